//! Simplification of a surface that is too large for its memory.
//!
//! Pieces are simplified one after the other, with the vertices that they share held fast. What is left of them is put together
//! to fewer pieces, in which what is around these vertices is simplified, but for what is at their own borders. The error
//! counts from the surface that was there first.
//!
//! Guarantees: as for a surface in memory; where triangles of two pieces met, pieces are as they were. Does not guarantee: that
//! no seam is left, if what is left is too large to be one piece.

use super::{Simplifier, indices};
use crate::params::OffsetError;
use crate::pieces::{Piece, Pieces, Visibility};
use crate::space;
use crate::store::{Block, Store};
use crate::tile::Patch;
use ravec_mesh::{Aabb, ErrorSample, Keep, TriMesh, add_rings};
use rustc_hash::FxHashMap;
use std::f64::consts::PI;

/// How many rings of triangles beside the vertices that pieces share are simplified when all pieces are.
const SEAM_RINGS: usize = 1;

/// How often a piece is simplified whose triangles meet those of others, each time with more left as it was, before all of it
/// is.
const MOST_TRIES: u32 = 4;

/// A surface with fewer triangles.
pub(crate) enum Simplified {
    Mesh(TriMesh),
    Pieces(Pieces),
}

/// A piece, simplified, with the samples near its border.
struct Done {
    patch: Patch,
    samples: Vec<ErrorSample>,
}

impl Simplifier<'_> {
    /// The surface with fewer triangles; pieces of at most so many triangles are put in a store that is made for each pass.
    pub fn run(
        &self,
        surface: Pieces,
        most_triangles: usize,
        new_store: impl Fn() -> Result<Store, OffsetError>,
    ) -> Result<Simplified, OffsetError> {
        let progress = self.proofs.progress;
        if surface.count() == 1 {
            let mesh = surface.into_mesh(progress)?;
            return Ok(Simplified::Mesh(self.whole(mesh, Keep::default())?));
        }
        let simplify = |piece: &Piece, held: &[bool]| self.apart(piece, held);
        let (fewer, samples) = self.pass(&surface, most_triangles, &new_store, simplify)?;
        drop(surface);
        if fewer.count() == 1 {
            let piece = fewer.piece(0, progress)?;
            let seams = Seams::of(&fewer, &piece, &samples);
            drop(fewer);
            let held = seams.held(&[]);
            let keep = Keep {
                vertices: &held,
                samples: Some(seams.samples),
                ..Keep::default()
            };
            return Ok(Simplified::Mesh(self.whole(piece.mesh, keep)?));
        }
        let simplify = |piece: &Piece, held: &[bool]| {
            let seams = Seams::of(&fewer, piece, &samples);
            self.together(piece, held, seams)
        };
        let (done, _) = self.pass(&fewer, most_triangles, &new_store, simplify)?;
        Ok(Simplified::Pieces(done))
    }

    /// Simplifies each piece, which becomes a block, as often as it takes for triangles of two of them not to meet.
    fn pass(
        &self,
        surface: &Pieces,
        most_triangles: usize,
        new_store: &impl Fn() -> Result<Store, OffsetError>,
        simplify: impl Fn(&Piece, &[bool]) -> Result<Done, OffsetError>,
    ) -> Result<(Pieces, Vec<Vec<ErrorSample>>), OffsetError> {
        let progress = self.proofs.progress;
        let mut store = new_store()?;
        let mut blocks: Vec<Option<Block>> = (0..surface.count()).map(|_| None).collect();
        let mut samples = vec![Vec::new(); surface.count()];
        // where triangles met
        let mut places: Vec<Vec<Aabb>> = vec![Vec::new(); surface.count()];
        for tries in 0.. {
            for (at, block) in blocks.iter_mut().enumerate() {
                if block.is_some() {
                    continue;
                }
                let piece = surface.piece(at, progress)?;
                let key = surface.blocks()[surface.blocks_of(at).start].key;
                let done = if tries < MOST_TRIES {
                    let is_held =
                        |&p: &glam::DVec3| places[at].iter().any(|place| place.contains(p));
                    let held: Vec<bool> = piece.mesh.positions().iter().map(is_held).collect();
                    simplify(&piece, &held)?
                } else {
                    Done {
                        patch: patch(&piece, piece.mesh.clone(), |v| v),
                        samples: vec![],
                    }
                };
                samples[at] = done.samples;
                *block = Some(space::block(key, done.patch, &store)?);
            }
            let made: Vec<Block> = blocks.drain(..).flatten().collect();
            let fewer = Pieces::new(store, made, most_triangles, Visibility::All, progress)?;
            let meeting = fewer.meeting_pairs(progress)?;
            if meeting.is_empty() || tries > MOST_TRIES {
                return Ok((fewer, samples));
            }
            let mut is_bad = vec![false; fewer.blocks().len()];
            for &[block, t] in meeting.as_flattened() {
                let patch = fewer.patch(block as usize)?;
                let corners = patch.triangles[t as usize].map(|v| patch.positions[v as usize]);
                let bounds = Aabb::around(corners);
                places[block as usize].push(bounds.grown(0.5 * bounds.diagonal()));
                is_bad[block as usize] = true;
            }
            let (old_store, made) = fewer.into_blocks();
            store = old_store;
            let kept = made.into_iter().zip(is_bad);
            blocks.extend(kept.map(|(block, is_bad)| (!is_bad).then_some(block)));
        }
        unreachable!("the loop ends with a result")
    }

    /// Simplifies a piece but for its border and what is held.
    fn apart(&self, piece: &Piece, held: &[bool]) -> Result<Done, OffsetError> {
        let mut border = piece.border();
        for (v, &is_held) in held.iter().enumerate() {
            border[v] |= is_held;
        }
        let fixed = indices(&border);
        let prepared = self.prepared(&piece.mesh, &border)?;
        let surface = prepared.as_ref().unwrap_or(&piece.mesh);
        let keep = Keep {
            vertices: &fixed,
            sealed: true,
            reports_samples: true,
            ..Keep::default()
        };
        let Some(mut simplified) = self.merged(surface, keep, PI)? else {
            return Ok(Done {
                patch: patch(piece, surface.clone(), |v| v),
                samples: vec![],
            });
        };
        if self.is_merged_twice {
            let sealed = (simplified.vertex_origin.iter()).map(|&v| border[v as usize]);
            let sealed: Vec<bool> = sealed.collect();
            let eased = self.eased(surface, &simplified.mesh);
            simplified = eased.merged_again(simplified, &sealed)?;
        }
        let origin = |v: usize| simplified.vertex_origin[v] as usize;
        let near = around(&simplified.mesh, |v| border[origin(v)]);
        let is_near = |sample: &&ErrorSample| {
            let corners = simplified.mesh.triangles()[sample.triangle as usize];
            corners.iter().any(|&v| near[v as usize])
        };
        Ok(Done {
            samples: simplified.samples.iter().filter(is_near).copied().collect(),
            patch: patch(piece, simplified.mesh.clone(), origin),
        })
    }

    /// Simplifies what is around the seams in a piece, but for its border and what is held, and turns facets that lie badly.
    fn together(&self, piece: &Piece, held: &[bool], seams: Seams) -> Result<Done, OffsetError> {
        let mut border = piece.border();
        for (v, &is_held) in held.iter().enumerate() {
            border[v] |= is_held;
        }
        let fixed = seams.held(&border);
        let keep = Keep {
            vertices: &fixed,
            sealed: true,
            samples: Some(seams.samples),
            ..Keep::default()
        };
        let samples = vec![];
        let Some(simplified) = self.merged(&piece.mesh, keep, PI)? else {
            let patch = patch(piece, piece.mesh.clone(), |v| v);
            return Ok(Done { patch, samples });
        };
        let origin = |v: usize| simplified.vertex_origin[v] as usize;
        let sealed: Vec<bool> = (0..simplified.mesh.positions().len())
            .map(|v| border[origin(v)])
            .collect();
        let turned = self.turned(&simplified.mesh, &sealed, false)?;
        let patch = patch(piece, turned, origin);
        Ok(Done { patch, samples })
    }
}

/// What is around the vertices that several blocks of a piece share.
struct Seams {
    is_free: Vec<bool>,
    samples: Vec<ErrorSample>,
}

impl Seams {
    /// Those of a piece, with the samples of each block.
    fn of(surface: &Pieces, piece: &Piece, samples: &[Vec<ErrorSample>]) -> Self {
        let mut first_block = vec![u32::MAX; piece.mesh.positions().len()];
        let mut is_shared = vec![false; first_block.len()];
        let mut first_triangle: FxHashMap<u32, u32> = FxHashMap::default();
        let triangles = (0u32..).zip(piece.mesh.triangles()).zip(&piece.origin);
        for ((t, corners), &[block, _]) in triangles {
            first_triangle.entry(block).or_insert(t);
            for &v in corners {
                let first = &mut first_block[v as usize];
                if *first == u32::MAX {
                    *first = block;
                }
                is_shared[v as usize] |= *first != block;
            }
        }
        let is_free = around(&piece.mesh, |v| is_shared[v]);
        let blocks = 0..surface.blocks().len();
        let of_blocks = blocks.filter_map(|block| {
            let first = *first_triangle.get(&(block as u32))?;
            Some(samples.get(block)?.iter().map(move |sample| ErrorSample {
                triangle: first + sample.triangle,
                ..*sample
            }))
        });
        Self {
            samples: of_blocks.flatten().collect(),
            is_free,
        }
    }

    /// The vertices that are not near a seam, or at the border.
    fn held(&self, border: &[bool]) -> Vec<u32> {
        let is_border = |v: u32| border.get(v as usize) == Some(&true);
        let all = 0..self.is_free.len() as u32;
        all.filter(|&v| !self.is_free[v as usize] || is_border(v))
            .collect()
    }
}

/// Some vertices and those around them.
fn around(mesh: &TriMesh, is_first: impl Fn(usize) -> bool) -> Vec<bool> {
    let mut near: Vec<bool> = (0..mesh.positions().len()).map(is_first).collect();
    add_rings(&mut near, mesh, SEAM_RINGS);
    near
}

/// A mesh as the patch of a block, its vertices called as those of the piece that they were.
fn patch(piece: &Piece, mesh: TriMesh, origin: impl Fn(usize) -> usize) -> Patch {
    let (positions, triangles) = mesh.into_parts();
    Patch {
        names: (0..positions.len())
            .map(|v| piece.names[origin(v)])
            .collect(),
        edge_of: vec![0; triangles.len()],
        ample: vec![false; triangles.len()],
        positions,
        triangles,
        ..Patch::default()
    }
}

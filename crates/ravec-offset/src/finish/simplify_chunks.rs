//! Simplification of a surface that exceeds the memory.
//!
//! Chunks are simplified one after the other, with their shared vertices fixed. The results form fewer chunks, in which the
//! surroundings of these vertices are simplified, except at the new borders. The error counts from the original surface.
//!
//! Guarantees: as for a surface in memory; chunks whose triangles would intersect stay as they were. Does not guarantee: that
//! no seam remains, if the result exceeds one chunk.

use super::{Simplifier, indices};
use crate::params::OffsetError;
use crate::remote::{ChunkTask, Remote, SimplifiedChunk};
use crate::store::{
    Block, Chunk, ChunkedSurface, Record, Store, Visibility, encoded_samples, merged_pairs,
    put_block,
};
use crate::surface::Patch;
use ravec_mesh::{Aabb, ErrorSample, Keep, TriMesh, add_rings};
use ravec_progress::Progress;
use rustc_hash::FxHashMap;
use std::f64::consts::PI;

/// Rings of triangles around shared vertices that the second pass simplifies.
const SEAM_RINGS: usize = 1;

/// Bound on the attempts for a chunk whose triangles intersect those of others, each with more triangles fixed; then all of it
/// stays.
const MAX_TRIES: u32 = 4;

/// A simplified surface.
pub(crate) enum Simplified {
    Mesh(TriMesh),
    Chunked(ChunkedSurface),
}

/// A simplified chunk, with the error samples near its border.
struct Done {
    patch: Patch,
    samples: Vec<ErrorSample>,
}

impl Simplifier<'_> {
    /// Simplifies the surface; chunks of at most `max_triangles` triangles go to a new store for each pass.
    pub fn run(
        &self,
        surface: ChunkedSurface,
        max_triangles: usize,
        remote: Option<&dyn Remote>,
        new_store: impl Fn() -> Result<Store, OffsetError>,
    ) -> Result<Simplified, OffsetError> {
        let progress = self.rules.progress;
        if surface.count() == 1 {
            let mesh = surface.into_mesh(progress)?;
            return Ok(Simplified::Mesh(self.whole(mesh, Keep::default())?));
        }
        let new_store =
            || remote.map_or_else(&new_store, |remote| Ok(Store::Storage(remote.parts())));
        let (fewer, samples) = self.pass(&surface, &[], max_triangles, remote, &new_store)?;
        drop(surface);
        if fewer.count() == 1 {
            let chunk = fewer.chunk(0, progress)?;
            let seams = Seams::of(&chunk, 0, &fewer.samples(&samples)?);
            drop(fewer);
            let pinned = seams.pinned(&[]);
            let keep = Keep {
                vertices: &pinned,
                samples: Some(seams.samples),
                ..Keep::default()
            };
            return Ok(Simplified::Mesh(self.whole(chunk.mesh, keep)?));
        }
        let (done, _) = self.pass(&fewer, &samples, max_triangles, remote, &new_store)?;
        Ok(Simplified::Chunked(done))
    }

    /// Simplifies each chunk to one block, repeatedly until triangles of two of them do not intersect: except for its border, or
    /// around the seams in it, if there are samples of its blocks.
    fn pass(
        &self,
        surface: &ChunkedSurface,
        samples_of_blocks: &[Record],
        max_triangles: usize,
        remote: Option<&dyn Remote>,
        new_store: &impl Fn() -> Result<Store, OffsetError>,
    ) -> Result<(ChunkedSurface, Vec<Record>), OffsetError> {
        let progress = self.rules.progress;
        let mut store = new_store()?;
        let mut blocks: Vec<Option<Block>> = (0..surface.count()).map(|_| None).collect();
        let mut samples = vec![Record::default(); surface.count()];
        // where triangles met
        let mut places: Vec<Vec<Aabb>> = vec![Vec::new(); surface.count()];
        for tries in 0.. {
            let open = (0..blocks.len()).filter(|&at| blocks[at].is_none());
            let tasks = open.map(|chunk| ChunkTask {
                chunk,
                places: places[chunk].clone(),
                is_kept: tries >= MAX_TRIES,
                samples: (samples_of_blocks.get(surface.blocks_of(chunk))).map(<[_]>::to_vec),
            });
            let tasks: Vec<ChunkTask> = tasks.collect();
            let at: Vec<usize> = tasks.iter().map(|task| task.chunk).collect();
            let done = match remote {
                Some(remote) => remote.simplify(surface, tasks, progress)?,
                None => (tasks.into_iter())
                    .map(|task| self.simplify_chunk(surface, task, &store))
                    .collect::<Result<_, _>>()?,
            };
            for (at, done) in at.into_iter().zip(done) {
                samples[at] = done.samples;
                blocks[at] = Some(done.block);
            }
            let made: Vec<Block> = blocks.drain(..).flatten().collect();
            let fewer = ChunkedSurface::new(store, made, max_triangles, Visibility::All, progress)?;
            let meeting = pairs(&fewer, remote, progress)?;
            if meeting.is_empty() || tries > MAX_TRIES {
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

    /// Simplifies a chunk to one block.
    pub fn simplify_chunk(
        &self,
        surface: &ChunkedSurface,
        task: ChunkTask,
        store: &Store,
    ) -> Result<SimplifiedChunk, OffsetError> {
        let chunk = surface.chunk(task.chunk, self.rules.progress)?;
        let blocks = surface.blocks_of(task.chunk);
        let key = surface.blocks()[blocks.start].key;
        let done = if task.is_kept {
            Done {
                patch: patch(&chunk, chunk.mesh.clone(), |v| v),
                samples: vec![],
            }
        } else {
            let is_pinned = |&p: &glam::DVec3| task.places.iter().any(|place| place.contains(p));
            let pinned: Vec<bool> = chunk.mesh.positions().iter().map(is_pinned).collect();
            match task.samples {
                Some(records) => {
                    let seams = Seams::of(&chunk, blocks.start, &surface.samples(&records)?);
                    self.together(&chunk, &pinned, seams)?
                }
                None => self.apart(&chunk, &pinned)?,
            }
        };
        Ok(SimplifiedChunk {
            block: put_block(key, done.patch, store)?,
            samples: store.put_bytes(&encoded_samples(&done.samples))?,
        })
    }

    /// Simplifies a chunk except for its border and pinned vertices.
    fn apart(&self, chunk: &Chunk, pinned: &[bool]) -> Result<Done, OffsetError> {
        let mut border = chunk.border();
        for (v, &is_pinned) in pinned.iter().enumerate() {
            border[v] |= is_pinned;
        }
        let fixed = indices(&border);
        let prepared = self.prepared(&chunk.mesh, &border)?;
        let surface = prepared.as_ref().unwrap_or(&chunk.mesh);
        let keep = Keep {
            vertices: &fixed,
            sealed: true,
            reports_samples: true,
            ..Keep::default()
        };
        let Some(mut simplified) = self.merged(surface, keep, PI)? else {
            return Ok(Done {
                patch: patch(chunk, surface.clone(), |v| v),
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
            patch: patch(chunk, simplified.mesh.clone(), origin),
        })
    }

    /// Simplifies the surroundings of the seams in a chunk, except for its border and pinned vertices, and improves tilted
    /// facets.
    fn together(&self, chunk: &Chunk, pinned: &[bool], seams: Seams) -> Result<Done, OffsetError> {
        let mut border = chunk.border();
        for (v, &is_pinned) in pinned.iter().enumerate() {
            border[v] |= is_pinned;
        }
        let fixed = seams.pinned(&border);
        let keep = Keep {
            vertices: &fixed,
            sealed: true,
            samples: Some(seams.samples),
            ..Keep::default()
        };
        let samples = vec![];
        let Some(simplified) = self.merged(&chunk.mesh, keep, PI)? else {
            let patch = patch(chunk, chunk.mesh.clone(), |v| v);
            return Ok(Done { patch, samples });
        };
        let origin = |v: usize| simplified.vertex_origin[v] as usize;
        let sealed: Vec<bool> = (0..simplified.mesh.positions().len())
            .map(|v| border[origin(v)])
            .collect();
        let turned = self.turned(&simplified.mesh, &sealed, false)?;
        let patch = patch(chunk, turned, origin);
        Ok(Done { patch, samples })
    }
}

/// Returns the pairs of triangles of a surface that intersect, each by its block and its number there.
pub(super) fn pairs(
    surface: &ChunkedSurface,
    remote: Option<&dyn Remote>,
    progress: &Progress,
) -> Result<Vec<[[u32; 2]; 2]>, OffsetError> {
    let found: Vec<_> = match remote {
        Some(remote) => remote.pairs(surface, progress)?,
        None => (0..surface.count())
            .map(|chunk| surface.pairs_in(chunk, progress))
            .collect::<Result<_, _>>()?,
    };
    Ok(merged_pairs(&found))
}

/// Surroundings of the vertices that several blocks of a chunk share.
struct Seams {
    is_free: Vec<bool>,
    samples: Vec<ErrorSample>,
}

impl Seams {
    /// Finds the seams of a chunk, with the error samples of its blocks, whose numbers start at `first`.
    fn of(chunk: &Chunk, first: usize, samples: &[Vec<ErrorSample>]) -> Self {
        let mut first_block = vec![u32::MAX; chunk.mesh.positions().len()];
        let mut is_shared = vec![false; first_block.len()];
        let mut first_triangle: FxHashMap<u32, u32> = FxHashMap::default();
        let triangles = (0u32..).zip(chunk.mesh.triangles()).zip(&chunk.origin);
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
        let is_free = around(&chunk.mesh, |v| is_shared[v]);
        let of_blocks = (first as u32..)
            .zip(samples)
            .filter_map(|(block, samples)| {
                let first = *first_triangle.get(&block)?;
                Some(samples.iter().map(move |sample| ErrorSample {
                    triangle: first + sample.triangle,
                    ..*sample
                }))
            });
        Self {
            samples: of_blocks.flatten().collect(),
            is_free,
        }
    }

    /// Returns the vertices that are not near a seam, or at the border.
    fn pinned(&self, border: &[bool]) -> Vec<u32> {
        let is_border = |v: u32| border.get(v as usize) == Some(&true);
        let all = 0..self.is_free.len() as u32;
        all.filter(|&v| !self.is_free[v as usize] || is_border(v))
            .collect()
    }
}

/// Marks some vertices and those around them.
fn around(mesh: &TriMesh, is_first: impl Fn(usize) -> bool) -> Vec<bool> {
    let mut near: Vec<bool> = (0..mesh.positions().len()).map(is_first).collect();
    add_rings(&mut near, mesh, SEAM_RINGS);
    near
}

/// Converts a mesh to the patch of a block, with the vertex names of the chunk.
fn patch(chunk: &Chunk, mesh: TriMesh, origin: impl Fn(usize) -> usize) -> Patch {
    let (positions, triangles) = mesh.into_parts();
    Patch {
        names: (0..positions.len())
            .map(|v| chunk.names[origin(v)])
            .collect(),
        edge_of: vec![0; triangles.len()],
        ample: vec![false; triangles.len()],
        positions,
        triangles,
        ..Patch::default()
    }
}

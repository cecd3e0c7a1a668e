//! What is left to do when a surface is mended: to merge triangles, to measure what is left and to look at it once more.

use crate::field::Field;
use crate::measure::{Ample, Measured, creases, measure};
use crate::mend::{Budget, Mended};
use crate::offset::{Offset, OffsetReport, StoredOffset};
use crate::params::{OffsetError, OffsetParams, Side};
use crate::pieces::{Piece, Pieces};
use crate::simplify::{Simplified, Simplifier};
use crate::store::{Scratch, Store};
use crate::stored::{OffsetSurface, StoredSurface};
use crate::thicken::without_slivers;
use ravec_mesh::{CheckParams, MeshCheck, TriMesh, check, weld};
use ravec_progress::{Cancelled, Progress};

/// How a surface is finished.
pub(crate) struct Finish<'a> {
    pub params: &'a OffsetParams,
    pub field: &'a Field<'a>,
    /// The least and the largest distance that a point of the surface may have.
    pub limits: [f64; 2],
    pub budget: Budget<'a>,
}

/// What holds for a finished surface.
struct Facts {
    measured: Measured,
    feature_edges: u64,
    triangles: u64,
    is_closed_manifold: bool,
    self_intersections: u64,
}

/// A surface whose triangles are merged if that was asked for.
enum Merged {
    Mesh {
        mesh: TriMesh,
        /// Of each triangle whether ample room below it was proved; empty if that is not known.
        ample: Vec<bool>,
        /// Whether it is known to meet itself nowhere.
        is_apart: bool,
    },
    Pieces {
        pieces: Pieces,
        is_apart: bool,
    },
}

impl Finish<'_> {
    /// Finishes a surface of a `mesh`, in memory or where it is kept.
    pub fn run(
        &self,
        mesh: &TriMesh,
        mended: Mended,
        progress: &Progress,
    ) -> Result<StoredOffset, OffsetError> {
        let so_far = mended.report();
        let ample_distance = mended.ample_distance;
        let (surface, facts) = match self.merged(mesh, mended, progress)? {
            Merged::Pieces { pieces, is_apart } if self.params.side != Side::Shell => {
                let facts = self.facts_of_pieces(&pieces, ample_distance, is_apart, progress)?;
                let stored = StoredSurface::new(pieces, progress)?;
                (OffsetSurface::from(stored), facts)
            }
            Merged::Pieces { pieces, .. } => {
                let whole = pieces.into_mesh(progress)?;
                let (surface, facts) = self.in_memory(mesh, whole, false, progress)?;
                (OffsetSurface::from(surface), facts)
            }
            Merged::Mesh {
                mesh: whole,
                ample: facets,
                is_apart,
            } => {
                let distance = ample_distance;
                let ample = Ample {
                    distance,
                    facets: &facets,
                };
                let measured = measure(self.field, &whole, self.limits, ample, progress)?;
                let (surface, facts) =
                    self.measured(mesh, whole, measured, is_apart, false, progress)?;
                (OffsetSurface::from(surface), facts)
            }
        };
        let report = facts.report(&so_far);
        Ok(StoredOffset { surface, report })
    }

    /// Finishes a surface around all that triangles wind around: without parts and cavities of less volume than a cube whose side
    /// is the tolerance.
    pub fn wound(
        &self,
        mesh: &TriMesh,
        mended: Mended,
        progress: &Progress,
    ) -> Result<Offset, OffsetError> {
        let so_far = mended.report();
        let whole = match self.merged(mesh, mended, progress)? {
            Merged::Mesh { mesh, .. } => mesh,
            Merged::Pieces { pieces, .. } => pieces.into_mesh(progress)?,
        };
        let least_volume = self.params.tolerance.powi(3);
        let whole = without_slivers(whole, least_volume, progress)?;
        let (mesh, facts) = self.in_memory(mesh, whole, true, progress)?;
        let report = facts.report(&so_far);
        Ok(Offset { mesh, report })
    }

    fn merged(
        &self,
        mesh: &TriMesh,
        mended: Mended,
        progress: &Progress,
    ) -> Result<Merged, OffsetError> {
        let (params, is_apart) = (self.params, mended.is_proved);
        if params.simplify {
            let simplifier = Simplifier::new(self.field, params, self.limits, mesh, progress)?;
            let most_triangles = self.budget.triangles;
            let new_store = || Ok(Store::Storage(Scratch::new(self.budget.storage)?));
            let simplified = simplifier.run(mended.surface, most_triangles, new_store)?;
            return Ok(match simplified {
                Simplified::Pieces(pieces) => Merged::Pieces {
                    pieces,
                    is_apart: false,
                },
                Simplified::Mesh(mesh) => Merged::Mesh {
                    mesh,
                    ample: vec![],
                    is_apart: false,
                },
            });
        }
        let pieces = mended.surface;
        if pieces.count() > 1 {
            return Ok(Merged::Pieces { pieces, is_apart });
        }
        let Piece { mesh, ample, .. } = pieces.piece(0, progress)?;
        Ok(Merged::Mesh {
            mesh,
            ample,
            is_apart,
        })
    }

    /// A surface in memory of which nothing is known.
    fn in_memory(
        &self,
        mesh: &TriMesh,
        surface: TriMesh,
        wound: bool,
        progress: &Progress,
    ) -> Result<(TriMesh, Facts), OffsetError> {
        let ample = Ample {
            distance: 0.0,
            facets: &[],
        };
        let measured = measure(self.field, &surface, self.limits, ample, progress)?;
        self.measured(mesh, surface, measured, false, wound, progress)
    }

    /// A surface in memory that was measured; of a shell with the mesh.
    fn measured(
        &self,
        mesh: &TriMesh,
        mut surface: TriMesh,
        measured: Measured,
        mut is_apart: bool,
        wound: bool,
        progress: &Progress,
    ) -> Result<(TriMesh, Facts), OffsetError> {
        let reach = self.reach(wound);
        let feature_edges = creases(self.field, &surface, reach, |_| true, progress)?;
        if self.params.side == Side::Shell {
            surface = shell(mesh, &surface);
            is_apart = false;
        }
        // what is as it was mended meets itself nowhere
        let last = CheckParams {
            self_intersections: !is_apart,
            list_limit: 0,
        };
        let checked = check_written(&surface, &last, progress)?;
        let facts = Facts {
            measured,
            feature_edges,
            triangles: surface.triangles().len() as u64,
            is_closed_manifold: checked.closed && checked.manifold && checked.oriented,
            self_intersections: checked.self_intersections.map_or(0, |found| found.count),
        };
        Ok((surface, facts))
    }

    /// What holds for a surface that stays where it is kept.
    fn facts_of_pieces(
        &self,
        pieces: &Pieces,
        ample_distance: f64,
        is_apart: bool,
        progress: &Progress,
    ) -> Result<Facts, OffsetError> {
        let self_intersections = if is_apart {
            0
        } else {
            pieces.meeting_pairs(progress)?.len() as u64
        };
        let mut measured: Option<Measured> = None;
        for at in 0..pieces.count() {
            let piece = pieces.piece(at, progress)?;
            let ample = Ample {
                distance: ample_distance,
                facets: &piece.ample,
            };
            let of_piece = measure(self.field, &piece.mesh, self.limits, ample, progress)?;
            measured = Some(match measured {
                Some(before) => before.and(of_piece),
                None => of_piece,
            });
        }
        let mut feature_edges = 0;
        for at in 0..pieces.count() {
            let piece = pieces.piece_with_neighbors(at, progress)?;
            // an edge between two pieces belongs to the first of them
            let is_first = |[a, b]: [u32; 2]| {
                let [p, q] = [a, b].map(|t| piece.origin[t as usize]);
                (if p < q { a } else { b } as usize) < piece.own
            };
            let reach = self.reach(false);
            feature_edges += creases(self.field, &piece.mesh, reach, is_first, progress)?;
        }
        Ok(Facts {
            measured: measured.expect("there is a piece"),
            feature_edges,
            triangles: pieces.triangles() as u64,
            is_closed_manifold: pieces.is_closed_manifold(progress)?,
            self_intersections,
        })
    }

    /// How far beside an edge normals are compared.
    fn reach(&self, wound: bool) -> f64 {
        let reach = 2.0 * self.params.tolerance;
        if wound {
            reach
        } else {
            reach.min(0.125 * self.params.distance)
        }
    }
}

impl Mended {
    /// What mending says of itself.
    fn report(&self) -> OffsetReport {
        let triangles = self.surface.triangles() as u64;
        OffsetReport {
            certified: false,
            uncertified_facets: triangles,
            solid: false,
            self_intersections: 0,
            triangles,
            extracted_triangles: triangles,
            cells: self.cells,
            deepest_level: self.deepest_level,
            tiles: self.tiles,
            rounds: self.rounds,
            split_cells: self.split,
            filled_corners: self.filled,
            least_distance: 0.0,
            most_distance: f64::INFINITY,
            most_distance_found: 0.0,
            feature_edges: 0,
            sheet_kept: None,
        }
    }
}

impl Facts {
    /// Adds what holds to what mending said.
    fn report(self, so_far: &OffsetReport) -> OffsetReport {
        let Measured {
            unproved,
            least,
            most,
            most_found,
        } = self.measured;
        OffsetReport {
            certified: unproved == 0,
            uncertified_facets: unproved,
            solid: self.is_closed_manifold && self.self_intersections == 0,
            self_intersections: self.self_intersections,
            triangles: self.triangles,
            least_distance: least,
            most_distance: most,
            most_distance_found: most_found,
            feature_edges: self.feature_edges,
            ..so_far.clone()
        }
    }
}

/// Looks at a result as a file holds it: vertices in one place are one for many who read it.
pub(crate) fn check_written(
    mesh: &TriMesh,
    params: &CheckParams,
    progress: &Progress,
) -> Result<MeshCheck, Cancelled> {
    check(&weld(mesh, 0.0).mesh, params, progress)
}

/// The mesh with the surface inside it, turned so that the space between them is inside.
fn shell(mesh: &TriMesh, inner: &TriMesh) -> TriMesh {
    let mut positions = mesh.positions().to_vec();
    let first = positions.len() as u32;
    positions.extend(inner.positions());
    let mut triangles = mesh.triangles().to_vec();
    let turned = inner
        .triangles()
        .iter()
        .map(|&[a, b, c]| [a, c, b].map(|v| v + first));
    triangles.extend(turned);
    TriMesh::new(positions, triangles).expect("corners of both have numbers")
}

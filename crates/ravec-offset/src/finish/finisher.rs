//! Finish of a repaired surface: merge triangles, measure and check the result.

use super::{Ample, Simplified, Simplifier, creases, is_rough, measure, pairs, without_slivers};
use crate::domain::Field;
use crate::params::{OffsetError, OffsetParams, Side};
use crate::repair::{Budget, Repaired};
use crate::report::{ChunkFacts, Measured, Offset, OffsetReport, StoredOffset};
use crate::store::{Chunk, ChunkedSurface, OffsetSurface, Scratch, Store, StoredSurface};
use ravec_mesh::{CheckParams, MeshCheck, TriMesh, check, weld};
use ravec_progress::{Cancelled, Progress};

/// Inputs of the finish.
pub(crate) struct Finish<'a> {
    pub params: &'a OffsetParams,
    pub field: &'a Field<'a>,
    /// Minimum and maximum distance of the points of the surface.
    pub limits: [f64; 2],
    pub budget: Budget<'a>,
}

/// Properties of the finished surface.
struct Facts {
    measured: Measured,
    feature_edges: u64,
    triangles: u64,
    is_closed_manifold: bool,
    self_intersections: u64,
}

/// A surface whose triangles are merged if requested.
enum Merged {
    Mesh {
        mesh: TriMesh,
        /// For each triangle, whether ample room below it is proved; empty if unknown.
        ample: Vec<bool>,
        /// The surface is known to be free of intersections.
        is_apart: bool,
    },
    Chunked {
        chunks: ChunkedSurface,
        is_apart: bool,
    },
}

impl Finish<'_> {
    /// Finishes a surface of a `mesh`, in memory or where it is kept.
    pub fn run(
        &self,
        mesh: &TriMesh,
        repaired: Repaired,
        progress: &Progress,
    ) -> Result<StoredOffset, OffsetError> {
        let so_far = repaired.report();
        let ample_distance = repaired.ample_distance;
        let (surface, facts) = match self.merged(mesh, repaired, progress)? {
            Merged::Chunked { chunks, is_apart } if self.params.side != Side::Shell => {
                let facts = self.facts_of_chunks(&chunks, ample_distance, is_apart, progress)?;
                let stored = StoredSurface::new(chunks, progress)?;
                (OffsetSurface::from(stored), facts)
            }
            Merged::Chunked { chunks, .. } => {
                let whole = chunks.into_mesh(progress)?;
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

    /// Finishes a surface around all points that triangles wind around, without components and cavities of less volume than a
    /// cube whose side is the tolerance.
    pub fn wound(
        &self,
        mesh: &TriMesh,
        repaired: Repaired,
        progress: &Progress,
    ) -> Result<Offset, OffsetError> {
        let so_far = repaired.report();
        let whole = match self.merged(mesh, repaired, progress)? {
            Merged::Mesh { mesh, .. } => mesh,
            Merged::Chunked { chunks, .. } => chunks.into_mesh(progress)?,
        };
        let min_volume = self.params.tolerance.powi(3);
        let whole = without_slivers(whole, min_volume, progress)?;
        let (mesh, facts) = self.in_memory(mesh, whole, true, progress)?;
        let report = facts.report(&so_far);
        Ok(Offset { mesh, report })
    }

    fn merged(
        &self,
        mesh: &TriMesh,
        repaired: Repaired,
        progress: &Progress,
    ) -> Result<Merged, OffsetError> {
        let (params, is_apart) = (self.params, repaired.is_proved);
        if params.simplify {
            let is_rough = is_rough(mesh, params);
            progress.check()?;
            let simplifier = Simplifier::new(self.field, params, self.limits, is_rough, progress);
            let max_triangles = self.budget.triangles;
            let new_store = || Ok(Store::Storage(Scratch::new(self.budget.storage)?));
            let remote = self.budget.remote;
            let simplified = simplifier.run(repaired.surface, max_triangles, remote, new_store)?;
            return Ok(match simplified {
                Simplified::Chunked(chunks) => Merged::Chunked {
                    chunks,
                    is_apart: false,
                },
                Simplified::Mesh(mesh) => Merged::Mesh {
                    mesh,
                    ample: vec![],
                    is_apart: false,
                },
            });
        }
        let chunks = repaired.surface;
        if chunks.count() > 1 {
            return Ok(Merged::Chunked { chunks, is_apart });
        }
        let Chunk { mesh, ample, .. } = chunks.chunk(0, progress)?;
        Ok(Merged::Mesh {
            mesh,
            ample,
            is_apart,
        })
    }

    /// Measures and checks a surface in memory.
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

    /// Checks a measured surface in memory; for a shell, together with the mesh.
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
        // a repaired surface that is unchanged is free of intersections
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

    /// Measures and checks a surface that stays in its storage.
    fn facts_of_chunks(
        &self,
        chunks: &ChunkedSurface,
        ample_distance: f64,
        is_apart: bool,
        progress: &Progress,
    ) -> Result<Facts, OffsetError> {
        let self_intersections = if is_apart {
            0
        } else {
            pairs(chunks, self.budget.remote, progress)?.len() as u64
        };
        let facts = match self.budget.remote {
            Some(remote) => remote.facts(chunks, ample_distance, progress)?,
            None => (0..chunks.count())
                .map(|chunk| self.facts_of_chunk(chunks, chunk, ample_distance, progress))
                .collect::<Result<_, _>>()?,
        };
        let measured = facts.iter().map(|of_chunk| of_chunk.measured);
        Ok(Facts {
            measured: measured.reduce(Measured::and).expect("there is a chunk"),
            feature_edges: facts.iter().map(|of_chunk| of_chunk.feature_edges).sum(),
            triangles: chunks.triangles() as u64,
            is_closed_manifold: facts.iter().all(|of_chunk| of_chunk.is_closed_manifold),
            self_intersections,
        })
    }

    /// Measures and checks a chunk of a surface.
    pub fn facts_of_chunk(
        &self,
        chunks: &ChunkedSurface,
        chunk: usize,
        ample_distance: f64,
        progress: &Progress,
    ) -> Result<ChunkFacts, OffsetError> {
        let own = chunks.chunk(chunk, progress)?;
        let ample = Ample {
            distance: ample_distance,
            facets: &own.ample,
        };
        let measured = measure(self.field, &own.mesh, self.limits, ample, progress)?;
        drop(own);
        let chunk = chunks.chunk_with_neighbors(chunk, progress)?;
        // an edge between two chunks belongs to the first of them
        let is_first = |[a, b]: [u32; 2]| {
            let [p, q] = [a, b].map(|t| chunk.origin[t as usize]);
            (if p < q { a } else { b } as usize) < chunk.own
        };
        let reach = self.reach(false);
        Ok(ChunkFacts {
            measured,
            feature_edges: creases(self.field, &chunk.mesh, reach, is_first, progress)?,
            is_closed_manifold: chunk.is_closed_manifold(progress)?,
        })
    }

    /// Distance beside an edge at which normals are compared.
    fn reach(&self, wound: bool) -> f64 {
        let reach = 2.0 * self.params.tolerance;
        if wound {
            reach
        } else {
            reach.min(0.125 * self.params.distance)
        }
    }
}

impl Repaired {
    /// Report of the repair.
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
    /// Completes the report of the repair.
    fn report(self, so_far: &OffsetReport) -> OffsetReport {
        let Measured {
            unproved,
            least,
            most,
            max_found,
        } = self.measured;
        OffsetReport {
            certified: unproved == 0,
            uncertified_facets: unproved,
            solid: self.is_closed_manifold && self.self_intersections == 0,
            self_intersections: self.self_intersections,
            triangles: self.triangles,
            least_distance: least,
            most_distance: most,
            most_distance_found: max_found,
            feature_edges: self.feature_edges,
            ..so_far.clone()
        }
    }
}

/// Checks a result as readers of its file see it: with vertices at equal positions merged.
pub(crate) fn check_written(
    mesh: &TriMesh,
    params: &CheckParams,
    progress: &Progress,
) -> Result<MeshCheck, Cancelled> {
    check(&weld(mesh, 0.0).mesh, params, progress)
}

/// Joins the mesh and the surface inside it, reversed so that the space between them is inside.
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

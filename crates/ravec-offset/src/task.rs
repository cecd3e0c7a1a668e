//! An offset whose parameters are checked and whose inputs are prepared.

use crate::domain::{Enclosed, Field, Grid, Solid};
use crate::finish::Finish;
use crate::grow::Setting;
use crate::params::{OffsetError, OffsetParams, Side};
use crate::repair::{Budget, Repair, Repaired};
use crate::report::Offset;
use crate::store::{NewStorage, in_memory};
use glam::DVec3;
use ravec_mesh::{Aabb, Bvh, CheckParams, TriMesh, check};
use ravec_octree::Frame;
use ravec_progress::{Cancelled, Progress};
use std::sync::Arc;

/// Share of the tolerance by which the surface is moved off round numbers, at which sheets tend to touch exactly.
const OFF_ROUND: f64 = 0.0107;

/// Memory per node of the tree, including corners, polygons and triangles, in bytes: measured, rounded up.
const BYTES_PER_NODE: u64 = 512;

/// Memory per triangle during simplification, measurement and checks, in bytes: measured, rounded up.
const BYTES_PER_TRIANGLE: u64 = 1400;

/// Memory of the program itself, in bytes.
const BYTES_OF_PROGRAM: u64 = 40 << 20;

/// Share of the memory for trees and chunks: the sizes above are estimates.
const USED_SHARE: f64 = 0.75;

/// Memory beyond the mesh below which tiles are too small to be useful, in bytes.
const MIN_MEMORY: u64 = 64 << 20;

/// Topology that decides which side of a surface is inside.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Topology {
    boundary_edges: u64,
    is_oriented: bool,
}

impl Topology {
    /// For surfaces on both sides of all triangles.
    pub const UNKNOWN: Self = Self {
        boundary_edges: 0,
        is_oriented: false,
    };

    pub fn of(mesh: &TriMesh, progress: &Progress) -> Result<Self, Cancelled> {
        let quick = CheckParams {
            self_intersections: false,
            list_limit: 0,
        };
        let found = check(mesh, &quick, progress)?;
        Ok(Self {
            boundary_edges: found.boundary_edges.count,
            is_oriented: found.oriented,
        })
    }
}

/// Data that the offsets of a mesh share.
#[derive(Debug, Clone)]
pub(crate) struct Prepared {
    pub bounds: Aabb,
    pub bvh: Arc<Bvh>,
    /// Needed for other sides than both.
    pub topology: Topology,
}

/// A checked offset with its search tree, frame and grid.
pub(crate) struct Task {
    bvh: Arc<Bvh>,
    /// Interpretation of the triangles as a solid.
    solid: Solid,
    /// Signed distance of the surface.
    level: f64,
    /// Position of the octree.
    pub frame: Frame,
    pub grid: Grid,
}

impl Task {
    pub fn new(
        mesh: &TriMesh,
        params: &OffsetParams,
        progress: &Progress,
    ) -> Result<Self, OffsetError> {
        if mesh.triangles().is_empty() {
            return Err(OffsetError::NoTriangles);
        }
        params.check(&mesh.bounds())?;
        Self::checked(mesh, params, false, progress)
    }

    /// As [`Self::new`] for checked parameters; with `wound`, for the surface around all points that the triangles wind around.
    pub fn checked(
        mesh: &TriMesh,
        params: &OffsetParams,
        wound: bool,
        progress: &Progress,
    ) -> Result<Self, OffsetError> {
        // most of the check runs on one thread
        let (topology, bvh) = rayon::join(
            || match params.side {
                Side::Both => Ok(Topology::UNKNOWN),
                Side::Outer | Side::Inner | Side::Shell => Topology::of(mesh, progress),
            },
            || Bvh::try_new(mesh, progress),
        );
        let prepared = Prepared {
            bounds: mesh.bounds(),
            bvh: Arc::new(bvh?),
            topology: topology?,
        };
        Self::prepared(prepared, params, wound, progress)
    }

    /// As [`Self::checked`] for a mesh that is prepared.
    pub fn prepared(
        mesh: Prepared,
        params: &OffsetParams,
        wound: bool,
        progress: &Progress,
    ) -> Result<Self, OffsetError> {
        let Prepared {
            bounds,
            bvh,
            topology:
                Topology {
                    boundary_edges,
                    is_oriented,
                },
        } = mesh;
        let inward = params.side.is_inward();
        if inward && boundary_edges > 0 {
            return Err(OffsetError::NotClosed { boundary_edges });
        }
        progress.check()?;
        let level = if wound {
            0.0
        } else {
            params.distance + OFF_ROUND * params.tolerance
        };
        let margin = if inward { 0.0 } else { params.distance } + 4.0 * params.tolerance;
        let mut frame = frame_around(&bounds.grown(margin));
        let grid = Grid::fit(params.coordinates, &mut frame, params.tolerance)?;
        Ok(Self {
            bvh,
            solid: if params.side == Side::Both && !wound || boundary_edges > 0 {
                Solid::No
            } else if wound || is_oriented {
                Solid::Closed
            } else {
                Solid::Any
            },
            level: if inward { -level } else { level },
            frame,
            grid,
        })
    }

    /// Finds the space that the outermost surface can ignore. With signed distances, the inside of solids is known already.
    pub fn enclosed(
        &self,
        field: &Field<'_>,
        side: Side,
        max_nodes: usize,
        progress: &Progress,
    ) -> Result<Enclosed, Cancelled> {
        if side == Side::Outer && self.solid == Solid::No {
            Enclosed::find(field, &self.frame, max_nodes, progress)
        } else {
            Ok(Enclosed::default())
        }
    }

    /// The setting in which the octree is grown.
    pub fn setting<'a>(
        &self,
        field: &'a Field<'a>,
        enclosed: &'a Enclosed,
        params: &OffsetParams,
    ) -> Setting<'a> {
        Setting {
            field,
            enclosed,
            frame: self.frame,
            grid: self.grid,
            tolerance: params.tolerance,
        }
    }

    pub fn field(&self, progress: &Progress) -> Result<Field<'_>, Cancelled> {
        Field::new(&self.bvh, self.solid, self.level, progress)
    }

    /// Computes the surface, repaired until it is proved as far as possible.
    pub fn repaired(
        &self,
        params: &OffsetParams,
        finish: &Finish<'_>,
        progress: &Progress,
    ) -> Result<Repaired, OffsetError> {
        let Finish { field, budget, .. } = finish;
        let enclosed = self.enclosed(field, params.side, budget.nodes, progress)?;
        let repaired = self.repair(params, finish, &enclosed).run(progress)?;
        if repaired.surface.triangles() == 0 {
            return Err(OffsetError::Empty {
                distance: params.distance,
            });
        }
        Ok(repaired)
    }

    /// Prepares the repair of the surface, which ignores enclosed space.
    pub fn repair<'a>(
        &self,
        params: &OffsetParams,
        finish: &Finish<'a>,
        enclosed: &'a Enclosed,
    ) -> Repair<'a> {
        Repair {
            setting: self.setting(finish.field, enclosed, params),
            limits: finish.limits,
            outer_only: params.side == Side::Outer,
            budget: finish.budget,
        }
    }

    pub fn finish<'a>(
        &self,
        mesh: &TriMesh,
        params: &'a OffsetParams,
        field: &'a Field<'a>,
        storage: NewStorage<'a>,
    ) -> Result<Finish<'a>, OffsetError> {
        Ok(Finish {
            params,
            field,
            limits: [
                params.distance - params.tolerance,
                params.distance + params.tolerance,
            ],
            budget: budget(params, &self.bvh, mesh, storage)?,
        })
    }
}

/// Computes the surface around all points that the triangles of a mesh wind around, including cavities, without components and
/// cavities of less volume than a cube whose side is the tolerance. The parameters must be checked.
pub(crate) fn wound(
    mesh: &TriMesh,
    params: &OffsetParams,
    progress: &Progress,
) -> Result<Offset, OffsetError> {
    let task = Task::checked(mesh, params, true, progress)?;
    let field = task.field(progress)?;
    let finish = task.finish(mesh, params, &field, &in_memory)?;
    let repaired = task.repaired(params, &finish, progress)?;
    finish.wound(mesh, repaired, progress)
}

/// Returns a cube around a box, off its center, so that planes of symmetry do not coincide with faces of cells.
fn frame_around(bounds: &Aabb) -> Frame {
    let extent = bounds.size().max_element();
    let side = 1.0713 * extent;
    let slack = 0.5 * (side - extent);
    let low = bounds.center() - DVec3::splat(0.5 * side);
    Frame {
        origin: low + slack * DVec3::new(0.137, -0.211, 0.317),
        side,
    }
}

/// Divides the memory that the mesh leaves.
fn budget<'a>(
    params: &OffsetParams,
    bvh: &Bvh,
    mesh: &TriMesh,
    storage: NewStorage<'a>,
) -> Result<Budget<'a>, OffsetError> {
    let Some(bytes) = params.memory_bytes else {
        return Ok(Budget {
            nodes: usize::MAX,
            triangles: usize::MAX,
            storage,
            remote: None,
        });
    };
    let of_mesh = size_of_val(mesh.positions()) + size_of_val(mesh.triangles());
    let taken = (bvh.memory_bytes() + of_mesh) as u64;
    let least = taken + MIN_MEMORY;
    if bytes < least {
        return Err(OffsetError::Memory { got: bytes, least });
    }
    let left = ((bytes - taken - BYTES_OF_PROGRAM) as f64 * USED_SHARE) as u64;
    Ok(Budget {
        nodes: (left / BYTES_PER_NODE) as usize,
        triangles: (left / BYTES_PER_TRIANGLE) as usize,
        storage,
        remote: None,
    })
}

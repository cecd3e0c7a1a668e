//! The whole way from triangles to their offset surface.

use crate::enclosed::Enclosed;
use crate::field::{Field, Solid};
use crate::finish::Finish;
use crate::grid::{Grid, rounded};
use crate::mend::{Budget, Mended, Mending};
use crate::params::{Coordinates, OffsetError, OffsetParams, OpenRule, Side};
use crate::refine::Setting;
use crate::store::{NewStorage, in_memory};
use crate::stored::OffsetSurface;
use crate::thicken::thicken;
use glam::DVec3;
use ravec_mesh::{Bvh, CheckParams, TriMesh, check};
use ravec_octree::Frame;
use ravec_progress::{Cancelled, Progress};

/// The share of the tolerance by which the surface is moved off round numbers, at which sheets tend to touch exactly.
const OFF_ROUND: f64 = 0.0107;

/// Bytes that a node of the tree costs, with corners, polygons and triangles: as measured, rounded up.
const BYTES_PER_NODE: u64 = 512;

/// Bytes that a triangle costs while it is merged with others, measured and checked: as measured, rounded up.
const BYTES_PER_TRIANGLE: u64 = 1400;

/// Bytes that the program takes itself.
const BYTES_OF_PROGRAM: u64 = 40 << 20;

/// The share of the memory that trees and pieces are allowed, since what they take is only guessed by these bytes.
const USED_SHARE: f64 = 0.75;

/// Bytes without which no tile is worth its while, beside what the mesh itself takes.
const LEAST_MEMORY: u64 = 64 << 20;

/// Report of a Boolean operation and of the properties of its result.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct OffsetReport {
    /// Whether every facet is proved to keep the distance within the tolerance.
    pub certified: bool,
    /// Facets for which that proof failed.
    pub uncertified_facets: u64,
    /// Whether the surface is closed, manifold and consistently oriented, with vertices in one place taken as one.
    pub solid: bool,
    /// Pairs of triangles that meet where they should not.
    pub self_intersections: u64,
    /// Triangles of the result.
    pub triangles: u64,
    /// Triangles before simplification.
    pub extracted_triangles: u64,
    /// Leaves of the tree.
    pub cells: u64,
    /// The finest level of the tree that was used; the root is level 0.
    pub deepest_level: u8,
    /// Tiles that the tree was grown in, one after the other: 1 if all of it fitted in memory.
    pub tiles: u64,
    /// How often cells were split to mend the surface.
    pub rounds: u32,
    /// Leaves that were split to mend it.
    pub split_cells: u64,
    /// Corners of the finest cells that were put inside to mend it, where sheets come too close for cells to tell apart.
    pub filled_corners: u64,
    /// No point of the surface is nearer to the triangles than this: proved, and exact up to a thousandth of the tolerance.
    /// As the two below, of a shell it is about the surface inside.
    pub least_distance: f64,
    /// No point of the surface is farther from the triangles than this: proved.
    pub most_distance: f64,
    /// The largest distance that a corner or a middle of a facet has. The largest of all is between this and
    /// `most_distance`.
    pub most_distance_found: f64,
    /// Edges where the surface creases: both its facets and the normals of the true surface beside the edge turn by more
    /// than 20°.
    pub feature_edges: u64,
    /// Of a thickened sheet, whether its own triangles are one of the skins, unchanged but for their direction.
    pub sheet_kept: Option<bool>,
}

/// An offset surface.
#[derive(Debug, Clone)]
pub struct Offset {
    /// The surface; triangles are counterclockwise seen from outside of the offset solid.
    pub mesh: TriMesh,
    /// Report on it.
    pub report: OffsetReport,
}

/// An offset surface that need not be in memory.
#[derive(Debug)]
pub struct StoredOffset {
    /// The surface; triangles are counterclockwise seen from outside of the offset solid.
    pub surface: OffsetSurface,
    /// Report on it.
    pub report: OffsetReport,
}

/// The surface at a distance from the triangles of a mesh, which may be any triangles at all.
///
/// # Errors
/// [`OffsetError`]: no triangles, parameters out of range, a side that only closed meshes have, nothing that deep inside, a
/// sheet that is too rough to be thickened;
/// [`OffsetError::Cancelled`] soon after `progress` is.
pub fn offset(
    mesh: &TriMesh,
    params: &OffsetParams,
    progress: &Progress,
) -> Result<Offset, OffsetError> {
    let StoredOffset { surface, report } = offset_stored(mesh, params, &in_memory, progress)?;
    Ok(Offset {
        mesh: surface.into_mesh(progress)?,
        report,
    })
}

/// As [`offset`], but a surface that would take more memory than [`OffsetParams::memory_bytes`] is made in a `storage`, some
/// 180 bytes for each triangle before simplification, and stays there, to be written triangle by triangle.
///
/// # Errors
/// As [`offset`]; [`OffsetError::Storage`] if the storage fails.
pub fn offset_stored(
    mesh: &TriMesh,
    params: &OffsetParams,
    storage: NewStorage<'_>,
    progress: &Progress,
) -> Result<StoredOffset, OffsetError> {
    if mesh.triangles().is_empty() {
        return Err(OffsetError::NoTriangles);
    }
    // what becomes part of the result has to be what a file holds
    let is_part = params.open == OpenRule::Thicken || params.side == Side::Shell;
    if !is_part || params.coordinates == Coordinates::Double {
        return of_exact(mesh, params, storage, progress);
    }
    let got = params.tolerance;
    let Some((rounded, moved)) = rounded(mesh, params.coordinates) else {
        return Err(OffsetError::BeyondSinglePrecision);
    };
    let left = OffsetParams {
        // less than half is refused as well, by the same reason
        tolerance: got - moved.min(0.5 * got),
        ..params.clone()
    };
    let made = of_exact(&rounded, &left, storage, progress);
    let mut offset = made.map_err(|error| match error {
        OffsetError::SinglePrecision { least, .. } => OffsetError::SinglePrecision {
            got,
            least: least + moved,
        },
        OffsetError::Tolerance { least, most, .. } => OffsetError::Tolerance { got, least, most },
        other => other,
    })?;
    offset.report.least_distance -= moved;
    offset.report.most_distance += moved;
    Ok(offset)
}

/// As [`offset_stored`]; the mesh may become part of the result as it is.
fn of_exact(
    mesh: &TriMesh,
    params: &OffsetParams,
    storage: NewStorage<'_>,
    progress: &Progress,
) -> Result<StoredOffset, OffsetError> {
    if params.open == OpenRule::Thicken {
        let Offset { mesh, report } = thicken(mesh, params, progress)?;
        let surface = OffsetSurface::from(mesh);
        return Ok(StoredOffset { surface, report });
    }
    params.check(&mesh.bounds())?;
    let task = Task::checked(mesh, params, false, progress)?;
    let field = task.field(progress)?;
    let finish = task.finish(mesh, params, &field, storage)?;
    let mended = task.mended(params, &finish, progress)?;
    finish.run(mesh, mended, progress)
}

/// The surface around all that the triangles of a mesh wind around, cavities too, but without parts and cavities of less volume
/// than a cube whose side is the tolerance; for parameters that were checked.
pub(crate) fn wound(
    mesh: &TriMesh,
    params: &OffsetParams,
    progress: &Progress,
) -> Result<Offset, OffsetError> {
    let task = Task::checked(mesh, params, true, progress)?;
    let field = task.field(progress)?;
    let finish = task.finish(mesh, params, &field, &in_memory)?;
    let mended = task.mended(params, &finish, progress)?;
    finish.wound(mesh, mended, progress)
}

/// What is asked for, found possible and made ready.
pub(crate) struct Task {
    bvh: Bvh,
    /// Whether the triangles are taken as a solid.
    solid: Solid,
    /// The signed distance of the surface.
    level: f64,
    /// Where the tree lies.
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

    /// As [`Self::new`] for parameters that were checked; with `wound` around all that the triangles wind around.
    fn checked(
        mesh: &TriMesh,
        params: &OffsetParams,
        wound: bool,
        progress: &Progress,
    ) -> Result<Self, OffsetError> {
        let bounds = mesh.bounds();
        let quick = CheckParams {
            self_intersections: false,
            list_limit: 0,
        };
        // most of the check is done by one thread
        let (checked, bvh) = rayon::join(
            || match params.side {
                Side::Both => Ok(None),
                Side::Outer | Side::Inner | Side::Shell => check(mesh, &quick, progress).map(Some),
            },
            || Bvh::try_new(mesh, progress),
        );
        let (checked, bvh) = (checked?, bvh?);
        let boundary_edges = checked
            .as_ref()
            .map_or(0, |found| found.boundary_edges.count);
        let is_oriented = checked.is_some_and(|found| found.oriented);
        let inward = matches!(params.side, Side::Inner | Side::Shell);
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

    /// What need not be looked at for the outermost surface. Where distances have a sign, solids are inside anyway.
    pub fn enclosed(
        &self,
        field: &Field<'_>,
        side: Side,
        most_nodes: usize,
        progress: &Progress,
    ) -> Result<Enclosed, Cancelled> {
        if side == Side::Outer && self.solid == Solid::No {
            Enclosed::find(field, &self.frame, most_nodes, progress)
        } else {
            Ok(Enclosed::default())
        }
    }

    pub fn field(&self, progress: &Progress) -> Result<Field<'_>, Cancelled> {
        Field::new(&self.bvh, self.solid, self.level, progress)
    }

    /// The surface, proved as far as it can be.
    fn mended(
        &self,
        params: &OffsetParams,
        finish: &Finish<'_>,
        progress: &Progress,
    ) -> Result<Mended, OffsetError> {
        let Finish { field, budget, .. } = finish;
        let enclosed = self.enclosed(field, params.side, budget.nodes, progress)?;
        let mending = Mending {
            setting: Setting {
                field,
                enclosed: &enclosed,
                frame: self.frame,
                grid: self.grid,
                tolerance: params.tolerance,
            },
            limits: finish.limits,
            outer_only: params.side == Side::Outer,
            budget: *budget,
        };
        let mended = mending.run(progress)?;
        if mended.surface.triangles() == 0 {
            return Err(OffsetError::Empty {
                distance: params.distance,
            });
        }
        Ok(mended)
    }

    fn finish<'a>(
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

/// A cube around a box, off its center, so that planes of symmetry do not lie in faces of cells.
fn frame_around(bounds: &ravec_mesh::Aabb) -> Frame {
    let extent = bounds.size().max_element();
    let side = 1.0713 * extent;
    let slack = 0.5 * (side - extent);
    let low = bounds.center() - DVec3::splat(0.5 * side);
    Frame {
        origin: low + slack * DVec3::new(0.137, -0.211, 0.317),
        side,
    }
}

/// What fits in the memory that the mesh leaves.
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
        });
    };
    let of_mesh = size_of_val(mesh.positions()) + size_of_val(mesh.triangles());
    let taken = (bvh.memory_bytes() + of_mesh) as u64;
    let least = taken + LEAST_MEMORY;
    if bytes < least {
        return Err(OffsetError::Memory { got: bytes, least });
    }
    let left = ((bytes - taken - BYTES_OF_PROGRAM) as f64 * USED_SHARE) as u64;
    Ok(Budget {
        nodes: (left / BYTES_PER_NODE) as usize,
        triangles: (left / BYTES_PER_TRIANGLE) as usize,
        storage,
    })
}

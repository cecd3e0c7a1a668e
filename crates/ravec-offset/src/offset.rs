//! The whole way from triangles to their offset surface.

use crate::certify::keeps_distance;
use crate::field::Field;
use crate::mend::Mending;
use crate::params::{OffsetError, OffsetParams, Side};
use crate::simplify::simplify;
use glam::DVec3;
use ravec_mesh::{Bvh, CheckParams, TriMesh, check};
use ravec_octree::Frame;
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;

/// The share of the tolerance by which the surface is moved off round numbers, at which sheets tend to touch exactly.
const OFF_ROUND: f64 = 0.0107;

/// Bytes that a node of the tree costs, with corners, polygons and triangles: as measured, rounded up.
const BYTES_PER_NODE: u64 = 640;

/// Bytes without which no tile is worth its while, beside what the mesh itself takes.
const LEAST_MEMORY: u64 = 64 << 20;

/// What was done, and what holds for the result.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct OffsetReport {
    /// Whether every facet is proved to keep the distance within the tolerance.
    pub certified: bool,
    /// Facets for which that proof failed.
    pub uncertified_facets: u64,
    /// Whether the surface is closed, manifold and consistently oriented.
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
    /// Tiles that the tree was grown in, one after the other: 1 if memory is not limited.
    pub tiles: u64,
    /// How often cells were split to mend the surface.
    pub rounds: u32,
    /// Leaves that were split to mend it.
    pub split_cells: u64,
    /// Corners of the finest cells that were put inside to mend it, where sheets come too close for cells to tell apart.
    pub filled_corners: u64,
}

/// An offset surface.
#[derive(Debug, Clone)]
pub struct Offset {
    /// The surface; triangles are counterclockwise seen from outside of the offset solid.
    pub mesh: TriMesh,
    /// What holds for it.
    pub report: OffsetReport,
}

/// The surface at a distance from the triangles of a mesh, which may be any triangles at all.
///
/// # Errors
/// [`OffsetError`]: no triangles, parameters out of range, a side that only closed meshes have, nothing that deep inside;
/// [`OffsetError::Cancelled`] soon after `progress` is.
pub fn offset(
    mesh: &TriMesh,
    params: &OffsetParams,
    progress: &Progress,
) -> Result<Offset, OffsetError> {
    if mesh.triangles().is_empty() {
        return Err(OffsetError::NoTriangles);
    }
    let bounds = mesh.bounds();
    params.check(&bounds)?;
    let quick = CheckParams {
        self_intersections: false,
        list_limit: 0,
    };
    let boundary_edges = match params.side {
        Side::Both => 0,
        Side::Outer | Side::Inner | Side::Shell => {
            check(mesh, &quick, progress)?.boundary_edges.count
        }
    };
    let inward = matches!(params.side, Side::Inner | Side::Shell);
    if inward && boundary_edges > 0 {
        return Err(OffsetError::NotClosed { boundary_edges });
    }
    let bvh = Bvh::new(mesh);
    let is_solid = inward || (params.side == Side::Outer && boundary_edges == 0);
    let level = params.distance + OFF_ROUND * params.tolerance;
    let field = Field::new(&bvh, is_solid, if inward { -level } else { level });
    let margin = if inward { 0.0 } else { params.distance } + 4.0 * params.tolerance;
    let job = Job {
        params,
        field: &field,
    };
    let mending = Mending {
        field: &field,
        frame: frame_around(&bounds.grown(margin)),
        tolerance: params.tolerance,
        limits: job.limits(),
        outer_only: params.side == Side::Outer,
        most_nodes: match params.memory_bytes {
            Some(bytes) => nodes_within(bytes, &bvh, mesh)?,
            None => usize::MAX,
        },
    };
    let mended = mending.run(progress)?;
    if mended.triangles.is_empty() {
        return Err(OffsetError::Empty {
            distance: params.distance,
        });
    }
    let extracted_triangles = mended.triangles.len() as u64;
    let surface = TriMesh::new(mended.positions, mended.triangles);
    let mut surface = surface.expect("corners are finite and have numbers");
    let mut is_proved = mended.is_proved;
    if params.simplify {
        surface = simplify(&field, params, job.limits(), &surface, progress)?;
        is_proved = false;
    }
    let uncertified_facets = if is_proved {
        0
    } else {
        job.unproved(&surface, progress)?
    };
    if params.side == Side::Shell {
        surface = shell(mesh, &surface);
        is_proved = false;
    }
    // what is as it was mended meets itself nowhere
    let last = CheckParams {
        self_intersections: !is_proved,
        list_limit: 0,
    };
    let checked = check(&surface, &last, progress)?;
    let self_intersections = checked.self_intersections.map_or(0, |found| found.count);
    Ok(Offset {
        report: OffsetReport {
            certified: uncertified_facets == 0,
            uncertified_facets,
            solid: checked.closed
                && checked.manifold
                && checked.oriented
                && self_intersections == 0,
            self_intersections,
            triangles: surface.triangles().len() as u64,
            extracted_triangles,
            cells: mended.cells,
            deepest_level: mended.deepest_level,
            tiles: mended.tiles,
            rounds: mended.rounds,
            split_cells: mended.split,
            filled_corners: mended.filled,
        },
        mesh: surface,
    })
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

struct Job<'a> {
    params: &'a OffsetParams,
    field: &'a Field<'a>,
}

impl Job<'_> {
    /// The least and the largest distance that a point of the result may have.
    fn limits(&self) -> [f64; 2] {
        let &OffsetParams {
            distance,
            tolerance,
            ..
        } = self.params;
        [distance - tolerance, distance + tolerance]
    }

    /// How many facets are not proved to keep the distance.
    fn unproved(&self, surface: &TriMesh, progress: &Progress) -> Result<u64, Cancelled> {
        let limits = self.limits();
        (0..surface.triangles().len() as u32)
            .into_par_iter()
            .map(|t| {
                progress.check()?;
                Ok(u64::from(!keeps_distance(
                    self.field,
                    surface.corners(t),
                    limits,
                    [0; 3],
                )))
            })
            .try_reduce(|| 0, |a, b| Ok(a + b))
    }
}

/// How many nodes of a tree take half of the memory that the mesh leaves: the rest is for the surface.
fn nodes_within(bytes: u64, bvh: &Bvh, mesh: &TriMesh) -> Result<usize, OffsetError> {
    let of_mesh = size_of_val(mesh.positions()) + size_of_val(mesh.triangles());
    let taken = (bvh.memory_bytes() + of_mesh) as u64;
    let least = taken + LEAST_MEMORY;
    if bytes < least {
        return Err(OffsetError::Memory { got: bytes, least });
    }
    Ok(((bytes - taken) / 2 / BYTES_PER_NODE) as usize)
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

//! Defects of a mesh, and its topology.
//!
//! A mesh is *closed* if no edge has just one triangle, *manifold* if no edge has more than two and the triangles at each
//! vertex form one fan, and *oriented* if neighbors run along their common edge in opposite directions. A mesh that is all
//! three and does not intersect itself is the surface of a solid, which is what most uses need.
//!
//! Works on indices: vertices at the same place are two vertices. Weld them first if that is not meant.
//! Triangles that name a vertex twice count as degenerate and are otherwise passed over, as if their sides had been sewn
//! together.
//!
//! Guarantees: exact (areas and intersections by exact signs); the same on any number of threads.
//! Cost: O(n), about half a second a million triangles and core; as much again for intersections.

mod boundary;

use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::adjacency::is_proper;
use crate::par_collect::par_collect;
use crate::{Adjacency, BoxTree, SelfIntersections, TriMesh, on_one_line, self_intersections};

pub use boundary::BoundaryLoop;

/// Parameters of the check and of its report.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct CheckParams {
    /// `true` if to search for intersections (default true). It takes half of the time.
    pub self_intersections: bool,
    /// Number of defects of each kind to list (default 20). All are counted in any case.
    pub list_limit: usize,
}

impl Default for CheckParams {
    fn default() -> Self {
        Self {
            self_intersections: true,
            list_limit: 20,
        }
    }
}

/// Number of defects of one kind, and the first of them.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Found<T> {
    /// Number of them.
    pub count: u64,
    /// The first of them, in ascending order.
    pub listed: Vec<T>,
}

impl<T> Default for Found<T> {
    fn default() -> Self {
        Self {
            count: 0,
            listed: Vec::new(),
        }
    }
}

impl<T: Copy> Found<T> {
    /// Returns `true` if there are none.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    fn add(&mut self, item: T, limit: usize) {
        self.count += 1;
        if self.listed.len() < limit {
            self.listed.push(item);
        }
    }

    fn of(items: &[T], limit: usize) -> Self {
        Self {
            count: items.len() as u64,
            listed: items[..limit.min(items.len())].to_vec(),
        }
    }
}

/// The findings of [`check`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MeshCheck {
    /// The number of triangles.
    pub triangles: u64,
    /// The number of vertices, used or not.
    pub vertices: u64,
    /// The number of edges.
    pub edges: u64,
    /// The number of connected components; triangles that share a vertex are connected.
    pub components: u32,
    /// `true` if there are triangles, and no edge has just one.
    pub closed: bool,
    /// `true` if no edge has more than two triangles and no vertex more than one fan.
    pub manifold: bool,
    /// `true` if neighbors run along their common edges in opposite directions; where more than two triangles meet,
    /// whether as many run in either direction.
    pub oriented: bool,
    /// Vertices minus edges plus triangles, of what is used.
    pub euler: i64,
    /// The number of handles of all parts together; only of a closed, manifold and oriented mesh.
    pub genus: Option<u64>,
    /// Edges with just one triangle.
    pub boundary_edges: Found<[u32; 2]>,
    /// The chains that boundary edges form, the longest first.
    pub boundary_loops: Found<BoundaryLoop>,
    /// Edges with more than two triangles.
    pub non_manifold_edges: Found<[u32; 2]>,
    /// Vertices whose triangles form more than one fan.
    pub pinched_vertices: Found<u32>,
    /// Edges whose two triangles run along it in the same direction.
    pub orientation_clashes: Found<[u32; 2]>,
    /// Triangles without area, exactly.
    pub degenerate_triangles: Found<u32>,
    /// Triangles that name the same three vertices as one before them.
    pub duplicate_triangles: Found<u32>,
    /// Vertices that no triangle names.
    pub unused_vertices: Found<u32>,
    /// The self-intersections of the mesh, if they were requested.
    pub self_intersections: Option<SelfIntersections>,
}

impl MeshCheck {
    /// Returns `true` if the mesh is the surface of a solid: closed, manifold, oriented, and known not to intersect
    /// itself.
    pub fn is_solid(&self) -> bool {
        let apart = self.self_intersections.as_ref();
        self.closed && self.manifold && self.oriented && apart.is_some_and(|found| found.count == 0)
    }
}

/// Checks `mesh`.
///
/// ```
/// use glam::DVec3;
/// use ravec_mesh::{CheckParams, TriMesh, check};
/// use ravec_progress::Progress;
///
/// let corner = vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
/// let mesh = TriMesh::new(corner, vec![[0, 2, 1], [0, 1, 3], [0, 3, 2]])?;
/// let found = check(&mesh, &CheckParams::default(), &Progress::none())?;
/// assert!(found.manifold && !found.closed);
/// assert_eq!(found.boundary_edges.listed, [[1, 2], [1, 3], [2, 3]]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`Cancelled`] soon after `progress` is cancelled.
///
/// # Panics
/// If the mesh has more triangles than [`Adjacency`] can take.
pub fn check(
    mesh: &TriMesh,
    params: &CheckParams,
    progress: &Progress,
) -> Result<MeshCheck, Cancelled> {
    progress.check()?;
    let limit = params.list_limit;
    let adjacency = Adjacency::try_new(mesh, progress)?;

    let mut boundary = Vec::new();
    let mut non_manifold_edges = Found::default();
    let mut orientation_clashes = Found::default();
    let mut oriented = true;
    for (edge, &ends) in (0_u32..).zip(adjacency.edges()) {
        if edge.is_multiple_of(AT_ONCE) {
            progress.check()?;
        }
        let uses = adjacency.uses(edge);
        let forward = uses.iter().filter(|u| u.forward).count();
        match uses.len() {
            1 => boundary.push(edge),
            2 if forward != 1 => {
                oriented = false;
                orientation_clashes.add(ends, limit);
            }
            2 => {}
            many => {
                oriented &= 2 * forward == many;
                non_manifold_edges.add(ends, limit);
            }
        }
    }
    progress.check()?;
    let boundary_ends: Vec<[u32; 2]> = boundary
        .iter()
        .map(|&edge| adjacency.edges()[edge as usize])
        .collect();
    let boundary_loops = boundary::loops(mesh, &adjacency, &boundary, progress)?;
    let pinched = adjacency.try_pinched_vertices(mesh, progress)?;
    let degenerate = par_collect(mesh.triangles().len(), progress, |t| {
        let [a, b, c] = mesh.corners(t);
        on_one_line(a, b, c).then_some(t)
    })?;
    let duplicates = duplicate_triangles(mesh, &adjacency, progress)?;
    let mut used = vec![false; mesh.positions().len()];
    for block in mesh.triangles().chunks(AT_ONCE as usize) {
        progress.check()?;
        for &v in block.iter().flatten() {
            used[v as usize] = true;
        }
    }
    let mut unused_vertices = Found::default();
    for (v, _) in (0_u32..).zip(&used).filter(|(_, used)| !**used) {
        unused_vertices.add(v, limit);
    }
    let proper = mesh.triangles().iter().filter(|t| is_proper(**t)).count();
    let corners = (0..used.len() as u32)
        .into_par_iter()
        .filter(|&v| !adjacency.triangles_at(v).is_empty())
        .count();
    progress.check()?;
    let components = adjacency.try_components(mesh, progress)?.count;
    let closed = proper > 0 && boundary.is_empty();
    let manifold = non_manifold_edges.is_empty() && pinched.is_empty();
    let euler = corners as i64 - adjacency.edges().len() as i64 + proper as i64;
    let (vertices, edges) = (used.len() as u64, adjacency.edges().len() as u64);
    drop(adjacency);
    progress.check()?;
    let self_intersections = if params.self_intersections {
        Some(self_intersections(
            &BoxTree::try_new(mesh, progress)?,
            limit,
            progress,
        )?)
    } else {
        None
    };
    Ok(MeshCheck {
        triangles: mesh.triangles().len() as u64,
        vertices,
        edges,
        components,
        closed,
        manifold,
        oriented,
        euler,
        // a part with h handles adds 2 - 2h
        genus: (closed && manifold && oriented && proper == mesh.triangles().len())
            .then(|| (i64::from(components) - euler / 2).unsigned_abs()),
        boundary_edges: Found::of(&boundary_ends, limit),
        boundary_loops: Found::of(&boundary_loops, limit),
        non_manifold_edges,
        pinched_vertices: Found::of(&pinched, limit),
        orientation_clashes,
        degenerate_triangles: Found::of(&degenerate, limit),
        duplicate_triangles: Found::of(&duplicates, limit),
        unused_vertices,
        self_intersections,
    })
}

/// Number of edges between two checks for cancellation: about a millisecond.
const AT_ONCE: u32 = 1 << 16;

/// The triangles that name the same three vertices as one before them, ascending. Those that name a vertex twice are
/// listed as degenerate and not here.
fn duplicate_triangles(
    mesh: &TriMesh,
    adjacency: &Adjacency,
    progress: &Progress,
) -> Result<Vec<u32>, Cancelled> {
    let sorted = |t: u32| {
        let mut corners = mesh.triangles()[t as usize];
        corners.sort_unstable();
        corners
    };
    let mut repeated = par_collect(mesh.positions().len(), progress, |v| {
        // those whose lowest vertex this is
        let mut here: Vec<([u32; 3], u32)> = adjacency
            .triangles_at(v)
            .iter()
            .map(|&t| (sorted(t), t))
            .filter(|(corners, _)| corners[0] == v)
            .collect();
        here.sort_unstable();
        let again = here.windows(2).filter(|pair| pair[0].0 == pair[1].0);
        again.map(|pair| pair[1].1).collect::<Vec<_>>()
    })?;
    repeated.par_sort_unstable();
    Ok(repeated)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    fn found(mesh: &TriMesh) -> MeshCheck {
        check(mesh, &CheckParams::default(), &Progress::none()).unwrap()
    }

    /// A grid of `n` by `n` vertices bent to a torus.
    fn torus(n: u32) -> (Vec<DVec3>, Vec<[u32; 3]>) {
        let angle = |i: u32| std::f64::consts::TAU * f64::from(i) / f64::from(n);
        let positions = (0..n * n)
            .map(|k| {
                let ((s, c), (t, d)) = (angle(k / n).sin_cos(), angle(k % n).sin_cos());
                DVec3::new((3.0 + d) * c, (3.0 + d) * s, t)
            })
            .collect();
        let at = |i: u32, j: u32| i % n * n + j % n;
        let triangles = (0..n * n)
            .flat_map(|k| {
                let (i, j) = (k / n, k % n);
                let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
                [[a, b, c], [a, c, d]]
            })
            .collect();
        (positions, triangles)
    }

    #[test]
    fn a_torus_is_a_solid_with_one_handle() {
        let (positions, triangles) = torus(8);
        let found = found(&TriMesh::new(positions, triangles).unwrap());
        assert!(found.is_solid());
        assert_eq!(
            (found.components, found.euler, found.genus),
            (1, 0, Some(1))
        );
        assert_eq!(
            (found.edges, found.vertices, found.triangles),
            (192, 64, 128)
        );
    }

    #[test]
    fn planted_defects_are_found_and_named() {
        let (mut positions, mut triangles) = torus(8);
        // an unused vertex, a hole of one triangle, a flipped triangle, a repeated one, one without area, a fin
        positions.extend([DVec3::splat(9.0), DVec3::new(3.0, 0.0, 7.0)]);
        let (unused, tip) = (64, 65);
        triangles[40].swap(0, 1);
        triangles.push(triangles[90]);
        triangles.push([3, 3, 5]);
        let [a, b, _] = triangles[120];
        triangles.push([a, b, tip]);
        let hole = triangles.remove(0);
        let found = found(&TriMesh::new(positions, triangles).unwrap());
        assert!(!found.closed && !found.manifold && !found.oriented && !found.is_solid());
        assert_eq!(found.unused_vertices.listed, [unused]);
        assert_eq!(found.degenerate_triangles.listed, [128]);
        assert_eq!(found.duplicate_triangles.listed, [127]);
        assert_eq!(found.orientation_clashes.count, 3);
        // three of the hole, two of the fin
        assert_eq!(found.boundary_edges.count, 5);
        assert_eq!(found.boundary_loops.count, 2);
        let longest = found.boundary_loops.listed[0];
        assert_eq!((longest.edges, longest.closed), (2, false));
        let hole_loop = found.boundary_loops.listed[1];
        assert_eq!((hole_loop.edges, hole_loop.closed), (3, true));
        assert!(hole.contains(&hole_loop.vertex));
        // three of the repeated triangle, one of the fin
        assert_eq!(found.non_manifold_edges.count, 4);
        assert_eq!(found.genus, None);
        assert_eq!(found.self_intersections.unwrap().coincident, 1);
    }

    #[test]
    fn lists_are_cut_but_counts_are_not() {
        let positions: Vec<DVec3> = (0..30)
            .map(|i| DVec3::new(f64::from(i), 0.0, f64::from(i % 3)))
            .collect();
        let triangles = (0..10).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        let mesh = TriMesh::new(positions, triangles).unwrap();
        let params = CheckParams {
            list_limit: 4,
            self_intersections: false,
        };
        let found = check(&mesh, &params, &Progress::none()).unwrap();
        assert_eq!(found.components, 10);
        assert_eq!(
            (
                found.boundary_edges.count,
                found.boundary_edges.listed.len()
            ),
            (30, 4)
        );
        assert_eq!(found.boundary_loops.count, 10);
        assert_eq!(found.self_intersections, None);
    }

    #[test]
    fn an_empty_mesh_is_neither_closed_nor_wrong() {
        let found = found(&TriMesh::default());
        assert!(!found.closed && found.manifold && found.oriented);
        assert_eq!((found.components, found.genus), (0, None));
    }

    #[test]
    fn a_cancelled_check_stops() {
        let progress = Progress::none();
        progress.cancel();
        let answer = check(&TriMesh::default(), &CheckParams::default(), &progress);
        assert_eq!(answer, Err(Cancelled));
    }
}

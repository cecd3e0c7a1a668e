//! Seams closed: vertices on borders that lie at the same place made one.
//!
//! Formats with one set of attributes a vertex (glTF, PLY, OBJ as many programs write it) repeat vertices where normals or texture
//! coordinates jump. The surface goes on there, but its triangles do not share the vertices. Only vertices at the ends of
//! boundary edges are joined, so that closed solids which merely touch stay apart.
//!
//! Guarantees: triangles stay in their order and none is dropped; the first vertex of each place stays; a mesh without boundary
//! edges, or without two vertices at one place, comes back as it is, and so does one that would not have fewer boundary
//! edges. Does not guarantee: that the result is manifold, where more than two borders meet. Cost: that of welding; of two
//! adjacencies as well if any vertices share a place.

use ravec_memory::MemoryBudget;
use ravec_progress::{Cancelled, Progress};

use crate::{Adjacency, PlaceTable, TriMesh, place_key};

/// A mesh whose seams were closed.
#[derive(Debug, Clone, PartialEq)]
pub struct JoinedSeams {
    /// The mesh.
    pub mesh: TriMesh,
    /// Vertex of the given mesh that each vertex is.
    pub vertex_of: Vec<u32>,
    /// Number of vertices that were merged into an earlier one.
    pub joined: usize,
    /// Boundary edges that are left.
    pub boundary_edges: usize,
}

/// Triangles or vertices between two checks for cancellation: about a millisecond.
const AT_ONCE: usize = 1 << 14;

/// Stands for "no vertex".
const NONE: u32 = u32::MAX;

/// Joins the vertices of `mesh` that are at the ends of boundary edges and at exactly equal places; `None` if that leaves
/// no fewer boundary edges.
///
/// # Errors
/// [`Cancelled`] soon after `progress` is cancelled.
///
/// ```
/// use glam::DVec3;
/// use ravec_mesh::{TriMesh, join_seams};
/// use ravec_progress::Progress;
///
/// // two triangles at an edge, with vertices of their own
/// let places = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::X, DVec3::ONE, DVec3::Y];
/// let mesh = TriMesh::new(places.to_vec(), vec![[0, 1, 2], [3, 4, 5]])?;
/// let joined = join_seams(&mesh, &Progress::none())?.unwrap();
/// assert_eq!(joined.mesh.triangles(), [[0, 1, 2], [1, 3, 2]]);
/// assert_eq!((joined.vertex_of, joined.boundary_edges), (vec![0, 1, 2, 4], 4));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[expect(clippy::missing_panics_doc, reason = "the parts of a mesh make a mesh")]
pub fn join_seams(mesh: &TriMesh, progress: &Progress) -> Result<Option<JoinedSeams>, Cancelled> {
    let Some(place_of) = shared_places(mesh, progress)? else {
        return Ok(None);
    };
    let ends = boundary_ends(mesh, progress)?;
    let count = ends.len();
    let mut on_boundary = vec![false; mesh.positions().len()];
    for v in ends.into_iter().flatten() {
        on_boundary[v as usize] = true;
    }
    let mut first_at = vec![NONE; mesh.positions().len()];
    let mut new_from_old = Vec::with_capacity(mesh.positions().len());
    let mut vertex_of = Vec::new();
    for (v, &place) in place_of.iter().enumerate() {
        let first = &mut first_at[place as usize];
        if on_boundary[v] && *first != NONE {
            new_from_old.push(*first);
            continue;
        }
        if on_boundary[v] {
            *first = vertex_of.len() as u32;
        }
        new_from_old.push(vertex_of.len() as u32);
        vertex_of.push(v as u32);
    }
    progress.check()?;
    let positions = vertex_of.iter().map(|&v| mesh.positions()[v as usize]);
    let triangles = mesh.triangles().iter();
    let triangles = triangles.map(|t| t.map(|v| new_from_old[v as usize]));
    let joined = TriMesh::try_new(positions.collect(), triangles.collect(), progress)?;
    let joined = joined.expect("the parts of a mesh make a mesh");
    let boundary_edges = boundary_ends(&joined, progress)?.len();
    Ok((boundary_edges < count).then(|| JoinedSeams {
        joined: mesh.positions().len() - vertex_of.len(),
        mesh: joined,
        vertex_of,
        boundary_edges,
    }))
}

/// The number of the place of each vertex; `None` if no two share one.
fn shared_places(mesh: &TriMesh, progress: &Progress) -> Result<Option<Vec<u32>>, Cancelled> {
    let unlimited = "there is no limit";
    let mut places = PlaceTable::new(&MemoryBudget::unlimited()).expect(unlimited);
    let mut place_of = Vec::with_capacity(mesh.positions().len());
    for block in mesh.positions().chunks(AT_ONCE) {
        progress.check()?;
        let numbers = block.iter().map(|&at| places.index_of(place_key(at)));
        place_of.extend(numbers.map(|number| number.expect(unlimited)));
    }
    Ok((places.len() < place_of.len()).then_some(place_of))
}

/// The ends of the edges with a single triangle.
fn boundary_ends(mesh: &TriMesh, progress: &Progress) -> Result<Vec<[u32; 2]>, Cancelled> {
    let adjacency = Adjacency::try_new(mesh, progress)?;
    let edges = (0_u32..).zip(adjacency.edges());
    let open = edges.filter(|&(edge, _)| adjacency.uses(edge).len() == 1);
    Ok(open.map(|(_, &ends)| ends).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{CheckParams, check};
    use glam::DVec3;

    /// A tetrahedron at a place.
    fn tetrahedron(at: DVec3) -> TriMesh {
        let corners = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z].map(|p| p + at);
        let triangles = vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
        TriMesh::new(corners.to_vec(), triangles).unwrap()
    }

    /// The triangles with vertices of their own.
    fn apart(mesh: &TriMesh) -> TriMesh {
        let corners = mesh.triangles().iter().flatten();
        let positions = corners.map(|&v| mesh.positions()[v as usize]).collect();
        let triangles = (0..mesh.triangles().len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]);
        TriMesh::new(positions, triangles.collect()).unwrap()
    }

    fn together(meshes: &[TriMesh]) -> TriMesh {
        let (mut positions, mut triangles) = (Vec::new(), Vec::new());
        for mesh in meshes {
            let first = positions.len() as u32;
            positions.extend_from_slice(mesh.positions());
            triangles.extend(mesh.triangles().iter().map(|t| t.map(|v| v + first)));
        }
        TriMesh::new(positions, triangles).unwrap()
    }

    #[test]
    fn a_surface_of_separate_triangles_becomes_closed() {
        let mesh = apart(&tetrahedron(DVec3::ZERO));
        let joined = join_seams(&mesh, &Progress::none()).unwrap().unwrap();
        assert_eq!((joined.joined, joined.boundary_edges), (8, 0));
        let found = check(&joined.mesh, &CheckParams::default(), &Progress::none()).unwrap();
        assert!(found.is_solid());
        for (v, &old) in joined.vertex_of.iter().enumerate() {
            assert_eq!(joined.mesh.positions()[v], mesh.positions()[old as usize]);
        }
    }

    #[test]
    fn closed_solids_that_touch_stay_apart() {
        let pair = together(&[tetrahedron(DVec3::ZERO), tetrahedron(DVec3::X)]);
        assert_eq!(join_seams(&pair, &Progress::none()).unwrap(), None);
        // beside one with seams as well
        let all = together(&[pair, apart(&tetrahedron(DVec3::splat(5.0)))]);
        let joined = join_seams(&all, &Progress::none()).unwrap().unwrap();
        assert_eq!((joined.joined, joined.boundary_edges), (8, 0));
    }

    #[test]
    fn borders_that_meet_in_a_point_are_left() {
        let corner = |at: DVec3| {
            let corners = vec![at, at + DVec3::X, at + DVec3::Y];
            TriMesh::new(corners, vec![[0, 1, 2]]).unwrap()
        };
        let mesh = together(&[corner(DVec3::ZERO), corner(DVec3::X)]);
        assert_eq!(join_seams(&mesh, &Progress::none()).unwrap(), None);
    }
}

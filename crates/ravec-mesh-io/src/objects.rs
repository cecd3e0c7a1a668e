//! The objects that a mesh consists of.

use std::ops::Range;

use ravec_mesh::TriMesh;

/// An object of a file that holds several.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct MeshObject {
    /// Its name, perhaps empty.
    pub name: String,
    /// Its triangles in the mesh. No two objects share vertices.
    pub triangles: Range<usize>,
    /// The triangles of its negative volumes in [`MeshFile::negative`](crate::MeshFile::negative).
    pub negative: Range<usize>,
}

/// The triangles of a range, with the vertices that they use, in their order.
///
/// # Panics
/// If the mesh has no such range.
pub fn part_of(mesh: &TriMesh, range: Range<usize>) -> TriMesh {
    const UNUSED: u32 = u32::MAX;
    let triangles = &mesh.triangles()[range];
    let corners = || triangles.iter().flatten();
    let (Some(&first), Some(&last)) = (corners().min(), corners().max()) else {
        return TriMesh::default();
    };
    let mut places = vec![UNUSED; (last - first) as usize + 1];
    for &corner in corners() {
        places[(corner - first) as usize] = 0;
    }
    let mut positions = Vec::new();
    for (place, &at) in places.iter_mut().zip(&mesh.positions()[first as usize..]) {
        if *place != UNUSED {
            *place = positions.len() as u32;
            positions.push(at);
        }
    }
    let numbered = triangles.iter();
    let numbered = numbered.map(|t| t.map(|corner| places[(corner - first) as usize]));
    TriMesh::new(positions, numbered.collect()).expect("corners were numbered as they came")
}

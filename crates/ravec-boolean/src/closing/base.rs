//! A flat base below a relief.
//!
//! Each edge of the boundary gets a wall straight down to the plane of the base, and the loops are filled again there. A loop
//! around a hole of the relief takes its part of the base away, since it runs the other way.
//!
//! Guarantees: no boundary is left. Does not guarantee: a solid, unless the relief is above its base once everywhere.

use glam::DVec3;
use ravec_mesh::TriMesh;
use rustc_hash::FxHashMap;

use super::patch::fill;

/// Thickness of the base below the lowest point, as a share of the diagonal of the mesh's bounding box: 2 mm for 100 mm, a
/// few lines of a printer.
pub(crate) const THICKNESS_REL: f64 = 0.02;

/// Share of the area seen along z that may face the other way, by noise and slight overhangs.
const MAX_TURNED: f64 = 0.05;

/// Least share of the area that must be seen along z.
const MIN_SEEN: f64 = 1e-3;

/// Returns `true` if nearly all triangles of a mesh face up, or nearly all down.
pub(super) fn is_relief(mesh: &TriMesh) -> bool {
    let (mut up, mut down, mut area) = (0.0, 0.0, 0.0);
    for t in 0..mesh.triangles().len() as u32 {
        let [a, b, c] = mesh.corners(t);
        let normal = (b - a).cross(c - a);
        up += normal.z.max(0.0);
        down -= normal.z.min(0.0);
        area += normal.length();
    }
    let seen: f64 = up + down;
    up.min(down) <= MAX_TURNED * seen && seen > MIN_SEEN * area
}

/// Height of the base of a mesh.
pub(crate) fn level(mesh: &TriMesh) -> f64 {
    let bounds = mesh.bounds();
    bounds.min.z - THICKNESS_REL * bounds.diagonal()
}

/// Puts the loops of the boundary of a mesh on its base: adds to `triangles`, and to `added` the places of new vertices, which
/// are numbered after those of the mesh.
pub(super) fn put_on_base(
    mesh: &TriMesh,
    loops: &[Vec<u32>],
    triangles: &mut Vec<[u32; 3]>,
    added: &mut Vec<DVec3>,
) {
    let z = level(mesh);
    let first = mesh.positions().len();
    let mut below: FxHashMap<u32, u32> = FxHashMap::default();
    for vertices in loops {
        for &v in vertices {
            below.entry(v).or_insert_with(|| {
                added.push(mesh.positions()[v as usize].with_z(z));
                (first + added.len() - 1) as u32
            });
        }
        let at_base: Vec<u32> = vertices.iter().map(|v| below[v]).collect();
        for (i, &a) in vertices.iter().enumerate() {
            let next = (i + 1) % vertices.len();
            let (b, below_a, below_b) = (vertices[next], at_base[i], at_base[next]);
            triangles.extend([[b, a, below_a], [b, below_a, below_b]]);
        }
        let places: Vec<DVec3> = at_base.iter().map(|&v| added[v as usize - first]).collect();
        let backward = |[a, b, c]: [u32; 3]| [a, c, b].map(|i| at_base[i as usize]);
        triangles.extend(fill(&places).triangles.into_iter().map(backward));
    }
}

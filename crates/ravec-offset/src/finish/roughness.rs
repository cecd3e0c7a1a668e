//! Roughness of a mesh.

use ravec_mesh::{Adjacency, TriMesh};
use rayon::prelude::*;

/// Returns the roughness of a mesh: the rate at which it bends from triangle to triangle, in radians along a path as long as
/// its diagonal, at the first quartile by area.
///
/// More than a quarter of a designed part is flat or straight in some direction, so its roughness is almost zero. Scans bend
/// nearly everywhere, the more the finer their triangles are; facets that follow their offset more closely follow noise.
pub(super) fn roughness(mesh: &TriMesh) -> f64 {
    let adjacency = Adjacency::new(mesh);
    let normal = |triangle: u32| {
        let [a, b, c] = mesh.corners(triangle);
        (b - a).cross(c - a)
    };
    let diagonal = mesh.bounds().diagonal();
    let mut bends: Vec<(f64, f64)> = (0..adjacency.edges().len() as u32)
        .into_par_iter()
        .filter_map(|edge| {
            let [one, other] = adjacency.uses(edge) else {
                return None;
            };
            let (m, n) = (normal(one.triangle), normal(other.triangle));
            let area = m.length() + n.length();
            let lengths = m.length() * n.length();
            let cosine = (m.dot(n) / lengths).abs().min(1.0);
            let [a, b] = adjacency.edges()[edge as usize].map(|v| mesh.positions()[v as usize]);
            // from middle to middle
            let way = area / (3.0 * a.distance(b));
            let bend = cosine.acos() / way * diagonal;
            (lengths > 0.0).then_some((bend, area))
        })
        .collect();
    bends.par_sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let quarter = 0.25 * bends.iter().map(|(_, area)| area).sum::<f64>();
    let mut below = 0.0;
    let reached = bends.iter().find(|(_, area)| {
        below += area;
        below >= quarter
    });
    reached.map_or(0.0, |(bend, _)| *bend)
}

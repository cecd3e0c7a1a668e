//! Slivers: components and cavities that are too small to be intended.
//!
//! On a rough sheet, adjacent polyhedra leave slivers between them, or behind the sheet, that are thinner than the tolerance.

use crate::surface::compact;
use glam::DVec3;
use ravec_mesh::{Adjacency, TriMesh};
use ravec_progress::{Cancelled, Progress};

/// Removes the components of a closed surface without intersections that enclose less than a volume, whether solid or cavity.
/// The largest component stays in any case: a sheet may be that small.
///
/// A component encloses more than those inside it, so nothing remains in a filled or removed one.
pub(crate) fn without_slivers(
    surface: TriMesh,
    min_volume: f64,
    progress: &Progress,
) -> Result<TriMesh, Cancelled> {
    let parts = Adjacency::new(&surface).components(&surface);
    progress.check()?;
    // relative to the first corner of each component, against cancellation far from the origin
    let mut origins: Vec<Option<DVec3>> = vec![None; parts.count as usize];
    let mut volumes = vec![0.0; parts.count as usize];
    for (t, &part) in (0..).zip(&parts.of_triangle) {
        let corners = surface.corners(t);
        let origin = *origins[part as usize].get_or_insert(corners[0]);
        let [a, b, c] = corners.map(|corner| corner - origin);
        volumes[part as usize] += a.dot(b.cross(c)) / 6.0;
    }
    progress.check()?;
    let largest = volumes
        .iter()
        .fold(0.0, |most: f64, volume| most.max(volume.abs()));
    let is_kept = |volume: f64| volume.abs() >= min_volume.min(largest);
    if volumes.iter().all(|&volume| is_kept(volume)) {
        return Ok(surface);
    }
    let kept = surface.triangles().iter().zip(&parts.of_triangle);
    let kept = kept.filter(|(_, part)| is_kept(volumes[**part as usize]));
    let triangles: Vec<[u32; 3]> = kept.map(|(&triangle, _)| triangle).collect();
    compact(surface.positions(), &triangles, progress)
}

#[cfg(test)]
mod tests {
    use super::*;
    use ravec_scenes::solids::cuboid;

    #[test]
    fn small_parts_and_small_cavities_go() {
        // a cube of side 2, in it a cavity of side `hole`, and apart from both a cube of side `crumb`
        let body = |hole: f64, crumb: f64| {
            let mut positions = Vec::new();
            let mut triangles = Vec::new();
            let mut add = |side: f64, center: DVec3, turn: bool| {
                let cube = cuboid(DVec3::splat(side)).mesh;
                let first = positions.len() as u32;
                let shift = center - cube.bounds().center();
                positions.extend(cube.positions().iter().map(|&p| p + shift));
                triangles.extend(cube.triangles().iter().map(|&[a, b, c]| {
                    let turned = if turn { [a, c, b] } else { [a, b, c] };
                    turned.map(|v| v + first)
                }));
            };
            add(2.0, DVec3::ZERO, false);
            add(hole, DVec3::ZERO, true);
            add(crumb, 3.0 * DVec3::X, false);
            TriMesh::new(positions, triangles).unwrap()
        };
        let volume_left = |hole: f64, crumb: f64| {
            let left = without_slivers(body(hole, crumb), 0.1, &Progress::none()).unwrap();
            ravec_mesh::measure(&left).volume
        };
        let near = |found: f64, expected: f64| assert!((found - expected).abs() < 1e-12, "{found}");
        near(volume_left(0.5, 0.5), 8.0 - 0.125 + 0.125);
        near(volume_left(0.4, 0.5), 8.0 + 0.125);
        near(volume_left(0.5, 0.4), 8.0 - 0.125);
        near(volume_left(0.4, 0.4), 8.0);
        let all = cuboid(DVec3::splat(0.4)).mesh;
        let left = without_slivers(all.clone(), 0.1, &Progress::none()).unwrap();
        assert_eq!(left.triangles(), all.triangles());
    }
}

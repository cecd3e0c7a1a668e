//! Creases of the finished surface.

use crate::domain::Field;
use glam::DVec3;
use ravec_mesh::{Adjacency, TriMesh};
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;

/// Angle between normals above which an edge is a crease, in degrees. Facets are off by a few degrees, and coarse input for
/// smooth shapes turns by less.
const CREASE_DEG: f64 = 20.0;

/// Counts the creases: edges at which both the facets and the normals of the true surface beside the edge turn by more than
/// 20°. `reach` is the distance beside the edge, about as large as the error of the surface. Only edges between counted
/// triangles count.
pub(crate) fn creases(
    field: &Field<'_>,
    surface: &TriMesh,
    reach: f64,
    is_counted: impl Fn([u32; 2]) -> bool + Sync,
    progress: &Progress,
) -> Result<u64, Cancelled> {
    progress.check()?;
    let adjacency = Adjacency::new(surface);
    progress.check()?;
    let max_alike = CREASE_DEG.to_radians().cos();
    let turns = |a: DVec3, b: DVec3| a.dot(b) < max_alike * a.length() * b.length();
    (0..adjacency.edges().len() as u32)
        .into_par_iter()
        .map(|edge| {
            progress.check()?;
            let &[left, right] = adjacency.uses(edge) else {
                return Ok(0);
            };
            if !is_counted([left.triangle, right.triangle]) {
                return Ok(0);
            }
            let sides = [left, right].map(|side| surface.corners(side.triangle));
            let [m, n] = sides.map(|[a, b, c]| (b - a).cross(c - a));
            if !turns(m, n) {
                return Ok(0);
            }
            let ends = adjacency.edges()[edge as usize].map(|v| surface.positions()[v as usize]);
            let middle = 0.5 * (ends[0] + ends[1]);
            let [p, q] = sides.map(|[a, b, c]| {
                let inward = (a + b + c) / 3.0 - middle;
                let along = (ends[1] - ends[0]).normalize_or_zero();
                let across = (inward - inward.dot(along) * along).length();
                // within the facet, whatever its shape
                middle + (reach / across).min(1.0) * inward
            });
            let [p, q] = [p, q].map(|p| field.near(p, 0).away);
            Ok(u64::from(turns(p, q)))
        })
        .try_reduce(|| 0, |a, b| Ok(a + b))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::Solid;
    use ravec_mesh::Bvh;
    use ravec_scenes::solids::cuboid;

    fn cube(side: f64) -> TriMesh {
        cuboid(DVec3::splat(side)).mesh
    }

    #[test]
    fn edges_are_creases_only_where_the_true_surface_has_one() {
        let (small, large) = (cube(2.0), cube(4.0));
        for (inner, expected) in [(true, 12), (false, 0)] {
            let (mesh, surface) = if inner {
                (&large, &small)
            } else {
                (&small, &large)
            };
            let bvh = Bvh::new(mesh);
            let field = Field::new(
                &bvh,
                Solid::Closed,
                if inner { -1.0 } else { 1.0 },
                &Progress::none(),
            )
            .unwrap();
            // outside, cylinders and spheres round these edges
            let found = creases(&field, surface, 0.02, |_| true, &Progress::none()).unwrap();
            assert_eq!(found, expected, "inner: {inner}");
        }
    }
}

//! Fit of a cell: samples of the surface in it, the vertex that represents them, and the quality of that vertex.

use super::{CornerValue, Roots, Sample, Setting, crossed_edges, inside_of};
use crate::domain::{Near, Region};
use crate::params::COARSE;
use glam::{DMat3, DVec3};
use ravec_mesh::closest_on_triangle;
use ravec_octree::CellKey;

/// Share of the side of a cell that its vertex keeps from its faces, so that vertices of neighbors never coincide.
const MARGIN: f64 = 1e-4;

/// Steps towards the spheres, cylinders and planes at the samples, and then towards the surface.
const FIT_STEPS: usize = 6;
const PROJECTIONS: usize = 2;

/// Bound on the distance of the vertex from the planes at the samples, as a share of the tolerance: at the tolerance
/// [`COARSE`], and at a quarter or four times that and beyond. Facets are proved anyway; larger bounds fail more proofs and
/// tilt simplified facets, smaller ones cost cells.
const FLATNESS: [f64; 2] = [0.95, 1.0];

/// Bound on the distance of a vertex from the surface, as a share of the tolerance. Larger bounds cut off the tips of some
/// crests; smaller ones cost cells.
const MISS: f64 = 0.5;

/// Bound on the angle in degrees of the normals in a cell to their mean for its vertex to move off the surface, at the same
/// tolerances as [`FLATNESS`].
///
/// A cell on a sphere is about √(8 r ε) wide, so a displacement by a share of the tolerance ε tilts facets by an angle that
/// grows as √(ε/r). Larger bounds save cells, but tilt facets of designed parts by more than 4°.
const NEARLY_FLAT_DEG: [f64; 2] = [12.0, 24.0];

/// Bound on the distance of a sample on the surface, as a share of the tolerance.
pub(crate) const ON_SURFACE: f64 = 0.02;

/// Bound on the triangles in a cell that is not split: more take longer to examine than the parts of the cell.
pub(crate) const MAX_TRIANGLES: usize = 20;

/// [`MAX_TRIANGLES`] where the triangles face one way.
pub(crate) const MAX_TRIANGLES_OF_SHEET: usize = 64;

/// Smallest cosine between a direction and the normals of triangles that face it.
const FACING: f64 = 0.2;

/// [`MAX_TRIANGLES`] where the surface consists of the triangles themselves, which meet in any number at every vertex. Smaller
/// bounds split cells around vertices down to the floor.
pub(crate) const MAX_TRIANGLES_OF_SURFACE: usize = 40;

/// Returns whether triangles face one way: some direction is in front of all of them. If the triangles are oriented, lines in
/// that direction only leave the solid, so these triangles enclose nothing.
pub(crate) fn is_sheet(normals: &[DVec3]) -> bool {
    let front = normals.iter().sum::<DVec3>().normalize_or_zero();
    let faces = |normal: &DVec3| normal.dot(front) >= FACING || *normal == DVec3::ZERO;
    normals.iter().all(faces)
}

/// A cell whose corners are evaluated.
pub(crate) struct Cell<'a> {
    pub setting: &'a Setting<'a>,
    pub key: CellKey,
}

/// Result of fitting a cell.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Fit {
    /// The vertex; `None` without samples.
    pub vertex: Option<DVec3>,
    /// The vertex represents all samples, and the signs of the corners represent the surface.
    pub is_good: bool,
    /// Triangle closest to the vertex, or to the center of the cell without one.
    pub nearest: u32,
}

/// A placed vertex.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Placed {
    pub vertex: DVec3,
    /// Triangle closest to the vertex.
    pub nearest: u32,
    /// Upper bound of its distance from the surface.
    pub miss: f64,
}

impl Placed {
    /// Largest distance of the vertex from the planes at some samples.
    fn flatness(&self, samples: &[Sample]) -> f64 {
        samples
            .iter()
            .map(|sample| sample.away.dot(self.vertex - sample.point).abs())
            .fold(0.0, f64::max)
    }
}

impl Cell<'_> {
    /// Lowest and highest position of the vertex.
    fn room(&self) -> [DVec3; 2] {
        let [low, high] = self.setting.frame.bounds(self.key);
        let margin = self.setting.grid.margin(MARGIN, high.x - low.x) * (high - low);
        [low + margin, high - margin]
    }

    /// Fits the cell: `center` belongs to its center, `region` is the side of the cell and `side` that of its center; `roots`
    /// has at least those of its edges.
    pub fn fit(
        &self,
        center: Near,
        [region, side]: [Region; 2],
        corners: &[CornerValue; 8],
        roots: &Roots,
    ) -> Fit {
        let mut samples = Vec::with_capacity(24);
        let inside = inside_of(corners);
        samples.extend(crossed_edges(self.key, inside).map(|edge| roots[&edge]));
        let changes = !samples.is_empty();
        self.foot_points(center, side, corners, &mut samples);
        let through = if region == Region::Unknown && self.setting.field.is_signed() {
            self.triangles()
        } else {
            vec![]
        };
        self.foot_points_of_triangles(&through, center, &mut samples);
        if !changes {
            // a sheet, or a bump, between the corners
            let deep = samples
                .iter()
                .any(|sample| self.depth(sample.point) > 0.5 * self.setting.tolerance);
            return Fit {
                vertex: None,
                nearest: center.triangle,
                is_good: !deep && !self.may_hold_a_pocket(center, corners, self.is_crowd(&through)),
            };
        }
        let mut placed = self.vertex(&samples);
        let flatness = self.share(FLATNESS) * self.setting.tolerance;
        let is_bent = placed.flatness(&samples) > flatness;
        if is_bent && self.setting.field.level != 0.0 {
            self.balance(&mut placed, &samples);
        }
        Fit {
            vertex: Some(placed.vertex),
            nearest: placed.nearest,
            is_good: placed.flatness(&samples) <= flatness
                && placed.miss <= MISS * self.setting.tolerance
                && sign_components(inside) <= 2,
        }
    }

    /// Moves a vertex off a slightly bent surface, so that facets leave it on both sides and may be larger.
    fn balance(&self, placed: &mut Placed, samples: &[Sample]) {
        let normal = samples.iter().map(|sample| sample.away).sum::<DVec3>();
        let normal = normal.normalize_or_zero();
        let min_cosine = self.share(NEARLY_FLAT_DEG).to_radians().cos();
        if (samples.iter()).any(|sample| sample.away.dot(normal) < min_cosine) {
            return;
        }
        let [low, high] = samples
            .iter()
            .map(|sample| sample.away.dot(placed.vertex - sample.point))
            .fold([0.0, 0.0], |[low, high]: [f64; 2], off| {
                [low.min(off), high.max(off)]
            });
        let most = (MISS * self.setting.tolerance - placed.miss).max(0.0);
        let shift = (-0.5 * (low + high)).clamp(-most, most);
        let [low, high] = self.room();
        let moved = (placed.vertex + shift * normal).clamp(low, high);
        placed.vertex = self.setting.grid.nearest(moved);
        placed.miss += shift.abs();
    }

    /// Interpolates between the value where cells must be flattest, as where the surface consists of the triangles themselves,
    /// and the value elsewhere.
    fn share(&self, [flattest, other]: [f64; 2]) -> f64 {
        let fineness = COARSE * self.setting.field.radius() / self.setting.tolerance;
        if fineness == 0.0 {
            return flattest;
        }
        let off = fineness.max(1.0 / fineness).sqrt() - 1.0;
        flattest + off.min(1.0) * (other - flattest)
    }

    /// Depth of a point inside the cell.
    fn depth(&self, p: DVec3) -> f64 {
        let [low, high] = self.setting.frame.bounds(self.key);
        (p - low).min(high - p).min_element()
    }

    /// Places the vertex as close as possible to the spheres, cylinders and planes that the samples lie on.
    pub fn vertex(&self, samples: &[Sample]) -> Placed {
        let radius = self.setting.field.radius();
        let [low, high] = self.room();
        let mut triangles: Vec<u32> = samples.iter().map(|sample| sample.triangle).collect();
        triangles.sort_unstable();
        triangles.dedup();
        let mean = samples.iter().map(|sample| sample.point).sum::<DVec3>() / samples.len() as f64;
        let mut v = mean.clamp(low, high);
        v = self.toward_pieces(v, &triangles, [low, high]);
        let mut near = self.setting.field.near(v, samples[0].triangle);
        for _ in 0..2 {
            let is_off = (near.distance - radius).abs() > MISS * self.setting.tolerance;
            if !is_off || triangles.contains(&near.triangle) {
                break;
            }
            triangles.push(near.triangle);
            v = self.toward_pieces(v, &triangles, [low, high]);
            near = self.setting.field.near(v, near.triangle);
        }
        for _ in 0..PROJECTIONS {
            if (near.distance - radius).abs() <= 1e-3 * self.setting.tolerance {
                break;
            }
            let moved = self.setting.field.foot(v, &near).clamp(low, high);
            let there = self.setting.field.near(moved, near.triangle);
            if (there.distance - radius).abs() >= (near.distance - radius).abs() {
                break;
            }
            (v, near) = (moved, there);
        }
        let vertex = self.setting.grid.nearest(v);
        Placed {
            vertex,
            nearest: near.triangle,
            miss: (near.distance - radius).abs() + vertex.distance(v),
        }
    }

    /// Takes Gauss-Newton steps on the distances to some triangles.
    fn toward_pieces(&self, mut v: DVec3, triangles: &[u32], [low, high]: [DVec3; 2]) -> DVec3 {
        let radius = self.setting.field.radius();
        let damping = 1e-3 * triangles.len() as f64;
        for _ in 0..FIT_STEPS {
            let mut normal_matrix = DMat3::from_diagonal(DVec3::splat(damping));
            let mut right = DVec3::ZERO;
            for &triangle in triangles {
                let corners = self.setting.field.bvh().corners(triangle);
                let (distance, gradient) = if radius > 0.0 {
                    let closest = closest_on_triangle(v, corners);
                    let distance = closest.distance_sq.sqrt();
                    if distance <= 0.0 {
                        continue;
                    }
                    (distance, (v - closest.point) / distance)
                } else {
                    // the surface is made of the triangles themselves
                    let normal = self.setting.field.near_of(v, triangle).away;
                    (normal.dot(v - corners[0]), normal)
                };
                let outer = DMat3::from_cols(
                    gradient * gradient.x,
                    gradient * gradient.y,
                    gradient * gradient.z,
                );
                normal_matrix += outer;
                right += (radius - distance) * gradient;
            }
            let moved = (v + normal_matrix.inverse() * right).clamp(low, high);
            let step = moved.distance(v);
            v = moved;
            if step <= 1e-3 * self.setting.tolerance {
                break;
            }
        }
        v
    }
}

/// Counts the groups of corners of equal sign that edges of the cell connect.
fn sign_components(inside: u8) -> usize {
    components_of(inside) + components_of(!inside)
}

/// Counts the connected groups of a set of corners of a cube.
fn components_of(mut set: u8) -> usize {
    let mut count = 0;
    while set != 0 {
        count += 1;
        let mut group = 1 << set.trailing_zeros();
        loop {
            let grown = (0..8)
                .filter(|octant| group >> octant & 1 == 1)
                .flat_map(|octant: u8| [1, 2, 4].map(|bit| 1 << (octant ^ bit)))
                .fold(group, |all, corner: u8| all | corner)
                & set;
            if grown == group {
                break;
            }
            group = grown;
        }
        set &= !group;
    }
    count
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sheets_face_one_way() {
        let [x, y, z] = DVec3::AXES;
        assert!(is_sheet(&[x, y, z, DVec3::ZERO]));
        // a ditch with a wall that leans over, and a plate with its back
        assert!(!is_sheet(&[
            z,
            (x + 0.5 * z).normalize(),
            (-x - 0.1 * z).normalize()
        ]));
        assert!(!is_sheet(&[z, z, -z]));
    }

    #[test]
    fn groups_of_corners_are_counted() {
        assert_eq!(components_of(0), 0);
        assert_eq!(components_of(0xff), 1);
        assert_eq!(components_of(0b1000_0001), 2);
        assert_eq!(components_of(0b0110_1001), 4);
        assert_eq!(components_of(0b0000_1111), 1);
    }
}

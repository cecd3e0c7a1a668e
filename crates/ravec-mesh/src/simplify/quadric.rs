//! Sums of squared distances to planes.
//!
//! Notation: at the point x a quadric has the value xᵀA x + 2 bᵀx + c, and `weight` is the area it stands for.

use std::ops::{Add, AddAssign};

use glam::{DMat3, DVec3};

/// A weighted sum of squared distances to planes.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Quadric {
    /// A in the order xx, yy, zz, xy, yz, zx.
    a: [f64; 6],
    b: DVec3,
    c: f64,
    pub weight: f64,
}

impl AddAssign for Quadric {
    #[inline]
    fn add_assign(&mut self, other: Self) {
        for (x, y) in self.a.iter_mut().zip(other.a) {
            *x += y;
        }
        self.b += other.b;
        self.c += other.c;
        self.weight += other.weight;
    }
}

impl Add for Quadric {
    type Output = Self;

    #[inline]
    fn add(mut self, other: Self) -> Self {
        self += other;
        self
    }
}

/// Ridge that is added to A for the placement, relative to its mean eigenvalue.
///
/// Directions in which A is weaker than this are left to the middle of the edge. It corresponds to creases of a tenth of a
/// degree; smaller lets rounding decide, larger pulls vertices off shallow creases.
const RIDGE: f64 = 1e-6;

/// Number of refinements of the placement. Each time shrinks the pull of the ridge on a direction with relative
/// eigenvalue s by 1e-6 / s: after three, a crease of 6 degrees is met to 1e-11 of the edge.
const REFINEMENTS: usize = 3;

impl Quadric {
    /// The squared distance to the plane through `point` with the unit normal `n`, times `factor`. It does not stand for
    /// any area.
    #[inline]
    pub fn plane(n: DVec3, point: DVec3, factor: f64) -> Self {
        let offset = -n.dot(point);
        Self {
            a: [
                factor * n.x * n.x,
                factor * n.y * n.y,
                factor * n.z * n.z,
                factor * n.x * n.y,
                factor * n.y * n.z,
                factor * n.z * n.x,
            ],
            b: n * (factor * offset),
            c: factor * offset * offset,
            weight: 0.0,
        }
    }

    /// The share of one corner in the plane of a triangle: a third of its area. Zero if it has none.
    #[inline]
    pub fn corner([p, q, r]: [DVec3; 3]) -> Self {
        let normal = (q - p).cross(r - p);
        let length = normal.length();
        if length <= 0.0 {
            return Self::default();
        }
        let weight = length / 6.0;
        Self {
            weight,
            ..Self::plane(normal / length, p, weight)
        }
    }

    #[inline]
    fn times(&self, v: DVec3) -> DVec3 {
        let [xx, yy, zz, xy, yz, zx] = self.a;
        DVec3::new(
            xx * v.x + xy * v.y + zx * v.z,
            xy * v.x + yy * v.y + yz * v.z,
            zx * v.x + yz * v.y + zz * v.z,
        )
    }

    /// The value at `x`; rounding may make it slightly negative, which is cut off.
    #[inline]
    pub fn at(&self, x: DVec3) -> f64 {
        (x.dot(self.times(x) + 2.0 * self.b) + self.c).max(0.0)
    }

    /// More than the rounding of values within a distance of 1 from the origin: some twenty roundings of sums of terms that
    /// are no larger than the sum of the weights of the planes, which is the trace of A.
    #[inline]
    pub fn rounding(&self) -> f64 {
        1e-14 * (self.a[0] + self.a[1] + self.a[2])
    }

    /// The place of the smallest value; in directions in which that is not determined, the one closest to `middle`.
    #[inline]
    pub fn lowest(&self, middle: DVec3) -> DVec3 {
        let [xx, yy, zz, xy, yz, zx] = self.a;
        let ridge = RIDGE * (xx + yy + zz) / 3.0;
        let m = DMat3::from_cols(
            DVec3::new(xx + ridge, xy, zx),
            DVec3::new(xy, yy + ridge, yz),
            DVec3::new(zx, yz, zz + ridge),
        );
        let det = m.determinant();
        if !(det > 0.0 && ridge > 0.0) {
            return middle;
        }
        let inverse = m.inverse();
        let mut x = middle;
        for _ in 0..REFINEMENTS {
            x -= inverse * (self.times(x) + self.b);
        }
        x
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_value_is_the_sum_of_squared_distances(
            points in prop::collection::vec([-1.0..1.0, -1.0..1.0, -1.0..1.0], 2..9),
            x in [-1.0..1.0, -1.0..1.0, -1.0..1.0],
        ) {
            let x = DVec3::from_array(x);
            let mut sum = Quadric::default();
            let mut expected = 0.0;
            for pair in points.windows(2) {
                let (p, n) = (DVec3::from_array(pair[0]), DVec3::from_array(pair[1]).normalize_or(DVec3::X));
                sum += Quadric::plane(n, p, 0.5);
                expected += 0.5 * n.dot(x - p).powi(2);
            }
            // four roundings of sums of some dozen terms below 3
            prop_assert!((sum.at(x) - expected).abs() < 1e-13);
        }
    }

    #[test]
    fn three_planes_meet_in_their_common_point_and_two_in_the_point_of_their_line_nearest_to_the_middle()
     {
        let corner = DVec3::new(0.3, -0.2, 0.7);
        let middle = corner + DVec3::new(0.01, 0.02, -0.03);
        let plane = |n: DVec3| Quadric::plane(n.normalize(), corner, 0.1);
        // 10 degrees between the first two
        let tilted = DVec3::new(0.0, 0.17365, 0.98481);
        let two = plane(DVec3::Z) + plane(tilted);
        let three = two + plane(DVec3::new(0.9, 0.1, 0.0));
        assert!(three.lowest(middle).distance(corner) < 1e-12);
        let on_crease = DVec3::new(middle.x, corner.y, corner.z);
        assert!(two.lowest(middle).distance(on_crease) < 1e-12);
        let on_plane = DVec3::new(middle.x, middle.y, corner.z);
        assert!(plane(DVec3::Z).lowest(middle).distance(on_plane) < 1e-12);
        assert_eq!(Quadric::default().lowest(middle), middle);
    }
}

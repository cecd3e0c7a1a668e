//! Coordinates as whole numbers: exact whatever is done with them.
//!
//! All coordinates that occur are whole multiples of one power of two, so that they become integers of unlimited size;
//! points that are defined by lines and planes become homogeneous coordinates of such integers. They are slow, a
//! microsecond an operation, and computed only where intervals do not decide.

use glam::DVec3;
use num_bigint::{BigInt, Sign as BigSign};
use num_traits::{Signed, ToPrimitive, Zero};
use ravec_mesh::Sign;

use super::interval::Interval;

/// The power of two that all coordinates are multiples of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Grid {
    /// Coordinates are multiples of `2^-scale`.
    scale: i32,
}

/// Mantissa and exponent: `x` is `mantissa · 2^exponent`, and the mantissa is odd or zero.
fn parts(x: f64) -> (i64, i32) {
    if x == 0.0 {
        return (0, 0);
    }
    let bits = x.abs().to_bits();
    let biased = (bits >> 52) as i32;
    let fraction = (bits & ((1 << 52) - 1)) as i64;
    let (mantissa, exponent) = if biased == 0 {
        (fraction, -1074)
    } else {
        (fraction | 1 << 52, biased - 1075)
    };
    let zeros = mantissa.trailing_zeros();
    let mantissa = mantissa >> zeros;
    (
        if x < 0.0 { -mantissa } else { mantissa },
        exponent + zeros as i32,
    )
}

impl Grid {
    /// A coarse grid that holds all of `points`, and places between them: a billion steps to their extent at least.
    pub fn holding(points: &[DVec3]) -> Self {
        let (mut scale, mut largest) = (i32::MIN, 0.0_f64);
        for x in points.iter().flat_map(DVec3::to_array) {
            if x != 0.0 {
                scale = scale.max(-parts(x).1);
                largest = largest.max(x.abs());
            }
        }
        if scale == i32::MIN {
            return Self { scale: 0 };
        }
        let (_, exponent) = parts(2_f64.powi(largest.log2().floor() as i32));
        Self {
            scale: scale.max(30 - exponent),
        }
    }

    /// A number of the grid near `x`: no farther than one step.
    pub fn snap(self, x: f64) -> f64 {
        let (mantissa, exponent) = parts(x);
        let excess = -self.scale - exponent;
        if mantissa == 0 || excess <= 0 {
            x
        } else if excess >= 63 {
            0.0
        } else {
            ((mantissa >> excess) as f64) * 2_f64.powi(-self.scale)
        }
    }

    /// `x` in steps of the grid, rounded down if it lies between two of them.
    pub fn steps(self, x: f64) -> BigInt {
        let (mantissa, exponent) = parts(x);
        let shift = exponent + self.scale;
        if shift >= 0 {
            BigInt::from(mantissa) << shift
        } else {
            BigInt::from(mantissa) >> -shift
        }
    }
}

/// Homogeneous coordinates in steps of the grid; `w` is positive.
#[derive(Debug, Clone)]
pub(crate) struct Exact {
    pub xyz: [BigInt; 3],
    pub w: BigInt,
}

/// A vector of integers.
pub(crate) type Vector = [BigInt; 3];

pub(crate) fn difference(a: &Vector, b: &Vector) -> Vector {
    std::array::from_fn(|k| &a[k] - &b[k])
}

pub(crate) fn cross(a: &Vector, b: &Vector) -> Vector {
    std::array::from_fn(|k| {
        let (i, j) = ((k + 1) % 3, (k + 2) % 3);
        &a[i] * &b[j] - &a[j] * &b[i]
    })
}

pub(crate) fn dot(a: &Vector, b: &Vector) -> BigInt {
    &a[0] * &b[0] + &a[1] * &b[1] + &a[2] * &b[2]
}

pub(crate) fn sign(x: &BigInt) -> Sign {
    match x.sign() {
        BigSign::Minus => Sign::Negative,
        BigSign::NoSign => Sign::Zero,
        BigSign::Plus => Sign::Positive,
    }
}

/// The normal of a plane through three points, and one of them.
pub(crate) fn plane(grid: Grid, points: &[DVec3; 3]) -> (Vector, Vector) {
    let [a, b, c] = points.map(|p| vector(grid, p));
    (cross(&difference(&b, &a), &difference(&c, &a)), a)
}

pub(crate) fn vector(grid: Grid, p: DVec3) -> Vector {
    p.to_array().map(|x| grid.steps(x))
}

impl Exact {
    /// A point with coordinates on the grid.
    pub fn of_point(grid: Grid, p: DVec3) -> Self {
        Self {
            xyz: vector(grid, p),
            w: BigInt::from(1),
        }
    }

    /// The point in which a line meets a plane; `None` if they do not meet in one point.
    pub fn of_line_and_plane(grid: Grid, line: &[DVec3; 2], through: &[DVec3; 3]) -> Option<Self> {
        let (normal, a) = plane(grid, through);
        let p = vector(grid, line[0]);
        let d = difference(&vector(grid, line[1]), &p);
        let w = dot(&normal, &d);
        let t = dot(&normal, &difference(&a, &p));
        Self::normalized(std::array::from_fn(|k| &p[k] * &w + &d[k] * &t), w)
    }

    /// The point in which three planes meet; `None` if they do not meet in one point.
    pub fn of_planes(grid: Grid, planes: &[[DVec3; 3]; 3]) -> Option<Self> {
        let [(n0, a0), (n1, a1), (n2, a2)] = planes.each_ref().map(|p| plane(grid, p));
        let (c0, c1, c2) = (cross(&n1, &n2), cross(&n2, &n0), cross(&n0, &n1));
        let w = dot(&n0, &c0);
        let d = [dot(&n0, &a0), dot(&n1, &a1), dot(&n2, &a2)];
        Self::normalized(
            std::array::from_fn(|k| &c0[k] * &d[0] + &c1[k] * &d[1] + &c2[k] * &d[2]),
            w,
        )
    }

    fn normalized(xyz: Vector, w: BigInt) -> Option<Self> {
        match w.sign() {
            BigSign::NoSign => None,
            BigSign::Plus => Some(Self { xyz, w }),
            BigSign::Minus => Some(Self {
                xyz: xyz.map(|x| -x),
                w: -w,
            }),
        }
    }

    /// The mean of three points with positive weights.
    pub fn weighted(points: &[Self; 3], weights: [i64; 3]) -> Self {
        let [a, b, c] = points;
        let shares = [
            &b.w * &c.w * weights[0],
            &c.w * &a.w * weights[1],
            &a.w * &b.w * weights[2],
        ];
        let xyz =
            |k: usize| &a.xyz[k] * &shares[0] + &b.xyz[k] * &shares[1] + &c.xyz[k] * &shares[2];
        Self {
            xyz: std::array::from_fn(xyz),
            w: &a.w * &b.w * &c.w * weights.iter().sum::<i64>(),
        }
    }

    /// The point of a plane above or below this one along `axis`; `None` if the plane is along the axis, too.
    pub fn on_plane(&self, grid: Grid, through: &[DVec3; 3], axis: usize) -> Option<Self> {
        let (normal, a) = plane(grid, through);
        let (i, j) = ((axis + 1) % 3, (axis + 2) % 3);
        let w = &self.w * &normal[axis];
        let mut xyz: Vector = self.xyz.each_ref().map(|x| x * &normal[axis]);
        xyz[axis] =
            &self.w * dot(&normal, &a) - &normal[i] * &self.xyz[i] - &normal[j] * &self.xyz[j];
        Self::normalized(xyz, w)
    }

    /// Compares coordinate `axis` with that of `other`.
    pub fn compare(&self, other: &Self, axis: usize) -> std::cmp::Ordering {
        (&self.xyz[axis] * &other.w).cmp(&(&other.xyz[axis] * &self.w))
    }

    /// Coordinate `axis`, between neighboring doubles.
    pub fn rounded(&self, grid: Grid, axis: usize) -> Interval {
        let x = &self.xyz[axis];
        if x.is_zero() {
            return Interval::from(0.0);
        }
        // 80 bits of quotient, of which the conversion keeps 53
        let shift = (80 - (x.bits() as i64 - self.w.bits() as i64)).clamp(-4000, 4000);
        let quotient = if shift >= 0 {
            (x.abs() << shift) / &self.w
        } else {
            x.abs() / (&self.w << -shift)
        };
        let exponent = -shift as i32 - grid.scale;
        let value = quotient.to_f64().map_or(0.0, |q| scaled(q, exponent));
        let value = if x.is_negative() { -value } else { value };
        Interval {
            lo: value.next_down(),
            hi: value.next_up(),
        }
    }
}

/// `x · 2^exponent` without overflow on the way.
fn scaled(x: f64, exponent: i32) -> f64 {
    let half = exponent / 2;
    x * 2_f64.powi(half) * 2_f64.powi(exponent - half)
}

/// The sign of the area of three points seen along `axis`, whose homogeneous coordinates are given.
pub(crate) fn orient2d(points: [&Exact; 3], axis: usize) -> Sign {
    let (i, j) = ((axis + 1) % 3, (axis + 2) % 3);
    let [a, b, c] = points;
    let minor = |p: &Exact, q: &Exact| &p.xyz[i] * &q.xyz[j] - &p.xyz[j] * &q.xyz[i];
    sign(&(minor(a, b) * &c.w + minor(b, c) * &a.w + minor(c, a) * &b.w))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_the_grid_are_whole() {
        let points = [DVec3::new(0.1, -3.0, 1e-12), DVec3::new(0.0, 5e9, 2.5)];
        let grid = Grid::holding(&points);
        for x in points.iter().flat_map(DVec3::to_array) {
            assert_eq!(grid.snap(x), x);
            let back = Exact::of_point(grid, DVec3::splat(x)).rounded(grid, 1);
            assert!(back.lo <= x && x <= back.hi && back.width() <= 3.0 * x.abs() * f64::EPSILON);
        }
        assert!((grid.snap(0.3e-13) - 0.3e-13).abs() < 1e-20);
    }

    #[test]
    fn three_planes_and_a_line_with_a_plane_meet_where_they_should() {
        let planes = [
            [DVec3::X, DVec3::X + DVec3::Y, DVec3::X + DVec3::Z],
            [
                2.0 * DVec3::Y,
                2.0 * DVec3::Y + DVec3::X,
                2.0 * DVec3::Y + DVec3::Z,
            ],
            [
                3.0 * DVec3::Z,
                3.0 * DVec3::Z + DVec3::X,
                3.0 * DVec3::Z + DVec3::Y,
            ],
        ];
        let grid = Grid { scale: 4 };
        let meeting = Exact::of_planes(grid, &planes).unwrap();
        let line = [DVec3::new(1.0, 2.0, -7.0), DVec3::new(1.0, 2.0, 11.0)];
        let same = Exact::of_line_and_plane(grid, &line, &planes[2]).unwrap();
        for (axis, expected) in [1.0, 2.0, 3.0].into_iter().enumerate() {
            assert!(meeting.compare(&same, axis).is_eq());
            let found = meeting.rounded(grid, axis);
            assert!(found.lo <= expected && expected <= found.hi);
        }
        assert!(Exact::of_planes(grid, &[planes[0], planes[0], planes[1]]).is_none());
    }

    #[test]
    fn a_mean_of_corners_is_in_their_plane() {
        let grid = Grid { scale: 0 };
        let triangle = [
            DVec3::new(1e15, 3.0, 1.0),
            DVec3::new(1e15 + 1.0, 3.0, 2.0),
            DVec3::new(1e15, 4.0, 5.0),
        ];
        let corners = triangle.map(|p| Exact::of_point(grid, p));
        let mean = Exact::weighted(&corners, [1, 2, 4]);
        for axis in 0..3 {
            let same = mean.on_plane(grid, &triangle, axis).unwrap();
            assert!((0..3).all(|k| mean.compare(&same, k).is_eq()));
        }
        let other = triangle.map(|p| p + DVec3::Z);
        let above = mean.on_plane(grid, &other, 2).unwrap();
        assert!(above.compare(&mean, 2).is_gt() && above.compare(&mean, 0).is_eq());
        let upright = [DVec3::ZERO, DVec3::X, DVec3::Z];
        assert!(mean.on_plane(grid, &upright, 2).is_none());
    }
}

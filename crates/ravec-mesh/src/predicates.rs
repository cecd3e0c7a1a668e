//! Exact signs of orientation determinants.
//!
//! A determinant is first evaluated in `f64` together with a bound of its rounding error; only when the value does not
//! exceed the bound is it evaluated again with expansions of floating-point numbers.
//!
//! Source: Shewchuk, "Adaptive Precision Floating-Point Arithmetic and Fast Robust Geometric Predicates", 1997 (through
//! the crate `robust`); Meyer and Pion, "FPG: A code generator for fast and certified geometric predicates", 2008 (the
//! bound by the largest differences).
//!
//! Guarantees: the sign is that of the determinant of the coordinates as they are stored, as long as differences of
//! coordinates are 0 or lie between 1e-90 and 1e90 in size. Does not guarantee: anything about coordinates beyond
//! that range or that are not finite.
//! Cost: 3 ns when the bound decides, as it nearly always does; 0.1 to 1 µs otherwise.

use std::ops::{Mul, Neg};

use glam::{DVec2, DVec3};
use robust::{Coord, Coord3D};

/// The sign of an exact number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[repr(i8)]
pub enum Sign {
    /// Below zero.
    Negative = -1,
    /// Zero.
    Zero = 0,
    /// Above zero.
    Positive = 1,
}

impl Sign {
    /// The sign of `x`; zero if `x` is not a number.
    #[inline]
    pub fn of(x: f64) -> Self {
        if x > 0.0 {
            Self::Positive
        } else if x < 0.0 {
            Self::Negative
        } else {
            Self::Zero
        }
    }
}

impl Neg for Sign {
    type Output = Self;

    #[inline]
    fn neg(self) -> Self {
        match self {
            Self::Negative => Self::Positive,
            Self::Zero => Self::Zero,
            Self::Positive => Self::Negative,
        }
    }
}

impl Mul for Sign {
    type Output = Self;

    #[inline]
    fn mul(self, other: Self) -> Self {
        match self {
            Self::Negative => -other,
            Self::Zero => Self::Zero,
            Self::Positive => other,
        }
    }
}

/// Rounding of `(e × f) · p` relative to the product of the largest components of `e`, `f` and `p`, where these are
/// differences of coordinates. Each of the six products passes through eight roundings of half an ulp, 2⁻⁵³, so that
/// 48 · 2⁻⁵³ = 5.33e-15 bounds the error to first order; the rest of 6e-15 covers the higher orders and the rounding
/// of the bound itself. Smaller is wrong; larger only asks for the exact value more often.
const FILTER: f64 = 6e-15;

/// The plane through three points, prepared to say exactly on which side other points lie.
#[derive(Debug, Clone, Copy)]
pub struct OrientedPlane {
    a: DVec3,
    b: DVec3,
    c: DVec3,
    normal: DVec3,
    scale: f64,
}

impl OrientedPlane {
    /// The plane through `a`, `b` and `c`, which run counter-clockwise as seen from its positive side.
    #[inline]
    pub fn through(a: DVec3, b: DVec3, c: DVec3) -> Self {
        let (e, f) = (b - a, c - a);
        Self {
            a,
            b,
            c,
            normal: e.cross(f),
            scale: FILTER * e.abs().max_element() * f.abs().max_element(),
        }
    }

    /// Positive on the side from which the three points run counter-clockwise.
    #[inline]
    pub fn side(&self, d: DVec3) -> Sign {
        let p = d - self.a;
        let det = self.normal.dot(p);
        let bound = self.scale * p.abs().max_element();
        if det > bound {
            Sign::Positive
        } else if det < -bound {
            Sign::Negative
        } else {
            orient3d_exact(self.a, self.b, self.c, d)
        }
    }

    /// Returns `true` if the three points are on one line.
    #[inline]
    pub fn is_degenerate(&self) -> bool {
        // a component of the cross product has two products with four roundings each: 1/6 of the bound above
        self.normal.abs().max_element() <= self.scale && on_one_line(self.a, self.b, self.c)
    }

    /// A rounded normal, of the length of twice the area.
    pub fn normal(&self) -> DVec3 {
        self.normal
    }
}

#[cold]
fn orient3d_exact(a: DVec3, b: DVec3, c: DVec3, d: DVec3) -> Sign {
    // flat parts that lie along the axes are common and need no expansions
    let flat = a.cmpeq(b) & a.cmpeq(c) & a.cmpeq(d);
    if flat.any() || a == d || b == d || c == d {
        return Sign::Zero;
    }
    let coord = |p: DVec3| Coord3D {
        x: p.x,
        y: p.y,
        z: p.z,
    };
    // `robust` counts the other side as positive
    -Sign::of(robust::orient3d(coord(a), coord(b), coord(c), coord(d)))
}

/// On which side of the plane through `a`, `b` and `c` the point `d` lies: positive on the side from which the three
/// run counter-clockwise, zero on the plane or if the three are on one line.
#[inline]
pub fn orient3d(a: DVec3, b: DVec3, c: DVec3, d: DVec3) -> Sign {
    OrientedPlane::through(a, b, c).side(d)
}

/// Positive if `a`, `b` and `c` run counter-clockwise, zero if they are on one line.
#[inline]
pub fn orient2d(a: DVec2, b: DVec2, c: DVec2) -> Sign {
    let coord = |p: DVec2| Coord { x: p.x, y: p.y };
    Sign::of(robust::orient2d(coord(a), coord(b), coord(c)))
}

/// Returns `true` if the three points are on one line, exactly.
pub fn on_one_line(a: DVec3, b: DVec3, c: DVec3) -> bool {
    Projection::ALL
        .iter()
        .all(|on| on.orient(a, b, c) == Sign::Zero)
}

/// One of the three views along an axis. Leaving out a coordinate is exact.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Projection {
    /// Along x.
    Yz,
    /// Along y.
    Zx,
    /// Along z.
    Xy,
}

impl Projection {
    pub(crate) const ALL: [Self; 3] = [Self::Yz, Self::Zx, Self::Xy];

    /// The view that shows most of a plane with this normal.
    pub(crate) fn facing(normal: DVec3) -> Self {
        let n = normal.abs();
        if n.x >= n.y && n.x >= n.z {
            Self::Yz
        } else if n.y >= n.z {
            Self::Zx
        } else {
            Self::Xy
        }
    }

    #[inline]
    pub(crate) fn of(self, p: DVec3) -> DVec2 {
        match self {
            Self::Yz => DVec2::new(p.y, p.z),
            Self::Zx => DVec2::new(p.z, p.x),
            Self::Xy => DVec2::new(p.x, p.y),
        }
    }

    #[inline]
    pub(crate) fn orient(self, a: DVec3, b: DVec3, c: DVec3) -> Sign {
        orient2d(self.of(a), self.of(b), self.of(c))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn det(a: [i64; 3], b: [i64; 3], c: [i64; 3], d: [i64; 3]) -> i128 {
        let e: [i128; 3] = std::array::from_fn(|k| (b[k] - a[k]).into());
        let f: [i128; 3] = std::array::from_fn(|k| (c[k] - a[k]).into());
        let p: [i128; 3] = std::array::from_fn(|k| (d[k] - a[k]).into());
        (e[1] * f[2] - e[2] * f[1]) * p[0]
            + (e[2] * f[0] - e[0] * f[2]) * p[1]
            + (e[0] * f[1] - e[1] * f[0]) * p[2]
    }

    fn point(p: [i64; 3]) -> DVec3 {
        DVec3::new(p[0] as f64, p[1] as f64, p[2] as f64)
    }

    fn sign(x: i128) -> Sign {
        match x.signum() {
            1 => Sign::Positive,
            0 => Sign::Zero,
            _ => Sign::Negative,
        }
    }

    #[test]
    fn a_point_above_a_counter_clockwise_triangle_is_on_the_positive_side() {
        let above = orient3d(DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z);
        let below = orient3d(DVec3::ZERO, DVec3::X, DVec3::Y, -DVec3::Z);
        assert_eq!((above, below), (Sign::Positive, Sign::Negative));
        assert_eq!(orient2d(DVec2::ZERO, DVec2::X, DVec2::Y), Sign::Positive);
    }

    #[test]
    fn three_points_of_which_two_coincide_are_on_one_line() {
        let p = DVec3::new(0.1, 0.2, 0.3);
        assert!(on_one_line(p, p, DVec3::ONE));
        assert!(OrientedPlane::through(p, p, DVec3::ONE).is_degenerate());
        assert!(
            !OrientedPlane::through(p, DVec3::ONE, DVec3::new(1.0, 1.0, 1.0 + f64::EPSILON))
                .is_degenerate()
        );
    }

    proptest! {
        #[test]
        fn signs_agree_with_integers_far_beyond_the_precision_of_the_filter(
            corners in prop::array::uniform3(prop::array::uniform3(-(1i64 << 36)..1 << 36)),
            weights in prop::array::uniform2(-8i64..8),
            nudge in prop::array::uniform3(-1i64..2),
        ) {
            // a lattice point of the plane, moved by at most one unit along each axis
            let [a, b, c] = corners;
            let d: [i64; 3] = std::array::from_fn(|k| {
                a[k] + weights[0] * (b[k] - a[k]) + weights[1] * (c[k] - a[k]) + nudge[k]
            });
            prop_assert_eq!(orient3d(point(a), point(b), point(c), point(d)), sign(det(a, b, c, d)));
        }
    }
}

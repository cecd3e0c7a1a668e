//! Intervals of doubles that are sure to hold the exact number.

use ravec_mesh::Sign;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// All numbers from `lo` to `hi`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Interval {
    pub lo: f64,
    pub hi: f64,
}

impl Interval {
    /// Everything: what is known after a division by something that may be zero.
    pub const ALL: Self = Self {
        lo: f64::NEG_INFINITY,
        hi: f64::INFINITY,
    };

    /// The interval around rounded products or quotients. They may vanish by underflow alone, so that zero is widened, too.
    #[inline]
    fn around(ends: [f64; 4]) -> Self {
        let (lo, hi) = ends
            .iter()
            .fold((ends[0], ends[0]), |(lo, hi), &x| (lo.min(x), hi.max(x)));
        if lo.is_nan() || hi.is_nan() {
            Self::ALL
        } else {
            Self {
                lo: lo.next_down(),
                hi: hi.next_up(),
            }
        }
    }

    /// The sign of every number within, if they agree.
    #[inline]
    pub fn sign(self) -> Option<Sign> {
        if self.lo > 0.0 {
            Some(Sign::Positive)
        } else if self.hi < 0.0 {
            Some(Sign::Negative)
        } else if self.lo == 0.0 && self.hi == 0.0 {
            Some(Sign::Zero)
        } else {
            None
        }
    }

    /// The number in the middle.
    #[inline]
    pub fn mid(self) -> f64 {
        0.5 * self.lo + 0.5 * self.hi
    }

    /// The distance between the ends.
    #[inline]
    pub fn width(self) -> f64 {
        self.hi - self.lo
    }

    /// Returns `true` if there may be a number in both.
    #[inline]
    pub fn meets(self, other: Self) -> bool {
        self.lo <= other.hi && other.lo <= self.hi
    }
}

impl From<f64> for Interval {
    #[inline]
    fn from(x: f64) -> Self {
        Self { lo: x, hi: x }
    }
}

/// The next number below a rounded sum or product; a sum of doubles that rounds to zero is zero.
#[inline]
fn down(x: f64) -> f64 {
    if x == 0.0 { 0.0 } else { x.next_down() }
}

/// The next number above.
#[inline]
fn up(x: f64) -> f64 {
    if x == 0.0 { 0.0 } else { x.next_up() }
}

impl Add for Interval {
    type Output = Self;

    #[inline]
    fn add(self, other: Self) -> Self {
        Self {
            lo: down(self.lo + other.lo),
            hi: up(self.hi + other.hi),
        }
    }
}

impl Neg for Interval {
    type Output = Self;

    #[inline]
    fn neg(self) -> Self {
        Self {
            lo: -self.hi,
            hi: -self.lo,
        }
    }
}

impl Sub for Interval {
    type Output = Self;

    #[inline]
    fn sub(self, other: Self) -> Self {
        self + -other
    }
}

impl Mul for Interval {
    type Output = Self;

    #[inline]
    fn mul(self, other: Self) -> Self {
        let zero = |i: Self| i.lo == 0.0 && i.hi == 0.0;
        if zero(self) || zero(other) {
            return Self::from(0.0);
        }
        let p = [
            self.lo * other.lo,
            self.lo * other.hi,
            self.hi * other.lo,
            self.hi * other.hi,
        ];
        Self::around(p)
    }
}

impl Div for Interval {
    type Output = Self;

    fn div(self, other: Self) -> Self {
        if other.lo <= 0.0 && other.hi >= 0.0 {
            return Self::ALL;
        }
        let q = [
            self.lo / other.lo,
            self.lo / other.hi,
            self.hi / other.lo,
            self.hi / other.hi,
        ];
        Self::around(q)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use num_bigint::BigInt;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn results_hold_the_exact_number(a in -1_000_000_i64..1_000_000, b in -1_000_000_i64..1_000_000, c in 1_i64..1_000_000) {
            // (a / c + b / c) · c = a + b and (a / c) · (b / c) · c² = a · b, exactly
            let of = |x: i64| Interval::from(x as f64);
            let holds = |i: Interval, x: &BigInt| {
                let x: f64 = x.to_string().parse().unwrap();
                i.lo <= x && x <= i.hi
            };
            let sum = (of(a) / of(c) + of(b) / of(c)) * of(c);
            prop_assert!(holds(sum, &BigInt::from(a + b)));
            let product = (of(a) / of(c)) * (of(b) / of(c)) * of(c) * of(c);
            prop_assert!(holds(product, &(BigInt::from(a) * BigInt::from(b))));
            let zero = of(a) - of(a);
            prop_assert_eq!(zero.sign(), Some(Sign::Zero));
        }
    }

    #[test]
    fn a_division_by_nearly_nothing_says_nothing() {
        let quotient = Interval::from(1.0)
            / Interval {
                lo: -1e-9,
                hi: 1e-9,
            };
        assert_eq!(quotient.sign(), None);
    }
}

//! Rational numbers and time stamps of frames.

use serde::{Deserialize, Serialize};
use std::fmt;
use std::num::NonZeroU32;
use std::str::FromStr;

/// A positive fraction: frames per second, seconds per tick, or width per height of a pixel.
///
/// Two fractions are equal if numerator and denominator are; [`reduced`](Self::reduced) gives the lowest terms.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Rational {
    num: NonZeroU32,
    den: NonZeroU32,
}

impl Rational {
    /// One.
    pub const ONE: Self = Self {
        num: NonZeroU32::MIN,
        den: NonZeroU32::MIN,
    };

    /// The time base of `den` ticks a second.
    pub(crate) const fn ticks(den: u32) -> Self {
        match NonZeroU32::new(den) {
            Some(den) => Self {
                num: NonZeroU32::MIN,
                den,
            },
            None => panic!("a time base of zero ticks"),
        }
    }

    /// `num / den`, or `None` if one of them is zero.
    pub fn new(num: u32, den: u32) -> Option<Self> {
        Some(Self {
            num: NonZeroU32::new(num)?,
            den: NonZeroU32::new(den)?,
        })
    }

    /// The nearest fraction with a denominator of at most `max_den`, by continued fractions; `None` unless `value` is between
    /// 1e-6 and 1e9.
    pub fn nearest(value: f64, max_den: u32) -> Option<Self> {
        if !(1e-6..=1e9).contains(&value) {
            return None;
        }
        let (mut p0, mut q0, mut p1, mut q1) = (0u64, 1u64, 1u64, 0u64);
        let mut rest = value;
        for _ in 0..40 {
            let whole = rest.floor();
            let (p2, q2) = (whole as u64 * p1 + p0, whole as u64 * q1 + q0);
            if q2 > u64::from(max_den) || p2 > u64::from(u32::MAX) {
                break;
            }
            (p0, q0, p1, q1) = (p1, q1, p2, q2);
            let fraction = rest - whole;
            if fraction < 1e-9 {
                break;
            }
            rest = 1.0 / fraction;
        }
        Self::new(u32::try_from(p1).ok()?, u32::try_from(q1).ok()?)
    }

    /// Numerator.
    pub fn num(self) -> u32 {
        self.num.get()
    }

    /// Denominator.
    pub fn den(self) -> u32 {
        self.den.get()
    }

    /// The nearest real.
    pub fn to_f64(self) -> f64 {
        f64::from(self.num()) / f64::from(self.den())
    }

    /// `1 / self`.
    #[must_use]
    pub fn recip(self) -> Self {
        Self {
            num: self.den,
            den: self.num,
        }
    }

    /// The same number in lowest terms.
    #[must_use]
    pub fn reduced(self) -> Self {
        let (mut a, mut b) = (self.num(), self.den());
        while b != 0 {
            (a, b) = (b, a % b);
        }
        Self::new(self.num() / a, self.den() / a).unwrap_or(self)
    }
}

impl fmt::Display for Rational {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.num, self.den)
    }
}

/// A text that is no positive fraction.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("`{0}` is no positive number or fraction, such as 25, 29.97 or 30000/1001")]
pub struct ParseRationalError(String);

impl FromStr for Rational {
    type Err = ParseRationalError;

    /// Reads `30000/1001`, `30000:1001`, `25` or `29.97`. The decimal forms of the NTSC rates (23.976, 29.97, 59.94, 119.88)
    /// are read as the rates.
    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let wrong = || ParseRationalError(text.chars().take(40).collect());
        if let Some((num, den)) = text.split_once(['/', ':']) {
            let parse = |part: &str| part.trim().parse().ok();
            return parse(num)
                .zip(parse(den))
                .and_then(|(num, den)| Self::new(num, den))
                .ok_or_else(wrong);
        }
        if let Ok(whole) = text.trim().parse() {
            return Self::new(whole, 1).ok_or_else(wrong);
        }
        let value: f64 = text.trim().parse().map_err(|_| wrong())?;
        for base in [24u32, 30, 48, 60, 120] {
            if (value - f64::from(base) / 1.001).abs() < 0.005 {
                return Self::new(base * 1000, 1001).ok_or_else(wrong);
            }
        }
        Self::nearest(value, 100_000).ok_or_else(wrong)
    }
}

impl TryFrom<String> for Rational {
    type Error = ParseRationalError;

    fn try_from(text: String) -> Result<Self, Self::Error> {
        text.parse()
    }
}

impl From<Rational> for String {
    fn from(rational: Rational) -> Self {
        rational.to_string()
    }
}

/// Time stamp and duration of a frame, in ticks of its clip's time base.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct FrameTime {
    /// Ticks from the start of the clip to the moment at which the frame is shown. May be negative.
    pub start: i64,
    /// Ticks for which the frame is shown.
    pub duration: u64,
}

/// `ticks` of one time base in ticks of another, to the nearest, saturating at the range of the result.
pub fn rescale(ticks: i64, from: Rational, to: Rational) -> i64 {
    let num = i128::from(ticks) * i128::from(from.num()) * i128::from(to.den());
    let den = i128::from(from.den()) * i128::from(to.num());
    let nearest = (num + den / 2).div_euclid(den);
    i64::try_from(nearest).unwrap_or(if nearest < 0 { i64::MIN } else { i64::MAX })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_are_read_as_people_write_them() {
        let read = |text: &str| text.parse::<Rational>().unwrap();
        assert_eq!(read("25"), Rational::new(25, 1).unwrap());
        assert_eq!(read("30000/1001"), Rational::new(30000, 1001).unwrap());
        assert_eq!(read("30000:1001"), Rational::new(30000, 1001).unwrap());
        assert_eq!(read("29.97"), Rational::new(30000, 1001).unwrap());
        assert_eq!(read("23.976"), Rational::new(24000, 1001).unwrap());
        assert_eq!(read("12.5"), Rational::new(25, 2).unwrap());
        for wrong in [
            "", "0", "-1", "1/0", "0/1", "nan", "inf", "x", "1/", "1e300",
        ] {
            assert!(wrong.parse::<Rational>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn the_nearest_fraction_of_a_fraction_is_itself() {
        for (num, den) in [(1, 1), (179, 6), (25, 2), (30000, 1001), (1, 90000)] {
            let rational = Rational::new(num, den).unwrap();
            assert_eq!(
                Rational::nearest(rational.to_f64(), 100_000),
                Some(rational)
            );
        }
    }

    #[test]
    fn ticks_are_rescaled_to_the_nearest_and_saturate() {
        let (ms, film) = (
            Rational::new(1, 1000).unwrap(),
            Rational::new(1, 24).unwrap(),
        );
        assert_eq!(rescale(1, film, ms), 42);
        assert_eq!(rescale(-1, film, ms), -42);
        assert_eq!(rescale(42, ms, film), 1);
        assert_eq!(rescale(i64::MAX, film, ms), i64::MAX);
        assert_eq!(rescale(i64::MIN, film, ms), i64::MIN);
    }
}

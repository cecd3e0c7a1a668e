//! Sizes as they are asked for: pixels, percentages, or one side alone.

use crate::error::JobError;
use ravec::raster::Size;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// The length of a side.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Side {
    Pixels(u32),
    Percent(f64),
    /// Follows the other side, or stays.
    Open,
}

/// A size as it is written on the command line: `1080x1080`, `75%x100%`, `1080x`, `x720`, `50%`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct SizeSpec {
    sides: [Side; 2],
}

impl FromStr for SizeSpec {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let side = |word: &str| {
            let wrong = || {
                format!("`{word}` is no length: write pixels, as in 1080, or a share, as in 75%")
            };
            match word.trim() {
                "" => Ok(Side::Open),
                word => match word.strip_suffix('%') {
                    Some(share) => match share.trim().parse::<f64>() {
                        Ok(share) if share > 0.0 && share.is_finite() => Ok(Side::Percent(share)),
                        _ => Err(wrong()),
                    },
                    None => match word.parse::<u32>() {
                        Ok(pixels) if pixels > 0 => Ok(Side::Pixels(pixels)),
                        _ => Err(wrong()),
                    },
                },
            }
        };
        let text = text.trim();
        let sides = match text.split_once(['x', 'X', '×']) {
            Some((width, height)) => [side(width)?, side(height)?],
            None if text.ends_with('%') => [side(text)?; 2],
            None => return Err("a size is WIDTHxHEIGHT, as in 1080x1080 or 75%x100%".to_owned()),
        };
        if sides == [Side::Open; 2] {
            return Err("a size has at least one side".to_owned());
        }
        Ok(Self { sides })
    }
}

impl fmt::Display for SizeSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let side = |side: Side| match side {
            Side::Pixels(pixels) => pixels.to_string(),
            Side::Percent(share) => format!("{share}%"),
            Side::Open => String::new(),
        };
        write!(f, "{}x{}", side(self.sides[0]), side(self.sides[1]))
    }
}

impl TryFrom<String> for SizeSpec {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl From<SizeSpec> for String {
    fn from(size: SizeSpec) -> Self {
        size.to_string()
    }
}

impl SizeSpec {
    /// Returns `true` if one side is left open.
    pub fn has_open_side(&self) -> bool {
        self.sides.contains(&Side::Open)
    }

    /// The size for a picture. A side that is left open stays as it is; with `keep_aspect` it follows the other one, and of two
    /// sides the picture fits into both.
    ///
    /// # Errors
    /// [`JobError::Parameter`] for more pixels than `max_pixels`.
    pub fn of(&self, picture: Size, keep_aspect: bool, max_pixels: u64) -> Result<Size, JobError> {
        let old = [picture.width() as f64, picture.height() as f64];
        let asked: [Option<f64>; 2] = [0, 1].map(|a: usize| match self.sides[a] {
            Side::Pixels(pixels) => Some(f64::from(pixels)),
            Side::Percent(share) => Some(old[a] * share / 100.0),
            Side::Open => None,
        });
        let new = if keep_aspect {
            let factors =
                [0, 1].map(|a: usize| asked[a].map_or(f64::INFINITY, |side| side / old[a]));
            old.map(|side| side * factors[0].min(factors[1]))
        } else {
            [0, 1].map(|a: usize| asked[a].unwrap_or(old[a]))
        };
        let wrong = || JobError::Parameter {
            field: "sizes",
            value: self.to_string(),
            range: "small enough to keep the output within `max_pixels`",
        };
        let sides = new.map(|side| side.round().max(1.0));
        if sides[0] * sides[1] > max_pixels as f64 {
            return Err(wrong());
        }
        Size::new(sides[0] as usize, sides[1] as usize).map_err(|_| wrong())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(text: &str, keep_aspect: bool) -> (usize, usize) {
        let picture = Size::new(600, 400).unwrap();
        let size: SizeSpec = text.parse().unwrap();
        let found = size.of(picture, keep_aspect, 1_000_000).unwrap();
        (found.width(), found.height())
    }

    #[test]
    fn sizes_are_pixels_shares_or_one_side() {
        assert_eq!(of("1080x500", false), (1080, 500));
        assert_eq!(of("75%x100%", false), (450, 400));
        assert_eq!(of("50%", false), (300, 200));
        assert_eq!(of("300x", false), (300, 400));
        assert_eq!(of("x33.5%", false), (600, 134));
        assert_eq!(of("300x", true), (300, 200));
        assert_eq!(of("300x100", true), (150, 100));
        assert_eq!(of("0.01%", false), (1, 1));
    }

    #[test]
    fn what_is_no_size_is_refused() {
        for text in [
            "", "x", "300", "0x5", "5x-1", "ax5", "0%", "NaN%", "5x5x5", "-3%x5",
        ] {
            assert!(text.parse::<SizeSpec>().is_err(), "{text}");
        }
        let picture = Size::new(600, 400).unwrap();
        for text in ["4000000000x4000000000", "1e30%", "1001x1000"] {
            let size: SizeSpec = text.parse().unwrap();
            assert!(size.of(picture, false, 1_000_000).is_err(), "{text}");
        }
    }

    #[test]
    fn a_size_is_read_back_from_its_text() {
        for text in ["1080x1080", "75%x100%", "1080x", "x7.5%"] {
            let size: SizeSpec = text.parse().unwrap();
            assert_eq!(size.to_string(), text);
            let json = serde_json::to_string(&size).unwrap();
            assert_eq!(serde_json::from_str::<SizeSpec>(&json).unwrap(), size);
        }
    }
}

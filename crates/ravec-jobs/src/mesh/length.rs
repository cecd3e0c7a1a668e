//! Lengths as people give them: in units of the mesh, or in percent of its size.

use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// A length that belongs to a mesh.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum Length {
    /// In units of the file's coordinates, as in `0.2`.
    Units(f64),
    /// In percent of the diagonal of the mesh's bounding box, as in `0.1%`.
    Percent(f64),
}

/// The text is no length.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error(
    "a length is a number in units of the file, as in 0.2, or a share of the diagonal, as in 0.1%"
)]
pub struct LengthError;

impl Length {
    /// The length in units of a mesh whose bounding box has this diagonal.
    pub fn of(self, diagonal: f64) -> f64 {
        match self {
            Self::Units(length) => length,
            Self::Percent(percent) => percent / 100.0 * diagonal,
        }
    }

    /// Whether it is more than nothing.
    pub fn is_positive(self) -> bool {
        match self {
            Self::Units(number) | Self::Percent(number) => number > 0.0,
        }
    }

    /// Whether it is less than nothing.
    pub fn is_negative(self) -> bool {
        match self {
            Self::Units(number) | Self::Percent(number) => number < 0.0,
        }
    }
}

impl FromStr for Length {
    type Err = LengthError;

    fn from_str(text: &str) -> Result<Self, LengthError> {
        let text = text.trim();
        let (digits, kind): (_, fn(f64) -> Self) = match text.strip_suffix('%') {
            Some(digits) => (digits.trim_end(), Self::Percent),
            None => (text, Self::Units),
        };
        let number: f64 = digits.parse().map_err(|_| LengthError)?;
        if number.is_finite() {
            Ok(kind(number))
        } else {
            Err(LengthError)
        }
    }
}

impl fmt::Display for Length {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Units(length) => write!(f, "{length}"),
            Self::Percent(percent) => write!(f, "{percent}%"),
        }
    }
}

impl TryFrom<String> for Length {
    type Error = LengthError;

    fn try_from(text: String) -> Result<Self, LengthError> {
        text.parse()
    }
}

impl From<Length> for String {
    fn from(length: Length) -> Self {
        length.to_string()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_length_is_a_number_or_a_share_and_reads_as_it_was_written() {
        for (text, length, of_200) in [
            ("0.5", Length::Units(0.5), 0.5),
            ("0.1%", Length::Percent(0.1), 0.2),
            ("-3e-2", Length::Units(-0.03), -0.03),
            (" 50 % ", Length::Percent(50.0), 100.0),
        ] {
            assert_eq!(text.parse(), Ok(length));
            assert!((length.of(200.0) - of_200).abs() < 1e-15);
            assert_eq!(length.to_string().parse(), Ok(length));
        }
        for wrong in ["", "%", "2 mm", "inf", "nan%", "1,5", "0.1%%"] {
            assert_eq!(wrong.parse::<Length>(), Err(LengthError), "{wrong}");
        }
    }
}

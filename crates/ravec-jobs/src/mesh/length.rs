//! Lengths as people give them: in units of the mesh, in percent of its size, or in millimeters and the like.

use crate::error::JobError;
use ravec::mesh_io::LengthUnit;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// A length that belongs to a mesh and may have a unit.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum Length {
    /// In units of the file's coordinates, as in `0.5`.
    Units(f64),
    /// In percent of the diagonal of the mesh's bounding box, as in `2%`.
    Percent(f64),
    /// In a unit of length, as in `2mm`.
    Physical(f64, LengthUnit),
}

/// The text is no length.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error(
    "a length is a number in units of the file, as in 0.5, a share of the diagonal, as in 2%, or has a unit, as in 2mm: um, \
     mm, cm, m, in or ft"
)]
pub struct LengthError;

/// Units as they are written after a number. What ends in another one comes first.
const SUFFIXES: [(&str, LengthUnit); 7] = [
    ("um", LengthUnit::Micron),
    ("µm", LengthUnit::Micron),
    ("mm", LengthUnit::Millimeter),
    ("cm", LengthUnit::Centimeter),
    ("in", LengthUnit::Inch),
    ("ft", LengthUnit::Foot),
    ("m", LengthUnit::Meter),
];

impl Length {
    /// The length in units of a mesh whose bounding box has this diagonal and whose coordinates have this unit.
    ///
    /// # Errors
    /// [`JobError::Parameter`], of `field`, if the length has a unit and that of the mesh is unknown.
    pub(crate) fn resolve(
        self,
        field: &'static str,
        diagonal: f64,
        unit: Option<LengthUnit>,
    ) -> Result<f64, JobError> {
        match (self, unit) {
            (Self::Units(length), _) => Ok(length),
            (Self::Percent(percent), _) => Ok(percent / 100.0 * diagonal),
            (Self::Physical(number, of), Some(unit)) => Ok(of.per(unit).apply(number)),
            (Self::Physical(..), None) => Err(JobError::Parameter {
                field,
                value: self.to_string(),
                range: "a plain number or a percentage: the file does not name its unit",
            }),
        }
    }

    /// True for a length above 0.
    pub fn is_positive(self) -> bool {
        self.number() > 0.0
    }

    /// True for a length below 0.
    pub fn is_negative(self) -> bool {
        self.number() < 0.0
    }

    /// The number before the unit.
    pub fn number(self) -> f64 {
        match self {
            Self::Units(number) | Self::Percent(number) | Self::Physical(number, _) => number,
        }
    }

    /// The same length without its sign.
    pub fn abs(self) -> Self {
        self.map(f64::abs)
    }

    /// The length times a factor.
    pub fn times(self, factor: f64) -> Self {
        self.map(|number| factor * number)
    }

    fn map(self, number: impl FnOnce(f64) -> f64) -> Self {
        match self {
            Self::Units(value) => Self::Units(number(value)),
            Self::Percent(value) => Self::Percent(number(value)),
            Self::Physical(value, unit) => Self::Physical(number(value), unit),
        }
    }
}

impl FromStr for Length {
    type Err = LengthError;

    fn from_str(text: &str) -> Result<Self, LengthError> {
        let text = text.trim();
        let finite = |digits: &str| -> Result<f64, LengthError> {
            let number: f64 = digits.trim_end().parse().map_err(|_| LengthError)?;
            number.is_finite().then_some(number).ok_or(LengthError)
        };
        if let Some(digits) = text.strip_suffix('%') {
            return Ok(Self::Percent(finite(digits)?));
        }
        for (suffix, unit) in SUFFIXES {
            if let Some(digits) = text.strip_suffix(suffix) {
                return Ok(Self::Physical(finite(digits)?, unit));
            }
        }
        Ok(Self::Units(finite(text)?))
    }
}

impl fmt::Display for Length {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Units(length) => write!(f, "{length}"),
            Self::Percent(percent) => write!(f, "{percent}%"),
            Self::Physical(number, unit) => {
                let suffix = SUFFIXES.iter().find(|(_, known)| known == unit);
                write!(f, "{number}{}", suffix.map_or("", |(suffix, _)| suffix))
            }
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
    fn a_length_reads_as_it_was_written_and_knows_its_length() {
        let inches = Some(LengthUnit::Inch);
        for (text, length, in_inches) in [
            ("0.5", Length::Units(0.5), 0.5),
            ("-2e-1", Length::Units(-0.2), -0.2),
            (" 2 % ", Length::Percent(2.0), 4.0),
            (
                "25.4mm",
                Length::Physical(25.4, LengthUnit::Millimeter),
                1.0,
            ),
            (
                "25400 µm",
                Length::Physical(25_400.0, LengthUnit::Micron),
                1.0,
            ),
            (
                "1e-1m",
                Length::Physical(0.1, LengthUnit::Meter),
                3.937_007_874,
            ),
            (
                "1 cm",
                Length::Physical(1.0, LengthUnit::Centimeter),
                0.393_700_787,
            ),
            ("0.1in", Length::Physical(0.1, LengthUnit::Inch), 0.1),
            ("-1ft", Length::Physical(-1.0, LengthUnit::Foot), -12.0),
        ] {
            assert_eq!(text.parse(), Ok(length), "{text}");
            let resolved = length.resolve("distance", 200.0, inches).unwrap();
            assert!((resolved - in_inches).abs() < 1e-8, "{text} is {resolved}");
            assert_eq!(length.to_string().parse(), Ok(length));
            assert!(length.abs().number() > 0.0);
        }
        for wrong in [
            "", "%", "mm", "2 miles", "inf", "nanmm", "1,5mm", "2mm%", "2%mm",
        ] {
            assert_eq!(wrong.parse::<Length>(), Err(LengthError), "{wrong}");
        }
    }

    #[test]
    fn a_unit_needs_that_of_the_mesh() {
        let unknown = |length: Length| length.resolve("distance", 1.0, None);
        let error = unknown(Length::Physical(2.0, LengthUnit::Inch)).unwrap_err();
        assert!(error.to_string().contains("`distance` is 2in"), "{error}");
        assert_eq!(unknown(Length::Units(2.0)).unwrap(), 2.0);
        assert_eq!(unknown(Length::Percent(2.0)).unwrap(), 0.02);
    }
}

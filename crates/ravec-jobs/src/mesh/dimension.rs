//! Lengths with a unit: as numbers of the file, in percent of its size, or in millimeters and the like.

use super::convert::Unit;
use ravec::mesh_io::LengthUnit;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// A length that belongs to a mesh and may have a unit.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum Dimension {
    /// In units of the file's coordinates, as in `0.5`.
    Units(f64),
    /// In percent of the diagonal of the mesh's bounding box, as in `2%`.
    Percent(f64),
    /// In a unit of length, as in `2mm`.
    Physical(f64, Unit),
}

/// The text is no length.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error(
    "a length is a number in units of the file, as in 0.5, a share of the diagonal, as in 2%, or has a unit, as in 2mm: um, \
     mm, cm, m, in or ft"
)]
pub struct DimensionError;

/// Units as they are written after a number. What ends in another one comes first.
const SUFFIXES: [(&str, Unit); 7] = [
    ("um", Unit::Micron),
    ("µm", Unit::Micron),
    ("mm", Unit::Millimeter),
    ("cm", Unit::Centimeter),
    ("in", Unit::Inch),
    ("ft", Unit::Foot),
    ("m", Unit::Meter),
];

impl Dimension {
    /// The length in units of a mesh whose bounding box has this diagonal and whose coordinates have this unit.
    ///
    /// `None` if it has a unit and that of the mesh is not known.
    pub fn of(self, diagonal: f64, unit: Option<LengthUnit>) -> Option<f64> {
        match self {
            Self::Units(length) => Some(length),
            Self::Percent(percent) => Some(percent / 100.0 * diagonal),
            Self::Physical(number, of) if Some(of.into()) == unit => Some(number),
            Self::Physical(number, of) => {
                unit.map(|unit| number * LengthUnit::from(of).in_meters() / unit.in_meters())
            }
        }
    }

    /// The number before the unit.
    pub fn number(self) -> f64 {
        match self {
            Self::Units(number) | Self::Percent(number) | Self::Physical(number, _) => number,
        }
    }

    /// The same length without its sign.
    pub fn abs(self) -> Self {
        match self {
            Self::Units(number) => Self::Units(number.abs()),
            Self::Percent(number) => Self::Percent(number.abs()),
            Self::Physical(number, unit) => Self::Physical(number.abs(), unit),
        }
    }
}

impl FromStr for Dimension {
    type Err = DimensionError;

    fn from_str(text: &str) -> Result<Self, DimensionError> {
        let text = text.trim();
        let finite = |digits: &str| -> Result<f64, DimensionError> {
            let number: f64 = digits.trim_end().parse().map_err(|_| DimensionError)?;
            number.is_finite().then_some(number).ok_or(DimensionError)
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

impl fmt::Display for Dimension {
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

impl TryFrom<String> for Dimension {
    type Error = DimensionError;

    fn try_from(text: String) -> Result<Self, DimensionError> {
        text.parse()
    }
}

impl From<Dimension> for String {
    fn from(dimension: Dimension) -> Self {
        dimension.to_string()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_dimension_reads_as_it_was_written_and_knows_its_length() {
        let inches = Some(LengthUnit::Inch);
        for (text, dimension, in_inches) in [
            ("0.5", Dimension::Units(0.5), 0.5),
            ("-2e-1", Dimension::Units(-0.2), -0.2),
            (" 2 % ", Dimension::Percent(2.0), 4.0),
            ("25.4mm", Dimension::Physical(25.4, Unit::Millimeter), 1.0),
            ("25400 µm", Dimension::Physical(25_400.0, Unit::Micron), 1.0),
            (
                "1e-1m",
                Dimension::Physical(0.1, Unit::Meter),
                3.937_007_874,
            ),
            (
                "1 cm",
                Dimension::Physical(1.0, Unit::Centimeter),
                0.393_700_787,
            ),
            ("0.1in", Dimension::Physical(0.1, Unit::Inch), 0.1),
            ("-1ft", Dimension::Physical(-1.0, Unit::Foot), -12.0),
        ] {
            assert_eq!(text.parse(), Ok(dimension), "{text}");
            let length = dimension.of(200.0, inches).unwrap();
            assert!((length - in_inches).abs() < 1e-8, "{text} is {length}");
            assert_eq!(dimension.to_string().parse(), Ok(dimension));
            assert!(dimension.abs().number() > 0.0);
        }
        for wrong in [
            "", "%", "mm", "2 miles", "inf", "nanmm", "1,5mm", "2mm%", "2%mm",
        ] {
            assert_eq!(wrong.parse::<Dimension>(), Err(DimensionError), "{wrong}");
        }
    }

    #[test]
    fn a_unit_needs_that_of_the_mesh() {
        assert_eq!(Dimension::Physical(2.0, Unit::Inch).of(1.0, None), None);
        assert_eq!(Dimension::Units(2.0).of(1.0, None), Some(2.0));
        assert_eq!(Dimension::Percent(2.0).of(1.0, None), Some(0.02));
    }
}

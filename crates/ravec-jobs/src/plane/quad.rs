//! Quadrilaterals, grids, lenses and proportions as people give them.

use crate::error::JobError;
use crate::pixel_centers::PixelCenters;
use glam::{DVec2, dvec2};
use ravec::planar::Homography;
use ravec::raster::Size;
use ravec_media::focal_px_from_35mm;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// Four corners in turn, in pixels, x right, y down: `x0,y0,x1,y1,x2,y2,x3,y3`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Quad(pub [DVec2; 4]);

impl Quad {
    /// The corners with pixel centers at half-integers. Refuses what is no rectangle in perspective, or lies beside a picture of
    /// this size.
    pub(crate) fn check(&self, centers: PixelCenters, size: Size) -> Result<[DVec2; 4], JobError> {
        let corners = centers.read_all(self.0);
        Homography::from_unit_square(corners).map_err(|cause| JobError::Quad { cause })?;
        let extent = dvec2(size.width() as f64, size.height() as f64);
        let low = corners.into_iter().fold(DVec2::INFINITY, DVec2::min);
        let high = corners.into_iter().fold(DVec2::NEG_INFINITY, DVec2::max);
        if high.cmple(DVec2::ZERO).any() || low.cmpge(extent).any() {
            return Err(JobError::Outside {
                quad: self.to_string(),
                size,
            });
        }
        Ok(corners)
    }
}

impl FromStr for Quad {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers: Result<Vec<f64>, _> = text
            .split(',')
            .map(|number| number.trim().parse())
            .collect();
        let wrong = |what: &str| {
            format!(
                "{what}; a quadrilateral is eight numbers x,y,x,y,x,y,x,y, its corners in turn, in pixels"
            )
        };
        let numbers = numbers.map_err(|_| wrong("not all of these are numbers"))?;
        if numbers.len() != 8 {
            return Err(wrong(&format!("these are {} numbers", numbers.len())));
        }
        if !numbers.iter().all(|number| number.is_finite()) {
            return Err(wrong("a number is infinite or none at all"));
        }
        Ok(Self(
            [0, 2, 4, 6].map(|k| dvec2(numbers[k], numbers[k + 1])),
        ))
    }
}

impl fmt::Display for Quad {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [a, b, c, d] = self.0;
        write!(
            f,
            "{},{},{},{},{},{},{},{}",
            a.x, a.y, b.x, b.y, c.x, c.y, d.x, d.y
        )
    }
}

/// Columns and rows, as in `4x6`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Grid {
    /// From corner 0 to corner 1, 1 to 100.
    pub columns: u32,
    /// From corner 1 to corner 2, 1 to 100.
    pub rows: u32,
}

impl FromStr for Grid {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let count = |text: &str| {
            text.trim()
                .parse()
                .ok()
                .filter(|count| (1..=100).contains(count))
        };
        text.split_once(['x', 'X', '×'])
            .and_then(|(columns, rows)| Some((count(columns)?, count(rows)?)))
            .map(|(columns, rows)| Self { columns, rows })
            .ok_or_else(|| "a grid is columns and rows, 1 to 100 each, as in 4x6".to_owned())
    }
}

impl fmt::Display for Grid {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}x{}", self.columns, self.rows)
    }
}

/// A focal length: `1200px` or `1200`, or `28mm` for the lens that gives the same view on 35 mm film.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum Focal {
    /// In pixels.
    Pixels(f64),
    /// In millimeters, for 35 mm film.
    Film(f64),
}

impl Focal {
    /// In pixels of a picture of this size.
    pub fn in_pixels(self, size: Size) -> f64 {
        match self {
            Self::Pixels(pixels) => pixels,
            Self::Film(millimeters) => focal_px_from_35mm(millimeters, size.width(), size.height()),
        }
    }
}

impl FromStr for Focal {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (digits, kind): (_, fn(f64) -> Self) = match text.trim().strip_suffix("mm") {
            Some(digits) => (digits, Self::Film),
            None => (text.trim().trim_end_matches("px"), Self::Pixels),
        };
        positive(digits).map(kind).ok_or_else(|| {
            "a focal length is a positive number of pixels, as in 1200px, or of millimeters on 35 mm film, as in 28mm".to_owned()
        })
    }
}

impl fmt::Display for Focal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Pixels(pixels) => write!(f, "{pixels}px"),
            Self::Film(millimeters) => write!(f, "{millimeters}mm"),
        }
    }
}

/// Width by height: `3:2` or `1.5`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Ratio(pub f64);

impl FromStr for Ratio {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let ratio = match text.split_once(':') {
            Some((width, height)) => positive(width).zip(positive(height)).map(|(w, h)| w / h),
            None => positive(text),
        };
        ratio
            .filter(|ratio| ratio.is_finite() && *ratio > 0.0)
            .map(Self)
            .ok_or_else(|| "an aspect is width by height, as in 3:2 or 1.5".to_owned())
    }
}

impl fmt::Display for Ratio {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.0)
    }
}

fn positive(text: &str) -> Option<f64> {
    let number: f64 = text.trim().parse().ok()?;
    (number > 0.0 && number.is_finite()).then_some(number)
}

/// As text in parameters and reports.
macro_rules! as_text {
    ($($name:ident),*) => {
        $(impl TryFrom<String> for $name {
            type Error = String;

            fn try_from(text: String) -> Result<Self, String> {
                text.parse()
            }
        }

        impl From<$name> for String {
            fn from(value: $name) -> Self {
                value.to_string()
            }
        })*
    };
}

as_text!(Quad, Grid, Focal, Ratio);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read() {
        let quad: Quad = "1, 2,30.5,4,30,40,0,39".parse().unwrap();
        assert_eq!(quad.0[1], dvec2(30.5, 4.0));
        assert_eq!(quad.to_string().parse(), Ok(quad));
        assert_eq!(
            "4x6".parse(),
            Ok(Grid {
                columns: 4,
                rows: 6
            })
        );
        assert_eq!("28mm".parse(), Ok(Focal::Film(28.0)));
        assert_eq!("1200".parse(), Ok(Focal::Pixels(1200.0)));
        assert_eq!("1200px".parse(), Ok(Focal::Pixels(1200.0)));
        assert_eq!("3:2".parse(), Ok(Ratio(1.5)));
        for text in ["28mm", "17.5px"] {
            assert_eq!(text.parse::<Focal>().unwrap().to_string(), text);
        }
    }

    #[test]
    fn what_is_no_quadrilateral_is_said_in_a_sentence() {
        for (text, part) in [
            ("1,2,3", "these are 3 numbers"),
            ("1,2,3,4,5,6,7,8,9", "these are 9 numbers"),
            ("1,2,3,4,5,6,7,x", "not all of these are numbers"),
            ("1,2,3,4,5,6,7,NaN", "infinite or none"),
            ("", "not all of these"),
        ] {
            let error = text.parse::<Quad>().unwrap_err();
            assert!(
                error.contains(part) && error.contains("eight numbers"),
                "{error}"
            );
        }
        for text in ["4", "0x3", "4x101", "x", "axb"] {
            assert!(text.parse::<Grid>().is_err(), "{text}");
        }
        for text in ["0", "-3mm", "NaN", "mm", "1e999"] {
            assert!(text.parse::<Focal>().is_err(), "{text}");
        }
        for text in ["0", "3:0", "1:", ":", "1e-300:1e300"] {
            assert!(text.parse::<Ratio>().is_err(), "{text}");
        }
    }

    #[test]
    fn crossing_flat_and_far_quadrilaterals_are_refused() {
        let size = Size::new(100, 80).unwrap();
        let check = |text: &str| {
            text.parse::<Quad>()
                .unwrap()
                .check(PixelCenters::Half, size)
        };
        check("10,10,90,12,88,70,9,60").unwrap();
        // reaching beyond the picture is no harm
        check("-10,-10,190,12,188,170,-9,160").unwrap();
        for text in [
            "10,10,90,60,88,10,9,60",
            "10,10,20,20,30,30,9,60",
            "10,10,10,10,10,10,10,10",
            "10,10,90,12,40,20,9,60",
        ] {
            let error = check(text).unwrap_err();
            assert!(
                matches!(error, JobError::Quad { .. }) && error.kind() == crate::ErrorKind::Request,
                "{error}"
            );
        }
        let error = check("110,10,190,12,188,70,109,60").unwrap_err();
        assert!(
            matches!(error, JobError::Outside { .. }) && error.kind() == crate::ErrorKind::Request,
            "{error}"
        );
    }
}

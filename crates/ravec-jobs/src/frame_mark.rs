//! Strokes in the frames of a shot, as text: `FRAME:SIDE:RADIUS:X,Y,X,Y,...`.

use crate::pixel_centers::PixelCenters;
use glam::{DVec2, dvec2};
use ravec::raster::{Rect, Size};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// Radius up to which a stroke is taken, in pixels.
const MAX_RADIUS_PX: f64 = 4096.0;
/// Points of a stroke at most.
const MAX_POINTS: usize = 1 << 16;

/// Label of the pixels under a stroke.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// They are foreground.
    Foreground,
    /// They are background.
    Background,
}

impl Side {
    /// Name in text.
    pub fn name(self) -> &'static str {
        match self {
            Self::Foreground => "foreground",
            Self::Background => "background",
        }
    }
}

/// A stroke with a round tip in a frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct FrameMark {
    /// Number of the frame, from 0.
    pub frame: u64,
    /// Label of its pixels.
    pub side: Side,
    /// Radius of the tip in pixels.
    pub radius_px: f64,
    /// Points of its middle line, at least one.
    pub points: Vec<[f64; 2]>,
}

impl FrameMark {
    /// The pixels whose centers the tip touches, row by row, with points in this convention.
    pub(crate) fn cells(&self, size: Size, centers: PixelCenters) -> Vec<(usize, usize)> {
        let points: Vec<DVec2> = (self.points.iter())
            .map(|point| centers.read(DVec2::from(*point)))
            .collect();
        let Some(bounds) = bounds(&points, self.radius_px, size) else {
            return Vec::new();
        };
        let mut touched = vec![false; bounds.pixels()];
        let ends = points
            .iter()
            .zip(points.iter().skip(1).chain(points.last()));
        for (a, b) in ends {
            let part = around(*a, *b, self.radius_px, size);
            for row in part.row..part.bottom() {
                for col in part.col..part.right() {
                    let at = dvec2(col as f64 + 0.5, row as f64 + 0.5);
                    if distance(*a, *b, at) <= self.radius_px {
                        touched[(row - bounds.row) * bounds.width + col - bounds.col] = true;
                    }
                }
            }
        }
        let marked = touched.iter().enumerate().filter(|(_, touched)| **touched);
        marked
            .map(|(at, _)| {
                (
                    bounds.col + at % bounds.width,
                    bounds.row + at / bounds.width,
                )
            })
            .collect()
    }

    /// Pixels that the tip may touch, at some points only; `None` if there are none in the frame.
    pub(crate) fn bounds(
        &self,
        points: &[[f64; 2]],
        size: Size,
        centers: PixelCenters,
    ) -> Option<Rect> {
        let points: Vec<DVec2> = (points.iter())
            .map(|point| centers.read(DVec2::from(*point)))
            .collect();
        bounds(&points, self.radius_px, size)
    }
}

/// Pixels of a frame that a tip along some points may touch.
fn bounds(points: &[DVec2], radius: f64, size: Size) -> Option<Rect> {
    let low = points.iter().copied().reduce(DVec2::min)?;
    let high = points.iter().copied().reduce(DVec2::max)?;
    let bounds = around(low, high, radius, size);
    (!bounds.is_empty()).then_some(bounds)
}

/// Pixels of a frame that a tip between two points may touch.
fn around(a: DVec2, b: DVec2, radius: f64, size: Size) -> Rect {
    let side = |k: usize, length: usize| {
        let low = (a[k].min(b[k]) - radius - 1.0).clamp(0.0, length as f64) as usize;
        let high = (a[k].max(b[k]) + radius + 1.0).clamp(0.0, length as f64) as usize;
        (low, high - low)
    };
    let ((col, width), (row, height)) = (side(0, size.width()), side(1, size.height()));
    Rect::new(col, row, width, height)
}

/// Distance of a point from a segment.
fn distance(a: DVec2, b: DVec2, at: DVec2) -> f64 {
    let (along, to) = (b - a, at - a);
    let length = along.length_squared();
    let share = if length > 0.0 {
        (along.dot(to) / length).clamp(0.0, 1.0)
    } else {
        0.0
    };
    to.distance(along * share)
}

impl FromStr for FrameMark {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = |reason: &str| {
            let start: String = text.chars().take(60).collect();
            format!(
                "`{start}`: {reason}; write FRAME:SIDE:RADIUS:X,Y,X,Y,..., as in 40:foreground:6:100,80,140,90"
            )
        };
        let parts: Vec<&str> = text.split(':').map(str::trim).collect();
        let [frame, side, radius, points] = parts[..] else {
            return Err(wrong("it does not have four parts"));
        };
        let side = [Side::Foreground, Side::Background]
            .into_iter()
            .find(|known| known.name() == side)
            .ok_or_else(|| wrong("the side is neither foreground nor background"))?;
        let number = |text: &str| {
            text.trim()
                .parse()
                .ok()
                .filter(|value: &f64| value.is_finite())
        };
        let radius_px = number(radius)
            .filter(|radius| (0.5..=MAX_RADIUS_PX).contains(radius))
            .ok_or_else(|| wrong("the radius is not from 0.5 to 4096 pixels"))?;
        let values: Option<Vec<f64>> = points.split(',').map(number).collect();
        let values = values.ok_or_else(|| wrong("a coordinate is no number"))?;
        if values.len() % 2 != 0 || values.len() > 2 * MAX_POINTS {
            return Err(wrong("it does not have from 1 to 65536 points"));
        }
        Ok(Self {
            frame: frame.parse().map_err(|_| wrong("the frame is no number"))?,
            side,
            radius_px,
            points: values
                .chunks_exact(2)
                .map(|pair| [pair[0], pair[1]])
                .collect(),
        })
    }
}

impl fmt::Display for FrameMark {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}:{}:", self.frame, self.side.name(), self.radius_px)?;
        for (index, [x, y]) in self.points.iter().enumerate() {
            let comma = if index > 0 { "," } else { "" };
            write!(f, "{comma}{x},{y}")?;
        }
        Ok(())
    }
}

impl TryFrom<String> for FrameMark {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl From<FrameMark> for String {
    fn from(mark: FrameMark) -> Self {
        mark.to_string()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stroke_comes_back_from_its_text() {
        let text = "40:foreground:6.5:100,80,140.25,-9";
        let mark: FrameMark = text.parse().unwrap();
        assert_eq!((mark.frame, mark.points.len()), (40, 2));
        assert_eq!(mark.to_string(), text);
        for text in [
            "",
            "40",
            "40:foreground:6",
            "40:foreground:6:",
            "40:foreground:6:1,2,3",
            "40:foreground:0:1,2",
            "40:foreground:inf:1,2",
            "40:front:6:1,2",
            "-1:foreground:6:1,2",
            "4:foreground:6:1,nan",
            "4:foreground:6:1,2:3",
        ] {
            assert!(text.parse::<FrameMark>().is_err(), "{text}");
        }
    }

    #[test]
    fn the_tip_touches_what_is_within_its_radius() {
        let size = Size::new(40, 30).unwrap();
        let mark: FrameMark = "0:background:3:5,5,30,20,30,20".parse().unwrap();
        let found = mark.cells(size, PixelCenters::Half);
        let cells = (0..30).flat_map(|row| (0..40).map(move |col| (col, row)));
        let expected: Vec<(usize, usize)> = cells
            .filter(|&(col, row)| {
                // the nearest of many points on the segment
                let distances = (0..=2000).map(|k| f64::from(k) / 2000.0).map(|t| {
                    let (x, y) = (5.0 + 25.0 * t, 5.0 + 15.0 * t);
                    (col as f64 + 0.5 - x).hypot(row as f64 + 0.5 - y)
                });
                distances.fold(f64::INFINITY, f64::min) <= 3.0
            })
            .collect();
        assert_eq!(found, expected);
        // far outside there is nothing
        let away: FrameMark = "0:background:3:-500,1e300".parse().unwrap();
        assert!(away.cells(size, PixelCenters::Integer).is_empty());
    }
}

//! Strokes as data.

use crate::filter_error::FilterError;
use crate::operator::{Mode, OperatorParams};
use ravec_progress::Cancelled;
use ravec_raster::Size;

/// Effect of a stroke on the pixels under it.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub enum Tool {
    /// One of the modes of the operator.
    Operator {
        /// Mode of the operator.
        mode: Mode,
        /// Number of applications, 1 to 16.
        #[serde(default = "once")]
        iterations: u32,
        /// For cleaning: the noise in steps of 8-bit values, estimated when not given.
        #[serde(default)]
        noise_sigma: Option<f32>,
    },
    /// Paints a color over the picture.
    Color {
        /// Encoded sRGB, 0 to 255.
        rgb: [u8; 3],
    },
    /// Brightens, towards white but never beyond.
    Dodge,
    /// Darkens, towards black.
    Burn,
    /// Changes the saturation.
    Saturation {
        /// −1 takes all color away, 1 doubles it; −1 to 4.
        amount: f32,
    },
    /// Gives the hue and saturation of a color, and keeps the lightness.
    Recolor {
        /// Encoded sRGB, 0 to 255.
        rgb: [u8; 3],
    },
    /// Selects: writes into the mask beside the picture, which stays as it is.
    Mask,
    /// Copies from another place of the picture as it was before the stroke.
    Clone {
        /// Offset of the source, relative to each pixel: columns and rows. Pixels outside the picture are not copied.
        offset: [i32; 2],
    },
}

fn once() -> u32 {
    1
}

/// A stroke of the brush.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Stroke {
    /// Effect on the pixels under the stroke.
    pub tool: Tool,
    /// The way of the brush: positions `[x, y]` in pixels, y down. A single point is a dab.
    pub points: Vec<[f64; 2]>,
    /// Reach in pixels, above 0, at most 4096.
    pub radius_px: f64,
    /// The share of the radius with full effect, 0 (soft) to 1 (hard); default 0.5.
    #[serde(default = "half")]
    pub hardness: f64,
    /// Full effect, 0 to 1; default 1.
    #[serde(default = "full")]
    pub strength: f64,
    /// `true` if paint stops at edges; default yes.
    #[serde(default = "yes")]
    pub edge_aware: bool,
    /// Largest difference of colors on the way that paint passes, as an Oklab distance, 0.005 to 1; default 0.08. Less
    /// stops at fainter edges and at texture.
    #[serde(default = "tolerance")]
    pub edge_tolerance: f32,
    /// Side of the windows that find the edges, odd, 3 to 31; default 9.
    #[serde(default = "window")]
    pub window_px: usize,
    /// `true` if the effect adds up where the brush passes again; default no.
    #[serde(default)]
    pub accumulate: bool,
    /// For strokes that accumulate: the distance of dabs relative to the radius, 0.05 to 2; default 0.25.
    #[serde(default = "spacing")]
    pub spacing: f64,
}

fn half() -> f64 {
    0.5
}
fn full() -> f64 {
    1.0
}
fn yes() -> bool {
    true
}
fn tolerance() -> f32 {
    0.08
}
fn window() -> usize {
    9
}
fn spacing() -> f64 {
    0.25
}

impl Stroke {
    /// A stroke with default settings.
    pub fn new(tool: Tool, points: Vec<[f64; 2]>, radius_px: f64) -> Self {
        Self {
            tool,
            points,
            radius_px,
            hardness: half(),
            strength: full(),
            edge_aware: yes(),
            edge_tolerance: tolerance(),
            window_px: window(),
            accumulate: false,
            spacing: spacing(),
        }
    }

    /// Refuses invalid strokes.
    pub(crate) fn check(&self) -> Result<(), Problem> {
        let finite = self
            .points
            .iter()
            .flatten()
            .all(|v| v.is_finite() && v.abs() <= 1e7);
        let within = |value: f64, low: f64, high: f64| (low..=high).contains(&value);
        if self.points.is_empty() {
            return Err(Problem("has no points"));
        }
        if self.points.len() > MAX_POINTS {
            return Err(Problem("has more than a million points"));
        }
        if !finite {
            return Err(Problem(
                "has a point that is not a number or further than 10 000 000 pixels away",
            ));
        }
        if !(self.radius_px > 0.0 && self.radius_px <= 4096.0) {
            return Err(Problem(
                "has a radius that is not above 0 and at most 4096 pixels",
            ));
        }
        if !within(self.hardness, 0.0, 1.0) || !within(self.strength, 0.0, 1.0) {
            return Err(Problem("has a hardness or a strength that is not 0 to 1"));
        }
        if !within(f64::from(self.edge_tolerance), 0.005, 1.0) {
            return Err(Problem("has an edge tolerance that is not 0.005 to 1"));
        }
        if !(3..32).contains(&self.window_px) || self.window_px.is_multiple_of(2) {
            return Err(Problem("has a window that is not odd and 3 to 31 pixels"));
        }
        if !within(self.spacing, 0.05, 2.0) {
            return Err(Problem("has a spacing that is not 0.05 to 2"));
        }
        match self.tool {
            Tool::Operator {
                iterations,
                noise_sigma,
                ..
            } => {
                let noise_makes_sense =
                    noise_sigma.is_none_or(|sigma| (0.0..=255.0).contains(&sigma));
                if !(1..=16).contains(&iterations) || !noise_makes_sense {
                    return Err(Problem(
                        "has iterations that are not 1 to 16, or noise that is not 0 to 255",
                    ));
                }
            }
            Tool::Saturation { amount } if !(-1.0..=4.0).contains(&amount) => {
                return Err(Problem("has a saturation that is not -1 to 4"));
            }
            _ => {}
        }
        Ok(())
    }

    /// The operator of an operator tool.
    pub(crate) fn operator(&self) -> Option<OperatorParams> {
        match self.tool {
            Tool::Operator {
                mode,
                iterations,
                noise_sigma,
            } => Some(OperatorParams {
                mode,
                window_px: self.window_px,
                strength: 1.0,
                iterations,
                noise_sigma,
                seed: 0,
            }),
            _ => None,
        }
    }

    /// The stroke on a picture that is larger by `x` and `y`.
    fn scaled(&self, x: f64, y: f64) -> Self {
        if x == 1.0 && y == 1.0 {
            return self.clone();
        }
        let mean = (x * y).sqrt();
        let mut stroke = self.clone();
        for point in &mut stroke.points {
            *point = [point[0] * x, point[1] * y];
        }
        stroke.radius_px *= mean;
        // odd, and not so large that the fit becomes slow
        let window = (self.window_px as f64 * mean / 2.0).floor() as usize * 2 + 1;
        stroke.window_px = window.clamp(3, self.window_px.max(15));
        if let Tool::Clone { offset } = &mut stroke.tool {
            *offset = [
                (f64::from(offset[0]) * x).round() as i32,
                (f64::from(offset[1]) * y).round() as i32,
            ];
        }
        stroke
    }
}

/// The most points of a stroke.
const MAX_POINTS: usize = 1_000_000;

/// The most strokes of a list.
const MAX_STROKES: usize = 100_000;

/// An invalid property of a stroke.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Problem(pub &'static str);

/// Strokes on a picture of a certain size, as they are stored.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Strokes {
    /// The version of this format: 1.
    pub version: u32,
    /// Columns of the picture that the strokes were drawn on.
    pub width: usize,
    /// Rows of that picture.
    pub height: usize,
    /// The strokes in the order of drawing.
    pub strokes: Vec<Stroke>,
}

/// Why strokes could not be applied.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum StrokeError {
    /// A stroke is invalid.
    #[error("stroke {number} {problem}")]
    Stroke {
        /// Number of the stroke, counted from 1.
        number: usize,
        /// Description of the defect.
        problem: &'static str,
    },
    /// The list is of another version.
    #[error("the strokes have version {got}, but version 1 is needed")]
    Version {
        /// The version it has.
        got: u32,
    },
    /// The size that the strokes were drawn on is empty.
    #[error(
        "the strokes were drawn on a picture of {width} x {height} pixels: each side must be at least 1"
    )]
    EmptyPicture {
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
    },
    /// There are too many strokes.
    #[error("{got} strokes are too many: apply at most 100 000 at a time")]
    TooMany {
        /// Number of strokes.
        got: usize,
    },
    /// The operator failed.
    #[error(transparent)]
    Filter(FilterError),
    /// The caller cancelled.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

impl From<FilterError> for StrokeError {
    fn from(error: FilterError) -> Self {
        match error {
            FilterError::Cancelled(cancelled) => Self::Cancelled(cancelled),
            other => Self::Filter(other),
        }
    }
}

impl Strokes {
    /// No strokes yet, on a picture of the given size.
    pub fn new(size: Size) -> Self {
        Self {
            version: 1,
            width: size.width(),
            height: size.height(),
            strokes: Vec::new(),
        }
    }

    /// The strokes in pixels of a picture of another size, checked.
    pub(crate) fn scaled_to(&self, size: Size) -> Result<Vec<Stroke>, StrokeError> {
        if self.version != 1 {
            return Err(StrokeError::Version { got: self.version });
        }
        let (width, height) = (self.width, self.height);
        if width == 0 || height == 0 {
            return Err(StrokeError::EmptyPicture { width, height });
        }
        if self.strokes.len() > MAX_STROKES {
            return Err(StrokeError::TooMany {
                got: self.strokes.len(),
            });
        }
        let (x, y) = (
            size.width() as f64 / width as f64,
            size.height() as f64 / height as f64,
        );
        let checked = |(i, stroke): (usize, &Stroke)| {
            let wrong = |Problem(problem)| StrokeError::Stroke {
                number: i + 1,
                problem,
            };
            stroke.check().map_err(wrong)?;
            let stroke = stroke.scaled(x, y);
            stroke.check().map_err(wrong)?;
            Ok(stroke)
        };
        self.strokes.iter().enumerate().map(checked).collect()
    }
}

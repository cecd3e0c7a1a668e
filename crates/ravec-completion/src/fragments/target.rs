//! Targets, sources, and the steps that join them.
//!
//! A step says everything that is needed to do it again, in numbers that can be read and changed by hand: positions are
//! those of the pictures, not of the buffers in which they were found.

use glam::{DMat2, DVec2};
use serde::{Deserialize, Serialize};

/// Shape of a fragment: the pixels around its middle that it has.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Shape {
    /// Those within the radius.
    #[default]
    Circle,
    /// Those of a square with sides of two radii.
    Square,
}

impl Shape {
    /// The least radius of a fragment that reaches as far as this.
    pub(crate) fn distance(self, step: DVec2) -> f64 {
        match self {
            Self::Circle => step.length(),
            Self::Square => step.abs().max_element(),
        }
    }
}

/// The pixels to replace, as far as they lie in the hole, and the desired appearance of a source, as far as it is
/// known.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Target {
    /// The middle, in pixels of the picture, x right, y down, pixel centers at half-integers. Without a plane the middle of
    /// the pixel that it lies in counts.
    pub at: DVec2,
    /// The plane in whose rectified view the fragment is cut out, from 0; none for the picture itself.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plane: Option<usize>,
    /// From the middle to the rim, 2 to 124: in pixels of the picture, on a plane in pixels of its view, which are about as
    /// large at the hole. Larger follows more structure, smaller finds more that fits.
    pub radius_px: u32,
    /// Shape of the target (default [`Shape::Circle`]).
    #[serde(default)]
    pub shape: Shape,
}

impl Target {
    /// The round fragment of a picture around the pixel at `at`.
    pub fn new(at: DVec2, radius_px: u32) -> Self {
        Self {
            at,
            plane: None,
            radius_px,
            shape: Shape::Circle,
        }
    }
}

/// Transform that lays a source over its target.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Variant {
    /// Rotation of the source, in radians, clockwise as seen (default 0).
    pub turn_rad: f64,
    /// Left and right of the source are exchanged, before it is turned (default false).
    pub mirrored: bool,
    /// Scale of the copy relative to its source, 0.25 to 4 (default 1). Above 1 it becomes less sharp.
    pub scale: f64,
}

impl Default for Variant {
    fn default() -> Self {
        Self {
            turn_rad: 0.0,
            mirrored: false,
            scale: 1.0,
        }
    }
}

impl Variant {
    /// Returns `true` if it can be done: numbers, and a scale in range.
    pub fn is_usable(&self) -> bool {
        self.turn_rad.is_finite() && (0.25..=4.0).contains(&self.scale)
    }

    /// From steps in the copy to steps in the source.
    pub(crate) fn source_from_copy(self) -> DMat2 {
        let (sin, cos) = self.turn_rad.sin_cos();
        let turn = DMat2::from_cols(DVec2::new(cos, -sin), DVec2::new(sin, cos));
        let mirror = DMat2::from_diagonal(DVec2::new(if self.mirrored { -1.0 } else { 1.0 }, 1.0));
        mirror * turn * self.scale.recip()
    }
}

/// The copied source.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SourceFragment {
    /// From which photo: 0 for the picture itself, then the others in the order in which they were given (default 0).
    #[serde(default)]
    pub photo: usize,
    /// The plane of the picture in whose rectified view it is cut out, from 0; none for the photo as it is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub plane: Option<usize>,
    /// The point of the photo that is laid on the target's middle, in pixels, x right, y down, pixel centers at
    /// half-integers.
    pub at: DVec2,
    /// Transform that lays it over the target (default: the identity).
    #[serde(default)]
    pub transform: Variant,
}

/// One fragment laid over another.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Step {
    /// Mask of the replaced pixels.
    pub target: Target,
    /// By what.
    pub source: SourceFragment,
    /// Bend the tones of what is copied to those around it (default true).
    #[serde(default = "yes")]
    pub blend: bool,
}

fn yes() -> bool {
    true
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::dvec2;

    #[test]
    fn a_quarter_turn_takes_what_was_up_to_the_right() {
        let turn = Variant {
            turn_rad: std::f64::consts::FRAC_PI_2,
            ..Variant::default()
        };
        // a pixel to the right in the copy was above in the source
        let from = turn.source_from_copy() * DVec2::X;
        assert!(from.distance(DVec2::NEG_Y) < 1e-15, "{from}");
    }

    #[test]
    fn a_mirrored_copy_of_twice_the_size_takes_half_a_step_to_the_other_side() {
        let variant = Variant {
            mirrored: true,
            scale: 2.0,
            ..Variant::default()
        };
        assert_eq!(
            variant.source_from_copy() * dvec2(2.0, 4.0),
            dvec2(-1.0, 2.0)
        );
    }

    #[test]
    fn circles_and_squares_differ_in_their_corners() {
        assert_eq!(Shape::Circle.distance(dvec2(3.0, 4.0)), 5.0);
        assert_eq!(Shape::Square.distance(dvec2(3.0, 4.0)), 4.0);
    }
}

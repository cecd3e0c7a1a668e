//! Background plates: a picture of the plane of a shot without what moves before it.
//!
//! ```text
//! first pass:  each frame is warped onto the plate and its exposure fitted to the median of some before
//!              some of them are kept: as many as memory allows
//! modes:       for each pixel the color around which its samples are densest
//!              where several are, those of frames that agree with the plate around (`coherent`)
//!              where marked foreground lasts, colors of the background around (`hidden`)
//! second pass: each frame again, its exposure fitted to the modes
//!              samples near the mode of their pixel are averaged
//! ```
//!
//! Modes are robust, averages of all frames are free of noise and of the rounding that the samples of the first pass have.

mod coherent;
mod hidden;
mod mean;
mod modes;
mod on_plane;
mod regions;
mod samples;
mod surroundings;

pub use mean::PlateModes;
pub use regions::{joined_plate, plate_regions};
pub use samples::PlateSamples;

use crate::Colors;
use ravec_planar::Homography;
use ravec_raster::{Mask, Plane};

/// A frame of a shot on its way into a plate.
#[derive(Debug, Clone, Copy)]
pub struct ShotFrame<'a> {
    /// sRGB-encoded colors, 0 to 1.
    pub colors: &'a Colors,
    /// Map from the reference frame to this one.
    pub frame_from_reference: &'a Homography,
    /// Pixels that show foreground.
    pub foreground: Option<&'a Mask>,
    /// Those of them that belong to something that may cover a place most of the time.
    pub strokes: Option<&'a Mask>,
    /// Pixels that show the plane for certain.
    pub background: Option<&'a Mask>,
    /// True for the frame whose exposure the plate gets.
    pub is_reference: bool,
}

impl<'a> ShotFrame<'a> {
    /// A frame without marks.
    pub fn new(colors: &'a Colors, frame_from_reference: &'a Homography) -> Self {
        Self {
            colors,
            frame_from_reference,
            foreground: None,
            strokes: None,
            background: None,
            is_reference: false,
        }
    }
}

/// A background plate.
#[derive(Debug, Clone, PartialEq)]
pub struct Plate {
    /// sRGB-encoded colors, 0 to 1, in the exposure of the reference frame. Places that were never seen hold the colors of their
    /// surroundings.
    pub colors: Colors,
    /// Pixels that some frame shows without foreground.
    pub seen: Mask,
    /// Certainty, 0 to 1: the share of the samples of a pixel that agree with its color, times `n / (n + 1)` for `n` samples that
    /// do. 0 where nothing was seen.
    pub certainty: Plane,
    /// Standard deviation of the samples that agree, in units of color: noise, and more where the map to the frames is wrong. 0 where
    /// nothing was seen.
    pub spread: Plane,
    /// Share of the samples of a pixel that agree with its color.
    pub agreement: Plane,
    /// Number of frames that show a pixel.
    pub samples: Plane,
}

impl Plate {
    /// The share of the seen pixels whose color most frames have, 0 to 1; 1 where nothing was seen. Before a camera that stands still it
    /// is near 1; it falls below a half where frames do not lie on the plate.
    pub fn agreeing_share(&self) -> f64 {
        let seen = self.seen.coverage().pixels().iter();
        let agreement = seen.zip(self.agreement.pixels());
        let (mut agreeing, mut count) = (0usize, 0usize);
        for (_, agreement) in agreement.filter(|(seen, _)| **seen > 0.0) {
            count += 1;
            agreeing += usize::from(*agreement > 0.5);
        }
        if count == 0 {
            return 1.0;
        }
        agreeing as f64 / count as f64
    }
}

//! Foreground removed: the plate shows through.

use crate::grain::{grain, with_grain};
use crate::{Colors, VideoEditError, same_size};
use ravec_raster::{Image, Mask, Plane};

/// Alpha from which a pixel is foreground.
const MIN_ALPHA: f32 = 0.02;
/// Pixels around the foreground that are replaced too: what the matte misses of hair and blur.
const MARGIN_PX: f64 = 3.0;
/// Pixels beyond, over which the plate gives way to the frame.
const RAMP_PX: f64 = 2.0;

/// A frame of which the foreground is to be removed.
#[derive(Debug, Clone, Copy)]
pub struct Removal<'a> {
    /// sRGB-encoded colors, 0 to 1.
    pub frame: &'a Colors,
    /// Alpha of the foreground.
    pub alpha: &'a Plane,
    /// The plate as the frame shows it: in its view and light.
    pub background: &'a Colors,
    /// Share of certainty of the plate; where it is 0 the frame stays.
    pub known: &'a Plane,
    /// Number of the frame, if the plate gets the grain of the frame.
    pub grain: Option<u64>,
}

impl Removal<'_> {
    /// The frame without its foreground. Pixels more than 8 pixels from the foreground are those of the frame.
    ///
    /// # Errors
    /// [`VideoEditError::SizesDiffer`].
    pub fn result(&self) -> Result<Colors, VideoEditError> {
        let size = self.frame.size();
        same_size(self.alpha.size(), size)?;
        same_size(self.background.size(), size)?;
        same_size(self.known.size(), size)?;
        let weight = self.weight();
        let background = match self.grain {
            None => self.background.clone(),
            Some(number) => {
                let noise = grain(self.frame, self.background, &weight, self.known, number);
                with_grain(self.background, &noise, &weight)
            }
        };
        Ok(Image::from_fn(size, |col, row| {
            let at = (col, row);
            let weight = weight[at];
            if weight <= 0.0 {
                return self.frame[at];
            }
            [0, 1, 2].map(|c| weight * background[at][c] + (1.0 - weight) * self.frame[at][c])
        }))
    }

    /// Weight of the plate: 1 on the foreground, and falling to 0 around it.
    fn weight(&self) -> Plane {
        let foreground = Mask::from_fn(self.frame.size(), |col, row| {
            self.alpha[(col, row)] >= MIN_ALPHA
        });
        if foreground.is_empty() {
            return Plane::new(self.frame.size(), 0.0);
        }
        let hole = foreground.dilate(MARGIN_PX);
        let ramp = hole.dilate(RAMP_PX).feather(0.5 * RAMP_PX);
        Plane::from_fn(self.frame.size(), |col, row| {
            let weight = ramp.at(col, row).max(hole.at(col, row));
            // traces of the blur would replace pixels by themselves
            let weight = if weight < 0.01 { 0.0 } else { weight };
            weight * self.known[(col, row)]
        })
    }
}

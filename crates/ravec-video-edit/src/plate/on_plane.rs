//! Frames on a plate: their geometry, and their exposure against it.

use super::ShotFrame;
use crate::VideoEditError;
use crate::exposure::{Exposure, Pair};
use crate::interpolated::Interpolator;
use glam::DVec2;
use ravec_planar::Homography;
use ravec_raster::{Image, Mask, Size};

/// Pixels of the plate at which exposures are compared, at most.
pub const MAX_PAIRS: usize = 20_000;

/// Geometry of a plate: that of the reference frame, with `pad_px` pixels more on each side.
#[derive(Debug, Clone, Copy)]
pub struct Geometry {
    pub frame: Size,
    pub plate: Size,
    pub pad_px: usize,
}

impl Geometry {
    fn frame_from_plate(&self, frame: &ShotFrame<'_>) -> Homography {
        let shift = Homography::from_translation(DVec2::splat(-(self.pad_px as f64)))
            .unwrap_or(Homography::IDENTITY);
        let middle = DVec2::new(self.plate.width() as f64, self.plate.height() as f64) * 0.5;
        (*frame.frame_from_reference * shift).facing(middle)
    }

    pub fn stabilized(&self, frame: &ShotFrame<'_>) -> Result<Stabilized, VideoEditError> {
        if frame.colors.size() != self.frame {
            return Err(VideoEditError::SizesDiffer {
                found: frame.colors.size(),
                expected: self.frame,
            });
        }
        let map = self.frame_from_plate(frame);
        Ok(Interpolator::new(frame.colors, frame.foreground).view(&map, self.plate))
    }

    /// Pixels of the plate whose center lies in a pixel of a mask of the frame.
    pub fn marked(&self, frame: &ShotFrame<'_>, mask: &Mask) -> Mask {
        let map = self.frame_from_plate(frame);
        Mask::from_fn(self.plate, |col, row| {
            let at = map.try_apply(DVec2::new(col as f64 + 0.5, row as f64 + 0.5));
            at.is_some_and(|at| {
                at.x >= 0.0
                    && at.y >= 0.0
                    && at.x < self.frame.width() as f64
                    && at.y < self.frame.height() as f64
                    && mask.at(at.x as usize, at.y as usize) > 0.5
            })
        })
    }
}

/// Colors of a frame on the plate, and 1 where there are some.
pub type Stabilized = Image<[f32; 4]>;

/// A frame on the plate of one of several planes.
pub struct OnPlane<'a> {
    /// Index of the plane.
    pub plane: usize,
    pub frame: &'a ShotFrame<'a>,
    pub stabilized: Stabilized,
    /// Colors of the plate and of the frame.
    pub pairs: Vec<Pair>,
}

/// Exposure of a frame that lies on the plates of several planes. It is the same on all; where a plane fills little of the frame,
/// most of what lies on its plate is of others, so that the plane counts that fits best.
pub fn exposure_of(planes: &[OnPlane<'_>]) -> Exposure {
    if let [on] = planes {
        return Exposure::fit(&on.pairs);
    }
    let most = planes.iter().map(|on| on.pairs.len()).max().unwrap_or(0);
    let enough = planes.iter().filter(|on| 2 * on.pairs.len() >= most);
    let fits = enough.map(|on| {
        let exposure = Exposure::fit(&on.pairs);
        (exposure.deviation(&on.pairs), exposure)
    });
    let best = fits.min_by(|a, b| a.0.total_cmp(&b.0));
    best.map_or(Exposure::SAME, |(_, exposure)| exposure)
}

/// Colors of a frame on the plate beside colors that are known there.
pub fn pairs_of(
    stabilized: &Stabilized,
    colors: impl Fn(usize, usize) -> Option<[f32; 3]>,
) -> Vec<Pair> {
    let step = (stabilized.size().pixels() / MAX_PAIRS).isqrt().max(1);
    let mut pairs = Vec::new();
    for row in (step / 2..stabilized.height()).step_by(step) {
        for col in (step / 2..stabilized.width()).step_by(step) {
            let [r, g, b, share] = stabilized[(col, row)];
            if share == 0.0 {
                continue;
            }
            if let Some(plate) = colors(col, row) {
                let frame = [r, g, b];
                pairs.push(Pair { plate, frame });
            }
        }
    }
    pairs
}

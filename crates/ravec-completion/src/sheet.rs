//! The sheet: the part of a picture that a completion works on, flat.
//!
//! Without a plane it is a window of the picture, pixel by pixel. With one it is the rectified view, at a scale where the
//! hole has about the picture's own resolution, so that what repeats on the plane repeats on the sheet. Sheets are for
//! finding out what goes where; what is copied in the end is sampled from the picture itself.

use crate::canvas::{Canvas, HOLE, Ink, KNOWN, STEADY};
use glam::{DVec2, IVec2, dvec2};
use ravec_planar::Homography;
use ravec_raster::Rect;
use rayon::prelude::*;

/// Features by which pixels are compared: the ink, and the gradient of its luminance.
pub(crate) type Feature = [f32; 8];

/// Weight of a gradient against a color. More follows edges, less follows tones.
pub(crate) const GRADIENT_WEIGHT: f32 = 0.35;

/// A flat view of the surroundings of a hole.
#[expect(clippy::struct_field_names, reason = "maps are named dst_from_src")]
pub(crate) struct Sheet {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) inks: Vec<Ink>,
    pub(crate) features: Vec<Feature>,
    /// Bits of [`KNOWN`], [`SOURCE`], [`HOLE`], [`STEADY`].
    pub(crate) states: Vec<u8>,
    pub(crate) image_from_sheet: Homography,
}

impl Sheet {
    /// A window of the picture.
    pub(crate) fn window(canvas: &Canvas, window: Rect) -> Self {
        let at = |index: usize| {
            (
                window.col + index % window.width,
                window.row + index / window.width,
            )
        };
        let count = window.pixels();
        let mut sheet = Self {
            width: window.width,
            height: window.height,
            inks: (0..count).map(|index| canvas.inks[at(index)]).collect(),
            states: (0..count).map(|index| canvas.states[at(index)]).collect(),
            features: Vec::new(),
            image_from_sheet: Homography::from_translation(dvec2(
                window.col as f64,
                window.row as f64,
            ))
            .expect("a shift by a finite offset"),
        };
        sheet.find_features();
        sheet
    }

    /// The index of a pixel, if it is on the sheet.
    #[inline]
    pub(crate) fn index(&self, at: IVec2) -> Option<usize> {
        (at.x >= 0 && at.y >= 0 && (at.x as usize) < self.width && (at.y as usize) < self.height)
            .then(|| at.y as usize * self.width + at.x as usize)
    }

    #[inline]
    pub(crate) fn position(&self, index: usize) -> IVec2 {
        IVec2::new((index % self.width) as i32, (index / self.width) as i32)
    }

    /// The pixel that lies at an offset from another, if it is on the sheet.
    #[inline]
    pub(crate) fn shifted(&self, index: usize, offset: IVec2) -> Option<usize> {
        self.index(self.position(index) + offset)
    }

    /// Returns `true` if all bits are set.
    #[inline]
    pub(crate) fn is(&self, index: usize, bits: u8) -> bool {
        self.states[index] & bits == bits
    }

    /// Pixels that are to be filled.
    pub(crate) fn hole(&self) -> impl Iterator<Item = usize> {
        (0..self.states.len()).filter(|&index| self.is(index, HOLE))
    }

    /// Fills in [`Sheet::features`] and the bit [`STEADY`].
    pub(crate) fn find_features(&mut self) {
        let luminance: Vec<f32> = self
            .inks
            .iter()
            .map(|ink| 0.299 * ink[0] + 0.587 * ink[1] + 0.114 * ink[2])
            .collect();
        let (width, height) = (self.width, self.height);
        let found: Vec<(Feature, u8)> = (0..self.inks.len())
            .into_par_iter()
            .with_min_len(4096)
            .map(|index| {
                let (col, row) = (index % width, index / width);
                let (left, right) = (
                    index - usize::from(col > 0),
                    index + usize::from(col + 1 < width),
                );
                let up = if row > 0 { index - width } else { index };
                let down = if row + 1 < height {
                    index + width
                } else {
                    index
                };
                let known = [index, left, right, up, down]
                    .iter()
                    .all(|&i| self.states[i] & KNOWN != 0);
                let [r, g, b, a] = self.inks[index];
                let (dx, dy) = if known {
                    (
                        luminance[right] - luminance[left],
                        luminance[down] - luminance[up],
                    )
                } else {
                    (0.0, 0.0)
                };
                let state = self.states[index] & !STEADY | if known { STEADY } else { 0 };
                (
                    [
                        r,
                        g,
                        b,
                        a,
                        GRADIENT_WEIGHT * dx,
                        GRADIENT_WEIGHT * dy,
                        0.0,
                        0.0,
                    ],
                    state,
                )
            })
            .collect();
        (self.features, self.states) = found.into_iter().unzip();
    }
}

/// The squared distance of two features.
#[inline(always)]
pub(crate) fn distance_sq(a: &Feature, b: &Feature) -> f32 {
    let mut sum = [0.0f32; 8];
    for i in 0..8 {
        let d = a[i] - b[i];
        sum[i] = d * d;
    }
    (sum[0] + sum[1]) + (sum[2] + sum[3]) + ((sum[4] + sum[5]) + (sum[6] + sum[7]))
}

/// The squared distance of two inks.
#[inline(always)]
pub(crate) fn ink_distance_sq(a: &Ink, b: &Ink) -> f32 {
    let d: [f32; 4] = std::array::from_fn(|i| a[i] - b[i]);
    (d[0] * d[0] + d[1] * d[1]) + (d[2] * d[2] + d[3] * d[3])
}

/// The middle of a pixel.
#[inline]
pub(crate) fn center(at: IVec2) -> DVec2 {
    at.as_dvec2() + 0.5
}

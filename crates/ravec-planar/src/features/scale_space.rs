//! A picture blurred more and more, at sizes that fit the blur.
//!
//! An octave holds the picture at blurs σ₀ · 2^(i/3), i = 0 … 5, as if by that many of its own pixels, and its differences.
//! The next octave begins with every second pixel of its fourth picture, whose blur is twice the first one's.

use crate::features::detect::Extremum;
use ravec_progress::{Cancelled, Progress};
use ravec_raster::{Plane, Size, gaussian_blur};
use rayon::prelude::*;

/// Blurs by which the size doubles. Fewer find less and cost less; Lowe found the best repetition at 3.
pub(super) const SCALES: usize = 3;

/// The blur of an octave's first picture, in its pixels. Less is too sharp for every second pixel to say it all.
pub(super) const FIRST_SIGMA_PX: f64 = 1.6;

/// The blur that cameras and enlargements leave in a picture, as assumed by all implementations.
const CAMERA_SIGMA_PX: f64 = 0.5;

/// The smallest side of an octave: below it everything is border.
const MIN_SIDE: usize = 16;

/// One size.
pub(super) struct Octave {
    /// The blurred pictures, `SCALES` + 3 of them.
    pub blurred: Vec<Plane>,
    /// Each picture subtracted from the next blurrier one.
    pub differences: Vec<Plane>,
}

/// All sizes, the largest first: octave `o` has every 2^`o`-th pixel.
pub(super) struct ScaleSpace {
    pub octaves: Vec<Octave>,
}

impl ScaleSpace {
    pub(super) fn new(plane: &Plane, progress: &Progress) -> Result<Self, Cancelled> {
        let mut octaves = Vec::new();
        let added = (FIRST_SIGMA_PX.powi(2) - CAMERA_SIGMA_PX.powi(2)).sqrt();
        let mut first = gaussian_blur(plane, added);
        loop {
            progress.check()?;
            let octave = Octave::new(first);
            let next = every_second(&octave.blurred[SCALES]);
            octaves.push(octave);
            match next {
                Some(next) => first = next,
                None => return Ok(Self { octaves }),
            }
        }
    }

    /// The picture whose blur is nearest to that of an extremum.
    pub(super) fn nearest(&self, extremum: &Extremum) -> &Plane {
        let level = (extremum.level.round() as usize).min(SCALES + 2);
        &self.octaves[extremum.octave].blurred[level]
    }
}

impl Octave {
    fn new(first: Plane) -> Self {
        let sigma = |level: usize| FIRST_SIGMA_PX * 2f64.powf(level as f64 / SCALES as f64);
        let mut blurred = vec![first];
        let mut differences = Vec::new();
        for level in 1..SCALES + 3 {
            let added = (sigma(level).powi(2) - sigma(level - 1).powi(2)).sqrt();
            let before = &blurred[level - 1];
            let next = gaussian_blur(before, added);
            let mut difference = next.clone();
            difference
                .par_rows_mut()
                .zip(before.par_rows())
                .for_each(|(out, before)| {
                    for (out, before) in out.iter_mut().zip(before) {
                        *out -= before;
                    }
                });
            differences.push(difference);
            blurred.push(next);
        }
        Self {
            blurred,
            differences,
        }
    }
}

/// Every second pixel of every second row, from the first on; nothing if that is too small.
fn every_second(plane: &Plane) -> Option<Plane> {
    let (width, height) = (plane.width().div_ceil(2), plane.height().div_ceil(2));
    let size = Size::new(width, height).ok()?;
    (width.min(height) >= MIN_SIDE)
        .then(|| Plane::from_fn(size, |col, row| plane[(2 * col, 2 * row)]))
}

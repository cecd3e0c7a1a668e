//! A buffer at one resolution, as the search sees it.
//!
//! Colors are turned so that the first channel is their luminance: `(r + g + b) / √3`, `(r − b) / √2` and
//! `(r − 2g + b) / √6`. Squared differences stay what they were, and gradients need no channel of their own. Luminance has
//! a frame of one pixel, so that gradients at the border need no exception.
//!
//! Runs decide whether a whole fragment is known: each pixel stores the number of known ones that follow it in its row,
//! and a fragment is a few dozen rows. That is exact for every shape whose rows are connected, also for one that is cut
//! by the border of the picture, and needs one byte a pixel; a correlation with the unknown pixels would cost a
//! transform for each new shape.
//!
//! Cost: 13 bytes a pixel, 4 more with alpha and with features each.

use crate::canvas::Ink;
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;

/// Rows are read in whole vectors: so much may be read beyond the last pixel.
pub(super) const TAIL: usize = 16;
/// Weight of a gradient (the difference over two pixels, of a luminance that is √3 times the mean) against a color.
/// More follows edges, less follows tones. The automatic engine uses the same.
pub(super) const GRADIENT_WEIGHT: f32 = 0.2;
/// Weight of a feature pixel: half as much as the step from black to white in one channel.
const FEATURE_WEIGHT: f32 = 0.5;
/// Values of a pixel at most: luminance, two chromas, alpha, feature.
pub(super) const MAX_VALUES: usize = 5;

/// Features compared besides colors.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Channels {
    /// Some pixel is not opaque.
    pub(super) alpha: bool,
    /// Some pixels are marked as features.
    pub(super) features: bool,
}

impl Channels {
    /// Values that are colors, alpha included.
    pub(super) fn colors(self) -> usize {
        3 + usize::from(self.alpha)
    }

    /// All values.
    pub(super) fn values(self) -> usize {
        self.colors() + usize::from(self.features)
    }

    /// The values of a pixel; those beyond [`Channels::values`] are 0.
    #[inline]
    pub(super) fn of(self, [r, g, b, a]: Ink, feature: f32) -> [f32; MAX_VALUES] {
        use std::f32::consts::FRAC_1_SQRT_2;
        /// The roots of 1/3 and of 1/6.
        const ROOT_3: f32 = 0.577_350_26;
        const ROOT_6: f32 = 0.408_248_3;
        let mut values = [
            ROOT_3 * (r + g + b),
            FRAC_1_SQRT_2 * (r - b),
            ROOT_6 * (r - 2.0 * g + b),
            0.0,
            0.0,
        ];
        if self.alpha {
            values[3] = a;
        }
        if self.features {
            values[self.colors()] = FEATURE_WEIGHT * feature;
        }
        values
    }
}

/// The planes of a buffer at one resolution.
pub(super) struct Level {
    pub(super) width: usize,
    pub(super) height: usize,
    /// Luminance, with a frame of one pixel.
    pub(super) luma: Vec<f32>,
    /// The other values, without a frame.
    pub(super) planes: Vec<Vec<f32>>,
    /// For each pixel the number of source pixels from it to the right, itself included; 255 for more.
    pub(super) runs: Vec<u8>,
}

/// A row of all planes.
struct Row<'a> {
    luma: &'a mut [f32],
    planes: Vec<&'a mut [f32]>,
    runs: &'a mut [u8],
}

impl Level {
    /// A level from the values of its pixels, and whether they are sources.
    pub(super) fn new(
        width: usize,
        height: usize,
        channels: Channels,
        pixel: impl Fn(usize, usize) -> ([f32; MAX_VALUES], bool) + Sync,
    ) -> Self {
        let stride = width + 2;
        let mut luma = vec![0.0; stride * (height + 2) + TAIL];
        let mut planes = vec![vec![0.0; width * height + TAIL]; channels.values() - 1];
        let mut runs = vec![0; width * height];
        let mut columns: Vec<_> = planes
            .iter_mut()
            .map(|plane| plane.chunks_exact_mut(width))
            .collect();
        let rows: Vec<Row> = luma[stride..]
            .chunks_exact_mut(stride)
            .zip(runs.chunks_exact_mut(width))
            .map(|(luma, runs)| Row {
                luma,
                planes: columns.iter_mut().filter_map(Iterator::next).collect(),
                runs,
            })
            .collect();
        rows.into_par_iter()
            .enumerate()
            .with_min_len(8)
            .for_each(|(row, line)| {
                let mut run = 0u8;
                let mut planes = line.planes;
                for col in (0..width).rev() {
                    let (values, source) = pixel(col, row);
                    line.luma[col + 1] = values[0];
                    for (plane, value) in planes.iter_mut().zip(&values[1..]) {
                        plane[col] = *value;
                    }
                    run = if source { run.saturating_add(1) } else { 0 };
                    line.runs[col] = run;
                }
                line.luma[0] = line.luma[1];
                line.luma[width + 1] = line.luma[width];
            });
        luma.copy_within(stride..2 * stride, 0);
        luma.copy_within(
            stride * height..stride * (height + 1),
            stride * (height + 1),
        );
        Self {
            width,
            height,
            luma,
            planes,
            runs,
        }
    }

    /// The level of half the width and height: means of 2 × 2 pixels. Sources are those of which more than half are.
    pub(super) fn halved(
        &self,
        channels: Channels,
        progress: &Progress,
    ) -> Result<Self, Cancelled> {
        let (right, bottom) = (self.width - 1, self.height - 1);
        let half = Self::new(
            self.width.div_ceil(2),
            self.height.div_ceil(2),
            channels,
            |col, row| {
                let mut values = [0.0; MAX_VALUES];
                let mut sources = 0;
                if progress.is_cancelled() {
                    return (values, false);
                }
                for (x, y) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                    let (x, y) = ((2 * col + x).min(right), (2 * row + y).min(bottom));
                    let index = y * self.width + x;
                    sources += u8::from(self.runs[index] > 0);
                    values[0] += 0.25 * self.luma[self.luma_index(x, y)];
                    for (value, plane) in values[1..].iter_mut().zip(&self.planes) {
                        *value += 0.25 * plane[index];
                    }
                }
                (values, sources > 2)
            },
        );
        progress.check()?;
        Ok(half)
    }

    /// Index of the luminance of a pixel.
    #[inline]
    pub(super) fn luma_index(&self, col: usize, row: usize) -> usize {
        (row + 1) * (self.width + 2) + col + 1
    }

    pub(super) fn bytes(&self) -> usize {
        4 * (self.luma.len() + self.planes.iter().map(Vec::len).sum::<usize>()) + self.runs.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const COLORS: Channels = Channels {
        alpha: false,
        features: false,
    };

    #[test]
    fn turned_colors_are_as_far_apart_as_before() {
        let (a, b) = ([0.2, 0.9, 0.4, 1.0], [0.7, 0.1, 0.3, 1.0]);
        let (ta, tb) = (COLORS.of(a, 0.0), COLORS.of(b, 0.0));
        let square =
            |a: &[f32], b: &[f32]| -> f32 { a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum() };
        assert!((square(&a, &b) - square(&ta, &tb)).abs() < 1e-6);
    }

    #[test]
    fn runs_count_the_sources_to_the_right() {
        let level = Level::new(600, 2, COLORS, |col, row| {
            ([0.0; MAX_VALUES], row == 1 && col != 400)
        });
        assert_eq!(level.runs[..600], [0; 600]);
        assert_eq!(
            [0, 399, 400, 401, 599].map(|col| level.runs[600 + col]),
            [255, 1, 0, 199, 1]
        );
    }

    #[test]
    fn half_of_an_odd_level_repeats_its_last_row_and_column() {
        let level = Level::new(3, 3, COLORS, |col, row| {
            ([(col + 10 * row) as f32, 1.0, 2.0, 0.0, 0.0], true)
        });
        let half = level.halved(COLORS, &Progress::none()).unwrap();
        assert_eq!((half.width, half.height), (2, 2));
        assert_eq!(half.luma[half.luma_index(0, 0)], 5.5);
        assert_eq!(half.luma[half.luma_index(1, 1)], 22.0);
        assert_eq!(half.planes[1][..4], [2.0; 4]);
    }
}

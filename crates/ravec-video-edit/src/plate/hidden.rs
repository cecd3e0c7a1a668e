//! Places that foreground covers most of the time: there the most frequent color is not that of the background.
//!
//! The region that moving foreground sweeps is where no color is shown most of the time. Around it the background is known. In it,
//! each of the colors of a pixel is judged by how frequent it is, and by how likely it is among the colors of the background around
//! the region compared with all colors that the region has shown nearby. Pixels whose best color is one of the foreground were never seen.
//!
//! Only regions that strokes mark as foreground are treated so: leaves in the wind sweep regions too.

use super::modes::{Mode, Samples, biweight};
use ravec_raster::{Image, Mask, Plane, Rect, Size};
use rayon::prelude::*;

/// Share of samples at the mode below which a pixel is not stable.
const STABLE_SHARE: f32 = 0.75;
/// Gaps that are closed in a region, in pixels.
const CLOSE_PX: f64 = 4.0;
/// Pixels around a region that belong to it: soft rims of the foreground.
const RIM_PX: f64 = 3.0;
/// Reach of the colors around a region, and of those in it, in pixels.
const REACH_PX: usize = 40;
/// Standard deviation of the kernel of colors, in steps of 8 bits.
const COLOR_SIGMA: f32 = 10.0;
/// Exponent beyond which the kernel of colors counts as 0: a ten thousandth of [`MIN_DENSITY`].
const MAX_EXPONENT: f32 = 18.0;
/// Samples of colors on each side.
const MAX_COLORS: usize = 240;
/// Likelihood ratio, as a logarithm, below which a color is one of the foreground.
const FOREGROUND: f32 = -1.0;
/// Share of the marks on a region that must be at the most frequent color: else the foreground only passes.
const LASTING_SHARE: f32 = 0.2;
/// Density of colors that no color falls below: what is rare is not impossible.
const MIN_DENSITY: f32 = 2e-4;
/// Density, with a kernel of twice the width, that a color must have among those around the region.
const MIN_SUPPORT: f32 = 2e-3;
/// Share of the neighbors that must have been seen, too, and their distance in pixels.
const SEEN_SHARE: f32 = 0.5;
const NEIGHBORS_PX: usize = 3;

/// A pixel that a stroke marks as foreground in a frame.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Mark {
    pub at: (usize, usize),
    /// Color in that frame, in steps of 8 bits.
    pub color: [f32; 3],
}

/// Stability of the pixels of a plate.
pub(crate) struct Stability<'a> {
    /// Colors in steps of 8 bits; 0 in the last channel where there are no samples.
    pub modes: &'a Image<[f32; 4]>,
    /// Share of the samples at the mode.
    pub share: &'a Plane,
    pub marks: &'a [Mark],
    /// Radius of a mode.
    pub radius: f32,
}

impl Stability<'_> {
    /// The regions that marked foreground sweeps.
    pub fn swept(&self) -> Mask {
        let size = self.share.size();
        let unstable = Mask::from_fn(size, |col, row| {
            let at = (col, row);
            self.modes[at][3] > 0.0 && self.share[at] < STABLE_SHARE
        });
        let mut lasting: Image<u8> = Image::new(size, 0);
        let mut count = 0;
        for mark in self.marks {
            let [r, g, b, known] = self.modes[mark.at];
            let apart = [mark.color[0] - r, mark.color[1] - g, mark.color[2] - b];
            if known == 0.0 || biweight(apart, 1.0 / (self.radius * self.radius)) > 0.0 {
                lasting[mark.at] = 1;
                count += 1;
            }
        }
        if (count as f32) < LASTING_SHARE * self.marks.len() as f32 {
            return Mask::empty(size);
        }
        let marked = Mask::from_fn(size, |col, row| lasting[(col, row)] == 1);
        // single pixels are noise
        let solid = unstable.erode(1.0).dilate(1.0).union(&marked);
        let closed = solid
            .unwrap_or(unstable)
            .dilate(CLOSE_PX + RIM_PX)
            .erode(CLOSE_PX);
        connected(&without_holes(&closed), &marked)
    }
}

/// The mask with everything that it encloses.
fn without_holes(mask: &Mask) -> Mask {
    let size = mask.size();
    let border = Mask::from_fn(size, |col, row| {
        col == 0 || row == 0 || col + 1 == size.width() || row + 1 == size.height()
    });
    connected(&mask.invert(), &border).invert()
}

/// The parts of a mask that meet `seeds`.
fn connected(mask: &Mask, seeds: &Mask) -> Mask {
    let size = mask.size();
    let inside = |(col, row): (usize, usize)| mask.at(col, row) > 0.5;
    let mut reached: Image<u8> = Image::new(size, 0);
    let mut open: Vec<(usize, usize)> = (0..size.height())
        .flat_map(|row| (0..size.width()).map(move |col| (col, row)))
        .filter(|&(col, row)| seeds.at(col, row) > 0.0)
        .collect();
    while let Some((col, row)) = open.pop() {
        if reached[(col, row)] == 1 || !inside((col, row)) {
            continue;
        }
        reached[(col, row)] = 1;
        open.extend(col.checked_sub(1).map(|col| (col, row)));
        open.extend(row.checked_sub(1).map(|row| (col, row)));
        open.extend((col + 1 < size.width()).then_some((col + 1, row)));
        open.extend((row + 1 < size.height()).then_some((col, row + 1)));
    }
    Mask::from_fn(size, |col, row| reached[(col, row)] == 1)
}

/// Judges colors in a swept region.
pub(crate) struct Judge<'a> {
    stability: &'a Stability<'a>,
    swept: &'a Mask,
    /// Colors that the region has shown, by the pixel of a coarse grid.
    shown: Vec<((usize, usize), [f32; 3])>,
}

impl<'a> Judge<'a> {
    /// `samples` gives the samples of a pixel.
    pub fn new(
        stability: &'a Stability<'a>,
        swept: &'a Mask,
        samples: impl Fn(usize, usize) -> Samples,
    ) -> Self {
        let mut shown = Vec::new();
        for (col, row) in grid(swept.size(), swept, 3) {
            let samples = samples(col, row);
            for index in (0..samples.len()).step_by(5) {
                shown.push(((col, row), samples.color(index)));
            }
        }
        Self {
            stability,
            swept,
            shown,
        }
    }

    /// The best color of each pixel of a block of the plate; `None` where only foreground was seen.
    pub fn block(
        &self,
        block: Rect,
        radius: f32,
        samples: &(impl Fn(usize, usize) -> Samples + Sync),
    ) -> Vec<((usize, usize), Option<Mode>)> {
        let near = |(col, row): (usize, usize)| {
            let within = |at: usize, start: usize, length: usize| {
                at + REACH_PX >= start && at < start + length + REACH_PX
            };
            within(col, block.col, block.width) && within(row, block.row, block.height)
        };
        let around: Vec<[f32; 3]> = self.background(&near);
        let shown: Vec<[f32; 3]> = (self.shown.iter())
            .filter(|(at, _)| near(*at))
            .map(|(_, color)| *color)
            .collect();
        let marked = self.stability.marks.iter().map(|mark| mark.color).collect();
        let (around, shown, marked) = (thinned(around), thinned(shown), thinned(marked));
        let ratio = |color: [f32; 3]| {
            let foreground =
                density(&shown, color, COLOR_SIGMA).max(density(&marked, color, COLOR_SIGMA));
            ((density(&around, color, COLOR_SIGMA) + MIN_DENSITY) / (foreground + MIN_DENSITY)).ln()
        };
        let mut found = Vec::new();
        for row in block.row..block.row + block.height {
            for col in block.col..block.col + block.width {
                if self.swept.at(col, row) <= 0.5 {
                    continue;
                }
                let samples = samples(col, row);
                let count = samples.len() as f32;
                let best = samples
                    .modes(radius, samples.len())
                    .into_iter()
                    .filter(|mode| density(&around, mode.color, 2.0 * COLOR_SIGMA) > MIN_SUPPORT)
                    .map(|mode| {
                        let ratio = ratio(mode.color);
                        let score = (mode.density / count).ln() + ratio;
                        (score, ratio, mode)
                    })
                    .max_by(|a, b| a.0.total_cmp(&b.0));
                let best = best.filter(|(_, ratio, _)| *ratio > FOREGROUND);
                found.push(((col, row), best.map(|(_, _, mode)| mode)));
            }
        }
        found
    }

    /// Colors of the background around the region.
    fn background(&self, near: &impl Fn((usize, usize)) -> bool) -> Vec<[f32; 3]> {
        grid_of(self.swept.size(), 2)
            .filter(|&at| near(at))
            .filter(|&(col, row)| self.swept.at(col, row) <= 0.0)
            .filter_map(|at| {
                let [r, g, b, known] = self.stability.modes[at];
                (known > 0.0).then_some([r, g, b])
            })
            .collect()
    }
}

fn grid_of(size: Size, step: usize) -> impl Iterator<Item = (usize, usize)> {
    (0..size.height())
        .step_by(step)
        .flat_map(move |row| (0..size.width()).step_by(step).map(move |col| (col, row)))
}

fn grid(size: Size, mask: &Mask, step: usize) -> impl Iterator<Item = (usize, usize)> + '_ {
    grid_of(size, step).filter(|&(col, row)| mask.at(col, row) > 0.5)
}

/// At most [`MAX_COLORS`] of the colors, evenly chosen.
fn thinned(colors: Vec<[f32; 3]>) -> Vec<[f32; 3]> {
    let step = colors.len().div_ceil(MAX_COLORS).max(1);
    colors.into_iter().step_by(step).collect()
}

/// Kernel density of a color, 1 where all colors are equal to it.
fn density(colors: &[[f32; 3]], color: [f32; 3], sigma: f32) -> f32 {
    let scale = 0.5 / (sigma * sigma);
    let sum: f32 = colors
        .iter()
        .map(|other| {
            let distance: f32 = (0..3).map(|c| (other[c] - color[c]).powi(2)).sum();
            if scale * distance < MAX_EXPONENT {
                (-scale * distance).exp()
            } else {
                0.0
            }
        })
        .sum();
    sum / colors.len().max(1) as f32
}

/// Replaces modes in the swept regions. Pixels that were never seen lose theirs.
pub(crate) fn uncover(
    modes: &mut Image<[f32; 4]>,
    share: &Plane,
    marks: &[Mark],
    radius: f32,
    samples: &(impl Fn(usize, usize) -> Samples + Sync),
) {
    let before = modes.clone();
    let stability = Stability {
        modes: &before,
        share,
        marks,
        radius,
    };
    let swept = stability.swept();
    if swept.is_empty() {
        return;
    }
    let judge = Judge::new(&stability, &swept, samples);
    let blocks: Vec<Rect> = ravec_raster::tiles(modes.size(), 16).collect();
    let found: Vec<_> = blocks
        .into_par_iter()
        .flat_map_iter(|block| judge.block(block, radius, samples))
        .collect();
    for (at, mode) in found {
        modes[at] = match mode {
            Some(mode) => {
                let [r, g, b] = mode.color;
                [r, g, b, 1.0]
            }
            None => [0.0; 4],
        };
    }
    // what was seen is connected: a few pixels amid foreground have its colors by chance
    let found = modes.clone();
    for (col, row) in grid(modes.size(), &swept, 1) {
        let (mut seen, mut count) = (0.0, 0.0);
        for r in row.saturating_sub(NEIGHBORS_PX)..(row + NEIGHBORS_PX + 1).min(found.height()) {
            for c in col.saturating_sub(NEIGHBORS_PX)..(col + NEIGHBORS_PX + 1).min(found.width()) {
                seen += found[(c, r)][3];
                count += 1.0;
            }
        }
        if seen < SEEN_SHARE * count {
            modes[(col, row)] = [0.0; 4];
        }
    }
}

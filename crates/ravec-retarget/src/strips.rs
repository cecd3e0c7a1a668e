//! Candidates for long straight edges: the contrast across every straight line of a strip, all of them at once.
//!
//! A strip is 64 pixels long and as wide as the picture. A line enters it at one place and leaves it up to 63 pixels to
//! the side; along each such line the difference between the three pixels on one side and the three on the other is
//! averaged: a two-color pixel of 64 × 6, turned as the line is. Roughness averages out over such a length and a
//! straight edge does not.
//!
//! ```text
//! difference across, for each pixel
//! sums over lines of one pixel are these differences; over lines of 2, 4, 8 .. pixels:
//!     sum(rise, from) = left sum(rise / 2, from) + right sum(rise / 2, from + (rise + 1) / 2)
//! the candidates are the peaks of the last sums that the strip's roughness does not explain
//! ```
//!
//! Strips along x hold lines that are nearer to x, those along y the others; each half a strip further there is another.
//!
//! Source: A. Brandt and J. Dym, "Fast calculation of multiple line integrals", 1999, for the sums; A. Desolneux, L. Moisan and
//! J.-M. Morel, "Meaningful alignments", 2000, for judging a line by how seldom roughness alone makes one like it.
//!
//! Guarantees: the same candidates on any number of threads. Does not guarantee: that a candidate is straight, or that a line
//! is a single one.
//!
//! Cost: about 14 additions a pixel, channel and strip direction, for each of the two slopes.

use glam::{DVec2, dvec2};
use ravec_raster::{Image, Oklab};
use rayon::prelude::*;

/// The length of half a strip: a power of two.
const HALF: usize = 32;

/// The length of a strip. Longer ones find fainter lines and lose those that are shorter than most of it.
pub(crate) const STRIP: usize = 2 * HALF;

/// Number of pixels on each side of a line that are compared.
pub(crate) const SIDE: usize = 3;

/// The Oklab contrast along a whole strip from which on a line counts. Fainter ones an observer hardly sees.
const MIN_CONTRAST: f32 = 0.025;

/// By what factor the square of a line's contrast must exceed the median of its neighborhood. If contrasts of roughness are
/// normal, one line of a million does so by chance.
const MIN_ABOVE_MEDIAN: f32 = 50.0;

/// The neighborhood: this many places along the border of a strip.
const BAND: usize = 64;

/// Peaks are the largest within this many rises and places.
const PEAK: usize = 3;

/// The picture with one of its axes along the strips, by channels, so that what is across a strip lies together.
pub(crate) struct Frame {
    pub(crate) upright: bool,
    pub(crate) along: usize,
    pub(crate) across: usize,
    /// Place `at · across + v` holds what lies `at` along and `v` across.
    pub(crate) channels: [Vec<f32>; 3],
}

impl Frame {
    /// Strips go along y if `upright`.
    pub(crate) fn new(lab: &Image<Oklab>, upright: bool) -> Self {
        let (along, across) = if upright {
            (lab.height(), lab.width())
        } else {
            (lab.width(), lab.height())
        };
        let pixel = |at: usize, v: usize| {
            if upright { lab[(v, at)] } else { lab[(at, v)] }
        };
        let channels = [0, 1, 2].map(|c| {
            let mut out = vec![0.0; along * across];
            out.par_chunks_mut(across)
                .enumerate()
                .for_each(|(at, out)| {
                    for (v, out) in out.iter_mut().enumerate() {
                        *out = pixel(at, v).0[c];
                    }
                });
            out
        });
        Self {
            upright,
            along,
            across,
            channels,
        }
    }

    /// A place of the frame in the picture.
    pub(crate) fn point(&self, at: f64, v: f64) -> DVec2 {
        if self.upright {
            dvec2(v, at)
        } else {
            dvec2(at, v)
        }
    }

    /// A place of a candidate in the picture, so far along its strip.
    pub(crate) fn point_on(&self, candidate: &Candidate, along: f64) -> DVec2 {
        self.point(
            candidate.first as f64 + along,
            candidate.from + candidate.slope * along,
        )
    }

    /// By how much the pixels from `v` on differ from those before.
    fn differences(&self, channel: usize) -> Vec<f32> {
        let mut out = vec![0.0; self.along * self.across];
        let columns = self.channels[channel].par_chunks(self.across);
        out.par_chunks_mut(self.across)
            .zip(columns)
            .for_each(|(out, column)| {
                let last = column.len() - 1;
                for (v, out) in out.iter_mut().enumerate() {
                    let sum =
                        |k: usize| column[(v + k).min(last)] - column[v.saturating_sub(k + 1)];
                    *out = (0..SIDE).map(sum).sum::<f32>() / SIDE as f32;
                }
            });
        out
    }

    /// Candidates for straight edges, in the order of the strips.
    pub(crate) fn candidates(&self) -> Vec<Candidate> {
        if self.along < STRIP || self.across < 2 * SIDE {
            return Vec::new();
        }
        let differences = [0, 1, 2].map(|c| self.differences(c));
        // the last strip ends where the picture does
        let strips = (self.along - STRIP).div_ceil(HALF) + 1;
        let tasks: Vec<(usize, bool)> = (0..strips)
            .flat_map(|strip| [(strip, false), (strip, true)])
            .collect();
        tasks
            .into_par_iter()
            .flat_map_iter(|(strip, falling)| {
                let first = (strip * HALF).min(self.along - STRIP);
                Sums::new(&differences, self.across, first, falling).candidates()
            })
            .collect()
    }
}

/// A line that crosses a strip.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Candidate {
    /// Start of the strip.
    pub(crate) first: usize,
    /// Position of the line there.
    pub(crate) from: f64,
    /// Slope: its displacement across for each pixel along.
    pub(crate) slope: f64,
    /// Color after it across the strip, less the color before.
    pub(crate) step: [f32; 3],
    /// The contrast that roughness has on most lines of this length.
    pub(crate) noise: f32,
}

impl Candidate {
    pub(crate) fn contrast(&self) -> f32 {
        self.step.iter().map(|v| v * v).sum::<f32>().sqrt()
    }
}

/// The sums over all lines of a strip that rise, or that fall.
struct Sums {
    first: usize,
    across: usize,
    falling: bool,
    /// Those of both halves, as the lines come to them, by channels: `rise · across + from`.
    halves: [[Vec<f32>; 3]; 2],
}

impl Sums {
    fn new(differences: &[Vec<f32>; 3], across: usize, first: usize, falling: bool) -> Self {
        let half = |index: usize| {
            [0, 1, 2].map(|c| {
                let begin = if (index == 1) == falling {
                    first
                } else {
                    first + HALF
                };
                half_sums(
                    &differences[c][begin * across..][..HALF * across],
                    across,
                    falling,
                )
            })
        };
        Self {
            first,
            across,
            falling,
            halves: [half(0), half(1)],
        }
    }

    /// The sum over a line of the whole strip.
    fn sum(&self, channel: usize, rise: usize, from: usize) -> f32 {
        let at = |half: usize, from: usize| {
            self.halves[half][channel][rise / 2 * self.across..][..self.across].get(from)
        };
        let value = |found: Option<&f32>| found.copied().unwrap_or_default();
        value(at(0, from)) + value(at(1, from + rise.div_ceil(2)))
    }

    /// The squared lengths of the sums over lines of the whole strip, `rise · across + from`. Lines that leave the picture
    /// within its second half have 0: others hold what is seen of them.
    fn squares(&self) -> Vec<f32> {
        let across = self.across;
        let mut squares = vec![0.0f32; STRIP * across];
        for (rise, out) in squares.chunks_exact_mut(across).enumerate() {
            let shift = rise.div_ceil(2).min(across);
            for channel in 0..3 {
                let [left, right] = [0, 1]
                    .map(|half: usize| &self.halves[half][channel][rise / 2 * across..][..across]);
                for ((out, left), right) in out.iter_mut().zip(left).zip(&right[shift..]) {
                    *out += (left + right) * (left + right);
                }
            }
        }
        squares
    }

    /// The median of the squares of each block of places along the border: the level of the roughness.
    fn medians(&self, squares: &[f32]) -> Vec<f32> {
        let across = self.across;
        (0..across)
            .step_by(BAND)
            .map(|first| {
                let mut values = Vec::with_capacity(STRIP * BAND / 6);
                // a sixth of them gives the same estimate
                for rise in (0..STRIP).step_by(2) {
                    let within = across.saturating_sub(rise).min(first + BAND);
                    let places = (first..within).step_by(3);
                    values.extend(places.map(|from| squares[rise * across + from]));
                }
                let middle = values.len() / 2;
                if values.is_empty() {
                    0.0
                } else {
                    *values.select_nth_unstable_by(middle, f32::total_cmp).1
                }
            })
            .collect()
    }

    fn candidates(&self) -> Vec<Candidate> {
        let across = self.across;
        let squares = self.squares();
        let medians = self.medians(&squares);
        let length = STRIP as f32;
        let least = (MIN_CONTRAST * length).powi(2);
        let mut found = Vec::new();
        for rise in 0..STRIP {
            for from in 0..across {
                let (value, median) = (squares[rise * across + from], medians[from / BAND]);
                if value < least
                    || value < MIN_ABOVE_MEDIAN * median
                    || !is_peak(&squares, across, rise, from)
                {
                    continue;
                }
                let slope = rise as f64 / (STRIP - 1) as f64;
                let step = [0, 1, 2].map(|c| self.sum(c, rise, from) / length);
                // the sums have their places at the middles of pixels along
                let (from, slope) = if self.falling {
                    (from as f64 + slope * (STRIP as f64 - 0.5), -slope)
                } else {
                    (from as f64 - 0.5 * slope, slope)
                };
                found.push(Candidate {
                    first: self.first,
                    from,
                    slope,
                    step,
                    noise: median.sqrt() / length,
                });
            }
        }
        found
    }
}

/// The sums over all lines of half a strip, which the columns of `differences` make up.
fn half_sums(differences: &[f32], across: usize, falling: bool) -> Vec<f32> {
    let mut sums = vec![0.0; HALF * across];
    for (index, column) in differences.chunks_exact(across).enumerate() {
        let index = if falling { HALF - 1 - index } else { index };
        sums[index * across..][..across].copy_from_slice(column);
    }
    let mut next = vec![0.0; HALF * across];
    let mut length = 1;
    while length < HALF {
        for (pair, out) in sums
            .chunks_exact(2 * length * across)
            .zip(next.chunks_exact_mut(2 * length * across))
        {
            let (left, right) = pair.split_at(length * across);
            for (rise, out) in out.chunks_exact_mut(across).enumerate() {
                let shift = rise.div_ceil(2).min(across);
                let [left, right] = [left, right].map(|part| &part[rise / 2 * across..][..across]);
                let (both, only) = out.split_at_mut(across - shift);
                for ((out, left), right) in both.iter_mut().zip(left).zip(&right[shift..]) {
                    *out = left + right;
                }
                only.copy_from_slice(&left[across - shift..]);
            }
        }
        std::mem::swap(&mut sums, &mut next);
        length *= 2;
    }
    sums
}

/// Returns `true` if a value is the largest around; of equal ones the last is.
fn is_peak(squares: &[f32], across: usize, rise: usize, from: usize) -> bool {
    let value = squares[rise * across + from];
    let rises = rise.saturating_sub(PEAK)..=(rise + PEAK).min(STRIP - 1);
    let places = from.saturating_sub(PEAK)..=(from + PEAK).min(across - 1);
    rises.clone().all(|r| {
        places.clone().all(|f| {
            let other = squares[r * across + f];
            other < value || (other == value && (r, f) <= (rise, from))
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use ravec_raster::{LinearRgb, Size};
    use ravec_scenes::edge::{EdgeTruth, TwoColors, edge};

    /// Displacement across of a line of the sums at position `at` along.
    fn moved(rise: usize, at: usize, length: usize) -> usize {
        let half = length / 2;
        if length == 1 {
            0
        } else if at < half {
            moved(rise / 2, at, half)
        } else {
            rise.div_ceil(2) + moved(rise / 2, at - half, half)
        }
    }

    #[test]
    fn lines_of_the_sums_are_nearly_straight() {
        for rise in 0..STRIP {
            for at in 0..STRIP {
                let straight = (rise * at) as f64 / (STRIP - 1) as f64;
                let away = (moved(rise, at, STRIP) as f64 - straight).abs();
                // half a pixel from rounding at each of some lengths
                assert!(away < 1.6, "rise {rise}, {at} along: {away}");
            }
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(16))]
        #[test]
        fn sums_are_those_along_lines(
            across in 8usize..90,
            first in 0usize..3,
            falling: bool,
            values in prop::collection::vec(-4i8..5, 97),
        ) {
            let differences = [0, 1, 2].map(|c| {
                let value = |k: usize| f32::from(values[(k * (c + 7)) % 97]);
                (0..(STRIP + 2) * across).map(value).collect::<Vec<f32>>()
            });
            let sums = Sums::new(&differences, across, first, falling);
            for (channel, differences) in differences.iter().enumerate() {
                for rise in (0..STRIP).step_by(5) {
                    for from in 0..across {
                        let value = |at: usize| {
                            let column = first + if falling { STRIP - 1 - at } else { at };
                            let v = from + moved(rise, at, STRIP);
                            if v < across { differences[column * across + v] } else { 0.0 }
                        };
                        // whole numbers have no rounding
                        let plain: f32 = (0..STRIP).map(value).sum();
                        prop_assert_eq!(sums.sum(channel, rise, from), plain);
                    }
                }
            }
        }
    }

    #[test]
    fn the_strongest_candidate_of_each_strip_is_the_planted_edge() {
        for degrees in [60, 75, 90, 105, 120] {
            let through = dvec2(128.2, 100.4);
            let colors = TwoColors::gray_step(128.0, 64.0);
            let truth = EdgeTruth::from_angle(f64::from(degrees).to_radians(), through, colors);
            let drawn: Image<LinearRgb> = edge(Size::new(256, 300).unwrap(), &truth);
            let frame = Frame::new(&drawn.convert::<Oklab>(), false);
            let found = frame.candidates();
            let normal = DVec2::from_angle(f64::from(degrees).to_radians());
            for first in (0..=192).step_by(HALF) {
                let strip = found.iter().filter(|candidate| candidate.first == first);
                let best = strip.max_by(|a, b| a.contrast().total_cmp(&b.contrast()));
                let best = *best.unwrap_or_else(|| panic!("{degrees}: none from {first} on"));
                for along in [0.0, 32.0, 64.0] {
                    let away = (frame.point_on(&best, along) - through).dot(normal).abs();
                    // the lines of the sums are that far from straight ones
                    assert!(away < 1.6, "{degrees}, {along} after {first}: {away}");
                }
            }
        }
    }
}

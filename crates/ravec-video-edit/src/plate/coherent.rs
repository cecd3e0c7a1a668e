//! Modes that belong together in time.
//!
//! Where something stands for about half of a shot, the most frequent color of one pixel is that of the thing, that of the next one the
//! background. In each connected region of such pixels, frames that agree with the plate in many of its pixels therefore count more in
//! all of them:
//!
//! ```text
//! repeat: each pixel takes the mode whose frames have the largest sum of weights
//!         the weight of a frame is the share of the pixels whose mode it shows, to a power
//! ```

use super::modes::Samples;
use ravec_raster::{Image, Plane};
use rayon::prelude::*;

/// Share of the samples at the densest mode below which another mode may be meant.
const AMBIGUOUS_SHARE: f32 = 0.6;
/// Starts of the search for modes of a pixel.
const STARTS: usize = 12;
/// Rounds of weighting.
const ROUNDS: usize = 6;
/// Power of the share of a frame: larger lets few frames decide.
const POWER: i32 = 3;

/// A mode and the frames that show it.
struct Candidate {
    color: [f32; 3],
    frames: Vec<u16>,
}

/// Replaces the modes of ambiguous pixels. `share` is that of the samples at the mode; `samples` gives those of a pixel.
pub(crate) fn make_coherent(
    modes: &mut Image<[f32; 4]>,
    share: &Plane,
    radius: f32,
    samples: &(impl Fn(usize, usize) -> Samples + Sync),
) {
    let ambiguous = |(col, row): (usize, usize)| {
        modes[(col, row)][3] > 0.0 && share[(col, row)] < AMBIGUOUS_SHARE
    };
    let regions = regions(share, &ambiguous);
    let chosen: Vec<_> = regions
        .par_iter()
        .flat_map_iter(|region| {
            let candidates: Vec<Vec<Candidate>> = region
                .par_iter()
                .map(|&(col, row)| candidates(&samples(col, row), radius))
                .collect();
            region.iter().copied().zip(selected(candidates))
        })
        .collect();
    for (at, [r, g, b]) in chosen {
        modes[at] = [r, g, b, 1.0];
    }
}

/// Connected regions of pixels.
fn regions(share: &Plane, member: &impl Fn((usize, usize)) -> bool) -> Vec<Vec<(usize, usize)>> {
    let (width, height) = (share.width(), share.height());
    let mut reached: Image<u8> = Image::new(share.size(), 0);
    let mut regions = Vec::new();
    for start in (0..height).flat_map(|row| (0..width).map(move |col| (col, row))) {
        let mut region = Vec::new();
        let mut open = vec![start];
        while let Some((col, row)) = open.pop() {
            if reached[(col, row)] == 1 || !member((col, row)) {
                continue;
            }
            reached[(col, row)] = 1;
            region.push((col, row));
            for r in row.saturating_sub(1)..(row + 2).min(height) {
                open.extend((col.saturating_sub(1)..(col + 2).min(width)).map(|c| (c, r)));
            }
        }
        if !region.is_empty() {
            regions.push(region);
        }
    }
    regions
}

fn candidates(samples: &Samples, radius: f32) -> Vec<Candidate> {
    let modes = samples.modes(radius, STARTS);
    let near = |color| Candidate {
        color,
        frames: samples.frames_near(color, radius),
    };
    modes.into_iter().map(|mode| near(mode.color)).collect()
}

/// The color of each pixel.
fn selected(candidates: Vec<Vec<Candidate>>) -> Vec<[f32; 3]> {
    let frames = candidates.iter().flatten().flat_map(|one| &one.frames);
    let count = frames.max().map_or(0, |&last| usize::from(last) + 1);
    let mut weights = vec![1.0f32; count];
    let mut choice = vec![0; candidates.len()];
    for _ in 0..ROUNDS {
        for (choice, candidates) in choice.iter_mut().zip(&candidates) {
            let weight = |one: &Candidate| -> f32 {
                one.frames.iter().map(|&at| weights[usize::from(at)]).sum()
            };
            let best = candidates.iter().map(weight).enumerate();
            // the first of equals
            *choice = best
                .fold(
                    (0, f32::MIN),
                    |best, one| if one.1 > best.1 { one } else { best },
                )
                .0;
        }
        weights.fill(0.0);
        for (choice, candidates) in choice.iter().zip(&candidates) {
            for &frame in candidates.get(*choice).map_or(&[][..], |one| &one.frames) {
                weights[usize::from(frame)] += 1.0;
            }
        }
        for weight in &mut weights {
            *weight = (*weight / candidates.len() as f32).powi(POWER);
        }
    }
    let color = |(choice, candidates): (usize, Vec<Candidate>)| {
        candidates.get(choice).map_or([0.0; 3], |one| one.color)
    };
    choice.into_iter().zip(candidates).map(color).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_frames_of_the_majority_decide_for_all_pixels() {
        // frames 0 to 5 show a thing, frames 6 to 10 the background; noise in time lets some pixels see it shorter
        let pixel = |thing: std::ops::Range<u16>, background: std::ops::Range<u16>| {
            vec![
                Candidate {
                    color: [1.0; 3],
                    frames: thing.collect(),
                },
                Candidate {
                    color: [0.0; 3],
                    frames: background.collect(),
                },
            ]
        };
        let mut candidates: Vec<_> = (0..20).map(|_| pixel(0..6, 6..11)).collect();
        candidates.extend((0..6).map(|_| pixel(2..6, 6..11)));
        let found = selected(candidates);
        assert!(found.iter().all(|color| color[0] == 1.0));
        assert!(selected(Vec::new()).is_empty());
    }
}

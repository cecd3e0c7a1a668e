//! Grain: the noise of a frame, moved to where the frame has none.
//!
//! Blocks of the difference between the frame and its background, taken from places without foreground, keep the strength, the color
//! and the correlation of the noise, that of compression included.

use crate::Colors;
use ravec_raster::{Image, Plane};

/// Side of a block, in pixels.
const BLOCK_PX: usize = 12;
/// Places that are tried for a block.
const TRIES: u64 = 48;
/// Standard deviations at which a difference is no noise but an edge that does not fit.
const LIMIT: f32 = 3.5;

/// Factor of the grain. The plate has noise of its own, that of a mean of some frames, which is in the difference to the frame and
/// under the grain as well: this factor is right for a mean of eight.
const OVER_NOISE: f32 = 0.88;

/// Noise for the pixels in which `needed` is above 0; 0 elsewhere.
///
/// Blocks come from places in which `needed` is 0 and `known` is above 0. `frame_number` selects them, so that grain moves from frame
/// to frame as noise does, and the same frame has the same grain in every run.
pub(crate) fn grain(
    frame: &Colors,
    background: &Colors,
    needed: &Plane,
    known: &Plane,
    frame_number: u64,
) -> Colors {
    let size = frame.size();
    let free = |col: usize, row: usize| needed[(col, row)] <= 0.0 && known[(col, row)] > 0.99;
    let sigma = deviations(frame, background, &free);
    let mut grain = Colors::new(size, [0.0; 3]);
    grain.for_each_row(|row, grain| {
        let mut source: Option<(usize, Option<(usize, usize)>)> = None;
        for (col, grain) in grain.iter_mut().enumerate() {
            if needed[(col, row)] <= 0.0 {
                continue;
            }
            let block = (col / BLOCK_PX, row / BLOCK_PX);
            let corner = match source {
                Some((number, corner)) if number == block.0 => corner,
                _ => {
                    let corner = block_source(block, frame_number, needed, &free);
                    source = Some((block.0, corner));
                    corner
                }
            };
            let Some(corner) = corner else { continue };
            let at = (corner.0 + col % BLOCK_PX, corner.1 + row % BLOCK_PX);
            let (shown, behind) = (frame[at], background[at]);
            *grain = [0, 1, 2].map(|c| {
                let limit = LIMIT * sigma[c];
                OVER_NOISE * (shown[c] - behind[c]).clamp(-limit, limit)
            });
        }
    });
    grain
}

/// Upper left corner of the pixels whose noise a block gets.
fn block_source(
    block: (usize, usize),
    frame_number: u64,
    needed: &Plane,
    free: &(impl Fn(usize, usize) -> bool + Sync),
) -> Option<(usize, usize)> {
    let columns = needed.width().checked_sub(BLOCK_PX)? as u64 + 1;
    let rows = needed.height().checked_sub(BLOCK_PX)? as u64 + 1;
    let seed = mixed(frame_number ^ mixed((block.0 as u64) << 32 | block.1 as u64));
    (0..TRIES).find_map(|attempt| {
        let number = mixed(seed.wrapping_add(attempt));
        let corner = (
            (number % columns) as usize,
            (number / columns % rows) as usize,
        );
        let last = BLOCK_PX - 1;
        let places = [
            (0, 0),
            (last, 0),
            (0, last),
            (last, last),
            (last / 2, last / 2),
        ];
        places
            .iter()
            .all(|(x, y)| free(corner.0 + x, corner.1 + y))
            .then_some(corner)
    })
}

/// A number that looks random (the finalizer of `SplitMix64`: Steele et al., *Fast splittable pseudorandom number generators*, 2014).
fn mixed(value: u64) -> u64 {
    let mut z = value.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// Robust standard deviation of the difference in each channel.
fn deviations(
    frame: &Colors,
    background: &Colors,
    free: &impl Fn(usize, usize) -> bool,
) -> [f32; 3] {
    let step = (frame.size().pixels() / 20_000).isqrt().max(1);
    let mut sizes = [Vec::new(), Vec::new(), Vec::new()];
    for row in (0..frame.height()).step_by(step) {
        for col in (0..frame.width()).step_by(step) {
            if free(col, row) {
                for (c, sizes) in sizes.iter_mut().enumerate() {
                    sizes.push((frame[(col, row)][c] - background[(col, row)][c]).abs());
                }
            }
        }
    }
    sizes.map(|sizes| 1.4826 * crate::exposure::median(sizes))
}

/// Adds grain with a weight.
pub(crate) fn with_grain(colors: &Colors, grain: &Colors, weight: &Plane) -> Colors {
    Image::from_fn(colors.size(), |col, row| {
        let at = (col, row);
        [0, 1, 2].map(|c| colors[at][c] + weight[at] * grain[at][c])
    })
}

//! Tiles through which an edge runs.
//!
//! A tile is reduced to 8 × 8 pixels, and these are replaced by a line and the colors on its two sides (see `ravec-twocolor`).
//! If the colors differ and hardly anything is left over, the tile is a *feature*: there the eye looks for structure, where in
//! others it is content with color.
//!
//! Source: Pavić, v. Ceumern, Kobbelt, "`GIzMOs`: Genuine Image Mosaics with Adaptive Tiling", 2009.

use crate::descriptor::{Frame, parts};
use crate::tiling::Tiling;
use ravec_progress::{Cancelled, Progress};
use ravec_raster::{Image, Oklab, Size};
use ravec_twocolor::{FitError, FitParams, TwoColorField};
use rayon::prelude::*;

/// The side of a reduced tile, in pixels.
const SIDE: usize = 8;

/// Tiles that are fitted in one row.
const IN_A_ROW: usize = 64;

/// The Oklab distance of the two colors from which on an edge is one: a third of that of black and mid gray.
const CONTRAST: f32 = 0.15;

/// The share of the variance that may be left over. A ramp leaves a quarter of its own, an edge that is smeared over two of
/// the eight pixels a tenth.
const REST: f32 = 0.15;

/// Marks the tiles of a frame of the picture through which an edge runs, and returns their number.
///
/// # Errors
/// [`Cancelled`] soon after `progress` is cancelled.
pub fn mark_features(
    picture: &Image<Oklab>,
    frame: Frame,
    tiling: &mut Tiling,
    progress: &Progress,
) -> Result<usize, Cancelled> {
    let count = tiling.tiles.len();
    let Ok(size) = Size::new(SIDE * IN_A_ROW, SIDE * count.div_ceil(IN_A_ROW)) else {
        return Ok(0);
    };
    let phase = progress.phase("edges", count as u64);
    let blocks: Vec<Vec<[f32; 3]>> = tiling
        .tiles
        .par_iter()
        .map(|tile| {
            progress.check()?;
            phase.advance(1);
            Ok(parts(picture, tiling.part(frame, tile), SIDE))
        })
        .collect::<Result<_, Cancelled>>()?;
    let reduced = Image::from_fn(size, |col, row| {
        let block = blocks.get(row / SIDE * IN_A_ROW + col / SIDE);
        let pixel = |block: &Vec<[f32; 3]>| Oklab(block[row % SIDE * SIDE + col % SIDE]);
        block.map_or(Oklab::default(), pixel)
    });
    let params = FitParams {
        block_px: SIDE,
        ..FitParams::default()
    };
    let field = match TwoColorField::fit(&reduced, &params, progress) {
        Ok(field) => field,
        Err(FitError::Cancelled(cancelled)) => return Err(cancelled),
        Err(error) => unreachable!("blocks of {SIDE} pixels can be fitted: {error}"),
    };
    let mut features = 0;
    for (at, (tile, block)) in tiling.tiles.iter_mut().zip(&blocks).enumerate() {
        let fit = field.block(at % IN_A_ROW, at / IN_A_ROW);
        tile.feature = fit.contrast() >= CONTRAST && fit.error <= REST * variance(block);
        features += usize::from(tile.feature);
    }
    Ok(features)
}

/// The mean squared distance from the mean color.
fn variance(block: &[[f32; 3]]) -> f32 {
    let share = 1.0 / block.len() as f32;
    let mean = [0, 1, 2].map(|i| block.iter().map(|pixel| pixel[i] * share).sum::<f32>());
    let apart = |pixel: &[f32; 3]| [0, 1, 2].map(|i| (pixel[i] - mean[i]).powi(2) * share);
    block.iter().flat_map(apart).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tiling::grid_tiles;

    #[test]
    fn an_edge_is_a_feature_and_flat_ground_a_ramp_and_noise_are_none() {
        // 4 tiles of 16 pixels: flat, a slanted edge, a ramp, a checkerboard
        let picture = Image::from_fn(Size::new(64, 16).unwrap(), |col, row| {
            let x = col % 16;
            let light = match col / 16 {
                0 => 0.5,
                1 => 0.3 + 0.4 * f32::from(u8::from(2 * x + row > 24)),
                2 => 0.2 + 0.04 * x as f32,
                _ => 0.3 + 0.4 * ((x / 2 + row / 2) % 2) as f32,
            };
            Oklab([light, 0.0, 0.0])
        });
        let frame = Frame::of(&picture);
        let progress = Progress::none();
        let mut tiling = grid_tiles(&picture, frame, 4, 1, 1, &progress).unwrap();
        assert_eq!(
            mark_features(&picture, frame, &mut tiling, &progress),
            Ok(1)
        );
        let marked: Vec<bool> = tiling.tiles.iter().map(|tile| tile.feature).collect();
        assert_eq!(marked, [false, true, false, false]);
    }
}

//! Pictures that were drawn, not taken: text, line art, screenshots, pixel art.
//!
//! Their noise is 0, but their strokes fill all frequencies of a block as noise does. What tells them from photos is that
//! areas of one color have exactly this color: noise of half a step or more spreads each color over its neighbors. So a
//! color is an *ink* if it is frequent and colors near to it are rare, and a picture is drawn if nearly all of it is inks
//! and the pixels of smoothed edges beside them.
//!
//! Non-guarantee: a noisy picture with so few levels that none lies near another one counts as drawn.

use super::strip::encoded;
use crate::pixel::is_countable;
use ravec_progress::{Cancelled, Progress};
use ravec_raster::{LinearRgba, LinearRows, Size};
use rayon::prelude::*;

/// Side of the tiles that are examined, and the most of them.
const TILE: usize = 32;
const MAX_TILES: usize = 512;

/// The share of the pixels that a color must have to be an ink.
const MIN_INK: f64 = 0.01;

/// Largest difference of a channel, in 8-bit steps, of colors near to an ink.
const NEAR: i32 = 8;

/// An ink must be more frequent than the colors near to it together by this factor. Noise of half a step reaches 2, and
/// of one step that is clipped at white 2.2.
const MIN_EXCESS: usize = 3;

/// The share of the pixels that are inks in a drawn picture, at least.
const MIN_INKED: f64 = 0.2;

/// The share of the other pixels that do not touch an ink, at most.
const MAX_APART: f64 = 0.25;

/// The 8-bit color of a pixel, or that of none that can be seen.
const HIDDEN: u32 = u32::MAX;

fn key(pixel: LinearRgba) -> u32 {
    if pixel.alpha() <= 0.0 || !is_countable(pixel) {
        return HIDDEN;
    }
    encoded(pixel.rgb()).iter().fold(0, |key, value| {
        (key << 8) | (255.0 * value.clamp(0.0, 1.0) + 0.5) as u32
    })
}

fn channels(key: u32) -> [i32; 3] {
    [16, 8, 0].map(|shift| (key >> shift & 255) as i32)
}

/// Returns `true` if the picture consists of areas of one color each and of the edges between them.
///
/// # Errors
/// [`Cancelled`] soon after `progress` is.
pub(super) fn is_drawn(image: &dyn LinearRows, progress: &Progress) -> Result<bool, Cancelled> {
    let tiles = tiles(image.size());
    let mut keys: Vec<u32> = tiles
        .par_iter()
        .map(|&tile| {
            progress.check()?;
            Ok(inner(&Tile::read(image, tile)))
        })
        .collect::<Result<Vec<Vec<u32>>, Cancelled>>()?
        .concat();
    keys.par_sort_unstable();
    let inks = inks(&keys);
    let visible = keys.iter().filter(|&&key| key != HIDDEN).count();
    let is_ink = |key: &u32| inks.binary_search(key).is_ok();
    let inked = keys.iter().filter(|key| is_ink(key)).count();
    if inks.is_empty() || (inked as f64) < MIN_INKED * visible as f64 {
        return Ok(false);
    }
    let apart: usize = tiles
        .par_iter()
        .map(|&tile| {
            progress.check()?;
            Ok(Tile::read(image, tile).apart(&inks))
        })
        .collect::<Result<Vec<usize>, Cancelled>>()?
        .iter()
        .sum();
    Ok(apart as f64 <= MAX_APART * (visible - inked) as f64)
}

/// Corners of the tiles: all of them, or as many as are examined, evenly spread.
fn tiles(size: Size) -> Vec<[usize; 2]> {
    let [columns, rows] = [size.width().div_ceil(TILE), size.height().div_ceil(TILE)];
    let step = (columns * rows).div_ceil(MAX_TILES);
    (0..MAX_TILES)
        // a shift from one to the next, so that the tiles of neighboring rows do not stand in columns
        .map(|i| i * step + i * 7 % step)
        .take_while(|&tile| tile < columns * rows)
        .map(|tile| [tile % columns * TILE, tile / columns * TILE])
        .collect()
}

/// The colors of a tile with the pixels around it.
struct Tile {
    /// Row by row.
    keys: Vec<u32>,
    width: usize,
    /// The pixels of the tile itself: the first column and row and those after the last, in `keys`.
    inner: [[usize; 2]; 2],
}

impl Tile {
    fn read(image: &dyn LinearRows, [col, row]: [usize; 2]) -> Self {
        let size = image.size();
        let [right, bottom] = [
            (col + TILE).min(size.width()),
            (row + TILE).min(size.height()),
        ];
        let [left, top] = [col.saturating_sub(1), row.saturating_sub(1)];
        let width = (right + 1).min(size.width()) - left;
        let mut run = vec![LinearRgba::default(); width];
        let mut keys = Vec::with_capacity(width * (TILE + 2));
        for y in top..(bottom + 1).min(size.height()) {
            image.read_linear(y, left, &mut run);
            keys.extend(run.iter().map(|&pixel| key(pixel)));
        }
        Self {
            keys,
            width,
            inner: [[col - left, row - top], [right - left, bottom - top]],
        }
    }

    /// Number of visible pixels that are no ink and touch none.
    fn apart(&self, inks: &[u32]) -> usize {
        let is_ink: Vec<bool> = self
            .keys
            .iter()
            .map(|key| inks.binary_search(key).is_ok())
            .collect();
        let [[left, top], [right, bottom]] = self.inner;
        let height = self.keys.len() / self.width;
        let touches = |x: usize, y: usize| {
            (y.saturating_sub(1)..(y + 2).min(height)).any(|y| {
                is_ink[y * self.width..][x.saturating_sub(1)..(x + 2).min(self.width)]
                    .contains(&true)
            })
        };
        (top..bottom)
            .flat_map(|y| (left..right).map(move |x| (x, y)))
            .filter(|&(x, y)| self.keys[y * self.width + x] != HIDDEN && !touches(x, y))
            .count()
    }
}

/// The colors of the pixels of the tile itself.
fn inner(tile: &Tile) -> Vec<u32> {
    let [[left, top], [right, bottom]] = tile.inner;
    (top..bottom)
        .flat_map(|y| &tile.keys[y * tile.width..][left..right])
        .copied()
        .collect()
}

/// The inks among sorted colors, sorted.
fn inks(sorted: &[u32]) -> Vec<u32> {
    let counts: Vec<(u32, usize)> = sorted
        .chunk_by(|a, b| a == b)
        .map(|run| (run[0], run.len()))
        .filter(|&(key, _)| key != HIDDEN)
        .collect();
    let visible: usize = counts.iter().map(|(_, count)| count).sum();
    let least = (MIN_INK * visible as f64).max(4.0);
    counts
        .iter()
        .filter(|&&(key, count)| count as f64 >= least && count > MIN_EXCESS * near(key, &counts))
        .map(|&(key, _)| key)
        .collect()
}

/// Number of pixels whose color is near to `key`, but another one.
fn near(key: u32, counts: &[(u32, usize)]) -> usize {
    let ink = channels(key);
    counts
        .iter()
        .filter(|&&(other, _)| {
            let other = channels(other);
            (0..3).all(|c| (other[c] - ink[c]).abs() <= NEAR)
        })
        .map(|(_, count)| count)
        .sum::<usize>()
        .saturating_sub(
            counts
                .iter()
                .find(|other| other.0 == key)
                .map_or(0, |own| own.1),
        )
}

#[cfg(test)]
mod tests {
    use super::*;
    use ravec_raster::{Image, Sample as _, Srgb};

    fn drawn(image: &Image<Srgb<u8>>) -> bool {
        is_drawn(image, &Progress::none()).unwrap()
    }

    /// Disks and bars with smooth edges, of ink 0 on paper 1.
    fn line_art(width: usize, height: usize) -> Image<f32> {
        Image::from_fn(Size::new(width, height).unwrap(), |col, row| {
            let (x, y) = (col as f32 % 23.0 - 11.0, row as f32 % 19.0 - 9.0);
            let ring = ((x * x + y * y).sqrt() - 6.0).abs() - 1.0;
            ring.min((x + 0.4 * y).abs() - 0.7).clamp(0.0, 1.0)
        })
    }

    fn mixed(art: &Image<f32>, ink: [f32; 3], paper: [f32; 3], noise: f32) -> Image<Srgb<u8>> {
        let mut state = 1u32;
        // the sum of four even numbers is nearly normal
        let mut even = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 24) as f32 - 0.5
        };
        Image::from_fn(art.size(), |col, row| {
            let error = (even() + even() + even() + even()) * 1.732 * noise;
            let share = art[(col, row)];
            let color = std::array::from_fn(|c| ink[c] + share * (paper[c] - ink[c]) + error);
            Srgb(color.map(|v: f32| u8::from_unit(v / 255.0)))
        })
    }

    #[test]
    fn line_art_in_any_colors_is_drawn() {
        for (width, height) in [(64, 64), (400, 300), (2000, 40)] {
            let art = line_art(width, height);
            for (ink, paper) in [
                ([0.0; 3], [255.0; 3]),
                ([40.0; 3], [245.0, 244.0, 240.0]),
                ([230.0, 60.0, 60.0], [20.0, 30.0, 90.0]),
            ] {
                assert!(drawn(&mixed(&art, ink, paper, 0.0)), "{width} {ink:?}");
            }
        }
    }

    #[test]
    fn line_art_with_noise_is_not_drawn() {
        let art = line_art(300, 200);
        for noise in [0.8, 2.0, 10.0] {
            assert!(
                !drawn(&mixed(&art, [30.0; 3], [225.0; 3], noise)),
                "{noise}"
            );
        }
        // clipped at both ends
        for noise in [2.0, 10.0] {
            assert!(!drawn(&mixed(&art, [0.0; 3], [255.0; 3], noise)), "{noise}");
        }
    }

    #[test]
    fn a_smooth_picture_with_a_large_blank_area_is_not_drawn() {
        let image = Image::from_fn(Size::new(300, 200).unwrap(), |col, row| {
            if row < 120 {
                return Srgb([255u8; 3]);
            }
            let wave = 90.0 + 50.0 * (0.07 * col as f32).sin() + 30.0 * (0.11 * row as f32).cos();
            Srgb([wave as u8, (wave + 9.0) as u8, (wave * 0.8) as u8])
        });
        assert!(!drawn(&image));
    }
}

//! A picture in all sizes, cut into square pieces, from strips that come from top to bottom.
//!
//! The finest level is the picture; each coarser one has half as many pixels on a side, rounded up, down to a single one. Each
//! pixel is the mean of the two by two below it, in linear light; at a border of odd length, of those that are there.
//!
//! Memory: a row of pieces for each level, together twice those of the finest.

use crate::thumbnail::encoded;
use ravec_raster::color::linear_from_srgb;
use ravec_raster::{Image, Size, Srgb};
use rayon::prelude::*;
use std::sync::LazyLock;

/// The side of a piece, in pixels: what viewers of Deep Zoom expect. An even number, so that halves of whole rows of pieces
/// are whole rows of pixels.
pub(crate) const PIECE_PX: usize = 256;

/// A piece of a level: columns and rows count pieces.
pub(crate) struct Piece {
    pub level: usize,
    pub col: usize,
    pub row: usize,
    pub image: Image<Srgb<u8>>,
}

/// The levels of a picture, the coarsest first.
pub(crate) struct Pyramid {
    levels: Vec<Level>,
}

struct Level {
    width: usize,
    height: usize,
    /// Rows that came.
    rows: usize,
    /// Rows that are not in pieces yet.
    strip: Vec<Srgb<u8>>,
}

impl Pyramid {
    pub fn new(size: Size) -> Self {
        let (mut width, mut height) = (size.width(), size.height());
        let mut levels = Vec::new();
        loop {
            levels.push(Level {
                width,
                height,
                rows: 0,
                strip: Vec::new(),
            });
            if width == 1 && height == 1 {
                break;
            }
            (width, height) = (width.div_ceil(2), height.div_ceil(2));
        }
        levels.reverse();
        Self { levels }
    }

    /// Pieces of all levels of a picture of `size`.
    pub fn pieces(size: Size) -> usize {
        let across = |pixels: usize| pixels.div_ceil(PIECE_PX);
        let levels = Self::new(size).levels;
        let pieces = levels
            .iter()
            .map(|level| across(level.width) * across(level.height));
        pieces.sum()
    }

    /// Number of levels.
    pub fn levels(&self) -> usize {
        self.levels.len()
    }

    /// Takes the next rows of the picture, and hands out the pieces that are complete, of all levels.
    pub fn push<E: Send>(
        &mut self,
        pixels: &[Srgb<u8>],
        put: &(impl Fn(Piece) -> Result<(), E> + Sync),
    ) -> Result<(), E> {
        self.push_to(self.levels.len() - 1, pixels, put)
    }

    fn push_to<E: Send>(
        &mut self,
        level: usize,
        mut pixels: &[Srgb<u8>],
        put: &(impl Fn(Piece) -> Result<(), E> + Sync),
    ) -> Result<(), E> {
        while !pixels.is_empty() {
            let Level {
                width,
                height,
                rows,
                strip,
            } = &mut self.levels[level];
            let missing = PIECE_PX * *width - strip.len();
            let (now, later) = pixels.split_at(missing.min(pixels.len()));
            strip.extend_from_slice(now);
            *rows += now.len() / *width;
            pixels = later;
            if strip.len() < PIECE_PX * *width && *rows < *height {
                continue;
            }
            let (width, row) = (*width, (*rows - 1) / PIECE_PX);
            let mut strip = std::mem::take(strip);
            pieces(level, row, width, &strip, put)?;
            if level > 0 {
                self.push_to(level - 1, &halved(&strip, width), put)?;
            }
            strip.clear();
            self.levels[level].strip = strip;
        }
        Ok(())
    }
}

/// Hands out the pieces of a strip, in parallel.
fn pieces<E: Send>(
    level: usize,
    row: usize,
    width: usize,
    strip: &[Srgb<u8>],
    put: &(impl Fn(Piece) -> Result<(), E> + Sync),
) -> Result<(), E> {
    (0..width.div_ceil(PIECE_PX))
        .into_par_iter()
        .try_for_each(|col| {
            let columns = col * PIECE_PX..((col + 1) * PIECE_PX).min(width);
            let pixels: Vec<Srgb<u8>> = strip
                .chunks_exact(width)
                .flat_map(|line| &line[columns.clone()])
                .copied()
                .collect();
            let image = Image::from_vec(columns.len(), pixels)
                .expect("a strip has whole rows and at least one");
            put(Piece {
                level,
                col,
                row,
                image,
            })
        })
}

/// Linear light of encoded values.
static LIGHT: LazyLock<[f32; 256]> =
    LazyLock::new(|| std::array::from_fn(|value| linear_from_srgb(value as f32 / 255.0)));

/// Rows of pixels at half their size, rounded up.
fn halved(strip: &[Srgb<u8>], width: usize) -> Vec<Srgb<u8>> {
    let half = width.div_ceil(2);
    let mut result = vec![Srgb([0; 3]); strip.len().div_ceil(2 * width) * half];
    result
        .par_chunks_exact_mut(half)
        .zip(strip.par_chunks(2 * width))
        .for_each(|(line, both)| {
            let (upper, lower) = both.split_at(width);
            // an odd last row is its own neighbor, and so is an odd last column
            let lower = if lower.is_empty() { upper } else { lower };
            for (col, pixel) in line.iter_mut().enumerate() {
                let (a, b) = (2 * col, (2 * col + 1).min(width - 1));
                let light = |pixel: Srgb<u8>, i: usize| LIGHT[usize::from(pixel.0[i])];
                *pixel = Srgb([0, 1, 2].map(|i| {
                    let sum = light(upper[a], i)
                        + light(upper[b], i)
                        + light(lower[a], i)
                        + light(lower[b], i);
                    encoded(sum / 4.0)
                }));
            }
        });
    result
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::convert::Infallible;
    use std::sync::Mutex;

    fn picture(width: usize, height: usize) -> Vec<Srgb<u8>> {
        (0..width * height)
            .map(|at| {
                let (col, row) = (at % width, at / width);
                Srgb([col as u8, row as u8, (col * row / 7) as u8])
            })
            .collect()
    }

    /// All levels, put together from their pieces.
    fn levels(width: usize, height: usize, rows_at_once: usize) -> Vec<Image<Srgb<u8>>> {
        let mut pyramid = Pyramid::new(Size::new(width, height).unwrap());
        let pieces = Mutex::new(Vec::new());
        for rows in picture(width, height).chunks(rows_at_once * width) {
            let put = |piece: Piece| {
                pieces.lock().unwrap().push(piece);
                Ok::<(), Infallible>(())
            };
            pyramid.push(rows, &put).unwrap();
        }
        let pieces = pieces.into_inner().unwrap();
        (0..pyramid.levels())
            .map(|number| {
                let Level { width, height, .. } = pyramid.levels[number];
                let mut seen = vec![0; width * height];
                let mut whole = vec![Srgb([0; 3]); width * height];
                for piece in pieces.iter().filter(|piece| piece.level == number) {
                    for (dy, line) in piece.image.rows().enumerate() {
                        for (dx, &pixel) in line.iter().enumerate() {
                            let at =
                                (piece.row * PIECE_PX + dy) * width + piece.col * PIECE_PX + dx;
                            seen[at] += 1;
                            whole[at] = pixel;
                        }
                    }
                }
                assert!(seen.iter().all(|&times| times == 1), "level {number}");
                Image::from_vec(width, whole).unwrap()
            })
            .collect()
    }

    #[test]
    fn each_level_is_the_half_of_the_next_however_strips_are_cut() {
        for (width, height) in [(700, 531), (256, 512), (1, 9), (300, 1)] {
            let first = levels(width, height, 33);
            assert_eq!(first.last().unwrap().pixels(), picture(width, height));
            assert_eq!(first[0].size(), Size::new(1, 1).unwrap());
            for pair in first.windows(2) {
                assert_eq!(pair[0].width(), pair[1].width().div_ceil(2));
                assert_eq!(
                    pair[0].pixels(),
                    halved(pair[1].pixels(), pair[1].width()),
                    "{width} x {height}"
                );
            }
            for rows_at_once in [1, 256, 600] {
                assert_eq!(levels(width, height, rows_at_once), first);
            }
        }
    }

    #[test]
    fn halves_are_means_in_linear_light_and_even_colors_stay() {
        for value in 0..=255 {
            assert_eq!(halved(&[Srgb([value; 3]); 9], 3), [Srgb([value; 3]); 4]);
        }
        // half the light of white is 188 of 255
        let mixed = halved(&[Srgb([255; 3]), Srgb([0; 3])], 2);
        assert_eq!(mixed, [Srgb([188; 3])]);
    }
}

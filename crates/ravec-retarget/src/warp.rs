//! A picture in its new shape: each pixel looked up and filtered once.
//!
//! ```text
//! for each tile of the new picture:
//!     find where each of its pixels was, and how many old pixels it sees along x and along y
//!     take the part of the old picture that they see, in linear light and premultiplied
//!     weigh old pixels by the cubic of Catmull and Rom along x and along y, as wide as what is seen, at least a pixel
//! ```
//!
//! Guarantees: every pixel is written once; a picture that does not change comes back bit for bit; constants stay constant to
//! rounding; equal input gives equal bytes on any number of threads. Does not guarantee: no overshoot, a few per cent at hard
//! edges; a filter that turns with what is sheared (cells shear by few degrees).
//! Cost: 16 old pixels a new one where the picture grows, 16 times what is seen where it shrinks. Memory: a tile a thread.

use crate::deformation::Deformation;
use crate::locate::{Locator, Stretch};
use crate::params::RetargetError;
use glam::{DVec2, dvec2};
use ravec_progress::Progress;
use ravec_raster::{Color, Image, LinearRgba, Size};
use rayon::prelude::*;

/// How a picture is filtered.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum WarpFilter {
    /// Bilinear between four pixels, whatever the size: for following a frame that is being dragged, from a picture that was
    /// reduced to the size of the screen.
    Preview,
    /// Sharp where the picture grows, without aliasing where it shrinks.
    #[default]
    Full,
}

/// Rows and columns of a tile where nothing shrinks; it fits into the cache with what it sees.
const TILE: [usize; 2] = [32, 256];

impl Deformation {
    /// The new picture.
    ///
    /// # Errors
    /// [`RetargetError::OtherShape`] if `image` has another size than the analysed one, [`RetargetError::Cancelled`] soon
    /// after `progress` is cancelled.
    pub fn warp<P: Color>(
        &self,
        image: &Image<P>,
        progress: &Progress,
    ) -> Result<Image<P>, RetargetError> {
        if image.size() != self.source_size() {
            return Err(RetargetError::OtherShape {
                got: image.size(),
                analysed: self.source_size(),
            });
        }
        if self.is_identity() {
            return Ok(image.clone());
        }
        self.warp_to(image, self.size(), WarpFilter::Full, progress)
    }

    /// The new picture at another resolution, from an old one at any resolution: `image` is the analysed picture reduced or
    /// enlarged, `size` the size of the result.
    ///
    /// # Errors
    /// [`RetargetError::OtherShape`] if the sides of `image` are not in proportion, by more than a pixel;
    /// [`RetargetError::Cancelled`] soon after `progress` is cancelled.
    pub fn warp_to<P: Color>(
        &self,
        image: &Image<P>,
        size: Size,
        filter: WarpFilter,
        progress: &Progress,
    ) -> Result<Image<P>, RetargetError> {
        let analysed = self.source_size();
        let scaled = |a: usize, b: usize, c: usize| a as f64 * b as f64 / c as f64;
        let height = scaled(image.width(), analysed.height(), analysed.width());
        let width = scaled(image.height(), analysed.width(), analysed.height());
        if (height - image.height() as f64).abs() > 1.0 && (width - image.width() as f64).abs() > 1.0
        {
            return Err(RetargetError::OtherShape {
                got: image.size(),
                analysed,
            });
        }
        let lengths = |size: Size| dvec2(size.width() as f64, size.height() as f64);
        let warp = Warp {
            image,
            locator: Locator::new(self, lengths(size) / lengths(self.size()), size.width()),
            deformation: self,
            source_unit: self.grid.unit_px() * lengths(image.size()) / lengths(analysed),
            filter,
        };
        // where the picture shrinks, a tile sees more
        let shrink = (lengths(image.size()) / lengths(size)).max(DVec2::ONE);
        let rows = (TILE[0] as f64 / shrink.y).ceil() as usize;
        let columns = (TILE[1] as f64 / shrink.x).ceil() as usize;
        let mut result = Image::new(size, image.pixels()[0]);
        let phase = progress.phase("warp", size.height() as u64);
        result.par_strips_mut(rows).enumerate().try_for_each_init(
            Scratch::default,
            |scratch, (index, pixels)| {
                let height = pixels.len() / size.width();
                let strip = warp.strip(index * rows, height);
                for first in (0..size.width()).step_by(columns) {
                    progress.check()?;
                    let end = (first + columns).min(size.width());
                    warp.tile(&strip, [first, end], size.width(), scratch, pixels);
                }
                phase.advance(height as u64);
                Ok::<(), RetargetError>(())
            },
        )?;
        Ok(result)
    }
}

struct Warp<'a, P> {
    image: &'a Image<P>,
    locator: Locator<'a>,
    deformation: &'a Deformation,
    /// Pixels of `image` a unit of the grid.
    source_unit: DVec2,
    filter: WarpFilter,
}

/// Some rows of the new picture: which cells they cross, and where.
struct Strip {
    first_row: usize,
    rows: Vec<Vec<Stretch>>,
}

/// A pixel of the new picture as it looks at the old one.
#[derive(Debug, Clone, Copy)]
struct Look {
    /// Its place in the strip.
    index: u32,
    at: [f64; 2],
    /// How many pixels it sees along x and y, at least 1.
    width: [f32; 2],
}

/// Memory that is used again from tile to tile.
#[derive(Default)]
struct Scratch {
    looks: Vec<Look>,
    /// The part of the old picture that is seen.
    window: Vec<[f32; 4]>,
    weights: [Vec<f32>; 2],
}

impl<P: Color> Warp<'_, P> {
    fn strip(&self, first_row: usize, rows: usize) -> Strip {
        let cells = self.locator.cells_in(first_row, rows);
        let rows = (first_row..first_row + rows).map(|row| {
            let mut stretches = Vec::new();
            self.locator.stretches(row, &cells, &mut stretches);
            stretches
        });
        Strip {
            first_row,
            rows: rows.collect(),
        }
    }

    /// Fills columns `first..end` of a strip.
    fn tile(
        &self,
        strip: &Strip,
        [first, end]: [usize; 2],
        stride: usize,
        scratch: &mut Scratch,
        pixels: &mut [P],
    ) {
        let Scratch {
            looks,
            window,
            weights,
        } = scratch;
        looks.clear();
        for (row, stretches) in strip.rows.iter().enumerate() {
            for stretch in stretches {
                let (from, to) = (stretch.first.max(first), stretch.end.min(end));
                if from < to {
                    let row_start = (row * stride) as u32;
                    let y = (strip.first_row + row) as f64 + 0.5;
                    self.look(stretch.cell, [from, to], y, row_start, looks);
                }
            }
        }
        let Some(part) = Part::seen(looks) else {
            return;
        };
        part.fill(self.image, window);
        for look in looks.iter() {
            let light = match self.filter {
                WarpFilter::Full => part.cubic(window, look, weights),
                WarpFilter::Preview => part.bilinear(window, look),
            };
            pixels[look.index as usize] = P::from_linear(straight::<P>(light));
        }
    }

    /// Where the pixels `from..to` of a row, which lie in one cell, look.
    fn look(
        &self,
        cell: u32,
        [from, to]: [usize; 2],
        y: f64,
        row_start: u32,
        looks: &mut Vec<Look>,
    ) {
        debug_assert!((cell as usize) < self.deformation.grid.cells.len());
        let inverse = self.locator.inverse(cell, self.source_unit);
        let source = |col: usize| inverse.source(dvec2(col as f64 + 0.5, y));
        // what is seen changes little within a cell: along the row it is interpolated
        let (start, stop) = (
            inverse.footprint(source(from)),
            inverse.footprint(source(to - 1)),
        );
        let step = (stop - start) / ((to - from - 1).max(1)) as f64;
        for col in from..to {
            let at = source(col);
            let width = (start + step * (col - from) as f64).max(DVec2::ONE);
            looks.push(Look {
                index: row_start + col as u32,
                at: at.to_array(),
                width: [width.x as f32, width.y as f32],
            });
        }
    }
}

/// Straight alpha from premultiplied.
#[inline(always)]
fn straight<P: Color>([r, g, b, alpha]: [f32; 4]) -> LinearRgba {
    if !P::HAS_ALPHA {
        return LinearRgba([r, g, b, 1.0]);
    }
    let scale = if alpha > 0.0 { 1.0 / alpha } else { 0.0 };
    LinearRgba([r * scale, g * scale, b * scale, alpha.clamp(0.0, 1.0)])
}

/// A part of the old picture, which goes on beyond its borders.
struct Part {
    first: [isize; 2],
    width: usize,
    height: usize,
}

/// The reach of the cubic.
const REACH: f64 = 2.0;

impl Part {
    /// What the looks of a tile see; nothing if there are none.
    fn seen(looks: &[Look]) -> Option<Self> {
        let start = [[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]];
        let [low, high] = looks.iter().fold(start, |[low, high], look| {
            let reach = look.width.map(|width| REACH * f64::from(width));
            [
                [0, 1].map(|a| low[a].min(look.at[a] - reach[a])),
                [0, 1].map(|a| high[a].max(look.at[a] + reach[a])),
            ]
        });
        if looks.is_empty() {
            return None;
        }
        let first = low.map(|v| (v - 0.5).ceil() as isize - 1);
        let last = high.map(|v| (v - 0.5).floor() as isize + 1);
        Some(Self {
            first,
            width: (last[0] - first[0] + 1) as usize,
            height: (last[1] - first[1] + 1) as usize,
        })
    }

    fn fill<P: Color>(&self, image: &Image<P>, window: &mut Vec<[f32; 4]>) {
        window.clear();
        window.reserve(self.width * self.height);
        let premultiplied = |pixel: P| {
            let LinearRgba([r, g, b, alpha]) = pixel.to_linear();
            if P::HAS_ALPHA {
                [r * alpha, g * alpha, b * alpha, alpha]
            } else {
                [r, g, b, 1.0]
            }
        };
        let last = image.width() as isize - 1;
        for row in 0..self.height {
            let y = (self.first[1] + row as isize).clamp(0, image.height() as isize - 1);
            let pixels = image.row(y as usize);
            let (from, to) = (self.first[0], self.first[0] + self.width as isize);
            let before = (-from).clamp(0, self.width as isize) as usize;
            let after = (to - 1 - last).clamp(0, (self.width - before) as isize) as usize;
            window.extend(std::iter::repeat_n(premultiplied(pixels[0]), before));
            let inside = &pixels[from.max(0) as usize..][..self.width - before - after];
            window.extend(inside.iter().map(|&pixel| premultiplied(pixel)));
            window.extend(std::iter::repeat_n(
                premultiplied(pixels[last as usize]),
                after,
            ));
        }
    }

    #[inline(always)]
    fn cubic(&self, window: &[[f32; 4]], look: &Look, weights: &mut [Vec<f32>; 2]) -> [f32; 4] {
        let [xs, ys] = weights;
        let col = cubic_weights(look.at[0] - self.first[0] as f64, look.width[0], xs);
        let row = cubic_weights(look.at[1] - self.first[1] as f64, look.width[1], ys);
        let mut sum = [0.0f32; 4];
        for (k, &wy) in ys.iter().enumerate() {
            let pixels = &window[(row + k) * self.width + col..][..xs.len()];
            let mut line = [0.0f32; 4];
            for (pixel, &wx) in pixels.iter().zip(xs.iter()) {
                for c in 0..4 {
                    line[c] += wx * pixel[c];
                }
            }
            for c in 0..4 {
                sum[c] += wy * line[c];
            }
        }
        sum
    }

    #[inline(always)]
    fn bilinear(&self, window: &[[f32; 4]], look: &Look) -> [f32; 4] {
        let [x, y] = [0, 1].map(|a: usize| look.at[a] - self.first[a] as f64 - 0.5);
        let (col, row) = (x as usize, y as usize);
        let (u, v) = ((x - col as f64) as f32, (y - row as f64) as f32);
        let at = row * self.width + col;
        let (upper, lower) = (&window[at..at + 2], &window[at + self.width..][..2]);
        std::array::from_fn(|c| {
            let top = upper[0][c] + u * (upper[1][c] - upper[0][c]);
            let bottom = lower[0][c] + u * (lower[1][c] - lower[0][c]);
            top + v * (bottom - top)
        })
    }
}

/// The weights of the pixels from the returned one on, for a cubic of `width` pixels around `at`. They add up to 1.
#[inline(always)]
fn cubic_weights(at: f64, width: f32, weights: &mut Vec<f32>) -> usize {
    let reach = REACH * f64::from(width);
    let first = (at - reach - 0.5).ceil().max(0.0);
    let last = (at + reach - 0.5).floor();
    let count = (last - first) as usize + 1;
    weights.clear();
    let (scale, start) = (1.0 / width, (first + 0.5 - at) as f32);
    let mut sum = 0.0;
    for k in 0..count {
        let weight = catmull_rom((start + k as f32) * scale);
        sum += weight;
        weights.push(weight);
    }
    let scale = 1.0 / sum;
    for weight in weights.iter_mut() {
        *weight *= scale;
    }
    first as usize
}

/// The interpolating cubic of Catmull and Rom, 0 from 2 on.
#[inline(always)]
fn catmull_rom(x: f32) -> f32 {
    let x = x.abs();
    if x < 1.0 {
        (1.5 * x - 2.5) * x * x + 1.0
    } else if x < 2.0 {
        ((-0.5 * x + 2.5) * x - 4.0) * x + 2.0
    } else {
        0.0
    }
}

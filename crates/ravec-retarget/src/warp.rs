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
use glam::{DVec2, Vec4, dvec2};
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
        if (height - image.height() as f64).abs() > 1.0
            && (width - image.width() as f64).abs() > 1.0
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
    /// Pixels of `image` a unit of the grid.
    source_unit: DVec2,
    filter: WarpFilter,
}

/// Some rows of the new picture: which cells they cross, and where.
struct Strip {
    first_row: usize,
    rows: Vec<Vec<Stretch>>,
}

/// Pixels of a row that lie in one cell, as they look at the old picture.
#[derive(Debug, Clone, Copy)]
struct Looks {
    /// The place of the first in the strip.
    index: usize,
    count: usize,
    /// How many old pixels the first sees along x and along y, at least 1, and how that changes from one to the next.
    width: DVec2,
    step: DVec2,
}

/// Memory that is used again from tile to tile.
#[derive(Default)]
struct Scratch {
    looks: Vec<Looks>,
    /// Where each pixel of them looks.
    xs: Vec<f64>,
    ys: Vec<f64>,
    /// The part of the old picture that is seen.
    window: Vec<Vec4>,
    weights: [Vec<Vec4>; 2],
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
        scratch.looks.clear();
        scratch.xs.clear();
        scratch.ys.clear();
        for (row, stretches) in strip.rows.iter().enumerate() {
            for stretch in stretches {
                let (from, to) = (stretch.first.max(first), stretch.end.min(end));
                if from < to {
                    let y = (strip.first_row + row) as f64 + 0.5;
                    self.look(stretch.cell, [from, to], y, row * stride, scratch);
                }
            }
        }
        let Some(part) = Part::seen(scratch) else {
            return;
        };
        let Scratch {
            looks,
            xs,
            ys,
            window,
            weights,
        } = scratch;
        part.fill(self.image, window);
        let mut at = xs.iter().zip(ys.iter());
        for looks in looks.iter() {
            let mut width = looks.width;
            let out = &mut pixels[looks.index..looks.index + looks.count];
            for (pixel, (&x, &y)) in out.iter_mut().zip(&mut at) {
                let at = dvec2(x, y) - part.origin();
                let light = match self.filter {
                    WarpFilter::Full => part.cubic(window, at, width, weights),
                    WarpFilter::Preview => part.bilinear(window, at),
                };
                *pixel = P::from_linear(straight::<P>(light));
                width += looks.step;
            }
        }
    }

    /// Where the pixels `from..to` of a row, which lie in one cell, look.
    fn look(
        &self,
        cell: u32,
        [from, to]: [usize; 2],
        y: f64,
        row_start: usize,
        scratch: &mut Scratch,
    ) {
        let inverse = self.locator.inverse(cell, self.source_unit);
        let source = |col: usize| inverse.source(dvec2(col as f64 + 0.5, y));
        // what is seen changes little within a cell: along the row it is interpolated
        let footprint = |col: usize| inverse.footprint(source(col)).max(DVec2::ONE);
        let (width, last) = (footprint(from), footprint(to - 1));
        scratch.looks.push(Looks {
            index: row_start + from,
            count: to - from,
            width,
            step: (last - width) / ((to - from - 1).max(1)) as f64,
        });
        let start = scratch.xs.len();
        scratch.xs.resize(start + to - from, 0.0);
        scratch.ys.resize(start + to - from, 0.0);
        let places = scratch.xs[start..].iter_mut().zip(&mut scratch.ys[start..]);
        for (k, (x, y)) in places.enumerate() {
            let at = source(from + k);
            (*x, *y) = (at.x, at.y);
        }
    }
}

/// Straight alpha from premultiplied.
#[inline(always)]
fn straight<P: Color>(light: Vec4) -> LinearRgba {
    let [r, g, b, alpha] = light.to_array();
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
    /// What the pixels of a tile see; nothing if there are none.
    fn seen(scratch: &Scratch) -> Option<Self> {
        if scratch.looks.is_empty() {
            return None;
        }
        let range = |values: &[f64]| {
            values
                .iter()
                .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], &v| {
                    [
                        if v < low { v } else { low },
                        if v > high { v } else { high },
                    ]
                })
        };
        let ranges = [range(&scratch.xs), range(&scratch.ys)];
        let widest = scratch.looks.iter().fold(DVec2::ONE, |widest, looks| {
            let last = looks.width + looks.step * looks.count as f64;
            widest.max(looks.width).max(last)
        });
        let reach = REACH * widest;
        let first = [0, 1].map(|a: usize| (ranges[a][0] - reach[a] - 0.5).ceil() as isize - 1);
        // weights come in fours, of which up to three are 0
        let last = [0, 1].map(|a: usize| (ranges[a][1] + reach[a] - 0.5).floor() as isize + 4);
        Some(Self {
            first,
            width: (last[0] - first[0] + 1) as usize,
            height: (last[1] - first[1] + 1) as usize,
        })
    }

    /// Its upper left corner.
    fn origin(&self) -> DVec2 {
        dvec2(self.first[0] as f64, self.first[1] as f64)
    }

    fn fill<P: Color>(&self, image: &Image<P>, window: &mut Vec<Vec4>) {
        window.clear();
        window.reserve(self.width * self.height);
        let premultiplied = |pixel: P| {
            let LinearRgba([r, g, b, alpha]) = pixel.to_linear();
            if P::HAS_ALPHA {
                Vec4::new(r * alpha, g * alpha, b * alpha, alpha)
            } else {
                Vec4::new(r, g, b, 1.0)
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
    fn cubic(
        &self,
        window: &[Vec4],
        at: DVec2,
        width: DVec2,
        weights: &mut [Vec<Vec4>; 2],
    ) -> Vec4 {
        let [xs, ys] = weights;
        let (col, xs, _) = cubic_weights(at.x, width.x, xs);
        let (row, ys, rows) = cubic_weights(at.y, width.y, ys);
        let mut sum = Vec4::ZERO;
        for k in 0..rows {
            let pixels = &window[(row + k) * self.width + col..];
            let mut line = Vec4::ZERO;
            for (pixels, weights) in pixels.chunks_exact(4).zip(xs) {
                line += pixels[0] * weights.x
                    + pixels[1] * weights.y
                    + pixels[2] * weights.z
                    + pixels[3] * weights.w;
            }
            sum += line * ys[k / 4][k % 4];
        }
        sum
    }

    #[inline(always)]
    fn bilinear(&self, window: &[Vec4], at: DVec2) -> Vec4 {
        let [x, y] = (at - 0.5).to_array();
        let (col, row) = (x as usize, y as usize);
        let (u, v) = ((x - col as f64) as f32, (y - row as f64) as f32);
        let at = row * self.width + col;
        let (upper, lower) = (&window[at..at + 2], &window[at + self.width..][..2]);
        upper[0]
            .lerp(upper[1], u)
            .lerp(lower[0].lerp(lower[1], u), v)
    }
}

/// The first pixel, the weights from it on, and how many of them are not 0 for certain, for a cubic of `width` pixels around
/// `at`, which is beyond its reach. They add up to 1.
#[inline(always)]
fn cubic_weights(at: f64, width: f64, weights: &mut Vec<Vec4>) -> (usize, &[Vec4], usize) {
    let reach = REACH * width;
    // casts instead of calls to round: all are positive
    let first = (at - reach + 0.5) as usize;
    let count = (at + reach + 0.5) as usize - first;
    let fours = count.div_ceil(4);
    if weights.len() < fours {
        weights.resize(fours, Vec4::ZERO);
    }
    let weights = &mut weights[..fours];
    let (scale, start) = (1.0 / width as f32, (first as f64 + 0.5 - at) as f32);
    let mut x = Vec4::new(0.0, 1.0, 2.0, 3.0) + start;
    let mut sum = Vec4::ZERO;
    for weight in weights.iter_mut() {
        *weight = catmull_rom(x * scale);
        sum += *weight;
        x += 4.0;
    }
    let scale = 1.0 / sum.element_sum();
    for weight in weights.iter_mut() {
        *weight *= scale;
    }
    (first, weights, count)
}

/// The interpolating cubic of Catmull and Rom, 0 from 2 on.
#[inline(always)]
fn catmull_rom(x: Vec4) -> Vec4 {
    let x = x.abs();
    let near = (1.5 * x - 2.5) * x * x + 1.0;
    let far = ((-0.5 * x + 2.5) * x - 4.0) * x + 2.0;
    let far = Vec4::select(x.cmplt(Vec4::splat(2.0)), far, Vec4::ZERO);
    Vec4::select(x.cmplt(Vec4::ONE), near, far)
}

#[cfg(test)]
mod tests;

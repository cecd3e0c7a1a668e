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
use crate::locate::{Locator, Stretch, TOGETHER};
use crate::params::RetargetError;
use cubic::{Taps, cubic};
use fearless_simd::{Level, dispatch, prelude::*};
use glam::{DVec2, dvec2};
use ravec_progress::Progress;
use ravec_raster::{Color, Image, LinearRgba, Size};
use rayon::prelude::*;
use window::Window;

mod cubic;
mod plan;
mod window;

pub use plan::{WarpCell, WarpPlan, WarpSpan};

/// Filter of the resampling.
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
    /// [`RetargetError::OtherShape`] if `image` has another size than the analyzed one, [`RetargetError::Cancelled`] soon
    /// after `progress` is cancelled.
    pub fn warp<P: Color>(
        &self,
        image: &Image<P>,
        progress: &Progress,
    ) -> Result<Image<P>, RetargetError> {
        if image.size() != self.source_size() {
            return Err(RetargetError::OtherShape {
                got: image.size(),
                analyzed: self.source_size(),
            });
        }
        if self.is_identity() {
            return Ok(image.clone());
        }
        self.warp_to(image, self.size(), WarpFilter::Full, progress)
    }

    /// The new picture at another resolution, from an old one at any resolution: `image` is the analyzed picture reduced or
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
        self.prepare(image, size, filter)?.run(progress)
    }

    fn prepare<'a, P: Color>(
        &'a self,
        image: &'a Image<P>,
        size: Size,
        filter: WarpFilter,
    ) -> Result<Warp<'a, P>, RetargetError> {
        let analyzed = self.source_size();
        let scaled = |a: usize, b: usize, c: usize| a as f64 * b as f64 / c as f64;
        let height = scaled(image.width(), analyzed.height(), analyzed.width());
        let width = scaled(image.height(), analyzed.width(), analyzed.height());
        if (height - image.height() as f64).abs() > 1.0
            && (width - image.width() as f64).abs() > 1.0
        {
            return Err(RetargetError::OtherShape {
                got: image.size(),
                analyzed,
            });
        }
        Ok(Warp {
            image,
            size,
            locator: Locator::new(self, lengths(size) / lengths(self.size()), size.width()),
            source_unit: self.grid.unit_px() * lengths(image.size()) / lengths(analyzed),
            filter,
            simd: Level::new(),
        })
    }
}

fn lengths(size: Size) -> DVec2 {
    dvec2(size.width() as f64, size.height() as f64)
}

struct Warp<'a, P> {
    image: &'a Image<P>,
    /// Of the result.
    size: Size,
    locator: Locator<'a>,
    /// Pixels of `image` a unit of the grid.
    source_unit: DVec2,
    filter: WarpFilter,
    simd: Level,
}

/// Some rows of the new picture: which cells they cross, and where.
struct Strip {
    first_row: usize,
    rows: Vec<Vec<Stretch>>,
}

/// Span of pixels of a row that lie in one cell, with their footprints in the old picture.
#[derive(Debug, Clone, Copy)]
struct Span {
    /// The row in the strip, and the column.
    row: usize,
    first: usize,
    count: usize,
    /// Footprint of the first pixel along x and along y, in old pixels, at least 1, and its change from one pixel to
    /// the next.
    width: DVec2,
    step: DVec2,
}

impl Span {
    /// A span with the footprints of its first and its last pixel.
    #[inline(always)]
    fn between(row: usize, first: usize, count: usize, footprints: [DVec2; 2]) -> Self {
        let [width, last] = footprints.map(|footprint| footprint.max(DVec2::ONE));
        Self {
            row,
            first,
            count,
            width,
            step: (last - width) / ((count - 1).max(1)) as f64,
        }
    }
}

/// Memory that is used again from tile to tile.
#[derive(Default)]
struct Scratch {
    spans: Vec<Span>,
    /// Position of each of their pixels in the old picture.
    xs: Vec<f64>,
    ys: Vec<f64>,
    window: Window,
    taps: Taps,
    /// Light of each pixel.
    light: Vec<[f32; 4]>,
}

impl<P: Color> Warp<'_, P> {
    fn run(&self, progress: &Progress) -> Result<Image<P>, RetargetError> {
        let size = self.size;
        // where the picture shrinks, a tile sees more
        let shrink = (lengths(self.image.size()) / lengths(size)).max(DVec2::ONE);
        let rows = (TILE[0] as f64 / shrink.y).ceil() as usize;
        let columns = (TILE[1] as f64 / shrink.x).ceil() as usize;
        let mut result = Image::new(size, self.image.pixels()[0]);
        let phase = progress.phase("warp", size.height() as u64);
        result.par_strips_mut(rows).enumerate().try_for_each_init(
            Scratch::default,
            |scratch, (index, pixels)| {
                let height = pixels.len() / size.width();
                let strip = self.strip(index * rows, height);
                for first in (0..size.width()).step_by(columns) {
                    progress.check()?;
                    let end = (first + columns).min(size.width());
                    self.tile(&strip, [first, end], scratch, pixels);
                }
                phase.advance(height as u64);
                Ok::<(), RetargetError>(())
            },
        )?;
        Ok(result)
    }

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
    fn tile(&self, strip: &Strip, columns: [usize; 2], scratch: &mut Scratch, pixels: &mut [P]) {
        let locator = &self.locator;
        let unit = self.source_unit;
        locate(self.simd, locator, unit, strip, columns, scratch);
        let Scratch {
            spans,
            xs,
            ys,
            window,
            taps,
            light,
        } = scratch;
        let Some(seen) = seen(spans, xs, ys) else {
            return;
        };
        window.fill(self.image, seen);
        light.resize(xs.len(), [0.0; 4]);
        match self.filter {
            WarpFilter::Full => filter(self.simd, window, spans, [xs, ys], taps, light),
            WarpFilter::Preview => {
                for ((light, &x), &y) in light.iter_mut().zip(xs.iter()).zip(ys.iter()) {
                    *light = window.bilinear(dvec2(x, y));
                }
            }
        }
        let mut light = light.iter();
        for span in spans.iter() {
            let first = span.row * self.size.width() + span.first;
            for (pixel, &light) in pixels[first..first + span.count].iter_mut().zip(&mut light) {
                *pixel = P::from_linear(straight::<P>(light));
            }
        }
    }
}

/// [`locate_columns`] with the instructions of `level`, apart from the pixel type, so that it is compiled once.
fn locate(
    level: Level,
    locator: &Locator<'_>,
    source_unit: DVec2,
    strip: &Strip,
    columns: [usize; 2],
    scratch: &mut Scratch,
) {
    dispatch!(level, simd => locate_columns(simd, locator, source_unit, strip, columns, scratch));
}

/// [`cubic`] with the instructions of `level`, likewise.
fn filter(
    level: Level,
    window: &Window,
    spans: &[Span],
    places: [&[f64]; 2],
    taps: &mut Taps,
    light: &mut [[f32; 4]],
) {
    dispatch!(level, simd => cubic(simd, window, spans, places, taps, light));
}

/// Locates the pixels of the columns `first..end` of a strip in the old picture.
#[inline(always)]
fn locate_columns<S: Simd>(
    simd: S,
    locator: &Locator<'_>,
    source_unit: DVec2,
    strip: &Strip,
    [first, end]: [usize; 2],
    scratch: &mut Scratch,
) {
    let Scratch { spans, xs, ys, .. } = scratch;
    spans.clear();
    xs.clear();
    ys.clear();
    for (row, stretches) in strip.rows.iter().enumerate() {
        let y = (strip.first_row + row) as f64 + 0.5;
        for stretch in stretches {
            let (from, to) = (stretch.first.max(first), stretch.end.min(end));
            if from >= to {
                continue;
            }
            let inverse = locator.inverse(stretch.cell, source_unit);
            let (start, count) = (xs.len(), to - from);
            for places in [&mut *xs, &mut *ys] {
                places.resize(start + count.next_multiple_of(TOGETHER), 0.0);
            }
            let places = [&mut xs[start..], &mut ys[start..]];
            inverse.sources(simd, from as f64 + 0.5, y, places);
            xs.truncate(start + count);
            ys.truncate(start + count);
            // what is seen changes little within a cell: along the row it is interpolated
            let ends =
                [start, start + count - 1].map(|at| inverse.footprint(dvec2(xs[at], ys[at])));
            spans.push(Span::between(row, from, count, ends));
        }
    }
}

/// Range of the positions that the pixels read, if there are any.
fn seen(spans: &[Span], xs: &[f64], ys: &[f64]) -> Option<[DVec2; 2]> {
    let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
    let (mut widest, mut start) = (DVec2::ONE, 0);
    for span in spans {
        // places go up or down all along a stretch
        for at in [start, start + span.count - 1] {
            low = low.min(dvec2(xs[at], ys[at]));
            high = high.max(dvec2(xs[at], ys[at]));
        }
        let last = span.width + span.step * span.count as f64;
        widest = widest.max(span.width).max(last);
        start += span.count;
    }
    // all pixels of a stretch take as many old ones as that which sees the most, from the first on that they see
    let reach = REACH * widest;
    (start > 0).then(|| [low - reach, high + 2.0 * reach - REACH])
}

/// The reach of the cubic.
const REACH: f64 = 2.0;

/// Straight alpha from premultiplied.
#[inline(always)]
fn straight<P: Color>([r, g, b, alpha]: [f32; 4]) -> LinearRgba {
    if !P::HAS_ALPHA {
        return LinearRgba([r, g, b, 1.0]);
    }
    let scale = if alpha > 0.0 { 1.0 / alpha } else { 0.0 };
    LinearRgba([r * scale, g * scale, b * scale, alpha.clamp(0.0, 1.0)])
}

#[cfg(test)]
mod tests;

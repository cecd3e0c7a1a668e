//! Strokes that have ended and can be taken off again.

use super::stroke::Stroke;
use super::tiles::Tiles;
use ravec_raster::{Image, LinearRgba, Rect};
use rayon::prelude::*;
use std::collections::VecDeque;

/// Memory of all kept pixels: some hundred strokes of a brush as wide as a face.
const MAX_BYTES: usize = 256 << 20;

/// Pixels that a stroke has changed, as they were before it.
#[derive(Default)]
pub(crate) struct Patch {
    tiles: Vec<(Rect, Image<LinearRgba>)>,
}

impl Patch {
    /// The painted tiles in which two pictures of the same size differ, as they are in `before`.
    pub fn between(before: &Image<LinearRgba>, after: &Image<LinearRgba>, painted: &Tiles) -> Self {
        let tiles: Vec<Rect> = painted.rects().collect();
        let changed = tiles.into_par_iter().filter(|tile| {
            let columns = tile.col..tile.right();
            (tile.row..tile.bottom()).any(|row| {
                let [before, after] = [before, after].map(|image| &image.row(row)[columns.clone()]);
                // by their bits, so that what is not a number counts as equal to itself
                let bits = |pixel: &LinearRgba| pixel.0.map(f32::to_bits);
                before.iter().map(bits).ne(after.iter().map(bits))
            })
        });
        let kept = changed.filter_map(|tile| {
            let pixels = before.crop(tile.col, tile.row, tile.size()?).ok()?;
            Some((tile, pixels))
        });
        Self {
            tiles: kept.collect(),
        }
    }

    /// The tiles in which the stroke has changed pixels.
    pub fn rects(&self) -> impl Iterator<Item = Rect> {
        self.tiles.iter().map(|(tile, _)| *tile)
    }

    /// Puts the pixels back.
    pub fn restore(&self, image: &mut Image<LinearRgba>) {
        for (tile, pixels) in &self.tiles {
            for y in 0..tile.height {
                image.row_mut(tile.row + y)[tile.col..tile.right()].copy_from_slice(pixels.row(y));
            }
        }
    }

    fn bytes(&self) -> usize {
        let pixels: usize = self.tiles.iter().map(|(tile, _)| tile.pixels()).sum();
        pixels * size_of::<LinearRgba>()
    }
}

/// A stroke that has ended.
pub(crate) struct Ended {
    pub stroke: Stroke,
    pub patch: Patch,
    /// True if the noise of the picture was known before the stroke.
    pub noise_known: bool,
}

/// The last strokes that have ended, as many as the memory allows.
#[derive(Default)]
pub(crate) struct History {
    strokes: VecDeque<Ended>,
    bytes: usize,
}

impl History {
    pub fn push(&mut self, ended: Ended) {
        self.bytes += ended.patch.bytes();
        self.strokes.push_back(ended);
        while self.bytes > MAX_BYTES {
            let Some(oldest) = self.strokes.pop_front() else {
                return;
            };
            self.bytes -= oldest.patch.bytes();
        }
    }

    pub fn pop(&mut self) -> Option<Ended> {
        let ended = self.strokes.pop_back()?;
        self.bytes -= ended.patch.bytes();
        Some(ended)
    }
}

//! A picture before and after the stroke that is being painted.

use super::history::Patch;
use super::tiles::Tiles;
use crate::clean::NoiseLevel;
use crate::filter_error::FilterError;
use crate::operator::{OperatorParams, noise_for};
use ravec_progress::Progress;
use ravec_raster::{Image, LinearRgba, Rect};
use rayon::prelude::*;

/// Two copies of a picture that differ only where the current stroke has painted, so that the next stroke costs as much as
/// the pixels that this one changed and not as much as the picture.
pub(crate) struct Canvas {
    /// The picture before the stroke.
    pub before: Image<LinearRgba>,
    /// The picture with the stroke.
    pub image: Image<LinearRgba>,
    /// The tiles in which the two may differ.
    painted: Tiles,
    /// The noise that the first cleaning stroke found in the whole picture. Later ones use it again: painting does not change
    /// what the camera did, and the estimate costs as much as the picture is large.
    noise: Option<NoiseLevel>,
}

impl Canvas {
    pub fn new(image: Image<LinearRgba>) -> Self {
        Self {
            before: image.clone(),
            painted: Tiles::none(image.size()),
            image,
            noise: None,
        }
    }

    /// The noise that a cleaning stroke works against: given by the stroke, or that of the picture.
    pub fn noise_for(
        &mut self,
        operator: &OperatorParams,
        progress: &Progress,
    ) -> Result<Option<NoiseLevel>, FilterError> {
        if operator.noise_sigma.is_some() {
            return noise_for(&self.before, operator, progress);
        }
        if self.noise.is_none() {
            self.noise = noise_for(&self.before, operator, progress)?;
        }
        Ok(self.noise.clone())
    }

    /// True if a cleaning stroke has found the noise of the picture.
    pub fn knows_noise(&self) -> bool {
        self.noise.is_some()
    }

    /// Lets the next cleaning stroke find the noise of the picture anew.
    pub fn forget_noise(&mut self) {
        self.noise = None;
    }

    /// Marks the pixels of `region`, which must lie in the picture, as those that the stroke may have changed.
    pub fn mark(&mut self, region: Rect) {
        self.painted.add(region);
    }

    /// Takes the stroke off; returns the pixels that may have changed.
    pub fn take_off(&mut self) -> Rect {
        copy(&self.before, &mut self.image, &self.painted);
        self.painted.clear()
    }

    /// The pixels that the stroke has changed, as they were before it.
    pub fn patch(&self) -> Patch {
        Patch::between(&self.before, &self.image, &self.painted)
    }

    /// Makes the stroke of a patch, the last one that ended, the one that is being painted. The one after it must have been
    /// taken off.
    pub fn resume(&mut self, patch: &Patch) {
        patch.restore(&mut self.before);
        self.painted.clear();
        for tile in patch.rects() {
            self.painted.add(tile);
        }
    }

    /// Ends the stroke: the next one starts from the painted picture.
    pub fn settle(&mut self) {
        copy(&self.image, &mut self.before, &self.painted);
        self.painted.clear();
    }
}

/// Copies tiles.
fn copy(from: &Image<LinearRgba>, to: &mut Image<LinearRgba>, tiles: &Tiles) {
    let width = from.width();
    let mut bands = vec![Vec::new(); from.height().div_ceil(Tiles::SIDE)];
    for tile in tiles.rects() {
        bands[tile.row / Tiles::SIDE].push(tile);
    }
    let rows = to.pixels_mut().par_chunks_mut(Tiles::SIDE * width);
    rows.zip(bands).for_each(|(rows, tiles)| {
        for tile in tiles {
            for (row, out) in (tile.row..).zip(rows.chunks_exact_mut(width)) {
                let columns = tile.col..tile.right();
                out[columns.clone()].copy_from_slice(&from.row(row)[columns]);
            }
        }
    });
}

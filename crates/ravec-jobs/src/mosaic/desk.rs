//! Photos that are kept while a mosaic is edited.

use super::{Mosaic, checked};
use crate::context::Context;
use crate::error::JobError;
use ravec::raster::{Rect, Size};
use ravec_catalogue::{Catalogue, MosaicParams, PhotoSet, TileCandidate};
use ravec_media::Picture;
use std::path::Path;

/// The photos of a catalogue and how they look, for previews and for the candidates of tiles.
///
/// It serves as long as [`key`](Self::key) stays the same.
#[derive(Debug)]
pub struct MosaicDesk {
    set: PhotoSet,
}

/// A preview of a mosaic.
#[derive(Debug, Clone)]
pub struct Preview {
    /// Its pixels, at most 1600 a side.
    pub picture: Picture,
    /// Size of the mosaic that it shows.
    pub size: Size,
}

impl MosaicDesk {
    /// A text that changes when another desk is needed: with the file of the catalogue, the proportions of tiles and the use of
    /// photos of other proportions.
    ///
    /// # Errors
    /// [`JobError::Parameter`].
    pub fn key(operation: &Mosaic) -> Result<String, JobError> {
        let MosaicParams { tile, crop, .. } = checked(&operation.params)?;
        let path = &operation.catalogue;
        let data = path.metadata().ok();
        let length = data.as_ref().map(std::fs::Metadata::len);
        let modified = data.and_then(|data| data.modified().ok());
        Ok(format!(
            "{} {length:?} {modified:?} {}x{} {crop:?}",
            path.display(),
            tile.width(),
            tile.height()
        ))
    }

    /// Loads the photos for an operation.
    ///
    /// # Errors
    /// [`JobError::Parameter`], [`JobError::Catalogue`], [`JobError::Cancelled`].
    pub fn open(operation: &Mosaic, context: &Context) -> Result<Self, JobError> {
        let MosaicParams { tile, crop, .. } = checked(&operation.params)?;
        let (memory, progress) = (&context.limits.memory, &context.progress);
        let catalogue = Catalogue::open_to_read(&operation.catalogue, progress);
        let set = catalogue
            .and_then(|catalogue| PhotoSet::load(&catalogue, tile, crop, memory, progress));
        let set = set.map_err(JobError::from_catalogue)?;
        Ok(Self { set })
    }

    /// The preview that the operation would write with `preview`. Its files are not used.
    ///
    /// # Errors
    /// [`JobError::Parameter`], [`JobError::Catalogue`], [`JobError::Cancelled`].
    pub fn preview(
        &mut self,
        operation: &Mosaic,
        picture: &Picture,
        context: &Context,
    ) -> Result<Preview, JobError> {
        let mut params = operation.params.clone();
        params.preview = true;
        let params = checked(&params)?;
        let (limits, progress) = (&context.limits, &context.progress);
        let (made, image) = self
            .set
            .preview(&picture.image, &params, limits, progress)
            .map_err(JobError::from_catalogue)?;
        let (columns, rows) = made.tiles;
        let whole = Size::new(columns * params.tile.width(), rows * params.tile.height());
        Ok(Preview {
            size: whole.unwrap_or(made.size),
            picture: Picture::from_image(image),
        })
    }

    /// The `count` photos that are nearest to the tile at `place`, a rectangle in the pixels of the mosaic as in the report's
    /// `result.places`; the nearest first, of near-duplicates only one, and none that is banned there.
    ///
    /// # Errors
    /// [`JobError::Parameter`], [`JobError::Catalogue`] if no tile can lie there, [`JobError::Cancelled`].
    pub fn candidates(
        &self,
        operation: &Mosaic,
        picture: &Picture,
        place: Rect,
        count: usize,
        context: &Context,
    ) -> Result<Vec<TileCandidate>, JobError> {
        let mut params = operation.params.clone();
        params.preview = false;
        let params = checked(&params)?;
        let (memory, progress) = (&context.limits.memory, &context.progress);
        self.set
            .candidates(&picture.image, &params, place, count, memory, progress)
            .map_err(JobError::from_catalogue)
    }

    /// The small picture of a photo, if it can be used.
    pub fn small(&self, photo: &Path) -> Option<&ravec::raster::Image<ravec::raster::Srgb<u8>>> {
        self.set.small(photo)
    }
}

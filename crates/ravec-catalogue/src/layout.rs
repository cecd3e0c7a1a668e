//! Layout of the tiles on the picture and in the mosaic.

use crate::error::CatalogueError;
use crate::mosaic::MosaicParams;
use crate::thumbnail::light;
use ravec_mosaic::{
    ADAPTIVE_UNITS, ChooseParams, Frame, Photos, Tile, Tiling, adaptive_tiles, grid_tiles,
    mark_features,
};
use ravec_progress::{Cancelled, Progress};
use ravec_raster::{AnyImage, Image, Oklab, Rect, ResizeFilter, Size, resize};

/// Pixels of the picture in a tile beyond which more say nothing about its look.
const PICTURE_PX: usize = 16;

/// Layout of the tiles on the picture and in the mosaic.
pub(crate) struct Layout {
    /// Tiles of common size across, and down.
    pub columns: usize,
    pub rows: usize,
    /// Of a tile of common size.
    tile: Size,
    /// Of the mosaic.
    pub size: Size,
    /// The part of the picture that is shown.
    frame: Frame,
}

impl Layout {
    pub fn new(picture: Size, params: &MosaicParams) -> Result<Self, CatalogueError> {
        let (width, height) = (picture.width() as f64, picture.height() as f64);
        let tile = params.tile;
        let columns = params.columns;
        let rows = params.rows.unwrap_or_else(|| {
            let side = width / columns as f64 * tile.height() as f64 / tile.width() as f64;
            ((height / side).round() as usize).max(1)
        });
        let whole_units = |side: usize| side.is_multiple_of(ADAPTIVE_UNITS);
        if params.adaptive.is_some() && !(whole_units(tile.width()) && whole_units(tile.height())) {
            return Err(CatalogueError::NoThirds {
                width: tile.width(),
                height: tile.height(),
            });
        }
        let sides = |tile: Size| {
            columns
                .checked_mul(tile.width())
                .zip(rows.checked_mul(tile.height()))
        };
        let whole =
            |tile: Size| sides(tile).and_then(|(width, height)| Size::new(width, height).ok());
        let size = whole(tile).ok_or(CatalogueError::TooLarge {
            columns,
            rows,
            width: tile.width(),
            height: tile.height(),
        })?;
        if picture.width() < columns || picture.height() < rows {
            return Err(CatalogueError::PictureTooSmall {
                width: picture.width(),
                height: picture.height(),
                columns,
                rows,
            });
        }
        let aspect = size.width() as f64 / size.height() as f64;
        let small = params.preview_px.and_then(|most| {
            let factor = most as f64 / size.width().max(size.height()) as f64;
            let side = |pixels: usize| ((pixels as f64 * factor) as usize).max(1);
            let tile = Size::new(side(tile.width()), side(tile.height())).ok()?;
            (factor < 1.0).then_some(tile).zip(whole(tile))
        });
        let (tile, size) = small.unwrap_or((tile, size));
        Ok(Self {
            columns,
            rows,
            tile,
            size,
            frame: Frame::centered(width, height, aspect),
        })
    }

    /// A warning with the share of the picture that is not in the mosaic, if it is more than a hundredth.
    pub fn warning(&self, picture: Size) -> Vec<String> {
        let shown = self.frame.width * self.frame.height / picture.pixels() as f64;
        let lost = 100.0 * (1.0 - shown);
        if lost <= 1.0 {
            return Vec::new();
        }
        vec![format!(
            "the picture has other proportions than the mosaic; {lost:.0} % at its borders are not shown"
        )]
    }

    /// The tiles of the picture.
    pub fn tiles(
        &self,
        picture: &Image<Oklab>,
        frame: Frame,
        photos: &Photos,
        params: &MosaicParams,
        progress: &Progress,
    ) -> Result<Tiling, Cancelled> {
        let (columns, rows) = (self.columns, self.rows);
        let features = params.choose.features;
        let degree = degree(&params.choose);
        let mut tiling = match params.adaptive {
            Some(seed) => {
                let sides = [columns, rows];
                let (rules, choose) = (&params.rules, &params.choose);
                adaptive_tiles(
                    picture, frame, sides, degree, photos, rules, choose, seed, progress,
                )?
            }
            None => grid_tiles(picture, frame, columns, rows, degree, progress)?,
        };
        if features.is_some() {
            mark_features(picture, frame, &mut tiling, progress)?;
        }
        Ok(tiling)
    }

    /// The tile whose rectangle is `place` in the mosaic; none if no tile can lie there.
    pub fn tile_at(
        &self,
        picture: &Image<Oklab>,
        frame: Frame,
        place: Rect,
        params: &MosaicParams,
        progress: &Progress,
    ) -> Result<Option<Tile>, Cancelled> {
        let units = if params.adaptive.is_some() {
            ADAPTIVE_UNITS
        } else {
            1
        };
        let mut tiling = Tiling {
            tiles: Vec::new(),
            columns: units * self.columns,
            rows: units * self.rows,
            units,
            start: Vec::new(),
        };
        let (width, height) = (self.tile.width(), self.tile.height());
        let count = |pixels: usize, side: usize| (pixels * units).div_ceil(side);
        let (col, row) = (count(place.col, width), count(place.row, height));
        let side = count(place.right(), width).saturating_sub(col);
        let fits = side > 0 && col + side <= tiling.columns && row + side <= tiling.rows;
        if !fits {
            return Ok(None);
        }
        tiling.describe(picture, frame, [col, row], side, degree(&params.choose));
        if self.place(&tiling, &tiling.tiles[0]) != place {
            return Ok(None);
        }
        if params.choose.features.is_some() {
            mark_features(picture, frame, &mut tiling, progress)?;
        }
        Ok(tiling.tiles.pop())
    }

    /// Bytes that [`reduced`](Self::reduced) takes at most: the picture in linear light, and smaller ones on the way.
    pub fn bytes_to_reduce(&self, picture: Size) -> u64 {
        /// Of a pixel of three floats.
        const BYTES: u64 = 12;
        let small = (PICTURE_PX * self.columns + 1).saturating_mul(PICTURE_PX * self.rows + 1);
        // the small one, its halfway form of all rows, and its form in Oklab
        let small = small.min(picture.pixels()) as u64;
        let halfway = (PICTURE_PX * self.columns + 1).min(picture.width()) * picture.height();
        BYTES * (picture.pixels() as u64 + 2 * small + halfway as u64)
    }

    /// The picture with as many pixels as looks need, on white where it is transparent, and the part of it that is shown.
    pub fn reduced(&self, picture: &AnyImage) -> (Image<Oklab>, Frame) {
        let reduce = |length: f64, tiles: usize| (PICTURE_PX * tiles) as f64 / length;
        let factor =
            reduce(self.frame.width, self.columns).max(reduce(self.frame.height, self.rows));
        let opaque = light(picture);
        let side = |pixels: usize| ((pixels as f64 * factor).ceil() as usize).max(1);
        let small = if factor < 1.0 {
            Size::new(side(opaque.width()), side(opaque.height())).ok()
        } else {
            None
        };
        let (image, x, y) = match small {
            Some(size) => (
                resize(&opaque, size, ResizeFilter::Box),
                size.width() as f64 / opaque.width() as f64,
                size.height() as f64 / opaque.height() as f64,
            ),
            None => (opaque, 1.0, 1.0),
        };
        let frame = Frame {
            left: self.frame.left * x,
            top: self.frame.top * y,
            width: self.frame.width * x,
            height: self.frame.height * y,
        };
        (image.convert(), frame)
    }

    /// Photos with the rectangles of their tiles, in pixels.
    pub fn places(&self, tiling: &Tiling, photos: &[u32]) -> Vec<(u32, Rect)> {
        let tiles = tiling.tiles.iter().zip(photos);
        tiles
            .map(|(tile, &photo)| (photo, self.place(tiling, tile)))
            .collect()
    }

    /// Rectangle of a tile in the mosaic, in pixels.
    pub fn place(&self, tiling: &Tiling, tile: &Tile) -> Rect {
        let at = |units: usize, side: usize| units * side / tiling.units;
        let (width, height) = (self.tile.width(), self.tile.height());
        let (left, top) = (at(tile.col, width), at(tile.row, height));
        Rect::new(
            left,
            top,
            at(tile.col + tile.side, width) - left,
            at(tile.row + tile.side, height) - top,
        )
    }

    /// Rows of pixels of a tile of common size.
    pub fn tile_px(&self) -> usize {
        self.tile.height()
    }
}

/// The degree of the polynomials that tiles of both kinds are compared by.
fn degree(choose: &ChooseParams) -> usize {
    let of_features = choose.features.map_or(0, |features| features.degree);
    of_features.max(choose.weights.degree)
}

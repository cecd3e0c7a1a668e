//! Pictures as a screen shows them: 8 bits, at several sizes, in tiles.
//!
//! The full size is not converted as a whole: a tile of it is made of the picture when it is seen, so that a picture of any size is
//! shown as soon as it is read. Smaller sizes are kept; together they take a third of the bytes of the full size in 8 bits.

use ravec::raster::{
    AnyImage, Color as _, Image, LinearRgba, Pixel, Rect, Srgb, Srgba, with_image,
};
use ravec_media::Picture;
use rayon::prelude::*;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Shorter side below which no smaller size is made, in pixels.
const MIN_SIDE: usize = 64;

/// Side of a tile in pixels.
pub const TILE: usize = 512;

/// Rows of a band: a change copies the bands that it touches.
const BAND: usize = 64;

/// Red, green, blue and alpha, straight.
pub type Rgba = [u8; 4];

/// Number of the next state of a tile.
static STAMP: AtomicU64 = AtomicU64::new(1);

fn next_stamp() -> u64 {
    STAMP.fetch_add(1, Ordering::Relaxed)
}

/// A picture at several sizes, each half of the one before.
#[derive(Debug, Clone)]
pub struct Shown {
    picture: Arc<Picture>,
    exposure: f32,
    /// Columns and rows in the coordinates of the document: more than those of the picture for a preview of lower resolution.
    size: [usize; 2],
    levels: Vec<Level>,
}

/// One size.
#[derive(Debug, Clone)]
struct Level {
    width: usize,
    height: usize,
    /// Bands of rows, which states of a picture share; none for the full size.
    bands: Vec<Arc<Vec<Rgba>>>,
    /// State of each tile, row by row.
    stamps: Vec<u64>,
}

/// A tile of a level.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct TileIndex {
    /// Level, 0 for the full size.
    pub level: usize,
    /// Column of tiles.
    pub col: usize,
    /// Row of tiles.
    pub row: usize,
}

/// Pixels of a tile.
#[derive(Debug, Clone)]
pub struct Tile {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Row by row.
    pub pixels: Vec<Rgba>,
}

impl Shown {
    /// All sizes of a picture.
    pub fn new(picture: Arc<Picture>) -> Self {
        Self::exposed(picture, 0.0)
    }

    /// All sizes of a picture, brighter by a number of stops: 1 doubles the light.
    pub fn exposed(picture: Arc<Picture>, exposure: f32) -> Self {
        let image = &picture.image;
        let size = [image.size().width(), image.size().height()];
        let mut levels = vec![Level::new(size[0], size[1], vec![])];
        while let Some(last) = levels.last()
            && last.width.min(last.height) >= 2 * MIN_SIDE
        {
            let (width, height) = (last.width / 2, last.height / 2);
            let is_first = levels.len() == 1;
            let bands = (0..height.div_ceil(BAND)).into_par_iter().map(|band| {
                let rows = band * BAND..height.min((band + 1) * BAND);
                let mut pixels = vec![[0; 4]; width * rows.len()];
                for (row, out) in rows.zip(pixels.chunks_exact_mut(width)) {
                    if is_first {
                        let pair = drawn(image, Rect::new(0, 2 * row, 2 * width, 2), exposure);
                        halve_rows(pair.split_at(2 * width), out);
                    } else {
                        halve_rows((last.row(2 * row), last.row(2 * row + 1)), out);
                    }
                }
                Arc::new(pixels)
            });
            let level = Level::new(width, height, bands.collect());
            levels.push(level);
        }
        Self {
            picture,
            exposure,
            size,
            levels,
        }
    }

    /// The same picture as a preview of lower resolution of one with this size.
    #[must_use]
    pub fn stretched(self, size: [usize; 2]) -> Self {
        Self { size, ..self }
    }

    /// The state after a change of the picture inside of `region`, with the cost of the region and of the bands that it touches.
    ///
    /// # Panics
    /// If the picture has another size.
    #[must_use]
    pub fn changed(&self, picture: Arc<Picture>, region: Rect) -> Self {
        let image = &picture.image;
        assert_eq!(
            image.size(),
            self.picture.image.size(),
            "the size of a picture stays"
        );
        let mut levels = self.levels.clone();
        let mut region = region.intersection(Rect::of(image.size()));
        levels[0].touch(region);
        for index in 1..levels.len() {
            let (finer, coarser) = levels.split_at_mut(index);
            let (last, level) = (&finer[index - 1], &mut coarser[0]);
            let (left, top) = (region.col / 2, region.row / 2);
            let width = region.right().div_ceil(2).min(level.width) - left.min(level.width);
            let height = region.bottom().div_ceil(2).min(level.height) - top.min(level.height);
            region = Rect::new(left, top, width, height);
            for row in top..top + height {
                let out = &mut level.row_mut(row)[left..][..width];
                if index == 1 {
                    let pair = Rect::new(2 * left, 2 * row, 2 * width, 2);
                    let pair = drawn(image, pair, self.exposure);
                    halve_rows(pair.split_at(2 * width), out);
                } else {
                    let of = |row: usize| &last.row(row)[2 * left..][..2 * width];
                    halve_rows((of(2 * row), of(2 * row + 1)), out);
                }
            }
            level.touch(region);
        }
        Self {
            picture,
            levels,
            ..*self
        }
    }

    /// The picture.
    pub fn picture(&self) -> &Arc<Picture> {
        &self.picture
    }

    /// The exposure in stops.
    pub fn exposure(&self) -> f32 {
        self.exposure
    }

    /// Columns and rows in the coordinates of the document.
    pub fn size(&self) -> [usize; 2] {
        self.size
    }

    /// Number of sizes.
    pub fn levels(&self) -> usize {
        self.levels.len()
    }

    /// Columns and rows of a level.
    pub fn level_size(&self, level: usize) -> [usize; 2] {
        [self.levels[level].width, self.levels[level].height]
    }

    /// The smallest size that shows a picture at `zoom` screen pixels a pixel without blur.
    pub fn level_for(&self, zoom: f32) -> usize {
        let wanted = zoom * self.size[0] as f32;
        let sharp = |level: &Level| level.width as f32 >= wanted - 1.0;
        self.levels.iter().rposition(sharp).unwrap_or(0)
    }

    /// Columns and rows of the tiles of a level.
    pub fn tiles(&self, level: usize) -> [usize; 2] {
        let level = &self.levels[level];
        [level.width.div_ceil(TILE), level.height.div_ceil(TILE)]
    }

    /// The state of a tile, which changes with its pixels.
    pub fn stamp(&self, tile: TileIndex) -> u64 {
        let columns = self.tiles(tile.level)[0];
        self.levels[tile.level].stamps[tile.row * columns + tile.col]
    }

    /// The rectangle of a tile in its level: left, top, columns, rows.
    pub fn place(&self, tile: TileIndex) -> [usize; 4] {
        let level = &self.levels[tile.level];
        let (left, top) = (tile.col * TILE, tile.row * TILE);
        [
            left,
            top,
            TILE.min(level.width - left),
            TILE.min(level.height - top),
        ]
    }

    /// The pixels of a tile.
    pub fn tile(&self, tile: TileIndex) -> Tile {
        let [left, top, width, height] = self.place(tile);
        let pixels = if tile.level == 0 {
            let place = Rect::new(left, top, width, height);
            drawn(&self.picture.image, place, self.exposure)
        } else {
            let level = &self.levels[tile.level];
            let rows = (top..top + height).flat_map(|row| {
                let row = &level.row(row)[left..][..width];
                row.iter().copied()
            });
            rows.collect()
        };
        Tile {
            width,
            height,
            pixels,
        }
    }

    /// A pixel of the picture as the screen shows it; `None` outside.
    pub fn pixel(&self, col: usize, row: usize) -> Option<Rgba> {
        let size = self.picture.image.size();
        (col < size.width() && row < size.height()).then(|| {
            drawn(
                &self.picture.image,
                Rect::new(col, row, 1, 1),
                self.exposure,
            )[0]
        })
    }

    /// The stored values of a pixel in words, such as `12 40 255`; `None` outside.
    pub fn values(&self, col: usize, row: usize) -> Option<String> {
        let size = self.picture.image.size();
        if col >= size.width() || row >= size.height() {
            return None;
        }
        Some(with_image!(&self.picture.image, image => format!("{:?}", image[(col, row)].0)))
            .map(|text| text.trim_matches(['[', ']']).replace(',', ""))
    }

    /// All pixels as the screen shows them, row by row.
    pub fn pixels(&self) -> Vec<Rgba> {
        drawn(
            &self.picture.image,
            Rect::of(self.picture.image.size()),
            self.exposure,
        )
    }

    /// Bytes of the smaller sizes.
    pub fn bytes(&self) -> usize {
        let bands = self.levels.iter().flat_map(|level| &level.bands);
        bands.map(|band| 4 * band.len()).sum()
    }
}

impl Level {
    fn new(width: usize, height: usize, bands: Vec<Arc<Vec<Rgba>>>) -> Self {
        let stamp = next_stamp();
        Self {
            width,
            height,
            bands,
            stamps: vec![stamp; width.div_ceil(TILE) * height.div_ceil(TILE)],
        }
    }

    fn row(&self, row: usize) -> &[Rgba] {
        &self.bands[row / BAND][row % BAND * self.width..][..self.width]
    }

    fn row_mut(&mut self, row: usize) -> &mut [Rgba] {
        let band = Arc::make_mut(&mut self.bands[row / BAND]);
        &mut band[row % BAND * self.width..][..self.width]
    }

    /// Marks the tiles that a region meets as changed.
    fn touch(&mut self, region: Rect) {
        if region.is_empty() {
            return;
        }
        let (stamp, columns) = (next_stamp(), self.width.div_ceil(TILE));
        for row in region.row / TILE..region.bottom().div_ceil(TILE) {
            for col in region.col / TILE..region.right().div_ceil(TILE) {
                self.stamps[row * columns + col] = stamp;
            }
        }
    }
}

/// A part of a picture as the screen shows it.
fn drawn(image: &AnyImage, place: Rect, exposure: f32) -> Vec<Rgba> {
    // 8 bits are on the screen what they are in the file
    match image {
        AnyImage::Srgb8(image) if exposure == 0.0 => {
            cut(image, place, |&Srgb([r, g, b])| [r, g, b, u8::MAX])
        }
        AnyImage::Srgba8(image) if exposure == 0.0 => cut(image, place, |pixel| pixel.0),
        image => {
            let gain = exposure.exp2();
            with_image!(image, image => cut(image, place, |pixel| {
                let LinearRgba([r, g, b, alpha]) = pixel.to_linear();
                Srgba::<u8>::from_linear(LinearRgba([gain * r, gain * g, gain * b, alpha])).0
            }))
        }
    }
}

/// The pixels of a part, row by row.
fn cut<P: Pixel>(image: &Image<P>, place: Rect, draw: impl Fn(&P) -> Rgba) -> Vec<Rgba> {
    let mut pixels = Vec::with_capacity(place.pixels());
    for row in place.row..place.bottom() {
        pixels.extend(image.row(row)[place.col..place.right()].iter().map(&draw));
    }
    pixels
}

/// The means of 2 × 2 pixels of two rows.
fn halve_rows((upper, lower): (&[Rgba], &[Rgba]), out: &mut [Rgba]) {
    let pairs = upper.chunks_exact(2).zip(lower.chunks_exact(2));
    for (out, (a, b)) in out.iter_mut().zip(pairs) {
        *out = std::array::from_fn(|k| {
            let sum = [a[0], a[1], b[0], b[1]].map(|pixel| u16::from(pixel[k]));
            ((sum.iter().sum::<u16>() + 2) / 4) as u8
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ravec::raster::Size;

    fn picture(image: impl Into<AnyImage>) -> Arc<Picture> {
        Arc::new(Picture::from_image(image.into()))
    }

    fn stripes(size: Size) -> Arc<Picture> {
        let image = Image::from_fn(size, |col, _| {
            Srgb([if col % 2 == 0 { 100u8 } else { 200 }; 3])
        });
        picture(image)
    }

    #[test]
    fn sizes_halve_and_keep_the_mean() {
        let shown = Shown::new(stripes(Size::new(300, 200).unwrap()));
        assert_eq!(shown.levels(), 2);
        let coarse = TileIndex {
            level: 1,
            col: 0,
            row: 0,
        };
        assert_eq!(shown.tile(coarse).pixels[0], [150, 150, 150, 255]);
        let levels = [1.0, 0.5, 0.01].map(|zoom| shown.level_for(zoom));
        assert_eq!(levels, [0, 1, 1]);
        assert_eq!(shown.values(1, 0).unwrap(), "200 200 200");
        assert!(shown.values(300, 0).is_none());
    }

    #[test]
    fn a_change_touches_the_tiles_of_its_region_and_gives_what_a_new_start_gives() {
        let size = Size::new(1400, 1101).unwrap();
        let shown = Shown::new(stripes(size));
        let region = Rect::new(600, 301, 55, 49);
        let changed = Image::from_fn(size, |col, row| {
            let grey = if col % 2 == 0 { 100u8 } else { 200 };
            Srgb(if region.contains(col, row) {
                [grey, 7, 9]
            } else {
                [grey; 3]
            })
        });
        let changed = picture(changed);
        let patched = shown.changed(changed.clone(), region);
        let fresh = Shown::new(changed);
        for level in 0..fresh.levels() {
            let [columns, rows] = fresh.tiles(level);
            for (col, row) in (0..columns).flat_map(|col| (0..rows).map(move |row| (col, row))) {
                let tile = TileIndex { level, col, row };
                assert_eq!(
                    patched.tile(tile).pixels,
                    fresh.tile(tile).pixels,
                    "{tile:?}"
                );
                let same = patched.stamp(tile) == shown.stamp(tile);
                let equal = shown.tile(tile).pixels == fresh.tile(tile).pixels;
                assert!(!same || equal, "{tile:?} is not marked as changed");
            }
        }
        let far = TileIndex {
            level: 0,
            col: 0,
            row: 2,
        };
        assert_eq!(patched.stamp(far), shown.stamp(far));
    }

    #[test]
    fn exposure_doubles_the_light_with_each_stop() {
        let image = Image::new(Size::new(4, 4).unwrap(), LinearRgba([0.1, 0.2, 0.3, 1.0]));
        let shown = Shown::exposed(picture(image), 1.0);
        let twice = Image::new(Size::new(1, 1).unwrap(), LinearRgba([0.2, 0.4, 0.6, 1.0]));
        let expected: Image<Srgba<u8>> = twice.convert();
        assert_eq!(shown.pixel(0, 0).unwrap(), expected[(0, 0)].0);
    }
}

//! A photo as it stands in a tile: scaled, cropped on request, and nothing else.

use crate::descriptor::Frame;
use ravec_raster::{Image, ResizeFilter, Size, Srgb, resize};
use std::borrow::Cow;

/// Treatment of photos whose proportions are not those of the tile.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(rename_all = "kebab-case")
)]
pub enum Crop {
    /// They are not used.
    ///
    /// Only photos of the tile's proportions are, which are neither cropped nor distorted.
    #[default]
    Never,
    /// Their middle is used.
    ///
    /// It is the largest part there that has the proportions of the tile.
    Center,
}

/// Largest difference of the proportions of photo and tile without a crop. A photo of 160 × 107 pixels is a tile of 3:2 that
/// was rounded; 4:3 is another class than 3:2, which is 12 % away.
pub const SAME_PROPORTIONS: f64 = 0.03;

impl Crop {
    /// The part of a photo of the given size that a tile of the given proportions (width by height) shows: none if the photo
    /// does not fit.
    pub fn frame(self, photo: Size, aspect: f64) -> Option<Frame> {
        let (width, height) = (photo.width() as f64, photo.height() as f64);
        match self {
            Self::Center => Some(Frame::centered(width, height, aspect)),
            Self::Never if ((width / height) / aspect).ln().abs() <= SAME_PROPORTIONS => {
                Some(Frame {
                    left: 0.0,
                    top: 0.0,
                    width,
                    height,
                })
            }
            Self::Never => None,
        }
    }
}

/// The photo scaled to the size of a tile: of the frame that [`Crop::frame`] gives, in whole pixels, resampled in linear
/// light by a box where it shrinks. None if the photo does not fit the tile.
///
/// ```
/// use ravec_mosaic::{Crop, scaled_photo};
/// use ravec_raster::{Image, Size, Srgb};
///
/// let photo = Image::new(Size::new(30, 20)?, Srgb([9u8, 8, 7]));
/// let tile = Size::new(10, 10)?;
/// assert!(scaled_photo(&photo, tile, Crop::Never).is_none());
/// assert_eq!(scaled_photo(&photo, tile, Crop::Center).unwrap()[(3, 3)], Srgb([9, 8, 7]));
/// # Ok::<(), ravec_raster::SizeError>(())
/// ```
pub fn scaled_photo(photo: &Image<Srgb<u8>>, tile: Size, crop: Crop) -> Option<Image<Srgb<u8>>> {
    let aspect = tile.width() as f64 / tile.height() as f64;
    let frame = crop.frame(photo.size(), aspect)?;
    let side = |length: f64, most: usize| (length.round() as usize).clamp(1, most);
    let size = Size::new(
        side(frame.width, photo.width()),
        side(frame.height, photo.height()),
    );
    let size = size.ok()?;
    let cut = if size == photo.size() {
        Cow::Borrowed(photo)
    } else {
        let cut = photo.crop(frame.left as usize, frame.top as usize, size);
        Cow::Owned(cut.ok()?)
    };
    let shrinks = tile.width() < cut.width() && tile.height() < cut.height();
    let filter = if shrinks {
        ResizeFilter::Box
    } else {
        ResizeFilter::CatmullRom
    };
    Some(resize(&cut, tile, filter))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn size(width: usize, height: usize) -> Size {
        Size::new(width, height).unwrap()
    }

    #[test]
    fn a_tile_of_the_photos_size_is_the_photo() {
        let photo = Image::from_fn(size(30, 20), |col, row| {
            Srgb([col as u8, row as u8, (col * row % 256) as u8])
        });
        assert_eq!(
            scaled_photo(&photo, size(30, 20), Crop::Never),
            Some(photo.clone())
        );
        let middle = photo.crop(5, 0, size(20, 20)).unwrap();
        assert_eq!(
            scaled_photo(&photo, size(20, 20), Crop::Center),
            Some(middle)
        );
    }

    #[test]
    fn proportions_must_agree_unless_cropping_is_asked_for() {
        assert!(Crop::Never.frame(size(160, 107), 1.5).is_some());
        assert!(Crop::Never.frame(size(160, 120), 1.5).is_none());
        let frame = Crop::Center.frame(size(160, 120), 1.5).unwrap();
        assert!((frame.height - 160.0 / 1.5).abs() < 1e-9 && frame.left == 0.0);
    }
}

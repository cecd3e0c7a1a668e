//! Lens data of an EXIF block.
//!
//! The focal length is needed where rays count, as when a wall is to be seen from straight on. Cameras write it as the one that
//! a camera for 35 mm film would need for the same view, which with the size of the picture is all one has to know.
//!
//! Source: CIPA DC-008, "Exchangeable image file format for digital still cameras", tag `FocalLengthIn35mmFilm`.
//!
//! Does not guarantee: that the picture was not cropped since.

use crate::picture::Origin;
use exif::{In, Reader, Tag};

/// The diagonal of a picture on 35 mm film, in millimeters: 36 × 24.
const FILM_DIAGONAL_MM: f64 = 43.266_615_305_567_87;

impl Origin {
    /// The focal length in millimeters that gives the same view on 35 mm film, if the EXIF block says so.
    pub fn focal_35mm(&self) -> Option<f64> {
        let exif = Reader::new().read_raw(self.exif.as_ref()?.to_vec()).ok()?;
        let field = exif.get_field(Tag::FocalLengthIn35mmFilm, In::PRIMARY)?;
        // 0 means unknown
        field.value.get_uint(0).filter(|&mm| mm > 0).map(f64::from)
    }
}

/// The focal length in pixels of a picture of `width` × `height` pixels, from the one for 35 mm film in millimeters.
///
/// Pictures of other proportions are compared by their diagonals.
pub fn focal_px_from_35mm(focal_mm: f64, width: usize, height: usize) -> f64 {
    focal_mm / FILM_DIAGONAL_MM * (width as f64).hypot(height as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::Picture;
    use ravec_raster::{Image, Size, Srgb};

    /// A little-endian block with one entry, the focal length, in its EXIF part.
    fn block(tag: u16, value: u16) -> Vec<u8> {
        let entry = |tag: u16, kind: u16, value: u32| {
            let mut bytes = Vec::new();
            bytes.extend(tag.to_le_bytes());
            bytes.extend(kind.to_le_bytes());
            bytes.extend(1u32.to_le_bytes());
            bytes.extend(value.to_le_bytes());
            bytes
        };
        let part = |entry: Vec<u8>| {
            let mut bytes = 1u16.to_le_bytes().to_vec();
            bytes.extend(entry);
            bytes.extend(0u32.to_le_bytes());
            bytes
        };
        let mut bytes = b"II*\0".to_vec();
        bytes.extend(8u32.to_le_bytes());
        bytes.extend(part(entry(0x8769, 4, 26)));
        bytes.extend(part(entry(tag, 3, u32::from(value))));
        bytes
    }

    fn focal(exif: Option<Vec<u8>>) -> Option<f64> {
        let image = Image::new(Size::new(1, 1).unwrap(), Srgb([0u8; 3]));
        let mut picture = Picture::from_image(image);
        picture.origin.exif = exif.map(Into::into);
        picture.origin.focal_35mm()
    }

    #[test]
    fn the_focal_length_is_read_from_its_tag() {
        assert_eq!(focal(Some(block(0xa405, 28))), Some(28.0));
        assert_eq!(focal(Some(block(0xa405, 0))), None);
        assert_eq!(focal(Some(block(0xa406, 28))), None);
        assert_eq!(focal(None), None);
    }

    #[test]
    fn broken_blocks_say_nothing() {
        let whole = block(0xa405, 28);
        for length in 0..whole.len() {
            let found = focal(Some(whole[..length].to_vec()));
            assert!(found.is_none() || length >= whole.len() - 4, "{length}");
        }
    }

    #[test]
    fn a_full_frame_picture_has_as_many_pixels_as_millimeters() {
        assert!((focal_px_from_35mm(36.0, 3600, 2400) - 3600.0).abs() < 1e-6);
    }
}

//! The eight orientations of EXIF.

use image::metadata::Orientation;
use ravec_raster::{AnyImage, Image, Pixel, with_image};

/// The picture turned upright. Half of the orientations need no second image.
pub(crate) fn upright(image: AnyImage, orientation: Orientation) -> AnyImage {
    with_image!(image, image => turned(image, orientation).into())
}

/// Returns `true` if width and height change places.
pub(crate) fn transposes(orientation: Orientation) -> bool {
    orientation.to_exif() >= 5
}

fn turned<P: Pixel>(mut image: Image<P>, orientation: Orientation) -> Image<P> {
    let (width, height) = (image.width(), image.height());
    match orientation {
        Orientation::NoTransforms => image,
        Orientation::Rotate180 => {
            image.pixels_mut().reverse();
            image
        }
        Orientation::FlipHorizontal => {
            for row in 0..height {
                image.row_mut(row).reverse();
            }
            image
        }
        Orientation::FlipVertical => {
            for row in 0..height / 2 {
                let (above, below) = image.pixels_mut().split_at_mut((height - 1 - row) * width);
                above[row * width..][..width].swap_with_slice(&mut below[..width]);
            }
            image
        }
        // the pixel at (col, row) of the result, by its place in the source
        Orientation::Rotate90 => transposed(&image, |col, row| (row, height - 1 - col)),
        Orientation::Rotate270 => transposed(&image, |col, row| (width - 1 - row, col)),
        Orientation::Rotate90FlipH => transposed(&image, |col, row| (row, col)),
        Orientation::Rotate270FlipH => {
            transposed(&image, |col, row| (width - 1 - row, height - 1 - col))
        }
    }
}

fn transposed<P: Pixel>(
    image: &Image<P>,
    source: impl Fn(usize, usize) -> (usize, usize),
) -> Image<P> {
    Image::from_fn(image.size().transposed(), |col, row| {
        image[source(col, row)]
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use ravec_raster::Size;

    /// Places of the stored rows and columns in the upright picture, in the words of the EXIF standard: that of the stored
    /// pixel (0, 0), and that of its right neighbor.
    #[test]
    fn all_eight_orientations_are_those_of_the_standard() {
        let stored = Image::from_fn(Size::new(3, 2).unwrap(), |col, row| (10 * row + col) as u8);
        let expected: [(u8, usize, [u8; 6]); 8] = [
            (1, 3, [0, 1, 2, 10, 11, 12]),
            (2, 3, [2, 1, 0, 12, 11, 10]),
            (3, 3, [12, 11, 10, 2, 1, 0]),
            (4, 3, [10, 11, 12, 0, 1, 2]),
            (5, 2, [0, 10, 1, 11, 2, 12]),
            (6, 2, [10, 0, 11, 1, 12, 2]),
            (7, 2, [12, 2, 11, 1, 10, 0]),
            (8, 2, [2, 12, 1, 11, 0, 10]),
        ];
        for (exif, width, pixels) in expected {
            let orientation = Orientation::from_exif(exif).unwrap();
            let image = turned(stored.clone(), orientation);
            assert_eq!(
                (image.width(), image.pixels()),
                (width, &pixels[..]),
                "{exif}"
            );
            assert_eq!(transposes(orientation), width == 2);
        }
    }

    #[test]
    fn turning_there_and_back_changes_nothing() {
        let stored = Image::from_fn(Size::new(5, 4).unwrap(), |col, row| (10 * row + col) as u8);
        for exif in 1..=8 {
            let there = turned(stored.clone(), Orientation::from_exif(exif).unwrap());
            let back = if exif == 6 {
                8
            } else if exif == 8 {
                6
            } else {
                exif
            };
            assert_eq!(turned(there, Orientation::from_exif(back).unwrap()), stored);
        }
    }
}

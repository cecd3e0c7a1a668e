//! The small pictures of the catalogue, and the pixels that photos are seen by.

use ravec_raster::color::srgb_from_linear;
use ravec_raster::{
    AnyImage, Color, Image, LinearRgb, LinearRgba, PremulLinearRgba, Sample as _, Srgb, with_image,
};
use std::sync::LazyLock;

/// The longer side of the small pictures, which looks are taken from. A polynomial of degree 5 has at most 6 halves of waves;
/// 36 pixels give each 6, and roots for more pixels would take longer than decoding.
pub(crate) const THUMBNAIL: usize = 36;

/// Pixels of a photo in 8 bits, on white where it is transparent.
pub(crate) fn opaque(picture: AnyImage) -> Image<Srgb<u8>> {
    match picture {
        AnyImage::Srgb8(image) => image,
        picture => with_image!(&picture, image => opaque_image(image)),
    }
}

fn opaque_image<P: Color>(image: &Image<P>) -> Image<Srgb<u8>> {
    if !P::HAS_ALPHA {
        return image.convert();
    }
    image.map(|pixel| {
        let LinearRgb([r, g, b]) = on_white(pixel);
        Srgb::from_linear(LinearRgba([r, g, b, 1.0]))
    })
}

/// Pixels of a picture in linear light, on white where it is transparent.
pub(crate) fn light(picture: &AnyImage) -> Image<LinearRgb> {
    with_image!(picture, image => image.map(on_white))
}

fn on_white<P: Color>(pixel: P) -> LinearRgb {
    let color = pixel.to_linear();
    if !P::HAS_ALPHA {
        return LinearRgb(color.rgb());
    }
    let PremulLinearRgba([r, g, b, alpha]) = PremulLinearRgba::from_linear(color);
    let rest = 1.0 - alpha;
    LinearRgb([r + rest, g + rest, b + rest])
}

/// The small picture of a photo: its means in linear light, at most [`THUMBNAIL`] pixels on a side. Takes no memory in
/// proportion to the photo.
pub(crate) fn thumbnail(picture: &AnyImage) -> Image<Srgb<u8>> {
    with_image!(picture, image => means(image))
}

fn means<P: Color>(image: &Image<P>) -> Image<Srgb<u8>> {
    let (width, height) = (image.width(), image.height());
    let factor = THUMBNAIL as f64 / width.max(height) as f64;
    if factor >= 1.0 {
        return opaque_image(image);
    }
    let side = |pixels: usize| ((pixels as f64 * factor).round() as usize).max(1);
    let (across, down) = (
        Shares::new(width, side(width)),
        Shares::new(height, side(height)),
    );
    let mut sums = vec![[0.0f64; 3]; across.cells * down.cells];
    let mut line = vec![[0.0f64; 3]; across.cells];
    for (row, pixels) in image.rows().enumerate() {
        line.fill([0.0; 3]);
        for (col, &pixel) in pixels.iter().enumerate() {
            let light = on_white(pixel).0.map(f64::from);
            for (cell, share) in across.of(col) {
                for (sum, light) in line[cell].iter_mut().zip(light) {
                    *sum += share * light;
                }
            }
        }
        for (cell, share) in down.of(row) {
            for (sums, line) in sums[cell * across.cells..].iter_mut().zip(&line) {
                for (sum, light) in sums.iter_mut().zip(line) {
                    *sum += share * light;
                }
            }
        }
    }
    let pixels = sums
        .into_iter()
        .map(|sum| Srgb(sum.map(|light| encoded(light as f32))));
    Image::from_vec(across.cells, pixels.collect())
        .expect("there is a whole number of rows, at least one")
}

/// A line of pixels in fewer cells of equal length.
struct Shares {
    pixels: usize,
    cells: usize,
}

impl Shares {
    fn new(pixels: usize, cells: usize) -> Self {
        Self { pixels, cells }
    }

    /// The one or two cells in which a pixel lies, and its share of the mean of each.
    fn of(&self, pixel: usize) -> impl Iterator<Item = (usize, f64)> + use<> {
        // in parts, of which a pixel has as many as there are cells, and a cell as many as there are pixels
        let (begin, end) = (pixel * self.cells, (pixel + 1) * self.cells);
        let first = begin / self.pixels;
        let border = ((first + 1) * self.pixels).min(end);
        let whole = self.pixels as f64;
        let second = (end > border).then(|| (first + 1, (end - border) as f64 / whole));
        std::iter::once((first, (border - begin) as f64 / whole)).chain(second)
    }
}

/// The encoded value of linear light, within one step.
pub(crate) fn encoded(light: f32) -> u8 {
    let steps = (ENCODED.len() - 1) as f32;
    ENCODED[(light.clamp(0.0, 1.0) * steps + 0.5) as usize]
}

/// Encoded values of linear light in steps of a 4096th: within one step of the exact ones, without their roots.
static ENCODED: LazyLock<Vec<u8>> = LazyLock::new(|| {
    (0..=4096u16)
        .map(|light| u8::from_unit(srgb_from_linear(f32::from(light) / 4096.0)))
        .collect()
});

#[cfg(test)]
mod tests {
    use super::*;
    use ravec_raster::{ResizeFilter, Size, Srgba, resize};

    /// The plain definition: the mean over the part of each pixel that lies in a cell.
    fn mean(light: &Image<LinearRgb>, size: Size, col: usize, row: usize) -> [f64; 3] {
        let cell = |at: usize, pixels: usize, cells: usize| {
            let length = pixels as f64 / cells as f64;
            (at as f64 * length, (at + 1) as f64 * length)
        };
        let shared = |at: usize, (begin, end): (f64, f64)| {
            ((at + 1) as f64).min(end) - (at as f64).max(begin)
        };
        let (across, down) = (
            cell(col, light.width(), size.width()),
            cell(row, light.height(), size.height()),
        );
        let (mut sum, mut area) = ([0.0; 3], 0.0);
        for y in 0..light.height() {
            for x in 0..light.width() {
                let part = shared(x, across).max(0.0) * shared(y, down).max(0.0);
                area += part;
                for (sum, light) in sum.iter_mut().zip(light[(x, y)].0) {
                    *sum += part * f64::from(light);
                }
            }
        }
        sum.map(|sum| sum / area)
    }

    #[test]
    fn a_small_picture_has_the_means_of_the_photo() {
        for (width, height) in [(100, 75), (37, 36), (36, 36), (500, 1), (1, 90), (41, 200)] {
            let size = Size::new(width, height).unwrap();
            let photo = Image::from_fn(size, |col, row| {
                Srgb([
                    (col * 255 / width) as u8,
                    (row * 7) as u8,
                    (col * row) as u8,
                ])
            });
            let small = thumbnail(&photo.clone().into());
            assert!(small.width() <= THUMBNAIL && small.height() <= THUMBNAIL);
            let light: Image<LinearRgb> = photo.convert();
            for row in 0..small.height() {
                for col in 0..small.width() {
                    let truth = mean(&light, small.size(), col, row);
                    for (&small, truth) in small[(col, row)].0.iter().zip(truth) {
                        // sums in another order may fall on the other side of a step, and so may a table of 4096
                        let step = i32::from(small) - i32::from(encoded(truth as f32));
                        assert!(step.abs() <= 1, "{width} x {height}: {small} {truth}");
                    }
                }
            }
        }
    }

    #[test]
    fn a_small_picture_of_whole_cells_is_that_of_a_box() {
        let size = Size::new(360, 180).unwrap();
        let photo = Image::from_fn(size, |col, row| Srgb([col as u8, row as u8, 9]));
        let small = thumbnail(&photo.clone().into());
        let truth = resize(&photo, small.size(), ResizeFilter::Box);
        for (small, truth) in small.pixels().iter().zip(truth.pixels()) {
            assert!(small.0.iter().zip(truth.0).all(|(a, b)| a.abs_diff(b) <= 1));
        }
    }

    #[test]
    fn what_is_transparent_is_seen_on_white() {
        let size = Size::new(50, 50).unwrap();
        let glass: AnyImage = Image::new(size, Srgba([0u8, 200, 0, 0])).into();
        assert_eq!(thumbnail(&glass).pixels()[0], Srgb([255; 3]));
        assert_eq!(light(&glass).pixels()[0], LinearRgb([1.0; 3]));
        assert_eq!(opaque(glass).pixels()[0], Srgb([255; 3]));
        let solid: AnyImage = Image::new(size, Srgba([9u8, 200, 0, 255])).into();
        assert_eq!(opaque(solid).pixels()[0], Srgb([9, 200, 0]));
    }
}

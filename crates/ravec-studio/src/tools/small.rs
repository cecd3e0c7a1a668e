//! Small copies of pictures, for quick results.

use ravec::raster::{
    AnyImage, Color, Image, Resample, ResizeFilter, Size, Srgba, resize, with_image,
};
use ravec_media::Picture;

/// A copy of at most `max_side` pixels a side, in 8 bits, and its size by that of the picture.
pub(super) fn small_copy(picture: &Picture, max_side: f64) -> (Picture, [f64; 2]) {
    let size = picture.image.size();
    let small = with_image!(&picture.image, image => reduced(image, max_side));
    let scale = [
        small.size().width() as f64 / size.width() as f64,
        small.size().height() as f64 / size.height() as f64,
    ];
    (picture.with_pixels(small), scale)
}

fn reduced<P: Color + Resample>(image: &Image<P>, max_side: f64) -> AnyImage {
    let (width, height) = (image.width() as f64, image.height() as f64);
    let scale = (max_side / width.max(height)).min(1.0);
    let side = |length: f64| (scale * length).round().max(1.0) as usize;
    let size = Size::new(side(width), side(height)).unwrap_or(image.size());
    let small: Image<Srgba<u8>> = resize(image, size, ResizeFilter::default()).convert();
    small.into()
}

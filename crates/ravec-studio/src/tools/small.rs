//! Small copies of pictures, for quick results.

use ravec::raster::{
    AnyImage, Color, Image, Resample, ResizeFilter, Size, Srgba, resize, with_image,
};
use ravec_media::Picture;

/// Maximum side of a small copy in pixels.
pub(super) const SMALL_SIDE: f64 = 1000.0;

/// A copy of at most [`SMALL_SIDE`] pixels a side, in 8 bits, and its size by that of the picture.
pub(super) fn small_copy(picture: &Picture) -> (Picture, [f64; 2]) {
    let size = picture.image.size();
    let small = with_image!(&picture.image, image => reduced(image));
    let scale = [
        small.size().width() as f64 / size.width() as f64,
        small.size().height() as f64 / size.height() as f64,
    ];
    (picture.with_pixels(small), scale)
}

fn reduced<P: Color + Resample>(image: &Image<P>) -> AnyImage {
    let (width, height) = (image.width() as f64, image.height() as f64);
    let scale = (SMALL_SIDE / width.max(height)).min(1.0);
    let side = |length: f64| (scale * length).round().max(1.0) as usize;
    let size = Size::new(side(width), side(height)).unwrap_or(image.size());
    let small: Image<Srgba<u8>> = resize(image, size, ResizeFilter::default()).convert();
    small.into()
}

//! The samples that go into a file: the picture in the target's color space, sample kind and channels.

use crate::curve::Stored;
use crate::format::Format;
use crate::picture::{Picture, SampleKind, Warning};
use crate::profile::{self, Profile, product};
use crate::samples::Samples;
use crate::standard;
use crate::write::{ProfileChoice, WriteOptions};
use image::ExtendedColorType;
use ravec_raster::{
    AnyImage, Color, Image, LinearRgb, LinearRgba, Pixel, PremulLinearRgba, Size, Srgb, Srgba,
};
use rayon::prelude::*;
use std::borrow::Cow;

/// Samples ready to be encoded.
pub(crate) struct Raster<'a> {
    pub(crate) size: Size,
    data: Data<'a>,
    pub(crate) color: ExtendedColorType,
    pub(crate) icc: Option<Cow<'a, [u8]>>,
}

/// The picture's own samples where they can be used as they are.
enum Data<'a> {
    Borrowed(&'a [u8]),
    Made(Samples),
}

impl<'a> Raster<'a> {
    pub(crate) fn bytes(&self) -> &[u8] {
        match &self.data {
            Data::Borrowed(bytes) => bytes,
            Data::Made(samples) => samples.as_bytes(),
        }
    }

    pub(crate) fn new(
        picture: &'a Picture,
        format: Format,
        options: &WriteOptions,
        warnings: &mut Vec<Warning>,
    ) -> Self {
        let mut image = Cow::Borrowed(&picture.image);
        if !format.has_alpha() && image.has_alpha() {
            if !is_opaque(&image) {
                warnings.push(Warning::AlphaFlattened { format });
            }
            image = Cow::Owned(flattened(&image, options.background));
        }
        let wanted = options.sample.unwrap_or(picture.origin.sample);
        let kept = (options.profile == ProfileChoice::Keep && format.has_profile())
            .then_some(picture.origin.icc.as_deref())
            .flatten()
            .and_then(|icc| Some((Profile::parse(icc).ok()?, icc)));
        let job = Job {
            size: image.size(),
            alpha: image.has_alpha(),
            gray: picture.origin.gray && format.has_gray(image.has_alpha()),
            embeds: format.has_profile(),
            kept,
        };
        match format.nearest_sample(wanted) {
            SampleKind::U8 => job.integers::<u8>(image),
            SampleKind::U16 => job.integers::<u16>(image),
            SampleKind::F32 => job.floats(&image, format),
        }
    }
}

struct Job<'a> {
    size: Size,
    alpha: bool,
    /// `true` if one channel is to be used if every pixel allows it.
    gray: bool,
    /// `true` if the format says its color space.
    embeds: bool,
    /// The source's profile.
    kept: Option<(Profile, &'a [u8])>,
}

impl<'a> Job<'a> {
    fn integers<T: Integer>(self, image: Cow<'a, AnyImage>) -> Raster<'a> {
        if let Some((profile, icc)) = &self.kept
            && let Some(raster) = self.in_profile::<T>(&image, profile, icc)
        {
            return raster;
        }
        // colors take three samples a pixel or four, whatever the type they come in
        let samples: Cow<'a, [T]> = match image {
            Cow::Borrowed(image) => T::samples(image, self.alpha),
            Cow::Owned(image) => Cow::Owned(T::samples(&image, self.alpha).into_owned()),
        };
        let stride = 3 + usize::from(self.alpha);
        let gray = self.gray && all_gray(&samples, stride);
        let icc: Cow<'a, [u8]> = match &self.kept {
            // sRGB by the source's own profile; one for gray does not suit colors
            Some((Profile::Srgb, icc)) if gray || !profile::is_gray(icc) => Cow::Borrowed(*icc),
            _ if gray => Cow::Borrowed(standard::GREY_SRGB.as_slice()),
            _ => Cow::Borrowed(standard::SRGB.as_slice()),
        };
        let samples = if gray {
            Cow::Owned(first_channels(&samples, stride, self.alpha))
        } else {
            samples
        };
        self.raster(samples, gray, Some(icc))
    }

    /// The picture in the source's own space, if there is a way there.
    fn in_profile<T: Integer>(
        &self,
        image: &AnyImage,
        profile: &Profile,
        icc: &'a [u8],
    ) -> Option<Raster<'a>> {
        let pixels = image.convert::<LinearRgba>();
        if matches!(profile, Profile::Gray(_)) {
            let gray = |pixel: &LinearRgba| {
                let [r, g, b] = pixel.rgb();
                r == g && g == b
            };
            if !self.gray || !pixels.pixels().par_iter().with_min_len(1 << 14).all(gray) {
                return None;
            }
            let samples = profile.numbers_from_linear::<T>(&pixels)?;
            let samples = with_alpha(samples, &pixels, 1, self.alpha);
            return Some(self.raster(Cow::Owned(samples), true, Some(Cow::Borrowed(icc))));
        }
        let samples = with_alpha(
            profile.numbers_from_linear::<T>(&pixels)?,
            &pixels,
            3,
            self.alpha,
        );
        let stride = 3 + usize::from(self.alpha);
        let gray = self.gray && all_gray(&samples, stride);
        let samples = if gray {
            first_channels(&samples, stride, self.alpha)
        } else {
            samples
        };
        Some(self.raster(Cow::Owned(samples), gray, Some(Cow::Borrowed(icc))))
    }

    fn floats(self, image: &AnyImage, format: Format) -> Raster<'a> {
        let mut icc = Cow::Borrowed(standard::LINEAR_SRGB.as_slice());
        let mut pixels = image.convert::<LinearRgba>();
        if let Some((profile, kept)) = &self.kept
            && let Some(device_from_linear) = profile.linear_space()
        {
            icc = Cow::Borrowed(*kept);
            pixels = pixels.map(|pixel| {
                let rgb = product(&device_from_linear, pixel.rgb().map(f64::from));
                LinearRgba::from_rgb_alpha(rgb.map(|v| v as f32), pixel.alpha())
            });
        }
        let samples: Vec<f32> = match (self.alpha, format) {
            (true, Format::OpenExr) => cast(pixels.convert::<PremulLinearRgba>().into_pixels()),
            (true, _) => cast(pixels.into_pixels()),
            (false, _) => cast(pixels.convert::<LinearRgb>().into_pixels()),
        };
        self.raster(Cow::Owned(samples), false, Some(icc))
    }

    fn raster<T: Stored>(
        &self,
        samples: Cow<'a, [T]>,
        gray: bool,
        icc: Option<Cow<'a, [u8]>>,
    ) -> Raster<'a> {
        let color = match (size_of::<T>(), gray, self.alpha) {
            (1, true, false) => ExtendedColorType::L8,
            (1, true, true) => ExtendedColorType::La8,
            (1, false, false) => ExtendedColorType::Rgb8,
            (1, false, true) => ExtendedColorType::Rgba8,
            (2, true, false) => ExtendedColorType::L16,
            (2, true, true) => ExtendedColorType::La16,
            (2, false, false) => ExtendedColorType::Rgb16,
            (2, false, true) => ExtendedColorType::Rgba16,
            (_, _, false) => ExtendedColorType::Rgb32F,
            (_, _, true) => ExtendedColorType::Rgba32F,
        };
        Raster {
            size: self.size,
            data: match samples {
                Cow::Borrowed(samples) => Data::Borrowed(bytemuck::cast_slice(samples)),
                Cow::Owned(samples) => Data::Made(T::wrap(samples)),
            },
            color,
            icc: icc.filter(|icc| self.embeds && !icc.is_empty()),
        }
    }
}

/// The integers of files, and the images that hold them.
trait Integer: Stored {
    /// The samples of the image in encoded sRGB; borrowed if it has them.
    fn samples(image: &AnyImage, alpha: bool) -> Cow<'_, [Self]>;
}

impl Integer for u8 {
    fn samples(image: &AnyImage, alpha: bool) -> Cow<'_, [Self]> {
        match (image, alpha) {
            (AnyImage::Srgb8(image), false) => Cow::Borrowed(bytemuck::cast_slice(image.pixels())),
            (AnyImage::Srgba8(image), true) => Cow::Borrowed(bytemuck::cast_slice(image.pixels())),
            (image, false) => Cow::Owned(cast(image.convert::<Srgb<Self>>().into_pixels())),
            (image, true) => Cow::Owned(cast(image.convert::<Srgba<Self>>().into_pixels())),
        }
    }
}

impl Integer for u16 {
    fn samples(image: &AnyImage, alpha: bool) -> Cow<'_, [Self]> {
        match (image, alpha) {
            (AnyImage::Srgb16(image), false) => Cow::Borrowed(bytemuck::cast_slice(image.pixels())),
            (AnyImage::Srgba16(image), true) => Cow::Borrowed(bytemuck::cast_slice(image.pixels())),
            (image, false) => Cow::Owned(cast(image.convert::<Srgb<Self>>().into_pixels())),
            (image, true) => Cow::Owned(cast(image.convert::<Srgba<Self>>().into_pixels())),
        }
    }
}

fn cast<P: Pixel, T: Stored>(pixels: Vec<P>) -> Vec<T> {
    bytemuck::allocation::try_cast_vec(pixels)
        .unwrap_or_else(|(_, pixels)| bytemuck::allocation::pod_collect_to_vec(&pixels))
}

fn is_opaque(image: &AnyImage) -> bool {
    ravec_raster::with_image!(image, image => image.is_opaque())
}

/// The picture on a plain background, blended in linear light. Opaque pixels keep their integer values.
fn flattened(image: &AnyImage, background: Srgb<u8>) -> AnyImage {
    let background = background.to_linear();
    let over = |pixel: LinearRgba| {
        let alpha = pixel.alpha();
        let rgb = std::array::from_fn(|i| pixel.0[i] * alpha + background.0[i] * (1.0 - alpha));
        LinearRgb(rgb)
    };
    let image: Image<LinearRgb> =
        ravec_raster::with_image!(image, image => image.map(|pixel| over(pixel.to_linear())));
    image.into()
}

fn all_gray<T: Stored>(samples: &[T], stride: usize) -> bool {
    samples
        .par_chunks_exact(stride)
        .with_min_len(1 << 14)
        .all(|pixel| pixel[0] == pixel[1] && pixel[1] == pixel[2])
}

fn first_channels<T: Stored>(samples: &[T], stride: usize, alpha: bool) -> Vec<T> {
    let pixels = samples.chunks_exact(stride);
    if alpha {
        pixels
            .flat_map(|pixel| [pixel[0], pixel[stride - 1]])
            .collect()
    } else {
        pixels.map(|pixel| pixel[0]).collect()
    }
}

/// Puts the alpha of `pixels` behind each `colors` samples, if there is one.
fn with_alpha<T: Stored>(
    samples: Vec<T>,
    pixels: &Image<LinearRgba>,
    colors: usize,
    alpha: bool,
) -> Vec<T> {
    if !alpha {
        return samples;
    }
    let mut all = Vec::with_capacity(samples.len() / colors * (colors + 1));
    for (color, pixel) in samples.chunks_exact(colors).zip(pixels.pixels()) {
        all.extend_from_slice(color);
        all.push(T::from_unit(pixel.alpha()));
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flattening_blends_in_linear_light_and_keeps_opaque_pixels() {
        let pixels = vec![
            Srgba([10u8, 20, 30, 255]),
            Srgba([0, 0, 0, 0]),
            Srgba([0, 0, 0, 128]),
        ];
        let image = AnyImage::from(Image::from_vec(3, pixels).unwrap());
        let flat = flattened(&image, Srgb([255, 255, 0])).convert::<Srgb<u8>>();
        assert_eq!(flat[(0, 0)], Srgb([10, 20, 30]));
        assert_eq!(flat[(1, 0)], Srgb([255, 255, 0]));
        // 127/255 of white's light is 187 or 188 in sRGB, not 127
        assert!((187..=188).contains(&flat[(2, 0)].0[0]));
    }

    #[test]
    fn channels_are_dropped_and_added_in_place() {
        assert!(all_gray(&[1u8, 1, 1, 9, 2, 2, 2, 8], 4));
        assert!(!all_gray(&[1u8, 1, 1, 2, 3, 2], 3));
        assert_eq!(
            first_channels(&[1u8, 1, 1, 9, 2, 2, 2, 8], 4, true),
            [1, 9, 2, 8]
        );
        assert_eq!(first_channels(&[1u8, 1, 1, 2, 2, 2], 3, false), [1, 2]);
    }
}

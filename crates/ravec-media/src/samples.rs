//! Samples as a decoder gives them, and the images made of them.

use crate::curve::Stored;
use crate::picture::{SampleKind, Warning};
use crate::profile::Profile;
use ravec_raster::{AnyImage, Image, LinearRgb, LinearRgba, Pixel, Size, SizeError, Srgb, Srgba};
use rayon::prelude::*;

/// Replacement for an infinite sample: far beyond any light, and its square and sums of many still are numbers.
const INFINITE: f32 = 1e30;

/// Meaning of the samples of a pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Channels {
    Gray,
    GrayAlpha,
    Rgb,
    Rgba,
    /// Amounts of ink.
    Cmyk,
}

impl Channels {
    pub(crate) fn count(self) -> usize {
        match self {
            Self::Gray => 1,
            Self::GrayAlpha => 2,
            Self::Rgb => 3,
            Self::Rgba | Self::Cmyk => 4,
        }
    }

    pub(crate) fn has_alpha(self) -> bool {
        matches!(self, Self::GrayAlpha | Self::Rgba)
    }

    pub(crate) fn is_gray(self) -> bool {
        matches!(self, Self::Gray | Self::GrayAlpha)
    }
}

/// Decoded samples, pixel by pixel.
pub(crate) enum Samples {
    U8(Vec<u8>),
    U16(Vec<u16>),
    F32(Vec<f32>),
}

impl Samples {
    /// `count` zeros, or the error of a memory that has no room for them.
    pub(crate) fn zeroed(
        kind: SampleKind,
        count: usize,
    ) -> Result<Self, std::collections::TryReserveError> {
        Ok(match kind {
            SampleKind::U8 => Self::U8(zeros(count)?),
            SampleKind::U16 => Self::U16(zeros(count)?),
            SampleKind::F32 => Self::F32(zeros(count)?),
        })
    }

    pub(crate) fn as_bytes(&self) -> &[u8] {
        match self {
            Self::U8(samples) => samples,
            Self::U16(samples) => bytemuck::cast_slice(samples),
            Self::F32(samples) => bytemuck::cast_slice(samples),
        }
    }

    pub(crate) fn as_bytes_mut(&mut self) -> &mut [u8] {
        match self {
            Self::U8(samples) => samples,
            Self::U16(samples) => bytemuck::cast_slice_mut(samples),
            Self::F32(samples) => bytemuck::cast_slice_mut(samples),
        }
    }

    /// Makes floats finite, and reports the number that were not.
    pub(crate) fn make_finite(&mut self) -> Option<Warning> {
        let Self::F32(samples) = self else {
            return None;
        };
        let (nan, infinite) = samples
            .par_iter_mut()
            .with_min_len(1 << 14)
            .map(|sample| {
                let counts = (u64::from(sample.is_nan()), u64::from(sample.is_infinite()));
                *sample = finite(*sample);
                counts
            })
            .reduce(|| (0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
        (nan + infinite > 0).then_some(Warning::NotFinite { nan, infinite })
    }

    /// Straight alpha from premultiplied. Light of pixels that do not cover has no straight color.
    ///
    /// Files multiply the numbers that they store, whatever curve these follow.
    pub(crate) fn unmultiply(&mut self, channels: Channels) -> Option<Warning> {
        let count = channels.count();
        let pixels = match self {
            Self::U8(samples) => unmultiply_pixels(samples, count, |color, alpha| {
                divided(color.into(), alpha.into(), 255) as u8
            }),
            Self::U16(samples) => unmultiply_pixels(samples, count, |color, alpha| {
                divided(color.into(), alpha.into(), 65535) as u16
            }),
            Self::F32(samples) => unmultiply_pixels(samples, count, |color, alpha| {
                // alpha may be so little that the quotient is infinite
                finite(color / alpha)
            }),
        };
        (pixels > 0).then_some(Warning::GlowLost { pixels })
    }

    /// Colors from ink amounts by the plain formula, in the same memory.
    pub(crate) fn into_plain_colors(self) -> Self {
        match self {
            Self::U8(inks) => Self::U8(plain_colors(inks, 255, u64::from, |v| v as u8)),
            Self::U16(inks) => Self::U16(plain_colors(inks, 65535, u64::from, |v| v as u16)),
            floats @ Self::F32(_) => floats,
        }
    }

    /// The image, in sRGB: by the profile if there is one that does something, else the samples as they are.
    pub(crate) fn into_image(
        self,
        channels: Channels,
        size: Size,
        profile: Option<&Profile>,
    ) -> Result<AnyImage, String> {
        let (count, alpha) = (channels.count(), channels.has_alpha());
        match (self, profile) {
            (Self::U8(samples), Some(profile)) => profile.to_linear(&samples, count, alpha, size),
            (Self::U16(samples), Some(profile)) => profile.to_linear(&samples, count, alpha, size),
            (Self::F32(samples), Some(profile)) => profile.to_linear(&samples, count, alpha, size),
            (Self::U8(samples), None) => integers(samples, channels, size),
            (Self::U16(samples), None) => integers(samples, channels, size),
            (Self::F32(samples), None) => floats(samples, channels, size),
        }
    }
}

fn zeros<T: Stored>(count: usize) -> Result<Vec<T>, std::collections::TryReserveError> {
    let mut samples = Vec::new();
    samples.try_reserve_exact(count)?;
    samples.resize(count, T::default());
    Ok(samples)
}

fn integers<T: Stored>(samples: Vec<T>, channels: Channels, size: Size) -> Result<AnyImage, String>
where
    AnyImage: From<Image<Srgb<T>>> + From<Image<Srgba<T>>>,
{
    let width = size.width();
    let image = match channels {
        Channels::Gray => {
            Image::from_vec(width, pixels(&samples, |[v]| Srgb([v; 3]))).map(AnyImage::from)
        }
        Channels::GrayAlpha => {
            Image::from_vec(width, pixels(&samples, |[v, a]| Srgba([v, v, v, a])))
                .map(AnyImage::from)
        }
        Channels::Rgb => Image::from_vec(width, moved::<T, Srgb<T>>(samples)).map(AnyImage::from),
        Channels::Rgba => Image::from_vec(width, moved::<T, Srgba<T>>(samples)).map(AnyImage::from),
        Channels::Cmyk => return Err("inks without a profile".into()),
    };
    image.map_err(|error: SizeError| error.to_string())
}

fn floats(samples: Vec<f32>, channels: Channels, size: Size) -> Result<AnyImage, String> {
    let width = size.width();
    let image = match channels {
        Channels::Gray => {
            Image::from_vec(width, pixels(&samples, |[v]| LinearRgb([v; 3]))).map(AnyImage::from)
        }
        Channels::GrayAlpha => {
            Image::from_vec(width, pixels(&samples, |[v, a]| LinearRgba([v, v, v, a])))
                .map(AnyImage::from)
        }
        Channels::Rgb => Image::from_vec(width, moved::<_, LinearRgb>(samples)).map(AnyImage::from),
        Channels::Rgba => {
            Image::from_vec(width, moved::<_, LinearRgba>(samples)).map(AnyImage::from)
        }
        Channels::Cmyk => return Err("inks without a profile".into()),
    };
    image.map_err(|error: SizeError| error.to_string())
}

/// One pixel from each `N` samples.
fn pixels<T: Stored, P: Pixel, const N: usize>(
    samples: &[T],
    pixel: impl Fn([T; N]) -> P + Sync + Send,
) -> Vec<P> {
    samples
        .par_chunks_exact(N)
        .with_min_len(1 << 14)
        .map(|samples| pixel(std::array::from_fn(|i| samples[i])))
        .collect()
}

/// The same memory as pixels. Falls back to a copy if the allocator gave more than requested.
fn moved<T: Stored, P: Pixel>(samples: Vec<T>) -> Vec<P> {
    bytemuck::allocation::try_cast_vec(samples)
        .unwrap_or_else(|(_, samples)| bytemuck::allocation::pod_collect_to_vec(&samples))
}

/// Divides the colors of pixels by the alpha behind them; counts those that have color but no alpha.
fn unmultiply_pixels<T: Stored>(
    samples: &mut [T],
    channels: usize,
    divided: impl Fn(T, T) -> T + Sync + Send,
) -> u64 {
    let none = T::default();
    samples
        .par_chunks_exact_mut(channels)
        .with_min_len(1 << 14)
        .map(|pixel| {
            let alpha = pixel[channels - 1];
            let mut lost = false;
            for color in &mut pixel[..channels - 1] {
                lost |= alpha == none && *color != none;
                *color = if alpha == none {
                    none
                } else {
                    divided(*color, alpha)
                };
            }
            u64::from(lost)
        })
        .sum()
}

fn divided(color: u64, alpha: u64, one: u64) -> u64 {
    ((color * one + alpha / 2) / alpha).min(one)
}

fn plain_colors<T: Stored>(
    mut inks: Vec<T>,
    one: u64,
    number: impl Fn(T) -> u64,
    stored: impl Fn(u64) -> T,
) -> Vec<T> {
    let pixels = inks.len() / 4;
    for pixel in 0..pixels {
        let [c, m, y, k] = std::array::from_fn(|i| number(inks[4 * pixel + i]));
        for (channel, ink) in [c, m, y].into_iter().enumerate() {
            inks[3 * pixel + channel] = stored(((one - ink) * (one - k) + one / 2) / one);
        }
    }
    inks.truncate(3 * pixels);
    // pixels are made of the memory that is in use
    inks.shrink_to_fit();
    inks
}

/// Bytes of the pixels of an image.
pub(crate) fn bytes(image: &AnyImage) -> u64 {
    let bytes_per_pixel = match image {
        AnyImage::Srgb8(_) => size_of::<Srgb<u8>>(),
        AnyImage::Srgba8(_) => size_of::<Srgba<u8>>(),
        AnyImage::Srgb16(_) => size_of::<Srgb<u16>>(),
        AnyImage::Srgba16(_) => size_of::<Srgba<u16>>(),
        AnyImage::Linear(_) => size_of::<LinearRgb>(),
        AnyImage::LinearAlpha(_) => size_of::<LinearRgba>(),
    };
    (image.size().pixels() * bytes_per_pixel) as u64
}

/// Brings alpha within 0 to 1, which float files do not promise, and makes colors finite, which a profile may make infinite
/// out of large ones.
pub(crate) fn bound(image: &mut AnyImage) {
    match image {
        AnyImage::Linear(image) => image
            .pixels_mut()
            .par_iter_mut()
            .with_min_len(1 << 14)
            .for_each(|pixel| pixel.0 = pixel.0.map(finite)),
        AnyImage::LinearAlpha(image) => image
            .pixels_mut()
            .par_iter_mut()
            .with_min_len(1 << 14)
            .for_each(|pixel| {
                pixel.0 = pixel.0.map(finite);
                pixel.0[3] = pixel.0[3].clamp(0.0, 1.0);
            }),
        // integers have no other values
        AnyImage::Srgb8(_) | AnyImage::Srgba8(_) | AnyImage::Srgb16(_) | AnyImage::Srgba16(_) => {}
    }
}

/// The number, or its replacement if it is NaN or infinite.
fn finite(value: f32) -> f32 {
    if value.is_nan() {
        0.0
    } else if value.is_infinite() {
        INFINITE.copysign(value)
    } else {
        value
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gray_is_spread_and_colors_keep_their_memory() {
        let size = Size::new(2, 1).unwrap();
        let gray = Samples::U8(vec![7, 9]).into_image(Channels::Gray, size, None);
        let expected = Image::from_vec(2, vec![Srgb([7u8; 3]), Srgb([9; 3])]).unwrap();
        assert_eq!(gray.unwrap(), expected.into());

        let samples = vec![1u16, 2, 3, 4, 5, 6];
        let place = samples.as_ptr();
        let image = Samples::U16(samples).into_image(Channels::Rgb, size, None);
        let AnyImage::Srgb16(image) = image.unwrap() else {
            panic!("16-bit samples make a 16-bit image");
        };
        assert_eq!(image.pixels().as_ptr().cast(), place);
    }

    #[test]
    fn numbers_that_are_not_finite_are_replaced_and_counted() {
        let mut samples = Samples::F32(vec![1.0, f32::NAN, f32::NEG_INFINITY, f32::INFINITY, -2.0]);
        let warning = samples.make_finite();
        assert_eq!(
            warning,
            Some(Warning::NotFinite {
                nan: 1,
                infinite: 2
            })
        );
        let Samples::F32(samples) = samples else {
            unreachable!()
        };
        assert_eq!(samples, [1.0, 0.0, -INFINITE, INFINITE, -2.0]);
    }

    #[test]
    fn colors_stay_finite_however_little_they_cover() {
        let mut samples = Samples::F32(vec![1.0, -2.0, 1e-40, 1e-40]);
        assert_eq!(samples.unmultiply(Channels::Rgba), None);
        let Samples::F32(samples) = samples else {
            unreachable!()
        };
        assert_eq!(samples, [INFINITE, -INFINITE, 1.0, 1e-40]);
    }

    #[test]
    fn images_have_finite_colors_and_alpha_within_its_bounds() {
        let wild = LinearRgba([f32::INFINITY, f32::NAN, f32::NEG_INFINITY, 2.0]);
        let bounded = LinearRgba([INFINITE, 0.0, -INFINITE, 1.0]);
        let mut image = Image::from_vec(1, vec![wild]).unwrap().into();
        bound(&mut image);
        assert_eq!(image, Image::from_vec(1, vec![bounded]).unwrap().into());
        let mut image = Image::from_vec(1, vec![LinearRgb([f32::NEG_INFINITY; 3])])
            .unwrap()
            .into();
        bound(&mut image);
        let bounded = vec![LinearRgb([-INFINITE; 3])];
        assert_eq!(image, Image::from_vec(1, bounded).unwrap().into());
    }

    #[test]
    fn plain_colors_are_white_without_ink_and_black_with_all_of_one_kind() {
        let inks = vec![0, 0, 0, 0, 0, 0, 0, 255, 255, 0, 0, 0, 0, 0, 255, 51];
        let Samples::U8(colors) = Samples::U8(inks).into_plain_colors() else {
            unreachable!()
        };
        assert_eq!(colors, [255, 255, 255, 0, 0, 0, 0, 255, 255, 204, 204, 0]);
    }

    #[test]
    fn colors_are_divided_by_their_alpha_and_glow_is_counted() {
        let mut samples = Samples::U8(vec![50, 100, 0, 100, 9, 0, 0, 0]);
        let warning = samples.unmultiply(Channels::Rgba);
        assert_eq!(warning, Some(Warning::GlowLost { pixels: 1 }));
        assert_eq!(samples.as_bytes(), [128, 255, 0, 100, 0, 0, 0, 0]);

        let mut samples = Samples::F32(vec![0.5, 0.5, 1.0, 0.0, 0.0, 0.0]);
        let warning = samples.unmultiply(Channels::GrayAlpha);
        assert_eq!(warning, Some(Warning::GlowLost { pixels: 1 }));
        let Samples::F32(samples) = samples else {
            unreachable!()
        };
        assert_eq!(samples, [1.0, 0.5, 0.0, 0.0, 0.0, 0.0]);
    }
}

//! Color profiles: from the numbers of a file to linear sRGB, and back.
//!
//! A profile made of tone curves and a matrix is computed here, exactly and without clipping, so that colors outside
//! sRGB survive as values below 0 or above 1, and numbers that were only read and written come back:
//!
//! ```text
//! linear sRGB = M(sRGB from XYZ D50) · M(XYZ D50 from device) · curve(device)
//! ```
//!
//! Profiles that are tables (all of CMYK, some of RGB) are left to `moxcms`, which clips to sRGB; they have no way back
//! here. A profile that has both is used through its matrix.
//!
//! Exactness of the way back: linear light is held as `f32`, so a stored number is recovered if its light differs from
//! that of its neighbor by more than about 2⁻²² of the brightest channel. That is so for all 8-bit numbers, and for
//! 16-bit ones in spaces whose curve is not flat at black (Display P3, sRGB curves). Where it is flat (Adobe RGB and other
//! pure powers), 16-bit numbers of about 1 % and less in a pixel with a bright other channel may come back changed by
//! at most 0.05 % of the range.

use crate::curve::{Backward, Curve, Stored};
use moxcms::{
    ColorProfile, DataColorSpace, Layout, Matrix3d, ProfileText, ToneReprCurve, TransformOptions,
};
use ravec_raster::color::linear_from_srgb;
use ravec_raster::{AnyImage, Image, LinearRgb, LinearRgba, Size, SizeError};
use rayon::prelude::*;

/// Conversion that an embedded profile asks for.
#[derive(Debug)]
pub(crate) enum Profile {
    /// sRGB by another name: numbers are taken as they are.
    Srgb,
    /// Curves and a matrix.
    Shaper(Box<Shaper>),
    /// One curve, from gray to luminance.
    Gray(Curve),
    /// Tables, to be evaluated by `moxcms`.
    Table(Box<ColorProfile>),
}

/// An RGB space given by tone curves and primaries.
#[derive(Debug)]
pub(crate) struct Shaper {
    curves: [Curve; 3],
    linear_from_device: [[f64; 3]; 3],
    device_from_linear: [[f64; 3]; 3],
}

impl Profile {
    /// Understands a profile.
    ///
    /// # Errors
    /// A few words on what is wrong with it.
    pub(crate) fn parse(bytes: &[u8]) -> Result<Self, String> {
        let profile =
            ColorProfile::new_from_slice(bytes).map_err(|error| format!("damaged: {error}"))?;
        match profile.color_space {
            DataColorSpace::Rgb => match Shaper::new(&profile) {
                Some(shaper)
                    if shaper.has_srgb_primaries() && shaper.curves.iter().all(Curve::is_srgb) =>
                {
                    Ok(Self::Srgb)
                }
                Some(shaper) => Ok(Self::Shaper(Box::new(shaper))),
                None => Self::table(profile, Layout::Rgb),
            },
            DataColorSpace::Gray => match profile.gray_trc.as_ref().and_then(Curve::new) {
                Some(curve) if curve.is_srgb() => Ok(Self::Srgb),
                Some(curve) => Ok(Self::Gray(curve)),
                None => Err("a gray profile without a usable curve".into()),
            },
            DataColorSpace::Cmyk => Self::table(profile, Layout::Rgba),
            other => Err(format!("a profile for {other:?} colors")),
        }
    }

    /// Keeps a profile of tables if `moxcms` can evaluate it.
    fn table(profile: ColorProfile, layout: Layout) -> Result<Self, String> {
        let tables = [
            &profile.lut_a_to_b_perceptual,
            &profile.lut_a_to_b_colorimetric,
            &profile.lut_a_to_b_saturation,
        ];
        if tables.into_iter().all(Option::is_none) {
            return Err("it has neither usable curves and primaries nor tables".into());
        }
        let profile = Box::new(profile);
        transform(&profile, layout).map(|_| Self::Table(profile))
    }

    /// Returns `true` if a file with this profile may have this number of color channels.
    pub(crate) fn suits(&self, color_channels: usize) -> bool {
        match self {
            Self::Srgb | Self::Shaper(_) => matches!(color_channels, 1 | 3),
            Self::Gray(_) => color_channels == 1,
            Self::Table(profile) => match profile.color_space {
                DataColorSpace::Cmyk => color_channels == 4,
                _ => matches!(color_channels, 1 | 3),
            },
        }
    }

    /// The colors of stored samples in linear sRGB. `channels` counts colors and, if `alpha`, the alpha behind them.
    ///
    /// # Errors
    /// If a table cannot be evaluated after all.
    ///
    /// # Panics
    /// If the samples are not `size` times `channels`.
    pub(crate) fn to_linear<T: Stored>(
        &self,
        samples: &[T],
        channels: usize,
        alpha: bool,
        size: Size,
    ) -> Result<AnyImage, String> {
        let layout = Stride {
            channels,
            colors: channels - usize::from(alpha),
            alpha,
        };
        match self {
            Self::Srgb => layout.convert_pixels(samples, size, |color| match *color {
                [r, g, b] => [r, g, b].map(T::to_linear),
                _ => [color[0].to_linear(); 3],
            }),
            Self::Gray(curve) => {
                let table = curve.table::<T>();
                let light = |sample: T| light(table.as_deref(), curve, sample) as f32;
                layout.convert_pixels(samples, size, |color| [light(color[0]); 3])
            }
            Self::Shaper(shaper) => {
                let tables = shaper.curves.each_ref().map(Curve::table::<T>);
                layout.convert_pixels(samples, size, |color| {
                    let device = std::array::from_fn(|i| {
                        let sample = color[i.min(color.len() - 1)];
                        light(tables[i].as_deref(), &shaper.curves[i], sample)
                    });
                    product(&shaper.linear_from_device, device).map(|v| v as f32)
                })
            }
            Self::Table(profile) => layout.convert_by_table(samples, size, profile),
        }
    }

    /// The numbers of this profile nearest to pixels in linear sRGB, three a pixel; one if the profile is gray, where
    /// the luminance counts. Alpha is left out. `None` if there is no way back.
    pub(crate) fn numbers_from_linear<T: Stored>(
        &self,
        pixels: &Image<LinearRgba>,
    ) -> Option<Vec<T>> {
        match self {
            Self::Srgb | Self::Table(_) => None,
            Self::Gray(curve) => {
                let backward = Backward::new(curve.table::<T>()?);
                let numbers = pixels.pixels().par_iter().map(|pixel| {
                    let light = ravec_raster::color::luminance(pixel.rgb());
                    // the weights of luminance add up to 1 only nearly: gray is to come back as it was
                    let [r, g, b] = pixel.rgb();
                    let light = if r == g && g == b { r } else { light };
                    T::from_code(backward.nearest(f64::from(light)))
                });
                Some(numbers.collect())
            }
            Self::Shaper(shaper) => {
                let [red, green, blue] = shaper.curves.each_ref().map(Curve::table::<T>);
                let backward = [red?, green?, blue?].map(Backward::new);
                let mut numbers = vec![T::default(); 3 * pixels.pixels().len()];
                numbers
                    .par_chunks_exact_mut(3)
                    .zip(pixels.pixels())
                    .with_min_len(4096)
                    .for_each(|(numbers, pixel)| {
                        let device =
                            product(&shaper.device_from_linear, pixel.rgb().map(f64::from));
                        for channel in 0..3 {
                            numbers[channel] =
                                T::from_code(backward[channel].nearest(device[channel]));
                        }
                    });
                Some(numbers)
            }
        }
    }

    /// Returns `true` if floats of this profile are what our floats are.
    pub(crate) fn is_linear_srgb(&self) -> bool {
        match self {
            Self::Shaper(shaper) => shaper.has_srgb_primaries() && self.linear_space().is_some(),
            Self::Gray(curve) => curve.is_identity(),
            Self::Srgb | Self::Table(_) => false,
        }
    }

    /// The matrix to the linear space of this profile, if the space is linear: then floats need no curve.
    pub(crate) fn linear_space(&self) -> Option<[[f64; 3]; 3]> {
        match self {
            Self::Shaper(shaper) if shaper.curves.iter().all(Curve::is_identity) => {
                Some(shaper.device_from_linear)
            }
            _ => None,
        }
    }
}

fn light<T: Stored>(table: Option<&[f64]>, curve: &Curve, sample: T) -> f64 {
    match table {
        Some(table) => table[sample.code()],
        None => curve.at(f64::from(sample.to_unit())),
    }
}

/// Layout of the samples of a pixel.
#[derive(Clone, Copy)]
struct Stride {
    channels: usize,
    colors: usize,
    alpha: bool,
}

impl Stride {
    fn convert_pixels<T: Stored>(
        self,
        samples: &[T],
        size: Size,
        color: impl Fn(&[T]) -> [f32; 3] + Sync,
    ) -> Result<AnyImage, String> {
        let pixels = samples.par_chunks_exact(self.channels).with_min_len(4096);
        let finish = |error: SizeError| error.to_string();
        if self.alpha {
            let pixels = pixels.map(|pixel| {
                let alpha = pixel[self.colors].to_unit();
                LinearRgba::from_rgb_alpha(color(&pixel[..self.colors]), alpha)
            });
            let image = Image::from_vec(size.width(), pixels.collect()).map_err(finish)?;
            Ok(image.into())
        } else {
            let pixels = pixels.map(|pixel| LinearRgb(color(pixel)));
            let image = Image::from_vec(size.width(), pixels.collect()).map_err(finish)?;
            Ok(image.into())
        }
    }

    /// Row by row through encoded sRGB, where the tables' precision is spent best.
    fn convert_by_table<T: Stored>(
        self,
        samples: &[T],
        size: Size,
        profile: &ColorProfile,
    ) -> Result<AnyImage, String> {
        let inks = profile.color_space == DataColorSpace::Cmyk;
        let transform = transform(profile, if inks { Layout::Rgba } else { Layout::Rgb })?;
        let stored = if inks { 4 } else { 3 };
        let mut image = Image::new(size, LinearRgba([0.0, 0.0, 0.0, 1.0]));
        image
            .par_rows_mut()
            .zip(samples.par_chunks_exact(size.width() * self.channels))
            .try_for_each(|(row, samples)| {
                let pixels = samples.chunks_exact(self.channels);
                let device: Vec<f32> = pixels
                    .clone()
                    .flat_map(|pixel| (0..stored).map(|i| pixel[i.min(self.colors - 1)].to_unit()))
                    .collect();
                let mut encoded = vec![0.0; 3 * size.width()];
                transform.transform(&device, &mut encoded)?;
                for ((out, encoded), stored) in
                    row.iter_mut().zip(encoded.chunks_exact(3)).zip(pixels)
                {
                    let rgb = [encoded[0], encoded[1], encoded[2]].map(linear_from_srgb);
                    let alpha = if self.alpha {
                        stored[self.colors].to_unit()
                    } else {
                        1.0
                    };
                    *out = LinearRgba::from_rgb_alpha(rgb, alpha);
                }
                Ok(())
            })
            .map_err(|error: moxcms::CmsError| error.to_string())?;
        Ok(if self.alpha {
            image.into()
        } else {
            image.convert::<LinearRgb>().into()
        })
    }
}

type Transform = std::sync::Arc<moxcms::TransformF32Executor>;

fn transform(profile: &ColorProfile, layout: Layout) -> Result<Transform, String> {
    let options = TransformOptions {
        rendering_intent: profile.rendering_intent,
        prefer_fixed_point: false,
        ..TransformOptions::default()
    };
    profile
        .create_transform_f32(layout, &ColorProfile::new_srgb(), Layout::Rgb, options)
        .map_err(|error| format!("its tables are of no use: {error}"))
}

impl Shaper {
    fn new(profile: &ColorProfile) -> Option<Self> {
        let curve = |curve: &Option<ToneReprCurve>| curve.as_ref().and_then(Curve::new);
        let curves = [
            curve(&profile.red_trc)?,
            curve(&profile.green_trc)?,
            curve(&profile.blue_trc)?,
        ];
        let srgb = ColorProfile::new_srgb().colorant_matrix();
        let mut linear_from_device = inverse(&srgb)?.mat_mul(profile.colorant_matrix());
        // colorants are rounded to 16 bits: without this, white would get a tint in the fifth place
        for row in &mut linear_from_device.v {
            let sum: f64 = row.iter().sum();
            if (sum - 1.0).abs() < 2e-3 {
                *row = row.map(|value| value / sum);
            }
        }
        if is_identity(&linear_from_device.v) {
            linear_from_device = Matrix3d::IDENTITY;
        }
        let device_from_linear = inverse(&linear_from_device)?;
        Some(Self {
            curves,
            linear_from_device: linear_from_device.v,
            device_from_linear: device_from_linear.v,
        })
    }

    fn has_srgb_primaries(&self) -> bool {
        is_identity(&self.linear_from_device)
    }
}

/// Returns `true` if a matrix is the identity, within the spread of the sRGB profiles in circulation.
fn is_identity(matrix: &[[f64; 3]; 3]) -> bool {
    let expected = |row: usize, col: usize| f64::from(u8::from(row == col));
    (0..9).all(|i| (matrix[i / 3][i % 3] - expected(i / 3, i % 3)).abs() < 2e-3)
}

/// The inverse of a matrix that has a usable one.
fn inverse(matrix: &Matrix3d) -> Option<Matrix3d> {
    let determinant = matrix.determinant()?;
    (determinant.is_finite() && determinant.abs() > 1e-6).then(|| matrix.inverse())
}

#[inline]
pub(crate) fn product(matrix: &[[f64; 3]; 3], [x, y, z]: [f64; 3]) -> [f64; 3] {
    matrix.map(|[a, b, c]| a * x + b * y + c * z)
}

/// The description that a profile holds, in one line.
pub(crate) fn description(bytes: &[u8]) -> Option<String> {
    let text = match ColorProfile::new_from_slice(bytes).ok()?.description? {
        ProfileText::PlainString(text) => text,
        ProfileText::Localizable(texts) => texts.into_iter().next()?.value,
        ProfileText::Description(text) => text.ascii_string,
    };
    let text: String = text.chars().filter(|c| !c.is_control()).collect();
    let text = text.trim();
    (!text.is_empty()).then(|| text.to_owned())
}

/// Returns `true` if a profile is one for gray pictures.
pub(crate) fn is_gray(bytes: &[u8]) -> bool {
    bytes.get(16..20) == Some(b"GRAY")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(profile: &ColorProfile) -> Profile {
        Profile::parse(&profile.encode().unwrap()).unwrap()
    }

    #[test]
    fn white_of_any_space_is_white_and_saturated_green_leaves_srgb() {
        for profile in [
            ColorProfile::new_adobe_rgb(),
            ColorProfile::new_display_p3(),
            ColorProfile::new_pro_photo_rgb(),
            ColorProfile::new_bt2020(),
        ] {
            let size = Size::new(2, 1).unwrap();
            let samples = [255u8, 255, 255, 0, 255, 0];
            let image = parse(&profile).to_linear(&samples, 3, false, size).unwrap();
            let image = image.convert::<LinearRgb>();
            for value in image[(0, 0)].0 {
                assert!((value - 1.0).abs() < 1e-6, "{value}");
            }
            let [r, g, _] = image[(1, 0)].0;
            assert!(r < -0.1 && g > 0.99, "{r} {g}");
        }
    }

    #[test]
    fn display_p3_agrees_with_its_published_matrix() {
        // CSS Color 4: the primaries of Display P3 in linear sRGB
        let published = [
            [1.224_940_2, -0.042_056_96, -0.019_637_55],
            [-0.224_940_18, 1.042_056_96, -0.078_636_04],
            [0.0, 0.0, 1.098_273_6],
        ];
        let size = Size::new(3, 1).unwrap();
        let samples = [255u8, 0, 0, 0, 255, 0, 0, 0, 255];
        let image = parse(&ColorProfile::new_display_p3())
            .to_linear(&samples, 3, false, size)
            .unwrap()
            .convert::<LinearRgb>();
        for (col, published) in published.iter().enumerate() {
            for (value, published) in image[(col, 0)].0.iter().zip(published) {
                // colorants in a profile are rounded to 2^-16, the inverse matrix enlarges that about threefold
                assert!((value - published).abs() < 2e-4, "{value} {published}");
            }
        }
    }

    #[test]
    fn a_gray_gamma_profile_is_a_curve() {
        let profile = parse(&ColorProfile::new_gray_with_gamma(1.8));
        let size = Size::new(2, 1).unwrap();
        let image = profile.to_linear(&[0u8, 128], 1, false, size).unwrap();
        let value = image.convert::<LinearRgb>()[(1, 0)].0;
        // the gamma is stored in steps of 1/256
        assert!((value[0] - (128.0f32 / 255.0).powf(1.8)).abs() < 2e-3 && value[0] == value[2]);
        assert!(profile.suits(1) && !profile.suits(3));
    }

    #[test]
    fn damaged_and_exotic_profiles_are_refused_in_words() {
        assert!(Profile::parse(b"not a profile").is_err());
        assert!(Profile::parse(&[]).is_err());
        let mut flat = ColorProfile::new_srgb();
        flat.green_colorant = flat.red_colorant;
        assert!(Profile::parse(&flat.encode().unwrap()).is_err());
        let lab = Profile::parse(&ColorProfile::new_lab().encode().unwrap());
        assert!(lab.unwrap_err().contains("Lab"));
    }
}

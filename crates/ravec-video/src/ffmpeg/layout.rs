//! Layouts of raw frames, by the names that FFmpeg has for them, and frames in these layouts.
//!
//! Planes of luma and chroma keep their samples. Red, green and blue of 9 to 15 bits are scaled to 16 bits to the nearest, and
//! back, which is exact in both directions together.

use super::nut::{FrameHead, NutError, NutReader};
use crate::color::{ColorInfo, Range, Subsampling};
use crate::error::VideoError;
use crate::frame::FramePicture;
use crate::info::PixelKind;
use crate::yuv::{SamplePlane, YuvFormat, YuvImage};
use ravec_raster::{AnyImage, Image, Pixel, Sample, Size, Srgb, Srgba};
use std::borrow::Cow;
use std::io::{self, Read, Write};

/// Arrangement of samples in a raw frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Samples {
    /// A plane for each of luma, Cb, Cr and alpha.
    Planes(YuvFormat),
    /// Luma and alpha side by side.
    GrayAlpha,
    /// A plane for each of green, blue, red and alpha.
    PlanarRgb { alpha: bool },
    /// Red, green, blue and alpha side by side.
    Rgb { alpha: bool },
    /// Blue, green, red and a fourth byte, which is alpha or unused.
    Bgr { alpha: bool },
}

/// A layout by its name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Layout {
    /// The name, such as `yuv420p10le`.
    pub(super) name: String,
    pub(super) samples: Samples,
    /// Bits a sample, 8 to 16.
    pub(super) depth: u32,
    /// True for the names that imply the full range, such as `yuvj420p`.
    pub(super) full: bool,
    /// True for samples of two bytes with the high one first.
    pub(super) big_endian: bool,
}

impl Layout {
    /// The layout of that name, if frames can hold it.
    pub(super) fn parse(name: &str) -> Option<Self> {
        let (stem, big_endian) = match (name.strip_suffix("le"), name.strip_suffix("be")) {
            (Some(stem), _) => (stem, false),
            (_, Some(stem)) => (stem, true),
            _ => (name, false),
        };
        let (samples, depth, full) = match stem {
            "rgb24" => (Samples::Rgb { alpha: false }, 8, false),
            "rgba" => (Samples::Rgb { alpha: true }, 8, false),
            "rgb48" => (Samples::Rgb { alpha: false }, 16, false),
            "rgba64" => (Samples::Rgb { alpha: true }, 16, false),
            "bgr0" => (Samples::Bgr { alpha: false }, 8, false),
            "bgra" => (Samples::Bgr { alpha: true }, 8, false),
            "ya8" => (Samples::GrayAlpha, 8, false),
            "ya16" => (Samples::GrayAlpha, 16, false),
            _ => planar(stem)?,
        };
        if (depth > 8) != (stem.len() < name.len()) {
            return None;
        }
        Some(Self {
            name: name.to_owned(),
            samples,
            depth,
            full,
            big_endian,
        })
    }

    /// Samples of the frames as the rest of the crate sees them.
    pub(super) fn pixels(&self, color: ColorInfo) -> PixelKind {
        match self.yuv_format() {
            Some(format) => PixelKind::Yuv { format, color },
            None => PixelKind::Rgb {
                depth: if self.depth > 8 { 16 } else { 8 },
                alpha: self.alpha(),
            },
        }
    }

    /// The planes of the frames, unless they are red, green and blue.
    pub(super) fn yuv_format(&self) -> Option<YuvFormat> {
        match self.samples {
            Samples::Planes(format) => Some(format),
            Samples::GrayAlpha => Some(YuvFormat {
                subsampling: Subsampling::Gray,
                depth: self.depth,
                alpha: true,
            }),
            _ => None,
        }
    }

    pub(super) fn alpha(&self) -> bool {
        match self.samples {
            Samples::Planes(format) => format.alpha,
            Samples::GrayAlpha => true,
            Samples::PlanarRgb { alpha } | Samples::Rgb { alpha } | Samples::Bgr { alpha } => alpha,
        }
    }

    /// The same layout with the low byte first: the one that goes through the pipes.
    pub(super) fn piped_name(&self) -> String {
        match self.name.strip_suffix("be") {
            Some(stem) if self.big_endian => format!("{stem}le"),
            _ => self.name.clone(),
        }
    }

    /// The four characters by which FFmpeg knows the layout in raw streams; `None` for the few that have none.
    pub(super) fn fourcc(&self) -> Option<[u8; 4]> {
        let depth = self.depth as u8;
        Some(match self.samples {
            Samples::Rgb { alpha: false } if depth == 8 => *b"RGB\x18",
            Samples::Rgb { alpha: true } if depth == 8 => *b"RGBA",
            Samples::Rgb { alpha: false } => *b"RGB0",
            Samples::Rgb { alpha: true } => *b"RBA@",
            Samples::Bgr { alpha: false } => *b"BGR\0",
            Samples::Bgr { alpha: true } => *b"BGRA",
            Samples::PlanarRgb { alpha } => [b'G', b'3' + u8::from(alpha), 0, depth],
            Samples::GrayAlpha if depth == 8 => [b'Y', b'2', 0, 8],
            Samples::GrayAlpha => return None,
            Samples::Planes(format) => match (format.subsampling, depth, format.alpha) {
                (Subsampling::Gray, _, true) => return None,
                (Subsampling::Gray, 8, _) => *b"Y800",
                (Subsampling::Gray, ..) => [b'Y', b'1', 0, depth],
                (Subsampling::S420, 8, false) => *b"I420",
                (Subsampling::S422, 8, false) => *b"Y42B",
                (Subsampling::S440, 8, false) => *b"440P",
                (Subsampling::S411, 8, false) => *b"Y41B",
                (Subsampling::S444, 8, false) => *b"444P",
                (Subsampling::S420, ..) => [b'Y', b'3' + u8::from(format.alpha), 11, depth],
                (Subsampling::S422, ..) => [b'Y', b'3' + u8::from(format.alpha), 10, depth],
                (Subsampling::S444, ..) => [b'Y', b'3' + u8::from(format.alpha), 0, depth],
                (Subsampling::S440 | Subsampling::S411, ..) => return None,
            },
        })
    }

    /// Bytes of a raw frame.
    pub(super) fn frame_bytes(&self, size: Size) -> u64 {
        if let Some(format) = self.yuv_format() {
            return format.frame_bytes(size);
        }
        let samples = match self.samples {
            Samples::Bgr { .. } => 4,
            _ => 3 + u64::from(self.alpha()),
        };
        size.pixels() as u64 * samples * if self.depth > 8 { 2 } else { 1 }
    }

    /// Reads the content of a frame.
    pub(super) fn read_frame<R: Read>(
        &self,
        input: &mut NutReader<R>,
        head: FrameHead,
        size: Size,
        color: ColorInfo,
    ) -> Result<FramePicture, NutError> {
        if self.depth > 8 {
            self.read_samples::<u16, R>(input, head, size, color)
        } else {
            self.read_samples::<u8, R>(input, head, size, color)
        }
    }

    fn read_samples<T: RawSample, R: Read>(
        &self,
        input: &mut NutReader<R>,
        head: FrameHead,
        size: Size,
        color: ColorInfo,
    ) -> Result<FramePicture, NutError> {
        let planes = match self.samples {
            Samples::Planes(format) => {
                let sizes = format.plane_sizes(size);
                let mut planes: Vec<Image<T>> = sizes
                    .iter()
                    .map(|size| Image::new(*size, T::default()))
                    .collect();
                fill(input, head, &mut planes)?;
                return Ok(yuv(format, color, planes));
            }
            Samples::GrayAlpha => {
                let mut pairs = [Image::new(size, [T::default(); 2])];
                fill(input, head, &mut pairs)?;
                let planes = [0, 1].map(|c| pairs[0].map(|pair| pair[c])).to_vec();
                let format = YuvFormat {
                    subsampling: Subsampling::Gray,
                    depth: self.depth,
                    alpha: true,
                };
                return Ok(yuv(format, color, planes));
            }
            Samples::Rgb { alpha: false } => {
                let mut image = [Image::new(size, Srgb([T::default(); 3]))];
                fill(input, head, &mut image)?;
                let [image] = image;
                return Ok(FramePicture::Image(T::opaque(image)));
            }
            Samples::Rgb { alpha: true } => {
                let mut image = [Image::new(size, Srgba([T::default(); 4]))];
                fill(input, head, &mut image)?;
                let [image] = image;
                return Ok(FramePicture::Image(T::with_alpha(image)));
            }
            Samples::Bgr { alpha } => {
                let mut image = [Image::new(size, [T::default(); 4])];
                fill(input, head, &mut image)?;
                let picture = if alpha {
                    T::with_alpha(image[0].map(|[b, g, r, a]| Srgba([r, g, b, a])))
                } else {
                    T::opaque(image[0].map(|[b, g, r, _]| Srgb([r, g, b])))
                };
                return Ok(FramePicture::Image(picture));
            }
            Samples::PlanarRgb { alpha } => {
                let mut planes = vec![Image::new(size, T::default()); 3 + usize::from(alpha)];
                fill(input, head, &mut planes)?;
                planes
            }
        };
        let depth = self.depth;
        let sample = |plane: usize, at: usize| planes[plane].pixels()[at].widened(depth);
        let width = size.width();
        let picture = if planes.len() > 3 {
            T::with_alpha(Image::from_fn(size, |col, row| {
                Srgba([2, 0, 1, 3].map(|plane| sample(plane, row * width + col)))
            }))
        } else {
            T::opaque(Image::from_fn(size, |col, row| {
                Srgb([2, 0, 1].map(|plane| sample(plane, row * width + col)))
            }))
        };
        Ok(FramePicture::Image(picture))
    }

    /// Writes the content of a frame, whose samples are converted if they are others than these. `color` is the meaning of
    /// the planes that are written.
    pub(super) fn write_frame(
        &self,
        output: &mut impl Write,
        picture: &FramePicture,
        color: ColorInfo,
    ) -> io::Result<()> {
        if let Some(format) = self.yuv_format() {
            let planes = picture.to_yuv(format, color);
            if self.samples == Samples::GrayAlpha
                && let [SamplePlane::U8(luma), SamplePlane::U8(alpha)] = planes.planes()
            {
                let values = luma.pixels().iter().zip(alpha.pixels());
                let pairs: Vec<[u8; 2]> = values.map(|(luma, alpha)| [*luma, *alpha]).collect();
                return output.write_all(bytemuck::cast_slice(&pairs));
            }
            for plane in planes.planes() {
                match plane {
                    SamplePlane::U8(plane) => output.write_all(plane.pixels())?,
                    SamplePlane::U16(plane) => output.write_all(&u16::raw(plane.pixels()))?,
                }
            }
            return Ok(());
        }
        let image = picture.to_image();
        if self.depth > 8 {
            let rgba = match &*image {
                // kept as they are: conversion of 16 bits through floats need not be exact
                AnyImage::Srgb16(image) => image.map(|Srgb([r, g, b])| [r, g, b, u16::MAX]),
                AnyImage::Srgba16(image) => image.map(|Srgba(rgba)| rgba),
                AnyImage::Srgb8(image) => image.map(|Srgb([r, g, b])| [r, g, b, 255].map(wide)),
                AnyImage::Srgba8(image) => image.map(|Srgba(rgba)| rgba.map(wide)),
                other => other.convert::<Srgba<u16>>().map(|Srgba(rgba)| rgba),
            };
            self.write_rgba(output, &rgba)
        } else {
            let rgba = match &*image {
                AnyImage::Srgb8(image) => image.map(|Srgb([r, g, b])| [r, g, b, 255]),
                AnyImage::Srgba8(image) => image.map(|Srgba(rgba)| rgba),
                other => other.convert::<Srgba<u8>>().map(|Srgba(rgba)| rgba),
            };
            self.write_rgba(output, &rgba)
        }
    }

    fn write_rgba<T: RawSample>(
        &self,
        output: &mut impl Write,
        image: &Image<[T; 4]>,
    ) -> io::Result<()> {
        let depth = self.depth;
        let mut samples: Vec<T> = Vec::with_capacity(4 * image.pixels().len());
        match self.samples {
            Samples::Rgb { alpha: false } => {
                samples.extend(image.pixels().iter().flat_map(|[r, g, b, _]| [*r, *g, *b]));
            }
            Samples::Bgr { .. } => {
                let pixels = image.pixels().iter();
                samples.extend(pixels.flat_map(|[r, g, b, a]| [*b, *g, *r, *a]));
            }
            Samples::PlanarRgb { alpha } => {
                let order: &[usize] = if alpha { &[1, 2, 0, 3] } else { &[1, 2, 0] };
                for channel in order {
                    let pixels = image.pixels().iter();
                    samples.extend(pixels.map(|pixel| pixel[*channel].narrowed(depth)));
                }
            }
            _ => samples.extend(image.pixels().iter().flatten()),
        }
        output.write_all(&T::raw(&samples))
    }
}

/// Planes of a name such as `yuva420p10`, with the number of bits and the full range implied.
fn planar(stem: &str) -> Option<(Samples, u32, bool)> {
    let (kind, depth) = stem.split_at(stem.trim_end_matches(|c: char| c.is_ascii_digit()).len());
    // the chroma of `gray8` and the planes of `yuv420p` stand before the bits
    let depth = match depth {
        "" => 8,
        digits => digits
            .parse()
            .ok()
            .filter(|depth| (9..=16).contains(depth))?,
    };
    let alpha = kind.starts_with("yuva") || kind.starts_with("gbrap");
    if matches!(kind, "gbrp" | "gbrap") {
        return Some((Samples::PlanarRgb { alpha }, depth, false));
    }
    let full = kind.starts_with("yuvj");
    let chroma = kind
        .strip_prefix("yuva")
        .or_else(|| kind.strip_prefix("yuvj"))
        .or_else(|| kind.strip_prefix("yuv"));
    let subsampling = match chroma {
        None if kind == "gray" => Subsampling::Gray,
        Some("420p") => Subsampling::S420,
        Some("422p") => Subsampling::S422,
        Some("440p") => Subsampling::S440,
        Some("411p") => Subsampling::S411,
        Some("444p") => Subsampling::S444,
        _ => return None,
    };
    let format = YuvFormat {
        subsampling,
        depth,
        alpha,
    };
    Some((Samples::Planes(format), depth, full))
}

fn wide(value: u8) -> u16 {
    u16::from(value) * 257
}

fn fill<P: Pixel, R: Read>(
    input: &mut NutReader<R>,
    head: FrameHead,
    images: &mut [Image<P>],
) -> Result<(), NutError> {
    let mut pieces: Vec<&mut [u8]> = images
        .iter_mut()
        .map(|image| bytemuck::cast_slice_mut(image.pixels_mut()))
        .collect();
    input.read_content(head, &mut pieces)?;
    if cfg!(target_endian = "big") {
        for piece in pieces.iter_mut().filter(|_| size_of::<P>() > 1) {
            piece.chunks_exact_mut(2).for_each(<[u8]>::reverse);
        }
    }
    Ok(())
}

fn yuv<T: RawSample>(format: YuvFormat, color: ColorInfo, planes: Vec<Image<T>>) -> FramePicture {
    let planes = planes.into_iter().map(T::plane).collect();
    let planes =
        YuvImage::new(format, color, planes).expect("the planes were made for this format");
    FramePicture::Yuv(planes)
}

/// Samples of raw frames.
trait RawSample: Sample {
    fn plane(image: Image<Self>) -> SamplePlane;
    fn opaque(image: Image<Srgb<Self>>) -> AnyImage;
    fn with_alpha(image: Image<Srgba<Self>>) -> AnyImage;
    /// The sample on the scale of all bits, from one of `depth` bits.
    fn widened(self, depth: u32) -> Self;
    /// The sample of `depth` bits.
    fn narrowed(self, depth: u32) -> Self;
    /// The bytes, low one first.
    fn raw(samples: &[Self]) -> Cow<'_, [u8]>;
}

impl RawSample for u8 {
    fn plane(image: Image<Self>) -> SamplePlane {
        SamplePlane::U8(image)
    }
    fn opaque(image: Image<Srgb<Self>>) -> AnyImage {
        image.into()
    }
    fn with_alpha(image: Image<Srgba<Self>>) -> AnyImage {
        image.into()
    }
    fn widened(self, _: u32) -> Self {
        self
    }
    fn narrowed(self, _: u32) -> Self {
        self
    }
    fn raw(samples: &[Self]) -> Cow<'_, [u8]> {
        samples.into()
    }
}

impl RawSample for u16 {
    fn plane(image: Image<Self>) -> SamplePlane {
        SamplePlane::U16(image)
    }
    fn opaque(image: Image<Srgb<Self>>) -> AnyImage {
        image.into()
    }
    fn with_alpha(image: Image<Srgba<Self>>) -> AnyImage {
        image.into()
    }
    fn widened(self, depth: u32) -> Self {
        let max = (1u32 << depth) - 1;
        ((u32::from(self).min(max) * 65535 + max / 2) / max) as Self
    }
    fn narrowed(self, depth: u32) -> Self {
        let max = (1u32 << depth) - 1;
        ((u32::from(self) * max + 32767) / 65535) as Self
    }
    fn raw(samples: &[Self]) -> Cow<'_, [u8]> {
        if cfg!(target_endian = "little") {
            bytemuck::cast_slice(samples).into()
        } else {
            samples
                .iter()
                .flat_map(|sample| sample.to_le_bytes())
                .collect()
        }
    }
}

/// The range of a layout whose name implies one.
impl Layout {
    pub(super) fn implied_range(&self) -> Option<Range> {
        self.full.then_some(Range::Full)
    }
}

/// The layout in which frames of FFmpeg's layout `name` are read: the same, or the nearest that holds its samples.
///
/// Those without a match become red, green and blue by FFmpeg's own conversion.
pub(super) fn reading_layout(name: &str) -> Result<Layout, VideoError> {
    if let Some(layout) = Layout::parse(name) {
        let name = layout.piped_name();
        return Ok(Layout {
            name,
            big_endian: false,
            ..layout
        });
    }
    let stem = name.trim_end_matches("le").trim_end_matches("be");
    // the same samples in another order, or in the nearest layout
    let same = match stem {
        "nv12" | "nv21" | "yuv410p" => "yuv420p",
        "nv16" | "yuyv422" | "uyvy422" | "yvyu422" => "yuv422p",
        "nv24" | "nv42" | "vuyx" => "yuv444p",
        "uyyvyy411" => "yuv411p",
        "nv20" | "p210" | "y210" | "v210" => "yuv422p10le",
        "p010" => "yuv420p10le",
        "p012" => "yuv420p12le",
        "p016" => "yuv420p16le",
        "y212" | "p212" => "yuv422p12le",
        "p216" => "yuv422p16le",
        "p410" | "xv30" => "yuv444p10le",
        "p412" | "xv36" => "yuv444p12le",
        "p416" | "xv48" => "yuv444p16le",
        "ayuv64" => "yuva444p16le",
        "vuya" | "ayuv" => "yuva444p",
        "monow" | "monob" => "gray",
        "grayf32" => "gray16le",
        "pal8" | "argb" | "abgr" => "rgba",
        "bgra64" | "gbrapf32" | "rgbaf32" => "rgba64le",
        _ if stem.starts_with("bayer") && stem.ends_with("16") => "rgb48le",
        "bgr48" | "gbrpf32" | "rgbf32" | "xyz12" | "x2rgb10" | "x2bgr10" => "rgb48le",
        _ if stem.is_empty() => "",
        _ => "rgb24",
    };
    Layout::parse(same).ok_or_else(|| VideoError::Unsupported {
        feature: format!("the pixel layout `{name}`"),
        hint: None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_layouts_are_read() {
        let planes = |subsampling, depth, alpha| {
            Samples::Planes(YuvFormat {
                subsampling,
                depth,
                alpha,
            })
        };
        for (name, samples, full) in [
            ("gray", planes(Subsampling::Gray, 8, false), false),
            ("gray12le", planes(Subsampling::Gray, 12, false), false),
            ("yuv420p", planes(Subsampling::S420, 8, false), false),
            ("yuvj422p", planes(Subsampling::S422, 8, false), true),
            ("yuv440p10be", planes(Subsampling::S440, 10, false), false),
            ("yuva444p16le", planes(Subsampling::S444, 16, true), false),
            ("yuv411p", planes(Subsampling::S411, 8, false), false),
            ("gbrap10le", Samples::PlanarRgb { alpha: true }, false),
            ("rgb48le", Samples::Rgb { alpha: false }, false),
            ("bgr0", Samples::Bgr { alpha: false }, false),
            ("ya8", Samples::GrayAlpha, false),
        ] {
            let layout = Layout::parse(name).unwrap();
            assert_eq!((layout.samples, layout.full), (samples, full), "{name}");
        }
        for wrong in [
            "",
            "yuv",
            "yuv420p7le",
            "yuv420p17le",
            "yuv420p10",
            "nv12",
            "gbrpf32le",
            "yuv410p",
            "rgb565le",
            "graf",
            "gray8le",
        ] {
            assert_eq!(Layout::parse(wrong), None, "{wrong}");
        }
    }

    #[test]
    fn colors_of_few_bits_come_back_from_sixteen() {
        for depth in 9..=16 {
            for code in 0..=((1u32 << depth) - 1) as u16 {
                assert_eq!(code.widened(depth).narrowed(depth), code);
            }
            assert_eq!(0u16.widened(depth), 0);
            assert_eq!(u16::MAX.widened(depth), u16::MAX);
        }
    }
}

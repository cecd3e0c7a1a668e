//! Codecs by name, the encoders of FFmpeg for them, and what qualities mean to each.

use super::layout::{Layout, Samples};
use super::process::{Programs, capture};
use crate::color::Subsampling;
use crate::error::VideoError;
use crate::info::PixelKind;
use crate::sink::EncodeOptions;
use ravec_raster::Size;

/// Bytes of the description of an encoder.
const MAX_DESCRIPTION: u64 = 1 << 20;
/// Threads of encoders. The number is fixed because it changes what some of them write.
const THREADS: &str = "8";
/// Least width of frames of more than 8 bit that the vector code of x265 encodes: it fails with 36 and 48 columns.
const MIN_X265_WIDTH: usize = 64;
/// Quality for which none is chosen.
const DEFAULT_QUALITY: u8 = 75;

/// Option that sets the quality.
#[derive(Debug, Clone, Copy)]
enum Scale {
    /// A constant rate factor at quality 0 and at quality 100.
    Crf(f64, f64),
    /// The same with the rate set to zero, as libvpx and libaom want it.
    CrfWithoutRate(f64, f64),
    /// Quantizers, fine to coarse.
    Quantizer,
    /// 0 to 10.
    Tenth,
    /// Profiles of `ProRes`.
    Profile,
    /// The encoder is lossless.
    Exact,
}

struct Encoder {
    codec: &'static str,
    name: &'static str,
    scale: Scale,
    /// Arguments for exact samples, if it can.
    lossless: Option<&'static [&'static str]>,
    /// Arguments in any case.
    extra: &'static [&'static str],
    /// Smallest side of a frame.
    min_side: usize,
}

const fn encoder(codec: &'static str, name: &'static str, scale: Scale) -> Encoder {
    Encoder {
        codec,
        name,
        scale,
        lossless: None,
        extra: &[],
        min_side: 1,
    }
}

const fn exact(codec: &'static str, name: &'static str) -> Encoder {
    Encoder {
        lossless: Some(&[]),
        ..encoder(codec, name, Scale::Exact)
    }
}

/// In the order of preference for each codec.
const ENCODERS: &[Encoder] = &[
    Encoder {
        lossless: Some(&["-qp", "0"]),
        ..encoder("h264", "libx264", Scale::Crf(40.0, 10.0))
    },
    // red, green and blue without conversion
    Encoder {
        lossless: Some(&["-qp", "0"]),
        ..encoder("h264", "libx264rgb", Scale::Crf(40.0, 10.0))
    },
    Encoder {
        lossless: Some(&["-x265-params", "log-level=error:frame-threads=4:lossless=1"]),
        extra: &["-x265-params", "log-level=error:frame-threads=4"],
        min_side: 16,
        ..encoder("hevc", "libx265", Scale::Crf(42.0, 12.0))
    },
    Encoder {
        extra: &["-preset", "8"],
        min_side: 64,
        ..encoder("av1", "libsvtav1", Scale::Crf(55.0, 13.0))
    },
    Encoder {
        lossless: Some(&["-aom-params", "lossless=1", "-cpu-used", "6"]),
        extra: &["-cpu-used", "6"],
        ..encoder("av1", "libaom-av1", Scale::CrfWithoutRate(55.0, 13.0))
    },
    Encoder {
        lossless: Some(&["-lossless", "1", "-cpu-used", "4"]),
        extra: &["-deadline", "good", "-cpu-used", "4", "-tile-columns", "2"],
        ..encoder("vp9", "libvpx-vp9", Scale::CrfWithoutRate(55.0, 13.0))
    },
    Encoder {
        extra: &["-deadline", "good", "-cpu-used", "4"],
        ..encoder("vp8", "libvpx", Scale::CrfWithoutRate(55.0, 8.0))
    },
    encoder("prores", "prores_ks", Scale::Profile),
    Encoder {
        extra: &["-level", "3", "-g", "1", "-slices", "4", "-slicecrc", "1"],
        ..exact("ffv1", "ffv1")
    },
    exact("ffvhuff", "ffvhuff"),
    exact("huffyuv", "huffyuv"),
    exact("utvideo", "utvideo"),
    exact("png", "png"),
    encoder("mjpeg", "mjpeg", Scale::Quantizer),
    encoder("mpeg4", "mpeg4", Scale::Quantizer),
    encoder("mpeg2video", "mpeg2video", Scale::Quantizer),
    encoder("mpeg1video", "mpeg1video", Scale::Quantizer),
    encoder("theora", "libtheora", Scale::Tenth),
];

/// Other names of codecs.
const ALIASES: &[(&str, &str)] = &[
    ("avc", "h264"),
    ("x264", "h264"),
    ("h265", "hevc"),
    ("x265", "hevc"),
    ("mpeg2", "mpeg2video"),
    ("mpeg1", "mpeg1video"),
    ("jpeg", "mjpeg"),
];

/// The codec of a container for which none is chosen. Alpha gets one that has it, where the container takes such a codec.
fn default_codec(extension: &str, lossless: bool, alpha: bool) -> &'static str {
    match (extension, lossless) {
        ("mov", false) if alpha => "prores",
        ("mkv" | "avi" | "nut", _) if alpha => "ffv1",
        ("webm", _) => "vp9",
        ("ogv" | "ogg", _) => "theora",
        ("mpg" | "mpeg" | "mxf", _) => "mpeg2video",
        ("mkv" | "avi" | "nut", true) => "ffv1",
        ("avi", false) | ("wmv", _) => "mpeg4",
        _ => "h264",
    }
}

/// An encoder with its arguments, and the layout that it gets.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Choice {
    pub(super) encoder: &'static str,
    pub(super) codec: &'static str,
    pub(super) arguments: Vec<String>,
    pub(super) layout: Layout,
}

/// Chooses the encoder and the layout for frames of these samples.
pub(super) fn choose(
    programs: &Programs,
    extension: &str,
    pixels: PixelKind,
    size: Size,
    options: &EncodeOptions,
) -> Result<Choice, VideoError> {
    let codec = codec_name(extension, pixels.has_alpha(), options)?;
    let candidates = ENCODERS.iter().filter(|encoder| {
        let side = size.width().min(size.height());
        encoder.codec == codec && encoder.min_side <= side
    });
    let (mut missing, mut inexact, mut best) = (Vec::new(), None, None::<(u32, &Encoder, Layout)>);
    for encoder in candidates {
        if options.lossless && encoder.lossless.is_none() {
            inexact.get_or_insert(encoder.name);
            continue;
        }
        let Some(layouts) = layouts(programs, encoder.name)? else {
            missing.push(encoder.name);
            continue;
        };
        let ranked = layouts
            .into_iter()
            .map(|layout| (loss(pixels, &layout), layout));
        let Some((lost, layout)) = ranked.min_by_key(|(lost, _)| *lost) else {
            continue;
        };
        if options.lossless && !holds(pixels, &layout) {
            inexact = Some(encoder.name);
            continue;
        }
        // earlier encoders are preferred unless they lose more than they must
        if best.as_ref().is_none_or(|(least, ..)| lost < *least) {
            best = Some((lost, encoder, layout));
        }
    }
    if let Some((_, encoder, layout)) = best {
        return Ok(Choice {
            encoder: encoder.name,
            codec: encoder.codec,
            arguments: encoder.arguments(&layout, size, options),
            layout,
        });
    }
    Err(VideoError::Options(match inexact {
        Some(name) if options.lossless => format!(
            "{codec} by {name} cannot keep these samples exactly: choose the codec ffv1 in an mkv file, or leave `lossless` out"
        ),
        _ if missing.is_empty() => format!("frames of {size} pixels are too small for {codec}"),
        _ => format!(
            "this FFmpeg has no encoder for {codec} ({}): install one that has, or choose another `codec`",
            missing.join(", ")
        ),
    }))
}

fn codec_name(
    extension: &str,
    alpha: bool,
    options: &EncodeOptions,
) -> Result<&'static str, VideoError> {
    let Some(name) = &options.codec else {
        return Ok(default_codec(extension, options.lossless, alpha));
    };
    let name = name.to_ascii_lowercase();
    let name = ALIASES
        .iter()
        .find(|(alias, _)| *alias == name)
        .map_or(name.as_str(), |(_, codec)| codec);
    let found = ENCODERS
        .iter()
        .find(|encoder| encoder.codec == name || encoder.name == name);
    found.map(|encoder| encoder.codec).ok_or_else(|| {
        let mut names: Vec<_> = ENCODERS.iter().map(|encoder| encoder.codec).collect();
        names.dedup();
        let short: String = name.chars().take(40).collect();
        VideoError::Options(format!(
            "no codec is called `{short}`: {} are known",
            names.join(", ")
        ))
    })
}

/// The layouts that an encoder takes; `None` if this FFmpeg does not have it.
fn layouts(programs: &Programs, encoder: &str) -> Result<Option<Vec<Layout>>, VideoError> {
    let mut command = programs.ffmpeg();
    command.args(["-h", &format!("encoder={encoder}")]);
    let answer = capture(&mut command, MAX_DESCRIPTION)?;
    let text = String::from_utf8_lossy(&answer.stdout);
    let names = text
        .lines()
        .find_map(|line| line.trim().strip_prefix("Supported pixel formats:"));
    Ok(names.map(|names| {
        let known = names.split_whitespace().filter_map(Layout::parse);
        // a layout without a name in raw streams does not go through the pipe
        known.filter(|layout| layout.fourcc().is_some()).collect()
    }))
}

/// Penalty for what a layout loses of the samples, with a small one for what it adds.
fn loss(pixels: PixelKind, layout: &Layout) -> u32 {
    let (depth, alpha) = match pixels {
        PixelKind::Yuv { format, .. } => (format.depth, format.alpha),
        PixelKind::Rgb { depth, alpha } => (depth.min(16), alpha),
    };
    let mut sum = if layout.depth < depth {
        100 * (depth - layout.depth)
    } else {
        layout.depth - depth
    };
    if alpha != layout.alpha() {
        // nothing else that can be lost is worth more
        sum += if alpha { 100_000 } else { 20 };
    }
    let chroma = |subsampling| match subsampling {
        Subsampling::Gray => 0,
        Subsampling::S420 | Subsampling::S411 => 2,
        Subsampling::S422 | Subsampling::S440 => 3,
        Subsampling::S444 => 4,
    };
    sum += match (pixels, layout.yuv_format().map(|format| format.subsampling)) {
        (PixelKind::Yuv { format, .. }, Some(subsampling)) if format.subsampling == subsampling => {
            0
        }
        (PixelKind::Yuv { format, .. }, Some(subsampling)) => {
            let (has, gets) = (chroma(format.subsampling), chroma(subsampling));
            if gets < has {
                10_000 * (has - gets)
            } else {
                30 + 10 * (gets - has)
            }
        }
        (PixelKind::Yuv { .. }, None) => 8000,
        (PixelKind::Rgb { .. }, Some(subsampling)) => 1000 + 10_000 * (4 - chroma(subsampling)),
        (PixelKind::Rgb { .. }, None) => {
            u32::from(matches!(layout.samples, Samples::PlanarRgb { .. }))
        }
    };
    // the names that imply the full range come second
    sum + u32::from(layout.full)
}

/// True if the layout holds the samples exactly.
fn holds(pixels: PixelKind, layout: &Layout) -> bool {
    match pixels {
        PixelKind::Yuv { format, color } => {
            layout.yuv_format() == Some(format)
                && layout
                    .implied_range()
                    .is_none_or(|range| range == color.range)
        }
        PixelKind::Rgb { depth, alpha } => {
            layout.yuv_format().is_none() && depth == layout.depth && (layout.alpha() || !alpha)
        }
    }
}

impl Encoder {
    fn arguments(&self, layout: &Layout, size: Size, options: &EncodeOptions) -> Vec<String> {
        let quality = f64::from(options.quality.unwrap_or(DEFAULT_QUALITY).min(100)) / 100.0;
        let crf = |low: f64, high: f64| format!("{}", (low + (high - low) * quality).round());
        let mut arguments: Vec<String> = ["-threads", THREADS].map(str::to_owned).to_vec();
        let mut add = |more: &[&str]| arguments.extend(more.iter().map(|text| (*text).to_owned()));
        if options.lossless {
            add(self.lossless.unwrap_or_default());
            if matches!(self.scale, Scale::Exact) {
                add(self.extra);
            }
        } else {
            add(self.extra);
            match self.scale {
                Scale::Crf(low, high) => add(&["-crf", &crf(low, high)]),
                Scale::CrfWithoutRate(low, high) => add(&["-crf", &crf(low, high), "-b:v", "0"]),
                // the visible difference between quantizers is in their ratio
                Scale::Quantizer => {
                    let value = 1.0 + 30.0 * (1.0 - quality) * (1.0 - quality);
                    add(&["-qmin", "1", "-q:v", &format!("{}", value.round())]);
                }
                Scale::Tenth => add(&["-q:v", &format!("{}", (10.0 * quality).round())]),
                Scale::Profile | Scale::Exact => {}
            }
        }
        if matches!(self.scale, Scale::Profile) {
            let full = layout
                .yuv_format()
                .is_some_and(|format| format.subsampling == Subsampling::S444);
            let profile = match options.quality.unwrap_or(DEFAULT_QUALITY) {
                _ if full => "4",
                0..25 => "0",
                25..50 => "1",
                50..75 => "2",
                _ => "3",
            };
            add(&["-profile:v", profile]);
        }
        // x265 writes beyond its buffers in its vector code where such frames are narrow
        let breaks = self.codec == "hevc" && layout.depth > 8 && size.width() < MIN_X265_WIDTH;
        if breaks
            && let Some(at) = arguments.iter().position(|text| text == "-x265-params")
            && let Some(params) = arguments.get_mut(at + 1)
        {
            params.push_str(":asm=0");
        }
        let mut add = |more: &[&str]| arguments.extend(more.iter().map(|text| (*text).to_owned()));
        if self.codec.starts_with("vp") && layout.alpha() {
            // frames that are not shown have no place for alpha
            add(&["-auto-alt-ref", "0"]);
        }
        arguments
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::ColorInfo;
    use crate::yuv::YuvFormat;

    fn best(pixels: PixelKind, names: &str) -> String {
        let layouts = names.split(' ').filter_map(Layout::parse);
        layouts
            .min_by_key(|layout| loss(pixels, layout))
            .unwrap()
            .name
    }

    fn planes(subsampling: Subsampling, depth: u32, alpha: bool) -> PixelKind {
        PixelKind::Yuv {
            format: YuvFormat {
                subsampling,
                depth,
                alpha,
            },
            color: ColorInfo::guess(480),
        }
    }

    #[test]
    fn the_nearest_layout_keeps_alpha_then_chroma_then_depth() {
        let x264 = "yuv420p yuvj420p yuv422p yuvj422p yuv444p yuvj444p yuv420p10le yuv422p10le yuv444p10le gray gray10le";
        assert_eq!(best(planes(Subsampling::S420, 8, false), x264), "yuv420p");
        assert_eq!(
            best(planes(Subsampling::S422, 12, false), x264),
            "yuv422p10le"
        );
        assert_eq!(best(planes(Subsampling::S444, 8, true), x264), "yuv444p");
        assert_eq!(best(planes(Subsampling::S411, 8, false), x264), "yuv420p");
        assert_eq!(best(planes(Subsampling::S440, 8, false), x264), "yuv422p");
        assert_eq!(best(planes(Subsampling::Gray, 8, false), x264), "gray");
        let rgb = |depth, alpha| PixelKind::Rgb { depth, alpha };
        assert_eq!(best(rgb(8, false), x264), "yuv444p");
        let prores = "yuv422p10le yuv444p10le yuva444p10le";
        assert_eq!(
            best(planes(Subsampling::S420, 8, false), prores),
            "yuv422p10le"
        );
        assert_eq!(best(rgb(8, true), prores), "yuva444p10le");
        let vp9 = "yuv420p yuva420p yuv422p yuv444p gbrp";
        assert_eq!(best(rgb(8, true), vp9), "yuva420p");
        assert_eq!(best(planes(Subsampling::S444, 8, true), vp9), "yuva420p");
        let ffv1 = "yuv420p yuva420p bgr0 bgra gbrp10le gbrp16le rgb48le rgba64le";
        assert_eq!(best(rgb(8, false), ffv1), "bgr0");
        assert_eq!(best(rgb(8, true), ffv1), "bgra");
        assert_eq!(best(rgb(16, false), ffv1), "rgb48le");
        assert_eq!(best(planes(Subsampling::S420, 8, true), ffv1), "yuva420p");
    }

    #[test]
    fn more_quality_is_a_finer_quantizer() {
        let layout = Layout::parse("yuv420p").unwrap();
        for encoder in ENCODERS.iter().filter(|encoder| {
            matches!(
                encoder.scale,
                Scale::Crf(..) | Scale::CrfWithoutRate(..) | Scale::Quantizer
            )
        }) {
            let value = |quality| -> u32 {
                let options = EncodeOptions {
                    quality: Some(quality),
                    ..EncodeOptions::default()
                };
                let arguments = encoder.arguments(&layout, Size::new(320, 240).unwrap(), &options);
                let at = arguments
                    .iter()
                    .position(|name| name == "-crf" || name == "-q:v")
                    .unwrap();
                arguments[at + 1].parse().unwrap()
            };
            let values = [0, 25, 50, 75, 100].map(value);
            assert!(
                values.is_sorted_by(|a, b| a > b),
                "{}: {values:?}",
                encoder.name
            );
        }
    }

    #[test]
    fn codecs_have_their_usual_names() {
        let name = |codec: &str| {
            let options = EncodeOptions {
                codec: Some(codec.to_owned()),
                ..EncodeOptions::default()
            };
            codec_name("mkv", false, &options)
        };
        assert_eq!(name("H265").unwrap(), "hevc");
        assert_eq!(name("libx264").unwrap(), "h264");
        assert_eq!(name("ffv1").unwrap(), "ffv1");
        let usual = |extension: &str, alpha: bool| {
            codec_name(extension, alpha, &EncodeOptions::default()).unwrap()
        };
        assert_eq!(
            (usual("mov", false), usual("mov", true)),
            ("h264", "prores")
        );
        assert_eq!((usual("webm", true), usual("mkv", true)), ("vp9", "ffv1"));
        let message = name("-y").unwrap_err().to_string();
        assert!(message.contains("no codec is called `-y`"), "{message}");
    }
}

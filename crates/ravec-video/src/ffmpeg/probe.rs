//! Properties of a clip, from `ffprobe`.

use super::layout::{Layout, reading_layout};
use super::process::{Ended, Programs, capture, input_arguments};
use crate::color::{ColorInfo, Range, Siting, SitingAxis, Subsampling};
use crate::error::VideoError;
use crate::info::{ClipInfo, Container, OtherTrack, PixelKind, Rotation, TrackKind};
use crate::limits::VideoLimits;
use crate::time::{Rational, rescale};
use crate::turn::{is_quarter, turned_color, turned_format};
use ravec_raster::Size;
use serde::Deserialize;
use std::path::Path;

/// Bytes of the answer of `ffprobe`. A file with a thousand tracks and long tags stays below.
const MAX_ANSWER: u64 = 16 << 20;
/// Microseconds, in which a format states its start.
const MICROSECONDS: (u32, u32) = (1, 1_000_000);

#[derive(Debug, Default, Deserialize)]
struct Answer {
    #[serde(default)]
    streams: Vec<Stream>,
    #[serde(default)]
    format: Format,
}

#[derive(Debug, Default, Deserialize)]
struct Format {
    start_time: Option<String>,
    duration: Option<String>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Stream {
    index: u32,
    codec_type: String,
    codec_name: Option<String>,
    width: Option<i64>,
    height: Option<i64>,
    pix_fmt: Option<String>,
    field_order: Option<String>,
    sample_aspect_ratio: Option<String>,
    color_range: Option<String>,
    color_space: Option<String>,
    color_primaries: Option<String>,
    color_transfer: Option<String>,
    chroma_location: Option<String>,
    time_base: Option<String>,
    avg_frame_rate: Option<String>,
    r_frame_rate: Option<String>,
    start_pts: Option<i64>,
    duration_ts: Option<i64>,
    nb_frames: Option<String>,
    has_b_frames: Option<u64>,
    disposition: Disposition,
    tags: Tags,
    side_data_list: Vec<SideData>,
}

/// The most frames that any codec holds back.
const MAX_REORDERED: u64 = 16;

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Disposition {
    attached_pic: i64,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Tags {
    language: Option<String>,
    #[serde(alias = "ALPHA_MODE")]
    alpha_mode: Option<String>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct SideData {
    displaymatrix: Option<String>,
}

/// A clip as FFmpeg sees it.
#[derive(Debug, Clone)]
pub(super) struct Probe {
    pub(super) info: ClipInfo,
    /// Number of the track of frames among all tracks.
    pub(super) track: u32,
    /// Layout in which frames are read.
    pub(super) layout: Layout,
    /// Size and meaning of frames as stored.
    pub(super) stored_size: Size,
    pub(super) stored_color: ColorInfo,
    /// Ticks of FFmpeg's clock at the start of the clip.
    pub(super) start: i64,
    /// Ticks from the start of the clip to the end of the track, if stated.
    pub(super) end: Option<i64>,
    /// The decoder to choose, where the usual one leaves something out.
    pub(super) decoder: Option<&'static str>,
    /// True if each packet of the file should be a frame.
    pub(super) frame_a_packet: bool,
    /// The most frames that the decoder holds back because they are shown later.
    pub(super) reordered: u64,
}

impl Probe {
    /// Asks `ffprobe`.
    pub(super) fn of_file(
        programs: &Programs,
        path: &Path,
        limits: &VideoLimits,
    ) -> Result<Self, VideoError> {
        if std::fs::metadata(path)?.len() == 0 {
            return Err(VideoError::Empty);
        }
        let mut command = programs.ffprobe();
        command.args(["-print_format", "json", "-show_format", "-show_streams"]);
        command.args(input_arguments(path)?);
        let answer = capture(&mut command, MAX_ANSWER)?;
        if !answer.ended.status.success() {
            return Err(refusal(&answer.ended, path));
        }
        let answer: Answer =
            serde_json::from_slice(&answer.stdout).map_err(|error| VideoError::FfmpegFailed {
                message: format!("the answer of ffprobe cannot be read: {error}"),
            })?;
        Self::of_answer(&answer, limits)
    }

    fn of_answer(answer: &Answer, limits: &VideoLimits) -> Result<Self, VideoError> {
        let is_frames =
            |stream: &&Stream| stream.codec_type == "video" && stream.disposition.attached_pic == 0;
        let Some(stream) = answer.streams.iter().find(is_frames) else {
            return Err(VideoError::NoVideo {
                tracks: count_tracks(&answer.streams),
            });
        };
        let damaged = |reason: &str| VideoError::Damaged {
            reason: reason.to_owned(),
        };
        let side = |side: Option<i64>| side.and_then(|side| u64::try_from(side).ok()).unwrap_or(0);
        let codec = stream.codec_name.clone();
        let (Some(codec), Some(pix_fmt)) =
            (codec.filter(|name| name != "unknown"), &stream.pix_fmt)
        else {
            return Err(no_decoder(stream));
        };
        let stored_size = limits.check_size(side(stream.width), side(stream.height))?;
        let rotation = rotation(stream)?;
        let decoder = alpha_decoder(&codec, stream);
        let name = match (decoder, pix_fmt.as_str()) {
            (Some(_), "yuv420p") => "yuva420p",
            (_, name) => name,
        };
        let layout = reading_layout(name)?;
        let stored_color = color(stream, stored_size, &layout)?;
        let time_base = fraction(stream.time_base.as_deref())
            .ok_or_else(|| damaged("its time stamps have no unit"))?;
        let rate = [&stream.avg_frame_rate, &stream.r_frame_rate]
            .into_iter()
            .find_map(|rate| fraction(rate.as_deref()));
        let start = clip_start(answer, time_base)
            .or(stream.start_pts)
            .unwrap_or(0);
        let length = stream.duration_ts.filter(|ticks| *ticks > 0);
        let end = stream
            .start_pts
            .zip(length)
            .and_then(|(first, length)| first.checked_sub(start)?.checked_add(length));
        let duration = length.or_else(|| format_duration(answer, time_base));
        let turned_size = if is_quarter(rotation) {
            stored_size.transposed()
        } else {
            stored_size
        };
        let mut aspect = fraction(stream.sample_aspect_ratio.as_deref()).unwrap_or(Rational::ONE);
        if is_quarter(rotation) {
            aspect = aspect.recip();
        }
        let others = answer
            .streams
            .iter()
            .filter(|other| other.index != stream.index);
        Ok(Self {
            info: ClipInfo {
                container: Container::Ffmpeg,
                codec,
                size: turned_size,
                rotation,
                pixels: turned_pixels(&layout, stored_color, rotation),
                pixel_aspect: aspect,
                time_base,
                rate,
                variable_rate: None,
                frames: stream
                    .nb_frames
                    .as_ref()
                    .and_then(|count| count.parse().ok()),
                duration: duration.and_then(|ticks| u64::try_from(ticks).ok()),
                other_tracks: others.map(other_track).collect(),
            },
            frame_a_packet: is_frame_a_packet(stream),
            reordered: stream
                .has_b_frames
                .unwrap_or(MAX_REORDERED)
                .min(MAX_REORDERED),
            track: stream.index,
            layout,
            stored_size,
            stored_color,
            start,
            end,
            decoder,
        })
    }
}

/// The sentence for a file that FFmpeg does not open.
fn refusal(ended: &Ended, path: &Path) -> VideoError {
    if ended.lines.iter().any(|line| line.contains("whitelist")) {
        return VideoError::Unsupported {
            feature: "this kind of file".to_owned(),
            hint: Some("it is none that holds its frames itself".to_owned()),
        };
    }
    let message = ended.message();
    let message = message.as_str();
    let own = format!("file:{}: ", path.display());
    let message = message.strip_prefix(&own).unwrap_or(message);
    let message = message.rsplit_once(": ").map_or(message, |(start, end)| {
        // "file:/a/b.mkv: Invalid data found": the path is named by the caller
        if start.starts_with("file:") {
            end
        } else {
            message
        }
    });
    if message.starts_with("Invalid data found") {
        return VideoError::UnknownFormat;
    }
    VideoError::Damaged {
        reason: message.to_owned(),
    }
}

fn count_tracks(streams: &[Stream]) -> String {
    let count = |kind: &str| {
        streams
            .iter()
            .filter(|stream| stream.codec_type == kind)
            .count()
    };
    let tracks: Vec<String> = [
        ("audio", "audio"),
        ("subtitle", "subtitle"),
        ("video", "picture"),
    ]
    .into_iter()
    .filter_map(|(kind, name)| match count(kind) {
        0 => None,
        1 => Some(format!("1 {name} track")),
        many => Some(format!("{many} {name} tracks")),
    })
    .collect();
    if tracks.is_empty() {
        "no tracks at all".to_owned()
    } else {
        tracks.join(", ")
    }
}

fn no_decoder(stream: &Stream) -> VideoError {
    let (feature, hint) = match stream
        .codec_name
        .as_deref()
        .filter(|name| *name != "unknown")
    {
        Some(codec) => (
            format!("the codec {codec}, as this FFmpeg decodes it,"),
            "install an FFmpeg that decodes it; the file may also be damaged",
        ),
        None => (
            "the codec of this file, which this FFmpeg does not know,".to_owned(),
            "install a newer FFmpeg",
        ),
    };
    VideoError::Unsupported {
        feature,
        hint: Some(hint.to_owned()),
    }
}

/// The decoders of FFmpeg itself leave out alpha of VP8 and VP9; those of libvpx have it.
fn alpha_decoder(codec: &str, stream: &Stream) -> Option<&'static str> {
    match (stream.tags.alpha_mode.as_deref(), codec) {
        (Some("1"), "vp8") => Some("libvpx"),
        (Some("1"), "vp9") => Some("libvpx-vp9"),
        _ => None,
    }
}

/// Codecs and layouts for which a packet is a frame that is shown, and a key packet makes a decoder start anew.
fn is_frame_a_packet(stream: &Stream) -> bool {
    let progressive = matches!(
        stream.field_order.as_deref(),
        None | Some("progressive" | "unknown")
    );
    let codecs = [
        "h264",
        "hevc",
        "vvc",
        "av1",
        "vp9",
        "mpeg4",
        "mpeg2video",
        "mpeg1video",
        "ffv1",
        "prores",
        "mjpeg",
        "dnxhd",
        "huffyuv",
        "ffvhuff",
        "utvideo",
        "rawvideo",
        "png",
        "qtrle",
        "v210",
        "cfhd",
    ];
    progressive && codecs.contains(&stream.codec_name.as_deref().unwrap_or_default())
}

fn turned_pixels(layout: &Layout, color: ColorInfo, rotation: Rotation) -> PixelKind {
    let pixels = layout.pixels(color);
    let PixelKind::Yuv { format, color } = pixels else {
        return pixels;
    };
    match turned_format(format, rotation) {
        Some(format) => PixelKind::Yuv {
            format,
            color: turned_color(color, rotation),
        },
        None => PixelKind::Rgb {
            depth: if format.depth > 8 { 16 } else { 8 },
            alpha: format.alpha,
        },
    }
}

fn other_track(stream: &Stream) -> OtherTrack {
    let kind = match stream.codec_type.as_str() {
        "audio" => TrackKind::Audio,
        "subtitle" => TrackKind::Subtitles,
        _ => TrackKind::Data,
    };
    OtherTrack {
        kind,
        codec: stream
            .codec_name
            .clone()
            .unwrap_or_else(|| "unknown".to_owned()),
        language: stream
            .tags
            .language
            .clone()
            .filter(|language| language != "und"),
    }
}

/// A positive fraction such as `30000/1001` or `4:3`; `0/0` and others are none.
fn fraction(text: Option<&str>) -> Option<Rational> {
    let (num, den) = text?.split_once(['/', ':'])?;
    Rational::new(num.parse().ok()?, den.parse().ok()?)
}

/// A decimal number of seconds as microseconds.
fn microseconds(text: &str) -> Option<i64> {
    let seconds: f64 = text.parse().ok()?;
    (seconds.abs() < 1e12).then(|| (seconds * 1e6).round() as i64)
}

fn format_ticks(text: Option<&String>, time_base: Rational) -> Option<i64> {
    let micro = Rational::new(MICROSECONDS.0, MICROSECONDS.1)?;
    Some(rescale(microseconds(text?)?, micro, time_base))
}

fn clip_start(answer: &Answer, time_base: Rational) -> Option<i64> {
    format_ticks(answer.format.start_time.as_ref(), time_base)
}

fn format_duration(answer: &Answer, time_base: Rational) -> Option<i64> {
    format_ticks(answer.format.duration.as_ref(), time_base)
}

/// The turn that the display matrix of a track asks for.
fn rotation(stream: &Stream) -> Result<Rotation, VideoError> {
    let Some(matrix) = stream
        .side_data_list
        .iter()
        .find_map(|data| data.displaymatrix.as_ref())
    else {
        return Ok(Rotation::None);
    };
    // lines such as "00000000:       0   65536       0"
    let rows: Vec<Vec<i64>> = matrix
        .lines()
        .filter_map(|line| line.split_once(':'))
        .map(|(_, row)| {
            row.split_whitespace()
                .map_while(|value| value.parse().ok())
                .collect()
        })
        .collect();
    let at = |row: usize, col: usize| {
        rows.get(row)
            .and_then(|row: &Vec<i64>| row.get(col))
            .copied()
            .unwrap_or(0)
    };
    let signs = [at(0, 0), at(0, 1), at(1, 0), at(1, 1)].map(i64::signum);
    match signs {
        [1, 0, 0, 1] | [0, 0, 0, 0] => Ok(Rotation::None),
        [0, 1, -1, 0] => Ok(Rotation::Clockwise),
        [-1, 0, 0, -1] => Ok(Rotation::Half),
        [0, -1, 1, 0] => Ok(Rotation::Counterclockwise),
        _ => Err(VideoError::Unsupported {
            feature: "a display matrix that mirrors the frames, or turns them by no multiple of 90 degrees,".to_owned(),
            hint: Some("convert the clip with FFmpeg, which applies it".to_owned()),
        }),
    }
}

/// The meaning of samples, from the names of FFmpeg.
fn color(stream: &Stream, size: Size, layout: &Layout) -> Result<ColorInfo, VideoError> {
    let mut color = ColorInfo::guess(size.height());
    let space = stream.color_space.as_deref();
    if matches!(
        space,
        Some("ycgco" | "ycgco-re" | "ycgco-ro" | "ictcp" | "chroma-derived-c")
    ) && layout.yuv_format().is_some()
    {
        return Err(VideoError::Unsupported {
            feature: format!("the color matrix {}", space.unwrap_or_default()),
            hint: None,
        });
    }
    if let Some(code) = space.and_then(|name| code_of(MATRICES, name)) {
        color.set_matrix_code(code);
    }
    let range = match stream.color_range.as_deref() {
        Some("tv") => Some(Range::Limited),
        Some("pc") => Some(Range::Full),
        _ => layout.implied_range(),
    };
    if let Some(range) = range {
        color.range = range;
        color.tagged = true;
    }
    let code = |table, name: &Option<String>| name.as_deref().and_then(|name| code_of(table, name));
    color.primaries = code(PRIMARIES, &stream.color_primaries).unwrap_or(color.primaries);
    color.transfer = code(TRANSFERS, &stream.color_transfer).unwrap_or(color.transfer);
    let axes = match stream.chroma_location.as_deref() {
        Some("left") => Some(Siting::LEFT),
        Some("center") => Some(Siting::CENTER),
        Some("topleft") => Some(Siting::TOP_LEFT),
        Some("top") => Some(Siting {
            x: SitingAxis::Center,
            y: SitingAxis::First,
        }),
        Some("bottomleft") => Some(Siting {
            x: SitingAxis::First,
            y: SitingAxis::Last,
        }),
        Some("bottom") => Some(Siting {
            x: SitingAxis::Center,
            y: SitingAxis::Last,
        }),
        _ => None,
    };
    color.siting = match (axes, stream.codec_name.as_deref()) {
        (Some(axes), _) => axes,
        (None, Some("mjpeg" | "mpeg1video")) => Siting::CENTER,
        (None, _) => color.siting,
    };
    if layout
        .yuv_format()
        .is_none_or(|format| format.subsampling == Subsampling::S444)
    {
        // nothing depends on it; the usual value keeps frames comparable
        color.siting = Siting::LEFT;
    }
    Ok(color)
}

type Names = &'static [(u8, &'static str)];

/// Names of FFmpeg for the codes of H.273.
const MATRICES: Names = &[
    (1, "bt709"),
    (4, "fcc"),
    (5, "bt470bg"),
    (6, "smpte170m"),
    (7, "smpte240m"),
    (9, "bt2020nc"),
    (10, "bt2020c"),
];
const PRIMARIES: Names = &[
    (1, "bt709"),
    (4, "bt470m"),
    (5, "bt470bg"),
    (6, "smpte170m"),
    (7, "smpte240m"),
    (8, "film"),
    (9, "bt2020"),
    (10, "smpte428"),
    (11, "smpte431"),
    (12, "smpte432"),
    (22, "ebu3213"),
];
const TRANSFERS: Names = &[
    (1, "bt709"),
    (4, "bt470m"),
    (5, "bt470bg"),
    (6, "smpte170m"),
    (7, "smpte240m"),
    (8, "linear"),
    (9, "log100"),
    (10, "log316"),
    (11, "iec61966-2-4"),
    (12, "bt1361e"),
    (13, "iec61966-2-1"),
    (14, "bt2020-10"),
    (15, "bt2020-12"),
    (16, "smpte2084"),
    (17, "smpte428"),
    (18, "arib-std-b67"),
];

fn code_of(table: Names, name: &str) -> Option<u8> {
    table
        .iter()
        .find(|(_, known)| *known == name)
        .map(|(code, _)| *code)
}

//! Encoded parts and the tracks of another clip, joined without encoding anything again.

use super::process::{Programs, add, capture, file_argument, input_arguments, run};
use super::sink::read_part_start;
use crate::error::VideoError;
use serde::Deserialize;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Bytes of the answer of `ffprobe`.
const MAX_ANSWER: u64 = 16 << 20;

/// The clip whose sound and subtitles are copied, and the time from which they are.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackExcerpt<'a> {
    /// Its file.
    pub path: &'a Path,
    /// Seconds from its start to the first frame of the output.
    pub start_secs: f64,
    /// Seconds from its start to the end of the last frame of the output; `None` for all that follows.
    pub end_secs: Option<f64>,
}

/// Joins `parts`, which [`FfmpegSink`](super::FfmpegSink)s have written one after the other with the same format and options,
/// to the file `output`, which is replaced. `extension` decides on the container. The first frame gets the time 0, and
/// the others keep their distance to it.
///
/// Returns a sentence for each track that the container cannot hold, which is left out.
///
/// # Errors
/// [`VideoError::FfmpegMissing`], [`VideoError::UnknownExtension`], [`VideoError::FfmpegFailed`] if FFmpeg refuses, such as for
/// a codec that the container does not have.
pub fn assemble(
    parts: &[PathBuf],
    tracks: Option<TrackExcerpt<'_>>,
    output: &Path,
    extension: &str,
) -> Result<Vec<String>, VideoError> {
    let extension = extension.to_ascii_lowercase();
    let Some(muxer) = muxer(&extension) else {
        return Err(VideoError::UnknownExtension { extension });
    };
    let programs = Programs::locate(&format!("writing .{extension}"))?;
    let list = list_of_parts(&programs, parts)?;
    let mut warnings = Vec::new();

    let mut command = programs.ffmpeg();
    command.args([
        "-protocol_whitelist",
        "file,pipe",
        "-f",
        "concat",
        "-safe",
        "0",
        "-i",
        "pipe:0",
    ]);
    let mut maps = vec!["0:v:0".to_owned()];
    if let Some(excerpt) = tracks {
        let other = streams(&programs, excerpt.path)?;
        for stream in other.streams {
            let kind = match stream.codec_type.as_str() {
                "audio" => "audio",
                "subtitle" => "subtitle",
                _ => continue,
            };
            let codec = stream.codec_name.unwrap_or_else(|| "unknown".to_owned());
            if accepts(&extension, kind, &codec) {
                maps.push(format!("1:{}", stream.index));
            } else {
                warnings.push(format!(
                    "the {kind} track {} ({codec}) was left out: .{extension} files cannot hold it",
                    stream.index
                ));
            }
        }
        if maps.len() > 1 {
            command.args(["-ss", &format!("{:.6}", excerpt.start_secs)]);
            if let Some(end) = excerpt.end_secs {
                command.args(["-t", &format!("{:.6}", (end - excerpt.start_secs).max(0.0))]);
            }
            add(&mut command, input_arguments(excerpt.path)?);
        }
    }
    for map in &maps {
        command.args(["-map", map]);
    }
    command.args([
        "-c",
        "copy",
        "-copypriorss",
        "0",
        "-map_metadata:g",
        "-1",
        "-map_chapters",
        "-1",
    ]);
    command.args([
        "-fflags",
        "+bitexact",
        "-flags",
        "+bitexact",
        "-max_interleave_delta",
        "0",
    ]);
    match muxer {
        "mp4" | "mov" => {
            command.args(["-movflags", "+faststart"]);
            if list.codec == "hevc" {
                // the tag under which all players find it
                command.args(["-tag:v", "hvc1"]);
            }
        }
        "mpegts" => {
            command.args(["-muxdelay", "0", "-muxpreload", "0"]);
        }
        _ => {}
    }
    command
        .args(["-f", muxer, "-y"])
        .arg(file_argument(output)?);
    run(&mut command, list.text.as_bytes())?;
    Ok(warnings)
}

/// The container of an extension.
fn muxer(extension: &str) -> Option<&'static str> {
    Some(match extension {
        "mkv" => "matroska",
        "webm" => "webm",
        "mp4" | "m4v" => "mp4",
        "mov" => "mov",
        "avi" => "avi",
        "ts" | "m2ts" | "mts" => "mpegts",
        "mpg" | "mpeg" => "mpeg",
        "wmv" => "asf",
        "flv" => "flv",
        "ogv" => "ogg",
        "3gp" => "3gp",
        "mxf" => "mxf",
        "nut" => "nut",
        _ => return None,
    })
}

/// True if the container holds tracks of that codec. FFmpeg itself refuses the whole file for one that it does not.
fn accepts(extension: &str, kind: &str, codec: &str) -> bool {
    let pcm = codec.starts_with("pcm_");
    if kind == "subtitle" {
        return match extension {
            "mkv" => [
                "subrip",
                "ass",
                "ssa",
                "webvtt",
                "hdmv_pgs_subtitle",
                "dvd_subtitle",
                "dvb_subtitle",
            ]
            .contains(&codec),
            "webm" => codec == "webvtt",
            "mp4" | "m4v" | "mov" => codec == "mov_text",
            "ts" | "m2ts" | "mts" => codec == "dvb_subtitle",
            "nut" => ["subrip", "ass", "ssa"].contains(&codec),
            _ => false,
        };
    }
    match extension {
        "mkv" | "nut" => codec != "unknown",
        "webm" => ["opus", "vorbis"].contains(&codec),
        "mp4" | "m4v" => [
            "aac", "mp3", "mp2", "ac3", "eac3", "opus", "flac", "alac", "vorbis",
        ]
        .contains(&codec),
        "mov" => pcm || ["aac", "mp3", "ac3", "eac3", "alac", "mp2"].contains(&codec),
        "3gp" => ["aac", "amr_nb", "amr_wb"].contains(&codec),
        "avi" => {
            pcm && codec.ends_with("le") || ["mp3", "mp2", "ac3", "aac", "pcm_u8"].contains(&codec)
        }
        "ts" | "m2ts" | "mts" => {
            ["aac", "mp3", "mp2", "ac3", "eac3", "opus", "dts"].contains(&codec)
        }
        "mpg" | "mpeg" => ["mp2", "mp3", "ac3"].contains(&codec),
        "wmv" => ["wmav1", "wmav2", "mp3", "pcm_s16le"].contains(&codec),
        "flv" => ["aac", "mp3"].contains(&codec),
        "ogv" => ["vorbis", "opus", "flac", "speex"].contains(&codec),
        "mxf" => ["pcm_s16le", "pcm_s24le"].contains(&codec),
        _ => false,
    }
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Streams {
    streams: Vec<Stream>,
    format: Format,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Stream {
    index: u32,
    codec_type: String,
    codec_name: Option<String>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Format {
    tags: Tags,
}

#[derive(Debug, Default, Deserialize)]
#[serde(default)]
struct Tags {
    #[serde(alias = "COMMENT")]
    comment: Option<String>,
}

fn streams(programs: &Programs, path: &Path) -> Result<Streams, VideoError> {
    let mut command = programs.ffprobe();
    command.args(["-print_format", "json", "-show_entries"]);
    command.arg("stream=index,codec_type,codec_name:format_tags=comment");
    add(&mut command, input_arguments(path)?);
    let answer = capture(&mut command, MAX_ANSWER)?;
    if !answer.ended.status.success() {
        return Err(answer.ended.into_error());
    }
    serde_json::from_slice(&answer.stdout).map_err(|error| VideoError::FfmpegFailed {
        message: format!("the answer of ffprobe cannot be read: {error}"),
    })
}

/// The parts as FFmpeg's list of files.
struct List {
    text: String,
    codec: String,
}

/// Lists the parts with the times from the start of each to the start of the next. Each time is the difference of two starts
/// that were rounded to microseconds, so that errors do not add up, and none is left where ticks are longer than some
/// microseconds.
fn list_of_parts(programs: &Programs, parts: &[PathBuf]) -> Result<List, VideoError> {
    let failed = |message: &str| VideoError::FfmpegFailed {
        message: message.to_owned(),
    };
    let mut starts = Vec::new();
    let mut codec = String::new();
    for part in parts {
        let found = streams(programs, part)?;
        let start = found
            .format
            .tags
            .comment
            .as_deref()
            .and_then(read_part_start);
        starts.push(start.ok_or_else(|| failed("a part was not written by this program"))?);
        if let Some(stream) = found.streams.first() {
            codec = stream.codec_name.clone().unwrap_or_default();
        }
    }
    let mut text = "ffconcat version 1.0\n".to_owned();
    for (number, part) in parts.iter().enumerate() {
        let argument = file_argument(part)?;
        let name = argument
            .to_str()
            .filter(|name| !name.contains(['\n', '\r']))
            .ok_or_else(|| {
                failed("the name of the folder has characters that FFmpeg cannot take")
            })?;
        let _ = writeln!(text, "file '{}'", name.replace('\'', "'\\''"));
        if let Some(next) = starts.get(number + 1) {
            let duration = (next - starts[number]).max(0);
            let _ = writeln!(
                text,
                "duration {}.{:06}",
                duration / 1_000_000,
                duration % 1_000_000
            );
        }
    }
    if parts.is_empty() {
        return Err(failed("there are no parts to join"));
    }
    Ok(List { text, codec })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn containers_take_the_tracks_that_players_expect() {
        for (extension, kind, codec, taken) in [
            ("mp4", "audio", "aac", true),
            ("mp4", "audio", "pcm_s16le", false),
            ("mov", "audio", "pcm_s16le", true),
            ("webm", "audio", "aac", false),
            ("webm", "audio", "opus", true),
            ("mkv", "audio", "truehd", true),
            ("mkv", "subtitle", "mov_text", false),
            ("mp4", "subtitle", "mov_text", true),
            ("avi", "subtitle", "subrip", false),
            ("xyz", "audio", "aac", false),
        ] {
            assert_eq!(
                accepts(extension, kind, codec),
                taken,
                "{extension} {codec}"
            );
        }
    }

    #[test]
    fn an_unknown_extension_is_named() {
        let error = assemble(&[], None, Path::new("out.xyz"), "XYZ").unwrap_err();
        assert!(matches!(error, VideoError::UnknownExtension { extension } if extension == "xyz"));
    }
}

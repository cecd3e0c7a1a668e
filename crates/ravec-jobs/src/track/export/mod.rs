//! Tracks in the forms that other programs load.

mod after_effects;
mod blender;
mod nuke;
mod table;

use super::file::TrackFile;
use crate::pixel_centers::PixelCenters;
use glam::DVec2;
use ravec::planar::track::{Track, TrackState, TrackedFrame};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// A form of a track in a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ExportFormat {
    /// All that is known, as `track` reads it again.
    Json,
    /// Eight numbers a frame: the corners.
    Text,
    /// A table with a header: frame, state, corners, sigma.
    Csv,
    /// A corner pin node of Nuke.
    Nuke,
    /// Keyframe data of After Effects, to be pasted on a layer.
    AfterEffects,
    /// A Python script that makes a plane track in Blender.
    Blender,
}

/// Formats with their names and the ends of file names that select them.
const FORMATS: [(ExportFormat, &str, &str); 6] = [
    (ExportFormat::Json, "json", ".json"),
    // before .txt
    (ExportFormat::AfterEffects, "after-effects", ".aekf.txt"),
    (ExportFormat::Text, "txt", ".txt"),
    (ExportFormat::Csv, "csv", ".csv"),
    (ExportFormat::Nuke, "nuke", ".nk"),
    (ExportFormat::Blender, "blender", ".py"),
];

/// Placeholder of the number of a plane, from 1, in the name of an output.
const PLACEHOLDER: &str = "{plane}";

impl ExportFormat {
    /// The format that the end of a file name selects.
    pub fn of(path: &Path) -> Option<Self> {
        let name = path.file_name()?.to_str()?.to_ascii_lowercase();
        let found = FORMATS.iter().find(|(_, _, end)| name.ends_with(end));
        found.map(|(format, ..)| *format)
    }

    /// The format, as a report names it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Json => "track",
            Self::Text => "corners",
            Self::Csv => "CSV",
            Self::Nuke => "Nuke",
            Self::AfterEffects => "After Effects",
            Self::Blender => "Blender script",
        }
    }

    /// The known ends of names, in words.
    pub(super) const ENDS: &str = "a name that ends in .json, .txt, .csv, .nk, .aekf.txt or .py";
}

/// A file with its format: `FILE`, whose end selects it, or `FORMAT=FILE`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Export {
    /// The format, if it is given.
    pub format: Option<ExportFormat>,
    /// The file.
    pub path: PathBuf,
}

impl Export {
    /// The format that is given, or that of the name; JSON for standard output and results in memory.
    pub fn format(&self) -> Option<ExportFormat> {
        let name = self.path.to_string_lossy();
        let nameless = name == "-" || name.starts_with('@');
        self.format
            .or_else(|| nameless.then_some(ExportFormat::Json))
            .or_else(|| ExportFormat::of(&self.path))
    }
}

impl FromStr for Export {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let named = text.split_once('=').and_then(|(name, path)| {
            let found = FORMATS.iter().find(|(_, known, _)| *known == name);
            found.map(|(format, ..)| (*format, path))
        });
        let export = match named {
            Some((format, path)) => Self {
                format: Some(format),
                path: path.into(),
            },
            None => Self {
                format: None,
                path: text.into(),
            },
        };
        if export.path.as_os_str().is_empty() || export.format().is_none() {
            return Err(format!(
                "`{text}` names no format: give {}, or FORMAT=FILE with json, txt, csv, nuke, after-effects or blender",
                ExportFormat::ENDS
            ));
        }
        Ok(export)
    }
}

impl fmt::Display for Export {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let named = |format| FORMATS.iter().find(|(known, ..)| *known == format);
        if let Some((_, name, _)) = self.format.and_then(named) {
            write!(f, "{name}=")?;
        }
        write!(f, "{}", self.path.display())
    }
}

impl TryFrom<String> for Export {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl From<Export> for String {
    fn from(export: Export) -> Self {
        export.to_string()
    }
}

/// True if several planes need a place for their number in this name.
pub(super) fn lacks_place(path: &Path, format: ExportFormat) -> bool {
    format != ExportFormat::Json && !path.to_string_lossy().contains(PLACEHOLDER)
}

/// The name of the file for plane `number`, from 1.
pub(super) fn named(path: &Path, number: usize) -> PathBuf {
    path.to_str().map_or_else(
        || path.to_path_buf(),
        |name| PathBuf::from(name.replace(PLACEHOLDER, &number.to_string())),
    )
}

/// Surroundings of a track that exports state.
pub(super) struct Clip {
    /// Frames a second.
    pub rate: f64,
    /// Number that other programs give to frame 0.
    pub first_number: u64,
    /// Width of a pixel by its height.
    pub pixel_aspect: f64,
    /// Convention of points where the format has none of its own.
    pub centers: PixelCenters,
}

/// The files of all planes in a format: paths and texts.
pub(super) fn texts(
    path: &Path,
    format: ExportFormat,
    file: &TrackFile,
    clip: &Clip,
) -> Vec<(PathBuf, String)> {
    if format == ExportFormat::Json {
        return vec![(path.to_path_buf(), file.to_json())];
    }
    let planes = file.planes.iter().enumerate();
    planes
        .map(|(at, track)| {
            let text = match format {
                ExportFormat::Json => file.to_json(),
                ExportFormat::Text => table::corners(track, clip.centers),
                ExportFormat::Csv => table::csv(track, clip.centers),
                ExportFormat::Nuke => nuke::corner_pin(track, clip, at + 1),
                ExportFormat::AfterEffects => after_effects::corner_pin(track, clip),
                ExportFormat::Blender => blender::script(track, at + 1),
            };
            (named(path, at + 1), text)
        })
        .collect()
}

/// Frames in which the plane is found, with their numbers: poses of lost frames mean nothing, so programs interpolate there.
fn found(track: &Track) -> impl Iterator<Item = (u64, &TrackedFrame)> {
    let numbered = (track.first..).zip(&track.frames);
    numbered.filter(|(_, frame)| frame.state != TrackState::Lost)
}

/// A number with six digits behind the point at most: a millionth of a pixel.
fn short(number: f64) -> f64 {
    let rounded = (number * 1e6).round() / 1e6;
    // no minus before 0
    if rounded == 0.0 { 0.0 } else { rounded }
}

/// A point with y upward from the lower edge of a frame of this height.
fn upward(point: DVec2, height: usize) -> DVec2 {
    DVec2::new(point.x, height as f64 - point.y)
}

#[cfg(test)]
mod tests;

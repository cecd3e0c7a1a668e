//! `stabilize`: a clip in which a plane, or the camera, stands still or moves smoothly.

mod shots;

use crate::context::Context;
use crate::error::JobError;
use crate::files::is_stream;
use crate::operation::{Operation, paths};
use crate::report::Report;
use crate::track::file::TrackFile;
use crate::track::follow::Reader;
use crate::track::rewrite::{Target, rewrite};
use crate::track::summary::{in_words, lost_ranges};
use crate::track::{Precision, read_track};
use crate::video::{Encoding, FrameRange, check_clip_target, key_of, open_clip};
use glam::{DVec2, dvec2};
use ravec::planar::track::{
    PathFrame, SmoothParams, SmoothPath, Track, TrackState, TrackedFrame, smooth_path,
};
use ravec::planar::{Backdrop, Homography, warp_frame};
use ravec::raster::{AnyImage, Size};
use ravec_video::{Clip, FrameSource as _, Rational};
use serde::{Deserialize, Serialize};
use shots::{Found, Shots};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Stabilize a clip: hold a plane or the whole picture still, or smooth its motion
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args), command(after_help = HELP))]
pub struct Stabilize {
    /// Clip: a file, a folder of pictures, a pattern such as frame_%04d.png, or `-` for Y4M on standard input
    pub input: PathBuf,
    /// Output clip of the same size; its extension selects the format, a pattern such as out_%04d.png writes numbered pictures
    #[cfg_attr(feature = "cli", arg(short, long, value_name = "CLIP"))]
    pub output: PathBuf,
    /// Track of a plane in this clip, as ravec track writes it to a .json file; its frames are written [default: the whole
    /// picture is tracked, against the first frame of each shot]
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE"))]
    #[serde(default)]
    pub track: Option<PathBuf>,
    /// Parameters.
    #[cfg_attr(feature = "cli", command(flatten))]
    #[serde(default)]
    pub params: Params,
}

#[cfg(feature = "cli")]
const HELP: &str = "\
Examples:
  ravec stabilize wall.y4m -o still.y4m
  ravec stabilize wall.y4m -o smooth.y4m --mode smooth --strength 1
  ravec stabilize wall.y4m --track track.json -o plane.y4m --border repeat

With --mode plane each frame is laid on the reference frame: the plane of the track stands still, or without a track what most of \
the picture shows. With --mode smooth the motion stays, without what is faster than --strength; each frame is moved a little, and \
the part that all frames cover is enlarged to the whole picture unless --uncropped is given.

Without a track, cuts are found, and each shot is stabilized for itself, against its own first frame; a warning names them. Where \
the plane is lost, the last known pose is kept, and a warning names the frames. Of a track with several planes the first one \
counts (--plane).

Figures: frames, lost, weak, and without a track cuts; with --mode smooth crop_percent (cut off on each side), limited (frames that the limit of the crop \
keeps from their smooth place), jitter_before_px and jitter_after_px (changes of speed from frame to frame).";

/// Parameters of [`Stabilize`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct Params {
    /// Result of the stabilization
    #[cfg_attr(feature = "cli", arg(long, value_enum, default_value_t = Mode::Plane))]
    pub mode: Mode,
    /// For smooth: remove motion faster than this period, in seconds, 0 to 60; more needs a larger crop
    #[cfg_attr(feature = "cli", arg(long, value_name = "SECONDS", default_value_t = Self::default().strength))]
    pub strength: f64,
    /// For smooth: the share of width and height that may be cut off on each side, 0 to 0.4; less keeps more of the shake
    #[cfg_attr(feature = "cli", arg(long, value_name = "SHARE", default_value_t = Self::default().max_crop))]
    pub max_crop: f64,
    /// For smooth: keep the scale, and show the border
    #[cfg_attr(feature = "cli", arg(long))]
    pub uncropped: bool,
    /// Content beyond the border of a frame
    #[cfg_attr(feature = "cli", arg(long, value_enum, default_value_t = Border::Black))]
    pub border: Border,
    /// Number of the plane of a track with several, from 1
    #[cfg_attr(feature = "cli", arg(long, value_name = "NUMBER", requires = "track", default_value_t = Self::default().plane))]
    pub plane: usize,
    /// Without a track: number of pixels that are compared; dense is closest, fast takes the least time
    #[cfg_attr(feature = "cli", arg(long, value_enum, default_value_t = Precision::Normal))]
    pub precision: Precision,
    /// Encoding of the output.
    #[cfg_attr(feature = "cli", command(flatten))]
    pub encoding: Encoding,
}

impl Default for Params {
    fn default() -> Self {
        let smooth = SmoothParams::default();
        Self {
            mode: Mode::Plane,
            strength: smooth.strength_secs,
            max_crop: smooth.max_crop,
            uncropped: false,
            border: Border::Black,
            plane: 1,
            precision: Precision::Normal,
            encoding: Encoding::default(),
        }
    }
}

/// Result of a stabilization.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
pub enum Mode {
    /// The plane stands still, as in the reference frame
    #[default]
    Plane,
    /// The motion of the plane becomes smooth
    Smooth,
}

/// Content beyond the border of a frame.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
pub enum Border {
    /// Black
    #[default]
    Black,
    /// The border pixels go on
    Repeat,
    /// Pixels of the last frame
    Last,
}

/// Frames a second of clips that state none.
const DEFAULT_RATE: f64 = 25.0;

impl Operation for Stabilize {
    const NAME: &'static str = "stabilize";

    fn inputs(&self) -> Vec<&Path> {
        paths(&self.input, [&self.track])
    }

    fn outputs(&self) -> Vec<&Path> {
        vec![&self.output]
    }

    /// Writes the stabilized clip. Without a track the whole picture is followed, in one pass where the plane is to stand still.
    ///
    /// Figures: `frames`, `lost`, `weak`, without a track `cuts`; with `mode` smooth `crop_percent`, `limited`, `jitter_before_px`, `jitter_after_px`.
    /// `timings` has `decode`, `track` and `warp`, which overlap.
    ///
    /// # Errors
    /// [`JobError::Parameter`], [`JobError::ReadClip`], [`JobError::WriteClip`], [`JobError::Track`], [`JobError::TrackLost`],
    /// [`JobError::TrackFile`], what [`check_files`](crate::check_files) refuses, [`JobError::Cancelled`].
    fn run(&self, context: &Context) -> Result<Report, JobError> {
        self.check(context)?;
        let mut report = Report::of(self, &self.params);
        let clip = open_clip(&self.input, None, &mut report, context)?;
        report.check_output(&self.output)?;
        let track = match &self.track {
            Some(path) => {
                let size = clip.info().size;
                let file = read_track(path, &self.input, size, &mut report, context)?;
                Some(self.chosen(file)?)
            }
            None => None,
        };
        match (track, self.params.mode) {
            (Some(track), _) => {
                let states = track.frames.iter().map(|frame| frame.state);
                self.record(states, &lost_ranges(&track), &mut report)?;
                let maps = match self.params.mode {
                    Mode::Plane => held(&track.frames),
                    Mode::Smooth => {
                        let size = Size::new(track.width, track.height);
                        let size = size.map_err(|_| self.empty())?;
                        let rate = clip.info().rate;
                        self.smooth(&track.path_frames(), size, rate, &mut report)?
                    }
                };
                self.by_maps(track.first, &maps, clip, &mut report, context)?;
            }
            (None, Mode::Plane) => self.in_one_pass(clip, &mut report, context)?,
            (None, Mode::Smooth) => {
                let (size, rate) = (clip.info().size, clip.info().rate);
                let shots = self.follow(clip, &mut report, context)?;
                let maps = self.smooth(&shots.path_frames(), size, rate, &mut report)?;
                let clip = self.reopened(context)?;
                self.by_maps(0, &maps, clip, &mut report, context)?;
            }
        }
        Ok(report)
    }
}

/// Time spent on warping.
#[derive(Default)]
struct Warper {
    spent: Duration,
    last: Option<AnyImage>,
}

impl Warper {
    /// The frame seen through the map.
    fn warp(
        &mut self,
        frame: &AnyImage,
        frame_from_output: &Homography,
        border: Border,
        context: &Context,
    ) -> Result<AnyImage, JobError> {
        let start = Instant::now();
        let backdrop = match (border, &self.last) {
            (Border::Repeat, _) => Backdrop::Border,
            (Border::Last, Some(last)) => Backdrop::Picture(last),
            (Border::Black, _) | (Border::Last, None) => Backdrop::Black,
        };
        let progress = context.progress.silent();
        let warped = warp_frame(frame, frame_from_output, backdrop, &progress)?;
        if border == Border::Last {
            self.last = Some(warped.clone());
        }
        self.spent += start.elapsed();
        Ok(warped)
    }

    fn record(&self, report: &mut Report) {
        report.timings.push(crate::Timing {
            phase: "warp",
            duration_secs: self.spent.as_secs_f64(),
        });
    }
}

impl Stabilize {
    fn check(&self, context: &Context) -> Result<(), JobError> {
        let params = &self.params;
        let wrong = |field, value: String, range| {
            Err(JobError::Parameter {
                field,
                value,
                range,
            })
        };
        if !(0.0..=60.0).contains(&params.strength) {
            return wrong("strength", params.strength.to_string(), "0 to 60");
        }
        if !(0.0..=0.4).contains(&params.max_crop) {
            return wrong("max_crop", params.max_crop.to_string(), "0 to 0.4");
        }
        if params.plane == 0 {
            return wrong("plane", "0".to_owned(), "at least 1");
        }
        let two_passes = params.mode == Mode::Smooth && self.track.is_none();
        if is_stream(&self.input) && two_passes {
            let range = "a file, which is read twice for `mode` smooth without `track`";
            return wrong("input", "-".to_owned(), range);
        }
        check_clip_target(&self.output, context)?;
        context.check_files(&self.inputs(), &self.outputs())
    }

    /// The plane that is asked for.
    fn chosen(&self, file: TrackFile) -> Result<Track, JobError> {
        let number = self.params.plane;
        let planes = file.planes.len();
        file.planes
            .into_iter()
            .nth(number - 1)
            .ok_or_else(|| JobError::Parameter {
                field: "plane",
                value: format!("{number}, and the track has {planes}"),
                range: "the number of one of its planes",
            })
    }

    /// The clip once more, which is in the list of inputs already.
    fn reopened(&self, context: &Context) -> Result<Clip, JobError> {
        open_clip(
            &self.input,
            None,
            &mut Report::new("stabilize", &()),
            context,
        )
    }

    /// The motion of the whole picture, shot by shot.
    fn follow(
        &self,
        clip: Clip,
        report: &mut Report,
        context: &Context,
    ) -> Result<Found, JobError> {
        let total = clip.info().frames.unwrap_or(1);
        let mut reader = Reader::new(clip, &self.input, FrameRange::default())?;
        let mut shots = Shots::new(&self.input, self.params.precision, true);
        let phase = context.progress.phase("track", total);
        let mut current = reader.next()?;
        while let Some(shot) = current {
            context.progress.check()?;
            let (next, pose) = rayon::join(|| reader.next(), || shots.push(&shot.image));
            pose?;
            phase.advance(1);
            current = next?;
        }
        self.record_shots(shots, &reader, report)
    }

    /// Records what following the shots has found.
    fn record_shots(
        &self,
        shots: Shots<'_>,
        reader: &Reader<'_>,
        report: &mut Report,
    ) -> Result<Found, JobError> {
        for (phase, duration_secs) in [
            ("decode", reader.spent_secs()),
            ("track", shots.spent.as_secs_f64()),
        ] {
            report.timings.push(crate::Timing {
                phase,
                duration_secs,
            });
        }
        let found = shots.end();
        if found.poses.is_empty() {
            return Err(self.empty());
        }
        let states = found.poses.iter().map(|pose| pose.state);
        self.record(states, &found.lost(), report)?;
        report.figures.insert("cuts", found.cuts() as f64);
        for remark in found.remarks() {
            report.warn(remark);
        }
        Ok(found)
    }

    fn empty(&self) -> JobError {
        JobError::EmptyRange {
            path: self.input.clone(),
            range: FrameRange::default().to_string(),
        }
    }

    /// Tracks and warps in one pass.
    fn in_one_pass(
        &self,
        clip: Clip,
        report: &mut Report,
        context: &Context,
    ) -> Result<(), JobError> {
        let total = clip.info().frames;
        let mut reader = Reader::new(clip, &self.input, FrameRange::default())?;
        let border = self.params.border;
        let mut warper = Warper::default();
        let mut shots = Shots::new(&self.input, self.params.precision, false);
        let key = key_of(self);
        let target = self.target(&key, total);
        let rewritten = rewrite(&target, &mut reader, report, context, |shot, done| {
            let pose = shots.push(&shot.image)?;
            // the next frame may need this one below it
            if done && border != Border::Last {
                return Ok(None);
            }
            let map = &pose.frame_from_reference;
            let warped = warper.warp(&shot.image, map, border, context)?;
            Ok((!done).then_some(warped))
        })?;
        self.record_shots(shots, &reader, report)?;
        warper.record(report);
        reader.warn(report);
        rewritten.finish(report)
    }

    fn target<'a>(&'a self, key: &'a str, frames: Option<u64>) -> Target<'a> {
        Target {
            input: &self.input,
            output: &self.output,
            size: None,
            encoding: &self.params.encoding,
            key,
            pixels: None,
            phase: ("frames", frames),
        }
    }

    /// Writes the frames from `first` on, each seen through its map.
    fn by_maps(
        &self,
        first: u64,
        maps: &[Homography],
        clip: Clip,
        report: &mut Report,
        context: &Context,
    ) -> Result<(), JobError> {
        let params = &self.params;
        let frames = first..first + maps.len() as u64;
        let count = frames.end - frames.start;
        let mut reader = Reader::new(clip, &self.input, FrameRange::between(&frames))?;
        let mut warper = Warper::default();
        let key = key_of(self);
        let target = self.target(&key, Some(count));
        let rewritten = rewrite(&target, &mut reader, report, context, |shot, done| {
            if done && params.border != Border::Last {
                return Ok(None);
            }
            // the range has a map for each of its frames
            let map = &maps[(shot.index - frames.start) as usize];
            let warped = warper.warp(&shot.image, map, params.border, context)?;
            Ok((!done).then_some(warped))
        })?;
        reader.warn(report);
        let written = rewritten.count;
        if written < count {
            report.warn(format!(
                "the clip ends at frame {}, and the track goes on to {}",
                frames.start + written,
                frames.end
            ));
        }
        warper.record(report);
        rewritten.finish(report)
    }

    /// The maps to each frame from an output in which the plane moves smoothly.
    fn smooth(
        &self,
        frames: &[PathFrame],
        size: Size,
        rate: Option<Rational>,
        report: &mut Report,
    ) -> Result<Vec<Homography>, JobError> {
        let params = &self.params;
        let options = SmoothParams {
            strength_secs: params.strength,
            max_crop: params.max_crop,
        };
        let rate = rate.map_or(DEFAULT_RATE, Rational::to_f64);
        // both were checked; rates of clips may be anything
        let wrong = |cause: ravec::planar::track::SmoothError| JobError::Parameter {
            field: "strength",
            value: cause.to_string(),
            range: "possible with the rate of the clip",
        };
        let path = smooth_path(frames, size, rate, &options).map_err(wrong)?;
        let SmoothPath {
            crop,
            limited,
            jitter_before_px,
            jitter_after_px,
            ..
        } = path;
        for (name, figure) in [
            ("crop_percent", 100.0 * crop),
            ("limited", limited as f64),
            ("jitter_before_px", jitter_before_px),
            ("jitter_after_px", jitter_after_px),
        ] {
            report.figures.insert(name, figure);
        }
        let maps = (0..frames.len()).map(|at| {
            let output_from_frame = if params.uncropped {
                path.output_from_frame[at]
            } else {
                path.filling(at)
            };
            output_from_frame.inverse()
        });
        Ok(maps.collect())
    }

    /// Records states of frames, with a warning for those in which the plane is lost.
    fn record(
        &self,
        states: impl Iterator<Item = TrackState>,
        lost: &[[u64; 2]],
        report: &mut Report,
    ) -> Result<(), JobError> {
        let states: Vec<_> = states.collect();
        let count = |state| states.iter().filter(|found| **found == state).count();
        let never = states.len() > 1 && count(TrackState::Lost) + 1 >= states.len();
        if never {
            return Err(JobError::TrackLost {
                path: self.input.clone(),
            });
        }
        if !lost.is_empty() {
            report.record_assumed(format!(
                "the last known pose is kept where the plane is lost: frames {}",
                in_words(lost)
            ));
        }
        for (name, count) in [
            ("frames", states.len()),
            ("weak", count(TrackState::Weak)),
            ("lost", count(TrackState::Lost)),
        ] {
            report.figures.insert(name, count as f64);
        }
        Ok(())
    }
}

/// The corners of a whole frame.
fn whole(size: Size) -> [DVec2; 4] {
    let (width, height) = (size.width() as f64, size.height() as f64);
    [
        DVec2::ZERO,
        dvec2(width, 0.0),
        dvec2(width, height),
        dvec2(0.0, height),
    ]
}

/// The map to each frame from the reference; where the plane is lost, that of the last frame in which it is not.
pub(crate) fn held(frames: &[TrackedFrame]) -> Vec<Homography> {
    let found = |frame: &&TrackedFrame| frame.state != TrackState::Lost;
    let mut last = frames
        .iter()
        .find(found)
        .map_or(Homography::IDENTITY, |frame| frame.frame_from_reference);
    let maps = frames.iter().map(|frame| {
        if found(&frame) {
            last = frame.frame_from_reference;
        }
        last
    });
    maps.collect()
}

#[cfg(test)]
mod tests;

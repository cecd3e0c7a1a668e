//! `track`: planes through a clip, as homographies and corners for each frame.

mod choices;
pub(crate) mod exclusions;
pub mod export;
pub(crate) mod file;
pub(crate) mod follow;
mod photo;
pub(crate) mod rewrite;
mod show;
pub(crate) mod summary;

pub use choices::FrameQuad;
pub use export::{Export, ExportFormat};
pub use ravec::planar::track::Precision;

use crate::context::Context;
use crate::error::{JobError, plain};
use crate::files::{self, is_stream};
use crate::mask::read_mask;
use crate::operation::Operation;
use crate::pixel_centers::PixelCenters;
use crate::plane::Quad;
use crate::report::Report;
use crate::video::{Encoding, FrameRange, check_clip_target, check_no_encoding, open_clip};
use exclusions::{Exclusions, MaskFiles};
use file::TrackFile;
use follow::{Followers, Reader, Shot, Watch, unwatched};
use glam::DVec2;
use photo::Photo;
use ravec::planar::track::{
    Correction, PlaneTracker, Track as PlaneTrack, TrackError, TrackParams, TrackRegion,
    TrackedFrame,
};
use ravec::raster::{Mask, Size};
use ravec_video::{Container, FrameSource as _, Rational};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Track planes through a clip: corners, homographies and their uncertainty for every frame
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args), command(after_help = HELP, group = clap::ArgGroup::new("source").args(["quads", "track"]).required(true).multiple(false)))]
pub struct Track {
    /// Clip: a file, a folder of pictures, a pattern such as frame_%04d.png, or `-` for Y4M on standard input
    pub input: PathBuf,
    /// Output; the end of its name selects the format: .json has all that is known, see below for others; `-` is JSON on
    /// standard output
    #[cfg_attr(feature = "cli", arg(short, long, value_name = "FILE"))]
    #[serde(default)]
    pub output: Option<Export>,
    /// One more output, as FILE or FORMAT=FILE. May be repeated
    #[cfg_attr(feature = "cli", arg(long = "export", value_name = "FILE"))]
    #[serde(default)]
    pub exports: Vec<Export>,
    /// Write the clip with a grid drawn on the plane: green where it is tracked, orange where the pose is weak; a red cross
    /// where it is lost
    #[cfg_attr(feature = "cli", arg(long, value_name = "CLIP"))]
    #[serde(default)]
    pub show: Option<PathBuf>,
    /// Use this track of the clip, a .json file that this command wrote, instead of tracking
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE", conflicts_with_all = ["mask", "exclude", "strokes", "reference", "frames", "cuts"]))]
    #[serde(default)]
    pub track: Option<PathBuf>,
    /// Mask of the plane in the reference frame, of the same size, white on black, instead of the inside of the quadrilateral
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE"))]
    #[serde(default)]
    pub mask: Option<PathBuf>,
    /// Mask of what is never the plane, white on black: a picture for all frames, or a clip of masks
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE"))]
    #[serde(default)]
    pub exclude: Option<PathBuf>,
    /// Pictures of strokes in some frames, each with the number of its frame in its name: white hides the plane in that frame,
    /// black is the plane, gray is unknown. A folder, a pattern, or one picture
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE"))]
    #[serde(default)]
    pub strokes: Option<PathBuf>,
    /// Photo of the plane, of another camera, zoom or light: finds its place, and draws it where the plane is shown
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE"))]
    #[serde(default)]
    pub photo: Option<PathBuf>,
    /// Parameters.
    #[cfg_attr(feature = "cli", command(flatten))]
    #[serde(default)]
    pub params: Params,
}

#[cfg(feature = "cli")]
const HELP: &str = "\
Examples:
  ravec track wall.y4m --quad 40,30,120,24,124,90,36,84 -o track.json --show grid.y4m
  ravec track wall.y4m --quad 40,30,120,24,124,90,36,84 -o corners.txt --export pin.nk
  ravec track wall.y4m --quad 40,30,120,24,124,90,36,84 --reference 6 --frames 2..10 -o part.json
  ravec track wall.y4m --track track.json --correct 8:40,30,120,24,124,90,36,84 -o better.json
  ravec track wall.y4m --track track.json --export after-effects=pin.txt --export plane.py

The corners of a rectangle on the plane are given in the reference frame, in turn from the upper left one clockwise, in pixels, x \
right, y down; the center of the first pixel is (0.5, 0.5), or (0, 0) with --pixel-centers integer. Frames are counted from 0. \
Every frame is compared with the reference frame, so errors do not add up. A frame is tracked, weak (little of the plane is seen, \
or its error may exceed a pixel) or lost (the plane is not found; its pose is the last known one and means nothing).

Formats: .json: everything; .txt: eight numbers a frame, the corners; .csv: frame, state, corners, sigma; .nk: a corner pin of Nuke; \
.aekf.txt or after-effects=FILE: keyframes to paste on a layer in After Effects; .py: a script that makes a plane track in Blender. \
The last three have no keyframes where the plane is lost. With several planes a .json file has them all, and other names \
need {plane} for the number of each.

Figures: planes, frames, tracked, weak, lost, sigma_px_median and sigma_px_max (predicted standard deviation of a corner), first_lost. \
With --photo also photo_inliers and photo_sigma_px; in JSON, result has the place of the photo, as reference_from_photo. The times of \
decoding and tracking overlap.";

/// Parameters of [`Track`].
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct Params {
    /// Corners of a rectangle on the plane in the reference frame. May be repeated: several planes are tracked at once
    #[cfg_attr(
        feature = "cli",
        arg(
            long = "quad",
            value_name = "X,Y,X,Y,X,Y,X,Y",
            allow_hyphen_values = true
        )
    )]
    pub quads: Vec<Quad>,
    /// Number of the reference frame [default: the first one]
    #[cfg_attr(feature = "cli", arg(long, value_name = "FRAME"))]
    pub reference: Option<u64>,
    /// Frames to track, from 0: 100..200 (without frame 200), 100.., ..200, or seconds, as in 1.5s..4s
    #[cfg_attr(feature = "cli", arg(long, value_name = "RANGE"))]
    pub frames: Option<FrameRange>,
    /// Pixels that are tracked, if there is no mask
    #[cfg_attr(feature = "cli", arg(long, value_enum, default_value_t = Region::Quad))]
    pub region: Region,
    /// Number of pixels that are compared: dense is closest, fast takes the least time
    #[cfg_attr(feature = "cli", arg(long, value_enum, default_value_t = Precision::Normal))]
    pub precision: Precision,
    /// Frames with which a new shot begins, as in 40,75: the plane is searched for, not predicted
    #[cfg_attr(
        feature = "cli",
        arg(long, value_name = "FRAMES", value_delimiter = ',')
    )]
    pub cuts: Vec<u64>,
    /// Corners corrected by hand, as FRAME:X,Y,X,Y,X,Y,X,Y; frames around it follow. May be repeated
    #[cfg_attr(
        feature = "cli",
        arg(
            long = "correct",
            value_name = "FRAME:X,Y,...",
            allow_hyphen_values = true
        )
    )]
    pub corrections: Vec<FrameQuad>,
    /// Center of the first pixel in points that are given or printed: half is (0.5, 0.5), integer is (0, 0)
    #[cfg_attr(feature = "cli", arg(long, value_enum, value_name = "CENTERS", default_value_t = PixelCenters::Half))]
    pub pixel_centers: PixelCenters,
    /// Encoding of the clip that shows the plane.
    #[cfg_attr(feature = "cli", command(flatten))]
    pub encoding: Encoding,
}

/// Part of the reference frame that is tracked.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
pub enum Region {
    /// The inside of the quadrilateral
    #[default]
    Quad,
    /// The whole frame, and what comes into view beyond it
    Frame,
}

/// Frames a second of clips that state none.
const DEFAULT_RATE: f64 = 25.0;

impl Operation for Track {
    const NAME: &'static str = "track";

    fn inputs(&self) -> Vec<&Path> {
        let more = [
            &self.track,
            &self.mask,
            &self.exclude,
            &self.strokes,
            &self.photo,
        ];
        crate::operation::paths(&self.input, more)
    }

    fn outputs(&self) -> Vec<&Path> {
        let exports = self.output.iter().chain(&self.exports);
        let exports = exports.map(|export| export.path.as_path());
        exports.chain(self.show.as_deref()).collect()
    }

    /// Tracks planes through a clip, forward and backward from the reference frame, or takes a track that is there, and writes it.
    ///
    /// Figures: `planes`, `frames`, `tracked`, `weak`, `lost`, `sigma_px_median`, `sigma_px_max` (of frames that are not lost),
    /// `first_lost`, summed over planes. The `result` has them for each plane, with `quad`, `reference`, `first` and
    /// `lost_frames`. A warning names the lost frames. `timings` has `decode` and `track`, which overlap.
    ///
    /// # Errors
    /// [`JobError::Parameter`], [`JobError::Missing`], [`JobError::Quad`], [`JobError::Outside`], [`JobError::ReadClip`],
    /// [`JobError::EmptyRange`], [`JobError::SizesDiffer`] for masks, [`JobError::Strokes`], [`JobError::Track`],
    /// [`JobError::TrackLost`], [`JobError::TrackFile`], [`JobError::Correct`], [`JobError::Photo`], [`JobError::Write`], [`JobError::WriteClip`],
    /// what [`check_files`](crate::check_files) refuses, [`JobError::Cancelled`].
    fn run(&self, context: &Context) -> Result<Report, JobError> {
        self.check(context)?;
        let mut report = Report::of(self, &self.params);
        let clip = open_clip(&self.input, None, &mut report, context)?;
        if let Some(output) = &self.show {
            // pictures of folders and patterns are known only now
            report.check_output(output)?;
        }
        let info = clip.info().clone();
        let surroundings = export::Clip {
            rate: info.rate.map_or(DEFAULT_RATE, Rational::to_f64),
            // other programs count frames of files from 1
            first_number: match info.container {
                Container::Pictures => clip.first_number(),
                _ => 1,
            },
            pixel_aspect: info.pixel_aspect.to_f64(),
            centers: self.params.pixel_centers,
        };
        let mut file = match &self.track {
            Some(path) => read_track(path, &self.input, info.size, &mut report, context)?,
            None => self.follow(clip, &unwatched, &mut report, context)?,
        };
        file.centers = self.params.pixel_centers;
        self.correct(&mut file)?;
        summary::record(&file, &self.input, &mut report)?;
        self.check_places(&file)?;
        let photo = match &self.photo {
            Some(path) => Some(Photo::locate(self, path, &file, &mut report, context)?),
            None => None,
        };
        for export in self.output.iter().chain(&self.exports) {
            // checked when it was parsed
            let format = export.format().unwrap_or(ExportFormat::Json);
            for (path, text) in export::texts(&export.path, format, &file, &surroundings) {
                files::write_output_text(&path, format.name(), &text, &mut report, context)?;
            }
        }
        if let Some(output) = &self.show {
            let drawn = (&file, photo.as_ref());
            show::show(self, output, drawn, &mut report, context)?;
        }
        Ok(report)
    }
}

/// An error of a parameter.
fn wrong(field: &'static str, value: &impl ToString, range: &'static str) -> JobError {
    JobError::Parameter {
        field,
        value: value.to_string(),
        range,
    }
}

/// Reads a track of the clip `input`, whose frames have this size.
///
/// # Errors
/// [`JobError::TrackFile`].
pub(crate) fn read_track(
    path: &Path,
    input: &Path,
    size: Size,
    report: &mut Report,
    context: &Context,
) -> Result<TrackFile, JobError> {
    let failed = |reason: String| JobError::TrackFile {
        path: path.to_path_buf(),
        reason,
    };
    let text = files::read_text_in(path, file::MAX_BYTES, context)
        .map_err(|error| failed(plain(&error)))?;
    let file = TrackFile::from_json(&text, context.max_frames).map_err(failed)?;
    if !context.is_intermediate(path) {
        report.protect(path);
    }
    report.inputs.push(crate::FileReport {
        path: path.display().to_string(),
        format: ExportFormat::Json.name().to_owned(),
        ..crate::FileReport::default()
    });
    if file.size() != Some((size.width(), size.height())) {
        let (width, height) = file.size().unwrap_or_default();
        return Err(failed(format!(
            "it is of frames of {width} x {height} pixels, and those of {} have {size}",
            input.display()
        )));
    }
    Ok(file)
}

impl Track {
    /// Refuses what makes no sense, before anything is read.
    fn check(&self, context: &Context) -> Result<(), JobError> {
        let params = &self.params;
        if params.quads.is_empty() == self.track.is_none() {
            return Err(JobError::Missing {
                fields: &["quads", "track"],
                expected: "give one of the two",
            });
        }
        if params.quads.len() > file::MAX_PLANES {
            return Err(wrong("quads", &params.quads.len(), "at most 64 planes"));
        }
        if self.outputs().is_empty() {
            return Err(JobError::Missing {
                fields: &["output", "exports", "show"],
                expected: "give at least one output",
            });
        }
        if self.mask.is_some() && (params.region == Region::Frame || params.quads.len() > 1) {
            let range = "left out with several planes, or `region` frame";
            return Err(wrong("mask", &"given", range));
        }
        if self.track.is_some() {
            let given = [
                ("mask", self.mask.is_some()),
                ("exclude", self.exclude.is_some()),
                ("strokes", self.strokes.is_some()),
                ("reference", params.reference.is_some()),
                ("frames", params.frames.is_some()),
                ("cuts", !params.cuts.is_empty()),
            ];
            if let Some((field, _)) = given.into_iter().find(|(_, given)| *given) {
                return Err(wrong(field, &"given", "left out with `track`"));
            }
        }
        if is_stream(&self.input) && (self.show.is_some() || self.photo.is_some()) {
            return Err(wrong(
                "input",
                &"-",
                "a file, which `show` and `photo` read again",
            ));
        }
        if self.photo.is_some() && params.quads.len() > 1 {
            return Err(wrong("photo", &"given", "left out for several planes"));
        }
        match &self.show {
            Some(output) => check_clip_target(output, context)?,
            None => check_no_encoding(&params.encoding)?,
        }
        if params.quads.len() > 1 {
            self.check_names()?;
        }
        let mut inputs = self.inputs();
        inputs.retain(|path| !context.is_intermediate(path));
        context.check_files(&inputs, &self.outputs())
    }

    /// Refuses names of text files that several planes would share.
    fn check_names(&self) -> Result<(), JobError> {
        for export in self.output.iter().chain(&self.exports) {
            let format = export.format().unwrap_or(ExportFormat::Json);
            if export::lacks_place(&export.path, format) {
                let range = "a name with {plane} in it, where there are several planes";
                return Err(wrong("output", &export.path.display(), range));
            }
        }
        Ok(())
    }

    /// The same for a track that was read.
    fn check_places(&self, file: &TrackFile) -> Result<(), JobError> {
        if file.planes.len() > 1 {
            self.check_names()?;
        }
        Ok(())
    }

    /// Tracks the planes as [`run`](Operation::run) does, without corrections by hand, and writes nothing. `watch` gets the number
    /// of each frame and the planes in it as soon as they are tracked: the reference frame, then those behind it, then those before
    /// it backward. The result may differ from what `watch` got by a last refinement over all frames.
    ///
    /// # Errors
    /// [`JobError::Missing`] without a quadrilateral, and those of `run` for input, masks and tracking.
    pub fn measure(
        &self,
        watch: &(dyn Fn(u64, &[TrackedFrame]) + Sync),
        context: &Context,
    ) -> Result<Vec<PlaneTrack>, JobError> {
        if self.params.quads.is_empty() {
            return Err(JobError::Missing {
                fields: &["quads"],
                expected: "give the corners of a plane",
            });
        }
        let mut report = Report::of(self, &self.params);
        let clip = open_clip(&self.input, None, &mut report, context)?;
        Ok(self.follow(clip, watch, &mut report, context)?.planes)
    }

    /// A measured track of the only plane with the corrections by hand.
    ///
    /// # Errors
    /// [`JobError::Correct`].
    pub fn corrected(&self, measured: &PlaneTrack) -> Result<PlaneTrack, JobError> {
        let centers = self.params.pixel_centers;
        let corrections = self.params.corrections.iter().map(|given| Correction {
            frame: given.frame,
            corners: centers.read_all(given.quad.0),
        });
        let corrections: Vec<_> = corrections.collect();
        if corrections.is_empty() {
            return Ok(measured.clone());
        }
        let corrected = measured.corrected(&corrections);
        corrected.map_err(|cause| JobError::Correct { cause })
    }

    /// The text of the file that [`run`](Operation::run) writes for what was [measured](Self::measure): JSON, with the corrections by
    /// hand.
    ///
    /// # Errors
    /// [`JobError::Correct`], [`JobError::Parameter`] for corrections of several planes.
    pub fn text(&self, planes: Vec<PlaneTrack>) -> Result<String, JobError> {
        let mut file = TrackFile {
            planes,
            centers: self.params.pixel_centers,
        };
        self.correct(&mut file)?;
        Ok(file.to_json())
    }

    /// Tracks the planes.
    fn follow(
        &self,
        clip: ravec_video::Clip,
        watch: Watch<'_>,
        report: &mut Report,
        context: &Context,
    ) -> Result<TrackFile, JobError> {
        let params = &self.params;
        let size = clip.info().size;
        let quads = params.quads.iter();
        let quads = quads.map(|quad| quad.check(params.pixel_centers, size));
        let quads = quads.collect::<Result<Vec<_>, _>>()?;
        let range = params.frames.unwrap_or_default();
        let total = range.frames(clip.info());
        let mut reader = Reader::new(clip, &self.input, range)?;
        let reference = params.reference.unwrap_or(reader.first());
        let files = MaskFiles {
            input: &self.input,
            exclude: self.exclude.as_deref(),
            strokes: self.strokes.as_deref(),
        };
        let exclusions = Exclusions::open(&files, size, reference, report, context)?;
        reader.exclude(exclusions);
        let beyond = || {
            wrong(
                "reference",
                &reference,
                "a frame of the clip, within `frames`",
            )
        };
        if reference < reader.first() {
            return Err(beyond());
        }
        reader.seek(reference)?;
        let shot = reader.next()?.ok_or_else(beyond)?;
        let phase = context.progress.phase("track", total.unwrap_or(1));
        let regions = self.regions(&quads, &shot, &reader, report, context)?;
        let options = TrackParams {
            precision: params.precision,
        };
        let start = std::time::Instant::now();
        let trackers = quads.iter().zip(&regions).map(|(&quad, region)| {
            PlaneTracker::new(&shot.image, quad, region, shot.exclude.as_ref(), &options)
        });
        let trackers = trackers.collect::<Result<Vec<_>, TrackError>>();
        let mut followers = Followers {
            trackers: trackers.map_err(|cause| JobError::Track {
                path: self.input.clone(),
                cause,
            })?,
            cuts: params.cuts.clone(),
            spent: start.elapsed(),
            watch,
        };
        let itself = followers.trackers.iter();
        let itself: Vec<_> = itself.map(PlaneTracker::reference_frame).collect();
        watch(reference, &itself);
        phase.advance(1);
        let found = followers.follow(&mut reader, reference, &phase, context)?;
        let planes = followers.tracks(found, reference, size);
        reader.warn(report);
        followers.record_times(&reader, report);
        Ok(TrackFile {
            centers: params.pixel_centers,
            planes,
        })
    }

    /// The region of each plane: with the strokes of the reference frame that mark the plane.
    fn regions(
        &self,
        quads: &[[DVec2; 4]],
        reference: &Shot,
        reader: &Reader<'_>,
        report: &mut Report,
        context: &Context,
    ) -> Result<Vec<TrackRegion>, JobError> {
        let size = reference.image.size();
        let mask = match &self.mask {
            Some(path) => Some(read_mask(path, &self.input, size, report, context)?),
            None => None,
        };
        if mask.is_none() && self.params.region == Region::Frame {
            return Ok(vec![TrackRegion::Frame; quads.len()]);
        }
        let strokes = match reader.exclusions() {
            Some(exclusions) => exclusions.strokes(reference.index)?,
            None => None,
        };
        // which of several planes is marked is not known
        let marked = strokes
            .map(|[_, plane]| plane)
            .filter(|plane| quads.len() == 1 && !plane.is_empty());
        let regions = quads.iter().map(|quad| {
            let Some(plane) = &marked else {
                return mask.clone().map_or(TrackRegion::Quad, TrackRegion::Mask);
            };
            let inside = match &mask {
                Some(mask) => mask.clone(),
                None => Mask::from_polygon(size, quad).unwrap_or_else(|_| Mask::empty(size)),
            };
            inside
                .union(plane)
                .map_or(TrackRegion::Quad, TrackRegion::Mask)
        });
        Ok(regions.collect())
    }

    /// Applies the corrections by hand.
    fn correct(&self, file: &mut TrackFile) -> Result<(), JobError> {
        let params = &self.params;
        if params.corrections.is_empty() {
            return Ok(());
        }
        let [plane] = &mut file.planes[..] else {
            return Err(wrong(
                "corrections",
                &"given",
                "left out for several planes",
            ));
        };
        *plane = self.corrected(plane)?;
        Ok(())
    }
}

#[cfg(test)]
pub(crate) mod tests;

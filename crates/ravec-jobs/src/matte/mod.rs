//! `matte`: alpha and foreground of a picture or a clip, with a known background or marked pixels.

mod frames;
mod live;

pub use frames::{FrameMattes, Spread};
pub use live::LiveMatte;

use crate::context::Context;
use crate::error::JobError;
use crate::files;
use crate::frame_mark::FrameMark;
use crate::operation::{Operation, paths};
use crate::pixel_centers::PixelCenters;
use crate::report::Report;
use crate::shot::{check_pad, check_plane, check_regions, is_deep};
use crate::track::follow::{Reader, Shot};
use crate::track::rewrite::{Target, rewrite_each};
use crate::video::{
    Encoding, FrameRange, clip_folders, clip_outputs, folder_or_clip, is_clip, key_of, open_clip,
};
use ravec::matting::{Matte as Solution, PlateParams};
use ravec::raster::{AnyImage, Image, Plane, Sample, Srgb, Srgba};
use ravec_media::{Picture, WriteOptions};
use ravec_video::{FrameSource as _, PixelKind};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Separate the foreground of a picture or clip from its background: alpha, or colors without the background
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args), command(after_help = HELP))]
pub struct Matte {
    /// Picture, or clip: a file, a folder of pictures, a pattern such as frame_%04d.png
    pub input: PathBuf,
    /// Output: a picture for a picture; for a clip a file, a folder that is there, or a pattern such as alpha_%04d.png
    #[cfg_attr(feature = "cli", arg(short, long, value_name = "FILE"))]
    pub output: PathBuf,
    /// Picture of the background without foreground; transparent pixels are not known. A clip needs it, a picture can do with
    /// --trimap or --strokes
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE"))]
    #[serde(default)]
    pub plate: Option<PathBuf>,
    /// Picture of what is known of a picture: white is foreground, black is background, gray and transparent are to be found
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE"))]
    #[serde(default)]
    pub trimap: Option<PathBuf>,
    /// Track of the background in the clip, as ravec track writes it to a .json file [default: the camera stands still]
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE"))]
    #[serde(default)]
    pub track: Option<PathBuf>,
    /// Map of the planes of a plate, as ravec plate --regions writes it: gray values are numbers of planes of the track
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE", requires = "track"))]
    #[serde(default)]
    pub regions: Option<PathBuf>,
    /// Strokes: a picture for one frame, or a folder of pictures with the number of a frame in their names; white is foreground,
    /// black is background, gray and transparent say nothing
    #[cfg_attr(feature = "cli", arg(long, value_name = "PATH"))]
    #[serde(default)]
    pub strokes: Option<PathBuf>,
    /// Parameters.
    #[cfg_attr(feature = "cli", command(flatten))]
    #[serde(default)]
    pub params: Params,
}

#[cfg(feature = "cli")]
const HELP: &str = "\
Examples:
  ravec matte shot_06.bmp --trimap trimap.png --content foreground -o cut.png
  ravec matte shot_06.bmp --plate empty.png -o alpha.png
  ravec matte clip.y4m --plate empty.png -o alpha.y4m
  ravec matte clip.y4m --plate empty.png --content foreground -o cut_%04d.png
  ravec matte clip.y4m --plate empty.png --mark 3:foreground:4:30,20,38,22 -o alpha.y4m

Light, noise and small shifts of the background are followed frame by frame; a plate from another light is fine. With --track the \
plate belongs to the reference frame of the track, and may be larger by --pad pixels on each side.

Without a plate, the pixels that a trimap or strokes leave open are found from the colors of the marked ones nearby: the closer the \
marks to the border, the better.

Foreground that has the colors of the background cannot be seen where neither has texture: strokes set it. Marks of a few frames \
are carried through the clip: background along the track, foreground with what lies under it; in other frames than their own they \
hold only where the colors are theirs. Shadows are a part of the foreground, unless --shadows keeps, softens or drops them.

Figures: frames, foreground_percent (mean of alpha), empty (frames without foreground); after --resume the last two are about the \
frames of this run.";

/// Parameters of [`Matte`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct Params {
    /// Content of the output
    #[cfg_attr(feature = "cli", arg(long, value_enum, default_value_t = Content::Alpha))]
    pub content: Content,
    /// Pixels by which the plate is larger than a frame on each side
    #[cfg_attr(feature = "cli", arg(long, value_name = "PIXELS", default_value_t = 0))]
    pub pad: usize,
    /// Number of the plane of a track with several, from 1
    #[cfg_attr(
        feature = "cli",
        arg(long, value_name = "NUMBER", requires = "track", default_value_t = 1)
    )]
    pub plane: usize,
    /// Stroke in a frame, as 40:foreground:6:X,Y,X,Y,... with its radius in pixels, or background. May be repeated
    #[cfg_attr(
        feature = "cli",
        arg(
            long = "mark",
            value_name = "FRAME:SIDE:RADIUS:X,Y,...",
            allow_hyphen_values = true
        )
    )]
    pub marks: Vec<FrameMark>,
    /// Frames before and after its own in which a stroke holds [default: all for --mark, none for pictures of strokes]
    #[cfg_attr(feature = "cli", arg(long, value_name = "FRAMES"))]
    pub carry: Option<u64>,
    /// Convention of the points of strokes, and of a track of another program, which does not state its own
    #[cfg_attr(feature = "cli", arg(long, value_enum, default_value_t = PixelCenters::Half))]
    pub pixel_centers: PixelCenters,
    /// Parameters of the matte.
    #[cfg_attr(feature = "cli", command(flatten))]
    pub matte: PlateParams,
    /// Encoding of an output clip.
    #[cfg_attr(feature = "cli", command(flatten))]
    pub encoding: Encoding,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            content: Content::Alpha,
            pad: 0,
            plane: 1,
            marks: Vec::new(),
            carry: None,
            pixel_centers: PixelCenters::Half,
            matte: PlateParams::default(),
            encoding: Encoding::default(),
        }
    }
}

/// Content of a matte's output.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
pub enum Content {
    /// Alpha as gray values: white is foreground
    #[default]
    Alpha,
    /// Colors of the foreground without those of the background, with alpha
    Foreground,
}

/// Sums over the frames.
#[derive(Default)]
struct Figures {
    frames: u64,
    empty: u64,
    alpha: f64,
}

impl Figures {
    /// Adds a frame of this mean alpha.
    fn add(&mut self, alpha: f64) {
        self.frames += 1;
        self.empty += u64::from(alpha == 0.0);
        self.alpha += alpha;
    }

    fn record(&self, report: &mut Report) {
        let mean = self.alpha / self.frames.max(1) as f64;
        for (name, figure) in [
            ("frames", self.frames as f64),
            ("empty", self.empty as f64),
            ("foreground_percent", 100.0 * mean),
        ] {
            report.figures.insert(name, figure);
        }
    }
}

impl Operation for Matte {
    const NAME: &'static str = "matte";

    fn inputs(&self) -> Vec<&Path> {
        let optional = [
            &self.plate,
            &self.trimap,
            &self.track,
            &self.strokes,
            &self.regions,
        ];
        paths(&self.input, optional)
    }

    fn outputs(&self) -> Vec<&Path> {
        clip_outputs(&self.output)
    }

    fn folders(&self) -> Vec<&Path> {
        clip_folders(&self.output)
    }

    /// Writes alpha or the foreground of a picture or of all frames of a clip.
    ///
    /// Figures: `frames`, `empty`, `foreground_percent`.
    ///
    /// # Errors
    /// [`JobError::Parameter`], [`JobError::Read`], [`JobError::ReadClip`], [`JobError::WriteClip`], [`JobError::SizesDiffer`],
    /// [`JobError::Strokes`], [`JobError::TrackFile`], what [`check_files`](crate::check_files) refuses,
    /// [`JobError::Cancelled`].
    fn run(&self, context: &Context) -> Result<Report, JobError> {
        let params = &self.params;
        check_plane(params.plane)?;
        check_pad(params.pad)?;
        check_regions(self.regions.as_deref(), self.track.as_deref())?;
        if !(0.0..=0.25).contains(&params.matte.snap) {
            return Err(JobError::Parameter {
                field: "snap",
                value: params.matte.snap.to_string(),
                range: "0 to 0.25",
            });
        }
        let clip = is_clip(&self.input, context);
        let given = |file: &Option<PathBuf>| file.is_some();
        let marked = given(&self.trimap) || given(&self.strokes) || !params.marks.is_empty();
        let plate = given(&self.plate);
        let wrong = if clip && !plate {
            Some(("plate", "left out", "given for a clip"))
        } else if clip && given(&self.trimap) {
            Some(("trimap", "given", "left out for a clip"))
        } else if !clip && given(&self.track) {
            Some(("track", "given", "left out for a picture"))
        } else if !plate && !marked {
            Some(("plate", "left out", "given, or a trimap or strokes instead"))
        } else {
            None
        };
        if let Some((field, value, range)) = wrong {
            return Err(JobError::Parameter {
                field,
                value: value.to_owned(),
                range,
            });
        }
        let mut report = Report::of(self, params);
        if clip {
            self.clip(&mut report, context)?;
        } else {
            context.check_files(&self.inputs(), &[&self.output])?;
            self.still(&mut report, context)?;
        }
        Ok(report)
    }
}

impl Matte {
    fn still(&self, report: &mut Report, context: &Context) -> Result<(), JobError> {
        let picture = files::read(&self.input, report, context)?;
        let mattes = FrameMattes::open(
            self,
            picture.image.size(),
            Spread::OwnFrames,
            report,
            context,
        )?;
        let found = mattes.solve(0, &picture.image, &context.progress, context)?;
        let mut figures = Figures::default();
        figures.add(mean(&found.alpha));
        figures.record(report);
        let made = Picture::from_image(self.drawn(&found, &picture.image));
        files::write(
            &self.output,
            &made,
            &WriteOptions::default(),
            report,
            context,
        )
    }

    fn clip(&self, report: &mut Report, context: &Context) -> Result<(), JobError> {
        let output = folder_or_clip(&self.output, &self.inputs(), context)?;
        context.check_files(&self.inputs(), &[&output])?;
        let clip = open_clip(&self.input, None, report, context)?;
        report.check_output(&output)?;
        let total = clip.info().frames;
        let source = clip.info().pixels;
        let mattes = FrameMattes::open(self, clip.info().size, Spread::Clip, report, context)?;
        let mut reader = Reader::new(clip, &self.input, FrameRange::default())?;
        let key = key_of(self);
        let target = Target {
            input: &self.input,
            output: &output,
            size: None,
            encoding: &self.params.encoding,
            key: &key,
            pixels: (self.params.content == Content::Foreground).then(|| with_alpha(source)),
            phase: ("matte", total),
        };
        let mut figures = Figures::default();
        let solve = |shot: &Shot, (): ()| {
            let progress = context.progress.silent();
            let found = mattes.solve(shot.index, &shot.image, &progress, context)?;
            Ok((self.drawn(&found, &shot.image), mean(&found.alpha)))
        };
        let record = |alpha| figures.add(alpha);
        let rewritten = rewrite_each(
            &target,
            &mut reader,
            report,
            context,
            |_| Ok(()),
            solve,
            record,
        )?;
        reader.warn(report);
        figures.record(report);
        // those of an earlier run, too
        report.figures.insert("frames", rewritten.count as f64);
        rewritten.finish(report)
    }

    /// The content that is asked for, with as many bits as the frame has.
    fn drawn(&self, matte: &Solution, frame: &AnyImage) -> AnyImage {
        let deep = is_deep(frame);
        match self.params.content {
            Content::Alpha if deep => AnyImage::Srgb16(gray(&matte.alpha)),
            Content::Alpha => AnyImage::Srgb8(gray(&matte.alpha)),
            Content::Foreground => {
                let cut: Image<Srgba<f32>> = Image::from_fn(matte.alpha.size(), |col, row| {
                    let [r, g, b] = matte.foreground[(col, row)];
                    Srgba([r, g, b, matte.alpha[(col, row)]])
                });
                if deep {
                    AnyImage::Srgba16(cut.with_samples())
                } else {
                    AnyImage::Srgba8(cut.with_samples())
                }
            }
        }
    }
}

/// The mean of a plane.
fn mean(alpha: &Plane) -> f64 {
    let alpha = alpha.pixels();
    let sum: f64 = alpha.iter().map(|alpha| f64::from(*alpha)).sum();
    sum / alpha.len() as f64
}

/// Alpha as gray values.
fn gray<T: Sample>(alpha: &Plane) -> Image<Srgb<T>> {
    alpha.map(|alpha| Srgb([T::from_unit(alpha); 3]))
}

/// Pixels with alpha, of as many bits as those of the source.
fn with_alpha(source: PixelKind) -> PixelKind {
    let depth = match source {
        PixelKind::Rgb { depth: 16.., .. } => 16,
        PixelKind::Rgb { .. } | PixelKind::Yuv { .. } => 8,
    };
    PixelKind::Rgb { depth, alpha: true }
}

#[cfg(test)]
mod tests;

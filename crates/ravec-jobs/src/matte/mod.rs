//! `matte`: alpha and foreground of a picture or a clip, with a known background or marked pixels.

use crate::context::Context;
use crate::error::JobError;
use crate::files;
use crate::operation::{Operation, paths};
use crate::pixel_centers::PixelCenters;
use crate::report::Report;
use crate::shot::{ShotPlate, ShotTrack, TrackChoice, check_pad, check_plane, encoded, is_deep};
use crate::track::exclusions::{Exclusions, MaskFiles};
use crate::track::follow::Reader;
use crate::track::rewrite::{Target, rewrite};
use crate::video::{
    Encoding, FrameRange, clip_folders, clip_outputs, folder_or_clip, is_clip, key_of, open_clip,
};
use ravec::matting::{
    Constraints, Matte as Solution, MattingError, PlateFrame, PlateParams, plate_matte, still_matte,
};
use ravec::planar::Homography;
use ravec::progress::Progress;
use ravec::raster::{AnyImage, Image, Mask, Plane, Size, Srgb, Srgba};
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

Light, noise and small shifts of the background are followed frame by frame; a plate from another light is fine. With --track the \
plate belongs to the reference frame of the track, and may be larger by --pad pixels on each side.

Without a plate, the pixels that a trimap or strokes leave open are found from the colors of the marked ones nearby: the closer the \
marks to the border, the better.

Foreground that has the colors of the background cannot be seen where neither has texture: strokes set it. Shadows are a part of \
the foreground.

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
    /// Convention of a track of another program, which does not state its own
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

/// Gray value of a pixel about which nothing is known.
const UNKNOWN: u8 = 128;

/// Inputs of the matte of a picture or a frame.
struct Frame<'a> {
    image: &'a AnyImage,
    plate: Option<&'a ShotPlate>,
    from_reference: &'a Homography,
    constraints: Option<&'a Constraints>,
}

/// Sums over the frames.
#[derive(Default)]
struct Figures {
    frames: u64,
    empty: u64,
    alpha: f64,
}

impl Figures {
    fn add(&mut self, alpha: &Plane) {
        let alpha = alpha.pixels();
        let sum: f64 = alpha.iter().map(|alpha| f64::from(*alpha)).sum();
        self.frames += 1;
        self.empty += u64::from(sum == 0.0);
        self.alpha += sum / alpha.len() as f64;
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
        let optional = [&self.plate, &self.trimap, &self.track, &self.strokes];
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
        if !(0.0..=0.25).contains(&params.matte.snap) {
            return Err(JobError::Parameter {
                field: "snap",
                value: params.matte.snap.to_string(),
                range: "0 to 0.25",
            });
        }
        let clip = is_clip(&self.input, context);
        let given = |file: &Option<PathBuf>| file.is_some();
        let marked = given(&self.trimap) || given(&self.strokes);
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
        let size = picture.image.size();
        let plate = self.plate(size, report, context)?;
        let trimap = self.trimap(size, report, context)?;
        let strokes = self.strokes(size, report, context)?;
        let marks = constraints(strokes.strokes(0)?, trimap, size);
        let frame = Frame {
            image: &picture.image,
            plate: plate.as_ref(),
            from_reference: &Homography::IDENTITY,
            constraints: marks.as_ref(),
        };
        let mut figures = Figures::default();
        let made = self.solve(&frame, &mut figures, &context.progress, context)?;
        figures.record(report);
        let made = Picture::from_image(made);
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
        let size = clip.info().size;
        let total = clip.info().frames;
        let source = clip.info().pixels;
        let plate = self.plate(size, report, context)?;
        let track = match &self.track {
            Some(path) => {
                let choice = TrackChoice {
                    path,
                    plane: self.params.plane,
                    centers: self.params.pixel_centers,
                };
                Some(ShotTrack::read(&choice, report, context)?)
            }
            None => None,
        };
        let mut strokes = self.strokes(size, report, context)?;
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
        let rewritten = rewrite(&target, &mut reader, report, context, |shot, done| {
            if done {
                return Ok(None);
            }
            let known = track.as_ref().map(|track| track.map(shot.index));
            let map = match known {
                None => Some(&Homography::IDENTITY),
                Some(map) => map,
            };
            let Some(map) = map else {
                return Err(JobError::TrackFile {
                    path: self.track.clone().unwrap_or_default(),
                    reason: format!("it lacks frame {}", shot.index),
                });
            };
            // borrowed for this thread alone: a clip of masks cannot be shared
            let strokes = &mut strokes;
            let marks = constraints(strokes.strokes(shot.index)?, None, size);
            let frame = Frame {
                image: &shot.image,
                plate: plate.as_ref(),
                from_reference: map,
                constraints: marks.as_ref(),
            };
            let progress = context.progress.silent();
            let made = self.solve(&frame, &mut figures, &progress, context)?;
            Ok(Some(made))
        })?;
        reader.warn(report);
        figures.record(report);
        // those of an earlier run, too
        report.figures.insert("frames", rewritten.count as f64);
        rewritten.finish(report)
    }

    /// Reads the plate of frames of this size.
    fn plate(
        &self,
        size: Size,
        report: &mut Report,
        context: &Context,
    ) -> Result<Option<ShotPlate>, JobError> {
        let Some(path) = &self.plate else {
            return Ok(None);
        };
        let picture = files::read(path, report, context)?;
        let plate = ShotPlate::new(&picture.image, self.params.pad);
        if plate.frame_size() != Some(size) {
            return Err(JobError::SizesDiffer {
                a: self.input.clone(),
                a_size: size,
                b: path.clone(),
                b_size: picture.image.size(),
            });
        }
        Ok(Some(plate))
    }

    fn strokes(
        &self,
        size: Size,
        report: &mut Report,
        context: &Context,
    ) -> Result<Exclusions, JobError> {
        let files = MaskFiles {
            input: &self.input,
            exclude: None,
            strokes: self.strokes.as_deref(),
        };
        Exclusions::open(&files, size, 0, report, context)
    }

    /// Reads the trimap of a picture of this size.
    fn trimap(
        &self,
        size: Size,
        report: &mut Report,
        context: &Context,
    ) -> Result<Option<Constraints>, JobError> {
        let Some(path) = &self.trimap else {
            return Ok(None);
        };
        let picture = files::read(path, report, context)?;
        if picture.image.size() != size {
            return Err(JobError::SizesDiffer {
                a: self.input.clone(),
                a_size: size,
                b: path.clone(),
                b_size: picture.image.size(),
            });
        }
        let image: Image<Srgba<u8>> = picture.convert();
        Ok(Some(image.map(|Srgba([r, g, b, alpha])| {
            let gray = (u32::from(r) + u32::from(g) + u32::from(b)) / 3;
            if alpha < 128 { UNKNOWN } else { gray as u8 }
        })))
    }

    /// The output of a frame.
    fn solve(
        &self,
        frame: &Frame<'_>,
        figures: &mut Figures,
        progress: &Progress,
        context: &Context,
    ) -> Result<AnyImage, JobError> {
        let colors = encoded(frame.image);
        let found = match (frame.plate, frame.constraints) {
            (Some(plate), constraints) => {
                let plate = plate.in_frame(frame.from_reference, colors.size(), context)?;
                let input = PlateFrame {
                    known: Some(&plate.known),
                    strokes: constraints,
                    ..PlateFrame::new(&colors, &plate.colors)
                };
                plate_matte(&input, &self.params.matte, progress)?.matte
            }
            (None, Some(constraints)) => still_matte(&colors, constraints, progress)?.matte,
            (None, None) => return Err(MattingError::Unmarked("foreground").into()),
        };
        figures.add(&found.alpha);
        Ok(self.drawn(&found, frame.image))
    }

    /// The content that is asked for, with as many bits as the frame has.
    fn drawn(&self, matte: &Solution, frame: &AnyImage) -> AnyImage {
        let deep = is_deep(frame);
        match self.params.content {
            Content::Alpha if deep => {
                let gray = matte.alpha.map(|alpha| Srgb([alpha; 3]));
                AnyImage::Srgb16(gray.convert())
            }
            Content::Alpha => {
                let gray = matte.alpha.map(|alpha| Srgb([alpha; 3]));
                AnyImage::Srgb8(gray.convert())
            }
            Content::Foreground => {
                let cut: Image<Srgba<f32>> = Image::from_fn(matte.alpha.size(), |col, row| {
                    let [r, g, b] = matte.foreground[(col, row)];
                    Srgba([r, g, b, matte.alpha[(col, row)]])
                });
                if deep {
                    AnyImage::Srgba16(cut.convert())
                } else {
                    AnyImage::Srgba8(cut.convert())
                }
            }
        }
    }
}

/// Constraints of strokes, `[foreground, background]`, and below them those of a trimap.
fn constraints(
    strokes: Option<[Mask; 2]>,
    trimap: Option<Constraints>,
    size: Size,
) -> Option<Constraints> {
    let Some([foreground, background]) = strokes else {
        return trimap;
    };
    Some(Constraints::from_fn(size, |col, row| {
        if foreground.at(col, row) > 0.0 {
            u8::MAX
        } else if background.at(col, row) > 0.0 {
            0
        } else {
            trimap.as_ref().map_or(UNKNOWN, |trimap| trimap[(col, row)])
        }
    }))
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

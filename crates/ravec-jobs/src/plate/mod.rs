//! `plate`: a picture of the background of a shot, without what moves before it.

use crate::context::Context;
use crate::error::JobError;
use crate::files;
use crate::frame_mark::FrameMark;
use crate::marks::{MarkSource, Marks};
use crate::operation::{Operation, paths};
use crate::pixel_centers::PixelCenters;
use crate::plane::Quad;
use crate::report::Report;
use crate::shot::{
    ShotTrack, TrackChoice, check_pad, check_plane, check_regions, encoded, is_deep,
};
use crate::track::exclusions::{Exclusions, MaskFiles};
use crate::track::follow::{Reader, Shot};
use crate::video::{FrameRange, open_clip};
use glam::DVec2;
use ravec::completion::{CompleteError, CompleteParams, complete};
use ravec::matting::Constraint;
use ravec::planar::Homography;
use ravec::raster::{AnyImage, Image, Mask, Plane, Srgb, Srgba};
use ravec::video_edit::{
    Plate as BackgroundPlate, PlateModes, PlateSamples, ShotFrame, joined_plate, plate_regions,
};
use ravec_media::{Format, Picture, WriteOptions};
use ravec_video::FrameSource as _;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Make a picture of the background of a clip, without what moves before it
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args), command(after_help = HELP))]
pub struct Plate {
    /// Clip: a file, a folder of pictures, a pattern such as frame_%04d.png
    pub input: PathBuf,
    /// Output picture
    #[cfg_attr(feature = "cli", arg(short, long, value_name = "FILE"))]
    pub output: PathBuf,
    /// Track of the background in the clip, as ravec track writes it to a .json file [default: the camera stands still]
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE"))]
    #[serde(default)]
    pub track: Option<PathBuf>,
    /// Mask of what is never the background, white on black: a picture for all frames, or a clip of masks
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE"))]
    #[serde(default)]
    pub exclude: Option<PathBuf>,
    /// Strokes: a picture for one frame, or a folder of pictures with the number of a frame in their names; white is foreground,
    /// black is background, gray and transparent say nothing
    #[cfg_attr(feature = "cli", arg(long, value_name = "PATH"))]
    #[serde(default)]
    pub strokes: Option<PathBuf>,
    /// Write a map of what was seen: white was seen in some frame, black is invented
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE"))]
    #[serde(default)]
    pub seen: Option<PathBuf>,
    /// Write a map of certainty: white where all frames agree
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE"))]
    #[serde(default)]
    pub certainty: Option<PathBuf>,
    /// Put all planes of the track on the plate, and write a map of them: gray values are numbers of planes, from 1
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE", requires = "track"))]
    #[serde(default)]
    pub regions: Option<PathBuf>,
    /// Parameters.
    #[cfg_attr(feature = "cli", command(flatten))]
    #[serde(default)]
    pub params: Params,
}

#[cfg(feature = "cli")]
const HELP: &str = "\
Examples:
  ravec plate clip.y4m -o background.png
  ravec plate clip.y4m --strokes strokes.png --seen seen.png -o background.png

Each pixel gets the color that most frames show there; what moves is left out even if several things pass. The exposure of the clip \
is followed, and the plate has that of the reference frame of the track. What no frame shows is completed from the rest, along the \
plane of --quad.

Things that cover a place most of the time must be marked: by --exclude, or by strokes in a few frames; those of --mark are \
carried through the clip.

With --regions all planes of the track are on the plate, each pixel in the view of the reference frame: a wall and a floor, or cards one behind the other. Each pixel lies on the plane along which the frames agree best. ravec matte and ravec video take the plate with the same --regions; where planes overlap in a frame, the one with the lower number is in front.

Figures: frames, seen_percent, certainty (mean where something was seen), agreeing_percent (seen pixels whose color most frames have), invented_px; planes with --regions.";

/// Share of pixels on which most frames agree below which a camera is taken to move. Cameras that stood still had 0.83 and more,
/// cameras in motion 0.51 and less.
const MIN_AGREEING: f64 = 0.6;

/// Maximum number of planes of a plate.
const MAX_PLANES: usize = 16;

/// Parameters of [`Plate`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct Params {
    /// Pixels by which the plate is larger than a frame on each side
    #[cfg_attr(feature = "cli", arg(long, value_name = "PIXELS", default_value_t = 0))]
    pub pad: usize,
    /// Corners of a rectangle on the plane in the reference frame: what is invented follows its perspective
    #[cfg_attr(
        feature = "cli",
        arg(long, value_name = "X,Y,X,Y,X,Y,X,Y", allow_hyphen_values = true)
    )]
    pub quad: Option<Quad>,
    /// Number of the plane of a track with several, from 1
    #[cfg_attr(
        feature = "cli",
        arg(long, value_name = "NUMBER", requires = "track", default_value_t = 1)
    )]
    pub plane: usize,
    /// Frames to use, from 0: 100..200 (without frame 200), 100.., ..200, or seconds, as in 1.5s..4s
    #[cfg_attr(feature = "cli", arg(long, value_name = "RANGE"))]
    pub frames: Option<FrameRange>,
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
    /// Content of places that no frame shows
    #[cfg_attr(feature = "cli", arg(long, value_enum, default_value_t = Unseen::Completed))]
    pub unseen: Unseen,
    /// Convention of corners and strokes, and of a track of another program, which does not state its own
    #[cfg_attr(feature = "cli", arg(long, value_enum, default_value_t = PixelCenters::Half))]
    pub pixel_centers: PixelCenters,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            pad: 0,
            quad: None,
            plane: 1,
            frames: None,
            marks: Vec::new(),
            carry: None,
            unseen: Unseen::Completed,
            pixel_centers: PixelCenters::Half,
        }
    }
}

/// Content of places that no frame shows.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
pub enum Unseen {
    /// Holes are completed from the rest of the plate; what lies beyond all frames is transparent, with colors that continue smoothly
    #[default]
    Completed,
    /// The colors of the surroundings continue smoothly
    Smooth,
    /// Nothing: pixels are transparent
    Transparent,
}

impl Operation for Plate {
    const NAME: &'static str = "plate";

    fn inputs(&self) -> Vec<&Path> {
        paths(&self.input, [&self.track, &self.exclude, &self.strokes])
    }

    fn outputs(&self) -> Vec<&Path> {
        paths(&self.output, [&self.seen, &self.certainty, &self.regions])
    }

    /// Writes the plate, and the maps that are asked for.
    ///
    /// Figures: `frames`, `seen_percent`, `certainty`, `agreeing_percent`, `invented_px`. Without a track, a camera that seems to move is a
    /// warning.
    ///
    /// # Errors
    /// [`JobError::Parameter`], [`JobError::ResultSize`], [`JobError::Quad`], [`JobError::Outside`], [`JobError::ReadClip`],
    /// [`JobError::EmptyRange`],
    /// [`JobError::SizesDiffer`], [`JobError::Strokes`], [`JobError::TrackFile`], [`JobError::Shot`], [`JobError::Write`], what
    /// [`check_files`](crate::check_files) refuses, [`JobError::Cancelled`].
    fn run(&self, context: &Context) -> Result<Report, JobError> {
        let params = &self.params;
        let mut report = Report::of(self, params);
        check_plane(params.plane)?;
        check_pad(params.pad)?;
        check_regions(self.regions.as_deref(), self.track.as_deref())?;
        context.check_files(&self.inputs(), &self.outputs())?;
        let clip = open_clip(&self.input, None, &mut report, context)?;
        let (size, total) = (clip.info().size, clip.info().frames);
        let side = |length: usize| (length + 2 * params.pad) as f64;
        let (width, height) = (side(size.width()), side(size.height()));
        if width * height > context.limits.max_pixels as f64 {
            return Err(JobError::ResultSize {
                width,
                height,
                remedy: "give a smaller `pad`",
            });
        }
        let quad = match &params.quad {
            Some(quad) => Some(quad.check(params.pixel_centers, size)?),
            None => None,
        };
        let tracks = self.tracks(&mut report, context)?;
        // strokes follow the chosen plane
        let chosen = if self.regions.is_some() {
            params.plane - 1
        } else {
            0
        };
        let track = tracks.get(chosen);
        let masks = MaskFiles {
            input: &self.input,
            exclude: self.exclude.as_deref(),
            strokes: self.strokes.as_deref(),
        };
        let masks = Exclusions::open(&masks, size, 0, &mut report, context)?;
        let source = MarkSource {
            input: &self.input,
            size,
            marks: &params.marks,
            pictures: &masks.stroke_pictures(),
            carry: params.carry,
            centers: params.pixel_centers,
            track,
            track_path: self.track.as_deref(),
        };
        let marks = Marks::carried(&source, &mut report, context)?;
        let range = params.frames.unwrap_or_default();
        let mut reader = Reader::new(clip, &self.input, range)?;
        reader.exclude(masks);
        let mut pass = Passes {
            reader,
            tracks: &tracks,
            chosen,
            marks,
            total,
            frames: 0,
            deep: false,
        };
        let planes = tracks.len().max(1);
        let samples = PlateSamples::new(size, params.pad, total)?.sharing_memory(planes);
        let mut samples = vec![samples; planes];
        pass.run("samples", context, |frames| {
            Ok(PlateSamples::add_planes(&mut samples, frames)?)
        })?;
        let mut modes = PlateSamples::modes_of_planes(samples, &context.progress)?;
        pass.run("average", context, |frames| {
            Ok(PlateModes::add_planes(&mut modes, frames)?)
        })?;
        pass.reader.warn(&mut report);
        let mut plates: Vec<BackgroundPlate> = modes.into_iter().map(PlateModes::plate).collect();
        let plate = match &self.regions {
            Some(path) => {
                let regions = plate_regions(&plates)?;
                let numbers = regions.map(|index| Srgb([index + 1; 3]));
                let numbers = Picture::from_image(AnyImage::Srgb8(numbers));
                let options = WriteOptions::default();
                files::write(path, &numbers, &options, &mut report, context)?;
                report.figures.insert("planes", planes as f64);
                joined_plate(&plates, &regions)?
            }
            None => plates.swap_remove(0),
        };
        self.write(&plate, quad, pass.deep, &mut report, context)?;
        report.figures.insert("frames", pass.frames as f64);
        Ok(report)
    }
}

/// Passes over the frames of a shot.
struct Passes<'a> {
    reader: Reader<'a>,
    /// The planes; none for a camera that stands still.
    tracks: &'a [ShotTrack],
    /// The plane that strokes follow.
    chosen: usize,
    marks: Marks,
    /// Number of frames, if it is known.
    total: Option<u64>,
    /// Number of frames of the last pass.
    frames: u64,
    /// True if some frame has more than 8 bits.
    deep: bool,
}

impl Passes<'_> {
    /// Calls `take` with each frame in which some plane is found, along all planes. The next frame is read meanwhile.
    fn run(
        &mut self,
        name: &'static str,
        context: &Context,
        mut take: impl FnMut(&[Option<ShotFrame<'_>>]) -> Result<(), JobError> + Send,
    ) -> Result<(), JobError> {
        self.reader.seek(self.reader.first())?;
        self.frames = 0;
        let phase = context.progress.phase(name, self.total.unwrap_or(1));
        let mut current = self.reader.next()?;
        while let Some(shot) = current {
            context.progress.check()?;
            self.deep |= is_deep(&shot.image);
            let (tracks, chosen, marks) = (self.tracks, self.chosen, &self.marks);
            let (next, taken) = rayon::join(
                || self.reader.next(),
                || {
                    let maps: Vec<_> = (0..tracks.len().max(1))
                        .map(|plane| map_of(tracks.get(plane), &shot))
                        .collect();
                    if maps.iter().all(Option::is_none) {
                        return Ok(());
                    }
                    let colors = encoded(&shot.image);
                    let strokes =
                        maps[chosen].map(|map| marks.constraints(shot.index, &colors, map, None));
                    let strokes = strokes.flatten();
                    let marked = |wanted: Constraint| {
                        let strokes = strokes.as_ref()?;
                        Some(Mask::from_fn(colors.size(), |col, row| {
                            Constraint::of(strokes[(col, row)]) == wanted
                        }))
                    };
                    let foreground = marked(Constraint::Foreground);
                    let background = marked(Constraint::Background);
                    let frames = maps.into_iter().enumerate().map(|(plane, map)| {
                        let reference = tracks.get(plane).map_or(0, ShotTrack::reference);
                        Some(ShotFrame {
                            colors: &colors,
                            frame_from_reference: map?,
                            foreground: shot.exclude.as_ref(),
                            strokes: foreground.as_ref(),
                            background: background.as_ref(),
                            is_reference: reference == shot.index,
                        })
                    });
                    take(&frames.collect::<Vec<_>>())
                },
            );
            taken?;
            self.frames += 1;
            phase.advance(1);
            current = next?;
        }
        Ok(())
    }
}

/// The map to a frame; `None` where the plane is lost.
fn map_of<'a>(track: Option<&'a ShotTrack>, shot: &Shot) -> Option<&'a Homography> {
    match track {
        None => Some(&Homography::IDENTITY),
        Some(track) if track.is_found(shot.index) => track.map(shot.index),
        Some(_) => None,
    }
}

impl Plate {
    /// The planes of the plate: the chosen one of the track, or all of them.
    fn tracks(&self, report: &mut Report, context: &Context) -> Result<Vec<ShotTrack>, JobError> {
        let Some(path) = &self.track else {
            return Ok(Vec::new());
        };
        let choice = TrackChoice {
            path,
            plane: self.params.plane,
            centers: self.params.pixel_centers,
        };
        if self.regions.is_none() {
            return Ok(vec![ShotTrack::read(&choice, report, context)?]);
        }
        let tracks = ShotTrack::read_all(&choice, report, context)?;
        let planes = tracks.len();
        if !(1..=planes).contains(&self.params.plane) {
            return Err(JobError::Parameter {
                field: "plane",
                value: format!("{}, and the track has {planes}", self.params.plane),
                range: "the number of one of its planes",
            });
        }
        if let Some(map) = &self.regions
            && Format::from_extension(map) == Some(Format::Jpeg)
        {
            return Err(JobError::Parameter {
                field: "regions",
                value: map.display().to_string(),
                range: "a file that keeps exact values, such as .png",
            });
        }
        if planes > MAX_PLANES {
            return Err(JobError::TrackFile {
                path: path.clone(),
                reason: format!("it has {planes} planes, and a plate has at most {MAX_PLANES}"),
            });
        }
        let reference = tracks[0].reference();
        if tracks.iter().any(|track| track.reference() != reference) {
            return Err(JobError::TrackFile {
                path: path.clone(),
                reason: "its planes are given in different frames: a plate has the view of one"
                    .to_owned(),
            });
        }
        Ok(tracks)
    }

    /// Writes the plate and the maps.
    fn write(
        &self,
        plate: &BackgroundPlate,
        quad: Option<[DVec2; 4]>,
        deep: bool,
        report: &mut Report,
        context: &Context,
    ) -> Result<(), JobError> {
        let beyond = beyond(&plate.seen, self.params.pad);
        let colors = self.completed(plate, &beyond, quad, report, context)?;
        let gray = |plane: &Plane| -> AnyImage {
            let gray: Image<Srgb<u8>> = plane.map(|value| Srgb([value; 3])).convert();
            gray.into()
        };
        let mut save = |path: &Path, image: AnyImage| {
            let options = WriteOptions::default();
            files::write(path, &Picture::from_image(image), &options, report, context)
        };
        let opaque = match self.params.unseen {
            Unseen::Completed if self.output_has_alpha() && !beyond.is_empty() => {
                Some(beyond.invert())
            }
            Unseen::Completed | Unseen::Smooth => None,
            Unseen::Transparent => Some(plate.seen.clone()),
        };
        save(&self.output, drawn(&colors, opaque.as_ref(), deep))?;
        let seen = plate.seen.coverage();
        if let Some(path) = &self.seen {
            save(path, gray(seen))?;
        }
        if let Some(path) = &self.certainty {
            save(path, gray(&plate.certainty))?;
        }
        let pixels = seen.pixels().len();
        let count = seen.pixels().iter().filter(|&&seen| seen > 0.0).count();
        let agreeing = plate.agreeing_share();
        if self.track.is_none() && agreeing < MIN_AGREEING {
            report.warn(format!(
                "most frames agree on {:.0} % of the plate only: if the camera moves, track the background with `ravec track` and give `track`",
                100.0 * agreeing
            ));
        }
        let certainty = plate.certainty.pixels().iter();
        let certainty: f64 = certainty.map(|&value| f64::from(value)).sum();
        for (name, figure) in [
            ("seen_percent", 100.0 * count as f64 / pixels as f64),
            ("certainty", certainty / count.max(1) as f64),
            ("agreeing_percent", 100.0 * agreeing),
            ("invented_px", (pixels - count) as f64),
        ] {
            report.figures.insert(name, figure);
        }
        Ok(())
    }

    /// False for an output whose format has no alpha.
    fn output_has_alpha(&self) -> bool {
        Format::from_extension(&self.output).is_none_or(Format::has_alpha)
    }

    /// Colors of the plate, with holes completed if that is asked for.
    fn completed(
        &self,
        plate: &BackgroundPlate,
        beyond: &Mask,
        quad: Option<[DVec2; 4]>,
        report: &mut Report,
        context: &Context,
    ) -> Result<Image<Srgb<f32>>, JobError> {
        let colors = plate.colors.map(Srgb);
        let hole = Mask::from_fn(plate.seen.size(), |col, row| {
            plate.seen.at(col, row) <= 0.0 && beyond.at(col, row) <= 0.0
        });
        if self.params.unseen != Unseen::Completed || hole.is_empty() {
            return Ok(colors);
        }
        let shift = DVec2::splat(self.params.pad as f64);
        let quad = quad.map(|quad| quad.map(|at| at + shift));
        let params = CompleteParams::default();
        match complete(&colors, &hole, quad.as_slice(), &params, &context.progress) {
            Ok(completed) => Ok(completed.image),
            Err(CompleteError::Cancelled(_)) => Err(JobError::Cancelled),
            Err(reason) => {
                report.record_assumed(format!(
                    "what no frame shows continues smoothly, for it cannot be completed: {reason}"
                ));
                Ok(colors)
            }
        }
    }
}

/// The picture that is written, with as many bits as the clip has.
fn drawn(colors: &Image<Srgb<f32>>, opaque: Option<&Mask>, deep: bool) -> AnyImage {
    let Some(opaque) = opaque else {
        return if deep {
            AnyImage::Srgb16(colors.with_samples())
        } else {
            AnyImage::Srgb8(colors.with_samples())
        };
    };
    let pixels: Image<Srgba<f32>> = Image::from_fn(colors.size(), |col, row| {
        let Srgb([r, g, b]) = colors[(col, row)];
        Srgba([r, g, b, opaque.at(col, row)])
    });
    if deep {
        AnyImage::Srgba16(pixels.with_samples())
    } else {
        AnyImage::Srgba8(pixels.with_samples())
    }
}

/// Mask of the area outside of all frames: unseen pixels connected to the border of the plate outside of the reference frame.
fn beyond(seen: &Mask, pad_px: usize) -> Mask {
    let size = seen.size();
    let (width, height) = (size.width(), size.height());
    let in_reference = |col: usize, row: usize| {
        let (right, bottom) = (width - pad_px.min(width), height - pad_px.min(height));
        (pad_px..right).contains(&col) && (pad_px..bottom).contains(&row)
    };
    let unseen = |col: usize, row: usize| seen.at(col, row) <= 0.0;
    let mut outside: Image<u8> = Image::new(size, 0);
    let mut open: Vec<(usize, usize)> = (0..width)
        .flat_map(|col| [(col, 0), (col, height - 1)])
        .chain((0..height).flat_map(|row| [(0, row), (width - 1, row)]))
        .collect();
    while let Some((col, row)) = open.pop() {
        if outside[(col, row)] == 1 || !unseen(col, row) || in_reference(col, row) {
            continue;
        }
        outside[(col, row)] = 1;
        open.extend((col > 0).then(|| (col - 1, row)));
        open.extend((row > 0).then(|| (col, row - 1)));
        open.extend((col + 1 < width).then_some((col + 1, row)));
        open.extend((row + 1 < height).then_some((col, row + 1)));
    }
    Mask::from_fn(size, |col, row| outside[(col, row)] == 1)
}

#[cfg(test)]
mod tests;

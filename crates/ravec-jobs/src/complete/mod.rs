//! `complete`: holes of a picture filled from the rest of it, in perspective where planes are known.
//!
//! Two engines: offsets and one cut for a whole hole, or fragments one by one, whose steps can be written, changed and
//! repeated.

mod fragments;

pub use crate::corners::Corners;
pub use fragments::RecordedSteps;

use crate::context::Context;
use crate::corners::{check_polygons, with_polygons};
use crate::error::JobError;
use crate::files;
use crate::mask::read_mask;
use crate::operation::{Operation, paths};
use crate::pixel_centers::PixelCenters;
use crate::report::Report;
use glam::DVec2;
use ravec::completion::{CompleteError, CompleteParams, CompleteSummary, complete};
use ravec::progress::Progress;
use ravec::raster::{AnyImage, Color, Image, Mask, with_image};
use ravec_media::WriteOptions;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Fill holes in a picture from the rest of it, in perspective where planes are given
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args), command(after_help = HELP, group = clap::ArgGroup::new("hole").args(["mask", "polygons"]).required(true).multiple(true)))]
pub struct Complete {
    /// Input picture; `-` is standard input
    pub input: PathBuf,
    /// Mask of the pixels to replace, of the same size: white replaces, black keeps, gray mixes; `-` is standard input
    #[cfg_attr(feature = "cli", arg(short, long, value_name = "FILE"))]
    #[serde(default)]
    pub mask: Option<PathBuf>,
    /// Mask of the structure to continue, of the same size: white on it, inside and outside the hole
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE"))]
    #[serde(default)]
    pub features: Option<PathBuf>,
    /// Another photo that fragments may come from. May be repeated
    #[cfg_attr(feature = "cli", arg(long = "source", value_name = "FILE"))]
    #[serde(default)]
    pub sources: Vec<PathBuf>,
    /// Replay the steps of this file, which `--steps` wrote, instead of searching
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE"))]
    #[serde(default)]
    pub replay: Option<PathBuf>,
    /// Steps in the operation itself, in place of a file, in the form of such a file
    #[cfg_attr(feature = "cli", arg(skip))]
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub recorded: Option<RecordedSteps>,
    /// Write the steps as JSON; `-` is standard output
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE"))]
    #[serde(default)]
    pub steps: Option<PathBuf>,
    /// Output picture; its extension selects the format, `-` is standard output in the input's format
    #[cfg_attr(feature = "cli", arg(short, long, value_name = "FILE"))]
    pub output: PathBuf,
    /// Parameters.
    #[cfg_attr(feature = "cli", command(flatten))]
    #[serde(default)]
    pub params: Params,
}

#[cfg(feature = "cli")]
const HELP: &str = "\
Examples:
  ravec complete photo.jpg --polygon 40,30,70,28,72,60,41,58 -o without.png
  ravec complete photo.jpg --mask mask.png -o without.png --plane 10,8,110,20,108,70,12,80
  ravec complete photo.jpg --mask mask.png -o without.png --engine fragments --steps steps.json
  ravec complete photo.jpg --mask mask.png -o without.png --replay steps.json
  ravec complete photo.jpg --mask mask.png -o without.png --target 70,50 --source noisy.jpg

Points are in pixels, x right, y down; the center of the first pixel is (0.5, 0.5), or (0, 0) with --pixel-centers integer. Pixels that are not masked stay as they are, \
bit for bit.

With --radius, --target, --mirror, --turn, --scale, --features, --source, --replay or --steps the hole is filled by fragments, \
which are copied one by one; without them as a whole.

Figures: hole_px; with offsets thin_px, plane_px, parts, proposals, offsets, sourceless_px; with fragments steps, replaced, \
buffers, index_bytes_per_px, open_px.";

/// Parameters of [`Complete`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct Params {
    /// The corners x0,y0,x1,y1,x2,y2,x3,y3 of a rectangle on a plane, in order around it; `none` or nothing for no plane.
    /// May be repeated
    ///
    /// The part of the hole in it is filled in its perspective. Where several overlap, the first one counts.
    #[cfg_attr(
        feature = "cli",
        arg(long = "plane", value_name = "X0,Y0,...", allow_hyphen_values = true)
    )]
    pub planes: Vec<Corners>,
    /// The corners x0,y0,x1,y1,x2,y2,... of a polygon that is replaced as well. May be repeated
    #[cfg_attr(
        feature = "cli",
        arg(long = "polygon", value_name = "X0,Y0,...", allow_hyphen_values = true)
    )]
    pub polygons: Vec<Corners>,
    /// Radius around the hole in which sources are searched without a plane, in pixels, 16 to 65535. A larger one finds more
    /// sources, more of them in another light
    #[cfg_attr(feature = "cli", arg(long, value_name = "PX", default_value_t = Self::default().search))]
    pub search: u16,
    /// Keep the tones of copied pixels, instead of blending them into those around the hole
    #[cfg_attr(feature = "cli", arg(long))]
    pub unblended: bool,
    /// Method: by default fragments where an option needs them, else offsets
    #[cfg_attr(feature = "cli", arg(long, value_enum, value_name = "ENGINE"))]
    pub engine: Option<Engine>,
    /// Radius of fragments in pixels, 2 to 124; without it chosen from the picture
    #[cfg_attr(feature = "cli", arg(long, value_name = "PX"))]
    pub radius: Option<u32>,
    /// A position X,Y around which a fragment is replaced by the one that fits best, in this order, instead of filling all.
    /// May be repeated
    #[cfg_attr(
        feature = "cli",
        arg(long = "target", value_name = "X,Y", allow_hyphen_values = true)
    )]
    pub targets: Vec<Corners>,
    /// Also use mirrored fragments
    #[cfg_attr(feature = "cli", arg(long))]
    pub mirror: bool,
    /// Also use fragments rotated by this angle in degrees, clockwise. May be repeated
    #[cfg_attr(
        feature = "cli",
        arg(long = "turn", value_name = "DEGREES", allow_hyphen_values = true)
    )]
    pub turns: Vec<f64>,
    /// Also use fragments scaled by this factor, 0.25 to 4. May be repeated
    #[cfg_attr(feature = "cli", arg(long = "scale", value_name = "FACTOR"))]
    pub scales: Vec<f64>,
    /// Leave out the last N of the steps that are replayed
    #[cfg_attr(feature = "cli", arg(long, value_name = "N", default_value_t = Self::default().undo))]
    pub undo: usize,
    /// Center of the first pixel in points that are given or printed: half is (0.5, 0.5), integer is (0, 0)
    #[cfg_attr(feature = "cli", arg(long, value_enum, value_name = "CENTERS", default_value_t = PixelCenters::Half))]
    pub pixel_centers: PixelCenters,
    /// Quality of a JPEG output, 1 to 100: higher is larger and closer to the picture
    #[cfg_attr(feature = "cli", arg(long, value_name = "QUALITY", default_value_t = Self::default().quality))]
    pub quality: u8,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            planes: Vec::new(),
            polygons: Vec::new(),
            search: CompleteParams::default().search_px as u16,
            unblended: false,
            engine: None,
            radius: None,
            targets: Vec::new(),
            mirror: false,
            turns: Vec::new(),
            scales: Vec::new(),
            undo: 0,
            pixel_centers: PixelCenters::default(),
            quality: WriteOptions::default().quality,
        }
    }
}

/// Method that fills a hole.
///
/// In the library each method is a function with parameters of its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
pub enum Engine {
    /// As a whole: offsets that fit its surroundings, and one cut that says which pixel takes which of them
    Offsets,
    /// Step by step: fragments that fit what is known by then
    Fragments,
}

impl Complete {
    /// The first field that only fragments can honor.
    fn needs_fragments(&self) -> Option<&'static str> {
        let params = &self.params;
        let needs = [
            (params.radius.is_some(), "radius"),
            (!params.targets.is_empty(), "targets"),
            (params.mirror, "mirror"),
            (!params.turns.is_empty(), "turns"),
            (!params.scales.is_empty(), "scales"),
            (self.features.is_some(), "features"),
            (!self.sources.is_empty(), "sources"),
            (self.replay.is_some(), "replay"),
            (self.recorded.is_some(), "recorded"),
            (self.steps.is_some(), "steps"),
        ];
        needs.into_iter().find(|need| need.0).map(|need| need.1)
    }

    fn check(&self) -> Result<(), JobError> {
        let params = &self.params;
        let no_polygon = params.polygons.iter().all(|polygon| polygon.0.is_empty());
        if self.mask.is_none() && no_polygon {
            return Err(JobError::Missing {
                fields: &["mask", "polygons"],
                expected: "give the pixels to replace",
            });
        }
        params.check()?;
        match self.needs_fragments() {
            Some(field) if params.engine == Some(Engine::Offsets) => Err(JobError::Parameter {
                field,
                value: "given".to_owned(),
                range: "left out with `engine` offsets",
            }),
            _ => Ok(()),
        }
    }
}

impl Params {
    fn check(&self) -> Result<(), JobError> {
        let wrong = |field, value: String, range| {
            Err(JobError::Parameter {
                field,
                value,
                range,
            })
        };
        if let Some(plane) = self
            .planes
            .iter()
            .find(|plane| !matches!(plane.0.len(), 0 | 4))
        {
            return wrong(
                "planes",
                format!("{} corners", plane.0.len()),
                "4 corners, that is 8 numbers",
            );
        }
        check_polygons("polygons", &self.polygons)?;
        if let Some(target) = self.targets.iter().find(|target| target.0.len() != 1) {
            let given = format!("{} positions", target.0.len());
            return wrong("targets", given, "one position X,Y");
        }
        if self
            .radius
            .is_some_and(|radius| !(2..=124).contains(&radius))
        {
            let radius = self.radius.unwrap_or_default().to_string();
            return wrong("radius", radius, "2 to 124");
        }
        if let Some(scale) = self
            .scales
            .iter()
            .find(|scale| !(0.25..=4.0).contains(*scale))
        {
            return wrong("scales", scale.to_string(), "0.25 to 4");
        }
        if let Some(turn) = self.turns.iter().find(|turn| !turn.is_finite()) {
            return wrong("turns", turn.to_string(), "a number of degrees");
        }
        if self.search < 16 {
            return wrong("search", self.search.to_string(), "16 to 65535");
        }
        if !(1..=100).contains(&self.quality) {
            return wrong("quality", self.quality.to_string(), "1 to 100");
        }
        Ok(())
    }
}

impl Operation for Complete {
    const NAME: &'static str = "complete";

    fn inputs(&self) -> Vec<&Path> {
        let mut inputs = paths(&self.input, [&self.mask, &self.features]);
        inputs.extend(self.sources.iter().map(PathBuf::as_path));
        inputs.extend(self.replay.as_deref());
        inputs
    }

    fn outputs(&self) -> Vec<&Path> {
        paths(&self.output, [&self.steps])
    }

    /// Replaces what the mask (white replaces, black keeps, gray mixes) and the polygons cover.
    ///
    /// Figures: `hole_px`, pixels that were replaced, be it in part. With offsets: of these `thin_px`, interpolated because they
    /// were near known ones on both sides, and `plane_px`, filled along planes; `parts` that were filled one after another;
    /// `proposals` and `offsets`, places that were thought of and that were copied from; `sourceless_px`, pixels without any
    /// source. With fragments: `steps` that were taken, of these `replaced`, whose fragment took the place of another one;
    /// `buffers` that were searched, `index_bytes_per_px` for each of their pixels, `open_px` that are still to be filled.
    ///
    /// # Errors
    /// [`JobError::Parameter`], [`JobError::Missing`], [`JobError::Read`], [`JobError::SizesDiffer`], [`JobError::Complete`], [`JobError::Steps`],
    /// [`JobError::Write`], what [`check_files`](crate::check_files) refuses, [`JobError::Cancelled`].
    fn run(&self, context: &Context) -> Result<Report, JobError> {
        let Self {
            input,
            output,
            params,
            ..
        } = self;
        self.check()?;
        files::check_target(output, context)?;
        context.check_files(&self.inputs(), &self.outputs())?;
        let mut report = Report::of(self, params);
        let picture = files::read(input, &mut report, context)?;
        let size = picture.image.size();
        files::check_size(output, size, &picture, context)?;
        let mut read = |path: &PathBuf| read_mask(path, input, size, &mut report, context);
        let mask = self.mask.as_ref().map(&mut read).transpose()?;
        let features = self.features.as_ref().map(&mut read).transpose()?;
        let hole = mask.unwrap_or_else(|| Mask::empty(size));
        let hole = with_polygons(hole, "polygons", &params.polygons, params.pixel_centers)?;
        let job = Job {
            operation: self,
            picture: &picture.image,
            hole: &hole,
            features: features.as_ref(),
            planes: params
                .planes
                .iter()
                .filter_map(|plane| plane.0.as_slice().try_into().ok())
                .map(|plane| params.pixel_centers.read_all(plane))
                .collect(),
            context,
        };
        let fragments = match params.engine {
            Some(engine) => engine == Engine::Fragments,
            None => self.needs_fragments().is_some(),
        };
        let image = if fragments {
            fragments::fill(&job, &mut report)?
        } else {
            offsets(&job, &mut report)?
        };
        if hole.is_empty() {
            report.warn("the mask is empty: the picture is as it was");
        }
        let options = WriteOptions {
            quality: params.quality,
            ..WriteOptions::default()
        };
        let picture = picture.with_pixels(image);
        files::write(output, &picture, &options, &mut report, context)?;
        Ok(report)
    }
}

/// Inputs of a completion.
struct Job<'a> {
    operation: &'a Complete,
    picture: &'a AnyImage,
    hole: &'a Mask,
    features: Option<&'a Mask>,
    planes: Vec<[DVec2; 4]>,
    context: &'a Context,
}

/// Fills the hole as a whole.
fn offsets(job: &Job, report: &mut Report) -> Result<AnyImage, JobError> {
    let params = &job.operation.params;
    let options = CompleteParams {
        search_px: usize::from(params.search),
        blend: !params.unblended,
    };
    let filled = report.time("complete", || {
        with_image!(job.picture, image => filled(image, job.hole, &job.planes, &options, &job.context.progress))
    });
    let (image, summary) =
        filled.map_err(|cause| JobError::from_completing(&job.operation.input, cause))?;
    for (index, _) in summary
        .plane_px
        .iter()
        .enumerate()
        .filter(|(_, px)| **px == 0 && summary.hole_px > 0)
    {
        report.warn(format!("nothing of the mask lies in plane {}", index + 1));
    }
    if summary.sourceless_px > 0 {
        report.record_assumed(format!(
            "{} pixels had no source and were interpolated",
            summary.sourceless_px
        ));
    }
    for (name, count) in [
        ("hole_px", summary.hole_px),
        ("thin_px", summary.thin_px),
        ("plane_px", summary.plane_px.iter().sum()),
        ("parts", summary.parts),
        ("proposals", summary.proposals),
        ("offsets", summary.offsets),
        ("sourceless_px", summary.sourceless_px),
    ] {
        report.figures.insert(name, count as f64);
    }
    report.embed(&summary);
    Ok(image)
}

fn filled<P: Color>(
    image: &Image<P>,
    hole: &Mask,
    planes: &[[DVec2; 4]],
    params: &CompleteParams,
    progress: &Progress,
) -> Result<(AnyImage, CompleteSummary), CompleteError>
where
    Image<P>: Into<AnyImage>,
{
    let completed = complete(image, hole, planes, params, progress)?;
    Ok((completed.image.into(), completed.summary))
}

#[cfg(test)]
mod tests;

//! `complete`: holes of a picture filled from the rest of it, in perspective where planes are known.
//!
//! Two engines: offsets and one cut for a whole hole, or fragments one by one, whose steps can be written, changed and
//! repeated.

mod fragments;

use crate::error::JobError;
use crate::files::{self, Source};
use crate::mask::read_mask;
use crate::report::Report;
use glam::DVec2;
use ravec::completion::{CompleteError, CompleteParams, CompleteSummary, complete};
use ravec::progress::Progress;
use ravec::raster::{AnyImage, Color, Image, Mask, Size, with_image};
use ravec_media::WriteOptions;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// Holes and sources of a completion.
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
    /// How far from the hole sources are looked for where there is no plane, in pixels, 16 to 65535. Farther finds more, of
    /// which more is in another light
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
            quality: WriteOptions::default().quality,
        }
    }
}

/// How a hole is filled.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
pub enum Engine {
    /// As a whole: offsets that fit its surroundings, and one cut that says which pixel takes which of them
    Offsets,
    /// Step by step: fragments that fit what is known by then
    Fragments,
}

/// The files beside the picture, all of them optional.
#[derive(Debug, Clone, Default)]
pub struct Files {
    /// Mask of the pixels to replace: white replaces, black keeps, gray mixes.
    pub mask: Option<Source>,
    /// Pixels on structure that should go on: white, in a picture of the same size.
    pub features: Option<Source>,
    /// Other photos that fragments may come from.
    pub photos: Vec<Source>,
    /// Steps to be taken instead of others.
    pub replay: Option<PathBuf>,
    /// Where the steps that were taken are written.
    pub steps: Option<PathBuf>,
}

impl Files {
    /// The files that are read.
    pub fn inputs(&self) -> impl Iterator<Item = &Path> {
        let sources = self.mask.iter().chain(&self.features).chain(&self.photos);
        sources
            .map(|source| source.path.as_path())
            .chain(self.replay.as_deref())
    }
}

/// Corners as they are given on the command line: x and y in turn, in pixels, x right, y down, pixel centers at
/// half-integers. None at all for `none` or an empty text.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Corners(pub Vec<DVec2>);

impl FromStr for Corners {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let text = text.trim();
        if text.is_empty() || text == "none" {
            return Ok(Self::default());
        }
        let number = |word: &str| match word.trim().parse::<f64>() {
            Ok(number) if number.is_finite() => Ok(number),
            _ => Err(format!("`{}` is not a number", word.trim())),
        };
        let numbers = text.split(',').map(number).collect::<Result<Vec<_>, _>>()?;
        if numbers.len() % 2 == 1 {
            return Err(format!(
                "{} numbers are not pairs of x and y",
                numbers.len()
            ));
        }
        Ok(Self(
            numbers
                .chunks_exact(2)
                .map(|pair| DVec2::new(pair[0], pair[1]))
                .collect(),
        ))
    }
}

impl Params {
    /// The first of what only fragments can do.
    fn needs_fragments(&self, files: &Files) -> Option<&'static str> {
        let needs = [
            (self.radius.is_some(), "--radius"),
            (!self.targets.is_empty(), "--target"),
            (self.mirror, "--mirror"),
            (!self.turns.is_empty(), "--turn"),
            (!self.scales.is_empty(), "--scale"),
            (files.features.is_some(), "--features"),
            (!files.photos.is_empty(), "--source"),
            (files.replay.is_some(), "--replay"),
            (files.steps.is_some(), "--steps"),
        ];
        needs.into_iter().find(|need| need.0).map(|need| need.1)
    }

    fn check(&self, files: &Files) -> Result<(), JobError> {
        let wrong = |name, value: String, range| Err(JobError::Parameter { name, value, range });
        if files.mask.is_none() && self.polygons.iter().all(|polygon| polygon.0.is_empty()) {
            return wrong(
                "--mask or --polygon",
                "missing".to_owned(),
                "what is to be replaced",
            );
        }
        if let Some(plane) = self
            .planes
            .iter()
            .find(|plane| !matches!(plane.0.len(), 0 | 4))
        {
            return wrong(
                "--plane",
                format!("{} corners", plane.0.len()),
                "4 corners, that is 8 numbers",
            );
        }
        if let Some(polygon) = self
            .polygons
            .iter()
            .find(|polygon| matches!(polygon.0.len(), 1 | 2))
        {
            return wrong(
                "--polygon",
                format!("{} corners", polygon.0.len()),
                "3 corners or more",
            );
        }
        if let Some(target) = self.targets.iter().find(|target| target.0.len() != 1) {
            let given = format!("{} positions", target.0.len());
            return wrong("--target", given, "one position X,Y");
        }
        if self
            .radius
            .is_some_and(|radius| !(2..=124).contains(&radius))
        {
            let radius = self.radius.unwrap_or_default().to_string();
            return wrong("--radius", radius, "2 to 124");
        }
        if let Some(scale) = self
            .scales
            .iter()
            .find(|scale| !(0.25..=4.0).contains(*scale))
        {
            return wrong("--scale", scale.to_string(), "0.25 to 4");
        }
        if let Some(turn) = self.turns.iter().find(|turn| !turn.is_finite()) {
            return wrong("--turn", turn.to_string(), "a number of degrees");
        }
        if self.engine == Some(Engine::Offsets)
            && let Some(name) = self.needs_fragments(files)
        {
            return wrong(name, "given".to_owned(), "left out with --engine offsets");
        }
        if self.search < 16 {
            return wrong("--search", self.search.to_string(), "16 to 65535");
        }
        if !(1..=100).contains(&self.quality) {
            return wrong("--quality", self.quality.to_string(), "1 to 100");
        }
        Ok(())
    }
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
/// [`JobError::Parameter`], [`JobError::Read`], [`JobError::SizesDiffer`], [`JobError::Complete`], [`JobError::Steps`],
/// [`JobError::Write`], what [`check_files`](crate::check_files) refuses, [`JobError::Cancelled`].
pub fn run(
    input: &Source,
    files: &Files,
    output: &Path,
    params: &Params,
    progress: &Progress,
) -> Result<Report, JobError> {
    params.check(files)?;
    files::check_target(output)?;
    let inputs: Vec<&Path> = std::iter::once(input.path.as_path())
        .chain(files.inputs())
        .collect();
    let outputs: Vec<&Path> = std::iter::once(output)
        .chain(files.steps.as_deref())
        .collect();
    files::check_files(&inputs, &outputs)?;
    let mut report = Report::new("complete", params);
    let picture = files::read(input, &mut report, progress)?;
    let size = picture.image.size();
    files::check_size(output, size, &picture)?;
    let mut read = |mask: &Source| read_mask(mask, (&input.path, size), &mut report, progress);
    let mut hole = files
        .mask
        .as_ref()
        .map_or_else(|| Ok(Mask::empty(size)), &mut read)?;
    let features = files.features.as_ref().map(&mut read).transpose()?;
    add_polygons(&mut hole, size, params)?;
    let job = Job {
        input,
        picture: &picture.image,
        hole: &hole,
        features: features.as_ref(),
        files,
        planes: params
            .planes
            .iter()
            .filter_map(|plane| plane.0.as_slice().try_into().ok())
            .collect(),
        params,
        progress,
    };
    let fragments = match params.engine {
        Some(engine) => engine == Engine::Fragments,
        None => params.needs_fragments(files).is_some(),
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
    files::write(
        output,
        &picture.with_pixels(image),
        &options,
        &mut report,
        progress,
    )?;
    Ok(report)
}

/// Inputs of a completion.
struct Job<'a> {
    input: &'a Source,
    picture: &'a AnyImage,
    hole: &'a Mask,
    features: Option<&'a Mask>,
    files: &'a Files,
    planes: Vec<[DVec2; 4]>,
    params: &'a Params,
    progress: &'a Progress,
}

/// Fills the hole as a whole.
fn offsets(job: &Job, report: &mut Report) -> Result<AnyImage, JobError> {
    let options = CompleteParams {
        search_px: usize::from(job.params.search),
        blend: !job.params.unblended,
    };
    let filled = report.time("complete", || {
        with_image!(job.picture, image => filled(image, job.hole, &job.planes, &options, job.progress))
    });
    let (image, summary) =
        filled.map_err(|cause| JobError::from_completing(&job.input.path, cause))?;
    for (index, _) in summary
        .plane_px
        .iter()
        .enumerate()
        .filter(|(_, px)| **px == 0 && summary.hole_px > 0)
    {
        report.warn(format!("nothing of the mask lies in plane {}", index + 1));
    }
    if summary.sourceless_px > 0 {
        report.warn(format!(
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

fn add_polygons(hole: &mut Mask, size: Size, params: &Params) -> Result<(), JobError> {
    for polygon in params
        .polygons
        .iter()
        .filter(|polygon| !polygon.0.is_empty())
    {
        let wrong = |_| JobError::Parameter {
            name: "--polygon",
            value: "too large".to_owned(),
            range: "coordinates between -1e9 and 1e9",
        };
        let covered = Mask::from_polygon(size, &polygon.0).map_err(wrong)?;
        *hole = hole.union(&covered).map_err(wrong)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests;

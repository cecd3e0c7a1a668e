//! Filling step by step, and the steps as a file.
//!
//! A file of steps is JSON: the size of the picture that they were taken on, `pixel_centers` unless they are at
//! half-integers, and for each step a target (position, radius, shape, the plane in whose view it lies), a source (photo, plane,
//! position, how it is turned, mirrored and scaled) and whether tones are bent. All positions are in pixels of the pictures, so
//! that a step can be changed by hand.

use super::{Job, Params};
use crate::context::Context;
use crate::error::{JobError, plain};
use crate::files;
use crate::pixel_centers::PixelCenters;
use crate::report::Report;
use ravec::completion::{
    CompleteError, FillOptions, FragmentIndex, Retouch, SearchOptions, Sources, Step, Target,
    Variant,
};
use ravec::raster::{AnyImage, Color, Image, Size, with_image};
use ravec_media::Picture;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// The largest file of steps that is read.
const MAX_BYTES: u64 = 64 << 20;
/// The radius of targets that are given without one.
const TARGET_RADIUS_PX: u32 = 24;

/// Steps, with the size of the picture that they were taken on.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RecordedSteps {
    /// Columns of the picture.
    pub width: usize,
    /// Rows of the picture.
    pub height: usize,
    /// Convention of the positions.
    #[serde(default, skip_serializing_if = "PixelCenters::is_half")]
    pub pixel_centers: PixelCenters,
    /// The steps in their order.
    pub steps: Vec<Step>,
}

/// Result for a picture.
struct Filled {
    image: AnyImage,
    steps: Vec<Step>,
    replaced: usize,
    open_px: usize,
    buffers: usize,
    bytes_per_px: f64,
}

/// Fills the hole by fragments.
pub(super) fn fill(job: &Job, report: &mut Report) -> Result<AnyImage, JobError> {
    let mut photos = Vec::new();
    for source in &job.operation.sources {
        photos.push(files::read(source, report, job.context)?);
    }
    let size = job.picture.size();
    let Params { undo, .. } = job.operation.params;
    let replayed = match (&job.operation.replay, &job.operation.recorded) {
        (Some(path), None) => Some(checked(read_steps(path, job.context)?, path, size, undo)?),
        (None, Some(steps)) => Some(checked(steps.clone(), &job.operation.input, size, undo)?),
        (None, None) => None,
        (Some(_), Some(_)) => {
            return Err(JobError::Parameter {
                field: "recorded",
                value: "given".to_owned(),
                range: "left out with `replay`",
            });
        }
    };
    let filled = report.time(
        "complete",
        || with_image!(job.picture, image => filled(image, job, &photos, replayed.as_deref())),
    )?;
    if filled.open_px > 0 {
        report.warn(format!("{} pixels are not filled yet", filled.open_px));
    }
    let hole_px = job
        .hole
        .coverage()
        .pixels()
        .iter()
        .filter(|&&c| c > 0.0)
        .count();
    for (name, value) in [
        ("hole_px", hole_px as f64),
        ("steps", filled.steps.len() as f64),
        ("replaced", filled.replaced as f64),
        ("buffers", filled.buffers as f64),
        ("index_bytes_per_px", filled.bytes_per_px),
        ("open_px", filled.open_px as f64),
    ] {
        report.figures.insert(name, value);
    }
    if let Some(path) = &job.operation.steps {
        let centers = job.operation.params.pixel_centers;
        let mut steps = filled.steps;
        for step in &mut steps {
            step.target.at = centers.write(step.target.at);
            step.source.at = centers.write(step.source.at);
        }
        let steps = RecordedSteps {
            width: size.width(),
            height: size.height(),
            pixel_centers: centers,
            steps,
        };
        let text = serde_json::to_string_pretty(&steps).expect("steps are plain numbers and words");
        files::write_output_text(path, "JSON", &(text + "\n"), report, job.context)?;
    }
    Ok(filled.image)
}

fn filled<P: Color>(
    image: &Image<P>,
    job: &Job,
    photos: &[Picture],
    replayed: Option<&[Step]>,
) -> Result<Filled, JobError>
where
    Image<P>: Into<AnyImage>,
{
    let failed = |cause| JobError::from_completing(&job.operation.input, cause);
    let params = &job.operation.params;
    let nothing = Filled {
        image: image.clone().into(),
        steps: Vec::new(),
        replaced: 0,
        open_px: 0,
        buffers: 0,
        bytes_per_px: 0.0,
    };
    if job.hole.is_empty() && replayed.is_none() {
        return Ok(nothing);
    }
    let photos: Vec<Image<P>> = photos.iter().map(Picture::convert).collect();
    let sources = Sources {
        planes: &job.planes,
        photos: &photos,
        features: job.features,
        variants: &variants(params),
        ..Sources::new(image, job.hole)
    };
    let index = FragmentIndex::new(&sources, &job.context.progress).map_err(failed)?;
    let mut retouch = Retouch::new(&index);
    let mut replaced = 0;
    if let Some(steps) = replayed {
        let path = job
            .operation
            .replay
            .as_ref()
            .unwrap_or(&job.operation.input);
        retouch
            .replay(steps, &job.context.progress)
            .map_err(|cause| match cause {
                CompleteError::Fragment { what } => JobError::Steps {
                    path: path.clone(),
                    reason: what,
                },
                cause => failed(cause),
            })?;
    }
    for target in &params.targets {
        take_best(&mut retouch, params.pixel_centers.read(target.0[0]), job).map_err(failed)?;
    }
    if replayed.is_none() && params.targets.is_empty() {
        let options = FillOptions {
            radius_px: params.radius,
            blend: !params.unblended,
            ..FillOptions::default()
        };
        replaced = retouch
            .fill(&options, &job.context.progress)
            .map_err(failed)?
            .replaced;
    }
    Ok(Filled {
        image: retouch.picture(image).into(),
        steps: retouch.steps().copied().collect(),
        replaced,
        open_px: retouch.open_px(),
        buffers: index.buffers(),
        bytes_per_px: index.bytes() as f64 / index.pixels() as f64,
    })
}

/// Takes the best step around a position, on the plane there if there is one.
fn take_best(retouch: &mut Retouch, at: glam::DVec2, job: &Job) -> Result<(), CompleteError> {
    let plane = retouch.index().plane_at(at);
    let target = Target {
        plane,
        ..Target::new(at, job.operation.params.radius.unwrap_or(TARGET_RADIUS_PX))
    };
    let search = SearchOptions {
        count: 1,
        along_plane: plane.map(Some),
        ..SearchOptions::default()
    };
    let found = retouch.best(&target, &search, &job.context.progress)?;
    let step = Step {
        blend: !job.operation.params.unblended,
        ..retouch.step(&target, &found[0])
    };
    retouch.apply(&step, &job.context.progress)?;
    Ok(())
}

fn variants(params: &Params) -> Vec<Variant> {
    let mirrored = params.mirror.then_some(Variant {
        mirrored: true,
        ..Variant::default()
    });
    let turned = params.turns.iter().map(|degrees| Variant {
        turn_rad: degrees.to_radians(),
        ..Variant::default()
    });
    let scaled = params.scales.iter().map(|&scale| Variant {
        scale,
        ..Variant::default()
    });
    mirrored.into_iter().chain(turned).chain(scaled).collect()
}

/// The steps of a file.
fn read_steps(path: &Path, context: &Context) -> Result<RecordedSteps, JobError> {
    let wrong = |reason: String| JobError::Steps {
        path: path.to_path_buf(),
        reason,
    };
    let text =
        files::read_text_in(path, MAX_BYTES, context).map_err(|error| wrong(plain(&error)))?;
    serde_json::from_str(&text)
        .map_err(|error| wrong(format!("they are not in the form of steps: {error}")))
}

/// Steps that fit a picture of this size, without the last `undo`, with pixel centers at half-integers.
fn checked(
    mut found: RecordedSteps,
    path: &Path,
    size: Size,
    undo: usize,
) -> Result<Vec<Step>, JobError> {
    if (found.width, found.height) != (size.width(), size.height()) {
        return Err(JobError::Steps {
            path: path.to_path_buf(),
            reason: format!(
                "they were taken on a picture of {} x {} pixels, and this one has {size}",
                found.width, found.height
            ),
        });
    }
    found.steps.truncate(found.steps.len().saturating_sub(undo));
    for step in &mut found.steps {
        step.target.at = found.pixel_centers.read(step.target.at);
        step.source.at = found.pixel_centers.read(step.source.at);
    }
    Ok(found.steps)
}

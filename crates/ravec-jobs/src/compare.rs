//! `compare`: how far two pictures or clips of the same size are apart.

mod clips;

use crate::context::Context;
use crate::error::JobError;
use crate::files;
use crate::operation::Operation;
use crate::report::Report;
use crate::video::is_clip;
use clips::compare_clips;
use ravec::raster::{Comparison, LinearRgba, MetricError, compare_with_progress, with_image};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Compare two pictures or clips of the same size: PSNR, SSIM, color difference
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args), command(after_help = HELP))]
pub struct Compare {
    /// Reference: a picture, or a clip; `-` is a picture on standard input
    pub a: PathBuf,
    /// Picture or clip to compare with it; `-` is a picture on standard input
    pub b: PathBuf,
    /// Plot the PSNR of each frame of two clips as SVG
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE"))]
    #[serde(default)]
    pub plot: Option<PathBuf>,
    /// Parameters.
    #[cfg_attr(feature = "cli", command(flatten))]
    #[serde(default)]
    pub params: Params,
}

#[cfg(feature = "cli")]
const HELP: &str = "\
Examples:
  ravec compare photo.jpg noisy.jpg
  ravec compare photo.jpg noisy.jpg -q --json figures.json
  ravec compare clip.y4m blocks.y4m --plot psnr.svg

Figures: psnr_db (infinite, or null in JSON, for equal pictures), ssim (1 for equal pictures), delta_e_mean, delta_e_p95 and \
delta_e_max (CIEDE2000; 1 is just noticeable), max_difference_steps (of 255), max_alpha_difference, identical (0 or 1).

Two clips are compared frame by frame, in their order; the result lists the figures of each frame. Over all frames, psnr_db is that of the mean squared error, ssim and delta_e_mean are means, delta_e_p95 is the largest, min_psnr_db and min_ssim belong to the worst frame; frames and extra_frames (of the longer clip, which are not compared) are counted.";

/// Parameters of [`Compare`]; there are none yet.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct Params {}

impl Operation for Compare {
    const NAME: &'static str = "compare";

    fn inputs(&self) -> Vec<&Path> {
        vec![&self.a, &self.b]
    }

    fn outputs(&self) -> Vec<&Path> {
        self.plot.iter().map(PathBuf::as_path).collect()
    }

    /// Compares `b` with the reference `a`, as they are shown: alpha over a middle gray. Clips are compared frame by frame.
    ///
    /// Figures: `psnr_db`, the peak signal-to-noise ratio of the encoded colors, infinite for equal pictures; `ssim`, the mean
    /// structural similarity of luma, 1 for equal pictures; `delta_e_mean`, `delta_e_p95` and `delta_e_max`, CIEDE2000 color
    /// differences, of which 1 is just noticeable; `max_difference_steps`, the largest difference of a sample in 8-bit steps;
    /// `max_alpha_difference`, 0 to 1; `identical`, 1 if no pixel differs at all.
    ///
    /// # Errors
    /// [`JobError::Read`] for an input that is no picture, [`JobError::SizesDiffer`], [`JobError::InputTwice`] if both are
    /// standard input, [`JobError::Cancelled`].
    fn run(&self, context: &Context) -> Result<Report, JobError> {
        let Self { a, b, params, .. } = self;
        context.check_files(&self.inputs(), &self.outputs())?;
        if is_clip(a, context) || is_clip(b, context) {
            return compare_clips(self, context);
        }
        if self.plot.is_some() {
            return Err(JobError::Parameter {
                field: "plot",
                value: "given".to_owned(),
                range: "left out for pictures, which have no frames",
            });
        }
        let mut report = Report::of(self, params);
        // pictures keep their shares of the memory budget
        let picture_a = files::read(a, &mut report, context)?;
        let picture_b = files::read(b, &mut report, context)?;
        let (image_a, image_b) = (&picture_a.image, &picture_b.image);
        let differ = JobError::SizesDiffer {
            a: a.clone(),
            a_size: image_a.size(),
            b: b.clone(),
            b_size: image_b.size(),
        };
        if image_a.size() != image_b.size() {
            return Err(differ);
        }
        let image_b = image_b.convert::<LinearRgba>();
        let compared = report.time(
        "compare",
        || with_image!(image_a, image_a => compare_with_progress(image_a, &image_b, &context.progress)),
    );
        let found = compared.map_err(|error| match error {
            MetricError::Cancelled(_) => JobError::Cancelled,
            _ => differ,
        })?;
        record(&found, &mut report);
        Ok(report)
    }
}

fn record(found: &Comparison, report: &mut Report) {
    for (name, figure) in [
        ("psnr_db", found.psnr_db),
        ("ssim", found.ssim),
        ("delta_e_mean", found.delta_e_mean),
        ("delta_e_p95", found.delta_e_p95),
        ("delta_e_max", found.delta_e_max),
        ("max_difference_steps", 255.0 * found.max_abs),
        ("max_alpha_difference", found.alpha_max_abs),
        ("identical", f64::from(u8::from(found.identical))),
    ] {
        report.figures.insert(name, figure);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ravec::raster::{AnyImage, Image, Size, Srgb, Srgba};
    use ravec_media::{Picture, WriteOptions};

    fn compare(a: PathBuf, b: PathBuf) -> Result<Report, JobError> {
        let params = Params::default();
        Compare {
            a,
            b,
            plot: None,
            params,
        }
        .run(&Context::default())
    }

    fn compared(a: AnyImage, b: AnyImage) -> Report {
        let folder = tempfile::tempdir().unwrap();
        let source = |name: &str, image: AnyImage| {
            let path = folder.path().join(name);
            ravec_media::write(&path, &Picture::from_image(image), &WriteOptions::default())
                .unwrap();
            path
        };
        let (a, b) = (source("a.png", a), source("b.png", b));
        compare(a, b).unwrap()
    }

    #[test]
    fn one_step_in_every_sample_is_48_decibels() {
        let size = Size::new(7, 5).unwrap();
        let report = compared(
            Image::new(size, Srgb([100u8, 150, 200])).into(),
            Image::new(size, Srgb([101u8, 149, 201])).into(),
        );
        // 20 log10(255); samples are rounded to f32
        assert!((report.figures["psnr_db"] - 48.1308).abs() < 1e-3);
        assert!((report.figures["max_difference_steps"] - 1.0).abs() < 1e-4);
        assert!(report.figures["delta_e_mean"] > 0.1 && report.figures["delta_e_mean"] < 2.0);
        assert!(report.figures["ssim"] > 0.99);
    }

    #[test]
    fn what_transparent_pixels_hide_makes_no_difference() {
        let size = Size::new(2, 2).unwrap();
        let report = compared(
            Image::new(size, Srgba([255u8, 0, 0, 0])).into(),
            Image::new(size, Srgba([0u8, 255, 9, 0])).into(),
        );
        assert_eq!(report.figures["psnr_db"], f64::INFINITY);
        assert_eq!(report.figures["max_difference_steps"], 0.0);
        let report = compared(
            Image::new(size, Srgba([0u8, 0, 0, 0])).into(),
            Image::new(size, Srgba([0u8, 0, 0, 255])).into(),
        );
        assert_eq!(report.figures["max_alpha_difference"], 1.0);
        assert_eq!(report.figures["identical"], 0.0);
    }

    #[test]
    fn pictures_of_different_sizes_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let source = |name: &str, width| {
            let path = folder.path().join(name);
            let image = Image::new(Size::new(width, 3).unwrap(), Srgb([0u8; 3]));
            ravec_media::write(&path, &Picture::from_image(image), &WriteOptions::default())
                .unwrap();
            path
        };
        let (a, b) = (source("a.png", 3), source("b.png", 4));
        let error = compare(a.clone(), b).unwrap_err();
        assert!(matches!(error, JobError::SizesDiffer { .. }), "{error}");
        let missing = PathBuf::from("no such file");
        let error = compare(a, missing).unwrap_err();
        assert!(matches!(error, JobError::Read { .. }), "{error}");
    }
}

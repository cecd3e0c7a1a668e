//! `compare`: how far two pictures of the same size are apart.

use crate::error::JobError;
use crate::files::{self, Source};
use crate::report::Report;
use ravec::progress::Progress;
use ravec::raster::{LinearRgba, MetricError, compare_with_progress, with_image};
use serde::{Deserialize, Serialize};

/// How the pictures are compared: there is nothing to choose yet.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct Params {}

/// Compares `b` with the reference `a`, as they are shown: alpha over a middle gray.
///
/// Figures: `psnr_db`, the peak signal-to-noise ratio of the encoded colors, infinite for equal pictures; `ssim`, the mean
/// structural similarity of luma, 1 for equal pictures; `delta_e_mean`, `delta_e_p95` and `delta_e_max`, CIEDE2000 color
/// differences, of which 1 is just noticeable; `max_difference_steps`, the largest difference of a sample in 8-bit steps;
/// `max_alpha_difference`, 0 to 1; `identical`, 1 if no pixel differs at all.
///
/// # Errors
/// [`JobError::Read`] for an input that is no picture, [`JobError::SizesDiffer`], [`JobError::InputTwice`] if both are
/// standard input, [`JobError::Cancelled`].
pub fn run(
    a: &Source,
    b: &Source,
    params: &Params,
    progress: &Progress,
) -> Result<Report, JobError> {
    files::check_files(&[&a.path, &b.path], &[])?;
    let mut report = Report::new("compare", params);
    // pictures keep their shares of the memory budget
    let picture_a = files::read(a, &mut report, progress)?;
    let picture_b = files::read(b, &mut report, progress)?;
    let (image_a, image_b) = (&picture_a.image, &picture_b.image);
    let differ = JobError::SizesDiffer {
        a: a.path.clone(),
        a_size: image_a.size(),
        b: b.path.clone(),
        b_size: image_b.size(),
    };
    if image_a.size() != image_b.size() {
        return Err(differ);
    }
    let image_b = image_b.convert::<LinearRgba>();
    let compared = report.time(
        "compare",
        || with_image!(image_a, image_a => compare_with_progress(image_a, &image_b, progress)),
    );
    let found = compared.map_err(|error| match error {
        MetricError::Cancelled(_) => JobError::Cancelled,
        _ => differ,
    })?;
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
    Ok(report)
}

#[cfg(test)]
mod tests {
    use super::*;
    use ravec::raster::{AnyImage, Image, Size, Srgb, Srgba};
    use ravec_media::{Picture, WriteOptions};
    use std::path::Path;

    fn compared(a: AnyImage, b: AnyImage) -> Report {
        let folder = tempfile::tempdir().unwrap();
        let source = |name: &str, image: AnyImage| {
            let path = folder.path().join(name);
            ravec_media::write(&path, &Picture::from_image(image), &WriteOptions::default())
                .unwrap();
            Source::new(path)
        };
        let (a, b) = (source("a.png", a), source("b.png", b));
        run(&a, &b, &Params::default(), &Progress::none()).unwrap()
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
            Source::new(path)
        };
        let (a, b) = (source("a.png", 3), source("b.png", 4));
        let error = run(&a, &b, &Params::default(), &Progress::none()).unwrap_err();
        assert!(matches!(error, JobError::SizesDiffer { .. }), "{error}");
        let missing = Source::new(Path::new("no such file"));
        let error = run(&a, &missing, &Params::default(), &Progress::none()).unwrap_err();
        assert!(matches!(error, JobError::Read { .. }), "{error}");
    }
}

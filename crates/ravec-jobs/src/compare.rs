//! `compare`: how far two pictures of the same size are apart.

use crate::error::JobError;
use crate::files::{self, Source};
use crate::report::Report;
use ravec::progress::{Cancelled, Progress};
use ravec::raster::{AnyImage, Srgba};
use serde::{Deserialize, Serialize};

/// How the pictures are compared: there is nothing to choose yet.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct Params {}

/// Compares `b` with the reference `a`.
///
/// Figures: `psnr_db`, the peak signal-to-noise ratio of the encoded colors, infinite for equal pictures;
/// `max_difference_steps`, the largest difference of a sample in 8-bit steps. Colors count by their alpha, so what is
/// hidden in transparent pixels makes no difference, but alpha itself does.
///
/// # Errors
/// [`JobError::Read`] for an input that is no picture, [`JobError::SizesDiffer`], [`JobError::Cancelled`].
pub fn run(
    a: &Source,
    b: &Source,
    params: &Params,
    progress: &Progress,
) -> Result<Report, JobError> {
    let mut report = Report::new("compare", params);
    let image_a = files::read(a, &mut report, progress)?.image;
    let image_b = files::read(b, &mut report, progress)?.image;
    if image_a.size() != image_b.size() {
        return Err(JobError::SizesDiffer {
            a: a.path.clone(),
            a_size: image_a.size(),
            b: b.path.clone(),
            b_size: image_b.size(),
        });
    }
    let difference = report.time("compare", || difference(&image_a, &image_b, progress))?;
    report.figures.insert("psnr_db", difference.psnr_db());
    report
        .figures
        .insert("max_difference_steps", 255.0 * difference.largest);
    Ok(report)
}

/// Sums over all samples, on a scale of 0 to 1.
struct Difference {
    mean_square: f64,
    largest: f64,
}

impl Difference {
    fn psnr_db(&self) -> f64 {
        -10.0 * self.mean_square.log10()
    }
}

fn difference(a: &AnyImage, b: &AnyImage, progress: &Progress) -> Result<Difference, Cancelled> {
    let channels = if a.has_alpha() || b.has_alpha() { 4 } else { 3 };
    let (a, b) = (a.convert::<Srgba<f32>>(), b.convert::<Srgba<f32>>());
    let phase = progress.phase("compare", a.height() as u64);
    let (mut squares, mut largest) = (0.0, 0.0f64);
    for (row_a, row_b) in a.rows().zip(b.rows()) {
        progress.check()?;
        for (a, b) in row_a.iter().zip(row_b) {
            let (a, b) = (weighted(*a), weighted(*b));
            for channel in 0..channels {
                let difference = (a[channel] - b[channel]).abs();
                squares += difference * difference;
                largest = largest.max(difference);
            }
        }
        phase.advance(1);
    }
    Ok(Difference {
        mean_square: squares / (channels * a.size().pixels()) as f64,
        largest,
    })
}

/// Encoded colors times alpha, and alpha.
fn weighted(Srgba([r, g, b, alpha]): Srgba<f32>) -> [f64; 4] {
    [r * alpha, g * alpha, b * alpha, alpha].map(f64::from)
}

#[cfg(test)]
mod tests {
    use super::*;
    use ravec::raster::{Image, Size, Srgb};
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
        assert_eq!(report.figures["max_difference_steps"], 255.0);
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

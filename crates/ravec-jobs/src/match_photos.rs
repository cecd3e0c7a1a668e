//! `match`: the homography between two photos of a plane.

use crate::context::Context;
use crate::error::JobError;
use crate::files;
use crate::operation::Operation;
use crate::pixel_centers::PixelCenters;
use crate::report::Report;
use ravec::planar::{
    FeatureParams, MatchError, MatchParams, RobustParams, encoded_luminance, match_photos,
};
use ravec::raster::with_image;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Match two photos of a plane: find the homography from one to the other
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args), command(after_help = HELP))]
pub struct Match {
    /// Source photo; `-` is standard input
    pub first: PathBuf,
    /// Target photo; `-` is standard input
    pub second: PathBuf,
    /// Output text file: the nine entries of the matrix, row by row; `-` is standard output
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
  ravec match poster.jpg street.jpg -o h.txt
  ravec match poster.jpg street.jpg -o - -q

The nine numbers h, row by row, lead from a point (x, y) of the first photo to (h1 x + h2 y + h3, h4 x + h5 y + h6) / (h7 x + h8 y + \
h9) in the second. Points are in pixels, x right, y down; the center of the first pixel is (0.5, 0.5), or (0, 0) with \
--pixel-centers integer.

Figures: matches, inliers, patches, sigma_px, tilted (0 or 1).";

/// Parameters of [`Match`].
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct Params {
    /// Number of features in each photo, 50 to 20000; more find more in large photos and cost time
    #[cfg_attr(feature = "cli", arg(long, value_name = "COUNT", default_value_t = Self::default().features))]
    pub features: usize,
    /// The photos are not rotated against each other, which finds a few more matches
    #[cfg_attr(feature = "cli", arg(long))]
    pub upright: bool,
    /// Seed of the random samples of matches
    #[cfg_attr(feature = "cli", arg(long, value_name = "NUMBER", default_value_t = Self::default().seed))]
    pub seed: u64,
    /// Center of the first pixel in points that are given or printed: half is (0.5, 0.5), integer is (0, 0)
    #[cfg_attr(feature = "cli", arg(long, value_enum, value_name = "CENTERS", default_value_t = PixelCenters::Half))]
    pub pixel_centers: PixelCenters,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            features: FeatureParams::default().max_features,
            upright: false,
            seed: 0,
            pixel_centers: PixelCenters::default(),
        }
    }
}

impl Operation for Match {
    const NAME: &'static str = "match";

    fn inputs(&self) -> Vec<&Path> {
        vec![&self.first, &self.second]
    }

    fn outputs(&self) -> Vec<&Path> {
        vec![&self.output]
    }

    /// Finds the homography that leads from points of the first photo to those of the second, and writes its nine numbers as
    /// text, row by row, for points in pixels, x right, y down, with pixel centers as `pixel_centers` says.
    ///
    /// Figures: `matches`, features that look alike; `inliers`, those that agree; `patches`, places that were aligned to a
    /// fraction of a pixel; `sigma_px`, the standard deviation of a coordinate of such a place; `tilted`, 1 if the photos had to
    /// be tried as seen from other sides.
    ///
    /// # Errors
    /// [`JobError::Parameter`], [`JobError::Read`], [`JobError::NoMatch`], [`JobError::Write`], [`JobError::Cancelled`].
    fn run(&self, context: &Context) -> Result<Report, JobError> {
        let Self {
            first,
            second,
            output,
            params,
        } = self;
        if !(50..=20_000).contains(&params.features) {
            return Err(JobError::Parameter {
                field: "features",
                value: params.features.to_string(),
                range: "50 to 20000",
            });
        }
        context.check_files(&self.inputs(), &self.outputs())?;
        let mut report = Report::of(self, params);
        report.seed = Some(params.seed);
        // pictures keep their shares of the memory budget
        let first_picture = files::read(first, &mut report, context)?;
        let second_picture = files::read(second, &mut report, context)?;
        let options = MatchParams {
            features: FeatureParams {
                max_features: params.features,
                upright: params.upright,
                ..FeatureParams::default()
            },
            robust: RobustParams {
                seed: params.seed,
                ..RobustParams::default()
            },
            ..MatchParams::default()
        };
        let found = report.time("match", || {
            let first = with_image!(&first_picture.image, image => encoded_luminance(image));
            let second = with_image!(&second_picture.image, image => encoded_luminance(image));
            match_photos(&first, &second, &options, &context.progress)
        });
        let found = found.map_err(|cause| match cause {
            MatchError::Cancelled => JobError::Cancelled,
            cause => JobError::NoMatch {
                first: first.clone(),
                second: second.clone(),
                cause,
            },
        })?;
        let rows = params
            .pixel_centers
            .write_map(&found.second_from_first)
            .to_rows();
        let lines: Vec<String> = rows
            .chunks_exact(3)
            .map(|row| format!("{} {} {}\n", row[0], row[1], row[2]))
            .collect();
        files::write_output_text(output, "text", &lines.concat(), &mut report, context)?;
        for (name, figure) in [
            ("matches", found.matches as f64),
            ("inliers", found.inliers as f64),
            ("patches", found.patches as f64),
            ("sigma_px", found.sigma_px),
            ("tilted", f64::from(u8::from(found.tilted))),
        ] {
            report.figures.insert(name, figure);
        }
        Ok(report)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ravec::raster::{AnyImage, Image, Size, Srgb};
    use ravec_media::{Picture, WriteOptions};
    use ravec_scenes::{Seed, texture::fractal};

    fn photo(folder: &Path, name: &str, shift: f64, scale: f64) -> PathBuf {
        let size = Size::new(240, 200).unwrap();
        let image: Image<Srgb<u8>> = Image::from_fn(size, |col, row| {
            let at = glam::dvec2(col as f64 + shift, row as f64) / 40.0;
            Srgb([(128.0 + scale * fractal(at, 0.02, 5, Seed(1))) as u8; 3])
        });
        let path = folder.join(name);
        let picture = Picture::from_image(AnyImage::from(image));
        ravec_media::write(&path, &picture, &WriteOptions::default()).unwrap();
        path
    }

    fn run(
        first: &Path,
        second: &Path,
        output: &Path,
        params: &Params,
    ) -> Result<Report, JobError> {
        let operation = Match {
            first: first.to_path_buf(),
            second: second.to_path_buf(),
            output: output.to_path_buf(),
            params: params.clone(),
        };
        operation.run(&Context::default())
    }

    #[test]
    fn nine_numbers_lead_from_the_first_photo_to_the_second() {
        let folder = tempfile::tempdir().unwrap();
        let (first, second) = (
            photo(folder.path(), "a.png", 0.0, 90.0),
            photo(folder.path(), "b.png", 30.0, 60.0),
        );
        let output = folder.path().join("h.txt");
        let report = run(&first, &second, &output, &Params::default()).unwrap();
        assert!(report.figures["inliers"] >= 20.0 && report.figures["tilted"] == 0.0);
        let text = std::fs::read_to_string(&output).unwrap();
        let numbers: Vec<f64> = text
            .split_whitespace()
            .map(|word| word.parse().unwrap())
            .collect();
        let truth = [1.0, 0.0, -30.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
        assert_eq!((numbers.len(), text.lines().count()), (9, 3));
        for (found, truth) in numbers.iter().zip(truth) {
            // a tenth of a pixel for the shift, much less for the rest
            assert!((found - truth).abs() < 0.1, "{numbers:?}");
        }
    }

    #[test]
    fn photos_of_nothing_do_not_match() {
        let folder = tempfile::tempdir().unwrap();
        let flat = photo(folder.path(), "a.png", 0.0, 0.0);
        let output = folder.path().join("h.txt");
        let error = run(&flat, &flat, &output, &Params::default()).unwrap_err();
        assert!(
            matches!(error, JobError::NoMatch { .. }) && error.kind() == crate::ErrorKind::Failure,
            "{error}"
        );
        assert!(!output.exists());
        let params = Params {
            features: 1,
            ..Params::default()
        };
        let error = run(&flat, &flat, &output, &params).unwrap_err();
        assert!(matches!(error, JobError::Parameter { .. }));
    }
}

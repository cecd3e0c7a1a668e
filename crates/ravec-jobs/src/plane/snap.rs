//! `snap`: a rough grid on a plane, moved onto the edges below it.

use crate::context::Context;
use crate::error::JobError;
use crate::files;
use crate::operation::Operation;
use crate::pixel_centers::PixelCenters;
use crate::plane::overlay::{AFTER, BEFORE, draw_grid, line_width};
use crate::plane::{Grid, Quad, check_paths, write_result};
use crate::report::Report;
use ravec::planar::{QuadGrid, SnapError, SnapParams, encoded_luminance, snap, snap_counting};
use ravec::raster::{Pyramid, Reduction, with_image};
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::path::{Path, PathBuf};

/// Snap a rough grid to the edges below it, and print its corners as JSON
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args), command(after_help = HELP))]
pub struct Snap {
    /// Input picture; `-` is standard input
    pub input: PathBuf,
    /// Output picture of the grid before (orange) and after (green), or the result if the name ends in .json
    #[cfg_attr(feature = "cli", arg(short, long, value_name = "FILE"))]
    #[serde(default)]
    pub output: Option<PathBuf>,
    /// Parameters.
    #[cfg_attr(feature = "cli", command(flatten))]
    pub params: Params,
}

#[cfg(feature = "cli")]
const HELP: &str = "\
Examples:
  ravec snap photo.jpg --quad 36,26,130,7,136,97,52,85 --grid 4x3
  ravec snap photo.jpg --quad 36,26,130,7,136,97,52,85 --grid 4x3 -o grid.png

The corners of the grid are given in turn, from the upper left one clockwise, in pixels, x right, y down; the center of the first pixel \
is (0.5, 0.5), or (0, 0) with --pixel-centers integer. They should be within a few percent of the grid's diagonal of where they belong (--reach). Lines come to lie on \
edges, or in the middle of joints.

Standard output gets one object in JSON: quad (four corners [x, y]), columns, rows, support (the share of the lines that lies on an edge, \
0 to 1), moved_px (of each corner). With --json, it is result in the report.

Figures: support, moved_most_px.";

/// Parameters of [`Snap`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct Params {
    /// The rough corners of the grid, in turn from the upper left one, in pixels, x right, y down
    #[cfg_attr(
        feature = "cli",
        arg(long, value_name = "X,Y,X,Y,X,Y,X,Y", allow_hyphen_values = true)
    )]
    pub quad: Quad,
    /// Columns and rows, as in 4x6 [default: searched for, up to 12 each]
    #[cfg_attr(feature = "cli", arg(long, value_name = "COLSxROWS"))]
    #[serde(default)]
    pub grid: Option<Grid>,
    /// Maximum error of a rough corner, in percent of the grid's diagonal, 0 to 20; a larger one may find other edges
    #[cfg_attr(feature = "cli", arg(long, value_name = "PERCENT", default_value_t = Self::REACH))]
    #[serde(default = "Params::default_reach")]
    pub reach: f64,
    /// Center of the first pixel in points that are given or printed: half is (0.5, 0.5), integer is (0, 0)
    #[cfg_attr(feature = "cli", arg(long, value_enum, value_name = "CENTERS", default_value_t = PixelCenters::Half))]
    #[serde(default)]
    pub pixel_centers: PixelCenters,
}

/// Columns and rows that are searched for at most: finer grids find edges everywhere.
const MAX_COUNT: u32 = 12;

impl Params {
    const REACH: f64 = 4.0;

    fn default_reach() -> f64 {
        Self::REACH
    }

    /// The defaults for a quadrilateral.
    pub fn new(quad: Quad) -> Self {
        Self {
            quad,
            grid: None,
            reach: Self::REACH,
            pixel_centers: PixelCenters::default(),
        }
    }
}

impl Operation for Snap {
    const NAME: &'static str = "snap";

    const PRINTS_RESULT: bool = true;

    fn inputs(&self) -> Vec<&Path> {
        vec![&self.input]
    }

    fn outputs(&self) -> Vec<&Path> {
        self.output.as_deref().into_iter().collect()
    }

    /// Moves the corners of a grid so that its lines fall on edges, and says where they are. The picture that may be written shows
    /// the grid before in orange and after in green.
    ///
    /// The report's `result` has `quad` (four corners [x, y]), `columns`, `rows`, `support` (the share of the lines' length that
    /// lies on an edge, 0 to 1) and `moved_px` (how far each corner moved). Figures: `support`, `moved_most_px`.
    ///
    /// # Errors
    /// [`JobError::Parameter`], [`JobError::Quad`], [`JobError::Outside`], [`JobError::NoSnap`], [`JobError::Read`],
    /// [`JobError::Write`], [`JobError::Cancelled`].
    fn run(&self, context: &Context) -> Result<Report, JobError> {
        let Self {
            input,
            output,
            params,
        } = self;
        let progress = &context.progress;
        let output = output.as_deref();
        if !(0.0..=20.0).contains(&params.reach) {
            return Err(JobError::Parameter {
                field: "reach",
                value: params.reach.to_string(),
                range: "0 to 20",
            });
        }
        check_paths(input, output, context)?;
        let mut report = Report::of(self, params);
        let picture = files::read(input, &mut report, context)?;
        let centers = params.pixel_centers;
        let quad = params.quad.check(centers, picture.image.size())?;
        let grid = params.grid.unwrap_or(Grid {
            columns: 1,
            rows: 1,
        });
        let rough = QuadGrid::new(quad, grid.columns, grid.rows)
            .map_err(|cause| JobError::Quad { cause })?;
        let options = SnapParams {
            reach_rel: params.reach / 100.0,
        };
        let found = report.time("snap", || {
            let plane = with_image!(&picture.image, image => encoded_luminance(image));
            let levels = Pyramid::new(plane, Reduction::Area);
            if params.grid.is_some() {
                snap(&levels, &rough, &options, progress)
            } else {
                let counts = 1..=MAX_COUNT;
                snap_counting(&levels, &rough, counts.clone(), counts, &options, progress)
            }
        });
        let found = found.map_err(|cause| match cause {
            SnapError::Cancelled => JobError::Cancelled,
            cause => JobError::NoSnap {
                path: input.clone(),
                cause,
            },
        })?;
        let corners = found.grid.corners();
        let moved: Vec<f64> = (0..4).map(|k| corners[k].distance(quad[k])).collect();
        report.figures.insert("support", found.support);
        report.figures.insert(
            "moved_most_px",
            moved.iter().fold(0.0, |a: f64, &b| a.max(b)),
        );
        report.result = Some(json!({
            "quad": centers.write_all(corners).map(|corner| corner.to_array()),
            "pixel_centers": centers,
            "columns": found.grid.columns(),
            "rows": found.grid.rows(),
            "support": found.support,
            "moved_px": moved,
        }));
        if let Some(output) = output {
            let draw = |image: &mut _| {
                let width = line_width(picture.image.size());
                let before = rough
                    .divided(found.grid.columns(), found.grid.rows())
                    .map_err(|cause| JobError::Quad { cause })?;
                draw_grid(image, &before, 0.6 * width, BEFORE);
                draw_grid(image, &found.grid, width, AFTER);
                Ok(())
            };
            write_result(output, &picture, draw, &mut report, context)?;
        }
        Ok(report)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ErrorKind;
    use ravec::raster::{AnyImage, Image, Size, Srgb};
    use ravec_media::{Picture, WriteOptions};

    fn run(input: &Path, output: Option<&Path>, params: &Params) -> Result<Report, JobError> {
        let operation = Snap {
            input: input.to_path_buf(),
            output: output.map(Path::to_path_buf),
            params: params.clone(),
        };
        operation.run(&Context::default())
    }

    /// Fields of 20 × 20 pixels, 5 × 4 of them from (30, 30) on.
    fn photo(folder: &Path) -> PathBuf {
        let image: Image<Srgb<u8>> = Image::from_fn(Size::new(160, 140).unwrap(), |col, row| {
            let inside = (30..130).contains(&col) && (30..110).contains(&row);
            let light = ((col + 70) / 20 + (row + 70) / 20) % 2 == 0;
            Srgb([if inside && light { 210 } else { 90 }; 3])
        });
        let path = folder.join("photo.png");
        let picture = Picture::from_image(AnyImage::from(image));
        ravec_media::write(&path, &picture, &WriteOptions::default()).unwrap();
        path
    }

    #[test]
    fn the_refined_quadrilateral_is_the_result_and_a_drawing_shows_it() {
        let folder = tempfile::tempdir().unwrap();
        let photo = photo(folder.path());
        let output = folder.path().join("drawn.png");
        let params = Params {
            grid: "5x4".parse().ok(),
            ..Params::new("27,32,133,28,131,113,28,107".parse().unwrap())
        };
        let report = run(&photo, Some(&output), &params).unwrap();
        let result = report.result.unwrap();
        let truth = [[30.0, 30.0], [130.0, 30.0], [130.0, 110.0], [30.0, 110.0]];
        for (corner, truth) in result["quad"].as_array().unwrap().iter().zip(truth) {
            for k in 0..2 {
                assert!(
                    (corner[k].as_f64().unwrap() - truth[k]).abs() < 0.2,
                    "{result}"
                );
            }
        }
        // half of the border has the same gray on both sides
        assert!(report.figures["support"] > 0.6);
        let drawn = ravec_media::read(&output, &ravec_media::Limits::default()).unwrap();
        let AnyImage::Srgb8(drawn) = drawn.image else {
            panic!("a drawing on an opaque picture is opaque");
        };
        let Srgb([r, g, _]) = drawn[(70, 40)];
        // a line of a pixel and a fifth covers three fifths of this pixel
        assert!(g > r + 60, "a green line between two columns: {r} {g}");
    }

    #[test]
    fn columns_and_rows_are_found_if_not_given() {
        let folder = tempfile::tempdir().unwrap();
        let photo = photo(folder.path());
        let params = Params::new("27,32,133,28,131,113,28,107".parse().unwrap());
        let report = run(&photo, None, &params).unwrap();
        let result = report.result.unwrap();
        assert_eq!(
            (&result["columns"], &result["rows"]),
            (&5.into(), &4.into())
        );
        assert!(report.outputs.is_empty());
    }

    #[test]
    fn an_even_picture_and_a_wild_reach_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("even.png");
        let even = Image::new(Size::new(160, 140).unwrap(), Srgb([90u8; 3]));
        let picture = Picture::from_image(AnyImage::from(even));
        ravec_media::write(&path, &picture, &WriteOptions::default()).unwrap();
        let params = Params::new("27,32,133,28,131,113,28,107".parse().unwrap());
        let error = run(&path.clone(), None, &params).unwrap_err();
        assert!(
            matches!(error, JobError::NoSnap { .. }) && error.kind() == ErrorKind::Failure,
            "{error}"
        );
        let wild = Params {
            reach: f64::NAN,
            ..params
        };
        let error = run(&path.clone(), None, &wild).unwrap_err();
        assert!(matches!(error, JobError::Parameter { .. }), "{error}");
    }
}

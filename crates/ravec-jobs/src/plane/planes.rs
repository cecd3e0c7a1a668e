//! `planes`: quadrilaterals that may be rectangles on planes, from the edges of a picture.

use crate::context::Context;
use crate::error::JobError;
use crate::files;
use crate::operation::Operation;
use crate::pixel_centers::PixelCenters;
use crate::plane::overlay::{Color, draw_line, line_width};
use crate::plane::{Focal, check_paths, write_result};
use crate::report::Report;
use glam::dvec2;
use ravec::planar::{Proposals, Segment, propose_planes};
use ravec::raster::{Image, LinearRgba, PremulLinearRgba};
use ravec::twocolor::line_segments;
use ravec_media::focal_px_from_35mm;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Propose planes from the edges of a picture, and print them as JSON
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args), command(after_help = HELP))]
pub struct Planes {
    /// Input picture; `-` is standard input
    pub input: PathBuf,
    /// Output picture of the planes and the edges that support them, or the planes if the name ends in .json
    #[cfg_attr(feature = "cli", arg(short, long, value_name = "FILE"))]
    #[serde(default)]
    pub output: Option<PathBuf>,
    /// Parameters.
    #[cfg_attr(feature = "cli", command(flatten))]
    #[serde(default)]
    pub params: Params,
}

#[cfg(feature = "cli")]
const HELP: &str = "\
Examples:
  ravec planes photo.jpg
  ravec planes photo.jpg -o planes.png --focal 28mm
  ravec planes photo.jpg --most 1 -o planes.json

Proposals are there to be chosen from: give the corners of one to ravec snap or ravec rectify.

Standard output gets one object in JSON: planes, the best first, each with quad (four corners [x, y] in pixels, clockwise from the upper \
left one), vanishing (the numbers of the points where its sides meet), support_px (the length of the edges along its sides) and \
right_angles (true, false, or null without a focal length); vanishing_points, each with at (homogeneous coordinates x, y, w) and \
length_px; focal_px, given or found, or null. With --json, it is result in the report.

Figures: planes, segments, vanishing_points, focal_px.";

/// Parameters of [`Planes`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct Params {
    /// The focal length, in pixels (1200px) or on 35 mm film (28mm) [default: the one in the EXIF data]; only what is at right
    /// angles is proposed then
    #[cfg_attr(feature = "cli", arg(long, value_name = "LENGTH"))]
    pub focal: Option<Focal>,
    /// Maximum number of planes, 1 to 12
    #[cfg_attr(feature = "cli", arg(long, value_name = "COUNT", default_value_t = Self::default().most))]
    pub most: usize,
    /// Center of the first pixel in points that are given or printed: half is (0.5, 0.5), integer is (0, 0)
    #[cfg_attr(feature = "cli", arg(long, value_enum, value_name = "CENTERS", default_value_t = PixelCenters::Half))]
    pub pixel_centers: PixelCenters,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            focal: None,
            most: 6,
            pixel_centers: PixelCenters::default(),
        }
    }
}

impl Operation for Planes {
    const NAME: &'static str = "planes";

    const PRINTS_RESULT: bool = true;

    fn inputs(&self) -> Vec<&Path> {
        vec![&self.input]
    }

    fn outputs(&self) -> Vec<&Path> {
        self.output.as_deref().into_iter().collect()
    }

    /// Proposes planes, the best first. An `output` that ends in `.json` gets the result; any other is a picture that shows the
    /// planes in strong colors, with the edges that led to them: those that meet in one point in one color.
    ///
    /// The report's `result` has `planes` (each with `quad`, four corners [x, y] clockwise from the upper left one, `vanishing`,
    /// the numbers of its two vanishing points, `support_px` and `right_angles`), `vanishing_points` (each with `at`, three
    /// homogeneous coordinates, and `length_px`) and `focal_px` (null if nothing is known). Figures: `planes`, `segments`,
    /// `vanishing_points`, `focal_px`.
    ///
    /// # Errors
    /// [`JobError::Parameter`], [`JobError::Read`], [`JobError::Write`], [`JobError::Cancelled`].
    fn run(&self, context: &Context) -> Result<Report, JobError> {
        let Self {
            input,
            output,
            params,
        } = self;
        let progress = &context.progress;
        let output = output.as_deref();
        if !(1..=12).contains(&params.most) {
            return Err(JobError::Parameter {
                field: "most",
                value: params.most.to_string(),
                range: "1 to 12",
            });
        }
        check_paths(input, output, context)?;
        let mut report = Report::of(self, params);
        let picture = files::read(input, &mut report, context)?;
        let size = picture.image.size();
        let exif = || {
            let film = picture.origin.focal_35mm()?;
            Some(focal_px_from_35mm(film, size.width(), size.height()))
        };
        let focal = params
            .focal
            .map(|focal| focal.in_pixels(size))
            .or_else(exif);
        let image: Image<PremulLinearRgba> = picture.convert();
        let edges = report.time("edges", || line_segments(&image, progress))?;
        let extent = dvec2(size.width() as f64, size.height() as f64);
        let mut found =
            report.time("planes", || propose_planes(&edges, extent, focal, progress))?;
        found.planes.truncate(params.most);
        for (name, count) in [
            ("planes", found.planes.len()),
            ("segments", edges.len()),
            ("vanishing_points", found.vanishing_points.len()),
        ] {
            report.figures.insert(name, count as f64);
        }
        if let Some(focal) = found.focal_px {
            report.figures.insert("focal_px", focal);
        }
        report.result = Some(described(&found, params.pixel_centers));
        if let Some(output) = output {
            let draw = |image: &mut _| {
                draw(image, &edges, &found);
                Ok(())
            };
            write_result(output, &picture, draw, &mut report, context)?;
        }
        Ok(report)
    }
}

fn described(found: &Proposals, centers: PixelCenters) -> Value {
    let planes: Vec<_> = found
        .planes
        .iter()
        .map(|plane| {
            json!({
                "quad": centers.write_all(plane.quad).map(|corner| corner.to_array()),
                "vanishing": plane.vanishing,
                "support_px": plane.support_px,
                "right_angles": plane.right_angles,
            })
        })
        .collect();
    let points: Vec<_> = found
        .vanishing_points
        .iter()
        .map(|point| {
            let at = centers.write_homogeneous(point.at).to_array();
            json!({ "at": at, "length_px": point.length_px })
        })
        .collect();
    json!({
        "planes": planes,
        "vanishing_points": points,
        "focal_px": found.focal_px,
        "pixel_centers": centers,
    })
}

/// Edges by the point that they aim at.
const POINT_COLORS: [Color; 6] = [
    [1.0, 0.1, 0.1],
    [0.1, 0.25, 1.0],
    [0.05, 0.6, 0.1],
    [0.9, 0.6, 0.0],
    [0.6, 0.1, 0.8],
    [0.0, 0.65, 0.7],
];

/// Planes, the best first; later ones repeat the last.
const PLANE_COLORS: [Color; 6] = [
    [0.0, 1.0, 0.2],
    [1.0, 0.75, 0.0],
    [0.0, 0.8, 1.0],
    [1.0, 0.2, 0.7],
    [0.7, 1.0, 0.0],
    [0.9, 0.9, 0.9],
];

/// Draws the edges of each vanishing point as thin lines in a color of its own, and each plane as a grid of three by three.
///
/// `edges` are the segments from which `found` was proposed.
///
/// # Panics
/// If `found` names a segment that `edges` lacks.
pub fn draw(image: &mut Image<LinearRgba>, edges: &[Segment], found: &Proposals) {
    let width = line_width(image.size());
    for (point, color) in found.vanishing_points.iter().zip(POINT_COLORS) {
        for &edge in &point.segments {
            draw_line(image, edges[edge].ends, 0.6 * width, color);
        }
    }
    for (index, plane) in found.planes.iter().enumerate().rev() {
        let color = PLANE_COLORS[index.min(PLANE_COLORS.len() - 1)];
        if let Ok(grid) = ravec::planar::QuadGrid::new(plane.quad, 3, 3) {
            super::overlay::draw_grid(image, &grid, width, color);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec2;
    use ravec::raster::{AnyImage, Size, Srgb};
    use ravec_media::{Picture, WriteOptions};
    use ravec_scenes::Seed;
    use ravec_scenes::building::building;
    use ravec_scenes::damage::add_gaussian_noise;

    fn run(input: &Path, output: Option<&Path>, params: &Params) -> Result<Report, JobError> {
        let operation = Planes {
            input: input.to_path_buf(),
            output: output.map(Path::to_path_buf),
            params: params.clone(),
        };
        operation.run(&Context::default())
    }

    #[test]
    fn both_walls_of_a_building_are_proposed_and_its_focal_length_is_found() {
        let folder = tempfile::tempdir().unwrap();
        let size = Size::new(960, 720).unwrap();
        let (image, truth) = building(size, 0.9, Seed(3));
        let image = add_gaussian_noise(&image.convert::<Srgb<u8>>(), 4.0, Seed(1));
        let path = folder.path().join("building.png");
        let picture = Picture::from_image(AnyImage::from(image));
        ravec_media::write(&path, &picture, &WriteOptions::default()).unwrap();
        let drawn = folder.path().join("drawn.png");
        let source = path.clone();
        let report = run(&source, Some(&drawn), &Params::default()).unwrap();
        assert!(
            (report.figures["focal_px"] / truth.focal_px - 1.0).abs() < 0.05,
            "{:?}",
            report.figures
        );
        let result = report.result.unwrap();
        let quads: Vec<[DVec2; 4]> = result["planes"]
            .as_array()
            .unwrap()
            .iter()
            .map(|plane| serde_json::from_value(plane["quad"].clone()).unwrap())
            .collect();
        for wall in truth.walls_in_image {
            // a quadrilateral with the middle of the wall in it
            let middle = wall.iter().sum::<DVec2>() / 4.0;
            let found = quads.iter().any(|quad| {
                (0..4).all(|k| (quad[(k + 1) % 4] - quad[k]).perp_dot(middle - quad[k]) > 0.0)
            });
            assert!(found, "{wall:?} {quads:?}");
        }
        assert!(drawn.exists());
        let listed = folder.path().join("planes.JSON");
        let report = run(&source, Some(&listed), &Params::default()).unwrap();
        let text = std::fs::read_to_string(&listed).unwrap();
        assert_eq!(serde_json::from_str::<Value>(&text).unwrap(), result);
        assert_eq!(report.outputs[0].format, "JSON");
    }

    #[test]
    fn an_even_picture_has_no_planes_and_a_wrong_count_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("even.png");
        let even = Image::new(Size::new(90, 70).unwrap(), Srgb([90u8; 3]));
        let picture = Picture::from_image(AnyImage::from(even));
        ravec_media::write(&path, &picture, &WriteOptions::default()).unwrap();
        let source = path.clone();
        let report = run(&source, None, &Params::default()).unwrap();
        assert_eq!(report.figures["planes"], 0.0);
        assert_eq!(report.result.unwrap()["focal_px"], Value::Null);
        let params = Params {
            most: 0,
            ..Params::default()
        };
        let error = run(&source, None, &params).unwrap_err();
        assert!(matches!(error, JobError::Parameter { .. }), "{error}");
    }
}

//! `rectify`: a plane of a picture, seen from straight on.

use crate::context::Context;
use crate::error::JobError;
use crate::files;
use crate::operation::Operation;
use crate::pixel_centers::PixelCenters;
use crate::plane::{Focal, Quad, Ratio, check_paths};
use crate::report::Report;
use glam::{DVec2, dvec2};
use ravec::planar::{Beyond, Known, Straight, proportions, straight_view};
use ravec::raster::{Color as _, Image, LinearRgba, PremulLinearRgba, Size};
use ravec_media::{Picture, WriteOptions, focal_px_from_35mm};
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// Rectify a plane of a picture: show it from the front, with its true proportions
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args), command(after_help = HELP))]
pub struct Rectify {
    /// Input picture; `-` is standard input
    pub input: PathBuf,
    /// Output picture; its extension selects the format, `-` is standard output in the input's format
    #[cfg_attr(feature = "cli", arg(short, long, value_name = "FILE"))]
    pub output: PathBuf,
    /// Parameters.
    #[cfg_attr(feature = "cli", command(flatten))]
    pub params: Params,
}

#[cfg(feature = "cli")]
const HELP: &str = "\
Examples:
  ravec rectify photo.jpg -o front.png --quad 36,26,130,7,136,97,52,85 --aspect 4:3
  ravec rectify photo.jpg -o front.png --quad 36,26,130,7,136,97,52,85 --focal 28mm --whole
  ravec rectify photo.jpg -o front.png --quad 36,26,130,7,136,97,52,85 --aspect 4:3 --json f.json

The corners of a rectangle on the plane are given in turn, from the upper left one clockwise, in pixels, x right, y down; the center of \
the first pixel is (0.5, 0.5), or (0, 0) with --pixel-centers integer. Its proportions are those of --aspect; else they follow from the focal length, given or in the \
EXIF data; else from its right angles, if neither pair of sides is parallel in the picture. For both, the picture should not \
have been cropped.

Figures: aspect (width by height), aspect_sigma_percent (its standard deviation if each corner is a pixel off), angle_deg (between the \
sides, 90 for a rectangle), focal_px. In JSON, result has these, aspect_from (hand, focal, exif or right-angles), quad, size, and \
image_from_straight and straight_from_image, nine numbers each, row by row.";

/// Parameters of [`Rectify`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct Params {
    /// The corners of a rectangle on the plane, in turn from the upper left one, in pixels, x right, y down
    #[cfg_attr(
        feature = "cli",
        arg(long, value_name = "X,Y,X,Y,X,Y,X,Y", allow_hyphen_values = true)
    )]
    pub quad: Quad,
    /// The rectangle's width by its height, as in 3:2 or 1.5, if it is known
    #[cfg_attr(feature = "cli", arg(long, value_name = "W:H"))]
    #[serde(default)]
    pub aspect: Option<Ratio>,
    /// The focal length, in pixels (1200px) or on 35 mm film (28mm) [default: the one in the EXIF data]
    #[cfg_attr(
        feature = "cli",
        arg(long, value_name = "LENGTH", conflicts_with = "aspect")
    )]
    #[serde(default)]
    pub focal: Option<Focal>,
    /// The width of the rectangle in the result in pixels, 1 to 65535 [default: as many pixels as it has in the picture]
    #[cfg_attr(feature = "cli", arg(long, value_name = "PX"))]
    #[serde(default)]
    pub width: Option<u32>,
    /// The height of the rectangle in the result in pixels, 1 to 65535
    #[cfg_attr(
        feature = "cli",
        arg(long, value_name = "PX", conflicts_with = "width")
    )]
    #[serde(default)]
    pub height: Option<u32>,
    /// Margin of the plane around the rectangle, as a multiple of its sides, 0 to 100, limited to the picture
    #[cfg_attr(
        feature = "cli",
        arg(
            long,
            value_name = "SIDES",
            default_value_t = 0.0,
            conflicts_with = "whole"
        )
    )]
    #[serde(default)]
    pub margin: f64,
    /// Show all of the plane that is in the picture, up to three times the rectangle's sides around it
    #[cfg_attr(feature = "cli", arg(long))]
    #[serde(default)]
    pub whole: bool,
    /// Content beyond the picture: transparent, extended (its border pixels go on), or a color as #rrggbb
    #[cfg_attr(
        feature = "cli",
        arg(long, value_name = "WHAT", default_value = "transparent")
    )]
    #[serde(default)]
    pub beyond: Outside,
    /// Center of the first pixel in points that are given or printed: half is (0.5, 0.5), integer is (0, 0)
    #[cfg_attr(feature = "cli", arg(long, value_enum, value_name = "CENTERS", default_value_t = PixelCenters::Half))]
    #[serde(default)]
    pub pixel_centers: PixelCenters,
}

/// Margin of `whole`, in sides of the rectangle: farther off, floors are a few blurred pixels.
const WHOLE_MARGIN: f64 = 3.0;

impl Params {
    /// The defaults for a quadrilateral.
    pub fn new(quad: Quad) -> Self {
        Self {
            quad,
            aspect: None,
            focal: None,
            width: None,
            height: None,
            margin: 0.0,
            whole: false,
            beyond: Outside::default(),
            pixel_centers: PixelCenters::default(),
        }
    }
}

/// Content beyond the picture.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Outside {
    /// Nothing.
    #[default]
    Transparent,
    /// The border pixels.
    Extended,
    /// A color, sRGB.
    Color([u8; 3]),
}

impl FromStr for Outside {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "transparent" => Ok(Self::Transparent),
            "extended" => Ok(Self::Extended),
            color => crate::brush::color(color).map(Self::Color).map_err(|_| {
                "beyond the picture there is transparent, extended, or a color as in #c03020"
                    .to_owned()
            }),
        }
    }
}

impl Operation for Rectify {
    const NAME: &'static str = "rectify";

    fn inputs(&self) -> Vec<&Path> {
        vec![&self.input]
    }

    fn outputs(&self) -> Vec<&Path> {
        vec![&self.output]
    }

    /// Writes the plane of a rectangle in the picture as if it was seen from straight on, with its true proportions and each pixel
    /// filtered once.
    ///
    /// The proportions are the ones given, or follow from the focal length (given, or in the EXIF data), or from the rectangle's
    /// right angles; the middle of the picture is taken for where the axis of the lens goes through.
    ///
    /// The report's `result` has `quad`, `size` in pixels, `image_from_straight` and `straight_from_image` (nine numbers each, row
    /// by row), `aspect`, `aspect_from` (`hand`, `focal`, `exif` or `right-angles`), `aspect_sigma_percent` (its standard deviation
    /// if the corners are a pixel off), `focal_px` and `angle_deg` (between the sides; 90 for a rectangle). The same numbers, where
    /// they are single, are figures.
    ///
    /// # Errors
    /// [`JobError::Parameter`], [`JobError::Quad`], [`JobError::Outside`], [`JobError::Proportions`], [`JobError::Read`],
    /// [`JobError::Write`], [`JobError::Cancelled`].
    fn run(&self, context: &Context) -> Result<Report, JobError> {
        let Self {
            input,
            output,
            params,
        } = self;
        let progress = &context.progress;
        for (name, side) in [("width", params.width), ("height", params.height)] {
            if let Some(side) = side.filter(|side| !(1..=65535).contains(side)) {
                return Err(JobError::Parameter {
                    field: name,
                    value: side.to_string(),
                    range: "1 to 65535",
                });
            }
        }
        if !(0.0..=100.0).contains(&params.margin) {
            return Err(JobError::Parameter {
                field: "margin",
                value: params.margin.to_string(),
                range: "0 to 100",
            });
        }
        check_paths(input, Some(output), context)?;
        let mut report = Report::of(self, params);
        let picture = files::read(input, &mut report, context)?;
        let size = picture.image.size();
        let quad = params.quad.check(params.pixel_centers, size)?;
        let view = view(params, quad, &picture, &mut report)?;
        let area = view.size.x * view.size.y;
        let straight_size = Size::new(view.size.x as usize, view.size.y as usize)
            .ok()
            .filter(|_| area <= context.limits.max_pixels as f64)
            .ok_or(JobError::ResultSize {
                width: view.size.x,
                height: view.size.y,
                remedy: "give a smaller `width` or `margin`",
            })?;
        files::check_size(output, straight_size, &picture, context)?;
        let map = &view.image_from_straight;
        let straight: Image<LinearRgba> = report.time("warp", || {
            let source = picture.convert::<PremulLinearRgba>();
            let beyond = match params.beyond {
                Outside::Transparent => Beyond::Pixel(PremulLinearRgba([0.0; 4])),
                Outside::Extended => Beyond::Border,
                Outside::Color(rgb) => Beyond::Pixel(PremulLinearRgba::from_linear(
                    ravec::raster::Srgb(rgb).to_linear(),
                )),
            };
            let straight =
                context
                    .device
                    .warp_homography(&source, map, straight_size, beyond, progress);
            straight.map(|image| settled(&image))
        })?;
        context.device.report_warnings(&mut report);
        let result = picture.with_image(&straight);
        files::write(
            output,
            &result,
            &WriteOptions::default(),
            &mut report,
            context,
        )?;
        Ok(report)
    }
}

/// The view and its place in the report.
fn view(
    params: &Params,
    quad: [DVec2; 4],
    picture: &Picture,
    report: &mut Report,
) -> Result<Straight, JobError> {
    let size = picture.image.size();
    let extent = dvec2(size.width() as f64, size.height() as f64);
    let exif = picture
        .origin
        .focal_35mm()
        .map(|film| focal_px_from_35mm(film, size.width(), size.height()));
    let (known, from) = match (params.aspect, params.focal, exif) {
        (Some(Ratio(ratio)), _, _) => (Known::Ratio(ratio), "hand"),
        (None, Some(focal), _) => (Known::Focal(focal.in_pixels(size)), "focal"),
        (None, None, Some(focal)) => (Known::Focal(focal), "exif"),
        (None, None, None) => (Known::RightAngles, "right-angles"),
    };
    let found =
        proportions(quad, 0.5 * extent, known).map_err(|cause| JobError::Proportions { cause })?;
    let margin = if params.whole {
        WHOLE_MARGIN
    } else {
        params.margin
    };
    let no_view = |cause| JobError::Quad { cause };
    let plain = straight_view(quad, found.ratio, 1.0, 0.0, extent).map_err(no_view)?;
    let scale = match (params.width, params.height) {
        (Some(width), _) => f64::from(width) / plain.size.x,
        (_, Some(height)) => f64::from(height) / plain.size.y,
        _ => 1.0,
    };
    let view = straight_view(quad, found.ratio, scale, margin, extent).map_err(no_view)?;
    let angle_deg = found.angle_rad.to_degrees();
    report.figures.insert("aspect", found.ratio);
    report
        .figures
        .insert("aspect_sigma_percent", 100.0 * found.ratio_sigma_rel);
    report.figures.insert("angle_deg", angle_deg);
    if let Some(focal) = found.focal_px {
        report.figures.insert("focal_px", focal);
    }
    if (angle_deg - 90.0).abs() > 5.0 {
        report.warn(format!(
            "with this focal length the sides meet at {angle_deg:.0} degrees: it is no rectangle, or the picture was cropped"
        ));
    }
    if found.ratio_sigma_rel > 0.1 {
        report.warn(
            "the proportions hang on fractions of a pixel of the corners: give `aspect` or `focal` if you know them",
        );
    }
    let centers = params.pixel_centers;
    report.result = Some(json!({
        "quad": params.quad.0.map(|corner| corner.to_array()),
        "pixel_centers": centers,
        "size": [view.size.x as u64, view.size.y as u64],
        "image_from_straight": centers.write_map(&view.image_from_straight).to_rows(),
        "straight_from_image": centers.write_map(&view.image_from_straight.inverse()).to_rows(),
        "aspect": found.ratio,
        "aspect_from": from,
        "aspect_sigma_percent": 100.0 * found.ratio_sigma_rel,
        "focal_px": found.focal_px,
        "angle_deg": angle_deg,
    }));
    Ok(view)
}

/// Straight alpha between 0 and 1, and 1 where only rounding keeps it from that.
fn settled(image: &Image<PremulLinearRgba>) -> Image<LinearRgba> {
    const ROUNDING: f32 = 1e-4;
    Image::from_fn(image.size(), |col, row| {
        let LinearRgba([r, g, b, alpha]) = image[(col, row)].to_linear();
        if alpha <= 0.0 {
            LinearRgba([0.0; 4])
        } else if alpha >= 1.0 - ROUNDING {
            LinearRgba([r, g, b, 1.0])
        } else {
            LinearRgba([r, g, b, alpha])
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ErrorKind;
    use ravec::raster::{AnyImage, Srgb};

    fn run(input: &Path, output: &Path, params: &Params) -> Result<Report, JobError> {
        let operation = Rectify {
            input: input.to_path_buf(),
            output: output.to_path_buf(),
            params: params.clone(),
        };
        operation.run(&Context::default())
    }

    /// A picture of 200 × 150 with a red field in a quadrilateral that is a square on its plane, on gray.
    fn photo(folder: &Path) -> PathBuf {
        let quad = quad().0;
        let unit_from_image = ravec::planar::Homography::from_unit_square(quad)
            .unwrap()
            .inverse();
        let image: Image<Srgb<u8>> = Image::from_fn(Size::new(200, 150).unwrap(), |col, row| {
            let at = unit_from_image.apply(dvec2(col as f64 + 0.5, row as f64 + 0.5));
            let inside = at.cmpgt(glam::DVec2::ZERO).all() && at.cmplt(glam::DVec2::ONE).all();
            Srgb(if inside { [200, 30, 20] } else { [120; 3] })
        });
        let path = folder.join("photo.png");
        let picture = Picture::from_image(AnyImage::from(image));
        ravec_media::write(&path, &picture, &WriteOptions::default()).unwrap();
        path
    }

    fn quad() -> Quad {
        "50,30,160,20,150,130,60,110".parse().unwrap()
    }

    #[test]
    fn the_rectangle_fills_the_result_and_the_report_says_how() {
        let folder = tempfile::tempdir().unwrap();
        let photo = photo(folder.path());
        let output = folder.path().join("out.png");
        let params = Params {
            aspect: Some(Ratio(2.0)),
            width: Some(80),
            ..Params::new(quad())
        };
        let report = run(&photo, &output, &params).unwrap();
        let found = ravec_media::read(&output, &ravec_media::Limits::default()).unwrap();
        let AnyImage::Srgb8(image) = found.image else {
            panic!("opaque pictures stay opaque");
        };
        assert_eq!((image.width(), image.height()), (80, 40));
        assert_eq!(image[(40, 20)], Srgb([200, 30, 20]));
        let result = report.result.unwrap();
        assert_eq!(result["aspect_from"], "hand");
        assert_eq!(result["image_from_straight"].as_array().unwrap().len(), 9);
    }

    #[test]
    fn the_whole_plane_is_larger_and_transparent_where_there_is_no_picture() {
        let folder = tempfile::tempdir().unwrap();
        let photo = photo(folder.path());
        let output = folder.path().join("out.png");
        let params = Params {
            whole: true,
            focal: Some(Focal::Pixels(300.0)),
            ..Params::new(quad())
        };
        run(&photo, &output, &params).unwrap();
        let found = ravec_media::read(&output, &ravec_media::Limits::default()).unwrap();
        let AnyImage::Srgba8(image) = found.image else {
            panic!("there are places that the picture does not show");
        };
        assert!(image.width() > 150);
        let extended = Params {
            beyond: Outside::Extended,
            ..params
        };
        run(&photo, &output, &extended).unwrap();
        let found = ravec_media::read(&output, &ravec_media::Limits::default()).unwrap();
        assert!(!found.image.has_alpha());
    }

    #[test]
    fn what_cannot_be_is_refused_before_anything_is_written() {
        let folder = tempfile::tempdir().unwrap();
        let photo = photo(folder.path());
        let output = folder.path().join("out.png");
        let refused = |params: Params| run(&photo, &output, &params).unwrap_err();
        let crossing: Quad = "50,30,150,130,160,20,60,110".parse().unwrap();
        assert!(matches!(
            refused(Params::new(crossing)),
            JobError::Quad { .. }
        ));
        let far: Quad = "250,30,360,20,350,130,260,110".parse().unwrap();
        assert!(matches!(
            refused(Params::new(far)),
            JobError::Outside { .. }
        ));
        let parallel: Quad = "50,30,150,30,180,110,20,110".parse().unwrap();
        let error = refused(Params::new(parallel));
        assert!(
            matches!(error, JobError::Proportions { .. }) && error.kind() == ErrorKind::Failure,
            "{error}"
        );
        let margin = Params {
            margin: f64::NAN,
            ..Params::new(quad())
        };
        assert!(matches!(refused(margin), JobError::Parameter { .. }));
        let large = Params {
            width: Some(65535),
            ..Params::new(quad())
        };
        assert!(matches!(refused(large), JobError::ResultSize { .. }));
        assert!(!output.exists());
    }
}

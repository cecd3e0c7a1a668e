//! `mesh render`: a picture of a mesh, plain, cut open or colored by its distance to another.

mod colored;

use self::colored::{Colored, summarize};
use super::compare::read_surface;
use super::refine::refined;
use super::{Cut, Length, Viewpoint};
use crate::context::Context;
use crate::error::JobError;
use crate::files;
use crate::operation::{Operation, paths};
use crate::report::Report;
use ravec::mesh::{Bvh, TriMesh, vertex_distances};
use ravec::mesh_io::{LengthUnit, MeshFile};
use ravec::mesh_render::{
    Camera, FeatureLines, LineStyle, Paint, Projection, RenderError, RenderParams, Rendering,
    Section, UpAxis, View, render,
};
use ravec::raster::{AnyImage, Image, Size, Srgb, Srgba};
use ravec_media::{Picture, WriteOptions};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Render a mesh to a picture
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args), command(after_help = HELP))]
pub struct Render {
    /// Input mesh; `-` is standard input
    pub input: PathBuf,
    /// Output picture; its extension selects the format, `-` is standard output as PNG
    #[cfg_attr(feature = "cli", arg(short, long, value_name = "FILE"))]
    pub output: PathBuf,
    /// Color each place by its distance to this mesh; `-` is standard input
    #[cfg_attr(feature = "cli", arg(long, value_name = "MESH"))]
    #[serde(default)]
    pub compare: Option<PathBuf>,
    /// Parameters.
    #[cfg_attr(feature = "cli", command(flatten))]
    #[serde(default)]
    pub params: Params,
}

#[cfg(feature = "cli")]
const HELP: &str = "\
Examples:
  ravec mesh render part.stl -o part.png
  ravec mesh render part.stl -o part.png --view 30,20 --perspective --edges --width 640 --height 480
  ravec mesh render part.stl -o cut.png --section=-y=40% --transparent
  ravec mesh render other.ply -o distance.png --compare part.stl --range 2%
  ravec mesh render part.stl -o - --view front --up y >front.png

Colors of distances go from violet (nothing) over green to yellow; with --expected from blue (too near) over gray to red (too \
far).

Figures, with --compare: distance_min, distance_mean and distance_max at vertices, and color_low and color_high, the values \
at the ends of the scale of colors.";

/// Parameters of [`Render`].
#[expect(
    clippy::struct_excessive_bools,
    reason = "each is a flag of its own, which may be combined with all others"
)]
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct Params {
    /// Columns, 1 to 16384; at most 100 million pixels in all
    #[cfg_attr(feature = "cli", arg(long, value_name = "PX", default_value_t = Params::default().width))]
    pub width: u32,
    /// Rows, 1 to 16384
    #[cfg_attr(feature = "cli", arg(long, value_name = "PX", default_value_t = Params::default().height))]
    pub height: u32,
    /// Viewpoint: front, right, back, left, top, bottom, iso, or degrees around and up, as in 30,20
    #[cfg_attr(feature = "cli", arg(long, value_name = "VIEW", allow_hyphen_values = true, default_value_t = Params::default().view))]
    pub view: Viewpoint,
    /// The axis that points upward
    #[cfg_attr(feature = "cli", arg(long, value_enum, value_name = "AXIS", default_value_t = Params::default().up))]
    pub up: UpAxis,
    /// Show depth, with this field of view, 1 to 150 degrees: more shows more depth [default: parallel lines stay parallel]
    #[cfg_attr(feature = "cli", arg(long, value_name = "DEGREES", num_args = 0..=1, default_missing_value = "35", require_equals = true))]
    pub perspective: Option<f64>,
    /// Magnification about the middle, relative to the whole mesh in the frame, above 0
    #[cfg_attr(feature = "cli", arg(long, value_name = "FACTOR", default_value_t = Params::default().zoom))]
    pub zoom: f64,
    /// Draw the edges of all triangles
    #[cfg_attr(feature = "cli", arg(long))]
    pub edges: bool,
    /// Draw edges as features where normals differ by more than this, 0 to 180 degrees
    #[cfg_attr(feature = "cli", arg(long, value_name = "DEGREES", default_value_t = Params::default().feature_angle))]
    pub feature_angle: f64,
    /// Draw no features: neither creases and borders nor outlines
    #[cfg_attr(feature = "cli", arg(long))]
    pub no_features: bool,
    /// Draw no outlines where the surface turns away from the eye
    #[cfg_attr(feature = "cli", arg(long))]
    pub no_outlines: bool,
    /// Width of features in pixels, above 0, up to 64; other edges are half as wide
    #[cfg_attr(feature = "cli", arg(long, value_name = "PX", default_value_t = Params::default().line_width))]
    pub line_width: f64,
    /// Color of lines
    #[cfg_attr(feature = "cli", arg(long, value_name = "#RRGGBB", default_value = "#181c22", value_parser = crate::brush::color))]
    pub line_color: [u8; 3],
    /// Let the surface look smooth up to this angle between triangles, 0 to 180 degrees; 0 shows each triangle flat
    #[cfg_attr(feature = "cli", arg(long, value_name = "DEGREES", default_value_t = Params::default().smooth_angle))]
    pub smooth_angle: f64,
    /// Cut the mesh open and take away what is beyond: x, y, z or a direction as in 1,1,0, a minus sign before an axis for
    /// the other side, and where, as in x=2.5 or -y=40% [default place: 50%]
    #[cfg_attr(
        feature = "cli",
        arg(long, value_name = "PLANE", allow_hyphen_values = true)
    )]
    pub section: Option<Cut>,
    /// Show the inside of a cut, rather than fill it as if the mesh were solid
    #[cfg_attr(feature = "cli", arg(long))]
    pub hollow: bool,
    /// Color of the outside
    #[cfg_attr(feature = "cli", arg(long, value_name = "#RRGGBB", default_value = "#b2c0d0", value_parser = crate::brush::color))]
    pub color: [u8; 3],
    /// Color of the inside, so that flipped and open parts are seen
    #[cfg_attr(feature = "cli", arg(long, value_name = "#RRGGBB", default_value = "#c4644e", value_parser = crate::brush::color))]
    pub back_color: [u8; 3],
    /// Color of a cut
    #[cfg_attr(feature = "cli", arg(long, value_name = "#RRGGBB", default_value = "#e2b268", value_parser = crate::brush::color))]
    pub cut_color: [u8; 3],
    /// Color behind the mesh
    #[cfg_attr(feature = "cli", arg(long, value_name = "#RRGGBB", default_value = "#ffffff", value_parser = crate::brush::color))]
    pub background: [u8; 3],
    /// Leave what is behind the mesh transparent
    #[cfg_attr(feature = "cli", arg(long))]
    pub transparent: bool,
    /// Samples of a pixel along each side, 1 to 8: more makes smoother edges and takes longer
    #[cfg_attr(feature = "cli", arg(long, value_name = "N", default_value_t = Params::default().samples))]
    pub samples: u32,
    /// With --compare: the distance at the end of the scale of colors, a length or as in 0.5% of the other mesh's diagonal
    /// [default: the largest]
    #[cfg_attr(feature = "cli", arg(long, value_name = "LENGTH"))]
    pub range: Option<Length>,
    /// With --compare: show by how much distances fall short of this (blue) or exceed it (red), rather than distances;
    /// a length or as in 2% of the other mesh's diagonal
    #[cfg_attr(feature = "cli", arg(long, value_name = "LENGTH"))]
    pub expected: Option<Length>,
    /// Quality of a JPEG output, 1 to 100: higher is larger and closer to the picture
    #[cfg_attr(feature = "cli", arg(long, value_name = "QUALITY", default_value_t = Params::default().quality))]
    pub quality: u8,
}

impl Default for Params {
    fn default() -> Self {
        let look = RenderParams::default();
        let features = FeatureLines::default();
        Self {
            width: look.width,
            height: look.height,
            view: Viewpoint(View::ISO),
            up: UpAxis::default(),
            perspective: None,
            zoom: 1.0,
            edges: false,
            feature_angle: features.angle_deg,
            no_features: false,
            no_outlines: false,
            line_width: features.style.width_px,
            line_color: features.style.color,
            smooth_angle: look.smooth_angle_deg,
            section: None,
            hollow: false,
            color: look.front_color,
            back_color: look.back_color,
            cut_color: look.cut_color,
            background: [255; 3],
            transparent: false,
            samples: look.samples_per_side,
            range: None,
            expected: None,
            quality: WriteOptions::default().quality,
        }
    }
}

/// A picture takes 20 bytes a pixel while it is drawn.
const MAX_PIXELS: u64 = 100_000_000;

/// With colors for distances, edges are halved until they are no longer than this share of the diagonal.
const FINE_EDGE: f64 = 1.0 / 150.0;

/// And no further than to this number of triangles, which take seconds.
const FINE_TRIANGLES: usize = 1_500_000;

impl Params {
    fn check(&self, compares: bool) -> Result<(), JobError> {
        let wrong = |field, value: String, range| {
            Err(JobError::Parameter {
                field,
                value,
                range,
            })
        };
        for (name, side) in [("width", self.width), ("height", self.height)] {
            if !(1..=16_384).contains(&side) {
                return wrong(name, side.to_string(), "1 to 16384");
            }
        }
        if u64::from(self.width) * u64::from(self.height) > MAX_PIXELS {
            let size = format!("{} with `height` {}", self.width, self.height);
            let range = "such that both give at most 100 million pixels";
            return wrong("width", size, range);
        }
        if let Some(angle) = self.perspective.filter(|a| !(1.0..=150.0).contains(a)) {
            return wrong("perspective", angle.to_string(), "1 to 150");
        }
        if !(self.zoom > 0.0 && self.zoom <= 1e6) {
            return wrong("zoom", self.zoom.to_string(), "above 0, up to 1000000");
        }
        for (name, angle) in [
            ("feature_angle", self.feature_angle),
            ("smooth_angle", self.smooth_angle),
        ] {
            if !(0.0..=180.0).contains(&angle) {
                return wrong(name, angle.to_string(), "0 to 180");
            }
        }
        if !(self.line_width > 0.0 && self.line_width <= 64.0) {
            let width = self.line_width.to_string();
            return wrong("line_width", width, "above 0, up to 64");
        }
        if !(1..=8).contains(&self.samples) {
            return wrong("samples", self.samples.to_string(), "1 to 8");
        }
        if !(1..=100).contains(&self.quality) {
            return wrong("quality", self.quality.to_string(), "1 to 100");
        }
        if let Some(range) = self.range.filter(|range| !range.is_positive()) {
            return wrong("range", range.to_string(), "above 0");
        }
        for (name, length) in [("range", self.range), ("expected", self.expected)] {
            if let Some(length) = length.filter(|_| !compares) {
                return wrong(name, length.to_string(), "left out without `compare`");
            }
        }
        Ok(())
    }

    fn look(&self, mesh: &TriMesh, unit: Option<LengthUnit>) -> Result<RenderParams, JobError> {
        let style = LineStyle {
            color: self.line_color,
            width_px: self.line_width,
        };
        let features = FeatureLines {
            angle_deg: self.feature_angle,
            silhouettes: !self.no_outlines,
            style,
        };
        let plane = self.section.map(|section| section.plane(mesh, unit));
        let plane = plane.transpose()?.flatten();
        Ok(RenderParams {
            width: self.width,
            height: self.height,
            samples_per_side: self.samples,
            camera: Camera {
                view: self.view.0,
                up: self.up,
                projection: match self.perspective {
                    Some(field_of_view_deg) => Projection::Perspective { field_of_view_deg },
                    None => Projection::Orthographic,
                },
                frame: None,
                zoom: self.zoom,
                target: None,
            },
            smooth_angle_deg: self.smooth_angle,
            shaded: true,
            front_color: self.color,
            back_color: self.back_color,
            cut_color: self.cut_color,
            background: (!self.transparent).then_some(self.background),
            wireframe: self.edges.then_some(LineStyle {
                width_px: 0.5 * self.line_width,
                ..style
            }),
            features: (!self.no_features).then_some(features),
            marked: None,
            section: plane.map(|(normal, offset)| Section {
                normal,
                offset,
                capped: !self.hollow,
            }),
        })
    }
}

impl Operation for Render {
    const NAME: &'static str = "mesh render";

    fn inputs(&self) -> Vec<&Path> {
        paths(&self.input, [&self.compare])
    }

    fn outputs(&self) -> Vec<&Path> {
        vec![&self.output]
    }

    /// Renders the mesh.
    ///
    /// With a mesh to compare, colors show how far each place is from that surface. Triangles are cut for it until they are small, unless
    /// edges are drawn.
    ///
    /// Figures, with a mesh to compare only, of the places drawn: `distance_min`, `distance_mean` (over vertices) and `distance_max`,
    /// `color_low` and `color_high` (the values at the ends of the scale).
    ///
    /// # Errors
    /// [`JobError::Parameter`], [`JobError::ReadMesh`], [`JobError::NoTriangles`], [`JobError::Write`], [`JobError::RenderMesh`], what
    /// [`check_files`](crate::check_files) refuses, [`JobError::Cancelled`].
    fn run(&self, context: &Context) -> Result<Report, JobError> {
        let Self {
            input,
            output,
            compare,
            params,
        } = self;
        let progress = &context.progress;
        params.check(compare.is_some())?;
        files::check_target(output, context)?;
        context.check_files(&self.inputs(), &self.outputs())?;
        let mut report = Report::of(self, params);
        let file = read_surface(input, &mut report, context)?;
        let MeshFile { mut mesh, unit, .. } = file;
        let look = params.look(&mesh, unit)?;
        let rendering = if let Some(other) = compare {
            let reference = read_surface(other, &mut report, context)?;
            if !params.edges {
                let edge = FINE_EDGE * mesh.bounds().diagonal();
                mesh = report.time("refine", || refined(mesh, edge, FINE_TRIANGLES, progress))?;
            }
            let values = report.time("compare", || {
                vertex_distances(&mesh, &Bvh::try_new(&reference.mesh, progress)?, progress)
            })?;
            summarize(&values, &mut report);
            let values = Colored::new(values, &reference, params)?;
            report.time("render", || render(&mesh, &values.paint(), &look, progress))
        } else {
            report.time("render", || render(&mesh, &Paint::Plain, &look, progress))
        };
        let rendering = rendering.map_err(refused)?;
        if let Some(legend) = rendering.legend {
            report.figures.insert("color_low", legend.low);
            report.figures.insert("color_high", legend.high);
        }
        let picture = Picture::from_image(image_of(rendering));
        let options = WriteOptions {
            quality: params.quality,
            ..WriteOptions::default()
        };
        files::write(output, &picture, &options, &mut report, context)?;
        Ok(report)
    }
}

/// Converts an error of the renderer, such as a plane at infinity.
pub(super) fn refused(error: RenderError) -> JobError {
    match error {
        RenderError::Cancelled(_) => JobError::Cancelled,
        cause => JobError::RenderMesh { cause },
    }
}

/// Converts a rendering to an image: with an alpha channel only if a pixel is not opaque.
///
/// # Panics
/// If the rendering has no pixels; [`render`] makes none of that kind.
pub fn image_of(rendering: Rendering) -> AnyImage {
    let picture = rendering.picture;
    let (width, height) = (picture.width as usize, picture.height as usize);
    let size = Size::new(width, height).expect("the renderer refuses pictures without pixels");
    let pixel = |col: usize, row: usize| {
        let start = 4 * (row * width + col);
        [0, 1, 2, 3].map(|i| picture.pixels[start + i])
    };
    if picture.pixels.chunks_exact(4).all(|pixel| pixel[3] == 255) {
        Image::from_fn(size, |col, row| {
            let [r, g, b, _] = pixel(col, row);
            Srgb([r, g, b])
        })
        .into()
    } else {
        Image::from_fn(size, |col, row| Srgba(pixel(col, row))).into()
    }
}

#[cfg(test)]
mod tests;

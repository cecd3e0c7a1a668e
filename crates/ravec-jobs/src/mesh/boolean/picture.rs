//! A picture of a result that shows what is old and what is new in it.

use crate::context::Context;
use crate::error::JobError;
use crate::files;
use crate::mesh::Viewpoint;
use crate::mesh::render::{image_of, refused};
use crate::report::Report;
use ravec::boolean::{Boolean, Origin};
use ravec::mesh::TriMesh;
use ravec::mesh_render::{
    Camera, FeatureLines, LineStyle, MarkedEdges, Paint, RenderParams, render,
};
use ravec_media::{Picture, WriteOptions};
use std::path::Path;

/// The color of triangles that are as they were.
const WHOLE: [u8; 3] = [178, 192, 208];

/// The color of pieces of triangles.
const PIECE: [u8; 3] = [240, 178, 86];

/// The color of what closes holes.
const CLOSING: [u8; 3] = [120, 186, 118];

/// The color of edges along which surfaces were cut.
const SEAM: [u8; 3] = [196, 30, 58];

/// Colors the triangles of a result by their origin: gray-blue as they were, orange if cut, green if they close a hole.
pub fn origin_colors(origins: &[Origin]) -> Vec<[u8; 3]> {
    let color = |origin: &Origin| match (origin.triangle, origin.whole) {
        (None, _) => CLOSING,
        (Some(_), true) => WHOLE,
        (Some(_), false) => PIECE,
    };
    origins.iter().map(color).collect()
}

/// Adds to `params` red lines `width_px` wide along the edges where the surfaces of a result meet.
pub fn with_seams(result: &Boolean, width_px: f64, params: &RenderParams) -> RenderParams {
    RenderParams {
        smooth_angle_deg: 0.0,
        features: Some(FeatureLines {
            style: LineStyle {
                color: [60, 66, 76],
                width_px: 0.5 * width_px,
            },
            ..FeatureLines::default()
        }),
        marked: Some(MarkedEdges {
            edges: result.feature_edges.clone(),
            style: LineStyle {
                color: SEAM,
                width_px,
            },
        }),
        ..params.clone()
    }
}

/// Draws `result` and writes the picture.
pub(super) fn write(
    path: &Path,
    result: &Boolean,
    view: Viewpoint,
    report: &mut Report,
    context: &Context,
) -> Result<(), JobError> {
    let camera = Camera {
        view: view.0,
        ..Camera::default()
    };
    let params = with_seams(
        result,
        2.0,
        &RenderParams {
            camera,
            ..RenderParams::default()
        },
    );
    let colors = origin_colors(&result.origins);
    let paint = Paint::FaceColors(&colors);
    let mesh: &TriMesh = &result.mesh;
    let rendering = report.time("render", || {
        render(mesh, &paint, &params, &context.progress)
    });
    let picture = Picture::from_image(image_of(rendering.map_err(refused)?));
    files::write(path, &picture, &WriteOptions::default(), report, context)
}

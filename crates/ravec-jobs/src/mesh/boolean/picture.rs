//! A picture of a result that shows what is old and what is new in it.

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
use ravec::progress::Progress;
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

/// The colors of the triangles of a result.
pub(super) fn colors(origins: &[Origin]) -> Vec<[u8; 3]> {
    let color = |origin: &Origin| match (origin.triangle, origin.whole) {
        (None, _) => CLOSING,
        (Some(_), true) => WHOLE,
        (Some(_), false) => PIECE,
    };
    origins.iter().map(color).collect()
}

/// A look with the seams of a result marked.
pub(super) fn look(result: &Boolean, width_px: f64, look: &RenderParams) -> RenderParams {
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
        ..look.clone()
    }
}

/// Draws `result` and writes the picture.
pub(super) fn write(
    path: &Path,
    result: &Boolean,
    view: Viewpoint,
    report: &mut Report,
    progress: &Progress,
) -> Result<(), JobError> {
    let camera = Camera {
        view: view.0,
        ..Camera::default()
    };
    let look = look(
        result,
        2.0,
        &RenderParams {
            camera,
            ..RenderParams::default()
        },
    );
    let colors = colors(&result.origins);
    let paint = Paint::FaceColors(&colors);
    let mesh: &TriMesh = &result.mesh;
    let rendering = report.time("render", || render(mesh, &paint, &look, progress));
    let picture = Picture::from_image(image_of(rendering.map_err(refused)?));
    files::write(path, &picture, &WriteOptions::default(), report, progress)
}

//! A mesh as it will be in a file that holds 32-bit floats.

use super::MeshTarget;
use super::convert::unit_scale;
use crate::error::JobError;
use glam::DVec3;
use ravec::mesh::{CheckParams, MeshCheck, TriMesh, check, weld};
use ravec::progress::Progress;

/// Effect of rounding on a mesh.
pub(super) struct Rounded {
    /// Largest change of a coordinate.
    pub moved: f64,
    /// Verdict on the rounded mesh, if it differs.
    pub check: Option<MeshCheck>,
}

/// Rounds a mesh as writing it to `target` will, and looks at what comes of it.
pub(super) fn rounded(
    mesh: &TriMesh,
    target: MeshTarget,
    progress: &Progress,
) -> Result<Rounded, JobError> {
    let scale = unit_scale(target);
    let round = |x: f64| f64::from((x * scale) as f32) / scale;
    let rounded = |p: &DVec3| DVec3::new(round(p.x), round(p.y), round(p.z));
    let positions: Vec<_> = mesh.positions().iter().map(rounded).collect();
    let changes = positions.iter().zip(mesh.positions());
    let moved = changes.map(|(a, b)| (*a - *b).abs().max_element());
    let moved = moved.fold(0.0, f64::max);
    // what is beyond all 32-bit floats is refused when it is written
    let check = match TriMesh::new(positions, mesh.triangles().to_vec()) {
        Ok(rounded) if moved > 0.0 => {
            let full = CheckParams {
                self_intersections: true,
                list_limit: 0,
            };
            // vertices that have become equal are one for readers of the file
            Some(check(&weld(&rounded, 0.0).mesh, &full, progress)?)
        }
        _ => None,
    };
    Ok(Rounded { moved, check })
}

//! A mesh as readers of a format see it: rounded to its numbers, with vertices joined where it cannot tell them apart.

use super::MeshTarget;
use super::convert::{rounds, unit_scale};
use ravec::mesh::{Coordinates, TriMesh, try_weld};
use ravec::mesh_io::MeshFormat;
use ravec::progress::{Cancelled, Progress};

/// Precision of the coordinates of a file.
pub(super) fn coordinates_of(target: MeshTarget) -> Coordinates {
    if rounds(&target) {
        Coordinates::Single
    } else {
        Coordinates::Double
    }
}

/// True if the format has no vertices of its own, so that readers join those at equal places.
pub(super) fn joins_places(target: MeshTarget) -> bool {
    matches!(target.format, MeshFormat::StlBinary | MeshFormat::StlAscii)
}

/// The mesh that is read from a file to which `mesh` is written, in the unit of the file; `None` beyond the range of its
/// numbers, which is refused when the file is written.
pub(super) fn as_read(
    mesh: &TriMesh,
    target: MeshTarget,
    progress: &Progress,
) -> Result<Option<TriMesh>, Cancelled> {
    let scale = unit_scale(target);
    let coordinates = coordinates_of(target);
    let positions = mesh.positions().iter();
    let positions = positions.map(|&p| coordinates.nearest(p * scale)).collect();
    let Ok(rounded) = TriMesh::new(positions, mesh.triangles().to_vec()) else {
        return Ok(None);
    };
    if joins_places(target) {
        return Ok(Some(try_weld(&rounded, 0.0, progress)?.mesh));
    }
    Ok(Some(rounded))
}

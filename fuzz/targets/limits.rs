//! The limits that all targets read with, in one place.

use ravec::mesh::MeshLimits;
use ravec_media::Limits;

/// The memory of a picture reader: enough for each seed, and little enough that a file which takes more is found.
pub const PICTURE_BYTES: usize = 16 << 20;

/// The most pixels of a picture.
pub const MAX_PIXELS: u64 = 1 << 20;

const MESH_BYTES: u64 = 1 << 20;
const MAX_ELEMENTS: u64 = 1 << 14;

/// The memory of a mesh reader: bytes of the file and of what is packed in it, each in two copies while a buffer grows, and
/// four times the mesh, as [`MeshLimits`] says.
pub const MESH_HELD: usize =
    2 * MESH_BYTES as usize + 4 * (12 + 24) * MAX_ELEMENTS as usize + (1 << 20);

/// The limits of picture readers.
pub fn pictures() -> Limits {
    Limits {
        max_pixels: MAX_PIXELS,
        max_bytes: PICTURE_BYTES as u64,
    }
}

/// The limits of mesh readers.
pub fn meshes() -> MeshLimits {
    MeshLimits {
        max_bytes: MESH_BYTES,
        max_triangles: MAX_ELEMENTS,
        max_vertices: MAX_ELEMENTS,
    }
}

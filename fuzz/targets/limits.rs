//! The limits that all targets read with, in one place.

use ravec::memory::MemoryBudget;
use ravec::mesh_io::MeshLimits;
use ravec_media::Limits;

/// The memory of a picture reader: enough for each seed, and little enough that a file which takes more is found.
pub const PICTURE_BYTES: usize = 16 << 20;

/// The most pixels of a picture.
pub const MAX_PIXELS: u64 = 1 << 20;

/// The memory of a clip reader, and of the frames that its target keeps: most of it is reserved for the decoder.
pub const CLIP_BYTES: usize = 32 << 20;

const MESH_BYTES: u64 = 4 << 20;
const MAX_ELEMENTS: u64 = 1 << 14;

/// The memory of a mesh reader: its budget, and the tables of decompressors and parsers, which do not grow with the file.
pub const MESH_HELD: usize = MESH_BYTES as usize + (1 << 20);

/// The limits of picture readers.
pub fn pictures() -> Limits {
    Limits {
        max_pixels: MAX_PIXELS,
        memory: MemoryBudget::new(PICTURE_BYTES as u64),
    }
}

/// The limits of clip readers.
pub fn clips() -> Limits {
    Limits {
        max_pixels: 1 << 14,
        memory: MemoryBudget::new(CLIP_BYTES as u64),
    }
}

/// The limits of mesh readers.
pub fn meshes() -> MeshLimits {
    MeshLimits {
        memory: MemoryBudget::new(MESH_BYTES),
        max_triangles: MAX_ELEMENTS,
        max_vertices: MAX_ELEMENTS,
    }
}

//! Operations on mesh files.
//!
//! [`read_mesh_file`] and [`write_mesh_file`] are what they all read and write with.

mod files;

pub use files::{MeshSource, MeshTarget, read_mesh_file, write_mesh_file};
pub(crate) use files::{known_extensions, read, write};

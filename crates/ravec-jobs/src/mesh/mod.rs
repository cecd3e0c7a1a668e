//! Operations on mesh files.
//!
//! | module | what it does |
//! | --- | --- |
//! | [`info`] | says what is in a file |
//! | [`check`] | looks for defects and says where they are |
//! | [`convert`] | writes a mesh in another format, unit or precision |
//! | [`compare`] | measures how far two surfaces are apart |
//! | [`render`] | draws a picture |
//! | [`simplify`] | removes triangles that are not needed |
//! | [`offset`] | makes the surface at a distance |
//! | [`boolean`] | combines meshes by an expression |
//!
//! They all read and write with [`ravec::mesh_io`].

mod as_read;
pub mod boolean;
pub mod check;
pub mod compare;
pub mod convert;
mod files;
pub mod info;
mod judge;
mod length;
mod negative;
pub mod offset;
mod refine;
pub mod render;
pub mod simplify;
mod view;
mod weld;

pub use boolean::NamedFile;
use files::{keep_supported, read_with_attributes, write_stored, write_with};
pub(crate) use files::{read, write};
pub use length::{Length, LengthError};
pub use ravec::mesh_io::{MeshLimits, MeshTarget, read_mesh_file, write_mesh_file};
pub use refine::refined;
pub use view::{Cut, CutError, Viewpoint, ViewpointError};

//! Files of triangle meshes: STL, PLY, OBJ, OFF, 3MF and glTF, read and written.
//!
//! [`read_mesh`] recognizes the format by the content, [`write_mesh`] takes it from the caller, for whom
//! [`MeshFormat::from_extension`] reads it off a file name. Both work on streams. [`read_mesh_file`] and [`write_mesh_file`]
//! bind them to paths, `-` being a standard stream; [`write_rows`] writes surfaces that are not in memory.
//!
//! ```
//! use glam::DVec3;
//! use ravec_mesh::TriMesh;
//! use ravec_mesh_io::{MeshFormat, ReadOptions, WriteOptions, read_mesh, write_mesh};
//! use ravec_progress::Progress;
//!
//! let corners = vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
//! let mesh = TriMesh::new(corners, vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])?;
//! let progress = Progress::none();
//! for format in [MeshFormat::StlBinary, MeshFormat::Obj, MeshFormat::ThreeMf, MeshFormat::Glb] {
//!     let mut bytes = Vec::new();
//!     write_mesh(&mesh, format, &WriteOptions::default(), &mut bytes, &progress)?;
//!     let file = read_mesh(&bytes[..], &ReadOptions::default(), &progress)?;
//!     assert_eq!((file.format, file.mesh.positions().len()), (format, 4));
//! }
//! let error = read_mesh(&b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 one 0\n3 0 1 2\n"[..], &ReadOptions::default(), &progress);
//! assert!(error.unwrap_err().to_string().starts_with("OFF, line 5: "));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! | format | read | written as |
//! | --- | --- | --- |
//! | STL | binary and ASCII, as a stream | 32-bit floats in binary, all digits in ASCII |
//! | PLY | binary of both byte orders and ASCII, polygons and triangle strips, as a stream | little-endian or ASCII, 64-bit floats where 32 bits would lose something |
//! | OBJ | polygons, relative indices, continued lines, as a stream | all digits |
//! | OFF | with the prefixes `ST`, `C`, `N`, as a stream | all digits |
//! | 3MF | meshes, components, build items and their transforms, in one or several parts | one object, or those that are named ([`Attributes::objects`]), all digits |
//! | glTF | `.glb` and `.gltf`, node transforms, triangle lists, strips and fans, sparse and quantized positions | 32-bit floats |
//!
//! Normals, texture coordinates, materials and colors are left out, and [`MeshFile::warnings`] says so; only the colors of
//! vertices of PLY files ([`ReadOptions::colors`]) and texture coordinates of OBJ and glTF files ([`ReadOptions::texture`])
//! can be requested, and written ([`write_mesh_with`]). Polygons are cut into triangles.
//!
//! # Guarantees
//!
//! - Whatever the bytes, the result is a mesh or an error that says what is wrong and where.
//! - Vertices and triangles keep the order of the file.
//! - With [`Precision::Exact`], text and PLY files give the same numbers again. Equal input gives equal bytes.
//! - Memory is reserved of [`MeshLimits::memory`] before it is allocated, but for some 100 KiB.
//! - A file that is written by path is whole or absent, and data beside a glTF file are read from its folder only.
//!
//! # Not guaranteed
//!
//! - That a mesh that was read is closed, or that it has triangles.
//! - That vertices which no triangle uses survive STL, and 3MF or glTF without triangles.
//!
//! # Words
//!
//! *Format*: one of [`MeshFormat`]. *Limits*: the most triangles, vertices and bytes that a file may have. *Place*: where in
//! a file a defect is, as a person would look it up. *Attributes*: colors and texture coordinates beside the shape.
//! *Rows*: vertices and triangles one after the other. *Target*: format, precision and unit of a file that is written.
//!
//! # Costs
//!
//! A reader takes time in proportion to the file and the mesh; binary STL takes about 80 ns a triangle, most of them for
//! finding equal corners.

mod error;
mod format;
mod gltf;
mod number;
mod obj;
mod objects;
mod off;
mod paths;
mod ply;
mod polygon;
mod read;
mod sniff;
mod soup;
mod source;
mod stl;
mod threemf;
mod write;

pub use error::{Place, ReadMeshError, WriteMeshError};
pub use format::{LengthUnit, MeshFormat, UnitRatio};
pub use objects::{MeshObject, part_of};
pub use paths::{
    MeshTarget, ReadMeshFileError, UnknownMeshExtension, WriteMeshFileError, read_mesh_file,
    read_mesh_file_with, write_mesh_file, write_mesh_file_with, write_rows_file,
};
pub use read::{
    BufferResolver, MeshFile, MeshLimits, ReadOptions, ReadWarning, read_mesh,
    read_mesh_with_buffers,
};
pub use write::{Attributes, Precision, WriteOptions, write_mesh, write_mesh_with, write_rows};

//! Mesh files: STL, PLY, OBJ, OFF, 3MF and glTF, read and written.
//!
//! [`read_mesh`] recognizes the format by the content, [`write_mesh`] takes it from the caller, for whom
//! [`MeshFormat::from_extension`] reads it off a file name. Both work on streams and never touch the file system.
//!
//! | format | read | written as |
//! | --- | --- | --- |
//! | STL | binary and ASCII, as a stream | 32-bit floats in binary, all digits in ASCII |
//! | PLY | binary of both byte orders and ASCII, polygons and triangle strips, as a stream | little-endian or ASCII, 64-bit floats where 32 bits would lose something |
//! | OBJ | polygons, relative indices, continued lines, as a stream | all digits |
//! | OFF | with the prefixes `ST`, `C`, `N`, as a stream | all digits |
//! | 3MF | meshes, components, build items and their transforms, in one or several parts | one object, all digits |
//! | glTF | `.glb` and `.gltf`, node transforms, triangle lists, strips and fans, sparse and quantized positions | 32-bit floats |
//!
//! Normals, texture coordinates, materials and colors are left out, and [`MeshFile::warnings`] says so; only the colors of
//! vertices of PLY files ([`ReadOptions::colors`]) and texture coordinates of OBJ and glTF files ([`ReadOptions::texture`])
//! can be asked for, and written ([`write_mesh_with`]). Polygons are cut into triangles.
//!
//! Guarantees: vertices and triangles keep the order of the file; whatever the bytes, the result is a mesh or an error
//! that says what is wrong and where. Memory is reserved of [`MeshLimits::memory`] before it is allocated, but for some
//! 100 KiB, and a reader takes time in proportion to the file and the mesh. Does not guarantee: that a mesh is closed, or
//! that it has triangles.

mod error;
mod gltf;
mod memory;
mod number;
mod obj;
mod off;
mod ply;
mod polygon;
mod read;
mod rows;
mod sniff;
mod soup;
mod source;
mod stl;
mod threemf;
mod weld;
mod write;

use std::fmt;

pub use error::{Place, ReadMeshError, WriteMeshError};
pub use read::{
    BufferResolver, MeshFile, MeshLimits, ReadOptions, ReadWarning, read_mesh,
    read_mesh_with_buffers,
};
pub use rows::MeshRows;
pub use weld::{Welded, try_weld, weld};
pub use write::{Attributes, Precision, WriteOptions, write_mesh, write_mesh_with, write_rows};

/// The formats of mesh files.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum MeshFormat {
    /// STL in its binary form.
    StlBinary,
    /// STL in its text form.
    StlAscii,
    /// PLY with binary data.
    PlyBinary,
    /// PLY with data in text.
    PlyAscii,
    /// Wavefront OBJ.
    Obj,
    /// Object File Format of Geomview, in text.
    Off,
    /// 3D Manufacturing Format.
    ThreeMf,
    /// glTF 2.0 in one binary file.
    Glb,
    /// glTF 2.0 as JSON; written with its data inside.
    Gltf,
}

impl MeshFormat {
    /// The format that a file name ending in `extension` asks for, in any case and with or without the dot. STL and PLY
    /// are meant in their binary forms.
    ///
    /// ```
    /// use ravec_mesh::MeshFormat;
    ///
    /// assert_eq!(MeshFormat::from_extension("STL"), Some(MeshFormat::StlBinary));
    /// assert_eq!(MeshFormat::from_extension("png"), None);
    /// ```
    pub fn from_extension(extension: &str) -> Option<Self> {
        let extension = extension.trim_start_matches('.').to_ascii_lowercase();
        Some(match extension.as_str() {
            "stl" => Self::StlBinary,
            "ply" => Self::PlyBinary,
            "obj" => Self::Obj,
            "off" => Self::Off,
            "3mf" => Self::ThreeMf,
            "glb" => Self::Glb,
            "gltf" => Self::Gltf,
            _ => return None,
        })
    }

    /// The usual ending of file names, without the dot.
    pub fn extension(self) -> &'static str {
        match self {
            Self::StlBinary | Self::StlAscii => "stl",
            Self::PlyBinary | Self::PlyAscii => "ply",
            Self::Obj => "obj",
            Self::Off => "off",
            Self::ThreeMf => "3mf",
            Self::Glb => "glb",
            Self::Gltf => "gltf",
        }
    }

    /// The format of a file that begins with `head`.
    ///
    /// 4 KiB are enough but for a text file with longer comments in front, of which 64 KiB are looked at; fewer bytes than a magic number or one row of
    /// data leave the format unknown.
    pub fn sniff(head: &[u8]) -> Option<Self> {
        sniff::sniff(head)
    }
}

impl fmt::Display for MeshFormat {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::StlBinary => "binary STL",
            Self::StlAscii => "ASCII STL",
            Self::PlyBinary => "binary PLY",
            Self::PlyAscii => "ASCII PLY",
            Self::Obj => "OBJ",
            Self::Off => "OFF",
            Self::ThreeMf => "3MF",
            Self::Glb => "GLB",
            Self::Gltf => "glTF",
        })
    }
}

/// A unit of length that a file may name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum LengthUnit {
    /// 1e-6 m.
    Micron,
    /// 1e-3 m.
    Millimeter,
    /// 1e-2 m.
    Centimeter,
    /// 0.0254 m.
    Inch,
    /// 0.3048 m.
    Foot,
    /// 1 m.
    Meter,
}

impl LengthUnit {
    /// All units, from the smallest.
    pub const ALL: [Self; 6] = [
        Self::Micron,
        Self::Millimeter,
        Self::Centimeter,
        Self::Inch,
        Self::Foot,
        Self::Meter,
    ];

    /// Its length in meters.
    pub fn in_meters(self) -> f64 {
        match self {
            Self::Micron => 1e-6,
            Self::Millimeter => 1e-3,
            Self::Centimeter => 1e-2,
            Self::Inch => 0.0254,
            Self::Foot => 0.3048,
            Self::Meter => 1.0,
        }
    }

    /// Its name, as 3MF spells it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Micron => "micron",
            Self::Millimeter => "millimeter",
            Self::Centimeter => "centimeter",
            Self::Inch => "inch",
            Self::Foot => "foot",
            Self::Meter => "meter",
        }
    }
}

impl fmt::Display for LengthUnit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

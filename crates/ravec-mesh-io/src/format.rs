//! The formats of mesh files, and the units of length that they name.

use std::fmt;

/// The formats of mesh files.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(rename_all = "kebab-case")
)]
#[non_exhaustive]
pub enum MeshFormat {
    /// STL, binary.
    #[cfg_attr(feature = "clap", value(name = "stl"))]
    #[cfg_attr(feature = "serde", serde(rename = "stl"))]
    StlBinary,
    /// STL in text.
    StlAscii,
    /// PLY, binary.
    #[cfg_attr(feature = "clap", value(name = "ply"))]
    #[cfg_attr(feature = "serde", serde(rename = "ply"))]
    PlyBinary,
    /// PLY in text.
    PlyAscii,
    /// Wavefront OBJ.
    Obj,
    /// Object File Format.
    ///
    /// It is that of Geomview, in text.
    Off,
    /// 3D Manufacturing Format.
    #[cfg_attr(feature = "clap", value(name = "3mf"))]
    #[cfg_attr(feature = "serde", serde(rename = "3mf"))]
    ThreeMf,
    /// glTF 2.0 in one binary file.
    Glb,
    /// glTF 2.0 as JSON.
    ///
    /// It is written with its data inside.
    Gltf,
}

impl MeshFormat {
    /// The format that a file name ending in `extension` asks for, in any case and with or without the dot. STL and PLY
    /// are meant in their binary forms.
    ///
    /// ```
    /// use ravec_mesh_io::MeshFormat;
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
    /// 4 KiB are enough but for a text file with longer comments in front, of which 64 KiB are examined; fewer bytes than a magic number or one row of
    /// data leave the format unknown.
    pub fn sniff(head: &[u8]) -> Option<Self> {
        crate::sniff::sniff(head)
    }
}

impl MeshFormat {
    /// The extensions that [`Self::from_extension`] knows, for a message: with dots, and commas between them.
    pub fn known_extensions() -> String {
        let formats = [
            Self::StlBinary,
            Self::PlyBinary,
            Self::Obj,
            Self::Off,
            Self::ThreeMf,
            Self::Glb,
            Self::Gltf,
        ];
        formats
            .map(|format| format!(".{}", format.extension()))
            .join(", ")
    }

    /// True if files of this format hold colors of vertices that are read and written here.
    pub fn holds_colors(self) -> bool {
        matches!(self, Self::PlyBinary | Self::PlyAscii)
    }

    /// True if files of this format hold texture coordinates that are read and written here.
    pub fn holds_texture(self) -> bool {
        matches!(self, Self::Obj | Self::Glb | Self::Gltf)
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
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(rename_all = "kebab-case")
)]
#[non_exhaustive]
pub enum LengthUnit {
    /// 1e-6 m.
    #[cfg_attr(feature = "clap", value(alias = "um"))]
    Micron,
    /// 1e-3 m.
    #[cfg_attr(feature = "clap", value(alias = "mm"))]
    Millimeter,
    /// 1e-2 m.
    #[cfg_attr(feature = "clap", value(alias = "cm"))]
    Centimeter,
    /// 0.0254 m.
    #[cfg_attr(feature = "clap", value(alias = "in"))]
    Inch,
    /// 0.3048 m.
    #[cfg_attr(feature = "clap", value(alias = "ft"))]
    Foot,
    /// 1 m.
    #[cfg_attr(feature = "clap", value(alias = "m"))]
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

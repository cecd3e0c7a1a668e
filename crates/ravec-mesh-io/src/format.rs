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

/// The ratio of two units of length, a fraction of whole numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct UnitRatio {
    numerator: u32,
    denominator: u32,
}

impl UnitRatio {
    /// `numerator / denominator`, both above 0, in lowest terms.
    fn new(numerator: u32, denominator: u32) -> Self {
        let (mut divisor, mut rest) = (numerator, denominator);
        while rest > 0 {
            (divisor, rest) = (rest, divisor % rest);
        }
        Self {
            numerator: numerator / divisor,
            denominator: denominator / divisor,
        }
    }

    /// The ratio as the nearest number, such as 25.4.
    pub fn factor(self) -> f64 {
        f64::from(self.numerator) / f64::from(self.denominator)
    }

    /// The length `x` in the other unit.
    ///
    /// Numbers that stand for a decimal fraction of at most nine places, as files of text have them, give what that fraction
    /// gives, rounded once: an inch is exactly 25.4 mm, and 25.4 mm are exactly one inch.
    #[inline]
    pub fn apply(self, x: f64) -> f64 {
        /// The largest number up to which all whole numbers are exact.
        const EXACT: f64 = 9_007_199_254_740_992.0;
        let (numerator, denominator) = (f64::from(self.numerator), f64::from(self.denominator));
        for places in [1e9, 1e6, 1e3] {
            let whole = (x * places).round();
            let product = whole * numerator;
            if product.abs() <= EXACT && whole / places == x {
                return product / (places * denominator);
            }
        }
        x * numerator / denominator
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
        self.per(Self::Meter).factor()
    }

    /// Its length in micrometers, which is a whole number for all units.
    pub fn in_micrometers(self) -> u32 {
        match self {
            Self::Micron => 1,
            Self::Millimeter => 1_000,
            Self::Centimeter => 10_000,
            Self::Inch => 25_400,
            Self::Foot => 304_800,
            Self::Meter => 1_000_000,
        }
    }

    /// The number of `other` in one of this unit, exactly.
    ///
    /// ```
    /// use ravec_mesh_io::LengthUnit;
    ///
    /// let scale = LengthUnit::Inch.per(LengthUnit::Millimeter);
    /// assert_eq!(scale.apply(0.3), 7.62);
    /// assert_eq!(LengthUnit::Millimeter.per(LengthUnit::Inch).apply(7.62), 0.3);
    /// ```
    pub fn per(self, other: Self) -> UnitRatio {
        UnitRatio::new(self.in_micrometers(), other.in_micrometers())
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decimal_lengths_are_converted_exactly_and_back() {
        for (from, to, x, y) in [
            (LengthUnit::Inch, LengthUnit::Millimeter, 1.0, 25.4),
            (LengthUnit::Inch, LengthUnit::Centimeter, 0.5, 1.27),
            (LengthUnit::Inch, LengthUnit::Millimeter, 0.7, 17.78),
            (LengthUnit::Foot, LengthUnit::Inch, 0.1, 1.2),
            (LengthUnit::Foot, LengthUnit::Meter, 1.1, 0.33528),
            (LengthUnit::Meter, LengthUnit::Micron, 0.000_123, 123.0),
            (LengthUnit::Millimeter, LengthUnit::Meter, -25.4, -0.0254),
            (LengthUnit::Foot, LengthUnit::Micron, 0.25, 76_200.0),
        ] {
            assert_eq!(from.per(to).apply(x), y, "{x} {from}");
            assert_eq!(to.per(from).apply(y), x, "{y} {to}");
        }
        let ratio = LengthUnit::Inch.per(LengthUnit::Millimeter);
        for i in 1..5000 {
            let inches = f64::from(i) / 1000.0;
            let millimeters = f64::from(i) * 254.0 / 10_000.0;
            assert_eq!(ratio.apply(inches), millimeters);
        }
    }

    #[test]
    fn other_numbers_are_converted_to_the_last_bits_and_zero_keeps_its_sign() {
        let ratio = LengthUnit::Inch.per(LengthUnit::Millimeter);
        for x in [std::f64::consts::PI, 1e-20, -7e300, 1.0 / 3.0] {
            assert!((ratio.apply(x) / (x * 25.4) - 1.0).abs() < 4e-16);
        }
        assert!(ratio.apply(-0.0).is_sign_negative());
        assert_eq!(ratio.factor(), 25.4);
        let same = LengthUnit::Foot.per(LengthUnit::Foot);
        assert_eq!((same.factor(), same.apply(1e9 / 7.0)), (1.0, 1e9 / 7.0));
    }

    #[test]
    fn units_have_their_length_in_meters() {
        let meters = LengthUnit::ALL.map(LengthUnit::in_meters);
        assert_eq!(meters, [1e-6, 1e-3, 1e-2, 0.0254, 0.3048, 1.0]);
    }
}

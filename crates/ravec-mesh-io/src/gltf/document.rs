//! The JSON of a glTF file: the part of it that locates triangles.

use std::fmt;

use serde::de::{Deserializer, SeqAccess, Visitor};

#[derive(serde::Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Document {
    pub(super) scene: Option<usize>,
    #[serde(default)]
    pub(super) scenes: Vec<Scene>,
    #[serde(default)]
    pub(super) nodes: Vec<Node>,
    #[serde(default)]
    pub(super) meshes: Vec<Mesh>,
    #[serde(default)]
    pub(super) accessors: Vec<Accessor>,
    #[serde(default)]
    pub(super) buffer_views: Vec<BufferView>,
    #[serde(default)]
    pub(super) buffers: Vec<Buffer>,
    #[serde(default, deserialize_with = "harmful")]
    /// The first one that is not known to be harmless.
    pub(super) extensions_required: Option<String>,
}

#[derive(serde::Deserialize)]
pub(super) struct Scene {
    #[serde(default)]
    pub(super) nodes: Vec<usize>,
}

#[derive(serde::Deserialize)]
pub(super) struct Node {
    pub(super) mesh: Option<usize>,
    #[serde(default)]
    pub(super) children: Vec<usize>,
    pub(super) matrix: Option<Box<[f64; 16]>>,
    pub(super) translation: Option<Box<[f64; 3]>>,
    pub(super) rotation: Option<Box<[f64; 4]>>,
    pub(super) scale: Option<Box<[f64; 3]>>,
    pub(super) skin: Option<usize>,
}

#[derive(serde::Deserialize)]
pub(super) struct Mesh {
    #[serde(default)]
    pub(super) primitives: Vec<Primitive>,
}

#[derive(serde::Deserialize)]
pub(super) struct Primitive {
    #[serde(default)]
    pub(super) attributes: Attributes,
    pub(super) indices: Option<usize>,
    pub(super) mode: Option<u32>,
    pub(super) material: Option<serde::de::IgnoredAny>,
    pub(super) targets: Option<serde::de::IgnoredAny>,
}

#[derive(serde::Deserialize, Default)]
pub(super) struct Attributes {
    #[serde(rename = "POSITION")]
    pub(super) position: Option<usize>,
    #[serde(rename = "NORMAL")]
    pub(super) normal: Option<serde::de::IgnoredAny>,
    #[serde(rename = "TEXCOORD_0")]
    pub(super) texture: Option<usize>,
    #[serde(rename = "COLOR_0")]
    pub(super) color: Option<serde::de::IgnoredAny>,
}

#[derive(serde::Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Accessor {
    pub(super) buffer_view: Option<usize>,
    #[serde(default)]
    pub(super) byte_offset: usize,
    pub(super) component_type: u32,
    #[serde(default)]
    pub(super) normalized: bool,
    pub(super) count: usize,
    #[serde(rename = "type")]
    pub(super) kind: String,
    pub(super) sparse: Option<Box<Sparse>>,
}

/// Some elements of an accessor that are other than the rest.
#[derive(serde::Deserialize)]
pub(super) struct Sparse {
    pub(super) count: usize,
    pub(super) indices: Part,
    pub(super) values: Part,
}

#[derive(serde::Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Part {
    pub(super) buffer_view: usize,
    #[serde(default)]
    pub(super) byte_offset: usize,
    /// Only for indices.
    pub(super) component_type: Option<u32>,
}

#[derive(serde::Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct BufferView {
    pub(super) buffer: usize,
    #[serde(default)]
    pub(super) byte_offset: usize,
    pub(super) byte_length: usize,
    pub(super) byte_stride: Option<usize>,
}

#[derive(serde::Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Buffer {
    pub(super) uri: Option<String>,
    pub(super) byte_length: usize,
}

/// Extensions that a file may demand: these do not change where the triangles are.
const HARMLESS: [&str; 4] = [
    "KHR_mesh_quantization",
    "KHR_texture_",
    "KHR_materials_",
    "EXT_texture_",
];

/// The first extension of a list that is not harmless.
fn harmful<'de, D: Deserializer<'de>>(from: D) -> Result<Option<String>, D::Error> {
    struct Harmful;

    impl<'de> Visitor<'de> for Harmful {
        type Value = Option<String>;

        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str("a list of names")
        }

        fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<Option<String>, A::Error> {
            let mut harmful = None;
            while let Some(Name(name)) = items.next_element()? {
                let is_harmless = HARMLESS.iter().any(|harmless| name.starts_with(harmless));
                if harmful.is_none() && !is_harmless {
                    harmful = Some(name);
                }
            }
            Ok(harmful)
        }
    }

    #[derive(serde::Deserialize)]
    struct Name(String);

    from.deserialize_seq(Harmful)
}

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
    /// Those that are neither read nor known to leave the shape as it is.
    #[serde(default, deserialize_with = "unknown")]
    pub(super) extensions_required: Unknown,
    #[serde(default, deserialize_with = "unknown")]
    pub(super) extensions_used: Unknown,
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
    pub(super) skin: Option<serde::de::IgnoredAny>,
    /// `true` if some weight of a morph target is not 0; nothing if those of the mesh count.
    #[serde(default, deserialize_with = "has_weight")]
    pub(super) weights: Option<bool>,
    pub(super) extensions: Option<Box<NodeExtensions>>,
}

/// Extensions of nodes that are read.
#[derive(serde::Deserialize)]
pub(super) struct NodeExtensions {
    #[serde(rename = "EXT_mesh_gpu_instancing")]
    pub(super) instancing: Option<Instancing>,
    #[serde(rename = "KHR_node_visibility")]
    pub(super) visibility: Option<Visibility>,
}

#[derive(serde::Deserialize)]
pub(super) struct Instancing {
    #[serde(default)]
    pub(super) attributes: InstanceAttributes,
}

/// The accessors that place the instances of a mesh.
#[derive(serde::Deserialize, Default)]
pub(super) struct InstanceAttributes {
    #[serde(rename = "TRANSLATION")]
    pub(super) translation: Option<usize>,
    #[serde(rename = "ROTATION")]
    pub(super) rotation: Option<usize>,
    #[serde(rename = "SCALE")]
    pub(super) scale: Option<usize>,
}

#[derive(serde::Deserialize)]
pub(super) struct Visibility {
    pub(super) visible: Option<bool>,
}

#[derive(serde::Deserialize)]
pub(super) struct Mesh {
    #[serde(default)]
    pub(super) primitives: Vec<Primitive>,
    /// `true` if some weight of a morph target is not 0.
    #[serde(default, deserialize_with = "has_weight")]
    pub(super) weights: Option<bool>,
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

/// Beginnings of the names of extensions that are read, or do not change where the triangles are.
const HARMLESS: [&str; 20] = [
    "KHR_mesh_quantization",
    "EXT_mesh_gpu_instancing",
    "KHR_node_visibility",
    "KHR_texture_",
    "KHR_materials_",
    "KHR_lights_",
    "KHR_xmp",
    "KHR_animation",
    "KHR_audio",
    "KHR_techniques_webgl",
    "KHR_physics_",
    "EXT_texture_",
    "EXT_materials_",
    "EXT_lights_",
    "EXT_mesh_features",
    "EXT_instance_features",
    "EXT_structural_metadata",
    "MSFT_texture_",
    "ADOBE_materials_",
    "MSFT_lod",
];

/// Extensions that pack a mesh. A file that uses one without requiring it has the mesh as it is, too.
pub(super) const PACKING: [&str; 3] = [
    "KHR_draco_mesh_compression",
    "EXT_meshopt_compression",
    "KHR_meshopt_compression",
];

/// The most unknown extensions that are named.
const MAX_NAMED: usize = 3;

/// The first few unknown extensions of a list.
#[derive(Default)]
pub(super) struct Unknown {
    pub(super) names: Vec<String>,
    /// The number of those that are not among `names`.
    pub(super) more: u64,
}

fn unknown<'de, D: Deserializer<'de>>(from: D) -> Result<Unknown, D::Error> {
    struct List;

    impl<'de> Visitor<'de> for List {
        type Value = Unknown;

        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str("a list of names")
        }

        fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<Unknown, A::Error> {
            let mut unknown = Unknown::default();
            while let Some(Name(name)) = items.next_element()? {
                if HARMLESS.iter().any(|harmless| name.starts_with(harmless)) {
                    continue;
                }
                if unknown.names.len() < MAX_NAMED {
                    unknown.names.push(name);
                } else {
                    unknown.more += 1;
                }
            }
            Ok(unknown)
        }
    }

    #[derive(serde::Deserialize)]
    struct Name(String);

    from.deserialize_seq(List)
}

/// Says whether a list of weights has one that is not 0.
fn has_weight<'de, D: Deserializer<'de>>(from: D) -> Result<Option<bool>, D::Error> {
    struct List;

    impl<'de> Visitor<'de> for List {
        type Value = Option<bool>;

        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str("a list of numbers")
        }

        fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<Self::Value, A::Error> {
            let mut found = false;
            while let Some(weight) = items.next_element::<f64>()? {
                found |= weight != 0.0;
            }
            Ok(Some(found))
        }
    }

    from.deserialize_seq(List)
}

//! The JSON of a glTF file: as much of it as tells where triangles are.

use std::fmt;
use std::marker::PhantomData;

use serde::de::{Deserialize, Deserializer, Error as _, SeqAccess, Visitor};

/// The most nodes, meshes, accessors and so on of a file. Some bytes of text become a hundred times as many in memory, so
/// that the limit of bytes alone would allow too much.
const MOST: usize = 1 << 20;

#[derive(serde::Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Document {
    pub(super) scene: Option<usize>,
    #[serde(default, deserialize_with = "few")]
    pub(super) scenes: Vec<Scene>,
    #[serde(default, deserialize_with = "few")]
    pub(super) nodes: Vec<Node>,
    #[serde(default, deserialize_with = "few")]
    pub(super) meshes: Vec<Mesh>,
    #[serde(default, deserialize_with = "few")]
    pub(super) accessors: Vec<Accessor>,
    #[serde(default, deserialize_with = "few")]
    pub(super) buffer_views: Vec<BufferView>,
    #[serde(default, deserialize_with = "few")]
    pub(super) buffers: Vec<Buffer>,
    #[serde(default, deserialize_with = "few")]
    pub(super) extensions_required: Vec<String>,
}

#[derive(serde::Deserialize)]
pub(super) struct Scene {
    #[serde(default, deserialize_with = "few")]
    pub(super) nodes: Vec<usize>,
}

#[derive(serde::Deserialize)]
pub(super) struct Node {
    pub(super) mesh: Option<usize>,
    #[serde(default, deserialize_with = "few")]
    pub(super) children: Vec<usize>,
    pub(super) matrix: Option<Box<[f64; 16]>>,
    pub(super) translation: Option<Box<[f64; 3]>>,
    pub(super) rotation: Option<Box<[f64; 4]>>,
    pub(super) scale: Option<Box<[f64; 3]>>,
    pub(super) skin: Option<usize>,
}

#[derive(serde::Deserialize)]
pub(super) struct Mesh {
    #[serde(default, deserialize_with = "few")]
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

/// A list of at most [`MOST`] things.
fn few<'de, D: Deserializer<'de>, T: Deserialize<'de>>(from: D) -> Result<Vec<T>, D::Error> {
    struct Few<T>(PhantomData<T>);

    impl<'de, T: Deserialize<'de>> Visitor<'de> for Few<T> {
        type Value = Vec<T>;

        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str("a list")
        }

        fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<Vec<T>, A::Error> {
            let mut list = Vec::new();
            while let Some(item) = items.next_element()? {
                if list.len() == MOST {
                    return Err(A::Error::custom(format_args!(
                        "a list has more than {MOST} items"
                    )));
                }
                list.push(item);
            }
            Ok(list)
        }
    }

    from.deserialize_seq(Few(PhantomData))
}

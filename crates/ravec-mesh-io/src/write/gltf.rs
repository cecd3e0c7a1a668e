//! glTF 2.0: one mesh of one primitive, in a GLB file or as JSON with the data inside.

use base64::engine::general_purpose::STANDARD;
use base64::write::EncoderWriter;

use super::{Sink, rounded};
use crate::error::WriteMeshError;
use crate::{LengthUnit, MeshFormat};
use ravec_mesh::MeshRows;

/// The JSON, but for what stands in the braces of its only buffer behind the length.
struct Document {
    before: String,
    after: &'static str,
    /// The length of the buffer.
    bytes: u32,
}

fn document(
    mesh: &dyn MeshRows,
    texture: Option<&[[f32; 2]]>,
    unit: Option<LengthUnit>,
    format: MeshFormat,
) -> Result<Document, WriteMeshError> {
    const ASSET: &str = r#"{"asset":{"version":"2.0","generator":"ravec"},"scene":0"#;
    let (vertices, corners) = (mesh.vertex_count(), 3 * mesh.triangle_count());
    // The format has no buffers without bytes.
    if corners == 0 {
        return Ok(Document {
            before: format!("{ASSET},\"scenes\":[{{}}]}}"),
            after: "",
            bytes: 0,
        });
    }
    let points = 12 * vertices as u64;
    let coordinates = texture.map_or(0, |texture| 8 * texture.len() as u64);
    let total = points + 4 * corners as u64 + coordinates;
    // The JSON takes less than 1024 bytes of the 4 GiB that the lengths in a GLB file can count.
    let bytes = u32::try_from(total)
        .ok()
        .filter(|bytes| bytes.checked_add(1024).is_some());
    let bytes = bytes.ok_or(WriteMeshError::TooLarge {
        format,
        bytes: total,
    })?;
    let (mut least, mut most) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    mesh.for_each_vertex(&mut |at| {
        for (axis, x) in rounded(at).into_iter().enumerate() {
            least[axis] = least[axis].min(x);
            most[axis] = most[axis].max(x);
        }
        Ok(())
    })?;
    let scale = unit.map_or(1.0, LengthUnit::in_meters);
    let scale = if scale == 1.0 {
        String::new()
    } else {
        format!(",\"scale\":[{scale:?},{scale:?},{scale:?}]")
    };
    let (attribute, accessor, view) = if texture.is_some() {
        (
            ",\"TEXCOORD_0\":2",
            format!(
                ",{{\"bufferView\":2,\"componentType\":5126,\"count\":{vertices},\"type\":\"VEC2\"}}"
            ),
            format!(
                ",{{\"buffer\":0,\"byteOffset\":{},\"byteLength\":{coordinates},\"target\":34962}}",
                total - coordinates
            ),
        )
    } else {
        ("", String::new(), String::new())
    };
    let before = format!(
        "{ASSET},\"scenes\":[{{\"nodes\":[0]}}],\"nodes\":[{{\"mesh\":0{scale}}}],\
         \"meshes\":[{{\"primitives\":[{{\"attributes\":{{\"POSITION\":0{attribute}}},\"indices\":1}}]}}],\
         \"accessors\":[{{\"bufferView\":0,\"componentType\":5126,\"count\":{vertices},\"type\":\"VEC3\",\
         \"min\":{least:?},\"max\":{most:?}}},\
         {{\"bufferView\":1,\"componentType\":5125,\"count\":{corners},\"type\":\"SCALAR\"}}{accessor}],\
         \"bufferViews\":[{{\"buffer\":0,\"byteLength\":{points},\"target\":34962}},\
         {{\"buffer\":0,\"byteOffset\":{points},\"byteLength\":{},\"target\":34963}}{view}],\
         \"buffers\":[{{\"byteLength\":{bytes}",
        total - points - coordinates,
    );
    Ok(Document {
        before,
        after: "}]}",
        bytes,
    })
}

fn write_data(
    mesh: &dyn MeshRows,
    texture: Option<&[[f32; 2]]>,
    sink: &mut Sink<'_>,
) -> Result<(), WriteMeshError> {
    sink.vertices(mesh, |buffer, at| {
        buffer.extend_from_slice(rounded(at).map(f32::to_le_bytes).as_flattened());
        Ok(())
    })?;
    sink.triangles(mesh, |buffer, corners, _| {
        buffer.extend_from_slice(corners.map(u32::to_le_bytes).as_flattened());
        Ok(())
    })?;
    sink.more(texture.unwrap_or_default(), |buffer, at| {
        buffer.extend_from_slice(at.map(f32::to_le_bytes).as_flattened());
        Ok(())
    })
}

pub(super) fn write_glb(
    mesh: &dyn MeshRows,
    texture: Option<&[[f32; 2]]>,
    unit: Option<LengthUnit>,
    sink: &mut Sink<'_>,
) -> Result<(), WriteMeshError> {
    let document = document(mesh, texture, unit, MeshFormat::Glb)?;
    let mut json = document.before + document.after;
    json.extend(std::iter::repeat_n(
        ' ',
        json.len().next_multiple_of(4) - json.len(),
    ));
    // All data are 4 bytes wide, so that nothing needs to be padded behind them.
    let data = if document.bytes == 0 {
        0
    } else {
        8 + document.bytes
    };
    let json_bytes = json.len() as u32;
    sink.bytes(b"glTF");
    for word in [2, 12 + 8 + json_bytes + data, json_bytes] {
        sink.bytes(&word.to_le_bytes());
    }
    sink.bytes(b"JSON");
    sink.bytes(json.as_bytes());
    if document.bytes > 0 {
        sink.bytes(&document.bytes.to_le_bytes());
        sink.bytes(b"BIN\0");
        write_data(mesh, texture, sink)?;
    }
    Ok(())
}

pub(super) fn write_gltf(
    mesh: &dyn MeshRows,
    texture: Option<&[[f32; 2]]>,
    unit: Option<LengthUnit>,
    sink: &mut Sink<'_>,
) -> Result<(), WriteMeshError> {
    let document = document(mesh, texture, unit, MeshFormat::Gltf)?;
    sink.bytes(document.before.as_bytes());
    if document.bytes > 0 {
        sink.bytes(b",\"uri\":\"data:application/octet-stream;base64,");
        sink.flush()?;
        let mut encoder = EncoderWriter::new(&mut *sink.writer, &STANDARD);
        let mut data = Sink {
            writer: &mut encoder,
            buffer: std::mem::take(&mut sink.buffer),
            progress: sink.progress,
            phase: sink.phase,
        };
        write_data(mesh, texture, &mut data)?;
        data.flush()?;
        encoder.finish()?;
        drop(encoder);
        sink.bytes(b"\"");
    }
    sink.bytes(document.after.as_bytes());
    sink.bytes(b"\n");
    Ok(())
}

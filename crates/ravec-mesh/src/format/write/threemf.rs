//! 3MF: one object, built once.

use std::io::{self, Write as _};

use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

use super::super::LengthUnit;
use super::super::error::WriteMeshError;
use super::{Sink, WriteOptions, number, whole};
use crate::TriMesh;

const TYPES: &str = r#"<?xml version="1.0" encoding="UTF-8"?>
<Types xmlns="http://schemas.openxmlformats.org/package/2006/content-types">
<Default Extension="rels" ContentType="application/vnd.openxmlformats-package.relationships+xml"/>
<Default Extension="model" ContentType="application/vnd.ms-package.3dmanufacturing-3dmodel+xml"/>
</Types>
"#;

const RELATIONS: &str = r#"<?xml version="1.0" encoding="UTF-8"?>
<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">
<Relationship Target="/3D/3dmodel.model" Id="rel0" Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/>
</Relationships>
"#;

fn failed(error: zip::result::ZipError) -> WriteMeshError {
    match error {
        zip::result::ZipError::Io(error) => WriteMeshError::Io(error),
        other => WriteMeshError::Io(io::Error::other(other)),
    }
}

pub(super) fn write(
    mesh: &TriMesh,
    options: &WriteOptions,
    sink: &mut Sink<'_>,
) -> Result<(), WriteMeshError> {
    // An archive entry above 4 GiB has to be announced as such: at most so many bytes are a vertex and a triangle.
    let most = 130 * mesh.positions().len() as u64 + 80 * mesh.triangles().len() as u64;
    let entry = SimpleFileOptions::default()
        .compression_method(CompressionMethod::Deflated)
        .large_file(most > u64::from(u32::MAX) / 2);
    let mut archive = ZipWriter::new_stream(&mut *sink.writer);
    for (name, content) in [("[Content_Types].xml", TYPES), ("_rels/.rels", RELATIONS)] {
        archive.start_file(name, entry).map_err(failed)?;
        archive.write_all(content.as_bytes())?;
    }
    archive
        .start_file("3D/3dmodel.model", entry)
        .map_err(failed)?;
    let mut model = Sink {
        writer: &mut archive,
        buffer: std::mem::take(&mut sink.buffer),
        progress: sink.progress,
        phase: sink.phase,
    };
    write_model(mesh, options, &mut model)?;
    model.flush()?;
    archive.finish().map_err(failed)?;
    Ok(())
}

fn write_model(
    mesh: &TriMesh,
    options: &WriteOptions,
    sink: &mut Sink<'_>,
) -> Result<(), WriteMeshError> {
    let unit = options.unit.unwrap_or(LengthUnit::Millimeter);
    let head = format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n\
         <model unit=\"{unit}\" xml:lang=\"en-US\" xmlns=\"http://schemas.microsoft.com/3dmanufacturing/core/2015/02\">\n\
         <resources>\n"
    );
    sink.bytes(head.as_bytes());
    // The format has no meshes without triangles.
    let is_empty = mesh.triangles().is_empty();
    if !is_empty {
        sink.bytes(b"<object id=\"1\" type=\"model\"><mesh>\n<vertices>\n");
        sink.rows(mesh.positions(), |buffer, &at| {
            for (name, x) in ["<vertex x=\"", "\" y=\"", "\" z=\""]
                .iter()
                .zip(at.to_array())
            {
                buffer.extend_from_slice(name.as_bytes());
                number(buffer, x, options.precision)?;
            }
            buffer.extend_from_slice(b"\"/>\n");
            Ok(())
        })?;
        sink.bytes(b"</vertices>\n<triangles>\n");
        sink.rows(mesh.triangles(), |buffer, &corners| {
            for (name, v) in ["<triangle v1=\"", "\" v2=\"", "\" v3=\""]
                .iter()
                .zip(corners)
            {
                buffer.extend_from_slice(name.as_bytes());
                whole(buffer, v);
            }
            buffer.extend_from_slice(b"\"/>\n");
            Ok(())
        })?;
        sink.bytes(b"</triangles>\n</mesh></object>\n");
    }
    sink.bytes(b"</resources>\n<build>");
    if !is_empty {
        sink.bytes(b"<item objectid=\"1\"/>");
    }
    sink.bytes(b"</build>\n</model>\n");
    Ok(())
}

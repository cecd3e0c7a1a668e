//! OBJ and OFF.

use super::super::error::WriteMeshError;
use super::{Precision, Sink, point, whole};
use crate::TriMesh;

pub(super) fn write_obj(
    mesh: &TriMesh,
    precision: Precision,
    sink: &mut Sink<'_>,
) -> Result<(), WriteMeshError> {
    sink.rows(mesh.positions(), |buffer, &at| {
        buffer.extend_from_slice(b"v ");
        point(buffer, at, precision)?;
        buffer.push(b'\n');
        Ok(())
    })?;
    sink.rows(mesh.triangles(), |buffer, &corners| {
        buffer.push(b'f');
        for corner in corners {
            buffer.push(b' ');
            // Cannot overflow: there are at most u32::MAX vertices.
            whole(buffer, corner + 1);
        }
        buffer.push(b'\n');
        Ok(())
    })?;
    if mesh.positions().is_empty() {
        sink.bytes(b"# no vertices\n");
    }
    Ok(())
}

pub(super) fn write_off(
    mesh: &TriMesh,
    precision: Precision,
    sink: &mut Sink<'_>,
) -> Result<(), WriteMeshError> {
    let (vertices, triangles) = (mesh.positions().len(), mesh.triangles().len());
    sink.bytes(format!("OFF\n{vertices} {triangles} 0\n").as_bytes());
    sink.rows(mesh.positions(), |buffer, &at| {
        point(buffer, at, precision)?;
        buffer.push(b'\n');
        Ok(())
    })?;
    sink.rows(mesh.triangles(), |buffer, &corners| {
        buffer.push(b'3');
        for corner in corners {
            buffer.push(b' ');
            whole(buffer, corner);
        }
        buffer.push(b'\n');
        Ok(())
    })
}

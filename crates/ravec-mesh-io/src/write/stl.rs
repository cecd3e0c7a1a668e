//! STL, binary and ASCII.
//!
//! Coordinates of the binary form are rounded to 32-bit floats, so that vertices closer to one another than their spacing
//! (1 part in 10⁷) become one when the file is read. Normals are those of the exact triangles, zero for those without
//! area.

use std::io::Write as _;

use glam::DVec3;

use super::{Precision, Sink, point, rounded};
use crate::error::WriteMeshError;
use ravec_mesh::MeshRows;

fn normal([a, b, c]: [DVec3; 3]) -> [f32; 3] {
    rounded((b - a).cross(c - a).normalize_or_zero())
}

pub(super) fn write_binary(mesh: &dyn MeshRows, sink: &mut Sink<'_>) -> Result<(), WriteMeshError> {
    // Must not begin with `solid`, which is the mark of the text form.
    let mut header = [b' '; 80];
    header[..17].copy_from_slice(b"binary STL, ravec");
    sink.bytes(&header);
    // A mesh never has more triangles than fit.
    sink.bytes(&(mesh.triangle_count() as u32).to_le_bytes());
    sink.triangles(mesh, |buffer, _, corners| {
        let mut row = [0; 50];
        let [a, b, c] = corners.map(rounded);
        let numbers = [normal(corners), a, b, c];
        let words = row.as_chunks_mut::<4>().0;
        for (word, number) in words.iter_mut().zip(numbers.as_flattened()) {
            *word = number.to_le_bytes();
        }
        buffer.extend_from_slice(&row);
        Ok(())
    })
}

pub(super) fn write_ascii(
    mesh: &dyn MeshRows,
    precision: Precision,
    sink: &mut Sink<'_>,
) -> Result<(), WriteMeshError> {
    sink.bytes(b"solid ravec\n");
    sink.triangles(mesh, |buffer, _, corners| {
        let [x, y, z] = normal(corners);
        write!(buffer, "facet normal {x:?} {y:?} {z:?}\n outer loop\n")?;
        for corner in corners {
            buffer.extend_from_slice(b"  vertex ");
            point(buffer, corner, precision)?;
            buffer.push(b'\n');
        }
        buffer.extend_from_slice(b" endloop\nendfacet\n");
        Ok(())
    })?;
    sink.bytes(b"endsolid ravec\n");
    Ok(())
}

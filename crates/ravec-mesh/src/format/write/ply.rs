//! PLY, little-endian and ASCII.

use super::super::error::WriteMeshError;
use super::{Precision, Sink, point, rounded, whole};
use crate::TriMesh;

/// Whether 32-bit floats are to be written: if asked for, or if they hold all coordinates exactly.
fn is_single(mesh: &TriMesh, precision: Precision) -> bool {
    let holds = |x: f64| f64::from(x as f32) == x;
    precision == Precision::Single
        || mesh
            .positions()
            .iter()
            .all(|at| at.to_array().into_iter().all(holds))
}

fn header(mesh: &TriMesh, encoding: &str, single: bool, sink: &mut Sink<'_>) {
    let float = if single { "float" } else { "double" };
    let header = format!(
        "ply\nformat {encoding} 1.0\nelement vertex {}\n\
         property {float} x\nproperty {float} y\nproperty {float} z\n\
         element face {}\nproperty list uchar int vertex_indices\nend_header\n",
        mesh.positions().len(),
        mesh.triangles().len(),
    );
    // Many programs read indices as signed numbers and know no other type.
    let header = if i32::try_from(mesh.positions().len()).is_ok() {
        header
    } else {
        header.replace("uchar int", "uchar uint")
    };
    sink.bytes(header.as_bytes());
}

pub(super) fn write_binary(
    mesh: &TriMesh,
    precision: Precision,
    sink: &mut Sink<'_>,
) -> Result<(), WriteMeshError> {
    let single = is_single(mesh, precision);
    header(mesh, "binary_little_endian", single, sink);
    sink.rows(mesh.positions(), |buffer, &at| {
        if single {
            let row = rounded(at).map(f32::to_le_bytes);
            buffer.extend_from_slice(row.as_flattened());
        } else {
            let row = at.to_array().map(f64::to_le_bytes);
            buffer.extend_from_slice(row.as_flattened());
        }
        Ok(())
    })?;
    sink.rows(mesh.triangles(), |buffer, &corners| {
        let mut row = [3; 13];
        row[1..].copy_from_slice(corners.map(u32::to_le_bytes).as_flattened());
        buffer.extend_from_slice(&row);
        Ok(())
    })
}

pub(super) fn write_ascii(
    mesh: &TriMesh,
    precision: Precision,
    sink: &mut Sink<'_>,
) -> Result<(), WriteMeshError> {
    header(mesh, "ascii", is_single(mesh, precision), sink);
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

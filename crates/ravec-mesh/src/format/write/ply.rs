//! PLY, little-endian and ASCII.

use super::super::error::WriteMeshError;
use super::{Precision, Sink, point, rounded, whole};
use crate::TriMesh;
use glam::DVec3;

/// Whether 32-bit floats are to be written: if asked for, or if they hold all coordinates exactly.
fn is_single(mesh: &TriMesh, precision: Precision) -> bool {
    let holds = |x: f64| f64::from(x as f32) == x;
    precision == Precision::Single
        || mesh
            .positions()
            .iter()
            .all(|at| at.to_array().into_iter().all(holds))
}

fn header(mesh: &TriMesh, colored: bool, encoding: &str, single: bool, sink: &mut Sink<'_>) {
    let float = if single { "float" } else { "double" };
    let colors = if colored {
        "property uchar red\nproperty uchar green\nproperty uchar blue\nproperty uchar alpha\n"
    } else {
        ""
    };
    let header = format!(
        "ply\nformat {encoding} 1.0\nelement vertex {}\n\
         property {float} x\nproperty {float} y\nproperty {float} z\n{colors}\
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

/// The vertices, each with its color if it has one.
fn vertices<'a>(
    mesh: &'a TriMesh,
    colors: Option<&'a [[u8; 4]]>,
) -> impl Iterator<Item = (DVec3, Option<[u8; 4]>)> {
    let colors = colors.unwrap_or_default().iter().copied().map(Some);
    let colors = colors.chain(std::iter::repeat(None));
    mesh.positions().iter().copied().zip(colors)
}

pub(super) fn write_binary(
    mesh: &TriMesh,
    colors: Option<&[[u8; 4]]>,
    precision: Precision,
    sink: &mut Sink<'_>,
) -> Result<(), WriteMeshError> {
    let single = is_single(mesh, precision);
    header(mesh, colors.is_some(), "binary_little_endian", single, sink);
    sink.rows(vertices(mesh, colors), |buffer, (at, color)| {
        if single {
            let row = rounded(at).map(f32::to_le_bytes);
            buffer.extend_from_slice(row.as_flattened());
        } else {
            let row = at.to_array().map(f64::to_le_bytes);
            buffer.extend_from_slice(row.as_flattened());
        }
        buffer.extend(color.into_iter().flatten());
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
    colors: Option<&[[u8; 4]]>,
    precision: Precision,
    sink: &mut Sink<'_>,
) -> Result<(), WriteMeshError> {
    header(
        mesh,
        colors.is_some(),
        "ascii",
        is_single(mesh, precision),
        sink,
    );
    sink.rows(vertices(mesh, colors), |buffer, (at, color)| {
        point(buffer, at, precision)?;
        for level in color.into_iter().flatten() {
            buffer.push(b' ');
            whole(buffer, level.into());
        }
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

//! PLY, little-endian and ASCII.

use ravec_progress::Progress;

use super::{AT_ONCE, Precision, Sink, point, rounded, whole};
use crate::error::WriteMeshError;
use ravec_mesh::MeshRows;

/// Returns `true` if 32-bit floats are to be written: on request, or if they hold all coordinates exactly.
fn is_single(
    mesh: &dyn MeshRows,
    precision: Precision,
    progress: &Progress,
) -> Result<bool, WriteMeshError> {
    if precision == Precision::Single {
        return Ok(true);
    }
    let holds = |x: f64| f64::from(x as f32) == x;
    let (mut all, mut vertex) = (true, 0_usize);
    mesh.for_each_vertex(&mut |at| {
        if vertex.is_multiple_of(AT_ONCE) {
            progress.check()?;
        }
        vertex += 1;
        all = all && at.to_array().into_iter().all(holds);
        Ok(())
    })?;
    Ok(all)
}

fn header(mesh: &dyn MeshRows, colored: bool, encoding: &str, single: bool, sink: &mut Sink<'_>) {
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
        mesh.vertex_count(),
        mesh.triangle_count(),
    );
    // Many programs read indices as signed numbers and know no other type.
    let header = if i32::try_from(mesh.vertex_count()).is_ok() {
        header
    } else {
        header.replace("uchar int", "uchar uint")
    };
    sink.bytes(header.as_bytes());
}

/// The colors of the vertices, none where there are none.
fn colors_of(colors: Option<&[[u8; 4]]>) -> impl Iterator<Item = [u8; 4]> + '_ {
    colors.unwrap_or_default().iter().copied()
}

pub(super) fn write_binary(
    mesh: &dyn MeshRows,
    colors: Option<&[[u8; 4]]>,
    precision: Precision,
    sink: &mut Sink<'_>,
) -> Result<(), WriteMeshError> {
    let single = is_single(mesh, precision, sink.progress)?;
    header(mesh, colors.is_some(), "binary_little_endian", single, sink);
    let mut colors = colors_of(colors);
    sink.vertices(mesh, |buffer, at| {
        if single {
            let row = rounded(at).map(f32::to_le_bytes);
            buffer.extend_from_slice(row.as_flattened());
        } else {
            let row = at.to_array().map(f64::to_le_bytes);
            buffer.extend_from_slice(row.as_flattened());
        }
        buffer.extend(colors.next().into_iter().flatten());
        Ok(())
    })?;
    sink.triangles(mesh, |buffer, corners, _| {
        let mut row = [3; 13];
        row[1..].copy_from_slice(corners.map(u32::to_le_bytes).as_flattened());
        buffer.extend_from_slice(&row);
        Ok(())
    })
}

pub(super) fn write_ascii(
    mesh: &dyn MeshRows,
    colors: Option<&[[u8; 4]]>,
    precision: Precision,
    sink: &mut Sink<'_>,
) -> Result<(), WriteMeshError> {
    header(
        mesh,
        colors.is_some(),
        "ascii",
        is_single(mesh, precision, sink.progress)?,
        sink,
    );
    let mut colors = colors_of(colors);
    sink.vertices(mesh, |buffer, at| {
        point(buffer, at, precision)?;
        for level in colors.next().into_iter().flatten() {
            buffer.push(b' ');
            whole(buffer, level.into());
        }
        buffer.push(b'\n');
        Ok(())
    })?;
    sink.triangles(mesh, |buffer, corners, _| {
        buffer.push(b'3');
        for corner in corners {
            buffer.push(b' ');
            whole(buffer, corner);
        }
        buffer.push(b'\n');
        Ok(())
    })
}

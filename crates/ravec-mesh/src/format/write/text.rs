//! OBJ and OFF.

use glam::DVec2;
use rustc_hash::FxHashMap;

use super::super::error::WriteMeshError;
use super::{Precision, Sink, number, point, whole};
use crate::TriMesh;

/// Texture coordinates, each once, and which of them the corners of triangles have, from 1; 0 for none.
struct Texture {
    coordinates: Vec<DVec2>,
    of_corners: Vec<[u32; 3]>,
}

impl Texture {
    fn of(corners: &[[DVec2; 3]]) -> Self {
        let mut names: FxHashMap<[u64; 2], u32> = FxHashMap::default();
        let mut coordinates = Vec::new();
        let of_corners = corners.iter().map(|corners| {
            corners.map(|at| {
                if at.is_nan() {
                    return 0;
                }
                *names
                    .entry(at.to_array().map(f64::to_bits))
                    .or_insert_with(|| {
                        coordinates.push(at);
                        coordinates.len() as u32
                    })
            })
        });
        let of_corners = of_corners.collect();
        Self {
            coordinates,
            of_corners,
        }
    }
}

pub(super) fn write_obj(
    mesh: &TriMesh,
    texture: Option<&[[DVec2; 3]]>,
    precision: Precision,
    sink: &mut Sink<'_>,
) -> Result<(), WriteMeshError> {
    let texture = texture.map(Texture::of);
    sink.rows(mesh.positions(), |buffer, &at| {
        buffer.extend_from_slice(b"v ");
        point(buffer, at, precision)?;
        buffer.push(b'\n');
        Ok(())
    })?;
    let coordinates = texture.iter().flat_map(|texture| &texture.coordinates);
    sink.more(coordinates, |buffer, at| {
        buffer.extend_from_slice(b"vt ");
        number(buffer, at.x, precision)?;
        buffer.push(b' ');
        number(buffer, at.y, precision)?;
        buffer.push(b'\n');
        Ok(())
    })?;
    let of_corners = texture.iter().flat_map(|texture| &texture.of_corners);
    let of_corners = of_corners.copied().chain(std::iter::repeat([0; 3]));
    sink.rows(
        mesh.triangles().iter().zip(of_corners),
        |buffer, (corners, texture)| {
            buffer.push(b'f');
            for (corner, at) in corners.iter().zip(texture) {
                buffer.push(b' ');
                // Cannot overflow: there are at most u32::MAX vertices.
                whole(buffer, corner + 1);
                if at > 0 {
                    buffer.push(b'/');
                    whole(buffer, at);
                }
            }
            buffer.push(b'\n');
            Ok(())
        },
    )?;
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

//! OBJ and OFF.

use glam::DVec2;
use ravec_progress::{Cancelled, Progress};

use super::{AT_ONCE, Precision, Sink, number, point, whole};
use crate::error::WriteMeshError;
use ravec_mesh::KeyedMap;
use ravec_mesh::MeshRows;

/// Texture coordinates, each once, and which of them the corners of triangles have, from 1; 0 for none.
struct Texture {
    coordinates: Vec<DVec2>,
    of_corners: Vec<[u32; 3]>,
}

impl Texture {
    fn of(corners: &[[DVec2; 3]], progress: &Progress) -> Result<Self, Cancelled> {
        let mut names: KeyedMap<[u64; 2], u32> = KeyedMap::default();
        let mut coordinates = Vec::new();
        let of_corners = corners.iter().enumerate().map(|(t, corners)| {
            if t.is_multiple_of(AT_ONCE) {
                progress.check()?;
            }
            Ok(corners.map(|at| {
                if at.is_nan() {
                    return 0;
                }
                *names
                    .entry(at.to_array().map(f64::to_bits))
                    .or_insert_with(|| {
                        coordinates.push(at);
                        coordinates.len() as u32
                    })
            }))
        });
        let of_corners = of_corners.collect::<Result<_, Cancelled>>()?;
        Ok(Self {
            coordinates,
            of_corners,
        })
    }
}

pub(super) fn write_obj(
    mesh: &dyn MeshRows,
    texture: Option<&[[DVec2; 3]]>,
    precision: Precision,
    sink: &mut Sink<'_>,
) -> Result<(), WriteMeshError> {
    let texture = texture.map(|texture| Texture::of(texture, sink.progress));
    let texture = texture.transpose()?;
    sink.vertices(mesh, |buffer, at| {
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
    let mut of_corners = of_corners.copied();
    sink.triangles(mesh, |buffer, corners, _| {
        buffer.push(b'f');
        for (corner, at) in corners
            .into_iter()
            .zip(of_corners.next().unwrap_or_default())
        {
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
    })?;
    if mesh.vertex_count() == 0 {
        sink.bytes(b"# no vertices\n");
    }
    Ok(())
}

pub(super) fn write_off(
    mesh: &dyn MeshRows,
    precision: Precision,
    sink: &mut Sink<'_>,
) -> Result<(), WriteMeshError> {
    let (vertices, triangles) = (mesh.vertex_count(), mesh.triangle_count());
    sink.bytes(format!("OFF\n{vertices} {triangles} 0\n").as_bytes());
    sink.vertices(mesh, |buffer, at| {
        point(buffer, at, precision)?;
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

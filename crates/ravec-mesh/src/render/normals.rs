//! Normals for shading: smooth where the surface bends little, sharp at creases.
//!
//! The normal of a corner is the mean of those of the triangles around its vertex, weighted by their angles there (so that
//! it does not depend on how a plane was cut in triangles), of those whose normals are within the limit of its own.
//! Flipped neighbors are thus left out.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::camera::Projector;
use crate::TriMesh;

/// The unit normals of the corners of each triangle, in the coordinates of the view.
///
/// With `smooth_angle_deg` zero they are those of the triangles. Triangles without area have normals of zero.
pub(super) fn corner_normals(
    mesh: &TriMesh,
    projector: &Projector,
    smooth_angle_deg: f64,
) -> Vec<[Vec3; 3]> {
    let triangles = 0..mesh.triangles().len() as u32;
    let faces: Vec<Face> = triangles
        .clone()
        .into_par_iter()
        .map(|triangle| Face::new(mesh.corners(triangle), projector))
        .collect();
    if smooth_angle_deg <= 0.0 {
        return faces.iter().map(|face| [face.normal; 3]).collect();
    }
    let (first, around) = corners_by_vertex(mesh);
    let limit = smooth_angle_deg.to_radians().cos() as f32;
    triangles
        .into_par_iter()
        .map(|triangle| {
            let own = faces[triangle as usize].normal;
            mesh.triangles()[triangle as usize].map(|vertex| {
                let range = first[vertex as usize] as usize..first[vertex as usize + 1] as usize;
                // A fan of thousands is no smooth surface, and would take its square in time.
                if range.len() > MOST_AROUND {
                    return own;
                }
                let sum: Vec3 = around[range]
                    .iter()
                    .map(|&corner| {
                        let face = &faces[corner as usize / 3];
                        if face.normal.dot(own) >= limit {
                            face.angles[corner as usize % 3] * face.normal
                        } else {
                            Vec3::ZERO
                        }
                    })
                    .sum();
                sum.try_normalize().unwrap_or(own)
            })
        })
        .collect()
}

/// Most corners at a vertex that are averaged.
const MOST_AROUND: usize = 256;

struct Face {
    normal: Vec3,
    angles: [f32; 3],
}

impl Face {
    fn new(corners: [DVec3; 3], projector: &Projector) -> Self {
        let [a, b, c] = corners;
        let normal = (b - a).cross(c - a).normalize_or_zero();
        let angles = [0, 1, 2].map(|i| {
            let (to, back) = (
                (corners[(i + 1) % 3] - corners[i]).as_vec3(),
                (corners[(i + 2) % 3] - corners[i]).as_vec3(),
            );
            let cos = to.dot(back) / (to.length_squared() * back.length_squared()).sqrt();
            if cos.is_nan() {
                0.0
            } else {
                cos.clamp(-1.0, 1.0).acos()
            }
        });
        Self {
            normal: projector.turned(normal).as_vec3(),
            angles,
        }
    }
}

/// For each vertex where its corners start, and the corners (three times the triangle, plus which), by vertex.
fn corners_by_vertex(mesh: &TriMesh) -> (Vec<u32>, Vec<u32>) {
    let mut first = vec![0_u32; mesh.positions().len() + 1];
    for &vertex in mesh.triangles().iter().flatten() {
        first[vertex as usize + 1] += 1;
    }
    for i in 1..first.len() {
        first[i] += first[i - 1];
    }
    let mut next = first.clone();
    let mut around = vec![0; 3 * mesh.triangles().len()];
    for (corner, &vertex) in mesh.triangles().iter().flatten().enumerate() {
        around[next[vertex as usize] as usize] = corner as u32;
        next[vertex as usize] += 1;
    }
    (first, around)
}

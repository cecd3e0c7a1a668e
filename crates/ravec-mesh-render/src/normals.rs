//! Normals for shading: smooth where the surface bends little, sharp at creases.
//!
//! The normal of a corner is the mean of those of the triangles around its vertex, weighted by their angles there (so that
//! it does not depend on how a plane was cut in triangles), of those whose normals are within the limit of its own.
//! Flipped neighbors are thus left out.

use glam::{DVec3, Vec3};
use ravec_progress::{Cancelled, Progress};

use ravec_mesh::TriMesh;
use ravec_mesh::par_collect;

/// The unit normals of the corners of each triangle.
///
/// With `smooth_angle_deg` zero they are those of the triangles. Triangles without area have normals of zero.
pub(super) fn corner_normals(
    mesh: &TriMesh,
    smooth_angle_deg: f64,
    progress: &Progress,
) -> Result<Vec<[Vec3; 3]>, Cancelled> {
    let count = mesh.triangles().len();
    let faces = par_collect(count, progress, |triangle| {
        [Face::new(mesh.corners(triangle))]
    })?;
    if smooth_angle_deg <= 0.0 {
        return par_collect(count, progress, |triangle| {
            [[faces[triangle as usize].normal; 3]]
        });
    }
    let (first, around) = corners_by_vertex(mesh, progress)?;
    let limit = smooth_angle_deg.to_radians().cos() as f32;
    par_collect(count, progress, |triangle| {
        let own = faces[triangle as usize].normal;
        [mesh.triangles()[triangle as usize].map(|vertex| {
            let range = first[vertex as usize] as usize..first[vertex as usize + 1] as usize;
            // A fan of thousands is no smooth surface, and would take its square in time.
            if range.len() > MAX_AROUND {
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
        })]
    })
}

/// Most corners at a vertex that are averaged.
const MAX_AROUND: usize = 256;

struct Face {
    normal: Vec3,
    angles: [f32; 3],
}

impl Face {
    fn new(corners: [DVec3; 3]) -> Self {
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
            normal: normal.as_vec3(),
            angles,
        }
    }
}

/// For each vertex where its corners start, and the corners (three times the triangle, plus which), by vertex.
fn corners_by_vertex(
    mesh: &TriMesh,
    progress: &Progress,
) -> Result<(Vec<u32>, Vec<u32>), Cancelled> {
    const AT_ONCE: usize = 1 << 16;
    let mut first = vec![0_u32; mesh.positions().len() + 1];
    for block in mesh.triangles().chunks(AT_ONCE) {
        progress.check()?;
        for &vertex in block.iter().flatten() {
            first[vertex as usize + 1] += 1;
        }
    }
    for i in 1..first.len() {
        first[i] += first[i - 1];
    }
    let mut next = first.clone();
    let mut around = vec![0; 3 * mesh.triangles().len()];
    for (corner, &vertex) in mesh.triangles().iter().flatten().enumerate() {
        if corner % AT_ONCE == 0 {
            progress.check()?;
        }
        around[next[vertex as usize] as usize] = corner as u32;
        next[vertex as usize] += 1;
    }
    Ok((first, around))
}

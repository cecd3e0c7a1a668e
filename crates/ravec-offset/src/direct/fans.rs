//! The triangles around each vertex and the angles at edges of a closed mesh.

use glam::DVec3;
use ravec_mesh::TriMesh;
use ravec_progress::{Cancelled, Progress};
use rustc_hash::FxHashMap;

/// An edge, with the triangles on both sides.
#[derive(Debug, Clone, Copy)]
pub(super) struct Turn {
    /// Ends, as the triangle on its left has them.
    pub ends: [u32; 2],
    /// The triangle on the left, and that on the right.
    pub triangles: [u32; 2],
    /// Angle by which the surface turns in radians: positive where it is convex.
    pub angle: f64,
    pub length: f64,
}

/// A closed, oriented and manifold mesh whose triangles have areas.
pub(super) struct Fans {
    /// Unit normals of the triangles.
    pub normals: Vec<DVec3>,
    pub edges: Vec<Turn>,
    /// For each vertex, the numbers of its edges in counterclockwise order, as seen from outside.
    pub around: Vec<Vec<u32>>,
}

/// Cosine between normals below which faces lie back to back.
const BACK_TO_BACK: f64 = -0.985;

impl Fans {
    /// Examines a mesh; `None` if it is not such a mesh.
    pub fn of(mesh: &TriMesh, progress: &Progress) -> Result<Option<Self>, Cancelled> {
        let triangles = mesh.triangles();
        let mut normals = Vec::with_capacity(triangles.len());
        for t in 0..triangles.len() as u32 {
            let [a, b, c] = mesh.corners(t);
            let normal = (b - a).cross(c - a).normalize_or_zero();
            if normal == DVec3::ZERO {
                return Ok(None);
            }
            normals.push(normal);
        }
        progress.check()?;
        // the triangle on the left of each directed edge
        let mut left_of: FxHashMap<[u32; 2], u32> = FxHashMap::default();
        left_of.reserve(3 * triangles.len());
        for (t, &[a, b, c]) in (0u32..).zip(triangles) {
            for edge in [[a, b], [b, c], [c, a]] {
                if left_of.insert(edge, t).is_some() {
                    return Ok(None);
                }
            }
        }
        progress.check()?;
        let mut edges = Vec::with_capacity(3 * triangles.len() / 2);
        let mut number_of: FxHashMap<[u32; 2], u32> = FxHashMap::default();
        number_of.reserve(3 * triangles.len() / 2);
        for (left, &[a, b, c]) in (0u32..).zip(triangles) {
            for ends in [[a, b], [b, c], [c, a]] {
                let [from, to] = ends;
                let Some(&right) = left_of.get(&[to, from]) else {
                    return Ok(None);
                };
                if from > to {
                    continue;
                }
                let along = mesh.positions()[to as usize] - mesh.positions()[from as usize];
                let [l, r] = [left, right].map(|t| normals[t as usize]);
                let (cross, dot) = (r.cross(l), r.dot(l));
                if dot < BACK_TO_BACK {
                    return Ok(None);
                }
                let angle = cross.length().atan2(dot);
                number_of.insert(ends, edges.len() as u32);
                edges.push(Turn {
                    ends,
                    triangles: [left, right],
                    angle: if cross.dot(along) < 0.0 {
                        angle
                    } else {
                        -angle
                    },
                    length: along.length(),
                });
            }
        }
        progress.check()?;
        Ok(around(mesh, &left_of, &number_of).map(|around| Self {
            normals,
            edges,
            around,
        }))
    }
}

/// The edges around each vertex; `None` if triangles form several fans at one.
fn around(
    mesh: &TriMesh,
    left_of: &FxHashMap<[u32; 2], u32>,
    number_of: &FxHashMap<[u32; 2], u32>,
) -> Option<Vec<Vec<u32>>> {
    let mut degree = vec![0; mesh.positions().len()];
    let mut first = vec![u32::MAX; mesh.positions().len()];
    for &[a, b, c] in mesh.triangles() {
        for [v, next] in [[a, b], [b, c], [c, a]] {
            degree[v as usize] += 1;
            first[v as usize] = next;
        }
    }
    let of_vertex = |(v, (&degree, &first)): (u32, (&usize, &u32))| {
        let mut edges = Vec::with_capacity(degree);
        let mut other = first;
        while edges.len() < degree {
            edges.push(*number_of.get(&[v.min(other), v.max(other)])?);
            // the next edge is the other one of the triangle on the left
            let &t = left_of.get(&[v, other])?;
            let corners = mesh.triangles()[t as usize];
            let at = corners.iter().position(|&corner| corner == v)?;
            other = corners[(at + 2) % 3];
            if other == first {
                break;
            }
        }
        (edges.len() == degree && (degree == 0 || other == first)).then_some(edges)
    };
    (0u32..)
        .zip(degree.iter().zip(&first))
        .map(of_vertex)
        .collect()
}

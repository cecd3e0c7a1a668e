//! The moved triangles, joined by strips along edges and the patches at vertices.

use super::Shape;
use super::corner::{MovedCorner, Vertex};
use super::fans::{Fans, Turn};
use super::unfold::unfold;
use crate::domain::Field;
use crate::params::Coordinates;
use glam::DVec3;
use ravec_mesh::TriMesh;
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;

/// A moved surface.
#[derive(Debug, Default)]
pub(super) struct Moved {
    pub positions: Vec<DVec3>,
    pub triangles: Vec<[u32; 3]>,
    /// A triangle of the mesh close to each of them.
    pub bases: Vec<u32>,
}

impl Moved {
    /// Adds another one.
    pub fn add(&mut self, other: Self) {
        let first = self.positions.len() as u32;
        self.positions.extend(other.positions);
        let triangles = other.triangles.into_iter();
        self.triangles
            .extend(triangles.map(|t| t.map(|v| v + first)));
        self.bases.extend(other.bases);
    }

    fn push(&mut self, base: u32, triangle: [u32; 3]) {
        self.triangles.push(triangle);
        self.bases.push(base);
    }
}

/// The corners of a mesh, with the numbers of their first points.
struct Corners<'a> {
    fans: &'a Fans,
    of_vertex: Vec<MovedCorner>,
    first: Vec<u32>,
}

impl Corners<'_> {
    /// The point at a vertex of the triangle on the left of an edge from there.
    fn point(&self, v: u32, edge: u32) -> u32 {
        let of_triangle = &self.of_vertex[v as usize].of_triangle;
        self.first[v as usize] + of_triangle[self.place(v, edge)]
    }

    fn place(&self, v: u32, edge: u32) -> usize {
        let around = &self.fans.around[v as usize];
        let found = around.iter().position(|&other| other == edge);
        found.expect("edges are around their ends")
    }

    /// The points at a vertex across an edge, counterclockwise.
    fn arc(&self, v: u32, edge: u32) -> impl DoubleEndedIterator<Item = u32> + '_ {
        let arc = &self.of_vertex[v as usize].arcs[self.place(v, edge)];
        arc.iter().map(move |&point| self.first[v as usize] + point)
    }
}

/// Moves a mesh to the side that its triangles face; `None` if some vertex cannot be moved.
pub(super) fn moved(
    mesh: &TriMesh,
    fans: &Fans,
    shape: &Shape,
    field: &Field<'_>,
    coordinates: Coordinates,
    progress: &Progress,
) -> Result<Option<Moved>, Cancelled> {
    let of_vertex: Option<Vec<MovedCorner>> = (0..mesh.positions().len() as u32)
        .into_par_iter()
        .map(|v| {
            progress.check()?;
            Ok(corner(mesh, fans, v, shape, field))
        })
        .collect::<Result<_, Cancelled>>()?;
    let Some(of_vertex) = of_vertex else {
        return Ok(None);
    };
    let mut first = Vec::with_capacity(of_vertex.len());
    let mut moved = Moved::default();
    for corner in &of_vertex {
        first.push(moved.positions.len() as u32);
        let points = corner.points.iter();
        moved
            .positions
            .extend(points.map(|&p| coordinates.nearest(p)));
    }
    let corners = Corners {
        fans,
        of_vertex,
        first,
    };
    for (v, corner) in corners.of_vertex.iter().enumerate() {
        let Some(&edge) = fans.around[v].first() else {
            continue;
        };
        let base = fans.edges[edge as usize].triangles[0];
        for t in &corner.patch {
            moved.push(base, t.map(|point| corners.first[v] + point));
        }
    }
    progress.check()?;
    let mut faces = vec![[0; 3]; mesh.triangles().len()];
    for (edge, turn) in (0u32..).zip(&fans.edges) {
        strip(&corners, edge, turn, &mut moved);
        let Turn {
            ends: [a, b],
            triangles: [left, right],
            ..
        } = *turn;
        for (t, v) in [(left, a), (right, b)] {
            let at = mesh.triangles()[t as usize]
                .iter()
                .position(|&corner| corner == v);
            let at = at.expect("the triangle has the edge");
            faces[t as usize][at] = corners.point(v, edge);
        }
    }
    let first_face = moved.triangles.len();
    for (t, face) in (0u32..).zip(faces) {
        moved.push(t, face);
    }
    unfold(&mut moved, first_face, &fans.normals);
    Ok(Some(moved))
}

/// Moves a vertex.
fn corner(
    mesh: &TriMesh,
    fans: &Fans,
    v: u32,
    shape: &Shape,
    field: &Field<'_>,
) -> Option<MovedCorner> {
    let around = &fans.around[v as usize];
    let edges = || around.iter().map(|&edge| &fans.edges[edge as usize]);
    let left = |edge: &Turn| edge.triangles[usize::from(edge.ends[0] != v)];
    let Some(hint) = edges().next().map(left) else {
        return Some(MovedCorner::default());
    };
    let normals: Vec<DVec3> = edges()
        .map(|edge| fans.normals[left(edge) as usize])
        .collect();
    let angles: Vec<f64> = edges().map(|edge| edge.angle).collect();
    let vertex = Vertex {
        place: mesh.positions()[v as usize],
        normals: &normals,
        angles: &angles,
        hint,
    };
    vertex.moved(shape, field)
}

/// Fills the gap between the moved triangles beside an edge.
fn strip(corners: &Corners<'_>, edge: u32, turn: &Turn, moved: &mut Moved) {
    let [a, b] = turn.ends;
    // from the left to the right
    let from: Vec<u32> = corners.arc(a, edge).rev().collect();
    let to: Vec<u32> = corners.arc(b, edge).collect();
    let (mut i, mut j) = (0, 0);
    while i + 1 < from.len() || j + 1 < to.len() {
        let share = |i: usize, len: usize| (i + 1) as f64 / (len - 1) as f64;
        let advances_from =
            j + 1 == to.len() || i + 1 < from.len() && share(i, from.len()) <= share(j, to.len());
        let base = turn.triangles[usize::from(2 * (i + j) >= from.len() + to.len() - 2)];
        if advances_from {
            moved.push(base, [from[i], from[i + 1], to[j]]);
            i += 1;
        } else {
            moved.push(base, [from[i], to[j + 1], to[j]]);
            j += 1;
        }
    }
}

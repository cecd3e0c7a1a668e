//! Triangles that close a mesh.
//!
//! A mesh winds around each place a whole number of times only if every edge is used as often in one direction as in the
//! other, at the exact places of its ends. Where a mesh is not like that, triangles are added that make it so, near the surface
//! where its generalized winding number is a half, so that the same places stay inside:
//!
//! 1. The boundary as a chain: each edge with the uses in one direction minus those in the other, after vertices at exactly
//!    the same place were taken for one. A mesh may have any number of triangles at an edge and still have none (`edges`).
//! 2. Seams, where parts nearly meet, are closed by strips (`seams`).
//! 3. What is left is taken apart into loops, which are filled by surfaces of least area, several in common where that takes
//!    less (`loops`, `patch`).
//!
//! Guarantees: mesh and closing together have no boundary; no place of the mesh moves and none is added; a mesh
//! without boundary gets no triangles. Does not guarantee: that the triangles meet neither one another nor the mesh.
//! Cost: 60 ns a triangle of the mesh, some tens of microseconds an edge of the boundary.

mod edges;
mod loops;
mod patch;
mod seams;

use glam::DVec3;
use ravec_mesh::{Aabb, TriMesh};
use ravec_progress::{Cancelled, Progress};
use rustc_hash::FxHashSet;

use edges::census;
use loops::{Filled, fill_loops, simple_loops};
use seams::{Seams, close_seams};

/// Triangles that close a mesh.
#[derive(Debug, Clone, Default)]
pub(crate) struct Closing {
    /// Triangles over the positions of the mesh; together with those of the mesh they have no boundary.
    pub triangles: Vec<[u32; 3]>,
    /// Whether the mesh has no boundary itself.
    pub closed: bool,
    /// Edges of two triangles that use it in the same direction.
    pub clashing_edges: u64,
    /// Edges of more than two triangles.
    pub multiple_edges: u64,
    /// Edges of the boundary that were closed by strips to others.
    pub seam_edges: u64,
    /// The width of the widest of these strips.
    pub seam_width: f64,
    /// Triangles that face the other way than all around them; closing the hole that each leaves is taking it as turned.
    pub turned_triangles: u64,
    /// The other places that were closed, in no particular order.
    pub holes: Vec<Hole>,
}

/// A place that was closed by a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Hole {
    /// The middle of the box around it.
    pub center: DVec3,
    /// The diagonal of that box.
    pub width: f64,
    /// How many loops of the boundary it has: 1 for a lid, 2 for a band.
    pub loops: u32,
}

/// Closes a mesh.
pub(crate) fn close(mesh: &TriMesh, progress: &Progress) -> Result<Closing, Cancelled> {
    let census = census(mesh, progress)?;
    let mut chain = census.boundary;
    let mut closing = Closing {
        closed: chain.is_empty(),
        clashing_edges: census.clashing,
        multiple_edges: census.multiple,
        ..Closing::default()
    };
    if closing.closed {
        return Ok(closing);
    }
    let at = |v: u32| mesh.positions()[v as usize];
    let diagonal = mesh.bounds().diagonal();
    let Seams { edges, widest } =
        close_seams(&mut chain, &at, diagonal, &mut closing.triangles, progress)?;
    closing.seam_edges = edges;
    closing.seam_width = widest;
    let loops = simple_loops(&chain, &at, progress)?;
    let filled = fill_loops(loops, &at, progress)?;
    let turned = turned_triangles(mesh, &filled);
    closing.turned_triangles = turned.len() as u64;
    for filled in filled {
        let is_turned = lid(&filled).is_some_and(|lid| turned.contains(&lid));
        let Filled {
            vertices,
            patch,
            loops,
        } = filled;
        let bounds = Aabb::around(vertices.iter().map(|&v| at(v)));
        if !is_turned {
            closing.holes.push(Hole {
                center: bounds.center(),
                width: bounds.diagonal(),
                loops,
            });
        }
        let backward = |[a, b, c]: [u32; 3]| [a, c, b].map(|i| vertices[i as usize]);
        closing
            .triangles
            .extend(patch.triangles.into_iter().map(backward));
    }
    // at a bridge the same vertex comes twice, and a triangle with it has no area and no boundary
    closing
        .triangles
        .retain(|[a, b, c]| a != b && b != c && c != a);
    Ok(closing)
}

/// The only triangle that fills a hole, with its lowest vertex first.
fn lid(filled: &Filled) -> Option<[u32; 3]> {
    match filled.vertices[..] {
        [a, b, c] => Some(rotated([a, c, b])),
        _ => None,
    }
}

/// A triangle with its lowest vertex first, facing the same way.
fn rotated([a, b, c]: [u32; 3]) -> [u32; 3] {
    match a.min(b).min(c) {
        low if low == a => [a, b, c],
        low if low == b => [b, c, a],
        _ => [c, a, b],
    }
}

/// Lids that are there twice, over a triangle of the mesh that faces the other way.
fn turned_triangles(mesh: &TriMesh, filled: &[Filled]) -> FxHashSet<[u32; 3]> {
    let mut once = FxHashSet::default();
    let twice: FxHashSet<_> = filled
        .iter()
        .filter_map(lid)
        .filter(|lid| !once.insert(*lid))
        .collect();
    if twice.is_empty() {
        return twice;
    }
    let backward = mesh.triangles().iter().map(|&[a, b, c]| rotated([a, c, b]));
    backward
        .filter(|triangle| twice.contains(triangle))
        .collect()
}

#[cfg(test)]
mod tests;

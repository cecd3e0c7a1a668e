//! Triangles that close a mesh.
//!
//! A mesh winds around each place a whole number of times only if every edge is used as often in one direction as in the
//! other, at the exact places of its ends. Where a mesh is not like that, triangles are added that make it so, near the surface
//! where its generalized winding number is a half, so that the same places stay inside:
//!
//! 1. The boundary as a chain: each edge with the uses in one direction minus those in the other, after vertices at exactly
//!    the same place were taken for one. A mesh may have any number of triangles at an edge and still have none (`edges`).
//! 2. Seams, where parts nearly meet, are closed by strips (`seams`).
//! 3. The rest is taken apart into loops, which are filled by surfaces of least area, several in common where that
//!    takes less and closes anything (`loops`, `patch`, `walls`). On demand they are put on a flat base instead (`base`).
//!
//! Guarantees: mesh and closing together have no boundary; no place of the mesh moves and none is added, but for a base; a mesh
//! without boundary gets no triangles. Does not guarantee: that the triangles meet neither one another nor the mesh.
//! Cost: 60 ns a triangle of the mesh, some tens of microseconds an edge of the boundary.

mod base;
mod edges;
mod loops;
mod patch;
mod seams;
mod strip;
mod walls;

use glam::DVec3;
use ravec_mesh::{Aabb, TriMesh};
use ravec_progress::{Cancelled, Progress};
use rustc_hash::FxHashSet;

use base::{is_relief, put_on_base};
use edges::census;
use loops::{Filled, fill_loops, simple_loops};
use seams::{Seams, close_seams};
use walls::Walls;

use crate::params::CloseRule;

pub(crate) use base::level as base_level;

/// Triangles that close a mesh.
#[derive(Debug, Clone, Default)]
pub(crate) struct Closing {
    /// Triangles over the positions of the mesh and then `added`; together with those of the mesh they have no boundary.
    pub triangles: Vec<[u32; 3]>,
    /// Vertices of a base.
    pub added: Vec<DVec3>,
    /// `true` if the mesh was to be put on a base and is none that can be: then nothing was closed.
    pub is_no_relief: bool,
    /// `true` if vertices of the boundary are at one place with others.
    pub is_split: bool,
    /// `true` if the mesh has no boundary itself.
    pub closed: bool,
    /// Edges of two triangles that use it in the same direction.
    pub clashing_edges: u64,
    /// Edges of more than two triangles.
    pub multiple_edges: u64,
    /// Edges of the boundary that were closed by strips to others.
    pub seam_edges: u64,
    /// The width of the widest of these strips.
    pub seam_width: f64,
    /// Patches of triangles that face the other way than all around them: what closes them takes them as turned.
    pub turned_patches: u64,
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
    /// Number of loops of the boundary: 1 for a lid, 2 for a band.
    pub loops: u32,
    /// A vertex of the boundary there.
    pub vertex: u32,
    /// `true` if the surface folds back onto the mesh, as the one in the border of a sheet does.
    pub folded: bool,
}

/// Closes a mesh.
pub(crate) fn close(
    mesh: &TriMesh,
    close: CloseRule,
    progress: &Progress,
) -> Result<Closing, Cancelled> {
    let census = census(mesh, progress)?;
    let mut closing = Closing {
        closed: census.boundary.is_empty(),
        clashing_edges: census.clashing,
        multiple_edges: census.multiple,
        is_split: !census.first.is_empty(),
        ..Closing::default()
    };
    if closing.closed {
        return Ok(closing);
    }
    let at = |v: u32| mesh.positions()[v as usize];
    let diagonal = mesh.bounds().diagonal();
    let walls = Walls::of(mesh, &census, progress)?;
    let mut chain = census.boundary;
    let triangles = &mut closing.triangles;
    let Seams { edges, widest } =
        close_seams(&mut chain, &walls, &at, diagonal, triangles, progress)?;
    closing.seam_edges = edges;
    closing.seam_width = widest;
    let loops = simple_loops(&chain, &at, progress)?;
    if close == CloseRule::Base && !loops.is_empty() {
        closing.is_no_relief = !is_relief(mesh);
        if !closing.is_no_relief {
            put_on_base(mesh, &loops, &mut closing.triangles, &mut closing.added);
        }
        return Ok(closing);
    }
    let filled = fill_loops(loops, &walls, close, &at, progress)?;
    let turned = match closing.clashing_edges {
        0 => FxHashSet::default(),
        _ => doubled(&filled),
    };
    closing.turned_patches = turned.len() as u64;
    for filled in filled {
        let is_turned = turned.contains(&sorted(&filled));
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
                vertex: vertices[0],
                folded: walls.is_retraced(&vertices, &patch, &at),
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

/// Loops that are there twice, as around triangles that face the other way than all around them.
fn doubled(filled: &[Filled]) -> FxHashSet<Vec<u32>> {
    let mut once = FxHashSet::default();
    let loops = filled.iter().map(sorted);
    loops.filter(|own| !once.insert(own.clone())).collect()
}

/// The vertices of a loop, ascending.
fn sorted(filled: &Filled) -> Vec<u32> {
    let mut vertices = filled.vertices.clone();
    vertices.sort_unstable();
    vertices
}

#[cfg(test)]
mod tests;

//! Which part of the surface is cut into triangles: all that belongs to a tile, or what changed since it was cut last.
//!
//! How a polygon is cut depends on the vertices in its leaves and in those of the polygons beside it, and a vertex in a leaf with
//! several sheets on the edges around that leaf. So a step goes from a leaf to all others around the edges on which the surface
//! goes through it, and what is [`AFFECTED`] steps away from all changes stays as it is.
//!
//! Guarantees: what is cut after changes, together with what stayed, is what would come of cutting all.

use crate::refine::Refinement;
use ravec_octree::{CellKey, MinimalEdge, NodeId, Polygon, minimal_edges, minimal_edges_near};
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;

/// Steps from a change within which polygons have to be cut again: one to the leaves of a polygon beside, one more to those that
/// place its vertices.
const AFFECTED: u8 = 2;

/// Steps from a change to the last leaf whose vertices are asked for: those of polygons that share a leaf with an affected one,
/// and so may meet it, are a step farther than that; their corners another one; and so are those of polygons that might use the
/// same diagonal.
const SURROUNDED: u8 = AFFECTED + 3;

/// Leaves that are not reached in so many steps.
const FAR: u8 = u8::MAX;

/// An edge on which the sign changes, and whether its start is inside.
pub(crate) type Crossing = (MinimalEdge, bool);

/// What is cut.
pub(crate) enum Scope {
    /// The polygons whose edges start in a tile.
    Tile(CellKey),
    /// The polygons of a tile near what changed.
    Changes(Surroundings),
}

/// Leaves around changes, and the edges on which the surface goes through them.
pub(crate) struct Surroundings {
    tile: CellKey,
    /// How many steps each node is away from a change; [`FAR`] if it is no leaf.
    steps: Vec<u8>,
    crossings: Vec<Crossing>,
}

impl Scope {
    /// What the changes of some leaves concern in a tile.
    pub fn around(
        tile: CellKey,
        changed: impl IntoIterator<Item = NodeId>,
        refinement: &Refinement<'_>,
        progress: &Progress,
    ) -> Result<Self, Cancelled> {
        let tree = &refinement.tree;
        let mut steps = vec![FAR; tree.len()];
        let mut crossings = Vec::new();
        let mut front = Vec::new();
        for leaf in changed {
            if tree.is_leaf(leaf) && steps[leaf as usize] == FAR {
                steps[leaf as usize] = 0;
                front.push(leaf);
            }
        }
        let mut is_near = vec![false; tree.len()];
        for step in 0..=SURROUNDED {
            is_near.fill(false);
            for node in front.drain(..).flat_map(|leaf| tree.path_to(leaf)) {
                is_near[node as usize] = true;
            }
            let found = minimal_edges_near(
                tree,
                |node| is_near[node as usize],
                |edge| {
                    // the others were found a step before
                    let is_new = edge.cells.iter().all(|&cell| steps[cell as usize] >= step);
                    (is_new && !progress.is_cancelled()).then(|| crossing(refinement, edge))?
                },
            );
            progress.check()?;
            for leaf in found.iter().flat_map(|(edge, _)| edge.cells) {
                if steps[leaf as usize] == FAR {
                    steps[leaf as usize] = step + 1;
                    front.push(leaf);
                }
            }
            crossings.extend(found);
        }
        Ok(Self::Changes(Surroundings {
            tile,
            steps,
            crossings,
        }))
    }

    /// Takes the edges on which the surface goes through what is looked at, in an order that all tiles agree on.
    pub fn take_crossings(
        &mut self,
        refinement: &Refinement<'_>,
        progress: &Progress,
    ) -> Result<Vec<Crossing>, Cancelled> {
        let mut crossings = match self {
            Self::Tile(_) => minimal_edges(&refinement.tree, |edge| {
                (!progress.is_cancelled()).then(|| crossing(refinement, edge))?
            }),
            Self::Changes(surroundings) => std::mem::take(&mut surroundings.crossings),
        };
        progress.check()?;
        crossings.par_sort_by_cached_key(|(edge, _)| (edge.start.morton(), edge.axis));
        progress.check()?;
        Ok(crossings)
    }

    /// Whether all around a leaf is looked at.
    pub fn is_core(&self, refinement: &Refinement<'_>, leaf: NodeId) -> bool {
        match self {
            Self::Tile(_) => refinement.is_core(leaf),
            Self::Changes(near) => {
                near.steps[leaf as usize] <= SURROUNDED && refinement.is_core(leaf)
            }
        }
    }

    /// Whether a polygon is asked for.
    pub fn owns(&self, polygon: &Polygon) -> bool {
        match self {
            Self::Tile(tile) => tile.owns(polygon.start),
            Self::Changes(near) => {
                let is_affected = |&leaf: &NodeId| near.is_affected(leaf);
                near.tile.owns(polygon.start) && polygon.cells().iter().any(is_affected)
            }
        }
    }
}

impl Surroundings {
    /// Whether the polygons with a corner in a leaf have to be cut again; so have all with corners in what is no leaf any more.
    pub fn is_affected(&self, leaf: NodeId) -> bool {
        self.steps[leaf as usize] <= AFFECTED
    }
}

/// An edge, if the surface goes through it.
fn crossing(refinement: &Refinement<'_>, edge: MinimalEdge) -> Option<Crossing> {
    let is_crossed = refinement.is_crossed(&edge);
    is_crossed.then(|| (edge, refinement.is_inside(edge.smallest, edge.start)))
}

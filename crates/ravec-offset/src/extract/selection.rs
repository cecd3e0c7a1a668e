//! The selection of polygons to extract: all of a tile, or those near changes.
//!
//! The triangulation of a polygon depends on the vertices in its leaves and in those of adjacent polygons, and a vertex in a
//! leaf with several sheets depends on the edges around that leaf. A step leads from a leaf to all leaves around the edges on
//! which the surface passes through it; polygons more than [`AFFECTED`] steps from all changes stay as they are.
//!
//! Guarantees: polygons extracted near changes, together with those that stay, equal a complete extraction.

use crate::grow::Refinement;
use ravec_octree::{CellKey, MinimalEdge, NodeId, Polygon, minimal_edges, minimal_edges_near};
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;

/// Steps from a change within which polygons are extracted again: one to the leaves of an adjacent polygon, one more to those
/// that place its vertices.
const AFFECTED: u8 = 2;

/// Steps from a change to the last leaf whose vertices are needed. Polygons that share a leaf with an affected one, and so may
/// intersect it, are one step farther; their corners another one; and so are polygons that might use the same diagonal.
const SURROUNDED: u8 = AFFECTED + 3;

/// Distance of leaves that are not reached.
const FAR: u8 = u8::MAX;

/// An edge on which the sign changes, and whether its start is inside.
pub(crate) type Crossing = (MinimalEdge, bool);

/// The polygons to extract.
pub(crate) enum Selection {
    /// The polygons whose edges start in a tile.
    Tile(CellKey),
    /// The polygons of a tile near changes.
    Changes(Surroundings),
}

/// Leaves around changes, and the edges on which the surface passes through them.
pub(crate) struct Surroundings {
    tile: CellKey,
    /// Steps from each node to a change; [`FAR`] for inner nodes and leaves that are not reached.
    steps: Vec<u8>,
    crossings: Vec<Crossing>,
}

impl Selection {
    /// Selects the polygons of a tile that the changes of some leaves affect.
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

    /// Takes the crossed edges, in an order that all tiles share.
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

    /// Returns whether all surroundings of a leaf are known.
    pub fn is_core(&self, refinement: &Refinement<'_>, leaf: NodeId) -> bool {
        match self {
            Self::Tile(_) => refinement.is_core(leaf),
            Self::Changes(near) => {
                near.steps[leaf as usize] <= SURROUNDED && refinement.is_core(leaf)
            }
        }
    }

    /// Returns whether a polygon is selected.
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
    /// Returns whether polygons with a corner in a leaf must be extracted again. Polygons with a corner in a former leaf must,
    /// too.
    pub fn is_affected(&self, leaf: NodeId) -> bool {
        self.steps[leaf as usize] <= AFFECTED
    }
}

/// Returns an edge if the surface crosses it.
fn crossing(refinement: &Refinement<'_>, edge: MinimalEdge) -> Option<Crossing> {
    let is_crossed = refinement.is_crossed(&edge);
    is_crossed.then(|| (edge, refinement.is_inside(edge.smallest, edge.start)))
}

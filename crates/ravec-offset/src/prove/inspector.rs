//! Inspection: defects of a surface, and the edits that repair them.
//!
//! Facets must be proved to keep the distance, and triangles must not intersect. Only triangles near leaves with several sheets
//! can intersect, see [`crate::extract`]; the finished surface is searched completely.

use super::{keeps_distance, near_corner, room_kept, tightened};
use crate::extract::{Extracted, Selection};
use crate::grow::{Refinement, Setting};
use crate::surface::{Edits, Patch, Proof, ProofStart, Room, intersecting_pairs};
use ravec_octree::{CellKey, Corner, NodeId};
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Number of unproved facets above which their cells are split once instead of twice.
const MANY_UNPROVED: usize = 2000;

/// Share of the tolerance by which facets with ample room come nearer than the distance; most facets have ample room.
const AMPLE: f64 = 0.65;

/// Edits requested by an inspection. The number of levels by which cells of unproved facets are split depends on their number
/// everywhere.
#[derive(Debug, Default, Serialize, Deserialize)]
pub(crate) struct EditRequests {
    next: Edits,
    unproved: Vec<CellKey>,
}

impl EditRequests {
    /// Adds all of `other`.
    pub fn extend(&mut self, other: Self) {
        self.next.extend(&other.next);
        self.unproved.extend(other.unproved);
    }

    /// Returns the edits, with cells split by some levels at once.
    pub fn edits(mut self, setting: &Setting<'_>, levels: u8) -> Edits {
        let are_many = self.unproved.len() > MANY_UNPROVED;
        // a proof needs no second try where cells cannot be split
        let limit = setting.limit();
        for key in self.unproved.into_iter().filter(|key| key.level < limit) {
            if are_many {
                self.next.split.insert(key);
            } else {
                self.next.split.extend(with_descendants(key, levels, limit));
            }
        }
        self.next
    }
}

/// Defects of a surface.
#[derive(Debug, Default, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Defects {
    /// Leaves of triangles that are not proved or intersect others.
    pub leaves: Vec<NodeId>,
    /// Starts of the edges of their polygons, or corners of such leaves.
    pub starts: Vec<Corner>,
}

/// Inspects a surface.
#[derive(Clone, Copy)]
pub(crate) struct Inspector<'a> {
    pub setting: Setting<'a>,
    /// Minimum and maximum distance of the points of the surface.
    pub limits: [f64; 2],
}

impl Inspector<'_> {
    /// Minimum distance of facets with ample room below them.
    pub fn ample_distance(&self) -> f64 {
        self.setting.field.radius() - AMPLE * self.setting.tolerance
    }

    /// Requests the edits that repair facets without a proof and triangles that intersect.
    ///
    /// Returns the defects, and the proofs of the selected triangles in their order. Facets proved in the surface `before` are
    /// not proved again.
    pub fn inspect(
        &self,
        before: &Patch,
        refinement: &Refinement<'_>,
        (extracted, selection): (&Extracted, &Selection),
        levels: u8,
        requests: &mut EditRequests,
        progress: &Progress,
    ) -> Result<(Defects, Vec<Option<Proof>>), Cancelled> {
        let start_of = |t: usize| {
            let polygon = extracted.polygon_of[t];
            extracted.contour.polygons[polygon as usize].start
        };
        let mut defects = Defects::default();
        let asked: Vec<usize> = (0..extracted.triangles.len())
            .into_par_iter()
            .filter(|&t| extracted.is_owned(t, selection))
            .collect();
        progress.check()?;
        let proofs = self.proofs(before, refinement, extracted, &asked, progress)?;
        let unproved: Vec<usize> = (asked.iter().zip(&proofs))
            .filter(|(_, proof)| proof.is_none())
            .map(|(&t, _)| t)
            .collect();
        let at_fault = self.at_fault(refinement, extracted, &unproved, progress)?;
        for (&t, at_fault) in unproved.iter().zip(at_fault) {
            requests.unproved.extend(at_fault);
            defects.leaves.extend(extracted.cells_of(t));
            defects.starts.push(start_of(t));
        }
        progress.check()?;
        let next = &mut requests.next;
        let crowded = extracted.near_crowded_cells(refinement, selection);
        progress.check()?;
        let chosen: Vec<[u32; 3]> = crowded
            .iter()
            .map(|&t| extracted.triangles[t as usize])
            .collect();
        let pairs = intersecting_pairs(&extracted.positions, &chosen, progress)?;
        let equal = extracted.cells_with_equal_vertices(refinement, selection);
        let at = |&leaf: &NodeId| refinement.tree.key(leaf).at;
        defects.starts.extend(equal.iter().map(at));
        defects.leaves.extend(&equal);
        for pair in pairs {
            for t in pair {
                let triangle = crowded[t as usize] as usize;
                let cells = extracted.cells_of(triangle);
                separate(refinement, cells, levels, next);
                defects.leaves.extend(cells);
                defects.starts.push(start_of(triangle));
            }
        }
        separate(refinement, &equal, levels, next);
        Ok((defects, proofs))
    }

    /// Returns the cells to split for each of some facets without a proof.
    ///
    /// Across a crest, a facet has vertices on either side that miss its tip, and perhaps one that does not, whose cell is
    /// useless to split. So the edge whose center is farthest off the surface must become shorter. Of the cells at its ends the
    /// coarsest are split, which suffices: the edges of finer cells beside a coarse cell follow a crest whose tip lies in it
    /// without a corner beyond.
    fn at_fault(
        &self,
        refinement: &Refinement<'_>,
        extracted: &Extracted,
        facets: &[usize],
        progress: &Progress,
    ) -> Result<Vec<Vec<CellKey>>, Cancelled> {
        let (field, limit) = (self.setting.field, self.setting.limit());
        let can_be_split = |&leaf: &NodeId| refinement.tree.key(leaf).level < limit;
        let of_facet = |&t: &usize| {
            progress.check()?;
            let around = extracted.cells_of(t);
            let (facet, hint) = (extracted.facet(t), refinement.tree.data(around[0]).hint);
            let off = |i: usize| {
                let middle = 0.5 * (facet[i] + facet[(i + 1) % 3]);
                (field.near(middle, hint).distance - field.radius()).abs()
            };
            let worst = (0..3)
                .map(|i| (off(i), extracted.cells_at_ends(t, i)))
                .filter(|(_, cells)| cells.iter().any(can_be_split))
                .max_by(|(a, _), (b, _)| a.total_cmp(b));
            let cells = worst.map_or_else(|| around.to_vec(), |(_, cells)| cells);
            Ok(coarsest(refinement, &cells))
        };
        facets.par_iter().map(of_facet).collect()
    }

    /// Proves triangles as far as possible.
    fn proofs(
        &self,
        before: &Patch,
        refinement: &Refinement<'_>,
        extracted: &Extracted,
        asked: &[usize],
        progress: &Progress,
    ) -> Result<Vec<Option<Proof>>, Cancelled> {
        let limit = self.setting.limit();
        let given = |t: usize| {
            let cells = extracted.cells_of(t);
            let level = |&cell: &NodeId| refinement.tree.key(cell).level;
            let hint = |cell: NodeId| refinement.tree.data(cell).hint;
            ProofStart {
                hints: std::array::from_fn(|i| hint(cells[i.min(cells.len() - 1)])),
                is_last: cells.iter().all(|cell| level(cell) >= limit),
            }
        };
        let phase = progress.phase("prove", asked.len() as u64);
        asked
            .par_iter()
            .map(|&t| {
                progress.check()?;
                phase.advance(1);
                let (given, facet) = (given(t), extracted.facet(t));
                let known = before.proof_of(&extracted.edge_of(t), facet);
                if let Some(proof) = known.filter(|proof| proof.is_from(&given)) {
                    return Ok(Some(proof));
                }
                let ProofStart { hints, is_last } = given;
                let field = self.setting.field;
                // corners of fans are not those of the leaves, nor in their order
                let near = facet.map(|corner| near_corner(field, corner, &hints, self.limits));
                let hints = near.map(|near| near.triangle);
                // cells that cannot be split must keep the distance, but cannot follow a crest any further
                let limits = tightened(field, facet, near, self.limits);
                let room = room_kept(field, facet, limits, self.ample_distance(), hints);
                let keeps = || is_last && keeps_distance(field, facet, self.limits, hints);
                let room = room.or_else(|| keeps().then_some(Room::Enough));
                Ok(room.map(|room| Proof::new(room, &given)))
            })
            .collect()
    }
}

/// Returns the coarsest cells of some leaves.
fn coarsest(refinement: &Refinement<'_>, leaves: &[NodeId]) -> Vec<CellKey> {
    let keys = leaves.iter().map(|&leaf| refinement.tree.key(leaf));
    let least = keys.clone().map(|key| key.level).min();
    keys.filter(|key| Some(key.level) == least).collect()
}

/// Returns a cell to split, and its descendants to split with it, over some levels in all.
fn with_descendants(key: CellKey, levels: u8, limit: u8) -> Vec<CellKey> {
    let mut cells = vec![key];
    let (mut first, last) = (0, (key.level + levels).min(limit));
    for _ in key.level + 1..last {
        let end = cells.len();
        for k in first..end {
            let parent = cells[k];
            cells.extend((0..8).map(|octant| parent.child(octant)));
        }
        first = end;
    }
    cells
}

/// Requests edits that separate the sheets in some leaves: finer cells, or at the finest level filled corners.
pub(crate) fn separate(
    refinement: &Refinement<'_>,
    leaves: &[NodeId],
    levels: u8,
    next: &mut Edits,
) {
    let limit = refinement.setting.limit();
    for &leaf in leaves {
        let key = refinement.tree.key(leaf);
        if key.level < limit {
            next.split.extend(with_descendants(key, levels, limit));
        } else {
            next.filled.extend(refinement.open_corners(leaf));
        }
    }
}

//! What is wrong with a surface, and what is ordered to mend it.
//!
//! Facets have to be proved to keep the distance, and triangles must not meet. Only those near leaves with several sheets can,
//! see [`crate::extract`]; whoever wants to be sure searches all in the end.

use crate::certify::{Room, keeps_distance, room_kept};
use crate::crest::{near_corner, tightened};
use crate::extract::Extracted;
use crate::outermost::compact;
use crate::proof::{Given, Proof};
use crate::refine::{Refinement, Setting};
use crate::scope::Scope;
use crate::tile::{Orders, Patch};
use glam::DVec3;
use ravec_mesh::{BoxTree, self_intersections};
use ravec_octree::{CellKey, Corner, NodeId};
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;

/// Where more facets than this are not proved, their cells are split once and not twice.
const MANY: usize = 2000;

/// The share of the tolerance by which most facets come nearer than the distance at most: three quarters of it is what the worst
/// of them do.
const AMPLE: f64 = 0.65;

/// What is ordered while a surface is judged. How cells of facets that are not proved are split depends on how many there are
/// everywhere.
#[derive(Debug, Default)]
pub(crate) struct Wanted {
    next: Orders,
    unproved: Vec<CellKey>,
}

impl Wanted {
    /// Adds all of `other`.
    pub fn extend(&mut self, other: Self) {
        self.next.extend(&other.next);
        self.unproved.extend(other.unproved);
    }

    /// What is to be done, where cells are split by some levels at once.
    pub fn orders(mut self, setting: &Setting<'_>, levels: u8) -> Orders {
        let are_many = self.unproved.len() > MANY;
        // a proof needs no second try where cells cannot be split
        let limit = setting.limit();
        for key in self.unproved.into_iter().filter(|key| key.level < limit) {
            if are_many {
                self.next.split.insert(key);
            } else {
                self.next.split.extend(parts(key, levels, limit));
            }
        }
        self.next
    }
}

/// What is wrong with a surface.
#[derive(Debug, Default)]
pub(crate) struct Bad {
    /// The leaves of triangles that are not proved or meet others.
    pub leaves: Vec<NodeId>,
    /// Where the edges of their polygons start, or such a leaf.
    pub starts: Vec<Corner>,
}

/// Who judges a surface.
#[derive(Clone, Copy)]
pub(crate) struct Judge<'a> {
    pub setting: Setting<'a>,
    /// The least and the largest distance that a point of the surface may have.
    pub limits: [f64; 2],
}

impl Judge<'_> {
    /// The nearest that facets with ample room below them may come.
    pub fn ample_distance(&self) -> f64 {
        self.setting.field.radius() - AMPLE * self.setting.tolerance
    }

    /// Orders what mends facets that are not proved, and triangles that meet.
    ///
    /// Returns where all these are, and a proof of each triangle that is asked for, in their order. What was proved of the
    /// surface `before` is not proved again.
    pub fn judge(
        &self,
        before: &Patch,
        refinement: &Refinement<'_>,
        (extracted, scope): (&Extracted, &Scope),
        levels: u8,
        wanted: &mut Wanted,
        progress: &Progress,
    ) -> Result<(Bad, Vec<Option<Proof>>), Cancelled> {
        let start_of = |t: usize| {
            let polygon = extracted.polygon_of[t];
            extracted.contour.polygons[polygon as usize].start
        };
        let mut bad = Bad::default();
        let asked: Vec<usize> = (0..extracted.triangles.len())
            .into_par_iter()
            .filter(|&t| extracted.is_owned(t, scope))
            .collect();
        progress.check()?;
        let proofs = self.proofs(before, refinement, extracted, &asked, progress)?;
        let unproved: Vec<usize> = (asked.iter().zip(&proofs))
            .filter(|(_, proof)| proof.is_none())
            .map(|(&t, _)| t)
            .collect();
        let at_fault = self.at_fault(refinement, extracted, &unproved, progress)?;
        for (&t, at_fault) in unproved.iter().zip(at_fault) {
            wanted.unproved.extend(at_fault);
            bad.leaves.extend(extracted.cells_of(t));
            bad.starts.push(start_of(t));
        }
        progress.check()?;
        let next = &mut wanted.next;
        let crowded = extracted.near_crowded_cells(refinement, scope);
        progress.check()?;
        let chosen: Vec<[u32; 3]> = crowded
            .iter()
            .map(|&t| extracted.triangles[t as usize])
            .collect();
        let pairs = meeting_pairs(&extracted.positions, &chosen, progress)?;
        let equal = extracted.cells_with_equal_vertices(refinement, scope);
        let at = |&leaf: &NodeId| refinement.tree.key(leaf).at;
        bad.starts.extend(equal.iter().map(at));
        bad.leaves.extend(&equal);
        for pair in pairs {
            for t in pair {
                let triangle = crowded[t as usize] as usize;
                let cells = extracted.cells_of(triangle);
                separate(refinement, cells, levels, next);
                bad.leaves.extend(cells);
                bad.starts.push(start_of(triangle));
            }
        }
        separate(refinement, &equal, levels, next);
        Ok((bad, proofs))
    }

    /// For each of some facets that are not proved, the cells to split.
    ///
    /// Across a crest, a facet has vertices on either side that miss its tip, and perhaps one that does not: to split the cell of
    /// that one is of no use. So it is the edge whose middle is farthest off the surface that is to become shorter. Of the cells at
    /// its ends the coarsest are split, which is enough in the end: a crest whose tip lies in a coarse cell without a corner beyond
    /// it is followed by the edges of finer cells beside it.
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

    /// Proofs of some triangles, as far as they can be found.
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
            Given {
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
                let Given { hints, is_last } = given;
                let field = self.setting.field;
                // corners of fans are not those of the leaves, nor in their order
                let near = facet.map(|corner| near_corner(field, corner, &hints, self.limits));
                let hints = near.map(|near| near.triangle);
                // what cannot be split has to keep the distance, but cannot follow a crest any further
                let limits = tightened(field, facet, near, self.limits);
                let room = room_kept(field, facet, limits, self.ample_distance(), hints);
                let is_held = || is_last && keeps_distance(field, facet, self.limits, hints);
                let room = room.or_else(|| is_held().then_some(Room::Enough));
                Ok(room.map(|room| Proof::new(room, &given)))
            })
            .collect()
    }
}

/// The cells of those leaves that are the coarsest.
fn coarsest(refinement: &Refinement<'_>, leaves: &[NodeId]) -> Vec<CellKey> {
    let keys = leaves.iter().map(|&leaf| refinement.tree.key(leaf));
    let least = keys.clone().map(|key| key.level).min();
    keys.filter(|key| Some(key.level) == least).collect()
}

/// A cell that is to be split, and its descendants as far as they are to be split with it, over some levels in all.
fn parts(key: CellKey, levels: u8, limit: u8) -> Vec<CellKey> {
    let mut parts = vec![key];
    let (mut first, last) = (0, (key.level + levels).min(limit));
    for _ in key.level + 1..last {
        let end = parts.len();
        for k in first..end {
            let parent = parts[k];
            parts.extend((0..8).map(|octant| parent.child(octant)));
        }
        first = end;
    }
    parts
}

/// Orders what keeps the sheets in some leaves apart: finer cells, and where there are none, no gap.
pub(crate) fn separate(
    refinement: &Refinement<'_>,
    leaves: &[NodeId],
    levels: u8,
    next: &mut Orders,
) {
    let limit = refinement.setting.limit();
    for &leaf in leaves {
        let key = refinement.tree.key(leaf);
        if key.level < limit {
            next.split.extend(parts(key, levels, limit));
        } else {
            next.filled.extend(refinement.open_corners(leaf));
        }
    }
}

/// Pairs of triangles that meet where they should not.
pub(crate) fn meeting_pairs(
    positions: &[DVec3],
    triangles: &[[u32; 3]],
    progress: &Progress,
) -> Result<Vec<[u32; 2]>, Cancelled> {
    if triangles.is_empty() {
        return Ok(vec![]);
    }
    let tree = BoxTree::try_new(&compact(positions, triangles, progress)?, progress)?;
    let pairs = self_intersections(&tree, usize::MAX, progress)?.pairs;
    Ok(pairs.iter().map(|pair| [pair.first, pair.second]).collect())
}

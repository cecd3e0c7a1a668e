//! The tree: cells that may hold the surface are split until a vertex can stand for what they hold.

use crate::cell::{Cell, CornerValue, Fit, MOST_TRIANGLES};
use crate::field::{Field, Near, Region};
use glam::DVec3;
use ravec_mesh::Aabb;
use ravec_octree::{CellKey, Corner, Frame, MAX_LEVEL, NodeId, Octree};
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;
use rustc_hash::{FxHashMap, FxHashSet};

/// Cells coarser than this are split without a look.
const FIRST_LEVEL: u8 = 3;

/// What is known of a cell.
#[derive(Debug, Clone, Copy)]
pub(crate) enum State {
    /// Nothing yet.
    New,
    /// All of it lies on one side of the surface.
    Empty { is_inside: bool },
    /// It may hold the surface; with the place of its vertex, if its corners have both signs.
    Full { vertex: Option<DVec3> },
}

/// A node of the tree.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Node {
    /// A triangle close to it.
    pub hint: u32,
    pub region: Region,
    pub state: State,
}

/// The tree, and all that was found on the way.
pub(crate) struct Refinement<'a> {
    pub field: &'a Field<'a>,
    pub frame: Frame,
    pub tolerance: f64,
    /// Cells of this level are not split because of what they hold.
    pub floor: u8,
    pub tree: Octree<Node>,
    corners: FxHashMap<u64, CornerValue>,
    /// Corners that count as inside though the field says otherwise: see [`Self::fill`].
    filled: FxHashSet<u64>,
}

/// What came of looking at the middle of a cell.
struct Look {
    near: Near,
    region: Region,
    empty: Option<bool>,
}

impl<'a> Refinement<'a> {
    /// Grows the tree over a cube until every cell is good.
    pub fn grow(
        field: &'a Field<'a>,
        frame: Frame,
        tolerance: f64,
        progress: &Progress,
    ) -> Result<Self, Cancelled> {
        let floor_side = tolerance / 3f64.sqrt();
        let floor = (frame.side / floor_side).log2().ceil().max(0.0) as u8;
        let mut refinement = Self {
            field,
            frame,
            tolerance,
            floor: floor.min(MAX_LEVEL - 2),
            tree: Octree::new(Node {
                hint: 0,
                region: Region::Unknown,
                state: State::New,
            }),
            corners: FxHashMap::default(),
            filled: FxHashSet::default(),
        };
        refinement.settle(vec![0], progress)?;
        Ok(refinement)
    }

    /// Splits some leaves, whatever they hold, and goes on until every cell is good again.
    pub fn split(&mut self, leaves: &[NodeId], progress: &Progress) -> Result<(), Cancelled> {
        let children = self.split_all(leaves);
        self.settle(children, progress)
    }

    /// The finest level: cells of it are so small that the surface may go anywhere in them.
    pub fn limit(&self) -> u8 {
        (self.floor + 2).min(MAX_LEVEL)
    }

    /// Puts all corners of some cells of the finest level inside, where sheets come closer than cells can tell apart. The
    /// surface goes through these cells, so that moves it by less than their diagonal, a quarter of the tolerance. Returns
    /// whether that changed anything.
    pub fn fill(&mut self, leaves: &[NodeId]) -> bool {
        let before = self.filled.len();
        for &leaf in leaves {
            let key = self.tree.key(leaf);
            for octant in 0..8 {
                let corner = key.corner(octant);
                if !self.is_inside(leaf, corner) {
                    self.filled.insert(corner.code());
                }
            }
        }
        self.filled.len() > before
    }

    fn split_all(&mut self, leaves: &[NodeId]) -> Vec<NodeId> {
        let mut children = Vec::with_capacity(8 * leaves.len());
        for &leaf in leaves {
            let first = self.tree.split(leaf, |_, &parent| Node {
                state: State::New,
                ..parent
            });
            children.extend(first..first + 8);
        }
        children
    }

    /// Looks at new leaves, level by level.
    fn settle(&mut self, mut front: Vec<NodeId>, progress: &Progress) -> Result<(), Cancelled> {
        while !front.is_empty() {
            progress.check()?;
            let phase = progress.phase("refine", front.len() as u64);
            let looks: Vec<Look> = front
                .par_iter()
                .map(|&node| {
                    progress.check()?;
                    phase.advance(1);
                    Ok(self.look(node))
                })
                .collect::<Result<_, Cancelled>>()?;
            let (mut coarse, mut full) = (Vec::new(), Vec::new());
            for (&node, look) in front.iter().zip(looks) {
                let data = self.tree.data_mut(node);
                data.hint = look.near.triangle;
                data.region = look.region;
                if let Some(is_inside) = look.empty {
                    data.state = State::Empty { is_inside };
                } else if self.must_split(node, &look) {
                    coarse.push(node);
                } else {
                    full.push((node, look));
                }
            }
            self.evaluate_corners(&full, progress)?;
            let fits: Vec<Fit> = full
                .par_iter()
                .map(|(node, look)| {
                    progress.check()?;
                    let key = self.tree.key(*node);
                    let corners = self.corners_of(key);
                    Ok(self.cell(key).fit(look.near, look.region, &corners))
                })
                .collect::<Result<_, Cancelled>>()?;
            for ((node, _), fit) in full.into_iter().zip(fits) {
                if fit.is_good || self.tree.key(node).level >= self.floor {
                    self.tree.data_mut(node).state = State::Full { vertex: fit.vertex };
                } else {
                    coarse.push(node);
                }
            }
            front = self.split_all(&coarse);
        }
        Ok(())
    }

    /// Looks at the middle of a cell.
    fn look(&self, node: NodeId) -> Look {
        let [low, high] = self.frame.bounds(self.tree.key(node));
        let (center, radius) = (0.5 * (low + high), 0.5 * (high - low).length());
        let &Node { hint, region, .. } = self.tree.data(node);
        let near = self.field.near(center, hint);
        let region = match region {
            // no triangle goes through the cell, so all of it lies on one side of them
            Region::Unknown if near.distance > radius || !self.field.is_signed() => {
                self.field.region(center)
            }
            known => known,
        };
        let empty = if region == Region::Unknown {
            let reaches = near.distance + radius >= self.field.radius();
            (!reaches).then_some(self.field.level > 0.0)
        } else {
            let value = self.field.value(near.distance, region);
            (value.abs() > radius).then_some(value < 0.0)
        };
        Look {
            near,
            region,
            empty,
        }
    }

    /// Whether a cell is to be split without a look at its corners.
    fn must_split(&self, node: NodeId, look: &Look) -> bool {
        let key = self.tree.key(node);
        if key.level < FIRST_LEVEL {
            return true;
        }
        let [low, high] = self.frame.bounds(key);
        let radius = 0.5 * (high - low).length();
        if look.near.distance > radius || key.level >= self.floor {
            return false;
        }
        // without signs, a cell with triangles in it would hide the surface on one side of them; with signs, many
        // triangles may enclose what the corners know nothing of
        let mut triangles = 0;
        let bounds = Aabb {
            min: low,
            max: high,
        };
        let field = self.field;
        field.bvh().for_each_touching(&bounds, |triangle| {
            // large slanted triangles have boxes in which they are nearly nowhere
            let is_far =
                field.level == 0.0 && field.near_of(0.5 * (low + high), triangle).distance > radius;
            triangles += usize::from(!is_far);
        });
        !self.field.is_signed() || triangles > MOST_TRIANGLES
    }

    fn evaluate_corners(
        &mut self,
        cells: &[(NodeId, Look)],
        progress: &Progress,
    ) -> Result<(), Cancelled> {
        let mut missing: Vec<(Corner, bool, Region, u32)> = cells
            .iter()
            .flat_map(|(node, look)| {
                let key = self.tree.key(*node);
                (0..8).map(move |octant| {
                    let unknown = look.region == Region::Unknown;
                    (key.corner(octant), unknown, look.region, look.near.triangle)
                })
            })
            .filter(|(corner, ..)| !self.corners.contains_key(&corner.code()))
            .collect();
        // of each corner the cell that knows the side, if any does
        missing.sort_unstable_by_key(|&(corner, unknown, ..)| (corner, unknown));
        missing.dedup_by_key(|&mut (corner, ..)| corner);
        let values: Vec<(u64, CornerValue)> = missing
            .into_par_iter()
            .map(|(corner, _, region, hint)| {
                progress.check()?;
                Ok((corner.code(), self.evaluate(corner, region, hint)))
            })
            .collect::<Result<_, Cancelled>>()?;
        self.corners.extend(values);
        Ok(())
    }

    fn evaluate(&self, corner: Corner, region: Region, hint: u32) -> CornerValue {
        let p = self.frame.point(corner);
        let near = self.field.near(p, hint);
        let region = match region {
            Region::Unknown => self.field.region(p),
            known => known,
        };
        CornerValue {
            triangle: near.triangle,
            value: self.field.value(near.distance, region),
        }
    }

    fn corners_of(&self, key: CellKey) -> [CornerValue; 8] {
        std::array::from_fn(|octant| self.corners[&key.corner(octant).code()])
    }

    /// A cell, to fit a vertex in it.
    pub fn cell(&self, key: CellKey) -> Cell<'_> {
        Cell {
            field: self.field,
            frame: &self.frame,
            tolerance: self.tolerance,
            key,
        }
    }

    /// What is known of a corner of a leaf that may hold the surface.
    pub fn corner(&self, corner: Corner) -> Option<&CornerValue> {
        self.corners.get(&corner.code())
    }

    /// Whether a corner of a leaf lies inside the offset solid.
    pub fn is_inside(&self, leaf: NodeId, corner: Corner) -> bool {
        if !self.filled.is_empty() && self.filled.contains(&corner.code()) {
            return true;
        }
        match self.tree.data(leaf).state {
            State::Empty { is_inside } => is_inside,
            State::New | State::Full { .. } => self.corners[&corner.code()].value < 0.0,
        }
    }

    pub fn leaf_vertex(&self, leaf: NodeId) -> Option<DVec3> {
        match self.tree.data(leaf).state {
            State::Full { vertex } => vertex,
            State::New | State::Empty { .. } => None,
        }
    }
}

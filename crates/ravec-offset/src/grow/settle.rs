//! Examination of new leaves, level by level.

use super::{
    CornerValue, EdgeKey, Ends, Fit, Halt, Node, ON_SURFACE, Probe, Refinement, Roots, Sample,
    State, VertexNumber, crossed_edges, inside_of, root,
};
use crate::domain::{Enclosure, Place, Region};
use crate::surface::Edits;
use ravec_octree::{CellKey, Corner, NodeId};
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;
use rustc_hash::FxBuildHasher;

/// Batch size between cancellation checks: a few milliseconds of work.
const AT_ONCE: usize = 1 << 14;

impl Refinement<'_> {
    pub(super) fn split_all(&mut self, leaves: &[NodeId]) -> Vec<NodeId> {
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

    /// Examines new leaves, level by level, and splits those that are not good.
    pub(super) fn settle(
        &mut self,
        mut front: Vec<NodeId>,
        edits: &Edits,
        progress: &Progress,
    ) -> Result<(), Halt> {
        while !front.is_empty() {
            progress.check()?;
            if self.tree.len() > self.max_nodes {
                return Err(Halt::TooLarge);
            }
            front.retain(|&node| {
                let key = self.tree.key(node);
                let known = if !self.reach.touches(key) {
                    Some(State::Beyond)
                } else if self.setting.enclosed.of(key) == Some(Enclosure::Whole) {
                    // enclosed cells count as inside
                    Some(State::Empty { is_inside: true })
                } else {
                    None
                };
                if let Some(state) = known {
                    self.tree.data_mut(node).state = state;
                }
                known.is_none()
            });
            let phase = progress.phase("refine", front.len() as u64);
            let probes: Vec<Probe> = front
                .par_iter()
                .map(|&node| {
                    progress.check()?;
                    phase.advance(1);
                    Ok(self.probe(node))
                })
                .collect::<Result<_, Cancelled>>()?;
            let mut coarse = Vec::new();
            let mut full: Vec<(NodeId, Probe)> = Vec::new();
            for (&node, probe) in front.iter().zip(probes) {
                progress.check()?;
                let data = self.tree.data_mut(node);
                data.hint = probe.near.triangle;
                data.region = probe.region;
                data.middle = probe.middle.signed_distance();
                let is_requested = edits.split.contains(&self.tree.key(node));
                if let Some(is_inside) = probe.empty {
                    self.tree.data_mut(node).state = State::Empty { is_inside };
                    if is_requested {
                        coarse.push(node);
                    }
                } else if self.must_split(node, &probe) {
                    coarse.push(node);
                } else {
                    full.push((node, probe));
                }
            }
            self.evaluate_corners(&full, progress)?;
            let corners: Vec<[CornerValue; 8]> = full
                .par_iter()
                .map(|&(node, _)| {
                    progress.check()?;
                    Ok(self.corners_of(self.tree.key(node)))
                })
                .collect::<Result<_, Cancelled>>()?;
            let inside: Vec<u8> = corners.par_iter().map(inside_of).collect();
            let roots = self.roots(&full, &inside, progress)?;
            let fits: Vec<Fit> = full
                .par_iter()
                .zip(&corners)
                .map(|((node, probe), corners)| {
                    progress.check()?;
                    let cell = self.cell(self.tree.key(*node));
                    let regions = [probe.region, probe.middle.region];
                    Ok(cell.fit(probe.near, regions, corners, &roots))
                })
                .collect::<Result<_, Cancelled>>()?;
            drop(corners);
            for (((node, _), inside), fit) in full.into_iter().zip(inside).zip(fits) {
                let key = self.tree.key(node);
                let is_done = fit.is_good || key.level >= self.floor;
                if is_done && !edits.split.contains(&key) {
                    let vertex = fit
                        .vertex
                        .map(|place| VertexNumber::add(&mut self.vertices, place));
                    let data = self.tree.data_mut(node);
                    data.state = State::Full { vertex, inside };
                    data.hint = fit.nearest;
                } else {
                    coarse.push(node);
                }
            }
            drop(roots);
            progress.check()?;
            front = self.split_all(&coarse);
        }
        Ok(())
    }

    fn evaluate_corners(
        &mut self,
        cells: &[(NodeId, Probe)],
        progress: &Progress,
    ) -> Result<(), Cancelled> {
        // in Morton order, so that neighbors follow one another; for each corner, cells that know the side come first
        let mut missing: Vec<(u64, u32)> = cells
            .par_iter()
            .enumerate()
            .flat_map_iter(|(at, (node, probe))| {
                let (key, unknown) = (self.tree.key(*node), probe.region == Region::Unknown);
                (0..8)
                    .map(move |octant| key.corner(octant))
                    .filter(|corner| {
                        !progress.is_cancelled() && !self.corners.contains_key(&corner.code())
                    })
                    .map(move |corner| (corner.morton() << 1 | u64::from(unknown), at as u32))
            })
            .collect();
        progress.check()?;
        missing.par_sort_unstable();
        progress.check()?;
        missing.dedup_by_key(|&mut (place, _)| place >> 1);
        let values: Vec<(u64, CornerValue)> = missing
            .into_par_iter()
            .map(|(place, at)| {
                progress.check()?;
                let corner = Corner::at_morton(place >> 1);
                Ok((corner.code(), self.evaluate(corner, &cells[at as usize].1)))
            })
            .collect::<Result<_, Cancelled>>()?;
        self.corners.reserve(values.len());
        for some in values.chunks(AT_ONCE) {
            progress.check()?;
            self.corners.extend(some.iter().copied());
        }
        progress.check()
    }

    /// Finds the points at which the surface crosses the edges of some cells, given with the inside bits of their corners. Up
    /// to four cells share an edge, which is evaluated once.
    fn roots(
        &self,
        cells: &[(NodeId, Probe)],
        inside: &[u8],
        progress: &Progress,
    ) -> Result<Roots, Cancelled> {
        let mut edges: Vec<EdgeKey> = cells
            .par_iter()
            .zip(inside)
            .flat_map_iter(|((node, _), &inside)| crossed_edges(self.tree.key(*node), inside))
            .collect();
        progress.check()?;
        edges.par_sort_unstable();
        progress.check()?;
        edges.dedup();
        progress.check()?;
        let found: Vec<(EdgeKey, Sample)> = edges
            .into_par_iter()
            .map(|edge| {
                progress.check()?;
                let ends = edge.ends();
                let points = ends.map(|end| self.setting.frame.point(end));
                let values = ends.map(|end| self.corners[&end.code()]);
                let enough = ON_SURFACE * self.setting.tolerance;
                let place =
                    |i: usize| Place::new(points[i], values[i].value + self.setting.field.level);
                let known = [place(0), place(1)];
                // the cells around must not matter: the known ones differ between tiles
                let region = self.setting.field.region_between(&known);
                let ends = Ends {
                    points,
                    values,
                    known: &known,
                };
                Ok((edge, root(self.setting.field, region, ends, enough)))
            })
            .collect::<Result<_, Cancelled>>()?;
        let mut roots = Roots::with_capacity_and_hasher(found.len(), FxBuildHasher);
        for some in found.chunks(AT_ONCE) {
            progress.check()?;
            roots.extend(some.iter().copied());
        }
        Ok(roots)
    }

    /// Evaluates the field at a corner of a probed cell.
    fn evaluate(&self, corner: Corner, probe: &Probe) -> CornerValue {
        let p = self.setting.frame.point(corner);
        let near = self.setting.field.near(p, probe.near.triangle);
        let region = match probe.region {
            Region::Unknown => {
                (self.setting.field).region_beside(p, near.distance, &[probe.middle])
            }
            known => known,
        };
        CornerValue {
            triangle: near.triangle,
            value: self.setting.field.value(near.distance, region),
        }
    }

    fn corners_of(&self, key: CellKey) -> [CornerValue; 8] {
        std::array::from_fn(|octant| self.corners[&key.corner(octant).code()])
    }
}

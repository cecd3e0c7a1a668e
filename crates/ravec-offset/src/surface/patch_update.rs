//! Polygons of a patch replaced in place.

use super::{Patch, TRIANGLES_AT_ONCE};
use ravec_octree::NodeId;
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;

impl Patch {
    /// Replaces the polygons whose leaves satisfy `is_gone` by `fresh` ones without copying the others. Vertices on the seam
    /// are stored twice, under the same name.
    ///
    /// After a cancellation the patch is invalid.
    pub fn replace(
        &mut self,
        is_gone: impl Fn(&[NodeId; 4]) -> bool + Sync,
        fresh: Self,
        progress: &Progress,
    ) -> Result<(), Cancelled> {
        let is_kept: Vec<bool> = (self.leaves.par_iter())
            .map(|leaves| !is_gone(leaves))
            .collect();
        progress.check()?;
        self.retain(&is_kept, progress)?;
        self.drop_unused_vertices();
        progress.check()?;
        self.insert(fresh, progress)
    }

    /// Drops polygons.
    fn retain(&mut self, is_kept: &[bool], progress: &Progress) -> Result<(), Cancelled> {
        let Some(first_gone) = is_kept.iter().position(|is_kept| !is_kept) else {
            return Ok(());
        };
        let mut start = (self.edge_of).partition_point(|&edge| (edge as usize) < first_gone);
        let (mut edges, mut triangles) = (first_gone, start);
        for (edge, &is_kept) in is_kept.iter().enumerate().skip(first_gone) {
            if edge.is_multiple_of(TRIANGLES_AT_ONCE as usize) {
                progress.check()?;
            }
            let of_edge = &self.edge_of[start..];
            let count = of_edge.iter().take_while(|&&e| e as usize == edge).count();
            let end = start + count;
            if is_kept {
                self.edges[edges] = self.edges[edge];
                self.leaves[edges] = self.leaves[edge];
                self.triangles.copy_within(start..end, triangles);
                self.proofs.copy_within(start..end, triangles);
                self.edge_of[triangles..triangles + count].fill(edges as u32);
                edges += 1;
                triangles += count;
            }
            start = end;
        }
        self.edges.truncate(edges);
        self.leaves.truncate(edges);
        self.triangles.truncate(triangles);
        self.proofs.truncate(triangles);
        self.edge_of.truncate(triangles);
        Ok(())
    }

    fn drop_unused_vertices(&mut self) {
        let mut numbers = vec![u32::MAX; self.positions.len()];
        for &v in self.triangles.iter().flatten() {
            numbers[v as usize] = 0;
        }
        let mut next = 0;
        for (v, number) in numbers.iter_mut().enumerate() {
            if *number == 0 {
                *number = next as u32;
                self.positions[next] = self.positions[v];
                self.names[next] = self.names[v];
                next += 1;
            }
        }
        self.positions.truncate(next);
        self.names.truncate(next);
        for corners in &mut self.triangles {
            *corners = corners.map(|v| numbers[v as usize]);
        }
    }

    /// Inserts polygons around other edges, each at its place in the order.
    fn insert(&mut self, fresh: Self, progress: &Progress) -> Result<(), Cancelled> {
        let first_new = self.positions.len() as u32;
        self.positions.extend(fresh.positions);
        self.names.extend(fresh.names);
        let mut kept = [self.edges.len(), self.triangles.len()];
        let mut new = [fresh.edges.len(), fresh.triangles.len()];
        // polygons move from the last on, so their target is always free
        let mut at = [0, 1].map(|i| kept[i] + new[i]);
        self.edges.extend(&fresh.edges);
        self.leaves.extend(&fresh.leaves);
        self.triangles.extend(&fresh.triangles);
        self.proofs.extend(&fresh.proofs);
        self.edge_of.extend(&fresh.edge_of);
        while let Some(last_new) = new[0].checked_sub(1) {
            if at[0].is_multiple_of(TRIANGLES_AT_ONCE as usize) {
                progress.check()?;
            }
            at[0] -= 1;
            let is_later = |last: &usize| self.edges[*last].place() > fresh.edges[last_new].place();
            if let Some(last) = kept[0].checked_sub(1).filter(is_later) {
                self.edges[at[0]] = self.edges[last];
                self.leaves[at[0]] = self.leaves[last];
                while kept[1] > 0 && self.edge_of[kept[1] - 1] as usize == last {
                    let [from, to] = [kept[1] - 1, at[1] - 1];
                    self.triangles[to] = self.triangles[from];
                    self.proofs[to] = self.proofs[from];
                    self.edge_of[to] = at[0] as u32;
                    (kept[1], at[1]) = (from, to);
                }
                kept[0] = last;
            } else {
                self.edges[at[0]] = fresh.edges[last_new];
                self.leaves[at[0]] = fresh.leaves[last_new];
                while new[1] > 0 && fresh.edge_of[new[1] - 1] as usize == last_new {
                    let [from, to] = [new[1] - 1, at[1] - 1];
                    self.triangles[to] = fresh.triangles[from].map(|v| first_new + v);
                    self.proofs[to] = fresh.proofs[from];
                    self.edge_of[to] = at[0] as u32;
                    (new[1], at[1]) = (from, to);
                }
                new[0] = last_new;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::{Edge, Proof, ProofStart, Room, VertexName};
    use glam::DVec3;
    use proptest::prelude::*;
    use ravec_octree::Corner;

    /// The corners of a facet, and its proof.
    type Facet = ([(DVec3, VertexName); 3], Option<Proof>);

    /// A polygon independent of the numbering of its vertices.
    #[derive(Debug, Clone, PartialEq)]
    struct Plain {
        edge: Edge,
        leaves: [NodeId; 4],
        facets: Vec<Facet>,
    }

    fn plain(patch: &Patch) -> Vec<Plain> {
        let of_edge = patch.edge_of.chunk_by(|a, b| a == b);
        let counts: Vec<usize> = of_edge.map(<[u32]>::len).collect();
        assert_eq!(counts.len(), patch.edges.len());
        let mut t = 0;
        counts
            .into_iter()
            .enumerate()
            .map(|(edge, count)| {
                assert!(
                    patch.edge_of[t..t + count]
                        .iter()
                        .all(|&e| e as usize == edge)
                );
                t += count;
                let vertex = |v: u32| (patch.positions[v as usize], patch.names[v as usize]);
                let facets =
                    (t - count..t).map(|t| (patch.triangles[t].map(vertex), patch.proofs[t]));
                Plain {
                    edge: patch.edges[edge],
                    leaves: patch.leaves[edge],
                    facets: facets.collect(),
                }
            })
            .collect()
    }

    /// Polygons around edges at places on a line, each given with its leaf and its number of triangles.
    fn patch(polygons: &[(u32, NodeId, usize)], height: f64) -> Patch {
        let mut patch = Patch::default();
        for &(place, leaf, count) in polygons {
            let start = Corner([place, 0, 0]);
            let axis = (place % 3) as u8;
            let edge = patch.edges.len() as u32;
            patch.edges.push(Edge {
                start,
                length: 1,
                axis,
            });
            patch.leaves.push([leaf, leaf + 1, leaf, leaf]);
            for k in 0..count {
                // some vertices are those of the polygon before
                let first = (patch.positions.len() as u32).saturating_sub(k as u32 % 3);
                for v in patch.positions.len() as u32..first + 3 {
                    let at = DVec3::new(f64::from(place), f64::from(v), height);
                    patch.positions.push(at);
                    patch.names.push(VertexName::OnEdge { start, axis });
                }
                patch.triangles.push([first, first + 1, first + 2]);
                patch.edge_of.push(edge);
                let given = ProofStart {
                    hints: [leaf, k as u32, 0, 0],
                    is_last: false,
                };
                let proof = (k != 1).then(|| Proof::new(Room::Enough, &given));
                patch.proofs.push(proof);
            }
        }
        patch
    }

    fn polygons() -> impl Strategy<Value = Vec<(u32, NodeId, usize)>> {
        let polygon = (0..60u32, (0..8u32, 1..5usize));
        prop::collection::btree_map(polygon.0, polygon.1, 0..30).prop_map(|all| {
            let all = all.into_iter();
            all.map(|(place, (leaf, count))| (place, leaf, count))
                .collect()
        })
    }

    proptest! {
        #[test]
        fn polygons_are_replaced_as_in_sorted_lists(before in polygons(), fresh in polygons(), gone in 0..9u32) {
            let is_gone = |leaves: &[NodeId; 4]| leaves[0] >= gone;
            let left = before.iter().filter(|polygon| polygon.1 < gone);
            let places: Vec<u32> = left.map(|polygon| polygon.0).collect();
            let mut fresh = fresh;
            fresh.retain(|polygon| !places.contains(&polygon.0));
            let (mut replaced, new) = (patch(&before, 0.0), patch(&fresh, 1.0));
            let mut expected = plain(&replaced);
            expected.retain(|polygon| !is_gone(&polygon.leaves));
            expected.extend(plain(&new));
            expected.sort_by_key(|polygon| polygon.edge.place());
            replaced.replace(is_gone, new, &Progress::none()).unwrap();
            let found = plain(&replaced);
            prop_assert_eq!(&found, &expected);
            // no vertex is left that no triangle has
            let mut used: Vec<u32> = replaced.triangles.iter().flatten().copied().collect();
            used.sort_unstable();
            used.dedup();
            prop_assert_eq!(used.len(), replaced.positions.len());
            prop_assert_eq!(replaced.names.len(), replaced.positions.len());
            for polygon in found {
                for (facet, proof) in &polygon.facets {
                    let known = replaced.proof_of(&polygon.edge, facet.map(|(at, _)| at));
                    prop_assert_eq!(known, *proof);
                }
                prop_assert_eq!(replaced.proof_of(&polygon.edge, [DVec3::NAN; 3]), None);
            }
        }
    }
}

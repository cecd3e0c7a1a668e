//! Closed components of the surface that can be reached from far away.

use super::components::{ComponentShare, components};
use crate::params::OffsetError;
use crate::surface::{Patch, VertexName, border, compact};
use glam::DVec3;
use ravec_mesh::{Aabb, Bvh, TriMesh, WindingNumbers, measure, winding_number};
use ravec_numeric::DisjointSets;
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;
use rustc_hash::FxHashMap;
use std::borrow::Cow;

/// Returns, by triangle, whether its component can be reached from far away. The surface must be closed and free of
/// intersections, with triangles seen from outside of the solid.
///
/// A component encloses connected space. So the border of a cavity, with negative volume, cannot be reached, nor can components
/// inside another one.
pub(crate) fn reachable(
    positions: &[DVec3],
    triangles: &[[u32; 3]],
    progress: &Progress,
) -> Result<Vec<bool>, Cancelled> {
    let part_of = components(positions.len(), triangles, progress)?;
    let count = part_of.iter().max().map_or(0, |&last| last as usize + 1);
    if count <= 1 {
        return Ok(vec![true; triangles.len()]);
    }
    let mut groups: Vec<Vec<[u32; 3]>> = vec![Vec::new(); count];
    for (triangle, &part) in triangles.iter().zip(&part_of) {
        groups[part as usize].push(*triangle);
    }
    let parts: Vec<TriMesh> = groups
        .iter()
        .map(|group| compact(positions, group, progress))
        .collect::<Result<_, Cancelled>>()?;
    drop(groups);
    let encloses: Vec<bool> = parts
        .iter()
        .map(|part| measure(part).volume > 0.0)
        .collect();
    let mut seen = encloses.clone();
    for (solid, part) in parts.iter().enumerate().filter(|&(i, _)| encloses[i]) {
        progress.check()?;
        let bounds = part.bounds();
        let inside_box: Vec<usize> = (0..count)
            .filter(|&other| other != solid && seen[other])
            .filter(|&other| holds(&bounds, parts[other].positions()[0]))
            .collect();
        if inside_box.is_empty() {
            continue;
        }
        let bvh = Bvh::try_new(part, progress)?;
        let winding = WindingNumbers::try_new(&bvh, progress)?;
        for other in inside_box {
            progress.check()?;
            seen[other] = !winding.is_inside(parts[other].positions()[0]);
        }
    }
    Ok(part_of.iter().map(|&part| seen[part as usize]).collect())
}

/// As [`reachable`] for a surface in blocks, of which few are in memory at once: returns the reachable triangles of the blocks
/// that are partly reachable.
pub(crate) fn reachable_in_blocks<'a>(
    blocks: usize,
    patch: impl Fn(usize) -> Result<Cow<'a, Patch>, OffsetError>,
    progress: &Progress,
) -> Result<FxHashMap<usize, Vec<bool>>, OffsetError> {
    let parts = BlockComponents::find(blocks, &patch, progress)?;
    let seen = parts.outermost(blocks, &patch, progress)?;
    let BlockComponents {
        shares,
        first_of,
        part_of,
    } = parts;
    let mut found = FxHashMap::default();
    for at in 0..blocks {
        progress.check()?;
        let next = first_of
            .get(at + 1)
            .map_or(shares.len(), |&next| next as usize);
        let own = first_of[at] as usize..next;
        if part_of[own].iter().all(|&part| seen[part as usize]) {
            continue;
        }
        let patch = patch(at)?;
        let part_of_triangle = components(patch.positions.len(), &patch.triangles, progress)?;
        let is_seen = |part: &u32| seen[part_of[(first_of[at] + part) as usize] as usize];
        found.insert(at, part_of_triangle.iter().map(is_seen).collect());
    }
    Ok(found)
}

/// The components of blocks, and which of them are shares of the same component of the surface.
struct BlockComponents {
    shares: Vec<ComponentShare>,
    /// Number of the first share of each block.
    first_of: Vec<u32>,
    /// The component of each share: its first share, which sums the others.
    part_of: Vec<u32>,
}

impl BlockComponents {
    fn find<'a>(
        blocks: usize,
        patch: &impl Fn(usize) -> Result<Cow<'a, Patch>, OffsetError>,
        progress: &Progress,
    ) -> Result<Self, OffsetError> {
        let mut shares: Vec<ComponentShare> = Vec::new();
        let mut first_of = Vec::with_capacity(blocks);
        let mut sets = DisjointSets::default();
        let mut known: FxHashMap<VertexName, u32> = FxHashMap::default();
        for at in 0..blocks {
            let patch = patch(at)?;
            let part_of = components(patch.positions.len(), &patch.triangles, progress)?;
            let first = shares.len() as u32;
            first_of.push(first);
            let border = border(patch.positions.len(), patch.triangles.iter());
            for (corners, &part) in patch.triangles.iter().zip(&part_of) {
                let number = first + part;
                if number as usize == shares.len() {
                    sets.push();
                    shares.push(ComponentShare::at(patch.positions[corners[0] as usize]));
                }
                shares[number as usize].add(corners.map(|v| patch.positions[v as usize]));
                for &v in corners.iter().filter(|&&v| border[v as usize]) {
                    let other = *known.entry(patch.names[v as usize]).or_insert(number);
                    sets.join(other, number);
                }
            }
        }
        drop(known);
        let part_of: Vec<u32> = (0..shares.len() as u32)
            .map(|share| sets.root(share))
            .collect();
        for share in 0..shares.len() {
            let part = part_of[share] as usize;
            if part != share {
                let of_part = shares[share].clone();
                shares[part].join(&of_part);
            }
        }
        Ok(Self {
            shares,
            first_of,
            part_of,
        })
    }

    /// Returns, by share, whether its component encloses volume and lies in no other one.
    fn outermost<'a>(
        &self,
        blocks: usize,
        patch: &impl Fn(usize) -> Result<Cow<'a, Patch>, OffsetError>,
        progress: &Progress,
    ) -> Result<Vec<bool>, OffsetError> {
        let Self {
            shares,
            first_of,
            part_of,
        } = self;
        let solids: Vec<u32> = (0..shares.len() as u32)
            .filter(|&part| part_of[part as usize] == part && shares[part as usize].volume > 0.0)
            .collect();
        let mut seen = vec![false; shares.len()];
        for &solid in &solids {
            seen[solid as usize] = true;
        }
        // for each solid, the others that may lie in it, and its winding number around them
        let mut within: FxHashMap<u32, Vec<(u32, f64)>> = FxHashMap::default();
        for &solid in &solids {
            let bounds = shares[solid as usize].bounds;
            let others = (solids.iter().copied())
                .filter(|&other| other != solid && holds(&bounds, shares[other as usize].origin));
            let others: Vec<(u32, f64)> = others.map(|other| (other, 0.0)).collect();
            if !others.is_empty() {
                within.insert(solid, others);
            }
        }
        for at in 0..blocks {
            progress.check()?;
            if within.is_empty() {
                break;
            }
            let patch = patch(at)?;
            let part_of_triangle = components(patch.positions.len(), &patch.triangles, progress)?;
            let mut groups: FxHashMap<u32, Vec<[u32; 3]>> = FxHashMap::default();
            for (&corners, &part) in patch.triangles.iter().zip(&part_of_triangle) {
                let part = part_of[(first_of[at] + part) as usize];
                if within.contains_key(&part) {
                    groups.entry(part).or_default().push(corners);
                }
            }
            for (part, group) in groups {
                let mesh = compact(&patch.positions, &group, progress)?;
                if let Some(others) = within.get_mut(&part) {
                    others.par_iter_mut().for_each(|(other, turns)| {
                        *turns += winding_number(&mesh, shares[*other as usize].origin);
                    });
                }
            }
        }
        for (other, turns) in within.into_values().flatten() {
            seen[other as usize] &= turns <= 0.5;
        }
        Ok(seen)
    }
}

fn holds(bounds: &Aabb, p: DVec3) -> bool {
    p.cmpge(bounds.min).all() && p.cmple(bounds.max).all()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A box around the origin; seen from within if `inward`.
    fn add_box(half: f64, inward: bool, positions: &mut Vec<DVec3>, triangles: &mut Vec<[u32; 3]>) {
        let first = positions.len() as u32;
        for k in 0..8 {
            let sign = |bit: i32| if k >> bit & 1 == 1 { half } else { -half };
            positions.push(DVec3::new(sign(0), sign(1), sign(2)) + DVec3::splat(1e5));
        }
        let quads = [
            [0, 2, 3, 1],
            [4, 5, 7, 6],
            [0, 1, 5, 4],
            [2, 6, 7, 3],
            [0, 4, 6, 2],
            [1, 3, 7, 5],
        ];
        for [a, b, c, d] in quads {
            for [p, q, r] in [[a, b, c], [a, c, d]] {
                let t = if inward { [p, r, q] } else { [p, q, r] };
                triangles.push(t.map(|v: u32| v + first));
            }
        }
    }

    #[test]
    fn a_component_in_a_cavity_cannot_be_reached() {
        let (mut positions, mut triangles) = (vec![], vec![]);
        add_box(1.0, false, &mut positions, &mut triangles);
        add_box(3.0, false, &mut positions, &mut triangles);
        add_box(2.0, true, &mut positions, &mut triangles);
        let seen = reachable(&positions, &triangles, &Progress::none()).unwrap();
        assert_eq!(seen, [[false; 12], [true; 12], [false; 12]].concat());
        assert_eq!(
            reachable(&positions, &triangles[..12], &Progress::none()).unwrap(),
            vec![true; 12]
        );
    }

    #[test]
    fn solids_side_by_side_can_be_reached() {
        let (mut positions, mut triangles) = (vec![], vec![]);
        add_box(1.0, false, &mut positions, &mut triangles);
        add_box(1.0, false, &mut positions, &mut triangles);
        for p in &mut positions[8..] {
            p.x += 1.5;
            p.y += 2.5;
        }
        assert_eq!(
            reachable(&positions, &triangles, &Progress::none()).unwrap(),
            vec![true; 24]
        );
    }
}

//! Which closed surfaces can be reached from far away.

use crate::params::OffsetError;
use crate::tile::{Patch, TRIANGLES_AT_ONCE, VertexName, border};
use glam::DVec3;
use ravec_mesh::{Aabb, Bvh, TriMesh, WindingNumbers, measure, winding_number};
use ravec_numeric::DisjointSets;
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;
use rustc_hash::FxHashMap;
use std::borrow::Cow;

/// Of each triangle of a closed surface that does not meet itself, and is seen from outside of what it encloses, whether it
/// can be reached from far away.
///
/// What a part of the surface encloses hangs together. So the border of a cavity, which encloses nothing, cannot be reached,
/// and of the other parts those that lie inside another one cannot.
pub(crate) fn reachable(
    positions: &[DVec3],
    triangles: &[[u32; 3]],
    progress: &Progress,
) -> Result<Vec<bool>, Cancelled> {
    let part_of = parts(positions.len(), triangles, progress)?;
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

/// As [`reachable`] for a surface in blocks, of which few are taken at once: the triangles that can be reached of those blocks of
/// which only some can.
pub(crate) fn reachable_in_blocks<'a>(
    blocks: usize,
    patch: impl Fn(usize) -> Result<Cow<'a, Patch>, OffsetError>,
    progress: &Progress,
) -> Result<FxHashMap<usize, Vec<bool>>, OffsetError> {
    // the parts of blocks, and which of them are the same part of the surface
    let mut shares: Vec<Share> = Vec::new();
    let mut first_of = Vec::with_capacity(blocks);
    let mut sets = DisjointSets::default();
    let mut known: FxHashMap<VertexName, u32> = FxHashMap::default();
    for at in 0..blocks {
        let patch = patch(at)?;
        let part_of = parts(patch.positions.len(), &patch.triangles, progress)?;
        let first = shares.len() as u32;
        first_of.push(first);
        let border = border(patch.positions.len(), patch.triangles.iter());
        for (corners, &part) in patch.triangles.iter().zip(&part_of) {
            let number = first + part;
            if number as usize == shares.len() {
                sets.push();
                shares.push(Share::at(patch.positions[corners[0] as usize]));
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
    let solids: Vec<u32> = (0..shares.len() as u32)
        .filter(|&part| part_of[part as usize] == part && shares[part as usize].volume > 0.0)
        .collect();
    let mut seen = vec![false; shares.len()];
    for &solid in &solids {
        seen[solid as usize] = true;
    }
    // of each solid those others that may lie in it, and how often it goes around them
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
        let part_of_triangle = parts(patch.positions.len(), &patch.triangles, progress)?;
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
        let part_of_triangle = parts(patch.positions.len(), &patch.triangles, progress)?;
        let is_seen = |part: &u32| seen[part_of[(first_of[at] + part) as usize] as usize];
        found.insert(at, part_of_triangle.iter().map(is_seen).collect());
    }
    Ok(found)
}

/// What a block has of a part of the surface.
#[derive(Debug, Clone)]
struct Share {
    /// One of its corners.
    origin: DVec3,
    /// The volume under its triangles as seen from there, and their area as a vector, which says what it is elsewhere.
    volume: f64,
    area: DVec3,
    bounds: Aabb,
}

impl Share {
    fn at(origin: DVec3) -> Self {
        Self {
            origin,
            volume: 0.0,
            area: DVec3::ZERO,
            bounds: Aabb::EMPTY,
        }
    }

    fn add(&mut self, corners: [DVec3; 3]) {
        let [a, b, c] = corners.map(|corner| corner - self.origin);
        self.volume += a.dot(b.cross(c)) / 6.0;
        self.area += 0.5 * (b - a).cross(c - a);
        self.bounds = self.bounds.union(Aabb::around(corners));
    }

    fn join(&mut self, other: &Self) {
        self.volume += other.volume + other.area.dot(other.origin - self.origin) / 3.0;
        self.area += other.area;
        self.bounds = self.bounds.union(other.bounds);
    }
}

fn holds(bounds: &Aabb, p: DVec3) -> bool {
    p.cmpge(bounds.min).all() && p.cmple(bounds.max).all()
}

/// Of each triangle the number of the part that it hangs together with.
fn parts(
    vertices: usize,
    triangles: &[[u32; 3]],
    progress: &Progress,
) -> Result<Vec<u32>, Cancelled> {
    let mut sets = DisjointSets::new(vertices);
    for some in triangles.chunks(TRIANGLES_AT_ONCE as usize) {
        progress.check()?;
        for &[a, b, c] in some {
            sets.join(a, b);
            sets.join(a, c);
        }
    }
    progress.check()?;
    let mut numbers = vec![u32::MAX; vertices];
    let mut count = 0;
    let numbered = triangles
        .iter()
        .map(|&[a, ..]| {
            let number = &mut numbers[sets.root(a) as usize];
            if *number == u32::MAX {
                *number = count;
                count += 1;
            }
            *number
        })
        .collect();
    Ok(numbered)
}

/// The mesh of some triangles, without vertices that none of them uses.
pub(crate) fn compact(
    positions: &[DVec3],
    triangles: &[[u32; 3]],
    progress: &Progress,
) -> Result<TriMesh, Cancelled> {
    let mut numbers = FxHashMap::default();
    let mut used = Vec::new();
    let mut compacted = Vec::with_capacity(triangles.len());
    for some in triangles.chunks(TRIANGLES_AT_ONCE as usize) {
        progress.check()?;
        compacted.extend(some.iter().map(|triangle| {
            triangle.map(|corner| {
                *numbers.entry(corner).or_insert_with(|| {
                    used.push(positions[corner as usize]);
                    (used.len() - 1) as u32
                })
            })
        }));
    }
    progress.check()?;
    Ok(TriMesh::new(used, compacted).expect("corners are finite and have numbers"))
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
    fn what_lies_in_a_cavity_cannot_be_reached() {
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

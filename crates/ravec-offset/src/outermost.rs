//! Which closed surfaces can be reached from far away.

use crate::tile::TRIANGLES_AT_ONCE;
use glam::DVec3;
use ravec_mesh::{Aabb, Bvh, TriMesh, WindingNumbers, measure};
use ravec_progress::{Cancelled, Progress};

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

fn holds(bounds: &Aabb, p: DVec3) -> bool {
    p.cmpge(bounds.min).all() && p.cmple(bounds.max).all()
}

/// The smallest member of the set that `at` is in, of sets that are joined but never split.
pub(crate) fn root(parents: &mut [u32], mut at: u32) -> u32 {
    while parents[at as usize] != at {
        let above = parents[parents[at as usize] as usize];
        parents[at as usize] = above;
        at = above;
    }
    at
}

/// Of each triangle the number of the part that it hangs together with.
fn parts(
    vertices: usize,
    triangles: &[[u32; 3]],
    progress: &Progress,
) -> Result<Vec<u32>, Cancelled> {
    let mut parents: Vec<u32> = (0..vertices as u32).collect();
    for some in triangles.chunks(TRIANGLES_AT_ONCE as usize) {
        progress.check()?;
        for &[a, b, c] in some {
            for other in [b, c] {
                let (a, b) = (root(&mut parents, a), root(&mut parents, other));
                parents[a.max(b) as usize] = a.min(b);
            }
        }
    }
    progress.check()?;
    let mut numbers = vec![u32::MAX; vertices];
    let mut count = 0;
    let numbered = triangles
        .iter()
        .map(|&[a, ..]| {
            let number = &mut numbers[root(&mut parents, a) as usize];
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
    let mut numbers = rustc_hash::FxHashMap::default();
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

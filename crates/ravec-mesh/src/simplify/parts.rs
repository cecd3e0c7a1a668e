//! Parts of a mesh that are simplified on their own.

use glam::DVec3;

use super::deviation::{Sample, take_from_end};
use super::surface::edge_key;
use crate::adjacency::is_proper;
use crate::keyed::{KeyedMap, KeyedSet};
use crate::{Aabb, TriMesh};

/// Patches have at least about half as many triangles: of smaller ones much is seam.
const MIN_TRIANGLES: usize = 4096;

/// Patches have at most about as many triangles: little is gained from fewer seams than that.
const MAX_TRIANGLES: usize = 16_384;

/// Number of patches that are made between these limits: enough for as many threads.
const PATCHES: usize = 8;

/// Least number of triangles, roughly, of the pieces into which the surroundings of seams are cut.
const MIN_SEAM_TRIANGLES: usize = 512;

/// Between which shares of its triangles a piece of seams is cut, and in how many places that is tried.
const CUT_SHARES: [f64; 2] = [0.25, 0.75];
const CUT_PLACES: usize = 32;

/// A part of the original or of what became of it, as a mesh of its own.
pub(super) struct Part {
    pub mesh: TriMesh,
    /// The names of its vertices and triangles in the original.
    pub vertices: Vec<u32>,
    pub triangles: Vec<u32>,
}

impl Part {
    /// Of `triangles`, those that are left if each vertex is the one in `merged_into`, at `positions`.
    pub fn new(
        original: &TriMesh,
        (merged_into, positions): (&[u32], &[DVec3]),
        triangles: impl Iterator<Item = u32>,
    ) -> Self {
        let mut names: KeyedMap<u32, u32> = KeyedMap::default();
        let mut vertices = Vec::new();
        let mut kept = Vec::new();
        let mut corners = Vec::new();
        for t in triangles {
            let now = original.triangles()[t as usize].map(|v| merged_into[v as usize]);
            if is_proper(now) {
                kept.push(t);
                corners.push(now.map(|v| {
                    *names.entry(v).or_insert_with(|| {
                        vertices.push(v);
                        vertices.len() as u32 - 1
                    })
                }));
            }
        }
        let positions = vertices.iter().map(|&v| positions[v as usize]);
        Self {
            mesh: TriMesh::new(positions.collect(), corners).expect("names were just given"),
            vertices,
            triangles: kept,
        }
    }

    /// Gives samples that are near triangles of the original as it is the names that these have here.
    pub fn rename(&self, samples: &mut [Sample]) {
        let names: KeyedMap<u32, u32> = self.triangles.iter().copied().zip(0..).collect();
        for sample in samples {
            let triangle = names[&sample.triangle];
            *sample = Sample {
                place: sample.place,
                original: triangle,
                settled: triangle,
                triangle,
            };
        }
    }

    /// Those of its vertices that are `chosen`, a bit for each vertex of the original, by their names here.
    pub fn vertices_in(&self, chosen: &[bool]) -> Vec<u32> {
        let all = (0..).zip(&self.vertices);
        let here = all.filter(|(_, v)| chosen[**v as usize]);
        here.map(|(name, _)| name).collect()
    }

    /// Those of its vertices that are at most this many `rings` away from what is `chosen`, a bit for each vertex of the
    /// original: a bit for each of them.
    pub fn around(&self, chosen: &[bool], rings: usize) -> Vec<bool> {
        let here = self.vertices.iter().map(|&v| chosen[v as usize]);
        let mut around: Vec<bool> = here.collect();
        add_rings(&mut around, &self.mesh, rings);
        around
    }

    /// The triangles with a corner that is `chosen`, a bit for each of its vertices.
    pub fn triangles_at(&self, chosen: &[bool]) -> Vec<u32> {
        let all = (0..).zip(self.mesh.triangles());
        let at = all.filter(|(_, corners)| corners.iter().any(|&v| chosen[v as usize]));
        at.map(|(t, _)| t).collect()
    }

    /// The features of the original that remain, by their names here.
    pub fn features(&self, features: &[[u32; 2]], merged_into: &[u32]) -> Vec<[u32; 2]> {
        if features.is_empty() {
            return Vec::new();
        }
        let sides = self.mesh.triangles().iter();
        let edges: KeyedSet<u64> = sides
            .flat_map(|&[a, b, c]| [edge_key(a, b), edge_key(b, c), edge_key(c, a)])
            .collect();
        let names: KeyedMap<u32, u32> = self.vertices.iter().copied().zip(0..).collect();
        features
            .iter()
            .filter_map(|ends| {
                let [a, b] = ends.map(|v| names.get(&merged_into[v as usize]));
                Some([*a?, *b?])
            })
            .filter(|&[a, b]| edges.contains(&edge_key(a, b)))
            .collect()
    }
}

/// Cuts the triangles into patches.
pub(super) fn cut(mesh: &TriMesh) -> Vec<Vec<u32>> {
    let proper = (0_u32..)
        .zip(mesh.triangles())
        .filter(|(_, t)| is_proper(**t));
    let all: Vec<u32> = proper.map(|(t, _)| t).collect();
    let middles: Vec<DVec3> = (0..mesh.triangles().len() as u32)
        .map(|t| mesh.corners(t).into_iter().sum())
        .collect();
    let most = (all.len() / PATCHES).clamp(MIN_TRIANGLES, MAX_TRIANGLES);
    let mut patches = Vec::new();
    let mut to_cut = vec![all];
    while let Some(mut triangles) = to_cut.pop() {
        if triangles.len() <= most + most / 8 {
            triangles.sort_unstable();
            patches.push(triangles);
            continue;
        }
        let size = Aabb::around(triangles.iter().map(|&t| middles[t as usize])).size();
        let longest = (0..3).max_by(|&a, &b| size[a].total_cmp(&size[b]));
        let axis = longest.unwrap_or(0);
        let half = triangles.len() / 2;
        triangles.select_nth_unstable_by(half, |&s, &t| {
            let [x, y] = [s, t].map(|t| middles[t as usize][axis]);
            x.total_cmp(&y).then(s.cmp(&t))
        });
        to_cut.push(triangles.split_off(half));
        to_cut.push(triangles);
    }
    patches
}

/// Cuts `triangles` of a mesh into pieces, where they are sparsest.
///
/// Around seams they are dense along the planes of seams, so that they are cut across these.
pub(super) fn cut_sparsely(mesh: &TriMesh, triangles: Vec<u32>) -> Vec<Vec<u32>> {
    let middle = |t: u32| mesh.corners(t).into_iter().sum::<DVec3>();
    let most = (triangles.len() / PATCHES).clamp(MIN_SEAM_TRIANGLES, MAX_TRIANGLES);
    let mut pieces = Vec::new();
    let mut to_cut = vec![triangles];
    while let Some(mut triangles) = to_cut.pop() {
        if triangles.len() <= 2 * most {
            triangles.sort_unstable();
            pieces.push(triangles);
            continue;
        }
        let count = triangles.len();
        let [first, last] = CUT_SHARES.map(|share| (share * count as f64) as usize);
        let step = (last - first) / CUT_PLACES;
        // the farther some of them reach along an axis, the fewer are cut across it
        let cuts = (0..3).map(|axis| {
            let mut places: Vec<(f64, u32)> =
                (triangles.iter()).map(|&t| (middle(t)[axis], t)).collect();
            places.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            let width = |at: usize| places[at + step].0 - places[at].0;
            let at = (0..CUT_PLACES).map(|i| first + i * step);
            let widest = at.max_by(|&a, &b| width(a).total_cmp(&width(b)));
            let widest = widest.unwrap_or(first);
            (width(widest), widest + step / 2, places)
        });
        let Some((_, at, places)) = cuts.max_by(|a, b| a.0.total_cmp(&b.0)) else {
            break;
        };
        let sorted = places.iter().map(|(_, t)| *t);
        triangles.clear();
        triangles.extend(sorted);
        to_cut.push(triangles.split_off(at));
        to_cut.push(triangles);
    }
    pieces
}

/// The group of each triangle, by its index or the number of groups if it is in none, and whether triangles of several groups,
/// or of one and of none, share a vertex.
pub(super) fn borders(mesh: &TriMesh, groups: &[Vec<u32>]) -> (Vec<u32>, Vec<bool>) {
    let mut group_of = vec![groups.len() as u32; mesh.triangles().len()];
    for (g, group) in (0..).zip(groups) {
        for &t in group {
            group_of[t as usize] = g;
        }
    }
    let mut first = vec![None; mesh.positions().len()];
    let mut shared = vec![false; first.len()];
    for (&group, corners) in group_of.iter().zip(mesh.triangles()) {
        for &v in corners.iter().filter(|_| is_proper(*corners)) {
            shared[v as usize] |= *first[v as usize].get_or_insert(group) != group;
        }
    }
    (group_of, shared)
}

/// Takes out the samples of each group, where `group_of` gives the group of a triangle; those of no group stay.
pub(super) fn by_group(
    samples: &mut Vec<Sample>,
    groups: usize,
    group_of: impl Fn(u32) -> u32,
) -> Vec<Vec<Sample>> {
    let mut counts = vec![0; groups];
    for sample in &*samples {
        if let Some(count) = counts.get_mut(group_of(sample.triangle) as usize) {
            *count += 1;
        }
    }
    let mut samples_of: Vec<Vec<Sample>> = counts.into_iter().map(Vec::with_capacity).collect();
    let mut others = Vec::new();
    take_from_end(samples, |sample| {
        let group = samples_of.get_mut(group_of(sample.triangle) as usize);
        group.unwrap_or(&mut others).push(sample);
    });
    for list in samples_of.iter_mut().chain([&mut others]) {
        list.reverse();
    }
    *samples = others;
    samples_of
}

/// Adds rings of neighbors to the chosen vertices, which have a bit for each vertex of the mesh.
///
/// # Panics
/// If there are fewer bits than vertices.
pub fn add_rings(chosen: &mut [bool], mesh: &TriMesh, rings: usize) {
    for _ in 0..rings {
        let before = chosen.to_vec();
        for corners in mesh.triangles() {
            if corners.iter().any(|&v| before[v as usize]) {
                for &v in corners {
                    chosen[v as usize] = true;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A flat grid of `columns` × `rows` squares, each of two triangles.
    fn grid(columns: u32, rows: u32) -> TriMesh {
        let at = |x: u32, y: u32| y * (columns + 1) + x;
        let places = (0..=rows).flat_map(|y| (0..=columns).map(move |x| (x, y)));
        let positions = places.map(|(x, y)| DVec3::new(f64::from(x), f64::from(y), 0.0));
        let squares = (0..rows).flat_map(|y| (0..columns).map(move |x| (x, y)));
        let triangles = squares.flat_map(|(x, y)| {
            let [a, b, c, d] = [at(x, y), at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)];
            [[a, b, c], [a, c, d]]
        });
        TriMesh::new(positions.collect(), triangles.collect()).expect("all corners are there")
    }

    #[test]
    fn seams_are_cut_across() {
        // bands of triangles, 10 wide, along two lines that cross
        let mesh = grid(300, 200);
        let near: Vec<u32> = (0..mesh.triangles().len() as u32)
            .filter(|&t| {
                let middle = mesh.corners(t).into_iter().sum::<DVec3>() / 3.0;
                (middle.x - 150.0).abs() < 5.0 || (middle.y - 100.0).abs() < 5.0
            })
            .collect();
        let pieces = cut_sparsely(&mesh, near.clone());
        assert!(pieces.len() > PATCHES / 2, "{} pieces", pieces.len());
        let mut all = pieces.concat();
        all.sort_unstable();
        assert_eq!(all, near);
        // across a band there are 10 vertices, at most twice that where a cut is ragged; along it 200 or 300
        let (_, shared) = borders(&mesh, &pieces);
        let is_inside = |at: DVec3| (at.x - 150.0).abs() < 4.5 || (at.y - 100.0).abs() < 4.5;
        let inside = mesh.positions().iter().zip(&shared);
        let between = inside.filter(|(at, shared)| **shared && is_inside(**at));
        let between = between.count();
        assert!(
            between <= 24 * (pieces.len() - 1),
            "{between} between {}",
            pieces.len()
        );
    }

    #[test]
    fn borders_are_between_groups_and_where_they_end() {
        let mesh = grid(3, 1);
        let (group_of, shared) = borders(&mesh, &[vec![0, 1], vec![2, 3]]);
        assert_eq!(group_of, [0, 0, 1, 1, 2, 2]);
        let expected = [false, true, true, false];
        assert_eq!(shared, [expected, expected].concat());
    }
    #[test]
    fn samples_go_to_their_groups_and_others_stay_in_order() {
        let sample = |i: u32| Sample {
            place: DVec3::splat(f64::from(i)),
            original: i,
            settled: i,
            triangle: i % 5,
        };
        let mut samples: Vec<Sample> = (0..40).map(sample).collect();
        // triangles 0 and 3 in the first group, 1 in the second, others in none
        let group_of = |t: u32| [0, 1, 2, 0, 2][t as usize];
        let groups = by_group(&mut samples, 2, group_of);
        let of = |is_in: fn(u32) -> bool| (0..40).filter(|i| is_in(i % 5)).map(sample).collect();
        let expected: [Vec<Sample>; 3] = [
            of(|t| t == 0 || t == 3),
            of(|t| t == 1),
            of(|t| t == 2 || t == 4),
        ];
        assert_eq!(groups, expected[..2]);
        assert_eq!(samples, expected[2]);
    }
}

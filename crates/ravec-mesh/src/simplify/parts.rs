//! Parts of a mesh that are simplified on their own.

use glam::DVec3;
use rustc_hash::{FxHashMap, FxHashSet};

use super::deviation::Sample;
use super::surface::edge_key;
use crate::adjacency::is_proper;
use crate::{Aabb, TriMesh};

/// Patches have at least about half as many triangles: of smaller ones much is seam.
const FEWEST: usize = 4096;

/// Patches have at most about as many triangles: little is gained from fewer seams than that.
const MOST: usize = 16_384;

/// So many patches are made between these limits: enough for as many threads.
const PATCHES: usize = 8;

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
        let mut names: FxHashMap<u32, u32> = FxHashMap::default();
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
        let names: FxHashMap<u32, u32> = self.triangles.iter().copied().zip(0..).collect();
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

    /// What became of features of the original, by their names here.
    pub fn features(&self, features: &[[u32; 2]], merged_into: &[u32]) -> Vec<[u32; 2]> {
        if features.is_empty() {
            return Vec::new();
        }
        let sides = self.mesh.triangles().iter();
        let edges: FxHashSet<u64> = sides
            .flat_map(|&[a, b, c]| [edge_key(a, b), edge_key(b, c), edge_key(c, a)])
            .collect();
        let names: FxHashMap<u32, u32> = self.vertices.iter().copied().zip(0..).collect();
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
    let most = (all.len() / PATCHES).clamp(FEWEST, MOST);
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

/// Adds so many rings of neighbors to the vertices that are chosen: a bit for each vertex of the mesh.
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

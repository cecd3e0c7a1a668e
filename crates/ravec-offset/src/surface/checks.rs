//! Questions about a list of triangles: the border, equal vertices, intersections.

use super::TRIANGLES_AT_ONCE;
use glam::DVec3;
use ravec_mesh::{BoxTree, TriMesh, self_intersections};
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;
use rustc_hash::{FxHashMap, FxHashSet};

/// Returns, by vertex, whether it is an end of an edge with a single triangle. In a part of a closed surface these are the
/// vertices shared with other parts.
pub(crate) fn border<'a>(
    vertices: usize,
    triangles: impl Iterator<Item = &'a [u32; 3]>,
) -> Vec<bool> {
    let mut open: FxHashSet<[u32; 2]> = FxHashSet::default();
    for &[a, b, c] in triangles {
        for [from, to] in [[a, b], [b, c], [c, a]] {
            if !open.remove(&[to, from]) {
                open.insert([from, to]);
            }
        }
    }
    let mut border = vec![false; vertices];
    for v in open.into_iter().flatten() {
        border[v as usize] = true;
    }
    border
}

/// Returns the vertices whose position equals that of another vertex.
pub(crate) fn doubled(positions: &[DVec3]) -> FxHashSet<u32> {
    let mut by_place: Vec<([u64; 3], u32)> = positions
        .iter()
        // of the two zeros, one
        .map(|&p| (p + DVec3::ZERO).to_array().map(f64::to_bits))
        .zip(0..)
        .collect();
    by_place.par_sort_unstable();
    by_place
        .chunk_by(|a, b| a.0 == b.0)
        .filter(|group| group.len() > 1)
        .flatten()
        .map(|&(_, v)| v)
        .collect()
}

/// Returns pairs of triangles that intersect other than in common vertices and edges.
pub(crate) fn intersecting_pairs(
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

/// Builds the mesh of some triangles without unused vertices.
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

    #[test]
    fn vertices_in_one_place_are_found_whatever_the_sign_of_zero() {
        let places = [DVec3::ZERO, DVec3::X, DVec3::new(-0.0, 0.0, -0.0)];
        let mut found: Vec<u32> = doubled(&places).into_iter().collect();
        found.sort_unstable();
        assert_eq!(found, [0, 2]);
    }
}

//! Classification of the triangles around a slab into upper and lower skin.
//!
//! A triangle belongs to the nearby polyhedron face with the most similar normal. At the edge between skin and wall this is
//! ambiguous for small triangles, so islands join their surroundings, and the lower skin yields where the border between both
//! would touch itself.

use super::slab::Slab;
use glam::DVec3;
use ravec_mesh::{Adjacency, Bvh, TriMesh};
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;

/// Bound on the rounds in which the lower skin yields; more would consume it.
const MAX_ROUNDS: usize = 8;

/// Returns, for each triangle of the border of a slab within the tolerance, whether it belongs to the upper skin or to a wall.
/// The lower skin has as many `parts` as the sheet.
pub(super) fn upper(
    surface: &TriMesh,
    slab: &Slab,
    tolerance: f64,
    parts: usize,
    progress: &Progress,
) -> Result<Vec<bool>, Cancelled> {
    let polyhedra = Bvh::try_new(&slab.polyhedra, progress)?;
    let mut is_upper = (0..surface.triangles().len() as u32)
        .into_par_iter()
        .map(|t| {
            progress.check()?;
            let corners = surface.corners(t);
            let middle = (corners[0] + corners[1] + corners[2]) / 3.0;
            let own = area_vector(corners).normalize_or_zero();
            let mut best = (f64::NEG_INFINITY, true);
            polyhedra.for_each_within(middle, 1.5 * tolerance, |near, _| {
                let normal = area_vector(*polyhedra.corners(near)).normalize_or_zero();
                let likeness = own.dot(normal);
                let is_upper = !slab.is_low[near as usize];
                if likeness > best.0 || (likeness == best.0 && is_upper) {
                    best = (likeness, is_upper);
                }
            });
            Ok(best.1)
        })
        .collect::<Result<Vec<bool>, Cancelled>>()?;
    let adjacency = Adjacency::new(surface);
    for side in [true, false] {
        progress.check()?;
        give_up_islands(surface, &adjacency, &mut is_upper, side, parts);
    }
    for _ in 0..MAX_ROUNDS {
        progress.check()?;
        let pinched: Vec<u32> = (0..surface.positions().len() as u32)
            .into_par_iter()
            .filter(|&v| changes_around(surface, &adjacency, &is_upper, v) > 2)
            .collect();
        if pinched.is_empty() {
            break;
        }
        for t in pinched.into_iter().flat_map(|v| adjacency.triangles_at(v)) {
            is_upper[*t as usize] = true;
        }
        give_up_islands(surface, &adjacency, &mut is_upper, false, parts);
    }
    Ok(is_upper)
}

/// Returns the normal with twice the area as its length.
fn area_vector([a, b, c]: [DVec3; 3]) -> DVec3 {
    (b - a).cross(c - a)
}

/// Counts the edges at a vertex between the upper part and the lower skin.
fn changes_around(surface: &TriMesh, adjacency: &Adjacency, is_upper: &[bool], v: u32) -> usize {
    let around = adjacency.triangles_at(v);
    let first = around.first().map(|&t| is_upper[t as usize]);
    if around.iter().all(|&t| Some(is_upper[t as usize]) == first) {
        return 0;
    }
    let is_change = |&(t, side): &(u32, u8)| {
        let corners = surface.triangles()[t as usize];
        let uses = adjacency.edge_of(t, side).map(|edge| adjacency.uses(edge));
        // each edge at the vertex starts there in one of its triangles
        corners[side as usize] == v
            && uses.is_some_and(|uses| {
                uses.iter()
                    .any(|u| is_upper[u.triangle as usize] != is_upper[t as usize])
            })
    };
    let sides = around.iter().flat_map(|&t| [0, 1, 2].map(|side| (t, side)));
    sides.filter(is_change).count()
}

/// Keeps only the largest parts of one side.
fn give_up_islands(
    surface: &TriMesh,
    adjacency: &Adjacency,
    is_upper: &mut [bool],
    side: bool,
    parts: usize,
) {
    let mut seen = vec![false; is_upper.len()];
    let mut islands: Vec<(f64, Vec<u32>)> = Vec::new();
    for start in 0..is_upper.len() as u32 {
        if is_upper[start as usize] != side || seen[start as usize] {
            continue;
        }
        seen[start as usize] = true;
        let mut island = vec![start];
        let mut area = 0.0;
        let mut at = 0;
        while let Some(&t) = island.get(at) {
            at += 1;
            area += area_vector(surface.corners(t)).length();
            let edges = (0..3).filter_map(|side| adjacency.edge_of(t, side));
            for other in edges
                .flat_map(|edge| adjacency.uses(edge))
                .map(|u| u.triangle)
            {
                if is_upper[other as usize] == side && !seen[other as usize] {
                    seen[other as usize] = true;
                    island.push(other);
                }
            }
        }
        islands.push((area, island));
    }
    islands.sort_by(|a, b| b.0.total_cmp(&a.0));
    for t in islands
        .into_iter()
        .skip(parts)
        .flat_map(|(_, island)| island)
    {
        is_upper[t as usize] = !side;
    }
}

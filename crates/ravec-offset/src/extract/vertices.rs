//! Positions of the contour's vertices.

use super::{CrossingCache, Selection};
use crate::grow::{Refinement, Sample};
use glam::DVec3;
use ravec_octree::Contour;
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;
use rustc_hash::FxBuildHasher;
use std::hash::BuildHasher as _;

/// Places the contour's vertices.
pub(super) fn vertices(
    refinement: &Refinement<'_>,
    selection: &Selection,
    contour: &Contour,
    places: &mut CrossingCache,
    progress: &Progress,
) -> Result<Vec<DVec3>, Cancelled> {
    let cells = &contour.vertex_cells;
    let is_alone = |i: usize| {
        (i == 0 || cells[i - 1] != cells[i]) && (i + 1 == cells.len() || cells[i + 1] != cells[i])
    };
    let placed: Vec<Option<DVec3>> = (0..cells.len())
        .map(|i| refinement.leaf_vertex(cells[i]).filter(|_| is_alone(i)))
        .collect();
    progress.check()?;
    // vertices of leaves with several represent the crossings of their own polygons
    let mut polygons_of: Vec<(u32, u32)> = (0u32..)
        .zip(&contour.polygons)
        .flat_map(|(number, polygon)| polygon.vertices().iter().map(move |&v| (v, number)))
        .filter(|&(vertex, _)| {
            placed[vertex as usize].is_none()
                && selection.is_core(refinement, cells[vertex as usize])
        })
        .collect();
    progress.check()?;
    polygons_of.sort_unstable();
    progress.check()?;
    let mut numbers: Vec<u32> = polygons_of.iter().map(|&(_, polygon)| polygon).collect();
    numbers.par_sort_unstable();
    numbers.dedup();
    let polygons = numbers.par_iter().map(|&n| &contour.polygons[n as usize]);
    places.fill(refinement, polygons, progress)?;
    let groups: Vec<&[(u32, u32)]> = polygons_of.chunk_by(|a, b| a.0 == b.0).collect();
    let known = &places.vertices;
    let found: Vec<(u32, u64, DVec3)> = groups
        .into_par_iter()
        .map(|group| {
            progress.check()?;
            let samples: Vec<Sample> = group
                .iter()
                .map(|&(_, polygon)| places.of(&contour.polygons[polygon as usize]))
                .collect();
            let vertex = group[0].0;
            let key = refinement.tree.key(cells[vertex as usize]);
            let points = samples.iter().map(|s| s.point.to_array().map(f64::to_bits));
            let hash = FxBuildHasher.hash_one((key, points.collect::<Vec<_>>()));
            let position = known.get(&hash).copied();
            let position = position.unwrap_or_else(|| {
                let placed = refinement.cell(key).vertex(&samples).vertex;
                refinement
                    .setting
                    .grid
                    .apart(placed, samples.iter().map(|s| s.point))
            });
            Ok((vertex, hash, position))
        })
        .collect::<Result<_, Cancelled>>()?;
    let mut positions: Vec<DVec3> = placed.into_iter().map(Option::unwrap_or_default).collect();
    places.vertices.clear();
    for (vertex, hash, position) in found {
        positions[vertex as usize] = position;
        places.vertices.insert(hash, position);
    }
    Ok(positions)
}

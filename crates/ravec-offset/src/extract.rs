//! The triangles: polygons around edges with a change of sign, cut so that no two of them meet where they should not.
//!
//! Source: Ju and Udeshi, *Intersection-free Contouring on an Octree Grid*, Pacific Graphics 2006: a dual edge that does
//! not go through its minimal face gets a vertex in the face; a triangle that its edge does not pierce is replaced by a fan
//! around a vertex on that edge.
//!
//! Guarantees: closed, oriented, manifold by its indices. Intersections can be left only in cells with several vertices.

mod crossing;
mod cutting;
mod face;

pub(crate) use crate::extract::crossing::CrossingPlaces;

use crate::cell::Sample;
use crate::extract::cutting::Cutter;
use crate::refine::Refinement;
use crate::scope::Scope;
use crate::tile::{Edge, Patch, TRIANGLES_AT_ONCE, VertexName};
use glam::DVec3;
use ravec_octree::{Contour, NodeId, Polygon};
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;
use rustc_hash::{FxBuildHasher, FxHashSet};
use std::hash::BuildHasher as _;
use std::ops::Range;

/// A surface with, for each triangle, the leaves that it comes from.
pub(crate) struct Extracted {
    pub positions: Vec<DVec3>,
    /// What the positions after those of the contour's vertices are called.
    added: Vec<VertexName>,
    pub triangles: Vec<[u32; 3]>,
    /// The polygon of each triangle.
    pub polygon_of: Vec<u32>,
    pub contour: Contour,
}

impl Extracted {
    /// The leaves around the polygon of a triangle.
    pub fn cells_of(&self, triangle: usize) -> &[NodeId] {
        self.contour.polygons[self.polygon_of[triangle] as usize].cells()
    }

    /// The vertices of each leaf that has several sheets and was looked at with all around it.
    fn crowds(
        &self,
        refinement: &Refinement<'_>,
        scope: &Scope,
    ) -> impl Iterator<Item = Range<usize>> {
        let cells = &self.contour.vertex_cells;
        let mut start = 0;
        cells
            .chunk_by(|a, b| a == b)
            .map(move |crowd| {
                start += crowd.len();
                start - crowd.len()..start
            })
            .filter(|crowd| crowd.len() > 1 && scope.is_core(refinement, cells[crowd.start]))
    }

    /// The leaves in which sheets have the same vertex, which no search for intersections tells from a common one.
    pub fn cells_with_equal_vertices(
        &self,
        refinement: &Refinement<'_>,
        scope: &Scope,
    ) -> Vec<NodeId> {
        self.crowds(refinement, scope)
            .filter(|crowd| {
                crowd
                    .clone()
                    .any(|a| (a + 1..crowd.end).any(|b| self.positions[a] == self.positions[b]))
            })
            .map(|crowd| self.contour.vertex_cells[crowd.start])
            .collect()
    }

    /// The triangles of polygons that have a corner in a leaf with several sheets, or share a leaf with such a polygon.
    pub fn near_crowded_cells(&self, refinement: &Refinement<'_>, scope: &Scope) -> Vec<u32> {
        let mut near: FxHashSet<NodeId> = self
            .crowds(refinement, scope)
            .map(|crowd| self.contour.vertex_cells[crowd.start])
            .collect();
        if near.is_empty() {
            return vec![];
        }
        let touches = |polygon: &Polygon, cells: &FxHashSet<NodeId>| {
            polygon.cells().iter().any(|cell| cells.contains(cell))
        };
        let polygons = &self.contour.polygons;
        let beside: Vec<NodeId> = polygons
            .iter()
            .filter(|polygon| touches(polygon, &near))
            .flat_map(Polygon::cells)
            .copied()
            .collect();
        near.extend(beside);
        let is_near: Vec<bool> = polygons
            .iter()
            .map(|polygon| touches(polygon, &near))
            .collect();
        (0u32..)
            .zip(&self.polygon_of)
            .filter(|&(_, &polygon)| is_near[polygon as usize])
            .map(|(triangle, _)| triangle)
            .collect()
    }

    /// What is asked for.
    pub fn patch(
        &self,
        refinement: &Refinement<'_>,
        scope: &Scope,
        progress: &Progress,
    ) -> Result<Patch, Cancelled> {
        let mut patch = Patch::default();
        let mut numbers = vec![u32::MAX; self.positions.len()];
        let mut last = None;
        for (t, (triangle, &polygon_number)) in
            (0u32..).zip(self.triangles.iter().zip(&self.polygon_of))
        {
            if t.is_multiple_of(TRIANGLES_AT_ONCE) {
                progress.check()?;
            }
            let polygon = &self.contour.polygons[polygon_number as usize];
            if !scope.owns(polygon) {
                continue;
            }
            if last != Some(polygon_number) {
                last = Some(polygon_number);
                patch.edges.push(edge_of(polygon));
                patch.leaves.push(leaves_of(polygon));
            }
            patch.edge_of.push(patch.edges.len() as u32 - 1);
            patch.triangles.push(triangle.map(|v| {
                let number = &mut numbers[v as usize];
                if *number == u32::MAX {
                    *number = patch.positions.len() as u32;
                    patch.positions.push(self.positions[v as usize]);
                    patch.names.push(self.name(refinement, v as usize));
                }
                *number
            }));
        }
        Ok(patch)
    }

    fn name(&self, refinement: &Refinement<'_>, vertex: usize) -> VertexName {
        let cells = &self.contour.vertex_cells;
        let Some(&leaf) = cells.get(vertex) else {
            return self.added[vertex - cells.len()];
        };
        let before = cells[..vertex].iter().rev();
        VertexName::Sheet {
            leaf: refinement.tree.key(leaf).at,
            number: before.take_while(|&&cell| cell == leaf).count() as u32,
        }
    }

    /// The corners of a triangle.
    pub fn facet(&self, triangle: usize) -> [DVec3; 3] {
        self.triangles[triangle].map(|v| self.positions[v as usize])
    }

    /// The leaves in which the ends of an edge of a triangle lie, edge `i` from corner `i` to the next; all around the polygon if
    /// both ends were added when it was cut.
    pub fn cells_at_ends(&self, triangle: usize, i: usize) -> Vec<NodeId> {
        let corners = self.triangles[triangle];
        let ends = [corners[i], corners[(i + 1) % 3]];
        let cell = |&vertex: &u32| self.contour.vertex_cells.get(vertex as usize).copied();
        let cells: Vec<NodeId> = ends.iter().filter_map(cell).collect();
        if cells.is_empty() {
            self.cells_of(triangle).to_vec()
        } else {
            cells
        }
    }

    /// The edge around which the polygon of a triangle lies.
    pub fn edge_of(&self, triangle: usize) -> Edge {
        edge_of(&self.contour.polygons[self.polygon_of[triangle] as usize])
    }

    /// Whether the polygon of a triangle is asked for.
    pub fn is_owned(&self, triangle: usize, scope: &Scope) -> bool {
        scope.owns(&self.contour.polygons[self.polygon_of[triangle] as usize])
    }
}

fn edge_of(polygon: &Polygon) -> Edge {
    Edge {
        start: polygon.start,
        length: polygon.length,
        axis: polygon.axis,
    }
}

/// The leaves of a polygon's corners, the last one twice if there are three.
fn leaves_of(polygon: &Polygon) -> [NodeId; 4] {
    let cells = polygon.cells();
    std::array::from_fn(|i| cells[i.min(cells.len() - 1)])
}

/// The surface of what was looked at, as far as it is asked for, and what that depends on.
pub(crate) fn extract(
    refinement: &Refinement<'_>,
    scope: &mut Scope,
    places: &mut CrossingPlaces,
    progress: &Progress,
) -> Result<Extracted, Cancelled> {
    let crossings = scope.take_crossings(refinement, progress)?;
    let scope = &*scope;
    let is_core = |cell| scope.is_core(refinement, cell);
    let contour = Contour::within(&refinement.tree, &crossings, is_core, || progress.check())?;
    drop(crossings);
    progress.check()?;
    let positions = vertices(refinement, scope, &contour, places, progress)?;
    let cutter = Cutter::new(refinement, scope, &contour, positions);
    Ok(cutter.cut(places, progress)?.with(contour))
}

/// The places of the contour's vertices.
fn vertices(
    refinement: &Refinement<'_>,
    scope: &Scope,
    contour: &Contour,
    places: &mut CrossingPlaces,
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
    // the others stand for where their own polygons' edges go through the surface
    let mut polygons_of: Vec<(u32, u32)> = (0u32..)
        .zip(&contour.polygons)
        .flat_map(|(number, polygon)| polygon.vertices().iter().map(move |&v| (v, number)))
        .filter(|&(vertex, _)| {
            placed[vertex as usize].is_none() && scope.is_core(refinement, cells[vertex as usize])
        })
        .collect();
    progress.check()?;
    polygons_of.sort_unstable();
    progress.check()?;
    let mut numbers: Vec<u32> = polygons_of.iter().map(|&(_, polygon)| polygon).collect();
    numbers.par_sort_unstable();
    numbers.dedup();
    let polygons = numbers.par_iter().map(|&n| &contour.polygons[n as usize]);
    places.look_up(refinement, polygons, progress)?;
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

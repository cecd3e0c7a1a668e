//! Extraction: the surface of a selection, with the leaves that each triangle comes from.

use super::{CrossingCache, Cutter, Selection, vertices};
use crate::grow::Refinement;
use crate::surface::{Edge, Patch, TRIANGLES_AT_ONCE, VertexName};
use glam::DVec3;
use ravec_octree::{Contour, NodeId, Polygon};
use ravec_progress::{Cancelled, Progress};
use rustc_hash::FxHashSet;
use std::ops::Range;

/// An extracted surface.
pub(crate) struct Extracted {
    pub positions: Vec<DVec3>,
    /// Names of the vertices after those of the contour.
    pub(super) added: Vec<VertexName>,
    pub triangles: Vec<[u32; 3]>,
    /// The polygon of each triangle.
    pub polygon_of: Vec<u32>,
    pub contour: Contour,
}

impl Extracted {
    /// Returns the leaves around the polygon of a triangle.
    pub fn cells_of(&self, triangle: usize) -> &[NodeId] {
        self.contour.polygons[self.polygon_of[triangle] as usize].cells()
    }

    /// Returns the vertices of each leaf that has several sheets and known surroundings.
    fn crowds(
        &self,
        refinement: &Refinement<'_>,
        selection: &Selection,
    ) -> impl Iterator<Item = Range<usize>> {
        let cells = &self.contour.vertex_cells;
        let mut start = 0;
        cells
            .chunk_by(|a, b| a == b)
            .map(move |crowd| {
                start += crowd.len();
                start - crowd.len()..start
            })
            .filter(|crowd| crowd.len() > 1 && selection.is_core(refinement, cells[crowd.start]))
    }

    /// Returns the leaves in which sheets have equal vertices, which a search for intersections takes for a common vertex.
    pub fn cells_with_equal_vertices(
        &self,
        refinement: &Refinement<'_>,
        selection: &Selection,
    ) -> Vec<NodeId> {
        self.crowds(refinement, selection)
            .filter(|crowd| {
                crowd
                    .clone()
                    .any(|a| (a + 1..crowd.end).any(|b| self.positions[a] == self.positions[b]))
            })
            .map(|crowd| self.contour.vertex_cells[crowd.start])
            .collect()
    }

    /// Returns the triangles of polygons that have a corner in a leaf with several sheets, or share a leaf with such a polygon.
    pub fn near_crowded_cells(
        &self,
        refinement: &Refinement<'_>,
        selection: &Selection,
    ) -> Vec<u32> {
        let mut near: FxHashSet<NodeId> = self
            .crowds(refinement, selection)
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

    /// Returns the selected polygons.
    pub fn patch(
        &self,
        refinement: &Refinement<'_>,
        selection: &Selection,
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
            if !selection.owns(polygon) {
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

    /// Returns the corners of a triangle.
    pub fn facet(&self, triangle: usize) -> [DVec3; 3] {
        self.triangles[triangle].map(|v| self.positions[v as usize])
    }

    /// Returns the leaves of the ends of edge `i` of a triangle, from corner `i` to the next; all leaves around the polygon if
    /// cutting added both ends.
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

    /// Returns the edge to which the polygon of a triangle is dual.
    pub fn edge_of(&self, triangle: usize) -> Edge {
        edge_of(&self.contour.polygons[self.polygon_of[triangle] as usize])
    }

    /// Returns whether the polygon of a triangle is selected.
    pub fn is_owned(&self, triangle: usize, selection: &Selection) -> bool {
        selection.owns(&self.contour.polygons[self.polygon_of[triangle] as usize])
    }
}

fn edge_of(polygon: &Polygon) -> Edge {
    Edge {
        start: polygon.start,
        length: polygon.length,
        axis: polygon.axis,
    }
}

/// Returns the leaves of a polygon's corners, the last one twice if there are three.
fn leaves_of(polygon: &Polygon) -> [NodeId; 4] {
    let cells = polygon.cells();
    std::array::from_fn(|i| cells[i.min(cells.len() - 1)])
}

/// Extracts the selected surface and its surroundings.
pub(crate) fn extract(
    refinement: &Refinement<'_>,
    selection: &mut Selection,
    places: &mut CrossingCache,
    progress: &Progress,
) -> Result<Extracted, Cancelled> {
    let crossings = selection.take_crossings(refinement, progress)?;
    let selection = &*selection;
    let is_core = |cell| selection.is_core(refinement, cell);
    let contour = Contour::within(&refinement.tree, &crossings, is_core, || progress.check())?;
    drop(crossings);
    progress.check()?;
    let positions = vertices(refinement, selection, &contour, places, progress)?;
    let cutter = Cutter::new(refinement, selection, &contour, positions);
    Ok(cutter.cut(places, progress)?.with(contour))
}

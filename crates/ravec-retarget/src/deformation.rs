//! The map from every point of a picture to its place in the new one.
//!
//! Cell by cell, bilinear in the four corners: continuous, and invertible because no cell folds.

use crate::bounds::State;
use crate::forms::GridRun;
use crate::grid::{Cell, Grid};
use glam::{DVec2, dvec2};
use ravec_raster::Size;
use std::sync::Arc;

/// Figures of a solution for one size.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct SolveSummary {
    /// The new width in pixels.
    pub width: usize,
    /// The new height.
    pub height: usize,
    /// The scale that important content was to get.
    pub object_scale: f64,
    /// Edges of cells that had to be kept from folding. If 0, the result is the minimum of the energy.
    pub bounded_edges: usize,
    /// Steps that this took, two solutions of a factored system each.
    pub steps: usize,
    /// The share of plain scaling that was mixed in to prove that nothing folds, 0 to 1.
    pub plain_share: f64,
    /// The share of a side that was cut off.
    pub cropped: f64,
    /// The least local area against that of plain scaling: above 0, or something would fold.
    pub least_area: f64,
}

/// A deformation of a picture to a new size.
#[derive(Debug, Clone)]
pub struct Deformation {
    pub(crate) size: Size,
    pub(crate) grid: Arc<Grid>,
    /// Position of each vertex of the grid in the new picture. The frame is `0..width` × `0..height`; what is outside
    /// is cut off.
    pub(crate) vertices: Vec<DVec2>,
    pub(crate) weights: Arc<Vec<f64>>,
    pub(crate) runs: Arc<Vec<GridRun>>,
    /// State from which a solution for a similar size starts.
    pub(crate) state: Option<State>,
    pub(crate) summary: SolveSummary,
}

/// A side of a cell in the new picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GridLine {
    /// Its two ends.
    pub ends: [DVec2; 2],
    /// `true` if it is part of the picture's border.
    pub border: bool,
}

impl Deformation {
    /// The size of the new picture.
    pub fn size(&self) -> Size {
        self.size
    }

    /// The size of the picture that was analyzed.
    pub fn source_size(&self) -> Size {
        self.grid.image_size
    }

    /// Figures of the solution.
    pub fn summary(&self) -> &SolveSummary {
        &self.summary
    }

    /// The place of a point of the old picture in the new one, both in pixels. Points outside go on from the nearest cell.
    pub fn target_from_source(&self, point: DVec2) -> DVec2 {
        let weights = self.grid.weights_at(point / self.grid.unit_px());
        let parts = weights.iter();
        parts
            .map(|&(vertex, weight)| weight * self.vertices[vertex as usize])
            .sum()
    }

    /// Returns `true` if the new picture is the old one, pixel by pixel.
    pub fn is_identity(&self) -> bool {
        let moved =
            |vertex: u32| self.vertices[vertex as usize].distance(self.grid.position_px(vertex));
        self.size == self.grid.image_size
            && (0..self.vertices.len() as u32).all(|vertex| moved(vertex) < 1e-6)
    }

    /// The sides of all cells.
    pub fn grid_lines(&self) -> impl Iterator<Item = GridLine> {
        let units = self.grid.units;
        self.grid.edges.iter().map(move |edge| {
            let across = usize::from(edge.across);
            let at = edge
                .ends
                .map(|end| self.grid.vertices[end as usize][across]);
            GridLine {
                ends: edge.ends.map(|end| self.vertices[end as usize]),
                border: at == [0; 2] || at == [units[across]; 2],
            }
        })
    }

    /// The straight runs that were held straight, as chains of points a cell apart.
    pub fn straight_runs(&self) -> impl Iterator<Item = Vec<DVec2>> {
        self.runs.iter().map(|run| {
            let unit = self.grid.unit_px();
            run.samples()
                .map(|(at, _)| self.target_from_source(at * unit))
                .collect()
        })
    }

    /// The cells with their corners in order around them, and their weights: 0.0025 where the picture may give way, 0.025 to 1
    /// by importance, 100 where it is protected.
    pub fn cells(&self) -> impl Iterator<Item = ([DVec2; 4], f64)> {
        self.grid
            .cells
            .iter()
            .zip(self.weights.iter())
            .map(|(cell, &weight)| {
                let [a, b, c, d] = self.corners(cell);
                ([a, b, d, c], weight)
            })
    }

    /// Upper left, upper right, lower left, lower right.
    pub(crate) fn corners(&self, cell: &Cell) -> [DVec2; 4] {
        cell.corners.map(|corner| self.vertices[corner as usize])
    }

    /// The least of the local areas, against plain scaling.
    pub(crate) fn least_area(&self) -> f64 {
        let unit = self.grid.unit_px();
        let old = dvec2(
            self.grid.image_size.width() as f64,
            self.grid.image_size.height() as f64,
        );
        let new = dvec2(self.size.width() as f64, self.size.height() as f64);
        let plain = (unit * new / old).element_product();
        self.grid
            .cells
            .iter()
            .flat_map(|cell| {
                let [a, b, c, d] = self.corners(cell);
                let [width, height] = self.grid.extent(cell);
                let scale = 1.0 / (plain * (width * height) as f64);
                [
                    (b - a).perp_dot(c - a),
                    (b - a).perp_dot(d - b),
                    (d - c).perp_dot(c - a),
                    (d - c).perp_dot(d - b),
                ]
                .map(|area| area * scale)
            })
            .fold(f64::INFINITY, f64::min)
    }
}

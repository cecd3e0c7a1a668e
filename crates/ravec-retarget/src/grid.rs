//! The grid that is deformed: cells, their corners, and which corners hang on an edge of a larger cell.
//!
//! Positions are counted in *units*, the smallest cells; a regular grid has a cell a unit. Where cells of two sizes meet, the
//! corners of the smaller ones that lie within an edge of the larger one *hang*: they are not moved freely but stay on the
//! edge, in proportion, so that the deformed cells leave no gap.

use glam::{DVec2, dvec2};
use ravec_raster::Size;

/// A cell. The last ones of a row or column may be cut by the border of the grid.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Cell {
    /// First column and row in units.
    pub(crate) first: [usize; 2],
    /// Units a side, a power of two.
    pub(crate) span: usize,
    /// Upper left, upper right, lower left, lower right vertex.
    pub(crate) corners: [u32; 4],
}

/// A side of a cell that is not part of a longer side of another cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Edge {
    /// Its left or upper end, and the other one.
    pub(crate) ends: [u32; 2],
    /// `true` if it runs along x.
    pub(crate) across: bool,
}

/// No vertex here.
const NONE: u32 = u32::MAX;

#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Grid {
    /// Columns and rows of units.
    pub(crate) units: [usize; 2],
    /// The size of the picture, in pixels.
    pub(crate) image_size: Size,
    /// Position of each vertex, in units.
    pub(crate) vertices: Vec<[usize; 2]>,
    pub(crate) cells: Vec<Cell>,
    pub(crate) edges: Vec<Edge>,
    /// The cell over each unit, row by row.
    cell_of_unit: Vec<u32>,
    /// The vertex at each corner of units, row by row, or [`NONE`].
    vertex_at: Vec<u32>,
    /// For a vertex that hangs: the ends of the edge that it lies on.
    hangs_on: Vec<Option<[u32; 2]>>,
}

impl Grid {
    /// The grid whose cell over unit `(col, row)` has `span_of(col, row)` units a side, a power of two, aligned to multiples of
    /// its span.
    pub(crate) fn new(
        image_size: Size,
        units: [usize; 2],
        span_of: impl Fn(usize, usize) -> usize,
    ) -> Self {
        let [cols, rows] = units;
        let mut grid = Self {
            units,
            image_size,
            vertices: Vec::new(),
            cells: Vec::new(),
            edges: Vec::new(),
            cell_of_unit: vec![0; cols * rows],
            vertex_at: vec![NONE; (cols + 1) * (rows + 1)],
            hangs_on: Vec::new(),
        };
        for row in 0..rows {
            for col in 0..cols {
                let span = span_of(col, row);
                if !(col.is_multiple_of(span) && row.is_multiple_of(span)) {
                    continue;
                }
                let (right, below) = ((col + span).min(cols), (row + span).min(rows));
                let corners = [[col, row], [right, row], [col, below], [right, below]]
                    .map(|at| grid.vertex(at));
                for y in row..below {
                    for x in col..right {
                        grid.cell_of_unit[y * cols + x] = grid.cells.len() as u32;
                    }
                }
                grid.cells.push(Cell {
                    first: [col, row],
                    span,
                    corners,
                });
            }
        }
        grid.hangs_on = vec![None; grid.vertices.len()];
        grid.find_hanging();
        grid.collect_edges();
        grid
    }

    fn vertex(&mut self, at: [usize; 2]) -> u32 {
        let place = at[1] * (self.units[0] + 1) + at[0];
        if self.vertex_at[place] == NONE {
            self.vertex_at[place] = self.vertices.len() as u32;
            self.vertices.push(at);
        }
        self.vertex_at[place]
    }

    /// The vertices strictly within the side of a cell between two of its corners, in order.
    pub(crate) fn within_side(&self, ends: [u32; 2]) -> impl Iterator<Item = u32> {
        let [from, to] = ends.map(|end| self.vertices[end as usize]);
        let axis = usize::from(from[0] == to[0]);
        (from[axis] + 1..to[axis]).filter_map(move |along| {
            let mut at = from;
            at[axis] = along;
            let vertex = self.vertex_at[at[1] * (self.units[0] + 1) + at[0]];
            (vertex != NONE).then_some(vertex)
        })
    }

    fn find_hanging(&mut self) {
        let mut found = Vec::new();
        for cell in self.cells.iter().filter(|cell| cell.span > 1) {
            for side in sides(cell) {
                found.extend(self.within_side(side).map(|vertex| (vertex, side)));
            }
        }
        for (vertex, side) in found {
            self.hangs_on[vertex as usize] = Some(side);
        }
    }

    fn collect_edges(&mut self) {
        let mut edges = Vec::new();
        for cell in &self.cells {
            for (index, side) in sides(cell).into_iter().enumerate() {
                if !self.lies_on_longer(side) {
                    edges.push(Edge {
                        ends: side,
                        across: index < 2,
                    });
                }
            }
        }
        edges.sort_unstable_by_key(|edge| edge.ends);
        edges.dedup();
        self.edges = edges;
    }

    /// Returns `true` if a side is part of a longer side of another cell.
    fn lies_on_longer(&self, side: [u32; 2]) -> bool {
        let [a, b] = side;
        let on = |vertex: u32| self.hangs_on[vertex as usize];
        // both ends hang on it, or one does and the other is its end, which may hang elsewhere
        let on_edge_to = |on: Option<[u32; 2]>, end| on.is_some_and(|ends| ends.contains(&end));
        on_edge_to(on(a), b) || on_edge_to(on(b), a) || (on(a).is_some() && on(a) == on(b))
    }

    /// The picture's pixels a unit.
    pub(crate) fn unit_px(&self) -> DVec2 {
        dvec2(
            self.image_size.width() as f64 / self.units[0] as f64,
            self.image_size.height() as f64 / self.units[1] as f64,
        )
    }

    /// Position of a vertex in the picture, in pixels.
    pub(crate) fn position_px(&self, vertex: u32) -> DVec2 {
        let [x, y] = self.vertices[vertex as usize];
        dvec2(x as f64, y as f64) * self.unit_px()
    }

    /// The cell over a position in units; those outside belong to the nearest.
    pub(crate) fn cell_at(&self, at: DVec2) -> &Cell {
        let col = (at.x.max(0.0) as usize).min(self.units[0] - 1);
        let row = (at.y.max(0.0) as usize).min(self.units[1] - 1);
        &self.cells[self.cell_of_unit[row * self.units[0] + col] as usize]
    }

    /// The size of a cell in units, which the border may have cut.
    pub(crate) fn extent(&self, cell: &Cell) -> [usize; 2] {
        let [first, last] = [0, 3].map(|k: usize| self.vertices[cell.corners[k] as usize]);
        [last[0] - first[0], last[1] - first[1]]
    }

    /// Weights of the corners of the cell around a position in units, whose weighted sum is the position.
    pub(crate) fn weights_at(&self, at: DVec2) -> [(u32, f64); 4] {
        let cell = self.cell_at(at);
        let [width, height] = self.extent(cell);
        let u = (at.x - cell.first[0] as f64) / width as f64;
        let v = (at.y - cell.first[1] as f64) / height as f64;
        let weights = [(1.0 - u) * (1.0 - v), u * (1.0 - v), (1.0 - u) * v, u * v];
        [0, 1, 2, 3].map(|k| (cell.corners[k], weights[k]))
    }

    /// A vertex as a weighted mean of vertices that do not hang.
    pub(crate) fn resolved(&self, vertex: u32) -> Vec<(u32, f64)> {
        let mut open = vec![(vertex, 1.0)];
        let mut done: Vec<(u32, f64)> = Vec::new();
        while let Some((vertex, weight)) = open.pop() {
            match self.hangs_on[vertex as usize] {
                // the edge of a larger cell: this ends after as many steps as there are sizes
                Some(ends) => {
                    let [from, to] = ends.map(|end| self.vertices[end as usize]);
                    let at = self.vertices[vertex as usize];
                    let part = (at[0] - from[0] + at[1] - from[1]) as f64;
                    let share = part / (to[0] - from[0] + to[1] - from[1]) as f64;
                    open.push((ends[0], weight * (1.0 - share)));
                    open.push((ends[1], weight * share));
                }
                None => match done.iter_mut().find(|(known, _)| *known == vertex) {
                    Some((_, sum)) => *sum += weight,
                    None => done.push((vertex, weight)),
                },
            }
        }
        done
    }
}

/// The upper, lower, left and right side of a cell.
fn sides(cell: &Cell) -> [[u32; 2]; 4] {
    let [a, b, c, d] = cell.corners;
    [[a, b], [c, d], [a, c], [b, d]]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn size() -> Size {
        Size::new(70, 50).unwrap()
    }

    /// Spans 4 at the left, then 2, then 1 at the right.
    fn graded() -> Grid {
        Grid::new(size(), [7, 5], |col, _| match col {
            0..=3 => 4,
            4..=5 => 2,
            _ => 1,
        })
    }

    #[test]
    fn a_regular_grid_has_a_cell_a_unit_and_nothing_hangs() {
        let grid = Grid::new(size(), [7, 5], |_, _| 1);
        assert_eq!(grid.cells.len(), 35);
        assert_eq!(grid.vertices.len(), 48);
        assert_eq!(grid.edges.len(), 7 * 6 + 8 * 5);
        assert!(grid.hangs_on.iter().all(Option::is_none));
    }

    #[test]
    fn hanging_vertices_stay_where_they_are_on_a_grid_that_is_not_deformed() {
        let grid = graded();
        assert!(grid.hangs_on.iter().any(Option::is_some));
        for vertex in 0..grid.vertices.len() as u32 {
            let resolved = grid.resolved(vertex);
            let sum: f64 = resolved.iter().map(|(_, weight)| weight).sum();
            let at: DVec2 = resolved
                .iter()
                .map(|&(v, weight)| weight * grid.position_px(v))
                .sum();
            assert!((sum - 1.0).abs() < 1e-12);
            assert!(at.distance(grid.position_px(vertex)) < 1e-9);
        }
    }

    #[test]
    fn every_position_is_a_mean_of_the_corners_of_its_cell() {
        for grid in [graded(), Grid::new(size(), [7, 5], |_, _| 1)] {
            for k in 0..=70 {
                let at = dvec2(f64::from(k) * 0.1, f64::from(k) * 5.0 / 70.0);
                let mean: DVec2 = grid
                    .weights_at(at)
                    .iter()
                    .map(|&(vertex, weight)| weight * grid.position_px(vertex))
                    .sum();
                assert!(mean.distance(at * grid.unit_px()) < 1e-9);
            }
        }
    }

    #[test]
    fn sides_within_longer_sides_are_left_out() {
        let grid = graded();
        for edge in &grid.edges {
            assert!(!grid.lies_on_longer(edge.ends));
        }
        // the first cell's right side is cut by cells of half the size, but counts once
        let right = [grid.cells[0].corners[1], grid.cells[0].corners[3]];
        assert_eq!(
            grid.edges.iter().filter(|edge| edge.ends == right).count(),
            1
        );
        assert_eq!(grid.within_side(right).count(), 1);
    }
}

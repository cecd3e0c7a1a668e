//! The closed surface dual to the edges on which a sign changes.
//!
//! Every minimal edge with a sign change has a polygon around it with a corner in each leaf there. Consecutive corners of a
//! polygon are joined by a *dual edge* through the minimal face between their leaves. The boundary of a minimal face has an
//! even number of sign changes, and the polygons around these are joined in pairs, so every dual edge has two polygons. Inside
//! a leaf, corners that are joined through its faces form cycles; each cycle is one vertex.
//!
//! Source: Schaefer, Ju and Warren, *Manifold Dual Contouring*, TVCG 2007; here the pairing in minimal faces takes the place of
//! their clustering, so that the levels of neighbors may differ by any number.
//!
//! Guarantees, for signs that are equal on the border of the root: every dual edge has exactly two polygons, with consistent
//! orientation, and the polygons around every vertex form one fan. Does not guarantee: that two vertices share only one dual
//! edge, nor anything about the positions of vertices. Cost: linear, except for one sort of the dual edges.

use crate::edges::MinimalEdge;
use crate::key::Corner;
use crate::tree::{NodeId, Octree};
use rayon::prelude::*;
use std::convert::Infallible;

/// A minimal edge with a sign change, and the polygon around it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Polygon {
    /// Direction of the edge: 0 for x, 1 for y, 2 for z.
    pub axis: u8,
    /// The end with the lower coordinate is inside.
    pub start_inside: bool,
    /// Number of corners: 3 or 4.
    len: u8,
    /// End of the edge with the lower coordinate.
    pub start: Corner,
    /// Length of the edge on the lattice.
    pub length: u32,
    cells: [NodeId; 4],
    vertices: [u32; 4],
    duals: [u32; 4],
}

impl Polygon {
    /// Returns the leaves of the corners, counterclockwise seen from outside.
    #[inline]
    pub fn cells(&self) -> &[NodeId] {
        &self.cells[..self.len.into()]
    }

    /// Returns the vertices at the corners.
    #[inline]
    pub fn vertices(&self) -> &[u32] {
        &self.vertices[..self.len.into()]
    }

    /// Returns the dual edges: each from the corner with the same index to the next.
    #[inline]
    pub fn duals(&self) -> &[u32] {
        &self.duals[..self.len.into()]
    }

    /// Returns the ends of the edge: the one inside, then the one outside.
    pub fn ends(&self) -> [Corner; 2] {
        let end = self.start.moved(self.axis.into(), self.length);
        if self.start_inside {
            [self.start, end]
        } else {
            [end, self.start]
        }
    }
}

/// A minimal face through which the surface passes from one leaf to another.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct DualEdge {
    /// The two leaves, lower index first.
    pub cells: [NodeId; 2],
    /// The vertices in them.
    pub vertices: [u32; 2],
    /// The polygons that share the dual edge.
    pub polygons: [u32; 2],
    /// Another dual edge passes through the same minimal face.
    pub is_ambiguous: bool,
}

/// Connectivity of the surface.
#[derive(Debug, Clone, Default)]
pub struct Contour {
    /// The polygons, in the order of the edges.
    pub polygons: Vec<Polygon>,
    /// The dual edges.
    pub duals: Vec<DualEdge>,
    /// The leaf of each vertex. Vertices of a leaf are consecutive.
    pub vertex_cells: Vec<NodeId>,
}

/// One side of a polygon.
struct Side {
    cells: [NodeId; 2],
    polygon: u32,
    /// Corner of the polygon from which the side leads to the next.
    corner: u8,
}

impl Contour {
    /// Builds the surface around the edges on which the sign changes, given in any order with whether their start is inside.
    ///
    /// # Panics
    /// If the signs do not belong to corners, so that around some face they change an odd number of times.
    pub fn new<T>(tree: &Octree<T>, crossings: &[(MinimalEdge, bool)]) -> Self {
        let Ok(contour) = Self::within(tree, crossings, |_| true, || Ok::<(), Infallible>(()));
        contour
    }

    /// Builds the part of the surface in some leaves, for which all edges with a sign change must be given.
    ///
    /// Polygons with corners in other leaves are present, but incomplete: their dual edges between such leaves have the index
    /// `u32::MAX`.
    ///
    /// # Errors
    /// Those of `go_on`, which is called repeatedly.
    ///
    /// # Panics
    /// As [`Self::new`].
    pub fn within<T, E>(
        tree: &Octree<T>,
        crossings: &[(MinimalEdge, bool)],
        is_within: impl Fn(NodeId) -> bool,
        mut go_on: impl FnMut() -> Result<(), E>,
    ) -> Result<Self, E> {
        go_on()?;
        let mut polygons: Vec<Polygon> = crossings.iter().map(polygon_around).collect();
        let mut sides: Vec<Side> = Vec::with_capacity(4 * polygons.len());
        for (polygon, p) in (0u32..).zip(&polygons) {
            let cells = p.cells();
            for (side, &cell) in cells.iter().enumerate() {
                let next = cells[(side + 1) % cells.len()];
                sides.push(Side {
                    cells: [cell.min(next), cell.max(next)],
                    polygon,
                    corner: side as u8,
                });
            }
        }
        go_on()?;
        sides.par_sort_unstable_by_key(|side| (side.cells, side.polygon, side.corner));

        let mut duals = Vec::with_capacity(sides.len() / 2);
        let mut fans = Fans::new(4 * polygons.len());
        for face in sides.chunk_by(|a, b| a.cells == b.cells) {
            if duals.len().is_multiple_of(FACES_AT_ONCE) {
                go_on()?;
            }
            if !face[0].cells.iter().any(|&cell| is_within(cell)) {
                continue;
            }
            assert!(face.len().is_multiple_of(2), "signs belong to corners");
            for [a, b] in pairs(tree, &polygons, face) {
                let dual = duals.len() as u32;
                for side in [a, b] {
                    polygons[side.polygon as usize].duals[side.corner as usize] = dual;
                }
                for cell in a.cells {
                    fans.join(corner_in(&polygons, a, cell), corner_in(&polygons, b, cell));
                }
                duals.push(DualEdge {
                    cells: a.cells,
                    vertices: [0; 2],
                    polygons: [a.polygon, b.polygon],
                    is_ambiguous: face.len() > 2,
                });
            }
        }
        go_on()?;
        let vertex_cells = fans.number(&mut polygons);
        go_on()?;
        for dual in &mut duals {
            let polygon = &polygons[dual.polygons[0] as usize];
            for (vertex, cell) in dual.vertices.iter_mut().zip(dual.cells) {
                let corner = polygon.cells().iter().position(|&c| c == cell);
                *vertex =
                    polygon.vertices[corner.expect("a dual edge joins corners of its polygons")];
            }
        }
        Ok(Self {
            polygons,
            duals,
            vertex_cells,
        })
    }
}

/// Batch size between calls of `go_on`: a few milliseconds of work.
const FACES_AT_ONCE: usize = 1 << 14;

fn polygon_around(&(edge, start_inside): &(MinimalEdge, bool)) -> Polygon {
    let [a, b, c, d] = edge.cells;
    let mut around = [a, b, c, d];
    if !start_inside {
        around.reverse();
    }
    let (mut cells, mut len) = ([0; 4], 0);
    for (i, &cell) in around.iter().enumerate() {
        if cell != around[(i + 3) % 4] {
            cells[len] = cell;
            len += 1;
        }
    }
    Polygon {
        axis: edge.axis as u8,
        start_inside,
        len: len as u8,
        start: edge.start,
        length: edge.length,
        cells,
        vertices: [0; 4],
        duals: [u32::MAX; 4],
    }
}

/// Returns the number of the polygon's corner in a cell, over all polygons.
fn corner_in(polygons: &[Polygon], side: &Side, cell: NodeId) -> usize {
    let polygon = &polygons[side.polygon as usize];
    let at = usize::from(side.corner);
    let corner = if polygon.cells[at] == cell {
        at
    } else {
        (at + 1) % usize::from(polygon.len)
    };
    4 * side.polygon as usize + corner
}

/// Joins the sides of a minimal face in pairs.
fn pairs<'a, T>(tree: &Octree<T>, polygons: &[Polygon], face: &'a [Side]) -> Vec<[&'a Side; 2]> {
    if let [a, b] = face {
        return vec![[a, b]];
    }
    let crossings = around_face(tree, polygons, face);
    // a run of inside corners begins where the way around enters: its two ends belong together
    let first = crossings.iter().position(|&(_, enters, _)| enters);
    let first = first.expect("signs change both ways around a face");
    (0..crossings.len() / 2)
        .map(|pair| {
            let at = |i: usize| crossings[(first + 2 * pair + i) % crossings.len()].2;
            [at(0), at(1)]
        })
        .collect()
}

/// Returns the crossings in their order around the face: position, whether the path enters the inside there, side.
fn around_face<'a, T>(
    tree: &Octree<T>,
    polygons: &[Polygon],
    face: &'a [Side],
) -> Vec<(u32, bool, &'a Side)> {
    let [a, b] = face[0].cells.map(|cell| tree.key(cell));
    let small = if a.level >= b.level { a } else { b };
    let touches = |axis: usize| {
        a.at.0[axis] + a.side() == b.at.0[axis] || b.at.0[axis] + b.side() == a.at.0[axis]
    };
    let normal = (0..3).find(|&axis| touches(axis));
    let normal = normal.expect("two leaves that share an edge and a face touch");
    let (u, v) = ((normal + 1) % 3, (normal + 2) % 3);
    let side = 2 * small.side();
    let mut crossings: Vec<_> = face
        .iter()
        .map(|crossing| {
            let polygon = &polygons[crossing.polygon as usize];
            // the middle of the edge, in half steps from the corner of the face
            let middle = |axis: usize| {
                let along = u32::from(usize::from(polygon.axis) == axis);
                2 * (polygon.start.0[axis] - small.at.0[axis]) + along * polygon.length
            };
            let (x, y) = (middle(u), middle(v));
            let (place, forward) = if y == 0 {
                (x, true)
            } else if x == side {
                (side + y, true)
            } else if y == side {
                (3 * side - x, false)
            } else {
                (4 * side - y, false)
            };
            (place, forward != polygon.start_inside, crossing)
        })
        .collect();
    crossings.sort_unstable_by_key(|&(place, ..)| place);
    crossings
}

/// Corners of polygons, joined to fans.
struct Fans {
    parents: Vec<u32>,
}

impl Fans {
    fn new(corners: usize) -> Self {
        Self {
            parents: (0..corners as u32).collect(),
        }
    }

    fn root(&mut self, corner: usize) -> u32 {
        let mut at = corner as u32;
        while self.parents[at as usize] != at {
            let above = self.parents[self.parents[at as usize] as usize];
            self.parents[at as usize] = above;
            at = above;
        }
        at
    }

    /// Joins two corners; the lower root wins, so that the result does not depend on the order.
    fn join(&mut self, a: usize, b: usize) {
        let (a, b) = (self.root(a), self.root(b));
        self.parents[a.max(b) as usize] = a.min(b);
    }

    /// Numbers the fans by cell and first corner; returns their cells.
    fn number(&mut self, polygons: &mut [Polygon]) -> Vec<NodeId> {
        let mut roots = Vec::new();
        for (i, polygon) in polygons.iter().enumerate() {
            for (k, &cell) in polygon.cells().iter().enumerate() {
                let corner = 4 * i + k;
                if self.root(corner) as usize == corner {
                    roots.push((cell, corner as u32));
                }
            }
        }
        roots.sort_unstable();
        let mut numbers = vec![0; self.parents.len()];
        for (number, &(_, root)) in (0u32..).zip(&roots) {
            numbers[root as usize] = number;
        }
        for (i, polygon) in polygons.iter_mut().enumerate() {
            for k in 0..usize::from(polygon.len) {
                polygon.vertices[k] = numbers[self.root(4 * i + k) as usize];
            }
        }
        roots.into_iter().map(|(cell, _)| cell).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::edges::for_each_minimal_edge;
    use crate::key::{CellKey, MAX_LEVEL};
    use std::collections::HashMap;

    /// Signs by a function of corners; the border of the root is outside.
    fn contour(tree: &Octree<()>, inside: impl Fn(Corner) -> bool) -> Contour {
        let at_border = |c: Corner| c.0.iter().any(|&x| x == 0 || x == 1 << MAX_LEVEL);
        let inside = |c: Corner| !at_border(c) && inside(c);
        let mut crossings = Vec::new();
        for_each_minimal_edge(tree, |edge| {
            let start = inside(edge.start);
            if start != inside(edge.end()) {
                crossings.push((edge, start));
            }
        });
        Contour::new(tree, &crossings)
    }

    /// The promises of the module, from their definition.
    fn check(contour: &Contour) {
        let mut uses: HashMap<u32, Vec<[u32; 2]>> = HashMap::new();
        let mut fans: HashMap<u32, Vec<[u32; 2]>> = HashMap::new();
        for polygon in &contour.polygons {
            let (vertices, duals) = (polygon.vertices(), polygon.duals());
            let len = vertices.len();
            assert!(len == 3 || len == 4);
            for k in 0..len {
                assert_eq!(
                    contour.vertex_cells[vertices[k] as usize],
                    polygon.cells()[k]
                );
                uses.entry(duals[k])
                    .or_default()
                    .push([vertices[k], vertices[(k + 1) % len]]);
                fans.entry(vertices[k])
                    .or_default()
                    .push([duals[(k + len - 1) % len], duals[k]]);
            }
        }
        assert_eq!(uses.len(), contour.duals.len());
        for (dual, ways) in uses {
            let [[a, b], [c, d]] = ways[..] else {
                panic!("dual edge {dual} has {} polygons", ways.len());
            };
            assert_eq!([a, b], [d, c], "orientation");
            let mut ends = contour.duals[dual as usize].vertices;
            ends.sort_unstable();
            assert_eq!(ends, [a.min(b), a.max(b)]);
        }
        for wedges in fans.into_values() {
            // from the first wedge on, each next one begins with the dual edge with which the last one ended
            let next: HashMap<u32, u32> = wedges.iter().map(|&[i, o]| (o, i)).collect();
            assert_eq!(next.len(), wedges.len());
            let (mut at, mut steps) = (wedges[0][1], 0);
            loop {
                at = next[&at];
                steps += 1;
                if at == wedges[0][1] {
                    break;
                }
            }
            assert_eq!(steps, wedges.len(), "one fan around a vertex");
        }
    }

    /// A tree with all cells of a level.
    fn uniform(level: u8) -> Octree<()> {
        let mut tree = Octree::new(());
        for _ in 0..level {
            for leaf in tree.leaves().collect::<Vec<_>>() {
                tree.split(leaf, |_, ()| ());
            }
        }
        tree
    }

    #[test]
    fn all_signs_of_a_cell_give_a_manifold_beside_coarse_and_fine_neighbors() {
        // the corners of one inner cell of a 4 x 4 x 4 tree; some of its neighbors are split
        for split in [0u32, 1, 0b1010_0110] {
            let mut tree = uniform(2);
            let leaves: Vec<_> = tree.leaves().collect();
            for (i, &leaf) in leaves.iter().enumerate() {
                if split >> (i % 8) & 1 == 1 && i / 8 != 7 {
                    tree.split(leaf, |_, ()| ());
                }
            }
            let cell = CellKey::ROOT.child(7).child(0);
            for signs in 0..256u32 {
                let surface = contour(&tree, |corner| {
                    (0..8).any(|octant| signs >> octant & 1 == 1 && cell.corner(octant) == corner)
                });
                check(&surface);
            }
        }
    }

    #[test]
    fn random_signs_on_random_trees_give_manifolds() {
        let mut state = 5u64;
        let mut random = move || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            state >> 33
        };
        for _ in 0..60 {
            let mut tree = uniform(1);
            for _ in 0..25 {
                let leaves: Vec<_> = tree.leaves().collect();
                let leaf = leaves[random() as usize % leaves.len()];
                if tree.key(leaf).level < 6 {
                    tree.split(leaf, |_, ()| ());
                }
            }
            let salt = random();
            let surface = contour(&tree, |corner| {
                let mixed = (corner.code() ^ salt).wrapping_mul(0x9e37_79b9_7f4a_7c15);
                mixed >> 62 == 0
            });
            assert!(!surface.polygons.is_empty());
            check(&surface);
        }
    }

    #[test]
    fn a_single_inside_corner_gives_a_box_of_six_quads_seen_from_outside() {
        let tree = uniform(2);
        let middle = Corner([1 << (MAX_LEVEL - 1); 3]);
        let surface = contour(&tree, |corner| corner == middle);
        assert_eq!(surface.polygons.len(), 6);
        assert_eq!(surface.vertex_cells.len(), 8);
        let center = |cell: NodeId| {
            let key = tree.key(cell);
            key.at.0.map(|x| f64::from(x) + 0.5 * f64::from(key.side()))
        };
        let m = f64::from(1u32 << (MAX_LEVEL - 1));
        for polygon in &surface.polygons {
            assert_eq!(polygon.ends()[0], middle);
            let [a, b, c] = [0, 1, 2].map(|k| glam::DVec3::from(center(polygon.cells()[k])));
            assert!((b - a).cross(c - a).dot(a - glam::DVec3::splat(m)) > 0.0);
        }
    }
    #[test]
    fn a_contour_that_is_not_wanted_any_more_ends_wherever_it_is() {
        let tree = uniform(3);
        let mut crossings = Vec::new();
        for_each_minimal_edge(&tree, |edge| {
            let inside = |c: Corner| c.0.iter().all(|&x| x >> (MAX_LEVEL - 3) & 3 == 2);
            if inside(edge.start) != inside(edge.end()) {
                crossings.push((edge, inside(edge.start)));
            }
        });
        let mut asked = 0u32;
        let whole = Contour::within(
            &tree,
            &crossings,
            |_| true,
            || {
                asked += 1;
                Ok::<(), ()>(())
            },
        );
        check(&whole.unwrap());
        for most in 0..asked {
            let mut left = most;
            let go_on = || {
                let go_on = if left == 0 { Err("enough") } else { Ok(()) };
                left = left.saturating_sub(1);
                go_on
            };
            let end = Contour::within(&tree, &crossings, |_| true, go_on);
            assert_eq!(end.unwrap_err(), "enough");
        }
    }

    #[test]
    fn a_part_of_a_contour_is_as_it_is_in_the_whole() {
        let tree = uniform(3);
        let inside = |c: Corner| (c.0[0] ^ c.0[1] ^ c.0[2]) >> (MAX_LEVEL - 3) & 3 == 3;
        let at_border = |c: Corner| c.0.iter().any(|&x| x == 0 || x == 1 << MAX_LEVEL);
        let inside = |c: Corner| !at_border(c) && inside(c);
        let mut crossings = Vec::new();
        for_each_minimal_edge(&tree, |edge| {
            if inside(edge.start) != inside(edge.end()) {
                crossings.push((edge, inside(edge.start)));
            }
        });
        let whole = Contour::new(&tree, &crossings);
        let is_within = |cell: NodeId| tree.key(cell).at.0[0] < 1 << (MAX_LEVEL - 1);
        let known: Vec<_> = crossings
            .iter()
            .filter(|(edge, _)| edge.cells.iter().any(|&cell| is_within(cell)))
            .copied()
            .collect();
        let go_on = || Ok::<(), Infallible>(());
        let Ok(part) = Contour::within(&tree, &known, is_within, go_on);
        // the polygon of an edge, as leaves with the number of the sheet there
        let sheets = |contour: &Contour, polygon: &Polygon| -> Vec<(NodeId, usize)> {
            let vertices = polygon.vertices().iter().map(|&v| {
                let cell = contour.vertex_cells[v as usize];
                let first = contour.vertex_cells.iter().position(|&c| c == cell);
                (cell, v as usize - first.unwrap())
            });
            vertices.collect()
        };
        let mut compared = 0;
        for polygon in &part.polygons {
            if !polygon.cells().iter().all(|&cell| is_within(cell)) {
                continue;
            }
            let same = |p: &&Polygon| (p.start, p.axis) == (polygon.start, polygon.axis);
            let other = whole.polygons.iter().find(same).unwrap();
            assert_eq!(sheets(&part, polygon), sheets(&whole, other));
            compared += 1;
        }
        assert!(compared > 50);
    }
}

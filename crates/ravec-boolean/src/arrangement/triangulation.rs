//! Triangulation of a piece of a plane, with all its points and all its lines.
//!
//! Points are inserted one by one; segments are forced in by flipping the edges that they cross, and where two segments
//! cross, the point is made from the lines and planes that they lie in. All decisions are exact. Edges that nothing
//! prescribes are flipped to make round triangles; that alone is decided in rounded numbers, as nothing depends on it.
//!
//! Source: Lawson 1977 (insertion and flips); Sloan, "A fast algorithm for generating constrained Delaunay
//! triangulations", 1993.
//!
//! Guarantees: every point is a vertex, every segment a chain of edges, no triangle is inverted or flat. Does not
//! guarantee: the Delaunay property where triangles are thinner than rounding.

mod segments;
#[cfg(test)]
mod tests;

use std::ops::Deref;

use glam::DVec3;
use ravec_mesh::Sign;
use rustc_hash::FxHashMap;

use super::exact::Grid;
use super::point::{Point, orient2d};

/// No triangle.
const NONE: u32 = u32::MAX;

/// Least distance of the sum of two angles from the limit at which an edge is flipped, as a sine. Smaller lets rounding
/// flip an edge back and forth, larger leaves thinner triangles.
const FLIP_MARGIN: f64 = 1e-9;

/// Passes over all edges when they are made round in the end. One does nearly all of it; the limit is for rounding.
const PASSES: usize = 8;

/// The surface, beside the plane, in which a segment lies.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Line {
    /// The line through two corners.
    Edge([DVec3; 2]),
    /// Another plane.
    Plane([DVec3; 3]),
}

/// A point of others or of our own.
#[derive(Debug)]
pub(crate) enum PointRef<'a> {
    Shared(&'a Point),
    Own(Box<Point>),
}

impl Deref for PointRef<'_> {
    type Target = Point;

    fn deref(&self) -> &Point {
        match self {
            Self::Shared(point) => point,
            Self::Own(point) => point,
        }
    }
}

#[derive(Debug, Clone, Copy)]
struct Tri {
    /// Counter-clockwise.
    corners: [u32; 3],
    /// The triangle over the edge opposite of each corner.
    beyond: [u32; 3],
}

impl Tri {
    fn index_of(&self, vertex: u32) -> usize {
        self.corners
            .iter()
            .position(|&c| c == vertex)
            .expect("asked only of triangles at the vertex")
    }

    /// The side whose ends are `a` and `b`.
    fn side_of(&self, a: u32, b: u32) -> usize {
        (0..3)
            .find(|&i| self.corners[i] != a && self.corners[i] != b)
            .expect("a triangle has a third corner")
    }
}

/// Location of a point.
enum Place {
    Vertex(u32),
    Side(u32, usize),
    Inside(u32),
}

/// A triangulation under construction. Vertices are numbered in the order in which they came.
pub(crate) struct Triangulation<'a> {
    plane: [DVec3; 3],
    axis: usize,
    grid: Grid,
    max_width: f64,
    points: Vec<PointRef<'a>>,
    triangles: Vec<Tri>,
    triangle_at: Vec<u32>,
    lines: Vec<Line>,
    lines_of: FxHashMap<[u32; 2], Vec<u32>>,
    last: u32,
    /// Triangles whose sides may be flipped, empty between insertions.
    stack: Vec<u32>,
}

fn key(a: u32, b: u32) -> [u32; 2] {
    [a.min(b), a.max(b)]
}

impl<'a> Triangulation<'a> {
    /// Begins with one triangle, which must run counter-clockwise as seen against `axis` and hold everything that
    /// follows. `plane` is the plane of it all, `max_width` the widest interval that a new point may have.
    pub fn new(
        corners: [PointRef<'a>; 3],
        plane: [DVec3; 3],
        axis: usize,
        grid: Grid,
        max_width: f64,
    ) -> Self {
        Self {
            plane,
            axis,
            grid,
            max_width,
            points: corners.into(),
            triangles: vec![Tri {
                corners: [0, 1, 2],
                beyond: [NONE; 3],
            }],
            triangle_at: vec![0; 3],
            lines: Vec::new(),
            lines_of: FxHashMap::default(),
            last: 0,
            stack: Vec::new(),
        }
    }

    pub fn point(&self, vertex: u32) -> &Point {
        &self.points[vertex as usize]
    }

    pub fn point_count(&self) -> usize {
        self.points.len()
    }

    /// The triangles, counter-clockwise.
    pub fn triangles(&self) -> impl Iterator<Item = [u32; 3]> + '_ {
        self.triangles.iter().map(|t| t.corners)
    }

    fn orient(&self, a: u32, b: u32, c: u32) -> Sign {
        orient2d(
            self.point(a),
            self.point(b),
            self.point(c),
            self.axis,
            self.grid,
        )
    }

    /// The vertex at a point, which is made if there is none. Second, whether it is new.
    pub fn insert(&mut self, point: PointRef<'a>) -> (u32, bool) {
        match self.locate(&point) {
            Place::Vertex(vertex) => (vertex, false),
            Place::Side(triangle, side) => (self.split_side(triangle, side, point), true),
            Place::Inside(triangle) => (self.split_triangle(triangle, point), true),
        }
    }

    /// The vertex at a point that is known to be on a straight chain of edges, which is given by its vertices and grows
    /// by the new one. Nothing is asked but the order along the chain.
    pub fn insert_on(&mut self, chain: &mut Vec<u32>, point: PointRef<'a>) -> (u32, bool) {
        let (first, last) = (self.point(chain[0]), self.point(chain[chain.len() - 1]));
        let (from, to) = (first.rounded(), last.rounded());
        let along = (to - from).abs();
        let mut axes = [0, 1, 2];
        axes.sort_by(|&i, &j| along[j].total_cmp(&along[i]));
        let (axis, way) = axes
            .into_iter()
            .map(|axis| (axis, first.compare(last, axis, self.grid)))
            .find(|(_, way)| way.is_ne())
            .expect("the ends of a chain are two places");
        let rank = |vertex: u32| {
            let order = self.point(vertex).compare(&point, axis, self.grid);
            if way.is_lt() { order } else { order.reverse() }
        };
        match chain.binary_search_by(|&vertex| rank(vertex)) {
            Ok(at) => (chain[at], false),
            // not beyond the ends, whatever the caller believes
            Err(at) => {
                let at = at.clamp(1, chain.len() - 1);
                let (t, side) = self.find(chain[at - 1], chain[at]);
                let vertex = self.split_side(t, side, point);
                chain.insert(at, vertex);
                (vertex, true)
            }
        }
    }

    fn locate(&self, point: &Point) -> Place {
        let sides_of = |t: u32, known: Option<usize>| -> [Sign; 3] {
            let corners = self.triangles[t as usize].corners;
            std::array::from_fn(|i| {
                if known == Some(i) {
                    return Sign::Positive;
                }
                let (a, b) = (corners[(i + 1) % 3], corners[(i + 2) % 3]);
                orient2d(self.point(a), self.point(b), point, self.axis, self.grid)
            })
        };
        let (mut t, mut previous) = (self.last, NONE);
        for step in 0..2 * self.triangles.len() + 8 {
            let tri = &self.triangles[t as usize];
            let known = (0..3).find(|&i| previous != NONE && tri.beyond[i] == previous);
            let signs = sides_of(t, known);
            // starting at another side in each step keeps the walk from going in circles
            let out = (0..3)
                .map(|i| (i + step) % 3)
                .find(|&i| signs[i] == Sign::Negative && tri.beyond[i] != NONE);
            match out {
                Some(i) => (previous, t) = (t, tri.beyond[i]),
                None => return self.place(t, signs),
            }
        }
        let t = (0..self.triangles.len() as u32)
            .find(|&t| !sides_of(t, None).contains(&Sign::Negative))
            .unwrap_or(t);
        self.place(t, sides_of(t, None))
    }

    fn place(&self, t: u32, signs: [Sign; 3]) -> Place {
        let corners = self.triangles[t as usize].corners;
        let zero = signs.map(|s| s == Sign::Zero);
        match zero {
            [false, false, false] => Place::Inside(t),
            [true, true, _] => Place::Vertex(corners[2]),
            [_, true, true] => Place::Vertex(corners[0]),
            [true, _, true] => Place::Vertex(corners[1]),
            [true, ..] => Place::Side(t, 0),
            [_, true, _] => Place::Side(t, 1),
            [_, _, true] => Place::Side(t, 2),
        }
    }

    fn push_point(&mut self, point: PointRef<'a>) -> u32 {
        self.points.push(point);
        self.triangle_at.push(NONE);
        (self.points.len() - 1) as u32
    }

    /// Sets a triangle and updates its neighbors and corners.
    fn set(&mut self, t: u32, corners: [u32; 3], beyond: [u32; 3]) {
        if t as usize == self.triangles.len() {
            self.triangles.push(Tri { corners, beyond });
        } else {
            self.triangles[t as usize] = Tri { corners, beyond };
        }
        for i in 0..3 {
            self.triangle_at[corners[i] as usize] = t;
            if beyond[i] != NONE && (beyond[i] as usize) < self.triangles.len() {
                let (a, b) = (corners[(i + 1) % 3], corners[(i + 2) % 3]);
                let other = &mut self.triangles[beyond[i] as usize];
                if other.corners.contains(&a) && other.corners.contains(&b) {
                    let side = other.side_of(a, b);
                    other.beyond[side] = t;
                }
            }
        }
        self.last = t;
    }

    fn split_triangle(&mut self, t: u32, point: PointRef<'a>) -> u32 {
        let p = self.push_point(point);
        let Tri {
            corners: [a, b, c],
            beyond: [na, nb, nc],
        } = self.triangles[t as usize];
        let (t1, t2) = (self.triangles.len() as u32, self.triangles.len() as u32 + 1);
        self.set(t, [a, b, p], [t1, t2, nc]);
        self.set(t1, [b, c, p], [t2, t, na]);
        self.set(t2, [c, a, p], [t, t1, nb]);
        self.make_round_around(p, &[t, t1, t2]);
        p
    }

    fn split_side(&mut self, t: u32, side: usize, point: PointRef<'a>) -> u32 {
        let p = self.push_point(point);
        let tri = self.triangles[t as usize];
        let [a, b, c] = std::array::from_fn(|k| tri.corners[(side + k) % 3]);
        let [u, nb, nc] = std::array::from_fn(|k| tri.beyond[(side + k) % 3]);
        if let Some(lines) = self.lines_of.remove(&key(b, c)) {
            self.lines_of.insert(key(b, p), lines.clone());
            self.lines_of.insert(key(p, c), lines);
        }
        let t2 = self.triangles.len() as u32;
        if u == NONE {
            self.set(t, [a, b, p], [NONE, t2, nc]);
            self.set(t2, [a, p, c], [NONE, nb, t]);
            self.make_round_around(p, &[t, t2]);
        } else {
            let u2 = t2 + 1;
            let other = self.triangles[u as usize];
            let i = other.side_of(b, c);
            let d = other.corners[i];
            // d, c, b run counter-clockwise
            let (beyond_b, beyond_c) = (other.beyond[(i + 2) % 3], other.beyond[(i + 1) % 3]);
            self.set(t, [a, b, p], [u2, t2, nc]);
            self.set(t2, [a, p, c], [u, nb, t]);
            self.set(u, [d, c, p], [t2, u2, beyond_b]);
            self.set(u2, [d, p, b], [t, beyond_c, u]);
            self.make_round_around(p, &[t, t2, u, u2]);
        }
        p
    }

    fn is_line(&self, a: u32, b: u32) -> bool {
        self.lines_of.contains_key(&key(a, b))
    }

    /// Flips edges opposite of a new vertex until triangles around it are round.
    fn make_round_around(&mut self, p: u32, triangles: &[u32]) {
        let mut stack = std::mem::take(&mut self.stack);
        stack.clear();
        stack.extend(triangles);
        // An insertion flips each edge once at most. Where points are as near as their rounded places are wrong, edges might
        // be flipped back and forth.
        let mut flips = self.triangles.len();
        while let Some(t) = stack.pop().filter(|_| flips > 0) {
            let tri = self.triangles[t as usize];
            let Some(i) = tri.corners.iter().position(|&c| c == p) else {
                continue;
            };
            if let Some(other) = self.flip_if_rounder(t, i) {
                stack.extend([t, other]);
                flips -= 1;
            }
        }
        self.stack = stack;
    }

    /// Flips a side if that makes rounder triangles; gives the other triangle.
    fn flip_if_rounder(&mut self, t: u32, side: usize) -> Option<u32> {
        let tri = self.triangles[t as usize];
        let u = tri.beyond[side];
        if u == NONE {
            return None;
        }
        let [p, b, c] = std::array::from_fn(|k| tri.corners[(side + k) % 3]);
        if self.is_line(b, c) {
            return None;
        }
        let other = self.triangles[u as usize];
        let q = other.corners[other.side_of(b, c)];
        let at = |v: u32| self.point(v).rounded();
        // cosine and sine of the angle under which the edge is seen
        let seen = |v: u32| {
            let (d, e) = (at(b) - at(v), at(c) - at(v));
            let size = (d.length_squared() * e.length_squared()).sqrt();
            (d.dot(e) / size, d.cross(e).length() / size)
        };
        let ((cos_p, sin_p), (cos_q, sin_q)) = (seen(p), seen(q));
        let rounder = sin_p * cos_q + cos_p * sin_q < -FLIP_MARGIN;
        (rounder && self.is_convex(p, b, q, c)).then(|| {
            self.flip(t, side);
            u
        })
    }

    /// Returns `true` if the edge from `b` to `c` may be replaced by the one from `p` to `q`.
    fn is_convex(&self, p: u32, b: u32, q: u32, c: u32) -> bool {
        self.orient(p, b, q) == Sign::Positive && self.orient(q, c, p) == Sign::Positive
    }

    /// Replaces a side by the other diagonal.
    fn flip(&mut self, t: u32, side: usize) {
        let tri = self.triangles[t as usize];
        let [p, b, c] = std::array::from_fn(|k| tri.corners[(side + k) % 3]);
        let [u, beyond_pc, beyond_pb] = std::array::from_fn(|k| tri.beyond[(side + k) % 3]);
        let other = self.triangles[u as usize];
        let i = other.side_of(b, c);
        let q = other.corners[i];
        // q, c, b run counter-clockwise
        let (beyond_qb, beyond_qc) = (other.beyond[(i + 1) % 3], other.beyond[(i + 2) % 3]);
        self.set(t, [p, b, q], [beyond_qb, u, beyond_pb]);
        self.set(u, [q, c, p], [beyond_pc, t, beyond_qc]);
    }

    /// Triangles around a vertex, with the index of the vertex in each.
    fn around(&self, vertex: u32) -> impl Iterator<Item = (u32, usize)> + '_ {
        let first = self.triangle_at[vertex as usize];
        // one way around until it is closed or at the border; from there the other way
        let (mut at, mut turn) = (first, 1);
        std::iter::from_fn(move || {
            if at == NONE && turn == 1 {
                turn = 2;
                let start = &self.triangles[first as usize];
                at = start.beyond[(start.index_of(vertex) + turn) % 3];
            }
            if at == NONE {
                return None;
            }
            let tri = &self.triangles[at as usize];
            let i = tri.index_of(vertex);
            let found = (at, i);
            at = tri.beyond[(i + turn) % 3];
            if at == first {
                (at, turn) = (NONE, 2);
            }
            Some(found)
        })
    }

    /// The triangle and the side with these ends.
    fn find(&self, a: u32, b: u32) -> (u32, usize) {
        let found = self.around(a).find_map(|(t, _)| {
            let tri = &self.triangles[t as usize];
            tri.corners.contains(&b).then(|| (t, tri.side_of(a, b)))
        });
        found.expect("asked only of edges that exist")
    }

    /// Flips edges that nothing prescribes wherever that makes rounder triangles.
    pub fn make_round(&mut self) {
        for _ in 0..PASSES {
            let mut flipped = false;
            for t in 0..self.triangles.len() as u32 {
                for side in 0..3 {
                    flipped |= self.flip_if_rounder(t, side).is_some();
                }
            }
            if !flipped {
                break;
            }
        }
    }
}

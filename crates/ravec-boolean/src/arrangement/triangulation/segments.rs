//! Segments in a triangulation: forcing them in, crossing them, and what they enclose.

use std::collections::VecDeque;

use glam::DVec3;
use ravec_mesh::Sign;

use super::{Line, NONE, PointRef, Triangulation, key};
use crate::arrangement::point::{Definition, Point};

/// Element met on the way from a vertex towards another.
enum Step {
    /// An edge that leads the way.
    Along(u32),
    /// Edges to be crossed before the next vertex on the way.
    Across(Vec<[u32; 2]>, u32),
    /// A segment lies across.
    Blocked([u32; 2]),
}

impl Triangulation<'_> {
    /// Makes the way from vertex `a` to vertex `b`, which lies in `line`, a chain of edges.
    pub fn insert_segment(&mut self, a: u32, b: u32, line: Line) -> u32 {
        let name = self.lines.len() as u32;
        self.lines.push(line);
        self.lay(a, b, name);
        name
    }

    fn lay(&mut self, mut a: u32, b: u32, line: u32) {
        while a != b {
            match self.step(a, b) {
                Step::Along(next) => {
                    self.mark(a, next, line);
                    a = next;
                }
                Step::Across(edges, next) => {
                    self.clear_the_way(a, next, edges);
                    self.mark(a, next, line);
                    a = next;
                }
                Step::Blocked(edge) => {
                    let crossing = self.split_crossing(edge, line);
                    self.lay(a, crossing, line);
                    a = crossing;
                }
            }
        }
    }

    fn mark(&mut self, a: u32, b: u32, line: u32) {
        let lines = self.lines_of.entry(key(a, b)).or_default();
        if !lines.contains(&line) {
            lines.push(line);
        }
    }

    /// Returns `true` if `x`, which is on the line through `a` and `b`, is on the side of `a` where `b` is.
    fn is_ahead(&self, a: u32, b: u32, x: u32) -> bool {
        let axes = [(self.axis + 1) % 3, (self.axis + 2) % 3];
        axes.into_iter().any(|axis| {
            let way = self.point(a).compare(self.point(b), axis, self.grid);
            way.is_ne() && way == self.point(a).compare(self.point(x), axis, self.grid)
        })
    }

    fn step(&self, a: u32, b: u32) -> Step {
        for (t, i) in self.around(a) {
            let corners = self.triangles[t as usize].corners;
            let (right, left) = (corners[(i + 1) % 3], corners[(i + 2) % 3]);
            if right == b || left == b {
                return Step::Along(b);
            }
            let signs = [right, left].map(|x| self.orient(a, b, x));
            for (sign, x) in signs.into_iter().zip([right, left]) {
                if sign == Sign::Zero && self.is_ahead(a, b, x) {
                    return Step::Along(x);
                }
            }
            if signs == [Sign::Negative, Sign::Positive] {
                return self.walk(a, b, t, i);
            }
        }
        unreachable!("the triangles around a vertex look into all directions that the piece has");
    }

    /// From `a` through the side opposite of it towards `b`, to the next vertex on the way.
    fn walk(&self, a: u32, b: u32, mut t: u32, mut side: usize) -> Step {
        let mut edges = Vec::new();
        loop {
            let tri = &self.triangles[t as usize];
            let (right, left) = (tri.corners[(side + 1) % 3], tri.corners[(side + 2) % 3]);
            if self.is_line(right, left) {
                return Step::Blocked([right, left]);
            }
            edges.push([right, left]);
            t = tri.beyond[side];
            let other = &self.triangles[t as usize];
            let apex = other.side_of(right, left);
            let w = other.corners[apex];
            if w == b {
                return Step::Across(edges, w);
            }
            match self.orient(a, b, w) {
                Sign::Zero => return Step::Across(edges, w),
                Sign::Negative => side = other.index_of(right),
                Sign::Positive => side = other.index_of(left),
            }
        }
    }

    /// Flips edges until one leads from `a` to `b`.
    fn clear_the_way(&mut self, a: u32, b: u32, edges: Vec<[u32; 2]>) {
        let mut queue = VecDeque::from(edges);
        while let Some([right, left]) = queue.pop_front() {
            let (t, side) = self.find(right, left);
            let tri = self.triangles[t as usize];
            let [p, c, d] = std::array::from_fn(|k| tri.corners[(side + k) % 3]);
            let other = self.triangles[tri.beyond[side] as usize];
            let q = other.corners[other.side_of(c, d)];
            if !self.is_convex(p, c, q, d) {
                queue.push_back([right, left]);
                continue;
            }
            self.flip(t, side);
            let apart = |x: u32| x != a && x != b;
            if apart(p) && apart(q) && self.orient(a, b, p) == -self.orient(a, b, q) {
                queue.push_back([p, q]);
            }
        }
    }

    /// Makes a vertex where a segment in `line` crosses an edge of other segments.
    fn split_crossing(&mut self, [a, b]: [u32; 2], line: u32) -> u32 {
        let others = &self.lines_of[&key(a, b)];
        let others = others.iter().map(|&l| self.lines[l as usize]);
        // an edge with a plane is the simplest of all
        let other = others
            .min_by_key(|l| matches!(l, Line::Plane(_)))
            .expect("an edge of segments belongs to one");
        let definition = match (self.lines[line as usize], other) {
            (Line::Edge(edge), Line::Plane(plane)) | (Line::Plane(plane), Line::Edge(edge)) => {
                Definition::LinePlane(edge, plane)
            }
            (Line::Edge(edge), Line::Edge([p, q])) => {
                // a plane through the other edge that stands on ours
                let mut r = p;
                r[self.axis] = if p[self.axis] == 0.0 {
                    // a coordinate of the input, so that it is on the grid
                    let size = |q: &DVec3| q.abs().max_element();
                    self.plane.iter().map(size).fold(0.0, f64::max)
                } else {
                    0.0
                };
                Definition::LinePlane(edge, [p, q, r])
            }
            (Line::Plane(one), Line::Plane(two)) => Definition::Planes([self.plane, one, two]),
        };
        let point = Point::defined(definition, self.max_width, self.grid);
        let (t, side) = self.find(a, b);
        self.split_side(t, side, PointRef::Own(Box::new(point)))
    }

    /// The triangles that are enclosed by segments, given by name, to the left of the first edge from `a` to `b`.
    pub fn enclosed(&self, a: u32, b: u32, border: &[u32]) -> Vec<u32> {
        let Step::Along(next) = self.step(a, b) else {
            return Vec::new();
        };
        let first = self
            .around(a)
            .find(|&(t, i)| self.triangles[t as usize].corners[(i + 1) % 3] == next);
        let Some((first, _)) = first else {
            return Vec::new();
        };
        let mut found = vec![first];
        let mut seen: rustc_hash::FxHashSet<u32> = [first].into_iter().collect();
        let mut at = 0;
        while at < found.len() {
            let tri = self.triangles[found[at] as usize];
            at += 1;
            for i in 0..3 {
                let (c, d) = (tri.corners[(i + 1) % 3], tri.corners[(i + 2) % 3]);
                let closed = self
                    .lines_of
                    .get(&key(c, d))
                    .is_some_and(|lines| lines.iter().any(|l| border.contains(l)));
                if !closed && tri.beyond[i] != NONE && seen.insert(tri.beyond[i]) {
                    found.push(tri.beyond[i]);
                }
            }
        }
        found
    }
}

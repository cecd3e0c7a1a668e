//! The solid between two heights above a sheet, as polyhedra that may overlap.
//!
//! Over each triangle stands a prism; at convex hinges a wedge turns from one prism to the next, and around convex vertices a
//! cone joins the wedges. At concave hinges prisms overlap. All of them are closed and face outward, so a point is in the
//! solid just where the winding number of all of them is above 0. What two of them share and face oppositely is left out.
//!
//! Guarantees: no point of the solid is farther than its upper height and the slack from the sheet. Does not guarantee: upright
//! walls where a valley ends at the boundary; there a prism may stand out beyond the wall of its neighbor.
//!
//! Cost: two triangles for each of the sheet where it is smooth, and about 20 for each edge of a crease.

use super::directions::{Directed, Hinge};
use glam::DVec3;
use ravec_mesh::TriMesh;
use ravec_progress::{Cancelled, Progress};
use rustc_hash::FxHashMap;

/// Below this angle in radians directions are taken for the same.
///
/// What is left open then is a ten-millionth of the height wide; angles from dot products are no better than that.
const LEAST_TURN: f64 = 1e-7;

/// Vertices with more edges than this are not searched for what is nearest to them: it takes the cube of their number.
const MOST_EDGES: usize = 64;

/// Polyhedra that may overlap.
pub(super) struct Slab {
    /// Their triangles, each with corners of its own.
    pub polyhedra: TriMesh,
    /// Whether a triangle lies at the lower height.
    pub is_low: Vec<bool>,
    /// The vertices of the sheet at the lower height.
    pub lifted: Vec<DVec3>,
}

/// The polyhedra between two `heights` above a sheet; round parts fall short of the upper one by the slack at most.
pub(super) fn slab(
    directed: &Directed<'_>,
    heights: [f64; 2],
    slack: f64,
    progress: &Progress,
) -> Result<Slab, Cancelled> {
    let mut builder = Builder {
        directed,
        heights,
        // 1 - cos(step / 2) of the height, and a third more in the middle of three directions
        step: (2.0 * (1.5 * slack / heights[1]).sqrt()).min(0.5),
        positions: Vec::new(),
        is_low: Vec::new(),
        turns: FxHashMap::default(),
    };
    for t in 0..directed.normals.len() as u32 {
        progress.check()?;
        builder.caps(t);
    }
    for edge in 0..directed.adjacency.edges().len() as u32 {
        progress.check()?;
        builder.edge(edge);
    }
    let mut turns: Vec<(u32, Vec<Turn>)> = builder.turns.drain().collect();
    turns.sort_unstable_by_key(|&(vertex, _)| vertex);
    for (vertex, turns) in turns {
        progress.check()?;
        builder.vertex(vertex, &turns);
        builder.saddle(vertex);
    }
    progress.check()?;
    let count = builder.positions.len() as u32 / 3;
    let triangles = (0..count).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
    let vertices = 0..directed.sheet.positions().len() as u32;
    let lifted = vertices.map(|v| builder.low(v)).collect();
    Ok(Slab {
        lifted,
        polyhedra: TriMesh::new(builder.positions, triangles)
            .expect("three corners each, all finite"),
        is_low: builder.is_low,
    })
}

/// The directions along the end of a wedge, seen from outside of it from left to right.
type Turn = Vec<DVec3>;

struct Builder<'a> {
    directed: &'a Directed<'a>,
    heights: [f64; 2],
    /// The largest angle between neighboring directions of wedges and cones.
    step: f64,
    positions: Vec<DVec3>,
    is_low: Vec<bool>,
    /// By vertex, the ends of wedges.
    turns: FxHashMap<u32, Vec<Turn>>,
}

impl Builder<'_> {
    fn place(&self, vertex: u32) -> DVec3 {
        self.directed.sheet.positions()[vertex as usize]
    }

    fn triangle(&mut self, [a, b, c]: [DVec3; 3], is_low: bool) {
        if a != b && b != c && c != a {
            self.positions.extend([a, b, c]);
            self.is_low.push(is_low);
        }
    }

    /// A patch at the upper height, counterclockwise seen from the front.
    fn top<const N: usize>(&mut self, at: [u32; N], directions: [DVec3; N]) {
        let corners: [DVec3; N] = std::array::from_fn(|k| self.high(at[k], directions[k]));
        for k in 1..N - 1 {
            self.triangle([corners[0], corners[k], corners[k + 1]], false);
        }
    }

    /// A place above a vertex at the upper height.
    fn high(&self, vertex: u32, direction: DVec3) -> DVec3 {
        self.place(vertex) + self.heights[1] * direction
    }

    /// The place above a vertex at the lower height.
    fn low(&self, vertex: u32) -> DVec3 {
        self.place(vertex) + self.heights[0] * self.directed.of_vertex[vertex as usize]
    }

    /// A wall over an edge, seen from outside with `a` on the left.
    fn wall(&mut self, [a, b]: [u32; 2], [da, db]: [DVec3; 2]) {
        let corners = [self.low(a), self.low(b), self.high(b, db), self.high(a, da)];
        self.triangle([corners[0], corners[1], corners[2]], false);
        self.triangle([corners[0], corners[2], corners[3]], false);
    }

    /// A wall over a vertex, seen from outside from left to right.
    fn sector(&mut self, vertex: u32, turn: &[DVec3]) {
        let low = self.low(vertex);
        for pair in turn.windows(2) {
            self.triangle(
                [low, self.high(vertex, pair[1]), self.high(vertex, pair[0])],
                false,
            );
        }
    }

    fn caps(&mut self, t: u32) {
        let vertices = self.directed.sheet.triangles()[t as usize];
        self.top(vertices, self.directed.of_corner[t as usize]);
        let [a, b, c] = vertices.map(|v| self.low(v));
        self.triangle([a, c, b], true);
    }

    fn edge(&mut self, edge: u32) {
        let directed = self.directed;
        let hinge = directed.hinge(edge);
        let opens = |hinge: Hinge, least: f64| {
            let openings = directed.openings(hinge);
            openings.into_iter().all(|opening| opening >= least)
        };
        if let Some(hinge) = hinge.filter(|&hinge| opens(hinge, 0.0)) {
            self.wedge(hinge, false);
            return;
        }
        let uses = directed.adjacency.uses(edge);
        let [low, high] = directed.adjacency.edges()[edge as usize];
        for edge_use in uses {
            let ends = if edge_use.forward {
                [low, high]
            } else {
                [high, low]
            };
            let directions = ends.map(|v| directed.at(edge_use.triangle, v));
            self.wall(ends, directions);
        }
        if uses.len() < 3 {
            return;
        }
        // where many sheets meet, any two of them may open
        let of = |forward: bool| uses.iter().filter(move |u| u.forward == forward);
        for left in of(true) {
            for right in of(false) {
                let hinge = Hinge {
                    ends: [low, high],
                    left: left.triangle,
                    right: right.triangle,
                };
                if opens(hinge, f64::MIN_POSITIVE) {
                    self.wedge(hinge, true);
                }
            }
        }
    }

    /// What opens between two prisms; `alone` if their sides are there as well.
    fn wedge(&mut self, hinge: Hinge, alone: bool) {
        let ends = hinge.ends;
        let [from, to] =
            [hinge.left, hinge.right].map(|t| hinge.ends.map(|v| self.directed.at(t, v)));
        let angle = (0..2)
            .map(|i| from[i].angle_between(to[i]))
            .fold(0.0, f64::max);
        if angle < LEAST_TURN && !alone {
            return;
        }
        let steps = (angle / self.step).ceil().max(1.0) as u32;
        let [mut start, mut end] = [0, 1].map(|i| turn(from[i], to[i], steps));
        for k in 0..steps as usize {
            self.top(
                [ends[0], ends[0], ends[1], ends[1]],
                [start[k], start[k + 1], end[k + 1], end[k]],
            );
        }
        end.reverse();
        for (i, turn) in [&mut start, &mut end].into_iter().enumerate() {
            if alone {
                self.sector(ends[i], turn);
            } else if turn[0] != turn[turn.len() - 1] {
                let turns = self.turns.entry(hinge.ends[i]).or_default();
                turns.push(std::mem::take(turn));
            }
        }
        if alone {
            self.wall([ends[1], ends[0]], [from[1], from[0]]);
            self.wall(ends, to);
        }
    }

    /// Fills what is nearest to a vertex at which some hinges open and others close.
    fn saddle(&mut self, vertex: u32) {
        let directed = self.directed;
        let around = directed.adjacency.triangles_at(vertex);
        let mut edges: Vec<u32> = around
            .iter()
            .flat_map(|&t| (0..3).filter_map(move |side| directed.adjacency.edge_of(t, side)))
            .filter(|&edge| directed.adjacency.edges()[edge as usize].contains(&vertex))
            .collect();
        edges.sort_unstable();
        edges.dedup();
        let mut closes = false;
        for &edge in &edges {
            let Some(hinge) = directed.hinge(edge) else {
                return;
            };
            closes |= directed
                .openings(hinge)
                .into_iter()
                .any(|opening| opening < 0.0);
        }
        if !closes || edges.len() > MOST_EDGES {
            return;
        }
        let place = self.place(vertex);
        let ways: Vec<DVec3> = edges
            .iter()
            .map(|&edge| {
                let [a, b] = directed.adjacency.edges()[edge as usize];
                (self.place(if a == vertex { b } else { a }) - place).normalize_or_zero()
            })
            .collect();
        let Some(rays) = polar_cone(&ways, directed.of_vertex[vertex as usize]) else {
            return;
        };
        let mean = rays.iter().sum::<DVec3>().normalize_or_zero();
        let widest = rays
            .iter()
            .map(|ray| ray.angle_between(mean))
            .fold(0.0, f64::max);
        let rings = (widest / self.step).ceil().max(1.0) as u32;
        for (i, &from) in rays.iter().enumerate() {
            let to = rays[(i + 1) % rays.len()];
            let steps = (from.angle_between(to) / self.step).ceil().max(1.0) as u32;
            let border = turn(from, to, steps);
            for pair in border.windows(2) {
                let [from, to] = [pair[0], pair[1]].map(|d| turn(mean, d, rings));
                for k in 0..rings as usize {
                    self.top([vertex; 4], [from[k], from[k + 1], to[k + 1], to[k]]);
                }
            }
            self.sector(vertex, &border);
        }
    }

    /// A cone over the ends of wedges at a vertex.
    fn vertex(&mut self, vertex: u32, turns: &[Turn]) {
        let around = self.directed.adjacency.triangles_at(vertex);
        let mean = around
            .iter()
            .map(|&t| self.directed.at(t, vertex))
            .sum::<DVec3>()
            .normalize_or_zero();
        // seen from outside the wedge its end runs clockwise around the cone
        let is_filled = |turn: &Turn| {
            let is_ahead = turn.iter().all(|direction| mean.dot(*direction) > 0.0);
            is_ahead
                && turn
                    .windows(2)
                    .all(|pair| mean.dot(pair[1].cross(pair[0])) > 0.0)
        };
        let (filled, open): (Vec<&Turn>, Vec<&Turn>) =
            turns.iter().partition(|turn| is_filled(turn));
        for turn in open {
            self.sector(vertex, turn);
        }
        let widest = filled
            .iter()
            .flat_map(|turn| turn.iter())
            .map(|direction| direction.angle_between(mean))
            .fold(0.0, f64::max);
        let rings = (widest / self.step).ceil().max(1.0) as u32;
        // how often a ray from the mean has a sector on its left less those on its right
        let mut rays: FxHashMap<[u64; 3], (DVec3, i32)> = FxHashMap::default();
        for run in filled {
            for pair in run.windows(2) {
                let [to, from] = [pair[0], pair[1]].map(|d| turn(mean, d, rings));
                for k in 0..rings as usize {
                    self.top([vertex; 4], [from[k], from[k + 1], to[k + 1], to[k]]);
                }
            }
            let (to, from) = (run[0], run[run.len() - 1]);
            for (direction, count) in [(from, 1), (to, -1)] {
                let key = direction.to_array().map(f64::to_bits);
                rays.entry(key).or_insert((direction, 0)).1 += count;
            }
        }
        let mut rays: Vec<([u64; 3], (DVec3, i32))> = rays.into_iter().collect();
        rays.sort_unstable_by_key(|ray| ray.0);
        for (_, (direction, count)) in rays {
            let mut ray = turn(mean, direction, rings);
            if count < 0 {
                ray.reverse();
            }
            for _ in 0..count.abs() {
                self.sector(vertex, &ray);
            }
        }
    }
}

/// The directions in which a vertex is closer than anything beside it, counterclockwise around their mean: the cone polar to
/// its edges. Nothing if it has no inside on the front.
fn polar_cone(edges: &[DVec3], front: DVec3) -> Option<Vec<DVec3>> {
    let mut rays: Vec<DVec3> = Vec::new();
    for (i, &a) in edges.iter().enumerate() {
        for &b in &edges[i + 1..] {
            let across = a.cross(b).normalize_or_zero();
            for ray in [across, -across] {
                let is_free = edges.iter().all(|edge| edge.dot(ray) <= LEAST_TURN);
                let is_new = rays.iter().all(|other| other.distance(ray) > LEAST_TURN);
                if ray.dot(front) > 0.0 && is_free && is_new {
                    rays.push(ray);
                }
            }
        }
    }
    let mean = rays.iter().sum::<DVec3>().normalize_or_zero();
    let right = mean.any_orthonormal_vector();
    let up = mean.cross(right);
    rays.sort_by(|a, b| {
        let angle = |ray: &DVec3| ray.dot(up).atan2(ray.dot(right));
        angle(a).total_cmp(&angle(b))
    });
    let is_ahead = |pair: [DVec3; 2]| mean.dot(pair[0].cross(pair[1])) > LEAST_TURN;
    let count = rays.len();
    let is_cone = count > 2 && (0..count).all(|i| is_ahead([rays[i], rays[(i + 1) % count]]));
    is_cone.then_some(rays)
}

/// The directions on the way from one to another in equal steps.
fn turn(from: DVec3, to: DVec3, steps: u32) -> Turn {
    let angle = from.angle_between(to);
    let sine = angle.sin();
    let at = |k: u32| match k {
        0 => from,
        k if k == steps => to,
        k => {
            let share = f64::from(k) / f64::from(steps);
            if sine < LEAST_TURN {
                from.lerp(to, share)
            } else {
                (((1.0 - share) * angle).sin() * from + (share * angle).sin() * to) / sine
            }
        }
    };
    (0..=steps).map(at).collect()
}

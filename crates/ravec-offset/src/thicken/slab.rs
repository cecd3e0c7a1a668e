//! The slab: the solid between two heights above a sheet, as polyhedra that may overlap.
//!
//! A prism stands over each triangle; at convex hinges a wedge turns from one prism to the next, and cones fill the openings
//! around vertices. At concave hinges prisms overlap. All polyhedra are closed and face outward, so a point is in the solid if
//! and only if their total winding number is positive. Faces that two of them share with opposite orientations are omitted.
//!
//! Guarantees: no point of the solid is farther from the sheet than its upper height plus the slack. Does not guarantee:
//! upright walls where a valley ends at the boundary; a prism may stick out of the wall of its neighbor there.
//!
//! Cost: two triangles per triangle of the sheet where it is smooth, and about 20 per edge of a crease.

use super::directions::{Directed, Hinge};
use glam::DVec3;
use ravec_mesh::TriMesh;
use ravec_progress::{Cancelled, Progress};
use rustc_hash::FxHashMap;

/// Angle in radians below which directions count as equal. The remaining gap is a ten-millionth of the height wide; angles from
/// dot products are no more precise.
const MIN_TURN: f64 = 1e-7;

/// Polyhedra that may overlap.
pub(super) struct Slab {
    /// Their triangles, each with its own corners.
    pub polyhedra: TriMesh,
    /// For each triangle, whether it lies at the lower height.
    pub is_low: Vec<bool>,
    /// The vertices of the sheet at the lower height.
    pub lifted: Vec<DVec3>,
}

/// Builds the polyhedra between two `heights` above a sheet; round parts fall short of the upper height by at most the slack.
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

/// Directions that turn at one end of a hinge.
struct Turn {
    /// From left to right, seen from outside of the hinge.
    directions: Vec<DVec3>,
    /// The hinge opens, so a wedge ends here.
    has_wedge: bool,
}

struct Builder<'a> {
    directed: &'a Directed<'a>,
    heights: [f64; 2],
    /// Largest angle between adjacent directions of wedges and cones.
    step: f64,
    positions: Vec<DVec3>,
    is_low: Vec<bool>,
    /// Turns at the ends of hinges, by vertex.
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

    /// Adds a face at the upper height, counterclockwise seen from the front.
    fn top<const N: usize>(&mut self, at: [u32; N], directions: [DVec3; N]) {
        let corners: [DVec3; N] = std::array::from_fn(|k| self.high(at[k], directions[k]));
        for k in 1..N - 1 {
            self.triangle([corners[0], corners[k], corners[k + 1]], false);
        }
    }

    /// Position over a vertex at the upper height.
    fn high(&self, vertex: u32, direction: DVec3) -> DVec3 {
        self.place(vertex) + self.heights[1] * direction
    }

    /// Position over a vertex at the lower height.
    fn low(&self, vertex: u32) -> DVec3 {
        self.place(vertex) + self.heights[0] * self.directed.of_vertex[vertex as usize]
    }

    /// Adds a wall over an edge, seen from outside with `a` on the left.
    ///
    /// Directions may differ, so a wall need not be flat. The walls on both sides of a closing hinge must bend the same way;
    /// otherwise they would leave slits as high as the solid.
    fn wall(&mut self, [a, b]: [u32; 2], [da, db]: [DVec3; 2]) {
        let corners = [self.low(a), self.low(b), self.high(b, db), self.high(a, da)];
        let first = usize::from(a > b);
        let [from, next, to, last] = [0, 1, 2, 3].map(|k| corners[(first + k) % 4]);
        self.triangle([from, next, to], false);
        self.triangle([from, to, last], false);
    }

    /// Adds a wall over a vertex, seen from outside from left to right.
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
        if let Some(hinge) = hinge {
            self.turns_of(hinge, false);
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

    /// Fills the opening between two prisms; `alone` if their sides are present as well.
    fn wedge(&mut self, hinge: Hinge, alone: bool) {
        let ends = hinge.ends;
        let [from, to] =
            [hinge.left, hinge.right].map(|t| hinge.ends.map(|v| self.directed.at(t, v)));
        let angle = (0..2)
            .map(|i| from[i].angle_between(to[i]))
            .fold(0.0, f64::max);
        if angle < MIN_TURN && !alone {
            return;
        }
        let steps = (angle / self.step).ceil().max(1.0) as u32;
        let [start, mut end] = [0, 1].map(|i| turn(from[i], to[i], steps));
        for k in 0..steps as usize {
            self.top(
                [ends[0], ends[0], ends[1], ends[1]],
                [start[k], start[k + 1], end[k + 1], end[k]],
            );
        }
        if alone {
            end.reverse();
            self.sector(ends[0], &start);
            self.sector(ends[1], &end);
            self.wall([ends[1], ends[0]], [from[1], from[0]]);
            self.wall(ends, to);
        } else {
            self.turns_of(hinge, true);
        }
    }

    /// Records the turns at both ends of a hinge for the cones around its vertices.
    fn turns_of(&mut self, hinge: Hinge, has_wedge: bool) {
        let [from, to] =
            [hinge.left, hinge.right].map(|t| hinge.ends.map(|v| self.directed.at(t, v)));
        let angles = [0, 1].map(|i| from[i].angle_between(to[i]));
        // both ends of a wedge in the same steps
        let angle = angles[0].max(angles[1]);
        if angle < MIN_TURN {
            return;
        }
        let steps = (angle / self.step).ceil().max(1.0) as u32;
        for i in 0..2 {
            let mut directions = turn(from[i], to[i], steps);
            if i == 1 {
                directions.reverse();
            }
            if directions[0] != directions[directions.len() - 1] {
                let turns = self.turns.entry(hinge.ends[i]).or_default();
                turns.push(Turn {
                    directions,
                    has_wedge,
                });
            }
        }
    }

    /// Fills the opening around a vertex: cones over the turns that run clockwise around the mean direction.
    ///
    /// At a vertex, the prisms of its triangles separate where hinges open and overlap where they close. A point above it lies
    /// in one prism more than in closing hinges, minus the winding number of the turns of all hinges around it. So the opening
    /// lies within the turns, and a cone over each clockwise turn covers it, whether its hinge opens or closes.
    fn vertex(&mut self, vertex: u32, turns: &[Turn]) {
        let directed = self.directed;
        let around = directed.adjacency.triangles_at(vertex);
        let mean = around
            .iter()
            .map(|&t| directed.at(t, vertex))
            .sum::<DVec3>()
            .normalize_or_zero();
        // at the boundary of the sheet, closing hinges leave no opening
        let ends_there = (around.iter())
            .flat_map(|&t| (0..3).filter_map(move |side| directed.adjacency.edge_of(t, side)))
            .filter(|&edge| directed.adjacency.edges()[edge as usize].contains(&vertex))
            .any(|edge| directed.hinge(edge).is_none());
        // seen from outside a wedge its end runs clockwise around the cone
        let is_filled = |pair: &[DVec3]| {
            pair.iter().all(|direction| mean.dot(*direction) > 0.0)
                && mean.dot(pair[1].cross(pair[0])) > MIN_TURN * MIN_TURN
        };
        let mut filled: Vec<(&[DVec3], bool)> = Vec::new();
        for turn in turns.iter().filter(|turn| turn.has_wedge || !ends_there) {
            for pair in turn.directions.windows(2) {
                if is_filled(pair) {
                    filled.push((pair, turn.has_wedge));
                } else if turn.has_wedge {
                    self.sector(vertex, pair);
                }
            }
        }
        let widest = (filled.iter())
            .flat_map(|(pair, _)| pair.iter())
            .map(|direction| direction.angle_between(mean))
            .fold(0.0, f64::max);
        let rings = (widest / self.step).ceil().max(1.0) as u32;
        // per ray from the mean: the number of sectors on its left minus those on its right
        let mut rays: FxHashMap<[u64; 3], (DVec3, i32)> = FxHashMap::default();
        for (pair, has_wedge) in filled {
            let (to, from) = (pair[0], pair[1]);
            let [start, end] = [from, to].map(|d| turn(mean, d, rings));
            for k in 0..rings as usize {
                self.top([vertex; 4], [start[k], start[k + 1], end[k + 1], end[k]]);
            }
            if !has_wedge {
                self.sector(vertex, &[from, to]);
            }
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

/// Returns the directions from one to another in equal steps.
fn turn(from: DVec3, to: DVec3, steps: u32) -> Vec<DVec3> {
    let angle = from.angle_between(to);
    let sine = angle.sin();
    let at = |k: u32| match k {
        0 => from,
        k if k == steps => to,
        k => {
            let share = f64::from(k) / f64::from(steps);
            if sine < MIN_TURN {
                from.lerp(to, share)
            } else {
                (((1.0 - share) * angle).sin() * from + (share * angle).sin() * to) / sine
            }
        }
    };
    (0..=steps).map(at).collect()
}

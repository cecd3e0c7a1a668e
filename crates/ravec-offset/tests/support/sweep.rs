//! Points at a distance from single triangles, edges and vertices, along lines and arcs.
//!
//! The points at distance δ from a mesh are among the points at distance δ from its faces, edges and vertices, each by itself:
//! planes, cylinders and spheres. A *track* runs over one of them, only where its neighbors do not hide it at once.

use glam::DVec3;
use ravec_mesh::{Adjacency, TriMesh, weld};
use std::f64::consts::{PI, TAU};

/// Feature under a track.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Piece {
    Plane,
    Cylinder,
    Sphere,
}

/// A curve at a distance from a part of a mesh.
#[derive(Debug, Clone, Copy)]
pub struct Track {
    pub piece: Piece,
    feet: [DVec3; 2],
    /// Unit vectors, less than half a turn apart.
    away: [DVec3; 2],
}

impl Track {
    /// The place at share `t` of the track, at `distance`.
    pub fn at(&self, t: f64, distance: f64) -> DVec3 {
        let [from, to] = self.away;
        let angle = from.angle_between(to);
        let away = if angle < 1e-7 {
            from.lerp(to, t).normalize()
        } else {
            (((1.0 - t) * angle).sin() * from + (t * angle).sin() * to) / angle.sin()
        };
        self.feet[0].lerp(self.feet[1], t) + distance * away
    }

    pub fn length(&self, distance: f64) -> f64 {
        let [from, to] = self.away;
        self.feet[0].distance(self.feet[1]) + distance * from.angle_between(to)
    }
}

/// A mesh whose tracks can be listed.
pub struct Tracks {
    mesh: TriMesh,
    adjacency: Adjacency,
    /// Sides of triangles that name a vertex twice, of which adjacency takes no notice.
    loose: Vec<[u32; 2]>,
    distance: f64,
    spacing: f64,
}

impl Tracks {
    /// Tracks at `distance`, about `spacing` apart; at least one over each part that can be seen.
    pub fn new(mesh: &TriMesh, distance: f64, spacing: f64) -> Self {
        let mesh = weld(mesh, 0.0).mesh;
        let adjacency = Adjacency::new(&mesh);
        let thin = mesh
            .triangles()
            .iter()
            .filter(|[a, b, c]| a == b || b == c || c == a);
        let mut loose: Vec<[u32; 2]> = thin
            .flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]])
            .filter(|[a, b]| a == b || adjacency.edge_between(*a, *b).is_none())
            .map(|[a, b]| [a.min(b), a.max(b)])
            .collect();
        loose.sort_unstable();
        loose.dedup();
        Self {
            mesh,
            adjacency,
            loose,
            distance,
            spacing,
        }
    }

    /// The number of faces, edges and vertices.
    pub fn parts(&self) -> usize {
        let proper = self.mesh.triangles().len() + self.adjacency.edges().len();
        proper + self.mesh.positions().len() + self.loose.len()
    }

    /// The tracks over one of them.
    pub fn of(&self, part: usize) -> Vec<Track> {
        let (faces, edges) = (self.mesh.triangles().len(), self.adjacency.edges().len());
        let vertices = self.mesh.positions().len();
        if part < faces {
            self.over_face(part as u32)
        } else if part < faces + edges {
            let edge = (part - faces) as u32;
            self.over_edge(self.adjacency.edges()[edge as usize], Some(edge))
        } else if part < faces + edges + vertices {
            self.over_vertex((part - faces - edges) as u32)
        } else {
            self.over_edge(self.loose[part - faces - edges - vertices], None)
        }
    }

    fn steps(&self, length: f64) -> u32 {
        (length / self.spacing).ceil().clamp(1.0, 1e4) as u32
    }

    fn over_face(&self, face: u32) -> Vec<Track> {
        let mut corners = self.mesh.corners(face);
        let length = |corners: &[DVec3; 3]| corners[0].distance(corners[1]);
        for _ in 0..2 {
            let mut turned = corners;
            turned.rotate_left(1);
            if length(&turned) > length(&corners) {
                corners = turned;
            }
        }
        let [a, b, c] = corners;
        let normal = (b - a).cross(c - a);
        let Some(away) = normal.try_normalize() else {
            return Vec::new();
        };
        let rows = self.steps(normal.length() / length(&corners));
        let row = |k: u32, away: DVec3| {
            let share = (f64::from(k) + 0.5) / f64::from(rows);
            Track {
                piece: Piece::Plane,
                feet: [a.lerp(c, share), b.lerp(c, share)],
                away: [away; 2],
            }
        };
        (0..rows)
            .flat_map(|k| [row(k, away), row(k, -away)])
            .collect()
    }

    fn over_edge(&self, ends: [u32; 2], edge: Option<u32>) -> Vec<Track> {
        let [from, to] = ends.map(|v| self.mesh.positions()[v as usize]);
        let Some(along) = (to - from).try_normalize() else {
            return Vec::new();
        };
        // into the triangles at the edge
        let into: Vec<DVec3> = edge
            .map_or(&[][..], |edge| self.adjacency.uses(edge))
            .iter()
            .filter_map(|u| {
                let triangle = self.mesh.triangles()[u.triangle as usize];
                let third = triangle[(u.side as usize + 2) % 3];
                let offset = self.mesh.positions()[third as usize] - from;
                let across = offset - offset.dot(along) * along;
                // what is left of a triangle without area is rounding
                across
                    .try_normalize()
                    .filter(|_| across.length() > 1e-7 * offset.length())
            })
            .collect();
        let mut tracks = Vec::new();
        for [first, last] in arcs(along, &into) {
            let angle = first.angle_between(last);
            let (places, turns) = (
                self.steps(from.distance(to)),
                self.steps(angle * self.distance),
            );
            let share = |k: u32, of: u32| (f64::from(k) + 0.5) / f64::from(of);
            tracks.extend((0..places).map(|k| Track {
                piece: Piece::Cylinder,
                feet: [from.lerp(to, share(k, places)); 2],
                away: [first, last],
            }));
            if angle * self.distance < 0.1 * self.spacing {
                continue;
            }
            let turn = Track {
                piece: Piece::Cylinder,
                feet: [DVec3::ZERO; 2],
                away: [first, last],
            };
            tracks.extend((0..turns).map(|k| Track {
                feet: [from, to],
                away: [turn.at(share(k, turns), 1.0); 2],
                ..turn
            }));
        }
        tracks
    }

    fn over_vertex(&self, vertex: u32) -> Vec<Track> {
        let center = self.mesh.positions()[vertex as usize];
        let triangles = self.adjacency.triangles_at(vertex);
        if triangles.is_empty() && !self.loose.iter().any(|ends| ends.contains(&vertex)) {
            return Vec::new();
        }
        let mut along: Vec<DVec3> = Vec::new();
        let mut candidates: Vec<DVec3> = Vec::new();
        for &t in triangles {
            let corners = self.mesh.corners(t);
            along.extend(corners.iter().filter_map(|&q| (q - center).try_normalize()));
            let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
            candidates.extend(normal.try_normalize().into_iter().flat_map(|n| [n, -n]));
        }
        let wanted = TAU * (self.distance / self.spacing).powi(2);
        candidates.extend(spread(wanted.clamp(24.0, 2000.0) as u32));
        candidates.retain(|away| along.iter().all(|e| away.dot(*e) <= 1e-9));
        let middle: DVec3 = candidates.iter().sum();
        let middle = middle
            .try_normalize()
            .or(candidates.first().copied())
            .unwrap_or(DVec3::Z);
        candidates
            .into_iter()
            .filter(|away| middle.dot(*away) > -0.98)
            .map(|away| Track {
                piece: Piece::Sphere,
                feet: [center; 2],
                away: [middle, away],
            })
            .collect()
    }
}

/// The directions across an edge that lead away from all triangles at it, of which `into` holds the directions into them:
/// as arcs of less than half a turn.
fn arcs(along: DVec3, into: &[DVec3]) -> Vec<[DVec3; 2]> {
    let free = |away: DVec3| into.iter().all(|t| away.dot(*t) <= 1e-9);
    let halves = |first: DVec3, middle: DVec3, last: DVec3| vec![[first, middle], [middle, last]];
    let Some(&one) = into.first() else {
        let (u, v) = along.any_orthonormal_pair();
        return [u, v, -u, -v, u]
            .windows(2)
            .map(|pair| [pair[0], pair[1]])
            .collect();
    };
    let mut rays: Vec<DVec3> = Vec::new();
    for t in into {
        let across = along.cross(*t);
        for ray in [across, -across] {
            if free(ray) && rays.iter().all(|r| r.distance(ray) > 1e-9) {
                rays.push(ray);
            }
        }
    }
    let &[first, last] = rays.as_slice() else {
        return Vec::new();
    };
    let middle = if first.dot(last) < -1.0 + 1e-12 {
        -one
    } else {
        (first + last).normalize()
    };
    if free(middle) {
        halves(first, middle, last)
    } else {
        Vec::new()
    }
}

/// Directions spread evenly over the sphere (Fibonacci).
fn spread(count: u32) -> impl Iterator<Item = DVec3> {
    let turn = PI * (3.0 - 5f64.sqrt());
    (0..count).map(move |i| {
        let z = 1.0 - (2.0 * f64::from(i) + 1.0) / f64::from(count);
        let (sin, cos) = (turn * f64::from(i)).sin_cos();
        let radius = (1.0 - z * z).sqrt();
        DVec3::new(radius * cos, radius * sin, z)
    })
}

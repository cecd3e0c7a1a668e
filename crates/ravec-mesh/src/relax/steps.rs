//! The mesh while facets are mended, and what may be done to it.

use glam::DVec3;
use ravec_progress::{Cancelled, Progress};

use super::{Facet, RelaxJudge};
use crate::loose_octree::LooseOctree;
use crate::tri_intersect::{TriTri, intersection};
use crate::{Aabb, Adjacency, TriMesh};

/// A change of few facets.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Step {
    /// The edge between two triangles becomes the other diagonal.
    Flip { triangles: [u32; 2] },
    /// A vertex moves.
    Move { vertex: u32, to: DVec3 },
}

/// The facets that a step changes, and what they become.
#[derive(Debug)]
pub(super) struct Fan<L> {
    pub triangles: Vec<u32>,
    pub after: Vec<Facet<L>>,
    /// By how much the sum of their faults becomes less.
    pub gain: f64,
}

/// Triangles, the names that their corners will have, and where these will be.
type Change = (Vec<u32>, Vec<([u32; 3], [DVec3; 3])>);

pub(super) struct Steps<'a, J: RelaxJudge> {
    pub judge: &'a J,
    /// How the facets look.
    looks: Vec<J::Look>,
    positions: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
    /// The triangles at each vertex.
    stars: Vec<Vec<u32>>,
    /// Vertices that edges have which are not between two triangles of one orientation.
    held: Vec<bool>,
    tree: LooseOctree,
    stack: Vec<(u32, DVec3, f64)>,
    found: Vec<u32>,
}

impl<'a, J: RelaxJudge> Steps<'a, J> {
    pub fn new(
        mesh: &TriMesh,
        looks: Vec<J::Look>,
        judge: &'a J,
        progress: &Progress,
    ) -> Result<Self, Cancelled> {
        let adjacency = Adjacency::new(mesh);
        progress.check()?;
        let vertices = mesh.positions().len();
        let mut held = vec![false; vertices];
        for v in adjacency.pinched_vertices(mesh) {
            held[v as usize] = true;
        }
        for (edge, ends) in (0_u32..).zip(adjacency.edges()) {
            let is_plain = match adjacency.uses(edge) {
                [one, other] => one.forward != other.forward,
                _ => false,
            };
            if !is_plain {
                for &v in ends {
                    held[v as usize] = true;
                }
            }
        }
        progress.check()?;
        let stars = (0..vertices as u32)
            .map(|v| adjacency.triangles_at(v).to_vec())
            .collect();
        let mut tree = LooseOctree::new(mesh.bounds(), mesh.triangles().len());
        for t in 0..mesh.triangles().len() as u32 {
            tree.insert(t, &Aabb::around(mesh.corners(t)));
        }
        progress.check()?;
        Ok(Self {
            judge,
            looks,
            positions: mesh.positions().to_vec(),
            triangles: mesh.triangles().to_vec(),
            stars,
            held,
            tree,
            stack: Vec::new(),
            found: Vec::new(),
        })
    }

    fn corners(&self, triangle: u32) -> [DVec3; 3] {
        self.triangles[triangle as usize].map(|v| self.positions[v as usize])
    }

    fn facet(&self, triangle: u32) -> Facet<J::Look> {
        Facet {
            names: self.triangles[triangle as usize],
            corners: self.corners(triangle),
            look: self.looks[triangle as usize],
        }
    }

    /// All steps that concern a triangle: flips of its edges and moves of its corners.
    pub fn of_triangle(&self, triangle: u32) -> Vec<Step> {
        let names = self.triangles[triangle as usize];
        let mut steps = Vec::with_capacity(6);
        for i in 0..3 {
            let [a, b] = [names[i], names[(i + 1) % 3]];
            let mut across = (self.stars[a as usize].iter().copied())
                .filter(|&t| t != triangle && self.triangles[t as usize].contains(&b));
            if let (Some(other), None) = (across.next(), across.next()) {
                let triangles = [triangle, other];
                steps.push(Step::Flip { triangles });
            }
        }
        for vertex in names {
            if self.held[vertex as usize] {
                continue;
            }
            let star = &self.stars[vertex as usize];
            let around: Vec<_> = star.iter().map(|&t| self.facet(t)).collect();
            if let Some(to) = self.judge.place(vertex, &around) {
                steps.push(Step::Move { vertex, to });
            }
        }
        steps
    }

    /// What a step makes; `None` if topology or the shape of facets forbids it, or if it does not lessen their `faults` by more
    /// than a share of what they are.
    pub fn fan(&self, step: Step, faults: &[f64], least_gain: f64) -> Option<Fan<J::Look>> {
        let (triangles, after) = match step {
            Step::Flip { triangles } => self.flipped(triangles)?,
            Step::Move { vertex, to } => self.moved(vertex, to)?,
        };
        // no facet may turn over: the directions before are those of the facets around
        let normal = |[a, b, c]: [DVec3; 3]| (b - a).cross(c - a);
        let before = triangles.iter().map(|&t| normal(self.corners(t)));
        let stands = match step {
            Step::Flip { .. } => {
                let sum: DVec3 = before.sum();
                after.iter().all(|&(_, at)| normal(at).dot(sum) > 0.0)
            }
            Step::Move { .. } => before
                .zip(&after)
                .all(|(old, &(_, at))| old.dot(normal(at)) > 0.0),
        };
        if !stands {
            return None;
        }
        let before: f64 = triangles.iter().map(|&t| faults[t as usize]).sum();
        let mut sum = 0.0;
        let mut facets = Vec::with_capacity(after.len());
        for (&t, (names, corners)) in triangles.iter().zip(after) {
            let look = self.judge.look(corners, Some(&self.looks[t as usize]));
            sum += self.judge.fault(&look);
            // what is still to come only adds to it
            if before - sum <= least_gain * before {
                return None;
            }
            facets.push(Facet {
                names,
                corners,
                look,
            });
        }
        Some(Fan {
            after: facets,
            triangles,
            gain: before - sum,
        })
    }

    fn flipped(&self, [one, other]: [u32; 2]) -> Option<Change> {
        let names = self.triangles[one as usize];
        let others = self.triangles[other as usize];
        let apex = names.into_iter().find(|v| !others.contains(v))?;
        let opposite = others.into_iter().find(|v| !names.contains(v))?;
        // the edge as the first triangle goes along it
        let at = names.iter().position(|&v| v == apex)?;
        let [a, b] = [names[(at + 1) % 3], names[(at + 2) % 3]];
        let next = others.iter().position(|&v| v == b)?;
        if others[(next + 1) % 3] != a {
            return None;
        }
        // the other diagonal must not be an edge already
        let joins = (self.stars[apex as usize].iter())
            .any(|&t| self.triangles[t as usize].contains(&opposite));
        if joins {
            return None;
        }
        let facet = |names: [u32; 3]| (names, names.map(|v| self.positions[v as usize]));
        let after = vec![facet([apex, a, opposite]), facet([apex, opposite, b])];
        Some((vec![one, other], after))
    }

    fn moved(&self, vertex: u32, to: DVec3) -> Option<Change> {
        if !to.is_finite() || to == self.positions[vertex as usize] {
            return None;
        }
        let star = &self.stars[vertex as usize];
        let after = star.iter().map(|&t| {
            let names = self.triangles[t as usize];
            let at = |v: u32| {
                if v == vertex {
                    to
                } else {
                    self.positions[v as usize]
                }
            };
            (names, names.map(at))
        });
        Some((star.clone(), after.collect()))
    }

    /// Whether the facets that a step makes meet one another, and all others, only in what they share.
    pub fn stay_apart(&mut self, fan: &Fan<J::Look>) -> bool {
        let bad = |kind: TriTri| kind.is_improper() || kind == TriTri::Same;
        for (i, t) in fan.after.iter().enumerate() {
            let mut others = fan.after[..i].iter();
            if others.any(|s| bad(intersection(&s.corners, &t.corners))) {
                return false;
            }
        }
        let corners = fan.after.iter().map(|facet| facet.corners);
        let boxes: Vec<Aabb> = corners.map(Aabb::around).collect();
        let whole = boxes.iter().fold(Aabb::EMPTY, |sum, b| sum.union(*b));
        self.found.clear();
        self.tree.search(&whole, &mut self.stack, &mut self.found);
        self.found.iter().all(|&other| {
            if fan.triangles.contains(&other) {
                return true;
            }
            let corners = self.corners(other);
            let bounds = Aabb::around(corners);
            fan.after.iter().zip(&boxes).all(|(own, b)| {
                let apart = !b.touches(&bounds) || !bad(intersection(&own.corners, &corners));
                // a vertex at the place of another would meet it as if they were one
                let names = self.triangles[other as usize];
                let mut places = own.names.iter().zip(&own.corners);
                apart && places.all(|(v, place)| names.contains(v) || !corners.contains(place))
            })
        })
    }

    /// Does what was found possible.
    pub fn take(&mut self, step: Step, fan: &Fan<J::Look>) {
        for (&t, facet) in fan.triangles.iter().zip(&fan.after) {
            self.looks[t as usize] = facet.look;
            if let Step::Flip { .. } = step {
                let before = self.triangles[t as usize];
                let names = facet.names;
                for v in before.into_iter().filter(|v| !names.contains(v)) {
                    self.stars[v as usize].retain(|&s| s != t);
                }
                for v in names.into_iter().filter(|v| !before.contains(v)) {
                    self.stars[v as usize].push(t);
                }
                self.triangles[t as usize] = names;
            }
            self.tree.update(t, &Aabb::around(facet.corners));
        }
        if let Step::Move { vertex, to } = step {
            self.positions[vertex as usize] = to;
        }
    }

    pub fn into_mesh(self) -> TriMesh {
        let mesh = TriMesh::new(self.positions, self.triangles);
        mesh.expect("places are finite and corners have numbers")
    }
}

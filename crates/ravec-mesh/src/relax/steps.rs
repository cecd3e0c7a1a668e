//! The mesh while facets are repaired, and the steps that may change it.

use glam::DVec3;
use ravec_progress::{Cancelled, Progress};

use super::{Facet, NEW_VERTEX, RelaxJudge};
use crate::loose_octree::LooseOctree;
use crate::tri_intersect::{TriTri, intersection};
use crate::{Aabb, Adjacency, TriMesh};

/// Shares of the way to its better place that a vertex tries to go: the full way may be too far for some of the facets
/// around it.
const SHARES: [f64; 2] = [1.0, 0.5];

/// A change of few facets.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Step {
    /// The edge between two triangles becomes the other diagonal.
    Flip { triangles: [u32; 2] },
    /// A vertex moves.
    Move { vertex: u32, to: DVec3 },
    /// A new vertex divides the edge between two triangles, and both of them in two.
    Split { triangles: [u32; 2], at: DVec3 },
}

/// The facets that a step changes, and what they become.
#[derive(Debug)]
pub(super) struct Fan<L> {
    pub triangles: Vec<u32>,
    /// Those that take the places of `triangles`, in the same order, and behind them new ones.
    pub after: Vec<Facet<L>>,
    /// Decrease of the sum of their faults.
    pub gain: f64,
}

impl<L> Fan<L> {
    /// A box around what the facets become.
    pub fn bounds(&self) -> Aabb {
        Aabb::around(self.after.iter().flat_map(|facet| facet.corners))
    }
}

/// Memory for searches.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    stack: Vec<(u32, DVec3, f64)>,
    found: Vec<u32>,
}

/// Triangles, and of what comes to be of each, and of new ones: the names that its corners will have, where these will be, and
/// which of the triangles it is a part of.
type Change = (Vec<u32>, Vec<([u32; 3], [DVec3; 3], usize)>);

pub(super) struct Steps<'a, J: RelaxJudge> {
    pub judge: &'a J,
    /// Description of each facet.
    descriptors: Vec<J::Descriptor>,
    positions: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
    /// The triangles at each vertex.
    stars: Vec<Vec<u32>>,
    /// Vertices that edges have which are not between two triangles of one orientation.
    held: Vec<bool>,
    tree: LooseOctree,
}

impl<'a, J: RelaxJudge> Steps<'a, J> {
    pub fn new(
        mesh: &TriMesh,
        descriptors: Vec<J::Descriptor>,
        judge: &'a J,
        progress: &Progress,
    ) -> Result<Self, Cancelled> {
        let adjacency = Adjacency::try_new(mesh, progress)?;
        progress.check()?;
        let vertices = mesh.positions().len();
        let mut held = vec![false; vertices];
        for v in adjacency.try_pinched_vertices(mesh, progress)? {
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
            descriptors,
            positions: mesh.positions().to_vec(),
            triangles: mesh.triangles().to_vec(),
            stars,
            held,
            tree,
        })
    }

    fn corners(&self, triangle: u32) -> [DVec3; 3] {
        self.triangles[triangle as usize].map(|v| self.positions[v as usize])
    }

    fn facet(&self, triangle: u32) -> Facet<J::Descriptor> {
        Facet {
            names: self.triangles[triangle as usize],
            corners: self.corners(triangle),
            descriptor: self.descriptors[triangle as usize],
        }
    }

    /// A box around all triangles that have a corner of this one: steps that concern it change no other, and are chosen by no
    /// other.
    pub fn surroundings(&self, triangle: u32) -> Aabb {
        let names = self.triangles[triangle as usize].into_iter();
        let around = names.flat_map(|v| &self.stars[v as usize]);
        Aabb::around(around.flat_map(|&t| self.corners(t)))
    }

    /// The triangles beside the edges of a triangle that have one other triangle.
    fn across(&self, triangle: u32) -> impl Iterator<Item = u32> {
        let names = self.triangles[triangle as usize];
        (0..3).filter_map(move |i| {
            let [a, b] = [names[i], names[(i + 1) % 3]];
            let mut across = (self.stars[a as usize].iter().copied())
                .filter(|&t| t != triangle && self.triangles[t as usize].contains(&b));
            across.next().filter(|_| across.next().is_none())
        })
    }

    /// The steps by which a triangle is divided.
    pub fn splits_of(&self, triangle: u32) -> Vec<Step> {
        let splits = self.across(triangle).filter_map(|other| {
            let [_, a, b, _] = self.diamond([triangle, other])?;
            let triangles = [triangle, other];
            let facets = triangles.map(|t| self.facet(t));
            let place = self.judge.between([a, b], &facets)?;
            let at = self.judge.rounded(place);
            Some(Step::Split { triangles, at })
        });
        splits.collect()
    }

    /// Flips of the edges of a triangle and moves of its corners.
    pub fn of_triangle(&self, triangle: u32) -> Vec<Step> {
        let mut steps = Vec::with_capacity(3 + 3 * SHARES.len());
        let flips = self.across(triangle).map(|other| Step::Flip {
            triangles: [triangle, other],
        });
        steps.extend(flips);
        for vertex in self.triangles[triangle as usize] {
            if self.held[vertex as usize] {
                continue;
            }
            let star = &self.stars[vertex as usize];
            let around: Vec<_> = star.iter().map(|&t| self.facet(t)).collect();
            if let Some(place) = self.judge.place(vertex, &around) {
                let from = self.positions[vertex as usize];
                steps.extend(SHARES.map(|share| Step::Move {
                    vertex,
                    to: self.judge.rounded(from + share * (place - from)),
                }));
            }
        }
        steps
    }

    /// The result of a step; `None` if topology or the shape of facets forbids it, or if it does not lessen their
    /// `faults` by more than a share of them.
    pub fn fan(&self, step: Step, faults: &[f64], min_gain: f64) -> Option<Fan<J::Descriptor>> {
        let (triangles, after) = match step {
            Step::Flip { triangles } => self.flipped(triangles)?,
            Step::Move { vertex, to } => self.moved(vertex, to)?,
            Step::Split { triangles, at } => self.divided(triangles, at)?,
        };
        // no facet may turn over: the directions before are those of the facets around
        let normal = |[a, b, c]: [DVec3; 3]| (b - a).cross(c - a);
        let before: Vec<DVec3> = (triangles.iter())
            .map(|&t| normal(self.corners(t)))
            .collect();
        let stands = match step {
            Step::Flip { .. } => {
                let sum: DVec3 = before.iter().sum();
                after.iter().all(|&(_, at, _)| normal(at).dot(sum) > 0.0)
            }
            Step::Move { .. } | Step::Split { .. } => after
                .iter()
                .all(|&(_, at, part_of)| before[part_of].dot(normal(at)) > 0.0),
        };
        if !stands {
            return None;
        }
        let before: f64 = triangles.iter().map(|&t| faults[t as usize]).sum();
        let mut sum = 0.0;
        let mut facets = Vec::with_capacity(after.len());
        for (names, corners, part_of) in after {
            let like = &self.descriptors[triangles[part_of] as usize];
            let descriptor = self.judge.describe(corners, Some(like));
            sum += self.judge.fault(&descriptor);
            // what is still to come only adds to it
            if before - sum <= min_gain * before {
                return None;
            }
            facets.push(Facet {
                names,
                corners,
                descriptor,
            });
        }
        Some(Fan {
            after: facets,
            triangles,
            gain: before - sum,
        })
    }

    /// The corners of two triangles with a common edge: that of the first which is not on the edge, the edge as the first goes
    /// along it, and that of the second; `None` if they do not go along it in opposite directions.
    fn diamond(&self, [one, other]: [u32; 2]) -> Option<[u32; 4]> {
        let names = self.triangles[one as usize];
        let others = self.triangles[other as usize];
        let apex = names.into_iter().find(|v| !others.contains(v))?;
        let opposite = others.into_iter().find(|v| !names.contains(v))?;
        let at = names.iter().position(|&v| v == apex)?;
        let [a, b] = [names[(at + 1) % 3], names[(at + 2) % 3]];
        let next = others.iter().position(|&v| v == b)?;
        (others[(next + 1) % 3] == a).then_some([apex, a, b, opposite])
    }

    fn flipped(&self, triangles: [u32; 2]) -> Option<Change> {
        let [apex, a, b, opposite] = self.diamond(triangles)?;
        // the other diagonal must not be an edge already
        let joins = (self.stars[apex as usize].iter())
            .any(|&t| self.triangles[t as usize].contains(&opposite));
        if joins {
            return None;
        }
        let facet = |names: [u32; 3], part_of| {
            let corners = names.map(|v| self.positions[v as usize]);
            (names, corners, part_of)
        };
        let after = vec![facet([apex, a, opposite], 0), facet([apex, opposite, b], 1)];
        Some((triangles.to_vec(), after))
    }

    fn divided(&self, triangles: [u32; 2], place: DVec3) -> Option<Change> {
        if !place.is_finite() {
            return None;
        }
        let [apex, a, b, opposite] = self.diamond(triangles)?;
        let new = NEW_VERTEX;
        let facet = |names: [u32; 3], part_of| {
            let at = |v: u32| {
                if v == new {
                    place
                } else {
                    self.positions[v as usize]
                }
            };
            (names, names.map(at), part_of)
        };
        let after = vec![
            facet([apex, a, new], 0),
            facet([opposite, b, new], 1),
            facet([apex, new, b], 0),
            facet([opposite, new, a], 1),
        ];
        Some((triangles.to_vec(), after))
    }

    fn moved(&self, vertex: u32, to: DVec3) -> Option<Change> {
        if !to.is_finite() || to == self.positions[vertex as usize] {
            return None;
        }
        let star = &self.stars[vertex as usize];
        let after = (0..).zip(star).map(|(part_of, &t)| {
            let names = self.triangles[t as usize];
            let at = |v: u32| {
                if v == vertex {
                    to
                } else {
                    self.positions[v as usize]
                }
            };
            (names, names.map(at), part_of)
        });
        Some((star.clone(), after.collect()))
    }

    /// Returns `true` if the facets that a step makes meet one another, and all others, only in what they share.
    pub fn stay_apart(&self, fan: &Fan<J::Descriptor>, scratch: &mut Scratch) -> bool {
        let bad = |kind: TriTri| kind.is_improper() || kind == TriTri::Same;
        for (i, t) in fan.after.iter().enumerate() {
            let mut others = fan.after[..i].iter();
            if others.any(|s| bad(intersection(&s.corners, &t.corners))) {
                return false;
            }
        }
        let corners = fan.after.iter().map(|facet| facet.corners);
        let boxes: Vec<Aabb> = corners.map(Aabb::around).collect();
        let Scratch { stack, found } = scratch;
        found.clear();
        self.tree.search(&fan.bounds(), stack, found);
        found.iter().all(|&other| {
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

    /// Does what was found possible, and says which triangles the facets are now.
    pub fn take(&mut self, step: Step, fan: &Fan<J::Descriptor>) -> Vec<u32> {
        let mut new_vertex = NEW_VERTEX;
        match step {
            Step::Flip { .. } => {}
            Step::Move { vertex, to } => self.positions[vertex as usize] = to,
            Step::Split { at, .. } => {
                new_vertex = self.positions.len() as u32;
                self.positions.push(at);
                self.stars.push(vec![]);
                self.held.push(false);
            }
        }
        let mut triangles = fan.triangles.clone();
        for facet in &fan.after[triangles.len()..] {
            triangles.push(self.triangles.len() as u32);
            // without corners so far
            self.triangles.push([NEW_VERTEX; 3]);
            self.descriptors.push(facet.descriptor);
            self.tree.add(&Aabb::around(facet.corners));
        }
        for (&t, facet) in triangles.iter().zip(&fan.after) {
            let before = self.triangles[t as usize];
            let is_new = |&v: &u32| v == NEW_VERTEX;
            let names = facet.names.map(|v| if is_new(&v) { new_vertex } else { v });
            let left = before
                .into_iter()
                .filter(|v| !is_new(v) && !names.contains(v));
            for v in left {
                self.stars[v as usize].retain(|&s| s != t);
            }
            for v in names.into_iter().filter(|v| !before.contains(v)) {
                self.stars[v as usize].push(t);
            }
            self.triangles[t as usize] = names;
            self.descriptors[t as usize] = facet.descriptor;
            self.tree.update(t, &Aabb::around(facet.corners));
        }
        triangles
    }

    pub fn into_mesh(self) -> TriMesh {
        let mesh = TriMesh::new(self.positions, self.triangles);
        mesh.expect("places are finite and corners have numbers")
    }
}

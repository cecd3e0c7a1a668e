//! Examination: the conditions that allow a collapse.

use glam::DVec3;

use super::judge::CollapseCandidate;
use super::surface::{Class, Surface};
use super::{SimplifyParams, Vetoes};
use crate::loose_octree::LooseOctree;
use crate::{Aabb, TriTri, intersection};

/// Two vertices that are to become one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Plan {
    pub kept: u32,
    pub removed: u32,
    pub position: DVec3,
}

/// Why a collapse does not happen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Veto {
    Topology,
    Features,
    Turns,
    Quality,
    Error,
    Intersections,
    Caller,
}

impl Vetoes {
    pub(super) fn count(&mut self, veto: Veto) {
        let counter = match veto {
            Veto::Topology => &mut self.topology,
            Veto::Features => &mut self.features,
            Veto::Turns => &mut self.turns,
            Veto::Quality => &mut self.quality,
            Veto::Error => &mut self.error,
            Veto::Intersections => &mut self.intersections,
            Veto::Caller => &mut self.caller,
        };
        *counter += 1;
    }
}

/// Below this quality, see [`SimplifyParams::min_quality`], the direction of a normal is rounding and may turn at will.
const NO_NORMAL: f64 = 1e-8;

/// The limits, in the form in which they are compared.
#[derive(Debug, Clone, Copy)]
pub(super) struct Limits {
    pub max_error: f64,
    turn_cos_sq: f64,
    min_quality: f64,
}

impl Limits {
    pub fn new(params: &SimplifyParams) -> Self {
        Self {
            max_error: params.max_error,
            turn_cos_sq: params.max_turn_rad.cos().powi(2),
            min_quality: params.min_quality,
        }
    }
}

/// The change of a collapse. The lists are kept for the next one.
#[derive(Default)]
pub(super) struct Change {
    /// The triangles that change, where their corners are and will be.
    pub changed: Vec<u32>,
    before: Vec<[DVec3; 3]>,
    pub after: Vec<[DVec3; 3]>,
    /// The names of the corners of what changes, as they are and will be.
    corners_before: Vec<[u32; 3]>,
    corners: Vec<[u32; 3]>,
    /// The triangles that vanish.
    pub vanishing: Vec<u32>,
    vanishing_corners: Vec<[u32; 3]>,
    vanishing_at: Vec<[DVec3; 3]>,
}

impl Change {
    /// The triangles that change, and those that vanish.
    pub fn old(&self) -> [&[u32]; 2] {
        [&self.changed, &self.vanishing]
    }

    /// The box around what will be there.
    pub fn bounds(&self) -> Aabb {
        Aabb::around(self.after.iter().flatten().copied())
    }

    /// The box around what was there and what will be.
    pub fn bounds_of_all(&self) -> Aabb {
        let before = self.before.iter().chain(&self.vanishing_at).flatten();
        self.bounds().union(Aabb::around(before.copied()))
    }

    /// Examines the shape of the triangles that were [gathered](Examiner::gather).
    pub fn examine_shape(
        &mut self,
        surface: &Surface,
        plan: &Plan,
        limits: &Limits,
    ) -> Result<(), Veto> {
        self.before.clear();
        self.after.clear();
        self.corners_before.clear();
        self.corners.clear();
        let mut worst_sq = f64::INFINITY;
        let mut new_worst_sq = f64::INFINITY;
        for &t in &self.changed {
            let names = surface.triangles[t as usize];
            let before = surface.corners(t);
            let after: [DVec3; 3] = std::array::from_fn(|i| {
                if names[i] == plan.kept || names[i] == plan.removed {
                    plan.position
                } else {
                    before[i]
                }
            });
            let (old, new) = (normal(&before), normal(&after));
            let (old_sq, new_sq) = (quality_sq(&before, old), quality_sq(&after, new));
            worst_sq = worst_sq.min(old_sq);
            new_worst_sq = new_worst_sq.min(new_sq);
            if old_sq > NO_NORMAL * NO_NORMAL {
                let along = old.dot(new);
                let min_sq = limits.turn_cos_sq * old.length_squared() * new.length_squared();
                if along <= 0.0 || along * along < min_sq {
                    return Err(Veto::Turns);
                }
            }
            self.before.push(before);
            self.after.push(after);
            let renamed = |v| if v == plan.removed { plan.kept } else { v };
            self.corners_before.push(names);
            self.corners.push(names.map(renamed));
        }
        self.vanishing_corners.clear();
        self.vanishing_at.clear();
        for &t in &self.vanishing {
            let at = surface.corners(t);
            self.vanishing_corners.push(surface.triangles[t as usize]);
            self.vanishing_at.push(at);
            worst_sq = worst_sq.min(quality_sq(&at, normal(&at)));
        }
        let min_sq = limits.min_quality * limits.min_quality;
        if new_worst_sq <= 0.0 || new_worst_sq < min_sq.min(worst_sq) {
            return Err(Veto::Quality);
        }
        Ok(())
    }

    /// The collapse as the caller sees it.
    pub fn candidate<'a>(&'a self, surface: &Surface, plan: &Plan) -> CollapseCandidate<'a> {
        let vertices = [plan.kept, plan.removed];
        CollapseCandidate {
            vertices,
            from: vertices.map(|v| surface.positions[v as usize]),
            position: plan.position,
            triangles: &self.changed,
            before: &self.before,
            corners_before: &self.corners_before,
            after: &self.after,
            corners: &self.corners,
            vanishing: &self.vanishing,
            vanishing_corners: &self.vanishing_corners,
            vanishing_at: &self.vanishing_at,
        }
    }
}

/// Vertices that were seen.
#[derive(Default)]
pub(super) struct Marks {
    /// Each carries the number of the examination, or the one after it if it was seen twice.
    of: Vec<u32>,
    last: u32,
}

impl Marks {
    pub fn new(vertices: usize) -> Self {
        Self {
            of: vec![0; vertices],
            last: 0,
        }
    }

    /// A number that no vertex carries, nor the one after it.
    pub fn next(&mut self) -> u32 {
        if self.last >= u32::MAX - 3 {
            self.of.fill(0);
            self.last = 0;
        }
        self.last += 2;
        self.last
    }

    /// Returns `true` if `v` did not carry `mark` yet, which it does from now on.
    #[inline]
    pub fn is_new(&mut self, v: u32, mark: u32) -> bool {
        std::mem::replace(&mut self.of[v as usize], mark) != mark
    }
}

/// Examines collapses, one after the other.
pub(super) struct Examiner {
    marks: Marks,
    common: Vec<u32>,
    boxes: Vec<Aabb>,
    found: Vec<u32>,
    stack: Vec<(u32, DVec3, f64)>,
}

impl Examiner {
    pub fn new(vertices: usize) -> Self {
        Self {
            marks: Marks::new(vertices),
            common: Vec::new(),
            boxes: Vec::new(),
            found: Vec::new(),
            stack: Vec::new(),
        }
    }

    /// Gathers the triangles around the edge, and examines whether the topology stays.
    ///
    /// The link condition: a vertex with edges to both ends must be the third corner of a triangle at the edge, and no
    /// triangle may become the same as another.
    pub fn gather(
        &mut self,
        surface: &Surface,
        plan: &Plan,
        change: &mut Change,
    ) -> Result<(), Veto> {
        let Plan { kept, removed, .. } = *plan;
        change.changed.clear();
        change.vanishing.clear();
        self.common.clear();
        let mark = self.marks.next();
        for (t, corners) in surface.star(removed) {
            if corners.contains(&kept) {
                change.vanishing.push(t);
            } else {
                change.changed.push(t);
            }
            for w in corners {
                self.marks.of[w as usize] = mark;
            }
        }
        let of_removed = change.changed.len();
        for (t, corners) in surface.star(kept) {
            if !corners.contains(&removed) {
                change.changed.push(t);
            }
            for w in corners {
                if self.marks.of[w as usize] == mark && w != kept && w != removed {
                    self.marks.of[w as usize] = mark + 1;
                    self.common.push(w);
                }
            }
        }
        if change.changed.is_empty() || self.common.len() != change.vanishing.len() {
            return Err(Veto::Topology);
        }
        // two boundaries or features would become one
        let special = |&w: &u32| surface.is_special(kept, w) && surface.is_special(removed, w);
        if self.common.iter().any(special) {
            return Err(Veto::Topology);
        }
        // a triangle of one end over two common neighbors, and the same of the other end
        let over_common = |t: u32, apex: u32| {
            let corners = surface.triangles[t as usize];
            let mut others = corners.iter().filter(|&&w| w != apex);
            let both = others.all(|&w| self.marks.of[w as usize] == mark + 1);
            both.then_some(corners)
        };
        for &t in &change.changed[..of_removed] {
            let Some(corners) = over_common(t, removed) else {
                continue;
            };
            let twin = change.changed[of_removed..].iter().any(|&s| {
                over_common(s, kept)
                    .is_some_and(|other| other.iter().all(|&w| w == kept || corners.contains(&w)))
            });
            if twin {
                return Err(Veto::Topology);
            }
        }
        Ok(())
    }

    /// Examines whether an edge between two `sealed` vertices would come to be, after [`Self::gather`].
    pub fn examine_seal(
        &self,
        surface: &Surface,
        plan: &Plan,
        sealed: &[bool],
    ) -> Result<(), Veto> {
        if !sealed[plan.kept as usize] {
            return Ok(());
        }
        let shared = self.marks.last + 1;
        let joins = surface
            .star(plan.removed)
            .flat_map(|(_, corners)| corners)
            .filter(|&w| w != plan.kept && w != plan.removed)
            .any(|w| sealed[w as usize] && self.marks.of[w as usize] != shared);
        if joins { Err(Veto::Topology) } else { Ok(()) }
    }

    /// Examines whether the new triangles would meet one another, or others, where they should not.
    pub fn examine_intersections(
        &mut self,
        surface: &Surface,
        plan: &Plan,
        change: &Change,
        tree: &LooseOctree,
    ) -> Result<(), Veto> {
        let bad = |kind: TriTri| kind.is_improper() || kind == TriTri::Same;
        self.boxes.clear();
        self.boxes
            .extend(change.after.iter().map(|t| Aabb::around(*t)));
        for (i, t) in change.after.iter().enumerate() {
            if change.after[..i].iter().any(|s| bad(intersection(s, t))) {
                return Err(Veto::Intersections);
            }
        }
        let whole = self.boxes.iter().fold(Aabb::EMPTY, |sum, b| sum.union(*b));
        self.found.clear();
        tree.search(&whole, &mut self.stack, &mut self.found);
        for &other in &self.found {
            let corners = surface.corners(other);
            let bounds = Aabb::around(corners);
            if !bounds.touches(&whole) {
                continue;
            }
            let names = surface.triangles[other as usize];
            if names.contains(&plan.kept) || names.contains(&plan.removed) {
                continue;
            }
            // a vertex at the place of another would meet it as if they were one
            let meets = corners.contains(&plan.position)
                || (change.after.iter().zip(&self.boxes))
                    .any(|(t, b)| b.touches(&bounds) && bad(intersection(t, &corners)));
            if meets {
                return Err(Veto::Intersections);
            }
        }
        Ok(())
    }
}

/// Of the vertices of an edge, which one is kept, and whether the other may go there, or both may move.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Freedom {
    /// The first one stays in its place.
    To([u32; 2]),
    /// Both may move.
    Between([u32; 2]),
}

/// Freedom that the classes of the ends allow: a vertex on a curve never leaves it, and vertices on two curves meet
/// only along an edge of theirs.
#[inline]
pub(super) fn freedom(surface: &Surface, a: u32, b: u32) -> Option<Freedom> {
    let (class_a, class_b) = (surface.class(a), surface.class(b));
    let ordered = if class_a >= class_b { [a, b] } else { [b, a] };
    match (class_a.max(class_b), class_a.min(class_b)) {
        (Class::Free, _) => Some(Freedom::Between(ordered)),
        (_, Class::Free) => Some(Freedom::To(ordered)),
        (Class::Fixed, Class::Fixed) => None,
        (most, _) if surface.is_special(a, b) => Some(if most == Class::Fixed {
            Freedom::To(ordered)
        } else {
            Freedom::Between(ordered)
        }),
        _ => None,
    }
}

#[inline]
fn normal([a, b, c]: &[DVec3; 3]) -> DVec3 {
    (b - a).cross(c - a)
}

/// The squared quality of a triangle with this normal: see [`SimplifyParams::min_quality`].
#[inline]
fn quality_sq([a, b, c]: &[DVec3; 3], normal: DVec3) -> f64 {
    let sides = a.distance_squared(*b) + b.distance_squared(*c) + c.distance_squared(*a);
    if sides > 0.0 {
        12.0 * normal.length_squared() / (sides * sides)
    } else {
        0.0
    }
}

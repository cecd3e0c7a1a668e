//! Connected parts of a mesh: which enclose a volume, which are inside out, and which are open sheets.
//!
//! Parts are what triangles, those of the closing among them, join by their vertices. A part is inside out if its volume is
//! negative and winding numbers near its surface say that no other part is around it; a cavity is not. If that holds for all
//! parts with their cavities, the mesh as a whole is inside out.

use glam::DVec3;
use ravec_mesh::{
    Aabb, BoxTree, Bvh, OrientedPlane, TriMesh, WindingNumbers, for_each_self_intersection,
};
use ravec_numeric::DisjointSets;
use ravec_progress::{Cancelled, Progress};
use rustc_hash::{FxHashMap, FxHashSet};
use std::sync::{Mutex, PoisonError};

use super::STRIDE;
use crate::closing::Closing;
use crate::params::Inside;

/// A part with less volume than this share of a cube with its area is flat: nobody can say what is inside.
const SOLID_REL: f64 = 1e-6;

/// A part with a boundary and less volume than this share of a cube with its area may be a sheet. A cap of a sphere has as
/// much if it rises by 35 degrees at its rim, half a ball 0.14.
const SHEET_REL: f64 = 0.08;

/// Rounding of the volume of a triangle about the center of the mesh, as a share of the cube of half the diagonal.
const ROUNDING_REL: f64 = 2e-15;

/// Number of triangles of a part that decide what is around it: a few may lie on a border.
const SAMPLES: u64 = 16;

/// Largest winding number near a part that is clear of all others and inside out: 0, and what the sum over triangles is off by.
const MAX_OUTSIDE: f64 = 0.25;

/// Findings about the parts of a mesh.
#[derive(Default)]
pub(super) struct Parts {
    /// Triangles of the mesh without area.
    pub degenerate: u64,
    /// Volume enclosed, after parts were turned.
    pub volume: f64,
    /// Parts that are turned, the largest first.
    pub turned: Vec<Reversed>,
    /// `true` if the mesh as a whole is turned.
    pub is_all_turned: bool,
    /// For each triangle of the mesh, and then of the closing, whether it is turned; empty if none is.
    pub turn: Vec<bool>,
    /// Other parts that are inside out, the largest first.
    pub left: Vec<Reversed>,
    /// `true` if every part is an open sheet.
    pub is_sheet: bool,
}

/// A part that is inside out.
#[derive(Debug, Clone, Copy)]
pub(super) struct Reversed {
    pub volume: f64,
    pub center: DVec3,
}

/// Sums over a part.
#[derive(Debug, Clone, Copy, Default)]
struct Part {
    volume: f64,
    area: f64,
    triangles: u64,
    /// Width of the widest hole, and whether what fills it folds back.
    hole: f64,
    is_folded: bool,
}

impl Part {
    fn is_solid(&self) -> bool {
        self.volume.abs() > SOLID_REL * self.area.powf(1.5)
    }

    fn is_negative(&self) -> bool {
        self.volume < 0.0 && self.is_solid()
    }

    fn is_sheet(&self) -> bool {
        self.is_folded && self.volume.abs() < SHEET_REL * self.area.powf(1.5)
    }
}

/// A mesh with its closing, and its parts by a vertex of each.
struct Survey<'a> {
    mesh: &'a TriMesh,
    closing: &'a Closing,
    group: DisjointSets,
    parts: Vec<Part>,
}

/// Finds the parts. Those that are inside out are turned if `inside` asks for directions.
pub(super) fn parts(
    mesh: &TriMesh,
    closing: &Closing,
    inside: Inside,
    progress: &Progress,
) -> Result<Parts, Cancelled> {
    let count = mesh.positions().len() + closing.added.len();
    let mut survey = Survey {
        mesh,
        closing,
        group: DisjointSets::new(count),
        parts: Vec::new(),
    };
    for (i, &[a, b, c]) in all_of(mesh, closing).enumerate() {
        if i.is_multiple_of(STRIDE) {
            progress.check()?;
        }
        survey.group.join(a, b);
        survey.group.join(a, c);
    }
    let mut found = Parts {
        degenerate: survey.measure(|_, center| center, progress)?,
        ..Parts::default()
    };
    found.volume = survey.parts.iter().map(|part| part.volume).sum();
    let maybe_sheet = closing.holes.iter().any(|hole| hole.folded);
    let rounding = ROUNDING_REL * (0.5 * mesh.bounds().diagonal()).powi(3);
    let maybe_negative =
        |part: &Part| part.area > 0.0 && part.volume < rounding * part.triangles as f64;
    if !maybe_sheet && !survey.parts.iter().any(maybe_negative) {
        return Ok(found);
    }
    let all = maybe_sheet || closing.is_split;
    survey.join_by_place(|part| all || maybe_negative(part));
    // about a place of the part, so that it may be small and far away
    let first = mesh.positions().first().copied().unwrap_or_default();
    survey.measure(
        |own, _| mesh.positions().get(own as usize).copied().unwrap_or(first),
        progress,
    )?;
    found.volume = survey.parts.iter().map(|part| part.volume).sum();
    survey.note_holes();
    let mut whole = survey.parts.iter().filter(|part| part.triangles > 0);
    found.is_sheet = maybe_sheet && whole.all(Part::is_sheet);
    if survey.parts.iter().any(Part::is_negative) {
        survey.judge(&mut found, inside, progress)?;
    }
    Ok(found)
}

/// All triangles of a mesh, and then of its closing.
fn all_of<'a>(mesh: &'a TriMesh, closing: &'a Closing) -> impl Iterator<Item = &'a [u32; 3]> {
    mesh.triangles().iter().chain(&closing.triangles)
}

impl Survey<'_> {
    fn at(&self, v: u32) -> DVec3 {
        let own = self.mesh.positions();
        let beyond = || self.closing.added[v as usize - own.len()];
        own.get(v as usize).copied().unwrap_or_else(beyond)
    }

    fn corners(&self, t: [u32; 3]) -> [DVec3; 3] {
        t.map(|v| self.at(v))
    }

    /// Sums up the parts, with volumes about an origin by part; areas are those of the mesh alone. Gives the number of its
    /// triangles without area.
    fn measure(
        &mut self,
        origin: impl Fn(u32, DVec3) -> DVec3,
        progress: &Progress,
    ) -> Result<u64, Cancelled> {
        let center = self.mesh.bounds().center();
        let mut parts = vec![Part::default(); self.group.len()];
        let own_triangles = self.mesh.triangles().len();
        let mut degenerate = 0;
        for (i, t) in all_of(self.mesh, self.closing).enumerate() {
            if i.is_multiple_of(STRIDE) {
                progress.check()?;
            }
            let corners = self.corners(*t);
            let own = self.group.root(t[0]);
            let part = &mut parts[own as usize];
            if i < own_triangles {
                let [a, b, c] = corners;
                let plane = OrientedPlane::through(a, b, c);
                degenerate += u64::from(plane.is_degenerate());
                part.area += 0.5 * plane.normal().length();
                part.triangles += 1;
            }
            let origin = origin(own, center);
            let [a, b, c] = corners.map(|corner| corner - origin);
            part.volume += a.dot(b.cross(c)) / 6.0;
        }
        self.parts = parts;
        Ok(degenerate)
    }

    /// Joins parts of which one is `asked` for and that have a vertex at the same place: specks at a surface belong to it.
    fn join_by_place(&mut self, asked: impl Fn(&Part) -> bool) {
        let mesh = self.mesh;
        let place = |v: u32| {
            let at = mesh.positions()[v as usize].to_array();
            at.map(|x| (x + 0.0).to_bits())
        };
        let vertices = || 0..mesh.positions().len() as u32;
        let mut first: FxHashMap<[u64; 3], u32> = FxHashMap::default();
        for v in vertices() {
            if asked(&self.parts[self.group.root(v) as usize]) {
                first.entry(place(v)).or_insert(v);
            }
        }
        for v in vertices() {
            if let Some(&other) = first.get(&place(v)) {
                self.group.join(v, other);
            }
        }
    }

    /// Enters the widest hole of each part.
    fn note_holes(&mut self) {
        for hole in &self.closing.holes {
            let part = &mut self.parts[self.group.root(hole.vertex) as usize];
            if hole.width > part.hole {
                part.hole = hole.width;
                part.is_folded = hole.folded;
            }
        }
    }

    /// Winding numbers on both sides of some triangles of each part that is `asked` for, by the root of the part.
    fn sampled(
        &mut self,
        winding: &WindingNumbers,
        asked: impl Fn(&Part) -> bool,
        progress: &Progress,
    ) -> Result<FxHashMap<u32, Vec<[f64; 2]>>, Cancelled> {
        let mut seen: FxHashMap<u32, u64> = FxHashMap::default();
        let mut samples: FxHashMap<u32, Vec<[f64; 2]>> = FxHashMap::default();
        for t in self.mesh.triangles() {
            let own = self.group.root(t[0]);
            let part = &self.parts[own as usize];
            if !asked(part) {
                continue;
            }
            let seen = seen.entry(own).or_default();
            let is_sample = seen.is_multiple_of(part.triangles.div_ceil(SAMPLES));
            *seen += 1;
            if !is_sample {
                continue;
            }
            progress.check()?;
            let [a, b, c] = self.corners(*t);
            // a thousandth of the triangle's size away from it on either side
            let normal = (b - a).cross(c - a);
            let away = 1e-3 * normal.normalize_or_zero() * normal.length().sqrt();
            let middle = (a + b + c) / 3.0;
            let sides = [middle - away, middle + away].map(|p| winding.at(p));
            samples.entry(own).or_default().push(sides);
        }
        Ok(samples)
    }

    /// Finds parts that are inside out, and decides which are turned.
    fn judge(
        &mut self,
        found: &mut Parts,
        inside: Inside,
        progress: &Progress,
    ) -> Result<(), Cancelled> {
        let closed = [self.mesh.triangles(), &self.closing.triangles].concat();
        let places = [self.mesh.positions(), &self.closing.added].concat();
        let closed = TriMesh::new(places, closed).expect("a closing has the vertices of its mesh");
        let bvh = Bvh::try_new(&closed, progress)?;
        let winding = WindingNumbers::try_new(&bvh, progress)?;
        // on the surface of a part that winds −1 in itself it winds −½ on average, and what is around it adds to that
        let is_outside = |samples: &Vec<[f64; 2]>| {
            let below = samples.iter().filter(|sides| sides[0] + sides[1] < 0.0);
            2 * below.count() > samples.len()
        };
        let meets_others = self.roots_that_meet(&BoxTree::try_new(&closed, progress)?, progress)?;
        let is_clear = |own: u32, samples: &Vec<[f64; 2]>| {
            let largest = samples
                .iter()
                .flatten()
                .copied()
                .fold(f64::NEG_INFINITY, f64::max);
            largest < MAX_OUTSIDE && !meets_others.contains(&own)
        };
        let mut samples = self.sampled(&winding, Part::is_negative, progress)?;
        samples.retain(|_, samples| is_outside(samples));
        if samples.is_empty() {
            return Ok(());
        }
        let others = |part: &Part| part.is_solid() && !part.is_negative();
        let others = self.sampled(&winding, others, progress)?;
        let asks_for_directions = inside == Inside::Positive;
        let is_sheet = |own: u32| self.parts[own as usize].is_sheet();
        found.is_all_turned =
            asks_for_directions && !found.is_sheet && others.values().all(is_outside);
        let turns = |(own, samples): (&u32, &Vec<[f64; 2]>)| {
            let is_turned = found.is_all_turned || (is_clear(*own, samples) && !is_sheet(*own));
            (asks_for_directions && is_turned).then_some(*own)
        };
        let mut turned: Vec<u32> = samples.iter().filter_map(turns).collect();
        // cavities of parts that are turned are turned with them
        let cavities = others.iter().filter(|(_, samples)| is_outside(samples));
        turned.extend(cavities.filter_map(turns));
        turned.sort_unstable();
        let mut left: Vec<u32> = samples.into_keys().collect();
        left.sort_unstable();
        let reversed = self.reversed(&left);
        for (own, part) in left.into_iter().zip(reversed) {
            match turned.binary_search(&own) {
                Ok(_) => found.turned.push(part),
                Err(_) => found.left.push(part),
            }
        }
        for list in [&mut found.turned, &mut found.left] {
            list.sort_by(|a, b| a.volume.total_cmp(&b.volume));
        }
        self.turn(&turned, found);
        Ok(())
    }

    /// The roots of parts that meet other parts, by exact tests of their triangles.
    fn roots_that_meet(
        &mut self,
        closed: &BoxTree,
        progress: &Progress,
    ) -> Result<FxHashSet<u32>, Cancelled> {
        let group = &mut self.group;
        let own: Vec<u32> = all_of(self.mesh, self.closing)
            .map(|t| group.root(t[0]))
            .collect();
        let found = Mutex::new(FxHashSet::default());
        for_each_self_intersection(closed, progress, |pair| {
            let roots = [pair.first, pair.second].map(|t| own[t as usize]);
            if roots[0] != roots[1] {
                // a set is valid wherever another thread stopped
                let mut found = found.lock().unwrap_or_else(PoisonError::into_inner);
                found.extend(roots);
            }
        })?;
        Ok(found.into_inner().unwrap_or_else(PoisonError::into_inner))
    }

    /// Marks the triangles of parts that are turned: of all of the mesh, or of those with these roots.
    fn turn(&mut self, turned: &[u32], found: &mut Parts) {
        if turned.is_empty() {
            return;
        }
        let group = &mut self.group;
        found.turn = all_of(self.mesh, self.closing)
            .map(|t| found.is_all_turned || turned.binary_search(&group.root(t[0])).is_ok())
            .collect();
        found.volume = if found.is_all_turned {
            -found.volume
        } else {
            let own = turned.iter().map(|&own| self.parts[own as usize].volume);
            found.volume - 2.0 * own.sum::<f64>()
        };
    }

    /// Findings about the parts with these roots, which ascend.
    fn reversed(&mut self, roots: &[u32]) -> Vec<Reversed> {
        let mut bounds = vec![Aabb::EMPTY; roots.len()];
        for t in self.mesh.triangles() {
            if let Ok(at) = roots.binary_search(&self.group.root(t[0])) {
                bounds[at] = bounds[at].union(Aabb::around(self.corners(*t)));
            }
        }
        let list = roots.iter().zip(bounds);
        list.map(|(&own, bounds)| Reversed {
            volume: self.parts[own as usize].volume,
            center: bounds.center(),
        })
        .collect()
    }
}

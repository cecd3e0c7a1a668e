//! Coverage of an offset surface: each point at the distance must have some of the surface close by.
//!
//! Runs along tracks over the faces, edges and vertices of the mesh, at the distance from them. A place on a track belongs
//! to the true offset if nothing else is closer; where that begins or ends, a crest of the offset crosses the track, and its
//! place is found by halving. So creases are checked as strictly as the smooth parts.

use super::sweep::{Piece, Tracks};
use glam::{DVec3, IVec3};
use ravec_mesh::{Aabb, Bvh, TriMesh};
use rayon::prelude::*;

/// Which part of what is at the distance is meant.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// All of it.
    All,
    /// Points that can be reached from far away.
    Reachable,
    /// Points outside the solid that can be reached from far away.
    Outside,
    /// Points inside the solid.
    Inside,
}

/// The truth about a mesh.
pub struct Truth<'a> {
    pub mesh: &'a TriMesh,
    pub part: Part,
    /// The distance of the offset.
    pub delta: f64,
    /// The distance of a point from the mesh.
    pub distance: &'a (dyn Fn(DVec3) -> f64 + Sync),
    /// Returns whether a point is inside the solid; for parts of a solid only.
    pub is_inside: &'a (dyn Fn(DVec3) -> bool + Sync),
}

/// A place of the true offset that is far from the surface.
#[derive(Debug, Clone, Copy)]
pub struct Gap {
    pub at: DVec3,
    /// Distance from the surface.
    pub miss: f64,
    pub piece: Piece,
    pub on_crest: bool,
    /// Increase of the distance from the mesh along the uphill path.
    pub rise: f64,
    /// The uphill path leads far away; known for reachable parts only.
    pub is_reachable: bool,
}

/// Result.
#[derive(Debug, Clone, Default)]
pub struct Coverage {
    pub samples: usize,
    pub crest_samples: usize,
    /// The largest distance from a place of the offset to the surface, without regard to gaps that are excused.
    pub worst: f64,
    /// Places farther than the tolerance, the worst first; none of pockets shallower than the tolerance, or that cannot be
    /// reached although they would have to be.
    pub gaps: Vec<Gap>,
    /// Places that were excused for one of those reasons.
    pub excused: Vec<Gap>,
}

/// Half of the number of places that are examined closely.
const MOST_FAR: usize = 3000;

struct Sample {
    at: DVec3,
    piece: Piece,
    on_crest: bool,
}

/// Measures how well `surface` covers the true offset, along tracks about `spacing` apart.
pub fn coverage(truth: &Truth<'_>, surface: &TriMesh, tolerance: f64, spacing: f64) -> Coverage {
    let tracks = Tracks::new(truth.mesh, truth.delta, spacing);
    let slack = truth.slack();
    let surface = Bvh::new(surface);
    let miss = |p: DVec3| {
        surface
            .closest(p)
            .map_or(f64::INFINITY, |c| c.distance_sq.sqrt())
    };
    let found: Vec<(Sample, f64)> = (0..tracks.parts())
        .into_par_iter()
        .flat_map_iter(|part| truth.samples(&tracks, part, spacing, slack))
        .map(|sample| {
            let miss = miss(sample.at);
            (sample, miss)
        })
        .collect();
    let mut far: Vec<&(Sample, f64)> = found.iter().filter(|(_, miss)| *miss > tolerance).collect();
    far.sort_by(|a, b| b.1.total_cmp(&a.1));
    if far.len() > 2 * MOST_FAR {
        // what is missing altogether is far, what is just not good enough is near: some of each
        far.drain(MOST_FAR..far.len() - MOST_FAR);
    }
    let reach = match truth.part {
        Part::Reachable | Part::Outside if !far.is_empty() => Some(Reach::new(truth)),
        _ => None,
    };
    let gaps: Vec<Gap> = far
        .into_par_iter()
        .map(|(sample, miss)| {
            let top = truth.climb(sample.at, tolerance);
            Gap {
                at: sample.at,
                miss: *miss,
                piece: sample.piece,
                on_crest: sample.on_crest,
                rise: (truth.distance)(top) - truth.delta,
                is_reachable: reach.as_ref().is_some_and(|reach| reach.holds(top)),
            }
        })
        .collect();
    let must_be_reachable = reach.is_some();
    let (gaps, excused): (Vec<Gap>, Vec<Gap>) = gaps
        .into_iter()
        .partition(|gap| gap.rise > tolerance && (gap.is_reachable || !must_be_reachable));
    let covered = found.iter().map(|(_, miss)| *miss);
    let covered = covered
        .filter(|miss| *miss <= tolerance)
        .fold(0.0, f64::max);
    Coverage {
        samples: found.len(),
        crest_samples: found.iter().filter(|(sample, _)| sample.on_crest).count(),
        worst: gaps.first().map_or(covered, |gap| gap.miss),
        gaps,
        excused,
    }
}

impl Truth<'_> {
    /// Largest change of a distance by rounding.
    fn slack(&self) -> f64 {
        let bounds = self.mesh.bounds();
        let size = bounds.min.abs().max(bounds.max.abs()).max_element();
        1e-10 * self.delta + 1e-14 * size
    }

    /// Returns whether a place lies on the requested side.
    fn is_on_side(&self, p: DVec3) -> bool {
        match self.part {
            Part::All | Part::Reachable => true,
            Part::Outside => !(self.is_inside)(p),
            Part::Inside => (self.is_inside)(p),
        }
    }

    /// Places of the true offset over one part of the mesh.
    fn samples(&self, tracks: &Tracks, part: usize, spacing: f64, slack: f64) -> Vec<Sample> {
        let is_at_distance = |p: DVec3| ((self.distance)(p) - self.delta).abs() <= slack;
        let mut samples = Vec::new();
        for track in tracks.of(part) {
            let steps = (track.length(self.delta) / spacing).ceil().clamp(1.0, 1e4) as u32;
            let at = |t: f64| track.at(t, self.delta);
            let mut offer = |at: DVec3, on_crest: bool| {
                let piece = track.piece;
                samples.push(Sample {
                    at,
                    piece,
                    on_crest,
                });
            };
            // the last place at the distance and its side: so close to it the mesh cannot be between
            let mut known: Option<(DVec3, bool)> = None;
            let mut side = |p: DVec3| {
                let near = known.filter(|(q, _)| p.distance(*q) < 1.9 * self.delta);
                let is_on_side = near.map_or_else(|| self.is_on_side(p), |(_, side)| side);
                known = Some((p, is_on_side));
                is_on_side
            };
            let mut before = None;
            for k in 0..=steps {
                let t = f64::from(k) / f64::from(steps);
                let holds = is_at_distance(at(t));
                if holds && side(at(t)) {
                    offer(at(t), false);
                }
                if let Some((earlier, held)) = before
                    && held != holds
                {
                    let (mut on, mut off) = if holds { (t, earlier) } else { (earlier, t) };
                    for _ in 0..40 {
                        let middle = 0.5 * (on + off);
                        if is_at_distance(at(middle)) {
                            on = middle;
                        } else {
                            off = middle;
                        }
                    }
                    if side(at(on)) {
                        offer(at(on), true);
                    }
                }
                before = Some((t, holds));
            }
        }
        samples
    }

    /// A place uphill from `p`, as high as steps lead that cannot jump over the mesh.
    fn climb(&self, p: DVec3, tolerance: f64) -> DVec3 {
        let (mut at, mut height) = (p, (self.distance)(p));
        let mut step = 0.5 * tolerance;
        for _ in 0..300 {
            let best = (0..27)
                .filter(|&k| k != 13)
                .map(|k| DVec3::new(f64::from(k % 3), f64::from(k / 3 % 3), f64::from(k / 9)) - 1.0)
                .map(|toward| at + step * toward.normalize())
                .map(|q| (q, (self.distance)(q)))
                .max_by(|a, b| a.1.total_cmp(&b.1));
            match best {
                Some((q, higher)) if higher > height + 1e-3 * step => {
                    (at, height) = (q, higher);
                    step = (1.3 * step).min(0.25 * self.delta);
                }
                _ => step *= 0.5,
            }
            if step < 1e-4 * tolerance || height > 3.0 * self.delta {
                break;
            }
        }
        at
    }
}

/// A grid of the space outside the offset that is known to hang together with what is far away.
struct Reach {
    low: DVec3,
    cell: f64,
    size: IVec3,
    reached: Vec<bool>,
}

impl Reach {
    fn new(truth: &Truth<'_>) -> Self {
        let bounds: Aabb = truth.mesh.bounds().grown(1.2 * truth.delta);
        let cell = (bounds.size().max_element() / 96.0).max(0.2 * truth.delta);
        let low = bounds.min - 2.0 * cell;
        let size = ((bounds.size() / cell).ceil() + 5.0).as_ivec3();
        let count = size.element_product() as usize;
        let place = |index: usize| {
            let i = index as i32;
            let at = IVec3::new(i % size.x, i / size.x % size.y, i / (size.x * size.y));
            low + cell * at.as_dvec3()
        };
        // a step to a neighbor comes at most half a cell closer
        let open: Vec<bool> = (0..count)
            .into_par_iter()
            .map(|index| (truth.distance)(place(index)) > truth.delta + 0.5 * cell)
            .collect();
        let mut reached = vec![false; count];
        let mut front = vec![IVec3::ZERO];
        let number = |at: IVec3| (at.x + size.x * (at.y + size.y * at.z)) as usize;
        reached[0] = open[0];
        while let Some(at) = front.pop() {
            for toward in [IVec3::X, IVec3::Y, IVec3::Z] {
                for next in [at - toward, at + toward] {
                    let inside = next.cmpge(IVec3::ZERO).all() && next.cmplt(size).all();
                    if inside && open[number(next)] && !reached[number(next)] {
                        reached[number(next)] = true;
                        front.push(next);
                    }
                }
            }
        }
        Self {
            low,
            cell,
            size,
            reached,
        }
    }

    /// Returns whether a place far from the mesh is known to be reachable.
    fn holds(&self, p: DVec3) -> bool {
        let at = ((p - self.low) / self.cell).floor().as_ivec3();
        (0..8).any(|k| {
            let at = at + IVec3::new(k & 1, k >> 1 & 1, k >> 2);
            let outside = at.cmplt(IVec3::ZERO).any() || at.cmpge(self.size).any();
            outside || self.reached[(at.x + self.size.x * (at.y + self.size.y * at.z)) as usize]
        })
    }
}

//! Facets that lie as the surface does.
//!
//! After simplification a few facets are left that lie across a crease, or otherwise point away from the surface by more
//! than is allowed. Their corners are moved to where the planes that touch the surface around them meet, and their edges
//! flipped, as long as that lessens what they are off, and the tolerance is proved for what comes to be. Where neither helps,
//! large ones are divided.

use crate::certify::proved;
use crate::field::{Field, Near};
use crate::params::Coordinates;
use glam::{DMat3, DVec3};
use ravec_mesh::{Facet, RelaxJudge, TriMesh, relax};
use ravec_progress::{Cancelled, Progress};

/// What facets are turned to, as a share of what is allowed: a step that just keeps what is allowed at the middle of a facet
/// would be worth nothing.
const AIM: f64 = 0.8;

/// The share of what is allowed up to which facets are not divided: a few degrees less are not worth a vertex.
const TOLERATED: f64 = 0.95;

/// The area of the least facets that are divided, relative to their mean: smaller ones weigh too little.
const LEAST_DIVIDED: f64 = 0.3;

/// What holds a vertex in the directions in which the planes do not, relative to their mean weight: enough for flat parts,
/// too little to keep it from a crease of a few degrees.
const HOLD: f64 = 1e-5;

/// Turns facets of `surface` that are off by more than is allowed, while distances stay within limits.
///
/// Vertices and triangles keep their numbers; new ones come behind them.
pub(crate) fn smooth(
    surface: &TriMesh,
    facets: &Facets<'_>,
    progress: &Progress,
) -> Result<TriMesh, Cancelled> {
    relax(surface, facets, progress).map(|relaxed| relaxed.mesh)
}

/// Twice the area of the least facets of a surface that should be divided.
pub(crate) fn least_divided(surface: &TriMesh) -> f64 {
    let area = |t: u32| {
        let [a, b, c] = surface.corners(t);
        (b - a).cross(c - a).length()
    };
    let count = surface.triangles().len();
    let whole: f64 = (0..count as u32).map(area).sum();
    LEAST_DIVIDED * whole / count as f64
}

/// What facets should be.
pub(crate) struct Facets<'a> {
    pub field: &'a Field<'a>,
    pub coordinates: Coordinates,
    pub limits: [f64; 2],
    /// What they may be off, in radians.
    pub most_deviation: f64,
    /// Twice the area of the least facets that are divided; infinite if none are.
    pub least_divided: f64,
    /// Of each vertex whether triangles elsewhere have it, too; empty if there are none.
    pub sealed: &'a [bool],
}

impl Facets<'_> {
    /// Whether a side of a facet may be one of triangles elsewhere.
    fn is_sealed(&self, names: [u32; 3]) -> bool {
        let is_sealed = |v: &u32| self.sealed.get(*v as usize) == Some(&true);
        names.iter().filter(|v| is_sealed(v)).count() > 1
    }
}

/// How a facet lies.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Lie {
    /// By how much more than is aimed at the facet is off at its middle, times its area.
    fault: f64,
    area: f64,
    /// What is closest to the middle.
    near: Near,
    /// The point of the surface there.
    foot: DVec3,
}

/// Where planes meet that touch the surface, or nearly, from a place on; each with its weight.
fn meeting(from: DVec3, planes: impl Iterator<Item = Lie>) -> Option<DVec3> {
    let mut matrix = DMat3::ZERO;
    let mut right = DVec3::ZERO;
    for Lie {
        area, near, foot, ..
    } in planes
    {
        let n = near.away;
        matrix += area * DMat3::from_cols(n.x * n, n.y * n, n.z * n);
        right += area * n.dot(foot - from) * n;
    }
    let trace = matrix.x_axis.x + matrix.y_axis.y + matrix.z_axis.z;
    let held = matrix + DMat3::from_diagonal(DVec3::splat(HOLD * trace / 3.0));
    (trace > 0.0).then(|| from + held.inverse() * right)
}

impl RelaxJudge for Facets<'_> {
    type Descriptor = Lie;

    fn describe(&self, corners: [DVec3; 3], like: Option<&Lie>) -> Lie {
        let [a, b, c] = corners;
        let normal = (b - a).cross(c - a);
        let middle = (a + b + c) / 3.0;
        let near = (self.field).near(middle, like.map_or(0, |lie| lie.near.triangle));
        let outward = if self.field.level < 0.0 {
            -near.away
        } else {
            near.away
        };
        let length = normal.length();
        let fault = if length > 0.0 {
            let angle = (normal.dot(outward) / length).clamp(-1.0, 1.0).acos();
            (angle - AIM * self.most_deviation).max(0.0) * length
        } else {
            0.0
        };
        Lie {
            fault,
            area: length,
            near,
            foot: self.field.foot(middle, &near),
        }
    }

    fn fault(&self, descriptor: &Lie) -> f64 {
        descriptor.fault
    }

    /// Where the planes meet that touch the surface at the middles of the facets around.
    fn place(&self, of: u32, around: &[Facet<Lie>]) -> Option<DVec3> {
        let v = around.first()?.corner(of)?;
        meeting(v, around.iter().map(|facet| facet.descriptor))
    }

    /// Where the planes meet that touch the surface at the middles of what the facets would be divided into.
    fn between(&self, ends: [u32; 2], facets: &[Facet<Lie>; 2]) -> Option<DVec3> {
        let worst = facets[0].descriptor;
        let tolerated = (TOLERATED - AIM) * self.most_deviation * worst.area;
        if worst.area < self.least_divided || worst.fault <= tolerated {
            return None;
        }
        let places = ends.map(|v| facets[0].corner(v));
        let [Some(p), Some(q)] = places else {
            return None;
        };
        let middle = 0.5 * (p + q);
        let halves = facets.iter().flat_map(|facet| {
            let apex = facet.names.iter().position(|v| !ends.contains(v));
            apex.into_iter().flat_map(move |apex| {
                [p, q].map(|end| {
                    self.describe([facet.corners[apex], end, middle], Some(&facet.descriptor))
                })
            })
        });
        meeting(middle, halves)
    }

    fn rounded(&self, place: DVec3) -> DVec3 {
        self.coordinates.nearest(place)
    }

    fn admits(&self, after: &[Facet<Lie>]) -> bool {
        if after.iter().any(|facet| self.is_sealed(facet.names)) {
            return false;
        }
        let mut known: Vec<(u32, Near)> = Vec::with_capacity(after.len() + 1);
        after.iter().all(|facet| {
            let near = [0, 1, 2].map(|i| {
                let name = facet.names[i];
                if let Some(&(_, near)) = known.iter().find(|(v, _)| *v == name) {
                    return near;
                }
                let near = (self.field).near(facet.corners[i], facet.descriptor.near.triangle);
                known.push((name, near));
                near
            });
            proved(self.field, facet.corners, self.limits, near)
        })
    }
}

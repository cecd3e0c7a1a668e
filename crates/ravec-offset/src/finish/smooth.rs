//! Improvement of facets that are tilted against the surface.
//!
//! After simplification a few facets lie across a crease or otherwise deviate from the surface by more than allowed. Their
//! corners move to the intersection of the tangent planes around them, and their edges are flipped, as long as that reduces the
//! deviation and the tolerance is proved for the result. Where neither helps, large facets are divided.

use crate::domain::{Field, Near};
use crate::params::Coordinates;
use crate::prove::proved;
use glam::{DMat3, DVec3};
use ravec_mesh::{Facet, RelaxJudge, TriMesh, relax};
use ravec_progress::{Cancelled, Progress};

/// Target of the tilt, as a share of the limit: a facet that just keeps the limit is not worth a move.
const AIM: f64 = 0.8;

/// Share of the limit up to which facets are not divided: a few degrees are not worth a vertex.
const TOLERATED: f64 = 0.95;

/// Area of the smallest facets that are divided, relative to the mean: smaller ones weigh too little.
const MIN_DIVIDED: f64 = 0.3;

/// Damping of a vertex in directions that the planes do not determine, relative to their mean weight: enough for flat parts,
/// too little to hold it off a crease of a few degrees.
const DAMPING: f64 = 1e-5;

/// Improves facets of `surface` that deviate by more than allowed, within the limits of the distance.
///
/// Vertices and triangles keep their numbers; new ones follow them.
pub(crate) fn smooth(
    surface: &TriMesh,
    facets: &Facets<'_>,
    progress: &Progress,
) -> Result<TriMesh, Cancelled> {
    relax(surface, facets, progress).map(|relaxed| relaxed.mesh)
}

/// Returns twice the area of the smallest facets that are divided.
pub(crate) fn min_divided_area(surface: &TriMesh) -> f64 {
    let area = |t: u32| {
        let [a, b, c] = surface.corners(t);
        (b - a).cross(c - a).length()
    };
    let count = surface.triangles().len();
    let whole: f64 = (0..count as u32).map(area).sum();
    MIN_DIVIDED * whole / count as f64
}

/// Requirements of facets.
pub(crate) struct Facets<'a> {
    pub field: &'a Field<'a>,
    pub coordinates: Coordinates,
    pub limits: [f64; 2],
    /// Limit of the tilt, in radians.
    pub max_deviation: f64,
    /// Twice the area of the smallest facets that are divided; infinite if none is.
    pub min_divided_area: f64,
    /// For each vertex, whether triangles elsewhere share it; empty if there are none.
    pub sealed: &'a [bool],
}

impl Facets<'_> {
    /// Returns whether a side of a facet may be shared with triangles elsewhere.
    fn is_sealed(&self, names: [u32; 3]) -> bool {
        let is_sealed = |v: &u32| self.sealed.get(*v as usize) == Some(&true);
        names.iter().filter(|v| is_sealed(v)).count() > 1
    }
}

/// Tilt of a facet.
#[derive(Debug, Clone, Copy)]
pub(crate) struct FacetTilt {
    /// Excess of the angle over the target at the center, times the area.
    fault: f64,
    area: f64,
    /// Closest point to the center.
    near: Near,
    /// Foot point of the center on the surface.
    foot: DVec3,
}

/// Returns the weighted least-squares intersection of tangent planes, near a position.
fn meeting(from: DVec3, planes: impl Iterator<Item = FacetTilt>) -> Option<DVec3> {
    let mut matrix = DMat3::ZERO;
    let mut right = DVec3::ZERO;
    for FacetTilt {
        area, near, foot, ..
    } in planes
    {
        let n = near.away;
        matrix += area * DMat3::from_cols(n.x * n, n.y * n, n.z * n);
        right += area * n.dot(foot - from) * n;
    }
    let trace = matrix.x_axis.x + matrix.y_axis.y + matrix.z_axis.z;
    let damped = matrix + DMat3::from_diagonal(DVec3::splat(DAMPING * trace / 3.0));
    (trace > 0.0).then(|| from + damped.inverse() * right)
}

impl RelaxJudge for Facets<'_> {
    type Descriptor = FacetTilt;

    fn describe(&self, corners: [DVec3; 3], like: Option<&FacetTilt>) -> FacetTilt {
        let [a, b, c] = corners;
        let normal = (b - a).cross(c - a);
        let middle = (a + b + c) / 3.0;
        let near = (self.field).near(middle, like.map_or(0, |tilt| tilt.near.triangle));
        let outward = if self.field.level < 0.0 {
            -near.away
        } else {
            near.away
        };
        let length = normal.length();
        let fault = if length > 0.0 {
            let angle = (normal.dot(outward) / length).clamp(-1.0, 1.0).acos();
            (angle - AIM * self.max_deviation).max(0.0) * length
        } else {
            0.0
        };
        FacetTilt {
            fault,
            area: length,
            near,
            foot: self.field.foot(middle, &near),
        }
    }

    fn fault(&self, descriptor: &FacetTilt) -> f64 {
        descriptor.fault
    }

    /// Intersection of the tangent planes at the centers of the facets around.
    fn place(&self, of: u32, around: &[Facet<FacetTilt>]) -> Option<DVec3> {
        let v = around.first()?.corner(of)?;
        meeting(v, around.iter().map(|facet| facet.descriptor))
    }

    /// Intersection of the tangent planes at the centers of the divided facets.
    fn between(&self, ends: [u32; 2], facets: &[Facet<FacetTilt>; 2]) -> Option<DVec3> {
        let worst = facets[0].descriptor;
        let tolerated = (TOLERATED - AIM) * self.max_deviation * worst.area;
        if worst.area < self.min_divided_area || worst.fault <= tolerated {
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

    fn admits(&self, after: &[Facet<FacetTilt>]) -> bool {
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

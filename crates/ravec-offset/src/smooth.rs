//! Facets that lie as the surface does.
//!
//! After simplification a few facets are left that lie across a crease, or otherwise point away from the surface by more
//! than is allowed. Their corners are moved to where the planes that touch the surface around them meet, and their edges
//! flipped, as long as that lessens what they are off, and the tolerance is proved for what comes to be.

use crate::certify::proved;
use crate::field::{Field, Near};
use glam::{DMat3, DVec3};
use ravec_mesh::{RelaxJudge, TriMesh, relax};
use ravec_progress::{Cancelled, Progress};

/// Where planes touch the surface that a corner is moved to, as weights of the corners of a facet: at its middle, and half
/// way from there to each corner.
const SAMPLES: [[f64; 3]; 4] = [
    [1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0],
    [2.0 / 3.0, 1.0 / 6.0, 1.0 / 6.0],
    [1.0 / 6.0, 2.0 / 3.0, 1.0 / 6.0],
    [1.0 / 6.0, 1.0 / 6.0, 2.0 / 3.0],
];

/// What facets are turned to, as a share of what is allowed: a step that just keeps what is allowed at the middle of a facet
/// would be worth nothing.
const AIM: f64 = 0.8;

/// What holds a vertex in the directions in which the planes do not, relative to their mean weight: enough for flat parts,
/// too little to keep it from a crease of a few degrees.
const HOLD: f64 = 1e-5;

/// Turns facets of `surface` that are off by more than `most_deviation`, in radians, while distances stay within `limits`.
pub(crate) fn smooth(
    field: &Field<'_>,
    surface: &TriMesh,
    limits: [f64; 2],
    most_deviation: f64,
    progress: &Progress,
) -> Result<TriMesh, Cancelled> {
    let facets = Facets {
        field,
        limits,
        aim: AIM * most_deviation,
    };
    relax(surface, &facets, progress).map(|relaxed| relaxed.mesh)
}

struct Facets<'a> {
    field: &'a Field<'a>,
    limits: [f64; 2],
    /// In radians.
    aim: f64,
}

impl Facets<'_> {
    fn outward(&self, near: &Near) -> DVec3 {
        if self.field.level < 0.0 {
            -near.away
        } else {
            near.away
        }
    }
}

fn at(corners: [DVec3; 3], weights: [f64; 3]) -> DVec3 {
    weights[0] * corners[0] + weights[1] * corners[1] + weights[2] * corners[2]
}

fn normal([a, b, c]: [DVec3; 3]) -> DVec3 {
    (b - a).cross(c - a)
}

impl RelaxJudge for Facets<'_> {
    /// By how much more than is aimed at the facet is off at its middle, times its area.
    fn fault(&self, _: [u32; 3], corners: [DVec3; 3]) -> f64 {
        let normal = normal(corners);
        let length = normal.length();
        if length <= 0.0 {
            return 0.0;
        }
        let near = self.field.near(at(corners, SAMPLES[0]), 0);
        let cosine = normal.dot(self.outward(&near)) / length;
        (cosine.clamp(-1.0, 1.0).acos() - self.aim).max(0.0) * length
    }

    /// Where the planes meet that touch the surface at the samples of the facets around.
    fn place(&self, of: u32, around: &[([u32; 3], [DVec3; 3])]) -> Option<DVec3> {
        let (names, corners) = around.first()?;
        let v = corners[names.iter().position(|&name| name == of)?];
        let mut matrix = DMat3::ZERO;
        let mut right = DVec3::ZERO;
        let mut hint = 0;
        for &(_, corners) in around {
            let area = normal(corners).length();
            for weights in SAMPLES {
                let sample = at(corners, weights);
                let near = self.field.near(sample, hint);
                hint = near.triangle;
                let n = near.away;
                let foot = self.field.foot(sample, &near);
                matrix += area * DMat3::from_cols(n.x * n, n.y * n, n.z * n);
                right += area * n.dot(foot - v) * n;
            }
        }
        let trace = matrix.x_axis.x + matrix.y_axis.y + matrix.z_axis.z;
        let held = matrix + DMat3::from_diagonal(DVec3::splat(HOLD * trace / 3.0));
        (trace > 0.0).then(|| v + held.inverse() * right)
    }

    fn admits(&self, after: &[([u32; 3], [DVec3; 3])]) -> bool {
        after.iter().all(|&(_, corners)| {
            let mut hint = 0;
            let near = corners.map(|p| {
                let near = self.field.near(p, hint);
                hint = near.triangle;
                near
            });
            proved(self.field, corners, self.limits, near)
        })
    }
}

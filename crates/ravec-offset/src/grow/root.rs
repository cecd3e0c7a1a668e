//! Roots of the field along the edges of cells.

use super::{CornerValue, Sample};
use crate::domain::{Field, Place, Region};
use glam::DVec3;
use ravec_mesh::closest_on_triangle;

/// Rounds after which a root has the precision of the numbers: a third of the rounds halve the interval.
const MAX_ROUNDS: usize = 90;

/// The ends of an edge.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Ends<'a> {
    pub points: [DVec3; 2],
    pub values: [CornerValue; 2],
    /// Known places near the edge.
    pub known: &'a [Place],
}

/// Finds the zero of the field between two points with different signs, within `enough` of the surface or to the precision of
/// the numbers.
pub(crate) fn root(field: &Field<'_>, region: Region, ends: Ends<'_>, enough: f64) -> Sample {
    let Ends {
        points,
        values,
        known,
    } = ends;
    let (mut low, mut high) = (0.0, 1.0);
    let [mut low_value, mut high_value] = values.map(|end| end.value);
    let nearer = usize::from(high_value.abs() < low_value.abs());
    let mut hint = values[nearer].triangle;
    let mut best = None;
    for round in 0..MAX_ROUNDS {
        // most edges meet the offset of one triangle only; halving guards against stagnation
        let t = if round % 3 == 2 {
            0.5 * (low + high)
        } else {
            let mut t = low + (high - low) * low_value / (low_value - high_value);
            // a triangle has an offset on either side
            if region != Region::Unknown {
                t = root_on_piece(field, points, hint, t);
            }
            t.clamp(low + 1e-6 * (high - low), high - 1e-6 * (high - low))
        };
        let point = points[0].lerp(points[1], t);
        let near = field.near(point, hint);
        hint = near.triangle;
        let region = match region {
            Region::Unknown => field.region_beside(point, near.distance, known),
            known => known,
        };
        let value = field.value(near.distance, region);
        let sample = Sample {
            point,
            away: near.away,
            triangle: near.triangle,
        };
        best = Some(sample);
        if value.abs() <= enough {
            break;
        }
        if (value < 0.0) == (low_value < 0.0) {
            (low, low_value) = (t, value);
        } else {
            (high, high_value) = (t, value);
        }
    }
    best.expect("there was a round")
}

/// Finds the point of a segment at the distance of the surface from one triangle, by Newton's method from `t`.
fn root_on_piece(field: &Field<'_>, points: [DVec3; 2], triangle: u32, mut t: f64) -> f64 {
    let corners = field.bvh().corners(triangle);
    let along = points[1] - points[0];
    for _ in 0..4 {
        let p = points[0] + t * along;
        let closest = closest_on_triangle(p, corners);
        let distance = closest.distance_sq.sqrt();
        let slope = (p - closest.point).dot(along);
        if slope == 0.0 {
            break;
        }
        let step = (field.radius() - distance) * distance / slope;
        t = (t + step).clamp(0.0, 1.0);
        if step.abs() < 1e-6 {
            break;
        }
    }
    t
}

//! Strokes: polylines with a width and round ends, covering pixels.
//!
//! The distance to a stroke is that to the nearest of its segments. A footprint (the side of a pixel, or of a sample
//! within it) is covered by what the straight line at that distance and direction would cover: exact along straight
//! parts, within `side² / (8·radius)` at a curve, and within 0.11 at the very ends and corners.

use crate::coverage::{HalfPlane, bar};
use glam::DVec2;
use serde::{Deserialize, Serialize};

/// A polyline with a width and round ends.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Stroke {
    /// The corners, at least one; a curve is a polyline with many.
    pub points: Vec<DVec2>,
    /// Full width, in the unit of the points.
    pub width: f64,
}

/// The nearest point of a stroke's middle line.
#[derive(Debug, Clone, Copy)]
struct Nearest {
    distance: f64,
    /// From the middle line to the query; zero on the line itself.
    offset: DVec2,
}

impl Stroke {
    /// A straight stroke.
    pub fn straight(from: DVec2, to: DVec2, width: f64) -> Self {
        Self {
            points: vec![from, to],
            width,
        }
    }

    /// A stroke along an arc of a circle, flattened to pieces of at most 5 degrees.
    pub fn arc(center: DVec2, radius: f64, from_rad: f64, to_rad: f64, width: f64) -> Self {
        let pieces = ((to_rad - from_rad).abs() / 5f64.to_radians())
            .ceil()
            .max(1.0);
        let at = |i: f64| {
            center + radius * DVec2::from_angle(from_rad + (to_rad - from_rad) * i / pieces)
        };
        Self {
            points: (0..=pieces as usize).map(|i| at(i as f64)).collect(),
            width,
        }
    }

    fn nearest(&self, p: DVec2) -> Nearest {
        let start = self.points.first().copied().unwrap_or(DVec2::INFINITY);
        let mut offset = p - start;
        let mut best = offset.length_squared();
        for pair in self.points.windows(2) {
            let along = pair[1] - pair[0];
            let length_sq = along.length_squared();
            let t = if length_sq == 0.0 {
                0.0
            } else {
                ((p - pair[0]).dot(along) / length_sq).clamp(0.0, 1.0)
            };
            let candidate = p - (pair[0] + t * along);
            let distance_sq = candidate.length_squared();
            if distance_sq < best {
                (best, offset) = (distance_sq, candidate);
            }
        }
        Nearest {
            distance: best.sqrt(),
            offset,
        }
    }

    /// The distance of a point from the middle line.
    pub fn distance(&self, p: DVec2) -> f64 {
        self.nearest(p).distance
    }

    /// Coverage by the stroke of the square of side `side` around `p`, 0 to 1.
    pub fn coverage(&self, p: DVec2, side: f64) -> f64 {
        let near = self.nearest(p);
        let half = 0.5 * self.width;
        if near.distance > half + 0.71 * side {
            return 0.0;
        }
        if near.distance + 0.71 * side <= half {
            return 1.0;
        }
        let normal = near.offset.normalize_or(DVec2::X);
        // in units of the footprint, with the query at the origin
        let border = |at: f64| {
            let offset_px = (at - near.distance) / side;
            HalfPlane { normal, offset_px }.coverage(DVec2::ZERO)
        };
        border(half) - border(-half)
    }

    /// The same as [`Self::coverage`] for a round footprint: cheaper, without the direction.
    pub(crate) fn soft_coverage(&self, p: DVec2, side: f64) -> f64 {
        bar(self.distance(p), 0.5 * self.width, side)
    }

    /// The smallest box around the stroke: lower corner, upper corner.
    pub fn bounds(&self) -> (DVec2, DVec2) {
        let margin = DVec2::splat(0.5 * self.width);
        let low = self.points.iter().fold(DVec2::INFINITY, |a, &b| a.min(b));
        let high = self
            .points
            .iter()
            .fold(DVec2::NEG_INFINITY, |a, &b| a.max(b));
        (low - margin, high + margin)
    }
}

/// Strokes with their boxes, for many queries.
#[derive(Debug, Clone)]
pub(crate) struct Strokes {
    items: Vec<(DVec2, DVec2, Stroke)>,
}

impl Strokes {
    pub(crate) fn new(strokes: impl IntoIterator<Item = Stroke>) -> Self {
        let boxed = |stroke: Stroke| {
            let (low, high) = stroke.bounds();
            (low, high, stroke)
        };
        Self {
            items: strokes.into_iter().map(boxed).collect(),
        }
    }

    /// The union's coverage of a footprint, as if strokes that meet did not overlap within it: their sum, at most 1.
    pub(crate) fn coverage(&self, p: DVec2, side: f64) -> f64 {
        self.sum(p, side, Stroke::coverage)
    }

    /// The cheaper coverage of each, summed.
    pub(crate) fn soft_coverage(&self, p: DVec2, side: f64) -> f64 {
        self.sum(p, side, Stroke::soft_coverage)
    }

    fn sum(&self, p: DVec2, side: f64, of: impl Fn(&Stroke, DVec2, f64) -> f64) -> f64 {
        let mut largest = 0.0f64;
        let mut sum = 0.0;
        for (low, high, stroke) in &self.items {
            let near = p + side;
            if near.cmpge(*low).all() && (p - side).cmple(*high).all() {
                let covered = of(stroke, p, side);
                sum += covered;
                largest = largest.max(covered);
            }
        }
        // strokes of one drawing mostly join, they rarely run side by side within a footprint
        if sum > 1.0 { 1.0 } else { largest.max(sum) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sampled(stroke: &Stroke, p: DVec2) -> f64 {
        const N: i32 = 64;
        let at = |i: i32| (f64::from(i) + 0.5) / f64::from(N) - 0.5;
        let inside =
            |i: &i32| stroke.distance(p + DVec2::new(at(i % N), at(i / N))) <= 0.5 * stroke.width;
        (0..N * N).filter(inside).count() as f64 / f64::from(N * N)
    }

    #[test]
    fn a_long_straight_stroke_covers_exactly() {
        let stroke = Stroke::straight(DVec2::new(-30.0, -11.0), DVec2::new(40.0, 23.0), 2.3);
        for i in 0..60 {
            let p = DVec2::new(0.37 * f64::from(i % 10), 0.41 * f64::from(i / 10));
            // the judge's own error: border length over samples a side
            assert!((stroke.coverage(p, 1.0) - sampled(&stroke, p)).abs() < 3.0 / 64.0);
        }
    }

    #[test]
    fn round_ends_and_arcs_are_within_the_stated_error() {
        let strokes = [
            Stroke::straight(DVec2::ZERO, DVec2::new(5.0, 1.0), 3.0),
            Stroke::arc(DVec2::new(2.0, 2.0), 6.0, 0.3, 2.9, 2.0),
        ];
        for stroke in &strokes {
            for i in 0..400 {
                let p = DVec2::new(0.7 * f64::from(i % 20) - 5.0, 0.7 * f64::from(i / 20) - 5.0);
                let error = (stroke.coverage(p, 1.0) - sampled(stroke, p)).abs();
                assert!(error < 0.11 + 2.0 / 64.0, "{p} {error}");
            }
        }
    }

    #[test]
    fn a_stroke_without_length_is_a_dot_and_one_without_points_is_nothing() {
        let dot = Stroke {
            points: vec![DVec2::new(3.0, 3.0)],
            width: 4.0,
        };
        assert_eq!(dot.coverage(DVec2::new(3.0, 3.0), 1.0), 1.0);
        assert_eq!(dot.coverage(DVec2::new(9.0, 3.0), 1.0), 0.0);
        let nothing = Stroke {
            points: vec![],
            width: 4.0,
        };
        assert_eq!(nothing.coverage(DVec2::ZERO, 1.0), 0.0);
    }
}

//! The way of a brush, and how far pixels are from it.

use super::stroke::Stroke;
use glam::DVec2;
use ravec_raster::Rect;

/// A polyline without superfluous points.
///
/// Repeated points, and points on the straight way between their neighbors, say nothing; without them the same way gives
/// the same bits however it was cut into events.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Path {
    points: Vec<DVec2>,
    radius: f64,
    /// Distance below which the effect is full.
    core: f64,
    /// Dabs along the way, for strokes that accumulate.
    dabs: Option<Vec<DVec2>>,
}

/// Largest distance from the straight segment at which a point is superfluous: above the rounding of positions of a
/// million pixels, far below anything visible.
const STRAIGHT_PX: f64 = 1e-7;

/// More than the rounding of distances.
const ROUNDING_PX: f64 = 1e-6;

/// The nearest point of a path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Nearest {
    pub point: DVec2,
    pub distance: f64,
    /// Number of the segment that it lies on; the first one of several.
    pub segment: usize,
}

/// The part of a path that can reach a rectangle.
#[derive(Debug, Clone)]
pub(crate) struct NearPath {
    segments: Vec<Segment>,
    radius: f64,
    core: f64,
    dabs: Option<Vec<DVec2>>,
}

/// A segment of a path; that of a single point has no length.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Segment {
    number: usize,
    ends: [DVec2; 2],
}

impl Segment {
    fn nearest(&self, p: DVec2) -> Nearest {
        let [a, b] = self.ends;
        let along = b - a;
        let length_sq = along.length_squared();
        let t = if length_sq > 0.0 {
            ((p - a).dot(along) / length_sq).clamp(0.0, 1.0)
        } else {
            0.0
        };
        let point = a + t * along;
        Nearest {
            point,
            distance: point.distance(p),
            segment: self.number,
        }
    }
}

impl Path {
    pub fn of(stroke: &Stroke) -> Self {
        let mut points: Vec<DVec2> = Vec::new();
        for &[x, y] in &stroke.points {
            let point = DVec2::new(x, y);
            if points
                .last()
                .is_some_and(|last| last.distance(point) <= STRAIGHT_PX)
            {
                continue;
            }
            while let [.., before, last] = points[..] {
                let along = (last - before).dot(point - last) >= 0.0;
                let segment = Segment {
                    number: 0,
                    ends: [before, point],
                };
                if !along || segment.nearest(last).distance > STRAIGHT_PX {
                    break;
                }
                points.pop();
            }
            points.push(point);
        }
        // at least one pixel of falloff, so that hard brushes have smooth rims
        let core = (stroke.hardness * stroke.radius_px)
            .min(stroke.radius_px - 1.0)
            .max(0.0);
        let dabs = stroke
            .accumulate
            .then(|| dabs(&points, stroke.spacing * stroke.radius_px));
        Self {
            points,
            radius: stroke.radius_px,
            core,
            dabs,
        }
    }

    /// The pixels within the radius of the path.
    pub fn bounds(&self) -> Rect {
        bounds_of(&self.points, self.radius)
    }

    /// The pixels within the radius of the last `segments` segments.
    pub fn bounds_of_end(&self, segments: usize) -> Rect {
        let first = self.points.len().saturating_sub(segments + 1);
        bounds_of(&self.points[first..], self.radius)
    }

    /// Number of the first segment that differs from those of an earlier state of the path.
    pub fn first_change(&self, before: &Self) -> usize {
        let pairs = self.points.iter().zip(&before.points);
        let shared = pairs.take_while(|(now, before)| now == before).count();
        shared.saturating_sub(1)
    }

    /// True if the path goes on from the end of an earlier state, all of whose segments it has.
    pub fn continues(&self, before: &Self) -> bool {
        self.points.starts_with(&before.points)
    }

    /// True if the effect at a pixel is that of its nearest segment alone.
    pub fn is_by_distance(&self) -> bool {
        self.dabs.is_none()
    }

    /// The part of the path that can reach a rectangle.
    pub fn near(&self, rect: Rect) -> NearPath {
        let (low, high) = corners(rect, self.radius);
        let reaches = |a: DVec2, b: DVec2| a.min(b).cmple(high).all() && a.max(b).cmpge(low).all();
        let segment = |(number, ends): (usize, &[DVec2])| Segment {
            number,
            ends: [ends[0], ends[1]],
        };
        let mut segments: Vec<Segment> = (self.points.windows(2).enumerate())
            .filter(|(_, ends)| reaches(ends[0], ends[1]))
            .map(segment)
            .collect();
        if let [point] = self.points[..] {
            segments.push(segment((0, &[point, point])));
        }
        let dabs = self.dabs.as_ref().map(|dabs| {
            let reached = |p: &DVec2| p.cmple(high).all() && p.cmpge(low).all();
            dabs.iter().copied().filter(reached).collect()
        });
        NearPath {
            segments,
            radius: self.radius,
            core: self.core,
            dabs,
        }
    }
}

impl NearPath {
    /// The segments that are nearest to some point of a rectangle, and the dabs that reach one.
    pub fn nearest_within(&self, rect: Rect) -> Self {
        let (middle, half_diagonal) = circle_around(rect);
        let distance = |segment: &Segment| segment.nearest(middle).distance;
        let least = self.segments.iter().map(distance).reduce(f64::min);
        // the nearest segment of a point is at most a half diagonal farther from the middle than from the point
        let limit = least.unwrap_or_default() + 2.0 * half_diagonal + ROUNDING_PX;
        let near = self.segments.iter();
        let reach = self.radius + half_diagonal;
        let dabs = self.dabs.as_ref().map(|dabs| {
            let reached = |dab: &DVec2| dab.distance(middle) <= reach;
            dabs.iter().copied().filter(reached).collect()
        });
        Self {
            segments: near.filter(|s| distance(s) <= limit).copied().collect(),
            dabs,
            ..*self
        }
    }

    /// The nearest point of the path; `None` if no part of it is near.
    pub fn nearest(&self, p: DVec2) -> Option<Nearest> {
        let (first, rest) = self.segments.split_first()?;
        let mut best = first.nearest(p);
        for segment in rest {
            let found = segment.nearest(p);
            if found.distance < best.distance {
                best = found;
            }
        }
        Some(best)
    }

    /// Returns `true` if the path comes within its radius of a rectangle.
    pub fn reaches(&self, rect: Rect) -> bool {
        let (middle, half_diagonal) = circle_around(rect);
        let nearest = self.nearest(middle);
        nearest.is_some_and(|nearest| nearest.distance - half_diagonal < self.radius)
    }

    /// The effect at a distance from the path, 0 to 1.
    pub fn profile(&self, distance: f64) -> f64 {
        if distance >= self.radius {
            return 0.0;
        }
        if distance <= self.core {
            return 1.0;
        }
        let t = (self.radius - distance) / (self.radius - self.core);
        t * t * (3.0 - 2.0 * t)
    }

    /// The effect at a pixel with the given distance to the path, for a given strength.
    pub fn effect(&self, p: DVec2, distance: f64, strength: f64) -> f64 {
        match &self.dabs {
            None => strength * self.profile(distance),
            Some(dabs) => {
                let left: f64 = dabs
                    .iter()
                    .map(|dab| 1.0 - strength * self.profile(dab.distance(p)))
                    .product();
                1.0 - left
            }
        }
    }
}

/// Middle and half diagonal of a rectangle of pixels.
fn circle_around(rect: Rect) -> (DVec2, f64) {
    let [width, height] = [rect.width, rect.height].map(|side| side as f64);
    let corner = DVec2::new(rect.col as f64, rect.row as f64);
    (
        corner + 0.5 * DVec2::new(width, height),
        0.5 * width.hypot(height),
    )
}

fn corners(rect: Rect, margin: f64) -> (DVec2, DVec2) {
    let low = DVec2::new(rect.col as f64, rect.row as f64) - margin;
    let high = DVec2::new(rect.right() as f64, rect.bottom() as f64) + margin;
    (low, high)
}

fn bounds_of(points: &[DVec2], radius: f64) -> Rect {
    let low = points
        .iter()
        .copied()
        .reduce(DVec2::min)
        .unwrap_or_default()
        - radius;
    let high = points
        .iter()
        .copied()
        .reduce(DVec2::max)
        .unwrap_or_default()
        + radius;
    // `as` saturates: what lies left of or above the picture becomes 0
    let (col, row) = (low.x.floor() as usize, low.y.floor() as usize);
    let (right, bottom) = (high.x.ceil() as usize, high.y.ceil() as usize);
    Rect::new(col, row, right - col, bottom - row)
}

/// Points at equal distances along the path, the first at its beginning.
fn dabs(points: &[DVec2], spacing: f64) -> Vec<DVec2> {
    let mut dabs = vec![points[0]];
    let mut left = spacing;
    for segment in points.windows(2) {
        let length = segment[0].distance(segment[1]);
        let mut at = left;
        while at <= length && dabs.len() < MAX_DABS {
            dabs.push(segment[0].lerp(segment[1], at / length));
            at += spacing;
        }
        left = at - length;
    }
    dabs
}

/// The most dabs of a stroke: a way of a million radii.
const MAX_DABS: usize = 4_000_000;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::brush::Tool;
    use proptest::prelude::*;

    fn path(points: Vec<[f64; 2]>) -> Path {
        Path::of(&Stroke::new(Tool::Dodge, points, 10.0))
    }

    #[test]
    fn the_profile_is_full_in_the_core_and_nothing_at_the_radius() {
        let path = path(vec![[0.0, 0.0]]).near(Rect::new(0, 0, 1, 1));
        assert_eq!(
            (path.profile(0.0), path.profile(5.0), path.profile(10.0)),
            (1.0, 1.0, 0.0)
        );
        assert!(path.profile(6.0) > path.profile(8.0));
    }

    #[test]
    fn the_part_near_a_rectangle_has_the_same_distances_there() {
        let whole = path(
            (0..60)
                .map(|i| [f64::from(i) * 7.0, 40.0 * (f64::from(i) * 0.7).sin()])
                .collect(),
        );
        let rect = Rect::new(100, 0, 60, 30);
        let all = whole.near(Rect::new(0, 0, 1000, 1000));
        let near = whole.near(rect);
        for p in [
            DVec2::new(101.0, 2.0),
            DVec2::new(130.0, 15.0),
            DVec2::new(159.0, 29.0),
        ] {
            if all.nearest(p).unwrap().distance < 10.0 {
                assert_eq!(near.nearest(p), all.nearest(p));
            }
        }
        let all = whole.near(Rect::new(0, 0, 1000, 1000));
        for (col, row) in [(96, 8), (128, 16), (152, 0)] {
            let block = Rect::new(col, row, 8, 8);
            let near = all.nearest_within(block);
            for (x, y) in (0..8).flat_map(|y| (0..8).map(move |x| (col + x, row + y))) {
                let p = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
                assert_eq!(near.nearest(p), all.nearest(p));
            }
        }
    }

    #[test]
    fn segments_before_the_last_corner_that_stays_are_the_same() {
        let bent = path(vec![[0.0, 0.0], [10.0, 0.0], [20.0, 5.0], [30.0, 5.0]]);
        let longer = path(vec![
            [0.0, 0.0],
            [10.0, 0.0],
            [20.0, 5.0],
            [30.0, 5.0],
            [40.0, 5.0],
            [40.0, 9.0],
        ]);
        // the end of the third segment has moved on
        assert_eq!(longer.first_change(&bent), 2);
        assert!(!longer.continues(&bent) && longer.continues(&path(vec![[0.0, 0.0]])));
        assert_eq!(longer.first_change(&longer), 4);
        assert_eq!(bent.first_change(&path(vec![[0.0, 0.0]])), 0);
        assert_eq!(bent.first_change(&path(vec![[1.0, 0.0]])), 0);
    }

    proptest! {
        #[test]
        fn points_on_the_way_change_nothing(
            corners in prop::collection::vec((0.0f64..500.0, 0.0f64..500.0), 1..8),
            cuts in prop::collection::vec(0.01f64..0.99, 0..6),
        ) {
            let plain: Vec<[f64; 2]> = corners.iter().map(|&(x, y)| [x, y]).collect();
            let mut cut = vec![plain[0]];
            let mut cuts_sorted = cuts;
            cuts_sorted.sort_by(f64::total_cmp);
            for pair in plain.windows(2) {
                for t in &cuts_sorted {
                    cut.push([pair[0][0] + t * (pair[1][0] - pair[0][0]), pair[0][1] + t * (pair[1][1] - pair[0][1])]);
                }
                cut.push(pair[1]);
                cut.push(pair[1]);
            }
            prop_assert_eq!(path(cut), path(plain));
        }
    }
}

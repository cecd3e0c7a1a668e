//! Smooth motion across frames in which the plane is lost.
//!
//! Corners move along cubics from knot to knot: the last and the first frame in which the plane was found, and the frames that
//! were corrected by hand. At the ends the cubics go on as the plane moved there.
//!
//! Source: the Hermite cubic; slopes at inner knots are those of the parabola through three knots. Long gaps trust the speed at
//! their ends less, since hands and cars change theirs.
//!
//! The variance in the middle of a gap of n frames is that of a path whose acceleration is noise of deviation a: a² n³ / 192. A
//! random walk from both ends has the variance q n / 4 there, so that its steps have the variance q = a² n² / 48.

use crate::track::offsets::Vector;

/// Frames over which a speed lasts. In longer gaps the speed at the ends counts less: with more, a speed that is off by a pixel
/// a frame bends the path by more than two pixels; with less, a turn inside the gap becomes a straight line.
const SPEED_FRAMES: f64 = 16.0;

/// Frames apart of the three from which the speed at an end is taken, at most. Neighbors alone would double its noise.
const STRIDE: usize = 3;

/// A place that the path goes through.
#[derive(Debug, Clone)]
pub(super) struct Knot {
    pub at: usize,
    pub corners: Vector,
    /// Motion per frame, where it is known.
    pub speed: Option<Vector>,
}

/// The speed at the end of a run of places, `place(0)` last and `place(k)` k frames before, of which there are `count`; for
/// places in the order of time. Exact for parabolas.
pub(super) fn end_speed(count: usize, place: impl Fn(usize) -> Vector) -> Option<Vector> {
    let stride = (count.saturating_sub(1) / 2).min(STRIDE);
    match (stride, count) {
        (0, 2) => Some(place(0) - place(1)),
        (0, _) => None,
        _ => {
            let h = stride as f64;
            Some((place(0) * 3.0 - place(stride) * 4.0 + place(2 * stride)) / (2.0 * h))
        }
    }
}

/// Places of the frames strictly between the first and the last knot, with those of the inner knots.
pub(super) fn bridge(knots: &[Knot]) -> Vec<(usize, Vector)> {
    let gaps: Vec<(f64, Vector)> = knots
        .windows(2)
        .map(|pair| {
            let frames = (pair[1].at - pair[0].at) as f64;
            (frames, (pair[1].corners - pair[0].corners) / frames)
        })
        .collect();
    let damped = |speed: Option<Vector>, (frames, mean): (f64, Vector)| {
        speed.map_or(mean, |speed| {
            mean + (speed - mean) * (SPEED_FRAMES / frames).min(1.0)
        })
    };
    let slope = |index: usize| {
        if index == 0 {
            damped(knots[0].speed, gaps[0])
        } else if index == gaps.len() {
            damped(knots[index].speed, gaps[index - 1])
        } else {
            let ((before, left), (after, right)) = (gaps[index - 1], gaps[index]);
            (right * before + left * after) / (before + after)
        }
    };
    let mut path = Vec::new();
    for (index, pair) in knots.windows(2).enumerate() {
        let (frames, mean) = gaps[index];
        let (from, to) = (slope(index) - mean, slope(index + 1) - mean);
        for at in pair[0].at + 1..=pair[1].at {
            let t = (at - pair[0].at) as f64 / frames;
            let straight = pair[0].corners * (1.0 - t) + pair[1].corners * t;
            let bend = from * (t * (1.0 - t) * (1.0 - t)) - to * (t * t * (1.0 - t));
            path.push((at, straight + bend * frames));
        }
    }
    path.pop();
    path
}

/// The variance of a step of the random walk across a gap of `frames`, for accelerations of deviation `acceleration`.
pub(super) fn step_variance(acceleration: f64, frames: usize) -> f64 {
    (acceleration * frames as f64).powi(2) / 48.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parabola(at: usize) -> Vector {
        let t = at as f64;
        Vector::from_fn(|k, _| 3.0 * k as f64 + t * (1.0 + 0.2 * k as f64) + 0.05 * t * t)
    }

    #[test]
    fn parabolas_are_bridged_exactly() {
        let backward = |k| parabola(20 + k);
        let knots = [
            Knot {
                at: 8,
                corners: parabola(8),
                speed: end_speed(9, |k| parabola(8 - k)),
            },
            Knot {
                at: 13,
                corners: parabola(13),
                speed: None,
            },
            Knot {
                at: 20,
                corners: parabola(20),
                speed: end_speed(9, backward).map(|v| -v),
            },
        ];
        let path = bridge(&knots);
        assert_eq!(
            path.iter().map(|p| p.0).collect::<Vec<_>>(),
            (9..20).collect::<Vec<_>>()
        );
        for (at, place) in path {
            assert!((place - parabola(at)).norm() < 1e-9, "{at}");
        }
    }

    #[test]
    fn speeds_need_two_places_and_use_what_there_is() {
        assert_eq!(end_speed(0, parabola), None);
        assert_eq!(end_speed(1, parabola), None);
        for count in 2..9 {
            // backward in time from 30
            let speed = end_speed(count, |k| parabola(30 - k)).unwrap();
            let truth = Vector::from_fn(|k, _| 1.0 + 0.2 * k as f64 + 0.1 * 30.0);
            // two places know the speed half a frame ago
            let expected = if count == 2 { 0.05 * 8f64.sqrt() } else { 0.0 };
            assert!(((speed - truth).norm() - expected).abs() < 1e-9, "{count}");
        }
    }

    #[test]
    fn a_straight_line_stays_one_with_wrong_speeds_far_away_damped() {
        let line = |at: usize| Vector::repeat(2.0 * at as f64);
        let knots = |frames: usize| {
            let knot = |at| Knot {
                at,
                corners: line(at),
                speed: Some(Vector::repeat(3.0)),
            };
            [knot(0), knot(frames)]
        };
        let bend = |frames: usize| {
            bridge(&knots(frames))
                .iter()
                .map(|(at, place)| (place - line(*at)).amax())
                .fold(0.0, f64::max)
        };
        // both ends a pixel a frame too fast: n √3 / 18 at worst
        assert!((bend(16) - 1.54).abs() < 0.02 && bend(160) < 1.55);
    }

    #[test]
    fn the_variance_in_the_middle_is_that_of_random_acceleration() {
        // a path with fixed ends and ends' speeds whose acceleration is noise: the inverse of the matrix of second differences
        const FRAMES: usize = 96;
        let mut matrix = nalgebra::DMatrix::<f64>::zeros(FRAMES - 1, FRAMES - 1);
        for center in 0..=FRAMES {
            let taps = [
                (center as isize - 1, 1.0),
                (center as isize, -2.0),
                (center as isize + 1, 1.0),
            ];
            // beyond the ends the path goes on as it is known to
            let known = |at: isize| !(1..FRAMES as isize).contains(&at);
            for &(i, a) in taps.iter().filter(|tap| !known(tap.0)) {
                for &(j, b) in taps.iter().filter(|tap| !known(tap.0)) {
                    matrix[(i as usize - 1, j as usize - 1)] += a * b;
                }
            }
        }
        let covariance = matrix.try_inverse().unwrap();
        let middle = covariance[(FRAMES / 2 - 1, FRAMES / 2 - 1)];
        let walk = step_variance(1.0, FRAMES) * FRAMES as f64 / 4.0;
        assert!((walk / middle - 1.0).abs() < 0.05, "{walk} {middle}");
    }
}

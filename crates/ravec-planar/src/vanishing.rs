//! Vanishing points: where lines that are parallel in the world meet in the picture.
//!
//! ```text
//! while many segments are left:
//!     try where pairs of the longest ones meet; keep the point that most segments aim at, counted by length
//!     move it to where they aim best, by least squares
//!     take those segments away
//! ```
//!
//! Points are homogeneous, so that lines which are parallel in the picture as well meet in (dx, dy, 0). A segment aims at a
//! point if turning it about its middle to do so moves its ends by a fraction of a pixel.
//!
//! Source: Rother, "A new approach to vanishing point detection in architectural environments", 2002, whose votes these are;
//! weights that end smoothly as in MAGSAC++.
//!
//! Guarantees: equal segments give equal bytes. Does not guarantee: that lines which meet are parallel in the world.
//! Cost: a few thousand pairs times the segments.

use glam::{DMat3, DVec2, DVec3};
use ravec_numeric::smallest_eigenvector;
use ravec_progress::{Cancelled, Progress};
use ravec_raster::Segment;
use rayon::prelude::*;

/// Point in which many segments meet.
#[derive(Debug, Clone, PartialEq)]
pub struct VanishingPoint {
    /// The point (x, y, w): at (x / w, y / w) in pixels, x right, y down, pixel centers at half-integers; (x, y, 0) for the
    /// far end of a direction. Of length 1.
    pub at: DVec3,
    /// The numbers of the segments that aim at it, rising. No segment aims at two points.
    pub segments: Vec<usize>,
    /// Their length together, in pixels.
    pub length_px: f64,
}

/// Number of the longest segments of which pairs are made: a direction that has none of them is not worth a plane.
const LONGEST: usize = 72;

/// Points at most: three directions of a building, a second building, a roof.
const MAX_POINTS: usize = 6;

/// The least share of all segments' length that a point needs, and the fewest segments. Smaller finds points by chance.
const MIN_SHARE: f64 = 0.06;
const MIN_SEGMENTS: usize = 5;

/// Standard deviation of the end of a segment, in pixels, and of its direction, in radians (lenses bend lines). Smaller
/// loses real lines, larger gathers others.
const SIGMA_PX: f64 = 0.5;
const SIGMA_RAD: f64 = 3e-3;

/// Standard deviations from which a segment aims elsewhere.
const REACH: f64 = 3.0;

/// Nearer than this, as an angle in the middle of the picture's half diagonal, two points are one that was not quite met.
const MIN_ANGLE: f64 = 0.03;

/// Rounds of least squares.
const ROUNDS: usize = 8;

/// A segment in units of half the picture's diagonal around its middle.
struct Aim {
    middle: DVec2,
    direction: DVec2,
    /// The line as a homogeneous vector with a normal of length 1.
    line: DVec3,
    half: f64,
    /// One standard deviation of an end, across.
    sigma: f64,
    length: f64,
}

impl Aim {
    /// Weight with which the segment aims at a point, 0 to 1, and the factor that makes of `line · at` standard
    /// deviations.
    fn weight(&self, at: DVec3) -> (f64, f64) {
        let towards = at.truncate() - at.z * self.middle;
        let distance = towards.length();
        // a point on the segment itself is not a vanishing point of it
        if distance <= 1.2 * self.half * at.z.abs() {
            return (0.0, 0.0);
        }
        let scale = self.half / (distance * self.sigma);
        let off = self.direction.perp_dot(towards) * scale / REACH;
        ((1.0 - off * off).max(0.0).powi(2), scale)
    }
}

/// The vanishing points of segments in a picture of `picture` width and height, those of most length first.
///
/// Segments whose coordinates are not finite, or that are shorter than a pixel, aim nowhere.
///
/// # Errors
/// [`Cancelled`] soon after `progress` is cancelled.
pub fn vanishing_points(
    segments: &[Segment],
    picture: DVec2,
    progress: &Progress,
) -> Result<Vec<VanishingPoint>, Cancelled> {
    let (origin, unit) = (0.5 * picture, 0.5 * picture.length());
    let aims: Vec<Option<Aim>> = segments
        .iter()
        .map(|segment| {
            let [a, b] = segment.ends.map(|end| (end - origin) / unit);
            let length = segment.length_px();
            let direction = (b - a).try_normalize()?;
            (length >= 1.0 && length.is_finite()).then(|| {
                let (half, middle) = (0.5 * length / unit, 0.5 * (a + b));
                let normal = direction.perp();
                Aim {
                    middle,
                    direction,
                    line: normal.extend(-normal.dot(middle)),
                    half,
                    sigma: (SIGMA_PX / unit).hypot(half * SIGMA_RAD),
                    length,
                }
            })
        })
        .collect();
    let total: f64 = aims.iter().flatten().map(|aim| aim.length).sum();
    let mut left: Vec<usize> = (0..aims.len()).filter(|&k| aims[k].is_some()).collect();
    left.sort_by(|&a, &b| {
        length_of(aims[b].as_ref())
            .total_cmp(&length_of(aims[a].as_ref()))
            .then(a.cmp(&b))
    });
    let mut found: Vec<VanishingPoint> = Vec::new();
    let phase = progress.phase("vanishing points", MAX_POINTS as u64);
    for _ in 0..MAX_POINTS {
        progress.check()?;
        let free: Vec<&Aim> = left.iter().filter_map(|&k| aims[k].as_ref()).collect();
        let Some(at) = best_point(&free) else { break };
        let at = refined(&free, at);
        let aiming: Vec<usize> = left
            .iter()
            .copied()
            .filter(|&k| aims[k].as_ref().is_some_and(|aim| aim.weight(at).0 > 0.0))
            .collect();
        let length: f64 = aiming.iter().map(|&k| length_of(aims[k].as_ref())).sum();
        if aiming.len() < MIN_SEGMENTS || length < MIN_SHARE * total {
            break;
        }
        left.retain(|k| !aiming.contains(k));
        // back to pixels
        let at_px = DVec3::new(
            at.x * unit + at.z * origin.x,
            at.y * unit + at.z * origin.y,
            at.z,
        );
        let same = |other: &VanishingPoint| {
            let other = (other.at.truncate() - other.at.z * origin).extend(other.at.z * unit);
            other.normalize().cross(at).length() < MIN_ANGLE
        };
        // the segments of a point that was found before and did not take them all belong to nobody
        if !found.iter().any(same) {
            let mut segments = aiming;
            segments.sort_unstable();
            found.push(VanishingPoint {
                at: at_px.normalize(),
                segments,
                length_px: length,
            });
        }
        phase.advance(1);
    }
    found.sort_by(|a, b| b.length_px.total_cmp(&a.length_px));
    Ok(found)
}

fn length_of(aim: Option<&Aim>) -> f64 {
    aim.map_or(0.0, |aim| aim.length)
}

/// The point in which two of the longest segments meet and at which most length aims.
fn best_point(aims: &[&Aim]) -> Option<DVec3> {
    let longest = aims.len().min(LONGEST);
    let score = |at: DVec3| -> f64 { aims.iter().map(|aim| aim.length * aim.weight(at).0).sum() };
    let best_of = |first: usize| {
        (first + 1..longest)
            .filter_map(|second| aims[first].line.cross(aims[second].line).try_normalize())
            .map(|at| (score(at), at))
            .fold((0.0, DVec3::ZERO), |best, found| {
                if found.0 > best.0 { found } else { best }
            })
    };
    let bests: Vec<(f64, DVec3)> = (0..longest).into_par_iter().map(best_of).collect();
    let best = bests.into_iter().fold((0.0, DVec3::ZERO), |best, found| {
        if found.0 > best.0 { found } else { best }
    });
    (best.0 > 0.0).then_some(best.1)
}

/// The point at which the segments aim best that aim at it now.
fn refined(aims: &[&Aim], mut at: DVec3) -> DVec3 {
    for _ in 0..ROUNDS {
        let mut sum = DMat3::ZERO;
        for aim in aims {
            let (weight, scale) = aim.weight(at);
            let line = aim.line * (weight * scale * scale * aim.length);
            sum += DMat3::from_cols(line * aim.line.x, line * aim.line.y, line * aim.line.z);
        }
        let Some(found) = smallest_eigenvector(&sum.to_cols_array_2d()) else {
            break;
        };
        at = DVec3::from_array(found.vector);
    }
    at
}

/// The focal length in pixels for which the most pairs of points are the pictures of directions at right angles, if the axis of
/// the lens goes through the middle of the picture. None if no pair says anything: right angles need two points at a finite
/// distance, on opposite sides.
pub fn focal_from_right_angles(points: &[VanishingPoint], picture: DVec2) -> Option<f64> {
    let mut best: Option<(f64, f64)> = None;
    for (index, a) in points.iter().enumerate() {
        for b in &points[index + 1..] {
            let [p, q] = [a, b].map(|v| (v.at.truncate() - v.at.z * 0.5 * picture).extend(v.at.z));
            let square = -p.truncate().dot(q.truncate()) / (p.z * q.z);
            // lenses from a fisheye's to a moon shot's; points that are nearly at infinity give anything
            let range = (0.25 * picture.length()).powi(2)..(6.0 * picture.length()).powi(2);
            if !range.contains(&square) {
                continue;
            }
            let focal = square.sqrt();
            let score = right_angles(points, picture, focal);
            if best.is_none_or(|(most, _)| score > most) {
                best = Some((score, focal));
            }
        }
    }
    best.map(|(_, focal)| focal)
}

/// The length of the pairs that are at right angles, each pair's the smaller of both.
fn right_angles(points: &[VanishingPoint], picture: DVec2, focal_px: f64) -> f64 {
    let mut sum = 0.0;
    for (index, a) in points.iter().enumerate() {
        for b in &points[index + 1..] {
            if cosine(a, b, picture, focal_px) < 0.05 {
                sum += a.length_px.min(b.length_px);
            }
        }
    }
    sum
}

/// The absolute cosine between the directions of two points, 0 at right angles, for a focal length in pixels and an axis through
/// the middle of the picture.
pub(crate) fn cosine(a: &VanishingPoint, b: &VanishingPoint, picture: DVec2, focal_px: f64) -> f64 {
    let ray = |v: &VanishingPoint| {
        (v.at.truncate() - v.at.z * 0.5 * picture)
            .extend(v.at.z * focal_px)
            .normalize_or_zero()
    };
    ray(a).dot(ray(b)).abs()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::SplitMix;
    use glam::dvec2;

    const PICTURE: DVec2 = dvec2(1000.0, 800.0);

    /// Segments of 30 to 130 pixels that aim at a point, their ends off by up to 0.3 pixels.
    fn aiming(at: DVec3, count: usize, random: &mut SplitMix) -> Vec<Segment> {
        let mut unit = || random.below(1 << 20) as f64 / f64::from(1 << 20);
        (0..count)
            .map(|_| {
                let middle = PICTURE * dvec2(unit(), unit());
                let direction = (at.truncate() - at.z * middle).normalize();
                let half = 15.0 + 50.0 * unit();
                let ends = [-half, half]
                    .map(|along| middle + direction * along + 0.6 * (dvec2(unit(), unit()) - 0.5));
                Segment { ends }
            })
            .collect()
    }

    fn planted() -> ([DVec3; 3], Vec<Segment>) {
        // x, y, z through a camera of 900 pixels, turned by 0.6 and 0.2
        let turn = DMat3::from_rotation_x(0.2) * DMat3::from_rotation_y(0.6);
        let points = [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| {
            let seen = turn * axis;
            (900.0 * seen.truncate() + seen.z * 0.5 * PICTURE).extend(seen.z)
        });
        let mut random = SplitMix::new(5);
        let mut segments = Vec::new();
        for (at, count) in points.iter().zip([60, 50, 30]) {
            segments.extend(aiming(*at, count, &mut random));
        }
        // and 40 in all directions
        for _ in 0..40 {
            let at = DVec3::new(
                random.below(2000) as f64 - 500.0,
                random.below(2000) as f64 - 500.0,
                1.0,
            );
            segments.extend(aiming(at, 1, &mut random));
        }
        (points, segments)
    }

    #[test]
    fn planted_points_and_the_focal_length_are_found() {
        let (truth, segments) = planted();
        let found = vanishing_points(&segments, PICTURE, &Progress::none()).unwrap();
        assert!(found.len() >= 3);
        for truth in truth {
            let ray = |v: DVec3| {
                (v.truncate() - v.z * 0.5 * PICTURE)
                    .extend(v.z * 900.0)
                    .normalize()
            };
            let nearest = found
                .iter()
                .map(|point| ray(point.at).cross(ray(truth)).length())
                .fold(f64::INFINITY, f64::min);
            // 30 segments of 80 pixels with 0.2 pixels at each end: 0.0035 / √30 each, and some that aim by chance
            assert!(nearest < 0.004, "{nearest}");
        }
        let focal = focal_from_right_angles(&found, PICTURE).unwrap();
        assert!((focal / 900.0 - 1.0).abs() < 0.02, "{focal}");
    }

    #[test]
    fn parallel_lines_meet_at_infinity() {
        let mut random = SplitMix::new(8);
        let segments = aiming(DVec3::X, 30, &mut random);
        let found = vanishing_points(&segments, PICTURE, &Progress::none()).unwrap();
        assert_eq!(found.len(), 1);
        let far = found[0].at.truncate().length() / found[0].at.z.abs();
        assert!(far > 3e4 && found[0].segments.len() >= 28, "{far}");
        assert_eq!(focal_from_right_angles(&found, PICTURE), None);
    }

    #[test]
    fn few_odd_and_no_segments_have_no_vanishing_points() {
        let none = vanishing_points(&[], PICTURE, &Progress::none()).unwrap();
        assert!(none.is_empty());
        let odd = [
            [0.0, f64::NAN],
            [1.0, 1.0],
            [f64::INFINITY, 0.0],
            [1e300, -1e300],
        ];
        let odd: Vec<Segment> = odd
            .iter()
            .flat_map(|&[x, y]| {
                [Segment {
                    ends: [dvec2(x, y), DVec2::ZERO],
                }; 9]
            })
            .collect();
        let found = vanishing_points(&odd, PICTURE, &Progress::none()).unwrap();
        assert!(found.iter().all(|point| point.at.is_finite()));
        let progress = Progress::none();
        progress.cancel();
        assert_eq!(vanishing_points(&odd, PICTURE, &progress), Err(Cancelled));
    }
}

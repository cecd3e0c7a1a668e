//! Straight runs: the long straight lines of a picture.
//!
//! ```text
//! for each axis of the picture:
//!     find candidates by their contrast along whole strips
//!     follow each one, those with the strongest contrast first, unless it lies on a line that was followed
//! join those that lie on one line: something covers it in between
//! drop those that repeat a longer one
//! ```
//!
//! Single two-color pixels do not distinguish lines from texture that is as strong as they are, and a line narrower
//! than a block has two edges in it, of which the block shows one or the other. Strips of 64 pixels have neither
//! difficulty.
//!
//! Guarantees: the edge of a run is within [`MAX_AWAY_PX`] of it where it was found, or the ends of what was joined are. Does not
//! guarantee: that a long line is one run; where more of it is covered than to be seen on either side, there are two.

use crate::strips::{Frame, STRIP};
use crate::trace::trace;
use glam::DVec2;
use ravec_raster::{Image, LinearRgb, Oklab};

/// A straight line of the picture, in pixels of the analyzed reduction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Run {
    pub(crate) ends: [DVec2; 2],
}

impl Run {
    pub(crate) fn length(&self) -> f64 {
        self.ends[0].distance(self.ends[1])
    }

    /// The distance of a point.
    fn distance(&self, point: DVec2) -> f64 {
        let along = (point - self.ends[0])
            .dot(self.direction())
            .clamp(0.0, self.length());
        point.distance(self.ends[0] + along * self.direction())
    }

    pub(crate) fn direction(&self) -> DVec2 {
        (self.ends[1] - self.ends[0]).normalize_or_zero()
    }
}

/// Largest distance of the ends of joined chains from their common line.
const MAX_AWAY_PX: f64 = 1.0;

/// A run that lies within this distance of a longer one repeats it: the other side of the same stroke.
const REPEATED_PX: f64 = 3.5;

/// So far it may go on beyond the longer one.
const REPEATED_BEYOND_PX: f64 = 28.0;

/// Largest number of runs that are kept, those with the most contrast along the most length. Each couples two unknowns
/// with all cells along it; photos of buildings have hundreds.
pub(crate) const MAX_RUNS: usize = 96;

/// A candidate that lies within this distance of a run is the same line.
const KNOWN_PX: f64 = 4.0;

/// Largest number of candidates that are followed along each axis. Photos have some hundreds, pictures of fine print
/// more.
const MAX_CANDIDATES: usize = 1000;

/// Largest number of chains that are considered for joining.
const MAX_CHAINS: usize = 4 * MAX_RUNS;

/// The runs of a picture, the strongest first.
pub(crate) fn straight_runs(image: &Image<LinearRgb>) -> Vec<Run> {
    let lab = image.convert::<Oklab>();
    let (mut found, upright) = rayon::join(|| chains(&lab, false), || chains(&lab, true));
    found.extend(upright);
    let by_strength = |a: &Chain, b: &Chain| b.strength().total_cmp(&a.strength());
    found.sort_by(by_strength);
    found.truncate(MAX_CHAINS);
    join(&mut found);
    found.sort_by(by_strength);
    let mut kept: Vec<Run> = Vec::new();
    for Chain { run, .. } in found {
        if kept.len() < MAX_RUNS && !kept.iter().any(|longer| repeats(&run, longer)) {
            kept.push(run);
        }
    }
    kept
}

/// The chains that are nearer to y if `upright`, or to x.
fn chains(lab: &Image<Oklab>, upright: bool) -> Vec<Chain> {
    let frame = Frame::new(lab, upright);
    let mut candidates = frame.candidates();
    // stable, so that ties keep the order of the strips
    candidates.sort_by(|a, b| b.contrast().total_cmp(&a.contrast()));
    candidates.truncate(MAX_CANDIDATES);
    let mut found: Vec<Chain> = Vec::new();
    for candidate in candidates {
        let quarters = [0.25, 0.75].map(|share| frame.point_on(&candidate, share * STRIP as f64));
        let known = |chain: &Chain| quarters.iter().all(|&at| chain.run.distance(at) < KNOWN_PX);
        if !found.iter().any(known) {
            found.extend(trace(&frame, &candidate));
        }
    }
    found
}

/// A run with what it was made from.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Chain {
    pub(crate) run: Run,
    pub(crate) fit: LineFit,
    /// Change of color across it, from left to right as seen along the run.
    pub(crate) step: [f32; 3],
}

impl Chain {
    fn contrast(&self) -> f32 {
        self.step.iter().map(|v| v * v).sum::<f32>().sqrt()
    }

    fn strength(&self) -> f64 {
        f64::from(self.contrast()) * self.run.length()
    }

    /// Both as one, if they lie on one line, have like colors on like sides, and what is between them is not longer than
    /// the longer.
    fn joined(&self, other: &Self) -> Option<Self> {
        let same_way = if self.run.direction().dot(other.run.direction()) < 0.0 {
            -1.0
        } else {
            1.0
        };
        let dot: f32 = self.step.iter().zip(other.step).map(|(a, b)| a * b).sum();
        if same_way * dot <= 0.5 * self.contrast().min(other.contrast()).powi(2) {
            return None;
        }
        let mut fit = self.fit;
        fit.join(&other.fit);
        let (center, mut direction) = fit.line();
        if direction.dot(self.run.direction()) < 0.0 {
            direction = -direction;
        }
        let ends = [self.run.ends, other.run.ends];
        let away = |end: DVec2| (end - center).perp_dot(direction).abs();
        if ends.iter().flatten().any(|&end| away(end) > MAX_AWAY_PX) {
            return None;
        }
        let [[a, b], [c, d]] = ends.map(|ends| {
            let [from, to] = ends.map(|end| (end - center).dot(direction));
            [from.min(to), from.max(to)]
        });
        let gap = a.max(c) - b.min(d);
        (gap <= (b - a).max(d - c)).then(|| Self {
            run: Run {
                ends: [a.min(c), b.max(d)].map(|t| center + t * direction),
            },
            fit,
            step: [0, 1, 2].map(|k| 0.5 * (self.step[k] + same_way * other.step[k])),
        })
    }
}

/// Joins chains on one line until no two are left that can be.
fn join(chains: &mut Vec<Chain>) {
    let mut first = 0;
    while first < chains.len() {
        let found = (first + 1..chains.len())
            .find_map(|k| chains[first].joined(&chains[k]).map(|chain| (k, chain)));
        match found {
            Some((k, chain)) => {
                chains[first] = chain;
                chains.remove(k);
            }
            None => first += 1,
        }
    }
}

/// The line through pieces of lines, by least squares over all their points.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct LineFit {
    length: f64,
    sum: DVec2,
    squares: [f64; 3],
}

impl LineFit {
    /// Adds a piece of a line by its middle `m` and its half `h`.
    pub(crate) fn add(&mut self, m: DVec2, h: DVec2) {
        let length = 2.0 * h.length();
        self.length += length;
        self.sum += length * m;
        // the mean square along a segment is that of its middle plus a third of its half length
        self.squares[0] += length * (m.x * m.x + h.x * h.x / 3.0);
        self.squares[1] += length * (m.x * m.y + h.x * h.y / 3.0);
        self.squares[2] += length * (m.y * m.y + h.y * h.y / 3.0);
    }

    fn join(&mut self, other: &Self) {
        self.length += other.length;
        self.sum += other.sum;
        for (sum, value) in self.squares.iter_mut().zip(other.squares) {
            *sum += value;
        }
    }

    /// A point and the direction.
    fn line(&self) -> (DVec2, DVec2) {
        let center = self.sum / self.length;
        let xx = self.squares[0] / self.length - center.x * center.x;
        let xy = self.squares[1] / self.length - center.x * center.y;
        let yy = self.squares[2] / self.length - center.y * center.y;
        (center, DVec2::from_angle(0.5 * (2.0 * xy).atan2(xx - yy)))
    }
}

/// Returns `true` if a run lies along a longer one.
pub(crate) fn repeats(run: &Run, longer: &Run) -> bool {
    let direction = longer.direction();
    run.ends.iter().all(|&end| {
        let from = end - longer.ends[0];
        let along = from.dot(direction);
        from.perp_dot(direction).abs() < REPEATED_PX
            && along > -REPEATED_BEYOND_PX
            && along < longer.length() + REPEATED_BEYOND_PX
    })
}

#[cfg(test)]
mod tests;

//! Straight runs: chains of two-color lines that lie on one long line of the picture.
//!
//! ```text
//! for each line, those with the strongest contrast first:
//!     walk along it both ways, a small step at a time
//!     whatever block is met whose line continues the run joins it, and the run is fitted anew
//!     the walk ends where nothing has joined for some steps
//! keep the runs that are long and straight
//! join those that lie on one line: something covers it in between
//! drop those that repeat a longer one
//! ```
//!
//! A line continues a run if it lies within a pixel of it, at nearly its angle, with the same colour on the same side.
//!
//! Guarantees: the middles of the lines of a run are within [`MAX_AWAY_PX`] of it, or the ends of what was joined. Does not
//! guarantee: that a long line is one run; where more of it is covered than to be seen on either side, there are two.

use glam::{DVec2, dvec2};
use ravec_raster::{Rect, Size};
use ravec_twocolor::TwoColorField;

/// A straight line of the picture, in pixels of the analysed reduction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Run {
    pub(crate) ends: [DVec2; 2],
}

impl Run {
    pub(crate) fn length(&self) -> f64 {
        self.ends[0].distance(self.ends[1])
    }

    pub(crate) fn direction(&self) -> DVec2 {
        (self.ends[1] - self.ends[0]).normalize_or_zero()
    }
}

/// The angle between a line and the run that it continues, at most. Larger follows curves, smaller loses noisy lines.
const MAX_TURN_RAD: f64 = 0.14;

/// How far the middle of a line may lie from the run.
const MAX_AWAY_PX: f64 = 1.0;

/// How far the walk goes on without a line that continues the run.
const MAX_GAP_PX: f64 = 28.0;

/// A step of the walk: no block of 8 pixels is missed.
const STEP_PX: f64 = 4.0;

/// The least length of a run. Shorter ones are found on curves.
const MIN_LENGTH_PX: f64 = 60.0;

/// The share of a run's length that its lines must cover.
const MIN_COVERED: f64 = 0.6;

/// A run that lies within this distance of a longer one repeats it: the other side of the same stroke.
const REPEATED_PX: f64 = 3.5;

/// The Oklab contrast from which on a line counts. Fainter ones are noise and texture.
const MIN_CONTRAST: f32 = 0.04;

/// How many runs are kept, those with the most contrast along the most length. Each couples two unknowns with all cells along
/// it; photos of buildings have hundreds.
const MAX_RUNS: usize = 96;

/// How many chains are looked at for joining.
const MAX_CHAINS: usize = 4 * MAX_RUNS;

/// A line within its block.
#[derive(Debug, Clone, Copy)]
struct Segment {
    middle: DVec2,
    half: DVec2,
    normal: DVec2,
    /// The colour of side 1 minus that of side 0.
    step: [f32; 3],
    contrast: f32,
}

/// The runs of a field, the strongest first.
pub(crate) fn straight_runs(field: &TwoColorField) -> Vec<Run> {
    let blocks = field.grid_size();
    let segments: Vec<Option<Segment>> = (0..blocks.pixels())
        .map(|k| segment(field, k % blocks.width(), k / blocks.width()))
        .collect();
    let mut seeds: Vec<usize> = (0..segments.len())
        .filter(|&k| segments[k].is_some())
        .collect();
    let strength = |k: usize| segments[k].map_or(0.0, |s| f64::from(s.contrast) * s.half.length());
    // stable, so that ties keep the order of the blocks
    seeds.sort_by(|&a, &b| strength(b).total_cmp(&strength(a)));
    let mut walk = Walk {
        blocks,
        block_px: field.block_px() as f64,
        segments: &segments,
        taken: vec![false; segments.len()],
    };
    let mut found: Vec<Chain> = Vec::new();
    for seed in seeds {
        if !walk.taken[seed] {
            found.extend(walk.from(seed));
        }
    }
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

/// A run with what it was made from.
#[derive(Debug, Clone, Copy)]
struct Chain {
    run: Run,
    fit: LineFit,
    /// How colours change across it, from left to right as seen along the run.
    step: [f32; 3],
}

impl Chain {
    fn contrast(&self) -> f32 {
        self.step.iter().map(|v| v * v).sum::<f32>().sqrt()
    }

    fn strength(&self) -> f64 {
        f64::from(self.contrast()) * self.run.length()
    }

    /// Both as one, if they lie on one line, have like colours on like sides, and what is between them is not longer than
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

/// The part of a block's line that lies within the block.
fn segment(field: &TwoColorField, col: usize, row: usize) -> Option<Segment> {
    let pixel = field.block(col, row);
    let line = pixel.line?;
    if pixel.contrast() < MIN_CONTRAST {
        return None;
    }
    let side = field.block_px();
    let corner = dvec2((col * side) as f64, (row * side) as f64);
    let center = corner + 0.5 * side as f64;
    let rect = Rect::new(col * side, row * side, side, side).clipped(field.image_size());
    let (low, high) = (
        dvec2(rect.col as f64, rect.row as f64) - center,
        dvec2(rect.right() as f64, rect.bottom() as f64) - center,
    );
    let (from, along) = (line.normal * line.offset_px, line.normal.perp());
    let (mut first, mut last) = (f64::NEG_INFINITY, f64::INFINITY);
    for axis in 0..2 {
        if along[axis].abs() < 1e-12 {
            if !(low[axis]..=high[axis]).contains(&from[axis]) {
                return None;
            }
            continue;
        }
        let (a, b) = (
            (low[axis] - from[axis]) / along[axis],
            (high[axis] - from[axis]) / along[axis],
        );
        first = first.max(a.min(b));
        last = last.min(a.max(b));
    }
    // a corner that is cut off tells no direction
    (last - first > 2.0).then(|| Segment {
        middle: center + from + along * (0.5 * (first + last)),
        half: along * (0.5 * (last - first)),
        normal: line.normal,
        step: [0, 1, 2].map(|c| pixel.colors[1].0[c] - pixel.colors[0].0[c]),
        contrast: pixel.contrast(),
    })
}

/// The line through the lines that have joined, by least squares over all their points.
#[derive(Debug, Clone, Copy, Default)]
struct LineFit {
    length: f64,
    sum: DVec2,
    squares: [f64; 3],
}

impl LineFit {
    fn add(&mut self, segment: &Segment) {
        let (m, h) = (segment.middle, segment.half);
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

struct Walk<'a> {
    blocks: Size,
    block_px: f64,
    segments: &'a [Option<Segment>],
    taken: Vec<bool>,
}

impl Walk<'_> {
    /// The run through a seed. Its lines are taken, also where it is too short.
    fn from(&mut self, seed: usize) -> Option<Chain> {
        let first = self.segments[seed]?;
        let mut fit = LineFit::default();
        fit.add(&first);
        self.taken[seed] = true;
        let mut members = vec![seed];
        for sign in [1.0, -1.0] {
            let start = fit.line().1;
            let heading = if start.dot(first.half) < 0.0 {
                -start
            } else {
                start
            } * sign;
            self.follow(&first, heading, &mut fit, &mut members);
        }
        let (center, direction) = fit.line();
        let inside: Vec<Segment> = members
            .iter()
            .filter_map(|&k| self.segments[k])
            .filter(|s| (s.middle - center).perp_dot(direction).abs() <= MAX_AWAY_PX)
            .collect();
        let mut ends = [f64::INFINITY, f64::NEG_INFINITY];
        let mut step = [0.0f32; 3];
        for s in &inside {
            let (at, half) = (
                (s.middle - center).dot(direction),
                s.half.dot(direction).abs(),
            );
            ends = [ends[0].min(at - half), ends[1].max(at + half)];
            let sign = if s.normal.dot(direction.perp()) < 0.0 {
                -1.0
            } else {
                1.0
            };
            for (sum, value) in step.iter_mut().zip(s.step) {
                *sum += sign * value / inside.len() as f32;
            }
        }
        let length = ends[1] - ends[0];
        let covered: f64 = inside.iter().map(|s| 2.0 * s.half.length()).sum();
        (length >= MIN_LENGTH_PX && covered >= MIN_COVERED * length).then(|| Chain {
            run: Run {
                ends: ends.map(|t| center + t * direction),
            },
            fit,
            step,
        })
    }

    fn follow(
        &mut self,
        seed: &Segment,
        heading: DVec2,
        fit: &mut LineFit,
        members: &mut Vec<usize>,
    ) {
        let mut at = seed.middle.dot(heading);
        let mut gap = 0.0;
        while gap <= MAX_GAP_PX {
            at += STEP_PX;
            gap += STEP_PX;
            let (center, mut direction) = fit.line();
            if direction.dot(heading) < 0.0 {
                direction = -direction;
            }
            // the point of the line at which the walk stands
            let here = center + direction * ((at - center.dot(heading)) / direction.dot(heading));
            let Some(next) = self.best_near(here, center, direction, seed) else {
                continue;
            };
            self.taken[next] = true;
            members.push(next);
            if let Some(joined) = self.segments[next] {
                fit.add(&joined);
            }
            gap = 0.0;
        }
    }

    /// The block nearest to the run, among those around a point, whose line continues it.
    fn best_near(
        &self,
        here: DVec2,
        center: DVec2,
        direction: DVec2,
        seed: &Segment,
    ) -> Option<usize> {
        let (col, row) = (
            (here.x / self.block_px).floor() as i64,
            (here.y / self.block_px).floor() as i64,
        );
        let mut best: Option<(f64, usize)> = None;
        for (dx, dy) in [(0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)] {
            let (x, y) = (col + dx, row + dy);
            if x < 0 || y < 0 || x >= self.blocks.width() as i64 || y >= self.blocks.height() as i64
            {
                continue;
            }
            let index = y as usize * self.blocks.width() + x as usize;
            let Some(segment) = self.segments[index].filter(|_| !self.taken[index]) else {
                continue;
            };
            let away = (segment.middle - center).perp_dot(direction).abs();
            if away <= best.map_or(MAX_AWAY_PX, |(away, _)| away)
                && segment.normal.dot(direction).abs() <= MAX_TURN_RAD.sin()
                && alike(&segment, seed)
            {
                best = Some((away, index));
            }
        }
        best.map(|(_, index)| index)
    }
}

/// Whether two lines of nearly the same direction have like colours on like sides.
fn alike(a: &Segment, b: &Segment) -> bool {
    let same_way = if a.normal.dot(b.normal) < 0.0 {
        -1.0
    } else {
        1.0
    };
    let dot: f32 = a.step.iter().zip(b.step).map(|(x, y)| x * y).sum();
    same_way * dot > 0.5 * a.contrast.min(b.contrast).powi(2)
}

/// Whether a run lies along a longer one.
fn repeats(run: &Run, longer: &Run) -> bool {
    let direction = longer.direction();
    run.ends.iter().all(|&end| {
        let from = end - longer.ends[0];
        let along = from.dot(direction);
        from.perp_dot(direction).abs() < REPEATED_PX
            && along > -MAX_GAP_PX
            && along < longer.length() + MAX_GAP_PX
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use ravec_progress::Progress;
    use ravec_raster::{Image, LinearRgb};
    use ravec_scenes::edge::{EdgeTruth, TwoColors, edge};
    use ravec_twocolor::FitParams;

    fn runs_of(image: &Image<LinearRgb>) -> Vec<Run> {
        let mut field =
            TwoColorField::fit(image, &FitParams::default(), &Progress::none()).unwrap();
        field.refine_lines(image, &Progress::none()).unwrap();
        straight_runs(&field)
    }

    #[test]
    fn a_straight_edge_is_one_run_on_it() {
        let size = Size::new(320, 240).unwrap();
        for degrees in [0, 12, 37, 45, 90, 122, 171] {
            let colors = TwoColors::grey_step(128.0, 64.0);
            let through = dvec2(160.3, 120.7);
            let truth = EdgeTruth::from_angle(f64::from(degrees).to_radians(), through, colors);
            let runs = runs_of(&edge(size, &truth));
            assert_eq!(runs.len(), 1, "{degrees}");
            let normal = DVec2::from_angle(f64::from(degrees).to_radians());
            for end in runs[0].ends {
                // within a tenth on clean oblique edges; an upright one is known only to the pixel that it crosses
                assert!((end - through).dot(normal).abs() < 1.0, "{degrees}: {end}");
            }
            assert!(runs[0].length() > 220.0, "{degrees}: {}", runs[0].length());
        }
    }

    #[test]
    fn small_discs_have_no_straight_runs() {
        let disc = Image::from_fn(Size::new(200, 200).unwrap(), |col, row| {
            let r = (col as f64 - 99.5).hypot(row as f64 - 99.5);
            LinearRgb([if r < 50.0 { 0.1 } else { 0.6 }; 3])
        });
        assert_eq!(runs_of(&disc), []);
    }

    #[test]
    fn an_edge_is_followed_behind_a_post() {
        let size = Size::new(320, 160).unwrap();
        let truth =
            EdgeTruth::from_angle(1.4, dvec2(160.0, 80.0), TwoColors::grey_step(128.0, 64.0));
        let mut image = edge(size, &truth);
        for row in 0..160 {
            for col in 150..200 {
                image[(col, row)] = LinearRgb([0.02; 3]);
            }
        }
        let along = runs_of(&image)
            .into_iter()
            .filter(|run| run.direction().x.abs() > 0.9);
        assert_eq!(along.count(), 1);
    }
}

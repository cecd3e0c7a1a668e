//! A candidate followed along the picture, as far as the edge goes straight on.
//!
//! ```text
//! chunk by chunk of the strip, look for the edge where its contrast is largest near the candidate
//! fit a line to where it was found, and look again near that
//! go on at both ends, fitting anew with each chunk, until there was none for some time
//! keep the line if it is long, covered, straight, and more than roughness makes
//! ```
//!
//! A chunk is a two-color pixel of 8 × 6 that is turned as the line is, 16 × 6 where 8 do not distinguish it from
//! roughness. Its score is the contrast in the colors of the candidate.
//!
//! Guarantees: where the edge was found is within a pixel of the run, and 0.3 in the mean. Does not guarantee: that all of an
//! edge is followed; see [`crate::runs`] for the joining of what is left.

use crate::runs::{Chain, LineFit, Run};
use crate::strips::{Candidate, Frame, SIDE, STRIP};

/// Largest distance of a chunk's edge from the line so far. Larger follows curves, smaller loses rough edges.
const MAX_AWAY_PX: f64 = 1.0;

/// Largest distance of the first edge from a candidate: the sums have their lines at whole pixels, and only nearly
/// straight.
const SEED_AWAY_PX: f64 = 2.0;

/// Largest distance of a further chunk from a line that all others meet exactly; three times as much as those scatter
/// is added. More goes on around a disc where its tangent ends.
const NEXT_AWAY_PX: f64 = 0.3;

/// Largest distance of its edge from the line in the mean (root of squares). An edge anywhere within a pixel has 0.6,
/// long ones on strong texture up to 0.25.
const MAX_SCATTER_PX: f64 = 0.3;

/// The share of the line's contrast that a chunk must have.
const MIN_SHARE: f32 = 0.5;

/// Largest gap without a chunk that continues the line.
const MAX_GAP_PX: usize = 28;

/// The least length of a run. Shorter ones are found on curves.
const MIN_LENGTH_PX: f64 = 60.0;

/// The share of a run's length that its chunks must cover.
const MIN_COVERED: f64 = 0.75;

/// By how much its contrast, taken together over its length, must exceed the median of its neighborhood. One in fifty of the
/// lines that texture makes has 10, see `docs/notes/straight-runs.md`.
const MIN_SIGNIFICANCE: f64 = 12.0;

/// The length of a chunk.
const CHUNK: usize = 8;

/// By what factor the contrast must exceed that of roughness in such a chunk, or those of twice the length are taken.
const MIN_SIGNAL: f32 = 4.0;

/// Number of pixels on each side of the line that are read.
const REACH: usize = 6;

/// The edge in a chunk.
#[derive(Debug, Clone, Copy)]
struct Edge {
    /// Start of the chunk.
    first: usize,
    /// Position of its middle, along and across.
    at: f64,
    v: f64,
    contrast: f32,
}

/// A straight line of the frame.
#[derive(Debug, Clone, Copy)]
struct Level {
    /// Its position at the frame's border.
    from: f64,
    slope: f64,
    /// Mean distance across of the edges that it was fitted to.
    scatter: f64,
}

impl Level {
    /// By least squares.
    fn fitted(edges: &[Edge]) -> Self {
        let n = edges.len() as f64;
        let mean = |value: &dyn Fn(&Edge) -> f64| edges.iter().map(value).sum::<f64>() / n;
        let (at, v) = (mean(&|e| e.at), mean(&|e| e.v));
        let spread = mean(&|e| (e.at - at) * (e.at - at));
        let slope = mean(&|e| (e.at - at) * (e.v - v)) / spread;
        let from = v - slope * at;
        Self {
            from,
            slope,
            scatter: mean(&|e| (e.v - from - slope * e.at).powi(2)).sqrt(),
        }
    }

    fn v(&self, at: f64) -> f64 {
        self.from + self.slope * at
    }

    /// Pixels of the line for each along.
    fn stretch(&self) -> f64 {
        self.slope.hypot(1.0)
    }
}

/// The run along a candidate, if there is one.
pub(crate) fn trace(frame: &Frame, candidate: &Candidate) -> Option<Chain> {
    let contrast = candidate.contrast();
    // shorter chunks are rougher
    let noise = candidate.noise * (STRIP as f32 / CHUNK as f32).sqrt();
    let mut tracer = Tracer {
        frame,
        colors: candidate.step.map(|v| v / contrast),
        contrast,
        chunk: if contrast < MIN_SIGNAL * noise {
            2 * CHUNK
        } else {
            CHUNK
        },
    };
    let mut edges = tracer.within_strip(candidate)?;
    tracer.go_on(&mut edges, candidate.first + STRIP, false);
    tracer.go_on(&mut edges, candidate.first, true);
    let level = Level::fitted(&edges);
    edges.retain(|e| (e.v - level.v(e.at)).abs() <= MAX_AWAY_PX * level.stretch());
    tracer.chain(&edges, candidate.noise)
}

struct Tracer<'a> {
    frame: &'a Frame,
    /// The step of colors across the line, of length 1.
    colors: [f32; 3],
    contrast: f32,
    chunk: usize,
}

impl Tracer<'_> {
    /// The edges near a candidate, if most of its strip has some.
    fn within_strip(&mut self, candidate: &Candidate) -> Option<Vec<Edge>> {
        let mut level = Level {
            from: candidate.from - candidate.slope * candidate.first as f64,
            slope: candidate.slope,
            scatter: 0.0,
        };
        let mut edges = Vec::new();
        for away in [SEED_AWAY_PX, MAX_AWAY_PX, MAX_AWAY_PX] {
            let chunks = (0..STRIP).step_by(self.chunk);
            edges = chunks
                .filter_map(|k| self.edge(candidate.first + k, &level, away))
                .collect();
            if 2 * edges.len() * self.chunk < STRIP {
                return None;
            }
            level = Level::fitted(&edges);
            // the strip may hold the line in part, and not quite
            let mut contrasts: Vec<f32> = edges.iter().map(|e| e.contrast).collect();
            let middle = contrasts.len() / 2;
            let (_, median, _) = contrasts.select_nth_unstable_by(middle, f32::total_cmp);
            self.contrast = self.contrast.max(*median);
        }
        Some(edges)
    }

    /// Adds the edges from `start` on, or back from there.
    fn go_on(&self, edges: &mut Vec<Edge>, start: usize, back: bool) {
        let steps = if back {
            start
        } else {
            self.frame.along - start
        } / self.chunk;
        let mut gap = 0;
        for step in 0..steps {
            let first = if back {
                start - (step + 1) * self.chunk
            } else {
                start + step * self.chunk
            };
            let level = Level::fitted(edges);
            let away = 3.0 * level.scatter / level.stretch() + NEXT_AWAY_PX;
            if let Some(edge) = self.edge(first, &level, away.min(MAX_AWAY_PX)) {
                edges.push(edge);
                gap = 0;
            } else {
                gap += self.chunk;
                if gap > MAX_GAP_PX {
                    return;
                }
            }
        }
    }

    /// The run through edges.
    fn chain(&self, edges: &[Edge], noise: f32) -> Option<Chain> {
        let first = edges.iter().map(|e| e.first).min()? as f64;
        let last = (edges.iter().map(|e| e.first).max()? + self.chunk) as f64;
        let level = Level::fitted(edges);
        let stretch = level.stretch();
        let covered = (edges.len() * self.chunk) as f64;
        let contrast = edges.iter().map(|e| e.contrast).sum::<f32>() / edges.len() as f32;
        let significance = f64::from(contrast) * (covered / STRIP as f64).sqrt();
        let straight = level.scatter <= MAX_SCATTER_PX * stretch;
        if !straight
            || (last - first) * stretch < MIN_LENGTH_PX
            || covered < MIN_COVERED * (last - first)
            || significance < MIN_SIGNIFICANCE * f64::from(noise)
        {
            return None;
        }
        let mut fit = LineFit::default();
        let half = 0.5 * self.chunk as f64;
        for edge in edges {
            fit.add(
                self.frame.point(edge.at, edge.v),
                self.frame.point(half, half * level.slope),
            );
        }
        // seen along the run, what comes after it across is on the right
        let ends = if self.frame.upright {
            [last, first]
        } else {
            [first, last]
        };
        Some(Chain {
            run: Run {
                ends: ends.map(|at| self.frame.point(at, level.v(at))),
            },
            fit,
            step: self.colors.map(|v| v * contrast),
        })
    }

    /// The edge of the chunk from `first` on, if it has one within `away` of a line.
    fn edge(&self, first: usize, level: &Level, away: f64) -> Option<Edge> {
        const OFFSETS: usize = 2 * (REACH - SIDE) + 1;
        let offset = |o: usize| o as f64 - (REACH - SIDE) as f64;
        let profile = self.profile(first, level);
        let contrasts: [f32; OFFSETS] = std::array::from_fn(|o| {
            let before: f32 = profile[o..o + SIDE].iter().sum();
            let after: f32 = profile[o + SIDE..o + 2 * SIDE].iter().sum();
            (after - before) / (SIDE * self.chunk) as f32
        });
        let away = away * level.stretch();
        let best = (1..OFFSETS - 1)
            .filter(|&o| offset(o).abs() <= away + 0.5)
            .max_by(|&a, &b| contrasts[a].total_cmp(&contrasts[b]))?;
        if contrasts[best] < MIN_SHARE * self.contrast {
            return None;
        }
        // the top of the parabola through the three largest
        let [low, here, high] = [best - 1, best, best + 1].map(|o| f64::from(contrasts[o]));
        let bend = low - 2.0 * here + high;
        let fine = if bend < 0.0 {
            (0.5 * (low - high) / bend).clamp(-1.0, 1.0)
        } else {
            0.0
        };
        let from_line = offset(best) + fine;
        let at = first as f64 + 0.5 * self.chunk as f64;
        (from_line.abs() <= away).then(|| Edge {
            first,
            at,
            v: level.v(at) + from_line,
            contrast: contrasts[best],
        })
    }

    /// The colors across a line, summed along a chunk: what they have of the step, for the pixels around the places
    /// −`REACH` + 1/2, −`REACH` + 3/2 ...
    fn profile(&self, first: usize, level: &Level) -> [f32; 2 * REACH] {
        let across = self.frame.across;
        let mut profile = [0.0; 2 * REACH];
        for at in first..first + self.chunk {
            let begin = level.v(at as f64 + 0.5) - REACH as f64;
            let (whole, share) = (begin.floor(), (begin - begin.floor()) as f32);
            for (channel, color) in self.frame.channels.iter().zip(self.colors) {
                let column = &channel[at * across..][..across];
                let mut around = [0.0; 2 * REACH + 1];
                let inside = whole >= 0.0 && whole < across.saturating_sub(2 * REACH) as f64;
                if inside {
                    around.copy_from_slice(&column[whole as usize..][..=2 * REACH]);
                } else {
                    for (k, value) in around.iter_mut().enumerate() {
                        *value =
                            column[(whole + k as f64).clamp(0.0, (across - 1) as f64) as usize];
                    }
                }
                let (low, high) = (color * (1.0 - share), color * share);
                for (k, sum) in profile.iter_mut().enumerate() {
                    *sum += low * around[k] + high * around[k + 1];
                }
            }
        }
        profile
    }
}

//! The moves of four corners that bring lines onto edges, tried all.

use crate::snap::SnapError;
use crate::snap::sites::{Profile, Site, Sites};
use ravec_raster::Plane;
use rayon::prelude::*;

/// Pieces of a line that are distinguished. The ends of a line move differently; within a piece the difference is a
/// fraction of the coarsest step.
const PIECES: usize = 16;

/// The blur across lines, in pixels. Edges must be wide enough to meet along a piece that is not yet parallel to them, which
/// grows with the reach; but both edges of a thin line fade where it is wider than they are apart.
const MIN_SIGMA_PX: f64 = 1.0;
const MAX_SIGMA_PX: f64 = 2.0;

/// Four corners and the difference of two sides.
const MOVES: usize = 5;

/// Steps of one move to each side in the coarsest search: (2 · 4 + 1)⁵ moves are tried. With fewer, parallel edges come to
/// lie within one step.
const HALF_MOVES: i32 = 4;

/// Shifts of an end of a line that are distinguished in the coarsest search, in half steps: up to twice the reach.
const CELLS: usize = 8 * HALF_MOVES as usize + 1;

/// A cell in the fixed-point numbers that the coarsest search counts in: they are added and cut faster than floats.
const CELL: i32 = 1 << CELL_BITS;
const CELL_BITS: u32 = 16;

/// Coarse finds that are followed: a few parallel edges look alike from afar.
const CANDIDATES: usize = 16;

/// Finds that are followed at the finest step at least; half as many at each step as at the one before.
const MIN_CANDIDATES: usize = 6;

/// Finds that are returned.
const FINDS: usize = 3;

/// The share of the best find's evidence that others have at least.
const FINDS_WORTH: f32 = 0.9;

/// Steps uphill at one step size.
const MAX_CLIMB: u8 = 4;

/// Share of the evidence by which the largest moves must exceed no move, to be preferred: a tie goes to the nearer one.
const NEARNESS: f32 = 0.02;

/// Likelihood of an edge at each distance from each piece of each line.
pub(super) struct Evidence {
    pieces: Vec<Piece>,
    ends: Vec<[[f64; 8]; 2]>,
    reach: usize,
    /// Evidence of a line at any place.
    mean: f64,
}

struct Piece {
    line: usize,
    /// Its middle along the line, 0 to 1.
    along: f32,
    /// 2 · `reach` + 1 values from 0 to 1.
    values: Vec<f32>,
}

impl Evidence {
    pub(super) fn gather(plane: &Plane, sites: &Sites, reach_px: f64) -> Result<Self, SnapError> {
        if sites.sites.is_empty() {
            return Err(SnapError::Outside);
        }
        let reach = reach_px.ceil() as usize;
        let sigma_px = (reach_px / PIECES as f64).clamp(MIN_SIGMA_PX, MAX_SIGMA_PX);
        let width = 2 * reach + 1;
        let mut slopes = vec![0.0; width * sites.sites.len()];
        slopes
            .par_chunks_exact_mut(width)
            .zip(&sites.sites)
            .with_min_len(64)
            .for_each_init(
                || Profile::new(reach, sigma_px),
                |profile, (slopes, site)| {
                    profile.read(plane, site.at, site.normal);
                    slopes.copy_from_slice(&profile.slopes);
                },
            );
        let largest = steepest(slopes.iter().copied()).ok_or(SnapError::NoEdges)?;
        let piece_of = |site: &Site| {
            (
                site.line,
                ((site.along * PIECES as f64) as usize).min(PIECES - 1),
            )
        };
        let parts = sites.sites.chunk_by(|a, b| piece_of(a) == piece_of(b));
        let mut rest = slopes.as_slice();
        let parts: Vec<(&[Site], &[f32])> = parts
            .map(|sites| {
                let (here, after) = rest.split_at(width * sites.len());
                rest = after;
                (sites, here)
            })
            .collect();
        let pieces: Vec<Piece> = parts
            .into_par_iter()
            .map(|(sites, slopes)| {
                let share = 1.0 / sites.len() as f32;
                let scale = edge_scale(slopes.iter().copied(), largest);
                let mut values = vec![0.0; width];
                for slopes in slopes.chunks_exact(width) {
                    for (sum, slope) in values.iter_mut().zip(slopes) {
                        *sum += share * edgeness(*slope, scale);
                    }
                }
                // what is uneven everywhere, as leaves in front of a wall are, says little about one place
                let mean = values.iter().sum::<f32>() / values.len() as f32;
                for value in &mut values {
                    *value = (*value - mean).max(0.0);
                }
                Piece {
                    line: sites[0].line,
                    along: sites.iter().map(|site| share * site.along as f32).sum(),
                    values,
                }
            })
            .collect();
        let values = || pieces.iter().flat_map(|piece| &piece.values);
        Ok(Self {
            mean: values().map(|&v| f64::from(v)).sum::<f64>() / values().count() as f64,
            pieces,
            ends: sites.ends.clone(),
            reach,
        })
    }
}

/// Certainty that a slope is an edge, 0 to 1: one half at `scale`. It saturates, so that strong edges do not outvote
/// many.
#[inline]
pub(super) fn edgeness(slope: f32, scale: f32) -> f32 {
    let square = slope * slope;
    square / (square + scale * scale)
}

/// The steepest of all slopes. Nothing if the picture is even, or finite nowhere.
pub(super) fn steepest(slopes: impl Iterator<Item = f32>) -> Option<f32> {
    let finite = |slope: &f32| slope.is_finite();
    let largest = slopes.map(f32::abs).filter(finite).fold(0.0, f32::max);
    // a tenth of an encoded step of 255
    (largest >= 4e-4).then_some(largest)
}

/// The slope that counts half: some times that of the places given by `usual`, which are noise and texture as most places
/// are no edges; not less than a share of the `steepest`.
pub(super) fn edge_scale(usual: impl Iterator<Item = f32>, steepest: f32) -> f32 {
    let floor = 0.05 * steepest;
    let mut heights: Vec<f32> = usual.map(f32::abs).filter(|h| h.is_finite()).collect();
    if heights.is_empty() {
        return floor;
    }
    let middle = heights.len() / 2;
    let (_, median, _) = heights.select_nth_unstable_by(middle, f32::total_cmp);
    // a picture without noise has a median of 0
    (2.4 * *median).max(floor)
}

/// The best moves.
pub(super) struct Moves {
    /// Moves of the corners along their directions, in pixels.
    pub by_px: [f64; 4],
    /// The evidence of all lines above what lines at any place find, less a share of the best line's for each.
    pub excess: f64,
}

/// Shift of both ends of a line when each move grows by 1.
type Ends = [[f32; MOVES]; 2];

/// Moves and what they find.
type Scored = (f32, [f32; MOVES]);

/// Tries all moves of four corners, each along its own direction, and of the difference of two sides; `modes` say what each
/// move does to the corners' coordinates. Returns a few that differ by more than `apart_px`, at least one, the best first.
pub(super) fn best_moves(
    evidence: &Evidence,
    modes: &[[f64; 8]; MOVES],
    apart_px: f64,
) -> Vec<Moves> {
    let ends: Vec<Ends> = evidence
        .ends
        .iter()
        .map(|ends| {
            ends.map(|influence| {
                std::array::from_fn(|k| {
                    modes[k]
                        .iter()
                        .zip(influence)
                        .map(|(m, i)| m * i)
                        .sum::<f64>() as f32
                })
            })
        })
        .collect();
    let mut step = evidence.reach as f32 / HALF_MOVES as f32;
    let mut candidates = Level::new(evidence, &ends, step).best_of_all();
    let mut followed = CANDIDATES;
    while step > 1.0 {
        step *= 0.5;
        let level = Level::new(evidence, &ends, step);
        candidates = candidates
            .into_par_iter()
            .map(|(_, at)| level.climb(at))
            .collect();
        // several come to one place
        let mut seen: Vec<[f32; MOVES]> = Vec::new();
        candidates.retain(|(_, at)| {
            let is_new = !seen.contains(at);
            seen.extend(is_new.then_some(*at));
            is_new
        });
        candidates.sort_by(|a, b| b.0.total_cmp(&a.0));
        followed = (followed / 2).max(MIN_CANDIDATES);
        candidates.truncate(followed);
    }
    // with no evidence nothing moves
    candidates.retain(|(score, _)| *score > 0.0);
    candidates.sort_by(|a, b| b.0.total_cmp(&a.0));
    let worth = candidates.first().map_or(0.0, |best| FINDS_WORTH * best.0);
    candidates.retain(|(score, _)| *score >= worth);
    let mut finds: Vec<[f32; MOVES]> = Vec::new();
    for (_, at) in candidates {
        let differs = |other: &[f32; MOVES]| {
            let apart = at.iter().zip(other).map(|(a, b)| (a - b).abs());
            apart.fold(0.0, f32::max) > apart_px as f32
        };
        if finds.len() < FINDS && finds.iter().all(differs) {
            finds.push(at);
        }
    }
    if finds.is_empty() {
        finds.push([0.0; MOVES]);
    }
    finds
        .into_iter()
        .map(|at| Moves {
            by_px: std::array::from_fn(|k| f64::from(at[k])),
            excess: excess(evidence, &ends, at),
        })
        .collect()
}

fn shifts(ends: &Ends, moves: [f32; MOVES]) -> [f32; 2] {
    ends.map(|weights| weights.iter().zip(moves).map(|(w, m)| w * m).sum())
}

/// The evidence at one step: each value is the highest within half a step, so that no edge lies between two moves.
struct Level<'a> {
    pieces: &'a [Piece],
    /// `width` values for each piece.
    values: Vec<f32>,
    width: usize,
    ends: &'a [Ends],
    reach: usize,
    step: f32,
    penalty: f32,
}

impl<'a> Level<'a> {
    fn new(evidence: &'a Evidence, ends: &'a [Ends], step: f32) -> Self {
        let radius = (0.5 * step).round() as usize;
        let reach = evidence.reach;
        let width = 2 * reach + 1;
        let mut values = vec![0.0; width * evidence.pieces.len()];
        values
            .par_chunks_exact_mut(width)
            .zip(&evidence.pieces)
            .for_each(|(values, piece)| highest_within(&piece.values, radius, values));
        Self {
            pieces: &evidence.pieces,
            values,
            width,
            ends,
            reach,
            step,
            penalty: NEARNESS * evidence.pieces.len() as f32 / (MOVES * reach * reach) as f32,
        }
    }

    /// The pieces with their values.
    fn rows(&self) -> impl Iterator<Item = (&Piece, &[f32])> {
        self.pieces.iter().zip(self.values.chunks_exact(self.width))
    }

    /// Evidence of a piece with these values when the ends of its line shift.
    #[inline]
    fn find(&self, along: f32, values: &[f32], [start, end]: [f32; 2]) -> f32 {
        let shift = start + along * (end - start);
        // places out of reach find the first of the row, or nothing
        let at = (shift + self.reach as f32 + 0.5).max(0.0) as i32;
        values.get(at as usize).copied().unwrap_or(0.0)
    }

    fn score(&self, moves: [f32; MOVES]) -> f32 {
        let mut sum = 0.0;
        // pieces come line by line
        let mut line = usize::MAX;
        let mut ends = [0.0; 2];
        for (piece, values) in self.rows() {
            if piece.line != line {
                line = piece.line;
                ends = shifts(&self.ends[line], moves);
            }
            sum += self.find(piece.along, values, ends);
        }
        sum - self.penalty * moves.iter().map(|m| m * m).sum::<f32>()
    }

    /// Shift of both ends of each line, in cells of the tables times [`CELL`].
    fn in_cells(&self, moves: [f32; MOVES]) -> impl Iterator<Item = [i32; 2]> {
        let scale = 2.0 / self.step * CELL as f32;
        // far outside is outside, and two of these do not overflow
        let most = (i32::MAX / 4) as f32;
        self.ends.iter().map(move |ends| {
            shifts(ends, moves).map(|shift| (shift * scale).clamp(-most, most) as i32)
        })
    }

    /// Evidence of each line for each pair of shifts of its ends, in half steps: `CELLS` × `CELLS` values a line.
    fn tables(&self) -> Vec<f32> {
        let shift = |cell: usize| (cell as f32 - (CELLS / 2) as f32) * 0.5 * self.step;
        (0..self.ends.len())
            .into_par_iter()
            .flat_map_iter(|line| {
                let pieces: Vec<_> = self
                    .rows()
                    .filter(|(piece, _)| piece.line == line)
                    .collect();
                let cells =
                    (0..CELLS * CELLS).map(|cell| [shift(cell / CELLS), shift(cell % CELLS)]);
                cells.map(move |ends| {
                    pieces
                        .iter()
                        .map(|(piece, values)| self.find(piece.along, values, ends))
                        .sum::<f32>()
                })
            })
            .collect()
    }

    /// The best of all moves, found by tables of lines instead of pieces: the best of the last three moves for each of the
    /// first two, and the best [`CANDIDATES`] of those.
    fn best_of_all(&self) -> Vec<Scored> {
        let tables = self.tables();
        let choices: Vec<f32> = (-HALF_MOVES..=HALF_MOVES)
            .map(|k| k as f32 * self.step)
            .collect();
        let pairs: Vec<[f32; 2]> = choices
            .iter()
            .flat_map(|&a| choices.iter().map(move |&b| [a, b]))
            .collect();
        let triples: Vec<[f32; 3]> = pairs
            .iter()
            .flat_map(|&[c, d]| choices.iter().map(move |&e| [c, d, e]))
            .collect();
        let lines = self.ends.len();
        let last: Vec<[i32; 2]> = triples
            .iter()
            .flat_map(|&[c, d, e]| self.in_cells([0.0, 0.0, c, d, e]))
            .collect();
        let middle = CELL * (CELLS / 2) as i32 + CELL / 2;
        let mut found: Vec<Scored> = pairs
            .par_iter()
            .with_min_len(8)
            .map(|&[a, b]| {
                let first: Vec<[i32; 2]> = self
                    .in_cells([a, b, 0.0, 0.0, 0.0])
                    .map(|ends| ends.map(|shift| shift + middle))
                    .collect();
                let mut best = (f32::MIN, [0.0; MOVES]);
                for (triple, last) in triples.iter().zip(last.chunks_exact(lines)) {
                    let mut score = 0.0;
                    let tables = tables.chunks_exact(CELLS * CELLS);
                    for ((table, first), last) in tables.zip(&first).zip(last) {
                        // what is below the first cell is far beyond the last one as an unsigned number
                        let start = ((first[0] + last[0]) >> CELL_BITS) as u32 as usize;
                        let end = ((first[1] + last[1]) >> CELL_BITS) as u32 as usize;
                        if start < CELLS && end < CELLS {
                            score += table[start * CELLS + end];
                        }
                    }
                    let moves = [a, b, triple[0], triple[1], triple[2]];
                    score -= self.penalty * moves.iter().map(|m| m * m).sum::<f32>();
                    if score > best.0 {
                        best = (score, moves);
                    }
                }
                best
            })
            .collect();
        found.sort_by(|a, b| b.0.total_cmp(&a.0));
        found.truncate(CANDIDATES);
        found
    }

    /// Takes the best neighbor until there is none better.
    fn climb(&self, start: [f32; MOVES]) -> Scored {
        const SIDE: usize = 2 * MAX_CLIMB as usize + 1;
        // in steps from the start, each from 0 to `SIDE` − 1
        let mut center = [MAX_CLIMB as usize; MOVES];
        let mut is_tried = vec![false; SIDE.pow(MOVES as u32)];
        let mut best = (self.score(start), start);
        for _ in 0..MAX_CLIMB {
            let mut next = center;
            for k in 0..3usize.pow(MOVES as u32) {
                let mut rest = k;
                let place = center.map(|at| {
                    let offset = rest % 3;
                    rest /= 3;
                    at + offset - 1
                });
                // neighbors of two places on the way are no better than the second
                let index = place.iter().fold(0, |index, at| SIDE * index + at);
                if std::mem::replace(&mut is_tried[index], true) {
                    continue;
                }
                let moves = std::array::from_fn(|i| {
                    start[i] + (place[i] as f32 - MAX_CLIMB as f32) * self.step
                });
                if moves.iter().all(|m| m.abs() <= self.reach as f32) {
                    let score = self.score(moves);
                    if score > best.0 {
                        best = (score, moves);
                        next = place;
                    }
                }
            }
            if next == center {
                break;
            }
            center = next;
        }
        best
    }
}

/// The highest value within `radius` places to each side.
fn highest_within(row: &[f32], radius: usize, highest: &mut [f32]) {
    for (k, highest) in highest.iter_mut().enumerate() {
        let near = &row[k.saturating_sub(radius)..(k + radius + 1).min(row.len())];
        *highest = near.iter().fold(0.0, |a: f32, &b| a.max(b));
    }
}

/// See [`Moves::excess`].
fn excess(evidence: &Evidence, ends: &[Ends], moves: [f32; MOVES]) -> f64 {
    let level = Level::new(evidence, ends, 2.0);
    let mut lines = vec![0.0; ends.len()];
    for (piece, values) in level.rows() {
        let found = level.find(piece.along, values, shifts(&ends[piece.line], moves));
        lines[piece.line] += (f64::from(found) - evidence.mean) / PIECES as f64;
    }
    let best = lines.iter().fold(0.0f64, |a, &b| a.max(b));
    // a line that finds less than a third of what the best one finds speaks against the count
    lines.iter().map(|line| line - best / 3.0).sum()
}

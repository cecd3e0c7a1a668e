//! All ways in which a line can split a square block of pixels, in the order of a rotating sweep.
//!
//! Keep the block's pixel centers sorted along a direction that turns by half a circle. The first `k` pixels of the
//! order are one side of a split. Only at *critical directions*, normal to the join of two centers, does the order
//! change: every run of pixels with equal projection is reversed. Reversing a run `[i, j)` renews exactly the splits
//! `k = i + 1 … j − 1`. Each renewal is an *event* `(k, pixel)`: the first `k` pixels are now the first `k − 1` and
//! `pixel`. So one addition to a prefix sum and one gain per event visit every split once: the prefixes of the initial
//! order need no scoring of their own, since each returns as a complement within the half turn.
//!
//! Source: the sweep is classical (Edelsbrunner & Guibas, "Topologically sweeping an arrangement", 1989); the counts
//! are those of linear threshold functions on the grid, 6, 28, 86, 200, 418, 748, 1282 for N = 2 … 8.
//!
//! Cost: O(N⁴) events; the table of N = 8 holds 1 282, of N = 16 20 074, of N = 32 319 346.

use crate::line::Line;
use glam::DVec2;
use std::ops::Range;
use std::sync::OnceLock;

/// The largest block side with a table. N = 64 would take 5 million events a block; larger blocks are fitted coarse to
/// fine.
pub const MAX_EXACT_SIDE: usize = 32;

/// Sectors of angle into which the half turn is divided where several good splits are wanted.
pub(crate) const SECTORS: usize = 8;

/// One new split: the first `prefix` pixels are the first `prefix − 1` together with `pixel`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Event {
    /// Pixels on side 0, 1 to N² − 1.
    pub prefix: u16,
    /// Row-major index of the pixel that side 0 gains over prefix − 1.
    pub pixel: u16,
}

/// All splits of a block of `side` × `side` pixels.
#[derive(Debug)]
pub(crate) struct SplitTable {
    /// N, 2 to [`MAX_EXACT_SIDE`].
    pub side: usize,
    /// The order of the pixels at the start of the sweep.
    pub initial_order: Vec<u16>,
    /// One event a split.
    pub events: Vec<Event>,
    /// By prefix `k`, the factor `1/k + 1/(N² − k)` that makes a gain of a squared sum; 0 where a side is empty.
    pub gain_weights: Vec<f32>,
    /// The events of each eighth of the half turn.
    pub sectors: [Range<usize>; SECTORS],
    /// For each event, a line with that split, relative to the block's center: halfway, in angle and in offset, between
    /// the lines at which the split would change. Side 0 holds the event's prefix.
    pub lines: Vec<CentralLine>,
}

/// A line in the precision that sides of pixel centers need.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct CentralLine {
    pub normal: [f32; 2],
    pub offset: f32,
}

#[cfg(test)]
impl CentralLine {
    /// Returns `true` if the pixel whose center is at `(x, y)` from the block's center lies on side 0.
    pub fn has_on_side_0(&self, x: f32, y: f32) -> bool {
        self.normal[0] * x + self.normal[1] * y < self.offset
    }
}

impl From<CentralLine> for Line {
    fn from(line: CentralLine) -> Self {
        Self {
            normal: DVec2::new(f64::from(line.normal[0]), f64::from(line.normal[1])).normalize(),
            offset_px: f64::from(line.offset),
        }
    }
}

/// The table for blocks of `side` × `side` pixels, made at the first call and kept.
///
/// # Panics
/// If `side` is not within 2 to [`MAX_EXACT_SIDE`].
pub(crate) fn split_table(side: usize) -> &'static SplitTable {
    static TABLES: [OnceLock<SplitTable>; MAX_EXACT_SIDE + 1] =
        [const { OnceLock::new() }; MAX_EXACT_SIDE + 1];
    assert!(
        (2..=MAX_EXACT_SIDE).contains(&side),
        "no split table for side {side}"
    );
    TABLES[side].get_or_init(|| SplitTable::sweep(side))
}

/// The number of ways in which a line splits the centers of `side` × `side` pixels into two parts that are not empty.
///
/// # Panics
/// If `side` is not within 2 to 32.
pub fn split_count(side: usize) -> usize {
    split_table(side).events.len()
}

/// The position of a pixel's center relative to the center of its block.
pub(crate) fn center_in_block(pixel: usize, side: usize) -> DVec2 {
    let half = 0.5 * (side as f64 - 1.0);
    DVec2::new((pixel % side) as f64 - half, (pixel / side) as f64 - half)
}

impl SplitTable {
    /// Turns the direction by half a circle and records every split.
    fn sweep(side: usize) -> Self {
        let mut order: Vec<u16> = (0..(side * side) as u16).collect();
        order.sort_by_key(|&pixel| (pixel as usize % side, pixel as usize / side));
        let initial_order = order.clone();

        let mut events = Vec::new();
        let mut angles = Vec::new();
        for [ux, uy] in critical_directions(side) {
            let angle = f64::from(uy).atan2(f64::from(ux));
            let projection = |pixel: u16| {
                i32::from(pixel) % side as i32 * ux + i32::from(pixel) / side as i32 * uy
            };
            let mut begin = 0;
            while begin < order.len() {
                let value = projection(order[begin]);
                let run = order[begin..]
                    .iter()
                    .take_while(|&&pixel| projection(pixel) == value)
                    .count();
                order[begin..begin + run].reverse();
                for prefix in begin + 1..begin + run {
                    events.push(Event {
                        prefix: prefix as u16,
                        pixel: order[prefix - 1],
                    });
                    angles.push(angle);
                }
                begin += run;
            }
        }
        let first_in = |sector: usize| {
            let begin = std::f64::consts::PI * sector as f64 / SECTORS as f64;
            angles.partition_point(|&angle| angle <= begin)
        };
        let sectors = std::array::from_fn(|sector| first_in(sector)..first_in(sector + 1));
        let lines = central_lines(side, &initial_order, &events, &angles);
        let count = side * side;
        let gain_weights = (0..=count)
            .map(|k| {
                if k % count == 0 {
                    0.0
                } else {
                    1.0 / k as f32 + 1.0 / (count - k) as f32
                }
            })
            .collect();
        Self {
            side,
            initial_order,
            events,
            gain_weights,
            sectors,
            lines,
        }
    }
}

/// The primitive integer directions at which two centers of the block project onto the same point, by angle in (0, π].
fn critical_directions(side: usize) -> Vec<[i32; 2]> {
    let reach = side as i32 - 1;
    let mut directions: Vec<[i32; 2]> = (-reach..=reach)
        .flat_map(|ux| (0..=reach).map(move |uy| [ux, uy]))
        .filter(|&[ux, uy]| gcd(ux.unsigned_abs(), uy.unsigned_abs()) == 1 && (uy > 0 || ux < 0))
        .collect();
    // the cross product of two directions of the half plane is positive when the second lies further round
    directions.sort_by(|a, b| 0.cmp(&(a[0] * b[1] - a[1] * b[0])));
    directions
}

fn gcd(a: u32, b: u32) -> u32 {
    if b == 0 { a } else { gcd(b, a % b) }
}

/// For each event, the line halfway through the angles over which its split lasts.
fn central_lines(
    side: usize,
    initial_order: &[u16],
    events: &[Event],
    angles: &[f64],
) -> Vec<CentralLine> {
    let count = side * side;
    // a split lasts until the next event of its prefix; past the end of the half turn it goes on as the complement
    let mut first_angle = vec![std::f64::consts::PI; count + 1];
    for (event, &angle) in events.iter().zip(angles).rev() {
        first_angle[event.prefix as usize] = angle;
    }
    let mut next_angle: Vec<f64> = (0..=count)
        .map(|prefix| first_angle[count - prefix] + std::f64::consts::PI)
        .collect();
    let mut middles = vec![0.0; events.len()];
    for (i, (event, &angle)) in events.iter().zip(angles).enumerate().rev() {
        let next = &mut next_angle[event.prefix as usize];
        middles[i] = 0.5 * (angle + *next);
        *next = angle;
    }

    // replay the sweep to know the members of each prefix, and put the line into the middle of the gap
    let mut order = initial_order.to_vec();
    let mut lines = Vec::with_capacity(events.len());
    let mut begin = 0;
    while begin < events.len() {
        // the events of one run: consecutive prefixes at one angle
        let run = 1
            + (begin + 1..events.len())
                .take_while(|&i| {
                    angles[i] == angles[begin] && events[i].prefix == events[i - 1].prefix + 1
                })
                .count();
        let from = events[begin].prefix as usize - 1;
        order[from..=from + run].reverse();
        for (event, &middle) in events[begin..begin + run].iter().zip(&middles[begin..]) {
            let normal = DVec2::from_angle(middle);
            let project = |&pixel: &u16| normal.dot(center_in_block(pixel as usize, side));
            let (side_0, side_1) = order.split_at(event.prefix as usize);
            let below = side_0.iter().map(project).fold(f64::MIN, f64::max);
            let above = side_1.iter().map(project).fold(f64::MAX, f64::min);
            lines.push(CentralLine {
                normal: [normal.x as f32, normal.y as f32],
                offset: (0.5 * (below + above)) as f32,
            });
        }
        begin += run;
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashSet;

    /// The members of side 0 of each event, replayed from the table's definition.
    fn members(table: &SplitTable) -> Vec<Vec<bool>> {
        let count = table.side * table.side;
        let mut prefixes: Vec<Vec<bool>> = (0..=count)
            .map(|k| {
                let mut mask = vec![false; count];
                table.initial_order[..k]
                    .iter()
                    .for_each(|&pixel| mask[pixel as usize] = true);
                mask
            })
            .collect();
        let mut splits = Vec::new();
        for event in &table.events {
            let k = event.prefix as usize;
            let mut mask = prefixes[k - 1].clone();
            assert!(
                !std::mem::replace(&mut mask[event.pixel as usize], true),
                "a pixel joins twice"
            );
            prefixes[k] = mask.clone();
            splits.push(mask);
        }
        splits
    }

    #[test]
    fn the_splits_are_as_many_as_published() {
        let counts: Vec<usize> = (2..=9).map(split_count).collect();
        assert_eq!(counts, [6, 28, 86, 200, 418, 748, 1282, 2040]);
        assert_eq!(
            (split_count(10), split_count(12), split_count(16)),
            (3106, 6394, 20074)
        );
    }

    #[test]
    fn no_split_is_listed_twice_not_even_as_its_complement() {
        for side in 2..=9 {
            let splits = members(split_table(side));
            let mut seen = HashSet::new();
            for mask in &splits {
                let complement: Vec<bool> = mask.iter().map(|inside| !inside).collect();
                assert!(!seen.contains(&complement));
                assert!(seen.insert(mask.clone()));
            }
        }
    }

    #[test]
    fn each_line_has_its_events_split_with_a_clear_gap() {
        for side in [2, 3, 4, 5, 8, 9, 12, 16] {
            let table = split_table(side);
            for (mask, line) in members(table).iter().zip(&table.lines) {
                for (pixel, &inside) in mask.iter().enumerate() {
                    let center = center_in_block(pixel, side);
                    assert_eq!(line.has_on_side_0(center.x as f32, center.y as f32), inside);
                    // far above the rounding of f32 at these magnitudes, so sides are never in doubt
                    assert!(Line::from(*line).signed_distance(center).abs() > 1e-4);
                }
            }
        }
    }
}

//! The lowest positions of a block: where a template is valid, and where its mismatch is small.

use super::blocks::Field;
use super::level::Level;
use super::search::Place;
use super::template::Template;
use glam::{DVec2, IVec2, dvec2};

/// A position with a low mismatch.
#[derive(Debug, Clone, Copy)]
pub(super) struct Low {
    /// The place, with the score at the bottom of the parabola through its neighbors.
    pub(super) place: Place,
    /// Offset of that bottom from the pixel, −½ to ½.
    pub(super) between: DVec2,
    /// No neighbor is lower.
    pub(super) minimum: bool,
}

impl From<Place> for Low {
    fn from(place: Place) -> Self {
        Self {
            place,
            between: DVec2::ZERO,
            minimum: true,
        }
    }
}

/// At which positions of a block a template is valid.
#[derive(Default)]
pub(super) struct Valid {
    side: usize,
    flags: Vec<u8>,
}

impl Valid {
    /// Finds out for `side`² positions from `first` on; false if there is none.
    pub(super) fn find(
        &mut self,
        template: &Template,
        level: &Level,
        first: IVec2,
        side: usize,
    ) -> bool {
        self.side = side;
        self.flags.clear();
        self.flags.resize(side * side, 0);
        let rows: Vec<(usize, usize, usize)> = template
            .rows
            .iter()
            .enumerate()
            .filter(|(_, row)| row.1 > 0)
            .map(|(row, &(from, to))| (row, from, to))
            .collect();
        let (Some(top), Some(bottom)) = (rows.first(), rows.last()) else {
            return false;
        };
        let low = rows.iter().fold(usize::MAX, |low, row| low.min(row.1)) as i32;
        let high = rows.iter().fold(0, |high, row| high.max(row.2)) as i32;
        // positions at which the whole fragment is in the buffer
        let from = (-low - first.x).clamp(0, side as i32) as usize;
        let to = (level.width as i32 - high + 1 - first.x).clamp(0, side as i32) as usize;
        if from >= to {
            return false;
        }
        let mut any = 0;
        for (dy, flags) in self.flags.chunks_exact_mut(side).enumerate() {
            let y = first.y + dy as i32;
            if y + (top.0 as i32) < 0 || y + bottom.0 as i32 >= level.height as i32 {
                continue;
            }
            let flags = &mut flags[from..to];
            flags.fill(1);
            for &(row, start, end) in &rows {
                let line = (y + row as i32) as usize * level.width;
                let x = (first.x + from as i32 + start as i32) as usize;
                let need = (end - start) as u8;
                for (flag, &run) in flags.iter_mut().zip(&level.runs[line + x..]) {
                    *flag &= u8::from(run >= need);
                }
            }
            any |= flags.iter().fold(0, |any, flag| any | flag);
        }
        any > 0
    }

    /// For each position of a row 1 if it is valid.
    pub(super) fn row(&self, row: usize) -> &[u8] {
        &self.flags[row * self.side..][..self.side]
    }
}

/// The lowest minima and other positions of a block, at most as many of each as `counts` says.
pub(super) fn minima(
    field: &Field,
    valid: &Valid,
    counts: [usize; 2],
    buffer: usize,
    first: IVec2,
) -> Vec<Low> {
    let side = valid.side;
    let line = |row: usize| -> Vec<f32> {
        let values = field.row(row).iter().zip(valid.row(row));
        values
            .map(|(&value, &valid)| if valid > 0 { value } else { f32::INFINITY })
            .collect()
    };
    let mut found: Vec<(f32, u32)> = Vec::new();
    let mut slopes: Vec<(f32, u32)> = Vec::new();
    let mut limit = f32::INFINITY;
    let mut lines = [line(0), line(1), line(2)];
    let mut least = vec![0.0f32; side];
    for row in 1..side - 1 {
        let above_and_below = lines[0].iter().zip(&lines[1]).zip(&lines[2]);
        for (least, ((above, own), below)) in least.iter_mut().zip(above_and_below) {
            *least = above.min(*own).min(*below);
        }
        for col in 1..side - 1 {
            let value = lines[1][col];
            if value >= limit && value > least[col] {
                continue;
            }
            if value <= least[col - 1].min(least[col]).min(least[col + 1]) {
                if value < f32::INFINITY {
                    found.push((value, (row * side + col) as u32));
                }
            } else if value < limit {
                slopes.push((value, (row * side + col) as u32));
            }
        }
        if slopes.len() > 4 * counts[1] {
            lowest(&mut slopes, counts[1]);
            limit = slopes
                .iter()
                .fold(f32::NEG_INFINITY, |limit, slope| limit.max(slope.0));
        }
        lines.rotate_left(1);
        if row + 2 < side {
            lines[2] = line(row + 2);
        }
    }
    lowest(&mut found, counts[0]);
    lowest(&mut slopes, counts[1]);
    let at = |col: usize, row: usize| {
        if valid.row(row)[col] > 0 {
            field.row(row)[col]
        } else {
            f32::INFINITY
        }
    };
    let low = |(value, index): (f32, u32), minimum: bool| {
        let (row, col) = (index as usize / side, index as usize % side);
        let (x, dx) = bottom(at(col - 1, row), value, at(col + 1, row));
        let (y, dy) = bottom(at(col, row - 1), value, at(col, row + 1));
        Low {
            place: Place {
                buffer,
                corner: first + IVec2::new(col as i32, row as i32),
                score: value - x - y,
            },
            between: dvec2(dx, dy),
            minimum,
        }
    };
    let found = found.into_iter().map(|value| low(value, true));
    found
        .chain(slopes.into_iter().map(|value| low(value, false)))
        .collect()
}

/// Leaves the `count` lowest, in any order.
fn lowest(values: &mut Vec<(f32, u32)>, count: usize) {
    if values.len() > count {
        values.select_nth_unstable_by(count, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        values.truncate(count);
    }
}

/// Depth of a parabola through three values below its middle value, and the place of its minimum. Farther than half a
/// pixel away there is no bottom.
pub(super) fn bottom(before: f32, value: f32, after: f32) -> (f32, f64) {
    let (bend, slope) = (before + after - 2.0 * value, before - after);
    if !bend.is_finite() || bend <= 0.0 || slope.abs() > bend {
        return (0.0, 0.0);
    }
    (slope * slope / (8.0 * bend), f64::from(0.5 * slope / bend))
}

//! A lower triangular factor in panels: neighboring columns whose entries lie in the same rows.
//!
//! ```text
//! for each panel: gather what its rows have, eliminate its columns one after the other, scatter
//! then the panels from the last to the first, transposed
//! ```
//!
//! Separators of a nested dissection are such panels, and hold most of the entries. Within one the rows are written once and
//! not with each entry, and what is read lies together: solving reads all of the factor twice, which is what takes the time.
//!
//! Source: E. Ng and B. Peyton, "Block sparse Cholesky algorithms on advanced uniprocessor computers", 1993 (supernodes).

use std::ops::{Add, Div, Mul, Sub};

/// Columns of a factor with the same rows below them.
#[derive(Debug, Clone, Copy)]
struct Panel {
    /// The first column, and row.
    first: usize,
    columns: usize,
    /// Entries of the first column, with that on the diagonal. Each further column has one less.
    height: usize,
    /// Start of the rows below its columns.
    rows: usize,
    /// Index of its first entry; entries come column by column.
    values: usize,
}

/// Precision in which entries are stored.
pub(crate) trait Entry:
    Copy + Default + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self>
{
}

impl<T> Entry for T where
    T: Copy + Default + Add<Output = T> + Sub<Output = T> + Mul<Output = T> + Div<Output = T>
{
}

#[derive(Debug, Clone)]
pub(crate) struct PanelFactor<T> {
    panels: Vec<Panel>,
    rows: Vec<u32>,
    values: Vec<T>,
    highest: usize,
}

impl PanelFactor<f64> {
    /// The lower triangle by columns: where the entries of each column begin and end, their rows in ascending order with the
    /// diagonal first, and their values.
    pub(crate) fn new(offsets: &[usize], rows: &[usize], values: Vec<f64>) -> Self {
        let mut panels: Vec<Panel> = Vec::new();
        let mut kept = Vec::new();
        let size = offsets.len() - 1;
        let mut first = 0;
        while first < size {
            let column = |col: usize| &rows[offsets[col]..offsets[col + 1]];
            let mut end = first + 1;
            // the rows of a column without its own are those of the next
            while end < size && column(end - 1)[1..] == *column(end) {
                end += 1;
            }
            panels.push(Panel {
                first,
                columns: end - first,
                height: column(first).len(),
                rows: kept.len(),
                values: offsets[first],
            });
            kept.extend(column(end - 1)[1..].iter().map(|&row| row as u32));
            first = end;
        }
        Self {
            highest: panels.iter().map(|panel| panel.height).max().unwrap_or(0),
            panels,
            rows: kept,
            values,
        }
    }

    /// The same with half the digits, in half the memory.
    pub(crate) fn single(self) -> PanelFactor<f32> {
        PanelFactor {
            panels: self.panels,
            rows: self.rows,
            values: self.values.into_iter().map(|value| value as f32).collect(),
            highest: self.highest,
        }
    }
}

impl<T: Entry> PanelFactor<T> {
    /// Solves L Lᵀ x = `x` in place.
    pub(crate) fn solve_in_place(&self, x: &mut [T]) {
        let mut work = vec![T::default(); self.highest];
        for panel in &self.panels {
            let rows = self.rows_of(panel);
            if panel.columns == 1 {
                // without the detour
                let column = self.column(panel, 0);
                let solved = x[panel.first] / column[0];
                x[panel.first] = solved;
                for (&row, &value) in rows.iter().zip(&column[1..]) {
                    x[row as usize] = x[row as usize] - value * solved;
                }
                continue;
            }
            let work = &mut work[..panel.height];
            let (own, below) = work.split_at_mut(panel.columns);
            own.copy_from_slice(&x[panel.first..][..panel.columns]);
            below.fill(T::default());
            self.eliminate(panel, work);
            let (own, below) = work.split_at(panel.columns);
            x[panel.first..][..panel.columns].copy_from_slice(own);
            for (&row, &change) in rows.iter().zip(below) {
                x[row as usize] = x[row as usize] + change;
            }
        }
        for panel in self.panels.iter().rev() {
            let work = &mut work[..panel.height];
            let (own, below) = work.split_at_mut(panel.columns);
            own.copy_from_slice(&x[panel.first..][..panel.columns]);
            for (&row, value) in self.rows_of(panel).iter().zip(below) {
                *value = x[row as usize];
            }
            self.substitute(panel, work);
            x[panel.first..][..panel.columns].copy_from_slice(&work[..panel.columns]);
        }
    }

    fn rows_of(&self, panel: &Panel) -> &[u32] {
        &self.rows[panel.rows..][..panel.height - panel.columns]
    }

    /// The entries of a column of a panel, from the diagonal on.
    fn column(&self, panel: &Panel, index: usize) -> &[T] {
        let before = index * panel.height - index * index.saturating_sub(1) / 2;
        &self.values[panel.values + before..][..panel.height - index]
    }

    /// Solves for the columns of a panel, and takes them off from what is below. Two columns go together where there are two, so
    /// that what is below is read and written half as often.
    fn eliminate(&self, panel: &Panel, work: &mut [T]) {
        let mut index = 0;
        while index + 1 < panel.columns {
            let (a, b) = (self.column(panel, index), self.column(panel, index + 1));
            let first = work[index] / a[0];
            let second = (work[index + 1] - a[1] * first) / b[0];
            work[index] = first;
            work[index + 1] = second;
            for ((value, &a), &b) in work[index + 2..].iter_mut().zip(&a[2..]).zip(&b[1..]) {
                *value = *value - (a * first + b * second);
            }
            index += 2;
        }
        if index < panel.columns {
            let a = self.column(panel, index);
            let first = work[index] / a[0];
            work[index] = first;
            for (value, &a) in work[index + 1..].iter_mut().zip(&a[1..]) {
                *value = *value - a * first;
            }
        }
    }

    /// Solves for the columns of a panel, given all that is below.
    fn substitute(&self, panel: &Panel, work: &mut [T]) {
        for index in (0..panel.columns).rev() {
            let a = self.column(panel, index);
            work[index] = (work[index] - dot(&a[1..], &work[index + 1..])) / a[0];
        }
    }
}

/// The sum of products, eight sums side by side.
fn dot<T: Entry>(a: &[T], b: &[T]) -> T {
    let mut sums = [T::default(); 8];
    let (blocks_a, rest_a) = a.as_chunks::<8>();
    let (blocks_b, rest_b) = b.as_chunks::<8>();
    for (a, b) in blocks_a.iter().zip(blocks_b) {
        for (sum, (&a, &b)) in sums.iter_mut().zip(a.iter().zip(b)) {
            *sum = *sum + a * b;
        }
    }
    let rest = rest_a.iter().zip(rest_b).map(|(&a, &b)| a * b);
    rest.chain(sums).fold(T::default(), Add::add)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A lower triangle of some entries, by columns and as a dense matrix.
    struct Lower {
        offsets: Vec<usize>,
        rows: Vec<usize>,
        values: Vec<f64>,
        dense: Vec<Vec<f64>>,
    }

    fn lower(size: usize, value: impl Fn(usize, usize) -> Option<f64>) -> Lower {
        let mut all = Lower {
            offsets: vec![0],
            rows: Vec::new(),
            values: Vec::new(),
            dense: vec![vec![0.0; size]; size],
        };
        for col in 0..size {
            for row in col..size {
                let entry = if row == col {
                    Some(1.5)
                } else {
                    value(row, col)
                };
                if let Some(entry) = entry {
                    all.rows.push(row);
                    all.values.push(entry);
                    all.dense[row][col] = entry;
                }
            }
            all.offsets.push(all.rows.len());
        }
        all
    }

    /// `L Lᵀ x`.
    fn times(dense: &[Vec<f64>], x: &[f64]) -> Vec<f64> {
        let size = x.len();
        let transposed: Vec<f64> = (0..size)
            .map(|col| (0..size).map(|row| dense[row][col] * x[row]).sum())
            .collect();
        dense
            .iter()
            .map(|row| row.iter().zip(&transposed).map(|(l, t)| l * t).sum())
            .collect()
    }

    proptest! {
        #[test]
        fn what_is_solved_for_gives_back_the_right_side(
            size in 1usize..40,
            // blocks of columns with like rows, and columns that stand alone
            block in 1usize..12,
            holes in prop::collection::vec(any::<bool>(), 31),
            entries in prop::collection::vec(-0.3f64..0.3, 17),
        ) {
            let lower = lower(size, |row, col| {
                let within = row / block == col / block;
                let kept = within || holes[(row * 5 + col / block) % 31];
                kept.then(|| entries[(row * 3 + col * 7) % 17])
            });
            let x: Vec<f64> = (0..size).map(|k| ((k * 37) % 11) as f64 - 5.0).collect();
            let right = times(&lower.dense, &x);
            let panels = PanelFactor::new(&lower.offsets, &lower.rows, lower.values.clone());
            let mut found = right.clone();
            panels.solve_in_place(&mut found);
            let back = times(&lower.dense, &found);
            let largest = found.iter().chain(&right).fold(1.0f64, |m, v| m.max(v.abs()));
            for (a, b) in back.iter().zip(&right) {
                // the largest value times the size and the digits of the type
                prop_assert!((a - b).abs() <= 1e-12 * largest, "{} for {}", a, b);
            }
            let mut single: Vec<f32> = right.iter().map(|&v| v as f32).collect();
            panels.single().solve_in_place(&mut single);
            let back = times(&lower.dense, &single.iter().map(|&v| f64::from(v)).collect::<Vec<_>>());
            for (a, b) in back.iter().zip(&right) {
                prop_assert!((a - b).abs() <= 1e-4 * largest, "{} for {}", a, b);
            }
        }
    }

    #[test]
    fn columns_with_like_rows_are_one_panel() {
        let full = lower(9, |_, _| Some(0.1));
        let panels = PanelFactor::new(&full.offsets, &full.rows, full.values);
        assert_eq!(panels.panels.len(), 1);
        assert!(panels.rows.is_empty());
        // of a chain only the last two have none below that the other lacks
        let chain = lower(9, |row, col| (row == col + 1).then_some(0.1));
        let panels = PanelFactor::new(&chain.offsets, &chain.rows, chain.values);
        assert_eq!(panels.panels.len(), 8);
    }
}

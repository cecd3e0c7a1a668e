//! Sparse symmetric systems: sums of squares over thousands of unknowns, factored once and solved many times.
//!
//! ```text
//! order the unknowns so that few entries appear: cut the set in two halves and a separator between them, again and again
//! factor P A Pᵀ = L Lᵀ
//! for each right-hand side: solve L y = P b, then Lᵀ P x = y
//! ```
//!
//! The factorization is that of `nalgebra-sparse`, which takes the unknowns in the order in which they come. The order is
//! ours: unknowns have positions in the plane, and separators are taken across the longer side of what is to be cut. On a
//! grid of n vertices the factor then has O(n log n) entries and takes O(n^1.5) operations, against O(n^1.5) and O(n²) row
//! by row.
//!
//! Source: A. George, "Nested dissection of a regular finite element mesh", 1973.
//!
//! Guarantees: the same bits on any number of threads. Does not guarantee: more digits than the condition of the matrix
//! leaves.

use crate::panels::{Entry, PanelFactor};
use nalgebra_sparse::factorization::{CscCholesky, CscSymbolicCholesky};
use nalgebra_sparse::pattern::SparsityPattern;

/// Squares of sparse linear forms, on their way to a matrix: `Σ weight · (Σ coefficient · x)²`.
#[derive(Debug, Clone)]
pub struct SquareSum {
    size: usize,
    entries: Vec<(u32, u32, f64)>,
}

impl SquareSum {
    /// A sum of nothing over `size` unknowns.
    pub fn new(size: usize) -> Self {
        Self {
            size,
            entries: Vec::new(),
        }
    }

    /// Adds `weight · (Σ coefficient · x)²`. A coefficient of 0 keeps a place in the pattern.
    pub fn add(&mut self, form: &[(usize, f64)], weight: f64) {
        for &(row, a) in form {
            for &(col, b) in form {
                self.entries.push((row as u32, col as u32, weight * a * b));
            }
        }
    }

    /// The matrix A with `xᵀ A x` equal to the sum.
    ///
    /// # Panics
    /// If an unknown is not below the size.
    pub fn matrix(&self) -> SparseSymmetric {
        let mut offsets = vec![0usize; self.size + 1];
        for &(_, col, _) in &self.entries {
            offsets[col as usize + 1] += 1;
        }
        for col in 0..self.size {
            offsets[col + 1] += offsets[col];
        }
        let mut next = offsets.clone();
        let mut sorted = vec![(0u32, 0.0f64); self.entries.len()];
        for &(row, col, value) in &self.entries {
            sorted[next[col as usize]] = (row, value);
            next[col as usize] += 1;
        }
        let mut matrix = SparseSymmetric {
            size: self.size,
            offsets: vec![0],
            rows: Vec::new(),
            values: Vec::new(),
        };
        for col in 0..self.size {
            let column = &mut sorted[offsets[col]..offsets[col + 1]];
            // stable, so that equal places are summed in the order in which they came
            column.sort_by_key(|&(row, _)| row);
            let first = matrix.rows.len();
            for &(row, value) in column.iter() {
                if matrix.rows.len() > first && matrix.rows.last() == Some(&(row as usize)) {
                    if let Some(last) = matrix.values.last_mut() {
                        *last += value;
                    }
                } else {
                    matrix.rows.push(row as usize);
                    matrix.values.push(value);
                }
            }
            matrix.offsets.push(matrix.rows.len());
        }
        matrix
    }
}

/// A symmetric matrix of which the entries other than 0 are kept.
#[derive(Debug, Clone)]
pub struct SparseSymmetric {
    size: usize,
    offsets: Vec<usize>,
    rows: Vec<usize>,
    values: Vec<f64>,
}

impl SparseSymmetric {
    /// Rows, and columns.
    pub fn size(&self) -> usize {
        self.size
    }

    /// The entries of a column: their rows in ascending order, and their values.
    ///
    /// # Panics
    /// If there is no such column.
    pub fn column(&self, col: usize) -> impl Iterator<Item = (usize, f64)> {
        let range = self.offsets[col]..self.offsets[col + 1];
        let values = self.values[range.clone()].iter().copied();
        self.rows[range].iter().copied().zip(values)
    }

    /// The matrix times a vector.
    ///
    /// # Panics
    /// If the vector is shorter than the size.
    pub fn times(&self, x: &[f64]) -> Vec<f64> {
        (0..self.size)
            .map(|col| self.column(col).map(|(row, value)| value * x[row]).sum())
            .collect()
    }

    /// The mean of the entries on the diagonal; 0 for a matrix without rows.
    pub fn mean_diagonal(&self) -> f64 {
        let on_diagonal = (0..self.size)
            .flat_map(|col| self.column(col).filter(move |&(row, _)| row == col))
            .map(|(_, value)| value);
        on_diagonal.sum::<f64>() / self.size.max(1) as f64
    }
}

/// In which order unknowns are eliminated, and which entries that makes: found once for all matrices with one pattern.
#[derive(Debug, Clone)]
pub struct EliminationPlan {
    /// The place of each unknown in the order.
    place: Vec<usize>,
    offsets: Vec<usize>,
    rows: Vec<usize>,
    /// Position of each entry in the permuted matrix.
    slots: Vec<usize>,
    symbolic: CscSymbolicCholesky,
}

/// Sets of unknowns that are not cut any more. Smaller sets save few entries, larger ones cost.
const LEAF: usize = 24;

impl EliminationPlan {
    /// A plan for matrices with the pattern of `matrix`, whose unknowns lie at `positions`, in any unit. Unknowns without a
    /// position come last: those that are linked to many others.
    ///
    /// `None` if there are not as many positions as unknowns, or if the pattern is not symmetric.
    pub fn new(matrix: &SparseSymmetric, positions: &[Option<[f64; 2]>]) -> Option<Self> {
        let size = matrix.size;
        if positions.len() != size {
            return None;
        }
        let mut placed: Vec<(u32, [f64; 2])> = Vec::with_capacity(size);
        let mut last = Vec::new();
        for (unknown, position) in positions.iter().enumerate() {
            match position {
                Some(at) if at.iter().all(|v| v.is_finite()) => placed.push((unknown as u32, *at)),
                _ => last.push(unknown as u32),
            }
        }
        let mut order = Vec::with_capacity(size);
        dissect(matrix, placed, &mut order, &mut Marks(vec![0; size], 0));
        order.extend(last);
        let mut place = vec![0usize; size];
        for (rank, &unknown) in order.iter().enumerate() {
            place[unknown as usize] = rank;
        }
        let mut offsets = vec![0usize];
        let mut rows = Vec::with_capacity(matrix.rows.len());
        let mut slots = vec![0usize; matrix.rows.len()];
        let mut column: Vec<(usize, usize)> = Vec::new();
        for &unknown in &order {
            let unknown = unknown as usize;
            let entries = matrix.offsets[unknown]..matrix.offsets[unknown + 1];
            column.clear();
            column.extend(entries.map(|entry| (place[matrix.rows[entry]], entry)));
            column.sort_unstable();
            for &(row, entry) in &column {
                slots[entry] = rows.len();
                rows.push(row);
            }
            offsets.push(rows.len());
        }
        let pattern =
            SparsityPattern::try_from_offsets_and_indices(size, size, offsets, rows).ok()?;
        if pattern.transpose() != pattern {
            return None;
        }
        Some(Self {
            place,
            offsets: matrix.offsets.clone(),
            rows: matrix.rows.clone(),
            slots,
            symbolic: CscSymbolicCholesky::factor(pattern),
        })
    }

    /// Number of entries of a factor.
    pub fn factor_entries(&self) -> usize {
        self.symbolic.l_pattern().nnz()
    }

    /// Factors a matrix with the pattern of the plan.
    ///
    /// `None` if the pattern is another one, or if the matrix is not positive definite.
    pub fn factor(&self, matrix: &SparseSymmetric) -> Option<SparseCholesky> {
        if matrix.offsets != self.offsets || matrix.rows != self.rows {
            return None;
        }
        let mut values = vec![0.0; matrix.values.len()];
        for (&slot, &value) in self.slots.iter().zip(&matrix.values) {
            values[slot] = value;
        }
        let factor = CscCholesky::factor_numerical(self.symbolic.clone(), &values).ok()?;
        let lower = factor.take_l();
        // a matrix of NaN passes every comparison of the factorization but leaves its mark
        lower.values().iter().all(|v| v.is_finite()).then(|| {
            let (offsets, rows, values) = lower.disassemble();
            SparseCholesky {
                place: self.place.clone(),
                panels: PanelFactor::new(&offsets, &rows, values),
            }
        })
    }
}

/// Marks of the unknowns in the part under examination: those with the current number.
struct Marks(Vec<u32>, u32);

/// Appends `part` to `order`: one half, the other half, and what separates them.
fn dissect(
    matrix: &SparseSymmetric,
    part: Vec<(u32, [f64; 2])>,
    order: &mut Vec<u32>,
    marks: &mut Marks,
) {
    let extent = |axis: usize| {
        let values = part.iter().map(|(_, at)| at[axis]);
        let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| {
            (low.min(v), high.max(v))
        });
        high - low
    };
    let axis = usize::from(part.len() > 1 && extent(1) > extent(0));
    if part.len() <= LEAF || extent(axis) <= 0.0 {
        order.extend(part.iter().map(|&(unknown, _)| unknown));
        return;
    }
    let mut along: Vec<f64> = part.iter().map(|(_, at)| at[axis]).collect();
    along.sort_unstable_by(f64::total_cmp);
    let (lowest, median) = (along[0], along[along.len() / 2]);
    // above the lowest, so that both halves have members
    let cut = if median > lowest {
        median
    } else {
        along
            .iter()
            .copied()
            .find(|&v| v > lowest)
            .unwrap_or(median)
    };
    let (low, high): (Vec<_>, Vec<_>) = part.into_iter().partition(|(_, at)| at[axis] < cut);
    marks.1 += 1;
    for &(unknown, _) in &low {
        marks.0[unknown as usize] = marks.1;
    }
    let (separator, high): (Vec<_>, Vec<_>) = high.into_iter().partition(|&(unknown, _)| {
        matrix
            .column(unknown as usize)
            .any(|(row, _)| marks.0[row] == marks.1)
    });
    dissect(matrix, low, order, marks);
    dissect(matrix, high, order, marks);
    order.extend(separator.iter().map(|&(unknown, _)| unknown));
}

/// A factored matrix: each right-hand side costs two operations an entry of the factor.
#[derive(Debug, Clone)]
pub struct SparseCholesky {
    place: Vec<usize>,
    panels: PanelFactor<f64>,
}

impl SparseCholesky {
    /// Replaces `right` by the x with A · x = `right`.
    ///
    /// # Panics
    /// If `right` has another size than the matrix.
    pub fn solve_in_place(&self, right: &mut [f64]) {
        assert_eq!(
            right.len(),
            self.place.len(),
            "the right-hand side has another size"
        );
        solve(&self.place, &self.panels, right);
    }

    /// The same factor in half the memory, which is twice as fast where memory is what takes the time.
    pub fn single_precision(self) -> SingleCholesky {
        SingleCholesky {
            place: self.place,
            panels: self.panels.single(),
        }
    }
}

/// A factored matrix with about seven digits, less those that the condition of the matrix takes: for corrections of what is
/// known better.
#[derive(Debug, Clone)]
pub struct SingleCholesky {
    place: Vec<usize>,
    panels: PanelFactor<f32>,
}

impl SingleCholesky {
    /// Replaces `right` by nearly the x with A · x = `right`.
    ///
    /// # Panics
    /// If `right` has another size than the matrix.
    pub fn solve_in_place(&self, right: &mut [f32]) {
        assert_eq!(
            right.len(),
            self.place.len(),
            "the right-hand side has another size"
        );
        solve(&self.place, &self.panels, right);
    }
}

/// Solves in the order of elimination.
fn solve<T: Entry>(place: &[usize], panels: &PanelFactor<T>, right: &mut [T]) {
    let mut x = vec![T::default(); right.len()];
    for (&place, &value) in place.iter().zip(right.iter()) {
        x[place] = value;
    }
    panels.solve_in_place(&mut x);
    for (&place, value) in place.iter().zip(right.iter_mut()) {
        *value = x[place];
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};
    use proptest::prelude::*;

    /// Springs between the vertices of a grid, second differences, and one unknown that is linked to every third vertex.
    fn grid_system(
        cols: usize,
        rows: usize,
        stiffness: &[f64],
    ) -> (SquareSum, Vec<Option<[f64; 2]>>) {
        let vertex = |col: usize, row: usize| row * cols + col;
        let mut sum = SquareSum::new(cols * rows + 1);
        let weight = |k: usize| stiffness[k % stiffness.len()];
        for row in 0..rows {
            for col in 0..cols {
                let here = vertex(col, row);
                sum.add(&[(here, 1.0)], 1e-3);
                if col + 1 < cols {
                    sum.add(&[(here, -1.0), (vertex(col + 1, row), 1.0)], weight(here));
                }
                if row + 2 < rows {
                    let form = [
                        (here, 1.0),
                        (vertex(col, row + 1), -2.0),
                        (vertex(col, row + 2), 1.0),
                    ];
                    sum.add(&form, weight(here + 1));
                }
                if here.is_multiple_of(3) {
                    sum.add(&[(here, 1.0), (cols * rows, -1.0)], 0.5);
                }
            }
        }
        let at = |k: usize| (k < cols * rows).then(|| [(k % cols) as f64, (k / cols) as f64]);
        (sum, (0..=cols * rows).map(at).collect())
    }

    proptest! {
        #[test]
        fn solutions_agree_with_a_dense_factorization(
            cols in 1usize..14,
            rows in 1usize..14,
            stiffness in prop::collection::vec(0.02f64..2.0, 7),
        ) {
            let (sum, positions) = grid_system(cols, rows, &stiffness);
            let matrix = sum.matrix();
            let n = matrix.size();
            let dense = DMatrix::from_fn(n, n, |row, col| {
                matrix.column(col).find(|&(r, _)| r == row).map_or(0.0, |(_, value)| value)
            });
            let right: Vec<f64> = (0..n).map(|k| ((k * 37) % 11) as f64 - 5.0).collect();
            let expected = dense.cholesky().unwrap().solve(&DVector::from_vec(right.clone()));
            let mut found = right.clone();
            EliminationPlan::new(&matrix, &positions).unwrap().factor(&matrix).unwrap().solve_in_place(&mut found);
            let largest = expected.iter().fold(1.0f64, |m, v| m.max(v.abs()));
            for (a, b) in found.iter().zip(expected.iter()) {
                // a condition of some 10⁵ costs as many of the sixteen digits
                prop_assert!((a - b).abs() < 1e-9 * largest, "{a} {b}");
            }
            let back = matrix.times(&found);
            for (a, b) in back.iter().zip(&right) {
                prop_assert!((a - b).abs() < 1e-9 * largest);
            }
        }
    }

    #[test]
    fn every_unknown_is_eliminated_once_also_where_all_lie_in_one_place() {
        let (sum, mut positions) = grid_system(9, 7, &[1.0]);
        for at in positions.iter_mut().take(40) {
            *at = Some([2.0, 2.0]);
        }
        let plan = EliminationPlan::new(&sum.matrix(), &positions).unwrap();
        let mut places = plan.place.clone();
        places.sort_unstable();
        assert!(places.iter().enumerate().all(|(k, &place)| k == place));
    }

    #[test]
    fn dissection_makes_fewer_entries_than_rows_in_order() {
        let (sum, positions) = grid_system(60, 40, &[1.0]);
        let matrix = sum.matrix();
        let dissected = EliminationPlan::new(&matrix, &positions).unwrap();
        let in_order = EliminationPlan::new(&matrix, &vec![None; matrix.size()]).unwrap();
        assert!(2 * dissected.factor_entries() < in_order.factor_entries());
    }

    #[test]
    fn what_cannot_be_factored_is_refused() {
        let (sum, positions) = grid_system(5, 5, &[1.0]);
        let plan = EliminationPlan::new(&sum.matrix(), &positions).unwrap();
        let mut negative = sum.clone();
        negative.add(&[(3, 1.0)], -10.0);
        assert!(plan.factor(&negative.matrix()).is_none());
        let mut unknown = sum.clone();
        unknown.add(&[(3, 1.0)], f64::NAN);
        assert!(plan.factor(&unknown.matrix()).is_none());
        let mut other = sum.clone();
        other.add(&[(0, 1.0), (24, 1.0)], 1.0);
        assert!(plan.factor(&other.matrix()).is_none());
        assert!(EliminationPlan::new(&sum.matrix(), &positions[1..]).is_none());
    }
}

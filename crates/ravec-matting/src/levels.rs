//! The matting Laplacian on levels of a picture, each at half the size of the one before.
//!
//! Conjugate gradients carry alpha a few pixels a step. What is smooth over a wide unknown part is solved at a coarse level instead,
//! and added to the start at the next finer one: details of the start stay.

use crate::half::{doubled, halved_of};
use crate::laplacian::{DataTerm, MattingLaplacian, Unknowns};
use crate::matte::{Colors, MattingError};
use ravec_progress::Progress;
use ravec_raster::{Plane, Reduction, halved};

/// Unknown pixels below which a level has no coarser one.
const MIN_UNKNOWNS: usize = 2000;
/// Largest number of levels.
const MAX_LEVELS: usize = 5;
/// Steps of the solver at the coarse levels. More of them follow the Laplacian where the likelihood knows better.
const COARSE_STEPS: usize = 12;

/// The matting Laplacians of a picture, the finest one first.
pub(crate) struct Levels(Vec<MattingLaplacian>);

impl Levels {
    pub fn new(colors: &Colors, unknowns: Unknowns) -> Self {
        let mut levels = vec![MattingLaplacian::new(colors, unknowns)];
        let mut colors = halved(colors, Reduction::Area);
        while let Some(last) = levels.last()
            && levels.len() < MAX_LEVELS
            && last.unknowns().len() >= MIN_UNKNOWNS
        {
            let unknowns = last.unknowns().halved();
            levels.push(MattingLaplacian::new(&colors, unknowns));
            colors = halved(&colors, Reduction::Area);
        }
        Self(levels)
    }

    /// The unknown pixels of the picture.
    pub fn unknowns(&self) -> &Unknowns {
        self.0[0].unknowns()
    }

    /// Approximates the minimum of αᵀLα + Σ wᵢ(αᵢ − aᵢ)² over the unknown pixels of `alpha`; the others stay as they are. The finest
    /// level takes at most `max_steps` steps.
    ///
    /// # Errors
    /// [`MattingError::Cancelled`].
    pub fn solve(
        &self,
        data: &DataTerm,
        alpha: &mut Plane,
        max_steps: usize,
        progress: &Progress,
    ) -> Result<(), MattingError> {
        solve(&self.0, data, alpha, max_steps, progress)
    }
}

fn solve(
    levels: &[MattingLaplacian],
    data: &DataTerm,
    alpha: &mut Plane,
    max_steps: usize,
    progress: &Progress,
) -> Result<(), MattingError> {
    let Some((fine, coarse)) = levels.split_first() else {
        return Ok(());
    };
    if let Some(next) = coarse.first() {
        let [start] = halved_of(alpha.size(), |row, [line]| {
            line.copy_from_slice(alpha.row(row));
        });
        let mut correction = start.clone();
        let data = data.halved(fine.unknowns(), next.unknowns());
        solve(coarse, &data, &mut correction, COARSE_STEPS, progress)?;
        for (value, start) in correction.pixels_mut().iter_mut().zip(start.pixels()) {
            *value -= start;
        }
        let correction = doubled(&correction, alpha.size());
        for at in fine.unknowns().positions() {
            alpha[at] = (alpha[at] + correction[at]).clamp(0.0, 1.0);
        }
    }
    fine.solve(data, alpha, max_steps, progress)
}

#[cfg(test)]
mod tests {
    use super::*;
    use ravec_raster::{Image, Size};

    #[test]
    fn alpha_crosses_a_wide_unknown_part_in_few_steps() {
        // windows of one color want alpha to be constant: together they have the ramp as solution
        let size = Size::new(256, 120).unwrap();
        let truth = Plane::from_fn(size, |col, _| ((col as f32 - 39.0) / 181.0).clamp(0.0, 1.0));
        let colors: Colors = Image::new(size, [0.5, 0.4, 0.3]);
        let is_unknown = |col: usize, _: usize| (40..220).contains(&col);
        let error = |is_single: bool| {
            let mut levels = Levels::new(&colors, Unknowns::new(size, is_unknown));
            assert!(levels.0.len() > 2);
            if is_single {
                levels.0.truncate(1);
            }
            let count = levels.unknowns().len();
            let data = DataTerm {
                alpha: vec![0.5; count],
                weight: vec![1e-7; count],
            };
            let mut alpha = truth.clone();
            for at in levels.unknowns().positions() {
                alpha[at] = 0.5;
            }
            levels
                .solve(&data, &mut alpha, 16, &Progress::none())
                .unwrap();
            let pairs = alpha.pixels().iter().zip(truth.pixels());
            pairs.map(|(a, b)| (a - b).abs()).sum::<f32>() / count as f32
        };
        let (single, levels) = (error(true), error(false));
        assert!(
            levels < 0.03 && levels < 0.3 * single,
            "{levels} of {single}"
        );
    }
}

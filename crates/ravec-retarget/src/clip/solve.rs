//! Deformations of a key time, for all target sizes.

use super::content::Seen;
use super::options::ClipOptions;
use crate::deformation::Deformation;
use crate::grid::Grid;
use crate::params::RetargetError;
use crate::retargeter::{Retargeter, as_vector};
use ravec_raster::Size;
use std::sync::Arc;

/// What was seen, and the deformations that it leads to.
#[derive(Debug)]
pub(super) struct Solution {
    pub(super) seen: Seen,
    /// One for each target.
    pub(super) deformations: Vec<Deformation>,
}

impl Solution {
    /// Factors the energies of what is seen once, and solves for each target.
    pub(super) fn new(
        seen: Seen,
        grid: &Arc<Grid>,
        targets: &[Size],
        options: &ClipOptions,
    ) -> Result<Self, RetargetError> {
        let retargeter = Retargeter::from_content(
            &options.still_params(),
            grid.clone(),
            seen.weights.clone(),
            seen.runs.clone(),
            seen.mean_importance,
        )?;
        let deformations = targets
            .iter()
            .map(|&target| {
                let factor = as_vector(target) / as_vector(grid.image_size);
                let share = if options.fit_paths {
                    seen.path_share(factor, options.object_scale)
                } else {
                    1.0
                };
                let mut found = retargeter.solve_scaled(target, share * options.object_scale)?;
                found.state = None;
                Ok(found)
            })
            .collect::<Result<_, RetargetError>>()?;
        Ok(Self { seen, deformations })
    }
}

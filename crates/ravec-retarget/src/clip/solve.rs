//! Deformations of a key time, for all target sizes.

use super::content::Seen;
use super::options::ClipOptions;
use crate::deformation::Deformation;
use crate::grid::Grid;
use crate::params::RetargetError;
use crate::retargeter::{KnownContent, Retargeter, as_vector};
use glam::DVec2;
use ravec_raster::Size;
use std::sync::Arc;

/// Observations, and the deformations that they lead to.
#[derive(Debug)]
pub(super) struct Solution {
    pub(super) seen: Seen,
    /// One for each target.
    pub(super) deformations: Arc<Vec<Deformation>>,
    /// Kept where the camera moves.
    retargeter: Option<Retargeter>,
}

impl Solution {
    /// Factors the energies of what is seen once, and solves for each target.
    pub(super) fn new(
        seen: Seen,
        grid: &Arc<Grid>,
        targets: &[Size],
        options: &ClipOptions,
        moving: bool,
    ) -> Result<Self, RetargetError> {
        let retargeter = Retargeter::from_content(
            &options.still_params(),
            KnownContent {
                grid: grid.clone(),
                weights: seen.weights.clone(),
                runs: seen.runs.clone(),
                mean_importance: seen.mean_importance,
            },
            moving,
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
            .collect::<Result<Vec<Deformation>, RetargetError>>()?;
        Ok(Self {
            seen,
            deformations: Arc::new(deformations),
            retargeter: moving.then_some(retargeter),
        })
    }

    /// The vertices of the deformation whose edges are nearest to `edges`, in the measure of the energy; those of the
    /// deformation itself if the camera was not known to move.
    pub(super) fn nearest(&self, target: usize, edges: &[DVec2]) -> Vec<DVec2> {
        let found = &self.deformations[target];
        match &self.retargeter {
            Some(retargeter) => retargeter.nearest(found, edges),
            None => found.vertices.clone(),
        }
    }
}

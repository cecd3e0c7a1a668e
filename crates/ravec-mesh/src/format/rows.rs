//! Meshes that are written row by row, wherever they are kept.

use glam::DVec3;

use super::error::WriteMeshError;
use crate::TriMesh;

/// A mesh whose vertices and triangles can be gone through, again and again, in the same order.
///
/// Numbers of vertices are below [`Self::vertex_count`], and coordinates are finite. Errors of `visit` are handed on at once;
/// where rows are read from somewhere, its own errors are [`WriteMeshError::Io`].
pub trait MeshRows {
    /// How many vertices there are.
    fn vertex_count(&self) -> usize;

    /// How many triangles there are.
    fn triangle_count(&self) -> usize;

    /// Calls `visit` with each vertex.
    ///
    /// # Errors
    /// The first error of `visit`; [`WriteMeshError::Io`] if rows cannot be read.
    fn for_each_vertex(
        &self,
        visit: &mut dyn FnMut(DVec3) -> Result<(), WriteMeshError>,
    ) -> Result<(), WriteMeshError>;

    /// Calls `visit` with the vertices of each triangle, and where they are.
    ///
    /// # Errors
    /// As [`Self::for_each_vertex`].
    fn for_each_triangle(
        &self,
        visit: &mut dyn FnMut([u32; 3], [DVec3; 3]) -> Result<(), WriteMeshError>,
    ) -> Result<(), WriteMeshError>;
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
        visit: &mut dyn FnMut(DVec3) -> Result<(), WriteMeshError>,
    ) -> Result<(), WriteMeshError> {
        self.positions().iter().try_for_each(|&at| visit(at))
    }

    fn for_each_triangle(
        &self,
        visit: &mut dyn FnMut([u32; 3], [DVec3; 3]) -> Result<(), WriteMeshError>,
    ) -> Result<(), WriteMeshError> {
        let mut triangles = (0_u32..).zip(self.triangles());
        triangles.try_for_each(|(t, &corners)| visit(corners, self.corners(t)))
    }
}

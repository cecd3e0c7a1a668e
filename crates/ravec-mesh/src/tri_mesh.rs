//! A list of positions and a list of triangles.

use glam::DVec3;
use ravec_progress::{Cancelled, Progress};

use crate::Aabb;

/// A triangle soup: positions and, for each triangle, the indices of its three corners.
///
/// Nothing is promised but that indices are in range and coordinates finite: triangles may be degenerate, repeated,
/// flipped, may intersect and may leave holes. `check` finds whether more holds.
///
/// Right-handed; corners run counter-clockwise as seen from outside. Lengths are in the units of the file.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TriMesh {
    positions: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
}

/// Why positions and triangles do not make a mesh.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MeshError {
    /// A coordinate is infinite or not a number.
    #[error("vertex {vertex} has the invalid position ({}, {}, {}): coordinates must be finite", at.x, at.y, at.z)]
    NotFinite {
        /// Index of the first such vertex.
        vertex: usize,
        /// Its coordinates.
        at: DVec3,
    },
    /// A triangle names a vertex that does not exist.
    #[error(
        "triangle {triangle} refers to vertex {vertex}, but there are only {vertices} vertices"
    )]
    NoSuchVertex {
        /// Index of the first such triangle.
        triangle: usize,
        /// The index it names.
        vertex: u32,
        /// Number of vertices of the mesh.
        vertices: usize,
    },
    /// More vertices or triangles than 32-bit indices can name.
    #[error("{count} {what} are more than the 4 294 967 295 that a mesh can hold")]
    TooMany {
        /// Kind of the elements: vertices or triangles.
        what: &'static str,
        /// Number of them.
        count: usize,
    },
}

/// Number of vertices or triangles that are processed between two checks for cancellation: some milliseconds.
const AT_ONCE: usize = 1 << 20;

impl TriMesh {
    /// A mesh from its parts.
    ///
    /// # Errors
    /// [`MeshError::NotFinite`], [`MeshError::NoSuchVertex`] and [`MeshError::TooMany`].
    #[expect(clippy::missing_panics_doc, reason = "nobody cancels")]
    pub fn new(positions: Vec<DVec3>, triangles: Vec<[u32; 3]>) -> Result<Self, MeshError> {
        let made = Self::try_new(positions, triangles, &Progress::none());
        made.expect("a progress of its own is never cancelled")
    }

    /// A mesh from its parts, as [`Self::new`] makes it.
    ///
    /// # Errors
    /// [`Cancelled`] soon after `progress` is cancelled; inside, those of [`Self::new`].
    pub fn try_new(
        positions: Vec<DVec3>,
        triangles: Vec<[u32; 3]>,
        progress: &Progress,
    ) -> Result<Result<Self, MeshError>, Cancelled> {
        for (what, count) in [
            ("vertices", positions.len()),
            ("triangles", triangles.len()),
        ] {
            if u32::try_from(count).is_err() {
                return Ok(Err(MeshError::TooMany { what, count }));
            }
        }
        for (block, places) in positions.chunks(AT_ONCE).enumerate() {
            progress.check()?;
            if let Some(i) = places.iter().position(|at| !at.is_finite()) {
                let (vertex, at) = (block * AT_ONCE + i, places[i]);
                return Ok(Err(MeshError::NotFinite { vertex, at }));
            }
        }
        let vertices = positions.len();
        for (block, corners) in triangles.chunks(AT_ONCE).enumerate() {
            progress.check()?;
            let outside = |&v: &u32| v as usize >= vertices;
            if let Some(i) = corners.iter().position(|t| t.iter().any(outside)) {
                let vertex = corners[i].into_iter().find(outside).unwrap_or_default();
                return Ok(Err(MeshError::NoSuchVertex {
                    triangle: block * AT_ONCE + i,
                    vertex,
                    vertices,
                }));
            }
        }
        Ok(Ok(Self {
            positions,
            triangles,
        }))
    }

    /// The places of the vertices.
    pub fn positions(&self) -> &[DVec3] {
        &self.positions
    }

    /// The corners of the triangles, as indices into [`Self::positions`].
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// The places of the corners of `triangle`.
    ///
    /// # Panics
    /// If there is no such triangle.
    #[inline]
    pub fn corners(&self, triangle: u32) -> [DVec3; 3] {
        self.triangles[triangle as usize].map(|v| self.positions[v as usize])
    }

    /// The positions and the triangles.
    pub fn into_parts(self) -> (Vec<DVec3>, Vec<[u32; 3]>) {
        (self.positions, self.triangles)
    }

    /// The smallest box around the vertices that triangles use; empty if there are no triangles.
    pub fn bounds(&self) -> Aabb {
        let used = self
            .triangles
            .iter()
            .flatten()
            .map(|&v| self.positions[v as usize]);
        used.fold(Aabb::EMPTY, Aabb::with_point)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_that_do_not_fit_are_refused_with_the_culprit() {
        let nan = DVec3::new(0.0, f64::NAN, 0.0);
        assert!(matches!(
            TriMesh::new(vec![DVec3::ZERO, nan], vec![]),
            Err(MeshError::NotFinite { vertex: 1, .. })
        ));
        assert_eq!(
            TriMesh::new(vec![DVec3::ZERO], vec![[0, 0, 1]]),
            Err(MeshError::NoSuchVertex {
                triangle: 0,
                vertex: 1,
                vertices: 1
            })
        );
    }

    #[test]
    fn vertices_that_no_triangle_uses_do_not_widen_the_bounds() {
        let positions = vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::splat(9.0)];
        let mesh = TriMesh::new(positions, vec![[0, 1, 2]]).unwrap();
        assert_eq!(
            mesh.bounds(),
            Aabb::new(DVec3::ZERO, DVec3::new(1.0, 1.0, 0.0))
        );
    }
}

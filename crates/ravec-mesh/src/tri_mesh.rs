//! A list of positions and a list of triangles.

use glam::DVec3;

use crate::Aabb;

/// A triangle soup: positions and, for each triangle, the indices of its three corners.
///
/// Nothing is promised but that indices are in range and coordinates finite: triangles may be degenerate, repeated,
/// flipped, may intersect and may leave holes. Whether more holds is asked of `check`.
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
    #[error("vertex {vertex} is at ({}, {}, {}), which is not a place", at.x, at.y, at.z)]
    NotFinite {
        /// Index of the first such vertex.
        vertex: usize,
        /// Its coordinates.
        at: DVec3,
    },
    /// A triangle names a vertex that does not exist.
    #[error(
        "triangle {triangle} has vertex {vertex} for a corner, but there are only {vertices} vertices"
    )]
    NoSuchVertex {
        /// Index of the first such triangle.
        triangle: usize,
        /// The index it names.
        vertex: u32,
        /// How many vertices there are.
        vertices: usize,
    },
    /// More vertices or triangles than 32-bit indices can name.
    #[error("{count} {what} are more than the 4 294 967 295 that a mesh can hold")]
    TooMany {
        /// What there are too many of.
        what: &'static str,
        /// How many.
        count: usize,
    },
}

impl TriMesh {
    /// A mesh from its parts.
    ///
    /// # Errors
    /// [`MeshError::NotFinite`], [`MeshError::NoSuchVertex`] and [`MeshError::TooMany`].
    pub fn new(positions: Vec<DVec3>, triangles: Vec<[u32; 3]>) -> Result<Self, MeshError> {
        for (what, count) in [
            ("vertices", positions.len()),
            ("triangles", triangles.len()),
        ] {
            if u32::try_from(count).is_err() {
                return Err(MeshError::TooMany { what, count });
            }
        }
        if let Some(vertex) = positions.iter().position(|at| !at.is_finite()) {
            let at = positions[vertex];
            return Err(MeshError::NotFinite { vertex, at });
        }
        let vertices = positions.len();
        for (triangle, corners) in triangles.iter().enumerate() {
            if let Some(&vertex) = corners.iter().find(|&&v| v as usize >= vertices) {
                return Err(MeshError::NoSuchVertex {
                    triangle,
                    vertex,
                    vertices,
                });
            }
        }
        Ok(Self {
            positions,
            triangles,
        })
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

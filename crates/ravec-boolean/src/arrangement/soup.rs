//! All triangles of all meshes in one list, with one vertex for each place.

use glam::DVec3;
use ravec_mesh::{OrientedPlane, TriMesh};
use ravec_progress::{Cancelled, Progress};
use rustc_hash::FxHashMap;

use crate::closing::Closing;

/// Vertices or triangles between two looks at the progress: some milliseconds.
const STRIDE: usize = 1 << 16;

/// Coordinates smaller than this are taken for zero: exact tests multiply the differences of three, which must not vanish.
const SMALLEST: f64 = 1e-70;

/// Where a triangle of the soup comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Source {
    /// Index of the mesh.
    pub mesh: u32,
    /// Index of the triangle in the mesh; beyond its triangles, those that close it.
    pub triangle: u32,
}

/// All triangles that have an area, over vertices of which no two are at one place.
#[derive(Debug, Clone, Default)]
pub(crate) struct Soup {
    pub positions: Vec<DVec3>,
    pub triangles: Vec<[u32; 3]>,
    pub sources: Vec<Source>,
    /// Number of meshes.
    pub meshes: usize,
}

impl Soup {
    /// Puts meshes and what closes them together.
    ///
    /// # Errors
    /// [`Cancelled`] soon after `progress` is.
    pub fn of(
        meshes: &[&TriMesh],
        closings: &[Closing],
        progress: &Progress,
    ) -> Result<Self, Cancelled> {
        let count = |f: fn(&TriMesh) -> usize| meshes.iter().map(|m| f(m)).sum();
        let triangles: usize = count(|m| m.triangles().len());
        let positions: usize = count(|m| m.positions().len());
        let mut soup = Self {
            positions: Vec::with_capacity(positions),
            triangles: Vec::with_capacity(triangles),
            sources: Vec::with_capacity(triangles),
            meshes: meshes.len(),
        };
        let mut vertex_at = FxHashMap::default();
        vertex_at.reserve(positions);
        let mut vertices = Vec::new();
        for (index, (mesh, closing)) in meshes.iter().zip(closings).enumerate() {
            vertices.clear();
            for (at, &p) in mesh.positions().iter().enumerate() {
                if at % STRIDE == 0 {
                    progress.check()?;
                }
                // adding zero makes the two zeros one
                let p = DVec3::select(p.abs().cmplt(DVec3::splat(SMALLEST)), DVec3::ZERO, p)
                    + DVec3::ZERO;
                let key = p.to_array().map(f64::to_bits);
                vertices.push(*vertex_at.entry(key).or_insert_with(|| {
                    soup.positions.push(p);
                    (soup.positions.len() - 1) as u32
                }));
            }
            let all = mesh.triangles().iter().chain(&closing.triangles);
            for (triangle, corners) in all.enumerate() {
                if triangle % STRIDE == 0 {
                    progress.check()?;
                }
                let source = Source {
                    mesh: index as u32,
                    triangle: triangle as u32,
                };
                soup.push(corners.map(|v| vertices[v as usize]), source);
            }
        }
        Ok(soup)
    }

    /// No triangles yet, over given places.
    pub fn with_vertices(positions: Vec<DVec3>, meshes: usize) -> Self {
        Self {
            positions,
            meshes,
            ..Self::default()
        }
    }

    /// The same triangles as a mesh.
    pub fn mesh(&self) -> TriMesh {
        TriMesh::new(self.positions.clone(), self.triangles.clone())
            .expect("a soup has finite positions, and its corners are among them")
    }

    /// Adds a triangle if it has an area.
    pub fn push(&mut self, corners: [u32; 3], source: Source) {
        let [a, b, c] = corners.map(|v| self.positions[v as usize]);
        let distinct =
            corners[0] != corners[1] && corners[1] != corners[2] && corners[2] != corners[0];
        if distinct && !OrientedPlane::through(a, b, c).is_degenerate() {
            self.triangles.push(corners);
            self.sources.push(source);
        }
    }

    /// The places of the corners of a triangle.
    #[inline]
    pub fn corners(&self, triangle: u32) -> [DVec3; 3] {
        self.triangles[triangle as usize].map(|v| self.positions[v as usize])
    }
}

//! Meshes of vertices and triangles.

use crate::error::of_request;
use crate::work;
use glam::DVec3;
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;
use ravec::mesh::TriMesh;
use ravec::mesh_io::{MeshFile, MeshFormat};
use std::sync::Arc;

/// A mesh of triangles that operations take and give.
#[pyclass(frozen, module = "ravec._ravec")]
pub struct MeshData {
    pub file: Arc<MeshFile>,
}

impl MeshData {
    pub fn new(file: MeshFile) -> Self {
        Self {
            file: Arc::new(file),
        }
    }
}

#[pymethods]
impl MeshData {
    /// A mesh of `float64` vertices of shape (V, 3) and `uint32` triangles of shape (F, 3).
    #[new]
    fn from_arrays(
        py: Python<'_>,
        vertices: PyReadonlyArray2<'_, f64>,
        faces: PyReadonlyArray2<'_, u32>,
    ) -> PyResult<Self> {
        for (what, shape) in [("vertices", vertices.shape()), ("faces", faces.shape())] {
            if shape[1] != 3 {
                return Err(of_request(format!(
                    "{what} have the shape (N, 3), not {shape:?}"
                )));
            }
        }
        let vertices = vertices.as_array();
        let positions = vertices.rows().into_iter();
        let positions = positions
            .map(|row| DVec3::new(row[0], row[1], row[2]))
            .collect();
        let faces = faces.as_array();
        let triangles = faces.rows().into_iter();
        let triangles = triangles.map(|row| [row[0], row[1], row[2]]).collect();
        let mesh = work::run(py, None, move |_| {
            TriMesh::new(positions, triangles).map_err(of_request)
        })?;
        Ok(Self::new(MeshFile::from_mesh(mesh, MeshFormat::PlyBinary)))
    }

    /// Coordinates as a new array of shape (V, 3).
    fn vertices<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let positions = self.file.mesh.positions();
        let values = positions.iter().flat_map(DVec3::to_array).collect();
        PyArray1::from_vec(py, values).reshape([positions.len(), 3])
    }

    /// Vertices of the triangles as a new array of shape (F, 3).
    fn faces<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u32>>> {
        let triangles = self.file.mesh.triangles();
        let values: Vec<u32> = triangles.iter().flatten().copied().collect();
        PyArray1::from_vec(py, values).reshape([triangles.len(), 3])
    }

    /// Number of vertices and of triangles.
    fn counts(&self) -> (usize, usize) {
        let mesh = &self.file.mesh;
        (mesh.positions().len(), mesh.triangles().len())
    }

    /// Corners of the bounding box.
    fn bounds(&self) -> Option<([f64; 3], [f64; 3])> {
        let bounds = self.file.mesh.bounds();
        (!bounds.is_empty()).then(|| (bounds.min.to_array(), bounds.max.to_array()))
    }
}

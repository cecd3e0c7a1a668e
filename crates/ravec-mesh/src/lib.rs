//! Triangle meshes: formats, checks, measures, closest points and exact intersections.

mod aabb;
mod tri_mesh;

pub use aabb::Aabb;
pub use tri_mesh::{MeshError, TriMesh};

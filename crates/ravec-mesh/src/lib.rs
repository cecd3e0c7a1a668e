//! Triangle meshes: formats, checks, measures, closest points and exact intersections.

mod aabb;
mod bvh;
mod closest;
mod tri_mesh;

pub use aabb::Aabb;
pub use bvh::{Bvh, Closest};
pub use closest::{ClosestOnTriangle, Feature, closest_on_triangle, distance_sq_to_triangle};
pub use tri_mesh::{MeshError, TriMesh};

//! Triangle meshes: formats, checks, measures, closest points and exact intersections.

mod aabb;
mod bvh;
mod closest;
mod predicates;
mod tri_intersect;
mod tri_mesh;

pub use aabb::Aabb;
pub use bvh::{Bvh, Closest, RayHit};
pub use closest::{ClosestOnTriangle, Feature, closest_on_triangle, distance_sq_to_triangle};
pub use predicates::{Sign, on_one_line, orient2d, orient3d};
pub use tri_intersect::{TriTri, intersection};
pub use tri_mesh::{MeshError, TriMesh};

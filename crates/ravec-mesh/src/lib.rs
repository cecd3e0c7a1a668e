//! Triangle meshes: formats, checks, measures, closest points and exact intersections.

mod aabb;
mod adjacency;
mod bvh;
mod check;
mod closest;
mod format;
mod gathered;
mod hausdorff;
mod keyed;
mod loose_octree;
mod measures;
mod predicates;
mod relax;
pub mod render;
mod self_intersection;
mod simplify;
mod tri_distance;
mod tri_intersect;
mod tri_mesh;

pub use aabb::Aabb;
pub use adjacency::{Adjacency, Components, EdgeUse, Fans};
pub use bvh::{BoxTree, Bvh, CandidateTree, Closest, RayHit, WindingNumbers, winding_number};
pub use check::{BoundaryLoop, CheckParams, Found, MeshCheck, check};
pub use closest::{ClosestOnTriangle, Feature, closest_on_triangle, distance_sq_to_triangle};
pub use format::{
    Attributes, BufferResolver, LengthUnit, MeshFile, MeshFormat, MeshLimits, MeshRows, Place,
    Precision, ReadMeshError, ReadOptions, ReadWarning, Welded, WriteMeshError, WriteOptions,
    read_mesh, read_mesh_with_buffers, try_weld, weld, write_mesh, write_mesh_with, write_rows,
};
pub use hausdorff::{
    Hausdorff, HausdorffError, HausdorffParams, OneSided, distances_to, hausdorff, vertex_distances,
};
pub use measures::{Measures, SideLengths, measure, try_measure};
pub use predicates::{OrientedPlane, Sign, on_one_line, orient2d, orient3d};
pub use relax::{Facet, NEW_VERTEX, RelaxJudge, Relaxed, relax};
pub use self_intersection::{
    IntersectingPair, SelfIntersections, for_each_self_intersection, intersections_with,
    self_intersections,
};
pub use simplify::{
    BoundaryRule, CollapseCandidate, CollapseJudge, ErrorSample, JudgeFactory, Keep, Simplified,
    SimplifyError, SimplifyParams, SimplifyReport, Trust, Vetoes, add_rings, simplify,
    simplify_patches,
};
pub use tri_distance::triangle_distance_sq;
pub use tri_intersect::{TriTri, intersection};
pub use tri_mesh::{MeshError, TriMesh};

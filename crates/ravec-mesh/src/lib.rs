//! Triangle meshes in memory: adjacency, measures, checks, distances, exact predicates, welding and simplification.
//!
//! A [`TriMesh`] is a list of places and a list of triangles between them, and promises nothing else: it may have holes,
//! flipped and repeated triangles, and triangles that pass through each other. [`check()`] finds out what it is the surface
//! of. Files are read and written by `ravec-mesh-io`, pictures are drawn by `ravec-mesh-render`.
//!
//! ```
//! use glam::DVec3;
//! use ravec_mesh::{Bvh, CheckParams, HausdorffParams, TriMesh, check, hausdorff, measure, weld};
//! use ravec_progress::Progress;
//!
//! // a tetrahedron as STL has it: four triangles that share no vertex
//! let [o, x, y, z] = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
//! let corners = [[o, y, x], [o, x, z], [o, z, y], [x, y, z]].concat();
//! let triangles = (0..4).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
//! let soup = TriMesh::new(corners, triangles)?;
//!
//! let progress = Progress::none();
//! assert!(!check(&soup, &CheckParams::default(), &progress)?.closed);
//! let solid = weld(&soup, 0.0).mesh;
//! assert_eq!(solid.positions().len(), 4);
//! let found = check(&solid, &CheckParams::default(), &progress)?;
//! assert!(found.is_solid() && found.genus == Some(0));
//! assert!((measure(&solid).volume - 1.0 / 6.0).abs() < 1e-15);
//!
//! // distances to the surface, and between surfaces
//! let nearest = Bvh::new(&solid).closest(DVec3::new(0.2, 0.2, -3.0)).expect("there are triangles");
//! assert_eq!(nearest.distance_sq, 9.0);
//! let apart = hausdorff(&soup, &solid, &HausdorffParams::default(), &progress)?;
//! assert!(apart.upper() < 1e-3);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # What is here
//!
//! | for | use |
//! | --- | --- |
//! | triangles | [`TriMesh`], [`MeshRows`] for those that are not in memory |
//! | neighbors | [`Adjacency`], [`Components`], [`Fans`] |
//! | one vertex at each place | [`weld()`], [`weld_within`] |
//! | area, volume, centers | [`measure`] |
//! | defects | [`check()`], [`self_intersections`] |
//! | nearest points, rays, inside and outside | [`Bvh`], [`WindingNumbers`] |
//! | distances between surfaces | [`hausdorff()`], [`vertex_distances`] |
//! | exact signs | [`orient3d`], [`orient2d`], [`intersection`] |
//! | fewer triangles | [`simplify()`], [`simplify_patches`] |
//! | smoother triangles | [`relax()`] |
//!
//! # Guarantees
//!
//! - Indices of a [`TriMesh`] are in range and coordinates are finite.
//! - Signs of determinants are exact, and so is each verdict of [`check()`] that rests on them: closed, oriented, free of
//!   self-intersections.
//! - Distances between surfaces are enclosed by bounds that hold for all of their points.
//! - The same input gives the same bytes on any number of threads; work runs in the caller's `rayon` pool.
//! - Whatever may take longer than a moment takes a `Progress`, and stops within 50 ms of a cancellation.
//!
//! # Not guaranteed
//!
//! - That a mesh is closed, oriented, or the surface of anything.
//! - That a chain of vertices, each within the tolerance of the next, is welded to one.
//!
//! # Words
//!
//! *Soup*: triangles of which nothing is known. *Solid*: a closed, oriented surface that does not meet itself. *Boundary*: the edges
//! of one triangle. *Fan*: the triangles around a vertex that are connected by edges there. *Component*: triangles that are
//! connected by edges. *Feature*: the vertex, edge or face that a nearest point lies on. *Judge*: what accepts or refuses a
//! step of [`simplify()`] or [`relax()`].
//!
//! # Costs
//!
//! Adjacency, measures and welding take time in proportion to the mesh, a hierarchy `n log n`; a nearest point takes about
//! a microsecond. [`check()`] takes time in proportion to the mesh and to the pairs of triangles that meet. Figures and
//! machines are in `docs/measurements.md`.

mod aabb;
mod adjacency;
mod bvh;
mod check;
mod closest;
mod coordinates;
mod hausdorff;
mod keyed;
mod loose_octree;
mod measures;
mod par_collect;
mod predicates;
mod relax;
mod rows;
mod seams;
mod self_intersection;
mod simplify;
mod tri_distance;
mod tri_intersect;
mod tri_mesh;
mod weld;

pub use aabb::Aabb;
pub use adjacency::{Adjacency, Components, EdgeUse, Fans};
pub use bvh::{BoxTree, Bvh, CandidateTree, Closest, RayHit, WindingNumbers, winding_number};
pub use check::{BoundaryLoop, CheckParams, Found, MeshCheck, check};
pub use closest::{ClosestOnTriangle, Feature, closest_on_triangle, distance_sq_to_triangle};
pub use coordinates::Coordinates;
pub use hausdorff::{
    Hausdorff, HausdorffError, HausdorffParams, OneSided, distances_to, hausdorff, vertex_distances,
};
pub use keyed::{KeyedMap, KeyedSet};
pub use measures::{Measures, SideLengths, measure, try_measure};
pub use par_collect::par_collect;
pub use predicates::{OrientedPlane, Sign, on_one_line, orient2d, orient3d};
pub use relax::{Facet, NEW_VERTEX, RelaxJudge, Relaxed, relax};
pub use rows::{MeshRows, RowsError};
pub use seams::{JoinedSeams, join_seams};
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
pub use weld::{PlaceKey, PlaceTable, WeldError, Welded, place_key, try_weld, weld, weld_within};

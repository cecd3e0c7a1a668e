//! Fewer triangles for nearly the same surface.
//!
//! The plain idea: each vertex carries a *quadric*, the sum of the squared distances to the planes it stands for; of all
//! edges the one whose best point has the smallest sum is collapsed to that point; the quadrics of its ends are added.
//! Departures from it:
//!
//! 1. A collapse may be *vetoed*: it would change the topology (link condition), leave the boundary or a feature, turn or
//!    flatten a triangle, exceed the error, make triangles intersect, or the caller does not like it.
//! 2. Where planes do not determine the best point it is the one closest to the middle of the edge.
//! 3. Boundary and feature edges add planes of their own, across the surface, and collapse only along themselves.
//! 4. Vetoed collapses are tried again when the queue is empty, since their neighborhood may have changed.
//!
//! Source: Garland and Heckbert, "Surface Simplification Using Quadric Error Metrics", 1997; Lindstrom and Turk, "Fast and
//! Memory Efficient Polygonal Simplification", 1998 (weights by area, boundary planes, placement where the system is
//! nearly singular); Dey et al., "Topology Preserving Edge Contraction", 1999 (link condition). We differ in: the vetoes;
//! the error, see [`SimplifyParams::max_error`].
//!
//! Guarantees: a closed, manifold or oriented mesh stays so, with its components, handles and holes; with
//! [`SimplifyParams::avoid_intersections`] a mesh without self-intersections stays without them, exactly; vertices that
//! are not moved keep their places bit by bit; the same result on any number of threads. Does not guarantee: a distance
//! to the original surface; the veto of the caller can.
//! Cost: O(n), 2 to 5 µs for each collapse on one thread, 10 µs more for the search for intersections, and about as much
//! for the error; some 300 bytes a triangle. Several threads examine edges ahead of their turn, which on two of them takes some
//! 0.8 of the time; [`simplify_patches`] lets them work on patches.

mod deviation;
mod engine;
mod examine;
mod judge;
mod parts;
mod patches;
mod quadric;
mod queue;
mod state;
mod surface;
mod undo;

use deviation::known_samples;
use engine::{Engine, Start};
use glam::DVec3;
use ravec_progress::{Cancelled, Progress};
use serde::{Deserialize, Serialize};
use std::sync::atomic::AtomicUsize;

use crate::{Bvh, TriMesh};

pub use judge::{CollapseCandidate, CollapseJudge, JudgeFactory, Trust};
pub use parts::add_rings;
pub use patches::simplify_patches;

/// Treatment of the edges with one triangle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum BoundaryRule {
    /// They are simplified like features: along themselves, as far as their shape allows.
    #[default]
    Follow,
    /// They and their vertices stay as they are.
    Lock,
}

/// Parameters of simplification: its targets, and the properties to preserve.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct SimplifyParams {
    /// Stop when there are no more triangles than this (default 0: go on while anything is allowed). Fewer triangles,
    /// coarser surface; the last collapse may go one below.
    pub target_triangles: u64,
    /// The largest error, in units of the mesh, at least 0 (default infinite).
    ///
    /// Measured by samples: from the vertices and the middles of the edges of the original, and, if `both_ways`, from
    /// vertices and the middles of edges and triangles of the simplified surface. The distance is thus nearly, but not
    /// provably, kept below. Larger gives fewer triangles.
    pub max_error: f64,
    /// `true` if to measure the error in both directions (default true), and not only from the original. Without, it
    /// takes less time, and parts of the simplified surface may be farther away, such as between two sheets.
    pub both_ways: bool,
    /// Edges at which triangles meet at a larger angle between their normals than this, in radians, are features (default
    /// π: none). Quadrics keep creases quite well by themselves; with this they are kept as chains of edges. Smaller
    /// makes more features and keeps more triangles; below the noise of a scan it freezes everything.
    pub feature_angle_rad: f64,
    /// Treatment of boundaries (default [`BoundaryRule::Follow`]).
    pub boundary: BoundaryRule,
    /// Largest angle by which one collapse may turn the normal of a triangle, in radians, at most π/2 (default 1.2).
    /// Smaller is more careful at creases; larger admits folds.
    pub max_turn_rad: f64,
    /// The least quality of a new triangle, 0 to 1 (default 0.02): 4√3 times its area, divided by the sum of its squared
    /// sides; 1 if equilateral. A worse one is admitted only where it replaces one that is worse still. Larger avoids
    /// slivers and keeps more triangles.
    pub min_quality: f64,
    /// `true` if to veto collapses that make triangles meet where they should not (default true). It takes some 10 µs
    /// for each collapse.
    pub avoid_intersections: bool,
}

impl Default for SimplifyParams {
    fn default() -> Self {
        Self {
            target_triangles: 0,
            max_error: f64::INFINITY,
            both_ways: true,
            feature_angle_rad: std::f64::consts::PI,
            boundary: BoundaryRule::Follow,
            max_turn_rad: 1.2,
            min_quality: 0.02,
            avoid_intersections: true,
        }
    }
}

/// Elements that must be kept, by index into the mesh.
#[derive(Debug, Clone, Default)]
pub struct Keep<'a> {
    /// Edges that are features, in either direction: they collapse only along themselves, and where one ends or more than
    /// two meet, the vertex stays.
    pub features: &'a [[u32; 2]],
    /// Vertices that stay. Others may be merged into them.
    pub vertices: &'a [u32],
    /// `true` if other meshes have these vertices, too (default false): then no edge between two of them comes to be,
    /// since there might be one elsewhere.
    pub sealed: bool,
    /// Samples from which the error is measured, if not from the mesh itself: the [`samples`](Simplified::samples) of a
    /// simplification that it came from, so that the errors of both do not add up.
    pub samples: Option<Vec<ErrorSample>>,
    /// `true` if the [`samples`](Simplified::samples) of the result are wanted, to go on from (default false).
    pub reports_samples: bool,
}

/// A place that the simplified mesh must be near.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ErrorSample {
    /// A vertex or the middle of an edge of the original.
    pub place: DVec3,
    /// The triangle that is near it.
    pub triangle: u32,
}

/// Number of vetoed collapses, by reason. One edge may be counted several times.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Vetoes {
    /// The topology would have changed.
    pub topology: u64,
    /// A feature, a boundary or a vertex to keep would have been left.
    pub features: u64,
    /// A triangle would have turned by too much.
    pub turns: u64,
    /// A triangle would have become too thin.
    pub quality: u64,
    /// The error would have become too large.
    pub error: u64,
    /// Triangles would have met.
    pub intersections: u64,
    /// The caller said so.
    pub caller: u64,
}

impl std::ops::AddAssign for Vetoes {
    fn add_assign(&mut self, other: Self) {
        self.topology += other.topology;
        self.features += other.features;
        self.turns += other.turns;
        self.quality += other.quality;
        self.error += other.error;
        self.intersections += other.intersections;
        self.caller += other.caller;
    }
}

/// Figures of a simplification by [`simplify`].
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct SimplifyReport {
    /// Triangles of the mesh that was given.
    pub triangles_before: u64,
    /// Triangles of the result.
    pub triangles_after: u64,
    /// Edges that were collapsed.
    pub collapses: u64,
    /// Collapses that were not allowed.
    pub vetoes: Vetoes,
    /// The largest error at any time, if it was limited: see [`SimplifyParams::max_error`].
    pub largest_error: Option<f64>,
    /// `true` if there are as few triangles as requested.
    pub target_reached: bool,
}

/// The result of [`simplify`].
#[derive(Debug, Clone, PartialEq)]
pub struct Simplified {
    /// The mesh, with vertices and triangles in the order of the original.
    pub mesh: TriMesh,
    /// The original vertex whose name each vertex kept.
    pub vertex_origin: Vec<u32>,
    /// The original triangle whose name each triangle kept.
    pub triangle_origin: Vec<u32>,
    /// The feature edges that were left, each with its lower vertex first, ascending; boundary edges are not listed.
    pub features: Vec<[u32; 2]>,
    /// The samples from which the error was measured, if it was limited and they were
    /// [requested](Keep::reports_samples).
    pub samples: Vec<ErrorSample>,
    /// Report.
    pub report: SimplifyReport,
}

/// Why a mesh was not simplified.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SimplifyError {
    /// A parameter is out of its range.
    #[error("{name} is {value}, but must be {range}")]
    BadParameter {
        /// The name of the parameter.
        name: &'static str,
        /// Its value.
        value: f64,
        /// The allowed range.
        range: &'static str,
    },
    /// A vertex that does not exist is to be kept.
    #[error("vertex {vertex} is to be kept, but there are only {vertices} vertices")]
    NoSuchVertex {
        /// The vertex.
        vertex: u32,
        /// Number of vertices.
        vertices: usize,
    },
    /// A sample is near a triangle that does not exist.
    #[error("a sample is near triangle {triangle}, but there are only {triangles} triangles")]
    NoSuchTriangle {
        /// The triangle.
        triangle: u32,
        /// Number of triangles.
        triangles: usize,
    },
    /// Two vertices without an edge between them are to be kept as a feature.
    #[error("a feature joins vertices {} and {}, but no edge does", ends[0], ends[1])]
    NoSuchEdge {
        /// The vertices.
        ends: [u32; 2],
    },
    /// There are more triangles than can be handled.
    #[error("{triangles} triangles are more than the {} that can be simplified at once", u32::MAX / 3)]
    TooMany {
        /// Number of triangles.
        triangles: usize,
    },
    /// The work was cancelled.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

fn validate(mesh: &TriMesh, params: &SimplifyParams, keep: &Keep<'_>) -> Result<(), SimplifyError> {
    let half_turn = std::f64::consts::PI;
    let bounded = [
        ("max_error", params.max_error, f64::INFINITY, "at least 0"),
        (
            "feature_angle_rad",
            params.feature_angle_rad,
            half_turn,
            "0 to π",
        ),
        (
            "max_turn_rad",
            params.max_turn_rad,
            0.5 * half_turn,
            "0 to π/2",
        ),
        ("min_quality", params.min_quality, 1.0, "0 to 1"),
    ];
    for (name, value, most, range) in bounded {
        if !(0.0..=most).contains(&value) {
            return Err(SimplifyError::BadParameter { name, value, range });
        }
    }
    let vertices = mesh.positions().len();
    let named = keep.vertices.iter().chain(keep.features.iter().flatten());
    if let Some(&vertex) = named.into_iter().find(|&&v| v as usize >= vertices) {
        return Err(SimplifyError::NoSuchVertex { vertex, vertices });
    }
    let triangles = mesh.triangles().len();
    if triangles > (u32::MAX / 3) as usize {
        return Err(SimplifyError::TooMany { triangles });
    }
    let mut near = keep.samples.iter().flatten().map(|sample| sample.triangle);
    if let Some(triangle) = near.find(|&t| t as usize >= triangles) {
        return Err(SimplifyError::NoSuchTriangle {
            triangle,
            triangles,
        });
    }
    Ok(())
}

/// Simplifies `mesh` by collapsing edges.
///
/// `veto` is asked last, about collapses that all other conditions allow; if it answers `true` the collapse does not
/// happen. It is asked from several threads, and more often than collapses happen: see [`CollapseJudge`]. Triangles that name a vertex twice, and vertices without triangles, are dropped.
///
/// ```
/// use glam::DVec3;
/// use ravec_mesh::{Keep, SimplifyParams, TriMesh, simplify};
/// use ravec_progress::Progress;
///
/// // a flat square of 20 × 20 cells
/// let at = |k: u32| DVec3::new(f64::from(k % 21), f64::from(k / 21), 0.0);
/// let cells = (0..420).filter(|k| k % 21 < 20);
/// let triangles = cells.flat_map(|k| [[k, k + 1, k + 22], [k, k + 22, k + 21]]);
/// let mesh = TriMesh::new((0..441).map(at).collect(), triangles.collect())?;
///
/// let params = SimplifyParams { max_error: 1e-9, ..SimplifyParams::default() };
/// let simple = simplify(&mesh, &params, &Keep::default(), |_| false, &Progress::none())?;
/// assert_eq!(simple.mesh.triangles().len(), 2);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`SimplifyError::BadParameter`], [`SimplifyError::NoSuchVertex`], [`SimplifyError::NoSuchEdge`],
/// [`SimplifyError::NoSuchTriangle`] and [`SimplifyError::TooMany`]; [`SimplifyError::Cancelled`] soon after `progress` is cancelled.
pub fn simplify(
    mesh: &TriMesh,
    params: &SimplifyParams,
    keep: &Keep<'_>,
    veto: impl Fn(&CollapseCandidate<'_>) -> bool + Sync,
    progress: &Progress,
) -> Result<Simplified, SimplifyError> {
    progress.check()?;
    validate(mesh, params, keep)?;
    let limited = params.max_error < f64::INFINITY;
    let original = if limited && params.both_ways {
        Some(Bvh::try_new(mesh, progress)?)
    } else {
        None
    };
    let start = Start {
        mesh,
        params,
        keep: Keep {
            samples: None,
            ..*keep
        },
        sealed: if keep.sealed { keep.vertices } else { &[] },
        samples: keep.samples.clone().map(known_samples),
        original: original.as_ref(),
        waiting: &AtomicUsize::new(0),
    };
    let mut engine = Engine::new(start, veto, progress)?;
    let phase = progress.phase("simplify", engine.max_to_do());
    engine.run(&phase, progress)?;
    Ok(engine.take_apart().into_simplified(keep.reports_samples))
}

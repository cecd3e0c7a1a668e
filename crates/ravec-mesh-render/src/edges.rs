//! The edges of a mesh, and which of them are features from everywhere.

use std::ops::Range;

use glam::DVec3;
use ravec_mesh::{TriMesh, par_collect};
use ravec_progress::{Cancelled, Progress};

/// One side of an edge.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Side {
    pub low: u32,
    pub high: u32,
    pub triangle: u32,
    /// `true` if the triangle runs from the lower to the higher vertex.
    pub forward: bool,
}

/// Role of an edge among feature lines.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum EdgeKind {
    /// A crease, a border, or an edge of three and more triangles.
    Feature,
    /// An edge of two triangles; part of the silhouette in some views.
    Plain,
    /// An edge of a triangle without area, which bends no surface.
    Flat,
}

/// The edges by their lower, then their higher vertex.
pub(super) struct Edges {
    sides: Vec<Side>,
    /// Index of the first side of each edge, followed by the number of all sides.
    first: Vec<u32>,
}

impl Edges {
    pub fn new(mesh: &TriMesh, progress: &Progress) -> Result<Self, Cancelled> {
        let (first, sides) = sides_by_low(mesh, progress)?;
        let sides = par_collect(mesh.positions().len(), progress, |low| {
            let range = first[low as usize] as usize..first[low as usize + 1] as usize;
            let mut sides = sides[range].to_vec();
            sides.sort_unstable();
            sides.retain(|side| side.low < side.high);
            sides
        })?;
        let starts = par_collect(sides.len(), progress, |side| {
            let at = side as usize;
            let ends = |at: usize| [sides[at].low, sides[at].high];
            (at == 0 || ends(at - 1) != ends(at)).then_some(side)
        })?;
        let mut first = starts;
        first.push(sides.len() as u32);
        Ok(Self { sides, first })
    }

    /// Number of edges.
    pub fn len(&self) -> usize {
        self.first.len() - 1
    }

    /// The sides of an edge; one at least.
    #[inline]
    pub fn sides(&self, edge: u32) -> &[Side] {
        let Range { start, end } = self.first[edge as usize]..self.first[edge as usize + 1];
        &self.sides[start as usize..end as usize]
    }

    /// The kinds of all edges: features differ in their normals by more than an angle.
    pub fn kinds(
        &self,
        mesh: &TriMesh,
        angle_deg: f64,
        progress: &Progress,
    ) -> Result<Vec<EdgeKind>, Cancelled> {
        let limit = angle_deg.to_radians().cos();
        let normals = par_collect(mesh.triangles().len(), progress, |triangle| {
            [normal(mesh.corners(triangle))]
        })?;
        par_collect(self.len(), progress, |edge| {
            let [first, second] = self.sides(edge) else {
                return [EdgeKind::Feature];
            };
            let [a, b] = [first, second].map(|side| normals[side.triangle as usize]);
            if a == DVec3::ZERO || b == DVec3::ZERO {
                return [EdgeKind::Flat];
            }
            // Faces that run along the edge the same way are of opposite orientation.
            let b = if first.forward == second.forward {
                -b
            } else {
                b
            };
            [if a.dot(b) < limit {
                EdgeKind::Feature
            } else {
                EdgeKind::Plain
            }]
        })
    }
}

/// The height of a triangle as a share of its longest side, below which its normal says more about rounding than about the
/// surface: pieces of a flat face may be as thin as that.
const MIN_HEIGHT: f64 = 1e-9;

/// The unit normal of a triangle; 0 if it has no area to speak of.
pub(super) fn normal([a, b, c]: [DVec3; 3]) -> DVec3 {
    let normal = (b - a).cross(c - a);
    let sides = [b - a, c - b, a - c].map(DVec3::length_squared);
    let longest_sq = sides.into_iter().fold(0.0, f64::max);
    if normal.length() <= MIN_HEIGHT * longest_sq {
        return DVec3::ZERO;
    }
    normal.normalize_or_zero()
}

/// The sides of all triangles by their lower vertex, and where those of each vertex begin. There are as many as 32 bits count,
/// or the list of lines would not fit the memory.
fn sides_by_low(mesh: &TriMesh, progress: &Progress) -> Result<(Vec<u32>, Vec<Side>), Cancelled> {
    const AT_ONCE: usize = 1 << 16;
    let sides_of = |triangle: usize| {
        let corners = mesh.triangles()[triangle];
        [0, 1, 2].map(|i| {
            let (from, to) = (corners[i], corners[(i + 1) % 3]);
            Side {
                low: from.min(to),
                high: from.max(to),
                triangle: triangle as u32,
                forward: from < to,
            }
        })
    };
    let count = mesh.triangles().len();
    let mut first = vec![0_u32; mesh.positions().len() + 1];
    for triangle in 0..count {
        if triangle % AT_ONCE == 0 {
            progress.check()?;
        }
        for side in sides_of(triangle) {
            first[side.low as usize + 1] += 1;
        }
    }
    for i in 1..first.len() {
        first[i] += first[i - 1];
    }
    let mut next = first.clone();
    let blank = Side {
        low: 0,
        high: 0,
        triangle: 0,
        forward: false,
    };
    let mut sides = vec![blank; 3 * count];
    for triangle in 0..count {
        if triangle % AT_ONCE == 0 {
            progress.check()?;
        }
        for side in sides_of(triangle) {
            let at = &mut next[side.low as usize];
            sides[*at as usize] = side;
            *at += 1;
        }
    }
    Ok((first, sides))
}

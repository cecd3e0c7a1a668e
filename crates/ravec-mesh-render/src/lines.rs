//! Lines over the shaded surface: triangle edges, feature edges, silhouettes and the outline of a cut.
//!
//! Lines behind the surface are removed by its depth: a line is seen where its middle is no farther than the surface is
//! at the sample of the middle or at one next to it. (At a crease or an outline the surface falls back on at least one side;
//! a line behind the surface is farther than all of them.) What is left are valleys, where the surface rises on both sides by
//! what it slopes over a sample; by that much, and no more than [`MAX_BIAS`], the line is brought forward.

use glam::{DVec2, DVec3};
use ravec_progress::{Cancelled, Progress};

use super::camera::{Projected, Projector};
use super::{FeatureLines, RenderParams, Section};
use ravec_mesh::KeyedSet;
use ravec_mesh::TriMesh;
use ravec_mesh::par_collect;

/// Kind of a line, in the order of drawing: later ones are drawn over earlier ones.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Kind {
    Wire,
    Feature,
    /// The outline of a cut, in the style of features.
    Cut,
    Marked,
}

/// A piece of a line that is not cut away.
#[derive(Debug, Clone, Copy)]
pub(super) struct Line {
    pub ends: [Projected; 2],
    /// Distance by which it is brought forward.
    pub bias: f64,
    /// By how much the depth of the surface beside it changes over a sample, up to [`MAX_SLOPE`].
    pub slope: f64,
    pub kind: Kind,
}

impl Line {
    fn new(ends: [Projected; 2], slope: f64, kind: Kind) -> Self {
        Self {
            ends,
            bias: slope.clamp(MIN_BIAS, MAX_BIAS),
            slope: slope.min(MAX_SLOPE),
            kind,
        }
    }
}

/// Most by which lines are brought forward, as a share of the depth of the mesh. More lets lines shine through thin walls
/// that are seen edge-on; less breaks lines on steep faces.
const MAX_BIAS: f64 = 5e-3;

/// Most by which the surface beside a line may rise over a sample and still have half of the line drawn on it.
const MAX_SLOPE: f64 = 5e-2;

/// The least, for what single precision loses.
const MIN_BIAS: f64 = 1e-5;

/// One side of an edge.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Side {
    low: u32,
    high: u32,
    triangle: u32,
    /// `true` if the triangle runs from the lower to the higher vertex.
    forward: bool,
}

/// All lines to be drawn, in an order that depends on the mesh alone.
pub(super) fn lines(
    mesh: &TriMesh,
    projected: &[Projected],
    projector: &Projector,
    params: &RenderParams,
    progress: &Progress,
) -> Result<Vec<Line>, Cancelled> {
    let mut lines = Vec::new();
    let marked: KeyedSet<[u32; 2]> = params
        .marked
        .iter()
        .flat_map(|marked| &marked.edges)
        .map(|&[a, b]| [a.min(b), a.max(b)])
        .collect();
    if params.wireframe.is_some() || params.features.is_some() || !marked.is_empty() {
        let (first, sides) = sides_by_low(mesh, progress)?;
        lines = par_collect(mesh.positions().len(), progress, |low| {
            let range = first[low as usize] as usize..first[low as usize + 1] as usize;
            let mut sides = sides[range].to_vec();
            sides.sort_unstable();
            let edges = sides.chunk_by(|a, b| a.high == b.high);
            let found = edges.filter_map(|sides| {
                let is_marked = marked.contains(&[low, sides[0].high]);
                edge_line(mesh, projected, projector, params, sides, is_marked)
            });
            found.collect::<Vec<_>>()
        })?;
    }
    if let Some(section) = &params.section
        && params.features.is_some()
    {
        lines.extend(par_collect(mesh.triangles().len(), progress, |triangle| {
            cut_line(mesh, projected, projector, section, triangle)
        })?);
    }
    Ok(lines)
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

fn edge_line(
    mesh: &TriMesh,
    projected: &[Projected],
    projector: &Projector,
    params: &RenderParams,
    sides: &[Side],
    is_marked: bool,
) -> Option<Line> {
    let Side { low, high, .. } = sides[0];
    let facing =
        |side: &Side| signed_area(projected, mesh.triangles()[side.triangle as usize]) < 0.0;
    if low == high {
        return None;
    }
    let is_feature = params.features.as_ref().is_some_and(|features| {
        is_feature(mesh, sides, features)
            || features.silhouettes
                && sides.len() == 2
                && facing(&sides[0]) != facing(&sides[1])
                && sides.iter().all(|side| normal(mesh, side) != DVec3::ZERO)
    });
    let kind = match (is_feature, &params.wireframe) {
        _ if is_marked => Kind::Marked,
        (true, _) => Kind::Feature,
        (false, Some(_)) => Kind::Wire,
        (false, None) => return None,
    };
    let ends = [low, high].map(|vertex| mesh.positions()[vertex as usize]);
    let ends = match &params.section {
        Some(section) => kept(ends, section)?.map(|at| projector.project(at)),
        None => [low, high].map(|vertex| projected[vertex as usize]),
    };
    let steepest = sides
        .iter()
        .map(|side| slope(projected, mesh.triangles()[side.triangle as usize]))
        .fold(0.0, f64::max);
    Some(Line::new(ends, steepest, kind))
}

/// Returns `true` if an edge is one whatever the view.
fn is_feature(mesh: &TriMesh, sides: &[Side], features: &FeatureLines) -> bool {
    let [first, second] = sides else {
        return true;
    };
    let (a, b) = (normal(mesh, first), normal(mesh, second));
    // Faces that run along the edge the same way are of opposite orientation.
    let b = if first.forward == second.forward {
        -b
    } else {
        b
    };
    // A triangle without area bends no surface.
    a != DVec3::ZERO && b != DVec3::ZERO && a.dot(b) < features.angle_deg.to_radians().cos()
}

/// The height of a triangle as a share of its longest side, below which its normal says more about rounding than about the
/// surface: pieces of a flat face may be as thin as that.
const MIN_HEIGHT: f64 = 1e-9;

/// The unit normal of the triangle at an edge; 0 if it has no area to speak of.
fn normal(mesh: &TriMesh, side: &Side) -> DVec3 {
    let [a, b, c] = mesh.corners(side.triangle);
    let normal = (b - a).cross(c - a);
    let sides = [b - a, c - b, a - c].map(DVec3::length_squared);
    let longest_sq = sides.into_iter().fold(0.0, f64::max);
    if normal.length() <= MIN_HEIGHT * longest_sq {
        return DVec3::ZERO;
    }
    normal.normalize_or_zero()
}

/// The line in which a triangle is cut.
fn cut_line(
    mesh: &TriMesh,
    projected: &[Projected],
    projector: &Projector,
    section: &Section,
    triangle: u32,
) -> Option<Line> {
    let corners = mesh.corners(triangle);
    let beyond = corners.map(|corner| section.beyond(corner));
    let mut places = Vec::with_capacity(3);
    for i in 0..3 {
        let j = (i + 1) % 3;
        if (beyond[i] > 0.0) != (beyond[j] > 0.0) {
            places.push(corners[i].lerp(corners[j], beyond[i] / (beyond[i] - beyond[j])));
        }
    }
    let &[from, to] = &places[..] else {
        return None;
    };
    let ends = [projector.project(from), projector.project(to)];
    let slope = slope(projected, mesh.triangles()[triangle as usize]);
    Some(Line::new(ends, slope, Kind::Cut))
}

/// The part of a segment that is not cut away.
fn kept([a, b]: [DVec3; 2], section: &Section) -> Option<[DVec3; 2]> {
    let (at_a, at_b) = (section.beyond(a), section.beyond(b));
    let cut = || a.lerp(b, at_a / (at_a - at_b));
    match (at_a > 0.0, at_b > 0.0) {
        (false, false) => Some([a, b]),
        (true, true) => None,
        (true, false) => Some([cut(), b]),
        (false, true) => Some([a, cut()]),
    }
}

fn offsets(projected: &[Projected], corners: [u32; 3]) -> [DVec3; 2] {
    let [a, b, c] = corners.map(|vertex| {
        let at = projected[vertex as usize];
        DVec3::new(at.x, at.y, at.key)
    });
    [b - a, c - a]
}

/// Twice the area in the picture; negative if the front is seen, since y points downward.
#[inline]
pub(super) fn signed_area(projected: &[Projected], corners: [u32; 3]) -> f64 {
    let [ab, ac] = offsets(projected, corners);
    ab.x * ac.y - ab.y * ac.x
}

/// By how much the depth of a triangle changes over a sample; 0 if it is seen edge-on and covers none.
fn slope(projected: &[Projected], corners: [u32; 3]) -> f64 {
    let [ab, ac] = offsets(projected, corners);
    let normal = ab.cross(ac);
    let steep = DVec2::new(normal.x, normal.y).length() / normal.z.abs();
    if steep.is_finite() { steep } else { 0.0 }
}

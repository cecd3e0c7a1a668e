//! Lines over the shaded surface: triangle edges, feature edges, silhouettes and the outline of a cut.
//!
//! Lines behind the surface are removed by its depth: a line is seen where its middle is no farther than the surface is
//! at the sample of the middle or at one next to it. (At a crease or an outline the surface falls back on at least one side;
//! a line behind the surface is farther than all of them.) What is left are valleys, where the surface rises on both sides by
//! what it slopes over a sample; by that much, and no more than [`MAX_BIAS`], the line is brought forward.

use glam::{DVec2, DVec3};
use ravec_progress::{Cancelled, Progress};

use super::camera::{Projected, Projector};
use super::edges::{EdgeKind, Side};
use super::prepared::Prepared;
use super::{RenderParams, Section};
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
    /// Change of the depth of the surface beside it over a sample, up to [`MAX_SLOPE`].
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

/// All lines to be drawn, in an order that depends on the mesh alone.
pub(super) fn lines(
    mesh: &TriMesh,
    prepared: &Prepared,
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
        let edges = prepared.edges(mesh, progress)?;
        let kinds = match &params.features {
            Some(features) => Some(prepared.kinds(mesh, features.angle_deg, progress)?),
            None => None,
        };
        let facing = match &params.features {
            Some(features) if features.silhouettes => {
                par_collect(mesh.triangles().len(), progress, |triangle| {
                    [signed_area(projected, mesh.triangles()[triangle as usize]) < 0.0]
                })?
            }
            _ => Vec::new(),
        };
        lines = par_collect(edges.len(), progress, |edge| {
            let sides = edges.sides(edge);
            let is_marked = !marked.is_empty() && marked.contains(&[sides[0].low, sides[0].high]);
            let is_feature = kinds.as_ref().is_some_and(|kinds| {
                let kind = kinds[edge as usize];
                let turns =
                    || facing[sides[0].triangle as usize] != facing[sides[1].triangle as usize];
                kind == EdgeKind::Feature
                    || kind == EdgeKind::Plain && !facing.is_empty() && turns()
            });
            let kind = match (is_feature, &params.wireframe) {
                _ if is_marked => Kind::Marked,
                (true, _) => Kind::Feature,
                (false, Some(_)) => Kind::Wire,
                (false, None) => return None,
            };
            edge_line(mesh, projected, projector, params, sides, kind)
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

fn edge_line(
    mesh: &TriMesh,
    projected: &[Projected],
    projector: &Projector,
    params: &RenderParams,
    sides: &[Side],
    kind: Kind,
) -> Option<Line> {
    let Side { low, high, .. } = sides[0];
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

/// Change of the depth of a triangle over a sample; 0 if it is seen edge-on and covers none.
fn slope(projected: &[Projected], corners: [u32; 3]) -> f64 {
    let [ab, ac] = offsets(projected, corners);
    let normal = ab.cross(ac);
    let steep = DVec2::new(normal.x, normal.y).length() / normal.z.abs();
    if steep.is_finite() { steep } else { 0.0 }
}

//! The triangles of a mesh at its boundary, and what folds back onto them.
//!
//! Triangles that close a boundary may repeat the wall that ends there: the two rims of a short tube have no smaller surface
//! between them than the tube itself, and both together enclose nothing. What closes a mesh leaves its wall at an angle; what
//! repeats it lies on the wall, or nearly so where a wall bulges.

use glam::DVec3;
use ravec_mesh::TriMesh;
use ravec_progress::{Cancelled, Progress};
use rustc_hash::FxHashMap;

use super::edges::Census;
use super::patch::Patch;

/// Cosine of the angle to the wall below which a triangle folds back onto it: 45 degrees, between those of a wall that
/// bulges (a zone of a sphere that a band could close has up to 25) and those of lids and of the missing walls of rings (90).
const FOLD_COS: f64 = std::f64::consts::FRAC_1_SQRT_2;

/// Share of a boundary along which a surface may fold back onto the mesh. Where one repeats a wall, all of it does.
const MAX_FOLDED: f64 = 0.5;

/// Height of a triangle over a side, as a share of the side, below which it is a sliver.
const SLIVER: f64 = 0.1;

/// The same below which its direction is that of rounding.
const MIN_HEIGHT: f64 = 1e-6;

/// Distance of the polygon from a side of a triangle, as a share of the side, up to which the triangle stands for the edges
/// there.
const STRAIGHT: f64 = 0.1;

/// Triangles between two checks for cancellation: some milliseconds.
const STRIDE: usize = 1 << 16;

/// For each edge of a boundary, as it runs in its triangle, the place of the third corner of that triangle.
pub(super) struct Walls {
    apex: FxHashMap<[u32; 2], DVec3>,
}

impl Walls {
    /// Finds the triangles at the boundary of a mesh.
    pub fn of(mesh: &TriMesh, census: &Census, progress: &Progress) -> Result<Self, Cancelled> {
        let named = |v: u32| census.first.get(&v).copied().unwrap_or(v);
        let mut is_at_boundary = vec![false; mesh.positions().len()];
        for v in census
            .boundary
            .vertices()
            .chain(census.first.keys().copied())
        {
            is_at_boundary[v as usize] = true;
        }
        let mut apex: FxHashMap<[u32; 2], DVec3> = census
            .boundary
            .directed()
            .map(|(edge, _)| (edge, DVec3::NAN))
            .collect();
        for (at, t) in mesh.triangles().iter().enumerate() {
            if at % STRIDE == 0 {
                progress.check()?;
            }
            let ends = t.iter().filter(|&&v| is_at_boundary[v as usize]).count();
            if ends < 2 {
                continue;
            }
            let names = t.map(named);
            for side in 0..3 {
                let edge = [names[side], names[(side + 1) % 3]];
                if let Some(apex) = apex.get_mut(&edge) {
                    *apex = mesh.positions()[t[(side + 2) % 3] as usize];
                }
            }
        }
        Ok(Self { apex })
    }

    /// From an edge of the boundary straight away over its triangle, and the same to another place; `None` if the edge is
    /// not of the boundary.
    fn away(&self, edge: [u32; 2], at: &impl Fn(u32) -> DVec3, p: DVec3) -> Option<[DVec3; 2]> {
        let apex = *self.apex.get(&edge)?;
        let [u, v] = edge.map(at);
        let along = (v - u).normalize_or_zero();
        Some([apex, p].map(|p| (p - u) - along * (p - u).dot(along)))
    }

    /// Returns `true` if a triangle over an edge of the boundary with this third corner folds back onto the mesh.
    fn is_folded(&self, edge: [u32; 2], at: &impl Fn(u32) -> DVec3, third: DVec3) -> bool {
        let away = self.away(edge, at, third);
        away.is_some_and(|[wall, own]| wall.dot(own) > FOLD_COS * wall.length() * own.length())
    }

    /// Returns `true` if a strip along an edge of the boundary to a place across it covers all of the triangle there once more,
    /// as between the rims of a low wall. Where panels overlap a strip folds back, too, but over a small part of their triangles.
    pub fn is_covered(&self, edge: [u32; 2], at: &impl Fn(u32) -> DVec3, across: DVec3) -> bool {
        let away = self.away(edge, at, across);
        let is_whole = |[wall, own]: [DVec3; 2]| wall.length() <= 1.5 * own.length();
        self.is_folded(edge, at, across) && away.is_some_and(is_whole)
    }

    /// Returns `true` if a surface in a polygon along the boundary folds back onto the mesh along most of it.
    ///
    /// An edge is judged by the smallest triangle over it that is no sliver: along straight stretches of a polygon triangles are flat
    /// and say nothing, and one over all of the stretch decides. Where there are none but slivers, as in a low wall, these do.
    pub fn is_retraced(&self, polygon: &[u32], patch: &Patch, at: &impl Fn(u32) -> DVec3) -> bool {
        let n = polygon.len();
        let place = |i: usize| at(polygon[i % n]);
        let mut sides: Vec<(usize, usize, usize)> = Vec::new();
        for t in &patch.triangles {
            for side in 0..3 {
                let [i, j, k] = [0, 1, 2].map(|next| t[(side + next) % 3] as usize);
                sides.push(((j + n - i) % n, i, k));
            }
        }
        sides.sort_unstable();
        let mut is_judged = vec![false; n];
        let (mut whole, mut folded) = (0.0, 0.0);
        for is_sliver_wanted in [false, true] {
            for &(span, i, k) in &sides {
                let [from, to, third] = [i, i + span, k].map(place);
                let chord = from.distance(to);
                let height = distance_to_line(third, [from, to]);
                let is_sliver = height <= SLIVER * chord;
                let is_flat = height <= MIN_HEIGHT * chord;
                if is_sliver != is_sliver_wanted
                    || is_flat
                    || (i..i + span).all(|at| is_judged[at % n])
                    || !(i + 1..i + span)
                        .all(|at| distance_to_line(place(at), [from, to]) <= STRAIGHT * chord)
                {
                    continue;
                }
                for own in i..i + span {
                    let edge = [polygon[own % n], polygon[(own + 1) % n]];
                    if std::mem::replace(&mut is_judged[own % n], true)
                        || !self.apex.contains_key(&edge)
                    {
                        continue;
                    }
                    let length = at(edge[0]).distance(at(edge[1]));
                    whole += length;
                    if self.is_folded(edge, at, third) {
                        folded += length;
                    }
                }
            }
        }
        folded > MAX_FOLDED * whole
    }
}

/// Distance of a place from the line through two others.
fn distance_to_line(p: DVec3, [from, to]: [DVec3; 2]) -> f64 {
    let along = (to - from).normalize_or_zero();
    let away = p - from;
    (away - along * away.dot(along)).length()
}

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
    pub fn is_retraced(&self, polygon: &[u32], patch: &Patch, at: &impl Fn(u32) -> DVec3) -> bool {
        let n = polygon.len();
        let (mut whole, mut folded) = (0.0, 0.0);
        for t in &patch.triangles {
            for side in 0..3 {
                let [i, j, k] = [t[side], t[(side + 1) % 3], t[(side + 2) % 3]].map(|i| i as usize);
                let edge = [polygon[i], polygon[j]];
                if (i + 1) % n != j || !self.apex.contains_key(&edge) {
                    continue;
                }
                let length = at(edge[0]).distance(at(edge[1]));
                whole += length;
                if self.is_folded(edge, at, at(polygon[k])) {
                    folded += length;
                }
            }
        }
        folded > MAX_FOLDED * whole
    }
}

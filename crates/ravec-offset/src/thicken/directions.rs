//! Directions in which the corners of a sheet move to its front skin.
//!
//! On smooth parts of the sheet, all triangles at a vertex move it along their mean normal; at creases each smooth part has its
//! own direction, and `slab` fills the gap between them. So a fine scan needs one prism per triangle and nothing between them.
//!
//! Guarantees: where corners share a direction, the moved triangle keeps its height above the original within the slack, and no
//! triangle turns over on its way.

use glam::{DMat3, DVec3};
use ravec_mesh::{Adjacency, TriMesh};
use ravec_numeric::DisjointSets;
use ravec_progress::{Cancelled, Progress};

/// Share of its area, projected along the normal, that a triangle must keep on its way: with less, it is about to turn over.
const MIN_AREA: f64 = 0.1;

/// Damping of miters towards the mean normal, and their maximum length.
const MITER_DAMPING: f64 = 1e-4;
const LONGEST_MITER: f64 = 3.0;

/// Smallest opening of a hinge, as the sine of an angle; smaller ones count as none.
const MIN_OPENING: f64 = 1e-9;

/// A sheet with the directions of its corners.
pub(super) struct Directed<'a> {
    pub sheet: &'a TriMesh,
    pub adjacency: &'a Adjacency,
    pub normals: Vec<DVec3>,
    /// Directions by triangle and corner; not exactly unit vectors, so that smooth parts keep their height.
    pub of_corner: Vec<[DVec3; 3]>,
    /// Displacement by vertex to the common corner of all triangles at unit height, also across creases.
    pub of_vertex: Vec<DVec3>,
}

/// The two triangles at an edge that bound one sheet: `left` runs from the lower vertex to the higher one, `right` back.
#[derive(Clone, Copy)]
pub(super) struct Hinge {
    pub ends: [u32; 2],
    pub left: u32,
    pub right: u32,
}

impl<'a> Directed<'a> {
    /// Computes the directions for displacements up to `height` with an error of at most `slack`; all triangles must have an
    /// area.
    pub fn new(
        sheet: &'a TriMesh,
        adjacency: &'a Adjacency,
        height: f64,
        slack: f64,
        progress: &Progress,
    ) -> Result<Self, Cancelled> {
        let normal = |t: u32| {
            let [a, b, c] = sheet.corners(t);
            (b - a).cross(c - a).normalize_or_zero()
        };
        let normals: Vec<DVec3> = (0..sheet.triangles().len() as u32).map(normal).collect();
        let mut directed = Self {
            sheet,
            adjacency,
            of_corner: normals.iter().map(|&n| [n; 3]).collect(),
            of_vertex: Vec::new(),
            normals,
        };
        directed.of_vertex = (0..sheet.positions().len() as u32)
            .map(|v| {
                progress.check()?;
                Ok(directed.miter(v))
            })
            .collect::<Result<_, Cancelled>>()?;
        // of a direction scaled for the middle of its heights, these are off by (1 - c) / (1 + c)
        let share = (slack / height).min(0.2);
        let min_cosine = (1.0 - share) / (1.0 + share);
        for v in 0..sheet.positions().len() as u32 {
            progress.check()?;
            directed.smooth(v, min_cosine);
        }
        directed.sharpen(height, progress)?;
        Ok(directed)
    }

    /// Returns the direction of a triangle at one of its vertices.
    pub fn at(&self, triangle: u32, vertex: u32) -> DVec3 {
        let corners = self.sheet.triangles()[triangle as usize];
        let corner = corners.iter().position(|&c| c == vertex);
        self.of_corner[triangle as usize][corner.expect("the vertex is one of the triangle's")]
    }

    /// Returns the triangles at an edge, if there are two with opposite directions along it.
    pub fn hinge(&self, edge: u32) -> Option<Hinge> {
        match self.adjacency.uses(edge) {
            [a, b] if a.forward != b.forward => {
                let [left, right] = if a.forward { [a, b] } else { [b, a] };
                Some(Hinge {
                    ends: self.adjacency.edges()[edge as usize],
                    left: left.triangle,
                    right: right.triangle,
                })
            }
            _ => None,
        }
    }

    /// Returns the openings at both ends of a hinge: positive where it is convex.
    pub fn openings(&self, hinge: Hinge) -> [f64; 2] {
        let [a, b] = hinge.ends.map(|v| self.sheet.positions()[v as usize]);
        hinge.ends.map(|v| {
            let [from, to] = [self.at(hinge.left, v), self.at(hinge.right, v)];
            let opening = from.cross(to).dot((b - a).normalize_or_zero());
            if opening.abs() < MIN_OPENING {
                0.0
            } else {
                opening
            }
        })
    }

    /// Assigns one direction to the triangles of each smooth part at a vertex.
    fn smooth(&mut self, v: u32, min_cosine: f64) {
        let around = self.adjacency.triangles_at(v);
        // across a crease of twice the angle, the mean may still be within the angle of both
        let hinge_cosine = 2.0 * min_cosine * min_cosine - 1.0;
        for limit in [hinge_cosine, min_cosine] {
            let parts = self.parts_at(v, around, limit);
            let mut means = vec![DVec3::ZERO; around.len()];
            let mut sizes = vec![0; around.len()];
            for (&t, &part) in around.iter().zip(&parts) {
                means[part] += self.angle_at(t, v) * self.normals[t as usize];
                sizes[part] += 1;
            }
            let mut least = vec![1.0_f64; around.len()];
            for (&t, &part) in around.iter().zip(&parts) {
                let cosine = means[part]
                    .normalize_or_zero()
                    .dot(self.normals[t as usize]);
                least[part] = least[part].min(cosine);
            }
            for (&t, &part) in around.iter().zip(&parts) {
                if least[part] >= min_cosine && sizes[part] > 1 {
                    let scale = 2.0 / (1.0 + least[part]);
                    self.set(t, v, scale * means[part].normalize_or_zero());
                }
            }
            if parts.iter().all(|&part| least[part] >= min_cosine) {
                break;
            }
        }
    }

    /// Returns, for each triangle at a vertex, the first one that is connected to it by hinges flatter than a limit.
    fn parts_at(&self, v: u32, around: &[u32], min_cosine: f64) -> Vec<usize> {
        let mut sets = DisjointSets::new(around.len());
        for (place, &t) in around.iter().enumerate() {
            for edge in (0..3).filter_map(|side| self.adjacency.edge_of(t, side)) {
                let Some(hinge) = self.hinge(edge).filter(|hinge| hinge.ends.contains(&v)) else {
                    continue;
                };
                let [left, right] = [hinge.left, hinge.right];
                let cosine = self.normals[left as usize].dot(self.normals[right as usize]);
                let other = if left == t { right } else { left };
                // the triangles at a vertex ascend
                if let (Ok(other), true) = (around.binary_search(&other), cosine >= min_cosine) {
                    sets.join(place as u32, other as u32);
                }
            }
        }
        (0..around.len() as u32)
            .map(|place| sets.root(place) as usize)
            .collect()
    }

    /// Returns the least-squares intersection of the planes at unit height above all triangles at a vertex.
    fn miter(&self, v: u32) -> DVec3 {
        let mut matrix = DMat3::ZERO;
        let mut right = DVec3::ZERO;
        for &t in self.adjacency.triangles_at(v) {
            let normal = self.normals[t as usize];
            let weighted = self.angle_at(t, v) * normal;
            matrix += DMat3::from_cols(
                weighted * normal.x,
                weighted * normal.y,
                weighted * normal.z,
            );
            right += weighted;
        }
        let mean = right.normalize_or_zero();
        let trace = matrix.x_axis.x + matrix.y_axis.y + matrix.z_axis.z;
        if trace <= 0.0 {
            return mean;
        }
        // damped towards the mean where the planes leave freedom
        let damping = MITER_DAMPING * trace;
        matrix += DMat3::from_diagonal(DVec3::splat(damping));
        let miter = matrix.inverse() * (right + damping * mean);
        if miter.is_finite() {
            miter.clamp_length_max(LONGEST_MITER)
        } else {
            mean
        }
    }

    fn angle_at(&self, triangle: u32, v: u32) -> f64 {
        let corners = self.sheet.triangles()[triangle as usize];
        let places = self.sheet.corners(triangle);
        let i = corners.iter().position(|&c| c == v).unwrap_or(0);
        let [to_next, to_last] = [1, 2].map(|k| places[(i + k) % 3] - places[i]);
        to_next.cross(to_last).length().atan2(to_next.dot(to_last))
    }

    fn set(&mut self, triangle: u32, vertex: u32, direction: DVec3) {
        let corners = self.sheet.triangles()[triangle as usize];
        for (corner, at) in corners.iter().zip(&mut self.of_corner[triangle as usize]) {
            if *corner == vertex {
                *at = direction;
            }
        }
    }

    /// Separates directions where a triangle would turn over, or a hinge would open at one end and close at the other.
    fn sharpen(&mut self, height: f64, progress: &Progress) -> Result<(), Cancelled> {
        loop {
            progress.check()?;
            let mut bad: Vec<u32> = Vec::new();
            for t in 0..self.normals.len() as u32 {
                if !self.keeps_its_side(t, height) {
                    bad.extend(self.sheet.triangles()[t as usize]);
                }
            }
            progress.check()?;
            for edge in 0..self.adjacency.edges().len() as u32 {
                if let Some(hinge) = self.hinge(edge) {
                    let [a, b] = self.openings(hinge);
                    if a * b < 0.0 {
                        bad.extend(hinge.ends);
                    }
                }
            }
            bad.sort_unstable();
            bad.dedup();
            let mut changed = false;
            for v in bad {
                for &t in self.adjacency.triangles_at(v) {
                    let normal = self.normals[t as usize];
                    if self.at(t, v) != normal {
                        changed = true;
                        self.set(t, v, normal);
                    }
                }
            }
            if !changed {
                return Ok(());
            }
        }
    }

    fn keeps_its_side(&self, triangle: u32, height: f64) -> bool {
        let normal = self.normals[triangle as usize];
        let places = self.sheet.corners(triangle);
        let directions = self.of_corner[triangle as usize];
        let area = |height: f64| {
            let [a, b, c] = [0, 1, 2].map(|i| places[i] + height * directions[i]);
            (b - a).cross(c - a).dot(normal)
        };
        let least = MIN_AREA * area(0.0);
        area(0.5 * height) >= least && area(height) >= least
    }
}

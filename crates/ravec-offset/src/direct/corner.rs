//! The moved surface at a vertex: where the triangles around it go, and what fills the gaps between them.
//!
//! Displacements are relative to the distance. A displacement m keeps a triangle with the unit normal n in its moved plane if
//! m·n = 1. Where one does so for all triangles, and is no farther from the vertex than the tolerance allows, the vertex moves as
//! a whole: on smooth surfaces, and at concave edges and corners. Elsewhere convex edges cut the triangles into sectors of
//! one displacement each, an arc leads from each sector to the next, and three sectors or more leave a patch of a sphere.

use super::Shape;
use crate::domain::Field;
use glam::{DMat3, DVec3};

/// Largest error of a displacement from a moved plane, as a share of the tolerance.
const OFF_PLANE: f64 = 0.2;

/// Largest error of the distance of a point, as a share of the tolerance.
const OFF_DISTANCE: f64 = 0.3;

/// Angle beyond which an edge between two sectors is rounded or mitered, as a share of the angle whose miter is off by the
/// tolerance.
const SHARP: f64 = 0.5;

/// Damping of a displacement towards the mean normal, per triangle, and the steps with which it fades: planes that differ by
/// more than a degree are met, and those that differ by less do not send it far off.
const DAMPING: f64 = 1e-3;
const STEPS: usize = 8;

/// Angle of the facets of a patch of a sphere, as a share of that of strips: triangles on a sphere are off in two directions.
const PATCH: f64 = 0.6;

/// A vertex with the triangles around it, counterclockwise.
pub(super) struct Vertex<'a> {
    pub place: DVec3,
    /// Normals of the triangles.
    pub normals: &'a [DVec3],
    /// Angle at the edge before each triangle: positive where the surface is convex.
    pub angles: &'a [f64],
    /// A triangle.
    pub hint: u32,
}

/// The moved surface at a vertex.
#[derive(Debug, Default)]
pub(super) struct MovedCorner {
    pub points: Vec<DVec3>,
    /// The point of each triangle.
    pub of_triangle: Vec<u32>,
    /// The points from the triangle before each edge to that after it.
    pub arcs: Vec<Vec<u32>>,
    /// Triangles between the arcs.
    pub patch: Vec<[u32; 3]>,
}

/// Triangles with one displacement.
struct Sector {
    /// The edge before the first triangle.
    cut: usize,
    displacement: DVec3,
}

impl Vertex<'_> {
    /// Moves the vertex; `None` if the gaps between its triangles cannot be filled.
    pub fn moved(&self, shape: &Shape, field: &Field<'_>) -> Option<MovedCorner> {
        let count = self.normals.len();
        if let Some(displacement) = self.miter(0, count, shape)
            && self.is_at_distance(displacement, shape, field)
        {
            return Some(MovedCorner {
                points: vec![self.at(displacement, shape)],
                of_triangle: vec![0; count],
                arcs: vec![vec![0]; count],
                patch: vec![],
            });
        }
        let sectors = self.sectors(shape)?;
        let corner = self.rounded(&sectors, shape);
        let is_sound = (corner.points.iter())
            .all(|&p| self.is_at_distance((p - self.place) / shape.distance, shape, field));
        is_sound.then_some(corner)
    }

    fn at(&self, displacement: DVec3, shape: &Shape) -> DVec3 {
        self.place + shape.distance * displacement
    }

    /// Returns whether a point is at the distance from the whole mesh.
    fn is_at_distance(&self, displacement: DVec3, shape: &Shape, field: &Field<'_>) -> bool {
        let distance = field.near(self.at(displacement, shape), self.hint).distance;
        (distance - shape.distance).abs() <= OFF_DISTANCE * shape.tolerance
    }

    /// The displacement that keeps some consecutive triangles in their moved planes, if there is one.
    fn miter(&self, first: usize, count: usize, shape: &Shape) -> Option<DVec3> {
        let normals = || (first..first + count).map(|i| self.normals[i % self.normals.len()]);
        let damping = DAMPING * count as f64;
        let (mut matrix, mut sum) = (DMat3::from_diagonal(DVec3::splat(damping)), DVec3::ZERO);
        for n in normals() {
            matrix += DMat3::from_cols(n * n.x, n * n.y, n * n.z);
            sum += n;
        }
        let inverse = matrix.inverse();
        let mut displacement = sum.normalize_or_zero();
        for _ in 0..STEPS {
            displacement = inverse * (sum + damping * displacement);
        }
        let keeps = |n: DVec3| (displacement.dot(n) - 1.0).abs() <= OFF_PLANE * shape.slack();
        (displacement.is_finite() && normals().all(keeps)).then_some(displacement)
    }

    /// Divides the triangles at convex edges; `None` if a concave edge remains between two sectors.
    fn sectors(&self, shape: &Shape) -> Option<Vec<Sector>> {
        let count = self.normals.len();
        let sharp = SHARP * 2.0 * (1.0 / (1.0 + shape.slack())).acos();
        let mut cuts: Vec<usize> = (0..count)
            .filter(|&i| self.angles[i].abs() > sharp)
            .collect();
        let by_angle =
            |&i: &usize, &j: &usize| self.angles[i].abs().total_cmp(&self.angles[j].abs());
        while cuts.len() < 2 {
            cuts.push((0..count).filter(|i| !cuts.contains(i)).max_by(by_angle)?);
        }
        cuts.sort_unstable();
        let mut sectors = Vec::with_capacity(cuts.len());
        // sectors whose planes do not meet in a point are cut once more
        while sectors.len() < cuts.len() {
            let k = sectors.len();
            let (cut, len) = (cuts[k], sector_len(&cuts, k, count));
            if let Some(displacement) = self.miter(cut, len, shape) {
                sectors.push(Sector { cut, displacement });
            } else {
                let within = (cut + 1..cut + len).map(|i| i % count).max_by(by_angle)?;
                cuts.push(within);
                cuts.sort_unstable();
                sectors.clear();
            }
        }
        // concave edges between sectors are mitered
        while let Some(k) = (0..cuts.len())
            .filter(|&k| self.angles[cuts[k]] < 0.0)
            .min_by(|&i, &j| self.angles[cuts[i]].total_cmp(&self.angles[cuts[j]]))
        {
            if cuts.len() == 2 {
                return None;
            }
            let before = (k + cuts.len() - 1) % cuts.len();
            let len = sector_len(&cuts, before, count) + sector_len(&cuts, k, count);
            sectors[before].displacement = self.miter(cuts[before], len, shape)?;
            cuts.remove(k);
            sectors.remove(k);
        }
        Some(sectors)
    }

    /// Connects the sectors by arcs, and fills what these leave.
    fn rounded(&self, sectors: &[Sector], shape: &Shape) -> MovedCorner {
        let count = self.normals.len();
        let mut displacements: Vec<DVec3> =
            sectors.iter().map(|sector| sector.displacement).collect();
        let mut corner = MovedCorner {
            of_triangle: vec![0; count],
            arcs: vec![vec![]; count],
            ..MovedCorner::default()
        };
        for (k, sector) in sectors.iter().enumerate() {
            let next = sectors[(k + 1) % sectors.len()].cut;
            let len = (next + count - sector.cut - 1) % count + 1;
            for i in sector.cut..sector.cut + len {
                corner.of_triangle[i % count] = k as u32;
                corner.arcs[i % count] = vec![k as u32];
            }
        }
        let mut border = Vec::new();
        for (k, sector) in sectors.iter().enumerate() {
            let before = (k + sectors.len() - 1) % sectors.len();
            if sectors.len() == 2 && k == 1 {
                // both edges share the arc
                let shared = corner.arcs[sectors[0].cut].iter().rev().copied();
                corner.arcs[sector.cut] = shared.collect();
                break;
            }
            let angle = if sectors.len() == 2 {
                0.5 * (self.angles[sectors[0].cut] + self.angles[sectors[1].cut])
            } else {
                self.angles[sector.cut]
            };
            let ends = [sectors[before].displacement, sector.displacement];
            let first = displacements.len() as u32;
            let inner = arc(ends, angle, shape);
            displacements.extend(&inner);
            let mut points = vec![before as u32];
            points.extend(first..first + inner.len() as u32);
            border.extend(&points);
            points.push(k as u32);
            corner.arcs[sector.cut] = points;
        }
        if sectors.len() > 2 {
            corner.patch = patch(&border, &mut displacements, shape);
        }
        let points = displacements.iter().map(|&m| self.at(m, shape));
        corner.points = points.collect();
        corner
    }
}

/// Number of triangles from a cut to the next.
fn sector_len(cuts: &[usize], k: usize, count: usize) -> usize {
    let next = cuts[(k + 1) % cuts.len()];
    (next + count - cuts[k] - 1) % count + 1
}

/// Points between two displacements around an edge at which the normals turn by an angle.
///
/// Across the edge they are on a circle, and along it where the arc of an ellipse in the plane of both displacements is: that is
/// where the cylinders around two edges with these ends meet.
fn arc([from, to]: [DVec3; 2], angle: f64, shape: &Shape) -> Vec<DVec3> {
    let is_unit = |m: DVec3| (m.length() - 1.0).abs() <= shape.slack();
    let angle = if is_unit(from) && is_unit(to) {
        from.angle_between(to)
    } else {
        angle
    };
    let steps = (angle / shape.max_angle).ceil().max(1.0) as usize;
    let at = |step: usize| {
        let t = step as f64 / steps as f64;
        (((1.0 - t) * angle).sin() * from + (t * angle).sin() * to) / angle.sin()
    };
    (1..steps).map(at).collect()
}

/// Fills a border, counterclockwise, by rings around its middle.
fn patch(border: &[u32], displacements: &mut Vec<DVec3>, shape: &Shape) -> Vec<[u32; 3]> {
    let n = border.len();
    let at = |displacements: &[DVec3], i: usize| displacements[border[i % n] as usize];
    if n == 3 {
        return vec![[border[0], border[1], border[2]]];
    }
    // the mean over the border by its length, which does not depend on its division
    let weighted = (0..n).map(|i| {
        let (before, here, after) = (
            at(displacements, i + n - 1),
            at(displacements, i),
            at(displacements, i + 1),
        );
        (before.distance(here) + here.distance(after)) * here
    });
    let center = weighted.sum::<DVec3>().normalize_or_zero();
    let farthest = (0..n)
        .map(|i| center.angle_between(at(displacements, i)))
        .fold(0.0, f64::max);
    let rings = (farthest / (PATCH * shape.max_angle)).ceil().max(1.0) as usize;
    let middle = displacements.len() as u32;
    displacements.push(center);
    let mut triangles = Vec::new();
    let mut inner = vec![middle; n];
    for ring in 1..=rings {
        let outer: Vec<u32> = if ring == rings {
            border.to_vec()
        } else {
            let t = ring as f64 / rings as f64;
            let first = displacements.len() as u32;
            for i in 0..n {
                let end = at(displacements, i);
                let angle = center.angle_between(end);
                let direction = ((1.0 - t) * angle).sin() * center
                    + (t * angle).sin() * end.normalize_or_zero();
                let length = 1.0 + t * (end.length() - 1.0);
                displacements.push(length * direction.normalize_or_zero());
            }
            (first..first + n as u32).collect()
        };
        for i in 0..n {
            let j = (i + 1) % n;
            triangles.push([inner[i], outer[i], outer[j]]);
            if ring > 1 {
                triangles.push([inner[i], outer[j], inner[j]]);
            }
        }
        inner = outer;
    }
    triangles
}

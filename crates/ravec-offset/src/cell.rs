//! What a cell holds of the surface: samples of it, the vertex that represents them, and how well it does.

mod feet;
mod pocket;

use crate::field::{Field, Near, Place, Region};
use crate::params::COARSE;
use crate::refine::Setting;
use glam::{DMat3, DVec3};
use ravec_mesh::closest_on_triangle;
use ravec_octree::{CellKey, Corner};
use rustc_hash::FxHashMap;

/// The share of a cell's side that its vertex keeps away from its faces, so that vertices of neighbors never meet.
const MARGIN: f64 = 1e-4;

/// Steps towards the pieces, and then towards the surface.
const FIT_STEPS: usize = 6;
const PROJECTIONS: usize = 2;

/// The share of the tolerance by which the planes at the samples may miss the vertex: where the tolerance is [`COARSE`], and where
/// it is a quarter or four times that, or beyond. Facets are proved anyway, and what fails is split: with 0.8 hardly any fails, but
/// there are more cells. With the second value there are fewer than with the first, and simplified facets turn by 0.1° more,
/// which does no harm where these are turned by less than they may be, as with a finer tolerance, or may be turned by more.
const FLATNESS: [f64; 2] = [0.95, 1.0];

/// The share of the tolerance by which a vertex may miss the surface. With 0.6 tips of some crests are cut off by more than the
/// tolerance; with 0.25 there are up to a third more cells.
const MISS: f64 = 0.5;

/// The angles in degrees by which the normals in a cell may turn from their mean if its vertex is moved off the surface, likewise.
///
/// A cell that holds a part of a sphere is some √(8 r ε) wide, so that moving its vertex by a share of the tolerance ε tilts
/// facets by an angle that grows as √(ε/r). With the first up to a third of the cells is spared; with more, designed parts come out
/// with more than 4° between facets and surface.
const NEARLY_FLAT_DEG: [f64; 2] = [12.0, 24.0];

/// The share of the tolerance within which a sample counts as lying on the surface.
pub(crate) const ON_SURFACE: f64 = 0.02;

/// Rounds after which a root is as good as numbers go: a third of them halve.
const MOST_ROUNDS: usize = 90;

/// Triangles that may go through a cell that is not split: more are slower to look at than parts of it.
pub(crate) const MOST_TRIANGLES: usize = 20;

/// As [`MOST_TRIANGLES`] where these face one way.
pub(crate) const MOST_TRIANGLES_OF_SHEET: usize = 64;

/// The least cosine of the angle between a direction and the normals of triangles that face it.
const FACING: f64 = 0.2;

/// As [`MOST_TRIANGLES`] where the surface is made of the triangles themselves. There they meet at every vertex, in any
/// number, and each of them is looked at. With 6, cells around vertices are split down to the floor, which gave 5 and 15
/// times as many triangles on two open meshes; with 12, twice as many on one of them.
pub(crate) const MOST_TRIANGLES_OF_SURFACE: usize = 40;

/// Whether triangles face one way: a direction is the front of all of them. Where triangles are oriented, lines in that direction
/// go only out of the solid, so that these triangles enclose nothing.
pub(crate) fn is_sheet(normals: &[DVec3]) -> bool {
    let front = normals.iter().sum::<DVec3>().normalize_or_zero();
    let faces = |normal: &DVec3| normal.dot(front) >= FACING || *normal == DVec3::ZERO;
    normals.iter().all(faces)
}

/// A point of the surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Sample {
    pub point: DVec3,
    /// The unit vector away from the triangles: the surface's normal, but for its sign.
    pub away: DVec3,
    pub triangle: u32,
}

/// What is known of a corner of a cell.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct CornerValue {
    /// The closest triangle.
    pub triangle: u32,
    /// The field there: below zero is inside the offset solid.
    pub value: f64,
}

/// An edge of a cell: its lower end, its level and its direction. They are in the order in which those nearby follow one another.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) struct EdgeKey {
    /// The place of the end on the curve through all corners.
    start: u64,
    level: u8,
    axis: u8,
}

impl EdgeKey {
    /// The ends, the lower one first.
    pub fn ends(self) -> [Corner; 2] {
        let start = Corner::at_morton(self.start);
        let level = CellKey {
            at: start,
            level: self.level,
        };
        [start, start.moved(self.axis.into(), level.side())]
    }
}

/// Where the surface goes through edges.
pub(crate) type Roots = FxHashMap<EdgeKey, Sample>;

/// A bit for each corner that lies inside.
pub(crate) fn inside_of(corners: &[CornerValue; 8]) -> u8 {
    (0..8)
        .filter(|&octant| corners[octant].value < 0.0)
        .map(|octant| 1 << octant)
        .sum()
}

/// The edges of a cell whose ends have different signs, by the corners that lie inside.
pub(crate) fn crossed_edges(key: CellKey, inside: u8) -> impl Iterator<Item = EdgeKey> {
    (0..24).filter_map(move |i| {
        let (octant, axis) = (i % 8, i / 8);
        let is_lower = octant >> axis & 1 == 0;
        let differs = (inside >> octant ^ inside >> (octant | 1 << axis)) & 1 == 1;
        (is_lower && differs).then(|| EdgeKey {
            start: key.corner(octant).morton(),
            level: key.level,
            axis: axis as u8,
        })
    })
}

/// A cell with its corners evaluated.
pub(crate) struct Cell<'a> {
    pub setting: &'a Setting<'a>,
    pub key: CellKey,
}

/// What came of looking at a cell.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Fit {
    /// Where its vertex would be; nothing if no sample was found.
    pub vertex: Option<DVec3>,
    /// Whether the vertex stands for all samples, and the signs of the corners for the surface.
    pub is_good: bool,
    /// The triangle closest to the vertex, or to the middle where there is none.
    pub nearest: u32,
}

/// Where a vertex is placed.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Placed {
    pub vertex: DVec3,
    /// The triangle closest to it.
    pub nearest: u32,
    /// By how much it misses the surface at most.
    pub miss: f64,
}

impl Placed {
    /// By how much the planes at some samples miss the vertex at most.
    fn flatness(&self, samples: &[Sample]) -> f64 {
        samples
            .iter()
            .map(|sample| sample.away.dot(self.vertex - sample.point).abs())
            .fold(0.0, f64::max)
    }
}

impl Cell<'_> {
    /// The lowest and the highest place for the vertex.
    fn room(&self) -> [DVec3; 2] {
        let [low, high] = self.setting.frame.bounds(self.key);
        let margin = self.setting.grid.margin(MARGIN, high.x - low.x) * (high - low);
        [low + margin, high - margin]
    }

    /// Looks at the cell: `center` is its middle, `region` the side it lies on and `side` that of its middle, `roots` has at least
    /// those of its edges.
    pub fn fit(
        &self,
        center: Near,
        [region, side]: [Region; 2],
        corners: &[CornerValue; 8],
        roots: &Roots,
    ) -> Fit {
        let mut samples = Vec::with_capacity(24);
        let inside = inside_of(corners);
        samples.extend(crossed_edges(self.key, inside).map(|edge| roots[&edge]));
        let changes = !samples.is_empty();
        self.feet(center, side, corners, &mut samples);
        let through = if region == Region::Unknown && self.setting.field.is_signed() {
            self.triangles()
        } else {
            vec![]
        };
        self.feet_of_triangles(&through, center, &mut samples);
        if !changes {
            // a sheet, or a bump, between the corners
            let deep = samples
                .iter()
                .any(|sample| self.depth(sample.point) > 0.5 * self.setting.tolerance);
            return Fit {
                vertex: None,
                nearest: center.triangle,
                is_good: !deep && !self.may_hold_a_pocket(center, corners, self.is_crowd(&through)),
            };
        }
        let mut placed = self.vertex(&samples);
        let flatness = self.share(FLATNESS) * self.setting.tolerance;
        let is_bent = placed.flatness(&samples) > flatness;
        if is_bent && self.setting.field.level != 0.0 {
            self.balance(&mut placed, &samples);
        }
        Fit {
            vertex: Some(placed.vertex),
            nearest: placed.nearest,
            is_good: placed.flatness(&samples) <= flatness
                && placed.miss <= MISS * self.setting.tolerance
                && sign_components(inside) <= 2,
        }
    }

    /// Moves a vertex off a surface that bends a little, so that facets leave it on both sides and may be larger.
    fn balance(&self, placed: &mut Placed, samples: &[Sample]) {
        let normal = samples.iter().map(|sample| sample.away).sum::<DVec3>();
        let normal = normal.normalize_or_zero();
        let least_cosine = self.share(NEARLY_FLAT_DEG).to_radians().cos();
        if (samples.iter()).any(|sample| sample.away.dot(normal) < least_cosine) {
            return;
        }
        let [low, high] = samples
            .iter()
            .map(|sample| sample.away.dot(placed.vertex - sample.point))
            .fold([0.0, 0.0], |[low, high]: [f64; 2], off| {
                [low.min(off), high.max(off)]
            });
        let most = (MISS * self.setting.tolerance - placed.miss).max(0.0);
        let shift = (-0.5 * (low + high)).clamp(-most, most);
        let [low, high] = self.room();
        let moved = (placed.vertex + shift * normal).clamp(low, high);
        placed.vertex = self.setting.grid.nearest(moved);
        placed.miss += shift.abs();
    }

    /// What lies between the value where cells have to be the flattest, as where the surface is made of the triangles themselves, and
    /// that where they need not be.
    fn share(&self, [flattest, other]: [f64; 2]) -> f64 {
        let fineness = COARSE * self.setting.field.radius() / self.setting.tolerance;
        if fineness == 0.0 {
            return flattest;
        }
        let off = fineness.max(1.0 / fineness).sqrt() - 1.0;
        flattest + off.min(1.0) * (other - flattest)
    }

    /// How far inside the cell a point is.
    fn depth(&self, p: DVec3) -> f64 {
        let [low, high] = self.setting.frame.bounds(self.key);
        (p - low).min(high - p).min_element()
    }

    /// The point in the cell that is nearest to being on the pieces that the samples lie on.
    pub fn vertex(&self, samples: &[Sample]) -> Placed {
        let radius = self.setting.field.radius();
        let [low, high] = self.room();
        let mut triangles: Vec<u32> = samples.iter().map(|sample| sample.triangle).collect();
        triangles.sort_unstable();
        triangles.dedup();
        let mean = samples.iter().map(|sample| sample.point).sum::<DVec3>() / samples.len() as f64;
        let mut v = mean.clamp(low, high);
        v = self.toward_pieces(v, &triangles, [low, high]);
        let mut near = self.setting.field.near(v, samples[0].triangle);
        for _ in 0..2 {
            let is_off = (near.distance - radius).abs() > MISS * self.setting.tolerance;
            if !is_off || triangles.contains(&near.triangle) {
                break;
            }
            triangles.push(near.triangle);
            v = self.toward_pieces(v, &triangles, [low, high]);
            near = self.setting.field.near(v, near.triangle);
        }
        for _ in 0..PROJECTIONS {
            if (near.distance - radius).abs() <= 1e-3 * self.setting.tolerance {
                break;
            }
            let moved = self.setting.field.foot(v, &near).clamp(low, high);
            let there = self.setting.field.near(moved, near.triangle);
            if (there.distance - radius).abs() >= (near.distance - radius).abs() {
                break;
            }
            (v, near) = (moved, there);
        }
        let vertex = self.setting.grid.nearest(v);
        Placed {
            vertex,
            nearest: near.triangle,
            miss: (near.distance - radius).abs() + vertex.distance(v),
        }
    }

    /// Gauss-Newton steps on the distances to some triangles.
    fn toward_pieces(&self, mut v: DVec3, triangles: &[u32], [low, high]: [DVec3; 2]) -> DVec3 {
        let radius = self.setting.field.radius();
        let damping = 1e-3 * triangles.len() as f64;
        for _ in 0..FIT_STEPS {
            let mut normal_matrix = DMat3::from_diagonal(DVec3::splat(damping));
            let mut right = DVec3::ZERO;
            for &triangle in triangles {
                let corners = self.setting.field.bvh().corners(triangle);
                let (distance, gradient) = if radius > 0.0 {
                    let closest = closest_on_triangle(v, corners);
                    let distance = closest.distance_sq.sqrt();
                    if distance <= 0.0 {
                        continue;
                    }
                    (distance, (v - closest.point) / distance)
                } else {
                    // the surface is made of the triangles themselves
                    let normal = self.setting.field.near_of(v, triangle).away;
                    (normal.dot(v - corners[0]), normal)
                };
                let outer = DMat3::from_cols(
                    gradient * gradient.x,
                    gradient * gradient.y,
                    gradient * gradient.z,
                );
                normal_matrix += outer;
                right += (radius - distance) * gradient;
            }
            let moved = (v + normal_matrix.inverse() * right).clamp(low, high);
            let step = moved.distance(v);
            v = moved;
            if step <= 1e-3 * self.setting.tolerance {
                break;
            }
        }
        v
    }
}

/// The ends of an edge.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Ends<'a> {
    pub points: [DVec3; 2],
    pub values: [CornerValue; 2],
    /// Places near the edge.
    pub known: &'a [Place],
}

/// Where the field is zero between two points at which it has different signs: within `enough` of the surface, or as near
/// as numbers go.
pub(crate) fn root(field: &Field<'_>, region: Region, ends: Ends<'_>, enough: f64) -> Sample {
    let Ends {
        points,
        values,
        known,
    } = ends;
    let (mut low, mut high) = (0.0, 1.0);
    let [mut low_value, mut high_value] = values.map(|end| end.value);
    let nearer = usize::from(high_value.abs() < low_value.abs());
    let mut hint = values[nearer].triangle;
    let mut best = None;
    for round in 0..MOST_ROUNDS {
        // where the piece of the closest triangle is, as most edges meet one piece only; halves when that gets stuck
        let t = if round % 3 == 2 {
            0.5 * (low + high)
        } else {
            let mut t = low + (high - low) * low_value / (low_value - high_value);
            // a piece has its like on the other side of its triangle
            if region != Region::Unknown {
                t = root_on_piece(field, points, hint, t);
            }
            t.clamp(low + 1e-6 * (high - low), high - 1e-6 * (high - low))
        };
        let point = points[0].lerp(points[1], t);
        let near = field.near(point, hint);
        hint = near.triangle;
        let region = match region {
            Region::Unknown => field.region_beside(point, near.distance, known),
            known => known,
        };
        let value = field.value(near.distance, region);
        let sample = Sample {
            point,
            away: near.away,
            triangle: near.triangle,
        };
        best = Some(sample);
        if value.abs() <= enough {
            break;
        }
        if (value < 0.0) == (low_value < 0.0) {
            (low, low_value) = (t, value);
        } else {
            (high, high_value) = (t, value);
        }
    }
    best.expect("there was a round")
}

/// Where a segment is at the field's distance from one triangle, by Newton's method from `t`.
fn root_on_piece(field: &Field<'_>, points: [DVec3; 2], triangle: u32, mut t: f64) -> f64 {
    let corners = field.bvh().corners(triangle);
    let along = points[1] - points[0];
    for _ in 0..4 {
        let p = points[0] + t * along;
        let closest = closest_on_triangle(p, corners);
        let distance = closest.distance_sq.sqrt();
        let slope = (p - closest.point).dot(along);
        if slope == 0.0 {
            break;
        }
        let step = (field.radius() - distance) * distance / slope;
        t = (t + step).clamp(0.0, 1.0);
        if step.abs() < 1e-6 {
            break;
        }
    }
    t
}

/// Groups of corners of equal sign that are joined by edges of the cell.
fn sign_components(inside: u8) -> usize {
    components_of(inside) + components_of(!inside)
}

/// Groups of a set of corners of a cube.
fn components_of(mut set: u8) -> usize {
    let mut count = 0;
    while set != 0 {
        count += 1;
        let mut group = 1 << set.trailing_zeros();
        loop {
            let grown = (0..8)
                .filter(|octant| group >> octant & 1 == 1)
                .flat_map(|octant: u8| [1, 2, 4].map(|bit| 1 << (octant ^ bit)))
                .fold(group, |all, corner: u8| all | corner)
                & set;
            if grown == group {
                break;
            }
            group = grown;
        }
        set &= !group;
    }
    count
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sheets_face_one_way() {
        let [x, y, z] = DVec3::AXES;
        assert!(is_sheet(&[x, y, z, DVec3::ZERO]));
        // a ditch with a wall that leans over, and a plate with its back
        assert!(!is_sheet(&[
            z,
            (x + 0.5 * z).normalize(),
            (-x - 0.1 * z).normalize()
        ]));
        assert!(!is_sheet(&[z, z, -z]));
    }

    #[test]
    fn groups_of_corners_are_counted() {
        assert_eq!(components_of(0), 0);
        assert_eq!(components_of(0xff), 1);
        assert_eq!(components_of(0b1000_0001), 2);
        assert_eq!(components_of(0b0110_1001), 4);
        assert_eq!(components_of(0b0000_1111), 1);
    }
}

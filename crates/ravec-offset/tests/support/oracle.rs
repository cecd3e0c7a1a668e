//! Distance and winding number by the plain definition: a loop over all triangles.

use glam::DVec3;
use ravec_mesh::TriMesh;

/// The triangles of a mesh, one after the other.
pub struct Oracle {
    triangles: Vec<[DVec3; 3]>,
}

/// Triangles whose doubled area is a smaller share of the square of their longest side count as their sides: no point of
/// them is farther from those than this share of that side, while the direction of their normal is lost in rounding.
const FLAT: f64 = 1e-9;

impl Oracle {
    pub fn new(mesh: &TriMesh) -> Self {
        let all = 0..mesh.triangles().len() as u32;
        Self {
            triangles: all.map(|t| mesh.corners(t)).collect(),
        }
    }

    /// Returns the distance of `p` from the triangles.
    pub fn distance(&self, p: DVec3) -> f64 {
        let distance_sq = self.triangles.iter().map(|&t| distance_sq(p, t));
        distance_sq.fold(f64::INFINITY, f64::min).sqrt()
    }

    /// Returns the winding number of the triangles around `p`: the sum of their solid angles (van Oosterom and Strackee, 1983).
    pub fn winding(&self, p: DVec3) -> f64 {
        let angle = |&[a, b, c]: &[DVec3; 3]| {
            let [a, b, c] = [a - p, b - p, c - p];
            let [x, y, z] = [a.length(), b.length(), c.length()];
            let below = x * y * z + a.dot(b) * z + b.dot(c) * x + c.dot(a) * y;
            2.0 * a.dot(b.cross(c)).atan2(below)
        };
        self.triangles.iter().map(angle).sum::<f64>() / (4.0 * std::f64::consts::PI)
    }

    pub fn is_inside(&self, p: DVec3) -> bool {
        self.winding(p) > 0.5
    }
}

/// The squared distance to a triangle: to its plane if the foot lies inside, else to its nearest side.
fn distance_sq(p: DVec3, [a, b, c]: [DVec3; 3]) -> f64 {
    let sides = [(a, b), (b, c), (c, a)];
    let normal = (b - a).cross(c - a);
    let longest_sq = sides.map(|(from, to)| from.distance_squared(to));
    let longest_sq = longest_sq.into_iter().fold(0.0, f64::max);
    let within = |&(from, to): &(DVec3, DVec3)| normal.dot((to - from).cross(p - from)) > 0.0;
    if normal.length() > FLAT * longest_sq && sides.iter().all(within) {
        let height = normal.dot(p - a);
        return height * height / normal.length_squared();
    }
    let to_side = |(from, to): (DVec3, DVec3)| {
        let (side, offset) = (to - from, p - from);
        let length_sq = side.length_squared();
        if length_sq == 0.0 {
            return offset.length_squared();
        }
        let along = (offset.dot(side) / length_sq).clamp(0.0, 1.0);
        (offset - along * side).length_squared()
    };
    sides.map(to_side).into_iter().fold(f64::INFINITY, f64::min)
}

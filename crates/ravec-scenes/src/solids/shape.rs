//! Distances by formula.
//!
//! Those of sphere, box, torus and of solids that are extruded or turned are exact, inside as well; see Quilez,
//! "Distance functions", 2008.

use glam::{DVec2, DVec3};

/// A surface around the origin.
#[derive(Debug, Clone)]
pub(super) enum Shape {
    Sphere {
        radius: f64,
    },
    Box {
        half_size: DVec3,
    },
    /// Around the z axis.
    Cylinder {
        radius: f64,
        half_height: f64,
    },
    /// Around the z axis, with its base at z = 0.
    Cone {
        radius: f64,
        height: f64,
    },
    /// Around the z axis.
    Torus {
        major: f64,
        minor: f64,
    },
    /// A polygon in x and y, between two planes.
    Prism {
        outline: Vec<DVec2>,
        half_depth: f64,
    },
    /// Without inside.
    Rectangles(Vec<Rectangle>),
    /// Without inside.
    Triangles(Vec<[DVec3; 3]>),
}

/// A flat rectangle.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rectangle {
    pub center: DVec3,
    /// From the center to the middles of two sides, at a right angle.
    pub half_sides: [DVec3; 2],
}

impl Shape {
    pub fn distance(&self, p: DVec3) -> f64 {
        match self {
            Self::Sphere { radius } => p.length() - radius,
            Self::Box { half_size } => {
                let beyond = p.abs() - half_size;
                beyond.max(DVec3::ZERO).length() + beyond.max_element().min(0.0)
            }
            Self::Cylinder {
                radius,
                half_height,
            } => both(p.truncate().length() - radius, p.z.abs() - half_height),
            Self::Cone { radius, height } => {
                // turned into the half plane, of which the other half is the mirror image
                let profile = [
                    DVec2::new(-radius, 0.0),
                    DVec2::new(*radius, 0.0),
                    DVec2::new(0.0, *height),
                ];
                distance_to_polygon(DVec2::new(p.truncate().length(), p.z), &profile)
            }
            Self::Torus { major, minor } => (p.truncate().length() - major).hypot(p.z) - minor,
            Self::Prism {
                outline,
                half_depth,
            } => both(
                distance_to_polygon(p.truncate(), outline),
                p.z.abs() - half_depth,
            ),
            Self::Rectangles(list) => list
                .iter()
                .map(|rectangle| rectangle.distance(p))
                .fold(f64::INFINITY, f64::min),
            Self::Triangles(list) => list
                .iter()
                .map(|&corners| distance_to_triangle(p, corners))
                .fold(f64::INFINITY, f64::min),
        }
    }
}

impl Rectangle {
    fn distance(&self, p: DVec3) -> f64 {
        let offset = p - self.center;
        let nearest: DVec3 = self
            .half_sides
            .iter()
            .map(|&side| side * (offset.dot(side) / side.length_squared()).clamp(-1.0, 1.0))
            .sum();
        (offset - nearest).length()
    }
}

/// The distance to what two conditions at right angles leave inside, from those to each.
fn both(x: f64, y: f64) -> f64 {
    x.max(0.0).hypot(y.max(0.0)) + x.max(y).min(0.0)
}

/// The distance to the border of a simple polygon, negative inside.
fn distance_to_polygon(p: DVec2, outline: &[DVec2]) -> f64 {
    let (mut nearest_sq, mut inside) = (f64::INFINITY, false);
    for (i, &to) in outline.iter().enumerate() {
        let from = outline[(i + outline.len() - 1) % outline.len()];
        let (side, offset) = (to - from, p - from);
        let along = (offset.dot(side) / side.length_squared()).clamp(0.0, 1.0);
        nearest_sq = f64::min(nearest_sq, offset.distance_squared(side * along));
        // a ray to the right crosses the border an odd number of times from inside
        if (from.y > p.y) != (to.y > p.y) && offset.x < side.x * (offset.y / side.y) {
            inside = !inside;
        }
    }
    if inside {
        -nearest_sq.sqrt()
    } else {
        nearest_sq.sqrt()
    }
}

fn distance_to_segment(p: DVec3, from: DVec3, to: DVec3) -> f64 {
    let (side, offset) = (to - from, p - from);
    let length_sq = side.length_squared();
    if length_sq == 0.0 {
        return offset.length();
    }
    let along = (offset.dot(side) / length_sq).clamp(0.0, 1.0);
    offset.distance(side * along)
}

/// The distance to a triangle: to its plane if the foot is inside, else to its nearest side.
pub(super) fn distance_to_triangle(p: DVec3, [a, b, c]: [DVec3; 3]) -> f64 {
    let normal = (b - a).cross(c - a);
    let inside = [(a, b), (b, c), (c, a)]
        .iter()
        .all(|&(from, to)| normal.dot((to - from).cross(p - from)) > 0.0);
    if inside {
        return normal.normalize().dot(p - a).abs();
    }
    distance_to_segment(p, a, b)
        .min(distance_to_segment(p, b, c))
        .min(distance_to_segment(p, c, a))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_l_shaped_polygon_has_an_inside_and_an_outside() {
        let outline = [(0., 0.), (3., 0.), (3., 1.), (1., 1.), (1., 4.), (0., 4.)]
            .map(|(x, y)| DVec2::new(x, y));
        let at = |x: f64, y: f64| distance_to_polygon(DVec2::new(x, y), &outline);
        assert_eq!(at(0.5, 2.0), -0.5);
        assert_eq!(at(0.5, 0.5), -0.5);
        assert_eq!(at(2.0, 3.0), 1.0);
        assert_eq!(at(6.0, 5.0), 5.0);
        assert_eq!(at(-3.0, 8.0), 5.0);
    }

    #[test]
    fn triangles_without_area_are_segments_and_points() {
        let p = DVec3::new(1.0, 2.0, 0.0);
        assert_eq!(distance_to_triangle(p, [DVec3::X; 3]), 2.0);
        let segment = [DVec3::ZERO, DVec3::X * 3.0, DVec3::X * 2.0];
        assert_eq!(distance_to_triangle(p, segment), 2.0);
    }
}

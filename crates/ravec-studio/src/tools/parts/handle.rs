//! The handle of a part: three arrows that shift it along an axis, and three rings that turn it about one.
//!
//! Arrows and rings follow the axes of space, not those of the part. They have the same size on the screen at any zoom.

use crate::view::mesh::MeshView;
use egui::{Color32, Painter, Pos2, Shape, Stroke, Vec2};
use glam::DVec3;
use ravec::mesh_render::Sight;
use ravec_jobs::mesh::boolean::Placement;

/// Length of an arrow in screen points.
const ARROW: f64 = 96.0;

/// Share of an arrow at its root that is not taken: the roots of three arrows are in one place.
const ROOT: f64 = 0.25;

/// Radius of a ring in screen points: below that of the arrows, so that their tips are free.
const RING: f64 = 66.0;

/// Distance within which a handle is taken, in screen points.
const REACH: f32 = 8.0;

/// Least length of an arrow on the screen, in points: one that points at the eye cannot be dragged.
const MIN_ARROW: f32 = 14.0;

/// Cosine between the line of sight and the axis of a ring, below which the ring is seen from its edge.
const EDGE_ON: f64 = 0.2;

/// Lines of a ring.
const SEGMENTS: usize = 72;

/// Steps of a turn in degrees, and those with the key Ctrl.
const TURN_STEPS: [f64; 2] = [0.1, 15.0];

/// Steps of numbers that a turn is made of, in degrees: finer than is seen.
const ANGLE_STEP: f64 = 1e-4;

/// The colors of the axes x, y and z.
const COLORS: [Color32; 3] = [
    Color32::from_rgb(222, 66, 66),
    Color32::from_rgb(70, 168, 70),
    Color32::from_rgb(72, 118, 232),
];

/// The color of what is taken or may be.
const ACTIVE: Color32 = Color32::from_rgb(250, 190, 40);

/// A part of the handle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Grip {
    /// The arrow along an axis.
    Arrow(usize),
    /// The ring about an axis.
    Ring(usize),
}

impl Grip {
    /// All parts of a handle.
    pub const ALL: [Self; 6] = [
        Self::Arrow(0),
        Self::Arrow(1),
        Self::Arrow(2),
        Self::Ring(0),
        Self::Ring(1),
        Self::Ring(2),
    ];

    /// Its name, such as `Move b along x`.
    pub fn name(self, part: &str) -> String {
        let axis = |axis: usize| ["x", "y", "z"][axis];
        match self {
            Self::Arrow(k) => format!("Move {part} along {}", axis(k)),
            Self::Ring(k) => format!("Turn {part} about {}", axis(k)),
        }
    }
}

/// A handle in a view.
#[derive(Debug, Clone)]
pub(super) struct Handle {
    view: MeshView,
    center: DVec3,
    /// Length of a screen point at the center.
    point: f64,
    /// The ends of the arrows on the screen that can be dragged.
    arrows: [Option<[Pos2; 2]>; 3],
    /// The rings on the screen, as closed lines.
    rings: [Vec<RingPoint>; 3],
}

/// A point of a ring.
#[derive(Debug, Clone, Copy)]
struct RingPoint {
    point: DVec3,
    at: Pos2,
    /// True on the side of the eye.
    front: bool,
}

impl Handle {
    /// The handle about a point; `None` if the point is not seen.
    pub fn new(view: &MeshView, center: DVec3) -> Option<Self> {
        view.project(center)?;
        let point = 1.0 / view.points_per_unit(center);
        if !(point.is_finite() && point > 0.0) {
            return None;
        }
        let arrow = |axis: usize| {
            let at = |share: f64| view.project(center + share * ARROW * point * DVec3::AXES[axis]);
            let ends = [at(ROOT)?, at(1.0)?];
            (ends[0].distance(ends[1]) > MIN_ARROW).then_some(ends)
        };
        let [_, _, toward] = view.axes();
        let ring = |axis: usize| {
            let angles = (0..=SEGMENTS).map(|k| std::f64::consts::TAU * k as f64 / SEGMENTS as f64);
            let points = angles.filter_map(|angle| {
                let offset = RING * point * on_circle(axis, angle);
                Some(RingPoint {
                    point: center + offset,
                    at: view.project(center + offset)?,
                    front: offset.dot(toward) > -1e-9 * point,
                })
            });
            points.collect()
        };
        Some(Self {
            view: *view,
            center,
            point,
            arrows: [0, 1, 2].map(arrow),
            rings: [0, 1, 2].map(ring),
        })
    }

    /// The distance of a place of the screen from a part of the handle, in points.
    fn distance(&self, grip: Grip, at: Pos2) -> f32 {
        match grip {
            Grip::Arrow(axis) => {
                self.arrows[axis].map_or(f32::INFINITY, |ends| to_segment(at, ends))
            }
            Grip::Ring(axis) => {
                let sides = self.rings[axis].windows(2);
                let distances = sides.map(|side| to_segment(at, [side[0].at, side[1].at]));
                distances.fold(f32::INFINITY, f32::min)
            }
        }
    }

    /// The place of a part of the handle where a hand would take it: the tip of an arrow; the place of a ring on the side of the
    /// eye that is farthest from all else.
    pub fn place(&self, grip: Grip) -> Option<Pos2> {
        match grip {
            Grip::Arrow(axis) => self.arrows[axis].map(|[_, tip]| tip),
            Grip::Ring(axis) => {
                let clearance = |at: Pos2| {
                    let others = Grip::ALL.into_iter().filter(|other| *other != grip);
                    let distances = others.map(|other| self.distance(other, at));
                    distances.fold(f32::INFINITY, f32::min)
                };
                let places = self.rings[axis].iter().step_by(3);
                let places = places.filter(|point| point.front);
                let clear = places.map(|point| (clearance(point.at), point.at));
                let best = clear.max_by(|a, b| a.0.total_cmp(&b.0));
                best.map(|(_, at)| at)
            }
        }
    }

    /// The part of the handle at a place of the screen.
    pub fn grip(&self, at: Pos2) -> Option<Grip> {
        let near = Grip::ALL.map(|grip| (self.distance(grip, at), grip));
        let nearest = near.into_iter().min_by(|a, b| a.0.total_cmp(&b.0));
        nearest
            .filter(|(distance, _)| *distance < REACH)
            .map(|(_, grip)| grip)
    }

    /// The place of a part that was at `start` when the hand took a grip `from` somewhere, and is `to` somewhere else now.
    pub fn dragged(
        &self,
        grip: Grip,
        start: &Placement,
        [from, to]: [Pos2; 2],
        coarse: bool,
    ) -> Option<Placement> {
        let mut placement = start.clone();
        match grip {
            Grip::Arrow(axis) => {
                let along = self.along(axis, to)? - self.along(axis, from)?;
                // numbers that can be read: no finer than a point of the screen
                let step = 10f64.powi(self.point.log10().floor() as i32 + i32::from(coarse));
                let shift = &mut placement.shift[axis];
                *shift = rounded(*shift + along, step);
            }
            Grip::Ring(axis) => {
                let angle = self.angle(axis, [from, to])?.to_degrees();
                let angle = rounded(angle, TURN_STEPS[usize::from(coarse)]);
                let mut about = Placement::new("");
                about.turn_deg[axis] = angle;
                placement = placement.with_turn(about.turn() * start.turn());
                placement.turn_deg = placement.turn_deg.map(|angle| rounded(angle, ANGLE_STEP));
            }
        }
        Some(placement)
    }

    /// The coordinate along the axis of the point that is nearest to a line of sight.
    fn along(&self, axis: usize, at: Pos2) -> Option<f64> {
        let Sight { origin, direction } = self.view.sight(at);
        let axis = DVec3::AXES[axis];
        let from = origin - self.center;
        let cosine = axis.dot(direction);
        let along = (axis.dot(from) - cosine * direction.dot(from)) / (1.0 - cosine * cosine);
        along.is_finite().then_some(along)
    }

    /// The angle between two places of a ring, in radians.
    fn angle(&self, axis: usize, [from, to]: [Pos2; 2]) -> Option<f64> {
        let normal = DVec3::AXES[axis];
        let spoke = |at: Pos2| {
            let Sight { origin, direction } = self.view.sight(at);
            let slope = normal.dot(direction);
            let t = normal.dot(self.center - origin) / slope;
            (slope.abs() > EDGE_ON && t > 0.0).then(|| origin + t * direction - self.center)
        };
        if let (Some(a), Some(b)) = (spoke(from), spoke(to)) {
            return Some(normal.dot(a.cross(b)).atan2(a.dot(b)));
        }
        // seen from the edge: the hand rolls the ring
        let points = self.rings[axis].iter().filter(|point| point.front);
        let near = points.map(|point| (point.at.distance(from), point.point));
        let (_, taken) = near.min_by(|a, b| a.0.total_cmp(&b.0))?;
        let tangent = normal.cross(taken - self.center);
        let step = 1e-3;
        let moved = self.view.project(taken + step * tangent)? - self.view.project(taken)?;
        let per_radian = moved / step as f32;
        let angle = (to - from).dot(per_radian) / per_radian.length_sq();
        angle.is_finite().then_some(f64::from(angle))
    }

    /// Draws the handle.
    pub fn paint(&self, painter: &Painter, active: Option<Grip>) {
        let color = |grip: Grip| match grip {
            _ if active == Some(grip) => ACTIVE,
            Grip::Arrow(axis) | Grip::Ring(axis) => COLORS[axis],
        };
        for (axis, points) in self.rings.iter().enumerate() {
            let color = color(Grip::Ring(axis));
            for side in points.windows(2) {
                let front = side[0].front && side[1].front;
                let color = if front {
                    color
                } else {
                    color.gamma_multiply(0.35)
                };
                painter.line_segment([side[0].at, side[1].at], Stroke::new(2.0, color));
            }
        }
        for (axis, arrow) in self.arrows.iter().enumerate() {
            let Some([root, tip]) = *arrow else {
                continue;
            };
            let color = color(Grip::Arrow(axis));
            let along = (tip - root).normalized();
            let across = Vec2::new(-along.y, along.x);
            let neck = tip - 14.0 * along;
            painter.line_segment([root, neck], Stroke::new(3.0, color));
            let head = vec![tip, neck + 6.0 * across, neck - 6.0 * across];
            painter.add(Shape::convex_polygon(head, color, Stroke::NONE));
        }
    }
}

/// The unit vector at an angle of the circle about an axis.
fn on_circle(axis: usize, angle: f64) -> DVec3 {
    let [a, b] = [1, 2].map(|k| DVec3::AXES[(axis + k) % 3]);
    angle.cos() * a + angle.sin() * b
}

/// The multiple of a step that is nearest to a number.
fn rounded(number: f64, step: f64) -> f64 {
    // a step below 1 as its inverse: 0.1 has no exact value, but 10 has
    let multiple = if step < 1.0 {
        let parts = (1.0 / step).round();
        (number * parts).round() / parts
    } else {
        (number / step).round() * step
    };
    // no negative zero
    multiple + 0.0
}

/// Distance of a point from a segment on the screen.
fn to_segment(at: Pos2, [a, b]: [Pos2; 2]) -> f32 {
    let along = b - a;
    let share = ((at - a).dot(along) / along.length_sq().max(1e-6)).clamp(0.0, 1.0);
    (a + share * along).distance(at)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::view::mesh::OrbitCamera;
    use egui::{Rect, pos2, vec2};
    use glam::DMat3;
    use ravec::mesh::Aabb;
    use ravec::mesh_render::View;

    fn handles() -> Vec<Handle> {
        let bounds = Aabb::new(DVec3::splat(-10.0), DVec3::splat(30.0));
        let area = Rect::from_min_size(pos2(100.0, 50.0), vec2(700.0, 600.0));
        let views = [View::ISO, View::new(33.0, 21.0), View::new(-140.0, 50.0)];
        let cameras = views.into_iter().flat_map(|view| {
            [false, true].map(|perspective| OrbitCamera {
                view,
                perspective,
                center: bounds.center(),
                span: 80.0,
                ..OrbitCamera::default()
            })
        });
        let views = cameras.map(|camera| camera.on(bounds, area).unwrap());
        views
            .map(|view| Handle::new(&view, DVec3::new(3.0, 8.0, 12.0)).unwrap())
            .collect()
    }

    #[test]
    fn each_part_is_taken_at_its_place() {
        for handle in handles() {
            for grip in Grip::ALL {
                assert_eq!(handle.grip(handle.place(grip).unwrap()), Some(grip));
            }
            assert_eq!(handle.grip(pos2(101.0, 51.0)), None);
        }
    }

    #[test]
    fn an_arrow_shifts_the_part_along_its_axis_as_far_as_the_hand_goes() {
        for handle in handles() {
            for axis in 0..3 {
                let wanted = 7.0 * DVec3::AXES[axis];
                let from = handle.place(Grip::Arrow(axis)).unwrap();
                let tip = handle.center + ARROW * handle.point * DVec3::AXES[axis];
                let to = handle.view.project(tip + wanted).unwrap();
                let start = "b:1,2,3,10,20,30,2".parse().unwrap();
                let moved = handle
                    .dragged(Grip::Arrow(axis), &start, [from, to], false)
                    .unwrap();
                let shift = DVec3::from(moved.shift) - DVec3::from(start.shift);
                // as near as places on the screen are known, and rounded to a point
                assert!((shift - wanted).length() < 0.06, "{shift} {wanted}");
                assert_eq!((moved.turn_deg, moved.scale), (start.turn_deg, start.scale));
            }
        }
    }

    #[test]
    fn a_ring_turns_the_part_about_its_axis_as_far_as_the_hand_goes() {
        for handle in handles() {
            for axis in 0..3 {
                for [a, b] in [[0.3, 1.1], [2.0, 1.2], [3.0, 5.5]] {
                    let places = [a, b].map(|angle| {
                        let spoke = RING * handle.point * on_circle(axis, angle);
                        handle.view.project(handle.center + spoke).unwrap()
                    });
                    let start: Placement = "b:1,2,3,10,20,30,2".parse().unwrap();
                    let grip = Grip::Ring(axis);
                    let moved = handle.dragged(grip, &start, places, false).unwrap();
                    let about = DMat3::from_axis_angle(DVec3::AXES[axis], b - a);
                    let error = moved.turn() - about * start.turn();
                    // rounded to a tenth of a degree
                    assert!(error.abs_diff_eq(DMat3::ZERO, 2e-3), "{error}");
                    assert_eq!((moved.shift, moved.scale), (start.shift, start.scale));
                }
            }
        }
    }

    #[test]
    fn a_ring_that_is_seen_from_its_edge_rolls() {
        let other = handles().remove(0);
        let camera = OrbitCamera {
            view: View::FRONT,
            ..other.view.camera
        };
        let view = camera.on(other.view.bounds, other.view.area).unwrap();
        let handle = Handle::new(&view, other.center).unwrap();
        let from = handle.view.project(handle.center).unwrap();
        let per_radian = (RING * handle.point * handle.view.points_per_unit(handle.center)) as f32;
        let to = from + vec2(0.5 * per_radian, 0.0);
        let start = Placement::new("b");
        let moved = handle
            .dragged(Grip::Ring(2), &start, [from, to], false)
            .unwrap();
        // what is in front goes to the right, which is counter-clockwise seen from above
        let [x, y, z] = moved.turn_deg;
        assert_eq!([x, y], [0.0, 0.0]);
        assert!((z.to_radians() - 0.5).abs() < 0.05, "{z}");
    }

    #[test]
    fn numbers_are_rounded_to_steps_that_can_be_read() {
        assert_eq!(rounded(1.234_567, 0.01), 1.23);
        assert_eq!(rounded(-0.001, 0.01).to_string(), "0");
        assert_eq!(rounded(1234.0, 100.0), 1200.0);
        assert_eq!(rounded(37.2, 15.0), 30.0);
    }
}

//! Points that are given by coordinates, or by the lines and planes that meet in them.
//!
//! Cuts make points that doubles cannot represent. They are kept as what defines them: the line and the plane, or the
//! three planes, through corners of the input. Each has intervals around its coordinates, which decide nearly every
//! question, and integers in reserve, which decide the rest.
//!
//! Source: Attene, "Indirect predicates for geometric constructions", 2020; we take intervals and integers of unlimited
//! size where that work has semi-static filters and expansions.

use std::cmp::Ordering;
use std::sync::OnceLock;

use glam::DVec3;
use ravec_mesh::Sign;

use super::exact::{self, Exact, Grid};
use super::interval::Interval;

/// Definition of a point without coordinates of its own.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Definition {
    /// A line goes through a plane.
    LinePlane([DVec3; 2], [DVec3; 3]),
    /// Three planes meet.
    Planes([[DVec3; 3]; 3]),
}

/// A point with intervals around its coordinates, and exact ones when they are needed.
#[derive(Debug, Clone)]
pub(crate) struct Point {
    pub near: [Interval; 3],
    definition: Option<Definition>,
    exact: OnceLock<Box<Exact>>,
}

type Vec3 = [Interval; 3];

fn sub(a: DVec3, b: DVec3) -> Vec3 {
    std::array::from_fn(|k| Interval::from(a[k]) - Interval::from(b[k]))
}

fn cross(a: Vec3, b: Vec3) -> Vec3 {
    std::array::from_fn(|k| {
        let (i, j) = ((k + 1) % 3, (k + 2) % 3);
        a[i] * b[j] - a[j] * b[i]
    })
}

fn dot(a: Vec3, b: Vec3) -> Interval {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// The normal of the plane through three points, as intervals.
pub(crate) fn normal(plane: &[DVec3; 3]) -> Vec3 {
    cross(sub(plane[1], plane[0]), sub(plane[2], plane[0]))
}

impl Definition {
    /// Intervals around the coordinates of the point. A coordinate that is the same all over the line or a plane is that
    /// of the point, so that what is cut from a plane along two axes stays in it.
    fn near(&self) -> [Interval; 3] {
        let mut near = self.meeting();
        let mut fix = |points: &[DVec3]| {
            for (axis, near) in near.iter_mut().enumerate() {
                let first = points[0][axis];
                if points.iter().all(|p| p[axis] == first) {
                    *near = Interval::from(first);
                }
            }
        };
        match self {
            Self::LinePlane(line, plane) => {
                fix(line);
                fix(plane);
            }
            Self::Planes(planes) => planes.iter().for_each(|plane| fix(plane)),
        }
        near
    }

    /// Intervals around the coordinates of the place where it all meets.
    fn meeting(&self) -> [Interval; 3] {
        match self {
            Self::LinePlane(line, plane) => {
                let n = normal(plane);
                let d = sub(line[1], line[0]);
                let t = dot(n, sub(plane[0], line[0])) / dot(n, d);
                std::array::from_fn(|k| Interval::from(line[0][k]) + d[k] * t)
            }
            Self::Planes(planes) => {
                let origin = planes[0][0];
                let n = planes.each_ref().map(normal);
                let offset = |k: usize| dot(n[k], sub(planes[k][0], origin));
                let c = [cross(n[1], n[2]), cross(n[2], n[0]), cross(n[0], n[1])];
                let w = dot(n[0], c[0]);
                let (d1, d2) = (offset(1), offset(2));
                std::array::from_fn(|k| {
                    Interval::from(origin[k]) + (c[1][k] * d1 + c[2][k] * d2) / w
                })
            }
        }
    }

    fn exact(&self, grid: Grid) -> Option<Exact> {
        match self {
            Self::LinePlane(line, plane) => Exact::of_line_and_plane(grid, line, plane),
            Self::Planes(planes) => Exact::of_planes(grid, planes),
        }
    }
}

impl Point {
    /// A point with coordinates on the grid.
    pub fn at(p: DVec3) -> Self {
        Self {
            near: p.to_array().map(Interval::from),
            definition: None,
            exact: OnceLock::new(),
        }
    }

    /// The point that lines and planes define, which must meet in one point. Intervals wider than `max_width` are
    /// made as narrow as doubles allow.
    pub fn defined(definition: Definition, max_width: f64, grid: Grid) -> Self {
        let mut point = Self {
            near: definition.near(),
            definition: Some(definition),
            exact: OnceLock::new(),
        };
        // written so that what is not a number counts as wide
        if !point.near.iter().all(|i| i.width() <= max_width) {
            point.near = std::array::from_fn(|k| point.exact(grid).rounded(grid, k));
        }
        point
    }

    /// Returns `true` if the point has coordinates.
    pub fn is_given(&self) -> bool {
        self.definition.is_none()
    }

    /// The nearest double to each coordinate, or one of its neighbors.
    pub fn rounded(&self) -> DVec3 {
        DVec3::from_array(self.near.map(Interval::mid))
    }

    pub fn exact(&self, grid: Grid) -> &Exact {
        self.exact.get_or_init(|| {
            Box::new(match &self.definition {
                None => Exact::of_point(grid, self.rounded()),
                Some(definition) => definition
                    .exact(grid)
                    .expect("points are defined only where lines and planes were seen to meet"),
            })
        })
    }

    /// Compares coordinate `axis` with that of `other`, exactly.
    pub fn compare(&self, other: &Self, axis: usize, grid: Grid) -> Ordering {
        let (a, b) = (self.near[axis], other.near[axis]);
        if a.hi < b.lo {
            Ordering::Less
        } else if a.lo > b.hi {
            Ordering::Greater
        } else if self.is_given() && other.is_given() {
            a.lo.partial_cmp(&b.lo).unwrap_or(Ordering::Equal)
        } else {
            self.exact(grid).compare(other.exact(grid), axis)
        }
    }

    /// Returns `true` if both are the same place, exactly.
    pub fn is_same(&self, other: &Self, grid: Grid) -> bool {
        (0..3).all(|k| self.near[k].meets(other.near[k]))
            && (0..3).all(|k| self.compare(other, k, grid).is_eq())
    }
}

/// On which side of the line from `a` to `b` the point `c` lies, seen against `axis`: positive to the left.
pub(crate) fn orient2d(a: &Point, b: &Point, c: &Point, axis: usize, grid: Grid) -> Sign {
    let (i, j) = ((axis + 1) % 3, (axis + 2) % 3);
    if a.is_given() && b.is_given() && c.is_given() {
        let flat = |p: &Point| glam::DVec2::new(p.near[i].lo, p.near[j].lo);
        return ravec_mesh::orient2d(flat(a), flat(b), flat(c));
    }
    // With middles instead of intervals the determinant is wrong by no more than the products of the largest differences
    // and the widths of the intervals (the roundings of differences are less than the widths, which are an ulp or more).
    let mid = |p: &Point, k: usize| p.near[k].mid();
    let (ax, ay) = (mid(a, i), mid(a, j));
    let (bx, by) = (mid(b, i) - ax, mid(b, j) - ay);
    let (cx, cy) = (mid(c, i) - ax, mid(c, j) - ay);
    let det = bx * cy - by * cx;
    let size = bx.abs().max(by.abs()).max(cx.abs()).max(cy.abs());
    let width = [a, b, c]
        .iter()
        .map(|p| p.near[i].width().max(p.near[j].width()) + ulp(p.near[i]).max(ulp(p.near[j])))
        .fold(0.0, f64::max);
    let bound = 8.0 * width * (size + width) + 8.0 * f64::EPSILON * size * size;
    if det > bound {
        return Sign::Positive;
    }
    if det < -bound {
        return Sign::Negative;
    }
    exact::orient2d([a.exact(grid), b.exact(grid), c.exact(grid)], axis)
}

/// A step between neighboring doubles around the numbers of an interval.
fn ulp(i: Interval) -> f64 {
    i.lo.abs().max(i.hi.abs()) * f64::EPSILON
}

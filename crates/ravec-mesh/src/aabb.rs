//! Boxes along the axes.

use glam::DVec3;
use serde::{Deserialize, Serialize};

/// A closed box along the axes, from `min` to `max`. Empty if `min` exceeds `max` on any axis.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Aabb {
    /// The corner with the smallest coordinates.
    pub min: DVec3,
    /// The corner with the largest coordinates.
    pub max: DVec3,
}

impl Aabb {
    /// The box that holds nothing.
    pub const EMPTY: Self = Self {
        min: DVec3::INFINITY,
        max: DVec3::NEG_INFINITY,
    };

    /// The box from `min` to `max`.
    pub const fn new(min: DVec3, max: DVec3) -> Self {
        Self { min, max }
    }

    /// The smallest box around `points`.
    pub fn around(points: impl IntoIterator<Item = DVec3>) -> Self {
        points.into_iter().fold(Self::EMPTY, Self::with_point)
    }

    /// Returns `true` if the box holds no point.
    pub fn is_empty(&self) -> bool {
        !self.min.cmple(self.max).all()
    }

    /// The smallest box around this one and `point`.
    #[inline]
    pub fn with_point(self, point: DVec3) -> Self {
        Self::new(self.min.min(point), self.max.max(point))
    }

    /// The smallest box around both.
    #[inline]
    pub fn union(self, other: Self) -> Self {
        Self::new(self.min.min(other.min), self.max.max(other.max))
    }

    /// The box grown by `margin` on all sides.
    pub fn grown(self, margin: f64) -> Self {
        Self::new(self.min - margin, self.max + margin)
    }

    /// The middle of the box.
    pub fn center(&self) -> DVec3 {
        0.5 * (self.min + self.max)
    }

    /// The edge lengths; negative on some axis if the box is empty.
    pub fn size(&self) -> DVec3 {
        self.max - self.min
    }

    /// The length of the diagonal; 0 if the box is empty.
    pub fn diagonal(&self) -> f64 {
        if self.is_empty() {
            0.0
        } else {
            self.size().length()
        }
    }

    /// Returns `true` if `point` lies in the box or on its border.
    #[inline]
    pub fn contains(&self, point: DVec3) -> bool {
        self.min.cmple(point).all() && point.cmple(self.max).all()
    }

    /// Returns `true` if the boxes share a point.
    #[inline]
    pub fn touches(&self, other: &Self) -> bool {
        self.min.cmple(other.max).all() && other.min.cmple(self.max).all()
    }

    /// The squared distance from `point` to the box; 0 inside.
    #[inline]
    pub fn distance_sq(&self, point: DVec3) -> f64 {
        let outside = (self.min - point).max(point - self.max).max(DVec3::ZERO);
        outside.length_squared()
    }
}

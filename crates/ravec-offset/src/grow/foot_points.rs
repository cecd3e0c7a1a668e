//! Foot points: points of the surface in a cell, over the closest points to its corners and center and over its triangles.

use super::{Cell, CornerValue, MAX_TRIANGLES, ON_SURFACE, Sample};
use crate::domain::{Near, Region};
use glam::DVec3;
use ravec_mesh::{Aabb, closest_on_triangle};

impl Cell<'_> {
    /// Collects the foot points of the corners and the center that lie in the cell.
    pub(super) fn foot_points(
        &self,
        center: Near,
        side: Region,
        corners: &[CornerValue; 8],
        samples: &mut Vec<Sample>,
    ) {
        let radius = self.setting.field.radius();
        let [low, high] = self.setting.frame.bounds(self.key);
        let at = |octant| self.setting.frame.point(self.key.corner(octant));
        let middle = 0.5 * (low + high);
        let middle_value = self.setting.field.value(center.distance, side);
        let points = (0..8).map(|octant| {
            let (p, CornerValue { triangle, value }) = (at(octant), corners[octant]);
            (p, self.setting.field.near_of(p, triangle), value)
        });
        for (p, near, value) in points.chain([(middle, center, middle_value)]) {
            // the other side of the solid has its surface elsewhere
            let signed_distance = value + self.setting.field.level;
            if near.distance <= 0.0 || signed_distance * self.setting.field.level < 0.0 {
                continue;
            }
            let foot = self.setting.field.foot(p, &near);
            if foot.cmplt(low).any() || foot.cmpgt(high).any() || !self.is_border(foot, near.away) {
                continue;
            }
            let mut sample = Sample {
                point: foot,
                away: near.away,
                triangle: near.triangle,
            };
            if near.distance < radius {
                // another triangle may be closer there
                let there = self.setting.field.near(foot, near.triangle);
                if (there.distance - radius).abs() > ON_SURFACE * self.setting.tolerance {
                    continue;
                }
                sample.triangle = there.triangle;
                sample.away = there.away;
            }
            samples.push(sample);
        }
    }

    fn is_border(&self, p: DVec3, normal: DVec3) -> bool {
        self.setting
            .field
            .is_border(p, normal, ON_SURFACE * self.setting.tolerance)
    }

    /// Returns the triangles that may pass through the cell, sorted.
    pub(super) fn triangles(&self) -> Vec<u32> {
        let [min, max] = self.setting.frame.bounds(self.key);
        let mut triangles = Vec::with_capacity(MAX_TRIANGLES);
        let field = self.setting.field;
        (field.bvh()).for_each_touching(&Aabb { min, max }, |triangle| triangles.push(triangle));
        triangles.sort_unstable();
        triangles
    }

    /// Collects the foot points of triangles that pass through the cell, on the side of the surface.
    pub(super) fn foot_points_of_triangles(
        &self,
        triangles: &[u32],
        center: Near,
        samples: &mut Vec<Sample>,
    ) {
        let [low, high] = self.setting.frame.bounds(self.key);
        let radius = self.setting.field.radius();
        let is_oriented = self.setting.field.is_oriented();
        for &triangle in triangles {
            let corners = self.setting.field.bvh().corners(triangle);
            let normal = self.setting.field.normal(triangle);
            let base = closest_on_triangle(0.5 * (low + high), corners).point;
            // triangles that face away from the solid have the surface on one side only
            let front = if self.setting.field.level < 0.0 {
                -normal
            } else {
                normal
            };
            let both = [front, -front];
            let wanted = if is_oriented { &both[..1] } else { &both };
            for &away in wanted {
                let foot = base + radius * away;
                if away == DVec3::ZERO || foot.cmplt(low).any() || foot.cmpgt(high).any() {
                    continue;
                }
                if radius == 0.0 {
                    if away == normal && self.is_border(foot, normal) {
                        samples.push(Sample {
                            point: foot,
                            away,
                            triangle,
                        });
                    }
                    continue;
                }
                let there = self.setting.field.near(foot, center.triangle);
                let is_off = (there.distance - radius).abs() > ON_SURFACE * self.setting.tolerance;
                let is_in_front = || is_oriented && there.triangle == triangle;
                let is_wanted = || {
                    is_in_front()
                        || self.setting.field.region(foot) == self.setting.field.surface_region()
                };
                if !is_off && is_wanted() {
                    samples.push(Sample {
                        point: foot,
                        away: there.away,
                        triangle: there.triangle,
                    });
                }
            }
        }
    }
}

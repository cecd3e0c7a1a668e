//! A probe of the center of a cell, which shows for most cells that they do not hold the surface.

use super::{
    MAX_TRIANGLES, MAX_TRIANGLES_OF_SHEET, MAX_TRIANGLES_OF_SURFACE, Node, Refinement, is_sheet,
};
use crate::domain::{Enclosure, Near, Place, Region};
use glam::DVec3;
use ravec_mesh::{Aabb, distance_sq_to_triangle};
use ravec_octree::{CellKey, Corner, NodeId};

/// Coarser cells are split without a probe.
const FIRST_LEVEL: u8 = 3;

/// Result of probing the center of a cell.
pub(super) struct Probe {
    pub near: Near,
    pub region: Region,
    /// The center, with its side.
    pub middle: Place,
    pub empty: Option<bool>,
}

impl Refinement<'_> {
    /// Probes the center of a cell.
    pub(super) fn probe(&self, node: NodeId) -> Probe {
        let key = self.tree.key(node);
        let [low, high] = self.setting.frame.bounds(key);
        let (center, radius) = (0.5 * (low + high), 0.5 * (high - low).length());
        let &Node {
            hint,
            region,
            middle,
            ..
        } = self.tree.data(node);
        let near = self.setting.field.near(center, hint);
        let side = match region {
            Region::Unknown => {
                let parent = Place::new(self.middle_of_parent(key), middle);
                (self.setting.field).region_beside(center, near.distance, &[parent])
            }
            known => known,
        };
        // no triangle goes through the cell, so all of it lies on one side of them
        let is_clear = near.distance > radius || !self.setting.field.is_signed();
        let region = if is_clear { side } else { region };
        let empty = if region == Region::Unknown {
            let reaches = near.distance + radius >= self.setting.field.radius();
            (!reaches).then_some(self.setting.field.level > 0.0)
        } else {
            let value = self.setting.field.value(near.distance, region);
            (value.abs() > radius).then_some(value < 0.0)
        };
        let empty = empty.or_else(|| {
            self.is_filled(key, &near)
                .then_some(self.setting.field.level > 0.0)
        });
        Probe {
            near,
            region,
            middle: Place {
                point: center,
                distance: near.distance,
                region: side,
            },
            empty,
        }
    }

    /// Returns whether all of a cell is nearer to one triangle than the surface is. The distance to one triangle is convex, so
    /// it is largest at a corner.
    fn is_filled(&self, key: CellKey, near: &Near) -> bool {
        let most = (1.0 - 1e-9) * self.setting.field.radius();
        // it grows along its gradient at least that fast
        let steepest = near.away.abs().element_sum();
        if near.distance + 0.5 * self.setting.frame.side_at(key.level) * steepest >= most {
            return false;
        }
        let triangle = self.setting.field.bvh().corners(near.triangle);
        let is_near = |octant| {
            let p = self.setting.frame.point(key.corner(octant));
            distance_sq_to_triangle(p, triangle) < most * most
        };
        (0..8).all(is_near)
    }

    /// Returns the center of the parent of a cell: its corner that is not one of the parent.
    fn middle_of_parent(&self, key: CellKey) -> DVec3 {
        let inner = key.at.0.map(|x| {
            if x & key.side() == 0 {
                x + key.side()
            } else {
                x
            }
        });
        self.setting.frame.point(Corner(inner))
    }

    /// Returns whether a cell must be split before its corners are evaluated.
    pub(super) fn must_split(&self, node: NodeId, probe: &Probe) -> bool {
        let key = self.tree.key(node);
        if key.level < FIRST_LEVEL || self.setting.enclosed.of(key) == Some(Enclosure::Partial) {
            return true;
        }
        let [low, high] = self.setting.frame.bounds(key);
        let radius = 0.5 * (high - low).length();
        if probe.near.distance > radius || key.level >= self.floor {
            return false;
        }
        // without signs, a cell with triangles in it would hide the surface on one side of them; with signs, many
        // triangles may enclose a room that the corners miss
        let field = self.setting.field;
        if !field.is_signed() {
            return true;
        }
        let center = 0.5 * (low + high);
        let bounds = Aabb {
            min: low,
            max: high,
        };
        let mut triangles = 0;
        let mut normals = [DVec3::ZERO; MAX_TRIANGLES_OF_SHEET];
        field.bvh().for_each_touching(&bounds, |triangle| {
            // boxes of large slanted triangles are mostly empty
            if field.level == 0.0 && field.near_of(center, triangle).distance > radius {
                return;
            }
            if let Some(normal) = normals.get_mut(triangles) {
                *normal = field.normal(triangle);
            }
            triangles += 1;
        });
        if field.level == 0.0 {
            return triangles > MAX_TRIANGLES_OF_SURFACE;
        }
        let is_sheet =
            || triangles <= normals.len() && field.is_oriented() && is_sheet(&normals[..triangles]);
        triangles > MAX_TRIANGLES && !is_sheet()
    }
}

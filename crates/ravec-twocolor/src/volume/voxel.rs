//! The two-color voxel itself.

use crate::line::Line;
use crate::pixel::TwoColorPixel;
use glam::DVec3;
use ravec_raster::Oklab;

/// A plane `n·p = d` in (x, y, t). Side 0 is where `n·p < d`.
///
/// Positions are in pixels, y down, and in frames, relative to the center of the block. A frame counts as a pixel, and a
/// frame's picture stands at its middle: at −3.5 for the first of 8.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct VoxelPlane {
    /// Unit normal, pointing to side 1: right or down, whichever is more, or later if the plane lies across time.
    pub normal: DVec3,
    /// Distance of the plane from the block's center along the normal, in pixels.
    pub offset_px: f64,
}

impl VoxelPlane {
    /// Signed distance of `point` from the plane, in pixels; positive on side 1, negative on side 0.
    pub fn signed_distance(&self, point: DVec3) -> f64 {
        self.normal.dot(point) - self.offset_px
    }

    /// Speed of the plane's trace in a frame along its own normal, in pixels a frame; positive towards side 1.
    ///
    /// `None` for a plane across time, whose trace passes more than 64 pixels in a frame: no block is wide enough to
    /// distinguish such a speed from a cut.
    pub fn velocity_px(&self) -> Option<f64> {
        let spatial = self.normal.truncate().length();
        (spatial * FASTEST_PX > self.normal.z.abs()).then(|| -self.normal.z / spatial)
    }

    /// The plane's trace at a time, in frames from the block's center. Nothing for a plane across time, as in
    /// [`velocity_px`](Self::velocity_px).
    pub fn line_at(&self, time_frames: f64) -> Option<Line> {
        let velocity = self.velocity_px()?;
        let spatial = self.normal.truncate();
        let length = spatial.length();
        Some(Line {
            normal: spatial / length,
            offset_px: self.offset_px / length + velocity * time_frames,
        })
    }

    /// The same plane seen from its other side if its normal does not point as documented.
    pub(crate) fn oriented(self) -> (Self, bool) {
        let DVec3 { x, y, z } = self.normal;
        let leading = if self.velocity_px().is_none() {
            z
        } else if x.abs() >= y.abs() {
            x
        } else {
            y
        };
        let turned = leading < 0.0;
        let sign = if turned { -1.0 } else { 1.0 };
        let plane = Self {
            normal: self.normal * sign,
            offset_px: self.offset_px * sign,
        };
        (plane, turned)
    }
}

/// The largest speed that is one. Four times the widest block: a trace this fast crosses the block in a quarter of a
/// frame. Smaller would hide fast edges in wide blocks; larger would report rounding as a speed.
const FASTEST_PX: f64 = 64.0;

/// A block of a video, replaced by a plane and the color on each side of it.
///
/// The plane's origin is the center of the block, also where the borders of the frame or the end of the video clip the
/// block. A block without a plane is *flat*: both colors are the same.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TwoColorVoxel {
    /// The plane in which the colors meet; `None` for a flat block.
    pub plane: Option<VoxelPlane>,
    /// The colors of side 0 and side 1.
    pub colors: [Oklab; 2],
    /// The alphas of side 0 and side 1, 0 to 1.
    pub alphas: [f32; 2],
    /// The mean squared distance (Oklab, alpha-weighted, plus that of alpha) of the block's voxels from their side's
    /// color.
    pub error: f32,
}

impl TwoColorVoxel {
    /// A block of one color.
    pub fn flat(color: Oklab, alpha: f32, error: f32) -> Self {
        Self {
            plane: None,
            colors: [color; 2],
            alphas: [alpha; 2],
            error,
        }
    }

    /// Returns `true` if the block has a single color.
    pub fn is_flat(&self) -> bool {
        self.plane.is_none()
    }

    /// Speed of the edge along its normal, in pixels a frame; positive towards side 1, thus to the right or down.
    /// Nothing for flat blocks and for cuts in time.
    pub fn velocity_px(&self) -> Option<f64> {
        self.plane?.velocity_px()
    }

    /// The block at a time, in frames from its center: a two-color pixel, flat where the plane lies across time. Its
    /// error is that of the whole block.
    pub fn pixel_at(&self, time_frames: f64) -> TwoColorPixel {
        let Some(plane) = self.plane else {
            return TwoColorPixel::flat(self.colors[0], self.alphas[0], self.error);
        };
        let Some(line) = plane.line_at(time_frames) else {
            let side = usize::from(plane.signed_distance(DVec3::Z * time_frames) >= 0.0);
            return TwoColorPixel::flat(self.colors[side], self.alphas[side], self.error);
        };
        TwoColorPixel {
            line: Some(line),
            colors: self.colors,
            alphas: self.alphas,
            error: self.error,
        }
    }

    /// The voxel of a block of one frame.
    pub(crate) fn from_pixel(pixel: &TwoColorPixel) -> Self {
        let voxel = Self {
            plane: pixel.line.map(|line| VoxelPlane {
                normal: line.normal.extend(0.0),
                offset_px: line.offset_px,
            }),
            colors: pixel.colors,
            alphas: pixel.alphas,
            error: pixel.error,
        };
        voxel.oriented()
    }

    /// The same voxel with the sides in the documented order.
    pub(crate) fn oriented(mut self) -> Self {
        if let Some((plane, turned)) = self.plane.map(VoxelPlane::oriented) {
            self.plane = Some(plane);
            if turned {
                self.colors.reverse();
                self.alphas.reverse();
            }
        }
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec2;

    fn moving(normal: DVec2, velocity_px: f64, offset_px: f64) -> VoxelPlane {
        let normal = normal.normalize().extend(-velocity_px);
        VoxelPlane {
            normal: normal.normalize(),
            offset_px: offset_px / normal.length(),
        }
    }

    #[test]
    fn the_trace_moves_by_the_velocity() {
        let plane = moving(DVec2::new(3.0, 4.0), 0.7, 1.5);
        assert!((plane.velocity_px().unwrap() - 0.7).abs() < 1e-12);
        for time in [-3.5, 0.0, 2.0] {
            let line = plane.line_at(time).unwrap();
            assert!((line.offset_px - (1.5 + 0.7 * time)).abs() < 1e-12);
            let point = DVec2::new(0.3, -2.0);
            let scale = plane.normal.truncate().length();
            let expected = plane.signed_distance(point.extend(time)) / scale;
            assert!((line.signed_distance(point) - expected).abs() < 1e-12);
        }
    }

    #[test]
    fn a_plane_across_time_has_no_velocity_and_shows_one_side_at_a_time() {
        let voxel = TwoColorVoxel {
            plane: Some(VoxelPlane {
                normal: DVec3::Z,
                offset_px: 1.0,
            }),
            colors: [Oklab([0.1; 3]), Oklab([0.9; 3])],
            alphas: [1.0, 0.5],
            error: 0.0,
        };
        assert_eq!(voxel.velocity_px(), None);
        assert_eq!(voxel.pixel_at(0.5).colors, [Oklab([0.1; 3]); 2]);
        assert_eq!(voxel.pixel_at(1.5).alphas, [0.5; 2]);
    }

    #[test]
    fn turning_a_voxel_round_changes_no_side() {
        let plane = moving(DVec2::new(-2.0, 1.0), 0.3, 0.4);
        let voxel = TwoColorVoxel {
            plane: Some(plane),
            colors: [Oklab([0.1; 3]), Oklab([0.9; 3])],
            alphas: [1.0, 0.5],
            error: 0.0,
        };
        let oriented = voxel.oriented();
        let turned = oriented.plane.unwrap();
        assert!(turned.normal.x > 0.0);
        assert_eq!(turned.normal, -plane.normal);
        assert_eq!(oriented.colors, [voxel.colors[1], voxel.colors[0]]);
        assert_eq!(oriented.alphas, [0.5, 1.0]);
        let point = DVec3::new(0.3, 2.0, -1.0);
        assert_eq!(turned.signed_distance(point), -plane.signed_distance(point));
    }
}

//! Ellipsoids before a camera: rays, shadows, and the conic that is their outline.
//!
//! Source of the outline: Hartley and Zisserman, "Multiple View Geometry", 2003, section 8.3. For the dual quadric `Q*`
//! of an ellipsoid and a camera `P` it is `C = (P Q* Pᵀ)⁻¹`.

use crate::texture::smoothstep;
use glam::{DMat3, DVec2, DVec3};
use ravec_raster::Size;

/// An ellipsoid, turned about y.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Ellipsoid {
    pub center: DVec3,
    pub radii: DVec3,
    /// World from the ellipsoid's own axes.
    pub turn: DMat3,
    unit_from_world: DMat3,
    mean_radius: f64,
}

impl Ellipsoid {
    pub(crate) fn new(center: DVec3, radii: DVec3) -> Self {
        Self {
            center,
            radii,
            turn: DMat3::IDENTITY,
            unit_from_world: DMat3::from_diagonal(radii.recip()),
            mean_radius: radii.element_product().cbrt(),
        }
    }

    /// Turned about y.
    pub(crate) fn turned(self, angle_rad: f64) -> Self {
        let turn = DMat3::from_rotation_y(angle_rad);
        Self {
            turn,
            unit_from_world: self.unit_from_world * turn.transpose(),
            ..self
        }
    }

    /// Into the space in which the ellipsoid is the unit ball.
    pub(crate) fn unit_ball(&self, v: DVec3) -> DVec3 {
        self.unit_from_world * v
    }

    /// Nearest hit of a ray beyond `t` = 1e-6.
    pub(crate) fn hit(&self, from: DVec3, direction: DVec3) -> Option<f64> {
        let offset = from - self.center;
        let along = offset.dot(direction);
        let reach = self.radii.max_element();
        if offset.length_squared() * direction.length_squared() - along * along
            > reach * reach * direction.length_squared()
        {
            return None;
        }
        let (o, d) = (self.unit_ball(offset), self.unit_ball(direction));
        let (a, b, c) = (d.length_squared(), o.dot(d), o.length_squared() - 1.0);
        let root = b * b - a * c;
        if root <= 0.0 {
            return None;
        }
        let t = (-b - root.sqrt()) / a;
        (t > 1e-6).then_some(t)
    }

    /// Unit normal at a point of the surface.
    pub(crate) fn normal(&self, at: DVec3) -> DVec3 {
        (self.turn * (self.unit_ball(at - self.center) / self.radii)).normalize()
    }

    /// Share of a light of angular radius `size` that is seen past the thing from `at` (Quilez, "sphere soft shadow").
    pub(crate) fn lets_through(&self, at: DVec3, toward: DVec3, size: f64) -> f64 {
        // far from the ray the thing cannot reach into the penumbra
        let c = self.center - at;
        let ahead = c.dot(toward);
        let reach =
            self.radii.max_element() * (1.0 + size * ahead.max(0.0) / self.radii.min_element());
        if ahead < -reach || c.length_squared() - ahead * ahead > reach * reach {
            return 1.0;
        }
        let (o, d) = (self.unit_ball(-c), self.unit_ball(toward).normalize());
        let along = -o.dot(d);
        if along <= 0.0 {
            return 1.0;
        }
        let miss = (o.length_squared() - along * along).max(0.0).sqrt();
        let penumbra = size * along;
        smoothstep(1.0 - penumbra, 1.0 + penumbra, miss)
    }

    /// Share of the light from all around that the thing blocks at a point with a normal.
    pub(crate) fn occlusion(&self, at: DVec3, normal: DVec3) -> f64 {
        let mean = self.mean_radius;
        let d = self.center - at;
        let distance = d.length().max(mean);
        (0.5 + 0.5 * normal.dot(d) / distance).max(0.0) * (mean / distance).powi(2)
    }

    /// The outline in the image as a conic, negative inside.
    pub(crate) fn outline(&self, camera: &Camera) -> DMat3 {
        let radii = DMat3::from_diagonal(self.radii * self.radii);
        let spread = self.turn * radii * self.turn.transpose();
        // P (x, 1) = M (x − position), so P Q* Pᵀ = M (spread − c cᵀ) Mᵀ with c relative to the camera
        let c = self.center - camera.position;
        let outer = DMat3::from_cols(c * c.x, c * c.y, c * c.z);
        let dual = camera.image_from_world * (spread - outer) * camera.image_from_world.transpose();
        let conic = dual.inverse();
        let middle = camera.project(self.center).extend(1.0);
        if middle.dot(conic * middle) > 0.0 {
            -conic
        } else {
            conic
        }
    }
}

/// A camera above the table that looks along −z and a little down.
pub(crate) struct Camera {
    pub position: DVec3,
    image_from_world: DMat3,
    world_from_image: DMat3,
}

impl Camera {
    pub(crate) fn new(size: Size) -> Self {
        let extent = DVec2::new(size.width() as f64, size.height() as f64);
        let f = 1.28 * extent.x.min(1.5 * extent.y);
        let center = extent * DVec2::new(0.5, 0.52);
        let (sin, cos) = 19f64.to_radians().sin_cos();
        // rows: right, down, forward
        let down = DVec3::new(0.0, -cos, sin);
        let forward = DVec3::new(0.0, -sin, -cos);
        let rows = DMat3::from_cols(DVec3::X, down, forward).transpose();
        let lens = DMat3::from_cols(
            DVec3::new(f, 0.0, 0.0),
            DVec3::new(0.0, f, 0.0),
            center.extend(1.0),
        );
        let image_from_world = lens * rows;
        Self {
            position: DVec3::new(0.0, 2.55, 5.6),
            image_from_world,
            world_from_image: image_from_world.inverse(),
        }
    }

    pub(crate) fn project(&self, point: DVec3) -> DVec2 {
        let h = self.image_from_world * (point - self.position);
        h.truncate() / h.z
    }

    pub(crate) fn direction(&self, p: DVec2) -> DVec3 {
        (self.world_from_image * p.extend(1.0)).normalize()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_and_projections_are_inverse() {
        let camera = Camera::new(Size::new(300, 200).unwrap());
        for p in [
            DVec2::ZERO,
            DVec2::new(300.0, 0.0),
            DVec2::new(150.0, 120.0),
        ] {
            assert!(
                camera
                    .project(camera.position + 3.0 * camera.direction(p))
                    .distance(p)
                    < 1e-9
            );
        }
    }
}

//! Light: brightness and color of a surface.
//!
//! Lights are fixed to the eye, so that every view is well lit: a key light from the upper left, a weak one from the
//! right that keeps the dark side readable, a sky that is lighter than the ground, and a highlight that shows
//! curvature.

use std::f32::consts::FRAC_1_SQRT_2;

use glam::Vec3;

/// Toward the key light, in the coordinates of the view.
const KEY: Vec3 = Vec3::new(-0.408_248_3, 0.577_35, FRAC_1_SQRT_2);
/// Toward the light that fills the shadows.
const FILL: Vec3 = Vec3::new(0.805_823, 0.161_165, 0.569_803);

const KEY_POWER: f32 = 0.62;
const FILL_POWER: f32 = 0.15;
const SKY: f32 = 0.34;
const GROUND: f32 = 0.12;
/// The highlight's power and sharpness: those of a satin finish.
const SHINE: f32 = 0.14;
const SHARPNESS: i32 = 32;

/// Material of a surface at a point.
#[derive(Debug, Clone, Copy)]
pub(super) struct Material {
    /// Linear light.
    pub color: Vec3,
    /// Strength of the highlight, 0 to 1; colors that carry meaning have none.
    pub shine: f32,
    /// Strength of the shadows, 0 to 1; colors that carry meaning must not grow dark.
    pub relief: f32,
}

/// The light that comes from a surface with the normal `normal` toward `eye`, both of unit length, in the coordinates of the
/// view. The normal is on the side that is seen.
pub(super) fn shaded(material: Material, normal: Vec3, eye: Vec3) -> Vec3 {
    let key = normal.dot(KEY).max(0.0);
    let fill = normal.dot(FILL).max(0.0);
    let sky = GROUND + (SKY - GROUND) * (0.5 + 0.5 * normal.y);
    let bright = KEY_POWER * key + FILL_POWER * fill + sky;
    let bright = 1.0 + material.relief * (bright - 1.0);
    let half = (KEY + eye).normalize_or_zero();
    let shine = SHINE * material.shine * normal.dot(half).max(0.0).powi(SHARPNESS);
    material.color * bright + Vec3::splat(shine)
}

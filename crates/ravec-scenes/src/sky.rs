//! An afternoon sky: a gradient from warm haze to deep blue, and lit clouds.

use crate::paint::hex;
use crate::random::Seed;
use crate::texture::{fractal, smoothstep};
use glam::{DVec2, DVec3, Vec3};

/// Radiance of the sky in a direction (unit, y up); `footprint_rad` is the angle that one sample stands for.
pub(crate) fn sky(direction: DVec3, footprint_rad: f64, sun: DVec3, seed: Seed) -> Vec3 {
    let up = direction.y.max(0.0);
    let height = up.sqrt() as f32;
    let zenith = hex(0x2f6cb5);
    let middle = hex(0x86b4dc);
    let horizon = hex(0xf3ddbd);
    let clear = if height < 0.45 {
        horizon.lerp(middle, smoothstep(0.0, 0.45, height as f64) as f32)
    } else {
        middle.lerp(zenith, smoothstep(0.45, 1.0, height as f64) as f32)
    };
    let toward_sun = direction.dot(sun).max(0.0);
    let glow = Vec3::new(1.0, 0.72, 0.42) * (0.35 * toward_sun.powi(6)) as f32;
    // clouds lie on a plane far above; perspective flattens them towards the horizon
    let q = DVec2::new(direction.x, direction.z) / (up + 0.14) * 1.25;
    let fp = footprint_rad / (up + 0.14) * 1.25;
    let shape = |q: DVec2| {
        let warp = fractal(q * 0.8 + 3.1, fp, 3, seed.fork(31));
        fractal(q * DVec2::new(1.0, 1.3) + 0.35 * warp, fp, 6, seed.fork(32)) + 0.06
    };
    let thick = shape(q);
    let cover = smoothstep(0.0, 0.38, thick);
    // lit from the side of the sun: thinner towards it is brighter
    let toward = shape(q + 0.12 * DVec2::new(sun.x, sun.z));
    let light = (0.62 + 0.9 * (thick - toward)).clamp(0.25, 1.15);
    let bright = hex(0xfff4e2) * 1.12;
    let shade = hex(0x9ca6bd);
    let cloud = shade
        .lerp(bright, light as f32)
        .lerp(horizon, 0.5 * smoothstep(0.25, 0.02, up) as f32);
    (clear + glow).lerp(cloud, 0.92 * cover as f32)
}

//! Surfaces of moving shapes: colors as functions of a position on the shape.

use crate::coverage::{above, bar};
use crate::paint::hex;
use crate::random::Seed;
use crate::texture::{fractal, smoothstep};
use glam::{DVec2, Vec3};

/// A surface; positions and lengths are those of the shape's own coordinates.
///
/// Pixels at the border of a shape ask for the color at their middle, which may lie outside of it: there the color is about
/// that of the nearest place on the shape.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Coat {
    /// One color.
    Flat(Vec3),
    /// A glossy ball around the origin, lit from the upper left.
    Ball { color: Vec3, radius: f64 },
    /// Panels of three colors around the origin, with a white cap.
    Panels { colors: [Vec3; 3], radius: f64 },
    /// Painted sheet metal along x, lighter along its middle.
    Paint { color: Vec3, half_width: f64 },
    /// Woven cloth with folds; brightness changes along `light`.
    Cloth {
        color: Vec3,
        light: DVec2,
        weave: f64,
        seed: Seed,
    },
    /// Planks or a crate with its border.
    Crate { half: DVec2, seed: Seed },
    /// A leaf with veins along x.
    Leaf { half_length: f64, seed: Seed },
}

impl Coat {
    /// Linear light at a position; `footprint` is the side of the square that the sample stands for.
    pub(crate) fn color(&self, p: DVec2, footprint: f64) -> Vec3 {
        match *self {
            Self::Flat(color) => color,
            Self::Ball { color, radius } => {
                let q = (p / radius).clamp_length_max(1.0);
                let height = (1.0 - q.length_squared()).max(0.0).sqrt();
                let facing = (-0.45 * q.x - 0.55 * q.y + 0.70 * height).max(0.0);
                let gloss = smoothstep(0.30, 0.05, q.distance(DVec2::new(-0.36, -0.42)));
                let lit = color * (0.42 + 0.62 * facing) as f32;
                lit.lerp(Vec3::splat(0.9), 0.55 * gloss as f32)
            }
            Self::Panels { colors, radius } => {
                let reach = p.length();
                let turn = p.to_angle() / std::f64::consts::TAU * 6.0;
                let panel = turn.rem_euclid(6.0).floor();
                // panels meet within a footprint
                let border = (turn - turn.round()).abs() * std::f64::consts::TAU / 6.0 * reach;
                let own = colors[panel as usize % 3];
                let across = if turn.rem_euclid(1.0) < 0.5 { 5.0 } else { 1.0 };
                let other = colors[(panel + across) as usize % 3];
                let share = (0.5 - border / footprint.max(1e-9)).clamp(0.0, 0.5);
                let cap = above(0.16 * radius, reach, footprint);
                let shade = 1.0 - 0.35 * (reach / radius).min(1.0).powi(3);
                own.lerp(other, share as f32)
                    .lerp(hex(0xf2efe6), cap as f32)
                    * shade as f32
            }
            Self::Paint { color, half_width } => {
                let t = (p.y / half_width).clamp(-1.0, 1.0);
                let crown = 1.0 - 0.42 * t * t;
                let gloss = smoothstep(0.22, 0.0, (t + 0.45).abs());
                (color * crown as f32).lerp(Vec3::splat(0.85), 0.16 * gloss as f32)
            }
            Self::Cloth {
                color,
                light,
                weave,
                seed,
            } => {
                let folds = fractal(
                    p / weave * DVec2::new(0.055, 0.016),
                    0.055 * footprint / weave,
                    4,
                    seed,
                );
                let threads = fractal(p / weave, footprint / weave, 2, seed.fork(1));
                let shade = 0.8 + p.dot(light) + 0.30 * folds + 0.12 * threads;
                color * shade.clamp(0.18, 1.5) as f32
            }
            Self::Crate { half, seed } => crate_color(p, half, footprint, seed),
            Self::Leaf { half_length, seed } => {
                let q = p / half_length;
                let cloud = fractal(q * 3.0, 3.0 * footprint / half_length, 4, seed);
                let side = q.x - 0.9 * q.y.abs();
                let vein = smoothstep(
                    0.05,
                    0.015,
                    ((side / 0.28).rem_euclid(1.0) - 0.5).abs() * 0.28,
                )
                .max(bar(q.y, 0.02, footprint / half_length));
                let autumn = smoothstep(-0.5, 0.6, q.x + 0.4 * cloud);
                let blade = hex(0x5d8a2c).lerp(hex(0xdb9a2a), autumn as f32);
                (blade * (1.0 + 0.2 * cloud) as f32).lerp(hex(0xe9dfa0), 0.6 * vein as f32)
            }
        }
    }
}

/// A wooden crate: four boards between battens.
fn crate_color(p: DVec2, half: DVec2, footprint: f64, seed: Seed) -> Vec3 {
    let unit = half.min_element();
    let q = p / unit;
    let fp = footprint / unit;
    let rim = (half / unit - q.abs()).min_element();
    let upright = rim < 0.2 && half.x - p.x.abs() < half.y - p.y.abs();
    let along = if upright { DVec2::new(q.y, q.x) } else { q };
    let grain = fractal(along * DVec2::new(3.0, 42.0), 42.0 * fp, 3, seed);
    let cloud = fractal(q * 2.0, 2.0 * fp, 3, seed.fork(1));
    let gap = bar((q.y / 0.42).rem_euclid(1.0) - 0.5, 0.03, fp / 0.42);
    let batten = above(0.2, rim, fp);
    let shadow = bar(rim - 0.215, 0.02, fp);
    let board = hex(0xb98650) * (0.85 + 0.16 * grain + 0.12 * cloud - 0.6 * gap) as f32;
    let frame = hex(0xd2a468) * (0.92 + 0.14 * grain) as f32;
    let color = board.lerp(frame, batten as f32) * (1.0 - 0.6 * shadow) as f32;
    color.max(Vec3::splat(0.004))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coats_reflect_between_nothing_and_all_and_are_smooth_under_a_wide_footprint() {
        let color = hex(0xc03a2c);
        let coats = [
            Coat::Flat(color),
            Coat::Ball {
                color,
                radius: 20.0,
            },
            Coat::Panels {
                colors: [color, hex(0xf0c040), hex(0x2460a0)],
                radius: 20.0,
            },
            Coat::Paint {
                color,
                half_width: 15.0,
            },
            Coat::Cloth {
                color,
                light: DVec2::new(0.01, 0.0),
                weave: 0.5,
                seed: Seed(1),
            },
            Coat::Crate {
                half: DVec2::new(30.0, 20.0),
                seed: Seed(2),
            },
            Coat::Leaf {
                half_length: 25.0,
                seed: Seed(3),
            },
        ];
        for coat in &coats {
            for i in 0..900 {
                let p = DVec2::new(f64::from(i % 30) - 15.0, f64::from(i / 30) - 15.0);
                // a small shape within a large pixel is asked far outside
                for (footprint, p) in [(0.1, p), (1.0, p), (30.0, p), (300.0, 20.0 * p)] {
                    let color = coat.color(p, footprint);
                    assert!(
                        color.is_finite()
                            && color.min_element() >= 0.0
                            && color.max_element() <= 1.3,
                        "{coat:?} {color}"
                    );
                }
            }
        }
    }
}

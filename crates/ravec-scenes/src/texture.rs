//! Noise and material textures as pure functions of a position and a seed.
//!
//! Each takes a `footprint`, the side of the square in texture units that one sample stands for. Noise fades out octave
//! by octave as its period nears two footprints (Perlin's "clamping", after Norton, Rockwood, Skolmoski 1982), and
//! regular patterns return the mean over the footprint, so a texture in perspective goes over into its average instead
//! of aliasing. Positions are in meters where a material has a natural size.
//!
//! Sources: Perlin, "Improving noise", 2002; Worley, "A cellular texture basis function", 1996.
//!
//! Guarantees: the same value for the same arguments; continuous in the position except across joints of masonry.
//! Does not guarantee: a strict spectral bound; what is left above the footprint's frequency is below a tenth.

use crate::coverage::pulse;
use crate::paint::hex;
use crate::random::Seed;
use glam::{DVec2, Vec3};

#[inline(always)]
fn smooth(t: f64) -> f64 {
    t * t * t * (t * (t * 6.0 - 15.0) + 10.0)
}

/// The smooth step of Hermite between two edges, 0 to 1.
#[inline(always)]
pub(crate) fn smoothstep(from: f64, to: f64, x: f64) -> f64 {
    let t = ((x - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

#[inline(always)]
fn lattice(p: DVec2) -> (i64, i64, DVec2) {
    let cell = p.floor();
    (cell.x as i64, cell.y as i64, p - cell)
}

/// Value noise of period 1: between 0 and 1, mean 0.5.
#[inline]
pub fn value_noise(p: DVec2, seed: Seed) -> f64 {
    let (x, y, f) = lattice(p);
    let (s, t) = (smooth(f.x), smooth(f.y));
    let at = |dx: i64, dy: i64| seed.unit(x + dx, y + dy, 0);
    let upper = at(0, 0) + s * (at(1, 0) - at(0, 0));
    let lower = at(0, 1) + s * (at(1, 1) - at(0, 1));
    upper + t * (lower - upper)
}

/// Gradient noise of period 1: 0 at the lattice points, mean 0, mostly within ±0.7, always within ±1.5.
#[inline]
pub fn gradient_noise(p: DVec2, seed: Seed) -> f64 {
    let (x, y, f) = lattice(p);
    let (s, t) = (smooth(f.x), smooth(f.y));
    let at = |dx: i64, dy: i64| {
        let bits = seed.bits(x + dx, y + dy, 0);
        let slope = |b: u64| f64::from(b as u32 as i32) * (1.5 / 2_147_483_648.0);
        slope(bits) * (f.x - dx as f64) + slope(bits >> 32) * (f.y - dy as f64)
    };
    let (a, b) = (at(0, 0), at(0, 1));
    let upper = a + s * (at(1, 0) - a);
    let lower = b + s * (at(1, 1) - b);
    upper + t * (lower - upper)
}

/// A sum of `octaves` gradient noises, each of half the period and half the height of the one before, the first of
/// period 1. Mean 0, mostly within ±1.
#[inline]
pub fn fractal(p: DVec2, footprint: f64, octaves: u32, seed: Seed) -> f64 {
    let (mut sum, mut height, mut frequency) = (0.0, 1.0, 1.0);
    for octave in 0..octaves {
        // full below a quarter of the period, none above half of it
        let weight = (2.0 - 4.0 * footprint * frequency).clamp(0.0, 1.0);
        if weight == 0.0 {
            break;
        }
        // the shift keeps the lattice points of different octaves apart
        let q = p * frequency + DVec2::splat(17.37 * f64::from(octave));
        sum += weight * height * gradient_noise(q, seed);
        height *= 0.5;
        frequency *= 2.0;
    }
    sum
}

/// Cellular noise at a position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cell {
    /// Distance to the nearest feature point.
    pub nearest: f64,
    /// Distance to the second nearest; equal to `nearest` on the border between two cells.
    pub second: f64,
    /// A uniform number of the nearest point's cell, 0 to 1.
    pub tint: f64,
}

/// Cellular noise: one feature point in each unit cell.
///
/// The nearest point is exact; the second nearest is sought in the same nine cells.
pub fn cellular(p: DVec2, seed: Seed) -> Cell {
    let (x, y, f) = lattice(p);
    let mut cell = Cell {
        nearest: f64::INFINITY,
        second: f64::INFINITY,
        tint: 0.0,
    };
    for dy in -1..=1 {
        for dx in -1..=1 {
            let bits = seed.bits(x + dx, y + dy, 1);
            // the middle of a cell: the own point is within 0.8·√2, all beyond the nine cells are at least 1.2 away
            let inner = |b: u64| 0.2 + 0.6 * (b & 0xf_ffff) as f64 / 1_048_576.0;
            let point = DVec2::new(dx as f64 + inner(bits), dy as f64 + inner(bits >> 20));
            let distance = point.distance_squared(f);
            if distance < cell.nearest {
                cell.second = cell.nearest;
                cell.nearest = distance;
                cell.tint = (bits >> 40) as f64 / 16_777_216.0;
            } else if distance < cell.second {
                cell.second = distance;
            }
        }
    }
    cell.nearest = cell.nearest.sqrt();
    cell.second = cell.second.sqrt();
    cell
}

/// A regular pattern of stones: the size of a stone with its joint, and how courses are shifted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Masonry {
    /// Length of a stone and its joint, along x.
    pub length: f64,
    /// Height of a course with its joint, along y.
    pub height: f64,
    /// Width of the joints, less than both.
    pub joint: f64,
    /// Shift of each second course as a share of a length: 0 for tiles, 0.5 for a running bond.
    pub shift: f64,
}

/// Masonry at a position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stone {
    /// Share of the footprint that is stone and not joint, 0 to 1.
    pub face: f64,
    /// The stone's own deviation, −1 to 1, faded to 0 where stones are smaller than the footprint.
    pub tint: f64,
    /// Light on the rounded borders: 1 where the stone turns to −y, −1 where it turns to +y.
    pub relief: f64,
}

impl Masonry {
    /// The pattern at a position.
    pub fn at(&self, p: DVec2, footprint: f64, seed: Seed) -> Stone {
        let course = (p.y / self.height).floor();
        let shifted = p.x / self.length + self.shift * (course as i64 & 1) as f64;
        let column = shifted.floor();
        let along = pulse(
            shifted,
            1.0 - self.joint / self.length,
            footprint / self.length,
        );
        let across = pulse(
            p.y / self.height,
            1.0 - self.joint / self.height,
            footprint / self.height,
        );
        let visible = (2.0 - 3.0 * footprint / self.height).clamp(0.0, 1.0);
        let tint = visible * (2.0 * seed.unit(column as i64, course as i64, 2) - 1.0);
        let t = (p.y / self.height - course) / (1.0 - self.joint / self.height);
        let relief = visible * (smoothstep(0.15, 0.0, t) - smoothstep(0.85, 1.0, t));
        Stone {
            face: along * across,
            tint,
            relief,
        }
    }
}

/// A brick wall with mortar, bricks of 24 × 7.5 cm: the reflectance of the given brick color.
pub fn brick(p: DVec2, footprint: f64, color: Vec3, seed: Seed) -> Vec3 {
    const WALL: Masonry = Masonry {
        length: 0.24,
        height: 0.075,
        joint: 0.012,
        shift: 0.5,
    };
    let stone = WALL.at(p, footprint, seed);
    let grain = fractal(p / 0.05, footprint / 0.05, 3, seed.fork(1));
    let shade = 1.0 + 0.28 * stone.tint + 0.16 * grain - 0.12 * stone.relief;
    let warm = Vec3::new(
        1.0,
        1.0 - 0.08 * stone.tint as f32,
        1.0 - 0.12 * stone.tint as f32,
    );
    let mortar = hex(0xb5a898) * (0.9 + 0.15 * grain) as f32;
    mortar.lerp(color * warm * shade as f32, stone.face as f32)
}

/// Square tiles of a given side with joints, in two colors like a chessboard.
pub fn tiles(p: DVec2, footprint: f64, side: f64, colors: [Vec3; 2], seed: Seed) -> Vec3 {
    let floor = Masonry {
        length: side,
        height: side,
        joint: 0.02 * side,
        shift: 0.0,
    };
    let stone = floor.at(p, footprint, seed);
    let wave = |x: f64| 2.0 * pulse(x / (2.0 * side), 0.5, footprint / (2.0 * side)) - 1.0;
    let even = 0.5 + 0.5 * wave(p.x) * wave(p.y);
    let cloud = fractal(p / (0.4 * side), footprint / (0.4 * side), 4, seed.fork(2));
    let color =
        colors[0].lerp(colors[1], even as f32) * (1.0 + 0.07 * stone.tint + 0.08 * cloud) as f32;
    (hex(0x6a6258)).lerp(color, stone.face as f32)
}

/// Planks of wood along x, 12 cm wide, with grain, knots and joints.
pub fn wood(p: DVec2, footprint: f64, color: Vec3, seed: Seed) -> Vec3 {
    const PLANK: f64 = 0.12;
    let row = (p.y / PLANK).floor();
    let plank = seed.unit(row as i64, 0, 3);
    let local = DVec2::new(p.x + 37.0 * plank, p.y);
    // rings of a trunk cut at a slant: lines that run along the plank and bend around knots
    let bend = fractal(
        local * DVec2::new(1.2, 9.0),
        footprint * 9.0,
        3,
        seed.fork(3),
    );
    let rings = (local.y / 0.011 + 5.0 * bend + 40.0 * plank) * std::f64::consts::TAU * 0.5;
    let visible = (1.6 - 260.0 * footprint).clamp(0.0, 1.0);
    let line = visible * (0.5 + 0.5 * rings.sin()).powi(3);
    let fiber = fractal(
        local * DVec2::new(14.0, 420.0),
        footprint * 420.0,
        2,
        seed.fork(4),
    );
    let shade = 0.92 + 0.24 * (plank - 0.5) - 0.30 * line + 0.10 * fiber + 0.12 * bend;
    let gap = 1.0 - 0.75 * (1.0 - pulse(p.y / PLANK, 0.97, footprint / PLANK));
    let ruddy = Vec3::new(1.0, 1.0 - 0.12 * line as f32, 1.0 - 0.22 * line as f32);
    color * ruddy * (shade * gap).max(0.05) as f32
}

/// White marble with dark veins.
pub fn marble(p: DVec2, footprint: f64, seed: Seed) -> Vec3 {
    let warp = DVec2::new(
        fractal(p * 1.5, footprint * 1.5, 5, seed.fork(5)),
        fractal(p * 1.5 + 9.0, footprint * 1.5, 5, seed.fork(6)),
    );
    let vein = fractal((p + 0.6 * warp) * 2.0, footprint * 2.0, 5, seed.fork(7)).abs();
    let dark = (1.0 - vein * 3.5).clamp(0.0, 1.0).powi(3);
    let cloud = fractal(p * 3.0, footprint * 3.0, 4, seed.fork(8));
    let stone = hex(0xece8e1) * (0.92 + 0.08 * cloud) as f32;
    stone.lerp(hex(0x5d616b), 0.75 * dark as f32)
}

/// A meadow seen from above: blades, patches of dry grass, small flowers.
pub fn grass(p: DVec2, footprint: f64, seed: Seed) -> Vec3 {
    let patch = fractal(p * 0.7, footprint * 0.7, 4, seed.fork(9));
    let blades = fractal(
        p * DVec2::new(60.0, 18.0),
        footprint * 60.0,
        3,
        seed.fork(10),
    );
    let tuft = fractal(p * 8.0, footprint * 8.0, 3, seed.fork(11));
    let green = hex(0x4f6f2c).lerp(hex(0x9a974a), smoothstep(-0.3, 0.6, patch) as f32);
    let lit = green * (1.0 + 0.45 * blades + 0.35 * tuft).max(0.1) as f32;
    let flower = cellular(p * 5.0, seed.fork(12));
    let visible = smoothstep(0.09, 0.05, flower.nearest) * (1.5 - 12.0 * footprint).clamp(0.0, 1.0);
    let petals = if flower.tint > 0.5 {
        hex(0xf4f0e0)
    } else {
        hex(0xe8b93a)
    };
    lit.lerp(
        petals,
        if flower.tint > 0.25 {
            visible as f32
        } else {
            0.0
        },
    )
}

/// Foliage as painted leaf over leaf.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Leaves {
    /// Share that is covered, 0 to 1.
    pub cover: f64,
    /// Depth of the visible leaf: 0 deep in the shade, 1 on top in the light.
    pub height: f64,
    /// A number of the leaf itself, 0 to 1.
    pub tint: f64,
}

/// Leaves of about `leaf` in length where `density` (below 0: none, above 1: thick) says so.
///
/// Layers from the back to the front, each with one leaf in each cell of a grid; where leaves are smaller than the
/// footprint, their mean.
pub fn foliage(
    p: DVec2,
    footprint: f64,
    leaf: f64,
    density: impl Fn(DVec2) -> f64,
    seed: Seed,
) -> Leaves {
    const LAYERS: i64 = 4;
    let here = density(p);
    let mut leaves = Leaves {
        cover: 0.0,
        height: 0.0,
        tint: 0.5,
    };
    if here < -0.5 {
        return leaves;
    }
    if footprint > 0.5 * leaf {
        let grain = fractal(p / (3.0 * leaf), footprint / (3.0 * leaf), 3, seed);
        leaves.cover = smoothstep(0.0, 0.35, here + 0.3 * grain);
        leaves.height = (0.5 + 0.5 * grain).clamp(0.0, 1.0);
        return leaves;
    }
    for layer in 0..LAYERS {
        // turned against one another, so that the grid does not show
        let turn = DVec2::from_angle(0.7 * layer as f64);
        let q = turn.rotate(p) / leaf;
        let (x, y, f) = lattice(q);
        for dy in -1..=1 {
            for dx in -1..=1 {
                let bits = seed.bits(x + dx, y + dy, 4 + layer as u64);
                let part = |shift: u32| (bits >> shift & 0xffff) as f64 / 65536.0;
                let spot = DVec2::new(dx as f64 + part(0), dy as f64 + part(16));
                let offset = f - spot;
                if offset.length_squared() > 0.64 {
                    continue;
                }
                let axis = DVec2::from_angle(std::f64::consts::TAU * part(32));
                let along = offset.dot(axis) / 0.75;
                // pointed at both ends
                let half_width = 0.34 * (1.0 - along * along);
                let across = offset.perp_dot(axis).abs();
                if half_width <= across {
                    continue;
                }
                let root = DVec2::new(turn.x, -turn.y).rotate(q - offset) * leaf;
                // upper layers thin out first towards the border of the crown
                if density(root) > 0.25 * layer as f64 * part(48) + 0.02 {
                    let depth = (layer as f64 + part(48)) / LAYERS as f64;
                    leaves = Leaves {
                        cover: 1.0,
                        height: depth,
                        tint: part(40),
                    };
                }
            }
        }
    }
    leaves
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid() -> impl Iterator<Item = DVec2> {
        (0..4096).map(|i| {
            DVec2::new(
                0.173 * f64::from(i % 64) - 3.0,
                0.191 * f64::from(i / 64) - 5.0,
            )
        })
    }

    #[test]
    fn noise_stays_within_its_range_and_has_its_mean() {
        let mut sums = [0.0; 2];
        for p in grid() {
            let (value, gradient) = (value_noise(p, Seed(5)), gradient_noise(p, Seed(5)));
            assert!((0.0..=1.0).contains(&value) && gradient.abs() <= 1.5);
            sums[0] += value / 4096.0;
            sums[1] += gradient / 4096.0;
        }
        // about 130 independent lattice cells: five standard errors of a uniform mean, and of ±0.4
        assert!(
            (sums[0] - 0.5).abs() < 0.13 && sums[1].abs() < 0.18,
            "{sums:?}"
        );
    }

    #[test]
    fn noise_is_continuous_across_cells() {
        for i in -3..4 {
            let at = |x: f64| DVec2::new(f64::from(i) + x, 0.37);
            for noise in [value_noise, gradient_noise] {
                // slopes are below 8
                assert!((noise(at(-1e-9), Seed(6)) - noise(at(1e-9), Seed(6))).abs() < 1.6e-8);
            }
        }
    }

    #[test]
    fn a_large_footprint_leaves_no_noise() {
        for p in grid().take(50) {
            assert_eq!(fractal(p, 0.5, 8, Seed(7)), 0.0);
            let (a, b) = (
                brick(p, 4.0, Vec3::ONE, Seed(7)),
                brick(p + 1.7, 4.0, Vec3::ONE, Seed(7)),
            );
            // the wall goes over into one color, up to what part of a brick the footprint's border cuts
            assert!((a - b).abs().max_element() < 0.02, "{a} {b}");
        }
    }

    #[test]
    fn the_nearest_feature_point_is_the_nearest_of_many() {
        // the plain definition over 7 × 7 cells
        let seed = Seed(8);
        for p in grid().take(500) {
            let (x, y, f) = lattice(p);
            let mut nearest = f64::INFINITY;
            for dy in -3..=3 {
                for dx in -3..=3 {
                    let bits = seed.bits(x + dx, y + dy, 1);
                    let inner = |b: u64| 0.2 + 0.6 * (b & 0xf_ffff) as f64 / 1_048_576.0;
                    let point = DVec2::new(dx as f64 + inner(bits), dy as f64 + inner(bits >> 20));
                    nearest = nearest.min(point.distance(f));
                }
            }
            let cell = cellular(p, seed);
            assert!((cell.nearest - nearest).abs() < 1e-12 && cell.second >= cell.nearest);
        }
    }

    #[test]
    fn stones_and_joints_have_their_share_of_the_area() {
        let wall = Masonry {
            length: 2.0,
            height: 1.0,
            joint: 0.25,
            shift: 0.5,
        };
        let share = wall.at(DVec2::new(0.3, 0.2), 40.0, Seed(9)).face;
        assert!((share - (1.75 / 2.0) * 0.75).abs() < 1e-9);
        assert_eq!(wall.at(DVec2::new(0.8, 0.4), 0.01, Seed(9)).face, 1.0);
        assert_eq!(wall.at(DVec2::new(0.8, 0.9), 0.01, Seed(9)).face, 0.0);
    }

    #[test]
    fn materials_reflect_between_nothing_and_all() {
        for p in grid() {
            for footprint in [0.0005, 0.02, 0.5] {
                let colors = [
                    brick(p, footprint, hex(0x9c4a32), Seed(1)),
                    tiles(p, footprint, 0.4, [hex(0xd8cfc0), hex(0x7d4a3a)], Seed(1)),
                    wood(p, footprint, hex(0x9a6a3c), Seed(1)),
                    marble(p, footprint, Seed(1)),
                    grass(p, footprint, Seed(1)),
                ];
                for color in colors {
                    assert!(
                        color.min_element() >= 0.0 && color.max_element() <= 1.3,
                        "{color}"
                    );
                }
            }
        }
    }

    #[test]
    fn leaves_grow_only_where_there_is_density() {
        let disc = |p: DVec2| 1.0 - p.length();
        let cover = |p| foliage(p, 0.001, 0.1, disc, Seed(2)).cover;
        assert!(grid().filter(|p| p.length() > 1.2).all(|p| cover(p) == 0.0));
        let inner: Vec<f64> = grid().map(|p| cover(p * 0.05)).collect();
        // four layers of leaves, each of which covers more than half
        assert!(inner.iter().sum::<f64>() / inner.len() as f64 > 0.9);
    }
}

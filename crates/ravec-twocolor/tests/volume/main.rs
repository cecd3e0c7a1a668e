//! The fit of two-color voxels against its definition, and against planted edges.

mod contract;
mod oracle;

use glam::{DVec2, DVec3};
use oracle::{all_splits, best_error, error_of_plane, error_of_split, points, voxels_of};
use proptest::prelude::*;
use ravec_progress::Progress;
use ravec_raster::{Color, Image, LinearRgba, Oklab, Size};
use ravec_twocolor::volume::{TwoColorVolume, VolumeParams};

/// A stream of numbers from 0 to 1 (splitmix64), the same on every machine.
struct Noise(u64);

impl Noise {
    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    /// About normal, mean 0, deviation 1.
    fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }
}

fn size(width: usize, height: usize) -> Size {
    Size::new(width, height).unwrap()
}

/// Colors from 0.3 to 0.7 in lightness, and a little color, without any structure.
fn noise_video(width: usize, height: usize, frames: usize, seed: u64) -> Vec<Image<Oklab>> {
    let mut noise = Noise(seed);
    (0..frames)
        .map(|_| {
            Image::from_fn(size(width, height), |_, _| {
                Oklab([
                    0.3 + 0.4 * noise.uniform() as f32,
                    0.1 * noise.uniform() as f32,
                    0.1 * noise.uniform() as f32,
                ])
            })
        })
        .collect()
}

const DARK: Oklab = Oklab([0.3, 0.05, -0.05]);
const LIGHT: Oklab = Oklab([0.7, -0.02, 0.04]);

/// One block with a planted plane: dark where `normal·(position, time) < offset`, both from the block's center.
fn planted(
    side: usize,
    frames: usize,
    normal: DVec3,
    offset: f64,
    sigma: f64,
    seed: u64,
) -> Vec<Image<Oklab>> {
    let mut noise = Noise(seed);
    let half = 0.5 * (side as f64 - 1.0);
    (0..frames)
        .map(|t| {
            Image::from_fn(size(side, side), |x, y| {
                let time = t as f64 - 0.5 * (frames as f64 - 1.0);
                let position = DVec3::new(x as f64 - half, y as f64 - half, time);
                let Oklab(mut color) = if normal.dot(position) < offset {
                    DARK
                } else {
                    LIGHT
                };
                for v in &mut color {
                    *v += (sigma * noise.normal()) as f32;
                }
                Oklab(color)
            })
        })
        .collect()
}

fn params(block_px: usize, block_frames: usize) -> VolumeParams {
    VolumeParams {
        block_px,
        block_frames,
        flat_contrast: 0.0,
        ..VolumeParams::default()
    }
}

fn fit<P: Color>(frames: &[Image<P>], params: &VolumeParams) -> TwoColorVolume {
    TwoColorVolume::fit(frames, params, &Progress::none()).unwrap()
}

/// A normal whose trace moves with a velocity.
fn moving(angle_rad: f64, velocity_px: f64) -> DVec3 {
    DVec2::from_angle(angle_rad).extend(-velocity_px)
}

/// Blocks of pure noise: nothing guides the search to the best of many nearly equal splits.
#[test]
fn on_noise_the_error_is_within_half_a_percent_of_the_optimum_on_average() {
    // measured: means 1.0000, 1.0010, 1.0000, 1.0006, 1.0016 and 99th percentiles 1, 1.006, 1, 1.013, 1.029
    const BLOCKS: usize = 200;
    for [side, m] in [[2, 2], [3, 2], [2, 3], [3, 3], [4, 2]] {
        let splits = all_splits([side, side, m]);
        let frames = noise_video(side * BLOCKS, side, m, 7);
        let volume = fit(&frames, &params(side, m));
        let mut ratios: Vec<f64> = (0..BLOCKS)
            .map(|col| {
                let voxels = voxels_of(&frames, col, 0, side);
                f64::from(volume.block(col, 0, 0).error) / best_error(&voxels, &splits)
            })
            .collect();
        ratios.sort_by(f64::total_cmp);
        let mean = ratios.iter().sum::<f64>() / BLOCKS as f64;
        // nothing is below the optimum but by the rounding of colors to single precision
        assert!(ratios[0] > 1.0 - 1e-5, "{side} {m}: {}", ratios[0]);
        assert!(mean <= 1.005, "{side} {m}: mean {mean}");
        let percentile = ratios[BLOCKS * 99 / 100 - 1];
        assert!(percentile <= 1.05, "{side} {m}: {percentile}");
    }
}

/// The exhaustive small universe: each split of a cube is the truth once.
#[test]
fn every_split_of_a_small_cube_is_found_when_it_is_planted() {
    for [side, m] in [[2, 2], [3, 2], [3, 3]] {
        let splits = all_splits([side, side, m]);
        let frames: Vec<Image<Oklab>> = (0..m)
            .map(|t| {
                Image::from_fn(size(side * splits.len(), side), |x, y| {
                    let bit = (t * side + y) * side + x % side;
                    if splits[x / side] >> bit & 1 == 1 {
                        DARK
                    } else {
                        LIGHT
                    }
                })
            })
            .collect();
        let volume = fit(&frames, &params(side, m));
        let missed = volume.blocks().iter().filter(|b| b.error > 1e-6).count();
        assert_eq!(missed, 0, "{side} {m}: of {}", splits.len());
    }
}

/// Errors below this are rounding: a single voxel of 512 on the wrong side of the planted edges adds 3e-4.
const EXACT: f64 = 1e-6;

#[test]
fn a_planted_moving_edge_is_found_with_its_velocity() {
    let mut noise = Noise(5);
    let mut errors = Vec::new();
    for seed in 0..100 {
        let angle = noise.uniform() * std::f64::consts::TAU;
        let velocity = 2.0 * noise.uniform() - 1.0;
        let offset = 2.0 * noise.uniform() - 1.0;
        let normal = moving(angle, velocity);
        for sigma in [0.0, 0.04] {
            let frames = planted(8, 8, normal, offset, sigma, seed);
            let volume = fit(&frames, &params(8, 8));
            let voxel = volume.block(0, 0, 0);
            let voxels = voxels_of(&frames, 0, 0, 8);
            let points = points([8; 3]);
            let truth = error_of_split(&voxels, |i| {
                let position = DVec3::from_array(points[i].map(f64::from)) - 3.5;
                normal.dot(position) < offset
            });
            let error = f64::from(voxel.error);
            assert!(
                error < truth + EXACT,
                "{angle} {velocity} {offset}: {error} for {truth}"
            );
            let n = voxel.plane.unwrap().normal;
            let same_way = n.dot(normal).signum();
            errors.push((voxel.velocity_px().unwrap() * same_way - velocity).abs());
            let leading = if n.x.abs() >= n.y.abs() { n.x } else { n.y };
            assert!(leading > 0.0, "the documented orientation");
        }
    }
    // Planes of one split may differ by up to an eighth of a voxel a frame, one voxel in all, where the edge runs along
    // an axis; elsewhere by much less. Measured: median 0.004, 90th percentile 0.018, worst 0.12.
    errors.sort_by(f64::total_cmp);
    let at = |percent: usize| errors[(errors.len() - 1) * percent / 100];
    assert!(at(50) < 0.01, "median {}", at(50));
    assert!(at(90) < 0.04, "90 % {}", at(90));
    assert!(at(100) < 0.15, "worst {}", at(100));
}

#[test]
fn a_standing_edge_stands() {
    for step in 0..24 {
        let normal = moving(f64::from(step) * 0.27, 0.0);
        let volume = fit(&planted(8, 8, normal, 0.4, 0.0, 0), &params(8, 8));
        let voxel = volume.block(0, 0, 0);
        assert!(f64::from(voxel.error) < EXACT);
        // the planes of a standing split lie symmetrically about the standing ones
        let velocity = voxel.velocity_px().unwrap();
        assert!(velocity.abs() < 0.01, "{step}: {velocity}");
    }
}

#[test]
fn a_scene_cut_is_a_plane_across_time() {
    for cut in 1..8 {
        let offset = f64::from(cut) - 4.0;
        let frames = planted(8, 8, DVec3::Z, offset, 0.01, 3);
        let voxel = *fit(&frames, &params(8, 8)).block(0, 0, 0);
        assert_eq!(voxel.velocity_px(), None, "{:?}", voxel.plane);
        assert!((voxel.plane.unwrap().offset_px - offset).abs() < 0.05);
        // 64 voxels or more of noise 0.01 a side: means are within 0.005
        let shown = |time| voxel.pixel_at(time).colors[0].0[0];
        assert!((shown(offset - 0.5) - DARK.0[0]).abs() < 0.005);
        assert!((shown(offset + 0.5) - LIGHT.0[0]).abs() < 0.005);
    }
}

fn any_color() -> impl Strategy<Value = LinearRgba> {
    let channel = || prop_oneof![Just(0.0f32), Just(1.0), 0.0f32..1.0];
    (channel(), channel(), channel(), channel()).prop_map(|(r, g, b, a)| LinearRgba([r, g, b, a]))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Ties, extreme colors, transparency, blocks clipped on three sides: the error is that of the plane's split, and
    /// never above that of one color or of a cut across x, y or time.
    #[test]
    fn the_error_is_that_of_the_plane(
        (width, height, frames) in (1usize..12, 1usize..12, 2usize..9),
        (side, m) in (2usize..9, 2usize..9),
        colors in prop::collection::vec(any_color(), 1..40),
        picks in prop::collection::vec(0usize..40, 1..1200),
    ) {
        let video: Vec<Image<LinearRgba>> = (0..frames)
            .map(|t| Image::from_fn(size(width, height), |x, y| {
                let i = (t * height + y) * width + x;
                colors[picks[i % picks.len()] % colors.len()]
            }))
            .collect();
        let volume = fit(&video, &params(side, m));
        let grid = volume.grid_size();
        prop_assert_eq!(volume.blocks().len(), grid.pixels() * volume.slabs());
        for (i, voxel) in volume.blocks().iter().enumerate() {
            let (col, row) = (i % grid.width(), i / grid.width() % grid.height());
            let frames = video.chunks(m).nth(i / grid.pixels()).unwrap();
            let voxels = voxels_of(frames, col, row, side);
            let extents = [
                side.min(width - col * side),
                side.min(height - row * side),
                frames.len(),
            ];
            let points = points(extents);
            let error = f64::from(voxel.error);
            let again = error_of_plane(voxel, &voxels, extents, [side, side, m]);
            // voxels are kept to single precision, and colors are of order 1
            prop_assert!((error - again).abs() < 1e-6, "{} {}", error, again);
            for axis in 0..3 {
                for cut in 0..extents[axis] as i32 {
                    let plain = error_of_split(&voxels, |i| points[i][axis] < cut);
                    prop_assert!(error <= plain + 1e-5, "{} {}", error, plain);
                }
            }
            for alpha in voxel.alphas {
                prop_assert!((0.0..=1.0).contains(&alpha));
            }
        }
    }
}

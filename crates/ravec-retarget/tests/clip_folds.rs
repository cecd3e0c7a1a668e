//! Nothing folds in any frame, whatever the frames, their motions and the options are, and every frame comes back once.

use glam::{DMat3, dvec2};
use proptest::prelude::*;
use ravec_progress::Progress;
use ravec_raster::{AnyImage, Image, Mask, Rect, Size, Srgb};
use ravec_retarget::Borders;
use ravec_retarget::clip::{ClipFrame, ClipOptions, ClipRetargeter, FrameMotion, Settled};

fn random(seed: u64, k: u64) -> f64 {
    let mut h = seed ^ k.wrapping_mul(0x9e37_79b9_7f4a_7c15);
    h = (h ^ (h >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    h = (h ^ (h >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    (h >> 11) as f64 / (1u64 << 53) as f64
}

/// Blocks of random colors that move, with stripes.
fn frame(size: Size, seed: u64, t: usize) -> AnyImage {
    let block = 3 + seed as usize % 17;
    Image::from_fn(size, |col, row| {
        let x = col + (seed as usize % 5) * t;
        if ((x + 2 * row) / 29).is_multiple_of(3) {
            return Srgb([240u8, 235, 230]);
        }
        let place = (x / block * 1000 + row / block) as u64;
        Srgb([0, 1, 2].map(|c| (255.0 * random(seed, 3 * place + c)) as u8))
    })
    .into()
}

/// A motion of a few pixels, with zoom, turn and perspective.
fn motion(seed: u64, t: usize) -> FrameMotion {
    let r = |k: u64, reach: f64| reach * (2.0 * random(seed, 97 * t as u64 + k) - 1.0);
    let strength = [0.0, 1.0, 6.0][seed as usize / 7 % 3];
    let turn = DMat3::from_angle(0.01 * r(1, strength));
    let zoom = DMat3::from_scale(dvec2(
        1.0 + 0.01 * r(2, strength),
        1.0 + 0.01 * r(3, strength),
    ));
    let shift = DMat3::from_translation(dvec2(r(4, strength), r(5, strength)));
    let mut tilt = DMat3::IDENTITY;
    tilt.x_axis.z = 1e-4 * r(6, strength);
    tilt.y_axis.z = 1e-4 * r(7, strength);
    FrameMotion {
        frame_from_previous: shift * turn * zoom * tilt,
        cut: random(seed, 1000 + t as u64) < 0.05,
    }
}

fn assert_one_to_one(frame: &Settled) {
    for found in &frame.deformations {
        for (corners, _) in found.cells() {
            for k in 0..4 {
                let [before, here, after] = [k + 3, k, k + 1].map(|k: usize| corners[k % 4]);
                assert!(
                    (after - here).perp_dot(before - here) > 0.0,
                    "frame {}: {corners:?}",
                    frame.frame
                );
            }
        }
        assert!(found.summary().least_area > 0.0);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn no_cell_is_inverted_in_any_frame(
        (width, height) in (1usize..90, 1usize..70),
        (fx, fy) in (0.25f64..3.0, 0.25f64..3.0),
        seed in any::<u64>(),
        count in 1usize..34,
        cells in 2usize..20,
        (look_ahead, sample_frames, voxel_frames) in (1usize..12, 1usize..9, 2usize..20),
        borders in 0usize..3,
    ) {
        let size = Size::new(width, height).unwrap();
        let side = |length: usize, factor: f64| ((length as f64 * factor).round() as usize).max(1);
        let target = Size::new(side(width, fx), side(height, fy)).unwrap();
        let options = ClipOptions {
            grid_cells: cells,
            borders: [Borders::Slide, Borders::Symmetric, Borders::Free][borders],
            look_ahead,
            sample_frames,
            voxel_frames,
            ..ClipOptions::default()
        };
        let none = Progress::none();
        let rect = Rect::new(width / 3, height / 3, width / 3, height / 4);
        let mask = Mask::from_rect(size, rect);
        let mut clip = ClipRetargeter::new(size, &[target, size], &options).unwrap();
        let mut settled: Vec<Settled> = Vec::new();
        for t in 0..count {
            let image = frame(size, seed, t);
            // a motion that takes the frame out of view is refused: then the camera stands
            let mut pushed = ClipFrame::new(image, motion(seed, t));
            if width.min(height) < 20 {
                pushed.motion.frame_from_previous = DMat3::IDENTITY;
            }
            pushed.protect = (seed % 3 == 0 && t % 4 == 1).then_some(&mask);
            pushed.give_way = (seed % 3 == 1).then_some(&mask);
            settled.extend(clip.push(pushed, &none).unwrap());
        }
        settled.extend(clip.finish(&none).unwrap());
        prop_assert_eq!(settled.len(), count);
        for (number, frame) in settled.iter().enumerate() {
            prop_assert_eq!(frame.frame, number);
            assert_one_to_one(frame);
        }
        prop_assert!(clip.report().least_area > 0.0);
        let warped = settled[count / 2].warp(0, &none).unwrap();
        prop_assert_eq!(warped.size(), target);
    }
}

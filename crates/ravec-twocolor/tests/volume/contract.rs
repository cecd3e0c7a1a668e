//! The contract of every volume: parameters, errors, cancellation, threads, frame by frame, drawing.

use crate::{DARK, EXACT, LIGHT, fit, moving, noise_video, params, planted, size};
use ravec_progress::Progress;
use ravec_raster::{Image, Oklab, PremulLinearRgba, Srgb};
use ravec_twocolor::volume::{
    TwoColorVolume, TwoColorVoxel, VolumeBuilder, VolumeError, VolumeParams,
};
use ravec_twocolor::{FitParams, TwoColorField};

#[test]
fn blocks_of_one_frame_are_two_color_pixels() {
    let frames = noise_video(37, 21, 3, 9);
    for (block_px, flat_contrast) in [(2, 0.0), (5, 0.1), (8, 0.0), (16, 0.05)] {
        let volume_params = VolumeParams {
            flat_contrast,
            ..params(block_px, 1)
        };
        let field_params = FitParams {
            block_px,
            flat_contrast,
            ..FitParams::default()
        };
        let volume = fit(&frames, &volume_params);
        for (t, frame) in frames.iter().enumerate() {
            let field = TwoColorField::fit(frame, &field_params, &Progress::none()).unwrap();
            let grid = field.grid_size();
            for (i, pixel) in field.blocks().iter().enumerate() {
                let voxel = volume.block(i % grid.width(), i / grid.width(), t);
                assert_eq!(voxel.error, pixel.error);
                assert_eq!(voxel.is_flat(), pixel.is_flat());
                assert_eq!(voxel.velocity_px(), pixel.line.map(|_| 0.0));
            }
        }
    }
}

#[test]
fn one_thread_and_many_give_the_same_bits() {
    let frames = noise_video(50, 40, 5, 2);
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.unwrap().install(|| fit(&frames, &params(8, 4)))
    };
    assert_eq!(with(1), with(3));
}

#[test]
fn frame_by_frame_gives_the_same_volume() {
    let frames = noise_video(20, 20, 10, 4);
    let params = params(8, 4);
    let mut builder = VolumeBuilder::new(&params).unwrap();
    let mut slabs = Vec::new();
    for frame in frames.clone() {
        if let Some(slab) = builder.push(frame, &Progress::none()).unwrap() {
            slabs.push(slab.to_vec());
        }
    }
    let volume = builder.finish(&Progress::none()).unwrap();
    assert_eq!(volume, fit(&frames, &params));
    // the third slab has two frames only, and comes with the end
    assert_eq!(slabs.concat(), volume.blocks()[..2 * 9]);
}

#[test]
fn a_builder_survives_a_refused_frame_and_a_cancellation() {
    let frames = noise_video(9, 9, 4, 4);
    let mut builder = VolumeBuilder::new(&params(4, 2)).unwrap();
    let cancelled = Progress::none();
    cancelled.cancel();
    let odd = Image::new(size(3, 9), DARK);
    for (number, frame) in frames.iter().enumerate() {
        if number > 0 {
            let refused = builder.push(odd.clone(), &Progress::none()).unwrap_err();
            let expected = VolumeError::FrameSize {
                frame: number,
                got: size(3, 9),
                expected: size(9, 9),
            };
            assert_eq!(refused, expected);
        }
        if number % 2 == 1 {
            let error = builder.push(frame.clone(), &cancelled).unwrap_err();
            assert!(matches!(error, VolumeError::Cancelled(_)));
        }
        builder.push(frame.clone(), &Progress::none()).unwrap();
    }
    let volume = builder.finish(&Progress::none()).unwrap();
    assert_eq!(volume, fit(&frames, &params(4, 2)));

    // a first frame that was cancelled does not decide the size
    let mut builder = VolumeBuilder::new(&params(4, 1)).unwrap();
    assert!(builder.push(odd, &cancelled).is_err());
    builder.push(frames[0].clone(), &Progress::none()).unwrap();
    let volume = builder.finish(&Progress::none()).unwrap();
    assert_eq!(volume.frame_size(), size(9, 9));
}

#[test]
fn each_bad_input_has_its_error() {
    let frames = noise_video(4, 4, 2, 0);
    let fit = |frames: &[Image<Oklab>], params: &VolumeParams| {
        TwoColorVolume::fit(frames, params, &Progress::none()).unwrap_err()
    };
    let good = VolumeParams::default();
    assert_eq!(fit(&[], &good), VolumeError::NoFrames);
    for got in [0, 1, 17] {
        let error = VolumeError::BlockSize { got };
        assert_eq!(fit(&frames, &params(got, 4)), error);
    }
    for got in [0, 17] {
        let error = VolumeError::BlockFrames { got };
        assert_eq!(fit(&frames, &params(4, got)), error);
        let params = VolumeParams {
            starts: got,
            ..good.clone()
        };
        assert_eq!(fit(&frames, &params), VolumeError::Starts { got });
        assert!(VolumeBuilder::<Oklab>::new(&params).is_err());
    }
    let odd = [frames[0].clone(), Image::new(size(5, 4), DARK)];
    let error = VolumeError::FrameSize {
        frame: 1,
        got: size(5, 4),
        expected: size(4, 4),
    };
    assert_eq!(fit(&odd, &good), error);
    let empty = VolumeBuilder::<Oklab>::new(&good).unwrap();
    let error = empty.finish(&Progress::none()).unwrap_err();
    assert_eq!(error, VolumeError::NoFrames);
}

#[test]
fn a_cancelled_fit_stops() {
    let progress = Progress::none();
    progress.cancel();
    let frames = noise_video(16, 16, 4, 0);
    for m in [1, 4] {
        let result = TwoColorVolume::fit(&frames, &params(8, m), &progress);
        assert!(matches!(result, Err(VolumeError::Cancelled(_))));
    }
    let volume = fit(&frames, &params(8, 4));
    assert!(volume.render_frame(0, &progress).is_err());
}

#[test]
fn a_constant_block_is_flat_and_keeps_its_color_beside_a_voxel_that_is_not_a_number() {
    let mut frames = vec![Image::new(size(9, 9), DARK); 5];
    let volume = fit(&frames, &params(8, 4));
    assert!(volume.blocks().iter().all(TwoColorVoxel::is_flat));
    let off = |voxel: &TwoColorVoxel| (voxel.colors[0].0[0] - DARK.0[0]).abs();
    assert!(volume.blocks().iter().all(|voxel| off(voxel) < 1e-5));
    // it counts as transparent, so the block may have a side without cover, and has one with it
    frames[1][(2, 2)] = Oklab([f32::NAN; 3]);
    let volume = fit(&frames, &params(8, 4));
    for voxel in volume.blocks() {
        let covering = (0..2).filter(|&side| voxel.alphas[side] > 0.01);
        let mut colors = covering.map(|side| voxel.colors[side]).peekable();
        assert!(colors.peek().is_some());
        assert!(colors.all(|color| (color.0[0] - DARK.0[0]).abs() < 1e-4));
    }
}

#[test]
fn faint_blocks_are_flat_below_the_threshold() {
    // the Oklab distance of the planted colors is 0.416, and half of the block is on each side
    let frames = planted(8, 8, moving(0.3, 0.2), 0.0, 0.0, 0);
    for (flat_contrast, flat) in [(0.40, false), (0.43, true)] {
        let params = VolumeParams {
            flat_contrast,
            ..params(8, 8)
        };
        assert_eq!(fit(&frames, &params).block(0, 0, 0).is_flat(), flat);
    }
}

#[test]
fn a_frame_drawn_from_the_volume_looks_like_the_frame() {
    // an edge between pixel columns, so that no pixel mixes colors, moving by a pixel a frame through a clipped border
    let frames: Vec<Image<Oklab>> = (0..11)
        .map(|t| Image::from_fn(size(21, 13), |x, _| if x < 6 + t { DARK } else { LIGHT }))
        .collect();
    let volume = fit(&frames, &params(8, 8));
    assert_eq!((volume.grid_size(), volume.slabs()), (size(3, 2), 2));
    for (t, frame) in frames.iter().enumerate() {
        let drawn = volume.render_frame(t, &Progress::none()).unwrap();
        let wanted = frame.convert::<PremulLinearRgba>();
        // the plane is centered between the columns to a few hundredths of a pixel; three frames of a block which the edge
        // is about to leave hold it less firmly, but no pixel may lean to the wrong side
        let tolerance = if t < 8 { 0.03 } else { 0.1 };
        for (drawn, wanted) in drawn.pixels().iter().zip(wanted.pixels()) {
            for (a, b) in drawn.0.iter().zip(wanted.0) {
                assert!((a - b).abs() < tolerance, "{t}: {drawn:?} {wanted:?}");
            }
        }
    }
    let at = |time| volume.render_at(time, &Progress::none()).unwrap();
    assert_eq!(at(f64::NAN), at(0.0));
    assert_eq!(at(-5.0), at(0.0));
    assert_eq!(at(1e9), at(11.0));
}

#[test]
fn eight_bit_video_is_fitted_too() {
    let frames: Vec<Image<Srgb<u8>>> = planted(8, 6, moving(1.0, 0.5), 0.0, 0.0, 0)
        .iter()
        .map(Image::convert)
        .collect();
    let volume = fit(&frames, &VolumeParams::default());
    assert!(f64::from(volume.block(0, 0, 0).error) < EXACT);
}

//! Completion held against scenes whose hidden background is known, and against its promises.

use glam::{DVec2, dvec2};
use proptest::prelude::*;
use ravec_completion::{CompleteError, CompleteParams, complete};
use ravec_progress::Progress;
use ravec_raster::{Image, LinearRgba, Mask, Rect, Size, Srgb, Srgba};
use ravec_scenes::Seed;
use ravec_scenes::occlusion::{Surface, occluded};

fn done(image: &Image<Srgb<u8>>, hole: &Mask, planes: &[[DVec2; 4]]) -> Image<Srgb<u8>> {
    complete(
        image,
        hole,
        planes,
        &CompleteParams::default(),
        &Progress::none(),
    )
    .unwrap()
    .image
}

/// The root of the mean squared difference in the hole, in 8-bit steps.
fn error(a: &Image<Srgb<u8>>, b: &Image<Srgb<u8>>, hole: &Mask) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for row in 0..a.height() {
        for col in 0..a.width() {
            if hole.at(col, row) > 0.0 {
                for c in 0..3 {
                    sum += f64::from(a[(col, row)].0[c].abs_diff(b[(col, row)].0[c])).powi(2);
                    count += 1.0;
                }
            }
        }
    }
    f64::sqrt(sum / count)
}

/// The picture, its hidden background, the hole, and the corners of the plane.
type Planted = (Image<Srgb<u8>>, Image<Srgb<u8>>, Mask, [DVec2; 4]);

fn planted(surface: Surface) -> Planted {
    let scene = occluded(surface, Size::new(360, 270).unwrap(), Seed(5));
    // all that the post touches is replaced whole
    let hole = Mask::from_fn(scene.post.size(), |col, row| scene.post.at(col, row) > 0.0);
    (
        scene.picture.convert(),
        scene.background.convert(),
        hole,
        scene.corners_in_image,
    )
}

#[test]
fn windows_and_tiles_behind_a_post_go_on_in_perspective() {
    // what repeats exactly comes back but for resampling and seams; without the plane it cannot
    for surface in [Surface::Windows, Surface::Tiles] {
        let (picture, background, hole, quad) = planted(surface);
        let with = error(&done(&picture, &hole, &[quad]), &background, &hole);
        let before = error(&picture, &background, &hole);
        assert!(with < 0.35 * before, "{surface:?}: {with} of {before}");
    }
}

#[test]
fn bricks_and_wood_behind_a_post_look_like_their_surroundings() {
    for surface in [Surface::Bricks, Surface::Wood] {
        let (picture, background, hole, quad) = planted(surface);
        let found = done(&picture, &hole, &[quad]);
        // no brick is like another: two of them differ by about their own contrast
        let (after, before) = (
            error(&found, &background, &hole),
            error(&picture, &background, &hole),
        );
        assert!(after < 0.6 * before, "{surface:?}: {after} of {before}");
    }
}

#[test]
fn only_pixels_under_the_mask_change_in_every_pixel_type() {
    let size = Size::new(80, 60).unwrap();
    let soft = Mask::from_disc(size, dvec2(40.3, 30.2), 9.0).unwrap();
    let color =
        |col: usize, row: usize, c: usize| (col * 7 + row * 13 * (c + 1) + col * row) as u32 % 251;
    let deep: Image<Srgba<u16>> = Image::from_fn(size, |col, row| {
        Srgba([0, 1, 2, 3].map(|c| (color(col, row, c) * 261) as u16))
    });
    let light: Image<LinearRgba> = deep.convert();
    let params = CompleteParams::default();
    let a = complete(&deep, &soft, &[], &params, &Progress::none())
        .unwrap()
        .image;
    let b = complete(&light, &soft, &[], &params, &Progress::none())
        .unwrap()
        .image;
    for row in 0..60 {
        for col in 0..80 {
            if soft.at(col, row) == 0.0 {
                assert_eq!(a[(col, row)], deep[(col, row)]);
                assert_eq!(b[(col, row)], light[(col, row)]);
            }
        }
    }
    assert_ne!(a, deep);
}

#[test]
fn a_scratch_across_a_slope_leaves_no_trace() {
    let size = Size::new(90, 70).unwrap();
    let slope = Image::from_fn(size, |col, row| {
        Srgb([(2 * col) as u8, (3 * row) as u8, (col + row) as u8])
    });
    let scratch = Mask::from_fn(size, |col, row| (col + 2 * row).abs_diff(120) < 4);
    let hurt = Image::from_fn(size, |col, row| {
        if scratch.at(col, row) > 0.0 {
            Srgb([255; 3])
        } else {
            slope[(col, row)]
        }
    });
    // a plane bends nothing: rounding only
    let found = done(&hurt, &scratch, &[]);
    assert!(error(&found, &slope, &scratch) < 1.0);
}

#[test]
fn the_number_of_threads_does_not_matter() {
    let (picture, _, hole, quad) = planted(Surface::Tiles);
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| done(&picture, &hole, &[quad]))
    };
    assert_eq!(run(1), run(3));
}

#[test]
fn an_empty_mask_changes_nothing() {
    let (picture, _, _, _) = planted(Surface::Wood);
    let none = Mask::empty(picture.size());
    assert_eq!(done(&picture, &none, &[]), picture);
}

#[test]
fn what_cannot_be_filled_says_why() {
    let size = Size::new(40, 30).unwrap();
    let image = Image::new(size, Srgb([90u8, 80, 70]));
    let hole = Mask::from_rect(size, Rect::new(10, 10, 10, 10));
    let fails = |hole: &Mask, planes: &[[DVec2; 4]]| {
        complete(
            &image,
            hole,
            planes,
            &CompleteParams::default(),
            &Progress::none(),
        )
        .unwrap_err()
    };
    let small = Mask::empty(Size::new(9, 9).unwrap());
    assert!(matches!(fails(&small, &[]), CompleteError::MaskSize { .. }));
    assert_eq!(
        fails(&Mask::full(size), &[]),
        CompleteError::NoSource {
            largest_radius_px: 0.0
        }
    );
    let stripes = Mask::from_fn(size, |col, _| col % 5 != 0);
    assert!(matches!(
        fails(&stripes, &[]),
        CompleteError::NoSource { largest_radius_px } if largest_radius_px <= 1.0
    ));
    let quad = |p: [(f64, f64); 4]| [p.map(|(x, y)| dvec2(x, y))];
    let crossing = quad([(0.0, 0.0), (30.0, 25.0), (30.0, 0.0), (0.0, 25.0)]);
    assert_eq!(
        fails(&hole, &crossing),
        CompleteError::QuadCrosses { plane: 1 }
    );
    let concave = quad([(0.0, 0.0), (30.0, 0.0), (8.0, 6.0), (0.0, 25.0)]);
    assert!(matches!(
        fails(&hole, &concave),
        CompleteError::Plane { plane: 1, .. }
    ));
    let outside = quad([(50.0, 0.0), (60.0, 0.0), (60.0, 10.0), (50.0, 10.0)]);
    assert_eq!(
        fails(&hole, &outside),
        CompleteError::PlaneOutside { plane: 1 }
    );
}

#[test]
fn a_cancelled_completion_says_so() {
    let (picture, _, hole, quad) = planted(Surface::Bricks);
    let progress = Progress::none();
    progress.cancel();
    let result = complete(
        &picture,
        &hole,
        &[quad],
        &CompleteParams::default(),
        &progress,
    );
    assert!(matches!(result, Err(CompleteError::Cancelled(_))));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn no_mask_and_no_plane_is_too_odd(
        col in 0usize..40, row in 0usize..30, width in 1usize..40, height in 1usize..30,
        xs in prop::array::uniform4(-20f64..60.0), ys in prop::array::uniform4(-20f64..50.0), noise in any::<u64>(),
    ) {
        let size = Size::new(40, 30).unwrap();
        let image = Image::from_fn(size, |c, r| {
            let value = (c as u64 * 31 + r as u64 * 17).wrapping_mul(noise | 1) >> 40;
            Srgb([value as u8, (value >> 8) as u8, (value >> 16) as u8])
        });
        let hole = Mask::from_rect(size, Rect::new(col, row, width, height));
        let quad = [0, 1, 2, 3].map(|i| dvec2(xs[i], ys[i]));
        // any answer will do, but a pixel outside the mask never changes
        if let Ok(filled) = complete(&image, &hole, &[quad], &CompleteParams::default(), &Progress::none()) {
            for r in 0..30 {
                for c in 0..40 {
                    prop_assert!(hole.at(c, r) > 0.0 || filled.image[(c, r)] == image[(c, r)]);
                }
            }
        }
    }
}

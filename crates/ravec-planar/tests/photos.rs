//! Photos of a plane whose homography is an input, matched from their pixels alone.

use glam::{DMat3, DVec2, dvec2};
use ravec_planar::{
    FeatureParams, Features, Homography, MatchError, MatchParams, encoded_luminance,
    match_features, match_photos,
};
use ravec_progress::Progress;
use ravec_raster::{Image, LinearRgb, Plane, Size, Srgb};
use ravec_scenes::Seed;
use ravec_scenes::damage::add_gaussian_noise;
use ravec_scenes::texture::{cellular, fractal};
use rayon::prelude::*;

const WIDTH: usize = 480;
const HEIGHT: usize = 360;

/// A photo of a textured plane: clouds and cells of all sizes, with noise of 2 of 255 steps.
fn photo(plane_from_image: &Homography, seed: Seed) -> Plane {
    photo_of(Size::new(WIDTH, HEIGHT).unwrap(), plane_from_image, seed)
}

fn photo_of(size: Size, plane_from_image: &Homography, seed: Seed) -> Plane {
    let mut image = Image::new(size, LinearRgb([0.0; 3]));
    image.par_rows_mut().enumerate().for_each(|(row, line)| {
        for (col, pixel) in line.iter_mut().enumerate() {
            // two samples a pixel
            let sum: f64 = [(0.25, 0.25), (0.75, 0.75)]
                .iter()
                .map(|&(x, y)| plane_from_image.apply(dvec2(col as f64 + x, row as f64 + y)))
                .map(|q| {
                    let clouds = fractal(q / 60.0, 1.0 / 60.0, 4, Seed(1));
                    let cells =
                        cellular(q / 14.0, Seed(2)).tint + 0.7 * cellular(q / 37.0, Seed(3)).tint;
                    0.35 + 0.2 * clouds + 0.09 * cells
                })
                .sum();
            *pixel = LinearRgb([(sum / 2.0).clamp(0.0, 1.0) as f32; 3]);
        }
    });
    encoded_luminance(&add_gaussian_noise(&image.convert::<Srgb<u8>>(), 2.0, seed))
}

/// A camera that is turned, closer by `zoom` and tilted so that depth changes by ±`tilt` over half the width.
fn view(angle: f64, zoom: f64, tilt: f64, squeeze: f64) -> Homography {
    let center = dvec2(WIDTH as f64, HEIGHT as f64) * 0.5;
    let mut slant = DMat3::IDENTITY;
    slant.x_axis.z = tilt / center.x;
    Homography::from_matrix(
        DMat3::from_translation(center)
            * DMat3::from_scale(dvec2(1.0 / squeeze, 1.0))
            * slant
            * DMat3::from_scale_angle_translation(DVec2::splat(zoom), angle, DVec2::ZERO)
            * DMat3::from_translation(-center),
    )
    .unwrap()
}

/// The mean error at the corners of the first photo, in pixels of the second.
fn corner_error(found: &Homography, truth: &Homography) -> f64 {
    let (w, h) = (WIDTH as f64, HEIGHT as f64);
    [dvec2(0.0, 0.0), dvec2(w, 0.0), dvec2(w, h), dvec2(0.0, h)]
        .iter()
        .map(|&c| found.apply(c).distance(truth.apply(c)))
        .sum::<f64>()
        / 4.0
}

fn error_of(second_from_first: &Homography) -> (f64, bool) {
    let first = photo(&Homography::IDENTITY, Seed(10));
    let second = photo(&second_from_first.inverse(), Seed(11));
    let found = match_photos(&first, &second, &MatchParams::default(), &Progress::none()).unwrap();
    (
        corner_error(&found.second_from_first, second_from_first),
        found.tilted,
    )
}

#[test]
fn photos_turned_and_tilted_are_laid_on_each_other_within_a_fifth_of_a_pixel() {
    for (angle, zoom, tilt) in [
        (0.0, 1.0, 0.1),
        (0.7, 0.8, -0.1),
        (2.5, 1.0, 0.0),
        (-1.6, 1.3, 0.2),
    ] {
        let (error, _) = error_of(&view(angle, zoom, tilt, 1.0));
        assert!(error < 0.2, "{angle} {zoom} {tilt}: {error}");
    }
}

#[test]
fn a_photo_from_three_times_as_near_is_found_in_the_other() {
    let far_from_near = view(0.6, 0.35, 0.05, 1.0);
    let near = photo(&Homography::IDENTITY, Seed(10));
    let far = photo(&far_from_near.inverse(), Seed(11));
    let (params, progress) = (MatchParams::default(), Progress::none());
    let found = match_photos(&near, &far, &params, &progress).unwrap();
    assert!(corner_error(&found.second_from_first, &far_from_near) < 0.2);
    // the other way round the same corners are known as well, in pixels that are three times as small
    let found = match_photos(&far, &near, &params, &progress).unwrap();
    let back = found.second_from_first.inverse();
    assert!(corner_error(&back, &far_from_near) < 0.2);
}

#[test]
fn a_steep_view_is_found_through_views_from_other_sides() {
    let (error, tilted) = error_of(&view(0.4, 1.0, 0.1, 4.5));
    assert!(tilted && error < 0.5, "{tilted} {error}");
}

/// Seen along its diagonal, so that only views aslant help; of a strip of 20 : 1 these are made of tiles.
#[test]
fn a_steep_view_of_a_strip_is_found_through_tiles() {
    let strip = Size::new(1800, 90).unwrap();
    let first = photo_of(strip, &Homography::IDENTITY, Seed(10));
    let (turn, back) = (DMat3::from_angle(0.8), DMat3::from_angle(-0.8));
    let second_from_first = Homography::from_matrix(
        DMat3::from_translation(dvec2(60.0, 290.0))
            * turn
            * DMat3::from_scale(dvec2(0.25, 1.0))
            * back
            * DMat3::from_translation(dvec2(-500.0, 0.0)),
    )
    .unwrap();
    let second = photo(&second_from_first.inverse(), Seed(11));
    let found = match_photos(&first, &second, &MatchParams::default(), &Progress::none()).unwrap();
    let error = [dvec2(550.0, 45.0), dvec2(700.0, 80.0), dvec2(650.0, 10.0)]
        .iter()
        .map(|&at| {
            found
                .second_from_first
                .apply(at)
                .distance(second_from_first.apply(at))
        })
        .fold(0.0, f64::max);
    assert!(found.tilted && error < 0.5, "{found:?}: {error}");
}

#[test]
fn one_thread_and_many_give_the_same_bytes() {
    let photos = [
        photo(&Homography::IDENTITY, Seed(1)),
        photo(&view(0.3, 1.1, 0.1, 1.0), Seed(2)),
    ];
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| {
            match_photos(
                &photos[0],
                &photos[1],
                &MatchParams::default(),
                &Progress::none(),
            )
        })
    };
    assert_eq!(on(1), on(3));
}

#[test]
fn other_scenes_empty_and_broken_pictures_do_not_match() {
    let params = MatchParams::default();
    let progress = Progress::none();
    let first = photo(&Homography::IDENTITY, Seed(1));
    let size = first.size();
    let other = photo(
        &Homography::from_translation(dvec2(9000.0, 7000.0)).unwrap(),
        Seed(2),
    );
    for second in [
        other,
        Plane::new(size, 0.5),
        Plane::new(size, f32::NAN),
        Plane::new(Size::new(1, 1).unwrap(), 0.0),
    ] {
        let found = match_photos(&first, &second, &params, &progress);
        assert!(
            matches!(
                found,
                Err(MatchError::TooFewMatches { .. } | MatchError::NoPlane(_))
            ),
            "{found:?}"
        );
    }
    progress.cancel();
    assert_eq!(
        match_photos(&first, &first, &params, &progress),
        Err(MatchError::Cancelled)
    );
}

#[test]
fn features_of_a_turned_picture_are_the_turned_features() {
    let plane = photo(&Homography::IDENTITY, Seed(1));
    let turned = Plane::from_fn(plane.size().transposed(), |col, row| {
        plane[(row, HEIGHT - 1 - col)]
    });
    let detect =
        |plane| Features::detect(plane, &FeatureParams::default(), &Progress::none()).unwrap();
    let (straight, turned) = (detect(&plane), detect(&turned));
    let matches = match_features(&straight, &turned, 0.8);
    assert!(
        matches.len() > straight.points.len() * 6 / 10,
        "{} of {}",
        matches.len(),
        straight.points.len()
    );
    let mut right = 0;
    for found in &matches {
        let (a, b) = (straight.points[found.first], turned.points[found.second]);
        let quarter = (b.angle_rad - a.angle_rad).rem_euclid(std::f64::consts::TAU);
        let there = dvec2(HEIGHT as f64 - a.at.y, a.at.x);
        // octaves sample every second pixel from one side: coarse features are the same to a part of their own pixels
        let near = 0.1 * b.sigma_px;
        if b.at.distance(there) < near && (quarter - std::f64::consts::FRAC_PI_2).abs() < 0.1 {
            right += 1;
        }
    }
    assert!(
        right > matches.len() * 9 / 10,
        "{right} of {}",
        matches.len()
    );
}

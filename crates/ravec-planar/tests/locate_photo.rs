//! Photos of a plane by other cameras, laid on a frame by their pixels, against maps that are an input.

use glam::{DMat3, DVec2, DVec3, dvec2};
use ravec_planar::Homography;
use ravec_planar::track::{PhotoError, PhotoParams, PhotoPose, TrackState, locate_photo};
use ravec_progress::Progress;
use ravec_raster::{AnyImage, Image, LinearRgb, Size, Srgb};
use ravec_scenes::Seed;
use ravec_scenes::damage::add_gaussian_noise;
use ravec_scenes::texture::{cellular, fractal};
use rayon::prelude::*;

const WIDTH: usize = 480;
const HEIGHT: usize = 360;

/// The plane in the frame; around it there is something else, which moves otherwise.
const QUAD: [DVec2; 4] = [
    dvec2(90.0, 60.0),
    dvec2(400.0, 50.0),
    dvec2(410.0, 300.0),
    dvec2(80.0, 310.0),
];

fn frame_size() -> Size {
    Size::new(WIDTH, HEIGHT).unwrap()
}

/// A camera's film: what it makes of light.
#[derive(Clone, Copy)]
struct Film {
    gain: f64,
    gamma: f64,
    noise: f64,
    /// A disc in front of the plane, in pixels of the frame.
    hidden: Option<(DVec2, f64)>,
}

const PLAIN: Film = Film {
    gain: 1.0,
    gamma: 1.0,
    noise: 2.0,
    hidden: None,
};

/// A texture of clouds and cells of all sizes, blurred by a footprint.
fn texture(q: DVec2, footprint: f64, seed: Seed) -> f64 {
    let clouds = fractal(q / 60.0, footprint / 60.0, 7, seed.fork(1));
    let cells = cellular(q / 14.0, seed.fork(2)).tint + 0.7 * cellular(q / 37.0, seed.fork(3)).tint;
    0.35 + 0.2 * clouds + 0.09 * cells
}

fn is_on_plane(q: DVec2) -> bool {
    (0..4).all(|k| (QUAD[(k + 1) % 4] - QUAD[k]).perp_dot(q - QUAD[k]) >= 0.0)
}

/// The scene as seen by `frame_from_photo`, an average of many samples a pixel. What is not on the plane is shifted.
fn shot(
    size: Size,
    frame_from_photo: &Homography,
    film: Film,
    off_plane: DVec2,
    seed: Seed,
) -> AnyImage {
    let middle = dvec2(size.width() as f64, size.height() as f64) * 0.5;
    let spread = frame_from_photo.jacobian(middle);
    // two samples a pixel of the frame and of the photo at least, along each side
    let side = (2.0 * spread.col(0).length().max(spread.col(1).length()))
        .ceil()
        .clamp(2.0, 8.0) as usize;
    let footprint = spread.determinant().abs().sqrt() / side as f64;
    let mut image = Image::new(size, LinearRgb([0.0; 3]));
    image.par_rows_mut().enumerate().for_each(|(row, line)| {
        for (col, pixel) in line.iter_mut().enumerate() {
            let mut sum = 0.0;
            for k in 0..side * side {
                let within = dvec2((k % side) as f64 + 0.5, (k / side) as f64 + 0.5) / side as f64;
                let p = dvec2(col as f64, row as f64) + within;
                let q = frame_from_photo.apply(p);
                sum += match film.hidden {
                    Some((center, radius)) if q.distance(center) < radius => {
                        texture(p * 1.7, 0.3, Seed(77)) * 0.7
                    }
                    _ if is_on_plane(q) => texture(q, footprint, Seed(1)),
                    _ => texture(q + off_plane, footprint, Seed(2)),
                };
            }
            let light = film.gain * sum / (side * side) as f64;
            let value = light.clamp(0.0, 1.0).powf(film.gamma) as f32;
            *pixel = LinearRgb([value; 3]);
        }
    });
    AnyImage::Srgb8(add_gaussian_noise(
        &image.convert::<Srgb<u8>>(),
        film.noise,
        seed,
    ))
}

fn frame() -> AnyImage {
    shot(
        frame_size(),
        &Homography::IDENTITY,
        PLAIN,
        DVec2::ZERO,
        Seed(10),
    )
}

/// A camera at an angle to the plane, turned around its view, that shows it `zoom` times as large in the middle.
fn photo_from_frame(size: Size, tilt_deg: f64, axis: f64, roll: f64, zoom: f64) -> Homography {
    let focal = 900.0;
    let to = dvec2(size.width() as f64, size.height() as f64) * 0.5;
    let turned = glam::DQuat::from_rotation_z(roll)
        * glam::DQuat::from_axis_angle(DVec2::from_angle(axis).extend(0.0), tilt_deg.to_radians());
    let rotation = DMat3::from_quat(turned);
    let camera = DMat3::from_cols(
        dvec2(focal, 0.0).extend(0.0),
        dvec2(0.0, focal).extend(0.0),
        to.extend(1.0),
    );
    let placed = DMat3::from_cols(
        rotation.x_axis,
        rotation.y_axis,
        DVec3::new(0.0, 0.0, focal / zoom),
    );
    let center = dvec2(WIDTH as f64, HEIGHT as f64) * 0.5;
    Homography::from_matrix(camera * placed * DMat3::from_translation(-center)).unwrap()
}

/// Mean error of the corners, in pixels of the frame.
fn error(pose: &PhotoPose, photo_from_frame: &Homography) -> f64 {
    let off = |&p: &DVec2| {
        pose.frame_from_photo
            .apply(photo_from_frame.apply(p))
            .distance(p)
    };
    0.25 * QUAD.iter().map(off).sum::<f64>()
}

fn locate(photo: &AnyImage) -> Result<PhotoPose, PhotoError> {
    let params = PhotoParams::default();
    locate_photo(photo, &frame(), Some(QUAD), &params, &Progress::none())
}

/// The pose of a photo, and its error.
fn judge(size: (usize, usize), view: [f64; 4], film: Film) -> (PhotoPose, f64) {
    let size = Size::new(size.0, size.1).unwrap();
    let [tilt, axis, roll, zoom] = view;
    let truth = photo_from_frame(size, tilt, axis, roll, zoom);
    let photo = shot(size, &truth.inverse(), film, dvec2(40.0, -25.0), Seed(11));
    let pose = locate(&photo).unwrap();
    let error = error(&pose, &truth);
    println!(
        "{size} {view:?}: error {error:.4} sigma {:.4} {:?} visible {:.2} inliers {} gain {:.2}",
        pose.sigma_px(),
        pose.state,
        pose.visible,
        pose.inliers,
        pose.gain
    );
    (pose, error)
}

const OTHER_CAMERA: Film = Film {
    gain: 1.3,
    gamma: 1.25,
    noise: 2.0,
    hidden: None,
};

#[test]
fn moderate_views_are_laid_within_a_tenth_of_a_pixel() {
    for (view, film) in [
        ([0.0, 0.0, 0.3, 1.0], PLAIN),
        ([25.0, 0.7, -0.8, 1.1], PLAIN),
        ([35.0, 2.0, 2.4, 0.9], OTHER_CAMERA),
        (
            [15.0, 1.0, 0.1, 1.0],
            Film {
                gain: 0.5,
                ..OTHER_CAMERA
            },
        ),
    ] {
        let (pose, error) = judge((640, 480), view, film);
        assert!(error < 0.1, "{view:?}: {error}");
        assert_eq!(pose.state, TrackState::Tracked);
        assert!(
            error < 4.0 * pose.sigma_px() + 0.01,
            "{error} {}",
            pose.sigma_px()
        );
    }
}

#[test]
fn the_light_of_the_photo_is_measured() {
    let film = Film { gain: 0.6, ..PLAIN };
    // linear light of 0.6 is about 0.6 to the power of 1 / 2.3 in encoded values, whichever picture is the coarser one
    for zoom in [1.3, 0.7] {
        let (pose, error) = judge((640, 480), [10.0, 0.0, 0.2, zoom], film);
        let middle = pose.gain * 0.6 + pose.bias;
        assert!((middle / 0.6 - 0.79).abs() < 0.04, "{middle} {pose:?}");
        assert!(error < 0.1, "{error}");
    }
}

#[test]
fn an_object_before_the_plane_does_not_matter() {
    let film = Film {
        hidden: Some((dvec2(180.0, 200.0), 70.0)),
        ..OTHER_CAMERA
    };
    let (pose, error) = judge((640, 480), [20.0, 0.5, 0.4, 1.0], film);
    assert!(error < 0.1, "{error}");
    assert!(pose.visible < 0.9, "{}", pose.visible);
}

#[test]
fn photos_from_near_and_from_far_are_laid_within_three_tenths_of_a_pixel() {
    for (size, view) in [
        ((1400, 1050), [20.0, 0.3, 0.5, 3.0]),
        ((1400, 1050), [10.0, 0.3, -1.5, 4.0]),
        ((480, 360), [20.0, 1.3, 0.5, 1.0 / 3.0]),
        ((480, 360), [10.0, 2.3, 2.0, 0.25]),
    ] {
        let (_, error) = judge(size, view, OTHER_CAMERA);
        assert!(error < 0.3, "{view:?}: {error}");
    }
}

#[test]
fn steep_views_are_laid_within_three_tenths_of_a_pixel() {
    for (size, view) in [
        ((640, 480), [60.0, 0.2, 0.3, 1.0]),
        ((640, 480), [60.0, 1.5, 0.0, 1.4]),
        ((900, 700), [68.0, 0.9, -0.3, 1.6]),
    ] {
        let (_, error) = judge(size, view, OTHER_CAMERA);
        assert!(error < 0.3, "{view:?}: {error}");
    }
}

#[test]
fn the_whole_frame_serves_without_a_quadrilateral() {
    let size = frame_size();
    let truth = photo_from_frame(size, 15.0, 0.4, 0.2, 0.8);
    // nothing moves otherwise here
    let photo = shot(size, &truth.inverse(), PLAIN, DVec2::ZERO, Seed(12));
    let (params, progress) = (PhotoParams::default(), Progress::none());
    let pose = locate_photo(&photo, &frame(), None, &params, &progress).unwrap();
    assert!(error(&pose, &truth) < 0.1, "{}", error(&pose, &truth));
}

#[test]
fn photos_of_something_else_are_refused() {
    let size = Size::new(640, 480).unwrap();
    let elsewhere = Homography::from_translation(dvec2(9000.0, 7000.0)).unwrap();
    let other = shot(size, &elsewhere, PLAIN, DVec2::ZERO, Seed(13));
    let plain = AnyImage::Srgb8(Image::new(size, Srgb([90, 90, 90])));
    let tiny = AnyImage::Srgb8(Image::new(Size::new(1, 1).unwrap(), Srgb([9, 9, 9])));
    let nothing = AnyImage::Linear(Image::new(size, LinearRgb([f32::NAN; 3])));
    for photo in [other, plain, tiny, nothing] {
        let found = locate(&photo);
        assert!(
            matches!(
                found,
                Err(PhotoError::NoMatch(_) | PhotoError::Unlike { .. })
            ),
            "{found:?}"
        );
    }
}

/// Something else fills the quadrilateral, but the surroundings are those of the frame: their features must not count.
#[test]
fn the_surroundings_of_the_plane_do_not_count() {
    let size = frame_size();
    let mut photo = Image::new(size, Srgb([128u8; 3]));
    let (AnyImage::Srgb8(around), AnyImage::Srgb8(inside)) = (
        frame(),
        shot(
            size,
            &Homography::from_translation(dvec2(9000.0, 100.0)).unwrap(),
            PLAIN,
            DVec2::ZERO,
            Seed(5),
        ),
    ) else {
        unreachable!("shots have 8 bits")
    };
    for row in 0..HEIGHT {
        for col in 0..WIDTH {
            let on_plane = is_on_plane(dvec2(col as f64 + 0.5, row as f64 + 0.5));
            photo.row_mut(row)[col] = if on_plane {
                inside[(col, row)]
            } else {
                around[(col, row)]
            };
        }
    }
    let found = locate(&AnyImage::Srgb8(photo));
    assert!(
        matches!(
            found,
            Err(PhotoError::NoMatch(_) | PhotoError::Unlike { .. })
        ),
        "{found:?}"
    );
}

#[test]
fn bad_quadrilaterals_and_cancellation_have_their_errors() {
    let (params, frame) = (PhotoParams::default(), frame());
    let with = |quad: [DVec2; 4], progress: &Progress| {
        locate_photo(&frame, &frame, Some(quad), &params, progress)
    };
    let progress = Progress::none();
    assert!(matches!(
        with([DVec2::ONE; 4], &progress),
        Err(PhotoError::Quad(_))
    ));
    let beyond = QUAD.map(|p| p + 1000.0);
    assert!(matches!(
        with(beyond, &progress),
        Err(PhotoError::Outside { .. })
    ));
    for check in (1..200).step_by(7) {
        let found = with(QUAD, &Progress::cancelled_at(check));
        assert!(
            matches!(found, Err(PhotoError::Cancelled) | Ok(_)),
            "{found:?}"
        );
        if check < 20 {
            assert_eq!(found, Err(PhotoError::Cancelled));
        }
    }
}

#[test]
fn one_thread_and_many_give_the_same_bytes() {
    let size = Size::new(300, 220).unwrap();
    let truth = photo_from_frame(size, 15.0, 0.4, 0.2, 0.7);
    let photo = shot(size, &truth.inverse(), PLAIN, DVec2::ZERO, Seed(12));
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| locate(&photo))
    };
    assert_eq!(on(1), on(3));
}

//! Every camera stays on its plane, and lines are seen where truth says.

use super::*;
use crate::clip::project;
use crate::clip::world::Line;
use glam::Vec3;
use ravec_raster::{Image, LinearRgb};

#[test]
fn no_camera_sees_beyond_its_plane() {
    for (width, height) in [(160, 90), (96, 96)] {
        let size = Size::new(width, height).unwrap();
        for id in ClipId::ALL {
            let clip = clip(id, size, 30, Seed(2));
            for index in 0..clip.frames() {
                let world_from_frame = clip.frame_from_world(index).inverse();
                let extent = clip.shot(index).1.world.extent;
                for (x, y) in [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)] {
                    let corner = DVec2::new(x * width as f64, y * height as f64);
                    let seen = project(&world_from_frame, corner).unwrap();
                    // half a pixel: rounding at the border of pictures that the frame fills
                    assert!(
                        seen.cmpge(DVec2::splat(-0.5)).all() && seen.cmple(extent + 0.5).all(),
                        "{id:?} frame {index}: {seen} of {extent}"
                    );
                }
            }
        }
    }
}

/// The centroid of a bright line on black across its axis, near a place on it, relative to the place.
fn centroid(image: &Image<LinearRgb>, middle: DVec2, axis: DVec2, reach: f64) -> f64 {
    let (mut weight, mut moment) = (0.0, 0.0);
    for (i, pixel) in image.pixels().iter().enumerate() {
        let p = crate::paint::center(i % image.width(), i / image.width()) - middle;
        let (t, across) = (p.dot(axis) / 6.0, p.dot(axis.perp()));
        if t.abs() < 1.0 && across.abs() < reach {
            // a smooth window along the line, so that pixels enter and leave it gradually
            let window = (0.5 + 0.5 * (PI * t).cos()) * f64::from(pixel.0[0]);
            weight += window;
            moment += window * across;
        }
    }
    moment / weight
}

#[test]
fn a_line_alone_is_seen_within_two_hundredths_of_a_pixel_of_its_truth() {
    let size = Size::new(240, 135).unwrap();
    let extent = DVec2::new(240.0, 135.0);
    for id in ClipId::ALL {
        let clip = clip(id, size, 21, Seed(3));
        let mut measured = 0;
        for index in (0..21).step_by(5) {
            let shot = clip.shot(index).1;
            let m = clip.frame_from_world(index);
            // two lines through the middle of the view, on a plane of their own
            let seen = project(&m.inverse(), 0.5 * extent).unwrap();
            for direction in [DVec2::new(1.0, 0.13), DVec2::new(-0.2, 1.0)] {
                let line = Line {
                    name: "line".to_owned(),
                    from: seen - 90.0 * direction,
                    to: seen + 90.0 * direction,
                    width_px: 3.0,
                };
                let plane = World::paint(shot.world.extent, DENSITY, |_, _| Vec3::ZERO)
                    .with_line(line, Vec3::ONE);
                let truth = plane.features.in_frame(&m);
                let image = plane.render(&m, size);
                let Line {
                    from, to, width_px, ..
                } = truth.lines[0].clone();
                let axis = (to - from).normalize();
                let reach = 0.5 * width_px + 3.0;
                for along in [-20.0, 0.0, 20.0] {
                    let middle = from + axis * ((0.5 * extent - from).dot(axis) + along);
                    let error = centroid(&image, middle, axis, reach);
                    // two samples a pixel and side: a step of half a pixel across a slanted border
                    assert!(error.abs() < 0.02, "{id:?} {index} {direction}: {error}");
                    measured += 1;
                }
            }
        }
        assert_eq!(measured, 30);
    }
}

#[test]
fn names_are_unique_and_lead_back() {
    for id in ClipId::ALL {
        assert_eq!(ClipId::from_name(id.name()), Some(id));
        assert_eq!(serde_json::to_value(id).unwrap(), id.name());
        assert!(!id.description().is_empty() && id.default_frames() > 0);
        assert!(crate::catalog::SceneId::from_name(id.name()).is_none());
    }
    assert_eq!(ClipId::from_name("nothing"), None);
}

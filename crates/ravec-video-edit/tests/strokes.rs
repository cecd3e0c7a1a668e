//! Strokes carried through drawn shots whose motion is known.

use glam::{DMat3, DVec2};
use ravec_planar::Homography;
use ravec_raster::{Mask, Size};
use ravec_video_edit::{CarriedStroke, Colors};

fn size() -> Size {
    Size::new(160, 100).unwrap()
}

/// A wavy wall that is moved by `wall`, and a disc with spots of its own at `disc`, of the colors of the wall.
fn frame(wall: DVec2, disc: DVec2) -> Colors {
    Colors::from_fn(size(), |col, row| {
        let at = DVec2::new(col as f64 + 0.5, row as f64 + 0.5);
        let wave =
            |at: DVec2, scale: f64| ((scale * at.x).sin() + (1.3 * scale * at.y).cos()) as f32;
        if at.distance(disc) < DISC_PX {
            let spot = wave(at - disc, 0.9);
            [0.55 + 0.1 * spot, 0.3 + 0.1 * spot, 0.2]
        } else {
            let shade = wave(at - wall, 0.31);
            [0.4 + 0.05 * shade, 0.5 + 0.05 * shade, 0.6]
        }
    })
}

const DISC_PX: f64 = 18.0;

fn disc_mask(center: DVec2, radius_px: f64) -> Mask {
    Mask::from_fn(size(), |col, row| {
        DVec2::new(col as f64 + 0.5, row as f64 + 0.5).distance(center) < radius_px
    })
}

fn cells(mask: &Mask) -> Vec<(usize, usize)> {
    let cells = (0..100).flat_map(|row| (0..160).map(move |col| (col, row)));
    cells
        .filter(|&(col, row)| mask.at(col, row) > 0.0)
        .collect()
}

fn marked(stroke: &CarriedStroke, number: u64, colors: &Colors, map: &Homography) -> Mask {
    let cells = stroke.marked(number, colors, map);
    Mask::from_fn(size(), |col, row| cells.contains(&(col, row)))
}

#[test]
fn a_foreground_stroke_stays_on_its_object() {
    let start = DVec2::new(50.0, 40.0);
    // fast, not even, and half a pixel off the grid
    let place = |number: u64| {
        let t = number as f64;
        start + DVec2::new(5.5 * t - 0.1 * t * t, 2.0 * (0.8 * t).sin())
    };
    let first = frame(DVec2::ZERO, start);
    // the stroke paints over the border of the disc
    let mask = disc_mask(start, DISC_PX + 3.0);
    let mut stroke =
        CarriedStroke::new(3, cells(&mask), true, &first, &Homography::IDENTITY).unwrap();
    let mut follower = stroke.follow(&first);
    for number in 1..=12 {
        let now = frame(DVec2::ZERO, place(number));
        assert!(
            follower.push(&mut stroke, 3 + number, &now),
            "frame {number}"
        );
        let found = marked(&stroke, 3 + number, &now, &Homography::IDENTITY);
        let core = disc_mask(place(number), DISC_PX - 4.0);
        let missed = core.subtract(&found).unwrap().area_px() / core.area_px();
        assert!(
            missed < 0.05,
            "frame {number}: {missed} of the disc is not marked"
        );
    }
    let exact = marked(&stroke, 3, &first, &Homography::IDENTITY);
    assert_eq!(exact.coverage(), mask.coverage());
}

#[test]
fn a_stroke_ends_where_its_colors_end() {
    let center = DVec2::new(80.0, 50.0);
    let first = frame(DVec2::ZERO, center);
    let inside = disc_mask(center, DISC_PX - 3.0);
    let mut stroke =
        CarriedStroke::new(0, cells(&inside), true, &first, &Homography::IDENTITY).unwrap();
    // the disc turns into wall but for its left part
    let mut next = frame(DVec2::ZERO, DVec2::splat(-100.0));
    for row in 0..100 {
        for col in 0..80 {
            next[(col, row)] = first[(col, row)];
        }
    }
    assert!(stroke.follow(&first).push(&mut stroke, 1, &next));
    let found = marked(&stroke, 1, &next, &Homography::IDENTITY);
    let right = found.bounding_box().unwrap().right();
    assert!((78..=80).contains(&right), "{right}");
}

#[test]
fn an_object_that_is_gone_is_lost() {
    let center = DVec2::new(80.0, 50.0);
    let first = frame(DVec2::ZERO, center);
    let mask = disc_mask(center, 10.0);
    let mut stroke =
        CarriedStroke::new(0, cells(&mask), true, &first, &Homography::IDENTITY).unwrap();
    let mut follower = stroke.follow(&first);
    let empty = frame(DVec2::ZERO, DVec2::splat(-100.0));
    assert!(!follower.push(&mut stroke, 1, &empty));
    // it does not come back by itself
    assert!(!follower.push(&mut stroke, 2, &first));
    let found = marked(&stroke, 1, &empty, &Homography::IDENTITY);
    assert!(found.is_empty());
    assert!(CarriedStroke::new(0, Vec::new(), true, &first, &Homography::IDENTITY).is_none());
}

#[test]
fn a_background_stroke_moves_with_the_plane() {
    let far = DVec2::splat(-100.0);
    let first = frame(DVec2::ZERO, far);
    let mask = disc_mask(DVec2::new(40.0, 50.0), 12.0);
    let stroke = CarriedStroke::new(0, cells(&mask), false, &first, &Homography::IDENTITY).unwrap();
    let shift = DVec2::new(30.0, -7.0);
    let map = Homography::from_translation(shift).unwrap();
    // something stands on a part of the place
    let moved = frame(shift, DVec2::new(80.0, 43.0));
    let found = marked(&stroke, 9, &moved, &map);
    let expected = disc_mask(DVec2::new(70.0, 43.0), 12.0)
        .subtract(&disc_mask(DVec2::new(80.0, 43.0), DISC_PX))
        .unwrap();
    assert_eq!(found.coverage(), expected.coverage());
    // out of the frame, and behind the horizon, there is nothing, and nothing breaks
    let away = Homography::from_translation(DVec2::new(5000.0, 0.0)).unwrap();
    let tilted = Homography::from_matrix(DMat3::from_cols_array(&[
        1.0, 0.0, -0.02, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0,
    ]));
    for map in [away, tilted.unwrap()] {
        marked(&stroke, 9, &moved, &map);
    }
}

#[test]
fn a_large_stroke_stays_on_its_object() {
    // the same scene, four times as large as the test above
    let large = Size::new(640, 400).unwrap();
    let scaled = |frame: &Colors| Colors::from_fn(large, |col, row| frame[(col / 4, row / 4)]);
    let start = DVec2::new(50.0, 40.0);
    let place = |number: u64| start + DVec2::new(4.0 * number as f64, number as f64);
    let first = scaled(&frame(DVec2::ZERO, start));
    let inside = |center: DVec2, radius_px: f64, (col, row): (usize, usize)| {
        DVec2::new(col as f64 + 0.5, row as f64 + 0.5).distance(4.0 * center) < 4.0 * radius_px
    };
    let all = || (0..400).flat_map(|row| (0..640).map(move |col| (col, row)));
    let cells = all().filter(|cell| inside(start, DISC_PX + 1.0, *cell));
    let map = Homography::IDENTITY;
    let mut stroke = CarriedStroke::new(0, cells.collect(), true, &first, &map).unwrap();
    let mut follower = stroke.follow(&first);
    for number in 1..=8 {
        let now = scaled(&frame(DVec2::ZERO, place(number)));
        assert!(follower.push(&mut stroke, number, &now), "frame {number}");
        let found: std::collections::HashSet<_> =
            stroke.marked(number, &now, &map).into_iter().collect();
        let core: Vec<_> = all()
            .filter(|cell| inside(place(number), DISC_PX - 4.0, *cell))
            .collect();
        let missed = core.iter().filter(|cell| !found.contains(cell)).count();
        assert!(
            missed * 20 < core.len(),
            "frame {number}: {missed} of {}",
            core.len()
        );
    }
}

//! Paneled walls whose grid is an input, and grids that start beside it.

use glam::{DVec2, dvec2};
use ravec_planar::{
    Homography, QuadGrid, SnapError, SnapParams, encoded_luminance, snap, snap_counting,
};
use ravec_progress::Progress;
use ravec_raster::{Plane, Pyramid, Reduction, Size, Srgb};
use ravec_scenes::Seed;
use ravec_scenes::building::building;
use ravec_scenes::texture::fractal;

const WIDTH: usize = 560;
const HEIGHT: usize = 440;

/// A wall of panels in different grays before an even ground, with noise of 4 of 255 steps; where `hidden` says so, there
/// is something else.
fn wall(truth: &QuadGrid, seed: Seed, hidden: impl Fn(DVec2) -> bool) -> Plane {
    let grid_from_image = truth.image_from_grid().inverse();
    let extent = dvec2(f64::from(truth.columns()), f64::from(truth.rows()));
    let tone = |p: DVec2| {
        let q = grid_from_image.apply(p);
        if hidden(p) {
            0.5
        } else if q.cmpgt(DVec2::ZERO).all() && q.cmplt(extent).all() {
            // neighbors differ by at least a tenth
            let light = (q.x as i64 + q.y as i64) % 2;
            0.25 + 0.3 * light as f64 + 0.2 * seed.unit(q.x as i64, q.y as i64, 1)
        } else {
            0.12
        }
    };
    Plane::from_fn(Size::new(WIDTH, HEIGHT).unwrap(), |col, row| {
        let sum: f64 = [(0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75)]
            .iter()
            .map(|&(x, y)| tone(dvec2(col as f64 + x, row as f64 + y)))
            .sum();
        (sum / 4.0 + seed.gaussian(col as i64, row as i64, 2) * 4.0 / 255.0) as f32
    })
}

/// A quad that differs from seed to seed, and one with each corner 3 % of the diagonal beside it.
fn quads(seed: Seed, columns: u32, rows: u32) -> (QuadGrid, QuadGrid) {
    let middle = [
        dvec2(90.0, 70.0),
        dvec2(470.0, 90.0),
        dvec2(460.0, 350.0),
        dvec2(100.0, 370.0),
    ];
    let jitter = |k: i64, channel| seed.between(k, 0, channel, -30.0, 30.0);
    let truth: [DVec2; 4] =
        std::array::from_fn(|k| middle[k] + dvec2(jitter(k as i64, 3), jitter(k as i64, 4)));
    let truth = QuadGrid::new(truth, columns, rows).unwrap();
    let off = 0.03 * truth.diagonal_px();
    let angle = |k: usize| seed.between(k as i64, 1, 5, 0.0, std::f64::consts::TAU);
    let corners = truth.corners();
    let rough = std::array::from_fn(|k| corners[k] + DVec2::from_angle(angle(k)) * off);
    (truth, QuadGrid::new(rough, columns, rows).unwrap())
}

fn levels(picture: &Plane) -> Pyramid<f32> {
    Pyramid::new(picture.clone(), Reduction::Area)
}

fn rms(found: &QuadGrid, truth: &QuadGrid) -> f64 {
    let corners = found.corners().into_iter().zip(truth.corners());
    (corners.map(|(a, b)| a.distance_squared(b)).sum::<f64>() / 4.0).sqrt()
}

#[test]
fn a_grid_three_per_cent_off_snaps_to_a_tenth_of_a_pixel() {
    for k in 0..12 {
        let (truth, rough) = quads(Seed(k), 3 + k as u32 % 4, 3 + k as u32 % 3);
        let picture = wall(&truth, Seed(k), |_| false);
        let found = snap(
            &levels(&picture),
            &rough,
            &SnapParams::default(),
            &Progress::none(),
        )
        .unwrap();
        assert!(
            rms(&found.grid, &truth) < 0.1,
            "{k}: {}",
            rms(&found.grid, &truth)
        );
        assert!(found.support > 0.9);
    }
}

#[test]
fn what_hides_a_third_of_the_wall_costs_little() {
    for k in 0..8 {
        let (truth, rough) = quads(Seed(100 + k), 5, 4);
        let center = truth.image_from_grid().apply(dvec2(2.0, 2.2));
        let picture = wall(&truth, Seed(k), |p| {
            p.distance(center) < 95.0 || (p.x - 380.0).abs() < 12.0
        });
        let found = snap(
            &levels(&picture),
            &rough,
            &SnapParams::default(),
            &Progress::none(),
        )
        .unwrap();
        assert!(
            rms(&found.grid, &truth) < 0.5,
            "{k}: {}",
            rms(&found.grid, &truth)
        );
    }
}

/// A wall of tiles that goes on beyond the grid, all much the same, with joints a fortieth to a twentieth of a tile wide
/// and at most a tenth brighter or darker than the tiles.
fn tiles(truth: &QuadGrid, seed: Seed, hidden: impl Fn(DVec2) -> bool) -> Plane {
    let grid_from_image = truth.image_from_grid().inverse();
    let width = seed.between(1, 0, 8, 0.025, 0.05);
    let tone = seed.between(2, 0, 8, 0.07, 0.1)
        * if seed.bits(3, 0, 8).is_multiple_of(2) {
            1.0
        } else {
            -1.0
        };
    let at = |p: DVec2| {
        if hidden(p) {
            return 0.3 + 0.2 * fractal(p / 20.0, 0.1, 3, seed.fork(2));
        }
        let q = grid_from_image.apply(p);
        let off = (q - q.round()).abs().min_element();
        let glaze = 0.04 * seed.unit(q.x.floor() as i64, q.y.floor() as i64, 1);
        0.5 + glaze + if off < 0.5 * width { tone } else { 0.0 }
    };
    Plane::from_fn(Size::new(WIDTH, HEIGHT).unwrap(), |col, row| {
        let sum: f64 = (0..16)
            .map(|k| {
                at(dvec2(col as f64, row as f64)
                    + (dvec2(f64::from(k % 4), f64::from(k / 4)) + 0.5) / 4.0)
            })
            .sum();
        (sum / 16.0 + seed.gaussian(col as i64, row as i64, 2) * 4.0 / 255.0) as f32
    })
}

#[test]
fn a_grid_comes_to_lie_in_the_middle_of_weak_joints() {
    for k in 0..12 {
        let (truth, rough) = quads(Seed(300 + k), 3 + k as u32 % 4, 3 + k as u32 % 3);
        let center = truth.image_from_grid().apply(dvec2(1.3, 1.6));
        let picture = tiles(&truth, Seed(k), |p| k % 2 == 1 && p.distance(center) < 80.0);
        let found = snap(
            &levels(&picture),
            &rough,
            &SnapParams::default(),
            &Progress::none(),
        )
        .unwrap();
        // joints of 2 to 5 pixels with a noise of a sixth of their height
        assert!(
            rms(&found.grid, &truth) < 0.35,
            "{k}: {}",
            rms(&found.grid, &truth)
        );
    }
}

/// Panels of some thirty pixels with joints of one to two, and a bright round window in each.
fn round_windows(truth: &QuadGrid, seed: Seed) -> Plane {
    let grid_from_image = truth.image_from_grid().inverse();
    let at = |p: DVec2| {
        let q = grid_from_image.apply(p);
        let from_window = q - q.floor() - 0.5;
        if from_window.length() < 0.3 {
            if from_window.x < 0.1 { 0.95 } else { 0.1 }
        } else if (q - q.round()).abs().min_element() < 0.025 {
            0.3
        } else {
            0.5 + 0.05 * fractal(p / 20.0, 0.1, 3, seed)
        }
    };
    Plane::from_fn(Size::new(WIDTH, HEIGHT).unwrap(), |col, row| {
        let offsets = [(0.25, 0.25), (0.75, 0.25), (0.25, 0.75), (0.75, 0.75)];
        let sum: f64 = offsets
            .iter()
            .map(|&(x, y)| at(dvec2(col as f64 + x, row as f64 + y)))
            .sum();
        (sum / 4.0 + seed.gaussian(col as i64, row as i64, 2) * 2.0 / 255.0) as f32
    })
}

/// Outlines of windows are far stronger than joints, but lie along them only in parts.
#[test]
fn thin_joints_are_preferred_to_the_outlines_of_windows() {
    let snaps = |k: u64| {
        let seed = Seed(700 + k);
        let jitter = |k: usize, channel| seed.between(k as i64, 0, channel, -12.0, 12.0);
        let middle = [
            dvec2(200.0, 160.0),
            dvec2(335.0, 190.0),
            dvec2(330.0, 300.0),
            dvec2(205.0, 280.0),
        ];
        let truth = std::array::from_fn(|k| middle[k] + dvec2(jitter(k, 3), jitter(k, 4)));
        let truth = QuadGrid::new(truth, 4, 3).unwrap();
        let off = 0.03 * truth.diagonal_px();
        let angle = |k: usize| seed.between(k as i64, 1, 5, 0.0, std::f64::consts::TAU);
        let corners = truth.corners();
        let rough = std::array::from_fn(|k| corners[k] + DVec2::from_angle(angle(k)) * off);
        let rough = QuadGrid::new(rough, 4, 3).unwrap();
        let picture = round_windows(&truth, seed);
        let found = snap(
            &levels(&picture),
            &rough,
            &SnapParams::default(),
            &Progress::none(),
        )
        .unwrap();
        rms(&found.grid, &truth) < 0.5
    };
    // outlines of a row of windows may lie on one line by chance
    let right = (0..24).filter(|&k| snaps(k)).count();
    assert!(right >= 18, "{right}");
}

#[test]
fn columns_and_rows_are_counted() {
    for (k, columns, rows) in [(1, 4, 3), (2, 6, 5)] {
        let (truth, rough) = quads(Seed(200 + k), columns, rows);
        let picture = wall(&truth, Seed(k), |_| false);
        let start = rough.divided(1, 1).unwrap();
        let params = SnapParams::default();
        let found = snap_counting(
            &levels(&picture),
            &start,
            2..=8,
            2..=8,
            &params,
            &Progress::none(),
        )
        .unwrap();
        assert_eq!((found.grid.columns(), found.grid.rows()), (columns, rows));
        assert!(rms(&found.grid, &truth) < 0.2);
    }
}

#[test]
fn bad_input_is_refused() {
    let (truth, rough) = quads(Seed(1), 4, 4);
    let params = SnapParams::default();
    let progress = Progress::none();
    let size = Size::new(WIDTH, HEIGHT).unwrap();
    for value in [0.5, f32::NAN] {
        let found = snap(
            &levels(&Plane::new(size, value)),
            &rough,
            &params,
            &progress,
        );
        assert_eq!(found, Err(SnapError::NoEdges));
    }
    let far = QuadGrid::new(rough.corners().map(|c| c + 5000.0), 4, 4).unwrap();
    let picture = wall(&truth, Seed(1), |_| false);
    assert_eq!(
        snap(&levels(&picture), &far, &params, &progress),
        Err(SnapError::Outside)
    );
    let empty = std::ops::RangeInclusive::new(3, 2);
    let none = snap_counting(&levels(&picture), &rough, empty, 3..=4, &params, &progress);
    assert_eq!(none, Err(SnapError::NoEdges));
    progress.cancel();
    assert_eq!(
        snap(&levels(&picture), &rough, &params, &progress),
        Err(SnapError::Cancelled)
    );
}

#[test]
fn one_thread_and_many_give_the_same_bytes() {
    let (truth, rough) = quads(Seed(5), 4, 5);
    let picture = wall(&truth, Seed(5), |_| false);
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| {
            snap(
                &levels(&picture),
                &rough,
                &SnapParams::default(),
                &Progress::none(),
            )
        })
    };
    assert_eq!(on(1), on(3));
}

/// A building, the grid of the windows of its right wall, and the same with each corner 2 % of the diagonal beside it.
fn windows(size: Size, seed: Seed) -> (Pyramid<f32>, QuadGrid, QuadGrid) {
    let (image, truth) = building(size, 0.81, seed);
    let picture = encoded_luminance(&image.convert::<Srgb<u8>>());
    let image_from_wall = Homography::from_unit_square(truth.walls_in_image[0]).unwrap();
    // bays and floors; panes begin at 0.29 of a bay, frames of 0.025 of a floor end at 0.305
    let place = |bay: f64, floor: f64| {
        image_from_wall.apply(dvec2((bay + 0.29) / 5.0, (floor + 0.295) / 4.0))
    };
    let corners = [
        place(1.0, 3.0),
        place(4.0, 3.0),
        place(4.0, 1.0),
        place(1.0, 1.0),
    ];
    let truth = QuadGrid::new(corners, 3, 2).unwrap();
    let rough = std::array::from_fn(|corner| {
        let angle = seed.between(corner as i64, 2, 5, 0.0, std::f64::consts::TAU);
        corners[corner] + DVec2::from_angle(angle) * 0.02 * truth.diagonal_px()
    });
    let rough = QuadGrid::new(rough, 3, 2).unwrap();
    (levels(&picture), truth, rough)
}

/// The dark panes between the frame and the bar of a window are stripes with two edges, too, but wider than joints.
#[test]
fn panes_between_frames_and_bars_are_no_joints() {
    let mut off = Vec::new();
    for k in 0..12 {
        let (picture, truth, rough) = windows(Size::new(960, 720).unwrap(), Seed(k));
        let found = snap(&picture, &rough, &SnapParams::default(), &Progress::none()).unwrap();
        off.push(rms(&found.grid, &truth));
    }
    off.sort_by(f64::total_cmp);
    // frames are two pixels wide, the middle of a pane is five pixels away; from some places bars fit as well
    assert!(off[7] < 1.0, "{off:?}");
}

/// The search in reduced pictures against that in the picture itself, which reads all places within the reach.
#[test]
fn reduced_pictures_lead_to_the_same_edges() {
    let params = SnapParams { reach_rel: 0.06 };
    for k in 0..4 {
        let (picture, _, rough) = windows(Size::new(2400, 1800).unwrap(), Seed(k));
        let found =
            |picture: &Pyramid<f32>| snap(picture, &rough, &params, &Progress::none()).unwrap();
        let plain = Pyramid::with_levels(picture.level(0).clone(), Reduction::Area, 1);
        let apart = rms(&found(&picture).grid, &found(&plain).grid);
        assert!(apart < 0.05, "{k}: {apart}");
    }
}

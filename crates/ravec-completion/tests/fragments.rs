//! Fragments held against planted truth, and against their promises.

use glam::{DVec2, dvec2};
use ravec_completion::{
    CompleteError, FillOptions, FragmentIndex, Match, Retouch, SearchOptions, Shape, Sources, Step,
    Target, Variant,
};
use ravec_planar::Homography;
use ravec_progress::Progress;
use ravec_raster::{Color, Image, Mask, Rect, Size, Srgb, Srgba};
use ravec_scenes::Seed;
use ravec_scenes::occlusion::{Surface, occluded};

const NONE: Variant = Variant {
    turn_rad: 0.0,
    mirrored: false,
    scale: 1.0,
};

/// Smooth noise: no two places are alike, and resampling keeps it.
fn clouds(x: f64, y: f64, seed: f64) -> [u8; 3] {
    let wave =
        |a: f64, b: f64, c: f64| ((x * a + y * b) + 3.0 * (x * c - y * a + seed).sin()).sin();
    [0.11, 0.17, 0.23].map(|f| {
        let v = wave(f, 0.31 * f, 0.7 * f) + wave(-0.4 * f, 0.9 * f, 0.3 * f) + wave(0.13, f, 0.05);
        (128.0 + 38.0 * v) as u8
    })
}

fn picture(size: Size, at: impl Fn(DVec2) -> [u8; 3]) -> Image<Srgb<u8>> {
    Image::from_fn(size, |col, row| {
        Srgb(at(dvec2(col as f64 + 0.5, row as f64 + 0.5)))
    })
}

fn index<P: Color>(sources: &Sources<P>) -> FragmentIndex {
    FragmentIndex::new(sources, &Progress::none()).unwrap()
}

fn best(index: &FragmentIndex, target: &Target, full: bool) -> Vec<Match> {
    let options = SearchOptions {
        full,
        ..SearchOptions::default()
    };
    Retouch::new(index)
        .best(target, &options, &Progress::none())
        .unwrap()
}

/// A picture around whose hole, at (200, 150), lies what also lies around `from`, seen through `variant`.
fn planted(from: DVec2, variant: Variant) -> (Image<Srgb<u8>>, Mask) {
    let size = Size::new(400, 300).unwrap();
    let to = dvec2(200.5, 150.5);
    let (sin, cos) = variant.turn_rad.sin_cos();
    let image = picture(size, |at| {
        let d = at - to;
        if d.length() > 40.0 {
            return clouds(at.x, at.y, 1.0);
        }
        // back by the turn, then mirrored, then smaller
        let back = dvec2(cos * d.x + sin * d.y, cos * d.y - sin * d.x) / variant.scale;
        let x = if variant.mirrored { -back.x } else { back.x };
        clouds(from.x + x, from.y + back.y, 1.0)
    });
    (image, Mask::from_disc(size, to, 9.0).unwrap())
}

#[test]
fn a_planted_copy_is_the_first_match_with_and_without_the_full_search() {
    let from = dvec2(90.5, 210.5);
    let (image, hole) = planted(from, NONE);
    let index = index(&Sources::new(&image, &hole));
    for shape in [Shape::Circle, Shape::Square] {
        let target = Target {
            shape,
            ..Target::new(dvec2(206.0, 155.0), 20)
        };
        for full in [false, true] {
            let found = best(&index, &target, full);
            let wanted = from + target.at.floor() + 0.5 - dvec2(200.5, 150.5);
            assert_eq!(found[0].source.at, wanted, "{shape:?} {full}");
            assert_eq!(found[0].mismatch, 0.0);
        }
    }
}

#[test]
fn copies_that_are_turned_mirrored_or_scaled_are_found_as_such() {
    let from = dvec2(100.5, 190.5);
    let quarter = Variant {
        turn_rad: 0.5,
        ..NONE
    };
    let mirrored = Variant {
        mirrored: true,
        ..NONE
    };
    let scaled = Variant {
        scale: 1.25,
        ..NONE
    };
    for variant in [quarter, mirrored, scaled] {
        let (image, hole) = planted(from, variant);
        let variants = [quarter, mirrored, scaled];
        let sources = Sources {
            variants: &variants,
            ..Sources::new(&image, &hole)
        };
        let index = index(&sources);
        assert_eq!(index.buffers(), 4);
        let target = Target::new(dvec2(200.5, 150.5), 22);
        let found = best(&index, &target, false);
        assert_eq!(found[0].source.transform, variant);
        // a fraction of a pixel is found from three values only
        assert!(
            found[0].source.at.distance(from) < 0.3,
            "{variant:?} {:?}",
            found[0]
        );
        let mut retouch = Retouch::new(&index);
        retouch
            .apply(&retouch.step(&target, &found[0]), &Progress::none())
            .unwrap();
        assert_eq!(retouch.open_px(), 0);
    }
}

#[test]
fn a_copy_in_another_photo_is_found_there_whatever_its_size() {
    let size = Size::new(200, 160).unwrap();
    let image = picture(size, |at| clouds(at.x, at.y, 1.0));
    let hole = Mask::from_rect(size, Rect::new(90, 70, 14, 14));
    let other = picture(Size::new(90, 140).unwrap(), |at| {
        clouds(at.x + 50.0, at.y + 20.0, 1.0)
    });
    let photos = [other];
    let sources = Sources {
        photos: &photos,
        ..Sources::new(&image, &hole)
    };
    let index = index(&sources);
    let found = best(&index, &Target::new(dvec2(97.5, 77.5), 18), false);
    assert_eq!(
        (found[0].source.photo, found[0].source.at),
        (1, dvec2(47.5, 57.5))
    );
    assert_eq!(found[0].mismatch, 0.0);
}

#[test]
fn along_a_plane_a_copy_comes_from_where_the_pattern_repeats() {
    // panels of one by one on a plane, each with the same marks
    let size = Size::new(320, 240).unwrap();
    let quad = [
        dvec2(10.0, 10.0),
        dvec2(300.0, 50.0),
        dvec2(300.0, 190.0),
        dvec2(10.0, 230.0),
    ];
    let image_from_wall = Homography::from_unit_square(quad).unwrap();
    let wall_from_image = image_from_wall.inverse();
    let panels = |at: DVec2| {
        let cell = (8.0 * wall_from_image.apply(at)).map(|v| v.rem_euclid(1.0));
        clouds(60.0 * cell.x, 60.0 * cell.y, 2.0)
    };
    let image = picture(size, panels);
    let hole = Mask::from_rect(size, Rect::new(140, 100, 16, 16));
    let sources = Sources {
        planes: &[quad],
        ..Sources::new(&image, &hole)
    };
    let index = index(&sources);
    let target = Target {
        plane: Some(0),
        ..Target::new(dvec2(148.0, 108.0), 26)
    };
    let found = best(&index, &target, false);
    let on_wall = |at: DVec2| 8.0 * wall_from_image.apply(at);
    let shift = on_wall(found[0].source.at) - on_wall(target.at);
    assert_eq!(found[0].source.plane, Some(0));
    // a panel is about 25 pixels wide there
    assert!(
        (shift - shift.round()).length() < 0.02 && shift.length() > 0.9,
        "{shift}"
    );
    let mut retouch = Retouch::new(&index);
    retouch
        .apply(&retouch.step(&target, &found[0]), &Progress::none())
        .unwrap();
    assert_eq!(retouch.open_px(), 0);
    let filled = retouch.picture(&image);
    let off = (0..size.pixels()).map(|k| {
        let at = (k % 320, k / 320);
        f64::from(filled[at].0[0].abs_diff(image[at].0[0])).powi(2)
    });
    // sampled once from a place of about the same size: a few steps
    assert!((off.sum::<f64>() / hole.area_px()).sqrt() < 6.0);
}

#[test]
fn features_decide_where_colors_cannot() {
    // plain but for marked pixels: a line runs into the hole, and another one is known far away
    let size = Size::new(160, 120).unwrap();
    let image = Image::new(size, Srgb([90u8, 120, 60]));
    let hole = Mask::from_rect(size, Rect::new(30, 30, 12, 12));
    let line = Mask::from_fn(size, |col, row| {
        row.abs_diff(36) < 2 && (20..50).contains(&col) || row.abs_diff(88) < 2 && col > 80
    });
    let sources = Sources {
        features: Some(&line),
        ..Sources::new(&image, &hole)
    };
    let index = index(&sources);
    let found = best(&index, &Target::new(dvec2(36.5, 36.5), 12), false);
    assert_eq!(found[0].source.at.y, 88.5);
    assert_eq!(found[0].mismatch, 0.0);
}

fn scene() -> (Image<Srgb<u8>>, Mask, [DVec2; 4]) {
    let scene = occluded(Surface::Bricks, Size::new(300, 220).unwrap(), Seed(4));
    let hole = scene.post.clone();
    (scene.picture.convert(), hole, scene.corners_in_image)
}

#[test]
fn filling_changes_nothing_beyond_the_matte_and_leaves_nothing_open() {
    let (image, hole, quad) = scene();
    let sources = Sources {
        planes: &[quad],
        ..Sources::new(&image, &hole)
    };
    let index = index(&sources);
    let mut retouch = Retouch::new(&index);
    let summary = retouch
        .fill(&FillOptions::default(), &Progress::none())
        .unwrap();
    assert_eq!((summary.open_px, summary.steps), (0, retouch.steps().len()));
    let filled = retouch.picture(&image);
    let mut changed = 0;
    for row in 0..image.height() {
        for col in 0..image.width() {
            if hole.at(col, row) == 0.0 {
                assert_eq!(filled[(col, row)], image[(col, row)]);
            } else {
                changed += usize::from(filled[(col, row)] != image[(col, row)]);
            }
        }
    }
    assert!(changed as f64 > 0.9 * hole.area_px());
}

/// The picture with its hole filled, and the steps that did it.
fn filled(index: &FragmentIndex, image: &Image<Srgb<u8>>) -> (Image<Srgb<u8>>, Vec<Step>) {
    let mut retouch = Retouch::new(index);
    retouch
        .fill(&FillOptions::default(), &Progress::none())
        .unwrap();
    let steps = retouch.steps().copied().collect();
    (retouch.picture(image), steps)
}

#[test]
fn steps_done_again_give_the_same_bytes_and_undone_the_ones_before() {
    let (image, hole, quad) = scene();
    let index = index(&Sources {
        planes: &[quad],
        ..Sources::new(&image, &hole)
    });
    let (filled, steps) = filled(&index, &image);
    let mut again = Retouch::new(&index);
    let mut pictures = vec![again.picture(&image)];
    for step in &steps {
        again.apply(step, &Progress::none()).unwrap();
        pictures.push(again.picture(&image));
    }
    assert_eq!(pictures.last(), Some(&filled));
    for (step, before) in steps.iter().zip(&pictures).rev() {
        assert_eq!(again.undo().as_ref(), Some(step));
        assert_eq!(&again.picture(&image), before);
    }
    assert_eq!(again.undo(), None);
    assert_eq!(again.picture(&image), image);
}

#[test]
fn a_state_goes_on_with_its_index_and_follows_any_steps() {
    let (image, hole, quad) = scene();
    let index_of = || {
        index(&Sources {
            planes: &[quad],
            ..Sources::new(&image, &hole)
        })
    };
    let (index, other) = (index_of(), index_of());
    let (_, steps) = filled(&index, &image);
    let after = |steps: &[Step]| {
        let mut fresh = Retouch::new(&index);
        fresh.replay(steps, &Progress::none()).unwrap();
        (fresh.picture(&image), fresh.open_px())
    };
    // longer, shorter, with another step in the middle, and none
    let mut changed = steps.clone();
    let middle = steps.len() / 2;
    changed[middle] = Step {
        blend: !steps[middle].blend,
        ..steps[middle]
    };
    let mut retouch = Retouch::new(&index);
    for wanted in [&steps[..], &steps[..1], &changed, &steps, &[]] {
        retouch.follow(wanted, &Progress::none()).unwrap();
        assert_eq!((retouch.picture(&image), retouch.open_px()), after(wanted));
        assert!(retouch.steps().eq(wanted));
        retouch = Retouch::resume(&index, retouch.suspend()).expect("it is of this index");
    }
    assert!(Retouch::resume(&other, retouch.suspend()).is_none());
}

#[test]
fn a_step_that_was_changed_by_hand_copies_from_elsewhere() {
    let size = Size::new(120, 90).unwrap();
    let image = picture(size, |at| clouds(at.x, at.y, 3.0));
    let hole = Mask::from_rect(size, Rect::new(50, 40, 8, 8));
    let index = index(&Sources::new(&image, &hole));
    let mut retouch = Retouch::new(&index);
    let target = Target::new(dvec2(54.0, 44.0), 10);
    let mut step = retouch.step(&target, &best(&index, &target, false)[0]);
    step.source.at = dvec2(24.5, 64.5);
    step.blend = false;
    assert_eq!(retouch.apply(&step, &Progress::none()), Ok(64));
    let filled = retouch.picture(&image);
    for (col, row) in [(50, 40), (57, 47), (53, 44)] {
        assert_eq!(filled[(col, row)], image[(col - 30, row + 20)]);
    }
    // beyond what is known it gives nothing
    step.source.at = dvec2(1.5, 1.5);
    retouch.undo();
    assert!(retouch.apply(&step, &Progress::none()).unwrap() < 64);
}

#[test]
fn where_fragments_overlap_the_seam_runs_along_what_they_share() {
    // two halves of a plain picture with a band between them that any cut can hide in
    let size = Size::new(140, 100).unwrap();
    let image = picture(size, |at| {
        if at.y > 50.0 {
            [200, 180, 160]
        } else {
            [20, 40, 60]
        }
    });
    let hole = Mask::from_rect(size, Rect::new(40, 30, 60, 40));
    let index = index(&Sources::new(&image, &hole));
    let mut retouch = Retouch::new(&index);
    let summary = retouch
        .fill(&FillOptions::default(), &Progress::none())
        .unwrap();
    assert_eq!(summary.open_px, 0);
    let off = |a: &Image<Srgb<u8>>| {
        a.pixels()
            .iter()
            .zip(image.pixels())
            .filter(|(a, b)| a.0[0].abs_diff(b.0[0]) > 4)
            .count()
    };
    assert_eq!(off(&retouch.picture(&image)), 0);
}

#[test]
fn the_number_of_threads_does_not_matter() {
    let (image, hole, quad) = scene();
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| {
            let index = index(&Sources {
                planes: &[quad],
                ..Sources::new(&image, &hole)
            });
            filled(&index, &image)
        })
    };
    assert_eq!(run(1), run(3));
}

#[test]
fn coarse_to_fine_finds_what_the_full_search_finds() {
    let (mut same, mut queries) = (0, 0);
    for surface in Surface::ALL {
        let scene = occluded(surface, Size::new(420, 320).unwrap(), Seed(9));
        let image: Image<Srgb<u8>> = scene.picture.convert();
        for k in 0..6 {
            let at = dvec2(80.5 + 45.0 * f64::from(k), 90.5 + 23.0 * f64::from(k));
            let hole = Mask::from_disc(image.size(), at, 22.0).unwrap();
            let index = index(&Sources::new(&image, &hole));
            let target = Target::new(
                at + 20.0 * DVec2::from_angle(f64::from(k)),
                [12, 20, 32][k as usize % 3],
            );
            queries += 1;
            same += u32::from(
                best(&index, &target, false)[0].source == best(&index, &target, true)[0].source,
            );
        }
    }
    // one in a hundred may differ
    assert_eq!((same, queries), (24, 24));
}

#[test]
fn the_index_takes_no_more_than_60_bytes_a_pixel() {
    for (width, height) in [(768, 512), (1000, 700), (1600, 1200)] {
        let size = Size::new(width, height).unwrap();
        let image = Image::new(size, Srgb([90u8; 3]));
        let index = index(&Sources::new(
            &image,
            &Mask::from_rect(size, Rect::new(100, 100, 40, 40)),
        ));
        assert_eq!(index.pixels(), width * height);
        assert!(
            index.bytes() <= 60 * index.pixels(),
            "{}",
            index.bytes() as f64 / index.pixels() as f64
        );
    }
}

#[test]
fn every_pixel_type_is_filled_and_soft_mattes_mix() {
    let size = Size::new(90, 70).unwrap();
    let glass = Image::from_fn(size, |col, row| {
        Srgba([
            (col * 2) as u16 * 200,
            (row * 3) as u16 * 200,
            9000,
            if col % 9 < 4 { 65535 } else { 30000 },
        ])
    });
    let soft = Mask::from_disc(size, dvec2(45.3, 35.2), 7.0).unwrap();
    let index = index(&Sources::new(&glass, &soft));
    let mut retouch = Retouch::new(&index);
    retouch
        .fill(&FillOptions::default(), &Progress::none())
        .unwrap();
    let filled = retouch.picture(&glass);
    assert_eq!(retouch.open_px(), 0);
    for row in 0..70 {
        for col in 0..90 {
            assert!(soft.at(col, row) > 0.0 || filled[(col, row)] == glass[(col, row)]);
        }
    }
}

#[test]
fn what_cannot_be_done_says_why() {
    let size = Size::new(60, 50).unwrap();
    let image = Image::new(size, Srgb([90u8, 80, 70]));
    let hole = Mask::from_rect(size, Rect::new(20, 20, 10, 10));
    let fails =
        |sources: &Sources<Srgb<u8>>| FragmentIndex::new(sources, &Progress::none()).unwrap_err();
    let small = Mask::empty(Size::new(9, 9).unwrap());
    assert!(matches!(
        fails(&Sources::new(&image, &small)),
        CompleteError::MaskSize { .. }
    ));
    let features = Sources {
        features: Some(&small),
        ..Sources::new(&image, &hole)
    };
    assert!(matches!(
        fails(&features),
        CompleteError::FeatureSize { .. }
    ));
    let full = Mask::full(size);
    assert!(matches!(
        fails(&Sources::new(&image, &full)),
        CompleteError::NoSource { .. }
    ));
    let huge = Sources {
        variants: &[Variant { scale: 9.0, ..NONE }],
        ..Sources::new(&image, &hole)
    };
    assert!(matches!(fails(&huge), CompleteError::Fragment { .. }));
    // a turned copy of it would have 1.6 thousand million pixels
    let long = Size::new(56_000, 10).unwrap();
    let (row, stain) = (
        Image::new(long, Srgb([90u8; 3])),
        Mask::from_rect(long, Rect::new(9000, 0, 9, 9)),
    );
    let turned = Variant {
        turn_rad: 0.7,
        ..NONE
    };
    let aslant = Sources {
        variants: &[turned],
        ..Sources::new(&row, &stain)
    };
    let error = fails(&aslant);
    assert!(
        matches!(error, CompleteError::Fragment { .. })
            && error.to_string().contains("56000 x 10 pixels"),
        "{error}"
    );

    let index = index(&Sources::new(&image, &hole));
    let retouch = Retouch::new(&index);
    let why = |target: Target| {
        retouch
            .best(&target, &SearchOptions::default(), &Progress::none())
            .unwrap_err()
    };
    for target in [
        Target::new(dvec2(70.0, 10.0), 8),
        Target::new(dvec2(f64::NAN, 10.0), 8),
        Target::new(dvec2(25.0, 25.0), 1),
        Target::new(dvec2(25.0, 25.0), 3),
        Target {
            plane: Some(2),
            ..Target::new(dvec2(20.0, 20.0), 8)
        },
    ] {
        assert!(
            matches!(why(target), CompleteError::Fragment { .. }),
            "{target:?}"
        );
    }
    let too_large = FillOptions {
        radius_px: Some(30),
        ..FillOptions::default()
    };
    let error = Retouch::new(&index)
        .fill(&too_large, &Progress::none())
        .unwrap_err();
    assert!(
        matches!(
            error,
            CompleteError::Radius {
                radius_px: 30,
                largest_radius_px: 8..20
            }
        ),
        "{error:?}"
    );
}

#[test]
fn a_cancelled_search_says_so() {
    let (image, hole, _) = scene();
    let progress = Progress::none();
    progress.cancel();
    let sources = Sources::new(&image, &hole);
    assert!(matches!(
        FragmentIndex::new(&sources, &progress),
        Err(CompleteError::Cancelled(_))
    ));
    let index = index(&sources);
    let mut retouch = Retouch::new(&index);
    let target = Target::new(dvec2(150.0, 110.0), 90);
    let options = SearchOptions::default();
    assert!(matches!(
        retouch.best(&target, &options, &progress),
        Err(CompleteError::Cancelled(_))
    ));
    let filled = retouch.fill(&FillOptions::default(), &progress);
    assert!(matches!(filled, Err(CompleteError::Cancelled(_))));
    assert_eq!(retouch.picture(&image), image);
}

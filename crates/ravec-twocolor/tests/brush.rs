//! The contract of the brush: what changes, what does not, and what it does not depend on.

use ravec_progress::Progress;
use ravec_raster::{Color, Image, LinearRgba, Oklab, Size, Srgb};
use ravec_twocolor::Mode;
use ravec_twocolor::brush::{Brush, Painted, Stroke, StrokeError, Strokes, Tool, replay};

/// Two halves with a slanted border and some texture.
fn picture(width: usize, height: usize) -> Image<LinearRgba> {
    let image = Image::from_fn(Size::new(width, height).unwrap(), |col, row| {
        let texture = ((col * 7 + row * 13 + col * row) % 9) as u8;
        // 64 steps apart
        if 4 * col > 2 * width + row {
            Srgb([150 + texture, 140, 130])
        } else {
            Srgb([86 + texture, 76, 66])
        }
    });
    image.convert()
}

fn tools() -> Vec<Tool> {
    let operator = |mode| Tool::Operator {
        mode,
        iterations: 1,
        noise_sigma: Some(5.0),
    };
    vec![
        operator(Mode::Abstract),
        operator(Mode::Smooth),
        operator(Mode::Sharpen),
        operator(Mode::Clean),
        operator(Mode::Antialias),
        operator(Mode::Stamp),
        Tool::Operator {
            mode: Mode::Smooth,
            iterations: 3,
            noise_sigma: None,
        },
        Tool::Color { rgb: [220, 30, 40] },
        Tool::Dodge,
        Tool::Burn,
        Tool::Saturation { amount: 1.0 },
        Tool::Recolor { rgb: [30, 60, 220] },
        Tool::Clone { offset: [15, -9] },
    ]
}

fn painted(image: &Image<LinearRgba>, strokes: Vec<Stroke>) -> Painted {
    let list = Strokes {
        strokes,
        ..Strokes::new(image.size())
    };
    replay(image.clone(), &list, &Progress::none()).unwrap()
}

fn way() -> Vec<[f64; 2]> {
    vec![[20.0, 20.0], [60.0, 25.0], [40.0, 50.0]]
}

fn distance_to_way([x, y]: [f64; 2]) -> f64 {
    way()
        .windows(2)
        .map(|s| {
            let (dx, dy) = (s[1][0] - s[0][0], s[1][1] - s[0][1]);
            let t =
                (((x - s[0][0]) * dx + (y - s[0][1]) * dy) / (dx * dx + dy * dy)).clamp(0.0, 1.0);
            (x - s[0][0] - t * dx).hypot(y - s[0][1] - t * dy)
        })
        .fold(f64::MAX, f64::min)
}

#[test]
fn only_pixels_within_the_radius_change_and_some_do() {
    let image = picture(96, 80);
    for tool in tools() {
        let result = painted(&image, vec![Stroke::new(tool.clone(), way(), 9.0)]);
        let mut changed = 0;
        for row in 0..80 {
            for col in 0..96 {
                let near = distance_to_way([col as f64 + 0.5, row as f64 + 0.5]) < 9.0;
                let same = result.image[(col, row)] == image[(col, row)];
                assert!(same || near, "{tool:?} ({col}, {row})");
                changed += u64::from(!same);
            }
        }
        // antialiasing changes the pixels on the edge only
        assert!(changed > 8, "{tool:?}: {changed}");
        assert!(result.touched[0] >= changed);
    }
}

#[test]
fn a_stroke_is_the_same_live_replayed_and_cut_into_pieces() {
    let image = picture(96, 80);
    let mut cut = vec![];
    for pair in way().windows(2) {
        for i in 0..4 {
            let t = f64::from(i) / 4.0;
            cut.push([
                pair[0][0] + t * (pair[1][0] - pair[0][0]),
                pair[0][1] + t * (pair[1][1] - pair[0][1]),
            ]);
        }
    }
    cut.push([40.0, 50.0]);
    for tool in tools() {
        for accumulate in [false, true] {
            let stroke = |points| Stroke {
                accumulate,
                strength: 0.7,
                ..Stroke::new(tool.clone(), points, 9.0)
            };
            let whole = painted(&image, vec![stroke(way())]).image;
            assert!(
                painted(&image, vec![stroke(cut.clone())]).image == whole,
                "{tool:?} cut"
            );
            let mut brush =
                Brush::begin(image.clone(), stroke(vec![cut[0]]), &Progress::none()).unwrap();
            for &point in &cut[1..] {
                brush.extend(point, &Progress::none()).unwrap();
            }
            assert!(
                brush.finish() == whole,
                "{tool:?} live, accumulate {accumulate}"
            );
            // in batches of several lengths, the last of which is longer than what is painted at once
            let mut brush =
                Brush::begin(image.clone(), stroke(vec![cut[0]]), &Progress::none()).unwrap();
            for range in [1..2, 2..4, 4..4, 4..cut.len()] {
                let changed = brush.extend_along(&cut[range.clone()], &Progress::none());
                assert_eq!(changed.unwrap().is_empty(), range.is_empty());
            }
            assert!(
                brush.finish() == whole,
                "{tool:?} in batches, accumulate {accumulate}"
            );
        }
    }
}

/// A way of small steps that turns in loops and crosses itself.
fn loops() -> Vec<[f64; 2]> {
    let at = |k: u32| {
        let t = f64::from(k) * 0.13;
        [
            48.0 + 28.0 * (1.3 * t).sin(),
            40.0 + 25.0 * (2.1 * t + 0.4).cos(),
        ]
    };
    (0..70).map(at).collect()
}

#[test]
fn a_stroke_of_small_steps_that_crosses_itself_is_the_same_live_and_replayed() {
    let image = picture(96, 80);
    let way = loops();
    let tools = [Tool::Mask, Tool::Color { rgb: [220, 30, 40] }, Tool::Dodge];
    for (tool, edge_aware) in tools.iter().flat_map(|tool| [(tool, true), (tool, false)]) {
        let stroke = |points: &[[f64; 2]]| Stroke {
            edge_aware,
            ..Stroke::new(tool.clone(), points.to_vec(), 9.0)
        };
        let expect = |brush: &Brush, points: &[[f64; 2]]| {
            let expected = painted(&image, vec![stroke(points)]);
            assert!(brush.image() == &expected.image, "{tool:?} {edge_aware}");
            assert!(
                brush.mask() == expected.mask.as_ref(),
                "{tool:?} {edge_aware}"
            );
        };
        let progress = Progress::none();
        let mut brush = Brush::begin(image.clone(), stroke(&way[..1]), &progress).unwrap();
        for end in 2..=way.len() {
            brush.extend(way[end - 1], &progress).unwrap();
            if end % 9 == 0 {
                expect(&brush, &way[..end]);
            }
        }
        expect(&brush, &way);
        if *tool == Tool::Mask {
            continue;
        }
        // taken in the hand again, it goes on
        let mut brush = Brush::begin(image.clone(), stroke(&way[..30]), &progress).unwrap();
        brush.next_stroke(stroke(&way[50..60]), &progress).unwrap();
        brush.undo_stroke().unwrap();
        for &point in &way[30..45] {
            brush.extend(point, &progress).unwrap();
        }
        expect(&brush, &way[..45]);
    }
}

#[test]
fn strokes_one_after_another_are_the_same_live_and_replayed() {
    let image = picture(96, 80);
    let strokes: Vec<Stroke> = tools()
        .into_iter()
        .filter(|tool| *tool != Tool::Mask)
        .enumerate()
        .map(|(i, tool)| {
            let begin = 10.0 + 6.0 * i as f64;
            Stroke::new(tool, vec![[begin, 20.0], [50.0, 30.0 + begin / 2.0]], 9.0)
        })
        .collect();
    let progress = Progress::none();
    let mut brush: Option<Brush> = None;
    for stroke in &strokes {
        let first = Stroke {
            points: stroke.points[..1].to_vec(),
            ..stroke.clone()
        };
        match &mut brush {
            None => brush = Some(Brush::begin(image.clone(), first, &progress).unwrap()),
            Some(brush) => {
                brush.next_stroke(first, &progress).unwrap();
            }
        }
        let brush = brush.as_mut().unwrap();
        brush.extend(stroke.points[1], &progress).unwrap();
    }
    let live = brush.unwrap().finish();
    assert!(live == painted(&image, strokes).image);
}

#[test]
fn strokes_that_are_undone_and_replaced_leave_the_picture_of_the_others() {
    let image = picture(96, 80);
    let progress = Progress::none();
    let tools: Vec<Tool> = tools()
        .into_iter()
        .filter(|tool| *tool != Tool::Mask)
        .collect();
    let stroke = |k: usize| {
        let tool = tools[(k * 7) % tools.len()].clone();
        let begin = 8.0 + (k * 13 % 60) as f64;
        Stroke {
            accumulate: k.is_multiple_of(3),
            ..Stroke::new(tool, vec![[begin, 20.0], [50.0, 60.0 - begin / 2.0]], 9.0)
        }
    };
    let mut kept = vec![stroke(0)];
    let mut brush = Brush::begin(image.clone(), stroke(0), &progress).unwrap();
    let mut state = 5u64;
    for k in 1..40 {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        // a look at the region of a stroke, often of the next one, changes neither picture nor stroke
        if k % 4 != 0 {
            let next = stroke(k + usize::from(k % 4 == 1));
            let (rect, effect) = brush.region(&next, &progress).unwrap().unwrap();
            let selects = Stroke {
                tool: Tool::Mask,
                ..next
            };
            let with_mask = kept.iter().cloned().chain([selects]).collect();
            let mask = painted(&image, with_mask).mask.unwrap();
            let expected = mask.crop(rect.col, rect.row, rect.size().unwrap()).unwrap();
            assert!(effect == expected, "region {k}");
        }
        match (state >> 60) % 4 {
            0 if kept.len() > 1 => {
                let before = brush.image().clone();
                let changed = brush.undo_stroke().expect("a stroke to undo");
                kept.pop();
                for row in 0..80 {
                    for col in 0..96 {
                        let same = brush.image()[(col, row)] == before[(col, row)];
                        assert!(same || changed.contains(col, row), "({col}, {row})");
                    }
                }
            }
            1 => {
                brush.replace_stroke(stroke(k), &progress).unwrap();
                kept.pop();
                kept.push(stroke(k));
            }
            _ => {
                brush.next_stroke(stroke(k), &progress).unwrap();
                kept.push(stroke(k));
            }
        }
        assert_eq!(*brush.stroke(), kept[kept.len() - 1]);
        assert!(
            *brush.image() == painted(&image, kept.clone()).image,
            "step {k}"
        );
    }
    while kept.len() > 1 {
        assert!(brush.undo_stroke().is_some());
        kept.pop();
    }
    assert!(
        brush.undo_stroke().is_none(),
        "only the first stroke is left"
    );
    assert!(*brush.image() == painted(&image, kept).image);
}

#[test]
fn paint_does_not_cross_an_edge_of_64_steps() {
    let image = picture(96, 80);
    let stroke = Stroke {
        hardness: 1.0,
        ..Stroke::new(Tool::Color { rgb: [220, 30, 40] }, vec![[30.0, 40.0]], 40.0)
    };
    let aware = painted(&image, vec![stroke.clone()]).image;
    let careless = painted(
        &image,
        vec![Stroke {
            edge_aware: false,
            ..stroke
        }],
    )
    .image;
    let (mut inside, mut beyond, mut beyond_careless) = (0, 0, 0);
    for row in 10..70 {
        for col in 0..96 {
            let signed = (4 * col) as i64 - (192 + row as i64);
            let changed = aware[(col, row)] != image[(col, row)];
            if signed > 4 {
                beyond += u32::from(changed);
                beyond_careless += u32::from(careless[(col, row)] != image[(col, row)]);
            } else if signed < -8 {
                inside += u32::from(changed);
            }
        }
    }
    assert_eq!(beyond, 0);
    assert!(
        beyond_careless > 100 && inside > 1000,
        "{beyond_careless} {inside}"
    );
}

#[test]
fn tools_do_what_their_names_say() {
    let image = picture(64, 48);
    let center = (12, 24);
    let after = |tool: Tool| {
        let result = painted(&image, vec![Stroke::new(tool, vec![[12.5, 24.5]], 8.0)]).image;
        Oklab::from_linear(result[center].to_linear()).0
    };
    let before = Oklab::from_linear(image[center].to_linear()).0;
    let chroma = |lab: [f32; 3]| lab[1].hypot(lab[2]);
    assert!(after(Tool::Dodge)[0] > before[0] + 0.1);
    assert!(after(Tool::Burn)[0] < before[0] - 0.1);
    assert!((chroma(after(Tool::Saturation { amount: 1.0 })) / chroma(before) - 2.0).abs() < 0.01);
    assert!(chroma(after(Tool::Saturation { amount: -1.0 })) < 1e-3);
    let blue = after(Tool::Recolor { rgb: [0, 0, 255] });
    assert!((blue[0] - before[0]).abs() < 1e-3 && blue[2] < -0.2);
    let result = painted(
        &image,
        vec![Stroke::new(
            Tool::Clone { offset: [30, 0] },
            vec![[12.5, 24.5]],
            8.0,
        )],
    )
    .image;
    assert_eq!(result[center], image[(42, 24)]);
}

#[test]
fn mask_strokes_select_and_leave_the_picture_alone() {
    let image = picture(64, 48);
    let result = painted(
        &image,
        vec![
            Stroke {
                strength: 0.5,
                ..Stroke::new(Tool::Mask, vec![[12.5, 24.5]], 8.0)
            };
            2
        ],
    );
    assert!(result.image == image);
    let mask = result.mask.unwrap();
    assert_eq!((mask[(12, 24)], mask[(60, 5)]), (0.5, 0.0));
    let mut brush = Brush::begin(
        image,
        Stroke::new(Tool::Mask, vec![[12.5, 24.5]], 8.0),
        &Progress::none(),
    )
    .unwrap();
    brush.extend([20.0, 24.5], &Progress::none()).unwrap();
    assert_eq!(brush.mask().unwrap()[(16, 24)], 1.0);
}

#[test]
fn overlaps_add_up_only_when_asked() {
    let image = picture(64, 48);
    let back_and_forth = vec![[8.0, 24.5], [18.0, 24.5], [8.0, 24.5], [18.0, 24.5]];
    let run = |points: Vec<[f64; 2]>, accumulate| {
        let stroke = Stroke {
            accumulate,
            strength: 0.3,
            ..Stroke::new(Tool::Dodge, points, 5.0)
        };
        painted(&image, vec![stroke]).image[(13, 24)].0[0]
    };
    let once = vec![[8.0, 24.5], [18.0, 24.5]];
    assert_eq!(run(back_and_forth.clone(), false), run(once.clone(), false));
    assert!(run(back_and_forth, true) > run(once, true));
}

#[test]
fn a_stroke_outside_the_picture_changes_nothing_and_says_so() {
    let image = picture(64, 48);
    for at in [[-50.0, 10.0], [500.0, 500.0], [10.0, -9.5]] {
        let result = painted(&image, vec![Stroke::new(Tool::Dodge, vec![at], 9.0)]);
        assert!(result.image == image);
        assert_eq!(result.touched, [0]);
    }
}

#[test]
fn strokes_are_replayed_at_another_resolution() {
    let (small, large) = (picture(96, 80), picture(192, 160));
    let mut strokes = Strokes::new(small.size());
    strokes
        .strokes
        .push(Stroke::new(Tool::Color { rgb: [220, 30, 40] }, way(), 9.0));
    let a = replay(small.clone(), &strokes, &Progress::none()).unwrap();
    let b = replay(large.clone(), &strokes, &Progress::none()).unwrap();
    let ratio = b.touched[0] as f64 / a.touched[0] as f64;
    assert!((ratio - 4.0).abs() < 0.3, "{ratio}");
    // the middle of the stroke is painted in both
    assert_eq!(a.image[(30, 21)], b.image[(60, 42)]);
}

#[test]
fn undo_is_a_replay_without_the_last_stroke() {
    let image = picture(64, 48);
    let first = Stroke::new(Tool::Burn, vec![[20.0, 20.0]], 9.0);
    let second = Stroke::new(Tool::Dodge, vec![[25.0, 20.0]], 9.0);
    let both = painted(&image, vec![first.clone(), second]).image;
    let undone = painted(&image, vec![first.clone()]).image;
    assert!(both != undone);
    assert!(undone == painted(&image, vec![first]).image);
}

#[test]
fn strokes_survive_json_and_bad_ones_are_refused() {
    let mut strokes = Strokes::new(Size::new(64, 48).unwrap());
    strokes.strokes = tools()
        .into_iter()
        .map(|tool| Stroke::new(tool, way(), 9.0))
        .collect();
    let text = serde_json::to_string(&strokes).unwrap();
    assert_eq!(serde_json::from_str::<Strokes>(&text).unwrap(), strokes);
    let short = r#"{"version":1,"width":64,"height":48,"strokes":[{"tool":"dodge","points":[[1,2]],"radius_px":3}]}"#;
    assert_eq!(
        serde_json::from_str::<Strokes>(short).unwrap().strokes[0],
        Stroke::new(Tool::Dodge, vec![[1.0, 2.0]], 3.0)
    );
    assert!(serde_json::from_str::<Strokes>(&short.replace("radius_px", "radius")).is_err());

    let image = picture(64, 48);
    let base = Stroke::new(Tool::Dodge, vec![[1.0, 2.0]], 3.0);
    for wrong in [
        Stroke {
            points: vec![],
            ..base.clone()
        },
        Stroke {
            points: vec![[f64::NAN, 0.0]],
            ..base.clone()
        },
        Stroke {
            points: vec![[1e9, 0.0]],
            ..base.clone()
        },
        Stroke {
            radius_px: 0.0,
            ..base.clone()
        },
        Stroke {
            radius_px: -1.0,
            ..base.clone()
        },
        Stroke {
            radius_px: f64::NAN,
            ..base.clone()
        },
        Stroke {
            radius_px: 1e6,
            ..base.clone()
        },
        Stroke {
            hardness: 2.0,
            ..base.clone()
        },
        Stroke {
            strength: -0.5,
            ..base.clone()
        },
        Stroke {
            window_px: 8,
            ..base.clone()
        },
        Stroke {
            edge_tolerance: 0.0,
            ..base.clone()
        },
        Stroke {
            spacing: 0.0,
            ..base.clone()
        },
        Stroke {
            tool: Tool::Saturation { amount: 9.0 },
            ..base.clone()
        },
    ] {
        let list = Strokes {
            strokes: vec![base.clone(), wrong],
            ..Strokes::new(image.size())
        };
        let error = replay(image.clone(), &list, &Progress::none()).unwrap_err();
        assert!(
            matches!(error, StrokeError::Stroke { number: 2, .. }),
            "{error}"
        );
    }
    let version = Strokes {
        version: 2,
        ..Strokes::new(image.size())
    };
    assert_eq!(
        replay(image.clone(), &version, &Progress::none()).unwrap_err(),
        StrokeError::Version { got: 2 }
    );
    let empty = Strokes {
        width: 0,
        ..Strokes::new(image.size())
    };
    assert!(matches!(
        replay(image, &empty, &Progress::none()),
        Err(StrokeError::EmptyPicture { .. })
    ));
}

#[test]
fn threads_do_not_matter_and_neither_do_odd_pictures() {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build()
        .unwrap();
    for size in [(96, 80), (1, 1), (3, 2000)] {
        let image = picture(size.0, size.1);
        for tool in tools() {
            let strokes = vec![Stroke::new(tool, vec![[0.0, 0.0], [2.0, 30.0]], 12.0)];
            let many = painted(&image, strokes.clone()).image;
            assert!(pool.install(|| painted(&image, strokes)).image == many);
        }
    }
}

#[test]
fn cancelled_strokes_stop() {
    let image = picture(64, 48);
    let progress = Progress::none();
    progress.cancel();
    let list = Strokes {
        strokes: vec![Stroke::new(Tool::Dodge, way(), 9.0)],
        ..Strokes::new(image.size())
    };
    assert!(matches!(
        replay(image, &list, &progress),
        Err(StrokeError::Cancelled(_))
    ));
}

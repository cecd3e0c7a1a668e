//! Edits along a plate of two planes: a wall above a floor.

use super::*;

/// A wall above a floor, each of which moves in its own way, and a square that passes before both.
struct TwoPlanes {
    shot: Shot,
}

impl TwoPlanes {
    const FRAMES: usize = 14;
    const SPEEDS: [f64; 2] = [0.5, 1.5];

    fn scene(index: usize, col: usize, row: usize) -> [f64; 3] {
        let plane = usize::from(row >= SIZE.1 / 2);
        let (x, y) = (col as f64 + Self::SPEEDS[plane] * index as f64, row as f64);
        let wave = 40.0 * (0.7 * x).sin() + 25.0 * (0.45 * y + 0.3 * x).cos();
        [130.0 + wave, 120.0 - wave, 120.0 + 0.5 * wave]
    }

    fn covered(index: usize, col: usize, row: usize) -> bool {
        (4 + 5 * index..12 + 5 * index).contains(&col) && row.abs_diff(SIZE.1 / 2) < 10
    }

    fn new() -> Self {
        let shot = Shot {
            folder: tempfile::tempdir().unwrap(),
        };
        let mut planes = [Vec::new(), Vec::new()];
        for index in 0..Self::FRAMES {
            let frame = picture(size(), |col, row| {
                if Self::covered(index, col, row) {
                    [230.0, 30.0, 50.0]
                } else {
                    Self::scene(index, col, row)
                }
            });
            shot.save(&format!("f_{index:02}.png"), frame);
            for (maps, speed) in planes.iter_mut().zip(Self::SPEEDS) {
                let shift = -speed * index as f64;
                maps.push([1.0, 0.0, shift, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
            }
        }
        let planes = planes.map(|maps| serde_json::json!({ "frame_from_reference": maps }));
        let track = serde_json::json!({ "planes": planes });
        crate::files::write_text(&shot.at("track.json"), &track.to_string()).unwrap();
        Self { shot }
    }

    fn plate(&self) -> crate::plate::Plate {
        crate::plate::Plate {
            input: self.shot.at("f_%02d.png"),
            output: self.shot.at("plate.png"),
            track: Some(self.shot.at("track.json")),
            exclude: None,
            strokes: None,
            seen: None,
            certainty: None,
            regions: Some(self.shot.at("regions.png")),
            params: crate::plate::Params {
                pad: PAD,
                ..crate::plate::Params::default()
            },
        }
    }
}

#[test]
fn a_plate_of_two_planes_is_made_matted_and_shown_through() {
    let two = TwoPlanes::new();
    let shot = &two.shot;
    let report = run(&two.plate());
    assert_eq!(report.figures["planes"], 2.0);
    let regions = shot.read("regions.png");
    let number = |col: usize, row: usize| regions[(PAD + col, PAD + row)].0;
    assert_eq!([number(30, 8), number(30, SIZE.1 - 9)], [[1; 3], [2; 3]]);
    let matte = Matte {
        input: shot.at("f_%02d.png"),
        output: shot.at("a_%02d.png"),
        plate: Some(shot.at("plate.png")),
        trimap: None,
        track: Some(shot.at("track.json")),
        regions: Some(shot.at("regions.png")),
        strokes: None,
        params: crate::matte::Params {
            pad: PAD,
            ..crate::matte::Params::default()
        },
    };
    run(&matte);
    let removal = Remove {
        input: shot.at("f_%02d.png"),
        matte: shot.at("a_%02d.png"),
        regions: Some(shot.at("regions.png")),
        params: remove::Params {
            shot: Shot::params(),
            grain: Grain::None,
            ..remove::Params::default()
        },
        ..shot.removal("clean_%02d.png")
    };
    run(&removal);
    // the border between the planes is filtered in the plate, and what the last frames show at the right border no other one does
    let inner =
        |col: usize, row: usize| row.abs_diff(SIZE.1 / 2) > 3 && (4..SIZE.0 - 4).contains(&col);
    for index in [2, 5, 8] {
        let found = shot.read(&format!("clean_{index:02}.png"));
        let wrong = largest(&found, |col, row| TwoPlanes::scene(index, col, row), inner);
        assert!(wrong < 16.0, "{wrong} in frame {index}");
    }
    // along one plane alone the other one is not there
    let mut plain = two.plate();
    plain.regions = None;
    plain.output = shot.at("plain.png");
    run(&plain);
    let wrong = largest(
        &shot.read("plain.png").crop(PAD, PAD, size()).unwrap(),
        |col, row| TwoPlanes::scene(0, col, row),
        inner,
    );
    assert!(wrong > 30.0, "{wrong}");
}

#[test]
fn planes_that_a_track_lacks_are_refused() {
    let two = TwoPlanes::new();
    run(&two.plate());
    let size = two.shot.read("regions.png").size();
    two.shot.save("regions.png", picture(size, |_, _| [3.0; 3]));
    two.shot
        .save("a.png", picture(self::size(), |_, _| [0.0; 3]));
    let removal = Remove {
        input: two.shot.at("f_%02d.png"),
        matte: two.shot.at("a.png"),
        regions: Some(two.shot.at("regions.png")),
        ..two.shot.removal("clean_%02d.png")
    };
    assert!(refused(&removal).to_string().contains("plane 3"));
    two.shot
        .save("regions.png", picture(self::size(), |_, _| [1.0; 3]));
    assert!(matches!(refused(&removal), JobError::SizesDiffer { .. }));
    let untracked = Remove {
        track: None,
        ..removal
    };
    assert!(refused(&untracked).to_string().contains("regions"));
    let untracked = crate::plate::Plate {
        track: None,
        ..two.plate()
    };
    assert!(refused(&untracked).to_string().contains("regions"));
    let lossy = crate::plate::Plate {
        regions: Some(two.shot.at("regions.jpg")),
        ..two.plate()
    };
    assert!(refused(&lossy).to_string().contains("exact values"));
}

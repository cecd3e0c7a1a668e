//! Every command that takes or prints points, with both conventions: the same pixels, and numbers half a pixel apart. `track` has
//! its own test.

use super::PixelCenters;
use crate::brush::{Brush, BrushMode};
use crate::complete::{self, Complete, Corners};
use crate::match_photos::{self, Match};
use crate::plane::planes::{self, Planes};
use crate::plane::rectify::{self, Rectify};
use crate::plane::snap::{self, Snap};
use crate::plane::{Quad, Ratio};
use crate::{Context, Operation, Report, brush};
use glam::{DMat3, DVec2, dvec2};
use ravec::planar::Homography;
use ravec::raster::{AnyImage, Image, Size, Srgb};
use ravec_media::{Picture, WriteOptions};
use ravec_scenes::{Seed, texture::fractal};
use serde_json::Value;
use std::path::{Path, PathBuf};

const BOTH: [PixelCenters; 2] = [PixelCenters::Half, PixelCenters::Integer];

/// Fields of 20 × 20 pixels, 5 × 4 of them from (30, 30) on, on a little texture.
fn photo(folder: &Path, name: &str) -> PathBuf {
    let image: Image<Srgb<u8>> = Image::from_fn(Size::new(200, 160).unwrap(), |col, row| {
        let inside = (30..130).contains(&col) && (30..110).contains(&row);
        let light = ((col + 70) / 20 + (row + 70) / 20) % 2 == 0;
        let at = dvec2(col as f64, row as f64) / 30.0;
        let texture = 30.0 * fractal(at, 0.02, 5, Seed(1));
        let value = if inside && light { 200.0 } else { 100.0 };
        Srgb([(value + texture) as u8; 3])
    });
    save(&folder.join(name), image)
}

fn save(path: &Path, image: Image<Srgb<u8>>) -> PathBuf {
    let picture = Picture::from_image(AnyImage::from(image));
    ravec_media::write(path, &picture, &WriteOptions::default()).unwrap();
    path.to_path_buf()
}

fn bytes(path: &Path) -> Vec<u8> {
    std::fs::read(path).unwrap()
}

fn done(operation: &impl Operation) -> Report {
    operation.run(&Context::default()).unwrap()
}

fn numbers(value: &Value) -> Vec<f64> {
    match value {
        Value::Array(list) => list.iter().flat_map(numbers).collect(),
        other => vec![other.as_f64().unwrap_or_else(|| panic!("{other}"))],
    }
}

fn points(value: &Value) -> Vec<DVec2> {
    let numbers = numbers(value);
    numbers
        .chunks_exact(2)
        .map(|pair| dvec2(pair[0], pair[1]))
        .collect()
}

/// Points of the second are half a pixel less.
fn assert_half_apart(half: &Value, integer: &Value) {
    let (half, integer) = (points(half), points(integer));
    assert!(!half.is_empty());
    for (half, integer) in half.iter().zip(&integer) {
        assert!((*half - *integer - 0.5).abs().max_element() < 1e-9);
    }
}

/// The maps are the same if points of either convention are given to its own.
fn assert_same_map(half: &[f64], integer: &[f64]) {
    let map = |rows: &[f64]| {
        let rows: [f64; 9] = rows.try_into().unwrap();
        Homography::from_matrix(DMat3::from_cols_array(&rows).transpose()).unwrap()
    };
    let (half, integer) = (map(half), map(integer));
    for point in [dvec2(3.0, 8.0), dvec2(120.0, 50.0)] {
        let expected = half.apply(point) - 0.5;
        assert!(integer.apply(point - 0.5).distance(expected) < 1e-6);
    }
    assert!(
        half.apply(dvec2(3.0, 8.0))
            .distance(integer.apply(dvec2(3.0, 8.0)))
            > 1e-6
    );
}

fn rough() -> [DVec2; 4] {
    [
        dvec2(28.5, 31.0),
        dvec2(131.5, 28.5),
        dvec2(130.5, 112.0),
        dvec2(29.0, 108.5),
    ]
}

#[test]
fn rectified_pictures_are_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let input = photo(folder.path(), "a.png");
    let [half, integer] = BOTH.map(|centers| {
        let output = folder.path().join("out.png");
        let report = done(&Rectify {
            input: input.clone(),
            output: output.clone(),
            params: rectify::Params {
                aspect: Some(Ratio(1.25)),
                pixel_centers: centers,
                ..rectify::Params::new(Quad(centers.write_all(rough())))
            },
        });
        (bytes(&output), report.result.unwrap())
    });
    assert!(half.0 == integer.0);
    assert_half_apart(&half.1["quad"], &integer.1["quad"]);
    for name in ["image_from_straight", "straight_from_image"] {
        assert_same_map(&numbers(&half.1[name]), &numbers(&integer.1[name]));
    }
    assert_eq!(integer.1["pixel_centers"], "integer");
}

#[test]
fn snapped_grids_are_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let input = photo(folder.path(), "a.png");
    let [half, integer] = BOTH.map(|centers| {
        let report = done(&Snap {
            input: input.clone(),
            output: None,
            params: snap::Params {
                grid: "5x4".parse().ok(),
                pixel_centers: centers,
                ..snap::Params::new(Quad(centers.write_all(rough())))
            },
        });
        report.result.unwrap()
    });
    assert_half_apart(&half["quad"], &integer["quad"]);
    assert_eq!(half["moved_px"], integer["moved_px"]);
}

#[test]
fn proposed_planes_are_the_same() {
    let folder = tempfile::tempdir().unwrap();
    // the fields from the side
    let front = photo(folder.path(), "a.png");
    let input = folder.path().join("side.png");
    done(&Rectify {
        input: front,
        output: input.clone(),
        params: rectify::Params {
            aspect: Some(Ratio(1.3)),
            width: Some(400),
            ..rectify::Params::new("10,5,190,30,185,130,15,155".parse().unwrap())
        },
    });
    let [half, integer] = BOTH.map(|centers| {
        let report = done(&Planes {
            input: input.clone(),
            output: None,
            params: planes::Params {
                pixel_centers: centers,
                ..planes::Params::default()
            },
        });
        report.result.unwrap()
    });
    let count = half["planes"].as_array().unwrap().len();
    assert!(count > 0, "{half}");
    for at in 0..count {
        assert_half_apart(&half["planes"][at]["quad"], &integer["planes"][at]["quad"]);
    }
    let vanishing = |value: &Value| numbers(&value["vanishing_points"][0]["at"]);
    let (a, b) = (vanishing(&half), vanishing(&integer));
    assert!((a[0] - b[0] - 0.5 * a[2]).abs() < 1e-9 && (a[2] - b[2]).abs() < 1e-12);
}

#[test]
fn matched_photos_have_the_same_map() {
    let folder = tempfile::tempdir().unwrap();
    let scene = |name: &str, shift: f64| {
        let size = Size::new(240, 200).unwrap();
        let image: Image<Srgb<u8>> = Image::from_fn(size, |col, row| {
            // seen a little from the side, for a map that is no shift
            let depth = 1.0 + 4e-4 * shift * col as f64 / 30.0;
            let at = dvec2(col as f64 + shift, row as f64) / depth / 40.0;
            Srgb([(128.0 + 90.0 * fractal(at, 0.02, 5, Seed(1))) as u8; 3])
        });
        save(&folder.path().join(name), image)
    };
    let (first, second) = (scene("a.png", 0.0), scene("b.png", 30.0));
    let [half, integer] = BOTH.map(|centers| {
        let output = folder.path().join("h.txt");
        done(&Match {
            first: first.clone(),
            second: second.clone(),
            output: output.clone(),
            params: match_photos::Params {
                pixel_centers: centers,
                ..match_photos::Params::default()
            },
        });
        let text = std::fs::read_to_string(output).unwrap();
        let words = text.split_whitespace().map(|word| word.parse().unwrap());
        words.collect::<Vec<f64>>()
    });
    assert_same_map(&half, &integer);
}

#[test]
fn strokes_paint_the_same_pixels() {
    let folder = tempfile::tempdir().unwrap();
    let input = photo(folder.path(), "a.png");
    let [half, integer] = BOTH.map(|centers| {
        let points = [dvec2(40.3, 30.8), dvec2(90.0, 52.5)].map(|at| centers.write(at).to_array());
        let strokes = folder.path().join("points.json");
        crate::files::write_text(&strokes, &serde_json::to_string(&points).unwrap()).unwrap();
        let output = folder.path().join("out.png");
        done(&Brush {
            input: input.clone(),
            output: output.clone(),
            everywhere: false,
            stroke: Some(strokes),
            strokes: None,
            mask: None,
            params: brush::Params {
                mode: BrushMode::Color,
                radius: 9.3,
                pixel_centers: centers,
                ..brush::Params::default()
            },
        });
        bytes(&output)
    });
    assert!(half == integer);
    assert!(half != bytes(&input));
}

#[test]
fn holes_and_planes_are_the_same_and_steps_say_their_convention() {
    let folder = tempfile::tempdir().unwrap();
    let input = photo(folder.path(), "a.png");
    let corners = |centers: PixelCenters, points: &[DVec2]| {
        Corners(points.iter().map(|&point| centers.write(point)).collect())
    };
    let polygon = [dvec2(60.2, 50.0), dvec2(84.0, 51.0), dvec2(80.0, 74.7)];
    let run = |centers: PixelCenters, fragments: bool, replay: Option<PathBuf>| {
        let output = folder.path().join("out.png");
        let steps = folder.path().join("steps.json");
        done(&Complete {
            input: input.clone(),
            mask: None,
            features: None,
            sources: Vec::new(),
            replay,
            recorded: None,
            steps: fragments.then(|| steps.clone()),
            output: output.clone(),
            params: complete::Params {
                planes: vec![corners(centers, &rough())],
                polygons: vec![corners(centers, &polygon)],
                pixel_centers: centers,
                ..complete::Params::default()
            },
        });
        let steps = fragments.then(|| std::fs::read_to_string(&steps).unwrap());
        (bytes(&output), steps.unwrap_or_default())
    };
    let [half, integer] = BOTH.map(|centers| run(centers, false, None));
    assert!(half.0 == integer.0);
    let [half, integer] = BOTH.map(|centers| run(centers, true, None));
    assert!(half.0 == integer.0);
    let json = |text: &str| serde_json::from_str::<Value>(text).unwrap();
    let (a, b) = (json(&half.1), json(&integer.1));
    assert_eq!(b["pixel_centers"], "integer");
    assert_half_apart(
        &a["steps"][0]["target"]["at"],
        &b["steps"][0]["target"]["at"],
    );
    // a file is read as it says, whatever the command writes
    let file = folder.path().join("integer.json");
    crate::files::write_text(&file, &integer.1).unwrap();
    let replayed = run(PixelCenters::Half, true, Some(file));
    assert!(replayed.0 == half.0);
}

//! `plate` on drawn clips.

use super::*;
use crate::ErrorKind;
use ravec::raster::Size;
use ravec_media::Limits;

const SIZE: (usize, usize) = (96, 72);

/// The background, `shift` pixels to the left.
fn background(x: f64, y: f64) -> [f64; 3] {
    let wave = 30.0 * (0.3 * x).sin() * (0.2 * y).cos();
    [140.0 + wave, 130.0 - wave, 120.0]
}

/// A frame of a camera that pans, with a bar before it.
fn frame(index: usize, bar: usize) -> Image<Srgb<u8>> {
    Image::from_fn(Size::new(SIZE.0, SIZE.1).unwrap(), |col, row| {
        let covered = (bar..bar + 8).contains(&col) && (20..60).contains(&row);
        let color = background(col as f64 + 0.5 * index as f64, row as f64);
        let color = if covered { [220.0, 30.0, 40.0] } else { color };
        Srgb(color.map(|value| value.round() as u8))
    })
}

/// A folder with a clip of pictures, its track, and strokes on the bar in a frame.
fn shot(bar: impl Fn(usize) -> usize) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let save = |name: &str, image: Image<Srgb<u8>>| {
        let picture = Picture::from_image(AnyImage::from(image));
        ravec_media::write(at(name), &picture, &WriteOptions::default()).unwrap();
    };
    let mut maps = Vec::new();
    for index in 0..16 {
        save(&format!("f_{index:02}.png"), frame(index, bar(index)));
        maps.push([1.0, 0.0, -0.5 * index as f64, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
    }
    let track = serde_json::json!({ "frame_from_reference": maps });
    crate::files::write_text(&at("track.json"), &track.to_string()).unwrap();
    let stroke = Image::from_fn(Size::new(SIZE.0, SIZE.1).unwrap(), |col, row| {
        let inside = (bar(0) + 2..bar(0) + 6).contains(&col) && (24..56).contains(&row);
        Srgb([if inside { 255u8 } else { 128 }; 3])
    });
    save("stroke_0000.png", stroke);
    folder
}

fn operation(folder: &Path) -> Plate {
    Plate {
        input: folder.join("f_%02d.png"),
        output: folder.join("plate.png"),
        track: Some(folder.join("track.json")),
        exclude: None,
        strokes: None,
        seen: Some(folder.join("seen.png")),
        certainty: Some(folder.join("certainty.png")),
        regions: None,
        params: Params {
            pad: 6,
            ..Params::default()
        },
    }
}

fn read(path: &Path) -> Image<Srgb<u8>> {
    ravec_media::read(path, &Limits::default())
        .unwrap()
        .convert()
}

/// The largest difference to the background over the pixels of the reference frame.
fn largest_error(plate: &Image<Srgb<u8>>) -> f64 {
    let mut largest = 0.0f64;
    for row in 4..SIZE.1 - 4 {
        for col in 4..SIZE.0 - 4 {
            let truth = background(col as f64, row as f64);
            let found = plate[(col + 6, row + 6)].0;
            for (found, truth) in found.into_iter().zip(truth) {
                largest = largest.max((f64::from(found) - truth).abs());
            }
        }
    }
    largest
}

#[test]
fn a_camera_that_moves_without_a_track_is_a_warning() {
    let folder = tempfile::tempdir().unwrap();
    for index in 0..12 {
        // a wall of stones that passes by: a pixel shows four of them in turn
        let wall = Image::from_fn(Size::new(64, 48).unwrap(), |col, row| {
            Srgb([((col + 3 * index) / 12 * 67 + row / 12 * 151) as u8; 3])
        });
        let picture = Picture::from_image(AnyImage::from(wall));
        let path = folder.path().join(format!("f_{index:02}.png"));
        ravec_media::write(path, &picture, &WriteOptions::default()).unwrap();
    }
    let plate = Plate {
        track: None,
        params: Params::default(),
        ..operation(folder.path())
    };
    let report = plate.run(&Context::default()).unwrap();
    assert!(report.figures["agreeing_percent"] < 60.0);
    let warnings = report.warnings.join("\n");
    assert!(warnings.contains("ravec track"), "{warnings}");
}

#[test]
fn a_bar_that_passes_is_not_on_the_plate() {
    let folder = shot(|index| 10 + 5 * index);
    let plate = operation(folder.path());
    let report = plate.run(&Context::default()).unwrap();
    assert_eq!(report.figures["frames"], 16.0);
    assert!(report.figures["seen_percent"] > 68.0 && report.figures["certainty"] > 0.8);
    assert!(report.figures["agreeing_percent"] > 95.0);
    assert!(report.warnings.is_empty(), "{:?}", report.warnings);
    let made = read(&plate.output);
    assert_eq!(made.size(), Size::new(SIZE.0 + 12, SIZE.1 + 12).unwrap());
    assert!(largest_error(&made) < 6.0, "{}", largest_error(&made));
    let seen = read(&folder.path().join("seen.png"));
    assert_eq!([seen[(0, 0)].0[0], seen[(50, 40)].0[0]], [0, 255]);
    // beyond all frames the plate is transparent, where the format can be
    let made: Image<Srgba<u8>> = ravec_media::read(&plate.output, &Limits::default())
        .unwrap()
        .convert();
    assert_eq!([made[(0, 0)].0[3], made[(50, 40)].0[3]], [0, 255]);
    let mut photo = plate;
    photo.output = folder.path().join("plate.jpg");
    let report = photo.run(&Context::default()).unwrap();
    assert!(report.warnings.is_empty(), "{:?}", report.warnings);
}

#[test]
fn what_is_always_covered_is_completed_or_transparent_once_it_is_marked() {
    let folder = shot(|index| 40 - index / 2 + index % 5);
    let mut plate = operation(folder.path());
    plate.strokes = Some(folder.path().join("stroke_%04d.png"));
    let report = plate.run(&Context::default()).unwrap();
    assert!(report.figures["invented_px"] > 100.0);
    let middle = read(&plate.output)[(52, 46)].0;
    assert!(middle[0] < 190 && middle[1] > 80, "{middle:?}");
    plate.params.unseen = Unseen::Transparent;
    plate.run(&Context::default()).unwrap();
    let made: Image<Srgba<u8>> = ravec_media::read(&plate.output, &Limits::default())
        .unwrap()
        .convert();
    assert_eq!([made[(52, 46)].0[3], made[(20, 20)].0[3]], [0, 255]);
}

#[test]
fn parameters_out_of_range_and_quadrilaterals_beside_the_frames_are_refused() {
    let folder = shot(|index| index);
    let plate = operation(folder.path());
    let refused = |change: &dyn Fn(&mut Params)| {
        let mut other = plate.clone();
        change(&mut other.params);
        let error = other.run(&Context::default()).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Request, "{error}");
    };
    refused(&|params| params.plane = 0);
    refused(&|params| params.pad = 1 << 20);
    // a plate of a thousand million pixels
    refused(&|params| params.pad = 1 << 14);
    refused(&|params| params.quad = Some("500,500,600,500,600,600,500,600".parse().unwrap()));
    assert!(!plate.output.exists());
}

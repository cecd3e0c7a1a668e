//! `track` on clips whose motion is known.

use super::file::TrackFile;
use super::*;
use crate::ErrorKind;
use crate::ErrorKind::{Failure, Input, Request};
use glam::dvec2;
use ravec::planar::Homography;
use ravec::planar::track::TrackState;
use ravec::raster::{AnyImage, Image, Srgb};
use ravec_media::{Picture, WriteOptions};
use ravec_scenes::Seed;
use ravec_scenes::clip::{ClipId, clip};

/// A wall that is filmed from the hand, as numbered pictures, and its truth.
pub(crate) struct Wall {
    pub folder: tempfile::TempDir,
    pub truth: ravec_scenes::clip::Clip,
}

pub(crate) const FRAMES: usize = 9;

pub(crate) fn wall_size() -> Size {
    Size::new(320, 240).unwrap()
}

impl Wall {
    pub fn new() -> Self {
        Self::with(|_, image| image)
    }

    /// The frames, changed by their numbers.
    pub fn with(change: impl Fn(usize, Image<Srgb<u8>>) -> Image<Srgb<u8>>) -> Self {
        let mut truth = clip(ClipId::HandheldWall, wall_size(), 50, Seed(4));
        truth.noise_sigma = 1.0;
        let folder = tempfile::tempdir().unwrap();
        for index in 0..FRAMES {
            let image = change(index, truth.frame(index).stored());
            save(&folder.path().join(format!("f_{index:04}.png")), image);
        }
        Self { folder, truth }
    }

    pub fn clip(&self) -> PathBuf {
        self.at("f_%04d.png")
    }

    pub fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Map of the background from frame `reference` to frame `index`.
    pub fn map(&self, index: u64, reference: u64) -> Homography {
        let matrix = self
            .truth
            .frame_from_frame(index as usize, reference as usize);
        Homography::from_matrix(matrix.unwrap()).unwrap()
    }

    fn operation(&self, output: &str) -> Track {
        Track {
            input: self.clip(),
            output: Some(Export {
                format: None,
                path: self.at(output),
            }),
            exports: Vec::new(),
            show: None,
            track: None,
            mask: None,
            exclude: None,
            strokes: None,
            photo: None,
            params: Params {
                quads: vec![Quad(quad())],
                ..Params::default()
            },
        }
    }

    fn read(&self, name: &str) -> TrackFile {
        let text = std::fs::read_to_string(self.at(name)).unwrap();
        TrackFile::from_json(&text, 1000).unwrap()
    }

    /// Runs the operation and reads its only plane.
    fn tracked(&self, operation: &Track) -> (ravec::planar::track::Track, Report) {
        let report = operation.run(&Context::default()).unwrap();
        let path = &operation.output.as_ref().unwrap().path;
        let mut file = self.read(path.file_name().unwrap().to_str().unwrap());
        assert_eq!(file.planes.len(), 1);
        (file.planes.remove(0), report)
    }

    fn assert_true(&self, track: &ravec::planar::track::Track) {
        for (index, frame) in (track.first..).zip(&track.frames) {
            let map = self.map(index, track.reference);
            for k in 0..4 {
                let error = frame.corners[k].distance(map.apply(quad()[k]));
                assert!(error < 0.3, "frame {index}, corner {k}: {error}");
                let through = frame.frame_from_reference.apply(quad()[k]);
                assert!(through.distance(frame.corners[k]) < 1e-6);
            }
            assert_ne!(frame.state, TrackState::Lost, "frame {index}");
        }
    }
}

pub(crate) fn save(path: &Path, image: impl Into<AnyImage>) {
    let picture = Picture::from_image(image);
    ravec_media::write(path, &picture, &WriteOptions::default()).unwrap();
}

fn quad() -> [DVec2; 4] {
    [
        dvec2(80.0, 60.0),
        dvec2(240.0, 64.0),
        dvec2(236.0, 180.0),
        dvec2(84.0, 176.0),
    ]
}

/// Noise without any structure.
pub(crate) fn noise(index: usize) -> Image<Srgb<u8>> {
    let mut state = 1 + index as u64;
    Image::from_fn(wall_size(), |_, _| {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        Srgb([(state >> 56) as u8; 3])
    })
}

fn even(value: u8) -> Image<Srgb<u8>> {
    Image::new(wall_size(), Srgb([value; 3]))
}

#[test]
fn a_track_is_true_and_comes_back_from_its_file_into_exports() {
    let wall = Wall::new();
    let mut operation = wall.operation("track.json");
    operation.exports = ["c.txt", "c.csv", "c.nk", "c.aekf.txt", "c.py"]
        .map(|name| wall.at(name).to_str().unwrap().parse().unwrap())
        .into();
    operation.show = Some(wall.at("g_%04d.png"));
    let (track, report) = wall.tracked(&operation);
    assert_eq!((track.first, track.frames.len()), (0, FRAMES));
    wall.assert_true(&track);
    assert_eq!(report.figures["frames"], FRAMES as f64);
    assert_eq!(report.figures["lost"], 0.0);
    assert!(report.figures["sigma_px_max"] < 0.5, "{:?}", report.figures);
    assert!(report.warnings.is_empty(), "{:?}", report.warnings);
    let phases: Vec<_> = report.timings.iter().map(|timing| timing.phase).collect();
    assert!(phases.contains(&"decode") && phases.contains(&"track"));
    let corners = std::fs::read_to_string(wall.at("c.txt")).unwrap();
    assert_eq!(corners.lines().count(), FRAMES);
    // a green line goes through the first corner in the first frame
    let shown = ravec_media::read(wall.at("g_0000.png"), &ravec_media::Limits::default());
    let shown: Image<Srgb<u8>> = shown.unwrap().convert();
    let Srgb([r, g, _]) = shown[(80, 60)];
    assert!(g > 150 && g > r, "{:?}", shown[(80, 60)]);
    assert!(wall.at(&format!("g_{:04}.png", FRAMES - 1)).is_file());
    // the same exports from the file
    let mut again = wall.operation("again.txt");
    again.params.quads.clear();
    again.track = Some(wall.at("track.json"));
    again.run(&Context::default()).unwrap();
    let numbers = |text: &str| -> Vec<f64> {
        text.split_whitespace()
            .map(|word| word.parse().unwrap())
            .collect()
    };
    let from_file = std::fs::read_to_string(wall.at("again.txt")).unwrap();
    for (a, b) in numbers(&corners).iter().zip(numbers(&from_file)) {
        assert!((a - b).abs() < 1e-9);
    }
}

#[test]
fn planes_are_followed_backward_and_in_ranges() {
    let wall = Wall::new();
    for (reference, frames, first, count) in [
        (FRAMES as u64 - 1, None, 0, FRAMES),
        (5, Some("3..8"), 3, 5),
        (5, Some("5.."), 5, FRAMES - 5),
        (6, Some("0.16s..7"), 4, 3),
    ] {
        let mut operation = wall.operation("track.json");
        operation.params.reference = Some(reference);
        operation.params.frames = frames.map(|range: &str| range.parse().unwrap());
        let (track, _) = wall.tracked(&operation);
        assert_eq!(
            (track.reference, track.first, track.frames.len()),
            (reference, first, count)
        );
        assert_eq!(
            track.frame(reference).unwrap().frame_from_reference,
            Homography::IDENTITY
        );
        wall.assert_true(&track);
    }
}

#[test]
fn integer_pixel_centers_are_the_same_half_a_pixel_off() {
    let wall = Wall::new();
    let mut half = wall.operation("half.json");
    half.params.frames = "..4".parse().ok();
    let mut integer = wall.operation("integer.json");
    integer.params.frames = half.params.frames;
    integer.params.pixel_centers = PixelCenters::Integer;
    integer.params.quads = vec![Quad(PixelCenters::Integer.write_all(quad()))];
    let (a, report_a) = wall.tracked(&half);
    let (b, report_b) = wall.tracked(&integer);
    for (a, b) in a.frames.iter().zip(&b.frames) {
        for k in 0..4 {
            // read back, both are at half-integers
            assert!(a.corners[k].distance(b.corners[k]) < 1e-9);
        }
    }
    let corner = |report: &Report| {
        report.result.as_ref().unwrap()["planes"][0]["quad"][0][0]
            .as_f64()
            .unwrap()
    };
    assert!((corner(&report_a) - corner(&report_b) - 0.5).abs() < 1e-12);
    let json: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(wall.at("integer.json")).unwrap()).unwrap();
    assert_eq!(json["pixel_centers"], "integer");
    let written = json["corners"][2][3].as_f64().unwrap();
    assert!((written + 0.5 - a.frames[2].corners[1].y).abs() < 1e-9);
}

#[test]
fn corners_corrected_by_hand_are_kept_exactly() {
    let wall = Wall::new();
    wall.tracked(&wall.operation("track.json"));
    let moved = wall.map(4, 0);
    let corners = quad().map(|corner| moved.apply(corner) + dvec2(1.5, -1.0));
    let mut operation = wall.operation("better.json");
    operation.params.quads.clear();
    operation.track = Some(wall.at("track.json"));
    operation.params.corrections = vec![FrameQuad {
        frame: 4,
        quad: Quad(corners),
    }];
    let (track, _) = wall.tracked(&operation);
    for (k, corner) in corners.into_iter().enumerate() {
        assert!(track.frames[4].corners[k].distance(corner) < 1e-9);
        assert!(track.frames[0].corners[k].distance(quad()[k]) < 1e-9);
    }
    operation.params.corrections[0].frame = 99;
    let error = operation.run(&Context::default()).unwrap_err();
    assert!(matches!(error, JobError::Correct { .. }) && error.kind() == ErrorKind::Request);
}

#[test]
fn a_measurement_is_watched_frame_by_frame_and_equals_the_run() {
    let wall = Wall::new();
    let mut operation = wall.operation("track.json");
    operation.params.reference = Some(4);
    let moved = wall.map(6, 4);
    operation.params.corrections = vec![FrameQuad {
        frame: 6,
        quad: Quad(quad().map(|corner| moved.apply(corner) + dvec2(0.5, 0.5))),
    }];
    let (track, _) = wall.tracked(&operation);
    let seen = std::sync::Mutex::new(Vec::new());
    let watch = |frame: u64, planes: &[TrackedFrame]| {
        assert_eq!(planes.len(), 1);
        seen.lock().unwrap().push(frame);
    };
    let measured = operation.measure(&watch, &Context::default()).unwrap();
    assert_eq!(seen.into_inner().unwrap(), [4, 5, 6, 7, 8, 3, 2, 1, 0]);
    let corrected = operation.corrected(&measured[0]).unwrap();
    let written = operation.params.pixel_centers;
    let file = TrackFile {
        centers: written,
        planes: vec![corrected],
    };
    let read = TrackFile::from_json(&file.to_json(), 100).unwrap();
    assert_eq!(read.planes[0], track);
}

#[test]
fn frames_of_noise_are_named_and_nothing_but_noise_is_a_failure() {
    let wall = Wall::with(|index, image| {
        if matches!(index, 4 | 5) {
            noise(index)
        } else {
            image
        }
    });
    let mut operation = wall.operation("track.json");
    operation.exports = vec![wall.at("c.csv").to_str().unwrap().parse().unwrap()];
    let (track, report) = wall.tracked(&operation);
    for (index, frame) in track.frames.iter().enumerate() {
        let lost = matches!(index, 4 | 5);
        assert_eq!(frame.state == TrackState::Lost, lost, "frame {index}");
    }
    assert_eq!(report.warnings, ["the plane is lost in frames 4 to 5"]);
    assert_eq!(report.figures["first_lost"], 4.0);
    let csv = std::fs::read_to_string(wall.at("c.csv")).unwrap();
    assert!(csv.lines().nth(5).unwrap().starts_with("4,lost,"));
    let hopeless = Wall::with(|index, image| if index > 0 { noise(index) } else { image });
    let operation = hopeless.operation("track.json");
    let error = operation.run(&Context::default()).unwrap_err();
    assert!(
        matches!(error, JobError::TrackLost { .. }) && error.kind() == ErrorKind::Failure,
        "{error}"
    );
    assert!(!hopeless.at("track.json").exists());
}

/// What is excluded is not seen: where all of a frame is, the plane is lost.
#[test]
fn masks_and_strokes_apply_to_their_frames() {
    let wall = Wall::new();
    let lost = |operation: &Track| -> Vec<usize> {
        let (track, _) = wall.tracked(operation);
        let frames = track.frames.iter().enumerate();
        frames
            .filter(|(_, frame)| frame.state == TrackState::Lost)
            .map(|(index, _)| index)
            .collect()
    };
    let mut operation = wall.operation("track.json");
    operation.params.reference = Some(4);
    std::fs::create_dir(wall.at("strokes")).unwrap();
    save(&wall.at("strokes/s_0006.png"), even(255));
    save(&wall.at("strokes/s_0002.png"), even(255));
    save(&wall.at("strokes/s_0003.png"), even(128));
    operation.strokes = Some(wall.at("strokes"));
    assert_eq!(lost(&operation), [2, 6]);
    // a clip of masks; black strokes take back what it excludes
    save(&wall.at("strokes/s_0006.png"), even(0));
    for index in 0..FRAMES {
        let white = if matches!(index, 1 | 6) { 255 } else { 0 };
        save(&wall.at(&format!("m_{index:04}.png")), even(white));
    }
    operation.exclude = Some(wall.at("m_%04d.png"));
    assert_eq!(lost(&operation), [1, 2]);
    // a clip of masks that ends early excludes nothing afterward
    operation.strokes = None;
    for index in 5..FRAMES {
        std::fs::remove_file(wall.at(&format!("m_{index:04}.png"))).unwrap();
    }
    let (_, report) = wall.tracked(&operation);
    assert!(
        report
            .warnings
            .iter()
            .any(|text| text.contains("no mask for frame 5")),
        "{:?}",
        report.warnings
    );
}

#[test]
fn several_planes_have_files_of_their_own_or_share_one() {
    let wall = Wall::new();
    let mut operation = wall.operation("track.json");
    let other = quad().map(|corner| corner + dvec2(30.0, 20.0));
    operation.params.quads.push(Quad(other));
    operation.params.frames = "..4".parse().ok();
    operation.exports = vec![wall.at("c{plane}.txt").to_str().unwrap().parse().unwrap()];
    let report = operation.run(&Context::default()).unwrap();
    assert_eq!(report.figures["planes"], 2.0);
    assert_eq!(wall.read("track.json").planes.len(), 2);
    assert!(wall.at("c1.txt").is_file() && wall.at("c2.txt").is_file());
    operation.exports = vec![wall.at("c.txt").to_str().unwrap().parse().unwrap()];
    let error = operation.run(&Context::default()).unwrap_err();
    assert!(error.to_string().contains("{plane}"), "{error}");
}

#[test]
fn a_photo_of_the_plane_is_found_on_it() {
    let wall = Wall::new();
    let frame = wall.truth.frame(0).stored();
    let crop: Image<Srgb<u8>> = Image::from_fn(Size::new(200, 150).unwrap(), |col, row| {
        frame[(col + 60, row + 45)]
    });
    save(&wall.at("photo.png"), crop);
    let mut operation = wall.operation("track.json");
    operation.params.frames = "..3".parse().ok();
    operation.photo = Some(wall.at("photo.png"));
    operation.show = Some(wall.at("g_%d.png"));
    let (_, report) = wall.tracked(&operation);
    let photo = &report.result.unwrap()["photo"];
    let rows: Vec<f64> = photo["reference_from_photo"]
        .as_array()
        .unwrap()
        .iter()
        .map(|number| number.as_f64().unwrap())
        .collect();
    let truth = [1.0, 0.0, 60.0, 0.0, 1.0, 45.0, 0.0, 0.0, 1.0];
    for (found, truth) in rows.iter().zip(truth) {
        assert!((found - truth).abs() < 0.2, "{photo}");
    }
    assert!(wall.at("g_2.png").is_file());
    save(&wall.at("photo.png"), noise(0));
    let error = operation.run(&Context::default()).unwrap_err();
    assert!(matches!(error, JobError::Photo { .. }), "{error}");
}

#[test]
fn requests_that_make_no_sense_are_refused() {
    let wall = Wall::new();
    let refused = |change: &dyn Fn(&mut Track), kind: ErrorKind, part: &str| {
        let mut operation = wall.operation("track.json");
        change(&mut operation);
        let error = operation.run(&Context::default()).unwrap_err();
        assert_eq!(error.kind(), kind, "{error}");
        assert!(error.to_string().contains(part), "no `{part}` in: {error}");
        assert!(!wall.at("track.json").exists());
    };
    refused(&|o| o.params.quads.clear(), Request, "`quads` or `track`");
    refused(&|o| o.output = None, Request, "`output`");
    refused(
        &|o| o.params.quads[0].0[1] = dvec2(85.0, 170.0),
        Request,
        "no rectangle",
    );
    refused(
        &|o| o.params.quads[0] = Quad(quad().map(|c| c + 1000.0)),
        Request,
        "outside the picture",
    );
    refused(
        &|o| o.params.reference = Some(99),
        Request,
        "`reference` is 99",
    );
    refused(
        &|o| {
            o.params.frames = "4..".parse().ok();
            o.params.reference = Some(2);
        },
        Request,
        "`reference` is 2",
    );
    refused(
        &|o| o.params.frames = "99..".parse().ok(),
        Input,
        "no frames in the range",
    );
    refused(
        &|o| o.params.encoding.lossless = true,
        Request,
        "`lossless`",
    );
    refused(
        &|o| o.track = Some(wall.at("t.json")),
        Request,
        "give one of the two",
    );
    save(
        &wall.at("small.png"),
        Image::new(Size::new(9, 9).unwrap(), Srgb([255u8; 3])),
    );
    refused(&|o| o.mask = Some(wall.at("small.png")), Input, "9 x 9");
    refused(&|o| o.exclude = Some(wall.at("small.png")), Input, "9 x 9");
    refused(
        &|o| o.strokes = Some(wall.at("nothing_%d.png")),
        Input,
        "stroke_0040.png",
    );
    save(&wall.at("black.png"), even(0));
    refused(
        &|o| o.mask = Some(wall.at("black.png")),
        Failure,
        "too little texture",
    );
    let of_track = |text: &str, part: &str| {
        crate::files::write_text(&wall.at("t.json"), text).unwrap();
        refused(
            &|o| {
                o.params.quads.clear();
                o.track = Some(wall.at("t.json"));
            },
            Input,
            part,
        );
    };
    of_track("{}", "it is no track");
    of_track("", "it is empty");
    let other = TrackFile {
        centers: PixelCenters::Half,
        planes: vec![file::tests::track()],
    };
    of_track(&other.to_json(), "640 x 480");
}

#[test]
fn a_cancelled_run_writes_nothing() {
    let wall = Wall::new();
    let progress = ravec::progress::Progress::new(|_| ());
    progress.cancel();
    let error = wall
        .operation("track.json")
        .run(&Context::new(&progress))
        .unwrap_err();
    assert!(matches!(error, JobError::Cancelled));
    assert!(!wall.at("track.json").exists());
}

//! Clips through the operations that read and write them.

#![allow(
    clippy::disallowed_methods,
    reason = "tests may write files as they like"
)]

use ravec::progress::Progress;
use ravec::raster::{AnyImage, Image, Size, Srgb};
use ravec_jobs::compare::Compare;
use ravec_jobs::twocolor::TwoColor;
use ravec_jobs::video::convert::{self, Convert};
use ravec_jobs::video::frames::{self, Frames};
use ravec_jobs::video::info::{self, Info};
use ravec_jobs::{Context, ErrorKind, JobError, Operation, Report, brush, twocolor};
use ravec_video::{
    CHUNK_FRAMES, Clip, ClipWriter, CreateOptions, Frame, FramePicture, FrameSource as _,
    FrameTime, OpenOptions, PixelKind, Rational, SinkFormat,
};
use std::path::{Path, PathBuf};

fn size() -> Size {
    Size::new(24, 16).unwrap()
}

/// A gray step that moves; its value is the number of the frame.
fn picture(at: u64) -> Image<Srgb<u8>> {
    Image::from_fn(size(), |col, row| {
        let value = if col as u64 > at % 24 {
            200
        } else {
            (at % 250) as u8
        };
        Srgb([value, value, row as u8])
    })
}

/// Writes a clip at 25 frames a second; `times` gives start and duration of each frame in ticks.
fn write_clip(path: &Path, times: impl Iterator<Item = (i64, u64)>, ticks: u32) {
    let format = SinkFormat {
        size: size(),
        pixels: PixelKind::Rgb {
            depth: 8,
            alpha: false,
        },
        time_base: Rational::new(1, ticks).unwrap(),
        rate: None,
        pixel_aspect: Rational::ONE,
    };
    let mut options = CreateOptions::default();
    options.encode.lossless = path.extension().is_some_and(|extension| extension == "y4m");
    let mut writer = ClipWriter::create(path, &format, &options).unwrap();
    for (at, (start, duration)) in times.enumerate() {
        let picture = FramePicture::Image(picture(at as u64).into());
        let time = FrameTime { start, duration };
        writer.write(&Frame { picture, time }).unwrap();
    }
    writer.finish().unwrap();
}

fn clip(folder: &Path, frames: u64) -> PathBuf {
    let path = folder.join("clip.y4m");
    write_clip(&path, (0..frames).map(|at| (at as i64, 1)), 25);
    path
}

fn images(path: &Path) -> Vec<Image<Srgb<u8>>> {
    let mut clip = Clip::open(path, &OpenOptions::default()).unwrap();
    let mut images = Vec::new();
    while let Some(frame) = clip.next_frame().unwrap() {
        images.push(frame.picture.into_image().convert());
    }
    images
}

fn convert(input: &Path, output: &Path, params: convert::Params) -> Result<Report, JobError> {
    convert_in(&Context::default(), input, output, params)
}

fn convert_in(
    context: &Context,
    input: &Path,
    output: &Path,
    params: convert::Params,
) -> Result<Report, JobError> {
    let operation = Convert {
        input: input.to_path_buf(),
        output: output.to_path_buf(),
        params,
    };
    operation.run(context)
}

#[test]
fn a_range_of_frames_is_the_same_by_number_and_by_time() {
    let folder = tempfile::tempdir().unwrap();
    let source = clip(folder.path(), 20);
    let output = folder.path().join("part.y4m");
    for range in ["5..9", "0.2s..0.36s"] {
        let params = convert::Params {
            frames: Some(range.parse().unwrap()),
            ..convert::Params::default()
        };
        let report = convert(&source, &output, params).unwrap();
        assert_eq!(report.figures["frames"], 4.0, "{range}");
        let found = images(&output);
        let truth: Vec<_> = (5..9).map(picture).collect();
        assert!(found == truth, "{range}");
    }
    let params = convert::Params {
        frames: Some("30..".parse().unwrap()),
        ..convert::Params::default()
    };
    let error = convert(&source, &output, params).unwrap_err();
    assert!(matches!(error, JobError::EmptyRange { .. }), "{error}");
}

#[test]
fn another_rate_repeats_frames_and_keeps_the_duration() {
    let folder = tempfile::tempdir().unwrap();
    let source = clip(folder.path(), 10);
    let output = folder.path().join("fast.y4m");
    let params = convert::Params {
        rate: Rational::new(50, 1),
        ..convert::Params::default()
    };
    let report = convert(&source, &output, params).unwrap();
    assert_eq!(report.figures["frames"], 20.0);
    assert_eq!(report.figures["duration_secs"], 0.4);
    let truth: Vec<_> = (0..20).map(|at| picture(at / 2)).collect();
    assert!(images(&output) == truth);
}

#[test]
fn stamps_of_a_variable_rate_are_kept_or_their_loss_is_reported() {
    let folder = tempfile::tempdir().unwrap();
    let source = folder.path().join("clip.gif");
    let times = [(0, 4), (4, 10), (14, 3)];
    write_clip(&source, times.into_iter(), 100);
    let kept = folder.path().join("kept.apng");
    let report = convert(&source, &kept, convert::Params::default()).unwrap();
    assert!(report.warnings.is_empty(), "{:?}", report.warnings);
    let mut clip = Clip::open(&kept, &OpenOptions::default()).unwrap();
    for (start, _) in times {
        let frame = clip.next_frame().unwrap().unwrap();
        assert_eq!(frame.time.start, start * 10_000_000);
    }
}

#[test]
fn clips_shrink_by_one_side_and_become_pictures() {
    let folder = tempfile::tempdir().unwrap();
    let source = clip(folder.path(), 3);
    let pattern = folder.path().join("small_%02d.png");
    let params = convert::Params {
        size: Some("12x".parse().unwrap()),
        ..convert::Params::default()
    };
    convert(&source, &pattern, params).unwrap();
    let small = images(&pattern);
    assert_eq!(small.len(), 3);
    assert_eq!((small[0].width(), small[0].height()), (12, 8));
    assert!(folder.path().join("small_00.png").exists());
}

#[test]
fn single_frames_are_written_under_their_numbers() {
    let folder = tempfile::tempdir().unwrap();
    let input = clip(folder.path(), 12);
    let run = |output: &str, params: frames::Params| {
        let output = folder.path().join(output);
        let input = input.clone();
        Frames {
            input,
            output,
            params,
        }
        .run(&Context::default())
    };
    let every = frames::Params {
        every: 5,
        ..frames::Params::default()
    };
    let report = run("f_%02d.png", every).unwrap();
    assert_eq!(report.figures["frames"], 3.0);
    for at in [0, 5, 10] {
        let path = folder.path().join(format!("f_{at:02}.png"));
        let found = ravec_media::read(path, &ravec_media::Limits::default()).unwrap();
        // the planes have ten bits
        assert!(matches!(found.image, AnyImage::Srgb16(_)));
        assert!(found.image.convert::<Srgb<u8>>() == picture(at));
    }
    let at = |frame: &[u64]| frames::Params {
        at: frame.to_vec(),
        ..frames::Params::default()
    };
    assert_eq!(
        run("still.png", at(&[7])).unwrap().result.unwrap()[0]["frame"],
        7
    );
    assert_eq!(
        run("still.png", at(&[7, 8])).unwrap_err().kind(),
        ErrorKind::Request
    );
    assert_eq!(
        run("still.png", at(&[])).unwrap_err().kind(),
        ErrorKind::Request
    );
    assert_eq!(
        run("still.png", at(&[12])).unwrap_err().kind(),
        ErrorKind::Input
    );
}

#[test]
fn the_description_has_what_the_file_states_and_what_was_counted() {
    let folder = tempfile::tempdir().unwrap();
    let input = clip(folder.path(), 7);
    let data = std::fs::read(&input).unwrap();
    std::fs::write(&input, &data[..data.len() - 1]).unwrap();
    let params = info::Params { count: true };
    let report = Info { input, params }.run(&Context::default()).unwrap();
    let result = report.result.unwrap();
    assert_eq!(result["container"], "y4m");
    assert_eq!(result["size"], serde_json::json!([24, 16]));
    assert_eq!(result["rate"], "25/1");
    assert_eq!(result["counted"]["frames"], 6);
    assert_eq!(result["counted"]["damage"]["frames"], 6);
    assert_eq!(report.warnings.len(), 1);
}

#[test]
fn an_interrupted_run_goes_on_with_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let source = folder.path().join("clip.y4m");
    write_clip(
        &source,
        (0..CHUNK_FRAMES as i64 * 2 + 9).map(|at| (at, 1)),
        25,
    );
    let whole = folder.path().join("whole.y4m");
    let params = |resume| {
        let mut params = convert::Params {
            size: Some("50%".parse().unwrap()),
            ..convert::Params::default()
        };
        params.encoding.resume = resume;
        params
    };
    convert(&source, &whole, params(false)).unwrap();
    for check in [3, CHUNK_FRAMES + 20, 2 * CHUNK_FRAMES + 5] {
        let output = folder.path().join(format!("part{check}.y4m"));
        let stopped = Context::new(&Progress::cancelled_at(check));
        let error = convert_in(&stopped, &source, &output, params(false)).unwrap_err();
        assert!(matches!(error, JobError::Cancelled));
        assert!(!output.exists());
        convert(&source, &output, params(true)).unwrap();
        assert!(std::fs::read(&output).unwrap() == std::fs::read(&whole).unwrap());
    }
    let left = std::fs::read_dir(folder.path()).unwrap();
    let hidden = left.filter(|entry| {
        entry
            .as_ref()
            .unwrap()
            .file_name()
            .to_string_lossy()
            .starts_with('.')
    });
    assert_eq!(hidden.count(), 0);
}

#[test]
fn no_output_takes_the_place_of_an_input() {
    let folder = tempfile::tempdir().unwrap();
    let source = clip(folder.path(), 3);
    let error = convert(&source, &source, convert::Params::default()).unwrap_err();
    assert!(matches!(error, JobError::OverwritesInput { .. }), "{error}");
    let pattern = folder.path().join("f_%d.png");
    convert(&source, &pattern, convert::Params::default()).unwrap();
    let error = convert(&pattern, &pattern, convert::Params::default()).unwrap_err();
    assert!(matches!(error, JobError::OverwritesInput { .. }), "{error}");
    // another spelling of the same files
    let alias = folder.path().join("f_%01d.png");
    let error = convert(&pattern, &alias, convert::Params::default()).unwrap_err();
    assert!(matches!(error, JobError::OverwritesInput { .. }), "{error}");
    assert_eq!(images(&pattern).len(), 3);
}

#[test]
fn operations_on_pictures_take_clips() {
    let folder = tempfile::tempdir().unwrap();
    let input = clip(folder.path(), 4);
    let blocks = folder.path().join("blocks.y4m");
    let operation = TwoColor {
        input: input.clone(),
        output: Some(blocks.clone()),
        svg: None,
        params: twocolor::Params {
            size: 4,
            scale: 2.0,
            ..twocolor::Params::default()
        },
    };
    let report = operation.run(&Context::default()).unwrap();
    assert_eq!(report.figures["frames"], 4.0);
    assert_eq!(report.figures["blocks"], 24.0);
    assert_eq!(images(&blocks)[0].width(), 48);
    let output = folder.path().join("smooth_%d.png");
    let operation = brush::Brush {
        input: input.clone(),
        output: output.clone(),
        everywhere: true,
        stroke: None,
        strokes: None,
        mask: None,
        params: brush::Params::default(),
    };
    operation.run(&Context::default()).unwrap();
    let plot = folder.path().join("psnr.svg");
    let operation = Compare {
        a: input.clone(),
        b: output,
        plot: Some(plot.clone()),
        params: ravec_jobs::compare::Params::default(),
    };
    let report = operation.run(&Context::default()).unwrap();
    assert_eq!(report.figures["frames"], 4.0);
    assert!(report.figures["psnr_db"] > 25.0);
    assert!(report.figures["min_psnr_db"] <= report.figures["psnr_db"]);
    assert_eq!(report.result.unwrap().as_array().unwrap().len(), 4);
    assert!(std::fs::read_to_string(plot).unwrap().contains("polyline"));
    let itself = Compare {
        a: input.clone(),
        b: input,
        plot: None,
        params: ravec_jobs::compare::Params::default(),
    };
    let report = itself.run(&Context::default()).unwrap();
    assert_eq!(report.figures["identical"], 1.0);
    assert_eq!(report.figures["psnr_db"], f64::INFINITY);
}

#[test]
fn clips_pass_from_step_to_step_as_they_were_computed() {
    let folder = tempfile::tempdir().unwrap();
    let name = |name: &str| folder.path().join(name);
    // an uneven rate, which the last step still has
    let input = name("in.apng");
    let stamps = [(0, 40), (40, 40), (80, 100), (180, 40)];
    write_clip(&input, stamps.into_iter(), 1000);
    let steps = |between: [PathBuf; 2], output: PathBuf| {
        let [first, second] = between;
        serde_json::json!({"version": 1, "steps": [
            {"operation": "brush", "input": input, "output": first, "everywhere": true,
                "params": {"mode": "smooth"}},
            {"operation": "retarget", "input": first, "output": second,
                "params": {"sizes": ["75%x100%"]}},
            {"operation": "video convert", "input": second, "output": output,
                "params": {"frames": "1.."}},
        ]})
    };
    let run = |steps: serde_json::Value| {
        let file = name("recipe.json");
        std::fs::write(&file, steps.to_string()).unwrap();
        let params = ravec_jobs::recipe::Params::default();
        ravec_jobs::recipe::Run { file, params }.run(&Context::default())
    };
    let files = [name("a.apng"), name("b.apng")];
    run(steps(files, name("by-files.apng"))).unwrap();
    let names = ["@a", "@b"].map(PathBuf::from);
    let report = run(steps(names.clone(), name("by-names.apng"))).unwrap();
    let bytes = |file: &str| std::fs::read(name(file)).unwrap();
    assert_eq!(bytes("by-names.apng"), bytes("by-files.apng"));
    assert_eq!(images(&name("by-names.apng")).len(), 3);
    assert_eq!(report.outputs.len(), 1);
    // a clip is not a picture
    let mut wrong = steps(names, name("wrong.apng"));
    wrong["steps"][1] = serde_json::json!({"operation": "rectify", "input": "@a",
        "output": "@b", "params": {"quad": "2,2,20,2,20,14,2,14"}});
    let error = run(wrong).unwrap_err();
    assert!(error.to_string().contains("a picture"), "{error}");
}

#[test]
fn flags_of_clips_are_refused_for_pictures() {
    let folder = tempfile::tempdir().unwrap();
    let mut params = twocolor::Params::default();
    params.encoding.lossless = true;
    let operation = TwoColor {
        input: folder.path().join("photo.png"),
        output: Some(folder.path().join("out.png")),
        svg: None,
        params,
    };
    let error = operation.run(&Context::default()).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Request);
}

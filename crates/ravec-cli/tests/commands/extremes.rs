//! Pictures of extreme shape: every operation ends in time and memory in proportion to their pixels, or refuses them in one
//! sentence.
//!
//! Each command runs in an address space of its own that is limited in proportion to the picture's pixels, so that what would
//! grow with the square of a side fails at once. Time is only guarded against hanging.

use crate::pictures::{GREY, png};
use crate::program::{assert_refused, done, folder, ravec};
use std::fs::File;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// The memory that the program may ask for: so much in any case, for its threads, its code and what is of a fixed size, and so
/// much for each pixel.
const ALWAYS_KIB: u64 = 1 << 20;
const KIB_PER_PIXEL: u64 = 1;

/// A command that runs longer hangs. All of them take seconds.
const HANG: Duration = Duration::from_mins(3);

/// Uneven numbers that do not repeat.
fn noise(index: usize) -> u8 {
    ((index as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40) as u8
}

/// Writes a picture `in.png` of uneven grays, a mask `hole.png` of its middle hundredth or at least a pixel, and a stroke from
/// end to end.
fn write_picture(folder: &Path, width: usize, height: usize) {
    let pixels = width * height;
    let write = |name: &str, samples: &[u8]| {
        let file = png(width as u32, height as u32, 8, GREY, samples);
        std::fs::write(folder.join(name), file).unwrap();
    };
    write("in.png", &(0..pixels).map(noise).collect::<Vec<_>>());
    let half = (pixels / 200).max(1);
    let middle = |index: usize| index.abs_diff(pixels / 2) < half;
    let hole: Vec<u8> = (0..pixels).map(|k| 255 * u8::from(middle(k))).collect();
    write("hole.png", &hole);
    let (right, bottom) = (width as f64 - 0.5, height as f64 - 0.5);
    let stroke = format!("[[0.5, 0.5], [{right}, {bottom}]]");
    std::fs::write(folder.join("stroke.json"), stroke).unwrap();
}

/// Runs a command on a picture of so many pixels: it succeeds, or refuses in one sentence.
#[track_caller]
fn assert_ends(folder: &Path, pixels: usize, arguments: &str) {
    let limit = ALWAYS_KIB + KIB_PER_PIXEL * pixels as u64;
    let mut command = if cfg!(unix) {
        let mut shell = Command::new("sh");
        let script = format!("ulimit -v {limit} && exec \"$0\" \"$@\"");
        shell.args(["-c", &script, env!("CARGO_BIN_EXE_ravec")]);
        shell
    } else {
        Command::new(env!("CARGO_BIN_EXE_ravec"))
    };
    let said = folder.join("said.txt");
    let mut child = command
        .args(["-q", "--threads", "2"])
        .args(arguments.split(' '))
        .current_dir(folder)
        .env_remove("RAVEC_LOG")
        .env("RUST_BACKTRACE", "0")
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(File::create(&said).unwrap())
        .spawn()
        .unwrap();
    let start = Instant::now();
    let status = loop {
        if let Some(status) = child.try_wait().unwrap() {
            break status;
        }
        if start.elapsed() > HANG {
            child.kill().unwrap();
            child.wait().unwrap();
            panic!("{arguments}: did not end within {HANG:?}");
        }
        std::thread::sleep(Duration::from_millis(2));
    };
    let said = std::fs::read_to_string(said).unwrap();
    let code = status.code();
    assert!(
        matches!(code, Some(0..=4)),
        "{arguments}: {status} with {limit} KiB: {said}"
    );
    assert!(
        !said.contains("this is a bug in ravec"),
        "{arguments}: {said}"
    );
    if code != Some(0) {
        let sentences: Vec<&str> = said
            .lines()
            .filter(|line| !line.starts_with("ravec: warning: "))
            .collect();
        assert!(
            sentences.len() == 1 && sentences[0].starts_with("ravec: error: "),
            "{arguments}: {said}"
        );
    }
}

/// The operations on a picture of a size, except those that are as dear on one pixel as on many. `QUAD` is its outline, `PART`
/// a quadrilateral within it.
const OPERATIONS: [&str; 43] = [
    "compare in.png in.png",
    "match in.png in.png -o h.txt",
    "rectify in.png --quad QUAD -o out.png",
    "rectify in.png --quad PART --aspect 2 --width 40 -o out.png",
    "snap in.png --quad QUAD -o out.png",
    "snap in.png --quad PART --grid 40x40 --reach 20 -o out.png",
    "planes in.png -o out.png",
    "complete in.png --mask hole.png -o out.png",
    "complete in.png --mask hole.png --plane QUAD -o out.png",
    "complete in.png --mask hole.png --search 65535 -o out.png",
    "complete in.png --mask hole.png --engine fragments -o out.png",
    "complete in.png --polygon PART -o out.png",
    "complete in.png --polygon PART --engine fragments --mirror --turn 45 -o out.png",
    "complete in.png --polygon PART --engine fragments --target 0.5,0.5 --turn 90 --scale 2 -o out.png",
    "retarget in.png --size 50% -o out.png --show-grid grid.png",
    "retarget in.png --size 50%x200% -o out.png --show-grid grid.svg",
    "retarget in.png --size 70%x100% --adaptive --grid 400 --borders free -o out.png",
    "retarget in.png --size 70%x100% --crop 0.5 --protect hole.png -o out.png",
    "retarget in.png --size 100x100 -o out.png",
    "twocolor in.png -o out.png --svg out.svg",
    "twocolor in.png --size 2 -o out.png",
    "twocolor in.png --size 64 -o out.png",
    "twocolor in.png --adaptive -o out.png --svg out.svg",
    "twocolor in.png --scale 3 -o out.png",
    "twocolor in.png --scale 0.01 -o out.png",
    "twocolor in.png --mosaic --scale 0.5 -o out.png",
    "twocolor in.png -o out.jpg",
    "twocolor in.png -o out.webp",
    "twocolor in.png -o out.tif",
    "twocolor in.png -o out.exr",
    "brush in.png --everywhere --mode abstract -o out.png",
    "brush in.png --everywhere --mode smooth -o out.png",
    "brush in.png --everywhere --mode sharpen -o out.png",
    "brush in.png --everywhere --mode clean -o out.png",
    "brush in.png --everywhere --mode antialias --scale 2 -o out.png",
    "brush in.png --everywhere --mode antialias --scale 0.01 -o out.png",
    "brush in.png --everywhere --mode stamp -o out.png",
    "brush in.png --stroke stroke.json --mode color --radius 4096 -o out.png",
    "brush in.png --stroke stroke.json --mode dodge --across-edges -o out.png",
    "brush in.png --stroke stroke.json --mode mask -o out.png --mask mask.png",
    "brush in.png --stroke stroke.json --mode clone --offset 3,0 -o out.png",
    "brush in.png --stroke stroke.json --mode smooth -o out.png",
    "brush in.png --stroke stroke.json --mode stamp -o out.png",
];

/// Of a catalogue, in this order.
const LIBRARY: [&str; 4] = [
    "library add in.png --catalogue photos.ravec",
    "mosaic in.png --catalogue photos.ravec --tiles 8x6 --tile-size 6 -o mosaic.png",
    "mosaic in.png --catalogue photos.ravec --tiles 8x6 --tile-size 6 --adaptive --crop center -o mosaic.png",
    "mosaic in.png --catalogue photos.ravec --tiles 8 --tile-size 6 -o mosaic.png",
];

fn filled_in(operation: &str, width: usize, height: usize) -> String {
    let (w, h) = (width as f64, height as f64);
    let outline = format!("0,0,{w},0,{w},{h},0,{h}");
    let (left, right, top, bottom) = (0.45 * w, 0.55 * w, 0.25 * h, 0.75 * h);
    let part = format!("{left},{top},{right},{top},{right},{bottom},{left},{bottom}");
    operation.replace("QUAD", &outline).replace("PART", &part)
}

/// Runs the commands on a picture of a size.
fn assert_all_end(width: usize, height: usize, operations: &[&str]) {
    let folder = tempfile::tempdir().unwrap();
    write_picture(folder.path(), width, height);
    for operation in operations {
        let arguments = filled_in(operation, width, height);
        assert_ends(folder.path(), width * height, &arguments);
    }
}

#[test]
fn a_row_of_65_535_pixels() {
    assert_all_end(65_535, 1, &OPERATIONS);
    assert_all_end(65_535, 1, &LIBRARY);
}

#[test]
fn a_column_of_20_000_pixels() {
    // a row of windows costs as much for one column as for a vector of them
    let (dear, rest): (Vec<&str>, Vec<&str>) = OPERATIONS.iter().partition(|operation| {
        let large = ["--adaptive -o", "--size 64"]
            .iter()
            .any(|flag| operation.contains(flag));
        operation.starts_with("brush") || large
    });
    assert_all_end(1, 20_000, &rest);
    assert_all_end(1, 20_000, &LIBRARY);
    assert_all_end(1, 5_000, &dear);
}

#[test]
fn one_pixel() {
    assert_all_end(1, 1, &OPERATIONS);
    assert_all_end(1, 1, &LIBRARY);
}

/// Narrow, but wide enough for windows and features.
#[test]
fn a_ribbon() {
    // beyond 30 : 1, from where copies are not turned; long ones take a while to be searched
    assert_all_end(2_000, 16, &OPERATIONS[..19]);
    let dear_only_if_unbounded = [
        "match in.png in.png -o h.txt",
        "complete in.png --mask hole.png -o out.png",
        "complete in.png --polygon PART --engine fragments --turn 45 -o out.png",
    ];
    for (width, height) in [(25_000, 16), (16, 25_000)] {
        assert_all_end(width, height, &dear_only_if_unbounded);
    }
}

#[test]
fn a_row_of_a_million_pixels() {
    let cheap = [
        "compare in.png in.png",
        "match in.png in.png -o h.txt",
        "snap in.png --quad PART --grid 20x20 -o out.png",
        "planes in.png -o out.png",
        "complete in.png --mask hole.png --engine fragments --turn 45 -o out.png",
        "retarget in.png --size 50% -o out.png --show-grid grid.png",
        "twocolor in.png -o out.png",
        "twocolor in.png -o out.jpg",
        "library add in.png --catalogue photos.ravec",
    ];
    assert_all_end(1_000_000, 1, &cheap);
    let cheap = [
        "compare in.png in.png",
        "match in.png in.png -o h.txt",
        "snap in.png --quad PART --grid 20x20 -o out.png",
        "planes in.png -o out.png",
        "retarget in.png --size 50% -o out.png --show-grid grid.png",
        "library add in.png --catalogue photos.ravec",
    ];
    assert_all_end(1, 1_000_000, &cheap);
}

/// One bit a pixel, so that the file is small. Operations that only read it and refuse, or do little.
#[test]
fn a_row_of_eight_million_pixels() {
    let folder = tempfile::tempdir().unwrap();
    let (width, height) = (8_000_000, 1);
    let bits: Vec<u8> = (0..width / 8).map(noise).collect();
    let file = png(width as u32, height as u32, 1, GREY, &bits);
    std::fs::write(folder.path().join("in.png"), file).unwrap();
    for operation in [
        "match in.png in.png -o h.txt",
        "planes in.png",
        "twocolor in.png -o out.jpg",
        "rectify in.png --quad QUAD -o out.png",
        "complete in.png --polygon 0,0,9,0,9,1,0,1 --engine fragments --turn 30 -o out.png",
    ] {
        let arguments = filled_in(operation, width, height);
        assert_ends(folder.path(), width * height, &arguments);
    }
}

/// A drawing counts in hundredths of a pixel, and so ends before a picture does.
#[test]
fn a_drawing_of_a_row_that_is_too_long_for_it_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let file = png(24_000_000, 1, 1, GREY, &vec![0xff; 3_000_000]);
    std::fs::write(folder.path().join("in.png"), file).unwrap();
    let output = ravec(folder.path(), &["twocolor", "in.png", "--svg", "out.svg"]);
    assert_refused(
        &output,
        4,
        &["out.svg", "at most 21474836 pixels", "24000000 x 1"],
    );
}

/// The demonstration reduces its picture first, and costs the same for all of them.
#[test]
fn the_demonstration_of_a_row() {
    let folder = folder();
    write_picture(folder.path(), 65_535, 1);
    done(
        folder.path(),
        "-q demo --image in.png --max-side 64 --out gallery",
    );
    assert!(folder.path().join("gallery/index.html").is_file());
}

//! Ctrl-C in the middle of the work, which takes far longer than a signal needs to arrive.
#![cfg(unix)]

use crate::meshes::torus;
use crate::pictures::bmp;
use crate::program::{done, files};
use std::io::{BufRead as _, BufReader, Read as _};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// A folder with a large picture, and older files in the places of the outputs.
fn studio() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let texture = |col: usize, row: usize| {
        let mixed = (col * 73_856_093) ^ (row * 19_349_663);
        [mixed as u8, (mixed >> 8) as u8, (col / 9 * 40) as u8]
    };
    std::fs::write(folder.path().join("large.bmp"), bmp(1600, 1200, texture)).unwrap();
    let mesh = torus(2.0, 0.8, 400, 200).stl();
    std::fs::write(folder.path().join("large.stl"), mesh).unwrap();
    for name in ["out.png", "r.json"] {
        std::fs::write(folder.path().join(name), "old").unwrap();
    }
    folder
}

/// Starts the program, waits until it says `ready`, sends it `signal`, and gives its code and the rest of what it says.
fn interrupted(folder: &Path, arguments: &str, ready: &str, signal: &str) -> (Option<i32>, String) {
    let mut child = Command::new(env!("CARGO_BIN_EXE_ravec"))
        .args(["-vv", "--json", "r.json"])
        .args(arguments.split(' '))
        .current_dir(folder)
        .env_remove("RAVEC_LOG")
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut said = BufReader::new(child.stderr.take().unwrap()).lines();
    let begun = said.by_ref().any(|line| line.unwrap().contains(ready));
    assert!(begun, "it never said `{ready}`");
    let sent = Command::new("kill")
        .args([signal, &child.id().to_string()])
        .status();
    assert!(sent.unwrap().success());
    let rest: Vec<_> = said.map(Result::unwrap).collect();
    (child.wait().unwrap().code(), rest.join("\n"))
}

#[test]
fn work_that_is_interrupted_leaves_everything_as_it_was() {
    let folder = studio();
    let before = files(folder.path());
    let slow = "--everywhere --window 21 --iterations 16";
    for (arguments, signal) in [
        (format!("brush large.bmp -o out.png {slow}"), "-INT"),
        (format!("brush large.bmp -o out.png {slow}"), "-TERM"),
        (
            "demo --image large.bmp --max-side 1600 --out gallery".to_owned(),
            "-INT",
        ),
        (
            "mesh simplify large.stl -o out.ply --error 1%".to_owned(),
            "-INT",
        ),
        (
            "offset large.stl -o out.ply --distance 2% --tolerance 0.002%".to_owned(),
            "-INT",
        ),
        (
            "mesh compare large.stl large.stl --samples 90000000".to_owned(),
            "-TERM",
        ),
    ] {
        // the input is read, and the work on it begins
        let (code, said) = interrupted(folder.path(), &arguments, "phase done", signal);
        assert_eq!(code, Some(130), "{arguments}: {said}");
        assert!(said.contains("ravec: error: interrupted"), "{said}");
        assert_eq!(files(folder.path()), before, "{arguments}");
        for name in ["out.png", "r.json"] {
            assert_eq!(std::fs::read(folder.path().join(name)).unwrap(), b"old");
        }
    }
}

#[test]
fn scenes_that_are_interrupted_are_whole_or_absent() {
    let folder = studio();
    let arguments = "scenes --out scenes --scene disc --scene street --width 640 --height 480";
    let (code, said) = interrupted(folder.path(), arguments, "drawing street", "-INT");
    assert_eq!(code, Some(130), "{said}");
    let written = files(&folder.path().join("scenes"));
    let names: Vec<_> = written
        .iter()
        .map(|path| path.file_name().unwrap())
        .collect();
    assert_eq!(names, ["disc.json", "disc.png"]);
}

/// Time after which a program that should end counts as one that hangs: far more than the tenth of a second that it needs, as
/// the machine may be busy.
const HANG: Duration = Duration::from_secs(20);

fn signal(child: &Child, signal: &str) {
    let sent = Command::new("kill")
        .args([signal, &child.id().to_string()])
        .status();
    assert!(sent.unwrap().success());
}

/// Waits for the end, and gives the code and the last words.
fn end_of(mut child: Child, what: &str) -> (Option<i32>, String) {
    let start = Instant::now();
    while child.try_wait().unwrap().is_none() {
        if start.elapsed() > HANG {
            child.kill().unwrap();
            panic!("{what}: does not end");
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    let mut said = String::new();
    let mut stderr = child.stderr.take().unwrap();
    stderr.read_to_string(&mut said).unwrap();
    (child.wait().unwrap().code(), said)
}

fn spawned(folder: &Path, arguments: &str, stdin: Stdio) -> Child {
    Command::new(env!("CARGO_BIN_EXE_ravec"))
        .args(arguments.split(' '))
        .current_dir(folder)
        .env_remove("RAVEC_LOG")
        .stdin(stdin)
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

#[test]
fn a_read_that_waits_for_ever_is_interrupted() {
    let folder = studio();
    let fifo = Command::new("mkfifo")
        .arg(folder.path().join("fifo"))
        .status();
    assert!(fifo.unwrap().success());
    let before = files(folder.path());
    for arguments in [
        "twocolor INPUT -o out.png",
        "brush large.bmp -o out.png --stroke INPUT",
        "compare large.bmp INPUT",
        "complete large.bmp --mask INPUT -o out.png",
        "mesh info INPUT",
        "offset INPUT --distance 2% -o out.ply",
        "boolean union large.stl INPUT -o out.ply",
    ] {
        for (input, signal_name) in [
            ("-", "-INT"),
            ("-", "-TERM"),
            ("fifo", "-INT"),
            ("fifo", "-TERM"),
        ] {
            let line = arguments.replace("INPUT", input);
            let child = spawned(folder.path(), &line, Stdio::piped());
            // long enough to be waiting; a signal before that is no different
            std::thread::sleep(Duration::from_millis(150));
            signal(&child, signal_name);
            let (code, said) = end_of(child, &line);
            assert_eq!(code, Some(130), "{line}: {said}");
            assert_eq!(
                said.matches("ravec: error: interrupted").count(),
                1,
                "{said}"
            );
        }
    }
    assert_eq!(files(folder.path()), before);
}

/// A seeded sequence of numbers: moments that differ from test to test and not from run to run.
fn moments() -> impl Iterator<Item = Duration> {
    let mut state = 0x2545_f491_u32;
    std::iter::repeat_with(move || {
        state ^= state << 13;
        state ^= state >> 17;
        state ^= state << 5;
        Duration::from_micros(u64::from(state % 400_000))
    })
}

#[test]
fn any_command_at_any_moment_ends_with_whole_outputs() {
    let folder = studio();
    let at = |name: &str| folder.path().join(name);
    std::fs::create_dir(at("photos")).unwrap();
    done(
        folder.path(),
        "-q scenes --out photos --scene street --width 640 --height 480",
    );
    done(
        folder.path(),
        "-q library add photos --catalogue photos.ravec",
    );
    let quad = "40,30,1500,60,1400,1100,80,1000";
    let lines = [
        "twocolor large.bmp -o out.png --svg out.svg".to_owned(),
        "brush large.bmp -o out.png --everywhere --mode clean".to_owned(),
        format!("rectify large.bmp --quad {quad} -o out.png"),
        format!("snap large.bmp --quad {quad} -o out.png"),
        "planes large.bmp -o out.png".to_owned(),
        "match large.bmp large.bmp -o out.txt".to_owned(),
        "compare large.bmp large.bmp".to_owned(),
        "retarget large.bmp --size 50% -o out.png".to_owned(),
        "complete large.bmp --polygon 400,300,700,280,720,600,410,580 -o out.png".to_owned(),
        "mosaic large.bmp --catalogue photos.ravec -o out.png --tiles 40x30 --crop center --max-uses 99999 --min-repeat-distance 0".to_owned(),
        "library add photos large.bmp --catalogue new.ravec".to_owned(),
        "mesh check large.stl".to_owned(),
        "mesh convert large.stl -o out.ply".to_owned(),
        "mesh simplify large.stl -o out.ply --error 1%".to_owned(),
        "mesh render large.stl -o out.png".to_owned(),
        "offset large.stl -o out.ply --distance 2%".to_owned(),
        "boolean union large.stl large.stl -o out.ply".to_owned(),
        "scenes --out scenes --width 640 --height 480".to_owned(),
        "demo --image large.bmp --out gallery".to_owned(),
    ];
    for (line, moment) in lines.iter().chain(&lines).zip(moments()) {
        let child = spawned(folder.path(), line, Stdio::null());
        std::thread::sleep(moment);
        signal(&child, "-INT");
        let (code, said) = end_of(child, line);
        // a signal may come before the program listens, which ends it, or after the work
        assert!(
            matches!(code, Some(130 | 0) | None),
            "{line}: {code:?} {said}"
        );
        let name_of = |path: &PathBuf| path.file_name().unwrap().to_str().unwrap().to_owned();
        let mut folders = vec![folder.path().to_path_buf()];
        folders.extend(
            ["scenes", "gallery"]
                .map(at)
                .into_iter()
                .filter(|path| path.is_dir()),
        );
        let names = folders.iter().flat_map(|folder| files(folder));
        let left: Vec<_> = names
            .map(|path| name_of(&path))
            .filter(|name| name.starts_with('.'))
            .collect();
        assert!(left.is_empty() || code.is_none(), "{line}: {left:?}");
        let out = std::fs::read(at("out.png")).unwrap();
        let whole = out.ends_with(b"IEND\xaeB`\x82");
        assert!(out == b"old" || whole, "{line}: out.png is half there");
    }
}

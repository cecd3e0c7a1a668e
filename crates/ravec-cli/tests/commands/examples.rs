//! The examples of the help pages, the readme and the guide, run as they are written.

use crate::meshes::{parts, torus};
use crate::pictures::bmp;
use crate::program::{code, done, files, photos, stderr};
use std::path::Path;
use std::process::{Command, Stdio};

const COMMANDS: [&str; 42] = [
    "compare",
    "rectify",
    "snap",
    "planes",
    "track",
    "stabilize",
    "plate",
    "matte",
    "complete",
    "retarget",
    "twocolor",
    "brush",
    "mesh",
    "mesh info",
    "mesh check",
    "mesh convert",
    "mesh compare",
    "mesh render",
    "mesh simplify",
    "offset",
    "boolean",
    "library",
    "library add",
    "library remove",
    "library list",
    "library clean",
    "library stats",
    "mosaic",
    "video",
    "video info",
    "video convert",
    "video frames",
    "video remove",
    "video replace",
    "video enhance",
    "video overlay",
    "video paste",
    "run",
    "demo",
    "scenes",
    "completions",
    "man",
];

/// A folder with the files that the examples are about.
fn studio() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    photos(folder.path());
    parts(folder.path());
    let mut scan = torus(2.0, 0.8, 48, 24);
    // without the last two quadrilaterals, side by side: a hole of six edges
    scan.triangles.truncate(2300);
    std::fs::write(folder.path().join("scan.stl"), scan.stl()).unwrap();
    for (name, photo) in [("a.png", "photo.jpg"), ("b.png", "noisy.jpg")] {
        done(folder.path(), &format!("-q twocolor {photo} -o {name}"));
    }
    let sheet = "solid sheet\n\
        facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 30 0 0\nvertex 30 20 0\nendloop\nendfacet\n\
        facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 30 20 0\nvertex 0 20 0\nendloop\nendfacet\n\
        endsolid sheet\n";
    std::fs::write(folder.path().join("sheet.stl"), sheet).unwrap();
    let mask = bmp(160, 120, |col, row| {
        [255 * u8::from((60..80).contains(&col) && (40..60).contains(&row)); 3]
    });
    std::fs::write(folder.path().join("mask.png"), mask).unwrap();
    clips(folder.path());
    std::fs::create_dir(folder.path().join("photos")).unwrap();
    for number in 0..40usize {
        let tone = |step: usize| (number * step % 40 * 5) as u8;
        let photo = bmp(64, 48, |col, row| {
            [tone(1) + (col / 2) as u8, tone(7) + row as u8, tone(17)]
        });
        std::fs::write(folder.path().join(format!("photos/{number}.bmp")), photo).unwrap();
    }
    done(
        folder.path(),
        "-q library add photos photo.jpg --catalogue photos.ravec",
    );
    std::fs::write(folder.path().join("points.json"), "[[40, 30], [90, 50]]").unwrap();
    let help = done(folder.path(), "help brush");
    let begin = help.find("{\"version\"").unwrap();
    let strokes = &help[begin..];
    let strokes = &strokes[..strokes.find("}]}").unwrap() + 3];
    std::fs::write(folder.path().join("strokes.json"), strokes).unwrap();
    folder
}

/// The color of a wall with a pattern at a point.
fn wall(x: f64, y: f64) -> [u8; 3] {
    let wave = |a: f64, b: f64| (a * x + b * y).sin();
    let value =
        128.0 + 40.0 * wave(0.31, 0.11) + 40.0 * wave(-0.13, 0.37) + 30.0 * wave(0.05, -0.07);
    [value as u8, (0.9 * value) as u8, (250.0 - value) as u8]
}

/// Twelve frames of a disc that moves, as a clip without loss, as MP4 and as two-color pixels.
fn clips(folder: &Path) {
    for number in 0..12usize {
        let frame = bmp(64, 48, |col, row| {
            let inside = (col as f64 - 14.0 - 3.0 * number as f64).hypot(row as f64 - 24.0) < 9.0;
            if inside {
                [40, 40, 60]
            } else {
                [200, (150 + col) as u8, (180 + row) as u8]
            }
        });
        std::fs::write(folder.join(format!("shot_{number:02}.bmp")), frame).unwrap();
    }
    // the same place without the disc
    let empty = bmp(64, 48, |col, row| {
        [200, (150 + col) as u8, (180 + row) as u8]
    });
    std::fs::write(folder.join("empty.png"), empty).unwrap();
    // marks on shot_06.bmp: inside the disc, and around it
    let marks = bmp(64, 48, |col, row| {
        match (col as f64 - 32.0).hypot(row as f64 - 24.0) {
            distance if distance < 6.0 => [255; 3],
            distance if distance > 12.0 => [0; 3],
            _ => [128; 3],
        }
    });
    std::fs::write(folder.join("trimap.png"), &marks).unwrap();
    std::fs::write(folder.join("strokes.png"), &marks).unwrap();
    done(folder, "-q video convert shot_%02d.bmp clip.y4m");
    done(folder, "-q video convert clip.y4m clip.mp4");
    done(folder, "-q twocolor clip.y4m -o blocks.y4m");
    // a wall with a pattern before which the camera moves
    for number in 0..12usize {
        let (right, down) = (0.7 * number as f64, 0.3 * number as f64);
        let frame = bmp(160, 120, |col, row| {
            wall(col as f64 + right, row as f64 + down)
        });
        std::fs::write(folder.join(format!("wall_{number:02}.bmp")), frame).unwrap();
    }
    done(folder, "-q video convert wall_%02d.bmp wall.y4m");
    done(folder, "-q video frames wall.y4m -o wall.png --at 3");
    done(folder, "-q matte clip.y4m --plate empty.png -o alpha.y4m");
    // the wall from nearer, in other light, and nothing before it
    let quad = "40,30,120,24,124,90,36,84";
    done(
        folder,
        &format!("-q track wall.y4m --quad {quad} -o wall.json"),
    );
    done(
        folder,
        "-q plate wall.y4m --track wall.json -o wall_plate.png",
    );
    let photo = bmp(320, 240, |col, row| {
        wall(0.5 * col as f64, 0.5 * row as f64)
    });
    std::fs::write(folder.join("wall_photo.png"), photo).unwrap();
    std::fs::write(folder.join("none.png"), bmp(160, 120, |_, _| [0; 3])).unwrap();
    for (name, short) in [
        ("wall.json", "w.json"),
        ("wall_plate.png", "w.png"),
        ("wall_photo.png", "p.png"),
        ("none.png", "m.png"),
    ] {
        std::fs::copy(folder.join(name), folder.join(short)).unwrap();
    }
}

/// Runs a line as a shell would, on small pictures where it is about built-in ones, and with small meshes.
#[cfg(unix)]
fn run(folder: &Path, line: &str) {
    let small = match line {
        line if line == "ravec demo" || line.starts_with("ravec demo ") => " --max-side 64",
        "ravec scenes --out scenes" => " --width 48 --height 32",
        _ => "",
    };
    let programs = Path::new(env!("CARGO_BIN_EXE_ravec")).parent().unwrap();
    let path = std::env::var("PATH").unwrap_or_default();
    let output = Command::new("sh")
        .args(["-c", &format!("{line}{small}")])
        .env("PATH", format!("{}:{path}", programs.display()))
        .current_dir(folder)
        .stdin(Stdio::null())
        .output()
        .unwrap();
    assert_eq!(code(&output), 0, "{line}: {}", stderr(&output));
    assert_eq!(stderr(&output), "", "{line}");
}

#[cfg(unix)]
#[test]
fn examples_of_the_help_run_as_they_are_written() {
    let folder = studio();
    let pages = COMMANDS.map(|command| done(folder.path(), &format!("help {command}")));
    let program = done(folder.path(), "--help");
    for page in pages.iter().chain([&program]) {
        let (_, examples) = page.split_once("Examples:\n").expect("every page has some");
        let (examples, _) = examples.split_once("\n\n").unwrap();
        for line in examples.lines() {
            run(folder.path(), line.trim());
        }
    }
    for written in [
        "ravec-demo/index.html",
        "gallery/index.html",
        "blocks.jpg",
        "mask.png",
        "pages/ravec-brush.1",
        "figures.json",
        "f.json",
        "grid.png",
        "planes.json",
        "without.png",
        "part.png",
        "cut.png",
        "small.stl",
        "part.3mf",
        "distance.json",
        "grown.stl",
        "hollow.3mf",
        "smaller.json",
        "better.json",
        "pin.nk",
        "plane.py",
        "plane.y4m",
    ] {
        assert!(folder.path().join(written).is_file(), "{written}");
    }
}

#[test]
fn tools_and_settings_of_the_help_are_understood() {
    let folder = studio();
    let help = done(folder.path(), "help brush");
    let lines = |title: &str| {
        let (_, rest) = help.split_once(title).unwrap();
        let lines = rest
            .lines()
            .skip(1)
            .take_while(|line| line.starts_with("  "));
        lines.map(str::trim).collect::<Vec<_>>()
    };
    let paint = |tool: &str, settings: &str| {
        let strokes =
            format!("[{{\"tool\": {tool}, \"points\": [[80, 60]], \"radius_px\": 20{settings}}}]");
        std::fs::write(folder.path().join("strokes.json"), strokes).unwrap();
        let arguments = "-q brush photo.jpg -o out.png --mask mask.png --stroke strokes.json";
        done(folder.path(), arguments);
        std::fs::read(folder.path().join("out.png")).unwrap()
    };
    let settings = format!(", {}", lines("Settings").concat());
    let tools = lines("Tools");
    assert_eq!(tools.len(), 8, "{tools:?}");
    for tool in tools {
        assert!(
            paint(tool, "") == paint(tool, &settings),
            "{tool}: no defaults"
        );
    }
}

/// The lines of the shell blocks of a page that run the program, without their comments.
#[cfg(unix)]
fn commands(page: &str) -> Vec<&str> {
    let mut in_shell = false;
    let mut lines = Vec::new();
    for line in page.lines() {
        if let Some(language) = line.strip_prefix("```") {
            in_shell = language == "sh";
        } else if in_shell && line.starts_with("ravec ") {
            lines.push(line.split(" # ").next().unwrap().trim());
        }
    }
    lines
}

#[cfg(unix)]
#[test]
fn commands_of_the_readme_run_as_they_are_written() {
    let folder = studio();
    let readme = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../README.md");
    let readme = std::fs::read_to_string(readme).unwrap();
    let lines = commands(&readme);
    assert!(lines.len() > 5, "{lines:?}");
    for line in lines {
        run(folder.path(), line);
    }
}

#[cfg(unix)]
#[test]
fn commands_of_the_guide_run_as_they_are_written() {
    let pages = files(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/guide"));
    assert!(pages.len() > 7, "{pages:?}");
    for page in pages {
        let text = std::fs::read_to_string(&page).unwrap();
        let lines = commands(&text);
        assert!(!lines.is_empty(), "{}", page.display());
        // no page uses what another one has written
        let folder = studio();
        for line in lines {
            run(folder.path(), line);
        }
    }
}

//! Catalogues of photos: what stays as it is, broken ones, and several programs at one catalogue.

use crate::mosaic::studio;
use crate::program::{assert_refused, code, ravec, stderr};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

/// All files of a folder and those in it, with their content.
fn content(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut pending = vec![folder.to_path_buf()];
    while let Some(folder) = pending.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let entry = entry.unwrap();
            match entry.file_type().unwrap() {
                kind if kind.is_dir() => pending.push(entry.path()),
                kind if kind.is_file() => {
                    found.insert(entry.path(), std::fs::read(entry.path()).unwrap());
                }
                _ => {}
            }
        }
    }
    found
}

fn words(line: &str) -> Vec<&str> {
    line.split(' ').collect()
}

#[test]
fn no_output_takes_the_place_of_the_catalogue_or_of_a_photo() {
    let folder = studio();
    let path = folder.path();
    let at = |name: &str| path.join(name);
    std::fs::copy(at("photos/03.bmp"), at("photos/new.bmp")).unwrap();
    std::fs::hard_link(at("photos/00.bmp"), at("photo.png")).unwrap();
    std::fs::hard_link(at("photos/new.bmp"), at("new.json")).unwrap();
    std::fs::hard_link(at("c.ravec"), at("catalogue.png")).unwrap();
    std::fs::create_dir(at("pages")).unwrap();
    std::fs::copy(at("photos/00.bmp"), at("pages/mosaic.dzi")).unwrap();
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink("photos/01.bmp", at("link.png")).unwrap();
        std::os::unix::fs::symlink("photos", at("linked")).unwrap();
    }
    let before = content(path);
    let mosaic =
        "mosaic in.bmp --catalogue c.ravec --tiles 4x3 --crop center --min-repeat-distance 2";
    let mut refused = vec![
        (
            format!("{mosaic} -o photo.png"),
            2,
            "it is a photo of the catalogue",
        ),
        (format!("{mosaic} -o catalogue.png"), 2, "catalogue.png"),
        (
            format!("{mosaic} -o out.png --json photos/07.bmp"),
            2,
            "it is a photo of the catalogue",
        ),
        (
            format!("{mosaic} --deep-zoom ."),
            2,
            "the catalogue is in it",
        ),
        (
            format!("{mosaic} --deep-zoom photos"),
            2,
            "photos of the catalogue are in it",
        ),
        (
            format!("{mosaic} --deep-zoom pages"),
            4,
            "no list of its files",
        ),
        (
            format!("{mosaic} --deep-zoom pages --json pages/r.json"),
            2,
            "folder of the page",
        ),
        (
            "library add photos --catalogue c.ravec --json photos/new.bmp".into(),
            2,
            "photos/new.bmp",
        ),
        (
            "library add photos --catalogue c.ravec --json new.json".into(),
            2,
            "new.json",
        ),
        (
            "library add photos --catalogue other.ravec --json other.ravec".into(),
            2,
            "other.ravec",
        ),
        (
            "library add photos --catalogue other.ravec --json other.ravec-journal".into(),
            2,
            "other",
        ),
    ];
    for command in [
        "remove photos/02.bmp",
        "list",
        "clean",
        "clean --dry-run",
        "stats",
    ] {
        for report in [
            "photos/04.bmp",
            "photo.png",
            "c.ravec",
            "./photos/../c.ravec-wal",
        ] {
            let line = format!("library {command} --catalogue c.ravec --json {report}");
            refused.push((line, 2, report));
        }
    }
    if cfg!(unix) {
        refused.push((format!("{mosaic} -o link.png"), 2, "it is a photo"));
        refused.push((
            format!("{mosaic} --deep-zoom linked"),
            2,
            "photos of the catalogue",
        ));
    }
    for (line, expected, word) in refused {
        let output = ravec(path, &words(&line));
        assert_refused(&output, expected, &[word]);
        assert_eq!(content(path), before, "{line}");
    }
}

#[test]
fn a_broken_catalogue_is_an_input_that_cannot_be_read() {
    let folder = studio();
    let path = folder.path();
    let mut bytes = std::fs::read(path.join("c.ravec")).unwrap();
    // the header stays
    for byte in &mut bytes[4096..] {
        *byte = 0xa5;
    }
    std::fs::write(path.join("c.ravec"), bytes).unwrap();
    for line in [
        "library list --catalogue c.ravec",
        "library stats --catalogue c.ravec",
        "library clean --catalogue c.ravec",
        "library clean --dry-run --catalogue c.ravec",
        "library remove photos --catalogue c.ravec",
        "library add photos --catalogue c.ravec",
        "mosaic in.bmp --catalogue c.ravec -o out.png",
    ] {
        let output = ravec(path, &words(line));
        assert_refused(&output, 3, &["the catalogue c.ravec is damaged"]);
    }
}

#[cfg(unix)]
#[test]
fn a_catalogue_in_a_protected_folder_can_be_read() {
    use std::os::unix::fs::PermissionsExt as _;
    let folder = studio();
    let path = folder.path();
    let protect = |mode| {
        for name in ["c.ravec", "."] {
            let permissions = std::fs::Permissions::from_mode(mode);
            std::fs::set_permissions(path.join(name), permissions).unwrap();
        }
    };
    protect(0o555);
    let listed = ravec(path, &words("library list --catalogue c.ravec"));
    assert_eq!(code(&listed), 0, "{}", stderr(&listed));
    let files: Vec<_> = std::fs::read_dir(path).unwrap().collect();
    assert_eq!(files.len(), 3, "nothing is made beside it");
    protect(0o755);
}

/// Can only fail by hanging, or by what is said.
#[cfg(unix)]
#[test]
fn pipes_among_photos_are_not_waited_for() {
    let folder = studio();
    let path = folder.path();
    for name in ["photos/pipe.png", "c2.ravec"] {
        let made = Command::new("mkfifo").arg(path.join(name)).status();
        assert!(made.unwrap().success());
    }
    let added = ravec(path, &words("library add photos --catalogue c.ravec"));
    assert_eq!(code(&added), 0, "{}", stderr(&added));
    let pipe = "library add photos/pipe.png --catalogue c.ravec";
    assert_refused(
        &ravec(path, &words(pipe)),
        3,
        &["pipe.png", "neither a file nor a folder"],
    );
    for command in ["add photos", "list"] {
        let line = format!("library {command} --catalogue c2.ravec");
        assert_refused(
            &ravec(path, &words(&line)),
            3,
            &["c2.ravec is not a catalogue"],
        );
    }
    // a photo of the catalogue that became a pipe
    std::fs::rename(path.join("photos/pipe.png"), path.join("photos/07.bmp")).unwrap();
    let line = "mosaic in.bmp --catalogue c.ravec -o out.png --tiles 4x3 --tile-size 32x24 --min-repeat-distance 2";
    let made = ravec(path, &words(line));
    assert_eq!(code(&made), 0, "{}", stderr(&made));
    assert!(stderr(&made).contains("07.bmp: is no longer a plain file"));
}

fn start(folder: &Path, line: &str) -> Child {
    Command::new(env!("CARGO_BIN_EXE_ravec"))
        .args(words(line))
        .current_dir(folder)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

#[test]
fn programs_that_use_one_catalogue_at_once_wait_for_one_another() {
    let folder = studio();
    let path = folder.path();
    for part in 0..3 {
        std::fs::create_dir(path.join(format!("more{part}"))).unwrap();
        for number in 0..20usize {
            let photo = crate::pictures::bmp(64, 48, |col, row| {
                [
                    (col * (part + 2)) as u8,
                    (row * 5) as u8,
                    (9 * number + part) as u8,
                ]
            });
            std::fs::write(path.join(format!("more{part}/{number}.bmp")), photo).unwrap();
        }
    }
    let lines = [
        [
            "library add more0 more1",
            "library remove more1",
            "library add more1 more2",
        ],
        [
            "library add more2 more0",
            "library clean --dry-run",
            "library remove more2",
        ],
        ["library list", "library stats", "library add more0"],
        [
            "mosaic in.bmp --tiles 4x3 --tile-size 32x24 --min-repeat-distance 2 -o out.png",
            "library clean",
            "library list --all",
        ],
    ];
    for round in 0..3 {
        for step in 0..3 {
            let running: Vec<(String, Child)> = lines
                .iter()
                .map(|lines| format!("{} --catalogue c.ravec", lines[(step + round) % 3]))
                .map(|line| (line.clone(), start(path, &line)))
                .collect();
            for (line, child) in running {
                let output = child.wait_with_output().unwrap();
                let text = stderr(&output);
                let busy = text.contains("is busy");
                assert!(code(&output) == 0 || busy, "{line}: {text}");
            }
        }
    }
    // what was added last is there, once
    let added = ravec(path, &words("library add more0 photos --catalogue c.ravec"));
    assert_eq!(code(&added), 0, "{}", stderr(&added));
    let listed = ravec(path, &words("library list --all --catalogue c.ravec"));
    let listed: serde_json::Value = serde_json::from_slice(&listed.stdout).unwrap();
    let mut paths: Vec<&str> = listed
        .as_array()
        .unwrap()
        .iter()
        .map(|photo| photo["path"].as_str().unwrap())
        .collect();
    let photos = paths.len();
    paths.sort_unstable();
    paths.dedup();
    assert_eq!(paths.len(), photos);
    let known = |part: &str| paths.iter().filter(|path| path.contains(part)).count();
    assert_eq!((known("photos/"), known("more0/")), (30, 20));
    assert!(!path.join("c.ravec-journal").exists());
}

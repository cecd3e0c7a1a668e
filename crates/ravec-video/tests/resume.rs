//! Interrupted runs go on where they stopped, with the same bytes.

mod common;

use common::{colors, frame, picture};
use ravec_raster::Size;
use ravec_video::{CHUNK_FRAMES, ClipWriter, CreateOptions, VideoError};
use std::collections::BTreeMap;
use std::path::Path;

fn size() -> Size {
    Size::new(8, 6).unwrap()
}

const FRAMES: u64 = 2 * CHUNK_FRAMES + 17;

fn options(resume: bool) -> CreateOptions {
    CreateOptions {
        resume,
        key: "the same clip".to_owned(),
        ..CreateOptions::default()
    }
}

/// Writes frames from where the writer stands up to `end`, and completes the clip if that is its end. Returns the number of the
/// first frame.
fn run(path: &Path, options: &CreateOptions, end: u64) -> u64 {
    let mut writer = ClipWriter::create(path, &colors::<u8>(size(), false), options).unwrap();
    let first = writer.resumed_frames();
    for at in first..end {
        writer.write(&frame(picture(size(), at), at)).unwrap();
    }
    if end == FRAMES {
        writer.finish().unwrap();
    }
    first
}

/// The content of all files of a folder.
fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let entries = std::fs::read_dir(folder).unwrap().map(Result::unwrap);
    let read = entries.map(|entry| {
        let name = entry.file_name().into_string().unwrap();
        (name, std::fs::read(entry.path()).unwrap_or_default())
    });
    read.collect()
}

#[test]
fn a_resumed_run_gives_the_bytes_of_one_without_a_break() {
    for name in ["clip.y4m", "f_%04d.png"] {
        let whole = tempfile::tempdir().unwrap();
        run(&whole.path().join(name), &options(false), FRAMES);
        let truth = files(whole.path());
        assert!(
            truth.keys().all(|name| !name.starts_with('.')),
            "{:?}",
            truth.keys()
        );
        let stops = [CHUNK_FRAMES + 1, 0, 3, CHUNK_FRAMES, 2 * CHUNK_FRAMES + 3];
        // each picture is brought to the disk
        let stops = if name.contains('%') {
            &stops[..1]
        } else {
            &stops
        };
        for &stop in stops {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join(name);
            run(&path, &options(false), stop);
            let first = run(&path, &options(true), FRAMES);
            assert_eq!(first, stop / CHUNK_FRAMES * CHUNK_FRAMES, "{name}");
            assert!(files(folder.path()) == truth, "{name} {stop}");
        }
    }
}

#[test]
fn parts_of_another_clip_are_not_used() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("clip.y4m");
    run(&path, &options(false), CHUNK_FRAMES + 1);
    let other = CreateOptions {
        key: "another clip".to_owned(),
        ..options(true)
    };
    assert_eq!(run(&path, &other, CHUNK_FRAMES), 0);
    // nor without being asked
    assert_eq!(
        run(
            &path,
            &CreateOptions {
                resume: false,
                ..other
            },
            1
        ),
        0
    );
    assert_eq!(files(folder.path()).len(), 0);
}

#[test]
fn two_runs_do_not_write_the_same_clip() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("clip.y4m");
    let format = colors::<u8>(size(), false);
    let first = ClipWriter::create(&path, &format, &options(true)).unwrap();
    let second = ClipWriter::create(&path, &format, &options(true));
    assert!(matches!(second, Err(VideoError::Io(_))));
    drop(first);
    assert_eq!(run(&path, &options(true), FRAMES), 0);
}

#[test]
fn a_run_without_a_whole_chunk_leaves_nothing() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["clip.y4m", "clip.gif", "clip.apng"] {
        let path = folder.path().join(name);
        run(&path, &options(false), 5);
    }
    assert_eq!(files(folder.path()).len(), 0);
}

//! Files of strokes, read and applied to a small picture by the operation `brush`.

use super::Outcome;
use ravec::raster::{Image, Size, Srgb};
use ravec_jobs::{Context, JobError, Operation as _, brush};
use ravec_media::{Picture, WriteOptions, write};
use std::path::PathBuf;
use std::sync::LazyLock;
use tempfile::TempDir;

/// A folder with the picture.
struct Desk {
    _folder: TempDir,
    strokes: PathBuf,
    operation: brush::Brush,
}

static DESK: LazyLock<Desk> = LazyLock::new(|| {
    let folder = tempfile::tempdir().expect("a temporary folder can be made");
    let at = |name: &str| folder.path().join(name);
    let size = Size::new(24, 16).expect("not empty");
    let image = Image::from_fn(size, |col, row| {
        Srgb([
            (col * 9) as u8,
            (row * 15) as u8,
            if col > 12 { 200 } else { 20 },
        ])
    });
    write(
        at("in.png"),
        &Picture::from_image(image),
        &WriteOptions::default(),
    )
    .expect("a small picture can be written");
    Desk {
        strokes: at("strokes.json"),
        operation: brush::Brush {
            input: at("in.png"),
            output: at("out.png"),
            everywhere: false,
            stroke: Some(at("strokes.json")),
            strokes: None,
            mask: Some(at("mask.png")),
            params: brush::Params::default(),
        },
        _folder: folder,
    }
});

/// Applies the strokes.
pub fn read(input: &[u8]) -> Outcome {
    let desk = &*DESK;
    std::fs::write(&desk.strokes, input).expect("the folder can be written to");
    let result = desk.operation.run(&Context::default());
    match &result {
        Ok(report) => assert!(report.figures["strokes"] >= 0.0),
        Err(JobError::Strokes { .. }) => {}
        Err(other) => panic!("strokes cannot be to blame for: {other}"),
    }
    Outcome::of(&result)
}

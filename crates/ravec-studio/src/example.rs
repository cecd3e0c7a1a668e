//! The example: a project of drawn clips that shows a shot being edited.

use crate::document::Document;
use crate::project::Project;
use ravec_jobs::scenes::{Params, Scenes};
use ravec_jobs::{Context, Operation as _};
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};

/// Columns, rows and frames of the clips.
const SIZE: [u32; 2] = [480, 270];
const FRAMES: u32 = 50;

/// Noise of the clips in steps of 8 bits.
const NOISE: f64 = 1.5;

/// Name of the project.
const PROJECT: &str = "example.ravec.json";

/// Draws two clips into a folder and writes a project of them, unless it is there; its path.
///
/// In the first clip, a person walks past a shop. The project separates the person from the shop and puts the second clip behind; an
/// edit that removes the person instead is switched off.
///
/// # Errors
/// One sentence.
pub(crate) fn prepare(folder: &Path) -> Result<PathBuf, String> {
    draw(folder, SIZE, FRAMES)
}

fn draw(folder: &Path, size: [u32; 2], frames: u32) -> Result<PathBuf, String> {
    let path = folder.join(PROJECT);
    if path.exists() {
        return Ok(path);
    }
    let scenes: Vec<_> = ["walker", "handheld-wall"]
        .into_iter()
        .map(|name| name.to_owned().try_into())
        .collect::<Result<_, _>>()
        .map_err(|error: ravec_jobs::scenes::UnknownScene| error.to_string())?;
    let drawn = Scenes {
        out: folder.to_path_buf(),
        params: Params {
            scenes,
            width: Some(size[0]),
            height: Some(size[1]),
            frames: Some(frames),
            noise_sigma: NOISE,
            ..Params::default()
        },
    };
    let failed = |error: ravec_jobs::JobError| error.to_string();
    drawn.run(&Context::default()).map_err(failed)?;
    let project = Project {
        document: document(folder),
        output: folder.join("walker-edited.mp4"),
    };
    project.save(&path).map_err(|error| error.to_string())?;
    Ok(path)
}

/// The edits of the example.
fn document(folder: &Path) -> Document {
    let mut document = Document::new(folder.join("walker"));
    let other = folder.join("handheld-wall").to_string_lossy().into_owned();
    for (operation, fields) in [
        ("plate", json!({"output": "@plate"})),
        ("matte", json!({"output": "@matte", "plate": "@plate"})),
        (
            "video remove",
            json!({"plate": "@plate", "matte": "@matte"}),
        ),
        (
            "video replace",
            json!({"plate": "@plate", "matte": "@matte", "image": other}),
        ),
    ] {
        let fields = match fields {
            Value::Object(fields) => fields,
            _ => Map::new(),
        };
        let id = document.push(operation, fields);
        if operation == "video remove"
            && let Some(edit) = document.edit(id)
        {
            let mut off = edit.as_ref().clone();
            off.enabled = false;
            document.replace(off);
        }
    }
    document
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::export;
    use ravec::progress::Progress;
    use ravec_video::FrameSource as _;

    #[test]
    fn the_example_is_drawn_once_and_can_be_exported() {
        let folder = tempfile::tempdir().unwrap();
        let path = draw(folder.path(), [96, 64], 10).unwrap();
        let text = std::fs::read(&path).unwrap();
        assert_eq!(draw(folder.path(), [96, 64], 3).unwrap(), path);
        assert_eq!(std::fs::read(&path).unwrap(), text);
        let Project { document, output } = Project::load(&path).unwrap();
        assert_eq!(document.edits.len(), 4);
        let written = export(&document, &output, &Progress::none()).unwrap();
        assert_eq!(written, [output.as_path()]);
        let options = ravec_video::OpenOptions::default();
        let clip = ravec_video::Clip::open(&output, &options).unwrap();
        assert_eq!(clip.info().frames, Some(10));
        // without the person the same document writes a clip as well
        let mut other = document.clone();
        for edit in &document.edits[2..] {
            let mut changed = edit.as_ref().clone();
            changed.enabled = !changed.enabled;
            other.replace(changed);
        }
        export(&other, &folder.path().join("b.mp4"), &Progress::none()).unwrap();
    }
}

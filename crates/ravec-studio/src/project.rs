//! Projects: documents as recipes on the disk, which `ravec run` executes.

use crate::document::{Document, Edit, EditError};
use ravec_jobs::recipe::PathBase;
use ravec_jobs::{Recipe, Step};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Maximum size of a project in bytes.
const MAX_BYTES: u64 = 64 << 20;

/// The part of a project that only the studio reads.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Editor {
    program: String,
    source: PathBuf,
    output: PathBuf,
    edits: Vec<Edit>,
}

/// Name of the program in projects.
const PROGRAM: &str = "ravec-studio";

/// Why a project cannot be read or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ProjectError {
    /// The file cannot be read or written.
    #[error("{}: {cause}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The reason.
        cause: std::io::Error,
    },
    /// The file is no project.
    #[error("{} is no project of the studio: {reason}", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// The reason, in one sentence.
        reason: String,
    },
    /// An edit makes no sense.
    #[error(transparent)]
    Edit(#[from] EditError),
}

/// A document, and the file that its recipe writes.
#[derive(Debug, Clone, PartialEq)]
pub struct Project {
    /// The document. Its source is relative to the working folder, or absolute.
    pub document: Document,
    /// The file that `ravec run` writes, likewise.
    pub output: PathBuf,
}

impl Project {
    /// The project as the text of a recipe in `folder`; paths inside the folder become relative to it, those of edits included.
    ///
    /// # Errors
    /// [`ProjectError::Edit`], [`ProjectError::Format`] for a path that is not Unicode.
    pub fn to_text(&self, folder: &Path) -> Result<String, ProjectError> {
        let mut document = self.document.clone();
        document.source = relative(&document.source, folder);
        let output = relative(&self.output, folder);
        let edits = document.edits.iter();
        let edits: Vec<Edit> = edits
            .map(|edit| edit.with_paths(&|path| relative(path, folder)))
            .collect();
        document.edits = edits.iter().cloned().map(Arc::new).collect();
        let mut recipe = if document.enabled().next().is_some() {
            document.recipe(&output)?
        } else {
            Recipe::new(Vec::<Step>::new())
        };
        recipe.relative_to = PathBase::Recipe;
        let unreadable = |error: serde_json::Error| ProjectError::Format {
            path: folder.to_path_buf(),
            reason: error.to_string(),
        };
        let editor = Editor {
            program: PROGRAM.to_owned(),
            source: document.source.clone(),
            output,
            edits,
        };
        recipe.editor = Some(serde_json::to_value(editor).map_err(unreadable)?);
        recipe.to_json().map_err(unreadable)
    }

    /// The project of a text that stands in `folder`.
    ///
    /// # Errors
    /// One sentence.
    pub fn from_text(text: &str, folder: &Path) -> Result<Self, String> {
        let recipe = Recipe::from_json(text)?;
        let editor = recipe.editor.unwrap_or(Value::Null);
        let editor: Editor = serde_json::from_value(editor)
            .map_err(|error| format!("the field `editor` is not that of the studio: {error}"))?;
        let edits = editor.edits.iter();
        let edits = edits.map(|edit| edit.with_paths(&|path| absolute(path, folder)));
        Ok(Self {
            document: Document::from_edits(absolute(&editor.source, folder), edits.collect()),
            output: absolute(&editor.output, folder),
        })
    }

    /// Writes the project; the file is whole or as it was.
    ///
    /// # Errors
    /// [`ProjectError`].
    pub fn save(&self, path: &Path) -> Result<(), ProjectError> {
        let text = self.to_text(&folder_of(path))?;
        let failed = |cause: std::io::Error| ProjectError::Io {
            path: path.to_path_buf(),
            cause,
        };
        ravec_files::write_atomically(path, |file| file.write_all(text.as_bytes())).map_err(failed)
    }

    /// Reads a project.
    ///
    /// # Errors
    /// [`ProjectError`].
    pub fn load(path: &Path) -> Result<Self, ProjectError> {
        let failed = |cause: std::io::Error| ProjectError::Io {
            path: path.to_path_buf(),
            cause,
        };
        let wrong = |reason: String| ProjectError::Format {
            path: path.to_path_buf(),
            reason,
        };
        let length = std::fs::metadata(path).map_err(failed)?.len();
        if length > MAX_BYTES {
            return Err(wrong(format!(
                "it has {length} bytes, more than {MAX_BYTES}"
            )));
        }
        let text = std::fs::read_to_string(path).map_err(failed)?;
        Self::from_text(&text, &folder_of(path)).map_err(wrong)
    }
}

fn folder_of(path: &Path) -> PathBuf {
    let folder = path.parent().unwrap_or(Path::new(""));
    std::path::absolute(folder).unwrap_or_else(|_| folder.to_path_buf())
}

/// A path inside a folder as one from there; any other becomes absolute.
fn relative(path: &Path, folder: &Path) -> PathBuf {
    let whole = std::path::absolute(path).unwrap_or_else(|_| path.to_path_buf());
    let Ok(inside) = whole.strip_prefix(folder) else {
        return whole;
    };
    // not to be taken for an intermediate result, standard input or a file with a name
    let starts = inside.to_str().unwrap_or_default();
    if starts.starts_with('@') || starts == "-" || starts.contains('=') {
        Path::new(".").join(inside)
    } else {
        inside.to_path_buf()
    }
}

fn absolute(path: &Path, folder: &Path) -> PathBuf {
    // no dots that were added when it was saved
    folder.join(path.strip_prefix(".").unwrap_or(path))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::export;
    use glam::DVec3;
    use ravec::mesh::TriMesh;
    use ravec::mesh_io::MeshFormat;
    use ravec::progress::Progress;
    use ravec::raster::{AnyImage, Image, Size, Srgb};
    use ravec_jobs::mesh::{MeshTarget, write_mesh_file};
    use ravec_jobs::{Context, Operation as _, recipe};
    use ravec_media::{Picture, WriteOptions};
    use serde_json::{Map, json};

    fn fields(value: Value) -> Map<String, Value> {
        match value {
            Value::Object(fields) => fields,
            other => panic!("no object: {other}"),
        }
    }

    fn put_mesh(path: &Path, mesh: &TriMesh) {
        let target = MeshTarget::of(path, MeshFormat::Off).unwrap();
        write_mesh_file(path, mesh, &target, &Progress::none()).unwrap();
    }

    fn put_frame(path: &Path, number: usize) {
        let image: Image<Srgb<u8>> = Image::from_fn(Size::new(96, 72).unwrap(), |col, row| {
            let (x, y) = (col + 2 * number, row + number);
            let tone = ((x * 37 + y * 91 + (x / 5) * (y / 4) * 53) % 200) as u8;
            Srgb([tone, 255 - tone, 40 + tone / 2])
        });
        let picture = Picture::from_image(AnyImage::from(image));
        ravec_media::write(path, &picture, &WriteOptions::default()).unwrap();
    }

    /// Saves a project in a folder, and moves the folder.
    fn saved_and_moved(folder: &Path, document: Document, output: &Path) -> PathBuf {
        let project = Project {
            document,
            output: output.to_path_buf(),
        };
        let file = folder.join("here/all.ravec.json");
        project.save(&file).unwrap();
        assert_eq!(Project::load(&file).unwrap(), project);
        let text = std::fs::read_to_string(&file).unwrap();
        assert!(!text.contains("here/"), "{text}");
        std::fs::rename(folder.join("here"), folder.join("there")).unwrap();
        folder.join("there/all.ravec.json")
    }

    /// The bytes of files that the studio exports, which are those that `ravec run` writes.
    fn exported(project: &Path, files: &[PathBuf]) -> Vec<Vec<u8>> {
        let read = || -> Vec<Vec<u8>> {
            let bytes = files.iter().map(|file| std::fs::read(file).unwrap());
            bytes.collect()
        };
        let loaded = Project::load(project).unwrap();
        export(&loaded.document, &loaded.output, &Progress::none()).unwrap();
        let studio = read();
        for file in files {
            std::fs::remove_file(file).unwrap();
        }
        let run = recipe::Run {
            file: project.to_path_buf(),
            params: recipe::Params::default(),
        };
        run.run(&Context::default()).unwrap();
        assert!(read() == studio);
        studio
    }

    #[test]
    fn a_boolean_moves_with_its_folder() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::create_dir_all(at("here/parts")).unwrap();
        let cube = |side: f64| ravec_scenes::solids::cuboid(DVec3::splat(side));
        put_mesh(&at("here/block.off"), &cube(4.0).mesh);
        put_mesh(
            &at("here/parts/drill.off"),
            &cube(2.0).shifted(DVec3::splat(1.5)).mesh,
        );
        // a name that would be one of a mesh, and a file, without its folder
        put_mesh(&at("here/c=d.off"), &cube(1.0).mesh);
        put_mesh(&at("outside.off"), &cube(0.5).mesh);
        let text = |name: &str| at(name).to_str().unwrap().to_owned();
        let mut document = Document::new(at("here/block.off"));
        let files = [
            format!("b={}", text("here/parts/drill.off")),
            text("here/c=d.off"),
            format!("e={}", text("outside.off")),
        ];
        document.push(
            "boolean",
            fields(json!({
                "expression": "a - b - c - e", "files": files, "origins": text("here/origins.csv"),
                "params": {"places": ["e:1.75,-1.75,0"]},
            })),
        );
        let wrong = document.push(
            "boolean",
            fields(json!({
                "expression": "a", "files": [text("here/parts/drill.off")], "params": {"inside": "no such"},
            })),
        );
        let wrong = Edit {
            enabled: false,
            ..Edit::clone(document.edit(wrong).unwrap())
        };
        document.replace(wrong);
        let project = saved_and_moved(folder.path(), document, &at("here/out.ply"));
        let moved = Project::load(&project).unwrap();
        assert_eq!(
            moved.document.edits[1].fields["files"],
            json!([text("there/parts/drill.off")])
        );
        let files = [at("there/out.ply"), at("there/origins.csv")];
        let bytes = exported(&project, &files);
        assert!(bytes.iter().all(|bytes| !bytes.is_empty()));
        let read = ravec_jobs::mesh::read_mesh_file(
            &files[0],
            &Context::default().mesh_limits(),
            &Progress::none(),
        );
        let volume = ravec::mesh::measure(&read.unwrap().mesh).volume;
        // the drill takes 1.5³ of the block, the cubes 1 and 0.5³
        let expected = 64.0 - 3.375 - 1.0 - 0.125;
        assert!((volume - expected).abs() < 1e-9, "{volume}");
    }

    #[test]
    fn a_track_moves_with_its_folder() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::create_dir_all(at("here/frames")).unwrap();
        for number in 0..3 {
            put_frame(&at(&format!("here/frames/{number}.png")), number);
        }
        let text = |name: &str| at(name).to_str().unwrap().to_owned();
        let mut document = Document::new(at("here/frames"));
        document.push(
            "track",
            fields(json!({
                "output": text("here/track.json"), "exports": [format!("csv={}", text("here/corners.dat"))],
                "show": text("here/show.y4m"), "params": {"quads": ["20,16,76,16,76,56,20,56"]},
            })),
        );
        let project = saved_and_moved(folder.path(), document, &at("here/out.mp4"));
        let files = ["there/track.json", "there/corners.dat", "there/show.y4m"].map(at);
        let bytes = exported(&project, &files);
        assert!(bytes[1].starts_with(b"frame"), "{:?}", bytes[1]);
    }
}

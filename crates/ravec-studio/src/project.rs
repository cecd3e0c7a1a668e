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

//! Surroundings of a run: progress, limits, and intermediate results in memory or, for clips, in files without a name.

use crate::device::Device;
use crate::error::JobError;
use crate::files;
use ravec::mesh_io::{MeshFile, MeshLimits};
use ravec::pieces::Cluster;
use ravec::progress::Progress;
use ravec_media::{Limits, Picture};
use ravec_video::{CopiedTracks, ScratchClip, VideoLimits};
use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

/// Surroundings of a run. Clones share the progress, the memory budget and the intermediate results.
#[derive(Clone)]
pub struct Context {
    /// Receives the progress, and cancels the run.
    pub progress: Progress,
    /// Limits for pictures, with the memory budget of all inputs, meshes included.
    pub limits: Limits,
    /// Maximum number of triangles of an input mesh (default 200 million).
    pub max_triangles: u64,
    /// Maximum number of vertices of an input mesh (default 200 million).
    pub max_vertices: u64,
    /// Maximum number of frames of an input clip (default 10 million).
    pub max_frames: u64,
    /// Files that the caller writes after the run, such as the report. Operations on catalogues refuse those that would replace
    /// a photo.
    pub side_outputs: Vec<PathBuf>,
    /// The device that computes two-color pixels and warps (default: the CPU).
    pub device: Device,
    /// Other processes that run pieces of operations that can be divided: `offset` and `mosaic`.
    pub cluster: Option<Arc<Cluster>>,
    /// Intermediate results by name, in a recipe.
    intermediates: Option<Arc<Intermediates>>,
}

impl Default for Context {
    /// No progress and the default limits.
    fn default() -> Self {
        Self::new(&Progress::none())
    }
}

impl Context {
    /// Default limits.
    pub fn new(progress: &Progress) -> Self {
        let meshes = MeshLimits::default();
        Self {
            progress: progress.clone(),
            limits: Limits::default(),
            max_triangles: meshes.max_triangles,
            max_vertices: meshes.max_vertices,
            max_frames: VideoLimits::default().max_frames,
            side_outputs: Vec::new(),
            device: Device::default(),
            cluster: None,
            intermediates: None,
        }
    }

    /// The limits for meshes, with the memory budget of all inputs.
    pub fn mesh_limits(&self) -> MeshLimits {
        MeshLimits {
            memory: self.limits.memory.clone(),
            max_triangles: self.max_triangles,
            max_vertices: self.max_vertices,
        }
    }

    /// The same surroundings, in which paths such as `@name` are intermediate results.
    #[must_use]
    pub fn with_intermediates(&self) -> Self {
        Self {
            intermediates: Some(Arc::default()),
            ..self.clone()
        }
    }

    /// Makes a picture the intermediate result of this name, such as `@input`, for operations that are run with this context; see
    /// [`with_intermediates`](Self::with_intermediates).
    pub fn insert_picture(&self, name: &Path, picture: Picture) {
        self.store(name, Intermediate::Picture(picture));
    }

    /// The picture that an operation has written to an intermediate result.
    ///
    /// # Errors
    /// [`JobError::NoIntermediate`].
    pub fn picture(&self, name: &Path) -> Result<Picture, JobError> {
        self.stored_picture(name)
    }

    /// Makes a mesh the intermediate result of this name, as [`insert_picture`](Self::insert_picture) does with a picture.
    pub fn insert_mesh(&self, name: &Path, mesh: Arc<MeshFile>) {
        self.store(name, Intermediate::Mesh(mesh));
    }

    /// Makes a text, such as a track, the intermediate result of this name.
    pub fn insert_text(&self, name: &Path, text: String) {
        self.store(name, Intermediate::Text(text));
    }

    /// The mesh that an operation has written to an intermediate result.
    ///
    /// # Errors
    /// [`JobError::NoIntermediate`].
    pub fn mesh(&self, name: &Path) -> Result<MeshFile, JobError> {
        self.stored_mesh(name)
    }

    /// The text that an operation has written to an intermediate result.
    ///
    /// # Errors
    /// [`JobError::NoIntermediate`].
    pub fn text(&self, name: &Path) -> Result<String, JobError> {
        self.stored_text(name)
    }

    /// Names of the intermediate results so far.
    pub(crate) fn names(&self) -> HashSet<PathBuf> {
        let Some(intermediates) = &self.intermediates else {
            return HashSet::new();
        };
        let values = intermediates
            .0
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        values.keys().cloned().collect()
    }

    /// True for a path that is an intermediate result here, not a file.
    pub(crate) fn is_intermediate(&self, path: &Path) -> bool {
        self.intermediates.is_some() && is_intermediate(path)
    }

    /// Refuses what [`files::check_files`] refuses, and intermediate results that are written twice.
    pub(crate) fn check_files(&self, inputs: &[&Path], outputs: &[&Path]) -> Result<(), JobError> {
        let files = |paths: &[&Path]| -> Vec<PathBuf> {
            let files = paths.iter().filter(|path| !self.is_intermediate(path));
            files.map(|path| path.to_path_buf()).collect()
        };
        let (read, written) = (files(inputs), files(outputs));
        let read: Vec<&Path> = read.iter().map(PathBuf::as_path).collect();
        let written: Vec<&Path> = written.iter().map(PathBuf::as_path).collect();
        files::check_files(&read, &written)
    }

    /// Refuses an intermediate result where only a file will do.
    pub(crate) fn check_is_file(&self, path: &Path) -> Result<(), JobError> {
        if self.is_intermediate(path) {
            return Err(JobError::NotInMemory {
                path: path.to_path_buf(),
            });
        }
        Ok(())
    }

    /// Keeps an intermediate result. An earlier one of that name is dropped.
    pub(crate) fn store(&self, path: &Path, value: Intermediate) {
        if let Some(intermediates) = &self.intermediates {
            let mut values = intermediates
                .0
                .lock()
                .unwrap_or_else(PoisonError::into_inner);
            values.insert(path.to_path_buf(), value);
        }
    }

    /// The intermediate result of that name.
    fn stored(&self, path: &Path) -> Result<Intermediate, JobError> {
        let missing = || JobError::NoIntermediate {
            path: path.to_path_buf(),
            expected: "an output of an earlier step",
        };
        let intermediates = self.intermediates.as_ref().ok_or_else(missing)?;
        let values = intermediates
            .0
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        values.get(path).cloned().ok_or_else(missing)
    }

    /// The picture of that name.
    pub(crate) fn stored_picture(&self, path: &Path) -> Result<Picture, JobError> {
        match self.stored(path)? {
            Intermediate::Picture(picture) => Ok(picture),
            _ => Err(wrong_kind(path, "a picture")),
        }
    }

    /// The mesh of that name.
    pub(crate) fn stored_mesh(&self, path: &Path) -> Result<MeshFile, JobError> {
        match self.stored(path)? {
            Intermediate::Mesh(mesh) => Ok(MeshFile::clone(&mesh)),
            _ => Err(wrong_kind(path, "a mesh")),
        }
    }

    /// The clip of that name.
    pub(crate) fn stored_clip(&self, path: &Path) -> Result<StoredClip, JobError> {
        match self.stored(path)? {
            Intermediate::Clip(clip) => Ok(clip),
            _ => Err(wrong_kind(path, "a clip")),
        }
    }

    /// True for an intermediate result that is a clip.
    pub(crate) fn is_stored_clip(&self, path: &Path) -> bool {
        self.is_intermediate(path) && self.stored_clip(path).is_ok()
    }

    /// The text of that name.
    pub(crate) fn stored_text(&self, path: &Path) -> Result<String, JobError> {
        match self.stored(path)? {
            Intermediate::Text(text) => Ok(text),
            _ => Err(wrong_kind(path, "a text")),
        }
    }
}

fn wrong_kind(path: &Path, expected: &'static str) -> JobError {
    JobError::NoIntermediate {
        path: path.to_path_buf(),
        expected,
    }
}

/// True for a path that names an intermediate result in a recipe, such as `@wide`. A file of such a name is `./@wide`.
pub(crate) fn is_intermediate(path: &Path) -> bool {
    path.to_str().is_some_and(|path| path.starts_with('@'))
}

/// An intermediate result.
#[derive(Clone)]
pub(crate) enum Intermediate {
    /// Samples as they were computed, not rounded to those of a file.
    Picture(Picture),
    /// Coordinates as they were computed, with attributes.
    Mesh(Arc<MeshFile>),
    /// Frames as they were computed, in a file without a name.
    Clip(StoredClip),
    /// JSON, or numbers.
    Text(String),
}

/// A clip between two operations.
#[derive(Clone)]
pub(crate) struct StoredClip {
    pub clip: ScratchClip,
    /// Sound and subtitles of the file that it was made from.
    pub tracks: Option<CopiedTracks>,
    /// Number of the first picture of a pattern.
    pub first_number: u64,
    /// Text that changes with the operations and files that it was made by.
    pub identity: String,
}

/// Intermediate results by name.
#[derive(Default)]
struct Intermediates(Mutex<HashMap<PathBuf, Intermediate>>);

//! Reading and writing of files beside the window.

use crate::autosave::{EndedRuns, Session, recover};
use crate::content::Kind;
use crate::document::Document;
use crate::engine::export;
use crate::engine::lock;
use crate::project::Project;
use ravec::progress::{Progress, Update};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// The end of a task, each with a sentence if it failed.
pub(crate) enum Done {
    /// A picture or a project was opened; where it is saved, if it is a project.
    Opened(PathBuf, Result<(Project, Kind), String>),
    /// The project of the document with this number was saved, in this state.
    Saved(u64, PathBuf, Result<Document, String>),
    /// Documents of runs that have ended without closing them were found; the session of this run, if there can be one.
    Recovered(Vec<(Project, Kind)>, EndedRuns, Option<Session>),
    /// The export with this number has ended: the files that it has written.
    Exported(u64, Result<Vec<PathBuf>, String>),
}

/// An export that is going on.
pub(crate) struct Export {
    number: u64,
    progress: Progress,
    update: Arc<Mutex<Option<Update>>>,
    since: Instant,
}

impl Export {
    /// Name of the phase, and the share of it that is done.
    pub fn state(&self) -> (&'static str, f64) {
        lock(&self.update).map_or(("export", 0.0), |update| (update.phase, update.fraction()))
    }

    /// Time since it began.
    pub fn elapsed(&self) -> Duration {
        self.since.elapsed()
    }

    /// Stops it. Files are whole or absent.
    pub fn stop(&self) {
        self.progress.cancel();
    }
}

/// Tasks on files.
pub(crate) struct Background {
    sender: Sender<Done>,
    receiver: Receiver<Done>,
    repaint: Arc<dyn Fn() + Send + Sync>,
    /// Tasks that have not ended.
    pub running: usize,
    /// The exports among them.
    pub exports: Vec<Export>,
    next_export: u64,
}

impl Background {
    pub fn new(repaint: Arc<dyn Fn() + Send + Sync>) -> Self {
        let (sender, receiver) = channel();
        Self {
            sender,
            receiver,
            repaint,
            running: 0,
            exports: Vec::new(),
            next_export: 0,
        }
    }

    fn spawn(&mut self, task: impl FnOnce() -> Done + Send + 'static) {
        let (sender, repaint) = (self.sender.clone(), self.repaint.clone());
        self.running += 1;
        std::thread::spawn(move || {
            // the window may be closed
            let _ = sender.send(task());
            repaint();
        });
    }

    /// Looks for documents of runs that have ended without closing them, and begins the session of this one.
    pub fn recover(&mut self, folder: &Path) {
        let folder = folder.to_path_buf();
        self.spawn(move || {
            let (projects, ended) = recover(&folder);
            let projects = projects.into_iter().map(|project| {
                let kind = Kind::of(&project.document.source);
                (project, kind)
            });
            Done::Recovered(projects.collect(), ended, Session::create(&folder).ok())
        });
    }

    /// Opens a picture, or a project.
    pub fn open(&mut self, path: &Path) {
        let path = path.to_path_buf();
        self.spawn(move || {
            let project = open(&path);
            Done::Opened(path, project)
        });
    }

    /// Saves a project.
    pub fn save(&mut self, number: u64, project: Project, path: PathBuf) {
        self.spawn(move || {
            let saved = project.save(&path).map_err(|error| error.to_string());
            Done::Saved(number, path, saved.map(|()| project.document))
        });
    }

    /// Writes the result of a document.
    pub fn export(&mut self, document: Document, path: PathBuf) {
        let number = self.next_export;
        self.next_export += 1;
        let update = Arc::new(Mutex::new(None));
        let (own, repaint) = (update.clone(), self.repaint.clone());
        let progress = Progress::new(move |update| {
            *lock(&own) = Some(update);
            repaint();
        });
        self.exports.push(Export {
            number,
            progress: progress.clone(),
            update,
            since: Instant::now(),
        });
        self.spawn(move || Done::Exported(number, export(&document, &path, &progress)));
    }

    /// The tasks that have ended since the last call.
    pub fn ended(&mut self) -> Vec<Done> {
        let ended: Vec<Done> = self.receiver.try_iter().collect();
        self.running -= ended.len();
        for done in &ended {
            if let Done::Exported(number, _) = done {
                self.exports.retain(|export| export.number != *number);
            }
        }
        ended
    }
}

/// True for the name of a project.
pub(crate) fn is_project(path: &Path) -> bool {
    path.extension()
        .is_some_and(|extension| extension.eq_ignore_ascii_case("json"))
}

fn open(path: &Path) -> Result<(Project, Kind), String> {
    if is_project(path) {
        let project = Project::load(path).map_err(|error| error.to_string())?;
        let kind = Kind::of(&project.document.source);
        return Ok((project, kind));
    }
    let whole = std::path::absolute(path).unwrap_or_else(|_| path.to_path_buf());
    // a missing file is refused here; what is no picture by the engine
    let is_pattern = whole.to_string_lossy().contains('%');
    if !is_pattern {
        std::fs::metadata(&whole).map_err(|error| format!("{}: {error}", path.display()))?;
    }
    let kind = Kind::of(&whole);
    let stem = whole
        .file_stem()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned();
    let name = format!("{stem}-edited.{}", kind.extension());
    let project = Project {
        output: whole.with_file_name(name),
        document: Document::new(whole),
    };
    Ok((project, kind))
}

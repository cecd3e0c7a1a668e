//! Reading and writing of files beside the window.

use crate::autosave::{EndedRuns, Session, recover};
use crate::content::Kind;
use crate::document::Document;
use crate::engine::export;
use crate::engine::lock;
use crate::example;
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

/// State of an export.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum ExportState {
    /// Its turn has not come.
    Waiting,
    /// It is written.
    Running,
    /// It is there: the files.
    Done(Vec<PathBuf>),
    /// It has failed, for this reason.
    Failed(String),
    /// It was stopped by hand.
    Stopped,
}

/// An export of the render queue.
pub(crate) struct Export {
    pub number: u64,
    document: Document,
    pub path: PathBuf,
    pub state: ExportState,
    progress: Progress,
    update: Arc<Mutex<Option<Update>>>,
    since: Instant,
}

impl Export {
    /// Name of the phase, and the share of it that is done.
    pub fn phase(&self) -> (&'static str, f64) {
        lock(&self.update).map_or(("export", 0.0), |update| (update.phase, update.fraction()))
    }

    /// Time since it began.
    pub fn elapsed(&self) -> Duration {
        self.since.elapsed()
    }

    /// True while it is written.
    pub fn is_running(&self) -> bool {
        self.state == ExportState::Running
    }
}

/// Tasks on files.
pub(crate) struct Background {
    sender: Sender<Done>,
    receiver: Receiver<Done>,
    repaint: Arc<dyn Fn() + Send + Sync>,
    /// Tasks that have not ended.
    pub running: usize,
    /// The render queue: exports in their order, one of which is written at a time.
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

    /// Appends an export to the queue.
    pub fn export(&mut self, document: Document, path: PathBuf) {
        let number = self.next_export;
        self.next_export += 1;
        self.exports.push(Export {
            number,
            document,
            path,
            state: ExportState::Waiting,
            progress: Progress::none(),
            update: Arc::default(),
            since: Instant::now(),
        });
        self.next();
    }

    /// Starts the next export, if none is running.
    fn next(&mut self) {
        if self.exports.iter().any(Export::is_running) {
            return;
        }
        let waits = |export: &&mut Export| export.state == ExportState::Waiting;
        let Some(export) = self.exports.iter_mut().find(waits) else {
            return;
        };
        let (own, repaint) = (export.update.clone(), self.repaint.clone());
        *lock(&own) = None;
        let progress = Progress::new(move |update| {
            *lock(&own) = Some(update);
            repaint();
        });
        export.progress = progress.clone();
        export.state = ExportState::Running;
        export.since = Instant::now();
        let (number, document, path) =
            (export.number, export.document.clone(), export.path.clone());
        self.spawn(move || Done::Exported(number, self::export(&document, &path, &progress)));
    }

    fn find(&mut self, number: u64) -> Option<&mut Export> {
        let mut exports = self.exports.iter_mut();
        exports.find(|export| export.number == number)
    }

    /// Stops an export. Files are whole or absent.
    pub fn stop(&mut self, number: u64) {
        if let Some(export) = self.find(number) {
            export.progress.cancel();
            export.state = match export.state {
                // it ends by itself
                ExportState::Running => return,
                _ => ExportState::Stopped,
            };
        }
    }

    /// Puts an export that has ended at the end of the queue.
    pub fn again(&mut self, number: u64) {
        let at = self
            .exports
            .iter()
            .position(|export| export.number == number);
        if let Some(at) = at.filter(|at| !self.exports[*at].is_running()) {
            let mut export = self.exports.remove(at);
            export.state = ExportState::Waiting;
            self.exports.push(export);
            self.next();
        }
    }

    /// Moves a waiting export before the waiting one ahead of it.
    pub fn earlier(&mut self, number: u64) {
        let waits = |export: &Export| export.state == ExportState::Waiting;
        let at = self
            .exports
            .iter()
            .position(|export| export.number == number);
        if let Some(at) = at.filter(|at| *at > 0)
            && waits(&self.exports[at])
            && waits(&self.exports[at - 1])
        {
            self.exports.swap(at, at - 1);
        }
    }

    /// Drops an export that is not running from the queue.
    pub fn drop_export(&mut self, number: u64) {
        self.exports
            .retain(|export| export.number != number || export.is_running());
    }

    /// Draws the example, unless it is there, and opens it.
    pub fn open_example(&mut self, folder: &Path) {
        let folder = folder.to_path_buf();
        self.spawn(move || match example::prepare(&folder) {
            Ok(path) => {
                let project = open(&path);
                Done::Opened(path, project)
            }
            Err(reason) => Done::Opened(folder, Err(reason)),
        });
    }

    /// The tasks that have ended since the last call.
    pub fn ended(&mut self) -> Vec<Done> {
        let ended: Vec<Done> = self.receiver.try_iter().collect();
        self.running -= ended.len();
        for done in &ended {
            let Done::Exported(number, end) = done else {
                continue;
            };
            if let Some(export) = self.find(*number) {
                export.state = match end {
                    Ok(paths) => ExportState::Done(paths.clone()),
                    Err(_) if export.progress.is_cancelled() => ExportState::Stopped,
                    Err(reason) => ExportState::Failed(reason.clone()),
                };
            }
        }
        self.next();
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

//! Documents that outlive the program.
//!
//! Each run of the studio has a folder, which it locks, with a project for each open document. A folder that nobody has locked belongs to
//! a run that has ended without closing its documents: they are opened again.

use crate::project::Project;
use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread::JoinHandle;
use std::time::{SystemTime, UNIX_EPOCH};

/// Name of the lock in a folder.
const LOCK: &str = "lock";

/// The folder of all runs for this user; `None` where there is no home.
pub fn default_folder() -> Option<PathBuf> {
    let named = |name: &str| {
        std::env::var_os(name)
            .filter(|value| !value.is_empty())
            .map(PathBuf::from)
    };
    let base = named("XDG_STATE_HOME")
        .or_else(|| named("LOCALAPPDATA"))
        .or_else(|| Some(named("HOME")?.join(".local/state")))?;
    Some(base.join("ravec/studio"))
}

/// The folder of this run.
pub struct Session {
    folder: PathBuf,
    /// Locked as long as it is open.
    _lock: File,
}

impl Session {
    /// A new folder among those of all runs.
    ///
    /// # Errors
    /// Those of the file system.
    pub fn create(folder: &Path) -> std::io::Result<Self> {
        let since = SystemTime::now()
            .duration_since(UNIX_EPOCH)
            .unwrap_or_default();
        let own = folder.join(format!("{}-{}", since.as_nanos(), std::process::id()));
        std::fs::create_dir_all(&own)?;
        let lock = OpenOptions::new()
            .write(true)
            .create(true)
            .truncate(false)
            .open(own.join(LOCK))?;
        lock.try_lock().map_err(std::io::Error::other)?;
        Ok(Self {
            folder: own,
            _lock: lock,
        })
    }

    /// The file of a document.
    fn file(&self, number: u64) -> PathBuf {
        self.folder.join(format!("{number}.json"))
    }

    /// Forgets all documents: the run ends in good order.
    pub fn end(self) {
        // what cannot be removed is offered again
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}

enum Message {
    Save(u64, Project),
    Forget(u64),
    Discard(EndedRuns),
}

/// Saves documents beside the window, of each document the last state.
pub struct Autosave {
    sender: Option<Sender<Message>>,
    writer: Option<JoinHandle<Session>>,
}

impl Autosave {
    /// Starts to save in a session.
    pub fn new(session: Session) -> Self {
        let (sender, receiver) = channel();
        let writer = std::thread::Builder::new().name("autosave".to_owned());
        Self {
            sender: Some(sender),
            writer: writer.spawn(move || write(session, &receiver)).ok(),
        }
    }

    /// Saves the state of a document soon.
    pub fn save(&self, number: u64, project: Project) {
        self.send(Message::Save(number, project));
    }

    /// Forgets a document that was closed.
    pub fn forget(&self, number: u64) {
        self.send(Message::Forget(number));
    }

    /// Removes the copies of runs that have ended, once everything that was to be saved before is saved. If that fails they stay
    /// and are offered again.
    pub fn discard(&self, runs: EndedRuns) {
        self.send(Message::Discard(runs));
    }

    fn send(&self, message: Message) {
        if let Some(sender) = &self.sender {
            // without a writer nothing is saved, and the window still works
            let _ = sender.send(message);
        }
    }

    /// Waits until everything is saved; the session.
    pub fn finish(mut self) -> Option<Session> {
        self.sender = None;
        self.writer.take()?.join().ok()
    }
}

impl Drop for Autosave {
    /// Waits until everything is saved; the files stay.
    fn drop(&mut self) {
        self.sender = None;
        if let Some(writer) = self.writer.take() {
            // a panic of the writer was reported where it happened
            let _ = writer.join();
        }
    }
}

/// Writes what comes, the last state only where several wait.
fn write(session: Session, receiver: &Receiver<Message>) -> Session {
    while let Ok(first) = receiver.recv() {
        let mut states: BTreeMap<u64, Option<Project>> = BTreeMap::new();
        let mut ended = Vec::new();
        for message in std::iter::once(first).chain(receiver.try_iter()) {
            match message {
                Message::Save(number, project) => {
                    states.insert(number, Some(project));
                }
                Message::Forget(number) => {
                    states.insert(number, None);
                }
                Message::Discard(runs) => ended.push(runs),
            }
        }
        let mut all_saved = true;
        for (number, project) in states {
            let file = session.file(number);
            // a full disk is met again at the next gesture, and by the next save of the user, who is told
            match project {
                Some(project) => all_saved &= project.save(&file).is_ok(),
                None => {
                    let _ = std::fs::remove_file(&file);
                }
            }
        }
        if all_saved {
            ended.into_iter().for_each(EndedRuns::remove);
        }
    }
    session
}

/// Folders of runs that have ended without closing their documents, locked against other runs that look for them.
pub struct EndedRuns(Vec<(PathBuf, File)>);

impl EndedRuns {
    /// Removes the folders.
    fn remove(self) {
        for (folder, _lock) in self.0 {
            // what cannot be removed is offered again
            let _ = std::fs::remove_dir_all(folder);
        }
    }
}

/// The documents of runs that have ended without closing them, and the folders of these runs, to be
/// [discarded](Autosave::discard) once the documents are saved again.
pub fn recover(folder: &Path) -> (Vec<Project>, EndedRuns) {
    let mut found = Vec::new();
    let mut ended = EndedRuns(Vec::new());
    let Ok(runs) = std::fs::read_dir(folder) else {
        return (found, ended);
    };
    let mut runs: Vec<PathBuf> = runs.flatten().map(|entry| entry.path()).collect();
    runs.sort();
    for run in runs {
        let Ok(lock) = OpenOptions::new().write(true).open(run.join(LOCK)) else {
            continue;
        };
        if lock.try_lock().is_err() {
            continue;
        }
        let files = std::fs::read_dir(&run)
            .into_iter()
            .flatten()
            .flatten()
            .map(|entry| entry.path());
        let mut files: Vec<PathBuf> = files
            .filter(|path| path.extension().is_some_and(|e| e == "json"))
            .collect();
        files.sort();
        let projects: Vec<_> = files.iter().map(|file| Project::load(file)).collect();
        let whole = projects.iter().all(Result::is_ok);
        found.extend(projects.into_iter().flatten());
        if whole {
            ended.0.push((run, lock));
        }
    }
    (found, ended)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::document::Document;

    fn project(name: &str) -> Project {
        let mut document = Document::new(std::path::absolute(name).unwrap());
        document.push("twocolor", serde_json::Map::new());
        Project {
            document,
            output: std::path::absolute("out.png").unwrap(),
        }
    }

    #[test]
    fn documents_of_a_killed_run_come_back_once() {
        let folder = tempfile::tempdir().unwrap();
        let killed = Autosave::new(Session::create(folder.path()).unwrap());
        killed.save(1, project("old.png"));
        killed.save(1, project("a.png"));
        killed.save(2, project("b.png"));
        killed.forget(2);
        // the lock is dropped with the session, as at the end of a process; the files stay
        drop(killed.finish().unwrap());
        let running = Autosave::new(Session::create(folder.path()).unwrap());
        running.save(1, project("c.png"));
        let (projects, ended) = recover(folder.path());
        assert_eq!(projects, [project("a.png")]);
        assert_eq!(recover(folder.path()).0, [], "another run has them");
        // a kill before they are saved again loses nothing
        drop(ended);
        let (projects, ended) = recover(folder.path());
        assert_eq!(projects, [project("a.png")]);
        running.save(2, project("a.png"));
        running.discard(ended);
        let session = running.finish().unwrap();
        assert!(session.file(2).exists());
        assert_eq!(recover(folder.path()).0, []);
        session.end();
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }
}

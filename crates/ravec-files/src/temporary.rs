//! Temporary files and folders beside the targets whose place they take.
//!
//! A temporary is named `.ravec-TARGET-RANDOM.part`. As long as it is in use, its process holds a lock on it, which the
//! system releases however the process ends: a temporary of the same target without a lock is left over from a process that
//! was killed, and [`remove_stale`] removes it. All temporaries in use are registered, so that a program that has to end at
//! once can [`abandon_outputs`].
//!
//! Does not guarantee: that leftovers are found on file systems without locks.

use std::ffi::OsStr;
use std::fs::{self, File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError, TryLockError as TryMutexError};
use std::time::{Duration, Instant};
use tempfile::NamedTempFile;

const PREFIX: &str = ".ravec-";
const SUFFIX: &str = ".part";

/// Random letters and digits in the name of a temporary.
const RANDOM_CHARS: usize = 8;

/// Bytes of a target's name that are kept in the name of its temporary: file systems allow 255 in all.
const MAX_TARGET_BYTES: usize = 200;

/// Attempts to make a temporary that no other process takes for a leftover before it is locked.
const MAX_ATTEMPTS: usize = 16;

/// Time that [`abandon_outputs`] waits for a file operation of another thread.
const ABANDON_PATIENCE: Duration = Duration::from_millis(50);

/// All temporaries of this process.
static REGISTRY: Mutex<Registry> = Mutex::new(Registry {
    paths: Vec::new(),
    abandoned: false,
});

struct Registry {
    paths: Vec<PathBuf>,
    abandoned: bool,
}

impl Registry {
    fn lock() -> MutexGuard<'static, Self> {
        // a list of paths is consistent at any time
        REGISTRY.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Refuses to begin or to finish an output after all were abandoned.
    fn check(&self) -> io::Result<()> {
        if self.abandoned {
            return Err(io::Error::other("the program is ending"));
        }
        Ok(())
    }

    fn forget(&mut self, path: &Path) {
        self.paths.retain(|known| known != path);
    }
}

/// Removes all temporaries of this process, and lets no further output begin or take its place: for a program that ends
/// at once and not by returning from its work. Finished files stay.
pub fn abandon_outputs() {
    let start = Instant::now();
    let mut registry = loop {
        match REGISTRY.try_lock() {
            Ok(registry) => break registry,
            Err(TryMutexError::Poisoned(poisoned)) => break poisoned.into_inner(),
            Err(TryMutexError::WouldBlock) if start.elapsed() > ABANDON_PATIENCE => return,
            Err(TryMutexError::WouldBlock) => std::thread::sleep(Duration::from_millis(1)),
        }
    };
    registry.abandoned = true;
    for path in std::mem::take(&mut registry.paths) {
        // there is nobody to report to; the next run removes what stays
        let _ = if path.is_dir() {
            fs::remove_dir_all(&path)
        } else {
            fs::remove_file(&path)
        };
    }
}

/// A registered temporary file.
pub(crate) struct TemporaryFile {
    file: Option<NamedTempFile>,
}

impl TemporaryFile {
    /// A locked file beside `target`, with the permissions of any new file.
    pub(crate) fn beside(target: &Path) -> io::Result<Self> {
        let name = name_of(target);
        for _ in 0..MAX_ATTEMPTS {
            let mut registry = Registry::lock();
            registry.check()?;
            let file = new_file(&name, folder_of(target))?;
            registry.paths.push(file.path().to_path_buf());
            let temporary = Self { file: Some(file) };
            drop(registry);
            if lock(temporary.as_file(), temporary.path()) {
                return Ok(temporary);
            }
        }
        Err(io::Error::other(
            "other processes remove its temporary file",
        ))
    }

    pub(crate) fn as_file(&self) -> &File {
        self.file
            .as_ref()
            .expect("taken only when this is consumed")
            .as_file()
    }

    fn path(&self) -> &Path {
        self.file
            .as_ref()
            .expect("taken only when this is consumed")
            .path()
    }

    /// Takes the place of `target`, durably: after a loss of power the target has its old content or all of the new one.
    pub(crate) fn persist(mut self, target: &Path) -> io::Result<()> {
        self.as_file().sync_all()?;
        let mut registry = Registry::lock();
        registry.check()?;
        let Some(file) = self.file.take() else {
            return Ok(());
        };
        let path = file.path().to_path_buf();
        let persisted = file.persist(target);
        registry.forget(&path);
        drop(registry);
        persisted.map_err(|failed| failed.error)?;
        sync_folder(folder_of(target));
        Ok(())
    }
}

impl Drop for TemporaryFile {
    fn drop(&mut self) {
        if let Some(file) = self.file.take() {
            let mut registry = Registry::lock();
            registry.forget(file.path());
            drop(file);
        }
    }
}

/// A folder under a temporary name beside the place that it takes in the end. It is removed with all that is in it if it does
/// not.
#[derive(Debug)]
pub struct TemporaryFolder {
    path: PathBuf,
    /// Holds the lock.
    _handle: Option<File>,
    kept: bool,
}

impl TemporaryFolder {
    /// An empty folder beside `target`. Leftovers of killed processes that were to take the same place are removed.
    ///
    /// # Errors
    /// If the folder of `target` is missing or cannot be written into.
    pub fn beside(target: &Path) -> io::Result<Self> {
        remove_stale(target);
        let name = name_of(target);
        for _ in 0..MAX_ATTEMPTS {
            let mut registry = Registry::lock();
            registry.check()?;
            let path = new_folder(&name, folder_of(target))?;
            registry.paths.push(path.clone());
            drop(registry);
            // only unix opens folders; elsewhere leftovers of folders stay
            let handle = File::open(&path).ok();
            let locked = handle.as_ref().is_none_or(|handle| lock(handle, &path));
            let folder = Self {
                path,
                _handle: handle,
                kept: false,
            };
            if locked {
                return Ok(folder);
            }
        }
        Err(io::Error::other(
            "other processes remove its temporary folder",
        ))
    }

    /// Current path of the folder.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Takes the place of `target`, which must not be there.
    ///
    /// Does not guarantee: that the files have reached the disk when the machine loses power.
    ///
    /// # Errors
    /// If the folder cannot be renamed; it is removed then.
    pub fn persist(mut self, target: &Path) -> io::Result<()> {
        let mut registry = Registry::lock();
        registry.check()?;
        fs::rename(&self.path, target)?;
        registry.forget(&self.path);
        self.kept = true;
        Ok(())
    }
}

impl Drop for TemporaryFolder {
    fn drop(&mut self) {
        if !self.kept {
            let mut registry = Registry::lock();
            // what cannot be removed is removed by the next run
            let _ = fs::remove_dir_all(&self.path);
            registry.forget(&self.path);
        }
    }
}

/// Removes temporaries that killed processes left beside `target`, which they were to replace. Files that cannot be
/// removed stay.
pub(crate) fn remove_stale(target: &Path) {
    let start = format!("{PREFIX}{}-", name_of(target));
    remove_unlocked(folder_of(target), |name| {
        name.strip_prefix(start.as_str())
            .and_then(|rest| rest.strip_suffix(SUFFIX))
            .is_some_and(is_random)
    });
}

/// Removes temporaries that killed processes left in `folder`, whatever they were to replace. Files that cannot be
/// removed stay.
pub fn remove_stale_in(folder: &Path) {
    remove_unlocked(folder, |name| {
        name.strip_prefix(PREFIX)
            .and_then(|rest| rest.strip_suffix(SUFFIX))
            .and_then(|rest| rest.rsplit_once('-'))
            .is_some_and(|(_, random)| is_random(random))
    });
}

fn is_random(text: &str) -> bool {
    text.len() == RANDOM_CHARS && text.bytes().all(|byte| byte.is_ascii_alphanumeric())
}

fn remove_unlocked(folder: &Path, wanted: impl Fn(&str) -> bool) {
    let Ok(entries) = fs::read_dir(folder) else {
        return;
    };
    for entry in entries.flatten() {
        if !entry.file_name().to_str().is_some_and(&wanted) {
            continue;
        }
        let (path, kind) = (entry.path(), entry.file_type());
        // links and pipes are not ours, and opening a pipe would wait
        let Ok(kind) = kind else { continue };
        if !kind.is_file() && !kind.is_dir() {
            continue;
        }
        let Ok(handle) = File::open(&path) else {
            continue;
        };
        if handle.try_lock().is_err() {
            continue;
        }
        // somebody else may be removing it as well
        let _ = if kind.is_dir() {
            fs::remove_dir_all(&path)
        } else {
            fs::remove_file(&path)
        };
    }
}

/// Locks a new temporary. False if another process took it for a leftover before.
fn lock(handle: &File, path: &Path) -> bool {
    match handle.try_lock() {
        Ok(()) => path.symlink_metadata().is_ok(),
        Err(TryLockError::WouldBlock) => false,
        // no locks on this file system: then nobody takes anything for a leftover
        Err(TryLockError::Error(_)) => true,
    }
}

fn name_of(target: &Path) -> String {
    let name = target.file_name().unwrap_or(OsStr::new("output"));
    let name = name.to_string_lossy();
    let mut end = name.len().min(MAX_TARGET_BYTES);
    while !name.is_char_boundary(end) {
        end -= 1;
    }
    name[..end].to_owned()
}

/// Lets `make` make something under a random name that belongs to the target `name`.
fn with_random_name<T>(
    name: &str,
    make: impl FnOnce(&mut tempfile::Builder<'_, '_>) -> io::Result<T>,
) -> io::Result<T> {
    let prefix = format!("{PREFIX}{name}-");
    let mut builder = tempfile::Builder::new();
    builder
        .prefix(&prefix)
        .suffix(SUFFIX)
        .rand_bytes(RANDOM_CHARS);
    make(&mut builder).map_err(in_plain_words)
}

fn new_file(name: &str, folder: &Path) -> io::Result<NamedTempFile> {
    with_random_name(name, |builder| {
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt as _;
            // the default of temporary files is private; the system takes the umask off these
            builder.permissions(fs::Permissions::from_mode(0o666));
        }
        builder.tempfile_in(folder)
    })
}

fn new_folder(name: &str, folder: &Path) -> io::Result<PathBuf> {
    with_random_name(name, |builder| {
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt as _;
            builder.permissions(fs::Permissions::from_mode(0o777));
        }
        Ok(builder.tempdir_in(folder)?.keep())
    })
}

/// The error without the name of the temporary, which the caller does not know.
fn in_plain_words(error: io::Error) -> io::Error {
    match error.kind() {
        kind @ io::ErrorKind::NotFound => io::Error::new(kind, "its folder does not exist"),
        kind @ io::ErrorKind::PermissionDenied => {
            io::Error::new(kind, "its folder is write-protected")
        }
        kind @ io::ErrorKind::NotADirectory => {
            io::Error::new(kind, "what should be its folder is a file")
        }
        _ => match error.raw_os_error() {
            Some(code) => io::Error::from_raw_os_error(code),
            None => error,
        },
    }
}

pub(crate) fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if folder != Path::new("") => folder,
        _ => Path::new("."),
    }
}

/// Makes a rename in `folder` durable where the system can.
fn sync_folder(folder: &Path) {
    // a file system that cannot do so makes no promise that could be kept
    if let Ok(folder) = File::open(folder) {
        let _ = folder.sync_all();
    }
}

/// A new file in the system's folder for temporary files, without a name: it is gone when it is closed, whatever happens to the
/// program.
///
/// # Errors
/// Those of the file system.
pub fn nameless_file() -> std::io::Result<std::fs::File> {
    tempfile::tempfile()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let entries = fs::read_dir(folder).unwrap();
        let mut names: Vec<_> = entries
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }

    fn put(path: &Path) {
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        File::options()
            .write(true)
            .create_new(true)
            .open(path)
            .unwrap();
    }

    #[test]
    fn leftovers_of_the_same_target_are_removed_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let strangers = [
            ".ravec-a.png-12345678.part.txt",
            ".ravec-a.png-1234567.part",
            ".ravec-a.png-b-12345678.part",
            ".ravec-b.png-abcdefgh.part",
            "ravec-a.png-12345678.part",
        ];
        for name in strangers {
            put(&at(name));
        }
        put(&at(".ravec-a.png-12345678.part"));
        put(&at(".ravec-a.png-abcDEF12.part/deep/file"));
        let alive = TemporaryFile::beside(&at("a.png")).unwrap();
        remove_stale(&at("a.png"));
        let mut expected: Vec<_> = strangers.map(str::to_owned).to_vec();
        let own = alive.path().file_name().unwrap().to_str().unwrap();
        assert!(own.starts_with(".ravec-a.png-"), "{own}");
        expected.push(own.to_owned());
        expected.sort();
        assert_eq!(names(folder.path()), expected, "one that is in use stays");
        drop(alive);
        remove_stale_in(folder.path());
        assert_eq!(
            names(folder.path()),
            [strangers[1], strangers[0], strangers[4]],
            "those of all targets, but nothing with another name"
        );
    }

    #[test]
    fn a_folder_takes_its_place_or_is_removed_and_replaces_leftovers() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("page");
        put(&folder.path().join(".ravec-page-12345678.part/old"));
        let temporary = TemporaryFolder::beside(&target).unwrap();
        put(&temporary.path().join("new"));
        drop(temporary);
        assert!(names(folder.path()).is_empty());
        let temporary = TemporaryFolder::beside(&target).unwrap();
        put(&temporary.path().join("new"));
        remove_stale(&target);
        temporary.persist(&target).unwrap();
        assert_eq!(names(folder.path()), ["page"]);
        assert_eq!(names(&target), ["new"]);
    }

    #[test]
    fn a_long_name_and_one_without_text_get_a_temporary() {
        let folder = tempfile::tempdir().unwrap();
        let long = folder.path().join("ü".repeat(120));
        drop(TemporaryFile::beside(&long).unwrap());
        assert_eq!(name_of(&long).len(), 200);
        assert_eq!(name_of(Path::new("..")), "output");
    }
}

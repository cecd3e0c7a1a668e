//! The place of a page: an older page there is replaced, and nothing else is.
//!
//! The new page is complete in a folder beside the place before it is moved there. On Linux the two folders exchange their names
//! at once. Elsewhere the old page is first moved aside; a process that is killed between these two moves leaves both pages
//! under other names, and the next run with the same place moves the old one back.
//!
//! The old page is `.ravec-NAME-RANDOM.old` until its files are removed, those of its manifest alone. A process that is
//! removing them holds a lock on the folder; without a lock, a later run goes on with that.

use super::PageError;
use super::manifest::{DESCRIPTION, Manifest, Mismatch};
use crate::catalogue::place_of;
use ravec_files::TemporaryFolder;
use ravec_media::WriteError;
use ravec_progress::Progress;
use std::ffi::OsStr;
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

const PREFIX: &str = ".ravec-";
const OLD: &str = ".old";
const PART: &str = ".part";

/// Bytes of names that passing names may have only the beginning of.
const LONG_NAME_BYTES: usize = 190;

/// Advice about a folder that is not replaced.
const ADVICE: &str = "name a new folder";

/// The place of a page.
#[derive(Debug)]
pub(super) struct Place {
    /// As the caller has it.
    named: PathBuf,
    /// Behind links: a link to a folder stays.
    path: PathBuf,
}

/// Content at the place of a page.
enum Old {
    Nothing,
    /// A page, or an empty folder.
    Page(Manifest),
}

impl Place {
    /// Finds the place, and takes back or completes what killed processes left beside it.
    pub fn find(named: &Path) -> Result<Self, PageError> {
        let place = Self {
            named: named.into(),
            path: place_of(named),
        };
        if named.file_name().is_none() || place.path.file_name().is_none() {
            return Err(place.refused("the folder needs a name of its own"));
        }
        place.repair();
        Ok(place)
    }

    /// As the caller has it.
    pub fn named(&self) -> &Path {
        &self.named
    }

    /// Behind links.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Refuses a place where something is that no page of an earlier run is.
    pub fn check(&self, progress: &Progress) -> Result<(), PageError> {
        self.old(progress).map(drop)
    }

    fn old(&self, progress: &Progress) -> Result<Old, PageError> {
        let metadata = match self.path.symlink_metadata() {
            Ok(metadata) => metadata,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Old::Nothing),
            Err(error) => return Err(self.failed(error)),
        };
        if !metadata.is_dir() {
            return Err(self.refused("it is there and not a folder"));
        }
        if is_mount_point(&self.path) {
            return Err(self.refused("a disk is mounted there; name a folder in it"));
        }
        let manifest = || -> Result<Manifest, Mismatch> {
            if let Some(manifest) = Manifest::read(&self.path)? {
                manifest.check(&self.path, progress)?;
                return Ok(manifest);
            }
            if self.path.join(DESCRIPTION).symlink_metadata().is_ok() {
                let text =
                    "it has no list of its files, as pages of earlier versions; remove it yourself";
                return Err(Mismatch::Refused(format!("{text}, or {ADVICE}")));
            }
            // the manifest of nothing: an empty folder passes
            let manifest = Manifest::default();
            manifest.check(&self.path, progress)?;
            Ok(manifest)
        };
        match manifest() {
            Ok(manifest) => Ok(Old::Page(manifest)),
            Err(Mismatch::Cancelled(cancelled)) => Err(cancelled.into()),
            Err(Mismatch::Refused(text)) => Err(self.refused(&text)),
            Err(Mismatch::Io(error)) => Err(self.failed(error)),
        }
    }

    /// Moves a complete page here, after checking again what is here. Returns a folder in which something stays that was put
    /// into the old page in the meantime.
    pub fn take(
        &self,
        page: TemporaryFolder,
        progress: &Progress,
    ) -> Result<Option<PathBuf>, PageError> {
        let failed = |error| self.failed(error);
        let manifest = match self.old(progress)? {
            Old::Nothing => {
                page.persist(&self.path).map_err(failed)?;
                return Ok(None);
            }
            Old::Page(manifest) => manifest,
        };
        let aside = self.aside(page.path()).map_err(failed)?;
        let _lock = locked(&self.path);
        if exchange(page.path(), &self.path) {
            if let Err(error) = fs::rename(page.path(), &aside) {
                exchange(page.path(), &self.path);
                return Err(failed(error));
            }
        } else {
            fs::rename(&self.path, &aside).map_err(failed)?;
            if let Err(error) = page.persist(&self.path) {
                // if that fails as well, the next run tries it again
                let _ = fs::rename(&aside, &self.path);
                return Err(failed(error));
            }
        }
        // another run may have put its page here since
        let own = Manifest::read(&aside).ok().flatten();
        let gone = own.unwrap_or(manifest).remove(&aside);
        Ok((!gone).then_some(aside))
    }

    /// The passing name of the old page, with the random part of that of the new one.
    fn aside(&self, page: &Path) -> io::Result<PathBuf> {
        let name = page.file_name().and_then(OsStr::to_str);
        let stem = name.and_then(|name| name.strip_suffix(PART));
        let stem =
            stem.ok_or_else(|| io::Error::other("the temporary folder has a strange name"))?;
        Ok(self.path.with_file_name(format!("{stem}{OLD}")))
    }

    /// Finds old pages that killed processes left beside the place: moves one back if the place is empty, else removes
    /// the files of their manifests. Damage that cannot be repaired stays as it is.
    fn repair(&self) {
        let Some(name) = self.path.file_name() else {
            return;
        };
        let target = name.to_string_lossy();
        let folder = self.path.parent().unwrap_or(Path::new("."));
        let Ok(entries) = fs::read_dir(folder) else {
            return;
        };
        for entry in entries.flatten() {
            let name = entry.file_name();
            let of_target = name.to_str().and_then(|name| {
                let (of, _random) = name
                    .strip_prefix(PREFIX)?
                    .strip_suffix(OLD)?
                    .rsplit_once('-')?;
                // long names are cut
                Some(target == of || (of.len() >= LONG_NAME_BYTES && target.starts_with(of)))
            });
            let is_folder = entry.file_type().is_ok_and(|kind| kind.is_dir());
            if of_target != Some(true) || !is_folder {
                continue;
            }
            let path = entry.path();
            // a living process is at work on it
            let Some(_lock) = locked(&path) else { continue };
            if self.path.symlink_metadata().is_err() {
                let _ = fs::rename(&path, &self.path);
            } else if let Ok(Some(manifest)) = Manifest::read(&path) {
                manifest.remove(&path);
            } else {
                // an empty folder was replaced
                let _ = fs::remove_dir(&path);
            }
        }
    }

    pub fn failed(&self, cause: io::Error) -> PageError {
        PageError::Write(WriteError {
            path: self.named.clone(),
            cause: cause.into(),
        })
    }

    fn refused(&self, reason: &str) -> PageError {
        self.failed(io::Error::new(io::ErrorKind::AlreadyExists, reason))
    }
}

/// The lock held while a folder is moved aside and removed.
struct Lock {
    _handle: Option<File>,
}

/// Locks a folder. None if another process has the lock. On file systems without locks everybody gets one.
fn locked(folder: &Path) -> Option<Lock> {
    // only unix opens folders
    let Ok(handle) = File::open(folder) else {
        return Some(Lock { _handle: None });
    };
    match handle.try_lock() {
        Err(fs::TryLockError::WouldBlock) => None,
        _ => Some(Lock {
            _handle: Some(handle),
        }),
    }
}

/// Exchanges the names of two folders at once, where the system can do that. False if it cannot.
#[cfg(target_os = "linux")]
fn exchange(a: &Path, b: &Path) -> bool {
    use rustix::fs::{CWD, RenameFlags, renameat_with};
    renameat_with(CWD, a, CWD, b, RenameFlags::EXCHANGE).is_ok()
}

#[cfg(not(target_os = "linux"))]
fn exchange(_: &Path, _: &Path) -> bool {
    false
}

/// Returns `true` if a folder is on another device than the folder that it is in, so that it cannot be renamed.
fn is_mount_point(folder: &Path) -> bool {
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt as _;
        let device = |path: &Path| path.metadata().map(|found| found.dev()).ok();
        let parent = folder.parent().and_then(device);
        parent.is_some() && device(folder) != parent
    }
    #[cfg(not(unix))]
    {
        let _ = folder;
        false
    }
}

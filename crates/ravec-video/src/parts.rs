//! Finished parts of an output that takes long, from which an interrupted run goes on.
//!
//! A clip is encoded in chunks of [`CHUNK_FRAMES`] frames, each with an encoder of its own, in a folder `.ravec-NAME.parts`
//! beside the output. A chunk gets its name when it is whole, so that a run which is killed at any moment leaves whole chunks.
//! The next run either goes on behind them, if it makes the same clip, or removes them.
//!
//! Guarantees: the same bytes with and without an interruption. The folder is locked while a run uses it.

use crate::error::VideoError;
use ravec_files::write_atomically;
use std::fs::{self, File};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

/// Frames of a chunk: ten seconds at 25 frames a second.
pub const CHUNK_FRAMES: u64 = 250;

/// The folder of the parts of one output.
pub(crate) struct Parts {
    folder: PathBuf,
    extension: String,
    /// Whole chunks.
    finished: u64,
    _lock: File,
    removed: bool,
}

const KEY_FILE: &str = "key";
const LOCK_FILE: &str = "lock";
/// Number of the pictures that are whole, for outputs that are pictures.
const COUNT_FILE: &str = "count";

impl Parts {
    /// The folder for the parts of an output.
    pub fn folder_for(output: &Path) -> PathBuf {
        let name = output.file_name().unwrap_or_default().to_string_lossy();
        output.with_file_name(format!(".ravec-{name}.parts"))
    }

    /// Opens the folder. Parts that are there stay if `resume` is true and they were made for the same `key`; else they are
    /// removed.
    ///
    /// # Errors
    /// If another run uses the folder, or an error of the file system.
    pub fn open(
        output: &Path,
        extension: &str,
        key: &str,
        resume: bool,
    ) -> Result<Self, VideoError> {
        let folder = Self::folder_for(output);
        fs::create_dir_all(&folder)?;
        let lock = File::options()
            .create(true)
            .write(true)
            .truncate(false)
            .open(folder.join(LOCK_FILE))?;
        if let Err(fs::TryLockError::WouldBlock) = lock.try_lock() {
            return Err(VideoError::Io(io::Error::other(
                "another run is writing this file",
            )));
        }
        let same = fs::read_to_string(folder.join(KEY_FILE)).is_ok_and(|found| found == key);
        let mut parts = Self {
            folder,
            extension: extension.to_owned(),
            finished: 0,
            _lock: lock,
            removed: false,
        };
        if resume && same {
            while parts.chunk_path(parts.finished).exists() {
                parts.finished += 1;
            }
        } else {
            parts.clear()?;
            write_atomically(&parts.folder.join(KEY_FILE), |file| {
                file.write_all(key.as_bytes())
            })?;
        }
        Ok(parts)
    }

    /// Removes everything but the lock.
    fn clear(&self) -> io::Result<()> {
        for entry in fs::read_dir(&self.folder)? {
            let entry = entry?;
            if entry.file_name() != LOCK_FILE {
                fs::remove_file(entry.path())?;
            }
        }
        Ok(())
    }

    fn chunk_path(&self, chunk: u64) -> PathBuf {
        self.folder.join(format!("{chunk:06}.{}", self.extension))
    }

    /// Whole chunks.
    pub fn finished(&self) -> u64 {
        self.finished
    }

    /// The file in which the next chunk is made.
    pub fn next_path(&self) -> PathBuf {
        self.folder.join(format!("next.{}", self.extension))
    }

    /// Declares the next chunk whole.
    ///
    /// # Errors
    /// An error of the file system.
    pub fn finish_chunk(&mut self) -> io::Result<()> {
        File::open(self.next_path())?.sync_all()?;
        fs::rename(self.next_path(), self.chunk_path(self.finished))?;
        self.finished += 1;
        Ok(())
    }

    /// The whole chunks, in their order.
    pub fn chunks(&self) -> Vec<PathBuf> {
        (0..self.finished)
            .map(|chunk| self.chunk_path(chunk))
            .collect()
    }

    /// A path for something else in the folder.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    /// Number of pictures that a run before has finished.
    pub fn picture_count(&self) -> u64 {
        let text = fs::read_to_string(self.folder.join(COUNT_FILE)).unwrap_or_default();
        text.trim().parse().unwrap_or(0)
    }

    /// Records the number of pictures that are finished.
    ///
    /// # Errors
    /// An error of the file system.
    pub fn set_picture_count(&mut self, count: u64) -> io::Result<()> {
        self.finished = self.finished.max(u64::from(count > 0));
        write_atomically(&self.folder.join(COUNT_FILE), |file| {
            write!(file, "{count}")
        })
    }

    /// Removes the folder.
    ///
    /// # Errors
    /// An error of the file system.
    pub fn remove(&mut self) -> io::Result<()> {
        self.removed = true;
        fs::remove_dir_all(&self.folder)
    }
}

impl Drop for Parts {
    /// Keeps the folder if there is something to go on from.
    fn drop(&mut self) {
        if self.removed {
            return;
        }
        // there is nobody to report to; the next run removes what stays
        let _ = fs::remove_file(self.next_path());
        if self.finished == 0 {
            let _ = fs::remove_dir_all(&self.folder);
        }
    }
}

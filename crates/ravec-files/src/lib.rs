//! Files that appear whole or not at all, temporaries beside them, and the name of standard streams.
//!
//! [`write_atomically`] fills a temporary file beside the target and renames it at the end; [`check_writable`] finds out
//! before long work whether that can begin. [`TemporaryFolder`] does the same for a folder of files, [`scratch_file`] gives
//! room for data that do not fit in memory.
//!
//! ```
//! use std::io::Write as _;
//! use ravec_files::{check_writable, write_atomically};
//!
//! # let folder = tempfile::tempdir()?;
//! # let path = folder.path().join("notes.txt");
//! check_writable(&path)?;
//! write_atomically(&path, |file| file.write_all(b"whole"))?;
//! let failed = write_atomically(&path, |file| {
//!     file.write_all(b"half")?;
//!     Err::<(), _>(std::io::Error::other("no more"))
//! });
//! assert!(failed.is_err());
//! assert_eq!(std::fs::read(&path)?, b"whole");
//! # Ok::<(), std::io::Error>(())
//! ```
//!
//! Words: a *target* is the file that is to appear; a *temporary* is what takes its place at the end; a *leftover* is a
//! temporary whose process was killed.
//!
//! Guarantees: a target is old or new, never half written, also after a loss of power; leftovers of the same target are
//! removed by the next run; [`abandon_outputs`] removes all temporaries of the process at once. Does not guarantee: that hard
//! links and the owner of a replaced file survive, or that leftovers are found on file systems without locks.
//! Cost: one temporary file and one synchronization with the disk for each output.

mod atomic;
mod message;
mod stream;
mod temporary;

pub use atomic::{
    AtomicFile, AtomicWriter, check_writable, follow_links, scratch_file, write_atomically,
};
pub use message::message_without_code;
pub use stream::is_stream;
pub use temporary::{TemporaryFolder, abandon_outputs, nameless_file, remove_stale_in};

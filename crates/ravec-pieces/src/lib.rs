//! Work in pieces that other processes run.
//!
//! A large work divides into pieces. A *coordinator* plans them and merges their parts; a *worker*, usually one of several
//! processes on several machines, runs a piece. The large data that they exchange lies in a [`PartStore`] that all of them
//! share; a piece and what it answers are a few kilobytes, which an [`Executor`] carries.
//!
//! ```
//! use ravec_pieces::{Executor, FolderStore, PartStore, from_bytes, to_bytes};
//! use ravec_progress::Progress;
//!
//! // an executor whose only worker is this thread
//! struct Alone(Vec<(u64, Vec<u8>)>, FolderStore);
//!
//! impl Executor for Alone {
//!     fn submit(&mut self, number: u64, piece: Vec<u8>) -> std::io::Result<()> {
//!         self.0.push((number, piece));
//!         Ok(())
//!     }
//!     fn next(&mut self, _: &Progress) -> std::io::Result<(u64, Vec<u8>)> {
//!         let (number, piece) = self.0.pop().expect("there is a piece");
//!         let [first, last]: [u64; 2] = from_bytes(&piece)?;
//!         let bytes = self.1.read("numbers", first..last)?;
//!         Ok((number, to_bytes(&bytes.iter().map(|&b| u64::from(b)).sum::<u64>())?))
//!     }
//! }
//!
//! let folder = tempfile::tempdir()?;
//! let store = FolderStore::new(folder.path());
//! store.write("numbers", &[1, 2, 3, 4])?;
//! let mut executor = Alone(vec![], store);
//! executor.submit(0, to_bytes(&[0u64, 2])?)?;
//! executor.submit(1, to_bytes(&[2u64, 4])?)?;
//! let mut sum = 0;
//! for _ in 0..2 {
//!     sum += from_bytes::<u64>(&executor.next(&Progress::none())?.1)?;
//! }
//! assert_eq!(sum, 10);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Contract
//!
//! - A piece is a pure function of its bytes and of the parts that it names: run again, on any machine with the same version,
//!   it writes the same parts and gives the same answer. So an executor may run a piece again that a lost worker had, and may run
//!   one twice.
//! - A part has a name that no other piece uses, and is there as a whole or not at all.
//! - Pending pieces do not depend on each other: they may run in any order.
//!
//! Does not guarantee: that workers trust each other. Bytes that no coordinator wrote are refused where that is noticed, but a
//! store is as private as its folder.

mod cluster;
mod store;

pub use cluster::Cluster;
pub use store::{FolderStore, PartStore};

use ravec_progress::Progress;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::io::{Error, ErrorKind, Result};

/// Runs pieces by workers.
pub trait Executor: Send {
    /// Sends a piece to a worker.
    ///
    /// # Errors
    /// If it cannot be sent.
    fn submit(&mut self, number: u64, piece: Vec<u8>) -> Result<()>;

    /// Waits for the answer to any pending piece; returns the number of the piece and the answer.
    ///
    /// # Errors
    /// If a piece failed, with the reason; [`ErrorKind::Interrupted`] soon after `progress` is cancelled.
    fn next(&mut self, progress: &Progress) -> Result<(u64, Vec<u8>)>;
}

/// Encodes a piece or an answer: compact, and the same bytes for equal values.
///
/// # Errors
/// If the value has no such form, as for a sequence of unknown length.
pub fn to_bytes(value: &impl Serialize) -> Result<Vec<u8>> {
    postcard::to_stdvec(value).map_err(Error::other)
}

/// Decodes the bytes of [`to_bytes`].
///
/// # Errors
/// [`ErrorKind::InvalidData`] for others.
pub fn from_bytes<T: DeserializeOwned>(bytes: &[u8]) -> Result<T> {
    let invalid = |_| Error::new(ErrorKind::InvalidData, "it is not what a coordinator sends");
    postcard::from_bytes(bytes).map_err(invalid)
}

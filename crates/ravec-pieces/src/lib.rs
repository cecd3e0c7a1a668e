//! Work in pieces that other processes run.
//!
//! A large work divides into pieces. A *coordinator* plans them and merges their parts; a *worker*, usually one of several
//! processes on several machines, runs a piece. The large data that they exchange lies in a [`PartStore`] that all of them
//! share; a piece and what it answers are a few kilobytes, which a [`Crew`] carries.
//!
//! ```
//! use ravec_pieces::{Crew, FolderStore, PartStore, from_bytes, to_bytes};
//! use ravec_progress::Progress;
//!
//! // a crew whose only worker is this thread
//! struct Alone(Vec<(u64, Vec<u8>)>, FolderStore);
//!
//! impl Crew for Alone {
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
//! let mut crew = Alone(vec![], store);
//! crew.submit(0, to_bytes(&[0u64, 2])?)?;
//! crew.submit(1, to_bytes(&[2u64, 4])?)?;
//! let mut sum = 0;
//! for _ in 0..2 {
//!     sum += from_bytes::<u64>(&crew.next(&Progress::none())?.1)?;
//! }
//! assert_eq!(sum, 10);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Contract
//!
//! - A piece is a pure function of its bytes and of the parts that it names: run again, on any machine with the same version,
//!   it writes the same parts and gives the same answer. So a crew may run a piece again that a lost worker had, and may run
//!   one twice.
//! - A part has a name that no other piece uses, and is there as a whole or not at all.
//! - Pieces that are out at the same time do not depend on each other: parts arrive in any order.
//!
//! Does not guarantee: that workers trust each other. Bytes that no coordinator wrote are refused where that is noticed, but a
//! store is as private as its folder.

mod store;
mod team;

pub use store::{FolderStore, PartStore};
pub use team::Team;

use ravec_progress::Progress;
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::io::{Error, ErrorKind, Result};

/// Carries pieces to workers and answers back.
pub trait Crew: Send {
    /// Sends a piece on its way.
    ///
    /// # Errors
    /// If it cannot be sent.
    fn submit(&mut self, number: u64, piece: Vec<u8>) -> Result<()>;

    /// Waits for an answer to any of the pieces that are out: its number, and the answer.
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

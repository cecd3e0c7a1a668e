//! Records in a storage that the caller provides, usually a temporary file.

use super::codec::decoded;
use crate::params::OffsetError;
use crate::surface::Patch;
use std::io::{Cursor, Error, ErrorKind, Read, Result as IoResult, Seek, SeekFrom, Write};
use std::sync::Mutex;

/// A place for data that exceeds the memory, initially empty: usually a temporary file.
pub trait Storage: Read + Write + Seek + Send {}

impl<T: Read + Write + Seek + Send> Storage for T {}

/// Creates a storage for each step that needs one.
pub type NewStorage<'a> = &'a (dyn Fn() -> IoResult<Box<dyn Storage>> + Sync);

/// A storage in memory.
#[expect(clippy::unnecessary_wraps, reason = "others may fail")]
pub(crate) fn in_memory() -> IoResult<Box<dyn Storage>> {
    Ok(Box::new(Cursor::new(Vec::new())))
}

/// Divisor of the length of new data that gives the spare capacity of its record, for longer data later.
const SPARE: usize = 8;

/// A record in the storage.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Record {
    at: u64,
    bytes: usize,
    room: usize,
}

/// A storage shared by threads.
pub(crate) struct Scratch {
    storage: Mutex<Box<dyn Storage>>,
}

impl std::fmt::Debug for Scratch {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Scratch").finish_non_exhaustive()
    }
}

impl Scratch {
    pub fn new(storage: NewStorage<'_>) -> Result<Self, OffsetError> {
        let storage = storage().map_err(failed)?;
        Ok(Self {
            storage: Mutex::new(storage),
        })
    }

    /// Writes bytes, in the place of an earlier record if they fit there.
    pub fn put(&self, bytes: &[u8], instead: Option<Record>) -> Result<Record, OffsetError> {
        let write = || {
            let mut storage = self.storage.lock().map_err(|_| poisoned())?;
            let reused = instead.filter(|record| record.room >= bytes.len());
            let record = if let Some(record) = reused {
                storage.seek(SeekFrom::Start(record.at))?;
                storage.write_all(bytes)?;
                record
            } else {
                let room = bytes.len() + bytes.len() / SPARE;
                let at = storage.seek(SeekFrom::End(0))?;
                storage.write_all(bytes)?;
                let spare = (room - bytes.len()) as u64;
                std::io::copy(&mut std::io::repeat(0).take(spare), &mut **storage)?;
                let bytes = bytes.len();
                Record { at, bytes, room }
            };
            let bytes = bytes.len();
            Ok(Record { bytes, ..record })
        };
        write().map_err(failed)
    }

    /// Reads a record.
    pub fn get(&self, record: Record) -> Result<Vec<u8>, OffsetError> {
        let read = || {
            let mut bytes = vec![0; record.bytes];
            let mut storage = self.storage.lock().map_err(|_| poisoned())?;
            storage.seek(SeekFrom::Start(record.at))?;
            storage.read_exact(&mut bytes)?;
            Ok(bytes)
        };
        read().map_err(failed)
    }

    /// Reads a patch.
    pub fn patch(&self, record: Record) -> Result<Patch, OffsetError> {
        decoded(&self.get(record)?).ok_or_else(damaged)
    }
}

/// Error for data that differs from the data written.
pub(crate) fn damaged() -> OffsetError {
    let cause = "its content is not what was written";
    failed(Error::new(ErrorKind::InvalidData, cause))
}

#[expect(
    clippy::needless_pass_by_value,
    reason = "taken as it comes from a result"
)]
fn failed(cause: Error) -> OffsetError {
    OffsetError::Storage {
        cause: cause.to_string(),
    }
}

fn poisoned() -> Error {
    Error::other("another thread failed while it used it")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_used_again_for_what_fits() {
        let scratch = Scratch::new(&in_memory).unwrap();
        let first = scratch.put(&[1; 80], None).unwrap();
        let after = scratch.put(&[2; 8], None).unwrap();
        let longer = scratch.put(&[3; 90], Some(first)).unwrap();
        assert_eq!(longer.at, first.at);
        let too_long = scratch.put(&[4; 91], Some(longer)).unwrap();
        assert!(too_long.at > after.at);
        let shorter = scratch.put(&[5; 2], Some(longer)).unwrap();
        for (record, expected) in [
            (after, &[2; 8][..]),
            (too_long, &[4; 91]),
            (shorter, &[5; 2]),
        ] {
            assert_eq!(scratch.get(record).unwrap(), expected);
        }
    }
}

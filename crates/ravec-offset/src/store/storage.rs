//! Records in a storage that the caller provides, usually a temporary file, or in parts that several processes share.

use super::codec::decoded;
use crate::params::OffsetError;
use crate::surface::Patch;
use ravec_pieces::PartStore;
use serde::{Deserialize, Serialize};
use std::io::{Cursor, Error, ErrorKind, Read, Result as IoResult, Seek, SeekFrom, Write};
use std::sync::{Arc, Mutex};

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
const SPARE: u64 = 8;

/// A record in the storage.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Record {
    /// Number of the part; 0 in a storage of one process.
    pub part: u64,
    at: u64,
    bytes: u64,
    room: u64,
}

/// A storage shared by threads.
pub(crate) struct Scratch(Kind);

enum Kind {
    Storage(Mutex<Box<dyn Storage>>),
    Parts(Parts),
}

/// Parts that processes share, of which this one writes one.
struct Parts {
    store: Arc<dyn PartStore>,
    /// Number of the part to write.
    part: u64,
    /// Its bytes so far.
    bytes: Mutex<Vec<u8>>,
}

/// Beginning of the names of parts.
pub(crate) const PART: &str = "part-";

/// Returns the name of a part.
pub(crate) fn part_name(part: u64) -> String {
    format!("{PART}{part}")
}

impl std::fmt::Debug for Scratch {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Scratch").finish_non_exhaustive()
    }
}

impl Scratch {
    pub fn new(storage: NewStorage<'_>) -> Result<Self, OffsetError> {
        let storage = storage().map_err(failed)?;
        Ok(Self(Kind::Storage(Mutex::new(storage))))
    }

    /// Records of parts in a store; those put here are in the part of a number, which [`Self::write`] writes.
    pub fn of_parts(store: Arc<dyn PartStore>, part: u64) -> Self {
        let bytes = Mutex::default();
        Self(Kind::Parts(Parts { store, part, bytes }))
    }

    /// Writes the part with the records that were put, if there are any.
    pub fn write(&self) -> Result<(), OffsetError> {
        let Kind::Parts(parts) = &self.0 else {
            return Ok(());
        };
        let bytes = parts.bytes.lock().map_err(|_| failed(poisoned()))?;
        if bytes.is_empty() {
            return Ok(());
        }
        (parts.store)
            .write(&part_name(parts.part), &bytes)
            .map_err(failed)
    }

    /// Puts bytes, in the place of an earlier record if they fit there. The order of calls is that of the bytes in a part.
    pub fn put(&self, bytes: &[u8], instead: Option<Record>) -> Result<Record, OffsetError> {
        let storage = match &self.0 {
            Kind::Storage(storage) => storage,
            Kind::Parts(parts) => return parts.put(bytes).map_err(failed),
        };
        let write = || {
            let mut storage = storage.lock().map_err(|_| poisoned())?;
            let length = bytes.len() as u64;
            let reused = instead.filter(|record| record.room >= length);
            let record = if let Some(record) = reused {
                storage.seek(SeekFrom::Start(record.at))?;
                storage.write_all(bytes)?;
                record
            } else {
                let spare = length / SPARE;
                let at = storage.seek(SeekFrom::End(0))?;
                storage.write_all(bytes)?;
                std::io::copy(&mut std::io::repeat(0).take(spare), &mut **storage)?;
                Record {
                    part: 0,
                    at,
                    bytes: length,
                    room: length + spare,
                }
            };
            Ok(Record {
                bytes: length,
                ..record
            })
        };
        write().map_err(failed)
    }

    /// Reads a record.
    pub fn get(&self, record: Record) -> Result<Vec<u8>, OffsetError> {
        if record.bytes == 0 {
            // a part without bytes is not written
            return Ok(vec![]);
        }
        let storage = match &self.0 {
            Kind::Storage(storage) => storage,
            Kind::Parts(parts) => return parts.get(record),
        };
        let read = || {
            let mut bytes = vec![0; record.bytes as usize];
            let mut storage = storage.lock().map_err(|_| poisoned())?;
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

impl Parts {
    fn put(&self, bytes: &[u8]) -> IoResult<Record> {
        let mut written = self.bytes.lock().map_err(|_| poisoned())?;
        let (at, length) = (written.len() as u64, bytes.len() as u64);
        written.extend_from_slice(bytes);
        Ok(Record {
            part: self.part,
            at,
            bytes: length,
            room: length,
        })
    }

    fn get(&self, record: Record) -> Result<Vec<u8>, OffsetError> {
        let Record {
            part, at, bytes, ..
        } = record;
        let range = at..at.saturating_add(bytes);
        if part != self.part {
            let found = self.store.read(&part_name(part), range);
            return found.map_err(|error| match error.kind() {
                ErrorKind::NotFound | ErrorKind::UnexpectedEof => OffsetError::MissingPart { part },
                _ => failed(error),
            });
        }
        let written = self.bytes.lock().map_err(|_| failed(poisoned()))?;
        let range = range.start as usize..range.end as usize;
        let found = written.get(range).ok_or_else(damaged)?;
        Ok(found.to_vec())
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
pub(crate) fn failed(cause: Error) -> OffsetError {
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
    fn records_of_parts_are_those_of_the_process_that_wrote_them() {
        let folder = tempfile::tempdir().unwrap();
        let store: Arc<dyn PartStore> = Arc::new(ravec_pieces::FolderStore::new(folder.path()));
        let scratch = Scratch::of_parts(Arc::clone(&store), 7);
        scratch.write().unwrap();
        assert!(store.read_all("part-7").is_err());
        let first = scratch.put(&[1; 80], None).unwrap();
        let second = scratch.put(&[2; 8], Some(first)).unwrap();
        assert_eq!(scratch.get(first).unwrap(), [1; 80]);
        scratch.write().unwrap();
        let other = Scratch::of_parts(store, 8);
        assert_eq!(other.get(second).unwrap(), [2; 8]);
        let mut beyond = second;
        beyond.bytes += 1;
        assert!(other.get(beyond).is_err() && scratch.get(beyond).is_err());
        beyond.part = 6;
        assert!(other.get(beyond).is_err());
    }

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

//! Storage of parts.

use std::fs::File;
use std::io::{Error, ErrorKind, Read, Result, Seek, SeekFrom, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};

/// Bytes by name, shared by the processes of one work. Names have the letters `a` to `z`, digits and hyphens.
pub trait PartStore: Send + Sync {
    /// Writes a part, whole or not at all, in place of an earlier one.
    ///
    /// # Errors
    /// Those of the storage.
    fn write(&self, name: &str, bytes: &[u8]) -> Result<()>;

    /// Reads a range of the bytes of a part.
    ///
    /// # Errors
    /// [`ErrorKind::NotFound`] if there is no such part; [`ErrorKind::UnexpectedEof`] if it is shorter; others of the storage.
    fn read(&self, name: &str, range: Range<u64>) -> Result<Vec<u8>>;

    /// Reads a part.
    ///
    /// # Errors
    /// As [`read`](Self::read).
    fn read_all(&self, name: &str) -> Result<Vec<u8>>;

    /// Removes a part; one that is not there is none.
    ///
    /// # Errors
    /// Those of the storage.
    fn remove(&self, name: &str) -> Result<()>;
}

/// Parts as files of a folder that all machines see.
#[derive(Debug, Clone)]
pub struct FolderStore {
    folder: PathBuf,
}

impl FolderStore {
    /// The parts in a folder, which must be there.
    pub fn new(folder: &Path) -> Self {
        Self {
            folder: folder.to_owned(),
        }
    }

    fn open(&self, name: &str) -> Result<File> {
        let path = self.folder.join(name);
        File::open(&path).map_err(|error| {
            let kind = error.kind();
            Error::new(kind, format!("{}: {error}", path.display()))
        })
    }
}

impl PartStore for FolderStore {
    fn write(&self, name: &str, bytes: &[u8]) -> Result<()> {
        ravec_files::write_atomically(&self.folder.join(name), |file| file.write_all(bytes))
    }

    fn read(&self, name: &str, range: Range<u64>) -> Result<Vec<u8>> {
        let mut file = self.open(name)?;
        let length = range.end.saturating_sub(range.start);
        // a range is refused before memory is taken for it
        if file.metadata()?.len() < range.end {
            let reason = format!("the part {name} is shorter than it was");
            return Err(Error::new(ErrorKind::UnexpectedEof, reason));
        }
        let mut bytes = vec![0; usize::try_from(length).map_err(Error::other)?];
        file.seek(SeekFrom::Start(range.start))?;
        file.read_exact(&mut bytes)?;
        Ok(bytes)
    }

    fn read_all(&self, name: &str) -> Result<Vec<u8>> {
        let mut bytes = vec![];
        self.open(name)?.read_to_end(&mut bytes)?;
        Ok(bytes)
    }

    fn remove(&self, name: &str) -> Result<()> {
        match std::fs::remove_file(self.folder.join(name)) {
            Err(error) if error.kind() != ErrorKind::NotFound => Err(error),
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_read_as_they_were_written() {
        let folder = tempfile::tempdir().unwrap();
        let store = FolderStore::new(folder.path());
        store.write("part-1", b"something else").unwrap();
        store.write("part-1", b"bytes").unwrap();
        assert_eq!(store.read_all("part-1").unwrap(), b"bytes");
        assert_eq!(store.read("part-1", 1..4).unwrap(), b"yte");
        assert_eq!(store.read("part-1", 5..5).unwrap(), b"");
        let kind = |range| store.read("part-1", range).unwrap_err().kind();
        assert_eq!(kind(2..6), ErrorKind::UnexpectedEof);
        assert_eq!(kind(0..u64::MAX), ErrorKind::UnexpectedEof);
        store.remove("part-1").unwrap();
        store.remove("part-1").unwrap();
        let error = store.read_all("part-1").unwrap_err();
        assert_eq!(error.kind(), ErrorKind::NotFound);
        assert!(error.to_string().contains("part-1"), "{error}");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    #[test]
    fn a_part_that_cannot_be_written_is_not_there() {
        let folder = tempfile::tempdir().unwrap();
        let store = FolderStore::new(&folder.path().join("missing"));
        assert!(store.write("part-1", b"bytes").is_err());
        assert!(store.read_all("part-1").is_err());
    }
}

//! The catalogue: one `SQLite` file.
//!
//! Every change is a transaction, so that the file is valid whenever the program ends, and what was committed stays. Writers
//! wait for one another. Photos that were cleaned away keep their rows, so that they are not added again.

use crate::error::LibraryError;
use ravec_raster::{Image, Srgb};
use rusqlite::{
    Connection, ErrorCode, OpenFlags, OptionalExtension as _, Row, TransactionBehavior, params,
};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// What marks a file as a catalogue: the letters RAVC.
const APPLICATION: i64 = 0x5241_5643;

/// The format that is written.
const FORMAT: i64 = 1;

/// How long a writer waits for another one.
const PATIENCE: Duration = Duration::from_mins(1);

const SCHEMA: &str = "
CREATE TABLE photo (
    id INTEGER PRIMARY KEY,
    path TEXT NOT NULL UNIQUE,
    hash BLOB NOT NULL,
    bytes INTEGER NOT NULL,
    modified INTEGER NOT NULL,
    width INTEGER NOT NULL DEFAULT 0,
    height INTEGER NOT NULL DEFAULT 0,
    orientation INTEGER NOT NULL DEFAULT 1,
    taken TEXT,
    thumbnail_width INTEGER NOT NULL DEFAULT 0,
    thumbnail BLOB,
    unreadable TEXT,
    flaw TEXT,
    dropped TEXT
);
CREATE INDEX photo_by_hash ON photo (hash);
";

/// A catalogue of photos in a file.
#[derive(Debug)]
pub struct Catalogue {
    connection: Connection,
    path: PathBuf,
}

/// A photo as the catalogue has it.
#[derive(Debug, Clone, PartialEq)]
pub struct Entry {
    /// The number of the photo in the catalogue.
    pub id: i64,
    /// Where its file is.
    pub path: PathBuf,
    /// Columns of the upright photo.
    pub width: usize,
    /// Rows of the upright photo.
    pub height: usize,
    /// How it lay in the file, 1 to 8 as in EXIF.
    pub orientation: u8,
    /// When it was taken, in local time, if the file says so.
    pub taken: Option<String>,
    /// Why it could not be read, if so.
    pub unreadable: Option<String>,
    /// What is wrong with it, if anything: tiny, contentless, framed.
    pub flaw: Option<String>,
    /// Why it was cleaned away, if it was.
    pub dropped: Option<String>,
    /// Bytes of the file.
    pub bytes: u64,
    /// When the file was changed last, in nanoseconds since 1970.
    pub modified: i64,
    pub(crate) hash: Vec<u8>,
    pub(crate) thumbnail: Option<Image<Srgb<u8>>>,
}

const COLUMNS: &str = "id, path, hash, bytes, modified, width, height, orientation, taken, unreadable, flaw, dropped, \
                       thumbnail_width, thumbnail";

/// [`COLUMNS`] without the pixels.
const COLUMNS_WITHOUT_PIXELS: &str = "id, path, hash, bytes, modified, width, height, orientation, taken, unreadable, flaw, \
                                      dropped, 0, NULL";

fn entry(row: &Row<'_>) -> rusqlite::Result<Entry> {
    let thumbnail_width: usize = row.get::<_, i64>(12)? as usize;
    let pixels = row.get_ref(13)?.as_blob_or_null()?;
    let thumbnail = pixels.and_then(|pixels| {
        let pixels = pixels.as_chunks().0.iter().map(|&pixel| Srgb(pixel));
        Image::from_vec(thumbnail_width, pixels.collect()).ok()
    });
    Ok(Entry {
        id: row.get(0)?,
        path: PathBuf::from(row.get::<_, String>(1)?),
        hash: row.get(2)?,
        bytes: row.get::<_, i64>(3)? as u64,
        modified: row.get(4)?,
        width: row.get::<_, i64>(5)? as usize,
        height: row.get::<_, i64>(6)? as usize,
        orientation: row.get(7)?,
        taken: row.get(8)?,
        unreadable: row.get(9)?,
        flaw: row.get(10)?,
        dropped: row.get(11)?,
        thumbnail,
    })
}

impl Catalogue {
    /// Opens a catalogue that is there.
    ///
    /// # Errors
    /// [`LibraryError::NoCatalogue`], [`LibraryError::NotACatalogue`], [`LibraryError::Newer`], [`LibraryError::Database`].
    pub fn open(path: &Path) -> Result<Self, LibraryError> {
        if !path.exists() {
            return Err(LibraryError::NoCatalogue { path: path.into() });
        }
        Self::connected(path, false)
    }

    /// Opens a catalogue, and makes one if there is no file of that name.
    ///
    /// # Errors
    /// As for [`open`](Self::open), and [`LibraryError::Database`] if it cannot be made.
    pub fn open_or_make(path: &Path) -> Result<Self, LibraryError> {
        Self::connected(path, true)
    }

    fn connected(path: &Path, make: bool) -> Result<Self, LibraryError> {
        let mut flags = OpenFlags::SQLITE_OPEN_READ_WRITE | OpenFlags::SQLITE_OPEN_NO_MUTEX;
        if make {
            flags |= OpenFlags::SQLITE_OPEN_CREATE;
        }
        let failed = |error: rusqlite::Error| failure(path, &error);
        let connection = Connection::open_with_flags(path, flags).map_err(failed)?;
        connection.busy_timeout(PATIENCE).map_err(failed)?;
        let mut catalogue = Self {
            connection,
            path: path.into(),
        };
        catalogue.check(make)?;
        Ok(catalogue)
    }

    /// Looks whether the file is a catalogue, and makes an empty file one.
    fn check(&mut self, make: bool) -> Result<(), LibraryError> {
        let path = self.path.clone();
        let failed = |error: rusqlite::Error| failure(&path, &error);
        // what is not durable at once may be lost with the power, but never half there
        self.connection
            .pragma_update(None, "synchronous", "NORMAL")
            .map_err(failed)?;
        let behavior = if make {
            TransactionBehavior::Immediate
        } else {
            TransactionBehavior::Deferred
        };
        let transaction = self
            .connection
            .transaction_with_behavior(behavior)
            .map_err(failed)?;
        let number =
            |name: &str| transaction.pragma_query_value(None, name, |row| row.get::<_, i64>(0));
        let (application, format) = (
            number("application_id").map_err(failed)?,
            number("user_version").map_err(failed)?,
        );
        let tables: i64 = transaction
            .query_row("SELECT count(*) FROM sqlite_master", [], |row| row.get(0))
            .map_err(failed)?;
        if make && application == 0 && format == 0 && tables == 0 {
            transaction.execute_batch(SCHEMA).map_err(failed)?;
            transaction
                .pragma_update(None, "application_id", APPLICATION)
                .map_err(failed)?;
            transaction
                .pragma_update(None, "user_version", FORMAT)
                .map_err(failed)?;
            return transaction.commit().map_err(failed);
        }
        if application != APPLICATION {
            return Err(LibraryError::NotACatalogue { path });
        }
        if format > FORMAT {
            return Err(LibraryError::Newer {
                path,
                format,
                known: FORMAT,
            });
        }
        Ok(())
    }

    /// The file of the catalogue.
    pub fn path(&self) -> &Path {
        &self.path
    }

    fn failed(&self, error: &rusqlite::Error) -> LibraryError {
        failure(&self.path, error)
    }

    /// All photos by their paths, without those that were cleaned away unless `dropped` is set. Pixels are not read.
    ///
    /// # Errors
    /// [`LibraryError::Database`].
    pub fn entries(&self, dropped: bool) -> Result<Vec<Entry>, LibraryError> {
        self.select(COLUMNS_WITHOUT_PIXELS, dropped)
    }

    /// The photos that can be used, with their small pictures.
    pub(crate) fn usable(&self) -> Result<Vec<Entry>, LibraryError> {
        let mut entries = self.select(COLUMNS, false)?;
        entries.retain(|entry| entry.thumbnail.is_some());
        Ok(entries)
    }

    fn select(&self, columns: &str, dropped: bool) -> Result<Vec<Entry>, LibraryError> {
        let condition = if dropped { "1" } else { "dropped IS NULL" };
        let query = format!("SELECT {columns} FROM photo WHERE {condition} ORDER BY path");
        let read = || -> rusqlite::Result<Vec<Entry>> {
            let mut statement = self.connection.prepare(&query)?;
            statement.query_map([], entry)?.collect()
        };
        read().map_err(|error| self.failed(&error))
    }

    /// The photo that has this content, if there is one.
    pub(crate) fn with_hash(&self, hash: &[u8]) -> Result<Option<Entry>, LibraryError> {
        let query = format!("SELECT {COLUMNS_WITHOUT_PIXELS} FROM photo WHERE hash = ? LIMIT 1");
        let read = || {
            let mut statement = self.connection.prepare_cached(&query)?;
            statement.query_row([hash], entry).optional()
        };
        read().map_err(|error| self.failed(&error))
    }

    /// Makes several changes as one.
    pub(crate) fn change(&mut self, changes: &[Change]) -> Result<usize, LibraryError> {
        let path = self.path.clone();
        let mut work = || {
            let transaction = self
                .connection
                .transaction_with_behavior(TransactionBehavior::Immediate)?;
            let mut changed = 0;
            for change in changes {
                changed += change.make(&transaction)?;
            }
            transaction.commit()?;
            Ok(changed)
        };
        work().map_err(|error| failure(&path, &error))
    }
}

/// A change of the catalogue.
#[derive(Debug, Clone)]
pub(crate) enum Change {
    /// A photo is new, or its content is.
    Put(Box<Entry>),
    /// A file moved, or was touched without a change of its content.
    Move {
        id: i64,
        path: String,
        bytes: u64,
        modified: i64,
    },
    /// A photo is cleaned away, for a reason.
    Drop { id: i64, reason: String },
    /// A photo is forgotten.
    Forget { id: i64 },
}

impl Change {
    fn make(&self, connection: &Connection) -> rusqlite::Result<usize> {
        match self {
            Self::Put(entry) => {
                let pixels = entry.thumbnail.as_ref().map(|image| {
                    image
                        .pixels()
                        .iter()
                        .flat_map(|pixel| pixel.0)
                        .collect::<Vec<u8>>()
                });
                connection
                    .prepare_cached(
                        "INSERT OR REPLACE INTO photo (path, hash, bytes, modified, width, height, orientation, taken, \
                         unreadable, flaw, thumbnail_width, thumbnail) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
                    )?
                    .execute(params![
                        entry.path.to_str(),
                        entry.hash,
                        entry.bytes as i64,
                        entry.modified,
                        entry.width as i64,
                        entry.height as i64,
                        entry.orientation,
                        entry.taken,
                        entry.unreadable,
                        entry.flaw,
                        entry.thumbnail.as_ref().map_or(0, |image| image.width() as i64),
                        pixels,
                    ])
            }
            Self::Move {
                id,
                path,
                bytes,
                modified,
            } => connection
                .prepare_cached(
                    "UPDATE OR REPLACE photo SET path = ?, bytes = ?, modified = ? WHERE id = ?",
                )?
                .execute(params![path, *bytes as i64, modified, id]),
            Self::Drop { id, reason } => connection
                .prepare_cached("UPDATE photo SET dropped = ? WHERE id = ?")?
                .execute(params![reason, id]),
            Self::Forget { id } => connection
                .prepare_cached("DELETE FROM photo WHERE id = ?")?
                .execute([id]),
        }
    }
}

fn failure(path: &Path, error: &rusqlite::Error) -> LibraryError {
    let path = path.to_path_buf();
    match error.sqlite_error_code() {
        Some(ErrorCode::NotADatabase) => LibraryError::NotACatalogue { path },
        Some(ErrorCode::DatabaseBusy | ErrorCode::DatabaseLocked) => LibraryError::Database {
            path,
            reason: "another process has been writing to it for more than a minute".into(),
        },
        Some(ErrorCode::DiskFull) => LibraryError::Database {
            path,
            reason: "the disk is full".into(),
        },
        _ => LibraryError::Database {
            path,
            reason: error.to_string(),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn other_files_and_newer_catalogues_are_refused_and_stay_as_they_are() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("photos.ravec");
        assert!(matches!(
            Catalogue::open(&path),
            Err(LibraryError::NoCatalogue { .. })
        ));
        assert!(!path.exists());
        drop(Catalogue::open_or_make(&path).unwrap());
        let catalogue = Catalogue::open(&path).unwrap();
        assert!(catalogue.entries(true).unwrap().is_empty());
        catalogue
            .connection
            .pragma_update(None, "user_version", 7)
            .unwrap();
        drop(catalogue);
        let error = Catalogue::open_or_make(&path).unwrap_err().to_string();
        assert!(
            error.contains("has format 7, which a newer version made"),
            "{error}"
        );

        let database = folder.path().join("other.db");
        Connection::open(&database)
            .unwrap()
            .execute_batch("CREATE TABLE a (b);")
            .unwrap();
        assert!(matches!(
            Catalogue::open_or_make(&database),
            Err(LibraryError::NotACatalogue { .. })
        ));
        let text = folder.path().join("text");
        ravec_media::write_atomically(&text, |writer| {
            std::io::Write::write_all(writer, &[b'a'; 4000])
        })
        .unwrap();
        assert!(matches!(
            Catalogue::open_or_make(&text),
            Err(LibraryError::NotACatalogue { .. })
        ));
        assert_eq!(std::fs::read(&text).unwrap(), [b'a'; 4000]);
        let error = Catalogue::open_or_make(&folder.path().join("no/a")).unwrap_err();
        assert!(matches!(error, LibraryError::Database { .. }));
    }
}

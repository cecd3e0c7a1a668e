//! The catalogue: one `SQLite` file.
//!
//! Every change is a transaction, so that the file is valid whenever the program ends, and what was committed stays. Processes
//! wait for one another. Photos that were cleaned away keep their rows, so that they are not added again.

mod database;
mod protect;
mod row;
#[cfg(test)]
mod tests;

pub(crate) use protect::{FileNumber, place_of, protected};
pub use protect::{belongs_to_catalogue, leads_into};
pub(crate) use row::MAX_PATH_BYTES;

use crate::error::CatalogueError;
use database::{Access, Database, Trouble};
use ravec_memory::{MemoryBudget, OverBudget, Reservation};
use ravec_progress::Progress;
use ravec_raster::{Image, Srgb};
use row::{COLUMNS, COLUMNS_WITHOUT_PIXELS, entry};
use rusqlite::{Connection, params};
use std::path::{Path, PathBuf};

/// Maximum number of photos in a catalogue. Their numbers have 32 bits in a mosaic, where this many take 16 GiB.
const MAX_PHOTOS: usize = 4_000_000;

/// Photos between checks for cancellation.
const PHOTOS_PER_CHECK: usize = 1000;

/// A catalogue of photos in a file.
///
/// Guarantees: a change is done as a whole or not at all, also if the process is killed or the power fails, provided that the
/// disk keeps what it reports as written; a change that was reported as done stays. A process that finds a change half
/// done takes it back, which needs the permission to write. A catalogue that nobody is changing is a single file. A file with other tables or
/// with impossible rows is refused as damaged, and nothing in it is executed.
///
/// Waits up to a minute for other processes that use the same file, or until the [`Progress`] with which it was opened is
/// cancelled. Does not guarantee: anything on network folders whose locks do not work.
#[derive(Debug)]
pub struct Catalogue {
    database: Database,
}

/// A photo as the catalogue has it.
#[derive(Debug, Clone, PartialEq)]
pub struct Entry {
    /// The number of the photo in the catalogue.
    pub id: i64,
    /// Path of its file.
    pub path: PathBuf,
    /// Columns of the upright photo.
    pub width: usize,
    /// Rows of the upright photo.
    pub height: usize,
    /// Orientation in the file, 1 to 8 as in EXIF.
    pub orientation: u8,
    /// When it was taken, in local time, if the file says so.
    pub taken: Option<String>,
    /// Why it could not be read, if so.
    pub unreadable: Option<String>,
    /// Flaw of the photo, if any: tiny, contentless, framed.
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

/// Photos of a catalogue in memory.
#[derive(Debug)]
pub(crate) struct Loaded {
    pub entries: Vec<Entry>,
    /// The memory that they take.
    pub memory: Reservation,
}

impl Catalogue {
    /// Opens a catalogue that is there, to change it.
    ///
    /// # Errors
    /// [`CatalogueError::NoCatalogue`], [`CatalogueError::NotACatalogue`], [`CatalogueError::Newer`], [`CatalogueError::Damaged`],
    /// [`CatalogueError::Busy`], [`CatalogueError::Read`], [`CatalogueError::Cancelled`].
    pub fn open(path: &Path, progress: &Progress) -> Result<Self, CatalogueError> {
        Self::opened(path, Access::Change, progress)
    }

    /// Opens a catalogue that is there, only to read it: its file may be write-protected, and so may its folder.
    ///
    /// # Errors
    /// As for [`open`](Self::open). A change is refused later.
    pub fn open_to_read(path: &Path, progress: &Progress) -> Result<Self, CatalogueError> {
        Self::opened(path, Access::Read, progress)
    }

    /// Opens a catalogue to change it, and creates one if there is no file of that name.
    ///
    /// # Errors
    /// As for [`open`](Self::open), and [`CatalogueError::Change`] if it cannot be made.
    pub fn open_or_make(path: &Path, progress: &Progress) -> Result<Self, CatalogueError> {
        Self::opened(path, Access::Make, progress)
    }

    fn opened(path: &Path, access: Access, progress: &Progress) -> Result<Self, CatalogueError> {
        Ok(Self {
            database: Database::open(path, access, progress)?,
        })
    }

    /// The file of the catalogue.
    pub fn path(&self) -> &Path {
        self.database.path()
    }

    /// All photos by their paths, without those that were cleaned away unless `dropped` is set. Pixels are not read.
    ///
    /// # Errors
    /// [`CatalogueError::Damaged`], [`CatalogueError::Memory`], [`CatalogueError::Busy`], [`CatalogueError::Read`],
    /// [`CatalogueError::Cancelled`].
    pub fn entries(&self, dropped: bool) -> Result<Vec<Entry>, CatalogueError> {
        let memory = MemoryBudget::default();
        let loaded = self.select(COLUMNS_WITHOUT_PIXELS, dropped, &memory, |_| true)?;
        Ok(loaded.entries)
    }

    /// All photos without pixels, also those that were cleaned away.
    pub(crate) fn all(&self, memory: &MemoryBudget) -> Result<Loaded, CatalogueError> {
        self.select(COLUMNS_WITHOUT_PIXELS, true, memory, |_| true)
    }

    /// The photos that can be used, with their small pictures.
    pub(crate) fn usable(&self, memory: &MemoryBudget) -> Result<Loaded, CatalogueError> {
        self.select(COLUMNS, false, memory, |entry| entry.thumbnail.is_some())
    }

    fn select(
        &self,
        columns: &str,
        dropped: bool,
        memory: &MemoryBudget,
        wanted: impl Fn(&Entry) -> bool,
    ) -> Result<Loaded, CatalogueError> {
        let condition = if dropped { "1" } else { "dropped IS NULL" };
        let query = format!("SELECT {columns} FROM photo WHERE {condition}");
        self.database.read(|connection| {
            let mut account = Account::new(self.path(), memory);
            let mut entries = Vec::new();
            let mut statement = connection.prepare(&query)?;
            let mut rows = statement.query([])?;
            while let Some(row) = rows.next()? {
                let (entry, bytes) = entry(row)?;
                if account.rows.is_multiple_of(PHOTOS_PER_CHECK) {
                    self.database.progress().check()?;
                }
                let keep = wanted(&entry);
                account.enter(bytes, keep)?;
                if keep {
                    entries.push(entry);
                }
            }
            // rows come in the order of the file: by the index of paths each would be looked up on its own
            entries.sort_unstable_by(|a: &Entry, b: &Entry| {
                a.path.as_os_str().cmp(b.path.as_os_str())
            });
            Ok(Loaded {
                entries,
                memory: account.memory,
            })
        })
    }

    /// The photo that has this content, if there is one.
    pub(crate) fn with_hash(&self, hash: &[u8]) -> Result<Option<Entry>, CatalogueError> {
        let query = format!("SELECT {COLUMNS_WITHOUT_PIXELS} FROM photo WHERE hash = ? LIMIT 1");
        self.database.read(|connection| {
            let mut statement = connection.prepare_cached(&query)?;
            let mut rows = statement.query([hash])?;
            let row = rows.next()?;
            Ok(row.map(entry).transpose()?.map(|(entry, _)| entry))
        })
    }

    /// Makes several changes as one. Returns the number of photos that were changed.
    pub(crate) fn change(&mut self, changes: &[Change]) -> Result<usize, CatalogueError> {
        if changes.is_empty() {
            return Ok(0);
        }
        self.database.change(|connection| {
            let mut changed = 0;
            for change in changes {
                changed += change.make(connection)?;
            }
            Ok(changed)
        })
    }
}

/// The account of what a query returns: rows that claim more than the whole file has are not as they were written.
struct Account<'a> {
    path: &'a Path,
    file_bytes: u64,
    rows: usize,
    bytes: u64,
    memory: Reservation,
}

impl<'a> Account<'a> {
    fn new(path: &'a Path, memory: &MemoryBudget) -> Self {
        Self {
            path,
            file_bytes: 0,
            rows: 0,
            bytes: 0,
            memory: memory.reserve_nothing(),
        }
    }

    /// Counts a row that has `bytes` in the file, and reserves the memory for it if it is kept.
    fn enter(&mut self, bytes: u64, keep: bool) -> Result<(), Trouble> {
        self.rows += 1;
        self.bytes += bytes;
        if self.bytes > self.file_bytes {
            // the file may have grown
            self.file_bytes = self.path.metadata().map_or(0, |metadata| metadata.len());
        }
        if self.rows > MAX_PHOTOS || self.bytes > self.file_bytes {
            let reason = "it claims more photos than it can have";
            return Err(Trouble::Damaged(reason.into()));
        }
        if keep {
            // twice an entry: a list that grows is copied
            let memory = bytes + 2 * size_of::<Entry>() as u64;
            self.memory
                .grow(memory)
                .map_err(|over: OverBudget| CatalogueError::Memory {
                    path: self.path.into(),
                    limit: over.limit,
                })?;
        }
        Ok(())
    }
}

/// A change of the catalogue. Photos are named by their number and path: a number may be used again for another photo.
#[derive(Debug, Clone)]
pub(crate) enum Change {
    /// A photo is new, or its content is.
    Put(Box<Entry>),
    /// A file moved, or was touched without a change of its content.
    Move {
        id: i64,
        from: PathBuf,
        to: PathBuf,
        bytes: u64,
        modified: i64,
    },
    /// A photo is cleaned away, for a reason.
    Drop {
        id: i64,
        path: PathBuf,
        reason: String,
    },
    /// A photo is forgotten.
    Forget { id: i64, path: PathBuf },
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
                from,
                to,
                bytes,
                modified,
            } => connection
                .prepare_cached(
                    "UPDATE OR REPLACE photo SET path = ?, bytes = ?, modified = ? WHERE id = ? AND path = ?",
                )?
                .execute(params![to.to_str(), *bytes as i64, modified, id, from.to_str()]),
            Self::Drop { id, path, reason } => connection
                .prepare_cached("UPDATE photo SET dropped = ? WHERE id = ? AND path = ?")?
                .execute(params![reason, id, path.to_str()]),
            Self::Forget { id, path } => connection
                .prepare_cached("DELETE FROM photo WHERE id = ? AND path = ?")?
                .execute(params![id, path.to_str()]),
        }
    }
}

//! The connection to the file of a catalogue.
//!
//! A catalogue may come from anybody: its schema must be exactly the expected one, nothing in it is executed, and no row and no
//! query takes much memory. See <https://sqlite.org/security.html>.
//!
//! The journal is a rollback journal, which exists only during a change: a catalogue at rest is one file, which can be copied,
//! kept on a network folder, and read in a folder that is write-protected. A write-ahead log allows none of these.
//!
//! Locks are polled here instead of by the database, so that a process that waits can be cancelled.

use crate::error::CatalogueError;
use ravec_progress::{Cancelled, Progress};
use rusqlite::config::DbConfig;
use rusqlite::ffi::SQLITE_READONLY_ROLLBACK;
use rusqlite::limits::Limit;
use rusqlite::{Connection, ErrorCode, OpenFlags};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// The letters RAVC, which mark a file as a catalogue.
const APPLICATION: i64 = 0x5241_5643;

/// The format that is written.
const FORMAT: i64 = 1;

/// Time that a process waits for another one.
const PATIENCE: Duration = Duration::from_mins(1);

/// Pause between attempts to get a lock, which is also the time until a cancellation is noticed.
const PAUSE: Duration = Duration::from_millis(5);

/// Bytes of a row: two paths (its own and that of a near-duplicate), the thumbnail, and room to spare.
const MAX_ROW_BYTES: i32 = 1 << 18;

/// Bytes of memory of the database, for all catalogues of the process. Pages of large changes go to the disk beyond 2 MB; what
/// could need more is a schema of very many tables.
const MAX_HEAP_BYTES: i64 = 64 << 20;

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

/// The use of a catalogue that is opened.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Access {
    /// It is only read.
    Read,
    /// It is changed.
    Change,
    /// It is changed, and made if it is missing.
    Make,
}

/// A catalogue's file, open.
#[derive(Debug)]
pub(crate) struct Database {
    connection: Connection,
    path: PathBuf,
    progress: Progress,
}

/// The reason why something could not be done with the database.
#[derive(Debug)]
pub(crate) enum Trouble {
    Sqlite(rusqlite::Error),
    /// A row or the schema is not as it is written.
    Damaged(String),
    Cancelled(Cancelled),
    /// Any other reason.
    Other(Box<CatalogueError>),
}

impl From<rusqlite::Error> for Trouble {
    fn from(error: rusqlite::Error) -> Self {
        Self::Sqlite(error)
    }
}

impl From<Cancelled> for Trouble {
    fn from(cancelled: Cancelled) -> Self {
        Self::Cancelled(cancelled)
    }
}

impl From<CatalogueError> for Trouble {
    fn from(error: CatalogueError) -> Self {
        Self::Other(Box::new(error))
    }
}

impl Database {
    /// Opens the file, and checks that it is a catalogue.
    pub fn open(path: &Path, access: Access, progress: &Progress) -> Result<Self, CatalogueError> {
        match path.metadata() {
            // a pipe would be waited for
            Ok(metadata) if !metadata.is_file() => {
                return Err(CatalogueError::NotACatalogue { path: path.into() });
            }
            Err(_) if access != Access::Make => {
                return Err(CatalogueError::NoCatalogue { path: path.into() });
            }
            _ => {}
        }
        let connection = once_free(progress, || Ok(connect(path, access)?)).or_else(|trouble| {
            take_back(path, trouble, progress)?;
            once_free(progress, || Ok(connect(path, access)?))
        });
        let connection = connection.map_err(|trouble| failure(path, access, trouble))?;
        let database = Self {
            connection,
            path: path.into(),
            progress: progress.clone(),
        };
        match access {
            Access::Read | Access::Change => database.read(|connection| check(connection, path)),
            Access::Make => database.change(|connection| {
                if is_blank(connection)? {
                    make(connection)?;
                }
                check(connection, path)
            }),
        }?;
        Ok(database)
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    pub fn progress(&self) -> &Progress {
        &self.progress
    }

    /// Reads, once no other process is changing the file. `work` may run more than once.
    pub fn read<T>(
        &self,
        mut work: impl FnMut(&Connection) -> Result<T, Trouble>,
    ) -> Result<T, CatalogueError> {
        let result = self
            .once_free(|| work(&self.connection))
            .or_else(|trouble| {
                take_back(&self.path, trouble, &self.progress)?;
                self.once_free(|| work(&self.connection))
            });
        result.map_err(|trouble| failure(&self.path, Access::Read, trouble))
    }

    /// Makes changes as one, once no other process is using the file.
    pub fn change<T>(
        &self,
        work: impl FnOnce(&Connection) -> Result<T, Trouble>,
    ) -> Result<T, CatalogueError> {
        let execute = |sql: &str| self.once_free(|| Ok(self.connection.execute_batch(sql)?));
        let attempt = || {
            execute("BEGIN IMMEDIATE")?;
            let done = work(&self.connection).and_then(|value| {
                execute("COMMIT")?;
                Ok(value)
            });
            if done.is_err() && !self.connection.is_autocommit() {
                // what cannot be taken back now is taken back when the file is opened next
                let _ = self.connection.execute_batch("ROLLBACK");
            }
            done
        };
        attempt().map_err(|trouble| failure(&self.path, Access::Change, trouble))
    }

    fn once_free<T>(&self, attempt: impl FnMut() -> Result<T, Trouble>) -> Result<T, Trouble> {
        once_free(&self.progress, attempt)
    }
}

/// Tries again as long as other processes have the file.
fn once_free<T>(
    progress: &Progress,
    mut attempt: impl FnMut() -> Result<T, Trouble>,
) -> Result<T, Trouble> {
    let start = Instant::now();
    loop {
        match attempt() {
            Err(trouble) if trouble.is_busy() && start.elapsed() < PATIENCE => {
                progress.check()?;
                std::thread::sleep(PAUSE);
            }
            result => return result,
        }
    }
}

/// Takes back a change that a killed process left half done, which a connection that only reads cannot do. Returns any other
/// trouble.
fn take_back(path: &Path, trouble: Trouble, progress: &Progress) -> Result<(), Trouble> {
    if !trouble.is_unfinished_change() {
        return Err(trouble);
    }
    // a reader with the permission to write does it on the way
    once_free(progress, || is_blank(&connect(path, Access::Change)?)).map(drop)
}

impl Trouble {
    fn code(&self) -> Option<ErrorCode> {
        match self {
            Self::Sqlite(error) => error.sqlite_error_code(),
            _ => None,
        }
    }

    fn is_busy(&self) -> bool {
        let busy = [ErrorCode::DatabaseBusy, ErrorCode::DatabaseLocked];
        self.code().is_some_and(|code| busy.contains(&code))
    }

    fn is_unfinished_change(&self) -> bool {
        let Self::Sqlite(rusqlite::Error::SqliteFailure(error, _)) = self else {
            return false;
        };
        error.extended_code == SQLITE_READONLY_ROLLBACK
    }
}

fn connect(path: &Path, access: Access) -> rusqlite::Result<Connection> {
    let flags = OpenFlags::SQLITE_OPEN_NO_MUTEX
        | match access {
            Access::Read => OpenFlags::SQLITE_OPEN_READ_ONLY,
            Access::Change => OpenFlags::SQLITE_OPEN_READ_WRITE,
            Access::Make => OpenFlags::SQLITE_OPEN_READ_WRITE | OpenFlags::SQLITE_OPEN_CREATE,
        };
    // a relative path could be taken for an address, or for the name of a database in memory
    let absolute = std::path::absolute(path).unwrap_or_else(|_| path.into());
    let connection = Connection::open_with_flags(absolute, flags)?;
    connection.busy_timeout(Duration::ZERO)?;
    for (config, value) in [
        (DbConfig::SQLITE_DBCONFIG_DEFENSIVE, true),
        (DbConfig::SQLITE_DBCONFIG_TRUSTED_SCHEMA, false),
        (DbConfig::SQLITE_DBCONFIG_ENABLE_TRIGGER, false),
        (DbConfig::SQLITE_DBCONFIG_ENABLE_VIEW, false),
        (DbConfig::SQLITE_DBCONFIG_DQS_DML, false),
        (DbConfig::SQLITE_DBCONFIG_DQS_DDL, false),
    ] {
        connection.set_db_config(config, value)?;
    }
    connection.set_limit(Limit::SQLITE_LIMIT_LENGTH, MAX_ROW_BYTES)?;
    connection.set_limit(Limit::SQLITE_LIMIT_ATTACHED, 0)?;
    // the answers of these are of no interest
    for pragma in [
        format!("PRAGMA hard_heap_limit = {MAX_HEAP_BYTES}"),
        "PRAGMA cell_size_check = ON".to_owned(),
        "PRAGMA mmap_size = 0".to_owned(),
        // a change is on the disk, and its journal gone from the folder, before the next one begins
        "PRAGMA synchronous = EXTRA".to_owned(),
        "PRAGMA fullfsync = ON".to_owned(),
    ] {
        let mut statement = connection.prepare(&pragma)?;
        let mut rows = statement.query([])?;
        while rows.next()?.is_some() {}
    }
    Ok(connection)
}

fn number(connection: &Connection, pragma: &str) -> rusqlite::Result<i64> {
    connection.pragma_query_value(None, pragma, |row| row.get(0))
}

/// Returns `true` if nothing was ever put into the file.
fn is_blank(connection: &Connection) -> Result<bool, Trouble> {
    let tables: bool =
        connection.query_row("SELECT EXISTS (SELECT 1 FROM sqlite_master)", [], |row| {
            row.get(0)
        })?;
    Ok(!tables
        && number(connection, "application_id")? == 0
        && number(connection, "user_version")? == 0)
}

fn make(connection: &Connection) -> rusqlite::Result<()> {
    connection.execute_batch(SCHEMA)?;
    connection.pragma_update(None, "application_id", APPLICATION)?;
    connection.pragma_update(None, "user_version", FORMAT)
}

/// Refuses a file that is not a catalogue, or a catalogue of another format or with other tables.
fn check(connection: &Connection, path: &Path) -> Result<(), Trouble> {
    if number(connection, "application_id")? != APPLICATION {
        return Err(CatalogueError::NotACatalogue { path: path.into() }.into());
    }
    let format = number(connection, "user_version")?;
    if format > FORMAT {
        return Err(CatalogueError::Newer {
            path: path.into(),
            format,
            known: FORMAT,
        }
        .into());
    }
    let reference = Connection::open_in_memory()?;
    reference.execute_batch(SCHEMA)?;
    let expected = schema(&reference)?;
    if schema(connection)? != expected {
        return Err(Trouble::Damaged(
            "its tables are not those of a catalogue".into(),
        ));
    }
    Ok(())
}

type SchemaRow = (String, String, String, Option<String>);

/// The tables, indices, views and triggers, as far as there may be any.
fn schema(connection: &Connection) -> rusqlite::Result<Vec<SchemaRow>> {
    const MAX_OBJECTS: usize = 8;
    let query = format!(
        "SELECT type, name, tbl_name, sql FROM sqlite_master ORDER BY name LIMIT {MAX_OBJECTS}"
    );
    let mut statement = connection.prepare(&query)?;
    let rows = statement.query_map([], |row| {
        Ok((row.get(0)?, row.get(1)?, row.get(2)?, row.get(3)?))
    })?;
    rows.collect()
}

fn failure(path: &Path, access: Access, trouble: Trouble) -> CatalogueError {
    let path = path.to_path_buf();
    let code = trouble.code();
    let error = match trouble {
        Trouble::Other(error) => return *error,
        Trouble::Cancelled(cancelled) => return cancelled.into(),
        Trouble::Damaged(reason) => return CatalogueError::Damaged { path, reason },
        Trouble::Sqlite(error) => error,
    };
    let writing = access != Access::Read;
    let reason = match (&error, code) {
        (_, Some(ErrorCode::NotADatabase)) => return CatalogueError::NotACatalogue { path },
        (_, Some(ErrorCode::DatabaseBusy | ErrorCode::DatabaseLocked)) => {
            return CatalogueError::Busy { path, writing };
        }
        (_, Some(ErrorCode::DatabaseCorrupt)) => {
            let reason = "its database is corrupt".into();
            return CatalogueError::Damaged { path, reason };
        }
        (_, Some(ErrorCode::TooBig | ErrorCode::OutOfMemory)) => {
            let reason = "it has a larger row or more tables than any catalogue".into();
            return CatalogueError::Damaged { path, reason };
        }
        // rows of other types, and text that is not Unicode
        (error, None) => {
            let reason = error.to_string();
            return CatalogueError::Damaged { path, reason };
        }
        (_, Some(ErrorCode::DiskFull)) => "the disk is full".to_owned(),
        (_, Some(ErrorCode::ReadOnly)) if writing => "it is write-protected".to_owned(),
        (_, Some(ErrorCode::ReadOnly)) => {
            "a killed process left it half changed, and it is write-protected".to_owned()
        }
        (rusqlite::Error::SqliteFailure(_, Some(text)), _) => text.clone(),
        (error, _) => error.to_string(),
    };
    if writing {
        CatalogueError::Change { path, reason }
    } else {
        CatalogueError::Read { path, reason }
    }
}

//! Files that no output may replace: the catalogue, and the photos that it knows.
//!
//! A file is the same whatever link or spelling leads to it, which the system decides by its number on its device.

use super::database::Trouble;
use super::row::absolute;
use super::{Catalogue, PHOTOS_PER_CHECK};
use crate::error::CatalogueError;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// Names that the database appends to that of the catalogue for files of its own.
const SIDE_FILES: [&str; 4] = ["", "-journal", "-wal", "-shm"];

/// Links that are followed one after another, as many as Linux follows.
const MAX_LINKS: usize = 40;

/// Returns `true` if `path` leads to the catalogue or to one of the files that the database keeps beside it, also if
/// these are not there yet.
pub fn belongs_to_catalogue(catalogue: &Path, path: &Path) -> bool {
    let (catalogue, place) = (place_of(catalogue), place_of(path));
    SIDE_FILES.iter().any(|suffix| {
        let mut file = OsString::from(&catalogue);
        file.push(suffix);
        let number = FileNumber::of(Path::new(&file));
        place == Path::new(&file) || (number.is_some() && number == FileNumber::of(&place))
    })
}

impl Catalogue {
    /// Returns `true` if a file is the catalogue, a file of its database, or a photo that it knows, whatever link or
    /// spelling leads to it. A file that is not there counts if a photo is known by its path.
    ///
    /// # Errors
    /// As for [`entries`](Self::entries).
    pub fn knows(&self, path: &Path) -> Result<bool, CatalogueError> {
        Ok(belongs_to_catalogue(self.path(), path) || self.has_photo(path)?)
    }

    /// Refuses an output that the catalogue [`knows`](Self::knows).
    ///
    /// # Errors
    /// [`CatalogueError::Protected`], and as for [`entries`](Self::entries).
    pub fn check_output(&self, path: &Path) -> Result<(), CatalogueError> {
        let reason = if belongs_to_catalogue(self.path(), path) {
            "it belongs to the catalogue"
        } else if self.has_photo(path)? {
            "it is a photo of the catalogue"
        } else {
            return Ok(());
        };
        Err(protected(path, reason))
    }

    /// Refuses a folder as an output if the catalogue or a photo that it knows is in it.
    ///
    /// # Errors
    /// As for [`check_output`](Self::check_output).
    pub fn check_output_folder(&self, folder: &Path) -> Result<(), CatalogueError> {
        let place = place_of(folder);
        if place_of(self.path()).starts_with(&place) {
            return Err(protected(folder, "the catalogue is in it"));
        }
        let inside =
            |photo: &Path| photo.starts_with(&place) || place_of(photo).starts_with(&place);
        // what is in a folder that is not there cannot be replaced
        if place.exists() && self.any_photo(inside)? {
            return Err(protected(folder, "photos of the catalogue are in it"));
        }
        Ok(())
    }

    fn has_photo(&self, path: &Path) -> Result<bool, CatalogueError> {
        let place = place_of(path);
        let number = FileNumber::of(&place);
        self.any_photo(|photo| {
            photo == place || (number.is_some() && FileNumber::of(photo) == number)
        })
    }

    fn any_photo(&self, wanted: impl Fn(&Path) -> bool) -> Result<bool, CatalogueError> {
        self.database.read(|connection| {
            let mut statement = connection.prepare("SELECT path FROM photo")?;
            let mut rows = statement.query([])?;
            let mut looks = 0;
            while let Some(row) = rows.next()? {
                if usize::is_multiple_of(looks, PHOTOS_PER_CHECK) {
                    self.database.progress().check()?;
                }
                looks += 1;
                let path = absolute(row.get(0)?);
                let path =
                    path.ok_or_else(|| Trouble::Damaged("a photo has a wrong path".into()))?;
                if wanted(&path) {
                    return Ok(true);
                }
            }
            Ok(false)
        })
    }
}

/// Returns `true` if `path` leads to a place in `folder`, or to the folder, also if either is not there yet.
pub fn leads_into(path: &Path, folder: &Path) -> bool {
    place_of(path).starts_with(place_of(folder))
}

pub(crate) fn protected(path: &Path, reason: &'static str) -> CatalogueError {
    CatalogueError::Protected {
        path: path.into(),
        reason,
    }
}

/// Identity of a file in the system.
#[derive(PartialEq, Eq)]
pub(crate) struct FileNumber {
    #[cfg(unix)]
    number: (u64, u64),
    #[cfg(not(unix))]
    place: PathBuf,
}

impl FileNumber {
    /// None if there is no such file.
    pub fn of(path: &Path) -> Option<Self> {
        #[cfg(unix)]
        {
            use std::os::unix::fs::MetadataExt as _;
            let metadata = path.metadata().ok()?;
            let number = (metadata.dev(), metadata.ino());
            Some(Self { number })
        }
        #[cfg(not(unix))]
        {
            let place = path.canonicalize().ok()?;
            Some(Self { place })
        }
    }
}

/// The path from the root behind any symbolic links. The target of the link need not exist.
pub(crate) fn place_of(path: &Path) -> PathBuf {
    let mut path = std::path::absolute(path).unwrap_or_else(|_| path.into());
    for _ in 0..MAX_LINKS {
        match (path.read_link(), path.parent()) {
            (Ok(link), Some(folder)) => path = folder.join(link),
            _ => break,
        }
    }
    for there in path.ancestors() {
        if let (Ok(place), Ok(rest)) = (there.canonicalize(), path.strip_prefix(there)) {
            // joining nothing would add a separator
            return if rest == Path::new("") {
                place
            } else {
                place.join(rest)
            };
        }
    }
    path
}

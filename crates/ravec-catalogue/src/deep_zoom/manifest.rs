//! The list of files of a page, by which a later run knows what it may replace.
//!
//! `ravec-manifest.json` in the folder of the page:
//!
//! ```json
//! {
//!   "format": "ravec-deep-zoom",
//!   "version": 1,
//!   "files": {
//!     "index.html": { "bytes": 12034, "blake3": "9f0c…64 hexadecimal digits" },
//!     "mosaic.dzi": { "bytes": 214, "blake3": "…" },
//!     "mosaic_files/0/0_0.jpg": { "bytes": 631, "blake3": "…" }
//!   }
//! }
//! ```
//!
//! A manifest may come from anybody: only names that a page has are accepted, so that none leads out of the folder, and only
//! files whose size and hash are the recorded ones count as files of the page.

use ravec_progress::{Cancelled, Progress};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::fs::{self, File, FileType};
use std::io::{self, Read as _};
use std::path::Path;

/// The name of the manifest in the folder of a page.
pub(crate) const MANIFEST: &str = "ravec-manifest.json";

/// The page itself.
pub(super) const PAGE: &str = "index.html";

/// The description for other viewers of Deep Zoom images.
pub(crate) const DESCRIPTION: &str = "mosaic.dzi";

/// The folder of the pieces.
pub(crate) const PIECES: &str = "mosaic_files";

const FORMAT: &str = "ravec-deep-zoom";
const VERSION: u32 = 1;

/// Files of a page, at most: 30 gigapixels.
pub(super) const MAX_FILES: usize = 600_000;

/// Bytes of a manifest, at most: 110 a file.
const MAX_BYTES: u64 = 110 * MAX_FILES as u64;

/// The files of a page.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Manifest {
    format: String,
    version: u32,
    files: BTreeMap<String, Fingerprint>,
}

/// The content of a file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Fingerprint {
    bytes: u64,
    blake3: String,
}

/// The reason why a folder is not exactly what a manifest lists.
#[derive(Debug)]
pub(super) enum Mismatch {
    Cancelled(Cancelled),
    /// A sentence without its end.
    Refused(String),
    Io(io::Error),
}

impl From<Cancelled> for Mismatch {
    fn from(cancelled: Cancelled) -> Self {
        Self::Cancelled(cancelled)
    }
}

impl From<io::Error> for Mismatch {
    fn from(error: io::Error) -> Self {
        Self::Io(error)
    }
}

impl Default for Manifest {
    /// A manifest of no files.
    fn default() -> Self {
        Self {
            format: FORMAT.to_owned(),
            version: VERSION,
            files: BTreeMap::new(),
        }
    }
}

impl Manifest {
    /// Records a file of the page, by its name in the folder.
    pub fn record(&mut self, name: &str, content: &[u8]) {
        debug_assert!(is_page_file(name), "{name}");
        let fingerprint = Fingerprint {
            bytes: content.len() as u64,
            blake3: blake3::hash(content).to_hex().to_string(),
        };
        self.files.insert(name.to_owned(), fingerprint);
    }

    pub fn to_json(&self) -> Vec<u8> {
        // a map of texts and numbers has a form in JSON
        let mut text = serde_json::to_vec_pretty(self).unwrap_or_default();
        text.push(b'\n');
        text
    }

    /// Reads the manifest of a folder. None if there is none.
    pub fn read(folder: &Path) -> Result<Option<Self>, Mismatch> {
        let path = folder.join(MANIFEST);
        let metadata = match path.symlink_metadata() {
            Ok(metadata) => metadata,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(error.into()),
        };
        let unusable = || {
            Mismatch::Refused(format!(
                "{MANIFEST} in it is not a list of files of a page; name a new folder"
            ))
        };
        if !metadata.is_file() || metadata.len() > MAX_BYTES {
            return Err(unusable());
        }
        let mut text = Vec::new();
        File::open(path)?.take(MAX_BYTES).read_to_end(&mut text)?;
        let manifest: Self = serde_json::from_slice(&text).map_err(|_| unusable())?;
        let known = manifest.format == FORMAT && manifest.version == VERSION;
        if !known || !manifest.files.keys().all(|name| is_page_file(name)) {
            return Err(unusable());
        }
        Ok(Some(manifest))
    }

    /// Refuses a folder in which is anything but unchanged files of this manifest. Files may be missing.
    pub fn check(&self, folder: &Path, progress: &Progress) -> Result<(), Mismatch> {
        let folders = self.folders();
        let mut pending = vec![String::new()];
        while let Some(inner) = pending.pop() {
            for entry in fs::read_dir(folder.join(&inner))? {
                progress.check()?;
                let entry = entry?;
                let name = entry.file_name();
                let shown = format!("{inner}{}", name.to_string_lossy());
                let kind = entry.file_type()?;
                let whole = name.to_str().map(|name| format!("{inner}{name}"));
                match whole {
                    Some(name) if kind.is_file() && name == MANIFEST => {}
                    Some(name) if kind.is_file() && self.files.contains_key(&name) => {
                        if !self.is_unchanged(folder, &name)? {
                            return Err(Mismatch::Refused(format!(
                                "{shown} in it was changed since the page was made; name a new folder"
                            )));
                        }
                    }
                    Some(name) if kind.is_dir() && folders.contains(&name) => {
                        pending.push(format!("{name}/"));
                    }
                    _ => {
                        let kind = kind_name(kind);
                        return Err(Mismatch::Refused(format!(
                            "{shown} in it is a {kind} that is not of an earlier page; name a new folder"
                        )));
                    }
                }
            }
        }
        Ok(())
    }

    /// Removes the unchanged files of this manifest from a folder, and the folder if nothing else is in it. True if it is
    /// gone.
    pub fn remove(&self, folder: &Path) -> bool {
        let is_folder = |path: &Path| path.symlink_metadata().is_ok_and(|found| found.is_dir());
        let inner: Vec<_> = self
            .folders()
            .iter()
            .map(|name| folder.join(name))
            .collect();
        // a link could lead elsewhere
        if inner
            .iter()
            .any(|path| path.symlink_metadata().is_ok() && !is_folder(path))
        {
            return false;
        }
        for name in self.files.keys() {
            let path = folder.join(name);
            let ours = path.symlink_metadata().is_ok_and(|found| found.is_file())
                && self.is_unchanged(folder, name).unwrap_or(false);
            if ours {
                // a file that stays keeps the folder
                let _ = fs::remove_file(path);
            }
        }
        // the deepest first; those with something in them stay
        for path in inner.iter().rev() {
            let _ = fs::remove_dir(path);
        }
        let others = fs::read_dir(folder).map_or(1, |entries| {
            entries
                .flatten()
                .filter(|entry| entry.file_name() != MANIFEST)
                .count()
        });
        // last of all: with it, a later run can go on here
        others == 0
            && (fs::remove_file(folder.join(MANIFEST)).is_ok() || self.files.is_empty())
            && fs::remove_dir(folder).is_ok()
    }

    /// The folders in the folder of the page, each after the one that it is in.
    fn folders(&self) -> BTreeSet<String> {
        let files = self.files.keys();
        let parents = files.filter_map(|name| Some(name.rsplit_once('/')?.0.to_owned()));
        let mut folders: BTreeSet<String> = parents.collect();
        if !folders.is_empty() {
            folders.insert(PIECES.to_owned());
        }
        folders
    }

    fn is_unchanged(&self, folder: &Path, name: &str) -> io::Result<bool> {
        let Some(recorded) = self.files.get(name) else {
            return Ok(false);
        };
        let file = File::open(folder.join(name))?;
        if file.metadata()?.len() != recorded.bytes {
            return Ok(false);
        }
        let mut hasher = blake3::Hasher::new();
        hasher.update_reader(file.take(recorded.bytes))?;
        Ok(hasher.finalize().to_hex().as_str() == recorded.blake3)
    }
}

/// Returns `true` if a page has files of this name.
fn is_page_file(name: &str) -> bool {
    let number = |text: &str| {
        let number = text.parse::<u32>().ok()?;
        (number.to_string() == text).then_some(number)
    };
    let is_piece = || {
        let (level, piece) = name
            .strip_prefix(PIECES)?
            .strip_prefix('/')?
            .split_once('/')?;
        let (col, row) = piece.strip_suffix(".jpg")?.split_once('_')?;
        Some((number(level)?, number(col)?, number(row)?))
    };
    name == PAGE || name == DESCRIPTION || is_piece().is_some()
}

fn kind_name(kind: FileType) -> &'static str {
    if kind.is_file() {
        "file"
    } else if kind.is_dir() {
        "folder"
    } else if kind.is_symlink() {
        "link"
    } else {
        "special file"
    }
}

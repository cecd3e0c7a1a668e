//! Photos come into the catalogue.
//!
//! Files are known by their size and time of change, else by a hash of their content: what is known is not decoded again, a
//! file that moved keeps its row, and one that changed is examined anew. Decoding runs in parallel, at reduced scale; what is
//! done is committed every few seconds' worth of photos, so that an interrupted run goes on where it was.
//!
//! All photos share one memory budget. A photo waits for its share and is refused only if it needs more than all of them have
//! together, so that the result depends neither on the number of threads nor on the other photos.

use crate::catalogue::{Catalogue, Change, Entry, FileNumber, Loaded, MAX_PATH_BYTES};
use crate::deep_zoom::{DESCRIPTION, PIECES};
use crate::error::CatalogueError;
use crate::thumbnail::thumbnail;
use crate::workers::Workers;
use ravec_media::{DecodeError, Format, Limits, Probe, decode_reduced, memory_to_decode};
use ravec_memory::{MemoryBudget, OverBudget, ReserveError};
use ravec_mosaic::flaw;
use ravec_progress::{Cancelled, Progress};
use ravec_raster::{Image, Srgb};
use std::collections::{HashMap, HashSet};
use std::ffi::OsStr;
use std::fs::{File, Metadata};
use std::io::{self, Cursor, Read as _};
use std::path::{Path, PathBuf};
use std::time::UNIX_EPOCH;

/// The shorter side below which a photo is not reduced while it is decoded.
const MIN_DECODED: u32 = 40;

/// Memory for headers: profiles, and tables of where things are in the file.
pub(crate) const HEADER_BYTES: u64 = 16 << 20;

/// Photos that are committed together.
const BATCH: usize = 256;

/// Counts and failures of the files that were examined.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Added {
    /// Photos that are new.
    pub new: usize,
    /// Photos whose content changed.
    pub changed: usize,
    /// Photos that are at another place than before.
    pub moved: usize,
    /// Photos that were known.
    pub unchanged: usize,
    /// Files with the content of another one that is in the catalogue and still there.
    pub copies: usize,
    /// Files that cannot be read as pictures, and why.
    pub unreadable: Vec<(PathBuf, String)>,
}

/// Adds files, and all picture files in folders and the folders in them, recognized by their extensions. Pieces of
/// pages that zoom (`mosaic_files` beside `mosaic.dzi`) are passed by.
///
/// # Errors
/// [`CatalogueError::Add`] if a path is not there, and as for [`Catalogue::entries`], and [`CatalogueError::Change`]; what was
/// committed before stays.
pub fn add(
    catalogue: &mut Catalogue,
    paths: &[PathBuf],
    limits: &Limits,
    progress: &Progress,
) -> Result<Added, CatalogueError> {
    let files = files_in(paths, progress)?;
    let Loaded {
        entries,
        memory: _of_entries,
    } = catalogue.all(&limits.memory)?;
    let of_files = files
        .iter()
        .map(|path| (path.as_os_str().len() + size_of::<PathBuf>()) as u64);
    let too_much = |over: OverBudget| CatalogueError::Memory {
        path: catalogue.path().into(),
        limit: over.limit,
    };
    let _of_files = limits.memory.reserve(of_files.sum()).map_err(too_much)?;
    // photos share what is left, and one that needs more than all of that is refused instead of waiting for it
    let rest = limits.memory.reserve(limits.memory.available());
    let limits = Limits {
        memory: rest.map_err(too_much)?.into_budget(),
        ..limits.clone()
    };
    let known: HashMap<PathBuf, Entry> = entries
        .into_iter()
        .map(|entry| (entry.path.clone(), entry))
        .collect();
    let mut added = Added::default();
    let mut taken: HashSet<Vec<u8>> = HashSet::new();
    let phase = progress.phase("photos", files.len() as u64);
    let workers = Workers::new()?;
    for batch in files.chunks(BATCH) {
        let examined: Vec<Examined> = workers.map(batch, |path| {
            let examined = examine(path, known.get(path), &limits, progress)?;
            phase.advance(1);
            Ok::<_, Cancelled>(examined)
        })?;
        let mut changes = Vec::new();
        for examined in examined {
            let (entry, old) = match examined {
                Examined::Unchanged => {
                    added.unchanged += 1;
                    continue;
                }
                Examined::Touched(change) => {
                    added.unchanged += 1;
                    changes.push(change);
                    continue;
                }
                Examined::Failed(path, reason) => {
                    added.unreadable.push((path, reason));
                    continue;
                }
                Examined::Read(entry, old) => (entry, old),
            };
            if let Some(reason) = &entry.unreadable {
                added.unreadable.push((entry.path.clone(), reason.clone()));
            } else {
                let other = catalogue.with_hash(&entry.hash)?;
                let other = other.filter(|other| other.path != entry.path);
                if let Some(other) = other.as_ref().filter(|other| !other.path.exists()) {
                    added.moved += 1;
                    taken.insert(entry.hash.clone());
                    changes.push(Change::Move {
                        id: other.id,
                        from: other.path.clone(),
                        to: entry.path.clone(),
                        bytes: entry.bytes,
                        modified: entry.modified,
                    });
                    continue;
                }
                if other.is_some() || !taken.insert(entry.hash.clone()) {
                    added.copies += 1;
                    let path = entry.path.clone();
                    changes.extend(old.map(|id| Change::Forget { id, path }));
                    continue;
                }
                if old.is_some() {
                    added.changed += 1;
                } else {
                    added.new += 1;
                }
            }
            changes.push(Change::Put(entry));
        }
        catalogue.change(&changes)?;
    }
    Ok(added)
}

/// Returns `true` if [`add`] of `paths` would read a file, whatever link or spelling leads to it.
///
/// # Errors
/// [`CatalogueError::Add`] if a path is not there, [`CatalogueError::Cancelled`].
pub fn would_read(
    paths: &[PathBuf],
    file: &Path,
    progress: &Progress,
) -> Result<bool, CatalogueError> {
    // what is not there is not read
    let Some(number) = FileNumber::of(file) else {
        return Ok(false);
    };
    let files = files_in(paths, progress)?;
    Ok(files
        .iter()
        .any(|path| FileNumber::of(path).as_ref() == Some(&number)))
}

/// All picture files, by absolute paths, in the order of their names.
fn files_in(paths: &[PathBuf], progress: &Progress) -> Result<Vec<PathBuf>, CatalogueError> {
    let mut files = Vec::new();
    for path in paths {
        let failed = |reason: String| CatalogueError::Add {
            path: path.clone(),
            reason,
        };
        let root = path
            .canonicalize()
            .map_err(|error| failed(reason_of(&error)))?;
        if root.is_file() {
            files.push(root);
            continue;
        }
        if !root.is_dir() {
            return Err(failed("it is neither a file nor a folder".into()));
        }
        for entry in walkdir::WalkDir::new(&root)
            .follow_links(true)
            .sort_by_file_name()
            .into_iter()
            .filter_entry(|entry| entry.depth() == 0 || !is_folder_of_pieces(entry.path()))
        {
            progress.check()?;
            // folders that may not be read and links that go round are passed by, as there is nothing to be had from them
            let Ok(entry) = entry else { continue };
            if entry.file_type().is_file() && Format::from_extension(entry.path()).is_some() {
                files.push(entry.into_path());
            }
        }
    }
    files.sort();
    files.dedup();
    Ok(files)
}

/// Returns `true` if a folder has the pieces of a page that zooms, which are not photos.
fn is_folder_of_pieces(path: &Path) -> bool {
    path.file_name() == Some(OsStr::new(PIECES)) && path.with_file_name(DESCRIPTION).is_file()
}

/// The message of the system, without its number.
fn reason_of(error: &std::io::Error) -> String {
    let text = error.to_string();
    match text.rfind(" (os error ") {
        Some(at) => text[..at].to_owned(),
        None => text,
    }
}

enum Examined {
    /// Size and time are as they were.
    Unchanged,
    /// Only the time has changed.
    Touched(Change),
    /// A photo that is new to its path, and what was known under that path.
    Read(Box<Entry>, Option<i64>),
    /// A file that says nothing.
    Failed(PathBuf, String),
}

pub(crate) fn modified(metadata: &Metadata) -> i64 {
    let time = metadata.modified().ok();
    let since = time.and_then(|time| time.duration_since(UNIX_EPOCH).ok());
    since.map_or(0, |since| since.as_nanos() as i64)
}

/// Looks at a file, waiting for the memory that this takes. `limits` have only what photos share.
fn examine(
    path: &Path,
    known: Option<&Entry>,
    limits: &Limits,
    progress: &Progress,
) -> Result<Examined, Cancelled> {
    progress.check()?;
    let failed = |reason: String| Ok(Examined::Failed(path.into(), reason));
    if path.to_str().is_none() {
        return failed("its name is not Unicode".into());
    }
    if path.as_os_str().len() > MAX_PATH_BYTES {
        return failed("its path is too long for the catalogue".into());
    }
    let metadata = match path.metadata() {
        // a pipe would be waited for
        Ok(metadata) if !metadata.is_file() => return failed("it is no plain file".into()),
        Ok(metadata) => metadata,
        Err(error) => return failed(reason_of(&error)),
    };
    let (bytes, modified) = (metadata.len(), modified(&metadata));
    if known.is_some_and(|known| known.bytes == bytes && known.modified == modified) {
        return Ok(Examined::Unchanged);
    }
    let (hash, decoded) = match decoded(path, bytes, known, limits, progress) {
        Ok(found) => found,
        Err(Undecoded::Cancelled(cancelled)) => return Err(cancelled),
        Err(Undecoded::File(error)) => return failed(reason_of(&error)),
        Err(Undecoded::Limit(error)) => return failed(error.to_string()),
    };
    let mut entry = Entry {
        id: 0,
        path: path.into(),
        width: 0,
        height: 0,
        orientation: 1,
        taken: None,
        unreadable: None,
        flaw: None,
        dropped: None,
        bytes,
        modified,
        hash,
        thumbnail: None,
    };
    match decoded {
        Decoded::Known => {
            let known = known.unwrap_or(&entry);
            return Ok(Examined::Touched(Change::Move {
                id: known.id,
                from: known.path.clone(),
                to: known.path.clone(),
                bytes,
                modified,
            }));
        }
        Decoded::Photo {
            probe,
            taken,
            small,
        } => {
            (entry.width, entry.height) = (probe.size.width(), probe.size.height());
            entry.orientation = probe.orientation;
            entry.taken = taken.map(bounded);
            let short_side = entry.width.min(entry.height);
            entry.flaw = flaw(&small.convert(), short_side).map(|flaw| flaw.name().into());
            entry.thumbnail = Some(small);
        }
        Decoded::Unreadable(error) => entry.unreadable = Some(bounded(error.to_string())),
    }
    Ok(Examined::Read(Box::new(entry), known.map(|known| known.id)))
}

/// The content of a file.
enum Decoded {
    /// As it was.
    Known,
    Photo {
        probe: Probe,
        taken: Option<String>,
        small: Image<Srgb<u8>>,
    },
    Unreadable(DecodeError),
}

/// The reason why nothing is known of the content of a file.
enum Undecoded {
    Cancelled(Cancelled),
    File(io::Error),
    /// It exceeds a limit, which may be another one the next time.
    Limit(DecodeError),
}

impl From<io::Error> for Undecoded {
    fn from(error: io::Error) -> Self {
        Self::File(error)
    }
}

/// The hash of a file of `bytes`, and what is in it.
///
/// The memory is reserved in two steps, the second of which is known only after reading the header. If it is not free, the
/// first is given back before it is waited for, and the file is read again: two photos that keep what they have and wait for
/// more wait forever.
fn decoded(
    path: &Path,
    bytes: u64,
    known: Option<&Entry>,
    limits: &Limits,
    progress: &Progress,
) -> Result<(Vec<u8>, Decoded), Undecoded> {
    let budget = &limits.memory;
    let wait = |bytes: u64| match budget.reserve_when_free(bytes, progress) {
        Ok(share) => Ok(share),
        Err(ReserveError::Cancelled(cancelled)) => Err(Undecoded::Cancelled(cancelled)),
        Err(ReserveError::OverBudget(over)) => Err(Undecoded::Limit(DecodeError::TooManyBytes {
            bytes: Some(bytes),
            others: 0,
            limit: over.limit,
        })),
    };
    // what is read of a picture within its share
    let within = |bytes: u64| Limits {
        memory: MemoryBudget::new(bytes),
        ..limits.clone()
    };
    let encoded = bytes.saturating_mul(copies(path)?);
    let mut share = wait(encoded.max(budget.limit().min(encoded.saturating_add(HEADER_BYTES))))?;
    let mut data = read_whole(path, bytes)?;
    let hash = blake3::hash(&data).as_bytes().to_vec();
    if known.is_some_and(|known| known.hash == hash) {
        return Ok((hash, Decoded::Known));
    }
    let header = within(share.bytes() - bytes);
    let need = memory_to_decode(Cursor::new(&data), Some(MIN_DECODED), &header);
    let need = match need {
        Ok(need) => bytes.saturating_add(need),
        Err(error) => return Ok((hash, unreadable(error)?)),
    };
    if share.grow_to(need).is_err() {
        drop((data, share));
        share = wait(need)?;
        data = read_whole(path, bytes)?;
        if blake3::hash(&data).as_bytes()[..] != hash {
            return Err(changed().into());
        }
    }
    let share_of_picture = within(share.bytes() - bytes);
    let decoded = match decode_reduced(Cursor::new(&data), MIN_DECODED, &share_of_picture) {
        Ok((probe, picture)) => Decoded::Photo {
            probe,
            taken: picture.origin.taken_at(),
            small: thumbnail(&picture.image),
        },
        Err(error) => unreadable(error)?,
    };
    Ok((hash, decoded))
}

/// Errors of the content are kept in the catalogue, those of the limits and of the disk are not.
fn unreadable(error: DecodeError) -> Result<Decoded, Undecoded> {
    match error {
        DecodeError::TooManyBytes { .. }
        | DecodeError::TooManyPixels { .. }
        | DecodeError::OutOfMemory { .. } => Err(Undecoded::Limit(error)),
        DecodeError::Io(error) => Err(Undecoded::File(error)),
        error => Ok(Decoded::Unreadable(error)),
    }
}

/// Copies of the encoded data that decoding holds: JPEG decoders have one of their own.
fn copies(path: &Path) -> io::Result<u64> {
    let mut first = [0; 2];
    let mut file = File::open(path)?;
    let is_jpeg = file.read_exact(&mut first).is_ok() && first == [0xff, 0xd8];
    Ok(1 + u64::from(is_jpeg))
}

/// The content of a file of `bytes`, and an error if it has another length.
fn read_whole(path: &Path, bytes: u64) -> io::Result<Vec<u8>> {
    let mut data = Vec::new();
    data.try_reserve_exact(bytes as usize)?;
    let mut file = File::open(path)?;
    // into memory that is there, which is not made larger for what was added in the meantime
    file.by_ref().take(bytes).read_to_end(&mut data)?;
    let more = file.read(&mut [0])?;
    if data.len() as u64 != bytes || more > 0 {
        return Err(changed());
    }
    Ok(data)
}

fn changed() -> io::Error {
    io::Error::other("it was changed while it was read")
}

/// A text that comes from a file, as far as it goes into the catalogue.
fn bounded(mut text: String) -> String {
    // longer than any sentence of a decoder
    const MAX_BYTES: usize = 1000;
    text.truncate(text.floor_char_boundary(MAX_BYTES));
    text
}

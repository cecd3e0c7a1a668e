//! Photos come into the catalogue.
//!
//! Files are known by their size and time of change, else by a hash of their content: what is known is not decoded again, a
//! file that moved keeps its row, and one that changed is looked at anew. Decoding runs in parallel, at reduced scale; what is
//! done is committed every few seconds' worth of photos, so that an interrupted run goes on where it was.

use crate::catalogue::{Catalogue, Change, Entry, FileNumber, MAX_PATH_BYTES};
use crate::deep_zoom::{DESCRIPTION, PIECES};
use crate::error::LibraryError;
use ravec_media::{Format, Limits, Picture, decode_reduced};
use ravec_mosaic::flaw;
use ravec_progress::Progress;
use ravec_raster::color::srgb_from_linear;
use ravec_raster::{
    Image, LinearRgb, PremulLinearRgba, ResizeFilter, Sample as _, Size, Srgb, resize,
};
use rayon::prelude::*;
use std::collections::{HashMap, HashSet};
use std::ffi::OsStr;
use std::fs::Metadata;
use std::io::Cursor;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;
use std::time::UNIX_EPOCH;

/// The longer side of the small pictures, which looks are taken from. A polynomial of degree 5 has at most 6 halves of waves;
/// 36 pixels give each 6, and roots for more pixels would take longer than decoding.
pub(crate) const THUMBNAIL: usize = 36;

/// The shorter side below which a photo is not reduced while it is decoded.
const LEAST_DECODED: u32 = 40;

/// Photos that are committed together.
const BATCH: usize = 256;

/// What became of the files that were looked at.
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

/// Adds files, and all picture files in folders and the folders in them, told by their extensions. Pieces of pages that zoom
/// (`mosaic_files` beside `mosaic.dzi`) are passed by.
///
/// # Errors
/// [`LibraryError::Add`] if a path is not there, and as for [`Catalogue::entries`], and [`LibraryError::Change`]; what was
/// committed before stays.
pub fn add(
    catalogue: &mut Catalogue,
    paths: &[PathBuf],
    limits: &Limits,
    progress: &Progress,
) -> Result<Added, LibraryError> {
    let files = files_in(paths, progress)?;
    let known: HashMap<PathBuf, Entry> = catalogue
        .entries(true)?
        .into_iter()
        .map(|entry| (entry.path.clone(), entry))
        .collect();
    let mut added = Added::default();
    let mut taken: HashSet<Vec<u8>> = HashSet::new();
    let phase = progress.phase("photos", files.len() as u64);
    for batch in files.chunks(BATCH) {
        let looked: Vec<Looked> = batch
            .par_iter()
            .map(|path| {
                progress.check()?;
                let looked = look(path, known.get(path), limits);
                phase.advance(1);
                Ok::<_, LibraryError>(looked)
            })
            .collect::<Result<_, _>>()?;
        let mut changes = Vec::new();
        for looked in looked {
            let (entry, old) = match looked {
                Looked::Unchanged => {
                    added.unchanged += 1;
                    continue;
                }
                Looked::Touched(change) => {
                    added.unchanged += 1;
                    changes.push(change);
                    continue;
                }
                Looked::Failed(path, reason) => {
                    added.unreadable.push((path, reason));
                    continue;
                }
                Looked::Read(entry, old) => (entry, old),
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

/// Whether [`add`] of `paths` would read a file, whatever link or spelling leads to it.
///
/// # Errors
/// [`LibraryError::Add`] if a path is not there, [`LibraryError::Cancelled`].
pub fn would_read(
    paths: &[PathBuf],
    file: &Path,
    progress: &Progress,
) -> Result<bool, LibraryError> {
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
fn files_in(paths: &[PathBuf], progress: &Progress) -> Result<Vec<PathBuf>, LibraryError> {
    let mut files = Vec::new();
    for path in paths {
        let failed = |reason: String| LibraryError::Add {
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

/// Whether a folder has the pieces of a page that zooms, which are no photos.
fn is_folder_of_pieces(path: &Path) -> bool {
    path.file_name() == Some(OsStr::new(PIECES)) && path.with_file_name(DESCRIPTION).is_file()
}

/// What the system says, without its number.
fn reason_of(error: &std::io::Error) -> String {
    let text = error.to_string();
    match text.rfind(" (os error ") {
        Some(at) => text[..at].to_owned(),
        None => text,
    }
}

enum Looked {
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

fn look(path: &Path, known: Option<&Entry>, limits: &Limits) -> Looked {
    let failed = |reason: String| Looked::Failed(path.into(), reason);
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
        return Looked::Unchanged;
    }
    if bytes > limits.memory.limit() {
        return failed("it is larger than --max-bytes".into());
    }
    let data = match std::fs::read(path) {
        Ok(data) => data,
        Err(error) => return failed(reason_of(&error)),
    };
    let hash = blake3::hash(&data).as_bytes().to_vec();
    if let Some(known) = known.filter(|known| known.hash == hash) {
        return Looked::Touched(Change::Move {
            id: known.id,
            from: known.path.clone(),
            to: known.path.clone(),
            bytes,
            modified,
        });
    }
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
    match decode_reduced(Cursor::new(&data), LEAST_DECODED, limits) {
        Ok((probe, picture)) => {
            (entry.width, entry.height) = (probe.size.width(), probe.size.height());
            entry.orientation = probe.orientation;
            entry.taken = picture.origin.taken_at().map(bounded);
            let small = thumbnail(&opaque(&picture));
            let short_side = entry.width.min(entry.height);
            entry.flaw = flaw(&small.convert(), short_side).map(|flaw| flaw.name().into());
            entry.thumbnail = Some(small);
        }
        Err(error) => entry.unreadable = Some(bounded(error.to_string())),
    }
    Looked::Read(Box::new(entry), known.map(|known| known.id))
}

/// A text that comes from a file, as far as it goes into the catalogue.
fn bounded(mut text: String) -> String {
    // longer than any sentence of a decoder
    const MAX_BYTES: usize = 1000;
    text.truncate(text.floor_char_boundary(MAX_BYTES));
    text
}

/// The pixels of a photo, on white where it is transparent.
pub(crate) fn opaque(picture: &Picture) -> Image<Srgb<u8>> {
    if !picture.image.has_alpha() {
        return picture.convert();
    }
    picture
        .convert::<PremulLinearRgba>()
        .map(|PremulLinearRgba([r, g, b, alpha])| {
            let rest = 1.0 - alpha;
            PremulLinearRgba([r + rest, g + rest, b + rest, 1.0])
        })
        .convert()
}

fn thumbnail(image: &Image<Srgb<u8>>) -> Image<Srgb<u8>> {
    let factor = THUMBNAIL as f64 / image.width().max(image.height()) as f64;
    if factor >= 1.0 {
        return image.clone();
    }
    let side = |pixels: usize| ((pixels as f64 * factor).round() as usize).max(1);
    let Ok(size) = Size::new(side(image.width()), side(image.height())) else {
        return image.clone();
    };
    let light: Image<LinearRgb> = image.convert();
    resize(&light, size, ResizeFilter::Box).map(|LinearRgb(light)| Srgb(light.map(encoded)))
}

/// The encoded value of linear light, within one step.
pub(crate) fn encoded(light: f32) -> u8 {
    let steps = (ENCODED.len() - 1) as f32;
    ENCODED[(light.clamp(0.0, 1.0) * steps + 0.5) as usize]
}

/// Encoded values of linear light in steps of a 4096th: within one step of the exact ones, without their roots.
static ENCODED: LazyLock<Vec<u8>> = LazyLock::new(|| {
    (0..=4096u16)
        .map(|light| u8::from_unit(srgb_from_linear(f32::from(light) / 4096.0)))
        .collect()
});

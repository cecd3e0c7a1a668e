//! Rows of the catalogue, each of which is checked: a catalogue may come from anybody.

use super::Entry;
use super::database::Trouble;
use crate::thumbnail::THUMBNAIL;
use ravec_raster::{Image, Srgb};
use rusqlite::Row;
use rusqlite::types::ValueRef;
use std::path::{Path, PathBuf};

/// Columns of an [`Entry`] with its pixels.
pub(super) const COLUMNS: &str = "id, path, hash, bytes, modified, width, height, orientation, taken, unreadable, flaw, \
                                  dropped, thumbnail_width, thumbnail";

/// [`COLUMNS`] without the pixels.
pub(super) const COLUMNS_WITHOUT_PIXELS: &str = "id, path, hash, bytes, modified, width, height, orientation, taken, \
                                                 unreadable, flaw, dropped, 0, NULL";

/// Bytes of a hash.
const HASH_BYTES: usize = 32;

/// The longest path that is kept, in bytes.
pub(crate) const MAX_PATH_BYTES: usize = 1 << 16;

/// The entry in a row, and the bytes that it has in the file at least.
pub(super) fn entry(row: &Row<'_>) -> Result<(Entry, u64), Trouble> {
    let id: i64 = row.get(0)?;
    let wrong = |name: &str| Trouble::Damaged(format!("photo {id} has a wrong {name}"));
    let whole = |column: usize, name: &str, max: i64| -> Result<i64, Trouble> {
        let number: i64 = row.get(column)?;
        if (0..=max).contains(&number) {
            Ok(number)
        } else {
            Err(wrong(name))
        }
    };
    let text = |column: usize, name: &str| -> Result<Option<String>, Trouble> {
        match row.get_ref(column)? {
            ValueRef::Null => Ok(None),
            ValueRef::Text(text) => match std::str::from_utf8(text) {
                Ok(text) => Ok(Some(text.to_owned())),
                Err(_) => Err(wrong(name)),
            },
            _ => Err(wrong(name)),
        }
    };
    let path = text(1, "path")?.and_then(absolute);
    let hash: Vec<u8> = row.get(2)?;
    if hash.len() != HASH_BYTES {
        return Err(wrong("hash"));
    }
    let (taken, unreadable) = (text(8, "time")?, text(9, "reason")?);
    let (flaw, dropped) = (text(10, "flaw")?, text(11, "reason")?);
    let thumbnail = match row.get_ref(13)? {
        ValueRef::Null => None,
        ValueRef::Blob(pixels) => {
            let width = whole(12, "thumbnail", THUMBNAIL as i64)? as usize;
            Some(thumbnail(width, pixels).ok_or_else(|| wrong("thumbnail"))?)
        }
        _ => return Err(wrong("thumbnail")),
    };
    let entry = Entry {
        id,
        path: path.ok_or_else(|| wrong("path"))?,
        hash,
        bytes: whole(3, "length", i64::MAX)? as u64,
        modified: row.get(4)?,
        width: whole(5, "width", u32::MAX.into())? as usize,
        height: whole(6, "height", u32::MAX.into())? as usize,
        orientation: whole(7, "orientation", 8)? as u8,
        taken,
        unreadable,
        flaw,
        dropped,
        thumbnail,
    };
    if entry.thumbnail.is_some() && (entry.width == 0 || entry.height == 0) {
        return Err(wrong("size"));
    }
    let texts = [&entry.taken, &entry.unreadable, &entry.flaw, &entry.dropped];
    let texts: usize = texts.into_iter().flatten().map(String::len).sum();
    let pixels = entry
        .thumbnail
        .as_ref()
        .map_or(0, |image| 3 * image.pixels().len());
    let bytes = HASH_BYTES + entry.path.as_os_str().len() + texts + pixels;
    Ok((entry, bytes as u64))
}

/// The path of a photo, if it is one: they are kept as they are from the root.
pub(super) fn absolute(text: String) -> Option<PathBuf> {
    let fits = text.len() <= MAX_PATH_BYTES && !text.contains('\0');
    (fits && Path::new(&text).is_absolute()).then(|| text.into())
}

fn thumbnail(width: usize, pixels: &[u8]) -> Option<Image<Srgb<u8>>> {
    let (pixels, rest) = pixels.as_chunks();
    let whole = rest.is_empty() && pixels.len() <= THUMBNAIL * THUMBNAIL;
    if width == 0 || !whole || !pixels.len().is_multiple_of(width) {
        return None;
    }
    let height = pixels.len() / width;
    let pixels = pixels.iter().map(|&pixel| Srgb(pixel)).collect();
    (height <= THUMBNAIL).then(|| Image::from_vec(width, pixels).ok())?
}

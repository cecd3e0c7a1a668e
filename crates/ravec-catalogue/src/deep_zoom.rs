//! A folder with a page that zooms from the mosaic into its photos.
//!
//! | file | content |
//! | --- | --- |
//! | `index.html` | the page: a viewer, and where which photo is; it needs nothing beyond the folder |
//! | `mosaic.dzi` | what other viewers of Deep Zoom images want to know |
//! | `mosaic_files/LEVEL/COL_ROW.jpg` | the mosaic in all sizes, in pieces of 256 pixels |
//! | `ravec-manifest.json` | sizes and hashes of all these files, by which a later run knows what it may replace |
//!
//! The viewer is our own page of script. A kept one such as `OpenSeadragon` brings 200 KB and a license text for buttons,
//! protocols and plug-ins that are not wanted here, and knows nothing of the photos within the picture.
//!
//! Guarantees: the folder is made beside its place under another name, and takes its place when it is complete. It replaces an
//! empty folder, or one in which is nothing but unchanged files of an earlier page; with anything else in it, a folder stays as
//! it is. A link to a folder stays, and what it leads to is replaced. A process that is killed leaves the old page or the new
//! one at the place; where the system cannot exchange two folders at once, it may leave the old one under a passing name, which
//! the next run with the same place undoes. Does not guarantee: that a page that was just written survives a loss of power.

mod manifest;
mod page;
mod place;

pub(crate) use manifest::{DESCRIPTION, PIECES};

use crate::error::CatalogueError;
use crate::painter::Unpainted;
use crate::pyramid::{PIECE_PX, Piece, Pyramid};
use manifest::{MANIFEST, MAX_FILES, Manifest, PAGE};
use place::Place;
use ravec_files::TemporaryFolder;
use ravec_media::{EncodeError, Format, Picture, WriteError, WriteOptions, encode};
use ravec_progress::{Cancelled, Progress};
use ravec_raster::{Rect, Size, Srgb};
use std::fs::{self, File};
use std::io::{self, Cursor, Write as _};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// A folder that is being made. It is removed if it is not finished.
pub(crate) struct DeepZoom {
    place: Place,
    /// The folder under its passing name.
    folder: TemporaryFolder,
    manifest: Mutex<Manifest>,
    pyramid: Pyramid,
    size: Size,
    quality: u8,
}

/// The reason why a page could not be made.
pub(crate) enum PageError {
    Cancelled(Cancelled),
    Write(WriteError),
}

impl From<Cancelled> for PageError {
    fn from(cancelled: Cancelled) -> Self {
        Self::Cancelled(cancelled)
    }
}

impl From<PageError> for Unpainted {
    fn from(error: PageError) -> Self {
        match error {
            PageError::Cancelled(cancelled) => Self::Cancelled(cancelled),
            PageError::Write(error) => Self::Write(error),
        }
    }
}

impl From<PageError> for CatalogueError {
    fn from(error: PageError) -> Self {
        match error {
            PageError::Cancelled(cancelled) => cancelled.into(),
            PageError::Write(error) => Self::Write(error),
        }
    }
}

/// Refuses a folder that no page may replace, before any work is done for it.
pub(crate) fn check_place(target: &Path, size: Size, progress: &Progress) -> Result<(), PageError> {
    let place = Place::find(target)?;
    if Pyramid::pieces(size) > MAX_FILES - 2 {
        let text = format!("the page would have more than {MAX_FILES} files");
        return Err(place.failed(io::Error::other(text)));
    }
    place.check(progress)
}

/// Bytes of memory that making a page takes, at most: a row of pieces of all levels, pieces that are being written, the lists of
/// pieces and tiles.
pub(crate) fn bytes_of_page(size: Size, tiles: usize) -> u64 {
    /// Of a level, the strip and its half on the way to the next one; all levels have twice the pixels of the finest.
    const STRIPS: usize = 3;
    /// Of a piece, its pixels, what the encoder has of them, and the file.
    const COPIES: usize = 4;
    let strips = STRIPS * 3 * PIECE_PX * size.width().next_multiple_of(PIECE_PX);
    let pieces = COPIES * 3 * PIECE_PX * PIECE_PX * rayon::current_num_threads();
    let lists = 300 * Pyramid::pieces(size) + 100 * tiles;
    (strips + pieces + lists) as u64
}

impl DeepZoom {
    pub fn new(target: &Path, size: Size, quality: u8) -> Result<Self, PageError> {
        let place = Place::find(target)?;
        let failed = |cause: io::Error| place.failed(cause);
        if let Some(parent) = place.path().parent() {
            fs::create_dir_all(parent).map_err(failed)?;
        }
        let folder = TemporaryFolder::beside(place.path()).map_err(failed)?;
        let pyramid = Pyramid::new(size);
        for level in 0..pyramid.levels() {
            let level = folder.path().join(PIECES).join(level.to_string());
            fs::create_dir_all(level).map_err(failed)?;
        }
        Ok(Self {
            place,
            folder,
            manifest: Mutex::default(),
            pyramid,
            size,
            quality,
        })
    }

    /// Takes the next rows of the mosaic.
    pub fn push(&mut self, pixels: &[Srgb<u8>], progress: &Progress) -> Result<(), PageError> {
        let Self {
            place,
            folder,
            manifest,
            pyramid,
            quality,
            ..
        } = self;
        let options = WriteOptions {
            quality: *quality,
            ..WriteOptions::default()
        };
        pyramid.push(pixels, &|piece: Piece| {
            progress.check()?;
            let failed = |cause: EncodeError| {
                PageError::Write(WriteError {
                    path: place.named().into(),
                    cause,
                })
            };
            let Piece {
                level,
                col,
                row,
                image,
            } = piece;
            let mut bytes = Cursor::new(Vec::new());
            encode(
                &mut bytes,
                Format::Jpeg,
                &Picture::from_image(image),
                &options,
            )
            .map_err(failed)?;
            let name = format!("{PIECES}/{level}/{col}_{row}.jpg");
            put(folder.path(), &name, bytes.get_ref(), manifest)
                .map_err(|cause| failed(cause.into()))
        })
    }

    /// Writes the page and puts the folder in its place. `photos` has the file of each tile and where the tile is. Returns a
    /// folder that is kept, with what was put into the page that was replaced in the meantime.
    pub fn finish<'a>(
        self,
        photos: impl Iterator<Item = (&'a Path, Rect)>,
        progress: &Progress,
    ) -> Result<Option<PathBuf>, PageError> {
        let Self {
            place,
            folder,
            manifest,
            pyramid,
            size,
            ..
        } = self;
        let title = place
            .named()
            .file_name()
            .unwrap_or_default()
            .to_string_lossy();
        let page = page::page(&title, size, pyramid.levels(), photos);
        let description = page::description(size);
        for (name, content) in [(PAGE, page), (DESCRIPTION, description)] {
            put(folder.path(), name, content.as_bytes(), &manifest)
                .map_err(|cause| place.failed(cause))?;
        }
        let manifest = manifest
            .into_inner()
            .unwrap_or_else(PoisonError::into_inner);
        // the last file: with it, the folder is known to be complete
        create(&folder.path().join(MANIFEST), &manifest.to_json())
            .map_err(|cause| place.failed(cause))?;
        place.take(folder, progress)
    }
}

/// Writes a new file of a page into its temporary folder, and records it.
fn put(folder: &Path, name: &str, content: &[u8], manifest: &Mutex<Manifest>) -> io::Result<()> {
    create(&folder.join(name), content)?;
    // entries are complete or not there
    let mut manifest = manifest.lock().unwrap_or_else(PoisonError::into_inner);
    manifest.record(name, content);
    Ok(())
}

fn create(path: &Path, content: &[u8]) -> io::Result<()> {
    let mut file = File::options().write(true).create_new(true).open(path)?;
    file.write_all(content)
}

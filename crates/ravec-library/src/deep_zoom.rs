//! A folder with a page that zooms from the mosaic into its photos.
//!
//! | file | content |
//! | --- | --- |
//! | `index.html` | the page: a viewer, and where which photo is; it needs nothing beyond the folder |
//! | `mosaic.dzi` | what other viewers of Deep Zoom images want to know |
//! | `mosaic_files/LEVEL/COL_ROW.jpg` | the mosaic in all sizes, in pieces of 256 pixels |
//!
//! The viewer is our own page of script. A kept one such as `OpenSeadragon` brings 200 KB and a licence text for buttons,
//! protocols and plug-ins that are not wanted here, and knows nothing of the photos within the picture.
//!
//! The folder is made beside its place under another name, and takes its place when it is complete. A mosaic that was there
//! before is replaced; anything else is not.

use crate::painter::Unpainted;
use crate::pyramid::{PIECE_PX, Piece, Pyramid};
use ravec_media::{
    EncodeError, Format, Picture, WriteError, WriteOptions, encode, write_atomically,
};
use ravec_progress::Progress;
use ravec_raster::{Rect, Size, Srgb};
use serde_json::json;
use std::collections::HashMap;
use std::ffi::OsString;
use std::fs;
use std::io::{self, Cursor, Write as _};
use std::path::{Path, PathBuf};

const PAGE: &str = include_str!("viewer.html");

/// The file by which a folder is known to be a mosaic.
const MARK: &str = "mosaic.dzi";

/// A folder that is being made. It is removed if it is not finished.
pub(crate) struct DeepZoom {
    target: PathBuf,
    /// The folder under its passing name.
    folder: PathBuf,
    finished: bool,
    pyramid: Pyramid,
    size: Size,
    quality: u8,
}

impl DeepZoom {
    pub fn new(target: &Path, size: Size, quality: u8) -> Result<Self, Unpainted> {
        let failed = |cause: io::Error| unwritable(target, cause);
        if let Some(reason) = taken(target) {
            return Err(failed(io::Error::new(io::ErrorKind::AlreadyExists, reason)));
        }
        let folder = beside(target, "part");
        let pyramid = Pyramid::new(size);
        let parent = target.parent().filter(|parent| *parent != Path::new(""));
        if let Some(parent) = parent {
            fs::create_dir_all(parent).map_err(failed)?;
        }
        fs::create_dir(&folder).map_err(failed)?;
        let zoom = Self {
            target: target.into(),
            folder,
            finished: false,
            pyramid,
            size,
            quality,
        };
        for level in 0..zoom.pyramid.levels() {
            fs::create_dir_all(zoom.level(level)).map_err(failed)?;
        }
        Ok(zoom)
    }

    fn level(&self, level: usize) -> PathBuf {
        level_folder(&self.folder, level)
    }

    /// Takes the next rows of the mosaic.
    pub fn push(&mut self, pixels: &[Srgb<u8>], progress: &Progress) -> Result<(), Unpainted> {
        let Self {
            target,
            folder,
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
                Unpainted::Write(WriteError {
                    path: target.clone(),
                    cause,
                })
            };
            let name = format!("{}_{}.jpg", piece.col, piece.row);
            let mut bytes = Cursor::new(Vec::new());
            let picture = Picture::from_image(piece.image);
            encode(&mut bytes, Format::Jpeg, &picture, &options).map_err(failed)?;
            let path = level_folder(folder, piece.level).join(name);
            put(&path, bytes.get_ref()).map_err(|cause| failed(cause.into()))
        })
    }

    /// Writes the page and puts the folder in its place. `photos` has the file of each tile and where the tile is.
    pub fn finish<'a>(
        mut self,
        photos: impl Iterator<Item = (&'a Path, Rect)>,
    ) -> Result<(), Unpainted> {
        let target = self.target.clone();
        let failed = |cause: io::Error| unwritable(&target, cause);
        let title = target.file_name().unwrap_or_default().to_string_lossy();
        let page = page(&title, self.size, self.pyramid.levels(), photos);
        put(&self.folder.join("index.html"), page.as_bytes()).map_err(failed)?;
        let description = description(self.size);
        put(&self.folder.join(MARK), description.as_bytes()).map_err(failed)?;
        // between the two renames the target is missing; what was there is kept until the new folder is in its place
        let old = beside(&target, "old");
        let replaces = target.exists();
        if replaces {
            fs::rename(&target, &old).map_err(failed)?;
        }
        if let Err(cause) = fs::rename(&self.folder, &target) {
            if replaces {
                fs::rename(&old, &target).map_err(failed)?;
            }
            return Err(failed(cause));
        }
        self.finished = true;
        if replaces {
            fs::remove_dir_all(&old).map_err(failed)?;
        }
        Ok(())
    }
}

impl Drop for DeepZoom {
    fn drop(&mut self) {
        if !self.finished {
            // a folder that cannot be removed is left under its passing name, and there is nobody to tell
            let _ = fs::remove_dir_all(&self.folder);
        }
    }
}

fn put(path: &Path, content: &[u8]) -> io::Result<()> {
    write_atomically(path, |writer| writer.write_all(content))
}

fn level_folder(folder: &Path, level: usize) -> PathBuf {
    folder.join("mosaic_files").join(level.to_string())
}

/// A name beside the target that no other run has.
fn beside(target: &Path, kind: &str) -> PathBuf {
    let mut name = OsString::from(".");
    name.push(target.file_name().unwrap_or_default());
    name.push(format!(".{}.{kind}", std::process::id()));
    target.with_file_name(name)
}

/// Why a folder cannot be made here, if it cannot.
fn taken(target: &Path) -> Option<&'static str> {
    if target.file_name().is_none() {
        return Some("the folder needs a name of its own");
    }
    let mut content = match fs::read_dir(target) {
        Ok(content) => content,
        Err(_) if target.exists() => return Some("it is there and not a folder"),
        Err(_) => return None,
    };
    let other = content.next().is_some() && !target.join(MARK).is_file();
    other.then_some("the folder has other files in it; name a new one")
}

fn unwritable(path: &Path, cause: io::Error) -> Unpainted {
    Unpainted::Write(WriteError {
        path: path.into(),
        cause: cause.into(),
    })
}

fn description(size: Size) -> String {
    format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<Image xmlns=\"http://schemas.microsoft.com/deepzoom/2008\" Format=\"jpg\" \
         Overlap=\"0\" TileSize=\"{PIECE_PX}\">\n  <Size Width=\"{}\" Height=\"{}\"/>\n</Image>\n",
        size.width(),
        size.height()
    )
}

/// The page: the viewer, with what it has to know.
fn page<'a>(
    title: &str,
    size: Size,
    levels: usize,
    photos: impl Iterator<Item = (&'a Path, Rect)>,
) -> String {
    let mut numbers: HashMap<&Path, usize> = HashMap::new();
    let (mut names, mut tiles) = (Vec::new(), Vec::new());
    for (path, place) in photos {
        let number = *numbers.entry(path).or_insert_with(|| {
            names.push(path.file_name().unwrap_or_default().to_string_lossy());
            names.len() - 1
        });
        tiles.extend([place.col, place.row, place.width, place.height, number]);
    }
    let data = json!({
        "title": title,
        "width": size.width(),
        "height": size.height(),
        "piece": PIECE_PX,
        "levels": levels,
        "names": names,
        "tiles": tiles,
    });
    // no name may end the script
    let data = data.to_string().replace('<', "\\u003c");
    PAGE.replace("\"DATA\"", &data)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_cannot_break_the_page() {
        let evil = Path::new("/photos/<!--<script>\"x\".jpg");
        let size = Size::new(20, 10).unwrap();
        let page = page("</title>", size, 5, [(evil, Rect::of(size))].into_iter());
        assert!(page.contains(r#"["\u003c!--\u003cscript>\"x\".jpg"]"#));
        assert!(page.contains(r#""title":"\u003c/title>""#));
        assert_eq!(page.matches("<script>").count(), 1);
    }

    #[test]
    fn only_new_folders_and_mosaics_are_taken() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(taken(&folder.path().join("new")), None);
        assert_eq!(taken(folder.path()), None);
        assert!(taken(Path::new("..")).is_some());
        let file = folder.path().join("file");
        put(&file, b"text").unwrap();
        assert!(taken(&file).is_some() && taken(folder.path()).is_some());
        put(&folder.path().join(MARK), b"").unwrap();
        assert_eq!(taken(folder.path()), None);
    }
}

//! A mosaic from a picture and a catalogue.
//!
//! Looks come from the small pictures in the catalogue; only the photos that were chosen are decoded, at full size, and scaled
//! once. The mosaic is made one row of tiles at a time.

use crate::add::{modified, opaque};
use crate::catalogue::{Catalogue, Entry};
use crate::error::LibraryError;
use ravec_media::{Limits, RowsError, read, write_rows};
use ravec_mosaic::{
    Choice, ChooseParams, Crop, Frame, Look, MAX_DEGREE, NEAR_DUPLICATE, Photos, Rules, Tile,
    choose, grid_tiles, near_duplicates, scaled_photo,
};
use ravec_progress::{Cancelled, Progress};
use ravec_raster::{
    AnyImage, Image, LinearRgb, Oklab, PremulLinearRgba, ResizeFilter, Size, Srgb, resize,
};
use rayon::prelude::*;
use std::collections::{HashMap, HashSet};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// How a mosaic is made.
#[derive(Debug, Clone, PartialEq)]
pub struct MosaicParams {
    /// Tiles in a row.
    pub columns: usize,
    /// Rows of tiles; none for as many as keep the proportions of the picture.
    pub rows: Option<usize>,
    /// The size of a tile.
    pub tile: Size,
    /// What is done with photos of other proportions.
    pub crop: Crop,
    /// Limits on repeats.
    pub rules: Rules,
    /// How photos are compared.
    pub choose: ChooseParams,
    /// Quality of JPEG, 1 to 100.
    pub quality: u8,
    /// Bytes of scaled photos that are kept for later rows.
    pub kept_bytes: usize,
}

/// A mosaic that was written.
#[derive(Debug, Clone, PartialEq)]
pub struct Mosaic {
    /// Tiles in a row, and rows.
    pub tiles: (usize, usize),
    /// Pixels of the mosaic.
    pub size: Size,
    /// The photo of each tile, row by row.
    pub photos: Vec<PathBuf>,
    /// The choice; its numbers are of [`used`](Self::used).
    pub choice: Choice,
    /// Photos in the catalogue that fit the tiles.
    pub fitting: usize,
    /// Of these, how many are different to the eye.
    pub different: usize,
    /// Different photos in the mosaic.
    pub used: usize,
    /// The most uses of a photo.
    pub most_uses: usize,
    /// The least distance of two tiles with the same photo, in tiles; none if no photo is there twice.
    pub nearest_repeat: Option<f64>,
    /// Photos that are gone, changed or cannot be read, and what was done about it.
    pub warnings: Vec<String>,
}

/// Pixels of the picture in a tile beyond which more say nothing about its look.
const PICTURE_PX: usize = 16;

/// Makes a mosaic of `picture` from the photos of a catalogue, and writes it to `output` as PNG, JPEG or TIFF.
///
/// Photos that cannot be read any more are replaced by the next best.
///
/// # Errors
/// [`LibraryError`]; the output is then as it was.
pub fn mosaic(
    catalogue: &Catalogue,
    picture: &AnyImage,
    output: &Path,
    params: &MosaicParams,
    limits: &Limits,
    progress: &Progress,
) -> Result<Mosaic, LibraryError> {
    let layout = Layout::new(picture.size(), params)?;
    let mut warnings = layout.warning(picture.size());
    let entries = there(catalogue, &mut warnings)?;
    if entries.is_empty() {
        return Err(LibraryError::Empty {
            path: catalogue.path().into(),
        });
    }
    let total = entries.len();
    let aspect = params.tile.width() as f64 / params.tile.height() as f64;
    let fitting: Vec<(Entry, Frame)> = entries
        .into_iter()
        .filter_map(|entry| {
            let frame = Size::new(entry.width, entry.height).ok();
            let frame = frame.and_then(|size| params.crop.frame(size, aspect))?;
            Some((entry, frame))
        })
        .collect();
    if fitting.is_empty() {
        return Err(LibraryError::NoneFits {
            photos: total,
            width: params.tile.width(),
            height: params.tile.height(),
        });
    }
    let tiles = layout.tiles(picture, params.choose.weights.degree, progress)?;
    let phase = progress.phase("photos", fitting.len() as u64);
    let looks: Vec<Look> = fitting
        .par_iter()
        .map(|(entry, frame)| {
            progress.check()?;
            phase.advance(1);
            Ok(look(entry, *frame))
        })
        .collect::<Result<_, Cancelled>>()?;
    let mut photos: Vec<(PathBuf, Look)> = fitting
        .into_iter()
        .map(|(entry, _)| entry.path)
        .zip(looks)
        .collect();
    loop {
        let (paths, looks): (Vec<PathBuf>, Vec<Look>) = photos.iter().cloned().unzip();
        let groups = near_duplicates(&looks, NEAR_DUPLICATE, progress)?;
        let library = Photos::new(&looks, groups.clone(), params.choose.weights);
        let choice = choose(&tiles, &library, &params.rules, &params.choose, progress)?;
        let mut painter = Painter {
            paths: &paths,
            choice: &choice,
            columns: layout.columns,
            params,
            limits,
            progress,
            kept: HashMap::new(),
            kept_bytes: 0,
            left: uses(&choice),
        };
        let size = layout.size;
        let phase = progress.phase("write", layout.rows as u64);
        let written = write_rows(
            output,
            size,
            params.quality,
            params.tile.height(),
            |rows, pixels| {
                painter.rows(&rows, pixels)?;
                phase.advance(1);
                Ok(())
            },
        );
        match written {
            Ok(()) => {
                return Ok(described(
                    &layout,
                    &paths,
                    &groups,
                    library.different(),
                    choice,
                    &tiles,
                    warnings,
                ));
            }
            Err(RowsError::Write(error)) => return Err(LibraryError::Write(error)),
            Err(RowsError::Fill(Unpainted::Cancelled(cancelled))) => return Err(cancelled.into()),
            Err(RowsError::Fill(Unpainted::Photos(broken))) => {
                let gone: HashSet<u32> = broken.iter().map(|(photo, _)| *photo).collect();
                warnings.extend(broken.into_iter().map(|(photo, reason)| {
                    format!(
                        "{}: {reason}; others took its place",
                        paths[photo as usize].display()
                    )
                }));
                let mut number = 0..;
                photos.retain(|_| number.next().is_none_or(|number| !gone.contains(&number)));
                if photos.is_empty() {
                    return Err(LibraryError::Empty {
                        path: catalogue.path().into(),
                    });
                }
            }
        }
    }
}

/// The photos whose files are as they were when they were added.
fn there(catalogue: &Catalogue, warnings: &mut Vec<String>) -> Result<Vec<Entry>, LibraryError> {
    let mut entries = catalogue.usable()?;
    entries.retain(|entry| {
        let reason = match entry.path.metadata() {
            Ok(metadata)
                if metadata.len() == entry.bytes && modified(&metadata) == entry.modified =>
            {
                return true;
            }
            Ok(_) => "changed since it was added (add it again)",
            Err(_) => "is no longer there",
        };
        warnings.push(format!(
            "{}: {reason}; others took its place",
            entry.path.display()
        ));
        false
    });
    Ok(entries)
}

/// What the part of a photo that a tile shows looks like.
fn look(entry: &Entry, frame: Frame) -> Look {
    let Some(small) = &entry.thumbnail else {
        // only photos with a small picture come here
        return Look {
            coefficients: Vec::new(),
            quarters: [[0.0; 3]; 4],
        };
    };
    let image: Image<Oklab> = small.convert();
    let (x, y) = (
        image.width() as f64 / entry.width as f64,
        image.height() as f64 / entry.height as f64,
    );
    let frame = Frame {
        left: frame.left * x,
        top: frame.top * y,
        width: frame.width * x,
        height: frame.height * y,
    };
    Look::of(&image, frame, MAX_DEGREE)
}

fn uses(choice: &Choice) -> HashMap<u32, usize> {
    let mut uses = HashMap::new();
    for &photo in &choice.photos {
        *uses.entry(photo).or_default() += 1;
    }
    uses
}

fn described(
    layout: &Layout,
    paths: &[PathBuf],
    groups: &[u32],
    different: usize,
    choice: Choice,
    tiles: &[Tile],
    warnings: Vec<String>,
) -> Mosaic {
    let mut places: HashMap<u32, Vec<[f64; 2]>> = HashMap::new();
    for (tile, &photo) in tiles.iter().zip(&choice.photos) {
        places
            .entry(groups[photo as usize])
            .or_default()
            .push(tile.center());
    }
    let nearest_sq = places
        .values()
        .flat_map(|places| {
            places.iter().enumerate().flat_map(move |(at, a)| {
                places[..at]
                    .iter()
                    .map(move |b| (a[0] - b[0]).powi(2) + (a[1] - b[1]).powi(2))
            })
        })
        .min_by(f64::total_cmp);
    Mosaic {
        tiles: (layout.columns, layout.rows),
        size: layout.size,
        photos: choice
            .photos
            .iter()
            .map(|&photo| paths[photo as usize].clone())
            .collect(),
        fitting: paths.len(),
        different,
        used: places.len(),
        most_uses: places.values().map(Vec::len).max().unwrap_or(0),
        nearest_repeat: nearest_sq.map(f64::sqrt),
        choice,
        warnings,
    }
}

/// Where the tiles are on the picture and in the mosaic.
struct Layout {
    columns: usize,
    rows: usize,
    size: Size,
    /// The part of the picture that is shown.
    frame: Frame,
}

impl Layout {
    fn new(picture: Size, params: &MosaicParams) -> Result<Self, LibraryError> {
        let (width, height) = (picture.width() as f64, picture.height() as f64);
        let tile = params.tile;
        let columns = params.columns;
        let rows = params.rows.unwrap_or_else(|| {
            let side = width / columns as f64 * tile.height() as f64 / tile.width() as f64;
            ((height / side).round() as usize).max(1)
        });
        let size = columns
            .checked_mul(tile.width())
            .zip(rows.checked_mul(tile.height()))
            .and_then(|(width, height)| Size::new(width, height).ok());
        let size = size.ok_or(LibraryError::TooLarge {
            columns,
            rows,
            width: tile.width(),
            height: tile.height(),
        })?;
        if picture.width() < columns || picture.height() < rows {
            return Err(LibraryError::PictureTooSmall {
                width: picture.width(),
                height: picture.height(),
                columns,
                rows,
            });
        }
        let aspect = size.width() as f64 / size.height() as f64;
        Ok(Self {
            columns,
            rows,
            size,
            frame: Frame::centered(width, height, aspect),
        })
    }

    /// How much of the picture is not in the mosaic, if that is more than a hundredth.
    fn warning(&self, picture: Size) -> Vec<String> {
        let shown = self.frame.width * self.frame.height / picture.pixels() as f64;
        let lost = 100.0 * (1.0 - shown);
        if lost <= 1.0 {
            return Vec::new();
        }
        vec![format!(
            "the picture has other proportions than the mosaic; {lost:.0} % at its borders are not shown"
        )]
    }

    fn tiles(
        &self,
        picture: &AnyImage,
        degree: usize,
        progress: &Progress,
    ) -> Result<Vec<Tile>, Cancelled> {
        let reduce = |length: f64, tiles: usize| (PICTURE_PX * tiles) as f64 / length;
        let factor =
            reduce(self.frame.width, self.columns).max(reduce(self.frame.height, self.rows));
        // transparent parts are seen on white
        let opaque: Image<LinearRgb> = if picture.has_alpha() {
            let on_white = |PremulLinearRgba([r, g, b, alpha]): PremulLinearRgba| {
                LinearRgb([r, g, b].map(|value| value + 1.0 - alpha))
            };
            picture.convert::<PremulLinearRgba>().map(on_white)
        } else {
            picture.convert()
        };
        let side = |pixels: usize| ((pixels as f64 * factor).ceil() as usize).max(1);
        let small = if factor < 1.0 {
            Size::new(side(opaque.width()), side(opaque.height())).ok()
        } else {
            None
        };
        let (image, x, y) = match small {
            Some(size) => (
                resize(&opaque, size, ResizeFilter::Box),
                size.width() as f64 / opaque.width() as f64,
                size.height() as f64 / opaque.height() as f64,
            ),
            None => (opaque, 1.0, 1.0),
        };
        let frame = Frame {
            left: self.frame.left * x,
            top: self.frame.top * y,
            width: self.frame.width * x,
            height: self.frame.height * y,
        };
        let image: Image<Oklab> = image.convert();
        grid_tiles(&image, frame, self.columns, self.rows, degree, progress)
    }
}

/// Why rows could not be painted.
enum Unpainted {
    Cancelled(Cancelled),
    /// Photos that cannot be read, and why.
    Photos(Vec<(u32, String)>),
}

impl From<Cancelled> for Unpainted {
    fn from(cancelled: Cancelled) -> Self {
        Self::Cancelled(cancelled)
    }
}

/// A photo as it stands in a tile, or why there is none.
type Scaled = Result<Image<Srgb<u8>>, String>;

struct Painter<'a> {
    paths: &'a [PathBuf],
    choice: &'a Choice,
    columns: usize,
    params: &'a MosaicParams,
    limits: &'a Limits,
    progress: &'a Progress,
    /// Scaled photos that are wanted again.
    kept: HashMap<u32, Arc<Image<Srgb<u8>>>>,
    kept_bytes: usize,
    /// Uses of each photo that are still to come.
    left: HashMap<u32, usize>,
}

impl Painter<'_> {
    /// Paints a row of tiles.
    fn rows(&mut self, rows: &Range<usize>, pixels: &mut [Srgb<u8>]) -> Result<(), Unpainted> {
        let tile = self.params.tile;
        let first = rows.start / tile.height() * self.columns;
        let wanted = &self.choice.photos[first..first + self.columns];
        let mut missing: Vec<u32> = wanted.to_vec();
        missing.retain(|photo| !self.kept.contains_key(photo));
        missing.sort_unstable();
        missing.dedup();
        let scaled: Vec<(u32, Scaled)> = missing
            .par_iter()
            .map(|&photo| {
                self.progress.check()?;
                Ok((photo, self.scaled(photo)))
            })
            .collect::<Result<_, Cancelled>>()?;
        let mut here = HashMap::new();
        let mut broken = Vec::new();
        for (photo, result) in scaled {
            match result {
                Ok(image) => drop(here.insert(photo, Arc::new(image))),
                Err(reason) => broken.push((photo, reason)),
            }
        }
        if !broken.is_empty() {
            return Err(Unpainted::Photos(broken));
        }
        let width = self.columns * tile.width();
        for (col, photo) in wanted.iter().enumerate() {
            let Some(image) = here.get(photo).or_else(|| self.kept.get(photo)) else {
                continue;
            };
            for (line, row) in pixels.chunks_exact_mut(width).zip(image.rows()) {
                line[col * tile.width()..][..tile.width()].copy_from_slice(row);
            }
        }
        for photo in wanted {
            if let Some(left) = self.left.get_mut(photo) {
                *left -= 1;
            }
        }
        let bytes = 3 * tile.pixels();
        for photo in wanted {
            let again = self.left.get(photo).is_some_and(|&left| left > 0);
            if !again && self.kept.remove(photo).is_some() {
                self.kept_bytes -= bytes;
            }
            if again
                && self.kept_bytes + bytes <= self.params.kept_bytes
                && let Some(image) = here.get(photo)
                && self.kept.insert(*photo, Arc::clone(image)).is_none()
            {
                self.kept_bytes += bytes;
            }
        }
        Ok(())
    }

    fn scaled(&self, photo: u32) -> Scaled {
        let picture = read(&self.paths[photo as usize], self.limits)
            .map_err(|error| error.cause.to_string())?;
        scaled_photo(&opaque(&picture), self.params.tile, self.params.crop)
            .ok_or_else(|| "has other proportions than when it was added".to_owned())
    }
}

//! A mosaic from a picture and a catalogue.
//!
//! Looks come from the small pictures in the catalogue; only the photos that were chosen are decoded, at full size, and scaled
//! once. The mosaic is made one row of tiles at a time, or in lower strips if the memory does not suffice for that.

use crate::add::modified;
use crate::catalogue::{Catalogue, Entry, Loaded, leads_into, protected};
use crate::deep_zoom::{DeepZoom, check_place};
use crate::error::CatalogueError;
use crate::layout::Layout;
use crate::painter::{Candidate, Painter, Source, Unpainted};
use crate::plan::{Plan, reserve, reserve_choice};
use crate::workers::Workers;
use ravec_media::{Limits, RowsError, write_rows};
use ravec_memory::{MemoryBudget, Reservation};
use ravec_mosaic::{
    Choice, ChooseParams, Crop, Descriptor, Frame, MAX_DEGREE, NEAR_DUPLICATE, Photos, Rules,
    Tiling, choose, near_duplicates,
};
use ravec_progress::{Cancelled, Progress};
use ravec_raster::{AnyImage, Rect, Size, Srgb};
use rayon::prelude::*;
use std::collections::{HashMap, HashSet};
use std::ops::Range;
use std::path::{Path, PathBuf};

/// Parameters of a mosaic.
#[derive(Debug, Clone, PartialEq)]
pub struct MosaicParams {
    /// Tiles in a row.
    pub columns: usize,
    /// Rows of tiles; none for as many as keep the proportions of the picture.
    pub rows: Option<usize>,
    /// The size of a tile.
    pub tile: Size,
    /// Treatment of photos of other proportions.
    pub crop: Crop,
    /// Limits on repeats.
    pub rules: Rules,
    /// Comparison of photos.
    pub choose: ChooseParams,
    /// Tiles of several sizes, off the grid, at most as many as there would be on it, with this seed; none for the grid.
    pub adaptive: Option<u64>,
    /// Quality of JPEG, 1 to 100.
    pub quality: u8,
    /// Bytes of scaled photos that are kept for later rows.
    pub kept_bytes: usize,
    /// For a preview: the mosaic has at most this many pixels on its longer side, and is made of the small pictures in the
    /// catalogue; none for the mosaic itself.
    pub preview_px: Option<usize>,
}

/// A mosaic that was written.
#[derive(Debug, Clone, PartialEq)]
pub struct Mosaic {
    /// Tiles in a row, and rows, of a grid.
    pub tiles: (usize, usize),
    /// Tiles through which an edge runs, if these are compared in their own way.
    pub features: usize,
    /// Pixels of the mosaic.
    pub size: Size,
    /// The photo of each tile, by the upper borders of tiles and then the left ones.
    pub photos: Vec<PathBuf>,
    /// The rectangle of each tile, in pixels.
    pub places: Vec<Rect>,
    /// The choice; its numbers are of [`used`](Self::used).
    pub choice: Choice,
    /// Photos in the catalogue that fit the tiles.
    pub fitting: usize,
    /// Of these, how many are different to the eye.
    pub different: usize,
    /// Different photos in the mosaic.
    pub used: usize,
    /// The most uses of a photo.
    pub max_uses: usize,
    /// The least distance of two tiles with the same photo, in tiles; none if no photo is there twice.
    pub nearest_repeat: Option<f64>,
    /// Photos that are gone, changed or cannot be read, and what was done about it.
    pub warnings: Vec<String>,
}

/// Outputs of a mosaic.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Outputs<'a> {
    /// A picture: PNG, JPEG or TIFF.
    pub picture: Option<&'a Path>,
    /// A folder with a page that zooms from the mosaic into its photos.
    pub deep_zoom: Option<&'a Path>,
}

/// Makes a mosaic of `picture` from the photos of a catalogue, and writes it to `outputs`.
///
/// Photos that cannot be read any more are replaced by the next best. All memory in proportion to photos, tiles and pixels is
/// taken from the budget of `limits`, of which `picture` may hold a part; the mosaic has at most the pixels of `limits`.
///
/// # Errors
/// [`CatalogueError`]; the outputs are then as they were.
pub fn mosaic(
    catalogue: &Catalogue,
    picture: &AnyImage,
    outputs: &Outputs<'_>,
    params: &MosaicParams,
    limits: &Limits,
    progress: &Progress,
) -> Result<Mosaic, CatalogueError> {
    let layout = Layout::new(picture.size(), params)?;
    check_outputs(catalogue, &layout, outputs, limits, progress)?;
    let mut warnings = layout.warning(picture.size());
    let memory = &limits.memory;
    let (mut photos, _of_entries) = candidates(catalogue, params, memory, &mut warnings)?;
    let reducing = reserve(
        memory,
        layout.bytes_to_reduce(picture.size()),
        "the picture",
    )?;
    let (picture, frame) = layout.reduced(picture);
    drop(reducing);
    let small = 12 * picture.size().pixels() as u64;
    let _of_picture = reserve(memory, small, "the picture")?;
    let _of_choice = reserve_choice(&layout, params, photos.len(), memory)?;
    let plan = Plan::new(&layout, outputs, params, limits)?;
    let workers = Workers::new()?;
    let mut descriptors = describe_all(&photos, progress)?;
    if params.preview_px.is_none() {
        // the descriptors hold all that is needed of the small pictures
        for photo in &mut photos {
            photo.entry.thumbnail = None;
        }
    }
    let mut cut = None;
    loop {
        let groups = near_duplicates(&descriptors, NEAR_DUPLICATE, progress)?;
        let library = Photos::new(&descriptors, groups.clone(), &params.choose);
        // the tiles stay when photos are replaced
        let tiling = match &mut cut {
            Some(tiling) => &*tiling,
            none => none.insert(layout.tiles(&picture, frame, &library, params, progress)?),
        };
        let choice = choose(tiling, &library, &params.rules, &params.choose, progress)?;
        let places: Vec<(u32, Rect)> = tiling
            .tiles
            .iter()
            .zip(&choice.photos)
            .map(|(tile, &photo)| (photo, layout.place(tiling, tile)))
            .collect();
        let source = if params.preview_px.is_some() {
            Source::Thumbnails
        } else {
            Source::Photos(params.crop, &plan.photos)
        };
        let painter = Painter::new(
            &photos,
            &places,
            (layout.size, plan.strip_px),
            source,
            plan.room,
            &workers,
            progress,
        );
        let named: Vec<(&Path, Rect)> = places
            .iter()
            .map(|&(photo, place)| (photos[photo as usize].entry.path.as_path(), place))
            .collect();
        let size = (layout.size, plan.strip_px);
        let broken = match write(outputs, size, &named, painter, params.quality, progress) {
            Ok(kept) => {
                warnings.extend(kept.as_deref().map(kept_warning));
                return Ok(described(
                    &layout,
                    &photos,
                    &groups,
                    library.different(),
                    choice,
                    tiling,
                    &places,
                    warnings,
                ));
            }
            Err(Unpainted::Write(error)) => return Err(CatalogueError::Write(error)),
            Err(Unpainted::Cancelled(cancelled)) => return Err(cancelled.into()),
            Err(Unpainted::Photos(broken)) => broken,
        };
        warnings.extend(replaced(&broken, &photos));
        if let Some(tiling) = &mut cut {
            // photos get other numbers
            tiling.start.clear();
        }
        let gone: HashSet<u32> = broken.iter().map(|(photo, _)| *photo).collect();
        remove(&gone, &mut photos);
        remove(&gone, &mut descriptors);
        if photos.is_empty() {
            return Err(CatalogueError::Empty {
                path: catalogue.path().into(),
            });
        }
    }
}

/// Checks that the mosaic is not too large and that its outputs may be written.
fn check_outputs(
    catalogue: &Catalogue,
    layout: &Layout,
    outputs: &Outputs<'_>,
    limits: &Limits,
    progress: &Progress,
) -> Result<(), CatalogueError> {
    if layout.size.pixels() as u64 > limits.max_pixels {
        return Err(CatalogueError::TooManyPixels {
            width: layout.size.width(),
            height: layout.size.height(),
            limit: limits.max_pixels,
        });
    }
    if let Some(path) = outputs.picture {
        catalogue.check_output(path)?;
    }
    if let Some(folder) = outputs.deep_zoom {
        if let Some(path) = outputs.picture.filter(|path| leads_into(path, folder)) {
            return Err(protected(path, "it would lie in the folder of the page"));
        }
        catalogue.check_output_folder(folder)?;
        check_place(folder, layout.size, progress)?;
    }
    Ok(())
}

/// The descriptors of all photos.
fn describe_all(photos: &[Candidate], progress: &Progress) -> Result<Vec<Descriptor>, Cancelled> {
    let phase = progress.phase("photos", photos.len() as u64);
    photos
        .par_iter()
        .map(|photo| {
            progress.check()?;
            phase.advance(1);
            Ok(describe(photo))
        })
        .collect()
}

/// A warning about a folder that holds what was put into the old page.
fn kept_warning(folder: &Path) -> String {
    format!(
        "what was put into the old page while the new one was made is kept in {}",
        folder.display()
    )
}

/// Warnings about photos that could not be read.
fn replaced(broken: &[(u32, String)], photos: &[Candidate]) -> Vec<String> {
    broken
        .iter()
        .map(|(photo, reason)| {
            format!(
                "{}: {reason}; others took its place",
                photos[*photo as usize].entry.path.display()
            )
        })
        .collect()
}

/// Removes the members with these numbers.
fn remove<T>(gone: &HashSet<u32>, list: &mut Vec<T>) {
    let mut number = 0..;
    list.retain(|_| number.next().is_some_and(|number| !gone.contains(&number)));
}

/// Paints the mosaic into all outputs at once. Returns a folder that is kept, with what was put into a page that was replaced.
fn write(
    outputs: &Outputs<'_>,
    (size, strip_px): (Size, usize),
    photos: &[(&Path, Rect)],
    mut painter: Painter<'_>,
    quality: u8,
    progress: &Progress,
) -> Result<Option<PathBuf>, Unpainted> {
    let phase = progress.phase("write", size.height().div_ceil(strip_px) as u64);
    let mut zoom = match outputs.deep_zoom {
        Some(folder) => Some(DeepZoom::new(folder, size, quality)?),
        None => None,
    };
    let mut fill = |rows: Range<usize>, pixels: &mut [Srgb<u8>]| {
        painter.rows(&rows, pixels)?;
        if let Some(zoom) = &mut zoom {
            zoom.push(pixels, progress)?;
        }
        phase.advance(1);
        Ok::<(), Unpainted>(())
    };
    if let Some(path) = outputs.picture {
        write_rows(path, size, quality, strip_px, fill).map_err(|error| match error {
            RowsError::Write(error) => Unpainted::Write(error),
            RowsError::Fill(unpainted) => unpainted,
        })?;
    } else {
        let mut strip = vec![Srgb([0; 3]); strip_px * size.width()];
        for first in (0..size.height()).step_by(strip_px) {
            let rows = first..(first + strip_px).min(size.height());
            let pixels = rows.len() * size.width();
            fill(rows, &mut strip[..pixels])?;
        }
    }
    if let Some(zoom) = zoom {
        return Ok(zoom.finish(photos.iter().copied(), progress)?);
    }
    Ok(None)
}

/// The photos that fit the tiles.
fn candidates(
    catalogue: &Catalogue,
    params: &MosaicParams,
    memory: &MemoryBudget,
    warnings: &mut Vec<String>,
) -> Result<(Vec<Candidate>, Reservation), CatalogueError> {
    let Loaded { entries, memory } = there(catalogue, memory, warnings)?;
    if entries.is_empty() {
        return Err(CatalogueError::Empty {
            path: catalogue.path().into(),
        });
    }
    let total = entries.len();
    let aspect = params.tile.width() as f64 / params.tile.height() as f64;
    let fitting: Vec<Candidate> = entries
        .into_iter()
        .filter_map(|entry| {
            let size = Size::new(entry.width, entry.height).ok()?;
            let frame = params.crop.frame(size, aspect)?;
            Some(Candidate { entry, frame })
        })
        .collect();
    if fitting.is_empty() {
        return Err(CatalogueError::NoneFits {
            photos: total,
            width: params.tile.width(),
            height: params.tile.height(),
        });
    }
    Ok((fitting, memory))
}

/// The photos whose files are as they were when they were added.
fn there(
    catalogue: &Catalogue,
    memory: &MemoryBudget,
    warnings: &mut Vec<String>,
) -> Result<Loaded, CatalogueError> {
    let Loaded {
        mut entries,
        memory,
    } = catalogue.usable(memory)?;
    let flaw = |entry: &Entry| match entry.path.metadata() {
        Ok(metadata) if !metadata.is_file() => Some("is no longer a plain file"),
        Ok(metadata) if metadata.len() == entry.bytes && modified(&metadata) == entry.modified => {
            None
        }
        Ok(_) => Some("changed since it was added (add it again)"),
        Err(_) => Some("is no longer there"),
    };
    let flaws: Vec<Option<&str>> = entries.par_iter().map(flaw).collect();
    let mut flaws = flaws.into_iter();
    entries.retain(|entry| {
        let Some(reason) = flaws.next().flatten() else {
            return true;
        };
        warnings.push(format!(
            "{}: {reason}; others took its place",
            entry.path.display()
        ));
        false
    });
    Ok(Loaded { entries, memory })
}

/// Descriptor of the part of a photo that a tile shows.
fn describe(Candidate { entry, frame }: &Candidate) -> Descriptor {
    let Some(small) = &entry.thumbnail else {
        // only photos with a small picture come here
        return Descriptor {
            coefficients: Vec::new(),
            quarters: [[0.0; 3]; 4],
        };
    };
    let (x, y) = (
        small.width() as f64 / entry.width as f64,
        small.height() as f64 / entry.height as f64,
    );
    let frame = Frame {
        left: frame.left * x,
        top: frame.top * y,
        width: frame.width * x,
        height: frame.height * y,
    };
    Descriptor::of_srgb(small, frame, MAX_DEGREE)
}

#[expect(clippy::too_many_arguments, reason = "the parameters of a mosaic")]
fn described(
    layout: &Layout,
    photos: &[Candidate],
    groups: &[u32],
    different: usize,
    choice: Choice,
    tiling: &Tiling,
    places: &[(u32, Rect)],
    warnings: Vec<String>,
) -> Mosaic {
    let mut centers: HashMap<u32, Vec<[f64; 2]>> = HashMap::new();
    for (center, &photo) in tiling.centers().into_iter().zip(&choice.photos) {
        centers
            .entry(groups[photo as usize])
            .or_default()
            .push(center);
    }
    let nearest_sq = centers
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
        features: tiling.tiles.iter().filter(|tile| tile.feature).count(),
        size: layout.size,
        photos: choice
            .photos
            .iter()
            .map(|&photo| photos[photo as usize].entry.path.clone())
            .collect(),
        places: places.iter().map(|&(_, place)| place).collect(),
        fitting: photos.len(),
        different,
        used: centers.len(),
        max_uses: centers.values().map(Vec::len).max().unwrap_or(0),
        // thirds of tiles are not exact
        nearest_repeat: nearest_sq.map(|sq| (1e9 * sq.sqrt()).round() / 1e9),
        choice,
        warnings,
    }
}

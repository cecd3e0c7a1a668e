//! A mosaic from a picture and a catalogue.
//!
//! Looks come from the small pictures in the catalogue; only the photos that were chosen are decoded, at full size, and scaled
//! once. The mosaic is made one row of tiles at a time, or in lower strips if the memory does not suffice for that.

use crate::by_hand::{Ban, Pin, resolve};
use crate::catalogue::{Catalogue, leads_into, protected};
use crate::deep_zoom::{DeepZoom, check_place};
use crate::error::CatalogueError;
use crate::layout::Layout;
use crate::painter::{Candidate, Painter, Source, Unpainted};
use crate::photo_set::PhotoSet;
use crate::pieces::{ClusterTasks, PaintedStrips};
use crate::plan::{Plan, reserve, reserve_choice};
use crate::workers::Workers;
use ravec_media::{Limits, RowsError, write_rows};
use ravec_memory::{MemoryBudget, Reservation};
use ravec_mosaic::{
    Choice, ChooseError, ChooseParams, Crop, Frame, Photos, Rules, Tiling, choose_found,
};
use ravec_pieces::Cluster;
use ravec_progress::Progress;
use ravec_raster::{AnyImage, Image, Oklab, Rect, Size, Srgb};
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
    /// Tiles of the grid whose photo is set by hand; none in an adaptive mosaic.
    pub pins: Vec<Pin>,
    /// Photos that are not used, or not at a tile of the grid.
    pub bans: Vec<Ban>,
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
    /// Number of these that are different to the eye.
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
    to_files(catalogue, picture, outputs, params, limits, None, progress)
}

/// Makes a mosaic as [`mosaic()`] does, with the search for candidates, the photos and the rows by a cluster, whose workers run pieces by
/// [`MosaicWorker`](crate::MosaicWorker). The store must have no parts; the caller removes them.
///
/// # Errors
/// As [`mosaic()`]; [`CatalogueError::Piece`] if a piece fails, with its reason.
pub fn mosaic_in_pieces(
    catalogue: &Catalogue,
    picture: &AnyImage,
    outputs: &Outputs<'_>,
    params: &MosaicParams,
    limits: &Limits,
    cluster: &Cluster,
    progress: &Progress,
) -> Result<Mosaic, CatalogueError> {
    let cluster = Some(cluster);
    to_files(
        catalogue, picture, outputs, params, limits, cluster, progress,
    )
}

fn to_files(
    catalogue: &Catalogue,
    picture: &AnyImage,
    outputs: &Outputs<'_>,
    params: &MosaicParams,
    limits: &Limits,
    cluster: Option<&Cluster>,
    progress: &Progress,
) -> Result<Mosaic, CatalogueError> {
    let layout = Layout::new(picture.size(), params)?;
    check_outputs(catalogue, &layout, outputs, limits, progress)?;
    let mut sink = Sink::to_files(*outputs);
    make(
        catalogue, picture, &layout, &mut sink, params, limits, cluster, progress,
    )
}

/// Makes a mosaic as [`mosaic()`] does, and returns its pixels, which take memory from the budget of `limits` as well. A page may be
/// written besides.
///
/// # Errors
/// [`CatalogueError`]; the page is then as it was.
pub fn mosaic_in_memory(
    catalogue: &Catalogue,
    picture: &AnyImage,
    deep_zoom: Option<&Path>,
    params: &MosaicParams,
    limits: &Limits,
    progress: &Progress,
) -> Result<(Mosaic, Image<Srgb<u8>>), CatalogueError> {
    let layout = Layout::new(picture.size(), params)?;
    let mut sink = Sink::in_memory(layout.size, deep_zoom, &limits.memory)?;
    check_outputs(catalogue, &layout, &sink.outputs, limits, progress)?;
    let made = make(
        catalogue, picture, &layout, &mut sink, params, limits, None, progress,
    )?;
    Ok((made, sink.into_image(layout.size)))
}

/// Destination of the pixels of a mosaic.
pub(crate) struct Sink<'a> {
    pub outputs: Outputs<'a>,
    /// All pixels, if they are wanted in memory.
    pixels: Option<Vec<Srgb<u8>>>,
    _memory: Option<Reservation>,
}

impl<'a> Sink<'a> {
    fn to_files(outputs: Outputs<'a>) -> Self {
        Self {
            outputs,
            pixels: None,
            _memory: None,
        }
    }

    pub fn in_memory(
        size: Size,
        deep_zoom: Option<&'a Path>,
        memory: &MemoryBudget,
    ) -> Result<Self, CatalogueError> {
        let bytes = 3 * size.pixels() as u64;
        let reserved = reserve(memory, bytes, "the mosaic")?;
        Ok(Self {
            outputs: Outputs {
                picture: None,
                deep_zoom,
            },
            pixels: Some(Vec::with_capacity(size.pixels())),
            _memory: Some(reserved),
        })
    }

    pub fn into_image(self, size: Size) -> Image<Srgb<u8>> {
        let image = Image::from_vec(size.width(), self.pixels.unwrap_or_default());
        image.expect("every strip of the mosaic was painted")
    }
}

/// The picture that a mosaic is made of, with as many pixels as looks need.
pub(crate) struct Scene {
    pub picture: Image<Oklab>,
    /// The part of it that is shown.
    pub frame: Frame,
}

impl Scene {
    /// The reduced picture, and the memory that it takes.
    pub fn new(
        layout: &Layout,
        picture: &AnyImage,
        memory: &MemoryBudget,
    ) -> Result<(Self, Reservation), CatalogueError> {
        let reducing = reserve(
            memory,
            layout.bytes_to_reduce(picture.size()),
            "the picture",
        )?;
        let (picture, frame) = layout.reduced(picture);
        drop(reducing);
        let small = 12 * picture.size().pixels() as u64;
        let memory = reserve(memory, small, "the picture")?;
        Ok((Self { picture, frame }, memory))
    }
}

/// Makes a mosaic of `picture` from the photos of a catalogue, alone or with a cluster.
#[expect(clippy::too_many_arguments, reason = "all that a mosaic is made from")]
fn make(
    catalogue: &Catalogue,
    picture: &AnyImage,
    layout: &Layout,
    sink: &mut Sink<'_>,
    params: &MosaicParams,
    limits: &Limits,
    cluster: Option<&Cluster>,
    progress: &Progress,
) -> Result<Mosaic, CatalogueError> {
    let mut warnings = layout.warning(picture.size());
    let memory = &limits.memory;
    let mut set = PhotoSet::fitting(catalogue, params.tile, params.crop, memory)?;
    // what is set by hand is checked before any work is done for it
    resolve(&set, layout, params)?;
    warnings.extend_from_slice(set.warnings());
    let (scene, _of_picture) = Scene::new(layout, picture, memory)?;
    let _of_choice = reserve_choice(layout, params, set.len(), memory)?;
    let plan = Plan::new(layout, &sink.outputs, params, limits)?;
    let workers = Workers::new()?;
    set.describe(progress)?;
    if params.preview_px.is_none() {
        // the descriptors hold all that is needed of the small pictures
        for photo in &mut set.photos {
            photo.entry.thumbnail = None;
        }
    }
    let mut made = compose(
        &mut set, layout, &scene, sink, params, &plan, &workers, cluster, progress,
    )?;
    made.warnings.splice(0..0, warnings);
    Ok(made)
}

/// Chooses photos and paints the mosaic. Photos that cannot be read are taken out of the set.
#[expect(clippy::too_many_arguments, reason = "all that a mosaic is made from")]
pub(crate) fn compose(
    set: &mut PhotoSet,
    layout: &Layout,
    scene: &Scene,
    sink: &mut Sink<'_>,
    params: &MosaicParams,
    plan: &Plan,
    workers: &Workers,
    cluster: Option<&Cluster>,
    progress: &Progress,
) -> Result<Mosaic, CatalogueError> {
    let mut warnings = Vec::new();
    let mut tasks = cluster.map(|cluster| ClusterTasks::new(cluster, params.crop, &plan.photos));
    let mut cut = None;
    loop {
        let hand = resolve(set, layout, params)?;
        let mut library = Photos::new(&set.descriptors, set.groups.clone(), &params.choose);
        for photo in hand.banned {
            library.ban(photo);
        }
        // the tiles stay when photos are replaced
        let tiling = match &mut cut {
            Some(tiling) => &*tiling,
            none => none.insert(layout.tiles(
                &scene.picture,
                scene.frame,
                &library,
                params,
                progress,
            )?),
        };
        let (rules, choose) = (&params.rules, &params.choose);
        let by_hand = &hand.by_hand;
        let found = match &mut tasks {
            Some(work) if params.preview_px.is_none() => {
                let searches = library.searches(tiling, by_hand, choose)?;
                let found = work.search(&library, &searches, progress);
                Some(found.map_err(unpainted)?)
            }
            _ => None,
        };
        let choice = choose_found(tiling, &library, rules, by_hand, choose, found, progress)
            .map_err(|error| of_tile(error, tiling))?;
        let places = layout.places(tiling, &choice.photos);
        let size = (layout.size, plan.strip_px);
        let painted = |source| {
            let painter = Painter::new(
                &set.photos,
                &places,
                size,
                source,
                plan.room,
                workers,
                progress,
            );
            Ok(Strips::Here(painter))
        };
        let strips = match &mut tasks {
            _ if params.preview_px.is_some() => painted(Source::Thumbnails),
            None => painted(Source::Photos(params.crop, &plan.photos)),
            Some(work) => work
                .scale(&set.photos, &places, progress)
                .and_then(|()| Ok(Strips::Cluster(work.strips(&set.photos, &places, size)?))),
        };
        let written = strips.and_then(|strips| {
            let named = with_paths(&places, &set.photos);
            write(sink, size, &named, strips, params.quality, progress)
        });
        let broken = match written {
            Ok(kept) => {
                warnings.extend(kept.as_deref().map(kept_warning));
                return Ok(described(
                    layout,
                    &set.photos,
                    &set.groups,
                    library.different(),
                    choice,
                    tiling,
                    &places,
                    warnings,
                ));
            }
            Err(Unpainted::Photos(broken)) => broken,
            Err(reason) => return Err(unpainted(reason)),
        };
        warnings.extend(replaced(&broken, &set.photos));
        if let Some(tiling) = &mut cut {
            // photos get other numbers
            tiling.start.clear();
        }
        let gone: HashSet<u32> = broken.iter().map(|(photo, _)| *photo).collect();
        set.remove(&gone, progress)?;
    }
}

/// Photos in tiles by their paths.
fn with_paths<'a>(places: &[(u32, Rect)], photos: &'a [Candidate]) -> Vec<(&'a Path, Rect)> {
    let named = |&(photo, place): &(u32, Rect)| (&*photos[photo as usize].entry.path, place);
    places.iter().map(named).collect()
}

/// Strips of the mosaic, which come from the top.
enum Strips<'a, 't> {
    /// Painted by this process.
    Here(Painter<'a>),
    /// Painted by a cluster.
    Cluster(PaintedStrips<'a, 't>),
}

impl Strips<'_, '_> {
    fn rows(
        &mut self,
        rows: &Range<usize>,
        pixels: &mut [Srgb<u8>],
        progress: &Progress,
    ) -> Result<(), Unpainted> {
        match self {
            Self::Here(painter) => painter.rows(rows, pixels),
            Self::Cluster(strips) => strips.rows(rows, pixels, progress),
        }
    }
}

/// Errors for which no other photo helps.
fn unpainted(reason: Unpainted) -> CatalogueError {
    match reason {
        Unpainted::Write(error) => CatalogueError::Write(error),
        Unpainted::Cancelled(cancelled) => cancelled.into(),
        Unpainted::Piece(reason) => CatalogueError::Piece { reason },
        Unpainted::Photos(_) => unreachable!("photos are replaced"),
    }
}

/// Errors about a tile by its place in the grid.
fn of_tile(error: ChooseError, tiling: &Tiling) -> CatalogueError {
    match error {
        ChooseError::NothingLeft { tile } => CatalogueError::NothingLeft {
            col: tiling.tiles[tile].col,
            row: tiling.tiles[tile].row,
        },
        error => error.into(),
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

/// Paints the mosaic into all outputs at once. Returns a folder that is kept, with what was put into a page that was replaced.
fn write(
    sink: &mut Sink<'_>,
    (size, strip_px): (Size, usize),
    photos: &[(&Path, Rect)],
    mut strips: Strips<'_, '_>,
    quality: u8,
    progress: &Progress,
) -> Result<Option<PathBuf>, Unpainted> {
    let outputs = sink.outputs;
    if let Some(all) = &mut sink.pixels {
        // a second attempt begins anew
        all.clear();
    }
    let phase = progress.phase("write", size.height().div_ceil(strip_px) as u64);
    let mut zoom = match outputs.deep_zoom {
        Some(folder) => Some(DeepZoom::new(folder, size, quality)?),
        None => None,
    };
    let mut fill = |rows: Range<usize>, pixels: &mut [Srgb<u8>]| {
        strips.rows(&rows, pixels, progress)?;
        if let Some(zoom) = &mut zoom {
            zoom.push(pixels, progress)?;
        }
        if let Some(all) = &mut sink.pixels {
            all.extend_from_slice(pixels);
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

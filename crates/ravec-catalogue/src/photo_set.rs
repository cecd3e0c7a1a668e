//! The photos that fit the tiles of a mosaic, and how they look.

use crate::add::modified;
use crate::by_hand::resolve;
use crate::catalogue::{Catalogue, Entry, Loaded, place_of};
use crate::error::CatalogueError;
use crate::layout::Layout;
use crate::mosaic::{Mosaic, MosaicParams, Scene, Sink, compose};
use crate::painter::Candidate;
use crate::plan::{Plan, reserve_choice, reserve_photos};
use crate::workers::Workers;
use ravec_media::Limits;
use ravec_memory::{MemoryBudget, Reservation};
use ravec_mosaic::{
    Crop, Describer, Descriptor, Frame, MAX_DEGREE, NEAR_DUPLICATE, Photos, near_duplicates,
};
use ravec_progress::{Cancelled, Progress};
use ravec_raster::{AnyImage, Image, Rect, Size, Srgb};
use rayon::prelude::*;
use std::collections::HashSet;
use std::path::{Path, PathBuf};

/// The photos of a catalogue that fit the tiles of a mosaic, and how they look.
///
/// It is made once for all mosaics whose tiles have the same proportions: previews and candidates of tiles come from it without
/// the catalogue and without the files of photos.
#[derive(Debug)]
pub struct PhotoSet {
    pub(crate) photos: Vec<Candidate>,
    pub(crate) descriptors: Vec<Descriptor>,
    /// The group of near-duplicates of each photo.
    pub(crate) groups: Vec<u32>,
    /// Photos of the catalogue that cannot be used, and why.
    left_out: Vec<(PathBuf, &'static str)>,
    /// The catalogue.
    path: PathBuf,
    warnings: Vec<String>,
    reservations: Vec<Reservation>,
}

/// A photo for a tile.
#[derive(Debug, Clone, PartialEq)]
pub struct TileCandidate {
    /// The path of the photo in the catalogue.
    pub photo: PathBuf,
    /// The root of the mean squared difference between photo and tile in Oklab, weighted as the choice does; 0 is the same.
    pub distance: f64,
    /// The small picture in the catalogue: the whole photo, at most 36 pixels on a side.
    pub small: Image<Srgb<u8>>,
}

impl PhotoSet {
    /// Loads the photos that fit tiles of this size.
    ///
    /// # Errors
    /// As for [`Catalogue::entries`], [`CatalogueError::Empty`], [`CatalogueError::NoneFits`], [`CatalogueError::MosaicMemory`].
    pub fn load(
        catalogue: &Catalogue,
        tile: Size,
        crop: Crop,
        memory: &MemoryBudget,
        progress: &Progress,
    ) -> Result<Self, CatalogueError> {
        let mut set = Self::fitting(catalogue, tile, crop, memory)?;
        set.reservations
            .push(reserve_photos(set.photos.len(), memory)?);
        set.describe(progress)?;
        Ok(set)
    }

    /// The photos that fit, without their looks.
    pub(crate) fn fitting(
        catalogue: &Catalogue,
        tile: Size,
        crop: Crop,
        memory: &MemoryBudget,
    ) -> Result<Self, CatalogueError> {
        let mut left_out = Vec::new();
        let mut warnings = Vec::new();
        let Loaded { entries, memory } = there(catalogue, memory, &mut left_out, &mut warnings)?;
        if entries.is_empty() {
            return Err(CatalogueError::Empty {
                path: catalogue.path().into(),
            });
        }
        let total = entries.len();
        let aspect = tile.width() as f64 / tile.height() as f64;
        let mut photos = Vec::with_capacity(total);
        for entry in entries {
            let size = Size::new(entry.width, entry.height).ok();
            match size.and_then(|size| crop.frame(size, aspect)) {
                Some(frame) => photos.push(Candidate { entry, frame }),
                None => left_out.push((entry.path, "has other proportions than a tile")),
            }
        }
        if photos.is_empty() {
            return Err(CatalogueError::NoneFits {
                photos: total,
                width: tile.width(),
                height: tile.height(),
            });
        }
        Ok(Self {
            photos,
            descriptors: Vec::new(),
            groups: Vec::new(),
            left_out,
            path: catalogue.path().into(),
            warnings,
            reservations: vec![memory],
        })
    }

    /// Number of photos that fit.
    pub fn len(&self) -> usize {
        self.photos.len()
    }

    /// Returns `false`: there is no set without photos.
    pub fn is_empty(&self) -> bool {
        self.photos.is_empty()
    }

    /// Photos that are gone or changed, in words.
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// A preview of a mosaic, without files: of `params`, `preview_px` must be set.
    ///
    /// # Errors
    /// [`CatalogueError`].
    ///
    /// # Panics
    /// If `preview_px` is none.
    pub fn preview(
        &mut self,
        picture: &AnyImage,
        params: &MosaicParams,
        limits: &Limits,
        progress: &Progress,
    ) -> Result<(Mosaic, Image<Srgb<u8>>), CatalogueError> {
        assert!(params.preview_px.is_some(), "a preview has a size");
        let layout = Layout::new(picture.size(), params)?;
        let memory = &limits.memory;
        let warnings = layout.warning(picture.size());
        let (scene, _of_picture) = Scene::new(&layout, picture, memory)?;
        let _of_choice = reserve_choice(&layout, params, 0, memory)?;
        let mut sink = Sink::in_memory(layout.size, None, memory)?;
        let plan = Plan::new(&layout, &sink.outputs, params, limits)?;
        let workers = Workers::new()?;
        let mut made = compose(
            self, &layout, &scene, &mut sink, params, &plan, &workers, None, progress,
        )?;
        let warnings = warnings.into_iter().chain(self.warnings.iter().cloned());
        made.warnings.splice(0..0, warnings);
        Ok((made, sink.into_image(layout.size)))
    }

    /// The `count` photos nearest to the tile at `place`, a rectangle of pixels in the mosaic as in [`Mosaic::places`], the nearest
    /// first. Of near-duplicates only the nearest is there, and none that is banned there.
    ///
    /// # Errors
    /// [`CatalogueError::NoSuchPlace`] if no tile can lie there, and those of pins and bans.
    pub fn candidates(
        &self,
        picture: &AnyImage,
        params: &MosaicParams,
        place: Rect,
        count: usize,
        memory: &MemoryBudget,
        progress: &Progress,
    ) -> Result<Vec<TileCandidate>, CatalogueError> {
        let layout = Layout::new(picture.size(), params)?;
        let (scene, _of_picture) = Scene::new(&layout, picture, memory)?;
        let tile = layout
            .tile_at(&scene.picture, scene.frame, place, params, progress)?
            .ok_or(CatalogueError::NoSuchPlace { place })?;
        let hand = resolve(self, &layout, params)?;
        let mut photos = Photos::new(&self.descriptors, self.groups.clone(), &params.choose);
        for photo in hand.banned {
            photos.ban(photo);
        }
        let group = |photo: u32| self.groups[photo as usize];
        let number = tile.row * layout.columns + tile.col;
        let here = hand.by_hand.bans.iter().filter(|ban| ban.tile == number);
        let banned: HashSet<u32> = here.map(|ban| group(ban.photo)).collect();
        let mut near = photos.nearest(&tile, count + banned.len());
        near.retain(|near| !banned.contains(&group(near.photo)));
        near.truncate(count);
        let found = near.iter().filter_map(|near| {
            let entry = &self.photos[near.photo as usize].entry;
            Some(TileCandidate {
                photo: entry.path.clone(),
                distance: f64::from(near.distance_sq).sqrt(),
                small: entry.thumbnail.clone()?,
            })
        });
        Ok(found.collect())
    }

    /// The small picture in the catalogue of a photo that fits.
    pub fn small(&self, photo: &Path) -> Option<&Image<Srgb<u8>>> {
        let mut photos = self.photos.iter();
        let found = photos.find(|found| found.entry.path == photo)?;
        found.entry.thumbnail.as_ref()
    }

    /// The number of a photo, or why it cannot be used.
    ///
    /// # Errors
    /// [`CatalogueError::NoSuchPhoto`].
    pub(crate) fn find(&self, path: &Path) -> Result<Result<u32, &'static str>, CatalogueError> {
        let look = |path: &Path| {
            let number = self
                .photos
                .iter()
                .position(|photo| photo.entry.path == path);
            if let Some(number) = number {
                return Some(Ok(number as u32));
            }
            let mut left_out = self.left_out.iter();
            left_out
                .find(|(other, _)| other == path)
                .map(|(_, reason)| Err(*reason))
        };
        look(path)
            .or_else(|| look(&place_of(path)))
            .ok_or_else(|| CatalogueError::NoSuchPhoto {
                catalogue: self.path.clone(),
                photo: path.into(),
            })
    }

    /// Looks at all photos.
    pub(crate) fn describe(&mut self, progress: &Progress) -> Result<(), Cancelled> {
        let phase = progress.phase("photos", self.photos.len() as u64);
        self.descriptors = self
            .photos
            .par_iter()
            .map_init(Describer::default, |describer, photo| {
                progress.check()?;
                phase.advance(1);
                Ok(describe(photo, describer))
            })
            .collect::<Result<_, Cancelled>>()?;
        self.groups = near_duplicates(&self.descriptors, NEAR_DUPLICATE, progress)?;
        Ok(())
    }

    /// Takes out photos that cannot be read, by their numbers.
    ///
    /// # Errors
    /// [`CatalogueError::Empty`] if none is left, [`CatalogueError::Cancelled`].
    pub(crate) fn remove(
        &mut self,
        gone: &HashSet<u32>,
        progress: &Progress,
    ) -> Result<(), CatalogueError> {
        for &photo in gone {
            let path = self.photos[photo as usize].entry.path.clone();
            self.left_out.push((path, "cannot be read"));
        }
        remove(gone, &mut self.photos);
        remove(gone, &mut self.descriptors);
        if self.photos.is_empty() {
            return Err(CatalogueError::Empty {
                path: self.path.clone(),
            });
        }
        self.groups = near_duplicates(&self.descriptors, NEAR_DUPLICATE, progress)?;
        Ok(())
    }
}

/// Removes the members with these numbers.
fn remove<T>(gone: &HashSet<u32>, list: &mut Vec<T>) {
    let mut number = 0..;
    list.retain(|_| number.next().is_some_and(|number| !gone.contains(&number)));
}

/// The photos whose files are as they were when they were added.
fn there(
    catalogue: &Catalogue,
    memory: &MemoryBudget,
    left_out: &mut Vec<(PathBuf, &'static str)>,
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
        left_out.push((entry.path.clone(), reason));
        false
    });
    Ok(Loaded { entries, memory })
}

/// Descriptor of the part of a photo that a tile shows.
fn describe(Candidate { entry, frame }: &Candidate, describer: &mut Describer) -> Descriptor {
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
    describer.describe(small, frame, MAX_DEGREE)
}

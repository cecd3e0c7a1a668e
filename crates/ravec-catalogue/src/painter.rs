//! The mosaic, strip by strip.
//!
//! Photos are decoded when the first strip wants them, scaled, and kept as long as a tile goes on in the next strip or they are
//! wanted again, if there is room; else they are decoded again. Each photo waits for its share of the memory (see the module
//! `workers`). No order of the photos and no lack of room changes a pixel.

use crate::add::HEADER_BYTES;
use crate::catalogue::Entry;
use crate::thumbnail::opaque;
use crate::workers::Workers;
use ravec_media::{DecodeError, Limits, Probe, WriteError, memory_to_decode, probe_data, read};
use ravec_memory::{MemoryBudget, Reservation, ReserveError};
use ravec_mosaic::{Crop, Frame, scaled_photo};
use ravec_progress::{Cancelled, Progress};
use ravec_raster::{Image, Rect, ResizeFilter, Size, Srgb, resize};
use std::collections::HashMap;
use std::fs::File;
use std::io::{BufReader, Seek as _};
use std::ops::Range;
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Why rows could not be painted.
pub(crate) enum Unpainted {
    Cancelled(Cancelled),
    /// Photos that cannot be read, and why.
    Photos(Vec<(u32, String)>),
    /// A part of the output that cannot be written.
    Write(WriteError),
    /// A piece that another process could not run, and why.
    Piece(String),
}

impl From<Cancelled> for Unpainted {
    fn from(cancelled: Cancelled) -> Self {
        Self::Cancelled(cancelled)
    }
}

/// A photo that can be chosen, and the part of it that tiles show.
#[derive(Debug, Clone)]
pub(crate) struct Candidate {
    pub entry: Entry,
    pub frame: Frame,
}

/// Source of pixels.
#[derive(Clone, Copy)]
pub(crate) enum Source<'a> {
    /// The photos, scaled once.
    Photos(Crop, &'a Limits),
    /// The small pictures of the catalogue.
    Thumbnails,
}

/// A photo as it stands in a tile, with the memory that it takes, or why there is none.
pub(crate) type Scaled = Result<(Arc<Image<Srgb<u8>>>, Option<Reservation>), String>;

/// A photo and the size in which it is wanted.
type Key = (u32, Size);

pub(crate) struct Painter<'a> {
    photos: &'a [Candidate],
    source: Source<'a>,
    progress: &'a Progress,
    workers: &'a Workers,
    width: usize,
    strip_px: usize,
    /// Photos and where they are, for each strip.
    strips: Vec<Vec<(Key, Rect)>>,
    /// Scaled photos that are wanted again.
    kept: Kept,
    /// Strips that are still to come, for each photo and tile.
    left: HashMap<Key, usize>,
}

/// Scaled photos that later strips want, as far as there is room.
struct Kept {
    photos: HashMap<Key, Arc<Image<Srgb<u8>>>>,
    bytes: usize,
    room: Room,
}

/// Bytes of scaled photos that are kept.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Room {
    /// In all.
    pub all: usize,
    /// Up to which also those are kept that no tile of the next strip goes on with.
    pub for_later: usize,
}

impl Kept {
    fn put(&mut self, key: Key, image: &Arc<Image<Srgb<u8>>>, goes_on: bool) {
        let bytes = bytes_of(key.1);
        let room = if goes_on {
            self.room.all
        } else {
            self.room.for_later
        };
        if self.bytes + bytes <= room && !self.photos.contains_key(&key) {
            self.photos.insert(key, Arc::clone(image));
            self.bytes += bytes;
        }
    }

    fn remove(&mut self, key: &Key) {
        if self.photos.remove(key).is_some() {
            self.bytes -= bytes_of(key.1);
        }
    }
}

fn bytes_of(size: Size) -> usize {
    3 * size.pixels()
}

impl<'a> Painter<'a> {
    /// A painter of a mosaic of `size`, with a photo in each of `places`.
    pub fn new(
        photos: &'a [Candidate],
        places: &[(u32, Rect)],
        (size, strip_px): (Size, usize),
        source: Source<'a>,
        room: Room,
        workers: &'a Workers,
        progress: &'a Progress,
    ) -> Self {
        let mut strips = vec![Vec::new(); size.height().div_ceil(strip_px)];
        let mut left: HashMap<Key, usize> = HashMap::new();
        for &(photo, place) in places {
            let Some(size) = place.size() else { continue };
            let key = (photo, size);
            let touched = place.row / strip_px..place.bottom().div_ceil(strip_px);
            *left.entry(key).or_default() += touched.len();
            for strip in &mut strips[touched] {
                strip.push((key, place));
            }
        }
        let kept = Kept {
            photos: HashMap::new(),
            bytes: 0,
            room,
        };
        Self {
            photos,
            source,
            progress,
            workers,
            width: size.width(),
            strip_px,
            strips,
            kept,
            left,
        }
    }

    /// Paints a strip: the rows from a multiple of the strip's height up to the next one, or the last row.
    pub fn rows(&mut self, rows: &Range<usize>, pixels: &mut [Srgb<u8>]) -> Result<(), Unpainted> {
        let mut wanted = std::mem::take(&mut self.strips[rows.start / self.strip_px]);
        let order = |&(photo, size): &Key| (photo, size.width(), size.height());
        wanted.sort_by_key(|(key, _)| order(key));
        let of_key: Vec<&[(Key, Rect)]> = wanted.chunk_by(|a, b| a.0 == b.0).collect();
        for places in &of_key {
            if let Some(left) = self.left.get_mut(&places[0].0) {
                *left -= places.len();
            }
        }
        let shared = Mutex::new((pixels, &mut self.kept));
        let (left, width) = (&self.left, self.width);
        let (photos, source, progress) = (self.photos, self.source, self.progress);
        // of each photo, all tiles at once, so that none but those that are kept need stay in memory
        let results = self
            .workers
            .map(&of_key, |places| -> Result<_, Unpainted> {
                let key = places[0].0;
                progress.check()?;
                let there = lock(&shared).1.photos.get(&key).cloned();
                let scaled = match there {
                    Some(image) => Ok((image, None)),
                    None => scaled(&photos[key.0 as usize], key.1, source, progress)?,
                };
                let (image, share) = match scaled {
                    Ok(scaled) => scaled,
                    Err(reason) => return Ok(Some((key.0, reason))),
                };
                let mut shared = lock(&shared);
                let (pixels, kept) = &mut *shared;
                for (_, place) in *places {
                    for row in rows.start.max(place.row)..rows.end.min(place.bottom()) {
                        let line = &mut pixels[(row - rows.start) * width..][..width];
                        line[place.col..place.right()].copy_from_slice(image.row(row - place.row));
                    }
                }
                if left.get(&key).is_some_and(|&left| left > 0) {
                    let goes_on = places.iter().any(|(_, place)| place.bottom() > rows.end);
                    kept.put(key, &image, goes_on);
                } else {
                    kept.remove(&key);
                }
                drop(share);
                Ok(None)
            })?;
        let mut broken: Vec<(u32, String)> = results.into_iter().flatten().collect();
        if broken.is_empty() {
            return Ok(());
        }
        broken.dedup_by_key(|(photo, _)| *photo);
        Err(Unpainted::Photos(broken))
    }
}

fn lock<T>(shared: &Mutex<T>) -> MutexGuard<'_, T> {
    // a panic ends the work on all threads
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A photo as it stands in a tile, with the memory that it takes.
fn scaled(
    candidate: &Candidate,
    size: Size,
    source: Source<'_>,
    progress: &Progress,
) -> Result<Scaled, Unpainted> {
    match source {
        Source::Photos(crop, limits) => {
            let path = &candidate.entry.path;
            Ok(scaled_from_file(path, size, crop, limits, progress)?)
        }
        Source::Thumbnails => Ok(small_part(candidate, size)
            .map(|image| (Arc::new(image), None))
            .ok_or_else(|| "has no small picture in the catalogue".to_owned())),
    }
}

/// A photo of a file, scaled, once the memory for it is free. The need is known only after reading the header, for which
/// memory is taken, and given back, before: a photo that keeps what it has and waits for more could wait forever.
pub(crate) fn scaled_from_file(
    path: &Path,
    size: Size,
    crop: Crop,
    limits: &Limits,
    progress: &Progress,
) -> Result<Scaled, Cancelled> {
    let budget = &limits.memory;
    let within = |share: Reservation| Limits {
        memory: share.into_budget(),
        ..limits.clone()
    };
    let probed = || -> Result<(u64, Probe), DecodeError> {
        let file = File::open(path)?;
        let header = file.metadata()?.len().saturating_add(HEADER_BYTES);
        let share = match budget.reserve_when_free(header.min(budget.limit()), progress) {
            Ok(share) => share,
            Err(_) => budget.reserve_nothing(),
        };
        let limits = within(share);
        let mut file = BufReader::new(file);
        let probe = probe_data(&mut file, &limits)?;
        file.rewind()?;
        Ok((memory_to_decode(&mut file, None, &limits)?, probe))
    };
    let probed = probed();
    progress.check()?;
    let (decoding, probe) = match probed {
        Ok(probed) => probed,
        Err(error) => return Ok(Err(error.to_string())),
    };
    let needed = need(decoding, &probe, size);
    let share = match budget.reserve_when_free(needed, progress) {
        Ok(share) => share,
        Err(ReserveError::Cancelled(cancelled)) => return Err(cancelled),
        Err(ReserveError::OverBudget(over)) => {
            let error = DecodeError::TooManyBytes {
                bytes: Some(needed),
                others: 0,
                limit: over.limit,
            };
            return Ok(Err(error.to_string()));
        }
    };
    let limits = Limits {
        memory: MemoryBudget::new(decoding),
        ..limits.clone()
    };
    let photo = match read(path, &limits) {
        Ok(picture) => opaque(picture.image),
        Err(error) => return Ok(Err(error.cause.to_string())),
    };
    let image = scaled_photo(&photo, size, crop)
        .ok_or_else(|| "has other proportions than when it was added".to_owned());
    Ok(image.map(|image| (Arc::new(image), Some(share))))
}

/// Bytes at the peak of decoding a photo and scaling it to `tile`.
fn need(decoding: u64, probe: &Probe, tile: Size) -> u64 {
    /// Rows of the result that are resampled at once, with their surroundings in floats.
    const ROWS_AT_ONCE: u64 = 32;
    /// Pixels of the photo that are floats at once, at least 8 rows.
    const PIXELS_AT_ONCE: u64 = 1 << 14;
    let (width, height) = (probe.size.width() as u64, probe.size.height() as u64);
    let pixels = width.saturating_mul(height);
    let channels = 3 + u64::from(probe.alpha);
    // pixels of other color spaces are held as floats
    let bytes = if probe.profile.is_some() {
        4
    } else {
        probe.sample.bytes() as u64
    };
    let picture = decoding.min(pixels.saturating_mul(channels * bytes));
    // the photo in 8 bits, and the part of it that is shown
    let converting = picture.saturating_add(pixels.saturating_mul(3));
    let (columns, rows) = (tile.width() as u64, tile.height() as u64);
    let scale = height.div_ceil(rows);
    let source_rows = height.min((ROWS_AT_ONCE + 4).saturating_mul(scale) + 8);
    let block = 12 * PIXELS_AT_ONCE.max(8 * width);
    let strip = (12 * columns).saturating_mul(source_rows) + block + 12 * ROWS_AT_ONCE * columns;
    let scaling = pixels
        .saturating_mul(6)
        .saturating_add(strip)
        .saturating_add(3 * columns * rows);
    decoding.max(converting).max(scaling)
}

/// The part of a photo that tiles show, from its small picture.
fn small_part(candidate: &Candidate, size: Size) -> Option<Image<Srgb<u8>>> {
    let Candidate { entry, frame } = candidate;
    let small = entry.thumbnail.as_ref()?;
    let x = small.width() as f64 / entry.width as f64;
    let y = small.height() as f64 / entry.height as f64;
    let side = |length: f64, most: usize| (length.round() as usize).clamp(1, most);
    let (width, height) = (
        side(frame.width * x, small.width()),
        side(frame.height * y, small.height()),
    );
    let left = ((frame.left * x) as usize).min(small.width() - width);
    let top = ((frame.top * y) as usize).min(small.height() - height);
    let part = small.crop(left, top, Size::new(width, height).ok()?).ok()?;
    let filter = if size.width() < width && size.height() < height {
        ResizeFilter::Box
    } else {
        ResizeFilter::CatmullRom
    };
    Some(resize(&part, size, filter))
}

//! The mosaic, strip by strip.
//!
//! Photos are decoded when the first strip wants them, scaled, and kept as long as a tile goes on in the next strip; beyond
//! that, as long as they are wanted again and there is room.

use crate::add::opaque;
use crate::catalogue::Entry;
use ravec_media::{Limits, WriteError, read};
use ravec_mosaic::{Crop, Frame, scaled_photo};
use ravec_progress::{Cancelled, Progress};
use ravec_raster::{Image, Rect, ResizeFilter, Size, Srgb, resize};
use rayon::prelude::*;
use std::collections::HashMap;
use std::ops::Range;
use std::sync::Arc;

/// Why rows could not be painted.
pub(crate) enum Unpainted {
    Cancelled(Cancelled),
    /// Photos that cannot be read, and why.
    Photos(Vec<(u32, String)>),
    /// A part of the output that cannot be written.
    Write(WriteError),
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

/// Where pixels come from.
#[derive(Clone, Copy)]
pub(crate) enum Source<'a> {
    /// The photos, scaled once.
    Photos(Crop, &'a Limits),
    /// The small pictures of the catalogue.
    Thumbnails,
}

/// A photo as it stands in a tile, or why there is none.
type Scaled = Result<Image<Srgb<u8>>, String>;

/// A photo and the size in which it is wanted.
type Key = (u32, Size);

pub(crate) struct Painter<'a> {
    photos: &'a [Candidate],
    source: Source<'a>,
    progress: &'a Progress,
    width: usize,
    strip_px: usize,
    /// Photos and where they are, for each strip.
    strips: Vec<Vec<(Key, Rect)>>,
    /// Scaled photos that are wanted again.
    kept: HashMap<Key, Arc<Image<Srgb<u8>>>>,
    kept_bytes: usize,
    most_bytes: usize,
    /// Strips that are still to come, for each photo and tile.
    left: HashMap<Key, usize>,
}

impl<'a> Painter<'a> {
    /// A painter of a mosaic of `size`, with a photo in each of `places`, that keeps at most about `most_bytes`.
    pub fn new(
        photos: &'a [Candidate],
        places: &[(u32, Rect)],
        size: Size,
        strip_px: usize,
        source: Source<'a>,
        most_bytes: usize,
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
        Self {
            photos,
            source,
            progress,
            width: size.width(),
            strip_px,
            strips,
            kept: HashMap::new(),
            kept_bytes: 0,
            most_bytes,
            left,
        }
    }

    /// Paints a strip: the rows from a multiple of the strip's height up to the next one, or the last row.
    pub fn rows(&mut self, rows: &Range<usize>, pixels: &mut [Srgb<u8>]) -> Result<(), Unpainted> {
        let wanted = std::mem::take(&mut self.strips[rows.start / self.strip_px]);
        let mut missing: Vec<Key> = wanted.iter().map(|&(key, _)| key).collect();
        missing.retain(|key| !self.kept.contains_key(key));
        missing.sort_unstable_by_key(|&(photo, size)| (photo, size.width(), size.height()));
        missing.dedup();
        let scaled: Vec<(Key, Scaled)> = missing
            .par_iter()
            .map(|&key| {
                self.progress.check()?;
                Ok((key, self.scaled(key)))
            })
            .collect::<Result<_, Cancelled>>()?;
        let mut here = HashMap::new();
        let mut broken = Vec::new();
        for (key, result) in scaled {
            match result {
                Ok(image) => drop(here.insert(key, Arc::new(image))),
                Err(reason) => broken.push((key.0, reason)),
            }
        }
        if !broken.is_empty() {
            broken.dedup_by_key(|(photo, _)| *photo);
            return Err(Unpainted::Photos(broken));
        }
        for (key, place) in &wanted {
            let Some(image) = here.get(key).or_else(|| self.kept.get(key)) else {
                continue;
            };
            for row in rows.start.max(place.row)..rows.end.min(place.bottom()) {
                let line = &mut pixels[(row - rows.start) * self.width..][..self.width];
                line[place.col..place.right()].copy_from_slice(image.row(row - place.row));
            }
        }
        for (key, _) in &wanted {
            if let Some(left) = self.left.get_mut(key) {
                *left -= 1;
            }
        }
        for (key, place) in wanted {
            let bytes = 3 * key.1.pixels();
            if self.left.get(&key).is_none_or(|&left| left == 0) {
                if self.kept.remove(&key).is_some() {
                    self.kept_bytes -= bytes;
                }
                continue;
            }
            let goes_on = place.bottom() > rows.end;
            if (goes_on || self.kept_bytes + bytes <= self.most_bytes)
                && let Some(image) = here.get(&key)
                && self.kept.insert(key, Arc::clone(image)).is_none()
            {
                self.kept_bytes += bytes;
            }
        }
        Ok(())
    }

    fn scaled(&self, (photo, size): Key) -> Scaled {
        let candidate = &self.photos[photo as usize];
        match self.source {
            Source::Photos(crop, limits) => {
                let picture =
                    read(&candidate.entry.path, limits).map_err(|error| error.cause.to_string())?;
                scaled_photo(&opaque(&picture), size, crop)
                    .ok_or_else(|| "has other proportions than when it was added".to_owned())
            }
            Source::Thumbnails => small_part(candidate, size)
                .ok_or_else(|| "has no small picture in the catalogue".to_owned()),
        }
    }
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

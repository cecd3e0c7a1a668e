//! Photos that other processes scale.
//!
//! Most of the time of a mosaic goes into decoding the photos that were chosen. With a team, its workers decode and scale them, some
//! at a time, into parts; the mosaic is then painted from the parts, strip by strip. Photos are read by their paths, which all
//! machines must see.
//!
//! Guarantees: the same mosaic as without a team, as far as each worker has the memory for each photo: one that takes more than a
//! worker has is replaced by another, as one that takes more than the budget is without a team. A part that is lost is made again.

use crate::error::CatalogueError;
use crate::painter::{Candidate, Unpainted, scaled_from_file};
use crate::workers::Workers;
use ravec_media::Limits;
use ravec_memory::MemoryBudget;
use ravec_mosaic::Crop;
use ravec_pieces::{PartStore, Team, from_bytes, to_bytes};
use ravec_progress::{Cancelled, Progress};
use ravec_raster::{Image, Rect, Size, Srgb};
use serde::{Deserialize, Serialize};
use std::collections::{HashMap, HashSet};
use std::io::{Error, ErrorKind};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

/// Photos in a piece.
const PHOTOS_IN_PIECE: usize = 64;

/// Attempts to read a part before the store counts as unreliable.
const MAX_ATTEMPTS: usize = 4;

/// A photo and the size in which it is wanted.
type Wanted = (PathBuf, [u32; 2]);

/// Photos to scale.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Piece {
    /// Number of the part that it writes.
    part: u64,
    crop: Crop,
    max_pixels: u64,
    photos: Vec<Wanted>,
}

/// For each photo, why it cannot be read, if so.
type Answer = Vec<Option<String>>;

/// Place of a scaled photo.
#[derive(Debug, Clone, Copy)]
struct Place {
    part: u64,
    at: u64,
}

fn part_name(part: u64) -> String {
    format!("photos-{part}")
}

fn bytes_of([width, height]: [u32; 2]) -> u64 {
    3 * u64::from(width) * u64::from(height)
}

/// Photos that a team has scaled, from one choice of photos to the next.
pub(crate) struct ScaledPhotos<'t> {
    team: &'t Team,
    crop: Crop,
    max_pixels: u64,
    places: HashMap<Wanted, Result<Place, String>>,
    pieces: Vec<Piece>,
    /// Parts are made again one at a time.
    restoring: Mutex<()>,
}

impl<'t> ScaledPhotos<'t> {
    pub fn new(team: &'t Team, crop: Crop, limits: &Limits) -> Self {
        Self {
            team,
            crop,
            max_pixels: limits.max_pixels,
            places: HashMap::new(),
            pieces: Vec::new(),
            restoring: Mutex::default(),
        }
    }

    /// Has all photos of a mosaic scaled that are not there yet.
    pub fn scale(
        &mut self,
        photos: &[Candidate],
        places: &[(u32, Rect)],
        progress: &Progress,
    ) -> Result<(), Unpainted> {
        let mut known = HashSet::new();
        let mut wanted: Vec<Wanted> = Vec::new();
        for &(photo, place) in places {
            let size = [place.width as u32, place.height as u32];
            if known.insert((photo, size)) {
                let key = (photos[photo as usize].entry.path.clone(), size);
                if !self.places.contains_key(&key) {
                    wanted.push(key);
                }
            }
        }
        let first = self.pieces.len();
        let parts = (first as u64..).zip(wanted.chunks(PHOTOS_IN_PIECE));
        let pieces: Vec<Piece> = parts
            .map(|(part, photos)| Piece {
                part,
                crop: self.crop,
                max_pixels: self.max_pixels,
                photos: photos.to_vec(),
            })
            .collect();
        self.pieces.extend(pieces);
        let phase = progress.phase("photos", (self.pieces.len() - first) as u64);
        let mut answers = self.answers(&self.pieces[first..], progress, || phase.advance(1))?;
        for piece in &self.pieces[first..] {
            let answer = answers.remove(&piece.part).unwrap_or_default();
            let mut at = 0;
            for (key, reason) in piece.photos.iter().zip(answer) {
                let place = match reason {
                    Some(reason) => Err(reason),
                    None => Ok(Place {
                        part: piece.part,
                        at,
                    }),
                };
                if place.is_ok() {
                    at += bytes_of(key.1);
                }
                self.places.insert(key.clone(), place);
            }
        }
        Ok(())
    }

    /// Has pieces run; returns their answers by part.
    fn answers(
        &self,
        pieces: &[Piece],
        progress: &Progress,
        done: impl Fn(),
    ) -> Result<HashMap<u64, Answer>, Unpainted> {
        let mut crew = self.team.crew();
        for piece in pieces {
            let bytes = to_bytes(piece).map_err(failed)?;
            crew.submit(piece.part, bytes).map_err(failed)?;
        }
        let mut answers: HashMap<u64, Answer> = HashMap::new();
        while answers.len() < pieces.len() {
            let (part, answer) = crew.next(progress).map_err(failed)?;
            answers.insert(part, from_bytes(&answer).map_err(failed)?);
            done();
        }
        Ok(answers)
    }

    /// A photo as it stands in a tile, or why there is none.
    pub fn get(
        &self,
        path: &Path,
        size: Size,
        progress: &Progress,
    ) -> Result<Result<Image<Srgb<u8>>, String>, Unpainted> {
        let sides = [size.width() as u32, size.height() as u32];
        let place = match self.places.get(&(path.to_owned(), sides)) {
            Some(Ok(place)) => *place,
            Some(Err(reason)) => return Ok(Err(reason.clone())),
            None => return Ok(Err("was not scaled".to_owned())),
        };
        let store = self.team.store();
        let name = part_name(place.part);
        let range = place.at..place.at + bytes_of(sides);
        for attempt in 1.. {
            match store.read(&name, range.clone()) {
                Ok(bytes) => {
                    let pixels = bytes.chunks_exact(3).map(|p| Srgb([p[0], p[1], p[2]]));
                    let image = Image::from_vec(size.width(), pixels.collect());
                    return Ok(Ok(image.expect("the range has the bytes of the photo")));
                }
                Err(error) if is_lost(&error) && attempt < MAX_ATTEMPTS => {
                    let restoring = self.restoring.lock();
                    let _one = restoring.unwrap_or_else(PoisonError::into_inner);
                    // another photo of the part may have restored it
                    if store.read(&name, range.clone()).is_err() {
                        let piece = &self.pieces[place.part as usize];
                        self.answers(std::slice::from_ref(piece), progress, || {})?;
                    }
                }
                Err(error) => return Err(failed(error)),
            }
        }
        unreachable!("attempts end")
    }
}

fn is_lost(error: &Error) -> bool {
    matches!(error.kind(), ErrorKind::NotFound | ErrorKind::UnexpectedEof)
}

#[expect(
    clippy::needless_pass_by_value,
    reason = "taken as it comes from a result"
)]
fn failed(error: Error) -> Unpainted {
    if error.kind() == ErrorKind::Interrupted {
        return Cancelled.into();
    }
    Unpainted::Piece(error.to_string())
}

/// Scales photos for a mosaic that another process makes with [`mosaic_in_pieces`](crate::mosaic_in_pieces).
pub struct PhotoWorker {
    parts: Arc<dyn PartStore>,
    memory: MemoryBudget,
}

impl std::fmt::Debug for PhotoWorker {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("PhotoWorker").finish_non_exhaustive()
    }
}

impl PhotoWorker {
    /// A worker that takes memory for photos from a budget.
    pub fn new(parts: Arc<dyn PartStore>, memory: MemoryBudget) -> Self {
        Self { parts, memory }
    }

    /// Runs a piece in the current pool of threads; returns the answer for the coordinator.
    ///
    /// # Errors
    /// [`CatalogueError::Piece`] if the store fails, or the bytes are no piece; [`CatalogueError::Cancelled`].
    pub fn run(&self, piece: &[u8], progress: &Progress) -> Result<Vec<u8>, CatalogueError> {
        let broken = |error: Error| CatalogueError::Piece {
            reason: error.to_string(),
        };
        let piece: Piece = from_bytes(piece).map_err(broken)?;
        let limits = Limits {
            max_pixels: piece.max_pixels,
            memory: self.memory.clone(),
        };
        let workers = Workers::new()?;
        let scaled = workers.map(&piece.photos, |(path, [width, height])| {
            progress.check()?;
            let Ok(size) = Size::new(*width as usize, *height as usize) else {
                return Ok(Err("has no pixels in its tile".to_owned()));
            };
            let scaled = scaled_from_file(path, size, piece.crop, &limits, progress)?;
            Ok::<_, Cancelled>(scaled.map(|(image, _)| image))
        })?;
        let mut bytes = Vec::new();
        let answer = scaled.into_iter().map(|scaled| match scaled {
            Ok(image) => {
                bytes.extend(image.pixels().iter().flat_map(|pixel| pixel.0));
                None
            }
            Err(reason) => Some(reason),
        });
        let answer: Answer = answer.collect();
        let written = self.parts.write(&part_name(piece.part), &bytes);
        written.map_err(broken)?;
        to_bytes(&answer).map_err(broken)
    }
}

//! Steps of a mosaic that run in other processes: the search for candidates, and decoding and scaling of photos.
//!
//! Most of the time of a mosaic goes into decoding the photos that were chosen, and most of the rest into the search for the photos
//! nearest to each tile. With a cluster, its workers search for some tiles at a time in an index that each of them makes once, and
//! decode and scale some photos at a time into parts; the mosaic is then painted from the parts, strip by strip. Photos are read by
//! their paths, which all machines must see.
//!
//! The search divides the tiles and not the photos: a search among half of the photos takes far more than half of the time.
//!
//! Guarantees: the same mosaic as without a cluster, as far as each worker has the memory for each photo: one that takes more than a
//! worker has is replaced by another, as one that takes more than the budget is without a cluster. Lost parts are recomputed.

use crate::error::CatalogueError;
use crate::painter::{Candidate, Unpainted, scaled_from_file};
use crate::workers::Workers;
use ravec_media::Limits;
use ravec_memory::MemoryBudget;
use ravec_mosaic::{Crop, Near, PhotoIndex, Photos, TileSearch};
use ravec_pieces::{Cluster, PartStore, from_bytes, to_bytes};
use ravec_progress::{Cancelled, Progress};
use ravec_raster::{Image, Rect, Size, Srgb};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::collections::{HashMap, HashSet, VecDeque};
use std::io::{Error, ErrorKind};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

/// Photos in a piece.
const PHOTOS_IN_PIECE: usize = 64;

/// Tiles in a piece.
const TILES_IN_PIECE: usize = 1000;

/// Attempts to read a part before the store counts as unreliable.
const MAX_ATTEMPTS: usize = 4;

/// Maximum size of a part that is read as a whole: neighboring tiles have their photos in one part, and the latency of a request
/// to an object store is that of some megabytes.
const MAX_WHOLE_BYTES: u64 = 4 << 20;

/// Capacity of the cache of parts, in bytes.
const MAX_KEPT_BYTES: u64 = 4 * MAX_WHOLE_BYTES;

/// A photo and the size in which it is wanted.
type Wanted = (PathBuf, [u32; 2]);

/// A piece of the work.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Piece {
    /// Number of the part that it writes.
    part: u64,
    work: Work,
}

#[derive(Debug, Clone, Serialize, Deserialize)]
enum Work {
    /// Photos to scale.
    Scale {
        crop: Crop,
        max_pixels: u64,
        photos: Vec<Wanted>,
    },
    /// Tiles to search for.
    Search {
        /// Number of the index.
        index: u64,
        /// For each tile, the query and the number of photos.
        queries: Vec<(Vec<f32>, u32)>,
    },
}

/// For each photo of a piece, why it cannot be read, if so; nothing for a search.
type Answer = Vec<Option<String>>;

/// Place of a scaled photo.
#[derive(Debug, Clone, Copy)]
struct Place {
    part: u64,
    at: u64,
}

fn part_name(part: u64) -> String {
    format!("part-{part}")
}

/// Returns the name of the vectors of an index.
fn index_name(index: u64) -> String {
    format!("index-{index}")
}

fn bytes_of([width, height]: [u32; 2]) -> u64 {
    3 * u64::from(width) * u64::from(height)
}

/// The bytes of a part, once a thread has read them.
type PartBytes = Arc<Mutex<Option<Arc<Vec<u8>>>>>;

/// A cache of parts that evicts the least recently used ones.
#[derive(Default)]
struct PartCache {
    /// Number, size and bytes of each part, the most recently used one last.
    parts: VecDeque<(u64, u64, PartBytes)>,
}

impl PartCache {
    /// The entry of a part of this many bytes.
    fn entry(&mut self, part: u64, bytes: u64) -> PartBytes {
        let known = self.parts.iter().position(|(other, ..)| *other == part);
        let found = known.and_then(|at| self.parts.remove(at));
        let found = found.unwrap_or_else(|| (part, bytes, PartBytes::default()));
        let entry = Arc::clone(&found.2);
        self.parts.push_back(found);
        let kept = |parts: &VecDeque<_>| parts.iter().map(|(_, bytes, _)| bytes).sum::<u64>();
        while kept(&self.parts) > MAX_KEPT_BYTES {
            self.parts.pop_front();
        }
        entry
    }
}

/// The work of a cluster for one mosaic, and the photos that it has scaled, from one choice of photos to the next.
pub(crate) struct ClusterTasks<'t> {
    cluster: &'t Cluster,
    crop: Crop,
    max_pixels: u64,
    places: HashMap<Wanted, Result<Place, String>>,
    /// Pieces by the number of their part.
    pieces: Vec<Piece>,
    /// Bytes of the parts with photos.
    bytes_of_parts: HashMap<u64, u64>,
    cache: Mutex<PartCache>,
    /// Number of indices so far.
    indices: u64,
    /// Parts are recomputed one at a time.
    restoring: Mutex<()>,
}

impl<'t> ClusterTasks<'t> {
    pub fn new(cluster: &'t Cluster, crop: Crop, limits: &Limits) -> Self {
        Self {
            cluster,
            crop,
            max_pixels: limits.max_pixels,
            places: HashMap::new(),
            pieces: Vec::new(),
            bytes_of_parts: HashMap::new(),
            cache: Mutex::default(),
            indices: 0,
            restoring: Mutex::default(),
        }
    }

    /// Searches for the candidates of tiles; returns the nearest photos of each.
    pub fn search(
        &mut self,
        photos: &Photos,
        searches: &[TileSearch],
        progress: &Progress,
    ) -> Result<Vec<Vec<Near>>, Unpainted> {
        let first_index = self.indices;
        for index in photos.indices() {
            let dimensions = (index.dimensions() as u64).to_le_bytes();
            let vectors = index.vectors();
            let bytes = [&dimensions[..], bytemuck::cast_slice(&vectors)].concat();
            let name = index_name(self.indices);
            self.cluster.store().write(&name, &bytes).map_err(failed)?;
            self.indices += 1;
        }
        // tiles that are searched in one index together
        let mut order: Vec<usize> = (0..searches.len()).collect();
        order.sort_by_key(|&tile| searches[tile].index);
        let groups: Vec<&[usize]> = order
            .chunk_by(|&a, &b| searches[a].index == searches[b].index)
            .flat_map(|group| group.chunks(TILES_IN_PIECE))
            .collect();
        let works = groups.iter().map(|group| Work::Search {
            index: first_index + searches[group[0]].index as u64,
            queries: (group.iter())
                .map(|&tile| (searches[tile].query.clone(), searches[tile].count as u32))
                .collect(),
        });
        let parts = self.run("search", works.collect(), progress)?;
        let mut found: Vec<Vec<Near>> = vec![Vec::new(); searches.len()];
        for (group, (part, _)) in groups.iter().zip(parts) {
            let bytes = self.read(part, None, progress)?;
            let lists: Vec<Vec<(u32, f32)>> = from_bytes(&bytes).map_err(failed)?;
            for (&tile, list) in group.iter().zip(lists) {
                let near = list.into_iter();
                found[tile] = near
                    .map(|(photo, distance_sq)| Near { photo, distance_sq })
                    .collect();
            }
            self.cluster
                .store()
                .remove(&part_name(part))
                .map_err(failed)?;
        }
        Ok(found)
    }

    /// Scales all photos of a mosaic that are not scaled yet.
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
        let works = wanted.chunks(PHOTOS_IN_PIECE).map(|photos| Work::Scale {
            crop: self.crop,
            max_pixels: self.max_pixels,
            photos: photos.to_vec(),
        });
        let parts = self.run("photos", works.collect(), progress)?;
        for (photos, (part, answer)) in wanted.chunks(PHOTOS_IN_PIECE).zip(parts) {
            let mut at = 0;
            for (key, reason) in photos.iter().zip(answer) {
                let place = match reason {
                    Some(reason) => Err(reason),
                    None => Ok(Place { part, at }),
                };
                if place.is_ok() {
                    at += bytes_of(key.1);
                }
                self.places.insert(key.clone(), place);
            }
            self.bytes_of_parts.insert(part, at);
        }
        Ok(())
    }

    /// Runs pieces; returns their parts and answers in order.
    fn run(
        &mut self,
        name: &'static str,
        works: Vec<Work>,
        progress: &Progress,
    ) -> Result<Vec<(u64, Answer)>, Unpainted> {
        let first = self.pieces.len();
        let numbered = (first as u64..).zip(works);
        self.pieces
            .extend(numbered.map(|(part, work)| Piece { part, work }));
        let pieces = &self.pieces[first..];
        let phase = progress.phase(name, pieces.len() as u64);
        let mut answers = self.answers(pieces, progress, || phase.advance(1))?;
        let taken = pieces.iter().map(|piece| {
            let answer = answers.remove(&piece.part).unwrap_or_default();
            (piece.part, answer)
        });
        Ok(taken.collect())
    }

    /// Runs pieces; returns their answers by part.
    fn answers(
        &self,
        pieces: &[Piece],
        progress: &Progress,
        done: impl Fn(),
    ) -> Result<HashMap<u64, Answer>, Unpainted> {
        let mut executor = self.cluster.executor();
        for piece in pieces {
            let bytes = to_bytes(piece).map_err(failed)?;
            executor.submit(piece.part, bytes).map_err(failed)?;
        }
        let mut answers: HashMap<u64, Answer> = HashMap::new();
        while answers.len() < pieces.len() {
            let (part, answer) = executor.next(progress).map_err(failed)?;
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
        let range = place.at..place.at + bytes_of(sides);
        let whole = self.bytes_of_parts[&place.part];
        let pixels: Vec<Srgb<u8>> = if whole > MAX_WHOLE_BYTES {
            let bytes = self.read(place.part, Some(&range), progress)?;
            bytemuck::pod_collect_to_vec(&bytes)
        } else {
            let bytes = self.part(place.part, whole, progress)?;
            bytemuck::pod_collect_to_vec(&bytes[range.start as usize..range.end as usize])
        };
        let image = Image::from_vec(size.width(), pixels);
        Ok(Ok(image.expect("the range has the bytes of the photo")))
    }

    /// The bytes of a part of this size, from the cache or the store.
    fn part(&self, part: u64, bytes: u64, progress: &Progress) -> Result<Arc<Vec<u8>>, Unpainted> {
        let mut cache = self.cache.lock().unwrap_or_else(PoisonError::into_inner);
        let entry = cache.entry(part, bytes);
        drop(cache);
        // other threads that need the part wait for the one that reads it
        let mut entry = entry.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = &*entry {
            return Ok(Arc::clone(known));
        }
        let read = Arc::new(self.read(part, Some(&(0..bytes)), progress)?);
        Ok(Arc::clone(entry.insert(read)))
    }

    /// Reads a range of a part, or all of it; recomputes the part if it is lost.
    fn read(
        &self,
        part: u64,
        range: Option<&Range<u64>>,
        progress: &Progress,
    ) -> Result<Vec<u8>, Unpainted> {
        let (store, name) = (self.cluster.store(), part_name(part));
        let read = || match range {
            Some(range) => store.read(&name, range.clone()),
            None => store.read_all(&name),
        };
        for attempt in 1.. {
            match read() {
                Ok(bytes) => return Ok(bytes),
                Err(error) if is_lost(&error) && attempt < MAX_ATTEMPTS => {
                    let restoring = self.restoring.lock();
                    let _one = restoring.unwrap_or_else(PoisonError::into_inner);
                    // another thread may have restored it
                    if read().is_err() {
                        let piece = &self.pieces[part as usize];
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

/// Runs the pieces of a mosaic that another process makes with [`mosaic_in_pieces`](crate::mosaic_in_pieces).
pub struct MosaicWorker {
    parts: Arc<dyn PartStore>,
    memory: MemoryBudget,
    /// The latest index.
    index: Mutex<Option<(u64, Arc<PhotoIndex>)>>,
}

impl std::fmt::Debug for MosaicWorker {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("MosaicWorker").finish_non_exhaustive()
    }
}

impl MosaicWorker {
    /// A worker that takes memory for photos from a budget.
    pub fn new(parts: Arc<dyn PartStore>, memory: MemoryBudget) -> Self {
        Self {
            parts,
            memory,
            index: Mutex::default(),
        }
    }

    /// Runs a piece in the current pool of threads; returns the answer for the coordinator.
    ///
    /// # Errors
    /// [`CatalogueError::Piece`] if the store fails, or the bytes are no piece; [`CatalogueError::Cancelled`].
    pub fn run(&self, piece: &[u8], progress: &Progress) -> Result<Vec<u8>, CatalogueError> {
        let Piece { part, work } = from_bytes(piece).map_err(broken)?;
        let (bytes, answer) = match work {
            Work::Scale {
                crop,
                max_pixels,
                photos,
            } => {
                let limits = Limits {
                    max_pixels,
                    memory: self.memory.clone(),
                };
                scale(&photos, crop, &limits, progress)?
            }
            Work::Search { index, queries } => (self.search(index, &queries, progress)?, vec![]),
        };
        let written = self.parts.write(&part_name(part), &bytes);
        written.map_err(broken)?;
        to_bytes(&answer).map_err(broken)
    }

    /// Searches for tiles; returns the nearest photos of each as the bytes of a part.
    fn search(
        &self,
        index: u64,
        queries: &[(Vec<f32>, u32)],
        progress: &Progress,
    ) -> Result<Vec<u8>, CatalogueError> {
        let index = self.index(index)?;
        if queries
            .iter()
            .any(|(query, _)| query.len() != index.dimensions())
        {
            return Err(broken(damaged()));
        }
        let nearest = |(query, count): &(Vec<f32>, u32)| -> Result<Vec<(u32, f32)>, Cancelled> {
            progress.check()?;
            let near = index.nearest(query, *count as usize).into_iter();
            Ok(near.map(|near| (near.photo, near.distance_sq)).collect())
        };
        let found = queries.par_iter().map(nearest);
        let found = found.collect::<Result<Vec<_>, Cancelled>>()?;
        to_bytes(&found).map_err(broken)
    }

    /// Returns an index, made from its vectors.
    fn index(&self, number: u64) -> Result<Arc<PhotoIndex>, CatalogueError> {
        let mut latest = self.index.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((of, index)) = &*latest
            && *of == number
        {
            return Ok(Arc::clone(index));
        }
        let bytes = self.parts.read_all(&index_name(number)).map_err(broken)?;
        let (dimensions, vectors) = bytes.split_first_chunk().ok_or_else(|| broken(damaged()))?;
        let dimensions = u64::from_le_bytes(*dimensions) as usize;
        let bytes_of_vector = dimensions.saturating_mul(size_of::<f32>());
        if bytes_of_vector == 0 || !vectors.len().is_multiple_of(bytes_of_vector) {
            return Err(broken(damaged()));
        }
        let vectors: Vec<f32> = bytemuck::pod_collect_to_vec(vectors);
        let index = Arc::new(PhotoIndex::new(&vectors, dimensions));
        *latest = Some((number, Arc::clone(&index)));
        Ok(index)
    }
}

fn damaged() -> Error {
    Error::new(
        ErrorKind::InvalidData,
        "its content is not what was written",
    )
}

/// Error of the store, or of bytes that no coordinator wrote.
#[expect(
    clippy::needless_pass_by_value,
    reason = "taken as it comes from a result"
)]
fn broken(error: Error) -> CatalogueError {
    CatalogueError::Piece {
        reason: error.to_string(),
    }
}

/// Scales photos; returns their pixels one after the other, and why some are missing.
fn scale(
    photos: &[Wanted],
    crop: Crop,
    limits: &Limits,
    progress: &Progress,
) -> Result<(Vec<u8>, Answer), CatalogueError> {
    let workers = Workers::new()?;
    let scaled = workers.map(photos, |(path, [width, height])| {
        progress.check()?;
        let Ok(size) = Size::new(*width as usize, *height as usize) else {
            return Ok(Err("has no pixels in its tile".to_owned()));
        };
        let scaled = scaled_from_file(path, size, crop, limits, progress)?;
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
    let answer = answer.collect();
    Ok((bytes, answer))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_least_recently_used_parts_are_evicted() {
        let mut cache = PartCache::default();
        let third = MAX_KEPT_BYTES / 3;
        let first = cache.entry(1, third);
        cache.entry(2, third);
        assert!(Arc::ptr_eq(&first, &cache.entry(1, third)));
        cache.entry(3, third);
        cache.entry(4, third);
        let kept: Vec<u64> = cache.parts.iter().map(|(part, ..)| *part).collect();
        assert_eq!(kept, [1, 3, 4]);
        let empty = cache.entry(2, third);
        assert!(empty.lock().unwrap().is_none());
    }
}

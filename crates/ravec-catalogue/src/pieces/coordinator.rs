//! The coordinator: divides the work of a mosaic, and puts the results together.

use super::{
    Answer, Flaws, Piece, Scaled, Wanted, Work, bytes_of, damaged, index_name, is_lost, part_name,
};
use crate::painter::{Candidate, Unpainted};
use ravec_media::Limits;
use ravec_mosaic::{Crop, Near, Photos, TileSearch};
use ravec_pieces::{Cluster, from_bytes, to_bytes};
use ravec_progress::{Cancelled, Progress};
use ravec_raster::{Rect, Size, Srgb};
use std::collections::{HashMap, HashSet, VecDeque};
use std::io::{Error, ErrorKind};
use std::ops::Range;

/// Photos in a piece.
const PHOTOS_IN_PIECE: usize = 64;

/// Tiles in a piece.
const TILES_IN_PIECE: usize = 1000;

/// Maximum size of a painted part of a strip, in bytes, unless a row has more.
const MAX_PAINTED_BYTES: usize = 16 << 20;

/// Maximum number of parts of strips that are painted before the first of them is written.
const MAX_PARTS_AHEAD: usize = 128;

/// Attempts to run a piece or to read its part before the store counts as unreliable.
const MAX_ATTEMPTS: usize = 4;

/// Place of a scaled photo.
#[derive(Debug, Clone, Copy)]
struct Place {
    part: u64,
    at: u64,
}

/// The work of a cluster for one mosaic, and the photos that it has scaled, from one choice of photos to the next.
pub(crate) struct ClusterTasks<'t> {
    cluster: &'t Cluster,
    crop: Crop,
    max_pixels: u64,
    places: HashMap<Wanted, Result<Place, String>>,
    /// Bytes of the parts with photos.
    bytes_of_parts: HashMap<u64, u64>,
    /// Work by the number of its part, as long as the part is needed.
    works: HashMap<u64, Work>,
    /// Number of the next part.
    next_part: u64,
    /// Number of indices so far.
    indices: u64,
    /// Answers that are not asked for yet, by part.
    answers: HashMap<u64, Answer>,
}

impl<'t> ClusterTasks<'t> {
    pub fn new(cluster: &'t Cluster, crop: Crop, limits: &Limits) -> Self {
        Self {
            cluster,
            crop,
            max_pixels: limits.max_pixels,
            places: HashMap::new(),
            bytes_of_parts: HashMap::new(),
            works: HashMap::new(),
            next_part: 0,
            indices: 0,
            answers: HashMap::new(),
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
            let bytes = self.take(part, progress)?;
            let lists: Vec<Vec<(u32, f32)>> = from_bytes(&bytes).map_err(failed)?;
            for (&tile, list) in group.iter().zip(lists) {
                let near = list.into_iter();
                found[tile] = near
                    .map(|(photo, distance_sq)| Near { photo, distance_sq })
                    .collect();
            }
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
        for (photo, place) in shown(places) {
            let size = sides(place);
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
        for (photos, (part, flaws)) in wanted.chunks(PHOTOS_IN_PIECE).zip(parts) {
            let mut at = 0;
            for (key, flaw) in photos.iter().zip(flaws) {
                let place = match flaw {
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

    /// Strips of `strip_px` rows of a mosaic of `size`, which workers paint from the photos that they have scaled.
    ///
    /// If photos cannot be read, those of the first such strip are the error, as without a cluster, so that others take their place in
    /// the same order.
    pub fn strips(
        &mut self,
        photos: &[Candidate],
        places: &[(u32, Rect)],
        (size, strip_px): (Size, usize),
    ) -> Result<PaintedStrips<'_, 't>, Unpainted> {
        let mut scaled = Vec::with_capacity(places.len());
        let mut broken: Vec<(usize, u32, String)> = Vec::new();
        for (photo, rect) in shown(places) {
            let key = (photos[photo as usize].entry.path.clone(), sides(rect));
            let place = match self.places.get(&key) {
                Some(place) => place.as_ref().map_err(String::as_str),
                None => Err("was not scaled"),
            };
            match place {
                Ok(place) => scaled.push(Scaled {
                    part: place.part,
                    part_bytes: self.bytes_of_parts[&place.part],
                    at: place.at,
                    origin: [rect.col as u32, rect.row as u32],
                    size: key.1,
                }),
                Err(reason) => broken.push((rect.row / strip_px, photo, reason.to_owned())),
            }
        }
        if let Some(first) = broken.iter().map(|(strip, ..)| *strip).min() {
            broken.retain(|(strip, ..)| *strip == first);
            let mut broken: Vec<(u32, String)> = broken
                .into_iter()
                .map(|(_, photo, reason)| (photo, reason))
                .collect();
            broken.sort_by_key(|(photo, _)| *photo);
            broken.dedup_by_key(|(photo, _)| *photo);
            return Err(Unpainted::Photos(broken));
        }
        let part_px = (MAX_PAINTED_BYTES / (3 * size.width())).clamp(1, strip_px);
        let parts_per_strip = strip_px.div_ceil(part_px);
        let mut parts: Vec<(Range<usize>, Vec<Scaled>)> = (0..size.height())
            .step_by(strip_px)
            .flat_map(|strip| {
                let end = (strip + strip_px).min(size.height());
                let part = move |first: usize| (first..(first + part_px).min(end), Vec::new());
                (strip..end).step_by(part_px).map(part)
            })
            .collect();
        for tile in scaled {
            let (top, height) = (tile.origin[1] as usize, tile.size[1] as usize);
            let part_of = |row: usize| row / strip_px * parts_per_strip + row % strip_px / part_px;
            for (_, tiles) in &mut parts[part_of(top)..=part_of(top + height - 1)] {
                tiles.push(tile.clone());
            }
        }
        Ok(PaintedStrips {
            width: size.width(),
            parts: parts.into_iter(),
            pending: VecDeque::new(),
            tasks: self,
        })
    }

    /// Runs works; returns their parts and answers in order.
    fn run(
        &mut self,
        name: &'static str,
        works: Vec<Work>,
        progress: &Progress,
    ) -> Result<Vec<(u64, Flaws)>, Unpainted> {
        let phase = progress.phase(name, works.len() as u64);
        let mut parts = Vec::with_capacity(works.len());
        for work in works {
            parts.push(self.submit(work)?);
        }
        for _ in &parts {
            self.receive(progress)?;
            phase.advance(1);
        }
        let with_answer = |part| Ok((part, self.answer(part, progress)?));
        parts.into_iter().map(with_answer).collect()
    }

    /// Sends a work to the workers; returns the number of its part.
    fn submit(&mut self, work: Work) -> Result<u64, Unpainted> {
        let part = self.next_part;
        self.next_part += 1;
        self.works.insert(part, work);
        self.submit_again(part)?;
        Ok(part)
    }

    fn submit_again(&self, part: u64) -> Result<(), Unpainted> {
        let work = self.works[&part].clone();
        let bytes = to_bytes(&Piece { part, work }).map_err(failed)?;
        self.cluster.executor().submit(part, bytes).map_err(failed)
    }

    /// Waits for any answer.
    fn receive(&mut self, progress: &Progress) -> Result<(), Unpainted> {
        let (part, bytes) = self.cluster.executor().next(progress).map_err(failed)?;
        let answer = from_bytes(&bytes).map_err(failed)?;
        self.answers.insert(part, answer);
        Ok(())
    }

    /// Waits for the answer of the work with this part. Parts that it misses are recomputed before it runs again.
    fn answer(&mut self, part: u64, progress: &Progress) -> Result<Flaws, Unpainted> {
        for _ in 0..MAX_ATTEMPTS {
            let answer = loop {
                match self.answers.remove(&part) {
                    Some(answer) => break answer,
                    None => self.receive(progress)?,
                }
            };
            match answer {
                Answer::Done(flaws) => return Ok(flaws),
                Answer::Lost(parts) => self.recompute(parts, progress)?,
            }
            self.submit_again(part)?;
        }
        let reason = format!("what it needs was lost {MAX_ATTEMPTS} times");
        Err(failed(Error::new(ErrorKind::NotFound, reason)))
    }

    /// Recomputes the parts that are still lost; fails if their photos can no longer be read.
    fn recompute(&mut self, mut parts: Vec<u64>, progress: &Progress) -> Result<(), Unpainted> {
        let store = self.cluster.store();
        // they may have been recomputed for another piece since
        parts.retain(|&part| {
            let first = store.read(&part_name(part), 0..1);
            first.is_err() && self.works.contains_key(&part)
        });
        for &part in &parts {
            self.submit_again(part)?;
        }
        for part in parts {
            let flaws = self.answer(part, progress)?;
            if let Some(Work::Scale { photos, .. }) = self.works.get(&part) {
                // photos lie one after the other: a part without one of them has others elsewhere
                let is_known = |(photo, flaw): (&Wanted, &Option<String>)| {
                    let known = self.places.get(photo);
                    known.is_none_or(|known| known.is_ok() == flaw.is_none())
                };
                if !photos.iter().zip(&flaws).all(is_known) {
                    let reason = "photos have changed while the mosaic was made: start again";
                    return Err(failed(Error::new(ErrorKind::InvalidData, reason)));
                }
            }
        }
        Ok(())
    }

    /// Reads a part, which is not needed any more; recomputes it if it is lost.
    fn take(&mut self, part: u64, progress: &Progress) -> Result<Vec<u8>, Unpainted> {
        let store = self.cluster.store();
        let mut attempts = 1..MAX_ATTEMPTS;
        loop {
            match store.read_all(&part_name(part)) {
                Ok(bytes) => {
                    store.remove(&part_name(part)).map_err(failed)?;
                    self.works.remove(&part);
                    return Ok(bytes);
                }
                Err(error) if is_lost(&error) && attempts.next().is_some() => {
                    self.recompute(vec![part], progress)?;
                }
                Err(error) => return Err(failed(error)),
            }
        }
    }
}

/// Strips of a mosaic, which come from the top. Workers paint parts of them, which are strips of their own unless they are large.
pub(crate) struct PaintedStrips<'a, 't> {
    tasks: &'a mut ClusterTasks<'t>,
    width: usize,
    /// Rows and tiles of the parts that are not submitted yet.
    parts: std::vec::IntoIter<(Range<usize>, Vec<Scaled>)>,
    /// Rows of the parts that are submitted, and their numbers in the store.
    pending: VecDeque<(Range<usize>, u64)>,
}

impl PaintedStrips<'_, '_> {
    /// The pixels of the strip with these rows, each of which is asked for once, from the top.
    pub fn rows(
        &mut self,
        rows: &Range<usize>,
        pixels: &mut [Srgb<u8>],
        progress: &Progress,
    ) -> Result<(), Unpainted> {
        let mut painted = rows.start;
        while painted < rows.end {
            while self.pending.len() < MAX_PARTS_AHEAD
                && let Some((rows, tiles)) = self.parts.next()
            {
                let part = self.tasks.submit(Work::Paint {
                    width: self.width as u32,
                    rows: rows.start as u32..rows.end as u32,
                    tiles,
                })?;
                self.pending.push_back((rows, part));
            }
            let next = self.pending.pop_front();
            let (of_part, part) = next.ok_or_else(|| failed(damaged()))?;
            self.tasks.answer(part, progress)?;
            let bytes = self.tasks.take(part, progress)?;
            let first = (of_part.start - rows.start) * self.width;
            let pixels = &mut pixels[first..][..of_part.len() * self.width];
            if bytes.len() != size_of_val(pixels) {
                return Err(failed(damaged()));
            }
            bytemuck::cast_slice_mut(pixels).copy_from_slice(&bytes);
            painted = of_part.end;
        }
        Ok(())
    }
}

/// Photos in tiles that have pixels.
fn shown(places: &[(u32, Rect)]) -> impl Iterator<Item = (u32, Rect)> {
    let places = places.iter().copied();
    places.filter(|(_, place)| place.size().is_some())
}

fn sides(place: Rect) -> [u32; 2] {
    [place.width as u32, place.height as u32]
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

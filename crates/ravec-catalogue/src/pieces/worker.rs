//! The worker: runs pieces.

use super::parts::PartCache;
use super::{
    Answer, Flaws, Piece, Scaled, Wanted, Work, broken, bytes_of, damaged, index_name, is_lost,
    part_name,
};
use crate::error::CatalogueError;
use crate::painter::scaled_from_file;
use crate::plan::reserve;
use crate::workers::Workers;
use ravec_media::Limits;
use ravec_memory::MemoryBudget;
use ravec_mosaic::{Crop, PhotoIndex};
use ravec_pieces::{PartStore, from_bytes, to_bytes};
use ravec_progress::{Cancelled, Progress};
use ravec_raster::Size;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};

/// Runs the pieces of a mosaic that another process makes with [`mosaic_in_pieces`](crate::mosaic_in_pieces).
pub struct MosaicWorker {
    parts: Arc<dyn PartStore>,
    memory: MemoryBudget,
    /// The latest index.
    index: Mutex<Option<(u64, Arc<PhotoIndex>)>>,
    cache: PartCache,
}

impl std::fmt::Debug for MosaicWorker {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("MosaicWorker").finish_non_exhaustive()
    }
}

impl MosaicWorker {
    /// A worker that takes memory for photos and strips from a budget.
    pub fn new(parts: Arc<dyn PartStore>, memory: MemoryBudget) -> Self {
        Self {
            parts,
            memory,
            index: Mutex::default(),
            cache: PartCache::default(),
        }
    }

    /// Runs a piece in the current pool of threads; returns the answer for the coordinator.
    ///
    /// # Errors
    /// [`CatalogueError::Piece`] if the store fails, or the bytes are no piece; [`CatalogueError::MosaicMemory`] if the budget is
    /// less than a strip; [`CatalogueError::Cancelled`].
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
                let (bytes, flaws) = scale(&photos, crop, &limits, progress)?;
                (bytes, Answer::Done(flaws))
            }
            Work::Search { index, queries } => {
                let found = self.search(index, &queries, progress)?;
                (found, Answer::Done(vec![]))
            }
            Work::Paint { width, rows, tiles } => {
                let strip = 3 * u64::from(width) * u64::from(rows.end.saturating_sub(rows.start));
                let _of_strip = reserve(&self.memory, strip, "the rows that are painted at once")?;
                let mut pixels = vec![0; strip as usize];
                let lost = self.paint(&tiles, width, &rows, &mut pixels, progress)?;
                if !lost.is_empty() {
                    return to_bytes(&Answer::Lost(lost)).map_err(broken);
                }
                (pixels, Answer::Done(vec![]))
            }
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
    /// Paints what some rows show of tiles; returns the parts that are not there.
    fn paint(
        &self,
        tiles: &[Scaled],
        width: u32,
        rows: &Range<u32>,
        pixels: &mut [u8],
        progress: &Progress,
    ) -> Result<Vec<u64>, CatalogueError> {
        let line = 3 * width as usize;
        let pixels = Mutex::new(pixels);
        let paint = |tile: &Scaled| -> Result<Option<u64>, CatalogueError> {
            progress.check()?;
            let ([left, top], [columns, height]) = (tile.origin, tile.size);
            let right = left.checked_add(columns).filter(|&right| right <= width);
            let bottom = top.checked_add(height);
            let (Some(_), Some(bottom)) = (right, bottom) else {
                return Err(broken(damaged()));
            };
            let shown = rows.start.max(top)..rows.end.min(bottom);
            if shown.is_empty() || columns == 0 {
                return Ok(None);
            }
            let row = bytes_of([columns, 1]);
            let at = |shown: u32| {
                tile.at
                    .checked_add(u64::from(shown - top).checked_mul(row)?)
            };
            let (Some(start), Some(end)) = (at(shown.start), at(shown.end)) else {
                return Err(broken(damaged()));
            };
            let copy = |bytes: &[u8]| {
                let mut pixels = pixels.lock().unwrap_or_else(PoisonError::into_inner);
                let first = (shown.start - rows.start) as usize;
                let lines = pixels.chunks_exact_mut(line).skip(first);
                for (line, bytes) in lines.zip(bytes.chunks_exact(row as usize)) {
                    line[3 * left as usize..][..bytes.len()].copy_from_slice(bytes);
                }
            };
            let part = (tile.part, tile.part_bytes);
            match self.cache.read(&*self.parts, part, &(start..end), copy) {
                Ok(()) => Ok(None),
                Err(error) if is_lost(&error) => Ok(Some(tile.part)),
                Err(error) => Err(broken(error)),
            }
        };
        let lost = tiles.par_iter().map(paint);
        let lost = lost.collect::<Result<Vec<Option<u64>>, CatalogueError>>()?;
        let mut lost: Vec<u64> = lost.into_iter().flatten().collect();
        lost.sort_unstable();
        lost.dedup();
        Ok(lost)
    }
}

/// Scales photos; returns their pixels one after the other, and why some are missing.
fn scale(
    photos: &[Wanted],
    crop: Crop,
    limits: &Limits,
    progress: &Progress,
) -> Result<(Vec<u8>, Flaws), CatalogueError> {
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
    let flaws = scaled.into_iter().map(|scaled| match scaled {
        Ok(image) => {
            bytes.extend(image.pixels().iter().flat_map(|pixel| pixel.0));
            None
        }
        Err(reason) => Some(reason),
    });
    let flaws = flaws.collect();
    Ok((bytes, flaws))
}

#[cfg(test)]
mod tests {
    use super::*;
    use ravec_pieces::FolderStore;

    #[test]
    fn strips_of_any_height_are_rows_of_the_mosaic() {
        let folder = tempfile::tempdir().unwrap();
        let store = Arc::new(FolderStore::new(folder.path()));
        let worker = MosaicWorker::new(store.clone(), MemoryBudget::default());
        // tiles of several sizes, among them ones over several strips, with the photos of two parts; columns 9 to 11 are black
        let sizes = [
            ([0, 0], [5, 7]),
            ([5, 0], [4, 3]),
            ([5, 3], [4, 4]),
            ([0, 7], [9, 5]),
        ];
        let byte = |tile: usize, at: u64| (60 * tile as u64 + at) as u8 | 1;
        let mut parts = [Vec::new(), Vec::new()];
        let mut tiles = Vec::new();
        for (tile, (origin, size)) in sizes.into_iter().enumerate() {
            let part = &mut parts[tile % 2];
            let at = part.len() as u64;
            part.extend((0..bytes_of(size)).map(|at| byte(tile, at)));
            tiles.push(Scaled {
                part: tile as u64 % 2,
                part_bytes: 0,
                at,
                origin,
                size,
            });
        }
        for tile in &mut tiles {
            tile.part_bytes = parts[tile.part as usize].len() as u64;
        }
        let mut truth = vec![0; 12 * 12 * 3];
        for (tile, ([left, top], [width, height])) in sizes.into_iter().enumerate() {
            for at in 0..bytes_of([width, height]) {
                let (row, col) = (at as u32 / (3 * width), at as u32 % (3 * width));
                let to = (top + row) * 36 + 3 * left + col;
                truth[to as usize] = byte(tile, at);
            }
        }
        let paint = |rows: Range<u32>| {
            let work = Work::Paint {
                width: 12,
                rows,
                tiles: tiles.clone(),
            };
            let piece = to_bytes(&Piece { part: 9, work }).unwrap();
            let answer = worker.run(&piece, &Progress::none()).unwrap();
            from_bytes::<Answer>(&answer).unwrap()
        };
        let lost = paint(0..12);
        assert!(
            matches!(&lost, Answer::Lost(parts) if parts == &[0, 1]),
            "{lost:?}"
        );
        for (part, bytes) in parts.iter().enumerate() {
            store.write(&part_name(part as u64), bytes).unwrap();
        }
        for strip in [1, 2, 5, 12] {
            for first in (0..12).step_by(strip) {
                let rows = first..(first + strip as u32).min(12);
                assert!(matches!(paint(rows.clone()), Answer::Done(_)));
                let bytes = store.read_all(&part_name(9)).unwrap();
                let rows = rows.start as usize * 36..rows.end as usize * 36;
                assert_eq!(bytes, truth[rows]);
            }
        }
        // beyond the mosaic, and beyond the part
        for (origin, at) in [
            ([8, 0], 0),
            ([u32::MAX, 0], 0),
            ([0, 0], u64::MAX - 2),
            ([0, 0], 1000),
        ] {
            let tiles = vec![Scaled {
                at,
                origin,
                ..tiles[0].clone()
            }];
            let work = Work::Paint {
                width: 12,
                rows: 0..12,
                tiles,
            };
            let piece = to_bytes(&Piece { part: 9, work }).unwrap();
            assert!(worker.run(&piece, &Progress::none()).is_err());
        }
    }
}

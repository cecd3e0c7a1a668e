//! Parallel loops over chunks of pixels, compiled once for all types of pixels and all bodies.
//!
//! An instance of a parallel iterator is about ten thousand lines of intermediate code, and a program maps pictures in hundreds of
//! places. Here pixels pass the iterator as bytes and the body as a reference, which costs a call a chunk and a third of the time
//! of a build.

use crate::pixel::Pixel;
use ravec_progress::Cancelled;
use rayon::prelude::*;

/// Calls `work(first, chunk)` in parallel for each chunk of `length` pixels (the last may be shorter); `first` is the index of the
/// first pixel of the chunk.
///
/// # Panics
/// If `length` is 0.
pub(crate) fn for_each_chunk<P: Pixel>(
    pixels: &mut [P],
    length: usize,
    work: impl Fn(usize, &mut [P]) + Sync,
) {
    let bytes = bytemuck::cast_slice_mut(pixels);
    bytes_in_parallel(bytes, length * size_of::<P>(), &|index, chunk| {
        work(index * length, bytemuck::cast_slice_mut(chunk));
    });
}

/// [`for_each_chunk`] for work that can be cancelled: no chunk is begun after one was.
///
/// # Errors
/// [`Cancelled`] if a chunk's work was.
///
/// # Panics
/// If `length` is 0.
pub(crate) fn try_for_each_chunk<P: Pixel>(
    pixels: &mut [P],
    length: usize,
    work: impl Fn(usize, &mut [P]) -> Result<(), Cancelled> + Sync,
) -> Result<(), Cancelled> {
    let bytes = bytemuck::cast_slice_mut(pixels);
    try_bytes_in_parallel(bytes, length * size_of::<P>(), &|index, chunk| {
        work(index * length, bytemuck::cast_slice_mut(chunk))
    })
}

/// Work on the chunk of an index, which can be cancelled.
type TryWork<'a> = dyn Fn(usize, &mut [u8]) -> Result<(), Cancelled> + Sync + 'a;

fn bytes_in_parallel(bytes: &mut [u8], length: usize, work: &(dyn Fn(usize, &mut [u8]) + Sync)) {
    bytes
        .par_chunks_mut(length)
        .enumerate()
        .for_each(|(index, chunk)| work(index, chunk));
}

fn try_bytes_in_parallel(
    bytes: &mut [u8],
    length: usize,
    work: &TryWork<'_>,
) -> Result<(), Cancelled> {
    bytes
        .par_chunks_mut(length)
        .enumerate()
        .try_for_each(|(index, chunk)| work(index, chunk))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicUsize, Ordering};

    #[test]
    fn each_pixel_is_in_one_chunk_and_knows_its_index() {
        for count in [0, 1, 4, 5, 6, 9, 10, 1000] {
            let mut pixels = vec![[0u16; 3]; count];
            for_each_chunk(&mut pixels, 5, |first, chunk| {
                assert!(first % 5 == 0 && chunk.len() == 5.min(count - first));
                for (offset, pixel) in chunk.iter_mut().enumerate() {
                    pixel[2] += (first + offset + 1) as u16;
                }
            });
            let expected: Vec<_> = (1..=count).map(|index| [0, 0, index as u16]).collect();
            assert_eq!(pixels, expected);
        }
    }

    #[test]
    fn no_chunk_is_begun_after_one_was_cancelled() {
        let mut pixels = vec![0u8; 100_000];
        let begun = AtomicUsize::new(0);
        let one_thread = rayon::ThreadPoolBuilder::new().num_threads(1).build();
        let result = one_thread.unwrap().install(|| {
            try_for_each_chunk(&mut pixels, 10, |_, chunk| {
                chunk.fill(1);
                match begun.fetch_add(1, Ordering::Relaxed) {
                    2 => Err(Cancelled),
                    _ => Ok(()),
                }
            })
        });
        assert_eq!(result, Err(Cancelled));
        assert_eq!(begun.into_inner(), 3);
        let written: usize = pixels.iter().map(|&pixel| usize::from(pixel)).sum();
        assert_eq!(written, 30);
    }
}

//! Work on horizontal strips of a picture: in parallel, cancellable, with the same result on any number of threads.
//!
//! The strips are cut by the picture and the caller's number of rows alone, never by the number of threads; results
//! come back in the order of the strips. So a sum over strips has the same rounding on every machine pool.
//!
//! Guarantees: cancellation is checked before each strip; after [`Cancelled`] the image holds a mixture of finished
//! and untouched strips and should be dropped. Does not guarantee: any order in which strips are worked on.

use crate::chunks::try_for_each_chunk;
use crate::image::Image;
use crate::pixel::Pixel;
use ravec_progress::{Cancelled, Phase, Progress};
use rayon::prelude::*;
use std::ops::Range;

/// Lets `work(first_row, pixels)` write each strip of `rows_per_strip` rows (the last may be lower), in parallel in the
/// caller's pool. `phase` is advanced by one unit a row.
///
/// Choose the rows so that a strip takes well under 50 ms, the time within which a cancellation should be noticed.
///
/// ```
/// use ravec_progress::{Cancelled, Progress};
/// use ravec_raster::{Plane, Size, for_each_strip};
///
/// let mut ramp = Plane::new(Size::new(3, 100).unwrap(), 0.0);
/// let progress = Progress::none();
/// let phase = progress.phase("ramp", 100);
/// for_each_strip(&mut ramp, 16, &progress, &phase, |first_row, pixels| {
///     for (index, row) in pixels.chunks_exact_mut(3).enumerate() {
///         row.fill((first_row + index) as f32);
///     }
/// })?;
/// assert_eq!(ramp[(2, 99)], 99.0);
/// # Ok::<(), Cancelled>(())
/// ```
///
/// # Errors
/// [`Cancelled`] soon after `progress` is cancelled.
///
/// # Panics
/// If `rows_per_strip` is 0.
pub fn for_each_strip<P: Pixel>(
    image: &mut Image<P>,
    rows_per_strip: usize,
    progress: &Progress,
    phase: &Phase,
    work: impl Fn(usize, &mut [P]) + Sync,
) -> Result<(), Cancelled> {
    let width = image.width();
    try_for_each_chunk(
        image.pixels_mut(),
        width * rows_per_strip,
        |first, pixels| {
            progress.check()?;
            work(first / width, pixels);
            phase.advance((pixels.len() / width) as u64);
            Ok(())
        },
    )
}

/// The results of `work(rows)` for each strip of `rows_per_strip` out of `height` rows, from the top. `phase` is
/// advanced by one unit a row.
///
/// # Errors
/// [`Cancelled`] soon after `progress` is cancelled.
///
/// # Panics
/// If `rows_per_strip` is 0.
pub fn map_strips<T: Send>(
    height: usize,
    rows_per_strip: usize,
    progress: &Progress,
    phase: &Phase,
    work: impl Fn(Range<usize>) -> T + Sync,
) -> Result<Vec<T>, Cancelled> {
    (0..height.div_ceil(rows_per_strip))
        .into_par_iter()
        .map(|index| {
            progress.check()?;
            let first = index * rows_per_strip;
            let rows = first..(first + rows_per_strip).min(height);
            let count = rows.len() as u64;
            let result = work(rows);
            phase.advance(count);
            Ok(result)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::size::Size;
    use std::sync::Arc;
    use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};

    #[test]
    fn each_row_is_written_once_and_the_phase_is_filled() {
        let seen = Arc::new(AtomicU64::new(0));
        let sink = Arc::clone(&seen);
        let progress = Progress::new(move |update| {
            sink.fetch_max(update.done, Ordering::Relaxed);
        });
        let mut image = Image::new(Size::new(2, 23).unwrap(), 0u32);
        let phase = progress.phase("write", 23);
        for_each_strip(&mut image, 5, &progress, &phase, |first, pixels| {
            for (index, row) in pixels.chunks_exact_mut(2).enumerate() {
                for pixel in row {
                    *pixel += (first + index) as u32;
                }
            }
        })
        .unwrap();
        assert!((0..23).all(|row| image.row(row) == [row as u32; 2]));
        assert_eq!(seen.load(Ordering::Relaxed), 23);
    }

    #[test]
    fn results_come_in_the_order_of_the_strips() {
        let progress = Progress::none();
        let strips = map_strips(7, 3, &progress, &progress.phase("map", 7), |rows| rows).unwrap();
        assert_eq!(strips, [0..3, 3..6, 6..7]);
    }

    #[test]
    fn a_cancellation_stops_before_the_next_strip() {
        let progress = Progress::none();
        let phase = progress.phase("work", 1000);
        let worked = AtomicUsize::new(0);
        let result = map_strips(1000, 1, &progress, &phase, |_| {
            worked.fetch_add(1, Ordering::Relaxed);
            progress.cancel();
        });
        assert_eq!(result, Err(Cancelled));
        // at most the strips that were already begun on other threads
        assert!(worked.into_inner() <= rayon::current_num_threads());
        let mut image = Image::new(Size::new(1, 9).unwrap(), 0u8);
        let written = for_each_strip(&mut image, 2, &progress, &phase, |_, pixels| pixels.fill(1));
        assert_eq!(written, Err(Cancelled));
        assert!(image.pixels().iter().all(|&pixel| pixel == 0));
    }
}

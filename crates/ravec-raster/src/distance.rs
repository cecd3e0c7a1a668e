//! The exact Euclidean distance of each pixel to a set of pixels.
//!
//! The plain idea: for each pixel the least distance between its center and that of any pixel of the set.
//!
//! Source: Meijster, Roerdink, Hesselink, "A general algorithm for computing distance transforms in linear time", 2000.
//! First the distance within each column by two sweeps, then the lower envelope of one parabola a column in each row.
//! Everything is done in whole numbers, so distances are exact; only the root at the end rounds.
//!
//! Cost: O(pixels), the rows in parallel; 4 bytes a pixel beside the result.

use crate::image::{Image, Plane};
use crate::pixel::Pixel;
use crate::size::Size;
use rayon::prelude::*;

/// Stands for "no pixel of the set in this column". Its square still fits.
const NONE: u32 = u32::MAX;

/// The distance in pixels from the center of each pixel to the nearest center of a pixel for which `member(col, row)`
/// holds: 0 for members, infinity everywhere if there are none.
///
/// ```
/// use ravec_raster::{Size, distance_to};
///
/// let distance = distance_to(Size::new(5, 5)?, |col, row| (col, row) == (0, 0));
/// assert_eq!(distance[(3, 4)], 5.0);
/// # Ok::<(), ravec_raster::SizeError>(())
/// ```
pub fn distance_to(size: Size, member: impl Fn(usize, usize) -> bool + Sync) -> Plane {
    map_distance_sq(size, member, |_, _, distance_sq| {
        distance_sq.map_or(f32::INFINITY, |d| (d as f64).sqrt() as f32)
    })
}

/// `f(col, row, squared distance)` of each pixel; no distance if the set is empty.
pub(crate) fn map_distance_sq<P: Pixel + Default>(
    size: Size,
    member: impl Fn(usize, usize) -> bool + Sync,
    f: impl Fn(usize, usize, Option<u64>) -> P + Sync,
) -> Image<P> {
    let columns = column_distances(size, member);
    let mut result = Image::new(size, P::default());
    result
        .par_rows_mut()
        .zip(columns.par_rows())
        .enumerate()
        .for_each_init(Vec::new, |envelope, (row, (out, column))| {
            lower_envelope(column, envelope);
            let mut pieces = envelope.iter().peekable();
            let mut current = pieces.next();
            for (col, pixel) in out.iter_mut().enumerate() {
                while let Some(next) = pieces.next_if(|next| next.from as usize <= col) {
                    current = Some(next);
                }
                *pixel = f(
                    col,
                    row,
                    current.map(|piece| parabola(column, piece.apex, col as u32)),
                );
            }
        });
    result
}

/// The distance of each pixel to the nearest member of its own column.
fn column_distances(size: Size, member: impl Fn(usize, usize) -> bool + Sync) -> Image<u32> {
    let mut distance = Image::new(size, NONE);
    distance.for_each_row(|row, line| {
        for (col, value) in line.iter_mut().enumerate() {
            if member(col, row) {
                *value = 0;
            }
        }
    });
    let width = size.width();
    let pixels = distance.pixels_mut();
    let mut relax = |from: usize, to: usize| {
        let (low, high) = pixels.split_at_mut(from.max(to) * width);
        let (low, high) = (
            &mut low[from.min(to) * width..][..width],
            &mut high[..width],
        );
        let (from, to) = if from < to { (low, high) } else { (high, low) };
        for (near, far) in from.iter().zip(to) {
            *far = (*far).min(near.saturating_add(1));
        }
    };
    (1..size.height()).for_each(|row| relax(row - 1, row));
    (1..size.height()).rev().for_each(|row| relax(row, row - 1));
    distance
}

/// A stretch of columns, from `from` to the next piece, whose nearest member stands in column `apex`.
struct Piece {
    from: u32,
    apex: u32,
}

fn parabola(column: &[u32], apex: u32, at: u32) -> u64 {
    let across = u64::from(apex.abs_diff(at));
    let down = u64::from(column[apex as usize]);
    across * across + down * down
}

/// The pieces of the lower envelope of all columns that have a member, from left to right.
fn lower_envelope(column: &[u32], pieces: &mut Vec<Piece>) {
    pieces.clear();
    for (apex, &down) in column.iter().enumerate() {
        if down == NONE {
            continue;
        }
        let apex = apex as u32;
        // a piece that the new parabola undercuts already where it begins is nowhere the lowest
        while let Some(last) = pieces.last() {
            if parabola(column, apex, last.from) < parabola(column, last.apex, last.from) {
                pieces.pop();
            } else {
                break;
            }
        }
        let from = match pieces.last() {
            None => 0,
            Some(last) => {
                // the first column where the new parabola is strictly lower:
                // (x − a)² + f > (x − b)² + g  ⇔  x > (b² − a² + g − f) / 2(b − a)
                let (a, b) = (i128::from(last.apex), i128::from(apex));
                let (f, g) = (i128::from(column[last.apex as usize]), i128::from(down));
                let meet = (b * b - a * a + g * g - f * f).div_euclid(2 * (b - a)) + 1;
                if meet >= column.len() as i128 {
                    continue;
                }
                // not before the last piece begins, or that piece would have gone above
                meet as u32
            }
        };
        pieces.push(Piece { from, apex });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn brute_force(size: Size, members: &[(usize, usize)]) -> Vec<f32> {
        let to = |col: usize, row: usize| {
            members
                .iter()
                .map(|&(c, r)| (c.abs_diff(col).pow(2) + r.abs_diff(row).pow(2)) as f64)
                .fold(f64::INFINITY, f64::min)
                .sqrt() as f32
        };
        (0..size.pixels())
            .map(|index| to(index % size.width(), index / size.width()))
            .collect()
    }

    proptest! {
        #[test]
        fn the_distance_is_that_of_the_brute_force(
            (w, h) in (1usize..24, 1usize..24), sparsity in 1u32..200, seed in 0u32..10_000
        ) {
            let size = Size::new(w, h).unwrap();
            let member = |col: usize, row: usize| {
                let mixed = ((row * w + col) as u32 + seed).wrapping_mul(2_654_435_761);
                (mixed >> 8).is_multiple_of(sparsity)
            };
            let members: Vec<_> = (0..h)
                .flat_map(|row| (0..w).map(move |col| (col, row)))
                .filter(|&(col, row)| member(col, row))
                .collect();
            let found = distance_to(size, member);
            prop_assert_eq!(found.pixels(), &brute_force(size, &members)[..]);
        }
    }

    #[test]
    fn every_set_in_a_3_by_3_image_has_the_right_distances() {
        let size = Size::new(3, 3).unwrap();
        for set in 0u32..512 {
            let member = |col: usize, row: usize| set >> (3 * row + col) & 1 == 1;
            let members: Vec<_> = (0..9)
                .map(|i| (i % 3, i / 3))
                .filter(|&(col, row)| member(col, row))
                .collect();
            assert_eq!(
                distance_to(size, member).pixels(),
                brute_force(size, &members)
            );
        }
    }

    #[test]
    fn an_empty_set_is_infinitely_far() {
        let far = distance_to(Size::new(4, 2).unwrap(), |_, _| false);
        assert!(far.pixels().iter().all(|&d| d == f32::INFINITY));
    }

    #[test]
    fn one_thread_and_many_give_the_same_bytes() {
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap();
            pool.install(|| {
                distance_to(Size::new(90, 70).unwrap(), |c, r| {
                    (c * 31 + r * 17) % 97 == 0
                })
            })
        };
        assert_eq!(on(1), on(4));
    }
}

//! A picture cut into tiles of equal size.

use crate::choose::Tile;
use crate::look::{Frame, Look};
use ravec_progress::{Cancelled, Progress};
use ravec_raster::{Image, Oklab};
use rayon::prelude::*;

/// The tiles of a frame of the picture, row by row, with polynomials up to `degree`.
///
/// # Errors
/// [`Cancelled`] soon after `progress` is cancelled.
pub fn grid_tiles(
    picture: &Image<Oklab>,
    frame: Frame,
    columns: usize,
    rows: usize,
    degree: usize,
    progress: &Progress,
) -> Result<Vec<Tile>, Cancelled> {
    let phase = progress.phase("look", (columns * rows) as u64);
    let side = (frame.width / columns as f64, frame.height / rows as f64);
    (0..columns * rows)
        .into_par_iter()
        .map(|at| {
            progress.check()?;
            let (col, row) = (at % columns, at / columns);
            let part = Frame {
                left: frame.left + side.0 * col as f64,
                top: frame.top + side.1 * row as f64,
                width: side.0,
                height: side.1,
            };
            phase.advance(1);
            Ok(Tile {
                look: Look::of(picture, part, degree),
                col: 2 * col,
                row: 2 * row,
                sides: 1,
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use ravec_raster::Size;

    #[test]
    fn tiles_come_row_by_row_and_the_mean_of_their_colors_is_that_of_the_picture() {
        let picture = Image::from_fn(Size::new(31, 17).unwrap(), |col, row| {
            Oklab([(col * 3 + row * 5) as f32 / 170.0, col as f32 / 31.0, 0.0])
        });
        let tiles = grid_tiles(&picture, Frame::of(&picture), 4, 3, 2, &Progress::none()).unwrap();
        assert_eq!((tiles[5].col, tiles[5].row, tiles.len()), (2, 2, 12));
        for channel in 0..2 {
            let mean: f32 = tiles
                .iter()
                .map(|tile| tile.look.coefficients[0][channel])
                .sum();
            let truth: f32 = picture.pixels().iter().map(|pixel| pixel.0[channel]).sum();
            assert!((mean / 12.0 - truth / (31.0 * 17.0)).abs() < 1e-5);
        }
    }
}

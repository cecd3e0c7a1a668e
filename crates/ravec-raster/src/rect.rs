//! Rectangles of whole pixels, and the tiles of a picture.

use crate::size::Size;

/// A rectangle of whole pixels: columns `col..right()`, rows `row..bottom()`. May be empty.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
pub struct Rect {
    /// First column.
    pub col: usize,
    /// First row.
    pub row: usize,
    /// Columns, 0 if empty.
    pub width: usize,
    /// Rows, 0 if empty.
    pub height: usize,
}

impl Rect {
    /// The rectangle that begins at `(col, row)`.
    pub fn new(col: usize, row: usize, width: usize, height: usize) -> Self {
        Self {
            col,
            row,
            width,
            height,
        }
    }

    /// The whole of a picture.
    pub fn of(size: Size) -> Self {
        Self::new(0, 0, size.width(), size.height())
    }

    /// The column after the last one.
    pub fn right(self) -> usize {
        self.col.saturating_add(self.width)
    }

    /// The row after the last one.
    pub fn bottom(self) -> usize {
        self.row.saturating_add(self.height)
    }

    /// Returns `true` if there is no pixel in it.
    pub fn is_empty(self) -> bool {
        self.width == 0 || self.height == 0
    }

    /// Columns × rows.
    pub fn pixels(self) -> usize {
        self.width.saturating_mul(self.height)
    }

    /// Its size as that of an image, unless it is empty or too large for one.
    pub fn size(self) -> Option<Size> {
        Size::new(self.width, self.height).ok()
    }

    /// Returns `true` if the pixel `(col, row)` lies in it.
    pub fn contains(self, col: usize, row: usize) -> bool {
        (self.col..self.right()).contains(&col) && (self.row..self.bottom()).contains(&row)
    }

    /// The pixels that both have. Empty (but not at a particular place) if there are none.
    pub fn intersection(self, other: Self) -> Self {
        let col = self.col.max(other.col);
        let row = self.row.max(other.row);
        Self::new(
            col,
            row,
            self.right().min(other.right()).saturating_sub(col),
            self.bottom().min(other.bottom()).saturating_sub(row),
        )
    }

    /// The part of it that lies in a picture.
    pub fn clipped(self, size: Size) -> Self {
        self.intersection(Self::of(size))
    }

    /// The smallest rectangle around both; an empty one adds nothing.
    pub fn bounding(self, other: Self) -> Self {
        if self.is_empty() {
            return other;
        }
        if other.is_empty() {
            return self;
        }
        let col = self.col.min(other.col);
        let row = self.row.min(other.row);
        Self::new(
            col,
            row,
            self.right().max(other.right()) - col,
            self.bottom().max(other.bottom()) - row,
        )
    }

    /// The rectangle with `margin_px` more on each side, cut off at column and row 0. An empty one stays as it is.
    pub fn grown(self, margin_px: usize) -> Self {
        if self.is_empty() {
            return self;
        }
        let col = self.col.saturating_sub(margin_px);
        let row = self.row.saturating_sub(margin_px);
        Self::new(
            col,
            row,
            self.right().saturating_add(margin_px) - col,
            self.bottom().saturating_add(margin_px) - row,
        )
    }
}

/// The tiles of `tile_px` × `tile_px` pixels that cover a picture without overlap, row by row; those at the right and
/// lower border are cut off there.
///
/// ```
/// use ravec_raster::{Rect, Size, tiles};
///
/// let found: Vec<_> = tiles(Size::new(5, 2)?, 4).collect();
/// assert_eq!(found, [Rect::new(0, 0, 4, 2), Rect::new(4, 0, 1, 2)]);
/// # Ok::<(), ravec_raster::SizeError>(())
/// ```
///
/// # Panics
/// If `tile_px` is 0.
pub fn tiles(size: Size, tile_px: usize) -> impl ExactSizeIterator<Item = Rect> {
    let grid = size.cells(tile_px);
    (0..grid.pixels()).map(move |index| {
        let (col, row) = (index % grid.width(), index / grid.width());
        Rect::new(col * tile_px, row * tile_px, tile_px, tile_px).clipped(size)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn rect() -> impl Strategy<Value = Rect> {
        (0usize..9, 0usize..9, 0usize..6, 0usize..6).prop_map(|(c, r, w, h)| Rect::new(c, r, w, h))
    }

    proptest! {
        #[test]
        fn a_pixel_is_in_the_intersection_if_it_is_in_both(a in rect(), b in rect()) {
            let (both, around) = (a.intersection(b), a.bounding(b));
            for (col, row) in (0..16).flat_map(|row| (0..16).map(move |col| (col, row))) {
                let (in_a, in_b) = (a.contains(col, row), b.contains(col, row));
                prop_assert_eq!(both.contains(col, row), in_a && in_b);
                prop_assert!(!(in_a || in_b) || around.contains(col, row));
            }
        }

        #[test]
        fn every_pixel_lies_in_exactly_one_tile(w in 1usize..20, h in 1usize..20, tile_px in 1usize..9) {
            let size = Size::new(w, h).unwrap();
            let mut seen = vec![0; size.pixels()];
            for tile in tiles(size, tile_px) {
                prop_assert!(!tile.is_empty() && tile.width <= tile_px && tile.height <= tile_px);
                for row in tile.row..tile.bottom() {
                    for col in tile.col..tile.right() {
                        seen[row * w + col] += 1;
                    }
                }
            }
            prop_assert!(seen.iter().all(|&count| count == 1));
        }
    }

    #[test]
    fn growing_stops_at_the_origin_and_leaves_the_empty_alone() {
        assert_eq!(Rect::new(1, 5, 2, 2).grown(3), Rect::new(0, 2, 6, 8));
        assert!(Rect::new(4, 4, 0, 3).grown(9).is_empty());
        assert_eq!(Rect::new(0, 0, 0, 3).size(), None);
    }

    #[test]
    fn sides_near_the_largest_number_do_not_overflow() {
        let huge = Rect::new(usize::MAX - 1, 0, usize::MAX, usize::MAX);
        let size = Size::new(4, 4).unwrap();
        assert!(huge.clipped(size).is_empty());
        assert_eq!(huge.grown(7).right(), usize::MAX);
    }
}

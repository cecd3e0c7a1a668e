//! The part of a picture that a stroke has painted, tile by tile: a slanted stroke fills little of its bounding rectangle.

use ravec_raster::{Rect, Size};

/// Tiles of a picture.
pub(crate) struct Tiles {
    size: Size,
    columns: usize,
    has: Vec<bool>,
    /// The tiles in the order in which they came.
    list: Vec<usize>,
    bounds: Rect,
}

impl Tiles {
    /// Side of a tile in pixels.
    pub const SIDE: usize = 64;

    /// No tile of a picture of this size.
    pub fn none(size: Size) -> Self {
        let cells = size.cells(Self::SIDE);
        Self {
            size,
            columns: cells.width(),
            has: vec![false; cells.pixels()],
            list: Vec::new(),
            bounds: Rect::default(),
        }
    }

    /// Adds the tiles of a region of the picture.
    pub fn add(&mut self, region: Rect) {
        if region.is_empty() {
            return;
        }
        self.bounds = self.bounds.bounding(region);
        for y in region.row / Self::SIDE..=(region.bottom() - 1) / Self::SIDE {
            for x in region.col / Self::SIDE..=(region.right() - 1) / Self::SIDE {
                let tile = y * self.columns + x;
                if !std::mem::replace(&mut self.has[tile], true) {
                    self.list.push(tile);
                }
            }
        }
    }

    /// Removes all tiles; returns the rectangle around all regions that were added.
    pub fn clear(&mut self) -> Rect {
        for tile in self.list.drain(..) {
            self.has[tile] = false;
        }
        std::mem::take(&mut self.bounds)
    }

    /// The pixels of each tile.
    pub fn rects(&self) -> impl Iterator<Item = Rect> {
        self.list.iter().map(|tile| {
            let (x, y) = (tile % self.columns, tile / self.columns);
            Rect::new(x * Self::SIDE, y * Self::SIDE, Self::SIDE, Self::SIDE)
                .intersection(Rect::of(self.size))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_cover_what_was_added_once_and_lie_in_the_picture() {
        let mut tiles = Tiles::none(Size::new(200, 100).unwrap());
        let regions = [
            Rect::new(3, 4, 10, 10),
            Rect::new(60, 60, 10, 10),
            Rect::new(190, 90, 10, 10),
            Rect::default(),
        ];
        for region in regions {
            tiles.add(region);
        }
        let rects: Vec<Rect> = tiles.rects().collect();
        assert_eq!(rects.len(), 6);
        let covers = |rect: &Rect, col, row| rect.contains(col, row);
        for region in &regions[..3] {
            for (col, row) in [
                (region.col, region.row),
                (region.right() - 1, region.bottom() - 1),
            ] {
                let count = rects.iter().filter(|rect| covers(rect, col, row)).count();
                assert_eq!(count, 1);
            }
        }
        assert!(
            rects
                .iter()
                .all(|rect| rect.right() <= 200 && rect.bottom() <= 100)
        );
        assert_eq!(tiles.clear(), Rect::new(3, 4, 197, 96));
        assert_eq!(tiles.rects().count(), 0);
        tiles.add(regions[0]);
        assert_eq!(tiles.clear(), regions[0]);
    }
}

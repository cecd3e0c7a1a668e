//! Two-color pixels where they lie on the image: what regular and adaptive fields have in common.

use crate::field::TwoColorField;
use crate::line::Line;
use crate::pixel::TwoColorPixel;
use glam::DVec2;
use ravec_raster::{Oklab, Rect, Size};
use std::ops::Range;

/// A two-color pixel and the square of the image that it stands for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlacedBlock<'a> {
    /// First column of the square.
    pub col_px: usize,
    /// First row of the square.
    pub row_px: usize,
    /// Side of the square. It may reach beyond the right and lower border of the image.
    pub side_px: usize,
    /// The line and the colors.
    pub pixel: &'a TwoColorPixel,
}

impl PlacedBlock<'_> {
    /// The part of the square that lies on the image.
    pub fn rect(&self, image_size: Size) -> Rect {
        Rect::new(self.col_px, self.row_px, self.side_px, self.side_px).clipped(image_size)
    }

    /// The line, seen from the upper left corner of the image; nothing for a flat block.
    pub fn line_in_image(&self) -> Option<Line> {
        let corner = DVec2::new(self.col_px as f64, self.row_px as f64);
        let center = corner + 0.5 * self.side_px as f64;
        self.pixel.line.map(|line| line.relative_to(-center))
    }

    /// The part of the line that lies in the block and on the image, from end to end; nothing for a flat block or a line that
    /// misses it.
    pub fn segment_in_image(&self, image_size: Size) -> Option<[DVec2; 2]> {
        let line = self.line_in_image()?;
        let rect = self.rect(image_size);
        let along = line.normal.perp();
        let foot = line.offset_px * line.normal;
        let borders = [
            (rect.col, rect.right(), foot.x, along.x),
            (rect.row, rect.bottom(), foot.y, along.y),
        ];
        // the range of the line's parameter in which it lies between each pair of borders
        let (mut first, mut last) = (f64::NEG_INFINITY, f64::INFINITY);
        for (low, high, start, slope) in borders {
            let (low, high) = (low as f64, high as f64);
            if slope.abs() < 1e-12 {
                if start < low || start > high {
                    return None;
                }
                continue;
            }
            let (a, b) = ((low - start) / slope, (high - start) / slope);
            first = first.max(a.min(b));
            last = last.min(a.max(b));
        }
        (first < last).then(|| [first, last].map(|at| foot + at * along))
    }

    /// Number of the block's pixels with their center on side 0 and on side 1; all count for side 0 in a flat block.
    pub fn pixels_per_side(&self, image_size: Size) -> [usize; 2] {
        let rect = self.rect(image_size);
        let Some(line) = self.line_in_image() else {
            return [rect.pixels(), 0];
        };
        let on_side_0 = (rect.row..rect.bottom())
            .flat_map(|row| (rect.col..rect.right()).map(move |col| (col, row)))
            .filter(|&(col, row)| {
                line.signed_distance(DVec2::new(col as f64 + 0.5, row as f64 + 0.5)) < 0.0
            })
            .count();
        [on_side_0, rect.pixels() - on_side_0]
    }

    /// The mean color of the block's pixels, weighted by alpha, and their mean alpha: what one color instead of two
    /// would be.
    pub fn mean(&self, image_size: Size) -> (Oklab, f32) {
        let [(c0, a0, n0), (c1, a1, n1)] = {
            let n = self.pixels_per_side(image_size).map(|n| n as f32);
            [0, 1].map(|side| (self.pixel.colors[side].0, self.pixel.alphas[side], n[side]))
        };
        let (w0, w1) = (a0 * n0, a1 * n1);
        if w0 + w1 <= 0.0 {
            return (self.pixel.colors[0], 0.0);
        }
        let share_1 = w1 / (w0 + w1);
        let color = std::array::from_fn(|c| c0[c] + (c1[c] - c0[c]) * share_1);
        (Oklab(color), (w0 + w1) / (n0 + n1))
    }
}

/// Two-color pixels whose squares tile an image without overlap.
pub trait BlockField: Sync {
    /// The size of the image that was fitted.
    fn image_size(&self) -> Size;

    /// The blocks that have a pixel in `rows` of the image, each once, in an order that depends on the field alone.
    fn blocks_in_rows(&self, rows: Range<usize>) -> impl Iterator<Item = PlacedBlock<'_>>;

    /// All blocks.
    fn placed_blocks(&self) -> impl Iterator<Item = PlacedBlock<'_>> {
        self.blocks_in_rows(0..self.image_size().height())
    }
}

impl BlockField for TwoColorField {
    fn image_size(&self) -> Size {
        self.image_size()
    }

    fn blocks_in_rows(&self, rows: Range<usize>) -> impl Iterator<Item = PlacedBlock<'_>> {
        let (side, grid) = (self.block_px(), self.grid_size());
        let last = rows.end.div_ceil(side).min(grid.height());
        (rows.start / side..last).flat_map(move |row| {
            (0..grid.width()).map(move |col| PlacedBlock {
                col_px: col * side,
                row_px: row * side,
                side_px: side,
                pixel: self.block(col, row),
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::field::FitParams;
    use ravec_progress::Progress;
    use ravec_raster::{Image, LinearRgba};

    fn noisy(width: usize, height: usize) -> Image<LinearRgba> {
        Image::from_fn(Size::new(width, height).unwrap(), |col, row| {
            let v = |k: usize| ((col * 37 + row * 91 + col * row * k) % 101) as f32 / 100.0;
            LinearRgba([v(3), v(5), v(7), v(11)])
        })
    }

    #[test]
    fn the_mean_is_that_of_the_pixels_also_where_the_border_clips() {
        let image = noisy(19, 13);
        let field = TwoColorField::fit(&image, &FitParams::default(), &Progress::none()).unwrap();
        for block in field.placed_blocks() {
            let rect = block.rect(image.size());
            let (mut sum, mut weight) = ([0.0f64; 3], 0.0f64);
            for (col, row) in (rect.row..rect.bottom())
                .flat_map(|row| (rect.col..rect.right()).map(move |col| (col, row)))
            {
                let pixel = image[(col, row)];
                let lab = ravec_raster::color::oklab_from_linear(pixel.rgb());
                weight += f64::from(pixel.alpha());
                for (sum, value) in sum.iter_mut().zip(lab) {
                    *sum += f64::from(pixel.alpha() * value);
                }
            }
            let (color, alpha) = block.mean(image.size());
            // sums of at most 64 values of size 1 in f32
            assert!((f64::from(alpha) - weight / rect.pixels() as f64).abs() < 1e-5);
            for (found, sum) in color.0.into_iter().zip(sum) {
                assert!((f64::from(found) - sum / weight).abs() < 1e-5);
            }
        }
    }

    #[test]
    fn segments_lie_on_their_lines_and_end_on_the_borders_of_their_blocks() {
        let image = noisy(19, 13);
        let field = TwoColorField::fit(&image, &FitParams::default(), &Progress::none()).unwrap();
        let mut found = 0;
        for block in field.placed_blocks() {
            let Some(ends) = block.segment_in_image(image.size()) else {
                continue;
            };
            found += 1;
            let line = block.line_in_image().unwrap();
            let rect = block.rect(image.size());
            for end in ends {
                assert!(line.signed_distance(end).abs() < 1e-9);
                let borders = [
                    end.x - rect.col as f64,
                    rect.right() as f64 - end.x,
                    end.y - rect.row as f64,
                    rect.bottom() as f64 - end.y,
                ];
                assert!(borders.iter().all(|distance| *distance > -1e-9));
                assert!(borders.iter().any(|distance| distance.abs() < 1e-9));
            }
        }
        assert!(found > 3);
        let pixel = TwoColorPixel {
            line: Some(Line::from_angle(0.0, 40.0)),
            ..TwoColorPixel::flat(Oklab([0.5, 0.0, 0.0]), 1.0, 0.0)
        };
        let beyond = PlacedBlock {
            col_px: 0,
            row_px: 0,
            side_px: 8,
            pixel: &pixel,
        };
        assert_eq!(beyond.segment_in_image(image.size()), None);
    }

    #[test]
    fn rows_name_the_blocks_that_they_cross() {
        let image = noisy(20, 20);
        let field = TwoColorField::fit(&image, &FitParams::default(), &Progress::none()).unwrap();
        let rows = |rows: Range<usize>| {
            let mut found: Vec<usize> = field.blocks_in_rows(rows).map(|b| b.row_px).collect();
            found.dedup();
            found
        };
        assert_eq!(rows(0..1), [0]);
        assert_eq!(rows(7..9), [0, 8]);
        assert_eq!(rows(8..16), [8]);
        assert_eq!(rows(19..20), [16]);
        assert_eq!(field.placed_blocks().count(), 9);
    }
}

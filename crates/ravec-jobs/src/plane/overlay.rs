//! Lines drawn over a picture.

use glam::DVec2;
use ravec::planar::QuadGrid;
use ravec::raster::{Image, LinearRgba, Size};

/// A color in linear light.
pub type Color = [f32; 3];

/// Color of the input grid.
pub const BEFORE: Color = [1.0, 0.55, 0.0];
/// Color of the result.
pub const AFTER: Color = [0.0, 0.85, 0.25];

/// A width that can be seen in a picture of this size: three pixels of two thousand, or a quarter of the shorter side of a
/// strip, which a line would else fill.
pub fn line_width(size: Size) -> f64 {
    let (width, height) = (size.width() as f64, size.height() as f64);
    let share = 1.5e-3 * width.hypot(height);
    share.min(0.25 * width.min(height)).max(1.2)
}

/// Draws the stretch from `a` to `b`, `width_px` wide, with smooth borders. What is not finite, or far outside, is not drawn.
pub fn draw_line(image: &mut Image<LinearRgba>, [a, b]: [DVec2; 2], width_px: f64, color: Color) {
    let extent = DVec2::new(image.width() as f64, image.height() as f64);
    let (low, high) = (a.min(b) - width_px, a.max(b) + width_px);
    if !(a.is_finite() && b.is_finite()) {
        return;
    }
    let (low, high) = (low.max(DVec2::ZERO), high.min(extent));
    let along = b - a;
    let square = along.length_squared();
    for row in low.y as usize..high.y.ceil() as usize {
        // where the line is within reach in this row
        let y = row as f64 + 0.5;
        let (mut left, mut right) = (low.x, high.x);
        if along.y.abs() > 1e-9 {
            let x = a.x + (y - a.y) / along.y * along.x;
            let reach = (width_px + 1.0) * square.sqrt() / along.y.abs();
            left = left.max(x - reach);
            right = right.min(x + reach);
        }
        for col in left.max(0.0) as usize..(right.ceil().max(0.0) as usize).min(image.width()) {
            let at = DVec2::new(col as f64 + 0.5, y);
            let share = if square > 0.0 {
                ((at - a).dot(along) / square).clamp(0.0, 1.0)
            } else {
                0.0
            };
            let distance = at.distance(a + share * along);
            let cover = (0.5 * width_px + 0.5 - distance).clamp(0.0, 1.0) as f32;
            if cover > 0.0 {
                let pixel = &mut image[(col, row)];
                for (channel, value) in pixel.0.iter_mut().zip([color[0], color[1], color[2], 1.0])
                {
                    *channel += cover * (value - *channel);
                }
            }
        }
    }
}

/// Draws all lines of a grid, its border twice as wide.
pub fn draw_grid(image: &mut Image<LinearRgba>, grid: &QuadGrid, width_px: f64, color: Color) {
    let columns =
        (0..=grid.columns()).map(|k| (grid.column_line(k), k == 0 || k == grid.columns()));
    let rows = (0..=grid.rows()).map(|k| (grid.row_line(k), k == 0 || k == grid.rows()));
    for (ends, border) in columns.chain(rows) {
        draw_line(
            image,
            ends,
            if border { 1.6 * width_px } else { width_px },
            color,
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_fit_into_strips_and_are_seen_in_large_pictures() {
        let width = |width, height| line_width(Size::new(width, height).unwrap());
        assert_eq!(width(2000, 1500), 1.5e-3 * 2500.0);
        assert_eq!(width(100, 100), 1.2);
        assert_eq!(width(20_000_000, 1), 1.2);
        assert_eq!(width(40, 1_000_000), 10.0);
    }

    #[test]
    fn a_line_covers_its_area_and_nothing_breaks_it() {
        let black = LinearRgba([0.0, 0.0, 0.0, 1.0]);
        let mut image = Image::new(Size::new(60, 50).unwrap(), black);
        draw_line(
            &mut image,
            [DVec2::new(10.0, 10.0), DVec2::new(50.0, 40.0)],
            3.0,
            [1.0; 3],
        );
        let sum: f32 = image.pixels().iter().map(|pixel| pixel.0[0]).sum();
        // 50 long, 3 wide, round ends of 1.5 pixels
        assert!((sum - 157.0).abs() < 6.0, "{sum}");
        let before = image.clone();
        for end in [DVec2::NAN, DVec2::INFINITY] {
            draw_line(&mut image, [DVec2::ZERO, end], 3.0, [1.0; 3]);
        }
        draw_line(
            &mut image,
            [DVec2::new(-9e9, -50.0), DVec2::new(9e9, -50.0)],
            3.0,
            [1.0; 3],
        );
        assert_eq!(image, before);
        draw_line(
            &mut image,
            [DVec2::new(-9e9, 25.0), DVec2::new(9e9, 25.0)],
            2.0,
            [1.0; 3],
        );
        assert_eq!(image[(30, 24)], LinearRgba([1.0; 4]));
    }
}

//! Pictures as a screen shows them: 8 bits, at several sizes.

use ravec::raster::{AnyImage, Image, Srgba, with_image};

/// Shorter side below which no smaller size is made, in pixels.
const MIN_SIDE: usize = 64;

/// A picture at several sizes, each half of the one before. Alpha is straight.
#[derive(Debug, Clone)]
pub struct Shown {
    /// Columns, rows and pixels, the full size first.
    pub levels: Vec<ShownLevel>,
}

/// One size.
#[derive(Debug, Clone)]
pub struct ShownLevel {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Red, green, blue and alpha of each pixel, row by row.
    pub pixels: Vec<[u8; 4]>,
}

impl Shown {
    /// All sizes of a picture.
    pub fn new(image: &AnyImage) -> Self {
        let full: Image<Srgba<u8>> = with_image!(image, image => image.convert());
        let mut levels = vec![ShownLevel {
            width: full.width(),
            height: full.height(),
            pixels: full.pixels().iter().map(|pixel| pixel.0).collect(),
        }];
        while let Some(last) = levels.last()
            && last.width.min(last.height) >= 2 * MIN_SIDE
        {
            levels.push(last.halved());
        }
        Self { levels }
    }

    /// Columns and rows of the full size.
    pub fn size(&self) -> [usize; 2] {
        [self.levels[0].width, self.levels[0].height]
    }

    /// The smallest size that shows a picture at `zoom` screen pixels a pixel without blur.
    pub fn level_for(&self, zoom: f32) -> usize {
        let halvings = (-zoom.max(1e-6).log2()).floor().max(0.0);
        (halvings as usize).min(self.levels.len() - 1)
    }
}

impl ShownLevel {
    /// The means of 2 × 2 pixels.
    fn halved(&self) -> Self {
        let (width, height) = (self.width / 2, self.height / 2);
        let mut pixels = Vec::with_capacity(width * height);
        for row in 0..height {
            let upper = &self.pixels[2 * row * self.width..][..self.width];
            let lower = &self.pixels[(2 * row + 1) * self.width..][..self.width];
            for (a, b) in upper.chunks_exact(2).zip(lower.chunks_exact(2)) {
                pixels.push(std::array::from_fn(|k| {
                    let sum = [a[0], a[1], b[0], b[1]].map(|pixel| u16::from(pixel[k]));
                    ((sum.iter().sum::<u16>() + 2) / 4) as u8
                }));
            }
        }
        Self {
            width,
            height,
            pixels,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ravec::raster::{Size, Srgb};

    #[test]
    fn sizes_halve_and_keep_the_mean() {
        let size = Size::new(300, 200).unwrap();
        let image = Image::from_fn(size, |col, _| {
            Srgb([if col % 2 == 0 { 100u8 } else { 200 }; 3])
        });
        let shown = Shown::new(&AnyImage::from(image));
        assert_eq!(shown.levels.len(), 2);
        assert_eq!(shown.levels[1].pixels[0], [150, 150, 150, 255]);
        assert_eq!(
            (
                shown.level_for(1.0),
                shown.level_for(0.5),
                shown.level_for(0.01)
            ),
            (0, 1, 1)
        );
    }
}

//! Why a photo is not worth a tile, as far as its pixels say.

use ravec_raster::{Image, Oklab};

/// Why a photo is left out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Flaw {
    /// Its shorter side has fewer than [`MIN_SIDE`] pixels.
    Tiny,
    /// It is nearly one color all over.
    Contentless,
    /// It has a frame of one color on all sides, or bars on two opposite ones.
    Framed,
}

impl Flaw {
    /// The flaw as one word.
    pub fn name(self) -> &'static str {
        match self {
            Self::Tiny => "tiny",
            Self::Contentless => "contentless",
            Self::Framed => "framed",
        }
    }
}

/// The shorter side below which a photo is tiny, in pixels.
pub const MIN_SIDE: usize = 48;

/// The root mean square difference from the mean color, in Oklab, below which a photo has no content. A blank scan with the
/// noise of the sensor has 0.01, a blue sky from top to bottom 0.04.
const CONTENT: f32 = 0.02;

/// Largest distance of the pixels of a frame from its color.
const FRAME_NOISE: f32 = 0.03;

/// Least share of a side that a frame covers, so that a dark border of one pixel does not count.
const FRAME_SHARE: f64 = 0.03;

/// The flaw of a photo, if it has one. `image` is a reduced version, `short_side` is of the photo itself.
pub fn flaw(image: &Image<Oklab>, short_side: usize) -> Option<Flaw> {
    if short_side < MIN_SIDE {
        return Some(Flaw::Tiny);
    }
    let count = image.size().pixels() as f32;
    let mean = image.pixels().iter().fold([0.0f32; 3], |mut sum, pixel| {
        for (sum, value) in sum.iter_mut().zip(pixel.0) {
            *sum += value / count;
        }
        sum
    });
    let spread: f32 = image
        .pixels()
        .iter()
        .map(|pixel| apart_sq(pixel.0, mean) / count)
        .sum();
    if spread < CONTENT * CONTENT {
        return Some(Flaw::Contentless);
    }
    let (width, height) = (image.width(), image.height());
    let column = |col: usize| (0..height).map(move |row| image[(col, row)].0);
    let row = |row: usize| (0..width).map(move |col| image[(col, row)].0);
    let left = uniform((0..width).map(column));
    let right = uniform((0..width).rev().map(column));
    let top = uniform((0..height).map(row));
    let bottom = uniform((0..height).rev().map(row));
    let both = |a: usize, b: usize, side: usize| {
        let least = (FRAME_SHARE * side as f64).max(1.0);
        // bars of very different width are rather a wall beside a window
        let (thin, thick) = (a.min(b) as f64, a.max(b) as f64);
        thin >= least && thick <= 2.0 * thin + 1.0
    };
    (both(left, right, width) || both(top, bottom, height)).then_some(Flaw::Framed)
}

fn apart_sq(a: [f32; 3], b: [f32; 3]) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum()
}

/// Number of lines of one color from the border on.
fn uniform<L: Iterator<Item = [f32; 3]>>(lines: impl Iterator<Item = L>) -> usize {
    let mut color = None;
    let same = |mut line: L| {
        line.all(|pixel| apart_sq(pixel, *color.get_or_insert(pixel)) <= FRAME_NOISE * FRAME_NOISE)
    };
    lines.map(same).take_while(|&same| same).count()
}

#[cfg(test)]
mod tests {
    use super::*;
    use ravec_raster::Size;

    fn picture(color: impl Fn(usize, usize) -> f32) -> Image<Oklab> {
        Image::from_fn(Size::new(48, 32).unwrap(), |col, row| {
            Oklab([color(col, row), 0.0, 0.0])
        })
    }

    #[test]
    fn each_flaw_is_seen_and_a_photo_has_none() {
        let busy = |col: usize, row: usize| ((col * 7 + row * 5) % 11) as f32 / 11.0;
        assert_eq!(flaw(&picture(busy), 300), None);
        assert_eq!(flaw(&picture(busy), 47), Some(Flaw::Tiny));
        let blank = |col: usize, _: usize| 0.9 + 0.01 * (col % 2) as f32;
        assert_eq!(flaw(&picture(blank), 300), Some(Flaw::Contentless));
        let bars = |col: usize, row: usize| {
            if (4..28).contains(&row) {
                busy(col, row)
            } else {
                0.0
            }
        };
        assert_eq!(flaw(&picture(bars), 300), Some(Flaw::Framed));
        let sky = |col: usize, row: usize| if row < 12 { 0.8 } else { busy(col, row) };
        assert_eq!(flaw(&picture(sky), 300), None);
    }
}

//! The part of the old picture that a tile of the new one sees, ready to be filtered: in linear light, premultiplied, and going
//! on beyond its borders, so that no filter asks where it is.

use glam::{DVec2, Vec4, dvec2};
use ravec_raster::{Color, Image, LinearRgba};

/// Pixels of the old picture, each as red, green, blue and alpha.
#[derive(Default)]
pub(super) struct Window {
    first: [isize; 2],
    width: usize,
    height: usize,
    pixels: Vec<[f32; 4]>,
}

impl Window {
    /// Takes what a filter sees that reaches from `low` to `high`, and three columns more.
    pub(super) fn fill<P: Color>(&mut self, image: &Image<P>, [low, high]: [DVec2; 2]) {
        // one more at each end, for what is rounded
        let first = (low - 0.5).ceil() - 1.0;
        let last = (high - 0.5).floor() + dvec2(4.0, 1.0);
        self.first = [first.x as isize, first.y as isize];
        self.width = (last.x - first.x) as usize + 1;
        self.height = (last.y - first.y) as usize + 1;
        self.pixels.clear();
        self.pixels.reserve(self.width * self.height);
        let last = image.width() as isize - 1;
        for row in 0..self.height {
            let y = (self.first[1] + row as isize).clamp(0, image.height() as isize - 1);
            let pixels = image.row(y as usize);
            let (from, to) = (self.first[0], self.first[0] + self.width as isize);
            let before = (-from).clamp(0, self.width as isize) as usize;
            let after = (to - 1 - last).clamp(0, (self.width - before) as isize) as usize;
            let inside = &pixels[from.max(0) as usize..][..self.width - before - after];
            let window = &mut self.pixels;
            window.extend(std::iter::repeat_n(premultiplied(pixels[0]), before));
            window.extend(inside.iter().map(|&pixel| premultiplied(pixel)));
            window.extend(std::iter::repeat_n(
                premultiplied(pixels[last as usize]),
                after,
            ));
        }
    }

    /// Its upper left corner in the old picture.
    pub(super) fn origin(&self) -> DVec2 {
        dvec2(self.first[0] as f64, self.first[1] as f64)
    }

    /// Its pixels as numbers, and the length of a row.
    #[inline(always)]
    pub(super) fn numbers(&self) -> (&[f32], usize) {
        (self.pixels.as_flattened(), 4 * self.width)
    }

    /// Between the four pixels around a place in the old picture.
    #[inline(always)]
    pub(super) fn bilinear(&self, at: DVec2) -> [f32; 4] {
        let [x, y] = (at - self.origin() - 0.5).to_array();
        let (col, row) = (x as usize, y as usize);
        let (u, v) = ((x - col as f64) as f32, (y - row as f64) as f32);
        let at = row * self.width + col;
        let line = |at: usize| {
            let pixels = [at, at + 1].map(|at| Vec4::from_array(self.pixels[at]));
            pixels[0].lerp(pixels[1], u)
        };
        line(at).lerp(line(at + self.width), v).to_array()
    }
}

#[inline(always)]
fn premultiplied<P: Color>(pixel: P) -> [f32; 4] {
    let LinearRgba([r, g, b, alpha]) = pixel.to_linear();
    if P::HAS_ALPHA {
        [r * alpha, g * alpha, b * alpha, alpha]
    } else {
        [r, g, b, 1.0]
    }
}

//! A reduced frame at several sizes.

use glam::{DMat3, DVec2, dvec2};
use ravec_raster::{Plane, Reduction, gaussian_blur, halved};

/// Blur before sampling, in working pixels: bilinear samples of a sharp picture would pull motion towards whole pixels.
const BLUR_PX: f64 = 1.0;

/// The coarsest level has its longer side at most this long: the search for the start tries every shift there.
const COARSE_PX: usize = 72;

/// A level whose shorter side is below this is not halved further: nothing could be compared there.
const MIN_SIDE_PX: usize = 20;

/// Deviation of the blur that is subtracted before shifts are compared, in coarse pixels. It takes out light.
const SURROUND_PX: f64 = 3.0;

/// Luma from which a pixel is white.
const WHITE: f32 = 0.98;

/// Bins of the histogram.
const BINS: usize = 32;

/// A frame, reduced.
#[derive(Debug, Clone)]
pub(super) struct Picture {
    /// Blurred luma, finest first; each level has half the pixels of the one before in each direction.
    pub levels: Vec<Plane>,
    /// The coarsest level without its local mean.
    pub detail: Plane,
    /// The mean of the absolute values of `detail`.
    pub contrast: f32,
    /// The share of white pixels.
    pub white: f32,
    histogram: [f32; BINS],
}

impl Picture {
    pub fn new(luma: &Plane) -> Self {
        let mut levels = vec![gaussian_blur(luma, BLUR_PX)];
        while let Some(last) = levels.last()
            && last.width().max(last.height()) > COARSE_PX
            && last.width().min(last.height()) >= 2 * MIN_SIDE_PX
        {
            levels.push(halved(last, Reduction::Gaussian));
        }
        let coarse = &levels[levels.len() - 1];
        let mut detail = gaussian_blur(coarse, SURROUND_PX);
        for (low, &value) in detail.pixels_mut().iter_mut().zip(coarse.pixels()) {
            *low = value - *low;
        }
        let sum: f32 = detail.pixels().iter().map(|v| v.abs()).sum();
        let contrast = sum / detail.size().pixels() as f32;
        let histogram = histogram(luma);
        let white = luma.pixels().iter().filter(|&&v| v >= WHITE).count();
        Self {
            levels,
            detail,
            contrast,
            white: white as f32 / luma.size().pixels() as f32,
            histogram,
        }
    }

    /// Half the sum of the differences of the shares in each bin of luma, 0 to 1.
    pub fn histogram_difference(&self, other: &Self) -> f64 {
        let pairs = self.histogram.iter().zip(&other.histogram);
        0.5 * f64::from(pairs.map(|(a, b)| (a - b).abs()).sum::<f32>())
    }

    /// The coordinates of this picture.
    pub fn frame(&self) -> Frame {
        Frame::new(self.levels[0].width(), self.levels[0].height())
    }
}

/// Shares of the bins of luma after mean and deviation are brought to those of a standard picture, each pixel spread over
/// two bins: a change of exposure leaves it nearly as it is.
fn histogram(luma: &Plane) -> [f32; BINS] {
    let n = luma.size().pixels() as f32;
    let mean = luma.pixels().iter().sum::<f32>() / n;
    let variance = luma
        .pixels()
        .iter()
        .map(|v| (v - mean).powi(2))
        .sum::<f32>()
        / n;
    // five deviations over all bins
    let scale = BINS as f32 / (5.0 * variance.sqrt().max(0.01));
    let mut bins = [0.0; BINS];
    for &value in luma.pixels() {
        let place = (0.5 * BINS as f32 + (value - mean) * scale).clamp(0.0, BINS as f32 - 1.001);
        let bin = place as usize;
        let share = place - bin as f32;
        bins[bin] += 1.0 - share;
        bins[bin + 1] += share;
    }
    bins.map(|bin| bin / n)
}

/// Normalized coordinates: origin in the middle, half the diagonal is 1. They are the same at all levels, so that a map
/// between them needs no scaling from level to level.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Frame {
    pub center: DVec2,
    /// Half the diagonal in working pixels.
    pub half: f64,
}

impl Frame {
    pub fn new(width: usize, height: usize) -> Self {
        let center = 0.5 * dvec2(width as f64, height as f64);
        Self {
            center,
            half: center.length(),
        }
    }

    /// The same frame in pixels of a level.
    pub fn at_level(self, level: usize) -> Self {
        let shrink = 0.5f64.powi(level as i32);
        Self {
            center: self.center * shrink,
            half: self.half * shrink,
        }
    }

    /// Corners in normalized coordinates.
    pub fn corners(self) -> [DVec2; 4] {
        let c = self.center / self.half;
        [-c, dvec2(c.x, -c.y), c, dvec2(-c.x, c.y)]
    }

    /// A map between frames in pixels `factor` times smaller than working pixels.
    pub fn to_pixels(self, normalized: DMat3, factor: f64) -> DMat3 {
        let pixels_from_normalized = DMat3::from_translation(self.center * factor)
            * DMat3::from_scale(DVec2::splat(self.half * factor));
        pixels_from_normalized * normalized * pixels_from_normalized.inverse()
    }

    /// The mean distance, in working pixels, by which two maps differ at the corners. Infinite if one has its horizon there.
    pub fn corner_distance(self, a: &DMat3, b: &DMat3) -> f64 {
        let apply = |m: &DMat3, p: DVec2| {
            let image = *m * p.extend(1.0);
            (image.z > 0.0).then(|| image.truncate() / image.z)
        };
        let distances = self.corners().map(|corner| {
            apply(a, corner)
                .zip(apply(b, corner))
                .map_or(f64::INFINITY, |(p, q)| p.distance(q))
        });
        0.25 * distances.iter().sum::<f64>() * self.half
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ravec_raster::Size;

    #[test]
    fn a_change_of_exposure_hardly_changes_the_histogram() {
        let size = Size::new(96, 64).unwrap();
        let luma = Plane::from_fn(size, |col, row| {
            0.3 + 0.2 * ((col * row) as f32 / 97.0).sin()
        });
        let bright = Plane::from_fn(size, |col, row| 0.1 + 1.3 * luma[(col, row)]);
        let other = Plane::from_fn(size, |col, row| ((col / 32 + row / 32) % 2) as f32);
        let [a, b, c] = [&luma, &bright, &other].map(Picture::new);
        assert!(a.histogram_difference(&b) < 0.02);
        assert!(a.histogram_difference(&c) > 0.4);
    }

    #[test]
    fn normalized_maps_become_maps_of_pixels() {
        let frame = Frame::new(200, 100);
        let shift = DMat3::from_translation(dvec2(0.1, 0.0));
        let moved = frame.to_pixels(shift, 3.0) * dvec2(30.0, 60.0).extend(1.0);
        let expected = 30.0 + 0.1 * frame.half * 3.0;
        assert!((moved.x / moved.z - expected).abs() < 1e-9);
        let distance = frame.corner_distance(&DMat3::IDENTITY, &shift);
        assert!((distance - 0.1 * frame.half).abs() < 1e-9);
    }

    #[test]
    fn tiny_frames_have_one_level() {
        for (width, height) in [(1, 1), (2, 7), (39, 39)] {
            let picture = Picture::new(&Plane::new(Size::new(width, height).unwrap(), 0.5));
            assert_eq!(picture.levels.len(), 1);
        }
    }
}

//! The picture as the engines see it.
//!
//! Colors are encoded (perceived differences matter here, not light) and multiplied by alpha, so that what is invisible
//! does not count.

use ravec_progress::{Cancelled, Progress};
use ravec_raster::color::{linear_from_srgb, srgb_from_linear};
use ravec_raster::{Color, Image, LinearRgba, Mask, Rect};
use rayon::prelude::*;

/// An encoded color multiplied by its alpha, and the alpha.
pub(crate) type Ink = [f32; 4];

/// The color is known.
pub(crate) const KNOWN: u8 = 1;
/// May be copied from.
pub(crate) const SOURCE: u8 = 2;
/// Is to be filled.
pub(crate) const HOLE: u8 = 4;
/// The gradient is known as well.
pub(crate) const STEADY: u8 = 8;

/// Sources keep this distance from a hole, whose rim is often a little of both.
const CLEAR_PX: f64 = 2.0;
/// So far does the kernel reach with which sources are sampled. The old content of the hole must not show there.
const KERNEL_PX: usize = 2;

/// A picture with what is known about each pixel: bits of [`KNOWN`], [`SOURCE`], [`HOLE`].
#[derive(Debug, Clone)]
pub(crate) struct Canvas {
    pub(crate) inks: Image<Ink>,
    pub(crate) states: Image<u8>,
}

impl Canvas {
    /// A picture of which the pixels of `hole` are not known, not even those covered in part.
    pub(crate) fn new<P: Color>(
        image: &Image<P>,
        hole: &Mask,
        progress: &Progress,
    ) -> Result<Self, Cancelled> {
        let mut states = Image::new(image.size(), KNOWN | SOURCE);
        let mut inks = Image::new(image.size(), [0.0; 4]);
        inks.par_rows_mut()
            .zip(image.par_rows())
            .for_each(|(inks, pixels)| {
                if progress.is_cancelled() {
                    return;
                }
                for (ink, &pixel) in inks.iter_mut().zip(pixels) {
                    *ink = ink_of(pixel);
                }
            });
        progress.check()?;
        let reach = CLEAR_PX.ceil() as usize;
        if let Some(bounds) = hole.bounding_box() {
            // nothing changes beyond the surroundings of the hole
            let bounds = bounds.grown(reach).clipped(image.size());
            let size = bounds.size().expect("there is a hole in it");
            let at = |col: usize, row: usize| hole.at(bounds.col + col, bounds.row + row);
            let clear = Mask::from_fn(size, |col, row| at(col, row) > 0.0).dilate(CLEAR_PX);
            for row in 0..size.height() {
                for col in 0..size.width() {
                    states[(bounds.col + col, bounds.row + row)] =
                        match (at(col, row) > 0.0, clear.at(col, row) > 0.0) {
                            (true, _) => 0,
                            (false, true) => KNOWN,
                            (false, false) => KNOWN | SOURCE,
                        };
                }
            }
            forget(&mut inks, &states, bounds);
        }
        Ok(Self { inks, states })
    }
}

/// Replaces what is not known, all of it in `bounds`, by the mean of known neighbors, as far as a kernel reaches, and by nothing beyond.
fn forget(inks: &mut Image<Ink>, states: &Image<u8>, bounds: Rect) {
    let mut unknown: Vec<(usize, usize)> = Vec::new();
    let mut known = states.map(|state| u8::from(state & KNOWN != 0));
    for row in bounds.row..bounds.bottom() {
        for col in bounds.col..bounds.right() {
            if known[(col, row)] == 0 {
                inks[(col, row)] = [0.0; 4];
                unknown.push((col, row));
            }
        }
    }
    for _ in 0..KERNEL_PX {
        let mut found = Vec::new();
        for &(col, row) in &unknown {
            let (mut sum, mut count) = ([0.0f32; 4], 0.0f32);
            for k in 0..9 {
                let place = ((col + k % 3).wrapping_sub(1), (row + k / 3).wrapping_sub(1));
                if known.get(place.0, place.1) == Some(1) {
                    count += 1.0;
                    for (sum, value) in sum.iter_mut().zip(inks[place]) {
                        *sum += value;
                    }
                }
            }
            if count > 0.0 {
                found.push(((col, row), sum.map(|value| value / count)));
            }
        }
        for (place, ink) in found {
            inks[place] = ink;
            known[place] = 1;
        }
        unknown.retain(|&place| known[place] == 0);
    }
}

/// The covered pixels of a mask within a window around all of them, `margin_px` wide, and that window; none if there
/// are no such pixels. A filter that reads no farther than the margin sees no difference, and a large picture costs no
/// more than its hole.
pub(crate) fn solid_window(mask: &Mask, margin_px: usize) -> Option<(Mask, Rect)> {
    let window = mask.bounding_box()?.grown(margin_px).clipped(mask.size());
    let covered = |col: usize, row: usize| mask.at(window.col + col, window.row + row) > 0.0;
    Some((Mask::from_fn(window.size()?, covered), window))
}

/// The ink of a pixel. NaN becomes 0, an infinite value the nearest finite one.
pub(crate) fn ink_of<P: Color>(pixel: P) -> Ink {
    let linear = pixel.to_linear();
    let alpha = if linear.alpha() > 0.0 {
        linear.alpha().min(1.0)
    } else {
        0.0
    };
    let [r, g, b] = linear.rgb().map(|value| {
        let encoded = srgb_from_linear(value) * alpha;
        if encoded.is_nan() {
            0.0
        } else {
            encoded.clamp(-1e3, 1e3)
        }
    });
    [r, g, b, alpha]
}

/// A pixel of which the share `coverage` (0 to 1) is replaced by the ink.
pub(crate) fn mixed<P: Color>(pixel: P, ink: Ink, coverage: f32) -> P {
    let [r, g, b, alpha] = ink;
    let alpha = alpha.clamp(0.0, 1.0);
    let scale = if alpha > 0.0 { alpha.recip() } else { 0.0 };
    let new = LinearRgba::from_rgb_alpha([r, g, b].map(|v| linear_from_srgb(v * scale)), alpha);
    if coverage >= 1.0 {
        return P::from_linear(new);
    }
    let old = pixel.to_linear();
    // where the old color is unknown, as it may be in a hole, nothing of it is left
    let (old_share, new_share) = ((1.0 - coverage) * old.alpha(), coverage * alpha);
    let sum = old_share + new_share;
    if sum <= 0.0 || sum.is_nan() {
        return P::from_linear(LinearRgba::default());
    }
    let mix = |c: usize| (old_share * old.0[c] + new_share * new.0[c]) / sum;
    P::from_linear(LinearRgba([mix(0), mix(1), mix(2), sum]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use ravec_raster::{Srgb, Srgba};

    #[test]
    fn every_8_bit_color_survives_as_ink() {
        for value in 0..=255u8 {
            let opaque = Srgb([value, 255 - value, 7]);
            assert_eq!(mixed(opaque, ink_of(opaque), 1.0), opaque);
        }
        let glass = Srgba([200u8, 100, 50, 128]);
        assert_eq!(mixed(glass, ink_of(glass), 1.0), glass);
    }

    #[test]
    fn a_half_covered_pixel_is_mixed_in_light() {
        let gray = mixed(Srgb([0u8; 3]), ink_of(Srgb([255u8; 3])), 0.5);
        assert_eq!(gray, Srgb([188; 3]));
    }

    #[test]
    fn numbers_that_are_none_become_some() {
        let odd = LinearRgba([f32::NAN, f32::INFINITY, -1.0, 1.0]);
        assert!(ink_of(odd).iter().all(|v| v.is_finite()));
    }
}

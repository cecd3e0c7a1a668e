//! The modes of the operator that need one pixel and the window around it: abstract, smooth, sharpen, antialias.

use crate::dense::CenteredWindow;
use crate::operator::Mode;
use ravec_raster::LinearRgba;
use ravec_raster::color::{linear_from_oklab, oklab_from_linear};

/// Properties of a window that the pointwise modes need.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sides {
    /// Oklab color of the pixel's own side.
    pub own: [f32; 3],
    /// Oklab color of the other side.
    pub other: [f32; 3],
    /// The share of the pixel's area on its own side of the line.
    pub coverage: f32,
    /// Share of the window that two colors explain, 0 to 1.
    pub quality: f32,
    /// The mean squared distance of the window's pixels from the color of their side.
    pub variance: f32,
    /// Distance of the line from the pixel's center, relative to the distance at which it leaves the window: 0 to about
    /// 1.
    pub remoteness: f32,
}

impl Sides {
    pub fn of(window: &CenteredWindow, window_px: usize) -> Self {
        let coverage = window.fit.line.map_or(1.0, |line| {
            let side_0 = line.coverage(glam::DVec2::ZERO) as f32;
            if window.own_side == 0 {
                side_0
            } else {
                1.0 - side_0
            }
        });
        Self {
            own: window.own_color().0,
            other: window.other_color().0,
            coverage,
            quality: quality(window.fit.error, window.fit.contrast()),
            variance: window.fit.error,
            remoteness: window.fit.line.map_or(1.0, |line| {
                (line.offset_px.abs() / (0.5 * window_px as f64)) as f32
            }),
        }
    }
}

/// Quality of the explanation of a window by two colors: 1 if complete, 0 if the rest is a quarter of the energy of an
/// edge of their contrast.
pub(crate) fn quality(error: f32, contrast: f32) -> f32 {
    if contrast <= 0.0 {
        return 0.0;
    }
    let left = error / (0.25 * contrast * contrast);
    let kept = (1.0 - 4.0 * left).max(0.0);
    kept * (2.0 - kept)
}

/// The new color of a pixel in one of the pointwise modes.
pub(crate) fn apply(mode: Mode, pixel: LinearRgba, sides: &Sides) -> LinearRgba {
    if pixel.alpha() <= 0.0 {
        return pixel;
    }
    let here = oklab_from_linear(pixel.rgb());
    // a pixel that is not a number, or has one in its window, stays as it is
    if here
        .iter()
        .chain(&sides.own)
        .chain(&sides.other)
        .any(|v| !v.is_finite())
    {
        return pixel;
    }
    let color = match mode {
        Mode::Smooth => {
            // a pixel that stands out of its side is a detail, not noise
            let deviation_sq = distance_sq(here, sides.own);
            let noise = DETAIL_SIGMAS * DETAIL_SIGMAS * sides.variance;
            let share = if deviation_sq > 0.0 {
                noise / (noise + deviation_sq)
            } else {
                0.0
            };
            std::array::from_fn(|c| here[c] + share * (sides.own[c] - here[c]))
        }
        Mode::Sharpen => sharpened(here, sides),
        Mode::Antialias => {
            let [own, other] = [sides.own, sides.other].map(linear_from_oklab);
            let mixture: [f32; 3] = std::array::from_fn(|c| {
                sides.coverage * own[c] + (1.0 - sides.coverage) * other[c]
            });
            // only where the line crosses the pixel or its neighbor, and two colors are the truth
            let share = if sides.coverage < 1.0 {
                sides.quality
            } else {
                0.0
            };
            let mixture = LinearRgba::from_rgb_alpha(mixture, pixel.alpha());
            return mixed(pixel, mixture, share);
        }
        _ => sides.own,
    };
    LinearRgba::from_rgb_alpha(linear_from_oklab(color), pixel.alpha())
}

/// Deviation of a pixel from its side, in standard deviations, at which it moves half of the way: at 1 and 2 it moves
/// nine tenths and seven tenths. Smaller leaves noise, larger takes small details away.
const DETAIL_SIGMAS: f32 = 3.0;

/// A pixel of a soft edge moves along the axis between the two colors to where an ideal edge has it: by the share of its
/// area on either side of the line. So soft slopes become steep, and pixels that show an ideal edge already, stairs and
/// smooth mixtures alike, stay. Never towards the other side.
fn sharpened(here: [f32; 3], sides: &Sides) -> [f32; 3] {
    let axis: [f32; 3] = std::array::from_fn(|c| sides.own[c] - sides.other[c]);
    let length_sq: f32 = axis.iter().map(|v| v * v).sum();
    if length_sq <= 0.0 {
        return here;
    }
    // where the pixel is between the other color, 0, and its own, 1
    let place = (0..3)
        .map(|c| (here[c] - sides.other[c]) * axis[c])
        .sum::<f32>()
        / length_sq;
    let push = (sides.coverage - place).max(0.0);
    // lines come and go at the border of the window; nothing may jump there
    let explained = 0.25 * length_sq / (0.25 * length_sq + sides.variance);
    let [low, high] = SOFT_EDGE;
    let share =
        smoothstep((explained - low) / (high - low)) * smoothstep(2.0 - 2.0 * sides.remoteness);
    std::array::from_fn(|c| {
        let (own, other) = (sides.own[c], sides.other[c]);
        // each of the three is within the range of the window, so the result is
        let low = here[c].min(own).min(other);
        let high = here[c].max(own).max(other);
        (here[c] + share * push * axis[c]).clamp(low, high)
    })
}

/// The share of a window's variance that two colors must explain to be sharpened at all, and fully. A slope as wide as the
/// window has 0.75, noise as strong as half the contrast 0.5, noise alone 0.1.
const SOFT_EDGE: [f32; 2] = [0.3, 0.6];

/// 0 up to 0, 1 from 1 on, without a bend.
pub(crate) fn smoothstep(t: f32) -> f32 {
    let t = t.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

fn distance_sq(a: [f32; 3], b: [f32; 3]) -> f32 {
    (0..3).map(|c| (a[c] - b[c]) * (a[c] - b[c])).sum()
}

/// `from` with `share` of `to`, in linear light; exactly `from` at 0 and `to` at 1.
pub(crate) fn mixed(from: LinearRgba, to: LinearRgba, share: f32) -> LinearRgba {
    if share <= 0.0 {
        return from;
    }
    if share >= 1.0 {
        return to;
    }
    LinearRgba(std::array::from_fn(|c| {
        from.0[c] + share * (to.0[c] - from.0[c])
    }))
}

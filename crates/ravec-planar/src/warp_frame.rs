//! Frames of clips seen through a homography, fast enough to be played.
//!
//! ```text
//! if the map reduces the frame anywhere to less than two thirds: as warp does
//! for each pixel of the output: interpolate the frame's pixels in linear light by the cubic of Catmull and Rom
//! where the pixel lies beyond the frame: the backdrop; across the frame's border a mixture of both, by area
//! ```
//!
//! Frames of a shot hardly change their size, so that one interpolation of 4 × 4 pixels is as good as the ellipses of
//! [`warp`](fn@crate::warp), and takes a small part of their time.
//!
//! Points are in pixels, x right, y down, pixel centers at half-integers.
//!
//! Guarantees: the identity and whole-numbered shifts move pixels unchanged, except at the border; equal input gives equal bytes
//! on any number of threads. Does not guarantee: no overshoot, a few per cent at hard edges. Cost: 16 pixels of the frame for
//! each pixel.

use crate::homography::Homography;
use crate::warp::{Beyond, warp};
use glam::{DMat3, DVec2, DVec3, dvec2};
use ravec_progress::{Cancelled, Progress};
use ravec_raster::{AnyImage, Color, Image, PremulLinearRgba, Size, for_each_strip};

/// Content beyond the border of a frame.
#[derive(Debug, Clone, Copy)]
pub enum Backdrop<'a> {
    /// Black; of frames with alpha transparent.
    Black,
    /// The border pixels of the frame go on.
    Border,
    /// Another picture of the size of the output and the type of the frame, such as the frame before.
    Picture(&'a AnyImage),
}

/// Largest reduction that is interpolated: by how much the longer axis of a pixel's footprint exceeds a pixel. More lets fine
/// patterns alias; less takes the slow way, four times as long, for shots in which the camera comes nearer.
const MAX_REDUCTION: f64 = 1.5;

/// Places along each side where the reduction is measured.
const PROBES: usize = 8;

/// Rows that are worked on at once: a millisecond.
const ROWS_PER_STRIP: usize = 16;

/// The picture of the size of `frame` whose pixels look at it through `frame_from_output`, in the same pixel type.
///
/// ```
/// use glam::dvec2;
/// use ravec_planar::{Backdrop, Homography, warp_frame};
/// use ravec_progress::Progress;
/// use ravec_raster::{AnyImage, Image, Size, Srgb};
///
/// let frame = Image::from_fn(Size::new(40, 30)?, |col, row| Srgb([col as u8, row as u8, 0u8]));
/// let shift = Homography::from_translation(dvec2(3.0, 2.0))?;
/// let moved = warp_frame(&frame.into(), &shift, Backdrop::Black, &Progress::none())?;
/// let AnyImage::Srgb8(moved) = moved else { unreachable!() };
/// assert_eq!(moved[(10, 10)], Srgb([13, 12, 0]));
/// assert_eq!(moved[(39, 10)], Srgb([0; 3]));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`Cancelled`] soon after `progress` is cancelled.
///
/// # Panics
/// If the picture of a [`Backdrop::Picture`] has another size.
pub fn warp_frame(
    frame: &AnyImage,
    frame_from_output: &Homography,
    backdrop: Backdrop<'_>,
    progress: &Progress,
) -> Result<AnyImage, Cancelled> {
    let source: Image<PremulLinearRgba> = frame.convert();
    Ok(match frame {
        AnyImage::Srgb8(_) => {
            warped::<ravec_raster::Srgb<u8>>(&source, frame_from_output, backdrop, progress)?.into()
        }
        AnyImage::Srgba8(_) => {
            warped::<ravec_raster::Srgba<u8>>(&source, frame_from_output, backdrop, progress)?
                .into()
        }
        AnyImage::Srgb16(_) => {
            warped::<ravec_raster::Srgb<u16>>(&source, frame_from_output, backdrop, progress)?
                .into()
        }
        AnyImage::Srgba16(_) => {
            warped::<ravec_raster::Srgba<u16>>(&source, frame_from_output, backdrop, progress)?
                .into()
        }
        AnyImage::Linear(_) => {
            warped::<ravec_raster::LinearRgb>(&source, frame_from_output, backdrop, progress)?
                .into()
        }
        AnyImage::LinearAlpha(_) => {
            warped::<ravec_raster::LinearRgba>(&source, frame_from_output, backdrop, progress)?
                .into()
        }
    })
}

fn warped<P: Color>(
    source: &Image<PremulLinearRgba>,
    frame_from_output: &Homography,
    backdrop: Backdrop<'_>,
    progress: &Progress,
) -> Result<Image<P>, Cancelled> {
    progress.check()?;
    let size = source.size();
    let mut output: Image<P> = match backdrop {
        Backdrop::Picture(picture) => {
            assert_eq!(
                picture.size(),
                size,
                "the backdrop has the size of the frame"
            );
            picture.convert()
        }
        Backdrop::Black | Backdrop::Border => {
            let alpha = if P::HAS_ALPHA { 0.0 } else { 1.0 };
            Image::new(
                size,
                P::from_linear(ravec_raster::LinearRgba([0.0, 0.0, 0.0, alpha])),
            )
        }
    };
    let endless = matches!(backdrop, Backdrop::Border);
    if reduces(frame_from_output, size) {
        let beyond = if endless {
            Beyond::Border
        } else {
            Beyond::Pixel(PremulLinearRgba([0.0; 4]))
        };
        let seen = warp(source, frame_from_output, size, beyond, progress)?;
        let pixels = output.pixels_mut().iter_mut().zip(seen.pixels());
        for (pixel, seen) in pixels {
            *pixel = over(*pixel, *seen, 1.0 - seen.0[3]);
        }
        return Ok(output);
    }
    let matrix = frame_from_output.matrix();
    let (width, phase) = (size.width(), progress.phase("warp", size.height() as u64));
    for_each_strip(
        &mut output,
        ROWS_PER_STRIP,
        progress,
        &phase,
        |first, pixels| {
            for (row, pixels) in (first..).zip(pixels.chunks_exact_mut(width)) {
                warp_row(source, &matrix, row, endless, pixels);
            }
        },
    )?;
    Ok(output)
}

/// A row of the output.
fn warp_row<P: Color>(
    source: &Image<PremulLinearRgba>,
    matrix: &DMat3,
    row: usize,
    endless: bool,
    pixels: &mut [P],
) {
    let extent = dvec2(source.width() as f64, source.height() as f64);
    let start = *matrix * DVec3::new(0.5, row as f64 + 0.5, 1.0);
    for (col, pixel) in pixels.iter_mut().enumerate() {
        let place = start + matrix.x_axis * col as f64;
        // behind the horizon nothing is seen
        if place.z <= 0.0 {
            continue;
        }
        let at = dvec2(place.x, place.y) / place.z;
        let share = if endless {
            1.0
        } else {
            share_inside(at, extent)
        };
        // also for what is not a number
        if share.is_nan() || share <= 0.0 {
            continue;
        }
        let seen = PremulLinearRgba(interpolated(source, at));
        *pixel = if share >= 1.0 {
            P::from_linear(seen.to_linear())
        } else {
            let share = share as f32;
            over(
                *pixel,
                PremulLinearRgba(seen.0.map(|value| value * share)),
                1.0 - share,
            )
        };
    }
}

/// `seen`, which is multiplied by its share, and the rest of what was there.
fn over<P: Color>(below: P, seen: PremulLinearRgba, rest: f32) -> P {
    let below = PremulLinearRgba::from_linear(below.to_linear());
    let mut mixed = seen;
    for (value, below) in mixed.0.iter_mut().zip(below.0) {
        *value += rest * below;
    }
    P::from_linear(mixed.to_linear())
}

/// Share of a pixel around `at` that lies inside.
fn share_inside(at: DVec2, extent: DVec2) -> f64 {
    let share =
        |at: f64, length: f64| (at + 0.5).clamp(0.0, 1.0) - (at - length + 0.5).clamp(0.0, 1.0);
    share(at.x, extent.x) * share(at.y, extent.y)
}

/// Weights of the four pixels around a place, `t` behind the second one.
#[inline(always)]
fn cubic(t: f32) -> [f32; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [
        -0.5 * t3 + t2 - 0.5 * t,
        1.5 * t3 - 2.5 * t2 + 1.0,
        -1.5 * t3 + 2.0 * t2 + 0.5 * t,
        0.5 * t3 - 0.5 * t2,
    ]
}

/// The value at a place, cubic over 4 × 4 pixels; beyond the border its pixels go on.
#[inline(always)]
fn interpolated(image: &Image<PremulLinearRgba>, at: DVec2) -> [f32; 4] {
    let (width, height) = (image.width(), image.height());
    // far outside all taps read the border
    let x = at.x.clamp(-4.0, width as f64 + 4.0) - 0.5;
    let y = at.y.clamp(-4.0, height as f64 + 4.0) - 0.5;
    let (left, top) = (floor(x), floor(y));
    let (across, down) = (
        cubic((x - left as f64) as f32),
        cubic((y - top as f64) as f32),
    );
    let (col, row) = (left - 1, top - 1);
    let inside = col >= 0 && row >= 0 && col as usize + 4 <= width && row as usize + 4 <= height;
    let mut sum = [0.0f32; 4];
    if inside {
        let (col, row) = (col as usize, row as usize);
        for (k, weight) in down.into_iter().enumerate() {
            let taps = &image.row(row + k)[col..col + 4];
            let taps = [&taps[0].0, &taps[1].0, &taps[2].0, &taps[3].0];
            add(&mut sum, weight, taps, across);
        }
    } else {
        let clamped = |at: isize, length: usize| at.clamp(0, length as isize - 1) as usize;
        for (k, weight) in (0..).zip(down) {
            let pixels = image.row(clamped(row + k, height));
            let taps = [0, 1, 2, 3].map(|k| &pixels[clamped(col + k, width)].0);
            add(&mut sum, weight, taps, across);
        }
    }
    sum
}

/// Adds a row of four pixels. Channels lie side by side, so that the sum is a few operations on four numbers.
#[inline(always)]
fn add(sum: &mut [f32; 4], weight: f32, taps: [&[f32; 4]; 4], across: [f32; 4]) {
    let [a, b, c, d] = taps;
    for k in 0..4 {
        let row = across[0] * a[k] + across[1] * b[k] + across[2] * c[k] + across[3] * d[k];
        sum[k] += weight * row;
    }
}

/// The next whole number below. A call for each pixel would take longer than the rest of its place.
#[inline(always)]
fn floor(x: f64) -> isize {
    let whole = x as isize;
    whole - isize::from((whole as f64) > x)
}

/// True if the map reduces the frame anywhere by more than is interpolated.
fn reduces(frame_from_output: &Homography, size: Size) -> bool {
    let extent = dvec2(size.width() as f64, size.height() as f64);
    let places =
        (0..=PROBES).flat_map(|row| (0..=PROBES).map(move |col| dvec2(col as f64, row as f64)));
    places
        .map(|place| place / PROBES as f64 * extent)
        .any(|place| {
            let Some(at) = frame_from_output.try_apply(place) else {
                return false;
            };
            let jacobian = frame_from_output.jacobian(place);
            let (x, y) = (jacobian.x_axis, jacobian.y_axis);
            // the larger eigenvalue of Jᵀ J
            let (mean, half) = (
                0.5 * (x.length_squared() + y.length_squared()),
                0.5 * (x.length_squared() - y.length_squared()),
            );
            let axis = (mean + half.hypot(x.dot(y))).sqrt();
            share_inside(at, extent) > 0.0 && axis > MAX_REDUCTION
        })
}

#[cfg(test)]
mod tests {
    use super::*;
    use ravec_raster::{LinearRgb, Srgb};

    fn frame() -> Image<Srgb<u8>> {
        Image::from_fn(Size::new(61, 47).unwrap(), |col, row| {
            let wave =
                |a: f64, b: f64| (127.0 + 100.0 * (a * col as f64 + b * row as f64).sin()) as u8;
            Srgb([wave(0.3, 0.1), wave(-0.1, 0.4), wave(0.2, 0.2)])
        })
    }

    fn warped(map: &Homography, backdrop: Backdrop) -> Image<Srgb<u8>> {
        let warped = warp_frame(&frame().into(), map, backdrop, &Progress::none()).unwrap();
        let AnyImage::Srgb8(image) = warped else {
            panic!("frames keep their type");
        };
        image
    }

    fn gentle() -> Homography {
        Homography::from_matrix(DMat3::from_cols(
            DVec3::new(0.98, 0.03, 2e-5),
            DVec3::new(-0.04, 0.97, -1e-5),
            DVec3::new(2.3, 1.7, 1.0),
        ))
        .unwrap()
    }

    #[test]
    fn the_identity_and_whole_shifts_keep_pixels() {
        assert_eq!(warped(&Homography::IDENTITY, Backdrop::Black), frame());
        let shift = Homography::from_translation(dvec2(5.0, -3.0)).unwrap();
        let moved = warped(&shift, Backdrop::Black);
        assert_eq!(moved[(20, 20)], frame()[(25, 17)]);
        assert_eq!(moved[(58, 20)], Srgb([0; 3]));
        assert_eq!(moved[(20, 1)], Srgb([0; 3]));
    }

    /// The slow way is the judge of the fast one.
    #[test]
    fn interpolation_agrees_with_the_general_warp() {
        let source: Image<PremulLinearRgba> = frame().convert();
        let map = gentle();
        let size = source.size();
        let judge = warp(&source, &map, size, Beyond::Border, &Progress::none()).unwrap();
        let judge: Image<Srgb<u8>> = judge.convert();
        let found = warped(&map, Backdrop::Border);
        for (a, b) in found.pixels().iter().zip(judge.pixels()) {
            for k in 0..3 {
                // the judge mixes in a little of its ellipse where the frame is reduced by a hundredth
                assert!(a.0[k].abs_diff(b.0[k]) <= 2, "{a:?} {b:?}");
            }
        }
    }

    #[test]
    fn beyond_the_frame_there_is_the_backdrop() {
        let shift = Homography::from_translation(dvec2(-20.5, 0.0)).unwrap();
        let blue = Image::new(frame().size(), Srgb([0u8, 0, 200]));
        let on_blue = warped(&shift, Backdrop::Picture(&blue.into()));
        assert_eq!(on_blue[(3, 9)], Srgb([0, 0, 200]));
        // half of this pixel is the frame's
        let edge = on_blue[(20, 9)];
        let border = warped(&shift, Backdrop::Border);
        assert!(
            edge.0[0] > 0 && edge.0[0] < border[(20, 9)].0[0],
            "{edge:?}"
        );
        assert_eq!(border[(3, 9)], frame()[(0, 9)]);
        assert_eq!(on_blue[(40, 9)], border[(40, 9)]);
    }

    #[test]
    fn reduced_frames_do_not_alias() {
        let stripes: Image<LinearRgb> = Image::from_fn(Size::new(64, 64).unwrap(), |col, _| {
            LinearRgb([(col % 2) as f32; 3])
        });
        let half = Homography::from_scale(dvec2(2.0, 2.0)).unwrap();
        let small = warp_frame(&stripes.into(), &half, Backdrop::Black, &Progress::none()).unwrap();
        let AnyImage::Linear(small) = small else {
            panic!("frames keep their type");
        };
        assert!((small[(10, 10)].0[0] - 0.5).abs() < 0.1);
        assert_eq!(small[(40, 10)], LinearRgb([0.0; 3]));
    }

    #[test]
    fn what_is_behind_the_horizon_is_backdrop_and_nothing_panics() {
        let steep = Homography::from_matrix(DMat3::from_cols(
            DVec3::new(1.0, 0.0, -0.05),
            DVec3::new(0.0, 1.0, 0.0),
            DVec3::new(0.0, 0.0, 1.0),
        ))
        .unwrap();
        for backdrop in [Backdrop::Black, Backdrop::Border] {
            let image = warped(&steep, backdrop);
            assert_eq!(image[(50, 5)], Srgb([0; 3]));
        }
        let progress = Progress::new(|_| ());
        progress.cancel();
        let cancelled = warp_frame(&frame().into(), &gentle(), Backdrop::Black, &progress);
        assert!(cancelled.is_err());
    }
}

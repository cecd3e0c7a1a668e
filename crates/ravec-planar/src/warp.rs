//! Pictures seen through a homography, each pixel filtered once.
//!
//! ```text
//! for each pixel of the output:
//!     its center lies somewhere in the image, and the map is nearly linear there: a unit circle becomes an ellipse
//!     the axes of the ellipse are made at least a pixel long
//!     average the image's pixels within twice the ellipse, by a kernel of the elliptical distance
//! ```
//!
//! Where the image is only enlarged, no average is needed and the kernel is the interpolating cubic of Catmull and Rom; in
//! between both are mixed, so that nothing jumps. Ellipses that are large in every direction are filtered in a halved image.
//!
//! Compose maps before warping: `warp(image, &(image_from_plane * plane_from_output), …)` filters once, two warps blur twice.
//!
//! Points are in pixels, x right, y down, pixel centers at half-integers.
//!
//! Source: Greene and Heckbert, "Creating raster omnimax images from multiple perspective views using the elliptical weighted
//! average filter", 1986. We differ in the kernel, which is the cubic of Robidoux instead of a Gaussian, for it keeps more
//! detail, and in that axes are made a pixel long instead of adding a circle, which would blur what is neither enlarged nor
//! reduced.
//!
//! Guarantees: a whole-numbered shift moves pixels unchanged; constants stay constant to rounding; equal input gives equal
//! bytes on any number of threads. Does not guarantee: no overshoot, a few per cent at hard edges.
//! Cost: 16 pixels of the image a pixel where it is enlarged, 13 times the area of the ellipse where it is reduced, at most
//! some thousands.

use crate::homography::Homography;
use glam::{DVec2, dvec2};
use ravec_progress::{Cancelled, Progress};
use ravec_raster::{Average, Image, Reduction, Size, for_each_strip, halved};
use std::ops::Range;
use std::sync::LazyLock;

/// Values beyond the border of the image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Beyond<P> {
    /// The image goes on with its border pixels. Behind the horizon there is [`Average::ZERO`].
    Border,
    /// This pixel everywhere, such as a transparent one. The image's border is smooth.
    Pixel(P),
}

/// Largest ratio of length to width of an ellipse. Longer ones, near the horizon, become wider: that blurs what is
/// flattened to nothing anyway, and bounds the cost.
const MAX_ANISOTROPY: f64 = 24.0;

/// The least width of an ellipse in a halved image, in pixels: halving averages 2 × 2 pixels, which is then a small part of
/// the filter. Smaller is faster and lets aliasing of the halving through.
const MIN_MINOR_PX: f64 = 4.0;

/// The greatest width of an ellipse that is filtered as it is.
const MAX_MINOR_PX: f64 = 4.0 * MIN_MINOR_PX;

/// The reduction at which the cubic of the enlarged image has given way to the ellipse's kernel: by how much an axis
/// exceeds a pixel. Smaller makes the change of sharpness steeper, larger lets aliasing through.
const BLEND: f64 = 0.25;

/// The kernel ends at twice the ellipse.
const SUPPORT_SQ: f64 = 4.0;

/// Rows that are worked on at once: some milliseconds.
const ROWS_PER_STRIP: usize = 4;

/// The picture of `size` whose pixels look at `image` through `image_from_output`.
///
/// Values are averaged as they are: give linear light, and premultiplied alpha where there is transparency.
///
/// ```
/// use glam::dvec2;
/// use ravec_planar::{Beyond, Homography, warp};
/// use ravec_progress::Progress;
/// use ravec_raster::{Plane, Size};
///
/// let image = Plane::from_fn(Size::new(40, 30)?, |col, row| (col * row) as f32);
/// let image_from_output = Homography::from_translation(dvec2(3.0, 2.0))?;
/// let output = warp(&image, &image_from_output, Size::new(40, 30)?, Beyond::Pixel(-1.0), &Progress::none())?;
/// assert_eq!(output[(10, 10)], image[(13, 12)]);
/// assert_eq!(output[(39, 10)], -1.0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`Cancelled`] soon after `progress` is cancelled.
pub fn warp<P: Average>(
    image: &Image<P>,
    image_from_output: &Homography,
    size: Size,
    beyond: Beyond<P>,
    progress: &Progress,
) -> Result<Image<P>, Cancelled> {
    progress.check()?;
    let source = Source::new(image, image_from_output, size);
    let empty = match beyond {
        Beyond::Border => P::ZERO,
        Beyond::Pixel(pixel) => pixel,
    };
    let mut output = Image::new(size, empty);
    let phase = progress.phase("warp", size.height() as u64);
    let width = size.width();
    for_each_strip(
        &mut output,
        ROWS_PER_STRIP,
        progress,
        &phase,
        |first_row, pixels| {
            for (index, pixel) in pixels.iter_mut().enumerate() {
                let (col, row) = (index % width, first_row + index / width);
                let center = dvec2(col as f64 + 0.5, row as f64 + 0.5);
                let Some(footprint) = Footprint::new(image_from_output, center) else {
                    continue;
                };
                let share = match beyond {
                    Beyond::Border => 1.0,
                    Beyond::Pixel(_) => footprint.share_inside(image.size()),
                };
                if share > 0.0 {
                    let seen = source.filtered(&footprint);
                    *pixel = if share < 1.0 {
                        P::ZERO.plus(share, seen).plus(1.0 - share, empty)
                    } else {
                        seen
                    };
                }
            }
        },
    )?;
    Ok(output)
}

/// Inputs of [`warp`](fn@crate::warp) besides the image, for warps on another device.
pub struct WarpParts<P> {
    /// The image halved once, twice and so on, as often as the map needs.
    pub halved: Vec<Image<P>>,
}

impl<P: Average> WarpParts<P> {
    /// The parts of the warp of `image` to a picture of `size`.
    pub fn new(image: &Image<P>, image_from_output: &Homography, size: Size) -> Self {
        Self {
            halved: Source::new(image, image_from_output, size).halved,
        }
    }

    /// The weights of the kernel by the square of the elliptical distance, from 0 to [`WarpParts::SUPPORT_SQ`].
    pub fn kernel() -> &'static [f32] {
        &KERNEL
    }

    /// The square of the elliptical distance at which the kernel ends.
    pub const SUPPORT_SQ: f32 = SUPPORT_SQ as f32;

    /// Rows of the image that some rows of an output of `width` columns see, with some to spare; all of them where the output
    /// reaches the horizon.
    pub fn seen_rows(
        image: Size,
        image_from_output: &Homography,
        width: usize,
        rows: Range<usize>,
    ) -> Range<usize> {
        const STEP: usize = 32;
        let places = |from: usize, to: usize| (from..to).step_by(STEP).chain([to]);
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for y in places(rows.start, rows.end) {
            for x in places(0, width) {
                let Some(seen) = Footprint::new(image_from_output, dvec2(x as f64, y as f64))
                else {
                    return 0..image.height();
                };
                // within a few pixels a footprint grows little; coarser images are read one of their pixels further
                let coarse = f64::from(1u32 << seen.level().min(16));
                let reach = 3.0 * seen.axes_sq[0].sqrt() + 4.0 * coarse + 4.0;
                low = low.min(seen.at.y - reach);
                high = high.max(seen.at.y + reach);
            }
        }
        let inside = |row: f64| row.clamp(0.0, image.height() as f64 - 1.0) as usize;
        inside(low)..inside(high) + 1
    }
}

/// Footprint of an output pixel in the image, if the map is taken as linear there.
struct Footprint {
    at: DVec2,
    /// The lengths of the ellipse's bounding box, before its axes were made a pixel long.
    extent: DVec2,
    /// The squared axes, larger first, at least 1.
    axes_sq: [f64; 2],
    /// The square of the elliptical distance: q₀ dx² + 2 q₁ dx dy + q₂ dy².
    metric: [f64; 3],
}

impl Footprint {
    /// Nothing behind the horizon.
    fn new(image_from_output: &Homography, center: DVec2) -> Option<Self> {
        let at = image_from_output.try_apply(center)?;
        let jacobian = image_from_output.jacobian(center);
        // the ellipse is { p : pᵀ (J Jᵀ)⁻¹ p = 1 }
        let rows = [jacobian.row(0), jacobian.row(1)];
        let (xx, xy, yy) = (
            rows[0].length_squared(),
            rows[0].dot(rows[1]),
            rows[1].length_squared(),
        );
        let mean = 0.5 * (xx + yy);
        let spread = (0.25 * (xx - yy).powi(2) + xy * xy).sqrt();
        if !(mean + spread).is_finite() {
            return None;
        }
        let major = (mean + spread).max(1.0);
        let minor = (mean - spread).max(1.0).max(major / MAX_ANISOTROPY.powi(2));
        // the projector to the major axis is (J Jᵀ − λ₂) / (λ₁ − λ₂); a circle has none, and needs none
        let difference = if spread > 0.0 {
            (major.recip() - minor.recip()) / (2.0 * spread)
        } else {
            0.0
        };
        let lower = mean - spread;
        Some(Self {
            at,
            extent: dvec2(xx.sqrt(), yy.sqrt()),
            axes_sq: [major, minor],
            metric: [
                minor.recip() + difference * (xx - lower),
                difference * xy,
                minor.recip() + difference * (yy - lower),
            ],
        })
    }

    /// Share of the ellipse's bounding box that lies in the image.
    fn share_inside(&self, size: Size) -> f32 {
        let share = |at: f64, extent: f64, length: usize| {
            let below = |edge: f64| ((at - edge) / extent + 0.5).clamp(0.0, 1.0);
            below(0.0) - below(length as f64)
        };
        let share = share(self.at.x, self.extent.x, size.width())
            * share(self.at.y, self.extent.y, size.height());
        share as f32
    }

    /// Number of times that the image may be halved before the ellipse is filtered.
    fn level(&self) -> usize {
        let widths = self.axes_sq[1].sqrt() / MIN_MINOR_PX;
        widths.log2().max(0.0) as usize
    }
}

/// The image and as many reductions of it as the map needs.
struct Source<'a, P> {
    image: &'a Image<P>,
    halved: Vec<Image<P>>,
}

impl<'a, P: Average> Source<'a, P> {
    fn new(image: &'a Image<P>, image_from_output: &Homography, size: Size) -> Self {
        // places between those that are examined here have ellipses of like size; if not, they cost more
        const PLACES: usize = 32;
        let place = |k: usize, length: usize| k as f64 / PLACES as f64 * length as f64;
        let footprints = (0..=PLACES * (PLACES + 2)).filter_map(|k| {
            let (col, row) = (k % (PLACES + 1), k / (PLACES + 1));
            let at = dvec2(place(col, size.width()), place(row, size.height()));
            Footprint::new(image_from_output, at)
        });
        let needed = footprints
            .filter(|footprint| footprint.share_inside(image.size()) > 0.0)
            .map(|footprint| footprint.level())
            .max();
        let mut halves: Vec<Image<P>> = Vec::new();
        for _ in 0..needed.unwrap_or(0) {
            let last = halves.last().unwrap_or(image);
            if last.size().pixels() == 1 {
                break;
            }
            halves.push(halved(last, Reduction::Area));
        }
        Self {
            image,
            halved: halves,
        }
    }

    fn filtered(&self, footprint: &Footprint) -> P {
        let blend = (footprint.axes_sq[0].sqrt() - 1.0) / BLEND;
        if blend <= 0.0 {
            return self.image.catmull_rom(footprint.at);
        }
        let level = footprint.level().min(self.halved.len());
        let image = match level {
            0 => self.image,
            level => &self.halved[level - 1],
        };
        let scale = 0.5f64.powi(level as i32);
        // wider than twice the least width only where there is no coarser image: a single pixel needs no wide filter, and
        // what was not foreseen must not cost without end
        let width = footprint.axes_sq[1].sqrt() * scale;
        let narrower = (width / MAX_MINOR_PX).max(1.0) / scale;
        let metric = footprint.metric.map(|q| q * narrower * narrower);
        let average = average(image, footprint.at * scale, metric);
        if blend < 1.0 {
            let cubic = self.image.catmull_rom(footprint.at);
            P::ZERO
                .plus(blend as f32, average)
                .plus(1.0 - blend as f32, cubic)
        } else {
            average
        }
    }
}

/// The average of the pixels within twice the ellipse around `at`, weighed by the kernel. Beyond the image its border goes on.
fn average<P: Average>(image: &Image<P>, at: DVec2, [xx, xy, yy]: [f64; 3]) -> P {
    let kernel = &*KERNEL;
    let determinant = xx * yy - xy * xy;
    let reach_y = (SUPPORT_SQ * xx / determinant).sqrt();
    let (first, last) = (
        (at.y - reach_y - 0.5).ceil() as i64,
        (at.y + reach_y - 0.5).floor() as i64,
    );
    let (mut sum, mut weights) = (P::ZERO, 0.0f32);
    for row in first..=last {
        let dy = row as f64 + 0.5 - at.y;
        // where the line cuts twice the ellipse
        let under_root = (xy * dy).powi(2) - xx * (yy * dy * dy - SUPPORT_SQ);
        if under_root < 0.0 {
            continue;
        }
        let (middle, half) = (at.x - xy * dy / xx, under_root.sqrt() / xx);
        let start = (middle - half - 0.5).ceil() as i64;
        let end = (middle + half - 0.5).floor() as i64 + 1;
        let pixels = image.row(row.clamp(0, image.height() as i64 - 1) as usize);
        let weight = |col: i64| {
            let dx = col as f64 + 0.5 - at.x;
            let distance_sq = dx * (xx * dx + 2.0 * xy * dy) + yy * dy * dy;
            // a cast saturates at 0; rounding may lead past the end
            let entry = (distance_sq as f32 * ENTRIES_PER_UNIT) as usize;
            kernel.get(entry).copied().unwrap_or(0.0)
        };
        let mut add = |weight: f32, pixel: P| {
            sum = sum.plus(weight, pixel);
            weights += weight;
        };
        if start >= 0 && end <= pixels.len() as i64 {
            if start < end {
                for (col, &pixel) in (start..).zip(&pixels[start as usize..end as usize]) {
                    add(weight(col), pixel);
                }
            }
        } else {
            for col in start..end {
                add(
                    weight(col),
                    pixels[col.clamp(0, pixels.len() as i64 - 1) as usize],
                );
            }
        }
    }
    P::ZERO.plus(weights.recip(), sum)
}

/// Entries of the table of the kernel: between two of them it changes by less than 1 / 1000.
const ENTRIES: usize = 4096;
const ENTRIES_PER_UNIT: f32 = ENTRIES as f32 / SUPPORT_SQ as f32;

/// The kernel by the square of the distance.
static KERNEL: LazyLock<Vec<f32>> = LazyLock::new(|| {
    let entry = |k: usize| (k as f64 + 0.5) / f64::from(ENTRIES_PER_UNIT);
    (0..ENTRIES)
        .map(|k| robidoux(entry(k).sqrt()) as f32)
        .collect()
});

/// The cubic of Mitchell and Netravali's family that keeps, as a radial kernel, straight lines that are constant along rows or
/// columns as they are (N. Robidoux, 2012).
fn robidoux(distance: f64) -> f64 {
    const B: f64 = 0.378_215_754_915_2;
    const C: f64 = 0.310_892_122_542_4;
    let (r, r2) = (distance, distance * distance);
    if r < 1.0 {
        ((12.0 - 9.0 * B - 6.0 * C) * r + (-18.0 + 12.0 * B + 6.0 * C)) * r2 + (6.0 - 2.0 * B)
    } else if r < 2.0 {
        (((-B - 6.0 * C) * r + (6.0 * B + 30.0 * C)) * r - (12.0 * B + 48.0 * C)) * r
            + (8.0 * B + 24.0 * C)
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use ravec_raster::{Plane, PremulLinearRgba};

    fn size(width: usize, height: usize) -> Size {
        Size::new(width, height).unwrap()
    }

    fn noise(width: usize, height: usize) -> Plane {
        let mut random = crate::random::SplitMix::new(7);
        Plane::from_fn(size(width, height), |_, _| random.below(1000) as f32 / 1e3)
    }

    /// A map from a picture of 30 × 30 onto a quadrilateral in one of 60 × 50.
    fn map() -> impl Strategy<Value = Homography> {
        let corner = |x: f64, y: f64| {
            (-18.0..18.0, -14.0..14.0).prop_map(move |(dx, dy)| dvec2(x + dx, y + dy))
        };
        (
            corner(10.0, 10.0),
            corner(55.0, 8.0),
            corner(50.0, 45.0),
            corner(5.0, 40.0),
        )
            .prop_filter_map("no quadrilateral", |(a, b, c, d)| {
                let square = Homography::from_unit_square([a, b, c, d]).ok()?;
                Some(square * Homography::from_scale(DVec2::splat(1.0 / 30.0)).unwrap())
            })
    }

    /// The plain definition where no axis is shorter than a pixel and a quarter: all pixels of the endless image, the kernel
    /// of the exact inverse of J Jᵀ.
    fn average_naive(image: &Plane, map: &Homography, center: DVec2) -> Option<f32> {
        let (at, jacobian) = (map.apply(center), map.jacobian(center));
        let spread = jacobian * jacobian.transpose();
        let inverse = spread.inverse();
        // the smaller eigenvalue is the square of the shorter axis
        let half_trace = 0.5 * (spread.x_axis.x + spread.y_axis.y);
        let shorter_sq = half_trace - (half_trace * half_trace - spread.determinant()).sqrt();
        if shorter_sq.is_nan() || shorter_sq < 1.25 * 1.25 || jacobian.determinant().abs() > 12.0 {
            return None;
        }
        let (mut sum, mut weights) = (0.0, 0.0);
        for row in -60..120 {
            for col in -60..130 {
                let d = dvec2(f64::from(col) + 0.5, f64::from(row) + 0.5) - at;
                let weight = robidoux(d.dot(inverse * d).sqrt());
                let clamped = |k: i32, length: usize| k.clamp(0, length as i32 - 1) as usize;
                let pixel = image[(clamped(col, image.width()), clamped(row, image.height()))];
                sum += weight * f64::from(pixel);
                weights += weight;
            }
        }
        Some((sum / weights) as f32)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(40))]

        #[test]
        fn the_average_is_the_definition(map in map(), col in 0usize..30, row in 0usize..30) {
            let image = noise(60, 50);
            let center = dvec2(col as f64 + 0.5, row as f64 + 0.5);
            if let Some(naive) = average_naive(&image, &map, center) {
                let found = warp(&image, &map, size(30, 30), Beyond::Border, &Progress::none()).unwrap();
                // the table of the kernel is exact to a thousandth, over some tens of pixels of random sign
                prop_assert!((found[(col, row)] - naive).abs() < 2e-3, "{} {naive}", found[(col, row)]);
            }
        }

        #[test]
        fn a_constant_stays_constant_and_a_border_only_mixes(map in map()) {
            let image = Image::new(size(60, 50), [0.25f32, -3.0]);
            let on = |beyond| warp(&image, &map, size(30, 30), beyond, &Progress::none()).unwrap();
            for pixel in on(Beyond::Border).pixels() {
                prop_assert!((pixel[0] - 0.25).abs() < 1e-5 && (pixel[1] + 3.0).abs() < 1e-4);
            }
            for pixel in on(Beyond::Pixel([0.0, 0.0])).pixels() {
                prop_assert!((-1e-5..=0.25001).contains(&pixel[0]), "{pixel:?}");
                prop_assert!((pixel[1] + 12.0 * pixel[0]).abs() < 1e-3);
            }
        }
    }

    #[test]
    fn the_same_place_is_the_same_picture() {
        let image = noise(20, 15);
        let same = warp(
            &image,
            &Homography::IDENTITY,
            image.size(),
            Beyond::Pixel(9.0),
            &Progress::none(),
        );
        assert_eq!(same.unwrap(), image);
    }

    #[test]
    fn the_transparent_border_has_the_area_of_the_quadrilateral() {
        let image = Image::new(size(300, 200), PremulLinearRgba([0.5, 0.5, 0.5, 1.0]));
        let quad = [
            dvec2(20.3, 10.7),
            dvec2(170.2, 40.1),
            dvec2(160.9, 120.4),
            dvec2(30.6, 140.2),
        ];
        let square = Homography::from_unit_square(quad).unwrap();
        let image_from_output =
            Homography::from_scale(dvec2(300.0, 200.0)).unwrap() * square.inverse();
        let beyond = Beyond::Pixel(PremulLinearRgba::ZERO);
        let found = warp(
            &image,
            &image_from_output,
            size(200, 150),
            beyond,
            &Progress::none(),
        );
        let alpha: f64 = found
            .unwrap()
            .pixels()
            .iter()
            .map(|p| f64::from(p.0[3]))
            .sum();
        let area = 0.5 * (quad[2] - quad[0]).perp_dot(quad[3] - quad[1]);
        // the border is right to a tenth of a pixel along 500 pixels, and errors on opposite sides cancel
        assert!((alpha - area).abs() < 25.0, "{alpha} {area}");
    }

    #[test]
    fn stripes_towards_the_horizon_fade_instead_of_swarming() {
        // a floor with stripes of 6 pixels along and 4 across, from 1 to 30 pixels of it a pixel
        let image = Plane::from_fn(size(600, 1200), |col, row| {
            0.5 * f32::from(u8::from(col % 6 < 3) + u8::from(row % 4 < 2))
        });
        let quad = [
            dvec2(70.0, 20.0),
            dvec2(130.0, 20.0),
            dvec2(320.0, 200.0),
            dvec2(-120.0, 200.0),
        ];
        let square = Homography::from_unit_square(quad).unwrap();
        let map = Homography::from_scale(dvec2(600.0, 1200.0)).unwrap() * square.inverse();
        let output = size(200, 200);
        let found = warp(&image, &map, output, Beyond::Border, &Progress::none()).unwrap();
        // the kernel in the output, by 32 × 32 looks at pixels of the image through the map itself
        let look = |at: DVec2| f64::from(image.nearest(map.apply(at)));
        let filtered = |center: DVec2| {
            let (mut sum, mut weights) = (0.0, 0.0);
            for k in 0..1024 {
                let step = dvec2(f64::from(k % 32) + 0.5, f64::from(k / 32) + 0.5) / 8.0 - 2.0;
                let weight = robidoux(step.length());
                sum += weight * look(center + step);
                weights += weight;
            }
            (sum / weights) as f32
        };
        let (mut error, mut plain, mut count) = (0.0, 0.0, 0.0);
        // farther up, the looks are too few for a stripe each
        for row in 60..150 {
            for col in 70..130 {
                let center = dvec2(col as f64 + 0.5, row as f64 + 0.5);
                let truth = filtered(center);
                error += (found[(col, row)] - truth).powi(2);
                plain += (image.catmull_rom(map.apply(center)) - truth).powi(2);
                count += 1.0;
            }
        }
        let (error, plain): (f32, f32) = ((error / count).sqrt(), (plain / count).sqrt());
        // pixels are squares here and points there: a tenth of the contrast of the finest stripes, which is a quarter
        assert!(error < 0.03 && error < 0.15 * plain, "{error} {plain}");
    }

    #[test]
    fn far_reductions_see_the_mean() {
        // 800 pixels of noise onto 10: each sees 80 × 80
        let image = noise(800, 800);
        let map = Homography::from_scale(DVec2::splat(80.0)).unwrap();
        let found = warp(
            &image,
            &map,
            size(10, 10),
            Beyond::Border,
            &Progress::none(),
        )
        .unwrap();
        for &value in found.pixels() {
            // 6400 even numbers from 0 to 1 and a kernel that sharpens a little: a deviation of 0.29 / 80 each
            assert!((value - 0.5).abs() < 0.03, "{value}");
        }
    }

    #[test]
    fn behind_the_horizon_there_is_nothing_and_no_number_breaks_it() {
        let image = noise(8, 8);
        let matrix = glam::DMat3::from_cols_array(&[1.0, 0.0, 0.1, 0.0, 1.0, 0.1, 0.0, 0.0, -1.0]);
        let map = Homography::from_matrix(matrix).unwrap();
        let found = warp(
            &image,
            &map,
            size(20, 20),
            Beyond::Pixel(7.0),
            &Progress::none(),
        )
        .unwrap();
        assert_eq!(found[(0, 0)], 7.0);
        assert!(found.pixels().iter().all(|value| value.is_finite()));
        let map = Homography::from_scale(DVec2::splat(1e9)).unwrap();
        let found = warp(&image, &map, size(5, 5), Beyond::Border, &Progress::none()).unwrap();
        assert!(found.pixels().iter().all(|value| value.is_finite()));
    }

    #[test]
    fn cancelled_work_ends_and_threads_do_not_matter() {
        let image = noise(60, 50);
        let map = Homography::from_scale(dvec2(1.7, 1.3)).unwrap();
        let on = |threads| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()
                .unwrap();
            pool.install(|| {
                warp(
                    &image,
                    &map,
                    size(40, 40),
                    Beyond::Border,
                    &Progress::none(),
                )
            })
        };
        assert_eq!(on(1), on(3));
        let progress = Progress::none();
        progress.cancel();
        let cancelled = warp(&image, &map, size(40, 40), Beyond::Border, &progress);
        assert_eq!(cancelled, Err(Cancelled));
    }
}

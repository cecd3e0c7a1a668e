//! Enlarging without blur and without stairs: the windows' lines drawn at the new resolution.
//!
//! 1. Enlarge by a smooth kernel (Catmull-Rom): right for gradients and texture, soft along edges.
//! 2. At every pixel of the source, the window's line (to a fraction of a pixel) with its colors is a picture without resolution. Near the line, and as
//!    far as two colors explain the window, it replaces the smooth result.
//! 3. Each output pixel takes the four nearest source pixels' windows, weighted as bilinear interpolation does, so that
//!    nothing jumps between them.
//!
//! Source: dissertation, chapter 3 (antialiasing by rerendering). We differ in keeping the smooth result where windows are
//! not two-colored.
//!
//! Cost: one exact fit a source pixel and four coverages an output pixel. Memory: the result and 48 bytes a source pixel.

use crate::dense::{WindowParams, map_windows};
use crate::filter_error::FilterError;
use crate::line::coverage;
use crate::pointwise::quality;
use crate::render::RenderError;
use crate::subpixel::refine_line;
use glam::DVec2;
use ravec_progress::Progress;
use ravec_raster::color::linear_from_oklab;
use ravec_raster::{Color, Image, LinearRgba, PremulLinearRgba, Rect, ResizeFilter, Size, resize};
use rayon::prelude::*;

/// Why an image could not be enlarged.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum EnlargeError {
    /// The factor is not above 0, or gives a picture that cannot be held.
    #[error(transparent)]
    Scale(#[from] RenderError),
    /// The windows could not be fitted.
    #[error(transparent)]
    Filter(#[from] FilterError),
}

/// A window as plain numbers: normal, offset, colors of side 0 and side 1 in linear light, quality.
type Packed = [f32; 10];

/// Distances from its line, in source pixels, within which a window draws: fully within the first, nothing beyond the
/// second. The smooth kernel blurs an edge over about two pixels to each side.
const REACH_PX: [f64; 2] = [1.0, 2.5];

/// The image enlarged (or reduced) by `factor`, with crisp edges. Alpha is enlarged smoothly.
///
/// # Errors
/// [`EnlargeError::Scale`] if `factor` is not positive and finite or the result too large; [`EnlargeError::Filter`] for a window
/// out of range, or soon after `progress` is cancelled.
pub fn enlarge<P: Color>(
    image: &Image<P>,
    factor: f64,
    params: &WindowParams,
    progress: &Progress,
) -> Result<Image<LinearRgba>, EnlargeError> {
    let wrong = RenderError::Scale { got: factor };
    if !factor.is_finite() || factor <= 0.0 {
        return Err(wrong.into());
    }
    let side = |pixels: usize| (pixels as f64 * factor).round().max(1.0) as usize;
    let size = Size::new(side(image.width()), side(image.height())).map_err(|_| wrong)?;
    let half = params.window_px / 2;
    let windows = map_windows(
        image,
        Rect::of(image.size()),
        params,
        progress,
        |col, row, window| {
            let Some(line) = window.fit.line else {
                return [0.0; 10];
            };
            if line.offset_px.abs() > REACH_PX[1] + 1.0 {
                return [0.0; 10];
            }
            // windows over the border keep the line of their split
            let fit = match (col.checked_sub(half), row.checked_sub(half)) {
                (Some(left), Some(top)) => {
                    refine_line(image, [left, top], params.window_px, &window.fit)
                }
                _ => window.fit,
            };
            let line = fit.line.unwrap_or(line);
            let [c0, c1] = fit.colors.map(|color| linear_from_oklab(color.0));
            let quality = quality(window.fit.error, window.fit.contrast());
            let [x, y] = [line.normal.x as f32, line.normal.y as f32];
            [
                x,
                y,
                line.offset_px as f32,
                c0[0],
                c0[1],
                c0[2],
                c1[0],
                c1[1],
                c1[2],
                quality,
            ]
        },
    )?;
    let smooth = resize(
        &image.convert::<PremulLinearRgba>(),
        size,
        ResizeFilter::CatmullRom,
    );
    progress.check().map_err(FilterError::from)?;
    let mut result: Image<LinearRgba> = smooth.convert();
    let scale = DVec2::new(
        size.width() as f64 / image.width() as f64,
        size.height() as f64 / image.height() as f64,
    );
    let phase = progress.phase("enlarge", size.height() as u64);
    result
        .par_rows_mut()
        .enumerate()
        .try_for_each(|(row, out)| {
            progress.check()?;
            for (col, out) in out.iter_mut().enumerate() {
                let p = DVec2::new(col as f64 + 0.5, row as f64 + 0.5) / scale;
                *out = redrawn(*out, p, scale, &windows);
            }
            phase.advance(1);
            Ok::<(), FilterError>(())
        })?;
    Ok(result)
}

/// The pixel at `p` (in the source) with the lines around it drawn over its smooth color.
fn redrawn(smooth: LinearRgba, p: DVec2, scale: DVec2, windows: &Image<Packed>) -> LinearRgba {
    let corner = (p - 0.5).floor();
    let share = p - 0.5 - corner;
    let mut rgb = smooth.rgb();
    let base = rgb;
    for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
        let weight = (if dx == 0 { 1.0 - share.x } else { share.x })
            * (if dy == 0 { 1.0 - share.y } else { share.y });
        let (col, row) = (corner.x as isize + dx, corner.y as isize + dy);
        let [nx, ny, offset, colors @ .., quality] = windows.clamped(col, row);
        if quality <= 0.0 || weight <= 0.0 {
            continue;
        }
        let normal = DVec2::new(f64::from(nx), f64::from(ny));
        let center = DVec2::new(col as f64 + 0.5, row as f64 + 0.5);
        let inside = f64::from(offset) - normal.dot(p - center);
        let near = ((REACH_PX[1] - inside.abs()) / (REACH_PX[1] - REACH_PX[0])).clamp(0.0, 1.0);
        let weight = (weight * near * f64::from(quality)) as f32;
        if weight <= 0.0 {
            continue;
        }
        // an output pixel is 1/scale source pixels wide
        let zoom = 0.5 * (scale.x + scale.y);
        let side_0 = coverage(normal, inside * zoom) as f32;
        for (c, value) in rgb.iter_mut().enumerate() {
            let drawn = side_0 * colors[c] + (1.0 - side_0) * colors[c + 3];
            *value += weight * (drawn - base[c]);
        }
    }
    LinearRgba::from_rgb_alpha(rgb, smooth.alpha())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Line;

    /// A slanted edge drawn with exact coverage at any scale.
    fn edge(side: usize, scale: f64) -> Image<LinearRgba> {
        let line = Line::from_angle(0.5, 0.0)
            .relative_to(DVec2::new(-20.3, -18.1))
            .scaled(scale);
        Image::from_fn(Size::new(side, side).unwrap(), |col, row| {
            let f = line.coverage(DVec2::new(col as f64 + 0.5, row as f64 + 0.5)) as f32;
            LinearRgba::from_rgb_alpha([0.1, 0.6, 0.3].map(|v| v * f + (1.0 - v) * (1.0 - f)), 1.0)
        })
    }

    fn distance(a: &Image<LinearRgba>, b: &Image<LinearRgba>) -> f64 {
        let mut sum = 0.0;
        for row in 24..136 {
            for col in 24..136 {
                sum += (0..3)
                    .map(|c| f64::from(a[(col, row)].0[c] - b[(col, row)].0[c]).powi(2))
                    .sum::<f64>();
            }
        }
        sum.sqrt()
    }

    #[test]
    fn an_enlarged_edge_is_nearer_to_the_truth_than_a_smooth_kernel_gets() {
        let (small, truth) = (edge(40, 1.0), edge(160, 4.0));
        let smooth: Image<LinearRgba> = resize(
            &small.convert::<PremulLinearRgba>(),
            truth.size(),
            ResizeFilter::CatmullRom,
        )
        .convert();
        let crisp = enlarge(&small, 4.0, &WindowParams::default(), &Progress::none()).unwrap();
        assert!(distance(&crisp, &truth) < 0.5 * distance(&smooth, &truth));
    }

    #[test]
    fn an_even_picture_stays_even_and_sizes_are_rounded() {
        let image = Image::new(Size::new(7, 3).unwrap(), LinearRgba([0.2, 0.4, 0.1, 0.5]));
        let result = enlarge(&image, 2.3, &WindowParams::default(), &Progress::none()).unwrap();
        assert_eq!(result.size(), Size::new(16, 7).unwrap());
        for pixel in result.pixels() {
            for (a, b) in pixel.0.into_iter().zip([0.2, 0.4, 0.1, 0.5]) {
                assert!((a - b).abs() < 1e-5);
            }
        }
    }

    #[test]
    fn useless_factors_are_refused() {
        let image = Image::new(Size::new(7, 3).unwrap(), LinearRgba::default());
        for got in [0.0, -2.0, f64::NEG_INFINITY, 1e9] {
            let error =
                enlarge(&image, got, &WindowParams::default(), &Progress::none()).unwrap_err();
            assert_eq!(error, EnlargeError::Scale(RenderError::Scale { got }));
        }
    }
}

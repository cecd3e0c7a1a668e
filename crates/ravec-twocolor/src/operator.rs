//! The two-color operator: a pixel, the split of the window around it, its own side and the other.
//!
//! | mode | what a pixel becomes |
//! | --- | --- |
//! | abstract | the mean of its side: even areas, crisp edges |
//! | smooth | nearer to the mean of its side: noise goes, edges stay |
//! | sharpen | on a soft edge, where an ideal edge along the same line has it |
//! | clean | the mean of what all windows over it estimate (see [`clean`](crate::clean())) |
//! | antialias | on an edge, the mixture of both sides by the area that the line leaves in the pixel |
//! | stamp | a square with two colors out of many that are scattered over the picture |
//!
//! Source: dissertation, chapter 3.
//!
//! Guarantees: the same result for any region and any number of threads; alpha stays (but for stamp); fully transparent
//! pixels stay as they are. Cost: one exact fit a pixel and iteration. Memory: the result of each iteration.

use crate::clean::{CleanParams, NoiseLevel, clean_with, estimate_noise};
use crate::dense::{ODD_SIDES, WindowParams, map_windows};
use crate::filter_error::FilterError;
use crate::pointwise::{Sides, apply, mixed};
use crate::stamp::stamp;
use ravec_progress::Progress;
use ravec_raster::{Color, Image, LinearRgba, Rect, Size};

/// Modes of the operator.
#[derive(
    Debug, Clone, Copy, Default, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize,
)]
#[serde(rename_all = "kebab-case")]
pub enum Mode {
    /// Even areas with crisp edges.
    Abstract,
    /// Less noise within areas.
    #[default]
    Smooth,
    /// Crisper edges without halos.
    Sharpen,
    /// Less noise and compression damage, texture kept.
    Clean,
    /// Smooth edges instead of stairs.
    Antialias,
    /// A picture made of two-color squares.
    Stamp,
}

/// Parameters of the operator.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct OperatorParams {
    /// Effect (default smooth).
    pub mode: Mode,
    /// Side of the windows in pixels, odd, 3 to 31 (default 9). Larger windows act more broadly. Cleaning has windows of its
    /// own and does not use it.
    pub window_px: usize,
    /// Share of the way that a pixel moves to its new color, 0 to 1 (default 1).
    pub strength: f32,
    /// Number of applications, 1 to 16 (default 1). More gives a stronger look. Stamping happens once.
    pub iterations: u32,
    /// For cleaning: the noise in steps of 8-bit values, estimated when not given.
    pub noise_sigma: Option<f32>,
    /// For stamping: another number scatters the squares differently (default 0).
    pub seed: u64,
}

impl Default for OperatorParams {
    fn default() -> Self {
        Self {
            mode: Mode::default(),
            window_px: 9,
            strength: 1.0,
            iterations: 1,
            noise_sigma: None,
            seed: 0,
        }
    }
}

/// The most iterations.
const MAX_ITERATIONS: u32 = 16;

impl OperatorParams {
    /// Refuses parameters out of range.
    ///
    /// # Errors
    /// [`FilterError`] for the first of them.
    pub fn check(&self) -> Result<(), FilterError> {
        if !(3..32).contains(&self.window_px) || self.window_px.is_multiple_of(2) {
            return Err(FilterError::Window {
                got: self.window_px,
                expected: ODD_SIDES,
            });
        }
        if !(0.0..=1.0).contains(&self.strength) {
            return Err(FilterError::Strength { got: self.strength });
        }
        if !(1..=MAX_ITERATIONS).contains(&self.iterations) {
            return Err(FilterError::Iterations {
                got: self.iterations,
            });
        }
        Ok(())
    }

    /// The windows of the modes that have one around each pixel.
    pub fn window(&self) -> WindowParams {
        WindowParams {
            window_px: self.window_px,
            ..WindowParams::default()
        }
    }

    /// The region of each iteration on an image of `size`; the last is `region`, clipped to the image. Each holds what the
    /// windows of the next one reach.
    ///
    /// # Errors
    /// [`FilterError::EmptyRegion`] if the region has no pixel of the image.
    pub fn regions(&self, region: Rect, size: Size) -> Result<Vec<Rect>, FilterError> {
        let whole = Rect::of(size);
        let region = region.intersection(whole);
        if region.is_empty() {
            return Err(FilterError::EmptyRegion);
        }
        let rounds = if self.mode == Mode::Stamp {
            1
        } else {
            self.iterations as usize
        };
        let around = |rounds_left: usize| {
            match self.mode {
                Mode::Clean if rounds_left > 0 => on_clean_grid(region, rounds_left),
                _ => grown(region, self.window_px / 2 * rounds_left),
            }
            .intersection(whole)
        };
        Ok((0..rounds).rev().map(around).collect())
    }
}

/// The pixels of `region` (clipped to the image) after the operator.
///
/// # Errors
/// [`FilterError`] for a parameter out of range or a region without pixels; [`FilterError::Cancelled`] soon after `progress` is.
pub fn operate<P: Color>(
    image: &Image<P>,
    region: Rect,
    params: &OperatorParams,
    progress: &Progress,
) -> Result<Image<LinearRgba>, FilterError> {
    params.check()?;
    let noise = noise_for(image, params, progress)?;
    operate_with(image, region, params, noise.as_ref(), progress)
}

/// The noise that cleaning works against, in all its iterations: given, or that of the whole image. Nothing for the other
/// modes.
pub(crate) fn noise_for<P: Color>(
    image: &Image<P>,
    params: &OperatorParams,
    progress: &Progress,
) -> Result<Option<NoiseLevel>, FilterError> {
    if params.mode != Mode::Clean {
        return Ok(None);
    }
    match params.noise_sigma {
        Some(sigma) if !(0.0..=255.0).contains(&sigma) => Err(FilterError::Noise { got: sigma }),
        Some(sigma) => Ok(Some(NoiseLevel::uniform(sigma))),
        None => Ok(Some(estimate_noise(image, progress)?)),
    }
}

/// [`operate`] with what [`noise_for`] found before.
pub(crate) fn operate_with<P: Color>(
    image: &Image<P>,
    region: Rect,
    params: &OperatorParams,
    noise: Option<&NoiseLevel>,
    progress: &Progress,
) -> Result<Image<LinearRgba>, FilterError> {
    let mut regions = params.regions(region, image.size())?.into_iter();
    let mut at = regions.next().ok_or(FilterError::EmptyRegion)?;
    let mut current = step(image, at, params, noise, progress)?;
    for next in regions {
        let inner = Rect::new(
            next.col - at.col,
            next.row - at.row,
            next.width,
            next.height,
        );
        current = step(&current, inner, params, noise, progress)?;
        at = next;
    }
    Ok(current)
}

/// The region with what `rounds` of cleaning read around it, on the grid of its windows and blocks: these count from the
/// corner of the picture that they are given, so a part of it must begin at one of theirs.
fn on_clean_grid(region: Rect, rounds: usize) -> Rect {
    let margin = CLEAN_REACH * rounds;
    let grown = grown(region, margin);
    let [left, top] = [grown.col, grown.row].map(|v| v / CLEAN_GRID * CLEAN_GRID);
    Rect::new(left, top, grown.right() - left, grown.bottom() - top)
}

/// Pixels of the grid that the windows (2) and the blocks of compression (8) of cleaning have in common.
const CLEAN_GRID: usize = 8;

/// Largest distance between a cleaned pixel and the pixels it depends on: windows of 8 pixels over every pixel of its
/// block of compression.
const CLEAN_REACH: usize = 16;

/// A rectangle with `margin` more pixels on each side, as far as coordinates go.
fn grown(rect: Rect, margin: usize) -> Rect {
    let (left, top) = (
        rect.col.saturating_sub(margin),
        rect.row.saturating_sub(margin),
    );
    Rect::new(
        left,
        top,
        rect.right() + margin - left,
        rect.bottom() + margin - top,
    )
}

/// One application.
fn step<P: Color>(
    image: &Image<P>,
    region: Rect,
    params: &OperatorParams,
    noise: Option<&NoiseLevel>,
    progress: &Progress,
) -> Result<Image<LinearRgba>, FilterError> {
    let strength = params.strength;
    match (params.mode, noise) {
        (Mode::Clean, Some(noise)) => {
            let mut cleaned = clean_with(image, region, noise, &CleanParams::default(), progress)?;
            if strength < 1.0 {
                blend_rows(image, region, &mut cleaned, strength);
            }
            Ok(cleaned)
        }
        (Mode::Stamp, _) => {
            let mut stamped = stamp(image, region, params.window_px, params.seed, progress)?;
            if strength < 1.0 {
                blend_rows(image, region, &mut stamped, strength);
            }
            Ok(stamped)
        }
        (mode, _) => map_windows(
            image,
            region,
            &params.window(),
            progress,
            |col, row, window| {
                let pixel = image[(col, row)].to_linear();
                let sides = Sides::of(window, params.window_px);
                mixed(pixel, apply(mode, pixel, &sides), strength)
            },
        ),
    }
}

/// Takes a result back towards its source.
fn blend_rows<P: Color>(
    image: &Image<P>,
    region: Rect,
    result: &mut Image<LinearRgba>,
    strength: f32,
) {
    result.for_each_row(|y, row| {
        let source = &image.row(region.row + y)[region.col..];
        for (out, pixel) in row.iter_mut().zip(source) {
            *out = mixed(pixel.to_linear(), *out, strength);
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use ravec_raster::{Oklab, Size, Srgb};

    const MODES: [Mode; 6] = [
        Mode::Abstract,
        Mode::Smooth,
        Mode::Sharpen,
        Mode::Clean,
        Mode::Antialias,
        Mode::Stamp,
    ];

    fn run(image: &Image<LinearRgba>, region: Rect, params: &OperatorParams) -> Image<LinearRgba> {
        operate(image, region, params, &Progress::none()).unwrap()
    }

    fn of(mode: Mode) -> OperatorParams {
        OperatorParams {
            mode,
            noise_sigma: Some(6.0),
            ..OperatorParams::default()
        }
    }

    /// Two noisy halves along a slanted edge.
    fn noisy_edge(size: usize, sigma: f32) -> Image<LinearRgba> {
        let mut state = 9u64;
        let image = Image::from_fn(Size::new(size, size).unwrap(), |col, row| {
            let base = if 3 * col + row > 2 * size {
                [180.0, 150.0, 90.0]
            } else {
                [60.0, 80.0, 120.0f32]
            };
            let mut noise = || {
                state = state
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1_442_695_040_888_963_407);
                ((state >> 40) as f32 / (1u64 << 24) as f32 - 0.5) * sigma * 12f32.sqrt()
            };
            Srgb(base.map(|v| (v + noise()).round() as u8))
        });
        image.convert()
    }

    /// Root mean square distance in 8-bit steps from the picture without noise, away from the border.
    fn distance(a: &Image<LinearRgba>, b: &Image<LinearRgba>) -> f64 {
        let step = |p: LinearRgba| Srgb::<f32>::from_linear(p).0.map(|v| f64::from(v) * 255.0);
        let squares: f64 = a
            .pixels()
            .iter()
            .zip(b.pixels())
            .map(|(&a, &b)| {
                step(a)
                    .iter()
                    .zip(step(b))
                    .map(|(a, b)| (a - b) * (a - b))
                    .sum::<f64>()
            })
            .sum();
        (squares / (3 * a.size().pixels()) as f64).sqrt()
    }

    #[test]
    fn smoothing_modes_lower_the_noise_on_both_sides_of_an_edge() {
        let (clear, noisy) = (noisy_edge(64, 0.0), noisy_edge(64, 6.0));
        let before = distance(&clear, &noisy);
        for mode in [Mode::Abstract, Mode::Smooth, Mode::Clean] {
            let after = distance(&clear, &run(&noisy, Rect::of(noisy.size()), &of(mode)));
            // an edge that bled by a pixel would cost about 9 steps alone
            assert!(after < 0.4 * before, "{mode:?}: {before} to {after}");
        }
    }

    #[test]
    fn a_region_gives_the_same_pixels_as_the_whole_image() {
        let image = noisy_edge(70, 10.0);
        for mode in MODES {
            for iterations in [1, 3] {
                let params = OperatorParams {
                    iterations,
                    window_px: 5,
                    ..of(mode)
                };
                let whole = run(&image, Rect::of(image.size()), &params);
                for region in [Rect::new(20, 13, 31, 17), Rect::new(0, 50, 9, 20)] {
                    let part = run(&image, region, &params);
                    assert_eq!(
                        part,
                        whole.crop(region.col, region.row, part.size()).unwrap(),
                        "{mode:?}"
                    );
                }
            }
        }
    }

    #[test]
    fn sharpening_never_leaves_the_range_of_the_window() {
        let image = noisy_edge(48, 20.0);
        let sharp = run(
            &image,
            Rect::of(image.size()),
            &OperatorParams {
                window_px: 5,
                ..of(Mode::Sharpen)
            },
        );
        let lab = |image: &Image<LinearRgba>| image.convert::<Oklab>();
        let (before, after) = (lab(&image), lab(&sharp));
        for row in 0..48isize {
            for col in 0..48isize {
                for c in 0..3 {
                    let near = || (-2..=2).flat_map(|y| (-2..=2).map(move |x| (x, y)));
                    let values = || near().map(|(x, y)| before.clamped(col + x, row + y).0[c]);
                    let (low, high) = (
                        values().fold(f32::MAX, f32::min),
                        values().fold(f32::MIN, f32::max),
                    );
                    let value = after[(col as usize, row as usize)].0[c];
                    // the way through linear light rounds
                    assert!(
                        (low - 2e-5..=high + 2e-5).contains(&value),
                        "({col}, {row})"
                    );
                }
            }
        }
    }

    #[test]
    fn sharpening_steepens_a_blurred_edge() {
        let image = Image::from_fn(Size::new(32, 16).unwrap(), |col, _| {
            let v = (0.2 + 0.1 * (col as f32 - 12.0)).clamp(0.2, 0.8);
            LinearRgba([v, v, v, 1.0])
        });
        let sharp = run(
            &image,
            Rect::of(image.size()),
            &OperatorParams {
                window_px: 9,
                ..of(Mode::Sharpen)
            },
        );
        let steepest = |image: &Image<LinearRgba>| {
            (1..32)
                .map(|col| image[(col, 8)].0[0] - image[(col - 1, 8)].0[0])
                .fold(0.0, f32::max)
        };
        let (before, after) = (steepest(&image), steepest(&sharp));
        assert!(after > 2.5 * before, "{before} to {after}");
    }

    #[test]
    fn antialiasing_turns_stairs_into_mixtures() {
        let (dark, bright) = ([0.05f32, 0.05, 0.1], [0.9f32, 0.8, 0.7]);
        let stairs = Image::from_fn(Size::new(40, 40).unwrap(), |col, row| {
            let color = if 3 * col > row + 40 { bright } else { dark };
            LinearRgba::from_rgb_alpha(color, 1.0)
        });
        let smooth = run(&stairs, Rect::of(stairs.size()), &of(Mode::Antialias));
        let line = crate::Line {
            normal: glam::DVec2::new(3.0, -1.0).normalize(),
            offset_px: 0.0,
        };
        let shift = glam::DVec2::new(13.9, 0.0);
        let (mut before, mut after) = (0.0, 0.0);
        for row in 8..32 {
            for col in 8..32 {
                let p = glam::DVec2::new(col as f64 + 0.5, row as f64 + 0.5) - shift;
                let f = line.coverage(p) as f32;
                let truth = f * dark[0] + (1.0 - f) * bright[0];
                before += (stairs[(col, row)].0[0] - truth).abs();
                after += (smooth[(col, row)].0[0] - truth).abs();
            }
        }
        assert!(after < 0.6 * before, "{before} to {after}");
    }

    #[test]
    fn pixels_that_are_not_numbers_stay_and_do_not_spread() {
        let mut image = noisy_edge(40, 5.0);
        image[(20, 20)] = LinearRgba([f32::NAN, 0.5, f32::INFINITY, 1.0]);
        for mode in MODES {
            let result = run(&image, Rect::of(image.size()), &of(mode));
            let broken = result
                .pixels()
                .iter()
                .filter(|p| p.0.iter().any(|v| !v.is_finite()));
            // a stamped picture shows no pixel of the source
            let expected = usize::from(mode != Mode::Stamp);
            assert_eq!(broken.count(), expected, "{mode:?}");
        }
    }

    #[test]
    fn parameters_out_of_range_are_refused() {
        let image = noisy_edge(16, 0.0);
        let refused = |params: OperatorParams| {
            operate(&image, Rect::of(image.size()), &params, &Progress::none()).unwrap_err()
        };
        let base = OperatorParams::default;
        assert_eq!(
            refused(OperatorParams {
                window_px: 4,
                ..base()
            }),
            FilterError::Window {
                got: 4,
                expected: ODD_SIDES
            }
        );
        assert_eq!(
            refused(OperatorParams {
                strength: 1.5,
                ..base()
            }),
            FilterError::Strength { got: 1.5 }
        );
        assert_eq!(
            refused(OperatorParams {
                iterations: 0,
                ..base()
            }),
            FilterError::Iterations { got: 0 }
        );
    }

    #[test]
    fn transparency_and_tiny_pictures_survive_every_mode() {
        for mode in MODES {
            let image = Image::from_fn(Size::new(20, 3).unwrap(), |col, _| {
                LinearRgba([0.4, 0.2, 0.1, if col % 5 == 0 { 0.0 } else { 0.5 }])
            });
            let result = run(&image, Rect::of(image.size()), &of(mode));
            if mode != Mode::Stamp {
                assert!(
                    result
                        .pixels()
                        .iter()
                        .zip(image.pixels())
                        .all(|(a, b)| a.alpha() == b.alpha()),
                    "{mode:?}"
                );
            }
            let one = Image::new(Size::new(1, 1).unwrap(), LinearRgba([0.4, 0.2, 0.1, 1.0]));
            let result = run(&one, Rect::of(one.size()), &of(mode));
            assert!((result[(0, 0)].0[0] - 0.4).abs() < 1e-4, "{mode:?}");
        }
    }
}

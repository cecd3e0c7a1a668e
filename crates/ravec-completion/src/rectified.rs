//! Sheets of planes: the rectified view.
//!
//! Cost: a few samples for each sheet pixel; the sheet has at most about twice as many pixels as the picture.

use crate::canvas::{Canvas, HOLE, Ink, KNOWN, SOURCE};
use crate::sheet::{Sheet, center};
use glam::{DVec2, IVec2, dvec2};
use ravec_planar::Homography;
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;

/// Sheet pixels per picture pixel at the hole. Less blurs what repeats, more costs and gains nothing.
pub(crate) const SCALE: f64 = 0.9;
/// Places whose resolution is below this share of the hole's do not serve as sources: they would show as a blur.
pub(crate) const MIN_RESOLUTION: f64 = 0.7;
/// The sheet goes on a little beyond, so that gradients are known where sources end.
const MARGIN: f64 = 0.9;
/// Samples for a sheet pixel in each direction, at most. Beyond, the picture is so much finer than the hole that
/// aliasing would not show.
const MAX_TAPS: f64 = 8.0;
/// Most sheet pixels for each pixel of the picture. Only planes seen under extreme angles come near.
const MAX_GROWTH: f64 = 4.0;

impl Sheet {
    /// The rectified view of a plane around the hole of a canvas, of which there is at least a pixel in front of the
    /// plane's horizon.
    pub(crate) fn rectified(
        canvas: &Canvas,
        image_from_plane: &Homography,
        progress: &Progress,
    ) -> Result<Option<Self>, Cancelled> {
        let extent = Self::extent(canvas, image_from_plane, progress)?;
        let Some(([width, height], image_from_sheet)) = extent else {
            return Ok(None);
        };
        let cells: Vec<(Ink, u8)> = (0..width * height)
            .into_par_iter()
            .with_min_len(512)
            .map(|index| {
                let at = center(IVec2::new((index % width) as i32, (index / width) as i32));
                if progress.is_cancelled() {
                    return ([0.0; 4], 0);
                }
                let Some((ink, state)) = sampled(canvas, &image_from_sheet, at) else {
                    return ([0.0; 4], 0);
                };
                let coarse = resolution(&image_from_sheet, at) < MIN_RESOLUTION;
                (ink, if coarse { state & !SOURCE } else { state })
            })
            .collect();
        progress.check()?;
        let (inks, states) = cells.into_iter().unzip();
        let mut sheet = Self {
            width,
            height,
            inks,
            states,
            features: Vec::new(),
            image_from_sheet,
        };
        progress.check()?;
        sheet.find_features();
        progress.check()?;
        Ok(Some(sheet))
    }

    /// The size of the rectified view, and the map from it.
    pub(crate) fn extent(
        canvas: &Canvas,
        image_from_plane: &Homography,
        progress: &Progress,
    ) -> Result<Option<([usize; 2], Homography)>, Cancelled> {
        let found = extent(canvas, image_from_plane, progress)?;
        Ok(found.and_then(|(low, size, image_from_sheet)| {
            let shift = Homography::from_translation(low).ok()?;
            Some((size, image_from_sheet * shift))
        }))
    }
}

/// Origin of the sheet, its size, and the map from it, at the scale of the hole.
fn extent(
    canvas: &Canvas,
    image_from_plane: &Homography,
    progress: &Progress,
) -> Result<Option<(DVec2, [usize; 2], Homography)>, Cancelled> {
    let plane_from_image = image_from_plane.inverse();
    let (width, height) = (canvas.states.width(), canvas.states.height());
    let middle = |(col, row): (usize, usize)| dvec2(col as f64 + 0.5, row as f64 + 0.5);
    // steps of the plane that are a picture pixel long at the hole, in each direction
    let (mut steps, mut count) = (DVec2::ZERO, 0.0);
    for row in 0..height {
        progress.check()?;
        for place in (0..width).map(|col| (col, row)) {
            if canvas.states[place] & HOLE == 0 {
                continue;
            }
            if let Some(at) = plane_from_image.try_apply(middle(place)) {
                let j = image_from_plane.jacobian(at);
                steps += dvec2(j.x_axis.length(), j.y_axis.length());
                count += 1.0;
            }
        }
    }
    if count == 0.0 {
        return Ok(None);
    }
    let Ok(sheet_from_plane) = Homography::from_scale(SCALE * steps / count) else {
        return Ok(None);
    };
    let image_from_sheet = *image_from_plane * sheet_from_plane.inverse();
    let sheet_from_image = image_from_sheet.inverse();
    let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
    for row in 0..height {
        progress.check()?;
        for place in (0..width).map(|col| (col, row)) {
            let Some(at) = sheet_from_image.try_apply(middle(place)) else {
                continue;
            };
            let hole = canvas.states[place] & HOLE != 0;
            if hole || resolution(&image_from_sheet, at) > MARGIN * MIN_RESOLUTION {
                low = low.min(at);
                high = high.max(at);
            }
        }
    }
    let low = low.floor();
    let size = (high - low).ceil() + 1.0;
    let fits =
        size.is_finite() && size.element_product() <= MAX_GROWTH * (width * height) as f64 + 1e4;
    Ok(fits.then_some((low, [size.x as usize, size.y as usize], image_from_sheet)))
}

/// Picture pixels for each sheet pixel, against what there are at the hole: 1 there in the mean.
fn resolution(image_from_sheet: &Homography, at: DVec2) -> f64 {
    SCALE * image_from_sheet.jacobian(at).determinant().abs().sqrt()
}

/// The mean ink under a sheet pixel, and what is known about it, unless it lies outside the picture.
pub(crate) fn sampled(
    canvas: &Canvas,
    image_from_sheet: &Homography,
    at: DVec2,
) -> Option<(Ink, u8)> {
    let end = dvec2(canvas.inks.width() as f64, canvas.inks.height() as f64);
    let from = image_from_sheet.try_apply(at)?;
    if from.cmplt(DVec2::ZERO).any() || from.cmpge(end).any() {
        return None;
    }
    let j = image_from_sheet.jacobian(at);
    let taps = j
        .x_axis
        .length()
        .max(j.y_axis.length())
        .ceil()
        .clamp(1.0, MAX_TAPS);
    let ink = mean_ink(canvas, taps as usize, |d| from + j * d);
    // what lies under the pixel, and at least the four nearest pixels, decides
    let reach = (0.5 * (j.x_axis.abs() + j.y_axis.abs())).max(DVec2::splat(0.75));
    let low = (from - reach).floor().max(DVec2::ZERO).as_usizevec2();
    let high = (from + reach).floor().min(end - 1.0).as_usizevec2();
    let (mut all, mut any) = (u8::MAX, 0);
    for row in low.y..=high.y {
        for col in low.x..=high.x {
            let state = canvas.states[(col, row)];
            all &= state;
            any |= state;
        }
    }
    let state = if any & HOLE != 0 {
        HOLE
    } else {
        all & (KNOWN | SOURCE)
    };
    Some((ink, state))
}

/// The mean of `taps` × `taps` samples of the picture; `place` takes steps of −½ to ½ to where they are taken.
pub(crate) fn mean_ink(canvas: &Canvas, taps: usize, place: impl Fn(DVec2) -> DVec2) -> Ink {
    let share = 1.0 / (taps * taps) as f32;
    let mut mean = [0.0f32; 4];
    for k in 0..taps * taps {
        let step = (dvec2((k % taps) as f64, (k / taps) as f64) + 0.5) / taps as f64 - 0.5;
        let value = canvas.inks.catmull_rom(place(step));
        for (mean, value) in mean.iter_mut().zip(value) {
            *mean += share * value;
        }
    }
    mean
}

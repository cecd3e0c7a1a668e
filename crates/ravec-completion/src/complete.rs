//! Filling a hole without further questions.
//!
//! The plain idea: whatever was behind the hole goes on like its surroundings, and somewhere in the picture it looks
//! alike. So: propose offsets at which it does ([`crate::proposals`]), let one graph cut decide which pixel takes which
//! offset ([`crate::cut`]), find the offsets to a fraction of a pixel ([`crate::subpixel`]), and compose
//! ([`crate::compose`]). On planes all of that happens in the rectified view. A part too thin to need a copy is bent
//! over ([`crate::thin`]).
//!
//! Sources: Pavić, Schönefeld and Kobbelt, "Interactive image completion with perspective correction", 2006, for planes
//! and the search; He and Sun, "Statistics of patch offsets for image completion", 2012, for the cut over offsets.
//!
//! Cost: about 40 microseconds of one core for each pixel of the hole, and a second for twelve megapixels around it.

use crate::canvas::{Canvas, HOLE, KNOWN, SOURCE, mixed};
use crate::compose::{Composition, compose};
use crate::cut::{Cut, UNLABELED};
use crate::error::{CompleteError, largest_radius, plane_map};
use crate::guidance::guidance;
use crate::parts::{self, Part};
use crate::proposals::{self, Proposals};
use crate::sheet::Sheet;
use crate::{subpixel, thin};
use glam::{DVec2, IVec2};
use ravec_planar::Homography;
use ravec_progress::{Cancelled, Progress};
use ravec_raster::{Color, Image, Mask, Rect};
use serde::{Deserialize, Serialize};

/// Parameters of completion.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CompleteParams {
    /// Radius around the hole within which sources without a plane are searched, in pixels, 16 and more (default 200).
    /// Farther finds more, of which more is in another light or at another distance.
    pub search_px: usize,
    /// Bend the tones of what is copied to those of the rim (default true). Without it seams show where light changes, but
    /// colors are exactly those of the source.
    pub blend: bool,
}

impl Default for CompleteParams {
    fn default() -> Self {
        Self {
            search_px: 200,
            blend: true,
        }
    }
}

/// A picture without its hole.
#[derive(Debug, Clone, PartialEq)]
pub struct Completed<P> {
    /// The picture.
    pub image: Image<P>,
    /// Report.
    pub summary: CompleteSummary,
}

/// Report of filling a hole.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
pub struct CompleteSummary {
    /// Pixels of the hole, those covered in part included.
    pub hole_px: usize,
    /// Of these, the ones that were thin enough to be interpolated.
    pub thin_px: usize,
    /// For each plane, pixels that were filled along it.
    pub plane_px: Vec<usize>,
    /// Parts that were filled one after another.
    pub parts: usize,
    /// Offsets that were proposed.
    pub proposals: usize,
    /// Offsets from which pixels came.
    pub offsets: usize,
    /// Pixels for which there was no source, and which were interpolated.
    pub sourceless_px: usize,
}

/// Fills `hole` from the rest of `image`.
///
/// Pixels that the mask does not cover are returned unchanged, bit for bit; those that it covers in part are mixed, in
/// linear light. `planes` are quadrilaterals in the picture, corners in order around them, in pixels, x right, y down,
/// pixel centers at half-integers: pictures of rectangles. The part of the hole that lies in one is filled in its
/// perspective, from anywhere on the plane that is not much coarser; where several overlap, the first one counts.
///
/// ```
/// use ravec_completion::{CompleteParams, complete};
/// use ravec_progress::Progress;
/// use ravec_raster::{Image, Mask, Rect, Size, Srgb};
///
/// // tiles, and a stain on them
/// let size = Size::new(120, 90)?;
/// let tiles = Image::from_fn(size, |col, row| {
///     Srgb(if col % 20 < 2 || row % 15 < 2 { [200u8, 200, 190] } else { [90, 60, 50] })
/// });
/// let hole = Mask::from_rect(size, Rect::new(50, 40, 24, 20));
/// let stained = Image::from_fn(size, |col, row| if hole.at(col, row) > 0.0 { Srgb([0; 3]) } else { tiles[(col, row)] });
///
/// let completed = complete(&stained, &hole, &[], &CompleteParams::default(), &Progress::none())?;
/// let wrong = completed.image.pixels().iter().zip(tiles.pixels()).filter(|(a, b)| a.0[0].abs_diff(b.0[0]) > 8);
/// assert!(wrong.count() < 10, "of 480 pixels");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`CompleteError::MaskSize`], [`CompleteError::NoSource`] if no pixel is more than 3 pixels away from the hole, for
/// planes [`CompleteError::QuadCrosses`], [`CompleteError::Plane`] and [`CompleteError::PlaneOutside`],
/// [`CompleteError::Cancelled`] soon after `progress` is cancelled.
pub fn complete<P: Color>(
    image: &Image<P>,
    hole: &Mask,
    planes: &[[DVec2; 4]],
    params: &CompleteParams,
    progress: &Progress,
) -> Result<Completed<P>, CompleteError> {
    if image.size() != hole.size() {
        return Err(CompleteError::MaskSize {
            image: image.size(),
            mask: hole.size(),
        });
    }
    let mut maps = Vec::new();
    for (index, quad) in planes.iter().enumerate() {
        maps.push(plane_map(quad, image.size(), index + 1)?);
    }
    let mut summary = CompleteSummary {
        hole_px: hole
            .coverage()
            .pixels()
            .iter()
            .filter(|&&coverage| coverage > 0.0)
            .count(),
        ..CompleteSummary::default()
    };
    if summary.hole_px == 0 {
        summary.plane_px = vec![0; planes.len()];
        return Ok(Completed {
            image: image.clone(),
            summary,
        });
    }
    let mut canvas = Canvas::new(image, hole, progress)?;
    let along: Vec<_> = planes.iter().zip(&maps).collect();
    fill_all(&mut canvas, hole, &along, params, &mut summary, progress)?;
    let mut filled = image.clone();
    for row in 0..image.height() {
        for col in 0..image.width() {
            let coverage = hole.at(col, row);
            if coverage > 0.0 {
                filled[(col, row)] = mixed(image[(col, row)], canvas.inks[(col, row)], coverage);
            }
        }
    }
    Ok(Completed {
        image: filled,
        summary,
    })
}

/// Fills the hole of a canvas, along the planes, each with its map, as far as it lies in them.
fn fill_all(
    canvas: &mut Canvas,
    hole: &Mask,
    planes: &[(&[DVec2; 4], &Homography)],
    params: &CompleteParams,
    summary: &mut CompleteSummary,
    progress: &Progress,
) -> Result<(), CompleteError> {
    if !canvas
        .states
        .pixels()
        .iter()
        .any(|&state| state & SOURCE != 0)
    {
        return Err(CompleteError::NoSource {
            largest_radius_px: largest_radius(hole),
        });
    }
    progress.check()?;
    let thin = thin::thin_parts(hole);
    progress.check()?;
    summary.thin_px = thin.area_px() as usize;
    thin::bend(
        &mut canvas.inks,
        &thin,
        |col, row| hole.at(col, row) > 0.0,
        progress,
    )?;
    for (state, &thin) in canvas
        .states
        .pixels_mut()
        .iter_mut()
        .zip(thin.coverage().pixels())
    {
        if thin > 0.0 {
            *state = KNOWN;
        }
    }
    let mut rest = Mask::from_fn(hole.size(), |col, row| {
        hole.at(col, row) > 0.0 && thin.at(col, row) == 0.0
    });
    for (quad, map) in planes {
        let part = parts::take_quad(&mut rest, quad);
        summary.plane_px.push(part.len());
        fill(canvas, &part, Some(map), params, summary, progress)?;
    }
    for part in parts::split(&rest) {
        fill(canvas, &part, None, params, summary, progress)?;
    }
    Ok(())
}

/// Labels that remain for the cut of single pixels: those that won the most cells before.
const MAX_OFFSETS: usize = 120;
/// Most cells of the first cut. Larger ones follow seams less well, smaller ones cost more; pixels decide in the end.
const MAX_CELLS: usize = 20_000;

/// Fills a part of the hole, along a plane if there is one.
fn fill(
    canvas: &mut Canvas,
    part: &Part,
    plane: Option<&Homography>,
    params: &CompleteParams,
    summary: &mut CompleteSummary,
    progress: &Progress,
) -> Result<(), CompleteError> {
    if part.is_empty() {
        return Ok(());
    }
    progress.check()?;
    for &place in part {
        canvas.states[place] = HOLE;
    }
    let rectified = match plane {
        Some(plane) => Sheet::rectified(canvas, plane, progress)?,
        None => None,
    };
    let sheet = rectified.unwrap_or_else(|| flat(canvas, part, params));
    let found = proposals::propose(&sheet, progress)?;
    let mut offsets = distinct(&found);
    summary.proposals += offsets.len();
    cover(&sheet, &mut offsets);
    let guidance = guidance(&sheet, progress)?;
    let cut = Cut {
        sheet: &sheet,
        offsets: &offsets,
        guidance: &guidance,
    };
    let mut side = 2;
    while part.len() / (side * side) > MAX_CELLS {
        side *= 2;
    }
    let coarse = cut.assign(side as i32, None, None, 2, progress)?;
    let (kept, start) = most_used(&offsets, &coarse);
    let cut = Cut {
        offsets: &kept,
        ..cut
    };
    let labels = cut.assign(1, Some(&start), Some(side as i32 + 1), 2, progress)?;
    let (fine, used) = to_subpixel(&sheet, &kept, &labels, progress)?;
    summary.offsets += used;
    summary.parts += 1;
    summary.sourceless_px += sheet
        .hole()
        .filter(|&index| labels[index] == UNLABELED)
        .count();
    let composition = Composition {
        sheet: &sheet,
        labels: &labels,
        offsets: &fine,
    };
    compose(canvas, &composition, params.blend, progress)?;
    for &place in part {
        canvas.states[place] = KNOWN;
    }
    Ok(())
}

/// The window around a part, grown until there are sources in it.
fn flat(canvas: &Canvas, part: &Part, params: &CompleteParams) -> Sheet {
    let bounds = part
        .iter()
        .map(|&(col, row)| Rect::new(col, row, 1, 1))
        .reduce(Rect::bounding)
        .unwrap_or_default();
    let mut margin = params.search_px.max(16);
    loop {
        let window = bounds.grown(margin).clipped(canvas.states.size());
        let sheet = Sheet::window(canvas, window);
        let sources = (0..sheet.states.len())
            .filter(|&index| sheet.is(index, SOURCE))
            .count();
        if sources >= 2 * part.len() || window == Rect::of(canvas.states.size()) {
            return sheet;
        }
        margin *= 2;
    }
}

/// All proposals, each once, the most promising kind first.
fn distinct(found: &Proposals) -> Vec<IVec2> {
    let mut offsets = Vec::new();
    for proposal in found.ring.iter().chain(&found.periods).chain(&found.discs) {
        if !offsets.contains(&proposal.offset) {
            offsets.push(proposal.offset);
        }
    }
    offsets
}

/// Most offsets that are added so that each pixel has a source.
const MAX_COVERING: usize = 64;

/// Adds offsets until each pixel of the hole has a source with one of them.
fn cover(sheet: &Sheet, offsets: &mut Vec<IVec2>) {
    let fills = |offset: IVec2, pixel: usize| {
        sheet
            .shifted(pixel, offset)
            .is_some_and(|source| sheet.is(source, SOURCE))
    };
    let mut open: Vec<usize> = sheet
        .hole()
        .filter(|&pixel| !offsets.iter().any(|&offset| fills(offset, pixel)))
        .collect();
    let sources: Vec<usize> = (0..sheet.states.len())
        .filter(|&index| sheet.is(index, SOURCE))
        .collect();
    let stride = (sources.len() / 200).max(1);
    for _ in 0..MAX_COVERING {
        let Some(&pixel) = open.get(open.len() / 2) else {
            return;
        };
        let thinned = (open.len() / 300).max(1);
        let gain = |offset: IVec2| {
            open.iter()
                .step_by(thinned)
                .filter(|&&pixel| fills(offset, pixel))
                .count()
        };
        let candidates = sources
            .iter()
            .step_by(stride)
            .map(|&source| sheet.position(source) - sheet.position(pixel));
        let Some(best) = candidates.max_by_key(|&offset| gain(offset)) else {
            return;
        };
        open.retain(|&pixel| !fills(best, pixel));
        offsets.push(best);
    }
}

/// The offsets with the most pixels, and the labels renumbered for them.
fn most_used(offsets: &[IVec2], labels: &[u16]) -> (Vec<IVec2>, Vec<u16>) {
    let mut counts = vec![0u32; offsets.len()];
    for &label in labels.iter().filter(|&&label| label != UNLABELED) {
        counts[usize::from(label)] += 1;
    }
    let mut order: Vec<usize> = (0..offsets.len())
        .filter(|&label| counts[label] > 0)
        .collect();
    order.sort_by_key(|&label| std::cmp::Reverse((counts[label], label)));
    order.truncate(MAX_OFFSETS);
    let mut renumbered = vec![UNLABELED; offsets.len()];
    for (new, &old) in order.iter().enumerate() {
        renumbered[old] = new as u16;
    }
    let start = labels.iter().map(|&label| {
        if label == UNLABELED {
            UNLABELED
        } else {
            renumbered[usize::from(label)]
        }
    });
    (
        order.iter().map(|&label| offsets[label]).collect(),
        start.collect(),
    )
}

/// The offsets to a fraction of a pixel, and the number of them that are used.
fn to_subpixel(
    sheet: &Sheet,
    offsets: &[IVec2],
    labels: &[u16],
    progress: &Progress,
) -> Result<(Vec<DVec2>, usize), Cancelled> {
    let mut used = vec![false; offsets.len()];
    for index in sheet.hole().filter(|&index| labels[index] != UNLABELED) {
        used[usize::from(labels[index])] = true;
    }
    let ring = proposals::around(sheet, usize::MAX);
    let mut fine = Vec::with_capacity(offsets.len());
    for (&offset, &used) in offsets.iter().zip(&used) {
        progress.check()?;
        fine.push(if used {
            subpixel::refined(sheet, &ring, offset)
        } else {
            offset.as_dvec2()
        });
    }
    Ok((fine, used.iter().filter(|&&used| used).count()))
}

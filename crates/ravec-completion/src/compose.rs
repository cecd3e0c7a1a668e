//! From labels to pixels: everything is sampled once, from the original, and blended along the seams.
//!
//! A pixel of the hole goes to the sheet, along its offset, and back into the picture: the maps are multiplied before
//! anything is sampled, so that nothing is resampled twice. Near a seam a pixel takes a share from each of the pieces that
//! meet there and agree, and wants a share of the gradients of each; then the tones are solved for (see [`crate::blend`]).

use crate::blend::{self, Blend};
use crate::canvas::{Canvas, HOLE, Ink, KNOWN};
use crate::cut::UNLABELED;
use crate::rectified::mean_ink;
use crate::sheet::{Sheet, center, ink_distance_sq};
use glam::{DVec2, IVec2, dvec2};
use ravec_planar::Homography;
use ravec_progress::{Cancelled, Progress};
use ravec_raster::Rect;
use rayon::prelude::*;

/// The standard deviation of the transition between two pieces. None at all leaves visible seams, much more a blur.
const FEATHER_PX: f32 = 4.0;
/// Beyond two standard deviations there is next to nothing.
const REACH_PX: isize = 8;
/// Difference of a piece from the rim above which the rim has an edge that the piece has not, and its tone should not follow.
const TRUSTED_STEP: f32 = 0.6;
/// Pieces that differ by more than this at a pixel show different things, and the one that is not the pixel's own has little
/// share in it: else the edges of what lies beyond a seam would come through it, as faint steps in an even sky. Less keeps
/// more contrast, and tones meet more abruptly.
const SAME_THING: f32 = 0.25;
/// Samples for a pixel in each direction where the source is finer than the hole, at most.
const MAX_TAPS: f64 = 4.0;

/// A labeled hole.
pub(crate) struct Composition<'a> {
    pub(crate) sheet: &'a Sheet,
    /// A label for each pixel of the sheet.
    pub(crate) labels: &'a [u16],
    /// Offset of the source of each label, in sheet pixels.
    pub(crate) offsets: &'a [DVec2],
}

/// A pixel of the hole with the shares of the pieces that it is made of, its own first; those of a pixel without a piece are
/// empty.
struct Piece {
    place: (usize, usize),
    shares: Vec<(u16, f32)>,
}

impl Piece {
    fn normalize(&mut self) {
        let sum: f32 = self.shares.iter().map(|share| share.1).sum();
        for share in &mut self.shares {
            share.1 /= sum;
        }
    }
}

/// The maps of a composition.
struct Maps<'a> {
    canvas: &'a Canvas,
    composition: &'a Composition<'a>,
    sheet_from_image: Homography,
}

impl Maps<'_> {
    fn on_sheet(&self, (col, row): (usize, usize)) -> DVec2 {
        self.sheet_from_image
            .apply(dvec2(col as f64 + 0.5, row as f64 + 0.5))
    }

    fn label(&self, place: (usize, usize)) -> u16 {
        let index = self
            .composition
            .sheet
            .index(self.on_sheet(place).floor().as_ivec2());
        index.map_or(UNLABELED, |index| self.composition.labels[index])
    }

    /// Returns `true` if a piece goes on as far as this pixel.
    fn reaches(&self, place: (usize, usize), label: u16) -> bool {
        let at = self.on_sheet(place) + self.composition.offsets[usize::from(label)];
        let sheet = self.composition.sheet;
        sheet
            .index(at.floor().as_ivec2())
            .is_some_and(|index| sheet.is(index, KNOWN))
    }

    /// Value of a piece at a pixel.
    fn sample(&self, place: (usize, usize), label: u16) -> Ink {
        let at = self.on_sheet(place) + self.composition.offsets[usize::from(label)];
        let image_from_sheet = &self.composition.sheet.image_from_sheet;
        let from = image_from_sheet.apply(at);
        let j =
            image_from_sheet.jacobian(at) * self.sheet_from_image.jacobian(center(place_of(place)));
        let finer = j.x_axis.length().max(j.y_axis.length());
        // a little finer is still within what the kernel distinguishes
        let taps = (finer - 0.25).ceil().clamp(1.0, MAX_TAPS);
        mean_ink(self.canvas, taps as usize, |step| from + j * step)
    }

    /// The mean of the pieces at a pixel, after the shares of pieces that show something else there than its own are made
    /// smaller.
    fn blended(&self, piece: &mut Piece) -> Ink {
        let inks: Vec<Ink> = piece
            .shares
            .iter()
            .map(|&(label, _)| self.sample(piece.place, label))
            .collect();
        let mut mean = [0.0; 4];
        let Some(own) = inks.first() else {
            return mean;
        };
        for ((_, share), ink) in piece.shares.iter_mut().zip(&inks) {
            let step = ink_distance_sq(ink, own) / (SAME_THING * SAME_THING);
            *share *= (1.0 + step).powi(-2);
        }
        piece.normalize();
        for (&(_, share), ink) in piece.shares.iter().zip(&inks) {
            for c in 0..4 {
                mean[c] += share * ink[c];
            }
        }
        mean
    }

    /// The wanted difference between two neighbors, with the weight of the pieces that say so.
    fn difference(&self, a: &Piece, b: (usize, usize), shares: &[(u16, f32)]) -> (Ink, f32) {
        let (mut sum, mut weight) = ([0.0; 4], 0.0);
        for &(label, share) in shares {
            if self.reaches(a.place, label) && self.reaches(b, label) {
                let (here, there) = (self.sample(a.place, label), self.sample(b, label));
                weight += share;
                for c in 0..4 {
                    sum[c] += share * (here[c] - there[c]);
                }
            }
        }
        (sum, weight)
    }
}

fn place_of((col, row): (usize, usize)) -> IVec2 {
    IVec2::new(col as i32, row as i32)
}

/// Fills the hole of a canvas.
pub(crate) fn compose(
    canvas: &mut Canvas,
    composition: &Composition,
    blend: bool,
    progress: &Progress,
) -> Result<(), Cancelled> {
    let Some(bounds) = hole_bounds(canvas) else {
        return Ok(());
    };
    let (places, values) = {
        let maps = Maps {
            canvas,
            composition,
            sheet_from_image: composition.sheet.image_from_sheet.inverse(),
        };
        let mut pieces = pieces(&maps, bounds, progress)?;
        let values = pieces
            .par_iter_mut()
            .with_min_len(64)
            .map(|piece| {
                progress.check()?;
                Ok(maps.blended(piece))
            })
            .collect::<Result<Vec<Ink>, Cancelled>>()?;
        let mut system = system(&maps, &pieces, values, bounds, blend, progress)?;
        blend::solve(&mut system, progress)?;
        let places: Vec<(usize, usize)> = pieces.iter().map(|piece| piece.place).collect();
        (places, system.values)
    };
    for (place, value) in places.into_iter().zip(values) {
        canvas.inks[place] = value;
    }
    Ok(())
}

fn hole_bounds(canvas: &Canvas) -> Option<Rect> {
    let width = canvas.states.width();
    let holes = canvas
        .states
        .pixels()
        .iter()
        .enumerate()
        .filter(|(_, state)| **state & HOLE != 0);
    holes
        .map(|(index, _)| Rect::new(index % width, index / width, 1, 1))
        .reduce(Rect::bounding)
}

/// The pixels of the hole with their shares.
fn pieces(maps: &Maps, bounds: Rect, progress: &Progress) -> Result<Vec<Piece>, Cancelled> {
    let places = |rect: Rect| {
        (0..rect.pixels()).map(move |k| (rect.col + k % rect.width, rect.row + k / rect.width))
    };
    let hole = |place| maps.canvas.states[place] & HOLE != 0;
    let labels: Vec<u16> = places(bounds)
        .map(|place| {
            if hole(place) {
                maps.label(place)
            } else {
                UNLABELED
            }
        })
        .collect();
    let label = |col: usize, row: usize| {
        bounds
            .contains(col, row)
            .then(|| labels[(row - bounds.row) * bounds.width + col - bounds.col])
            .filter(|&label| label != UNLABELED)
    };
    let members: Vec<(usize, usize)> = places(bounds).filter(|&place| hole(place)).collect();
    members
        .into_par_iter()
        .with_min_len(256)
        .map(|place| {
            progress.check()?;
            let Some(own) = label(place.0, place.1) else {
                return Ok(Piece {
                    place,
                    shares: Vec::new(),
                });
            };
            let mut shares = vec![(own, 0.0)];
            for dy in -REACH_PX..=REACH_PX {
                for dx in -REACH_PX..=REACH_PX {
                    let (col, row) = (
                        place.0.wrapping_add_signed(dx),
                        place.1.wrapping_add_signed(dy),
                    );
                    let Some(other) = label(col, row) else {
                        continue;
                    };
                    let share =
                        (-0.5 * (dx * dx + dy * dy) as f32 / (FEATHER_PX * FEATHER_PX)).exp();
                    match shares.iter_mut().find(|known| known.0 == other) {
                        Some(known) => known.1 += share,
                        None => shares.push((other, share)),
                    }
                }
            }
            shares.retain(|&(label, _)| label == own || maps.reaches(place, label));
            let mut piece = Piece { place, shares };
            piece.normalize();
            Ok(piece)
        })
        .collect()
}

/// The system of equations for the values: with `blend` their gradients are those of the pieces, else they equal the
/// pieces. Pixels without a piece go on smoothly in any case.
fn system(
    maps: &Maps,
    pieces: &[Piece],
    values: Vec<Ink>,
    bounds: Rect,
    blend: bool,
    progress: &Progress,
) -> Result<Blend, Cancelled> {
    let mut number = vec![u32::MAX; bounds.pixels()];
    let at = |(col, row): (usize, usize)| (row - bounds.row) * bounds.width + col - bounds.col;
    for (index, piece) in pieces.iter().enumerate() {
        number[at(piece.place)] = index as u32;
    }
    let size = maps.canvas.states.size();
    let mut system = Blend {
        values,
        ..Blend::default()
    };
    for (i, piece) in pieces.iter().enumerate() {
        progress.check()?;
        if !blend && !piece.shares.is_empty() {
            system.anchors.push((i as u32, system.values[i], 1.0));
            continue;
        }
        let (col, row) = piece.place;
        for (x, y) in [
            (col.wrapping_sub(1), row),
            (col, row.wrapping_sub(1)),
            (col + 1, row),
            (col, row + 1),
        ] {
            if x >= size.width() || y >= size.height() {
                continue;
            }
            let j = if bounds.contains(x, y) {
                number[at((x, y))]
            } else {
                u32::MAX
            };
            if j == u32::MAX {
                if maps.canvas.states[(x, y)] & KNOWN == 0 {
                    continue;
                }
                let (sum, weight) = maps.difference(piece, (x, y), &piece.shares);
                let known = maps.canvas.inks[(x, y)];
                if weight > 0.0 {
                    let wanted = std::array::from_fn(|c| known[c] + sum[c] / weight);
                    let step =
                        ink_distance_sq(&wanted, &system.values[i]) / (TRUSTED_STEP * TRUSTED_STEP);
                    system
                        .anchors
                        .push((i as u32, wanted, (1.0 + step).powi(-2)));
                } else if piece.shares.is_empty() {
                    system.anchors.push((i as u32, known, 1.0));
                }
            } else if (j as usize) < i {
                let other = &pieces[j as usize];
                let (a, wa) = maps.difference(piece, other.place, &piece.shares);
                let (b, wb) = maps.difference(piece, other.place, &other.shares);
                if wa + wb > 0.0 {
                    let wanted = std::array::from_fn(|c| (a[c] + b[c]) / (wa + wb));
                    system.pairs.push((i as u32, j, wanted));
                } else if piece.shares.is_empty() || other.shares.is_empty() {
                    system.pairs.push((i as u32, j, [0.0; 4]));
                }
            }
        }
    }
    Ok(system)
}

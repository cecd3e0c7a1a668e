//! A picture of half the size, to begin with where a hole is large.

use super::index::FragmentIndex;
use super::retouch::Retouch;
use super::target::Step;
use crate::canvas::{Canvas, HOLE, KNOWN, SOURCE};
use crate::error::{CompleteError, plane_map};
use glam::DVec2;
use ravec_progress::Progress;
use ravec_raster::{Image, Mask, Size};
use rayon::prelude::*;

impl Retouch<'_> {
    /// The index of the picture as it is now, and of the other photos, at half the size; none if a picture is too small
    /// or nothing could be copied from it.
    pub(super) fn halved(
        &self,
        progress: &Progress,
    ) -> Result<Option<FragmentIndex>, CompleteError> {
        let index = self.index;
        let mut photos = Vec::new();
        for canvas in std::iter::once(&self.canvas).chain(&index.photos[1..]) {
            progress.check()?;
            let Some(half) = halved(canvas) else {
                return Ok(None);
            };
            photos.push(half);
        }
        let states = &photos[0].states;
        let hole = Mask::from_fn(states.size(), |col, row| states[(col, row)] & HOLE != 0);
        let features = index.features.as_ref().map(|mask| {
            Mask::from_fn(states.size(), |col, row| {
                let cells =
                    [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(x, y)| (2 * col + x, 2 * row + y));
                cells
                    .iter()
                    .any(|&(x, y)| mask.coverage().get(x, y).is_some_and(|c| c > 0.0))
            })
        });
        let mut planes = Vec::new();
        for (number, view) in index.views.iter().enumerate() {
            // a plane without a view now would have none there either, but numbers must stay
            let Some(view) = view else {
                return Ok(None);
            };
            let quad = view.quad.map(|corner| 0.5 * corner);
            planes.push((quad, plane_map(&quad, states.size(), number + 1)?));
        }
        let variants = index.variants().to_vec();
        match FragmentIndex::from_canvases(photos, hole, features, planes, variants, progress) {
            Ok(half) => Ok(Some(half)),
            Err(CompleteError::Cancelled(cancelled)) => Err(cancelled.into()),
            Err(_) => Ok(None),
        }
    }
}

/// Means of what is known of 2 × 2 pixels. A pixel that is open in part is open.
fn halved(canvas: &Canvas) -> Option<Canvas> {
    let (width, height) = (canvas.inks.width(), canvas.inks.height());
    let size = Size::new(width / 2, height / 2).ok()?;
    let cells = |col: usize, row: usize| {
        [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(x, y)| (2 * col + x, 2 * row + y))
    };
    let state = |col: usize, row: usize| {
        let states = cells(col, row).map(|cell| canvas.states[cell]);
        if states.iter().any(|state| state & HOLE != 0) {
            return HOLE;
        }
        states.iter().fold(KNOWN | SOURCE, |all, state| all & state)
    };
    let ink = |col: usize, row: usize| {
        let (mut sum, mut count) = ([0.0f32; 4], 0.0f32);
        for cell in cells(col, row) {
            if canvas.states[cell] & KNOWN != 0 {
                count += 1.0;
                for (sum, value) in sum.iter_mut().zip(canvas.inks[cell]) {
                    *sum += value;
                }
            }
        }
        sum.map(|value| value / count.max(1.0))
    };
    let mut half = Canvas {
        inks: Image::new(size, [0.0; 4]),
        states: Image::new(size, 0),
    };
    let rows = half.inks.par_rows_mut().zip(half.states.par_rows_mut());
    rows.enumerate().for_each(|(row, (inks, states))| {
        for col in 0..size.width() {
            inks[col] = ink(col, row);
            states[col] = state(col, row);
        }
    });
    Some(half)
}

/// A step of the picture of half the size, in that of the whole one.
pub(super) fn doubled(step: &Step) -> Step {
    let mut step = *step;
    // the middle of a pixel of half the size lies between four; the upper left of them is taken
    let shift = if step.target.plane.is_some() {
        DVec2::ZERO
    } else {
        DVec2::splat(0.5)
    };
    let linear = step.source.transform.source_from_copy();
    step.target.at = 2.0 * step.target.at - shift;
    step.source.at = 2.0 * step.source.at
        - if step.source.plane.is_some() {
            DVec2::ZERO
        } else {
            linear * shift
        };
    step.target.radius_px *= 2;
    step
}

//! Expected mean appearance of a hole: tones and contrast of its surroundings, continued inwards.
//!
//! Seams are cheapest where nothing happens, so that a cut on its own prefers bland sources. A weak pull towards the local
//! mean and contrast that the rim suggests cures that.

use crate::blend::{self, Blend};
use crate::canvas::{HOLE, KNOWN};
use crate::sheet::Sheet;
use glam::IVec2;
use ravec_progress::{Cancelled, Progress};
use ravec_raster::{Image, gaussian_blur};

/// The standard deviation of the window in which means and contrasts are taken.
const WINDOW_SIGMA_PX: f64 = 6.0;
/// Weight of a difference of contrast against one of tone.
const CONTRAST: f32 = 1.0;

/// Rows of a large sheet that are examined between two checks for cancellation, and rows beyond them that their blur sees:
/// with fewer than its kernel has, there would be steps.
const BAND_ROWS: usize = 128;
const BAND_OVERLAP: usize = 32;

/// Mean appearance of pixels: ink without alpha, and contrast.
pub(crate) struct Guidance {
    /// For each pixel of the sheet what it should be like if it is in the hole.
    pub(crate) expected: Vec<[f32; 4]>,
    /// For each pixel of the sheet what it is like as a source.
    pub(crate) found: Vec<[f32; 4]>,
}

/// The statistics of a sheet: mean ink and contrast of the luminance, around each pixel.
pub(crate) fn guidance(sheet: &Sheet, progress: &Progress) -> Result<Guidance, Cancelled> {
    let mut found = Vec::with_capacity(sheet.inks.len());
    for first in (0..sheet.height).step_by(BAND_ROWS) {
        progress.check()?;
        found.extend(statistics(
            sheet,
            first,
            (first + BAND_ROWS).min(sheet.height),
        ));
    }
    let mut expected = found.clone();
    let mut number = vec![u32::MAX; found.len()];
    let hole: Vec<usize> = sheet.hole().collect();
    for (n, &index) in hole.iter().enumerate() {
        number[index] = n as u32;
    }
    let mut blend = Blend {
        values: hole.iter().map(|&index| found[index]).collect(),
        ..Blend::default()
    };
    for (n, &index) in hole.iter().enumerate() {
        for step in [IVec2::X, IVec2::Y, IVec2::NEG_X, IVec2::NEG_Y] {
            let Some(other) = sheet.shifted(index, step) else {
                continue;
            };
            if sheet.is(other, HOLE) {
                if other > index {
                    blend.pairs.push((n as u32, number[other], [0.0; 4]));
                }
            } else if sheet.is(other, KNOWN) {
                blend.anchors.push((n as u32, found[other], 1.0));
            }
        }
    }
    blend::solve(&mut blend, progress)?;
    for (&index, value) in hole.iter().zip(blend.values) {
        expected[index] = value;
    }
    Ok(Guidance { expected, found })
}

/// The statistics of some rows.
fn statistics(sheet: &Sheet, first: usize, end: usize) -> impl Iterator<Item = [f32; 4]> + use<> {
    let (above, below) = (
        first.saturating_sub(BAND_OVERLAP),
        (end + BAND_OVERLAP).min(sheet.height),
    );
    let moment = |index: usize| {
        if !sheet.is(index, KNOWN) {
            return [0.0; 8];
        }
        let [r, g, b, _] = sheet.inks[index];
        let l = 0.299 * r + 0.587 * g + 0.114 * b;
        [r, g, b, l * l, l, 1.0, 0.0, 0.0]
    };
    let moments: Vec<[f32; 8]> = (above * sheet.width..below * sheet.width)
        .map(moment)
        .collect();
    let moments = Image::from_vec(sheet.width, moments).expect("a sheet has whole rows");
    let blurred = gaussian_blur(&moments, WINDOW_SIGMA_PX);
    let rows = (first - above) * sheet.width..(end - above) * sheet.width;
    let blurred = blurred.pixels()[rows].to_vec();
    blurred.into_iter().map(|m| {
        let share = m[5].max(1e-6);
        let l = m[4] / share;
        [
            m[0] / share,
            m[1] / share,
            m[2] / share,
            CONTRAST * (m[3] / share - l * l).max(0.0).sqrt(),
        ]
    })
}

//! Scratches, wires and specks: what is so thin that its surroundings say what was there.
//!
//! The plain idea: bend a thin plate through the known pixels on both sides, so that tones and slopes go on. It is better
//! than any copy where no pixel is more than a few from a known one, and a blur anywhere else; so only the thin parts of a
//! hole are filled this way.
//!
//! Cost: two dozen operations for each pixel and iteration, a hundred iterations or so.

use crate::canvas::{Ink, solid_window};
use ravec_progress::{Cancelled, Progress};
use ravec_raster::{Image, Mask};

/// Parts into which no disc of this radius fits are thin.
const RADIUS_PX: f64 = 5.0;
/// Iterations end when no value moves by more than a part of an 8-bit step.
const TOLERANCE: f64 = 1e-4;
const MAX_STEPS: usize = 400;

/// The thin parts of a hole.
pub(crate) fn thin_parts(hole: &Mask) -> Mask {
    let Some((solid, window)) = solid_window(hole, 2 * RADIUS_PX.ceil() as usize) else {
        return Mask::empty(hole.size());
    };
    // half a pixel more on the way back, so that the stairs of a thick part's rim are not taken for scratches
    let thick = solid.erode(RADIUS_PX).dilate(RADIUS_PX + 1.5);
    Mask::from_fn(hole.size(), |col, row| {
        window.contains(col, row) && {
            let (col, row) = (col - window.col, row - window.row);
            solid.at(col, row) > 0.0 && thick.at(col, row) == 0.0
        }
    })
}

/// A second difference: unknowns with their factors, and what the known pixels in it add up to.
struct Stencil {
    terms: [(u32, f32); 4],
    known: Ink,
}

/// Replaces the pixels of `part` by the plate through their surroundings. Pixels of `unknown` that are not in `part` take
/// no part in it.
pub(crate) fn bend(
    inks: &mut Image<Ink>,
    part: &Mask,
    unknown: impl Fn(usize, usize) -> bool,
    progress: &Progress,
) -> Result<(), Cancelled> {
    let Some(bounds) = part.bounding_box() else {
        return Ok(());
    };
    let mut number = Image::new(inks.size(), u32::MAX);
    let mut places = Vec::new();
    for row in bounds.row..bounds.bottom() {
        for col in bounds.col..bounds.right() {
            if part.at(col, row) > 0.0 {
                number[(col, row)] = places.len() as u32;
                places.push((col, row));
            }
        }
    }
    let stencils = stencils(inks, &number, &places, &unknown);
    let count = places.len();
    let residuals = |values: &[Ink], with_known: bool| applied(&stencils, values, with_known);
    let transposed = |residuals: &[Ink]| transposed(&stencils, residuals, count);
    // start from the mean of what is known nearby
    let mut values = start(inks, &places, &number, &unknown);
    let mut down: Vec<Ink> = transposed(&residuals(&values, true))
        .iter()
        .map(|v| v.map(|v| -v))
        .collect();
    let mut direction = down.clone();
    let mut energy = dot(&down, &down);
    let enough = count as f64 * TOLERANCE * TOLERANCE;
    for _ in 0..MAX_STEPS {
        if energy.iter().all(|&energy| energy <= enough) {
            break;
        }
        progress.check()?;
        let bent = residuals(&direction, false);
        let curvature = dot(&bent, &bent);
        let step: [f32; 4] = std::array::from_fn(|c| {
            if curvature[c] > 0.0 {
                (energy[c] / curvature[c]) as f32
            } else {
                0.0
            }
        });
        let applied = transposed(&bent);
        for i in 0..count {
            for c in 0..4 {
                values[i][c] += step[c] * direction[i][c];
                down[i][c] -= step[c] * applied[i][c];
            }
        }
        let next = dot(&down, &down);
        for (direction, down) in direction.iter_mut().zip(&down) {
            for c in 0..4 {
                let ratio = if energy[c] > 0.0 {
                    (next[c] / energy[c]) as f32
                } else {
                    0.0
                };
                direction[c] = down[c] + ratio * direction[c];
            }
        }
        energy = next;
    }
    for (&place, value) in places.iter().zip(values) {
        inks[place] = value;
    }
    Ok(())
}

/// J applied to the values: the bending at each stencil.
fn applied(stencils: &[Stencil], values: &[Ink], with_known: bool) -> Vec<Ink> {
    stencils
        .iter()
        .map(|stencil| {
            let mut sum = if with_known { stencil.known } else { [0.0; 4] };
            for &(index, factor) in &stencil.terms {
                if factor != 0.0 {
                    let value = values[index as usize];
                    for c in 0..4 {
                        sum[c] += factor * value[c];
                    }
                }
            }
            sum
        })
        .collect()
}

/// The transpose of J applied to what comes out.
fn transposed(stencils: &[Stencil], residuals: &[Ink], count: usize) -> Vec<Ink> {
    let mut sums = vec![[0.0f32; 4]; count];
    for (stencil, residual) in stencils.iter().zip(residuals) {
        for &(index, factor) in &stencil.terms {
            if factor != 0.0 {
                for c in 0..4 {
                    sums[index as usize][c] += factor * residual[c];
                }
            }
        }
    }
    sums
}

fn dot(a: &[Ink], b: &[Ink]) -> [f64; 4] {
    let mut sum = [0f64; 4];
    for (a, b) in a.iter().zip(b) {
        for c in 0..4 {
            sum[c] += f64::from(a[c] * b[c]);
        }
    }
    sum
}

/// For each unknown the mean of the known pixels around it, as far away as need be.
fn start(
    inks: &Image<Ink>,
    places: &[(usize, usize)],
    number: &Image<u32>,
    unknown: &impl Fn(usize, usize) -> bool,
) -> Vec<Ink> {
    let mean = |&(col, row): &(usize, usize)| {
        for reach in [2isize, 4, 8] {
            let (mut sum, mut weight) = ([0.0f32; 4], 0.0f32);
            for dy in -reach..=reach {
                for dx in -reach..=reach {
                    let (x, y) = (col.wrapping_add_signed(dx), row.wrapping_add_signed(dy));
                    if number.get(x, y) == Some(u32::MAX) && !unknown(x, y) {
                        let share = 1.0 / (dx * dx + dy * dy) as f32;
                        weight += share;
                        for (sum, value) in sum.iter_mut().zip(inks[(x, y)]) {
                            *sum += share * value;
                        }
                    }
                }
            }
            if weight > 0.0 {
                return sum.map(|v| v / weight);
            }
        }
        [0.0; 4]
    };
    places.iter().map(mean).collect()
}

/// The second differences that contain an unknown.
fn stencils(
    inks: &Image<Ink>,
    number: &Image<u32>,
    places: &[(usize, usize)],
    unknown: impl Fn(usize, usize) -> bool,
) -> Vec<Stencil> {
    const ROOT_2: f32 = std::f32::consts::SQRT_2;
    // along rows, along columns, and across: u_xx² + u_yy² + 2·u_xy²
    let shapes: [&[(isize, isize, f32)]; 3] = [
        &[(-1, 0, 1.0), (0, 0, -2.0), (1, 0, 1.0)],
        &[(0, -1, 1.0), (0, 0, -2.0), (0, 1, 1.0)],
        &[
            (0, 0, ROOT_2),
            (1, 0, -ROOT_2),
            (0, 1, -ROOT_2),
            (1, 1, ROOT_2),
        ],
    ];
    let mut found = Vec::new();
    for (own, &(col, row)) in places.iter().enumerate() {
        for shape in shapes {
            // each stencil belongs to the first of its unknowns
            for &(ox, oy, _) in shape {
                let mut stencil = Stencil {
                    terms: [(0, 0.0); 4],
                    known: [0.0; 4],
                };
                let mut first = u32::MAX;
                let whole = shape.iter().enumerate().all(|(k, &(dx, dy, factor))| {
                    let (x, y) = (
                        col.wrapping_add_signed(dx - ox),
                        row.wrapping_add_signed(dy - oy),
                    );
                    match number.get(x, y) {
                        None => false,
                        Some(u32::MAX) => {
                            for (sum, value) in stencil.known.iter_mut().zip(inks[(x, y)]) {
                                *sum += factor * value;
                            }
                            !unknown(x, y)
                        }
                        Some(index) => {
                            first = first.min(index);
                            stencil.terms[k] = (index, factor);
                            true
                        }
                    }
                });
                if whole && first == own as u32 {
                    found.push(stencil);
                }
            }
        }
    }
    found
}

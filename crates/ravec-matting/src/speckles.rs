//! Specks of a matte: a few pixels by themselves, where the plate does not fit an edge or the noise is strong.
//!
//! Foreground has a solid part somewhere. What is connected to none, and far from all, is cleared.

use ravec_raster::{Plane, gaussian_blur};

/// Blur of alpha, and its value there from which foreground is solid: a disc of five pixels across.
const SOLID_SIGMA_PX: f64 = 2.5;
const SOLID: f32 = 0.35;
/// Distance to connected foreground below which loose parts belong to it: hair that the noise interrupts.
const NEAR_PX: f64 = 6.0;

/// Clears specks. Parts that contain a pixel of `marked` stay.
pub(crate) fn clear_specks(alpha: &mut Plane, marked: impl Fn(usize, usize) -> bool) {
    let size = alpha.size();
    let smooth = gaussian_blur(alpha, SOLID_SIGMA_PX);
    let mut open = Vec::new();
    for row in 0..size.height() {
        for col in 0..size.width() {
            let solid = smooth[(col, row)] > SOLID && alpha[(col, row)] > 0.0;
            if solid || marked(col, row) {
                open.push((col, row));
            }
        }
    }
    if open.is_empty() {
        alpha.pixels_mut().fill(0.0);
        return;
    }
    let mut kept = Plane::new(size, 0.0);
    spread(alpha, &mut kept, open);
    let mut near = Vec::new();
    for row in 0..size.height() {
        for col in 0..size.width() {
            let is_loose = alpha[(col, row)] > 0.0 && kept[(col, row)] == 0.0;
            if is_loose && is_near(&kept, col, row) {
                near.push((col, row));
            }
        }
    }
    spread(alpha, &mut kept, near);
    for (alpha, kept) in alpha.pixels_mut().iter_mut().zip(kept.pixels()) {
        *alpha *= kept;
    }
}

/// Returns `true` if a pixel at most [`NEAR_PX`] away is marked.
fn is_near(kept: &Plane, col: usize, row: usize) -> bool {
    let reach = NEAR_PX as usize;
    (row.saturating_sub(reach)..(row + reach + 1).min(kept.height())).any(|other| {
        let half = NEAR_PX.powi(2) - (other as f64 - row as f64).powi(2);
        let half = half.sqrt() as usize;
        let line = kept.row(other);
        let line = &line[col.saturating_sub(half)..(col + half + 1).min(line.len())];
        line.iter().any(|kept| *kept > 0.0)
    })
}

/// Marks all pixels of alpha above 0 that are connected to those in `open`.
fn spread(alpha: &Plane, kept: &mut Plane, mut open: Vec<(usize, usize)>) {
    open.retain(|at| {
        let is_new = kept[*at] == 0.0 && alpha[*at] > 0.0;
        if is_new {
            kept[*at] = 1.0;
        }
        is_new
    });
    while let Some((col, row)) = open.pop() {
        for r in row.saturating_sub(1)..(row + 2).min(alpha.height()) {
            let (alpha, kept) = (alpha.row(r), kept.row_mut(r));
            for c in col.saturating_sub(1)..(col + 2).min(alpha.len()) {
                if alpha[c] > 0.0 && kept[c] == 0.0 {
                    kept[c] = 1.0;
                    open.push((c, r));
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ravec_raster::Size;

    #[test]
    fn specks_go_and_hair_stays() {
        let size = Size::new(60, 40).unwrap();
        let mut alpha = Plane::from_fn(size, |col, row| {
            let body = (10..20).contains(&col) && (10..30).contains(&row);
            let hair = row == 15 && (20..40).contains(&col);
            let gap = col == 30;
            let speck = (col, row) == (50, 35) || (col, row) == (51, 35);
            if body || hair && !gap {
                0.9
            } else if speck {
                0.6
            } else {
                0.0
            }
        });
        clear_specks(&mut alpha, |_, _| false);
        assert_eq!(alpha[(50, 35)], 0.0);
        assert_eq!(
            [alpha[(15, 20)], alpha[(29, 15)], alpha[(36, 15)]],
            [0.9; 3]
        );
        let mut loose = Plane::from_fn(
            size,
            |col, row| {
                if (col, row) == (50, 35) { 0.6 } else { 0.0 }
            },
        );
        let mut marked = loose.clone();
        clear_specks(&mut marked, |col, row| (col, row) == (50, 35));
        assert_eq!(marked, loose);
        clear_specks(&mut loose, |_, _| false);
        assert!(loose.pixels().iter().all(|alpha| *alpha == 0.0));
    }

    #[test]
    fn discs_from_five_pixels_across_are_solid() {
        let size = Size::new(60, 40).unwrap();
        let disc = |radius: f64| {
            let mut alpha = Plane::from_fn(size, |col, row| {
                let off = [col as f64 - 30.0, row as f64 - 20.0];
                f32::from(u8::from(off[0].hypot(off[1]) <= radius))
            });
            clear_specks(&mut alpha, |_, _| false);
            alpha.pixels().iter().any(|alpha| *alpha > 0.0)
        };
        assert!(disc(2.7) && !disc(1.5));
    }
}

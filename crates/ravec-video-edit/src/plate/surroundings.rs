//! Colors of places that were not seen.

use crate::Colors;
use ravec_raster::{Image, Mask, Size};

/// Colors with those of the surroundings in places that were not seen (push and pull: Gortler et al., *The Lumigraph*, 1996).
pub fn surrounded(colors: &Colors, seen: &Mask) -> Colors {
    let weighted = Image::from_fn(colors.size(), |col, row| {
        let [r, g, b] = colors[(col, row)];
        if seen.at(col, row) > 0.0 {
            [r, g, b, 1.0]
        } else {
            [0.0; 4]
        }
    });
    pulled(&weighted).map(|[r, g, b, _]| [r, g, b])
}

/// Colors of weight 1 everywhere, from pixels that are multiplied by their weight.
fn pulled(pixels: &Image<[f32; 4]>) -> Image<[f32; 4]> {
    let (width, height) = (pixels.width(), pixels.height());
    let coarse = Size::new(width.div_ceil(2), height.div_ceil(2));
    let Some(coarse) = coarse.ok().filter(|_| width > 1 || height > 1) else {
        return pixels.map(|[r, g, b, weight]| {
            if weight > 0.0 {
                [r / weight, g / weight, b / weight, 1.0]
            } else {
                [0.0, 0.0, 0.0, 1.0]
            }
        });
    };
    let halved = Image::from_fn(coarse, |col, row| {
        let mut sums = [0.0f32; 4];
        for r in 2 * row..(2 * row + 2).min(height) {
            for c in 2 * col..(2 * col + 2).min(width) {
                for (sum, value) in sums.iter_mut().zip(pixels[(c, r)]) {
                    *sum += value;
                }
            }
        }
        let scale = 1.0 / sums[3].max(1.0);
        sums.map(|sum| sum * scale)
    });
    let filled = pulled(&halved);
    Image::from_fn(pixels.size(), |col, row| {
        let own = pixels[(col, row)];
        if own[3] >= 1.0 {
            return own;
        }
        let around = |at: usize, length: usize| {
            let near = at / 2;
            let far = if at.is_multiple_of(2) {
                near.saturating_sub(1)
            } else {
                (near + 1).min(length - 1)
            };
            [near, far]
        };
        let (cols, rows) = (around(col, filled.width()), around(row, filled.height()));
        let mut below = [0.0f32; 4];
        for (r, row_share) in rows.into_iter().zip([0.75, 0.25]) {
            for (c, col_share) in cols.into_iter().zip([0.75, 0.25]) {
                for (below, value) in below.iter_mut().zip(filled[(c, r)]) {
                    *below += row_share * col_share * value;
                }
            }
        }
        [0, 1, 2, 3].map(|k| own[k] + (1.0 - own[3]) * below[k])
    })
}

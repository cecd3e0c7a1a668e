//! Closed regions that stand out: the minimum barrier distance to the picture's border.
//!
//! ```text
//! the cost of a path is how far the values along it are spread: its largest minus its smallest
//! a pixel's distance is the cost of the cheapest path to the border
//! ```
//!
//! Whatever a strong edge encloses is far from the border, its even inside too; a ramp is near, for its values at the border
//! are its own. Texture is as far as its amplitude.
//!
//! Source: J. Zhang et al., "Minimum barrier salient object detection at 80 FPS", ICCV 2015: raster scans, each of which
//! extends the best known path of two neighbors by the pixel. Distances are upper bounds, as there.
//!
//! Cost: four scans a channel.

use ravec_raster::Plane;

/// Scans over the picture, alternately from the upper left and from the lower right. After three little changes.
const SCANS: usize = 4;

/// Width of the border. In one of a single pixel a frame around the picture, as scans have them, would enclose all of
/// it, and then ground that differs from the frame is what stands out. Wider ones take from objects near the border.
const BORDER: usize = 2;

/// The distance of each pixel to the border of the picture.
pub(crate) fn barrier_distance(values: &Plane) -> Plane {
    let (width, height) = (values.width(), values.height());
    let on_border = |col: usize, row: usize| {
        col.min(width - 1 - col) < BORDER || row.min(height - 1 - row) < BORDER
    };
    // the highest and the lowest value of the best path so far, and their difference
    let mut paths: Vec<[f32; 3]> = values
        .pixels()
        .iter()
        .enumerate()
        .map(|(index, &value)| {
            let cost = if on_border(index % width, index / width) {
                0.0
            } else {
                f32::INFINITY
            };
            [value, value, cost]
        })
        .collect();
    if width >= 3 && height >= 3 {
        for scan in 0..SCANS {
            let forward = scan % 2 == 0;
            for step in 1..height - 1 {
                let row = if forward { step } else { height - 1 - step };
                scan_row(values.pixels(), &mut paths, width, row, forward);
            }
        }
    }
    Plane::from_fn(values.size(), |col, row| paths[row * width + col][2])
}

/// Extends the paths of the neighbors before and above by each pixel of a row, or of those after and below if not `forward`.
fn scan_row(values: &[f32], paths: &mut [[f32; 3]], width: usize, row: usize, forward: bool) {
    let values = &values[row * width..][..width];
    let (upper, rest) = paths.split_at_mut(row * width);
    let (here, lower) = rest.split_at_mut(width);
    let beside = if forward {
        &upper[(row - 1) * width..]
    } else {
        &lower[..width]
    };
    let (values, beside) = (&values[..width], &beside[..width]);
    let extend = |own: &mut [f32; 3], value: f32, from: [f32; 3]| {
        if from[2] < f32::INFINITY {
            let (high, low) = (from[0].max(value), from[1].min(value));
            if high - low < own[2] {
                *own = [high, low, high - low];
            }
        }
    };
    if forward {
        let mut before = here[0];
        for col in 1..width - 1 {
            let mut own = here[col];
            extend(&mut own, values[col], before);
            extend(&mut own, values[col], beside[col]);
            here[col] = own;
            before = own;
        }
    } else {
        let mut after = here[width - 1];
        for col in (1..width - 1).rev() {
            let mut own = here[col];
            extend(&mut own, values[col], after);
            extend(&mut own, values[col], beside[col]);
            here[col] = own;
            after = own;
        }
    }
}

/// The opening by a square of side `2 · radius + 1`: thin and small peaks go, the rest keeps its outline.
pub(crate) fn opened(values: &Plane, radius: usize) -> Plane {
    let eroded = extreme(values, radius, f32::min);
    extreme(&eroded, radius, f32::max)
}

/// The extreme value of each square; beyond the border nothing counts.
fn extreme(values: &Plane, radius: usize, pick: impl Fn(f32, f32) -> f32) -> Plane {
    let (width, height) = (values.width(), values.height());
    let mut rows = values.clone();
    for row in 0..height {
        let (from, to) = (values.row(row), rows.row_mut(row));
        for shift in 1..=radius.min(width - 1) {
            for (to, &from) in to.iter_mut().zip(&from[shift..]) {
                *to = pick(*to, from);
            }
            for (to, &from) in to[shift..].iter_mut().zip(from) {
                *to = pick(*to, from);
            }
        }
    }
    let mut result = rows.clone();
    for row in 0..height {
        let (first, last) = (row.saturating_sub(radius), (row + radius).min(height - 1));
        for other in (first..=last).filter(|&other| other != row) {
            let to = result.row_mut(row);
            for (to, &from) in to.iter_mut().zip(rows.row(other)) {
                *to = pick(*to, from);
            }
        }
    }
    result
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use ravec_raster::Size;

    /// The definition over all simple paths, by repeated improvement of sets of (highest, lowest) that no other beats.
    fn naive(values: &Plane) -> Plane {
        let (width, height) = (values.width(), values.height());
        let border = |c: usize, r: usize| {
            c < BORDER || r < BORDER || c + BORDER >= width || r + BORDER >= height
        };
        let mut levels: Vec<f32> = values.pixels().to_vec();
        levels.sort_by(f32::total_cmp);
        // with the lowest value of the path given, the cheapest path is that with the smallest highest value
        Plane::from_fn(values.size(), |col, row| {
            let mut best = f32::INFINITY;
            for &low in &levels {
                for &high in &levels {
                    if high < low || high - low >= best {
                        continue;
                    }
                    let inside = |c: usize, r: usize| (low..=high).contains(&values[(c, r)]);
                    let mut seen = vec![false; width * height];
                    let mut open = if inside(col, row) {
                        vec![(col, row)]
                    } else {
                        vec![]
                    };
                    while let Some((c, r)) = open.pop() {
                        if seen[r * width + c] {
                            continue;
                        }
                        seen[r * width + c] = true;
                        if border(c, r) {
                            best = high - low;
                            break;
                        }
                        open.extend(
                            [(c + 1, r), (c, r + 1), (c - 1, r), (c, r - 1)]
                                .into_iter()
                                .filter(|&(c, r)| inside(c, r)),
                        );
                    }
                }
            }
            best
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        #[test]
        fn scans_bound_the_distance_from_above(pixels in prop::collection::vec(0u8..6, 64)) {
            let values = Plane::from_fn(Size::new(8, 8).unwrap(), |c, r| f32::from(pixels[8 * r + c]));
            let (fast, exact) = (barrier_distance(&values), naive(&values));
            for (fast, exact) in fast.pixels().iter().zip(exact.pixels()) {
                prop_assert!(fast >= exact);
            }
        }
    }

    #[test]
    fn the_inside_of_a_closed_outline_is_as_far_as_the_outline_is_strong() {
        let ring = Plane::from_fn(Size::new(40, 30).unwrap(), |col, row| {
            let r = (col as f32 - 19.5).hypot(row as f32 - 14.5);
            if (8.0..10.0).contains(&r) {
                0.7
            } else {
                0.1 + 0.001 * col as f32
            }
        });
        let distance = barrier_distance(&ring);
        // the ramp adds at most a hundredth
        assert!((distance[(20, 15)] - 0.6).abs() < 0.03);
        assert!(distance[(3, 3)] < 0.03 && distance[(35, 15)] < 0.03);
    }

    #[test]
    fn a_frame_of_a_pixel_encloses_nothing() {
        let framed = Plane::from_fn(Size::new(40, 30).unwrap(), |col, row| {
            let frame = col == 0 || row == 0 || col == 39 || row == 29;
            if frame {
                0.9
            } else {
                0.1 + 0.4 * f32::from((col as f32 - 20.0).hypot(row as f32 - 15.0) < 6.0)
            }
        });
        let distance = barrier_distance(&framed);
        assert_eq!(distance[(5, 5)], 0.0);
        assert!((distance[(20, 15)] - 0.4).abs() < 1e-6);
    }

    #[test]
    fn opening_takes_thin_peaks_and_keeps_wide_ones() {
        let values = Plane::from_fn(Size::new(30, 12).unwrap(), |col, row| {
            f32::from(col == 4 || ((12..20).contains(&col) && (3..9).contains(&row)))
        });
        let open = opened(&values, 1);
        assert_eq!(open[(4, 6)], 0.0);
        assert_eq!(open[(15, 5)], 1.0);
        assert_eq!(open[(12, 3)], 1.0);
    }
}

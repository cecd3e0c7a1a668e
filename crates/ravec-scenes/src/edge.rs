//! Edges, corners, lines, discs, checkerboards and gradients of known geometry.
//!
//! Each picture is the exact area coverage of its shape, mixed in linear light, so a method that claims a subpixel
//! position can be held to it. The truth is the input: planted, not measured.
//!
//! Guarantees: covered areas within 1e-6 (checkerboards and discs up to a radius of 1000 px: 1e-9).
//! Cost: a few dozen operations a pixel, rows in parallel.

use crate::coverage::{HalfPlane, disc_coverage, intersection_coverage};
use crate::paint::paint;
use glam::{DVec2, Vec3};
use ravec_raster::color::linear_from_srgb;
use ravec_raster::{Image, LinearRgb, Size};
use serde::{Deserialize, Serialize};

/// The two colors of a shape, linear light.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TwoColors {
    /// Inside: where `normal·p` is below the offset, within the disc, on the line.
    pub inside: [f32; 3],
    /// Everywhere else.
    pub outside: [f32; 3],
}

impl TwoColors {
    /// Two colors by their encoded sRGB values in 8-bit steps, 0 to 255, fractions allowed.
    pub fn from_encoded(inside: [f32; 3], outside: [f32; 3]) -> Self {
        let linear = |color: [f32; 3]| color.map(|v| linear_from_srgb(v / 255.0));
        Self {
            inside: linear(inside),
            outside: linear(outside),
        }
    }

    /// Two grays around `middle`, the outside brighter by `contrast`, both in encoded 8-bit steps.
    ///
    /// A contrast below 0 makes the inside the brighter one.
    pub fn gray_step(middle: f32, contrast: f32) -> Self {
        Self::from_encoded([middle - 0.5 * contrast; 3], [middle + 0.5 * contrast; 3])
    }

    /// The mixture in linear light when a part `coverage` of the pixel is inside.
    pub fn mixed(&self, coverage: f64) -> LinearRgb {
        LinearRgb(self.mix(coverage).to_array())
    }

    fn mix(&self, coverage: f64) -> Vec3 {
        Vec3::from_array(self.outside).lerp(Vec3::from_array(self.inside), coverage as f32)
    }
}

/// A straight edge through the whole picture: the line `normal·p = offset_px`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct EdgeTruth {
    /// Unit normal, from the inside color to the outside color.
    pub normal: DVec2,
    /// Distance of the line from the origin (the outer corner of the first pixel) along `normal`.
    pub offset_px: f64,
    /// The colors of the two sides.
    pub colors: TwoColors,
}

impl EdgeTruth {
    /// The edge with normal `(cos, sin)` of an angle through a point.
    pub fn from_angle(angle_rad: f64, through: DVec2, colors: TwoColors) -> Self {
        let line = HalfPlane::from_angle(angle_rad, through);
        Self {
            normal: line.normal,
            offset_px: line.offset_px,
            colors,
        }
    }

    /// The half plane of the inside color.
    pub fn inside(&self) -> HalfPlane {
        HalfPlane {
            normal: self.normal,
            offset_px: self.offset_px,
        }
    }
}

/// A picture of a straight edge.
pub fn edge(size: Size, truth: &EdgeTruth) -> Image<LinearRgb> {
    paint(size, |p| truth.colors.mix(truth.inside().coverage(p)))
}

/// A corner: the intersection of two half planes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct WedgeTruth {
    /// The tip.
    pub apex: DVec2,
    /// The two half planes, whose borders go through the tip.
    pub sides: [HalfPlane; 2],
    /// The colors of the wedge and of its surroundings.
    pub colors: TwoColors,
}

impl WedgeTruth {
    /// A wedge that opens by `opening_rad` (0 to π) around the direction `axis_rad`.
    pub fn from_axis(apex: DVec2, axis_rad: f64, opening_rad: f64, colors: TwoColors) -> Self {
        let side = |sign: f64| {
            let along = axis_rad + sign * 0.5 * opening_rad;
            HalfPlane::from_angle(along + sign * std::f64::consts::FRAC_PI_2, apex)
        };
        Self {
            apex,
            sides: [side(1.0), side(-1.0)],
            colors,
        }
    }
}

/// A picture of a corner.
pub fn wedge(size: Size, truth: &WedgeTruth) -> Image<LinearRgb> {
    paint(size, |p| {
        truth.colors.mix(intersection_coverage(&truth.sides, p))
    })
}

/// A straight line of constant width through the whole picture.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LineTruth {
    /// Unit normal of the line.
    pub normal: DVec2,
    /// Distance of its middle from the origin along `normal`.
    pub offset_px: f64,
    /// Full width; may be far below 1.
    pub width_px: f64,
    /// The colors of the line (inside) and of its surroundings.
    pub colors: TwoColors,
}

/// A picture of a straight line.
pub fn line(size: Size, truth: &LineTruth) -> Image<LinearRgb> {
    let half_plane = |shift: f64| HalfPlane {
        normal: truth.normal,
        offset_px: truth.offset_px + shift * truth.width_px,
    };
    let (upper, lower) = (half_plane(0.5), half_plane(-0.5));
    paint(size, |p| {
        truth.colors.mix(upper.coverage(p) - lower.coverage(p))
    })
}

/// A disc.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct DiscTruth {
    /// Center, image coordinates.
    pub center: DVec2,
    /// Radius.
    pub radius_px: f64,
    /// The colors of the disc and of its surroundings.
    pub colors: TwoColors,
}

/// A picture of a disc.
pub fn disc(size: Size, truth: &DiscTruth) -> Image<LinearRgb> {
    paint(size, |p| {
        truth
            .colors
            .mix(disc_coverage(truth.center, truth.radius_px, p))
    })
}

/// An axis-parallel checkerboard.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct CheckerboardTruth {
    /// A corner of an inside cell that lies to the right of it and below.
    pub origin: DVec2,
    /// Side of a cell, above 0, need not be whole.
    pub cell_px: f64,
    /// The colors of the two kinds of cells.
    pub colors: TwoColors,
}

/// A picture of a checkerboard.
pub fn checkerboard(size: Size, truth: &CheckerboardTruth) -> Image<LinearRgb> {
    // a cell is inside where the product of two square waves is +1, and the mean of the product is the product of means
    let wave = |x: f64| {
        let period = 2.0 * truth.cell_px;
        2.0 * crate::coverage::pulse(x / period, 0.5, 1.0 / period) - 1.0
    };
    paint(size, |p| {
        let q = p - truth.origin;
        truth.colors.mix(0.5 * (1.0 + wave(q.x) * wave(q.y)))
    })
}

/// A smooth transition between four colors at the corners of the picture, bilinear in linear light.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct GradientTruth {
    /// Linear light at the upper left, upper right, lower left and lower right corner of the picture.
    pub corners: [[f32; 3]; 4],
}

/// A picture of a smooth transition: no edge at all.
pub fn gradient(size: Size, truth: &GradientTruth) -> Image<LinearRgb> {
    let extent = DVec2::new(size.width() as f64, size.height() as f64);
    let [upper_left, upper_right, lower_left, lower_right] = truth.corners.map(Vec3::from_array);
    // the mean of a bilinear function over a pixel is its value at the center
    paint(size, |p| {
        let t = (p / extent).as_vec2();
        let upper = upper_left.lerp(upper_right, t.x);
        upper.lerp(lower_left.lerp(lower_right, t.x), t.y)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn size(width: usize, height: usize) -> Size {
        Size::new(width, height).unwrap()
    }

    const COLORS: TwoColors = TwoColors {
        inside: [0.1, 0.2, 0.3],
        outside: [0.9, 0.5, 0.0],
    };

    fn largest_difference(a: &Image<LinearRgb>, b: impl Fn(usize, usize) -> LinearRgb) -> f32 {
        let mut largest = 0.0f32;
        for row in 0..a.height() {
            for col in 0..a.width() {
                for (x, y) in a[(col, row)].0.into_iter().zip(b(col, row).0) {
                    largest = largest.max((x - y).abs());
                }
            }
        }
        largest
    }

    #[test]
    fn a_mirrored_edge_is_the_mirrored_picture() {
        let (width, height) = (17, 12);
        for degrees in [0.0, 13.0, 45.0, 90.0, 201.5, 310.0] {
            let truth =
                EdgeTruth::from_angle(f64::to_radians(degrees), DVec2::new(8.1, 6.3), COLORS);
            let picture = edge(size(width, height), &truth);
            let mirrored = EdgeTruth {
                normal: DVec2::new(-truth.normal.x, truth.normal.y),
                offset_px: truth.offset_px - truth.normal.x * width as f64,
                ..truth
            };
            let other = edge(size(width, height), &mirrored);
            assert!(largest_difference(&picture, |col, row| other[(width - 1 - col, row)]) < 1e-6);
            let swapped = EdgeTruth {
                normal: DVec2::new(truth.normal.y, truth.normal.x),
                ..truth
            };
            let other = edge(size(height, width), &swapped);
            assert!(largest_difference(&picture, |col, row| other[(row, col)]) < 1e-6);
        }
    }

    #[test]
    fn exchanging_sides_and_colors_changes_nothing() {
        let truth = EdgeTruth::from_angle(0.7, DVec2::new(4.0, 5.0), COLORS);
        let exchanged = EdgeTruth {
            normal: -truth.normal,
            offset_px: -truth.offset_px,
            colors: TwoColors {
                inside: COLORS.outside,
                outside: COLORS.inside,
            },
        };
        let (a, b) = (edge(size(9, 9), &truth), edge(size(9, 9), &exchanged));
        assert!(largest_difference(&a, |col, row| b[(col, row)]) < 1e-6);
    }

    #[test]
    fn a_gray_step_has_the_asked_contrast_in_encoded_steps() {
        let colors = TwoColors::gray_step(100.0, 64.0);
        let encoded = |c: [f32; 3]| 255.0 * ravec_raster::color::srgb_from_linear(c[0]);
        assert!((encoded(colors.inside) - 68.0).abs() < 1e-3);
        assert!((encoded(colors.outside) - 132.0).abs() < 1e-3);
    }

    #[test]
    fn a_line_darkens_each_row_by_its_width() {
        let colors = TwoColors {
            inside: [0.0; 3],
            outside: [1.0; 3],
        };
        for (angle, width_px) in [(0.0, 0.3), (0.2, 1.0), (-0.4, 3.7)] {
            let normal = DVec2::from_angle(angle);
            let offset_px = normal.dot(DVec2::new(20.3, 3.0));
            let picture = line(
                size(40, 6),
                &LineTruth {
                    normal,
                    offset_px,
                    width_px,
                    colors,
                },
            );
            for row in picture.rows() {
                let missing: f32 = row.iter().map(|p| 1.0 - p.0[0]).sum();
                // the line meets a row over a length of width / cos
                assert!((f64::from(missing) - width_px / normal.x).abs() < 1e-5);
            }
        }
    }

    #[test]
    fn a_right_angled_wedge_is_a_product_of_overlaps() {
        let truth = WedgeTruth::from_axis(
            DVec2::new(3.25, 2.5),
            std::f64::consts::FRAC_PI_4,
            std::f64::consts::FRAC_PI_2,
            COLORS,
        );
        let picture = wedge(size(7, 7), &truth);
        let overlap = |i: usize, from: f64| (i as f64 + 1.0 - from).clamp(0.0, 1.0);
        let expected = |col, row| COLORS.mixed(overlap(col, 3.25) * overlap(row, 2.5));
        assert!(largest_difference(&picture, expected) < 1e-6);
    }

    #[test]
    fn a_checkerboard_of_whole_cells_has_pure_pixels() {
        let truth = CheckerboardTruth {
            origin: DVec2::ZERO,
            cell_px: 2.0,
            colors: COLORS,
        };
        let picture = checkerboard(size(9, 8), &truth);
        let expected =
            |col: usize, row: usize| COLORS.mixed(f64::from((col / 2 + row / 2).is_multiple_of(2)));
        assert!(largest_difference(&picture, expected) < 1e-6);
    }

    #[test]
    fn tiny_cells_become_an_even_mixture() {
        let truth = CheckerboardTruth {
            origin: DVec2::new(0.3, 0.1),
            cell_px: 0.125,
            colors: COLORS,
        };
        let picture = checkerboard(size(3, 3), &truth);
        assert!(largest_difference(&picture, |_, _| COLORS.mixed(0.5)) < 1e-6);
    }

    #[test]
    fn a_gradient_has_its_corner_colors_on_average() {
        let truth = GradientTruth {
            corners: [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        };
        let picture = gradient(size(1, 1), &truth);
        assert!(largest_difference(&picture, |_, _| LinearRgb([0.25; 3])) < 1e-6);
    }
}

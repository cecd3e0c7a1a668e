//! Perceived differences of two colors.
//!
//! Sources: CIE 142-2001 and Sharma, Wu, Dalal, "The CIEDE2000 color-difference formula: implementation notes,
//! supplementary test data, and mathematical observations", 2005, whose names are kept here: C chroma, h hue angle, a
//! prime for values after the correction of a*, a bar for means. All their 34 test pairs are reproduced.

use crate::color::{cbrt, oklab_from_linear};

/// CIELAB (white D65, L 0 to 100) from linear light with sRGB primaries.
#[inline]
pub fn lab_from_linear([r, g, b]: [f32; 3]) -> [f32; 3] {
    // XYZ over that of white, so that equal red, green and blue are exactly neutral up to rounding
    let x = (0.412_456_4 * r + 0.357_576_1 * g + 0.180_437_5 * b) / 0.950_47;
    let y = 0.212_672_9 * r + 0.715_152_2 * g + 0.072_175 * b;
    let z = (0.019_333_9 * r + 0.119_192 * g + 0.950_304_1 * b) / 1.088_83;
    let [fx, fy, fz] = [x, y, z].map(|t| {
        if t > 216.0 / 24_389.0 {
            cbrt(t)
        } else {
            (24_389.0 / 27.0 * t + 16.0) / 116.0
        }
    });
    [116.0 * fy - 16.0, 500.0 * (fx - fy), 200.0 * (fy - fz)]
}

/// The CIEDE2000 difference of two CIELAB colors, with all weights 1. About 1 is just noticeable side by side, 2.3 in
/// passing, 100 is black against white.
pub fn ciede2000([l1, a1, b1]: [f64; 3], [l2, a2, b2]: [f64; 3]) -> f64 {
    let c_bar = 0.5 * (a1.hypot(b1) + a2.hypot(b2));
    let stretch = 1.5 - 0.5 * saturation(c_bar);
    let (a1, a2) = (stretch * a1, stretch * a2);
    let (c1, c2) = (a1.hypot(b1), a2.hypot(b2));
    // hue angles are taken in degrees, as the constants of the formula are
    let hue = |a: f64, b: f64| b.atan2(a).to_degrees().rem_euclid(360.0);
    let (h1, h2) = (hue(a1, b1), hue(a2, b2));

    let (mut dh, mut h_bar) = (h2 - h1, 0.5 * (h1 + h2));
    if c1 * c2 == 0.0 {
        // a neutral color has no hue: the other one's counts alone, and neutral's reads as 0
        dh = 0.0;
        h_bar = h1 + h2;
    } else if dh.abs() > 180.0 + HALF_TURN_SLACK_DEG {
        // the shorter way round, and the mean on that side
        dh -= 360.0_f64.copysign(dh);
        h_bar += if h_bar < 180.0 { 180.0 } else { -180.0 };
    }

    let dl = l2 - l1;
    let dc = c2 - c1;
    let dh = 2.0 * (c1 * c2).sqrt() * (0.5 * dh).to_radians().sin();
    let l_bar = 0.5 * (l1 + l2);
    let c_bar = 0.5 * (c1 + c2);
    let cos = |degrees: f64| degrees.to_radians().cos();
    let t =
        1.0 - 0.17 * cos(h_bar - 30.0) + 0.24 * cos(2.0 * h_bar) + 0.32 * cos(3.0 * h_bar + 6.0)
            - 0.20 * cos(4.0 * h_bar - 63.0);
    let from_middle_sq = (l_bar - 50.0) * (l_bar - 50.0);
    let sl = 1.0 + 0.015 * from_middle_sq / (20.0 + from_middle_sq).sqrt();
    let sc = 1.0 + 0.045 * c_bar;
    let sh = 1.0 + 0.015 * c_bar * t;
    let from_blue = (h_bar - 275.0) / 25.0;
    let turn = 60.0 * (-from_blue * from_blue).exp();
    let rt = -2.0 * saturation(c_bar) * turn.to_radians().sin();
    let (dl, dc, dh) = (dl / sl, dc / sc, dh / sh);
    // the mixed term can outweigh the squares only by rounding
    (dl * dl + dc * dc + dh * dh + rt * dc * dh).max(0.0).sqrt()
}

/// Hues exactly opposite must not be distinguished by the rounding of two arc tangents: the formula jumps there, and
/// the published pairs 10 and 14 lie on the jump.
const HALF_TURN_SLACK_DEG: f64 = 1e-9;

/// √(C⁷ / (C⁷ + 25⁷)).
fn saturation(c: f64) -> f64 {
    let c7 = c.powi(7);
    (c7 / (c7 + 6_103_515_625.0)).sqrt()
}

/// The Euclidean distance in Oklab of two colors in linear light. About 0.02 is noticeable, 1 is black against white.
#[inline]
pub fn delta_e_oklab(a: [f32; 3], b: [f32; 3]) -> f32 {
    let (a, b) = (oklab_from_linear(a), oklab_from_linear(b));
    let squares = a.iter().zip(b).map(|(a, b)| (a - b) * (a - b));
    squares.sum::<f32>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::linear_from_srgb;

    /// Table 1 of Sharma, Wu, Dalal 2005: two colors and their difference.
    const PUBLISHED: [([f64; 3], [f64; 3], f64); 34] = [
        (
            [50.0000, 2.6772, -79.7751],
            [50.0000, 0.0000, -82.7485],
            2.0425,
        ),
        (
            [50.0000, 3.1571, -77.2803],
            [50.0000, 0.0000, -82.7485],
            2.8615,
        ),
        (
            [50.0000, 2.8361, -74.0200],
            [50.0000, 0.0000, -82.7485],
            3.4412,
        ),
        (
            [50.0000, -1.3802, -84.2814],
            [50.0000, 0.0000, -82.7485],
            1.0000,
        ),
        (
            [50.0000, -1.1848, -84.8006],
            [50.0000, 0.0000, -82.7485],
            1.0000,
        ),
        (
            [50.0000, -0.9009, -85.5211],
            [50.0000, 0.0000, -82.7485],
            1.0000,
        ),
        (
            [50.0000, 0.0000, 0.0000],
            [50.0000, -1.0000, 2.0000],
            2.3669,
        ),
        (
            [50.0000, -1.0000, 2.0000],
            [50.0000, 0.0000, 0.0000],
            2.3669,
        ),
        (
            [50.0000, 2.4900, -0.0010],
            [50.0000, -2.4900, 0.0009],
            7.1792,
        ),
        (
            [50.0000, 2.4900, -0.0010],
            [50.0000, -2.4900, 0.0010],
            7.1792,
        ),
        (
            [50.0000, 2.4900, -0.0010],
            [50.0000, -2.4900, 0.0011],
            7.2195,
        ),
        (
            [50.0000, 2.4900, -0.0010],
            [50.0000, -2.4900, 0.0012],
            7.2195,
        ),
        (
            [50.0000, -0.0010, 2.4900],
            [50.0000, 0.0009, -2.4900],
            4.8045,
        ),
        (
            [50.0000, -0.0010, 2.4900],
            [50.0000, 0.0010, -2.4900],
            4.8045,
        ),
        (
            [50.0000, -0.0010, 2.4900],
            [50.0000, 0.0011, -2.4900],
            4.7461,
        ),
        (
            [50.0000, 2.5000, 0.0000],
            [50.0000, 0.0000, -2.5000],
            4.3065,
        ),
        (
            [50.0000, 2.5000, 0.0000],
            [73.0000, 25.0000, -18.0000],
            27.1492,
        ),
        (
            [50.0000, 2.5000, 0.0000],
            [61.0000, -5.0000, 29.0000],
            22.8977,
        ),
        (
            [50.0000, 2.5000, 0.0000],
            [56.0000, -27.0000, -3.0000],
            31.9030,
        ),
        (
            [50.0000, 2.5000, 0.0000],
            [58.0000, 24.0000, 15.0000],
            19.4535,
        ),
        ([50.0000, 2.5000, 0.0000], [50.0000, 3.1736, 0.5854], 1.0000),
        ([50.0000, 2.5000, 0.0000], [50.0000, 3.2972, 0.0000], 1.0000),
        ([50.0000, 2.5000, 0.0000], [50.0000, 1.8634, 0.5757], 1.0000),
        ([50.0000, 2.5000, 0.0000], [50.0000, 3.2592, 0.3350], 1.0000),
        (
            [60.2574, -34.0099, 36.2677],
            [60.4626, -34.1751, 39.4387],
            1.2644,
        ),
        (
            [63.0109, -31.0961, -5.8663],
            [62.8187, -29.7946, -4.0864],
            1.2630,
        ),
        (
            [61.2901, 3.7196, -5.3901],
            [61.4292, 2.2480, -4.9620],
            1.8731,
        ),
        (
            [35.0831, -44.1164, 3.7933],
            [35.0232, -40.0716, 1.5901],
            1.8645,
        ),
        (
            [22.7233, 20.0904, -46.6940],
            [23.0331, 14.9730, -42.5619],
            2.0373,
        ),
        (
            [36.4612, 47.8580, 18.3852],
            [36.2715, 50.5065, 21.2231],
            1.4146,
        ),
        (
            [90.8027, -2.0831, 1.4410],
            [91.1528, -1.6435, 0.0447],
            1.4441,
        ),
        (
            [90.9257, -0.5406, -0.9208],
            [88.6381, -0.8985, -0.7239],
            1.5381,
        ),
        (
            [6.7747, -0.2908, -2.4247],
            [5.8714, -0.0985, -2.2286],
            0.6377,
        ),
        (
            [2.0776, 0.0795, -1.1350],
            [0.9033, -0.0636, -0.5514],
            0.9082,
        ),
    ];

    #[test]
    fn the_published_pairs_have_their_published_differences_in_both_orders() {
        for (index, &(a, b, difference)) in PUBLISHED.iter().enumerate() {
            for found in [ciede2000(a, b), ciede2000(b, a)] {
                // four digits are printed
                assert!(
                    (found - difference).abs() <= 0.51e-4,
                    "pair {}: {found}",
                    index + 1
                );
            }
        }
    }

    #[test]
    fn white_gray_and_red_have_their_known_lab_values() {
        let close = |found: [f32; 3], truth: [f32; 3]| {
            found.iter().zip(truth).all(|(f, t)| (f - t).abs() < 0.02)
        };
        assert!(close(lab_from_linear([1.0; 3]), [100.0, 0.0, 0.0]));
        assert!(close(lab_from_linear([0.0; 3]), [0.0; 3]));
        // sRGB 119 is L 50.03; sRGB red is L 53.24, a 80.09, b 67.20
        assert!(close(
            lab_from_linear([linear_from_srgb(119.0 / 255.0); 3]),
            [50.03, 0.0, 0.0]
        ));
        assert!(close(
            lab_from_linear([1.0, 0.0, 0.0]),
            [53.24, 80.09, 67.20]
        ));
    }

    #[test]
    fn black_and_white_differ_by_100_and_by_1() {
        let found = ciede2000([0.0; 3], [100.0, 0.0, 0.0]);
        assert!((found - 100.0).abs() < 1e-9);
        assert!((delta_e_oklab([0.0; 3], [1.0; 3]) - 1.0).abs() < 1e-5);
    }
}

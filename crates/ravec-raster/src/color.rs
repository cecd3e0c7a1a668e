//! Transfer functions and color spaces, one value at a time.
//!
//! Everything here is plain IEEE arithmetic (no fused operations, no library calls), so loops over these functions
//! vectorise at any width and give the same bits on every machine.
//!
//! Sources: IEC 61966-2-1 (sRGB); B. Ottosson, "A perceptual color space for image processing", 2020 (Oklab).

/// The cube root of a finite `x`, sign kept: within 2 units in the last place.
///
/// A first guess from the bits (a third of the exponent) is within 5 %; each of the two Halley steps cubes the error.
#[inline(always)]
pub fn cbrt(x: f32) -> f32 {
    let a = x.abs();
    let mut t =
        f32::from_bits(((a.to_bits() as i32 as f32) * (1.0 / 3.0)) as i32 as u32 + 0x2a51_19f2);
    for _ in 0..2 {
        let cube = t * t * t;
        t *= (cube + a + a) / (cube + cube + a);
    }
    // below the smallest normal number the guess is meaningless, and so is the root for our purposes
    let root = if a < f32::MIN_POSITIVE { 0.0 } else { t };
    root.copysign(x)
}

/// The fifth root of a finite `x` ≥ 0: three Newton steps from a guess within 4 %.
#[inline(always)]
fn fifth_root(x: f32) -> f32 {
    let mut t = f32::from_bits(((x.to_bits() as i32 as f32) * 0.2) as i32 as u32 + 0x32c9_af00);
    for _ in 0..3 {
        let t2 = t * t;
        t = 0.8 * t + 0.2 * x / (t2 * t2);
    }
    t
}

/// Linear light from an sRGB-encoded value. Odd about 0, so that colors outside the gamut survive.
#[inline(always)]
pub fn linear_from_srgb(encoded: f32) -> f32 {
    let e = encoded.abs();
    let base = (e + 0.055) * (1.0 / 1.055);
    let square = base * base;
    // base^2.4 = base^2 · (base^2)^(1/5)
    let power = square * fifth_root(square);
    let linear = if e <= 0.04045 {
        e * (1.0 / 12.92)
    } else {
        power
    };
    linear.copysign(encoded)
}

/// The sRGB-encoded value of linear light. Odd about 0.
#[inline(always)]
pub fn srgb_from_linear(linear: f32) -> f32 {
    let l = linear.abs();
    // l^(1/2.4) = l^(1/3) · l^(1/12)
    let third = cbrt(l);
    let power = 1.055 * (third * third.sqrt().sqrt()) - 0.055;
    let encoded = if l <= 0.003_130_8 { l * 12.92 } else { power };
    encoded.copysign(linear)
}

/// Oklab from linear light with sRGB primaries.
#[inline(always)]
pub fn oklab_from_linear([r, g, b]: [f32; 3]) -> [f32; 3] {
    let l = cbrt(0.412_221_46 * r + 0.536_332_55 * g + 0.051_445_995 * b);
    let m = cbrt(0.211_903_5 * r + 0.680_699_5 * g + 0.107_396_96 * b);
    let s = cbrt(0.088_302_46 * r + 0.281_718_85 * g + 0.629_978_7 * b);
    [
        0.210_454_26 * l + 0.793_617_8 * m - 0.004_072_047 * s,
        1.977_998_5 * l - 2.428_592_2 * m + 0.450_593_7 * s,
        0.025_904_037 * l + 0.782_771_77 * m - 0.808_675_77 * s,
    ]
}

/// Linear light with sRGB primaries from Oklab.
#[inline(always)]
pub fn linear_from_oklab([lightness, a, b]: [f32; 3]) -> [f32; 3] {
    let l = lightness + 0.396_337_78 * a + 0.215_803_76 * b;
    let m = lightness - 0.105_561_346 * a - 0.063_854_17 * b;
    let s = lightness - 0.089_484_18 * a - 1.291_485_5 * b;
    let (l, m, s) = (l * l * l, m * m * m, s * s * s);
    [
        4.076_741_7 * l - 3.307_711_6 * m + 0.230_969_94 * s,
        -1.268_438 * l + 2.609_757_4 * m - 0.341_319_38 * s,
        -0.004_196_086_3 * l - 0.703_418_6 * m + 1.707_614_7 * s,
    ]
}

/// Relative luminance (Y of CIE XYZ, white = 1) of linear light with sRGB primaries.
#[inline(always)]
pub fn luminance([r, g, b]: [f32; 3]) -> f32 {
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

/// [`linear_from_srgb`] of the 256 values of an 8-bit sample.
pub static LINEAR_FROM_SRGB8: [f32; 256] = linear_from_srgb8_table();

const fn linear_from_srgb8_table() -> [f32; 256] {
    let mut table = [0.0; 256];
    let mut value = 0;
    while value < 256 {
        let encoded = value as f64 / 255.0;
        table[value] = if encoded <= 0.04045 {
            (encoded / 12.92) as f32
        } else {
            let base = (encoded + 0.055) / 1.055;
            let square = base * base;
            let mut root = 1.0;
            let mut step = 0;
            while step < 40 {
                root = 0.8 * root + 0.2 * square / (root * root * root * root);
                step += 1;
            }
            (square * root) as f32
        };
        value += 1;
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;

    fn samples() -> impl Iterator<Item = f32> {
        // all magnitudes a picture can have, from dim shadow to high dynamic range
        (0..200_000).map(|i| 1e-9 * (i as f32 * 2e-4).exp().min(1e17))
    }

    #[test]
    fn cube_root_is_within_two_units_in_the_last_place() {
        for x in samples() {
            let truth = f64::from(x).cbrt();
            let error = (f64::from(cbrt(x)) - truth).abs() / truth;
            assert!(error <= 2.0 * f64::from(f32::EPSILON), "{x}: {error:e}");
            assert_eq!(cbrt(-x), -cbrt(x));
        }
        assert_eq!(cbrt(0.0), 0.0);
    }

    #[test]
    fn transfer_functions_agree_with_the_standard_in_f64() {
        for x in samples().filter(|&x| x < 100.0) {
            let v = f64::from(x);
            let encoded = if v <= 0.003_130_8 {
                v * 12.92
            } else {
                1.055 * v.powf(1.0 / 2.4) - 0.055
            };
            let linear = if v <= 0.04045 {
                v / 12.92
            } else {
                ((v + 0.055) / 1.055).powf(2.4)
            };
            assert!(
                (f64::from(srgb_from_linear(x)) - encoded).abs() <= 5e-7 * encoded.max(0.1),
                "{x}"
            );
            assert!(
                (f64::from(linear_from_srgb(x)) - linear).abs() <= 5e-7 * linear,
                "{x}"
            );
        }
    }

    #[test]
    fn the_table_agrees_with_the_function() {
        for (value, &linear) in LINEAR_FROM_SRGB8.iter().enumerate() {
            let computed = linear_from_srgb(value as f32 / 255.0);
            assert!((linear - computed).abs() <= 5e-7 * linear);
        }
    }

    #[test]
    fn oklab_of_white_gray_and_the_published_example_is_as_published() {
        let [l, a, b] = oklab_from_linear([1.0; 3]);
        assert!((l - 1.0).abs() < 1e-5 && a.abs() < 1e-5 && b.abs() < 1e-5);
        // sRGB red: Oklab (0.6280, 0.2249, 0.1258)
        let red = oklab_from_linear([1.0, 0.0, 0.0]);
        for (found, published) in red.into_iter().zip([0.62796, 0.22486, 0.12585]) {
            assert!((found - published).abs() < 2e-5);
        }
    }

    #[test]
    fn oklab_round_trips() {
        for i in 0..1000 {
            let rgb = [
                i as f32 / 999.0,
                (i * 7 % 1000) as f32 / 999.0,
                (i * 31 % 1000) as f32 / 999.0,
            ];
            let back = linear_from_oklab(oklab_from_linear(rgb));
            for (x, y) in rgb.into_iter().zip(back) {
                assert!((x - y).abs() < 4e-6);
            }
        }
    }
}

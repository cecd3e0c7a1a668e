//! Exponentials and logarithms that a compiler turns into vector code.

/// e to the power of `x`, for `x` from −87 to 88, with a relative error below 2·10⁻⁵. Smaller ones give almost 0.
#[inline(always)]
pub(crate) fn exp(x: f32) -> f32 {
    let power = x.clamp(-87.0, 88.0) * std::f32::consts::LOG2_E;
    // the nearest integer: adding 1.5·2²³ leaves no bits for a fraction
    let shifted = power + 12_582_912.0;
    let whole = shifted - 12_582_912.0;
    let f = (power - whole) * std::f32::consts::LN_2;
    let fraction =
        1.0 + f * (1.0 + f * (0.5 + f * (1.0 / 6.0 + f * (1.0 / 24.0 + f * (1.0 / 120.0)))));
    let exponent = ((whole as i32) + 127) << 23;
    fraction * f32::from_bits(exponent as u32)
}

/// Natural logarithm of a positive normal number, with an error below 2·10⁻⁵.
#[inline(always)]
pub(crate) fn ln(x: f32) -> f32 {
    let bits = x.to_bits() as i32;
    // the exponent that leaves a mantissa from √½ to √2
    let exponent = (bits - 0x3f35_04f3) >> 23;
    let mantissa = f32::from_bits((bits - (exponent << 23)) as u32);
    // 2·atanh(s), s at most 0.1716
    let s = (mantissa - 1.0) / (mantissa + 1.0);
    let squared = s * s;
    let series = 2.0 * s * (1.0 + squared * (1.0 / 3.0 + squared * (0.2 + squared * (1.0 / 7.0))));
    exponent as f32 * std::f32::consts::LN_2 + series
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_as_documented() {
        for step in -8600..8700 {
            let x = step as f32 * 0.01;
            let (found, truth) = (f64::from(exp(x)), f64::from(x).exp());
            assert!((found / truth - 1.0).abs() < 2e-5, "{x}: {found} {truth}");
            let positive = exp(x);
            assert!((f64::from(ln(positive)) - f64::from(positive).ln()).abs() < 2e-5);
        }
        assert!(exp(-1e9) < 1e-37 && exp(f32::NEG_INFINITY) < 1e-37);
    }
}

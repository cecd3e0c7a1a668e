//! Pixel types: each says its color space, its sample kind and what its alpha means.
//!
//! | type | space | alpha |
//! | --- | --- | --- |
//! | [`Srgb<T>`], [`Srgba<T>`] with `T` = `u8`, `u16` or `f32` | encoded sRGB, full range of the integer or 0 to 1 | straight |
//! | [`LinearRgb`], [`LinearRgba`] | linear light, sRGB primaries, 1 = white, values outside 0 to 1 are kept | straight |
//! | [`PremulLinearRgba`] | the same, color multiplied by alpha: the space in which pixels are averaged | premultiplied |
//! | [`Oklab`] | perceptual (Ottosson 2020): Euclidean distance is near perceived difference | none |
//!
//! All linear types can be turned into one another and into any [`Color`]; what has no alpha reads as opaque, and
//! losing alpha keeps the straight color.

use crate::color::{
    LINEAR_FROM_SRGB8, linear_from_oklab, linear_from_srgb, oklab_from_linear, srgb_from_linear,
};
use std::sync::LazyLock;

/// Anything an [`Image`](crate::Image) can hold: plain numbers without padding.
pub trait Pixel: bytemuck::Pod + PartialEq + std::fmt::Debug + Send + Sync {}

impl<T: bytemuck::Pod + PartialEq + std::fmt::Debug + Send + Sync> Pixel for T {}

/// A kind of stored number.
pub trait Sample: Pixel + Default {
    /// The number that stands for 1.
    const ONE: Self;
    /// The value on a scale of 0 to 1.
    fn to_unit(self) -> f32;
    /// The nearest number to a value on a scale of 0 to 1. Integers saturate, and NaN becomes 0; floats keep everything.
    fn from_unit(value: f32) -> Self;
    /// Linear light from the sRGB-encoded number.
    fn to_linear(self) -> f32 {
        linear_from_srgb(self.to_unit())
    }
    /// The nearest sRGB-encoded number to linear light; as [`from_unit`](Self::from_unit) otherwise.
    fn from_linear(linear: f32) -> Self {
        Self::from_unit(srgb_from_linear(linear))
    }
}

impl Sample for u8 {
    const ONE: Self = 255;
    #[inline(always)]
    fn to_unit(self) -> f32 {
        f32::from(self) / 255.0
    }
    #[inline(always)]
    fn from_unit(value: f32) -> Self {
        (value * 255.0 + 0.5) as Self
    }
    #[inline(always)]
    fn to_linear(self) -> f32 {
        LINEAR_FROM_SRGB8[self as usize]
    }
    #[inline(always)]
    fn from_linear(linear: f32) -> Self {
        // NaN is not above 0
        let light = if linear > 0.0 { linear.min(1.0) } else { 0.0 };
        let (code, next) = SRGB8_FROM_LINEAR[(light * LIGHT_STEPS as f32) as i32 as usize];
        code + Self::from(light >= next)
    }
}

/// Steps of linear light of which none holds more than one border between 8-bit codes: these are at least 1 / (12.92 · 255)
/// apart.
const LIGHT_STEPS: usize = 8192;

/// For each step of linear light the code at its beginning, and the light from which on it is the next code: a look-up is ten
/// times faster than the roots.
static SRGB8_FROM_LINEAR: LazyLock<Vec<(u8, f32)>> = LazyLock::new(|| {
    let code = |light: f32| u8::from_unit(srgb_from_linear(light));
    let light = |step: usize| step as f32 / LIGHT_STEPS as f32;
    (0..=LIGHT_STEPS)
        .map(|step| {
            let first = code(light(step));
            let (mut same, mut next) = (light(step).to_bits(), light(step + 1).to_bits());
            if step == LIGHT_STEPS || code(f32::from_bits(next)) == first {
                return (first, f32::INFINITY);
            }
            // positive floats are ordered like their bits
            while next - same > 1 {
                let middle = same.midpoint(next);
                if code(f32::from_bits(middle)) == first {
                    same = middle;
                } else {
                    next = middle;
                }
            }
            (first, f32::from_bits(next))
        })
        .collect()
});

impl Sample for u16 {
    const ONE: Self = 65535;
    #[inline(always)]
    fn to_unit(self) -> f32 {
        f32::from(self) / 65535.0
    }
    #[inline(always)]
    fn from_unit(value: f32) -> Self {
        (value * 65535.0 + 0.5) as Self
    }
    #[inline(always)]
    fn to_linear(self) -> f32 {
        LINEAR_FROM_SRGB16[self as usize]
    }
}

/// [`linear_from_srgb`] of the 65 536 values of a 16-bit sample: a look-up is four times faster than the roots.
static LINEAR_FROM_SRGB16: LazyLock<Vec<f32>> = LazyLock::new(|| {
    (0..=u16::MAX)
        .map(|value| linear_from_srgb(value.to_unit()))
        .collect()
});

impl Sample for f32 {
    const ONE: Self = 1.0;
    #[inline(always)]
    fn to_unit(self) -> f32 {
        self
    }
    #[inline(always)]
    fn from_unit(value: f32) -> Self {
        value
    }
}

macro_rules! pixel_type {
    ($(#[$doc:meta])* $name:ident, $n:literal, $sample:ty) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, Default, PartialEq, bytemuck::Zeroable, bytemuck::Pod)]
        #[repr(transparent)]
        pub struct $name(pub [$sample; $n]);
    };
}

/// Encoded sRGB without alpha.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash, bytemuck::Zeroable, bytemuck::Pod)]
#[repr(transparent)]
pub struct Srgb<T: Sample>(pub [T; 3]);

/// Encoded sRGB with straight alpha.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash, bytemuck::Zeroable, bytemuck::Pod)]
#[repr(transparent)]
pub struct Srgba<T: Sample>(pub [T; 4]);

pixel_type!(
    /// Linear light with sRGB primaries, no alpha.
    LinearRgb,
    3,
    f32
);
pixel_type!(
    /// Linear light with sRGB primaries and straight alpha.
    LinearRgba,
    4,
    f32
);
pixel_type!(
    /// Linear light with sRGB primaries, multiplied by alpha. The only type that may be averaged or resampled when
    /// there is transparency.
    PremulLinearRgba,
    4,
    f32
);
pixel_type!(
    /// Oklab: lightness 0 to 1, then green-red and blue-yellow, each about −0.4 to 0.4.
    Oklab,
    3,
    f32
);

impl LinearRgba {
    /// The color with its alpha taken off.
    #[inline(always)]
    pub fn rgb(self) -> [f32; 3] {
        [self.0[0], self.0[1], self.0[2]]
    }

    /// Alpha, 0 to 1.
    #[inline(always)]
    pub fn alpha(self) -> f32 {
        self.0[3]
    }

    /// From a color in linear light and a straight alpha.
    #[inline(always)]
    pub fn from_rgb_alpha([r, g, b]: [f32; 3], alpha: f32) -> Self {
        Self([r, g, b, alpha])
    }
}

/// A pixel that is a color.
pub trait Color: Pixel {
    /// `true` if the type stores alpha.
    const HAS_ALPHA: bool;
    /// The color in linear light with straight alpha.
    fn to_linear(self) -> LinearRgba;
    /// The nearest pixel of this type. Types without alpha drop it; integer types clip to their range.
    fn from_linear(color: LinearRgba) -> Self;
}

impl<T: Sample> Color for Srgb<T> {
    const HAS_ALPHA: bool = false;
    #[inline(always)]
    fn to_linear(self) -> LinearRgba {
        // in full, as `map` is not always inlined, and then costs as much as a look-up
        let [r, g, b] = self.0;
        LinearRgba([r.to_linear(), g.to_linear(), b.to_linear(), 1.0])
    }
    #[inline(always)]
    fn from_linear(color: LinearRgba) -> Self {
        let [r, g, b, _] = color.0;
        Self([T::from_linear(r), T::from_linear(g), T::from_linear(b)])
    }
}

impl<T: Sample> Color for Srgba<T> {
    const HAS_ALPHA: bool = true;
    #[inline(always)]
    fn to_linear(self) -> LinearRgba {
        let [r, g, b, a] = self.0;
        LinearRgba([r.to_linear(), g.to_linear(), b.to_linear(), a.to_unit()])
    }
    #[inline(always)]
    fn from_linear(color: LinearRgba) -> Self {
        let [r, g, b, alpha] = color.0;
        Self([
            T::from_linear(r),
            T::from_linear(g),
            T::from_linear(b),
            T::from_unit(alpha),
        ])
    }
}

impl Color for LinearRgb {
    const HAS_ALPHA: bool = false;
    #[inline(always)]
    fn to_linear(self) -> LinearRgba {
        LinearRgba::from_rgb_alpha(self.0, 1.0)
    }
    #[inline(always)]
    fn from_linear(color: LinearRgba) -> Self {
        Self(color.rgb())
    }
}

impl Color for LinearRgba {
    const HAS_ALPHA: bool = true;
    #[inline(always)]
    fn to_linear(self) -> LinearRgba {
        self
    }
    #[inline(always)]
    fn from_linear(color: LinearRgba) -> Self {
        color
    }
}

impl Color for PremulLinearRgba {
    const HAS_ALPHA: bool = true;
    /// Where alpha is 0 the color is unknown and becomes black.
    #[inline(always)]
    fn to_linear(self) -> LinearRgba {
        let [r, g, b, alpha] = self.0;
        let scale = if alpha == 0.0 { 0.0 } else { 1.0 / alpha };
        LinearRgba([r * scale, g * scale, b * scale, alpha])
    }
    #[inline(always)]
    fn from_linear(color: LinearRgba) -> Self {
        let [r, g, b, alpha] = color.0;
        Self([r * alpha, g * alpha, b * alpha, alpha])
    }
}

impl Color for Oklab {
    const HAS_ALPHA: bool = false;
    #[inline(always)]
    fn to_linear(self) -> LinearRgba {
        LinearRgba::from_rgb_alpha(linear_from_oklab(self.0), 1.0)
    }
    #[inline(always)]
    fn from_linear(color: LinearRgba) -> Self {
        Self(oklab_from_linear(color.rgb()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_8_bit_value_survives_linear_light() {
        for value in 0..=255u8 {
            let pixel = Srgba([value, 255 - value, value / 2, value]);
            assert_eq!(Srgba::<u8>::from_linear(pixel.to_linear()), pixel);
        }
    }

    #[test]
    fn looked_up_codes_are_those_of_the_formula() {
        let by_formula = |v: f32| u8::from_unit(srgb_from_linear(v));
        let values = (0..4_000_000u32).map(|k| k as f32 * (1.25 / 4e6) - 0.1);
        // the formula is right to some three last places, which are eight of the light: so near a change of code it goes to
        // and fro
        for value in values.chain([f32::NAN, f32::NEG_INFINITY, -0.0, 1.0, 1e-30, 1e9]) {
            let (found, expected) = (u8::from_linear(value), by_formula(value));
            let near = [value * (1.0 - 1e-6), value * (1.0 + 1e-6)].map(by_formula);
            assert!(
                found == expected || near.contains(&found),
                "{value}: {found} {expected}"
            );
        }
        // of which the formula has no root
        assert_eq!(u8::from_linear(f32::INFINITY), 255);
    }

    #[test]
    fn every_16_bit_value_survives_linear_light() {
        for value in 0..=65535u16 {
            let pixel = Srgb([value; 3]);
            assert_eq!(Srgb::<u16>::from_linear(pixel.to_linear()), pixel);
        }
    }

    #[test]
    fn every_8_bit_gray_and_primary_survives_oklab() {
        for value in 0..=255u8 {
            for rgb in [[value; 3], [value, 0, 0], [0, value, 0], [0, 0, value]] {
                let pixel = Srgb(rgb);
                let lab = Oklab::from_linear(pixel.to_linear());
                assert_eq!(Srgb::<u8>::from_linear(lab.to_linear()), pixel);
            }
        }
    }

    #[test]
    fn integers_saturate_and_nan_becomes_zero() {
        assert_eq!([-1.0, 2.0, f32::NAN].map(u8::from_unit), [0, 255, 0]);
        assert_eq!(
            [f32::NEG_INFINITY, f32::INFINITY].map(u16::from_unit),
            [0, 65535]
        );
    }

    #[test]
    fn a_transparent_premultiplied_pixel_has_no_color() {
        let pixel = PremulLinearRgba::from_linear(LinearRgba([0.5, 0.25, 1.0, 0.0]));
        assert_eq!(pixel.to_linear(), LinearRgba([0.0; 4]));
    }
}

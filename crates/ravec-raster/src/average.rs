//! Pixels that may be averaged.

use crate::pixel::{LinearRgb, Oklab, Pixel, PremulLinearRgba};

/// A pixel whose weighted mean is again a pixel: floats on a scale that is linear in what they measure.
///
/// Sampling, filters and pyramids ask for it. Encoded sRGB and straight alpha do not have it on purpose: averaging the
/// former darkens edges, averaging the latter lets the color of transparent pixels bleed. Convert first, for example
/// with [`Image::convert`](crate::Image::convert) to [`PremulLinearRgba`].
///
/// A type of your own may implement it if it consists of `CHANNELS` values of type `f32` and nothing else.
pub trait Average: Pixel {
    /// Number of floats of a pixel.
    const CHANNELS: usize;
    /// The pixel whose floats are all 0.
    const ZERO: Self;

    /// `self + weight · other`, channel by channel.
    fn plus(self, weight: f32, other: Self) -> Self;

    /// The floats of a row of pixels.
    #[inline]
    fn numbers(pixels: &[Self]) -> &[f32] {
        bytemuck::cast_slice(pixels)
    }

    /// The floats of a row of pixels.
    #[inline]
    fn numbers_mut(pixels: &mut [Self]) -> &mut [f32] {
        bytemuck::cast_slice_mut(pixels)
    }
}

impl Average for f32 {
    const CHANNELS: usize = 1;
    const ZERO: Self = 0.0;
    #[inline(always)]
    fn plus(self, weight: f32, other: Self) -> Self {
        self + weight * other
    }
}

impl<const N: usize> Average for [f32; N]
where
    Self: Pixel,
{
    const CHANNELS: usize = N;
    const ZERO: Self = [0.0; N];
    #[inline(always)]
    fn plus(mut self, weight: f32, other: Self) -> Self {
        for (sum, value) in self.iter_mut().zip(other) {
            *sum += weight * value;
        }
        self
    }
}

macro_rules! average_by_channels {
    ($($pixel:ident: $n:literal),*) => {
        $(impl Average for $pixel {
            const CHANNELS: usize = $n;
            const ZERO: Self = Self([0.0; $n]);
            #[inline(always)]
            fn plus(self, weight: f32, other: Self) -> Self {
                Self(self.0.plus(weight, other.0))
            }
        })*
    };
}

average_by_channels!(LinearRgb: 3, PremulLinearRgba: 4, Oklab: 3);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_the_channels_in_order() {
        let mut row = [
            PremulLinearRgba([1.0, 2.0, 3.0, 4.0]),
            PremulLinearRgba([5.0; 4]),
        ];
        assert_eq!(
            PremulLinearRgba::numbers(&row),
            [1.0, 2.0, 3.0, 4.0, 5.0, 5.0, 5.0, 5.0]
        );
        PremulLinearRgba::numbers_mut(&mut row)[7] = 8.0;
        assert_eq!(row[1].0, [5.0, 5.0, 5.0, 8.0]);
    }

    #[test]
    fn a_weighted_sum_is_taken_channel_by_channel() {
        let sum = Oklab([1.0, 2.0, 3.0]).plus(0.5, Oklab([2.0, 4.0, -6.0]));
        assert_eq!(sum, Oklab([2.0, 4.0, 0.0]));
        assert_eq!(<[f32; 2]>::ZERO.plus(2.0, [1.0, 3.0]), [2.0, 6.0]);
    }
}

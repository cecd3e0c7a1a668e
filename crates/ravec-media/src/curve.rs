//! Tone curves of color profiles: from stored numbers to linear light and back to the nearest stored number.
//!
//! Source: ICC.1:2022, sections 10.6 (`curveType`) and 10.18 (`parametricCurveType`).

use crate::samples::Samples;
use moxcms::ToneReprCurve;
use ravec_raster::Sample;

/// A non-decreasing curve from encoded values to linear light, both 0 to 1.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Curve(ToneReprCurve);

impl Curve {
    /// A usable curve: finite and rising over the range of stored numbers.
    pub(crate) fn new(curve: &ToneReprCurve) -> Option<Self> {
        if let ToneReprCurve::Parametric(parameters) = curve
            && !matches!(parameters.len(), 1 | 3 | 4 | 5 | 7)
        {
            return None;
        }
        let curve = Self(curve.clone());
        let samples: Vec<f64> = (0..=1024)
            .map(|i| curve.at(f64::from(i) / 1024.0))
            .collect();
        let rises = samples.windows(2).all(|pair| pair[0] <= pair[1]) && samples[0] < samples[1024];
        let finite = samples.iter().all(|value| value.is_finite());
        (rises && finite).then_some(curve)
    }

    /// Linear light of an encoded value. Odd about 0; tables end at 1, formulas go on.
    pub(crate) fn at(&self, encoded: f64) -> f64 {
        let x = encoded.abs();
        let linear = match &self.0 {
            ToneReprCurve::Lut(table) => match table.as_slice() {
                [] => x,
                [gamma] => x.powf(f64::from(*gamma) / 256.0),
                table => {
                    let place = x.min(1.0) * (table.len() - 1) as f64;
                    let below = (place as usize).min(table.len() - 2);
                    let [low, high] = [table[below], table[below + 1]].map(f64::from);
                    (low + (high - low) * (place - below as f64)) / 65535.0
                }
            },
            ToneReprCurve::Parametric(parameters) => formula(parameters, x),
        };
        linear.copysign(encoded)
    }

    /// Returns `true` if the curve does nothing, within the precision of a profile.
    pub(crate) fn is_identity(&self) -> bool {
        (0..=64).all(|i| {
            let x = f64::from(i) / 64.0;
            (self.at(x) - x).abs() < 1e-4
        })
    }

    /// Returns `true` if the curve is that of sRGB: seen as encoded values it is off by less than half an 8-bit step.
    pub(crate) fn is_srgb(&self) -> bool {
        (0..=255).all(|i| {
            let x = i as f32 / 255.0;
            let seen = ravec_raster::color::srgb_from_linear(self.at(f64::from(x)) as f32);
            (seen - x).abs() < 0.5 / 255.0
        })
    }

    /// Linear light of every number that `T` can store; none for floats.
    pub(crate) fn table<T: Stored>(&self) -> Option<Vec<f64>> {
        let codes = T::CODES?;
        let top = (codes - 1) as f64;
        Some((0..codes).map(|code| self.at(code as f64 / top)).collect())
    }
}

/// The five forms of a parametric curve, distinguished by the number of their parameters.
fn formula(parameters: &[f32], x: f64) -> f64 {
    let p = |i: usize| f64::from(parameters[i]);
    let power = |a: f64, b: f64| (a * x + b).max(0.0).powf(p(0));
    match parameters.len() {
        1 => x.powf(p(0)),
        3 if x >= -p(2) / p(1) => power(p(1), p(2)),
        3 => 0.0,
        4 if x >= -p(2) / p(1) => power(p(1), p(2)) + p(3),
        4 => p(3),
        5 if x >= p(4) => power(p(1), p(2)),
        5 => p(3) * x,
        7 if x >= p(4) => power(p(1), p(2)) + p(5),
        7 => p(3) * x + p(6),
        _ => f64::NAN,
    }
}

/// Samples as they lie in files.
pub(crate) trait Stored: Sample {
    /// Number of distinct values, if they can be listed.
    const CODES: Option<usize>;
    /// The place of the number in such a list.
    fn code(self) -> usize;
    /// The number at a place of the list.
    fn from_code(code: usize) -> Self;
    /// Samples of this kind as those of any.
    fn wrap(samples: Vec<Self>) -> Samples;
}

impl Stored for u8 {
    fn wrap(samples: Vec<Self>) -> Samples {
        Samples::U8(samples)
    }
    const CODES: Option<usize> = Some(1 << 8);
    #[inline]
    fn code(self) -> usize {
        self as usize
    }
    #[inline]
    fn from_code(code: usize) -> Self {
        code as Self
    }
}

impl Stored for u16 {
    fn wrap(samples: Vec<Self>) -> Samples {
        Samples::U16(samples)
    }
    const CODES: Option<usize> = Some(1 << 16);
    #[inline]
    fn code(self) -> usize {
        self as usize
    }
    #[inline]
    fn from_code(code: usize) -> Self {
        code as Self
    }
}

impl Stored for f32 {
    fn wrap(samples: Vec<Self>) -> Samples {
        Samples::F32(samples)
    }
    const CODES: Option<usize> = None;
    fn code(self) -> usize {
        0
    }
    fn from_code(code: usize) -> Self {
        code as Self
    }
}

/// A curve backwards: from linear light to the stored number whose own light is nearest.
///
/// Because the search is among the very values that reading gives, reading and writing returns every number.
#[derive(Debug)]
pub(crate) struct Backward {
    /// Linear light of each stored number.
    table: Vec<f64>,
    /// For equal steps of the square root of light, the first number that is not below: a short range to search.
    first: Vec<u32>,
}

/// Steps of the coarse index. The square root spreads the dark numbers, which crowd near 0.
const STEPS: usize = 4096;

impl Backward {
    pub(crate) fn new(table: Vec<f64>) -> Self {
        let first = (0..=STEPS)
            .map(|step| {
                let light = (step as f64 / STEPS as f64).powi(2);
                table.partition_point(|&value| value < light) as u32
            })
            .collect();
        Self { table, first }
    }

    /// The place of the stored number nearest to `light`.
    pub(crate) fn nearest(&self, light: f64) -> usize {
        let last = self.table.len() - 1;
        let step = (light.clamp(0.0, 1.0).sqrt() * STEPS as f64) as usize;
        // one step to either side makes the rounding of the root harmless
        let from = self.first[step.saturating_sub(1)] as usize;
        let to = self
            .first
            .get(step + 2)
            .map_or(self.table.len(), |&n| n as usize);
        let above = from + self.table[from..to].partition_point(|&value| value < light);
        if above == 0 {
            0
        } else if above > last {
            last
        } else if light - self.table[above - 1] < self.table[above] - light {
            above - 1
        } else {
            above
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn curves() -> Vec<ToneReprCurve> {
        vec![
            ToneReprCurve::Lut(vec![]),
            ToneReprCurve::Lut(vec![563]),
            ToneReprCurve::Lut((0..1024u32).map(|i| (i * i / 16) as u16).collect()),
            ToneReprCurve::Parametric(vec![1.8]),
            ToneReprCurve::Parametric(vec![2.4, 1.0 / 1.055, 0.055 / 1.055, 1.0 / 12.92, 0.04045]),
        ]
    }

    #[test]
    fn every_stored_number_comes_back() {
        for curve in curves() {
            let curve = Curve::new(&curve).unwrap();
            let table = curve.table::<u16>().unwrap();
            let backward = Backward::new(table.clone());
            for (code, &light) in table.iter().enumerate() {
                // tables may repeat a value; then any number of that value is right
                assert_eq!(table[backward.nearest(light)], light, "{code} of {curve:?}");
            }
            assert_eq!(backward.nearest(-1.0), 0);
            assert_eq!(backward.nearest(9.0), 65535);
            assert!(backward.nearest(f64::NAN) <= 65535);
        }
    }

    #[test]
    fn the_nearest_number_is_that_of_a_plain_search() {
        for curve in curves() {
            let table = Curve::new(&curve).unwrap().table::<u8>().unwrap();
            let backward = Backward::new(table.clone());
            for i in 0..5000 {
                let light = f64::from(i) / 4800.0 - 0.01;
                let best = |code: usize| (table[code] - light).abs();
                let plain = (0..256).map(best).fold(f64::INFINITY, f64::min);
                assert_eq!(best(backward.nearest(light)), plain, "{light}");
            }
        }
    }

    #[test]
    fn srgb_and_identity_are_recognized() {
        let of = |curve: &ToneReprCurve| Curve::new(curve).unwrap();
        let all = curves();
        assert!(of(&all[4]).is_srgb() && !of(&all[1]).is_srgb() && !of(&all[3]).is_srgb());
        assert!(of(&all[0]).is_identity() && !of(&all[4]).is_identity());
    }

    #[test]
    fn senseless_curves_are_refused() {
        assert!(Curve::new(&ToneReprCurve::Lut(vec![9, 3])).is_none());
        assert!(Curve::new(&ToneReprCurve::Lut(vec![7, 7])).is_none());
        assert!(Curve::new(&ToneReprCurve::Parametric(vec![])).is_none());
        assert!(Curve::new(&ToneReprCurve::Parametric(vec![f32::NAN])).is_none());
        assert!(Curve::new(&ToneReprCurve::Parametric(vec![1.0; 6])).is_none());
    }
}

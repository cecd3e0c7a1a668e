//! Colors: light as numbers, sRGB as bytes, and scales from numbers to colors.

use glam::Vec3;

/// A color as bytes of sRGB.
pub type Rgb8 = [u8; 3];

/// A scale of colors with steps of equal visual size.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ColorMap {
    /// From dark violet over green to yellow, steadily lighter: for amounts, such as distances.
    #[default]
    Sequential,
    /// From blue over light gray to red, equally dark at both ends: for what may fall short or exceed.
    Diverging,
}

/// Colors of equal distance; in between they are mixed in Oklab, where equal differences look equal.
const SEQUENTIAL: [Rgb8; 5] = [
    [68, 1, 84],
    [59, 82, 139],
    [33, 145, 140],
    [94, 201, 98],
    [253, 231, 37],
];
const DIVERGING: [Rgb8; 5] = [
    [43, 75, 170],
    [125, 158, 228],
    [226, 226, 226],
    [226, 142, 112],
    [166, 36, 40],
];

/// The color of values that are not numbers.
const NO_NUMBER: Rgb8 = [128, 128, 128];

impl ColorMap {
    /// The color at a share of the scale from 0 to 1, to which others are cut off; gray if it is not a number.
    pub fn color(self, share: f64) -> Rgb8 {
        encoded(self.light(share))
    }

    /// The same as linear light.
    pub(super) fn light(self, share: f64) -> Vec3 {
        if share.is_nan() {
            return light(NO_NUMBER);
        }
        let stops = match self {
            Self::Sequential => &SEQUENTIAL,
            Self::Diverging => &DIVERGING,
        };
        let at = share.clamp(0.0, 1.0) * (stops.len() - 1) as f64;
        let before = (at as usize).min(stops.len() - 2);
        let [low, high] = [before, before + 1].map(|stop| oklab(light(stops[stop])));
        from_oklab(low.lerp(high, (at - before as f64) as f32)).clamp(Vec3::ZERO, Vec3::ONE)
    }
}

/// Linear light of a color.
pub(super) fn light(color: Rgb8) -> Vec3 {
    Vec3::from_array(color.map(|byte| {
        let x = f32::from(byte) / 255.0;
        if x <= 0.04045 {
            x / 12.92
        } else {
            ((x + 0.055) / 1.055).powf(2.4)
        }
    }))
}

/// The closest color to linear light, which is cut off at 0 and 1.
pub(super) fn encoded(light: Vec3) -> Rgb8 {
    light.to_array().map(|x| {
        let x = x.clamp(0.0, 1.0);
        let x = if x <= 0.003_130_8 {
            12.92 * x
        } else {
            1.055 * x.powf(1.0 / 2.4) - 0.055
        };
        (x * 255.0).round() as u8
    })
}

/// Lightness and two differences of color. Source: Ottosson, *A perceptual color space for image processing*, 2020.
fn oklab(light: Vec3) -> Vec3 {
    let cone = |r: f32, g: f32, b: f32| light.dot(Vec3::new(r, g, b)).max(0.0).powf(1.0 / 3.0);
    let l = cone(0.412_221_46, 0.536_332_55, 0.051_445_995);
    let m = cone(0.211_903_5, 0.680_699_5, 0.107_396_96);
    let s = cone(0.088_302_46, 0.281_718_85, 0.629_978_7);
    Vec3::new(
        0.210_454_26 * l + 0.793_617_8 * m - 0.004_072_047 * s,
        1.977_998_5 * l - 2.428_592_2 * m + 0.450_593_7 * s,
        0.025_904_037 * l + 0.782_771_77 * m - 0.808_675_77 * s,
    )
}

fn from_oklab(lab: Vec3) -> Vec3 {
    let cone = |a: f32, b: f32| {
        let x = lab.x + a * lab.y + b * lab.z;
        x * x * x
    };
    let l = cone(0.396_337_78, 0.215_803_76);
    let m = cone(-0.105_561_346, -0.063_854_17);
    let s = cone(-0.089_484_18, -1.291_485_5);
    Vec3::new(
        4.076_741_7 * l - 3.307_711_6 * m + 0.230_969_94 * s,
        -1.268_438 * l + 2.609_757_4 * m - 0.341_319_38 * s,
        -0.004_196_086_3 * l - 0.703_418_6 * m + 1.707_614_7 * s,
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lightness(map: ColorMap, share: f64) -> f32 {
        oklab(light(map.color(share))).x
    }

    #[test]
    fn bytes_survive_linear_light_and_its_way_through_oklab() {
        for byte in 0..=255 {
            let color = [byte, 255 - byte, byte / 2];
            assert_eq!(encoded(light(color)), color);
            assert_eq!(encoded(from_oklab(oklab(light(color)))), color);
        }
    }

    #[test]
    fn the_sequential_scale_grows_lighter_at_a_steady_pace() {
        let steps: Vec<f32> = (0..20)
            .map(|i| {
                lightness(ColorMap::Sequential, f64::from(i + 1) / 20.0)
                    - lightness(ColorMap::Sequential, f64::from(i) / 20.0)
            })
            .collect();
        assert!(
            steps.iter().all(|&step| (0.02..0.05).contains(&step)),
            "{steps:?}"
        );
    }

    #[test]
    fn the_diverging_scale_is_lightest_in_the_middle_and_even_at_both_sides() {
        for i in 0..10 {
            let (here, next) = (f64::from(i) / 20.0, f64::from(i + 1) / 20.0);
            assert!(lightness(ColorMap::Diverging, here) < lightness(ColorMap::Diverging, next));
            let mirrored = lightness(ColorMap::Diverging, 1.0 - here);
            assert!((lightness(ColorMap::Diverging, here) - mirrored).abs() < 0.05);
        }
    }

    #[test]
    fn what_is_off_the_scale_has_the_color_of_its_end_and_no_number_is_gray() {
        let map = ColorMap::Diverging;
        assert_eq!(map.color(-3.0), DIVERGING[0]);
        assert_eq!(map.color(f64::INFINITY), DIVERGING[4]);
        assert_eq!(map.color(f64::NAN), NO_NUMBER);
    }
}

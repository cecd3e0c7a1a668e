//! The profiles that files get whose source had none, or none that can be kept.

use moxcms::{ColorProfile, LocalizableString, ProfileText, ToneReprCurve};
use std::sync::LazyLock;

/// The profile of 8- and 16-bit color files that we write in sRGB.
pub(crate) static SRGB: LazyLock<Vec<u8>> =
    LazyLock::new(|| encoded(ColorProfile::new_srgb(), "sRGB"));

/// The profile of float files: the primaries of sRGB, linear light.
pub(crate) static LINEAR_SRGB: LazyLock<Vec<u8>> = LazyLock::new(|| {
    let mut profile = ColorProfile::new_srgb();
    let linear = Some(ToneReprCurve::Lut(Vec::new()));
    (profile.red_trc, profile.green_trc) = (linear.clone(), linear.clone());
    profile.blue_trc = linear;
    profile.cicp = None;
    encoded(profile, "Linear sRGB")
});

/// The profile of gray files: the curve of sRGB.
pub(crate) static GREY_SRGB: LazyLock<Vec<u8>> = LazyLock::new(|| {
    let mut profile = ColorProfile::new_gray_with_gamma(2.2);
    profile.gray_trc = ColorProfile::new_srgb().red_trc;
    encoded(profile, "Gray with sRGB curve")
});

/// Range of the size in the header of a profile.
const SIZE_IN_HEADER: std::ops::Range<usize> = 0..4;

/// Range of the illuminant of the connection space in the header of a profile.
const ILLUMINANT_IN_HEADER: std::ops::Range<usize> = 68..80;

/// D50 as the standard rounds it (ICC.1:2022, 7.2.16).
const D50: [u8; 12] = [0, 0, 0xf6, 0xd6, 0, 1, 0, 0, 0, 0, 0xd3, 0x2d];

/// Offset of the date of creation in the header of a profile (ICC.1:2022, 7.2).
const DATE_IN_HEADER: std::ops::Range<usize> = 24..36;

/// The first of January 2024, midnight: year, month, day, hour, minute, second as 16-bit numbers.
const DATE: [u8; 12] = [0x07, 0xe8, 0, 1, 0, 1, 0, 0, 0, 0, 0, 0];

fn encoded(mut profile: ColorProfile, name: &str) -> Vec<u8> {
    profile.description = Some(ProfileText::Localizable(vec![LocalizableString::new(
        "en".into(),
        "US".into(),
        name.into(),
    )]));
    // a profile that cannot be encoded is left out; a test shows that these can
    let mut profile = profile.encode().unwrap_or_default();
    // the encoder writes the time of day, but equal pictures are to give equal files
    if let Some(date) = profile.get_mut(DATE_IN_HEADER) {
        date.copy_from_slice(&DATE);
    }
    // the encoder rounds it otherwise, and some readers compare bytes
    if let Some(illuminant) = profile.get_mut(ILLUMINANT_IN_HEADER) {
        illuminant.copy_from_slice(&D50);
    }
    // the size of a profile is a multiple of four (ICC.1:2022, 7.2.2), which the encoder forgets and some readers insist on
    profile.resize(profile.len().next_multiple_of(4), 0);
    let size = (profile.len() as u32).to_be_bytes();
    if let Some(field) = profile.get_mut(SIZE_IN_HEADER) {
        field.copy_from_slice(&size);
    }
    profile
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::profile::{Profile, description};

    #[test]
    fn our_own_profiles_are_what_they_say() {
        assert!(matches!(Profile::parse(&SRGB), Ok(Profile::Srgb)));
        assert!(matches!(Profile::parse(&GREY_SRGB), Ok(Profile::Srgb)));
        let linear = Profile::parse(&LINEAR_SRGB).unwrap();
        let matrix = linear.linear_space().unwrap();
        let drift = (0..9).map(|i| (matrix[i / 3][i % 3] - f64::from(u8::from(i % 4 == 0))).abs());
        assert!(drift.fold(0.0, f64::max) < 1e-4);
        assert_eq!(description(&SRGB).as_deref(), Some("sRGB"));
        for profile in [&SRGB, &GREY_SRGB, &LINEAR_SRGB] {
            assert_eq!(profile[DATE_IN_HEADER], DATE);
            assert_eq!(profile.len() % 4, 0);
            assert_eq!(
                profile[SIZE_IN_HEADER],
                (profile.len() as u32).to_be_bytes()
            );
        }
        assert!(SRGB.len() < 1000 && GREY_SRGB.len() < 1000);
    }
}

//! The profiles that files get whose source had none, or none that can be kept.

use moxcms::{ColorDateTime, ColorProfile, LocalizableString, ProfileText, ToneReprCurve};
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

/// The profile of grey files: the curve of sRGB.
pub(crate) static GREY_SRGB: LazyLock<Vec<u8>> = LazyLock::new(|| {
    let mut profile = ColorProfile::new_gray_with_gamma(2.2);
    profile.gray_trc = ColorProfile::new_srgb().red_trc;
    encoded(profile, "Grey with sRGB curve")
});

fn encoded(mut profile: ColorProfile, name: &str) -> Vec<u8> {
    profile.description = Some(ProfileText::Localizable(vec![LocalizableString::new(
        "en".into(),
        "US".into(),
        name.into(),
    )]));
    // equal pictures are to give equal files, so the profile must not tell the time
    profile.creation_date_time = ColorDateTime {
        year: 2024,
        month: 1,
        day_of_the_month: 1,
        hours: 0,
        minutes: 0,
        seconds: 0,
    };
    // a profile that cannot be encoded is left out; a test shows that these can
    profile.encode().unwrap_or_default()
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
        assert!(SRGB.len() < 1000 && GREY_SRGB.len() < 1000);
    }
}

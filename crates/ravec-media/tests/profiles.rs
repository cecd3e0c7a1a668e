//! Color profiles: what comes in goes out again, and looks right in between.

use image::{ExtendedColorType, ImageEncoder as _};
use moxcms::{ColorProfile, ToneReprCurve};
use ravec_media::{
    Format, Limits, Picture, ProfileChoice, SampleKind, Warning, WriteOptions, decode, encode,
    probe_data,
};
use ravec_raster::{AnyImage, Image, LinearRgb, LinearRgba, Size, Srgb};
use std::io::Cursor;

fn spaces() -> Vec<(&'static str, ColorProfile)> {
    vec![
        ("Adobe RGB", ColorProfile::new_adobe_rgb()),
        ("Display P3", ColorProfile::new_display_p3()),
        ("ProPhoto RGB", ColorProfile::new_pro_photo_rgb()),
        ("BT.2020", ColorProfile::new_bt2020()),
    ]
}

/// A PNG or TIFF of raw bytes with a profile.
fn file(
    format: Format,
    bytes: &[u8],
    width: u32,
    color: ExtendedColorType,
    icc: Vec<u8>,
) -> Vec<u8> {
    let height = (bytes.len() * 8 / color.bits_per_pixel() as usize) as u32 / width;
    let mut data = Cursor::new(Vec::new());
    if format == Format::Png {
        let mut encoder = image::codecs::png::PngEncoder::new(&mut data);
        encoder.set_icc_profile(icc).unwrap();
        encoder.write_image(bytes, width, height, color).unwrap();
    } else {
        let mut encoder = image::codecs::tiff::TiffEncoder::new(&mut data);
        encoder.set_icc_profile(icc).unwrap();
        encoder.write_image(bytes, width, height, color).unwrap();
    }
    data.into_inner()
}

fn decoded(data: &[u8]) -> Picture {
    decode(Cursor::new(data), &Limits::default()).unwrap()
}

fn rewritten(picture: &Picture, format: Format, options: &WriteOptions) -> Vec<u8> {
    let mut data = Cursor::new(Vec::new());
    assert_eq!(encode(&mut data, format, picture, options).unwrap(), []);
    data.into_inner()
}

/// The stored samples of a PNG or TIFF, without color management.
fn stored(data: &[u8]) -> image::DynamicImage {
    image::load_from_memory(data).unwrap()
}

fn numbers(count: usize) -> impl Iterator<Item = u32> {
    let mut state = 12345u32;
    std::iter::repeat_with(move || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        state >> 8
    })
    .take(count)
}

#[test]
fn eight_bit_pictures_in_other_spaces_come_back_number_by_number() {
    // all corners and edges of the cube, and random colors
    let mut samples: Vec<u8> = (0..=255u8)
        .flat_map(|v| {
            [
                v, 0, 0, 0, v, 255, 255, 255, v, v, v, v, v, 255, 0, 1, v, 254,
            ]
        })
        .collect();
    samples.extend(numbers(3 * 20_000).map(|n| n as u8));
    let width = 16;
    samples.truncate(samples.len() / (3 * width) * 3 * width);
    for (name, profile) in spaces() {
        let icc = profile.encode().unwrap();
        for format in [Format::Png, Format::Tiff] {
            let data = file(
                format,
                &samples,
                width as u32,
                ExtendedColorType::Rgb8,
                icc.clone(),
            );
            let picture = decoded(&data);
            assert_eq!(picture.warnings, []);
            assert_eq!(picture.origin.sample, SampleKind::U8);
            assert!(matches!(picture.image, AnyImage::Linear(_)), "{name}");
            let again = rewritten(&picture, format, &WriteOptions::default());
            assert_eq!(stored(&again), stored(&data), "{name} {format}");
            assert_eq!(decoded(&again), picture, "{name} {format}");
        }
    }
}

#[test]
fn sixteen_bit_pictures_in_other_spaces_come_back_number_by_number() {
    // Curves that are flat at black lose the darkest numbers beside a bright channel, see the module `profile`; so
    // those spaces are tested with channels of similar size and, below, with a bound.
    let mut any: Vec<u16> = (0..=65_535u16).flat_map(|v| [v, v, v]).collect();
    let similar = numbers(3 * 30_000).enumerate().scan(0, |base, (i, n)| {
        if i % 3 == 0 {
            *base = n % 50_000;
        }
        Some((*base + n % 15_000).max(700) as u16)
    });
    any.extend(similar);
    let mut all = any.clone();
    all.extend(numbers(3 * 30_000).map(|n| n as u16));
    all.extend((0..3000u16).flat_map(|v| [v, 65_535, 65_535, 65_535, 65_535, v, 0, v, 65_535]));
    for (name, profile) in spaces() {
        let steep = matches!(name, "Display P3" | "BT.2020");
        let samples = if steep { &all } else { &any };
        let bytes: Vec<u8> = samples.iter().flat_map(|v| v.to_ne_bytes()).collect();
        let bytes = &bytes[..bytes.len() / 96 * 96];
        let data = file(
            Format::Png,
            bytes,
            16,
            ExtendedColorType::Rgb16,
            profile.encode().unwrap(),
        );
        let again = rewritten(&decoded(&data), Format::Png, &WriteOptions::default());
        assert!(stored(&again) == stored(&data), "{name}");
    }
}

#[test]
fn dark_numbers_beside_bright_ones_stay_within_a_twentieth_of_a_percent() {
    let samples: Vec<u16> = (0..2000u16)
        .flat_map(|v| [v, 65_535, 65_535, 65_535, v, 0])
        .collect();
    let bytes: Vec<u8> = samples.iter().flat_map(|v| v.to_ne_bytes()).collect();
    for (name, profile) in spaces() {
        let data = file(
            Format::Png,
            &bytes,
            16,
            ExtendedColorType::Rgb16,
            profile.encode().unwrap(),
        );
        let again = rewritten(&decoded(&data), Format::Png, &WriteOptions::default());
        let (a, b) = (stored(&again).into_rgb16(), stored(&data).into_rgb16());
        let worst = a
            .iter()
            .zip(b.iter())
            .map(|(a, b)| a.abs_diff(*b))
            .max()
            .unwrap();
        assert!(worst <= 65_535 / 2000, "{name}: {worst}");
    }
}

#[test]
fn a_result_is_written_in_the_space_of_its_source_or_in_srgb_on_demand() {
    let icc = ColorProfile::new_display_p3().encode().unwrap();
    let data = file(
        Format::Png,
        &[255, 0, 0, 10, 200, 30],
        2,
        ExtendedColorType::Rgb8,
        icc.clone(),
    );
    let picture = decoded(&data);
    let same = picture.with_image(&picture.convert::<LinearRgba>());
    let again = rewritten(&same, Format::Png, &WriteOptions::default());
    assert_eq!(stored(&again), stored(&data));
    assert_eq!(decoded(&again).origin.icc.as_deref(), Some(&icc[..]));

    let options = WriteOptions {
        profile: ProfileChoice::Srgb,
        ..WriteOptions::default()
    };
    let srgb = decoded(&rewritten(&same, Format::Png, &options));
    // the red of P3 is outside sRGB
    assert_eq!(srgb.convert::<Srgb<u8>>()[(0, 0)], Srgb([255, 0, 0]));
    assert!(matches!(srgb.image, AnyImage::Srgb8(_)));
    assert_eq!(
        srgb.convert::<Srgb<u8>>()[(1, 0)],
        picture.convert::<Srgb<u8>>()[(1, 0)]
    );

    // a format that cannot say its space gets sRGB
    let bmp = decoded(&rewritten(&picture, Format::Bmp, &WriteOptions::default()));
    assert_eq!(bmp.image, srgb.image);
    // JPEG and WebP can
    for format in [Format::Jpeg, Format::WebP] {
        let data = rewritten(&picture, format, &WriteOptions::default());
        assert_eq!(
            decoded(&data).origin.icc.as_deref(),
            Some(&icc[..]),
            "{format}"
        );
    }
}

#[test]
fn srgb_under_any_name_is_left_alone() {
    let mut table = ColorProfile::new_srgb();
    table.cicp = None;
    // the curve of most sRGB profiles in circulation: a table of 1024
    let entries = (0..1024).map(|i| {
        let linear = ravec_raster::color::linear_from_srgb(i as f32 / 1023.0);
        (linear * 65535.0 + 0.5) as u16
    });
    let curve = Some(ToneReprCurve::Lut(entries.collect()));
    (table.red_trc, table.green_trc) = (curve.clone(), curve.clone());
    table.blue_trc = curve;
    for profile in [ColorProfile::new_srgb(), table] {
        let icc = profile.encode().unwrap();
        let data = file(
            Format::Png,
            &[1, 2, 3, 250, 128, 7],
            2,
            ExtendedColorType::Rgb8,
            icc.clone(),
        );
        let picture = decoded(&data);
        let expected = Image::from_vec(2, vec![Srgb([1u8, 2, 3]), Srgb([250, 128, 7])]).unwrap();
        assert_eq!(picture.image, expected.into());
        let again = rewritten(&picture, Format::Png, &WriteOptions::default());
        assert_eq!(decoded(&again).origin.icc.as_deref(), Some(&icc[..]));
    }
}

#[test]
fn gray_profiles_come_back_and_give_way_to_color() {
    let icc = ColorProfile::new_gray_with_gamma(1.8).encode().unwrap();
    let samples: Vec<u8> = (0..=255).collect();
    for (format, color) in [
        (Format::Png, ExtendedColorType::L8),
        (Format::Tiff, ExtendedColorType::L8),
    ] {
        let data = file(format, &samples, 16, color, icc.clone());
        let picture = decoded(&data);
        assert!(picture.origin.gray);
        let again = rewritten(&picture, format, &WriteOptions::default());
        assert_eq!(stored(&again), stored(&data));
        assert_eq!(decoded(&again), picture);
    }
    let picture = decoded(&file(Format::Png, &samples, 16, ExtendedColorType::L8, icc));
    let mut image = picture.convert::<LinearRgba>();
    image[(0, 0)] = LinearRgba([0.5, 0.0, 0.0, 1.0]);
    let result = decoded(&rewritten(
        &picture.with_image(&image),
        Format::Png,
        &WriteOptions::default(),
    ));
    assert_eq!(result.convert::<Srgb<u8>>(), image.convert());
    assert!(!result.origin.gray);
}

#[test]
fn linear_float_files_keep_their_space() {
    let profile = ColorProfile::new_aces_cg_linear();
    let samples = [0.25f32, 4.0, -0.5, 1.0, 1.0, 1.0];
    let bytes: Vec<u8> = samples.iter().flat_map(|v| v.to_ne_bytes()).collect();
    let icc = profile.encode().unwrap();
    let data = file(
        Format::Tiff,
        &bytes,
        2,
        ExtendedColorType::Rgb32F,
        icc.clone(),
    );
    let picture = decoded(&data);
    let white = picture.convert::<LinearRgb>()[(1, 0)].0;
    assert!(white.iter().all(|v| (v - 1.0).abs() < 1e-5), "{white:?}");
    let again = rewritten(&picture, Format::Tiff, &WriteOptions::default());
    assert_eq!(decoded(&again).origin.icc.as_deref(), Some(&icc[..]));
    let back = stored(&again).into_rgb32f();
    for (a, b) in back.iter().zip(samples) {
        // two products of a 3 x 3 matrix in double precision, stored as single
        assert!((a - b).abs() < 4e-6, "{a} {b}");
    }
}

#[test]
fn a_profile_that_cannot_be_used_is_a_warning() {
    let gray = ColorProfile::new_gray_with_gamma(2.2).encode().unwrap();
    for icc in [b"junk that is no profile".to_vec(), gray] {
        let data = file(Format::Png, &[1, 2, 3], 1, ExtendedColorType::Rgb8, icc);
        let picture = decoded(&data);
        assert!(matches!(
            picture.warnings[..],
            [Warning::ProfileIgnored { .. }]
        ));
        assert_eq!(
            picture.image,
            Image::from_vec(1, vec![Srgb([1u8, 2, 3])]).unwrap().into()
        );
        assert!(picture.origin.icc.is_none());
    }
}

#[test]
fn a_probe_tells_the_name_of_the_profile() {
    let icc = ColorProfile::new_display_p3().encode().unwrap();
    let data = file(Format::Png, &[0; 12], 2, ExtendedColorType::Rgb16, icc);
    let probe = probe_data(Cursor::new(data), &Limits::default()).unwrap();
    assert_eq!(probe.profile.as_deref(), Some("Display P3"));
    assert_eq!(
        (probe.format, probe.sample, probe.size),
        (Format::Png, SampleKind::U16, Size::new(2, 1).unwrap())
    );
    assert!(!probe.gray && !probe.alpha && probe.orientation == 1);
}

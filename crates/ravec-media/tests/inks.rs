//! CMYK and the kinds of TIFF that the usual encoders do not write, from files made here byte by byte.

use moxcms::{
    ColorProfile, DataColorSpace, LutDataType, LutStore, LutType, LutWarehouse, Matrix3d,
};
use ravec_media::{
    DecodeError, Format, Limits, Picture, SampleKind, Warning, WriteOptions, decode, encode,
};
use ravec_raster::{AnyImage, Image, LinearRgb, LinearRgba, Size, Srgb, Srgba};
use std::io::Cursor;
use tiff::encoder::colortype::{CMYK8, CMYK16, ColorType, Gray32Float};
use tiff::encoder::{TiffEncoder, TiffValue};
use tiff::tags::{ExtraSamples, PhotometricInterpretation, SampleFormat, Tag};

fn decoded(data: &[u8]) -> Picture {
    decode(Cursor::new(data), &Limits::default()).unwrap()
}

fn tiff<C: ColorType>(
    width: u32,
    samples: &[C::Inner],
    extra: &[ExtraSamples],
    icc: &[u8],
) -> Vec<u8>
where
    [C::Inner]: TiffValue,
{
    let channels = C::BITS_PER_SAMPLE.len() + extra.len();
    let height = (samples.len() / channels) as u32 / width;
    let mut data = Cursor::new(Vec::new());
    let mut encoder = TiffEncoder::new(&mut data).unwrap();
    let mut image = encoder.new_image::<C>(width, height).unwrap();
    if !extra.is_empty() {
        image.extra_samples(extra).unwrap();
    }
    if !icc.is_empty() {
        image.encoder().write_tag(Tag::IccProfile, icc).unwrap();
    }
    image.write_data(samples).unwrap();
    data.into_inner()
}

/// A CMYK profile of one table with two points an ink: Lab of the plain formula at the corners.
fn cmyk_profile() -> Vec<u8> {
    let mut clut = Vec::new();
    for corner in 0..16u32 {
        let ink = |i: u32| corner >> (3 - i) & 1 == 1;
        // lightness falls with each ink, in encoded 16-bit Lab; neutral
        let inks = (0..3).filter(|&i| ink(i)).count() as u16;
        let lightness = if ink(3) { 0 } else { 0xff00 / 3 * (3 - inks) };
        clut.extend_from_slice(&[lightness, 0x8000, 0x8000]);
    }
    let ramp = |channels: usize| [0u16, 0xffff].repeat(channels);
    let mut profile = ColorProfile::new_srgb();
    profile.cicp = None;
    (profile.red_trc, profile.green_trc, profile.blue_trc) = (None, None, None);
    profile.color_space = DataColorSpace::Cmyk;
    profile.pcs = DataColorSpace::Lab;
    profile.profile_class = moxcms::ProfileClass::OutputDevice;
    profile.lut_a_to_b_perceptual = Some(LutWarehouse::Lut(LutDataType {
        num_input_channels: 4,
        num_output_channels: 3,
        num_clut_grid_points: 2,
        matrix: Matrix3d::IDENTITY,
        num_input_table_entries: 2,
        num_output_table_entries: 2,
        input_table: LutStore::Store16(ramp(4)),
        clut_table: LutStore::Store16(clut),
        output_table: LutStore::Store16(ramp(3)),
        lut_type: LutType::Lut16,
    }));
    profile.encode().unwrap()
}

#[test]
fn inks_without_a_profile_follow_the_plain_formula_with_a_warning() {
    let inks = [0u8, 0, 0, 0, 255, 0, 0, 0, 0, 0, 0, 255, 0, 0, 255, 51];
    let picture = decoded(&tiff::<CMYK8>(2, &inks, &[], &[]));
    assert_eq!(picture.warnings, [Warning::CmykWithoutProfile]);
    let expected = vec![
        Srgb([255u8; 3]),
        Srgb([0, 255, 255]),
        Srgb([0; 3]),
        Srgb([204, 204, 0]),
    ];
    assert_eq!(
        picture.image,
        Image::from_vec(2, expected.clone()).unwrap().into()
    );

    let deep: Vec<u16> = inks.iter().map(|&v| u16::from(v) * 257).collect();
    let picture = decoded(&tiff::<CMYK16>(2, &deep, &[], &[]));
    assert_eq!(picture.convert::<Srgb<u8>>().pixels(), expected);
    assert_eq!(picture.origin.sample, SampleKind::U16);
}

#[test]
fn inks_with_a_profile_follow_it_and_are_written_as_srgb() {
    let inks = [0u8, 0, 0, 0, 255, 255, 255, 0, 0, 0, 0, 255, 255, 0, 0, 0];
    let data = tiff::<CMYK8>(2, &inks, &[], &cmyk_profile());
    let picture = decoded(&data);
    assert_eq!(picture.warnings, []);
    assert!(matches!(picture.image, AnyImage::Linear(_)));
    let pixels = picture.convert::<Srgb<u8>>();
    let near = |pixel: Srgb<u8>, value: u8| pixel.0.iter().all(|v| v.abs_diff(value) <= 2);
    assert!(
        near(pixels[(0, 0)], 255) && near(pixels[(1, 0)], 0),
        "{pixels:?}"
    );
    // lightness 66.7 is a linear light of 0.36, in sRGB 0.64
    assert!(
        near(pixels[(0, 1)], 0) && near(pixels[(1, 1)], 162),
        "{pixels:?}"
    );

    let mut again = Cursor::new(Vec::new());
    encode(&mut again, Format::Png, &picture, &WriteOptions::default()).unwrap();
    let again = decoded(again.get_ref());
    assert_eq!(again.image, pixels.into());
    assert_eq!(again.origin.sample, SampleKind::U8);
}

#[test]
fn a_cmyk_jpeg_is_read_with_its_inks_the_right_way_round() {
    for (transform, name) in [(0u8, "CMYK"), (2, "YCCK")] {
        let picture = decoded(&cmyk_jpeg(transform));
        assert_eq!(picture.warnings, [Warning::CmykWithoutProfile], "{name}");
        assert_eq!(picture.image.size(), Size::new(8, 8).unwrap());
        // the file stores 128 for every component: half of each ink
        let expected = Srgb([64u8; 3]);
        let pixel = picture.convert::<Srgb<u8>>()[(3, 3)];
        assert!(
            pixel
                .0
                .iter()
                .zip(expected.0)
                .all(|(a, b)| a.abs_diff(b) <= 1),
            "{name} {pixel:?}"
        );
    }
    // a dark ink pattern: component 0 is stored as 128 + 8 * 8 / 8 and so on by its mean coefficient
    let picture = decoded(&cmyk_jpeg_with_means([127, 0, -127, 127]));
    let [r, g, b] = picture.convert::<Srgb<u8>>()[(0, 0)].0;
    assert!(r > 250 && (120..136).contains(&g) && b < 5, "{r} {g} {b}");
}

fn cmyk_jpeg(transform: u8) -> Vec<u8> {
    jpeg_of_means(transform, [0; 4])
}

fn cmyk_jpeg_with_means(means: [i32; 4]) -> Vec<u8> {
    jpeg_of_means(0, means)
}

/// A baseline JPEG of one 8 x 8 block in four components of which only the means differ from 128.
fn jpeg_of_means(transform: u8, means: [i32; 4]) -> Vec<u8> {
    let mut data = vec![0xff, 0xd8];
    let mut segment = |marker: u8, content: &[u8]| {
        data.extend_from_slice(&[0xff, marker]);
        data.extend_from_slice(&(content.len() as u16 + 2).to_be_bytes());
        data.extend_from_slice(content);
    };
    segment(
        0xee,
        &[b"Adobe\0\x64\0\0\0\0".as_slice(), &[transform]].concat(),
    );
    segment(0xdb, &[[0u8].as_slice(), &[8; 64]].concat());
    let components: Vec<u8> = (1..=4).flat_map(|id| [id, 0x11, 0]).collect();
    segment(0xc0, &[[8, 0, 8, 0, 8, 4].as_slice(), &components].concat());
    // differences of 0 to 11 bits, all with codes of four bits; one code of one bit ends a block
    let lengths = |counts: &[(usize, u8)]| {
        let mut all = [0; 16];
        for &(length, count) in counts {
            all[length - 1] = count;
        }
        all
    };
    let sizes: Vec<u8> = (0..12).collect();
    segment(
        0xc4,
        &[[0x00].as_slice(), &lengths(&[(4, 12)]), &sizes].concat(),
    );
    segment(
        0xc4,
        &[[0x10].as_slice(), &lengths(&[(1, 1)]), &[0]].concat(),
    );
    let components: Vec<u8> = (1..=4).flat_map(|id| [id, 0x00]).collect();
    segment(0xda, &[[4].as_slice(), &components, &[0, 63, 0]].concat());
    let mut bits = Vec::new();
    let mut put =
        |value: i32, count: u32| (0..count).rev().for_each(|bit| bits.push(value >> bit & 1));
    for mean in means {
        // the mean coefficient is 8 times the mean; the table divides by 8
        let size = 32 - mean.unsigned_abs().leading_zeros();
        put(size as i32, 4);
        put(if mean < 0 { mean - 1 } else { mean }, size);
        put(0, 1);
    }
    while bits.len() % 8 != 0 {
        bits.push(1);
    }
    for byte in bits.chunks(8) {
        let byte = byte.iter().fold(0, |byte, bit| byte << 1 | *bit as u8);
        data.push(byte);
        if byte == 0xff {
            data.push(0);
        }
    }
    data.extend_from_slice(&[0xff, 0xd9]);
    data
}

#[test]
fn a_gray_float_tiff_is_read_as_linear_light() {
    let picture = decoded(&tiff::<Gray32Float>(
        2,
        &[0.25, 4.0, f32::NAN, -1.0],
        &[],
        &[],
    ));
    let expected = [0.25, 4.0, 0.0, -1.0].map(|v| LinearRgb([v; 3])).to_vec();
    assert_eq!(picture.image, Image::from_vec(2, expected).unwrap().into());
    assert_eq!(
        picture.warnings,
        [Warning::NotFinite {
            nan: 1,
            infinite: 0
        }]
    );
    assert!(picture.origin.gray);
}

/// Gray by another name, to write what the encoder has no type for.
struct Named<const BITS: u8>;

impl ColorType for Named<1> {
    type Inner = u8;
    const TIFF_VALUE: PhotometricInterpretation = PhotometricInterpretation::WhiteIsZero;
    const BITS_PER_SAMPLE: &'static [u16] = &[8];
    const SAMPLE_FORMAT: &'static [SampleFormat] = &[SampleFormat::Uint];
    fn horizontal_predict(_: &[u8], _: &mut Vec<u8>) {}
}

#[test]
fn a_tiff_whose_zero_is_white_and_one_with_gray_and_alpha() {
    let picture = decoded(&tiff::<Named<1>>(2, &[0, 255, 200, 100], &[], &[]));
    let gray: Vec<_> = picture
        .convert::<Srgb<u8>>()
        .pixels()
        .iter()
        .map(|p| p.0[0])
        .collect();
    assert_eq!(gray, [255, 0, 55, 155]);

    let straight = [ExtraSamples::UnassociatedAlpha];
    let data = tiff::<tiff::encoder::colortype::Gray8>(2, &[9, 255, 50, 100], &straight, &[]);
    let picture = decoded(&data);
    let expected = vec![Srgba([9u8, 9, 9, 255]), Srgba([50, 50, 50, 100])];
    assert_eq!(picture.image, Image::from_vec(2, expected).unwrap().into());
    assert!(picture.origin.gray);
}

#[test]
fn alpha_that_colors_are_multiplied_by_becomes_straight() {
    let multiplied = [ExtraSamples::AssociatedAlpha];
    let samples = [50u8, 100, 0, 100, 7, 8, 9, 255];
    let picture = decoded(&tiff::<tiff::encoder::colortype::RGB8>(
        2,
        &samples,
        &multiplied,
        &[],
    ));
    let expected = vec![Srgba([128u8, 255, 0, 100]), Srgba([7, 8, 9, 255])];
    assert_eq!(picture.image, Image::from_vec(2, expected).unwrap().into());
    let floats = [0.5f32, 0.25, 0.0, 0.5];
    let data = tiff::<tiff::encoder::colortype::RGB32Float>(1, &floats, &multiplied, &[]);
    assert_eq!(
        decoded(&data).convert::<LinearRgba>()[(0, 0)],
        LinearRgba([1.0, 0.5, 0.0, 0.5])
    );
}

#[test]
fn a_tiff_of_whole_numbers_of_32_bit_is_not_supported_and_says_so() {
    let data = tiff::<tiff::encoder::colortype::Gray32>(1, &[5, 6], &[], &[]);
    let error = decode(Cursor::new(data), &Limits::default()).unwrap_err();
    assert!(matches!(error, DecodeError::Unsupported { .. }));
    assert!(
        error
            .to_string()
            .starts_with("this kind of TIFF file is not supported: "),
        "{error}"
    );
}

//! Round trips: written pictures are read back, in every format and sample kind, gray, with alpha; orientation, EXIF,
//! standard sentences.

use image::{ExtendedColorType, ImageEncoder as _};
use ravec_files::write_atomically;
use ravec_media::{
    DecodeError, EncodeError, Format, Limits, Picture, ProfileChoice, SampleKind, Warning,
    WriteOptions, decode, encode, probe_data, read, write,
};
use ravec_raster::{AnyImage, Image, LinearRgb, LinearRgba, Size, Srgb, Srgba};
use std::io::{Cursor, Write as _};

fn encoded(picture: &Picture, format: Format) -> Vec<u8> {
    let mut data = Cursor::new(Vec::new());
    encode(&mut data, format, picture, &WriteOptions::default()).unwrap();
    data.into_inner()
}

fn decoded(data: &[u8]) -> Picture {
    let picture = decode(Cursor::new(data), &Limits::default()).unwrap();
    assert_eq!(picture.warnings, []);
    picture
}

/// Numbers without pattern.
fn noise(seed: u32) -> impl FnMut() -> u32 {
    let mut state = seed.wrapping_mul(2_654_435_761).wrapping_add(99);
    move || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        state >> 8
    }
}

fn size() -> Size {
    Size::new(19, 11).unwrap()
}

fn pictures() -> Vec<Picture> {
    let mut n = noise(1);
    let mut channel = move || n();
    let mut images: Vec<AnyImage> = vec![
        Image::from_fn(size(), |_, _| Srgb([0; 3].map(|_: i32| channel() as u8))).into(),
        Image::from_fn(size(), |_, _| Srgba([0; 4].map(|_: i32| channel() as u8))).into(),
        Image::from_fn(size(), |_, _| Srgb([0; 3].map(|_: i32| channel() as u16))).into(),
        Image::from_fn(size(), |_, _| Srgba([0; 4].map(|_: i32| channel() as u16))).into(),
    ];
    images.push(
        Image::from_fn(size(), |_, _| {
            LinearRgb([0; 3].map(|_: i32| channel() as f32 * 1e-5))
        })
        .into(),
    );
    images.push(
        Image::from_fn(size(), |_, _| {
            LinearRgba([
                channel() as f32 * 1e-5,
                0.5,
                -0.25,
                (channel() % 5) as f32 / 4.0 + 0.0,
            ])
        })
        .into(),
    );
    images.into_iter().map(Picture::from_image).collect()
}

#[test]
fn integer_pictures_survive_every_format_that_has_their_samples() {
    for picture in &pictures()[..4] {
        for format in Format::ALL {
            let fits = format.nearest_sample(picture.origin.sample) == picture.origin.sample
                && (format.has_alpha() || !picture.image.has_alpha())
                && format != Format::Jpeg;
            if !fits {
                continue;
            }
            let back = decoded(&encoded(picture, format));
            assert_eq!(back.image, picture.image, "{format}");
            assert_eq!(back.origin.format, Some(format));
            assert_eq!(back.origin.sample, picture.origin.sample);
            assert!(!back.origin.gray);
            assert_eq!(back.origin.icc.is_some(), format.has_profile(), "{format}");
            // and once more with what was read, which has the embedded profile
            assert_eq!(decoded(&encoded(&back, format)), back, "{format}");
        }
    }
}

#[test]
fn gray_pictures_stay_gray_in_every_format_that_has_gray() {
    let mut n = noise(3);
    let mut value = move || n();
    for alpha in [false, true] {
        for deep in [false, true] {
            let image: AnyImage = match (alpha, deep) {
                (false, false) => Image::from_fn(size(), |_, _| Srgb([value() as u8; 3])).into(),
                (true, false) => Image::from_fn(size(), |_, _| {
                    let v = value() as u8;
                    Srgba([v, v, v, value() as u8])
                })
                .into(),
                (false, true) => Image::from_fn(size(), |_, _| Srgb([value() as u16; 3])).into(),
                (true, true) => Image::from_fn(size(), |_, _| {
                    let v = value() as u16;
                    Srgba([v, v, v, value() as u16])
                })
                .into(),
            };
            let mut picture = Picture::from_image(image);
            picture.origin.gray = true;
            for format in [Format::Png, Format::Tiff, Format::WebP, Format::Bmp] {
                if format.nearest_sample(picture.origin.sample) != picture.origin.sample {
                    continue;
                }
                let data = encoded(&picture, format);
                let back = decoded(&data);
                assert_eq!(back.image, picture.image, "{format} {alpha} {deep}");
                let probe = probe_data(Cursor::new(&data), &Limits::default()).unwrap();
                // WebP and BMP store gray, but their decoders hand out color
                let says_gray = format == Format::Png || format == Format::Tiff && !alpha;
                assert_eq!(probe.gray, says_gray, "{format}");
                assert_eq!(back.origin.gray, probe.gray);
            }
        }
    }
}

#[test]
fn a_gray_source_with_a_colored_result_becomes_color() {
    let mut picture = Picture::from_image(Image::new(size(), Srgb([9u8; 3])));
    picture.origin.gray = true;
    let mut image = picture.convert::<LinearRgba>();
    image[(3, 3)] = LinearRgba([0.5, 0.1, 0.1, 1.0]);
    let back = decoded(&encoded(&picture.with_image(&image), Format::Png));
    assert!(!back.origin.gray);
    assert_eq!(back.convert::<Srgb<u8>>(), image.convert());
}

#[test]
fn floats_survive_tiff_and_exr_exactly_and_hdr_to_its_eight_bits() {
    let all = pictures();
    for format in [Format::Tiff, Format::OpenExr] {
        let back = decoded(&encoded(&all[4], format));
        assert_eq!(back.image, all[4].image, "{format}");
        assert_eq!(back.origin.sample, SampleKind::F32);
    }
    assert_eq!(decoded(&encoded(&all[5], Format::Tiff)).image, all[5].image);

    // alpha is premultiplied in EXR: powers of two come back exactly, other products within a rounding or two
    let back = decoded(&encoded(&all[5], Format::OpenExr)).convert::<LinearRgba>();
    for (a, b) in back
        .pixels()
        .iter()
        .zip(all[5].convert::<LinearRgba>().pixels())
    {
        assert_eq!(a.alpha(), b.alpha());
        for (x, y) in a.rgb().into_iter().zip(b.rgb()) {
            let expected = if b.alpha() == 0.0 { 0.0 } else { y };
            assert!(
                (x - expected).abs() <= 3e-7 * expected.abs(),
                "{x} {expected}"
            );
        }
    }

    // a shared exponent leaves each channel 8 bits below the largest
    let back = decoded(&encoded(&all[4], Format::Hdr)).convert::<LinearRgb>();
    for (a, b) in back
        .pixels()
        .iter()
        .zip(all[4].convert::<LinearRgb>().pixels())
    {
        let largest = b.0.into_iter().fold(0.0, f32::max);
        for (x, y) in a.0.into_iter().zip(b.0) {
            assert!((x - y).abs() <= largest / 128.0, "{x} {y}");
        }
    }
}

#[test]
fn jpeg_is_near_and_keeps_gray() {
    let ramp = Image::from_fn(Size::new(64, 48).unwrap(), |col, row| {
        Srgb([4 * col as u8, 5 * row as u8, 128])
    });
    let picture = Picture::from_image(ramp.clone());
    let back = decoded(&encoded(&picture, Format::Jpeg));
    let back = back.convert::<Srgb<u8>>();
    let worst = largest_difference(&back, &ramp);
    // quality 92 quantizes by up to 18 of 2040; smooth ramps stay well within
    assert!(worst <= 8, "{worst}");

    let mut gray = Picture::from_image(ramp.map(|p| Srgb([p.0[0]; 3])));
    gray.origin.gray = true;
    let back = decoded(&encoded(&gray, Format::Jpeg));
    assert!(back.origin.gray);
}

fn largest_difference(a: &Image<Srgb<u8>>, b: &Image<Srgb<u8>>) -> u8 {
    let pairs = a.pixels().iter().zip(b.pixels());
    let differences = pairs.flat_map(|(a, b)| (0..3).map(|i| a.0[i].abs_diff(b.0[i])));
    differences.max().unwrap_or(0)
}

#[test]
fn sample_kinds_follow_source_format_and_wish() {
    let deep = &pictures()[2];
    let float = &pictures()[4];
    let sample = |picture: &Picture, format, wish| {
        let options = WriteOptions {
            sample: wish,
            ..WriteOptions::default()
        };
        let mut data = Cursor::new(Vec::new());
        encode(&mut data, format, picture, &options).unwrap();
        data.set_position(0);
        probe_data(data, &Limits::default()).unwrap().sample
    };
    assert_eq!(sample(deep, Format::Png, None), SampleKind::U16);
    assert_eq!(sample(deep, Format::Jpeg, None), SampleKind::U8);
    assert_eq!(
        sample(deep, Format::Png, Some(SampleKind::U8)),
        SampleKind::U8
    );
    assert_eq!(sample(float, Format::Png, None), SampleKind::U16);
    assert_eq!(sample(float, Format::Tiff, None), SampleKind::F32);
    assert_eq!(
        sample(float, Format::Tiff, Some(SampleKind::U16)),
        SampleKind::U16
    );
    assert_eq!(sample(float, Format::WebP, None), SampleKind::U8);
    assert_eq!(sample(deep, Format::OpenExr, None), SampleKind::F32);
    // through linear floats and back, integers are what they were
    let data = encoded(deep, Format::OpenExr);
    assert_eq!(decoded(&data).convert::<Srgb<u16>>(), deep.convert());
}

#[test]
fn transparency_is_flattened_where_there_is_none() {
    let image = Image::from_fn(size(), |col, _| {
        Srgba([0u8, 0, 0, if col < 9 { 0 } else { 255 }])
    });
    let picture = Picture::from_image(image);
    let options = WriteOptions {
        background: Srgb([0, 0, 255]),
        ..WriteOptions::default()
    };
    let mut data = Cursor::new(Vec::new());
    let warnings = encode(&mut data, Format::Hdr, &picture, &options).unwrap();
    assert_eq!(
        warnings,
        [Warning::AlphaFlattened {
            format: Format::Hdr
        }]
    );
    let back = decoded(data.get_ref()).convert::<Srgb<u8>>();
    assert_eq!(
        (back[(0, 0)], back[(18, 0)]),
        (Srgb([0, 0, 255]), Srgb([0; 3]))
    );

    let opaque = Picture::from_image(Image::new(size(), Srgba([1u8, 2, 3, 255])));
    let warnings = encode(Cursor::new(Vec::new()), Format::Jpeg, &opaque, &options).unwrap();
    assert_eq!(warnings, []);
}

/// An EXIF block with one entry, the orientation.
fn exif(orientation: u8) -> Vec<u8> {
    let mut block = b"MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0".to_vec();
    block.extend_from_slice(&[orientation, 0, 0, 0, 0, 0, 0]);
    block
}

/// Where a stored pixel lies in the upright picture, by column and row.
type Place = fn(usize, usize) -> (usize, usize);

#[test]
fn all_orientations_are_applied_in_every_format_that_has_exif() {
    let upright = Image::from_fn(Size::new(3, 2).unwrap(), |col, row| {
        Srgb([100 * col as u8, 100 * row as u8, 0])
    });
    // the stored picture, by where its pixel (col, row) lies in the upright one of 3 x 2
    let place: [Place; 8] = [
        |c, r| (c, r),
        |c, r| (2 - c, r),
        |c, r| (2 - c, 1 - r),
        |c, r| (c, 1 - r),
        |c, r| (r, c),
        |c, r| (2 - r, c),
        |c, r| (2 - r, 1 - c),
        |c, r| (r, 1 - c),
    ];
    for orientation in 1..=8u8 {
        let size = if orientation < 5 {
            upright.size()
        } else {
            upright.size().transposed()
        };
        let stored = Image::from_fn(size, |col, row| {
            upright[place[orientation as usize - 1](col, row)]
        });
        let (width, height) = (size.width() as u32, size.height() as u32);
        let bytes: Vec<u8> = stored.pixels().iter().flat_map(|p| p.0).collect();
        let mut png = Vec::new();
        let mut encoder = image::codecs::png::PngEncoder::new(&mut png);
        encoder.set_exif_metadata(exif(orientation)).unwrap();
        encoder
            .write_image(&bytes, width, height, ExtendedColorType::Rgb8)
            .unwrap();
        let mut webp = Vec::new();
        let mut encoder = image::codecs::webp::WebPEncoder::new_lossless(&mut webp);
        encoder.set_exif_metadata(exif(orientation)).unwrap();
        encoder
            .write_image(&bytes, width, height, ExtendedColorType::Rgb8)
            .unwrap();
        for data in [png, webp] {
            let probe = probe_data(Cursor::new(&data), &Limits::default()).unwrap();
            assert_eq!(
                (probe.orientation, probe.size),
                (orientation, upright.size())
            );
            let picture = decoded(&data);
            assert_eq!(
                picture.image,
                upright.clone().into(),
                "orientation {orientation}"
            );
            assert_eq!(picture.origin.exif.as_deref(), Some(&exif(1)[..]));
            // written upright, with the block, and not turned again
            for format in [Format::Png, Format::Jpeg, Format::WebP] {
                let again = decoded(&encoded(&picture, format));
                assert_eq!(again.origin.exif, picture.origin.exif, "{format}");
                assert_eq!(again.image.size(), upright.size());
            }
        }
    }
}

#[test]
fn a_block_that_cannot_be_stored_is_left_out_with_a_warning() {
    let mut picture = Picture::from_image(Image::new(size(), Srgb([7u8; 3])));
    picture.origin.exif = Some(exif(1).into());
    let options = WriteOptions::default();
    let warnings = encode(Cursor::new(Vec::new()), Format::Bmp, &picture, &options).unwrap();
    assert_eq!(
        warnings,
        [Warning::ExifDropped {
            format: Format::Bmp
        }]
    );
    let mut long = exif(1);
    long.resize(70_000, 0);
    picture.origin.exif = Some(long.into());
    let warnings = encode(Cursor::new(Vec::new()), Format::Jpeg, &picture, &options).unwrap();
    assert_eq!(
        warnings,
        [Warning::ExifDropped {
            format: Format::Jpeg
        }]
    );
}

#[test]
fn floats_that_are_not_finite_are_replaced_with_a_warning() {
    let image = Image::from_fn(size(), |col, _| match col {
        0 => LinearRgb([f32::NAN, 1.0, 2.0]),
        1 => LinearRgb([f32::INFINITY, f32::NEG_INFINITY, 2.0]),
        _ => LinearRgb([0.5; 3]),
    });
    for format in [Format::OpenExr, Format::Tiff] {
        let data = encoded(&Picture::from_image(image.clone()), format);
        let picture = decode(Cursor::new(data), &Limits::default()).unwrap();
        let count = size().height() as u64;
        let expected = Warning::NotFinite {
            nan: count,
            infinite: 2 * count,
        };
        assert_eq!(picture.warnings, [expected]);
        let pixels = picture.convert::<LinearRgb>();
        assert_eq!(pixels[(0, 0)], LinearRgb([0.0, 1.0, 2.0]));
        assert_eq!(pixels[(1, 0)], LinearRgb([1e30, -1e30, 2.0]));
    }
}

#[test]
fn files_are_written_by_extension_and_read_by_content() {
    let folder = tempfile::tempdir().unwrap();
    let picture = &pictures()[0];
    let options = WriteOptions::default();
    let path = folder.path().join("a.png");
    assert_eq!(write(&path, picture, &options).unwrap(), []);
    assert_eq!(
        write(&path, picture, &options).unwrap(),
        [],
        "over an existing file"
    );
    let liar = folder.path().join("b.jpg");
    std::fs::rename(&path, &liar).unwrap();
    let back = read(&liar, &Limits::default()).unwrap();
    assert_eq!(
        (&back.image, back.origin.format),
        (&picture.image, Some(Format::Png))
    );

    let forced = WriteOptions {
        format: Some(Format::Bmp),
        ..options
    };
    let odd = folder.path().join("picture.of.mine");
    write(&odd, picture, &forced).unwrap();
    assert_eq!(
        read(&odd, &Limits::default()).unwrap().origin.format,
        Some(Format::Bmp)
    );
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2);
}

#[test]
fn failed_writes_say_why_and_leave_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let sentence = |name: &str, picture: &Picture, options: &WriteOptions| {
        let error = write(folder.path().join(name), picture, options).unwrap_err();
        assert!(error.to_string().contains(name), "{error}");
        error.cause.to_string()
    };
    let options = WriteOptions::default();
    let small = &pictures()[0];
    let wide = Picture::from_image(Image::new(Size::new(70_000, 1).unwrap(), Srgb([1u8; 3])));
    assert_eq!(
        sentence("a.gif", small, &options),
        "its extension does not name a picture format; known are .png, .jpg, .jpeg, .webp, .tif, .tiff, .bmp, .exr, .hdr"
    );
    assert_eq!(
        sentence("a", small, &options),
        EncodeError::UnknownExtension.to_string()
    );
    assert_eq!(
        sentence("a.jpg", &wide, &options),
        "a JPEG file can have at most 65535 pixels on a side, the picture has 70000 x 1"
    );
    let bad = WriteOptions {
        quality: 0,
        ..options.clone()
    };
    assert_eq!(
        sentence("a.jpg", small, &bad),
        "JPEG quality is 1 to 100, not 0"
    );
    assert!(write(folder.path().join("no/a.png"), small, &options).is_err());
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn unreadable_files_say_why() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.png");
    let sentence = |content: &[u8]| {
        write_atomically(&path, |file| file.write_all(content)).unwrap();
        let error = read(&path, &Limits::default()).unwrap_err();
        error
            .to_string()
            .strip_prefix(&format!("{}: ", path.display()))
            .unwrap()
            .to_owned()
    };
    let known = "known are PNG, JPEG, WebP, TIFF, BMP, OpenEXR, Radiance HDR";
    assert_eq!(sentence(b""), "the file is empty");
    assert_eq!(
        sentence(b"hello"),
        format!("not a picture in a known format; {known}")
    );
    assert_eq!(
        sentence(b"GIF89a......"),
        format!("not a picture in a known format (it looks like GIF); {known}")
    );
    let png = encoded(&pictures()[0], Format::Png);
    assert!(sentence(&png[..60]).starts_with("the PNG data is damaged: "));
    let missing = read(folder.path().join("none.png"), &Limits::default()).unwrap_err();
    assert!(matches!(missing.cause, DecodeError::Io(_)));
    assert!(read(folder.path(), &Limits::default()).is_err(), "a folder");
}

#[test]
fn a_jpeg_that_ends_early_is_read_with_a_warning() {
    let data = encoded(&pictures()[0], Format::Jpeg);
    let picture = decode(Cursor::new(&data[..data.len() - 20]), &Limits::default()).unwrap();
    assert_eq!(picture.warnings, [Warning::Truncated]);
}

#[test]
fn equal_pictures_make_equal_files() {
    for format in Format::ALL {
        let options = WriteOptions {
            profile: ProfileChoice::Srgb,
            ..WriteOptions::default()
        };
        let once = |picture: &Picture| {
            let mut data = Cursor::new(Vec::new());
            encode(&mut data, format, picture, &options).unwrap();
            data.into_inner()
        };
        for picture in &pictures() {
            assert_eq!(once(picture), once(picture), "{format}");
        }
    }
}

//! Pictures as our own encoders write them, and JPEG and OpenEXR in the ways that they do not.

use super::Seed;
use exr::prelude::{
    Blocks, Compression, Encoding, Image as ExrImage, LineOrder, SpecificChannels, Vec2,
    WritableImage as _, f16,
};
use jpeg_encoder::{ColorType, Encoder, SamplingFactor};
use ravec::raster::{Image, LinearRgb, LinearRgba, Size, Srgb, Srgba};
use ravec_media::{Format, Picture, WriteOptions, encode};
use std::io::Cursor;

/// An EXIF block with an orientation and a time.
pub fn exif(orientation: u8) -> Vec<u8> {
    let mut block = b"II*\0\x08\0\0\0\x02\0".to_vec();
    block.extend([0x12, 1, 3, 0, 1, 0, 0, 0, orientation, 0, 0, 0]);
    block.extend([0x32, 1, 2, 0, 20, 0, 0, 0, 38, 0, 0, 0]);
    block.extend([0; 4]);
    block.extend(b"2024:05:06 07:08:09\0");
    block
}

fn pictures() -> Vec<(&'static str, Picture)> {
    let size = Size::new(11, 7).expect("not empty");
    let at = |col: usize, row: usize| (col * 19 + row * 7) as u8;
    let gray = |gray: bool, mut picture: Picture| {
        picture.origin.gray = gray;
        picture
    };
    let mut turned =
        Picture::from_image(Image::from_fn(size, |c, r| Srgb([at(c, r), at(r, c), 7])));
    turned.origin.exif = Some(exif(6).into());
    vec![
        (
            "gray",
            gray(
                true,
                Picture::from_image(Image::from_fn(size, |c, r| Srgb([at(c, r); 3]))),
            ),
        ),
        ("turned", turned),
        (
            "alpha",
            Picture::from_image(Image::from_fn(size, |c, r| {
                Srgba([at(c, r), 9, 7, at(r, c)])
            })),
        ),
        (
            "deep",
            Picture::from_image(Image::from_fn(size, |c, r| {
                Srgb([256 * u16::from(at(c, r)); 3])
            })),
        ),
        (
            "float",
            Picture::from_image(Image::from_fn(size, |c, r| {
                LinearRgb([f32::from(at(c, r)) / 64.0; 3])
            })),
        ),
        (
            "float-alpha",
            Picture::from_image(Image::from_fn(size, |c, r| {
                LinearRgba([0.5, 2.0, f32::from(at(c, r)), 0.5])
            })),
        ),
    ]
}

const TARGETS: [(Format, &str); 7] = [
    (Format::Png, "png"),
    (Format::Jpeg, "jpeg"),
    (Format::WebP, "webp"),
    (Format::Tiff, "tiff"),
    (Format::Bmp, "bmp"),
    (Format::OpenExr, "exr"),
    (Format::Hdr, "hdr"),
];

pub fn seeds() -> Vec<Seed> {
    let mut seeds = Vec::new();
    for (format, target) in TARGETS {
        for (name, picture) in pictures() {
            let mut data = Cursor::new(Vec::new());
            encode(&mut data, format, &picture, &WriteOptions::default())
                .expect("every format takes these");
            seeds.push((target, name.to_owned(), data.into_inner()));
        }
    }
    seeds.extend(jpegs());
    seeds.extend(exrs());
    seeds
}

fn jpegs() -> Vec<Seed> {
    let (width, height) = (19_u16, 17_u16);
    let samples = |channels: usize| -> Vec<u8> {
        let count = usize::from(width) * usize::from(height) * channels;
        (0..count).map(|i| (i * 11 % 251) as u8).collect()
    };
    let mut seeds = Vec::new();
    for (name, color, channels, sampling, progressive, restart) in [
        (
            "cmyk",
            ColorType::Cmyk,
            4,
            SamplingFactor::F_1_1,
            false,
            None,
        ),
        (
            "ycck",
            ColorType::CmykAsYcck,
            4,
            SamplingFactor::F_1_1,
            false,
            None,
        ),
        (
            "quarter",
            ColorType::Rgb,
            3,
            SamplingFactor::F_2_2,
            false,
            None,
        ),
        (
            "half",
            ColorType::Rgb,
            3,
            SamplingFactor::F_2_1,
            false,
            Some(2),
        ),
        (
            "progressive",
            ColorType::Rgb,
            3,
            SamplingFactor::F_2_2,
            true,
            None,
        ),
        (
            "progressive-cmyk",
            ColorType::Cmyk,
            4,
            SamplingFactor::F_1_1,
            true,
            None,
        ),
        (
            "luma",
            ColorType::Luma,
            1,
            SamplingFactor::F_1_1,
            true,
            Some(1),
        ),
    ] {
        let mut data = Vec::new();
        let mut encoder = Encoder::new(&mut data, 60);
        encoder.set_sampling_factor(sampling);
        encoder.set_progressive(progressive);
        // with one channel its tables of progressive files lack codes
        encoder.set_optimized_huffman_tables(!progressive);
        if let Some(interval) = restart {
            encoder.set_restart_interval(interval);
        }
        let block = [b"Exif\0\0".to_vec(), exif(3)].concat();
        encoder.add_app_segment(1, block).expect("a short block");
        encoder
            .encode(&samples(channels), width, height, color)
            .expect("a small picture");
        seeds.push(("jpeg", name.to_owned(), data));
    }
    seeds
}

fn exrs() -> Vec<Seed> {
    let mut seeds = Vec::new();
    for (name, compression) in [
        ("none", Compression::Uncompressed),
        ("rle", Compression::RLE),
        ("zip1", Compression::ZIP1),
        ("piz", Compression::PIZ),
        ("pxr24", Compression::PXR24),
        ("b44", Compression::B44),
    ] {
        for tiled in [false, true] {
            let encoding = Encoding {
                compression,
                blocks: if tiled {
                    Blocks::Tiles(Vec2(8, 8))
                } else {
                    Blocks::ScanLines
                },
                line_order: LineOrder::Increasing,
            };
            let pixel = |Vec2(x, y): Vec2<usize>| {
                let value = |v: usize| f16::from_f32(v as f32 / 7.0);
                (value(x), value(y), value(x * y), value(3))
            };
            let channels = SpecificChannels::rgba(pixel);
            let image = ExrImage::from_encoded_channels((13, 9), encoding, channels);
            let mut data = Cursor::new(Vec::new());
            image
                .write()
                .non_parallel()
                .to_buffered(&mut data)
                .expect("memory takes any picture");
            let blocks = if tiled { "tiles" } else { "lines" };
            seeds.push(("exr", format!("{name}-{blocks}"), data.into_inner()));
        }
    }
    seeds
}

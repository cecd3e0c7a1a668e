//! Files that are put together byte by byte, because no encoder at hand writes them.

use super::Seed;
use super::pictures::exif;
use flate2::Compression;
use flate2::write::ZlibEncoder;
use std::io::Write as _;

fn deflated(data: &[u8]) -> Vec<u8> {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::best());
    encoder.write_all(data).expect("memory takes any data");
    encoder.finish().expect("memory takes any data")
}

fn bytes(count: usize) -> Vec<u8> {
    (0..count).map(|i| (i * 37 % 253) as u8).collect()
}

pub fn seeds() -> Vec<Seed> {
    let mut seeds = pngs();
    seeds.extend(tiffs());
    seeds.extend(bmps());
    seeds.extend(webps());
    let plain = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=2\n\n-Y 4 +X 5\n".to_vec();
    seeds.push(("hdr", "plain".into(), [plain, bytes(80)].concat()));
    let row = |v: u8| [vec![2, 2, 0, 9], [132, v, 5, 1, 2, 3, 4, 5].repeat(4)].concat();
    let runs = b"#?RGBE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 9\n".to_vec();
    seeds.push(("hdr", "runs".into(), [runs, row(7), row(130)].concat()));
    seeds
}

fn pngs() -> Vec<Seed> {
    let (width, height) = (9_usize, 6_usize);
    let mut seeds = Vec::new();
    for (color, depths, channels) in [
        (0_u8, &[1_u8, 2, 4, 8, 16][..], 1),
        (2, &[8, 16], 3),
        (3, &[1, 2, 4, 8], 1),
        (4, &[8, 16], 2),
        (6, &[8, 16], 4),
    ] {
        for &depth in depths {
            for interlaced in [false, true] {
                let header = [
                    &(width as u32).to_be_bytes()[..],
                    &(height as u32).to_be_bytes(),
                    &[depth, color, 0, 0, u8::from(interlaced)],
                ];
                let passes: &[[usize; 4]] = if interlaced {
                    &[
                        [0, 0, 8, 8],
                        [4, 0, 8, 8],
                        [0, 4, 4, 8],
                        [2, 0, 4, 4],
                        [0, 2, 2, 4],
                        [1, 0, 2, 2],
                        [0, 1, 1, 2],
                    ]
                } else {
                    &[[0, 0, 1, 1]]
                };
                let mut raw = Vec::new();
                for &[left, top, across, down] in passes {
                    let columns = width.saturating_sub(left).div_ceil(across);
                    let rows = height.saturating_sub(top).div_ceil(down);
                    if columns == 0 {
                        continue;
                    }
                    for row in 0..rows {
                        raw.push((row % 5) as u8);
                        raw.extend(bytes((columns * channels * usize::from(depth)).div_ceil(8)));
                    }
                }
                let mut file = b"\x89PNG\r\n\x1a\n".to_vec();
                let mut put = |kind: &[u8; 4], data: &[u8]| {
                    file.extend((data.len() as u32).to_be_bytes());
                    file.extend(kind);
                    file.extend(data);
                    let sum = crc32fast::hash(&[kind, data].concat());
                    file.extend(sum.to_be_bytes());
                };
                put(b"IHDR", &header.concat());
                put(b"gAMA", &45455_u32.to_be_bytes());
                if color == 3 {
                    put(b"PLTE", &bytes(3 << depth));
                    put(b"tRNS", &bytes(1 << (depth - 1)));
                } else if color < 3 {
                    put(b"tRNS", &bytes(2 * channels));
                }
                put(b"eXIf", &exif(8));
                put(b"IDAT", &deflated(&raw));
                put(b"IEND", b"");
                let way = if interlaced { "interlaced" } else { "plain" };
                seeds.push(("png", format!("color{color}-{depth}-{way}"), file));
            }
        }
    }
    seeds
}

/// A TIFF file with one directory.
struct Tiff {
    entries: Vec<(u16, Vec<u32>)>,
    blocks: Vec<Vec<u8>>,
    tiled: bool,
}

impl Tiff {
    fn file(&self) -> Vec<u8> {
        let mut file = b"II*\0\0\0\0\0".to_vec();
        let mut offsets = Vec::new();
        for block in &self.blocks {
            offsets.push(file.len() as u32);
            file.extend(block);
            file.resize(file.len().next_multiple_of(4), 0);
        }
        let lengths = self.blocks.iter().map(|block| block.len() as u32).collect();
        let mut entries = self.entries.clone();
        entries.push((if self.tiled { 324 } else { 273 }, offsets));
        entries.push((if self.tiled { 325 } else { 279 }, lengths));
        entries.sort_by_key(|entry| entry.0);
        let mut directory = (entries.len() as u16).to_le_bytes().to_vec();
        for (tag, values) in &entries {
            // offsets and lengths are 32-bit numbers, all others 16-bit ones
            let is_long = matches!(tag, 273 | 279 | 324 | 325);
            let mut bytes: Vec<u8> = Vec::new();
            for value in values {
                let number = value.to_le_bytes();
                bytes.extend(if is_long { &number[..] } else { &number[..2] });
            }
            if bytes.len() > 4 {
                let at = file.len() as u32;
                file.extend(&bytes);
                bytes = at.to_le_bytes().to_vec();
            }
            bytes.resize(4, 0);
            directory.extend(tag.to_le_bytes());
            directory.extend(if is_long { 4_u16 } else { 3 }.to_le_bytes());
            directory.extend((values.len() as u32).to_le_bytes());
            directory.extend(bytes);
        }
        directory.extend([0; 4]);
        let at = (file.len() as u32).to_le_bytes();
        file[4..8].copy_from_slice(&at);
        file.extend(directory);
        file
    }
}

fn tiffs() -> Vec<Seed> {
    let side = 16_usize;
    let mut seeds = Vec::new();
    // name, photometric, bits, channels, planar
    for (name, kind, bits, channels, planar) in [
        ("gray", 1_u32, 8_u32, 1_usize, false),
        ("bits", 0, 1, 1, false),
        ("rgb", 2, 8, 3, false),
        ("rgb-planar", 2, 8, 3, true),
        ("deep", 2, 16, 3, false),
        ("alpha", 2, 8, 4, false),
        ("cmyk", 5, 8, 4, false),
        ("float", 1, 32, 1, false),
    ] {
        for (way, tiled, compression) in [
            ("strips", false, 1_u32),
            ("tiles", true, 1),
            ("deflate", false, 8),
            ("deflate-tiles", true, 8),
        ] {
            let planes = if planar { channels } else { 1 };
            let in_plane = channels / planes;
            let block_rows = if tiled { side } else { side / 2 };
            let row_bytes = (side * in_plane * bits as usize).div_ceil(8);
            let mut blocks = Vec::new();
            for _ in 0..planes * side / block_rows {
                let mut raw = bytes(row_bytes * block_rows);
                if name == "float" {
                    raw = (0..side * block_rows)
                        .flat_map(|i| (i as f32 / 9.0).to_le_bytes())
                        .collect();
                }
                blocks.push(if compression == 8 {
                    deflated(&raw)
                } else {
                    raw
                });
            }
            let mut entries = vec![
                (256, vec![side as u32]),
                (257, vec![side as u32]),
                (258, vec![bits; channels]),
                (259, vec![compression]),
                (262, vec![kind]),
                (274, vec![5]),
                (277, vec![channels as u32]),
                (284, vec![if planar { 2 } else { 1 }]),
            ];
            if tiled {
                entries.extend([(322, vec![side as u32]), (323, vec![side as u32])]);
            } else {
                entries.push((278, vec![block_rows as u32]));
            }
            match name {
                "alpha" => entries.push((338, vec![2])),
                "float" => entries.push((339, vec![3])),
                _ => {}
            }
            let file = Tiff {
                entries,
                blocks,
                tiled,
            }
            .file();
            seeds.push(("tiff", format!("{name}-{way}"), file));
        }
    }
    seeds.push(("tiff", "fax".into(), fax()));
    seeds
}

/// White lines in the code of faxes (group 4): each is the same as the one above, one bit.
fn fax() -> Vec<u8> {
    let entries = [
        (256, 16),
        (257, 16),
        (258, 1),
        (259, 4),
        (262, 0),
        (277, 1),
        (278, 16),
    ];
    let entries = entries.map(|(tag, value)| (tag, vec![value])).to_vec();
    let blocks = vec![vec![0xff, 0xff, 0, 0x10, 0x01, 0, 0x10, 0x01]];
    Tiff {
        entries,
        blocks,
        tiled: false,
    }
    .file()
}

fn bmps() -> Vec<Seed> {
    let (width, height) = (9_u32, 5_u32);
    let file = |bits: u16, compression: u32, colors: &[u8], pixels: &[u8]| {
        let header = if compression == 3 { 56 } else { 40 };
        let masks = if compression == 3 { 16 } else { 0 };
        let start = 14 + 40 + masks + colors.len();
        let mut file = b"BM".to_vec();
        file.extend(((start + pixels.len()) as u32).to_le_bytes());
        file.extend([0; 4]);
        file.extend((start as u32).to_le_bytes());
        file.extend((header as u32).to_le_bytes());
        file.extend(width.to_le_bytes());
        file.extend(height.to_le_bytes());
        file.extend([1, 0]);
        file.extend(bits.to_le_bytes());
        file.extend(compression.to_le_bytes());
        file.extend([0; 20]);
        if compression == 3 {
            for mask in [0x7c00_u32, 0x3e0, 0x1f, 0x8000] {
                file.extend(mask.to_le_bytes());
            }
        }
        file.extend(colors);
        file.extend(pixels);
        file
    };
    let plain = |bits: usize| bytes((width as usize * bits).div_ceil(32) * 4 * height as usize);
    let palette = |colors: usize| bytes(4 * colors);
    let runs = [
        [9_u8, 1, 0, 0].repeat(4),
        vec![0, 3, 1, 2, 3, 0, 0, 2, 1, 0, 0, 1],
    ]
    .concat();
    [
        ("1", file(1, 0, &palette(2), &plain(1))),
        ("4", file(4, 0, &palette(16), &plain(4))),
        ("8", file(8, 0, &palette(256), &plain(8))),
        ("16", file(16, 0, &[], &plain(16))),
        ("16-masks", file(16, 3, &[], &plain(16))),
        ("24", file(24, 0, &[], &plain(24))),
        ("32", file(32, 0, &[], &plain(32))),
        ("8-runs", file(8, 1, &palette(256), &runs)),
        ("4-runs", file(4, 2, &palette(16), &runs)),
    ]
    .into_iter()
    .map(|(name, file)| ("bmp", format!("bits{name}"), file))
    .collect()
}

/// The smallest files of each kind: lossy, lossy with alpha, animated.
fn webps() -> Vec<Seed> {
    let lossy: &[u8] = b"RIFF\x22\0\0\0WEBPVP8 \x16\0\0\0\x30\x01\0\x9d\x01\x2a\x01\0\x01\0\x0e\xc0\xfe\x25\xa4\0\x03\x70\0\0\0\0";
    let alpha: &[u8] = b"RIFF\x4a\0\0\0WEBPVP8X\x0a\0\0\0\x10\0\0\0\0\0\0\0\0\0ALPH\x0c\0\0\0\x11\x07\x10\x11\xfd\x0f\x44\x44\xff\x03\0\0\
        VP8 \x18\0\0\0\x14\x01\0\x9d\x01\x2a\x01\0\x01\0\0\0\xfe\0\0\x0d\xc0\0\xfe\xe6\xb5\0\0\0";
    let animated: &[u8] = b"RIFF\x52\0\0\0WEBPVP8X\x0a\0\0\0\x12\0\0\0\0\0\0\0\0\0ANIM\x06\0\0\0\xff\xff\xff\xff\0\0\
        ANMF\x26\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\x64\0\0\0VP8L\x0d\0\0\0\x2f\0\0\0\x10\x07\x10\x11\x11\x88\x88\xfe\x07\0";
    [
        ("lossy", lossy),
        ("lossy-alpha", alpha),
        ("animated", animated),
    ]
    .into_iter()
    .map(|(name, data)| ("webp", name.to_owned(), data.to_vec()))
    .collect()
}

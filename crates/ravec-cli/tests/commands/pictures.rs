//! Picture files byte by byte, so that the program is judged by other code than its own.

/// Color types of PNG.
pub const GREY: u8 = 0;
pub const RGB: u8 = 2;
pub const RGBA: u8 = 6;

/// A bitmap file of 24 bits a pixel, blue first, from the bottom row.
pub fn bmp(width: usize, height: usize, pixel_at: impl Fn(usize, usize) -> [u8; 3]) -> Vec<u8> {
    let row_bytes = (3 * width).next_multiple_of(4);
    let mut file = b"BM".to_vec();
    let long = |file: &mut Vec<u8>, number: usize| file.extend((number as u32).to_le_bytes());
    long(&mut file, 54 + row_bytes * height);
    long(&mut file, 0);
    long(&mut file, 54);
    long(&mut file, 40);
    long(&mut file, width);
    long(&mut file, height);
    file.extend([1, 0, 24, 0]);
    for number in [0, row_bytes * height, 2835, 2835, 0, 0] {
        long(&mut file, number);
    }
    for row in (0..height).rev() {
        for col in 0..width {
            let [r, g, b] = pixel_at(col, row);
            file.extend([b, g, r]);
        }
        file.extend(vec![0; row_bytes - 3 * width]);
    }
    file
}

/// A PNG file without compression: `depth` bits a sample, the samples of all pixels as bytes.
pub fn png(width: u32, height: u32, depth: u8, color: u8, samples: &[u8]) -> Vec<u8> {
    png_of(&[
        (*b"IHDR", png_header(width, height, depth, color)),
        (*b"IDAT", png_data(height, samples)),
        (*b"IEND", Vec::new()),
    ])
}

/// The same with a chunk that says that an animation of two frames follows.
pub fn animated_png(width: u32, height: u32, samples: &[u8]) -> Vec<u8> {
    let frame = |number: u32| {
        let numbers = [number, width, height, 0, 0];
        let mut data: Vec<u8> = numbers.iter().flat_map(|n| n.to_be_bytes()).collect();
        data.extend([0, 1, 0, 10, 0, 0]);
        data
    };
    let second = [&2u32.to_be_bytes()[..], &png_data(height, samples)].concat();
    png_of(&[
        (*b"IHDR", png_header(width, height, 8, RGB)),
        (*b"acTL", [0, 0, 0, 2, 0, 0, 0, 0].to_vec()),
        (*b"fcTL", frame(0)),
        (*b"IDAT", png_data(height, samples)),
        (*b"fcTL", frame(1)),
        (*b"fdAT", second),
        (*b"IEND", Vec::new()),
    ])
}

fn png_header(width: u32, height: u32, depth: u8, color: u8) -> Vec<u8> {
    let mut header = [width.to_be_bytes(), height.to_be_bytes()].concat();
    header.extend([depth, color, 0, 0, 0]);
    header
}

/// Rows without a filter in a zlib stream of stored blocks.
fn png_data(height: u32, samples: &[u8]) -> Vec<u8> {
    let row_bytes = samples.len() / height.max(1) as usize;
    let rows: Vec<u8> = samples
        .chunks(row_bytes.max(1))
        .flat_map(|row| std::iter::once(0).chain(row.iter().copied()))
        .collect();
    let mut data = vec![0x78, 0x01];
    let blocks = rows.chunks(0xffff);
    let last = blocks.len().saturating_sub(1);
    for (i, block) in blocks.enumerate() {
        let length = block.len() as u16;
        data.push(u8::from(i == last));
        data.extend(length.to_le_bytes());
        data.extend((!length).to_le_bytes());
        data.extend(block);
    }
    let (mut a, mut b) = (1u32, 0u32);
    for &byte in &rows {
        a = (a + u32::from(byte)) % 65_521;
        b = (b + a) % 65_521;
    }
    data.extend((b << 16 | a).to_be_bytes());
    data
}

fn png_of(chunks: &[([u8; 4], Vec<u8>)]) -> Vec<u8> {
    let mut file = b"\x89PNG\r\n\x1a\n".to_vec();
    for (kind, data) in chunks {
        file.extend((data.len() as u32).to_be_bytes());
        let checked = [&kind[..], data].concat();
        file.extend(&checked);
        file.extend(crc(&checked).to_be_bytes());
    }
    file
}

/// The checksum of PNG, bit by bit.
fn crc(data: &[u8]) -> u32 {
    let mut crc = u32::MAX;
    for &byte in data {
        crc ^= u32::from(byte);
        for _ in 0..8 {
            crc = (crc >> 1) ^ (0xedb8_8320 & (crc & 1).wrapping_neg());
        }
    }
    !crc
}

/// A TIFF file of one strip without compression. `format` is 1 for integers and 3 for floats, `photometric` 2 for RGB and 5
/// for amounts of ink.
pub fn tiff(
    [width, height]: [u32; 2],
    [channels, bits, format, photometric]: [u16; 4],
    data: &[u8],
) -> Vec<u8> {
    let entries = 10u16;
    let lists = 8 + 2 + 12 * u32::from(entries) + 4;
    let strip = lists + 4 * u32::from(channels);
    let mut file = b"II*\0\x08\0\0\0".to_vec();
    file.extend(entries.to_le_bytes());
    for (tag, kind, count, value) in [
        (256u16, 4u16, 1, width),
        (257, 4, 1, height),
        (258, 3, channels.into(), lists),
        (259, 3, 1, 1),
        (262, 3, 1, photometric.into()),
        (273, 4, 1, strip),
        (277, 3, 1, channels.into()),
        (278, 4, 1, height),
        (279, 4, 1, data.len() as u32),
        (339, 3, channels.into(), lists + 2 * u32::from(channels)),
    ] {
        file.extend(tag.to_le_bytes());
        file.extend(kind.to_le_bytes());
        for number in [count, value] {
            file.extend(u32::to_le_bytes(number));
        }
    }
    file.extend([0; 4]);
    for number in [bits, format] {
        file.extend(number.to_le_bytes().repeat(channels.into()));
    }
    file.extend(data);
    file
}

/// Columns and rows by the header of a PNG file.
#[track_caller]
pub fn png_size(file: &[u8]) -> (u32, u32) {
    assert!(file.starts_with(b"\x89PNG\r\n\x1a\n"), "not a PNG file");
    let number = |at: usize| u32::from_be_bytes(file[at..at + 4].try_into().unwrap());
    (number(16), number(20))
}

/// Bits a sample and the color type by the header of a PNG file.
pub fn png_kind(file: &[u8]) -> (u8, u8) {
    (file[24], file[25])
}

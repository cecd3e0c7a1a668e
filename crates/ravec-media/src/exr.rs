//! `OpenEXR`: the part of the plane that has data, checked before the decoder takes memory for it.
//!
//! A picture is as large as its display window, but lines and tiles are decompressed in the width of its data window, which a
//! header may make as large as it likes.

use std::io::{self, BufRead, Read as _, Seek, SeekFrom};

/// The size of the largest part of a file, as its headers declare it.
#[derive(Debug, Default, PartialEq, Eq)]
pub(crate) struct Claims {
    /// Columns of the data window.
    pub(crate) width: u64,
    /// Rows of the data window.
    pub(crate) height: u64,
    /// The most bytes of a block of lines or of a tile, before compression.
    pub(crate) block_bytes: u64,
    /// Names of the channels of all parts, as far as they can be understood.
    pub(crate) channels: Vec<String>,
    /// True if some part has the channels R, G and B, or its channels cannot be understood.
    pub(crate) has_colors: bool,
    /// True if a part states primaries that are not those of sRGB.
    pub(crate) other_primaries: bool,
}

/// Primaries and white of sRGB, and the difference that nobody sees.
const SRGB_PRIMARIES: [f32; 8] = [0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329];
const TOLERANCE: f32 = 0.002;

/// The names in a list of channels: each ends with a zero, and 16 bytes follow it. `None` if the list is not understood.
fn channel_names(mut list: &[u8]) -> Option<Vec<String>> {
    let mut names = Vec::new();
    while list.first().is_some_and(|&byte| byte != 0) {
        let end = list.iter().position(|&byte| byte == 0)?;
        names.push(String::from_utf8(list[..end].to_vec()).ok()?);
        list = list.get(end + 17..)?;
    }
    Some(names)
}

/// No kind of compression takes more lines at once.
const MAX_LINES: u64 = 256;

/// Names and types of attributes have at most this many bytes.
const MAX_NAME: u64 = 255;

/// Lists of channels that are examined have at most this many bytes; longer ones count as this long.
const MAX_CHANNELS: u64 = 1 << 16;

/// Reads all headers, as far as they can be understood, and goes back to the start.
pub(crate) fn claims<R: BufRead + Seek>(input: &mut R) -> io::Result<Claims> {
    let mut claims = Claims::default();
    input.seek(SeekFrom::Start(8))?;
    // an empty name ends a header; a file of one part has one header, and others end with an empty one
    while let Some(part) = header(input)? {
        claims.width = claims.width.max(part.width);
        claims.height = claims.height.max(part.height);
        claims.block_bytes = claims.block_bytes.max(part.block_bytes);
        claims.has_colors |= part.has_colors;
        claims.other_primaries |= part.other_primaries;
        claims.channels.extend(part.channels);
    }
    input.seek(SeekFrom::Start(0))?;
    Ok(claims)
}

/// One header; `None` if the attribute is missing or its value is invalid.
fn header<R: BufRead + Seek>(input: &mut R) -> io::Result<Option<Claims>> {
    let mut part = Claims::default();
    let (mut pixel_bytes, mut tile) = (4, 0);
    let mut is_empty = true;
    while input.fill_buf()?.first().is_some_and(|&byte| byte != 0) {
        let (Some(name), Some(_kind)) = (word(input)?, word(input)?) else {
            break;
        };
        let mut size = [0; 4];
        if input.read_exact(&mut size).is_err() {
            break;
        }
        let size = u64::from(u32::from_le_bytes(size));
        is_empty = false;
        let start = input.stream_position()?;
        let mut value = Vec::new();
        if matches!(
            name.as_slice(),
            b"dataWindow" | b"tiles" | b"channels" | b"chromaticities"
        ) {
            input
                .by_ref()
                .take(size.min(MAX_CHANNELS))
                .read_to_end(&mut value)?;
        }
        let number = |at: usize| {
            let bytes = value
                .get(at..at + 4)
                .and_then(|bytes| bytes.try_into().ok());
            bytes.map_or(0, i32::from_le_bytes)
        };
        match name.as_slice() {
            b"dataWindow" => {
                let side = |low: usize, high: usize| {
                    let side = i64::from(number(high)) - i64::from(number(low)) + 1;
                    // the decoder takes a window that is inside out for a large one
                    side.unsigned_abs()
                };
                (part.width, part.height) = (side(0, 8), side(4, 12));
            }
            b"tiles" => tile = u64::from(number(0) as u32) * u64::from(number(4) as u32),
            // a channel has a name of at least one byte and 17 bytes more, and at most four bytes a pixel
            b"channels" => {
                pixel_bytes = 4 * (size / 18).max(1);
                let names = channel_names(&value).unwrap_or_default();
                let has = |name: &str| names.iter().any(|found| found == name);
                part.has_colors = names.is_empty() || (has("R") && has("G") && has("B"));
                part.channels = names;
            }
            b"chromaticities" => {
                let stated = value.as_chunks::<4>().0.iter();
                part.other_primaries = value.len() == 32
                    && stated
                        .zip(SRGB_PRIMARIES)
                        .any(|(bytes, srgb)| (f32::from_le_bytes(*bytes) - srgb).abs() > TOLERANCE);
            }
            _ => {}
        }
        input.seek(SeekFrom::Start(start + size))?;
    }
    if input.fill_buf()?.first() == Some(&0) {
        input.consume(1);
    }
    let lines = part.width.saturating_mul(part.height.min(MAX_LINES));
    // the decoder takes as much for compressed bytes as a whole tile has, also where the picture is smaller
    part.block_bytes = lines.max(tile).saturating_mul(pixel_bytes);
    Ok((!is_empty).then_some(part))
}

/// Bytes before a zero; none if they are too many, or the file ends. The first byte is one of them even if it is zero, as it
/// is for the decoder.
fn word<R: BufRead>(input: &mut R) -> io::Result<Option<Vec<u8>>> {
    let mut word = vec![0];
    if input.read_exact(&mut word).is_err() {
        return Ok(None);
    }
    input.take(MAX_NAME).read_until(0, &mut word)?;
    Ok((word.len() > 1 && word.pop() == Some(0)).then_some(word))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Cursor;

    fn file(parts: &[&[(&[u8], &[u8])]]) -> Vec<u8> {
        let mut file = b"\x76\x2f\x31\x01\x02\0\0\0".to_vec();
        for part in parts {
            for (name, value) in *part {
                file.extend(*name);
                file.extend(b"\0type\0");
                file.extend((value.len() as u32).to_le_bytes());
                file.extend(*value);
            }
            file.push(0);
        }
        file
    }

    fn window(numbers: [i32; 4]) -> Vec<u8> {
        numbers.iter().flat_map(|n| n.to_le_bytes()).collect()
    }

    #[test]
    fn the_largest_data_window_counts_whatever_the_picture_is() {
        let (small, wide) = (window([0, 0, 12, 8]), window([-16_777_216, 0, 12, 8]));
        let channels = [0; 36];
        let parts: [&[(&[u8], &[u8])]; 2] = [
            &[(b"displayWindow", &small), (b"dataWindow", &small)],
            &[(b"channels", &channels), (b"dataWindow", &wide)],
        ];
        let found = claims(&mut Cursor::new(file(&parts))).unwrap();
        let width = 16_777_216 + 13;
        let expected = Claims {
            width,
            height: 9,
            block_bytes: width * 9 * 8,
            has_colors: true,
            ..Claims::default()
        };
        assert_eq!(found, expected);
    }

    #[test]
    fn a_tile_counts_as_a_whole_and_a_name_may_begin_with_a_zero() {
        let small = window([0, 0, 10, 6]);
        let tiles = [[64, 0, 0, 0], [64, 0, 128, 0]].concat();
        let mut whole = file(&[&[(b"dataWindow", &small), (b"tiles", &tiles)]]);
        let expected = Claims {
            width: 11,
            height: 7,
            block_bytes: 64 * ((128 << 16) + 64) * 4,
            ..Claims::default()
        };
        assert_eq!(claims(&mut Cursor::new(&whole)).unwrap(), expected);
        // an attribute with a type of one zero, which the decoder reads
        whole.splice(8..8, *b"a\0\0\0\0\0\0\0");
        assert_eq!(claims(&mut Cursor::new(&whole)).unwrap(), expected);
    }

    #[test]
    fn channels_and_primaries_are_those_of_the_header() {
        let small = window([0, 0, 10, 6]);
        let list = |names: &[&str]| -> Vec<u8> {
            let entries = names
                .iter()
                .map(|name| [name.as_bytes(), &[0; 17]].concat());
            entries.chain([vec![0]]).flatten().collect()
        };
        let of = |names: &[&str], primaries: [f32; 8]| {
            let primaries: Vec<u8> = primaries.iter().flat_map(|v| v.to_le_bytes()).collect();
            let channels = list(names);
            let file = file(&[&[
                (b"channels", &channels),
                (b"chromaticities", &primaries),
                (b"dataWindow", &small),
            ]]);
            claims(&mut Cursor::new(file)).unwrap()
        };
        let found = of(&["A", "B", "G", "R"], SRGB_PRIMARIES);
        assert!(found.has_colors && !found.other_primaries);
        let mut wide = SRGB_PRIMARIES;
        wide[0] = 0.713;
        let found = of(&["Z"], wide);
        assert!(!found.has_colors && found.other_primaries);
        assert_eq!(found.channels, ["Z"]);
        assert!(!of(&["diffuse.B", "diffuse.G", "diffuse.R"], wide).has_colors);
    }

    #[test]
    fn windows_that_are_inside_out_are_large_and_files_may_end_anywhere() {
        let inside_out = window([5, 5, i32::MIN, i32::MIN]);
        let whole = file(&[&[(b"dataWindow", &inside_out), (b"tiles", &[255; 9])]]);
        let found = claims(&mut Cursor::new(&whole)).unwrap();
        assert_eq!((found.width, found.height), (2_147_483_652, 2_147_483_652));
        for length in 8..whole.len() {
            assert!(claims(&mut Cursor::new(&whole[..length])).is_ok());
        }
    }
}

//! Colors that a PNG file states without a profile, which are not applied.
//!
//! Source: Portable Network Graphics Specification (Third Edition), sections 11.3.2.1 (`cHRM`), 11.3.2.2 (`gAMA`).

use std::io::{self, Read, Seek, SeekFrom};

/// The gamma of sRGB as files state it, times 100 000, and the difference that nobody sees.
const SRGB_GAMMA: u32 = 45_455;
const GAMMA_TOLERANCE: u32 = 500;

/// White and primaries of sRGB, times 100 000, and the difference that nobody sees.
const SRGB_PRIMARIES: [u32; 8] = [
    31_270, 32_900, 64_000, 33_000, 30_000, 60_000, 15_000, 6_000,
];
const PRIMARIES_TOLERANCE: u32 = 200;

/// The most chunks before the pixels that are looked at.
const MAX_CHUNKS: usize = 1000;

/// Statement of the file about its colors, if that is something else than sRGB and no profile takes its place. Goes back to the
/// start.
pub(crate) fn other_colors<R: Read + Seek + ?Sized>(input: &mut R) -> io::Result<Option<String>> {
    let mut found = None;
    input.seek(SeekFrom::Start(8))?;
    for _ in 0..MAX_CHUNKS {
        let mut head = [0; 8];
        if input.read_exact(&mut head).is_err() {
            break;
        }
        let [length, kind] = [[0, 1, 2, 3], [4, 5, 6, 7]].map(|at| at.map(|i: usize| head[i]));
        let length = u32::from_be_bytes(length);
        let mut read = i64::from(length) + 4;
        match &kind {
            b"gAMA" | b"cHRM" if length <= 32 => {
                let mut value = [0; 32];
                let value = &mut value[..length as usize];
                if input.read_exact(value).is_err() {
                    break;
                }
                read = 4;
                let numbers: Vec<u32> = value
                    .as_chunks::<4>()
                    .0
                    .iter()
                    .map(|bytes| u32::from_be_bytes(*bytes))
                    .collect();
                found = statement(&numbers).or(found);
            }
            // these come first, whatever else the file says
            b"iCCP" | b"sRGB" | b"cICP" => {
                found = None;
                break;
            }
            b"IDAT" | b"IEND" => break,
            _ => {}
        }
        input.seek(SeekFrom::Current(read))?;
    }
    input.seek(SeekFrom::Start(0))?;
    Ok(found)
}

/// The statement of a chunk in words, unless it is that of sRGB.
fn statement(numbers: &[u32]) -> Option<String> {
    match numbers {
        [gamma] if *gamma > 0 && gamma.abs_diff(SRGB_GAMMA) > GAMMA_TOLERANCE => {
            Some(format!("a gamma of {}", f64::from(*gamma) / 1e5))
        }
        numbers if numbers.len() == 8 => {
            let mut pairs = numbers.iter().zip(SRGB_PRIMARIES);
            let others = pairs.any(|(a, b)| a.abs_diff(b) > PRIMARIES_TOLERANCE);
            others.then(|| "primaries of its own".to_owned())
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Cursor;

    fn found(chunks: &[(&[u8; 4], &[u32])]) -> Option<String> {
        let mut file = b"\x89PNG\r\n\x1a\n".to_vec();
        for (kind, numbers) in chunks {
            file.extend((4 * numbers.len() as u32).to_be_bytes());
            file.extend(*kind);
            file.extend(numbers.iter().flat_map(|number| number.to_be_bytes()));
            file.extend([0; 4]);
        }
        other_colors(&mut Cursor::new(file)).unwrap()
    }

    #[test]
    fn statements_count_unless_they_are_those_of_srgb_or_a_profile_is_there() {
        let header: (&[u8; 4], &[u32]) = (b"IHDR", &[4, 4, 0]);
        assert_eq!(found(&[header, (b"gAMA", &[45_455])]), None);
        let gamma = found(&[header, (b"gAMA", &[100_000])]);
        assert_eq!(gamma.as_deref(), Some("a gamma of 1"));
        assert_eq!(
            found(&[header, (b"gAMA", &[100_000]), (b"sRGB", &[0])]),
            None
        );
        assert_eq!(found(&[header, (b"cHRM", &SRGB_PRIMARIES)]), None);
        let mut wide = SRGB_PRIMARIES;
        wide[2] = 68_000;
        assert!(found(&[header, (b"cHRM", &wide), (b"IDAT", &[])]).is_some());
        assert_eq!(
            found(&[header, (b"IDAT", &[]), (b"gAMA", &[100_000])]),
            None
        );
        assert_eq!(found(&[header, (b"gAMA", &[])]), None);
    }
}

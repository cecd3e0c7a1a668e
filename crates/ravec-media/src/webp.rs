//! WebP: the sizes that its chunks declare, checked before the decoder allocates memory for them.
//!
//! The decoder takes memory for profiles and EXIF blocks by the length in their headers, and for a lossy frame by the size
//! in the frame's header, before it compares them with the file and with the picture.

use std::io::{self, Read, Seek, SeekFrom};

/// Properties that the chunks of a file declare.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct Claims {
    /// `true` if each chunk of metadata ends within the file.
    pub(crate) metadata_is_whole: bool,
    /// `true` if each lossy frame is as large as the picture or smaller.
    pub(crate) frames_fit: bool,
}

/// Bound on the number of chunks, each of which is inspected; a file with more is refused.
const MAX_CHUNKS: usize = 1 << 16;

/// Reads the headers of all chunks of a file of `length` bytes, and goes back to its start.
pub(crate) fn claims<R: Read + Seek>(input: &mut R, length: u64) -> io::Result<Claims> {
    let mut walk = Walk {
        input,
        canvas: None,
        claims: Claims {
            metadata_is_whole: true,
            frames_fit: true,
        },
        left: MAX_CHUNKS,
    };
    walk.chunks(12, length, length)?;
    let claims = walk.claims;
    input.seek(SeekFrom::Start(0))?;
    Ok(claims)
}

struct Walk<'a, R> {
    input: &'a mut R,
    /// Columns and rows of the picture, if a header of its own says so.
    canvas: Option<(u32, u32)>,
    claims: Claims,
    left: usize,
}

impl<R: Read + Seek> Walk<'_, R> {
    /// Looks at the chunks from `at` to `end` in a file of `length` bytes.
    fn chunks(&mut self, mut at: u64, end: u64, length: u64) -> io::Result<()> {
        while at + 8 <= end && self.left > 0 {
            self.left -= 1;
            let [kind @ .., s0, s1, s2, s3] = self.bytes::<8>(at)?;
            let size = u64::from(u32::from_le_bytes([s0, s1, s2, s3]));
            let content = at + 8;
            match &kind {
                b"VP8X" if content + 10 <= length && self.canvas.is_none() => {
                    let [_, _, _, _, w0, w1, w2, h0, h1, h2] = self.bytes::<10>(content)?;
                    let side =
                        |bytes: [u8; 3]| 1 + u32::from_le_bytes([bytes[0], bytes[1], bytes[2], 0]);
                    self.canvas = Some((side([w0, w1, w2]), side([h0, h1, h2])));
                }
                // three bytes of flags, a mark of three, columns and rows of 14 bits
                b"VP8 " if content + 10 <= length => {
                    let [.., w0, w1, h0, h1] = self.bytes::<10>(content)?;
                    let side = |bytes| u32::from(u16::from_le_bytes(bytes) & 0x3fff);
                    let (width, height) = (side([w0, w1]), side([h0, h1]));
                    self.claims.frames_fit &= self
                        .canvas
                        .is_none_or(|canvas| width <= canvas.0 && height <= canvas.1);
                }
                // a frame of an animation: 16 bytes about its place, and chunks
                b"ANMF" => self.chunks(content + 16, (content + size).min(length), length)?,
                b"ICCP" | b"EXIF" | b"XMP " => {
                    self.claims.metadata_is_whole &= content + size <= length;
                }
                _ => {}
            }
            at = content + size.next_multiple_of(2);
        }
        Ok(())
    }

    fn bytes<const N: usize>(&mut self, at: u64) -> io::Result<[u8; N]> {
        let mut bytes = [0; N];
        self.input.seek(SeekFrom::Start(at))?;
        self.input.read_exact(&mut bytes)?;
        Ok(bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Cursor;

    fn file(chunks: &[(&[u8; 4], u32, &[u8])]) -> Vec<u8> {
        let mut file = b"RIFF\0\0\0\0WEBP".to_vec();
        for (kind, size, content) in chunks {
            file.extend(*kind);
            file.extend(size.to_le_bytes());
            file.extend(*content);
        }
        file
    }

    fn claims_of(file: &[u8]) -> (bool, bool) {
        let claims = claims(&mut Cursor::new(file), file.len() as u64).unwrap();
        (claims.metadata_is_whole, claims.frames_fit)
    }

    /// A canvas of 4 × 3 pixels.
    const CANVAS: (&[u8; 4], u32, &[u8]) = (b"VP8X", 10, &[0, 0, 0, 0, 3, 0, 0, 2, 0, 0]);

    #[test]
    fn metadata_must_end_within_the_file() {
        assert_eq!(
            claims_of(&file(&[CANVAS, (b"EXIF", 2, b"ab")])),
            (true, true)
        );
        for kind in [b"EXIF", b"ICCP", b"XMP "] {
            assert_eq!(claims_of(&file(&[CANVAS, (kind, 3, b"ab")])), (false, true));
            assert_eq!(
                claims_of(&file(&[CANVAS, (kind, u32::MAX, b"ab")])),
                (false, true)
            );
        }
    }

    #[test]
    fn lossy_frames_must_fit_into_the_picture_also_in_animations() {
        for (width, height, fits) in [(4, 3, true), (5, 3, false), (4, 4, false)] {
            let frame = [0, 0, 0, 0x9d, 1, 0x2a, width, 0, height, 0];
            assert_eq!(
                claims_of(&file(&[CANVAS, (b"VP8 ", 10, &frame)])),
                (true, fits)
            );
            let inner = [&[0; 16][..], b"VP8 \x0a\0\0\0", &frame].concat();
            assert_eq!(
                claims_of(&file(&[CANVAS, (b"ANMF", 34, &inner)])),
                (true, fits)
            );
            // without a header of its own, the frame is the picture
            assert_eq!(claims_of(&file(&[(b"VP8 ", 10, &frame)])), (true, true));
        }
    }

    #[test]
    fn a_file_cut_anywhere_is_looked_at_to_its_end() {
        let whole = file(&[CANVAS, (b"ANMF", 34, &[0; 34]), (b"EXIF", 2, b"ab")]);
        for length in 12..whole.len() {
            assert!(claims(&mut Cursor::new(&whole[..length]), length as u64).is_ok());
        }
    }
}

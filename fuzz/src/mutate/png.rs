//! PNG: chunks with right lengths and checksums, and pixels under their compression.

use super::{Hand, number};
use flate2::Compression;
use flate2::read::ZlibDecoder;
use flate2::write::ZlibEncoder;
use std::io::{Read as _, Write as _};

const SIGNATURE: &[u8] = b"\x89PNG\r\n\x1a\n";
const KINDS: [&[u8; 4]; 14] = [
    b"IHDR", b"PLTE", b"IDAT", b"IEND", b"tRNS", b"gAMA", b"cHRM", b"sRGB", b"iCCP", b"eXIf",
    b"acTL", b"fcTL", b"fdAT", b"sBIT",
];

/// More than this is not unpacked.
const MAX_UNPACKED: u64 = 1 << 16;

struct Chunk {
    kind: [u8; 4],
    data: Vec<u8>,
}

fn chunks(input: &[u8]) -> Option<Vec<Chunk>> {
    let mut rest = input.strip_prefix(SIGNATURE)?;
    let mut chunks = Vec::new();
    while let Some((head, tail)) = rest.split_first_chunk::<8>() {
        let length = u32::from_be_bytes(head[..4].try_into().ok()?) as usize;
        let length = length.min(tail.len());
        chunks.push(Chunk {
            kind: head[4..].try_into().ok()?,
            data: tail[..length].to_vec(),
        });
        rest = tail.get(length + 4..).unwrap_or_default();
    }
    (!chunks.is_empty()).then_some(chunks)
}

fn file(chunks: &[Chunk]) -> Vec<u8> {
    let mut file = SIGNATURE.to_vec();
    for Chunk { kind, data } in chunks {
        file.extend((data.len() as u32).to_be_bytes());
        let start = file.len();
        file.extend(kind);
        file.extend(data);
        let sum = crc32fast::hash(&file[start..]);
        file.extend(sum.to_be_bytes());
    }
    file
}

/// The same bytes with right checksums, as far as chunks can be recognized.
pub fn repaired(input: &[u8]) -> Option<Vec<u8>> {
    input.strip_prefix(SIGNATURE)?;
    let mut made = input.to_vec();
    let mut at = SIGNATURE.len();
    while let Some(head) = made.get(at..at + 4) {
        let length = u32::from_be_bytes(head.try_into().ok()?) as usize;
        let end = at.checked_add(8)?.checked_add(length)?;
        if end + 4 > made.len() {
            break;
        }
        let sum = crc32fast::hash(&made[at + 4..end]);
        made[end..end + 4].copy_from_slice(&sum.to_be_bytes());
        at = end + 4;
    }
    Some(made)
}

/// Changes one chunk, or the order of chunks.
pub fn mutated(input: &[u8], hand: &mut Hand) -> Option<Vec<u8>> {
    let mut chunks = chunks(input)?;
    let at = hand.dice.below(chunks.len());
    let other = hand.dice.below(chunks.len());
    match hand.dice.below(12) {
        0 => {
            chunks.remove(at);
        }
        1 => {
            let Chunk { kind, data } = &chunks[at];
            let copy = Chunk {
                kind: *kind,
                data: data.clone(),
            };
            chunks.insert(other, copy);
        }
        2 => chunks.swap(at, other),
        3 => chunks[at].kind = **hand.dice.pick(&KINDS),
        4 | 5 => chunks[at].data = number::mutated(&chunks[at].data, hand)?,
        6 => mutate_header(
            chunks.iter_mut().find(|chunk| chunk.kind == *b"IHDR")?,
            hand,
        ),
        7 | 8 => {
            let pixels = chunks
                .iter_mut()
                .find(|chunk| matches!(&chunk.kind, b"IDAT" | b"iCCP"))?;
            repack(&mut pixels.data, hand)?;
        }
        _ => chunks[at].data = hand.changed(&chunks[at].data),
    }
    Some(file(&chunks))
}

/// Another depth, kind of color, interlacing or small size.
fn mutate_header(header: &mut Chunk, hand: &mut Hand) {
    if header.data.len() != 13 {
        return;
    }
    match hand.dice.below(4) {
        0 => header.data[8] = *hand.dice.pick(&[1, 2, 4, 8, 16]),
        1 => header.data[9] = *hand.dice.pick(&[0, 2, 3, 4, 6]),
        2 => header.data[12] ^= 1,
        _ => {
            let at = *hand.dice.pick(&[3, 7]);
            header.data[at] = hand.dice.below(40) as u8;
        }
    }
}

/// Changes what is compressed.
fn repack(data: &mut Vec<u8>, hand: &mut Hand) -> Option<()> {
    let mut content = Vec::new();
    // what comes before an error is taken
    let _ = ZlibDecoder::new(&data[..])
        .take(MAX_UNPACKED)
        .read_to_end(&mut content);
    let content = hand.changed(&content);
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(&content).ok()?;
    *data = encoder.finish().ok()?;
    Some(())
}

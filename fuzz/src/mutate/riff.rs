//! WebP: chunks with right lengths in a RIFF container.

use super::{Hand, number};

const KINDS: [&[u8; 4]; 8] = [
    b"VP8 ", b"VP8L", b"VP8X", b"ALPH", b"ANIM", b"ANMF", b"ICCP", b"EXIF",
];

fn chunks(input: &[u8]) -> Option<Vec<([u8; 4], Vec<u8>)>> {
    if !input.starts_with(b"RIFF") || input.get(8..12)? != b"WEBP" {
        return None;
    }
    let mut rest = &input[12..];
    let mut chunks = Vec::new();
    while let Some((head, tail)) = rest.split_first_chunk::<8>() {
        let length = u32::from_le_bytes(head[4..].try_into().ok()?) as usize;
        let length = length.min(tail.len());
        chunks.push((head[..4].try_into().ok()?, tail[..length].to_vec()));
        rest = tail.get(length.next_multiple_of(2)..).unwrap_or_default();
    }
    (!chunks.is_empty()).then_some(chunks)
}

fn file(chunks: &[([u8; 4], Vec<u8>)]) -> Vec<u8> {
    let mut body = b"WEBP".to_vec();
    for (kind, data) in chunks {
        body.extend(kind);
        body.extend((data.len() as u32).to_le_bytes());
        body.extend(data);
        body.resize(body.len().next_multiple_of(2), 0);
    }
    let mut file = b"RIFF".to_vec();
    file.extend((body.len() as u32).to_le_bytes());
    file.extend(body);
    file
}

/// Changes one chunk, or the order of chunks.
pub fn mutated(input: &[u8], hand: &mut Hand) -> Option<Vec<u8>> {
    let mut chunks = chunks(input)?;
    let at = hand.dice.below(chunks.len());
    let other = hand.dice.below(chunks.len());
    match hand.dice.below(9) {
        0 => {
            chunks.remove(at);
        }
        1 => chunks.insert(other, chunks[at].clone()),
        2 => chunks.swap(at, other),
        3 => chunks[at].0 = **hand.dice.pick(&KINDS),
        4 => chunks[at].1 = number::mutated(&chunks[at].1, hand)?,
        _ => chunks[at].1 = hand.changed(&chunks[at].1),
    }
    Some(file(&chunks))
}

//! JPEG: segments with right lengths.

use super::{Hand, number};

/// A marker with its segment; that of a scan has the compressed data behind it.
type Segment = Vec<u8>;

fn has_length(marker: u8) -> bool {
    !matches!(marker, 0x01 | 0xd0..=0xd9)
}

fn segments(input: &[u8]) -> Option<Vec<Segment>> {
    let mut segments = Vec::new();
    let mut at = 0;
    while at + 2 <= input.len() && input[at] == 0xff {
        let marker = input[at + 1];
        let mut end = at + 2;
        if has_length(marker) {
            let length = input.get(end..end + 2)?;
            end += usize::from(u16::from_be_bytes([length[0], length[1]]));
        }
        if marker == 0xda {
            // to the next marker that does not belong to the data
            while end + 1 < input.len()
                && !(input[end] == 0xff && !matches!(input[end + 1], 0 | 0xd0..=0xd7))
            {
                end += 1;
            }
        }
        let end = end.min(input.len());
        segments.push(input[at..end].to_vec());
        at = end;
    }
    (segments.len() > 1).then_some(segments)
}

/// Changes one segment, or the order of segments.
pub fn mutated(input: &[u8], hand: &mut Hand) -> Option<Vec<u8>> {
    let mut segments = segments(input)?;
    let at = hand.dice.below(segments.len());
    let other = hand.dice.below(segments.len());
    match hand.dice.below(10) {
        0 => {
            segments.remove(at);
        }
        1 => segments.insert(other, segments[at].clone()),
        2 => segments.swap(at, other),
        3 => {
            // another kind of frame: baseline, extended, progressive, lossless, arithmetic
            let frame = segments
                .iter_mut()
                .find(|s| matches!(s[1], 0xc0..=0xc3 | 0xc9 | 0xca))?;
            frame[1] = *hand.dice.pick(&[0xc0, 0xc1, 0xc2, 0xc3, 0xc9, 0xca]);
        }
        4 | 5 => {
            let body = segments[at].get(4..)?;
            let body = number::mutated(body, hand)?;
            segments[at].truncate(4);
            segments[at].extend(body);
        }
        _ => {
            let segment = &mut segments[at];
            let body = hand.changed(segment.get(4..)?);
            segment.truncate(4);
            segment.extend(body);
            if has_length(segment[1]) && segment[1] != 0xda {
                let length = (segment.len() - 2).min(0xffff) as u16;
                segment[2..4].copy_from_slice(&length.to_be_bytes());
            }
        }
    }
    Some(segments.concat())
}

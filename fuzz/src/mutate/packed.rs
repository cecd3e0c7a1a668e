//! Packages: entries of zip archives with right checksums, and the chunks of binary glTF with right lengths.

use super::{Hand, number, text};
use std::io::{Cursor, Read as _, Write as _};
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipArchive, ZipWriter};

/// More of an entry is not unpacked.
const MAX_ENTRY: u64 = 1 << 16;

/// Unpacks an archive, changes an entry or its name, and packs it again.
pub fn mutated_archive(input: &[u8], hand: &mut Hand) -> Option<Vec<u8>> {
    if hand.dice.below(4) == 0 {
        return number::mutated(input, hand);
    }
    let mut archive = ZipArchive::new(Cursor::new(input)).ok()?;
    let mut entries = Vec::new();
    for index in 0..archive.len().min(16) {
        let entry = archive.by_index(index).ok()?;
        let name = entry.name().ok()?.into_owned();
        let mut content = Vec::new();
        let _ = entry.take(MAX_ENTRY).read_to_end(&mut content);
        entries.push((name, content));
    }
    if entries.is_empty() {
        return None;
    }
    let at = hand.dice.below(entries.len());
    match hand.dice.below(6) {
        0 => {
            let name = hand.changed(entries[at].0.as_bytes());
            entries[at].0 = String::from_utf8_lossy(&name).into_owned();
        }
        1 => {
            let copy = entries[at].clone();
            entries.push(copy);
        }
        _ => entries[at].1 = text::mutated(&entries[at].1, hand)?,
    }
    let method = *hand
        .dice
        .pick(&[CompressionMethod::Stored, CompressionMethod::Deflated]);
    let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
    for (name, content) in entries {
        archive
            .start_file(
                name,
                SimpleFileOptions::default().compression_method(method),
            )
            .ok()?;
        archive.write_all(&content).ok()?;
    }
    Some(archive.finish().ok()?.into_inner())
}

/// Changes the JSON of a glTF file, or the data of a binary one.
pub fn mutated_gltf(input: &[u8], hand: &mut Hand) -> Option<Vec<u8>> {
    let Some(mut rest) = input.strip_prefix(b"glTF").and_then(|rest| rest.get(8..)) else {
        return text::mutated(input, hand);
    };
    let mut chunks = Vec::new();
    while let Some((head, tail)) = rest.split_first_chunk::<8>() {
        let length = u32::from_le_bytes(head[..4].try_into().ok()?) as usize;
        let length = length.min(tail.len());
        let kind: [u8; 4] = head[4..].try_into().ok()?;
        chunks.push((kind, tail[..length].to_vec()));
        rest = &tail[length..];
    }
    if chunks.is_empty() {
        return None;
    }
    let at = hand.dice.below(chunks.len());
    chunks[at].1 = match &chunks[at].0 {
        b"JSON" => text::mutated(&chunks[at].1, hand)?,
        _ => number::mutated(&chunks[at].1, hand)?,
    };
    let mut body = Vec::new();
    for (kind, mut data) in chunks {
        let fill = if &kind == b"JSON" { b' ' } else { 0 };
        data.resize(data.len().next_multiple_of(4), fill);
        body.extend((data.len() as u32).to_le_bytes());
        body.extend(kind);
        body.extend(data);
    }
    let mut file = b"glTF\x02\0\0\0".to_vec();
    file.extend((body.len() as u32 + 12).to_le_bytes());
    file.extend(body);
    Some(file)
}

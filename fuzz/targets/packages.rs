//! The model inside a 3MF package: the input is its XML, which is packed here, so that no checksum rejects it.

use super::{Outcome, meshes};
use std::io::{Cursor, Write as _};
use zip::CompressionMethod;
use zip::write::{SimpleFileOptions, ZipWriter};

/// Separator of the parts of a package in an input; the first is the root model.
pub const SEPARATOR: &[u8] = b"\n====\n";

/// Names of the parts, in the order of the input.
const PARTS: [&str; 3] = ["3D/3dmodel.model", "3D/Objects/a.model", "_rels/.rels"];

/// Packs the parts and reads the package.
pub fn read_model(input: &[u8]) -> Outcome {
    meshes::read(&package(input))
}

fn package(input: &[u8]) -> Vec<u8> {
    let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
    let options = SimpleFileOptions::default().compression_method(CompressionMethod::Stored);
    let mut rest = Some(input);
    for name in PARTS {
        let Some(text) = rest else { break };
        let cut = text
            .windows(SEPARATOR.len())
            .position(|window| window == SEPARATOR);
        let part = &text[..cut.unwrap_or(text.len())];
        rest = cut.map(|cut| &text[cut + SEPARATOR.len()..]);
        archive
            .start_file(name, options)
            .and_then(|()| Ok(archive.write_all(part)?))
            .expect("memory takes any archive");
    }
    archive
        .finish()
        .expect("memory takes any archive")
        .into_inner()
}

//! OFF in text, as a stream.
//!
//! An optional first word, a line with the numbers of vertices, faces and edges, a line for each vertex and a line for
//! each face. Prefixes of the first word announce texture coordinates, colors and normals, which are left out, or points
//! of other dimensions, which are refused. `#` begins a comment.

use glam::DVec3;

use crate::MeshFormat;
use crate::error::{Place, ReadMeshError};
use crate::number::{integer, shown, three, words};
use crate::read::{MeshFile, ReadWarning};
use crate::soup::Soup;
use crate::source::Source;
use ravec_memory::ReservedVec;

/// Number of corners of a face that are read between two checks for cancellation.
const AT_ONCE: u64 = 1 << 16;

/// The first word, `[ST][C][N][4][n]OFF`.
pub(super) struct Header<'a> {
    /// Kinds of data behind the coordinates.
    others: Vec<&'static str>,
    /// Points of another number of coordinates than three.
    dimension: bool,
    /// Rest of the line: files exist in which the counts follow without a space.
    rest: &'a [u8],
}

impl<'a> Header<'a> {
    pub(super) fn parse(word: &'a [u8]) -> Option<Self> {
        let mut rest = word;
        let mut has = |prefix: &[u8]| {
            let stripped = rest.strip_prefix(prefix);
            rest = stripped.unwrap_or(rest);
            stripped.is_some()
        };
        let prefixes = [
            (&b"ST"[..], "texture coordinates"),
            (b"C", "colors"),
            (b"N", "normals"),
        ];
        let others = prefixes.into_iter().filter(|(prefix, _)| has(prefix));
        let others = others.map(|(_, what)| what).collect();
        let (four, many) = (has(b"4"), has(b"n"));
        (has(b"OFF") && rest.iter().all(u8::is_ascii_digit)).then_some(Self {
            others,
            dimension: four || many,
            rest,
        })
    }
}

fn fault(place: Place, what: impl Into<String>) -> ReadMeshError {
    ReadMeshError::syntax(MeshFormat::Off, place, what)
}

pub(super) fn read(mut source: Source<'_>) -> Result<MeshFile, ReadMeshError> {
    source.skip_mark()?;
    let progress = source.progress;
    let mut soup = Soup::new(MeshFormat::Off, &source.limits);
    let (vertices, faces) = counts(&mut source, &mut soup)?;
    soup.claim(vertices, faces)?;
    for vertex in 0..vertices {
        let Some((line, place)) = source.content_line(Some(b'#'))? else {
            return Err(source.truncated(format!("vertex {vertex} of {vertices}")));
        };
        let Some(at) = three(&mut words(line)) else {
            let what = format!("`{}` does not begin with three numbers", shown(line));
            return Err(fault(place, what));
        };
        soup.vertex(DVec3::from_array(at), place)?;
    }
    let mut corners = ReservedVec::new(&source.limits.memory);
    for face in 0..faces {
        let Some((line, place)) = source.content_line(Some(b'#'))? else {
            return Err(source.truncated(format!("face {face} of {faces}")));
        };
        let mut words = words(line);
        let count = words.next().unwrap_or_default();
        let Some(Ok(length)) = integer(count).map(u64::try_from) else {
            let what = format!("`{}` is not a number of corners", shown(count));
            return Err(fault(place, what));
        };
        soup.check_room(length.saturating_sub(2))?;
        corners.clear();
        for corner in 0..length {
            if corner % AT_ONCE == 0 {
                progress.check()?;
            }
            let Some(written) = words.next().and_then(integer) else {
                let what = format!("the face lacks its {length} corners");
                return Err(fault(place, what));
            };
            corners.push(soup.index(written, 0, place)?)?;
        }
        if words.next().is_some() {
            soup.ignore("colors");
        }
        soup.face(&corners)?;
    }
    if source.content_line(Some(b'#'))?.is_some() {
        soup.warn(ReadWarning::MoreBehindTheEnd);
    }
    soup.finish(None, source.progress)
}

/// Reads the first word and the numbers of vertices and faces.
fn counts(source: &mut Source<'_>, soup: &mut Soup) -> Result<(u64, u64), ReadMeshError> {
    let (mut found, mut count) = ([0; 2], 0);
    let mut first = true;
    while count == 0 {
        let Some((line, place)) = source.content_line(Some(b'#'))? else {
            return Err(source.truncated("the header"));
        };
        for word in words(line) {
            let mut word = word;
            if std::mem::take(&mut first)
                && let Some(header) = Header::parse(word)
            {
                if header.dimension {
                    return Err(ReadMeshError::Unsupported {
                        format: MeshFormat::Off,
                        what: format!(
                            "`{}` announces points that do not have three coordinates; only surfaces in space are read",
                            shown(word)
                        ),
                    });
                }
                for what in header.others {
                    soup.ignore(what);
                }
                word = header.rest;
                if word.is_empty() {
                    continue;
                }
            }
            if word == b"BINARY" {
                return Err(ReadMeshError::Unsupported {
                    format: MeshFormat::Off,
                    what: "binary OFF is not read; save it as text or as PLY".to_owned(),
                });
            }
            let Some(Ok(number)) = integer(word).map(u64::try_from) else {
                let what = format!("`{}` is not a number of vertices or faces", shown(word));
                return Err(fault(place, what));
            };
            if let Some(found) = found.get_mut(count) {
                *found = number;
            }
            count += 1;
        }
        if count == 1 {
            return Err(fault(place, "the number of faces is missing"));
        }
    }
    Ok(found.into())
}

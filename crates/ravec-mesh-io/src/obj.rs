//! Wavefront OBJ, as a stream.
//!
//! Read are the statements `v` and `f`, with indices from 1 or, negative, back from the last vertex so far. A statement
//! goes on in the next line after a backslash, `#` begins a comment. Texture coordinates (`vt`) are read if they were
//! requested. Normals, colors, groups and materials are left out; lines, points and free-form surfaces, too.

use glam::{DVec2, DVec3};
use ravec_progress::Progress;

use crate::MeshFormat;
use crate::error::{Place, ReadMeshError};
use crate::number::{integer, number, shown, three, words};
use crate::read::MeshFile;
use crate::soup::{NO_TEXTURE, Soup};
use crate::source::Source;
use ravec_memory::ReservedVec;

/// Number of corners of a face that are read between two checks for cancellation.
const AT_ONCE: usize = 1 << 16;

/// The longest statement, put together from its lines.
const LONGEST: usize = 1 << 26;

pub(super) fn read(mut source: Source<'_>) -> Result<MeshFile, ReadMeshError> {
    source.skip_mark()?;
    let budget = &source.limits.memory;
    let mut reader = Reader {
        soup: Soup::new(MeshFormat::Obj, &source.limits),
        progress: source.progress,
        corners: ReservedVec::new(budget),
        texture: source.options().texture.then(|| ReservedVec::new(budget)),
    };
    // A statement of several lines, and where it began.
    let mut joined = ReservedVec::new(budget);
    let mut started = None;
    while let Some((line, place)) = source.content_line(Some(b'#'))? {
        match line.trim_ascii_end().strip_suffix(b"\\") {
            None if started.is_none() => reader.statement(line, place)?,
            part => {
                let start = *started.get_or_insert(place);
                joined.extend_from_slice(part.unwrap_or(line))?;
                joined.push(b' ')?;
                if joined.len() > LONGEST {
                    return Err(fault(start, "the statement is too long"));
                }
                if part.is_none() {
                    reader.statement(&joined, start)?;
                    joined.clear();
                    started = None;
                }
            }
        }
    }
    if let Some(start) = started {
        reader.statement(&joined, start)?;
    }
    reader.soup.finish(None, source.progress)
}

fn fault(place: Place, what: impl Into<String>) -> ReadMeshError {
    ReadMeshError::syntax(MeshFormat::Obj, place, what)
}

struct Reader<'a> {
    soup: Soup,
    progress: &'a Progress,
    /// The corners of the face at hand.
    corners: ReservedVec<u32>,
    /// Their texture coordinates, if wanted.
    texture: Option<ReservedVec<u32>>,
}

impl Reader<'_> {
    fn statement(&mut self, line: &[u8], place: Place) -> Result<(), ReadMeshError> {
        let mut words = words(line);
        let Some(keyword) = words.next() else {
            return Ok(());
        };
        match keyword {
            b"v" => {
                let Some(at) = three(&mut words) else {
                    let what = format!("`{}` lacks three numbers", shown(line));
                    return Err(fault(place, what));
                };
                // One more is a weight, which polygons do not use; three more are a color.
                if words.nth(2).is_some() {
                    self.soup.ignore("colors");
                }
                self.soup.vertex(DVec3::from_array(at), place)
            }
            b"f" | b"fo" => self.face(words, place),
            b"vn" => self.ignore("normals"),
            b"vt" => self.texture(words, place),
            b"mtllib" | b"usemtl" | b"maplib" | b"usemap" => self.ignore("materials"),
            b"l" => self.ignore("lines"),
            b"p" => self.ignore("points"),
            b"vp" | b"cstype" | b"curv" | b"curv2" | b"surf" => {
                self.ignore("free-form curves and surfaces")
            }
            // Groups, smoothing and what else there may be say nothing about the shape.
            keyword if keyword.is_ascii() => Ok(()),
            keyword => {
                let what = format!("`{}` is no word of an OBJ file", shown(keyword));
                Err(fault(place, what))
            }
        }
    }

    #[expect(clippy::unnecessary_wraps, reason = "the outcome of a statement")]
    fn ignore(&mut self, what: &'static str) -> Result<(), ReadMeshError> {
        self.soup.ignore(what);
        Ok(())
    }

    fn texture<'a>(
        &mut self,
        mut words: impl Iterator<Item = &'a [u8]>,
        place: Place,
    ) -> Result<(), ReadMeshError> {
        if self.texture.is_none() {
            return self.ignore("texture coordinates");
        }
        let Some(u) = words.next().and_then(number) else {
            return Err(fault(place, "texture coordinates lack a number"));
        };
        // one alone is a place on a line, a third one a depth
        let v = words.next().and_then(number).unwrap_or(0.0);
        self.soup.texture(DVec2::new(u, v))
    }

    fn face<'a>(
        &mut self,
        words: impl Iterator<Item = &'a [u8]>,
        place: Place,
    ) -> Result<(), ReadMeshError> {
        self.corners.clear();
        self.texture.iter_mut().for_each(ReservedVec::clear);
        for (i, word) in words.enumerate() {
            if i % AT_ONCE == 0 {
                self.progress.check()?;
            }
            // Corners are spelled `v`, `v/vt`, `v//vn` or `v/vt/vn`.
            let mut parts = word.split(|&byte| byte == b'/');
            let Some(written) = parts.next().and_then(integer) else {
                let what = format!("`{}` is not the corner of a face", shown(word));
                return Err(fault(place, what));
            };
            // Back from the last vertex so far, which is −1.
            let base = if written < 0 {
                -(self.soup.vertices() as i64)
            } else {
                1
            };
            self.corners.push(self.soup.index(written, base, place)?)?;
            if let Some(texture) = &mut self.texture {
                let index = parts.next().and_then(integer).map(|written| {
                    if written < 0 {
                        written + self.soup.textures() as i64
                    } else {
                        written - 1
                    }
                });
                // those that are not there are none
                let index = index.and_then(|index| u32::try_from(index).ok());
                texture.push(index.unwrap_or(NO_TEXTURE))?;
            }
        }
        match &self.texture {
            Some(texture) => self.soup.textured_face(&self.corners, texture),
            None => self.soup.face(&self.corners),
        }
    }
}

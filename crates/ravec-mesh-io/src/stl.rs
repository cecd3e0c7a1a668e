//! STL, binary and ASCII, as a stream.
//!
//! The binary form has a header of 80 bytes, a count, and 50 bytes for each triangle: a normal, three corners and two
//! bytes of no fixed meaning. The text form spells the same in words, in which any white space separates and any case
//! will do. Corners at equal places are made one vertex while they are read; normals and the two bytes are left out (the
//! corners determine the orientation).
//!
//! Cost: about 80 ns a triangle for the binary form, most of them for finding equal corners.

use glam::DVec3;

use crate::MeshFormat;
use crate::error::{Place, ReadMeshError};
use crate::number::{number, shown};
use crate::read::{MeshFile, MeshLimits, ReadWarning};
use crate::soup::mesh_file;
use crate::source::Source;
use ravec_memory::ReservedVec;
use ravec_mesh::{PlaceKey, PlaceTable, place_key};

/// The part that has been read: places, and the triangles between them.
struct Welder<K> {
    places: PlaceTable<K>,
    triangles: ReservedVec<[u32; 3]>,
    limits: MeshLimits,
}

impl<K: PlaceKey> Welder<K> {
    fn new(limits: &MeshLimits) -> Result<Self, ReadMeshError> {
        let most = u64::from(u32::MAX);
        Ok(Self {
            places: PlaceTable::new(&limits.memory)?,
            triangles: ReservedVec::new(&limits.memory),
            limits: MeshLimits {
                max_triangles: limits.max_triangles.min(most),
                max_vertices: limits.max_vertices.min(most),
                memory: limits.memory.clone(),
            },
        })
    }

    fn check_triangles(&self, count: u64) -> Result<(), ReadMeshError> {
        if count > self.limits.max_triangles {
            return Err(ReadMeshError::TooMany {
                what: "triangles",
                limit: self.limits.max_triangles,
            });
        }
        Ok(())
    }

    /// Adds a triangle. The limit of triangles is the caller's to check.
    #[inline]
    fn triangle(&mut self, corners: [K; 3]) -> Result<(), ReadMeshError> {
        let [a, b, c] = corners;
        let corners = [
            self.places.index_of(a)?,
            self.places.index_of(b)?,
            self.places.index_of(c)?,
        ];
        if self.places.len() as u64 > self.limits.max_vertices {
            return Err(ReadMeshError::TooMany {
                what: "vertices",
                limit: self.limits.max_vertices,
            });
        }
        self.triangles.push(corners)?;
        Ok(())
    }
}

pub(super) fn read_binary(mut source: Source<'_>) -> Result<MeshFile, ReadMeshError> {
    const HEADER: usize = 84;
    const FACET: usize = 50;
    let Some(header) = source.exact(HEADER)? else {
        return Err(source.truncated("the header"));
    };
    let count = u32::from_le_bytes([header[80], header[81], header[82], header[83]]);
    let mut welder = Welder::<[u32; 3]>::new(&source.limits)?;
    welder.check_triangles(u64::from(count))?;
    welder.triangles.expect(u64::from(count));
    let mut done = 0;
    while done < count {
        let offset = source.offset();
        let there = source.peek(FACET)?;
        let facets = there.as_chunks::<FACET>().0;
        let facets = &facets[..facets.len().min((count - done) as usize)];
        for (i, facet) in facets.iter().enumerate() {
            let word = |at: usize| {
                u32::from_le_bytes([facet[at], facet[at + 1], facet[at + 2], facet[at + 3]])
            };
            let corner = |at: usize| [word(at), word(at + 4), word(at + 8)];
            let corners = [corner(12), corner(24), corner(36)];
            for (which, corner) in corners.iter().enumerate() {
                let at = corner.map(f32::from_bits);
                if !at.iter().all(|x| x.is_finite()) {
                    return Err(ReadMeshError::NotFinite {
                        format: MeshFormat::StlBinary,
                        place: Place::Byte(offset + (FACET * i + 12 * (which + 1)) as u64),
                        vertex: 3 * (u64::from(done) + i as u64) + which as u64,
                        at: at.map(f64::from),
                    });
                }
            }
            welder.triangle(corners.map(|corner| corner.map(positive_zero)))?;
        }
        let got = facets.len();
        if got == 0 {
            return Err(source.truncated(format!("triangle {done} of {count}")));
        }
        source.consume(FACET * got);
        done += got as u32;
    }
    let mut warnings = Vec::new();
    if !source.peek(1)?.is_empty() {
        warnings.push(ReadWarning::MoreBehindTheEnd);
    }
    let Welder {
        places, triangles, ..
    } = welder;
    let progress = source.progress;
    let positions = places.into_positions(
        |key| key.map(|bits| f64::from(f32::from_bits(bits))),
        progress,
    )?;
    let lists = (positions, triangles);
    mesh_file(MeshFormat::StlBinary, lists, None, warnings, progress)
}

/// The bits of a number, the same for 0 and −0.
#[inline]
fn positive_zero(bits: u32) -> u32 {
    if bits == 1 << 31 { 0 } else { bits }
}

pub(super) fn read_ascii(mut source: Source<'_>) -> Result<MeshFile, ReadMeshError> {
    source.skip_mark()?;
    let mut welder = Welder::<[u64; 3]>::new(&source.limits)?;
    let mut corners = [[0; 3]; 3];
    // The corners of a loop that has begun.
    let mut open: Option<usize> = None;
    let mut ended = false;
    while let Some((word, place)) = source.word()? {
        ended = false;
        if word.eq_ignore_ascii_case(b"vertex") {
            let vertex = 3 * welder.triangles.len() as u64 + open.unwrap_or(0) as u64;
            let at = coordinates(&mut source, vertex, place)?;
            match &mut open {
                Some(count @ 0..3) => {
                    corners[*count] = place_key(at);
                    *count += 1;
                }
                Some(_) => {
                    return Err(source.syntax(place, "a triangle has a fourth corner"));
                }
                None => {
                    return Err(source.syntax(place, "a vertex stands outside of `outer loop`"));
                }
            }
        } else if word.eq_ignore_ascii_case(b"facet") {
            if open.is_some() {
                return Err(source.syntax(place, "a facet begins before the last one has ended"));
            }
            expect(&mut source, b"normal")?;
            for _ in 0..3 {
                // The normal is not used, so that whatever stands there is no reason to refuse the file.
                skip_word(&mut source)?;
            }
        } else if word.eq_ignore_ascii_case(b"outer") {
            if open.is_some() {
                return Err(source.syntax(place, "a loop begins before the last one has ended"));
            }
            expect(&mut source, b"loop")?;
            open = Some(0);
        } else if word.eq_ignore_ascii_case(b"endloop") {
            if open != Some(3) {
                let got = open.unwrap_or(0);
                let what = format!("a triangle ends after {got} of 3 corners");
                return Err(source.syntax(place, what));
            }
            welder.check_triangles(welder.triangles.len() as u64 + 1)?;
            welder.triangle(corners)?;
            open = None;
        } else if word.eq_ignore_ascii_case(b"solid") || word.eq_ignore_ascii_case(b"endsolid") {
            ended = word.len() > 5;
            if open.is_some() {
                return Err(source.syntax(place, "a solid begins or ends inside of a facet"));
            }
            source.line()?;
        } else if !word.eq_ignore_ascii_case(b"endfacet") {
            let what = format!("`{}` is no word of an STL file", shown(word));
            return Err(source.syntax(place, what));
        }
    }
    if open.is_some() {
        return Err(source.truncated(format!("triangle {}", welder.triangles.len())));
    }
    let warnings = if ended {
        vec![]
    } else {
        vec![ReadWarning::NoEnd]
    };
    let Welder {
        places, triangles, ..
    } = welder;
    let progress = source.progress;
    let positions = places.into_positions(|key| key.map(f64::from_bits), progress)?;
    let lists = (positions, triangles);
    mesh_file(MeshFormat::StlAscii, lists, None, warnings, progress)
}

fn coordinates(source: &mut Source<'_>, vertex: u64, place: Place) -> Result<DVec3, ReadMeshError> {
    let mut at = [0.0; 3];
    for x in &mut at {
        let Some((word, place)) = source.word()? else {
            return Err(source.truncated("a vertex"));
        };
        let Some(value) = number(word) else {
            let what = format!("`{}` is not a number", shown(word));
            return Err(source.syntax(place, what));
        };
        *x = value;
    }
    if !at.iter().all(|x| x.is_finite()) {
        return Err(ReadMeshError::NotFinite {
            format: MeshFormat::StlAscii,
            place,
            vertex,
            at,
        });
    }
    Ok(at.into())
}

fn skip_word(source: &mut Source<'_>) -> Result<(), ReadMeshError> {
    if source.word()?.is_none() {
        return Err(source.truncated("a normal"));
    }
    Ok(())
}

fn expect(source: &mut Source<'_>, wanted: &[u8]) -> Result<(), ReadMeshError> {
    let wanted_text = String::from_utf8_lossy(wanted);
    match source.word()? {
        Some((word, _)) if word.eq_ignore_ascii_case(wanted) => Ok(()),
        Some((word, place)) => {
            let what = format!("`{wanted_text}` should stand where `{}` is", shown(word));
            Err(source.syntax(place, what))
        }
        None => Err(source.truncated("a facet")),
    }
}

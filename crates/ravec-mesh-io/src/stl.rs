//! STL, binary and ASCII, as a stream.
//!
//! The binary form has a header of 80 bytes, a count, and 50 bytes for each triangle: a normal, three corners and two
//! bytes of no fixed meaning. Some programs never fill in the count: what is there decides, not what the header announces,
//! if the file ends with a whole triangle. The text form spells the same in words, in which any white space separates and any case
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

const HEADER: usize = 84;
const FACET: usize = 50;

/// The count of a header that was never filled in, other than 0.
const UNKNOWN: u32 = u32::MAX;

/// Number of facets behind those that a header announces that are examined before more are read.
const EXAMINED: usize = 20;

/// Corner `which` of a facet, as bits.
#[inline]
fn corner(facet: &[u8; FACET], which: usize) -> [u32; 3] {
    let word =
        |at: usize| u32::from_le_bytes([facet[at], facet[at + 1], facet[at + 2], facet[at + 3]]);
    let at = 12 * (which + 1);
    [word(at), word(at + 4), word(at + 8)]
}

/// True if `bytes` begin with triangles: all corners have coordinates of ordinary magnitude, and those of some triangle
/// differ, which padding by zeros does not have.
pub(super) fn are_facets(bytes: &[u8]) -> bool {
    let facets = bytes.as_chunks::<FACET>().0;
    let facets = &facets[..facets.len().min(EXAMINED)];
    let is_ordinary = |bits: u32| {
        let size = f32::from_bits(bits).abs();
        size == 0.0 || (1e-12..1e12).contains(&size)
    };
    let corners = |facet: &[u8; FACET]| [0, 1, 2].map(|which| corner(facet, which));
    let all_ordinary = facets.iter().all(|facet| {
        corners(facet)
            .as_flattened()
            .iter()
            .all(|&bits| is_ordinary(bits))
    });
    let is_triangle = |facet: &[u8; FACET]| {
        let [a, b, c] = corners(facet);
        a != b && b != c && c != a
    };
    all_ordinary && facets.iter().any(is_triangle)
}

pub(super) fn read_binary(mut source: Source<'_>) -> Result<MeshFile, ReadMeshError> {
    let Some(header) = source.exact(HEADER)? else {
        return Err(source.truncated("the header"));
    };
    let announced = u32::from_le_bytes([header[80], header[81], header[82], header[83]]);
    let mut welder = Welder::<[u32; 3]>::new(&source.limits)?;
    let size = source.options().size;
    let room = size.map(|size| size.saturating_sub(HEADER as u64) / FACET as u64);
    let expected = u64::from(announced).min(room.unwrap_or(u64::MAX));
    if room.is_some() {
        welder.check_triangles(expected)?;
    }
    if room.is_some() || announced != UNKNOWN {
        welder.triangles.expect(expected);
    }
    read_facets(&mut source, &mut welder, u64::from(announced))?;
    let mut found = welder.triangles.len() as u64;
    if found == u64::from(announced) && are_facets(source.peek(EXAMINED * FACET)?) {
        read_facets(&mut source, &mut welder, u64::MAX)?;
        found = welder.triangles.len() as u64;
    }
    let is_cut = !source.peek(1)?.is_empty();
    let misses = u64::from(announced) > found;
    if misses && (found == 0 || is_cut && announced != UNKNOWN) {
        source.skip(u64::MAX)?;
        return Err(source.truncated(format!("triangle {found} of {announced}")));
    }
    let mut warnings = Vec::new();
    if found != u64::from(announced) {
        warnings.push(ReadWarning::OtherCount {
            announced: u64::from(announced),
            found,
        });
    }
    if is_cut {
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

/// Reads facets until there are `most` triangles, or no whole facet is left.
fn read_facets(
    source: &mut Source<'_>,
    welder: &mut Welder<[u32; 3]>,
    most: u64,
) -> Result<(), ReadMeshError> {
    loop {
        let done = welder.triangles.len() as u64;
        let offset = source.offset();
        let facets = source.peek(FACET)?.as_chunks::<FACET>().0;
        let left = usize::try_from(most - done).unwrap_or(usize::MAX);
        let facets = &facets[..facets.len().min(left)];
        if facets.is_empty() {
            return Ok(());
        }
        welder.check_triangles(done + facets.len() as u64)?;
        for (i, facet) in facets.iter().enumerate() {
            let corners = [0, 1, 2].map(|which| corner(facet, which));
            for (which, corner) in corners.iter().enumerate() {
                let at = corner.map(f32::from_bits);
                if !at.iter().all(|x| x.is_finite()) {
                    return Err(ReadMeshError::NotFinite {
                        format: MeshFormat::StlBinary,
                        place: Place::Byte(offset + (FACET * i + 12 * (which + 1)) as u64),
                        vertex: 3 * (done + i as u64) + which as u64,
                        at: at.map(f64::from),
                    });
                }
            }
            welder.triangle(corners.map(|corner| corner.map(positive_zero)))?;
        }
        let got = facets.len();
        source.consume(FACET * got);
    }
}

/// The bits of a number, the same for 0 and −0.
#[inline]
fn positive_zero(bits: u32) -> u32 {
    if bits == 1 << 31 { 0 } else { bits }
}

/// The words that statements begin with, in any case. Some programs write `end solid` and the like in two words.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Keyword {
    Solid,
    Facet,
    Outer,
    OuterLoop,
    Vertex,
    End,
    EndLoop,
    EndFacet,
    EndSolid,
}

impl Keyword {
    const ALL: [(&'static [u8], Self); 10] = [
        (b"vertex", Self::Vertex),
        (b"facet", Self::Facet),
        (b"outer", Self::Outer),
        (b"endloop", Self::EndLoop),
        (b"endfacet", Self::EndFacet),
        (b"solid", Self::Solid),
        (b"endsolid", Self::EndSolid),
        (b"end", Self::End),
        (b"outerloop", Self::OuterLoop),
        (b"loop", Self::OuterLoop),
    ];

    fn parse(word: &[u8]) -> Option<Self> {
        let mut all = Self::ALL.iter();
        all.find(|(known, _)| word.eq_ignore_ascii_case(known))
            .map(|(_, keyword)| *keyword)
    }
}

/// The statement that begins with the word `end`, which has just been read.
fn end_of(source: &mut Source<'_>) -> Result<Keyword, ReadMeshError> {
    let Some((word, place)) = source.word()? else {
        return Ok(Keyword::EndSolid);
    };
    match Keyword::parse(word) {
        Some(Keyword::Solid) => Ok(Keyword::EndSolid),
        Some(Keyword::Facet) => Ok(Keyword::EndFacet),
        Some(Keyword::OuterLoop) => Ok(Keyword::EndLoop),
        _ => {
            let what = format!(
                "`loop`, `facet` or `solid` should stand where `{}` is",
                shown(word)
            );
            Err(source.syntax(place, what))
        }
    }
}

pub(super) fn read_ascii(mut source: Source<'_>) -> Result<MeshFile, ReadMeshError> {
    source.skip_mark()?;
    let mut text = Text {
        welder: Welder::new(&source.limits)?,
        corners: [[0; 3]; 3],
        open: None,
    };
    let mut ended = false;
    while let Some((word, place)) = source.word()? {
        let Some(mut keyword) = Keyword::parse(word) else {
            let what = format!("`{}` is no word of an STL file", shown(word));
            return Err(source.syntax(place, what));
        };
        if keyword == Keyword::End {
            keyword = end_of(&mut source)?;
        }
        text.statement(keyword, place, &mut source)?;
        ended = keyword == Keyword::EndSolid;
    }
    let Text { welder, open, .. } = text;
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

/// The text form while it is read.
struct Text {
    welder: Welder<[u64; 3]>,
    corners: [[u64; 3]; 3],
    /// The number of corners of a loop that has begun.
    open: Option<usize>,
}

impl Text {
    /// Reads the rest of a statement that begins with `keyword`.
    fn statement(
        &mut self,
        keyword: Keyword,
        place: Place,
        source: &mut Source<'_>,
    ) -> Result<(), ReadMeshError> {
        match keyword {
            Keyword::Vertex => self.vertex(place, source),
            Keyword::Facet => {
                if self.open.is_some() {
                    return Err(
                        source.syntax(place, "a facet begins before the last one has ended")
                    );
                }
                expect(source, b"normal")?;
                for _ in 0..3 {
                    // The normal is not used, so that whatever stands there is no reason to refuse the file.
                    skip_word(source)?;
                }
                Ok(())
            }
            Keyword::Outer | Keyword::OuterLoop => {
                if self.open.is_some() {
                    return Err(source.syntax(place, "a loop begins before the last one has ended"));
                }
                if keyword == Keyword::Outer {
                    expect(source, b"loop")?;
                }
                self.open = Some(0);
                Ok(())
            }
            Keyword::EndLoop => {
                if self.open != Some(3) {
                    let got = self.open.unwrap_or(0);
                    let what = format!("a triangle ends after {got} of 3 corners");
                    return Err(source.syntax(place, what));
                }
                let welder = &mut self.welder;
                welder.check_triangles(welder.triangles.len() as u64 + 1)?;
                welder.triangle(self.corners)?;
                self.open = None;
                Ok(())
            }
            Keyword::Solid | Keyword::EndSolid => {
                if self.open.is_some() {
                    return Err(source.syntax(place, "a solid begins or ends inside of a facet"));
                }
                source.line()?;
                Ok(())
            }
            Keyword::EndFacet | Keyword::End => Ok(()),
        }
    }

    fn vertex(&mut self, place: Place, source: &mut Source<'_>) -> Result<(), ReadMeshError> {
        let vertex = 3 * self.welder.triangles.len() as u64 + self.open.unwrap_or(0) as u64;
        let at = coordinates(source, vertex, place)?;
        match &mut self.open {
            Some(count @ 0..3) => {
                self.corners[*count] = place_key(at);
                *count += 1;
                Ok(())
            }
            Some(_) => Err(source.syntax(place, "a triangle has a fourth corner")),
            None => Err(source.syntax(place, "a vertex stands outside of `outer loop`")),
        }
    }
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

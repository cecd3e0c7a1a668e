//! The header of a PLY file: which elements come, and of which properties a row consists.

use ravec_memory::Reservation;

use crate::MeshFormat;
use crate::error::ReadMeshError;
use crate::number::{integer, shown, words};
use crate::source::Source;
use ravec_memory::ReservedVec;

/// Encoding of the rows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Encoding {
    Ascii,
    Little,
    Big,
}

/// The type of a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    fn parse(word: &[u8]) -> Option<Self> {
        Some(match word {
            b"char" | b"int8" => Self::I8,
            b"uchar" | b"uint8" => Self::U8,
            b"short" | b"int16" => Self::I16,
            b"ushort" | b"uint16" => Self::U16,
            b"int" | b"int32" => Self::I32,
            b"uint" | b"uint32" => Self::U32,
            b"float" | b"float32" => Self::F32,
            b"double" | b"float64" => Self::F64,
            _ => return None,
        })
    }

    /// Its size in bytes.
    pub(super) fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// The number that `bytes` begin with. All types fit a double exactly.
    #[inline]
    pub(super) fn decode(self, bytes: &[u8], big: bool) -> f64 {
        fn first<const N: usize>(bytes: &[u8], big: bool) -> [u8; N] {
            let mut first = [0; N];
            first.copy_from_slice(&bytes[..N]);
            if big {
                first.reverse();
            }
            first
        }
        match self {
            Self::I8 => f64::from(bytes[0] as i8),
            Self::U8 => f64::from(bytes[0]),
            Self::I16 => f64::from(i16::from_le_bytes(first(bytes, big))),
            Self::U16 => f64::from(u16::from_le_bytes(first(bytes, big))),
            Self::I32 => f64::from(i32::from_le_bytes(first(bytes, big))),
            Self::U32 => f64::from(u32::from_le_bytes(first(bytes, big))),
            Self::F32 => f64::from(f32::from_le_bytes(first(bytes, big))),
            Self::F64 => f64::from_le_bytes(first(bytes, big)),
        }
    }
}

/// One column of the rows of an element.
#[derive(Debug)]
pub(super) struct Property {
    pub(super) name: Vec<u8>,
    /// The type of the count if this is a list.
    pub(super) count: Option<Scalar>,
    /// The type of the number, or of the numbers in the list.
    pub(super) item: Scalar,
}

/// A table.
#[derive(Debug)]
pub(super) struct Element {
    pub(super) name: Vec<u8>,
    pub(super) rows: u64,
    pub(super) properties: ReservedVec<Property>,
}

impl Element {
    /// Index of the column that has one of `names`.
    pub(super) fn column(&self, names: &[&[u8]], list: bool) -> Option<usize> {
        self.properties.iter().position(|property| {
            names.contains(&property.name.as_slice()) && property.count.is_some() == list
        })
    }

    /// Returns `true` if a row is a list of 32-bit indices with its length in a byte, and nothing else.
    pub(super) fn is_plain_list(&self) -> bool {
        matches!(
            &*self.properties,
            [Property {
                count: Some(Scalar::U8),
                item: Scalar::I32 | Scalar::U32,
                ..
            }]
        )
    }

    /// The bytes of a row, if all rows have as many.
    pub(super) fn stride(&self) -> Option<usize> {
        let sizes = self.properties.iter();
        sizes
            .map(|property| property.count.is_none().then(|| property.item.size()))
            .sum()
    }
}

/// The most bytes of a header: a stream may have comments without end.
const MAX_HEADER: u64 = 1 << 24;

/// Length to which names are cut: known names are shorter, and messages show no more.
const MAX_NAME: usize = 128;

fn kept(name: &[u8]) -> Vec<u8> {
    name[..name.len().min(MAX_NAME)].to_vec()
}

/// The content of a header.
pub(super) struct Header {
    pub(super) encoding: Encoding,
    pub(super) elements: ReservedVec<Element>,
    /// The memory of the names.
    _names: Reservation,
}

/// Reads the header, up to and including the line `end_header`.
pub(super) fn read(source: &mut Source<'_>) -> Result<Header, ReadMeshError> {
    let mut encoding = None;
    let budget = source.limits.memory.clone();
    let mut names = budget.reserve_nothing();
    let mut elements: ReservedVec<Element> = ReservedVec::new(&budget);
    let format = source.format;
    let fault = |place, what: String| ReadMeshError::syntax(format, place, what);
    source.line()?;
    loop {
        let place = source.at_line();
        if source.offset() > MAX_HEADER {
            return Err(fault(place, "the header does not end".to_owned()));
        }
        let Some((line, _)) = source.line()? else {
            return Err(source.truncated("the header"));
        };
        let mut words = words(line);
        let Some(keyword) = words.next() else {
            continue;
        };
        let mut next = || words.next().unwrap_or_default();
        match keyword {
            b"comment" | b"obj_info" => {}
            b"end_header" => break,
            b"format" => {
                encoding = Some(match next() {
                    b"ascii" => Encoding::Ascii,
                    b"binary_little_endian" => Encoding::Little,
                    b"binary_big_endian" => Encoding::Big,
                    other => {
                        let what = format!(
                            "the format `{}` is not one of ascii, binary_little_endian and binary_big_endian",
                            shown(other)
                        );
                        return Err(fault(place, what));
                    }
                });
            }
            b"element" => {
                names.grow(MAX_NAME as u64)?;
                let name = kept(next());
                let rows = next();
                let Some(Ok(rows)) = integer(rows).map(u64::try_from) else {
                    let what = format!("`{}` is not a number of elements", shown(rows));
                    return Err(fault(place, what));
                };
                elements.push(Element {
                    name,
                    rows,
                    properties: ReservedVec::new(&budget),
                })?;
            }
            b"property" => {
                let mut types = [next(), b""];
                let is_list = types[0] == b"list";
                if is_list {
                    types = [next(), next()];
                }
                names.grow(MAX_NAME as u64)?;
                let name = kept(next());
                let [first, second] = types.map(Scalar::parse);
                let (count, item) = if is_list {
                    (first, second)
                } else {
                    (None, first)
                };
                let (Some(item), true) = (item, count.is_some() == is_list) else {
                    let what = format!("`{}` is not a property of a known type", shown(line));
                    return Err(fault(place, what));
                };
                let Some(element) = elements.last_mut() else {
                    return Err(fault(
                        place,
                        "a property stands before any element".to_owned(),
                    ));
                };
                element.properties.push(Property { name, count, item })?;
            }
            other => {
                let what = format!("`{}` is no word of a header", shown(other));
                return Err(fault(place, what));
            }
        }
    }
    let Some(encoding) = encoding else {
        let place = source.at_line();
        return Err(source.syntax(place, "the header does not name a format"));
    };
    source.format = match encoding {
        Encoding::Ascii => MeshFormat::PlyAscii,
        Encoding::Little | Encoding::Big => MeshFormat::PlyBinary,
    };
    Ok(Header {
        encoding,
        elements,
        _names: names,
    })
}

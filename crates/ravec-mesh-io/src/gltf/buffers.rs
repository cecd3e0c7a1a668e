//! The bytes behind a glTF file, and the numbers that accessors see in them.

use crate::MeshFormat;
use ravec_progress::Progress;

use super::document::{Accessor, Buffer, BufferView, Document, Part};
use super::json::{Data, number_of_data};
use crate::error::{Place, ReadMeshError};
use crate::number::shown;
use crate::read::{BufferResolver, ReadOptions};
use crate::source::Source;
use ravec_memory::ReservedVec;

/// The bytes of a buffer.
enum Bytes {
    /// From the text or from elsewhere.
    Own(ReservedVec<u8>),
    /// Data of the text that another buffer had before.
    Shared(usize),
}

/// All buffers of a file.
pub(super) struct Buffers {
    format: MeshFormat,
    all: ReservedVec<Bytes>,
}

/// Origins of the bytes of buffers.
pub(super) struct Origins<'a, 'r> {
    /// The part of the file that is the first buffer, if any.
    pub(super) inside: Option<ReservedVec<u8>>,
    /// Data that stood in the text.
    pub(super) data: ReservedVec<Data>,
    pub(super) resolver: Option<&'a mut BufferResolver<'r>>,
}

/// A row of equally spaced numbers, or groups of them.
#[derive(Clone, Copy)]
struct Span<'a> {
    bytes: &'a [u8],
    stride: usize,
    component: Component,
    normalized: bool,
}

/// The types of numbers in buffers.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Component {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl Component {
    fn of(code: u32) -> Option<Self> {
        Some(match code {
            5120 => Self::I8,
            5121 => Self::U8,
            5122 => Self::I16,
            5123 => Self::U16,
            5125 => Self::U32,
            5126 => Self::F32,
            _ => return None,
        })
    }

    fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::U32 | Self::F32 => 4,
        }
    }
}

impl Span<'_> {
    /// Component `which` of element `index`, which must be inside.
    #[inline]
    fn number(&self, index: usize, which: usize) -> f64 {
        let at = index * self.stride + which * self.component.size();
        let bytes = &self.bytes[at..];
        let scaled = |value: f64, most: f64| {
            if self.normalized {
                (value / most).max(-1.0)
            } else {
                value
            }
        };
        match self.component {
            Component::I8 => scaled(f64::from(bytes[0] as i8), 127.0),
            Component::U8 => scaled(f64::from(bytes[0]), 255.0),
            Component::I16 => scaled(f64::from(i16::from_le_bytes([bytes[0], bytes[1]])), 32767.0),
            Component::U16 => scaled(f64::from(u16::from_le_bytes([bytes[0], bytes[1]])), 65535.0),
            Component::U32 => {
                f64::from(u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]))
            }
            Component::F32 => {
                f64::from(f32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]))
            }
        }
    }
}

impl Span<'_> {
    fn row<const N: usize>(&self, index: usize) -> [f64; N] {
        std::array::from_fn(|which| self.number(index, which))
    }
}

impl Buffers {
    /// Gets all buffers.
    pub(super) fn new(
        format: MeshFormat,
        buffers: &[Buffer],
        mut origins: Origins<'_, '_>,
        options: &ReadOptions,
        progress: &Progress,
    ) -> Result<Self, ReadMeshError> {
        let budget = &options.limits.memory;
        let mut all = ReservedVec::new(budget);
        // which buffer got the data of that number
        let mut taken: ReservedVec<Option<usize>> = ReservedVec::new(budget);
        taken.fill_up_to(origins.data.len(), None)?;
        for (i, buffer) in buffers.iter().enumerate() {
            progress.check()?;
            let place = Place::Item {
                of: "buffer",
                index: i as u64,
            };
            let fault = |what: &str| ReadMeshError::syntax(format, place, what);
            let own = |bytes: ReservedVec<u8>| (bytes.len(), Bytes::Own(bytes));
            let (there, bytes) = if let Some(uri) = &buffer.uri {
                if let Some(number) = number_of_data(uri) {
                    match (taken.get_mut(number), origins.data.get_mut(number)) {
                        (Some(Some(first)), _) => (length(&all, *first), Bytes::Shared(*first)),
                        (Some(taken), Some(Data::Bytes(bytes))) => {
                            *taken = Some(i);
                            own(std::mem::replace(bytes, ReservedVec::new(budget)))
                        }
                        _ => return Err(fault("its data are not base64")),
                    }
                } else {
                    own(
                        from_elsewhere(format, buffer, uri, &mut origins, options, progress)
                            .map_err(|error| {
                                error.unwrap_or_else(|| fault("its address is not readable"))
                            })?,
                    )
                }
            } else {
                let inside = origins.inside.take().filter(|_| i == 0);
                own(inside.ok_or_else(|| fault("it has neither data nor an address"))?)
            };
            if there < buffer.byte_length {
                return Err(ReadMeshError::Truncated {
                    format,
                    place: Place::Byte(there as u64),
                    inside: format!("buffer {i}, which should have {} bytes", buffer.byte_length),
                });
            }
            all.push(bytes)?;
        }
        Ok(Self { format, all })
    }

    fn fault(&self, accessor: usize, what: &str) -> ReadMeshError {
        let place = Place::Item {
            of: "accessor",
            index: accessor as u64,
        };
        ReadMeshError::syntax(self.format, place, what)
    }

    fn accessor<'d>(
        &self,
        document: &'d Document,
        index: usize,
    ) -> Result<&'d Accessor, ReadMeshError> {
        let accessor = document.accessors.get(index);
        accessor.ok_or_else(|| self.fault(index, "there is no such accessor"))
    }

    /// The points that accessor `index` holds.
    pub(super) fn points<'a>(
        &'a self,
        document: &Document,
        index: usize,
    ) -> Result<impl ExactSizeIterator<Item = [f64; 3]> + use<'a>, ReadMeshError> {
        self.rows(document, index, "VEC3", "positions must be of type VEC3")
    }

    /// The quaternions that accessor `index` holds, of any length.
    pub(super) fn quaternions<'a>(
        &'a self,
        document: &Document,
        index: usize,
    ) -> Result<impl ExactSizeIterator<Item = [f64; 4]> + use<'a>, ReadMeshError> {
        self.rows(document, index, "VEC4", "rotations must be of type VEC4")
    }

    /// The pairs of numbers that accessor `index` holds.
    pub(super) fn pairs<'a>(
        &'a self,
        document: &Document,
        index: usize,
    ) -> Result<impl ExactSizeIterator<Item = [f64; 2]> + use<'a>, ReadMeshError> {
        let wrong = "texture coordinates must be of type VEC2";
        self.rows(document, index, "VEC2", wrong)
    }

    /// The rows of `N` numbers that accessor `index` holds, which must be of the type `kind`.
    fn rows<'a, const N: usize>(
        &'a self,
        document: &Document,
        index: usize,
        kind: &str,
        wrong: &str,
    ) -> Result<impl ExactSizeIterator<Item = [f64; N]> + use<'a, N>, ReadMeshError> {
        let accessor = self.accessor(document, index)?;
        if accessor.kind != kind {
            return Err(self.fault(index, wrong));
        }
        let base = self.span(document, index, accessor, N)?;
        // The elements that are replaced, in ascending order as the format demands.
        let mut replaced = 0..0;
        let mut sparse = None;
        if let Some(others) = &accessor.sparse {
            let part = |part: &Part, code, group| {
                self.part(document, index, part, code, others.count, group)
            };
            let code = others.indices.component_type.unwrap_or(0);
            let indices = part(&others.indices, code, 1)?;
            let mut values = part(&others.values, accessor.component_type, N)?;
            values.normalized = accessor.normalized && N > 1;
            sparse = Some((indices, values));
            replaced = 0..others.count;
        } else if base.is_none() {
            return Err(self.fault(
                index,
                "it has no data of its own; meshes that are all zeros or packed by an extension are not read",
            ));
        }
        Ok((0..accessor.count).map(move |i| {
            if let Some((indices, values)) = &sparse {
                while !replaced.is_empty() && indices.number(replaced.start, 0) < i as f64 {
                    replaced.start += 1;
                }
                if !replaced.is_empty() && indices.number(replaced.start, 0) == i as f64 {
                    return values.row(replaced.start);
                }
            }
            base.map_or([0.0; N], |base| base.row(i))
        }))
    }

    /// The indices that accessor `index` holds.
    pub(super) fn indices<'a>(
        &'a self,
        document: &Document,
        index: usize,
    ) -> Result<impl Iterator<Item = u32> + use<'a>, ReadMeshError> {
        let rows = self.rows(document, index, "SCALAR", "indices must be of type SCALAR")?;
        let component = Component::of(self.accessor(document, index)?.component_type);
        if !matches!(
            component,
            Some(Component::U8 | Component::U16 | Component::U32)
        ) {
            return Err(self.fault(index, "indices must be whole numbers without a sign"));
        }
        Ok(rows.map(|[index]: [f64; 1]| index as u32))
    }

    /// The numbers of an accessor, all of them inside of its buffer; nothing if it has no buffer view.
    fn span(
        &self,
        document: &Document,
        index: usize,
        accessor: &Accessor,
        group: usize,
    ) -> Result<Option<Span<'_>>, ReadMeshError> {
        let Some(buffer_view) = accessor.buffer_view else {
            return Ok(None);
        };
        let part = Part {
            buffer_view,
            byte_offset: accessor.byte_offset,
            component_type: None,
        };
        let code = accessor.component_type;
        let span = self.part(document, index, &part, code, accessor.count, group)?;
        Ok(Some(Span {
            normalized: accessor.normalized && group > 1,
            ..span
        }))
    }

    fn part(
        &self,
        document: &Document,
        index: usize,
        part: &Part,
        code: u32,
        count: usize,
        group: usize,
    ) -> Result<Span<'_>, ReadMeshError> {
        let component = Component::of(code)
            .ok_or_else(|| self.fault(index, "its component type is not one of glTF"))?;
        let view = document.buffer_views.get(part.buffer_view);
        let view =
            view.ok_or_else(|| self.fault(index, "it names a buffer view that does not exist"))?;
        let bytes = self.view(view).ok_or_else(|| {
            self.fault(
                index,
                "its buffer view is not inside of a buffer that exists",
            )
        })?;
        let size = component.size() * group;
        let stride = view.byte_stride.unwrap_or(size);
        if stride < size {
            return Err(self.fault(
                index,
                "its elements overlap: the stride is smaller than an element",
            ));
        }
        let bytes = bytes.get(part.byte_offset..).unwrap_or_default();
        let needed = match count.checked_sub(1) {
            Some(last) => last
                .checked_mul(stride)
                .and_then(|before| before.checked_add(size)),
            None => Some(0),
        };
        if needed.is_none_or(|needed| needed > bytes.len()) {
            return Err(self.fault(index, "it reaches beyond the end of its buffer view"));
        }
        Ok(Span {
            bytes,
            stride,
            component,
            normalized: false,
        })
    }

    fn view(&self, view: &BufferView) -> Option<&[u8]> {
        let bytes = bytes_of(&self.all, view.buffer)?;
        let end = view.byte_offset.checked_add(view.byte_length)?;
        bytes.get(view.byte_offset..end)
    }
}

fn bytes_of(all: &[Bytes], buffer: usize) -> Option<&[u8]> {
    match all.get(buffer)? {
        Bytes::Own(bytes) => Some(bytes),
        // that one has its own
        Bytes::Shared(first) => match all.get(*first)? {
            Bytes::Own(bytes) => Some(bytes),
            Bytes::Shared(_) => None,
        },
    }
}

fn length(all: &[Bytes], buffer: usize) -> usize {
    bytes_of(all, buffer).map_or(0, <[u8]>::len)
}

/// The bytes at an address; no error if the address is not readable.
fn from_elsewhere(
    format: MeshFormat,
    buffer: &Buffer,
    uri: &str,
    origins: &mut Origins<'_, '_>,
    options: &ReadOptions,
    progress: &Progress,
) -> Result<ReservedVec<u8>, Option<ReadMeshError>> {
    let Some(resolver) = origins.resolver.as_deref_mut() else {
        return Err(Some(ReadMeshError::Unsupported {
            format,
            what: format!(
                "its data are in another file, `{}`, which cannot be reached from here; save it as GLB or with its data embedded",
                shown(uri.as_bytes())
            ),
        }));
    };
    let address = percent_decoded(uri).ok_or(None)?;
    let mut reader = resolver(&address).map_err(|error| Some(error.into()))?;
    let options = ReadOptions {
        size: None,
        ..options.clone()
    };
    let mut source = Source::new(&mut reader, &options, progress)?;
    Ok(source.bytes(u64::MAX, buffer.byte_length as u64)?)
}

/// `address` with `%20` and the like replaced.
fn percent_decoded(address: &str) -> Option<String> {
    let mut bytes = Vec::with_capacity(address.len());
    let mut rest = address.as_bytes();
    while let [first, behind @ ..] = rest {
        if *first == b'%' {
            let digits = std::str::from_utf8(behind.get(..2)?).ok()?;
            bytes.push(u8::from_str_radix(digits, 16).ok()?);
            rest = &behind[2..];
        } else {
            bytes.push(*first);
            rest = behind;
        }
    }
    String::from_utf8(bytes).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_freed_of_percent_signs() {
        assert_eq!(percent_decoded("a%20b.bin").as_deref(), Some("a b.bin"));
        assert_eq!(percent_decoded("a%2"), None);
        assert_eq!(percent_decoded("%ff"), None);
    }
}

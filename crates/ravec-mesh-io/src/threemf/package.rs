//! The archive that a 3MF file is: a ZIP with files that are stored or deflated.
//!
//! Read here and not by the crate that writes archives, because each entry of the directory takes memory of the budget, the
//! search for a name must not go through all of them, and entries may not share their bytes: sixty thousand that unpack the
//! same megabyte are a small file.

use std::collections::HashMap;
use std::hash::{BuildHasher, RandomState};
use std::io::{self, BufReader, Read};

use flate2::Crc;
use flate2::bufread::DeflateDecoder;
use ravec_memory::Reservation;
use ravec_progress::Progress;

use crate::MeshFormat;
use crate::error::{Place, ReadMeshError};
use crate::source::Source;
use ravec_memory::ReservedVec;

/// Path of the model if no relationship names another.
const DEFAULT_MODEL: &str = "3D/3dmodel.model";

/// Bytes that are unpacked at once.
const BLOCK: usize = 1 << 16;

/// Memory for unpacking: the window of 32 KiB with the tables of the decoder, and the block.
const UNPACKING: u64 = (BLOCK + (1 << 16)) as u64;

/// A file in the archive, as the directory describes it.
#[derive(Clone, Copy)]
struct Entry {
    /// Start of its name.
    name: usize,
    name_length: usize,
    is_encrypted: bool,
    method: u16,
    crc: u32,
    packed: u64,
    unpacked: u64,
    /// Offset of its own header.
    header: u64,
}

pub(super) struct Package<'a> {
    file: ReservedVec<u8>,
    entries: ReservedVec<Entry>,
    /// The first entry of each name, by the hash of the name in lower case.
    by_name: HashMap<u64, u32>,
    _of_names: Reservation,
    hash: RandomState,
    /// Packed bytes that may still be read: none twice.
    left: u64,
    progress: &'a Progress,
}

/// One unpacked file. Reserves memory for those who have to hold what they have read of it since [`Part::begin`].
pub(super) struct Part<'a> {
    reader: Box<dyn Read + 'a>,
    memory: Reservation,
    since_begin: u64,
    crc: Crc,
    entry: Entry,
    progress: &'a Progress,
    /// Why reading failed, if it did.
    pub(super) failure: Option<ReadMeshError>,
}

impl Part<'_> {
    /// Begins what is held as a whole: an element of XML.
    pub(super) fn begin(&mut self) {
        self.since_begin = 0;
    }

    fn advance(&mut self, buffer: &mut [u8]) -> Result<usize, ReadMeshError> {
        self.progress.check()?;
        let got = self.reader.read(buffer);
        let got = got.map_err(|_| damaged("a part cannot be unpacked"))?;
        self.crc.update(&buffer[..got]);
        self.since_begin += got as u64;
        // a list that grows holds its old and its new place
        self.memory
            .grow_to(UNPACKING + 3 * (self.since_begin + BLOCK as u64))?;
        let size = u64::from(self.crc.amount());
        let is_whole =
            size == self.entry.unpacked & 0xffff_ffff && self.crc.sum() == self.entry.crc;
        if got == 0 && !buffer.is_empty() && !is_whole {
            return Err(damaged(
                "a part does not have the size and sum that it should",
            ));
        }
        Ok(got)
    }
}

impl Read for Part<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.advance(buffer).map_err(|error| {
            self.failure = Some(error);
            io::Error::other("see the failure of the part")
        })
    }
}

fn unsupported(what: &str) -> ReadMeshError {
    ReadMeshError::Unsupported {
        format: MeshFormat::ThreeMf,
        what: format!("the archive cannot be unpacked: {what}"),
    }
}

fn damaged(what: &str) -> ReadMeshError {
    ReadMeshError::Unsupported {
        format: MeshFormat::ThreeMf,
        what: format!("the archive is damaged: {what}; get it again from where it came"),
    }
}

fn number<const N: usize>(file: &[u8], at: usize) -> Option<[u8; N]> {
    file.get(at..)?.first_chunk().copied()
}

fn u16_at(file: &[u8], at: usize) -> Option<u16> {
    number(file, at).map(u16::from_le_bytes)
}

fn u32_at(file: &[u8], at: usize) -> Option<u32> {
    number(file, at).map(u32::from_le_bytes)
}

fn u64_at(file: &[u8], at: usize) -> Option<u64> {
    number(file, at).map(u64::from_le_bytes)
}

/// The directory of an archive.
struct Directory {
    start: usize,
    count: u64,
    /// The number of bytes in front of the archive, which its addresses do not count.
    shift: u64,
}

impl Directory {
    /// Finds the directory by its end, which stands at the end of the file in front of a comment.
    fn find(file: &[u8]) -> Option<Self> {
        const END: usize = 22;
        let last = file.len().checked_sub(END)?;
        let first = last.saturating_sub(usize::from(u16::MAX));
        let is_end = |at: usize| {
            let comment = u16_at(file, at + 20).unwrap_or(u16::MAX);
            file[at..].starts_with(b"PK\x05\x06") && at + END + usize::from(comment) <= file.len()
        };
        let mut end = (first..=last).rev().find(|&at| is_end(at))?;
        let mut count = u64::from(u16_at(file, end + 10)?);
        let mut size = u64::from(u32_at(file, end + 12)?);
        let mut start = u64::from(u32_at(file, end + 16)?);
        // the numbers of large archives stand in a record of their own
        let locator = end.checked_sub(20);
        let locator = locator.filter(|&at| file[at..].starts_with(b"PK\x06\x07"));
        if let Some(locator) = locator {
            end = usize::try_from(u64_at(file, locator + 8)?).ok()?;
            if !file.get(end..)?.starts_with(b"PK\x06\x06") {
                return None;
            }
            count = u64_at(file, end + 32)?;
            size = u64_at(file, end + 40)?;
            start = u64_at(file, end + 48)?;
        }
        let is_there = |at: u64| {
            let at = usize::try_from(at).ok().and_then(|at| file.get(at..));
            count == 0 || at.is_some_and(|directory| directory.starts_with(b"PK\x01\x02"))
        };
        let shift = if is_there(start) {
            0
        } else {
            (end as u64).checked_sub(size)?.checked_sub(start)?
        };
        start += shift;
        is_there(start).then_some(Self {
            start: usize::try_from(start).ok()?,
            count,
            shift,
        })
    }

    /// The entry at `at`, and where the next begins.
    fn entry(&self, file: &[u8], at: usize) -> Option<(Entry, usize)> {
        const LENGTH: usize = 46;
        if !file.get(at..)?.starts_with(b"PK\x01\x02") {
            return None;
        }
        let length_at = |at| u16_at(file, at).map(usize::from);
        let (name, name_length) = (at + LENGTH, length_at(at + 28)?);
        let extra = name + name_length;
        let comment = extra + length_at(at + 30)?;
        let end = comment + length_at(at + 32)?;
        let mut large = large_numbers(file.get(extra..comment)?);
        file.get(comment..end)?;
        // those of large files stand behind, in this order
        let mut size_at = |at| {
            let size = u32_at(file, at)?;
            if size == u32::MAX {
                large.next()
            } else {
                Some(u64::from(size))
            }
        };
        let (unpacked, packed, header) = (size_at(at + 24)?, size_at(at + 20)?, size_at(at + 42)?);
        let entry = Entry {
            name,
            name_length,
            is_encrypted: u16_at(file, at + 8)? & 1 == 1,
            method: u16_at(file, at + 10)?,
            crc: u32_at(file, at + 16)?,
            packed,
            unpacked,
            header: header.checked_add(self.shift)?,
        };
        Some((entry, end))
    }
}

/// The numbers of 64 bits among the extra fields of an entry.
fn large_numbers(mut extra: &[u8]) -> impl Iterator<Item = u64> {
    let mut found: &[u8] = &[];
    while let (Some(kind), Some(length)) = (u16_at(extra, 0), u16_at(extra, 2)) {
        let end = extra.len().min(4 + usize::from(length));
        if kind == 1 {
            found = &extra[4..end];
            break;
        }
        extra = &extra[end..];
    }
    found
        .as_chunks()
        .0
        .iter()
        .map(|&bytes| u64::from_le_bytes(bytes))
}

/// The hash of a name in lower case.
fn hash_of(hash: &RandomState, name: &[u8]) -> u64 {
    use std::hash::Hasher as _;
    let mut hasher = hash.build_hasher();
    for &byte in name {
        hasher.write_u8(byte.to_ascii_lowercase());
    }
    hasher.finish()
}

impl<'a> Package<'a> {
    pub(super) fn open(mut source: Source<'a>) -> Result<Self, ReadMeshError> {
        let (budget, progress) = (source.limits.memory.clone(), source.progress);
        let file = source.rest()?;
        drop(source);
        let directory =
            Directory::find(&file).ok_or_else(|| damaged("the directory at its end is missing"))?;
        let mut entries = ReservedVec::new(&budget);
        entries.expect(directory.count);
        let mut at = directory.start;
        while (entries.len() as u64) < directory.count {
            if entries.len() % 4096 == 0 {
                progress.check()?;
            }
            let entry = directory.entry(&file, at);
            let (entry, next) = entry.ok_or_else(|| damaged("the directory is cut off"))?;
            entries.push(entry)?;
            at = next;
        }
        // twelve bytes in at most 2.3 times as many places, and a byte for each place
        let of_names = budget.reserve(40 * entries.len() as u64 + 256)?;
        let hash = RandomState::new();
        let mut by_name = HashMap::with_capacity(entries.len());
        for (i, entry) in (0_u32..).zip(entries.iter()) {
            if i % 4096 == 0 {
                progress.check()?;
            }
            let name = &file[entry.name..entry.name + entry.name_length];
            by_name.entry(hash_of(&hash, name)).or_insert(i);
        }
        Ok(Self {
            left: file.len() as u64,
            file,
            entries,
            by_name,
            _of_names: of_names,
            hash,
            progress,
        })
    }

    /// The entry called `name`, in any case and with or without a slash in front.
    fn entry(&self, name: &str) -> Option<Entry> {
        let name = name.trim_start_matches('/').as_bytes();
        let index = self.by_name.get(&hash_of(&self.hash, name))?;
        let entry = self.entries[*index as usize];
        let other = &self.file[entry.name..entry.name + entry.name_length];
        other.eq_ignore_ascii_case(name).then_some(entry)
    }

    /// The file called `name`; nothing if there is none.
    pub(super) fn part(
        &mut self,
        name: &str,
        mut memory: Reservation,
    ) -> Result<Option<BufReader<Part<'_>>>, ReadMeshError> {
        const HEADER: usize = 30;
        let Some(entry) = self.entry(name) else {
            return Ok(None);
        };
        if entry.is_encrypted {
            return Err(unsupported("it is encrypted"));
        }
        let bytes = || {
            let header = usize::try_from(entry.header).ok()?;
            let file = self.file.get(header..)?;
            file.starts_with(b"PK\x03\x04").then_some(())?;
            let length_at = |at| u16_at(file, at).map(usize::from);
            let start = HEADER + length_at(26)? + length_at(28)?;
            file.get(start..)?
                .get(..usize::try_from(entry.packed).ok()?)
        };
        let bytes = bytes().ok_or_else(|| damaged("a part is not where it should be"))?;
        let left = self.left.checked_sub(entry.packed);
        self.left = left.ok_or_else(|| damaged("its parts overlap"))?;
        let reader: Box<dyn Read> = match entry.method {
            0 => Box::new(bytes),
            8 => Box::new(DeflateDecoder::new(bytes)),
            _ => return Err(unsupported("a part is neither stored nor deflated")),
        };
        memory.grow_to(UNPACKING)?;
        let part = Part {
            reader,
            memory,
            since_begin: 0,
            crc: Crc::new(),
            entry,
            progress: self.progress,
            failure: None,
        };
        Ok(Some(BufReader::with_capacity(BLOCK, part)))
    }

    /// The name of the part that holds the model.
    pub(super) fn root(&mut self, memory: Reservation) -> Result<String, ReadMeshError> {
        if let Some(relations) = self.part("_rels/.rels", memory)? {
            let target = super::xml::root_of(relations)?;
            if let Some(target) = target {
                return Ok(target);
            }
        }
        if self.entry(DEFAULT_MODEL).is_some() {
            return Ok(DEFAULT_MODEL.to_owned());
        }
        Err(ReadMeshError::syntax(
            MeshFormat::ThreeMf,
            Place::Byte(0),
            "this archive does not hold a 3D model; if there is a mesh file inside, unpack it first",
        ))
    }
}

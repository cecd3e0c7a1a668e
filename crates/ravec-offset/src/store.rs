//! Where the surface is kept while it is made: in memory or in a storage that the caller gives, most often a temporary file.
//!
//! Tiles go into the storage with their trees, and come back from round to round. When the surface is mended it is kept as blocks:
//! cells of the tree with the polygons whose edges start in them, a thousand at most. Blocks are in the order of the curve
//! through their cells; one after the other, their polygons are in the order of the curve through their edges.
//!
//! Guarantees: what was put away is the same, bit for bit, when it is taken out.

use crate::params::OffsetError;
use crate::proof::Proof;
use crate::tile::{Edge, Patch, VertexName};
use bytemuck::{Pod, cast_slice, pod_collect_to_vec};
use glam::DVec3;
use ravec_mesh::Aabb;
use ravec_octree::{CellKey, Corner};
use std::borrow::Cow;
use std::io::{Cursor, Error, ErrorKind, Read, Result as IoResult, Seek, SeekFrom, Write};
use std::sync::Mutex;

/// A place for what does not fit in memory, empty at first: a temporary file, in general.
pub trait Storage: Read + Write + Seek + Send {}

impl<T: Read + Write + Seek + Send> Storage for T {}

/// Makes storages, one for each step that needs one.
pub type NewStorage<'a> = &'a (dyn Fn() -> IoResult<Box<dyn Storage>> + Sync);

/// A storage that is in memory after all.
#[expect(clippy::unnecessary_wraps, reason = "others may fail")]
pub(crate) fn in_memory() -> IoResult<Box<dyn Storage>> {
    Ok(Box::new(Cursor::new(Vec::new())))
}

/// How much longer than what is put there first a place in the storage is, as a divisor: what is put there again may be longer.
const SPARE: usize = 8;

/// A part of the surface, and what is known of it.
#[derive(Debug)]
pub(crate) struct Block {
    pub key: CellKey,
    pub patch: Kept,
    /// The box of its triangles.
    pub bounds: Aabb,
    pub triangles: usize,
    /// Whether nothing is wrong with the patch.
    pub is_proved: bool,
}

/// A patch, or where it is.
#[derive(Debug)]
pub(crate) enum Kept {
    Here(Patch),
    There(Record),
}

/// A place in the storage.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Record {
    at: u64,
    bytes: usize,
    room: usize,
}

/// A storage, used by several threads.
pub(crate) struct Scratch {
    storage: Mutex<Box<dyn Storage>>,
}

impl std::fmt::Debug for Scratch {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Scratch").finish_non_exhaustive()
    }
}

impl Scratch {
    pub fn new(storage: NewStorage<'_>) -> Result<Self, OffsetError> {
        let storage = storage().map_err(failed)?;
        Ok(Self {
            storage: Mutex::new(storage),
        })
    }

    /// Writes bytes, if they fit there in the place of others.
    pub fn put(&self, bytes: &[u8], instead: Option<Record>) -> Result<Record, OffsetError> {
        let write = || {
            let mut storage = self.storage.lock().map_err(|_| poisoned())?;
            let reused = instead.filter(|record| record.room >= bytes.len());
            let record = if let Some(record) = reused {
                storage.seek(SeekFrom::Start(record.at))?;
                storage.write_all(bytes)?;
                record
            } else {
                let room = bytes.len() + bytes.len() / SPARE;
                let at = storage.seek(SeekFrom::End(0))?;
                storage.write_all(bytes)?;
                let spare = (room - bytes.len()) as u64;
                std::io::copy(&mut std::io::repeat(0).take(spare), &mut **storage)?;
                let bytes = bytes.len();
                Record { at, bytes, room }
            };
            let bytes = bytes.len();
            Ok(Record { bytes, ..record })
        };
        write().map_err(failed)
    }

    /// What was written.
    pub fn get(&self, record: Record) -> Result<Vec<u8>, OffsetError> {
        let read = || {
            let mut bytes = vec![0; record.bytes];
            let mut storage = self.storage.lock().map_err(|_| poisoned())?;
            storage.seek(SeekFrom::Start(record.at))?;
            storage.read_exact(&mut bytes)?;
            Ok(bytes)
        };
        read().map_err(failed)
    }

    /// What a patch was written as.
    pub fn patch(&self, record: Record) -> Result<Patch, OffsetError> {
        decoded(&self.get(record)?).ok_or_else(damaged)
    }
}

/// Says that something is not what was written.
pub(crate) fn damaged() -> OffsetError {
    let cause = "its content is not what was written";
    failed(Error::new(ErrorKind::InvalidData, cause))
}

#[expect(
    clippy::needless_pass_by_value,
    reason = "taken as it comes from a result"
)]
fn failed(cause: Error) -> OffsetError {
    OffsetError::Storage {
        cause: cause.to_string(),
    }
}

fn poisoned() -> Error {
    Error::other("another thread failed while it used it")
}

/// Where blocks are.
#[derive(Debug)]
pub(crate) enum Store {
    Memory,
    Storage(Scratch),
}

impl Store {
    /// Puts a patch away.
    pub fn put(&self, patch: Patch) -> Result<Kept, OffsetError> {
        match self {
            Self::Storage(scratch) if !patch.triangles.is_empty() => {
                Ok(Kept::There(scratch.put(&encoded(&patch), None)?))
            }
            Self::Storage(_) | Self::Memory => Ok(Kept::Here(patch)),
        }
    }

    /// What was put away.
    pub fn get<'a>(&self, kept: &'a Kept) -> Result<Cow<'a, Patch>, OffsetError> {
        match (self, kept) {
            (_, Kept::Here(patch)) => Ok(Cow::Borrowed(patch)),
            (Self::Storage(scratch), &Kept::There(record)) => {
                Ok(Cow::Owned(scratch.patch(record)?))
            }
            (Self::Memory, Kept::There(_)) => unreachable!("memory puts nothing elsewhere"),
        }
    }
}

/// Bytes that are read as numbers, from the first to the last.
pub(crate) struct Bytes<'a>(pub &'a [u8]);

impl Bytes<'_> {
    /// The next `count` of them, if there are so many.
    pub fn take<T: Pod>(&mut self, count: u64) -> Option<Vec<T>> {
        let bytes = usize::try_from(count).ok()?.checked_mul(size_of::<T>())?;
        let (taken, rest) = self.0.split_at_checked(bytes)?;
        self.0 = rest;
        Some(pod_collect_to_vec(taken))
    }
}

/// The kinds of names, in a storage.
const SHEET: u32 = 0;
const IN_FACE: u32 = 1;
const ON_EDGE: u32 = 2;

/// What stands for the arrays of a patch: their lengths, and then their numbers as they lie in memory.
pub(crate) fn encoded(patch: &Patch) -> Vec<u8> {
    let lengths = [
        patch.positions.len(),
        patch.triangles.len(),
        patch.edges.len(),
        patch.ample.len(),
        patch.leaves.len(),
        patch.proofs.len(),
    ];
    let positions: Vec<[f64; 3]> = patch.positions.iter().map(DVec3::to_array).collect();
    let names: Vec<[u32; 6]> = patch.names.iter().map(|&name| name_row(name)).collect();
    let edge = |edge: &Edge| {
        let [x, y, z] = edge.start.0;
        [x, y, z, edge.length, edge.axis.into()]
    };
    let edges: Vec<[u32; 5]> = patch.edges.iter().map(edge).collect();
    let proofs: Vec<u64> = patch.proofs.iter().map(|&p| Proof::to_bits(p)).collect();
    let ample: Vec<u8> = patch.ample.iter().map(|&is| is.into()).collect();
    [
        cast_slice(&lengths.map(|length| length as u64)),
        cast_slice(&positions),
        cast_slice(&names),
        cast_slice(&patch.triangles),
        cast_slice(&patch.edge_of),
        cast_slice(&edges),
        cast_slice(&patch.leaves),
        cast_slice(&proofs),
        &ample,
    ]
    .concat()
}

fn decoded(bytes: &[u8]) -> Option<Patch> {
    let mut bytes = Bytes(bytes);
    let lengths: Vec<u64> = bytes.take(6)?;
    let lengths: [u64; 6] = lengths.try_into().ok()?;
    let [vertices, triangles, edges, ample, leaves, proofs] = lengths;
    let positions: Vec<[f64; 3]> = bytes.take(vertices)?;
    let names: Vec<[u32; 6]> = bytes.take(vertices)?;
    let triangles_of: Vec<[u32; 3]> = bytes.take(triangles)?;
    let edge_of: Vec<u32> = bytes.take(triangles)?;
    let edges: Vec<[u32; 5]> = bytes.take(edges)?;
    let leaves = bytes.take(leaves)?;
    let proofs: Vec<u64> = bytes.take(proofs)?;
    let ample: Vec<u8> = bytes.take(ample)?;
    let edges = edges.into_iter().map(|[x, y, z, length, axis]| Edge {
        start: Corner([x, y, z]),
        length,
        axis: axis as u8,
    });
    Some(Patch {
        positions: positions.into_iter().map(DVec3::from).collect(),
        names: names.into_iter().map(named).collect::<Option<_>>()?,
        triangles: triangles_of,
        edge_of,
        edges: edges.collect(),
        ample: ample.into_iter().map(|is| is != 0).collect(),
        leaves,
        proofs: proofs.into_iter().map(Proof::from_bits).collect(),
    })
}

fn name_row(name: VertexName) -> [u32; 6] {
    let row = |kind, at: Corner, a, b| [kind, at.0[0], at.0[1], at.0[2], a, b];
    match name {
        VertexName::Sheet { leaf, number } => row(SHEET, leaf, number, 0),
        VertexName::InFace { start, axis, side } => row(IN_FACE, start, axis.into(), side.into()),
        VertexName::OnEdge { start, axis } => row(ON_EDGE, start, axis.into(), 0),
    }
}

fn named([kind, x, y, z, a, b]: [u32; 6]) -> Option<VertexName> {
    let start = Corner([x, y, z]);
    match kind {
        SHEET => Some(VertexName::Sheet {
            leaf: start,
            number: a,
        }),
        IN_FACE => Some(VertexName::InFace {
            start,
            axis: a as u8,
            side: b as u8,
        }),
        ON_EDGE => Some(VertexName::OnEdge {
            start,
            axis: a as u8,
        }),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn patch() -> Patch {
        let start = Corner([1, 1 << 20, 77]);
        Patch {
            positions: vec![DVec3::new(0.1, -2.0, 3e40), DVec3::X, DVec3::Y, DVec3::Z],
            names: vec![
                VertexName::Sheet {
                    leaf: start,
                    number: 3,
                },
                VertexName::InFace {
                    start,
                    axis: 2,
                    side: 1,
                },
                VertexName::OnEdge { start, axis: 1 },
                VertexName::OnEdge { start, axis: 0 },
            ],
            triangles: vec![[0, 1, 2], [2, 1, 3]],
            edge_of: vec![0, 1],
            edges: [4, 8]
                .map(|length| Edge {
                    start,
                    length,
                    axis: 2,
                })
                .to_vec(),
            ample: vec![true, false],
            leaves: vec![],
            proofs: vec![],
        }
    }

    #[test]
    fn what_is_put_away_comes_out_as_it_was() {
        let store = Store::Storage(Scratch::new(&in_memory).unwrap());
        let first = store.put(patch()).unwrap();
        let none = store.put(Patch::default()).unwrap();
        let other = || Patch {
            ample: vec![],
            leaves: vec![[1, 2, 3, 4], [5, 6, 7, u32::MAX]],
            proofs: vec![Proof::from_bits(77), None],
            ..patch()
        };
        let second = store.put(other()).unwrap();
        assert_eq!(*store.get(&first).unwrap(), patch());
        assert_eq!(*store.get(&none).unwrap(), Patch::default());
        assert_eq!(*store.get(&second).unwrap(), other());
    }

    #[test]
    fn places_are_used_again_for_what_fits() {
        let scratch = Scratch::new(&in_memory).unwrap();
        let first = scratch.put(&[1; 80], None).unwrap();
        let after = scratch.put(&[2; 8], None).unwrap();
        let longer = scratch.put(&[3; 90], Some(first)).unwrap();
        assert_eq!(longer.at, first.at);
        let too_long = scratch.put(&[4; 91], Some(longer)).unwrap();
        assert!(too_long.at > after.at);
        let shorter = scratch.put(&[5; 2], Some(longer)).unwrap();
        for (record, expected) in [
            (after, &[2; 8][..]),
            (too_long, &[4; 91]),
            (shorter, &[5; 2]),
        ] {
            assert_eq!(scratch.get(record).unwrap(), expected);
        }
    }

    #[test]
    fn what_is_not_a_patch_is_refused() {
        let bytes = encoded(&patch());
        for cut in 0..bytes.len() {
            assert!(decoded(&bytes[..cut]).is_none(), "{cut} bytes");
        }
        let mut bytes = bytes;
        bytes[..8].fill(255);
        assert!(decoded(&bytes).is_none());
    }
}

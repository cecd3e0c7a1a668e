//! The data that all later steps exchange: patches, their proofs, the reach of a tile and the edits of its tree.

mod bytes;
mod checks;
mod edits;
mod patch;
mod patch_update;
mod proof;
mod reach;

pub(crate) use bytes::Bytes;
pub(crate) use checks::{border, compact, doubled, intersecting_pairs};
pub(crate) use edits::Edits;
pub(crate) use patch::{Edge, Patch, TRIANGLES_AT_ONCE, VertexName};
pub(crate) use proof::{Proof, ProofStart, Room};
pub(crate) use reach::{RINGS, Reach};

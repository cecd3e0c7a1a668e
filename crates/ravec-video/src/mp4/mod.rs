//! MP4 and QuickTime files with H.264.
//!
//! [`Mp4Source`] reads a file: the tables of its samples are read from the atoms `moov` and `moof` as they are, so that they
//! take memory in proportion to the file and not to the numbers that it states; the order of display comes from time stamps and
//! edit lists; each picture belongs to the sample that holds it. [`Mp4Writer`] encodes frames and writes their stamps as they
//! are. [`CopiedTracks`] brings sound and subtitles of a file along, byte for byte. [`concatenate`] joins files of `Mp4Writer`
//! without encoding anew.
//!
//! The atoms are read and written here and not by a crate: sample entries of other tracks must survive byte for byte, tables
//! must stay in the compact form of the file, and a damaged file must give the frames before its damage.
//!
//! Guarantees: no panic on any bytes; memory for tables of at most 16 times the length of the file, and 40 times if it is in
//! fragments, taken from the budget of the limits before it is allocated; stamps in ticks of the track, unchanged; after
//! [`seek`](crate::FrameSource::seek) the same frames as without.
//!
//! Does not guarantee: samples of B-frames with direct prediction to the last bit, because the loop filter of the decoder is
//! off by a few steps beside edges of a few blocks (74 dB and more in all clips that were tried; other frames are exact); that
//! every file which some player opens is read. Encryption, edit lists that repeat or reorder parts, mirrored frames, and
//! pictures that the decoder does not know are refused with [`VideoError::Unsupported`], and are left to FFmpeg. The C++ code of
//! the decoder sees only parameter sets and sizes that were checked here; what its own faults may do to the process is its own.
//!
//! [`VideoError::Unsupported`]: crate::VideoError::Unsupported

mod atom;
mod concat;
mod copy;
mod fragments;
mod matrix;
mod movie;
mod mux;
mod samples;
mod sink;
mod source;
mod timeline;
mod write;

pub use concat::concatenate;
pub use copy::CopiedTracks;
pub use sink::Mp4Writer;
pub use source::Mp4Source;

use std::io::{Read, Seek};

/// A file that is read at any place.
pub trait ReadSeek: Read + Seek + Send {}

impl<R: Read + Seek + Send> ReadSeek for R {}

//! H.264 pictures: parameter sets, decoding and encoding by OpenH264.
//!
//! Parameter sets are parsed here, for three reasons: sizes are checked before the codec sees them, color tags and cropping are
//! those of the stream, and what the codec cannot decode is refused with a name before the first frame.
//!
//! The decoder gets a rewritten sequence parameter set (see [`Sps::for_decoder`]), by which it hands out each picture with the
//! sample that holds it. Its own reordering for display returns at most one picture a call and does not say which one; with
//! the order of the samples and the time stamps of the file, the order of display is exact, also beside damaged samples.

mod bits;
mod decoder;
mod encoder;
mod nal;
mod sps;
mod vui;

pub(crate) use decoder::{AvcDecoder, Crop, decoder_bytes};
pub(crate) use encoder::{AvcEncoder, EncoderSettings};
pub(crate) use nal::AvcConfig;
pub(crate) use sps::Sps;
pub(crate) use vui::Vui;

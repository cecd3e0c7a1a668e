//! Picture files: reading what people have, writing it back like it was.
//!
//! [`read`] finds the format from the content, turns the picture upright, brings its colors to sRGB by the embedded
//! profile and says in [`Picture::warnings`] what it had to guess. [`write()`] puts a result into a file like its source:
//! same sample kind, same color space, same EXIF block, whole or not at all.
//!
//! ```
//! use ravec_media::{Limits, Picture, WriteOptions, read, write};
//! use ravec_raster::{Image, LinearRgba, Size, Srgb};
//!
//! let folder = tempfile::tempdir()?;
//! let path = folder.path().join("ramp.png");
//! let ramp = Image::from_fn(Size::new(16, 4)?, |col, _| Srgb([16 * col as u8; 3]));
//! write(&path, &Picture::from_image(ramp.clone()), &WriteOptions::default())?;
//!
//! let picture = read(&path, &Limits::default())?;
//! assert_eq!(picture.convert::<Srgb<u8>>(), ramp);
//!
//! // work in linear light, written like the source
//! let darker = picture.convert::<LinearRgba>().map(|p| LinearRgba::from_rgb_alpha(p.rgb().map(|v| v / 2.0), p.alpha()));
//! write(&path, &picture.with_image(&darker), &WriteOptions::default())?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! | format | read | written |
//! | --- | --- | --- |
//! | PNG | 1 to 16 bit, gray, palette, alpha | 8, 16 bit, gray, alpha |
//! | JPEG | gray, color, CMYK | 8 bit, gray, color |
//! | WebP | lossy, lossless, alpha | lossless, 8 bit, alpha |
//! | TIFF | 8, 16 bit, float, gray, alpha, CMYK | 8, 16 bit, float, gray, alpha |
//! | BMP | 1 to 32 bit | 8 bit, gray, alpha |
//! | `OpenEXR` | half and full float, alpha | float, alpha |
//! | Radiance HDR | color | color |
//!
//! Guarantees: integer samples in sRGB survive reading and writing exactly, and so do those of other RGB and gray spaces
//! whose profile is curves and a matrix (the module `profile` says how exactly); hostile files give an error, within
//! [`Limits`]. Does not guarantee: metadata other than the profile and EXIF; frames after the first; colors outside sRGB
//! from profiles made of tables.

mod curve;
mod exr;
mod format;
mod jpeg;
mod lens;
mod limits;
mod opened;
mod orient;
mod picture;
mod png;
mod profile;
mod quantization;
mod raster;
mod read;
mod rows;
mod samples;
mod standard;
mod taken;
mod tiff;
mod webp;
mod write;

pub use format::Format;
pub use lens::focal_px_from_35mm;
pub use limits::Limits;
pub use picture::{Origin, Picture, SampleKind, Warning, WarningKind};
pub use quantization::Quantization;
pub use read::{
    DecodeError, Probe, ReadError, decode, decode_reduced, memory_to_decode, probe, probe_data,
    read,
};
pub use rows::{RowsError, write_rows};
pub use write::{EncodeError, ProfileChoice, WriteError, WriteOptions, encode, write};

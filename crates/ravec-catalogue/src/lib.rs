//! Photos known by what they look like: a catalogue in one file, and mosaics made from it.
//!
//! [`add()`] looks at photos once and remembers a small picture of each; [`mosaic()`] chooses among them (see `ravec-mosaic`)
//! and writes the mosaic row by row of tiles: as a picture, and as a folder with a page that zooms into its photos.
//!
//! ```
//! use ravec_catalogue::{Catalogue, add, stats};
//! use ravec_media::{Limits, Picture, WriteOptions, write};
//! use ravec_progress::Progress;
//! use ravec_raster::{Image, Size, Srgb};
//!
//! let folder = tempfile::tempdir()?;
//! let ramp = Image::from_fn(Size::new(90, 60)?, |col, row| Srgb([2 * col as u8, 4 * row as u8, 90]));
//! write(folder.path().join("ramp.png"), &Picture::from_image(ramp), &WriteOptions::default())?;
//!
//! let progress = Progress::none();
//! let mut catalogue = Catalogue::open_or_make(&folder.path().join("photos.ravec"), &progress)?;
//! let paths = [folder.path().to_path_buf()];
//! assert_eq!(add(&mut catalogue, &paths, &Limits::default(), &progress)?.new, 1);
//! // what is known is not examined again
//! assert_eq!(add(&mut catalogue, &paths, &Limits::default(), &progress)?.unchanged, 1);
//! assert_eq!(stats(&catalogue)?.landscape, 1);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Guarantees: the catalogue is valid whenever the program ends or the power fails (see [`Catalogue`]); several processes may
//! use it at once; photos are only read, and neither a mosaic nor its page takes the place of a photo that is known; in a mosaic, each tile is the scaled photo bit for bit (in JPEG, as far as its compression lets it). Does not guarantee:
//! that files which changed without a change of size and time are noticed.
//!
//! Memory: within the budget of [`Limits`](ravec_media::Limits), whatever the number of threads: a photo waits for its share, and
//! is refused only if it alone exceeds what all photos have together. Of a mosaic, a row of tiles (or less, if the budget is
//! small), the photos that are being scaled, and those that are kept for later rows; for a page that zooms, 768 rows of pixels
//! more; of the catalogue, 5 KB a photo.

mod add;
mod by_hand;
mod catalogue;
mod deep_zoom;
mod error;
mod layout;
mod manage;
mod mosaic;
mod painter;
mod photo_set;
mod pieces;
mod plan;
mod pyramid;
mod thumbnail;
mod workers;

pub use add::{Added, add, would_read};
pub use by_hand::{Ban, Pin};
pub use catalogue::{Catalogue, Entry, belongs_to_catalogue, leads_into};
pub use error::CatalogueError;
pub use manage::{Dropped, Stats, clean, remove, stats};
pub use mosaic::{Mosaic, MosaicParams, Outputs, mosaic, mosaic_in_memory, mosaic_in_pieces};
pub use photo_set::{PhotoSet, TileCandidate};
pub use pieces::MosaicWorker;

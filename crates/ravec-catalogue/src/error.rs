//! Why something could not be done with a catalogue.

use ravec_media::WriteError;
use ravec_mosaic::ChooseError;
use ravec_progress::Cancelled;
use ravec_raster::Rect;
use std::path::PathBuf;

/// Why something could not be done with a catalogue.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CatalogueError {
    /// There is no such catalogue.
    #[error("there is no catalogue {}: make one with ravec library add", .path.display())]
    NoCatalogue {
        /// The file.
        path: PathBuf,
    },
    /// The file is something else.
    #[error("{} is not a catalogue of photos", .path.display())]
    NotACatalogue {
        /// The file.
        path: PathBuf,
    },
    /// The catalogue has a format that is not known yet.
    #[error(
        "the catalogue {} has format {format} of a newer version, but this one reads formats up to {known}: update the program",
        .path.display()
    )]
    Newer {
        /// The file.
        path: PathBuf,
        /// Its format.
        format: i64,
        /// The newest format that is known.
        known: i64,
    },
    /// The catalogue is not as it was written.
    #[error("the catalogue {} is damaged: {reason}; make a new one with ravec library add", .path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// Description of the defect.
        reason: String,
    },
    /// Another process has the catalogue.
    #[error("the catalogue {} is busy: another process has been using it for more than a minute", .path.display())]
    Busy {
        /// The file.
        path: PathBuf,
        /// `true` if it was to be changed.
        writing: bool,
    },
    /// The catalogue cannot be read.
    #[error("cannot read the catalogue {}: {reason}", .path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Message of the database.
        reason: String,
    },
    /// The catalogue cannot be changed or made.
    #[error("cannot write the catalogue {}: {reason}", .path.display())]
    Change {
        /// The file.
        path: PathBuf,
        /// Message of the database.
        reason: String,
    },
    /// The photos of the catalogue need more memory than allowed.
    #[error("the photos of the catalogue {} need more than the limit of {limit} bytes (raise `max_bytes`)", .path.display())]
    Memory {
        /// The file.
        path: PathBuf,
        /// The limit in bytes.
        limit: u64,
    },
    /// The threads for the work cannot be started.
    #[error("cannot start the threads for the photos: {reason}; use fewer `threads`")]
    Threads {
        /// Message of the system.
        reason: String,
    },
    /// A piece of the work failed in another process.
    #[error("a piece of the work failed: {reason}")]
    Piece {
        /// Error of the piece.
        reason: String,
    },
    /// The mosaic would have more pixels than allowed.
    #[error(
        "the mosaic would have {width} x {height} pixels, more than the limit of {limit} (raise `max_pixels`)"
    )]
    TooManyPixels {
        /// Of the mosaic.
        width: usize,
        /// Of the mosaic.
        height: usize,
        /// The most pixels.
        limit: u64,
    },
    /// Making the mosaic needs more memory than allowed.
    #[error(
        "the mosaic needs {needed} bytes of memory for {purpose}, more than the limit of {limit} leaves (raise `max_bytes`)"
    )]
    MosaicMemory {
        /// Use of the memory.
        purpose: &'static str,
        /// Bytes.
        needed: u64,
        /// The limit in bytes.
        limit: u64,
    },
    /// An output would take the place of something that is read.
    #[error("cannot write {}: {reason}; choose another name", .path.display())]
    Protected {
        /// The file or folder.
        path: PathBuf,
        /// Reason for the protection.
        reason: &'static str,
    },
    /// A file to add does not exist.
    #[error("cannot add {}: {reason}", .path.display())]
    Add {
        /// The file or folder.
        path: PathBuf,
        /// Message of the system.
        reason: String,
    },
    /// There is no photo to choose from.
    #[error("the catalogue {} has no photo that can be used: add some with ravec library add", .path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// No photo has the proportions of a tile.
    #[error(
        "none of the {photos} photos has the proportions of a tile of {width} x {height} pixels: choose another `tile_size`, or \
         allow `crop` center"
    )]
    NoneFits {
        /// Photos in the catalogue.
        photos: usize,
        /// Of a tile.
        width: usize,
        /// Of a tile.
        height: usize,
    },
    /// The picture has fewer pixels than the mosaic has tiles.
    #[error(
        "the picture has {width} x {height} pixels, too few for {columns} x {rows} tiles: ask for fewer tiles"
    )]
    PictureTooSmall {
        /// Of the picture.
        width: usize,
        /// Of the picture.
        height: usize,
        /// Of tiles.
        columns: usize,
        /// Of tiles.
        rows: usize,
    },
    /// The mosaic would be too large.
    #[error(
        "{columns} x {rows} tiles of {width} x {height} pixels make a picture too large to hold: ask for fewer or smaller tiles"
    )]
    TooLarge {
        /// Of tiles.
        columns: usize,
        /// Of tiles.
        rows: usize,
        /// Of a tile.
        width: usize,
        /// Of a tile.
        height: usize,
    },
    /// Thirds of tiles would not have whole pixels.
    #[error(
        "an adaptive mosaic has tiles of thirds of {width} x {height} pixels, which are not whole: choose a `tile_size` of \
         multiples of 3"
    )]
    NoThirds {
        /// Of a tile.
        width: usize,
        /// Of a tile.
        height: usize,
    },
    /// A photo that is set by hand is not known.
    #[error(
        "the catalogue {} has no photo {} that can be used: ravec library list names its photos",
        .catalogue.display(), .photo.display()
    )]
    NoSuchPhoto {
        /// The file of the catalogue.
        catalogue: PathBuf,
        /// The photo.
        photo: PathBuf,
    },
    /// A photo that is pinned cannot be used.
    #[error("cannot pin {}: it {reason}", .photo.display())]
    CannotPin {
        /// The photo.
        photo: PathBuf,
        /// The flaw.
        reason: &'static str,
    },
    /// A tile that is set by hand is not in the grid.
    #[error(
        "there is no tile {col},{row}: the grid has {columns} columns and {rows} rows, counted from 0"
    )]
    NoSuchTile {
        /// Column of the tile.
        col: usize,
        /// Row of the tile.
        row: usize,
        /// Columns of the grid.
        columns: usize,
        /// Rows of the grid.
        rows: usize,
    },
    /// A rectangle is not that of a tile.
    #[error(
        "no tile can have {} x {} pixels at column {} and row {} of the mosaic",
        .place.width, .place.height, .place.col, .place.row
    )]
    NoSuchPlace {
        /// The rectangle in pixels.
        place: Rect,
    },
    /// Two photos are pinned to one tile.
    #[error("two photos are pinned to tile {col},{row}: remove one of the pins")]
    PinnedTwice {
        /// Column of the tile.
        col: usize,
        /// Row of the tile.
        row: usize,
    },
    /// A photo is pinned and banned.
    #[error("{} is both pinned and banned: remove the pin or the ban", .photo.display())]
    PinnedAndBanned {
        /// The photo.
        photo: PathBuf,
    },
    /// Tiles off the grid cannot be named.
    #[error(
        "the tiles of an adaptive mosaic have no columns and rows: pin photos and ban them at single tiles without `adaptive`"
    )]
    NoGrid,
    /// No photo is left for a tile.
    #[error(
        "no photo is left for tile {col},{row} beside those that are banned or used up: lift a ban"
    )]
    NothingLeft {
        /// Column of the tile.
        col: usize,
        /// Row of the tile.
        row: usize,
    },
    /// Photos cannot be put into tiles under the rules.
    #[error(transparent)]
    Choose(ChooseError),
    /// The mosaic cannot be written.
    #[error(transparent)]
    Write(WriteError),
    /// The caller cancelled the work.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

impl From<ChooseError> for CatalogueError {
    fn from(error: ChooseError) -> Self {
        match error {
            ChooseError::Cancelled(cancelled) => Self::Cancelled(cancelled),
            error => Self::Choose(error),
        }
    }
}

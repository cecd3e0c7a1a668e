//! Genuine image mosaics: pictures made of whole, unchanged photos.
//!
//! Seen from afar, a mosaic is the picture; seen from near, it is photos that were scaled and, on request, cropped,
//! but never recolored or overlaid. The choice of the photos alone makes the likeness.
//!
//! ```
//! use ravec_mosaic::{ChooseParams, Frame, Descriptor, Photos, Rules, choose, grid_tiles};
//! use ravec_progress::Progress;
//! use ravec_raster::{Image, Oklab, Size, Srgb};
//!
//! // twenty "photos", each of one gray, and a picture that fades from black to white
//! let gray = |value: usize| Image::new(Size::new(8, 8).unwrap(), Srgb([value as u8; 3])).convert::<Oklab>();
//! let descriptors: Vec<Descriptor> =
//!     (0..20).map(|i| gray(13 * i)).map(|photo| Descriptor::of(&photo, Frame::of(&photo), 3)).collect();
//! let fade = Image::from_fn(Size::new(60, 40)?, |col, _| Srgb([(col * 4) as u8; 3])).convert::<Oklab>();
//!
//! let progress = Progress::none();
//! let params = ChooseParams::default();
//! let tiling = grid_tiles(&fade, Frame::of(&fade), 6, 4, params.weights.degree, &progress)?;
//! let photos = Photos::new(&descriptors, (0..20).collect(), &params);
//! let rules = Rules { max_uses: Some(2), min_repeat_distance: 0.0, ..Rules::default() };
//! let choice = choose(&tiling, &photos, &rules, &params, &progress)?;
//! assert!(choice.photos[0] < choice.photos[5], "dark photos on the left");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! | for | use |
//! | --- | --- |
//! | the appearance of a photo or a tile | [`Descriptor`], [`Weights`] |
//! | the nearest photos, exactly | [`PhotoIndex`] |
//! | photos that are one to the eye | [`near_duplicates`] |
//! | photos not worth a tile | [`flaw`] |
//! | tiles of a picture | [`grid_tiles`], [`adaptive_tiles`], [`mark_features`] |
//! | which photo goes where | [`choose()`], [`Rules`], [`violations`] |
//! | searches by other processes | [`Photos::searches`], [`choose_found`] |
//! | photos that are set by hand | [`choose_by_hand`], [`ByHand`], [`Photos::ban`], [`Photos::nearest`] |
//! | a photo as it stands in a tile | [`scaled_photo`], [`Crop`] |
//!
//! Guarantees: rules hold or an error says why they cannot; the same choice on any number of threads. Does not
//! guarantee: the best mosaic under a repeat distance; the distance of its cost from a lower bound is reported.
//!
//! Words: the *descriptor* of a tile is its appearance from afar as numbers. A *group* is photos that are near-duplicates. *Genuine* is
//! a tile that is the scaled photo, bit for bit.
//!
//! # Current status
//!
//! There are no files here: see `ravec-catalogue`.

mod adaptive;
mod basis;
mod by_hand;
mod choose;
mod clean;
mod descriptor;
mod eye;
mod feature;
mod fill;
mod groups;
mod improve;
mod optimal;
mod retile;
mod rules;
mod search;
mod tile;
mod tiling;

pub use adaptive::{ADAPTIVE_UNITS, adaptive_tiles};
pub use by_hand::{ByHand, TilePhoto};
pub use choose::{
    Choice, ChooseParams, Features, Photos, TileSearch, choose, choose_by_hand, choose_found,
};
pub use clean::{Flaw, MIN_SIDE, flaw};
pub use descriptor::{Describer, Descriptor, Frame, MAX_DEGREE, Weights};
pub use feature::mark_features;
pub use groups::{NEAR_DUPLICATE, near_duplicates};
pub use rules::{ChooseError, Rules, violations};
pub use search::{Near, PhotoIndex};
pub use tile::{Crop, SAME_PROPORTIONS, scaled_photo};
pub use tiling::{Tile, Tiling, grid_tiles};

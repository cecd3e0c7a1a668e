//! Image completion: holes filled from the rest of a picture, in perspective where planes are known.
//!
//! A lamp post goes, and the wall behind it comes back. The scene behind it is in no pixel; but walls, floors, grass
//! and water look alike elsewhere, and on a plane they do so once the perspective is taken out.
//!
//! ```
//! use glam::dvec2;
//! use ravec_completion::{CompleteParams, complete};
//! use ravec_planar::Homography;
//! use ravec_progress::Progress;
//! use ravec_raster::{Image, Mask, Rect, Size, Srgb};
//!
//! // a wall of panels seen from the side, and something in front of it
//! let size = Size::new(200, 150)?;
//! let quad = [dvec2(5.0, 5.0), dvec2(190.0, 40.0), dvec2(190.0, 110.0), dvec2(5.0, 145.0)];
//! let wall_from_image = Homography::from_unit_square(quad)?.inverse();
//! let wall = Image::from_fn(size, |col, row| {
//!     let at = 14.0 * wall_from_image.apply(dvec2(col as f64 + 0.5, row as f64 + 0.5));
//!     let groove = at.x.rem_euclid(1.0).min(at.y.rem_euclid(1.0)) < 0.15;
//!     Srgb(if groove { [60u8, 50, 40] } else { [190, 170, 140] })
//! });
//! let post = Mask::from_rect(size, Rect::new(80, 60, 16, 30));
//! let seen = Image::from_fn(size, |col, row| if post.at(col, row) > 0.0 { Srgb([0; 3]) } else { wall[(col, row)] });
//!
//! let free = complete(&seen, &post, &[quad], &CompleteParams::default(), &Progress::none())?;
//! let error = |image: &Image<Srgb<u8>>| -> f64 {
//!     let pairs = image.pixels().iter().zip(wall.pixels());
//!     pairs.map(|(a, b)| f64::from(a.0[0].abs_diff(b.0[0]))).sum::<f64>() / post.area_px()
//! };
//! assert!(error(&free.image) < 25.0 && error(&seen) > 100.0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # How
//!
//! 1. Parts thinner than a few pixels are interpolated.
//! 2. Parts on a plane are filled in the rectified view, the rest in the picture itself.
//! 3. A few searches by Fourier transform propose offsets at which the surroundings look alike.
//! 4. One graph cut gives each pixel the offset that it is copied from.
//! 5. Offsets are refined to a fraction of a pixel, coordinates composed, and the original is sampled once.
//! 6. Along seams gradients are averaged, and tones are bent to those of the rim.
//!
//! # By hand
//!
//! The other engine copies fragments one by one. A [`FragmentIndex`] holds what may be copied from: the picture, rectified
//! views of planes, other photos, each also turned, mirrored and scaled on request. A [`Retouch`] finds the best
//! sources for a target, lays one of them over it, and keeps a log of such steps, which can be changed, done again and
//! undone. Structure that should go on may be marked. [`Retouch::fill`] takes the steps by itself; for a hole that nobody
//! looks after, [`complete()`] is the better engine, because it weighs the whole hole at once.
//!
//! # Guarantees
//!
//! - Pixels that the mask does not cover come back bit for bit.
//! - The same steps on the same pictures give the same bytes, and an undone step leaves no trace.
//! - A match is known as a whole, and its mismatch is what direct sums say.
//! - Copied pixels are sampled once, from the original.
//! - The same bytes on any number of threads.
//!
//! # Not guaranteed
//!
//! - That what was there comes back: only that it goes on like its surroundings. Faces, letters and whatever is in the
//!   picture only once are beyond it.
//! - That the search from coarse to fine finds what the full one does. On photos it did in all of 310 queries.
//! - The same last bits on machines with other vector units, for which the transforms have other code.
//!
//! # Words
//!
//! *Hole*: the pixels to be replaced. *Rim*: the known pixels around it. *Offset*: the shift from a pixel of the hole to
//! its source. *Fragment*: a disc or square of pixels, copied at once. *Buffer*: a view of a photo in which sources are looked
//! for. *Variant*: a way of turning, mirroring and scaling a copy. *Feature*: a pixel on structure that should go on. *Sheet*: the flat view in which offsets are searched. *Seam*: where pixels with different offsets meet.
//!
//! # Current status
//!
//! Both engines are complete. Fragments come from original pixels only, never from what a step has filled.

mod blend;
mod canvas;
mod complete;
mod compose;
mod cut;
mod error;
mod fragments;
mod guidance;
mod max_flow;
mod parts;
mod proposals;
mod rectified;
mod sheet;
mod subpixel;
mod thin;

pub use complete::{CompleteParams, CompleteSummary, Completed, complete};
pub use error::CompleteError;
pub use fragments::{
    FillOptions, FillSummary, FragmentIndex, Match, Retouch, RetouchState, SearchOptions, Shape,
    SourceFragment, Sources, Step, Target, Variant,
};

//! The place of a photo of the plane in a frame.
//!
//! ```text
//! features of the photo and of the plane's region in the frame, matched; from other sides if that fails
//! of the two pictures, the one that sees less of the plane is the reference; warp the other one onto it by the present map,
//!     each pixel filtered once, in linear light, so that both are as sharp
//! align the warped picture to the reference as a tracker aligns a frame; correct the map; again, until it settles
//! give the warped picture the tones of the reference in between: another camera has another curve
//! ```
//!
//! Points are in pixels, x right, y down, pixel centers at half-integers.
//!
//! Sources: those of `match_photos`, of [`warp`] and of [`PlaneTracker`].
//!
//! Guarantees: equal input gives equal bytes on any number of threads; a photo whose pixels do not confirm the features is
//! refused. Does not guarantee: the right one of several equal windows. Cost: that of the features, mostly, and some tenths of a
//! second a megapixel of the region.

use crate::homography::{Homography, HomographyError};
use crate::photos::{MatchError, MatchParams, PhotoMatch, match_where};
use crate::track::offsets::{carried, covariance_of, jacobian, matrix_of};
use crate::track::record::{CornerCovariance, TrackState, TrackedFrame};
use crate::track::tones::Tones;
use crate::track::tracker::{PlaneTracker, TrackParams, TrackRegion};
use crate::warp::{Beyond, warp};
use glam::{DVec2, dvec2};
use ravec_progress::{Cancelled, Progress};
use ravec_raster::color::{luminance, srgb_from_linear};
use ravec_raster::{
    AnyImage, Color, Image, LinearRgb, Mask, Pixel, Plane, Rect, Reduction, Size, for_each_strip,
    halved, with_image,
};
use serde::{Deserialize, Serialize};

/// Parameters of [`locate_photo`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct PhotoParams {
    /// Parameters of the match of features (default: up to 4000 features, and others as in [`MatchParams`]).
    pub matching: MatchParams,
    /// Parameters of the alignment.
    pub tracking: TrackParams,
}

impl Default for PhotoParams {
    fn default() -> Self {
        let mut matching = MatchParams::default();
        matching.features.max_features = 4000;
        Self {
            matching,
            tracking: TrackParams::default(),
        }
    }
}

/// The place of a photo in a frame.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PhotoPose {
    /// Map from the photo to the frame.
    pub frame_from_photo: Homography,
    /// Trust in the place, as for a frame of a track; never `Lost`.
    pub state: TrackState,
    /// Corners of the region in the frame, as given, or those of the frame.
    pub corners: [DVec2; 4],
    /// Covariance, in square pixels of the frame, of the places to which the map takes those points of the photo that belong to
    /// `corners`. Two standard deviations contain the error in about 95 % of the photos.
    pub covariance: CornerCovariance,
    /// Pairs of features that agree.
    pub inliers: usize,
    /// Share of the compared pixels that agree with the map, 0 to 1.
    pub inlier_share: f64,
    /// Share of the texture that both pictures show which is seen in both and not hidden, 0 to 1.
    pub visible: f64,
    /// Robust standard deviation of the residuals, in encoded values from 0 to 1.
    pub residual: f64,
    /// Factor of the photo's light against the frame's, of encoded values.
    pub gain: f64,
    /// Offset of the photo's light against the frame's, in encoded values from 0 to 1.
    pub bias: f64,
}

impl PhotoPose {
    /// Root mean square of the predicted standard deviations of the four corners' places, in pixels.
    pub fn sigma_px(&self) -> f64 {
        let trace: f64 = (0..8).map(|k| self.covariance[k][k]).sum();
        (0.25 * trace).max(0.0).sqrt()
    }
}

/// Why a photo has no place in a frame.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PhotoError {
    /// The corners are no quadrilateral in perspective.
    #[error("the corners are no rectangle in perspective: {0}")]
    Quad(HomographyError),
    /// The region lies outside the frame.
    #[error("nothing of the quadrilateral lies inside the frame of {frame} pixels")]
    Outside {
        /// Size of the frame.
        frame: Size,
    },
    /// Features of photo and frame do not agree on a place.
    #[error("the photo does not show the plane of the frame: {0}")]
    NoMatch(MatchError),
    /// Features agree on a place, but the pixels there do not look alike.
    #[error(
        "{inliers} features of the photo fit the frame, but the pixels there do not look alike: the photo shows something else, or \
         the plane in other light"
    )]
    Unlike {
        /// Features that agree.
        inliers: usize,
    },
    /// The work was cancelled.
    #[error("cancelled")]
    Cancelled,
}

impl From<Cancelled> for PhotoError {
    fn from(_: Cancelled) -> Self {
        Self::Cancelled
    }
}

/// Margin around the region in which pixels are read, in pixels.
const MARGIN_PX: f64 = 16.0;

/// Pixels of the photo in which features are sought, in those of the region: at this size most features can be seen in the frame
/// too. If that fails, they are sought in a photo of at most the second number of pixels.
const MAX_GROWTH: usize = 4;
const MAX_PIXELS: usize = 12_000_000;

/// Rounds of alignment at most, and the mean motion of the corners, in pixels of the reference, at which the map has settled.
const MAX_ROUNDS: usize = 6;
const SETTLED_PX: f64 = 0.004;

/// Pixels of a picture's border, in pixels of the coarser picture, that are not compared: filters mix in what lies beyond.
const BORDER_PX: f64 = 2.5;

/// Rows of a picture that are read at once: some milliseconds.
const ROWS_PER_STRIP: usize = 16;

/// Lays a `photo` of the plane on a `frame`: both show the part of the plane inside `quad`, or somewhere in the whole frame if
/// there is none. The photo may be that of another camera, in other light, from four times nearer or farther, and up to some 60
/// degrees aslant.
///
/// # Errors
/// [`PhotoError`].
pub fn locate_photo(
    photo: &AnyImage,
    frame: &AnyImage,
    quad: Option<[DVec2; 4]>,
    params: &PhotoParams,
    progress: &Progress,
) -> Result<PhotoPose, PhotoError> {
    let size = frame.size();
    let (w, h) = (size.width() as f64, size.height() as f64);
    let quad = quad.unwrap_or([DVec2::ZERO, dvec2(w, 0.0), dvec2(w, h), dvec2(0.0, h)]);
    Homography::from_unit_square(quad).map_err(PhotoError::Quad)?;
    let region = bounds(&quad, size).ok_or(PhotoError::Outside { frame: size })?;
    let outside = PhotoError::Outside { frame: size };
    let frame_luma = luma(frame, region, progress)?.ok_or(outside.clone())?;
    let photo_luma = luma(photo, Rect::of(photo.size()), progress)?.ok_or(outside)?;
    let origin = dvec2(region.col as f64, region.row as f64);
    let keep = |p: DVec2| is_inside(&quad, p + origin);
    let mut failure = None;
    for (halvings, tilts) in attempts(photo_luma.size(), frame_luma.size(), params) {
        let mut reduced = photo_luma.clone();
        for _ in 0..halvings {
            reduced = halved(&reduced, Reduction::Area);
            progress.check()?;
        }
        let mut matching = params.matching.clone();
        matching.try_tilts = tilts;
        let found = match match_where(&reduced, &frame_luma, &keep, &matching, progress) {
            Ok(found) => found,
            Err(MatchError::Cancelled) => return Err(PhotoError::Cancelled),
            Err(error) => {
                failure.get_or_insert(PhotoError::NoMatch(error));
                continue;
            }
        };
        let start = placed(&found, halvings, origin);
        let pictures = Pictures {
            photo,
            frame,
            quad,
            region,
        };
        if let Some(start) = start
            && let Some(pose) = pictures.refine(start, found.inliers, params, progress)?
        {
            return Ok(pose);
        }
        failure = Some(PhotoError::Unlike {
            inliers: found.inliers,
        });
    }
    Err(
        failure.unwrap_or(PhotoError::NoMatch(MatchError::TooFewMatches {
            matches: 0,
        })),
    )
}

/// Reductions of the photo that are tried, as numbers of halvings, each without and with views from other sides.
fn attempts(photo: Size, region: Size, params: &PhotoParams) -> Vec<(usize, bool)> {
    let halvings = |pixels: usize| {
        (0..16)
            .find(|k| photo.pixels() >> (2 * k) <= pixels.max(1))
            .unwrap_or(16)
    };
    let most = halvings(MAX_PIXELS);
    let small = halvings(MAX_GROWTH * region.pixels()).max(most);
    let mut tried = vec![(small, false)];
    if small > most {
        tried.push((most, false));
    }
    if params.matching.try_tilts {
        for k in 0..tried.len() {
            tried.push((tried[k].0, true));
        }
    }
    tried
}

/// The map of matched features in pixels of the whole pictures.
fn placed(found: &PhotoMatch, halvings: usize, origin: DVec2) -> Option<Homography> {
    let shrink = Homography::from_scale(DVec2::splat(0.5f64.powi(halvings as i32))).ok()?;
    let back = Homography::from_translation(origin).ok()?;
    Some(back * found.second_from_first * shrink)
}

/// A part of an image after a function of its pixels.
fn read<P: Pixel, Q: Pixel>(
    image: &Image<P>,
    part: Rect,
    empty: Q,
    value: impl Fn(P) -> Q + Sync,
    progress: &Progress,
) -> Result<Option<Image<Q>>, Cancelled> {
    let Some(size) = part.clipped(image.size()).size() else {
        return Ok(None);
    };
    let phase = progress.phase("picture", size.height() as u64);
    let mut output = Image::new(size, empty);
    for_each_strip(
        &mut output,
        ROWS_PER_STRIP,
        progress,
        &phase,
        |first, pixels| {
            for (index, line) in pixels.chunks_exact_mut(size.width()).enumerate() {
                let row = &image.row(part.row + first + index)[part.col..];
                for (out, &pixel) in line.iter_mut().zip(row) {
                    *out = value(pixel);
                }
            }
        },
    )?;
    Ok(Some(output))
}

/// The encoded luminance of a part of an image.
fn luma(image: &AnyImage, part: Rect, progress: &Progress) -> Result<Option<Plane>, Cancelled> {
    with_image!(image, image => {
        let value = |pixel| srgb_from_linear(luminance(Color::to_linear(pixel).rgb()));
        read(image, part, 0.0, value, progress)
    })
}

/// A part of an image in linear light. Transparent pixels are as their color says.
fn linear(
    image: &AnyImage,
    part: Rect,
    progress: &Progress,
) -> Result<Option<Image<LinearRgb>>, Cancelled> {
    with_image!(image, image => {
        let value = |pixel| LinearRgb(Color::to_linear(pixel).rgb());
        read(image, part, LinearRgb([0.0; 3]), value, progress)
    })
}

/// The rectangle around points with a margin, inside a picture; nothing if that is empty.
fn bounds(points: &[DVec2; 4], size: Size) -> Option<Rect> {
    let low = points.iter().copied().fold(DVec2::INFINITY, DVec2::min);
    let high = points.iter().copied().fold(DVec2::NEG_INFINITY, DVec2::max);
    let full = dvec2(size.width() as f64, size.height() as f64);
    if low.cmpge(full).any() || high.cmple(DVec2::ZERO).any() {
        return None;
    }
    let low = (low - MARGIN_PX).floor().max(DVec2::ZERO);
    let high = (high + MARGIN_PX).ceil().min(full);
    let extent = high - low;
    let [col, row, width, height] = [low.x, low.y, extent.x, extent.y].map(|v| v as usize);
    Some(Rect::new(col, row, width, height))
}

/// The map from a part of a picture to the whole.
fn origin(part: Rect) -> Option<Homography> {
    Homography::from_translation(dvec2(part.col as f64, part.row as f64)).ok()
}

/// True if a point lies inside a convex quadrilateral, whichever way around its corners go.
fn is_inside(quad: &[DVec2; 4], p: DVec2) -> bool {
    let sides = [0, 1, 2, 3].map(|k| (quad[(k + 1) % 4] - quad[k]).perp_dot(p - quad[k]));
    sides.iter().all(|&side| side >= 0.0) || sides.iter().all(|&side| side <= 0.0)
}

/// Two pictures of a plane.
struct Pictures<'a> {
    photo: &'a AnyImage,
    frame: &'a AnyImage,
    quad: [DVec2; 4],
    region: Rect,
}

/// The picture that sees less of the plane, and the other one.
struct Sides {
    reference: Image<LinearRgb>,
    other: Image<LinearRgb>,
    /// Corners of the region in pixels of the reference.
    quad: [DVec2; 4],
    other_from_reference: Homography,
    /// The reference is a part of the photo.
    photo_is_reference: bool,
    /// Maps from the parts to the whole pictures, of the reference and of the other.
    origins: [Homography; 2],
}

impl Pictures<'_> {
    /// Improves a map by the pixels; nothing if they do not look alike.
    fn refine(
        &self,
        start: Homography,
        inliers: usize,
        params: &PhotoParams,
        progress: &Progress,
    ) -> Result<Option<PhotoPose>, Cancelled> {
        let Some(mut sides) = self.sides(start, progress)? else {
            return Ok(None);
        };
        let phase = progress.phase("alignment", MAX_ROUNDS as u64);
        let mut tones = Tones::default();
        let mut best: Option<TrackedFrame> = None;
        let mut light = None;
        for _ in 0..MAX_ROUNDS {
            progress.check()?;
            let Some(round) = sides.align(&tones, params, progress)? else {
                break;
            };
            let motion = sides.correct(&round.found);
            tones = round.tones;
            // later rounds see what the tones leave
            light.get_or_insert([round.found.gain, round.found.bias]);
            best = Some(round.found);
            phase.advance(1);
            if motion.is_none_or(|motion| motion < SETTLED_PX) {
                break;
            }
        }
        Ok(best
            .zip(light)
            .and_then(|(found, light)| self.pose(&sides, &found, light, inliers)))
    }

    /// Parts of both pictures around the region.
    fn sides(
        &self,
        frame_from_photo: Homography,
        progress: &Progress,
    ) -> Result<Option<Sides>, Cancelled> {
        let photo_from_frame = frame_from_photo.inverse();
        let in_photo = if photo_from_frame.is_in_front(&self.quad) {
            let quad = self.quad.map(|p| photo_from_frame.apply(p));
            bounds(&quad, self.photo.size())
        } else {
            Some(Rect::of(self.photo.size()))
        };
        let Some(in_photo) = in_photo else {
            return Ok(None);
        };
        let photo = linear(self.photo, in_photo, progress)?;
        let frame = linear(self.frame, self.region, progress)?;
        Ok(photo.zip(frame).and_then(|(photo, frame)| {
            let origins = [origin(in_photo)?, origin(self.region)?];
            self.parts([photo, frame], origins, &photo_from_frame)
        }))
    }

    /// The same from the parts of photo and frame, and the maps from these to the whole.
    fn parts(
        &self,
        [photo, frame]: [Image<LinearRgb>; 2],
        [photo_origin, frame_origin]: [Homography; 2],
        photo_from_frame: &Homography,
    ) -> Option<Sides> {
        let photo_from_frame = photo_origin.inverse() * *photo_from_frame * frame_origin;
        let quad = self.quad.map(|p| frame_origin.inverse().apply(p));
        let middle = 0.25 * quad.iter().sum::<DVec2>();
        photo_from_frame.try_apply(middle)?;
        let growth = photo_from_frame.jacobian(middle).determinant().abs();
        let photo_is_reference = growth < 1.0 && photo_from_frame.is_in_front(&quad);
        Some(if photo_is_reference {
            Sides {
                quad: quad.map(|p| photo_from_frame.apply(p)),
                reference: photo,
                other: frame,
                other_from_reference: photo_from_frame.inverse(),
                photo_is_reference,
                origins: [photo_origin, frame_origin],
            }
        } else {
            Sides {
                quad,
                reference: frame,
                other: photo,
                other_from_reference: photo_from_frame,
                photo_is_reference,
                origins: [frame_origin, photo_origin],
            }
        })
    }

    /// The result in pixels of the whole pictures.
    fn pose(
        &self,
        sides: &Sides,
        found: &TrackedFrame,
        light: [f64; 2],
        inliers: usize,
    ) -> Option<PhotoPose> {
        let [reference, other] = sides.origins;
        let [gain, bias] = if sides.photo_is_reference {
            [light[0].recip(), -light[1] / light[0]]
        } else {
            light
        };
        let whole = other * sides.other_from_reference * reference.inverse();
        let (frame_from_photo, covariance) = if sides.photo_is_reference {
            let spread = jacobian(&sides.other_from_reference, &sides.quad);
            (whole, carried(&spread, &matrix_of(&found.covariance)))
        } else {
            (whole.inverse(), matrix_of(&found.covariance))
        };
        covariance
            .iter()
            .all(|v| v.is_finite())
            .then_some(PhotoPose {
                frame_from_photo,
                state: found.state,
                corners: self.quad,
                covariance: covariance_of(&covariance),
                inliers,
                inlier_share: found.inlier_share,
                visible: found.visible,
                residual: found.residual,
                gain,
                bias,
            })
    }
}

/// One alignment.
struct Round {
    found: TrackedFrame,
    tones: Tones,
}

impl Sides {
    /// Aligns the other picture to the reference; nothing if they do not look alike.
    fn align(
        &self,
        tones: &Tones,
        params: &PhotoParams,
        progress: &Progress,
    ) -> Result<Option<Round>, Cancelled> {
        let size = self.reference.size();
        let warped = warp(
            &self.other,
            &self.other_from_reference,
            size,
            Beyond::Border,
            progress,
        )?;
        let covered = self.covered(size);
        let Ok(inside) = Mask::from_polygon(size, &self.quad) else {
            return Ok(None);
        };
        let Ok(region) = inside.intersect(&covered) else {
            return Ok(None);
        };
        let toned = AnyImage::Linear(tones.applied(&warped));
        let reference = AnyImage::Linear(self.reference.clone());
        let tracker = PlaneTracker::new(
            &reference,
            self.quad,
            &TrackRegion::Mask(region.clone()),
            None,
            &params.tracking,
        );
        let Ok(mut tracker) = tracker else {
            return Ok(None);
        };
        progress.check()?;
        let found = tracker.push(&toned, Some(&covered.invert()));
        progress.check()?;
        let tones = Tones::fit(&warped, &self.reference, &region);
        Ok((found.state != TrackState::Lost).then_some(Round { found, tones }))
    }

    /// Pixels of the reference that the other picture shows.
    fn covered(&self, size: Size) -> Mask {
        let full = dvec2(self.other.width() as f64, self.other.height() as f64);
        Mask::from_fn(size, |col, row| {
            let p = dvec2(col as f64 + 0.5, row as f64 + 0.5);
            let Some(q) = self.other_from_reference.try_apply(p) else {
                return false;
            };
            let local = self.other_from_reference.jacobian(p);
            let extent = dvec2(local.row(0).length(), local.row(1).length()).max(DVec2::ONE);
            let border = extent * BORDER_PX;
            q.cmpge(border).all() && q.cmple(full - border).all()
        })
    }

    /// Corrects the map by what was found, and returns the mean motion of the corners in pixels of the reference.
    fn correct(&mut self, found: &TrackedFrame) -> Option<f64> {
        let step = found.frame_from_reference;
        let corrected = self.other_from_reference * step;
        let distances = self.quad.map(|p| step.apply(p).distance(p));
        let mean = 0.25 * distances.iter().sum::<f64>();
        if !mean.is_finite() {
            return None;
        }
        self.other_from_reference = corrected;
        Some(mean)
    }
}

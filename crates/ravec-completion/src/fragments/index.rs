//! The index of fragments: everything that may be copied from, prepared for searches.

use super::blocks::{KEPT_SIDE, Transform};
use super::buffer::{Base, Buffer, MAX_LEVEL, in_proportion};
use super::level::Channels;
use super::search::{Hunt, Place};
use super::target::{SourceFragment, Target, Variant};
use super::template::Template;
use crate::canvas::{Canvas, HOLE, SOURCE};
use crate::error::{CompleteError, largest_radius, plane_map};
use crate::sheet::Sheet;
use glam::DVec2;
use ravec_planar::Homography;
use ravec_progress::Progress;
use ravec_raster::{Color, Image, Mask};
use rayon::prelude::*;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};

/// Radii of fragments that can be searched, in pixels.
pub(super) const RADII: std::ops::RangeInclusive<u32> = 2..=124;

/// Allowed sources of fragments.
#[derive(Debug, Clone)]
pub struct Sources<'a, P: Color> {
    /// The picture itself.
    pub image: &'a Image<P>,
    /// Mask of the pixels to replace. Nothing is copied from there, nor from 2 pixels around it.
    pub hole: &'a Mask,
    /// Planes: quadrilaterals in the picture, corners in order around them, in pixels, x right, y down, pixel centers at
    /// half-integers, that are pictures of rectangles. Each gives a rectified view.
    pub planes: &'a [[DVec2; 4]],
    /// Other photos, of any size.
    pub photos: &'a [Image<P>],
    /// Pixels of the picture on structure that should go on, inside of the hole and outside. Sources should have such
    /// pixels where the target has them.
    pub features: Option<&'a Mask>,
    /// Ways in which copies may be turned, mirrored and scaled, besides as they are. Each is one more buffer of each photo
    /// and plane, in memory and in time.
    pub variants: &'a [Variant],
}

impl<'a, P: Color> Sources<'a, P> {
    /// The picture alone, as it is.
    pub fn new(image: &'a Image<P>, hole: &'a Mask) -> Self {
        Self {
            image,
            hole,
            planes: &[],
            photos: &[],
            features: None,
            variants: &[],
        }
    }
}

/// Parameters of a search.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SearchOptions {
    /// Number of matches, 1 to 64 (default 8).
    pub count: usize,
    /// Least distance of two matches in one buffer, as a share of the radius, 0 to 2 (default 0.5). Less gives many
    /// that are nearly the same, more leaves out good ones.
    pub apart: f64,
    /// Only sources from the rectified view of a plane, or with `Some(None)` only those that are on none (default: all). A
    /// copy from elsewhere has another perspective.
    pub along_plane: Option<Option<usize>>,
    /// Look at all positions at full resolution (default false). Some twenty times slower, and on photos hardly ever another
    /// result. Without it a search ends at some 150 megapixels around the target.
    pub full: bool,
}

impl Default for SearchOptions {
    fn default() -> Self {
        Self {
            count: 8,
            apart: 0.5,
            along_plane: None,
            full: false,
        }
    }
}

/// A source that looks like a target, as far as that is known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Match {
    /// The source.
    pub source: SourceFragment,
    /// The number of the buffer in which it was found.
    pub buffer: usize,
    /// The mean squared difference of colors (encoded, 0 to 1, summed over the channels) and gradients, weighted: 0 for
    /// equals.
    pub mismatch: f64,
}

/// A plane with its rectified view.
#[expect(clippy::struct_field_names, reason = "maps are named dst_from_src")]
pub(super) struct View {
    pub(super) quad: [DVec2; 4],
    pub(super) picture_from_view: Homography,
    size: [usize; 2],
}

/// Everything that may be copied from, prepared for searches.
///
/// See [`Retouch`](super::Retouch) for how it is used.
pub struct FragmentIndex {
    /// The picture first. Pixels of the hole are marked as such.
    pub(super) photos: Vec<Canvas>,
    pub(super) hole: Mask,
    pub(super) features: Option<Mask>,
    /// One for each plane; none for those on which nothing of the hole can be seen.
    pub(super) views: Vec<Option<View>>,
    pub(super) channels: Channels,
    variants: Vec<Variant>,
    buffers: Vec<Buffer>,
    fourier: Transform,
    /// Computed on demand: it takes as long as a pass over all pixels, and targets without a source may be many.
    largest_radius: OnceLock<u32>,
    /// Number of the index in this process.
    pub(super) number: u64,
}

/// Number of the next index.
static NEXT_NUMBER: AtomicU64 = AtomicU64::new(0);

impl std::fmt::Debug for FragmentIndex {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("FragmentIndex")
            .field("buffers", &self.buffers.len())
            .field("pixels", &self.pixels())
            .finish_non_exhaustive()
    }
}

impl FragmentIndex {
    /// Prepares searches: about 50 bytes and 100 nanoseconds of one core for each pixel of all buffers.
    ///
    /// # Errors
    /// [`CompleteError::MaskSize`], [`CompleteError::FeatureSize`], [`CompleteError::NoSource`] if no pixel is more than 3
    /// pixels away from the hole, [`CompleteError::Fragment`] for a variant out of range or one that turns a picture which is
    /// longer than about 30 times its width, for planes
    /// [`CompleteError::QuadCrosses`], [`CompleteError::Plane`] and [`CompleteError::PlaneOutside`],
    /// [`CompleteError::Cancelled`] soon after `progress` is cancelled.
    pub fn new<P: Color>(sources: &Sources<P>, progress: &Progress) -> Result<Self, CompleteError> {
        let size = sources.image.size();
        if sources.hole.size() != size {
            return Err(CompleteError::MaskSize {
                image: size,
                mask: sources.hole.size(),
            });
        }
        if let Some(mask) = sources.features.filter(|mask| mask.size() != size) {
            return Err(CompleteError::FeatureSize {
                image: size,
                mask: mask.size(),
            });
        }
        if let Some(variant) = sources.variants.iter().find(|variant| !variant.is_usable()) {
            return Err(CompleteError::Fragment {
                what: format!(
                    "copies cannot be scaled by {} and turned by {} radians: scales are 0.25 to 4",
                    variant.scale, variant.turn_rad
                ),
            });
        }
        let mut maps = Vec::new();
        for (index, quad) in sources.planes.iter().enumerate() {
            maps.push((*quad, plane_map(quad, size, index + 1)?));
        }
        progress.check()?;
        let mut photos = vec![Canvas::new(sources.image, sources.hole, progress)?];
        for photo in sources.photos {
            progress.check()?;
            photos.push(Canvas::new(photo, &Mask::empty(photo.size()), progress)?);
        }
        Self::from_canvases(
            photos,
            sources.hole.clone(),
            sources.features.cloned(),
            maps,
            sources.variants.to_vec(),
            progress,
        )
    }

    /// The index of canvases, the first of which has the hole.
    pub(super) fn from_canvases(
        mut photos: Vec<Canvas>,
        hole: Mask,
        features: Option<Mask>,
        planes: Vec<([DVec2; 4], Homography)>,
        variants: Vec<Variant>,
        progress: &Progress,
    ) -> Result<Self, CompleteError> {
        let sources = |canvas: &Canvas| canvas.states.pixels().iter().any(|&s| s & SOURCE != 0);
        if !photos.iter().any(sources) {
            return Err(CompleteError::NoSource {
                largest_radius_px: largest_radius(&hole),
            });
        }
        if let Some(bounds) = hole.bounding_box() {
            for row in bounds.row..bounds.bottom() {
                for col in bounds.col..bounds.right() {
                    if hole.at(col, row) > 0.0 {
                        photos[0].states[(col, row)] = HOLE;
                    }
                }
            }
        }
        // in a hole there is no ink, so only known pixels are read
        let translucent = |canvas: &Canvas| {
            let (inks, states) = (canvas.inks.pixels(), canvas.states.pixels());
            let pairs = inks.par_iter().with_min_len(4096).zip(states);
            pairs.any(|(ink, state)| state & SOURCE != 0 && ink[3] < 1.0)
        };
        let channels = Channels {
            alpha: photos.iter().any(translucent),
            features: features.is_some(),
        };
        let mut bases: Vec<Base> = photos
            .iter()
            .enumerate()
            .map(|(photo, canvas)| Base {
                photo,
                plane: None,
                size: [canvas.inks.width(), canvas.inks.height()],
                photo_from_base: Homography::IDENTITY,
            })
            .collect();
        let mut views = Vec::new();
        for (plane, (quad, map)) in planes.into_iter().enumerate() {
            progress.check()?;
            let extent = Sheet::extent(&photos[0], &map, progress)?;
            let view = extent.map(|(size, picture_from_view)| View {
                quad,
                picture_from_view,
                size,
            });
            bases.extend(view.iter().map(|view| Base {
                photo: 0,
                plane: Some(plane),
                size: view.size,
                photo_from_base: view.picture_from_view,
            }));
            views.push(view);
        }
        for base in &bases {
            if let Some(variant) = variants.iter().find(|v| !in_proportion(base.size, **v)) {
                let [width, height] = base.size;
                return Err(CompleteError::Fragment {
                    what: format!(
                        "copies cannot be turned by {} degrees: what they come from is too long and narrow with {width} x \
                         {height} pixels; give turns by 90 or 180 degrees",
                        variant.turn_rad.to_degrees()
                    ),
                });
            }
        }
        let fourier = Transform::new(KEPT_SIDE);
        let mut buffers = Vec::new();
        let phase = progress.phase("index", (bases.len() * (variants.len() + 1)) as u64);
        for base in &bases {
            for variant in std::iter::once(Variant::default()).chain(variants.iter().copied()) {
                let features = features.as_ref().filter(|_| base.photo == 0);
                let canvas = &photos[base.photo];
                buffers.extend(Buffer::new(
                    canvas, features, base, variant, channels, &fourier, progress,
                )?);
                phase.advance(1);
            }
        }
        Ok(Self {
            photos,
            hole,
            features,
            views,
            channels,
            variants,
            buffers,
            fourier,
            largest_radius: OnceLock::new(),
            number: NEXT_NUMBER.fetch_add(1, Ordering::Relaxed),
        })
    }

    /// Number of buffers.
    pub fn buffers(&self) -> usize {
        self.buffers.len()
    }

    /// Pixels of all buffers.
    pub fn pixels(&self) -> usize {
        self.buffers.iter().map(Buffer::pixels).sum()
    }

    /// The memory that the index takes: what is searched, and the photos that are copied from.
    pub fn bytes(&self) -> usize {
        let photos: usize = self
            .photos
            .iter()
            .map(|canvas| 17 * canvas.inks.pixels().len())
            .sum();
        photos + self.buffers.iter().map(Buffer::bytes).sum::<usize>()
    }

    /// Mask of the pixels to replace.
    pub fn hole(&self) -> &Mask {
        &self.hole
    }

    pub(super) fn variants(&self) -> &[Variant] {
        &self.variants
    }

    /// The best matches of a template.
    pub(super) fn best(
        &self,
        template: Template,
        target: &Target,
        options: &SearchOptions,
        progress: &Progress,
    ) -> Result<Vec<Match>, CompleteError> {
        let weight = template.weight();
        let wanted = coarse_level(target.radius_px);
        let longest = self.fourier.longest();
        let mut templates = vec![template];
        while templates.len() <= MAX_LEVEL {
            let half = templates[templates.len() - 1].halved();
            templates.push(half);
        }
        let hunt = Hunt {
            buffers: &self.buffers,
            templates: &templates,
            kept: &self.fourier,
            count: options.count.clamp(1, 64),
            apart_px: options.apart.clamp(0.0, 2.0) * f64::from(target.radius_px),
            around: (!options.full).then_some(target.at),
        };
        let start = |buffer: &Buffer| {
            let along = options
                .along_plane
                .is_none_or(|plane| buffer.plane == plane);
            if options.full || !along {
                return along.then_some(0);
            }
            let mut level = wanted;
            while level < MAX_LEVEL && templates[level].width > longest {
                level += 1;
            }
            Some(level.min(buffer.levels.len() - 1))
        };
        let places = hunt.best(start, progress)?;
        Ok(places
            .iter()
            .map(|place| self.found(&hunt, place, weight))
            .collect())
    }

    fn found(&self, hunt: &Hunt, place: &Place, weight: f64) -> Match {
        let buffer = &self.buffers[place.buffer];
        let beside = if buffer.as_it_is() {
            DVec2::ZERO
        } else {
            hunt.between(place)
        };
        Match {
            source: buffer.source(place.corner + hunt.templates[0].middle, beside),
            buffer: place.buffer,
            mismatch: f64::from(place.score) / weight.max(1e-9),
        }
    }

    /// The best match of a template at most this many pixels from a source; none if that is in no buffer.
    pub(super) fn near(
        &self,
        template: Template,
        source: &SourceFragment,
        reach: i32,
        progress: &Progress,
    ) -> Result<Option<Match>, CompleteError> {
        let middles = self.buffers.iter().map(|buffer| buffer.middle(source));
        let Some((index, middle)) = middles.enumerate().find_map(|(i, at)| Some((i, at?))) else {
            return Ok(None);
        };
        let (weight, step) = (template.weight(), template.middle);
        let hunt = Hunt {
            buffers: &self.buffers,
            templates: &[template],
            kept: &self.fourier,
            count: 1,
            apart_px: 0.0,
            around: None,
        };
        let place = hunt.near(index, middle - step, reach, progress)?;
        Ok(place.map(|place| self.found(&hunt, &place, weight)))
    }

    /// The largest radius of which the picture or a photo has a source.
    pub(super) fn largest_radius(&self) -> u32 {
        *self.largest_radius.get_or_init(|| {
            let of = |canvas: &Canvas| {
                largest_radius(&Mask::from_fn(canvas.states.size(), |col, row| {
                    canvas.states[(col, row)] & SOURCE == 0
                }))
            };
            let largest = self.photos.iter().map(of).fold(0.0, f64::max);
            // pixels at the radius itself belong to a fragment
            (largest.ceil() as u32).saturating_sub(1).min(*RADII.end())
        })
    }
}

/// The level on which all positions are examined. Larger fragments can be distinguished on coarser levels.
fn coarse_level(radius_px: u32) -> usize {
    if radius_px <= 60 { 1 } else { 2 }
}

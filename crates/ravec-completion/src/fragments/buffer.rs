//! Source buffers: photos, rectified views of planes, and both turned, mirrored and scaled.
//!
//! A buffer is a view of a photo that fragments are cut out of as they are. Copying within the rectified view of a plane is
//! the perspective correction. Buffers are for finding out what goes where; what is copied in the end is sampled from the
//! photo itself.
//!
//! Cost: a few samples for each pixel of a buffer that is not the photo as it is.

use super::blocks::{Blocks, Transform};
use super::level::{Channels, Level, MAX_VALUES};
use super::target::{SourceFragment, Variant};
use crate::canvas::{Canvas, SOURCE};
use crate::rectified::{MIN_RESOLUTION, SCALE, sampled};
use crate::sheet::center;
use glam::{DMat3, DVec2, IVec2, dvec2};
use ravec_planar::Homography;
use ravec_progress::{Cancelled, Progress};
use ravec_raster::Mask;

/// Levels that are built at most: fragments of the largest radius fit into a block on the last one.
pub(super) const MAX_LEVEL: usize = 3;
/// Spectra are kept if blocks have at most this many times the pixels of a level: small levels fill their blocks badly, but are
/// soon transformed anew. So the index stays below 60 bytes a pixel.
const WASTE: [f64; MAX_LEVEL] = [2.7, 3.2, 3.2];
/// Levels have at least this many pixels on their shorter side.
const MIN_SIDE: usize = 24;

/// A photo, or the rectified view of a plane of the picture, as it is.
#[derive(Debug, Clone, Copy)]
#[expect(clippy::struct_field_names, reason = "maps are named dst_from_src")]
pub(super) struct Base {
    pub(super) photo: usize,
    pub(super) plane: Option<usize>,
    pub(super) size: [usize; 2],
    pub(super) photo_from_base: Homography,
}

/// A source buffer, ready to be searched.
#[expect(clippy::struct_field_names, reason = "maps are named dst_from_src")]
pub(super) struct Buffer {
    pub(super) photo: usize,
    pub(super) plane: Option<usize>,
    pub(super) transform: Variant,
    photo_from_buffer: Homography,
    pub(super) levels: Vec<Level>,
    /// Those of all levels but the first.
    blocks: Vec<Blocks>,
}

impl Buffer {
    /// The variant of a base; none if it would have no pixel.
    pub(super) fn new(
        canvas: &Canvas,
        features: Option<&Mask>,
        base: &Base,
        transform: Variant,
        channels: Channels,
        fourier: &Transform,
        progress: &Progress,
    ) -> Result<Option<Self>, Cancelled> {
        progress.check()?;
        let Some((size, base_from_buffer)) = extent(base, transform) else {
            return Ok(None);
        };
        let photo_from_buffer = base.photo_from_base * base_from_buffer;
        let feature = |at: DVec2| features.map_or(0.0, |mask| mask.coverage().bilinear(at));
        let as_it_is = base.plane.is_none() && transform == Variant::default();
        let level = Level::new(size[0], size[1], channels, |col, row| {
            if progress.is_cancelled() {
                return ([0.0; MAX_VALUES], false);
            }
            if as_it_is {
                let feature = features.map_or(0.0, |mask| mask.at(col, row));
                let ink = canvas.inks[(col, row)];
                return (
                    channels.of(ink, feature),
                    canvas.states[(col, row)] & SOURCE != 0,
                );
            }
            let at = center(IVec2::new(col as i32, row as i32));
            let Some((ink, state)) = sampled(canvas, &photo_from_buffer, at) else {
                return ([0.0; MAX_VALUES], false);
            };
            // too coarse is what is coarser than the hole, not what is enlarged on request
            let j = photo_from_buffer.jacobian(at).determinant().abs().sqrt();
            let sharp = base.plane.is_none() || SCALE * j * transform.scale >= MIN_RESOLUTION;
            (
                channels.of(ink, feature(photo_from_buffer.apply(at))),
                sharp && state & SOURCE != 0,
            )
        });
        progress.check()?;
        let mut levels = vec![level];
        while levels.len() <= MAX_LEVEL {
            let last = &levels[levels.len() - 1];
            if last.width.min(last.height) < 2 * MIN_SIDE {
                break;
            }
            levels.push(last.halved(channels, progress)?);
        }
        let mut blocks = Vec::new();
        for (level, waste) in levels[1..].iter().zip(WASTE) {
            blocks.push(Blocks::new(level, channels, fourier, waste, progress)?);
        }
        Ok(Some(Self {
            photo: base.photo,
            plane: base.plane,
            transform,
            photo_from_buffer,
            levels,
            blocks,
        }))
    }

    /// Data for searches in a level; none for level 0, where they are rare.
    pub(super) fn blocks(&self, level: usize) -> Option<&Blocks> {
        level.checked_sub(1).map(|index| &self.blocks[index])
    }

    /// The pixel in which the middle of a source lies, if this is its buffer.
    pub(super) fn middle(&self, source: &SourceFragment) -> Option<IVec2> {
        let same = (self.photo, self.plane, self.transform)
            == (source.photo, source.plane, source.transform);
        let at = same.then(|| self.photo_from_buffer.inverse().try_apply(source.at));
        at.flatten().map(|at| at.floor().as_ivec2())
    }

    /// The pixel of a level that shows a place of the picture, or is nearest to it; in other photos the pixel at that place.
    pub(super) fn nearest(&self, in_picture: DVec2, level: usize) -> IVec2 {
        let planes = &self.levels[level];
        let end = dvec2((planes.width - 1) as f64, (planes.height - 1) as f64);
        let here = self.photo_from_buffer.inverse().try_apply(in_picture);
        // what lies behind the horizon of a plane is nowhere near
        let at = here.map_or(0.5 * end, |at| at * 0.5f64.powi(level as i32));
        at.clamp(DVec2::ZERO, end).floor().as_ivec2()
    }

    /// Returns `true` if its pixels are those of the photo. They are copied as they are, and anything else is resampled
    /// anyway.
    pub(super) fn as_it_is(&self) -> bool {
        self.plane.is_none() && self.transform == Variant::default()
    }

    /// The source whose middle is a pixel of the buffer, or a fraction of a pixel beside it.
    pub(super) fn source(&self, middle: IVec2, beside: DVec2) -> SourceFragment {
        SourceFragment {
            photo: self.photo,
            plane: self.plane,
            at: self.photo_from_buffer.apply(center(middle) + beside),
            transform: self.transform,
        }
    }

    pub(super) fn pixels(&self) -> usize {
        self.levels[0].width * self.levels[0].height
    }

    pub(super) fn bytes(&self) -> usize {
        self.levels.iter().map(Level::bytes).sum::<usize>()
            + self.blocks.iter().map(Blocks::bytes).sum::<usize>()
    }
}

/// Pixels of a variant for each pixel of its base and of its scale, at most, beside [`ALWAYS_PX`]. A base with sides of a : 1
/// that is turned by 45 degrees has (a + 1)² / 2a: 2 for a square, 6 for 10 : 1, 16 for 30 : 1. Less would refuse panoramas.
const MAX_GROWTH: f64 = 16.0;
/// Pixels that a variant may always have: this many cost little.
const ALWAYS_PX: f64 = 1e6;

/// Returns `true` if a variant of a base has pixels in proportion to the base, which it has not if that is long,
/// narrow, and lies aslant.
pub(super) fn in_proportion(base: [usize; 2], transform: Variant) -> bool {
    let pixels = variant_size(dvec2(base[0] as f64, base[1] as f64), transform).element_product();
    let share = (base[0] * base[1]) as f64 * transform.scale.powi(2);
    // sizes that are not finite have no pixels at all
    !pixels.is_finite() || pixels <= MAX_GROWTH * share + ALWAYS_PX
}

/// Columns and rows of the variant of a base of a size: whole pixels that lie in it, but for rounding.
fn variant_size(end: DVec2, transform: Variant) -> DVec2 {
    let linear = transform.source_from_copy();
    let corners = [DVec2::ZERO, dvec2(end.x, 0.0), end, dvec2(0.0, end.y)]
        .map(|corner| linear.inverse() * (corner - 0.5 * end));
    let high = corners.iter().fold(DVec2::ZERO, |high, &at| high.max(at));
    (2.0 * high + 1e-6).floor()
}

/// The size of a variant of a base, and the map from it.
fn extent(base: &Base, transform: Variant) -> Option<([usize; 2], Homography)> {
    if transform == Variant::default() {
        return Some((base.size, Homography::IDENTITY));
    }
    let end = dvec2(base.size[0] as f64, base.size[1] as f64);
    let linear = transform.source_from_copy();
    let size = variant_size(end, transform);
    if size.min_element() < 1.0 || !size.is_finite() {
        return None;
    }
    let shift = 0.5 * end - linear * (0.5 * size);
    let matrix = DMat3::from_cols(
        linear.x_axis.extend(0.0),
        linear.y_axis.extend(0.0),
        shift.extend(1.0),
    );
    let map = Homography::from_matrix(matrix).ok()?;
    Some(([size.x as usize, size.y as usize], map))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn turned(degrees: f64, scale: f64) -> Variant {
        Variant {
            turn_rad: degrees.to_radians(),
            scale,
            ..Variant::default()
        }
    }

    proptest! {
        #[test]
        fn variants_of_ordinary_and_of_small_pictures_are_in_proportion(
            side in 1usize..20_000, aspect in 1.0f64..29.0, degrees in -180.0f64..180.0, scale in 0.25f64..4.0
        ) {
            let longer = (side as f64 * aspect) as usize;
            prop_assert!(in_proportion([longer, side], turned(degrees, scale)));
            prop_assert!(in_proportion([side, longer], turned(degrees, scale)));
            prop_assert!(in_proportion([300, 1], turned(degrees, scale)));
        }
    }

    #[test]
    fn long_and_narrow_pictures_may_be_turned_by_right_angles_only() {
        for base in [[65_535, 1], [1, 65_535], [20_000_000, 1], [200_000, 16]] {
            assert!(!in_proportion(base, turned(45.0, 1.0)));
            for degrees in [0.0, 90.0, 180.0, -90.0] {
                assert!(
                    in_proportion(base, turned(degrees, 1.0)),
                    "{base:?} {degrees}"
                );
            }
        }
    }
}

//! Masks: the coverage of each pixel, from 0 to 1.
//!
//! A mask holds a coverage of 0 to 1 a pixel, never anything else and never NaN. Set operations are those of fuzzy
//! sets: union is the larger coverage, intersection the smaller, the complement `1 − c`. So a mask united or
//! intersected with itself stays itself, bit for bit, and hard masks behave as sets do. Where two edges share a pixel
//! this is an estimate, for coverage alone does not determine where in the pixel each of them lies.
//!
//! Growing and shrinking are exact Euclidean: they look at the pixels covered by at least a half and at distances
//! between pixel centers.

use crate::coverage;
use crate::distance::map_distance_sq;
use crate::filter::gaussian_blur;
use crate::image::Plane;
use crate::rect::Rect;
use crate::size::Size;
use glam::DVec2;
use rayon::prelude::*;

/// Coverage of 0 to 1 for each pixel.
///
/// ```
/// use glam::dvec2;
/// use ravec_raster::{Mask, Rect, Size};
///
/// let size = Size::new(40, 30)?;
/// let disc = Mask::from_disc(size, dvec2(20.0, 15.0), 6.0)?;
/// let left = Mask::from_polygon(size, &[dvec2(0.0, 0.0), dvec2(20.0, 0.0), dvec2(20.0, 30.0), dvec2(0.0, 30.0)])?;
/// let half = disc.intersect(&left)?;
/// assert!((half.area_px() - 18.0 * std::f64::consts::PI).abs() < 1e-5);
/// assert_eq!(half.bounding_box(), Some(Rect::new(14, 9, 6, 12)));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Mask(Plane);

/// Why a mask could not be made.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MaskError {
    /// Two masks must have the same size to be combined.
    #[error("masks of {left} and {right} pixels cannot be combined: their sizes differ")]
    Sizes {
        /// Size of the mask that the operation was called on.
        left: Size,
        /// Size of the other.
        right: Size,
    },
    /// A coordinate or radius is NaN, infinite, or so large that areas in pixels would be lost in rounding.
    #[error(
        "({x}, {y}) is an invalid position: coordinates and radii must be numbers between -1e9 and 1e9"
    )]
    OutOfRange {
        /// Horizontal coordinate, or the radius.
        x: f64,
        /// Vertical coordinate, or the radius.
        y: f64,
    },
}

/// The largest coordinate: a position is still good to 1e-7 pixels, and beyond any image.
const MAX_COORDINATE: f64 = 1e9;

impl Mask {
    /// A mask without coverage.
    pub fn empty(size: Size) -> Self {
        Self(Plane::new(size, 0.0))
    }

    /// A mask that covers everything.
    pub fn full(size: Size) -> Self {
        Self(Plane::new(size, 1.0))
    }

    /// The plane's values as coverage, cut off at 0 and 1; NaN becomes 0.
    pub fn from_coverage(plane: &Plane) -> Self {
        // NaN is not above 0
        Self(plane.map(|value| if value > 0.0 { value.min(1.0) } else { 0.0 }))
    }

    /// Covers the pixels whose value is at least `threshold`; NaN is not.
    pub fn from_threshold(plane: &Plane, threshold: f32) -> Self {
        Self(plane.map(|value| f32::from(value >= threshold)))
    }

    /// Covers the pixels for which `member(col, row)` holds.
    pub fn from_fn(size: Size, mut member: impl FnMut(usize, usize) -> bool) -> Self {
        Self(Plane::from_fn(size, |col, row| f32::from(member(col, row))))
    }

    /// Covers the rectangle.
    pub fn from_rect(size: Size, rect: Rect) -> Self {
        let mut mask = Self::empty(size);
        let rect = rect.clipped(size);
        for row in rect.row..rect.bottom() {
            mask.0.row_mut(row)[rect.col..rect.right()].fill(1.0);
        }
        mask
    }

    /// Covers a closed polygon, by the exact area of each pixel. Where it crosses itself, the even-odd rule decides.
    /// The last corner is joined to the first; fewer than three corners cover nothing.
    ///
    /// # Errors
    /// [`MaskError::OutOfRange`] for a corner that is not finite or beyond ±1e9.
    pub fn from_polygon(size: Size, corners: &[DVec2]) -> Result<Self, MaskError> {
        Self::from_polygons(size, &[corners])
    }

    /// Covers what lies in an odd number of closed polygons, by the exact area of each pixel: an outline and its holes.
    ///
    /// # Errors
    /// [`MaskError::OutOfRange`] for a corner that is not finite or beyond ±1e9.
    pub fn from_polygons(size: Size, rings: &[&[DVec2]]) -> Result<Self, MaskError> {
        rings
            .iter()
            .copied()
            .flatten()
            .try_for_each(|&corner| in_range(corner))?;
        Ok(Self(coverage::of_polygon(size, rings)))
    }

    /// Covers a disc, by the exact area of each pixel. A radius of 0 or less covers nothing.
    ///
    /// # Errors
    /// [`MaskError::OutOfRange`] for a center or radius that is not finite or beyond ±1e9.
    pub fn from_disc(size: Size, center: DVec2, radius_px: f64) -> Result<Self, MaskError> {
        in_range(center)?;
        in_range(DVec2::splat(radius_px))?;
        Ok(Self(coverage::of_disc(size, center, radius_px)))
    }

    /// Columns and rows.
    pub fn size(&self) -> Size {
        self.0.size()
    }

    /// The coverage as a plane.
    pub fn coverage(&self) -> &Plane {
        &self.0
    }

    /// The coverage as a plane.
    pub fn into_coverage(self) -> Plane {
        self.0
    }

    /// The coverage of one pixel, 0 to 1; 0 outside the picture.
    pub fn at(&self, col: usize, row: usize) -> f32 {
        self.0.get(col, row).unwrap_or(0.0)
    }

    /// Returns `true` if nothing is covered, not even in part.
    pub fn is_empty(&self) -> bool {
        self.0.pixels().par_iter().all(|&coverage| coverage == 0.0)
    }

    /// The sum of all coverage, in pixels.
    pub fn area_px(&self) -> f64 {
        let rows: Vec<f64> = self
            .0
            .par_rows()
            .map(|row| row.iter().map(|&coverage| f64::from(coverage)).sum())
            .collect();
        rows.iter().sum()
    }

    /// The smallest rectangle around all pixels with any coverage.
    pub fn bounding_box(&self) -> Option<Rect> {
        let lines: Vec<Rect> = self
            .0
            .par_rows()
            .enumerate()
            .map(|(row, line)| {
                let covered = |coverage: &f32| *coverage > 0.0;
                match (
                    line.iter().position(covered),
                    line.iter().rposition(covered),
                ) {
                    (Some(first), Some(last)) => Rect::new(first, row, last - first + 1, 1),
                    _ => Rect::default(),
                }
            })
            .collect();
        let found = lines.into_iter().fold(Rect::default(), Rect::bounding);
        (!found.is_empty()).then_some(found)
    }

    /// The complement of the mask.
    #[must_use]
    pub fn invert(&self) -> Self {
        Self(self.0.map(|coverage| 1.0 - coverage))
    }

    /// The union of two masks.
    ///
    /// # Errors
    /// [`MaskError::Sizes`] if the sizes differ.
    pub fn union(&self, other: &Self) -> Result<Self, MaskError> {
        self.combine(other, f32::max)
    }

    /// The intersection of two masks.
    ///
    /// # Errors
    /// [`MaskError::Sizes`] if the sizes differ.
    pub fn intersect(&self, other: &Self) -> Result<Self, MaskError> {
        self.combine(other, f32::min)
    }

    /// The difference of two masks: the part of this one that the other does not cover.
    ///
    /// # Errors
    /// [`MaskError::Sizes`] if the sizes differ.
    pub fn subtract(&self, other: &Self) -> Result<Self, MaskError> {
        self.combine(other, |a, b| a.min(1.0 - b))
    }

    /// Adds the pixels whose centers are at most `radius_px` from the center of a pixel covered by at least a half.
    /// Coverage in part stays where it was; what is added is covered wholly. A radius of 0 or less, or NaN, adds
    /// nothing.
    #[must_use]
    pub fn dilate(&self, radius_px: f64) -> Self {
        let Some(radius_sq) = squared(radius_px) else {
            return self.clone();
        };
        Self(map_distance_sq(
            self.size(),
            |col, row| self.0[(col, row)] >= 0.5,
            |col, row, distance_sq| match distance_sq {
                Some(distance_sq) if distance_sq as f64 <= radius_sq => 1.0,
                _ => self.0[(col, row)],
            },
        ))
    }

    /// Takes away the pixels whose centers are at most `radius_px` from the center of a pixel covered by less than a
    /// half. The border of the picture takes nothing away. A radius of 0 or less, or NaN, takes nothing away.
    #[must_use]
    pub fn erode(&self, radius_px: f64) -> Self {
        let Some(radius_sq) = squared(radius_px) else {
            return self.clone();
        };
        Self(map_distance_sq(
            self.size(),
            |col, row| self.0[(col, row)] < 0.5,
            |col, row, distance_sq| match distance_sq {
                Some(distance_sq) if distance_sq as f64 <= radius_sq => 0.0,
                _ => self.0[(col, row)],
            },
        ))
    }

    /// The mask with its edge softened by a gaussian of standard deviation `sigma_px`: coverage passes from 0.02 to 0.98
    /// within about four times as many pixels. The 50 % line of a straight edge stays where it was.
    #[must_use]
    pub fn feather(&self, sigma_px: f64) -> Self {
        // the weights sum to 1 only up to rounding
        Self(gaussian_blur(&self.0, sigma_px).map(|coverage| coverage.clamp(0.0, 1.0)))
    }

    fn combine(&self, other: &Self, f: impl Fn(f32, f32) -> f32 + Sync) -> Result<Self, MaskError> {
        if self.size() != other.size() {
            return Err(MaskError::Sizes {
                left: self.size(),
                right: other.size(),
            });
        }
        let mut result = self.0.clone();
        result
            .par_rows_mut()
            .zip(other.0.par_rows())
            .for_each(|(out, other)| {
                for (a, &b) in out.iter_mut().zip(other) {
                    *a = f(*a, b);
                }
            });
        Ok(Self(result))
    }
}

fn in_range(point: DVec2) -> Result<(), MaskError> {
    // NaN fails the comparison
    if point.x.abs() <= MAX_COORDINATE && point.y.abs() <= MAX_COORDINATE {
        Ok(())
    } else {
        Err(MaskError::OutOfRange {
            x: point.x,
            y: point.y,
        })
    }
}

/// The square of a radius that reaches anything.
fn squared(radius_px: f64) -> Option<f64> {
    (radius_px > 0.0).then_some(radius_px * radius_px)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::dvec2;
    use proptest::prelude::*;

    fn size(width: usize, height: usize) -> Size {
        Size::new(width, height).unwrap()
    }

    fn speckled(width: usize, height: usize, seed: u32) -> Mask {
        let value = |n: usize| ((n as u32 + seed).wrapping_mul(2_654_435_761) >> 8) % 5;
        Mask(Plane::from_fn(size(width, height), |col, row| {
            [0.0, 0.0, 0.3, 0.6, 1.0][value(row * width + col) as usize]
        }))
    }

    proptest! {
        #[test]
        fn dilation_and_erosion_agree_with_the_brute_force(
            (w, h) in (1usize..14, 1usize..14), radius_px in 0.0f64..5.0, seed in 0u32..1000
        ) {
            let mask = speckled(w, h, seed);
            let pixels = || (0..h).flat_map(|row| (0..w).map(move |col| (col, row)));
            let (grown, shrunk) = (mask.dilate(radius_px), mask.erode(radius_px));
            for (col, row) in pixels() {
                let near = |covered: bool| {
                    pixels().any(|(c, r)| {
                        let distance_sq = c.abs_diff(col).pow(2) + r.abs_diff(row).pow(2);
                        (mask.at(c, r) >= 0.5) == covered && distance_sq as f64 <= radius_px * radius_px
                    })
                };
                let own = mask.at(col, row);
                prop_assert_eq!(grown.at(col, row), if radius_px > 0.0 && near(true) { 1.0 } else { own });
                prop_assert_eq!(shrunk.at(col, row), if radius_px > 0.0 && near(false) { 0.0 } else { own });
            }
        }

        #[test]
        fn set_operations_obey_the_laws_of_sets(seed in 0u32..1000) {
            let (a, b) = (speckled(7, 5, seed), speckled(7, 5, seed + 99));
            prop_assert_eq!(&a.union(&a).unwrap(), &a);
            prop_assert_eq!(&a.intersect(&a).unwrap(), &a);
            prop_assert_eq!(a.union(&b).unwrap(), b.union(&a).unwrap());
            prop_assert_eq!(a.subtract(&b).unwrap(), a.intersect(&b.invert()).unwrap());
            // De Morgan
            prop_assert_eq!(a.union(&b).unwrap().invert(), a.invert().intersect(&b.invert()).unwrap());
        }

        #[test]
        fn the_bounding_box_holds_all_coverage_and_touches_it(seed in 0u32..1000, sparse in 1usize..40) {
            let mask = Mask::from_fn(size(9, 8), |col, row| (row * 9 + col + seed as usize).is_multiple_of(sparse));
            let covered: Vec<_> = (0..72).map(|i| (i % 9, i / 9)).filter(|&(c, r)| mask.at(c, r) > 0.0).collect();
            let cells = covered.iter().map(|&(c, r)| Rect::new(c, r, 1, 1));
            prop_assert_eq!(mask.bounding_box(), cells.reduce(Rect::bounding));
            prop_assert_eq!(mask.is_empty(), covered.is_empty());
            prop_assert_eq!(mask.area_px(), covered.len() as f64);
        }
    }

    #[test]
    fn coverage_is_never_anything_but_a_share() {
        let plane = Plane::from_vec(4, vec![f32::NAN, -1.0, 2.0, f32::INFINITY]).unwrap();
        assert_eq!(
            Mask::from_coverage(&plane).coverage().pixels(),
            [0.0, 0.0, 1.0, 1.0]
        );
        assert_eq!(
            Mask::from_threshold(&plane, 2.0).coverage().pixels(),
            [0.0, 0.0, 1.0, 1.0]
        );
    }

    #[test]
    fn feathering_keeps_the_middle_of_an_edge_and_stays_within_0_and_1() {
        let edge = Mask::from_fn(size(40, 5), |col, _| col >= 20).feather(3.0);
        let (left, right) = (edge.at(19, 2), edge.at(20, 2));
        assert!((left + right - 1.0).abs() < 1e-6 && left < right);
        let full = Mask::full(size(9, 9)).feather(2.0);
        assert!(
            full.coverage()
                .pixels()
                .iter()
                .all(|c| (0.999_999..=1.0).contains(c))
        );
    }

    #[test]
    fn rectangles_are_clipped() {
        let mask = Mask::from_rect(size(5, 4), Rect::new(3, 2, 9, 9));
        assert_eq!(mask.bounding_box(), Some(Rect::new(3, 2, 2, 2)));
        assert_eq!(mask.at(99, 0), 0.0);
    }

    #[test]
    fn a_mask_of_nothing_grows_to_nothing_and_one_of_all_shrinks_to_all() {
        let (empty, full) = (Mask::empty(size(6, 6)), Mask::full(size(6, 6)));
        assert_eq!(empty.dilate(100.0), empty);
        assert_eq!(full.erode(100.0), full);
        assert_eq!(full.erode(f64::NAN), full);
        assert_eq!(empty.bounding_box(), None);
    }

    #[test]
    fn masks_of_different_sizes_are_refused() {
        let (left, right) = (size(3, 4), size(4, 3));
        let found = Mask::empty(left).union(&Mask::empty(right));
        assert_eq!(found, Err(MaskError::Sizes { left, right }));
        assert_eq!(
            found.unwrap_err().to_string(),
            "masks of 3 x 4 and 4 x 3 pixels cannot be combined: their sizes differ"
        );
    }

    #[test]
    fn positions_that_are_no_numbers_or_too_far_are_refused() {
        let bad = dvec2(f64::INFINITY, 0.0);
        let corners = [dvec2(0.0, 0.0), bad, dvec2(1.0, 1.0)];
        assert!(matches!(
            Mask::from_polygon(size(3, 3), &corners),
            Err(MaskError::OutOfRange { x, .. }) if x == f64::INFINITY
        ));
        assert!(Mask::from_disc(size(3, 3), dvec2(0.0, 2e9), 1.0).is_err());
        assert!(Mask::from_disc(size(3, 3), dvec2(0.0, 0.0), f64::NAN).is_err());
    }
}

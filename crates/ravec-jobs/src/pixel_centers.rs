//! Position of pixel centers in the coordinates of points.

use glam::{DVec2, DVec3, dvec2};
use ravec::planar::Homography;
use serde::{Deserialize, Serialize};

/// Convention of points that are given and printed. The library has the centers of pixels at half-integers.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
pub enum PixelCenters {
    /// The center of the first pixel is (0.5, 0.5), and (0, 0) is the corner of the picture
    #[default]
    Half,
    /// The center of the first pixel is (0, 0), as in `OpenCV`
    Integer,
}

impl PixelCenters {
    /// True for the default, which files need not state.
    #[expect(
        clippy::trivially_copy_pass_by_ref,
        reason = "what serde calls to skip a field takes a reference"
    )]
    pub(crate) fn is_half(&self) -> bool {
        *self == Self::Half
    }

    fn shift(self) -> DVec2 {
        match self {
            Self::Half => DVec2::ZERO,
            Self::Integer => DVec2::splat(0.5),
        }
    }

    /// A point that is given in this convention, with pixel centers at half-integers.
    #[must_use]
    pub fn read(self, point: DVec2) -> DVec2 {
        point + self.shift()
    }

    /// Points that are given in this convention, with pixel centers at half-integers.
    #[must_use]
    pub fn read_all<const N: usize>(self, points: [DVec2; N]) -> [DVec2; N] {
        points.map(|point| self.read(point))
    }

    /// A point with pixel centers at half-integers, in this convention.
    #[must_use]
    pub fn write(self, point: DVec2) -> DVec2 {
        point - self.shift()
    }

    /// Points with pixel centers at half-integers, in this convention.
    #[must_use]
    pub fn write_all<const N: usize>(self, points: [DVec2; N]) -> [DVec2; N] {
        points.map(|point| self.write(point))
    }

    /// A homogeneous point with pixel centers at half-integers, in this convention. Directions stay.
    #[must_use]
    pub fn write_homogeneous(self, point: DVec3) -> DVec3 {
        let shift = self.shift() * point.z;
        point - shift.extend(0.0)
    }

    /// A map between pictures that is given in this convention on both sides, with pixel centers at half-integers:
    /// T(½) · H · T(−½).
    #[must_use]
    pub fn read_map(self, map: &Homography) -> Homography {
        self.conjugate(map, 1.0)
    }

    /// A map between pictures with pixel centers at half-integers, in this convention on both sides: T(−½) · H · T(½).
    #[must_use]
    pub fn write_map(self, map: &Homography) -> Homography {
        self.conjugate(map, -1.0)
    }

    fn conjugate(self, map: &Homography, sign: f64) -> Homography {
        if self.is_half() {
            return *map;
        }
        let shift = |by: f64| {
            Homography::from_translation(dvec2(by, by)).expect("half a pixel is a finite shift")
        };
        shift(0.5 * sign) * *map * shift(-0.5 * sign)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::dvec3;

    #[test]
    fn integer_centers_are_half_a_pixel_up_and_left() {
        let (half, integer) = (PixelCenters::Half, PixelCenters::Integer);
        let first = dvec2(0.5, 0.5);
        assert_eq!(half.write(first), first);
        assert_eq!(integer.write(first), DVec2::ZERO);
        assert_eq!(integer.read(DVec2::ZERO), first);
        let points = [first, dvec2(3.0, -1.0)];
        assert_eq!(integer.read_all(integer.write_all(points)), points);
        let far = integer.write_homogeneous(dvec3(2.0, 1.0, 0.0));
        assert_eq!(far, dvec3(2.0, 1.0, 0.0));
        let near = integer.write_homogeneous(dvec3(4.0, 2.0, 2.0));
        assert_eq!(near, dvec3(3.0, 1.0, 2.0));
    }

    #[test]
    fn maps_take_points_of_their_convention() {
        let corners = [
            dvec2(10.0, 10.0),
            dvec2(90.0, 25.0),
            dvec2(90.0, 75.0),
            dvec2(10.0, 95.0),
        ];
        let map = Homography::from_unit_square(corners).unwrap();
        let integer = PixelCenters::Integer;
        let written = integer.write_map(&map);
        let point = dvec2(0.3, 0.8);
        let expected = integer.write(map.apply(point));
        assert!(written.apply(integer.write(point)).distance(expected) < 1e-12);
        let again = integer.read_map(&written);
        assert!(again.apply(point).distance(map.apply(point)) < 1e-12);
        assert_eq!(PixelCenters::Half.write_map(&map), map);
    }
}

#[cfg(test)]
mod commands;

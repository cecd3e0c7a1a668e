//! Precision of coordinates: which numbers the vertices of a result may have.

use glam::DVec3;
use serde::{Deserialize, Serialize};

/// Precision of the coordinates of a result.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Coordinates {
    /// 64-bit floats.
    #[default]
    Double,
    /// Values that 32-bit floats represent exactly, for file formats that store nothing else: what a report says holds for
    /// the file as written.
    Single,
}

impl Coordinates {
    /// Rounds each coordinate to the nearest representable one; infinite beyond the range of 32-bit floats.
    #[inline]
    pub fn nearest(self, p: DVec3) -> DVec3 {
        match self {
            Self::Double => p,
            Self::Single => p.as_vec3().as_dvec3(),
        }
    }

    /// Distance between 1 and the next larger number.
    pub const fn epsilon(self) -> f64 {
        match self {
            Self::Double => f64::EPSILON,
            Self::Single => f32::EPSILON as f64,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn single_coordinates_are_those_of_32_bit_floats() {
        let p = DVec3::new(0.1, 1.0 + f64::EPSILON, 1e300);
        assert_eq!(Coordinates::Double.nearest(p), p);
        let single = Coordinates::Single.nearest(p);
        assert_eq!(single, DVec3::new(f64::from(0.1f32), 1.0, f64::INFINITY));
        let next = 1.0 + Coordinates::Single.epsilon();
        assert_eq!(Coordinates::Single.nearest(DVec3::splat(next)).x, next);
    }
}

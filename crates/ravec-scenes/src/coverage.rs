//! Coverage of a pixel by a shape: exact areas.
//!
//! A pixel is a square of side 1; what a camera with a perfect sensor would see of a shape is the mean over that square,
//! so the pixel's value is the colors mixed in linear light by the covered area. Everything else that a scene draws
//! is judged against these formulas, and these against plain supersampling.

use glam::DVec2;
use serde::{Deserialize, Serialize};

/// The points `p` with `normal·p ≤ offset`, image coordinates.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct HalfPlane {
    /// Unit vector that points out of the half plane.
    pub normal: DVec2,
    /// Distance of the border from the origin along `normal`, in pixels.
    pub offset_px: f64,
}

impl HalfPlane {
    /// The half plane whose border has the outward normal `(cos, sin)` of an angle and goes through a point.
    pub fn from_angle(angle_rad: f64, through: DVec2) -> Self {
        let normal = DVec2::from_angle(angle_rad);
        Self {
            normal,
            offset_px: normal.dot(through),
        }
    }

    /// Signed distance of a point from the border, positive outside.
    #[inline]
    pub fn distance(self, p: DVec2) -> f64 {
        self.normal.dot(p) - self.offset_px
    }

    /// The points outside, with the border.
    pub fn complement(self) -> Self {
        Self {
            normal: -self.normal,
            offset_px: -self.offset_px,
        }
    }

    /// The area of the half plane within the pixel around `center`, 0 to 1.
    ///
    /// The square's projection on the normal has a trapezoidal density; its integral is a difference of four squares.
    /// Within 1e-6 for any unit normal.
    pub fn coverage(self, center: DVec2) -> f64 {
        let u = -self.distance(center);
        let (a, b) = (self.normal.x.abs(), self.normal.y.abs());
        let (wide, narrow) = (a.max(b), a.min(b));
        // below this the four squares cancel; the border is axis-parallel to within a millionth of a pixel
        if narrow < 1e-6 {
            return (u / wide + 0.5).clamp(0.0, 1.0);
        }
        let f = |x: f64| x.max(0.0) * x.max(0.0);
        // where the projections of the square's corners lie
        let (outer, inner) = (0.5 * (wide + narrow), 0.5 * (wide - narrow));
        let sum = f(u + outer) - f(u + inner) - f(u - inner) + f(u - outer);
        (sum / (2.0 * wide * narrow)).clamp(0.0, 1.0)
    }
}

/// The area of the intersection of half planes within the pixel around `center`, 0 to 1; exact to rounding.
///
/// Clips the pixel's square by one half plane after another (Sutherland and Hodgman 1974). Each adds at most one corner.
pub fn intersection_coverage(half_planes: &[HalfPlane], center: DVec2) -> f64 {
    let mut polygon: Vec<DVec2> = [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)]
        .map(|(x, y)| center + DVec2::new(x, y))
        .to_vec();
    let mut clipped = Vec::with_capacity(polygon.len() + half_planes.len());
    for half_plane in half_planes {
        let mut previous = polygon[polygon.len() - 1];
        let mut previous_distance = half_plane.distance(previous);
        for &corner in &polygon {
            let distance = half_plane.distance(corner);
            if (distance < 0.0) != (previous_distance < 0.0) {
                let t = previous_distance / (previous_distance - distance);
                clipped.push(previous.lerp(corner, t));
            }
            if distance < 0.0 {
                clipped.push(corner);
            }
            (previous, previous_distance) = (corner, distance);
        }
        std::mem::swap(&mut polygon, &mut clipped);
        clipped.clear();
        if polygon.is_empty() {
            return 0.0;
        }
    }
    let origin = polygon[0];
    let twice_area: f64 = polygon
        .windows(2)
        .map(|pair| (pair[0] - origin).perp_dot(pair[1] - origin))
        .sum();
    (0.5 * twice_area.abs()).min(1.0)
}

/// The area of a disc within the pixel around `center`, 0 to 1.
///
/// Integrates the chord length, clipped to the pixel, in closed form. Loses digits with the square of the radius:
/// within 1e-9 up to a radius of 1000 pixels.
pub fn disc_coverage(disc_center: DVec2, radius_px: f64, center: DVec2) -> f64 {
    let r = radius_px.max(0.0);
    let p = center - disc_center;
    // whole pixels, the common case, need no integral
    let reach = p.length();
    let half_diagonal = std::f64::consts::FRAC_1_SQRT_2;
    if reach >= r + half_diagonal {
        return 0.0;
    }
    if reach + half_diagonal <= r {
        return 1.0;
    }
    let left = (p.x - 0.5).clamp(-r, r);
    let right = (p.x + 0.5).clamp(-r, r);
    // ∫ √(r² − x²) dx
    let arc = |x: f64| {
        0.5 * (x * (r * r - x * x).max(0.0).sqrt() + r * r * (x / r).clamp(-1.0, 1.0).asin())
    };
    // ∫ min(y, √(r² − x²)) dx for y ≥ 0: flat in the middle, round on both sides
    let capped = |y: f64| {
        let c = (r * r - y * y).max(0.0).sqrt();
        let (flat_left, flat_right) = (left.clamp(-c, c), right.clamp(-c, c));
        if y >= r {
            return arc(right) - arc(left);
        }
        y * (flat_right - flat_left) + (arc(right) - arc(left)) - (arc(flat_right) - arc(flat_left))
    };
    let below = |y: f64| capped(y.abs()).copysign(y);
    (below(p.y + 0.5) - below(p.y - 0.5)).clamp(0.0, 1.0)
}

/// The fraction of an interval of length `window` around `x` that lies within `half_width` of 0: a soft-edged bar.
#[inline]
pub(crate) fn bar(x: f64, half_width: f64, window: f64) -> f64 {
    let h = 0.5 * window;
    ((x + h).min(half_width) - (x - h).max(-half_width)).max(0.0) / window
}

/// The fraction of an interval of length `window` around `x` that lies above `edge`.
#[inline]
pub(crate) fn above(x: f64, edge: f64, window: f64) -> f64 {
    ((x - edge) / window + 0.5).clamp(0.0, 1.0)
}

/// The mean over an interval of length `window` around `x` of a wave of period 1 that is 1 for the first `duty` of it.
#[inline]
pub(crate) fn pulse(x: f64, duty: f64, window: f64) -> f64 {
    let integral = |t: f64| t.floor() * duty + (t - t.floor()).min(duty);
    ((integral(x + 0.5 * window) - integral(x - 0.5 * window)) / window).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The plain definition: a fine grid of points.
    fn sampled(inside: impl Fn(DVec2) -> bool, center: DVec2) -> f64 {
        const N: i32 = 128;
        let at = |i: i32| (f64::from(i) + 0.5) / f64::from(N) - 0.5;
        let count = (0..N * N)
            .filter(|i| inside(center + DVec2::new(at(i % N), at(i / N))))
            .count();
        count as f64 / f64::from(N * N)
    }

    // a border of length L through the pixel crosses about L·N cells of area 1/N², each wrong by at most half of it
    const GRID_ERROR: f64 = 1.5 / 128.0;

    proptest! {
        #[test]
        fn a_half_plane_covers_what_sampling_says(angle in 0.0..7.0, x in -1.0..1.0, y in -1.0..1.0) {
            let h = HalfPlane::from_angle(angle, DVec2::new(x, y));
            let exact = h.coverage(DVec2::ZERO);
            prop_assert!((exact - sampled(|p| h.distance(p) <= 0.0, DVec2::ZERO)).abs() < GRID_ERROR);
            prop_assert!((exact - intersection_coverage(&[h], DVec2::ZERO)).abs() < 1e-9);
            prop_assert!((exact + h.complement().coverage(DVec2::ZERO) - 1.0).abs() < 1e-9);
        }

        #[test]
        fn a_wedge_covers_what_sampling_says(a in 0.0..7.0, b in 0.0..7.0, x in -0.7..0.7, y in -0.7..0.7) {
            let apex = DVec2::new(x, y);
            let sides = [HalfPlane::from_angle(a, apex), HalfPlane::from_angle(b, apex)];
            let exact = intersection_coverage(&sides, DVec2::ZERO);
            let plain = sampled(|p| sides.iter().all(|h| h.distance(p) <= 0.0), DVec2::ZERO);
            prop_assert!((exact - plain).abs() < 2.0 * GRID_ERROR);
        }

        #[test]
        fn a_disc_covers_what_sampling_says(r in 0.01..4.0, x in -5.0..5.0, y in -5.0..5.0) {
            let c = DVec2::new(x, y);
            let exact = disc_coverage(c, r, DVec2::ZERO);
            let plain = sampled(|p| p.distance(c) <= r, DVec2::ZERO);
            prop_assert!((exact - plain).abs() < 2.5 * GRID_ERROR, "{} {}", exact, plain);
        }

        #[test]
        fn pulses_are_means_of_the_wave(x in -3.0..3.0, duty in 0.0..1.0, window in 0.01..2.5) {
            let n = 4000;
            let plain = (0..n).filter(|i| {
                let t: f64 = x + window * ((f64::from(*i) + 0.5) / f64::from(n) - 0.5);
                t - t.floor() < duty
            }).count() as f64 / f64::from(n);
            // each of the at most 7 jumps falls into one of n cells
            prop_assert!((pulse(x, duty, window) - plain).abs() < 8.0 / f64::from(n));
        }
    }

    #[test]
    fn axis_parallel_and_diagonal_borders_are_exact() {
        let at = |angle: f64, d: f64| {
            HalfPlane {
                normal: DVec2::from_angle(angle),
                offset_px: d,
            }
            .coverage(DVec2::ZERO)
        };
        assert!((at(0.0, 0.25) - 0.75).abs() < 1e-12);
        assert!((at(std::f64::consts::FRAC_PI_2, -0.25) - 0.25).abs() < 1e-12);
        // a corner triangle with legs of √2·(√½ − d)·... : at 45° and distance d from the corner the area is d²
        let d = 0.2;
        let corner = std::f64::consts::FRAC_1_SQRT_2;
        assert!((at(std::f64::consts::FRAC_PI_4, d - corner) - d * d).abs() < 1e-12);
        // nearly parallel borders go through the formula and the shortcut alike
        for tilt in [0.0, 1e-9, 0.99e-6, 1.01e-6, 1e-5] {
            assert!((at(tilt, 0.1) - 0.6).abs() < 1e-6, "{tilt}");
        }
    }

    #[test]
    fn pixels_add_up_to_the_area_of_the_disc() {
        for (center, radius) in [
            (DVec2::new(20.3, 19.8), 13.7),
            (DVec2::new(20.0, 20.5), 0.3),
        ] {
            let area: f64 = (0..40 * 40)
                .map(|i| DVec2::new(f64::from(i % 40) + 0.5, f64::from(i / 40) + 0.5))
                .map(|p| disc_coverage(center, radius, p))
                .sum();
            let truth = std::f64::consts::PI * radius * radius;
            assert!(
                (area - truth).abs() < 1e-9 * truth.max(1.0),
                "{area} {truth}"
            );
        }
    }
}

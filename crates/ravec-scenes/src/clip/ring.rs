//! Exact coverage of pixels by a polygon.
//!
//! Each edge adds to each pixel that it crosses the signed area between itself and the pixel's right border; a running sum
//! along the rows turns these into covered areas. Costs one step for each crossed pixel and one for each pixel of the box.
//!
//! Source: R. Levien, "Inside the fastest font renderer in the world", 2016.
//!
//! Guarantees: exact to rounding for a polygon that does not cross itself, in either direction of turn. Does not guarantee:
//! the area of the union where a polygon crosses itself.

use glam::DVec2;
use ravec_raster::Size;

/// Coverage within a box of pixels.
pub(crate) struct Patch {
    /// Upper left pixel.
    pub col: usize,
    pub row: usize,
    pub width: usize,
    /// Row by row, 0 to 1.
    pub coverage: Vec<f32>,
}

/// The covered areas of the pixels of a frame; nothing if the polygon lies outside or has a coordinate that is no number.
pub(crate) fn cover(size: Size, ring: &[DVec2]) -> Option<Patch> {
    if ring.len() < 3 || !ring.iter().all(|p| p.is_finite()) {
        return None;
    }
    let extent = DVec2::new(size.width() as f64, size.height() as f64);
    let low = ring
        .iter()
        .fold(extent, |a, &p| a.min(p))
        .max(DVec2::ZERO)
        .floor();
    let high = ring
        .iter()
        .fold(DVec2::ZERO, |a, &p| a.max(p))
        .min(extent)
        .ceil();
    if !low.cmplt(high).all() {
        return None;
    }
    let (width, height) = ((high.x - low.x) as usize, (high.y - low.y) as usize);
    let mut sums = Sums {
        width,
        height,
        // an edge on the right border adds to the two columns beyond
        values: vec![0.0; (width + 2) * height],
    };
    let mut from = ring[ring.len() - 1] - low;
    for &corner in ring {
        let to = corner - low;
        sums.add_unclipped(from, to);
        from = to;
    }
    let mut coverage = Vec::with_capacity(width * height);
    for row in sums.values.chunks_exact(width + 2) {
        let mut sum = 0.0;
        coverage.extend(row[..width].iter().map(|value| {
            sum += value;
            // rounding leaves traces of a unit in the last place beside the polygon
            if f64::abs(sum) < 1e-12 {
                0.0
            } else {
                sum.abs().min(1.0) as f32
            }
        }));
    }
    Some(Patch {
        col: low.x as usize,
        row: low.y as usize,
        width,
        coverage,
    })
}

struct Sums {
    width: usize,
    height: usize,
    values: Vec<f64>,
}

impl Sums {
    /// Splits an edge where it crosses the left and the right border; what lies beyond counts as lying on the border.
    fn add_unclipped(&mut self, from: DVec2, to: DVec2) {
        let right = self.width as f64;
        let mut cuts = [0.0, 1.0, 1.0, 1.0];
        let mut count = 1;
        for border in [0.0, right] {
            if (from.x < border) != (to.x < border) {
                cuts[count] = (border - from.x) / (to.x - from.x);
                count += 1;
            }
        }
        cuts[..count].sort_by(f64::total_cmp);
        cuts[count] = 1.0;
        for pair in cuts[..=count].windows(2) {
            let at = |t: f64| {
                let p = from.lerp(to, t);
                DVec2::new(p.x.clamp(0.0, right), p.y)
            };
            self.add(at(pair[0]), at(pair[1]));
        }
    }

    /// An edge between the left and the right border.
    fn add(&mut self, from: DVec2, to: DVec2) {
        let (sign, upper, lower) = if from.y < to.y {
            (1.0, from, to)
        } else {
            (-1.0, to, from)
        };
        let (top, bottom) = (upper.y.max(0.0), lower.y.min(self.height as f64));
        if top >= bottom {
            return;
        }
        let slope = (lower.x - upper.x) / (lower.y - upper.y);
        let right = self.width as f64;
        let x_at = |y: f64| (upper.x + slope * (y - upper.y)).clamp(0.0, right);
        for row in top.floor() as usize..bottom.ceil() as usize {
            let (begin, end) = (top.max(row as f64), bottom.min(row as f64 + 1.0));
            let (a, b) = (x_at(begin), x_at(end));
            let start = row * (self.width + 2);
            let values = &mut self.values[start..start + self.width + 2];
            add_span(values, sign * (end - begin), a.min(b), a.max(b));
        }
    }
}

/// Spreads an edge of signed height `height` that runs from `left` to `right` within one row.
fn add_span(values: &mut [f64], height: f64, left: f64, right: f64) {
    let first = left.floor() as usize;
    let end = right.ceil() as usize;
    if end <= first + 1 {
        let middle = 0.5 * (left + right) - first as f64;
        values[first] += height * (1.0 - middle);
        values[first + 1] += height * middle;
        return;
    }
    // the share of the edge left of x, integrated: what has been covered up to x
    let step = 1.0 / (right - left);
    let covered =
        |x: f64| 0.5 * step * (x.clamp(left, right) - left).powi(2) + (x - right).max(0.0);
    let mut before = [0.0, 0.0];
    for (cell, value) in values[first..=end].iter_mut().enumerate() {
        let total = covered((first + cell + 1) as f64);
        // the second difference of the integral
        *value += height * (total - 2.0 * before[0] + before[1]);
        before = [total, before[0]];
    }
}

/// A closed smooth curve: the quadratic B-spline of its control points, which touches the middles of their polygon.
pub(crate) fn smooth_ring(control: &[DVec2], pieces: usize) -> Vec<DVec2> {
    let n = control.len();
    let mut ring = Vec::with_capacity(n * pieces);
    for i in 0..n {
        let (before, here, after) = (control[(i + n - 1) % n], control[i], control[(i + 1) % n]);
        let (from, to) = (before.midpoint(here), here.midpoint(after));
        for piece in 0..pieces {
            let t = piece as f64 / pieces as f64;
            ring.push(from.lerp(here, t).lerp(here.lerp(to, t), t));
        }
    }
    ring
}

/// Corners of the polygon for a disc: within `7.6e-5` of the radius at any radius.
pub(crate) const DISC_CORNERS: usize = 256;

/// A disc as a regular polygon of the same area.
pub(crate) fn disc_ring(center: DVec2, radius: f64) -> Vec<DVec2> {
    let turn = std::f64::consts::TAU / DISC_CORNERS as f64;
    let reach = radius * (turn / turn.sin()).sqrt();
    (0..DISC_CORNERS)
        .map(|i| center + reach * DVec2::from_angle(turn * i as f64))
        .collect()
}

/// The convex hull of two discs: a limb or a bar with round ends.
pub(crate) fn limb_ring(from: DVec2, to: DVec2, radii: [f64; 2]) -> Vec<DVec2> {
    const HALF: usize = 10;
    let along = (to - from).normalize_or(DVec2::X);
    // the common tangents touch both discs at this angle from the axis
    let lean = ((radii[0] - radii[1]) / from.distance(to).max(1e-9))
        .clamp(-1.0, 1.0)
        .acos();
    let start = along.to_angle();
    let arc = |center: DVec2, radius: f64, begin: f64, end: f64| {
        (0..=HALF).map(move |i| {
            center + radius * DVec2::from_angle(begin + (end - begin) * i as f64 / HALF as f64)
        })
    };
    let turn = std::f64::consts::TAU;
    arc(to, radii[1], start - lean, start + lean)
        .chain(arc(from, radii[0], start + lean, start + turn - lean))
        .collect()
}

#[cfg(test)]
/// The area of a polygon, positive if it turns from x to y.
pub(crate) fn area(ring: &[DVec2]) -> f64 {
    let Some(&origin) = ring.first() else {
        return 0.0;
    };
    0.5 * ring
        .windows(2)
        .map(|pair| (pair[0] - origin).perp_dot(pair[1] - origin))
        .sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::coverage::{HalfPlane, disc_coverage, intersection_coverage};
    use crate::paint::center;
    use proptest::prelude::*;

    fn frame(size: Size, ring: &[DVec2]) -> Vec<f64> {
        let mut all = vec![0.0; size.pixels()];
        if let Some(patch) = cover(size, ring) {
            for (i, &c) in patch.coverage.iter().enumerate() {
                let (col, row) = (patch.col + i % patch.width, patch.row + i / patch.width);
                all[row * size.width() + col] = f64::from(c);
            }
        }
        all
    }

    proptest! {
        #[test]
        fn triangles_cover_what_clipping_says(
            p in prop::array::uniform6(-6.0..18.0f64), turned in any::<bool>()
        ) {
            let size = Size::new(12, 10).unwrap();
            let mut ring = [(p[0], p[1]), (p[2], p[3]), (p[4], p[5])].map(DVec2::from).to_vec();
            prop_assume!(area(&ring).abs() > 0.01);
            if turned { ring.reverse(); }
            let inward = -area(&ring).signum();
            let sides: Vec<HalfPlane> = (0..3).map(|i| {
                let (a, b) = (ring[i], ring[(i + 1) % 3]);
                let normal = inward * (b - a).perp().normalize();
                HalfPlane { normal, offset_px: normal.dot(a) }
            }).collect();
            for (i, found) in frame(size, &ring).into_iter().enumerate() {
                let exact = intersection_coverage(&sides, center(i % 12, i / 12));
                prop_assert!((found - exact).abs() < 1e-6, "{i}: {found} {exact}");
            }
        }

        #[test]
        fn disc_polygons_cover_as_discs_do(x in -3.0..15.0f64, y in -3.0..13.0f64, r in 0.2..6.0f64) {
            let size = Size::new(12, 10).unwrap();
            for (i, found) in frame(size, &disc_ring(DVec2::new(x, y), r)).into_iter().enumerate() {
                let exact = disc_coverage(DVec2::new(x, y), r, center(i % 12, i / 12));
                // the polygon is within 7.6e-5 r of the circle, over a border of at most √2
                prop_assert!((found - exact).abs() < 2e-4 * r.max(1.0), "{found} {exact}");
            }
        }
    }

    #[test]
    fn areas_of_limbs_and_curves_add_up() {
        let size = Size::new(60, 60).unwrap();
        let limb = limb_ring(DVec2::new(12.0, 15.0), DVec2::new(44.0, 39.0), [5.0, 5.0]);
        let expected = 40.0 * 10.0 + std::f64::consts::PI * 25.0;
        // round ends are polygons of 10 sides a half
        assert!((frame(size, &limb).iter().sum::<f64>() - expected).abs() < 0.02 * expected);
        let corners = [(10.0, 10.0), (50.0, 12.0), (45.0, 50.0), (20.0, 40.0)].map(DVec2::from);
        let curve = smooth_ring(&corners, 8);
        assert!((frame(size, &curve).iter().sum::<f64>() - area(&curve).abs()).abs() < 1e-3);
    }

    #[test]
    fn polygons_that_are_outside_or_no_numbers_cover_nothing() {
        let size = Size::new(8, 8).unwrap();
        let away = disc_ring(DVec2::new(-20.0, 4.0), 3.0);
        let wrong = [DVec2::NAN, DVec2::ONE, DVec2::ZERO];
        assert!(cover(size, &away).is_none() && cover(size, &wrong).is_none());
        assert!(cover(size, &away[..2]).is_none());
        let all = [(-9.0, -9.0), (30.0, -9.0), (30.0, 30.0), (-9.0, 30.0)].map(DVec2::from);
        assert!(frame(size, &all).iter().all(|&c| c == 1.0));
    }
}

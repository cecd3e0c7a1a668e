//! Lines, and the exact share of a pixel on each side of one.
//!
//! Notation: `n` unit normal, `d` offset, `u = d − n·p` signed distance of a pixel's center `p` on side 0.

use glam::DVec2;

/// A straight line `n·p = d`. Side 0 is where `n·p < d`.
///
/// Positions are in pixels, y down, relative to whatever origin the owner states.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Line {
    /// Unit normal, pointing to side 1.
    pub normal: DVec2,
    /// Distance of the line from the origin along the normal, in pixels.
    pub offset_px: f64,
}

impl Line {
    /// The line whose normal has the angle `angle_rad` against the x axis (towards y, that is down).
    pub fn from_angle(angle_rad: f64, offset_px: f64) -> Self {
        Self {
            normal: DVec2::from_angle(angle_rad),
            offset_px,
        }
    }

    /// The angle of the normal against the x axis, −π to π.
    pub fn angle_rad(&self) -> f64 {
        self.normal.to_angle()
    }

    /// Signed distance of `point` from the line, in pixels; positive on side 1, negative on side 0.
    pub fn signed_distance(&self, point: DVec2) -> f64 {
        self.normal.dot(point) - self.offset_px
    }

    /// The same line seen from another origin.
    pub fn relative_to(&self, origin: DVec2) -> Self {
        Self {
            normal: self.normal,
            offset_px: self.offset_px - self.normal.dot(origin),
        }
    }

    /// The same line after scaling all positions by `factor` > 0.
    pub fn scaled(&self, factor: f64) -> Self {
        Self {
            normal: self.normal,
            offset_px: self.offset_px * factor,
        }
    }

    /// The share of the unit pixel centered at `center` that lies on side 0: the exact area, 0 to 1.
    pub fn coverage(&self, center: DVec2) -> f64 {
        coverage(self.normal, -self.signed_distance(center))
    }
}

/// The area of side 0 within a unit pixel whose center lies `u` pixels inside side 0.
///
/// The area under a box filter of an edge, integrated once along each axis: with `a = |n.x|`, `b = |n.y|` and
/// `F(t) = max(0, t)²`,
/// `[F(u + (a+b)/2) − F(u + (a−b)/2) − F(u − (a−b)/2) + F(u − (a+b)/2)] / 2ab`.
/// Near an axis, where `a` or `b` vanishes, the line crosses the pixel parallel to a side and the area is a clamped
/// distance; the two forms differ by less than 1e-4 there.
pub(crate) fn coverage(normal: DVec2, u: f64) -> f64 {
    let (a, b) = (normal.x.abs(), normal.y.abs());
    if a.min(b) < PARALLEL {
        return (u + 0.5).clamp(0.0, 1.0);
    }
    let (sum, difference) = (0.5 * (a + b), 0.5 * (a - b));
    if u >= sum {
        return 1.0;
    }
    if u <= -sum {
        return 0.0;
    }
    let square = |t: f64| t.max(0.0) * t.max(0.0);
    (square(u + sum) - square(u + difference) - square(u - difference)) / (2.0 * a * b)
}

/// The derivatives of [`coverage`] with respect to `u` and, at fixed `u`, to the angle of the normal.
///
/// The first is the length of the line within the pixel; the second follows from the formula with
/// `da/dθ` and `db/dθ` of the normal `(cos θ, sin θ)`.
pub(crate) fn coverage_gradient(normal: DVec2, u: f64) -> (f64, f64) {
    let (a, b) = (normal.x.abs(), normal.y.abs());
    if a.min(b) < PARALLEL {
        return (f64::from(u.abs() < 0.5 + BORDER), 0.0);
    }
    let (sum, difference) = (0.5 * (a + b), 0.5 * (a - b));
    if u.abs() >= sum {
        return (0.0, 0.0);
    }
    let plus = |t: f64| t.max(0.0);
    let (t1, t2, t3) = (plus(u + sum), plus(u + difference), plus(u - difference));
    let scale = 1.0 / (a * b);
    let along = (t1 - t2 - t3) * scale;
    let area = 0.5 * (t1 * t1 - t2 * t2 - t3 * t3) * scale;
    // d|cos θ|/dθ and d|sin θ|/dθ
    let da = -normal.y * normal.x.signum();
    let db = normal.x * normal.y.signum();
    let d_sum = 0.5 * (da + db);
    let d_difference = 0.5 * (da - db);
    let numerator = t1 * d_sum - t2 * d_difference + t3 * d_difference;
    let turn = numerator * scale - area * (da * b + a * db) * scale;
    (along, turn)
}

/// Below this component of the unit normal the line counts as parallel to a pixel side. The general form divides by
/// the product of both components and would lose digits; the error of the parallel form is a quarter of this.
const PARALLEL: f64 = 1e-4;

/// A line along the border of pixels touches those on both sides: within this distance they count as crossed, so that the
/// derivatives do not depend on how `u` is rounded.
const BORDER: f64 = 1e-5;

#[cfg(test)]
mod tests {
    use super::*;

    /// The definition: the share of 200 × 200 points.
    fn coverage_naive(line: &Line, center: DVec2) -> f64 {
        let n = 200;
        let inside = (0..n * n).filter(|i| {
            let p =
                center + DVec2::new((i % n) as f64 + 0.5, (i / n) as f64 + 0.5) / n as f64 - 0.5;
            line.signed_distance(p) < 0.0
        });
        inside.count() as f64 / (n * n) as f64
    }

    #[test]
    fn coverage_is_the_area_of_the_pixel_on_side_0() {
        for step in 0..360 {
            let line = Line::from_angle(f64::from(step).to_radians() + 0.003, 0.37);
            for center in [DVec2::ZERO, DVec2::new(0.5, -0.5), DVec2::new(-0.3, 0.9)] {
                let error = line.coverage(center) - coverage_naive(&line, center);
                // a line crosses at most 400 of the 40 000 sample cells, each judged half right on average
                assert!(error.abs() < 6e-3, "{step} {center}: {error}");
            }
        }
    }

    #[test]
    fn coverage_of_both_sides_adds_up_to_one() {
        for step in 0..90 {
            let line = Line::from_angle(f64::from(step).to_radians(), 0.2);
            let opposite = Line {
                normal: -line.normal,
                offset_px: -line.offset_px,
            };
            let center = DVec2::new(0.4, 0.1);
            assert!((line.coverage(center) + opposite.coverage(center) - 1.0).abs() < 1e-9);
        }
    }

    #[test]
    fn gradient_agrees_with_finite_differences() {
        let h = 1e-6;
        for step in 0..720 {
            let angle = f64::from(step).to_radians() * 0.5 + 0.01;
            for u in [-0.6, -0.31, -0.05, 0.2, 0.45, 0.7] {
                let normal = DVec2::from_angle(angle);
                if normal.x.abs().min(normal.y.abs()) < 1e-3 {
                    continue;
                }
                let (along, turn) = coverage_gradient(normal, u);
                let numeric_along = (coverage(normal, u + h) - coverage(normal, u - h)) / (2.0 * h);
                let turned = |s: f64| coverage(DVec2::from_angle(angle + s), u);
                let numeric_turn = (turned(h) - turned(-h)) / (2.0 * h);
                // the second derivative is at most 1/(2ab), 500 here, so the difference quotient errs by 5e-4 at most
                assert!(
                    (along - numeric_along).abs() < 1e-3,
                    "{angle} {u}: {along} {numeric_along}"
                );
                assert!(
                    (turn - numeric_turn).abs() < 1e-3,
                    "{angle} {u}: {turn} {numeric_turn}"
                );
            }
        }
    }

    #[test]
    fn a_line_is_the_same_line_from_any_origin() {
        let line = Line::from_angle(1.1, 3.0);
        let (origin, point) = (DVec2::new(4.0, -2.0), DVec2::new(1.5, 7.0));
        let moved = line.relative_to(origin);
        assert!(
            (line.signed_distance(point) - moved.signed_distance(point - origin)).abs() < 1e-12
        );
    }
}

//! Contact of two triangles, against plain rational arithmetic on lattices small enough to be exhausted.

use glam::DVec3;
use proptest::prelude::*;
use ravec_mesh::{TriTri, intersection};

type Int3 = [i128; 3];
type Tri = [Int3; 3];

/// A rational point: `num / den` with `den > 0`.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
struct Point {
    num: Int3,
    den: i128,
}

fn gcd(a: i128, b: i128) -> i128 {
    if b == 0 { a.abs() } else { gcd(b, a % b) }
}

impl Point {
    fn new(num: Int3, den: i128) -> Self {
        let factor = num.iter().fold(den, |g, &x| gcd(g, x)) * den.signum();
        Self {
            num: num.map(|x| x / factor),
            den: den / factor,
        }
    }

    /// `den * (self - q)`.
    fn from(&self, q: Int3) -> Int3 {
        std::array::from_fn(|k| self.num[k] - self.den * q[k])
    }

    fn plus(&self, other: &Self) -> Self {
        let num = std::array::from_fn(|k| self.num[k] * other.den + other.num[k] * self.den);
        Self::new(num, self.den * other.den)
    }
}

fn sub(a: Int3, b: Int3) -> Int3 {
    std::array::from_fn(|k| a[k] - b[k])
}

fn dot(a: Int3, b: Int3) -> i128 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: Int3, b: Int3) -> Int3 {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

fn normal(t: &Tri) -> Int3 {
    cross(sub(t[1], t[0]), sub(t[2], t[0]))
}

/// Returns `true` if `p` is in the convex hull of `corners`, or with `strictly` in its relative interior.
fn holds(corners: &[Int3], p: &Point, strictly: bool) -> bool {
    let mut corners = corners.to_vec();
    corners.sort_unstable();
    corners.dedup();
    let enough = |x: i128| if strictly { x > 0 } else { x >= 0 };
    if let [a, b, c] = corners[..] {
        let t = [a, b, c];
        let n = normal(&t);
        if n != [0; 3] {
            return dot(n, p.from(a)) == 0
                && (0..3).all(|i| {
                    let edge = sub(t[(i + 1) % 3], t[i]);
                    enough(dot(n, cross(edge, p.from(t[i]))))
                });
        }
    }
    match (corners.first(), corners.last()) {
        (None, _) | (_, None) => false,
        (Some(&a), Some(&b)) if a == b => p.from(a) == [0; 3],
        // ends of a segment are its smallest and its largest corner
        (Some(&a), Some(&b)) => {
            let d = sub(b, a);
            cross(d, p.from(a)) == [0; 3] && enough(dot(d, p.from(a))) && enough(-dot(d, p.from(b)))
        }
    }
}

/// Points whose convex hull is what `a` and `b` share.
fn shared_points(a: &Tri, b: &Tri) -> Vec<Point> {
    let mut points = Vec::new();
    for (s, t) in [(a, b), (b, a)] {
        for &corner in s {
            let p = Point::new(corner, 1);
            if holds(t, &p, false) {
                points.push(p);
            }
        }
        let n = normal(t);
        for i in 0..3 {
            let (from, to) = (s[i], s[(i + 1) % 3]);
            let (h0, h1) = (dot(n, sub(from, t[0])), dot(n, sub(to, t[0])));
            if h0.signum() * h1.signum() < 0 {
                let num = std::array::from_fn(|k| from[k] * (h0 - h1) + (to[k] - from[k]) * h0);
                let p = Point::new(num, h0 - h1);
                if holds(t, &p, false) {
                    points.push(p);
                }
            }
        }
    }
    for i in 0..3 {
        for j in 0..3 {
            let (p, q) = (a[i], b[j]);
            let (d, e) = (sub(a[(i + 1) % 3], p), sub(b[(j + 1) % 3], q));
            let n = cross(d, e);
            let nn = dot(n, n);
            if nn == 0 || dot(n, sub(q, p)) != 0 {
                continue;
            }
            let s = dot(cross(sub(q, p), e), n);
            let t = dot(cross(sub(q, p), d), n);
            if (0..=nn).contains(&s) && (0..=nn).contains(&t) {
                points.push(Point::new(
                    std::array::from_fn(|k| p[k] * nn + d[k] * s),
                    nn,
                ));
            }
        }
    }
    points.sort_unstable_by_key(|p| (p.den, p.num));
    points.dedup();
    points
}

/// The definition of [`TriTri`], word by word.
fn by_definition(a: &Tri, b: &Tri) -> TriTri {
    let points = shared_points(a, b);
    if points.is_empty() {
        return TriTri::Disjoint;
    }
    if a.iter().all(|p| b.contains(p)) && b.iter().all(|p| a.contains(p)) {
        return TriTri::Same;
    }
    let common: Vec<Int3> = a.iter().copied().filter(|p| b.contains(p)).collect();
    if points.iter().all(|p| holds(&common, p, false)) {
        return TriTri::Neighbors;
    }
    // a mean of points that span a convex set is in its relative interior
    let sum = points[1..].iter().fold(points[0], |sum, p| sum.plus(p));
    let mean = Point::new(sum.num, sum.den * points.len() as i128);
    if !holds(a, &mean, true) || !holds(b, &mean, true) {
        return TriTri::Touch;
    }
    let all: Vec<Int3> = a.iter().chain(b).copied().collect();
    let flat = (1..6).all(|i| {
        (1..6).all(|j| {
            (1..6).all(|k| {
                let n = cross(sub(all[i], all[0]), sub(all[j], all[0]));
                dot(n, sub(all[k], all[0])) == 0
            })
        })
    });
    if flat {
        TriTri::CoplanarOverlap
    } else {
        TriTri::Crossing
    }
}

fn floats(t: &Tri) -> [DVec3; 3] {
    t.map(|p| DVec3::from_array(p.map(|x| x as f64)))
}

fn assert_agree_on_all(points: &[Int3]) {
    let n = points.len();
    let triangles =
        || (0..n * n * n).map(|code| [code / (n * n), code / n % n, code % n].map(|k| points[k]));
    let mut seen = std::collections::BTreeMap::new();
    for a in triangles().filter(|t| t.is_sorted()) {
        for b in triangles() {
            let expected = by_definition(&a, &b);
            let (x, y) = (floats(&a), floats(&b));
            assert_eq!(intersection(&x, &y), expected, "{a:?} {b:?}");
            assert_eq!(intersection(&y, &x), expected, "{b:?} {a:?}");
            *seen.entry(format!("{expected:?}")).or_insert(0) += 1;
        }
    }
    assert!(seen.len() >= 4, "{seen:?}");
}

#[test]
fn every_pair_of_triangles_between_the_corners_of_a_cube_is_right() {
    let points: Vec<Int3> = (0..8).map(|k| [k & 1, k >> 1 & 1, k >> 2]).collect();
    assert_agree_on_all(&points);
}

#[test]
fn every_pair_of_triangles_on_a_sloping_grid_of_nine_points_is_right() {
    let points: Vec<Int3> = (0..9)
        .map(|k| {
            let (u, v) = (k % 3, k / 3);
            [u + v, 2 * u - v, 3 * v]
        })
        .collect();
    assert_agree_on_all(&points);
}

#[test]
fn every_pair_of_segments_and_points_on_a_line_is_right() {
    let points: Vec<Int3> = (0..6).map(|k| [k, -2 * k, 3]).collect();
    assert_agree_on_all(&points);
}

fn lattice_triangle(side: i128) -> impl Strategy<Value = Tri> {
    prop::array::uniform3(prop::array::uniform3(0..side))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(20_000))]

    #[test]
    fn random_triangles_of_a_small_lattice_are_right(a in lattice_triangle(4), b in lattice_triangle(4)) {
        prop_assert_eq!(intersection(&floats(&a), &floats(&b)), by_definition(&a, &b));
    }

    /// Affine maps change no incidence, but these take coordinates and determinants far beyond what the filter can
    /// decide, while the coordinates stay integers that a double holds.
    #[test]
    fn an_affine_map_with_large_coefficients_changes_no_answer(
        a in lattice_triangle(3),
        b in lattice_triangle(3),
        matrix in prop::array::uniform3(prop::array::uniform3(-(1i128 << 40)..1 << 40)),
        shift in prop::array::uniform3(-(1i128 << 50)..1 << 50),
    ) {
        prop_assume!(dot(matrix[0], cross(matrix[1], matrix[2])) != 0);
        let map = |p: Int3| std::array::from_fn(|k| dot(matrix[k], p) + shift[k]);
        let (x, y) = (a.map(map), b.map(map));
        prop_assert_eq!(intersection(&floats(&x), &floats(&y)), by_definition(&a, &b));
    }

    #[test]
    fn nearly_flat_maps_change_no_answer_either(
        a in lattice_triangle(3),
        b in lattice_triangle(3),
        rows in prop::array::uniform2(prop::array::uniform3(-(1i128 << 30)..1 << 30)),
        nudge in prop::array::uniform3(-1i128..2),
    ) {
        // the third coordinate is nearly the sum of the others
        let last = std::array::from_fn(|k| rows[0][k] + rows[1][k] + nudge[k]);
        prop_assume!(dot(rows[0], cross(rows[1], last)) != 0);
        let map = |p: Int3| [dot(rows[0], p), dot(rows[1], p), dot(last, p)];
        let (x, y) = (a.map(map), b.map(map));
        prop_assert_eq!(intersection(&floats(&x), &floats(&y)), by_definition(&a, &b));
    }
}

//! Generalized winding numbers: how often the triangles of a soup go around a point.
//!
//! A triangle contributes its signed solid angle as seen from the point, over 4π. The sum over a closed surface is 1
//! inside and 0 outside (exactly, but for rounding); around holes, cracks and overlaps it passes smoothly between the
//! values of the sides, which makes it the best guess of what is inside.
//!
//! Far from a group of triangles their sum is that of a few moments: the plain idea is to descend the tree, and to take
//! the moments of a node instead of its triangles where the point is farther than `beta` times the node's radius from its
//! middle.
//!
//! Source: Barill, Dickson, Schmidt, Levin and Jacobson, *Fast Winding Numbers for Soups and Clouds*, 2018. We differ in:
//! the moments are those of the triangles, not of points in their middle; and since the kernel is harmonic only the
//! symmetric part without trace is kept, which leaves 3 + 6 + 10 numbers up to second order.
//!
//! Guarantees: with `beta` infinite the sum over all triangles; a point in the plane of a triangle gets nothing from it,
//! so that a point on a smooth part of a closed surface has ½. At the default `beta` of 2 the error stayed below 0.005
//! on scans and parts of 10 thousand to 871 thousand triangles, 0.001 on average; at twice that it is twenty times smaller.
//! Does not guarantee: an error bound for soups whose normals are random; it grows with their area.
//! Cost: building 0.1 µs a triangle and level; a query 3 µs far from and 13 µs near a surface of a million
//! triangles; four times that for twice the `beta`.

use std::f64::consts::PI;

use glam::DVec3;
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;

use super::Bvh;
use super::node::{Child, STACK};
use super::turned::slots;
use crate::TriMesh;

/// The share of the full solid angle by which all triangles of `mesh` go around `p`: the plain sum, linear in the number of
/// triangles.
pub fn winding_number(mesh: &TriMesh, p: DVec3) -> f64 {
    let triangles = 0..mesh.triangles().len() as u32;
    let sum: f64 = triangles
        .map(|triangle| half_solid_angle(p, mesh.corners(triangle)))
        .sum();
    sum / (2.0 * PI)
}

/// Half the signed solid angle of a triangle as seen from `p`: positive from behind, where its corners run clockwise.
///
/// Source: Van Oosterom and Strackee, *The Solid Angle of a Plane Triangle*, 1983.
#[inline]
fn half_solid_angle(p: DVec3, corners: [DVec3; 3]) -> f64 {
    let [a, b, c] = corners.map(|corner| corner - p);
    let volume = a.dot(b.cross(c));
    // From within its plane a triangle is seen from neither side; also from its corners.
    if volume == 0.0 {
        return 0.0;
    }
    let (la, lb, lc) = (a.length(), b.length(), c.length());
    volume.atan2(la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb)
}

/// Winding numbers of the triangles of a [`Bvh`], in logarithmic time.
#[derive(Debug, Clone)]
pub struct WindingNumbers<'a> {
    bvh: &'a Bvh,
    /// By node.
    moments: Vec<Moments>,
}

impl<'a> WindingNumbers<'a> {
    /// The `beta` of [`Self::at`]: errors below 0.005, far from the ½ by which inside and outside differ.
    pub const BETA: f64 = 2.0;

    /// The moments of all nodes, computed in the caller's thread pool.
    #[expect(clippy::missing_panics_doc, reason = "nobody can cancel it")]
    pub fn new(bvh: &'a Bvh) -> Self {
        Self::try_new(bvh, &Progress::none()).expect("nobody can cancel it")
    }

    /// As [`Self::new`], for meshes of which that takes more than a moment.
    ///
    /// # Errors
    /// [`Cancelled`] soon after `progress` is cancelled.
    pub fn try_new(bvh: &'a Bvh, progress: &Progress) -> Result<Self, Cancelled> {
        let moments = slots(&bvh.nodes)
            .into_par_iter()
            .map(|below| {
                let triangles = &bvh.corners[below.start as usize..below.end as usize];
                Moments::of(triangles, progress)
            })
            .collect::<Result<_, Cancelled>>()?;
        Ok(Self { bvh, moments })
    }

    /// The winding number around `p` with a `beta` of [`Self::BETA`].
    #[inline]
    pub fn at(&self, p: DVec3) -> f64 {
        self.at_with_beta(p, Self::BETA)
    }

    /// Returns `true` if `p` is more inside than outside: the winding number is above ½.
    #[inline]
    pub fn is_inside(&self, p: DVec3) -> bool {
        self.at(p) > 0.5
    }

    /// The winding number around `p`; not a number if `p` is not finite.
    ///
    /// `beta` is how many radii a node must be away for its moments to stand for its triangles, 1 or more. Larger is
    /// slower and more accurate; infinity gives the plain sum.
    pub fn at_with_beta(&self, p: DVec3, beta: f64) -> f64 {
        if self.moments.is_empty() {
            return 0.0;
        }
        if !p.is_finite() {
            return f64::NAN;
        }
        let beta_sq = beta * beta;
        let mut far = 0.0;
        let mut near = 0.0;
        let mut stack = [0; STACK];
        let mut len = 1;
        while len > 0 {
            len -= 1;
            let at = stack[len] as usize;
            let moments = &self.moments[at];
            let offset = moments.center - p;
            let distance_sq = offset.length_squared();
            // False for an infinite beta, whatever the radius.
            if distance_sq > beta_sq * moments.radius_sq && beta_sq < f64::INFINITY {
                far += moments.seen_from(offset, distance_sq);
                continue;
            }
            let node = &self.bvh.nodes[at];
            for lane in 0..node.len() {
                match node.child(lane) {
                    Child::Node(child) => {
                        stack[len] = child;
                        len += 1;
                    }
                    Child::Leaf { first, count } => {
                        let slots = first as usize..(first + count) as usize;
                        for &corners in &self.bvh.corners[slots] {
                            near += half_solid_angle(p, corners);
                        }
                    }
                }
            }
        }
        far / (4.0 * PI) + near / (2.0 * PI)
    }
}

/// Number of triangles between two checks for cancellation: about a millisecond.
const AT_ONCE: usize = 1 << 14;

/// The moments of triangles about their middle: of the normal n and the offset d, integrated over the area.
#[derive(Debug, Clone, Copy)]
struct Moments {
    center: DVec3,
    /// The squared distance of the farthest corner.
    radius_sq: f64,
    /// n.
    first: DVec3,
    /// The symmetric part without trace of n d: xx, yy, zz, xy, xz, yz; those of unequal axes twice.
    second: [f64; 6],
    /// The symmetric part without trace of n d d: xxx, yyy, zzz, then three times xxy, xxz, yyx, yyz, zzx, zzy, and six
    /// times xyz.
    third: [f64; 10],
}

impl Moments {
    fn of(triangles: &[[DVec3; 3]], progress: &Progress) -> Result<Self, Cancelled> {
        progress.check()?;
        let mut area = 0.0;
        let mut center = DVec3::ZERO;
        for [a, b, c] in triangles {
            let weight = (b - a).cross(c - a).length();
            area += weight;
            center += weight * (a + b + c) / 3.0;
        }
        center = if area > 0.0 {
            center / area
        } else {
            triangles[0][0]
        };
        let mut radius_sq = 0.0_f64;
        let mut first = DVec3::ZERO;
        let mut second = [[0.0; 3]; 3];
        let mut third = [[[0.0; 3]; 3]; 3];
        for (i, corners) in triangles.iter().enumerate() {
            if i % AT_ONCE == AT_ONCE - 1 {
                progress.check()?;
            }
            let corners = corners.map(|corner| corner - center);
            let [a, b, c] = corners;
            let farthest = corners.map(DVec3::length_squared);
            radius_sq = farthest.into_iter().fold(radius_sq, f64::max);
            let normal = 0.5 * (b - a).cross(c - a);
            let sum = a + b + c;
            first += normal;
            for j in 0..3 {
                for i in 0..3 {
                    second[i][j] += normal[i] * sum[j] / 3.0;
                }
                for k in 0..3 {
                    // The mean of d d over a triangle.
                    let mean = (sum[j] * sum[k] + a[j] * a[k] + b[j] * b[k] + c[j] * c[k]) / 12.0;
                    for i in 0..3 {
                        third[i][j][k] += normal[i] * mean;
                    }
                }
            }
        }
        Ok(Self {
            center,
            radius_sq,
            first,
            second: second_harmonic(&second),
            third: third_harmonic(&third),
        })
    }

    /// The solid angle as seen from afar; `offset` leads from there to the center.
    ///
    /// With R the offset and r its length, the kernel is R / r³; its derivatives, applied to tensors without trace, leave
    /// -3 R R / r⁵ and, halved, 7.5 R R R / r⁷.
    #[inline]
    fn seen_from(&self, offset: DVec3, distance_sq: f64) -> f64 {
        let DVec3 { x, y, z } = offset;
        let [xx, yy, zz, xy, xz, yz] = self.second;
        let second = x * (xx * x + xy * y + xz * z) + y * (yy * y + yz * z) + z * (zz * z);
        let [xxx, yyy, zzz, xxy, xxz, yyx, yyz, zzx, zzy, xyz] = self.third;
        let third = x * x * (xxx * x + xxy * y + xxz * z)
            + y * y * (yyy * y + yyx * x + yyz * z)
            + z * z * (zzz * z + zzx * x + zzy * y)
            + xyz * x * y * z;
        let inverse_sq = 1.0 / distance_sq;
        let cubed = inverse_sq * inverse_sq.sqrt();
        cubed * (self.first.dot(offset) + inverse_sq * (7.5 * inverse_sq * third - 3.0 * second))
    }
}

/// The coefficients of the quadratic form of `m` after the multiple of |x|² that makes it harmonic is taken off.
fn second_harmonic(m: &[[f64; 3]; 3]) -> [f64; 6] {
    let mean = (m[0][0] + m[1][1] + m[2][2]) / 3.0;
    [
        m[0][0] - mean,
        m[1][1] - mean,
        m[2][2] - mean,
        m[0][1] + m[1][0],
        m[0][2] + m[2][0],
        m[1][2] + m[2][1],
    ]
}

/// The coefficients of the cubic form of `m` after the multiple of |x|² that makes it harmonic is taken off.
fn third_harmonic(m: &[[[f64; 3]; 3]; 3]) -> [f64; 10] {
    // The sum over all orders of three indices, which for i = j counts equal ones three times.
    let once = |i: usize| m[i][i][i];
    let thrice = |i: usize, k: usize| m[i][i][k] + m[i][k][i] + m[k][i][i];
    let (xxy, xxz) = (thrice(0, 1), thrice(0, 2));
    let (yyx, yyz) = (thrice(1, 0), thrice(1, 2));
    let (zzx, zzy) = (thrice(2, 0), thrice(2, 1));
    let xyz = m[0][1][2] + m[0][2][1] + m[1][0][2] + m[1][2][0] + m[2][0][1] + m[2][1][0];
    // The Laplacian of the form is 2 (3 xxx + yyx + zzx) x + ..; that of (l x) |x|² is 10 l x.
    let lx = (3.0 * once(0) + yyx + zzx) / 5.0;
    let ly = (3.0 * once(1) + xxy + zzy) / 5.0;
    let lz = (3.0 * once(2) + xxz + yyz) / 5.0;
    [
        once(0) - lx,
        once(1) - ly,
        once(2) - lz,
        xxy - ly,
        xxz - lz,
        yyx - lx,
        yyz - lz,
        zzx - lx,
        zzy - ly,
        xyz,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bvh::tests::soup;
    use proptest::prelude::*;

    /// A sphere of radius 1 of `2 * around * (rings - 1)` triangles; only the rings from `from` on.
    fn sphere(around: u32, rings: u32, from: u32) -> TriMesh {
        let mut positions = vec![DVec3::Z, -DVec3::Z];
        for ring in 1..rings {
            for step in 0..around {
                let (polar, turn) = (
                    PI * f64::from(ring) / f64::from(rings),
                    2.0 * PI * f64::from(step) / f64::from(around),
                );
                let (sin, cos) = polar.sin_cos();
                positions.push(DVec3::new(sin * turn.cos(), sin * turn.sin(), cos));
            }
        }
        let at = |ring: u32, step: u32| match ring {
            0 => 0,
            ring if ring == rings => 1,
            ring => 2 + (ring - 1) * around + step % around,
        };
        let mut triangles = Vec::new();
        for ring in from..rings {
            for step in 0..around {
                let quad = [
                    at(ring, step),
                    at(ring + 1, step),
                    at(ring + 1, step + 1),
                    at(ring, step + 1),
                ];
                if ring + 1 < rings {
                    triangles.push([quad[0], quad[1], quad[2]]);
                }
                if ring > 0 {
                    triangles.push([quad[0], quad[2], quad[3]]);
                }
            }
        }
        TriMesh::new(positions, triangles).unwrap()
    }

    fn flipped(mesh: &TriMesh) -> TriMesh {
        let triangles = mesh.triangles().iter().map(|&[a, b, c]| [a, c, b]);
        TriMesh::new(mesh.positions().to_vec(), triangles.collect()).unwrap()
    }

    /// Places of a spiral through a ball of the given radius.
    fn places(count: u32, radius: f64) -> impl Iterator<Item = DVec3> {
        (0..count).map(move |i| {
            let share = (f64::from(i) + 0.5) / f64::from(count);
            let (turn, height) = (
                f64::from(i) * 2.399_963,
                2.0 * ((f64::from(i) * 0.618_034) % 1.0) - 1.0,
            );
            let flat = (1.0 - height * height).sqrt();
            radius * share.cbrt() * DVec3::new(flat * turn.cos(), flat * turn.sin(), height)
        })
    }

    #[test]
    fn closed_surfaces_go_around_their_inside_once_and_flipped_ones_backward() {
        let mesh = sphere(60, 30, 0);
        let bvh = Bvh::new(&mesh);
        let fast = WindingNumbers::new(&bvh);
        for p in places(300, 1.5) {
            // The tessellation lies between these radii.
            let inside = match p.length() {
                r if r < 0.99 => 1.0,
                r if r > 1.0 => 0.0,
                _ => continue,
            };
            assert!((winding_number(&mesh, p) - inside).abs() < 1e-12);
            assert!((winding_number(&flipped(&mesh), p) + inside).abs() < 1e-12);
            assert!((fast.at_with_beta(p, f64::INFINITY) - inside).abs() < 1e-12);
            assert!((fast.at(p) - inside).abs() < 0.005);
            assert_eq!(fast.is_inside(p), inside == 1.0);
        }
    }

    #[test]
    fn the_error_falls_more_than_tenfold_as_beta_doubles() {
        let mesh = sphere(100, 50, 25);
        let bvh = Bvh::new(&mesh);
        let fast = WindingNumbers::new(&bvh);
        let errors = |beta: f64| {
            let errors: Vec<f64> = places(400, 1.5)
                .map(|p| (fast.at_with_beta(p, beta) - winding_number(&mesh, p)).abs())
                .collect();
            let mean = errors.iter().sum::<f64>() / errors.len() as f64;
            (mean, errors.into_iter().fold(0.0, f64::max))
        };
        let [(mean, most), (mean_2, most_2), (mean_4, most_4)] = [2.0, 4.0, 8.0].map(errors);
        assert!(mean < 1e-3 && most < 5e-3, "{mean} {most}");
        assert!(
            mean_2 < mean / 10.0 && most_2 < most / 10.0,
            "{mean_2} {most_2}"
        );
        assert!(
            mean_4 < mean_2 / 10.0 && most_4 < most_2 / 10.0,
            "{mean_4} {most_4}"
        );
    }

    #[test]
    fn an_open_hemisphere_goes_halfway_around_its_center() {
        // The lower half, whose rim is a circle around the center: it takes half of the view.
        let mesh = sphere(64, 32, 16);
        let bvh = Bvh::new(&mesh);
        let fast = WindingNumbers::new(&bvh);
        assert!((winding_number(&mesh, DVec3::ZERO) - 0.5).abs() < 1e-12);
        assert!((fast.at(DVec3::ZERO) - 0.5).abs() < 1e-3);
        // Along the axis it leaves out the cap of the cone through the rim.
        for height in [-0.8, -0.3, 0.2, 0.7, 2.0_f64] {
            let inside = if height > -1.0 { 1.0 } else { 0.0 };
            let disc = 0.5 * (1.0 + height / (1.0 + height * height).sqrt());
            let p = DVec3::Z * height;
            // The rim is a polygon: it falls short of the circle by 1 / 1000.
            assert!(
                (winding_number(&mesh, p) - (inside - disc)).abs() < 2e-3,
                "{height}"
            );
            assert!((fast.at(p) - winding_number(&mesh, p)).abs() < 5e-3);
        }
    }

    #[test]
    fn a_place_on_the_surface_is_half_inside() {
        let corners = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
        let mesh = TriMesh::new(
            corners.to_vec(),
            vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
        );
        let mesh = mesh.unwrap();
        let on_face = DVec3::new(0.25, 0.25, 0.0);
        assert!((winding_number(&mesh, on_face) - 0.5).abs() < 1e-15);
        // An eighth of space at the corner where three faces meet at right angles; none of the three is seen from there.
        assert!((winding_number(&mesh, DVec3::ZERO) - 0.125).abs() < 1e-15);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn an_infinite_beta_gives_the_sum_over_any_soup(mesh in soup(150), p in [-2.0..2.0, -2.0..2.0, -2.0..2.0]) {
            let bvh = Bvh::new(&mesh);
            let p = DVec3::from_array(p) + bvh.bounds().min.max(DVec3::ZERO);
            let fast = WindingNumbers::new(&bvh);
            let expected = winding_number(&mesh, p);
            prop_assert!((fast.at_with_beta(p, f64::INFINITY) - expected).abs() < 1e-11);
            // Random normals: no cancellation helps, so the error is that of single nodes.
            prop_assert!((fast.at_with_beta(p, 16.0) - expected).abs() < 1e-3);
        }
    }

    #[test]
    fn nothing_goes_around_nothing_and_nowhere_has_no_number() {
        let empty = Bvh::new(&TriMesh::default());
        assert_eq!(WindingNumbers::new(&empty).at(DVec3::ZERO), 0.0);
        let mesh = sphere(8, 4, 0);
        let bvh = Bvh::new(&mesh);
        assert!(WindingNumbers::new(&bvh).at(DVec3::NAN).is_nan());
    }
}

//! The definition: every split of a small volume by a plane, in integers, and plain sums in double precision.

use crate::Noise;
use glam::DVec3;
use ravec_raster::color::oklab_from_linear;
use ravec_raster::{Color, Image};
use ravec_twocolor::volume::TwoColorVoxel;
use std::collections::{BTreeSet, HashMap};

pub type Point = [i32; 3];

fn minus(a: Point, b: Point) -> Point {
    std::array::from_fn(|i| a[i] - b[i])
}

fn cross(a: Point, b: Point) -> Point {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

fn dot(a: Point, b: Point) -> i32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// The voxels of a volume of up to 64, by x, then y, then t.
pub fn points([w, h, m]: [usize; 3]) -> Vec<Point> {
    (0..w * h * m)
        .map(|i| [i % w, i / w % h, i / (w * h)].map(|v| v as i32))
        .collect()
}

/// Adds the splits of the points by a hyperplane that rests on some of them, tilted a little any way.
///
/// Every hyperplane that splits a set of points can be moved, without a point changing sides, until it rests on as many
/// independent points as the dimension of the set allows. So the splits of a set are those of all such resting
/// hyperplanes, combined with the splits of what lies on each.
fn add_resting(
    all: &[Point],
    members: u64,
    side_of: impl Fn(Point) -> i32,
    known: &mut HashMap<u64, BTreeSet<u64>>,
    splits: &mut BTreeSet<u64>,
) {
    let (mut on, mut below, mut above) = (0u64, 0u64, 0u64);
    for (i, &point) in all.iter().enumerate() {
        if members >> i & 1 == 1 {
            match side_of(point).signum() {
                -1 => below |= 1 << i,
                0 => on |= 1 << i,
                _ => above |= 1 << i,
            }
        }
    }
    let inner = splits_of(all, on, known);
    splits.extend(inner.iter().flat_map(|s| [below | s, above | s]));
}

/// All splits of the members by a hyperplane of the space that they span, each as the members of either side; with the
/// trivial ones.
fn splits_of(
    all: &[Point],
    members: u64,
    known: &mut HashMap<u64, BTreeSet<u64>>,
) -> BTreeSet<u64> {
    if let Some(splits) = known.get(&members) {
        return splits.clone();
    }
    let ids: Vec<usize> = (0..all.len()).filter(|i| members >> i & 1 == 1).collect();
    let at = |i: usize| all[ids[i]];
    let mut splits = BTreeSet::from([0, members]);
    let direction = (1..ids.len()).map(|i| minus(at(i), at(0))).next();
    let normal = direction.and_then(|u| {
        (1..ids.len())
            .map(|i| cross(u, minus(at(i), at(0))))
            .find(|&n| n != [0; 3])
    });
    let is_solid = normal.is_some_and(|n| (1..ids.len()).any(|i| dot(n, minus(at(i), at(0))) != 0));
    match (direction, normal) {
        (None, _) => {}
        (Some(u), None) => {
            for i in 0..ids.len() {
                add_resting(
                    all,
                    members,
                    |p| dot(u, minus(p, at(i))),
                    known,
                    &mut splits,
                );
            }
        }
        (Some(_), Some(n)) if !is_solid => {
            for i in 0..ids.len() {
                for j in 0..i {
                    let across = cross(n, minus(at(i), at(j)));
                    let side_of = |p| dot(across, minus(p, at(j)));
                    add_resting(all, members, side_of, known, &mut splits);
                }
            }
        }
        _ => {
            for i in 0..ids.len() {
                for j in 0..i {
                    for k in 0..j {
                        let n = cross(minus(at(i), at(k)), minus(at(j), at(k)));
                        if n != [0; 3] {
                            let side_of = |p| dot(n, minus(p, at(k)));
                            add_resting(all, members, side_of, known, &mut splits);
                        }
                    }
                }
            }
        }
    }
    known.insert(members, splits.clone());
    splits
}

/// Every split of a volume by a plane into two parts that are not empty, one of each pair of complements.
pub fn all_splits(extents: [usize; 3]) -> Vec<u64> {
    let all = points(extents);
    let full = u64::MAX >> (64 - all.len());
    splits_of(&all, full, &mut HashMap::new())
        .into_iter()
        .filter(|&mask| mask != 0 && mask <= full ^ mask)
        .collect()
}

/// Oklab and alpha of each voxel.
pub type Voxels = Vec<([f64; 3], f64)>;

pub fn voxels_of<P: Color>(frames: &[Image<P>], col: usize, row: usize, side: usize) -> Voxels {
    let mut voxels = Vec::new();
    for frame in frames {
        for y in row * side..((row + 1) * side).min(frame.height()) {
            for x in col * side..((col + 1) * side).min(frame.width()) {
                let color = frame[(x, y)].to_linear();
                let lab = oklab_from_linear(color.rgb()).map(f64::from);
                voxels.push((lab, f64::from(color.alpha())));
            }
        }
    }
    voxels
}

/// The mean squared error of a split with the best colors, by its definition.
pub fn error_of_split(voxels: &Voxels, on_side_0: impl Fn(usize) -> bool) -> f64 {
    let mut error = 0.0;
    for wanted in [true, false] {
        let members = || (0..voxels.len()).filter(|&i| on_side_0(i) == wanted);
        let weight: f64 = members().map(|i| voxels[i].1).sum();
        let mean_alpha = weight / (members().count() as f64).max(1.0);
        for c in 0..3 {
            let sum: f64 = members().map(|i| voxels[i].1 * voxels[i].0[c]).sum();
            let mean = sum / weight.max(1e-12);
            error += members()
                .map(|i| voxels[i].1 * (voxels[i].0[c] - mean).powi(2))
                .sum::<f64>();
        }
        error += members()
            .map(|i| (voxels[i].1 - mean_alpha).powi(2))
            .sum::<f64>();
    }
    error / voxels.len() as f64
}

pub fn best_error(voxels: &Voxels, splits: &[u64]) -> f64 {
    splits
        .iter()
        .map(|mask| error_of_split(voxels, |i| mask >> i & 1 == 1))
        .fold(error_of_split(voxels, |_| true), f64::min)
}

/// The error of a fitted block, recomputed from the sides of its plane.
pub fn error_of_plane(
    voxel: &TwoColorVoxel,
    voxels: &Voxels,
    extents: [usize; 3],
    cube: [usize; 3],
) -> f64 {
    let middle = cube.map(|extent| 0.5 * (extent as f64 - 1.0));
    let points = points(extents);
    error_of_split(voxels, |i| {
        voxel.plane.is_some_and(|plane| {
            let position = DVec3::from_array(points[i].map(f64::from)) - DVec3::from_array(middle);
            plane.signed_distance(position) < 0.0
        })
    })
}

#[test]
fn the_oracle_finds_as_many_splits_as_are_known() {
    // 104 linear threshold functions of three variables, without the two constants, up to complement
    assert_eq!(all_splits([2, 2, 2]).len(), 51);
    // one frame: the counts of the plane
    assert_eq!(all_splits([2, 2, 1]).len(), 6);
    assert_eq!(all_splits([3, 3, 1]).len(), 28);
    assert_eq!(all_splits([4, 4, 1]).len(), 86);
    assert_eq!(all_splits([5, 1, 1]).len(), 4);
    // symmetric in the axes
    assert_eq!(all_splits([3, 2, 2]).len(), all_splits([2, 2, 3]).len());
}

#[test]
fn every_split_by_some_plane_is_among_those_of_the_oracle() {
    let extents = [3, 3, 3];
    let splits: BTreeSet<u64> = all_splits(extents).into_iter().collect();
    let mut noise = Noise(11);
    let mut seen = BTreeSet::new();
    for _ in 0..100_000 {
        let [x, y, t, d] = std::array::from_fn(|_| noise.normal());
        let mut mask = 0u64;
        for (i, p) in points(extents).into_iter().enumerate() {
            let [px, py, pt] = p.map(|v| f64::from(v - 1));
            mask |= u64::from(x * px + y * py + t * pt < d) << i;
        }
        let canonical = mask.min(((1 << 27) - 1) ^ mask);
        if canonical != 0 {
            assert!(splits.contains(&canonical));
            seen.insert(canonical);
        }
    }
    // the other way round only mostly: the rarest splits are met once in some 10^5 planes
    assert!(seen.len() * 10 > splits.len() * 9, "{} met", seen.len());
}

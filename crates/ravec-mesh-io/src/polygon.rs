//! Polygons cut into triangles.
//!
//! A quadrilateral is cut along its shorter diagonal among those that keep both halves on the same side. Larger
//! polygons are seen along their Newell normal; convex ones become a fan, others, and those with corners in the middle of a
//! straight side, are cut ear by ear.
//!
//! Guarantees: n − 2 triangles that use the corners in their cyclic order, so that the edges of the polygon stay edges;
//! a simple plane polygon is covered exactly once, up to [`MAX_EARS`] corners by triangles that all have an area. Does not
//! guarantee: anything but the count for polygons that cross
//! themselves or are far from plane. Cost: O(n) if convex, else O(n · reflex corners), and a fan beyond
//! [`MAX_EARS`] corners, so that a hostile file costs no more than a bounded time per corner.

use glam::{DVec2, DVec3};
use ravec_progress::{Cancelled, Progress};

/// Non-convex polygons with more corners become a fan. Text outlines have some hundred corners; at 2048 the worst case
/// costs about 4 µs a corner.
const MAX_EARS: usize = 2048;

/// Sine of the turn at a corner up to which its sides count as a straight line: coordinates of 32-bit floats and of six
/// decimals make such corners of straight ones. A circle of [`MAX_EARS`] corners turns by 3e-3.
const STRAIGHT: f64 = 1e-6;

/// Number of triangles that are made between two checks for cancellation.
const AT_ONCE: usize = 1 << 16;

/// Appends the triangles of the polygon `corners`, at least three, to `triangles`, as numbers of corners. Memory beside the
/// result is that of [`MAX_EARS`] corners at most.
///
/// # Errors
/// [`Cancelled`] soon after `progress` is cancelled.
pub(super) fn triangulate(
    corners: &[u32],
    positions: &[DVec3],
    triangles: &mut Vec<[u32; 3]>,
    progress: &Progress,
) -> Result<(), Cancelled> {
    let at = |corner: u32| positions[corner as usize];
    match *corners {
        [_, _, _] => triangles.push([0, 1, 2]),
        [a, b, c, d] => {
            let [pa, pb, pc, pd] = [a, b, c, d].map(at);
            let normal = |a: DVec3, b: DVec3, c: DVec3| (b - a).cross(c - a);
            let along_ac = normal(pa, pb, pc).dot(normal(pa, pc, pd)) > 0.0;
            let along_bd = normal(pa, pb, pd).dot(normal(pb, pc, pd)) > 0.0;
            let shorter_ac = pa.distance_squared(pc) <= pb.distance_squared(pd);
            // a diagonal beside a straight corner cuts off next to nothing
            let turns = |a: DVec3, b: DVec3, c: DVec3| {
                let lengths = (b - a).length() * (c - b).length();
                normal(a, b, c).length() > STRAIGHT * lengths
            };
            let proper_ac = along_ac && turns(pa, pb, pc) && turns(pc, pd, pa);
            let proper_bd = along_bd && turns(pd, pa, pb) && turns(pb, pc, pd);
            let cuts_ac = if proper_ac == proper_bd {
                along_ac && (shorter_ac || !along_bd) || shorter_ac && !along_bd
            } else {
                proper_ac
            };
            if cuts_ac {
                triangles.extend([[0, 1, 2], [0, 2, 3]]);
            } else {
                triangles.extend([[0, 1, 3], [1, 2, 3]]);
            }
        }
        _ if corners.len() > MAX_EARS => {
            let last = corners.len() as u32 - 1;
            for start in (1..last).step_by(AT_ONCE) {
                progress.check()?;
                let end = last.min(start.saturating_add(AT_ONCE as u32));
                triangles.extend((start..end).map(|i| [0, i, i + 1]));
            }
        }
        _ => cut_ears(corners, positions, triangles),
    }
    Ok(())
}

/// Twice the signed area.
fn turn(a: DVec2, b: DVec2, c: DVec2) -> f64 {
    (b - a).perp_dot(c - a)
}

/// Twice the signed area, and 0 for corners that count as straight if `straight` is their sine.
fn turn_beyond(straight: f64, a: DVec2, b: DVec2, c: DVec2) -> f64 {
    let turn = turn(a, b, c);
    if straight > 0.0 && turn.abs() <= straight * (b - a).length() * (c - b).length() {
        0.0
    } else {
        turn
    }
}

fn cut_ears(corners: &[u32], positions: &[DVec3], triangles: &mut Vec<[u32; 3]>) {
    let count = corners.len();
    let flat = flattened(corners, positions);
    let mut next: Vec<usize> = (0..count).map(|i| (i + 1) % count).collect();
    let mut previous: Vec<usize> = (0..count).map(|i| (i + count - 1) % count).collect();
    let at = |straight: f64, before: usize, corner: usize, after: usize| {
        turn_beyond(straight, flat[before], flat[corner], flat[after])
    };
    let has_straight = (0..count).any(|i| at(STRAIGHT, previous[i], i, next[i]) == 0.0);
    // without straight corners none needs to be recognized
    let mut straight = if has_straight { STRAIGHT } else { 0.0 };
    // straight corners stand in the way of ears like reflex ones: the edge behind an ear must not run along them
    let is_in_way = |straight: f64, before: usize, corner: usize, after: usize| {
        let turn = at(straight, before, corner, after);
        turn < 0.0 || has_straight && turn == 0.0
    };
    let in_way = |straight: f64, previous: &[usize], next: &[usize]| -> Vec<usize> {
        let open = (0..count).filter(|&i| next[i] != i);
        open.filter(|&i| is_in_way(straight, previous[i], i, next[i]))
            .collect()
    };
    let mut hollow = in_way(straight, &previous, &next);
    if hollow.is_empty() {
        triangles.extend((1..count as u32 - 1).map(|i| [0, i, i + 1]));
        return;
    }
    let (mut left, mut tip, mut tried) = (count, 0, 0);
    while left > 3 {
        let (before, after) = (previous[tip], next[tip]);
        let [a, b, c] = [before, tip, after].map(|i| flat[i]);
        let is_inside = |a: DVec2, b: DVec2, p: DVec2| {
            let slack = straight * (b - a).length() * (p - a).length();
            turn(a, b, p) >= -slack
        };
        let is_ear = at(straight, before, tip, after) > 0.0
            && !hollow.iter().any(|&i| {
                let p = flat[i];
                i != before
                    && i != tip
                    && i != after
                    && p != a
                    && p != b
                    && p != c
                    && is_inside(a, b, p)
                    && is_inside(b, c, p)
                    && is_inside(c, a, p)
            });
        // A polygon without ears crosses itself or has no area: any corner will do.
        if is_ear || tried > left && straight == 0.0 {
            triangles.push([before, tip, after].map(|i| i as u32));
            next[before] = after;
            previous[after] = before;
            // marks the corner as cut
            next[tip] = tip;
            left -= 1;
            tried = 0;
            hollow.retain(|&i| i != tip && is_in_way(straight, previous[i], i, next[i]));
            // Going on behind the ear instead of beside it avoids a fan of needles.
            tip = next[after];
        } else {
            tip = after;
            tried += 1;
            if tried > left && straight > 0.0 {
                // all that is left is thin: now the last bit of each coordinate counts
                straight = 0.0;
                hollow = in_way(straight, &previous, &next);
                tried = 0;
            }
        }
    }
    triangles.push([previous[tip], tip, next[tip]].map(|i| i as u32));
}

/// The polygon as seen along its Newell normal, counter-clockwise, relative to its first corner.
fn flattened(corners: &[u32], positions: &[DVec3]) -> Vec<DVec2> {
    let origin = positions[corners[0] as usize];
    let points = || corners.iter().map(|&v| positions[v as usize] - origin);
    let normal: DVec3 = points()
        .zip(points().cycle().skip(1))
        .map(|(p, q)| p.cross(q))
        .sum();
    let size = normal.abs();
    // Dropping the axis nearest to the normal keeps the sense of all turns.
    let (keep, sign): (fn(DVec3) -> DVec2, f64) = if size.x >= size.y && size.x >= size.z {
        (|p| DVec2::new(p.y, p.z), normal.x)
    } else if size.y >= size.z {
        (|p| DVec2::new(p.z, p.x), normal.y)
    } else {
        (|p| DVec2::new(p.x, p.y), normal.z)
    };
    let mirror = DVec2::new(1.0, if sign < 0.0 { -1.0 } else { 1.0 });
    points().map(|p| keep(p) * mirror).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn area(triangles: &[[u32; 3]], positions: &[DVec3]) -> (DVec3, f64) {
        let normals = triangles.iter().map(|t| {
            let [a, b, c] = t.map(|v| positions[v as usize]);
            0.5 * (b - a).cross(c - a)
        });
        normals.fold((DVec3::ZERO, 0.0), |(sum, sizes), normal| {
            (sum + normal, sizes + normal.length())
        })
    }

    fn cut(positions: &[DVec3]) -> Vec<[u32; 3]> {
        let corners: Vec<u32> = (0..positions.len() as u32).collect();
        let mut triangles = Vec::new();
        triangulate(&corners, positions, &mut triangles, &Progress::none()).unwrap();
        triangles
    }

    #[test]
    fn a_hollow_quadrilateral_is_cut_at_its_hollow_corner() {
        // The dart's shorter diagonal runs outside.
        let dart = [(0.0, 0.0), (4.0, -1.0), (1.0, 0.0), (4.0, 1.0)];
        let positions = dart.map(|(x, y)| DVec3::new(x, y, 0.0));
        for start in 0..4 {
            let mut turned = positions;
            turned.rotate_left(start);
            let (sum, sizes) = area(&cut(&turned), &turned);
            assert!((sum.length() - sizes).abs() < 1e-12, "start {start}");
        }
    }

    #[test]
    fn a_rectangle_of_unequal_diagonals_is_cut_along_the_shorter_one() {
        let kite = [(0.0, 0.0), (1.0, -0.5), (3.0, 0.0), (1.0, 0.5)];
        let positions = kite.map(|(x, y)| DVec3::new(x, y, 0.0));
        assert_eq!(cut(&positions), [[0, 1, 3], [1, 2, 3]]);
    }

    /// All triangles have an area and lie on the side of the polygon.
    fn assert_proper(positions: &[DVec3]) {
        let triangles = cut(positions);
        assert_eq!(triangles.len(), positions.len() - 2);
        let normal = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|v| positions[v as usize]);
            (b - a).cross(c - a)
        };
        let total: DVec3 = triangles.iter().map(normal).sum();
        for t in &triangles {
            let share = normal(t).dot(total) / total.length_squared();
            assert!(share > 1e-9, "{t:?} of {positions:?}: {share}");
        }
        let sizes: f64 = triangles.iter().map(|t| normal(t).length()).sum();
        assert!((sizes - total.length()).abs() < 1e-9 * sizes);
    }

    /// A polygon with `extra` corners on each of its sides, tilted so that they are straight only nearly.
    fn with_straight_corners(outline: &[(f64, f64)], extra: &[usize], start: usize) -> Vec<DVec3> {
        let turn = glam::DQuat::from_euler(glam::EulerRot::XYZ, 0.3, 0.7, 1.1);
        let mut positions = Vec::new();
        for (i, &(x, y)) in outline.iter().enumerate() {
            let (to_x, to_y) = outline[(i + 1) % outline.len()];
            let steps = extra[i % extra.len()] + 1;
            for step in 0..steps {
                let along = step as f64 / steps as f64;
                let at = DVec3::new(x + along * (to_x - x), y + along * (to_y - y), 0.0);
                positions.push(turn * at);
            }
        }
        let count = positions.len();
        positions.rotate_left(start % count);
        positions
    }

    #[test]
    fn polygons_with_straight_corners_become_triangles_with_an_area() {
        let square = [(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0)];
        let triangle = [(0.0, 0.0), (3.0, 0.0), (1.0, 2.0)];
        let bracket = [
            (0.0, 0.0),
            (3.0, 0.0),
            (3.0, 1.0),
            (1.0, 1.0),
            (1.0, 3.0),
            (0.0, 3.0),
        ];
        for outline in [&square[..], &triangle, &bracket] {
            for extra in [&[1, 0, 0, 0, 0, 0][..], &[0, 2], &[1], &[3, 0, 1], &[7]] {
                for start in 0..outline.len() * 8 {
                    assert_proper(&with_straight_corners(outline, extra, start));
                }
            }
        }
    }

    #[test]
    fn a_quadrilateral_with_a_straight_corner_is_cut_there() {
        let outline = [(0.0, 0.0), (0.1, 0.3), (0.3, 0.9), (1.0, 0.0)];
        for start in 0..4 {
            let mut positions = with_straight_corners(&outline, &[0], 0);
            positions.rotate_left(start);
            assert_proper(&positions);
        }
    }

    #[test]
    fn convex_polygons_without_straight_corners_stay_fans() {
        let positions: Vec<DVec3> = (0..60)
            .map(|i| {
                let (sin, cos) = (f64::from(i) / 60.0 * std::f64::consts::TAU).sin_cos();
                DVec3::new(cos, sin, 0.0)
            })
            .collect();
        let fan: Vec<[u32; 3]> = (1..59).map(|i| [0, i, i + 1]).collect();
        assert_eq!(cut(&positions), fan);
    }

    proptest! {
        /// A polygon that is star-shaped around the origin is simple, whatever its radii.
        #[test]
        fn a_star_shaped_polygon_is_covered_exactly_once(
            radii in prop::collection::vec(0.1_f64..1.0, 4..40),
            tilt in -1.0_f64..1.0,
        ) {
            let count = radii.len() as f64;
            let positions: Vec<DVec3> = radii.iter().enumerate().map(|(i, r)| {
                let (sin, cos) = (i as f64 / count * std::f64::consts::TAU).sin_cos();
                DVec3::new(r * cos, r * sin, tilt * r * sin)
            }).collect();
            let triangles = cut(&positions);
            prop_assert_eq!(triangles.len(), positions.len() - 2);
            let (sum, sizes) = area(&triangles, &positions);
            prop_assert!((sum.length() - sizes).abs() < 1e-9 * sizes, "{} {}", sum.length(), sizes);
        }

        #[test]
        fn any_polygon_gives_two_triangles_fewer_than_corners(
            raw in prop::collection::vec(prop::array::uniform3(-2_i8..3), 3..30),
        ) {
            let positions: Vec<DVec3> = raw.iter().map(|&p| DVec3::from_array(p.map(f64::from))).collect();
            prop_assert_eq!(cut(&positions).len(), positions.len() - 2);
        }
    }
}

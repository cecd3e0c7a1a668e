//! A strip of least area between two loops.
//!
//! Each triangle of a strip has a side in one loop and a corner in the other one, so that a strip is a way through the grid of
//! both loops' corners, and the best one is found by dynamic programming. Other than a surface of least area in the polygon that a
//! bridge joins both loops to, a strip cannot be pinched off into two lids.
//!
//! Cost: 10 ns times the corners of one loop times those of the other, and a byte for each.

use glam::DVec3;

use super::patch::Patch;

/// Most products of corners: some tens of milliseconds.
const MAX_STEPS: usize = 1 << 22;

/// A strip between two loops that run as the boundary does, so that they run around it in opposite directions, from these
/// corners of both on. Triangles run as the loops do; corners of the second are numbered after those of the first.
///
/// `None` if the loops are too long.
pub(super) fn strip(first: &[DVec3], second: &[DVec3], starts: [usize; 2]) -> Option<Patch> {
    let (n, m) = (first.len(), second.len());
    if n.checked_mul(m)? > MAX_STEPS {
        return None;
    }
    let a = |i: usize| (starts[0] + i) % n;
    let b = |j: usize| (starts[1] + m - j % m) % m;
    let area = |p: DVec3, q: DVec3, r: DVec3| 0.5 * (q - p).cross(r - p).length();
    // least areas up to each corner of the second loop, and whether the last step was along the first
    let mut least = vec![f64::INFINITY; m + 1];
    let mut is_along_first = vec![false; (n + 1) * (m + 1)];
    for i in 0..=n {
        for j in 0..=m {
            let (p, q) = (first[a(i)], second[b(j)]);
            let by_first = match i {
                0 => f64::INFINITY,
                _ => least[j] + area(first[a(i - 1)], p, q),
            };
            let by_second = match j {
                0 => f64::INFINITY,
                _ => least[j - 1] + area(second[b(j - 1)], q, p),
            };
            is_along_first[i * (m + 1) + j] = by_first <= by_second;
            least[j] = match (i, j) {
                (0, 0) => 0.0,
                _ => by_first.min(by_second),
            };
        }
    }
    let mut patch = Patch {
        triangles: Vec::with_capacity(n + m),
        area: least[m],
    };
    let (mut i, mut j) = (n, m);
    while i + j > 0 {
        let third = |k: usize| (n + b(k)) as u32;
        if is_along_first[i * (m + 1) + j] {
            patch
                .triangles
                .push([a(i - 1) as u32, a(i) as u32, third(j)]);
            i -= 1;
        } else {
            patch.triangles.push([third(j), third(j - 1), a(i) as u32]);
            j -= 1;
        }
    }
    Some(patch)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    #[test]
    fn a_strip_between_rings_is_the_wall_however_high() {
        let ring = |n: usize, z: f64, turn: f64| -> Vec<DVec3> {
            let angle = |i: usize| turn * TAU * i as f64 / n as f64;
            (0..n)
                .map(|i| DVec3::new(angle(i).cos(), angle(i).sin(), z))
                .collect()
        };
        for (n, m, height) in [
            (3, 3, 1.0),
            (40, 40, 9.0),
            (200, 200, 0.01),
            (300, 150, 2.0),
        ] {
            let (low, high) = (ring(n, 0.0, 1.0), ring(m, height, -1.0));
            for start in [0, n / 2] {
                let high_start = (m - start * m / n) % m;
                let patch = strip(&low, &high, [start, high_start]).unwrap();
                assert_eq!(patch.triangles.len(), n + m);
                let side = 2.0 * (TAU / (2.0 * n.max(m) as f64)).sin();
                if n == m {
                    let expected = n as f64 * side * height;
                    assert!(
                        (patch.area - expected).abs() < 1e-9,
                        "{} and not {expected}",
                        patch.area
                    );
                }
                // each side of both loops is used once, as it runs
                let mut sides: Vec<[u32; 2]> = patch
                    .triangles
                    .iter()
                    .flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]])
                    .collect();
                let all = sides.clone();
                sides.retain(|[a, b]| !all.contains(&[*b, *a]));
                sides.sort_unstable();
                let of_loop =
                    |from: u32, n: u32| (0..n).map(move |i| [from + i, from + (i + 1) % n]);
                let mut expected: Vec<_> = of_loop(0, n as u32)
                    .chain(of_loop(n as u32, m as u32))
                    .collect();
                expected.sort_unstable();
                assert_eq!(sides, expected);
            }
        }
        let long = ring(3000, 0.0, 1.0);
        assert!(strip(&long, &long, [0, 0]).is_none());
    }
}

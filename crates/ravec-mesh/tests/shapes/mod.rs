//! Meshes made by formulas, and how they are checked.

#![allow(
    dead_code,
    reason = "each file of tests is a program of its own, and uses some of these"
)]

use glam::DVec3;
use ravec_mesh::{CheckParams, MeshCheck, TriMesh, check};
use ravec_progress::Progress;

/// All that can be wrong with a mesh.
pub fn checked(mesh: &TriMesh) -> MeshCheck {
    check(mesh, &CheckParams::default(), &Progress::none()).unwrap()
}

/// The box from the origin to (1, 1, 1), each side a grid of `n` by `n` squares.
pub fn grid_box(n: u32) -> TriMesh {
    let mut names = std::collections::HashMap::new();
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    let mut name = |p: [u32; 3]| {
        *names.entry(p).or_insert_with(|| {
            positions.push(DVec3::from_array(p.map(f64::from)) / f64::from(n));
            positions.len() as u32 - 1
        })
    };
    for axis in 0..3 {
        for k in 0..2 * n * n {
            let (side, i, j) = (k / (n * n), k / n % n, k % n);
            let mut at = |u: u32, v: u32| {
                let mut p = [0; 3];
                (p[axis], p[(axis + 1) % 3], p[(axis + 2) % 3]) = (side * n, i + u, j + v);
                name(p)
            };
            let mut quad = [at(0, 0), at(1, 0), at(1, 1), at(0, 1)];
            if side == 0 {
                quad.reverse();
            }
            let [a, b, c, d] = quad;
            triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    TriMesh::new(positions, triangles).unwrap()
}

/// A torus with radii 3 and 1, of `n` by `m` squares.
pub fn torus(n: u32, m: u32) -> TriMesh {
    let angle = |i: u32, n: u32| std::f64::consts::TAU * f64::from(i) / f64::from(n);
    let positions = (0..n * m)
        .map(|k| {
            let ((s, c), (t, d)) = (angle(k / m, n).sin_cos(), angle(k % m, m).sin_cos());
            DVec3::new((3.0 + d) * c, (3.0 + d) * s, t)
        })
        .collect();
    let at = |i: u32, j: u32| i % n * m + j % m;
    let triangles = (0..n * m)
        .flat_map(|k| {
            let (i, j) = (k / m, k % m);
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            [[a, b, c], [a, c, d]]
        })
        .collect();
    TriMesh::new(positions, triangles).unwrap()
}

/// A square sheet of `n` by `n` cells with side 1, bent to the height of `height`.
pub fn sheet(n: u32, height: impl Fn(f64, f64) -> f64) -> TriMesh {
    let positions = (0..(n + 1) * (n + 1))
        .map(|k| {
            let [x, y] = [k % (n + 1), k / (n + 1)].map(|i| f64::from(i) / f64::from(n));
            DVec3::new(x, y, height(x, y))
        })
        .collect();
    let triangles = (0..n * (n + 1))
        .filter(|k| k % (n + 1) < n)
        .flat_map(|k| [[k, k + 1, k + n + 2], [k, k + n + 2, k + n + 1]])
        .collect();
    TriMesh::new(positions, triangles).unwrap()
}

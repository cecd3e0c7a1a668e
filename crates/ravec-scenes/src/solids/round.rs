//! Solids with curved sides, from a given number of triangles.

use std::collections::HashMap;
use std::f64::consts::{PI, TAU};

use glam::DVec3;

use super::Solid;
use super::shape::Shape;

/// The point of the unit circle after `i` of `n` steps.
fn step(i: u32, n: u32) -> (f64, f64) {
    let (sin, cos) = (TAU * f64::from(i) / f64::from(n)).sin_cos();
    (cos, sin)
}

fn sphere(
    name: &'static str,
    positions: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
    radius: f64,
) -> Solid {
    // the farthest any triangle comes from the sphere is not more than its plane
    let depth = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|v| positions[v as usize]);
        radius - (b - a).cross(c - a).normalize().dot(a)
    };
    let deviation = triangles.iter().map(depth).fold(0.0, f64::max);
    let solid = Solid::new(name, (positions, triangles), Shape::Sphere { radius });
    let volume = 4.0 / 3.0 * PI * radius.powi(3);
    Solid {
        deviation,
        ..solid.closed(4.0 * PI * radius * radius, volume, 0)
    }
}

/// A sphere around the origin, from an icosahedron whose triangles are divided in four `divisions` times: nearly
/// equilateral triangles.
pub fn icosphere(radius: f64, divisions: u32) -> Solid {
    let golden = 0.5 * (1.0 + 5_f64.sqrt());
    let mut positions = Vec::new();
    for (one, long) in [
        (-1.0, golden),
        (1.0, golden),
        (-1.0, -golden),
        (1.0, -golden),
    ] {
        positions.extend([
            DVec3::new(one, long, 0.0),
            DVec3::new(0.0, one, long),
            DVec3::new(long, 0.0, one),
        ]);
    }
    for p in &mut positions {
        *p = p.normalize();
    }
    // the sides of the icosahedron are its shortest distances: 2 among corners of length √(1 + golden²)
    let side_sq = 4.0 / (1.0 + golden * golden);
    let near =
        |a: usize, b: usize| (positions[a].distance_squared(positions[b]) - side_sq).abs() < 1e-9;
    let mut triangles = Vec::new();
    for (a, b, c) in
        (0..12).flat_map(|a| (a + 1..12).flat_map(move |b| (b + 1..12).map(move |c| (a, b, c))))
    {
        if near(a, b) && near(b, c) && near(c, a) {
            let outward = positions[a].dot(positions[b].cross(positions[c])) > 0.0;
            let [b, c] = if outward { [b, c] } else { [c, b] };
            triangles.push([a, b, c].map(|v| v as u32));
        }
    }
    for _ in 0..divisions {
        let mut middles = HashMap::new();
        let mut middle = |a: u32, b: u32| {
            *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
                let sum = positions[a as usize] + positions[b as usize];
                positions.push(sum.normalize());
                positions.len() as u32 - 1
            })
        };
        triangles = triangles
            .iter()
            .flat_map(|&[a, b, c]| {
                let [ab, bc, ca] = [middle(a, b), middle(b, c), middle(c, a)];
                [[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]
            })
            .collect();
    }
    for p in &mut positions {
        *p *= radius;
    }
    sphere("icosphere", positions, triangles, radius)
}

/// A sphere around the origin from `slices` (at least 3) around the z axis and `stacks` (at least 2) along it: needles at
/// the poles.
pub fn uv_sphere(radius: f64, slices: u32, stacks: u32) -> Solid {
    let (slices, stacks) = (slices.max(3), stacks.max(2));
    let mut positions = vec![DVec3::NEG_Z, DVec3::Z];
    for stack in 1..stacks {
        let (sin, cos) = (PI * f64::from(stack) / f64::from(stacks)).sin_cos();
        positions.extend((0..slices).map(|i| {
            let (x, y) = step(i, slices);
            DVec3::new(sin * x, sin * y, -cos)
        }));
    }
    for p in &mut positions {
        *p *= radius;
    }
    let at = |stack: u32, i: u32| 2 + (stack - 1) * slices + i % slices;
    let mut triangles = Vec::new();
    for i in 0..slices {
        triangles.push([0, at(1, i + 1), at(1, i)]);
        triangles.push([1, at(stacks - 1, i), at(stacks - 1, i + 1)]);
        for stack in 1..stacks - 1 {
            let [a, b] = [at(stack, i), at(stack, i + 1)];
            let [d, c] = [at(stack + 1, i), at(stack + 1, i + 1)];
            triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    sphere("sphere", positions, triangles, radius)
}

/// A closed cylinder around the z axis, centered, with `slices` (at least 3) sides.
pub fn cylinder(radius: f64, height: f64, slices: u32) -> Solid {
    let slices = slices.max(3);
    let half_height = 0.5 * height;
    let mut positions = vec![-half_height * DVec3::Z, half_height * DVec3::Z];
    positions.extend((0..2 * slices).map(|k| {
        let (x, y) = step(k / 2, slices);
        let z = if k % 2 == 0 {
            -half_height
        } else {
            half_height
        };
        DVec3::new(radius * x, radius * y, z)
    }));
    let at = |i: u32, top: u32| 2 + 2 * (i % slices) + top;
    let triangles = (0..slices)
        .flat_map(|i| {
            let [a, b] = [at(i, 0), at(i + 1, 0)];
            let [d, c] = [at(i, 1), at(i + 1, 1)];
            [[a, b, c], [a, c, d], [0, b, a], [1, d, c]]
        })
        .collect();
    let shape = Shape::Cylinder {
        radius,
        half_height,
    };
    let area = TAU * radius * (radius + height);
    let volume = PI * radius * radius * height;
    Solid {
        deviation: sagitta(radius, slices),
        ..Solid::new("cylinder", (positions, triangles), shape).closed(area, volume, 0)
    }
}

/// A closed cone around the z axis, from z = 0 to its tip at `height`, with `slices` (at least 3) sides.
pub fn cone(radius: f64, height: f64, slices: u32) -> Solid {
    let slices = slices.max(3);
    let mut positions = vec![DVec3::ZERO, height * DVec3::Z];
    positions.extend((0..slices).map(|i| {
        let (x, y) = step(i, slices);
        DVec3::new(radius * x, radius * y, 0.0)
    }));
    let at = |i: u32| 2 + i % slices;
    let triangles = (0..slices)
        .flat_map(|i| [[0, at(i + 1), at(i)], [1, at(i), at(i + 1)]])
        .collect();
    let area = PI * radius * (radius + radius.hypot(height));
    let volume = PI / 3.0 * radius * radius * height;
    Solid {
        deviation: sagitta(radius, slices),
        ..Solid::new(
            "cone",
            (positions, triangles),
            Shape::Cone { radius, height },
        )
        .closed(area, volume, 0)
    }
}

/// A torus around the z axis: a tube of radius `minor` around a circle of radius `major`, from `around` × `across`
/// squares (at least 3 each).
pub fn torus(major: f64, minor: f64, around: u32, across: u32) -> Solid {
    let (around, across) = (around.max(3), across.max(3));
    let positions = (0..around * across)
        .map(|k| {
            let ((x, y), (u, v)) = (step(k / across, around), step(k % across, across));
            let from_axis = major + minor * u;
            DVec3::new(from_axis * x, from_axis * y, minor * v)
        })
        .collect();
    let at = |i: u32, j: u32| i % around * across + j % across;
    let triangles = (0..around * across)
        .flat_map(|k| {
            let (i, j) = (k / across, k % across);
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            [[a, b, c], [a, c, d]]
        })
        .collect();
    let area = TAU * TAU * major * minor;
    let volume = 0.5 * area * minor;
    Solid {
        // a chord of the tube, drawn toward the axis by the chord around it
        deviation: sagitta(minor, across) + sagitta(major + minor, around),
        ..Solid::new(
            "torus",
            (positions, triangles),
            Shape::Torus { major, minor },
        )
        .closed(area, volume, 1)
    }
}

/// Distance of the sides of a regular polygon from its circle.
fn sagitta(radius: f64, sides: u32) -> f64 {
    radius * (1.0 - (PI / f64::from(sides)).cos())
}

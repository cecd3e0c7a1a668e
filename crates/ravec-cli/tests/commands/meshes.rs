//! Mesh files written by hand, so that the program is judged by something else than itself.

use std::fmt::Write as _;
use std::path::Path;

/// Places and, counted from 0, the corners of triangles.
pub struct Mesh {
    pub places: Vec<[f32; 3]>,
    pub triangles: Vec<[u32; 3]>,
}

/// A box from the origin, facing outward.
pub fn cuboid(x: f32, y: f32, z: f32) -> Mesh {
    let places = (0..8u8).map(|i| {
        let pick = |bit: u8, size: f32| if i >> bit & 1 == 1 { size } else { 0.0 };
        [pick(0, x), pick(1, y), pick(2, z)]
    });
    let sides = [
        [0, 2, 3, 1],
        [4, 5, 7, 6],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 4, 6, 2],
        [1, 3, 7, 5],
    ];
    let halves = |[a, b, c, d]: [u32; 4]| [[a, b, c], [a, c, d]];
    Mesh {
        places: places.collect(),
        triangles: sides.into_iter().flat_map(halves).collect(),
    }
}

/// A torus around the z axis, facing outward.
pub fn torus(major: f32, minor: f32, around: u32, across: u32) -> Mesh {
    let step = |i: u32, n: u32| (std::f32::consts::TAU * i as f32 / n as f32).sin_cos();
    let places = (0..around * across).map(|k| {
        let ((sin, cos), (up, out)) = (step(k / across, around), step(k % across, across));
        let radius = major + minor * out;
        [radius * cos, radius * sin, minor * up]
    });
    let at = |i: u32, j: u32| i % around * across + j % across;
    let triangles = (0..around * across).flat_map(|k| {
        let (i, j) = (k / across, k % across);
        let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
        [[a, b, c], [a, c, d]]
    });
    Mesh {
        places: places.collect(),
        triangles: triangles.collect(),
    }
}

/// A flat square of `cells` × `cells` squares, open.
pub fn sheet(cells: u32) -> Mesh {
    let row = cells + 1;
    let places = (0..row * row).map(|k| [(k % row) as f32, (k / row) as f32, 0.0]);
    let squares = (0..row * cells).filter(|k| k % row < cells);
    let triangles = squares.flat_map(|k| [[k, k + 1, k + row + 1], [k, k + row + 1, k + row]]);
    Mesh {
        places: places.collect(),
        triangles: triangles.collect(),
    }
}

impl Mesh {
    pub fn obj(&self) -> String {
        let mut text = String::new();
        for [x, y, z] in &self.places {
            writeln!(text, "v {x} {y} {z}").unwrap();
        }
        for [a, b, c] in self.triangles.iter().map(|t| t.map(|v| v + 1)) {
            writeln!(text, "f {a} {b} {c}").unwrap();
        }
        text
    }

    pub fn stl(&self) -> Vec<u8> {
        let mut bytes = vec![b' '; 80];
        bytes.extend((self.triangles.len() as u32).to_le_bytes());
        for triangle in &self.triangles {
            bytes.extend([0; 12]);
            for &vertex in triangle {
                let place = self.places[vertex as usize];
                bytes.extend(place.iter().flat_map(|x| x.to_le_bytes()));
            }
            bytes.extend([0; 2]);
        }
        bytes
    }
}

/// The files that examples are about: `part.stl`, a torus; `other.ply`, nearly the same; `sheet.obj`, open.
pub fn parts(folder: &Path) {
    let part = torus(2.0, 0.8, 48, 24);
    std::fs::write(folder.join("part.stl"), part.stl()).unwrap();
    std::fs::write(folder.join("sheet.obj"), sheet(8).obj()).unwrap();
    let other = torus(2.0, 0.75, 40, 20);
    let mut text = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
         element face {}\nproperty list uchar int vertex_indices\nend_header\n",
        other.places.len(),
        other.triangles.len()
    );
    for [x, y, z] in &other.places {
        writeln!(text, "{x} {y} {z}").unwrap();
    }
    for [a, b, c] in &other.triangles {
        writeln!(text, "3 {a} {b} {c}").unwrap();
    }
    std::fs::write(folder.join("other.ply"), text).unwrap();
}

//! Solids and sheets with flat sides: their meshes are the surfaces themselves.

use glam::{DVec2, DVec3};

use super::Solid;
use super::shape::{Rectangle, Shape};

/// A box around the origin.
pub fn cuboid(size: DVec3) -> Solid {
    let positions = (0..8)
        .map(|k| {
            let bits = [k & 1, k >> 1 & 1, k >> 2].map(f64::from);
            (DVec3::from_array(bits) - 0.5) * size
        })
        .collect();
    let quads: [[u32; 4]; 6] = [
        [0, 2, 3, 1],
        [4, 5, 7, 6],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 4, 6, 2],
        [1, 3, 7, 5],
    ];
    let triangles = quads
        .iter()
        .flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]])
        .collect();
    let area = 2.0 * (size.x * size.y + size.y * size.z + size.z * size.x);
    let shape = Shape::Box {
        half_size: 0.5 * size,
    };
    Solid::new("box", (positions, triangles), shape).closed(area, size.element_product(), 0)
}

/// A polygon in x and y, counter-clockwise, drawn out along z; `caps` are triangles of the polygon.
fn prism(name: &'static str, outline: Vec<DVec2>, caps: &[[u32; 3]], depth: f64) -> Solid {
    let (count, half_depth) = (outline.len() as u32, 0.5 * depth);
    let level = |z: f64| outline.iter().map(move |p| p.extend(z));
    let positions = level(-half_depth).chain(level(half_depth)).collect();
    let walls = (0..count).flat_map(|i| {
        let next = (i + 1) % count;
        let (a, b, c, d) = (i, next, next + count, i + count);
        [[a, b, c], [a, c, d]]
    });
    let caps = caps.iter().flat_map(|&[a, b, c]| {
        let above = [a, b, c].map(|v| v + count);
        [[a, c, b], above]
    });
    let triangles = walls.chain(caps).collect();
    let sides = || (0..outline.len()).map(|i| (outline[i], outline[(i + 1) % outline.len()]));
    let face: f64 = sides().map(|(p, q)| 0.5 * p.perp_dot(q)).sum();
    let length: f64 = sides().map(|(p, q)| p.distance(q)).sum();
    let shape = Shape::Prism {
        outline,
        half_depth,
    };
    let (area, volume) = (2.0 * face + depth * length, depth * face);
    Solid::new(name, (positions, triangles), shape).closed(area, volume, 0)
}

/// A wedge with its sharp edge on the z axis: an isosceles triangle with this angle, above 0 and below π, between two legs
/// of length `leg`, one on either side of the x axis, drawn out to `depth`.
pub fn wedge(angle_rad: f64, leg: f64, depth: f64) -> Solid {
    let end = leg * DVec2::from_angle(0.5 * angle_rad);
    let outline = vec![DVec2::ZERO, DVec2::new(end.x, -end.y), end];
    prism("wedge", outline, &[[0, 1, 2]], depth)
}

/// A comb: `fins` (at least 1) thin fins of this thickness and height on a base as thick as the gaps between them, drawn
/// out by as much as they are high, centered on the origin.
pub fn comb(fins: u32, thickness: f64, gap: f64, height: f64) -> Solid {
    let fins = fins.max(1);
    let width = f64::from(fins) * (thickness + gap) - gap;
    let middle = DVec2::new(0.5 * width, 0.5 * (gap + height));
    let at = |x: f64, y: f64| DVec2::new(x, y) - middle;
    // the sides of the fins, from left to right
    let sides: Vec<f64> = (0..2 * fins)
        .map(|i| f64::from(i / 2) * (thickness + gap) + f64::from(i % 2) * thickness)
        .collect();
    let count = sides.len() as u32;
    let mut outline: Vec<DVec2> = sides.iter().map(|&x| at(x, 0.0)).collect();
    // back along the top: down and up each fin
    for (i, &x) in sides.iter().enumerate().rev() {
        let (low, high) = (at(x, gap), at(x, gap + height));
        outline.extend(if i % 2 == 1 { [low, high] } else { [high, low] });
    }
    let base = |i: u32| count + 2 * (count - 1 - i) + 1 - i % 2;
    let tip = |i: u32| count + 2 * (count - 1 - i) + i % 2;
    let mut caps = Vec::new();
    for i in 0..count - 1 {
        let (a, b, c, d) = (i, i + 1, base(i + 1), base(i));
        caps.extend([[a, b, c], [a, c, d]]);
        if i % 2 == 0 {
            caps.extend([[d, c, tip(i + 1)], [d, tip(i + 1), tip(i)]]);
        }
    }
    prism("comb", outline, &caps, height)
}

/// Two squares of this side that cross at a right angle along the z axis: an open surface that intersects itself, without
/// common vertices.
pub fn crossing_plates(side: f64) -> Solid {
    let half = 0.5 * side;
    let plate = |along: DVec3| Rectangle {
        center: DVec3::ZERO,
        half_sides: [half * along, half * DVec3::Z],
    };
    let plates = vec![plate(DVec3::X), plate(DVec3::Y)];
    let positions = plates
        .iter()
        .flat_map(|plate| {
            let [u, v] = plate.half_sides;
            [-u - v, u - v, u + v, v - u]
        })
        .collect();
    let triangles = vec![[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]];
    Solid {
        area: Some(2.0 * side * side),
        ..Solid::new(
            "crossing plates",
            (positions, triangles),
            Shape::Rectangles(plates),
        )
    }
}

/// A flat rectangle at z = 0 around the origin, facing up, of `columns` × `rows` cells (at least 1 each): an open surface.
pub fn sheet(width: f64, height: f64, columns: u32, rows: u32) -> Solid {
    let (columns, rows) = (columns.max(1), rows.max(1));
    let pitch = columns + 1;
    let positions = (0..pitch * (rows + 1))
        .map(|k| {
            let x = f64::from(k % pitch) / f64::from(columns) - 0.5;
            let y = f64::from(k / pitch) / f64::from(rows) - 0.5;
            DVec3::new(width * x, height * y, 0.0)
        })
        .collect();
    let triangles = (0..pitch * rows)
        .filter(|k| k % pitch < columns)
        .flat_map(|k| [[k, k + 1, k + pitch + 1], [k, k + pitch + 1, k + pitch]])
        .collect();
    let rectangle = Rectangle {
        center: DVec3::ZERO,
        half_sides: [0.5 * width * DVec3::X, 0.5 * height * DVec3::Y],
    };
    Solid {
        area: Some(width * height),
        ..Solid::new(
            "sheet",
            (positions, triangles),
            Shape::Rectangles(vec![rectangle]),
        )
    }
}

//! Colors of the vertices and texture coordinates of the triangles of a result, from those of the meshes that its triangles
//! come from.

use glam::{DVec2, DVec3};
use ravec::boolean::Boolean;
use ravec::mesh::{TriMesh, closest_on_triangle};

/// The color of what has none.
const NONE: [u8; 4] = [255; 4];

/// A color for each vertex of `result`; none at all if no mesh has any.
///
/// A vertex takes the color of the first triangle around it that comes from a mesh with colors: that of its corner, or a mixture
/// of those of the three corners where it is a new vertex.
pub(super) fn colors_of(
    result: &Boolean,
    meshes: &[TriMesh],
    colors: &[Vec<[u8; 4]>],
) -> Vec<[u8; 4]> {
    if colors.iter().all(Vec::is_empty) {
        return Vec::new();
    }
    let mut found: Vec<Option<[u8; 4]>> = vec![None; result.mesh.positions().len()];
    for (corners, origin) in result.mesh.triangles().iter().zip(&result.origins) {
        let of_mesh = &colors[origin.mesh as usize];
        let Some(triangle) = origin.triangle.filter(|_| !of_mesh.is_empty()) else {
            continue;
        };
        let mesh = &meshes[origin.mesh as usize];
        let own = mesh.triangles()[triangle as usize];
        for &v in corners {
            let place = &mut found[v as usize];
            if place.is_none() {
                let at = result.mesh.positions()[v as usize];
                *place = Some(mixed(
                    at,
                    own.map(|v| mesh.positions()[v as usize]),
                    own.map(|v| of_mesh[v as usize]),
                ));
            }
        }
    }
    found
        .into_iter()
        .map(|color| color.unwrap_or(NONE))
        .collect()
}

/// Texture coordinates for the corners of each triangle of `result`, NaN where there are none; none at all if no mesh has any.
///
/// A piece of a triangle shows what the triangle shows at its place.
pub(super) fn texture_of(
    result: &Boolean,
    meshes: &[TriMesh],
    textures: &[Vec<[DVec2; 3]>],
) -> Vec<[DVec2; 3]> {
    if textures.iter().all(Vec::is_empty) {
        return Vec::new();
    }
    let triangles = result.mesh.triangles().iter().zip(&result.origins);
    let texture = triangles.map(|(corners, origin)| {
        let of_mesh = &textures[origin.mesh as usize];
        let Some(triangle) = origin.triangle.filter(|_| !of_mesh.is_empty()) else {
            return [DVec2::NAN; 3];
        };
        let mesh = &meshes[origin.mesh as usize];
        let places = mesh.triangles()[triangle as usize].map(|v| mesh.positions()[v as usize]);
        corners.map(|v| {
            let shares = shares(result.mesh.positions()[v as usize], places);
            let parts = shares.into_iter().zip(of_mesh[triangle as usize]);
            // what has no share does not count, even if it is not a number
            let parts = parts.filter(|(share, _)| *share != 0.0);
            parts.map(|(share, at)| share * at).sum()
        })
    });
    texture.collect()
}

/// The color at a place on a triangle.
fn mixed(at: DVec3, corners: [DVec3; 3], colors: [[u8; 4]; 3]) -> [u8; 4] {
    let shares = shares(at, corners);
    std::array::from_fn(|channel| {
        let parts = shares.iter().zip(colors);
        let level: f64 = parts
            .map(|(share, color)| share * f64::from(color[channel]))
            .sum();
        level.round().clamp(0.0, 255.0) as u8
    })
}

/// The shares of the corners of a triangle at the place on it that is next to `at`: one alone at a corner.
fn shares(at: DVec3, corners: [DVec3; 3]) -> [f64; 3] {
    match corners.iter().position(|corner| *corner == at) {
        Some(corner) => std::array::from_fn(|i| f64::from(u8::from(i == corner))),
        None => weights(closest_on_triangle(at, &corners).point, corners),
    }
}

/// The barycentric coordinates of a place on a triangle; a third each if it has no area.
fn weights(at: DVec3, [a, b, c]: [DVec3; 3]) -> [f64; 3] {
    let normal = (b - a).cross(c - a);
    let whole = normal.length_squared();
    let share = |p: DVec3, q: DVec3| (p - at).cross(q - at).dot(normal) / whole;
    let weights = [share(b, c), share(c, a), share(a, b)];
    if weights.iter().all(|weight| weight.is_finite()) {
        weights
    } else {
        [1.0 / 3.0; 3]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colors_are_exact_at_corners_and_mixed_between_them() {
        let corners = [DVec3::ZERO, DVec3::X, DVec3::Y];
        let colors = [[200, 0, 0, 255], [0, 100, 0, 255], [0, 0, 40, 55]];
        assert_eq!(mixed(DVec3::X, corners, colors), colors[1]);
        let middle = (DVec3::X + DVec3::Y) / 2.0;
        assert_eq!(mixed(middle, corners, colors), [0, 50, 20, 155]);
        let quarter = DVec3::new(0.25, 0.25, 1e-3);
        assert_eq!(mixed(quarter, corners, colors), [100, 25, 10, 205]);
    }

    #[test]
    fn a_triangle_without_area_has_a_color_too() {
        let corners = [DVec3::ZERO, DVec3::X, 2.0 * DVec3::X];
        let mixed = mixed(0.5 * DVec3::X, corners, [[30; 4], [60; 4], [90; 4]]);
        assert_eq!(mixed, [60; 4]);
    }
}

//! Meshes whose distance function is a closed formula.
//!
//! Each [`Solid`] is a mesh together with the *ideal* surface it stands for: a sphere is the sphere, not the polyhedron
//! with the triangles of its mesh. Distances, area and volume are those of the ideal surface, and `deviation` bounds how
//! far the mesh is from it; it is 0 where the mesh is the surface itself.
//!
//! ```
//! use glam::DVec3;
//! use ravec_scenes::solids::torus;
//!
//! let torus = torus(3.0, 1.0, 64, 32);
//! assert_eq!(torus.distance(DVec3::new(6.0, 0.0, 0.0)), 2.0);
//! assert_eq!(torus.distance(DVec3::new(3.0, 0.0, 0.0)), -1.0);
//! assert!(torus.deviation < 0.02);
//! ```
//!
//! Guarantees: equal parameters and seeds give equal meshes; closed solids have triangles that run counter-clockwise as
//! seen from outside, without cracks. No formula here is taken from the crates it is to judge.

mod boulder;
mod flat;
mod round;
mod shape;
mod soup;

use glam::DVec3;
use ravec_mesh::TriMesh;

use crate::Seed;
use shape::Shape;

pub use boulder::{boulder, with_holes};
pub use flat::{comb, crossing_plates, cuboid, sheet, wedge};
pub use round::{cone, cylinder, icosphere, torus, uv_sphere};
pub use soup::{Planted, soup};

/// A mesh and the truth about it.
#[derive(Debug, Clone)]
pub struct Solid {
    /// Name of the solid, in one or two words.
    pub name: &'static str,
    /// The triangles.
    pub mesh: TriMesh,
    /// The area of the ideal surface, of a sheet on one side, where it is known.
    pub area: Option<f64>,
    /// The volume inside the ideal surface, if it is closed.
    pub volume: Option<f64>,
    /// The number of handles of the mesh, if it is a closed surface.
    pub genus: Option<u64>,
    /// No point of the mesh is farther than this from the ideal surface, nor the other way round.
    pub deviation: f64,
    shape: Shape,
    origin: DVec3,
}

impl Solid {
    fn new(name: &'static str, (positions, triangles): Parts, shape: Shape) -> Self {
        let mesh = TriMesh::new(positions, triangles)
            .expect("generators name the vertices they make, at places that are numbers");
        Self {
            name,
            mesh,
            area: None,
            volume: None,
            genus: None,
            deviation: 0.0,
            shape,
            origin: DVec3::ZERO,
        }
    }

    fn closed(self, area: f64, volume: f64, genus: u64) -> Self {
        Self {
            area: Some(area),
            volume: Some(volume),
            genus: Some(genus),
            ..self
        }
    }

    /// Returns `true` if distances have a sign.
    pub fn is_closed(&self) -> bool {
        self.volume.is_some()
    }

    /// The distance from `p` to the ideal surface; negative inside if it is closed.
    pub fn distance(&self, p: DVec3) -> f64 {
        self.shape.distance(p - self.origin)
    }

    /// The same thing elsewhere.
    ///
    /// # Panics
    /// If `shift` is not finite.
    #[must_use]
    pub fn shifted(self, shift: DVec3) -> Self {
        let (mut positions, triangles) = self.mesh.into_parts();
        for p in &mut positions {
            *p += shift;
        }
        let mesh = TriMesh::new(positions, triangles)
            .expect("a mesh stays one, as long as places stay numbers");
        Self {
            mesh,
            origin: self.origin + shift,
            ..self
        }
    }
}

/// Positions and triangles.
type Parts = (Vec<DVec3>, Vec<[u32; 3]>);

/// One of each, of a size of about 2 around the origin.
pub fn all(seed: Seed) -> Vec<Solid> {
    vec![
        icosphere(1.0, 4),
        uv_sphere(1.0, 48, 24),
        cuboid(DVec3::new(2.0, 1.5, 1.0)),
        cylinder(0.8, 2.0, 96),
        cone(1.0, 1.6, 96),
        torus(1.0, 0.4, 96, 48),
        wedge(20_f64.to_radians(), 1.0, 1.0),
        comb(6, 0.04, 0.16, 1.0),
        crossing_plates(1.0),
        sheet(2.0, 1.5, 6, 5),
        soup(40, seed).0,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use ravec_mesh::{Adjacency, Bvh, TriTri, intersection, measure};
    use std::f64::consts::TAU;

    /// The distance to the triangles of the mesh, by the plain definition.
    fn distance_to_mesh(solid: &Solid, p: DVec3) -> f64 {
        (0..solid.mesh.triangles().len() as u32)
            .map(|t| shape::distance_to_triangle(p, solid.mesh.corners(t)))
            .fold(f64::INFINITY, f64::min)
    }

    /// Winding number of the mesh around `p`: the sum of the solid angles of its triangles (van Oosterom and Strackee).
    fn winding(solid: &Solid, p: DVec3) -> f64 {
        let angle = |t: u32| {
            let [a, b, c] = solid.mesh.corners(t).map(|q| q - p);
            let [x, y, z] = [a, b, c].map(DVec3::length);
            let below = x * y * z + a.dot(b) * z + b.dot(c) * x + c.dot(a) * y;
            2.0 * a.dot(b.cross(c)).atan2(below)
        };
        (0..solid.mesh.triangles().len() as u32)
            .map(angle)
            .sum::<f64>()
            / (2.0 * TAU)
    }

    fn places(count: i64) -> impl Iterator<Item = DVec3> {
        let at = |i: i64, c: u64| Seed(5).between(i, 0, c, -1.8, 1.8);
        (0..count).map(move |i| DVec3::new(at(i, 0), at(i, 1), at(i, 2)))
    }

    #[test]
    fn formulas_and_meshes_are_the_same_surface_up_to_the_deviation() {
        for solid in all(Seed(1)) {
            for p in places(150) {
                let (formula, plain) = (solid.distance(p), distance_to_mesh(&solid, p));
                let off = (formula.abs() - plain).abs();
                assert!(
                    off <= solid.deviation + 1e-14,
                    "{} at {p}: {off}",
                    solid.name
                );
                let near = formula.abs() <= solid.deviation;
                if solid.is_closed() && !near {
                    let inside = winding(&solid, p) > 0.5;
                    assert_eq!(formula < 0.0, inside, "{} at {p}", solid.name);
                }
            }
        }
    }

    /// Returns `true` if triangles meet at edges in pairs, in opposite directions, and form one fan at each vertex.
    fn is_closed_surface(solid: &Solid, adjacency: &Adjacency) -> bool {
        let pairs = (0..adjacency.edges().len() as u32).all(|edge| {
            let uses = adjacency.uses(edge);
            uses.len() == 2 && uses[0].forward != uses[1].forward
        });
        pairs && adjacency.pinched_vertices(&solid.mesh).is_empty()
    }

    fn intersects_itself(solid: &Solid) -> bool {
        let mut found = false;
        Bvh::new(&solid.mesh).for_each_overlapping_pair(|a, b| {
            let kind = intersection(&solid.mesh.corners(a), &solid.mesh.corners(b));
            found |= !matches!(kind, TriTri::Disjoint | TriTri::Neighbors);
        });
        found
    }

    #[test]
    fn closed_solids_are_solids_with_their_area_and_volume() {
        for solid in all(Seed(1)) {
            let adjacency = Adjacency::new(&solid.mesh);
            let closed = is_closed_surface(&solid, &adjacency);
            assert_eq!(closed, solid.is_closed(), "{}", solid.name);
            if let Some(genus) = solid.genus {
                let [v, f] = [solid.mesh.positions().len(), solid.mesh.triangles().len()];
                let euler = (v + f) as i64 - adjacency.edges().len() as i64;
                assert_eq!(euler, 2 - 2 * genus as i64, "{}", solid.name);
            }
            let crossed = matches!(solid.name, "crossing plates" | "soup");
            assert_eq!(intersects_itself(&solid), crossed, "{}", solid.name);
            let measured = measure(&solid.mesh);
            if let Some(area) = solid.area {
                // within a layer as thick as the deviation, on surfaces with radii of 0.4 or more
                let off = (measured.area - area).abs();
                assert!(
                    off <= area * 5.0 * solid.deviation + 1e-13,
                    "{}: {off}",
                    solid.name
                );
            }
            if let (Some(volume), Some(area)) = (solid.volume, solid.area) {
                let off = (measured.volume - volume).abs();
                assert!(
                    off <= area * solid.deviation + 1e-13,
                    "{}: {off}",
                    solid.name
                );
            }
        }
    }

    #[test]
    fn a_shift_moves_mesh_and_formula() {
        let shift = DVec3::new(1048576.0, 0.0, -4.0);
        let there = wedge(0.5, 1.0, 2.0).shifted(shift);
        let here = wedge(0.5, 1.0, 2.0);
        let p = DVec3::new(0.25, 0.5, 0.125);
        assert_eq!(there.distance(p + shift), here.distance(p));
        assert_eq!(there.mesh.positions()[0], here.mesh.positions()[0] + shift);
    }

    #[test]
    fn equal_seeds_give_equal_meshes() {
        let [one, same, other] = [1, 1, 2].map(|seed| soup(30, Seed(seed)).0.mesh);
        assert_eq!(one, same);
        assert_ne!(one, other);
    }
}

//! A closed surface as a scan of a thing in nature has it: round, bumpy, without symmetry.

use glam::DVec3;
use ravec_mesh::TriMesh;

use super::icosphere;
use crate::Seed;

/// Number of waves that are laid over a ball.
const WAVES: i64 = 12;

/// A bumpy ball with a radius of about 1 around the origin, seen from which each direction meets it once.
///
/// Each triangle of an icosahedron is divided into `divisions` levels of four; `seed` says where the bumps are. Its radius in
/// a direction is 1 plus waves that add up to less than 0.3.
///
/// # Panics
/// If there are more than about 14 levels, whose triangles 32 bits cannot count.
pub fn boulder(divisions: u32, seed: Seed) -> TriMesh {
    let waves: Vec<(DVec3, f64)> = (0..WAVES)
        .map(|wave| {
            let [x, y, z] = [0, 1, 2].map(|axis| seed.between(wave, axis, 0, -1.0, 1.0));
            let frequency = 2.0 + 0.6 * wave as f64;
            let direction = DVec3::new(x, y, z).normalize_or(DVec3::Z);
            (
                frequency * direction,
                std::f64::consts::TAU * seed.unit(wave, 3, 0),
            )
        })
        .collect();
    let (mut positions, triangles) = icosphere(1.0, divisions).mesh.into_parts();
    for p in &mut positions {
        let bumps: f64 = waves
            .iter()
            .map(|(wave, phase)| (wave.dot(*p) + phase).sin() / wave.length())
            .sum();
        *p *= 1.0 + 0.12 * bumps / (WAVES as f64).sqrt();
    }
    TriMesh::new(positions, triangles).expect("a ball with finite radii is a mesh")
}

/// The triangles of `mesh` that have no corner within `radius` of one of `places`: as where a scanner did not see.
///
/// # Panics
/// Never: triangles of a mesh have its vertices.
pub fn with_holes(mesh: &TriMesh, places: &[DVec3], radius: f64) -> TriMesh {
    let is_seen = |corners: &&[u32; 3]| {
        let mut corners = corners.iter().map(|&v| mesh.positions()[v as usize]);
        corners.all(|corner| places.iter().all(|place| corner.distance(*place) > radius))
    };
    let kept = mesh.triangles().iter().filter(is_seen).copied();
    let kept = TriMesh::new(mesh.positions().to_vec(), kept.collect());
    kept.expect("triangles of a mesh have its vertices")
}

#[cfg(test)]
mod tests {
    use super::*;
    use ravec_mesh::measure;

    #[test]
    fn a_boulder_is_closed_and_nearly_a_ball() {
        let mesh = boulder(3, Seed(5));
        assert_eq!(mesh.triangles().len(), 1280);
        let radii = mesh.positions().iter().map(|p| p.length());
        assert!(radii.clone().all(|radius| (radius - 1.0).abs() < 0.3));
        let spread = radii.clone().fold(0.0, f64::max) - radii.fold(f64::INFINITY, f64::min);
        assert!(spread > 0.05, "bumps of {spread}");
        assert!(measure(&mesh).volume > 2.0);
        assert_eq!(mesh, boulder(3, Seed(5)));
        assert_ne!(mesh, boulder(3, Seed(6)));
    }

    #[test]
    fn holes_are_where_they_were_asked_for() {
        let mesh = boulder(3, Seed(5));
        let open = with_holes(&mesh, &[DVec3::Z], 0.4);
        let gone = mesh.triangles().len() - open.triangles().len();
        assert!((20..200).contains(&gone), "{gone}");
        assert_eq!(with_holes(&mesh, &[], 0.4), mesh);
    }
}

//! The surface below the cursor.

use glam::DVec3;
use ravec::mesh::{Bvh, TriMesh};
use ravec::mesh_render::{Section, Sight};
use ravec::progress::Progress;
use std::sync::{Arc, OnceLock};

/// Hierarchies that are kept: of the mesh that is shown, and of those before it.
const KEPT: usize = 3;

/// A point of the surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Picked {
    /// The point.
    pub point: DVec3,
    /// The triangle that it is on, or that ends at the cap that it is on.
    pub triangle: u32,
    /// The unit normal of the surface there, toward the eye; 0 if the triangle has none.
    pub normal: DVec3,
    /// `true` if the point is on the cap of a section.
    pub on_cap: bool,
}

/// The nearest point of what is shown along a line of sight.
pub(super) fn pick(
    bvh: &Bvh,
    mesh: &TriMesh,
    section: Option<&Section>,
    sight: Sight,
) -> Option<Picked> {
    let beyond = |t: f64| match section {
        Some(section) => section.normal.dot(sight.origin + t * sight.direction) - section.offset,
        None => 0.0,
    };
    let hits = bvh.ray_hits(sight.origin, sight.direction);
    let hit = hits.into_iter().find(|hit| beyond(hit.t) <= 0.0)?;
    let [a, b, c] = mesh.corners(hit.triangle);
    let normal = (b - a).cross(c - a).normalize_or_zero();
    let toward = |normal: DVec3| {
        if normal.dot(sight.direction) > 0.0 {
            -normal
        } else {
            normal
        }
    };
    if let Some(section) = section
        && section.capped
        && hit.outward
    {
        // the inside is seen through the section: what is drawn there is the cap
        let slope = section.normal.dot(sight.direction);
        let t = -beyond(0.0) / slope;
        if t.is_finite() && (0.0..=hit.t).contains(&t) {
            return Some(Picked {
                point: sight.origin + t * sight.direction,
                triangle: hit.triangle,
                normal: toward(section.normal.normalize_or_zero()),
                on_cap: true,
            });
        }
    }
    Some(Picked {
        point: sight.origin + hit.t * sight.direction,
        triangle: hit.triangle,
        normal: toward(normal),
        on_cap: false,
    })
}

struct Build {
    mesh: Arc<TriMesh>,
    bvh: Arc<OnceLock<Bvh>>,
    progress: Progress,
}

/// Hierarchies of meshes, built on threads of their own.
#[derive(Default)]
pub(super) struct Picker {
    builds: Vec<Build>,
}

impl Picker {
    /// Starts to build the hierarchy of a mesh, unless that was done.
    pub fn want(&mut self, mesh: &Arc<TriMesh>, repaint: &Arc<dyn Fn() + Send + Sync>) {
        if let Some(known) = self.builds.iter().position(|b| Arc::ptr_eq(&b.mesh, mesh)) {
            let build = self.builds.remove(known);
            self.builds.push(build);
            return;
        }
        // what was not finished for another mesh may never be needed
        for build in self
            .builds
            .extract_if(.., |build| build.bvh.get().is_none())
        {
            build.progress.cancel();
        }
        if self.builds.len() == KEPT {
            self.builds.remove(0);
        }
        let build = Build {
            mesh: mesh.clone(),
            bvh: Arc::default(),
            progress: Progress::new(|_| {}),
        };
        let (mesh, bvh) = (mesh.clone(), build.bvh.clone());
        let (progress, repaint) = (build.progress.clone(), repaint.clone());
        let thread = std::thread::Builder::new().name("mesh picker".to_owned());
        // without a thread nothing is picked, and the canvas still works
        let started = thread.spawn(move || {
            if let Ok(built) = Bvh::try_new(&mesh, &progress) {
                let _ = bvh.set(built);
                repaint();
            }
        });
        if started.is_ok() {
            self.builds.push(build);
        }
    }

    /// The hierarchy of a mesh, once it is built.
    pub fn bvh(&self, mesh: &Arc<TriMesh>) -> Option<&Bvh> {
        let known = self.builds.iter().find(|b| Arc::ptr_eq(&b.mesh, mesh))?;
        known.bvh.get()
    }
}

impl Drop for Picker {
    fn drop(&mut self) {
        for build in &self.builds {
            build.progress.cancel();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ravec_scenes::solids::{cuboid, torus};

    /// The nearest place where a ray meets a triangle, by the formula of Moeller and Trumbore.
    fn naive(mesh: &TriMesh, section: Option<&Section>, sight: Sight) -> Option<f64> {
        let mut nearest: Option<f64> = None;
        for triangle in 0..mesh.triangles().len() as u32 {
            let [a, b, c] = mesh.corners(triangle);
            let (ab, ac) = (b - a, c - a);
            let p = sight.direction.cross(ac);
            let det = ab.dot(p);
            if det.abs() < 1e-12 {
                continue;
            }
            let from = sight.origin - a;
            let u = from.dot(p) / det;
            let q = from.cross(ab);
            let v = sight.direction.dot(q) / det;
            let t = ac.dot(q) / det;
            let at = sight.origin + t * sight.direction;
            let cut = section.is_some_and(|s| s.normal.dot(at) > s.offset);
            if u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 0.0 && !cut {
                nearest = Some(nearest.map_or(t, |known| known.min(t)));
            }
        }
        nearest
    }

    #[test]
    fn picks_are_those_of_a_loop_over_all_triangles() {
        let torus = torus(2.0, 0.7, 40, 20).mesh;
        let bvh = Bvh::new(&torus);
        let cut = Section {
            normal: DVec3::new(0.2, 1.0, 0.1),
            offset: 0.3,
            capped: false,
        };
        let mut hits = 0;
        for section in [None, Some(&cut)] {
            for i in 0..2000_u32 {
                let turn = |k: u32, n: f64| f64::from(i.wrapping_mul(k) % 1009) / 1009.0 * n;
                let origin = DVec3::new(turn(17, 12.0) - 6.0, -9.0, turn(41, 8.0) - 4.0);
                let to = DVec3::new(turn(91, 5.0) - 2.5, 0.0, turn(7, 2.0) - 1.0);
                let sight = Sight {
                    origin,
                    direction: (to - origin).normalize(),
                };
                let found = pick(&bvh, &torus, section, sight);
                let expected = naive(&torus, section, sight);
                assert_eq!(found.is_some(), expected.is_some(), "{sight:?}");
                if let (Some(found), Some(t)) = (found, expected) {
                    hits += 1;
                    let at = sight.origin + t * sight.direction;
                    assert!(found.point.distance(at) < 1e-9);
                    assert!(found.normal.dot(sight.direction) <= 0.0);
                }
            }
        }
        assert!(hits > 500, "{hits}");
    }

    #[test]
    fn caps_are_picked_on_the_plane_of_the_section() {
        let cube = cuboid(DVec3::splat(2.0)).mesh;
        let bounds = cube.bounds();
        let center = bounds.center();
        let bvh = Bvh::new(&cube);
        let sight = Sight {
            origin: center + DVec3::new(0.2, -9.0, 0.3),
            direction: DVec3::Y,
        };
        let plain = pick(&bvh, &cube, None, sight).unwrap();
        assert!((plain.point.y - bounds.min.y).abs() < 1e-12 && !plain.on_cap);
        // the front is taken away
        let mut section = Section {
            normal: -DVec3::Y,
            offset: -center.y,
            capped: true,
        };
        let cap = pick(&bvh, &cube, Some(&section), sight).unwrap();
        assert!((cap.point.y - center.y).abs() < 1e-12 && cap.on_cap);
        assert_eq!(cap.normal, -DVec3::Y);
        section.capped = false;
        let back = pick(&bvh, &cube, Some(&section), sight).unwrap();
        assert!((back.point.y - bounds.max.y).abs() < 1e-12 && !back.on_cap);
        let beside = Sight {
            origin: sight.origin + 7.0 * DVec3::X,
            ..sight
        };
        assert_eq!(pick(&bvh, &cube, None, beside), None);
    }
}

//! Connected components of the surface.

use crate::surface::TRIANGLES_AT_ONCE;
use glam::DVec3;
use ravec_mesh::Aabb;
use ravec_numeric::DisjointSets;
use ravec_progress::{Cancelled, Progress};

/// Returns the number of the connected component of each triangle.
pub(super) fn components(
    vertices: usize,
    triangles: &[[u32; 3]],
    progress: &Progress,
) -> Result<Vec<u32>, Cancelled> {
    let mut sets = DisjointSets::new(vertices);
    for some in triangles.chunks(TRIANGLES_AT_ONCE as usize) {
        progress.check()?;
        for &[a, b, c] in some {
            sets.join(a, b);
            sets.join(a, c);
        }
    }
    progress.check()?;
    let mut numbers = vec![u32::MAX; vertices];
    let mut count = 0;
    let numbered = triangles
        .iter()
        .map(|&[a, ..]| {
            let number = &mut numbers[sets.root(a) as usize];
            if *number == u32::MAX {
                *number = count;
                count += 1;
            }
            *number
        })
        .collect();
    Ok(numbered)
}

/// Share of a block in a component of the surface.
#[derive(Debug, Clone)]
pub(super) struct ComponentShare {
    /// One of the corners.
    pub origin: DVec3,
    /// Volume under the triangles as seen from the origin, and their vector area, which transfers the volume to other origins.
    pub volume: f64,
    area: DVec3,
    pub bounds: Aabb,
}

impl ComponentShare {
    pub fn at(origin: DVec3) -> Self {
        Self {
            origin,
            volume: 0.0,
            area: DVec3::ZERO,
            bounds: Aabb::EMPTY,
        }
    }

    pub fn add(&mut self, corners: [DVec3; 3]) {
        let [a, b, c] = corners.map(|corner| corner - self.origin);
        self.volume += a.dot(b.cross(c)) / 6.0;
        self.area += 0.5 * (b - a).cross(c - a);
        self.bounds = self.bounds.union(Aabb::around(corners));
    }

    pub fn join(&mut self, other: &Self) {
        self.volume += other.volume + other.area.dot(other.origin - self.origin) / 3.0;
        self.area += other.area;
        self.bounds = self.bounds.union(other.bounds);
    }
}

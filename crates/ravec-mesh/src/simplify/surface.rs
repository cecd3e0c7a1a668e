//! The mesh while it is being simplified.

use glam::DVec3;
use ravec_progress::Progress;

use super::{BoundaryRule, Keep, SimplifyError, SimplifyParams};
use crate::adjacency::is_proper;
use crate::keyed::KeyedSet;
use crate::{Adjacency, TriMesh};

/// The corners of a triangle that is gone.
pub(super) const GONE: [u32; 3] = [u32::MAX; 3];

/// Freedom of a vertex. The order matters: of two that merge, the larger one decides.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Class {
    /// On the smooth surface.
    Free,
    /// On a boundary or feature, with one neighbor on it to either side.
    Curve,
    /// Not to be moved.
    Fixed,
}

/// A key for the edge between two vertices.
#[inline]
pub(super) fn edge_key(a: u32, b: u32) -> u64 {
    u64::from(a.min(b)) << 32 | u64::from(a.max(b))
}

/// The edges between two triangles whose normals differ by more than an angle.
pub(super) fn creases(mesh: &TriMesh, adjacency: &Adjacency, angle_rad: f64) -> Vec<[u32; 2]> {
    if angle_rad >= std::f64::consts::PI {
        return Vec::new();
    }
    let cosine = angle_rad.cos();
    (0_u32..)
        .zip(adjacency.edges())
        .filter(|&(edge, _)| match adjacency.uses(edge) {
            [one, other] if one.forward != other.forward => {
                let [m, n] = [one, other].map(|at| {
                    let [p, q, r] = mesh.corners(at.triangle);
                    (q - p).cross(r - p)
                });
                // slivers without a normal of their own make no crease
                m.dot(n) < cosine * m.length() * n.length()
            }
            _ => false,
        })
        .map(|(_, &ends)| ends)
        .collect()
}

/// Triangles, positions, and which triangles are at which vertex.
pub(super) struct Surface {
    pub positions: Vec<DVec3>,
    pub triangles: Vec<[u32; 3]>,
    /// Start of the triangles of each vertex in `pool`, and their number. Some of them may be gone.
    stars: Vec<(usize, u32)>,
    /// Lists of triangles. A merged vertex gets a new list at the end.
    pool: Vec<u32>,
    pub alive: u64,
    /// Boundary edges, features and edges with more than two triangles.
    special: KeyedSet<u64>,
    /// Those of them that are features.
    features: KeyedSet<u64>,
    /// Number of special edges of each vertex.
    special_count: Vec<u32>,
    fixed: Vec<bool>,
}

impl Surface {
    pub fn new(
        mesh: &TriMesh,
        adjacency: &Adjacency,
        params: &SimplifyParams,
        keep: &Keep<'_>,
        progress: &Progress,
    ) -> Result<Self, SimplifyError> {
        const AT_ONCE: u32 = 1 << 16;
        let vertices = mesh.positions().len();
        let triangles: Vec<[u32; 3]> = mesh
            .triangles()
            .iter()
            .map(|&t| if is_proper(t) { t } else { GONE })
            .collect();
        let mut pool = Vec::with_capacity(4 * triangles.len());
        let mut stars = Vec::with_capacity(vertices);
        progress.check()?;
        for v in 0..vertices as u32 {
            if v.is_multiple_of(AT_ONCE) {
                progress.check()?;
            }
            let around = adjacency.triangles_at(v);
            stars.push((pool.len(), around.len() as u32));
            pool.extend_from_slice(around);
        }
        let mut fixed = vec![false; vertices];
        for v in adjacency.try_pinched_vertices(mesh, progress)? {
            fixed[v as usize] = true;
        }
        for &v in keep.vertices {
            fixed[v as usize] = true;
        }
        let mut features = KeyedSet::default();
        for &[a, b] in keep.features {
            if adjacency.edge_between(a, b).is_none() {
                return Err(SimplifyError::NoSuchEdge { ends: [a, b] });
            }
            features.insert(edge_key(a, b));
        }
        let mut special = features.clone();
        for [a, b] in creases(mesh, adjacency, params.feature_angle_rad) {
            special.insert(edge_key(a, b));
            features.insert(edge_key(a, b));
        }
        for (edge, &[a, b]) in (0_u32..).zip(adjacency.edges()) {
            if edge.is_multiple_of(AT_ONCE) {
                progress.check()?;
            }
            match adjacency.uses(edge) {
                [_] => {
                    special.insert(edge_key(a, b));
                    if params.boundary == BoundaryRule::Lock {
                        fixed[a as usize] = true;
                        fixed[b as usize] = true;
                    }
                }
                [one, other] if one.forward != other.forward => {}
                _ => {
                    special.insert(edge_key(a, b));
                }
            }
        }
        let mut special_count = vec![0; vertices];
        for &key in &special {
            special_count[(key >> 32) as usize] += 1;
            special_count[(key & u64::from(u32::MAX)) as usize] += 1;
        }
        let alive = triangles.iter().filter(|t| **t != GONE).count() as u64;
        Ok(Self {
            positions: mesh.positions().to_vec(),
            triangles,
            stars,
            pool,
            alive,
            special,
            features,
            special_count,
            fixed,
        })
    }

    /// The triangles at `v`.
    #[inline]
    pub fn star(&self, v: u32) -> impl Iterator<Item = (u32, [u32; 3])> {
        let (start, len) = self.stars[v as usize];
        self.pool[start..start + len as usize]
            .iter()
            .map(|&t| (t, self.triangles[t as usize]))
            .filter(|(_, corners)| *corners != GONE)
    }

    #[inline]
    pub fn corners(&self, triangle: u32) -> [DVec3; 3] {
        self.triangles[triangle as usize].map(|v| self.positions[v as usize])
    }

    #[inline]
    pub fn class(&self, v: u32) -> Class {
        match self.special_count[v as usize] {
            _ if self.fixed[v as usize] => Class::Fixed,
            0 => Class::Free,
            2 => Class::Curve,
            _ => Class::Fixed,
        }
    }

    #[inline]
    pub fn is_special(&self, a: u32, b: u32) -> bool {
        self.special_count[a as usize] > 0
            && self.special_count[b as usize] > 0
            && self.special.contains(&edge_key(a, b))
    }

    /// The edges that are features, in ascending order.
    pub fn features(&self) -> Vec<[u32; 2]> {
        let ends = |key: &u64| [(key >> 32) as u32, (key & u64::from(u32::MAX)) as u32];
        let mut features: Vec<[u32; 2]> = self.features.iter().map(ends).collect();
        features.sort_unstable();
        features
    }

    /// Merges `removed` into `kept`, which moves to `position`. `changed` are the triangles of either that do not have
    /// both, `vanishing` those that do.
    pub fn merge(
        &mut self,
        [kept, removed]: [u32; 2],
        position: DVec3,
        changed: &[u32],
        vanishing: &[u32],
    ) {
        if self.special_count[removed as usize] > 0 {
            let neighbors: Vec<u32> = self
                .star(removed)
                .flat_map(|(_, corners)| corners)
                .filter(|&w| w != removed)
                .collect();
            for w in neighbors {
                // each is met twice, but only once as an edge
                let old = edge_key(removed, w);
                if self.special.remove(&old) {
                    if w == kept {
                        self.special_count[kept as usize] -= 1;
                    } else {
                        self.special.insert(edge_key(kept, w));
                        self.special_count[kept as usize] += 1;
                    }
                }
                if self.features.remove(&old) && w != kept {
                    self.features.insert(edge_key(kept, w));
                }
            }
            self.special_count[removed as usize] = 0;
        }
        for &t in vanishing {
            self.triangles[t as usize] = GONE;
        }
        self.alive -= vanishing.len() as u64;
        for &t in changed {
            for v in &mut self.triangles[t as usize] {
                if *v == removed {
                    *v = kept;
                }
            }
        }
        self.positions[kept as usize] = position;
        let (start, len) = self.stars[kept as usize];
        let at = if changed.len() <= len as usize {
            start
        } else {
            let end = self.pool.len();
            self.pool.resize(end + changed.len(), 0);
            end
        };
        self.pool[at..at + changed.len()].copy_from_slice(changed);
        self.stars[kept as usize] = (at, changed.len() as u32);
        self.stars[removed as usize] = (0, 0);
    }
}

//! Parts of a picture that do not depend on the view, computed when they are first needed.

use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use glam::{DVec3, Vec3};
use ravec_mesh::{Aabb, TriMesh};
use ravec_progress::{Cancelled, Progress};

use super::edges::{EdgeKind, Edges};
use super::{Paint, RenderError, RenderParams, Rendering, draw, normals};

/// A mesh that is drawn many times: what does not depend on the view is computed once and kept.
///
/// # Guarantees
/// - Pictures are those of [`render`](super::render), bit for bit.
///
/// # Costs
/// 40 bytes a triangle for the shading and 60 for lines, each from when it is first needed.
pub struct PreparedMesh {
    mesh: Arc<TriMesh>,
    pub(super) prepared: Prepared,
}

impl PreparedMesh {
    /// Nothing is computed yet.
    pub fn new(mesh: Arc<TriMesh>) -> Self {
        Self {
            mesh,
            prepared: Prepared::default(),
        }
    }

    /// The mesh.
    pub fn mesh(&self) -> &Arc<TriMesh> {
        &self.mesh
    }

    /// The picture of the mesh.
    ///
    /// # Errors
    /// Those of [`render`](super::render).
    pub fn render(
        &self,
        paint: &Paint<'_>,
        params: &RenderParams,
        progress: &Progress,
    ) -> Result<Rendering, RenderError> {
        draw(&self.mesh, &self.prepared, paint, params, progress)
    }
}

/// The last value, and the angle that it belongs to.
type ByAngle<T> = Mutex<Option<(f64, Arc<T>)>>;

#[derive(Default)]
pub(super) struct Prepared {
    bounds: OnceLock<Aabb>,
    used: OnceLock<Option<Vec<DVec3>>>,
    normals: ByAngle<Vec<[Vec3; 3]>>,
    edges: OnceLock<Edges>,
    kinds: ByAngle<Vec<EdgeKind>>,
}

impl Prepared {
    pub fn bounds(&self, mesh: &TriMesh) -> Aabb {
        *self.bounds.get_or_init(|| mesh.bounds())
    }

    /// The places of the vertices that triangles use.
    pub fn used<'a>(&'a self, mesh: &'a TriMesh) -> &'a [DVec3] {
        let used = self.used.get_or_init(|| {
            let used = super::used_positions(mesh);
            (used.len() < mesh.positions().len()).then_some(used)
        });
        used.as_deref().unwrap_or(mesh.positions())
    }

    pub fn normals(
        &self,
        mesh: &TriMesh,
        smooth_angle_deg: f64,
        progress: &Progress,
    ) -> Result<Arc<Vec<[Vec3; 3]>>, Cancelled> {
        by_angle(&self.normals, smooth_angle_deg, || {
            normals::corner_normals(mesh, smooth_angle_deg, progress)
        })
    }

    pub fn edges(&self, mesh: &TriMesh, progress: &Progress) -> Result<&Edges, Cancelled> {
        if let Some(edges) = self.edges.get() {
            return Ok(edges);
        }
        let edges = Edges::new(mesh, progress)?;
        Ok(self.edges.get_or_init(|| edges))
    }

    pub fn kinds(
        &self,
        mesh: &TriMesh,
        angle_deg: f64,
        progress: &Progress,
    ) -> Result<Arc<Vec<EdgeKind>>, Cancelled> {
        let edges = self.edges(mesh, progress)?;
        by_angle(&self.kinds, angle_deg, || {
            edges.kinds(mesh, angle_deg, progress)
        })
    }
}

/// The cached value for an angle, computed if it is missing. The lock is released during the computation.
fn by_angle<T>(
    kept: &ByAngle<T>,
    angle_deg: f64,
    find: impl FnOnce() -> Result<T, Cancelled>,
) -> Result<Arc<T>, Cancelled> {
    let lock = || kept.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some((known, value)) = &*lock()
        && *known == angle_deg
    {
        return Ok(value.clone());
    }
    let found = Arc::new(find()?);
    *lock() = Some((angle_deg, found.clone()));
    Ok(found)
}

//! The canvas of meshes: views that are turned, moved and zoomed by hand, sections, colors by value, and measuring.
//!
//! Pictures are made by `ravec_mesh_render` on a thread of the canvas. While the hand moves they are coarse, and as fine as the
//! machine can make them in a tenth of a second; when it rests they are drawn again at full resolution. The last picture stays
//! until the next is there, and is moved and scaled along with the view in the meantime.

mod canvas;
mod gpu;
mod legend;
mod look;
mod marks;
mod measure;
mod options;
mod orbit;
mod pace;
mod picker;
mod renderer;

use glam::DVec3;
use ravec::mesh::{Aabb, TriMesh};
use ravec::mesh_render::ColorMap;
use std::sync::Arc;

pub use canvas::{AtRest, MeshCanvas};
pub use gpu::MeshGpu;
pub use measure::Measured;
pub use options::{MeshOptions, SectionOptions};
pub use orbit::{MeshView, OrbitCamera};
pub use picker::Picked;

/// Numbers at the vertices of a mesh, shown as colors.
#[derive(Debug, Clone, PartialEq)]
pub struct VertexValues {
    /// The title of the legend, such as "Distance (mm)".
    pub title: String,
    /// A number for each vertex; NaN is gray.
    pub values: Vec<f64>,
    /// The scale of colors.
    pub map: ColorMap,
    /// The values at the ends of the scale; those of the smallest and the largest value if not given.
    pub range: Option<[f64; 2]>,
}

/// A place of a mesh that is marked in red.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum MarkedPlace {
    /// A point in space.
    Point(DVec3),
    /// A line between two points in space.
    Segment([DVec3; 2]),
    /// The edge between two vertices.
    Edge([u32; 2]),
    /// A triangle.
    Triangle(u32),
}

/// A mesh as the canvas shows it.
#[derive(Debug, Clone)]
pub struct ShownMesh {
    /// The mesh.
    pub mesh: Arc<TriMesh>,
    /// Numbers that are shown as colors.
    pub values: Option<VertexValues>,
    /// Places that are marked, such as defects. Those that the mesh does not have are passed over.
    pub marked: Vec<MarkedPlace>,
    bounds: Aabb,
    /// Points that reach farthest in many directions: their view is about as large as that of the mesh.
    extremes: Arc<[DVec3]>,
}

impl ShownMesh {
    /// A mesh without colors and marks. Takes time in proportion to the mesh: not to be called from the window's thread.
    pub fn new(mesh: Arc<TriMesh>) -> Self {
        Self {
            bounds: mesh.bounds(),
            extremes: extremes(&mesh).into(),
            mesh,
            values: None,
            marked: Vec::new(),
        }
    }

    /// The same with numbers at the vertices. The canvas shows an error if there is not one for each.
    #[must_use]
    pub fn with_values(self, values: VertexValues) -> Self {
        Self {
            values: Some(values),
            ..self
        }
    }

    /// The same with marked places.
    #[must_use]
    pub fn with_marked(self, marked: Vec<MarkedPlace>) -> Self {
        Self { marked, ..self }
    }

    /// The box around the triangles; empty if there are none.
    pub fn bounds(&self) -> Aabb {
        self.bounds
    }

    /// The corners of a triangle, if the mesh has it.
    fn corners(&self, triangle: u32) -> Option<[DVec3; 3]> {
        ((triangle as usize) < self.mesh.triangles().len()).then(|| self.mesh.corners(triangle))
    }
}

/// The vertices of triangles that reach farthest along the axes, the diagonals, and directions between them.
fn extremes(mesh: &TriMesh) -> Vec<DVec3> {
    let steps = || (-2..=2).map(f64::from);
    let all = steps().flat_map(|x| steps().flat_map(move |y| steps().map(move |z| [x, y, z])));
    let directions = all.map(DVec3::from_array).filter(|direction| {
        let sizes = direction.abs();
        sizes.max_element() == 1.0 || sizes.element_sum() == 3.0 && sizes.min_element() == 0.0
    });
    let mut farthest: Vec<(DVec3, f64, DVec3)> = directions
        .map(|direction| (direction, f64::NEG_INFINITY, DVec3::ZERO))
        .collect();
    let mut seen = vec![false; mesh.positions().len()];
    for &vertex in mesh.triangles().iter().flatten() {
        if std::mem::replace(&mut seen[vertex as usize], true) {
            continue;
        }
        let at = mesh.positions()[vertex as usize];
        for (direction, most, extreme) in &mut farthest {
            let reach = direction.dot(at);
            if reach > *most {
                (*most, *extreme) = (reach, at);
            }
        }
    }
    farthest.retain(|&(_, most, _)| most > f64::NEG_INFINITY);
    farthest
        .into_iter()
        .map(|(_, _, extreme)| extreme)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use ravec_scenes::solids::torus;

    #[test]
    fn extremes_reach_about_as_far_as_the_mesh() {
        let torus = torus(2.0, 0.7, 60, 30).mesh;
        let extremes = extremes(&torus);
        assert!(extremes.len() == 50);
        let reach = |points: &[DVec3], direction: DVec3| {
            let reaches = points.iter().map(|at| at.dot(direction));
            reaches.fold(f64::NEG_INFINITY, f64::max)
        };
        for i in 0..200_i32 {
            let angle = f64::from(i);
            let direction = DVec3::new(angle.cos(), angle.sin(), (0.7 * angle).sin()).normalize();
            let whole = reach(torus.positions(), direction);
            let found = reach(&extremes, direction);
            // so that a fit to them shows all of the mesh
            assert!(found <= whole && found > 0.9 * whole, "{found} {whole}");
        }
    }

    #[test]
    fn a_mesh_without_triangles_has_neither_bounds_nor_extremes() {
        let empty = TriMesh::new(vec![DVec3::ONE], Vec::new()).unwrap();
        let shown = ShownMesh::new(Arc::new(empty));
        assert!(shown.bounds().is_empty() && shown.extremes.is_empty());
    }
}

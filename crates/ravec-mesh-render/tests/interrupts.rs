//! Work that is cancelled at any check stops, and checks come as often as the mesh is large.

use glam::DVec3;
use ravec_mesh::TriMesh;
use ravec_mesh_render::{Paint, RenderParams, render};
use ravec_progress::Progress;

/// A mesh of `count` tetrahedra, apart from one another, as parts of a machine are.
fn parts(count: u32) -> TriMesh {
    let mut positions = Vec::new();
    let mut triangles = Vec::new();
    for i in 0..count {
        let at = 2.1 * DVec3::from_array([i % 40, i / 40 % 40, i / 1600].map(f64::from));
        positions.extend([DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z].map(|p| at + p));
        let corners = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
        triangles.extend(corners.map(|t| t.map(|v| 4 * i + v)));
    }
    TriMesh::new(positions, triangles).unwrap()
}

/// Approximate number of checks for cancellation in `work`: the lowest power of 2 at which it is not stopped any more. `work` says
/// whether it was stopped.
fn checks(work: impl Fn(&Progress) -> bool) -> u64 {
    let powers = (0..40).map(|power| 1 << power);
    let mut powers = powers.skip_while(|&check| work(&Progress::cancelled_at(check)));
    powers.next().expect("the work has an end")
}

/// Between two checks there are at most so many triangles, times the passes that work makes over them.
const BETWEEN: u64 = 1 << 15;

#[track_caller]
fn assert_looks(what: &str, mesh: &TriMesh, work: impl Fn(&Progress) -> bool) {
    let checks = checks(work);
    let least = mesh.triangles().len() as u64 / BETWEEN;
    assert!(checks > least, "{what}: {checks} checks, not {least}");
}

#[test]
fn rendering_stops_wherever_it_is_cancelled() {
    let mesh = parts(35_000);
    let params = RenderParams::default();
    assert_looks("render", &mesh, |progress| {
        render(&mesh, &Paint::Plain, &params, progress).is_err()
    });
}

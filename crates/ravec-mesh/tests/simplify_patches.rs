//! Meshes simplified in patches: no seam, no harm, and nothing at fault.

mod shapes;

use glam::DVec3;
use ravec_mesh::{
    CollapseCandidate, JudgeFactory, Keep, Simplified, SimplifyError, SimplifyParams, TriMesh,
    Trust, simplify_patches,
};
use ravec_progress::Progress;
use shapes::{checked, grid_box};

/// Admits all.
#[derive(Default)]
struct Easygoing {
    keeps_apart: bool,
}

impl JudgeFactory for Easygoing {
    type Judge = fn(&CollapseCandidate<'_>) -> bool;

    fn judge(&self, _: &TriMesh, _: Trust) -> Self::Judge {
        |_| false
    }

    fn keeps_apart(&self) -> bool {
        self.keeps_apart
    }
}

fn run(mesh: &TriMesh, params: &SimplifyParams, keep: &Keep<'_>) -> Simplified {
    let judges = Easygoing::default();
    simplify_patches(mesh, params, keep.clone(), &judges, &Progress::none()).unwrap()
}

/// A shell of two wavy spheres, close to one another, of 37 632 triangles: eight patches.
fn thin_shell() -> TriMesh {
    let ball = grid_box(56);
    let wavy = |p: &DVec3, r: f64| {
        let n = (*p - 0.5).normalize();
        let waves = 0.08 * (9.0 * n.x).sin() * (7.0 * n.y + 1.0).sin() * (8.0 * n.z + 2.0).cos();
        n * (r + waves)
    };
    let outer = ball.positions().iter().map(|p| wavy(p, 1.004));
    let inner = ball.positions().iter().map(|p| wavy(p, 1.0));
    let count = ball.positions().len() as u32;
    let flipped = (ball.triangles().iter()).map(|&[a, b, c]| [a, c, b].map(|v| v + count));
    let triangles = ball.triangles().iter().copied().chain(flipped).collect();
    TriMesh::new(outer.chain(inner).collect(), triangles).unwrap()
}

#[test]
fn no_seam_is_left_on_the_sides_of_a_box() {
    let mesh = grid_box(40);
    for feature_angle_rad in [std::f64::consts::PI, 0.5] {
        let params = SimplifyParams {
            max_error: 1e-9,
            feature_angle_rad,
            ..SimplifyParams::default()
        };
        let simple = run(&mesh, &params, &Keep::default());
        assert_eq!(simple.mesh.triangles().len(), 12);
        assert!(checked(&simple.mesh).is_solid());
        let creases = if feature_angle_rad < 1.0 { 12 } else { 0 };
        assert_eq!(simple.features.len(), creases);
        // the corners of the box have integers as coordinates
        let corners = simple.mesh.positions().iter();
        assert!(corners.clone().all(|p| p.distance(p.round()) < 1e-9));
    }
}

#[test]
fn walls_in_different_patches_do_not_come_to_intersect_on_any_number_of_threads() {
    let mesh = thin_shell();
    let params = SimplifyParams {
        max_error: 0.003,
        ..SimplifyParams::default()
    };
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.unwrap()
            .install(|| run(&mesh, &params, &Keep::default()))
    };
    let simple = with(4);
    assert!(checked(&simple.mesh).is_solid());
    assert!(simple.report.triangles_after < simple.report.triangles_before / 4);
    assert_eq!(
        simple.report.triangles_after,
        simple.mesh.triangles().len() as u64
    );
    assert_eq!(simple, with(1));
}

#[test]
fn what_meets_is_undone_where_the_judges_were_believed_to_keep_walls_apart() {
    let mesh = thin_shell();
    let params = SimplifyParams {
        max_error: 0.003,
        ..SimplifyParams::default()
    };
    let judges = Easygoing { keeps_apart: true };
    let keep = Keep::default();
    let simple =
        simplify_patches(&mesh, &params, keep.clone(), &judges, &Progress::none()).unwrap();
    assert!(checked(&simple.mesh).is_solid());
    let careful = run(&mesh, &params, &keep);
    // without a judge walls do meet, so that it is another mesh
    assert_ne!(simple.mesh, careful.mesh);
    let [few, more] = [&careful, &simple].map(|simple| simple.mesh.triangles().len());
    assert!(more < few + few / 10, "{more} and {few}");
}

#[test]
fn vertices_and_features_to_keep_stay_across_patches() {
    let mesh = grid_box(40);
    let id = |p: DVec3| {
        let found = mesh.positions().iter().position(|q| q.distance(p) < 1e-9);
        found.unwrap() as u32
    };
    let along = |i: u32| id(DVec3::new(f64::from(i) / 40.0, 0.5, 1.0));
    let features: Vec<[u32; 2]> = (0..40).map(|i| [along(i), along(i + 1)]).collect();
    let lone = id(DVec3::new(0.25, 0.0, 0.25));
    let keep = Keep {
        features: &features,
        vertices: &[lone],
        ..Keep::default()
    };
    let params = SimplifyParams {
        max_error: 1e-9,
        ..SimplifyParams::default()
    };
    let simple = run(&mesh, &params, &keep);
    assert!(simple.vertex_origin.contains(&lone));
    let at = |v: u32| simple.mesh.positions()[v as usize];
    let length: f64 = (simple.features.iter())
        .map(|&[a, b]| at(a).distance(at(b)))
        .sum();
    assert!((length - 1.0).abs() < 1e-9, "{length}");
    assert!(simple.mesh.triangles().len() < 40);
}

/// Admits all in the beginning, but no triangle with a longer side in the end.
struct Strict {
    longest: f64,
}

impl Strict {
    fn refuses(longest: f64, [a, b, c]: [DVec3; 3]) -> bool {
        a.distance(b).max(b.distance(c)).max(c.distance(a)) > longest
    }
}

impl JudgeFactory for Strict {
    type Judge = Box<dyn Fn(&CollapseCandidate<'_>) -> bool + Sync>;

    fn judge(&self, _: &TriMesh, trust: Trust) -> Self::Judge {
        let longest = self.longest;
        Box::new(move |candidate| {
            trust == Trust::Final && candidate.after.iter().any(|&t| Self::refuses(longest, t))
        })
    }

    fn faults(&self, mesh: &TriMesh, triangles: &[u32]) -> Vec<u32> {
        let is_bad = |&t: &u32| Self::refuses(self.longest, mesh.corners(t));
        triangles.iter().copied().filter(is_bad).collect()
    }
}

#[test]
fn what_is_at_fault_is_undone_and_tried_again_with_care() {
    let mesh = grid_box(40);
    let params = SimplifyParams {
        max_error: 1e-9,
        ..SimplifyParams::default()
    };
    let strict = Strict { longest: 0.4 };
    let progress = Progress::none();
    let simple = simplify_patches(&mesh, &params, Keep::default(), &strict, &progress).unwrap();
    assert!(checked(&simple.mesh).is_solid());
    let all: Vec<u32> = (0..simple.mesh.triangles().len() as u32).collect();
    assert_eq!(strict.faults(&simple.mesh, &all), Vec::<u32>::new());
    assert!(all.len() > 12 && all.len() < 1000, "{}", all.len());
}

#[test]
fn a_number_of_triangles_is_refused_and_a_cancellation_heeded() {
    let mesh = grid_box(4);
    let params = SimplifyParams {
        target_triangles: 10,
        ..SimplifyParams::default()
    };
    let progress = Progress::none();
    let refused = simplify_patches(
        &mesh,
        &params,
        Keep::default(),
        &Easygoing::default(),
        &progress,
    );
    assert!(matches!(
        refused,
        Err(SimplifyError::BadParameter {
            name: "target_triangles",
            ..
        })
    ));
    progress.cancel();
    let params = SimplifyParams::default();
    let cancelled = simplify_patches(
        &mesh,
        &params,
        Keep::default(),
        &Easygoing::default(),
        &progress,
    );
    assert!(matches!(cancelled, Err(SimplifyError::Cancelled(_))));
}

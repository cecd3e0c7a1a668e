//! Simplified meshes: what they must keep, and how far they may go.

mod shapes;

use glam::DVec3;
use proptest::prelude::*;
use ravec_mesh::{
    BoundaryRule, Bvh, CheckParams, CollapseCandidate, Keep, MeshCheck, Simplified, SimplifyError,
    SimplifyParams, TriMesh, check, measure, simplify,
};
use ravec_progress::Progress;
use shapes::{checked, grid_box, sheet, torus};
use std::collections::BTreeSet;
use std::sync::atomic::{AtomicUsize, Ordering};

fn run(mesh: &TriMesh, params: &SimplifyParams) -> Simplified {
    simplify(mesh, params, &Keep::default(), |_| false, &Progress::none()).unwrap()
}

#[test]
fn a_box_ends_as_twelve_triangles_with_its_corners_in_place() {
    let params = SimplifyParams {
        max_error: 1e-9,
        ..SimplifyParams::default()
    };
    let simple = run(&grid_box(12), &params);
    assert_eq!(simple.mesh.triangles().len(), 12);
    for p in simple.mesh.positions() {
        let off = (*p - p.round()).length();
        assert!(off < 1e-12, "{p}");
    }
    assert!(checked(&simple.mesh).is_solid());
    assert!((measure(&simple.mesh).volume - 1.0).abs() < 1e-12);
}

#[test]
fn a_torus_keeps_its_hole_and_stays_within_the_error() {
    let mesh = torus(96, 48);
    let params = SimplifyParams {
        max_error: 0.01,
        ..SimplifyParams::default()
    };
    let simple = run(&mesh, &params);
    let found = checked(&simple.mesh);
    assert!(found.is_solid());
    assert_eq!((found.components, found.genus), (1, Some(1)));
    // sides of 0.28 around the tube and 0.5 along it have this error: 1700 triangles for the area of 118
    assert!(simple.report.triangles_after < 2200, "{:?}", simple.report);
    assert!(simple.report.largest_error.unwrap() <= 0.01);
    // the input is off by up to 1 - cos(π/48) = 0.0021 itself, and samples may miss a little
    let (original, bvh) = (Bvh::new(&mesh), Bvh::new(&simple.mesh));
    for p in mesh.positions() {
        assert!(bvh.closest(*p).unwrap().distance_sq <= 0.01_f64.powi(2));
    }
    for t in 0..simple.mesh.triangles().len() as u32 {
        let corners = simple.mesh.corners(t);
        for weights in [
            [0.6, 0.2, 0.2],
            [0.2, 0.6, 0.2],
            [0.1, 0.45, 0.45],
            [0.33, 0.33, 0.34],
        ] {
            let p = (0..3).map(|i| weights[i] * corners[i]).sum::<DVec3>();
            let off = original.closest(p).unwrap().distance_sq.sqrt();
            assert!(off < 0.012, "{off}");
        }
    }
}

#[test]
fn fewer_triangles_are_reached_exactly_or_by_one() {
    let mesh = torus(40, 20);
    for target in [1000, 401, 64] {
        let params = SimplifyParams {
            target_triangles: target,
            ..SimplifyParams::default()
        };
        let simple = run(&mesh, &params);
        assert!(simple.report.target_reached);
        assert!((target - 1..=target).contains(&simple.report.triangles_after));
        assert_eq!(simple.report.largest_error, None);
        assert!(checked(&simple.mesh).is_solid());
    }
}

#[test]
fn without_any_limit_a_solid_shrinks_to_a_few_triangles_but_not_to_none() {
    let ball = run(&grid_box(6), &SimplifyParams::default());
    assert!((4..=16).contains(&ball.mesh.triangles().len()));
    let ring = run(&torus(24, 12), &SimplifyParams::default());
    let found = checked(&ring.mesh);
    assert!(found.is_solid() && found.genus == Some(1), "{found:?}");
}

#[test]
fn a_rim_follows_its_shape_or_stays_as_it_is() {
    let mesh = sheet(16, |x, y| 0.1 * x * y);
    let follow = SimplifyParams {
        max_error: 0.004,
        ..SimplifyParams::default()
    };
    let lock = SimplifyParams {
        boundary: BoundaryRule::Lock,
        ..follow
    };
    let (followed, locked) = (run(&mesh, &follow), run(&mesh, &lock));
    for simple in [&followed, &locked] {
        let found = checked(&simple.mesh);
        assert_eq!((found.boundary_loops.count, found.manifold), (1, true));
        // the four sides are straight; a corner may be cut within the error
        let rim = &found.boundary_loops.listed[0];
        let length = 2.0 + 2.0 * 1.01_f64.sqrt();
        assert!((rim.length - length).abs() < 4.0 * 0.004, "{}", rim.length);
    }
    assert!(checked(&followed.mesh).boundary_edges.count < 12);
    assert_eq!(checked(&locked.mesh).boundary_edges.count, 64);
    assert!(locked.mesh.triangles().len() < 200);
}

#[test]
fn marked_features_and_vertices_stay_in_a_flat_sheet() {
    let n = 16;
    let mesh = sheet(n, |_, _| 0.0);
    // a line through the middle, and a vertex away from it
    let line: Vec<[u32; 2]> = (0..n)
        .map(|i| [8 * (n + 1) + i + 1, 8 * (n + 1) + i])
        .collect();
    let stays = 3 * (n + 1) + 5;
    let keep = Keep {
        features: &line,
        vertices: &[stays],
        ..Keep::default()
    };
    let params = SimplifyParams {
        max_error: 1e-6,
        min_quality: 0.0,
        ..SimplifyParams::default()
    };
    let simple = simplify(&mesh, &params, &keep, |_| false, &Progress::none()).unwrap();
    assert!(simple.mesh.triangles().len() < 20);
    let at = |v: u32| simple.mesh.positions()[v as usize];
    let length: f64 = simple
        .features
        .iter()
        .map(|&[a, b]| at(a).distance(at(b)))
        .sum();
    assert_eq!(length, 1.0);
    assert!(simple.features.iter().flatten().all(|&v| at(v).y == 0.5));
    let name = simple.vertex_origin.iter().position(|&v| v == stays);
    assert_eq!(at(name.unwrap() as u32), mesh.positions()[stays as usize]);
}

#[test]
fn creases_above_the_angle_are_kept_as_chains() {
    // a roof of 45 degrees
    let mesh = sheet(16, |x, _| 0.5 * (0.5 - (x - 0.5).abs()));
    let params = SimplifyParams {
        max_error: 0.2,
        feature_angle_rad: 0.5,
        ..SimplifyParams::default()
    };
    let simple = run(&mesh, &params);
    assert!(!simple.features.is_empty());
    let at = |v: u32| simple.mesh.positions()[v as usize];
    let ridge: f64 = simple
        .features
        .iter()
        .map(|&[a, b]| at(a).distance(at(b)))
        .sum();
    assert!((ridge - 1.0).abs() < 1e-6, "{ridge}");
    assert!(
        simple
            .features
            .iter()
            .flatten()
            .all(|&v| (at(v).x - 0.5).abs() < 1e-9)
    );
}

#[test]
fn the_caller_sees_what_will_happen_and_may_refuse_it() {
    let mesh = torus(20, 12);
    let refuse = simplify(
        &mesh,
        &SimplifyParams::default(),
        &Keep::default(),
        |_| true,
        &Progress::none(),
    );
    let refused = refuse.unwrap();
    assert_eq!(refused.mesh, mesh);
    assert!(refused.report.vetoes.caller > 0 && refused.report.collapses == 0);

    // a veto that keeps one half of the space as it is
    let asked = AtomicUsize::new(0);
    let veto = |candidate: &CollapseCandidate<'_>| {
        asked.fetch_add(1, Ordering::Relaxed);
        assert_eq!(candidate.before.len(), candidate.after.len());
        assert_eq!(candidate.before.len(), candidate.triangles.len());
        let [kept, removed] = candidate.vertices;
        for (before, after) in candidate.corners_before.iter().zip(candidate.corners) {
            let renamed = before.map(|v| if v == removed { kept } else { v });
            assert!(renamed == *after && after.contains(&kept));
        }
        assert_eq!(candidate.vanishing.len(), 2);
        for (before, after) in candidate.before.iter().zip(candidate.after) {
            let moved = (0..3).filter(|&i| before[i] != after[i]);
            assert!(moved.clone().all(|i| after[i] == candidate.position));
            assert!(moved.clone().all(|i| candidate.from.contains(&before[i])));
            assert!(after.contains(&candidate.position));
        }
        candidate.from.iter().any(|p| p.x < 0.0)
    };
    let params = SimplifyParams {
        target_triangles: 300,
        ..SimplifyParams::default()
    };
    let half = simplify(&mesh, &params, &Keep::default(), veto, &Progress::none()).unwrap();
    assert!(asked.load(Ordering::Relaxed) > 60);
    for (v, place) in (0..).zip(mesh.positions()).filter(|(_, p)| p.x < 0.0) {
        let now = half.vertex_origin.iter().position(|&origin| origin == v);
        assert_eq!(half.mesh.positions()[now.unwrap()], *place);
    }
}

/// A shell of two wavy spheres, close to one another.
fn shell(gap: f64) -> TriMesh {
    let ball = grid_box(14);
    let wavy = |p: &DVec3, r: f64| {
        let n = (*p - 0.5).normalize();
        let waves = 0.08 * (9.0 * n.x).sin() * (7.0 * n.y + 1.0).sin() * (8.0 * n.z + 2.0).cos();
        n * (r + waves)
    };
    let outer = ball.positions().iter().map(|p| wavy(p, 1.0 + gap));
    let inner = ball.positions().iter().map(|p| wavy(p, 1.0));
    let count = ball.positions().len() as u32;
    let flipped = ball
        .triangles()
        .iter()
        .map(|&[a, b, c]| [a, c, b].map(|v| v + count));
    let triangles = ball.triangles().iter().copied().chain(flipped).collect();
    TriMesh::new(outer.chain(inner).collect(), triangles).unwrap()
}

#[test]
fn thin_walls_do_not_come_to_intersect() {
    let mesh = shell(0.004);
    assert!(checked(&mesh).is_solid());
    let params = SimplifyParams {
        target_triangles: 500,
        ..SimplifyParams::default()
    };
    let careful = run(&mesh, &params);
    assert!(checked(&careful.mesh).is_solid());
    assert!(careful.report.vetoes.intersections > 0);
    let careless = SimplifyParams {
        avoid_intersections: false,
        ..params
    };
    let careless = checked(&run(&mesh, &careless).mesh);
    assert!(careless.closed && careless.manifold && careless.oriented);
    assert!(careless.self_intersections.unwrap().count > 0);
}

/// One thread looks at one edge after the other; more of them look ahead, and must come to the same end.
#[test]
fn any_number_of_threads_gives_the_same_mesh() {
    let fine = SimplifyParams::default();
    let one_way = SimplifyParams {
        max_error: 0.01,
        both_ways: false,
        avoid_intersections: false,
        ..fine
    };
    let near = SimplifyParams {
        max_error: 0.02,
        ..fine
    };
    let few = SimplifyParams {
        target_triangles: 501,
        ..fine
    };
    let mut vetoed = [0; 2];
    // of walls that are close, many collapses are vetoed since triangles elsewhere are near
    for (mesh, params) in [
        (shell(0.05), near),
        (shell(0.004), near),
        (shell(0.004), one_way),
        (shell(0.004), few),
    ] {
        // and one that depends on what is there by then
        let veto = |candidate: &CollapseCandidate<'_>| {
            let area = |[a, b, c]: [DVec3; 3]| (b - a).cross(c - a).length();
            candidate.after.iter().copied().map(area).sum::<f64>() > 0.3
        };
        let with = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
            let keep = Keep::default();
            let simplified = || simplify(&mesh, &params, &keep, veto, &Progress::none()).unwrap();
            pool.unwrap().install(simplified)
        };
        let alone = with(1);
        let vetoes = alone.report.vetoes;
        assert!(alone.report.collapses > 500);
        vetoed[0] += vetoes.intersections;
        vetoed[1] += vetoes.caller;
        assert_eq!(alone, with(4));
    }
    assert!(vetoed.iter().all(|&times| times > 500), "{vetoed:?}");
}

/// While a veto waits for parallel work of its own, its thread may take up other edges.
#[test]
fn a_veto_may_let_its_thread_do_other_work() {
    let mesh = shell(0.05);
    let params = SimplifyParams {
        max_error: 0.02,
        ..SimplifyParams::default()
    };
    let veto = |candidate: &CollapseCandidate<'_>| {
        rayon::yield_now();
        let area = |[a, b, c]: [DVec3; 3]| (b - a).cross(c - a).length();
        candidate.after.iter().any(|&corners| area(corners) > 0.04)
    };
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        let keep = Keep::default();
        let simplified = || simplify(&mesh, &params, &keep, veto, &Progress::none()).unwrap();
        pool.unwrap().install(simplified)
    };
    let alone = with(1);
    let report = &alone.report;
    assert!(
        report.collapses > 500 && report.vetoes.caller > 500,
        "{report:?}"
    );
    assert_eq!(alone, with(4));
}

#[test]
fn large_coordinates_and_tiny_meshes_are_simplified_alike() {
    let mesh = grid_box(8);
    let placed = |scale: f64, shift: f64| {
        let positions = mesh
            .positions()
            .iter()
            .map(|p| *p * scale + shift)
            .collect();
        TriMesh::new(positions, mesh.triangles().to_vec()).unwrap()
    };
    for (scale, shift) in [(1.0, 1048576.0), (1e-9, 0.0), (1e30, 0.0)] {
        let params = SimplifyParams {
            max_error: 1e-6 * scale,
            ..SimplifyParams::default()
        };
        let simple = run(&placed(scale, shift), &params);
        assert_eq!(simple.mesh.triangles().len(), 12, "{scale} {shift}");
    }
}

#[test]
fn bad_parameters_are_refused_by_name() {
    let mesh = torus(6, 6);
    let attempt = |params: SimplifyParams, keep: Keep<'_>| {
        simplify(&mesh, &params, &keep, |_| false, &Progress::none()).unwrap_err()
    };
    let fine = SimplifyParams::default();
    let bad = |params| match attempt(params, Keep::default()) {
        SimplifyError::BadParameter { name, .. } => name,
        other => panic!("{other}"),
    };
    assert_eq!(
        bad(SimplifyParams {
            max_error: f64::NAN,
            ..fine
        }),
        "max_error"
    );
    assert_eq!(
        bad(SimplifyParams {
            max_error: -1.0,
            ..fine
        }),
        "max_error"
    );
    assert_eq!(
        bad(SimplifyParams {
            feature_angle_rad: 4.0,
            ..fine
        }),
        "feature_angle_rad"
    );
    assert_eq!(
        bad(SimplifyParams {
            max_turn_rad: 2.0,
            ..fine
        }),
        "max_turn_rad"
    );
    assert_eq!(
        bad(SimplifyParams {
            min_quality: 1.5,
            ..fine
        }),
        "min_quality"
    );
    let keep = Keep {
        vertices: &[36],
        ..Keep::default()
    };
    assert_eq!(
        attempt(fine, keep),
        SimplifyError::NoSuchVertex {
            vertex: 36,
            vertices: 36
        }
    );
    let keep = Keep {
        features: &[[0, 20]],
        ..Keep::default()
    };
    assert_eq!(
        attempt(fine, keep),
        SimplifyError::NoSuchEdge { ends: [0, 20] }
    );
    let progress = Progress::none();
    progress.cancel();
    let cancelled = simplify(&mesh, &fine, &Keep::default(), |_| false, &progress);
    assert!(matches!(cancelled, Err(SimplifyError::Cancelled(_))));
}

#[test]
fn a_cancellation_by_the_caller_stops_the_work() {
    let (mesh, progress) = (torus(40, 20), Progress::none());
    let asked = AtomicUsize::new(0);
    let veto = |_: &CollapseCandidate<'_>| {
        if asked.fetch_add(1, Ordering::Relaxed) == 10 {
            progress.cancel();
        }
        false
    };
    let answer = simplify(
        &mesh,
        &SimplifyParams::default(),
        &Keep::default(),
        veto,
        &progress,
    );
    assert!(matches!(answer, Err(SimplifyError::Cancelled(_))));
    // no more than what was examined at once
    assert!(asked.load(Ordering::Relaxed) < 300);
}

fn soup() -> impl Strategy<Value = TriMesh> {
    let place = prop_oneof![
        [-2_i32..3, -2_i32..3, -2_i32..3].prop_map(|v| DVec3::from_array(v.map(f64::from))),
        [-2.0..2.0, -2.0..2.0, -2.0..2.0].prop_map(DVec3::from_array),
    ];
    prop::collection::vec(place, 3..20).prop_flat_map(|positions| {
        let vertex = 0..positions.len() as u32;
        let triangles = prop::collection::vec([vertex.clone(), vertex.clone(), vertex], 0..60);
        triangles.prop_map(move |triangles| TriMesh::new(positions.clone(), triangles).unwrap())
    })
}

/// The vertices around which there is no surface: where a collapse takes away an edge of three triangles, the fans that it
/// held together may be left in one point.
fn odd_vertices(mesh: &TriMesh) -> usize {
    let all = CheckParams {
        self_intersections: false,
        list_limit: usize::MAX,
    };
    let found = check(mesh, &all, &Progress::none()).unwrap();
    let ends = found.non_manifold_edges.listed.iter().flatten();
    let odd: BTreeSet<u32> = ends
        .chain(&found.pinched_vertices.listed)
        .copied()
        .collect();
    odd.len()
}

#[test]
fn fans_around_an_edge_of_three_triangles_may_be_left_in_its_end() {
    let positions = [
        [1.72, -0.58, 0.79],
        [1.0, 2.0, 1.0],
        [1.0, 0.0, -1.0],
        [-0.2, 0.49, -1.71],
        [1.0, 2.0, 2.0],
        [-2.0, 2.0, 0.0],
    ];
    let triangles = vec![
        [3, 0, 1],
        [2, 4, 1],
        [3, 5, 0],
        [0, 1, 4],
        [5, 1, 0],
        [5, 4, 2],
    ];
    let mesh = TriMesh::new(positions.map(DVec3::from_array).to_vec(), triangles).unwrap();
    assert_eq!(checked(&mesh).non_manifold_edges.count, 1);
    let simple = run(&mesh, &SimplifyParams::default()).mesh;
    assert!(checked(&simple).pinched_vertices.count > checked(&mesh).pinched_vertices.count);
    assert!(odd_vertices(&simple) <= odd_vertices(&mesh));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn any_soup_is_taken_and_nothing_new_is_wrong_with_it(mesh in soup(), avoid in any::<bool>()) {
        let params = SimplifyParams { avoid_intersections: avoid, ..SimplifyParams::default() };
        let simple = run(&mesh, &params);
        let (before, after) = (checked(&mesh), checked(&simple.mesh));
        // where edges have many triangles, what is wrong may become wrong in another way, but not more of it
        let odd_edges = |found: &MeshCheck| found.non_manifold_edges.count + found.orientation_clashes.count;
        prop_assert!(odd_edges(&after) <= odd_edges(&before));
        prop_assert!(odd_vertices(&simple.mesh) <= odd_vertices(&mesh));
        prop_assert!(after.boundary_edges.count <= before.boundary_edges.count + before.non_manifold_edges.count);
        prop_assert!(after.duplicate_triangles.count <= before.duplicate_triangles.count);
        if before.non_manifold_edges.count == 0 {
            prop_assert_eq!(after.non_manifold_edges.count, 0);
            prop_assert!(after.pinched_vertices.count <= before.pinched_vertices.count);
            prop_assert_eq!(after.euler, before.euler);
        }
        prop_assert_eq!(after.unused_vertices.count, 0);
        if avoid {
            let pairs = |found: MeshCheck| found.self_intersections.unwrap().count;
            prop_assert!(pairs(after) <= pairs(before));
        }
    }

    #[test]
    fn noisy_solids_stay_solids(noise in prop::collection::vec([-0.04..0.04, -0.04..0.04, -0.04..0.04], 8 * 8 * 6 + 2), target in 0_u64..700) {
        let mesh = grid_box(8);
        let moved = mesh.positions().iter().zip(&noise).map(|(p, n)| *p + DVec3::from_array(*n));
        let mesh = TriMesh::new(moved.collect(), mesh.triangles().to_vec()).unwrap();
        prop_assume!(checked(&mesh).is_solid());
        let params = SimplifyParams { target_triangles: target, ..SimplifyParams::default() };
        let simple = run(&mesh, &params);
        let found = checked(&simple.mesh);
        prop_assert!(found.is_solid());
        prop_assert_eq!((found.genus, found.components), (Some(0), 1));
        prop_assert!(measure(&simple.mesh).volume > 0.0);
    }
}

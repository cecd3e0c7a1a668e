use super::*;
use proptest::prelude::*;

fn mesh(positions: Vec<DVec3>, triangles: Vec<[u32; 3]>) -> TriMesh {
    TriMesh::new(positions, triangles).unwrap()
}

fn moved(mesh: &TriMesh, by: DVec3) -> TriMesh {
    let positions = mesh.positions().iter().map(|&at| at + by).collect();
    TriMesh::new(positions, mesh.triangles().to_vec()).unwrap()
}

/// The cube from 0 to 1; without its top if it is open.
fn cube(open: bool) -> TriMesh {
    let positions = (0..8)
        .map(|i| DVec3::new(f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2)))
        .collect();
    let quads = [
        [0, 2, 3, 1],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 4, 6, 2],
        [1, 3, 7, 5],
        [4, 5, 7, 6],
    ];
    let sides = if open { 5 } else { 6 };
    let triangles = quads[..sides]
        .iter()
        .flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]);
    mesh(positions, triangles.collect())
}

/// A sphere of radius 1: the octahedron, each triangle cut in four and pushed out, `levels` times.
fn sphere(levels: u32) -> TriMesh {
    let mut soup: Vec<[DVec3; 3]> = Vec::new();
    for (x, y, z) in [-1.0, 1.0]
        .iter()
        .flat_map(|&x| [-1.0, 1.0].map(|y| (x, y)))
        .flat_map(|(x, y)| [-1.0, 1.0].map(|z| (x, y, z)))
    {
        soup.push([DVec3::X * x, DVec3::Y * y, DVec3::Z * z]);
    }
    for _ in 0..levels {
        let cut = |[a, b, c]: [DVec3; 3]| {
            let [ab, bc, ca] = [a + b, b + c, c + a].map(DVec3::normalize);
            [[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]
        };
        soup = soup.into_iter().flat_map(cut).collect();
    }
    let triangles = (0..soup.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]);
    mesh(
        soup.iter().flatten().copied().collect(),
        triangles.collect(),
    )
}

fn params(tolerance: f64) -> HausdorffParams {
    HausdorffParams {
        tolerance,
        samples: 20_000,
        ..Default::default()
    }
}

fn measured(a: &TriMesh, b: &TriMesh, tolerance: f64) -> Hausdorff {
    let found = hausdorff(a, b, &params(tolerance), &Progress::none()).unwrap();
    for side in [found.forward, found.backward] {
        assert!(side.lower <= side.upper && side.upper <= side.lower + tolerance);
        assert!((side.from.distance(side.to) - side.lower).abs() < 1e-12);
        assert!(side.mean <= side.rms && side.rms <= side.upper);
    }
    found
}

#[test]
fn a_mesh_is_at_distance_zero_from_itself() {
    for mesh in [cube(false), sphere(3)] {
        let found = measured(&mesh, &mesh, 1e-9);
        // Places within faces are rounded.
        assert!(found.lower() < 1e-15);
        assert!(found.upper() <= 1e-9 && found.forward.rms < 1e-12);
    }
}

#[test]
fn a_shifted_cube_is_as_far_as_it_was_shifted() {
    // Along x the sides at x = 0 and 1 are the farthest; the four others slide within themselves.
    let found = measured(&cube(false), &moved(&cube(false), DVec3::X * 0.25), 1e-6);
    assert!((found.forward.lower - 0.25).abs() < 1e-6);
    assert!((found.backward.lower - 0.25).abs() < 1e-6);
    // The left side is at 0.25 from the other cube's; the right side is inside, and nowhere farther than 0.25. Of the four
    // others a quarter sticks out, by 0.125 on average.
    let side = |at: f64| 0.25_f64.min(at).min(1.0 - at);
    let n = 1000;
    let inner = (0..n * n)
        .map(|i| {
            let (y, z) = ((i % n) as f64 + 0.5, (i / n) as f64 + 0.5);
            side(y / n as f64).min(side(z / n as f64))
        })
        .sum::<f64>()
        / (n * n) as f64;
    let mean = (0.25 + inner + 4.0 * 0.25 * 0.125) / 6.0;
    assert!(
        (found.forward.mean - mean).abs() < 1e-3,
        "{} for {mean}",
        found.forward.mean
    );
    // Diagonally the farthest place is a corner.
    let found = measured(&cube(false), &moved(&cube(false), DVec3::splat(0.25)), 1e-6);
    assert!((found.lower() - 0.25 * 3_f64.sqrt()).abs() < 1e-6);
}

#[test]
fn an_open_box_is_near_the_closed_one_but_not_the_other_way_around() {
    let found = measured(&cube(true), &cube(false), 1e-6);
    assert!(found.forward.upper <= 1e-6);
    // The middle of the missing top is half a side from the rim: inside a triangle's edge, and no vertex.
    assert!((found.backward.lower - 0.5).abs() < 1e-6);
    assert!(found.backward.from.distance(DVec3::new(0.5, 0.5, 1.0)) < 1e-5);
    // A pyramid of height ½ over a sixth of the area.
    assert!((found.backward.mean - 1.0 / 36.0).abs() < 1e-4);
    assert!((found.backward.rms - (1.0_f64 / 144.0).sqrt()).abs() < 1e-4);
}

#[test]
fn a_coarse_sphere_is_as_far_from_a_fine_one_as_its_flattest_point() {
    let (coarse, fine) = (sphere(2), sphere(6));
    let found = measured(&coarse, &fine, 1e-5);
    // The farthest point of the coarse one is the middle of its largest triangle, the one closest to the center; that
    // of the fine one is no farther than the depth of its own triangles, 1e-4 of the radius, beyond that.
    let depth = (0..coarse.triangles().len() as u32)
        .map(|t| {
            let [a, b, c] = coarse.corners(t);
            1.0 - (b - a).cross(c - a).normalize().dot(a).abs()
        })
        .fold(0.0, f64::max);
    assert!(
        (found.forward.lower - depth).abs() < 3e-4,
        "{} for {depth}",
        found.forward.lower
    );
    assert!((found.lower() - depth).abs() < 3e-4);
}

#[test]
fn concentric_spheres_are_as_far_as_their_radii_differ() {
    let inner = sphere(4);
    let positions = inner.positions().iter().map(|&at| 1.5 * at).collect();
    let outer = mesh(positions, inner.triangles().to_vec());
    let found = measured(&inner, &outer, 1e-4);
    // Corner to corner is ½; faces are parallel, and nearer by the cosine of half their width.
    assert!((found.lower() - 0.5).abs() < 1e-3, "{}", found.lower());
    assert!((found.forward.mean - 0.5).abs() < 2e-3);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(32))]
    #[test]
    fn no_place_is_farther_than_the_upper_bound(
        a in prop::collection::vec([-1.0..1.0, -1.0..1.0, -1.0..1.0], 3..30),
        b in prop::collection::vec([-1.0..1.0, -1.0..1.0, -1.0..1.0], 3..30),
    ) {
        let soup = |places: &[[f64; 3]]| {
            let positions = places.iter().map(|&at| DVec3::from_array(at)).collect();
            mesh(positions, (0..places.len() as u32 / 3).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect())
        };
        let (a, b) = (soup(&a), soup(&b));
        let found = measured(&a, &b, 1e-3);
        for t in 0..a.triangles().len() as u32 {
            let [p, q, r] = a.corners(t);
            for i in 0..=20 {
                for j in 0..=20 - i {
                    let at = p + (q - p) * (f64::from(i) / 20.0) + (r - p) * (f64::from(j) / 20.0);
                    let distance_sq = (0..b.triangles().len() as u32)
                        .map(|t| distance_sq_to_triangle(at, &b.corners(t)))
                        .fold(f64::INFINITY, f64::min);
                    prop_assert!(distance_sq.sqrt() <= found.forward.upper + 1e-12);
                }
            }
        }
    }
}

#[test]
fn the_answer_does_not_depend_on_the_number_of_threads() {
    let (a, b) = (sphere(3), moved(&cube(false), DVec3::splat(-0.3)));
    let with_threads = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        let pool = pool.build().unwrap();
        pool.install(|| measured(&a, &b, 1e-4))
    };
    assert_eq!(with_threads(1), with_threads(3));
}

#[test]
fn a_tolerance_out_of_reach_ends_with_a_true_but_wider_enclosure() {
    let params = HausdorffParams {
        tolerance: 1e-12,
        max_pieces: 20_000,
        ..params(1.0)
    };
    let found = hausdorff(&sphere(3), &sphere(2), &params, &Progress::none()).unwrap();
    assert!(found.upper() >= found.lower() && found.upper() < found.lower() + 0.05);
}

#[test]
fn each_error_has_its_cause() {
    let cube = cube(false);
    let empty = TriMesh::default();
    let progress = Progress::none();
    let ask =
        |a: &TriMesh, b: &TriMesh, tolerance: f64| hausdorff(a, b, &params(tolerance), &progress);
    assert_eq!(ask(&empty, &cube, 1.0), Err(HausdorffError::Empty));
    assert_eq!(ask(&cube, &empty, 1.0), Err(HausdorffError::Empty));
    assert_eq!(ask(&cube, &cube, 0.0), Err(HausdorffError::Tolerance(0.0)));
    assert!(matches!(
        ask(&cube, &cube, f64::NAN),
        Err(HausdorffError::Tolerance(_))
    ));
    progress.cancel();
    assert_eq!(
        ask(&cube, &cube, 1.0),
        Err(HausdorffError::Cancelled(Cancelled))
    );
}

#[test]
fn the_distances_of_vertices_are_those_of_a_plane() {
    let plane = mesh(
        vec![
            DVec3::new(-9.0, -9.0, 0.0),
            DVec3::X * 30.0,
            DVec3::Y * 30.0,
        ],
        vec![[0, 1, 2]],
    );
    let found = vertex_distances(&cube(false), &Bvh::new(&plane), &Progress::none()).unwrap();
    assert_eq!(found, vec![0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0]);
    let nowhere = Bvh::new(&TriMesh::default());
    let found = vertex_distances(&cube(false), &nowhere, &Progress::none()).unwrap();
    assert!(found.iter().all(|distance| distance.is_nan()));
}

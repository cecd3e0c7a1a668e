//! Any triangles at all: coincident, nearly coincident, coplanar, needles, far from the origin, tiny and huge.

mod support;

use glam::DVec3;
use proptest::prelude::*;
use ravec_mesh::TriMesh;
use ravec_offset::{Coordinates, OffsetError, OffsetParams, Side, offset};
use ravec_progress::Progress;
use ravec_scenes::Seed;
use ravec_scenes::solids::{comb, soup, torus};
use support::verdict::{checked_offset, params};

/// A triangle to add to those that are there.
#[derive(Debug, Clone)]
enum Recipe {
    /// Anywhere.
    Free([DVec3; 3]),
    /// In a plane of the grid, with corners on the grid.
    Flat(u8, [[i8; 2]; 3]),
    /// Long, with a width that is as small as asked for.
    Needle(DVec3, DVec3, f64),
    /// One that is there, in this order, moved by this much.
    Again(usize, bool, DVec3),
    /// An edge of one that is there, with another corner.
    Neighbor(usize, DVec3),
    /// A point or a segment.
    Thin(DVec3, DVec3),
}

fn place() -> impl Strategy<Value = DVec3> {
    [-1.0..1.0, -1.0..1.0, -1.0..1.0].prop_map(DVec3::from_array)
}

fn grid_place() -> impl Strategy<Value = [i8; 2]> {
    [-2_i8..3, -2_i8..3]
}

fn smallness() -> impl Strategy<Value = f64> {
    prop_oneof![
        Just(0.0),
        Just(1e-15),
        Just(1e-9),
        Just(1e-5),
        Just(1e-3),
        Just(0.05)
    ]
}

fn recipe() -> impl Strategy<Value = Recipe> {
    prop_oneof![
        3 => [place(), place(), place()].prop_map(Recipe::Free),
        3 => (0_u8..3, [grid_place(), grid_place(), grid_place()])
            .prop_map(|(axis, corners)| Recipe::Flat(axis, corners)),
        1 => (place(), place(), smallness()).prop_map(|(a, b, w)| Recipe::Needle(a, b, w)),
        2 => (any::<usize>(), any::<bool>(), place(), smallness())
            .prop_map(|(which, flip, to, by)| Recipe::Again(which, flip, by * to)),
        2 => (any::<usize>(), place()).prop_map(|(which, to)| Recipe::Neighbor(which, to)),
        1 => (place(), place()).prop_map(|(a, b)| Recipe::Thin(a, b)),
    ]
}

/// The triangles of some recipes, each with corners of its own.
fn mesh_of(recipes: &[Recipe], scale: f64, shift: DVec3) -> TriMesh {
    let mut triangles: Vec<[DVec3; 3]> = Vec::new();
    for recipe in recipes {
        let old = |which: usize| triangles.get(which % triangles.len().max(1)).copied();
        let triangle = match recipe {
            Recipe::Free(corners) => *corners,
            Recipe::Flat(axis, corners) => corners.map(|[u, v]| {
                let mut p = [0.0, 0.5 * f64::from(u), 0.5 * f64::from(v)];
                p.rotate_right(*axis as usize);
                DVec3::from_array(p)
            }),
            Recipe::Needle(a, b, width) => [*a, *b, a.lerp(*b, 0.3) + DVec3::splat(*width)],
            Recipe::Again(which, flip, by) => {
                let [a, b, c] = old(*which).unwrap_or([DVec3::X, DVec3::Y, DVec3::Z]);
                let turned = if *flip { [a, c, b] } else { [b, c, a] };
                turned.map(|p| p + *by)
            }
            Recipe::Neighbor(which, to) => {
                let [a, b, _] = old(*which).unwrap_or([DVec3::X, DVec3::Y, DVec3::Z]);
                [b, a, *to]
            }
            Recipe::Thin(a, b) => [*a, *b, *a],
        };
        triangles.push(triangle);
    }
    let positions = triangles.concat().into_iter().map(|p| scale * p + shift);
    let names = (0..triangles.len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]);
    TriMesh::new(positions.collect(), names.collect()).unwrap()
}

fn coordinates() -> impl Strategy<Value = Coordinates> {
    prop_oneof![Just(Coordinates::Double), Just(Coordinates::Single)]
}

fn side() -> impl Strategy<Value = Side> {
    prop_oneof![Just(Side::Both), Just(Side::Outer)]
}

/// Share of the size, and share of that.
fn asked(
    mesh: &TriMesh,
    side: Side,
    distance: f64,
    tolerance: f64,
    simplify: bool,
) -> OffsetParams {
    let distance = distance * mesh.bounds().diagonal().max(1e-9);
    params(side, distance, tolerance * distance, simplify)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 32, ..ProptestConfig::default() })]

    #[test]
    fn any_few_triangles_have_a_sound_offset(
        recipes in prop::collection::vec(recipe(), 1..8),
        side in side(),
        (distance, tolerance) in (0.05..0.4, 0.08..0.3),
        simplify in any::<bool>(),
        coordinates in coordinates(),
    ) {
        let mesh = mesh_of(&recipes, 1.0, DVec3::ZERO);
        let asked = asked(&mesh, side, distance, tolerance, simplify);
        let asked = OffsetParams { coordinates, ..asked };
        if let Err(fault) = checked_offset(&mesh, &asked) {
            prop_assert!(false, "{fault}");
        }
    }

    #[test]
    fn size_and_place_do_not_matter(
        recipes in prop::collection::vec(recipe(), 1..5),
        side in side(),
        (scale, shift) in prop_oneof![
            Just((1e-6, 0.0)),
            Just((1e6, 0.0)),
            Just((1e6, 1e9)),
            Just((1.0, 6e3)),
            Just((1.0, 1e6)),
            Just((1.0, -3e6)),
        ],
        (distance, tolerance) in (0.08..0.3, 0.1..0.3),
        coordinates in coordinates(),
    ) {
        let mesh = mesh_of(&recipes, scale, shift * DVec3::new(1.0, -0.7, 0.3));
        let asked = asked(&mesh, side, distance, tolerance, true);
        let asked = OffsetParams { coordinates, ..asked };
        // what 32-bit floats are apart there, or up to four times as much
        let bounds = mesh.bounds().grown(asked.distance);
        let gap = 2.0 * bounds.min.abs().max(bounds.max.abs()).max_element() * f64::from(f32::EPSILON);
        if coordinates == Coordinates::Single && asked.tolerance < 16.0 * gap {
            match offset(&mesh, &asked, &Progress::none()) {
                Err(OffsetError::SinglePrecision { least, .. }) => prop_assert!(least <= 16.0 * gap),
                Err(error) => prop_assert!(false, "{error}"),
                Ok(_) => prop_assert!(asked.tolerance >= 4.0 * gap),
            }
        } else if let Err(fault) = checked_offset(&mesh, &asked) {
            prop_assert!(false, "{fault}");
        }
    }
}

/// The offset by this many threads, and all that was said about it.
fn offset_by(threads: usize, mesh: &TriMesh, asked: &OffsetParams) -> (TriMesh, String) {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .unwrap();
    let found = pool
        .install(|| offset(mesh, asked, &Progress::none()))
        .unwrap();
    (found.mesh, format!("{:?}", found.report))
}

#[test]
fn one_thread_and_four_give_the_same_bytes() {
    let (soup, _) = soup(16, Seed(9));
    for (mesh, side) in [
        (&soup.mesh, Side::Both),
        (&soup.mesh, Side::Outer),
        (&torus(1.0, 0.4, 24, 12).mesh, Side::Inner),
        (&comb(4, 0.04, 0.16, 0.6).mesh, Side::Both),
    ] {
        for simplify in [false, true] {
            let asked = params(side, 0.1, 0.03, simplify);
            let (one, four) = (offset_by(1, mesh, &asked), offset_by(4, mesh, &asked));
            assert_eq!(one.1, four.1);
            let bits = |mesh: &TriMesh| -> Vec<[u64; 3]> {
                let positions = mesh.positions().iter();
                positions.map(|p| p.to_array().map(f64::to_bits)).collect()
            };
            assert_eq!(one.0.triangles(), four.0.triangles());
            assert_eq!(bits(&one.0), bits(&four.0));
        }
    }
}

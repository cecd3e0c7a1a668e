use super::*;
use crate::closing::Closing;
use glam::DQuat;
use proptest::prelude::*;
use ravec_mesh::TriMesh;
use ravec_scenes::solids::{Solid, cuboid, cylinder};
use std::collections::BTreeMap;

/// A solid turned and then moved.
fn placed(solid: &Solid, turn: DQuat, by: DVec3) -> TriMesh {
    let positions = solid.mesh.positions().iter().map(|&p| turn * (p + by));
    TriMesh::new(positions.collect(), solid.mesh.triangles().to_vec()).unwrap()
}

fn soup_of(meshes: &[&TriMesh]) -> Soup {
    let closings = vec![Closing::default(); meshes.len()];
    Soup::of(meshes, &closings, &[], &Progress::none()).unwrap()
}

/// Number of uses of each edge forward less those backward, where that is not zero.
fn open_edges(soup: &Soup) -> BTreeMap<[u32; 2], i32> {
    let mut uses: BTreeMap<[u32; 2], i32> = BTreeMap::new();
    for &[a, b, c] in &soup.triangles {
        for [from, to] in [[a, b], [b, c], [c, a]] {
            *uses.entry([from.min(to), from.max(to)]).or_default() +=
                if from < to { 1 } else { -1 };
        }
    }
    uses.retain(|_, &mut count| count != 0);
    uses
}

fn all_near(soup: &Soup, reach: f64) -> Soup {
    merge_near(soup, reach, |_| true, &Progress::none()).unwrap()
}

#[test]
fn a_vertex_near_an_edge_divides_all_triangles_at_the_edge() {
    let places = [
        DVec3::ZERO,
        DVec3::X,
        DVec3::new(0.5, 1.0, 0.0),
        DVec3::new(0.5, -1.0, 0.0),
        // a triangle of another mesh that nearly touches the edge from 0 to 1
        DVec3::new(0.25, 0.0, 1e-12),
        DVec3::new(0.25, 0.5, 1.0),
        DVec3::new(0.25, -0.5, 1.0),
    ];
    let mesh = TriMesh::new(places.to_vec(), vec![[0, 1, 2], [1, 0, 3], [4, 5, 6]]).unwrap();
    let near = all_near(&soup_of(&[&mesh]), 1e-11);
    let whose: Vec<u32> = near.sources.iter().map(|s| s.triangle).collect();
    assert_eq!(whose, [0, 0, 1, 1, 2]);
    for (corners, triangle) in near.triangles.iter().zip(whose) {
        assert!(corners.contains(&4), "triangle {triangle} has {corners:?}");
    }
    // farther than half of the reach it is left alone
    assert_eq!(all_near(&soup_of(&[&mesh]), 1e-12).triangles.len(), 3);
}

#[test]
fn a_vertex_near_the_inside_of_a_triangle_divides_it_in_three() {
    let places = [
        DVec3::ZERO,
        DVec3::X,
        DVec3::Y,
        DVec3::new(0.25, 0.25, 1e-12),
        DVec3::new(0.25, 0.5, 1.0),
        DVec3::new(0.5, 0.25, 1.0),
    ];
    let mesh = TriMesh::new(places.to_vec(), vec![[0, 1, 2], [3, 4, 5]]).unwrap();
    let near = all_near(&soup_of(&[&mesh]), 1e-11);
    let of_first = near.sources.iter().filter(|s| s.triangle == 0).count();
    assert_eq!((of_first, near.triangles.len()), (3, 4));
    assert_eq!(open_edges(&near).len(), 6, "three of each triangle");
}

#[test]
fn only_vertices_of_chosen_triangles_are_merged() {
    let cube = cuboid(DVec3::ONE);
    let other = placed(&cube, DQuat::IDENTITY, DVec3::splat(1e-13));
    let soup = soup_of(&[&cube.mesh, &other]);
    assert_eq!(soup.positions.len(), 16);
    assert_eq!(all_near(&soup, 1e-12).positions.len(), 8);
    let none = merge_near(&soup, 1e-12, |_| false, &Progress::none()).unwrap();
    assert_eq!(none.positions, soup.positions);
    assert_eq!(none.triangles, soup.triangles);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn what_is_closed_stays_closed_and_near_where_it_was(
        shifts in prop::collection::vec([0.0..0.5, 0.0..0.5, 0.0..1e-12], 1..4),
        is_round in any::<bool>(),
        axis in [-1.0..1.0, -1.0..1.0, 0.1..1.0],
        angle in 0.0..3.0,
        reach in 1e-13_f64..1e-9,
    ) {
        let turn = DQuat::from_axis_angle(DVec3::from_array(axis).normalize(), angle);
        let solid = if is_round { cylinder(1.0, 1.0, 12) } else { cuboid(DVec3::ONE) };
        // the upper faces nearly lie on one another
        let meshes: Vec<TriMesh> = shifts
            .iter()
            .map(|&shift| placed(&solid, turn, DVec3::from_array(shift)))
            .collect();
        let soup = soup_of(&meshes.iter().collect::<Vec<_>>());
        let near = all_near(&soup, reach);
        prop_assert_eq!(open_edges(&near), BTreeMap::new());
        for (one, v) in near.positions.iter().enumerate().map(|(v, p)| (p, v)) {
            for other in &near.positions[..v] {
                prop_assert!((*one - *other).abs().max_element() > reach);
            }
            let was = soup.positions.iter().map(|p| (*p - *one).abs().max_element());
            prop_assert_eq!(was.fold(f64::INFINITY, f64::min), 0.0, "a vertex was made up");
        }
        let coarse = coarsened(&soup, reach, &Progress::none()).unwrap();
        prop_assert_eq!(open_edges(&coarse), BTreeMap::new());
        for p in &coarse.positions {
            prop_assert_eq!((*p / reach).round() * reach, *p);
        }
    }
}

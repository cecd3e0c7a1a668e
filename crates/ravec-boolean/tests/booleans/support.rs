//! Solids with known volumes, and what must hold for every result.

use glam::DVec3;
use ravec_boolean::{Boolean, BooleanParams, Expr, boolean};
use ravec_mesh::{Bvh, TriMesh, WindingNumbers, self_intersections};
use ravec_progress::Progress;

/// A box with two triangles a side.
pub fn cuboid(lo: DVec3, hi: DVec3) -> TriMesh {
    let corner = |i: usize| {
        let pick = |bit: usize, lo: f64, hi: f64| if i >> bit & 1 == 1 { hi } else { lo };
        DVec3::new(
            pick(2, lo.x, hi.x),
            pick(1, lo.y, hi.y),
            pick(0, lo.z, hi.z),
        )
    };
    let triangles = vec![
        [0, 1, 3],
        [0, 3, 2],
        [4, 6, 7],
        [4, 7, 5],
        [0, 4, 5],
        [0, 5, 1],
        [2, 3, 7],
        [2, 7, 6],
        [0, 2, 6],
        [0, 6, 4],
        [1, 5, 7],
        [1, 7, 3],
    ];
    TriMesh::new((0..8).map(corner).collect(), triangles).unwrap()
}

pub fn union() -> Expr {
    Expr::Union(vec![Expr::Mesh(0), Expr::Mesh(1)])
}

pub fn intersection() -> Expr {
    Expr::Intersection(vec![Expr::Mesh(0), Expr::Mesh(1)])
}

pub fn difference() -> Expr {
    Expr::Difference(vec![Expr::Mesh(0), Expr::Mesh(1)])
}

pub fn symmetric_difference() -> Expr {
    Expr::SymmetricDifference(vec![Expr::Mesh(0), Expr::Mesh(1)])
}

/// Evaluates with standard parameters.
pub fn run(meshes: &[TriMesh], expr: &Expr) -> Boolean {
    boolean(meshes, expr, &BooleanParams::default(), &Progress::none()).unwrap()
}

/// Closed, manifold, consistently oriented and free of intersections.
pub fn assert_sound(result: &Boolean) {
    let mesh = &result.mesh;
    assert_eq!(result.origins.len(), mesh.triangles().len());
    assert!(result.report.solid, "{:?}", result.report);
    assert_eq!(result.report.self_intersections, 0);
    let mut sides: Vec<[u32; 2]> = mesh
        .triangles()
        .iter()
        .flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]])
        .collect();
    sides.sort_unstable();
    assert!(
        sides.windows(2).all(|w| w[0] != w[1]),
        "an edge is used twice in one direction"
    );
    for &[a, b] in &sides {
        assert!(
            sides.binary_search(&[b, a]).is_ok(),
            "an edge has no other side"
        );
    }
    let adjacency = ravec_mesh::Adjacency::new(mesh);
    assert_eq!(adjacency.pinched_vertices(mesh), [] as [u32; 0]);
    let found = self_intersections(&Bvh::new(&welded(mesh)), 10, &Progress::none()).unwrap();
    assert_eq!(found.count, 0, "{:?}", found.pairs);
}

/// The same triangles over vertices of which no two are at one place.
fn welded(mesh: &TriMesh) -> TriMesh {
    let mut positions: Vec<DVec3> = Vec::new();
    let mut at = std::collections::HashMap::new();
    let triangles = mesh.triangles().iter().map(|t| {
        t.map(|v| {
            let p = mesh.positions()[v as usize];
            *at.entry(p.to_array().map(f64::to_bits)).or_insert_with(|| {
                positions.push(p);
                (positions.len() - 1) as u32
            })
        })
    });
    let triangles = triangles.collect();
    TriMesh::new(positions, triangles).unwrap()
}

/// Compares membership of points with what the expression says about the winding numbers of the meshes.
pub fn assert_members(meshes: &[TriMesh], expr: &Expr, result: &Boolean, points: &[DVec3]) {
    let trees: Vec<Bvh> = meshes.iter().map(Bvh::new).collect();
    let windings: Vec<WindingNumbers> = trees.iter().map(WindingNumbers::new).collect();
    let tree = Bvh::new(&result.mesh);
    let winding = WindingNumbers::new(&tree);
    for &p in points {
        let expected = expr.eval(&|mesh| windings[mesh].at(p) > 0.5);
        let found = winding.at(p) > 0.5;
        assert_eq!(found, expected, "at {p}");
    }
}

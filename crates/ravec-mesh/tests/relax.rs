//! Relaxed meshes: what must stay, and what must become better.

mod shapes;

use glam::{DMat3, DVec3};
use proptest::prelude::*;
use ravec_mesh::{Facet, NEW_VERTEX, RelaxJudge, TriMesh, relax};
use ravec_progress::Progress;
use shapes::{checked, sheet, torus};

/// Place of the ridge of the tests' roof: between the vertices of its grid.
const RIDGE: f64 = 0.47;
const SLOPE: f64 = 0.2;

fn roof_height(x: f64) -> f64 {
    -SLOPE * (x - RIDGE).abs()
}

/// A unit square of `n` by `n` cells, bent to a roof whose ridge runs through the middle of cells.
fn roof(n: u32) -> TriMesh {
    sheet(n, |x, _| roof_height(x))
}

fn normal([a, b, c]: [DVec3; 3]) -> DVec3 {
    (b - a).cross(c - a)
}

fn middle([a, b, c]: [DVec3; 3]) -> DVec3 {
    (a + b + c) / 3.0
}

/// Wants facets to lie in the two planes of the roof.
struct Roofer;

impl Roofer {
    fn truth(x: f64) -> DVec3 {
        DVec3::new(SLOPE * (x - RIDGE).signum(), 0.0, 1.0).normalize()
    }
}

impl RelaxJudge for Roofer {
    type Descriptor = f64;

    fn describe(&self, corners: [DVec3; 3], _: Option<&f64>) -> f64 {
        let normal = normal(corners);
        let off = normal.angle_between(Self::truth(middle(corners).x));
        if off > 1e-6 {
            off * normal.length()
        } else {
            0.0
        }
    }

    fn fault(&self, descriptor: &f64) -> f64 {
        *descriptor
    }

    fn place(&self, of: u32, around: &[Facet<Self::Descriptor>]) -> Option<DVec3> {
        let v = around[0].corner(of).unwrap();
        let (mut matrix, mut right) = (DMat3::from_diagonal(DVec3::splat(1e-6)), DVec3::ZERO);
        for &Facet { corners, .. } in around {
            let m = middle(corners);
            let n = Self::truth(m.x);
            let on_plane = DVec3::new(m.x, m.y, roof_height(m.x));
            matrix += DMat3::from_cols(n.x * n, n.y * n, n.z * n);
            right += n.dot(on_plane - v) * n;
        }
        Some(v + matrix.inverse() * right)
    }

    fn admits(&self, _: &[Facet<Self::Descriptor>]) -> bool {
        true
    }
}

/// Wants the sides of a tent to face the front and the back, none the left or the right.
struct Tent;

impl RelaxJudge for Tent {
    type Descriptor = f64;

    fn describe(&self, corners: [DVec3; 3], _: Option<&f64>) -> f64 {
        normal(corners).normalize().x.abs()
    }
    fn fault(&self, descriptor: &f64) -> f64 {
        *descriptor
    }

    fn place(&self, _: u32, _: &[Facet<Self::Descriptor>]) -> Option<DVec3> {
        None
    }
    fn admits(&self, _: &[Facet<Self::Descriptor>]) -> bool {
        true
    }
}

/// Wants what [`Roofer`] wants.
struct Like {
    /// Share of the way that a vertex is to go, to numbers that single precision has.
    share: f64,
    /// `true` if any step is admitted.
    admits: bool,
}

impl RelaxJudge for Like {
    type Descriptor = f64;

    fn describe(&self, corners: [DVec3; 3], like: Option<&f64>) -> f64 {
        Roofer.describe(corners, like)
    }
    fn fault(&self, descriptor: &f64) -> f64 {
        *descriptor
    }

    fn place(&self, of: u32, around: &[Facet<Self::Descriptor>]) -> Option<DVec3> {
        let v = around[0].corner(of)?;
        Some(v + self.share * (Roofer.place(of, around)? - v))
    }
    fn rounded(&self, place: DVec3) -> DVec3 {
        place.as_vec3().as_dvec3()
    }
    fn admits(&self, _: &[Facet<Self::Descriptor>]) -> bool {
        self.admits
    }
}

/// Wants what [`Roofer`] wants, and divides edges on the ridge instead of moving vertices there.
struct Divider;

impl RelaxJudge for Divider {
    type Descriptor = f64;

    fn describe(&self, corners: [DVec3; 3], like: Option<&f64>) -> f64 {
        Roofer.describe(corners, like)
    }
    fn fault(&self, descriptor: &f64) -> f64 {
        *descriptor
    }

    fn place(&self, _: u32, _: &[Facet<Self::Descriptor>]) -> Option<DVec3> {
        None
    }
    fn between(&self, ends: [u32; 2], facets: &[Facet<Self::Descriptor>; 2]) -> Option<DVec3> {
        assert!(facets[0].descriptor > 0.0, "the first facet is at fault");
        let [p, q] = ends.map(|v| {
            let [one, other] = [0, 1].map(|i| facets[i].corner(v).unwrap());
            assert_eq!(one, other);
            one
        });
        let share = (RIDGE - p.x) / (q.x - p.x);
        let on_ridge = DVec3::new(RIDGE, p.y + share * (q.y - p.y), 0.0);
        (0.0..1.0).contains(&share).then_some(on_ridge)
    }
    fn admits(&self, after: &[Facet<Self::Descriptor>]) -> bool {
        let new = after.iter().filter(|f| f.names.contains(&NEW_VERTEX));
        [0, 4].contains(&new.count())
    }
}

/// Wants the middles of two sheets to be behind one another.
struct Crossing;

impl Crossing {
    fn wanted(z: f64) -> f64 {
        if z < 0.5 { 0.7 } else { 0.3 }
    }
}

impl RelaxJudge for Crossing {
    type Descriptor = f64;

    fn describe(&self, corners: [DVec3; 3], _: Option<&f64>) -> f64 {
        let rim = corners.iter().find(|p| p.x != 0.0).unwrap();
        let apex = corners.iter().find(|p| p.x == 0.0).unwrap();
        (Self::wanted(rim.z) - apex.z).abs()
    }
    fn fault(&self, descriptor: &f64) -> f64 {
        *descriptor
    }

    fn place(&self, of: u32, around: &[Facet<Self::Descriptor>]) -> Option<DVec3> {
        let v = around[0].corner(of).unwrap();
        Some(DVec3::new(0.0, 0.0, Self::wanted(v.z)))
    }
    fn admits(&self, _: &[Facet<Self::Descriptor>]) -> bool {
        true
    }
}

/// Finds no fault.
struct Content;

impl RelaxJudge for Content {
    type Descriptor = f64;

    fn describe(&self, _: [DVec3; 3], _: Option<&f64>) -> f64 {
        0.0
    }
    fn fault(&self, descriptor: &f64) -> f64 {
        *descriptor
    }

    fn place(&self, _: u32, _: &[Facet<Self::Descriptor>]) -> Option<DVec3> {
        unreachable!("nothing is wrong")
    }
    fn admits(&self, _: &[Facet<Self::Descriptor>]) -> bool {
        unreachable!("nothing is wrong")
    }
}

#[test]
fn a_crease_between_vertices_is_found_by_moves_and_flips() {
    let mesh = roof(12);
    let relaxed = relax(&mesh, &Roofer, &Progress::none()).unwrap();
    // what is left lies at the two ends of the ridge, where vertices of the boundary stay
    assert!(
        relaxed.faults[1] < 0.25 * relaxed.faults[0],
        "{:?}",
        relaxed.faults
    );
    let ridge = relaxed.mesh.positions().iter();
    let on_it = ridge.filter(|p| (p.x - RIDGE).abs() < 1e-4).count();
    assert!(on_it >= 9, "{on_it} vertices on the ridge");
    for (before, after) in mesh.positions().iter().zip(relaxed.mesh.positions()) {
        // the smallest step that the pull of `place` leaves undone
        assert!(
            (after.z - roof_height(after.x)).abs() < 1e-4,
            "{before} went to {after}"
        );
        let on_boundary = [before.x, before.y].iter().any(|&c| c == 0.0 || c == 1.0);
        assert!(!on_boundary || before == after, "{before} went to {after}");
    }
    assert_eq!(checked(&relaxed.mesh).self_intersections.unwrap().count, 0);
}

#[test]
fn a_vertex_goes_a_part_of_the_way_where_all_of_it_is_too_far() {
    let mesh = roof(12);
    let overshooting = Like {
        share: 2.0,
        admits: true,
    };
    let relaxed = relax(&mesh, &overshooting, &Progress::none()).unwrap();
    let [before, after] = relaxed.faults;
    assert!(after < 0.25 * before, "{before} became {after}");
    let moved = (mesh.positions().iter().zip(relaxed.mesh.positions())).filter(|(p, q)| p != q);
    let mut count = 0;
    for (_, after) in moved {
        assert_eq!(*after, after.as_vec3().as_dvec3());
        count += 1;
    }
    assert!(count >= 9, "{count} vertices were moved");
    assert_eq!(checked(&relaxed.mesh).self_intersections.unwrap().count, 0);
}

#[test]
fn an_edge_across_a_crease_flips_even_if_no_vertex_may_move() {
    // a tent over a square, whose ridge should go from left to right
    let places = [
        DVec3::new(-1.0, 0.0, 0.5),
        DVec3::new(0.0, -1.0, 0.0),
        DVec3::new(1.0, 0.0, 0.5),
        DVec3::new(0.0, 1.0, 0.0),
    ];
    let mesh = TriMesh::new(places.to_vec(), vec![[0, 1, 3], [1, 2, 3]]).unwrap();
    let relaxed = relax(&mesh, &Tent, &Progress::none()).unwrap();
    assert_eq!((relaxed.flips, relaxed.moves), (1, 0));
    let ridge = |t: &[u32; 3]| t.contains(&0) && t.contains(&2);
    assert!(relaxed.mesh.triangles().iter().all(ridge));
    assert_eq!(relaxed.faults[1], 0.0);
}

#[test]
fn of_two_moves_that_would_meet_one_is_made() {
    let rim = [(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)];
    let fan = |z: f64| {
        let middle = DVec3::new(0.0, 0.0, z);
        std::iter::once(middle).chain(rim.map(|(x, y)| DVec3::new(x, y, z)))
    };
    let triangles = [0, 5]
        .map(|first| [[1, 2], [2, 3], [3, 4], [4, 1]].map(|[a, b]| [first, first + a, first + b]));
    let places = fan(0.0).chain(fan(1.0)).collect();
    let mesh = TriMesh::new(places, triangles.concat()).unwrap();
    let relaxed = relax(&mesh, &Crossing, &Progress::none()).unwrap();
    assert_eq!((relaxed.moves, relaxed.flips), (1, 0));
    assert_eq!(checked(&relaxed.mesh).self_intersections.unwrap().count, 0);
}

#[test]
fn edges_are_divided_where_nothing_else_helps() {
    let mesh = roof(12);
    let relaxed = relax(&mesh, &Divider, &Progress::none()).unwrap();
    let [before, after] = relaxed.faults;
    assert!(after < 0.25 * before, "{before} became {after}");
    assert!(relaxed.splits > 0);
    let (old, new) = relaxed.mesh.positions().split_at(mesh.positions().len());
    assert_eq!(old, mesh.positions());
    assert_eq!(new.len() as u64, relaxed.splits);
    assert!(new.iter().all(|p| p.x == RIDGE));
    let more = relaxed.mesh.triangles().len() - mesh.triangles().len();
    assert_eq!(more as u64, 2 * relaxed.splits);
    let checked = checked(&relaxed.mesh);
    assert!(checked.manifold && checked.oriented);
    assert_eq!(checked.self_intersections.unwrap().count, 0);
    assert_eq!(checked.euler, 1);
}

#[test]
fn what_is_not_admitted_does_not_happen() {
    let mesh = roof(6);
    let stubborn = Like {
        share: 1.0,
        admits: false,
    };
    let relaxed = relax(&mesh, &stubborn, &Progress::none()).unwrap();
    assert_eq!(relaxed.mesh, mesh);
    assert_eq!(relaxed.faults[0], relaxed.faults[1]);
}

#[test]
fn a_mesh_without_faults_is_returned_as_it_is() {
    let mesh = torus(20, 12);
    let relaxed = relax(&mesh, &Content, &Progress::none()).unwrap();
    assert_eq!(relaxed.mesh, mesh);
}

#[test]
fn a_cancelled_relaxation_stops() {
    let progress = Progress::none();
    progress.cancel();
    assert!(relax(&roof(4), &Roofer, &progress).is_err());
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, ..ProptestConfig::default() })]

    /// Whatever is wished for, a closed mesh stays closed and apart from itself, and the sum of faults falls.
    #[test]
    fn wishes_without_sense_break_nothing(seed in 0_u64..1 << 40, reach in 0.01..2.0_f64) {
        /// Likes what a hash likes.
        struct Whim { seed: u64, reach: f64 }
        impl Whim {
            fn number(&self, values: &[f64]) -> f64 {
                let mut hash = self.seed ^ 0x9e37_79b9_7f4a_7c15;
                for value in values {
                    hash = (hash ^ value.to_bits()).wrapping_mul(0xff51_afd7_ed55_8ccd);
                    hash ^= hash >> 33;
                }
                (hash >> 11) as f64 / (1_u64 << 53) as f64
            }
        }
        impl RelaxJudge for Whim {
            type Descriptor = f64;

            fn describe(&self, [a, b, c]: [DVec3; 3], _: Option<&f64>) -> f64 {
                self.number(&[a.x + b.x + c.x, a.y + b.y + c.y, a.z + b.z + c.z])
            }
            fn fault(&self, descriptor: &f64) -> f64 {
                *descriptor
            }

            fn place(&self, of: u32, around: &[Facet<Self::Descriptor>]) -> Option<DVec3> {
                let v = around[0].corner(of).unwrap();
                let shift = [0.0, 1.0, 2.0].map(|k| self.number(&[v.x, v.y, v.z, k]) - 0.5);
                Some(v + self.reach * DVec3::from_array(shift))
            }
            fn between(&self, ends: [u32; 2], facets: &[Facet<Self::Descriptor>; 2]) -> Option<DVec3> {
                let [p, q] = ends.map(|v| facets[0].corner(v).unwrap());
                let middle = 0.5 * (p + q);
                let shift = [3.0, 4.0, 5.0].map(|k| self.number(&[middle.x, middle.y, middle.z, k]) - 0.5);
                Some(middle + self.reach * p.distance(q) * DVec3::from_array(shift))
            }
            fn admits(&self, _: &[Facet<Self::Descriptor>]) -> bool {
                true
            }
        }
        let mesh = torus(14, 9);
        let before = checked(&mesh);
        let whim = Whim { seed, reach };
        let relaxed = relax(&mesh, &whim, &Progress::none()).unwrap();
        let after = checked(&relaxed.mesh);
        prop_assert!(relaxed.flips + relaxed.moves + relaxed.splits > 0);
        prop_assert!(relaxed.faults[1] < relaxed.faults[0]);
        let more = relaxed.mesh.triangles().len() - mesh.triangles().len();
        prop_assert_eq!(more as u64, 2 * relaxed.splits);
        prop_assert!(after.closed && after.manifold && after.oriented);
        prop_assert_eq!(after.self_intersections.unwrap().count, 0);
        prop_assert_eq!(after.components, before.components);
        prop_assert_eq!(after.euler, before.euler);
        let again = relax(&mesh, &whim, &Progress::none()).unwrap();
        prop_assert_eq!(again.mesh, relaxed.mesh);
    }
}

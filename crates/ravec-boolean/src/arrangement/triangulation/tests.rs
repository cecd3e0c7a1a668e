use super::*;
use glam::DVec2;
use proptest::prelude::*;
use ravec_mesh::{orient2d as orient_of, orient3d};

/// Everything is seen against z, so that x and y are the coordinates of the plane.
const AXIS: usize = 2;

fn at(x: i32, y: i32) -> DVec3 {
    DVec3::new(f64::from(x), f64::from(y), 0.0)
}

fn point_ref(p: DVec3) -> PointRef<'static> {
    PointRef::Own(Box::new(Point::at(p)))
}

/// A triangle that holds the square from 0 to 8.
fn started() -> Triangulation<'static> {
    let corners = [at(-1, -1), at(20, -1), at(-1, 20)];
    let grid = Grid::holding(&corners);
    Triangulation::new(corners.map(point_ref), corners, AXIS, grid, 1e-12)
}

/// No triangle is turned over or flat, neighbors agree, and together they have the area of the first.
fn assert_sound(triangulation: &Triangulation) {
    let mut area = 0.0;
    for (t, tri) in triangulation.triangles.iter().enumerate() {
        let [a, b, c] = tri.corners;
        assert_eq!(triangulation.orient(a, b, c), Sign::Positive);
        let [p, q, r] = tri.corners.map(|v| triangulation.point(v).rounded());
        area += 0.5 * (q - p).cross(r - p).z;
        for i in 0..3 {
            if tri.beyond[i] != NONE {
                let other = &triangulation.triangles[tri.beyond[i] as usize];
                let side = other.side_of(tri.corners[(i + 1) % 3], tri.corners[(i + 2) % 3]);
                assert_eq!(other.beyond[side], t as u32);
            }
        }
    }
    assert!((area - 0.5 * 21.0 * 21.0).abs() < 1e-9);
}

proptest! {
    #[test]
    fn points_become_vertices_and_segments_chains_of_edges(
        segments in prop::collection::vec([0_i32..9, 0_i32..9, 0_i32..9, 0_i32..9], 1..12),
    ) {
        let mut triangulation = started();
        let mut laid = Vec::new();
        for &[x, y, z, w] in &segments {
            let (p, q) = (at(x, y), at(z, w));
            let (a, _) = triangulation.insert(point_ref(p));
            let (b, _) = triangulation.insert(point_ref(q));
            assert_sound(&triangulation);
            if a != b {
                laid.push((a, b, triangulation.insert_segment(a, b, Line::Edge([p, q]))));
                assert_sound(&triangulation);
            }
        }
        triangulation.make_round();
        assert_sound(&triangulation);
        for (a, b, name) in laid {
            // along edges of that name from one end to the other
            let mut here = a;
            let mut before = NONE;
            while here != b {
                let next = triangulation.lines_of.iter().find_map(|(&[p, q], lines)| {
                    let other = if p == here { q } else { p };
                    let leads = (p == here || q == here) && other != before;
                    (leads && lines.contains(&name)).then_some(other)
                });
                before = here;
                here = next.expect("the chain goes on");
                prop_assert_eq!(triangulation.orient(a, b, here), Sign::Zero);
            }
        }
        // no two edges of segments cross: every crossing became a vertex
        let edges: Vec<[u32; 2]> = triangulation.lines_of.keys().copied().collect();
        for (i, &[a, b]) in edges.iter().enumerate() {
            for &[c, d] in &edges[i + 1..] {
                let o = |p, q, r| triangulation.orient(p, q, r);
                let apart = o(a, b, c) != -o(a, b, d) || o(c, d, a) != -o(c, d, b);
                prop_assert!(apart || o(a, b, c) == Sign::Zero || o(c, d, a) == Sign::Zero);
            }
        }
    }

    #[test]
    fn points_of_a_chain_are_put_in_by_their_order(mut places in prop::collection::vec(0_i32..20, 1..12)) {
        let mut triangulation = started();
        let mut chain = vec![0, 1];
        for &x in &places {
            let (vertex, _) = triangulation.insert_on(&mut chain, point_ref(at(x, -1)));
            prop_assert_eq!(triangulation.point(vertex).rounded(), at(x, -1));
            assert_sound(&triangulation);
        }
        places.sort_unstable();
        places.dedup();
        let found: Vec<DVec3> = chain.iter().map(|&v| triangulation.point(v).rounded()).collect();
        let inner: Vec<DVec3> = places.into_iter().map(|x| at(x, -1)).collect();
        prop_assert_eq!(&found[1..found.len() - 1], &inner[..]);
    }
}

#[test]
fn a_crossing_is_made_from_the_lines_and_planes_that_meet_there() {
    // a segment of the plane itself, and two in planes that stand upright on it: all through (3, 3)
    let mut triangulation = started();
    let upright = |p: DVec3, q: DVec3| Line::Plane([p, q, p + DVec3::Z]);
    let lines: [(DVec3, DVec3); 3] = [
        (at(1, 1), at(7, 7)),
        (at(3, 0), at(3, 8)),
        (at(0, 6), at(6, 0)),
    ];
    for (i, (p, q)) in lines.into_iter().enumerate() {
        let (a, _) = triangulation.insert(point_ref(p));
        let (b, _) = triangulation.insert(point_ref(q));
        let line = if i == 0 {
            Line::Edge([p, q])
        } else {
            upright(p, q)
        };
        triangulation.insert_segment(a, b, line);
    }
    assert_sound(&triangulation);
    // three corners, six ends and one crossing
    assert_eq!(triangulation.point_count(), 10);
    let mut made = triangulation.points.iter().filter(|p| !p.is_given());
    let crossing = made.next().expect("one was made");
    assert!(crossing.rounded().distance(at(3, 3)) < 1e-12);
    assert!(made.next().is_none());
}

#[test]
fn what_a_border_encloses_is_found() {
    let mut triangulation = started();
    let corners = [at(1, 1), at(6, 1), at(1, 6)];
    let vertices = corners.map(|p| triangulation.insert(point_ref(p)).0);
    // points inside and outside, and a segment across
    for p in [at(2, 2), at(5, 5), at(2, 3)] {
        triangulation.insert(point_ref(p));
    }
    let border: Vec<u32> = (0..3)
        .map(|i| {
            let line = Line::Edge([corners[i], corners[(i + 1) % 3]]);
            triangulation.insert_segment(vertices[i], vertices[(i + 1) % 3], line)
        })
        .collect();
    let (a, _) = triangulation.insert(point_ref(at(0, 2)));
    let (b, _) = triangulation.insert(point_ref(at(7, 3)));
    triangulation.insert_segment(a, b, Line::Edge([at(0, 2), at(7, 3)]));
    let area: f64 = triangulation
        .enclosed(vertices[0], vertices[1], &border)
        .into_iter()
        .map(|t| {
            let [p, q, r] = triangulation.triangles[t as usize]
                .corners
                .map(|v| triangulation.point(v).rounded());
            0.5 * (q - p).cross(r - p).z
        })
        .sum();
    assert!((area - 12.5).abs() < 1e-9);
    // the predicate of the plane agrees with those of the mesh
    let flat = |p: DVec3| DVec2::new(p.x, p.y);
    let [p, q, r] = corners;
    assert_eq!(
        orient_of(flat(p), flat(q), flat(r)),
        -orient3d(p, q, r, -DVec3::Z)
    );
}

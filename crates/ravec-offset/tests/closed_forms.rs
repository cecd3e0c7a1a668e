//! Offsets of meshes whose offsets are known: what they enclose, in how many parts, with how many handles.
//!
//! A surface that keeps the distance δ up to ε encloses at least what the offset at δ − ε does and at most what that at
//! δ + ε does. So volumes are held between two formulas, without any slack.

mod support;

use glam::{DVec3, dvec3};
use ravec_mesh::{TriMesh, measure};
use ravec_offset::Side;
use ravec_scenes::Seed;
use ravec_scenes::solids::{
    comb, cone, crossing_plates, cuboid, cylinder, icosphere, sheet, soup, torus, uv_sphere, wedge,
};
use std::collections::HashMap;
use std::f64::consts::{PI, TAU};
use support::verdict::{params, sound_offset};

/// Volume, area, total mean curvature: all that the volume of offsets of a convex body depends on (Steiner).
struct Convex {
    volume: f64,
    area: f64,
    curvature: f64,
}

impl Convex {
    fn of(mesh: &TriMesh) -> Self {
        let measured = measure(mesh);
        let mut normal_at: HashMap<[u32; 2], DVec3> = HashMap::new();
        let mut curvature = 0.0;
        for &[a, b, c] in mesh.triangles() {
            let [p, q, r] = [a, b, c].map(|v| mesh.positions()[v as usize]);
            let normal = (q - p).cross(r - p).normalize();
            for [from, to] in [[a, b], [b, c], [c, a]] {
                if let Some(other) = normal_at.get(&[to, from]) {
                    let [from, to] = [from, to].map(|v| mesh.positions()[v as usize]);
                    curvature += 0.5 * from.distance(to) * normal.angle_between(*other);
                }
                normal_at.insert([from, to], normal);
            }
        }
        Self {
            volume: measured.volume,
            area: measured.area,
            curvature,
        }
    }

    /// A flat convex sheet: both sides count, and the rim is bent by half a turn.
    fn sheet(area: f64, rim: f64) -> Self {
        Self {
            volume: 0.0,
            area: 2.0 * area,
            curvature: 0.5 * PI * rim,
        }
    }

    fn grown(&self, distance: f64) -> f64 {
        let [one, two, three] = [1, 2, 3].map(|k| distance.powi(k));
        self.volume + self.area * one + self.curvature * two + 4.0 / 3.0 * PI * three
    }
}

/// Distances and tolerances to try, of things with a size of about 2, and whether to simplify.
const TRIED: [(f64, f64, bool); 3] = [(0.3, 0.03, false), (0.1, 0.01, true), (0.9, 0.15, true)];

/// Expectations of one offset.
struct Expected<'a> {
    components: u32,
    genus: u64,
    /// The volume within the offset at a distance: grows with it, or shrinks for cavities.
    volume: &'a dyn Fn(f64) -> f64,
}

fn assert_offset(
    name: &str,
    mesh: &TriMesh,
    side: Side,
    (distance, tolerance, simplify): (f64, f64, bool),
    expected: &Expected<'_>,
) {
    let (found, checked) = sound_offset(name, mesh, &params(side, distance, tolerance, simplify));
    let place = format!("{name}, {side:?}, {distance} up to {tolerance}");
    assert_eq!(checked.components, expected.components, "{place}");
    assert_eq!(checked.genus, Some(expected.genus), "{place}");
    let volume = measure(&found.mesh).volume;
    let ends = [distance - tolerance, distance + tolerance].map(expected.volume);
    let (least, most) = (ends[0].min(ends[1]), ends[0].max(ends[1]));
    assert!(
        volume >= least && volume <= most,
        "{place}: {volume} is not between {least} and {most}"
    );
}

#[test]
fn outer_offsets_of_convex_solids_have_the_volume_of_steiners_formula() {
    for solid in [
        cuboid(dvec3(2.0, 1.5, 1.0)),
        icosphere(1.0, 1),
        uv_sphere(1.0, 12, 6),
        cylinder(0.8, 2.0, 24),
        cone(1.0, 1.6, 24),
        wedge(20_f64.to_radians(), 1.0, 1.0),
    ] {
        let convex = Convex::of(&solid.mesh);
        let expected = Expected {
            components: 1,
            genus: 0,
            volume: &|distance| convex.grown(distance),
        };
        for tried in TRIED {
            assert_offset(solid.name, &solid.mesh, Side::Outer, tried, &expected);
        }
    }
}

#[test]
fn small_clearances_cost_as_much_as_the_mesh_has_detail() {
    let (distance, tolerance) = (5e-4, 2e-5);
    for solid in [cuboid(dvec3(2.0, 1.5, 1.0)), cylinder(0.8, 2.0, 24)] {
        let convex = Convex::of(&solid.mesh);
        for simplify in [false, true] {
            let asked = params(Side::Outer, distance, tolerance, simplify);
            let (found, checked) = sound_offset(solid.name, &solid.mesh, &asked);
            assert_eq!((checked.components, checked.genus), (1, Some(0)));
            assert_eq!(found.report.cells, 0, "{}", solid.name);
            assert!(found.report.extracted_triangles < 4000, "{}", solid.name);
            let volume = measure(&found.mesh).volume;
            let [least, most] =
                [distance - tolerance, distance + tolerance].map(|d| convex.grown(d));
            assert!((least..=most).contains(&volume), "{}: {volume}", solid.name);
        }
    }
    let block = cuboid(dvec3(2.0, 1.5, 1.0));
    let asked = params(Side::Inner, distance, tolerance, true);
    let (found, checked) = sound_offset(block.name, &block.mesh, &asked);
    assert_eq!((checked.components, found.report.cells), (1, 0));
    let expected: f64 = [2.0, 1.5, 1.0]
        .map(|side| side - 2.0 * distance)
        .iter()
        .product();
    assert!((measure(&found.mesh).volume - expected).abs() < 1e-9);
}

#[test]
fn an_outer_offset_does_not_care_which_way_the_triangles_face() {
    let solid = cuboid(dvec3(2.0, 1.5, 1.0));
    let convex = Convex::of(&solid.mesh);
    let (positions, mut triangles) = solid.mesh.into_parts();
    for triangle in &mut triangles {
        triangle.swap(0, 1);
    }
    let flipped = TriMesh::new(positions, triangles).unwrap();
    let expected = Expected {
        components: 1,
        genus: 0,
        volume: &|distance| convex.grown(distance),
    };
    assert_offset("flipped box", &flipped, Side::Outer, TRIED[1], &expected);
}

#[test]
fn inner_offsets_and_shells_of_a_box_have_sharp_edges() {
    let size = dvec3(2.0, 1.5, 1.0);
    let solid = cuboid(size);
    let inner = |distance: f64| (size - 2.0 * distance).max(DVec3::ZERO).element_product();
    for tried in [
        (0.3, 0.02, false),
        (0.1, 0.01, true),
        (0.05, 0.002, true),
        (0.45, 0.02, true),
    ] {
        let expected = Expected {
            components: 1,
            genus: 0,
            volume: &inner,
        };
        assert_offset("box", &solid.mesh, Side::Inner, tried, &expected);
        let expected = Expected {
            components: 2,
            genus: 0,
            volume: &|distance| size.element_product() - inner(distance),
        };
        assert_offset("box", &solid.mesh, Side::Shell, tried, &expected);
    }
}

#[test]
fn a_box_on_both_sides_is_a_thick_wall() {
    let size = dvec3(2.0, 1.5, 1.0);
    let solid = cuboid(size);
    let convex = Convex::of(&solid.mesh);
    let wall = |distance: f64| {
        let cavity = (size - 2.0 * distance).max(DVec3::ZERO).element_product();
        convex.grown(distance) - cavity
    };
    for (tried, components) in [(TRIED[0], 2), (TRIED[1], 2), (TRIED[2], 1)] {
        let expected = Expected {
            components,
            genus: 0,
            volume: &wall,
        };
        assert_offset("box", &solid.mesh, Side::Both, tried, &expected);
    }
}

#[test]
fn inner_offsets_of_a_sphere_are_spheres() {
    let solid = icosphere(1.0, 2);
    for tried in [(0.3, 0.02, false), (0.1, 0.01, true), (0.8, 0.03, true)] {
        // the mesh may be this much deeper than the sphere
        let ball = |distance: f64| {
            let radius = 1.0 - distance;
            let radius = if distance > tried.0 {
                radius - solid.deviation
            } else {
                radius
            };
            4.0 / 3.0 * PI * radius.max(0.0).powi(3)
        };
        let expected = Expected {
            components: 1,
            genus: 0,
            volume: &ball,
        };
        assert_offset("sphere", &solid.mesh, Side::Inner, tried, &expected);
    }
}

/// The volume of a disc of this radius that is turned around an axis this far from its middle, as far as it is on one side.
fn turned_disc(major: f64, radius: f64) -> f64 {
    let steps = 20_000;
    let width = 2.0 * radius / f64::from(steps);
    (0..steps)
        .map(|i| (f64::from(i) + 0.5) * width - radius)
        .filter(|x| major + x > 0.0)
        .map(|x| TAU * (major + x) * 2.0 * (radius * radius - x * x).sqrt() * width)
        .sum()
}

#[test]
fn offsets_of_a_torus_are_tori_until_the_hole_closes() {
    let (major, minor) = (1.0, 0.4);
    let solid = torus(major, minor, 24, 12);
    for (tried, genus) in [
        ((0.1, 0.01, true), 1),
        ((0.3, 0.05, false), 1),
        ((0.8, 0.05, true), 0),
    ] {
        let filled = |distance: f64| {
            // the mesh lies within the torus, by not more than its deviation
            let depth = if distance < tried.0 {
                solid.deviation
            } else {
                0.0
            };
            turned_disc(major, minor + distance - depth)
        };
        let expected = Expected {
            components: 1,
            genus,
            volume: &filled,
        };
        assert_offset("torus", &solid.mesh, Side::Outer, tried, &expected);
    }
    let tried = (0.15, 0.01, true);
    let tube = |distance: f64| {
        let depth = if distance > tried.0 {
            solid.deviation
        } else {
            0.0
        };
        turned_disc(major, minor - distance - depth)
    };
    let expected = Expected {
        components: 1,
        genus: 1,
        volume: &tube,
    };
    assert_offset("torus", &solid.mesh, Side::Inner, tried, &expected);
    let expected = Expected {
        components: 2,
        genus: 2,
        volume: &|distance| measure(&solid.mesh).volume - tube(distance),
    };
    assert_offset("torus", &solid.mesh, Side::Shell, tried, &expected);
}

#[test]
fn open_sheets_become_pillows() {
    let (width, height) = (2.0, 1.5);
    let sheet = sheet(width, height, 6, 5);
    let convex = Convex::sheet(width * height, 2.0 * (width + height));
    let expected = Expected {
        components: 1,
        genus: 0,
        volume: &|distance| convex.grown(distance),
    };
    for tried in TRIED {
        for side in [Side::Both, Side::Outer] {
            assert_offset("sheet", &sheet.mesh, side, tried, &expected);
        }
    }
}

#[test]
fn crossing_plates_have_four_creases() {
    let side = 1.0;
    let plates = crossing_plates(side);
    let plate = Convex::sheet(side * side, 4.0 * side);
    // what is near to both: a square bar, and at its ends halves of what two crossing round bars have in common
    let both = |distance: f64| 4.0 * distance.powi(2) * side + 16.0 / 3.0 * distance.powi(3);
    let expected = Expected {
        components: 1,
        genus: 0,
        volume: &|distance| 2.0 * plate.grown(distance) - both(distance),
    };
    for tried in [(0.1, 0.01, true), (0.3, 0.03, false)] {
        for side in [Side::Both, Side::Outer] {
            assert_offset("crossing plates", &plates.mesh, side, tried, &expected);
        }
    }
}

/// The polygon of a comb, all of whose corners are square.
struct CombSection {
    area: f64,
    rim: f64,
    depth: f64,
    convex_corners: f64,
    concave_corners: f64,
}

impl CombSection {
    fn new(fins: f64, thickness: f64, gap: f64, height: f64) -> Self {
        let width = fins * (thickness + gap) - gap;
        Self {
            area: width * gap + fins * thickness * height,
            rim: 2.0 * (width + gap + fins * height),
            depth: height,
            convex_corners: 2.0 * fins + 2.0,
            concave_corners: 2.0 * fins - 2.0,
        }
    }

    /// The volume of the outer offset, while gaps are open.
    fn grown(&self, distance: f64) -> f64 {
        // the section is as much wider as a half circle says, towards both ends
        let bend = 0.25 * PI * self.convex_corners - self.concave_corners;
        let section = self.area + self.rim * distance + bend * distance.powi(2);
        let end = self.area * distance
            + 0.25 * PI * self.rim * distance.powi(2)
            + 2.0 / 3.0 * bend * distance.powi(3);
        section * self.depth + 2.0 * end
    }

    /// The volume of the inner offset, while fins are left.
    fn shrunk(&self, distance: f64) -> f64 {
        let bend = self.convex_corners - 0.25 * PI * self.concave_corners;
        let section = self.area - self.rim * distance + bend * distance.powi(2);
        section * (self.depth - 2.0 * distance)
    }
}

#[test]
fn fins_keep_their_gaps_and_their_thickness() {
    let comb = comb(4, 0.04, 0.16, 0.6);
    let section = CombSection::new(4.0, 0.04, 0.16, 0.6);
    for tried in [(0.05, 0.005, true), (0.015, 0.002, false)] {
        let expected = Expected {
            components: 1,
            genus: 0,
            volume: &|distance| section.grown(distance),
        };
        assert_offset("comb", &comb.mesh, Side::Outer, tried, &expected);
    }
    let tried = (0.015, 0.002, true);
    let expected = Expected {
        components: 1,
        genus: 0,
        volume: &|distance| section.shrunk(distance),
    };
    assert_offset("comb", &comb.mesh, Side::Inner, tried, &expected);
    let expected = Expected {
        components: 2,
        genus: 0,
        volume: &|distance| section.grown(distance) - section.shrunk(distance),
    };
    assert_offset("comb", &comb.mesh, Side::Both, tried, &expected);
}

#[test]
fn fins_that_are_too_thin_for_the_distance_leave_only_the_base() {
    let comb = comb(4, 0.04, 0.16, 0.6);
    let (distance, tolerance) = (0.05, 0.004);
    let asked = params(Side::Inner, distance, tolerance, false);
    let (found, checked) = sound_offset("comb", &comb.mesh, &asked);
    assert_eq!((checked.components, checked.genus), (1, Some(0)));
    // below the fins the base is thicker by what is between two spheres, so its top is not flat there
    let size = found.mesh.bounds().size();
    let room = dvec3(0.64, 0.16, 0.6) - 2.0 * distance;
    assert!((size.x - room.x).abs() <= 2.0 * tolerance, "{size}");
    assert!((size.z - room.z).abs() <= 2.0 * tolerance, "{size}");
    assert!(
        size.y >= room.y - 2.0 * tolerance && size.y <= room.y + 0.04,
        "{size}"
    );
}

#[test]
fn offsets_of_points_and_segments_are_balls_and_capsules() {
    let end = dvec3(1.0, 0.2, -0.3);
    let length = end.length();
    for (triangle, length) in [([0, 0, 0], 0.0), ([0, 1, 0], length)] {
        let mesh = TriMesh::new(vec![DVec3::ZERO, end], vec![triangle]).unwrap();
        let expected = Expected {
            components: 1,
            genus: 0,
            volume: &|distance| PI * distance.powi(2) * (length + 4.0 / 3.0 * distance),
        };
        for tried in TRIED {
            assert_offset("thin triangle", &mesh, Side::Both, tried, &expected);
        }
    }
}

#[test]
fn soups_of_all_that_is_wrong_have_sound_offsets() {
    for seed in 1..3 {
        let (soup, _) = soup(16, Seed(seed));
        for side in [Side::Both, Side::Outer] {
            for (distance, tolerance, simplify) in [(0.1, 0.03, true), (0.3, 0.05, false)] {
                let asked = params(side, distance, tolerance, simplify);
                let (_, checked) = sound_offset(&format!("soup {seed}"), &soup.mesh, &asked);
                assert!(checked.components >= 1);
            }
        }
    }
}

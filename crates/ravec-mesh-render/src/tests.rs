mod color;
mod lines;
mod prepared;

use std::f64::consts::PI;

use super::*;
use ravec_mesh::Aabb;

fn mesh(positions: Vec<DVec3>, triangles: Vec<[u32; 3]>) -> TriMesh {
    TriMesh::new(positions, triangles).unwrap()
}

/// The box between two corners.
fn cuboid(min: DVec3, max: DVec3) -> TriMesh {
    let positions = (0..8)
        .map(|i| {
            let pick = DVec3::new(f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2));
            min + pick * (max - min)
        })
        .collect();
    let quads = [
        [0, 2, 3, 1],
        [4, 5, 7, 6],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 4, 6, 2],
        [1, 3, 7, 5],
    ];
    let triangles = quads
        .iter()
        .flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]);
    mesh(positions, triangles.collect())
}

fn cube() -> TriMesh {
    cuboid(DVec3::ZERO, DVec3::ONE)
}

fn together(parts: &[TriMesh]) -> TriMesh {
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for part in parts {
        let first = positions.len() as u32;
        positions.extend_from_slice(part.positions());
        triangles.extend(
            part.triangles()
                .iter()
                .map(|corners| corners.map(|v| v + first)),
        );
    }
    mesh(positions, triangles)
}

/// A sphere of radius 1 from an octahedron, each triangle cut in four `levels` times; corners are welded.
fn sphere(levels: u32) -> TriMesh {
    let mut soup: Vec<[DVec3; 3]> = Vec::new();
    for i in 0..8 {
        let sign = |bit: i32| if i >> bit & 1 == 0 { 1.0 } else { -1.0 };
        let corners = [DVec3::X * sign(0), DVec3::Y * sign(1), DVec3::Z * sign(2)];
        let outward = sign(0) * sign(1) * sign(2) > 0.0;
        let [a, b, c] = corners;
        soup.push(if outward { [a, b, c] } else { [a, c, b] });
    }
    for _ in 0..levels {
        let cut = |[a, b, c]: [DVec3; 3]| {
            let [ab, bc, ca] = [a + b, b + c, c + a].map(DVec3::normalize);
            [[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]
        };
        soup = soup.into_iter().flat_map(cut).collect();
    }
    let mut positions: Vec<DVec3> = Vec::new();
    let mut known = std::collections::HashMap::new();
    let triangles = soup
        .iter()
        .map(|corners| {
            corners.map(|at| {
                let key = at.to_array().map(|x| (x * 1e9).round() as i64);
                *known.entry(key).or_insert_with(|| {
                    positions.push(at);
                    positions.len() as u32 - 1
                })
            })
        })
        .collect();
    mesh(positions, triangles)
}

/// Small, transparent behind, without lines, from the front.
fn plain() -> RenderParams {
    RenderParams {
        width: 120,
        height: 100,
        camera: from(View::FRONT),
        background: None,
        features: None,
        ..Default::default()
    }
}

fn from(view: View) -> Camera {
    Camera {
        view,
        ..Default::default()
    }
}

fn shown(mesh: &TriMesh, paint: &Paint<'_>, params: &RenderParams) -> Picture {
    let rendering = render(mesh, paint, params, &Progress::none()).unwrap();
    assert_eq!(
        rendering.picture.pixels.len(),
        4 * params.width as usize * params.height as usize
    );
    rendering.picture
}

fn pixel(picture: &Picture, x: u32, y: u32) -> [u8; 4] {
    let start = 4 * (y * picture.width + x) as usize;
    picture.pixels[start..start + 4].try_into().unwrap()
}

/// Number of covered pixels, in all.
fn covered(picture: &Picture) -> f64 {
    let alpha = picture.pixels.iter().skip(3).step_by(4);
    alpha.map(|&alpha| f64::from(alpha) / 255.0).sum()
}

/// Number of pixels that satisfy a condition.
fn count(picture: &Picture, is: impl Fn([u8; 4]) -> bool) -> usize {
    let pixels = picture.pixels.chunks_exact(4);
    pixels
        .filter(|pixel| is([pixel[0], pixel[1], pixel[2], pixel[3]]))
        .count()
}

const RED: Rgb8 = [255, 0, 0];
const GREEN: Rgb8 = [0, 255, 0];
const BLACK_LINES: FeatureLines = FeatureLines {
    angle_deg: 30.0,
    silhouettes: false,
    style: LineStyle {
        color: [0, 0, 0],
        width_px: 2.0,
    },
};

/// Mostly of the first color and hardly of the second.
fn is_red([r, g, _, a]: [u8; 4]) -> bool {
    a == 255 && r > 100 && g < 60
}

fn is_green([r, g, _, a]: [u8; 4]) -> bool {
    a == 255 && g > 100 && r < 60
}

fn is_black([r, g, b, a]: [u8; 4]) -> bool {
    a == 255 && r.max(g).max(b) < 40
}

#[test]
fn a_sphere_covers_a_disc_from_everywhere() {
    let sphere = sphere(5);
    for (_, view) in View::NAMED {
        let params = RenderParams {
            camera: from(view),
            ..plain()
        };
        let picture = shown(&sphere, &Paint::Plain, &params);
        // It fills 92 % of the height; the polygon falls short of the circle by less than 0.3 %.
        let disc = PI * (0.46 * 100.0_f64).powi(2);
        let share = covered(&picture) / disc;
        assert!((0.995..1.001).contains(&share), "{view:?}: {share}");
    }
}

#[test]
fn in_perspective_a_sphere_covers_what_its_tangents_enclose() {
    let sphere = sphere(5);
    let params = RenderParams {
        camera: Camera {
            projection: Projection::Perspective {
                field_of_view_deg: 60.0,
            },
            frame: Some(Aabb::new(DVec3::splat(-1.0), DVec3::splat(1.0))),
            ..from(View::FRONT)
        },
        ..plain()
    };
    let picture = shown(&sphere, &Paint::Plain, &params);
    let size = [360.0, 300.0];
    let projector = Projector::new(&params.camera, sphere.positions(), sphere.bounds(), size);
    // The eye's distance from the middle, from how much larger the front of the frame looks than its middle.
    let width = |y: f64| {
        projector.project(DVec3::new(1.0, y, 0.0)).x - projector.project(DVec3::new(0.0, y, 0.0)).x
    };
    let distance = 1.0 / (1.0 - width(0.0) / width(-1.0));
    let radius_px = projector.samples_per_unit(DVec3::ZERO) / 3.0 * distance
        / (distance * distance - 1.0).sqrt();
    let share = covered(&picture) / (PI * radius_px * radius_px);
    assert!((0.993..1.002).contains(&share), "{share} at {distance}");
}

#[test]
fn neighbors_leave_no_gap_and_share_no_sample() {
    // Half transparent light would show both: every pixel within a square of many slivers is fully covered.
    let fan: Vec<DVec3> = (0..400)
        .map(|i| {
            let turn = 2.0 * PI * f64::from(i) / 400.0;
            DVec3::new(turn.cos(), 0.0, turn.sin())
        })
        .chain([DVec3::new(0.123, 0.0, 0.456)])
        .collect();
    let triangles = (0..400).map(|i| [400, i, (i + 1) % 400]).collect();
    let picture = shown(&mesh(fan, triangles), &Paint::Plain, &plain());
    let (mut inside, mut full) = (0, 0);
    for y in 0..100 {
        for x in 0..120 {
            let r = (f64::from(x) - 59.5).hypot(f64::from(y) - 49.5);
            if r < 44.0 {
                inside += 1;
                full += usize::from(pixel(&picture, x, y)[3] == 255);
            }
        }
    }
    assert_eq!(full, inside);
    let disc = PI * 46_f64.powi(2);
    assert!((covered(&picture) / disc - 1.0).abs() < 2e-3);
}

#[test]
fn what_is_nearer_hides_what_is_behind_whatever_the_order() {
    // Seen from the front, the red wall has the smaller y and half the width.
    let red = cuboid(DVec3::new(0.0, 0.0, 0.0), DVec3::new(1.0, 0.1, 2.0));
    let green = cuboid(DVec3::new(0.0, 1.0, 0.0), DVec3::new(2.0, 1.1, 2.0));
    for (first, second, colors) in [(&red, &green, [RED, GREEN]), (&green, &red, [GREEN, RED])] {
        let both = together(&[first.clone(), second.clone()]);
        let colors: Vec<Rgb8> = (0..24).map(|t| colors[t / 12]).collect();
        for projection in [
            Projection::Orthographic,
            Projection::Perspective {
                field_of_view_deg: 40.0,
            },
        ] {
            let camera = |view| Camera {
                projection,
                ..from(view)
            };
            let look = |view| {
                let params = RenderParams {
                    camera: camera(view),
                    ..plain()
                };
                shown(&both, &Paint::FaceColors(&colors), &params)
            };
            let front = look(View::FRONT);
            assert!(is_red(pixel(&front, 45, 50)) && is_green(pixel(&front, 75, 50)));
            let back = look(View::BACK);
            assert!(is_green(pixel(&back, 45, 50)) && is_green(pixel(&back, 75, 50)));
        }
    }
}

#[test]
fn a_cut_box_shows_its_inside_or_its_cap_where_it_was_cut() {
    // Seen from above, with the upper half taken away: nothing but the inside, or the cut.
    let section = |capped| {
        Some(Section {
            normal: DVec3::Z,
            offset: 0.5,
            capped,
        })
    };
    let params = |view, capped| RenderParams {
        camera: from(view),
        front_color: GREEN,
        back_color: RED,
        cut_color: [0, 0, 255],
        section: section(capped),
        ..plain()
    };
    // 92 pixels square.
    let open = shown(&cube(), &Paint::Plain, &params(View::TOP, false));
    let red = count(&open, is_red);
    assert!((8281..=8649).contains(&red), "{red}");
    assert_eq!(count(&open, is_green), 0);
    let capped = shown(&cube(), &Paint::Plain, &params(View::TOP, true));
    let blue = count(&capped, |[r, g, b, a]| [r, g, b, a] == [0, 0, 255, 255]);
    assert!((8281..=8649).contains(&blue), "{blue}");
    // From the front the lower half is left.
    let side = shown(&cube(), &Paint::Plain, &params(View::FRONT, false));
    assert!(
        (covered(&side) - 92.0 * 46.0).abs() < 60.0,
        "{}",
        covered(&side)
    );
    assert!(is_green(pixel(&side, 60, 60)) && pixel(&side, 60, 40)[3] == 0);
    let wall = cuboid(DVec3::new(0.0, 0.0, 2.0), DVec3::new(1.0, 1.0, 3.0));
    let gone = shown(&wall, &Paint::Plain, &params(View::FRONT, false));
    assert_eq!(covered(&gone), 0.0);
}

#[test]
fn the_picture_does_not_depend_on_the_number_of_threads() {
    let scene = together(&[sphere(4), cube()]);
    let params = RenderParams {
        wireframe: Some(BLACK_LINES.style),
        features: Some(BLACK_LINES),
        camera: from(View::ISO),
        width: 150,
        height: 140,
        ..plain()
    };
    let with_threads = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        let pool = pool.build().unwrap();
        pool.install(|| shown(&scene, &Paint::Plain, &params))
    };
    assert_eq!(with_threads(1), with_threads(3));
}

#[test]
fn nothing_and_next_to_nothing_are_pictures_too() {
    let empty = shown(
        &TriMesh::default(),
        &Paint::Plain,
        &RenderParams {
            background: Some(RED),
            ..plain()
        },
    );
    assert_eq!(count(&empty, is_red), 12_000);
    let point = mesh(vec![DVec3::ONE; 3], vec![[0, 1, 2]]);
    let segment = mesh(vec![DVec3::ZERO, DVec3::X, DVec3::X], vec![[0, 1, 2]]);
    for degenerate in [point, segment] {
        for projection in [
            Projection::Orthographic,
            Projection::Perspective {
                field_of_view_deg: 40.0,
            },
        ] {
            let camera = Camera {
                projection,
                ..Default::default()
            };
            let params = RenderParams {
                features: Some(FeatureLines::default()),
                camera,
                ..plain()
            };
            assert!(covered(&shown(&degenerate, &Paint::Plain, &params)) < 1000.0);
        }
    }
}

#[test]
fn each_error_has_its_cause() {
    let ask = |change: &dyn Fn(&mut RenderParams)| {
        let mut params = plain();
        change(&mut params);
        render(&cube(), &Paint::Plain, &params, &Progress::none()).unwrap_err()
    };
    assert_eq!(
        ask(&|params| params.width = 0),
        RenderError::Size {
            width: 0,
            height: 100
        }
    );
    assert_eq!(
        ask(&|params| params.samples_per_side = 9),
        RenderError::Samples(9)
    );
    assert_eq!(
        ask(&|params| params.camera.zoom = -1.0),
        RenderError::Camera
    );
    assert_eq!(
        ask(&|params| params.smooth_angle_deg = f64::NAN),
        RenderError::Lines
    );
    let section = Section {
        normal: DVec3::ZERO,
        offset: 0.0,
        capped: false,
    };
    assert_eq!(
        ask(&|params| params.section = Some(section)),
        RenderError::Section
    );
    let paint = Paint::VertexColors(&[RED]);
    assert_eq!(
        render(&cube(), &paint, &plain(), &Progress::none()),
        Err(RenderError::Paint {
            got: 1,
            expected: 8
        })
    );
    let progress = Progress::none();
    progress.cancel();
    assert_eq!(
        render(&cube(), &Paint::Plain, &plain(), &progress),
        Err(RenderError::Cancelled(Cancelled))
    );
}

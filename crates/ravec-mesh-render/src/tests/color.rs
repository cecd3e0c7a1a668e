//! Colors, shading and scales.

use super::*;

#[test]
fn backs_have_another_color_and_a_flipped_mesh_shows_them() {
    let cube = cube();
    let flipped = cube
        .triangles()
        .iter()
        .map(|&[a, b, c]| [a, c, b])
        .collect();
    let flipped = mesh(cube.positions().to_vec(), flipped);
    let params = RenderParams {
        front_color: GREEN,
        back_color: RED,
        ..plain()
    };
    assert!(is_green(pixel(
        &shown(&cube, &Paint::Plain, &params),
        60,
        50
    )));
    assert!(is_red(pixel(
        &shown(&flipped, &Paint::Plain, &params),
        60,
        50
    )));
}

#[test]
fn values_have_the_colors_of_the_legend() {
    // A wall that faces the light squarely, with values from left to right.
    let wall = mesh(
        vec![DVec3::ZERO, DVec3::X, DVec3::new(1.0, 0.0, 1.0), DVec3::Z],
        vec![[0, 1, 2], [0, 2, 3]],
    );
    let values = [-1.0, 3.0, 3.0, -1.0];
    let paint = |map, range| {
        Paint::VertexValues(Values {
            values: &values,
            map,
            range,
        })
    };
    let legend = |map, range| {
        let rendering = render(&wall, &paint(map, range), &plain(), &Progress::none());
        rendering.unwrap().legend.unwrap()
    };
    let found = legend(ColorMap::Sequential, None);
    assert_eq!((found.low, found.high), (-1.0, 3.0));
    assert_eq!(found.color(3.0), ColorMap::Sequential.color(1.0));
    let found = legend(ColorMap::Diverging, None);
    assert_eq!((found.low, found.high), (-3.0, 3.0));
    let found = legend(ColorMap::Diverging, Some([0.0, 8.0]));
    assert_eq!((found.low, found.high), (0.0, 8.0));

    let picture = shown(
        &wall,
        &paint(ColorMap::Diverging, Some([-1.0, 3.0])),
        &plain(),
    );
    let [left, middle, right] = [18, 60, 101].map(|x| pixel(&picture, x, 50));
    assert!(
        left[2] > left[0] + 60 && right[0] > right[2] + 60,
        "{left:?} {right:?}"
    );
    assert!(middle[0].abs_diff(middle[2]) < 12, "{middle:?}");
    let none = [f64::NAN; 4];
    let gray = shown(
        &wall,
        &Paint::VertexValues(Values {
            values: &none,
            map: ColorMap::Sequential,
            range: None,
        }),
        &plain(),
    );
    let [r, g, b, _] = pixel(&gray, 60, 50);
    assert!(r == g && g == b && r > 60);
}

#[test]
fn smooth_shading_hides_facets_but_keeps_creases() {
    // Along a row, a faceted sphere has steps of brightness that a smooth one has not.
    let jump = |angle: f64, mesh: &TriMesh, view| {
        let params = RenderParams {
            smooth_angle_deg: angle,
            camera: from(view),
            samples_per_side: 1,
            ..plain()
        };
        let picture = shown(mesh, &Paint::Plain, &params);
        (30..90)
            .map(|x| pixel(&picture, x, 50)[0].abs_diff(pixel(&picture, x + 1, 50)[0]))
            .max()
    };
    let sphere = sphere(2);
    let [faceted, smooth] = [0.0, 40.0].map(|angle| jump(angle, &sphere, View::FRONT));
    assert!(
        faceted >= smooth.map(|step| 2 * step),
        "{faceted:?} {smooth:?}"
    );
    let corner = View::new(45.0, 0.0);
    assert!(jump(40.0, &cube(), corner) > Some(20));
    assert_eq!(jump(40.0, &cube(), corner), jump(0.0, &cube(), corner));
}

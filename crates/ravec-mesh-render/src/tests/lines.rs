//! Lines on the surface.

use super::*;

#[test]
fn edges_are_drawn_only_where_they_are_in_front() {
    let params = RenderParams {
        features: Some(BLACK_LINES),
        front_color: [255; 3],
        camera: from(View::new(30.0, 30.0)),
        ..plain()
    };
    let size = [360.0, 300.0];
    let cube = cube();
    let picture = shown(&cube, &Paint::Plain, &params);
    let projector = Projector::new(&params.camera, cube.positions(), cube.bounds(), size);
    // From above, the right and the front the corner at the left, the back and the bottom is hidden with its three edges.
    let hidden = DVec3::new(0.0, 1.0, 0.0);
    for axis in 0..3 {
        for i in 0..4 {
            let mut start = [0.0; 3];
            start[(axis + 1) % 3] = f64::from(i & 1);
            start[(axis + 2) % 3] = f64::from(i >> 1);
            let mut end = start;
            end[axis] = 1.0;
            let (start, end) = (DVec3::from_array(start), DVec3::from_array(end));
            let at = projector.project(0.5 * (start + end));
            let is_hidden = start == hidden || end == hidden;
            // The width of two pixels covers the pixel of the middle, or nearly so.
            let [r, _, _, a] = pixel(&picture, (at.x / 3.0) as u32, (at.y / 3.0) as u32);
            assert!(a == 255);
            assert_eq!(r > 110, is_hidden, "{start} to {end}: {r}");
        }
    }
}

#[test]
fn flat_diagonals_are_no_features_but_part_of_the_wireframe() {
    let bare = RenderParams {
        front_color: [255; 3],
        ..plain()
    };
    let with_features = RenderParams {
        features: Some(BLACK_LINES),
        ..bare.clone()
    };
    let with_wires = RenderParams {
        wireframe: Some(BLACK_LINES.style),
        ..bare.clone()
    };
    let black = |params: &RenderParams| count(&shown(&cube(), &Paint::Plain, params), is_black);
    assert_eq!(black(&bare), 0);
    // Four sides of 92 pixels, at least one pixel wide at full strength; the diagonal adds its length.
    let (sides, wires) = (black(&with_features), black(&with_wires));
    assert!((300..800).contains(&sides), "{sides}");
    assert!(wires > sides + 60 && wires < sides + 300, "{sides} {wires}");
}

#[test]
fn silhouettes_surround_what_has_no_creases() {
    let sphere = sphere(4);
    let lines = |silhouettes| {
        let params = RenderParams {
            features: Some(FeatureLines {
                silhouettes,
                ..BLACK_LINES
            }),
            front_color: [255; 3],
            ..plain()
        };
        count(&shown(&sphere, &Paint::Plain, &params), is_black)
    };
    assert_eq!(lines(false), 0);
    let around = 2.0 * PI * 46.0;
    let found = lines(true) as f64;
    assert!(
        (0.8 * around..3.0 * around).contains(&found),
        "{found} of {around}"
    );
}

#[test]
fn marked_edges_are_drawn_in_their_own_color_over_all_others() {
    let mesh = cuboid(DVec3::ZERO, DVec3::ONE);
    let [a, b, c] = mesh.triangles()[0];
    let params = RenderParams {
        width: 60,
        height: 60,
        features: None,
        marked: Some(MarkedEdges {
            // the diagonal of the first face, and a pair that is no edge
            edges: vec![[c, b], [a, a]],
            style: LineStyle {
                color: [255, 0, 0],
                width_px: 3.0,
            },
        }),
        ..RenderParams::default()
    };
    let red = |params: &RenderParams| {
        let views = [
            View::TOP,
            View::BOTTOM,
            View::FRONT,
            View::BACK,
            View::LEFT,
            View::RIGHT,
        ];
        let drawn = views.map(|view| {
            let camera = Camera {
                view,
                ..Camera::default()
            };
            let params = RenderParams {
                camera,
                ..params.clone()
            };
            let picture = render(&mesh, &Paint::Plain, &params, &Progress::none()).unwrap();
            let pixels = picture.picture.pixels;
            pixels.chunks(4).filter(|p| p[0] > 200 && p[1] < 60).count()
        });
        drawn.iter().sum::<usize>()
    };
    assert!(red(&params) > 60);
    let plain = RenderParams {
        marked: None,
        ..params
    };
    assert_eq!(red(&plain), 0);
}

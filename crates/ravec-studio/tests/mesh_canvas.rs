//! The canvas of meshes, driven by drags, clicks and keys without a window.

use egui::{Color32, ColorImage, Key, Modifiers, PointerButton, Pos2, Vec2, vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable as _;
use glam::DVec3;
use ravec::mesh::TriMesh;
use ravec::mesh_render::{ColorMap, View};
use ravec_scenes::solids::{cuboid, torus};
use ravec_studio::mesh::{MarkedPlace, MeshCanvas, ShownMesh, VertexValues};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// A bound on the time that background work may take, far beyond what it takes.
const HANG: Duration = Duration::from_mins(2);

struct Window {
    canvas: MeshCanvas,
    shown: Option<Arc<ShownMesh>>,
    ghost: Option<Arc<ShownMesh>>,
}

type Studio = Harness<'static, Window>;

fn window(shown: Option<ShownMesh>, size: Vec2, pixels_per_point: f32) -> Studio {
    let window = Window {
        canvas: MeshCanvas::new(Arc::new(|| {}), None),
        shown: shown.map(Arc::new),
        ghost: None,
    };
    let mut harness = Harness::builder()
        .with_size(size)
        .with_pixels_per_point(pixels_per_point)
        .with_step_dt(1.0 / 60.0)
        .build_ui_state(
            |ui, window: &mut Window| {
                egui::Panel::left("options").show(ui, |ui| window.canvas.options_ui(ui));
                egui::CentralPanel::no_frame().show(ui, |ui| {
                    let (shown, ghost) = (window.shown.clone(), window.ghost.clone());
                    window.canvas.ui(ui, shown.as_ref(), ghost.as_ref());
                });
            },
            window,
        );
    settle(&mut harness);
    harness
}

fn shown(mesh: TriMesh) -> ShownMesh {
    ShownMesh::new(Arc::new(mesh))
}

fn studio(mesh: TriMesh) -> Studio {
    window(Some(shown(mesh)), vec2(900.0, 600.0), 1.0)
}

/// Lets the window run until its picture is the last one, and points can be picked.
fn settle(harness: &mut Studio) {
    let start = Instant::now();
    let mut quiet = 0;
    while quiet < 3 {
        harness.step();
        let window = harness.state();
        let picks = window.shown.is_none() || window.canvas.is_ready_to_pick();
        if window.canvas.is_busy() || !picks {
            quiet = 0;
            std::thread::sleep(Duration::from_millis(2));
        } else {
            quiet += 1;
        }
        assert!(start.elapsed() < HANG, "the canvas hangs");
    }
}

fn canvas(harness: &Studio) -> &MeshCanvas {
    &harness.state().canvas
}

fn picture(harness: &Studio) -> Arc<ColorImage> {
    canvas(harness).picture().unwrap().clone()
}

fn middle(harness: &Studio) -> Pos2 {
    harness.get_by_label("Mesh canvas").rect().center()
}

fn click(harness: &mut Studio, label: &str) {
    harness.get_by_label(label).click();
    settle(harness);
}

fn press(harness: &mut Studio, at: Pos2, button: PointerButton, pressed: bool, keys: Modifiers) {
    harness.event_modifiers(
        egui::Event::PointerButton {
            pos: at,
            button,
            pressed,
            modifiers: keys,
        },
        keys,
    );
    harness.step();
}

fn drag_with(harness: &mut Studio, points: &[Pos2], button: PointerButton, keys: Modifiers) {
    harness.hover_at(points[0]);
    harness.step();
    press(harness, points[0], button, true, keys);
    for &point in &points[1..] {
        harness.event_modifiers(egui::Event::PointerMoved(point), keys);
        harness.step();
    }
    press(harness, points[points.len() - 1], button, false, keys);
    settle(harness);
}

fn drag(harness: &mut Studio, points: &[Pos2]) {
    drag_with(harness, points, PointerButton::Primary, Modifiers::NONE);
}

fn click_at(harness: &mut Studio, at: Pos2) {
    harness.hover_at(at);
    harness.step();
    press(harness, at, PointerButton::Primary, true, Modifiers::NONE);
    press(harness, at, PointerButton::Primary, false, Modifiers::NONE);
    settle(harness);
}

/// Number of pixels that satisfy a condition.
fn count(picture: &ColorImage, is: impl Fn(Color32) -> bool) -> usize {
    picture.pixels.iter().filter(|&&pixel| is(pixel)).count()
}

fn is_bluish(pixel: Color32) -> bool {
    let [r, _, b, _] = pixel.to_array();
    i32::from(b) - i32::from(r) > 20
}

fn is_ocher(pixel: Color32) -> bool {
    let [r, g, b, _] = pixel.to_array();
    r > g && i32::from(g) - i32::from(b) > 50
}

fn is_red(pixel: Color32) -> bool {
    let [r, g, b, _] = pixel.to_array();
    r > 180 && g < 90 && b < 90
}

#[test]
fn a_drag_turns_the_view_and_changes_the_picture() {
    let mut harness = studio(torus(2.0, 0.7, 60, 30).mesh);
    let before = (*canvas(&harness).camera(), picture(&harness));
    let size = harness.get_by_label("Mesh canvas").rect().size();
    assert_eq!(before.1.size, [size.x as usize, size.y as usize]);
    let at = middle(&harness);
    drag(
        &mut harness,
        &[at, at + vec2(30.0, 0.0), at + vec2(80.0, 25.0)],
    );
    let after = *canvas(&harness).camera();
    let turned = [
        after.view.azimuth_deg - before.0.view.azimuth_deg,
        after.view.elevation_deg - before.0.view.elevation_deg,
    ];
    assert!((turned[0] + 32.0).abs() < 0.01 && (turned[1] - 10.0).abs() < 0.01);
    assert_eq!((after.center, after.span), (before.0.center, before.0.span));
    assert_ne!(picture(&harness).pixels, before.1.pixels);
    // a tool that holds a handle
    harness.state_mut().canvas.lock_orbit(true);
    drag(&mut harness, &[at, at + vec2(80.0, 25.0)]);
    assert_eq!(*canvas(&harness).camera(), after);
}

#[test]
fn the_surface_follows_a_hand_that_pans_with_any_of_the_three_gestures() {
    let mut harness = studio(torus(2.0, 0.7, 60, 30).mesh);
    for (button, keys, space) in [
        (PointerButton::Middle, Modifiers::NONE, false),
        (PointerButton::Primary, Modifiers::SHIFT, false),
        (PointerButton::Primary, Modifiers::NONE, true),
    ] {
        click(&mut harness, "Fit");
        let from = middle(&harness) + vec2(90.0, 60.0);
        let to = from + vec2(-60.0, 45.0);
        let view = canvas(&harness).camera().view;
        let point = canvas(&harness).pick(from).unwrap().point;
        if space {
            harness.key_down(Key::Space);
        }
        drag_with(
            &mut harness,
            &[from, from + vec2(9.0, 9.0), to],
            button,
            keys,
        );
        if space {
            harness.key_up(Key::Space);
        }
        assert!(canvas(&harness).project(point).unwrap().distance(to) < 0.1);
        assert_eq!(canvas(&harness).camera().view, view);
    }
}

#[test]
fn the_wheel_zooms_to_the_cursor() {
    for mode in ["Perspective", "Parallel"] {
        let mut harness = studio(torus(2.0, 0.7, 60, 30).mesh);
        click(&mut harness, mode);
        let at = middle(&harness) + vec2(90.0, 60.0);
        let point = canvas(&harness).pick(at).unwrap().point;
        let span = canvas(&harness).camera().span;
        harness.hover_at(at);
        harness.step();
        harness.event(egui::Event::MouseWheel {
            unit: egui::MouseWheelUnit::Point,
            delta: vec2(0.0, 120.0),
            phase: egui::TouchPhase::Move,
            source: egui::MouseWheelSource::Unknown,
            modifiers: Modifiers::NONE,
        });
        for _ in 0..60 {
            harness.step();
        }
        settle(&mut harness);
        assert!(canvas(&harness).camera().span < 0.9 * span);
        assert!(canvas(&harness).project(point).unwrap().distance(at) < 0.5);
        let found = canvas(&harness).pick(at).unwrap().point;
        assert!(found.distance(point) < 0.02, "{found} {point}");
    }
}

#[test]
fn a_double_click_centers_on_the_surface() {
    let mut harness = studio(torus(2.0, 0.7, 60, 30).mesh);
    let at = middle(&harness) + vec2(90.0, 60.0);
    let point = canvas(&harness).pick(at).unwrap().point;
    harness.hover_at(at);
    harness.step();
    for pressed in [true, false, true, false] {
        press(
            &mut harness,
            at,
            PointerButton::Primary,
            pressed,
            Modifiers::NONE,
        );
    }
    settle(&mut harness);
    assert!(canvas(&harness).camera().center.distance(point) < 1e-9);
    let shown = canvas(&harness).project(point).unwrap();
    assert!(shown.distance(middle(&harness)) < 0.1);
}

#[test]
fn the_edge_of_a_unit_cube_measures_one() {
    let mut harness = studio(cuboid(DVec3::ONE).mesh);
    let bounds = harness.state().shown.as_ref().unwrap().bounds();
    click(&mut harness, "Measure");
    // the upper edge in front, as the view from the corner of front, right and top shows it
    let ends = [
        DVec3::new(bounds.max.x, bounds.min.y, bounds.max.z),
        DVec3::new(bounds.min.x, bounds.min.y, bounds.max.z),
    ];
    for (end, inside) in ends.into_iter().zip([vec2(-3.0, -2.0), vec2(4.0, 0.0)]) {
        let at = canvas(&harness).project(end).unwrap() + inside;
        click_at(&mut harness, at);
    }
    let measured = canvas(&harness).measured().unwrap();
    assert_eq!((measured.from, measured.to), (ends[0], ends[1]));
    assert_eq!(measured.distance(), 1.0);
    assert_eq!(measured.delta(), DVec3::new(-1.0, 0.0, 0.0));
    // a little beside the mesh the corner still counts
    for end in ends {
        let at = canvas(&harness).project(end).unwrap() + vec2(-2.0, -4.0);
        click_at(&mut harness, at);
    }
    assert_eq!(canvas(&harness).measured(), Some(measured));
    // away from corners the point of the surface counts
    let at = canvas(&harness)
        .project(ends[0] - DVec3::new(0.4, -0.3, 0.0))
        .unwrap();
    click_at(&mut harness, at);
    click_at(&mut harness, at + vec2(0.0, 30.0));
    let measured = canvas(&harness).measured().unwrap();
    assert!((measured.from.z - bounds.max.z).abs() < 1e-9 && measured.distance() > 0.01);
    click(&mut harness, "Measure");
    assert_eq!(canvas(&harness).measured(), None);
}

#[test]
fn a_section_shows_less_of_the_front_and_its_cap_is_picked() {
    let mut harness = studio(cuboid(DVec3::ONE).mesh);
    click(&mut harness, "Parallel");
    click(&mut harness, "Iso");
    let front = count(&picture(&harness), is_bluish);
    let center = harness.state().shown.as_ref().unwrap().bounds().center();
    click(&mut harness, "Section");
    let cut = picture(&harness);
    let (less, cap) = (count(&cut, is_bluish), count(&cut, is_ocher));
    assert!(less < front && cap > 5000, "{front} {less} {cap}");
    let at = canvas(&harness)
        .project(center + DVec3::new(0.1, 0.0, 0.1))
        .unwrap();
    let picked = canvas(&harness).pick(at).unwrap();
    assert!(picked.on_cap && (picked.point.y - center.y).abs() < 1e-9);
    click(&mut harness, "Caps");
    assert_eq!(count(&picture(&harness), is_ocher), 0);
    click(&mut harness, "Flip");
    assert!(!canvas(&harness).options().section.flip);
    click(&mut harness, "Across Z");
    harness.state_mut().canvas.options_mut().section.position = Some(-100.0);
    settle(&mut harness);
    let nothing = picture(&harness);
    assert_eq!(count(&nothing, |pixel| pixel != nothing.pixels[0]), 0);
}

#[test]
fn controls_change_the_picture_and_come_back() {
    let mut harness = studio(torus(2.0, 0.7, 60, 30).mesh);
    let first = picture(&harness);
    for label in [
        "Shaded",
        "Smooth",
        "All edges",
        "Feature edges",
        "Section",
        "Parallel",
        "Y is up",
    ] {
        click(&mut harness, label);
        assert_ne!(picture(&harness).pixels, first.pixels, "{label}");
        let back = if label == "Parallel" {
            "Perspective"
        } else {
            label
        };
        click(&mut harness, back);
        assert_eq!(picture(&harness).pixels, first.pixels, "{label}");
    }
    for (label, view) in [
        ("Front", View::FRONT),
        ("Bottom", View::BOTTOM),
        ("Left", View::LEFT),
    ] {
        click(&mut harness, label);
        assert_eq!(canvas(&harness).camera().view, view);
    }
}

#[test]
fn keys_turn_move_and_zoom_and_show_everything() {
    let mut harness = studio(torus(2.0, 0.7, 60, 30).mesh);
    let at = middle(&harness);
    click_at(&mut harness, at);
    let first = *canvas(&harness).camera();
    harness.key_press(Key::ArrowRight);
    settle(&mut harness);
    let turned = first.view.azimuth_deg - canvas(&harness).camera().view.azimuth_deg;
    assert!((turned - 15.0).abs() < 0.01, "{turned}");
    harness.key_press_modifiers(Modifiers::SHIFT, Key::ArrowUp);
    settle(&mut harness);
    let center = canvas(&harness).project(first.center).unwrap();
    assert!((center - at - vec2(0.0, -37.5)).length() < 0.1);
    harness.key_press(Key::Plus);
    settle(&mut harness);
    assert!((first.span / canvas(&harness).camera().span - 1.25).abs() < 1e-9);
    harness.key_press(Key::F);
    settle(&mut harness);
    let last = canvas(&harness).camera();
    assert!(last.center.distance(first.center) < 1e-12 && last.span > 0.9 * first.span);
}

#[test]
fn values_marks_and_ghosts_are_shown() {
    let mesh = torus(2.0, 0.7, 60, 30).mesh;
    let heights = mesh.positions().iter().map(|at| at.z).collect();
    let values = VertexValues {
        title: "Height (mm)".to_owned(),
        values: heights,
        map: ColorMap::Sequential,
        range: None,
    };
    let top = mesh.bounds().max;
    let marked = vec![
        MarkedPlace::Triangle(7),
        MarkedPlace::Edge(mesh.triangles()[900][..2].try_into().unwrap()),
        MarkedPlace::Point(top),
        MarkedPlace::Segment([top, DVec3::ZERO]),
        // what the mesh does not have
        MarkedPlace::Triangle(u32::MAX),
        MarkedPlace::Edge([u32::MAX, 0]),
    ];
    let plain = studio(mesh.clone());
    let mut harness = window(
        Some(shown(mesh.clone()).with_values(values.clone())),
        vec2(900.0, 600.0),
        1.0,
    );
    let colored = picture(&harness);
    let yellow = |pixel: Color32| pixel.r() > 200 && pixel.g() > 180 && pixel.b() < 90;
    assert_eq!(count(&picture(&plain), yellow), 0);
    assert!(count(&colored, yellow) > 500);
    click(&mut harness, "Colors");
    assert_eq!(picture(&harness).pixels, picture(&plain).pixels);
    harness.state_mut().shown = Some(Arc::new(shown(mesh.clone()).with_marked(marked)));
    settle(&mut harness);
    let red = count(&picture(&harness), is_red);
    assert!(red > 20, "{red}");
    click(&mut harness, "Defects");
    assert_eq!(picture(&harness).pixels, picture(&plain).pixels);
    // a ghost within the bounds of the mesh, so that the view stays
    harness.state_mut().ghost = Some(Arc::new(shown(cuboid(DVec3::splat(1.3)).mesh)));
    settle(&mut harness);
    assert_ne!(picture(&harness).pixels, picture(&plain).pixels);
    click(&mut harness, "Ghost");
    assert_eq!(picture(&harness).pixels, picture(&plain).pixels);
}

#[test]
fn a_wrong_number_of_values_is_said_and_nothing_hangs() {
    let values = VertexValues {
        title: "Too few".to_owned(),
        values: vec![1.0],
        map: ColorMap::Diverging,
        range: Some([-1.0, 1.0]),
    };
    let mut harness = window(
        Some(shown(cuboid(DVec3::ONE).mesh).with_values(values)),
        vec2(900.0, 600.0),
        1.0,
    );
    assert!(canvas(&harness).picture().is_none() && !canvas(&harness).is_busy());
    click(&mut harness, "Colors");
    assert!(canvas(&harness).picture().is_some());
}

#[test]
fn flying_to_a_place_shows_it_large() {
    let mut harness = studio(torus(2.0, 0.7, 60, 30).mesh);
    let place = DVec3::new(2.0, 0.0, 0.7);
    for radius in [0.1, 0.0, f64::NAN] {
        harness.state_mut().canvas.fly_to(place, radius);
        settle(&mut harness);
        let camera = canvas(&harness).camera();
        assert_eq!(camera.center, place);
        assert!(camera.span > 0.0 && camera.span < 2.0, "{}", camera.span);
    }
    let before = *canvas(&harness).camera();
    harness.state_mut().canvas.fly_to(DVec3::NAN, 1.0);
    settle(&mut harness);
    assert_eq!(*canvas(&harness).camera(), before);
}

#[test]
fn odd_meshes_and_sizes_are_shown() {
    let empty = TriMesh::new(vec![DVec3::ZERO], vec![]).unwrap();
    let one = TriMesh::new(vec![DVec3::ZERO, DVec3::X, DVec3::Y], vec![[0, 1, 2]]).unwrap();
    let line = TriMesh::new(vec![DVec3::ZERO, DVec3::X, 2.0 * DVec3::X], vec![[0, 1, 2]]).unwrap();
    let point = TriMesh::new(vec![DVec3::ONE; 3], vec![[0, 1, 2]]).unwrap();
    let huge = cuboid(DVec3::splat(1e150)).mesh;
    let tiny = cuboid(DVec3::splat(1e-150)).mesh;
    for mesh in [empty, one, line, point, huge, tiny] {
        let mesh = Arc::new(mesh);
        for (size, pixels_per_point) in [
            (vec2(700.0, 400.0), 1.0),
            (vec2(700.0, 400.0), 2.5),
            (vec2(1.0, 1.0), 1.0),
            (vec2(500.0, 3.0), 1.0),
        ] {
            let shown = ShownMesh::new(mesh.clone());
            let mut harness = Harness::builder()
                .with_size(size)
                .with_pixels_per_point(pixels_per_point)
                .build_ui_state(
                    |ui, window: &mut Window| {
                        let (shown, ghost) = (window.shown.clone(), window.ghost.clone());
                        window.canvas.ui(ui, shown.as_ref(), ghost.as_ref());
                    },
                    Window {
                        canvas: MeshCanvas::new(Arc::new(|| {}), None),
                        shown: Some(Arc::new(shown)),
                        ghost: None,
                    },
                );
            let start = Instant::now();
            harness.step();
            while harness.state().canvas.is_busy() {
                harness.step();
                std::thread::sleep(Duration::from_millis(2));
                assert!(start.elapsed() < HANG, "the canvas hangs");
            }
            let at = Pos2::ZERO + 0.5 * size;
            harness.hover_at(at);
            harness.drag_at(at);
            harness.step();
            harness.hover_at(at + vec2(40.0, 9.0));
            harness.step();
            harness.drop_at(at + vec2(40.0, 9.0));
            harness.step();
            let camera = harness.state().canvas.camera();
            assert!(camera.center.is_finite() && camera.span > 0.0);
        }
    }
}

#[test]
fn nothing_to_show_is_shown_as_nothing_and_the_next_mesh_anew() {
    let mut harness = window(None, vec2(900.0, 600.0), 1.0);
    assert!(canvas(&harness).picture().is_none() && !canvas(&harness).is_busy());
    assert!(canvas(&harness).pick(middle(&harness)).is_none());
    harness.state_mut().shown = Some(Arc::new(shown(cuboid(DVec3::ONE).mesh)));
    settle(&mut harness);
    assert!(canvas(&harness).picture().is_some());
    harness.state_mut().shown = None;
    settle(&mut harness);
    assert!(canvas(&harness).picture().is_none() && canvas(&harness).view().is_none());
    harness.state_mut().shown = Some(Arc::new(shown(torus(20.0, 7.0, 30, 20).mesh)));
    settle(&mut harness);
    assert!(canvas(&harness).camera().span > 20.0, "fit to the new mesh");
}

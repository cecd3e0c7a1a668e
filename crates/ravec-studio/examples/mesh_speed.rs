//! Prints the rate of pictures while a hand turns a mesh of a million triangles, and the time to the fine picture at rest.
//!
//! `cargo run --release -p ravec-studio --example mesh_speed`

#![expect(clippy::print_stdout, reason = "prints its measurements")]

use egui::{Event, Modifiers, PointerButton, Pos2, vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable as _;
use ravec_scenes::solids::torus;
use ravec_studio::mesh::{MeshCanvas, ShownMesh};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Segments around the ring and around its tube: two triangles each.
const SIDE: u32 = 708;

/// Duration of a round of turning.
const ROUND: Duration = Duration::from_secs(4);

/// Pause between frames of the window.
const PAUSE: Duration = Duration::from_millis(16);

type Window = Harness<'static, MeshCanvas>;

fn main() {
    let mesh = torus(2.0, 0.7, SIDE, SIDE).mesh;
    println!("{} triangles", mesh.triangles().len());
    let shown = Arc::new(ShownMesh::new(Arc::new(mesh)));
    let mut window = Harness::builder()
        .with_size(vec2(1500.0, 1000.0))
        .build_ui_state(
            move |ui, canvas: &mut MeshCanvas| {
                canvas.ui(ui, Some(&shown), None);
            },
            MeshCanvas::new(Arc::new(|| {})),
        );
    rest(&mut window);
    let at = window.get_by_label("Mesh canvas").rect().center();
    window.hover_at(at);
    window.step();
    press(&mut window, at, true);
    for round in 1..=3 {
        turn(&mut window, at, round);
    }
    let start = Instant::now();
    press(&mut window, at, false);
    rest(&mut window);
    println!("fine picture after {:?}", start.elapsed());
}

/// Lets the window run until its picture is the last one.
fn rest(window: &mut Window) {
    window.step();
    while window.state().is_busy() {
        std::thread::sleep(Duration::from_millis(2));
        window.step();
    }
}

fn press(window: &mut Window, pos: Pos2, pressed: bool) {
    window.event(Event::PointerButton {
        pos,
        button: PointerButton::Primary,
        pressed,
        modifiers: Modifiers::NONE,
    });
    window.step();
}

/// Turns the mesh for a round, and prints the rate of pictures and the longest frame of the window's thread.
fn turn(window: &mut Window, at: Pos2, round: u32) {
    let (start, before) = (Instant::now(), window.state().pictures());
    let mut longest = Duration::ZERO;
    while start.elapsed() < ROUND {
        let angle = 100.0 * start.elapsed().as_secs_f32();
        window.event(Event::PointerMoved(at + vec2(angle, 0.3 * angle)));
        let frame = Instant::now();
        window.step();
        longest = longest.max(frame.elapsed());
        std::thread::sleep(PAUSE);
    }
    let pictures = window.state().pictures() - before;
    let rate = pictures as f64 / start.elapsed().as_secs_f64();
    println!("round {round}: {rate:.1} pictures a second, longest frame {longest:?}");
}

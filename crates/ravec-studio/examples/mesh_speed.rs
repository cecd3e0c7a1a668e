//! Prints the rate of pictures while a hand turns a mesh of a million triangles, and the time to the fine picture at rest: by the
//! CPU, or by the adapter whose name contains the argument, whose frames are copied back to memory.
//!
//! `cargo run --release -p ravec-studio --example mesh_speed [ADAPTER]`

#![expect(clippy::print_stdout, reason = "prints its measurements")]

use eframe::egui_wgpu::{RenderState, RendererOptions, WgpuSetup, WgpuSetupCreateNew};
use egui::{Event, Modifiers, PointerButton, Pos2, vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable as _;
use egui_kittest::wgpu::{WgpuTestRenderer, create_render_state};
use ravec_scenes::solids::torus;
use ravec_studio::mesh::{MeshCanvas, MeshGpu, ShownMesh};
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
    let state = std::env::args().nth(1).map(adapter);
    let gpu = state.as_ref().and_then(MeshGpu::new);
    let mut builder = Harness::builder().with_size(vec2(1500.0, 1000.0));
    if let Some(state) = state {
        println!("{:?}", state.adapter.get_info());
        builder = builder.renderer(WgpuTestRenderer::from_render_state(state));
    }
    let mut window = builder.build_ui_state(
        move |ui, canvas: &mut MeshCanvas| {
            canvas.ui(ui, Some(&shown), None);
        },
        MeshCanvas::new(Arc::new(|| {}), gpu),
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

/// A device of the first adapter whose name contains a text, in any case.
fn adapter(name: String) -> RenderState {
    let mut setup = WgpuSetupCreateNew::without_display_handle();
    setup.native_adapter_selector = Some(Arc::new(move |adapters, _| {
        let is_named =
            |name: &str, found: String| found.to_lowercase().contains(&name.to_lowercase());
        let mut adapters = adapters.iter();
        let found = adapters.find(|adapter| is_named(&name, adapter.get_info().name));
        found
            .cloned()
            .ok_or_else(|| format!("no adapter has {name} in its name"))
    }));
    create_render_state(WgpuSetup::CreateNew(setup), RendererOptions::default())
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
    let mut by_gpu = 0;
    let mut longest = Duration::ZERO;
    while start.elapsed() < ROUND {
        let angle = 100.0 * start.elapsed().as_secs_f32();
        window.event(Event::PointerMoved(at + vec2(angle, 0.3 * angle)));
        let frame = Instant::now();
        window.step();
        longest = longest.max(frame.elapsed());
        if window.state().is_drawn_by_gpu() {
            // an adapter is there, and pictures come back
            let _ = window.render();
            by_gpu += 1;
        } else {
            std::thread::sleep(PAUSE);
        }
    }
    let pictures = window.state().pictures() - before + by_gpu;
    let rate = pictures as f64 / start.elapsed().as_secs_f64();
    println!("round {round}: {rate:.1} pictures a second, longest frame {longest:?}");
}

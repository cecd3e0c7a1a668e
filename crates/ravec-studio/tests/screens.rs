//! The window as it is seen, drawn by the software driver for Vulkan (Debian's mesa-vulkan-drivers): the main screens against
//! pictures in `tests/screens`, and meshes that the GPU draws against those of the CPU. Without the driver nothing is tested,
//! and a line says so.
//!
//! `RAVEC_UPDATE_SCREENS=1` writes the pictures again. A screen that differs is written into the folder of temporary files.

#![allow(
    clippy::disallowed_methods,
    reason = "tests may write files as they like"
)]

mod common;
#[path = "common/desk.rs"]
mod desk;

use desk::{click, drag, on_screen, settle};
use eframe::egui_wgpu::{RenderState, RendererOptions};
use egui::{Event, Modifiers, PointerButton, Pos2, Vec2, vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable as _;
use egui_kittest::wgpu::{WgpuTestRenderer, create_render_state, default_wgpu_setup};
use ravec::raster::{AnyImage, Image, Size, Srgb};
use ravec_media::{Limits, Picture, WriteOptions};
use ravec_scenes::solids::torus;
use ravec_studio::Studio;
use ravec_studio::mesh::{MeshCanvas, MeshGpu, ShownMesh};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// A bound on the time that background work may take, far beyond what it takes.
const HANG: Duration = Duration::from_mins(2);

/// Largest difference of a channel that is not seen, of 255.
const SEEN: u8 = 32;

/// Largest share of the pixels of a screen that may look different.
const MAX_SHARE: f64 = 2e-4;

/// Time in which a screen comes to what it is to be.
const PATIENCE: Duration = Duration::from_secs(30);

/// One after the other: the driver takes all cores.
fn lock() -> MutexGuard<'static, ()> {
    static LOCK: Mutex<()> = Mutex::new(());
    LOCK.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The software driver, as a window would have it.
fn software() -> Option<RenderState> {
    use eframe::wgpu;
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle());
    let found = instance.enumerate_adapters(wgpu::Backends::VULKAN);
    let found = pollster::block_on(found);
    let is_software =
        |adapter: &wgpu::Adapter| adapter.get_info().device_type == wgpu::DeviceType::Cpu;
    if !found.iter().any(is_software) {
        eprintln!("SKIPPED: no software driver for Vulkan; install mesa-vulkan-drivers");
        return None;
    }
    let setup = default_wgpu_setup();
    Some(create_render_state(setup, RendererOptions::PREDICTABLE))
}

type Pixels = Image<Srgb<u8>>;

fn pixels<S>(harness: &mut Harness<'_, S>) -> Pixels {
    let image = harness.render().unwrap();
    let size = Size::new(image.width() as usize, image.height() as usize).unwrap();
    let bytes = image.as_raw();
    Image::from_fn(size, |col, row| {
        let at = 4 * (row * size.width() + col);
        Srgb([bytes[at], bytes[at + 1], bytes[at + 2]])
    })
}

/// The share of pixels that look different.
fn difference(a: &Pixels, b: &Pixels) -> f64 {
    assert_eq!(a.size(), b.size());
    let pairs = a.pixels().iter().zip(b.pixels());
    let seen = pairs.filter(|(a, b)| (0..3).any(|k| a.0[k].abs_diff(b.0[k]) > SEEN));
    seen.count() as f64 / a.pixels().len() as f64
}

fn write(path: &Path, image: Pixels) {
    let picture = Picture::from_image(AnyImage::from(image));
    ravec_media::write(path, &picture, &WriteOptions::default()).unwrap();
}

/// `true` if the window looks like the picture of this name; else it is written beside other temporary files.
fn looks_like(name: &str, harness: &mut Harness<'_, Studio>) -> bool {
    // tooltips and highlights below the cursor are no part of a screen
    harness.hover_at(Pos2::new(1.0, 1.0));
    settle(harness);
    let mut found = pixels(harness);
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/screens");
    let path = folder.join(format!("{name}.png"));
    if std::env::var_os("RAVEC_UPDATE_SCREENS").is_some() {
        write(&path, found);
        return true;
    }
    let known = ravec_media::read(&path, &Limits::default()).unwrap();
    let AnyImage::Srgb8(known) = known.image else {
        panic!("{name} is not in RGB");
    };
    let mut share = difference(&found, &known);
    let start = Instant::now();
    // thumbnails come when they come
    while share > MAX_SHARE && start.elapsed() < PATIENCE {
        std::thread::sleep(Duration::from_millis(50));
        settle(harness);
        found = pixels(harness);
        share = difference(&found, &known);
    }
    if share > MAX_SHARE {
        let kept = std::env::temp_dir().join(format!("ravec-screen-{name}.png"));
        eprintln!("{share} of {name} differ: see {}", kept.display());
        write(&kept, found);
    }
    share <= MAX_SHARE
}

fn photo(folder: &Path) -> PathBuf {
    let image: Pixels = Image::from_fn(Size::new(320, 240).unwrap(), |col, row| {
        let disc = (col as f64 - 120.0).hypot(row as f64 - 100.0) < 60.0;
        let stripe = (col + 2 * row) / 24 % 2 == 0;
        Srgb(match (disc, stripe) {
            (true, _) => [220, 120, 60],
            (_, true) => [40, 60 + (row / 2) as u8, 110],
            (_, false) => [60, 90 + (row / 2) as u8, 90],
        })
    });
    let path = folder.join("photo.png");
    write(&path, image);
    path
}

fn mesh(folder: &Path) -> PathBuf {
    let mesh = torus(2.0, 0.7, 40, 20).mesh;
    let path = folder.join("ring.off");
    let (positions, triangles) = (mesh.positions(), mesh.triangles());
    let mut lines = vec![format!("OFF\n{} {} 0", positions.len(), triangles.len())];
    lines.extend(
        positions
            .iter()
            .map(|at| format!("{} {} {}", at.x, at.y, at.z)),
    );
    lines.extend(triangles.iter().map(|[a, b, c]| format!("3 {a} {b} {c}")));
    std::fs::write(&path, lines.join("\n")).unwrap();
    path
}

fn clip(folder: &Path) -> PathBuf {
    let shot = folder.join("shot");
    std::fs::create_dir(&shot).unwrap();
    for frame in 0..12 {
        let image: Pixels = Image::from_fn(Size::new(160, 120).unwrap(), |col, row| {
            let disc = (col as f64 - 20.0 - 8.0 * f64::from(frame)).hypot(row as f64 - 60.0) < 20.0;
            Srgb(if disc {
                [220, 120, 60]
            } else {
                [50, 70 + row as u8, 120]
            })
        });
        write(&shot.join(format!("f_{frame:04}.png")), image);
    }
    shot
}

fn studio(state: RenderState, file: Option<PathBuf>) -> Harness<'static, Studio> {
    let mut harness = Harness::builder()
        .with_size(Vec2::new(1000.0, 700.0))
        .renderer(WgpuTestRenderer::from_render_state(state))
        .build_eframe(move |context| {
            let mut studio = Studio::new(&context.egui_ctx, None);
            if let Some(file) = file {
                studio.open(&file);
            }
            studio
        });
    settle(&mut harness);
    harness
}

#[test]
fn the_main_screens_look_as_they_did() {
    let _lock = lock();
    if software().is_none() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let open = |file| studio(software().unwrap(), file);
    assert!(looks_like("start", &mut open(None)));

    let mut harness = open(Some(photo(folder.path())));
    click(&mut harness, "Brush");
    let way = [(60.0, 100.0), (120.0, 60.0), (200.0, 110.0)];
    let way = way.map(|(x, y)| on_screen(&harness, x, y));
    drag(&mut harness, &way);
    assert!(looks_like("brush", &mut harness));

    let mut harness = open(Some(photo(folder.path())));
    click(&mut harness, "Retarget");
    let (from, to) = (
        on_screen(&harness, 320.0, 120.0),
        on_screen(&harness, 220.0, 120.0),
    );
    drag(&mut harness, &[from, from.lerp(to, 0.5), to]);
    assert!(looks_like("retarget", &mut harness));

    let mut harness = open(Some(mesh(folder.path())));
    click(&mut harness, "Offset");
    assert!(looks_like("offset", &mut harness));

    let mut harness = open(Some(clip(folder.path())));
    assert!(looks_like("clip", &mut harness));
}

struct Window {
    canvas: MeshCanvas,
    shown: Arc<ShownMesh>,
    ghost: Option<Arc<ShownMesh>>,
}

fn canvas(state: RenderState, ghost: bool) -> Harness<'static, Window> {
    let shown = |radius| ShownMesh::new(Arc::new(torus(2.0, radius, 60, 30).mesh));
    let gpu = MeshGpu::new(&state);
    assert!(gpu.is_some());
    let window = Window {
        canvas: MeshCanvas::new(Arc::new(|| {}), gpu),
        shown: Arc::new(shown(0.7)),
        ghost: ghost.then(|| Arc::new(shown(0.9))),
    };
    Harness::builder()
        .with_size(vec2(500.0, 400.0))
        .with_step_dt(1.0 / 60.0)
        .renderer(WgpuTestRenderer::from_render_state(state))
        .build_ui_state(
            |ui, window: &mut Window| {
                egui::CentralPanel::no_frame().show(ui, |ui| {
                    let (shown, ghost) = (window.shown.clone(), window.ghost.clone());
                    window.canvas.ui(ui, Some(&shown), ghost.as_ref());
                });
            },
            window,
        )
}

/// Lets the window run until its picture is the last one.
fn settle_canvas(harness: &mut Harness<'_, Window>) {
    let start = Instant::now();
    let mut quiet = 0;
    while quiet < 3 {
        harness.step();
        if harness.state().canvas.is_busy() {
            quiet = 0;
            std::thread::sleep(Duration::from_millis(2));
        } else {
            quiet += 1;
        }
        assert!(start.elapsed() < HANG, "the canvas hangs");
    }
}

/// Moves the cursor with the button down until the GPU draws; it does once the mesh is copied there.
fn turn_until_gpu(harness: &mut Harness<'_, Window>, from: Pos2) -> Pos2 {
    let start = Instant::now();
    let mut at = from;
    loop {
        at.x += 2.0;
        harness.event(Event::PointerMoved(at));
        harness.step();
        if harness.state().canvas.is_drawn_by_gpu() {
            return at;
        }
        std::thread::sleep(Duration::from_millis(2));
        assert!(start.elapsed() < HANG, "the mesh never reaches the GPU");
        // to and fro, so that the cursor stays in the window
        at.x = if at.x > 480.0 { from.x } else { at.x };
    }
}

#[test]
fn the_gpu_draws_a_mesh_that_is_turned_as_the_cpu_draws_it_at_rest() {
    let _lock = lock();
    for ghost in [false, true] {
        let Some(state) = software() else { return };
        let mut harness = canvas(state, ghost);
        settle_canvas(&mut harness);
        assert!(!harness.state().canvas.is_drawn_by_gpu());
        let middle = harness.get_by_label("Mesh canvas").rect().center();
        harness.hover_at(middle);
        harness.step();
        let button = |pos, pressed| Event::PointerButton {
            pos,
            button: PointerButton::Primary,
            pressed,
            modifiers: Modifiers::NONE,
        };
        harness.event(button(middle, true));
        harness.step();
        let at = turn_until_gpu(&mut harness, middle);
        let moving = pixels(&mut harness);
        assert!(harness.state().canvas.is_drawn_by_gpu());
        harness.event(button(at, false));
        settle_canvas(&mut harness);
        assert!(!harness.state().canvas.is_drawn_by_gpu());
        let resting = pixels(&mut harness);
        let share = difference(&moving, &resting);
        assert!(share < 0.01, "{share}");
        // and it is no empty window
        let background = resting.pixels()[0];
        let ring = resting
            .pixels()
            .iter()
            .filter(|pixel| **pixel != background);
        assert!(ring.count() > resting.pixels().len() / 10);
    }
}

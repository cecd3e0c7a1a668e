//! Pictures of meshes, made beside the window.
//!
//! A draft is made for each movement, and a fine picture when the hand rests. A new draft stops a fine picture that is being
//! made, but no draft of the same mesh: while the hand moves without a pause, drafts appear one after the other. Drafts are as
//! coarse as the last ones took time. Where the window has a GPU, meshes are copied to it after their first draft, and the window
//! draws them itself while the hand moves.
//!
//! Guarantees: no call waits for the thread; pictures come in the order of requests.

use super::gpu::{Layer, MeshGpu};
use super::{MarkedPlace, ShownMesh};
use egui::{Color32, ColorImage};
use ravec::mesh::TriMesh;
use ravec::mesh_render::gpu::GpuMesh;
use ravec::mesh_render::{
    Camera, FeatureLines, Legend, LineStyle, MarkedEdges, Paint, PreparedMesh, RenderError,
    RenderParams, Rendering, Rgb8, Section, Values,
};
use ravec::progress::Progress;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Longest side of a picture in pixels: more than any screen has.
const MAX_SIDE: u32 = 8192;

/// Meshes of which the parts that do not depend on the view are kept.
const KEPT: usize = 3;

/// Drafts that take longer become coarser, so that ten appear in a second.
const DRAFT_TIME: Duration = Duration::from_millis(80);

/// Triangles from which the first drafts have a quarter of the pixels: a tenth of a second at all of them.
const MANY_TRIANGLES: usize = 400_000;

/// The cover of the ghost.
const GHOST_ALPHA: f32 = 0.3;

const GHOST_COLOR: Rgb8 = [96, 150, 214];
const MARK_COLOR: Rgb8 = [226, 32, 44];

/// Everything that a picture depends on.
#[derive(Debug, Clone)]
pub(super) struct Wanted {
    pub shown: Arc<ShownMesh>,
    pub ghost: Option<Arc<ShownMesh>>,
    pub camera: Camera,
    /// Pixels of the screen.
    pub size: [u32; 2],
    pub style: Style,
}

/// The look of a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
#[expect(clippy::struct_excessive_bools, reason = "each is a switch of its own")]
pub(super) struct Style {
    pub background: Rgb8,
    pub shaded: bool,
    pub smooth: bool,
    pub all_edges: bool,
    /// Angle of feature edges in degrees.
    pub features: Option<f64>,
    pub colors: bool,
    pub marks: bool,
    pub section: Option<Section>,
    /// Pixels of a line that is one point wide.
    pub pixels_per_point: f32,
}

impl PartialEq for Wanted {
    fn eq(&self, other: &Self) -> bool {
        let ghosts = match (&self.ghost, &other.ghost) {
            (Some(a), Some(b)) => Arc::ptr_eq(a, b),
            (None, None) => true,
            _ => false,
        };
        Arc::ptr_eq(&self.shown, &other.shown)
            && ghosts
            && self.camera == other.camera
            && self.size == other.size
            && self.style == other.style
    }
}

/// Fineness of a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Quality {
    samples: u32,
    /// Pixels of the screen for each pixel of the picture, along each side.
    divisor: u32,
    lines: bool,
}

const FINE: Quality = Quality {
    samples: 2,
    divisor: 1,
    lines: true,
};

/// Drafts from the finest to the coarsest.
const DRAFTS: [Quality; 5] = [
    Quality {
        samples: 1,
        divisor: 1,
        lines: true,
    },
    Quality {
        samples: 1,
        divisor: 2,
        lines: true,
    },
    Quality {
        samples: 1,
        divisor: 2,
        lines: false,
    },
    Quality {
        samples: 1,
        divisor: 3,
        lines: false,
    },
    Quality {
        samples: 1,
        divisor: 4,
        lines: false,
    },
];

/// A picture of the canvas.
#[derive(Clone)]
pub(super) struct Drawn {
    pub wanted: Wanted,
    /// `true` if the picture is as fine as it becomes.
    pub fine: bool,
    /// The number of pictures up to this one.
    pub serial: u64,
    /// Number of the last request when it was begun.
    pub request: u64,
    pub image: Arc<ColorImage>,
    pub legend: Option<Legend>,
}

#[derive(Default)]
struct State {
    draft: Option<Wanted>,
    fine: Option<Wanted>,
    running: Option<Running>,
    drawn: Option<Drawn>,
    failure: Option<(Wanted, String)>,
    /// Meshes on the GPU, the last ones at the end.
    uploaded: Vec<Uploaded>,
    /// Number of requests for drafts.
    requests: u64,
    pictures: u64,
    quits: bool,
}

/// A mesh that was copied to the GPU.
struct Uploaded {
    shown: Arc<ShownMesh>,
    look: Look,
    /// `None` if the GPU has refused it.
    mesh: Option<Arc<GpuMesh>>,
}

/// The part of the look that is copied along with a mesh.
#[derive(Clone, Copy, PartialEq)]
struct Look {
    has_colors: bool,
    is_ghost: bool,
}

impl Uploaded {
    fn is_of(&self, shown: &Arc<ShownMesh>, look: Look) -> bool {
        Arc::ptr_eq(&self.shown, shown) && self.look == look
    }
}

impl Wanted {
    /// The mesh and its ghost, with their looks.
    fn meshes(&self) -> impl Iterator<Item = (&Arc<ShownMesh>, Look)> {
        let mesh = Look {
            has_colors: self.style.colors && self.shown.values.is_some(),
            is_ghost: false,
        };
        let ghost = Look {
            has_colors: false,
            is_ghost: true,
        };
        let ghosts = self.ghost.iter().map(move |shown| (shown, ghost));
        std::iter::once((&self.shown, mesh)).chain(ghosts)
    }
}

struct Running {
    wanted: Wanted,
    fine: bool,
    progress: Progress,
}

struct Shared {
    state: Mutex<State>,
    wake: Condvar,
    repaint: Arc<dyn Fn() + Send + Sync>,
}

impl Shared {
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Makes pictures on a thread of its own.
pub(super) struct Renderer {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

impl Renderer {
    /// `repaint` is called, from another thread, when there is something new.
    pub fn new(repaint: Arc<dyn Fn() + Send + Sync>, gpu: Option<MeshGpu>) -> Self {
        let shared = Arc::new(Shared {
            state: Mutex::default(),
            wake: Condvar::new(),
            repaint,
        });
        let own = shared.clone();
        let thread = std::thread::Builder::new().name("mesh renderer".to_owned());
        Self {
            shared,
            // without a thread nothing is drawn, and the window still works
            thread: thread.spawn(move || work(&own, gpu.as_ref())).ok(),
        }
    }

    /// Asks for a coarse picture at once, in place of all other requests.
    pub fn request_draft(&self, wanted: Wanted) {
        let mut state = self.shared.state();
        if let Some(running) = &state.running
            && (running.fine || !Arc::ptr_eq(&running.wanted.shown.mesh, &wanted.shown.mesh))
        {
            running.progress.cancel();
        }
        state.fine = None;
        state.requests += 1;
        state.draft = Some(wanted);
        self.shared.wake.notify_all();
    }

    /// Asks for a fine picture after the drafts that were asked for.
    pub fn request_fine(&self, wanted: Wanted) {
        let mut state = self.shared.state();
        if let Some(running) = &state.running
            && running.fine
        {
            if running.wanted == wanted {
                return;
            }
            running.progress.cancel();
        }
        state.fine = Some(wanted);
        self.shared.wake.notify_all();
    }

    /// What the GPU draws in place of a draft: the mesh and its ghost. `None` until both are copied there, and if it has refused
    /// one of them.
    pub fn layers(&self, wanted: &Wanted) -> Option<Vec<Layer>> {
        let state = self.shared.state();
        let mut layers = Vec::new();
        for (shown, look) in wanted.meshes() {
            let known = state.uploaded.iter().find(|known| known.is_of(shown, look));
            let params = params(wanted, FINE, Some(Vec::new()));
            layers.push(Layer {
                mesh: known?.mesh.clone()?,
                params: if look.is_ghost {
                    ghost_params(&params)
                } else {
                    params
                },
                opacity: if look.is_ghost { GHOST_ALPHA } else { 1.0 },
            });
        }
        Some(layers)
    }

    /// Stops a fine picture, in place of which the GPU draws. Returns the number of the request.
    pub fn request_gpu(&self) -> u64 {
        let mut state = self.shared.state();
        if let Some(running) = &state.running
            && running.fine
        {
            running.progress.cancel();
        }
        state.fine = None;
        state.requests += 1;
        state.requests
    }

    /// Stops everything.
    pub fn stop(&self) {
        let mut state = self.shared.state();
        (state.draft, state.fine) = (None, None);
        if let Some(running) = &state.running {
            running.progress.cancel();
        }
    }

    /// The last picture.
    pub fn drawn(&self) -> Option<Drawn> {
        self.shared.state().drawn.clone()
    }

    /// One sentence, if there is no picture of what is wanted and never will be.
    pub fn failure(&self, wanted: &Wanted) -> Option<String> {
        let state = self.shared.state();
        let (failed, message) = state.failure.as_ref()?;
        (failed == wanted).then(|| message.clone())
    }

    /// Number of the last request for a draft.
    pub fn requests(&self) -> u64 {
        self.shared.state().requests
    }

    /// Number of pictures that were made.
    pub fn pictures(&self) -> u64 {
        self.shared.state().pictures
    }
}

impl Drop for Renderer {
    fn drop(&mut self) {
        self.shared.state().quits = true;
        self.stop();
        self.shared.wake.notify_all();
        if let Some(thread) = self.thread.take() {
            // a panic of the thread was reported where it happened
            let _ = thread.join();
        }
    }
}

/// Takes requests until the renderer is dropped.
fn work(shared: &Shared, gpu: Option<&MeshGpu>) {
    let mut meshes = Meshes::default();
    let mut pace = Pace::default();
    loop {
        let (wanted, fine, request, progress) = {
            let mut state = shared.state();
            while state.draft.is_none() && state.fine.is_none() && !state.quits {
                let waited = shared.wake.wait(state);
                state = waited.unwrap_or_else(PoisonError::into_inner);
            }
            if state.quits {
                return;
            }
            let (wanted, fine) = match state.draft.take() {
                Some(wanted) => (wanted, false),
                None => match state.fine.take() {
                    Some(wanted) => (wanted, true),
                    None => continue,
                },
            };
            let progress = Progress::new(|_| {});
            state.running = Some(Running {
                wanted: wanted.clone(),
                fine,
                progress: progress.clone(),
            });
            (wanted, fine, state.requests, progress)
        };
        let quality = if fine {
            FINE
        } else {
            pace.quality(&wanted.shown.mesh)
        };
        let start = Instant::now();
        let outcome = draw(&mut meshes, &wanted, quality, &progress);
        if fine {
            pace.rest();
        } else if outcome.is_ok() {
            pace.record(start.elapsed());
        }
        let uploads = outcome.is_ok();
        let copied = wanted.clone();
        let mut state = shared.state();
        match outcome {
            Ok((image, legend)) => {
                state.pictures += 1;
                state.drawn = Some(Drawn {
                    wanted,
                    fine,
                    serial: state.pictures,
                    request,
                    image: Arc::new(image),
                    legend,
                });
                state.failure = None;
            }
            Err(RenderError::Cancelled(_)) => {}
            Err(error) => state.failure = Some((wanted, error.to_string())),
        }
        drop(state);
        (shared.repaint)();
        if let Some(gpu) = gpu
            && uploads
            // a cancelled copy is made after the next picture
            && upload(shared, gpu, &mut meshes, &copied, &progress).is_ok_and(|is_new| is_new)
        {
            (shared.repaint)();
        }
        shared.state().running = None;
    }
}

/// Copies to the GPU what is not there yet. Returns `true` if it copied something.
fn upload(
    shared: &Shared,
    gpu: &MeshGpu,
    meshes: &mut Meshes,
    wanted: &Wanted,
    progress: &Progress,
) -> Result<bool, RenderError> {
    let mut is_new = false;
    for (shown, look) in wanted.meshes() {
        let is_known = |known: &Uploaded| known.is_of(shown, look);
        if shared.state().uploaded.iter().any(is_known) {
            continue;
        }
        let prepared = meshes.prepared(&shown.mesh);
        let mesh = gpu.upload(prepared, wanted, look.is_ghost, progress)?;
        let mut state = shared.state();
        if state.uploaded.len() == KEPT {
            state.uploaded.remove(0);
        }
        state.uploaded.push(Uploaded {
            shown: shown.clone(),
            look,
            mesh,
        });
        is_new = true;
    }
    Ok(is_new)
}

/// Coarseness of drafts, by the time that they took.
#[derive(Default)]
struct Pace {
    level: usize,
    mesh: Option<Arc<TriMesh>>,
    /// The coarsest level that took too long since the hand last rested: drafts that change to and fro would flicker.
    slow: Option<usize>,
    /// `true` if the draft that is being made is the first of its mesh, which takes longer than others.
    first: bool,
}

impl Pace {
    fn quality(&mut self, mesh: &Arc<TriMesh>) -> Quality {
        let known = self.mesh.as_ref();
        self.first = !known.is_some_and(|known| Arc::ptr_eq(known, mesh));
        if self.first {
            self.level = usize::from(mesh.triangles().len() > MANY_TRIANGLES);
            self.slow = None;
            self.mesh = Some(mesh.clone());
        }
        DRAFTS[self.level]
    }

    /// Takes note of the time of a draft.
    fn record(&mut self, time: Duration) {
        if self.first {
            return;
        }
        // all pixels of the screen are four times as many as the next level has
        let room = if self.level == 1 { 4 } else { 2 };
        if time > DRAFT_TIME {
            self.slow = self.slow.max(Some(self.level));
            self.level = (self.level + 1).min(DRAFTS.len() - 1);
        } else if time < DRAFT_TIME / room && self.level > self.slow.map_or(0, |slow| slow + 1) {
            self.level -= 1;
        }
    }

    /// Takes note that the hand rests.
    fn rest(&mut self) {
        self.slow = None;
    }
}

/// The meshes that were drawn last.
#[derive(Default)]
struct Meshes {
    known: Vec<PreparedMesh>,
}

impl Meshes {
    /// The index of a mesh.
    fn prepared(&mut self, mesh: &Arc<TriMesh>) -> &PreparedMesh {
        let same = |known: &PreparedMesh| Arc::ptr_eq(known.mesh(), mesh);
        let known = self.known.iter().position(same);
        let known = known.map(|known| self.known.remove(known));
        if self.known.len() == KEPT {
            self.known.remove(0);
        }
        let prepared = known.unwrap_or_else(|| PreparedMesh::new(mesh.clone()));
        self.known.push(prepared);
        &self.known[self.known.len() - 1]
    }
}

fn draw(
    meshes: &mut Meshes,
    wanted: &Wanted,
    quality: Quality,
    progress: &Progress,
) -> Result<(ColorImage, Option<Legend>), RenderError> {
    let edges = quality.lines.then(|| marked_edges(&wanted.shown));
    let params = params(wanted, quality, edges.filter(|edges| !edges.is_empty()));
    let prepared = meshes.prepared(&wanted.shown.mesh);
    let rendering = prepared.render(&paint(wanted, false), &params, progress)?;
    let Rendering { picture, legend } = rendering;
    let mut pixels = picture.pixels;
    if let Some(ghost) = &wanted.ghost {
        let ghost_params = ghost_params(&params);
        let prepared = meshes.prepared(&ghost.mesh);
        let ghost = prepared.render(&Paint::Plain, &ghost_params, progress)?;
        blend(&mut pixels, &ghost.picture.pixels);
    }
    let size = [picture.width, picture.height].map(|side| side as usize);
    let colors = pixels.chunks_exact(4);
    let colors = colors.map(|pixel| Color32::from_rgb(pixel[0], pixel[1], pixel[2]));
    Ok((ColorImage::new(size, colors.collect()), legend))
}

/// The colors of the mesh of `wanted`, or of its ghost.
pub(super) fn paint(wanted: &Wanted, is_ghost: bool) -> Paint<'_> {
    match &wanted.shown.values {
        Some(values) if wanted.style.colors && !is_ghost => Paint::VertexValues(Values {
            values: &values.values,
            map: values.map,
            range: values.range,
        }),
        _ => Paint::Plain,
    }
}

/// The marked edges of the mesh, whether they are shown or not.
pub(super) fn marked(wanted: &Wanted) -> Option<MarkedEdges> {
    let edges = marked_edges(&wanted.shown);
    let style = LineStyle {
        color: MARK_COLOR,
        width_px: 1.0,
    };
    (!edges.is_empty()).then_some(MarkedEdges { edges, style })
}

/// The look of the ghost of a picture.
fn ghost_params(params: &RenderParams) -> RenderParams {
    RenderParams {
        background: None,
        front_color: GHOST_COLOR,
        back_color: GHOST_COLOR,
        marked: None,
        wireframe: None,
        shaded: true,
        ..params.clone()
    }
}

/// Lays the ghost over a picture.
fn blend(pixels: &mut [u8], ghost: &[u8]) {
    for (pixel, over) in pixels.chunks_exact_mut(4).zip(ghost.chunks_exact(4)) {
        let alpha = GHOST_ALPHA * f32::from(over[3]) / 255.0;
        if alpha > 0.0 {
            for (below, &above) in pixel.iter_mut().zip(over).take(3) {
                let (low, high) = (f32::from(*below), f32::from(above));
                *below = (low + alpha * (high - low)).round() as u8;
            }
        }
    }
}

/// The pixels of a picture of a quality.
fn size(wanted: &Wanted, quality: Quality) -> [u32; 2] {
    let larger = wanted.size[0].max(wanted.size[1]);
    let divisor = quality.divisor.max(larger.div_ceil(MAX_SIDE));
    wanted.size.map(|side| side.div_ceil(divisor).max(1))
}

/// Parameters of a picture, with `edges` in the style of marks if marks are shown.
fn params(wanted: &Wanted, quality: Quality, edges: Option<Vec<[u32; 2]>>) -> RenderParams {
    let style = &wanted.style;
    let [width, height] = size(wanted, quality);
    let scale = f64::from(style.pixels_per_point) * f64::from(width.min(height))
        / f64::from(wanted.size[0].min(wanted.size[1]).max(1));
    let line = |color: Rgb8, width: f64| LineStyle {
        color,
        width_px: (width * scale).clamp(0.5, 64.0),
    };
    let surface = |color: Rgb8| {
        if style.shaded {
            color
        } else {
            style.background
        }
    };
    let defaults = RenderParams::default();
    let dark = style.background[1] < 128;
    // lines of a drawing without shades must differ from its background
    let ink = if dark && !style.shaded {
        [206, 212, 220]
    } else {
        [24, 28, 34]
    };
    RenderParams {
        width,
        height,
        samples_per_side: quality.samples,
        camera: wanted.camera,
        smooth_angle_deg: if style.smooth {
            defaults.smooth_angle_deg
        } else {
            0.0
        },
        shaded: style.shaded,
        front_color: surface(defaults.front_color),
        back_color: surface(defaults.back_color),
        background: Some(style.background),
        wireframe: (style.all_edges && quality.lines).then(|| {
            let color = if style.shaded { [92, 104, 118] } else { ink };
            line(color, 0.7)
        }),
        features: style
            .features
            .filter(|_| quality.lines)
            .map(|angle_deg| FeatureLines {
                angle_deg: angle_deg.clamp(0.0, 180.0),
                silhouettes: true,
                style: line(ink, 1.2),
            }),
        marked: edges.filter(|_| style.marks).map(|edges| MarkedEdges {
            edges,
            style: line(MARK_COLOR, 3.0),
        }),
        section: style.section,
        ..defaults
    }
}

/// The edges of the mesh that are marked.
fn marked_edges(shown: &ShownMesh) -> Vec<[u32; 2]> {
    let triangles = shown.mesh.triangles();
    let mut edges = Vec::new();
    for place in &shown.marked {
        match *place {
            MarkedPlace::Edge(edge) => edges.push(edge),
            MarkedPlace::Triangle(triangle) => {
                if let Some(&[a, b, c]) = triangles.get(triangle as usize) {
                    edges.extend([[a, b], [b, c], [c, a]]);
                }
            }
            MarkedPlace::Point(_) | MarkedPlace::Segment(_) => {}
        }
    }
    edges
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pace() -> Pace {
        let mesh = TriMesh::new(Vec::new(), Vec::new());
        let mut pace = Pace::default();
        let mesh = Arc::new(mesh.unwrap());
        assert_eq!(pace.quality(&mesh), DRAFTS[0]);
        // the first draft computes what is kept
        pace.record(10 * DRAFT_TIME);
        assert_eq!(pace.quality(&mesh), DRAFTS[0]);
        pace
    }

    #[test]
    fn slow_drafts_become_coarse_and_fast_ones_fine() {
        let mut pace = pace();
        for _ in 0..9 {
            pace.record(2 * DRAFT_TIME);
        }
        assert_eq!(pace.level, DRAFTS.len() - 1);
        pace.rest();
        for _ in 0..9 {
            pace.record(DRAFT_TIME / 9);
        }
        assert_eq!(pace.level, 0);
    }

    #[test]
    fn drafts_do_not_change_to_and_fro_while_the_hand_moves() {
        let mut pace = pace();
        let mut levels = Vec::new();
        for _ in 0..20 {
            pace.record(if pace.level < 2 {
                2 * DRAFT_TIME
            } else {
                DRAFT_TIME / 9
            });
            levels.push(pace.level);
        }
        assert!(levels[1..].iter().all(|&level| level == 2), "{levels:?}");
    }

    #[test]
    fn a_ghost_tints_what_it_covers() {
        let mut pixels = vec![200, 100, 0, 255, 9, 9, 9, 255];
        blend(&mut pixels, &[100, 100, 200, 255, 255, 255, 255, 0]);
        assert_eq!(pixels, [170, 100, 60, 255, 9, 9, 9, 255]);
    }
}

//! Pictures of meshes, made beside the window.
//!
//! A draft is made for each movement, and a fine picture when the hand rests. A new draft stops a fine picture that is being
//! made, but no draft of the same mesh: while the hand moves without a pause, drafts appear one after the other. Drafts are as
//! coarse as the last ones took time. Where the window has a GPU, meshes are copied to it after their first draft, and the window
//! draws them itself while the hand moves.
//!
//! Guarantees: no call waits for the thread; pictures come in the order of requests.

use super::ShownMesh;
use super::gpu::{Layer, MeshGpu};
use super::look::{GHOST_ALPHA, Look, Wanted, ghost_params, marked_edges, paint, params};
use super::pace::{FINE, Pace, Quality};
use crate::worker::Worker;
use egui::{Color32, ColorImage};
use ravec::mesh::TriMesh;
use ravec::mesh_render::gpu::GpuMesh;
use ravec::mesh_render::{Legend, Paint, PreparedMesh, RenderError, Rendering};
use ravec::progress::Progress;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// Meshes of which the parts that do not depend on the view are kept.
const KEPT: usize = 3;

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

impl Uploaded {
    fn is_of(&self, shown: &Arc<ShownMesh>, look: Look) -> bool {
        Arc::ptr_eq(&self.shown, shown) && self.look == look
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
    _worker: Worker,
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
        Self {
            shared,
            _worker: Worker::start("mesh renderer", move || work(&own, gpu.as_ref())),
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

    /// Layers of the mesh and its ghost, to be drawn by the GPU in place of a draft. `None` until both are copied there, and if it has
    /// refused one of them.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ghost_tints_what_it_covers() {
        let mut pixels = vec![200, 100, 0, 255, 9, 9, 9, 255];
        blend(&mut pixels, &[100, 100, 200, 255, 255, 255, 255, 0]);
        assert_eq!(pixels, [170, 100, 60, 255, 9, 9, 9, 255]);
    }
}

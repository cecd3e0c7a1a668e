//! Meshes that the adapter of the window draws, at each frame, while the hand moves.

use super::look::{self, Wanted};
use eframe::egui_wgpu::{
    Callback, CallbackResources, CallbackTrait, RenderState, ScreenDescriptor,
};
use eframe::wgpu;
use egui::{PaintCallbackInfo, Rect, Shape};
use ravec::mesh_render::gpu::{GpuMesh, GpuPicture, GpuRenderer};
use ravec::mesh_render::{PreparedMesh, RenderError, RenderParams};
use ravec::progress::Progress;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

/// The device of the window. Clones share its pipelines.
#[derive(Clone)]
pub struct MeshGpu {
    shared: Arc<Shared>,
}

struct Shared {
    device: wgpu::Device,
    queue: wgpu::Queue,
    format: wgpu::TextureFormat,
    /// `None` once the device has refused to compile them.
    renderer: OnceLock<Option<Arc<GpuRenderer>>>,
    /// `true` once the device has refused to draw: the CPU goes on.
    refused: AtomicBool,
}

impl MeshGpu {
    /// The device of a window; `None` if its adapter lacks what meshes need.
    pub fn new(state: &RenderState) -> Option<Self> {
        GpuRenderer::is_supported(&state.adapter).then(|| Self {
            shared: Arc::new(Shared {
                device: state.device.clone(),
                queue: state.queue.clone(),
                format: state.target_format,
                renderer: OnceLock::new(),
                refused: AtomicBool::new(false),
            }),
        })
    }

    /// `true` until the device refuses to draw, such as one that is lost.
    pub(super) fn is_usable(&self) -> bool {
        !self.shared.refused.load(Ordering::Relaxed)
    }

    /// The pipelines. The first call compiles them: not to be called from the window's thread.
    fn renderer(&self) -> Option<&Arc<GpuRenderer>> {
        let shared = &self.shared;
        let renderer = shared.renderer.get_or_init(|| {
            let renderer = GpuRenderer::new(&shared.device, &shared.queue, shared.format);
            renderer.ok().map(Arc::new)
        });
        renderer.as_ref()
    }

    /// Copies the mesh of `wanted` or its ghost to the device; `None` if the device refuses it.
    pub(super) fn upload(
        &self,
        prepared: &PreparedMesh,
        wanted: &Wanted,
        is_ghost: bool,
        progress: &Progress,
    ) -> Result<Option<Arc<GpuMesh>>, RenderError> {
        let Some(renderer) = self.renderer() else {
            return Ok(None);
        };
        let paint = look::paint(wanted, is_ghost);
        let marked = look::marked(wanted).filter(|_| !is_ghost);
        let angle = RenderParams::default().smooth_angle_deg;
        match GpuMesh::new(renderer, prepared, &paint, marked.as_ref(), angle, progress) {
            Ok(mesh) => Ok(Some(Arc::new(mesh))),
            Err(RenderError::Cancelled(cancelled)) => Err(cancelled.into()),
            Err(_) => Ok(None),
        }
    }

    /// Shape that draws the layers in `area`, one over the other.
    pub(super) fn shape(&self, pictures: &Pictures, area: Rect, layers: Vec<Layer>) -> Shape {
        let Some(Some(renderer)) = self.shared.renderer.get() else {
            return Shape::Noop;
        };
        let frame = Frame {
            renderer: renderer.clone(),
            layers,
            pictures: pictures.clone(),
            shared: self.shared.clone(),
        };
        Callback::new_paint_callback(area, frame).into()
    }
}

/// A mesh in the memory of the device, and its look.
pub(super) struct Layer {
    pub mesh: Arc<GpuMesh>,
    pub params: RenderParams,
    pub opacity: f32,
}

/// The pictures of the layers of a canvas, which keep their textures from frame to frame.
pub(super) type Pictures = Arc<Mutex<Vec<GpuPicture>>>;

/// One frame of a canvas.
struct Frame {
    renderer: Arc<GpuRenderer>,
    layers: Vec<Layer>,
    pictures: Pictures,
    shared: Arc<Shared>,
}

impl CallbackTrait for Frame {
    fn prepare(
        &self,
        _device: &wgpu::Device,
        _queue: &wgpu::Queue,
        _screen: &ScreenDescriptor,
        encoder: &mut wgpu::CommandEncoder,
        _resources: &mut CallbackResources,
    ) -> Vec<wgpu::CommandBuffer> {
        let mut pictures = self.pictures.lock().unwrap_or_else(PoisonError::into_inner);
        let renderer = &*self.renderer;
        pictures.resize_with(self.layers.len(), || GpuPicture::new(renderer));
        for (layer, picture) in self.layers.iter().zip(&mut *pictures) {
            let Layer {
                mesh,
                params,
                opacity,
            } = layer;
            let recorded = picture.record(renderer, encoder, mesh, params, *opacity);
            // other errors are those of the CPU, which says them
            if recorded == Err(RenderError::Device) {
                self.shared.refused.store(true, Ordering::Relaxed);
            }
        }
        Vec::new()
    }

    fn paint(
        &self,
        _info: PaintCallbackInfo,
        pass: &mut wgpu::RenderPass<'static>,
        _resources: &CallbackResources,
    ) {
        let pictures = self.pictures.lock().unwrap_or_else(PoisonError::into_inner);
        for picture in &*pictures {
            picture.copy(&self.renderer, pass);
        }
    }
}

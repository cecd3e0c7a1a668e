//! A picture in the memory of a device.

use super::mesh::{Edged, GpuMesh};
use super::{DEPTH_FORMAT, GpuRenderer, PICTURE_FORMAT, SAMPLES, light, scoped};
use crate::camera::{Projector, corners};
use crate::{LineStyle, RenderError, RenderParams, color};
use glam::{DVec3, Mat3};

/// The parameters of a picture as `mesh.wgsl` reads them.
#[derive(Debug, Clone, Copy, bytemuck::Zeroable, bytemuck::Pod)]
#[repr(C)]
struct View {
    clip: [[f32; 4]; 4],
    turn: [[f32; 4]; 3],
    eye: [f32; 4],
    section: [f32; 4],
    front: [f32; 4],
    back: [f32; 4],
    cut: [f32; 4],
    screen: [f32; 4],
    flags: u32,
    paint: u32,
    padding: [u32; 2],
}

const FLAT: u32 = 1;
const SHADED: u32 = 2;
const CUT_OPEN: u32 = 4;
const CAPPED: u32 = 8;

/// The look of lines as `mesh.wgsl` reads it.
#[derive(Debug, Clone, Copy, bytemuck::Zeroable, bytemuck::Pod)]
#[repr(C)]
struct Style {
    color: [f32; 4],
    half_width: f32,
    crease_cos: f32,
    edges: u32,
    silhouettes: u32,
}

const ALL_EDGES: u32 = 0;
const FEATURES: u32 = 1;

/// The parameters of `copy.wgsl`.
#[derive(Debug, Clone, Copy, bytemuck::Zeroable, bytemuck::Pod)]
#[repr(C)]
struct Copy {
    opacity: f32,
    encodes: u32,
    padding: [u32; 2],
}

/// Triangle edges, features, the outline of a section, and marked edges, in the order of drawing.
const LINES: usize = 4;

/// Textures of a size.
struct Textures {
    size: [u32; 2],
    samples: wgpu::TextureView,
    depth: wgpu::TextureView,
    picture: wgpu::Texture,
    resolved: wgpu::TextureView,
    copied: wgpu::BindGroup,
}

/// A picture of a mesh in the memory of a device. It is made again at each movement, and keeps its textures as long as the size
/// stays.
///
/// # Costs
/// 36 bytes a pixel on the device.
pub struct GpuPicture {
    view: wgpu::Buffer,
    styles: [(wgpu::Buffer, wgpu::BindGroup); LINES],
    copy: wgpu::Buffer,
    textures: Option<Textures>,
}

impl GpuPicture {
    /// A picture without pixels.
    pub fn new(renderer: &GpuRenderer) -> Self {
        let buffer = |bytes: usize| {
            renderer.device.create_buffer(&wgpu::BufferDescriptor {
                label: None,
                size: bytes as u64,
                usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            })
        };
        let style = |_| {
            let buffer = buffer(size_of::<Style>());
            let group = group(
                renderer,
                &renderer.style_layout,
                &[buffer.as_entire_binding()],
            );
            (buffer, group)
        };
        Self {
            view: buffer(size_of::<View>()),
            styles: [0; LINES].map(style),
            copy: buffer(size_of::<Copy>()),
            textures: None,
        }
    }

    /// Records the commands that make the picture of `mesh`, in place of what it showed. One picture may be recorded once in each
    /// submission to the queue of the device.
    ///
    /// All of `params` counts but [`RenderParams::samples_per_side`], which is about two. Without a target or a frame the camera
    /// frames the box around the mesh. [`RenderParams::smooth_angle_deg`] is either 0 or that of the mesh in memory, and the
    /// marked edges are those of the mesh in memory.
    ///
    /// # Errors
    /// As [`render`](crate::render); [`RenderError::Size`] also for pictures larger than the textures of the device, and
    /// [`RenderError::Device`] if the device refuses or is lost.
    pub fn record(
        &mut self,
        renderer: &GpuRenderer,
        encoder: &mut wgpu::CommandEncoder,
        mesh: &GpuMesh,
        params: &RenderParams,
        opacity: f32,
    ) -> Result<(), RenderError> {
        params.check()?;
        let size = [params.width, params.height];
        let limit = renderer.device.limits().max_texture_dimension_2d;
        if size.iter().any(|&side| side > limit) {
            let [width, height] = size;
            return Err(RenderError::Size { width, height });
        }
        scoped(&renderer.device, || {
            self.draw(renderer, encoder, mesh, params, opacity);
        })
    }

    fn draw(
        &mut self,
        renderer: &GpuRenderer,
        encoder: &mut wgpu::CommandEncoder,
        mesh: &GpuMesh,
        params: &RenderParams,
        opacity: f32,
    ) {
        let size = [params.width, params.height];
        let copy = Copy {
            opacity,
            encodes: renderer.encodes.into(),
            padding: [0; 2],
        };
        let write = |buffer: &wgpu::Buffer, bytes: &[u8]| {
            renderer.queue.write_buffer(buffer, 0, bytes);
        };
        write(&self.copy, bytemuck::bytes_of(&copy));
        write(&self.view, bytemuck::bytes_of(&view(mesh, params)));
        let styles = styles(params);
        for (style, (buffer, _)) in styles.iter().zip(&self.styles) {
            if let Some(style) = style {
                write(buffer, bytemuck::bytes_of(style));
            }
        }
        let textures = match self.textures.take() {
            Some(known) if known.size == size => known,
            _ => Textures::new(renderer, size, &self.copy),
        };
        let textures = self.textures.insert(textures);
        let mut bindings = vec![self.view.as_entire_binding()];
        bindings.extend(mesh.buffers.iter().map(wgpu::Buffer::as_entire_binding));
        let mesh_group = group(renderer, &renderer.mesh_layout, &bindings);
        let mut pass = textures.begin(encoder, params);
        pass.set_stencil_reference(1);
        pass.set_bind_group(0, &mesh_group, &[]);
        for surface in &renderer.surfaces {
            pass.set_pipeline(surface);
            pass.draw(0..3 * mesh.triangles, 0..1);
        }
        let is_capped = params.section.is_some_and(|section| section.capped);
        let edges = &renderer.edges[usize::from(is_capped)];
        let [wire, features, cut, marked] = [0, 1, 2, 3].map(|line: usize| {
            let (_, group) = &self.styles[line];
            styles[line].map(|_| group)
        });
        let lines = [
            (wire, edges, Some(&mesh.edges)),
            (features, edges, Some(&mesh.edges)),
            (cut, &renderer.cut, None),
            (marked, edges, Some(&mesh.marked)),
        ];
        for (group, pipeline, edged) in lines {
            let Some(group) = group else { continue };
            pass.set_pipeline(pipeline);
            pass.set_bind_group(1, group, &[]);
            let instances = match edged {
                Some(Edged { buffer, count }) => {
                    pass.set_vertex_buffer(0, buffer.slice(..));
                    *count
                }
                None => mesh.triangles,
            };
            pass.draw(0..4, 0..instances);
        }
    }

    /// Draws the picture over the viewport of a pass, whose target has the format of the renderer.
    pub fn copy(&self, renderer: &GpuRenderer, pass: &mut wgpu::RenderPass<'_>) {
        if let Some(textures) = &self.textures {
            pass.set_pipeline(&renderer.copy);
            pass.set_bind_group(0, &textures.copied, &[]);
            pass.draw(0..3, 0..1);
        }
    }

    /// The pixels: premultiplied linear light, which reads of the texture encode as sRGB.
    pub fn texture(&self) -> Option<&wgpu::Texture> {
        self.textures.as_ref().map(|textures| &textures.picture)
    }
}

impl Textures {
    fn new(renderer: &GpuRenderer, size: [u32; 2], copy: &wgpu::Buffer) -> Self {
        let texture = |format, sample_count, usage| {
            renderer.device.create_texture(&wgpu::TextureDescriptor {
                label: None,
                size: wgpu::Extent3d {
                    width: size[0],
                    height: size[1],
                    depth_or_array_layers: 1,
                },
                mip_level_count: 1,
                sample_count,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage: usage | wgpu::TextureUsages::RENDER_ATTACHMENT,
                view_formats: &[],
            })
        };
        let none = wgpu::TextureUsages::empty();
        let read = wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_SRC;
        let picture = texture(PICTURE_FORMAT, 1, read);
        let view =
            |texture: &wgpu::Texture| texture.create_view(&wgpu::TextureViewDescriptor::default());
        let resolved = view(&picture);
        let copied = group(
            renderer,
            &renderer.copy_layout,
            &[
                wgpu::BindingResource::TextureView(&resolved),
                copy.as_entire_binding(),
            ],
        );
        Self {
            size,
            samples: view(&texture(PICTURE_FORMAT, SAMPLES, none)),
            depth: view(&texture(DEPTH_FORMAT, SAMPLES, none)),
            picture,
            resolved,
            copied,
        }
    }

    /// Begins a pass on the background.
    fn begin<'a>(
        &self,
        encoder: &'a mut wgpu::CommandEncoder,
        params: &RenderParams,
    ) -> wgpu::RenderPass<'a> {
        let [r, g, b, a] = params.background.map_or([0.0; 4], light).map(f64::from);
        encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("mesh"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &self.samples,
                depth_slice: None,
                resolve_target: Some(&self.resolved),
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Clear(wgpu::Color { r, g, b, a }),
                    store: wgpu::StoreOp::Discard,
                },
            })],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &self.depth,
                depth_ops: Some(wgpu::Operations {
                    load: wgpu::LoadOp::Clear(0.0),
                    store: wgpu::StoreOp::Discard,
                }),
                stencil_ops: Some(wgpu::Operations {
                    load: wgpu::LoadOp::Clear(0),
                    store: wgpu::StoreOp::Discard,
                }),
            }),
            timestamp_writes: None,
            occlusion_query_set: None,
            multiview_mask: None,
        })
    }
}

fn group(
    renderer: &GpuRenderer,
    layout: &wgpu::BindGroupLayout,
    resources: &[wgpu::BindingResource<'_>],
) -> wgpu::BindGroup {
    let entries: Vec<_> = (0..)
        .zip(resources)
        .map(|(binding, resource)| wgpu::BindGroupEntry {
            binding,
            resource: resource.clone(),
        })
        .collect();
    renderer
        .device
        .create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout,
            entries: &entries,
        })
}

fn view(mesh: &GpuMesh, params: &RenderParams) -> View {
    let size = [params.width, params.height].map(f64::from);
    let bounds: Vec<DVec3> = if mesh.bounds.is_empty() {
        Vec::new()
    } else {
        corners(mesh.bounds).collect()
    };
    let projector = Projector::new(&params.camera, &bounds, mesh.bounds, size);
    let [scale, depth_scale] = projector.scales();
    let eye = match projector.eye_in_space() {
        Some(eye) => (eye - mesh.origin).extend(1.0),
        None => projector.axes[2].extend(0.0),
    };
    let section = params.section.map_or([0.0; 4], |section| {
        let size = section.normal.length();
        let normal = section.normal / size;
        let offset = normal.dot(mesh.origin) - section.offset / size;
        normal.extend(offset).as_vec4().to_array()
    });
    let mut flags = 0;
    for (is_set, flag) in [
        (params.smooth_angle_deg <= 0.0, FLAT),
        (params.shaded, SHADED),
        (params.section.is_some(), CUT_OPEN),
        (params.section.is_some_and(|section| section.capped), CAPPED),
    ] {
        flags |= if is_set { flag } else { 0 };
    }
    let turn = Mat3::from_cols_array_2d(&projector.axes.map(|axis| axis.as_vec3().to_array()));
    let turn = turn.transpose();
    View {
        clip: projector.clip(mesh.origin, size),
        turn: turn.to_cols_array_2d().map(|[x, y, z]| [x, y, z, 0.0]),
        eye: eye.as_vec4().to_array(),
        section,
        front: light(params.front_color),
        back: light(params.back_color),
        cut: light(params.cut_color),
        screen: [size[0], size[1], scale, depth_scale].map(|x| x as f32),
        flags,
        paint: mesh.paint,
        padding: [0; 2],
    }
}

/// The looks of the lines that are drawn.
fn styles(params: &RenderParams) -> [Option<Style>; LINES] {
    let style = |line: LineStyle| Style {
        color: color::light(line.color).extend(1.0).to_array(),
        half_width: (0.5 * line.width_px) as f32,
        crease_cos: 0.0,
        edges: ALL_EDGES,
        silhouettes: 0,
    };
    let features = params.features.map(|features| Style {
        crease_cos: features.angle_deg.to_radians().cos() as f32,
        edges: FEATURES,
        silhouettes: features.silhouettes.into(),
        ..style(features.style)
    });
    let cut = params.features.filter(|_| params.section.is_some());
    [
        params.wireframe.map(style),
        features,
        cut.map(|features| style(features.style)),
        params.marked.as_ref().map(|marked| style(marked.style)),
    ]
}

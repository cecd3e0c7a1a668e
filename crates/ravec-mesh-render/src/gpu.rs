//! Pictures of meshes on a GPU, for canvases that redraw at each movement of the hand.
//!
//! Every vertex, edge and value lies in the memory of the device; a picture takes a few hundred bytes of parameters. The look is
//! that of [`render`](super::render), which is the reference: same light, colors, lines and sections.
//!
//! | for | use |
//! | --- | --- |
//! | the pipelines of a device | [`GpuRenderer`] |
//! | a mesh in its memory | [`GpuMesh`] |
//! | a picture in its memory, and its way to the screen | [`GpuPicture`] |
//!
//! # Not guaranteed
//! - The bits of [`render`](super::render): edges of surfaces are smoothed by four samples in other places, lines meet with
//!   square ends, and whether half of a line on a steep surface is seen may differ. On drawn solids 98 of 100 pixels are within
//!   24 of 255.
//! - An order among surfaces that are nearer to each other than 1e-6 of the depth of the mesh.

mod mesh;
mod picture;

use super::{RenderError, Rgb8, color};

pub use mesh::GpuMesh;
pub use picture::GpuPicture;

/// Samples of a pixel, which every device offers.
const SAMPLES: u32 = 4;

/// Linear light; the device encodes sRGB when it stores a pixel.
const PICTURE_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8UnormSrgb;

const DEPTH_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Depth24PlusStencil8;

/// The pipelines of a device.
///
/// # Costs
/// Shaders are compiled when it is made, which takes a tenth of a second: not to be done on the thread of a window.
pub struct GpuRenderer {
    device: wgpu::Device,
    queue: wgpu::Queue,
    mesh_layout: wgpu::BindGroupLayout,
    style_layout: wgpu::BindGroupLayout,
    copy_layout: wgpu::BindGroupLayout,
    /// Fronts, then backs.
    surfaces: [wgpu::RenderPipeline; 2],
    /// Edges of all kinds, and the same where caps hide what lies behind them.
    edges: [wgpu::RenderPipeline; 2],
    cut: wgpu::RenderPipeline,
    copy: wgpu::RenderPipeline,
    encodes: bool,
}

impl GpuRenderer {
    /// Compiles the pipelines for pictures that are laid over targets of a format, without depth and with one sample.
    ///
    /// # Errors
    /// [`RenderError::Device`] if the device refuses them.
    pub fn new(
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        target: wgpu::TextureFormat,
    ) -> Result<Self, RenderError> {
        scoped(device, || Self::compile(device, queue, target))
    }

    /// Returns `true` if an adapter has what the pipelines need: storage buffers for vertices.
    pub fn is_supported(adapter: &wgpu::Adapter) -> bool {
        let flags = adapter.get_downlevel_capabilities().flags;
        flags.contains(wgpu::DownlevelFlags::VERTEX_STORAGE)
    }

    fn compile(device: &wgpu::Device, queue: &wgpu::Queue, target: wgpu::TextureFormat) -> Self {
        let mesh_layout = mesh_layout(device);
        let style_layout = layout(device, &[uniform(0, wgpu::ShaderStages::VERTEX_FRAGMENT)]);
        let copy_layout = layout(
            device,
            &[
                wgpu::BindGroupLayoutEntry {
                    binding: 0,
                    visibility: wgpu::ShaderStages::FRAGMENT,
                    ty: wgpu::BindingType::Texture {
                        sample_type: wgpu::TextureSampleType::Float { filterable: false },
                        view_dimension: wgpu::TextureViewDimension::D2,
                        multisampled: false,
                    },
                    count: None,
                },
                uniform(1, wgpu::ShaderStages::FRAGMENT),
            ],
        );
        let shader = device.create_shader_module(wgpu::include_wgsl!("gpu/mesh.wgsl"));
        let pipelines = Pipelines {
            device,
            shader: &shader,
            surface: &[Some(&mesh_layout)],
            lines: &[Some(&mesh_layout), Some(&style_layout)],
        };
        Self {
            surfaces: pipelines.surfaces(),
            edges: [false, true].map(|is_capped| pipelines.edges(is_capped)),
            cut: pipelines.cut(),
            copy: copy_pipeline(device, &copy_layout, target),
            encodes: !target.is_srgb(),
            device: device.clone(),
            queue: queue.clone(),
            mesh_layout,
            style_layout,
            copy_layout,
        }
    }
}

/// Runs `action`, and returns the error that it causes on the device.
fn scoped<R>(device: &wgpu::Device, action: impl FnOnce() -> R) -> Result<R, RenderError> {
    let filters = [
        wgpu::ErrorFilter::Internal,
        wgpu::ErrorFilter::OutOfMemory,
        wgpu::ErrorFilter::Validation,
    ];
    let scopes = filters.map(|filter| device.push_error_scope(filter));
    let result = action();
    let mut refused = false;
    for scope in scopes.into_iter().rev() {
        refused |= pollster::block_on(scope.pop()).is_some();
    }
    if refused {
        return Err(RenderError::Device);
    }
    Ok(result)
}

fn layout(device: &wgpu::Device, entries: &[wgpu::BindGroupLayoutEntry]) -> wgpu::BindGroupLayout {
    device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: None,
        entries,
    })
}

fn buffer_entry(
    binding: u32,
    visibility: wgpu::ShaderStages,
    ty: wgpu::BufferBindingType,
) -> wgpu::BindGroupLayoutEntry {
    wgpu::BindGroupLayoutEntry {
        binding,
        visibility,
        ty: wgpu::BindingType::Buffer {
            ty,
            has_dynamic_offset: false,
            min_binding_size: None,
        },
        count: None,
    }
}

fn uniform(binding: u32, visibility: wgpu::ShaderStages) -> wgpu::BindGroupLayoutEntry {
    buffer_entry(binding, visibility, wgpu::BufferBindingType::Uniform)
}

/// View, positions, triangles, normals, paints and scale of `mesh.wgsl`.
fn mesh_layout(device: &wgpu::Device) -> wgpu::BindGroupLayout {
    let storage = |binding, visibility| {
        let ty = wgpu::BufferBindingType::Storage { read_only: true };
        buffer_entry(binding, visibility, ty)
    };
    let vertex = wgpu::ShaderStages::VERTEX;
    layout(
        device,
        &[
            uniform(0, wgpu::ShaderStages::VERTEX_FRAGMENT),
            storage(1, vertex),
            storage(2, vertex),
            storage(3, vertex),
            storage(4, vertex),
            storage(5, wgpu::ShaderStages::FRAGMENT),
        ],
    )
}

/// Depth by which backs are farther than fronts at the same place, in the smallest steps that are told apart.
const BACK_BIAS: i32 = -16;

/// The four corners of a line.
const STRIP: wgpu::PrimitiveState = wgpu::PrimitiveState {
    topology: wgpu::PrimitiveTopology::TriangleStrip,
    strip_index_format: None,
    front_face: wgpu::FrontFace::Ccw,
    cull_mode: None,
    unclipped_depth: false,
    polygon_mode: wgpu::PolygonMode::Fill,
    conservative: false,
};

/// Tests of depth and stencil. Depth is 1 at the nearest place.
struct Depth {
    writes: bool,
    compare: wgpu::CompareFunction,
    stencil: wgpu::StencilState,
    bias: i32,
}

impl Depth {
    /// Lines are drawn over what is not nearer, and hide nothing.
    fn of_lines(stencil: wgpu::StencilState) -> Self {
        Self {
            writes: false,
            compare: wgpu::CompareFunction::GreaterEqual,
            stencil,
            bias: 0,
        }
    }
}

/// Device, shader and layouts that the pipelines of `mesh.wgsl` share.
struct Pipelines<'a> {
    device: &'a wgpu::Device,
    shader: &'a wgpu::ShaderModule,
    surface: &'a [Option<&'a wgpu::BindGroupLayout>],
    lines: &'a [Option<&'a wgpu::BindGroupLayout>],
}

impl Pipelines<'_> {
    /// Fronts of triangles, then backs, which set the stencil: a cap is where the back of a surface is seen. Of two triangles at the
    /// same place that face opposite ways, the front is seen.
    fn surfaces(&self) -> [wgpu::RenderPipeline; 2] {
        let face = |pass_op| wgpu::StencilFaceState {
            compare: wgpu::CompareFunction::Always,
            fail_op: wgpu::StencilOperation::Keep,
            depth_fail_op: wgpu::StencilOperation::Keep,
            pass_op,
        };
        let stencil = wgpu::StencilState {
            front: face(wgpu::StencilOperation::Zero),
            back: face(wgpu::StencilOperation::Replace),
            read_mask: !0,
            write_mask: !0,
        };
        [(wgpu::Face::Back, 0), (wgpu::Face::Front, BACK_BIAS)].map(|(hidden, bias)| {
            self.pipeline(
                ["surface_vertex", "surface_fragment"],
                self.surface,
                &[],
                wgpu::PrimitiveState {
                    cull_mode: Some(hidden),
                    ..wgpu::PrimitiveState::default()
                },
                Depth {
                    writes: true,
                    // of two at the same depth the first one, as on the CPU
                    compare: wgpu::CompareFunction::Greater,
                    stencil: stencil.clone(),
                    bias,
                },
            )
        })
    }

    /// The edges of triangles, where `is_capped` only beside caps: all that lies behind a cap is inside the solid.
    fn edges(&self, is_capped: bool) -> wgpu::RenderPipeline {
        let edges = wgpu::VertexBufferLayout {
            array_stride: size_of::<mesh::Edge>() as u64,
            step_mode: wgpu::VertexStepMode::Instance,
            attributes: &wgpu::vertex_attr_array![0 => Uint32x2, 1 => Uint32x2, 2 => Uint32],
        };
        let face = wgpu::StencilFaceState {
            compare: wgpu::CompareFunction::NotEqual,
            ..wgpu::StencilFaceState::IGNORE
        };
        let stencil = wgpu::StencilState {
            front: face,
            back: face,
            read_mask: !0,
            write_mask: 0,
        };
        let stencil = if is_capped {
            stencil
        } else {
            wgpu::StencilState::default()
        };
        self.pipeline(
            ["edge_vertex", "edge_fragment"],
            self.lines,
            &[Some(edges)],
            STRIP,
            Depth::of_lines(stencil),
        )
    }

    /// The outline of a section.
    fn cut(&self) -> wgpu::RenderPipeline {
        self.pipeline(
            ["cut_vertex", "cut_fragment"],
            self.lines,
            &[],
            STRIP,
            Depth::of_lines(wgpu::StencilState::default()),
        )
    }

    fn pipeline(
        &self,
        [vertex, fragment]: [&str; 2],
        groups: &[Option<&wgpu::BindGroupLayout>],
        buffers: &[Option<wgpu::VertexBufferLayout<'_>>],
        primitive: wgpu::PrimitiveState,
        depth: Depth,
    ) -> wgpu::RenderPipeline {
        let layout = self
            .device
            .create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
                label: None,
                bind_group_layouts: groups,
                immediate_size: 0,
            });
        self.device
            .create_render_pipeline(&wgpu::RenderPipelineDescriptor {
                label: Some(vertex),
                layout: Some(&layout),
                vertex: wgpu::VertexState {
                    module: self.shader,
                    entry_point: Some(vertex),
                    compilation_options: wgpu::PipelineCompilationOptions::default(),
                    buffers,
                },
                primitive,
                depth_stencil: Some(wgpu::DepthStencilState {
                    format: DEPTH_FORMAT,
                    depth_write_enabled: Some(depth.writes),
                    depth_compare: Some(depth.compare),
                    stencil: depth.stencil,
                    bias: wgpu::DepthBiasState {
                        constant: depth.bias,
                        ..wgpu::DepthBiasState::default()
                    },
                }),
                multisample: wgpu::MultisampleState {
                    count: SAMPLES,
                    ..wgpu::MultisampleState::default()
                },
                fragment: Some(wgpu::FragmentState {
                    module: self.shader,
                    entry_point: Some(fragment),
                    compilation_options: wgpu::PipelineCompilationOptions::default(),
                    targets: &[Some(wgpu::ColorTargetState {
                        format: PICTURE_FORMAT,
                        blend: Some(wgpu::BlendState::PREMULTIPLIED_ALPHA_BLENDING),
                        write_mask: wgpu::ColorWrites::ALL,
                    })],
                }),
                multiview_mask: None,
                cache: None,
            })
    }
}

fn copy_pipeline(
    device: &wgpu::Device,
    group: &wgpu::BindGroupLayout,
    target: wgpu::TextureFormat,
) -> wgpu::RenderPipeline {
    let shader = device.create_shader_module(wgpu::include_wgsl!("gpu/copy.wgsl"));
    let layout = device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
        label: None,
        bind_group_layouts: &[Some(group)],
        immediate_size: 0,
    });
    device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("copy"),
        layout: Some(&layout),
        vertex: wgpu::VertexState {
            module: &shader,
            entry_point: Some("copy_vertex"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            buffers: &[],
        },
        primitive: wgpu::PrimitiveState::default(),
        depth_stencil: None,
        multisample: wgpu::MultisampleState::default(),
        fragment: Some(wgpu::FragmentState {
            module: &shader,
            entry_point: Some("copy_fragment"),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            targets: &[Some(wgpu::ColorTargetState {
                format: target,
                blend: Some(wgpu::BlendState::PREMULTIPLIED_ALPHA_BLENDING),
                write_mask: wgpu::ColorWrites::ALL,
            })],
        }),
        multiview_mask: None,
        cache: None,
    })
}

/// Linear light of a color, opaque.
fn light(color: Rgb8) -> [f32; 4] {
    let [r, g, b] = color::light(color).to_array();
    [r, g, b, 1.0]
}

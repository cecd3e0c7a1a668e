//! Pictures on a GPU against those of the CPU, on the software driver for Vulkan (Debian's mesa-vulkan-drivers). Without it
//! nothing is tested, and a line says so.

#![allow(
    clippy::disallowed_methods,
    reason = "tests may write files as they like"
)]

use glam::DVec3;
use ravec_mesh::{Aabb, TriMesh};
use ravec_mesh_render::gpu::{GpuMesh, GpuPicture, GpuRenderer};
use ravec_mesh_render::{
    Camera, ColorMap, FeatureLines, LineStyle, MarkedEdges, Paint, PreparedMesh, Projection,
    RenderError, RenderParams, Section, Target, Values, View, render,
};
use ravec_progress::Progress;
use ravec_scenes::solids::{cuboid, torus};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// The adapter of the tests.
const ADAPTER: &str = "llvmpipe";

const SIZE: [u32; 2] = [320, 240];

/// Format of a window.
const TARGET: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;

/// A device with its renderer.
struct Stage {
    device: wgpu::Device,
    queue: wgpu::Queue,
    renderer: GpuRenderer,
}

/// One after the other: drivers on the CPU take all cores.
fn lock() -> MutexGuard<'static, ()> {
    static LOCK: Mutex<()> = Mutex::new(());
    LOCK.lock().unwrap_or_else(PoisonError::into_inner)
}

fn stage() -> Option<Stage> {
    let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
    descriptor.backends = wgpu::Backends::PRIMARY;
    let instance = wgpu::Instance::new(descriptor);
    let adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::PRIMARY));
    let found = adapters
        .iter()
        .find(|adapter| adapter.get_info().name.contains(ADAPTER));
    let Some(adapter) = found else {
        eprintln!("SKIPPED: no software driver for Vulkan; install mesa-vulkan-drivers");
        return None;
    };
    assert!(GpuRenderer::is_supported(adapter));
    let descriptor = wgpu::DeviceDescriptor {
        required_limits: wgpu::Limits::default(),
        ..Default::default()
    };
    let (device, queue) = pollster::block_on(adapter.request_device(&descriptor)).unwrap();
    let renderer = GpuRenderer::new(&device, &queue, TARGET).unwrap();
    Some(Stage {
        device,
        queue,
        renderer,
    })
}

impl Stage {
    fn upload(&self, mesh: &TriMesh, paint: &Paint<'_>, params: &RenderParams) -> GpuMesh {
        let prepared = PreparedMesh::new(Arc::new(mesh.clone()));
        let marked = params.marked.as_ref();
        let angle = params.smooth_angle_deg;
        let progress = Progress::none();
        GpuMesh::new(&self.renderer, &prepared, paint, marked, angle, &progress).unwrap()
    }

    /// The bytes of a window of one color, with the picture over it.
    fn shown(
        &self,
        mesh: &GpuMesh,
        params: &RenderParams,
        opacity: f32,
        below: wgpu::Color,
    ) -> Vec<u8> {
        let mut picture = GpuPicture::new(&self.renderer);
        let mut encoder = self
            .device
            .create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        picture
            .record(&self.renderer, &mut encoder, mesh, params, opacity)
            .unwrap();
        let size = wgpu::Extent3d {
            width: params.width,
            height: params.height,
            depth_or_array_layers: 1,
        };
        let target = self.device.create_texture(&wgpu::TextureDescriptor {
            label: None,
            size,
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: TARGET,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
            view_formats: &[],
        });
        let view = target.create_view(&wgpu::TextureViewDescriptor::default());
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &view,
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: wgpu::LoadOp::Clear(below),
                    store: wgpu::StoreOp::Store,
                },
            })],
            ..Default::default()
        });
        picture.copy(&self.renderer, &mut pass);
        drop(pass);
        let row = (4 * params.width).next_multiple_of(256);
        let buffer = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: u64::from(row * params.height),
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        encoder.copy_texture_to_buffer(
            target.as_image_copy(),
            wgpu::TexelCopyBufferInfo {
                buffer: &buffer,
                layout: wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(row),
                    rows_per_image: None,
                },
            },
            size,
        );
        self.queue.submit([encoder.finish()]);
        buffer
            .slice(..)
            .map_async(wgpu::MapMode::Read, |result| result.unwrap());
        self.device
            .poll(wgpu::PollType::wait_indefinitely())
            .unwrap();
        let bytes = buffer.slice(..).get_mapped_range().unwrap();
        let rows = bytes.chunks_exact(row as usize);
        rows.flat_map(|bytes| &bytes[..4 * params.width as usize])
            .copied()
            .collect()
    }

    fn picture(&self, mesh: &GpuMesh, params: &RenderParams) -> Vec<u8> {
        self.shown(mesh, params, 1.0, wgpu::Color::TRANSPARENT)
    }
}

/// Parameters of a canvas that views `mesh`.
fn params(mesh: &TriMesh, view: View, projection: Projection) -> RenderParams {
    let bounds = mesh.bounds();
    RenderParams {
        width: SIZE[0],
        height: SIZE[1],
        samples_per_side: 2,
        camera: Camera {
            view,
            projection,
            target: Some(Target {
                center: bounds.center(),
                span: 0.9 * bounds.diagonal(),
                bounds,
            }),
            ..Camera::default()
        },
        ..RenderParams::default()
    }
}

/// The share of pixels whose colors differ by more than 24, and the mean difference.
fn difference(a: &[u8], b: &[u8]) -> (f64, f64) {
    assert_eq!(a.len(), b.len());
    let pixels = a.chunks_exact(4).zip(b.chunks_exact(4));
    let mut far = 0.0;
    let mut sum = 0.0;
    for (a, b) in pixels {
        let differences = a.iter().zip(b).map(|(&a, &b)| f64::from(a.abs_diff(b)));
        let most = differences.fold(0.0, f64::max);
        far += f64::from(u8::from(most > 24.0));
        sum += most;
    }
    let count = a.len() as f64 / 4.0;
    (far / count, sum / count)
}

/// Writes both pictures side by side where the variable asks for them.
fn keep(name: &str, params: &RenderParams, gpu: &[u8], cpu: &[u8]) {
    let Ok(folder) = std::env::var("RAVEC_KEEP_PICTURES") else {
        return;
    };
    let mut text = format!("P6 {} {} 255\n", 2 * params.width, params.height).into_bytes();
    let width = 4 * params.width as usize;
    for (gpu, cpu) in gpu.chunks_exact(width).zip(cpu.chunks_exact(width)) {
        for row in [gpu, cpu] {
            text.extend(row.chunks_exact(4).flat_map(|pixel| &pixel[..3]));
        }
    }
    std::fs::write(format!("{folder}/{name}.ppm"), text).unwrap();
}

fn check(stage: &Stage, name: &str, mesh: &TriMesh, paint: &Paint<'_>, params: &RenderParams) {
    let on_gpu = stage.picture(&stage.upload(mesh, paint, params), params);
    let on_cpu = render(mesh, paint, params, &Progress::none()).unwrap();
    keep(name, params, &on_gpu, &on_cpu.picture.pixels);
    let (far, mean) = difference(&on_gpu, &on_cpu.picture.pixels);
    println!("{name}: {:.2} % far, mean {mean:.2}", 100.0 * far);
    assert!(far <= 0.02 && mean <= 1.5, "{name}: {far} {mean}");
}

const PERSPECTIVE: Projection = Projection::Perspective {
    field_of_view_deg: 40.0,
};

#[test]
fn pictures_look_like_those_of_the_cpu() {
    let _lock = lock();
    let Some(stage) = stage() else { return };
    let torus = torus(2.0, 0.7, 60, 30).mesh;
    let cuboid = cuboid(DVec3::new(3.0, 1.0, 2.0)).mesh;
    // far from the origin of space, where single precision would show
    let far = TriMesh::new(
        torus
            .positions()
            .iter()
            .map(|&at| at + DVec3::new(1e6, -2e6, 3e6))
            .collect(),
        torus.triangles().to_vec(),
    );
    for (name, mesh) in [
        ("torus", &torus),
        ("cuboid", &cuboid),
        ("far", &far.unwrap()),
    ] {
        for (kind, projection) in [
            ("parallel", Projection::Orthographic),
            ("perspective", PERSPECTIVE),
        ] {
            let params = params(mesh, View::new(30.0, 25.0), projection);
            check(
                &stage,
                &format!("{name}-{kind}"),
                mesh,
                &Paint::Plain,
                &params,
            );
        }
    }
}

#[test]
fn of_two_surfaces_at_the_same_place_the_front_is_seen() {
    let _lock = lock();
    let Some(stage) = stage() else { return };
    let torus = torus(2.0, 0.7, 40, 20).mesh;
    // the corners in another order, so that depths differ by rounding
    let reversed = torus.triangles().iter().map(|&[a, b, c]| [c, b, a]);
    let doubled: Vec<[u32; 3]> = torus.triangles().iter().copied().chain(reversed).collect();
    let doubled = TriMesh::new(torus.positions().to_vec(), doubled).unwrap();
    let params = RenderParams {
        features: None,
        ..params(&doubled, View::new(30.0, 25.0), PERSPECTIVE)
    };
    check(&stage, "doubled", &doubled, &Paint::Plain, &params);
}

#[test]
fn options_look_like_those_of_the_cpu() {
    let _lock = lock();
    let Some(stage) = stage() else { return };
    let mesh = torus(2.0, 0.7, 40, 20).mesh;
    let base = params(&mesh, View::new(200.0, 50.0), PERSPECTIVE);
    let section = |capped| {
        Some(Section {
            normal: DVec3::new(0.0, 2.0, 1.0),
            offset: 0.3,
            capped,
        })
    };
    let marked: Vec<[u32; 2]> = mesh.triangles()[..60]
        .iter()
        .map(|&[a, b, _]| [b, a])
        .collect();
    let line = |color, width_px| LineStyle { color, width_px };
    let cases = [
        (
            "flat",
            RenderParams {
                smooth_angle_deg: 0.0,
                ..base.clone()
            },
        ),
        (
            "unlit",
            RenderParams {
                shaded: false,
                ..base.clone()
            },
        ),
        (
            "bare",
            RenderParams {
                features: None,
                ..base.clone()
            },
        ),
        (
            "wire",
            RenderParams {
                wireframe: Some(line([92, 104, 118], 0.7)),
                ..base.clone()
            },
        ),
        (
            "creases",
            RenderParams {
                features: Some(FeatureLines {
                    angle_deg: 17.0,
                    ..FeatureLines::default()
                }),
                ..base.clone()
            },
        ),
        (
            "section",
            RenderParams {
                section: section(false),
                ..base.clone()
            },
        ),
        (
            "cap",
            RenderParams {
                section: section(true),
                ..base.clone()
            },
        ),
        (
            "marked",
            RenderParams {
                marked: Some(MarkedEdges {
                    edges: marked,
                    style: line([226, 32, 44], 3.0),
                }),
                ..base.clone()
            },
        ),
        (
            "zoomed",
            RenderParams {
                camera: Camera {
                    target: base.camera.target.map(|target| Target {
                        center: mesh.positions()[0],
                        span: 0.5,
                        ..target
                    }),
                    ..base.camera
                },
                ..base.clone()
            },
        ),
    ];
    for (name, params) in cases {
        check(&stage, name, &mesh, &Paint::Plain, &params);
    }
}

#[test]
fn colors_look_like_those_of_the_cpu() {
    let _lock = lock();
    let Some(stage) = stage() else { return };
    let mesh = torus(2.0, 0.7, 60, 30).mesh;
    let params = params(&mesh, View::ISO, Projection::Orthographic);
    let mut heights: Vec<f64> = mesh.positions().iter().map(|at| at.x).collect();
    heights[7] = f64::NAN;
    let values = |map, range| {
        Paint::VertexValues(Values {
            values: &heights,
            map,
            range,
        })
    };
    check(
        &stage,
        "values",
        &mesh,
        &values(ColorMap::Sequential, None),
        &params,
    );
    let range = Some([-0.5, 0.5]);
    check(
        &stage,
        "range",
        &mesh,
        &values(ColorMap::Diverging, range),
        &params,
    );
    let colors: Vec<[u8; 3]> = mesh
        .positions()
        .iter()
        .map(|at| [at.x, at.y, at.z].map(|x| (100.0 + 40.0 * x) as u8))
        .collect();
    check(
        &stage,
        "vertex-colors",
        &mesh,
        &Paint::VertexColors(&colors),
        &params,
    );
    let faces: Vec<[u8; 3]> = mesh
        .triangles()
        .iter()
        .map(|&[a, ..]| colors[a as usize])
        .collect();
    check(
        &stage,
        "face-colors",
        &mesh,
        &Paint::FaceColors(&faces),
        &params,
    );
    let numbers: Vec<f64> = (0..mesh.triangles().len())
        .map(|i| (i % 60) as f64)
        .collect();
    let numbers = Paint::FaceValues(Values {
        values: &numbers,
        map: ColorMap::Sequential,
        range: None,
    });
    check(&stage, "face-values", &mesh, &numbers, &params);
    let uploaded = stage.upload(&mesh, &numbers, &params);
    let legend = uploaded.legend().unwrap();
    assert_eq!([legend.low, legend.high], [0.0, 59.0]);
}

#[test]
fn a_ghost_covers_as_much_as_asked() {
    let _lock = lock();
    let Some(stage) = stage() else { return };
    let mesh = cuboid(DVec3::ONE).mesh;
    let params = RenderParams {
        background: None,
        shaded: false,
        front_color: [100, 100, 200],
        features: None,
        ..params(&mesh, View::FRONT, Projection::Orthographic)
    };
    let below = wgpu::Color {
        r: 200.0 / 255.0,
        g: 100.0 / 255.0,
        b: 0.0,
        a: 1.0,
    };
    let uploaded = stage.upload(&mesh, &Paint::Plain, &params);
    let pixels = stage.shown(&uploaded, &params, 0.3, below);
    let at = |x: u32, y: u32| {
        let start = 4 * (y * SIZE[0] + x) as usize;
        [
            pixels[start],
            pixels[start + 1],
            pixels[start + 2],
            pixels[start + 3],
        ]
    };
    let middle = at(SIZE[0] / 2, SIZE[1] / 2);
    for (found, expected) in middle.into_iter().zip([170, 100, 60, 255]) {
        assert!(found.abs_diff(expected) <= 1, "{middle:?}");
    }
    assert_eq!(at(1, 1), [200, 100, 0, 255]);
}

#[test]
fn hostile_meshes_and_parameters_give_a_picture_or_a_sentence() {
    let _lock = lock();
    let Some(stage) = stage() else { return };
    let places = vec![
        DVec3::ZERO,
        DVec3::X,
        DVec3::Y,
        DVec3::splat(1e300),
        DVec3::ZERO,
    ];
    let empty = TriMesh::new(Vec::new(), Vec::new()).unwrap();
    let points = TriMesh::new(places.clone(), Vec::new()).unwrap();
    let flat = TriMesh::new(places.clone(), vec![[0, 1, 1], [0, 0, 4], [0, 1, 2]]).unwrap();
    let huge = TriMesh::new(places, vec![[0, 1, 3]]).unwrap();
    for mesh in [&empty, &points, &flat, &huge] {
        let params = RenderParams {
            width: 3,
            height: 1,
            camera: Camera {
                target: Some(Target {
                    center: DVec3::ZERO,
                    span: 2.0,
                    bounds: Aabb::EMPTY,
                }),
                ..Camera::default()
            },
            ..RenderParams::default()
        };
        let uploaded = stage.upload(mesh, &Paint::Plain, &params);
        assert_eq!(stage.picture(&uploaded, &params).len(), 12);
    }
    let mesh = cuboid(DVec3::ONE).mesh;
    let too_few = Paint::VertexColors(&[[1, 2, 3]]);
    let prepared = PreparedMesh::new(Arc::new(mesh.clone()));
    let progress = Progress::none();
    let refused = GpuMesh::new(&stage.renderer, &prepared, &too_few, None, 30.0, &progress);
    assert_eq!(
        refused.err(),
        Some(RenderError::Paint {
            got: 1,
            expected: 8
        })
    );
    let base = params(&mesh, View::ISO, PERSPECTIVE);
    let uploaded = stage.upload(&mesh, &Paint::Plain, &base);
    let mut encoder = stage
        .device
        .create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
    let mut picture = GpuPicture::new(&stage.renderer);
    for (width, height) in [(0, 3), (16_000, 3)] {
        let params = RenderParams {
            width,
            height,
            ..base.clone()
        };
        let refused = picture.record(&stage.renderer, &mut encoder, &uploaded, &params, 1.0);
        assert_eq!(refused.err(), Some(RenderError::Size { width, height }));
    }
}

#[test]
fn a_device_that_is_lost_is_an_error() {
    let _lock = lock();
    let Some(stage) = stage() else { return };
    let mesh = cuboid(DVec3::ONE).mesh;
    let params = params(&mesh, View::ISO, PERSPECTIVE);
    let uploaded = stage.upload(&mesh, &Paint::Plain, &params);
    let mut picture = GpuPicture::new(&stage.renderer);
    stage.device.destroy();
    let prepared = PreparedMesh::new(Arc::new(mesh));
    let (plain, progress) = (Paint::Plain, Progress::none());
    let refused = GpuMesh::new(&stage.renderer, &prepared, &plain, None, 30.0, &progress);
    assert_eq!(refused.err(), Some(RenderError::Device));
    // an encoder of the lost device takes the commands or refuses them, and nothing panics
    stage.device.on_uncaptured_error(Arc::new(|_| {}));
    let descriptor = wgpu::CommandEncoderDescriptor::default();
    let mut encoder = stage.device.create_command_encoder(&descriptor);
    let recorded = picture.record(&stage.renderer, &mut encoder, &uploaded, &params, 1.0);
    assert!(matches!(recorded, Ok(()) | Err(RenderError::Device)));
}

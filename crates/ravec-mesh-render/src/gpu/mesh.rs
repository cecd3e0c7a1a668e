//! A mesh in the memory of a device.

use super::{GpuRenderer, scoped};
use crate::edges::{Edges, Side, normal};
use crate::prepared::PreparedMesh;
use crate::scene::STEPS;
use crate::{Legend, MarkedEdges, Paint, RenderError};
use glam::{DVec3, Vec3};
use ravec_mesh::{Aabb, KeyedSet, TriMesh, par_collect};
use ravec_progress::Progress;

/// An edge as `mesh.wgsl` reads it.
#[derive(Debug, Clone, Copy, bytemuck::Zeroable, bytemuck::Pod)]
#[repr(C)]
pub(super) struct Edge {
    ends: [u32; 2],
    /// Of the first two triangles beside it, as [`octahedral`] codes.
    normals: [u32; 2],
    kind: u32,
}

/// Kinds of edges in `mesh.wgsl`.
const FEATURE: u32 = 0;
const BEND: u32 = 1;
const FLAT_EDGE: u32 = 2;
const TWISTED: u32 = 4;

/// Colors and numbers in `mesh.wgsl`.
const PLAIN: u32 = 0;
const VERTEX_COLORS: u32 = 1;
const FACE_COLORS: u32 = 2;
const VERTEX_VALUES: u32 = 3;
const FACE_VALUES: u32 = 4;

/// The share of the scale that stands for what is not a number, far below [`MAX_SHARE`], so that triangles with one such corner
/// are gray.
const NO_NUMBER: f32 = -1e9;

/// Largest share of the scale, and negative the smallest.
const MAX_SHARE: f64 = 1e5;

/// A mesh with its colors and marked edges in the memory of a device.
///
/// # Costs
/// 24 bytes a triangle for the surface, 20 an edge for lines, 12 a vertex, and 4 for each color or number.
pub struct GpuMesh {
    /// Places are stored relative to this, so that few digits are lost.
    pub(super) origin: DVec3,
    pub(super) bounds: Aabb,
    pub(super) triangles: u32,
    pub(super) paint: u32,
    pub(super) buffers: [wgpu::Buffer; 5],
    pub(super) edges: Edged,
    pub(super) marked: Edged,
    legend: Option<Legend>,
}

/// Edges in the memory of a device.
pub(super) struct Edged {
    pub buffer: wgpu::Buffer,
    pub count: u32,
}

impl GpuMesh {
    /// Copies a mesh to the device of `renderer`. `smooth_angle_deg` is that of
    /// [`RenderParams`](crate::RenderParams::smooth_angle_deg).
    ///
    /// # Errors
    /// [`RenderError::Paint`] if colors or numbers do not fit the mesh, [`RenderError::DeviceMemory`] if an array exceeds what
    /// the device holds in one piece (5 to 11 million triangles by the limits that every device has), [`RenderError::Device`] if
    /// the device refuses or its memory is exhausted, [`RenderError::Cancelled`] soon after `progress` is cancelled.
    pub fn new(
        renderer: &GpuRenderer,
        mesh: &PreparedMesh,
        paint: &Paint<'_>,
        marked: Option<&MarkedEdges>,
        smooth_angle_deg: f64,
        progress: &Progress,
    ) -> Result<Self, RenderError> {
        let (prepared, mesh) = (&mesh.prepared, mesh.mesh());
        paint.check(mesh)?;
        let bounds = prepared.bounds(mesh);
        let origin = if bounds.is_empty() {
            DVec3::ZERO
        } else {
            bounds.center()
        };
        let positions = par_collect(mesh.positions().len(), progress, |vertex| {
            let place = mesh.positions()[vertex as usize] - origin;
            [place.as_vec3().to_array()]
        })?;
        let normals = prepared.normals(mesh, smooth_angle_deg, progress)?;
        let normals = par_collect(normals.len(), progress, |triangle| {
            [normals[triangle as usize].map(octahedral)]
        })?;
        let edges = edges(mesh, prepared.edges(mesh, progress)?, progress)?;
        let marked = marked_edges(&edges, marked);
        let (paint_kind, paints) = paints(paint);
        let legend = paint.legend();
        let scale = scale(legend);
        let uploads = Uploads { renderer };
        let storage = wgpu::BufferUsages::STORAGE;
        uploads.check::<[f32; 3]>(positions.len())?;
        uploads.check::<[u32; 3]>(mesh.triangles().len())?;
        let arrays: [&[u8]; 5] = [
            bytemuck::cast_slice(&positions),
            bytemuck::cast_slice(mesh.triangles()),
            bytemuck::cast_slice(&normals),
            bytemuck::cast_slice(&paints),
            bytemuck::cast_slice(&scale),
        ];
        progress.check()?;
        Ok(Self {
            origin,
            bounds,
            triangles: mesh.triangles().len() as u32,
            paint: paint_kind,
            buffers: uploads.buffers(arrays, storage)?,
            edges: uploads.edges(&edges)?,
            marked: uploads.edges(&marked)?,
            legend,
        })
    }

    /// Legend of the colors, if they stand for numbers.
    pub fn legend(&self) -> Option<Legend> {
        self.legend
    }
}

/// Copies arrays to a device.
struct Uploads<'a> {
    renderer: &'a GpuRenderer,
}

impl Uploads<'_> {
    /// Fails if an array is larger than a binding or a buffer of the device.
    fn check<T>(&self, count: usize) -> Result<(), RenderError> {
        let limits = self.renderer.device.limits();
        let limit = limits
            .max_storage_buffer_binding_size
            .min(limits.max_buffer_size);
        let bytes = (count as u64).saturating_mul(size_of::<T>() as u64);
        if bytes > limit {
            return Err(RenderError::DeviceMemory { bytes, limit });
        }
        Ok(())
    }

    fn buffers(
        &self,
        arrays: [&[u8]; 5],
        usage: wgpu::BufferUsages,
    ) -> Result<[wgpu::Buffer; 5], RenderError> {
        let [positions, triangles, normals, paints, scale] = arrays;
        Ok([
            self.buffer(positions, usage)?,
            self.buffer(triangles, usage)?,
            self.buffer(normals, usage)?,
            self.buffer(paints, usage)?,
            self.buffer(scale, usage)?,
        ])
    }

    fn edges(&self, edges: &[Edge]) -> Result<Edged, RenderError> {
        let limit = self.renderer.device.limits().max_buffer_size;
        let bytes = size_of_val(edges) as u64;
        if bytes > limit {
            return Err(RenderError::DeviceMemory { bytes, limit });
        }
        let bytes = bytemuck::cast_slice(edges);
        Ok(Edged {
            buffer: self.buffer(bytes, wgpu::BufferUsages::VERTEX)?,
            count: edges.len() as u32,
        })
    }

    fn buffer(&self, bytes: &[u8], usage: wgpu::BufferUsages) -> Result<wgpu::Buffer, RenderError> {
        // bindings are not empty, nor smaller than one entry
        let bytes = if bytes.is_empty() { &[0; 16] } else { bytes };
        let device = &self.renderer.device;
        let buffer = scoped(device, || {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: None,
                size: bytes.len() as u64,
                usage,
                mapped_at_creation: true,
            })
        })?;
        // a device that is lost or has no memory left maps nothing
        let mapped = buffer.get_mapped_range_mut(..);
        let mut mapped = mapped.map_err(|_| RenderError::Device)?;
        mapped.copy_from_slice(bytes);
        drop(mapped);
        buffer.unmap();
        Ok(buffer)
    }
}

/// All edges of the mesh.
fn edges(mesh: &TriMesh, edges: &Edges, progress: &Progress) -> Result<Vec<Edge>, RenderError> {
    let normals = par_collect(mesh.triangles().len(), progress, |triangle| {
        [normal(mesh.corners(triangle))]
    })?;
    Ok(par_collect(edges.len(), progress, |edge| {
        let sides = edges.sides(edge);
        let Side { low, high, .. } = sides[0];
        let normal_of = |side: &Side| normals[side.triangle as usize];
        let first = normal_of(&sides[0]);
        let (kind, second) = match sides {
            [a, b] => {
                let second = normal_of(b);
                let is_twisted = a.forward == b.forward;
                if first == DVec3::ZERO || second == DVec3::ZERO {
                    (FLAT_EDGE, second)
                } else if is_twisted {
                    (BEND | TWISTED, -second)
                } else {
                    (BEND, second)
                }
            }
            _ => (FEATURE, first),
        };
        [Edge {
            ends: [low, high],
            normals: [first, second].map(|normal| octahedral(normal.as_vec3())),
            kind,
        }]
    })?)
}

fn marked_edges(edges: &[Edge], marked: Option<&MarkedEdges>) -> Vec<Edge> {
    let marked = marked.iter().flat_map(|marked| &marked.edges);
    let marked: KeyedSet<[u32; 2]> = marked.map(|&[a, b]| [a.min(b), a.max(b)]).collect();
    if marked.is_empty() {
        return Vec::new();
    }
    let is_marked = |edge: &&Edge| marked.contains(&edge.ends);
    edges.iter().filter(is_marked).copied().collect()
}

/// The kind of paint, and its colors or shares of the scale.
fn paints(paint: &Paint<'_>) -> (u32, Vec<u32>) {
    let bytes = |colors: &[crate::Rgb8]| {
        let packed = colors
            .iter()
            .map(|&[r, g, b]| u32::from_le_bytes([r, g, b, 255]));
        packed.collect()
    };
    let legend = paint.legend();
    // between corners values are mixed before they are cut off at the ends of the scale
    let share = |legend: Legend, value: f64| {
        let share = (value - legend.low) / (legend.high - legend.low);
        if value.is_nan() {
            NO_NUMBER
        } else if legend.low < legend.high {
            share.clamp(-MAX_SHARE, MAX_SHARE) as f32
        } else {
            0.5
        }
    };
    let shares = |values: &[f64]| {
        let share = |&value: &f64| {
            legend
                .map_or(NO_NUMBER, |legend| share(legend, value))
                .to_bits()
        };
        values.iter().map(share).collect()
    };
    match paint {
        Paint::Plain => (PLAIN, Vec::new()),
        Paint::VertexColors(colors) => (VERTEX_COLORS, bytes(colors)),
        Paint::FaceColors(colors) => (FACE_COLORS, bytes(colors)),
        Paint::VertexValues(values) => (VERTEX_VALUES, shares(values.values)),
        Paint::FaceValues(values) => (FACE_VALUES, shares(values.values)),
    }
}

/// Linear light of the scale of colors, and of what is not a number at its end.
fn scale(legend: Option<Legend>) -> Vec<[f32; 4]> {
    let Some(legend) = legend else {
        return vec![[0.0; 4]; 2];
    };
    let shares = (0..STEPS).map(|step| step as f64 / (STEPS - 1) as f64);
    let shares = shares.chain([f64::NAN]);
    shares
        .map(|share| legend.map.light(share).extend(1.0).to_array())
        .collect()
}

/// A unit vector as two numbers of 16 bits: its place on an octahedron that is unfolded to a square, within 0.005 degrees.
/// Zero has a code of its own.
fn octahedral(direction: Vec3) -> u32 {
    const ZERO: u32 = 0x8000_8000;
    let size = direction.abs().element_sum();
    if size == 0.0 || !size.is_finite() {
        return ZERO;
    }
    let [x, y, z] = (direction / size).to_array();
    let sign = |x: f32| if x >= 0.0 { 1.0 } else { -1.0 };
    let [x, y] = if z >= 0.0 {
        [x, y]
    } else {
        [(1.0 - y.abs()) * sign(x), (1.0 - x.abs()) * sign(y)]
    };
    let code = |x: f32| u32::from(((x * 32_767.0).round() as i16).cast_unsigned());
    code(x) | code(y) << 16
}

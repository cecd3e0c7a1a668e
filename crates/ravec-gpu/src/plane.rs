//! Pictures as fits and refinements read them: colors and the weight, as floats.

use crate::device::Gpu;
use crate::error::Failure;
use crate::upload::{GpuPixel, source_constants};
use crate::work::Run;
use ravec_raster::Image;
use std::ops::Range;
use std::sync::Arc;

/// Pixels of a plane: 64 MiB, half of the default limit of WebGPU for a binding. Enough to fill a large device a few times, and
/// few enough that some planes of a large picture are in flight.
pub(crate) const MAX_PLANE_PIXELS: usize = 4 << 20;

/// Bytes of a pixel of a plane.
pub(crate) const PLANE_PIXEL_BYTES: usize = 16;

#[repr(C)]
#[derive(Clone, Copy, bytemuck::NoUninit)]
struct Params {
    zero: u32,
    count: u32,
    width: u32,
    side: u32,
    columns_of_blocks: u32,
    blocks: u32,
}

/// Colors of a plane.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum PlaneColor {
    /// Oklab times the weight; what is not a number has no weight.
    Oklab,
    /// Linear light as it is.
    Linear,
}

/// The conversion of pixels of one type to planes.
pub(crate) struct Planes {
    kernel: Arc<wgpu::ComputePipeline>,
    light: Arc<wgpu::Buffer>,
}

/// A plane, and what its conversion reads.
pub(crate) struct Plane {
    pub buffer: wgpu::Buffer,
    pub source: wgpu::Buffer,
    params: wgpu::Buffer,
    count: usize,
}

impl Planes {
    /// The conversion to planes of these colors.
    pub fn new<P: GpuPixel>(gpu: &Gpu, color: PlaneColor) -> Result<Self, Failure> {
        let parts = [
            include_str!("shaders/exact.wgsl"),
            include_str!("shaders/color.wgsl"),
            include_str!("shaders/source.wgsl"),
            include_str!("shaders/weighted_oklab.wgsl"),
            include_str!("shaders/oklab.wgsl"),
        ];
        let is_linear = color == PlaneColor::Linear;
        let constants = format!(
            "{}\nconst LINEAR_PLANE: bool = {is_linear};",
            source_constants::<P>()
        );
        Ok(Self {
            kernel: gpu.kernel("fill_plane", &constants, &parts)?,
            light: gpu.light::<P>()?,
        })
    }
}

impl Plane {
    /// Uploads rows of a picture. Pixels are sorted by their place in blocks of `side` pixels; 1 keeps them in rows.
    pub fn new<P: GpuPixel>(
        gpu: &Gpu,
        image: &Image<P>,
        rows: Range<usize>,
        side: usize,
    ) -> Result<Self, Failure> {
        let source = gpu.upload_rows(image, rows.clone())?;
        Self::of_source(gpu, source, image.width(), rows.len(), side)
    }

    /// As [`Self::new`] for rows of `width` pixels that were uploaded.
    pub fn of_source(
        gpu: &Gpu,
        source: wgpu::Buffer,
        width: usize,
        rows: usize,
        side: usize,
    ) -> Result<Self, Failure> {
        let count = width * rows;
        let columns = width.div_ceil(side);
        let blocks = columns * rows.div_ceil(side);
        Ok(Self {
            source,
            buffer: gpu.output(PLANE_PIXEL_BYTES * blocks * side * side)?,
            params: gpu.uniform(&Params {
                zero: 0,
                count: count as u32,
                width: width as u32,
                side: side as u32,
                columns_of_blocks: columns as u32,
                blocks: blocks as u32,
            })?,
            count,
        })
    }

    /// The run that fills the plane.
    pub fn run<'a>(&'a self, planes: &'a Planes) -> Run<'a> {
        Run {
            kernel: &planes.kernel,
            bindings: vec![
                (0, &self.params),
                (1, &self.source),
                (2, &planes.light),
                (3, &self.buffer),
            ],
            threads: self.count,
        }
    }
}

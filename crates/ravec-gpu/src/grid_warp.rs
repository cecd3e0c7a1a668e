//! A retargeted picture, one pixel a thread.
//!
//! Bound: places differ from those of the CPU by at most 1e-3 old pixels, and light by at most 1e-3 of the contrast between
//! neighbors; samples of 8 bit by at most one step. Cost: as many old pixels a new one as on the CPU, 16 where the picture
//! grows.

use crate::device::Gpu;
use crate::error::{Failure, Stopped};
use crate::upload::{GpuPixel, source_constants};
use crate::work::{Pending, Run, bands};
use glam::DVec2;
use ravec_progress::Progress;
use ravec_raster::{Image, LinearRgba};
use ravec_retarget::{Deformation, RetargetError, WarpCell, WarpPlan, WarpSpan};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;

/// Pixels of a run: 64 MiB of results.
const RUN_PIXELS: usize = 4 << 20;

/// Bytes of old rows in a run, at most.
const MAX_SOURCE_BYTES: usize = 64 << 20;

#[repr(C)]
#[derive(Clone, Copy, bytemuck::NoUninit)]
struct Params {
    width: u32,
    count: u32,
    source_width: u32,
    source_height: u32,
    source_first_row: u32,
}

#[repr(C)]
#[derive(Clone, Copy, bytemuck::NoUninit)]
struct Span {
    first: u32,
    cell: u32,
    corner: [f32; 2],
    width: [f32; 2],
    step: [f32; 2],
}

impl From<&WarpSpan> for Span {
    fn from(span: &WarpSpan) -> Self {
        Self {
            first: span.first as u32,
            cell: span.cell as u32,
            corner: floats(span.corner),
            width: floats(span.width),
            step: floats(span.step),
        }
    }
}

#[repr(C)]
#[derive(Clone, Copy, bytemuck::NoUninit)]
struct Cell {
    e: [f32; 2],
    f: [f32; 2],
    g: [f32; 2],
    first: [i32; 2],
    rest: [f32; 2],
    extent: [f32; 2],
}

impl From<&WarpCell> for Cell {
    fn from(cell: &WarpCell) -> Self {
        Self {
            e: floats(cell.e),
            f: floats(cell.f),
            g: floats(cell.g),
            first: cell.first.floor().to_array().map(|v| v as i32),
            rest: floats(cell.first - cell.first.floor()),
            extent: floats(cell.extent),
        }
    }
}

fn floats(v: DVec2) -> [f32; 2] {
    v.as_vec2().to_array()
}

/// The new picture: what [`Deformation::warp`] gives, within the bound of this module. If the device is lost, the CPU warps.
///
/// # Errors
/// As [`Deformation::warp`].
pub fn warp_deformed<P: GpuPixel>(
    gpu: &Gpu,
    deformation: &Deformation,
    image: &Image<P>,
    progress: &Progress,
) -> Result<Image<P>, RetargetError> {
    let is_other = image.size() != deformation.source_size();
    if gpu.is_lost() || is_other || deformation.is_identity() {
        return deformation.warp(image, progress);
    }
    let size = deformation.size();
    let mut pixels = Vec::with_capacity(size.pixels());
    match warp_bands(gpu, deformation, image, progress, &mut pixels) {
        Ok(()) => {}
        Err(Stopped::Cancelled(cancelled)) => return Err(cancelled.into()),
        Err(Stopped::Failed(failure)) => {
            gpu.warn("the warp", &failure);
            return deformation.warp(image, progress);
        }
    }
    Image::from_vec(size.width(), pixels).or_else(|_| deformation.warp(image, progress))
}

fn warp_bands<P: GpuPixel>(
    gpu: &Gpu,
    deformation: &Deformation,
    image: &Image<P>,
    progress: &Progress,
    pixels: &mut Vec<P>,
) -> Result<(), Stopped> {
    let constants = format!(
        "{}\nconst HAS_ALPHA: bool = {};",
        source_constants::<P>(),
        P::HAS_ALPHA
    );
    let warp = Warp {
        gpu,
        image,
        width: deformation.size().width(),
        light: gpu.light::<P>()?,
        kernel: gpu.kernel(
            "grid_warp",
            &constants,
            &[
                include_str!("shaders/source.wgsl"),
                include_str!("shaders/grid_warp.wgsl"),
            ],
        )?,
    };
    let height = deformation.size().height();
    let phase = progress.phase("warp", height as u64);
    // bands that see no more of the old picture than a binding holds
    let old_rows = (MAX_SOURCE_BYTES / (image.width() * size_of::<P>())).max(1);
    let rows = (RUN_PIXELS / warp.width)
        .min(old_rows * height / image.height() / 2)
        .clamp(1, height);
    gpu.pipelined(
        bands(height, rows),
        progress,
        |rows| {
            Ok((
                (),
                warp.submit(&deformation.warp_plan(rows.clone()), &rows)?,
            ))
        },
        |rows, (), bytes| {
            let count = rows.len() * warp.width;
            let light: &[LinearRgba] =
                bytemuck::cast_slice(&bytes[..size_of::<LinearRgba>() * count]);
            pixels.par_extend(light.par_iter().map(|&pixel| P::from_linear(pixel)));
            phase.advance(rows.len() as u64);
            Ok(())
        },
    )
}

struct Warp<'a, P> {
    gpu: &'a Gpu,
    image: &'a Image<P>,
    /// Of the new picture.
    width: usize,
    light: Arc<wgpu::Buffer>,
    kernel: Arc<wgpu::ComputePipeline>,
}

impl<P: GpuPixel> Warp<'_, P> {
    fn submit(&self, plan: &WarpPlan, rows: &Range<usize>) -> Result<Pending, Failure> {
        let source_rows = plan.source_rows.clone();
        if source_rows.len() * self.image.width() * size_of::<P>() > 2 * MAX_SOURCE_BYTES {
            return Err(Failure::Memory);
        }
        let storage = wgpu::BufferUsages::STORAGE;
        let spans: Vec<Span> = plan.spans.iter().map(Span::from).collect();
        let cells: Vec<Cell> = plan.cells.iter().map(Cell::from).collect();
        let starts: Vec<u32> = plan.row_starts.iter().map(|&start| start as u32).collect();
        let spans = self.gpu.upload(bytemuck::cast_slice(&spans), storage)?;
        let cells = self.gpu.upload(bytemuck::cast_slice(&cells), storage)?;
        let starts = self.gpu.upload(bytemuck::cast_slice(&starts), storage)?;
        let source = self.gpu.upload_rows(self.image, source_rows.clone())?;
        let count = rows.len() * self.width;
        let params = self.gpu.uniform(&Params {
            width: self.width as u32,
            count: count as u32,
            source_width: self.image.width() as u32,
            source_height: self.image.height() as u32,
            source_first_row: source_rows.start as u32,
        })?;
        let bytes = size_of::<LinearRgba>() * count;
        let output = self.gpu.output(bytes)?;
        let run = Run {
            kernel: &self.kernel,
            bindings: vec![
                (0, &params),
                (1, &source),
                (2, &*self.light),
                (3, &spans),
                (4, &starts),
                (5, &cells),
                (6, &output),
            ],
            threads: count,
        };
        self.gpu.submit(&[run], &output, bytes)
    }
}

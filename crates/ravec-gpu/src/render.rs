//! Renderings of a field at any size, one pixel a thread.
//!
//! Bound: light differs from that of [`render_to`](ravec_twocolor::render_to) by at most 1e-5 of the largest light in the
//! block, since sums are taken with 24 bits. Cost: 48 bytes of a block and 16 bytes of a pixel are moved.

use crate::device::Gpu;
use crate::error::{Failure, Stopped};
use crate::work::{Pending, Run, bands};
use ravec_progress::{Cancelled, Progress};
use ravec_raster::color::linear_from_oklab;
use ravec_raster::{Image, LinearRgba, Oklab, Size};
use ravec_twocolor::{BlockField, TwoColorField, TwoColorPixel, render_mosaic, render_to};
use std::ops::Range;
use std::sync::Arc;

/// Pixels of a run: 64 MiB.
const RUN_PIXELS: usize = 4 << 20;

/// Bytes of the blocks of a run, at most: what WebGPU allows for a binding.
const MAX_BLOCK_BYTES: usize = 128 << 20;

/// The longest side of a picture on the device, whose squares fit the device's integers.
const MAX_SIDE: usize = 65_535;

/// Rendering style of a field.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum RenderStyle {
    /// Two colors, separated by the line of the block (default).
    #[default]
    TwoColors,
    /// The mean color of the block.
    Mosaic,
}

#[repr(C)]
#[derive(Clone, Copy, bytemuck::NoUninit)]
struct Params {
    from_width: u32,
    from_height: u32,
    to_width: u32,
    to_height: u32,
    side: u32,
    columns_of_blocks: u32,
    rows_of_blocks: u32,
    first_block_row: u32,
    first_row: u32,
    count: u32,
}

#[repr(C)]
#[derive(Clone, Copy, bytemuck::NoUninit)]
struct Paint {
    line: [f32; 4],
    sides: [[f32; 4]; 2],
}

impl Paint {
    fn two_colors(pixel: &TwoColorPixel) -> Self {
        Self {
            line: pixel.line.map_or([0.0; 4], |line| {
                [
                    line.normal.x as f32,
                    line.normal.y as f32,
                    line.offset_px as f32,
                    1.0,
                ]
            }),
            sides: [0, 1].map(|side| premultiplied(pixel.colors[side], pixel.alphas[side])),
        }
    }
}

fn premultiplied(color: Oklab, alpha: f32) -> [f32; 4] {
    let [r, g, b] = linear_from_oklab(color.0).map(|v| v * alpha);
    [r, g, b, alpha]
}

/// Renders `field` so that it fills `size`: what [`render_to`], or for mosaics [`render_mosaic`], gives, within the bound of
/// this module. If the device is lost, the CPU renders.
///
/// # Errors
/// [`Cancelled`] soon after `progress` is.
pub fn render_field(
    gpu: &Gpu,
    field: &TwoColorField,
    size: Size,
    style: RenderStyle,
    progress: &Progress,
) -> Result<Image<LinearRgba>, Cancelled> {
    let on_cpu = || match style {
        RenderStyle::TwoColors => render_to(field, size, progress),
        RenderStyle::Mosaic => render_mosaic(field, size, progress),
    };
    let sides = [size, field.image_size()].map(|size| size.width().max(size.height()));
    if gpu.is_lost() || sides.into_iter().any(|side| side > MAX_SIDE) {
        return on_cpu();
    }
    let mut pixels = Vec::with_capacity(size.pixels());
    match render_bands(gpu, field, size, style, progress, &mut pixels) {
        Ok(()) => Image::from_vec(size.width(), pixels).or_else(|_| on_cpu()),
        Err(Stopped::Cancelled(cancelled)) => Err(cancelled),
        Err(Stopped::Failed(failure)) => {
            gpu.warn("the rendering", &failure);
            on_cpu()
        }
    }
}

fn render_bands(
    gpu: &Gpu,
    field: &TwoColorField,
    size: Size,
    style: RenderStyle,
    progress: &Progress,
    pixels: &mut Vec<LinearRgba>,
) -> Result<(), Stopped> {
    let renderer = Renderer {
        gpu,
        field,
        size,
        style,
        kernel: gpu.kernel(
            "render",
            "",
            &[
                include_str!("shaders/area.wgsl"),
                include_str!("shaders/render.wgsl"),
            ],
        )?,
    };
    let phase = progress.phase("render", size.height() as u64);
    let rows = renderer.rows_in_a_run()?;
    gpu.pipelined(
        bands(size.height(), rows),
        progress,
        |rows| Ok(((), renderer.submit(rows)?)),
        |rows, (), bytes| {
            let count = rows.len() * size.width();
            pixels.extend_from_slice(bytemuck::cast_slice(
                &bytes[..size_of::<LinearRgba>() * count],
            ));
            phase.advance(rows.len() as u64);
            Ok(())
        },
    )
}

struct Renderer<'a> {
    gpu: &'a Gpu,
    field: &'a TwoColorField,
    size: Size,
    style: RenderStyle,
    kernel: Arc<wgpu::ComputePipeline>,
}

impl Renderer<'_> {
    /// Block rows under rows of the rendering.
    fn block_rows(&self, rows: &Range<usize>) -> Range<usize> {
        let (from, to) = (self.field.image_size().height(), self.size.height());
        let first = rows.start * from / to / self.field.block_px();
        let end = (rows.end * from)
            .div_ceil(to)
            .div_ceil(self.field.block_px());
        first..end.min(self.field.grid_size().height())
    }

    fn rows_in_a_run(&self) -> Result<usize, Failure> {
        let mut rows = (RUN_PIXELS / self.size.width()).max(1);
        loop {
            let blocks = (self.block_rows(&(0..rows)).len() + 1) * self.field.grid_size().width();
            if blocks * size_of::<Paint>() <= MAX_BLOCK_BYTES {
                return Ok(rows);
            }
            if rows == 1 {
                return Err(Failure::Memory);
            }
            rows /= 2;
        }
    }

    fn submit(&self, rows: Range<usize>) -> Result<Pending, Failure> {
        let (image_size, grid, side) = (
            self.field.image_size(),
            self.field.grid_size(),
            self.field.block_px(),
        );
        let block_rows = self.block_rows(&rows);
        let paints: Vec<Paint> = match self.style {
            RenderStyle::TwoColors => self.field.blocks()
                [block_rows.start * grid.width()..block_rows.end * grid.width()]
                .iter()
                .map(Paint::two_colors)
                .collect(),
            RenderStyle::Mosaic => {
                let pixel_rows =
                    block_rows.start * side..(block_rows.end * side).min(image_size.height());
                let blocks = self.field.blocks_in_rows(pixel_rows);
                blocks
                    .map(|block| {
                        let (color, alpha) = block.mean(image_size);
                        Paint {
                            line: [0.0; 4],
                            sides: [premultiplied(color, alpha); 2],
                        }
                    })
                    .collect()
            }
        };
        let paints = self
            .gpu
            .upload(bytemuck::cast_slice(&paints), wgpu::BufferUsages::STORAGE)?;
        let count = rows.len() * self.size.width();
        let params = self.gpu.uniform(&Params {
            from_width: image_size.width() as u32,
            from_height: image_size.height() as u32,
            to_width: self.size.width() as u32,
            to_height: self.size.height() as u32,
            side: side as u32,
            columns_of_blocks: grid.width() as u32,
            rows_of_blocks: grid.height() as u32,
            first_block_row: block_rows.start as u32,
            first_row: rows.start as u32,
            count: count as u32,
        })?;
        let bytes = size_of::<LinearRgba>() * count;
        let output = self.gpu.output(bytes)?;
        let run = Run {
            kernel: &self.kernel,
            bindings: vec![(0, &params), (1, &paints), (2, &output)],
            threads: count,
        };
        self.gpu.submit(&[run], &output, bytes)
    }
}

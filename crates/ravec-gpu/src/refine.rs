//! Lines of a field to a fraction of a pixel, one block a thread.
//!
//! Bounds: the device computes with 24 bits where the CPU has 53. Over all scenes half of the lines are within 1e-5 pixels of
//! those of the CPU and 98 of 100 within 0.01; the rest lie in blocks that see one side in a single row, where many lines are
//! equally good, and the squared error of all differs by less than 0.1 %. Cost: nine fits of one line to the pixels of the
//! block.

use crate::device::Gpu;
use crate::error::{Failure, Stopped};
use crate::plane::{MAX_PLANE_PIXELS, Plane, PlaneColor, Planes};
use crate::upload::GpuPixel;
use crate::work::{Pending, Run, Words, bands};
use glam::DVec2;
use ravec_progress::{Cancelled, Progress};
use ravec_raster::Image;
use ravec_raster::Oklab;
use ravec_raster::color::oklab_from_linear;
use ravec_twocolor::{Line, TwoColorField, TwoColorPixel, refine_line};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;

/// Words that the kernel stores for a block: see `refine.wgsl`.
const WORDS: usize = 10;
const UNCHANGED: u32 = 0;
const REFINED: u32 = 1;

/// Gauss-Newton steps, and halvings of each, as on the CPU.
const STEPS: u32 = 2;
const HALVINGS: u32 = 4;

#[repr(C)]
#[derive(Clone, Copy, bytemuck::NoUninit)]
struct Params {
    width: u32,
    rows: u32,
    columns_of_blocks: u32,
    blocks: u32,
    side: u32,
    pixels: u32,
    steps: u32,
    halvings: u32,
}

/// Moves the lines of `field` between pixel centers: what [`TwoColorField::refine_lines`] does, within the bounds of this
/// module. If the device is lost, the CPU refines the rest.
///
/// # Errors
/// [`Cancelled`] soon after `progress` is; the field is then as it was.
///
/// # Panics
/// If `image` has another size than the fitted one.
pub fn refine_lines<P: GpuPixel>(
    gpu: &Gpu,
    field: &mut TwoColorField,
    image: &Image<P>,
    progress: &Progress,
) -> Result<(), Cancelled> {
    if gpu.is_lost() {
        return field.refine_lines(image, progress);
    }
    assert_eq!(
        image.size(),
        field.image_size(),
        "the image is not the one that was fitted"
    );
    let mut blocks = Vec::with_capacity(field.blocks().len());
    match refine_bands(gpu, field, image, progress, &mut blocks) {
        Ok(()) => {}
        Err(Stopped::Cancelled(cancelled)) => return Err(cancelled),
        Err(Stopped::Failed(failure)) => {
            gpu.warn("the refinement", &failure);
            let first = blocks.len();
            let rest = &field.blocks()[first..];
            let rest = refine_rest(image, field.block_px(), rest, first, progress)?;
            blocks.extend(rest);
        }
    }
    *field = TwoColorField::from_blocks(field.image_size(), field.block_px(), blocks);
    Ok(())
}

fn refine_bands<P: GpuPixel>(
    gpu: &Gpu,
    field: &TwoColorField,
    image: &Image<P>,
    progress: &Progress,
    blocks: &mut Vec<TwoColorPixel>,
) -> Result<(), Stopped> {
    let side = field.block_px();
    let refiner = Refiner::new(gpu, image, side)?;
    let grid = field.grid_size();
    let of_rows =
        |rows: &Range<usize>| &field.blocks()[rows.start * grid.width()..rows.end * grid.width()];
    let phase = progress.phase("refine", grid.height() as u64);
    let rows = (MAX_PLANE_PIXELS / (grid.width() * side * side)).max(1);
    gpu.pipelined(
        bands(grid.height(), rows),
        progress,
        |rows| {
            let pixel_rows = rows.start * side..(rows.end * side).min(image.height());
            let source = gpu.upload_rows(image, pixel_rows)?;
            Ok(((), refiner.submit(&rows, of_rows(&rows), source)?))
        },
        |rows, (), bytes| {
            phase.advance(rows.len() as u64);
            blocks.extend(refiner.refined(&rows, of_rows(&rows), bytes));
            Ok(())
        },
    )
}

/// State shared by the bands of a picture.
pub(crate) struct Refiner<'a, P> {
    gpu: &'a Gpu,
    image: &'a Image<P>,
    side: usize,
    columns: usize,
    planes: Planes,
    kernel: Arc<wgpu::ComputePipeline>,
}

impl<'a, P: GpuPixel> Refiner<'a, P> {
    pub fn new(gpu: &'a Gpu, image: &'a Image<P>, side: usize) -> Result<Self, Failure> {
        Ok(Self {
            gpu,
            image,
            side,
            columns: image.size().cells(side).width(),
            planes: Planes::new::<P>(gpu, PlaneColor::Linear)?,
            kernel: gpu.kernel(
                "refine",
                "",
                &[
                    include_str!("shaders/area.wgsl"),
                    include_str!("shaders/refine.wgsl"),
                ],
            )?,
        })
    }

    /// Starts the refinement of the blocks of a band, whose rows of pixels are `source`.
    pub fn submit(
        &self,
        block_rows: &Range<usize>,
        blocks: &[TwoColorPixel],
        source: wgpu::Buffer,
    ) -> Result<Pending, Failure> {
        let side = self.side;
        let (width, height) = (self.image.width(), self.image.height());
        let rows = (block_rows.end * side).min(height) - block_rows.start * side;
        let lines: Vec<[f32; 4]> = blocks.iter().map(line_of).collect();
        let lines = self
            .gpu
            .upload(bytemuck::cast_slice(&lines), wgpu::BufferUsages::STORAGE)?;
        let params = self.gpu.uniform(&Params {
            width: width as u32,
            rows: rows as u32,
            columns_of_blocks: self.columns as u32,
            blocks: blocks.len() as u32,
            side: side as u32,
            pixels: (side * side) as u32,
            steps: STEPS,
            halvings: HALVINGS,
        })?;
        let plane = Plane::of_source(self.gpu, source, width, rows, side)?;
        let bytes = 4 * WORDS * blocks.len();
        let output = self.gpu.output(bytes)?;
        let run = Run {
            kernel: &self.kernel,
            bindings: vec![(0, &params), (1, &plane.buffer), (2, &lines), (3, &output)],
            threads: blocks.len(),
        };
        self.gpu
            .submit(&[plane.run(&self.planes), run], &output, bytes)
    }

    /// The refined blocks of a band, from the results of the kernel.
    pub fn refined(
        &self,
        block_rows: &Range<usize>,
        blocks: &[TwoColorPixel],
        bytes: &[u8],
    ) -> Vec<TwoColorPixel> {
        let words = Words::new(bytes);
        let first = block_rows.start * self.columns;
        let refined = blocks.par_iter().enumerate().map(|(index, pixel)| {
            let at = WORDS * index;
            match words.word(at) {
                UNCHANGED => *pixel,
                REFINED => {
                    let [x, y, offset] = words.floats(at + 1).map(f64::from);
                    TwoColorPixel {
                        line: Some(Line {
                            normal: DVec2::new(x, y).normalize(),
                            offset_px: offset,
                        }),
                        colors: [at + 4, at + 7]
                            .map(|at| Oklab(oklab_from_linear(words.floats(at)))),
                        ..*pixel
                    }
                }
                // a block with values that are no numbers
                _ => refine_on_cpu(self.image, first + index, self.columns, self.side, pixel),
            }
        });
        refined.collect()
    }
}

/// Refines a block by its number in the field.
fn refine_on_cpu<P: GpuPixel>(
    image: &Image<P>,
    block: usize,
    columns: usize,
    side: usize,
    pixel: &TwoColorPixel,
) -> TwoColorPixel {
    let corner = [block % columns * side, block / columns * side];
    refine_line(image, corner, side, pixel)
}

/// Refines `blocks`, of which the first one has the number `first` in the field, on the CPU.
pub(crate) fn refine_rest<P: GpuPixel>(
    image: &Image<P>,
    side: usize,
    blocks: &[TwoColorPixel],
    first: usize,
    progress: &Progress,
) -> Result<Vec<TwoColorPixel>, Cancelled> {
    let columns = image.size().cells(side).width();
    let refined = blocks.par_iter().enumerate().map(|(index, pixel)| {
        progress.check()?;
        Ok(refine_on_cpu(image, first + index, columns, side, pixel))
    });
    refined.collect()
}

/// The line of a block, and 1 if it can be refined: flat blocks cannot, nor those with transparency on one side only.
fn line_of(pixel: &TwoColorPixel) -> [f32; 4] {
    match pixel.line {
        Some(line) if pixel.alphas[0] == pixel.alphas[1] => [
            line.normal.x as f32,
            line.normal.y as f32,
            line.offset_px as f32,
            1.0,
        ],
        _ => [0.0; 4],
    }
}

//! The two-color operator at every pixel, one window a thread.
//!
//! Bounds: abstract and smooth give the bits of the CPU, except in opaque windows beside transparency or the border: the CPU
//! may fit these with weights, and the two differ by rounding, at most 1e-5. Sharpen and antialias use the area of a pixel beside the line, which the CPU
//! computes with more digits: their light differs by at most 1e-4. Cost: as a fit of one block a pixel.

use crate::device::Gpu;
use crate::error::{Failure, Stopped};
use crate::fit::{SweepBuffers, sweep_constants};
use crate::plane::{Plane, PlaneColor, Planes};
use crate::upload::{GpuPixel, source_constants};
use crate::work::{Pending, Run, rest_of};
use ravec_progress::Progress;
use ravec_raster::{Image, LinearRgba, Rect};
use ravec_twocolor::{FilterError, Mode, OperatorParams, SweepTable, operate};
use std::sync::Arc;

/// The largest window on the device; larger ones take more private memory than a group of threads should.
pub const MAX_WINDOW_PX: usize = 17;

/// Pixels of a run: a few tenths of a second on a slow device, so that its watchdog stays quiet and a cancellation is prompt.
const RUN_PIXELS: usize = 1 << 19;

#[repr(C)]
#[derive(Clone, Copy, bytemuck::NoUninit)]
struct Params {
    zero: u32,
    width: u32,
    height: u32,
    first_row: u32,
    left: u32,
    top: u32,
    columns: u32,
    count: u32,
    side: u32,
    pixels: u32,
    events: u32,
    mode: u32,
    strength: f32,
    flat: f32,
}

const PARTS: [&str; 8] = [
    include_str!("shaders/exact.wgsl"),
    include_str!("shaders/color.wgsl"),
    include_str!("shaders/source.wgsl"),
    include_str!("shaders/weights.wgsl"),
    include_str!("shaders/sweep.wgsl"),
    include_str!("shaders/weighted_sweep.wgsl"),
    include_str!("shaders/area.wgsl"),
    include_str!("shaders/dense.wgsl"),
];

/// Number of a mode in `dense.wgsl`.
fn mode_number(mode: Mode) -> Option<u32> {
    match mode {
        Mode::Abstract => Some(0),
        Mode::Smooth => Some(1),
        Mode::Sharpen => Some(2),
        Mode::Antialias => Some(3),
        Mode::Clean | Mode::Stamp => None,
    }
}

/// The pixels of `region` after the operator: what [`operate`] gives, within the bounds of this module.
///
/// The device computes abstract, smooth, sharpen and antialias in windows of up to [`MAX_WINDOW_PX`]; the rest, and what a
/// device leaves that is lost, is computed on the CPU.
///
/// # Errors
/// As [`operate`].
pub fn operate_on<P: GpuPixel>(
    gpu: &Gpu,
    image: &Image<P>,
    region: Rect,
    params: &OperatorParams,
    progress: &Progress,
) -> Result<Image<LinearRgba>, FilterError> {
    let mode = mode_number(params.mode).filter(|_| params.window_px <= MAX_WINDOW_PX);
    let Some(mode) = mode.filter(|_| !gpu.is_lost()) else {
        return operate(image, region, params, progress);
    };
    params.check()?;
    let regions = params.regions(region, image.size())?;
    let mut regions = regions.into_iter();
    let Some(mut at) = regions.next() else {
        return operate(image, region, params, progress);
    };
    let mut current = step(gpu, image, at, params, mode, progress)?;
    for next in regions {
        let inner = Rect::new(
            next.col - at.col,
            next.row - at.row,
            next.width,
            next.height,
        );
        current = step(gpu, &current, inner, params, mode, progress)?;
        at = next;
    }
    Ok(current)
}

/// One application.
fn step<P: GpuPixel>(
    gpu: &Gpu,
    image: &Image<P>,
    region: Rect,
    params: &OperatorParams,
    mode: u32,
    progress: &Progress,
) -> Result<Image<LinearRgba>, FilterError> {
    let size = region.size().ok_or(FilterError::EmptyRegion)?;
    let mut pixels = Vec::with_capacity(size.pixels());
    match step_bands(gpu, image, region, params, mode, progress, &mut pixels) {
        Ok(()) => {}
        Err(Stopped::Cancelled(cancelled)) => return Err(cancelled.into()),
        Err(Stopped::Failed(failure)) => {
            gpu.warn("the operator", &failure);
            let rest = rest_of(region, pixels.len() / region.width);
            let once = OperatorParams {
                iterations: 1,
                ..params.clone()
            };
            pixels.extend_from_slice(operate(image, rest, &once, progress)?.pixels());
        }
    }
    Image::from_vec(size.width(), pixels).map_err(|_| FilterError::EmptyRegion)
}

fn step_bands<P: GpuPixel>(
    gpu: &Gpu,
    image: &Image<P>,
    region: Rect,
    params: &OperatorParams,
    mode: u32,
    progress: &Progress,
    pixels: &mut Vec<LinearRgba>,
) -> Result<(), Stopped> {
    let operator = Operator::new(gpu, image, params, mode)?;
    let phase = progress.phase("windows", region.height as u64);
    let rows = (RUN_PIXELS / image.width()).max(1);
    let bands = (region.row..region.bottom()).step_by(rows).map(|row| {
        Rect::new(
            region.col,
            row,
            region.width,
            rows.min(region.bottom() - row),
        )
    });
    gpu.pipelined(
        bands,
        progress,
        |band| Ok(((), operator.submit(band)?)),
        |band, (), bytes| {
            let bytes = &bytes[..size_of::<LinearRgba>() * band.pixels()];
            pixels.extend_from_slice(bytemuck::cast_slice(bytes));
            phase.advance(band.height as u64);
            Ok(())
        },
    )
}

/// State shared by the bands of a picture.
struct Operator<'a, P> {
    gpu: &'a Gpu,
    image: &'a Image<P>,
    params: &'a OperatorParams,
    mode: u32,
    planes: Planes,
    light: Arc<wgpu::Buffer>,
    sweep: SweepBuffers,
    kernel: Arc<wgpu::ComputePipeline>,
}

impl<'a, P: GpuPixel> Operator<'a, P> {
    fn new(
        gpu: &'a Gpu,
        image: &'a Image<P>,
        params: &'a OperatorParams,
        mode: u32,
    ) -> Result<Self, Failure> {
        let side = params.window_px;
        let constants = format!("{}\n{}", source_constants::<P>(), sweep_constants(side));
        Ok(Self {
            gpu,
            image,
            params,
            mode,
            planes: Planes::new::<P>(gpu, PlaneColor::Oklab)?,
            light: gpu.light::<P>()?,
            sweep: SweepBuffers::new(gpu, side)?,
            kernel: gpu.kernel("dense", &constants, &PARTS)?,
        })
    }

    fn submit(&self, band: Rect) -> Result<Pending, Failure> {
        let side = self.params.window_px;
        let first_row = band.row.saturating_sub(side / 2);
        let rows = first_row..(band.bottom() + side / 2).min(self.image.height());
        let plane = Plane::new(self.gpu, self.image, rows, 1)?;
        let flat = self.params.window().flat_contrast;
        let params = self.gpu.uniform(&Params {
            zero: 0,
            width: self.image.width() as u32,
            height: self.image.height() as u32,
            first_row: first_row as u32,
            left: band.col as u32,
            top: band.row as u32,
            columns: band.width as u32,
            count: band.pixels() as u32,
            side: side as u32,
            pixels: (side * side) as u32,
            events: SweepTable::new(side).events().len() as u32,
            mode: self.mode,
            strength: self.params.strength,
            flat: 0.25 * flat * flat,
        })?;
        let bytes = size_of::<LinearRgba>() * band.pixels();
        let output = self.gpu.output(bytes)?;
        let mut bindings = vec![
            (0, &params),
            (1, &plane.source),
            (2, &*self.light),
            (7, &plane.buffer),
            (8, &output),
        ];
        bindings.extend(self.sweep.opaque_bindings());
        let run = Run {
            kernel: &self.kernel,
            bindings,
            threads: band.pixels(),
        };
        self.gpu
            .submit(&[plane.run(&self.planes), run], &output, bytes)
    }
}

//! The fit coarse to fine, level by level.
//!
//! ```text
//! for each band of block rows, several in flight:
//!     upload its pixels; add up each block                               a block a thread
//!     halve the blocks down to at most 16 pixels a side                   a pixel a thread
//!     the best splits of two sectors of angle there                       a block a thread
//!     for each finer level:
//!         running sums along rows and columns                             a row or column a thread
//!         move both lines of a block over a grid, then climb              a candidate a thread
//!     lines and colors follow on the CPU
//! ```
//!
//! Guarantee: the field is that of [`TwoColorField::fit`](ravec_twocolor::TwoColorField::fit), bit for bit, as for the exact
//! fit: besides products and quotients, square roots are corrected in integers.
//!
//! Cost: a block of side N takes the exact fit of its reduction and about 70 lines of N sums at each level. Of the memory of
//! a band two thirds are running sums, 32 bytes a pixel.

use crate::device::Gpu;
use crate::error::{Failure, Stopped};
use crate::fit::{SweepBuffers, sweep_constants};
use crate::plane::{MAX_PLANE_PIXELS, PLANE_PIXEL_BYTES, Plane, PlaneColor, Planes};
use crate::upload::GpuPixel;
use crate::work::{GROUP, Pending, Run, Words, bands};
use ravec_progress::Progress;
use ravec_raster::Image;
use ravec_twocolor::{FitParams, MIN_FITTED_WEIGHT, RefinedSplit, SweepTable, TwoColorPixel};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;

/// Sides of blocks that are fitted coarse to fine on the device: powers of two, whose shares are exact.
pub const COARSE_TO_FINE_SIDES: [usize; 4] = [8, 16, 32, 64];

/// The largest side that is fitted exactly on the way: that of the CPU.
const EXACT_SIDE: usize = 16;

/// Words of a block in `coarse.wgsl`: its sums, two lines, and its result.
const BLOCK_WORDS: usize = 11;
const START_WORDS: usize = 8;
const WORDS: usize = 15;

/// Threads of the refinement for a block: 16 for each of two lines.
const REFINING_THREADS: usize = GROUP as usize / 2;

/// Pixels of a band: half of those of a plane, since their running sums take twice its bytes.
const MAX_BAND_PIXELS: usize = MAX_PLANE_PIXELS / 2;

#[repr(C)]
#[derive(Clone, Copy, bytemuck::NoUninit)]
struct Params {
    zero: u32,
    width: u32,
    rows: u32,
    columns_of_blocks: u32,
    blocks: u32,
    side: u32,
    pixels: u32,
    events: u32,
    factor: u32,
    pixel_share: f32,
    inverse_side: f32,
    is_finest: u32,
}

const EXACT: &str = include_str!("shaders/exact.wgsl");
const LEVELS: &str = include_str!("shaders/coarse.wgsl");
const WEIGHTS: &str = include_str!("shaders/weights.wgsl");

/// The sides of all levels, the finest first. The first reduction makes the fit cheap, so that there is always one.
fn level_sides(side: usize) -> Vec<usize> {
    let mut sides = vec![side, side / 2];
    while let Some(&last) = sides.last()
        && last > EXACT_SIDE
    {
        sides.push(last / 2);
    }
    sides
}

/// True if a row of blocks is small enough for a band.
pub(crate) fn fits(width: usize, side: usize) -> bool {
    width.div_ceil(side) * side * side <= MAX_BAND_PIXELS
}

/// Fits band after band and appends whole bands to `blocks`.
pub(crate) fn fit_bands<P: GpuPixel>(
    gpu: &Gpu,
    image: &Image<P>,
    params: &FitParams,
    progress: &Progress,
    blocks: &mut Vec<TwoColorPixel>,
) -> Result<(), Stopped> {
    let fitter = Fitter::new(gpu, image, params)?;
    let grid = image.size().cells(params.block_px);
    let phase = progress.phase("fit", grid.height() as u64);
    let row = grid.width() * params.block_px * params.block_px;
    gpu.pipelined(
        bands(grid.height(), (MAX_BAND_PIXELS / row).max(1)),
        progress,
        |rows| Ok(((), fitter.submit(rows)?)),
        |rows, (), bytes| {
            phase.advance(rows.len() as u64);
            let words = Words::new(bytes);
            blocks.par_extend(
                (0..grid.width() * rows.len())
                    .into_par_iter()
                    .map(|block| refined_split(&words, WORDS * block).pixel(params.flat_contrast)),
            );
            Ok(())
        },
    )
}

fn refined_split(words: &Words<'_>, at: usize) -> RefinedSplit {
    let [offset, gain, energy] = words.floats(at + 2);
    RefinedSplit {
        normal: words.floats(at),
        offset,
        gain,
        energy,
        mean: words.floats(at + 5),
        sum_0: words.floats(at + 8),
        weights: words.floats(at + 11),
        insides: words.floats(at + 13),
    }
}

/// Kernels and tables that the bands of a picture share.
struct Fitter<'a, P> {
    gpu: &'a Gpu,
    image: &'a Image<P>,
    /// The finest first.
    sides: Vec<usize>,
    columns: usize,
    planes: Planes,
    sweep: SweepBuffers,
    sectors: Arc<wgpu::Buffer>,
    center: Arc<wgpu::ComputePipeline>,
    /// From the image, and from a level.
    reduce: [Arc<wgpu::ComputePipeline>; 2],
    opaque_starts: Arc<wgpu::ComputePipeline>,
    weighted_starts: Arc<wgpu::ComputePipeline>,
    /// Of the image, and of a level.
    prefixes: [Arc<wgpu::ComputePipeline>; 2],
    refine: Arc<wgpu::ComputePipeline>,
}

/// A level of the blocks of a band.
struct LevelBuffers {
    params: wgpu::Buffer,
    side: usize,
    /// The pixels, but for the finest level.
    pixels: Option<wgpu::Buffer>,
    /// Running sums, but for the coarsest level.
    prefixes: Option<wgpu::Buffer>,
}

impl<'a, P: GpuPixel> Fitter<'a, P> {
    fn new(gpu: &'a Gpu, image: &'a Image<P>, params: &FitParams) -> Result<Self, Failure> {
        let sides = level_sides(params.block_px);
        let coarsest = *sides.last().unwrap_or(&params.block_px);
        let least = format!("const MIN_WEIGHT: f32 = {MIN_FITTED_WEIGHT:e};");
        let by_source = |entry: &str, part: &str| -> Result<_, Failure> {
            let of = |from_image: bool| {
                let constants = format!("const FROM_IMAGE: bool = {from_image};");
                let pixels = include_str!("shaders/coarse_pixels.wgsl");
                gpu.kernel(entry, &constants, &[EXACT, LEVELS, pixels, part])
            };
            Ok([of(true)?, of(false)?])
        };
        let starts = |entry: &str| {
            let constants = format!(
                "{}\nconst SECTORS: u32 = {}u;\nconst START_SHARE: f32 = {:e};",
                sweep_constants(coarsest),
                SweepTable::new(coarsest).sectors().len() - 1,
                RefinedSplit::START_SHARE,
            );
            let parts = [
                EXACT,
                LEVELS,
                WEIGHTS,
                include_str!("shaders/sweep.wgsl"),
                include_str!("shaders/weighted_sweep.wgsl"),
                include_str!("shaders/coarse_starts.wgsl"),
            ];
            gpu.kernel(entry, &constants, &parts)
        };
        let refinement = format!(
            "const GRID_STEP: f32 = {:e};\nconst CLIMB_STEP: f32 = {:e};\nconst CLIMB_ROUNDS: u32 = {}u;\nconst MIN_SHARED: f32 = {:e};",
            RefinedSplit::GRID_STEP,
            RefinedSplit::CLIMB_STEP,
            RefinedSplit::CLIMB_ROUNDS,
            RefinedSplit::MIN_SHARED,
        );
        Ok(Self {
            gpu,
            image,
            columns: image.size().cells(params.block_px).width(),
            planes: Planes::new::<P>(gpu, PlaneColor::Oklab)?,
            sweep: SweepBuffers::new(gpu, coarsest)?,
            sectors: gpu.table(&format!("sectors {coarsest}"), || {
                SweepTable::new(coarsest).sectors()
            })?,
            center: gpu.kernel(
                "center_blocks",
                &least,
                &[
                    EXACT,
                    LEVELS,
                    WEIGHTS,
                    include_str!("shaders/coarse_center.wgsl"),
                ],
            )?,
            reduce: by_source("reduce", include_str!("shaders/coarse_reduce.wgsl"))?,
            opaque_starts: starts("opaque_starts")?,
            weighted_starts: starts("weighted_starts")?,
            prefixes: by_source("add_prefixes", include_str!("shaders/coarse_prefixes.wgsl"))?,
            refine: gpu.kernel(
                "refine",
                &refinement,
                &[EXACT, LEVELS, include_str!("shaders/coarse_refine.wgsl")],
            )?,
            sides,
        })
    }

    fn finest(&self) -> usize {
        self.sides[0]
    }

    /// The buffers of the levels of a band, the finest first.
    fn levels(&self, rows: usize, blocks: usize) -> Result<Vec<LevelBuffers>, Failure> {
        let last = self.sides.len() - 1;
        let level = |(number, &side): (usize, &usize)| -> Result<LevelBuffers, Failure> {
            let factor = self.finest() / side;
            let events = if number == last {
                SweepTable::new(side).events().len()
            } else {
                0
            };
            let bytes = |pixels: usize| self.gpu.output(PLANE_PIXEL_BYTES * blocks * pixels);
            Ok(LevelBuffers {
                params: self.gpu.uniform(&Params {
                    zero: 0,
                    width: self.image.width() as u32,
                    rows: rows as u32,
                    columns_of_blocks: self.columns as u32,
                    blocks: blocks as u32,
                    side: side as u32,
                    pixels: (side * side) as u32,
                    events: events as u32,
                    factor: factor as u32,
                    pixel_share: 1.0 / (factor * factor) as f32,
                    inverse_side: 1.0 / side as f32,
                    is_finest: u32::from(number == 0),
                })?,
                side,
                pixels: (number > 0).then(|| bytes(side * side)).transpose()?,
                prefixes: (number < last)
                    .then(|| bytes(2 * side * (side + 1)))
                    .transpose()?,
            })
        };
        self.sides.iter().enumerate().map(level).collect()
    }

    /// Starts all kernels of a band.
    fn submit(&self, block_rows: Range<usize>) -> Result<Pending, Failure> {
        let side = self.finest();
        let pixel_rows = block_rows.start * side..(block_rows.end * side).min(self.image.height());
        let blocks = self.columns * block_rows.len();
        let levels = self.levels(pixel_rows.len(), blocks)?;
        let plane = Plane::new(self.gpu, self.image, pixel_rows, side)?;
        let found = self.gpu.output(4 * BLOCK_WORDS * blocks)?;
        let lines = self.gpu.output(4 * START_WORDS * blocks)?;
        let output = self.gpu.output(4 * WORDS * blocks)?;

        let pixels = |level: &LevelBuffers| level.pixels.as_ref().unwrap_or(&plane.buffer).clone();
        let sources: Vec<wgpu::Buffer> = levels.iter().map(pixels).collect();
        let mut runs = vec![
            plane.run(&self.planes),
            Run {
                kernel: &self.center,
                bindings: vec![(0, &levels[0].params), (1, &plane.buffer), (2, &found)],
                threads: blocks,
            },
        ];
        for (number, level) in levels.iter().enumerate().skip(1) {
            let from_image = number == 1;
            runs.push(Run {
                kernel: &self.reduce[usize::from(!from_image)],
                bindings: vec![
                    (0, &level.params),
                    (1, &sources[number - 1]),
                    (2, &found),
                    (3, &sources[number]),
                ],
                threads: blocks * level.side * level.side,
            });
        }
        let last = levels.len() - 1;
        let coarsest = [
            (0, &levels[last].params),
            (1, &sources[last]),
            (2, &found),
            (7, &*self.sectors),
            (8, &lines),
        ];
        let mut bindings = coarsest.to_vec();
        bindings.extend(self.sweep.opaque_bindings());
        runs.push(Run {
            kernel: &self.opaque_starts,
            bindings,
            threads: blocks,
        });
        let mut bindings = coarsest.to_vec();
        bindings.extend(self.sweep.weighted_bindings());
        runs.push(Run {
            kernel: &self.weighted_starts,
            bindings,
            threads: blocks,
        });
        for (number, level) in levels.iter().enumerate().rev() {
            let Some(prefixes) = &level.prefixes else {
                continue;
            };
            runs.push(Run {
                kernel: &self.prefixes[usize::from(number > 0)],
                bindings: vec![
                    (0, &level.params),
                    (1, &sources[number]),
                    (2, &found),
                    (3, prefixes),
                ],
                threads: 2 * level.side * blocks,
            });
            runs.push(Run {
                kernel: &self.refine,
                bindings: vec![
                    (0, &level.params),
                    (1, prefixes),
                    (2, &found),
                    (3, &lines),
                    (4, &output),
                ],
                threads: REFINING_THREADS * blocks,
            });
        }
        self.gpu.submit(&runs, &output, 4 * WORDS * blocks)
    }
}

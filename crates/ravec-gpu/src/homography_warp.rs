//! A picture seen through a homography, one pixel a thread.
//!
//! Bound: light differs from that of [`warp`](ravec_planar::warp) by at most 2e-3 of the contrast in the footprint of a pixel,
//! except at pixels of a reduction that the two read from pictures halved a different number of times: there by what one
//! halving changes. Cost: as many pixels of the image a pixel as on the CPU.

use crate::device::Gpu;
use crate::error::{Failure, Stopped};
use crate::work::{Pending, Run, bands};
use glam::{DMat3, DVec2, dvec2};
use ravec_planar::{Beyond, Homography, WarpParts, warp};
use ravec_progress::{Cancelled, Progress};
use ravec_raster::{Image, PremulLinearRgba, Size};
use std::ops::Range;
use std::sync::Arc;

/// Side of a tile.
const TILE: usize = 32;

/// Pixels of a run: 16 MiB of results.
const RUN_PIXELS: usize = 1 << 20;

/// Bytes of the image and its reductions in a run, at most: what WebGPU allows for a binding.
const MAX_SOURCE_BYTES: usize = 128 << 20;

#[repr(C)]
#[derive(Clone, Copy, bytemuck::NoUninit)]
struct Tile {
    rows: [[f32; 4]; 3],
    origin: [i32; 2],
    padding: [i32; 2],
}

#[repr(C)]
#[derive(Clone, Copy, bytemuck::NoUninit)]
struct Level {
    start: u32,
    first_row: u32,
    end_row: u32,
    width: u32,
    height: u32,
    padding: [u32; 3],
}

#[repr(C)]
#[derive(Clone, Copy, bytemuck::NoUninit)]
struct Params {
    width: u32,
    first_row: u32,
    count: u32,
    tile_columns: u32,
    first_tile_row: u32,
    levels: u32,
    endless: u32,
    entries: u32,
    empty: [f32; 4],
}

/// The picture of `size` whose pixels look at `image` through `image_from_output`: what [`warp`] gives, within the bound of
/// this module. If the device is lost, or an image does not fit it, the CPU warps.
///
/// # Errors
/// [`Cancelled`] soon after `progress` is.
pub fn warp_homography(
    gpu: &Gpu,
    image: &Image<PremulLinearRgba>,
    image_from_output: &Homography,
    size: Size,
    beyond: Beyond<PremulLinearRgba>,
    progress: &Progress,
) -> Result<Image<PremulLinearRgba>, Cancelled> {
    let on_cpu = || warp(image, image_from_output, size, beyond, progress);
    if gpu.is_lost() {
        return on_cpu();
    }
    progress.check()?;
    let mut pixels = Vec::with_capacity(size.pixels());
    let halved = WarpParts::new(image, image_from_output, size).halved;
    let mut levels = vec![image];
    levels.extend(&halved);
    match warp_bands(
        gpu,
        &levels,
        image_from_output,
        size,
        beyond,
        progress,
        &mut pixels,
    ) {
        Ok(()) => Image::from_vec(size.width(), pixels).or_else(|_| on_cpu()),
        Err(Stopped::Cancelled(cancelled)) => Err(cancelled),
        Err(Stopped::Failed(failure)) => {
            gpu.warn("the warp", &failure);
            on_cpu()
        }
    }
}

fn warp_bands(
    gpu: &Gpu,
    levels: &[&Image<PremulLinearRgba>],
    map: &Homography,
    size: Size,
    beyond: Beyond<PremulLinearRgba>,
    progress: &Progress,
    pixels: &mut Vec<PremulLinearRgba>,
) -> Result<(), Stopped> {
    let constants = format!(
        "const TILE: u32 = {TILE}u;\nconst SUPPORT_SQ: f32 = {:?};",
        WarpParts::<PremulLinearRgba>::SUPPORT_SQ
    );
    let warper = Warper {
        gpu,
        levels,
        map,
        size,
        beyond,
        weights: gpu.table("warp kernel", || {
            WarpParts::<PremulLinearRgba>::kernel().to_vec()
        })?,
        kernel: gpu.kernel(
            "homography_warp",
            &constants,
            &[include_str!("shaders/homography_warp.wgsl")],
        )?,
    };
    let phase = progress.phase("warp", size.height() as u64);
    let mut parts = Vec::new();
    let rows = (RUN_PIXELS / size.width() / TILE).max(1) * TILE;
    for rows in bands(size.height(), rows) {
        warper.divide(rows, &mut parts)?;
    }
    gpu.pipelined(
        parts,
        progress,
        |rows| Ok(((), warper.submit(&rows)?)),
        |rows, (), bytes| {
            let count = rows.len() * size.width();
            pixels.extend_from_slice(bytemuck::cast_slice(
                &bytes[..size_of::<PremulLinearRgba>() * count],
            ));
            phase.advance(rows.len() as u64);
            Ok(())
        },
    )
}

struct Warper<'a> {
    gpu: &'a Gpu,
    /// The image, and that halved once, twice and so on.
    levels: &'a [&'a Image<PremulLinearRgba>],
    map: &'a Homography,
    size: Size,
    beyond: Beyond<PremulLinearRgba>,
    weights: Arc<wgpu::Buffer>,
    kernel: Arc<wgpu::ComputePipeline>,
}

impl Warper<'_> {
    /// Rows of each level that some rows of the output see.
    fn seen(&self, rows: &Range<usize>) -> Vec<Range<usize>> {
        let image = self.levels[0].size();
        let seen = WarpParts::<PremulLinearRgba>::seen_rows(
            image,
            self.map,
            self.size.width(),
            rows.clone(),
        );
        let levels = self.levels.iter().enumerate();
        levels
            .map(|(number, level)| {
                let first = (seen.start >> number)
                    .saturating_sub(1)
                    .min(level.height() - 1);
                first..((seen.end >> number) + 2).min(level.height())
            })
            .collect()
    }

    /// Divides rows of the output until what each part sees fits a binding.
    fn divide(&self, rows: Range<usize>, into: &mut Vec<Range<usize>>) -> Result<(), Failure> {
        let seen = self.seen(&rows);
        let pixels: usize = seen
            .iter()
            .zip(self.levels)
            .map(|(rows, level)| rows.len() * level.width())
            .sum();
        if pixels * size_of::<PremulLinearRgba>() <= MAX_SOURCE_BYTES {
            into.push(rows);
            return Ok(());
        }
        if rows.len() == 1 {
            return Err(Failure::Memory);
        }
        let middle = rows.start + rows.len() / 2;
        self.divide(rows.start..middle, into)?;
        self.divide(middle..rows.end, into)
    }

    /// The map of a tile, in coordinates that begin near it.
    fn tile(&self, col: usize, row: usize) -> Tile {
        let half = 0.5 * TILE as f64;
        let center = dvec2((col * TILE) as f64 + half, (row * TILE) as f64 + half);
        let at = self.map.try_apply(center).map_or(DVec2::ZERO, DVec2::floor);
        // numbers beyond this have no fractions in single precision anyway
        let origin = at.clamp(dvec2(-1e8, -1e8), dvec2(1e8, 1e8));
        let local =
            DMat3::from_translation(-origin) * self.map.matrix() * DMat3::from_translation(center);
        let rows = [0, 1, 2].map(|k| local.row(k).to_array());
        let largest = rows[2]
            .iter()
            .fold(f64::MIN_POSITIVE, |most, v| most.max(v.abs()));
        Tile {
            rows: rows.map(|[a, b, c]| [a, b, c, 0.0].map(|v| (v / largest) as f32)),
            origin: origin.to_array().map(|v| v as i32),
            padding: [0; 2],
        }
    }

    fn submit(&self, rows: &Range<usize>) -> Result<Pending, Failure> {
        let storage = wgpu::BufferUsages::STORAGE;
        let seen = self.seen(rows);
        let mut levels = Vec::with_capacity(seen.len());
        let mut pixels: Vec<PremulLinearRgba> = Vec::new();
        for (rows, level) in seen.iter().zip(self.levels) {
            levels.push(Level {
                start: pixels.len() as u32,
                first_row: rows.start as u32,
                end_row: rows.end as u32,
                width: level.width() as u32,
                height: level.height() as u32,
                padding: [0; 3],
            });
            pixels.extend_from_slice(
                &level.pixels()[rows.start * level.width()..rows.end * level.width()],
            );
        }
        let tile_rows = rows.start / TILE..rows.end.div_ceil(TILE);
        let tile_columns = self.size.width().div_ceil(TILE);
        let tiles: Vec<Tile> = tile_rows
            .clone()
            .flat_map(|row| (0..tile_columns).map(move |col| self.tile(col, row)))
            .collect();
        let source = self.gpu.upload(bytemuck::cast_slice(&pixels), storage)?;
        let level_table = self.gpu.upload(bytemuck::cast_slice(&levels), storage)?;
        let tiles = self.gpu.upload(bytemuck::cast_slice(&tiles), storage)?;
        let count = rows.len() * self.size.width();
        let (endless, empty) = match self.beyond {
            Beyond::Border => (1, [0.0; 4]),
            Beyond::Pixel(pixel) => (0, pixel.0),
        };
        let params = self.gpu.uniform(&Params {
            width: self.size.width() as u32,
            first_row: rows.start as u32,
            count: count as u32,
            tile_columns: tile_columns as u32,
            first_tile_row: tile_rows.start as u32,
            levels: levels.len() as u32,
            endless,
            entries: WarpParts::<PremulLinearRgba>::kernel().len() as u32,
            empty,
        })?;
        let bytes = size_of::<PremulLinearRgba>() * count;
        let output = self.gpu.output(bytes)?;
        let run = Run {
            kernel: &self.kernel,
            bindings: vec![
                (0, &params),
                (1, &source),
                (2, &level_table),
                (3, &tiles),
                (4, &*self.weights),
                (5, &output),
            ],
            threads: count,
        };
        self.gpu.submit(&[run], &output, bytes)
    }
}

//! Retargets folders of numbered frames and prints what it costs and how steady the result is.
//!
//! ```text
//! ffmpeg -i clip.mp4 frames/f_%04d.ppm
//! cargo run --release -p ravec-retarget --example retarget_clip -- 60 frames [more folders]
//! ```
//!
//! Frames are PPM files with 8 bits a sample, in the order of their names. If a folder holds a file `motions.txt`, each of its
//! lines has the nine numbers of the homography that leads to a frame from the one before, row by row, and `cut` where a shot
//! begins. Results go to the folder `out` beside the frames.
//!
//! Printed for each folder: CPU milliseconds a megapixel of frame without reading and writing, those of plain scaling, and
//! the mean change from frame to frame against that of plain scaling.

use glam::DMat3;
use ravec_progress::Progress;
use ravec_raster::{AnyImage, Image, ResizeFilter, Size, Srgb, resize};
use ravec_retarget::clip::{ClipFrame, ClipOptions, ClipRetargeter, FrameMotion};
use std::error::Error;
use std::path::{Path, PathBuf};
use std::{env, fs};

type Frame = Image<Srgb<u8>>;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = env::args().skip(1);
    let percent: usize = arguments
        .next()
        .ok_or("name the width in per cent, and folders of frames")?
        .parse()?;
    for folder in arguments {
        run(Path::new(&folder), percent)?;
    }
    Ok(())
}

#[expect(
    clippy::disallowed_methods,
    reason = "a half-written result of a measurement does no harm"
)]
fn run(folder: &Path, percent: usize) -> Result<(), Box<dyn Error>> {
    let mut paths: Vec<PathBuf> = fs::read_dir(folder)?
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| path.extension().is_some_and(|end| end == "ppm"))
        .collect();
    paths.sort();
    let frames: Vec<Frame> = paths
        .iter()
        .map(|path| read(path))
        .collect::<Result<_, _>>()?;
    let motions = motions(&folder.join("motions.txt"), frames.len())?;
    let size = frames.first().ok_or("the folder has no frames")?.size();
    let target = Size::new((size.width() * percent + 50) / 100, size.height())?;
    let none = Progress::none();

    let start = cpu_ms();
    let mut results: Vec<Frame> = Vec::new();
    let mut clip = ClipRetargeter::new(size, &[target], &ClipOptions::default())?;
    let mut grids = Vec::new();
    let (mut analyzing, mut warping) = (0.0, 0.0);
    for (frame, motion) in frames.iter().cloned().map(Some).chain([None]).zip(motions) {
        let begin = cpu_ms();
        let settled = match frame {
            Some(frame) => clip.push(ClipFrame::new(frame.into(), motion), &none)?,
            None => clip.finish(&none)?,
        };
        let middle = cpu_ms();
        analyzing += middle - begin;
        for frame in settled {
            let AnyImage::Srgb8(result) = frame.warp(0, &none)? else {
                unreachable!("frames come back in their type")
            };
            results.push(result);
            grids.push(frame.deformations);
        }
        warping += cpu_ms() - middle;
    }
    let spent = cpu_ms() - start;
    let start = cpu_ms();
    let scaled: Vec<Frame> = frames
        .iter()
        .map(|frame| resize(frame, target, ResizeFilter::Box))
        .collect();
    let scaling = cpu_ms() - start;
    let megapixels = (size.pixels() * frames.len()) as f64 / 1e6;
    println!(
        "{}: {} frames of {size}: CPU ms a megapixel {:.1} (analysis and solution {:.1}, warp {:.1}; plain scaling {:.1}); flicker {:.3}",
        folder.display(),
        frames.len(),
        spent / megapixels,
        analyzing / megapixels,
        warping / megapixels,
        scaling / megapixels,
        change(&results) / change(&scaled),
    );
    println!("  {:?}", clip.report());
    let out = folder.join("out");
    fs::create_dir_all(&out)?;
    for (path, result) in paths.iter().zip(&results) {
        write(&out.join(path.file_name().unwrap_or_default()), result)?;
    }
    for (frame, deformations) in grids.iter().enumerate().step_by(10) {
        let mut svg = Vec::new();
        deformations[0].write_grid_svg(Some(&format!("f_{frame:04}.ppm")), &mut svg)?;
        fs::write(out.join(format!("grid_{frame:04}.svg")), svg)?;
    }
    Ok(())
}

/// The mean absolute difference from frame to frame.
fn change(frames: &[Frame]) -> f64 {
    let pairs = frames.windows(2).map(|pair| {
        let samples = |frame: &Frame| {
            let pixels = frame.pixels().to_vec();
            pixels
                .into_iter()
                .flat_map(|pixel| pixel.0)
                .collect::<Vec<u8>>()
        };
        let (a, b) = (samples(&pair[0]), samples(&pair[1]));
        let sum: u64 = a
            .iter()
            .zip(&b)
            .map(|(a, b)| u64::from(a.abs_diff(*b)))
            .sum();
        sum as f64 / a.len() as f64
    });
    pairs.sum::<f64>() / (frames.len() - 1).max(1) as f64
}

fn motions(path: &Path, count: usize) -> Result<Vec<FrameMotion>, Box<dyn Error>> {
    let Ok(text) = fs::read_to_string(path) else {
        return Ok(vec![FrameMotion::STILL; count + 1]);
    };
    let mut motions = Vec::new();
    for line in text.lines() {
        if line.trim() == "cut" {
            motions.push(FrameMotion::CUT);
            continue;
        }
        let numbers: Vec<f64> = line
            .split_whitespace()
            .map(str::parse)
            .collect::<Result<_, _>>()?;
        let rows: [f64; 9] = numbers
            .try_into()
            .map_err(|_| "a line has no nine numbers")?;
        motions.push(FrameMotion {
            frame_from_previous: DMat3::from_cols_array(&rows).transpose(),
            cut: false,
        });
    }
    motions.resize(count + 1, FrameMotion::STILL);
    Ok(motions)
}

fn read(path: &Path) -> Result<Frame, Box<dyn Error>> {
    let bytes = fs::read(path)?;
    let mut parts = bytes.splitn(4, |&byte| byte == b'\n');
    let (Some(b"P6"), Some(size), Some(b"255"), Some(samples)) =
        (parts.next(), parts.next(), parts.next(), parts.next())
    else {
        return Err(format!("{} is no PPM file with 8 bits a sample", path.display()).into());
    };
    let width: usize = std::str::from_utf8(size)?
        .split(' ')
        .next()
        .unwrap_or_default()
        .parse()?;
    let pixels = samples.chunks_exact(3).map(|s| Srgb([s[0], s[1], s[2]]));
    Ok(Image::from_vec(width, pixels.collect())?)
}

#[expect(
    clippy::disallowed_methods,
    reason = "a half-written result of a measurement does no harm"
)]
fn write(path: &Path, frame: &Frame) -> Result<(), Box<dyn Error>> {
    let mut bytes = format!("P6\n{} {}\n255\n", frame.width(), frame.height()).into_bytes();
    bytes.extend(frame.pixels().iter().flat_map(|pixel| pixel.0));
    Ok(fs::write(path, bytes)?)
}

/// CPU time of all threads so far; 0 where the system does not say.
fn cpu_ms() -> f64 {
    let Ok(tasks) = fs::read_dir("/proc/self/task") else {
        return 0.0;
    };
    tasks
        .filter_map(|task| {
            let text = fs::read_to_string(task.ok()?.path().join("schedstat")).ok()?;
            text.split(' ').next()?.parse::<f64>().ok()
        })
        .sum::<f64>()
        / 1e6
}

//! Times of kernels with their transfers, beside their twins on the CPU, on 12 megapixels; of the exact fit also its kernels on a
//! picture that lies on the device, those of a straightforward port, and its transfers alone.
//!
//! ```text
//! cargo bench -p ravec-gpu --bench device -- NAME
//! ```
//!
//! NAME is part of an adapter's name (default: a hardware adapter). Prints medians of five runs in milliseconds, after one that
//! compiles the kernels.

use ravec_gpu::timing::{FitKernel, time_resident_fit, time_transfers};
use ravec_gpu::{
    DeviceChoice, Gpu, GpuError, OpenOptions, RenderStyle, fit, fit_refined, operate_on,
    refine_lines, render_field,
};
use ravec_progress::Progress;
use ravec_raster::{Image, Rect, Size, Srgb};
use ravec_twocolor::{FitParams, Mode, OperatorParams, TwoColorField, operate, render_to};
use std::time::{Duration, Instant};

fn median_ms(mut work: impl FnMut()) -> f64 {
    median_of(|| {
        let start = Instant::now();
        work();
        1e3 * start.elapsed().as_secs_f64()
    })
}

/// The median of five results, after one that is dropped.
fn median_of(mut time: impl FnMut() -> f64) -> f64 {
    time();
    let mut times: [f64; 5] = std::array::from_fn(|_| time());
    times.sort_by(f64::total_cmp);
    times[2]
}

/// Edges, texture and noise.
fn picture(size: Size) -> Image<Srgb<u8>> {
    Image::from_fn(size, |col, row| {
        let noise = (col * 73 + row * 151 + col * row * 7) % 23;
        let side = if (col / 90 + row / 70) % 2 == 0 {
            140
        } else {
            40
        };
        Srgb([side + noise, 200 - side / 2 + noise, (col + row) % 251].map(|v| v as u8))
    })
}

fn main() {
    // `cargo bench` adds a flag of its own
    let name = std::env::args()
        .skip(1)
        .find(|argument| !argument.starts_with("--"));
    let choice = name.map_or(DeviceChoice::Gpu, DeviceChoice::Named);
    let gpu = match Gpu::open(&choice, OpenOptions::default()) {
        Ok(Some(gpu)) => gpu,
        Ok(None) => return,
        Err(error) => {
            println!("SKIPPED: {error}");
            return;
        }
    };
    println!("{}", gpu.adapter());
    let (size, none) = (Size::new(4000, 3000).unwrap(), Progress::none());
    let image = picture(size);
    for side in [4, 8, 16] {
        let params = FitParams {
            block_px: side,
            ..FitParams::default()
        };
        let on_gpu = median_ms(|| drop(fit(&gpu, &image, &params, &none).unwrap()));
        let on_cpu = median_ms(|| drop(TwoColorField::fit(&image, &params, &none).unwrap()));
        let ms = |time: Result<Duration, GpuError>| 1e3 * time.unwrap().as_secs_f64();
        let [kernels, port] = [FitKernel::Plane, FitKernel::Straightforward]
            .map(|kernel| ms(time_resident_fit(&gpu, &image, side, kernel).map(|fit| fit.time)));
        let transfers = median_of(|| ms(time_transfers(&gpu, &image, side)));
        println!("fit {side}: {on_gpu:.1} ms, CPU {on_cpu:.1} ms");
        println!(
            "fit {side} on the device: {kernels:.2} ms, straightforward {port:.2} ms ({:.1} times), transfers alone {transfers:.2} ms ({:.1} times with the fit)",
            port / kernels,
            on_gpu / transfers
        );
    }
    let field = TwoColorField::fit(&image, &FitParams::default(), &none).unwrap();
    let on_gpu = median_ms(|| refine_lines(&gpu, &mut field.clone(), &image, &none).unwrap());
    let on_cpu = median_ms(|| field.clone().refine_lines(&image, &none).unwrap());
    println!("refine 8: {on_gpu:.1} ms, CPU {on_cpu:.1} ms");
    let params = FitParams::default();
    let on_gpu = median_ms(|| drop(fit_refined(&gpu, &image, &params, &none).unwrap()));
    println!("fit and refine 8 with one upload: {on_gpu:.1} ms");
    let style = RenderStyle::TwoColors;
    let on_gpu = median_ms(|| drop(render_field(&gpu, &field, size, style, &none).unwrap()));
    let on_cpu = median_ms(|| drop(render_to(&field, size, &none).unwrap()));
    println!("render 8: {on_gpu:.1} ms, CPU {on_cpu:.1} ms");
    let operator = OperatorParams {
        mode: Mode::Smooth,
        ..OperatorParams::default()
    };
    let whole = Rect::of(size);
    let on_gpu = median_ms(|| drop(operate_on(&gpu, &image, whole, &operator, &none).unwrap()));
    let on_cpu = median_ms(|| drop(operate(&image, whole, &operator, &none).unwrap()));
    println!("smooth 9: {on_gpu:.1} ms, CPU {on_cpu:.1} ms");
    for warning in gpu.take_warnings() {
        println!("{warning}");
    }
}

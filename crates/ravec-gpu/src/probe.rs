//! The check of a device before it is used.

use crate::device::Gpu;
use crate::error::GpuError;
use crate::fit::fit;
use ravec_progress::Progress;
use ravec_raster::{Image, Size, Srgba};
use ravec_twocolor::{FitParams, TwoColorField};

/// Fits a small picture on the device and on the CPU.
///
/// Correctly rounded sums and products are all that the kernels ask for; hardware has them, but a compiler may be told to do
/// without. The picture has edges, noise, flat places, transparency and a border that clips blocks.
pub(crate) fn check(gpu: &Gpu) -> Result<(), GpuError> {
    let wrong = |cause: String| GpuError::Rounding {
        adapter: gpu.adapter().to_string(),
        cause,
    };
    let Ok(size) = Size::new(61, 43) else {
        return Ok(());
    };
    let image = Image::from_fn(size, |col, row| {
        let noise = (col * 73 + row * 151 + col * row * 7) % 23;
        let side = if 3 * col + 2 * row > 110 { 140 } else { 40 };
        let alpha = if row > 32 { 255 - 4 * col } else { 255 };
        if col < 16 && row < 16 {
            return Srgba([90, 120, 30, 255]);
        }
        Srgba(
            [
                side + noise,
                200 - side / 2 + noise,
                (col * 4 + row) % 251,
                alpha,
            ]
            .map(|v| v as u8),
        )
    });
    let params = FitParams::default();
    let progress = Progress::none();
    let on_cpu =
        TwoColorField::fit(&image, &params, &progress).map_err(|error| wrong(error.to_string()))?;
    let on_gpu = fit(gpu, &image, &params, &progress).map_err(|error| wrong(error.to_string()))?;
    if let Some(warning) = gpu.take_warnings().into_iter().next() {
        return Err(GpuError::Open {
            adapter: gpu.adapter().to_string(),
            cause: warning,
        });
    }
    let pairs = on_cpu.blocks().iter().zip(on_gpu.blocks());
    match pairs.enumerate().find(|(_, (cpu, gpu))| cpu != gpu) {
        Some((block, _)) => Err(wrong(format!("block {block} of the check"))),
        None => Ok(()),
    }
}

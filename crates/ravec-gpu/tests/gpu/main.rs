//! Kernels against their twins on the CPU, on the software driver for Vulkan (Debian's mesa-vulkan-drivers). Without it nothing
//! is tested, and a line says so.

mod clean;
mod dense;
mod fit;
mod fit_refined;
mod grid_warp;
mod homography_warp;
mod life;
mod pictures;
mod refine;
mod render;
mod timing;

use ravec_gpu::{DeviceChoice, Gpu, GpuError, OpenOptions};
use std::sync::OnceLock;

/// The adapter of the tests: named, since software drivers are never taken otherwise.
const ADAPTER: &str = "llvmpipe";

/// A device of its own.
fn open() -> Option<Gpu> {
    match Gpu::open(
        &DeviceChoice::Named(ADAPTER.to_owned()),
        OpenOptions::default(),
    ) {
        Ok(gpu) => gpu,
        Err(GpuError::NoAdapter { .. }) => {
            eprintln!("SKIPPED: no software driver for Vulkan; install mesa-vulkan-drivers");
            None
        }
        Err(error) => panic!("{error}"),
    }
}

/// The device that tests share.
fn gpu() -> Option<&'static Gpu> {
    static GPU: OnceLock<Option<Gpu>> = OnceLock::new();
    GPU.get_or_init(open).as_ref()
}

//! Two-color pixels on a GPU.
mod dense;
mod device;
mod error;
mod fit;
mod grid_warp;
mod homography_warp;
mod plane;
mod probe;
mod refine;
mod render;
mod upload;
mod work;

pub use dense::{MAX_WINDOW_PX, operate_on};
pub use device::{AdapterInfo, DeviceChoice, Gpu, OpenOptions, adapters};
pub use error::GpuError;
pub use fit::{FITTED_SIDES, fit};
pub use grid_warp::warp_deformed;
pub use homography_warp::warp_homography;
pub use refine::refine_lines;
pub use render::{RenderStyle, render_field};
pub use upload::GpuPixel;

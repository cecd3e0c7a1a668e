//! Two-color pixels on a GPU.
mod device;
mod error;
mod fit;
mod plane;
mod probe;
mod upload;
mod work;

pub use device::{AdapterInfo, DeviceChoice, Gpu, OpenOptions, adapters};
pub use error::GpuError;
pub use fit::{FITTED_SIDES, fit};
pub use upload::GpuPixel;

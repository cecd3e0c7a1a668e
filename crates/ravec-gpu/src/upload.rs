//! Pictures as kernels read them: the rows of the picture in its own pixel type, and a table of the light of its samples.

use crate::device::Gpu;
use crate::error::Failure;
use ravec_raster::{Color, Image, LinearRgb, LinearRgba, Sample, Srgb, Srgba};
use std::ops::Range;
use std::sync::Arc;

/// Pixel types that kernels read: those of files.
pub trait GpuPixel: Color + sealed::Sealed {
    /// Number of the type in `source.wgsl`.
    #[doc(hidden)]
    const FORMAT: u32;

    /// The linear light of each value of an integer sample, followed by its value on a scale of 0 to 1.
    #[doc(hidden)]
    fn light() -> Vec<f32>;
}

mod sealed {
    pub trait Sealed {}
}

fn light_of<T: Sample>(values: impl Iterator<Item = T> + Clone) -> Vec<f32> {
    let linear = values.clone().map(Sample::to_linear);
    linear.chain(values.map(Sample::to_unit)).collect()
}

macro_rules! gpu_pixel {
    ($type:ty, $format:literal, $light:expr) => {
        impl sealed::Sealed for $type {}

        impl GpuPixel for $type {
            const FORMAT: u32 = $format;

            fn light() -> Vec<f32> {
                $light
            }
        }
    };
}

gpu_pixel!(Srgb<u8>, 0, light_of(0..=u8::MAX));
gpu_pixel!(Srgba<u8>, 1, light_of(0..=u8::MAX));
gpu_pixel!(Srgb<u16>, 2, light_of(0..=u16::MAX));
gpu_pixel!(Srgba<u16>, 3, light_of(0..=u16::MAX));
gpu_pixel!(LinearRgb, 4, vec![0.0]);
gpu_pixel!(LinearRgba, 5, vec![0.0]);

/// The constants of a shader that reads pixels of this type.
pub(crate) fn source_constants<P: GpuPixel>() -> String {
    format!(
        "const FORMAT: u32 = {}u;\nconst MAX_LIGHT_BITS: u32 = {}u;",
        P::FORMAT,
        ravec_twocolor::MAX_FITTED_LIGHT.to_bits()
    )
}

impl Gpu {
    /// Uploads rows of a picture.
    pub(crate) fn upload_rows<P: GpuPixel>(
        &self,
        image: &Image<P>,
        rows: Range<usize>,
    ) -> Result<wgpu::Buffer, Failure> {
        let width = image.width();
        let pixels = &image.pixels()[rows.start * width..rows.end * width];
        self.upload(bytemuck::cast_slice(pixels), wgpu::BufferUsages::STORAGE)
    }

    /// The table for pixels of a type.
    pub(crate) fn light<P: GpuPixel>(&self) -> Result<Arc<wgpu::Buffer>, Failure> {
        // pixels with and without alpha share their samples
        self.table(&format!("light {}", P::FORMAT / 2), P::light)
    }
}

//! The device that computes two-color pixels and warps: the CPU, or a GPU beside it.
//!
//! Functions here have the names and results of their twins on the CPU. Fits are the same bits on all devices; the rest differs
//! within the bounds that `ravec::gpu` states, so that files written with a GPU may differ in the last bit of a sample.

use crate::error::JobError;
use crate::report::Report;
use ravec::planar::{Beyond, Homography, warp};
use ravec::progress::{Cancelled, Progress};
use ravec::raster::{AnyImage, Image, LinearRgba, PremulLinearRgba, Rect, Size, with_image};
use ravec::retarget::{Deformation, RetargetError};
use ravec::twocolor::{
    BlockField, CleanParams, FilterError, FitError, FitParams, NoiseLevel, OperatorParams,
    TwoColorField, clean_with, operate, render_mosaic, render_to,
};

#[cfg(feature = "gpu")]
use ravec::gpu::{self, DeviceChoice, Gpu, OpenOptions, RenderStyle};
#[cfg(feature = "gpu")]
use std::sync::Arc;

/// The device of a run: the CPU (default), or a GPU. Clones share it.
#[derive(Debug, Clone, Default)]
pub struct Device {
    #[cfg(feature = "gpu")]
    gpu: Option<Arc<Gpu>>,
}

#[cfg_attr(
    not(feature = "gpu"),
    expect(clippy::unused_self, reason = "there is no device but the CPU")
)]
impl Device {
    /// Opens a device: `cpu`, `gpu` for a hardware adapter, `auto` for a hardware adapter if there is one and else the CPU, or
    /// part of an adapter's name.
    ///
    /// # Errors
    /// [`JobError::Device`] if there is no such device, if it cannot be used, or if this program has no support for GPUs.
    #[cfg(feature = "gpu")]
    pub fn open(name: &str) -> Result<Self, JobError> {
        let failed = |cause: String| JobError::Device { cause };
        let choice: DeviceChoice = name.parse().map_err(failed)?;
        let gpu = Gpu::open(&choice, OpenOptions::default())
            .map_err(|error| failed(error.to_string()))?;
        Ok(Self {
            gpu: gpu.map(Arc::new),
        })
    }

    /// Opens a device: `cpu` or `auto`, which is the CPU. This program has no support for GPUs.
    ///
    /// # Errors
    /// [`JobError::Device`] for others.
    #[cfg(not(feature = "gpu"))]
    pub fn open(name: &str) -> Result<Self, JobError> {
        match name {
            "cpu" | "auto" => Ok(Self::default()),
            _ => Err(JobError::Device {
                cause: format!(
                    "cannot use the device `{name}`: this program was built without support for GPUs; build it with `--features gpu`, or choose `cpu`"
                ),
            }),
        }
    }

    /// The adapter with its driver; nothing for the CPU.
    pub fn adapter(&self) -> Option<String> {
        #[cfg(feature = "gpu")]
        return self.gpu.as_ref().map(|gpu| gpu.adapter().to_string());
        #[cfg(not(feature = "gpu"))]
        None
    }

    /// Takes the warnings of work that the CPU had to do instead of the device, which each clone may have caused.
    pub fn take_warnings(&self) -> Vec<String> {
        #[cfg(feature = "gpu")]
        return self
            .gpu
            .iter()
            .flat_map(|gpu| gpu.take_warnings())
            .collect();
        #[cfg(not(feature = "gpu"))]
        Vec::new()
    }

    /// Records what the CPU had to do instead of the device.
    pub(crate) fn report_warnings(&self, report: &mut Report) {
        for warning in self.take_warnings() {
            report.warn(warning);
        }
    }

    /// Fits two-color pixels, to the bits of [`TwoColorField::fit`].
    ///
    /// # Errors
    /// As [`TwoColorField::fit`].
    pub fn fit(
        &self,
        image: &AnyImage,
        params: &FitParams,
        progress: &Progress,
    ) -> Result<TwoColorField, FitError> {
        #[cfg(feature = "gpu")]
        if let Some(gpu) = &self.gpu {
            return with_image!(image, image => gpu::fit(gpu, image, params, progress));
        }
        with_image!(image, image => TwoColorField::fit(image, params, progress))
    }

    /// Fits two-color pixels and moves their lines between pixel centers: [`TwoColorField::fit`] and then
    /// [`TwoColorField::refine_lines`]. A GPU takes the picture once for both.
    ///
    /// # Errors
    /// As [`TwoColorField::fit`].
    pub fn fit_refined(
        &self,
        image: &AnyImage,
        params: &FitParams,
        progress: &Progress,
    ) -> Result<TwoColorField, FitError> {
        #[cfg(feature = "gpu")]
        if let Some(gpu) = &self.gpu {
            return with_image!(image, image => gpu::fit_refined(gpu, image, params, progress));
        }
        let mut field = self.fit(image, params, progress)?;
        with_image!(image, image => field.refine_lines(image, progress))?;
        Ok(field)
    }

    /// Renders a field so that it fills `size`, with its lines or as a plain mosaic.
    ///
    /// # Errors
    /// [`Cancelled`] soon after `progress` is cancelled.
    pub fn render(
        &self,
        field: &TwoColorField,
        size: Size,
        mosaic: bool,
        progress: &Progress,
    ) -> Result<Image<LinearRgba>, Cancelled> {
        #[cfg(feature = "gpu")]
        if let Some(gpu) = &self.gpu {
            let style = if mosaic {
                RenderStyle::Mosaic
            } else {
                RenderStyle::TwoColors
            };
            return gpu::render_field(gpu, field, size, style, progress);
        }
        render_field(field, size, mosaic, progress)
    }

    /// Warps a picture by the deformation of a retargeting, as [`Deformation::warp`] does.
    ///
    /// # Errors
    /// As [`Deformation::warp`].
    pub fn warp(
        &self,
        deformation: &Deformation,
        image: &AnyImage,
        progress: &Progress,
    ) -> Result<AnyImage, RetargetError> {
        #[cfg(feature = "gpu")]
        if let Some(gpu) = &self.gpu {
            return with_image!(image, image => Ok(gpu::warp_deformed(gpu, deformation, image, progress)?.into()));
        }
        with_image!(image, image => Ok(deformation.warp(image, progress)?.into()))
    }

    /// Warps a picture by a homography, as [`ravec::planar::warp`] does.
    ///
    /// # Errors
    /// [`Cancelled`] soon after `progress` is cancelled.
    pub fn warp_homography(
        &self,
        image: &Image<PremulLinearRgba>,
        image_from_output: &Homography,
        size: Size,
        beyond: Beyond<PremulLinearRgba>,
        progress: &Progress,
    ) -> Result<Image<PremulLinearRgba>, Cancelled> {
        #[cfg(feature = "gpu")]
        if let Some(gpu) = &self.gpu {
            return gpu::warp_homography(gpu, image, image_from_output, size, beyond, progress);
        }
        warp(image, image_from_output, size, beyond, progress)
    }

    pub(crate) fn operate(
        &self,
        image: &AnyImage,
        region: Rect,
        params: &OperatorParams,
        progress: &Progress,
    ) -> Result<Image<LinearRgba>, FilterError> {
        #[cfg(feature = "gpu")]
        if let Some(gpu) = &self.gpu {
            return with_image!(image, image => gpu::operate_on(gpu, image, region, params, progress));
        }
        with_image!(image, image => operate(image, region, params, progress))
    }

    /// Cleans the whole image.
    pub(crate) fn clean(
        &self,
        image: &AnyImage,
        noise: &NoiseLevel,
        params: &CleanParams,
        progress: &Progress,
    ) -> Result<Image<LinearRgba>, FilterError> {
        let whole = Rect::of(image.size());
        #[cfg(feature = "gpu")]
        if let Some(gpu) = &self.gpu {
            return with_image!(image, image => gpu::clean(gpu, image, whole, noise, params, progress));
        }
        with_image!(image, image => clean_with(image, whole, noise, params, progress))
    }
}

/// Renders a field on the CPU.
pub(crate) fn render_field(
    field: &impl BlockField,
    size: Size,
    mosaic: bool,
    progress: &Progress,
) -> Result<Image<LinearRgba>, Cancelled> {
    if mosaic {
        render_mosaic(field, size, progress)
    } else {
        render_to(field, size, progress)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ErrorKind;

    #[test]
    fn the_cpu_is_always_there_and_unknown_adapters_never() {
        assert_eq!(Device::open("cpu").unwrap().adapter(), None);
        for name in ["no such adapter", ""] {
            let error = Device::open(name).unwrap_err();
            assert_eq!(error.kind(), ErrorKind::Request);
            assert!(error.to_string().contains("cpu"), "{error}");
        }
    }
}

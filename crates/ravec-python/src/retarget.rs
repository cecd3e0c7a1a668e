//! A picture that is analyzed once and asked for many sizes.

use crate::array::{self, PixelKind};
use crate::device::{self, device};
use crate::error::{of_request, of_task};
use crate::work;
use pyo3::prelude::*;
use ravec::raster::{AnyImage, with_image};
use ravec::retarget::{Painted, RetargetError, RetargetParams};
use std::sync::Arc;

struct Analyzed {
    image: AnyImage,
    retargeter: ravec::retarget::Retargeter,
}

/// An analyzed picture.
#[pyclass(frozen, module = "ravec._ravec")]
pub struct Retargeter {
    analyzed: Arc<Analyzed>,
    kind: PixelKind,
}

fn raised(error: RetargetError) -> PyErr {
    match error {
        RetargetError::Parameter { .. }
        | RetargetError::Factor { .. }
        | RetargetError::MaskSize { .. } => of_request(error),
        error => of_task(error),
    }
}

#[pymethods]
impl Retargeter {
    /// Analyzes a picture. `params` are those of the analysis as JSON.
    #[new]
    #[pyo3(signature = (image, params, protect = None, give_way = None, color_space = "srgb", progress = None))]
    fn new(
        py: Python<'_>,
        image: &Bound<'_, PyAny>,
        params: &str,
        protect: Option<&Bound<'_, PyAny>>,
        give_way: Option<&Bound<'_, PyAny>>,
        color_space: &str,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let params: RetargetParams = serde_json::from_str(params).map_err(of_request)?;
        let linear = PixelKind::is_linear(color_space)?;
        let (image, kind) = array::picture(image, linear)?;
        let protect = protect.map(array::mask).transpose()?;
        let give_way = give_way.map(array::mask).transpose()?;
        let analyzed = work::run(py, progress, move |progress| {
            let painted = Painted {
                protect: protect.as_ref(),
                give_way: give_way.as_ref(),
            };
            let retargeter = with_image!(&image, image => {
                ravec::retarget::Retargeter::new(image, painted, &params, progress)
            });
            let retargeter = retargeter.map_err(raised)?;
            Ok(Analyzed { image, retargeter })
        })?;
        Ok(Self {
            analyzed: Arc::new(analyzed),
            kind,
        })
    }

    /// The picture with this many columns and rows.
    #[pyo3(signature = (width, height, progress = None))]
    fn picture(
        &self,
        py: Python<'_>,
        width: usize,
        height: usize,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Py<PyAny>> {
        let size = array::result_size(width as f64, height as f64)?;
        let analyzed = Arc::clone(&self.analyzed);
        let device = device(py)?;
        let used = device.clone();
        let image = work::run(py, progress, move |progress| {
            let deformation = analyzed.retargeter.solve(size).map_err(raised)?;
            used.warp(&deformation, &analyzed.image, progress)
                .map_err(raised)
        })?;
        device::warn(py, &device)?;
        array::array(py, image, self.kind)
    }
}

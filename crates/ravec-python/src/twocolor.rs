//! Fields of two-color pixels.

use crate::array::{self, PixelKind, Samples};
use crate::device::{self, device};
use crate::error::{of_request, of_task};
use crate::work;
use numpy::{PyArray1, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use ravec::raster::{AnyImage, LinearRgb, with_image};
use ravec::twocolor::{
    AdaptiveField, AdaptiveParams, FitParams, SvgParams, TwoColorField, render_mosaic, render_to,
    write_svg,
};
use std::sync::Arc;

enum Blocks {
    Regular(TwoColorField),
    Adaptive(AdaptiveField),
}

/// Runs the same code on fields of either kind.
macro_rules! with_blocks {
    ($blocks:expr, $field:ident => $body:expr) => {
        match $blocks {
            Blocks::Regular($field) => $body,
            Blocks::Adaptive($field) => $body,
        }
    };
}

/// Two-color pixels of a picture.
#[pyclass(frozen, module = "ravec._ravec")]
pub struct Field {
    blocks: Arc<Blocks>,
    kind: PixelKind,
}

/// Parameters of [`Field::fit`].
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct FitOptions {
    size: usize,
    adaptive: bool,
    max_size: usize,
    max_error: f32,
    flat_contrast: f32,
    whole_pixels: bool,
    color_space: String,
}

#[pymethods]
impl Field {
    /// Fits the blocks of a picture.
    #[staticmethod]
    #[pyo3(signature = (image, options, progress = None))]
    fn fit(
        py: Python<'_>,
        image: &Bound<'_, PyAny>,
        options: FitOptions,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let linear = PixelKind::is_linear(&options.color_space)?;
        let (image, kind) = array::picture(image, linear)?;
        let device = device(py)?;
        let used = device.clone();
        let blocks = work::run_sized(py, image.size().pixels(), progress, move |progress| {
            if options.adaptive {
                let params = AdaptiveParams {
                    min_block_px: options.size,
                    max_block_px: options.max_size,
                    max_error: options.max_error,
                    flat_contrast: options.flat_contrast,
                };
                with_image!(&image, image => {
                    let mut field = AdaptiveField::fit(image, &params, progress).map_err(of_request)?;
                    if !options.whole_pixels {
                        field.refine_lines(image, progress).map_err(of_task)?;
                    }
                    Ok(Blocks::Adaptive(field))
                })
            } else {
                let params = FitParams {
                    block_px: options.size,
                    flat_contrast: options.flat_contrast,
                    ..FitParams::default()
                };
                let field = if options.whole_pixels {
                    used.fit(&image, &params, progress)
                } else {
                    used.fit_refined(&image, &params, progress)
                };
                let field = field.map_err(of_request)?;
                Ok(Blocks::Regular(field))
            }
        })?;
        device::warn(py, &device)?;
        Ok(Self {
            blocks: Arc::new(blocks),
            kind,
        })
    }

    /// The picture at a scale; with `mosaic` each block in its mean color.
    #[pyo3(signature = (scale, mosaic, progress = None))]
    fn render(
        &self,
        py: Python<'_>,
        scale: f64,
        mosaic: bool,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Py<PyAny>> {
        let blocks = Arc::clone(&self.blocks);
        let kind = self.kind;
        let device = device(py)?;
        let used = device.clone();
        let size = with_blocks!(&*blocks, field => {
            scaled(ravec::twocolor::BlockField::image_size(field), scale)?
        });
        let image = work::run_sized(py, size.pixels(), progress, move |progress| {
            let image = match &*blocks {
                Blocks::Regular(field) => used.render(field, size, mosaic, progress),
                Blocks::Adaptive(field) if mosaic => render_mosaic(field, size, progress),
                Blocks::Adaptive(field) => render_to(field, size, progress),
            };
            let image = image.map_err(of_task)?;
            // rounded here, where the interpreter is free
            Ok(match (kind.samples, kind.has_alpha()) {
                (Samples::U8, false) => AnyImage::Srgb8(image.convert()),
                (Samples::U8, true) => AnyImage::Srgba8(image.convert()),
                (Samples::U16, false) => AnyImage::Srgb16(image.convert()),
                (Samples::U16, true) => AnyImage::Srgba16(image.convert()),
                (Samples::F32, false) => AnyImage::Linear(image.convert::<LinearRgb>()),
                (Samples::F32, true) => AnyImage::LinearAlpha(image),
            })
        })?;
        device::warn(py, &device)?;
        array::array(py, image, self.kind)
    }

    /// The drawing as SVG.
    #[pyo3(signature = (title, color_levels, progress = None))]
    fn svg(
        &self,
        py: Python<'_>,
        title: Option<String>,
        color_levels: u16,
        progress: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<String> {
        let blocks = Arc::clone(&self.blocks);
        work::run(py, progress, move |_| {
            let params = SvgParams {
                title,
                color_levels,
            };
            let mut text = Vec::new();
            with_blocks!(&*blocks, field => write_svg(field, &params, &mut text))
                .map_err(of_task)?;
            String::from_utf8(text).map_err(of_task)
        })
    }

    /// Columns and rows of the picture.
    #[getter]
    fn size(&self) -> (usize, usize) {
        let size =
            with_blocks!(&*self.blocks, field => ravec::twocolor::BlockField::image_size(field));
        (size.width(), size.height())
    }

    /// Corner, side, line, colors, alphas and error of each block, as arrays.
    fn blocks<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        use ravec::twocolor::BlockField as _;
        let mut corner: Vec<u32> = Vec::new();
        let mut side: Vec<u32> = Vec::new();
        let (mut normal, mut offset): (Vec<f64>, Vec<f64>) = Default::default();
        let (mut colors, mut alphas, mut error): (Vec<f32>, Vec<f32>, Vec<f32>) =
            Default::default();
        with_blocks!(&*self.blocks, field => {
            for block in field.placed_blocks() {
                corner.extend([block.col_px as u32, block.row_px as u32]);
                side.push(block.side_px as u32);
                let line = block.pixel.line;
                normal.extend(line.map_or([f64::NAN; 2], |line| line.normal.to_array()));
                offset.push(line.map_or(f64::NAN, |line| line.offset_px));
                colors.extend(block.pixel.colors.iter().flat_map(|color| color.0));
                alphas.extend(block.pixel.alphas);
                error.push(block.pixel.error);
            }
        });
        let count = side.len();
        let found = PyDict::new(py);
        found.set_item(
            "corner_px",
            PyArray1::from_vec(py, corner).reshape([count, 2])?,
        )?;
        found.set_item("side_px", PyArray1::from_vec(py, side))?;
        found.set_item(
            "normal",
            PyArray1::from_vec(py, normal).reshape([count, 2])?,
        )?;
        found.set_item("offset_px", PyArray1::from_vec(py, offset))?;
        found.set_item(
            "oklab",
            PyArray1::from_vec(py, colors).reshape([count, 2, 3])?,
        )?;
        found.set_item("alpha", PyArray1::from_vec(py, alphas).reshape([count, 2])?)?;
        found.set_item("error", PyArray1::from_vec(py, error))?;
        Ok(found)
    }
}

fn scaled(size: ravec::raster::Size, scale: f64) -> PyResult<ravec::raster::Size> {
    if !(scale.is_finite() && scale > 0.0) {
        return Err(of_request(format!(
            "the scale is {scale}, but must be above 0"
        )));
    }
    let side = |px: usize| (px as f64 * scale).round().max(1.0);
    array::result_size(side(size.width()), side(size.height()))
}

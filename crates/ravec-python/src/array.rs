//! NumPy arrays as pictures.
//!
//! Arrays have rows, columns and, unless they are gray, channels; samples are `uint8`, `uint16`, `float32` or `float64`, and `bool` for
//! masks. They may have any strides. Floats are on a scale of 0 to 1.

use crate::error::{of_request, of_task};
use crate::work;
use bytemuck::allocation::cast_vec;
use numpy::ndarray::{ArrayView3, Axis};
use numpy::{Element, PyArray1, PyArrayMethods, PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use ravec::raster::{
    AnyImage, Color, Image, LinearRgb, LinearRgba, Mask, Pixel, Plane, Sample, Size, Srgb, Srgba,
};
use ravec_media::{Format, Limits, Picture, WriteOptions, encode};
use std::io::Cursor;

/// Samples of an array.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Samples {
    U8,
    U16,
    F32,
}

/// Layout and color space of an array.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PixelKind {
    pub samples: Samples,
    /// Length of the last axis of channels, 1 to 4: gray, gray and alpha, RGB or RGBA; 0 for gray without that axis.
    pub channels: usize,
    /// Floats are linear light instead of sRGB.
    pub linear: bool,
}

impl PixelKind {
    pub const RGB8: Self = Self {
        samples: Samples::U8,
        channels: 3,
        linear: false,
    };

    /// True for arrays without color.
    pub fn is_gray(self) -> bool {
        self.channels < 3
    }

    /// True for arrays with alpha.
    pub fn has_alpha(self) -> bool {
        matches!(self.channels, 2 | 4)
    }

    /// A color space by its name.
    pub fn is_linear(color_space: &str) -> PyResult<bool> {
        match color_space {
            "srgb" => Ok(false),
            "linear" => Ok(true),
            other => Err(of_request(format!(
                "`color_space` is {other:?}, but must be \"srgb\" or \"linear\""
            ))),
        }
    }
}

/// The size of a result, refused before anything is allocated if it has more pixels than pictures may have.
pub fn result_size(width: f64, height: f64) -> PyResult<Size> {
    let limit = Limits::default().max_pixels;
    let pixels = width * height;
    if pixels.is_nan() || pixels > limit as f64 {
        return Err(of_request(format!(
            "the result would have {width} x {height} pixels, more than the limit of {limit}"
        )));
    }
    Size::new(width as usize, height as usize).map_err(of_request)
}

/// A picture from an array, and how to give results back.
pub fn picture(array: &Bound<'_, PyAny>, linear: bool) -> PyResult<(AnyImage, PixelKind)> {
    if let Ok(array) = array.extract::<PyReadonlyArrayDyn<'_, u8>>() {
        return typed(&array, Samples::U8, linear);
    }
    if let Ok(array) = array.extract::<PyReadonlyArrayDyn<'_, u16>>() {
        return typed(&array, Samples::U16, linear);
    }
    if let Ok(array) = array.extract::<PyReadonlyArrayDyn<'_, f32>>() {
        return typed(&array, Samples::F32, linear);
    }
    let name = array
        .getattr("dtype")
        .and_then(|dtype| dtype.str())
        .map_or_else(|_| "no array".to_owned(), |name| name.to_string());
    Err(PyTypeError::new_err(format!(
        "a picture is an array of uint8, uint16 or float32, not of {name}"
    )))
}

/// Coverage of a mask: 0 to 1.
pub fn mask(array: &Bound<'_, PyAny>) -> PyResult<Mask> {
    let (image, _) = picture(array, true)?;
    let size = image.size();
    let value = |col: usize, row: usize| match &image {
        AnyImage::Srgb8(image) => image[(col, row)].0[1].to_unit(),
        AnyImage::Srgb16(image) => image[(col, row)].0[1].to_unit(),
        AnyImage::Srgba8(image) => image[(col, row)].0[1].to_unit(),
        AnyImage::Srgba16(image) => image[(col, row)].0[1].to_unit(),
        AnyImage::Linear(image) => image[(col, row)].0[1],
        AnyImage::LinearAlpha(image) => image[(col, row)].0[1],
    };
    let coverage = Plane::from_fn(size, |col, row| value(col, row).clamp(0.0, 1.0));
    Ok(Mask::from_coverage(&coverage))
}

fn typed<T: Element + Sample>(
    array: &PyReadonlyArrayDyn<'_, T>,
    samples: Samples,
    linear: bool,
) -> PyResult<(AnyImage, PixelKind)> {
    let shape = array.shape().to_vec();
    let channels = match shape[..] {
        [_, _] => 0,
        [_, _, channels @ 1..=4] => channels,
        _ => {
            return Err(of_request(format!(
                "a picture has the shape (rows, columns) or (rows, columns, 1 to 4), not {shape:?}"
            )));
        }
    };
    let size = Size::new(shape[1], shape[0]).map_err(of_request)?;
    let kind = PixelKind {
        samples,
        channels,
        linear: linear && samples == Samples::F32,
    };
    let view = array.as_array();
    let view = if shape.len() == 2 {
        view.insert_axis(Axis(2))
    } else {
        view
    };
    let view = view.into_dimensionality().map_err(of_request)?;
    Ok((assembled(&view, size, kind)?, kind))
}

/// Pixels of the type that an array with these samples has.
fn assembled<T: Element + Sample>(
    view: &ArrayView3<'_, T>,
    size: Size,
    kind: PixelKind,
) -> PyResult<AnyImage> {
    // a copy of the memory as it is where rows follow one another, or of the pixels one by one
    let contiguous = view.as_slice();
    let three = || -> PyResult<Image<[T; 3]>> {
        let pixels = match contiguous {
            Some(values) if kind.channels == 3 => bytemuck::cast_slice(values).to_vec(),
            _ => pixels(view, |at| match kind.channels {
                0 | 1 => [at[0]; 3],
                _ => [at[0], at[1], at[2]],
            }),
        };
        Image::from_vec(size.width(), pixels).map_err(of_request)
    };
    let four = || -> PyResult<Image<[T; 4]>> {
        let pixels = match contiguous {
            Some(values) if kind.channels == 4 => bytemuck::cast_slice(values).to_vec(),
            _ => pixels(view, |at| match kind.channels {
                2 => [at[0], at[0], at[0], at[1]],
                _ => [at[0], at[1], at[2], at[3]],
            }),
        };
        Image::from_vec(size.width(), pixels).map_err(of_request)
    };
    Ok(match (kind.samples, kind.has_alpha()) {
        (Samples::U8, false) => AnyImage::Srgb8(cast(three()?)?),
        (Samples::U8, true) => AnyImage::Srgba8(cast(four()?)?),
        (Samples::U16, false) => AnyImage::Srgb16(cast(three()?)?),
        (Samples::U16, true) => AnyImage::Srgba16(cast(four()?)?),
        (Samples::F32, false) if kind.linear => AnyImage::Linear(cast(three()?)?),
        (Samples::F32, true) if kind.linear => AnyImage::LinearAlpha(cast(four()?)?),
        (Samples::F32, false) => AnyImage::Linear(cast::<_, Srgb<f32>>(three()?)?.convert()),
        (Samples::F32, true) => AnyImage::LinearAlpha(cast::<_, Srgba<f32>>(four()?)?.convert()),
    })
}

/// The pixels of an array of any strides.
fn pixels<T: Element + Copy, const N: usize>(
    view: &ArrayView3<'_, T>,
    pixel: impl Fn(&[T]) -> [T; N],
) -> Vec<[T; N]> {
    let mut buffer = Vec::with_capacity(4);
    view.lanes(Axis(2))
        .into_iter()
        .map(|lane| {
            buffer.clear();
            buffer.extend(lane.iter().copied());
            pixel(&buffer)
        })
        .collect()
}

/// The same numbers as pixels of another type of the same size.
fn cast<P: Pixel, Q: Pixel>(image: Image<P>) -> PyResult<Image<Q>> {
    let width = image.width();
    Image::from_vec(width, cast_vec(image.into_pixels())).map_err(of_request)
}

/// A picture as an array of the kind that came in; alpha is added where the picture has it.
pub fn array(py: Python<'_>, image: AnyImage, kind: PixelKind) -> PyResult<Py<PyAny>> {
    match (kind.samples, kind.has_alpha() || image.has_alpha()) {
        (Samples::U8, false) => numbers::<u8, _, 3>(py, converted::<Srgb<u8>>(image)?, kind),
        (Samples::U8, true) => numbers::<u8, _, 4>(py, converted::<Srgba<u8>>(image)?, kind),
        (Samples::U16, false) => numbers::<u16, _, 3>(py, converted::<Srgb<u16>>(image)?, kind),
        (Samples::U16, true) => numbers::<u16, _, 4>(py, converted::<Srgba<u16>>(image)?, kind),
        (Samples::F32, false) if kind.linear => {
            numbers::<f32, _, 3>(py, converted::<LinearRgb>(image)?, kind)
        }
        (Samples::F32, true) if kind.linear => {
            numbers::<f32, _, 4>(py, converted::<LinearRgba>(image)?, kind)
        }
        (Samples::F32, false) => numbers::<f32, _, 3>(py, converted::<Srgb<f32>>(image)?, kind),
        (Samples::F32, true) => numbers::<f32, _, 4>(py, converted::<Srgba<f32>>(image)?, kind),
    }
}

/// The pixels as those of another type; those that are of it already stay where they are.
fn converted<Q: Color + Pixel>(image: AnyImage) -> PyResult<Image<Q>> {
    use std::any::TypeId;
    let same = match &image {
        AnyImage::Srgb8(_) => TypeId::of::<Q>() == TypeId::of::<Srgb<u8>>(),
        AnyImage::Srgba8(_) => TypeId::of::<Q>() == TypeId::of::<Srgba<u8>>(),
        AnyImage::Srgb16(_) => TypeId::of::<Q>() == TypeId::of::<Srgb<u16>>(),
        AnyImage::Srgba16(_) => TypeId::of::<Q>() == TypeId::of::<Srgba<u16>>(),
        AnyImage::Linear(_) => TypeId::of::<Q>() == TypeId::of::<LinearRgb>(),
        AnyImage::LinearAlpha(_) => TypeId::of::<Q>() == TypeId::of::<LinearRgba>(),
    };
    if !same {
        return Ok(image.convert());
    }
    match image {
        AnyImage::Srgb8(image) => cast(image),
        AnyImage::Srgba8(image) => cast(image),
        AnyImage::Srgb16(image) => cast(image),
        AnyImage::Srgba16(image) => cast(image),
        AnyImage::Linear(image) => cast(image),
        AnyImage::LinearAlpha(image) => cast(image),
    }
}

/// The bytes of a PNG file.
#[pyfunction]
pub fn png<'py>(py: Python<'py>, image: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyBytes>> {
    let (image, _) = picture(image, false)?;
    let bytes = work::run(py, None, move |_| {
        let mut bytes = Cursor::new(Vec::new());
        let picture = Picture::from_image(image);
        encode(&mut bytes, Format::Png, &picture, &WriteOptions::default()).map_err(of_task)?;
        Ok(bytes.into_inner())
    })?;
    Ok(PyBytes::new(py, &bytes))
}

/// The numbers of pixels with `N` channels as an array, whose memory is that of the picture unless it becomes gray.
fn numbers<T: Element + Pixel, P: Pixel, const N: usize>(
    py: Python<'_>,
    image: Image<P>,
    kind: PixelKind,
) -> PyResult<Py<PyAny>> {
    let (width, height) = (image.width(), image.height());
    let pixels = image.into_pixels();
    if !kind.is_gray() {
        let values: Vec<T> = flattened(pixels);
        let flat = PyArray1::from_vec(py, values);
        return Ok(flat.reshape([height, width, N])?.into_any().unbind());
    }
    let channels: &[[T; N]] = bytemuck::cast_slice(&pixels);
    // red, green and blue of gray are equal; the middle one is as good as any
    if N == 4 {
        let values = channels.iter().flat_map(|at| [at[1], at[3]]).collect();
        let flat = PyArray1::from_vec(py, values);
        return Ok(flat.reshape([height, width, 2])?.into_any().unbind());
    }
    let flat = PyArray1::from_vec(py, channels.iter().map(|at| at[1]).collect());
    if kind.channels == 1 {
        return Ok(flat.reshape([height, width, 1])?.into_any().unbind());
    }
    Ok(flat.reshape([height, width])?.into_any().unbind())
}

/// The channels of pixels one after another, in the same memory where its size allows.
fn flattened<T: Pixel, P: Pixel>(mut pixels: Vec<P>) -> Vec<T> {
    pixels.shrink_to_fit();
    bytemuck::allocation::try_cast_vec(pixels)
        .unwrap_or_else(|(_, pixels)| bytemuck::cast_slice(&pixels).to_vec())
}

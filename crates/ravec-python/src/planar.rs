//! Homographies from pairs of points.

use crate::array::{self, PixelKind};
use crate::device::{self, device};
use crate::error::{of_request, of_task};
use crate::work;
use glam::{DMat3, DVec2};
use numpy::{PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;
use ravec::planar::{Beyond, Homography, PointPair, RobustParams};
use ravec::raster::{AnyImage, Image, PremulLinearRgba};

/// Pairs of points from two arrays of shape (N, 2).
fn pairs(
    src: &PyReadonlyArray2<'_, f64>,
    dst: &PyReadonlyArray2<'_, f64>,
) -> PyResult<Vec<PointPair>> {
    if src.shape() != dst.shape() || src.shape()[1] != 2 {
        return Err(of_request(format!(
            "points are two arrays of the same shape (N, 2), not {:?} and {:?}",
            src.shape(),
            dst.shape()
        )));
    }
    let (src, dst) = (src.as_array(), dst.as_array());
    let rows = src.rows().into_iter().zip(dst.rows());
    Ok(rows
        .map(|(src, dst)| PointPair {
            src: DVec2::new(src[0], src[1]),
            dst: DVec2::new(dst[0], dst[1]),
        })
        .collect())
}

/// The homography of four or more pairs with noise alone, as nine numbers row by row.
#[pyfunction]
pub fn estimate(
    src: PyReadonlyArray2<'_, f64>,
    dst: PyReadonlyArray2<'_, f64>,
) -> PyResult<[f64; 9]> {
    let found = ravec::planar::estimate(&pairs(&src, &dst)?).map_err(of_task)?;
    Ok(found.to_rows())
}

/// The homography of pairs of which many are wrong: nine numbers, which pairs agree, and the noise of the points in pixels.
#[pyfunction]
pub fn estimate_robust(
    py: Python<'_>,
    src: PyReadonlyArray2<'_, f64>,
    dst: PyReadonlyArray2<'_, f64>,
    max_sigma: f64,
    seed: u64,
) -> PyResult<([f64; 9], Vec<bool>, f64)> {
    let pairs = pairs(&src, &dst)?;
    let params = RobustParams {
        max_sigma_px: max_sigma,
        seed,
        ..RobustParams::default()
    };
    let found = work::run(py, None, move |_| {
        ravec::planar::estimate_robust(&pairs, &params).map_err(of_task)
    })?;
    Ok((found.dst_from_src.to_rows(), found.inliers, found.sigma_px))
}

/// A picture seen through a homography, from the picture to the result, with black beyond it, transparent where the picture has alpha.
#[pyfunction]
#[pyo3(signature = (image, matrix, width, height, color_space = "srgb", progress = None))]
pub fn warp(
    py: Python<'_>,
    image: &Bound<'_, PyAny>,
    matrix: [f64; 9],
    width: usize,
    height: usize,
    color_space: &str,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<Py<PyAny>> {
    let (image, kind) = array::picture(image, PixelKind::is_linear(color_space)?)?;
    let size = array::result_size(width as f64, height as f64)?;
    let matrix = DMat3::from_cols_array(&matrix).transpose();
    let map = Homography::from_matrix(matrix).map_err(of_request)?;
    let device = device(py)?;
    let used = device.clone();
    let pixels = image.size().pixels().max(size.pixels());
    let image = work::run_sized(py, pixels, progress, move |progress| {
        let has_alpha = image.has_alpha();
        let pixels: Image<PremulLinearRgba> = image.convert();
        let opacity = if has_alpha { 0.0 } else { 1.0 };
        let beyond = Beyond::Pixel(PremulLinearRgba([0.0, 0.0, 0.0, opacity]));
        let warped = used
            .warp_homography(&pixels, &map.inverse(), size, beyond, progress)
            .map_err(of_task)?;
        Ok(if has_alpha {
            AnyImage::LinearAlpha(warped.convert())
        } else {
            AnyImage::Linear(warped.convert())
        })
    })?;
    device::warn(py, &device)?;
    array::array(py, image, kind)
}

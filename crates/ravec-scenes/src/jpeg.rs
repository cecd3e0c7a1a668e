//! The damage that JPEG compression does, without the file.
//!
//! Entropy coding is lossless, so only the lossy steps are done: YCbCr (rounded to 8 bit), optional 4:2:0 subsampling,
//! the 8×8 discrete cosine transform, quantization by the example tables of the standard scaled by quality as libjpeg
//! does, and all of it back.
//!
//! Source: ITU-T T.81, annexes A and K; JFIF 1.02. Differs from a given decoder by its rounding in the transforms (ours
//! are in floats) and its chroma upsampling (ours is linear, as libjpeg's "fancy" one).
//!
//! Cost: about 2000 multiplications a block and plane; rows of blocks in parallel.

use ravec_raster::{Image, Plane, Size, Srgb};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Parameters of the compression.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct JpegParams {
    /// 1 (worst) to 100 (best; still not lossless), clamped. 30 shows blocks and ringing, 90 hardly anything.
    pub quality: u8,
    /// `true` if color is stored at half the resolution, as cameras do (4:2:0).
    pub subsampled: bool,
}

impl Default for JpegParams {
    fn default() -> Self {
        Self {
            quality: 75,
            subsampled: true,
        }
    }
}

const LUMA: [u16; 64] = [
    16, 11, 10, 16, 24, 40, 51, 61, 12, 12, 14, 19, 26, 58, 60, 55, 14, 13, 16, 24, 40, 57, 69, 56,
    14, 17, 22, 29, 51, 87, 80, 62, 18, 22, 37, 56, 68, 109, 103, 77, 24, 35, 55, 64, 81, 104, 113,
    92, 49, 64, 78, 87, 103, 121, 120, 101, 72, 92, 95, 98, 112, 100, 103, 99,
];
const CHROMA: [u16; 64] = [
    17, 18, 24, 47, 99, 99, 99, 99, 18, 21, 26, 66, 99, 99, 99, 99, 24, 26, 56, 99, 99, 99, 99, 99,
    47, 66, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99,
    99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99,
];

/// The picture after compression and decompression.
pub fn add_jpeg_damage(image: &Image<Srgb<u8>>, params: &JpegParams) -> Image<Srgb<u8>> {
    let [y, cb, cr] = [0, 1, 2].map(|channel| image.map(|Srgb(rgb)| ycc_from_rgb(rgb)[channel]));
    let luma = quantized(&y, &scaled(&LUMA, params.quality));
    let table = scaled(&CHROMA, params.quality);
    let chroma = |plane: &Plane| {
        if params.subsampled {
            doubled(&quantized(&halved(plane), &table), plane.size())
        } else {
            quantized(plane, &table)
        }
    };
    let (cb, cr) = (chroma(&cb), chroma(&cr));
    let mut decoded = image.clone();
    decoded.for_each_row(|row, pixels| {
        for (col, pixel) in pixels.iter_mut().enumerate() {
            let at = (col, row);
            *pixel = Srgb(rgb_from_ycc([luma[at], cb[at], cr[at]]));
        }
    });
    decoded
}

/// The table of quantization steps for a quality, as libjpeg scales it.
fn scaled(table: &[u16; 64], quality: u8) -> [f32; 64] {
    let quality = i32::from(quality.clamp(1, 100));
    let percent = if quality < 50 {
        5000 / quality
    } else {
        200 - 2 * quality
    };
    table.map(|step| ((i32::from(step) * percent + 50) / 100).clamp(1, 255) as f32)
}

fn ycc_from_rgb(rgb: [u8; 3]) -> [f32; 3] {
    let [r, g, b] = rgb.map(f32::from);
    [
        0.299 * r + 0.587 * g + 0.114 * b,
        -0.168_735_89 * r - 0.331_264_11 * g + 0.5 * b + 128.0,
        0.5 * r - 0.418_687_59 * g - 0.081_312_41 * b + 128.0,
    ]
    .map(|v| v.round().min(255.0))
}

fn rgb_from_ycc([y, cb, cr]: [f32; 3]) -> [u8; 3] {
    let (cb, cr) = (cb - 128.0, cr - 128.0);
    // the casts saturate
    [
        y + 1.402 * cr,
        y - 0.344_136_29 * cb - 0.714_136_29 * cr,
        y + 1.772 * cb,
    ]
    .map(|v| v.round() as u8)
}

/// The cosine basis: row k is frequency k, orthonormal.
fn basis() -> [[f32; 8]; 8] {
    let mut basis = [[0.0; 8]; 8];
    for (k, row) in basis.iter_mut().enumerate() {
        let scale = if k == 0 { 0.125f64 } else { 0.25 }.sqrt();
        for (n, value) in row.iter_mut().enumerate() {
            let angle = std::f64::consts::PI * (2 * n + 1) as f64 * k as f64 / 16.0;
            *value = (scale * angle.cos()) as f32;
        }
    }
    basis
}

type Block = [[f32; 8]; 8];

/// `a · b`, or `a · bᵀ`, of 8 × 8 matrices.
fn product(a: &Block, b: &Block, transposed: bool) -> Block {
    let mut c = [[0.0; 8]; 8];
    for i in 0..8 {
        for j in 0..8 {
            c[i][j] = (0..8)
                .map(|k| a[i][k] * if transposed { b[j][k] } else { b[k][j] })
                .sum();
        }
    }
    c
}

fn transpose(a: &Block) -> Block {
    std::array::from_fn(|i| std::array::from_fn(|j| a[j][i]))
}

fn forward(block: &Block, basis: &Block) -> Block {
    product(&product(basis, block, false), basis, true)
}

fn inverse(coefficients: &Block, basis: &Block) -> Block {
    let back = transpose(basis);
    product(&product(&back, coefficients, false), &back, true)
}

/// A plane with each block's coefficients rounded to multiples of the table's steps; values rounded to 0 to 255.
fn quantized(plane: &Plane, table: &[f32; 64]) -> Plane {
    let basis = basis();
    let width = plane.width();
    let mut result = plane.clone();
    result
        .par_strips_mut(8)
        .enumerate()
        .for_each(|(strip, pixels)| {
            for left in (0..width).step_by(8) {
                // the border goes on outside the picture
                let block: Block = std::array::from_fn(|row| {
                    std::array::from_fn(|col| {
                        plane.clamped((left + col) as isize, (8 * strip + row) as isize) - 128.0
                    })
                });
                let mut coefficients = forward(&block, &basis);
                for (value, step) in coefficients.iter_mut().flatten().zip(table) {
                    *value = (*value / step).round() * step;
                }
                let decoded = inverse(&coefficients, &basis);
                for (row, pixels) in pixels.chunks_exact_mut(width).enumerate() {
                    for (pixel, value) in pixels[left..].iter_mut().zip(decoded[row]) {
                        *pixel = (value + 128.0).round().clamp(0.0, 255.0);
                    }
                }
            }
        });
    result
}

/// Means of 2 × 2 pixels, the last column and row repeated where the size is odd.
fn halved(plane: &Plane) -> Plane {
    Image::from_fn(plane.size().cells(2), |col, row| {
        let at = |dx, dy| plane.clamped((2 * col + dx) as isize, (2 * row + dy) as isize);
        (0.25 * (at(0, 0) + at(1, 0) + at(0, 1) + at(1, 1))).round()
    })
}

/// Linear interpolation to twice the size: three quarters of the nearer sample and one of the farther, each way.
fn doubled(plane: &Plane, size: Size) -> Plane {
    Image::from_fn(size, |col, row| {
        let side = |i: usize| if i.is_multiple_of(2) { -1 } else { 1 };
        let (x, y) = ((col / 2) as isize, (row / 2) as isize);
        let (dx, dy) = (side(col), side(row));
        let near = 0.75 * plane.clamped(x, y) + 0.25 * plane.clamped(x + dx, y);
        let far = 0.75 * plane.clamped(x, y + dy) + 0.25 * plane.clamped(x + dx, y + dy);
        (0.75 * near + 0.25 * far).round()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Seed;
    use ravec_raster::Size;

    fn noise(width: usize, height: usize, gray: bool) -> Image<Srgb<u8>> {
        Image::from_fn(Size::new(width, height).unwrap(), |c, r| {
            let at = |k| Seed(5).bits(c as i64, r as i64, k) as u8;
            if gray {
                Srgb([at(0); 3])
            } else {
                Srgb([at(0), at(1), at(2)])
            }
        })
    }

    fn largest_difference(a: &Image<Srgb<u8>>, b: &Image<Srgb<u8>>) -> u8 {
        let pairs = a.pixels().iter().zip(b.pixels());
        pairs
            .flat_map(|(a, b)| a.0.into_iter().zip(b.0))
            .map(|(a, b)| a.abs_diff(b))
            .max()
            .unwrap_or(0)
    }

    /// The definition of annex A.3.3.
    fn forward_naive(block: &Block) -> Block {
        let c = |k: usize| {
            if k == 0 {
                std::f64::consts::FRAC_1_SQRT_2
            } else {
                1.0
            }
        };
        let cosine = |n: usize, k: usize| {
            ((2 * n + 1) as f64 * k as f64 * std::f64::consts::PI / 16.0).cos()
        };
        std::array::from_fn(|v| {
            std::array::from_fn(|u| {
                let mut sum = 0.0;
                for (y, row) in block.iter().enumerate() {
                    for (x, &s) in row.iter().enumerate() {
                        sum += f64::from(s) * cosine(x, u) * cosine(y, v);
                    }
                }
                (0.25 * c(u) * c(v) * sum) as f32
            })
        })
    }

    #[test]
    fn the_transform_is_that_of_the_standard_and_has_its_inverse() {
        for k in 0..20 {
            let block: Block = std::array::from_fn(|r| {
                std::array::from_fn(|c| {
                    Seed(6).between(c as i64, r as i64, k, -128.0, 127.0) as f32
                })
            });
            let fast = forward(&block, &basis());
            let (plain, back) = (forward_naive(&block), inverse(&fast, &basis()));
            for i in 0..64 {
                let at = |b: &Block| b[i / 8][i % 8];
                // sums of 16 products of at most 1024: a few units in the last place of that
                assert!((at(&fast) - at(&plain)).abs() < 1e-3);
                assert!((at(&back) - at(&block)).abs() < 1e-3);
            }
        }
    }

    #[test]
    fn best_quality_is_within_the_bound_of_rounding() {
        // Luma: each of 64 orthonormal coefficients is off by at most 1/2, so the block's error has norm at most 4, and
        // so has a single pixel. Root mean square: each is uniform, 1/√12 = 0.29, and rounding again at most doubles it.
        let image = noise(37, 29, true);
        let decoded = add_jpeg_damage(
            &image,
            &JpegParams {
                quality: 100,
                subsampled: false,
            },
        );
        assert!(largest_difference(&image, &decoded) <= 4);
        let squares: f64 = image
            .pixels()
            .iter()
            .zip(decoded.pixels())
            .map(|(a, b)| f64::from(a.0[0].abs_diff(b.0[0])).powi(2))
            .sum();
        assert!((squares / (37.0 * 29.0)).sqrt() < 0.6);
    }

    #[test]
    fn flat_colors_and_flat_blocks_survive_any_quality_nearly() {
        for quality in [1, 10, 50, 100] {
            for rgb in [[0, 0, 0], [255, 255, 255], [200, 100, 50]] {
                let image = Image::new(Size::new(19, 9).unwrap(), Srgb(rgb));
                for subsampled in [false, true] {
                    let decoded = add_jpeg_damage(
                        &image,
                        &JpegParams {
                            quality,
                            subsampled,
                        },
                    );
                    // the mean of a block is quantized in steps of table/8; half of that, in each of three planes
                    let step = f64::from(scaled(&LUMA, quality)[0]) / 16.0
                        + 1.8 * f64::from(scaled(&CHROMA, quality)[0]) / 16.0;
                    assert!(f64::from(largest_difference(&image, &decoded)) <= step + 3.0);
                    assert!(decoded.pixels().iter().all(|p| *p == decoded[(0, 0)]));
                }
            }
        }
    }

    #[test]
    fn lower_quality_damages_more() {
        let image = noise(64, 64, false);
        let error = |quality| {
            let decoded = add_jpeg_damage(
                &image,
                &JpegParams {
                    quality,
                    subsampled: false,
                },
            );
            let pairs = image.pixels().iter().zip(decoded.pixels());
            pairs
                .flat_map(|(a, b)| a.0.into_iter().zip(b.0))
                .map(|(a, b)| f64::from(a.abs_diff(b)).powi(2))
                .sum::<f64>()
        };
        let errors = [95, 75, 50, 20, 5].map(error);
        assert!(
            errors.windows(2).all(|pair| pair[0] < pair[1]),
            "{errors:?}"
        );
    }

    #[test]
    fn tables_scale_as_in_libjpeg() {
        assert_eq!(scaled(&LUMA, 50), LUMA.map(f32::from));
        assert_eq!(scaled(&LUMA, 100), [1.0; 64]);
        assert_eq!(scaled(&LUMA, 25)[0], 32.0);
        assert_eq!(scaled(&LUMA, 1)[0], 255.0);
        assert_eq!(scaled(&LUMA, 0), scaled(&LUMA, 1));
    }

    #[test]
    fn any_size_keeps_its_size() {
        for (width, height) in [(1, 1), (1, 9), (8, 8), (17, 3)] {
            let image = noise(width, height, false);
            assert_eq!(
                add_jpeg_damage(&image, &JpegParams::default()).size(),
                image.size()
            );
        }
    }
}

//! The 8 × 8 cosine transform, in which block codecs work and in which noise and structure part.

/// Side of a block.
pub(super) const SIDE: usize = 8;

/// A block of values or of coefficients, row by row.
pub(super) type Block = [[f32; SIDE]; SIDE];

/// Row `u` holds the samples of cosine `u`; orthonormal.
static BASIS: std::sync::LazyLock<Block> = std::sync::LazyLock::new(|| {
    std::array::from_fn(|u| {
        let scale = if u == 0 {
            (1.0 / SIDE as f64).sqrt()
        } else {
            (2.0 / SIDE as f64).sqrt()
        };
        std::array::from_fn(|x| {
            let angle = std::f64::consts::PI * (2 * x + 1) as f64 * u as f64 / (2 * SIDE) as f64;
            (scale * angle.cos()) as f32
        })
    })
});

/// The block of values that lie row by row.
#[inline(always)]
pub(super) fn block_of(values: &[f32; SIDE * SIDE]) -> Block {
    let (rows, _) = values.as_chunks();
    std::array::from_fn(|row| rows[row])
}

/// `a · b`, in loops, as closures are not compiled for the vectors of the caller.
#[inline(always)]
fn product(a: &Block, b: &Block) -> Block {
    let mut product = [[0.0; SIDE]; SIDE];
    for (row, factors) in product.iter_mut().zip(a) {
        for (&factor, b_row) in factors.iter().zip(b) {
            for (sum, &value) in row.iter_mut().zip(b_row) {
                *sum += factor * value;
            }
        }
    }
    product
}

#[inline(always)]
fn transposed(a: &Block) -> Block {
    let mut transposed = [[0.0; SIDE]; SIDE];
    for (row, values) in a.iter().enumerate() {
        for (col, &value) in values.iter().enumerate() {
            transposed[col][row] = value;
        }
    }
    transposed
}

/// The orthonormal cosine coefficients of a block, `[vertical][horizontal]` frequency.
#[inline(always)]
pub(super) fn forward(block: &Block) -> Block {
    let basis = &*BASIS;
    product(&product(basis, block), &transposed(basis))
}

/// The block of given coefficients.
pub(super) fn inverse(coefficients: &Block) -> Block {
    let basis = &*BASIS;
    product(&product(&transposed(basis), coefficients), basis)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_transform_is_orthonormal_and_its_inverse_undoes_it() {
        let block: Block =
            std::array::from_fn(|y| std::array::from_fn(|x| ((x * 5 + y * 3) % 7) as f32 - 2.0));
        let coefficients = forward(&block);
        let energy = |b: &Block| b.iter().flatten().map(|v| v * v).sum::<f32>();
        assert!((energy(&block) / energy(&coefficients) - 1.0).abs() < 1e-5);
        for (a, b) in inverse(&coefficients)
            .iter()
            .flatten()
            .zip(block.iter().flatten())
        {
            assert!((a - b).abs() < 1e-5);
        }
    }

    #[test]
    fn a_cosine_has_one_coefficient() {
        let block: Block = std::array::from_fn(|_| {
            std::array::from_fn(|x| (std::f32::consts::PI * (2 * x + 1) as f32 * 3.0 / 16.0).cos())
        });
        for (v, row) in forward(&block).iter().enumerate() {
            for (u, &value) in row.iter().enumerate() {
                // 8 rows of a cosine with squared norm 4
                let expected = if (v, u) == (0, 3) {
                    32.0f32.sqrt()
                } else {
                    0.0
                };
                assert!((value - expected).abs() < 1e-5);
            }
        }
    }
}

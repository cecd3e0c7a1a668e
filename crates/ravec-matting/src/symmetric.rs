//! Symmetric 3 × 3 matrices as six entries: xx, yy, zz, xy, xz, yz.

use std::ops::{Add, Mul, Sub};

/// Adjugate and determinant. The inverse is their quotient.
#[inline(always)]
pub(crate) fn adjugate<T>([xx, yy, zz, xy, xz, yz]: [T; 6]) -> ([T; 6], T)
where
    T: Copy + Add<Output = T> + Sub<Output = T> + Mul<Output = T>,
{
    let cofactors = [
        yy * zz - yz * yz,
        xx * zz - xz * xz,
        xx * yy - xy * xy,
        xz * yz - xy * zz,
        xy * yz - xz * yy,
        xy * xz - xx * yz,
    ];
    let determinant = xx * cofactors[0] + xy * cofactors[3] + xz * cofactors[4];
    (cofactors, determinant)
}

/// Product of a matrix and a vector.
#[inline(always)]
pub(crate) fn product([xx, yy, zz, xy, xz, yz]: &[f32; 6], [x, y, z]: [f32; 3]) -> [f32; 3] {
    [
        xx * x + xy * y + xz * z,
        xy * x + yy * y + yz * z,
        xz * x + yz * y + zz * z,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_adjugate_over_the_determinant_is_the_inverse() {
        let matrix = [4.0f32, 5.0, 6.0, 1.0, -2.0, 0.5];
        let (cofactors, determinant) = adjugate(matrix);
        let vector = [1.0, -3.0, 2.0];
        let back = product(&cofactors, product(&matrix, vector)).map(|value| value / determinant);
        assert!(
            (0..3).all(|c| (back[c] - vector[c]).abs() < 1e-5),
            "{back:?}"
        );
    }
}

//! The matrix by which a track is displayed.

use crate::info::Rotation;

/// One in the first two columns of a matrix of an MP4 file.
const ONE: i32 = 1 << 16;

/// The turn of a matrix of display; `None` if it mirrors, shears or turns by other angles.
pub(super) fn rotation_of(matrix: &[i32; 9]) -> Option<Rotation> {
    // pixels are scaled to the size of the track, which the matrix may repeat as a scale
    let signs = [0, 1, 3, 4].map(|at| matrix[at].signum());
    if matrix[2] != 0 || matrix[5] != 0 {
        return None;
    }
    match signs {
        [1, 0, 0, 1] => Some(Rotation::None),
        [0, 1, -1, 0] => Some(Rotation::Clockwise),
        [-1, 0, 0, -1] => Some(Rotation::Half),
        [0, -1, 1, 0] => Some(Rotation::Counterclockwise),
        [0, 0, 0, 0] => Some(Rotation::None),
        _ => None,
    }
}

/// The matrix of upright frames.
pub(super) const UPRIGHT: [i32; 9] = [ONE, 0, 0, 0, ONE, 0, 0, 0, 1 << 30];

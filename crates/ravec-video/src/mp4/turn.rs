//! Frames that are stored turned.

use crate::color::{ColorInfo, Siting, SitingAxis, Subsampling};
use crate::info::Rotation;
use crate::yuv::{SamplePlane, YuvFormat, YuvImage};
use ravec_raster::{Image, Pixel, Size};

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

/// True if columns become rows.
pub(super) fn swaps_sides(rotation: Rotation) -> bool {
    matches!(rotation, Rotation::Clockwise | Rotation::Counterclockwise)
}

/// The size of turned frames.
pub(super) fn turned_size(size: Size, rotation: Rotation) -> Size {
    if swaps_sides(rotation) {
        Size::new(size.height(), size.width()).expect("the sides of a size")
    } else {
        size
    }
}

/// The layout of turned frames.
pub(super) fn turned_format(format: YuvFormat, rotation: Rotation) -> YuvFormat {
    let subsampling = match format.subsampling {
        Subsampling::S422 if swaps_sides(rotation) => Subsampling::S440,
        Subsampling::S440 if swaps_sides(rotation) => Subsampling::S422,
        other => other,
    };
    YuvFormat {
        subsampling,
        ..format
    }
}

/// The meaning of the samples of turned frames: chroma turns with its luma.
pub(super) fn turned_color(color: ColorInfo, rotation: Rotation) -> ColorInfo {
    let reversed = |axis| match axis {
        SitingAxis::First => SitingAxis::Last,
        SitingAxis::Center => SitingAxis::Center,
        SitingAxis::Last => SitingAxis::First,
    };
    let Siting { x, y } = color.siting;
    let siting = match rotation {
        Rotation::None => color.siting,
        Rotation::Clockwise => Siting {
            x: reversed(y),
            y: x,
        },
        Rotation::Half => Siting {
            x: reversed(x),
            y: reversed(y),
        },
        Rotation::Counterclockwise => Siting {
            x: y,
            y: reversed(x),
        },
    };
    ColorInfo { siting, ..color }
}

/// A frame as it is shown.
pub(super) fn turned(frame: YuvImage, rotation: Rotation) -> YuvImage {
    if rotation == Rotation::None {
        return frame;
    }
    let planes = frame
        .planes()
        .iter()
        .map(|plane| match plane {
            SamplePlane::U8(plane) => SamplePlane::U8(turned_plane(plane, rotation)),
            SamplePlane::U16(plane) => SamplePlane::U16(turned_plane(plane, rotation)),
        })
        .collect();
    let format = turned_format(frame.format(), rotation);
    YuvImage::new(format, turned_color(frame.color(), rotation), planes)
        .expect("all planes turn alike")
}

fn turned_plane<P: Pixel>(plane: &Image<P>, rotation: Rotation) -> Image<P> {
    let (right, bottom) = (plane.width() - 1, plane.height() - 1);
    let pixels = plane.pixels();
    let width = plane.width();
    let at = |col: usize, row: usize| pixels[row * width + col];
    Image::from_fn(
        turned_size(plane.size(), rotation),
        |col, row| match rotation {
            Rotation::None => at(col, row),
            Rotation::Clockwise => at(row, bottom - col),
            Rotation::Half => at(right - col, bottom - row),
            Rotation::Counterclockwise => at(right - row, col),
        },
    )
}

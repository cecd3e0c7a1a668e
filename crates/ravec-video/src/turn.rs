//! Quarter turns of frames, without a change of any sample.

use crate::color::{ColorInfo, SitingAxis, Subsampling};
use crate::frame::FramePicture;
use crate::info::Rotation;
use crate::yuv::{SamplePlane, YuvFormat, YuvImage};
use ravec_raster::{AnyImage, Image, Pixel, Size, with_image};

/// The frame turned for display. Planes of 4:1:1, for which there is no turned layout, become colors.
pub(crate) fn turned(picture: FramePicture, rotation: Rotation) -> FramePicture {
    if rotation == Rotation::None {
        return picture;
    }
    let planes = match picture {
        FramePicture::Yuv(planes) => planes,
        FramePicture::Image(image) => {
            return FramePicture::Image(
                with_image!(&image, image => AnyImage::from(turn(image, rotation))),
            );
        }
    };
    match turned_planes(&planes, rotation) {
        Some(planes) => FramePicture::Yuv(planes),
        None => turned(
            FramePicture::Image(crate::image_from_yuv(&planes)),
            rotation,
        ),
    }
}

/// The planes turned for display; `None` if there is no turned layout.
pub(crate) fn turned_planes(planes: &YuvImage, rotation: Rotation) -> Option<YuvImage> {
    let format = turned_format(planes.format(), rotation)?;
    let color = turned_color(planes.color(), rotation);
    let planes = planes.planes().iter().map(|plane| match plane {
        SamplePlane::U8(plane) => SamplePlane::U8(turn(plane, rotation)),
        SamplePlane::U16(plane) => SamplePlane::U16(turn(plane, rotation)),
    });
    YuvImage::new(format, color, planes.collect()).ok()
}

/// The size of turned frames.
pub(crate) fn turned_size(size: Size, rotation: Rotation) -> Size {
    if is_quarter(rotation) {
        size.transposed()
    } else {
        size
    }
}

/// True for the turns that exchange columns and rows.
pub(crate) fn is_quarter(rotation: Rotation) -> bool {
    matches!(rotation, Rotation::Clockwise | Rotation::Counterclockwise)
}

/// The layout of turned planes; `None` if there is none.
pub(crate) fn turned_format(format: YuvFormat, rotation: Rotation) -> Option<YuvFormat> {
    let subsampling = match format.subsampling {
        Subsampling::S422 if is_quarter(rotation) => Subsampling::S440,
        Subsampling::S440 if is_quarter(rotation) => Subsampling::S422,
        Subsampling::S411 if is_quarter(rotation) => return None,
        other => other,
    };
    Some(YuvFormat {
        subsampling,
        ..format
    })
}

/// The places of chroma samples in turned frames.
pub(crate) fn turned_color(color: ColorInfo, rotation: Rotation) -> ColorInfo {
    let opposite = |axis| match axis {
        SitingAxis::First => SitingAxis::Last,
        SitingAxis::Center => SitingAxis::Center,
        SitingAxis::Last => SitingAxis::First,
    };
    let mut siting = color.siting;
    (siting.x, siting.y) = match rotation {
        Rotation::None => (siting.x, siting.y),
        Rotation::Clockwise => (opposite(siting.y), siting.x),
        Rotation::Half => (opposite(siting.x), opposite(siting.y)),
        Rotation::Counterclockwise => (siting.y, opposite(siting.x)),
    };
    ColorInfo { siting, ..color }
}

fn turn<P: Pixel>(image: &Image<P>, rotation: Rotation) -> Image<P> {
    let (last_col, last_row) = (image.width() - 1, image.height() - 1);
    Image::from_fn(
        turned_size(image.size(), rotation),
        |col, row| match rotation {
            Rotation::None => image[(col, row)],
            Rotation::Clockwise => image[(row, last_row - col)],
            Rotation::Half => image[(last_col - col, last_row - row)],
            Rotation::Counterclockwise => image[(last_col - row, col)],
        },
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::Siting;

    fn numbered(width: usize, height: usize) -> Image<u8> {
        let size = Size::new(width, height).unwrap();
        Image::from_fn(size, |col, row| (10 * row + col) as u8)
    }

    #[test]
    fn a_turn_moves_the_corners() {
        let image = numbered(3, 2);
        let clockwise = turn(&image, Rotation::Clockwise);
        assert_eq!(clockwise.pixels(), [10, 0, 11, 1, 12, 2]);
        let half = turn(&image, Rotation::Half);
        assert_eq!(half.pixels(), [12, 11, 10, 2, 1, 0]);
        let counterclockwise = turn(&image, Rotation::Counterclockwise);
        assert_eq!(counterclockwise.pixels(), [2, 12, 1, 11, 0, 10]);
        assert_eq!(turn(&counterclockwise, Rotation::Clockwise), image);
    }

    #[test]
    fn turned_frames_have_the_colors_of_turned_pictures() {
        let size = Size::new(8, 6).unwrap();
        for subsampling in [
            Subsampling::S420,
            Subsampling::S422,
            Subsampling::S440,
            Subsampling::S411,
        ] {
            let format = YuvFormat {
                subsampling,
                ..YuvFormat::YUV420P8
            };
            let planes = format
                .plane_sizes(size)
                .iter()
                .map(|size| {
                    SamplePlane::U8(Image::from_fn(*size, |col, row| {
                        (90 + 9 * col + 13 * row) as u8
                    }))
                })
                .collect();
            let color = ColorInfo {
                siting: Siting::TOP_LEFT,
                ..ColorInfo::guess(6)
            };
            let frame = YuvImage::new(format, color, planes).unwrap();
            let upright = crate::image_from_yuv(&frame);
            for rotation in [
                Rotation::None,
                Rotation::Clockwise,
                Rotation::Half,
                Rotation::Counterclockwise,
            ] {
                let found = turned(FramePicture::Yuv(frame.clone()), rotation);
                let truth = turned(FramePicture::Image(upright.clone()), rotation);
                assert_eq!(
                    *found.to_image(),
                    *truth.to_image(),
                    "{subsampling:?} {rotation:?}"
                );
            }
        }
    }
}

//! Masks from files, for all operations that take some.

use crate::context::Context;
use crate::error::JobError;
use crate::files;
use crate::report::Report;
use ravec::raster::{AnyImage, Image, Mask, Plane, Size, Srgba};
use std::path::Path;

/// Reads a mask of the picture in `picture`: white is inside, black is outside, gray is partly inside. Alpha is multiplied in.
///
/// # Errors
/// [`JobError::SizesDiffer`] if it does not have the size of the picture; those of [`files::read`].
pub(crate) fn read_mask(
    path: &Path,
    picture: &Path,
    size: Size,
    report: &mut Report,
    context: &Context,
) -> Result<Mask, JobError> {
    let mask = files::read(path, report, context)?.image;
    if mask.size() != size {
        return Err(JobError::SizesDiffer {
            a: picture.to_path_buf(),
            a_size: size,
            b: path.to_path_buf(),
            b_size: mask.size(),
        });
    }
    Ok(mask_of(&mask))
}

/// The mask that a picture shows: white is inside, black is outside, gray is partly inside. Alpha is multiplied in.
pub(crate) fn mask_of(image: &AnyImage) -> Mask {
    // encoded values, as one sees them
    let values: Image<Srgba<f32>> = image.convert();
    let plane: Plane =
        values.map(|Srgba([r, g, b, alpha])| alpha * (0.299 * r + 0.587 * g + 0.114 * b));
    // white is white in spite of rounding, and black black
    Mask::from_coverage(&plane.map(|value| (value * 65535.0).round() / 65535.0))
}

//! Masks from files, for all operations that take some.

use crate::error::JobError;
use crate::files::{self, Source};
use crate::report::Report;
use ravec::progress::Progress;
use ravec::raster::{AnyImage, Image, Mask, Plane, Size, Srgba};
use std::path::Path;

/// Reads a mask for a `picture`, given by its path and size: white covers, black does not, gray covers in part.
///
/// # Errors
/// [`JobError::SizesDiffer`] if the mask has another size; otherwise as [`files::read`].
pub(crate) fn read_mask(
    mask: &Source,
    (picture, size): (&Path, Size),
    report: &mut Report,
    progress: &Progress,
) -> Result<Mask, JobError> {
    let image = files::read(mask, report, progress)?.image;
    if image.size() == size {
        return Ok(coverage(&image));
    }
    Err(JobError::SizesDiffer {
        a: picture.to_path_buf(),
        a_size: size,
        b: mask.path.clone(),
        b_size: image.size(),
    })
}

/// How white a mask is: encoded values, as one sees them, times alpha.
fn coverage(mask: &AnyImage) -> Mask {
    let values: Image<Srgba<f32>> = mask.convert();
    let plane: Plane =
        values.map(|Srgba([r, g, b, alpha])| alpha * (0.299 * r + 0.587 * g + 0.114 * b));
    // white is white in spite of rounding, and black black
    Mask::from_coverage(&plane.map(|value| (value * 65535.0).round() / 65535.0))
}

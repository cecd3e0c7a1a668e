//! Parameters and errors of retargeting.

use ravec_progress::Cancelled;
use ravec_raster::Size;

/// Freedom of the vertices on the border of a picture.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(rename_all = "kebab-case")
)]
pub enum Borders {
    /// Along itself.
    ///
    /// Each vertex moves on its own.
    #[default]
    Slide,
    /// Along itself, opposite borders alike: what tiles still does.
    Symmetric,
    /// Along itself and out of the frame, where that costs little.
    ///
    /// Unimportant content may be cut off, up to [`RetargetParams::max_crop`] of a side, or a tenth if that is 0.
    Free,
}

/// Parameters of analysis and deformation.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct RetargetParams {
    /// Cells along the longer side, 2 to 400. More follow smaller objects and cost more; below 30 small objects share a cell
    /// with their surroundings. By default 100, and 50 for pictures of at most 800 pixels a side, where they are a third of the
    /// cost.
    pub grid_cells: Option<usize>,
    /// Large cells where the picture is even (default no): a fraction of the unknowns, for large grids.
    pub adaptive: bool,
    /// Weight of closed regions that stand out from the picture's border, 0 to 1 (default 1). With 0 only contrast
    /// counts and what is painted.
    pub saliency: f64,
    /// Weight of straight lines, 0 to 10 (default 1). 0 lets them bend.
    pub line_strength: f64,
    /// The size that important content gets, 0.25 to 4 (default 1: its own), within what the new format allows. Less keeps
    /// shapes better at strong reductions, with smaller objects.
    pub object_scale: f64,
    /// Freedom of the vertices on the border (default along it).
    pub borders: Borders,
    /// The share of the width or of the height that may be cut off if that lowers the energy, 0 to 0.5 (default 0).
    pub max_crop: f64,
}

/// Fewest cells along the longer side.
const MIN_CELLS: f64 = 2.0;

impl Default for RetargetParams {
    fn default() -> Self {
        Self {
            grid_cells: None,
            adaptive: false,
            saliency: 1.0,
            line_strength: 1.0,
            object_scale: 1.0,
            borders: Borders::default(),
            max_crop: 0.0,
        }
    }
}

/// Refuses the value of a field that is not within its range: field, value, least, most, and the range in words.
pub(crate) fn check_range(
    (field, value, low, high, range): (&'static str, f64, f64, f64, &'static str),
) -> Result<(), RetargetError> {
    if (low..=high).contains(&value) {
        return Ok(());
    }
    Err(RetargetError::Parameter {
        field,
        value,
        range,
    })
}

impl RetargetParams {
    /// Checks every range.
    ///
    /// # Errors
    /// [`RetargetError::Parameter`] with the first value out of range.
    pub fn check(&self) -> Result<(), RetargetError> {
        let cells = self.grid_cells.map_or(MIN_CELLS, |cells| cells as f64);
        let ranges = [
            ("grid_cells", cells, MIN_CELLS, 400.0, "2 to 400"),
            ("saliency", self.saliency, 0.0, 1.0, "0 to 1"),
            ("line_strength", self.line_strength, 0.0, 10.0, "0 to 10"),
            ("object_scale", self.object_scale, 0.25, 4.0, "0.25 to 4"),
            ("max_crop", self.max_crop, 0.0, 0.5, "0 to 0.5"),
        ];
        ranges.into_iter().try_for_each(check_range)
    }
}

/// Why a picture or a clip was not retargeted.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RetargetError {
    /// A parameter is out of range.
    #[error("`{field}` is {value}, but must be {range}")]
    Parameter {
        /// The field of [`RetargetParams`].
        field: &'static str,
        /// The invalid value.
        value: f64,
        /// The allowed values.
        range: &'static str,
    },
    /// A mask must have the size of the picture.
    #[error(
        "the {which} mask has {got} pixels, the picture {image}: paint the mask on a copy of the picture"
    )]
    MaskSize {
        /// Name of the mask.
        which: &'static str,
        /// The size of the mask.
        got: Size,
        /// The size of the picture.
        image: Size,
    },
    /// The new size is too far from the old one.
    #[error(
        "a picture of {image} pixels cannot become {target}: each side may change to between 1/20 and 20 times its length"
    )]
    Factor {
        /// The size of the picture.
        image: Size,
        /// The requested size.
        target: Size,
    },
    /// The picture to be warped has another shape than the analyzed one.
    #[error(
        "the picture to warp has {got} pixels, but the analyzed one {analyzed}: both need the same proportions"
    )]
    OtherShape {
        /// The size of the picture to warp.
        got: Size,
        /// The size of the analyzed picture.
        analyzed: Size,
    },
    /// A clip needs at least one target size, and a frame has only those of its clip.
    #[error("there is no such target size: name at least one")]
    NoTarget,
    /// All frames of a clip have one size.
    #[error("frame {frame} has {got} pixels, but the clip has {clip}")]
    FrameSize {
        /// Number of the frame, from 0.
        frame: usize,
        /// Its size.
        got: Size,
        /// The size of the clip.
        clip: Size,
    },
    /// The motion of the camera is not a motion.
    #[error(
        "the motion of the camera before frame {frame} is no homography that keeps the frame in view: give the identity where the motion is unknown"
    )]
    Motion {
        /// Number of the frame, from 0.
        frame: usize,
    },
    /// The system could not be factored, which only numbers out of all proportion can cause.
    #[error("the deformation cannot be computed: lower the strengths")]
    Singular,
    /// The caller cancelled.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_out_of_range_are_named() {
        let wrong = [
            (
                RetargetParams {
                    grid_cells: Some(1),
                    ..RetargetParams::default()
                },
                "`grid_cells` is 1, but must be 2 to 400",
            ),
            (
                RetargetParams {
                    saliency: f64::NAN,
                    ..RetargetParams::default()
                },
                "`saliency` is NaN, but must be 0 to 1",
            ),
            (
                RetargetParams {
                    line_strength: -1.0,
                    ..RetargetParams::default()
                },
                "`line_strength` is -1, but must be 0 to 10",
            ),
            (
                RetargetParams {
                    object_scale: 0.0,
                    ..RetargetParams::default()
                },
                "`object_scale` is 0, but must be 0.25 to 4",
            ),
            (
                RetargetParams {
                    max_crop: 0.7,
                    ..RetargetParams::default()
                },
                "`max_crop` is 0.7, but must be 0 to 0.5",
            ),
        ];
        for (params, sentence) in wrong {
            let error = params.check().unwrap_err();
            assert_eq!(error.to_string(), sentence);
        }
        assert_eq!(RetargetParams::default().check(), Ok(()));
    }
}

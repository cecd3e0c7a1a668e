//! Parameters of retargeting.

use super::SizeSpec;
use crate::corners::{Corners, check_polygons, with_polygons};
use crate::error::JobError;
use crate::pixel_centers::PixelCenters;
use crate::report::Report;
use crate::video::Encoding;
use ravec::raster::{Mask, Size};
use ravec::retarget::{Borders, RetargetError, RetargetParams};
use ravec_media::WriteOptions;
use serde::{Deserialize, Serialize};

/// Parameters of [`Retarget`](super::Retarget).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct Params {
    /// The new size, as in 1080x1080, 75%x100%, 1080x or 50%. May be repeated: the picture is analyzed once
    ///
    /// A side that is left out stays as it is.
    #[cfg_attr(
        feature = "cli",
        arg(short, long = "size", value_name = "WxH", required = true)
    )]
    pub sizes: Vec<SizeSpec>,
    /// Keep the picture's aspect: a side that is left out follows the other one, and of two the picture fits into both
    #[cfg_attr(feature = "cli", arg(long))]
    pub keep_aspect: bool,
    /// The corners X0,Y0,X1,Y1,... of a polygon that is protected, too. May be repeated
    #[cfg_attr(
        feature = "cli",
        arg(
            long = "protect-polygon",
            value_name = "X0,Y0,...",
            allow_hyphen_values = true
        )
    )]
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub protect_polygons: Vec<Corners>,
    /// The corners of a polygon that may give way, too. May be repeated
    #[cfg_attr(
        feature = "cli",
        arg(
            long = "give-way-polygon",
            value_name = "X0,Y0,...",
            allow_hyphen_values = true
        )
    )]
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub give_way_polygons: Vec<Corners>,
    /// Center of the first pixel in points that are given or printed: half is (0.5, 0.5), integer is (0, 0)
    #[cfg_attr(feature = "cli", arg(long, value_enum, value_name = "CENTERS", default_value_t = PixelCenters::Half))]
    #[serde(skip_serializing_if = "PixelCenters::is_half")]
    pub pixel_centers: PixelCenters,
    /// Cells of the grid along the longer side, 2 to 400 [default: 100, and 50 for pictures of at most 800 pixels a side]. More
    /// follow smaller objects, and cost more
    #[cfg_attr(feature = "cli", arg(long, value_name = "CELLS"))]
    pub grid: Option<usize>,
    /// Use large cells where the picture is even
    #[cfg_attr(feature = "cli", arg(long))]
    pub adaptive: bool,
    /// Weight of closed regions that stand out, 0 to 1. With 0, contrast and masks decide alone
    #[cfg_attr(feature = "cli", arg(long, value_name = "SHARE", default_value_t = Self::default().saliency))]
    pub saliency: f64,
    /// Weight of straight lines, 0 to 10
    #[cfg_attr(feature = "cli", arg(long, value_name = "STRENGTH", default_value_t = Self::default().lines))]
    pub lines: f64,
    /// The scale of what matters, 0.25 to 4, as far as the new size allows. Less keeps shapes better at strong reductions
    #[cfg_attr(feature = "cli", arg(long, value_name = "SCALE", default_value_t = Self::default().object_scale))]
    pub object_scale: f64,
    /// Motion of the border of the picture
    #[cfg_attr(feature = "cli", arg(long, value_enum, default_value_t = Self::default().borders))]
    pub borders: Borders,
    /// The share of a side that may be cut off, 0 to 0.5, if that is less loss than squeezing
    #[cfg_attr(feature = "cli", arg(long, value_name = "SHARE", default_value_t = Self::default().crop))]
    pub crop: f64,
    /// Quality of a JPEG output, 1 to 100: higher is larger and closer to the picture
    #[cfg_attr(feature = "cli", arg(long, value_name = "QUALITY", default_value_t = Self::default().quality))]
    pub quality: u8,
    /// Of a clip: seconds before and after a frame that its deformation considers, above 0, up to 10. More moves the background
    /// less while objects pass, and holds more frames in memory
    #[cfg_attr(feature = "cli", arg(long, value_name = "SECONDS", default_value_t = Self::default().look_ahead))]
    pub look_ahead: f64,
    /// Of a clip: the camera stands still; its motion is not estimated
    #[cfg_attr(feature = "cli", arg(long))]
    pub still_camera: bool,
    /// Encoding of a clip.
    #[cfg_attr(feature = "cli", command(flatten))]
    pub encoding: Encoding,
}

impl Default for Params {
    fn default() -> Self {
        let options = RetargetParams::default();
        Self {
            sizes: Vec::new(),
            keep_aspect: false,
            protect_polygons: Vec::new(),
            give_way_polygons: Vec::new(),
            pixel_centers: PixelCenters::default(),
            grid: options.grid_cells,
            adaptive: options.adaptive,
            saliency: options.saliency,
            lines: options.line_strength,
            object_scale: options.object_scale,
            borders: options.borders,
            crop: options.max_crop,
            quality: WriteOptions::default().quality,
            look_ahead: 1.0,
            still_camera: false,
            encoding: Encoding::default(),
        }
    }
}

/// Fields of [`RetargetParams`] that have another name here, and that name.
const RENAMED: [(&str, &str); 3] = [
    ("grid_cells", "grid"),
    ("line_strength", "lines"),
    ("max_crop", "crop"),
];

impl Params {
    /// The parameters of the library.
    pub fn options(&self) -> RetargetParams {
        RetargetParams {
            grid_cells: self.grid,
            adaptive: self.adaptive,
            saliency: self.saliency,
            line_strength: self.lines,
            object_scale: self.object_scale,
            borders: self.borders,
            max_crop: self.crop,
        }
    }

    /// The masks of what is protected and of what gives way with the polygons of the parameters, in a picture of this size.
    ///
    /// # Errors
    /// [`JobError::Parameter`] for coordinates beyond ±1e9.
    pub fn with_polygons(
        &self,
        protect: Option<Mask>,
        give_way: Option<Mask>,
        size: Size,
    ) -> Result<(Option<Mask>, Option<Mask>), JobError> {
        let add = |mask: Option<Mask>, field, polygons: &[Corners]| {
            if polygons.is_empty() {
                return Ok(mask);
            }
            let mask = mask.unwrap_or_else(|| Mask::empty(size));
            with_polygons(mask, field, polygons, self.pixel_centers).map(Some)
        };
        Ok((
            add(protect, "protect_polygons", &self.protect_polygons)?,
            add(give_way, "give_way_polygons", &self.give_way_polygons)?,
        ))
    }

    /// Warns of polygons whose bounding box lies beside the picture.
    pub(super) fn warn_of_polygons_outside(&self, size: Size, report: &mut Report) {
        for (name, polygons) in [
            ("protect", &self.protect_polygons),
            ("give-way", &self.give_way_polygons),
        ] {
            for (index, polygon) in polygons.iter().enumerate() {
                if polygon.is_outside(size, self.pixel_centers) {
                    report.record_dropped(format!(
                        "nothing of {name} polygon {} lies in the picture of {size} pixels",
                        index + 1
                    ));
                }
            }
        }
    }

    pub(super) fn check(&self) -> Result<(), JobError> {
        let wrong = |field, value: String, range| {
            Err(JobError::Parameter {
                field,
                value,
                range,
            })
        };
        if let Err(RetargetError::Parameter {
            field,
            value,
            range,
        }) = self.options().check()
        {
            let renamed = RENAMED.iter().find(|(library, _)| *library == field);
            return wrong(
                renamed.map_or(field, |(_, field)| field),
                value.to_string(),
                range,
            );
        }
        check_polygons("protect_polygons", &self.protect_polygons)?;
        check_polygons("give_way_polygons", &self.give_way_polygons)?;
        if self.sizes.is_empty() {
            return Err(JobError::Missing {
                fields: &["sizes"],
                expected: "give at least one",
            });
        }
        if !(1..=100).contains(&self.quality) {
            return wrong("quality", self.quality.to_string(), "1 to 100");
        }
        Ok(())
    }
}

//! `twocolor`: an image as two-color pixels, as pixels again at any scale or as a drawing.
//!
//! Guarantees: equal parameters give equal files on any number of threads; outputs are whole or absent. The two-color
//! picture is written with the sample kind, profile and EXIF block of its source.

use crate::context::Context;
use crate::device::render_field;
use crate::error::JobError;
use crate::files;
use crate::operation::Operation;
use crate::report::Report;
use crate::video::{ClipFiles, Encoding, check_no_encoding, is_clip, map_clip};
use ravec::raster::{AnyImage, Image, LinearRgba, Size, psnr_db, with_image};
use ravec::twocolor::{
    AdaptiveField, AdaptiveParams, BlockField, FitMethod, FitParams, MAX_SVG_SIDE, SvgParams,
    TwoColorField, write_svg,
};
use ravec_media::WriteOptions;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Convert a picture to two-color pixels: blocks of one line and two colors, sharp at any scale
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args), command(after_help = HELP, group = clap::ArgGroup::new("result").args(["output", "svg"]).required(true).multiple(true)))]
pub struct TwoColor {
    /// Input picture, or a clip; `-` is a picture on standard input
    pub input: PathBuf,
    /// Output picture or clip; its extension selects the format, `-` is standard output in the input's format
    #[cfg_attr(feature = "cli", arg(short, long, value_name = "FILE"))]
    #[serde(default)]
    pub output: Option<PathBuf>,
    /// Output drawing as SVG, with neighbors of equal color merged; `-` is standard output
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE"))]
    #[serde(default)]
    pub svg: Option<PathBuf>,
    /// Parameters.
    #[cfg_attr(feature = "cli", command(flatten))]
    #[serde(default)]
    pub params: Params,
}

#[cfg(feature = "cli")]
const HELP: &str = "\
Examples:
  ravec twocolor photo.jpg -o blocks.png --size 8
  ravec twocolor photo.jpg -o large.png --size 4 --scale 4
  ravec twocolor photo.jpg --svg photo.svg --adaptive
  ravec twocolor - -o - --size 16 <photo.jpg >blocks.jpg
  ravec twocolor clip.y4m -o blocks.y4m --size 8

Of a clip, figures are means over the frames.

Figures: blocks, flat_blocks (of one color), values (stored numbers), psnr_db (at scale 1), svg_bytes.";

/// Parameters of [`TwoColor`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct Params {
    /// Side of a block in pixels, 2 to 64; with --adaptive that of the smallest blocks, 2 to 32
    ///
    /// Larger blocks store less and abstract more. Up to 16 the best line of all is found; larger blocks are fitted coarse
    /// to fine.
    #[cfg_attr(feature = "cli", arg(long, value_name = "PX", default_value_t = Params::default().size))]
    pub size: usize,
    /// Let blocks grow where two colors are enough
    #[cfg_attr(feature = "cli", arg(long))]
    pub adaptive: bool,
    /// Side of the largest blocks with --adaptive: --size times a power of two, at most 64
    #[cfg_attr(feature = "cli", arg(long, value_name = "PX", default_value_t = Params::default().max_size))]
    pub max_size: usize,
    /// With --adaptive, cut a block where its pixels are further than this from its colors: root mean square Oklab
    /// distance, 0 to 1. Less follows more texture with more blocks
    #[cfg_attr(feature = "cli", arg(long, value_name = "DISTANCE", default_value_t = Params::default().max_error))]
    pub max_error: f32,
    /// Oklab contrast below which a block has one color, 0 to 1. More gives fewer lines
    #[cfg_attr(feature = "cli", arg(long, value_name = "CONTRAST", default_value_t = Params::default().flat_contrast))]
    pub flat_contrast: f32,
    /// Output pixels per pixel of the input, above 0: the lines stay sharp at any scale
    #[cfg_attr(feature = "cli", arg(long, value_name = "FACTOR", default_value_t = Params::default().scale))]
    pub scale: f64,
    /// Keep each line where the fit puts it, instead of moving it between pixel centers to where it explains the mixed
    /// pixels along it
    #[cfg_attr(feature = "cli", arg(long))]
    pub whole_pixels: bool,
    /// Draw each block in its mean color, without a line: the plain mosaic, for comparison
    #[cfg_attr(feature = "cli", arg(long))]
    pub mosaic: bool,
    /// Levels of each color channel in a drawing, 2 to 256. Fewer merge more neighbors into one shape
    #[cfg_attr(feature = "cli", arg(long, value_name = "N", default_value_t = Params::default().color_levels))]
    pub color_levels: u16,
    /// Quality of a JPEG output, 1 to 100: higher is larger and closer to the picture
    #[cfg_attr(feature = "cli", arg(long, value_name = "QUALITY", default_value_t = Params::default().quality))]
    pub quality: u8,
    /// Encoding of a clip.
    #[cfg_attr(feature = "cli", command(flatten))]
    pub encoding: Encoding,
}

impl Default for Params {
    fn default() -> Self {
        let (fit, adaptive) = (FitParams::default(), AdaptiveParams::default());
        Self {
            size: fit.block_px,
            adaptive: false,
            max_size: adaptive.max_block_px,
            max_error: adaptive.max_error,
            flat_contrast: fit.flat_contrast,
            scale: 1.0,
            whole_pixels: false,
            mosaic: false,
            color_levels: SvgParams::default().color_levels,
            quality: WriteOptions::default().quality,
            encoding: Encoding::default(),
        }
    }
}

impl Params {
    fn check(&self) -> Result<(), JobError> {
        let wrong = |field, value: String, range| {
            Err(JobError::Parameter {
                field,
                value,
                range,
            })
        };
        if !self.adaptive && !(2..=64).contains(&self.size) {
            return wrong("size", self.size.to_string(), "2 to 64");
        }
        if self.adaptive && !(2..=32).contains(&self.size) {
            return wrong("size", self.size.to_string(), "2 to 32 with `adaptive`");
        }
        let ratio = self.max_size / self.size;
        let nested = ratio.is_power_of_two() && ratio * self.size == self.max_size;
        if self.adaptive && !(nested && self.max_size <= 64) {
            return wrong(
                "max_size",
                self.max_size.to_string(),
                "`size` times a power of two, at most 64",
            );
        }
        for (name, value) in [
            ("max_error", self.max_error),
            ("flat_contrast", self.flat_contrast),
        ] {
            if !(0.0..=1.0).contains(&value) {
                return wrong(name, value.to_string(), "0 to 1");
            }
        }
        if !(self.scale > 0.0 && self.scale <= 1024.0) {
            return wrong("scale", self.scale.to_string(), "above 0, up to 1024");
        }
        if !(2..=256).contains(&self.color_levels) {
            return wrong("color_levels", self.color_levels.to_string(), "2 to 256");
        }
        if !(1..=100).contains(&self.quality) {
            return wrong("quality", self.quality.to_string(), "1 to 100");
        }
        Ok(())
    }

    /// The size of the output, if it stays within the most pixels that a picture may have.
    fn output_size(&self, input: Size, max_pixels: u64) -> Result<Size, JobError> {
        let pixels = input.pixels() as f64 * self.scale * self.scale;
        if pixels > max_pixels as f64 {
            return Err(JobError::Parameter {
                field: "scale",
                value: self.scale.to_string(),
                range: "small enough to keep the output within `max_pixels`",
            });
        }
        let side = |pixels: usize| (pixels as f64 * self.scale).round().max(1.0) as usize;
        Size::new(side(input.width()), side(input.height())).map_err(|_| JobError::Parameter {
            field: "scale",
            value: self.scale.to_string(),
            range: "small enough for a picture",
        })
    }
}

impl Operation for TwoColor {
    const NAME: &'static str = "twocolor";

    fn inputs(&self) -> Vec<&Path> {
        vec![&self.input]
    }

    fn outputs(&self) -> Vec<&Path> {
        let outputs = self.output.iter().chain(&self.svg);
        outputs.map(PathBuf::as_path).collect()
    }

    /// Fits the picture and writes it, in the input's size whatever the scale for the drawing.
    ///
    /// Figures: `blocks` and `flat_blocks`; `values` stored (a line has 2, a color 3); and, at the input's scale, `psnr_db` of
    /// the encoded colors against the input.
    ///
    /// # Errors
    /// [`JobError::Parameter`] for a parameter out of range, [`JobError::Missing`] without an output, [`JobError::Read`], [`JobError::Write`],
    /// what [`check_files`](crate::check_files) refuses, [`JobError::Cancelled`].
    fn run(&self, context: &Context) -> Result<Report, JobError> {
        let Self {
            input,
            output,
            svg,
            params,
        } = self;
        params.check()?;
        if output.is_none() && svg.is_none() {
            return Err(JobError::Missing {
                fields: &["output", "svg"],
                expected: "give a file to write",
            });
        }
        if is_clip(input, context) {
            return self.run_on_clip(context);
        }
        check_no_encoding(&params.encoding)?;
        if let Some(path) = output {
            files::check_target(path, context)?;
        }
        context.check_files(&self.inputs(), &self.outputs())?;
        let mut report = Report::of(self, params);
        let picture = files::read(input, &mut report, context)?;
        let size = params.output_size(picture.image.size(), context.limits.max_pixels)?;
        if let Some(path) = output {
            files::check_size(path, size, &picture, context)?;
        }
        if let Some(path) = svg {
            check_drawing(path, picture.image.size())?;
        }
        match fitted(&picture.image, params, &mut report, context)? {
            Fitted::Adaptive(field) => self.deliver(&field, &picture, &mut report, context)?,
            Fitted::Regular(field) => self.deliver(&field, &picture, &mut report, context)?,
        }
        Ok(report)
    }
}

/// The lines of the two-color pixels of a picture, each from end to end in pixels, as [`TwoColor`] fits them.
///
/// # Errors
/// [`JobError::Parameter`], [`JobError::Cancelled`].
pub fn lines(
    image: &AnyImage,
    params: &Params,
    context: &Context,
) -> Result<Vec<[[f64; 2]; 2]>, JobError> {
    params.check()?;
    let mut report = Report::new(TwoColor::NAME, params);
    Ok(match fitted(image, params, &mut report, context)? {
        Fitted::Adaptive(field) => segments(&field),
        Fitted::Regular(field) => segments(&field),
    })
}

fn segments(field: &impl BlockField) -> Vec<[[f64; 2]; 2]> {
    let size = field.image_size();
    let segments = field.placed_blocks();
    let segments = segments.filter_map(|block| block.segment_in_image(size));
    segments.map(|ends| ends.map(Into::into)).collect()
}

/// The two-color pixels of a picture.
enum Fitted {
    Adaptive(AdaptiveField),
    Regular(TwoColorField),
}

fn fitted(
    image: &AnyImage,
    params: &Params,
    report: &mut Report,
    context: &Context,
) -> Result<Fitted, JobError> {
    let progress = &context.progress;
    if params.adaptive {
        let fit = AdaptiveParams {
            min_block_px: params.size,
            max_block_px: params.max_size,
            max_error: params.max_error,
            flat_contrast: params.flat_contrast,
        };
        let mut field = report.time(
            "fit",
            || with_image!(image, image => AdaptiveField::fit(image, &fit, progress)),
        )?;
        if !params.whole_pixels {
            report.time(
                "refine",
                || with_image!(image, image => field.refine_lines(image, progress)),
            )?;
        }
        return Ok(Fitted::Adaptive(field));
    }
    let fit = FitParams {
        block_px: params.size,
        method: FitMethod::Auto,
        flat_contrast: params.flat_contrast,
    };
    let field = report.time("fit", || {
        if params.whole_pixels {
            context.device.fit(image, &fit, progress)
        } else {
            context.device.fit_refined(image, &fit, progress)
        }
    })?;
    context.device.report_warnings(report);
    Ok(Fitted::Regular(field))
}

/// Refuses a picture that is too long for a drawing, before any work is done for it.
fn check_drawing(path: &Path, size: Size) -> Result<(), JobError> {
    if size.width().max(size.height()) <= MAX_SVG_SIDE {
        return Ok(());
    }
    let text = format!(
        "a drawing can have at most {MAX_SVG_SIDE} pixels on a side, the picture has {size}"
    );
    Err(JobError::Write {
        path: path.to_path_buf(),
        cause: std::io::Error::new(std::io::ErrorKind::InvalidInput, text).into(),
    })
}

fn record_blocks(field: &impl BlockField, report: &mut Report) {
    let (mut blocks, mut flat) = (0u32, 0u32);
    for block in field.placed_blocks() {
        blocks += 1;
        flat += u32::from(block.pixel.is_flat());
    }
    report.figures.insert("blocks", f64::from(blocks));
    report.figures.insert("flat_blocks", f64::from(flat));
    report
        .figures
        .insert("values", f64::from(8 * (blocks - flat) + 3 * flat));
}

impl TwoColor {
    /// Converts every frame of a clip.
    fn run_on_clip(&self, context: &Context) -> Result<Report, JobError> {
        let (Some(output), None) = (&self.output, &self.svg) else {
            return Err(JobError::Parameter {
                field: "svg",
                value: "given".to_owned(),
                range: "left out for clips, which are written to `output`",
            });
        };
        let params = &self.params;
        let mut report = Report::of(self, params);
        let files = ClipFiles {
            input: &self.input,
            output,
            encoding: &params.encoding,
        };
        let size = |size| params.output_size(size, context.limits.max_pixels);
        map_clip(
            self,
            &files,
            &mut report,
            context,
            size,
            |image, report, context| {
                let drawn = match fitted(image, params, report, context)? {
                    Fitted::Adaptive(field) => drawn_frame(&field, image, params, report, context)?,
                    Fitted::Regular(field) => drawn_frame(&field, image, params, report, context)?,
                };
                Ok(image.like(&drawn))
            },
        )?;
        Ok(report)
    }

    /// Draws, writes and measures.
    fn deliver(
        &self,
        field: &impl Draw,
        picture: &ravec_media::Picture,
        report: &mut Report,
        context: &Context,
    ) -> Result<(), JobError> {
        let params = &self.params;
        record_blocks(field, report);
        if let Some(path) = &self.output {
            let image = draw(field, params, report, context)?;
            // there is none at another scale
            if let Ok(psnr) = with_image!(&picture.image, input => psnr_db(input, &image)) {
                report.figures.insert("psnr_db", psnr);
            }
            let options = WriteOptions {
                quality: params.quality,
                ..WriteOptions::default()
            };
            let picture = picture.with_image(&image);
            files::write(path, &picture, &options, report, context)?;
        }
        if let Some(path) = &self.svg {
            write_drawing(field, path, params, report, context)?;
        }
        Ok(())
    }
}

/// Draws and measures a frame.
fn drawn_frame(
    field: &impl Draw,
    image: &AnyImage,
    params: &Params,
    report: &mut Report,
    context: &Context,
) -> Result<Image<LinearRgba>, JobError> {
    record_blocks(field, report);
    let drawn = draw(field, params, report, context)?;
    if let Ok(psnr) = with_image!(image, input => psnr_db(input, &drawn)) {
        report.figures.insert("psnr_db", psnr);
    }
    Ok(drawn)
}

/// A field that is drawn by the device of the run.
trait Draw: BlockField {
    /// Draws the field so that it fills `size`, or its plain mosaic.
    fn draw(
        &self,
        size: Size,
        mosaic: bool,
        context: &Context,
    ) -> Result<Image<LinearRgba>, JobError>;
}

impl Draw for TwoColorField {
    fn draw(
        &self,
        size: Size,
        mosaic: bool,
        context: &Context,
    ) -> Result<Image<LinearRgba>, JobError> {
        let device = &context.device;
        Ok(device.render(self, size, mosaic, &context.progress)?)
    }
}

/// Blocks of several sizes are drawn by the CPU.
impl Draw for AdaptiveField {
    fn draw(
        &self,
        size: Size,
        mosaic: bool,
        context: &Context,
    ) -> Result<Image<LinearRgba>, JobError> {
        Ok(render_field(self, size, mosaic, &context.progress)?)
    }
}

fn draw(
    field: &impl Draw,
    params: &Params,
    report: &mut Report,
    context: &Context,
) -> Result<Image<LinearRgba>, JobError> {
    let size = params.output_size(field.image_size(), u64::MAX)?;
    let drawn = report.time("render", || field.draw(size, params.mosaic, context))?;
    context.device.report_warnings(report);
    Ok(drawn)
}

fn write_drawing(
    field: &impl BlockField,
    path: &Path,
    params: &Params,
    report: &mut Report,
    context: &Context,
) -> Result<(), JobError> {
    context.progress.check()?;
    let svg = SvgParams {
        title: None,
        color_levels: params.color_levels,
    };
    let mut text = Vec::new();
    report
        .time("draw", || write_svg(field, &svg, &mut text))
        .map_err(|cause| JobError::Write {
            path: path.to_path_buf(),
            cause: cause.into(),
        })?;
    report.figures.insert("svg_bytes", text.len() as f64);
    let text = String::from_utf8_lossy(&text);
    files::write_output_text(path, "SVG", &text, report, context)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ErrorKind;
    use ravec::raster::Srgb;
    use ravec_media::Picture;

    /// Outputs of [`run`].
    #[derive(Default)]
    struct Targets {
        picture: Option<PathBuf>,
        svg: Option<PathBuf>,
    }

    fn run(input: &Path, targets: &Targets, params: &Params) -> Result<Report, JobError> {
        run_in(&Context::default(), input, targets, params)
    }

    fn run_in(
        context: &Context,
        input: &Path,
        targets: &Targets,
        params: &Params,
    ) -> Result<Report, JobError> {
        let operation = TwoColor {
            input: input.to_path_buf(),
            output: targets.picture.clone(),
            svg: targets.svg.clone(),
            params: params.clone(),
        };
        operation.run(context)
    }

    fn folder_with_picture(width: usize, height: usize) -> (tempfile::TempDir, PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let image = Image::from_fn(Size::new(width, height).unwrap(), |col, row| {
            if col * 2 > row {
                Srgb([200u8, 180, 90])
            } else {
                Srgb([30, (row % 60) as u8, 120])
            }
        });
        let path = folder.path().join("in.png");
        ravec_media::write(&path, &Picture::from_image(image), &WriteOptions::default()).unwrap();
        (folder, path)
    }

    #[test]
    fn a_picture_becomes_a_larger_picture_and_a_drawing() {
        let (folder, source) = folder_with_picture(50, 40);
        let targets = Targets {
            picture: Some(folder.path().join("out.png")),
            svg: Some(folder.path().join("out.svg")),
        };
        for adaptive in [false, true] {
            let params = Params {
                adaptive,
                scale: 2.5,
                ..Params::default()
            };
            let report = run(&source, &targets, &params).unwrap();
            assert_eq!(
                (report.outputs[0].width, report.outputs[0].height),
                (Some(125), Some(100))
            );
            let svg = std::fs::read_to_string(targets.svg.as_ref().unwrap()).unwrap();
            assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"));
        }
    }

    #[test]
    fn two_colors_are_nearer_to_the_picture_than_one() {
        let (folder, source) = folder_with_picture(64, 64);
        let targets = Targets {
            picture: Some(folder.path().join("out.png")),
            svg: None,
        };
        let psnr = |mosaic| {
            let params = Params {
                mosaic,
                ..Params::default()
            };
            run(&source, &targets, &params).unwrap().figures["psnr_db"]
        };
        assert!(psnr(false) > psnr(true) + 3.5);
    }

    #[test]
    fn parameters_out_of_range_and_missing_targets_are_refused_before_reading() {
        let nowhere = PathBuf::from("does/not/exist.png");
        let targets = Targets {
            picture: Some("out.png".into()),
            svg: None,
        };
        for wrong in [
            Params {
                size: 1,
                ..Params::default()
            },
            Params {
                size: 65,
                ..Params::default()
            },
            Params {
                size: 5,
                adaptive: true,
                ..Params::default()
            },
            Params {
                scale: 0.0,
                ..Params::default()
            },
            Params {
                scale: f64::NAN,
                ..Params::default()
            },
            Params {
                flat_contrast: -0.1,
                ..Params::default()
            },
            Params {
                size: 64,
                adaptive: true,
                ..Params::default()
            },
            Params {
                color_levels: 1,
                ..Params::default()
            },
            Params {
                quality: 0,
                ..Params::default()
            },
        ] {
            let error = run(&nowhere, &targets, &wrong).unwrap_err();
            assert_eq!(error.kind(), ErrorKind::Request, "{error}");
        }
        let error = run(&nowhere, &Targets::default(), &Params::default()).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Request);
        let unknown = Targets {
            picture: Some("out.xyz".into()),
            svg: None,
        };
        assert_eq!(
            run(&nowhere, &unknown, &Params::default())
                .unwrap_err()
                .kind(),
            ErrorKind::Request
        );
        assert_eq!(
            run(&nowhere, &targets, &Params::default())
                .unwrap_err()
                .kind(),
            ErrorKind::Input
        );
    }

    #[test]
    fn a_scale_beyond_the_limit_is_refused() {
        let (folder, source) = folder_with_picture(50, 40);
        let mut context = Context::default();
        context.limits.max_pixels = 3000;
        let targets = Targets {
            picture: Some(folder.path().join("out.png")),
            svg: None,
        };
        let params = Params {
            scale: 2.0,
            ..Params::default()
        };
        assert_eq!(
            run_in(&context, &source, &targets, &params)
                .unwrap_err()
                .kind(),
            ErrorKind::Request
        );
        assert!(!folder.path().join("out.png").exists());
    }
}

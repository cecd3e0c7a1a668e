//! `brush`: strokes that stop at edges, or an operator over the whole picture.
//!
//! Guarantees: pixels that no stroke reaches keep their samples; equal parameters give equal files on any number of
//! threads; outputs are whole or absent.

mod strokes;

use crate::context::Context;
use crate::error::JobError;
use crate::files;
use crate::operation::{Operation, paths};
use crate::pixel_centers::PixelCenters;
use crate::report::Report;
use crate::video::{ClipFiles, Encoding, check_no_encoding, is_clip, map_clip};
use ravec::raster::{AnyImage, Image, LinearRgba, Rect, Size, Srgb, with_image};
use ravec::twocolor::brush::{Painted, Stroke, Strokes, Tool, replay};
use ravec::twocolor::{
    BlockQuantization, CleanParams, Mode, NoiseLevel, OperatorParams, WindowParams, enlarge,
    estimate_noise, estimate_noise_of_compressed,
};
use ravec_media::{Picture, Quantization, WriteOptions};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Effect of the brush.
///
/// It is one list of the operators of [`Mode`] and the tools of [`Tool`], of which some read a color or an offset from the other
/// parameters.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
pub enum BrushMode {
    /// Even areas with crisp edges
    Abstract,
    /// Less noise within areas, edges kept
    #[default]
    Smooth,
    /// Crisper edges without halos
    Sharpen,
    /// Less noise and compression damage, texture kept
    Clean,
    /// Smooth edges instead of stairs; with --scale, enlarge with crisp edges
    Antialias,
    /// A picture made of two-color squares
    Stamp,
    /// Paint --color
    Color,
    /// Brighten
    Dodge,
    /// Darken
    Burn,
    /// Change the saturation by --amount
    Saturation,
    /// Give the hue of --color, keep the lightness
    Recolor,
    /// Select: write the selection to --mask
    Mask,
    /// Copy from --offset
    Clone,
}

impl BrushMode {
    fn operator(self) -> Option<Mode> {
        match self {
            Self::Abstract => Some(Mode::Abstract),
            Self::Smooth => Some(Mode::Smooth),
            Self::Sharpen => Some(Mode::Sharpen),
            Self::Clean => Some(Mode::Clean),
            Self::Antialias => Some(Mode::Antialias),
            Self::Stamp => Some(Mode::Stamp),
            _ => None,
        }
    }
}

/// Filter or paint a picture, as a whole or with a brush that stops at edges
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args), command(after_help = HELP))]
pub struct Brush {
    /// Input picture, or a clip with --everywhere; `-` is a picture on standard input
    pub input: PathBuf,
    /// Output picture or clip; its extension selects the format, `-` is standard output in the input's format
    #[cfg_attr(feature = "cli", arg(short, long, value_name = "FILE"))]
    pub output: PathBuf,
    /// Apply the mode to the whole picture
    #[cfg_attr(
        feature = "cli",
        arg(long, required_unless_present = "stroke", conflicts_with = "stroke")
    )]
    #[serde(default)]
    pub everywhere: bool,
    /// Strokes as JSON, or the points [[x, y], ...] of one stroke with the settings of the flags: see below; `-` is
    /// standard input
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE"))]
    #[serde(default)]
    pub stroke: Option<PathBuf>,
    /// Strokes in the operation itself, in place of a file
    #[cfg_attr(feature = "cli", arg(skip))]
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub strokes: Option<Strokes>,
    /// Write the selection that mask strokes painted as a gray picture
    #[cfg_attr(
        feature = "cli",
        arg(
            long,
            value_name = "FILE",
            requires = "stroke",
            conflicts_with = "everywhere"
        )
    )]
    #[serde(default)]
    pub mask: Option<PathBuf>,
    /// Parameters.
    #[cfg_attr(feature = "cli", command(flatten))]
    #[serde(default)]
    pub params: Params,
}

#[cfg(feature = "cli")]
const HELP: &str = "\
Examples:
  ravec brush noisy.jpg -o clean.png --mode clean --everywhere
  ravec brush noisy.jpg -o clean.png --mode clean --everywhere --noise-sigma 15
  ravec brush photo.jpg -o large.png --mode antialias --scale 3 --everywhere
  ravec brush photo.jpg -o look.jpg --mode abstract --iterations 3 --everywhere
  ravec brush photo.jpg -o red.png --mode color --color '#c03020' --radius 80 --stroke points.json
  ravec brush photo.jpg -o all.png --stroke strokes.json --mask mask.png
  ravec brush clip.y4m -o clean.y4m --mode clean --everywhere
  echo '[[40, 30], [90, 50]]' | ravec brush photo.jpg -o light.png --mode dodge --stroke -

Strokes: points, in pixels from the upper left corner (with --pixel-centers integer from the center of the first pixel), are one stroke with the settings of the flags:
  [[40, 30], [90, 50]]
Strokes with settings of their own fit a picture of any size, because they say on which size they were drawn:
  {\"version\": 1, \"width\": 800, \"height\": 600, \"strokes\": [
    {\"tool\": {\"operator\": {\"mode\": \"smooth\"}}, \"points\": [[40, 30], [90, 50]], \"radius_px\": 20},
    {\"tool\": {\"color\": {\"rgb\": [192, 48, 32]}}, \"points\": [[200, 150]], \"radius_px\": 60},
    {\"tool\": \"mask\", \"points\": [[200, 150]], \"radius_px\": 60}]}
Tools:
  {\"operator\": {\"mode\": \"smooth\", \"iterations\": 1, \"noise_sigma\": null}}
  {\"color\": {\"rgb\": [192, 48, 32]}}
  {\"recolor\": {\"rgb\": [192, 48, 32]}}
  {\"saturation\": {\"amount\": 0.5}}
  {\"clone\": {\"offset\": [-40, 12]}}
  \"dodge\"
  \"burn\"
  \"mask\"
Settings of a stroke that may be left out, as they are then:
  \"hardness\": 0.5, \"strength\": 1, \"edge_aware\": true, \"edge_tolerance\": 0.08,
  \"window_px\": 9, \"accumulate\": false, \"spacing\": 0.25
A list [...] of such strokes is taken as drawn on the picture as it is.

Figures: strokes and touched_pixels with --stroke; noise_sigma_steps and compressed (0 or 1) with --mode clean.";

/// Parameters of [`Brush`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct Params {
    /// Effect of the brush
    #[cfg_attr(feature = "cli", arg(long, value_enum, default_value_t = Params::default().mode))]
    pub mode: BrushMode,
    /// Strength of the effect, 0 to 1: the share of the way from the old color to the new one
    #[cfg_attr(feature = "cli", arg(long, value_name = "SHARE", default_value_t = Params::default().strength))]
    pub strength: f32,
    /// Number of times the operator is applied, 1 to 16: more give a stronger effect
    #[cfg_attr(feature = "cli", arg(long, value_name = "N", default_value_t = Params::default().iterations))]
    pub iterations: u32,
    /// Side of the windows in pixels, odd, 3 to 31: larger ones act more broadly
    #[cfg_attr(feature = "cli", arg(long, value_name = "PX", default_value_t = Params::default().window))]
    pub window: usize,
    /// For clean: standard deviation of the noise in steps of 8-bit values, 0 to 255 [default: estimated]
    #[cfg_attr(feature = "cli", arg(long, value_name = "STEPS"))]
    pub noise_sigma: Option<f32>,
    /// For stamp with --everywhere: another number scatters the squares differently
    #[cfg_attr(feature = "cli", arg(long, default_value_t = Params::default().seed))]
    pub seed: u64,
    /// For antialias with --everywhere: output pixels per pixel of the input, above 0
    #[cfg_attr(feature = "cli", arg(long, value_name = "FACTOR", default_value_t = Params::default().scale))]
    pub scale: f64,
    /// Radius of a stroke that is given as plain points, in pixels, above 0, up to 4096
    #[cfg_attr(feature = "cli", arg(long, value_name = "PX", default_value_t = Params::default().radius))]
    pub radius: f64,
    /// Hardness of such a stroke: the share of the radius with full effect, 0 to 1
    #[cfg_attr(feature = "cli", arg(long, value_name = "SHARE", default_value_t = Params::default().hardness))]
    pub hardness: f64,
    /// Let such a stroke cross edges
    #[cfg_attr(feature = "cli", arg(long))]
    pub across_edges: bool,
    /// Color of such a stroke, as #rrggbb
    #[cfg_attr(feature = "cli", arg(long, value_name = "#RRGGBB", default_value = "#c03020", value_parser = color))]
    pub color: [u8; 3],
    /// Change of the saturation by such a stroke, -1 to 4
    #[cfg_attr(feature = "cli", arg(long, value_name = "AMOUNT", allow_negative_numbers = true, default_value_t = Params::default().amount))]
    pub amount: f32,
    /// Place that such a stroke copies from, relative to each pixel, as COLUMNS,ROWS
    #[cfg_attr(feature = "cli", arg(long, value_name = "DX,DY", allow_hyphen_values = true, default_value = "0,0", value_parser = offset))]
    pub offset: [i32; 2],
    /// Leave out the last N strokes: undo
    #[cfg_attr(feature = "cli", arg(long, value_name = "N", default_value_t = Params::default().undo))]
    pub undo: usize,
    /// Center of the first pixel in points that are given or printed: half is (0.5, 0.5), integer is (0, 0)
    #[cfg_attr(feature = "cli", arg(long, value_enum, value_name = "CENTERS", default_value_t = PixelCenters::Half))]
    pub pixel_centers: PixelCenters,
    /// Quality of a JPEG output, 1 to 100: higher is larger and closer to the picture
    #[cfg_attr(feature = "cli", arg(long, value_name = "QUALITY", default_value_t = Params::default().quality))]
    pub quality: u8,
    /// Encoding of a clip.
    #[cfg_attr(feature = "cli", command(flatten))]
    pub encoding: Encoding,
}

impl Default for Params {
    fn default() -> Self {
        let operator = OperatorParams::default();
        Self {
            mode: BrushMode::default(),
            strength: 1.0,
            iterations: 1,
            window: operator.window_px,
            noise_sigma: None,
            seed: 0,
            scale: 1.0,
            radius: 32.0,
            hardness: 0.5,
            across_edges: false,
            color: [0xc0, 0x30, 0x20],
            amount: 0.5,
            offset: [0, 0],
            undo: 0,
            pixel_centers: PixelCenters::default(),
            quality: WriteOptions::default().quality,
            encoding: Encoding::default(),
        }
    }
}

/// A color as #rrggbb.
pub(crate) fn color(text: &str) -> Result<[u8; 3], String> {
    let digits = text.strip_prefix('#').unwrap_or(text);
    let number = u32::from_str_radix(digits, 16)
        .ok()
        .filter(|_| digits.len() == 6);
    number
        .map(|number| [(number >> 16) as u8, (number >> 8) as u8, number as u8])
        .ok_or_else(|| "a color has six hexadecimal digits, as in #c03020".to_owned())
}

/// Two whole numbers.
#[cfg(feature = "cli")]
fn offset(text: &str) -> Result<[i32; 2], String> {
    let numbers: Result<Vec<i32>, _> = text.split(',').map(|part| part.trim().parse()).collect();
    match numbers.as_deref() {
        Ok(&[x, y]) => Ok([x, y]),
        _ => Err("two whole numbers are needed, as in -40,12".to_owned()),
    }
}

impl Params {
    fn check(&self, everywhere: bool) -> Result<(), JobError> {
        let wrong = |field, value: String, range| {
            Err(JobError::Parameter {
                field,
                value,
                range,
            })
        };
        if !(0.0..=1.0).contains(&self.strength) {
            return wrong("strength", self.strength.to_string(), "0 to 1");
        }
        if !(1..=16).contains(&self.iterations) {
            return wrong("iterations", self.iterations.to_string(), "1 to 16");
        }
        if !(3..=31).contains(&self.window) || self.window.is_multiple_of(2) {
            return wrong("window", self.window.to_string(), "odd, 3 to 31");
        }
        if let Some(sigma) = self.noise_sigma.filter(|s| !(0.0..=255.0).contains(s)) {
            return wrong("noise_sigma", sigma.to_string(), "0 to 255");
        }
        if !(self.radius > 0.0 && self.radius <= 4096.0) {
            return wrong("radius", self.radius.to_string(), "above 0, up to 4096");
        }
        if !(0.0..=1.0).contains(&self.hardness) {
            return wrong("hardness", self.hardness.to_string(), "0 to 1");
        }
        if !(-1.0..=4.0).contains(&self.amount) {
            return wrong("amount", self.amount.to_string(), "-1 to 4");
        }
        if !(1..=100).contains(&self.quality) {
            return wrong("quality", self.quality.to_string(), "1 to 100");
        }
        if !(self.scale > 0.0 && self.scale <= 64.0) {
            return wrong("scale", self.scale.to_string(), "above 0, up to 64");
        }
        if self.scale != 1.0 && !(everywhere && self.mode == BrushMode::Antialias) {
            return wrong(
                "scale",
                self.scale.to_string(),
                "1, unless with `mode` antialias and `everywhere`",
            );
        }
        if everywhere && self.mode.operator().is_none() {
            let mode = format!("{:?}", self.mode).to_lowercase();
            return wrong(
                "mode",
                mode,
                "abstract, smooth, sharpen, clean, antialias or stamp with `everywhere`",
            );
        }
        Ok(())
    }

    /// The size of the output, if it stays within the most pixels that a picture may have.
    fn output_size(&self, input: Size, max_pixels: u64) -> Result<Size, JobError> {
        let wrong = |range| JobError::Parameter {
            field: "scale",
            value: self.scale.to_string(),
            range,
        };
        if self.scale == 1.0 {
            return Ok(input);
        }
        if input.pixels() as f64 * self.scale * self.scale > max_pixels as f64 {
            return Err(wrong("small enough to keep the output within `max_pixels`"));
        }
        let side = |pixels: usize| (pixels as f64 * self.scale).round().max(1.0) as usize;
        Size::new(side(input.width()), side(input.height()))
            .map_err(|_| wrong("small enough for a picture"))
    }

    /// A stroke of plain points with these settings.
    fn stroke(&self, points: Vec<[f64; 2]>) -> Stroke {
        let tool = match self.mode {
            BrushMode::Color => Tool::Color { rgb: self.color },
            BrushMode::Dodge => Tool::Dodge,
            BrushMode::Burn => Tool::Burn,
            BrushMode::Saturation => Tool::Saturation {
                amount: self.amount,
            },
            BrushMode::Recolor => Tool::Recolor { rgb: self.color },
            BrushMode::Mask => Tool::Mask,
            BrushMode::Clone => Tool::Clone {
                offset: self.offset,
            },
            other => Tool::Operator {
                mode: other.operator().unwrap_or_default(),
                iterations: self.iterations,
                noise_sigma: self.noise_sigma,
            },
        };
        Stroke {
            hardness: self.hardness,
            strength: f64::from(self.strength),
            edge_aware: !self.across_edges,
            window_px: self.window,
            ..Stroke::new(tool, points, self.radius)
        }
    }
}

impl Operation for Brush {
    const NAME: &'static str = "brush";

    fn inputs(&self) -> Vec<&Path> {
        paths(&self.input, [&self.stroke])
    }

    fn outputs(&self) -> Vec<&Path> {
        paths(&self.output, [&self.mask])
    }

    /// Applies the mode to the whole picture, or the strokes: strokes with the size that they were drawn on, a plain list of
    /// strokes on this picture, or plain points `[[x, y], …]` of one stroke.
    ///
    /// Figures: `strokes` and `touched_pixels`; for cleaning the `noise_sigma_steps` that were assumed, and `compressed` (1 or
    /// 0) where they were estimated.
    ///
    /// # Errors
    /// [`JobError::Parameter`] for a parameter out of range, [`JobError::Missing`] unless either `stroke` or `everywhere` is given, [`JobError::Strokes`] for strokes that cannot be read or make no
    /// sense, [`JobError::Read`], [`JobError::Write`], what [`check_files`](crate::check_files) refuses,
    /// [`JobError::Cancelled`].
    fn run(&self, context: &Context) -> Result<Report, JobError> {
        let Self {
            input,
            output,
            stroke,
            params,
            ..
        } = self;
        let ways = [self.everywhere, stroke.is_some(), self.strokes.is_some()];
        if ways.into_iter().filter(|&given| given).count() != 1 {
            return Err(JobError::Missing {
                fields: &["stroke", "everywhere"],
                expected: "give one of the two",
            });
        }
        params.check(self.everywhere)?;
        if is_clip(input, context) {
            return self.run_on_clip(context);
        }
        check_no_encoding(&params.encoding)?;
        for path in self.outputs() {
            files::check_target(path, context)?;
        }
        context.check_files(&self.inputs(), &self.outputs())?;
        let mut report = Report::of(self, params);
        if params.mode == BrushMode::Stamp {
            report.seed = Some(params.seed);
        }
        let picture = files::read(input, &mut report, context)?;
        let size = params.output_size(picture.image.size(), context.limits.max_pixels)?;
        files::check_size(output, size, &picture, context)?;
        let result = match (&self.strokes, stroke) {
            (Some(strokes), _) => {
                let strokes = strokes::at_half(strokes.clone(), params.pixel_centers);
                self.paint(&strokes, &picture, &mut report, context)?
            }
            (None, Some(path)) => {
                let size = picture.image.size();
                let strokes = strokes::read(path, size, params, context)?;
                self.paint(&strokes, &picture, &mut report, context)?
            }
            (None, None) => {
                let quantization = picture.origin.quantization;
                everywhere(&picture.image, quantization, params, &mut report, context)?
            }
        };
        let options = WriteOptions {
            quality: params.quality,
            ..WriteOptions::default()
        };
        let picture = picture.with_image(&result);
        files::write(output, &picture, &options, &mut report, context)?;
        Ok(report)
    }
}

impl Brush {
    /// Applies the operator to every frame of a clip.
    fn run_on_clip(&self, context: &Context) -> Result<Report, JobError> {
        let params = &self.params;
        if !self.everywhere {
            return Err(JobError::Missing {
                fields: &["everywhere"],
                expected: "strokes are for pictures, clips are changed as a whole",
            });
        }
        let mut report = Report::of(self, params);
        if params.mode == BrushMode::Stamp {
            report.seed = Some(params.seed);
        }
        let files = ClipFiles {
            input: &self.input,
            output: &self.output,
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
                let result = everywhere(image, None, params, report, context)?;
                Ok(image.like(&result))
            },
        )?;
        Ok(report)
    }

    /// Applies the strokes of the file `path`.
    fn paint(
        &self,
        strokes: &Strokes,
        picture: &Picture,
        report: &mut Report,
        context: &Context,
    ) -> Result<Image<LinearRgba>, JobError> {
        let path = self.stroke.as_deref().unwrap_or(&self.input);
        let mut strokes = strokes.clone();
        strokes
            .strokes
            .truncate(strokes.strokes.len().saturating_sub(self.params.undo));
        let failed = |cause| JobError::from_strokes(path, cause);
        let Painted {
            image,
            mask,
            touched,
        } = report.time("paint", || {
            replay(picture.convert(), &strokes, &context.progress).map_err(failed)
        })?;
        let pixels: u64 = touched.iter().sum();
        report.figures.insert("strokes", touched.len() as f64);
        report.figures.insert("touched_pixels", pixels as f64);
        for (i, _) in touched
            .iter()
            .enumerate()
            .filter(|(_, pixels)| **pixels == 0)
        {
            report.warn(format!(
                "stroke {} lies outside the picture or has no effect",
                i + 1
            ));
        }
        if mask.is_some() && self.mask.is_none() {
            report.warn("the selection is not kept: name a file for it with `mask`");
        }
        if let Some(path) = &self.mask {
            write_mask(path, mask, picture.image.size(), report, context)?;
        }
        Ok(image)
    }
}

/// The operator over the whole picture, with the quantization of its file if that says one.
fn everywhere(
    image: &AnyImage,
    quantization: Option<Quantization>,
    params: &Params,
    report: &mut Report,
    context: &Context,
) -> Result<Image<LinearRgba>, JobError> {
    let progress = &context.progress;
    let whole = Rect::of(image.size());
    if params.scale != 1.0 {
        let window = WindowParams {
            window_px: params.window,
            ..WindowParams::default()
        };
        return report.time("enlarge", || {
            Ok(with_image!(image, image => enlarge(image, params.scale, &window, progress))?)
        });
    }
    let mut operator = OperatorParams {
        mode: params.mode.operator().unwrap_or_default(),
        window_px: params.window,
        strength: params.strength,
        iterations: params.iterations,
        noise_sigma: params.noise_sigma,
        seed: params.seed,
    };
    let is_plain = params.strength == 1.0 && params.iterations == 1;
    if operator.mode == Mode::Clean && operator.noise_sigma.is_none() {
        let quantization = quantization.map(|known| BlockQuantization {
            steps: known.luma_steps,
            grid: known.grid,
        });
        let noise = report.time("estimate", || {
            with_image!(image, image => match &quantization {
                Some(known) => estimate_noise_of_compressed(image, known, progress),
                None => estimate_noise(image, progress),
            })
        })?;
        report
            .figures
            .insert("noise_sigma_steps", f64::from(noise.typical()));
        report
            .figures
            .insert("compressed", f64::from(u8::from(noise.is_compressed())));
        if is_plain {
            return clean_on_device(image, &noise, report, context);
        }
        operator.noise_sigma = Some(noise.typical());
    } else if let (Mode::Clean, Some(sigma)) = (operator.mode, operator.noise_sigma) {
        report.figures.insert("noise_sigma_steps", f64::from(sigma));
        // `operate` refuses other values
        if is_plain && (0.0..=255.0).contains(&sigma) {
            return clean_on_device(image, &NoiseLevel::uniform(sigma), report, context);
        }
    }
    let operated = report.time("operate", || {
        context.device.operate(image, whole, &operator, progress)
    })?;
    context.device.report_warnings(report);
    Ok(operated)
}

/// Cleans the whole image once, at full strength.
fn clean_on_device(
    image: &AnyImage,
    noise: &NoiseLevel,
    report: &mut Report,
    context: &Context,
) -> Result<Image<LinearRgba>, JobError> {
    let params = CleanParams::default();
    let cleaned = report.time("clean", || {
        let device = &context.device;
        device.clean(image, noise, &params, &context.progress)
    })?;
    context.device.report_warnings(report);
    Ok(cleaned)
}

/// The selection as gray; black where there was no mask stroke.
fn write_mask(
    path: &Path,
    mask: Option<ravec::raster::Plane>,
    size: Size,
    report: &mut Report,
    context: &Context,
) -> Result<(), JobError> {
    let gray = if let Some(mask) = mask {
        mask.map(|v| Srgb([(v * 255.0).round() as u8; 3]))
    } else {
        report.warn("no stroke selects anything; the mask is black");
        Image::new(size, Srgb([0u8; 3]))
    };
    let mut picture = Picture::from_image(gray);
    picture.origin.gray = true;
    files::write(path, &picture, &WriteOptions::default(), report, context)
}

#[cfg(test)]
mod tests;

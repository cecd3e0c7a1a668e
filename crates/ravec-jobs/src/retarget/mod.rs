//! `retarget`: a picture in other formats, with objects in shape and lines straight.

mod showcase;
mod size;

pub(crate) use showcase::show;
pub use size::SizeSpec;

use crate::error::JobError;
use crate::files::{self, Source};
use crate::mask::read_mask;
use crate::plane::{draw_line, line_width};
use crate::report::Report;
use ravec::progress::Progress;
use ravec::raster::{AnyImage, Color, Image, LinearRgba, Size, Srgba, with_image};
use ravec::retarget::{
    AnalysisSummary, Borders, Deformation, Painted, RetargetError, RetargetParams, Retargeter,
    SolveSummary,
};
use ravec_media::WriteOptions;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// How the border of the picture may move.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
pub enum Border {
    /// Along itself
    #[default]
    Slide,
    /// Along itself, opposite borders alike: what tiles still does
    Symmetric,
    /// Along itself and out of the frame, where that costs little
    Free,
}

impl From<Border> for Borders {
    fn from(border: Border) -> Self {
        match border {
            Border::Slide => Self::Slide,
            Border::Symmetric => Self::Symmetric,
            Border::Free => Self::Free,
        }
    }
}

/// Which sizes are made, and how.
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
    /// Cells of the grid along the longer side, 2 to 400 [default: 100, and 50 for pictures of at most 800 pixels a side]. More
    /// follow smaller objects, and cost more
    #[cfg_attr(feature = "cli", arg(long, value_name = "CELLS"))]
    pub grid: Option<usize>,
    /// Use large cells where the picture is even
    #[cfg_attr(feature = "cli", arg(long))]
    pub adaptive: bool,
    /// How much closed regions count that stand out, 0 to 1. With 0 contrast and masks decide alone
    #[cfg_attr(feature = "cli", arg(long, value_name = "SHARE", default_value_t = Self::default().saliency))]
    pub saliency: f64,
    /// How firmly straight lines are held, 0 to 10
    #[cfg_attr(feature = "cli", arg(long, value_name = "STRENGTH", default_value_t = Self::default().lines))]
    pub lines: f64,
    /// The scale of what matters, 0.25 to 4, as far as the new size allows. Less keeps shapes better at strong reductions
    #[cfg_attr(feature = "cli", arg(long, value_name = "SCALE", default_value_t = Self::default().object_scale))]
    pub object_scale: f64,
    /// How the border of the picture may move
    #[cfg_attr(feature = "cli", arg(long, value_enum, default_value_t = Self::default().borders))]
    pub borders: Border,
    /// The share of a side that may be cut off, 0 to 0.5, if that is less loss than squeezing
    #[cfg_attr(feature = "cli", arg(long, value_name = "SHARE", default_value_t = Self::default().crop))]
    pub crop: f64,
    /// Quality of a JPEG output, 1 to 100: higher is larger and closer to the picture
    #[cfg_attr(feature = "cli", arg(long, value_name = "QUALITY", default_value_t = Self::default().quality))]
    pub quality: u8,
}

impl Default for Params {
    fn default() -> Self {
        let options = RetargetParams::default();
        Self {
            sizes: Vec::new(),
            keep_aspect: false,
            grid: options.grid_cells,
            adaptive: options.adaptive,
            saliency: options.saliency,
            lines: options.line_strength,
            object_scale: options.object_scale,
            borders: Border::default(),
            crop: options.max_crop,
            quality: WriteOptions::default().quality,
        }
    }
}

impl Params {
    fn options(&self) -> RetargetParams {
        RetargetParams {
            grid_cells: self.grid,
            adaptive: self.adaptive,
            saliency: self.saliency,
            line_strength: self.lines,
            object_scale: self.object_scale,
            borders: self.borders.into(),
            max_crop: self.crop,
        }
    }

    fn check(&self) -> Result<(), JobError> {
        let wrong = |name, value: String, range| Err(JobError::Parameter { name, value, range });
        let cells = self.grid.unwrap_or(2);
        let flags: [(&'static str, f64, f64, f64, &'static str); 5] = [
            ("--grid", cells as f64, 2.0, 400.0, "2 to 400"),
            ("--saliency", self.saliency, 0.0, 1.0, "0 to 1"),
            ("--lines", self.lines, 0.0, 10.0, "0 to 10"),
            ("--object-scale", self.object_scale, 0.25, 4.0, "0.25 to 4"),
            ("--crop", self.crop, 0.0, 0.5, "0 to 0.5"),
        ];
        for (name, value, low, high, range) in flags {
            if !(low..=high).contains(&value) {
                return wrong(name, value.to_string(), range);
            }
        }
        if self.sizes.is_empty() {
            return wrong("--size", "missing".to_owned(), "given at least once");
        }
        if !(1..=100).contains(&self.quality) {
            return wrong("--quality", self.quality.to_string(), "1 to 100");
        }
        Ok(())
    }
}

/// What the operation reads besides the picture, and what it writes besides its outputs.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Extras {
    /// What must keep its shape: white on black.
    pub protect: Option<Source>,
    /// What may give way.
    pub give_way: Option<Source>,
    /// The grid over the result: SVG if the name says so, else a picture.
    pub show_grid: Option<PathBuf>,
}

/// What stands for the size in the name of an output.
const PLACE: &str = "{size}";

/// The name of an output for a size.
fn named(path: &Path, size: Size) -> PathBuf {
    let text = format!("{}x{}", size.width(), size.height());
    path.to_str().map_or_else(
        || path.to_path_buf(),
        |name| PathBuf::from(name.replace(PLACE, &text)),
    )
}

fn is_svg(path: &Path) -> bool {
    path.extension()
        .is_some_and(|extension| extension.eq_ignore_ascii_case("svg"))
}

/// Makes the picture in every size. With several sizes, `{size}` in the name of an output becomes the size, as in `1080x1080`.
///
/// Figures: `cells`, `unknowns` and `straight_runs` of the analysis, `mean_importance`, 0 to 1; of all sizes the most
/// `bounded_edges` (that would have folded), `plain_share` (of plain scaling mixed in) and `cropped` (share of a side), and the
/// `least_area` of a cell against plain scaling. The result lists what was solved, size by size.
///
/// # Errors
/// [`JobError::Parameter`], [`JobError::Read`], [`JobError::SizesDiffer`], [`JobError::Retarget`], [`JobError::Write`], what
/// [`check_files`](crate::check_files) refuses, [`JobError::Cancelled`].
pub fn run(
    input: &Source,
    output: &Path,
    extras: &Extras,
    params: &Params,
    progress: &Progress,
) -> Result<Report, JobError> {
    params.check()?;
    let targets: Vec<&Path> = std::iter::once(output)
        .chain(extras.show_grid.as_deref())
        .collect();
    for &target in &targets {
        if !is_svg(target) || target == output {
            files::check_target(target)?;
        }
        if params.sizes.len() > 1 && !target.to_string_lossy().contains(PLACE) {
            return Err(JobError::Parameter {
                name: "--output",
                value: target.display().to_string(),
                range: "a name with {size} in it, where there are several sizes",
            });
        }
    }
    let masks = [&extras.protect, &extras.give_way].map(Option::as_ref);
    let inputs: Vec<&Path> = std::iter::once(input)
        .chain(masks.into_iter().flatten())
        .map(|source| source.path.as_path())
        .collect();
    files::check_files(&inputs, &targets)?;
    let mut report = Report::new("retarget", params);
    let picture = files::read(input, &mut report, progress)?;
    let size = picture.image.size();
    let mut sizes = Vec::new();
    for spec in &params.sizes {
        let new = spec.of(size, params.keep_aspect, input.limits.max_pixels)?;
        files::check_size(output, new, &picture)?;
        if !sizes.contains(&new) {
            sizes.push(new);
        }
    }
    let outputs: Vec<PathBuf> = targets
        .iter()
        .flat_map(|target| sizes.iter().map(|&size| named(target, size)))
        .collect();
    files::check_files(
        &inputs,
        &outputs.iter().map(PathBuf::as_path).collect::<Vec<_>>(),
    )?;
    let mut read = |mask: Option<&Source>| {
        mask.map(|mask| read_mask(mask, (&input.path, size), &mut report, progress))
            .transpose()
    };
    let (protect, give_way) = (read(masks[0])?, read(masks[1])?);
    let painted = Painted {
        protect: protect.as_ref(),
        give_way: give_way.as_ref(),
    };
    let failed = |cause| JobError::from_retargeting(&input.path, cause);
    let options = params.options();
    let retargeter = report
        .time("analyze", || {
            with_image!(&picture.image, image => Retargeter::new(image, painted, &options, progress))
        })
        .map_err(failed)?;
    let mut solved = Vec::new();
    for &new in &sizes {
        let deformation = report
            .time("solve", || retargeter.solve(new))
            .map_err(failed)?;
        let image: AnyImage = report
            .time(
                "warp",
                || with_image!(&picture.image, image => warped(&deformation, image, progress)),
            )
            .map_err(failed)?;
        if let Some(path) = &extras.show_grid {
            show_grid(
                &named(path, new),
                &deformation,
                &image,
                &mut report,
                progress,
            )?;
        }
        let options = WriteOptions {
            quality: params.quality,
            ..WriteOptions::default()
        };
        let path = named(output, new);
        files::write(
            &path,
            &picture.with_pixels(image),
            &options,
            &mut report,
            progress,
        )?;
        solved.push(deformation.summary().clone());
    }
    record(&mut report, retargeter.summary(), &solved);
    Ok(report)
}

fn record(report: &mut Report, analysis: &AnalysisSummary, solved: &[SolveSummary]) {
    let most = |value: fn(&SolveSummary) -> f64| solved.iter().map(value).fold(0.0, f64::max);
    let least_area = solved
        .iter()
        .map(|found| found.least_area)
        .fold(f64::INFINITY, f64::min);
    for (name, value) in [
        ("cells", analysis.cells as f64),
        ("unknowns", analysis.unknowns as f64),
        ("straight_runs", analysis.straight_runs as f64),
        ("mean_importance", analysis.mean_importance),
        ("bounded_edges", most(|found| found.bounded_edges as f64)),
        ("plain_share", most(|found| found.plain_share)),
        ("cropped", most(|found| found.cropped)),
        ("least_area", least_area),
    ] {
        report.figures.insert(name, value);
    }
    report.result = serde_json::to_value(solved).ok();
}

fn warped<P: Color>(
    deformation: &Deformation,
    image: &Image<P>,
    progress: &Progress,
) -> Result<AnyImage, RetargetError>
where
    AnyImage: From<Image<P>>,
{
    Ok(deformation.warp(image, progress)?.into())
}

/// Writes the grid, over the new picture or as a drawing.
fn show_grid(
    path: &Path,
    deformation: &Deformation,
    image: &AnyImage,
    report: &mut Report,
    progress: &Progress,
) -> Result<(), JobError> {
    if is_svg(path) {
        let mut drawing = Vec::new();
        deformation
            .write_grid_svg(None, &mut drawing)
            .expect("a vector takes every write");
        let text = String::from_utf8_lossy(&drawing);
        return files::write_output_text(path, "SVG", &text, report);
    }
    let drawn = with_grid(deformation, image.convert());
    let picture = ravec_media::Picture::from_image(drawn.convert::<Srgba<u8>>());
    files::write(path, &picture, &WriteOptions::default(), report, progress)
}

/// The new picture with the grid and the straight runs drawn over it.
fn with_grid(deformation: &Deformation, mut image: Image<LinearRgba>) -> Image<LinearRgba> {
    let width = line_width(image.size());
    for line in deformation.grid_lines() {
        draw_line(&mut image, line.ends, 0.4 * width, [0.9, 0.9, 0.9]);
    }
    for run in deformation.straight_runs() {
        for pair in run.windows(2) {
            draw_line(&mut image, [pair[0], pair[1]], width, [1.0, 0.6, 0.0]);
        }
    }
    image
}

#[cfg(test)]
mod tests {
    use super::*;
    use ravec::raster::Srgb;
    use ravec_media::Picture;

    fn write(folder: &Path, name: &str, image: impl Into<AnyImage>) -> Source {
        let path = folder.join(name);
        ravec_media::write(&path, &Picture::from_image(image), &WriteOptions::default()).unwrap();
        Source::new(path)
    }

    fn folder() -> (tempfile::TempDir, Source) {
        let folder = tempfile::tempdir().unwrap();
        let image = Image::from_fn(Size::new(120, 80).unwrap(), |col, row| {
            let r = (col as f64 - 60.0).hypot(row as f64 - 40.0);
            Srgb(if r < 18.0 {
                [30u16, 30, 9000]
            } else {
                [60000, (col * 90) as u16, 50000]
            })
        });
        let input = write(folder.path(), "in.png", image);
        (folder, input)
    }

    fn params(sizes: &[&str]) -> Params {
        Params {
            sizes: sizes.iter().map(|size| size.parse().unwrap()).collect(),
            grid: Some(24),
            ..Params::default()
        }
    }

    #[test]
    fn several_sizes_come_from_one_analysis_in_the_depth_of_the_input() {
        let (folder, input) = folder();
        let extras = Extras {
            show_grid: Some(folder.path().join("grid-{size}.svg")),
            ..Extras::default()
        };
        let params = params(&["60x80", "75%x100%", "x40"]);
        let output = folder.path().join("out-{size}.png");
        let report = run(&input, &output, &extras, &params, &Progress::none()).unwrap();
        assert_eq!(report.outputs.len(), 6);
        assert_eq!(report.result.as_ref().unwrap().as_array().unwrap().len(), 3);
        assert!(report.figures["least_area"] > 0.0);
        for (name, width, height) in [("60x80", 60, 80), ("90x80", 90, 80), ("120x40", 120, 40)] {
            let path = folder.path().join(format!("out-{name}.png"));
            let found = ravec_media::read(&path, &input.limits).unwrap().image;
            assert_eq!(found.size(), Size::new(width, height).unwrap());
            assert!(matches!(found, AnyImage::Srgb16(_)));
            let svg = std::fs::read_to_string(folder.path().join(format!("grid-{name}.svg")));
            assert_eq!(svg.unwrap().matches("<path").count(), 24 * 16);
        }
    }

    #[test]
    fn masks_must_fit_and_names_must_tell_sizes_apart() {
        let (folder, input) = folder();
        let small = write(
            folder.path(),
            "small.png",
            Image::new(Size::new(9, 9).unwrap(), Srgb([0u8; 3])),
        );
        let extras = Extras {
            protect: Some(small),
            ..Extras::default()
        };
        let output = folder.path().join("out.png");
        let none = Progress::none();
        let error = run(&input, &output, &extras, &params(&["60x80"]), &none).unwrap_err();
        assert_eq!(error.exit_code(), 3);
        let two = run(
            &input,
            &output,
            &Extras::default(),
            &params(&["60x80", "50%"]),
            &none,
        )
        .unwrap_err();
        assert_eq!(two.exit_code(), 2);
        assert!(two.to_string().contains("{size}"), "{two}");
        let far = run(
            &input,
            &output,
            &Extras::default(),
            &params(&["1x80"]),
            &none,
        )
        .unwrap_err();
        assert_eq!(far.exit_code(), 2);
        assert!(!output.exists());
    }

    #[test]
    fn flags_out_of_range_are_named() {
        let (folder, input) = folder();
        let output = folder.path().join("out.png");
        let wrong = [
            (
                Params {
                    grid: Some(1),
                    ..params(&["50%"])
                },
                "--grid",
            ),
            (
                Params {
                    saliency: 2.0,
                    ..params(&["50%"])
                },
                "--saliency",
            ),
            (
                Params {
                    lines: f64::NAN,
                    ..params(&["50%"])
                },
                "--lines",
            ),
            (
                Params {
                    object_scale: 9.0,
                    ..params(&["50%"])
                },
                "--object-scale",
            ),
            (
                Params {
                    crop: 0.9,
                    ..params(&["50%"])
                },
                "--crop",
            ),
            (
                Params {
                    quality: 0,
                    ..params(&["50%"])
                },
                "--quality",
            ),
            (params(&[]), "--size"),
        ];
        for (params, flag) in wrong {
            let error = run(
                &input,
                &output,
                &Extras::default(),
                &params,
                &Progress::none(),
            )
            .unwrap_err();
            assert!(error.to_string().contains(flag), "{error}");
            assert_eq!(error.exit_code(), 2);
        }
    }
}

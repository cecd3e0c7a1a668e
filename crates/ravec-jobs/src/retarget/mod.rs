//! `retarget`: a picture in other formats, with objects in shape and lines straight.

mod clip;
mod params;
mod size;
mod stream;

pub use params::Params;
pub use size::SizeSpec;
pub use stream::ClipStream;

use crate::context::Context;
use crate::error::JobError;
use crate::files;
use crate::mask::read_mask;
use crate::operation::{Operation, paths};
use crate::plane::{draw_line, line_width};
use crate::report::Report;
use crate::video::{check_no_encoding, is_clip};
use ravec::raster::{AnyImage, Image, LinearRgba, Size, Srgba, with_image};
use ravec::retarget::{AnalysisSummary, Deformation, Painted, Retargeter, SolveSummary};
use ravec_media::{Picture, WriteOptions};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Change the aspect ratio of a picture or a clip: objects keep their shape, straight lines stay straight
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args), command(after_help = HELP))]
pub struct Retarget {
    /// Input picture, or a clip; `-` is a picture on standard input
    pub input: PathBuf,
    /// Output picture or clip; its extension selects the format, `-` is standard output in the input's format. With several
    /// sizes `{size}` in the name stands for each
    #[cfg_attr(feature = "cli", arg(short, long, value_name = "FILE"))]
    pub output: PathBuf,
    /// Mask of the objects that keep their shape, of the same size, white on black; of a clip also a clip of masks; `-` is
    /// standard input
    #[cfg_attr(feature = "cli", arg(long, value_name = "MASK"))]
    #[serde(default)]
    pub protect: Option<PathBuf>,
    /// Mask of the areas that may be squeezed or stretched first, likewise
    #[cfg_attr(feature = "cli", arg(long, value_name = "MASK"))]
    #[serde(default)]
    pub give_way: Option<PathBuf>,
    /// Write the deformed grid and the straight lines as well, over the result or, if the name ends in .svg, as a drawing
    #[cfg_attr(feature = "cli", arg(long, value_name = "FILE"))]
    #[serde(default)]
    pub show_grid: Option<PathBuf>,
    /// Parameters.
    #[cfg_attr(feature = "cli", command(flatten))]
    #[serde(default)]
    pub params: Params,
}

#[cfg(feature = "cli")]
const HELP: &str = "\
Examples:
  ravec retarget photo.jpg -o square.png --size 100x100
  ravec retarget photo.jpg -o narrow.jpg --size 75%x100% --protect mask.png --show-grid grid.svg
  ravec retarget photo.jpg -o 'out-{size}.png' --size 60x120 --size 160x60 --size 50% --crop 0.2
  ravec retarget clip.y4m -o 'wide-{size}.y4m' --size 75%x100% --size 40x40

If both sides change by the same factor, the result is plain scaling. A side may change to between 1/20 and 20 times its length.

Figures: cells, unknowns and straight_runs of the analysis, mean_importance (0 to 1); of all sizes the most bounded_edges (kept \
from folding), plain_share (plain scaling mixed in to prove that nothing folds) and cropped (share of a side), and the least_area \
of a cell against plain scaling. With --json the result lists these for each size.

Clips: the motion of the camera is taken out, and the deformation changes slowly, with a look-ahead of one second. Figures of a clip: \
frames, cuts, look_ahead_frames, frames_held (the most at a time), keys_solved, second_difference_px (the largest second temporal \
difference of a vertex), least_area, object_scale.";

/// Placeholder of the size in the name of an output.
const PLACEHOLDER: &str = "{size}";

/// The name of an output for a size.
fn named(path: &Path, size: Size) -> PathBuf {
    let text = format!("{}x{}", size.width(), size.height());
    path.to_str().map_or_else(
        || path.to_path_buf(),
        |name| PathBuf::from(name.replace(PLACEHOLDER, &text)),
    )
}

fn is_svg(path: &Path) -> bool {
    path.extension()
        .is_some_and(|extension| extension.eq_ignore_ascii_case("svg"))
}

impl Operation for Retarget {
    const NAME: &'static str = "retarget";

    fn inputs(&self) -> Vec<&Path> {
        paths(&self.input, [&self.protect, &self.give_way])
    }

    fn outputs(&self) -> Vec<&Path> {
        paths(&self.output, [&self.show_grid])
    }

    /// Writes the picture in every size. With several sizes, `{size}` in the name of an output becomes the size, as in `1080x1080`.
    ///
    /// Figures: `cells`, `unknowns` and `straight_runs` of the analysis, `mean_importance`, 0 to 1; of all sizes the most
    /// `bounded_edges` (that would have folded), `plain_share` (of plain scaling mixed in) and `cropped` (share of a side), and the
    /// `least_area` of a cell against plain scaling. The result lists what was solved, size by size.
    ///
    /// # Errors
    /// [`JobError::Parameter`], [`JobError::Missing`], [`JobError::Read`], [`JobError::SizesDiffer`], [`JobError::Retarget`],
    /// [`JobError::Write`], what [`check_files`](crate::check_files) refuses, [`JobError::Cancelled`].
    fn run(&self, context: &Context) -> Result<Report, JobError> {
        let Self { input, params, .. } = self;
        let progress = &context.progress;
        params.check()?;
        if is_clip(input, context) {
            return clip::run(self, context);
        }
        check_no_encoding(&params.encoding)?;
        self.check_names(context)?;
        context.check_files(&self.inputs(), &self.outputs())?;
        let mut report = Report::of(self, params);
        let picture = files::read(input, &mut report, context)?;
        let size = picture.image.size();
        let sizes = self.sizes(&picture, context)?;
        let mut read = |path: Option<&PathBuf>| {
            path.map(|path| read_mask(path, input, size, &mut report, context))
                .transpose()
        };
        let (protect, give_way) = (read(self.protect.as_ref())?, read(self.give_way.as_ref())?);
        let (protect, give_way) = params.with_polygons(protect, give_way, size)?;
        params.warn_of_polygons_outside(size, &mut report);
        let painted = Painted {
            protect: protect.as_ref(),
            give_way: give_way.as_ref(),
        };
        let failed = |cause| JobError::from_retargeting(input, cause);
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
            self.deliver(&deformation, new, &picture, &mut report, context)?;
            solved.push(deformation.summary().clone());
        }
        record(&mut report, retargeter.summary(), &solved);
        Ok(report)
    }
}

impl Retarget {
    /// Refuses names of outputs that do not name a format, or do not distinguish several sizes.
    fn check_names(&self, context: &Context) -> Result<(), JobError> {
        for target in self.outputs() {
            if !is_svg(target) || target == self.output {
                files::check_target(target, context)?;
            }
            let several = self.params.sizes.len() > 1;
            if several && !target.to_string_lossy().contains(PLACEHOLDER) {
                return Err(JobError::Parameter {
                    field: "output",
                    value: target.display().to_string(),
                    range: "a name with {size} in it, where there are several sizes",
                });
            }
        }
        Ok(())
    }

    /// The sizes in pixels, each once. Outputs of these sizes are checked.
    fn sizes(&self, picture: &Picture, context: &Context) -> Result<Vec<Size>, JobError> {
        let mut sizes = Vec::new();
        for spec in &self.params.sizes {
            let keep_aspect = self.params.keep_aspect;
            let size = spec.of(picture.image.size(), keep_aspect, context.limits.max_pixels)?;
            files::check_size(&self.output, size, picture, context)?;
            if !sizes.contains(&size) {
                sizes.push(size);
            }
        }
        let targets = self.outputs();
        let outputs = targets
            .iter()
            .flat_map(|target| sizes.iter().map(|&size| named(target, size)));
        let outputs: Vec<PathBuf> = outputs.collect();
        let outputs: Vec<&Path> = outputs.iter().map(PathBuf::as_path).collect();
        context.check_files(&self.inputs(), &outputs)?;
        Ok(sizes)
    }

    /// Warps the picture to one size, and writes it and its grid.
    fn deliver(
        &self,
        deformation: &Deformation,
        size: Size,
        picture: &Picture,
        report: &mut Report,
        context: &Context,
    ) -> Result<(), JobError> {
        let image: AnyImage = report
            .time("warp", || {
                context
                    .device
                    .warp(deformation, &picture.image, &context.progress)
            })
            .map_err(|cause| JobError::from_retargeting(&self.input, cause))?;
        context.device.report_warnings(report);
        if let Some(path) = &self.show_grid {
            show_grid(&named(path, size), deformation, &image, report, context)?;
        }
        let options = WriteOptions {
            quality: self.params.quality,
            ..WriteOptions::default()
        };
        let path = named(&self.output, size);
        files::write(
            &path,
            &picture.with_pixels(image),
            &options,
            report,
            context,
        )
    }
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

/// Writes the grid, over the new picture or as a drawing.
fn show_grid(
    path: &Path,
    deformation: &Deformation,
    image: &AnyImage,
    report: &mut Report,
    context: &Context,
) -> Result<(), JobError> {
    if is_svg(path) {
        let mut drawing = Vec::new();
        deformation
            .write_grid_svg(None, &mut drawing)
            .expect("a vector takes every write");
        let text = String::from_utf8_lossy(&drawing);
        return files::write_output_text(path, "SVG", &text, report, context);
    }
    let drawn = with_grid(deformation, image.convert());
    let picture = Picture::from_image(drawn.convert::<Srgba<u8>>());
    files::write(path, &picture, &WriteOptions::default(), report, context)
}

/// Draws the deformed grid and the straight runs over `image`, the picture at its new size.
pub fn with_grid(deformation: &Deformation, mut image: Image<LinearRgba>) -> Image<LinearRgba> {
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
    use crate::ErrorKind;
    use crate::corners::Corners;
    use ravec::raster::{Mask, Srgb};
    use ravec_media::Picture;

    fn write(folder: &Path, name: &str, image: impl Into<AnyImage>) -> PathBuf {
        let path = folder.join(name);
        ravec_media::write(&path, &Picture::from_image(image), &WriteOptions::default()).unwrap();
        path
    }

    /// Files of [`run`] beside the picture.
    #[derive(Default)]
    struct Extras {
        protect: Option<PathBuf>,
        show_grid: Option<PathBuf>,
    }

    fn run(
        input: &Path,
        output: &Path,
        extras: &Extras,
        params: &Params,
    ) -> Result<Report, JobError> {
        let operation = Retarget {
            input: input.to_path_buf(),
            output: output.to_path_buf(),
            protect: extras.protect.clone(),
            give_way: None,
            show_grid: extras.show_grid.clone(),
            params: params.clone(),
        };
        operation.run(&Context::default())
    }

    fn folder() -> (tempfile::TempDir, PathBuf) {
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
        let report = run(&input, &output, &extras, &params).unwrap();
        assert_eq!(report.outputs.len(), 6);
        assert_eq!(report.result.as_ref().unwrap().as_array().unwrap().len(), 3);
        assert!(report.figures["least_area"] > 0.0);
        for (name, width, height) in [("60x80", 60, 80), ("90x80", 90, 80), ("120x40", 120, 40)] {
            let path = folder.path().join(format!("out-{name}.png"));
            let found = ravec_media::read(&path, &ravec_media::Limits::default())
                .unwrap()
                .image;
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
        let error = run(&input, &output, &extras, &params(&["60x80"])).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::Input);
        let two = run(
            &input,
            &output,
            &Extras::default(),
            &params(&["60x80", "50%"]),
        )
        .unwrap_err();
        assert_eq!(two.kind(), ErrorKind::Request);
        assert!(two.to_string().contains("{size}"), "{two}");
        let far = run(&input, &output, &Extras::default(), &params(&["1x80"])).unwrap_err();
        assert_eq!(far.kind(), ErrorKind::Request);
        assert!(!output.exists());
    }

    #[test]
    fn polygons_protect_as_a_mask_of_them_does() {
        let (folder, input) = folder();
        let size = ravec_media::read(&input, &ravec_media::Limits::default())
            .unwrap()
            .image
            .size();
        let corners = "6.5,4,30,5,28,40,8,36";
        let polygon: Corners = corners.parse().unwrap();
        let mask = Mask::from_polygon(size, &polygon.0).unwrap();
        // 16 bits, as coverage has many steps
        let gray = mask
            .coverage()
            .map(|value| Srgb([(65535.0 * value).round() as u16; 3]));
        let extras = Extras {
            protect: Some(write(folder.path(), "mask.png", gray)),
            ..Extras::default()
        };
        let outputs = ["a.png", "b.png", "c.png"].map(|name| folder.path().join(name));
        let plain = params(&["60x80"]);
        run(&input, &outputs[0], &extras, &plain).unwrap();
        let drawn = Params {
            protect_polygons: vec![polygon],
            ..plain.clone()
        };
        run(&input, &outputs[1], &Extras::default(), &drawn).unwrap();
        run(&input, &outputs[2], &Extras::default(), &plain).unwrap();
        let [a, b, c] = outputs.map(|path| std::fs::read(path).unwrap());
        assert!(a == b && b != c);
        let beside = Params {
            protect_polygons: vec!["900,4,930,5,928,40".parse().unwrap()],
            ..plain.clone()
        };
        let output = folder.path().join("e.png");
        let report = run(&input, &output, &Extras::default(), &beside).unwrap();
        assert!(report.warnings[0].starts_with("nothing of protect polygon 1"));
        assert!(std::fs::read(output).unwrap() == c);
        let two = Params {
            give_way_polygons: vec![Corners(vec![glam::DVec2::ZERO; 2])],
            ..plain
        };
        let error = run(
            &input,
            &folder.path().join("d.png"),
            &Extras::default(),
            &two,
        );
        assert!(error.unwrap_err().to_string().contains("3 corners"));
    }

    #[test]
    fn parameters_out_of_range_are_named() {
        let (folder, input) = folder();
        let output = folder.path().join("out.png");
        let wrong = [
            (
                Params {
                    grid: Some(1),
                    ..params(&["50%"])
                },
                "`grid`",
            ),
            (
                Params {
                    saliency: 2.0,
                    ..params(&["50%"])
                },
                "`saliency`",
            ),
            (
                Params {
                    lines: f64::NAN,
                    ..params(&["50%"])
                },
                "`lines`",
            ),
            (
                Params {
                    object_scale: 9.0,
                    ..params(&["50%"])
                },
                "`object_scale`",
            ),
            (
                Params {
                    crop: 0.9,
                    ..params(&["50%"])
                },
                "`crop`",
            ),
            (
                Params {
                    quality: 0,
                    ..params(&["50%"])
                },
                "`quality`",
            ),
            (params(&[]), "`sizes`"),
        ];
        for (params, field) in wrong {
            let error = run(&input, &output, &Extras::default(), &params).unwrap_err();
            assert!(error.to_string().contains(field), "{error}");
            assert_eq!(error.kind(), ErrorKind::Request);
        }
    }
}

//! `demo`: one page that shows what two-color pixels, planes and meshes are good for, with pictures, timings and measured figures.
//!
//! Everything is worked out while the page is made, from the built-in street or from a photo, and from solids with formulas.

use crate::error::JobError;
use crate::files::{self, Source};
use crate::gallery::{Figure, Gallery};
use crate::mesh;
use crate::plane;
use crate::report::Report;
use glam::DVec2;
use ravec::completion::{CompleteParams, complete};
use ravec::progress::Progress;
use ravec::raster::{
    AnyImage, Comparison, Image, LinearRgb, LinearRgba, Mask, PremulLinearRgba, Rect, ResizeFilter,
    Size, Srgb, compare, resize,
};
use ravec::twocolor::brush::{Stroke, Strokes, Tool, replay};
use ravec::twocolor::{
    AdaptiveField, AdaptiveParams, BlockField, CleanParams, FitParams, Mode, OperatorParams,
    SvgParams, TwoColorField, WindowParams, clean_with, enlarge, estimate_noise, operate,
    render_mosaic, render_to, write_svg,
};
use ravec_scenes::Seed;
use ravec_scenes::damage::{SensorNoise, add_gaussian_noise, add_sensor_noise};
use ravec_scenes::jpeg::{JpegParams, add_jpeg_damage};
use ravec_scenes::occlusion::{Surface, occluded};
use ravec_scenes::street::street;
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::time::Instant;

/// What the demonstration is made of.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct Params {
    /// The longest side of the picture that is worked on, 64 to 8192; larger photos are reduced
    ///
    /// Below 640, pictures of meshes are smaller and coarser, too.
    #[cfg_attr(feature = "cli", arg(long, value_name = "PX", default_value_t = Params::default().max_side))]
    pub max_side: usize,
    /// What the built-in street and the added noise are drawn from
    #[cfg_attr(feature = "cli", arg(long, default_value_t = Params::default().seed))]
    pub seed: u64,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            max_side: 1536,
            seed: 1,
        }
    }
}

/// Side of the part that is shown enlarged, in pixels.
const CROP: [usize; 2] = [96, 72];

/// How much parts are enlarged.
const ZOOM: usize = 4;

/// Makes the page `index.html` in the folder `out`, from a photo or from the built-in street.
///
/// Figures: `twocolor_psnr_db` and `mosaic_psnr_db` at blocks of 8; `clean_psnr_db` and `noisy_psnr_db` at noise of 25 steps;
/// `fit_megapixels_per_second`; `snapped_px`, how far a grid that snapped is off; `simplified_triangles` and `simplified_distance_percent` of a torus;
/// `front_completed_error_steps` and `floor_completed_error_steps` of what was filled in perspective, in 8-bit steps;
/// `offset_triangles`, `offset_error_percent` (of the tolerance) and `offset_proved` of offsets.
///
/// # Errors
/// [`JobError::Parameter`], [`JobError::Read`] for the photo, [`JobError::Write`], [`JobError::Cancelled`].
///
/// # Panics
/// Never: the size of the built-in street follows from a side that was checked.
pub fn run(
    photo: Option<&Source>,
    out: &Path,
    params: &Params,
    progress: &Progress,
) -> Result<Report, JobError> {
    if !(64..=8192).contains(&params.max_side) {
        return Err(JobError::Parameter {
            name: "--max-side",
            value: params.max_side.to_string(),
            range: "64 to 8192",
        });
    }
    files::check_folder(out)?;
    let mut report = Report::new("demo", params);
    report.seed = Some(params.seed);
    let (image, origin) = if let Some(source) = photo {
        let picture = files::read(source, &mut report, progress)?;
        (reduced(&picture.image, params.max_side), "the photo")
    } else {
        // three to two; at least 64 pixels wide, as checked above
        let size =
            Size::new(params.max_side, params.max_side * 2 / 3).expect("both sides are positive");
        let phase = progress.phase("draw", 1);
        let image = report.time("draw", || street(size, Seed(params.seed)).0);
        phase.advance(1);
        (image.convert(), "a street drawn by formulas")
    };
    let mut demo = Demo {
        // eight bits, as a file would have
        image: image.convert::<Srgb<u8>>().convert(),
        page: Gallery::new(
            "Ravec",
            "Pictures whose blocks of pixels become lines with two colors, and solids made of triangles: what that is good \
             for, worked out just now.",
        ),
        detail: Rect::default(),
        report: &mut report,
        progress,
    };
    demo.detail = demo.busiest_part()?;
    demo.input(origin)?;
    demo.two_color_pixels()?;
    demo.any_scale()?;
    demo.operator()?;
    demo.paint()?;
    demo.cleaning(Seed(params.seed))?;
    demo.completion(params.max_side, Seed(params.seed))?;
    demo.speed()?;
    let mut page = demo.page;
    let side = params.max_side;
    plane::show(&mut page, &mut report, Seed(params.seed), side, progress)?;
    let detail = mesh::Detail::of(side);
    mesh::show(&mut page, &mut report, Seed(params.seed), detail, progress)?;
    mesh::offset::show(&mut page, &mut report, detail, progress)?;
    let page = page.finish();
    files::make_folder(out)?;
    files::write_output_text(&out.join("index.html"), "HTML", &page, &mut report)?;
    Ok(report)
}

/// The picture, reduced if a side is too long.
fn reduced(image: &AnyImage, max_side: usize) -> Image<LinearRgba> {
    let (width, height) = (image.size().width(), image.size().height());
    let image = image.convert::<PremulLinearRgba>();
    let factor = max_side as f64 / width.max(height) as f64;
    if factor >= 1.0 {
        return image.convert();
    }
    let side = |pixels: usize| ((pixels as f64 * factor).round() as usize).max(1);
    match Size::new(side(width), side(height)) {
        Ok(size) => resize(&image, size, ResizeFilter::Lanczos3).convert(),
        Err(_) => image.convert(),
    }
}

/// The page in the making.
struct Demo<'a> {
    image: Image<LinearRgba>,
    page: Gallery,
    /// The part that is shown enlarged.
    detail: Rect,
    report: &'a mut Report,
    progress: &'a Progress,
}

impl Demo<'_> {
    fn fit(&self, block_px: usize) -> Result<TwoColorField, JobError> {
        let params = FitParams {
            block_px,
            ..FitParams::default()
        };
        let mut field = TwoColorField::fit(&self.image, &params, self.progress)?;
        field.refine_lines(&self.image, self.progress)?;
        Ok(field)
    }

    fn size(&self) -> Size {
        self.image.size()
    }

    /// Where the contrast of two-color pixels is largest: edges, not noise.
    fn busiest_part(&self) -> Result<Rect, JobError> {
        let field = self.fit(8)?;
        let (columns, rows) = (CROP[0] / 8, CROP[1] / 8);
        let grid = field.grid_size();
        let score = |col: usize, row: usize| {
            let blocks = (row..(row + rows).min(grid.height()))
                .flat_map(|r| (col..(col + columns).min(grid.width())).map(move |c| (c, r)));
            blocks
                .map(|(c, r)| {
                    let block = field.block(c, r);
                    // well explained edges
                    block.contrast() - 4.0 * block.error.sqrt()
                })
                .sum::<f32>()
        };
        let last_col = grid.width().saturating_sub(columns);
        let last_row = grid.height().saturating_sub(rows);
        let places = (0..=last_row)
            .step_by(4)
            .flat_map(|row| (0..=last_col).step_by(4).map(move |col| (col, row)));
        let best = places.max_by(|&a, &b| score(a.0, a.1).total_cmp(&score(b.0, b.1)));
        let (col, row) = best.unwrap_or((0, 0));
        Ok(Rect::new(8 * col, 8 * row, CROP[0], CROP[1]).intersection(Rect::of(self.size())))
    }

    /// An even place beside the part with edges, and a part of twice the size around it.
    fn even_place(&self) -> Result<(Rect, [f64; 2]), JobError> {
        let field = self.fit(8)?;
        let grid = field.grid_size();
        let span = |begin: usize, len: usize, limit: usize| {
            begin / 8..((begin + len) / 8).clamp(begin / 8 + 1, limit)
        };
        let columns = span(self.detail.col, self.detail.width, grid.width());
        let rows = span(self.detail.row, self.detail.height, grid.height());
        let unevenness = |&(col, row): &(usize, usize)| {
            let block = field.block(col, row);
            block.contrast() + block.error.sqrt()
        };
        let places = rows.flat_map(|row| columns.clone().map(move |col| (col, row)));
        let best = places
            .min_by(|a, b| unevenness(a).total_cmp(&unevenness(b)))
            .unwrap_or((0, 0));
        let (x, y) = (8 * best.0 + 4, 8 * best.1 + 4);
        let part = Rect::new(
            x.saturating_sub(CROP[0]),
            y.saturating_sub(CROP[1]),
            2 * CROP[0],
            2 * CROP[1],
        );
        Ok((
            part.intersection(Rect::of(self.size())),
            [x as f64, y as f64],
        ))
    }

    fn crop(&self, image: &Image<LinearRgba>, caption: impl Into<String>) -> Figure {
        Figure::crop(image, self.detail, ZOOM, caption)
    }

    fn compared(&self, image: &Image<LinearRgba>) -> Option<Comparison> {
        compare(&self.image, image).ok()
    }

    fn input(&mut self, origin: &str) -> Result<(), JobError> {
        let (width, height) = (self.size().width(), self.size().height());
        let text = format!(
            "{width} x {height} pixels: {origin}. The part on the right is shown enlarged below."
        );
        self.page.section("The picture", &text);
        let figures = [
            Figure::picture(&self.image, "the picture"),
            self.crop(&self.image, "a part of it, 4 times"),
        ];
        self.page.figures(&figures);
        Ok(self.progress.check()?)
    }

    fn two_color_pixels(&mut self) -> Result<(), JobError> {
        self.page.section(
            "Two-color pixels",
            "Each block of N x N pixels is replaced by the best of all lines and one color on each side. Beside it the mosaic \
             of mean colors with blocks of the same size.",
        );
        let size = self.size();
        let mut rows = Vec::new();
        for block_px in [4, 8, 16] {
            let field = self.fit(block_px)?;
            let lines = render_to(&field, size, self.progress)?;
            let mosaic = render_mosaic(&field, size, self.progress)?;
            rows.push(self.row(&format!("N = {block_px}"), &field, &lines, Some(&mosaic)));
            if block_px == 8 {
                let figures = [
                    Figure::picture(&lines, "two-color pixels, N = 8"),
                    Figure::picture(&mosaic, "mosaic, N = 8"),
                ];
                self.page.figures(&figures);
                if let (Some(two), Some(one)) = (self.compared(&lines), self.compared(&mosaic)) {
                    self.report.figures.insert("twocolor_psnr_db", two.psnr_db);
                    self.report.figures.insert("mosaic_psnr_db", one.psnr_db);
                }
                let crops = [
                    self.crop(&self.image, "input"),
                    self.crop(&lines, "two-color pixels"),
                    self.crop(&mosaic, "mosaic"),
                ];
                self.page.figures(&crops);
            }
        }
        let params = AdaptiveParams::default();
        let mut field = AdaptiveField::fit(&self.image, &params, self.progress)?;
        field.refine_lines(&self.image, self.progress)?;
        let adaptive = render_to(&field, size, self.progress)?;
        rows.push(self.row("adaptive, 4 to 32", &field, &adaptive, None));
        let text = "Adaptive blocks grow where two colors are enough; neighbors differ by at most one size.";
        self.page.paragraph(text);
        self.page.figures(&[
            Figure::picture(&adaptive, "adaptive two-color pixels"),
            self.crop(&adaptive, "a part of it"),
        ]);
        self.page.table(
            &[
                "blocks",
                "number",
                "flat",
                "PSNR dB",
                "SSIM",
                "mosaic PSNR dB",
            ],
            &rows,
        );
        Ok(())
    }

    fn row(
        &self,
        name: &str,
        field: &impl BlockField,
        lines: &Image<LinearRgba>,
        mosaic: Option<&Image<LinearRgba>>,
    ) -> Vec<String> {
        let blocks: Vec<_> = field.placed_blocks().collect();
        let flat = blocks.iter().filter(|block| block.pixel.is_flat()).count();
        let figure = |image: &Image<LinearRgba>, pick: fn(&Comparison) -> String| {
            self.compared(image)
                .map_or(String::new(), |comparison| pick(&comparison))
        };
        vec![
            name.to_owned(),
            blocks.len().to_string(),
            format!("{} %", 100 * flat / blocks.len().max(1)),
            figure(lines, |c| format!("{:.2}", c.psnr_db)),
            figure(lines, |c| format!("{:.3}", c.ssim)),
            mosaic.map_or(String::new(), |mosaic| {
                figure(mosaic, |c| format!("{:.2}", c.psnr_db))
            }),
        ]
    }

    fn any_scale(&mut self) -> Result<(), JobError> {
        self.page.section(
            "Any resolution",
            "A line has no pixels. The two-color image is drawn at 6 times the size, and as a vector graphic; enlarging the \
             picture itself draws the lines of overlapping windows and keeps the texture.",
        );
        let part = Rect::new(
            self.detail.col,
            self.detail.row,
            self.detail.width.min(72),
            self.detail.height.min(56),
        );
        let Some(part_size) = part.size() else {
            return Ok(());
        };
        let Ok(image) = self.image.crop(part.col, part.row, part_size) else {
            return Ok(());
        };
        let factor = 6;
        let Ok(size) = Size::new(part.width * factor, part.height * factor) else {
            return Ok(());
        };
        let fit = FitParams {
            block_px: 4,
            ..FitParams::default()
        };
        let mut field = TwoColorField::fit(&image, &fit, self.progress)?;
        field.refine_lines(&image, self.progress)?;
        let blocks = render_to(&field, size, self.progress)?;
        let smooth = resize(
            &image.convert::<PremulLinearRgba>(),
            size,
            ResizeFilter::CatmullRom,
        )
        .convert();
        let crisp = enlarge(
            &image,
            factor as f64,
            &WindowParams::default(),
            self.progress,
        )?;
        let mut svg = Vec::new();
        // a vector takes every write
        let drawn = write_svg(&field, &SvgParams::default(), &mut svg).is_ok();
        let whole = |image: &Image<LinearRgba>, caption: &str| {
            Figure::crop(image, Rect::of(image.size()), 1, caption)
        };
        let mut figures = vec![
            Figure::crop(&image, Rect::of(image.size()), factor, "pixels"),
            whole(&smooth, "Catmull-Rom"),
            whole(&crisp, "enlarged with lines"),
            whole(&blocks, "two-color pixels, N = 4"),
        ];
        if drawn {
            let text = String::from_utf8_lossy(&svg);
            figures.push(Figure::svg(
                &text,
                size.width(),
                "the same as a vector graphic",
            ));
        }
        self.page.figures(&figures);
        Ok(())
    }

    fn operator(&mut self) -> Result<(), JobError> {
        self.page.section(
            "The operator",
            "Each pixel looks at the window around it: on which side of the line it lies, and what that side's color is.",
        );
        let region = self.detail;
        // enough around the part for windows and iterations
        let around = Rect::new(
            region.col.saturating_sub(32),
            region.row.saturating_sub(32),
            region.width + 64,
            region.height + 64,
        );
        for (mode, iterations, text) in [
            (Mode::Abstract, 3, "abstract, 3 times"),
            (Mode::Smooth, 1, "smooth"),
            (Mode::Sharpen, 1, "sharpen"),
            (Mode::Antialias, 1, "antialias"),
            (Mode::Stamp, 1, "stamp"),
        ] {
            let params = OperatorParams {
                mode,
                iterations,
                ..OperatorParams::default()
            };
            let around = around.intersection(Rect::of(self.size()));
            let result = operate(&self.image, around, &params, self.progress)?;
            let inner = Rect::new(
                region.col - around.col,
                region.row - around.row,
                region.width,
                region.height,
            );
            let figures = [
                self.crop(&self.image, "input"),
                Figure::crop(&result, inner, ZOOM, text),
            ];
            self.page.figures(&figures);
        }
        Ok(())
    }

    fn paint(&mut self) -> Result<(), JobError> {
        self.page.section(
            "The brush",
            "One dab of a brush that is wider than the place it is set on, with each tool. Paint stops where the color on the way \
             from its middle changes, so nothing has to be masked.",
        );
        let (part, dab) = self.even_place()?;
        let smooth = |mode| Tool::Operator {
            mode,
            iterations: 1,
            noise_sigma: None,
        };
        let mut figures = vec![Figure::crop(&self.image, part, 2, "input")];
        for (tool, name) in [
            (Tool::Color { rgb: [200, 40, 30] }, "color"),
            (Tool::Recolor { rgb: [40, 90, 200] }, "recolor"),
            (Tool::Dodge, "dodge"),
            (Tool::Burn, "burn"),
            (Tool::Saturation { amount: 1.5 }, "saturation"),
            (smooth(Mode::Abstract), "abstract"),
            (Tool::Clone { offset: [-24, 0] }, "clone"),
            (Tool::Mask, "mask"),
        ] {
            let mut strokes = Strokes::new(self.size());
            let radius = 0.45 * part.height.max(3) as f64;
            strokes.strokes.push(Stroke::new(tool, vec![dab], radius));
            let failed = |cause| JobError::from_strokes(Path::new("the demonstration"), cause);
            let painted = replay(self.image.clone(), &strokes, self.progress).map_err(failed)?;
            let shown = match painted.mask {
                Some(mask) => mask.map(|v| LinearRgba([v, v, v, 1.0])),
                None => painted.image,
            };
            figures.push(Figure::crop(&shown, part, 2, name));
        }
        self.page.figures(&figures);
        Ok(())
    }

    fn cleaning(&mut self, seed: Seed) -> Result<(), JobError> {
        self.page.section(
            "Cleaning",
            "Noise and compression damage are added to the picture, and taken off without being told how strong they are.",
        );
        let original = self.image.convert::<Srgb<u8>>();
        let sensor = SensorNoise {
            gain: 2.5e-3,
            read: 5e-3,
        };
        let jpeg = JpegParams {
            quality: 30,
            ..JpegParams::default()
        };
        let damaged: [(&str, Image<Srgb<u8>>); 3] = [
            (
                "noise of 25 steps",
                add_gaussian_noise(&original, 25.0, seed.fork(25)),
            ),
            (
                "sensor noise",
                add_sensor_noise(&self.image.convert::<LinearRgb>(), &sensor, seed.fork(2))
                    .convert(),
            ),
            ("JPEG, quality 30", add_jpeg_damage(&original, &jpeg)),
        ];
        let mut rows = Vec::new();
        for (name, image) in &damaged {
            let noise = estimate_noise(image, self.progress)?;
            let start = Instant::now();
            let whole = Rect::of(image.size());
            let cleaned = clean_with(image, whole, &noise, &CleanParams::default(), self.progress)?;
            let seconds = start.elapsed().as_secs_f64();
            let before = image.convert::<LinearRgba>();
            let (Some(a), Some(b)) = (self.compared(&before), self.compared(&cleaned)) else {
                continue;
            };
            if rows.is_empty() {
                self.report.figures.insert("noisy_psnr_db", a.psnr_db);
                self.report.figures.insert("clean_psnr_db", b.psnr_db);
            }
            rows.push(vec![
                (*name).to_owned(),
                format!("{:.1}", noise.typical()),
                format!("{:.2}", a.psnr_db),
                format!("{:.2}", b.psnr_db),
                format!("{:.3}", a.ssim),
                format!("{:.3}", b.ssim),
                format!("{:.0} ms", 1e3 * seconds),
            ]);
            let figures = [
                self.crop(&self.image, "original"),
                self.crop(&before, *name),
                self.crop(&cleaned, "cleaned"),
            ];
            self.page.figures(&figures);
        }
        let head = [
            "damage",
            "strength found",
            "PSNR dB",
            "cleaned",
            "SSIM",
            "cleaned",
            "time",
        ];
        self.page.table(&head, &rows);
        Ok(())
    }

    /// Posts before a house front and a floor, taken away with and without the perspective.
    fn completion(&mut self, max_side: usize, seed: Seed) -> Result<(), JobError> {
        self.page.section(
            "What is in the way goes",
            "A hole is filled from where the picture looks like its surroundings. On a plane that is anywhere on the plane, once \
             the perspective is taken out; without it, windows have the wrong size and courses the wrong slant.",
        );
        let width = max_side.clamp(96, 420);
        let size = Size::new(width, width * 3 / 4).expect("both sides are positive");
        for (surface, figure) in [
            (Surface::Windows, "front_completed_error_steps"),
            (Surface::Tiles, "floor_completed_error_steps"),
        ] {
            let scene = occluded(surface, size, seed);
            let hole = Mask::from_fn(size, |col, row| scene.post.at(col, row) > 0.0);
            let picture = scene.picture.convert::<Srgb<u8>>();
            let params = CompleteParams::default();
            let filled =
                |planes: &[[DVec2; 4]]| complete(&picture, &hole, planes, &params, self.progress);
            let failed = |cause| JobError::from_completing(Path::new("the built-in scene"), cause);
            let (flat, plane) = self.report.time("complete", || {
                let flat = filled(&[]).map_err(failed)?.image;
                let plane = filled(&[scene.corners_in_image]).map_err(failed)?.image;
                Ok::<_, JobError>((flat, plane))
            })?;
            let truth = scene.background.convert::<Srgb<u8>>();
            let (with, without) = (
                error_steps(&plane, &truth, &hole),
                error_steps(&flat, &truth, &hole),
            );
            self.report.figures.insert(figure, with);
            let figures = [
                Figure::picture(&picture.convert(), "something in the way"),
                Figure::picture(
                    &flat.convert(),
                    format!("filled as it lies: {without:.1} steps off"),
                ),
                Figure::picture(
                    &plane.convert(),
                    format!("in perspective: {with:.1} steps off"),
                ),
            ];
            self.page.figures(&figures);
        }
        Ok(())
    }

    fn speed(&mut self) -> Result<(), JobError> {
        self.page.section(
            "Speed",
            "Wall-clock time on this machine, the median of five runs, colors converted included.",
        );
        let image = self.image.convert::<Srgb<u8>>();
        let megapixels = image.size().pixels() as f64 / 1e6;
        let mut rows = Vec::new();
        for block_px in [4, 8, 16, 32] {
            let params = FitParams {
                block_px,
                ..FitParams::default()
            };
            let mut times = Vec::new();
            for _ in 0..5 {
                let start = Instant::now();
                TwoColorField::fit(&image, &params, self.progress)?;
                times.push(start.elapsed().as_secs_f64());
            }
            times.sort_by(f64::total_cmp);
            let rate = megapixels / times[2];
            if block_px == 8 {
                self.report
                    .figures
                    .insert("fit_megapixels_per_second", rate);
            }
            let how = if block_px <= 16 {
                "exact"
            } else {
                "coarse to fine"
            };
            rows.push(vec![
                format!("fit, N = {block_px}, {how}"),
                format!("{:.1} ms", 1e3 * times[2]),
                format!("{rate:.0} megapixels/s"),
            ]);
        }
        self.page.table(&["operation", "time", "rate"], &rows);
        Ok(())
    }
}

/// The root of the mean squared difference in a hole, in 8-bit steps.
fn error_steps(a: &Image<Srgb<u8>>, b: &Image<Srgb<u8>>, hole: &Mask) -> f64 {
    let covered = hole
        .coverage()
        .pixels()
        .iter()
        .zip(a.pixels().iter().zip(b.pixels()));
    let (mut sum, mut count) = (0.0, 0.0f64);
    for (_, (a, b)) in covered.filter(|(coverage, _)| **coverage > 0.0) {
        for c in 0..3 {
            sum += f64::from(a.0[c].abs_diff(b.0[c])).powi(2);
            count += 1.0;
        }
    }
    (sum / count.max(1.0)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use ravec_media::{Picture, WriteOptions};

    #[test]
    fn the_page_is_whole_and_its_figures_hold() {
        let folder = tempfile::tempdir().unwrap();
        let params = Params {
            max_side: 240,
            ..Params::default()
        };
        let report = run(None, folder.path(), &params, &Progress::none()).unwrap();
        let html = std::fs::read_to_string(folder.path().join("index.html")).unwrap();
        assert!(html.trim_end().ends_with("</html>"));
        assert!(html.matches("<img").count() > 60);
        assert!(report.figures["twocolor_psnr_db"] > report.figures["mosaic_psnr_db"] + 2.0);
        assert!(report.figures["clean_psnr_db"] > report.figures["noisy_psnr_db"] + 3.0);
        assert!(report.figures["simplified_triangles"] <= 1000.0);
        assert!(report.figures["simplified_distance_percent"] < 1.0);
        assert!(report.figures["front_completed_error_steps"] < 25.0);
        assert_eq!(report.figures["offset_proved"], 1.0);
        assert!(report.figures["offset_error_percent"] <= 100.0);
    }

    #[test]
    fn tiny_and_transparent_photos_have_a_page_too() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("in.png");
        for (width, height, alpha) in [(1, 1, 255u8), (40, 3, 0), (30, 50, 128)] {
            let image = Image::new(
                Size::new(width, height).unwrap(),
                ravec::raster::Srgba([90u8, 80, 70, alpha]),
            );
            ravec_media::write(&path, &Picture::from_image(image), &WriteOptions::default())
                .unwrap();
            run(
                Some(&Source::new(&path)),
                folder.path(),
                &Params {
                    max_side: 64,
                    ..Params::default()
                },
                &Progress::none(),
            )
            .unwrap();
            let page = std::fs::read_to_string(folder.path().join("index.html")).unwrap();
            assert!(page.contains("</html>"), "{width} x {height}");
        }
    }

    #[test]
    fn sides_out_of_range_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let params = Params {
            max_side: 10,
            ..Params::default()
        };
        assert_eq!(
            run(None, folder.path(), &params, &Progress::none())
                .unwrap_err()
                .exit_code(),
            2
        );
    }
}

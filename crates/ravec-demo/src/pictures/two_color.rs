//! Two-color pixels themselves: their fidelity, their independence of resolution, and their speed.

use super::Demo;
use crate::page::Figure;
use ravec::raster::{
    Comparison, Image, LinearRgba, PremulLinearRgba, Rect, ResizeFilter, Size, Srgb, resize,
};
use ravec::twocolor::{
    AdaptiveField, AdaptiveParams, BlockField, FitParams, SvgParams, TwoColorField, WindowParams,
    enlarge, render_mosaic, render_to, write_svg,
};
use ravec_jobs::JobError;
use std::time::Instant;

impl Demo<'_> {
    pub fn two_color_pixels(&mut self) -> Result<(), JobError> {
        self.page.section(
            "Two-color pixels",
            "Each block of N x N pixels is replaced by the best of all lines with one color on each side. Edges stay sharp where \
             blocks of one color, a plain mosaic, turn them into stairs: a good start for vector graphics, cleaning and search.",
        );
        let size = self.size();
        let mut rows = Vec::new();
        for block_px in [4, 8, 16] {
            let field = self.fit(block_px)?;
            let lines = render_to(&field, size, self.progress)?;
            let mosaic = render_mosaic(&field, size, self.progress)?;
            rows.push(self.row(&format!("N = {block_px}"), &field, &lines, Some(&mosaic)));
            if block_px == 8 {
                let mut whole = Figure::compared(
                    Figure::picture(&mosaic, "one color"),
                    Figure::picture(&lines, "two colors and a line"),
                    "The picture from blocks of 8 x 8 pixels: with one color each, and with two",
                );
                if let (Some(two), Some(one)) = (self.compared(&lines), self.compared(&mosaic)) {
                    self.report.figures.insert("twocolor_psnr_db", two.psnr_db);
                    self.report.figures.insert("mosaic_psnr_db", one.psnr_db);
                    whole = whole.with_note(format!(
                        "PSNR {:.2} dB with one color, {:.2} dB with two",
                        one.psnr_db, two.psnr_db
                    ));
                }
                let crop = |image, label: &str| self.crop(image, label);
                let figures = [
                    whole,
                    Figure::compared(
                        crop(&mosaic, "one color"),
                        crop(&lines, "two colors and a line"),
                        "A part of it: edges keep their place and direction",
                    ),
                    Figure::compared(
                        crop(&self.image, "input"),
                        crop(&lines, "two colors and a line"),
                        "The same part beside the input: texture goes, shapes stay",
                    ),
                ];
                self.page.figures(&figures);
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
            Figure::picture(
                &adaptive,
                "Blocks of 4 to 32 pixels: small ones only where there is detail",
            ),
            Figure::compared(
                self.crop(&self.image, "input"),
                self.crop(&adaptive, "adaptive blocks"),
                "A part of it beside the input",
            ),
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

    pub fn any_scale(&mut self) -> Result<(), JobError> {
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
            Figure::crop(
                &image,
                Rect::of(image.size()),
                factor,
                "The input, enlarged six times: its pixels become squares",
            ),
            Figure::compared(
                whole(&smooth, "Catmull-Rom"),
                whole(&crisp, "enlarged with lines"),
                "The usual enlargement, and the one that follows edges: for prints from small photos",
            ),
            whole(
                &blocks,
                "Two-color pixels of 4 x 4, drawn at six times the size",
            ),
        ];
        if drawn {
            let text = String::from_utf8_lossy(&svg);
            figures.push(Figure::svg(
                &text,
                [size.width(), size.height()],
                "The same as a vector graphic, sharp at any size",
            ));
        }
        self.page.figures(&figures);
        Ok(())
    }

    pub fn speed(&mut self) -> Result<(), JobError> {
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

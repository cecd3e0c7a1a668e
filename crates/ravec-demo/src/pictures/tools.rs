//! What is done with two-color pixels: the operator, the brush, cleaning.

use super::{Demo, ZOOM};
use crate::error::bug;
use crate::page::Figure;
use ravec::raster::{Image, LinearRgb, LinearRgba, Rect, Srgb};
use ravec::twocolor::brush::{Stroke, StrokeError, Strokes, Tool, replay};
use ravec::twocolor::{CleanParams, Mode, OperatorParams, clean_with, estimate_noise, operate};
use ravec_jobs::JobError;
use ravec_scenes::Seed;
use ravec_scenes::damage::{SensorNoise, add_gaussian_noise, add_sensor_noise};
use ravec_scenes::jpeg::{JpegParams, add_jpeg_damage};
use std::time::Instant;

impl Demo<'_> {
    pub fn operator(&mut self) -> Result<(), JobError> {
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

    pub fn paint(&mut self) -> Result<(), JobError> {
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
            let failed = |cause| match cause {
                StrokeError::Cancelled(_) => JobError::Cancelled,
                StrokeError::Fit(cause) => cause.into(),
                other => bug("a stroke of the brush", &other),
            };
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

    pub fn cleaning(&mut self, seed: Seed) -> Result<(), JobError> {
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
}

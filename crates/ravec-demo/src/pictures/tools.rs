//! Tools that work with two-color pixels: the operator, the brush, cleaning.

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
            "Each pixel takes the color of its side of the line in the window around it. Five ways to use that: for posters and drawings, \
             against noise and blur, and against stairs at edges.",
        );
        let region = self.detail;
        // enough around the part for windows and iterations
        let around = Rect::new(
            region.col.saturating_sub(32),
            region.row.saturating_sub(32),
            region.width + 64,
            region.height + 64,
        );
        let mut figures = Vec::new();
        for (mode, iterations, label, text) in [
            (
                Mode::Abstract,
                3,
                "abstract",
                "Abstract, applied 3 times: flat areas with clear edges, as in a poster",
            ),
            (
                Mode::Smooth,
                1,
                "smooth",
                "Smooth: noise goes, edges stay where they are",
            ),
            (
                Mode::Sharpen,
                1,
                "sharpen",
                "Sharpen: blurred edges become steep, without halos",
            ),
            (
                Mode::Antialias,
                1,
                "antialias",
                "Antialias: stairs at edges become smooth",
            ),
            (
                Mode::Stamp,
                1,
                "stamp",
                "Stamp: light and dark only, for stencils and engraving",
            ),
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
            figures.push(Figure::compared(
                self.crop(&self.image, "input"),
                Figure::crop(&result, inner, ZOOM, label),
                text,
            ));
        }
        self.page.figures(&figures);
        Ok(())
    }

    pub fn paint(&mut self) -> Result<(), JobError> {
        self.page.section(
            "The brush",
            "One dab with each tool, of a brush much wider than the place that it is set on. Paint stops where the color changes on \
             the way from the middle of the brush, so that nothing has to be masked first.",
        );
        let (part, dab) = self.even_place()?;
        let smooth = |mode| Tool::Operator {
            mode,
            iterations: 1,
            noise_sigma: None,
        };
        let mut figures = Vec::new();
        for (tool, name, text) in [
            (
                Tool::Color { rgb: [200, 40, 30] },
                "color",
                "Color: paints, but stops at the edges around",
            ),
            (
                Tool::Recolor { rgb: [40, 90, 200] },
                "recolor",
                "Recolor: another hue, the same light and texture",
            ),
            (Tool::Dodge, "dodge", "Dodge: lighter"),
            (Tool::Burn, "burn", "Burn: darker"),
            (
                Tool::Saturation { amount: 1.5 },
                "saturation",
                "Saturation: stronger colors",
            ),
            (
                smooth(Mode::Abstract),
                "abstract",
                "Abstract: calms the texture",
            ),
            (
                Tool::Clone { offset: [-24, 0] },
                "clone",
                "Clone: copies from 24 pixels to the left",
            ),
            (
                Tool::Mask,
                "mask",
                "Mask: selects the same place, for other operations",
            ),
        ] {
            let mut strokes = Strokes::new(self.size());
            let radius = 0.45 * part.height.max(3) as f64;
            strokes.strokes.push(Stroke::new(tool, vec![dab], radius));
            let failed = |cause| match cause {
                StrokeError::Cancelled(_) => JobError::Cancelled,
                StrokeError::Filter(cause) => cause.into(),
                other => bug("a stroke of the brush", &other),
            };
            let painted = replay(self.image.clone(), &strokes, self.progress).map_err(failed)?;
            let shown = match painted.mask {
                Some(mask) => mask.map(|v| LinearRgba([v, v, v, 1.0])),
                None => painted.image,
            };
            figures.push(Figure::compared(
                Figure::crop(&self.image, part, 2, "input"),
                Figure::crop(&shown, part, 2, name),
                text,
            ));
        }
        self.page.figures(&figures);
        Ok(())
    }

    pub fn cleaning(&mut self, seed: Seed) -> Result<(), JobError> {
        self.page.section(
            "Cleaning",
            "Noise and compression damage are added to the picture and removed again. Cleaning measures their strength by itself, so that \
             nothing needs to be set: for photos taken in poor light and for pictures that were saved too small.",
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
        let mut figures =
            vec![self.crop(&self.image, "The original, which cleaning does not know")];
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
            figures.push(
                Figure::compared(
                    self.crop(&before, "damaged"),
                    self.crop(&cleaned, "cleaned"),
                    format!("{}{}, removed", name[..1].to_uppercase(), &name[1..]),
                )
                .with_note(format!(
                    "PSNR {:.2} dB before, {:.2} dB after; {:.0} ms",
                    a.psnr_db,
                    b.psnr_db,
                    1e3 * seconds
                )),
            );
        }
        self.page.figures(&figures);
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

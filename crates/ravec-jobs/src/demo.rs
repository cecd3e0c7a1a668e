//! `demo`: one page that shows what two-color pixels, planes and meshes are good for, with pictures, timings and measured figures.
//!
//! Everything is worked out while the page is made, from the built-in street or from a photo, and from solids with formulas.

mod completion;
mod mosaic;
mod tools;
mod two_color;

use crate::context::Context;
use crate::error::JobError;
use crate::files;
use crate::gallery::{Figure, Gallery};
use crate::mesh;
use crate::plane;
use crate::report::Report;
use crate::retarget;
use ravec::progress::Progress;
use ravec::raster::{
    AnyImage, Comparison, Image, LinearRgba, PremulLinearRgba, Rect, ResizeFilter, Size, Srgb,
    compare, resize,
};
use ravec::twocolor::{FitParams, TwoColorField};
use ravec_scenes::Seed;
use ravec_scenes::street::street;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Settings of the demonstration.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct Params {
    /// The longest side of the picture that is worked on, 64 to 8192; larger photos are reduced
    ///
    /// Below 640, pictures of meshes are smaller and coarser, too.
    #[cfg_attr(feature = "cli", arg(long, value_name = "PX", default_value_t = Params::default().max_side))]
    pub max_side: usize,
    /// Seed of the built-in street and of the added noise
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
/// `fit_megapixels_per_second`; `snapped_px`, how far a grid that snapped is off;
/// `simplified_triangles` and `simplified_distance_percent` of a torus;
/// `retargeted_disc_aspect`, how much discs are squeezed when the width is halved;
/// `front_completed_error_steps` and `floor_completed_error_steps` of what was filled in perspective, in 8-bit steps;
/// `mosaic_plain_afar_psnr_db` and `mosaic_afar_psnr_db` of mosaics after a blur by half a tile;
/// `offset_triangles`, `offset_error_percent` (of the tolerance) and `offset_proved` of offsets;
/// `boolean_solid` (0 or 1, whether all results of expressions are) and `boolean_kept_percent` of the triangles of
/// a scan from which a box was taken.
///
/// # Errors
/// [`JobError::Parameter`], [`JobError::Read`] for the photo, [`JobError::Write`], [`JobError::Cancelled`].
///
/// # Panics
/// Never: the size of the built-in street follows from a side that was checked.
pub fn run(
    photo: Option<&Path>,
    out: &Path,
    params: &Params,
    progress: &Progress,
) -> Result<Report, JobError> {
    if !(64..=8192).contains(&params.max_side) {
        return Err(JobError::Parameter {
            field: "max_side",
            value: params.max_side.to_string(),
            range: "64 to 8192",
        });
    }
    files::check_folder(out)?;
    let mut report = Report::new("demo", params);
    report.seed = Some(params.seed);
    let (image, origin) = if let Some(source) = photo {
        let picture = files::read(source, &mut report, &Context::new(progress))?;
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
    demo.mosaic(Seed(params.seed))?;
    demo.speed()?;
    let mut page = demo.page;
    let side = params.max_side;
    retarget::show(&mut page, &mut report, Seed(params.seed), side, progress)?;
    plane::show(&mut page, &mut report, Seed(params.seed), side, progress)?;
    let detail = mesh::Detail::of(side);
    mesh::show(&mut page, &mut report, Seed(params.seed), detail, progress)?;
    mesh::offset::show(&mut page, &mut report, detail, progress)?;
    mesh::boolean::show(&mut page, &mut report, Seed(params.seed), detail, progress)?;
    let page = page.finish();
    files::make_folder(out)?;
    files::write_output_text(
        &out.join("index.html"),
        "HTML",
        &page,
        &mut report,
        &Context::new(progress),
    )?;
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
        assert!(
            report.figures["mosaic_afar_psnr_db"]
                > report.figures["mosaic_plain_afar_psnr_db"] + 1.0
        );
        assert_eq!(report.figures["offset_proved"], 1.0);
        assert!(report.figures["offset_error_percent"] <= 100.0);
        assert_eq!(report.figures["boolean_solid"], 1.0);
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

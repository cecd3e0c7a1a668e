//! Sections about one picture: what two-color pixels keep of it, and what they are good for.

mod completion;
mod mosaic;
mod tools;
mod two_color;

use crate::Params;
use crate::page::{Figure, Gallery};
use ravec::progress::Progress;
use ravec::raster::{Comparison, Image, LinearRgba, Rect, Size, compare};
use ravec::twocolor::{FitParams, TwoColorField};
use ravec_jobs::{JobError, Report};
use ravec_scenes::Seed;

/// Side of the part that is shown enlarged, in pixels.
const CROP: [usize; 2] = [96, 72];

/// The factor by which parts are enlarged.
const ZOOM: usize = 4;

/// Puts the sections about one picture on the page; `origin` names it.
///
/// Figures: all that [`run`](crate::run) names, up to those of mosaics.
pub fn show(
    page: &mut Gallery,
    report: &mut Report,
    image: Image<LinearRgba>,
    origin: &str,
    params: &Params,
    progress: &Progress,
) -> Result<(), JobError> {
    let seed = Seed(params.seed);
    let mut demo = Demo {
        image,
        page,
        detail: Rect::default(),
        report,
        progress,
    };
    demo.detail = demo.busiest_part()?;
    demo.page.chapter("Two-color pixels");
    demo.input(origin)?;
    demo.two_color_pixels()?;
    demo.any_scale()?;
    demo.operator()?;
    demo.paint()?;
    demo.cleaning(seed)?;
    demo.speed()?;
    demo.page.chapter("Whole pictures");
    demo.completion(params.max_side, seed)?;
    demo.mosaic(seed)
}

/// The page in the making.
struct Demo<'a> {
    image: Image<LinearRgba>,
    page: &'a mut Gallery,
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

    /// The rectangle in which the contrast of two-color pixels is largest: edges, not noise.
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
            "The next sections work on this picture, {origin} of {width} x {height} pixels. The part on the right, where edges are \
             strongest, is shown enlarged in them."
        );
        self.page.section("The picture", &text);
        let figures = [
            Figure::picture(&self.image, "The picture that everything below starts from"),
            self.crop(&self.image, "A part of it, enlarged four times"),
        ];
        self.page.figures(&figures);
        Ok(self.progress.check()?)
    }
}

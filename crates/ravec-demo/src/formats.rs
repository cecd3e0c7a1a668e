//! The part of the demonstration that is about other formats.

use crate::error::bug;
use crate::page::{Figure, Gallery};
use ravec::progress::Progress;
use ravec::raster::{Image, LinearRgba, Rect, ResizeFilter, Size, Srgb, resize};
use ravec::retarget::{Deformation, Painted, RetargetError, RetargetParams, Retargeter};
use ravec_jobs::retarget::with_grid;
use ravec_jobs::{JobError, Report};
use ravec_scenes::Seed;
use ravec_scenes::portraits::portraits;
use ravec_scenes::shapes::Shape;
use std::time::Instant;

/// The picture is no wider: more shows no more.
const MAX_WIDTH: usize = 600;

/// The formats in hundredths of the width and of the height: a square, a phone, a column, a banner, a wide one, a half.
const FORMATS: [[usize; 2]; 6] = [
    [67, 100],
    [50, 100],
    [40, 120],
    [100, 50],
    [140, 100],
    [75, 75],
];

/// Puts the section about other formats on the page: a drawn scene at six formats, beside scaling, cropping and the removal of
/// seams.
///
/// Figures: `retargeted_disc_aspect`, the mean of how much discs are squeezed at the half width, 1 if not at all.
pub fn show(
    page: &mut Gallery,
    report: &mut Report,
    seed: Seed,
    max_side: usize,
    progress: &Progress,
) -> Result<(), JobError> {
    let width = max_side.min(MAX_WIDTH);
    let Ok(size) = Size::new(width, width * 2 / 3) else {
        return Ok(());
    };
    let (scene, truth) = portraits(size, seed.fork(4));
    let image = scene.convert::<Srgb<u8>>();
    let failed = |cause: RetargetError| match cause {
        RetargetError::Cancelled(_) => JobError::Cancelled,
        other => bug("the format of a scene", &other),
    };
    let start = Instant::now();
    let params = RetargetParams::default();
    let retargeter =
        Retargeter::new(&image, Painted::default(), &params, progress).map_err(failed)?;
    let analyzed = start.elapsed();
    page.section(
        "Many aspect ratios",
        &format!(
            "The same picture as a square, for a phone, as a column, a banner, wide, and small. Objects keep their shape, {} \
             straight runs stay straight, and the ground gives way. The analysis took {:.0} ms, once for all sizes. Beside each: \
             plain scaling, a crop from the middle, and the removal or doubling of seams.",
            retargeter.summary().straight_runs,
            1e3 * analyzed.as_secs_f64(),
        ),
    );
    page.figures(&[Figure::picture(
        &image.convert(),
        "The picture: figures on rough ground, drawn by formulas",
    )]);
    let mut rows = Vec::new();
    for [across, down] in FORMATS {
        let side = |length: usize, percent: usize| (length * percent / 100).max(1);
        let Ok(new) = Size::new(side(size.width(), across), side(size.height(), down)) else {
            continue;
        };
        let start = Instant::now();
        let deformation = retargeter.solve(new).map_err(failed)?;
        let solved = start.elapsed();
        let warped = deformation.warp(&image, progress).map_err(failed)?;
        let light: Image<LinearRgba> = warped.convert();
        let share = format!("{across} % of the width, {down} % of the height");
        let figures = [
            Figure::compared(
                Figure::picture(&light, "retargeted"),
                Figure::picture(&with_grid(&deformation, light.clone()), "its grid"),
                "Retargeted: objects keep their shape. The grid shows where the ground gives way",
            )
            .with_note(share),
            Figure::picture(
                &resize(&image, new, ResizeFilter::Lanczos3).convert(),
                "Scaled: everything is squeezed",
            ),
            Figure::picture(
                &cropped(&image, new).convert(),
                "Cropped: what stood at the borders is gone",
            ),
            Figure::picture(
                &seams(&image, new, progress)?.convert(),
                "Seams removed or doubled: straight lines break",
            ),
        ];
        page.figures(&figures);
        let mean = mean_disc_aspect(&truth.shapes, &deformation);
        if [across, down] == [50, 100] {
            report.figures.insert("retargeted_disc_aspect", mean);
        }
        let plain = (across as f64 / down as f64).max(down as f64 / across as f64);
        let found = deformation.summary();
        rows.push(vec![
            format!("{} x {}", new.width(), new.height()),
            format!("{mean:.3}"),
            format!("{plain:.2}"),
            found.bounded_edges.to_string(),
            format!("{:.1}", 1e3 * solved.as_secs_f64()),
        ]);
    }
    page.table(
        &[
            "format",
            "heads squeezed",
            "if scaled",
            "edges kept from folding",
            "solved in ms",
        ],
        &rows,
    );
    Ok(())
}

/// Mean ratio of the longer to the shorter diameter of the discs, as they are deformed.
fn mean_disc_aspect(shapes: &[Shape], deformation: &Deformation) -> f64 {
    let discs = shapes.iter().filter_map(|shape| match *shape {
        Shape::Disc {
            center, radius_px, ..
        } => {
            let at = |x: f64, y: f64| {
                deformation.target_from_source(center + radius_px * glam::dvec2(x, y))
            };
            let across = at(-1.0, 0.0).distance(at(1.0, 0.0));
            let down = at(0.0, -1.0).distance(at(0.0, 1.0));
            Some((across / down).max(down / across))
        }
        _ => None,
    });
    let aspects: Vec<f64> = discs.collect();
    aspects.iter().sum::<f64>() / aspects.len().max(1) as f64
}

/// The middle of the picture at the size that fills the format.
fn cropped(image: &Image<Srgb<u8>>, new: Size) -> Image<Srgb<u8>> {
    let factor = (new.width() as f64 / image.width() as f64)
        .max(new.height() as f64 / image.height() as f64);
    let part = [new.width(), new.height()].map(|side| side as f64 / factor);
    let rect = Rect::new(
        ((image.width() as f64 - part[0]) / 2.0) as usize,
        ((image.height() as f64 - part[1]) / 2.0) as usize,
        part[0].round() as usize,
        part[1].round() as usize,
    );
    let middle = rect
        .clipped(image.size())
        .size()
        .and_then(|size| image.crop(rect.col, rect.row, size).ok());
    middle.map_or_else(
        || image.clone(),
        |middle| resize(&middle, new, ResizeFilter::Lanczos3),
    )
}

/// The removal of seams, for comparison: the paths from top to bottom along which neighbors differ least go one by one, or are
/// doubled; then the same with columns for rows.
///
/// Source: S. Avidan and A. Shamir, "Seam carving for content-aware image resizing", 2007.
fn seams(
    image: &Image<Srgb<u8>>,
    new: Size,
    progress: &Progress,
) -> Result<Image<Srgb<u8>>, JobError> {
    let narrowed = seam_columns(image, new.width(), progress)?;
    Ok(transposed(&seam_columns(
        &transposed(&narrowed),
        new.height(),
        progress,
    )?))
}

fn transposed(image: &Image<Srgb<u8>>) -> Image<Srgb<u8>> {
    Image::from_fn(image.size().transposed(), |col, row| image[(row, col)])
}

fn seam_columns(
    image: &Image<Srgb<u8>>,
    width: usize,
    progress: &Progress,
) -> Result<Image<Srgb<u8>>, JobError> {
    // each pixel with the column that it came from
    let mut rows: Vec<Vec<(Srgb<u8>, usize)>> = image
        .rows()
        .map(|row| row.iter().copied().zip(0..).collect())
        .collect();
    let seams = width.abs_diff(image.width()).min(image.width() - 1);
    for _ in 0..seams {
        progress.check()?;
        let columns = rows[0].len();
        let value = |row: usize, col: usize| {
            let [r, g, b] = rows[row][col].0.0.map(f32::from);
            r + g + b
        };
        let energy = |row: usize, col: usize| {
            let (left, right) = (col.saturating_sub(1), (col + 1).min(columns - 1));
            let (up, down) = (row.saturating_sub(1), (row + 1).min(rows.len() - 1));
            (value(row, right) - value(row, left)).abs() + (value(down, col) - value(up, col)).abs()
        };
        let mut cost: Vec<Vec<f32>> = vec![(0..columns).map(|col| energy(0, col)).collect()];
        for row in 1..rows.len() {
            let above = &cost[row - 1];
            let next = (0..columns)
                .map(|col| {
                    let around = &above[col.saturating_sub(1)..(col + 2).min(columns)];
                    energy(row, col) + around.iter().copied().fold(f32::INFINITY, f32::min)
                })
                .collect();
            cost.push(next);
        }
        let mut at = 0;
        for (row, cost) in cost.iter().enumerate().rev() {
            let around = if row + 1 == rows.len() {
                0..columns
            } else {
                at.max(1) - 1..(at + 2).min(columns)
            };
            at = around
                .min_by(|&a, &b| cost[a].total_cmp(&cost[b]))
                .unwrap_or(at);
            rows[row].remove(at);
        }
    }
    let kept = |row: usize, col: usize| {
        rows[row]
            .binary_search_by_key(&col, |pixel| pixel.1)
            .is_ok()
    };
    let pixels = (0..image.height()).flat_map(|row| {
        (0..image.width()).flat_map(move |col| {
            // what the seams took is left out, or there twice
            let times = match (kept(row, col), width < image.width()) {
                (true, _) => 1,
                (false, true) => 0,
                (false, false) => 2,
            };
            std::iter::repeat_n(image[(col, row)], times)
        })
    });
    let found = Image::from_vec(width, pixels.collect());
    Ok(found.unwrap_or_else(|_| image.clone()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seams_go_where_nothing_is_and_make_the_size() {
        let image = Image::from_fn(Size::new(40, 20).unwrap(), |col, row| {
            Srgb(if (12..20).contains(&col) && (6..14).contains(&row) {
                [200u8, 0, 0]
            } else {
                [90, 120, 90]
            })
        });
        for (width, height) in [(30, 20), (50, 20), (40, 15), (33, 26)] {
            let new = Size::new(width, height).unwrap();
            let found = seams(&image, new, &Progress::none()).unwrap();
            assert_eq!(found.size(), new);
            let red = found
                .pixels()
                .iter()
                .filter(|pixel| pixel.0[0] == 200)
                .count();
            assert_eq!(red, 64, "{new}");
            assert_eq!(cropped(&image, new).size(), new);
        }
    }
}

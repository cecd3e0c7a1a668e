//! The part of the demonstration that is about planes: found in a picture, snapped to, and seen from straight on.

use crate::page::{Figure, Gallery};
use glam::{DVec2, dvec2};
use ravec::planar::{
    Beyond, Homography, Known, QuadGrid, SnapError, SnapParams, encoded_luminance, proportions,
    propose_planes, snap, straight_view, warp,
};
use ravec::progress::Progress;
use ravec::raster::{
    Image, LinearRgb, LinearRgba, PremulLinearRgba, Pyramid, Reduction, Size, Srgb,
};
use ravec::twocolor::line_segments;
use ravec_jobs::plane::overlay::{AFTER, BEFORE, draw_grid, line_width};
use ravec_jobs::plane::planes::draw;
use ravec_jobs::{JobError, Report};
use ravec_scenes::Seed;
use ravec_scenes::building::{BuildingTruth, building};
use ravec_scenes::damage::add_gaussian_noise;

/// Pictures of planes are no wider: more shows no more.
const MAX_WIDTH: usize = 960;

/// Noise of the picture, in steps of 255.
const NOISE: f64 = 4.0;

/// The error of the corners of the rough grid, as a share of its diagonal. With the reach it stays short of the ledges,
/// whose edges are longer than those of windows.
const OFF: f64 = 0.02;

/// Puts the sections about planes on the page, on a drawn building with noise.
///
/// Figures: `snapped_px`, the root mean square distance of the corners of a snapped grid from where they belong.
pub fn show(
    page: &mut Gallery,
    report: &mut Report,
    seed: Seed,
    max_side: usize,
    progress: &Progress,
) -> Result<(), JobError> {
    let width = max_side.min(MAX_WIDTH);
    let Ok(size) = Size::new(width, width * 3 / 4) else {
        return Ok(());
    };
    let (image, truth) = building(size, 0.81, seed);
    let image = add_gaussian_noise(&image.convert::<Srgb<u8>>(), NOISE, seed.fork(9));
    proposals(page, &image, &truth, progress)?;
    let rough = rough_grid(&truth, seed);
    let Ok((belongs, rough)) = rough else {
        return Ok(());
    };
    let snapped = snapping(page, report, &image, (&belongs, &rough), progress)?;
    straight(page, &image, &truth, &snapped, progress)
}

fn proposals(
    page: &mut Gallery,
    image: &Image<Srgb<u8>>,
    truth: &BuildingTruth,
    progress: &Progress,
) -> Result<(), JobError> {
    let edges = line_segments(&image.convert::<PremulLinearRgba>(), progress)?;
    let extent = dvec2(image.width() as f64, image.height() as f64);
    let found = propose_planes(&edges, extent, None, progress)?;
    let focal = found.focal_px.map_or_else(
        || "cannot be told here".to_owned(),
        |focal| {
            format!(
                "comes out as {focal:.0} pixels (it is {:.0})",
                truth.focal_px
            )
        },
    );
    page.section(
        "Planes in a picture",
        &format!(
            "Walls and floors are found without any help: {} straight edges, from lines of two-color pixels, meet in {} vanishing \
             points, and where two directions cross there is a plane. {} are proposed. From right angles alone the focal length \
             {focal}.",
            edges.len(),
            found.vanishing_points.len(),
            found.planes.len(),
        ),
    );
    let mut drawn: Image<LinearRgba> = image.convert();
    draw(&mut drawn, &edges, &found);
    page.figures(&[
        Figure::compared(
            Figure::picture(&image.convert(), "picture"),
            Figure::picture(&drawn, "edges and planes"),
            "A building drawn by formulas, with noise. Edges of one color lead to the same vanishing point; grids are planes",
        ),
    ]);
    Ok(())
}

/// A grid on the windows of the right wall, and the same with its corners moved: lines lie where panes begin on the left and
/// below, and frames end, which are the strongest edges.
fn rough_grid(
    truth: &BuildingTruth,
    seed: Seed,
) -> Result<(QuadGrid, QuadGrid), ravec::planar::HomographyError> {
    // lower left, lower right, upper right, upper left; panes begin at 0.29 of a bay and 0.295 of a floor
    let wall = truth.walls_in_image[0];
    let image_from_wall = Homography::from_unit_square(wall)?;
    let place = |bay: f64, floor: f64| {
        image_from_wall.apply(dvec2((bay + 0.29) / 5.0, (floor + 0.295) / 4.0))
    };
    let corners = [
        place(1.0, 3.0),
        place(4.0, 3.0),
        place(4.0, 1.0),
        place(1.0, 1.0),
    ];
    let belongs = QuadGrid::new(corners, 3, 2)?;
    let off = OFF * belongs.diagonal_px();
    let mut moved = corners;
    for (k, corner) in moved.iter_mut().enumerate() {
        *corner +=
            off * DVec2::from_angle(seed.between(k as i64, 0, 77, 0.0, std::f64::consts::TAU));
    }
    Ok((belongs, QuadGrid::new(moved, 3, 2)?))
}

fn snapping(
    page: &mut Gallery,
    report: &mut Report,
    image: &Image<Srgb<u8>>,
    (belongs, rough): (&QuadGrid, &QuadGrid),
    progress: &Progress,
) -> Result<QuadGrid, JobError> {
    let picture = Pyramid::new(encoded_luminance(image), Reduction::Area);
    let snapped = match snap(&picture, rough, &SnapParams::default(), progress) {
        Ok(snapped) => snapped.grid,
        Err(SnapError::Cancelled) => return Err(JobError::Cancelled),
        // a picture of a few pixels has no edges to snap to
        Err(_) => rough.clone(),
    };
    let off = |grid: &QuadGrid| {
        let corners = grid.corners().into_iter().zip(belongs.corners());
        (corners.map(|(a, b)| a.distance_squared(b)).sum::<f64>() / 4.0).sqrt()
    };
    report.figures.insert("snapped_px", off(&snapped));
    page.section(
        "A grid that snaps",
        &format!(
            "Four corners are set roughly on windows, as by hand. Snapping moves the lines of the grid to the edges nearby, so that \
             a few clicks measure a wall. The corners are {:.1} pixels off before and {:.2} pixels after (root mean square).",
            off(rough),
            off(&snapped)
        ),
    );
    let drawn = |grid: &QuadGrid, color| {
        let mut drawn: Image<LinearRgba> = image.convert();
        let width = line_width(drawn.size());
        draw_grid(&mut drawn, grid, width, color);
        drawn
    };
    page.figures(&[Figure::compared(
        Figure::picture(&drawn(rough, BEFORE), "set by hand"),
        Figure::picture(&drawn(&snapped, AFTER), "snapped"),
        "A grid on three by two windows of the right wall",
    )]);
    Ok(snapped)
}

fn straight(
    page: &mut Gallery,
    image: &Image<Srgb<u8>>,
    truth: &BuildingTruth,
    grid: &QuadGrid,
    progress: &Progress,
) -> Result<(), JobError> {
    // bays of 2.4 by 3 meters
    let ratio = 3.0 * 2.4 / (2.0 * 3.0);
    let extent = dvec2(image.width() as f64, image.height() as f64);
    let ways = [
        ("the focal length", Known::Focal(truth.focal_px)),
        ("right angles", Known::RightAngles),
    ];
    let rows: Vec<Vec<String>> = ways
        .iter()
        .map(|(name, known)| {
            let found = proportions(grid.corners(), 0.5 * extent, *known);
            let cells = found.map_or_else(
                |error| [error.to_string(), String::new()],
                |found| {
                    [
                        format!("{:.3}", found.ratio),
                        format!("{:.1} %", 100.0 * found.ratio_sigma_rel),
                    ]
                },
            );
            [vec![(*name).to_owned()], cells.to_vec()].concat()
        })
        .collect();
    let Ok(view) = straight_view(grid.corners(), ratio, 1.2, 0.35, extent) else {
        return Ok(());
    };
    let Ok(size) = Size::new(view.size.x as usize, view.size.y as usize) else {
        return Ok(());
    };
    let source: Image<PremulLinearRgba> = image.convert();
    let beyond = Beyond::Pixel(PremulLinearRgba([0.0; 4]));
    let straight = warp(&source, &view.image_from_straight, size, beyond, progress)?;
    page.section(
        "Seen from straight on",
        &format!(
            "The wall as if the camera stood in front of it: for measuring, for textures, and for editing without perspective. Each \
             pixel is filtered once, along the ellipse that it sees. The true ratio of width to height is {ratio:.3}."
        ),
    );
    page.table(
        &[
            "proportions from",
            "width / height",
            "deviation if corners are a pixel off",
        ],
        &rows,
    );
    let shown: Image<LinearRgb> = straight.convert();
    page.figures(&[Figure::picture(
        &shown.convert(),
        "The right wall from straight on: right angles are right, and windows equally large",
    )]);
    Ok(())
}

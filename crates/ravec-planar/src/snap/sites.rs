//! Places along the lines of a grid, and the picture across the lines there.

use crate::homography::Homography;
use crate::quad_grid::QuadGrid;
use glam::{DVec2, dvec2};
use ravec_raster::{Plane, Size};

/// Lines between columns, or lines between rows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Family {
    Columns,
    Rows,
}

/// A place on a line.
#[derive(Debug, Clone, Copy)]
pub(super) struct Site {
    pub line: usize,
    /// How far along the line, 0 to 1.
    pub along: f64,
    pub at: DVec2,
    /// Across the line, of length 1.
    pub normal: DVec2,
    /// By how much the line moves across itself when a corner's x or y grows by 1: x₀, y₀, x₁, …
    pub influence: [f64; 8],
}

/// Places on lines that lie in the picture.
pub(super) struct Sites {
    pub sites: Vec<Site>,
    pub lines: usize,
}

/// Distance of sites along a line in pixels. Nearer ones share most of their pixels.
const SPACING_PX: f64 = 2.0;

/// Sites on a line at most: longer lines are known well enough.
const MAX_SITES: f64 = 400.0;

impl Sites {
    /// The sites of one family or of both.
    pub(super) fn new(grid: &QuadGrid, family: Option<Family>, size: Size) -> Self {
        let unit = dvec2(f64::from(grid.columns()), f64::from(grid.rows()));
        let maps = Moved::new(grid);
        let mut all = Self {
            sites: Vec::new(),
            lines: 0,
        };
        let extent = dvec2(size.width() as f64, size.height() as f64);
        for (this, count) in [
            (Family::Columns, grid.columns()),
            (Family::Rows, grid.rows()),
        ] {
            if family.is_some_and(|family| family != this) {
                continue;
            }
            for index in 0..=count {
                let ends = match this {
                    Family::Columns => grid.column_line(index),
                    Family::Rows => grid.row_line(index),
                };
                let length = ends[0].distance(ends[1]);
                let normal = (ends[1] - ends[0]).normalize_or_zero().perp();
                let line = all.lines;
                all.lines += 1;
                let sites = (length / SPACING_PX).clamp(1.0, MAX_SITES).ceil() as usize;
                for k in 0..sites {
                    // evenly in the picture; corners are left out, where lines meet
                    let share = (k as f64 + 0.5) / sites as f64;
                    let at = ends[0].lerp(ends[1], share);
                    if at.cmplt(DVec2::ZERO).any() || at.cmpgt(extent).any() {
                        continue;
                    }
                    let place = maps.place(at) / unit;
                    all.sites.push(Site {
                        line,
                        along: share,
                        at,
                        normal,
                        influence: maps.influence(place * unit, at, normal),
                    });
                }
            }
        }
        all
    }
}

/// The grid's map, and those with each coordinate of a corner a little larger.
struct Moved {
    grid_from_image: Homography,
    moved: [Option<Homography>; 8],
}

/// The step of the differences, in pixels: the map is smooth, so any step between rounding and curvature will do.
const STEP_PX: f64 = 1e-3;

impl Moved {
    fn new(grid: &QuadGrid) -> Self {
        let moved = std::array::from_fn(|k| {
            let axis = if k % 2 == 0 { DVec2::X } else { DVec2::Y };
            let corner = grid.corners()[k / 2] + axis * STEP_PX;
            grid.with_corner(k / 2, corner)
                .ok()
                .map(|grid| grid.image_from_grid())
        });
        Self {
            grid_from_image: grid.image_from_grid().inverse(),
            moved,
        }
    }

    fn place(&self, at: DVec2) -> DVec2 {
        self.grid_from_image.apply(at)
    }

    fn influence(&self, in_grid: DVec2, at: DVec2, normal: DVec2) -> [f64; 8] {
        self.moved
            .map(|moved| moved.map_or(0.0, |map| (map.apply(in_grid) - at).dot(normal) / STEP_PX))
    }
}

/// The slope of the picture across a line.
pub(super) struct Profile {
    /// Slopes at distances −reach, …, reach in whole pixels; in units of the picture a pixel.
    pub slopes: Vec<f32>,
    brightness: Vec<f32>,
}

/// Weights of differences over one, two and three pixels to each side: the derivative of a Gaussian of deviation 1 pixel,
/// scaled so that a ramp has its slope.
const DERIVATIVE: [f32; 3] = [0.242_036, 0.107_981, 0.013_295];

impl Profile {
    pub(super) fn new(reach: usize) -> Self {
        Self {
            slopes: vec![0.0; 2 * reach + 1],
            brightness: vec![0.0; 2 * reach + 1 + 2 * DERIVATIVE.len()],
        }
    }

    /// Reads the picture across a line at a place. Beyond the picture its border goes on, without slopes.
    pub(super) fn read(&mut self, plane: &Plane, at: DVec2, normal: DVec2) {
        let half = (self.brightness.len() / 2) as f64;
        for (k, value) in self.brightness.iter_mut().enumerate() {
            *value = plane.bilinear(at + normal * (k as f64 - half));
        }
        let reach = DERIVATIVE.len();
        for (k, slope) in self.slopes.iter_mut().enumerate() {
            let center = k + reach;
            *slope = (1..=reach)
                .map(|m| {
                    DERIVATIVE[m - 1] * (self.brightness[center + m] - self.brightness[center - m])
                })
                .sum();
        }
    }
}

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

impl Family {
    pub(super) fn other(self) -> Self {
        match self {
            Self::Columns => Self::Rows,
            Self::Rows => Self::Columns,
        }
    }
}

/// A place on a line.
#[derive(Debug, Clone, Copy)]
pub(super) struct Site {
    pub line: usize,
    /// Position along the line, 0 to 1.
    pub along: f64,
    pub at: DVec2,
    /// Across the line, of length 1.
    pub normal: DVec2,
    /// Pixels that the line moves along the normal from one column or row to the next.
    pub cell_px: f64,
    pub family: Family,
}

/// Places on lines that lie in the picture.
pub(super) struct Sites {
    pub sites: Vec<Site>,
    /// Motion of each line across itself at both ends when a corner's x or y grows by 1: x₀, y₀, x₁, … Between the
    /// ends it changes evenly, as a line moves to a line.
    pub ends: Vec<[[f64; 8]; 2]>,
}

/// Distance of sites along a line in pixels. Nearer ones share most of their pixels.
const SPACING_PX: f64 = 2.0;

/// Sites on a line at most: longer lines are known well enough.
const MAX_SITES: f64 = 320.0;

/// Places across lines that are examined, for each pixel of the picture and beside these: a search with the largest reach
/// and most lines has some 12 a pixel in small pictures, and few in large ones.
const MAX_PLACES_PER_PIXEL: usize = 16;
const ALWAYS_PLACES: usize = 1 << 24;

impl Sites {
    /// The sites of one family or of both.
    pub(super) fn new(grid: &QuadGrid, family: Option<Family>, size: Size) -> Self {
        let maps = Moved::new(grid);
        let mut all = Self {
            sites: Vec::new(),
            ends: Vec::new(),
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
                let line = all.ends.len();
                all.ends
                    .push(ends.map(|at| maps.influence(maps.place(at), at, normal)));
                let cells_px = ends.map(|at| maps.step(at, this).dot(normal));
                let sites = (length / SPACING_PX).clamp(1.0, MAX_SITES).ceil() as usize;
                for k in 0..sites {
                    // evenly in the picture; corners are left out, where lines meet
                    let share = (k as f64 + 0.5) / sites as f64;
                    let at = ends[0].lerp(ends[1], share);
                    if at.cmplt(DVec2::ZERO).any() || at.cmpgt(extent).any() {
                        continue;
                    }
                    all.sites.push(Site {
                        line,
                        along: share,
                        at,
                        normal,
                        cell_px: cells_px[0] + share * (cells_px[1] - cells_px[0]),
                        family: this,
                    });
                }
            }
        }
        all
    }

    /// The part of a reach that is useful in a picture: beyond the picture there are no edges, so no line need be
    /// sought farther away than the picture is wide across it; and the area that is inspected stays in proportion to
    /// the picture.
    pub(super) fn reach_within(&self, size: Size, reach_px: f64) -> f64 {
        let extent = dvec2(size.width() as f64, size.height() as f64);
        let across = self.sites.iter().map(|site| site.normal.abs().dot(extent));
        let places = MAX_PLACES_PER_PIXEL * size.pixels() + ALWAYS_PLACES;
        let affordable = places as f64 / (2 * self.sites.len().max(1)) as f64;
        reach_px.min(across.fold(0.0, f64::max)).min(affordable)
    }

    /// Motion of the line across itself at a site when a corner's x or y grows by 1: x₀, y₀, x₁, …
    pub(super) fn influence(&self, site: &Site) -> [f64; 8] {
        let [start, end] = &self.ends[site.line];
        std::array::from_fn(|k| start[k] + site.along * (end[k] - start[k]))
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

    /// Displacement of a place in the picture for a step of one column or row.
    fn step(&self, at: DVec2, family: Family) -> DVec2 {
        let grid_from_here = self.grid_from_image.jacobian(at);
        let here_from_grid = grid_from_here.inverse();
        match family {
            Family::Columns => here_from_grid.x_axis,
            Family::Rows => here_from_grid.y_axis,
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

/// The picture across a line, and its slope.
pub(super) struct Profile {
    /// Slopes at distances −reach, …, reach in whole pixels; in units of the picture a pixel.
    pub slopes: Vec<f32>,
    brightness: Vec<f32>,
    /// Weights of differences over 1, 2, … pixels to each side.
    derivative: Vec<f32>,
}

impl Profile {
    /// For slopes up to `reach` pixels away, of the picture blurred by `sigma_px` across the line.
    pub(super) fn new(reach: usize, sigma_px: f64) -> Self {
        let taps = (3.0 * sigma_px).ceil() as usize;
        let raw = |m: usize| m as f64 * (-0.5 * (m as f64 / sigma_px).powi(2)).exp();
        // a ramp has its slope: Σ w · 2 m = 1
        let sum: f64 = (1..=taps).map(|m| raw(m) * 2.0 * m as f64).sum();
        Self {
            slopes: vec![0.0; 2 * reach + 1],
            brightness: vec![0.0; 2 * (reach + taps) + 1],
            derivative: (1..=taps).map(|m| (raw(m) / sum) as f32).collect(),
        }
    }

    /// Reads the picture across a line at a place. Beyond the picture its border goes on, without slopes.
    pub(super) fn read(&mut self, plane: &Plane, at: DVec2, normal: DVec2) {
        let half = (self.brightness.len() / 2) as f64;
        let extent = dvec2(plane.width() as f64, plane.height() as f64);
        let inside = |end: DVec2| {
            end.cmpge(DVec2::splat(0.5)).all() && end.cmplt(extent - DVec2::splat(0.5)).all()
        };
        if inside(at - normal * half) && inside(at + normal * half) {
            for (k, value) in self.brightness.iter_mut().enumerate() {
                *value = between_pixels(plane, at + normal * (k as f64 - half));
            }
        } else {
            for (k, value) in self.brightness.iter_mut().enumerate() {
                *value = plane.bilinear(at + normal * (k as f64 - half));
            }
        }
        let taps = self.derivative.len();
        self.slopes.fill(0.0);
        for (m, weight) in self.derivative.iter().enumerate() {
            let before = &self.brightness[taps - 1 - m..];
            let after = &self.brightness[taps + 1 + m..];
            for (slope, (after, before)) in self.slopes.iter_mut().zip(after.iter().zip(before)) {
                *slope += weight * (after - before);
            }
        }
    }
}

/// As `Plane::bilinear`, bit for bit, half a pixel or more from the border: there a cast rounds down as well as a floor,
/// which is a call on machines of the base level.
#[inline]
fn between_pixels(plane: &Plane, at: DVec2) -> f32 {
    let (x, y) = (at.x - 0.5, at.y - 0.5);
    let (col, row) = (x as u32, y as u32);
    let (tx, ty) = (x - f64::from(col), y - f64::from(row));
    let (wx, wy) = ([1.0 - tx, tx], [1.0 - ty, ty]);
    let line = |row: u32| {
        let pixels = &plane.row(row as usize)[col as usize..][..2];
        wx[0] as f32 * pixels[0] + wx[1] as f32 * pixels[1]
    };
    wy[0] as f32 * line(row) + wy[1] as f32 * line(row + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_reach_ends_with_the_picture_and_ordinary_ones_stay_as_they_are() {
        let sites = |corners: [(f64, f64); 4], family, size| {
            let grid = QuadGrid::new(corners.map(DVec2::from), 40, 40).unwrap();
            Sites::new(&grid, Some(family), size)
        };
        let (rows, columns) = (Family::Rows, Family::Columns);
        let whole = |w: f64, h: f64| [(0.0, 0.0), (w, 0.0), (w, h), (0.0, h)];
        for (width, height) in [(2_000_000, 1), (65_535, 1), (65_535, 7)] {
            let size = Size::new(width, height).unwrap();
            let (w, h) = (width as f64, height as f64);
            let (far, quad) = (0.2 * w, whole(w, h));
            assert!(sites(quad, rows, size).reach_within(size, far) <= h + 1e-6);
            assert_eq!(sites(quad, columns, size).reach_within(size, far), far);
            // what is far outside costs no more
            let outside = [(-1e9, -1e9), (1e9, -1e9), (1e9, 1e9), (-1e9, 1e9)];
            let there = sites(outside, columns, size);
            let reach = there.reach_within(size, 4e8);
            let places = 2.0 * reach * there.sites.len() as f64;
            assert!(
                places <= (16 * size.pixels() + (1 << 24)) as f64,
                "{places}"
            );
        }
        for (width, height) in [(4000, 3000), (60, 40), (300, 1200)] {
            let size = Size::new(width, height).unwrap();
            let (w, h) = (width as f64, height as f64);
            let far = 0.2 * w.hypot(h);
            for family in [rows, columns] {
                assert_eq!(
                    sites(whole(w, h), family, size).reach_within(size, far),
                    far
                );
            }
        }
    }

    #[test]
    fn profiles_read_as_single_places_do() {
        let size = Size::new(64, 48).unwrap();
        let plane = Plane::from_fn(size, |col, row| ((col * 37 + row * 61) % 29) as f32 / 29.0);
        for (at, angle) in [
            (dvec2(30.2, 22.9), 0.3),
            (dvec2(8.5, 24.0), 0.0),
            (dvec2(55.5, 20.25), 3.0),
            (dvec2(31.0, 39.5), 1.57),
            (dvec2(2.0, 3.0), 2.0),
        ] {
            let normal = DVec2::from_angle(angle);
            let mut profile = Profile::new(5, 1.0);
            profile.read(&plane, at, normal);
            let half = (profile.brightness.len() / 2) as f64;
            for (k, value) in profile.brightness.iter().enumerate() {
                let place = at + normal * (k as f64 - half);
                assert_eq!(*value, plane.bilinear(place), "{place}");
            }
        }
    }
}

//! Strokes carried from the frame in which they are drawn through the shot.
//!
//! A background stroke lies on the plane and follows its track. A foreground stroke follows what lies under it: from frame to frame
//! its surroundings are matched by a translation, coarse to fine, near where the last motion predicts them. In other frames than its
//! own, a stroke marks only pixels of the color that lies under it at that place in its own frame, or beside it, so that it ends where
//! its object ends.
//!
//! Cost: for each foreground stroke and frame, about 60 differences a pixel of the stroke's surroundings, most of them at a quarter
//! of the resolution.

use crate::Colors;
use glam::{DVec2, dvec2};
use ravec_planar::Homography;
use ravec_raster::{Image, Mask, Plane, Pyramid, Rect, Reduction, Size, Srgb};
use std::collections::BTreeMap;

/// Largest difference of a channel from a color under the stroke, in steps of 8 bits.
const SAME_COLOR: u8 = 10;
/// Pixels around a place in which a foreground stroke looks for its color: what lies under it changes its shape.
const REACH_PX: usize = 2;
/// Share of a stroke's pixels that must keep their colors, or it is lost.
const MIN_KEPT: f64 = 0.3;
/// Pixels around a stroke that are matched along with it, and their weight.
const RING_PX: usize = 8;
const RING_WEIGHT: f32 = 0.25;
/// Levels of the matching, each of half the size of the one before.
const LEVELS: usize = 3;
/// Radius of the search at the coarsest level in pixels of that level: 32 pixels of the frame.
const SEARCH: isize = 8;
/// Longest side of what is matched, in pixels of the finest level: larger strokes are matched at a lower resolution.
const MAX_SIDE: usize = 96;
/// Mean squared difference that a deviation of one pixel from the predicted motion costs, so that places without texture follow the
/// motion so far.
const DEVIATION_COST: f32 = 2e-7;

/// A stroke, and where it is in the frames that it was carried to.
#[derive(Debug, Clone)]
pub struct CarriedStroke {
    frame: u64,
    is_foreground: bool,
    /// Pixels of the stroke in its own frame, row by row.
    cells: Vec<(usize, usize)>,
    /// Colors of the frame in the bounds of the stroke.
    under: Image<Srgb<u8>>,
    bounds: Rect,
    size: Size,
    /// Map to its own frame.
    own_from_reference: Homography,
    /// Motion of what lies under a foreground stroke, in whole pixels from its own frame.
    shifts: BTreeMap<u64, (isize, isize)>,
}

impl CarriedStroke {
    /// A stroke over some pixels of frame `frame`, column and row, which shows `colors`; `None` for a stroke without pixels. Pixels
    /// beyond the frame are left out.
    pub fn new(
        frame: u64,
        mut cells: Vec<(usize, usize)>,
        is_foreground: bool,
        colors: &Colors,
        frame_from_reference: &Homography,
    ) -> Option<Self> {
        let size = colors.size();
        cells.retain(|&(col, row)| col < size.width() && row < size.height());
        cells.sort_unstable_by_key(|&(col, row)| (row, col));
        cells.dedup();
        if cells.is_empty() {
            return None;
        }
        let cols = cells.iter().map(|cell| cell.0);
        let (left, right) = (cols.clone().min()?, cols.max()? + 1);
        let (top, bottom) = (cells[0].1, cells[cells.len() - 1].1 + 1);
        let bounds = Rect::new(left, top, right - left, bottom - top);
        let part = Size::new(bounds.width, bounds.height).ok()?;
        let under = Image::from_fn(part, |col, row| {
            Srgb(colors[(left + col, top + row)].map(in_steps))
        });
        Some(Self {
            frame,
            is_foreground,
            under,
            bounds,
            size,
            own_from_reference: *frame_from_reference,
            shifts: BTreeMap::from([(frame, (0, 0))]),
            cells,
        })
    }

    /// Number of the stroke's own frame.
    pub fn frame(&self) -> u64 {
        self.frame
    }

    /// True for a foreground stroke, which has to be [followed](Self::follow).
    pub fn is_foreground(&self) -> bool {
        self.is_foreground
    }

    /// Starts to follow a foreground stroke, forward or backward, from its own frame.
    pub fn follow(&self, colors: &Colors) -> StrokeFollower {
        StrokeFollower {
            at: (0, 0),
            motion: (0, 0),
            before: Surroundings::new(self, colors, (0, 0)),
        }
    }

    /// The pixels of a frame that the stroke marks, column and row.
    ///
    /// Exact in its own frame. In others, a background stroke lies where the plane has moved it, a foreground stroke where it was
    /// followed to, and both end where the colors of the frame are not theirs.
    pub fn marked(
        &self,
        frame: u64,
        colors: &Colors,
        frame_from_reference: &Homography,
    ) -> Vec<(usize, usize)> {
        if frame == self.frame {
            return self.cells.clone();
        }
        if self.is_foreground {
            let Some(shift) = self.shifts.get(&frame) else {
                return Vec::new();
            };
            return self.kept(colors, *shift).collect();
        }
        let map = *frame_from_reference * self.own_from_reference.inverse();
        let back = map.inverse();
        let own = |(col, row): (usize, usize)| {
            let at = back
                .apply(dvec2(col as f64 + 0.5, row as f64 + 0.5))
                .floor();
            let inside = at.cmpge(DVec2::ZERO).all();
            inside.then_some((at.x as usize, at.y as usize))
        };
        self.around(&map)
            .filter(|&cell| {
                own(cell).is_some_and(|place| {
                    self.contains(place.0, place.1) && self.has(colors[cell], place, 1)
                })
            })
            .collect()
    }

    /// The cells of a foreground stroke that has moved by `shift` and lies there on its colors.
    fn kept<'a>(
        &'a self,
        colors: &'a Colors,
        (x, y): (isize, isize),
    ) -> impl Iterator<Item = (usize, usize)> + 'a {
        shifted(&self.cells, (x, y), self.size).filter(move |&cell| {
            let own = (
                cell.0.wrapping_add_signed(-x),
                cell.1.wrapping_add_signed(-y),
            );
            self.has(colors[cell], own, REACH_PX)
        })
    }

    /// True for a pixel of the stroke in its own frame.
    fn contains(&self, col: usize, row: usize) -> bool {
        // cells come row by row
        let order = |cell: &(usize, usize)| (cell.1, cell.0);
        self.cells.binary_search_by_key(&(row, col), order).is_ok()
    }

    /// Pixels of a frame that the bounds of the stroke may meet.
    fn around(&self, map: &Homography) -> impl Iterator<Item = (usize, usize)> + use<> {
        let (mut low, mut high) = (DVec2::MAX, DVec2::MIN);
        for &(col, row) in &self.cells {
            let at = map.apply(dvec2(col as f64 + 0.5, row as f64 + 0.5));
            low = low.min(at);
            high = high.max(at);
        }
        let whole = dvec2(self.size.width() as f64, self.size.height() as f64);
        // NaN of places behind the horizon becomes 0
        let clamp = |at: DVec2| at.max(DVec2::ZERO).min(whole);
        let (low, high) = (clamp(low - 1.5), clamp(high + 1.5));
        let (left, right) = (low.x as usize, high.x.ceil() as usize);
        let (top, bottom) = (low.y as usize, high.y.ceil() as usize);
        (top..bottom).flat_map(move |row| (left..right).map(move |col| (col, row)))
    }

    /// True for a color that lies under the stroke within `reach` pixels of a place in its own frame.
    fn has(&self, color: [f32; 3], (col, row): (usize, usize), reach: usize) -> bool {
        let color = color.map(in_steps);
        let part = self.bounds;
        let side = |at: usize, first: usize, length: usize| {
            let at = at.saturating_sub(first);
            at.saturating_sub(reach)..(at + reach + 1).min(length)
        };
        let cols = side(col, part.col, part.width);
        side(row, part.row, part.height).any(|row| {
            let line = self.under.row(row).get(cols.clone()).unwrap_or_default();
            line.iter().any(|Srgb(known)| {
                let mut pairs = known.iter().zip(color);
                pairs.all(|(a, b)| a.abs_diff(b) <= SAME_COLOR)
            })
        })
    }
}

/// A value in steps of 8 bits; NaN is 0.
fn in_steps(value: f32) -> u8 {
    (255.0 * value.clamp(0.0, 1.0)).round() as u8
}

/// The cells of a stroke moved by whole pixels, those that stay in the frame.
fn shifted(
    cells: &[(usize, usize)],
    (x, y): (isize, isize),
    size: Size,
) -> impl Iterator<Item = (usize, usize)> {
    cells.iter().filter_map(move |&(col, row)| {
        let (col, row) = (col.checked_add_signed(x)?, row.checked_add_signed(y)?);
        (col < size.width() && row < size.height()).then_some((col, row))
    })
}

/// Follows what lies under a foreground stroke from frame to frame.
#[derive(Debug, Clone)]
pub struct StrokeFollower {
    /// Pixels from the stroke's own frame.
    at: (isize, isize),
    /// Motion between the last two frames.
    motion: (isize, isize),
    before: Option<Surroundings>,
}

impl StrokeFollower {
    /// Finds the stroke in the next frame and records its place. False once it is lost: what lay under it has left the frame or has
    /// changed its colors.
    pub fn push(&mut self, stroke: &mut CarriedStroke, frame: u64, colors: &Colors) -> bool {
        let Some(before) = &self.before else {
            return false;
        };
        let Some(moved) = before.find(colors, self.motion) else {
            return false;
        };
        let at = (self.at.0 + moved.0, self.at.1 + moved.1);
        let kept = stroke.kept(colors, at).count();
        if (kept as f64) < MIN_KEPT * stroke.cells.len() as f64 {
            self.before = None;
            return false;
        }
        self.motion = moved;
        self.at = at;
        stroke.shifts.insert(frame, at);
        self.before = Surroundings::new(stroke, colors, at);
        true
    }
}

/// Brightness around a stroke at several sizes, with weights.
#[derive(Debug, Clone)]
struct Surroundings {
    rect: Rect,
    /// Pixels of the frame along a pixel of the finest level.
    step: usize,
    /// Brightness and weight, the finest level first.
    levels: Vec<(Plane, Plane)>,
}

impl Surroundings {
    /// Those of a stroke that has moved by `at`; `None` if it has left the frame.
    fn new(stroke: &CarriedStroke, colors: &Colors, at: (isize, isize)) -> Option<Self> {
        let cells: Vec<_> = shifted(&stroke.cells, at, stroke.size).collect();
        let cols = cells.iter().map(|cell| cell.0);
        let (left, right) = (cols.clone().min()?, cols.max()? + 1);
        let rows = cells.iter().map(|cell| cell.1);
        let (top, bottom) = (rows.clone().min()?, rows.max()? + 1);
        let size = colors.size();
        let (left, top) = (left.saturating_sub(RING_PX), top.saturating_sub(RING_PX));
        let right = (right + RING_PX).min(size.width());
        let bottom = (bottom + RING_PX).min(size.height());
        let rect = Rect::new(left, top, right - left, bottom - top);
        let step = rect.width.max(rect.height).div_ceil(MAX_SIDE);
        let cells_of = |length: usize| length.div_ceil(step);
        let size = Size::new(cells_of(rect.width), cells_of(rect.height)).ok()?;
        let mut weight = Plane::new(size, 0.0);
        for (col, row) in cells {
            weight[((col - left) / step, (row - top) / step)] = 1.0;
        }
        let own = Mask::from_coverage(&weight);
        let near = own.dilate((RING_PX / step) as f64);
        let weight = Plane::from_fn(weight.size(), |col, row| {
            if own.at(col, row) > 0.0 {
                1.0
            } else {
                RING_WEIGHT * near.at(col, row)
            }
        });
        let luma = levels(brightness(colors, rect, step)?);
        Some(Self {
            rect,
            step,
            levels: luma.into_iter().zip(levels(weight)).collect(),
        })
    }

    /// The motion to another frame; `None` if it leaves the frame.
    fn find(&self, colors: &Colors, predicted: (isize, isize)) -> Option<(isize, isize)> {
        let coarse = self.levels.len() - 1;
        let unit = 1_isize << coarse;
        let step = self.step as isize;
        // from here on in pixels of the finest level
        let predicted = (predicted.0 / step, predicted.1 / step);
        let search = (SEARCH / step).max(2);
        let reach = search * unit + predicted.0.abs().max(predicted.1.abs()) + 2 * unit;
        let reach = reach.unsigned_abs() * self.step;
        let (left, top) = (
            self.rect.col.saturating_sub(reach),
            self.rect.row.saturating_sub(reach),
        );
        let size = colors.size();
        // a grid that all levels share with the surroundings
        let grid = unit.unsigned_abs() * self.step;
        let left = self.rect.col - (self.rect.col - left) / grid * grid;
        let top = self.rect.row - (self.rect.row - top) / grid * grid;
        let right = (self.rect.right() + reach).min(size.width());
        let bottom = (self.rect.bottom() + reach).min(size.height());
        let area = Rect::new(left, top, right - left, bottom - top);
        let target = levels(brightness(colors, area, self.step)?);
        let offset = (
            ((self.rect.col - left) / self.step) as isize,
            ((self.rect.row - top) / self.step) as isize,
        );
        let mut best = (predicted.0 / unit, predicted.1 / unit);
        for level in (0..self.levels.len()).rev() {
            let unit = 1_isize << level;
            let radius = if level == coarse { search } else { 2 };
            let (luma, weight) = &self.levels[level];
            let target = target.get(level)?;
            let from = (offset.0 / unit, offset.1 / unit);
            let mut least = f32::INFINITY;
            let middle = best;
            for y in middle.1 - radius..=middle.1 + radius {
                for x in middle.0 - radius..=middle.0 + radius {
                    let Some(difference) =
                        difference(luma, weight, target, (from.0 + x, from.1 + y))
                    else {
                        continue;
                    };
                    let (dx, dy) = (x * unit - predicted.0, y * unit - predicted.1);
                    let cost = difference + DEVIATION_COST * (dx * dx + dy * dy) as f32;
                    if cost < least {
                        least = cost;
                        best = (x, y);
                    }
                }
            }
            if !least.is_finite() {
                return None;
            }
            if level > 0 {
                best = (2 * best.0, 2 * best.1);
            }
        }
        Some((best.0 * step, best.1 * step))
    }
}

/// Weighted mean of squared differences between surroundings and a target, with their corner at `at` in it; `None` if less than half
/// of the weight lies in the target.
fn difference(luma: &Plane, weight: &Plane, target: &Plane, at: (isize, isize)) -> Option<f32> {
    let (mut sum, mut inside, mut all) = (0.0f32, 0.0f32, 0.0f32);
    for row in 0..luma.height() {
        let (values, weights) = (luma.row(row), weight.row(row));
        all += weights.iter().sum::<f32>();
        let Some(line) = row
            .checked_add_signed(at.1)
            .filter(|&row| row < target.height())
        else {
            continue;
        };
        let line = target.row(line);
        for (col, (value, weight)) in values.iter().zip(weights).enumerate() {
            if let Some(other) = col.checked_add_signed(at.0).and_then(|col| line.get(col)) {
                sum += weight * (value - other).powi(2);
                inside += weight;
            }
        }
    }
    (inside > 0.5 * all).then(|| sum / inside)
}

/// Mean of the channels in a part of a frame, and of `step` × `step` pixels.
fn brightness(colors: &Colors, part: Rect, step: usize) -> Option<Plane> {
    let size = Size::new(part.width.div_ceil(step), part.height.div_ceil(step)).ok()?;
    Some(Plane::from_fn(size, |col, row| {
        let cols = col * step..((col + 1) * step).min(part.width);
        let rows = row * step..((row + 1) * step).min(part.height);
        let count = (cols.len() * rows.len()) as f32;
        let mut sum = 0.0;
        for row in rows {
            for [r, g, b] in &colors.row(part.row + row)[part.col..][cols.clone()] {
                sum += r + g + b;
            }
        }
        sum / (3.0 * count)
    }))
}

/// A plane at several sizes, the finest first.
fn levels(plane: Plane) -> Vec<Plane> {
    let pyramid = Pyramid::with_levels(plane, Reduction::Area, LEVELS);
    pyramid.levels().to_vec()
}

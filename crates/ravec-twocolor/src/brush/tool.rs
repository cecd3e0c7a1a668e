//! The effect of a stroke on each pixel.

use super::cells::Cells;
use super::path::{Nearest, Path};
use super::stroke::{Stroke, Tool};
use crate::pointwise::{apply, mixed};
use glam::DVec2;
use ravec_raster::color::{linear_from_oklab, oklab_from_linear};
use ravec_raster::{Color, Image, LinearRgba, Plane, Rect, Srgb};
use rayon::prelude::*;

/// Share of the way to white or black that full strength moves a tone: half.
const TONE_SHARE: f32 = 0.5;

/// Rows painted by one task.
const STRIP_ROWS: usize = 8;

/// A stroke at work.
pub(crate) struct Painter<'a> {
    pub stroke: &'a Stroke,
    pub path: &'a Path,
    pub cells: &'a Cells,
    /// The picture before the stroke.
    pub before: &'a Image<LinearRgba>,
}

impl Painter<'_> {
    /// Paints the pixels of `region` into `image` (and the mask); returns the number with a positive effect.
    pub fn paint(
        &self,
        region: Rect,
        image: &mut Image<LinearRgba>,
        mask: Option<&mut Plane>,
    ) -> u64 {
        let width = image.width();
        let rows = region.row * width..region.bottom() * width;
        let pixels = image.pixels_mut()[rows.clone()].par_chunks_mut(STRIP_ROWS * width);
        let strip_of = |strip: usize, len: usize| {
            let top = region.row + strip * STRIP_ROWS;
            Rect::new(region.col, top, region.width, len / width)
        };
        if self.stroke.tool == Tool::Mask {
            let Some(mask) = mask else { return 0 };
            let strips = mask.pixels_mut()[rows]
                .par_chunks_mut(STRIP_ROWS * width)
                .enumerate();
            return strips
                .map(|(strip, out)| {
                    let rect = strip_of(strip, out.len());
                    self.each(rect, |col, row, effect| {
                        let slot = &mut out[(row - rect.row) * width + col];
                        // selecting again does not select more
                        *slot = slot.max(effect);
                    })
                })
                .sum();
        }
        pixels
            .enumerate()
            .map(|(strip, out)| {
                let rect = strip_of(strip, out.len());
                self.each(rect, |col, row, effect| {
                    out[(row - rect.row) * width + col] = self.painted(col, row, effect);
                })
            })
            .sum()
    }

    /// The effect on each pixel of `region`, which `effect` covers.
    pub fn effect(&self, region: Rect, effect: &mut Plane) {
        effect.for_each_row(|row, out| {
            let rect = Rect::new(region.col, region.row + row, region.width, 1);
            self.each(rect, |col, _, value| out[col - region.col] = value);
        });
    }

    /// Visits the pixels of a rectangle on which the stroke has an effect.
    fn each(&self, rect: Rect, mut visit: impl FnMut(usize, usize, f32)) -> u64 {
        let near = self.path.near(rect);
        let mut count = 0;
        if near.is_empty() {
            return 0;
        }
        for row in rect.row..rect.bottom() {
            for col in rect.col..rect.right() {
                let p = DVec2::new(col as f64 + 0.5, row as f64 + 0.5);
                let nearest = near.nearest(p);
                let effect = near.effect(p, nearest.distance, self.stroke.strength) as f32;
                if effect <= 0.0 {
                    continue;
                }
                let effect = effect * self.edge_mask(col, row, &nearest);
                if effect > 0.0 {
                    count += 1;
                    visit(col, row, effect);
                }
            }
        }
        count
    }

    /// 1 where nothing on the way from the brush differs from where it is, 0 beyond an edge.
    fn edge_mask(&self, col: usize, row: usize, nearest: &Nearest) -> f32 {
        if !self.stroke.edge_aware {
            return 1.0;
        }
        let limit = |v: f64, len: usize| (v.max(0.0) as usize).min(len - 1);
        let at = |p: DVec2| {
            self.cells
                .sides(
                    limit(p.x, self.before.width()),
                    limit(p.y, self.before.height()),
                )
                .map(|sides| sides.own)
        };
        let target = DVec2::new(col as f64 + 0.5, row as f64 + 0.5);
        let Some(start) = at(nearest.point) else {
            return 1.0;
        };
        let steps = nearest.distance.ceil().max(1.0) as usize;
        let mut farthest = 0.0f32;
        let bound = self.stroke.edge_tolerance * self.stroke.edge_tolerance;
        for step in 1..=steps {
            let p = nearest.point.lerp(target, step as f64 / steps as f64);
            if let Some(color) = at(p) {
                let distance_sq = (0..3)
                    .map(|c| (color[c] - start[c]) * (color[c] - start[c]))
                    .sum::<f32>();
                farthest = farthest.max(distance_sq);
                if farthest >= bound {
                    return 0.0;
                }
            }
        }
        // full effect up to half the tolerance
        let t = (2.0 - 2.0 * farthest.sqrt() / self.stroke.edge_tolerance).clamp(0.0, 1.0);
        t * t * (3.0 - 2.0 * t)
    }

    /// The pixel with the stroke's effect on it.
    fn painted(&self, col: usize, row: usize, effect: f32) -> LinearRgba {
        let pixel = self.before[(col, row)];
        if let Tool::Color { rgb } = self.stroke.tool {
            return over(pixel, Srgb(rgb).to_linear().rgb(), effect);
        }
        let target = match self.stroke.tool {
            Tool::Operator { mode, .. } => self.cells.target(col, row).or_else(|| {
                self.cells
                    .sides(col, row)
                    .map(|sides| apply(mode, pixel, &sides))
            }),
            Tool::Clone { offset } => {
                let from = |v: usize, by: i32| usize::try_from(v as i64 + i64::from(by)).ok();
                from(col, offset[0])
                    .zip(from(row, offset[1]))
                    .and_then(|(c, r)| self.before.get(c, r))
            }
            Tool::Color { .. } | Tool::Mask => None,
            Tool::Dodge => Some(in_oklab(pixel, |[l, a, b]| {
                [l + TONE_SHARE * (1.0 - l).max(0.0), a, b]
            })),
            Tool::Burn => Some(in_oklab(pixel, |lab| lab.map(|v| v * (1.0 - TONE_SHARE)))),
            Tool::Saturation { amount } => Some(in_oklab(pixel, |[l, a, b]| {
                [l, a * (1.0 + amount), b * (1.0 + amount)]
            })),
            Tool::Recolor { rgb } => {
                let [_, a, b] = oklab_from_linear(Srgb(rgb).to_linear().rgb());
                Some(in_oklab(pixel, |[l, _, _]| [l, a, b]))
            }
        };
        target.map_or(pixel, |target| mixed(pixel, target, effect))
    }
}

/// The pixel with its Oklab color changed.
fn in_oklab(pixel: LinearRgba, change: impl Fn([f32; 3]) -> [f32; 3]) -> LinearRgba {
    let color = linear_from_oklab(change(oklab_from_linear(pixel.rgb())));
    LinearRgba::from_rgb_alpha(color, pixel.alpha())
}

/// An opaque color over the pixel, as much as `share` of it.
fn over(pixel: LinearRgba, color: [f32; 3], share: f32) -> LinearRgba {
    let below = pixel.alpha() * (1.0 - share);
    let alpha = share + below;
    let rgb = pixel.rgb();
    let mixed = std::array::from_fn(|c| (share * color[c] + below * rgb[c]) / alpha);
    LinearRgba::from_rgb_alpha(mixed, alpha)
}

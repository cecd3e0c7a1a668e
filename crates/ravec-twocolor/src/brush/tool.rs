//! The effect of a stroke on each pixel.

use super::cells::Cells;
use super::path::{NearPath, Nearest, Path};
use super::stroke::{Stroke, Tool};
use crate::pointwise::{apply, mixed};
use glam::DVec2;
use ravec_raster::color::{linear_from_oklab, oklab_from_linear};
use ravec_raster::{Color, Image, LinearRgba, Plane, Rect, Srgb};
use rayon::prelude::*;

/// Share of the way to white or black that full strength moves a tone: half.
const TONE_SHARE: f32 = 0.5;

/// Side of the blocks whose pixels share the segments that may be nearest; rows painted by one task.
const BLOCK: usize = 8;

/// The new value of a mask, of the old one and the effect of a stroke.
pub(crate) type Select = fn(f32, f32) -> f32;

/// A stroke at work.
pub(crate) struct Painter<'a> {
    pub stroke: &'a Stroke,
    pub path: &'a Path,
    /// Number of the first segment whose pixels are painted: those that are nearest to one before it stay as they are.
    pub first_segment: usize,
    /// The path that was painted before, if segments of it are gone: pixels that were nearest to them are painted too.
    pub replaced: Option<&'a Path>,
    pub cells: &'a Cells,
    /// The picture before the stroke.
    pub before: &'a Image<LinearRgba>,
}

impl Painter<'_> {
    /// Paints the pixels of `region` into `image`, or into the mask what `select` makes of the mask and the effect; returns the
    /// number with a positive effect.
    pub fn paint(
        &self,
        region: Rect,
        image: &mut Image<LinearRgba>,
        mask: Option<(&mut Plane, Select)>,
    ) -> u64 {
        let width = image.width();
        let rows = region.row * width..region.bottom() * width;
        let strip_of = |strip: usize, len: usize| {
            let top = region.row + strip * BLOCK;
            Rect::new(region.col, top, region.width, len / width)
        };
        if self.stroke.tool == Tool::Mask {
            let Some((mask, select)) = mask else { return 0 };
            let strips = mask.pixels_mut()[rows].par_chunks_mut(BLOCK * width);
            return strips
                .enumerate()
                .map(|(strip, out)| {
                    let rect = strip_of(strip, out.len());
                    self.each(rect, |col, row, effect| {
                        let slot = &mut out[(row - rect.row) * width + col];
                        *slot = select(*slot, effect);
                    })
                })
                .sum();
        }
        let strips = image.pixels_mut()[rows].par_chunks_mut(BLOCK * width);
        strips
            .enumerate()
            .map(|(strip, out)| {
                let rect = strip_of(strip, out.len());
                self.each(rect, |col, row, effect| {
                    out[(row - rect.row) * width + col] = if effect > 0.0 {
                        self.painted(col, row, effect)
                    } else {
                        self.before[(col, row)]
                    };
                })
            })
            .sum()
    }

    /// The effect on each pixel of `region`, which `effect` covers.
    pub fn effect(&self, region: Rect, effect: &mut Plane) {
        let width = region.width;
        let strips = effect.pixels_mut().par_chunks_mut(BLOCK * width);
        strips.enumerate().for_each(|(strip, out)| {
            let top = region.row + strip * BLOCK;
            let rect = Rect::new(region.col, top, width, out.len() / width);
            self.each(rect, |col, row, value| {
                out[(row - top) * width + col - region.col] = value;
            });
        });
    }

    /// Visits the pixels of a strip, with the effect of the stroke on each; returns the number with a positive effect.
    fn each(&self, strip: Rect, mut visit: impl FnMut(usize, usize, f32)) -> u64 {
        let near = self.path.near(strip);
        let replaced = self.replaced.map(|path| path.near(strip));
        let mut count = 0;
        for left in (strip.col..strip.right()).step_by(BLOCK) {
            let width = BLOCK.min(strip.right() - left);
            let block = Rect::new(left, strip.row, width, strip.height);
            let near = near.nearest_within(block);
            let replaced = replaced.as_ref().map(|near| near.nearest_within(block));
            let pixels = (block.row..block.bottom())
                .flat_map(|row| (block.col..block.right()).map(move |col| (col, row)));
            for (col, row) in pixels {
                let Some(effect) = self.effect_at(&near, replaced.as_ref(), col, row) else {
                    continue;
                };
                count += u64::from(effect > 0.0);
                visit(col, row, effect);
            }
        }
        count
    }

    /// The effect on a pixel; `None` if it is nearest to a segment that is not painted.
    fn effect_at(
        &self,
        near: &NearPath,
        replaced: Option<&NearPath>,
        col: usize,
        row: usize,
    ) -> Option<f32> {
        let p = DVec2::new(col as f64 + 0.5, row as f64 + 0.5);
        let stays = |nearest: Option<Nearest>| match nearest {
            Some(nearest) => nearest.segment < self.first_segment,
            None => self.first_segment > 0,
        };
        let nearest = near.nearest(p);
        if stays(nearest) && replaced.is_none_or(|replaced| stays(replaced.nearest(p))) {
            return None;
        }
        let Some(nearest) = nearest else {
            return Some(0.0);
        };
        let effect = near.effect(p, nearest.distance, self.stroke.strength) as f32;
        if effect <= 0.0 || !self.stroke.edge_aware {
            return Some(effect.max(0.0));
        }
        Some(effect * self.edge_mask(p, &nearest))
    }

    /// 1 where nothing on the way from the brush differs from where it is, 0 beyond an edge.
    fn edge_mask(&self, target: DVec2, nearest: &Nearest) -> f32 {
        let (width, height) = (self.before.width() as f64, self.before.height() as f64);
        let from = nearest.point;
        let last = DVec2::new(width - 0.5, height - 0.5);
        let at = |p: DVec2| self.cells.own(whole(p.x), whole(p.y));
        let Some(start) = at(from.clamp(DVec2::ZERO, last)) else {
            return 1.0;
        };
        let steps = nearest.distance.ceil().max(1.0);
        let step = (target - from) / steps;
        let bound = self.stroke.edge_tolerance * self.stroke.edge_tolerance;
        let mut farthest = 0.0f32;
        for number in 1..=steps as usize {
            let p = from + number as f64 * step;
            let Some(color) = at(p.clamp(DVec2::ZERO, last)) else {
                continue;
            };
            let [l, a, b, _] = color;
            let [l, a, b] = [l - start[0], a - start[1], b - start[2]];
            farthest = farthest.max(l * l + a * a + b * b);
            if farthest >= bound {
                return 0.0;
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

/// The whole part of a number from 0 to 2³⁰, rounded to 20 binary places before: without the checks of a conversion.
fn whole(value: f64) -> usize {
    // the last place of the sum is 2⁻²⁰, so its lower 20 bits are the fraction
    const SHIFT: f64 = (1_u64 << 32) as f64;
    ((value + SHIFT).to_bits() >> 20) as u32 as usize
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

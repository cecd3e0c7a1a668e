//! Offsets worth trying: from where, relative to a hole, might its content be copied?
//!
//! Three sources. *Rings*: the known pixels around the whole hole are laid over the sheet at all shifts; what fits is a
//! place where the whole surroundings look alike. *Discs*: the same for small discs on the rim, for pictures in which
//! nothing repeats as a whole. *Periods*: shifts at which the sheet looks like itself; on walls and floors they are what
//! counts.
//!
//! All of them are correlations, computed by Fourier transforms on a reduced sheet and refined by direct sums on the full
//! one.
//!
//! Cost: a dozen transforms for the ring, eight for each disc, six for the periods, all of the reduced sheet.

mod periods;
mod query;

use self::periods::periods;
use self::query::{COLORS, Prepared, Reduced};
use crate::canvas::{HOLE, KNOWN, SOURCE, STEADY};
use crate::sheet::{Sheet, distance_sq};
use glam::IVec2;
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;

/// A shift from a pixel of the hole to its source, with how well it fits where it was found: smaller is better.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Proposal {
    pub(crate) offset: IVec2,
    pub(crate) score: f32,
}

/// Result of the search.
#[derive(Debug, Default)]
pub(crate) struct Proposals {
    pub(crate) ring: Vec<Proposal>,
    pub(crate) discs: Vec<Proposal>,
    pub(crate) periods: Vec<Proposal>,
}

/// Places where the whole surroundings of a hole fit best.
const RING_MINIMA: usize = 20;
/// Discs on the rim, and the best places of each.
const DISCS: usize = 16;
const DISC_MINIMA: usize = 4;
/// Highest peaks of the autocorrelation.
const PERIODS: usize = 12;
/// The known ring around a hole is this wide: enough to see a pattern, not enough to see past it.
const RING_PX: i32 = 8;
/// Most pixels of a ring that direct sums look at.
const RING_SAMPLES: usize = 1500;
/// Offsets this near to a better one are left out.
const APART_PX: i32 = 3;
/// Reduced sheets have at most this many pixels, if the hole is large enough to survive.
const MAX_PIXELS: usize = 160_000;

/// The share of a disc that must be known and covered by sources.
const DISC_SHARE: f32 = 0.98;
/// Pixels of a transform for each pixel of the reduced sheet, at most, with the same margin in both directions. Holes of all
/// ordinary pictures stay below; beyond, a long hole in a narrow sheet gets a margin of its own in each direction, which makes
/// it about 4 in the worst case.
const MAX_GROWTH: usize = 8;

/// Returns `true` if a disc can be covered by sources anywhere on a sheet, which it cannot if the sheet is too narrow.
fn disc_fits(radius: i32, limit: IVec2) -> bool {
    let steps =
        || (-radius..=radius).flat_map(|y| (-radius..=radius).map(move |x| IVec2::new(x, y)));
    let inside = |step: &IVec2| step.length_squared() <= radius * radius;
    // a disc whose middle is in that of the sheet has most of its pixels on it
    let on_sheet = |step: &IVec2| {
        let at = *step + limit / 2;
        at.cmpge(IVec2::ZERO).all() && at.cmplt(limit).all()
    };
    let all = steps().filter(inside).count();
    let covered = steps().filter(inside).filter(on_sheet).count();
    covered as f32 >= DISC_SHARE * all as f32
}

/// Margins by which transforms must be wider and higher than the sheet, so that windows at all shifts are not wrapped
/// onto the other side: as much as the largest window.
fn margins(sheet: IVec2, ring: IVec2, disc_radius: Option<i32>) -> [usize; 2] {
    let [width, height] = [sheet.x as usize, sheet.y as usize];
    let disc = disc_radius.map_or(0, |r| 2 * r + 1);
    let margin = ring.max_element().max(disc) as usize;
    if (width + margin) * (height + margin) <= MAX_GROWTH * width * height {
        return [margin; 2];
    }
    [ring.x.max(disc) as usize, ring.y.max(disc) as usize]
}

/// Looks for offsets around the hole of a sheet.
pub(crate) fn propose(sheet: &Sheet, progress: &Progress) -> Result<Proposals, Cancelled> {
    let mut found = Proposals::default();
    let Some((low, high)) = bounds(sheet) else {
        return Ok(found);
    };
    let short = (high - low).min_element() + 1;
    let mut factor = 1;
    while sheet.inks.len() / (factor * factor) > MAX_PIXELS && short as usize / factor >= 24 {
        factor *= 2;
    }
    progress.check()?;
    let reduced = Reduced::new(sheet, factor);
    let f = factor as i32;
    let ring = (RING_PX / f).max(3);
    let corner = (low / f - ring).max(IVec2::ZERO);
    let far = (high / f + ring).min(IVec2::new(reduced.width as i32, reduced.height as i32) - 1);
    let size = far - corner + 1;
    let limit = IVec2::new(reduced.width as i32, reduced.height as i32);
    let radius = ((high - low).max_element() / 5).clamp(8, 20);
    let disc = Some((radius / f).max(3)).filter(|&r| disc_fits(r, limit));
    let prepared = Prepared::new(reduced, margins(limit, size, disc));
    let reduced = &prepared.reduced;
    progress.check()?;

    let apart = (APART_PX / f).max(1);
    {
        let map = prepared.mismatch(
            corner,
            size,
            &|x, y| reduced.weight(x, y, KNOWN),
            &|x, y| reduced.weight(x, y, HOLE),
        );
        let offsets = map.minima(RING_MINIMA, apart, 0.6, 0.4, corner, limit);
        let pixels = around(sheet, RING_SAMPLES);
        found.ring = refine(sheet, &offsets, f, &pixels);
    }
    progress.check()?;
    if let Some(r) = disc {
        for middle in rim_points(sheet, DISCS, radius) {
            progress.check()?;
            let middle_reduced = middle / f;
            let corner = middle_reduced - r;
            let size = IVec2::splat(2 * r + 1);
            let in_disc = |x: i32, y: i32| {
                let d = IVec2::new(x, y) - middle_reduced;
                d.length_squared() <= r * r
            };
            let weight = |x: i32, y: i32| {
                if in_disc(x, y) {
                    reduced.weight(x, y, KNOWN)
                } else {
                    0.0
                }
            };
            let needed = |x: i32, y: i32| f32::from(in_disc(x, y));
            let map = prepared.mismatch(corner, size, &weight, &needed);
            let offsets = map.minima(DISC_MINIMA, apart, DISC_SHARE, DISC_SHARE, corner, limit);
            let pixels: Vec<u32> = (0..(2 * radius + 1).pow(2))
                .filter_map(|i| {
                    let d = IVec2::new(i % (2 * radius + 1), i / (2 * radius + 1)) - radius;
                    let index = sheet.index(middle + d)?;
                    (d.length_squared() <= radius * radius && sheet.is(index, KNOWN))
                        .then_some(index as u32)
                })
                .collect();
            found.discs.extend(refine(sheet, &offsets, f, &pixels));
        }
    }
    progress.check()?;
    found.periods = periods(sheet, &prepared, PERIODS);
    Ok(found)
}

/// The smallest rectangle around the hole, both corners included.
pub(crate) fn bounds(sheet: &Sheet) -> Option<(IVec2, IVec2)> {
    sheet
        .hole()
        .map(|index| sheet.position(index))
        .fold(None, |bounds, at| {
            Some(bounds.map_or((at, at), |(low, high): (IVec2, IVec2)| {
                (low.min(at), high.max(at))
            }))
        })
}

/// Known pixels around the hole, at most about `samples` of them, evenly thinned.
pub(crate) fn around(sheet: &Sheet, samples: usize) -> Vec<u32> {
    let Some((low, high)) = bounds(sheet) else {
        return Vec::new();
    };
    let (low, high) = (low - RING_PX, high + RING_PX);
    let mut pixels: Vec<u32> = Vec::new();
    for y in low.y..=high.y {
        for x in low.x..=high.x {
            if let Some(index) = sheet.index(IVec2::new(x, y))
                && sheet.is(index, KNOWN)
            {
                pixels.push(index as u32);
            }
        }
    }
    let step = pixels.len().div_ceil(samples).max(1);
    pixels.into_iter().step_by(step).collect()
}

/// Looks around each offset of the reduced sheet for the best one of the full sheet.
fn refine(sheet: &Sheet, offsets: &[(IVec2, f32)], factor: i32, pixels: &[u32]) -> Vec<Proposal> {
    let reach = factor;
    let mut refined: Vec<Proposal> = offsets
        .par_iter()
        .filter_map(|&(offset, _)| {
            let side = 2 * reach + 1;
            (0..side * side)
                .filter_map(|k| {
                    let offset = offset * factor + IVec2::new(k % side, k / side) - reach;
                    let score = mismatch(sheet, pixels, offset)?;
                    Some(Proposal { offset, score })
                })
                .min_by(|a, b| a.score.total_cmp(&b.score))
        })
        .collect();
    refined.sort_by(|a, b| a.score.total_cmp(&b.score));
    let mut kept: Vec<Proposal> = Vec::new();
    for proposal in refined {
        if !kept
            .iter()
            .any(|k| (k.offset - proposal.offset).abs().max_element() < APART_PX.min(2))
        {
            kept.push(proposal);
        }
    }
    kept
}

/// The mean squared difference of pixels to those at an offset, as far as these are known; none if less than half are.
pub(crate) fn mismatch(sheet: &Sheet, pixels: &[u32], offset: IVec2) -> Option<f32> {
    if offset == IVec2::ZERO {
        return None;
    }
    let (mut sum, mut count) = (0.0f32, 0u32);
    for &index in pixels {
        let index = index as usize;
        let Some(other) = sheet.shifted(index, offset) else {
            continue;
        };
        if !sheet.is(other, SOURCE) {
            continue;
        }
        count += 1;
        let (a, b) = (&sheet.features[index], &sheet.features[other]);
        sum += if sheet.is(index, STEADY) {
            distance_sq(a, b)
        } else {
            (0..COLORS).map(|i| (a[i] - b[i]).powi(2)).sum()
        };
    }
    (count as usize * 2 >= pixels.len() && count > 0).then(|| sum / count as f32)
}

/// Points on the rim of the hole, about evenly spread: each is the one farthest from those before.
fn rim_points(sheet: &Sheet, count: usize, apart: i32) -> Vec<IVec2> {
    let rim: Vec<IVec2> = sheet
        .hole()
        .map(|index| sheet.position(index))
        .filter(|&at| {
            [IVec2::X, IVec2::NEG_X, IVec2::Y, IVec2::NEG_Y]
                .iter()
                .any(|&step| sheet.index(at + step).is_some_and(|i| sheet.is(i, KNOWN)))
        })
        .collect();
    let mut chosen = Vec::new();
    let mut nearest = vec![i64::MAX; rim.len()];
    let mut next = 0;
    while chosen.len() < count && next < rim.len() && nearest[next] >= i64::from(apart).pow(2) {
        let at = rim[next];
        chosen.push(at);
        for (distance, &other) in nearest.iter_mut().zip(&rim) {
            *distance = (*distance).min((other - at).as_i64vec2().length_squared());
        }
        next = (0..rim.len())
            .rev()
            .max_by_key(|&i| nearest[i])
            .unwrap_or(rim.len());
    }
    chosen
}

#[cfg(test)]
mod tests {
    use super::query::CHANNELS;
    use super::*;
    use crate::canvas::Canvas;
    use proptest::prelude::*;
    use ravec_raster::{Image, Mask, Rect, Size, Srgb};

    fn sheet(pattern: impl Fn(usize, usize) -> [u8; 3], hole: Rect) -> Sheet {
        let size = Size::new(96, 80).unwrap();
        let image = Image::from_fn(size, |col, row| Srgb(pattern(col, row)));
        let mut canvas =
            Canvas::new(&image, &Mask::from_rect(size, hole), &Progress::none()).unwrap();
        for row in hole.row..hole.bottom() {
            canvas.states.row_mut(row)[hole.col..hole.right()].fill(HOLE);
        }
        Sheet::window(&canvas, Rect::of(size))
    }

    fn noise(col: usize, row: usize) -> [u8; 3] {
        let value = (col as u64 * 7919 + row as u64 * 104_729).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        [40, 48, 56].map(|shift| (value >> shift) as u8)
    }

    #[test]
    fn a_planted_copy_of_the_surroundings_is_the_first_proposal() {
        let hole = Rect::new(55, 40, 16, 14);
        let around = hole.grown(10);
        let sheet = sheet(
            |col, row| {
                if around.contains(col + 40, row + 9) {
                    noise(col + 40, row + 9)
                } else {
                    noise(col, row)
                }
            },
            hole,
        );
        let found = propose(&sheet, &Progress::none()).unwrap();
        assert_eq!(found.ring[0].offset, IVec2::new(-40, -9));
        assert_eq!(found.ring[0].score, 0.0);
    }

    /// Sides from one pixel up, those of long strips as likely as those of squares.
    fn side() -> impl Strategy<Value = i32> {
        (0.0f64..20.0).prop_map(|log| log.exp2() as i32)
    }

    proptest! {
        #[test]
        fn transforms_have_pixels_in_proportion_to_the_sheet(
            (width, height) in (side(), side()), (right, below) in (0.0f64..1.0, 0.0f64..1.0), radius in 3i32..=20
        ) {
            let sheet = IVec2::new(width, height.min((100_000_000 / width).max(1)));
            let ring = (sheet.as_dvec2() * glam::dvec2(right, below)).ceil().as_ivec2().max(IVec2::ONE);
            let disc = Some(radius).filter(|&r| disc_fits(r, sheet));
            let [across, down] = margins(sheet, ring, disc);
            let pixels = sheet.x as usize * sheet.y as usize;
            let padded = (sheet.x as usize + across) * (sheet.y as usize + down);
            prop_assert!(padded <= MAX_GROWTH * pixels, "{sheet} {ring} {disc:?}: {across} {down}");
            prop_assert!(across >= ring.x as usize && down >= ring.y as usize);
            let least = disc.map_or(0, |r| 2 * r as usize + 1);
            prop_assert!(across >= least && down >= least);
        }
    }

    #[test]
    fn a_copy_on_a_sheet_of_one_row_is_found() {
        let size = Size::new(30_000, 1).unwrap();
        let image = Image::from_fn(size, |col, _| {
            let at = if (9_900..12_100).contains(&col) {
                col + 8_000
            } else {
                col
            };
            Srgb(noise(at, 0))
        });
        let hole = Rect::new(10_000, 0, 2_000, 1);
        let mut canvas =
            Canvas::new(&image, &Mask::from_rect(size, hole), &Progress::none()).unwrap();
        canvas.states.row_mut(0)[hole.col..hole.right()].fill(HOLE);
        let found = propose(&Sheet::window(&canvas, Rect::of(size)), &Progress::none()).unwrap();
        assert_eq!(found.ring[0].offset, IVec2::new(8_000, 0));
        assert_eq!(found.ring[0].score, 0.0);
    }

    #[test]
    fn what_repeats_is_found_at_its_periods_only() {
        let pattern = |col: usize, row: usize| noise(col % 13, row % 17);
        let found = propose(
            &sheet(pattern, Rect::new(40, 30, 16, 14)),
            &Progress::none(),
        )
        .unwrap();
        let whole = |p: &Proposal| p.offset.x % 13 == 0 && p.offset.y % 17 == 0;
        assert_eq!(found.periods.len(), PERIODS);
        assert!(found.periods.iter().all(whole), "{:?}", found.periods);
    }

    #[test]
    fn the_transforms_agree_with_direct_sums() {
        let sheet = sheet(noise, Rect::new(40, 30, 12, 10));
        let prepared = Prepared::new(Reduced::new(&sheet, 1), [32; 2]);
        let reduced = &prepared.reduced;
        let (corner, size) = (IVec2::new(34, 24), IVec2::new(24, 22));
        let map = prepared.mismatch(
            corner,
            size,
            &|x, y| reduced.weight(x, y, KNOWN),
            &|x, y| reduced.weight(x, y, HOLE),
        );
        for to in [(0, 0), (5, 50), (60, 3), (72, 58), (30, 20)] {
            let mut sum = 0.0f64;
            for k in 0..size.x * size.y {
                let step = IVec2::new(k % size.x, k / size.x);
                let a = sheet.index(corner + step).unwrap();
                let b = sheet.index(IVec2::from(to) + step).unwrap();
                if !sheet.is(a, KNOWN) || !sheet.is(b, SOURCE) {
                    continue;
                }
                let channels = if sheet.is(a, STEADY) {
                    CHANNELS
                } else {
                    COLORS
                };
                for channel in 0..channels {
                    let d = sheet.features[a][channel] - sheet.features[b][channel];
                    sum += f64::from(d).powi(2);
                }
            }
            let found = f64::from(map.mismatch[to.1 as usize * map.width + to.0 as usize]);
            assert!((found - sum).abs() <= 1e-3 * sum, "{to:?}: {found} {sum}");
        }
    }
}

//! A plate of several planes: each pixel belongs to the plane along which the frames agree best.
//!
//! Along its own plane the samples of a pixel differ by noise; along another one detail slides, so that they spread or do not agree at
//! all. A single pixel says little, and a place without detail nothing: costs are averaged over a window first. What a single frame
//! shows along some plane says nothing either, and follows its surroundings.

use super::Plate;
use crate::{Colors, VideoEditError, same_size};
use ravec_raster::{Image, Mask, Plane};
use rayon::prelude::*;

/// Cost of a pixel that was not seen along a plane, in units of encoded color; more than any spread.
const UNSEEN: f32 = 1.0;
/// Cost of samples that do not agree with the color of the plate.
const DISAGREEMENT: f32 = 0.25;
/// Radius of the window as a share of the shorter side, and at least, in pixels.
const WINDOW_SHARE: f64 = 0.02;
const MIN_WINDOW_PX: usize = 3;
/// Radius of the surroundings by that of the window, and their weight, which counts where the window says little.
const SURROUNDINGS: usize = 8;
const SURROUNDINGS_WEIGHT: f32 = 0.01;
/// Evidence of a pixel that some plane does not show: next to none.
const MIN_EVIDENCE: f32 = 1e-3;

/// The plane of each pixel of plates of one shot, each along another plane, as an index into `plates`; those after the first 256 are
/// not used.
///
/// Does not guarantee exact borders: where planes meet, and in places without detail, they may lie some pixels beside the true ones.
/// Ties go to the first plane.
///
/// # Errors
/// [`VideoEditError::NoFrames`] without a plate, [`VideoEditError::SizesDiffer`].
pub fn plate_regions(plates: &[Plate]) -> Result<Image<u8>, VideoEditError> {
    let first = plates.first().ok_or(VideoEditError::NoFrames)?;
    let size = first.colors.size();
    let shorter = size.width().min(size.height());
    let radius = ((WINDOW_SHARE * shorter as f64).round() as usize).max(MIN_WINDOW_PX);
    for plate in plates {
        same_size(plate.colors.size(), size)?;
    }
    let plates = &plates[..plates.len().min(256)];
    let evidence = evidence(plates);
    let spread_out = |plane: &Plane| {
        let (near, far) = (
            averaged(plane, radius),
            averaged(plane, SURROUNDINGS * radius),
        );
        Plane::from_fn(size, |col, row| {
            near[(col, row)] + SURROUNDINGS_WEIGHT * far[(col, row)]
        })
    };
    // the sum of the weights is the same for all planes
    let costs: Vec<Plane> = plates
        .iter()
        .map(|plate| spread_out(&cost(plate, &evidence)))
        .collect();
    Ok(Image::from_fn(size, |col, row| {
        let of = |index: usize| costs[index][(col, row)];
        let best = (1..costs.len()).fold(
            0,
            |best, index| if of(index) < of(best) { index } else { best },
        );
        best as u8
    }))
}

/// One plate of several: each pixel is that of the plate of its region.
///
/// # Errors
/// [`VideoEditError::NoFrames`] if a region has no plate, [`VideoEditError::SizesDiffer`].
pub fn joined_plate(plates: &[Plate], regions: &Image<u8>) -> Result<Plate, VideoEditError> {
    for plate in plates {
        same_size(plate.colors.size(), regions.size())?;
    }
    if regions
        .pixels()
        .iter()
        .any(|&index| usize::from(index) >= plates.len())
    {
        return Err(VideoEditError::NoFrames);
    }
    let of = |col: usize, row: usize| &plates[usize::from(regions[(col, row)])];
    let size = regions.size();
    Ok(Plate {
        colors: Colors::from_fn(size, |col, row| of(col, row).colors[(col, row)]),
        seen: Mask::from_fn(size, |col, row| of(col, row).seen.at(col, row) > 0.0),
        certainty: Plane::from_fn(size, |col, row| of(col, row).certainty[(col, row)]),
        spread: Plane::from_fn(size, |col, row| of(col, row).spread[(col, row)]),
        agreement: Plane::from_fn(size, |col, row| of(col, row).agreement[(col, row)]),
        samples: Plane::from_fn(size, |col, row| of(col, row).samples[(col, row)]),
    })
}

/// Evidence of each pixel about the planes, 0 to 1: it grows with the number of frames that show the pixel along every plane.
fn evidence(plates: &[Plate]) -> Plane {
    Plane::from_fn(plates[0].colors.size(), |col, row| {
        let of = |plate: &Plate| 1.0 - 1.0 / plate.samples[(col, row)].max(1.0);
        plates.iter().map(of).fold(1.0, f32::min).max(MIN_EVIDENCE)
    })
}

/// Data cost of assigning each pixel to the plane of a plate, weighted by its evidence.
fn cost(plate: &Plate, evidence: &Plane) -> Plane {
    Plane::from_fn(plate.colors.size(), |col, row| {
        let cost = if plate.seen.at(col, row) > 0.0 {
            plate.spread[(col, row)] + DISAGREEMENT * (1.0 - plate.agreement[(col, row)])
        } else {
            UNSEEN
        };
        evidence[(col, row)] * cost
    })
}

/// Means over windows of `2 * radius + 1` pixels a side, cut at the border.
fn averaged(plane: &Plane, radius: usize) -> Plane {
    let (width, height) = (plane.width(), plane.height());
    let window =
        |at: usize, length: usize| at.saturating_sub(radius)..(at + radius + 1).min(length);
    let mut across = Plane::new(plane.size(), 0.0);
    across
        .par_rows_mut()
        .zip(plane.par_rows())
        .for_each(|(out, row)| {
            let mut sums = vec![0.0f64; width + 1];
            for (col, &value) in row.iter().enumerate() {
                sums[col + 1] = sums[col] + f64::from(value);
            }
            for (col, out) in out.iter_mut().enumerate() {
                let range = window(col, width);
                *out = ((sums[range.end] - sums[range.start]) / range.len() as f64) as f32;
            }
        });
    let mut result = Plane::new(plane.size(), 0.0);
    result.for_each_row(|row, out| {
        let range = window(row, height);
        let scale = 1.0 / range.len() as f32;
        for row in range {
            for (out, value) in out.iter_mut().zip(across.row(row)) {
                *out += scale * value;
            }
        }
    });
    result
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{PlateModes, PlateSamples, ShotFrame};
    use glam::DVec2;
    use ravec_planar::Homography;
    use ravec_progress::Progress;
    use ravec_raster::Size;

    const SIZE: (usize, usize) = (120, 90);

    fn texture(x: f64, y: f64) -> [f32; 3] {
        let wave = 0.12 * (0.7 * x).sin() + 0.08 * (0.45 * y + 0.3 * x).cos();
        [0.5 + wave, 0.45 - wave, 0.5 + 0.5 * wave].map(|value| value as f32)
    }

    /// Row at which the floor begins: it fills a fifth of the frame.
    const FLOOR: usize = 72;

    /// A wall above and a floor below, which slide at two speeds, while the light changes.
    fn frame(index: usize) -> Colors {
        Image::from_fn(Size::new(SIZE.0, SIZE.1).unwrap(), |col, row| {
            let speed = if row < FLOOR { 0.5 } else { 1.5 };
            let color = texture(col as f64 + speed * index as f64, row as f64);
            color.map(|value| value * (1.0 - 0.012 * index as f32))
        })
    }

    /// Plates along planes that move at these speeds.
    fn plates(speeds: &[f64]) -> Vec<Plate> {
        let map = |speed: f64, index: usize| {
            Homography::from_translation(DVec2::new(-speed * index as f64, 0.0)).unwrap()
        };
        let size = Size::new(SIZE.0, SIZE.1).unwrap();
        let along = |index: usize, take: &mut dyn FnMut(&[Option<ShotFrame<'_>>])| {
            let colors = frame(index);
            let maps: Vec<_> = speeds.iter().map(|&speed| map(speed, index)).collect();
            let frames = maps.iter().map(|map| {
                Some(ShotFrame {
                    is_reference: index == 0,
                    ..ShotFrame::new(&colors, map)
                })
            });
            take(&frames.collect::<Vec<_>>());
        };
        let samples = PlateSamples::new(size, 0, Some(12)).unwrap();
        let mut samples = vec![samples.sharing_memory(speeds.len()); speeds.len()];
        for index in 0..12 {
            along(index, &mut |frames| {
                PlateSamples::add_planes(&mut samples, frames).unwrap();
            });
        }
        let mut modes = PlateSamples::modes_of_planes(samples, &Progress::none()).unwrap();
        for index in 0..12 {
            along(index, &mut |frames| {
                PlateModes::add_planes(&mut modes, frames).unwrap();
            });
        }
        modes.into_iter().map(PlateModes::plate).collect()
    }

    #[test]
    fn each_pixel_belongs_to_the_plane_that_it_moves_with() {
        let plates = plates(&[0.5, 1.5]);
        let regions = plate_regions(&plates).unwrap();
        let mut wrong = 0;
        for row in 0..SIZE.1 {
            for col in 0..SIZE.0 - 18 {
                let truth = u8::from(row >= FLOOR);
                let near = row.abs_diff(FLOOR) < 4;
                wrong += usize::from(regions[(col, row)] != truth && !near);
            }
        }
        assert!(wrong < 30, "{wrong} pixels");
        let joined = joined_plate(&plates, &regions).unwrap();
        for row in (0..SIZE.1).filter(|row| row.abs_diff(FLOOR) > 4) {
            for col in 2..SIZE.0 - 20 {
                let (found, truth) = (joined.colors[(col, row)], texture(col as f64, row as f64));
                let error = (0..3)
                    .map(|c| (found[c] - truth[c]).abs())
                    .fold(0.0, f32::max);
                assert!(error < 0.03, "{col}, {row}: {found:?} {truth:?}");
            }
        }
    }

    #[test]
    fn what_no_plane_has_is_refused() {
        assert_eq!(plate_regions(&[]), Err(VideoEditError::NoFrames));
        let plates = plates(&[0.5]);
        let mut regions = plate_regions(&plates).unwrap();
        assert!(regions.pixels().iter().all(|&index| index == 0));
        regions[(3, 4)] = 1;
        assert_eq!(
            joined_plate(&plates, &regions).unwrap_err(),
            VideoEditError::NoFrames
        );
    }
}

//! A picture as seen from other sides.
//!
//! Features know turns and sizes, but not that a circle becomes an ellipse when a plane is seen at a slant. So the slant is
//! simulated: the picture is narrowed along some directions, as if the camera had moved around it, and features are found
//! there as well.
//!
//! Source: Morel and Yu, "ASIFT: a new framework for fully affine invariant image comparison", 2009. We differ in that a view
//! of a long, narrow picture is made tile by tile: the canvas of a narrow strip of length l that lies aslant has l² / 4
//! pixels, nearly all of them beyond the strip.
//!
//! Guarantees: a view has at most [`MAX_GROWTH`] times the pixels of the picture, all its tiles together.
//! Cost: the area of all views, as many times the cost of features.

use crate::features::{FeatureParams, Features, MIN_SIDE_PX, STEPS};
use glam::{DMat2, DVec2, dvec2};
use ravec_progress::{Cancelled, Progress};
use ravec_raster::{Plane, Rect, Size};
use rayon::prelude::*;
use std::ops::Range;

/// Pixels of a view for each pixel of the picture, at most; views with more are cut into tiles. A view aslant of a picture
/// with sides of a : 1 has (a + 1)² / 4a: 1 for a square, 1.1 for 16 : 9, 4 for 14 : 1. Less would cut ordinary panoramas,
/// more costs more.
const MAX_GROWTH: usize = 4;

/// The length of a tile without what it shares with its neighbors, in shorter sides of the picture. It goes on by one shorter
/// side at both ends: the windows of larger features reach beyond the picture anyway. With 3, tiles have 3 times the pixels
/// of the picture, with 2 or 6 half a time more.
const OWN_SIDES: usize = 3;

/// Pixels of the tiles that are worked on at a time: enough for all threads where tiles are small, and no more memory than
/// one tile takes where they are large.
const BATCH_PIXELS: usize = 1 << 20;

/// A slanted view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct View {
    /// Factor by which the picture is narrower, at least 1.
    tilt: f64,
    /// The direction along which it is narrowed, in eighths of a full turn from x towards y.
    eighths: i32,
}

impl View {
    /// Narrowed by two along four directions. Together with features' own tolerance of slants (about two as well) in both
    /// pictures, it covers relative slants up to eight or so.
    pub(crate) const TILTS: &'static [Self] = &[
        Self {
            tilt: 2.0,
            eighths: 0,
        },
        Self {
            tilt: 2.0,
            eighths: 1,
        },
        Self {
            tilt: 2.0,
            eighths: 2,
        },
        Self {
            tilt: 2.0,
            eighths: 3,
        },
    ];

    /// The canvas of a region of the picture from this side; none if it would be too large for a picture.
    fn frame(self, region: Rect) -> Option<Frame> {
        let angle = f64::from(self.eighths) * std::f64::consts::FRAC_PI_4;
        let (along, across) = (DVec2::from_angle(angle), DVec2::from_angle(angle).perp());
        let extent = dvec2(region.width as f64, region.height as f64);
        // the region's extent along and across
        let (long, wide) = (along.abs().dot(extent), across.abs().dot(extent));
        let cells = |length: f64| (length.ceil() as usize).max(1);
        let size = Size::new(cells(long / self.tilt), cells(wide)).ok()?;
        let linear = DMat2::from_cols(along * self.tilt, across);
        let half = 0.5 * dvec2(size.width() as f64, size.height() as f64);
        let first = dvec2(region.col as f64, region.row as f64);
        Some(Frame {
            size,
            along,
            linear,
            offset: 0.5 * extent + first - linear * half,
        })
    }

    /// The tiles of which the view of a picture consists: one, if that has at most [`MAX_GROWTH`] times as many pixels as
    /// the picture; else as many as it takes; none for pictures so narrow that they have no features.
    fn tiles(self, picture: Size) -> Vec<Tile> {
        let whole = Rect::of(picture);
        if let Some(frame) = self.frame(whole)
            && frame.size.pixels() <= MAX_GROWTH * picture.pixels()
        {
            return vec![Tile {
                frame,
                own: f64::NEG_INFINITY..f64::INFINITY,
            }];
        }
        let wide = picture.width() >= picture.height();
        let (length, side) = if wide {
            (picture.width(), picture.height())
        } else {
            (picture.height(), picture.width())
        };
        if side < MIN_SIDE_PX {
            return Vec::new();
        }
        let count = length.div_ceil(OWN_SIDES * side);
        let border = |index: usize| index * length / count;
        (0..count)
            .filter_map(|index| {
                let (first, end) = (border(index), border(index + 1));
                let from = first.saturating_sub(side);
                let to = (end + side).min(length);
                let region = if wide {
                    Rect::new(from, 0, to - from, side)
                } else {
                    Rect::new(0, from, side, to - from)
                };
                let frame = self.frame(region)?;
                // what rounding puts beyond the ends of the picture belongs to the last tiles
                let low = if index > 0 {
                    first as f64
                } else {
                    f64::NEG_INFINITY
                };
                let high = if index + 1 < count {
                    end as f64
                } else {
                    f64::INFINITY
                };
                Some(Tile {
                    frame,
                    own: low..high,
                })
            })
            .collect()
    }

    /// The picture from this side, as far as a frame shows it.
    fn seen(self, plane: &Plane, frame: &Frame) -> Plane {
        let Frame {
            along,
            linear,
            offset,
            ..
        } = *frame;
        // a Gaussian along the narrowed direction, of the deviation that makes up for the coarser pixels
        let sigma = 0.8 * (self.tilt * self.tilt - 1.0).sqrt();
        let reach = (2.5 * sigma).ceil() as i32;
        let taps: Vec<(DVec2, f32)> = (-reach..=reach)
            .map(|k| {
                (
                    along * f64::from(k),
                    (-0.5 * (f64::from(k) / sigma).powi(2)).exp() as f32,
                )
            })
            .collect();
        let sum: f32 = taps.iter().map(|tap| tap.1).sum();
        let mut view = Plane::new(frame.size, 0.0);
        view.for_each_row(|row, line| {
            for (col, out) in line.iter_mut().enumerate() {
                let at = linear * dvec2(col as f64 + 0.5, row as f64 + 0.5) + offset;
                // beyond the corners of a turned picture there is its border, which has no features
                let total: f32 = taps
                    .iter()
                    .map(|(step, weight)| weight * plane.bilinear(at + *step))
                    .sum();
                *out = total / sum;
            }
        });
        view
    }

    /// The features of the view, those of all its tiles together at most as many as one view may have.
    fn features(
        self,
        plane: &Plane,
        params: &FeatureParams,
        progress: &Progress,
    ) -> Result<Features, Cancelled> {
        let tiles = self.tiles(plane.size());
        let phase = progress.phase("features", STEPS * tiles.len() as u64);
        let largest = tiles.iter().map(|tile| tile.frame.size.pixels()).max();
        let together = (BATCH_PIXELS / largest.unwrap_or(1)).max(1);
        let mut all = Features::default();
        for batch in tiles.chunks(together) {
            let found: Vec<Features> = batch
                .par_iter()
                .map(|tile| {
                    if tile.frame.size.width().min(tile.frame.size.height()) < MIN_SIDE_PX {
                        phase.advance(STEPS);
                        return Ok(Features::default());
                    }
                    let seen = self.seen(plane, &tile.frame);
                    let found = Features::find(&seen, params, progress, &phase)?;
                    Ok(tile.placed(found, plane.size()))
                })
                .collect::<Result<_, Cancelled>>()?;
            for mut found in found {
                all.points.append(&mut found.points);
                all.descriptors.append(&mut found.descriptors);
            }
            if tiles.len() > 1 {
                all.keep_strongest(params.max_features);
            }
        }
        Ok(all)
    }
}

/// The canvas of a view, and how to get back: a point p of the view is at `linear` · p + `offset` in the picture.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Frame {
    size: Size,
    /// The direction along which the picture is narrowed.
    along: DVec2,
    linear: DMat2,
    offset: DVec2,
}

/// A part of a view.
#[derive(Debug, Clone, PartialEq)]
struct Tile {
    frame: Frame,
    /// The stretch of the picture's longer side whose features are taken from this tile.
    own: Range<f64>,
}

impl Tile {
    /// Features of the tile in pixels of the picture, without those outside of it and those of other tiles.
    fn placed(&self, found: Features, picture: Size) -> Features {
        let Frame { linear, offset, .. } = self.frame;
        let (width, height) = (picture.width() as f64, picture.height() as f64);
        let scale = linear.determinant().abs().sqrt();
        let mut placed = Features::default();
        for (mut point, descriptor) in found.points.into_iter().zip(found.descriptors) {
            let direction = linear * DVec2::from_angle(point.angle_rad);
            point.at = linear * point.at + offset;
            point.sigma_px *= scale;
            point.angle_rad = direction.to_angle().rem_euclid(std::f64::consts::TAU);
            let inside =
                point.at.cmpge(DVec2::ZERO).all() && point.at.x <= width && point.at.y <= height;
            let along = if width >= height {
                point.at.x
            } else {
                point.at.y
            };
            if inside && self.own.contains(&along) {
                placed.points.push(point);
                placed.descriptors.push(descriptor);
            }
        }
        placed
    }
}

/// The features of a picture together with those of its views, all in the picture's pixels.
pub(crate) fn features_of_views(
    plane: &Plane,
    mut features: Features,
    views: &[View],
    params: &FeatureParams,
    progress: &Progress,
) -> Result<Features, Cancelled> {
    for view in views {
        let mut found = view.features(plane, params, progress)?;
        features.points.append(&mut found.points);
        features.descriptors.append(&mut found.descriptors);
    }
    Ok(features)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use ravec_scenes::{Seed, texture::fractal};

    fn size(width: usize, height: usize) -> Size {
        Size::new(width, height).unwrap()
    }

    fn texture(size: Size) -> Plane {
        Plane::from_fn(size, |col, row| {
            let at = dvec2(col as f64, row as f64) / 40.0;
            (0.5 + 0.35 * fractal(at, 0.02, 5, Seed(1))) as f32
        })
    }

    /// Sides from one pixel up, those of long strips as likely as those of squares.
    fn side() -> impl Strategy<Value = usize> {
        (0.0f64..24.2).prop_map(|log| log.exp2() as usize)
    }

    proptest! {
        #[test]
        fn views_of_any_size_have_pixels_in_proportion_to_the_picture(width in side(), height in side()) {
            let picture = size(width, height.min(400_000_000 / width).max(1));
            for view in View::TILTS {
                let tiles = view.tiles(picture);
                let pixels: usize = tiles.iter().map(|tile| tile.frame.size.pixels()).sum();
                prop_assert!(
                    pixels <= MAX_GROWTH * picture.pixels(),
                    "{picture}: {pixels} pixels in {} tiles", tiles.len()
                );
                // no place is in two tiles or in none, unless the picture is too narrow for features
                if picture.width().min(picture.height()) >= MIN_SIDE_PX {
                    prop_assert_eq!(tiles[0].own.start, f64::NEG_INFINITY);
                    prop_assert_eq!(tiles[tiles.len() - 1].own.end, f64::INFINITY);
                }
                for pair in tiles.windows(2) {
                    prop_assert_eq!(pair[0].own.end, pair[1].own.start);
                }
            }
        }

        #[test]
        fn up_to_thirteen_to_one_there_is_one_tile(side in MIN_SIDE_PX..4000, aspect in 1.0f64..13.0) {
            let longer = (side as f64 * aspect) as usize;
            for picture in [size(longer, side), size(side, longer)] {
                for view in View::TILTS {
                    prop_assert_eq!(view.tiles(picture).len(), 1, "{}", picture);
                }
            }
        }
    }

    #[test]
    fn a_strip_is_cut_and_a_line_has_no_views_aslant() {
        let aslant = View::TILTS[1];
        assert_eq!(aslant.tiles(size(3000, 100)).len(), 10);
        assert_eq!(aslant.tiles(size(100, 3001)).len(), 11);
        for narrow in [size(65_535, 1), size(1, 65_535), size(20_000_000, 1)] {
            assert!(aslant.tiles(narrow).is_empty());
            assert_eq!(View::TILTS[0].tiles(narrow).len(), 1);
        }
    }

    /// Tiles see what the whole view sees.
    #[test]
    fn tiles_have_the_features_of_the_whole_view() {
        for picture in [size(900, 60), size(60, 900)] {
            let plane = texture(picture);
            let params = FeatureParams {
                max_features: 100_000,
                ..FeatureParams::default()
            };
            let progress = Progress::none();
            for view in [View::TILTS[1], View::TILTS[3]] {
                let tiles = view.tiles(picture);
                assert!(tiles.len() > 3);
                let tiled = view.features(&plane, &params, &progress).unwrap();
                let whole = Tile {
                    frame: view.frame(Rect::of(picture)).unwrap(),
                    own: f64::NEG_INFINITY..f64::INFINITY,
                };
                let seen = view.seen(&plane, &whole.frame);
                let found = Features::detect(&seen, &params, &progress).unwrap();
                let found = whole.placed(found, picture);
                let again = found
                    .points
                    .iter()
                    .filter(|a| {
                        tiled.points.iter().any(|b| {
                            a.at.distance(b.at) < 0.5 * a.sigma_px
                                && (a.sigma_px / b.sigma_px).ln().abs() < 0.2
                        })
                    })
                    .count();
                let (of, count) = (found.points.len(), tiled.points.len());
                // pixels of a tile lie between those of the whole: weak features come and go, as in a picture that is
                // moved by a part of a pixel
                assert!(of > 100 && 5 * again >= 4 * of, "{again} of {of}");
                assert!(count.abs_diff(of) * 10 <= of, "{count} for {of}");
            }
        }
    }

    #[test]
    fn all_tiles_together_keep_the_strongest_features() {
        let plane = texture(size(1500, 60));
        let few = FeatureParams {
            max_features: 40,
            ..FeatureParams::default()
        };
        let view = View::TILTS[1];
        let found = view.features(&plane, &few, &Progress::none()).unwrap();
        assert_eq!((found.points.len(), found.descriptors.len()), (40, 40));
        let all = FeatureParams {
            max_features: 100_000,
            ..few
        };
        let all = view.features(&plane, &all, &Progress::none()).unwrap();
        let weakest = found.points[39].response.abs();
        let stronger = all.points.iter().filter(|p| p.response.abs() > weakest);
        assert!(stronger.count() < 40);
    }
}

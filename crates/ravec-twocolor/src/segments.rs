//! Straight stretches of edges, from the lines of two-color pixels.
//!
//! ```text
//! fit two-color pixels twice, the second time shifted by half a block, so that an edge between two blocks is within one
//! start at the line of most contrast; add neighbors that lie on it, and fit it again to all of them, until none is left
//! ```
//!
//! Retargeting finds its straight runs by contrast along strips of 64 pixels instead: it needs the two borders of strokes that
//! are narrower than a block, and lines in texture as strong as they are, both of which single blocks lose.

use crate::{BlockField as _, FitError, FitParams, TwoColorField};
use glam::{DMat2, DVec2, dvec2};
use ravec_progress::{Cancelled, Progress};
use ravec_raster::{Color, Image, LinearRgb, Resample, ResizeFilter, Segment, Size, resize};
use std::collections::HashMap;

/// The side of a block in pixels: smaller ones see noise, larger ones mix edges.
const BLOCK: usize = 8;

/// Larger pictures are reduced to this side first: more pixels show more texture, not more walls.
const MAX_SIDE: usize = 1600;

/// The least difference of both colors, in Oklab: a step that the eye sees on plain ground.
const MIN_CONTRAST: f32 = 0.03;

/// Largest unexplained share of a block's difference: more is texture rather than an edge.
const MAX_ERROR: f32 = 0.08;

/// Largest distance of a neighbor from the line so far, in pixels, and largest turn of its direction, in radians.
const MAX_OFF_PX: f64 = 1.0;
const MAX_TURN: f64 = 0.2;

/// The shortest stretch in pixels of the reduced picture: three blocks.
const MIN_LENGTH_PX: f64 = 24.0;

/// The line of a block within it.
struct Chord {
    ends: [DVec2; 2],
    contrast: f32,
}

impl Chord {
    fn middle(&self) -> DVec2 {
        0.5 * (self.ends[0] + self.ends[1])
    }

    fn direction(&self) -> DVec2 {
        (self.ends[1] - self.ends[0]).normalize_or_zero()
    }
}

/// The straight edges of a picture, the longest first.
///
/// Coordinates are in pixels of `image`, x right, y down, pixel centers at half-integers. A picture whose longer side exceeds
/// 1600 pixels is reduced to that side first; lengths and tolerances below are in pixels of the reduced picture. Alpha is
/// ignored.
///
/// ```
/// use ravec_progress::Progress;
/// use ravec_raster::{Image, Size, Srgb};
/// use ravec_twocolor::line_segments;
///
/// // a dark wall on the left of column 40
/// let wall = Image::from_fn(Size::new(96, 64)?, |col, _| Srgb([if col < 40 { 60u8 } else { 200 }; 3]));
/// let edges = line_segments(&wall, &Progress::none())?;
/// assert_eq!(edges.len(), 1);
/// assert!(edges[0].ends.iter().all(|end| (end.x - 40.0).abs() < 0.1));
/// assert!(edges[0].length_px() > 60.0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// Guarantees: each segment is at least 24 pixels long and made of blocks whose colors differ by 0.03 in Oklab or more;
/// each block's line was within a pixel of the segment and turned by less than 0.2 radians from it when the block was
/// added; equal pictures give equal bytes on any number of threads. Does not guarantee: that an edge is one segment
/// (what covers it, or a block that shows texture, divides it), that the borders of strokes narrower than a block of 8
/// pixels are distinguished, or that a gentle curve has none.
///
/// Cost: two fits of two-color pixels to at most 1600 × 1600 pixels; the linking is a small part of it.
///
/// # Errors
/// [`Cancelled`] soon after `progress` is cancelled.
pub fn line_segments<P: Color + Resample>(
    image: &Image<P>,
    progress: &Progress,
) -> Result<Vec<Segment>, Cancelled> {
    let longest = image.width().max(image.height());
    let reduced: Image<LinearRgb> = if longest > MAX_SIDE {
        let side = |length: usize| (length * MAX_SIDE).div_ceil(longest).max(1);
        // both sides are at least 1 and at most those of the picture
        let size = Size::new(side(image.width()), side(image.height())).unwrap_or(image.size());
        resize(image, size, ResizeFilter::Lanczos3).convert()
    } else {
        image.convert()
    };
    let scale = dvec2(
        image.width() as f64 / reduced.width() as f64,
        image.height() as f64 / reduced.height() as f64,
    );
    // blocks of 8 pixels can always be fitted, so that only a cancellation is left
    let blocks = |image: &Image<LinearRgb>, corner: DVec2| {
        chords(image, corner, progress).map_err(|_: FitError| Cancelled)
    };
    let mut chords = blocks(&reduced, DVec2::ZERO)?;
    let half = BLOCK / 2;
    if let Ok(shifted) = reduced.crop(half, half, reduced.size()) {
        chords.extend(blocks(&shifted, DVec2::splat(half as f64))?);
    }
    let mut found = linked(&chords, progress)?;
    for segment in &mut found {
        segment.ends = segment.ends.map(|end| end * scale);
    }
    found.sort_by(|a, b| b.length_px().total_cmp(&a.length_px()));
    Ok(found)
}

/// The lines of all blocks that have a clear one.
fn chords(
    image: &Image<LinearRgb>,
    corner: DVec2,
    progress: &Progress,
) -> Result<Vec<Chord>, FitError> {
    let params = FitParams {
        block_px: BLOCK,
        ..FitParams::default()
    };
    let mut field = TwoColorField::fit(image, &params, progress)?;
    field.refine_lines(image, progress)?;
    let size = field.image_size();
    let mut chords = Vec::new();
    for block in field.placed_blocks() {
        let contrast = block.pixel.contrast();
        let clear =
            contrast >= MIN_CONTRAST && block.pixel.error <= MAX_ERROR * contrast * contrast;
        let Some(line) = block.line_in_image().filter(|_| clear) else {
            continue;
        };
        let rect = block.rect(size);
        let low = dvec2(rect.col as f64, rect.row as f64);
        let high = dvec2(rect.right() as f64, rect.bottom() as f64);
        if let Some(ends) = within(line.normal * line.offset_px, line.normal.perp(), low, high) {
            chords.push(Chord {
                ends: ends.map(|end| end + corner),
                contrast,
            });
        }
    }
    Ok(chords)
}

/// The part of the line through `at` that lies in a rectangle, if it is longer than a pixel.
fn within(at: DVec2, direction: DVec2, low: DVec2, high: DVec2) -> Option<[DVec2; 2]> {
    let (mut first, mut last) = (f64::NEG_INFINITY, f64::INFINITY);
    for axis in 0..2 {
        if direction[axis].abs() < 1e-12 {
            if !(low[axis]..=high[axis]).contains(&at[axis]) {
                return None;
            }
            continue;
        }
        let a = (low[axis] - at[axis]) / direction[axis];
        let b = (high[axis] - at[axis]) / direction[axis];
        first = first.max(a.min(b));
        last = last.min(a.max(b));
    }
    (last - first > 1.0).then(|| [first, last].map(|t| at + t * direction))
}

/// Sums of points, for the line of least squares through them.
#[derive(Default)]
struct Points {
    count: f64,
    sum: DVec2,
    squares: DMat2,
}

impl Points {
    fn add(&mut self, chord: &Chord) {
        for end in chord.ends {
            self.count += 1.0;
            self.sum += end;
            self.squares += DMat2::from_cols(end * end.x, end * end.y);
        }
    }

    /// A point of the line and its direction, of length 1.
    fn line(&self) -> (DVec2, DVec2) {
        let mean = self.sum / self.count;
        let spread =
            self.squares * self.count.recip() - DMat2::from_cols(mean * mean.x, mean * mean.y);
        // the axis of the larger spread
        let angle = 0.5 * (2.0 * spread.x_axis.y).atan2(spread.x_axis.x - spread.y_axis.y);
        (mean, DVec2::from_angle(angle))
    }
}

/// Chords that lie on one line next to one another, as stretches of it.
fn linked(chords: &[Chord], progress: &Progress) -> Result<Vec<Segment>, Cancelled> {
    let cell = |at: DVec2| {
        let cell = (at / BLOCK as f64).floor();
        (cell.x as i32, cell.y as i32)
    };
    let mut near: HashMap<(i32, i32), Vec<usize>> = HashMap::new();
    for (index, chord) in chords.iter().enumerate() {
        near.entry(cell(chord.middle())).or_default().push(index);
    }
    let mut order: Vec<usize> = (0..chords.len()).collect();
    order.sort_by(|&a, &b| {
        chords[b]
            .contrast
            .total_cmp(&chords[a].contrast)
            .then(a.cmp(&b))
    });
    let mut taken = vec![false; chords.len()];
    let mut segments = Vec::new();
    for (count, start) in order.into_iter().enumerate() {
        if count % 1024 == 0 {
            progress.check()?;
        }
        if taken[start] {
            continue;
        }
        taken[start] = true;
        let mut points = Points::default();
        points.add(&chords[start]);
        let mut members = vec![start];
        let mut open = 0;
        while open < members.len() {
            let (col, row) = cell(chords[members[open]].middle());
            open += 1;
            for beside in (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (col + dx, row + dy))) {
                for &next in near.get(&beside).map_or(&[][..], Vec::as_slice) {
                    let (at, direction) = points.line();
                    let chord = &chords[next];
                    let off = |end: DVec2| direction.perp_dot(end - at).abs();
                    let fits = direction.perp_dot(chord.direction()).abs() < MAX_TURN
                        && chord.ends.iter().all(|&end| off(end) < MAX_OFF_PX);
                    if fits && !taken[next] {
                        taken[next] = true;
                        points.add(chord);
                        members.push(next);
                    }
                }
            }
        }
        let (at, direction) = points.line();
        let along = members
            .iter()
            .flat_map(|&member| chords[member].ends)
            .map(|end| (end - at).dot(direction));
        let (low, high) = along.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), t| {
            (low.min(t), high.max(t))
        });
        if high - low >= MIN_LENGTH_PX {
            segments.push(Segment {
                ends: [at + low * direction, at + high * direction],
            });
        }
    }
    Ok(segments)
}

#[cfg(test)]
mod tests {
    use super::*;
    use ravec_raster::{LinearRgba, PremulLinearRgba};
    use ravec_scenes::Seed;

    #[test]
    fn the_sides_of_a_square_are_found_to_a_fraction_of_a_pixel() {
        // turned, so that no side follows the blocks; drawn by exact coverage
        let middle = dvec2(100.3, 90.6);
        let normals = [0.3f64, 0.3 + std::f64::consts::FRAC_PI_2].map(DVec2::from_angle);
        let noise = Seed(3);
        let image: Image<PremulLinearRgba> =
            Image::from_fn(Size::new(200, 180).unwrap(), |col, row| {
                let at = dvec2(col as f64 + 0.5, row as f64 + 0.5);
                let share: f64 = normals
                    .iter()
                    .flat_map(|&normal| [normal, -normal])
                    .map(|normal| (60.5 - normal.dot(at - middle)).clamp(0.0, 1.0))
                    .product();
                let value = 0.2 + 0.4 * share + 0.01 * noise.gaussian(col as i64, row as i64, 0);
                PremulLinearRgba::from_linear(LinearRgba([
                    value as f32,
                    value as f32,
                    value as f32,
                    1.0,
                ]))
            });
        let found = line_segments(&image, &Progress::none()).unwrap();
        assert_eq!(found.len(), 4, "{found:?}");
        for segment in &found {
            assert!((95.0..125.0).contains(&segment.length_px()), "{segment:?}");
            for end in segment.ends {
                let off = normals.map(|normal| (normal.dot(end - middle).abs() - 60.0).abs());
                assert!(off[0].min(off[1]) < 0.3, "{segment:?}");
            }
        }
    }

    #[test]
    fn small_even_and_large_pictures_have_the_edges_they_have() {
        let even = Image::new(
            Size::new(5, 3).unwrap(),
            PremulLinearRgba([0.5, 0.5, 0.5, 1.0]),
        );
        assert!(line_segments(&even, &Progress::none()).unwrap().is_empty());
        // a step in a picture that is reduced by 1.25
        let step = Image::from_fn(Size::new(2000, 60).unwrap(), |_, row| {
            let value = if row < 31 { 0.1 } else { 0.6 };
            PremulLinearRgba([value, value, value, 1.0])
        });
        let found = line_segments(&step, &Progress::none()).unwrap();
        assert!(found[0].length_px() > 1900.0);
        assert!(
            found[0].ends.iter().all(|end| (end.y - 31.0).abs() < 0.5),
            "{:?}",
            found[0]
        );
        let progress = Progress::none();
        progress.cancel();
        assert!(line_segments(&step, &progress).is_err());
    }
}

//! Smooth paths of cameras and planes.
//!
//! ```text
//! x: how far the content at the frame's corners has moved since the shot began, summed from frame to frame
//! y: minimize Σ w (y − x)² + λ Σ (second differences of y)²
//! each frame is moved by y − x at its corners
//! twice: z: how far the output has moved beyond y, summed from frame to frame; remove what is fast in z the same way
//! while a border would show beyond the largest crop: raise w there; in the end scale y − x down where it still would
//! ```
//!
//! Sums of small motions stay well-behaved where maps to a distant reference have their horizon in the picture. Corners are eight
//! signals with the same matrix of five diagonals.
//!
//! λ is such that a motion to and fro of the period `strength_secs` keeps half of its amplitude; of one n times as fast remains
//! 1 / (1 + n⁴). Constant speed is kept exactly, also at the ends of a shot.
//!
//! Sources: Whittaker, "On a new method of graduation", 1923; the path of a crop inside the frame is that of Grundmann, Kwatra and
//! Essa, "Auto-directed video stabilization with robust L1 optimal camera paths", 2011. We differ in squares instead of absolute
//! values, which need no linear program and have no kinks.
//!
//! Guarantees: still clips and constant motion give the identity, to rounding; the crop is covered by every frame, and is no larger
//! than allowed. Does not guarantee: a smooth path where the limit of the crop forbids it. Cost: O(frames).

use crate::camera::FrameMotion;
use crate::homography::Homography;
use crate::track::offsets::{Vector, points_of, vector_of};
use crate::track::record::{Track, TrackState};
use glam::{DVec2, dvec2};
use ravec_raster::Size;
use serde::{Deserialize, Serialize};

#[cfg(test)]
mod tests;

/// Parameters of [`smooth_path`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct SmoothParams {
    /// Motion faster than this period is removed, in seconds, 0 to 60 (default 2). More keeps less of the camera's own motion and
    /// needs a larger crop; 0 changes nothing.
    pub strength_secs: f64,
    /// Largest share of the width and of the height that is cut off on each side, 0 to 0.4 (default 0.1). Less keeps more of the
    /// picture and more of the shake.
    pub max_crop: f64,
}

impl Default for SmoothParams {
    fn default() -> Self {
        Self {
            strength_secs: 2.0,
            max_crop: 0.1,
        }
    }
}

/// Motion of one frame.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PathFrame {
    /// Map to this frame from a reference that is the same for all frames of a shot; nothing where it is unknown.
    pub frame_from_reference: Option<Homography>,
    /// The frame is the first after a cut.
    pub cut: bool,
}

/// A smooth path.
#[derive(Debug, Clone, PartialEq)]
pub struct SmoothPath {
    /// Map from each frame to its place in the output, which has the size of the frames.
    pub output_from_frame: Vec<Homography>,
    /// Share of the width and of the height to cut off on each side of the output, so that no border shows: the least for which
    /// all frames cover the rest.
    pub crop: f64,
    /// Number of frames that the limit of the crop keeps from their smooth place.
    pub limited: usize,
    /// Root mean square of the changes of speed from frame to frame at the corners, in pixels, of the input.
    pub jitter_before_px: f64,
    /// The same for the output.
    pub jitter_after_px: f64,
    size: Size,
}

/// Why there is no smooth path.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SmoothError {
    /// A frame rate that is none.
    #[error("a frame rate of {fps} frames a second; it must lie between 0.1 and 1000")]
    FrameRate {
        /// Frames a second.
        fps: f64,
    },
    /// A strength out of range.
    #[error("a strength of {strength_secs} seconds; it must lie between 0 and 60")]
    Strength {
        /// The strength.
        strength_secs: f64,
    },
    /// A crop out of range.
    #[error("a crop of {max_crop} on each side; it must lie between 0 and 0.4")]
    Crop {
        /// The largest crop.
        max_crop: f64,
    },
}

/// Attempts to keep the path inside the crop by weights, and the factor of the weights of frames outside.
const ATTEMPTS: usize = 16;
const FIRMER: f64 = 3.0;

/// Rounds in which the fast part of what small motions do not quite add up to is removed. Each leaves its square.
const REFINEMENTS: usize = 2;

/// Period, in frames, beyond which λ would exceed the digits of a double.
const MAX_PERIOD: f64 = 4000.0;

impl Track {
    /// The motion of the plane, for [`smooth_path`]: unknown where the plane is lost.
    pub fn path_frames(&self) -> Vec<PathFrame> {
        let one = |state: TrackState, map: Homography| PathFrame {
            frame_from_reference: (state != TrackState::Lost).then_some(map),
            cut: false,
        };
        self.frames
            .iter()
            .map(|frame| one(frame.state, frame.frame_from_reference))
            .collect()
    }
}

/// The motion of a camera. Cuts are kept; where the motion is unreliable, its fallback counts.
impl From<&FrameMotion> for PathFrame {
    fn from(motion: &FrameMotion) -> Self {
        Self {
            frame_from_reference: Some(motion.frame_from_shot),
            cut: motion.cut,
        }
    }
}

/// The smooth path of a clip of `size` at `fps` frames a second, shot by shot. The crop is that of the whole clip.
///
/// ```
/// use glam::dvec2;
/// use ravec_planar::Homography;
/// use ravec_planar::track::{PathFrame, SmoothParams, smooth_path};
/// use ravec_raster::Size;
///
/// // a pan with a shake of 3 pixels from frame to frame
/// let frames: Vec<PathFrame> = (0..100)
///     .map(|at| {
///         let x = 2.0 * f64::from(at) + if at % 2 == 0 { 3.0 } else { 0.0 };
///         let moved = Homography::from_translation(dvec2(x, 0.0)).ok();
///         PathFrame { frame_from_reference: moved, cut: false }
///     })
///     .collect();
/// let path = smooth_path(&frames, Size::new(640, 480)?, 25.0, &SmoothParams::default())?;
/// assert!(path.jitter_after_px < 0.01 * path.jitter_before_px);
/// assert!(path.crop < 0.01);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`SmoothError`].
pub fn smooth_path(
    frames: &[PathFrame],
    size: Size,
    fps: f64,
    params: &SmoothParams,
) -> Result<SmoothPath, SmoothError> {
    let SmoothParams {
        strength_secs,
        max_crop,
    } = *params;
    if !(0.1..=1000.0).contains(&fps) {
        return Err(SmoothError::FrameRate { fps });
    }
    if !(0.0..=60.0).contains(&strength_secs) {
        return Err(SmoothError::Strength { strength_secs });
    }
    if !(0.0..=0.4).contains(&max_crop) {
        return Err(SmoothError::Crop { max_crop });
    }
    let frame = Frame::new(size);
    let period = (fps * strength_secs).min(MAX_PERIOD);
    let mut shifts = Vec::with_capacity(frames.len());
    let mut limited = 0;
    let mut start = 0;
    while start < frames.len() {
        let end = (start + 1..frames.len())
            .find(|&at| frames[at].cut)
            .unwrap_or(frames.len());
        for shot in unbroken(&frames[start..end], &frame) {
            let (shot, count) = smooth_shot(&shot, &frame, period, max_crop);
            shifts.extend(shot);
            limited += count;
        }
        start = end;
    }
    let covered = shifts
        .iter()
        .map(|shift| frame.covered(shift))
        .fold(1.0, f64::min);
    let output_from_frame: Vec<Homography> = shifts.iter().map(|shift| frame.map(shift)).collect();
    let [jitter_before_px, jitter_after_px] = jitter(frames, &output_from_frame, &frame);
    Ok(SmoothPath {
        output_from_frame,
        crop: 0.5 * (1.0 - covered),
        limited,
        jitter_before_px,
        jitter_after_px,
        size,
    })
}

impl SmoothPath {
    /// The map from frame `index` to an output in which the cropped part fills the whole picture.
    ///
    /// # Panics
    /// If there is no such frame.
    pub fn filling(&self, index: usize) -> Homography {
        let center = Frame::new(self.size).center();
        let zoom = (1.0 - 2.0 * self.crop).recip();
        let about = |p: DVec2| center + (p - center) * zoom;
        let corners = Frame::new(self.size).corners;
        Homography::from_pairs(&corners, &corners.map(about))
            .map_or(self.output_from_frame[index], |zoomed| {
                zoomed * self.output_from_frame[index]
            })
    }
}

/// The rectangle of the frames.
struct Frame {
    corners: [DVec2; 4],
}

impl Frame {
    fn new(size: Size) -> Self {
        let (w, h) = (size.width() as f64, size.height() as f64);
        Self {
            corners: [DVec2::ZERO, dvec2(w, 0.0), dvec2(w, h), dvec2(0.0, h)],
        }
    }

    fn center(&self) -> DVec2 {
        0.5 * self.corners[2]
    }

    /// The map that moves the corners by a shift.
    fn map(&self, shift: &Vector) -> Homography {
        if shift.amax() == 0.0 {
            return Homography::IDENTITY;
        }
        let moved = points_of(&(vector_of(&self.corners) + shift));
        Homography::from_pairs(&self.corners, &moved).unwrap_or(Homography::IDENTITY)
    }

    /// Distance by which a map moves the corners; nothing behind its horizon.
    fn motion(&self, map: &Homography) -> Option<Vector> {
        let moved = map.is_in_front(&self.corners).then(|| {
            let images = self.corners.map(|p| map.apply(p));
            vector_of(&images) - vector_of(&self.corners)
        })?;
        // and it must lead back
        map.inverse().is_in_front(&self.corners).then_some(moved)
    }

    /// The largest size, as a share of the frame's, of a rectangle around the middle of the output that the frame covers after
    /// its corners were moved by a shift; at most 1, and 0 if it does not even cover the middle.
    fn covered(&self, shift: &Vector) -> f64 {
        let quad = points_of(&(vector_of(&self.corners) + shift));
        let center = self.center();
        let mut scale: f64 = 1.0;
        for k in 0..4 {
            let (a, b) = (quad[k], quad[(k + 1) % 4]);
            let inside = (b - a).perp_dot(center - a);
            for corner in self.corners {
                let outward = -(b - a).perp_dot(corner - center);
                if outward > 0.0 {
                    scale = scale.min(inside / outward);
                }
            }
        }
        // also what is not a number
        if scale > 0.0 { scale } else { 0.0 }
    }

    /// The largest factor, 0 to 1, by which a shift leaves a share of the output covered.
    fn allowed(&self, shift: &Vector, share: f64) -> f64 {
        if self.covered(shift) >= share {
            return 1.0;
        }
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..40 {
            let middle = 0.5 * (low + high);
            if self.covered(&(shift * middle)) >= share {
                low = middle;
            } else {
                high = middle;
            }
        }
        low
    }
}

/// Frames of a shot with their maps, and the place of the content at their corners, where they are known.
type Path = Vec<Option<(Homography, Vector)>>;

/// Paths between cuts, and between frames whose relative motion makes no sense, which are as good as a cut.
fn unbroken(frames: &[PathFrame], frame: &Frame) -> Vec<Path> {
    let mut paths: Vec<Path> = vec![Path::new()];
    let mut last: Option<(Homography, Vector)> = None;
    for one in frames {
        let place = one.frame_from_reference.and_then(|map| {
            let place = match &last {
                None => Some(Vector::zeros()),
                Some((before, place)) => frame
                    .motion(&(map * before.inverse()))
                    .map(|motion| place + motion),
            };
            let place = place.unwrap_or_else(|| {
                paths.push(Path::new());
                Vector::zeros()
            });
            last = Some((map, place));
            place.iter().all(|v| v.is_finite()).then_some((map, place))
        });
        if let Some(path) = paths.last_mut() {
            path.push(place);
        }
    }
    paths
}

/// Shifts of the frames of a shot, and the number of frames that the crop limits.
fn smooth_shot(path: &Path, frame: &Frame, period: f64, max_crop: f64) -> (Vec<Vector>, usize) {
    let still = vec![Vector::zeros(); path.len()];
    let known: Vec<usize> = (0..path.len()).filter(|&at| path[at].is_some()).collect();
    let (Some(&first), Some(&last)) = (known.first(), known.last()) else {
        return (still, 0);
    };
    if period <= 0.0 || last - first < 2 {
        return (still, 0);
    }
    let curvature = (2.0 * (std::f64::consts::PI / period.max(2.0)).sin()).powi(-4);
    let share = 1.0 - 2.0 * max_crop;
    let inner = &path[first..=last];
    let places: Vec<Option<Vector>> = inner
        .iter()
        .map(|one| one.map(|(_, place)| place))
        .collect();
    let mut weights: Vec<f64> = inner
        .iter()
        .map(|place| if place.is_some() { 1.0 } else { 0.0 })
        .collect();
    let shifts_to = |smooth: &[Vector]| {
        let pairs = places.iter().zip(smooth);
        interpolated(pairs.map(|(place, smooth)| place.map(|place| smooth - place)))
    };
    let mut smooth = whittaker(&places, &weights, curvature);
    let mut shifts = shifts_to(&smooth);
    let outside = |shift: &Vector| frame.covered(shift) < share;
    let limited = shifts.iter().filter(|shift| outside(shift)).count();
    for _ in 0..ATTEMPTS {
        let mut firmer = false;
        for (weight, shift) in weights.iter_mut().zip(&shifts) {
            if *weight > 0.0 && outside(shift) {
                *weight *= FIRMER;
                firmer = true;
            }
        }
        if !firmer {
            break;
        }
        smooth = whittaker(&places, &weights, curvature);
        shifts = shifts_to(&smooth);
    }
    for _ in 0..REFINEMENTS {
        let Some(excess) = excess(inner, &shifts, &smooth, frame) else {
            break;
        };
        let slow = whittaker(&excess, &weights, curvature);
        let better = excess
            .iter()
            .zip(slow)
            .zip(&shifts)
            .map(|((excess, slow), shift)| {
                let correction = frame.map(&(slow - (*excess)?));
                frame.motion(&(correction * frame.map(shift)))
            });
        shifts = interpolated(better);
        if shifts.len() < inner.len() {
            return (still, limited);
        }
    }
    limit(&mut shifts, frame, share, period);
    let mut all = still;
    for (at, shift) in all.iter_mut().enumerate() {
        *shift = shifts[at.clamp(first, last) - first];
    }
    (all, limited)
}

/// Motion of the content in the output beyond the smooth path, summed from frame to frame: small motions do not quite
/// add up. Nothing if the output has a horizon.
fn excess(
    path: &[Option<(Homography, Vector)>],
    shifts: &[Vector],
    smooth: &[Vector],
    frame: &Frame,
) -> Option<Vec<Option<Vector>>> {
    let mut last: Option<(Homography, usize)> = None;
    let mut sum = Vector::zeros();
    let mut sums = Vec::with_capacity(path.len());
    for (at, one) in path.iter().enumerate() {
        let Some((map, _)) = one else {
            sums.push(None);
            continue;
        };
        let output = frame.map(&shifts[at]) * *map;
        if let Some((before, from)) = last {
            let motion = frame.motion(&(output * before.inverse()))?;
            sum += motion - (smooth[at] - smooth[from]);
        }
        last = Some((output, at));
        sums.push(Some(sum));
    }
    Some(sums)
}

/// Scales shifts down until the share is covered, smoothly in time.
fn limit(shifts: &mut [Vector], frame: &Frame, share: f64, period: f64) {
    let allowed: Vec<f64> = shifts
        .iter()
        .map(|shift| frame.allowed(shift, share))
        .collect();
    if allowed.iter().all(|&factor| factor == 1.0) {
        return;
    }
    // the mean over a window of the least factors over the same window is nowhere above the factor
    let radius = (0.25 * period).ceil() as usize;
    let window = |at: usize| at.saturating_sub(radius)..(at + radius + 1).min(shifts.len());
    let least: Vec<f64> = (0..shifts.len())
        .map(|at| allowed[window(at)].iter().copied().fold(1.0, f64::min))
        .collect();
    let means: Vec<f64> = (0..shifts.len())
        .map(|at| {
            let window = &least[window(at)];
            window.iter().sum::<f64>() / window.len() as f64
        })
        .collect();
    for (shift, mean) in shifts.iter_mut().zip(means) {
        *shift *= mean;
        // what is covered need not grow as the shift shrinks
        for _ in 0..60 {
            if frame.covered(shift) >= share {
                break;
            }
            *shift *= 0.9;
        }
        if frame.covered(shift) < share {
            *shift = Vector::zeros();
        }
    }
}

/// Fills gaps between known values in a straight line. The first and the last are known.
fn interpolated(values: impl Iterator<Item = Option<Vector>>) -> Vec<Vector> {
    let mut filled: Vec<Vector> = Vec::new();
    let mut gap = 0;
    for value in values {
        match (value, filled.last().copied()) {
            (None, _) => gap += 1,
            (Some(value), before) => {
                let before = before.unwrap_or(value);
                for k in 1..=gap {
                    let t = f64::from(k) / f64::from(gap + 1);
                    filled.push(before * (1.0 - t) + value * t);
                }
                gap = 0;
                filled.push(value);
            }
        }
    }
    filled
}

/// The y with the least Σ w (y − x)² + λ Σ (y₋₁ − 2 y + y₊₁)². Values without a weight do not count; two need one.
///
/// The matrix has two diagonals on each side of its own, and so has its factor L D Lᵀ.
fn whittaker(values: &[Option<Vector>], weights: &[f64], lambda: f64) -> Vec<Vector> {
    let n = values.len();
    let mut bands = vec![[0.0; 3]; n];
    for (band, weight) in bands.iter_mut().zip(weights) {
        band[0] = *weight;
    }
    for at in 0..n.saturating_sub(2) {
        let taps = [1.0, -2.0, 1.0];
        for i in 0..3 {
            for j in i..3 {
                bands[at + i][j - i] += lambda * taps[i] * taps[j];
            }
        }
    }
    // bands[k] becomes the pivot and the two entries of the factor below it
    let mut path: Vec<Vector> = values
        .iter()
        .zip(weights)
        .map(|(value, weight)| value.map_or(Vector::zeros(), |value| value * *weight))
        .collect();
    for k in 0..n {
        let [pivot, near, far] = bands[k];
        let (l1, l2) = (near / pivot, far / pivot);
        if k + 1 < n {
            bands[k + 1][0] -= l1 * near;
            bands[k + 1][1] -= l1 * far;
            let above = path[k];
            path[k + 1] -= above * l1;
        }
        if k + 2 < n {
            bands[k + 2][0] -= l2 * far;
            let above = path[k];
            path[k + 2] -= above * l2;
        }
        bands[k] = [pivot, l1, l2];
    }
    for k in (0..n).rev() {
        let [pivot, l1, l2] = bands[k];
        let mut value = path[k] / pivot;
        if k + 1 < n {
            value -= path[k + 1] * l1;
        }
        if k + 2 < n {
            value -= path[k + 2] * l2;
        }
        path[k] = value;
    }
    path
}

/// Root mean squares of the changes of speed at the corners, of the input and of the output.
fn jitter(frames: &[PathFrame], output_from_frame: &[Homography], frame: &Frame) -> [f64; 2] {
    let speed = |at: usize, smooth: bool| {
        let [before, after] = [&frames[at], &frames[at + 1]];
        if after.cut {
            return None;
        }
        let motion = after.frame_from_reference? * before.frame_from_reference?.inverse();
        frame.motion(&if smooth {
            output_from_frame[at + 1] * motion * output_from_frame[at].inverse()
        } else {
            motion
        })
    };
    [false, true].map(|smooth| {
        let (mut sum, mut count) = (0.0, 0usize);
        let speeds: Vec<Option<Vector>> = (0..frames.len().saturating_sub(1))
            .map(|at| speed(at, smooth))
            .collect();
        for pair in speeds.windows(2) {
            if let [Some(before), Some(after)] = pair {
                sum += (after - before).norm_squared() / 4.0;
                count += 1;
            }
        }
        (sum / count.max(1) as f64).sqrt()
    })
}

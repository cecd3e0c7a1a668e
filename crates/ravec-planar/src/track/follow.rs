//! Alignment of a frame: from what the last frames suggest, or from a search.

use crate::track::align::{Pose, Settled, Steps, mean_distance, project, sample, settle};
use crate::track::judge::{PoseCovariance, Verdict, blur_variance, judge, similarity, zoom_of};
use crate::track::keys::Key;
use crate::track::picture::{Picture, Window};
use crate::track::search::{best_places, best_shift, is_due};
use crate::track::template::Samples;
use crate::track::tracker::PlaneTracker;
use glam::{DMat3, DVec2};
use ravec_raster::{AnyImage, Mask};

/// Margin around the predicted plane that is read, in pixels, beside the last motion.
const MARGIN_PX: f64 = 40.0;

/// Steps of a level, and of the dense samples.
const LEVEL_STEPS: usize = 6;
const DENSE_STEPS: usize = 4;

/// Mean motion of the corners, in pixels, at which levels and dense samples have settled.
const SETTLED_PX: f64 = 0.02;
const DENSE_SETTLED_PX: f64 = 0.002;

/// Number of the finest levels at which blur is estimated.
const BLUR_LEVELS: usize = 3;

/// Variance of the relative blur, in square pixels of a level, up to which second derivatives stand for it.
const MAX_BLUR: f64 = 3.0;

/// Variance in square pixels of the finest level from which blur is taken from the coarsest level that has seen it: a box of 12
/// pixels.
const STRONG_BLUR: f64 = 12.0;

/// Correlation at the coarsest level below which a start is poor, also as a share of that of the last frame.
const POOR_START: f64 = 0.45;
const POOR_SHARE: f64 = 0.7;

/// Search for a poor start, in pixels of the coarsest level to each side.
const REACH: i32 = 5;

/// Share of the texture in view that must be alike.
const MIN_ALIKE: f64 = 0.3;

/// Share of the texture that must be seen.
const MIN_VISIBLE: f64 = 0.06;

/// Factor by which the area of the region may differ from that of the start.
const MAX_GROWTH: f64 = 2.5;

/// An alignment to a key with its verdict.
pub(super) struct Fit {
    pub pose: Pose,
    pub settled: Settled,
    pub verdict: Verdict,
    pub similarity: f64,
    pub covariance: Option<PoseCovariance>,
}

impl Fit {
    pub fn is_found(&self) -> bool {
        self.verdict.alike >= MIN_ALIKE && self.verdict.visible >= MIN_VISIBLE
    }

    pub fn quality(&self) -> f64 {
        self.verdict.visible.min(self.verdict.alike)
    }
}

impl PlaneTracker {
    /// Corners of the region in units of a key.
    fn corners_in_units(&self, key: &Key) -> [DVec2; 4] {
        let units_from_reference = key.reference_from_units.inverse();
        self.outline
            .map(|corner| project(&units_from_reference, corner).unwrap_or(DVec2::ZERO))
    }

    /// Starts that the last frames suggest, as maps from the reference to the frame.
    fn predictions(&self) -> [DMat3; 2] {
        let last = self.motion.frame_from_reference;
        let predicted = last * self.motion.velocity;
        let predicted = predicted * predicted.z_axis.z.recip();
        [
            if predicted.is_finite() {
                predicted
            } else {
                last
            },
            last,
        ]
    }

    /// Aligns from what the last frames suggest.
    pub(super) fn follow(&mut self, frame: &AnyImage, exclude: Option<&Mask>) -> Option<Fit> {
        let starts = self.predictions();
        let mut points = Vec::with_capacity(8);
        for start in &starts {
            points.extend(self.outline.iter().filter_map(|&p| project(start, p)));
        }
        let moved = mean_distance(&starts[0], &starts[1], &self.outline);
        let margin = MARGIN_PX + if moved.is_finite() { moved } else { 0.0 };
        let window = Window::around(&points, margin, self.size, self.levels);
        let picture = Picture::new(frame, exclude, window, self.levels, &mut self.buffers);
        let fit = self.align_from(&picture, &starts);
        self.buffers.recycle(picture);
        fit
    }

    /// Aligns from the best of some starts, or from shifts around it.
    pub(super) fn align_from(&mut self, picture: &Picture, starts: &[DMat3]) -> Option<Fit> {
        let key = &self.keys.all[self.key];
        let top = key.template.levels.len() - 1;
        let samples = &key.template.levels[top];
        let mut best = (f64::NEG_INFINITY, DMat3::IDENTITY);
        for start in starts {
            let pose = *start * key.reference_from_units;
            let level = picture.level(top, zoom_levels(&pose, key.template.units.half));
            sample(samples, level, &pose, &mut self.scratch.values);
            let found = similarity(samples, &self.scratch.values);
            if found > best.0 {
                best = (found, pose);
            }
        }
        if best.0 < POOR_START.max(POOR_SHARE * self.motion.similarity) {
            let level = picture.level(top, zoom_levels(&best.1, key.template.units.half));
            let shifted = best_shift(samples, level, &best.1, REACH, &mut self.scratch);
            if shifted.0 > best.0 {
                best = shifted;
            }
        }
        self.align(picture, &best.1, best.0)
    }

    /// Aligns from a start, coarse to fine, and judges the result.
    fn align(
        &mut self,
        picture: &Picture,
        frame_from_units: &DMat3,
        similarity: f64,
    ) -> Option<Fit> {
        let key = &self.keys.all[self.key];
        let corners = self.corners_in_units(key);
        let mut pose = Pose::new(*frame_from_units, self.motion.light);
        let scratch = &mut self.scratch;
        let count = key.template.levels.len();
        let zoom = zoom_levels(frame_from_units, key.template.units.half);
        // fine levels see too little of a strong blur, coarse ones do not know a weak one
        let (mut blur, mut strong) = (0.0f64, 0.0f64);
        for index in (0..count).rev() {
            let samples = &key.template.levels[index];
            let coarsest = index + 1 == count && count > 1;
            if index + 1 < count && is_blurred(blur, index) {
                break;
            }
            let steps = Steps {
                max: LEVEL_STEPS,
                settled_px: SETTLED_PX * f64::from(1u32 << index),
                motion: 8,
                blur: index < BLUR_LEVELS,
                far: coarsest,
            };
            let groups = self.motion.groups.as_ref();
            let prior = groups.map(|groups| weights_of(samples, groups));
            let level = picture.level(index, zoom);
            settle(
                samples,
                level,
                &mut pose,
                steps,
                (&corners, prior.as_deref()),
                scratch,
            )?;
            if steps.blur {
                blur = blur_variance(&pose);
                strong = if blur > STRONG_BLUR {
                    strong.max(blur)
                } else {
                    strong
                };
                blur = blur.max(strong);
            }
        }
        let last = key.template.dense.len() - 1;
        let finest = (0..last).find(|&index| !is_blurred(blur, index));
        let dense = &key.template.dense[finest.unwrap_or(last)];
        let level = picture.level(dense.level, zoom);
        let steps = Steps {
            max: DENSE_STEPS,
            settled_px: DENSE_SETTLED_PX * f64::from(1u32 << dense.level),
            motion: 8,
            blur: true,
            far: false,
        };
        let settled = settle(dense, level, &mut pose, steps, (&corners, None), scratch)?;
        blur = blur_variance(&pose).max(strong);
        if !is_plausible(frame_from_units, &pose.frame_from_units, &corners) {
            return None;
        }
        let verdict = judge(dense, &pose, settled.scale, scratch);
        let half = key.template.units.half;
        let covariance = PoseCovariance::new(dense, &settled, &pose, (half, blur), scratch);
        Some(Fit {
            pose,
            settled,
            verdict,
            similarity,
            covariance,
        })
    }

    /// Searches the whole frame.
    pub(super) fn search(&mut self, frame: &AnyImage, exclude: Option<&Mask>) -> Option<Fit> {
        let window = Window::whole(self.size);
        let picture = Picture::new(frame, exclude, window, self.levels, &mut self.buffers);
        let last = self.motion.frame_from_reference;
        let key = &self.keys.all[self.key];
        let start = last * key.reference_from_units;
        let places = best_places(&key.template, &picture, &start, &mut self.scratch);
        let mut best: Option<Fit> = None;
        for (similarity, start) in places {
            let fit = self.align(&picture, &start, similarity);
            best = better(best, fit);
        }
        if !best.as_ref().is_some_and(Fit::is_found)
            && is_due(self.motion.lost_for)
            && let Some(frame_from_reference) = self.searcher.by_features(&picture)
        {
            let start = frame_from_reference * self.keys.all[self.key].reference_from_units;
            let fit = self.align(&picture, &start, 1.0);
            best = better(best, fit);
        }
        self.buffers.recycle(picture);
        best
    }
}

/// The number of halvings by which the frame shows the plane larger than the template does, rounded.
fn zoom_levels(frame_from_units: &DMat3, half: f64) -> i32 {
    let zoom = (zoom_of(frame_from_units) / half).log2();
    // NaN becomes 0
    zoom.clamp(-8.0, 8.0).round() as i32
}

/// True if a pose shows the region as one camera could, and neither much larger nor much smaller than the start: a plane that has
/// collapsed into a spot agrees with anything.
fn is_plausible(start: &DMat3, pose: &DMat3, corners: &[DVec2; 4]) -> bool {
    let area = |m: &DMat3| {
        let mut places = [DVec2::ZERO; 4];
        for (place, &corner) in places.iter_mut().zip(corners) {
            *place = project(m, corner)?;
        }
        let turn = |k: usize| {
            let [a, b, c] = [0, 1, 2].map(|j| places[(k + j) % 4]);
            (b - a).perp_dot(c - b)
        };
        let turns = [0, 1, 2, 3].map(turn);
        let convex = turns.iter().all(|&t| t > 0.0) || turns.iter().all(|&t| t < 0.0);
        convex.then(|| 0.25 * turns.iter().sum::<f64>())
    };
    match (area(start), area(pose)) {
        (Some(before), Some(after)) => (1.0 / MAX_GROWTH..MAX_GROWTH).contains(&(after / before)),
        _ => false,
    }
}

/// True if a blur of a variance in square pixels is too strong for the second derivatives of a level to stand for it.
fn is_blurred(variance: f64, level: usize) -> bool {
    variance * 0.25f64.powi(level as i32) > MAX_BLUR
}

/// Weights of blocks from those of their groups.
fn weights_of(samples: &Samples, groups: &[f32]) -> Vec<f32> {
    samples
        .blocks
        .iter()
        .map(|block| groups[block.group])
        .collect()
}

pub(super) fn better(a: Option<Fit>, b: Option<Fit>) -> Option<Fit> {
    match (a, b) {
        (Some(a), Some(b)) => Some(if b.quality() > a.quality() { b } else { a }),
        (a, b) => a.or(b),
    }
}

//! Streaming tracker of a plane.
//!
//! ```text
//! predict the pose from the last motions; take the better of that and the last pose, by the correlation at the coarsest level
//! if neither fits: the best shift near them; if the plane was lost: the best place in the frame; features
//! align from the coarsest level to the finest, and to the dense samples
//! judge: what of the plane is seen, how exact is the pose; if much less is seen than before, search
//! ```

use crate::homography::{Homography, HomographyError};
use crate::track::align::{
    Light, Pose, Scratch, Settled, Steps, mean_distance, project, sample, settle,
};
use crate::track::judge::{Verdict, blur_variance, corner_covariance, judge, similarity, zoom_of};
use crate::track::picture::{Buffers, Picture, Window};
use crate::track::record::{CornerCovariance, TrackState, TrackedFrame};
use crate::track::search::{Searcher, best_shift};
use crate::track::template::{Samples, Template};
use glam::{DMat2, DMat3, DVec2, dvec2};
use ravec_raster::{AnyImage, Mask, Size};
use serde::{Deserialize, Serialize};

/// Samples of the finest level.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum Precision {
    /// 8 000 samples.
    Fast,
    /// 20 000 samples.
    #[default]
    Normal,
    /// 60 000 samples.
    Dense,
}

impl Precision {
    fn samples(self) -> usize {
        match self {
            Self::Fast => 8_000,
            Self::Normal => 20_000,
            Self::Dense => 60_000,
        }
    }
}

/// Parameters of [`PlaneTracker`].
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default)]
pub struct TrackParams {
    /// Samples of the finest level (default normal).
    pub precision: Precision,
}

/// Part of the reference frame whose pixels are tracked.
#[derive(Debug, Clone, PartialEq, Default)]
pub enum TrackRegion {
    /// The inside of the quadrilateral.
    #[default]
    Quad,
    /// The pixels that a mask of the size of the frame covers by half or more.
    Mask(Mask),
    /// The whole frame, and what comes into view beyond it.
    Frame,
}

/// Why a plane cannot be tracked.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum TrackError {
    /// The corners are no quadrilateral in perspective.
    #[error("the corners are no rectangle in perspective: {0}")]
    Quad(#[from] HomographyError),
    /// Nothing in the region could be recognized.
    #[error("the region has too little texture inside the reference frame to be tracked")]
    Plain,
    /// A mask has another size than the frames.
    #[error("the mask has {mask} pixels, the frames have {frame}")]
    MaskSize {
        /// Size of the mask.
        mask: Size,
        /// Size of the frames.
        frame: Size,
    },
}

/// Shorter side of the region at the coarsest level, in pixels, at least; and levels at most.
const COARSEST_PX: f64 = 40.0;
const MAX_LEVELS: usize = 7;

/// Margin around the predicted plane that is read, in pixels, beside the last motion.
const MARGIN_PX: f64 = 40.0;

/// Steps of a level, and of the dense samples.
const LEVEL_STEPS: usize = 6;
const DENSE_STEPS: usize = 4;

/// Mean motion of the corners, in pixels, at which levels and dense samples have settled.
const SETTLED_PX: f64 = 0.02;
const DENSE_SETTLED_PX: f64 = 0.002;

/// Blur is estimated at so many of the finest levels.
const BLUR_LEVELS: usize = 3;

/// Variance of the relative blur, in square pixels of a level, up to which second derivatives stand for it.
const MAX_BLUR: f64 = 3.0;

/// Correlation at the coarsest level below which a start is poor, also as a share of that of the last frame.
const POOR_START: f64 = 0.45;
const POOR_SHARE: f64 = 0.7;

/// Search for a poor start, in pixels of the coarsest level to each side.
const REACH: i32 = 5;

/// Share of the texture in view that must be alike.
const MIN_ALIKE: f64 = 0.3;

/// Share of the texture that must be seen.
const MIN_VISIBLE: f64 = 0.06;

/// The same, below which a pose is weak.
const WEAK_ALIKE: f64 = 0.4;
const WEAK_VISIBLE: f64 = 0.15;

/// Predicted standard deviation of a corner, in pixels, from which a pose is weak.
const WEAK_SIGMA_PX: f64 = 0.7;

/// Share of what was seen in the last frame below which the pose is doubted and searched for.
const DOUBT: f64 = 0.6;

/// Share of the samples of a key that must be in view for it to stay in use, and for an older key to come back, in planes of which
/// the reference shows a part.
const MIN_IN_VIEW: f64 = 0.55;
const RETURN_IN_VIEW: f64 = 0.7;

/// Standard deviation that stands for a lost plane, as a share of the diagonal of the frame.
const LOST_SIGMA: f64 = 1.0;

/// A frame whose plane is known.
#[derive(Debug, Clone)]
struct Key {
    template: Template,
    /// Pixels of the reference frame from units of the template.
    reference_from_units: DMat3,
    /// Pixels of the frame of the key from those of the reference.
    frame_from_reference: DMat3,
    /// Covariance of the corners of the quadrilateral in the frame of the key.
    covariance: CornerCovariance,
    /// Gain and bias against the reference.
    light: [f64; 2],
}

/// The last pose, and the motion to it.
#[derive(Debug, Clone)]
struct Motion {
    /// Pixels of the frame from those of the reference.
    frame_from_reference: DMat3,
    /// Change of the pose from the frame before: `before · velocity` is `last`.
    velocity: DMat3,
    light: Light,
    /// Weights of the groups of the key.
    groups: Option<Vec<f32>>,
    visible: f64,
    similarity: f64,
    /// Frames since the plane was lost.
    lost_for: usize,
}

impl Motion {
    fn none() -> Self {
        Self {
            frame_from_reference: DMat3::IDENTITY,
            velocity: DMat3::IDENTITY,
            light: Light::SAME,
            groups: None,
            visible: 1.0,
            similarity: 1.0,
            lost_for: 0,
        }
    }
}

/// An alignment to a key with its verdict.
struct Fit {
    pose: Pose,
    settled: Settled,
    verdict: Verdict,
    similarity: f64,
    covariance: Option<CornerCovariance>,
}

impl Fit {
    fn is_found(&self) -> bool {
        self.verdict.alike >= MIN_ALIKE && self.verdict.visible >= MIN_VISIBLE
    }

    fn quality(&self) -> f64 {
        self.verdict.visible.min(self.verdict.alike)
    }
}

/// Follows a plane from frame to frame. Frames are pushed in the order of time, forward or backward from the reference.
#[derive(Debug, Clone)]
pub struct PlaneTracker {
    size: Size,
    quad: [DVec2; 4],
    /// Corners of the region in the reference frame.
    outline: [DVec2; 4],
    levels: usize,
    dense: usize,
    /// True if more of the plane may come into view than the reference shows.
    grows: bool,
    whole_frame: bool,
    keys: Vec<Key>,
    key: usize,
    motion: Motion,
    searcher: Searcher,
    scratch: Scratch,
    buffers: Buffers,
}

impl PlaneTracker {
    /// A tracker of the plane of `quad` in the `reference` frame. Pixels that `exclude` covers do not belong to the plane.
    ///
    /// # Errors
    /// [`TrackError`].
    pub fn new(
        reference: &AnyImage,
        quad: [DVec2; 4],
        region: &TrackRegion,
        exclude: Option<&Mask>,
        params: &TrackParams,
    ) -> Result<Self, TrackError> {
        Homography::from_unit_square(quad)?;
        let size = reference.size();
        let check = |mask: &Mask| {
            let mask = mask.coverage().size();
            (mask == size)
                .then_some(())
                .ok_or(TrackError::MaskSize { mask, frame: size })
        };
        exclude.map_or(Ok(()), check)?;
        let mask = match region {
            TrackRegion::Quad => Mask::from_polygon(size, &quad).map_err(|_| TrackError::Plain)?,
            TrackRegion::Mask(mask) => {
                check(mask)?;
                mask.clone()
            }
            TrackRegion::Frame => Mask::full(size),
        };
        let bounds = mask.bounding_box().ok_or(TrackError::Plain)?;
        let low = dvec2(bounds.col as f64, bounds.row as f64);
        let high = low + dvec2(bounds.width as f64, bounds.height as f64);
        let outline = match region {
            TrackRegion::Quad => quad,
            _ => [low, dvec2(high.x, low.y), high, dvec2(low.x, high.y)],
        };
        let full = dvec2(size.width() as f64, size.height() as f64);
        let leaves = |p: &DVec2| p.cmplt(DVec2::ZERO).any() || p.cmpgt(full).any();
        let grows = *region == TrackRegion::Frame || outline.iter().any(leaves);
        let shorter = (high - low).min_element();
        let levels = ((shorter / COARSEST_PX).log2().floor() + 1.0).clamp(1.0, MAX_LEVELS as f64);
        let levels = levels as usize;
        let mut buffers = Buffers::default();
        let window = Window::around(&[low, high], 8.0, size, levels);
        let picture = Picture::new(reference, exclude, window, levels, &mut buffers);
        let coverage = picture.coverage(&mask);
        let template = Template::new(&picture, &coverage, params.precision.samples())
            .ok_or(TrackError::Plain)?;
        let searcher = Searcher::new(&picture, &coverage[0]);
        let reference_from_units = template.units.pixels_from_units();
        Ok(Self {
            size,
            quad,
            outline,
            levels,
            dense: params.precision.samples(),
            keys: vec![Key {
                template,
                reference_from_units,
                frame_from_reference: DMat3::IDENTITY,
                covariance: [[0.0; 8]; 8],
                light: [1.0, 0.0],
            }],
            grows,
            whole_frame: *region == TrackRegion::Frame,
            key: 0,
            motion: Motion::none(),
            searcher,
            scratch: Scratch::default(),
            buffers,
        })
    }

    /// The reference frame itself, as a tracked frame.
    pub fn reference_frame(&self) -> TrackedFrame {
        TrackedFrame {
            state: TrackState::Tracked,
            frame_from_reference: Homography::IDENTITY,
            corners: self.quad,
            covariance: [[0.0; 8]; 8],
            inlier_share: 1.0,
            visible: 1.0,
            residual: 0.0,
            gain: 1.0,
            bias: 0.0,
            keyframe: 0,
        }
    }

    /// Returns to the reference frame: the next frame is one of its neighbors. Keyframes are kept.
    pub fn rewind(&mut self) {
        self.motion = Motion::none();
        self.key = 0;
    }

    /// Declares a cut before the next frame: nothing is predicted, and the plane is searched for.
    pub fn cut(&mut self) {
        self.motion.lost_for = self.motion.lost_for.max(1);
        self.motion.velocity = DMat3::IDENTITY;
        self.motion.groups = None;
    }

    /// The plane in the next frame. Pixels that `exclude` covers do not belong to the plane.
    ///
    /// # Panics
    /// If the frame, or the mask, does not have the size of the reference frame.
    pub fn push(&mut self, frame: &AnyImage, exclude: Option<&Mask>) -> TrackedFrame {
        assert_eq!(frame.size(), self.size, "all frames have the same size");
        if let Some(mask) = exclude {
            assert_eq!(
                mask.coverage().size(),
                self.size,
                "masks have the size of the frames"
            );
        }
        let near = (self.motion.lost_for == 0)
            .then(|| self.follow(frame, exclude))
            .flatten();
        let doubted = near.as_ref().is_none_or(|fit| {
            !fit.is_found()
                || fit.verdict.visible < DOUBT * self.motion.visible.min(fit.verdict.alike)
        });
        let fit = if doubted {
            let found = self.search(frame, exclude);
            match (near, found) {
                (Some(near), Some(found)) if near.quality() >= found.quality() => Some(near),
                (near, None) => near,
                (_, found) => found,
            }
        } else {
            near
        };
        let Some(fit) = fit.filter(Fit::is_found) else {
            return self.lose();
        };
        let in_view = fit.verdict.in_view;
        let tracked = self.settle_on(fit);
        if self.grows && in_view < MIN_IN_VIEW && tracked.state == TrackState::Tracked {
            self.change_key(frame, exclude, &tracked);
        }
        tracked
    }

    /// Takes another key for the frames that follow: the one of which most is in view, or this frame.
    fn change_key(&mut self, frame: &AnyImage, exclude: Option<&Mask>, tracked: &TrackedFrame) {
        let pose = tracked.frame_from_reference.matrix();
        let full = dvec2(self.size.width() as f64, self.size.height() as f64);
        let in_view = |key: &Key| {
            let samples = &key.template.levels[key.template.levels.len() - 1];
            let frame_from_units = pose * key.reference_from_units;
            let inside = (0..samples.len()).filter(|&i| {
                let place = project(&frame_from_units, samples.place(i));
                place.is_some_and(|p| p.cmpgt(DVec2::ZERO).all() && p.cmplt(full).all())
            });
            inside.count() as f64 / samples.len() as f64
        };
        let shares = self.keys.iter().map(in_view).enumerate();
        // the older of equals is nearer to the reference
        let best = shares.max_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0)));
        if let Some((index, share)) = best
            && share >= RETURN_IN_VIEW
        {
            self.use_key(index);
            return;
        }
        let window = Window::whole(self.size);
        let picture = Picture::new(frame, exclude, window, self.levels, &mut self.buffers);
        let mask = if self.whole_frame {
            Mask::full(self.size)
        } else {
            let outline = self.outline.map(|p| project(&pose, p).unwrap_or(p));
            Mask::from_polygon(self.size, &outline).unwrap_or_else(|_| Mask::empty(self.size))
        };
        let coverage = picture.coverage(&mask);
        if let Some(template) = Template::new(&picture, &coverage, self.dense) {
            let frame_from_units = template.units.pixels_from_units();
            let reference_from_units = pose.inverse() * frame_from_units;
            self.keys.push(Key {
                reference_from_units: reference_from_units * reference_from_units.z_axis.z.recip(),
                template,
                frame_from_reference: pose,
                covariance: tracked.covariance,
                light: [tracked.gain, tracked.bias],
            });
            self.use_key(self.keys.len() - 1);
        }
        self.buffers.recycle(picture);
    }

    fn use_key(&mut self, index: usize) {
        self.key = index;
        self.motion.groups = None;
        self.motion.light = Light::SAME;
    }

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
    fn follow(&mut self, frame: &AnyImage, exclude: Option<&Mask>) -> Option<Fit> {
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
    fn align_from(&mut self, picture: &Picture, starts: &[DMat3]) -> Option<Fit> {
        let key = &self.keys[self.key];
        let top = key.template.levels.len() - 1;
        let samples = &key.template.levels[top];
        let mut best = (f64::NEG_INFINITY, DMat3::IDENTITY);
        for start in starts {
            let pose = *start * key.reference_from_units;
            sample(
                samples,
                &picture.levels[top],
                &pose,
                &mut self.scratch.values,
            );
            let found = similarity(samples, &self.scratch.values);
            if found > best.0 {
                best = (found, pose);
            }
        }
        if best.0 < POOR_START.max(POOR_SHARE * self.motion.similarity) {
            let shifted = best_shift(
                samples,
                &picture.levels[top],
                &best.1,
                REACH,
                &mut self.scratch,
            );
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
        let key = &self.keys[self.key];
        let corners = self.corners_in_units(key);
        let mut pose = Pose::new(*frame_from_units, self.motion.light);
        let scratch = &mut self.scratch;
        let count = key.template.levels.len();
        let zoom = zoom_levels(frame_from_units, key.template.units.half);
        for index in (0..count).rev() {
            let samples = &key.template.levels[index];
            let coarsest = index + 1 == count && count > 1;
            if index + 1 < count && index + 1 < BLUR_LEVELS && is_blurred(&pose, index) {
                break;
            }
            let steps = Steps {
                max: LEVEL_STEPS,
                settled_px: SETTLED_PX * f64::from(1u32 << index),
                motion: 8,
                blur: index < BLUR_LEVELS,
                far: coarsest,
            };
            let prior = self
                .motion
                .groups
                .as_ref()
                .map(|groups| weights_of(samples, groups));
            let level = &picture.levels[index];
            settle(
                samples,
                level,
                &mut pose,
                steps,
                (&corners, prior.as_deref()),
                scratch,
            )?;
        }
        let last = key.template.dense.len() - 1;
        let finest = (0..last).find(|&index| !is_blurred(&pose, index));
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
        let verdict = judge(dense, &pose, settled.scale, scratch);
        let units_from_reference = key.reference_from_units.inverse();
        let quad = self
            .quad
            .map(|p| project(&units_from_reference, p).unwrap_or(DVec2::ZERO));
        let covariance = corner_covariance(
            dense,
            &settled,
            &pose,
            true,
            (&quad, key.template.units.half),
            scratch,
        );
        Some(Fit {
            pose,
            settled,
            verdict,
            similarity,
            covariance,
        })
    }

    /// Searches the whole frame.
    fn search(&mut self, frame: &AnyImage, exclude: Option<&Mask>) -> Option<Fit> {
        let window = Window::whole(self.size);
        let picture = Picture::new(frame, exclude, window, self.levels, &mut self.buffers);
        let last = self.motion.frame_from_reference;
        let key = &self.keys[self.key];
        let start = last * key.reference_from_units;
        let places = self
            .searcher
            .places(&key.template, &picture, &start, &mut self.scratch);
        let mut best: Option<Fit> = None;
        for (similarity, start) in places {
            let fit = self.align(&picture, &start, similarity);
            best = better(best, fit);
        }
        if !best.as_ref().is_some_and(Fit::is_found)
            && self.searcher.is_due(self.motion.lost_for)
            && let Some(frame_from_reference) = self.searcher.by_features(&picture)
        {
            let start = frame_from_reference * self.keys[self.key].reference_from_units;
            let fit = self.align(&picture, &start, 1.0);
            best = better(best, fit);
        }
        self.buffers.recycle(picture);
        best
    }

    /// Takes a pose.
    fn settle_on(&mut self, fit: Fit) -> TrackedFrame {
        let key = &self.keys[self.key];
        let before = self.motion.frame_from_reference;
        let now = fit.pose.frame_from_units * key.reference_from_units.inverse();
        let now = now * now.z_axis.z.recip();
        let found = Homography::from_matrix(now);
        let (Some(covariance), Ok(frame_from_reference)) = (fit.covariance, found) else {
            return self.lose();
        };
        let corners = self.quad.map(|p| project(&now, p).unwrap_or(DVec2::NAN));
        if !corners.iter().all(|corner| corner.is_finite()) {
            return self.lose();
        }
        let covariance = carried(&covariance, key, &now, &self.quad);
        let [gain, bias] = key.light;
        let velocity = before.inverse() * now;
        self.motion = Motion {
            frame_from_reference: now,
            velocity: if self.motion.lost_for == 0 {
                velocity
            } else {
                DMat3::IDENTITY
            },
            light: fit.pose.light,
            groups: Some(fit.verdict.groups),
            visible: fit.verdict.visible,
            similarity: fit.similarity,
            lost_for: 0,
        };
        let mut tracked = TrackedFrame {
            state: TrackState::Tracked,
            frame_from_reference,
            corners,
            covariance,
            inlier_share: fit.verdict.inlier_share,
            visible: fit.verdict.visible,
            residual: f64::from(fit.settled.scale),
            gain: fit.pose.light.gain * gain,
            bias: fit.pose.light.gain * bias + fit.pose.light.bias,
            keyframe: self.key,
        };
        let weak = fit.verdict.alike < WEAK_ALIKE
            || fit.verdict.visible < WEAK_VISIBLE
            || tracked.sigma_px() > WEAK_SIGMA_PX;
        if weak {
            tracked.state = TrackState::Weak;
        }
        tracked
    }

    /// Reports the plane as lost; the pose is that of the last frame in which it was found.
    fn lose(&mut self) -> TrackedFrame {
        self.motion.lost_for += 1;
        self.motion.groups = None;
        let now = self.motion.frame_from_reference;
        let sigma =
            LOST_SIGMA * dvec2(self.size.width() as f64, self.size.height() as f64).length();
        let mut covariance = [[0.0; 8]; 8];
        for (k, row) in covariance.iter_mut().enumerate() {
            row[k] = 0.5 * sigma * sigma;
        }
        TrackedFrame {
            state: TrackState::Lost,
            frame_from_reference: Homography::from_matrix(now).unwrap_or(Homography::IDENTITY),
            corners: self.quad.map(|p| project(&now, p).unwrap_or(p)),
            covariance,
            inlier_share: 0.0,
            visible: 0.0,
            residual: 0.0,
            gain: self.motion.light.gain,
            bias: self.motion.light.bias,
            keyframe: self.key,
        }
    }
}

/// The number of halvings by which the frame shows the plane larger than the template does, rounded.
fn zoom_levels(frame_from_units: &DMat3, half: f64) -> i32 {
    let zoom = (zoom_of(frame_from_units) / half).log2();
    // NaN becomes 0
    zoom.clamp(-8.0, 8.0).round() as i32
}

/// True if blur is too strong for the second derivatives of a level to stand for it.
fn is_blurred(pose: &Pose, level: usize) -> bool {
    blur_variance(pose) * 0.25f64.powi(level as i32) > MAX_BLUR
}

/// Covariance of the corners in a frame that was measured against a key, with that of the key itself.
fn carried(
    measured: &CornerCovariance,
    key: &Key,
    frame_from_reference: &DMat3,
    quad: &[DVec2; 4],
) -> CornerCovariance {
    let frame_from_key = *frame_from_reference * key.frame_from_reference.inverse();
    // derivatives of each corner in the frame by the same corner in the frame of the key
    let local = quad.map(|corner| {
        let at = project(&key.frame_from_reference, corner)?;
        let map = Homography::from_matrix(frame_from_key).ok()?;
        Some(map.jacobian(at))
    });
    let mut sum = *measured;
    for (i, a) in local.iter().enumerate() {
        for (j, b) in local.iter().enumerate() {
            let (Some(a), Some(b)) = (a, b) else { continue };
            let c = &key.covariance;
            let tie = DMat2::from_cols(
                dvec2(c[2 * i][2 * j], c[2 * i + 1][2 * j]),
                dvec2(c[2 * i][2 * j + 1], c[2 * i + 1][2 * j + 1]),
            );
            let block = *a * tie * b.transpose();
            sum[2 * i][2 * j] += block.x_axis.x;
            sum[2 * i + 1][2 * j] += block.x_axis.y;
            sum[2 * i][2 * j + 1] += block.y_axis.x;
            sum[2 * i + 1][2 * j + 1] += block.y_axis.y;
        }
    }
    sum
}

/// Weights of blocks from those of their groups.
fn weights_of(samples: &Samples, groups: &[f32]) -> Vec<f32> {
    samples
        .blocks
        .iter()
        .map(|block| groups[block.group])
        .collect()
}

fn better(a: Option<Fit>, b: Option<Fit>) -> Option<Fit> {
    match (a, b) {
        (Some(a), Some(b)) => Some(if b.quality() > a.quality() { b } else { a }),
        (a, b) => a.or(b),
    }
}

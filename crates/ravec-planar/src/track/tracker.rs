//! Streaming tracker of a plane.
//!
//! ```text
//! predict the pose from the last motions; take the better of that and the last pose, by the correlation at the coarsest level
//! if neither fits: the best shift near them; if the plane was lost: the best place in the frame; features
//! align from the coarsest level to the finest, and to the dense samples
//! judge: what of the plane is seen, how exact is the pose; if much less is seen than before, search
//! ```

use crate::homography::{Homography, HomographyError};
use crate::track::align::{Light, Scratch, project};
use crate::track::follow::{Fit, better};
use crate::track::keys::{Choice, Keys};
use crate::track::picture::{Buffers, Picture, Window};
use crate::track::record::{TrackState, TrackedFrame};
use crate::track::search::Searcher;
use crate::track::template::Template;
use glam::{DMat3, DVec2, dvec2};
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

/// Share of the texture in view that is alike, and share of all texture that is, below which a pose is weak.
const WEAK_ALIKE: f64 = 0.4;
const WEAK_VISIBLE: f64 = 0.15;

/// Predicted standard deviation of a corner, in pixels, from which a pose is weak: two of it are a pixel.
const WEAK_SIGMA_PX: f64 = 0.5;

/// Share of what was seen in the last frame below which the pose is doubted and searched for.
const DOUBT: f64 = 0.6;

/// Residual from which a pose is weak: the frame is not explained, by a blur that is too strong or a wrong place. In encoded values
/// from 0 to 1, and as a multiple of the least one so far, which grows again with every frame.
const MISFIT: f64 = 0.018;
const MISFIT_GROWTH: f64 = 3.0;
const CALM_GROWTH: f64 = 1.02;

/// Predicted standard deviation of a corner, as a share of the diagonal of the region, from which a plane is lost.
const LOST_SIGMA: f64 = 0.025;

/// The last pose, and the motion to it.
#[derive(Debug, Clone)]
pub(super) struct Motion {
    /// Pixels of the frame from those of the reference.
    pub frame_from_reference: DMat3,
    /// Change of the pose from the frame before: `before · velocity` is `last`.
    pub velocity: DMat3,
    pub light: Light,
    /// Weights of the groups of the key.
    pub groups: Option<Vec<f32>>,
    pub visible: f64,
    pub similarity: f64,
    /// The least residual of the last frames.
    pub calm: f64,
    /// Frames since the plane was lost.
    pub lost_for: usize,
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
            calm: f64::INFINITY,
            lost_for: 0,
        }
    }
}

/// Follows a plane from frame to frame. Frames are pushed in the order of time, forward or backward from the reference.
#[derive(Debug, Clone)]
pub struct PlaneTracker {
    pub(super) size: Size,
    pub(super) quad: [DVec2; 4],
    /// Corners of the region in the reference frame.
    pub(super) outline: [DVec2; 4],
    pub(super) levels: usize,
    pub(super) dense: usize,
    /// True if more of the plane may come into view than the reference shows.
    pub(super) grows: bool,
    pub(super) whole_frame: bool,
    pub(super) keys: Keys,
    /// Frames since the key was changed.
    pub(super) since_change: usize,
    pub(super) key: usize,
    pub(super) motion: Motion,
    pub(super) searcher: Searcher,
    pub(super) scratch: Scratch,
    pub(super) buffers: Buffers,
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
        Ok(Self {
            size,
            quad,
            outline,
            levels,
            dense: params.precision.samples(),
            keys: Keys::new(template),
            grows,
            whole_frame: *region == TrackRegion::Frame,
            since_change: 0,
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
            better(near, found)
        } else {
            near
        };
        let Some(fit) = fit.filter(Fit::is_found) else {
            return self.lose();
        };
        let tracked = self.settle_on(&fit);
        if self.grows && tracked.state == TrackState::Tracked {
            return self.change_key(frame, exclude, (fit, tracked));
        }
        tracked
    }

    /// Takes another key for the frames that follow, if there is a better one; the frame, as measured against it.
    fn change_key(
        &mut self,
        frame: &AnyImage,
        exclude: Option<&Mask>,
        (fit, tracked): (Fit, TrackedFrame),
    ) -> TrackedFrame {
        self.since_change += 1;
        let pose = tracked.frame_from_reference.matrix();
        let in_view = fit.verdict.in_view;
        let choice = self
            .keys
            .choose(self.key, &pose, in_view, self.since_change, self.size);
        if choice == Choice::Keep {
            return tracked;
        }
        let window = Window::whole(self.size);
        let picture = Picture::new(frame, exclude, window, self.levels, &mut self.buffers);
        let tracked = if let Choice::Other(index) = choice {
            self.switch_key(index, &picture, &fit, tracked)
        } else {
            self.add_key(&picture, &fit, &tracked);
            tracked
        };
        self.buffers.recycle(picture);
        tracked
    }

    /// Measures the frame against another key as well, which ties the two.
    fn switch_key(
        &mut self,
        index: usize,
        picture: &Picture,
        fit: &Fit,
        tracked: TrackedFrame,
    ) -> TrackedFrame {
        let before = (self.key, self.motion.clone());
        self.use_key(index);
        let [gain, bias] = self.keys.all[index].light;
        self.motion.light.gain = tracked.gain / gain;
        self.motion.light.bias = tracked.bias - self.motion.light.gain * bias;
        let other = self.align_from(picture, &[self.motion.frame_from_reference]);
        let Some(other) = other.filter(Fit::is_found) else {
            (self.key, self.motion) = before;
            return tracked;
        };
        if let (Some(a), Some(b)) = (&fit.covariance, &other.covariance) {
            self.keys
                .tie((before.0, &fit.pose, a), (index, &other.pose, b), self.size);
        }
        self.settle_on(&other)
    }

    /// Makes a key of the frame.
    fn add_key(&mut self, picture: &Picture, fit: &Fit, tracked: &TrackedFrame) {
        let pose = tracked.frame_from_reference.matrix();
        let mask = if self.whole_frame {
            Mask::full(self.size)
        } else {
            let outline = self.outline.map(|p| project(&pose, p).unwrap_or(p));
            Mask::from_polygon(self.size, &outline).unwrap_or_else(|_| Mask::empty(self.size))
        };
        let coverage = picture.coverage(&mask);
        if let Some(template) = Template::new(picture, &coverage, self.dense)
            && let Some(covariance) = &fit.covariance
        {
            let measured = (self.key, &fit.pose, covariance);
            let index = self.keys.add(template, tracked, measured, self.size);
            self.use_key(index);
        }
    }

    fn use_key(&mut self, index: usize) {
        self.key = index;
        self.since_change = 0;
        self.motion.groups = None;
        self.motion.light = Light::SAME;
    }

    /// Refines the keyframes together, by all that ties them, and with them the poses of frames that were measured against them:
    /// where the plane has left the reference frame and come back, the error of the way is spread over it. Frames that are
    /// measured against the reference itself stay as they are. Returns `false` if there is nothing to refine.
    pub fn refine(&mut self, frames: &mut [TrackedFrame]) -> bool {
        self.keys.refine(frames, &self.quad, self.size)
    }

    /// Takes a pose, if it is sure enough.
    fn settle_on(&mut self, fit: &Fit) -> TrackedFrame {
        let Some(tracked) = self.tracked(fit) else {
            return self.lose();
        };
        let now = tracked.frame_from_reference.matrix();
        let residual = tracked.residual / fit.pose.light.gain;
        let velocity = self.motion.frame_from_reference.inverse() * now;
        self.motion = Motion {
            frame_from_reference: now * now.z_axis.z.recip(),
            velocity: if self.motion.lost_for == 0 {
                velocity
            } else {
                DMat3::IDENTITY
            },
            light: fit.pose.light,
            groups: Some(fit.verdict.groups.clone()),
            visible: fit.verdict.visible,
            similarity: fit.similarity,
            calm: residual.min(CALM_GROWTH * self.motion.calm),
            lost_for: 0,
        };
        tracked
    }

    /// A fit to the present key as a tracked frame; nothing if it says too little.
    fn tracked(&self, fit: &Fit) -> Option<TrackedFrame> {
        let Fit { pose, verdict, .. } = fit;
        let key = &self.keys.all[self.key];
        let matrix = pose.frame_from_units * key.reference_from_units.inverse();
        let frame_from_reference = Homography::from_matrix(matrix).ok()?;
        let [gain, bias] = key.light;
        let mut corners = self.quad;
        for corner in &mut corners {
            *corner = project(&matrix, *corner)?;
        }
        let mut tracked = TrackedFrame {
            state: TrackState::Tracked,
            frame_from_reference,
            corners,
            covariance: key.covariance_in(fit.covariance.as_ref()?, pose, &self.quad)?,
            inlier_share: verdict.inlier_share,
            visible: verdict.visible,
            residual: f64::from(fit.settled.scale),
            gain: pose.light.gain * gain,
            bias: pose.light.gain * bias + pose.light.bias,
            keyframe: self.key,
        };
        let diagonal = self.outline[0].distance(self.outline[2]);
        let sigma = tracked.sigma_px();
        if sigma > LOST_SIGMA * diagonal || (self.motion.lost_for > 0 && verdict.alike < WEAK_ALIKE)
        {
            return None;
        }
        // found again in one frame only, it may be a mistake
        let again = self.motion.lost_for > 0;
        let little = verdict.alike < WEAK_ALIKE || verdict.visible < WEAK_VISIBLE;
        // nothing is known before the first frame
        let calm = if self.motion.calm.is_finite() {
            self.motion.calm
        } else {
            0.0
        };
        let limit = MISFIT.max(MISFIT_GROWTH * calm);
        let misfit = tracked.residual > limit * pose.light.gain;
        if again || little || misfit || sigma > WEAK_SIGMA_PX {
            tracked.state = TrackState::Weak;
        }
        Some(tracked)
    }

    /// Reports the plane as lost; the pose is that of the last frame in which it was found.
    fn lose(&mut self) -> TrackedFrame {
        self.motion.lost_for += 1;
        self.motion.groups = None;
        let now = self.motion.frame_from_reference;
        // nothing is known
        let sigma = dvec2(self.size.width() as f64, self.size.height() as f64).length();
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

//! The state of a shot: its key frame, its last frame, and the way from one to the other.

use crate::camera::CameraMotionParams;
use crate::camera::align::{Fit, Pose, Scratch, align, approach, cost, evidence};
use crate::camera::picture::Picture;
use crate::camera::search::{best_shift, found_share};
use crate::camera::template::Template;
use crate::photos::{MatchParams, match_photos};
use glam::{DMat3, DVec2};
use ravec_progress::Progress;

/// The frames since the last cut, as far as they are remembered.
#[derive(Debug, Clone)]
pub(super) struct Shot {
    key: Template,
    key_from_first: DMat3,
    /// The last frame that is not plain.
    picture: Picture,
    /// Its pose.
    pose: Pose,
    /// The last motion between frames.
    motion: DMat3,
    /// The share of alike blocks when the key frame was new, and the residual.
    key_share: f64,
    key_sigma: f64,
    /// Textured blocks of the last frame.
    textured: f64,
    /// Frames since a new key frame was last tried.
    waited: usize,
    /// White frames that were passed over since the last one that was not.
    flashes: usize,
}

/// The verdict on a frame.
pub(super) enum Outcome {
    /// It starts a new shot.
    Cut(Picture),
    /// It belongs to the shot.
    Moved(Moved),
}

/// The motion at a frame of a shot, in normalized coordinates.
pub(super) struct Moved {
    pub frame_from_previous: DMat3,
    pub frame_from_shot: DMat3,
    pub share: f64,
    pub residual: f64,
    /// In working pixels.
    pub corner_sigma: f64,
    pub reliable: bool,
}

/// Motions of up to this share of the longer side are searched for in each frame, and wider ones if nothing else fits.
const REACH: f64 = 0.17;
const WIDE_REACH: f64 = 0.5;

/// A start that is less plain than another one must have a cost below this part of the other's.
const CLEARLY: f64 = 0.9;

/// Share of alike blocks from which a motion is believed.
const MIN_SHARE: f64 = 0.42;

/// Share of alike blocks, and residual as a share of the contrast, from which nothing else is compared to see a cut.
const SURE_SHARE: f64 = 0.6;
const SURE_NOISE: f64 = 0.3;

/// Share of textured blocks below which a picture says too little.
const MIN_JUDGED: f64 = 0.04;

/// Standard deviation of the corners, in working pixels, above which a simpler model is taken: that of a shift is more
/// certain.
const MAX_CORNER_SIGMA: f64 = 0.3;

/// The same, above which a motion says nothing.
const MAX_BELIEVED_SIGMA: f64 = 1.5;

/// A key frame is given up if less of it is in view, or if the share of alike blocks falls below this part of what it was.
const MIN_OVERLAP: f64 = 0.6;
const KEY_LOSS: f64 = 0.85;

/// It is given up as well if the residual grows by this factor, and a new key frame is better by as much: depth that a
/// homography cannot follow adds up with the way of the camera. Residuals below a bound (1 of 255 steps) are noise.
const KEY_RESIDUAL: f64 = 1.7;
const MIN_KEY_SIGMA: f64 = 0.004;

/// Share of alike blocks below which new key frames are tried, and the frames between two tries: what hid the background in the
/// present one may have gone.
const POOR_SHARE: f64 = 0.75;
const PATIENCE: usize = 6;

/// Motions against the key frame and against the previous frame whose corners differ by more, in working pixels, are not the
/// same.
const SAME_PX: f64 = 3.0;

/// A new key frame must be better by this share of blocks, or it is not worth its error.
const KEY_GAIN: f64 = 0.05;

/// Corners that move by less, in working pixels, have not moved.
const STILL_PX: f64 = 0.004;

/// Evidence above which a motion is better than a simpler one: a base, and for each unknown the evidence that chance makes in
/// two and a half blocks; in any case what is sure enough. A foreground of 40 % leaves 0.6 of 1.
const MIN_EVIDENCE: f64 = 0.05;
const CHANCE: f64 = 2.5;
const SURE_EVIDENCE: f64 = 0.6;

/// Part of a motion that was measured, but for which there is no evidence, which counts as the deviation of none.
const DOUBT: f64 = 0.25;

/// Blocks that must show the difference for each unknown, unless half of all textured blocks do.
const BLOCKS_PER_UNKNOWN: f64 = 3.0;

/// Growth of the share of white pixels from which a frame that fits nothing is a flash, and the maximum number of flashes in a row
/// that are passed over.
const FLASH: f32 = 0.3;
const MAX_FLASHES: usize = 4;

/// Mean absolute detail of the coarse picture below which it is plain, and the share of that of the last picture.
const PLAIN: f32 = 0.0015;
const PLAIN_SHARE: f32 = 0.25;

/// Matched features that agree, from which they are believed.
const MIN_MATCHES: usize = 12;

/// Share of the windows that are found again below which a frame is another shot for sure, and below which it is if its
/// histogram is another one, both at a sensitivity of 1.
const SURE_CUT: f64 = 0.4;
const LIKELY_CUT: f64 = 0.7;

impl Shot {
    pub fn new(picture: Picture) -> Self {
        Self {
            key: Template::new(&picture),
            key_from_first: DMat3::IDENTITY,
            picture,
            pose: Pose::still(),
            motion: DMat3::IDENTITY,
            key_share: 1.0,
            key_sigma: f64::INFINITY,
            textured: 0.0,
            waited: 0,
            flashes: 0,
        }
    }

    /// Takes the next frame.
    pub fn advance(
        &mut self,
        picture: Picture,
        params: &CameraMotionParams,
        scratch: &mut Scratch,
    ) -> Outcome {
        let last = self.picture.contrast;
        if last >= PLAIN && picture.contrast < PLAIN.max(PLAIN_SHARE * last) {
            return Outcome::Moved(self.unknown(0.0));
        }
        let shift = best_shift(&self.picture, &picture, REACH);
        let unknowns = params.model.unknowns();
        let starts = [DMat3::IDENTITY, self.motion, shift]
            .map(|motion| self.start(motion * self.pose.picture_from_template));
        let mut fit = fit_from(&self.key, &picture, &starts, unknowns, scratch);
        self.waited += 1;
        if !fit.as_ref().is_some_and(|fit| self.fits_key(fit)) {
            self.waited = 0;
            fit = self.renew_key(fit, &picture, shift, unknowns, scratch);
        }
        let sure = fit.as_ref().is_some_and(is_sure);
        if !sure && self.flashes < MAX_FLASHES && picture.white > FLASH + self.picture.white {
            self.flashes += 1;
            return Outcome::Moved(self.unknown(0.0));
        }
        self.flashes = 0;
        if !sure && self.is_cut(&picture, params.cut_sensitivity) {
            return Outcome::Cut(picture);
        }
        if let Some(fit) = fit.filter(is_believed) {
            return Outcome::Moved(self.settle(fit, picture, unknowns, scratch));
        }
        let moved = self.unknown(0.0);
        self.take_as_key(picture);
        Outcome::Moved(moved)
    }

    fn start(&self, motion: DMat3) -> Pose {
        Pose {
            picture_from_template: motion,
            ..self.pose
        }
    }

    fn fits_key(&self, fit: &Fit) -> bool {
        is_believed(fit)
            && fit.overlap >= MIN_OVERLAP
            && fit.share >= KEY_LOSS * self.key_share
            && fit.sigma <= KEY_RESIDUAL * self.key_sigma.max(MIN_KEY_SIGMA)
            && (fit.share >= POOR_SHARE || self.waited < PATIENCE)
    }

    /// Aligns to the previous frame, and takes it as the key frame if that is better than the alignment to the present one.
    fn renew_key(
        &mut self,
        with_key: Option<Fit>,
        picture: &Picture,
        shift: DMat3,
        unknowns: usize,
        scratch: &mut Scratch,
    ) -> Option<Fit> {
        let template = Template::new(&self.picture);
        let present = with_key.filter(is_believed);
        let fit = if let Some(present) = &present {
            self.same_motion(&template, present, picture, unknowns, scratch)
        } else {
            let starts = [DMat3::IDENTITY, self.motion, shift].map(Pose::from_motion);
            fit_from(&template, picture, &starts, unknowns, scratch)
                .filter(is_believed)
                .or_else(|| self.rescue(&template, picture, unknowns, scratch))
                .filter(is_believed)
        };
        let keeps = match (&present, &fit) {
            (Some(present), Some(fit)) => {
                present.overlap >= MIN_OVERLAP
                    && fit.share < present.share + KEY_GAIN
                    && fit.sigma > present.sigma / KEY_RESIDUAL
            }
            (present, _) => present.is_some(),
        };
        if keeps {
            let kept = present?;
            self.key_share = kept.share;
            self.key_sigma = kept.sigma;
            return Some(kept);
        }
        let fit = fit?;
        self.key = template;
        self.key_from_first = self.pose.picture_from_template * self.key_from_first;
        self.key_share = fit.share;
        self.key_sigma = fit.sigma;
        self.pose = Pose::still();
        Some(fit)
    }

    /// The fit to the previous frame that has the motion of one to the key frame, and not that of an object which only the
    /// previous frame shows.
    fn same_motion(
        &self,
        template: &Template,
        with_key: &Fit,
        picture: &Picture,
        unknowns: usize,
        scratch: &mut Scratch,
    ) -> Option<Fit> {
        let before = self.pose.picture_from_template;
        let motion = with_key.pose.picture_from_template * before.inverse();
        let start = Pose::from_motion(motion * motion.z_axis.z.recip());
        align(template, picture, start, unknowns, false, scratch)
            .filter(|fit| is_believed(fit) && distance_px(&fit.pose, &start, picture) <= SAME_PX)
    }

    /// A fit to the previous frame from a wide search, or from features.
    fn rescue(
        &self,
        template: &Template,
        picture: &Picture,
        unknowns: usize,
        scratch: &mut Scratch,
    ) -> Option<Fit> {
        let wide = Pose::from_motion(best_shift(&self.picture, picture, WIDE_REACH));
        let fit = fit_from(template, picture, &[wide], unknowns, scratch);
        if fit.as_ref().is_some_and(is_believed) {
            return fit;
        }
        let params = MatchParams {
            try_tilts: false,
            refine: false,
            ..MatchParams::default()
        };
        let (before, after) = (&self.picture.levels[0], &picture.levels[0]);
        let found = match_photos(before, after, &params, &Progress::none()).ok()?;
        if found.inliers < MIN_MATCHES {
            return None;
        }
        let frame = picture.frame();
        let pixels_from_normalized =
            DMat3::from_translation(frame.center) * DMat3::from_scale(DVec2::splat(frame.half));
        let motion = pixels_from_normalized.inverse()
            * found.second_from_first.matrix()
            * pixels_from_normalized;
        let start = Pose::from_motion(motion * motion.z_axis.z.recip());
        align(template, picture, start, unknowns, true, scratch)
    }

    /// Takes a motion against the key frame that is believed.
    fn settle(
        &mut self,
        fit: Fit,
        picture: Picture,
        unknowns: usize,
        scratch: &mut Scratch,
    ) -> Moved {
        let before = self.pose.picture_from_template;
        self.textured = fit.judged * self.key.levels[0].block_count as f64;
        let fit = self.simplest(fit, &picture, unknowns, scratch);
        let now = fit.pose.picture_from_template;
        let motion = if now == before {
            DMat3::IDENTITY
        } else {
            now * before.inverse()
        };
        self.motion = motion;
        self.pose = fit.pose;
        self.picture = picture;
        Moved {
            frame_from_previous: motion,
            frame_from_shot: now * self.key_from_first,
            share: fit.share,
            residual: fit.sigma,
            corner_sigma: fit.corner_sigma,
            reliable: fit.corner_sigma <= MAX_CORNER_SIGMA,
        }
    }

    /// The simplest motion that no more general one beats: that of the last frame, the same and a shift, the same and a turn
    /// and a zoom as well, or the fit.
    fn simplest(&self, fit: Fit, picture: &Picture, unknowns: usize, scratch: &mut Scratch) -> Fit {
        let before = Pose {
            picture_from_template: self.pose.picture_from_template,
            ..fit.pose
        };
        // a motion that was measured and is not believed may be one
        let stays = |pose: Pose, fit: Fit| Fit {
            corner_sigma: fit
                .corner_sigma
                .max(DOUBT * distance_px(&pose, &fit.pose, picture)),
            pose,
            ..fit
        };
        let distance = distance_px(&before, &fit.pose, picture);
        if distance <= STILL_PX
            || evidence(&self.key, picture, &fit.pose, &before, scratch).is_none()
        {
            return stays(before, fit);
        }
        let mut best = stays(before, fit.clone());
        let mut used = 0;
        for count in [2, 4] {
            if count >= unknowns {
                break;
            }
            let simple = align(&self.key, picture, best.pose, count, true, scratch);
            if let Some(simple) = simple
                && self.beats(&simple.pose, &best.pose, count - used, picture, scratch)
            {
                best = simple;
                used = count;
            }
        }
        if self.beats(&fit.pose, &best.pose, unknowns - used, picture, scratch) {
            best = fit;
            used = unknowns;
        }
        let still = Pose {
            picture_from_template: DMat3::IDENTITY,
            ..best.pose
        };
        if used > 0 && !self.beats(&best.pose, &still, used, picture, scratch) {
            return stays(still, best);
        }
        best
    }

    /// True if there is evidence that a pose with this many more `unknowns` is better than another one.
    fn beats(
        &self,
        pose: &Pose,
        other: &Pose,
        unknowns: usize,
        picture: &Picture,
        scratch: &mut Scratch,
    ) -> bool {
        let distance = distance_px(pose, other, picture);
        if distance <= STILL_PX {
            return false;
        }
        let found = evidence(&self.key, picture, pose, other, scratch);
        let textured = self.textured;
        found.is_some_and(|found| {
            // more unknowns explain more of chance
            let chance = CHANCE * unknowns as f64 / found.blocks as f64;
            let needed = (BLOCKS_PER_UNKNOWN * unknowns as f64).min(0.5 * textured);
            found.blocks as f64 >= needed && found.mean > (MIN_EVIDENCE + chance).min(SURE_EVIDENCE)
        })
    }

    /// Takes a frame as the key frame that stands where the last one does.
    fn take_as_key(&mut self, picture: Picture) {
        self.key_from_first = self.pose.picture_from_template * self.key_from_first;
        self.key = Template::new(&picture);
        self.key_share = 1.0;
        self.key_sigma = f64::INFINITY;
        self.pose = Pose::still();
        self.motion = DMat3::IDENTITY;
        self.picture = picture;
    }

    /// The motion where nothing is known: none.
    fn unknown(&self, share: f64) -> Moved {
        Moved {
            frame_from_previous: DMat3::IDENTITY,
            frame_from_shot: self.pose.picture_from_template * self.key_from_first,
            share,
            residual: 0.0,
            corner_sigma: f64::INFINITY,
            reliable: false,
        }
    }

    /// True if a frame that no motion explains is another shot.
    fn is_cut(&self, picture: &Picture, sensitivity: f64) -> bool {
        let difference = self.picture.histogram_difference(picture);
        match found_share(&self.picture, picture) {
            Some(found) => {
                found < SURE_CUT * sensitivity
                    || (found < LIKELY_CUT * sensitivity && difference > 0.15 / sensitivity)
            }
            // plain pictures: only their colors are left
            None => difference > 0.2 / sensitivity,
        }
    }
}

/// The mean distance by which two poses differ at the corners, in working pixels.
fn distance_px(a: &Pose, b: &Pose, picture: &Picture) -> f64 {
    let (a, b) = (&a.picture_from_template, &b.picture_from_template);
    picture.frame().corner_distance(a, b)
}

fn is_believed(fit: &Fit) -> bool {
    fit.share >= MIN_SHARE && fit.judged >= MIN_JUDGED && fit.corner_sigma <= MAX_BELIEVED_SIGMA
}

/// True if a fit leaves no doubt that both pictures show the same scene.
fn is_sure(fit: &Fit) -> bool {
    is_believed(fit)
        && fit.share >= SURE_SHARE
        && fit.noise <= SURE_NOISE
        && fit.corner_sigma <= MAX_CORNER_SIGMA
}

/// The best alignment: from the start that fits best at the coarsest level, with the most general model that the picture
/// determines.
fn fit_from(
    template: &Template,
    picture: &Picture,
    starts: &[Pose],
    unknowns: usize,
    scratch: &mut Scratch,
) -> Option<Fit> {
    let coarsest = template.levels.len() - 1;
    let (level, plane) = (&template.levels[coarsest], &picture.levels[coarsest]);
    if level.values.is_empty() {
        return None;
    }
    let mut best = (f64::INFINITY, starts[0]);
    for start in starts {
        let found = cost(level, plane, start, scratch);
        // a later start must be clearly better
        if found < CLEARLY * best.0 {
            best = (found, *start);
        }
    }
    let near = approach(template, picture, best.1, unknowns, scratch).unwrap_or(best.1);
    let mut last = None;
    for count in [8, 6, 4, 2] {
        if count > unknowns {
            continue;
        }
        if let Some(fit) = align(template, picture, near, count, false, scratch) {
            if fit.corner_sigma <= MAX_CORNER_SIGMA {
                return Some(fit);
            }
            last = Some(fit);
        }
    }
    last
}

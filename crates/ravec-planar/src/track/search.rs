//! Search for a plane whose place is not known: shifts of the last pose, and features.

use crate::estimate::PointPair;
use crate::features::{FeatureParams, Features};
use crate::matching::match_features;
use crate::robust::{RobustParams, estimate_robust};
use crate::track::align::{Scratch, sample};
use crate::track::judge::similarity;
use crate::track::picture::{Level, Picture};
use crate::track::template::{Samples, Template};
use glam::{DMat3, DVec2, dvec2};
use ravec_progress::Progress;
use ravec_raster::Plane;
use std::sync::{Arc, OnceLock};

/// Samples that are compared at every place of the frame.
const SCAN_SAMPLES: usize = 240;

/// Places that are aligned to after a scan.
const PLACES: usize = 3;

/// Frames in a row in which features are tried after a loss, and the period of later tries.
const EAGER_FRAMES: usize = 3;
const PATIENCE: usize = 5;

/// The ratio of distances below which two features match.
const MAX_RATIO: f64 = 0.8;

/// Longer side of the picture that features are found in, in pixels.
const FEATURE_PX: usize = 900;

/// Matches that must agree.
const MIN_MATCHES: usize = 10;

/// The best shift of a pose within `reach` pixels of the level, with its similarity.
pub(super) fn best_shift(
    samples: &Samples,
    level: &Level,
    frame_from_units: &DMat3,
    reach: i32,
    scratch: &mut Scratch,
) -> (f64, DMat3) {
    let step = f64::from(1u32 << level.index);
    let mut best = (f64::NEG_INFINITY, *frame_from_units);
    for dy in -reach..=reach {
        for dx in -reach..=reach {
            let shift = dvec2(f64::from(dx), f64::from(dy)) * step;
            let moved = DMat3::from_translation(shift) * *frame_from_units;
            sample(samples, level, &moved, &mut scratch.values);
            let found = similarity(samples, &scratch.values);
            if found > best.0 {
                best = (found, moved);
            }
        }
    }
    best
}

/// Means to find the plane anywhere.
#[derive(Debug, Clone)]
pub(super) struct Searcher {
    /// The region in the reference frame, and the place of its first pixel.
    reference: Plane,
    origin: DVec2,
    /// Its features, from the first time that they are needed.
    features: Arc<OnceLock<Features>>,
}

impl Searcher {
    pub fn new(picture: &Picture, coverage: &[f32]) -> Self {
        let level = &picture.levels[0];
        // what does not belong to the plane is even
        let values = (level.values.iter().zip(coverage)).map(|(&value, &covered)| {
            if covered > 0.5 && value.is_finite() {
                value
            } else {
                0.5
            }
        });
        let values = values.collect();
        Self {
            reference: Plane::from_vec(level.width, values).expect("a level is a rectangle"),
            origin: dvec2(level.left as f64, level.top as f64),
            features: Arc::default(),
        }
    }

    /// The plane by features: the map from the reference to the frame.
    pub fn by_features(&self, picture: &Picture) -> Option<DMat3> {
        let params = FeatureParams::default();
        let none = Progress::none();
        let reference = self
            .features
            .get_or_init(|| Features::detect(&self.reference, &params, &none).unwrap_or_default());
        let index = (0..picture.levels.len())
            .find(|&k| picture.levels[k].width.max(picture.levels[k].height) <= FEATURE_PX)
            .unwrap_or(picture.levels.len() - 1);
        let level = &picture.levels[index];
        let values = level
            .values
            .iter()
            .map(|&v| if v.is_nan() { 0.5 } else { v });
        let plane = Plane::from_vec(level.width, values.collect()).ok()?;
        let found = Features::detect(&plane, &params, &none).ok()?;
        let scale = f64::from(1u32 << index);
        let corner = dvec2(level.left as f64, level.top as f64);
        let pairs: Vec<PointPair> = match_features(reference, &found, MAX_RATIO)
            .iter()
            .map(|pair| {
                let first = reference.points[pair.first].at + self.origin;
                let second = (found.points[pair.second].at + corner) * scale;
                PointPair::new(first, second)
            })
            .collect();
        let fit = estimate_robust(&pairs, &RobustParams::default()).ok()?;
        (fit.inlier_count >= MIN_MATCHES).then(|| fit.dst_from_src.matrix())
    }
}

/// True if features are tried in a frame, `lost_for` frames after the loss.
pub(super) fn is_due(lost_for: usize) -> bool {
    lost_for < EAGER_FRAMES || lost_for.is_multiple_of(PATIENCE)
}

/// The best places of the plane in a frame, in the attitude that it had last, with their similarities.
pub(super) fn best_places(
    template: &Template,
    picture: &Picture,
    last: &DMat3,
    scratch: &mut Scratch,
) -> Vec<(f64, DMat3)> {
    let samples = &template.levels[template.levels.len() - 1];
    let level = &picture.levels[picture.levels.len() - 1];
    let thin = thinned(samples);
    let step = f64::from(1u32 << level.index);
    let center = *last * DVec2::ZERO.extend(1.0);
    let center = center.truncate() / center.z;
    if !center.is_finite() {
        return Vec::new();
    }
    let mut scores: Vec<(f64, DMat3, DVec2)> = Vec::new();
    for row in 0..level.height {
        for col in 0..level.width {
            let place = dvec2(
                (level.left + col) as f64 + 0.5,
                (level.top + row) as f64 + 0.5,
            );
            let moved = DMat3::from_translation(place * step - center) * *last;
            sample(&thin, level, &moved, &mut scratch.values);
            scores.push((correlation(&thin, &scratch.values), moved, place));
        }
    }
    scores.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut chosen: Vec<(f64, DMat3, DVec2)> = Vec::new();
    for (_, moved, place) in scores.into_iter().take(40 * PLACES) {
        if chosen.iter().any(|other| other.2.distance(place) < 4.0) {
            continue;
        }
        let found = best_shift(samples, level, &moved, 1, scratch);
        chosen.push((found.0, found.1, place));
        if chosen.len() == 2 * PLACES {
            break;
        }
    }
    chosen.sort_by(|a, b| b.0.total_cmp(&a.0));
    chosen.truncate(PLACES);
    chosen
        .into_iter()
        .map(|(score, pose, _)| (score, pose))
        .collect()
}

/// Some of the samples, as one block.
fn thinned(samples: &Samples) -> Samples {
    let stride = samples.len().div_ceil(SCAN_SAMPLES);
    let pick = |from: &[f32]| from.iter().copied().step_by(stride).collect::<Vec<f32>>();
    Samples {
        level: samples.level,
        u: pick(&samples.u),
        v: pick(&samples.v),
        value: pick(&samples.value),
        mean: samples.mean,
        ..Samples::default()
    }
}

/// Correlation of all samples in view; less with few.
fn correlation(samples: &Samples, values: &[f32]) -> f64 {
    let [mut n, mut t, mut y, mut tt, mut yy, mut ty] = [0.0f32; 6];
    for (&a, &b) in samples.value.iter().zip(values) {
        if !b.is_nan() {
            n += 1.0;
            t += a;
            y += b;
            tt += a * a;
            yy += b * b;
            ty += a * b;
        }
    }
    if n < 16.0 {
        return -1.0;
    }
    let product = (tt - t * t / n) * (yy - y * y / n);
    let seen = n / samples.len() as f32;
    if product <= 0.0 {
        return 0.0;
    }
    f64::from((ty - t * y / n) / product.sqrt() * seen.sqrt())
}

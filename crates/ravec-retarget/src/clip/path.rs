//! Deformations of frames from those of key times.
//!
//! ```text
//! between two key times vertices go straight
//! each frame's are the mean over the frames around it, over fewer the faster the camera moves
//! ```
//!
//! Both are convex combinations of key deformations of one grid. The bounds that exclude folds are convex, so whatever is
//! made of key deformations without folds has none.

use crate::deformation::Deformation;
use glam::DVec2;
use std::collections::VecDeque;
use std::sync::Arc;

/// Frames from one key time to the next where the camera stands. More costs less and follows later.
pub(super) const KEY_FRAMES: usize = 4;

/// Frames on each side over which deformations are averaged where the camera stands.
pub(super) const SMOOTHING: usize = 4;

/// The steady deformations of a key time, one for each target.
#[derive(Debug, Clone)]
pub(super) struct Key {
    pub(super) frame: usize,
    pub(super) deformations: Arc<Vec<Deformation>>,
}

/// Shares of the keys in the deformation of `frame`, averaged over `radius` frames on each side that lie in the shot, which
/// ends with frame `last`.
///
/// There must be a key at or before the first of these frames, or the first key is that of the first frame; and one at or after the
/// last.
pub(super) fn shares(
    keys: &VecDeque<Key>,
    frame: usize,
    first: usize,
    last: usize,
    radius: f64,
) -> Vec<(usize, f64)> {
    let mut shares = vec![0.0; keys.len()];
    let reach = radius.floor() as usize;
    let mut total = 0.0;
    for at in frame.saturating_sub(reach).max(first)..=(frame + reach).min(last) {
        let angle = std::f64::consts::PI * frame.abs_diff(at) as f64 / (radius + 1.0);
        let weight = 0.5 + 0.5 * angle.cos();
        total += weight;
        let after = keys.partition_point(|key| key.frame < at);
        if after == 0 {
            shares[0] += weight;
        } else if after == keys.len() {
            shares[after - 1] += weight;
        } else {
            let [from, to] = [after - 1, after].map(|k: usize| keys[k].frame);
            let share = (at - from) as f64 / (to - from) as f64;
            shares[after - 1] += weight * (1.0 - share);
            shares[after] += weight * share;
        }
    }
    shares
        .into_iter()
        .enumerate()
        .filter(|&(_, share)| share > 0.0)
        .map(|(key, share)| (key, share / total))
        .collect()
}

/// The deformation of a frame for target number `target`, from shares of the keys; those of `nearest` count as its content.
pub(super) fn deformation(
    keys: &VecDeque<Key>,
    shares: &[(usize, f64)],
    nearest: usize,
    target: usize,
) -> Deformation {
    let deformations = &keys[nearest].deformations;
    let mut found = deformations[target].clone();
    let same = |&(key, _): &(usize, f64)| Arc::ptr_eq(&keys[key].deformations, deformations);
    if shares.iter().all(same) {
        return found;
    }
    for (vertex, at) in found.vertices.iter_mut().enumerate() {
        *at = shares
            .iter()
            .map(|&(key, share)| share * keys[key].deformations[target].vertices[vertex])
            .sum();
    }
    found.summary.least_area = found.least_area();
    found
}

/// The largest second difference of three places of the vertices, one after the other.
pub(super) fn second_difference(places: [&[DVec2]; 3]) -> f64 {
    let [before, here, after] = places;
    before
        .iter()
        .zip(here)
        .zip(after)
        .map(|((&a, &b), &c)| (a - 2.0 * b + c).length())
        .fold(0.0, f64::max)
}

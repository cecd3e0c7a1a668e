//! Keyframes: frames that others are measured against, where the reference is out of sight.

use crate::homography::Homography;
use crate::track::align::{Pose, project};
use crate::track::judge::PoseCovariance;
use crate::track::offsets::{
    Matrix, carried, covariance_of, inverse_jacobian, jacobian, matrix_of,
};
use crate::track::record::{CornerCovariance, TrackedFrame};
use crate::track::template::Template;
use crate::track::ties::{MAX_KEYFRAMES, Tie, tie_keyframes};
use glam::{DMat3, DVec2, dvec2};
use ravec_raster::Size;

/// Share of the samples of a key that must be in view for it to stay in use.
const MIN_IN_VIEW: f64 = 0.55;

/// Share from which a key that is nearer to the reference is taken instead, and the period in frames in which such keys are looked
/// for.
const RETURN_IN_VIEW: f64 = 0.6;
const PERIOD: usize = 8;

/// Share of the variance of a key up to which another one is nearer to the reference.
const NEARER: f64 = 0.8;

/// A frame whose plane is known.
#[derive(Debug, Clone)]
pub(super) struct Key {
    pub template: Template,
    /// Pixels of the reference frame from units of the template.
    pub reference_from_units: DMat3,
    /// Gain and bias against the reference.
    pub light: [f64; 2],
    frame_from_reference: Homography,
    /// Covariance of the corners of the quadrilateral in the frame of the key.
    covariance: Matrix,
}

/// The reference and the keyframes.
#[derive(Debug, Clone)]
pub(super) struct Keys {
    pub all: Vec<Key>,
    ties: Vec<Tie>,
}

/// The key for the next frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Choice {
    Keep,
    Other(usize),
    New,
}

/// A measurement of a frame: number of the key, pose, covariance.
type Measured<'a> = (usize, &'a Pose, &'a PoseCovariance);

/// Corners of a frame of this size.
fn frame_corners(size: Size) -> [DVec2; 4] {
    let (x, y) = (size.width() as f64, size.height() as f64);
    [dvec2(0.0, 0.0), dvec2(x, 0.0), dvec2(x, y), dvec2(0.0, y)]
}

impl Key {
    /// Covariance of the corners of the quadrilateral in a frame that was measured against this key, with that of the key.
    pub fn covariance_in(
        &self,
        measured: &PoseCovariance,
        pose: &Pose,
        quad: &[DVec2; 4],
    ) -> Option<CornerCovariance> {
        let units_from_reference = self.reference_from_units.inverse();
        let own = measured.of_points(pose, &project_all(&units_from_reference, quad)?)?;
        let frame_from_reference =
            Homography::from_matrix(pose.frame_from_units * units_from_reference).ok()?;
        let carried = self.carried(&frame_from_reference, quad)?;
        Some(covariance_of(&(own + carried)))
    }

    /// The covariance of the key itself, carried to a frame.
    fn carried(&self, frame_from_reference: &Homography, quad: &[DVec2; 4]) -> Option<Matrix> {
        if self.covariance.iter().all(|&v| v == 0.0) {
            return Some(self.covariance);
        }
        let frame_from_key = *frame_from_reference * self.frame_from_reference.inverse();
        let in_key = project_all(&self.frame_from_reference.matrix(), quad)?;
        Some(carried(
            &jacobian(&frame_from_key, &in_key),
            &self.covariance,
        ))
    }

    /// Share of the samples that a pose brings into the frame.
    fn in_view(&self, frame_from_reference: &DMat3, size: Size) -> f64 {
        let full = dvec2(size.width() as f64, size.height() as f64);
        let samples = &self.template.levels[self.template.levels.len() - 1];
        let frame_from_units = *frame_from_reference * self.reference_from_units;
        let inside = (0..samples.len()).filter(|&i| {
            let place = project(&frame_from_units, samples.place(i));
            place.is_some_and(|p| p.cmpgt(DVec2::ZERO).all() && p.cmplt(full).all())
        });
        inside.count() as f64 / samples.len() as f64
    }
}

fn project_all(m: &DMat3, points: &[DVec2; 4]) -> Option<[DVec2; 4]> {
    let mut images = [DVec2::ZERO; 4];
    for (image, &point) in images.iter_mut().zip(points) {
        *image = project(m, point)?;
    }
    Some(images)
}

impl Keys {
    /// The reference alone.
    pub fn new(template: Template) -> Self {
        let reference = Key {
            reference_from_units: template.units.pixels_from_units(),
            template,
            light: [1.0, 0.0],
            frame_from_reference: Homography::IDENTITY,
            covariance: Matrix::zeros(),
        };
        Self {
            all: vec![reference],
            ties: Vec::new(),
        }
    }

    /// The key for the frames after one with a pose, in which a share of the samples of the present key is in view.
    pub fn choose(
        &self,
        present: usize,
        frame_from_reference: &DMat3,
        in_view: f64,
        since_change: usize,
        size: Size,
    ) -> Choice {
        let leaves = in_view < MIN_IN_VIEW;
        if !leaves && (present == 0 || !since_change.is_multiple_of(PERIOD)) {
            return Choice::Keep;
        }
        let limit = NEARER * self.all[present].covariance.trace();
        let nearest = (self.all.iter().enumerate())
            .filter(|&(index, key)| {
                index != present
                    && (leaves || key.covariance.trace() < limit)
                    && key.in_view(frame_from_reference, size) >= RETURN_IN_VIEW
            })
            .min_by(|a, b| a.1.covariance.trace().total_cmp(&b.1.covariance.trace()));
        match nearest {
            Some((index, _)) => Choice::Other(index),
            None if leaves && self.all.len() < MAX_KEYFRAMES => Choice::New,
            None => Choice::Keep,
        }
    }

    /// Makes a key of a frame; its number.
    pub fn add(
        &mut self,
        template: Template,
        tracked: &TrackedFrame,
        measured: Measured<'_>,
        size: Size,
    ) -> usize {
        let frame_from_reference = tracked.frame_from_reference;
        let reference_from_units =
            frame_from_reference.inverse().matrix() * template.units.pixels_from_units();
        let index = self.all.len();
        if let Some(tie) = self.tie_to_frame(measured, index, size) {
            self.ties.push(tie);
        }
        self.all.push(Key {
            template,
            reference_from_units: reference_from_units * reference_from_units.z_axis.z.recip(),
            light: [tracked.gain, tracked.bias],
            frame_from_reference,
            covariance: matrix_of(&tracked.covariance),
        });
        index
    }

    /// The measurement of a frame as a tie from its key to the frame, which is to become the key `to`.
    fn tie_to_frame(
        &self,
        (from, pose, covariance): Measured<'_>,
        to: usize,
        size: Size,
    ) -> Option<Tie> {
        let key = &self.all[from];
        let points = frame_corners(size);
        let key_from_units = key.frame_from_reference.matrix() * key.reference_from_units;
        let in_units = project_all(&key_from_units.inverse(), &points)?;
        let to_from =
            Homography::from_matrix(pose.frame_from_units * key_from_units.inverse()).ok()?;
        Some(Tie {
            from,
            to,
            to_from,
            points,
            covariance: covariance_of(&covariance.of_points(pose, &in_units)?),
        })
    }

    /// Ties two keys by one frame that was measured against both.
    pub fn tie(&mut self, a: Measured<'_>, b: Measured<'_>, size: Size) {
        let tie = self.tie_by_frame(a, b, size);
        self.ties.extend(tie);
    }

    fn tie_by_frame(&self, a: Measured<'_>, b: Measured<'_>, size: Size) -> Option<Tie> {
        let to_frame = self.tie_to_frame(a, b.0, size)?;
        let images = project_all(&to_frame.to_from.matrix(), &to_frame.points)?;
        let key = &self.all[b.0];
        let key_from_units = key.frame_from_reference.matrix() * key.reference_from_units;
        let in_units = project_all(&b.1.frame_from_units.inverse(), &images)?;
        let in_frame = b.2.of_points(b.1, &in_units)? + matrix_of(&to_frame.covariance);
        let frame_from_b =
            Homography::from_matrix(b.1.frame_from_units * key_from_units.inverse()).ok()?;
        let in_key = project_all(&frame_from_b.inverse().matrix(), &images)?;
        let back = inverse_jacobian(&frame_from_b, &in_key)?;
        Some(Tie {
            to_from: frame_from_b.inverse() * to_frame.to_from,
            covariance: covariance_of(&carried(&back, &in_frame)),
            ..to_frame
        })
    }

    /// Refines the keys together, and the poses of frames that were measured against them; false if there is nothing to refine.
    pub fn refine(&mut self, frames: &mut [TrackedFrame], quad: &[DVec2; 4], size: Size) -> bool {
        if self.ties.len() < self.all.len() {
            return false;
        }
        let maps: Vec<Homography> = self
            .all
            .iter()
            .map(|key| key.frame_from_reference)
            .collect();
        let Ok(tied) = tie_keyframes(&maps, &frame_corners(size), &self.ties) else {
            return false;
        };
        let mut refined = self.all.clone();
        for (index, key) in refined.iter_mut().enumerate().skip(1) {
            let map = tied.keyframe_from_reference[index];
            let covariance = tied.covariance(index, quad);
            let (Some(covariance), key_from_units) = (
                covariance,
                key.frame_from_reference.matrix() * key.reference_from_units,
            ) else {
                return false;
            };
            let reference_from_units = map.inverse().matrix() * key_from_units;
            key.reference_from_units = reference_from_units * reference_from_units.z_axis.z.recip();
            key.frame_from_reference = map;
            key.covariance = matrix_of(&covariance);
        }
        for frame in frames {
            let (Some(old), Some(new)) =
                (self.all.get(frame.keyframe), refined.get(frame.keyframe))
            else {
                continue;
            };
            if frame.keyframe > 0 {
                refine_frame(frame, old, new, quad);
            }
        }
        self.all = refined;
        true
    }
}

/// Replaces the key that a frame was measured against.
fn refine_frame(frame: &mut TrackedFrame, old: &Key, new: &Key, quad: &[DVec2; 4]) -> Option<()> {
    let before = frame.frame_from_reference;
    let after = before * old.frame_from_reference.inverse() * new.frame_from_reference;
    let corners = project_all(&after.matrix(), quad)?;
    let change = new.carried(&after, quad)? - old.carried(&before, quad)?;
    frame.covariance = covariance_of(&(matrix_of(&frame.covariance) + change));
    frame.frame_from_reference = after;
    frame.corners = corners;
    Some(())
}

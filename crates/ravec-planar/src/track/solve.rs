//! Corrections by hand, and what follows from them for the other frames.
//!
//! ```text
//! the pose of a frame is its measured pose after an offset of the quad's corners on the plane: frame_from_reference · (quad + d)
//! a frame either agrees with its measurement (d = 0) or slides along with its neighbors, at a price
//! sliding offsets are a random walk: what two neighbors were measured apart is good even where both are off
//! between two knots (corrections, the reference) the cheapest of all ways:
//!     slide all the way, or return to the measurements at b and leave them at a ≥ b
//! a slide of n steps from 0 to v costs vᵀ (Σ Q)⁻¹ v + the prices of its frames
//! ```
//!
//! A random walk between two fixed ends has a closed form, with S the sum of the steps' covariances up to a frame and Σ that of
//! all: the mean is S Σ⁻¹ of the way from one end to the other, the covariance S − S Σ⁻¹ S.
//!
//! A step has β times the mean of its frames' measured covariances, so that offsets change where the measurement is weak. β is 1
//! for corrections of the size of the noise, which then reach as many frames as they have standard deviations, and grows
//! with the square of larger ones, so that none reaches farther than thirty into frames that contradict it. A
//! measured jump, which is the end of a slide, lets the offset jump the same way.
//!
//! Frames that are lost are bridged by smooth motion (see `bridge`) if a correction lies among them.
//!
//! Guarantees: corrected frames have the given corners bit for bit, the reference is fixed, frames that no correction reaches are
//! unchanged bit for bit; the order of time does not matter. Does not guarantee: that a slide begins where no measurement shows
//! it. Cost: O(frames), some microseconds each.

use crate::homography::{Homography, HomographyError};
use crate::track::bridge::{Knot as Place, bridge, end_speed, step_variance};
use crate::track::offsets::{
    Matrix, Vector, carried, covariance_of, inverse_jacobian, jacobian, matrix_of, points_of,
    vector_of,
};
use crate::track::record::{Track, TrackState};
use crate::track::walk::{Walk, fill};
use glam::DVec2;
use serde::{Deserialize, Serialize};

#[cfg(test)]
mod tests;

/// Corners that somebody has set in a frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Correction {
    /// Number of the frame in the clip, from 0.
    pub frame: u64,
    /// Corners of the quadrilateral in that frame, in pixels, in the order of [`Track::quad`].
    pub corners: [DVec2; 4],
}

/// Why corrections cannot be applied.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CorrectError {
    /// The frame is not part of the track.
    #[error("frame {frame} is corrected, but the track has frames {first} to {last} only")]
    OutOfRange {
        /// Number of the corrected frame.
        frame: u64,
        /// Number of the first frame of the track.
        first: u64,
        /// Number of the last frame of the track.
        last: u64,
    },
    /// The reference frame says where the quadrilateral is; it has nothing to be corrected.
    #[error(
        "frame {frame} is the reference, where the corners are those of the quadrilateral; correct another frame, or track \
         another quadrilateral"
    )]
    Reference {
        /// Number of the reference frame.
        frame: u64,
    },
    /// Two corrections of one frame.
    #[error("frame {frame} is corrected twice; keep one of the corrections")]
    Repeated {
        /// Number of the frame.
        frame: u64,
    },
    /// Corners that are no quadrilateral in perspective.
    #[error("the corners set in frame {frame} are no rectangle in perspective: {source}")]
    Quad {
        /// Number of the frame.
        frame: u64,
        /// Fault of the corners.
        source: HomographyError,
    },
    /// The quadrilateral would fold between corrections.
    #[error("between corrections the corners of frame {frame} would cross; correct that frame too")]
    Folded {
        /// Number of the frame.
        frame: u64,
    },
}

/// Standard deviation of corners set by hand, in pixels.
const HAND_PX: f64 = 0.05;

/// Deviation that every measured frame has at least, in pixels: predicted ones may be zero.
const FLOOR_PX: f64 = 0.02;

/// Measured acceleration, in multiples of the common one, above which it is a jump of the measurement, if it is also larger than a
/// pixel share.
const JUMP: f64 = 6.0;
const MIN_JUMP_PX: f64 = 0.1;

/// Corners closer than this to those measured, in pixels, are no correction.
const SAME_PX: f64 = 1e-6;

/// Deviation, in sides of the quadrilateral, up to which a lost frame between corrections counts as found.
const MAX_SIGMA_SIDES: f64 = 0.25;

/// Deviation from which a frame is weak, in pixels: two of them are a pixel.
const WEAK_PX: f64 = 0.5;

/// A frame as the solver sees it.
#[derive(Debug, Clone)]
pub(super) struct Node {
    /// Measured pose, or that of the bridge.
    pub base: Homography,
    /// Covariance of the measured corners, on the plane; zero where nothing is measured.
    pub noise: Matrix,
    /// The same, never singular, for the steps of the walk.
    pub spread: Matrix,
    /// The frame was measured.
    pub measured: bool,
    /// Price of a frame that departs from its measurement.
    pub price: f64,
}

/// A frame whose offset is given.
#[derive(Debug, Clone)]
pub(super) struct Knot {
    pub at: usize,
    pub offset: Vector,
    pub covariance: Matrix,
    /// Factor of the steps' covariances around it, at least 1.
    pub stiffness: f64,
}

impl Track {
    /// The track with corners corrected in some frames, and with what follows from them for the others.
    ///
    /// Corrected frames get exactly the given corners and are `Tracked`. Around them the measured motion is kept and its error
    /// spread, up to about thirty frames into frames that contradict the correction, or all the way to another correction that
    /// agrees with it. Lost frames between corrections and frames where the plane is found are filled in by smooth motion and
    /// become `Weak`, unless that could be anywhere. No other frame changes, and corrections equal to the present corners
    /// change none.
    ///
    /// Corrections are relative to this track: keep the track as it was measured, collect all corrections, and apply them
    /// together.
    ///
    /// # Errors
    /// [`CorrectError`].
    pub fn corrected(&self, corrections: &[Correction]) -> Result<Self, CorrectError> {
        let corrections = self.checked(corrections)?;
        if corrections.is_empty() {
            return Ok(self.clone());
        }
        let acceleration = self.acceleration();
        let mut nodes: Vec<Option<Node>> = (0..self.frames.len()).map(|at| self.node(at)).collect();
        let mut steps = self.bridge_lost(&corrections, acceleration, &mut nodes)?;
        self.allow_jumps(&nodes, &mut steps);
        let walk = Walk {
            nodes: &nodes,
            steps: &steps,
        };
        let knots = self.knots(&corrections, &walk);
        let mut offsets = vec![None; nodes.len()];
        for slide in walk.plan(&knots) {
            fill(&walk, &slide, &mut offsets);
        }
        self.with_offsets(&corrections, &nodes, &offsets)
    }

    /// Corrections by place in the track, in the order of time, without those that are none.
    fn checked(
        &self,
        corrections: &[Correction],
    ) -> Result<Vec<(usize, [DVec2; 4])>, CorrectError> {
        let mut checked: Vec<(usize, [DVec2; 4])> = Vec::with_capacity(corrections.len());
        for &Correction { frame, corners } in corrections {
            let at = frame
                .checked_sub(self.first)
                .and_then(|at| usize::try_from(at).ok())
                .filter(|&at| at < self.frames.len())
                .ok_or(CorrectError::OutOfRange {
                    frame,
                    first: self.first,
                    last: self.first + (self.frames.len() as u64).saturating_sub(1),
                })?;
            Homography::from_pairs(&self.quad, &corners)
                .map_err(|source| CorrectError::Quad { frame, source })?;
            if frame == self.reference {
                let same = corners
                    .iter()
                    .zip(&self.quad)
                    .all(|(a, b)| a.distance(*b) < SAME_PX);
                if same {
                    continue;
                }
                return Err(CorrectError::Reference { frame });
            }
            checked.push((at, corners));
        }
        checked.sort_by_key(|&(at, _)| at);
        match checked.windows(2).find(|pair| pair[0].0 == pair[1].0) {
            Some(pair) => Err(CorrectError::Repeated {
                frame: self.first + pair[0].0 as u64,
            }),
            None => Ok(checked),
        }
    }

    /// A measured frame; nothing where the plane is lost, or where the record makes no sense.
    fn node(&self, at: usize) -> Option<Node> {
        let frame = &self.frames[at];
        let price = match frame.state {
            TrackState::Tracked => 1.0,
            TrackState::Weak => 0.25,
            TrackState::Lost => return None,
        };
        let covariance = matrix_of(&frame.covariance);
        if !covariance.iter().all(|v| v.is_finite()) {
            return None;
        }
        let base = frame.frame_from_reference;
        let back = inverse_jacobian(&base, &self.quad)?;
        // half of it spread evenly: a covariance from few blocks of pixels has directions of no variance
        let even = 0.5 * (covariance.trace() / 8.0).max(0.0) + FLOOR_PX * FLOOR_PX;
        let spread = covariance * 0.5 + Matrix::identity() * even;
        // a covariance with negative directions is none
        spread.cholesky()?;
        Some(Node {
            base,
            noise: carried(&back, &covariance),
            spread: carried(&back, &spread),
            measured: true,
            price,
        })
    }

    /// The common change of speed from frame to frame, in pixels: a robust deviation over all corners.
    fn acceleration(&self) -> f64 {
        let side = mean_side(&self.quad);
        let mut found: Vec<f64> = Vec::new();
        for triple in self.frames.windows(3) {
            if triple.iter().all(|frame| frame.state != TrackState::Lost) {
                let [a, b, c] = [0, 1, 2].map(|k| vector_of(&triple[k].corners));
                found.extend((a - b * 2.0 + c).iter().map(|v| v.abs()));
            }
        }
        if found.is_empty() {
            return 0.01 * side;
        }
        let middle = found.len() / 2;
        let (_, median, _) = found.select_nth_unstable_by(middle, f64::total_cmp);
        (*median / 0.6745).clamp(FLOOR_PX, side)
    }

    /// Fills in the lost frames between corrections and measured frames, and returns the covariances of the steps that are not
    /// those of measurements: step k leads from frame k to the next.
    fn bridge_lost(
        &self,
        corrections: &[(usize, [DVec2; 4])],
        acceleration: f64,
        nodes: &mut [Option<Node>],
    ) -> Result<Vec<Matrix>, CorrectError> {
        let mut steps = vec![Matrix::zeros(); nodes.len()];
        let measured: Vec<bool> = nodes.iter().map(Option::is_some).collect();
        let mut end = 0;
        while let Some(start) = (end..nodes.len()).find(|&at| !measured[at]) {
            end = (start..nodes.len())
                .find(|&at| measured[at])
                .unwrap_or(nodes.len());
            let inside = corrections
                .iter()
                .filter(|(at, _)| (start..end).contains(at));
            let mut places: Vec<Place> = inside
                .map(|(at, corners)| Place {
                    at: *at,
                    corners: vector_of(corners),
                    speed: None,
                })
                .collect();
            if places.is_empty() {
                continue;
            }
            let corners = |at: usize| vector_of(&self.frames[at].corners);
            if start > 0 {
                let run = (0..start).rev().take_while(|&at| measured[at]).count();
                places.insert(
                    0,
                    Place {
                        at: start - 1,
                        corners: corners(start - 1),
                        speed: end_speed(run, |k| corners(start - 1 - k)),
                    },
                );
            }
            if end < nodes.len() {
                let run = (end..nodes.len()).take_while(|&at| measured[at]).count();
                places.push(Place {
                    at: end,
                    corners: corners(end),
                    speed: end_speed(run, |k| corners(end + k)).map(|speed| -speed),
                });
            }
            self.put_bridge(&places, acceleration, nodes, &mut steps)?;
        }
        Ok(steps)
    }

    /// Nodes and steps of one bridge.
    fn put_bridge(
        &self,
        places: &[Place],
        acceleration: f64,
        nodes: &mut [Option<Node>],
        steps: &mut [Matrix],
    ) -> Result<(), CorrectError> {
        let path = bridge(places);
        let ends = [places.first(), places.last()].into_iter().flatten();
        let ends = ends.map(|place| (place.at, place.corners));
        for (at, corners) in path.into_iter().chain(ends) {
            if nodes[at].is_some() {
                continue;
            }
            let base = Homography::from_pairs(&self.quad, &points_of(&corners))
                .map_err(|_| self.folded(at))?;
            nodes[at] = Some(Node {
                base,
                noise: Matrix::zeros(),
                spread: Matrix::zeros(),
                measured: false,
                price: 0.0,
            });
        }
        for pair in places.windows(2) {
            let variance = step_variance(acceleration, pair[1].at - pair[0].at);
            let pixels = Matrix::identity() * variance;
            let range = pair[0].at..pair[1].at;
            for (at, step) in range.clone().zip(&mut steps[range]) {
                let found = self.step_on_plane(nodes, at, &pixels);
                *step = found.ok_or_else(|| self.folded(at))?;
            }
        }
        Ok(())
    }

    fn folded(&self, at: usize) -> CorrectError {
        CorrectError::Folded {
            frame: self.first + at as u64,
        }
    }

    /// The covariance on the plane of a step from frame `at` to the next, from that in pixels: the mean of both frames' views.
    fn step_on_plane(&self, nodes: &[Option<Node>], at: usize, pixels: &Matrix) -> Option<Matrix> {
        let mut sum = Matrix::zeros();
        for node in &nodes[at..at + 2] {
            let back = inverse_jacobian(&node.as_ref()?.base, &self.quad)?;
            sum += carried(&back, pixels) * 0.5;
        }
        Some(sum)
    }

    /// Widens the steps at which the measurement jumps.
    fn allow_jumps(&self, nodes: &[Option<Node>], steps: &mut [Matrix]) {
        let corners = |at: usize| vector_of(&self.frames[at].corners);
        let jump = |at: usize| {
            let around = at.checked_sub(1)?..at + 3;
            let known = around.end <= nodes.len()
                && nodes[around]
                    .iter()
                    .all(|node| node.as_ref().is_some_and(|node| node.measured));
            // the step less the mean of the one before and the one after
            known.then(|| {
                (corners(at + 1) - corners(at)) * 1.5 - (corners(at + 2) - corners(at - 1)) * 0.5
            })
        };
        let jumps: Vec<Option<Vector>> = (0..nodes.len()).map(jump).collect();
        let sizes: Vec<f64> = jumps
            .iter()
            .map(|jump| jump.map_or(0.0, |jump| jump.norm() / 8f64.sqrt()))
            .collect();
        let mut sorted: Vec<f64> = sizes.iter().copied().filter(|&size| size > 0.0).collect();
        sorted.sort_by(f64::total_cmp);
        let common = sorted.get(sorted.len() / 2).copied().unwrap_or(0.0);
        for (at, found) in jumps.iter().enumerate() {
            let Some(jump) = found else { continue };
            // the steps beside a jump seem to jump by half of it the other way
            let beside = |other: Option<usize>| {
                other.and_then(|k| sizes.get(k)).copied().unwrap_or(0.0) < sizes[at] / 1.5
            };
            if sizes[at] < (JUMP * common).max(MIN_JUMP_PX)
                || !beside(at.checked_sub(1))
                || !beside(Some(at + 1))
            {
                continue;
            }
            let square = 0.01 * sizes[at] * sizes[at];
            let covariance = jump * jump.transpose() + Matrix::identity() * square;
            if let Some(step) = self.step_on_plane(nodes, at, &covariance) {
                steps[at] += step;
            }
        }
    }

    /// Corrections and the reference, in the order of time.
    fn knots(&self, corrections: &[(usize, [DVec2; 4])], walk: &Walk) -> Vec<Knot> {
        let nodes = walk.nodes;
        let quad = vector_of(&self.quad);
        let knot = |&(at, corners): &(usize, [DVec2; 4])| {
            let node = nodes[at].as_ref()?;
            let base_from_frame = node.base.inverse();
            let same = self.frames[at]
                .corners
                .iter()
                .zip(&corners)
                .all(|(a, b)| a.distance(*b) < SAME_PX);
            let offset = if same || !node.measured {
                Vector::zeros()
            } else {
                vector_of(&corners.map(|p| base_from_frame.apply(p))) - quad
            };
            let back = inverse_jacobian(&node.base, &self.quad)?;
            Some(Knot {
                at,
                offset,
                covariance: carried(&back, &(Matrix::identity() * (HAND_PX * HAND_PX))),
                stiffness: walk.stiffness(at, &offset),
            })
        };
        let mut knots: Vec<Knot> = corrections.iter().filter_map(knot).collect();
        let reference = self
            .reference
            .checked_sub(self.first)
            .and_then(|at| usize::try_from(at).ok())
            .filter(|&at| at < nodes.len());
        if let Some(at) = reference {
            let place = knots.partition_point(|knot| knot.at < at);
            knots.insert(
                place,
                Knot {
                    at,
                    offset: Vector::zeros(),
                    covariance: Matrix::zeros(),
                    stiffness: 1.0,
                },
            );
        }
        knots
    }

    /// The track after offsets on the plane.
    fn with_offsets(
        &self,
        corrections: &[(usize, [DVec2; 4])],
        nodes: &[Option<Node>],
        offsets: &[Option<(Vector, Matrix)>],
    ) -> Result<Self, CorrectError> {
        let mut track = self.clone();
        for (at, found) in offsets.iter().enumerate() {
            let (Some((offset, covariance)), Some(node)) = (found, &nodes[at]) else {
                continue;
            };
            let on_plane = points_of(&(vector_of(&self.quad) + offset));
            if !node.base.is_in_front(&on_plane) {
                return Err(self.folded(at));
            }
            let corners = on_plane.map(|p| node.base.apply(p));
            let pose = Homography::from_pairs(&self.quad, &corners).map_err(|_| self.folded(at))?;
            let mut frame = self.frames[at].clone();
            frame.covariance =
                covariance_of(&carried(&jacobian(&node.base, &on_plane), covariance));
            let sigma = frame.sigma_px();
            if !node.measured && sigma > MAX_SIGMA_SIDES * mean_side(&corners) {
                continue;
            }
            if !node.measured || sigma > WEAK_PX {
                frame.state = TrackState::Weak;
            }
            // an offset of nothing leaves the measurement as it is
            if !node.measured || offset.amax() > 0.0 {
                frame.frame_from_reference = pose;
                frame.corners = corners;
                track.frames[at] = frame;
            }
        }
        for &(at, corners) in corrections {
            let frame = &mut track.frames[at];
            let same = frame.corners.iter().zip(&corners);
            if frame.state != TrackState::Lost
                && nodes[at].as_ref().is_some_and(|node| node.measured)
                && same.clone().all(|(a, b)| a.distance(*b) < SAME_PX)
            {
                continue;
            }
            let pose = Homography::from_pairs(&self.quad, &corners);
            frame.frame_from_reference = pose.map_err(|_| self.folded(at))?;
            frame.corners = corners;
            frame.state = TrackState::Tracked;
            frame.covariance = covariance_of(&(Matrix::identity() * (HAND_PX * HAND_PX)));
        }
        Ok(track)
    }
}

/// The mean length of the sides of a quadrilateral.
fn mean_side(quad: &[DVec2; 4]) -> f64 {
    0.25 * (0..4)
        .map(|k| quad[k].distance(quad[(k + 1) % 4]))
        .sum::<f64>()
}

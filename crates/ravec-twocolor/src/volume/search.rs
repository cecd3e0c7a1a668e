//! Improving a plane by line searches that visit every split on their way.
//!
//! Plain idea:
//!
//! ```text
//! repeat until no motion improves:
//!     for each of the motions of the plane (13, or 49 in small blocks):
//!         list when, along the motion, each voxel near the plane changes sides
//!         in the order of these events: add or subtract the voxel, score the split
//!         go to the middle of the interval with the best score
//! ```
//!
//! Departures: (1) an event is one `u32`: its time in 19 bits, the direction of the change, the voxel; sorting numbers is
//! all there is to ordering events. (2) Events closer than [`TIE`] count as one, so that rounding never makes a split that
//! no plane makes. (3) The running sums drift by single-precision rounding, so a winner is scored afresh.

use super::block::{Block, Heights, OTHERS, add, directions};

/// A plane and its gain.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scored {
    pub plane: Heights,
    pub gain: f32,
}

/// A motion of a plane: what one unit of time adds to its height. No height changes by more than 1 a unit.
#[derive(Debug, Clone, Copy)]
struct Motion {
    center: f64,
    slopes: [f64; 2],
}

impl Motion {
    fn moved(&self, plane: &Heights, time: f64) -> Heights {
        Heights {
            axis: plane.axis,
            center: plane.center + time * self.center,
            slopes: std::array::from_fn(|i| plane.slopes[i] + time * self.slopes[i]),
        }
    }

    #[inline(always)]
    fn speed(&self, from_b: f64, from_c: f64) -> f64 {
        self.center + self.slopes[0] * from_b + self.slopes[1] * from_c
    }
}

/// Distance that a line search moves the plane at the block's border, in voxels. Twice the distance of neighboring
/// voxels passes a wrong neighbor or two; longer searches cost in proportion and win little (starts differ by more).
const REACH: f64 = 2.0;

/// Bits of an event's time. The rest of a `u32` holds the change and the voxel of the largest block.
const TIME_BITS: u32 = 19;
const VOXEL_BITS: u32 = 12;
const LAST_TIME: u32 = (1 << TIME_BITS) - 1;

/// Events at most this many units of time apart count as simultaneous: 6e-5 voxels, above the rounding of positions and
/// of time, and far below the usual distance of two events.
const TIE: u32 = 8;

/// The memory of line searches, kept from block to block.
#[derive(Debug, Default)]
pub(super) struct Searcher {
    events: Vec<u32>,
}

impl Searcher {
    /// Improves a plane until no motion does.
    ///
    /// A start may pass through voxels, so that rounding alone has decided their sides; it is centered first, and the
    /// search begins at the split that it makes then.
    pub fn improve(&mut self, block: &Block, start: &Heights) -> Scored {
        let middle = block.middle();
        let plane = centered(block, start);
        let gain = block.score(&plane);
        let mut best = Scored { plane, gain };
        loop {
            // tilting may have made another axis the leading one
            let (normal, offset) = best.plane.plane(middle);
            if let Some(plane) = Heights::of_plane(normal, offset, middle)
                && plane.axis != best.plane.axis
                && block.score(&plane) >= best.gain
            {
                best.plane = plane;
            }
            let mut improved = false;
            for motion in motions(block, best.plane.axis) {
                let step = self.line_search(block, &best.plane, &motion);
                if f64::from(step.gain) > f64::from(best.gain) + block.rounding() {
                    let plane = motion.moved(&best.plane, step.time);
                    let gain = block.score(&plane);
                    if gain > best.gain {
                        best = Scored { plane, gain };
                        improved = true;
                    }
                }
            }
            if !improved {
                return best;
            }
        }
    }

    /// The best split that a plane meets when it moves by up to [`REACH`] either way.
    fn line_search(&mut self, block: &Block, plane: &Heights, motion: &Motion) -> Step {
        let axis = plane.axis;
        let extent = block.extents[axis];
        let strides = block.strides();
        let [b, c] = OTHERS[axis];
        let scale = f64::from(LAST_TIME) / (2.0 * REACH);
        let (mut sum, mut below) = ([0.0; 4], 0usize);
        self.events.clear();
        block.for_each_row(plane, |row, height, from_b, from_c| {
            let speed = motion.speed(from_b, from_c);
            let first = Block::cut(height - REACH * speed, extent);
            let last = Block::cut(height + REACH * speed, extent);
            add(&mut sum, 1.0, block.prefix(axis, row, first));
            below += first;
            if first == last {
                return;
            }
            let leaves = u32::from(last < first) << VOXEL_BITS;
            let (at_b, at_c) = (row % block.extents[b], row / block.extents[b]);
            let base = at_b * strides[b] + at_c * strides[c];
            let scale = scale / speed;
            for k in first.min(last)..first.max(last) {
                let time = (k as f64 - height) * scale + 0.5 * f64::from(LAST_TIME);
                let time = (time as u32).min(LAST_TIME);
                let voxel = (base + k * strides[axis]) as u32;
                self.events.push(time << (VOXEL_BITS + 1) | leaves | voxel);
            }
        });
        self.events.sort_unstable();

        let time_of = |event: u32| event >> (VOXEL_BITS + 1);
        let next = |i: usize| self.events.get(i).map_or(LAST_TIME, |&e| time_of(e));
        let mut best = (block.gain(below, &sum), next(0) / 2);
        for (i, &event) in self.events.iter().enumerate() {
            let voxel = &block.voxels[(event & ((1 << VOXEL_BITS) - 1)) as usize];
            if event >> VOXEL_BITS & 1 == 0 {
                add(&mut sum, 1.0, voxel);
                below += 1;
            } else {
                add(&mut sum, -1.0, voxel);
                below -= 1;
            }
            let (now, then) = (time_of(event), next(i + 1));
            if then - now > TIE {
                let gain = block.gain(below, &sum);
                if gain > best.0 {
                    best = (gain, now + (then - now) / 2);
                }
            }
        }
        Step {
            gain: best.0,
            time: f64::from(best.1) / scale - REACH,
        }
    }
}

/// The best split of a line search, and when it is met.
struct Step {
    gain: f32,
    time: f64,
}

/// The motions of planes with a leading axis that change a split of this block.
fn motions(block: &Block, axis: usize) -> impl Iterator<Item = Motion> {
    let middle = block.middle();
    let half = OTHERS[axis].map(|other| middle[other]);
    directions(block.fineness()).filter_map(move |direction| {
        let [c, b, center] = direction.map(f64::from);
        let unit = 1.0 / (center.abs() + b.abs() + c.abs());
        let slope = |tilt: f64, half: f64| {
            if tilt == 0.0 {
                Some(0.0)
            } else {
                (half > 0.0).then(|| tilt * unit / half)
            }
        };
        Some(Motion {
            center: center * unit,
            slopes: [slope(b, half[0])?, slope(c, half[1])?],
        })
    })
}

/// The plane of the same split that lies midway between the events along each motion in turn.
///
/// Two passes: the second sees the shifts that the tilts of the first have made room for. The result nears the middle of
/// all planes with this split.
pub(super) fn centered(block: &Block, plane: &Heights) -> Heights {
    let mut plane = *plane;
    let extent = block.extents[plane.axis] as f64;
    for _ in 0..2 {
        for motion in motions(block, plane.axis) {
            // a motion without an event within a voxel stays near where it is
            let (mut before, mut after) = (-1.0f64, 1.0f64);
            block.for_each_row(&plane, |_, height, from_b, from_c| {
                let speed = motion.speed(from_b, from_c);
                if speed == 0.0 {
                    return;
                }
                // the nearest voxel of the row above the plane, and the one below it
                let above = height.ceil().max(0.0);
                let under = (height.ceil() - 1.0).min(extent - 1.0);
                for voxel in [above, under] {
                    if (0.0..extent).contains(&voxel) {
                        let time = (voxel - height) / speed;
                        if (voxel == above) == (speed > 0.0) {
                            after = after.min(time);
                        } else {
                            before = before.max(time);
                        }
                    }
                }
            });
            if before < after {
                plane = motion.moved(&plane, 0.5 * (before + after));
            }
        }
    }
    plane
}

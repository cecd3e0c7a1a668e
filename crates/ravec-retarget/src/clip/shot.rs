//! A shot: frames between two cuts on their way through the window.
//!
//! ```text
//! on each frame: remember its motion and masks; every other frame: measure its reduction
//! at the end of a slab: fit voxels, analyze one frame, note what was found for the frames of the slab
//! for each key time whose look-ahead is known: solve
//! for each frame between known keys: settle
//! ```

use super::content::{Content, Demand, SlabRuns, shares};
use super::follow::{FOLLOWED, followed};
use super::options::{ClipFrame, ClipOptions, ClipReport, Settled};
use super::path::{
    KEY_FRAMES, Key, SMOOTHING, deformation, second_difference, shares as key_shares,
};
use super::sample::Sample;
use super::smooth::{RawKey, steady};
use super::solve::Solution;
use super::voxels::slab_motion;
use super::world::{Camera, Carry, UnitMap, View};
use crate::analysis::Analysis;
use crate::grid::Grid;
use crate::importance::{barrier, barrier_of, contrast, mixed_importance};
use crate::params::RetargetError;
use crate::retargeter::touched;
use crate::runs::straight_runs;
use glam::DVec2;
use ravec_progress::Progress;
use ravec_raster::{AnyImage, Mask, Size, with_image};
use rayon::prelude::*;
use std::collections::VecDeque;
use std::sync::Arc;

/// Frames around each that its deformation takes keys from.
const REACH: usize = if FOLLOWED > SMOOTHING {
    FOLLOWED
} else {
    SMOOTHING
};

/// State that all shots of a clip share.
#[derive(Debug)]
pub(super) struct Stage {
    pub(super) options: ClipOptions,
    pub(super) grid: Arc<Grid>,
    pub(super) targets: Vec<Size>,
}

impl Stage {
    /// Frames on each side over which deformations of key times are averaged.
    fn smoothing(&self) -> usize {
        4 * self.options.look_ahead / 5
    }

    fn cell_px(&self) -> f64 {
        self.grid.unit_px().min_element()
    }
}

#[derive(Debug)]
pub(super) struct Shot {
    /// Number of its first frame.
    first: usize,
    /// Number of the first frame that is not settled, which is the first in `held`.
    unsettled: usize,
    held: VecDeque<AnyImage>,
    camera: Camera,
    /// Samples of the slab that is not complete.
    samples: Vec<Sample>,
    content: Content,
    /// Content is known before this frame.
    known: usize,
    /// Key times that are solved, and the number of the first of them that is not steady yet.
    raw_keys: VecDeque<RawKey>,
    unsteady: usize,
    keys: VecDeque<Key>,
    next_key: usize,
    ended: bool,
    /// The vertices of the last two frames, for each target.
    recent: VecDeque<Vec<Vec<DVec2>>>,
}

impl Shot {
    pub(super) fn new(first: usize) -> Self {
        Self {
            first,
            unsettled: first,
            held: VecDeque::new(),
            camera: Camera::new(first),
            samples: Vec::new(),
            content: Content::default(),
            known: first,
            raw_keys: VecDeque::new(),
            unsteady: 0,
            keys: VecDeque::new(),
            next_key: first,
            ended: false,
            recent: VecDeque::new(),
        }
    }

    pub(super) fn frames_held(&self) -> usize {
        self.held.len()
    }

    /// Number of the frame after the last one.
    fn end(&self) -> usize {
        self.unsettled + self.held.len()
    }

    /// Takes a frame.
    pub(super) fn push(&mut self, stage: &Stage, frame: ClipFrame<'_>, begins: bool) {
        let number = self.end();
        if !begins {
            let size = stage.grid.image_size;
            self.camera
                .push(frame.motion.frame_from_previous, size, stage.cell_px());
        }
        for (maps, mask) in [
            (&mut self.content.protected, frame.protect),
            (&mut self.content.given_way, frame.give_way),
        ] {
            maps.extend(mask.and_then(|mask| mask_map(mask, number, &stage.grid)));
        }
        if (number - self.first).is_multiple_of(stage.options.sample_frames) {
            self.samples.push(Sample::new(number, &frame.image));
        }
        self.held.push_back(frame.image);
    }

    /// Does what can be done with the frames so far, and returns those that are settled.
    pub(super) fn advance(
        &mut self,
        stage: &Stage,
        report: &mut ClipReport,
        progress: &Progress,
    ) -> Result<Vec<Settled>, RetargetError> {
        let options = &stage.options;
        let depth = options.voxel_samples();
        // the frames after the last sample belong to its slab
        let complete = self
            .samples
            .first()
            .is_some_and(|sample| self.end() >= sample.frame + depth * options.sample_frames);
        if complete || (self.ended && !self.samples.is_empty()) {
            self.complete_slab(stage, report, progress)?;
        }
        while self.key_is_due(stage) {
            self.solve_key(stage, report, progress)?;
        }
        while self.steady_key(stage) {
            progress.check()?;
        }
        let mut settled = Vec::new();
        while self.is_settled() {
            progress.check()?;
            settled.extend(self.settle(stage, report));
        }
        self.forget(stage);
        Ok(settled)
    }

    /// Returns all frames that are left.
    pub(super) fn finish(
        mut self,
        stage: &Stage,
        report: &mut ClipReport,
        progress: &Progress,
    ) -> Result<Vec<Settled>, RetargetError> {
        self.ended = true;
        // the last frame is a key time
        let last = self.end() - 1;
        if self.next_key > last && self.raw_keys.back().is_some_and(|key| key.frame < last) {
            self.next_key = last;
        }
        self.advance(stage, report, progress)
    }

    /// Measures the slab of the samples so far.
    fn complete_slab(
        &mut self,
        stage: &Stage,
        report: &mut ClipReport,
        progress: &Progress,
    ) -> Result<(), RetargetError> {
        let units = stage.grid.units;
        let saliency = stage.options.saliency;
        let samples = std::mem::take(&mut self.samples);
        let middle = samples.len() / 2;
        let frame = samples[middle].frame;
        let carries: Vec<Carry> = samples
            .iter()
            .map(|sample| self.camera.to_from(sample.frame, frame))
            .collect();
        let size = stage.grid.image_size;
        let every = stage.options.sample_frames;
        let motion = slab_motion(&samples, &carries, size, units, every, progress)?;
        report.moving_voxels += motion.moving;
        report.voxels += motion.cells;

        let image = &self.held[frame - self.unsettled];
        let analysis = with_image!(image, image => Analysis::new(image, units, progress)?);
        let runs = if stage.options.line_strength > 0.0 {
            straight_runs(&analysis.image)
        } else {
            Vec::new()
        };
        progress.check()?;
        let still: Vec<f64> = contrast(&analysis, &runs)
            .into_iter()
            .map(f64::from)
            .collect();
        // a sample that shows the same has the same barrier distance to the last bit
        let same = |sample: &Sample| sample.small == samples[middle].small;
        let barriers: Vec<Vec<f64>> = samples
            .par_iter()
            .map(|sample| {
                if saliency <= 0.0 {
                    vec![0.0; still.len()]
                } else if same(sample) {
                    barrier(&analysis)
                } else {
                    barrier_of(&sample.small, units)
                }
            })
            .collect();
        let last = self.end() - 1;
        let valid = [samples[0].frame, last];
        let content = &mut self.content;
        for (sample, values) in samples.iter().zip(barriers) {
            let mixed = values.iter().zip(&still);
            let importance: Vec<f64> = mixed
                .map(|(&barrier, &contrast)| mixed_importance(barrier, contrast, saliency))
                .collect();
            content.demands.push_back(Demand {
                frame: sample.frame,
                shares: shares(&importance, units),
            });
            content.barriers.push_back(UnitMap {
                frame: sample.frame,
                valid: [sample.frame; 2],
                values,
            });
        }
        let map = |values| UnitMap {
            frame,
            valid,
            values,
        };
        let moving = still.iter().zip(&motion.contrast);
        let contrast = moving.map(|(a, b)| a.max(*b)).collect();
        content.contrasts.push_back(map(contrast));
        for (sample, values) in samples.iter().zip(motion.motion) {
            content.motions.push_back(UnitMap {
                valid: [sample.frame; 2],
                ..map(values)
            });
        }
        content.runs.push_back(SlabRuns {
            frame,
            valid,
            unit_px: analysis.unit_px as f64,
            runs,
        });
        self.known = self.end();
        Ok(())
    }

    fn key_is_due(&self, stage: &Stage) -> bool {
        if self.next_key >= self.end() {
            return false;
        }
        let block_end = self.next_key + KEY_FRAMES;
        self.ended
            || (self.known > self.next_key + stage.options.look_ahead && self.end() > block_end)
    }

    fn solve_key(
        &mut self,
        stage: &Stage,
        report: &mut ClipReport,
        progress: &Progress,
    ) -> Result<(), RetargetError> {
        progress.check()?;
        let view = View {
            camera: &self.camera,
            grid: &stage.grid,
            frame: self.next_key,
            look_ahead: stage.options.look_ahead,
        };
        let seen = self.content.seen(&view, &stage.options);
        // the camera moves somewhere within reach of the means
        let reach = stage.smoothing() + KEY_FRAMES;
        let near = (self.next_key + 1).saturating_sub(reach)..=self.next_key + reach;
        let moving = self.camera.speed(near) > 0.0;
        let known = self.raw_keys.back().map(|key| &key.solution);
        let same = known.filter(|known| known.seen == seen && !moving);
        let solution = if let Some(known) = same {
            known.clone()
        } else {
            report.keys_solved += 1;
            let solution =
                Solution::new(seen, &stage.grid, &stage.targets, &stage.options, moving)?;
            for found in solution.deformations.iter() {
                let scale = found.summary.object_scale;
                report.min_object_scale = report.min_object_scale.min(scale);
            }
            Arc::new(solution)
        };
        self.raw_keys.push_back(RawKey {
            frame: self.next_key,
            solution,
        });
        let mut next = self.next_key + self.key_step(stage);
        if self.ended && self.next_key + 1 < self.end() {
            next = next.min(self.end() - 1);
        }
        self.next_key = next;
        Ok(())
    }

    /// Makes the next key steady, if enough of those after it are known.
    fn steady_key(&mut self, stage: &Stage) -> bool {
        let (Some(key), Some(last)) = (self.raw_keys.get(self.unsteady), self.raw_keys.back())
        else {
            return false;
        };
        let radius = stage.smoothing();
        if !self.ended && last.frame <= key.frame + radius {
            return false;
        }
        self.keys.push_back(Key {
            frame: key.frame,
            deformations: steady(&self.raw_keys, self.unsteady, radius, &self.camera),
        });
        self.unsteady += 1;
        true
    }

    /// Frames from the next key to the one after it: fewer where the camera moves, so that content moves by a cell at most.
    fn key_step(&self, stage: &Stage) -> usize {
        let offset = self.next_key - self.first;
        let block = self.first + offset / KEY_FRAMES * KEY_FRAMES;
        let speed = self.camera.speed(block + 1..=block + KEY_FRAMES);
        let mut step = KEY_FRAMES;
        while step > 1 && speed * step as f64 > stage.cell_px() {
            step /= 2;
        }
        step
    }

    fn is_settled(&self) -> bool {
        if self.unsettled >= self.end() {
            return false;
        }
        self.ended
            || self
                .keys
                .back()
                .is_some_and(|key| key.frame > self.unsettled + REACH)
    }

    /// The first frame with its deformations.
    fn settle(&mut self, stage: &Stage, report: &mut ClipReport) -> Option<Settled> {
        let frame = self.unsettled;
        let last = self.end() - 1;
        let image = self.held.pop_front()?;
        self.unsettled += 1;
        // over half a cell of motion at most
        let speed = self.camera.speed(frame..=frame + 1);
        let radius = (0.5 * stage.cell_px() / speed.max(1e-9)).min(SMOOTHING as f64);
        let shares = key_shares(&self.keys, frame, self.first, last, radius);
        let nearest = shares.iter().copied().max_by(|a, b| a.1.total_cmp(&b.1))?.0;
        let deformations: Vec<_> = (0..stage.targets.len())
            .map(|target| {
                let found = deformation(&self.keys, &shares, nearest, target);
                followed(found, &self.keys, target, frame, &self.camera)
            })
            .collect();
        for found in &deformations {
            report.least_area = report.least_area.min(found.summary.least_area);
        }
        let vertices: Vec<Vec<DVec2>> = deformations
            .iter()
            .map(|found| found.vertices.clone())
            .collect();
        if let [before, here] = self.recent.make_contiguous() {
            for target in 0..vertices.len() {
                let places = [&before[target][..], &here[target], &vertices[target]];
                let difference = second_difference(places);
                report.max_second_difference_px = report.max_second_difference_px.max(difference);
            }
            self.recent.pop_front();
        }
        self.recent.push_back(vertices);
        Some(Settled {
            frame,
            image,
            deformations,
        })
    }

    /// Forgets what no later frame needs.
    fn forget(&mut self, stage: &Stage) {
        let needed = self.unsettled.saturating_sub(REACH + 1);
        while self.keys.len() > 1 && self.keys[1].frame <= needed {
            self.keys.pop_front();
        }
        // the key before the first in reach says for how long that one stands
        let radius = stage.smoothing();
        while let (Some(old), Some(next)) = (self.raw_keys.get(1), self.raw_keys.get(self.unsteady))
        {
            if old.frame + radius >= next.frame {
                break;
            }
            self.raw_keys.pop_front();
            self.unsteady -= 1;
        }
        self.content.forget(self.next_key, stage.options.look_ahead);
        let oldest = self.content.first_frame().unwrap_or(self.next_key);
        let sampled = self.samples.first().map_or(oldest, |sample| sample.frame);
        // the speed at the first frame that is not settled takes the motion that leads to it
        let key = self.raw_keys.front().map_or(oldest, |key| key.frame);
        let steady = self.keys.front().map_or(oldest, |key| key.frame);
        let oldest = oldest
            .min(sampled)
            .min(key)
            .min(steady)
            .min(self.next_key)
            .min(self.unsettled.saturating_sub(1));
        self.camera.forget(oldest);
    }
}

/// The units that a mask touches, if it touches any.
fn mask_map(mask: &Mask, frame: usize, grid: &Grid) -> Option<UnitMap> {
    let values: Vec<f64> = touched(mask, grid.units)
        .into_iter()
        .map(|touched| f64::from(u8::from(touched)))
        .collect();
    values.iter().any(|&value| value > 0.0).then_some(UnitMap {
        frame,
        valid: [frame; 2],
        values,
    })
}

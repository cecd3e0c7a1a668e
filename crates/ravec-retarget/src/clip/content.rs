//! Content of a shot that a deformation considers: importance, runs and what is painted, as seen from one frame.

use super::options::{ClipOptions, mapped};
use super::world::{UnitMap, View, fading};
use crate::forms::GridRun;
use crate::grid::Grid;
use crate::importance::mixed_importance;
use crate::retargeter::{GIVEN_WAY, PROTECTED, weight_of};
use crate::runs::{MAX_RUNS, Run, repeats};
use glam::{DMat3, DVec2};
use std::collections::VecDeque;

/// Share of the new side that important content may take before it is made smaller: the rest gives way. More leaves larger
/// objects, less room between them.
const FULL_SHARE: f64 = 0.6;

/// By which share all frames together must need more room than a single one for their paths to count in full. Less makes
/// objects smaller where little moves.
const FULL_MORE: f64 = 0.25;

/// A run that shows less than this many units in a frame has no direction to keep.
const LEAST_RUN: f64 = 2.0;

/// The runs of a slab, the strongest first.
#[derive(Debug, Clone)]
pub(super) struct SlabRuns {
    /// The frame in which they were found, and the frames for which they count.
    pub(super) frame: usize,
    pub(super) valid: [usize; 2],
    /// Pixels of the analysis a unit.
    pub(super) unit_px: f64,
    pub(super) runs: Vec<Run>,
}

/// The share of the sides that the important content of a frame takes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Demand {
    pub(super) frame: usize,
    pub(super) shares: [f64; 2],
}

/// Measurements of a shot that are not too old.
#[derive(Debug, Clone, Default)]
pub(super) struct Content {
    pub(super) barriers: VecDeque<UnitMap>,
    pub(super) contrasts: VecDeque<UnitMap>,
    pub(super) motions: VecDeque<UnitMap>,
    pub(super) protected: VecDeque<UnitMap>,
    pub(super) given_way: VecDeque<UnitMap>,
    pub(super) runs: VecDeque<SlabRuns>,
    pub(super) demands: VecDeque<Demand>,
}

/// Content as a solver takes it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Seen {
    /// The weight of each unit.
    pub(super) weights: Vec<f64>,
    pub(super) runs: Vec<GridRun>,
    pub(super) mean_importance: f64,
    /// The shares of the sides that important content takes over all frames, and at most in a single one.
    pub(super) path: [f64; 2],
    pub(super) single: [f64; 2],
}

impl Content {
    /// Forgets what no frame from `frame` on considers.
    pub(super) fn forget(&mut self, frame: usize, look_ahead: usize) {
        let gone = |last: usize| last + look_ahead < frame;
        for maps in [
            &mut self.barriers,
            &mut self.contrasts,
            &mut self.motions,
            &mut self.protected,
            &mut self.given_way,
        ] {
            maps.retain(|map| !gone(map.valid[1]));
        }
        self.runs.retain(|slab| !gone(slab.valid[1]));
        self.demands.retain(|demand| !gone(demand.frame));
    }

    /// The first frame in whose coordinates something is.
    pub(super) fn first_frame(&self) -> Option<usize> {
        let maps = [
            &self.barriers,
            &self.contrasts,
            &self.motions,
            &self.protected,
            &self.given_way,
        ];
        let frames = maps.into_iter().flatten().map(|map| map.frame);
        frames.chain(self.runs.iter().map(|slab| slab.frame)).min()
    }

    /// The content as seen from one frame.
    pub(super) fn seen(&self, view: &View<'_>, options: &ClipOptions) -> Seen {
        let barrier = view.passing(self.barriers.iter());
        let contrast = view.passing(self.contrasts.iter());
        let motion = view.largest(self.motions.iter());
        let importance: Vec<f64> = barrier
            .iter()
            .zip(&contrast)
            .zip(&motion)
            .map(|((&barrier, &contrast), &motion)| {
                let still = mixed_importance(barrier, contrast, options.saliency);
                if motion > 0.0 {
                    1.0 - (1.0 - still) * (1.0 - options.motion * motion)
                } else {
                    still
                }
            })
            .collect();
        let mut weights: Vec<f64> = importance.iter().map(|&b| weight_of(b)).collect();
        for (maps, weight) in [(&self.given_way, GIVEN_WAY), (&self.protected, PROTECTED)] {
            if maps.is_empty() {
                continue;
            }
            for (value, share) in weights.iter_mut().zip(view.largest(maps.iter())) {
                *value += share * (weight - *value);
            }
        }
        let faded = |demand: &Demand| {
            let fade = fading(demand.frame.abs_diff(view.frame), view.look_ahead);
            demand.shares.map(|share| fade * share)
        };
        Seen {
            mean_importance: importance.iter().sum::<f64>() / importance.len() as f64,
            path: shares(&importance, view.grid.units),
            single: self
                .demands
                .iter()
                .map(faded)
                .fold([0.0; 2], |a, b| [a[0].max(b[0]), a[1].max(b[1])]),
            runs: self.runs_seen(view),
            weights,
        }
    }

    /// The runs of all slabs as seen from one frame, each once, as strong as the share of the slabs in view of it that have found
    /// it: what only looks like a line is found now and then.
    fn runs_seen(&self, view: &View<'_>) -> Vec<GridRun> {
        let slabs: Vec<SeenSlab> = self
            .runs
            .iter()
            .filter_map(|slab| SeenSlab::new(slab, view))
            .collect();
        let mut candidates: Vec<(f64, usize, Run, f64)> = Vec::new();
        for slab in &slabs {
            let ranked = slab.runs.iter();
            candidates.extend(ranked.map(|&(rank, run)| (slab.fade, rank, run, slab.unit_px)));
        }
        // stable, so that of equal ones the earlier slab comes first
        candidates.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        let mut kept: Vec<(Run, GridRun)> = Vec::new();
        for (fade, _, run, unit_px) in candidates {
            if kept.len() == MAX_RUNS || kept.iter().any(|(longer, _)| repeats(&run, longer)) {
                continue;
            }
            let mut seen = GridRun::new(&run, unit_px, view.grid.units);
            if within(&seen, view.grid) {
                seen.strength = fade * support(&run, &slabs);
                kept.push((run, seen));
            }
        }
        kept.into_iter().map(|(_, seen)| seen).collect()
    }
}

/// A slab's runs as seen from a frame.
struct SeenSlab {
    fade: f64,
    unit_px: f64,
    /// The columns and rows of the analysis.
    size_px: DVec2,
    /// Maps points of the frame to that of the slab, in pixels of the analysis.
    slab_from_here: Option<DMat3>,
    /// With their ranks in the slab.
    runs: Vec<(usize, Run)>,
}

impl SeenSlab {
    fn new(slab: &SlabRuns, view: &View<'_>) -> Option<Self> {
        let distance = UnitMap {
            frame: slab.frame,
            valid: slab.valid,
            values: Vec::new(),
        }
        .distance(view.frame);
        let fade = fading(distance, view.look_ahead);
        if fade <= 0.0 {
            return None;
        }
        let scale = DMat3::from_scale(view.grid.unit_px() / slab.unit_px);
        let here_from_slab = view
            .camera
            .to_from(view.frame, slab.frame)
            .map(|matrix| scale.inverse() * matrix * scale);
        let runs = slab.runs.iter().enumerate();
        let units = view.grid.units.map(|k| k as f64);
        Some(Self {
            fade,
            unit_px: slab.unit_px,
            size_px: slab.unit_px * DVec2::from_array(units),
            slab_from_here: here_from_slab.map(|matrix| matrix.inverse()),
            runs: runs
                .filter_map(|(rank, run)| match here_from_slab {
                    None => Some((rank, *run)),
                    Some(matrix) => Some((rank, carried(run, &matrix)?)),
                })
                .collect(),
        })
    }

    /// Returns `true` if a run lies in the slab's frame, most of it.
    fn sees(&self, run: &Run) -> bool {
        let Some(matrix) = self.slab_from_here else {
            return true;
        };
        let inside = |share: f64| {
            let at = mapped(&matrix, run.ends[0].lerp(run.ends[1], share));
            at.is_some_and(|at| at.min(self.size_px - at).min_element() >= 0.0)
        };
        [0.25, 0.5, 0.75]
            .into_iter()
            .filter(|&share| inside(share))
            .count()
            >= 2
    }
}

/// The share of the slabs in view of a run that have found it.
fn support(run: &Run, slabs: &[SeenSlab]) -> f64 {
    let (mut found, mut all) = (0.0, 0.0);
    for slab in slabs {
        let has = |&(_, other): &(usize, Run)| repeats(&other, run) || repeats(run, &other);
        if slab.runs.iter().any(has) {
            found += slab.fade;
            all += slab.fade;
        } else if slab.sees(run) {
            all += slab.fade;
        }
    }
    found / all
}

/// Returns `true` if enough of a run is in the frame.
fn within(run: &GridRun, grid: &Grid) -> bool {
    let [cols, rows] = grid.units.map(|k| k as f64);
    run.ends[0].distance(run.ends[1]) >= LEAST_RUN
        && run.ends.iter().all(|end| {
            (-1e-6..=cols + 1e-6).contains(&end.x) && (-1e-6..=rows + 1e-6).contains(&end.y)
        })
}

/// A run under a homography.
fn carried(run: &Run, matrix: &DMat3) -> Option<Run> {
    let [from, to] = run.ends.map(|end| mapped(matrix, end));
    let ends = [from?, to?];
    ends.iter()
        .all(|end| end.is_finite())
        .then_some(Run { ends })
}

/// The share of the width that the most crowded rows take, three at a time, and that of the height for columns.
pub(super) fn shares(importance: &[f64], [cols, rows]: [usize; 2]) -> [f64; 2] {
    let mut along_rows = vec![0.0; rows];
    let mut along_cols = vec![0.0; cols];
    for (unit, value) in importance.iter().enumerate() {
        along_rows[unit / cols] += value / cols as f64;
        along_cols[unit % cols] += value / rows as f64;
    }
    let crowded = |sums: &[f64]| {
        let together = sums.len().min(3);
        let means = sums.windows(together);
        means
            .map(|three| three.iter().sum::<f64>() / together as f64)
            .fold(0.0, f64::max)
    };
    [crowded(&along_rows), crowded(&along_cols)]
}

impl Seen {
    /// The share of the scale `wanted` at which the paths of moving content fit, for new sides that are `factor` times the old
    /// ones: at most 1.
    ///
    /// It is 1 if all frames together need no more room than a single one, so that a clip of equal frames is retargeted as a
    /// still picture.
    pub(super) fn path_share(&self, factor: DVec2, wanted: f64) -> f64 {
        let least = factor.min_element();
        let still = wanted.clamp(least, factor.max_element());
        let mut share = 1.0f64;
        // a side that need not give way has room for everything
        for axis in (0..2).filter(|&axis| factor[axis] < still) {
            let more = self.path[axis] / self.single[axis].max(1e-9) - 1.0;
            let moved = (more / FULL_MORE).clamp(0.0, 1.0);
            let fits = (FULL_SHARE * factor[axis] / self.path[axis].max(1e-9)).max(least) / still;
            share = share.min(1.0 + moved * (fits.min(1.0) - 1.0));
        }
        share
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clip::world::Camera;
    use glam::dvec2;
    use ravec_raster::Size;

    fn map(frame: usize, values: Vec<f64>) -> UnitMap {
        UnitMap {
            frame,
            valid: [frame, frame],
            values,
        }
    }

    #[test]
    fn an_object_that_moves_far_is_made_smaller_where_its_path_does_not_fit() {
        let grid = Grid::new(Size::new(320, 160).unwrap(), [32, 16], |_, _| 1);
        let mut camera = Camera::new(0);
        let mut content = Content::default();
        for frame in 0..10 {
            if frame > 0 {
                camera.push(DMat3::IDENTITY, grid.image_size, 10.0);
            }
            // four cells wide, two cells a frame
            let values: Vec<f64> = (0..512)
                .map(|unit| {
                    let (col, row) = (unit % 32, unit / 32);
                    let inside = (4 + 2 * frame..8 + 2 * frame).contains(&col);
                    f64::from(u8::from(inside && (6..10).contains(&row)))
                })
                .collect();
            content.demands.push_back(Demand {
                frame,
                shares: shares(&values, grid.units),
            });
            content.barriers.push_back(map(frame, values));
        }
        let view = View {
            camera: &camera,
            grid: &grid,
            frame: 5,
            look_ahead: 20,
        };
        let seen = content.seen(&view, &ClipOptions::default());
        assert_eq!(seen.single[0], 4.0 / 32.0);
        assert_eq!(seen.path[0], 22.0 / 32.0);
        // 22 of 32 columns have to fit into a share of half of them
        let half = seen.path_share(dvec2(0.5, 1.0), 1.0);
        let fits = (FULL_SHARE * 16.0 / 22.0).max(0.5);
        assert!((half - fits).abs() < 1e-9, "{half}");
        assert_eq!(seen.path_share(dvec2(1.4, 1.0), 1.0), 1.0);
        assert_eq!(seen.path_share(dvec2(1.5, 1.0), 1.0), 1.0);
    }

    #[test]
    fn what_stands_needs_no_more_room_in_many_frames_than_in_one() {
        let grid = Grid::new(Size::new(320, 160).unwrap(), [32, 16], |_, _| 1);
        let mut camera = Camera::new(0);
        let values: Vec<f64> = (0..512).map(|unit| f64::from(unit % 7) / 6.0).collect();
        let mut content = Content::default();
        for frame in 0..5 {
            if frame > 0 {
                camera.push(DMat3::IDENTITY, grid.image_size, 10.0);
            }
            let seen: Vec<f64> = values
                .iter()
                .map(|&b| mixed_importance(b, 0.0, 1.0))
                .collect();
            content.demands.push_back(Demand {
                frame,
                shares: shares(&seen, grid.units),
            });
            content.barriers.push_back(map(frame, values.clone()));
        }
        for frame in 0..5 {
            let view = View {
                camera: &camera,
                grid: &grid,
                frame,
                look_ahead: 3,
            };
            let seen = content.seen(&view, &ClipOptions::default());
            assert_eq!(seen.path_share(dvec2(0.3, 1.0), 1.0), 1.0);
        }
    }

    #[test]
    fn runs_of_several_slabs_are_kept_once() {
        let grid = Grid::new(Size::new(320, 160).unwrap(), [32, 16], |_, _| 1);
        let mut camera = Camera::new(0);
        for _ in 0..16 {
            camera.push(
                DMat3::from_translation(dvec2(2.0, 0.0)),
                grid.image_size,
                10.0,
            );
        }
        // analysis of 20 pixels a unit, twice as many as the frame has
        let run = |shift: f64| Run {
            ends: [dvec2(100.0 + shift, 40.0), dvec2(300.0 + shift, 200.0)],
        };
        let slab = |frame: usize, shift: f64| SlabRuns {
            frame,
            valid: [frame, frame + 7],
            unit_px: 20.0,
            runs: vec![run(shift)],
        };
        let mut content = Content::default();
        content.runs.push_back(slab(0, 0.0));
        // eight frames later the camera has moved it by 16 pixels of the frame
        content.runs.push_back(slab(8, 32.5));
        let view = View {
            camera: &camera,
            grid: &grid,
            frame: 4,
            look_ahead: 20,
        };
        let found = content.runs_seen(&view);
        assert_eq!(found.len(), 1);
        assert_eq!(found[0].strength, 1.0);
        let expected = GridRun::new(&run(16.0), 20.0, grid.units);
        for k in 0..2 {
            assert!(found[0].ends[k].distance(expected.ends[k]) < 1e-9);
        }
    }
    #[test]
    fn a_run_that_is_found_now_and_then_is_weak() {
        let grid = Grid::new(Size::new(320, 160).unwrap(), [32, 16], |_, _| 1);
        let mut camera = Camera::new(0);
        for _ in 0..12 {
            camera.push(DMat3::IDENTITY, grid.image_size, 10.0);
        }
        let always = Run {
            ends: [dvec2(100.0, 40.0), dvec2(300.0, 200.0)],
        };
        let once = Run {
            ends: [dvec2(400.0, 40.0), dvec2(420.0, 300.0)],
        };
        let mut content = Content::default();
        for (slab, runs) in [vec![always], vec![always, once], vec![always]]
            .into_iter()
            .enumerate()
        {
            content.runs.push_back(SlabRuns {
                frame: 4 * slab,
                valid: [4 * slab, 4 * slab + 3],
                unit_px: 20.0,
                runs,
            });
        }
        let view = View {
            camera: &camera,
            grid: &grid,
            frame: 5,
            look_ahead: 30,
        };
        let found = content.runs_seen(&view);
        assert_eq!(found.len(), 2);
        assert_eq!(found[0].strength, 1.0);
        assert!((found[1].strength - 1.0 / 3.0).abs() < 1e-12);
    }
}

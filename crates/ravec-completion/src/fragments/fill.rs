//! The steps that the program takes by itself.
//!
//! Large holes are filled at half the size first, and so on; what was copied there is copied again, from where it fits
//! best within two pixels. The open rest is filled from the rim inwards, the surest and most structured place first
//! (see [`super::rim`]). Then every fragment is matched once more, now that all of its surroundings are known, and
//! another one takes its place if the seams show less with it.
//!
//! Cost: a search for each fragment and pass; a fragment gives several hundred pixels.

use super::index::{RADII, SearchOptions};
use super::pyramid::doubled;
use super::retouch::Retouch;
use super::rim::{Rim, local_radius};
use super::target::{Shape, Step, Target};
use crate::canvas::HOLE;
use crate::error::CompleteError;
use glam::dvec2;
use ravec_progress::Progress;
use ravec_raster::{Image, Rect, distance_to};
use serde::{Deserialize, Serialize};

/// Options of a fill by fragments.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FillOptions {
    /// The radius of fragments in pixels, 2 to 124; none (the default) to choose it from the structure around each of them,
    /// and from the size of the hole.
    pub radius_px: Option<u32>,
    /// Shape of fragments (default [`Shape::Circle`]).
    pub shape: Shape,
    /// Bend the tones of what is copied to those around it (default true).
    pub blend: bool,
}

impl Default for FillOptions {
    fn default() -> Self {
        Self {
            radius_px: None,
            shape: Shape::Circle,
            blend: true,
        }
    }
}

/// Report of filling a hole.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
pub struct FillSummary {
    /// Steps that were taken and not taken back.
    pub steps: usize,
    /// Of these, the ones that replaced what another had given.
    pub replaced: usize,
    /// Pixels for which there was no source, and which are open still.
    pub open_px: usize,
}

/// The radius where it is to be chosen. Support matters: smaller ones follow less structure, larger ones find less that fits.
const RADIUS: u32 = 20;
/// Holes into which a larger disc than this fits are begun at half the size. Where it is not needed it does harm: what repeats
/// is followed less exactly.
const DEEP_PX: f32 = 64.0;
/// Pictures are halved as long as their shorter side has this many pixels.
const MIN_SIDE: usize = 96;
/// Largest move of a source at the step to the next size.
const MOVE_PX: i32 = 2;
/// Smaller fragments say too little to be worth a try.
const MIN_RADIUS: u32 = 4;

impl Retouch<'_> {
    /// Fills what is open. Every step is logged like those that were taken by hand.
    ///
    /// # Errors
    /// [`CompleteError::Radius`] if there is no source of a requested radius, [`CompleteError::Fragment`] if it is
    /// out of range, [`CompleteError::Cancelled`]; the steps that were taken by then remain.
    pub fn fill(
        &mut self,
        options: &FillOptions,
        progress: &Progress,
    ) -> Result<FillSummary, CompleteError> {
        let before = self.steps().len();
        if let Some(radius_px) = options.radius_px {
            let largest_radius_px = self.index.largest_radius();
            if !RADII.contains(&radius_px) {
                return Err(CompleteError::Fragment {
                    what: format!(
                        "fragments have a radius of {} to {} pixels, not {radius_px}",
                        RADII.start(),
                        RADII.end()
                    ),
                });
            }
            if radius_px > largest_radius_px {
                return Err(CompleteError::Radius {
                    radius_px,
                    largest_radius_px,
                });
            }
        }
        self.begin_smaller(options, progress)?;
        self.fill_from_the_rim(options, progress)?;
        let replaced = self.polish(before, options, progress)?;
        Ok(FillSummary {
            steps: self.steps().len() - before,
            replaced,
            open_px: self.open_px(),
        })
    }

    /// Fills the picture of half the size, if that is worth it, and repeats its steps.
    fn begin_smaller(
        &mut self,
        options: &FillOptions,
        progress: &Progress,
    ) -> Result<(), CompleteError> {
        let states = &self.canvas.states;
        let large = states.width().min(states.height()) >= MIN_SIDE;
        if options.radius_px.is_some() || !large || self.depth() <= DEEP_PX {
            return Ok(());
        }
        let Some(index) = self.halved(progress)? else {
            return Ok(());
        };
        let mut half = Retouch::new(&index);
        half.fill(options, progress)?;
        let steps: Vec<Step> = half.steps().map(doubled).collect();
        let phase = progress.phase("refine", steps.len() as u64);
        for mut step in steps {
            step.target.radius_px = step.target.radius_px.min(*RADII.end());
            step.blend = options.blend;
            if let Some(source) = self.near(&step.target, &step.source, MOVE_PX, progress)? {
                step.source = source;
                self.take(&step, progress)?;
            }
            phase.advance(1);
        }
        Ok(())
    }

    /// The radius of the largest disc that fits into what is open.
    fn depth(&self) -> f32 {
        let states = &self.canvas.states;
        let Some(bounds) = self.index.hole.bounding_box() else {
            return 0.0;
        };
        let bounds = bounds.grown(1).clipped(states.size());
        let known =
            |col: usize, row: usize| states[(bounds.col + col, bounds.row + row)] & HOLE == 0;
        let depth = bounds.size().map(|size| distance_to(size, known));
        let deepest = depth.iter().flat_map(Image::pixels);
        deepest.fold(0.0f32, |a, &b| if b.is_finite() { a.max(b) } else { a })
    }

    fn fill_from_the_rim(
        &mut self,
        options: &FillOptions,
        progress: &Progress,
    ) -> Result<(), CompleteError> {
        let base = options.radius_px.unwrap_or(RADIUS);
        let reach = (base + base / 2) as usize;
        let mut rim = Rim::new(self, reach);
        let phase = progress.phase("fill", self.open_px().max(1) as u64);
        while let Some(place) = rim.next() {
            progress.check()?;
            let open = self.open_px();
            let mut radius = options
                .radius_px
                .unwrap_or_else(|| local_radius(self, place, base));
            let at = dvec2(place.0 as f64 + 0.5, place.1 as f64 + 0.5);
            let mut plane = self.index.plane_at(at);
            let changed = loop {
                let target = Target {
                    at,
                    plane,
                    radius_px: radius,
                    shape: options.shape,
                };
                let found = self.best_step(&target, &|_, _| false, options, progress)?;
                let changed = match found {
                    Some(step) => self.take(&step, progress)?,
                    None => None,
                };
                if changed.is_some() && self.open_px() < open {
                    break changed;
                }
                if radius / 2 >= MIN_RADIUS {
                    radius /= 2;
                } else if plane.is_some() {
                    (plane, radius) = (None, base);
                } else {
                    break None;
                }
            };
            let Some(changed) = changed else {
                rim.give_up(place);
                continue;
            };
            phase.advance((open - self.open_px()) as u64);
            rim.settle(self, place, radius as usize, changed);
            rim.update(self, changed, reach);
        }
        Ok(())
    }

    /// Looks once more for every fragment, as all around it is known now; returns the number of those replaced.
    fn polish(
        &mut self,
        first: usize,
        options: &FillOptions,
        progress: &Progress,
    ) -> Result<usize, CompleteError> {
        let count = self.steps().len();
        let phase = progress.phase("polish", (count - first).max(1) as u64);
        let mut replaced = 0;
        for number in first..count {
            progress.check()?;
            phase.advance(1);
            let number = number as u32;
            let old = *self.step_at(number);
            let bounds = self.way_of(number)?.bounds(&self.canvas);
            let owned = |place: (usize, usize)| self.owners[place] == number;
            if !places(bounds).any(owned) {
                continue;
            }
            let found = self.best_step(
                &old.target,
                &|col, row| owned((col, row)),
                options,
                progress,
            )?;
            let Some(step) = found.filter(|step| step.source != old.source) else {
                continue;
            };
            let around = bounds.grown(1).clipped(self.canvas.states.size());
            let before = self.energy(around)?;
            if self.take(&step, progress)?.is_none() {
                continue;
            }
            if self.energy(around)? < before {
                replaced += 1;
            } else {
                self.undo();
            }
        }
        Ok(replaced)
    }

    /// The step with the best match of a target; none if there is none.
    fn best_step(
        &self,
        target: &Target,
        forgotten: &dyn Fn(usize, usize) -> bool,
        options: &FillOptions,
        progress: &Progress,
    ) -> Result<Option<Step>, CompleteError> {
        let search = SearchOptions {
            count: 1,
            along_plane: Some(target.plane),
            ..SearchOptions::default()
        };
        match self.best_without(target, forgotten, &search, progress) {
            Ok(found) => Ok(found.first().map(|found| Step {
                blend: options.blend,
                ..self.step(target, found)
            })),
            Err(CompleteError::Cancelled(cancelled)) => Err(cancelled.into()),
            // too large, or nothing of it is known
            Err(_) => Ok(None),
        }
    }

    /// Takes a step, and says where pixels have changed; a step that changes none is forgotten.
    fn take(&mut self, step: &Step, progress: &Progress) -> Result<Option<Rect>, CompleteError> {
        if self.apply(step, progress)? == 0 {
            self.undo();
            return Ok(None);
        }
        let last = self.steps().len() - 1;
        Ok(Some(self.way_of(last as u32)?.bounds(&self.canvas)))
    }
}

fn places(rect: Rect) -> impl Iterator<Item = (usize, usize)> {
    (0..rect.pixels()).map(move |k| (rect.col + k % rect.width, rect.row + k / rect.width))
}

//! A picture on its way: the steps that were taken, and what is known by now.

use super::index::{FragmentIndex, Match, RADII, SearchOptions, View};
use super::paste::{Way, paste};
use super::target::{SourceFragment, Step, Target};
use super::template::{TargetPixel, Template};
use crate::canvas::{Canvas, HOLE, Ink, KNOWN, mixed};
use crate::error::CompleteError;
use crate::parts::in_quad;
use crate::rectified::sampled;
use glam::{DVec2, IVec2};
use ravec_planar::Homography;
use ravec_progress::Progress;
use ravec_raster::{Color, Image, Rect};

/// No step gave this pixel.
pub(super) const NOBODY: u32 = u32::MAX;

/// A picture whose hole is filled step by step.
///
/// ```
/// use glam::dvec2;
/// use ravec_completion::{FragmentIndex, Retouch, SearchOptions, Sources, Target};
/// use ravec_progress::Progress;
/// use ravec_raster::{Image, Mask, Rect, Size, Srgb};
///
/// // tiles, and a stain on them
/// let size = Size::new(160, 120)?;
/// let tiles = Image::from_fn(size, |col, row| {
///     Srgb(if col % 20 < 2 || row % 15 < 2 { [200u8, 200, 190] } else { [90, 60, 50] })
/// });
/// let hole = Mask::from_rect(size, Rect::new(70, 50, 16, 12));
/// let stained = Image::from_fn(size, |col, row| if hole.at(col, row) > 0.0 { Srgb([0; 3]) } else { tiles[(col, row)] });
///
/// let index = FragmentIndex::new(&Sources::new(&stained, &hole), &Progress::none())?;
/// let mut retouch = Retouch::new(&index);
/// let target = Target::new(dvec2(78.0, 56.0), 24);
/// let matches = retouch.best(&target, &SearchOptions::default(), &Progress::none())?;
/// retouch.apply(&retouch.step(&target, &matches[0]), &Progress::none())?;
/// assert_eq!(retouch.open_px(), 0);
/// assert_eq!(retouch.picture(&stained), tiles);
/// let part = ravec_raster::Rect::new(3, 4, 20, 15);
/// assert_eq!(retouch.picture_in(&stained, part), tiles.crop(3, 4, part.size().unwrap()).ok());
///
/// retouch.undo();
/// assert_eq!(retouch.picture(&stained), stained);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Retouch<'a> {
    pub(super) index: &'a FragmentIndex,
    /// The picture as it is now.
    pub(super) canvas: Canvas,
    /// For each pixel of the hole the number of the step that gave it, or [`NOBODY`].
    pub(super) owners: Image<u32>,
    open_px: usize,
    log: Vec<Logged>,
}

/// A [`Retouch`] without its index, so that both can be kept side by side. [`Retouch::resume`] goes on from it.
#[derive(Debug)]
pub struct RetouchState {
    /// Number of the index.
    index: u64,
    canvas: Canvas,
    owners: Image<u32>,
    open_px: usize,
    log: Vec<Logged>,
}

/// A step with what it replaced.
#[derive(Debug)]
struct Logged {
    step: Step,
    before: Vec<Before>,
}

#[derive(Debug)]
struct Before {
    place: (usize, usize),
    ink: Ink,
    state: u8,
    owner: u32,
}

impl<'a> Retouch<'a> {
    /// The picture of an index before the first step.
    pub fn new(index: &'a FragmentIndex) -> Self {
        let canvas = index.photos[0].clone();
        let open_px = canvas
            .states
            .pixels()
            .iter()
            .filter(|&&s| s & HOLE != 0)
            .count();
        Self {
            index,
            owners: Image::new(canvas.states.size(), NOBODY),
            canvas,
            open_px,
            log: Vec::new(),
        }
    }

    /// Goes on from a state, without the copy of the picture that [`new`](Self::new) makes; `None` if it is of another index.
    pub fn resume(index: &'a FragmentIndex, state: RetouchState) -> Option<Self> {
        (state.index == index.number).then_some(Self {
            index,
            canvas: state.canvas,
            owners: state.owners,
            open_px: state.open_px,
            log: state.log,
        })
    }

    /// The state, apart from the index.
    pub fn suspend(self) -> RetouchState {
        RetouchState {
            index: self.index.number,
            canvas: self.canvas,
            owners: self.owners,
            open_px: self.open_px,
            log: self.log,
        }
    }

    /// The source.
    pub fn index(&self) -> &'a FragmentIndex {
        self.index
    }

    /// Pixels of the hole that no step has given yet.
    pub fn open_px(&self) -> usize {
        self.open_px
    }

    /// The steps so far, the first one first.
    pub fn steps(&self) -> impl ExactSizeIterator<Item = &Step> {
        self.log.iter().map(|logged| &logged.step)
    }

    /// The sources that fit best what is known of a target by now, the best first. Fewer than requested, and perhaps none,
    /// if the target is larger than what is known in one piece.
    ///
    /// # Errors
    /// [`CompleteError::Fragment`] for a target that is not in the picture, of which nothing is known, or whose radius is out
    /// of range, [`CompleteError::Radius`] if there is no source of that radius, [`CompleteError::Cancelled`].
    pub fn best(
        &self,
        target: &Target,
        options: &SearchOptions,
        progress: &Progress,
    ) -> Result<Vec<Match>, CompleteError> {
        self.best_without(target, &|_, _| false, options, progress)
    }

    /// As [`Retouch::best`], as if some pixels were not known.
    pub(super) fn best_without(
        &self,
        target: &Target,
        forgotten: &dyn Fn(usize, usize) -> bool,
        options: &SearchOptions,
        progress: &Progress,
    ) -> Result<Vec<Match>, CompleteError> {
        let target = self.checked(target)?;
        let template = self.template(&target, forgotten)?;
        if template.weight() <= 0.0 {
            return Err(CompleteError::Fragment {
                what: format!(
                    "nothing is known within {} pixels of ({}, {}): begin at the rim of the hole",
                    target.radius_px, target.at.x, target.at.y
                ),
            });
        }
        let found = self.index.best(template, &target, options, progress)?;
        if found.is_empty() {
            return Err(CompleteError::Radius {
                radius_px: target.radius_px,
                largest_radius_px: self.index.largest_radius(),
            });
        }
        Ok(found)
    }

    /// The source that fits best at most this many pixels from another one; none if that is in no buffer.
    pub(super) fn near(
        &self,
        target: &Target,
        source: &SourceFragment,
        reach: i32,
        progress: &Progress,
    ) -> Result<Option<SourceFragment>, CompleteError> {
        let template = self.template(&self.checked(target)?, &|_, _| false)?;
        let found = self.index.near(template, source, reach, progress)?;
        Ok(found.map(|found| found.source))
    }

    /// The step that lays a match over a target, with tones bent to what is around.
    pub fn step(&self, target: &Target, found: &Match) -> Step {
        Step {
            target: settled(target),
            source: found.source,
            blend: true,
        }
    }

    /// Takes a step, and returns the number of pixels that it changed. Pixels outside the hole never change.
    ///
    /// A step that was changed by hand may reach sources that are not known; what it cannot give stays as it was.
    ///
    /// # Errors
    /// [`CompleteError::Fragment`] for a target or source that there is not, [`CompleteError::Cancelled`]; then nothing has
    /// changed.
    pub fn apply(&mut self, step: &Step, progress: &Progress) -> Result<usize, CompleteError> {
        let step = Step {
            target: self.checked(&step.target)?,
            ..*step
        };
        let way = Way::new(self.index, &step)?;
        let hole = &self.index.hole;
        let pasted = paste(
            &way,
            &self.canvas,
            step.blend,
            |col, row| hole.at(col, row) > 0.0,
            progress,
        )?;
        let owner = self.log.len() as u32;
        let mut before = Vec::with_capacity(pasted.len());
        for pixel in pasted {
            let place = pixel.place;
            before.push(Before {
                place,
                ink: self.canvas.inks[place],
                state: self.canvas.states[place],
                owner: self.owners[place],
            });
            self.open_px -= usize::from(self.canvas.states[place] & HOLE != 0);
            self.canvas.inks[place] = pixel.ink;
            self.canvas.states[place] = KNOWN;
            self.owners[place] = owner;
        }
        let changed = before.len();
        self.log.push(Logged { step, before });
        Ok(changed)
    }

    /// Takes the last step back, bit for bit, and returns it; none if there is none.
    pub fn undo(&mut self) -> Option<Step> {
        let Logged { step, before } = self.log.pop()?;
        for pixel in before {
            self.canvas.inks[pixel.place] = pixel.ink;
            self.canvas.states[pixel.place] = pixel.state;
            self.owners[pixel.place] = pixel.owner;
            self.open_px += usize::from(pixel.state & HOLE != 0);
        }
        Some(step)
    }

    /// Takes steps one after another, as a log says that was written before. The same steps on the same pictures give the
    /// same bytes.
    ///
    /// # Errors
    /// As [`Retouch::apply`]; the steps before the one that failed remain.
    pub fn replay<'b>(
        &mut self,
        steps: impl IntoIterator<Item = &'b Step>,
        progress: &Progress,
    ) -> Result<(), CompleteError> {
        for step in steps {
            self.apply(step, progress)?;
        }
        Ok(())
    }

    /// Undoes steps and takes others until the steps so far are `steps`: the cost is that of the steps that differ.
    ///
    /// # Errors
    /// As [`Retouch::apply`]; the steps before the one that failed remain.
    pub fn follow(&mut self, steps: &[Step], progress: &Progress) -> Result<(), CompleteError> {
        let taken = self.log.iter().map(|logged| &logged.step);
        let same = |(taken, step): &(&Step, &Step)| {
            let target = settled(&step.target);
            **taken == Step { target, ..**step }
        };
        let common = taken.zip(steps).take_while(same).count();
        while self.log.len() > common {
            self.undo();
        }
        self.replay(&steps[common..], progress)
    }

    /// The picture as it is now. Pixels that the hole does not cover, and those that are still open, come back bit for bit;
    /// those that it covers in part are mixed, in linear light. `image` is the picture of the index; of another one only what
    /// lies within both is filled.
    pub fn picture<P: Color>(&self, image: &Image<P>) -> Image<P> {
        let mut picture = image.clone();
        let width = self.owners.width();
        for (place, &owner) in self.owners.pixels().iter().enumerate() {
            let at = (place % width, place / width);
            if owner != NOBODY
                && let Some(pixel) = image.get(at.0, at.1)
            {
                let coverage = self.index.hole.at(at.0, at.1);
                picture[at] = mixed(pixel, self.canvas.inks[at], coverage);
            }
        }
        picture
    }

    /// A part of [`picture`](Self::picture); `None` if `part` is empty or reaches beyond `image`.
    pub fn picture_in<P: Color>(&self, image: &Image<P>, part: Rect) -> Option<Image<P>> {
        if part.is_empty() || part.right() > image.width() || part.bottom() > image.height() {
            return None;
        }
        let mut picture = image.crop(part.col, part.row, part.size()?).ok()?;
        for row in 0..part.height {
            for col in 0..part.width {
                let at = (part.col + col, part.row + row);
                if self
                    .owners
                    .get(at.0, at.1)
                    .is_some_and(|owner| owner != NOBODY)
                {
                    let coverage = self.index.hole.at(at.0, at.1);
                    picture[(col, row)] = mixed(image[at], self.canvas.inks[at], coverage);
                }
            }
        }
        Some(picture)
    }

    pub(super) fn way_of(&self, step: u32) -> Result<Way<'a>, CompleteError> {
        Way::new(self.index, &self.log[step as usize].step)
    }

    pub(super) fn step_at(&self, step: u32) -> &Step {
        &self.log[step as usize].step
    }

    /// The target, in the middle of its pixel, if it makes sense.
    fn checked(&self, target: &Target) -> Result<Target, CompleteError> {
        let wrong = |what: String| Err(CompleteError::Fragment { what });
        if !RADII.contains(&target.radius_px) {
            return wrong(format!(
                "fragments have a radius of {} to {} pixels, not {}",
                RADII.start(),
                RADII.end(),
                target.radius_px
            ));
        }
        let size = self.canvas.states.size();
        let end = DVec2::new(size.width() as f64, size.height() as f64);
        let DVec2 { x, y } = target.at;
        if !(target.at.cmpge(DVec2::ZERO).all() && target.at.cmplt(end).all()) {
            return wrong(format!(
                "the target at ({x}, {y}) lies outside the picture of {size} pixels"
            ));
        }
        let view = self.index.view(target.plane)?;
        if view.inverse().try_apply(target.at).is_none() {
            return wrong(format!(
                "the target at ({x}, {y}) lies behind the horizon of its plane"
            ));
        }
        Ok(settled(target))
    }

    /// Known pixels of a target.
    fn template(
        &self,
        target: &Target,
        forgotten: &dyn Fn(usize, usize) -> bool,
    ) -> Result<Template, CompleteError> {
        let channels = self.index.channels;
        let (canvas, features) = (&self.canvas, self.index.features.as_ref());
        let radius = target.radius_px as i32;
        if target.plane.is_none() {
            let middle = target.at.floor().as_ivec2();
            return Ok(Template::new(
                target.shape,
                radius,
                channels,
                |step: IVec2| {
                    let at = middle + step;
                    let place = (at.x as usize, at.y as usize);
                    let state =
                        (at.min_element() >= 0).then(|| canvas.states.get(place.0, place.1));
                    let Some(state) = state.flatten() else {
                        return TargetPixel::default();
                    };
                    let feature = features.map_or(0.0, |mask| mask.at(place.0, place.1));
                    TargetPixel {
                        inside: true,
                        known: state & KNOWN != 0 && !forgotten(place.0, place.1),
                        values: channels.of(canvas.inks[place], feature),
                    }
                },
            ));
        }
        let picture_from_view = self.index.view(target.plane)?;
        let middle = picture_from_view.inverse().apply(target.at);
        Ok(Template::new(target.shape, radius, channels, |step| {
            let at = middle + step.as_dvec2();
            let Some((ink, state)) = sampled(canvas, &picture_from_view, at) else {
                return TargetPixel::default();
            };
            let from = picture_from_view.apply(at);
            let feature = features.map_or(0.0, |mask| mask.coverage().bilinear(from));
            TargetPixel {
                inside: true,
                known: state & KNOWN != 0 && !forgotten(from.x as usize, from.y as usize),
                values: channels.of(ink, feature),
            }
        }))
    }
}

impl FragmentIndex {
    /// The map from the rectified view of a plane to the picture; without a plane that which changes nothing.
    pub(super) fn view(&self, plane: Option<usize>) -> Result<Homography, CompleteError> {
        let Some(plane) = plane else {
            return Ok(Homography::IDENTITY);
        };
        let view = self.views.get(plane).and_then(Option::as_ref);
        view.map(|view| view.picture_from_view)
            .ok_or_else(|| CompleteError::Fragment {
                what: format!(
                    "there is no plane {plane} of which a part of the hole is seen, among {}, counted from 0",
                    self.views.len()
                ),
            })
    }

    /// The plane in whose quadrilateral a position of the picture lies: the first one, if there are several.
    pub fn plane_at(&self, at: DVec2) -> Option<usize> {
        let contains =
            |view: &Option<View>| view.as_ref().is_some_and(|view| in_quad(&view.quad, at));
        self.views.iter().position(contains)
    }
}

/// The target, in the middle of its pixel if it has no plane.
fn settled(target: &Target) -> Target {
    if target.plane.is_some() {
        return *target;
    }
    Target {
        at: target.at.floor() + 0.5,
        ..*target
    }
}

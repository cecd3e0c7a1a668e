//! Laying a source over its target: which pixels it gives, and with what tones.
//!
//! Where the target is still open, the source fills it. Where earlier fragments lie, a cut decides which pixel keeps the old
//! and which takes the new, so that the seam runs where it shows least; if nothing is open, the inner half of the fragment
//! is new in any case. Then tones are bent so that gradients are those of the source and the rim fits (see
//! [`crate::blend`]).
//!
//! Coordinates are composed: a pixel goes to the view of the target, along the step, and from the view of the source into
//! the photo, which is sampled once.

use super::index::FragmentIndex;
use super::target::Step;
use crate::blend::{self, Blend};
use crate::canvas::{Canvas, HOLE, Ink, KNOWN};
use crate::error::CompleteError;
use crate::max_flow::FlowGraph;
use crate::rectified::mean_ink;
use crate::sheet::ink_distance_sq;
use glam::{DMat2, DVec2, dvec2};
use ravec_planar::Homography;
use ravec_progress::{Cancelled, Progress};
use ravec_raster::Rect;
use rayon::prelude::*;

/// Samples for a pixel in each direction where the source is finer than the target, at most.
const MAX_TAPS: f64 = 4.0;
/// If all of a target is filled already, what lies within this share of the radius is new in any case.
const CORE: f64 = 0.5;
/// Costs of the cut are whole numbers: squared differences of 1 are so much.
const COST: f32 = 1e6;
/// More than any cut can save.
const FORCED: i32 = 1 << 28;
/// Difference of rim and source above which the rim has an edge that the source has not, and tones should not follow.
const TRUSTED_STEP: f32 = 0.6;
/// Weight that holds tones to those of the source, against one neighbor: light may change from one end of a fragment to
/// the other, but does not run away over many of them.
const HOLD: f32 = 1e-2;

/// The way from pixels of the picture to those of a step's source.
pub(super) struct Way<'a> {
    photo: &'a Canvas,
    view_from_picture: Homography,
    photo_from_base: Homography,
    linear: DMat2,
    target_in_view: DVec2,
    source_in_base: DVec2,
    radius: f64,
    step: Step,
}

impl<'a> Way<'a> {
    /// The way of a step, if that names planes and photos that there are.
    pub(super) fn new(index: &'a FragmentIndex, step: &Step) -> Result<Self, CompleteError> {
        let wrong = |what: String| CompleteError::Fragment { what };
        let photo = index.photos.get(step.source.photo).ok_or_else(|| {
            let photos = index.photos.len();
            wrong(format!(
                "there is no photo {} among {photos}",
                step.source.photo
            ))
        })?;
        let picture_from_view = index.view(step.target.plane)?;
        if step.source.plane.is_some() && step.source.photo != 0 {
            return Err(wrong(
                "only the picture itself has planes, other photos have none".to_owned(),
            ));
        }
        let photo_from_base = index.view(step.source.plane)?;
        if !step.source.transform.is_usable() {
            return Err(wrong(format!(
                "copies cannot be scaled by {}: scales are 0.25 to 4",
                step.source.transform.scale
            )));
        }
        let view_from_picture = picture_from_view.inverse();
        let ends = view_from_picture
            .try_apply(step.target.at)
            .zip(photo_from_base.inverse().try_apply(step.source.at));
        let (target_in_view, source_in_base) = ends
            .ok_or_else(|| wrong("a fragment lies behind the horizon of its plane".to_owned()))?;
        Ok(Self {
            photo,
            view_from_picture,
            photo_from_base,
            linear: step.source.transform.source_from_copy(),
            target_in_view,
            source_in_base,
            radius: f64::from(step.target.radius_px) + 0.5,
            step: *step,
        })
    }

    /// Distance of a pixel from the middle of the target, as a share of its radius; `None` behind the horizon.
    pub(super) fn share(&self, (col, row): (usize, usize)) -> Option<f64> {
        let at = self
            .view_from_picture
            .try_apply(dvec2(col as f64 + 0.5, row as f64 + 0.5))?;
        Some(self.step.target.shape.distance(at - self.target_in_view) / self.radius)
    }

    /// Value of the source at a pixel; none where it is unknown.
    pub(super) fn ink(&self, (col, row): (usize, usize)) -> Option<Ink> {
        let middle = dvec2(col as f64 + 0.5, row as f64 + 0.5);
        let in_view = self.view_from_picture.try_apply(middle)?;
        let in_base = self.source_in_base + self.linear * (in_view - self.target_in_view);
        let from = self.photo_from_base.try_apply(in_base)?;
        let states = &self.photo.states;
        let known = from.cmpge(DVec2::ZERO).all()
            && states
                .get(from.x as usize, from.y as usize)
                .is_some_and(|s| s & KNOWN != 0);
        if !known {
            return None;
        }
        let j = self.photo_from_base.jacobian(in_base)
            * self.linear
            * self.view_from_picture.jacobian(middle);
        let finer = j.x_axis.length().max(j.y_axis.length());
        // a little finer is still within what the kernel distinguishes
        let taps = (finer - 0.25).ceil().clamp(1.0, MAX_TAPS);
        Some(mean_ink(self.photo, taps as usize, |step| from + j * step))
    }

    /// A rectangle of the picture in which all of the target lies.
    pub(super) fn bounds(&self, canvas: &Canvas) -> Rect {
        let size = canvas.states.size();
        let picture_from_view = self.view_from_picture.inverse();
        let reach = DVec2::splat(self.radius + 1.0);
        let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        for sign in [
            dvec2(-1.0, -1.0),
            dvec2(1.0, -1.0),
            dvec2(1.0, 1.0),
            dvec2(-1.0, 1.0),
        ] {
            let Some(at) = picture_from_view.try_apply(self.target_in_view + sign * reach) else {
                // it reaches beyond the horizon: anywhere
                return Rect::of(size);
            };
            (low, high) = (low.min(at), high.max(at));
        }
        let end = dvec2(size.width() as f64, size.height() as f64);
        let low = low.floor().clamp(DVec2::ZERO, end).as_usizevec2();
        let high = high.ceil().clamp(DVec2::ZERO, end).as_usizevec2();
        Rect::new(low.x, low.y, high.x - low.x, high.y - low.y)
    }
}

/// A pixel that a step gives.
pub(super) struct Pasted {
    pub(super) place: (usize, usize),
    pub(super) ink: Ink,
}

/// A pixel that a step may give.
struct Candidate {
    place: (usize, usize),
    ink: Ink,
    share: f64,
    open: bool,
}

/// The pixels that a step gives, and what they become.
pub(super) fn paste(
    way: &Way,
    canvas: &Canvas,
    blend: bool,
    replaceable: impl Fn(usize, usize) -> bool + Sync,
    progress: &Progress,
) -> Result<Vec<Pasted>, Cancelled> {
    let bounds = way.bounds(canvas);
    let candidates: Vec<Candidate> = (0..bounds.pixels())
        .into_par_iter()
        .with_min_len(256)
        .filter_map(|k| {
            let place = (bounds.col + k % bounds.width, bounds.row + k / bounds.width);
            if !replaceable(place.0, place.1) {
                return None;
            }
            let share = way.share(place).filter(|&share| share <= 1.0)?;
            Some(Candidate {
                place,
                ink: way.ink(place)?,
                share,
                open: canvas.states[place] & HOLE != 0,
            })
        })
        .collect();
    progress.check()?;
    let mut number = vec![u32::MAX; bounds.pixels()];
    let at = |(col, row): (usize, usize)| (row - bounds.row) * bounds.width + col - bounds.col;
    for (i, candidate) in candidates.iter().enumerate() {
        number[at(candidate.place)] = i as u32;
    }
    let find = |place: (usize, usize)| {
        let inside = bounds.contains(place.0, place.1);
        inside.then(|| number[at(place)]).filter(|&i| i != u32::MAX)
    };
    let new = cut(way, canvas, &candidates, find, &replaceable, progress)?;
    let mut chosen = vec![u32::MAX; candidates.len()];
    let mut members: Vec<&Candidate> = Vec::new();
    for (i, candidate) in candidates.iter().enumerate() {
        if new[i] {
            chosen[i] = members.len() as u32;
            members.push(candidate);
        }
    }
    let mut values: Vec<Ink> = members.iter().map(|member| member.ink).collect();
    if blend {
        values = blended(
            way,
            canvas,
            &members,
            values,
            |place| {
                find(place)
                    .map(|i| chosen[i as usize])
                    .filter(|&i| i != u32::MAX)
            },
            progress,
        )?;
    }
    Ok(members
        .iter()
        .zip(values)
        .map(|(member, ink)| Pasted {
            place: member.place,
            ink,
        })
        .collect())
}

/// The four neighbors of a pixel that are in the picture.
pub(super) fn neighbors(
    (col, row): (usize, usize),
    canvas: &Canvas,
) -> impl Iterator<Item = (usize, usize)> {
    let size = canvas.states.size();
    [
        (col.wrapping_sub(1), row),
        (col, row.wrapping_sub(1)),
        (col + 1, row),
        (col, row + 1),
    ]
    .into_iter()
    .filter(move |&(x, y)| x < size.width() && y < size.height())
}

/// Selects the candidates that become new.
fn cut(
    way: &Way,
    canvas: &Canvas,
    candidates: &[Candidate],
    find: impl Fn((usize, usize)) -> Option<u32>,
    replaceable: &impl Fn(usize, usize) -> bool,
    progress: &Progress,
) -> Result<Vec<bool>, Cancelled> {
    let any_open = candidates.iter().any(|candidate| candidate.open);
    if candidates.iter().all(|candidate| candidate.open) {
        return Ok(vec![true; candidates.len()]);
    }
    let cost = |value: f32| (value * COST).min(FORCED as f32 / 16.0) as i32;
    // the source's side of the cut is old, the sink's is new
    let mut graph = FlowGraph::default();
    graph.reset(candidates.len());
    let off = |candidate: &Candidate| {
        if candidate.open {
            0.0
        } else {
            ink_distance_sq(&canvas.inks[candidate.place], &candidate.ink)
        }
    };
    for (i, candidate) in candidates.iter().enumerate() {
        let node = i as u32;
        if candidate.open || !any_open && candidate.share <= CORE {
            graph.add_terminals(node, 0, FORCED);
        }
        let own = off(candidate);
        for place in neighbors(candidate.place, canvas) {
            if let Some(j) = find(place) {
                if (j as usize) < i {
                    let other = &candidates[j as usize];
                    // where one pixel was open, only the other has a known value, which counts twice
                    let factor = if candidate.open || other.open {
                        2.0
                    } else {
                        1.0
                    };
                    let capacity = cost(factor * (own + off(other)));
                    graph.add_edge(node, j, capacity, capacity);
                }
            } else if canvas.states[place] & KNOWN != 0 && !candidate.open {
                // beyond the fragment everything stays; what was known from the first fits what is there already
                let there = way
                    .ink(place)
                    .map(|ink| ink_distance_sq(&canvas.inks[place], &ink));
                let both = if replaceable(place.0, place.1) {
                    own
                } else {
                    0.0
                };
                graph.add_terminals(node, cost(both + there.unwrap_or(own)), 0);
            }
        }
    }
    graph.solve(|| progress.is_cancelled());
    progress.check()?;
    Ok((0..candidates.len() as u32)
        .map(|node| candidates[node as usize].open || graph.on_sink_side(node))
        .collect())
}

/// Values with the gradients of the source that fit the known pixels around.
fn blended(
    way: &Way,
    canvas: &Canvas,
    members: &[&Candidate],
    values: Vec<Ink>,
    find: impl Fn((usize, usize)) -> Option<u32>,
    progress: &Progress,
) -> Result<Vec<Ink>, Cancelled> {
    let mut system = Blend {
        values,
        hold: HOLD,
        ..Blend::default()
    };
    for (i, member) in members.iter().enumerate() {
        for place in neighbors(member.place, canvas) {
            if let Some(j) = find(place) {
                if (j as usize) < i {
                    let other = &members[j as usize].ink;
                    let wanted = std::array::from_fn(|c| member.ink[c] - other[c]);
                    system.pairs.push((i as u32, j, wanted));
                }
            } else if canvas.states[place] & KNOWN != 0
                && let Some(there) = way.ink(place)
            {
                let known = canvas.inks[place];
                let wanted: Ink = std::array::from_fn(|c| known[c] + member.ink[c] - there[c]);
                let step = ink_distance_sq(&wanted, &member.ink) / (TRUSTED_STEP * TRUSTED_STEP);
                let weight = (1.0 + step).powi(-2);
                system.anchors.push((i as u32, wanted, weight));
            }
        }
    }
    blend::solve(&mut system, progress)?;
    Ok(system.values)
}

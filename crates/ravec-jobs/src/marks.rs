//! Strokes of a shot: drawn in a few frames, carried through the others.

use crate::context::Context;
use crate::error::JobError;
use crate::files::is_stream;
use crate::frame_mark::{FrameMark, Side};
use crate::pixel_centers::PixelCenters;
use crate::report::Report;
use crate::shot::{ShotTrack, encoded};
use crate::track::exclusions::StrokePictures;
use crate::track::follow::{Reader, Shot, block_frames};
use crate::video::{FrameRange, open_clip};
use ravec::matting::{Colors, Constraints};
use ravec::planar::Homography;
use ravec::progress::Phase;
use ravec::raster::{Image, Mask, Plane, Size};
use ravec::video_edit::{CarriedStroke, StrokeFollower};
use ravec_video::FrameSource as _;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::Path;

/// Gray value of a pixel about which nothing is known.
pub(crate) const UNKNOWN: u8 = 128;

/// Strokes of a picture of strokes at most; the rest of its pixels are one stroke together.
const MAX_PARTS: usize = 64;

/// Strokes of an operation on a shot.
pub(crate) struct MarkSource<'a> {
    /// The clip.
    pub input: &'a Path,
    /// Size of its frames.
    pub size: Size,
    /// Strokes as data.
    pub marks: &'a [FrameMark],
    /// Strokes in pictures.
    pub pictures: &'a StrokePictures,
    /// Frames before and after its own in which a stroke holds; if it is absent, all for strokes as data, and none for pictures.
    pub carry: Option<u64>,
    /// Convention of the points of strokes.
    pub centers: PixelCenters,
    /// Maps of the background to the frames; the identity without.
    pub track: Option<&'a ShotTrack>,
    /// File of the track, for messages.
    pub track_path: Option<&'a Path>,
}

/// Pixels, column and row.
type Cells = Vec<(usize, usize)>;

/// The pixels of a mask.
fn cells(mask: &Mask) -> Cells {
    let Some(bounds) = mask.bounding_box() else {
        return Vec::new();
    };
    let rows = bounds.row..bounds.bottom();
    let all = rows.flat_map(|row| (bounds.col..bounds.right()).map(move |col| (col, row)));
    all.filter(|&(col, row)| mask.at(col, row) > 0.0).collect()
}

/// Strokes with their places in all frames.
pub(crate) struct Marks {
    size: Size,
    strokes: Vec<Drawn>,
}

/// A stroke, and the frames before and after its own in which it holds.
struct Drawn {
    stroke: CarriedStroke,
    carry: u64,
}

impl Drawn {
    /// True for a stroke that has to be followed.
    fn moves(&self) -> bool {
        self.stroke.is_foreground() && self.carry > 0
    }

    fn reaches(&self, frame: u64) -> bool {
        self.stroke.frame().abs_diff(frame) <= self.carry
    }
}

/// The pixels of a stroke before its frame is read.
struct Outline {
    side: Side,
    cells: Cells,
    carry: u64,
}

impl Outline {
    fn drawn(self, frame: u64, colors: &Colors, map: &Homography) -> Option<Drawn> {
        let is_foreground = self.side == Side::Foreground;
        let stroke = CarriedStroke::new(frame, self.cells, is_foreground, colors, map)?;
        Some(Drawn {
            stroke,
            carry: self.carry,
        })
    }
}

impl MarkSource<'_> {
    /// The map to a frame from the reference frame.
    fn map(&self, frame: u64) -> Result<Homography, JobError> {
        let Some(track) = self.track else {
            return Ok(Homography::IDENTITY);
        };
        let map = track.map(frame).copied();
        map.ok_or_else(|| JobError::TrackFile {
            path: self.track_path.unwrap_or(Path::new("")).to_path_buf(),
            reason: format!("it lacks frame {frame}"),
        })
    }

    /// The pixels of all strokes by frame, in the order in which they are drawn.
    fn outlines(&self) -> Result<BTreeMap<u64, Vec<Outline>>, JobError> {
        let mut outlines: BTreeMap<u64, Vec<Outline>> = BTreeMap::new();
        let carry = self.carry.unwrap_or(0);
        for frame in self.pictures.frames() {
            let Some([foreground, background]) = self.pictures.of(frame)? else {
                continue;
            };
            let list = outlines.entry(frame).or_default();
            let parts = parts(&foreground).into_iter();
            list.extend(parts.map(|part| Outline {
                side: Side::Foreground,
                cells: cells(&part),
                carry,
            }));
            list.push(Outline {
                side: Side::Background,
                cells: cells(&background),
                carry,
            });
        }
        for mark in self.marks {
            outlines.entry(mark.frame).or_default().push(Outline {
                side: mark.side,
                cells: mark.cells(self.size, self.centers),
                carry: self.carry.unwrap_or(u64::MAX),
            });
        }
        Ok(outlines)
    }
}

impl Marks {
    /// Strokes that hold in their own frames.
    ///
    /// # Errors
    /// [`JobError::Strokes`], those of reading pictures.
    pub fn in_own_frames(source: &MarkSource<'_>) -> Result<Self, JobError> {
        let unseen: Colors = Image::new(source.size, [0.0; 3]);
        let mut strokes = Vec::new();
        for (frame, list) in source.outlines()? {
            for mut outline in list {
                outline.carry = 0;
                strokes.extend(outline.drawn(frame, &unseen, &Homography::IDENTITY));
            }
        }
        Ok(Self {
            size: source.size,
            strokes,
        })
    }

    /// Carries strokes through the clip, which is read for that: the frames that have strokes, and for foreground strokes all frames
    /// as far as these are carried.
    ///
    /// # Errors
    /// [`JobError::ReadClip`], [`JobError::Strokes`] also for strokes behind its end, [`JobError::TrackFile`],
    /// [`JobError::Cancelled`].
    pub fn carried(
        source: &MarkSource<'_>,
        report: &mut Report,
        context: &Context,
    ) -> Result<Self, JobError> {
        let outlines = source.outlines()?;
        let mut all = outlines.values().flatten();
        if all.all(|outline| outline.carry == 0) {
            return Self::in_own_frames(source);
        }
        if is_stream(source.input) {
            report.warn("a stream is read once: strokes hold in their own frames only".to_owned());
            return Self::in_own_frames(source);
        }
        // the clip is in the list of inputs already
        let mut unused = Report::new("strokes", &());
        let clip = open_clip(source.input, None, &mut unused, context)?;
        let frames = clip.info().frames;
        let mut reader = Reader::new(clip, source.input, FrameRange::default())?;
        let mut strokes = Vec::new();
        for (frame, list) in outlines {
            context.progress.check()?;
            let too_short = || JobError::Strokes {
                path: source.input.to_path_buf(),
                reason: format!("it ends before frame {frame}"),
            };
            if frames.is_some_and(|frames| frame >= frames) {
                return Err(too_short());
            }
            reader.seek(frame)?;
            let shot = reader.next()?.ok_or_else(too_short)?;
            let colors = encoded(&shot.image);
            let map = source.map(frame)?;
            for outline in list {
                strokes.extend(outline.drawn(frame, &colors, &map));
            }
        }
        let mut marks = Self {
            size: source.size,
            strokes,
        };
        if marks.strokes.iter().any(Drawn::moves) {
            let phase = context.progress.phase("strokes", 2 * frames.unwrap_or(1));
            marks.follow_forward(&mut reader, &phase, context)?;
            marks.follow_backward(&mut reader, &phase, context)?;
        }
        Ok(marks)
    }

    /// Frames of strokes that have to be followed.
    fn starts(&self) -> impl Iterator<Item = u64> {
        let moving = self.strokes.iter().filter(|drawn| drawn.moves());
        moving.map(|drawn| drawn.stroke.frame())
    }

    fn follow_forward(
        &mut self,
        reader: &mut Reader<'_>,
        phase: &Phase,
        context: &Context,
    ) -> Result<(), JobError> {
        let Some(first) = self.starts().min() else {
            return Ok(());
        };
        let mut followers = self.followers();
        reader.seek(first)?;
        let mut current = reader.next()?;
        while let Some(shot) = current {
            context.progress.check()?;
            let (next, active) = rayon::join(|| reader.next(), || self.push(&mut followers, &shot));
            phase.advance(1);
            current = next?;
            let ahead = self.starts().any(|start| start > shot.index);
            if !active && !ahead {
                break;
            }
        }
        Ok(())
    }

    fn follow_backward(
        &mut self,
        reader: &mut Reader<'_>,
        phase: &Phase,
        context: &Context,
    ) -> Result<(), JobError> {
        let Some(last) = self.starts().max() else {
            return Ok(());
        };
        let mut followers = self.followers();
        let count = block_frames(self.size, None);
        let mut end = last + 1;
        while end > 0 {
            let start = end.saturating_sub(count);
            reader.seek(start)?;
            let mut active = false;
            for shot in reader.block(end - start, context)?.iter().rev() {
                context.progress.check()?;
                active = self.push(&mut followers, shot);
                phase.advance(1);
            }
            end = start;
            if !active && !self.starts().any(|start| start < end) {
                break;
            }
        }
        Ok(())
    }

    /// A place for the follower of each stroke.
    fn followers(&self) -> Vec<Option<StrokeFollower>> {
        vec![None; self.strokes.len()]
    }

    /// Follows all strokes that are on their way to a frame, and starts those that are drawn in it. False if there is none.
    fn push(&mut self, followers: &mut [Option<StrokeFollower>], shot: &Shot) -> bool {
        let colors = encoded(&shot.image);
        let pairs = self.strokes.par_iter_mut().zip(followers.par_iter_mut());
        let active = pairs.map(|(drawn, place)| {
            if !drawn.moves() {
                return false;
            }
            let reaches = drawn.reaches(shot.index);
            let stroke = &mut drawn.stroke;
            if stroke.frame() == shot.index {
                *place = Some(stroke.follow(&colors));
            } else if let Some(follower) = place
                && (!reaches || !follower.push(stroke, shot.index, &colors))
            {
                *place = None;
            }
            place.is_some()
        });
        active.reduce(|| false, |a, b| a || b)
    }

    /// Constraints of the strokes that reach a frame, on top of a trimap; `None` without both.
    ///
    /// Where strokes overlap, the stroke of the nearest frame has priority; within one frame, the last one drawn.
    pub fn constraints(
        &self,
        frame: u64,
        colors: &Colors,
        frame_from_reference: &Homography,
        trimap: Option<&Constraints>,
    ) -> Option<Constraints> {
        self.chosen(frame, colors, frame_from_reference, trimap, |_| true)
    }

    /// Constraints in a frame of the strokes that are drawn in other frames.
    pub fn of_others(
        &self,
        frame: u64,
        colors: &Colors,
        frame_from_reference: &Homography,
    ) -> Option<Constraints> {
        let is_other = |stroke: &CarriedStroke| stroke.frame() != frame;
        self.chosen(frame, colors, frame_from_reference, None, is_other)
    }

    fn chosen(
        &self,
        frame: u64,
        colors: &Colors,
        frame_from_reference: &Homography,
        trimap: Option<&Constraints>,
        is_chosen: impl Fn(&CarriedStroke) -> bool,
    ) -> Option<Constraints> {
        let reaching = self.strokes.iter().filter(|drawn| drawn.reaches(frame));
        let strokes = reaching.map(|drawn| &drawn.stroke);
        let mut near: Vec<&CarriedStroke> = strokes.filter(|stroke| is_chosen(stroke)).collect();
        // a stable order: later ones of a frame stay behind earlier ones
        near.sort_by_key(|stroke| std::cmp::Reverse(stroke.frame().abs_diff(frame)));
        if near.is_empty() {
            return trimap.cloned();
        }
        let mut constraints = trimap
            .cloned()
            .unwrap_or_else(|| Image::new(self.size, UNKNOWN));
        let marked: Vec<Vec<(usize, usize)>> = near
            .par_iter()
            .map(|stroke| stroke.marked(frame, colors, frame_from_reference))
            .collect();
        for (stroke, cells) in near.iter().zip(marked) {
            let value = if stroke.is_foreground() { u8::MAX } else { 0 };
            for cell in cells {
                constraints[cell] = value;
            }
        }
        Some(constraints)
    }
}

/// The connected parts of a mask, with neighbors across corners.
fn parts(mask: &Mask) -> Vec<Mask> {
    let size = mask.size();
    let mut left = mask.coverage().clone();
    let mut parts = Vec::new();
    for row in 0..size.height() {
        for col in 0..size.width() {
            if left[(col, row)] <= 0.0 {
                continue;
            }
            if parts.len() + 1 == MAX_PARTS {
                parts.push(Mask::from_coverage(&left));
                return parts;
            }
            let mut part = Plane::new(size, 0.0);
            let mut open = vec![(col, row)];
            while let Some((col, row)) = open.pop() {
                if left[(col, row)] <= 0.0 {
                    continue;
                }
                part[(col, row)] = left[(col, row)];
                left[(col, row)] = 0.0;
                let cols = col.saturating_sub(1)..(col + 2).min(size.width());
                let rows = row.saturating_sub(1)..(row + 2).min(size.height());
                open.extend(rows.flat_map(|row| cols.clone().map(move |col| (col, row))));
            }
            parts.push(Mask::from_coverage(&part));
        }
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_of_a_mask_are_disjoint_and_make_the_mask() {
        let size = Size::new(30, 20).unwrap();
        let mask = Mask::from_fn(size, |col, row| {
            (col < 5 && row < 5) || (col == 5 && row == 5) || (col > 20 && row > 3)
        });
        let parts = parts(&mask);
        assert_eq!(parts.len(), 2);
        let both = parts[0].union(&parts[1]).unwrap();
        assert_eq!(both.coverage(), mask.coverage());
        assert!(parts[0].intersect(&parts[1]).unwrap().is_empty());
        // as many dots as one likes
        let dots = Mask::from_fn(size, |col, row| col % 2 == 0 && row % 2 == 0);
        assert_eq!(super::parts(&dots).len(), MAX_PARTS);
    }
}

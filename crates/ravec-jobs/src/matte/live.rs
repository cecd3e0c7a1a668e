//! A frame with its matte under the hand: strokes are answered near them.

use super::frames::FrameMattes;
use crate::context::Context;
use crate::error::JobError;
use crate::frame_mark::{FrameMark, Side};
use crate::marks::UNKNOWN;
use crate::pixel_centers::PixelCenters;
use crate::shot::{PlateInFrame, encoded};
use ravec::matting::{
    Colors, Constraints, Matte as Solution, NEAR_PX, PlateFrame, PlateMatte, PlateParams,
    plate_matte, plate_matte_near,
};
use ravec::progress::Progress;
use ravec::raster::{AnyImage, Image, Rect, Size};
use std::sync::Arc;

/// A frame before its plate, solved, with the strokes that are drawn in it.
pub struct LiveMatte {
    index: u64,
    colors: Colors,
    plate: Arc<PlateInFrame>,
    /// Constraints of strokes that are drawn in other frames.
    others: Option<Constraints>,
    marks: Vec<FrameMark>,
    found: PlateMatte,
    params: PlateParams,
    centers: PixelCenters,
}

impl FrameMattes {
    /// Solves a frame for work by hand; `None` without a plate. `marks` are all strokes; those of other frames hold as far as they
    /// are carried here.
    ///
    /// # Errors
    /// Those of [`solve`](Self::solve).
    pub fn live(
        &self,
        index: u64,
        image: &AnyImage,
        marks: &[FrameMark],
        progress: &Progress,
        context: &Context,
    ) -> Result<Option<LiveMatte>, JobError> {
        let Some(plate) = &self.plate else {
            return Ok(None);
        };
        let map = self.map(index)?;
        let colors = encoded(image);
        let plate = plate.in_frame(&map, index, colors.size(), context)?;
        let others = self.marks.of_others(index, &colors, &map);
        let (params, centers) = (&self.matte.params.matte, self.matte.params.pixel_centers);
        let own = own_marks(marks, index);
        let constraints = constraints(others.as_ref(), &own, colors.size(), centers);
        let input = PlateFrame {
            known: Some(&plate.known),
            strokes: constraints.as_ref(),
            ..PlateFrame::new(&colors, &plate.colors)
        };
        let found = plate_matte(&input, params, progress)?;
        Ok(Some(LiveMatte {
            index,
            found,
            others,
            marks: own,
            params: params.clone(),
            centers,
            plate,
            colors,
        }))
    }
}

impl LiveMatte {
    /// Alpha and foreground.
    pub fn solution(&self) -> &Solution {
        &self.found.matte
    }

    /// Takes other strokes, and solves the surroundings of those that differ: the region in which the solution may have changed,
    /// if there is one.
    ///
    /// # Errors
    /// [`JobError::Parameter`], [`JobError::Cancelled`], after which the strokes are as they were.
    pub fn set_marks(
        &mut self,
        marks: &[FrameMark],
        progress: &Progress,
    ) -> Result<Option<Rect>, JobError> {
        let own = own_marks(marks, self.index);
        let size = self.colors.size();
        let Some(region) = difference(&self.marks, &own, size, self.centers) else {
            self.marks = own;
            return Ok(None);
        };
        // strokes tell their surroundings about colors
        let left = region.col.saturating_sub(NEAR_PX);
        let top = region.row.saturating_sub(NEAR_PX);
        let region = Rect::new(
            left,
            top,
            (region.right() + NEAR_PX).min(size.width()) - left,
            (region.bottom() + NEAR_PX).min(size.height()) - top,
        );
        let constraints = constraints(self.others.as_ref(), &own, size, self.centers);
        let input = PlateFrame {
            known: Some(&self.plate.known),
            strokes: constraints.as_ref(),
            ..PlateFrame::new(&self.colors, &self.plate.colors)
        };
        plate_matte_near(&input, &self.params, &mut self.found, region, progress)?;
        self.marks = own;
        Ok(Some(region))
    }
}

/// The strokes of a frame.
fn own_marks(marks: &[FrameMark], index: u64) -> Vec<FrameMark> {
    let own = marks.iter().filter(|mark| mark.frame == index);
    own.cloned().collect()
}

/// Constraints of the strokes of a frame, on top of those of other frames.
fn constraints(
    others: Option<&Constraints>,
    own: &[FrameMark],
    size: Size,
    centers: PixelCenters,
) -> Option<Constraints> {
    if own.is_empty() {
        return others.cloned();
    }
    let mut constraints = others.cloned().unwrap_or_else(|| Image::new(size, UNKNOWN));
    for mark in own {
        let value = match mark.side {
            Side::Foreground => u8::MAX,
            Side::Background => 0,
        };
        for cell in mark.cells(size, centers) {
            constraints[cell] = value;
        }
    }
    Some(constraints)
}

/// Pixels that the strokes of one list touch and those of the other may not.
fn difference(
    before: &[FrameMark],
    after: &[FrameMark],
    size: Size,
    centers: PixelCenters,
) -> Option<Rect> {
    let same = before.iter().zip(after).take_while(|(a, b)| a == b).count();
    let mut bounds: Option<Rect> = None;
    let mut add = |mark: &FrameMark, points: &[[f64; 2]]| {
        let Some(more) = mark.bounds(points, size, centers) else {
            return;
        };
        bounds = Some(bounds.map_or(more, |bounds| union(bounds, more)));
    };
    if let ([old], [new]) = (&before[same..], &after[same..])
        && old.side == new.side
        && old.radius_px == new.radius_px
        && new.points.starts_with(&old.points)
    {
        // the stroke in the hand has grown
        add(new, &new.points[old.points.len() - 1..]);
    } else {
        for mark in before[same..].iter().chain(&after[same..]) {
            add(mark, &mark.points);
        }
    }
    bounds
}

fn union(a: Rect, b: Rect) -> Rect {
    let (left, top) = (a.col.min(b.col), a.row.min(b.row));
    let (right, bottom) = (a.right().max(b.right()), a.bottom().max(b.bottom()));
    Rect::new(left, top, right - left, bottom - top)
}

//! Graphs below the thumbnails: a state and a value for each frame.

use super::scale::Scale;
use egui::{Align2, Color32, FontId, Painter, Pos2, Rect, Stroke, Visuals, pos2};
use std::ops::Range;

/// Height of a row in points.
pub(super) const ROW_HEIGHT: f32 = 40.0;

/// Height of the band of states.
const BAND: f32 = 5.0;

/// The state of a track in a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub enum FrameState {
    /// Nothing is known.
    #[default]
    Unknown,
    /// Followed: green.
    Good,
    /// Corrected by hand: green with a tick.
    Corrected,
    /// Followed with little certainty: orange.
    Weak,
    /// Not followed: red.
    Lost,
}

impl FrameState {
    /// The color of the state.
    pub fn color(self) -> Color32 {
        match self {
            Self::Unknown => Color32::from_gray(110),
            Self::Good | Self::Corrected => Color32::from_rgb(60, 165, 80),
            Self::Weak => Color32::from_rgb(235, 150, 30),
            Self::Lost => Color32::from_rgb(215, 50, 45),
        }
    }
}

/// A graph below the thumbnails. Its slices are indexed by the numbers of frames; frames beyond their ends are unknown.
#[derive(Debug, Clone, Copy)]
pub struct TimelineRow<'a> {
    /// Name of the row.
    pub label: &'a str,
    /// The state of each frame.
    pub states: &'a [FrameState],
    /// A value for each frame, such as the predicted error in pixels; `None` where it is unknown.
    pub values: &'a [Option<f32>],
    /// Frames with a tick.
    pub marks: &'a [u64],
}

/// One column of the screen: the worst state and the largest value of its frames.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Column {
    x: Range2,
    state: FrameState,
    value: Option<f32>,
}

/// Ends of a column.
type Range2 = [f32; 2];

impl TimelineRow<'_> {
    /// The columns of what is seen, each at least a point wide.
    fn columns(&self, scale: &Scale) -> Vec<Column> {
        let visible = scale.visible();
        let mut columns: Vec<Column> = Vec::new();
        let at_once = (1.0 / scale.cell()).ceil().max(1.0) as usize;
        for first in visible.clone().step_by(at_once) {
            let end = (first + at_once as u64).min(visible.end);
            let part = first as usize..end as usize;
            let states = cut(self.states, &part).iter();
            let values = cut(self.values, &part).iter().flatten();
            columns.push(Column {
                x: [scale.x_of(first as f64), scale.x_of(end as f64)],
                state: states.copied().max().unwrap_or_default(),
                value: values
                    .copied()
                    .filter(|value| value.is_finite())
                    .max_by(f32::total_cmp),
            });
        }
        columns
    }

    /// The value at the upper end of the graph: that of 98 in 100 values, so that a single one does not flatten the others.
    fn top(columns: &[Column]) -> f32 {
        let mut values: Vec<f32> = columns.iter().filter_map(|column| column.value).collect();
        values.sort_by(f32::total_cmp);
        let place = values.len().saturating_sub(1) * 98 / 100;
        values.get(place).copied().unwrap_or(1.0).max(1e-3)
    }

    /// Draws the row.
    pub(super) fn paint(&self, painter: &Painter, area: Rect, scale: &Scale, visuals: &Visuals) {
        painter.rect_filled(area, 0.0, visuals.extreme_bg_color);
        let columns = self.columns(scale);
        let top = Self::top(&columns);
        let graph = Rect::from_min_max(
            pos2(area.left(), area.top() + 2.0),
            pos2(area.right(), area.bottom() - BAND - 1.0),
        );
        let y_of = |value: f32| graph.bottom() - (value / top).clamp(0.0, 1.0) * graph.height();
        let mut before: Option<Pos2> = None;
        for column in &columns {
            let [left, right] = column.x;
            if column.state != FrameState::Unknown {
                let band = Rect::from_min_max(
                    pos2(left, area.bottom() - BAND),
                    pos2(right.max(left + 1.0), area.bottom()),
                );
                painter.rect_filled(band, 0.0, column.state.color());
            }
            let at = column
                .value
                .map(|value| pos2(0.5 * (left + right), y_of(value)));
            let stroke = Stroke::new(1.5, column.state.color());
            match (before, at) {
                (Some(before), Some(at)) => {
                    painter.line_segment([before, at], stroke);
                }
                (None, Some(at)) => {
                    painter.circle_filled(at, 1.0, stroke.color);
                }
                _ => {}
            }
            before = at;
        }
        self.paint_ticks(painter, area, scale, visuals);
        let font = FontId::proportional(11.0);
        let color = visuals.text_color();
        let corner = area.left_top() + egui::vec2(4.0, 2.0);
        painter.text(corner, Align2::LEFT_TOP, self.label, font.clone(), color);
        if columns.iter().any(|column| column.value.is_some()) {
            let corner = area.right_top() + egui::vec2(-4.0, 2.0);
            painter.text(corner, Align2::RIGHT_TOP, format!("{top:.2}"), font, color);
        }
    }

    fn paint_ticks(&self, painter: &Painter, area: Rect, scale: &Scale, visuals: &Visuals) {
        let visible = scale.visible();
        let part = visible.start as usize..visible.end as usize;
        let corrected = cut(self.states, &part).iter().zip(visible.clone());
        let corrected = corrected
            .filter(|(state, _)| **state == FrameState::Corrected)
            .map(|(_, frame)| frame);
        let marks = self.marks.iter().copied();
        let stroke = Stroke::new(2.0, visuals.strong_text_color());
        for frame in corrected.chain(marks.filter(|mark| visible.contains(mark))) {
            let x = scale.middle_of(frame);
            painter.vline(x, (area.bottom() - 2.0 * BAND)..=area.bottom(), stroke);
        }
    }

    /// The state and the value of a frame, in words.
    pub(super) fn describe(&self, frame: u64) -> String {
        let at = frame as usize;
        let state = self.states.get(at).copied().unwrap_or_default();
        let state = match state {
            FrameState::Unknown => "unknown",
            FrameState::Good => "good",
            FrameState::Corrected => "corrected",
            FrameState::Weak => "weak",
            FrameState::Lost => "lost",
        };
        match self.values.get(at).copied().flatten() {
            Some(value) => format!("{}: {state}, {value:.2}", self.label),
            None => format!("{}: {state}", self.label),
        }
    }
}

/// The part of a slice that a range has in common with it.
fn cut<'a, T>(slice: &'a [T], range: &Range<usize>) -> &'a [T] {
    let end = range.end.min(slice.len());
    &slice[range.start.min(end)..end]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_column_shows_the_worst_of_its_frames() {
        let mut states = vec![FrameState::Good; 100];
        states[37] = FrameState::Lost;
        states[61] = FrameState::Weak;
        let values: Vec<Option<f32>> = (0..90).map(|k| (k != 5).then_some(k as f32)).collect();
        let row = TimelineRow {
            label: "Error",
            states: &states,
            values: &values,
            marks: &[],
        };
        let columns = row.columns(&Scale::whole(0.0, 10.0, 100));
        assert_eq!(columns.len(), 10);
        let states: Vec<FrameState> = columns.iter().map(|column| column.state).collect();
        assert_eq!(states[3], FrameState::Lost);
        assert_eq!(states[6], FrameState::Weak);
        assert_eq!(states[7], FrameState::Good);
        assert_eq!((columns[2].value, columns[9].value), (Some(29.0), None));
        assert_eq!(row.columns(&Scale::whole(0.0, 500.0, 100)).len(), 100);
    }

    #[test]
    fn rows_shorter_than_the_clip_are_unknown_behind_their_end() {
        let row = TimelineRow {
            label: "Error",
            states: &[FrameState::Weak],
            values: &[Some(1.5), Some(f32::NAN)],
            marks: &[900],
        };
        let columns = row.columns(&Scale::whole(0.0, 10.0, 10));
        assert_eq!(columns[0].state, FrameState::Weak);
        assert_eq!(columns[1].value, None);
        assert_eq!(columns[9].state, FrameState::Unknown);
        assert_eq!(row.describe(0), "Error: weak, 1.50");
        assert_eq!(row.describe(u64::MAX), "Error: unknown");
    }
}

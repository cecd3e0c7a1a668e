//! The strip below the canvas: thumbnails, ruler, playhead, range and graphs of a clip.

mod rows;
mod scale;
mod strip;

use crate::clip::{ClipFacts, ClipReader, Player, SPEEDS};
use egui::{Button, DragValue, Key, Modifiers, Ui};
use std::ops::Range;
use std::time::Duration;

pub use rows::{FrameState, TimelineRow};
pub use scale::Scale;
use strip::{Strip, Textures};

/// Frames of a step with shift.
const LONG_STEP: u64 = 10;

/// The timeline of a clip: the frame that is shown, the range that is worked on, and playing.
#[derive(Default)]
pub struct Timeline {
    /// Number of the frame at the playhead.
    pub current: u64,
    /// Frames from the in point to before the out point. Empty for the whole clip.
    pub range: Range<u64>,
    /// Playing.
    pub player: Player,
    /// First frame and number of frames that are seen; `None` for all.
    view: Option<[f64; 2]>,
    strip: Strip,
    textures: Textures,
    /// The frame that the reader was asked for last.
    asked: Option<u64>,
}

/// Changes that the hand or the clock made in a frame of the window.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct TimelineAction {
    /// The frame at the playhead, if it is another one than before.
    pub moved: Option<u64>,
    /// True if the range is another one.
    pub range_changed: bool,
    /// True while the hand drags the playhead or an end of the range.
    pub is_dragging: bool,
}

impl Timeline {
    /// Draws the timeline, obeys mouse and keys, and asks the reader for the frame at the playhead.
    ///
    /// Keys, unless a text is typed: left and right for a step, with shift for ten, Home and End, P or K to play and pause, I and O
    /// for the in and the out point. The wheel zooms at the cursor and, sideways, scrolls.
    pub fn ui(
        &mut self,
        ui: &mut Ui,
        reader: &ClipReader,
        rows: &[TimelineRow<'_>],
    ) -> TimelineAction {
        let Some(facts) = reader.info() else {
            let failure = reader.failure();
            ui.label(failure.as_deref().unwrap_or("The clip is being opened"));
            return TimelineAction::default();
        };
        let now = ui.input(|input| input.time);
        let before = (self.current, self.range.clone());
        self.fit_to(facts.frames);
        self.advance(ui, &facts, now);
        let played = self.current;
        self.obey_keys(ui, &facts, now);
        self.controls_ui(ui, reader, &facts, now);
        let is_dragging = self.strip_ui(ui, reader, &facts, rows);
        self.fit_to(facts.frames);
        if self.current != played {
            self.player.move_to(now, self.current);
        }
        if self.asked != Some(self.current) {
            self.asked = Some(self.current);
            reader.request(self.current);
        }
        if let Some(failure) = reader.failure() {
            ui.colored_label(ui.visuals().error_fg_color, failure);
        }
        TimelineAction {
            moved: (self.current != before.0).then_some(self.current),
            range_changed: self.range != before.1,
            is_dragging,
        }
    }

    /// The range in a clip of `frames` frames: the whole clip if none is set.
    pub fn selection(&self, frames: u64) -> Range<u64> {
        let end = self.range.end.min(frames);
        if self.range.start >= end {
            return 0..frames;
        }
        self.range.start..end
    }

    /// Makes the frame at the playhead the first one of the range.
    pub fn set_in(&mut self, frames: u64) {
        let end = self.selection(frames).end;
        let start = self.current.min(frames.saturating_sub(1));
        self.set_range(start..if end > start { end } else { frames }, frames);
    }

    /// Makes the frame at the playhead the last one of the range.
    pub fn set_out(&mut self, frames: u64) {
        let start = self.selection(frames).start;
        let end = (self.current + 1).min(frames);
        self.set_range(if start < end { start } else { 0 }..end, frames);
    }

    fn set_range(&mut self, range: Range<u64>, frames: u64) {
        self.range = if range == (0..frames) { 0..0 } else { range };
    }

    /// Keeps the playhead in the clip, whose number of frames may be an estimate that changes.
    fn fit_to(&mut self, frames: u64) {
        self.current = self.current.min(frames.saturating_sub(1));
    }

    /// Moves the playhead to the frame that is due.
    fn advance(&mut self, ui: &Ui, facts: &ClipFacts, now: f64) {
        let range = self.selection(facts.frames);
        let Some(due) = self.player.due(now, facts.seconds_per_frame, &range) else {
            return;
        };
        self.current = due;
        if let Some(pause) = self.player.next_in(now, facts.seconds_per_frame) {
            let pause = Duration::from_secs_f64(pause.clamp(0.001, 1.0));
            ui.ctx().request_repaint_after(pause);
        }
    }

    fn toggle_playing(&mut self, now: f64) {
        if self.player.is_playing() {
            self.player.pause();
        } else {
            self.player.play(now, self.current);
        }
    }

    fn obey_keys(&mut self, ui: &Ui, facts: &ClipFacts, now: f64) {
        // a focused control has the keys for itself, the strip shares them with the window
        let focused = ui.memory(egui::Memory::focused);
        if focused.is_some_and(|focused| self.strip.id != Some(focused)) {
            return;
        }
        let frames = facts.frames;
        let (pressed, shift) = ui.input(|input| {
            let plain = input.modifiers.is_none();
            let shift = input.modifiers == Modifiers::SHIFT;
            let steps = |key: Key| input.num_presses(key) as u64;
            let step = match (plain, shift) {
                (true, _) => 1,
                (_, true) => LONG_STEP,
                _ => 0,
            };
            let keys = [Key::Home, Key::End, Key::I, Key::O, Key::P, Key::K];
            let pressed = keys.map(|key| plain && input.key_pressed(key));
            let moves = [steps(Key::ArrowLeft) * step, steps(Key::ArrowRight) * step];
            (pressed, moves)
        });
        let [left, right] = shift;
        if left + right > 0 {
            self.player.pause();
            self.current = self.current.saturating_sub(left);
            self.current = self.current.saturating_add(right).min(facts.last());
        }
        let [home, end, set_in, set_out, play, pause] = pressed;
        if home {
            self.current = 0;
        }
        if end {
            self.current = facts.last();
        }
        if set_in {
            self.set_in(frames);
        }
        if set_out {
            self.set_out(frames);
        }
        if play || pause {
            self.toggle_playing(now);
        }
    }

    fn controls_ui(&mut self, ui: &mut Ui, reader: &ClipReader, facts: &ClipFacts, now: f64) {
        ui.horizontal_wrapped(|ui| {
            let button = |ui: &mut Ui, text: &str, name: &str, hint: &str| {
                let button = ui.add(Button::new(text)).on_hover_text(hint);
                button.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Button, true, name));
                button.clicked()
            };
            let (label, hint) = if self.player.is_playing() {
                ("Pause", "Stop playing (P or K)")
            } else {
                ("Play", "Play the range (P or K)")
            };
            if button(ui, label, label, hint) {
                self.toggle_playing(now);
            }
            if button(ui, "|<", "First frame", "To the first frame (Home)") {
                self.current = 0;
            }
            if button(
                ui,
                "<",
                "Previous frame",
                "One frame back (left; with shift ten)",
            ) {
                self.player.pause();
                self.current = self.current.saturating_sub(1);
            }
            if button(
                ui,
                ">",
                "Next frame",
                "One frame on (right; with shift ten)",
            ) {
                self.player.pause();
                self.current = (self.current + 1).min(facts.last());
            }
            if button(ui, ">|", "Last frame", "To the last frame (End)") {
                self.current = facts.last();
            }
            let label = ui.label("Frame");
            ui.add(DragValue::new(&mut self.current).range(0..=facts.last()))
                .labelled_by(label.id)
                .on_hover_text("The frame that is shown, from 0");
            let about = if facts.is_exact { "" } else { "about " };
            let seconds = reader.seconds_at(self.current).unwrap_or_default();
            ui.label(format!("of {about}{}, {seconds:.3} s", facts.frames));
            ui.separator();
            self.speed_ui(ui, facts, now);
            ui.separator();
            self.range_ui(ui, facts, button);
        });
    }

    fn speed_ui(&mut self, ui: &mut Ui, facts: &ClipFacts, now: f64) {
        let label = ui.label("Speed");
        let mut speed = self.player.speed();
        let text = |speed: f64| format!("{speed} x");
        egui::ComboBox::from_id_salt("speed of the clip")
            .width(60.0)
            .selected_text(text(speed))
            .show_ui(ui, |ui| {
                for choice in SPEEDS {
                    ui.selectable_value(&mut speed, choice, text(choice));
                }
            })
            .response
            .labelled_by(label.id);
        if speed != self.player.speed() {
            self.player.set_speed(speed, now, facts.seconds_per_frame);
        }
        ui.checkbox(&mut self.player.loops, "Loop")
            .on_hover_text("Begin again at the end of the range");
    }

    fn range_ui(
        &mut self,
        ui: &mut Ui,
        facts: &ClipFacts,
        button: impl Fn(&mut Ui, &str, &str, &str) -> bool,
    ) {
        let frames = facts.frames;
        if button(ui, "In", "Set in", "Begin the range at this frame (I)") {
            self.set_in(frames);
        }
        if button(ui, "Out", "Set out", "End the range behind this frame (O)") {
            self.set_out(frames);
        }
        if self.range.is_empty() {
            return;
        }
        let Range { start, end } = self.selection(frames);
        let seconds = (end - start) as f64 * facts.seconds_per_frame;
        ui.label(format!(
            "{start} to {}: {} frames, {seconds:.3} s",
            end - 1,
            end - start
        ));
        if button(ui, "Clear", "Clear range", "Use the whole clip") {
            self.range = 0..0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(current: u64) -> Timeline {
        Timeline {
            current,
            ..Timeline::default()
        }
    }

    #[test]
    fn the_range_is_never_empty() {
        let mut timeline = at(30);
        assert_eq!(timeline.selection(100), 0..100);
        timeline.set_in(100);
        assert_eq!(timeline.selection(100), 30..100);
        timeline.current = 50;
        timeline.set_out(100);
        assert_eq!(timeline.selection(100), 30..51);
        // an end before the start moves the other one away
        timeline.current = 10;
        timeline.set_out(100);
        assert_eq!(timeline.selection(100), 0..11);
        timeline.current = 60;
        timeline.set_in(100);
        assert_eq!(timeline.selection(100), 60..100);
        timeline.current = 0;
        timeline.set_in(100);
        assert!(timeline.range.is_empty());
    }

    #[test]
    fn a_range_beyond_a_clip_that_is_shorter_than_estimated_is_cut() {
        let mut timeline = at(90);
        timeline.set_in(100);
        timeline.fit_to(95);
        assert_eq!(timeline.selection(95), 90..95);
        timeline.fit_to(40);
        assert_eq!(timeline.current, 39);
        assert_eq!(timeline.selection(40), 0..40);
        assert_eq!(timeline.selection(0), 0..0);
    }
}

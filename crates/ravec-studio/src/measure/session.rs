//! A session: the steps of a script become events, and the frames become figures.

use super::figures::Record;
use super::script::{Script, Step, Way};
use super::watch::{Fate, Watch};
use crate::controls::{Control, Controls};
use crate::engine::lock;
use crate::studio::{Counts, Studio};
use egui::{
    ColorImage, Context, Event, Key, Modifiers, MouseWheelSource, MouseWheelUnit, PointerButton,
    Pos2, Rect, TouchPhase, pos2, vec2,
};
use ravec::raster::{AnyImage, Image, Size, Srgb};
use ravec_media::{Picture, WriteOptions};
use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// Time between the events of a click or of a word.
const PAUSE: Duration = Duration::from_millis(20);
/// Time after which a field that was clicked takes keys, in a window whose frames take long.
const FOCUS: Duration = Duration::from_millis(300);
/// Time between two notches of the wheel.
const NOTCH: Duration = Duration::from_millis(60);
/// Frames in which nothing goes on after which a step has ended.
const QUIET_FRAMES: u32 = 4;
/// Quality of pictures of the window as JPEG: letters stay clear, and a picture has about 100 kB.
const PICTURE_QUALITY: u8 = 85;
/// Longest time of a step after its last event.
const PATIENCE: Duration = Duration::from_mins(5);

/// State between two frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    /// Events are played.
    Plays,
    /// Waits until nothing goes on; the number of quiet frames, and the moment of the first.
    Settles(u32, Option<Instant>),
    /// The next frame says the names of the controls.
    Names,
    /// A picture of the window is taken.
    Pictures,
    /// All steps are done.
    Ended,
}

/// An event that is due.
struct Due {
    at: Instant,
    event: Event,
}

/// An event whose picture is waited for.
#[derive(Debug, Clone, Copy)]
struct Followed {
    record: usize,
    due: Instant,
}

/// A studio under a hand that plays a script.
pub(super) struct Session {
    pub studio: Studio,
    controls: Controls,
    steps: VecDeque<Step>,
    done: usize,
    state: State,
    queue: VecDeque<Due>,
    /// The figures that the running step belongs to.
    record: Option<usize>,
    records: Vec<Record>,
    watch: Watch<Followed>,
    /// The state before the frame that is going on.
    before: Counts,
    last_event: Instant,
    pub size: [usize; 2],
    /// Folder of the pictures; `None` where none can be taken.
    pictures: Option<PathBuf>,
    /// Name of the picture that is taken.
    picture: String,
    /// The picture that was taken.
    taken: Arc<Mutex<Option<Arc<ColorImage>>>>,
}

impl Session {
    /// Pictures of the window are written into the folder `pictures`.
    pub fn new(
        context: &Context,
        studio: Studio,
        script: &Script,
        pictures: Option<PathBuf>,
    ) -> Self {
        let controls = Controls::watch(context, None);
        // names cost time in each frame, and are read between the steps only
        context.disable_accesskit();
        Self {
            studio,
            controls,
            steps: script.unrolled().into_iter().cloned().collect(),
            done: 0,
            state: State::Settles(0, None),
            queue: VecDeque::new(),
            record: None,
            records: Vec::new(),
            watch: Watch::new(),
            before: Counts::default(),
            last_event: Instant::now(),
            size: [0, 0],
            pictures,
            picture: String::new(),
            taken: Arc::default(),
        }
    }

    pub fn has_ended(&self) -> bool {
        self.state == State::Ended
    }

    pub fn into_records(self) -> Vec<Record> {
        self.records
    }

    /// The moment at which a frame is wanted at the latest.
    pub fn next_frame(&self, now: Instant) -> Instant {
        match self.state {
            _ if self.watch.wants_frame() => now,
            State::Plays => self.queue.front().map_or(now, |due| due.at),
            State::Settles(..) => now + Duration::from_millis(3),
            State::Names | State::Pictures | State::Ended => now,
        }
    }

    /// The events of the frame that begins.
    pub fn begin_frame(&mut self, context: &Context) -> Vec<Event> {
        let now = Instant::now();
        if self.state == State::Names {
            context.enable_accesskit();
        }
        let mut events = Vec::new();
        while let Some(due) = self.queue.front()
            && due.at <= now
        {
            let Some(Due { at, event }) = self.queue.pop_front() else {
                break;
            };
            // what only holds a key is no event of its own
            if let Some(record) = self.record
                && !matches!(event, Event::ModifiersChanged(_))
            {
                let chooses = matches!(event, Event::MouseWheel { .. } | Event::Key { .. });
                self.watch.follow(Followed { record, due: at }, chooses);
            }
            self.last_event = at;
            events.push(event);
        }
        self.before = self.studio.counts();
        events
    }

    /// Takes the end of a frame, which is shown at this moment.
    ///
    /// # Errors
    /// One sentence if the script cannot go on.
    pub fn end_frame(&mut self, context: &Context, shown: Instant) -> Result<(), String> {
        let after = self.studio.counts();
        if let Some(record) = self.record {
            let mut tiles = after.tiles.iter().filter(|seen| seen.slot == 0).peekable();
            let is_blank = tiles.peek().is_some() && tiles.all(|seen| seen.drawn.is_none());
            self.records[record].frames += 1;
            self.records[record].blank_frames += usize::from(is_blank);
        }
        for (followed, fate) in self.watch.end_frame(&self.before, after) {
            let record = &mut self.records[followed.record];
            match fate {
                Fate::Shown => record
                    .times
                    .push(shown.saturating_duration_since(followed.due)),
                Fate::WithoutEffect => record.without_effect += 1,
            }
        }
        match self.state {
            State::Plays if self.queue.is_empty() => self.state = State::Settles(0, None),
            State::Pictures => self.take_picture()?,
            State::Plays | State::Ended => {}
            State::Settles(quiet, since) => self.settle(quiet, since, shown)?,
            State::Names => {
                context.disable_accesskit();
                self.begin_step(context)?;
            }
        }
        Ok(())
    }

    /// Takes the time of the window's thread in a frame.
    pub fn frame_took(&mut self, time: Duration) {
        if let Some(record) = self.record {
            let longest = &mut self.records[record].longest_frame;
            *longest = (*longest).max(time);
        }
    }

    fn settle(&mut self, quiet: u32, since: Option<Instant>, now: Instant) -> Result<(), String> {
        if self.studio.is_busy() {
            if now.saturating_duration_since(self.last_event) > PATIENCE {
                let seconds = PATIENCE.as_secs();
                return Err(format!(
                    "step {} has not ended after {seconds} seconds",
                    self.done
                ));
            }
            self.state = State::Settles(0, None);
            return Ok(());
        }
        let since = since.unwrap_or(now);
        if quiet < QUIET_FRAMES {
            self.state = State::Settles(quiet + 1, Some(since));
            return Ok(());
        }
        for followed in self.watch.forget() {
            self.records[followed.record].without_picture += 1;
        }
        if let Some(record) = self.record.take() {
            let settled = &mut self.records[record].settled;
            *settled = (*settled).max(since.saturating_duration_since(self.last_event));
        }
        let failure = self.studio.snapshot().and_then(|snapshot| snapshot.failure);
        if let Some(failure) = failure {
            return Err(format!("step {}: {}", self.done, failure.message));
        }
        if let Some((message, true)) = self.studio.message() {
            return Err(format!("step {}: {message}", self.done));
        }
        if self.done == 0 {
            let snapshot = self.studio.snapshot();
            self.size = snapshot
                .and_then(|snapshot| snapshot.size())
                .unwrap_or_default();
        }
        self.state = if self.steps.is_empty() {
            State::Ended
        } else {
            State::Names
        };
        Ok(())
    }

    /// Writes the picture of the window, once it is taken.
    fn take_picture(&mut self) -> Result<(), String> {
        let taken = lock(&self.taken).take();
        if let (Some(image), Some(folder)) = (taken, &self.pictures) {
            write_picture(&image, &folder.join(format!("{}.jpg", self.picture)))?;
            self.state = State::Settles(0, None);
        }
        Ok(())
    }

    fn begin_step(&mut self, context: &Context) -> Result<(), String> {
        let Some(step) = self.steps.pop_front() else {
            self.state = State::Ended;
            return Ok(());
        };
        self.done += 1;
        self.record = step.measure().map(|name| {
            let known = self.records.iter().position(|record| record.name == name);
            known.unwrap_or_else(|| {
                self.records.push(Record {
                    name: name.to_owned(),
                    ..Record::default()
                });
                self.records.len() - 1
            })
        });
        if let Step::Picture { name } = &step {
            if self.pictures.is_none() {
                return Err(format!(
                    "step {}: pictures are taken in a window, with a folder for them",
                    self.done
                ));
            }
            self.picture.clone_from(name);
            self.state = State::Pictures;
            let taken = self.taken.clone();
            context.request_screenshot(move |image| *lock(&taken) = Some(image));
            return Ok(());
        }
        let events = self
            .events(&step)
            .map_err(|reason| format!("step {}: {reason}", self.done))?;
        let mut at = Instant::now();
        self.queue = events
            .into_iter()
            .map(|(pause, event)| {
                at += pause;
                Due { at, event }
            })
            .collect();
        self.state = State::Plays;
        Ok(())
    }

    /// The events of a step, each with the time since the one before.
    fn events(&self, step: &Step) -> Result<Vec<(Duration, Event)>, String> {
        Ok(match step {
            Step::Click { control, at, .. } => click(self.place(control.as_deref(), *at)?),
            Step::Press { key, ctrl, .. } => {
                let key = Key::from_name(key).ok_or("the key is not known")?;
                let modifiers = if *ctrl {
                    Modifiers::COMMAND | Modifiers::CTRL
                } else {
                    Modifiers::NONE
                };
                with_modifiers(modifiers, press(key, modifiers))
            }
            Step::Set { control, text, .. } => {
                let field = match self.controls.find_number(control) {
                    Some(field) => field,
                    None => self.control(control)?,
                };
                let mut events = click(field.rect().center());
                let all = Modifiers::COMMAND | Modifiers::CTRL;
                let mut selects = with_modifiers(all, press(Key::A, all));
                selects[0].0 = FOCUS;
                events.extend(selects);
                events.push((PAUSE, Event::Text(text.clone())));
                events.extend(press(Key::Enter, Modifiers::NONE));
                events
            }
            Step::Drag(way) => {
                let places = self.way(way)?;
                let (first, last) = (places[0], places[places.len() - 1]);
                let mut events = vec![
                    (Duration::ZERO, Event::PointerMoved(first)),
                    (PAUSE, button(first, true)),
                ];
                events.extend(motions(&places[1..], way.rate_hz));
                events.push((PAUSE, button(last, false)));
                events
            }
            Step::Move(way) => motions(&self.way(way)?, way.rate_hz),
            Step::Turn {
                control,
                at,
                notches,
                shift,
                ..
            } => {
                let at = self.place(control.as_deref(), *at)?;
                let modifiers = if *shift {
                    Modifiers::SHIFT
                } else {
                    Modifiers::NONE
                };
                let notch = Event::MouseWheel {
                    unit: MouseWheelUnit::Line,
                    delta: vec2(0.0, notches.signum() as f32),
                    phase: TouchPhase::Move,
                    source: MouseWheelSource::Wheel,
                    modifiers,
                };
                let turns = (0..notches.unsigned_abs()).map(|_| (NOTCH, notch.clone()));
                let mut events = vec![(Duration::ZERO, Event::PointerMoved(at))];
                events.extend(with_modifiers(modifiers, turns.collect()));
                events
            }
            Step::Picture { .. } | Step::Repeat { .. } => Vec::new(),
        })
    }

    fn control(&self, name: &str) -> Result<Control, String> {
        let found = self.controls.find(name);
        let found = found.ok_or_else(|| format!("there is no control {name:?}"))?;
        if found.enabled {
            Ok(found)
        } else {
            Err(format!("the control {name:?} cannot be used now"))
        }
    }

    /// The rectangle of a control, or of the picture.
    fn area(&self, control: Option<&str>) -> Result<Rect, String> {
        match control {
            Some(name) => Ok(self.control(name)?.rect()),
            None => self
                .studio
                .picture_place()
                .ok_or_else(|| "no picture is shown".to_owned()),
        }
    }

    /// The position of fractions.
    fn place(&self, control: Option<&str>, at: [f64; 2]) -> Result<Pos2, String> {
        Ok(inside(self.area(control)?, at))
    }

    /// The positions along a way, the first corner and then those of the motions.
    fn way(&self, way: &Way) -> Result<Vec<Pos2>, String> {
        let area = self.area(way.control.as_deref())?;
        let corners: Vec<Pos2> = way.points.iter().map(|at| inside(area, *at)).collect();
        let pieces = corners.len() - 1;
        let at = |share: f32| {
            let along = share * pieces as f32;
            let piece = (along as usize).min(pieces.saturating_sub(1));
            let end = corners[(piece + 1).min(pieces)];
            corners[piece].lerp(end, along - piece as f32)
        };
        let moves = way.moves as f32;
        Ok((0..=way.moves).map(|k| at(k as f32 / moves)).collect())
    }
}

/// Writes a picture of the window.
fn write_picture(image: &ColorImage, path: &Path) -> Result<(), String> {
    let [width, height] = image.size;
    let size = Size::new(width, height).map_err(|error| error.to_string())?;
    let pixels: Image<Srgb<u8>> = Image::from_fn(size, |col, row| {
        let color = image.pixels[row * width + col];
        Srgb([color.r(), color.g(), color.b()])
    });
    let picture = Picture::from_image(AnyImage::from(pixels));
    let options = WriteOptions {
        quality: PICTURE_QUALITY,
        ..WriteOptions::default()
    };
    ravec_media::write(path, &picture, &options).map_err(|error| error.to_string())?;
    Ok(())
}

fn inside(area: Rect, [x, y]: [f64; 2]) -> Pos2 {
    pos2(
        area.left() + x as f32 * area.width(),
        area.top() + y as f32 * area.height(),
    )
}

fn button(at: Pos2, pressed: bool) -> Event {
    Event::PointerButton {
        pos: at,
        button: PointerButton::Primary,
        pressed,
        modifiers: Modifiers::NONE,
    }
}

fn click(at: Pos2) -> Vec<(Duration, Event)> {
    vec![
        (Duration::ZERO, Event::PointerMoved(at)),
        (PAUSE, button(at, true)),
        (PAUSE, button(at, false)),
    ]
}

fn motions(places: &[Pos2], rate_hz: f64) -> Vec<(Duration, Event)> {
    let pause = Duration::from_secs_f64(1.0 / rate_hz);
    places
        .iter()
        .map(|&at| (pause, Event::PointerMoved(at)))
        .collect()
}

fn press(key: Key, modifiers: Modifiers) -> Vec<(Duration, Event)> {
    let event = |pressed| Event::Key {
        key,
        physical_key: None,
        pressed,
        repeat: false,
        modifiers,
    };
    vec![(PAUSE, event(true)), (PAUSE, event(false))]
}

/// Events while keys are held.
fn with_modifiers(modifiers: Modifiers, events: Vec<(Duration, Event)>) -> Vec<(Duration, Event)> {
    if modifiers.is_none() {
        return events;
    }
    let change = |modifiers| (PAUSE, Event::ModifiersChanged(modifiers));
    let mut held = vec![change(modifiers)];
    held.extend(events);
    held.push(change(Modifiers::NONE));
    held
}

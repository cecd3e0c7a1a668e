//! Frames of a clip, read beside the window.

use super::facts::ClipFacts;
use super::preview;
use super::proxies;
use super::state::{ReadFrame, Shared};
use super::thumbnails::{self, Thumbnails};
use crate::shown::Shown;
use ravec::progress::Progress;
use ravec_jobs::Context;
use ravec_jobs::video::FramePlace;
use ravec_media::Picture;
use ravec_video::{Clip, Frame, OpenOptions, RandomAccess, VideoError, VideoLimits};
use std::path::Path;
use std::sync::{Arc, PoisonError};

/// Bytes of the frames that are kept as they were read. With those that are ready for the screen they are 512 MiB.
const CACHE_BYTES: u64 = 384 << 20;

/// Frames that a step back reads at once, where going back starts at a key frame.
const FRAMES_BACK: u64 = 32;

/// Frames that are read ahead of a step forward while nothing is asked for.
const FRAMES_AHEAD: u64 = 4;

/// Frames of a clip, read by threads beside the window.
///
/// The request that was made last wins; the last good frame stays until it is there. No call waits for a file or a thread.
///
/// Guarantees: a frame that is shown is the one that reading from the start gives under its number, whatever was asked for before;
/// frames behind a damage are shown if they can be reached by seeking.
/// At most 512 MiB of frames are kept, and the last one whatever its size; and small copies of all frames in at most 256 MiB. A clip that is damaged, changes or vanishes gives a
/// sentence. Does not guarantee a time: a frame of H.264 is decoded from the key frame before it.
pub struct ClipReader {
    shared: Arc<Shared>,
}

impl ClipReader {
    /// Opens a clip soon: a file, a folder of pictures, or a pattern such as `frame_%04d.png`. `repaint` is called, from other
    /// threads, when there is something new.
    pub fn open(path: &Path, repaint: Arc<dyn Fn() + Send + Sync>) -> Self {
        let shared = Arc::new(Shared::new(path.to_path_buf(), repaint));
        let own = shared.clone();
        let worker = std::thread::Builder::new().name("clip frames".to_owned());
        if let Err(error) = worker.spawn(move || work(&own)) {
            let mut state = shared.state();
            state.ended = true;
            state.failure = Some(format!("no thread reads the clip: {error}"));
        }
        spawn(&shared, "clip thumbnails", thumbnails::work);
        spawn(&shared, "clip previews", preview::work);
        spawn(&shared, "clip proxies", proxies::work);
        Self { shared }
    }

    /// Properties of the clip; `None` until it is open.
    pub fn info(&self) -> Option<ClipFacts> {
        self.shared.state().facts.clone()
    }

    /// One sentence if the clip cannot be opened, or the frame that was asked for last cannot be read.
    pub fn failure(&self) -> Option<String> {
        self.shared.state().failure.clone()
    }

    /// Asks for a frame, in place of all earlier requests that are not done.
    pub fn request(&self, frame: u64) {
        self.shared.change(|state| {
            state.asked = Some(frame);
            state.counts[0] += 1;
            if !state.ended {
                state.wanted = Some(frame);
            }
        });
    }

    /// Number of the last request, and of the last one whose frame was read or whose small copy is shown.
    pub(crate) fn counts(&self) -> [u64; 2] {
        self.shared.state().counts
    }

    /// The last frame that was read: its number, as a screen shows it, and the picture.
    pub fn shown(&self) -> Option<(u64, Arc<Shown>, Arc<Picture>)> {
        let state = self.shared.state();
        let frame = state.shown.as_ref()?;
        Some((frame.number, frame.shown.clone(), frame.picture.clone()))
    }

    /// The last frame that was read: its place in the clip, and the picture.
    pub(crate) fn frame(&self) -> Option<(FramePlace, Arc<Picture>)> {
        let state = self.shared.state();
        let (frame, facts) = (state.shown.as_ref()?, state.facts.as_ref()?);
        let place = FramePlace {
            number: frame.number,
            seconds: frame.seconds,
            interval: facts.seconds_per_frame,
        };
        Some((place, frame.picture.clone()))
    }

    /// Number and picture of the frame to show: the last frame that was read or, until the requested one is, a nearer one, which may be
    /// an enlarged thumbnail, or an enlarged small copy of the frame itself.
    pub fn visible(&self) -> Option<(u64, Arc<Shown>)> {
        let state = self.shared.state();
        if let Some((number, shown)) = &state.preview {
            return Some((*number, shown.clone()));
        }
        let frame = state.shown.as_ref()?;
        Some((frame.number, frame.shown.clone()))
    }

    /// The time of a frame in seconds: by its time stamp if it is the last one that was read, else by the mean rate.
    pub fn seconds_at(&self, frame: u64) -> Option<f64> {
        let state = self.shared.state();
        let read = state.shown.as_ref();
        read.filter(|shown| shown.number == frame)
            .map(|shown| shown.seconds)
            .or_else(|| Some(state.facts.as_ref()?.seconds_at(frame)))
    }

    /// True while the clip is opened or a frame is read.
    pub fn is_busy(&self) -> bool {
        self.shared.state().is_busy()
    }

    /// The thumbnails so far, for `count` places evenly spaced over the clip. They are made again if `count` changes by more than a
    /// quarter; until then the old ones stay.
    pub fn thumbnails(&self, count: usize) -> Thumbnails {
        if self.shared.state().thumbnails.asks_for_other(count) {
            self.shared.change(|state| state.thumbnails.ask(count));
        }
        self.shared.state().thumbnails.made.clone()
    }

    /// Waits until nothing is asked for or going on: for tests and measurements.
    pub fn wait(&self) {
        let mut state = self.shared.state();
        while state.is_busy() {
            let woken = self.shared.wake.wait(state);
            state = woken.unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// Waits until the small copies of all frames are made: for tests and measurements.
    pub fn wait_for_proxies(&self) {
        let mut state = self.shared.state();
        while !state.ended && !state.proxies.ended {
            let woken = self.shared.wake.wait(state);
            state = woken.unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// Waits until the frames are counted and the thumbnails made: for tests and measurements.
    pub fn wait_for_thumbnails(&self) {
        let mut state = self.shared.state();
        while !state.ended && !state.thumbnails.is_done() {
            let woken = self.shared.wake.wait(state);
            state = woken.unwrap_or_else(PoisonError::into_inner);
        }
    }
}

impl Drop for ClipReader {
    fn drop(&mut self) {
        // the threads end by themselves: the window does not wait for a frame that is being decoded
        self.shared.change(|state| state.quits = true);
    }
}

/// Starts a thread without which frames are still read.
fn spawn(shared: &Arc<Shared>, name: &str, work: fn(&Shared)) {
    let own = shared.clone();
    let thread = std::thread::Builder::new().name(name.to_owned());
    if thread.spawn(move || work(&own)).is_err() {
        shared.change(|state| {
            state.thumbnails.ended = true;
            state.proxies.ended = true;
        });
    }
}

/// Opens the clip for one thread.
pub(super) fn open(path: &Path) -> Result<Clip, String> {
    if ravec_files::is_stream(path) {
        return Err(
            "a clip from standard input cannot be shown: write it to a file first".to_owned(),
        );
    }
    let context = Context::new(&Progress::none());
    let options = OpenOptions {
        rate: None,
        limits: VideoLimits {
            pictures: context.limits.clone(),
            max_frames: context.max_frames,
        },
    };
    Clip::open(path, &options).map_err(|error| sentence(path, &error))
}

fn sentence(path: &Path, error: &VideoError) -> String {
    format!("cannot read {}: {error}", path.display())
}

/// Ends the reader with its worker, however that ends.
struct End<'a>(&'a Shared);

impl Drop for End<'_> {
    fn drop(&mut self) {
        self.0.show(|state| {
            state.ended = true;
            state.wanted = None;
            state.running = None;
            if std::thread::panicking() {
                state.failure = Some(
                    "the reading of the clip was interrupted by an error of the program".to_owned(),
                );
            }
        });
    }
}

/// Reads frames until the reader is dropped.
fn work(shared: &Shared) {
    let _end = End(shared);
    let clip = match open(&shared.path) {
        Ok(clip) => clip,
        Err(failure) => {
            shared.state().failure = Some(failure);
            return;
        }
    };
    let facts = ClipFacts::of(&clip);
    let mut frames = Frames {
        shared,
        seeks_fast: facts.seeks_fast,
        seconds_per_tick: facts.time_base.to_f64(),
        access: RandomAccess::new(clip, CACHE_BYTES),
        origin: None,
        last: None,
    };
    shared.show(|state| state.facts = Some(facts));
    while let Some((number, request)) = shared.wait_for(|state| {
        let number = state.wanted.take()?;
        state.running = Some(number);
        Some((number, state.counts[0]))
    }) {
        let read = frames.read(number);
        shared.show(|state| {
            state.running = None;
            match read {
                Ok(frame) => {
                    state.publish(frame);
                    state.counts[1] = request;
                }
                Err(None) => {}
                Err(Some(failure)) => state.failure = Some(failure),
            }
        });
        frames.read_ahead(number);
        frames.last = Some(number);
    }
}

/// The frames of a clip, as the worker reads them.
struct Frames<'a> {
    shared: &'a Shared,
    access: RandomAccess<Clip>,
    seeks_fast: bool,
    seconds_per_tick: f64,
    /// Stamp of the first frame, once it is read.
    origin: Option<i64>,
    /// The request before.
    last: Option<u64>,
}

impl Frames<'_> {
    /// A frame, ready for the screen; no failure if a later request is in its place.
    fn read(&mut self, number: u64) -> Result<ReadFrame, Option<String>> {
        if let Some(frame) = self.shared.state().take_ready(number) {
            return Ok(frame);
        }
        let Some(frame) = self.find(number)? else {
            return Err(Some(self.missing(number)));
        };
        let origin = self.origin(number, &frame);
        let picture = Picture::from_image(frame.picture.to_image().into_owned());
        let picture = Arc::new(picture);
        let ready = ReadFrame {
            number,
            shown: Arc::new(Shown::new(picture.clone())),
            picture,
            seconds: frame.time.start.saturating_sub(origin) as f64 * self.seconds_per_tick,
        };
        self.shared.state().add_ready(ready.clone());
        Ok(ready)
    }

    /// The stamp of the first frame; that of this frame if the first one cannot be read.
    fn origin(&mut self, number: u64, frame: &Frame) -> i64 {
        if let Some(origin) = self.origin {
            return origin;
        }
        // mostly the first frame is the one that is asked for first
        let first = match number {
            0 => None,
            _ => self.access.frame(0).ok().flatten(),
        };
        let origin = first.map_or(frame.time.start, |first| first.time.start);
        self.origin = Some(origin);
        origin
    }

    fn find(&mut self, number: u64) -> Result<Option<Arc<Frame>>, Option<String>> {
        let path = &self.shared.path;
        let failed = |error: VideoError| Some(sentence(path, &error));
        let steps_back = self
            .last
            .is_some_and(|last| number < last && last - number <= FRAMES_BACK);
        if steps_back && !self.seeks_fast && !self.access.is_cached(number) {
            // decoding starts at a key frame far before: the frames of the next steps come with it
            let pixels = self.access.info().size.pixels() as u64;
            let fit = (CACHE_BYTES / 2 / (4 * pixels)).clamp(1, FRAMES_BACK);
            for before in (number + 1).saturating_sub(fit)..number {
                self.access.frame(before).map_err(failed)?;
                let wanted = self.shared.state().wanted;
                if wanted.is_some_and(|wanted| wanted > number || wanted < before) {
                    return Err(None);
                }
            }
        }
        let found = self.access.frame(number).map_err(failed)?;
        if found.is_none() && self.access.damage().is_some() {
            // the damage may be of a frame on the way: now the source goes there directly
            return self.access.frame(number).map_err(failed);
        }
        Ok(found)
    }

    /// The reason why there is no frame of a number.
    fn missing(&self, number: u64) -> String {
        let path = self.shared.path.display();
        match self.access.damage() {
            Some(damage) => format!("cannot read frame {number} of {path}: {}", damage.reason),
            None => format!("{path} has no frame {number}: it ends before"),
        }
    }

    /// Reads the frames behind a step forward while nothing is asked for.
    fn read_ahead(&mut self, number: u64) {
        let forward = self
            .last
            .is_some_and(|last| number > last && number - last <= RandomAccess::<Clip>::SKIP);
        if !forward {
            return;
        }
        for next in number + 1..=number.saturating_add(FRAMES_AHEAD) {
            let state = self.shared.state();
            let beyond = state
                .facts
                .as_ref()
                .is_none_or(|facts| next >= facts.frames);
            if beyond || state.quits || state.wanted.is_some() {
                return;
            }
            drop(state);
            // an error comes again when the frame is asked for
            if !matches!(self.access.frame(next), Ok(Some(_))) {
                return;
            }
        }
    }
}

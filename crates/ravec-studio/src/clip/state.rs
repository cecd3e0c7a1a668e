//! State that the threads of a reader share with the window.

use super::facts::ClipFacts;
use super::proxies::ProxyState;
use super::thumbnails::ThumbnailState;
use crate::shown::Shown;
use ravec::raster::with_image;
use ravec_media::Picture;
use std::collections::VecDeque;
use std::path::PathBuf;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

/// Bytes of frames that are ready for the screen.
const READY_BYTES: usize = 128 << 20;

/// A frame that was read.
#[derive(Debug, Clone)]
pub(super) struct ReadFrame {
    pub number: u64,
    pub shown: Arc<Shown>,
    pub picture: Arc<Picture>,
    /// Seconds from the first frame.
    pub seconds: f64,
}

impl ReadFrame {
    fn bytes(&self) -> usize {
        let picture =
            with_image!(&self.picture.image, image => std::mem::size_of_val(image.pixels()));
        picture + self.shown.bytes()
    }
}

#[derive(Default)]
pub(super) struct State {
    pub facts: Option<ClipFacts>,
    pub failure: Option<String>,
    /// The request that the worker takes next.
    pub wanted: Option<u64>,
    pub running: Option<u64>,
    /// The last request.
    pub asked: Option<u64>,
    /// Number of the last request, and of the last one whose frame was read or whose small copy is shown.
    pub counts: [u64; 2],
    /// The last frame that was read.
    pub shown: Option<ReadFrame>,
    /// A frame near the last request, until that one is there.
    pub preview: Option<(u64, Arc<Shown>)>,
    /// Frames that are ready, the last one that was used first.
    ready: VecDeque<ReadFrame>,
    ready_bytes: usize,
    pub thumbnails: ThumbnailState,
    /// Small copies of all frames.
    pub proxies: ProxyState,
    /// True once the worker has ended: nothing will be read.
    pub ended: bool,
    pub quits: bool,
}

impl State {
    /// True while a frame is read or the clip is opened.
    pub fn is_busy(&self) -> bool {
        !self.ended && (self.facts.is_none() || self.wanted.is_some() || self.running.is_some())
    }

    /// A frame that is ready, which becomes the last one that was used.
    pub fn take_ready(&mut self, number: u64) -> Option<ReadFrame> {
        let at = self.ready.iter().position(|frame| frame.number == number)?;
        let frame = self.ready.remove(at)?;
        self.ready.push_front(frame.clone());
        Some(frame)
    }

    /// Frames that are ready.
    pub fn ready(&self) -> impl Iterator<Item = &ReadFrame> {
        self.ready.iter()
    }

    pub fn add_ready(&mut self, frame: ReadFrame) {
        self.ready_bytes += frame.bytes();
        self.ready.push_front(frame);
        while self.ready_bytes > READY_BYTES && self.ready.len() > 1 {
            if let Some(oldest) = self.ready.pop_back() {
                self.ready_bytes -= oldest.bytes();
            }
        }
    }

    /// Shows a frame that was read.
    pub fn publish(&mut self, frame: ReadFrame) {
        let asked = self.asked.unwrap_or(frame.number);
        let distance = frame.number.abs_diff(asked);
        if let Some((number, _)) = self.preview
            && (distance == 0 || distance <= number.abs_diff(asked))
        {
            self.preview = None;
        }
        self.shown = Some(frame);
        self.failure = None;
    }
}

pub(super) struct Shared {
    pub path: PathBuf,
    state: Mutex<State>,
    pub wake: Condvar,
    /// Called when there is something new to show.
    pub repaint: Arc<dyn Fn() + Send + Sync>,
}

impl Shared {
    pub fn new(path: PathBuf, repaint: Arc<dyn Fn() + Send + Sync>) -> Self {
        Self {
            path,
            state: Mutex::default(),
            wake: Condvar::new(),
            repaint,
        }
    }

    pub fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Changes the state, and wakes who waits for it.
    pub fn change<T>(&self, change: impl FnOnce(&mut State) -> T) -> T {
        let changed = change(&mut self.state());
        self.wake.notify_all();
        changed
    }

    /// As [`change`](Self::change), and draws the window again.
    pub fn show<T>(&self, change: impl FnOnce(&mut State) -> T) -> T {
        let changed = self.change(change);
        (self.repaint)();
        changed
    }

    /// Waits until `take` finds something; `None` once the reader is dropped or its worker has ended.
    pub fn wait_for<T>(&self, mut take: impl FnMut(&mut State) -> Option<T>) -> Option<T> {
        let mut state = self.state();
        loop {
            if state.quits || state.ended {
                return None;
            }
            if let Some(found) = take(&mut state) {
                return Some(found);
            }
            let woken = self.wake.wait(state);
            state = woken.unwrap_or_else(PoisonError::into_inner);
        }
    }
}

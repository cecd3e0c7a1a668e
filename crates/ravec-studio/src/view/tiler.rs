//! Tiles of pictures, made beside the window and brought to the screen as they are seen.

use crate::shown::{Shown, TileIndex};
use egui::{Color32, ColorImage, TextureHandle, TextureOptions};
use std::collections::HashMap;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

/// Tiles that are uploaded in one frame: more would be felt.
const UPLOADS: usize = 8;

/// Tiles that are kept on the screen's side.
const KEPT: usize = 512;

/// A state of a tile.
type Key = (u64, TileIndex);

struct Kept {
    texture: TextureHandle,
    used: u64,
}

#[derive(Default)]
struct Queue {
    wanted: Vec<(Key, Arc<Shown>)>,
    quits: bool,
}

#[derive(Default)]
struct Shared {
    queue: Mutex<Queue>,
    wake: Condvar,
}

impl Shared {
    fn queue(&self) -> MutexGuard<'_, Queue> {
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The tiles of a canvas.
pub(super) struct Tiler {
    shared: Arc<Shared>,
    made: Receiver<(Key, ColorImage)>,
    sender: Sender<(Key, ColorImage)>,
    started: bool,
    textures: HashMap<Key, Kept>,
    clock: u64,
    /// Tiles that are seen and not there yet.
    missing: Vec<(Key, Arc<Shown>)>,
}

impl Default for Tiler {
    fn default() -> Self {
        let (sender, made) = channel();
        Self {
            shared: Arc::default(),
            made,
            sender,
            started: false,
            textures: HashMap::new(),
            clock: 0,
            missing: Vec::new(),
        }
    }
}

impl Tiler {
    /// Takes tiles that are made. Begins a frame.
    pub fn begin(&mut self, context: &egui::Context) {
        self.clock += 1;
        self.missing.clear();
        let options = TextureOptions {
            magnification: egui::TextureFilter::Nearest,
            ..TextureOptions::LINEAR
        };
        let mut uploads = 0;
        while uploads < UPLOADS
            && let Ok((key, image)) = self.made.try_recv()
        {
            uploads += 1;
            let texture = context.load_texture(format!("{key:?}"), image, options);
            let used = self.clock;
            self.textures.insert(key, Kept { texture, used });
        }
        if uploads == UPLOADS {
            context.request_repaint();
        }
    }

    /// The texture of a tile; one that is missing is made soon.
    pub fn texture(&mut self, shown: &Arc<Shown>, tile: TileIndex) -> Option<egui::TextureId> {
        let key = (shown.stamp(tile), tile);
        let id = self.known(key);
        if id.is_none() {
            self.missing.push((key, shown.clone()));
        }
        id
    }

    /// The texture of a state of a tile, if it is there.
    pub fn known(&mut self, key: (u64, TileIndex)) -> Option<egui::TextureId> {
        let kept = self.textures.get_mut(&key)?;
        kept.used = self.clock;
        Some(kept.texture.id())
    }

    /// Asks for the tiles that were missing in this frame, and drops those that were not seen for long.
    pub fn end(&mut self, context: &egui::Context) {
        if !self.missing.is_empty() && !self.started {
            self.start(context);
        }
        self.shared.queue().wanted = std::mem::take(&mut self.missing);
        self.shared.wake.notify_one();
        if self.textures.len() > KEPT {
            let mut uses: Vec<u64> = self.textures.values().map(|kept| kept.used).collect();
            let limit = *uses.select_nth_unstable(self.textures.len() - KEPT).1;
            let now = self.clock;
            self.textures
                .retain(|_, kept| kept.used >= limit || kept.used == now);
        }
    }

    /// True while tiles are seen that are not there yet.
    pub fn is_busy(&self) -> bool {
        !self.shared.queue().wanted.is_empty()
    }

    fn start(&mut self, context: &egui::Context) {
        self.started = true;
        let (shared, sender, context) = (self.shared.clone(), self.sender.clone(), context.clone());
        let thread = std::thread::Builder::new().name("tiles".to_owned());
        // without a thread the canvas stays empty, and the window still works
        let _ = thread.spawn(move || {
            while let Some((key, shown)) = next(&shared) {
                let tile = shown.tile(key.1);
                let colors = tile
                    .pixels
                    .iter()
                    .map(|&[r, g, b, a]| Color32::from_rgba_unmultiplied(r, g, b, a));
                let image = ColorImage::new([tile.width, tile.height], colors.collect());
                if sender.send((key, image)).is_err() {
                    return;
                }
                let mut queue = shared.queue();
                queue.wanted.retain(|(other, _)| *other != key);
                drop(queue);
                context.request_repaint();
            }
        });
    }
}

/// The first tile that is wanted; it stays in the queue until it is made.
fn next(shared: &Shared) -> Option<(Key, Arc<Shown>)> {
    let mut queue = shared.queue();
    loop {
        if queue.quits {
            return None;
        }
        if let Some(first) = queue.wanted.first() {
            return Some(first.clone());
        }
        let waited = shared.wake.wait(queue);
        queue = waited.unwrap_or_else(PoisonError::into_inner);
    }
}

impl Drop for Tiler {
    fn drop(&mut self) {
        self.shared.queue().quits = true;
        self.shared.wake.notify_all();
    }
}

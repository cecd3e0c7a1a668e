//! Any frame of a clip, with a cache.

use crate::error::VideoError;
use crate::frame::{Frame, FramePicture};
use crate::info::ClipInfo;
use crate::source::{Damage, FrameSource};
use ravec_raster::with_image;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Frames by their number, for scrubbing. Frames that were read lately are kept in a cache of a stated size.
///
/// Guarantees: `frame(n)` is the frame that reading from the start gives as number `n`. Frames ahead of the last one that was
/// read by less than [`SKIP`](Self::SKIP) are reached by reading on, others by [`FrameSource::seek`].
pub struct RandomAccess<S> {
    source: S,
    /// Number of the frame that the source gives next.
    position: u64,
    cache: BTreeMap<u64, Cached>,
    cache_bytes: u64,
    used_bytes: u64,
    clock: u64,
}

struct Cached {
    frame: Arc<Frame>,
    bytes: u64,
    used: u64,
}

/// Bytes of the pixels.
fn bytes_of(frame: &Frame) -> u64 {
    match &frame.picture {
        FramePicture::Yuv(planes) => planes.bytes(),
        FramePicture::Image(image) => {
            with_image!(image, image => std::mem::size_of_val(image.pixels()) as u64)
        }
    }
}

impl<S: FrameSource> RandomAccess<S> {
    /// Frames that are read over before seeking is tried.
    pub const SKIP: u64 = 8;

    /// Any frame of `source`, with a cache of at most `cache_bytes`, and at least one frame.
    pub fn new(source: S, cache_bytes: u64) -> Self {
        Self {
            source,
            position: 0,
            cache: BTreeMap::new(),
            cache_bytes,
            used_bytes: 0,
            clock: 0,
        }
    }

    /// Properties of the clip.
    pub fn info(&self) -> &ClipInfo {
        self.source.info()
    }

    /// The reason why the last frame that was asked for is `None`, if that is damage.
    pub fn damage(&self) -> Option<&Damage> {
        self.source.damage()
    }

    /// True if the frame `index` is in the cache: [`frame`](Self::frame) gives it without reading.
    pub fn is_cached(&self, index: u64) -> bool {
        self.cache.contains_key(&index)
    }

    /// The frame `index`, from 0; `None` beyond the end.
    ///
    /// # Errors
    /// Those of the source.
    pub fn frame(&mut self, index: u64) -> Result<Option<Arc<Frame>>, VideoError> {
        self.clock += 1;
        if let Some(cached) = self.cache.get_mut(&index) {
            cached.used = self.clock;
            return Ok(Some(cached.frame.clone()));
        }
        // after an error or at its end the source is nowhere: what comes next begins with seeking
        let mut at = std::mem::replace(&mut self.position, u64::MAX);
        let ahead = index.checked_sub(at);
        if ahead.is_none_or(|ahead| ahead > Self::SKIP) {
            self.source.seek(index)?;
            at = index;
        }
        loop {
            let Some(frame) = self.source.next_frame()? else {
                return Ok(None);
            };
            let frame = Arc::new(frame);
            self.store(at, &frame);
            at += 1;
            if at > index {
                self.position = at;
                return Ok(Some(frame));
            }
        }
    }

    fn store(&mut self, index: u64, frame: &Arc<Frame>) {
        let bytes = bytes_of(frame);
        while self.used_bytes + bytes > self.cache_bytes {
            let oldest = self.cache.iter().min_by_key(|(_, cached)| cached.used);
            let Some((&oldest, _)) = oldest else { break };
            if let Some(cached) = self.cache.remove(&oldest) {
                self.used_bytes -= cached.bytes;
            }
        }
        let cached = Cached {
            frame: frame.clone(),
            bytes,
            used: self.clock,
        };
        if let Some(replaced) = self.cache.insert(index, cached) {
            self.used_bytes -= replaced.bytes;
        }
        self.used_bytes += bytes;
    }
}

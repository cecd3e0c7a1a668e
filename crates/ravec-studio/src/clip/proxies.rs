//! Small copies of all frames, so that a jump shows its frame at once where decoding begins at a key frame far before.

use super::facts::ClipFacts;
use super::reader::open;
use super::state::{Shared, State};
use ravec::raster::{AnyImage, Image, ResizeFilter, Size, Srgb, resize, with_image};
use ravec_media::{Format, Picture, WriteOptions};
use ravec_video::FrameSource as _;
use std::collections::BTreeMap;
use std::io::Cursor;
use std::sync::Arc;

/// Bytes of all copies of a clip: about ten thousand frames of 1080p.
const MAX_BYTES: usize = 256 << 20;

/// Sides of a frame by those of its copy.
const REDUCTION: usize = 4;

/// Longer side of a copy in pixels below which frames are not reduced further.
const MIN_SIDE: usize = 320;

/// Quality of the copies, which are JPEG.
const QUALITY: u8 = 85;

/// Copies by the numbers of their frames.
#[derive(Default)]
pub(super) struct ProxyState {
    made: BTreeMap<u64, Arc<[u8]>>,
    bytes: usize,
    /// True if no more are made.
    pub ended: bool,
}

impl ProxyState {
    /// The copy of a frame.
    pub fn get(&self, frame: u64) -> Option<&Arc<[u8]>> {
        self.made.get(&frame)
    }

    fn insert(&mut self, frame: u64, copy: Vec<u8>) {
        self.bytes += copy.len();
        if let Some(replaced) = self.made.insert(frame, copy.into()) {
            self.bytes -= replaced.len();
        }
    }
}

/// Ends the making of copies, however it ends.
struct End<'a>(&'a Shared);

impl Drop for End<'_> {
    fn drop(&mut self) {
        self.0.change(|state| state.proxies.ended = true);
    }
}

/// True if the next frame may be copied: in a short clip always, since thumbnails are made of the copies; else while nobody waits for
/// a frame or a thumbnail.
fn may_go_on(state: &State) -> bool {
    let in_order = state
        .facts
        .as_ref()
        .is_some_and(ClipFacts::is_read_in_order);
    let quiet = state.wanted.is_none() && state.running.is_none();
    in_order || (quiet && state.thumbnails.is_done())
}

/// Copies all frames, from the first one on, until the reader is dropped or the bytes are used up.
/// Clips that are read fast anywhere need no copies; frames with alpha have none.
pub(super) fn work(shared: &Shared) {
    let _end = End(shared);
    let fast = shared.wait_for(|state| Some(state.facts.as_ref()?.seeks_fast));
    if fast != Some(false) {
        return;
    }
    // errors of this source are errors of the one that reads frames too, which says them
    let Ok(mut clip) = open(&shared.path) else {
        return;
    };
    for number in 0.. {
        if shared
            .wait_for(|state| may_go_on(state).then_some(()))
            .is_none()
        {
            return;
        }
        let Ok(Some(frame)) = clip.next_frame() else {
            return;
        };
        let Some(copy) = copy(&frame.picture.to_image()) else {
            return;
        };
        let full = shared.change(|state| {
            state.proxies.insert(number, copy);
            state.proxies.bytes > MAX_BYTES
        });
        if full {
            return;
        }
    }
}

/// A small copy of a frame; none of one with alpha.
fn copy(image: &AnyImage) -> Option<Vec<u8>> {
    if matches!(
        image,
        AnyImage::Srgba8(_) | AnyImage::Srgba16(_) | AnyImage::LinearAlpha(_)
    ) {
        return None;
    }
    let [width, height] = [image.size().width(), image.size().height()];
    let longer = width.max(height);
    let wanted = (longer / REDUCTION).max(MIN_SIDE).min(longer);
    let side = |full: usize| (full * wanted / longer).max(1);
    let image: Image<Srgb<u8>> = with_image!(image, image => image.convert());
    let size = Size::new(side(width), side(height)).ok()?;
    let small = resize(&image, size, ResizeFilter::Box);
    let picture = Picture::from_image(small);
    let options = WriteOptions {
        quality: QUALITY,
        ..WriteOptions::default()
    };
    let mut data = Cursor::new(Vec::new());
    ravec_media::encode(&mut data, Format::Jpeg, &picture, &options).ok()?;
    Some(data.into_inner())
}

#[cfg(test)]
mod tests {
    use super::*;
    use ravec::raster::Srgba;

    #[test]
    fn a_copy_has_a_quarter_of_the_sides_or_what_suffices() {
        let size_of = |width, height| {
            let image = Image::new(Size::new(width, height).unwrap(), Srgb([9u8, 90, 200]));
            let copy = copy(&image.into()).unwrap();
            let limits = ravec_media::Limits::default();
            let picture = ravec_media::decode(Cursor::new(copy), &limits).unwrap();
            let size = picture.image.size();
            [size.width(), size.height()]
        };
        assert_eq!(size_of(1920, 1080), [480, 270]);
        assert_eq!(size_of(640, 480), [320, 240]);
        assert_eq!(size_of(48, 32), [48, 32]);
        assert_eq!(size_of(1, 3000), [1, 750]);
        let glass = Image::new(Size::new(40, 30).unwrap(), Srgba([9u8, 90, 200, 100]));
        assert!(copy(&glass.into()).is_none());
    }
}

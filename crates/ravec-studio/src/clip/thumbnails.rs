//! Small pictures of frames that are evenly spaced over a clip.

use super::facts::ClipFacts;
use super::reader::open;
use super::state::{Shared, State};
use crate::shown::Tile;
use ravec::raster::{AnyImage, Image, ResizeFilter, Size, Srgba, resize, with_image};
use ravec_media::Limits;
use ravec_video::{Clip, FrameSource as _};
use std::collections::{BTreeMap, BTreeSet};
use std::io::Cursor;
use std::sync::Arc;

/// Columns and rows within which a thumbnail fits.
const BOX: [usize; 2] = [192, 96];

/// Thumbnails that are made at most.
const MAX_COUNT: usize = 512;

/// Frames that are counted between two messages to the window.
const COUNTED_AT_ONCE: u64 = 64;

/// A small picture of a frame.
#[derive(Debug, Clone)]
pub struct Thumbnail {
    /// Number of the frame.
    pub frame: u64,
    /// The picture, of at most 192 columns and 96 rows.
    pub tile: Tile,
}

/// Thumbnails by the numbers of their frames. Cheap to clone.
#[derive(Debug, Clone, Default)]
pub struct Thumbnails(Arc<BTreeMap<u64, Arc<Thumbnail>>>);

impl Thumbnails {
    /// The thumbnail of the frame nearest to `frame`.
    pub fn nearest(&self, frame: u64) -> Option<&Arc<Thumbnail>> {
        let before = self.0.range(..=frame).next_back();
        let behind = self.0.range(frame..).next();
        let both = before.into_iter().chain(behind);
        both.min_by_key(|(number, _)| number.abs_diff(frame))
            .map(|(_, thumbnail)| thumbnail)
    }

    /// The thumbnails in the order of their frames.
    pub fn iter(&self) -> impl Iterator<Item = &Arc<Thumbnail>> {
        self.0.values()
    }

    /// Number of thumbnails.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// True before the first one is made.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// True if the frame has one.
    pub fn contains(&self, frame: u64) -> bool {
        self.0.contains_key(&frame)
    }
}

#[derive(Default)]
pub(super) struct ThumbnailState {
    /// Places that are asked for.
    pub count: usize,
    /// Places and frames of the last round, once it is over.
    done: Option<(usize, u64)>,
    /// True once the frames are counted.
    counted: bool,
    /// True if no more are made.
    pub ended: bool,
    pub made: Thumbnails,
}

impl ThumbnailState {
    /// True if `count` places are many more or many fewer than those that are asked for.
    pub fn asks_for_other(&self, count: usize) -> bool {
        count.min(MAX_COUNT).abs_diff(self.count) > self.count / 4
    }

    pub fn ask(&mut self, count: usize) {
        self.count = count.min(MAX_COUNT);
    }

    pub fn is_done(&self) -> bool {
        let round = self.count == 0 || self.done.is_some_and(|(count, _)| count == self.count);
        self.ended || (self.counted && round)
    }
}

/// Ends the making of thumbnails, however it ends.
struct End<'a>(&'a Shared);

impl Drop for End<'_> {
    fn drop(&mut self) {
        self.0.change(|state| state.thumbnails.ended = true);
    }
}

/// Counts the frames and makes thumbnails until the reader is dropped.
pub(super) fn work(shared: &Shared) {
    let _end = End(shared);
    let Some(is_exact) = shared.wait_for(|state| Some(state.facts.as_ref()?.is_exact)) else {
        return;
    };
    // errors of this source are errors of the one that reads frames too, which says them
    let Ok(mut clip) = open(&shared.path) else {
        return;
    };
    if !is_exact {
        count_frames(shared, &mut clip);
    }
    shared.change(|state| state.thumbnails.counted = true);
    while let Some((count, frames)) = shared.wait_for(next_round) {
        if make_round(shared, &mut clip, count, frames) {
            shared.show(|state| state.thumbnails.done = Some((count, frames)));
        }
    }
}

/// Places and frames of the next round.
fn next_round(state: &mut State) -> Option<(usize, u64)> {
    let round = (state.thumbnails.count, state.facts.as_ref()?.frames);
    (round.0 > 0 && state.thumbnails.done != Some(round)).then_some(round)
}

/// Counts the frames of a clip that does not state them.
fn count_frames(shared: &Shared, clip: &mut Clip) {
    let mut counted = 0;
    while let Ok(Some(_)) = clip.next_frame() {
        counted += 1;
        if counted % COUNTED_AT_ONCE == 0 {
            let grows = {
                let state = shared.state();
                if state.quits {
                    return;
                }
                state
                    .facts
                    .as_ref()
                    .is_some_and(|facts| facts.frames < counted)
            };
            if grows {
                set_frames(shared, counted, false);
            }
        }
    }
    set_frames(shared, counted, true);
}

fn set_frames(shared: &Shared, frames: u64, is_exact: bool) {
    shared.show(|state| {
        if let Some(facts) = &mut state.facts {
            facts.frames = frames.max(1);
            facts.is_exact = is_exact;
        }
    });
}

/// The middles of `count` equal parts of a clip.
fn places(count: usize, frames: u64) -> Vec<u64> {
    let count = (count as u64).min(frames).max(1);
    let middle =
        |k: u64| ((2 * u128::from(k) + 1) * u128::from(frames) / (2 * u128::from(count))) as u64;
    (0..count).map(middle).collect()
}

/// True while small copies of all frames are made, the first frames first.
fn takes_copies(state: &State) -> bool {
    let in_order = state
        .facts
        .as_ref()
        .is_some_and(ClipFacts::is_read_in_order);
    in_order && !state.proxies.ended
}

/// Origin of the next thumbnail.
enum Next {
    /// A small copy of the frame.
    Copy(Arc<[u8]>),
    /// The frame.
    Seek,
    /// It is made already.
    Known,
    /// Another round is asked for.
    OtherRound,
}

/// A frame of the clip.
fn sought(clip: &mut Clip, place: u64) -> Option<AnyImage> {
    clip.seek(place).ok()?;
    let frame = clip.next_frame().ok()??;
    Some(frame.picture.into_image())
}

/// Makes the thumbnails of a round: of the small copies as these are made, or by seeking, first every fourth, so that the whole clip
/// is seen early. False if another round is asked for meanwhile.
fn make_round(shared: &Shared, clip: &mut Clip, count: usize, frames: u64) -> bool {
    let places = places(count, frames);
    let in_order = takes_copies(&shared.state());
    let every = if in_order { 1 } else { 4 };
    let first = places.iter().skip(every / 4).step_by(every);
    for &place in first.chain(&places) {
        let next = shared.wait_for(|state| {
            if next_round(state) != Some((count, frames)) {
                return Some(Next::OtherRound);
            }
            if state.thumbnails.made.contains(place) {
                return Some(Next::Known);
            }
            match state.proxies.get(place) {
                Some(copy) => Some(Next::Copy(copy.clone())),
                None if takes_copies(state) => None,
                None => Some(Next::Seek),
            }
        });
        let image = match next {
            None | Some(Next::OtherRound) => return false,
            Some(Next::Known) => continue,
            Some(Next::Copy(copy)) => ravec_media::decode(Cursor::new(copy), &Limits::default())
                .ok()
                .map(|picture| picture.image),
            Some(Next::Seek) => sought(clip, place),
        };
        // a frame that cannot be read has no thumbnail
        if let Some(image) = image {
            let tile = small(&image);
            let thumbnail = Arc::new(Thumbnail { frame: place, tile });
            shared.show(|state| {
                Arc::make_mut(&mut state.thumbnails.made.0).insert(place, thumbnail);
            });
        }
    }
    let kept: BTreeSet<u64> = places.into_iter().collect();
    shared.change(|state| {
        Arc::make_mut(&mut state.thumbnails.made.0).retain(|place, _| kept.contains(place));
    });
    true
}

/// A picture that fits into the box of thumbnails.
fn small(image: &AnyImage) -> Tile {
    let (width, height) = (image.size().width(), image.size().height());
    let by_width = BOX[0] as f64 / width as f64;
    let factor = by_width.min(BOX[1] as f64 / height as f64).min(1.0);
    let side = |full: usize| ((full as f64 * factor).round() as usize).max(1);
    let image: Image<Srgba<u8>> = with_image!(image, image => image.convert());
    let image = match Size::new(side(width), side(height)) {
        Ok(size) => resize(&image, size, ResizeFilter::Box),
        Err(_) => image,
    };
    Tile {
        width: image.width(),
        height: image.height(),
        pixels: image.pixels().iter().map(|pixel| pixel.0).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_distinct_frames_in_order() {
        assert_eq!(places(4, 100), [12, 37, 62, 87]);
        for (count, frames) in [(1, 1), (5, 3), (3, 5), (512, 1000), (7, u64::MAX / 4)] {
            let places = places(count, frames);
            assert_eq!(places.len() as u64, (count as u64).min(frames));
            assert!(places.is_sorted_by(|a, b| a < b), "{count} of {frames}");
            assert!(places.iter().all(|&place| place < frames));
        }
    }

    #[test]
    fn the_nearest_thumbnail_is_found_on_both_sides() {
        let tile = Tile {
            width: 1,
            height: 1,
            pixels: vec![[0; 4]],
        };
        let made = [10, 20, 40].map(|frame| {
            let tile = tile.clone();
            (frame, Arc::new(Thumbnail { frame, tile }))
        });
        let thumbnails = Thumbnails(Arc::new(made.into_iter().collect()));
        for (asked, found) in [
            (0, 10),
            (14, 10),
            (16, 20),
            (20, 20),
            (29, 20),
            (31, 40),
            (99, 40),
        ] {
            assert_eq!(thumbnails.nearest(asked).unwrap().frame, found, "{asked}");
        }
        assert!(Thumbnails::default().nearest(3).is_none());
    }

    #[test]
    fn extreme_shapes_fit_into_the_box() {
        for (width, height) in [(1, 1), (1, 5000), (5000, 1), (1920, 1080), (10, 10)] {
            let size = Size::new(width, height).unwrap();
            let image = Image::new(size, Srgba([9u8, 9, 9, 255]));
            let level = small(&image.into());
            assert!(
                level.width <= BOX[0].max(1) && level.height <= BOX[1],
                "{width} x {height}"
            );
            assert_eq!(level.pixels.len(), level.width * level.height);
        }
    }
}

//! Frames that stand for the one that is being read.

use super::state::{Shared, State};
use super::thumbnails::Thumbnail;
use crate::shown::{Shown, Tile};
use ravec::raster::{AnyImage, Image, Size, Srgba};
use ravec_media::{Limits, Picture};
use std::io::Cursor;
use std::sync::Arc;

/// A frame that is at hand.
enum Near {
    Ready(Arc<Shown>),
    Proxy(Arc<[u8]>, [usize; 2]),
    Small(Arc<Thumbnail>, [usize; 2]),
}

/// Shows the nearest frame that is at hand whenever one is asked for, until the reader is dropped.
pub(super) fn work(shared: &Shared) {
    let mut last = None;
    while let Some((asked, number, near)) = shared.wait_for(|state| {
        let asked = state.asked.filter(|&asked| last != Some(asked))?;
        state.facts.as_ref()?;
        last = Some(asked);
        let (number, near) = nearest(state, asked)?;
        Some((asked, number, near))
    }) {
        let shown = match near {
            Near::Ready(shown) => shown,
            Near::Proxy(copy, size) => match decoded(&copy, size) {
                Some(shown) => Arc::new(shown),
                None => continue,
            },
            Near::Small(thumbnail, size) => match enlarged(&thumbnail, size) {
                Some(shown) => Arc::new(shown),
                None => continue,
            },
        };
        shared.show(|state| {
            // the frame itself may have come meanwhile, or one that is nearer
            let still = state.asked == Some(asked)
                && distance(state, asked).is_none_or(|shown| number.abs_diff(asked) < shown);
            if still {
                state.preview = Some((number, shown));
                if number == asked {
                    state.counts[1] = state.counts[0];
                }
            }
        });
    }
}

/// Frames from the one that was read last to another one.
fn distance(state: &State, asked: u64) -> Option<u64> {
    Some(state.shown.as_ref()?.number.abs_diff(asked))
}

/// The frame at hand that is nearest to the one that is asked for and nearer than what is shown.
fn nearest(state: &State, asked: u64) -> Option<(u64, Near)> {
    let size = state.facts.as_ref()?.size;
    let shown = state.preview.as_ref().map(|(number, _)| *number);
    let shown = shown.into_iter().map(|number| number.abs_diff(asked));
    let bound = shown.chain(distance(state, asked)).min();
    let ready = state
        .ready()
        .map(|frame| (frame.number, Near::Ready(frame.shown.clone())));
    let proxy = state.proxies.get(asked);
    let proxy = proxy.map(|copy| (asked, Near::Proxy(copy.clone(), size)));
    let small = state.thumbnails.made.nearest(asked);
    let small = small.map(|thumbnail| (thumbnail.frame, Near::Small(thumbnail.clone(), size)));
    ready
        .chain(proxy)
        .chain(small)
        .min_by_key(|(number, _)| number.abs_diff(asked))
        .filter(|(number, _)| bound.is_none_or(|bound| number.abs_diff(asked) < bound))
}

/// A small copy at the size of the frames.
fn decoded(copy: &[u8], size: [usize; 2]) -> Option<Shown> {
    let picture = ravec_media::decode(Cursor::new(copy), &Limits::default()).ok()?;
    Some(Shown::new(Arc::new(picture)).stretched(size))
}

/// A thumbnail at the size of the frames. A preview only.
fn enlarged(thumbnail: &Thumbnail, size: [usize; 2]) -> Option<Shown> {
    let Tile {
        width,
        height,
        pixels,
    } = &thumbnail.tile;
    let size_of_tile = Size::new(*width, *height).ok()?;
    let image = Image::from_fn(size_of_tile, |col, row| Srgba(pixels[row * width + col]));
    let picture = Picture::from_image(AnyImage::from(image));
    Some(Shown::new(Arc::new(picture)).stretched(size))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_enlarged_thumbnail_has_the_size_of_the_frames() {
        let tile = Tile {
            width: 3,
            height: 2,
            pixels: (0..6).map(|k| [k, 0, 0, 255]).collect(),
        };
        let shown = enlarged(&Thumbnail { frame: 0, tile }, [13, 8]).unwrap();
        assert_eq!(shown.size(), [13, 8]);
        assert_eq!(shown.level_size(0), [3, 2]);
        assert_eq!(shown.pixel(2, 1), Some([5, 0, 0, 255]));
    }
}

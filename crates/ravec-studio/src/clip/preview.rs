//! Frames that stand for the one that is being read.

use super::state::{Shared, State};
use super::thumbnails::Thumbnail;
use crate::shown::{Shown, ShownLevel};
use std::sync::Arc;

/// A frame that is at hand.
enum Near {
    Ready(Arc<Shown>),
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
            Near::Small(thumbnail, size) => Arc::new(enlarged(&thumbnail, size)),
        };
        shared.show(|state| {
            // the frame itself may have come meanwhile, or one that is nearer
            let still = state.asked == Some(asked)
                && distance(state, asked).is_none_or(|shown| number.abs_diff(asked) < shown);
            if still {
                state.preview = Some((number, shown));
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
    let small = state.thumbnails.made.nearest(asked);
    let small = small.map(|thumbnail| (thumbnail.frame, Near::Small(thumbnail.clone(), size)));
    ready
        .chain(small)
        .min_by_key(|(number, _)| number.abs_diff(asked))
        .filter(|(number, _)| bound.is_none_or(|bound| number.abs_diff(asked) < bound))
}

/// A thumbnail at the size of the frames. A preview only: pixels are repeated.
fn enlarged(thumbnail: &Thumbnail, [width, height]: [usize; 2]) -> Shown {
    let mut levels = Vec::new();
    let (mut width, mut height) = (width, height);
    // as many sizes as it takes to come down to the thumbnail
    loop {
        levels.push(repeated(&thumbnail.level, width, height));
        (width, height) = (width / 2, height / 2);
        if width < thumbnail.level.width || height < thumbnail.level.height {
            return Shown { levels };
        }
    }
}

fn repeated(level: &ShownLevel, width: usize, height: usize) -> ShownLevel {
    let cols: Vec<usize> = (0..width).map(|col| col * level.width / width).collect();
    let mut pixels: Vec<[u8; 4]> = Vec::with_capacity(width * height);
    let mut before = None;
    for row in 0..height {
        let from = row * level.height / height;
        if before == Some(from) {
            pixels.extend_from_within(pixels.len() - width..);
        } else {
            let source = &level.pixels[from * level.width..][..level.width];
            pixels.extend(cols.iter().map(|&col| source[col]));
            before = Some(from);
        }
    }
    ShownLevel {
        width,
        height,
        pixels,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_enlarged_thumbnail_has_the_size_of_the_frames() {
        let pixel = |k: usize| [k as u8, 0, 0, 255];
        let level = ShownLevel {
            width: 3,
            height: 2,
            pixels: (0..6).map(pixel).collect(),
        };
        let shown = enlarged(&Thumbnail { frame: 0, level }, [13, 8]);
        assert_eq!(shown.size(), [13, 8]);
        assert!(shown.levels.len() == 3);
        for level in &shown.levels {
            let at = |col, row| level.pixels[row * level.width + col];
            let (right, bottom) = (level.width - 1, level.height - 1);
            assert_eq!(at(0, 0), pixel(0));
            assert_eq!(at(right, 0), pixel(2));
            assert_eq!(at(0, bottom), pixel(3));
            assert_eq!(at(right, bottom), pixel(5));
        }
    }
}

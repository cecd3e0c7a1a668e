//! Files of completion steps, taken on a small picture.

use super::Outcome;
use glam::dvec2;
use ravec::completion::{CompleteError, FragmentIndex, Retouch, Sources, Step, Variant};
use ravec::progress::Progress;
use ravec::raster::{Image, Mask, Rect, Size, Srgb};
use serde::Deserialize;
use std::sync::LazyLock;

/// Steps as `complete --steps` writes them.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Log {
    #[serde(rename = "width")]
    _width: usize,
    #[serde(rename = "height")]
    _height: usize,
    steps: Vec<Step>,
}

/// More steps repeat what fewer show.
const MAX_STEPS: usize = 16;

static SIZE: LazyLock<Size> = LazyLock::new(|| Size::new(64, 48).expect("not empty"));
static HOLE: LazyLock<Mask> = LazyLock::new(|| Mask::from_rect(*SIZE, Rect::new(20, 16, 12, 10)));
static PICTURE: LazyLock<Image<Srgb<u8>>> = LazyLock::new(|| {
    Image::from_fn(*SIZE, |col, row| {
        Srgb([(col * 37 % 90) as u8, (row * 5) as u8, (col ^ row) as u8])
    })
});
static INDEX: LazyLock<FragmentIndex> = LazyLock::new(|| {
    let wall = [
        dvec2(4.0, 4.0),
        dvec2(58.0, 8.0),
        dvec2(58.0, 40.0),
        dvec2(4.0, 44.0),
    ];
    let mirrored = Variant {
        mirrored: true,
        ..Variant::default()
    };
    let sources = Sources {
        planes: &[wall],
        photos: std::slice::from_ref(&*PICTURE),
        variants: &[mirrored],
        ..Sources::new(&*PICTURE, &HOLE)
    };
    FragmentIndex::new(&sources, &Progress::none()).expect("the picture has enough around the hole")
});

/// Takes the steps one after another.
pub fn read(input: &[u8]) -> Outcome {
    let log = match serde_json::from_slice::<Log>(input) {
        Ok(log) => log,
        Err(error) => return Outcome::of::<(), _>(&Err(error)),
    };
    let mut retouch = Retouch::new(&INDEX);
    let steps = &log.steps[..log.steps.len().min(MAX_STEPS)];
    let result = retouch.replay(steps, &Progress::none());
    if let Err(CompleteError::Cancelled(_)) = result {
        panic!("nobody cancelled");
    }
    let picture = retouch.picture(&PICTURE);
    for (row, col) in
        (0..SIZE.height()).flat_map(|row| (0..SIZE.width()).map(move |col| (row, col)))
    {
        let kept = HOLE.at(col, row) > 0.0 || picture[(col, row)] == PICTURE[(col, row)];
        assert!(kept, "the known pixel {col}, {row} changed");
    }
    Outcome::of(&result)
}

//! Searches for fragments in pictures of 2 and 12 megapixels, and their index.
//!
//! Divide the CPU time by the number of cores: searches are parallel throughout.

use divan::{Bencher, black_box};
use glam::dvec2;
use ravec_completion::{FragmentIndex, Retouch, SearchOptions, Sources, Target};
use ravec_progress::Progress;
use ravec_raster::{Image, Mask, Size, Srgb};

const SIZES: [(usize, usize); 2] = [(1632, 1224), (4000, 3000)];

fn main() {
    divan::main();
}

/// Waves of many lengths, and a hole in the middle.
fn picture((width, height): (usize, usize)) -> (Image<Srgb<u8>>, Mask) {
    let size = Size::new(width, height).expect("both sides are positive");
    let image = Image::from_fn(size, |col, row| {
        let (x, y) = (col as f64, row as f64);
        let wave = |f: f64| {
            (f * x + 2.0 * (0.3 * f * y).sin()).sin() + (1.3 * f * y + (0.2 * f * x).cos()).sin()
        };
        Srgb([0.05, 0.21, 0.67].map(|f| (128.0 + 30.0 * (wave(f) + wave(0.31 * f))) as u8))
    });
    let middle = dvec2(width as f64 / 2.0, height as f64 / 2.0);
    let hole = Mask::from_disc(size, middle, 60.0).expect("a disc in the picture");
    (image, hole)
}

#[divan::bench(args = SIZES, sample_count = 5)]
fn build(bencher: Bencher, size: (usize, usize)) {
    let (image, hole) = picture(size);
    let sources = Sources::new(&image, &hole);
    bencher.bench(|| FragmentIndex::new(black_box(&sources), &Progress::none()));
}

#[divan::bench(args = SIZES, consts = [12, 24, 48], sample_count = 20)]
fn query<const RADIUS: u32>(bencher: Bencher, size: (usize, usize)) {
    let (image, hole) = picture(size);
    let index = FragmentIndex::new(&Sources::new(&image, &hole), &Progress::none())
        .expect("there is much to copy from");
    let retouch = Retouch::new(&index);
    let middle = dvec2(size.0 as f64 / 2.0, size.1 as f64 / 2.0);
    let target = Target::new(middle + dvec2(57.0, 5.0), RADIUS);
    let found = retouch.best(&target, &SearchOptions::default(), &Progress::none());
    assert!(found.is_ok_and(|found| !found.is_empty()));
    bencher.bench(|| {
        retouch.best(
            black_box(&target),
            &SearchOptions::default(),
            &Progress::none(),
        )
    });
}

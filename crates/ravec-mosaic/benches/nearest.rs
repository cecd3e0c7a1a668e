//! The 32 nearest of each of 10 000 tiles among 1 000 000 photos, with coefficients drawn so that their spectrum falls.
//!
//! Prints seconds by the clock; for CPU seconds and memory, run it under `time -v`. Ten tiles are compared with a search of
//! everything.

use ravec_mosaic::PhotoIndex;
use ravec_progress::Progress;
use std::time::Instant;

const DIMENSIONS: usize = 30;
const NEAREST: usize = 32;

/// Numbers whose size falls with the dimension, three by three, as the coefficients of photos do.
fn falling(count: usize, seed: u64) -> Vec<f32> {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    (0..count * DIMENSIONS)
        .map(|at| {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            let unit = (state >> 40) as f32 / (1u64 << 24) as f32 - 0.5;
            unit / (1 + at % DIMENSIONS / 3) as f32
        })
        .collect()
}

fn main() {
    let begin = Instant::now();
    let photos = falling(1_000_000, 1);
    let tiles = falling(10_000, 2);
    println!("drawn: {:.2} s", begin.elapsed().as_secs_f64());
    let begin = Instant::now();
    let index = PhotoIndex::new(&photos, DIMENSIONS);
    drop(photos);
    println!("index: {:.2} s", begin.elapsed().as_secs_f64());
    let begin = Instant::now();
    let found = index
        .nearest_of_all(&tiles, NEAREST, f32::INFINITY, &Progress::none())
        .expect("nobody cancels");
    println!("search: {:.2} s", begin.elapsed().as_secs_f64());
    for (tile, found) in tiles.chunks_exact(DIMENSIONS).zip(&found).step_by(1000) {
        let mut all: Vec<(f32, u32)> = index.all(tile).into_iter().zip(0..).collect();
        all.select_nth_unstable_by(NEAREST, |a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let farthest = all[..NEAREST].iter().map(|near| near.0).fold(0.0, f32::max);
        assert_eq!(found[NEAREST - 1].distance_sq, farthest);
    }
}

//! Times from a request to the frame on a timeline: `clip_speed CLIP...`.
//!
//! *Seen* is the time to the frame at any size, *exact* that to the frame itself. For each clip: steps forward and back, jumps over the whole clip, a drag with a request every 16 ms, and the thumbnails.

use ravec_studio::clip::ClipReader;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Requests of each kind.
const COUNT: u64 = 60;

fn main() {
    for path in std::env::args_os().skip(1) {
        measure(Path::new(&path));
    }
}

fn measure(path: &Path) {
    let start = Instant::now();
    let reader = ClipReader::open(path, Arc::new(|| {}));
    reader.request(0);
    reader.wait();
    let Some(facts) = reader.info() else {
        println!("{}", reader.failure().unwrap_or_default());
        return;
    };
    let [width, height] = facts.size;
    let opened = start.elapsed();
    reader.wait_for_thumbnails();
    reader.wait_for_proxies();
    let frames = reader.info().map_or(1, |facts| facts.frames);
    println!("{}: {width} x {height}, {frames} frames", path.display());
    println!("  first frame      {:8.1} ms", millis(opened));
    let middle = frames / 3;
    print(
        "steps forward",
        &reader,
        (1..=COUNT).map(|k| middle + k).filter(|k| *k < frames),
    );
    let last = (middle + COUNT).min(frames - 1);
    print(
        "known steps back",
        &reader,
        (0..COUNT.min(last - middle)).map(|k| last - k),
    );
    let late = (frames - 1).min(9 * frames / 10);
    print(
        "new steps back",
        &reader,
        (0..COUNT.min(late)).map(|k| late - k),
    );
    // a walk that never comes twice to the same place
    print(
        "jumps",
        &reader,
        (0..COUNT).map(|k| (k * 7919 * 31 + 17) % frames),
    );
    drag(&reader, frames);
    let start = Instant::now();
    reader.thumbnails(20);
    reader.wait_for_thumbnails();
    println!("  20 thumbnails    {:8.1} ms", millis(start.elapsed()));
}

fn millis(time: Duration) -> f64 {
    1e3 * time.as_secs_f64()
}

fn print(name: &str, reader: &ClipReader, requests: impl Iterator<Item = u64>) {
    let (mut seen, mut exact) = (Vec::new(), Vec::new());
    for frame in requests {
        let start = Instant::now();
        reader.request(frame);
        let is_seen = || reader.visible().is_some_and(|(number, _)| number == frame);
        while !is_seen() && reader.is_busy() {
            std::thread::sleep(Duration::from_micros(200));
        }
        seen.push(millis(start.elapsed()));
        reader.wait();
        exact.push(millis(start.elapsed()));
        // the hand is no faster than the window
        std::thread::sleep(Duration::from_millis(16));
    }
    if seen.is_empty() {
        return;
    }
    for (kind, mut times) in [("seen", seen), ("exact", exact)] {
        times.sort_by(f64::total_cmp);
        let at = |part: usize| times[(times.len() - 1) * part / 100];
        println!(
            "  {name:16} {kind:5} {:8.1} ms median, {:8.1} ms at 90 %, {:8.1} ms at most",
            at(50),
            at(90),
            at(100)
        );
    }
}

/// A drag over the whole clip in two seconds: the distance of what is visible from the hand, and the time to the exact frame at
/// its end.
fn drag(reader: &ClipReader, frames: u64) {
    reader.thumbnails(40);
    reader.wait_for_thumbnails();
    let steps = 120;
    let mut far = Vec::new();
    for k in 0..=steps {
        let hand = (frames - 1) * k / steps;
        reader.request(hand);
        std::thread::sleep(Duration::from_millis(16));
        let visible = reader
            .visible()
            .map_or(frames, |(frame, _)| frame.abs_diff(hand));
        far.push(visible);
    }
    let start = Instant::now();
    reader.wait();
    far.sort_unstable();
    println!(
        "  drag             {} frames away in the median, {} at most; exact {:.1} ms after its end",
        far[far.len() / 2],
        far[far.len() - 1],
        millis(start.elapsed())
    );
}

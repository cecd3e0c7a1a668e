//! Draws frames of clips of the catalogue into a folder as PNG, with the truth of each clip as JSON beside.
//!
//! `write_clips FOLDER [NAME [WIDTH HEIGHT [FRAMES [STEP [SEED]]]]]`; without a name, all of them; each STEP-th frame is drawn.

#![allow(
    clippy::disallowed_methods,
    reason = "an example's files may be left half written"
)]

use ravec_raster::Size;
use ravec_scenes::Seed;
use ravec_scenes::clip::{ClipId, clip};
use std::error::Error;
use std::path::Path;
use std::time::Instant;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let default = std::env::temp_dir().join("ravec-clips");
    let folder = arguments.first().map_or(default.as_path(), Path::new);
    std::fs::create_dir_all(folder)?;
    let number = |index: usize| {
        arguments
            .get(index)
            .map(|text| text.parse::<usize>())
            .transpose()
    };
    for id in ClipId::ALL {
        if arguments.get(1).is_some_and(|name| name != id.name()) {
            continue;
        }
        let size = match (number(2)?, number(3)?) {
            (Some(width), Some(height)) => Size::new(width, height)?,
            _ => id.default_size(),
        };
        let frames = number(4)?.unwrap_or(id.default_frames());
        let step = number(5)?.unwrap_or(8).max(1);
        let seed = Seed(number(6)?.unwrap_or(1) as u64);
        let started = Instant::now();
        let clip = clip(id, size, frames, seed);
        let painted = started.elapsed().as_secs_f64();
        let mut drawn = 0.0;
        for index in (0..frames).step_by(step) {
            let started = Instant::now();
            let frame = clip.frame(index);
            let stored = frame.stored();
            drawn += started.elapsed().as_secs_f64();
            let bytes: Vec<u8> = stored.pixels().iter().flat_map(|p| p.0).collect();
            let path = folder.join(format!("{}_{index:05}.png", clip.name()));
            let (width, height) = (size.width() as u32, size.height() as u32);
            image::save_buffer(path, &bytes, width, height, image::ColorType::Rgb8)?;
        }
        let count = frames.div_ceil(step) as f64;
        println!(
            "{:14} {size}: planes {painted:.2} s, a frame {:.1} ms",
            clip.name(),
            1e3 * drawn / count
        );
        let truth = std::fs::File::create(folder.join(clip.name()).with_extension("json"))?;
        serde_json::to_writer_pretty(truth, &clip.truth())?;
    }
    Ok(())
}

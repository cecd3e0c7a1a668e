//! Draws scenes of the catalogue into a folder as PNG, with their truth as JSON beside.
//!
//! `write_scenes FOLDER [NAME [WIDTH HEIGHT [SEED]]]`; without a name, all of them.

#![allow(
    clippy::disallowed_methods,
    reason = "an example's files may be left half written"
)]

use ravec_raster::{Size, Srgba};
use ravec_scenes::Seed;
use ravec_scenes::catalog::{SceneId, render};
use std::error::Error;
use std::path::Path;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let default = std::env::temp_dir().join("ravec-scenes");
    let folder = arguments.first().map_or(default.as_path(), Path::new);
    std::fs::create_dir_all(folder)?;
    let number = |index: usize| {
        arguments
            .get(index)
            .map(|text| text.parse::<usize>())
            .transpose()
    };
    for id in SceneId::ALL {
        if arguments.get(1).is_some_and(|name| name != id.name()) {
            continue;
        }
        let size = match (number(2)?, number(3)?) {
            (Some(width), Some(height)) => Size::new(width, height)?,
            _ => id.default_size(),
        };
        let seed = number(4)?.map_or(id.default_seed(), |seed| Seed(seed as u64));
        let started = std::time::Instant::now();
        let scene = render(id, size, seed);
        println!(
            "{:14} {size} in {:.2} s",
            scene.name,
            started.elapsed().as_secs_f64()
        );
        let bytes: Vec<u8> = scene
            .image
            .convert::<Srgba<u8>>()
            .pixels()
            .iter()
            .flat_map(|p| p.0)
            .collect();
        let path = folder.join(scene.name);
        let (width, height) = (size.width() as u32, size.height() as u32);
        image::save_buffer(
            path.with_extension("png"),
            &bytes,
            width,
            height,
            image::ColorType::Rgba8,
        )?;
        let truth = std::fs::File::create(path.with_extension("json"))?;
        serde_json::to_writer_pretty(truth, &scene.truth)?;
    }
    Ok(())
}

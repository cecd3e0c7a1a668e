//! Composes a picture from photos: `cargo run --release -p ravec-jobs --example mosaic -- photo.jpg mosaic.png photos/`

use ravec::mosaic::{ChooseParams, Crop, Rules};
use ravec::progress::Progress;
use ravec::raster::Size;
use ravec_catalogue::{Catalogue, MosaicParams, Outputs, add, mosaic};
use ravec_media::{Limits, read};
use std::error::Error;
use std::path::{Path, PathBuf};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [input, output, photos] = &arguments[..] else {
        return Err("usage: mosaic PICTURE OUTPUT PHOTOS".into());
    };
    let (progress, limits) = (Progress::none(), Limits::default());
    // the catalogue stays beside the photos, so that a second mosaic need not read them again
    let mut catalogue =
        Catalogue::open_or_make(&Path::new(photos).join("photos.ravec"), &progress)?;
    add(&mut catalogue, &[PathBuf::from(photos)], &limits, &progress)?;

    let params = MosaicParams {
        columns: 40,
        rows: None,
        tile: Size::new(48, 48)?,
        crop: Crop::Center,
        // few photos repeat more often than the default of 5 tiles allows
        rules: Rules {
            min_repeat_distance: 2.0,
            ..Rules::default()
        },
        choose: ChooseParams::default(),
        adaptive: None,
        quality: 92,
        kept_bytes: 64 << 20,
        preview_px: None,
        pins: Vec::new(),
        bans: Vec::new(),
    };
    let outputs = Outputs {
        picture: Some(Path::new(output)),
        deep_zoom: None,
    };
    let picture = read(input, &limits)?;
    let made = mosaic(
        &catalogue,
        &picture.image,
        &outputs,
        &params,
        &limits,
        &progress,
    )?;
    println!(
        "{} different photos in {} tiles",
        made.used,
        made.photos.len()
    );
    Ok(())
}

//! Matches two photos of a plane: `cargo run --release -p ravec-jobs --example register -- first.jpg second.jpg`

use ravec::planar::{MatchParams, encoded_luminance, match_photos};
use ravec::progress::Progress;
use ravec::raster::LinearRgba;
use ravec_media::{Limits, read};
use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [first, second] = &arguments[..] else {
        return Err("usage: register PICTURE PICTURE".into());
    };
    let limits = Limits::default();
    let first = encoded_luminance(&read(first, &limits)?.convert::<LinearRgba>());
    let second = encoded_luminance(&read(second, &limits)?.convert::<LinearRgba>());
    let found = match_photos(&first, &second, &MatchParams::default(), &Progress::none())?;
    // maps a position in the first photo to one in the second
    println!("{:?}", found.second_from_first.to_rows());
    Ok(())
}

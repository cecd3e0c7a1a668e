//! Vectorizes a picture: `cargo run --release -p ravec-jobs --example vectorize -- photo.jpg photo.svg`

use ravec::progress::Progress;
use ravec::raster::Srgb;
use ravec::twocolor::{AdaptiveField, AdaptiveParams, SvgParams, write_svg};
use ravec_files::write_atomically;
use ravec_media::{Limits, read};
use std::error::Error;
use std::path::Path;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [input, output] = &arguments[..] else {
        return Err("usage: vectorize PICTURE DRAWING.svg".into());
    };
    let progress = Progress::none();
    let picture = read(input, &Limits::default())?.convert::<Srgb<u8>>();
    let mut field = AdaptiveField::fit(&picture, &AdaptiveParams::default(), &progress)?;
    field.refine_lines(&picture, &progress)?;
    write_atomically(Path::new(output), |file| {
        write_svg(&field, &SvgParams::default(), file)
    })?;
    println!("{} blocks", field.leaves().len());
    Ok(())
}

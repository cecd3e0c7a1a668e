//! Removes what lies in a rectangle: `cargo run --release -p ravec-jobs --example remove_object -- photo.jpg out.png 40 30 60 50`

use ravec::completion::{CompleteParams, complete};
use ravec::progress::Progress;
use ravec::raster::{LinearRgba, Mask, Rect};
use ravec_media::{Limits, WriteOptions, read, write};
use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [input, output, rectangle @ ..] = &arguments[..] else {
        return Err("usage: remove_object PICTURE OUTPUT LEFT TOP WIDTH HEIGHT".into());
    };
    let numbers: Vec<usize> = rectangle
        .iter()
        .map(|text| text.parse())
        .collect::<Result<_, _>>()?;
    let [left, top, width, height] = numbers[..] else {
        return Err("a rectangle is LEFT TOP WIDTH HEIGHT, in pixels".into());
    };
    let picture = read(input, &Limits::default())?;
    let image = picture.convert::<LinearRgba>();
    let hole = Mask::from_rect(image.size(), Rect::new(left, top, width, height));
    // no planes: the surroundings are taken as seen from the front
    let completed = complete(
        &image,
        &hole,
        &[],
        &CompleteParams::default(),
        &Progress::none(),
    )?;
    write(
        output,
        &picture.with_image(&completed.image),
        &WriteOptions::default(),
    )?;
    Ok(())
}

//! Changes the aspect ratio of a picture: `cargo run --release -p ravec-jobs --example retarget -- photo.jpg square.png 800 800`

use ravec::progress::Progress;
use ravec::raster::{LinearRgba, Size};
use ravec::retarget::{Painted, RetargetParams, Retargeter};
use ravec_media::{Limits, WriteOptions, read, write};
use std::error::Error;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [input, output, width, height] = &arguments[..] else {
        return Err("usage: retarget PICTURE OUTPUT WIDTH HEIGHT".into());
    };
    let progress = Progress::none();
    let picture = read(input, &Limits::default())?;
    let image = picture.convert::<LinearRgba>();
    // the analysis is done once; any number of sizes may follow
    let retargeter = Retargeter::new(
        &image,
        Painted::default(),
        &RetargetParams::default(),
        &progress,
    )?;
    let deformation = retargeter.solve(Size::new(width.parse()?, height.parse()?)?)?;
    let result = deformation.warp(&image, &progress)?;
    write(
        output,
        &picture.with_image(&result),
        &WriteOptions::default(),
    )?;
    println!("{:?}", deformation.summary());
    Ok(())
}

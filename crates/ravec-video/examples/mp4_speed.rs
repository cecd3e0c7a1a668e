//! Time of decoding a clip, of its conversion to colors, and of encoding it again:
//! `cargo run --release -p ravec-video --example mp4_speed -- CLIP.mp4 [FRAMES.yuv]`.
//!
//! Run it on one core for figures of one core. With a second argument, all planes are written to that file.

use ravec_video::mp4::{Mp4Source, Mp4Writer};
use ravec_video::{
    EncodeOptions, FramePicture, FrameSink as _, FrameSource as _, SamplePlane, SinkFormat,
    VideoLimits,
};
use std::error::Error;
use std::fs::File;
use std::io::{BufWriter, Cursor, Write as _};
use std::time::Instant;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let path = arguments.next().ok_or("name a clip")?;
    let mut planes = arguments
        .next()
        .map(File::create)
        .transpose()?
        .map(BufWriter::new);
    let limits = VideoLimits::default();
    let mut source = Mp4Source::open(File::open(&path)?, &limits)?;
    let info = source.info().clone();
    println!("{info:?}");
    let start = Instant::now();
    let mut frames = Vec::new();
    let mut count = 0u32;
    let mut decoding = 0.0;
    let mut coloring = 0.0;
    loop {
        let before = Instant::now();
        let Some(frame) = source.next_frame()? else {
            break;
        };
        decoding += before.elapsed().as_secs_f64();
        count += 1;
        let before = Instant::now();
        std::hint::black_box(frame.picture.to_image());
        coloring += before.elapsed().as_secs_f64();
        if let (Some(planes), FramePicture::Yuv(picture)) = (&mut planes, &frame.picture) {
            for plane in picture.planes() {
                if let SamplePlane::U8(plane) = plane {
                    planes.write_all(plane.pixels())?;
                }
            }
        }
        if frames.len() < 150 {
            frames.push(frame);
        }
    }
    println!("damage: {:?}", source.damage());
    println!(
        "{count} frames in {:.2} s: decoding {:.1} frames a second, colors {:.1} frames a second",
        start.elapsed().as_secs_f64(),
        f64::from(count) / decoding,
        f64::from(count) / coloring,
    );
    let format = SinkFormat {
        size: info.size,
        pixels: info.pixels,
        time_base: info.time_base,
        rate: info.rate,
        pixel_aspect: info.pixel_aspect,
    };
    let start = Instant::now();
    let mut writer = Mp4Writer::new(Cursor::new(Vec::new()), &format, &EncodeOptions::default())?;
    for frame in &frames {
        writer.write(frame)?;
    }
    let bytes = writer.complete()?.into_inner();
    println!(
        "encoding {} frames: {:.1} frames a second, {} bytes",
        frames.len(),
        frames.len() as f64 / start.elapsed().as_secs_f64(),
        bytes.len(),
    );
    if let Some(path) = std::env::args().nth(3) {
        std::fs::write(path, bytes)?;
    }
    Ok(())
}

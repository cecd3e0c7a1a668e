//! Work on an MP4 clip, whose time `time` measures from outside:
//! `mp4_speed decode|colors|encode|planes CLIP.mp4 [OUTPUT]`.
//!
//! `decode` reads all frames, `colors` converts them to colors as well, `encode` writes them to `OUTPUT` as MP4, `planes` writes
//! their samples to `OUTPUT` one after the other. Run it on one core (`taskset -c 0`) for figures of one core; encoding alone
//! is the difference of two runs.

#![allow(
    clippy::disallowed_methods,
    reason = "examples may write files as they like"
)]

use ravec_video::mp4::{Mp4Source, Mp4Writer};
use ravec_video::{
    EncodeOptions, FramePicture, FrameSink as _, FrameSource as _, SamplePlane, SinkFormat,
    VideoLimits,
};
use std::error::Error;
use std::fs::File;
use std::io::{BufWriter, Write as _};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [work, path, rest @ ..] = arguments.as_slice() else {
        return Err("name the work and a clip".into());
    };
    let mut source = Mp4Source::open(File::open(path)?, &VideoLimits::default())?;
    let info = source.info().clone();
    let mut output = rest
        .first()
        .map(File::create)
        .transpose()?
        .map(BufWriter::new);
    let mut writer = None;
    if work == "encode" {
        let format = SinkFormat {
            size: info.size,
            pixels: info.pixels,
            time_base: info.time_base,
            rate: info.rate,
            pixel_aspect: info.pixel_aspect,
        };
        let output = output.take().ok_or("name an output")?;
        writer = Some(Mp4Writer::new(output, &format, &EncodeOptions::default())?);
    }
    let mut count = 0;
    while let Some(frame) = source.next_frame()? {
        count += 1;
        if work == "colors" {
            std::hint::black_box(frame.picture.to_image());
        }
        if let Some(writer) = &mut writer {
            writer.write(&frame)?;
        }
        if let (Some(output), FramePicture::Yuv(picture)) = (&mut output, &frame.picture) {
            for plane in picture.planes() {
                if let SamplePlane::U8(plane) = plane {
                    output.write_all(plane.pixels())?;
                }
            }
        }
    }
    if let Some(writer) = writer {
        writer.complete()?;
    }
    println!(
        "{count} frames of {}, damage: {:?}",
        info.size,
        source.damage()
    );
    Ok(())
}

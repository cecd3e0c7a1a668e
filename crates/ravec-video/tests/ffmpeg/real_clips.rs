//! Clips for development: what is read is what FFmpeg itself reads, in any order.

use crate::scene::{clips, ffmpeg, ffprobe, has_ffmpeg, open, read_all, text};
use ravec_video::{FramePicture, FrameSource, PixelKind, Rotation, SamplePlane};

fn raw(picture: &FramePicture) -> Vec<u8> {
    match picture {
        FramePicture::Yuv(planes) => {
            let planes = planes.planes().iter().map(|plane| match plane {
                SamplePlane::U8(plane) => plane.pixels().to_vec(),
                SamplePlane::U16(plane) => plane
                    .pixels()
                    .iter()
                    .flat_map(|value| value.to_le_bytes())
                    .collect(),
            });
            planes.collect::<Vec<_>>().concat()
        }
        FramePicture::Image(image) => {
            let image: ravec_raster::Image<ravec_raster::Srgb<u8>> = image.convert();
            image.pixels().iter().flat_map(|pixel| pixel.0).collect()
        }
    }
}

#[test]
fn frames_and_times_are_those_of_ffmpeg() {
    if !has_ffmpeg() {
        return;
    }
    for path in clips() {
        let mut source = open(&path).unwrap();
        let info = source.info().clone();
        assert_eq!(info.rotation, Rotation::None);
        let layout = match info.pixels {
            PixelKind::Rgb { .. } => "rgb24".to_owned(),
            PixelKind::Yuv { .. } => ffprobe(&[
                "-select_streams",
                "v:0",
                "-show_entries",
                "stream=pix_fmt",
                "-of",
                "csv=p=0",
                text(&path),
            ])[0]
                .clone(),
        };
        let bytes = ffmpeg(&[
            "-i",
            text(&path),
            "-map",
            "0:v:0",
            "-vsync",
            "passthrough",
            "-frames:v",
            "60",
            "-f",
            "rawvideo",
            "-pix_fmt",
            &layout,
            "-",
        ]);
        let stamps = ffprobe(&[
            "-select_streams",
            "v:0",
            "-show_entries",
            "frame=best_effort_timestamp",
            "-of",
            "csv=p=0",
            text(&path),
        ]);
        let stamps: Vec<i64> = stamps.iter().map(|stamp| stamp.parse().unwrap()).collect();
        let name = path.file_name().unwrap().display().to_string();
        let found = read_all(&mut source);
        eprintln!("{name}: {} frames, {:?}", found.len(), source.damage());
        if source.damage().is_none() {
            assert_eq!(found.len(), stamps.len(), "{name}");
        }
        let truth = bytes.chunks_exact(bytes.len() / 60.min(stamps.len()));
        for (number, (frame, truth)) in found.iter().zip(truth).enumerate() {
            assert!(raw(&frame.picture) == truth, "{name}: frame {number}");
        }
        for (number, frame) in found.iter().enumerate() {
            assert_eq!(
                frame.time.start,
                stamps[number] - stamps[0],
                "{name}: frame {number}"
            );
            if let Some(next) = found.get(number + 1) {
                assert_eq!(
                    frame.time.duration as i64,
                    next.time.start - frame.time.start,
                    "{name}"
                );
            }
        }
    }
}

/// A sum of the content and the time, as all frames of a clip do not fit into memory.
fn print(frame: &ravec_video::Frame) -> (u64, i64, u64) {
    let sum = raw(&frame.picture)
        .iter()
        .fold(0xCBF2_9CE4_8422_2325u64, |hash, byte| {
            (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01B3)
        });
    (sum, frame.time.start, frame.time.duration)
}

#[test]
fn random_access_is_exact_to_the_frame() {
    if !has_ffmpeg() {
        return;
    }
    for path in clips() {
        let name = path.file_name().unwrap().display().to_string();
        let mut source = open(&path).unwrap();
        let mut truth = Vec::new();
        while let Some(frame) = source.next_frame().unwrap() {
            truth.push(print(&frame));
        }
        if source.damage().is_some() {
            // the last frames before damage depend on what FFmpeg has in its queues
            truth.truncate(truth.len() - 4);
        }
        let damaged = source.damage().is_some();
        let count = truth.len() as u64;
        // a fresh source knows nothing about the clip
        let mut source = open(&path).unwrap();
        let mut state = 12345u64;
        let mut indices = vec![
            count - 1,
            0,
            count / 2,
            count / 2 + 1,
            count / 2 - 1,
            count,
            count + 1000,
            1,
        ];
        for _ in 0..12 {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            indices.push((state >> 33) % count);
        }
        for index in indices {
            source.seek(index).unwrap();
            for ahead in 0..3 {
                let found = source.next_frame().unwrap().map(|frame| print(&frame));
                let truth = truth.get((index + ahead) as usize);
                if damaged && truth.is_none() {
                    break;
                }
                assert_eq!(found.as_ref(), truth, "{name}: frame {index} + {ahead}");
            }
        }
    }
}

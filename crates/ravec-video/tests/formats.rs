//! Clips come back as they were written.

#![allow(
    clippy::disallowed_methods,
    reason = "tests may write files as they like"
)]

mod common;

use common::{colors, deep_picture, frame, open, picture, read, read_anything, write};
use ravec_raster::{AnyImage, Image, Size, Srgb, Srgba};
use ravec_video::{
    ColorInfo, CreateOptions, EncodeOptions, Frame, FramePicture, FrameSource as _, FrameTime,
    Matrix, OpenOptions, PixelKind, RandomAccess, Range, Rational, SamplePlane, SinkFormat, Siting,
    Subsampling, VideoError, VideoLimits, YuvFormat, YuvImage,
};

fn size() -> Size {
    Size::new(17, 11).unwrap()
}

fn lossless() -> CreateOptions {
    CreateOptions {
        encode: EncodeOptions {
            lossless: true,
            ..EncodeOptions::default()
        },
        ..CreateOptions::default()
    }
}

/// Planes with all codes of their depth.
fn planes(format: YuvFormat, color: ColorInfo, at: u64) -> YuvImage {
    let mask = ((1u32 << format.depth) - 1) as usize;
    let planes = format.plane_sizes(size()).into_iter().enumerate();
    let planes = planes.map(|(plane, size)| {
        let code =
            |col: usize, row: usize| (col * 37 + row * 101 + at as usize * 11 + plane * 5) & mask;
        if format.depth > 8 {
            SamplePlane::U16(Image::from_fn(size, |col, row| code(col, row) as u16))
        } else {
            SamplePlane::U8(Image::from_fn(size, |col, row| code(col, row) as u8))
        }
    });
    YuvImage::new(format, color, planes.collect()).unwrap()
}

#[test]
fn planes_come_back_from_y4m_to_the_last_bit() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("clip.y4m");
    let layouts = [
        (Subsampling::Gray, 8),
        (Subsampling::Gray, 12),
        (Subsampling::S420, 8),
        (Subsampling::S420, 10),
        (Subsampling::S422, 8),
        (Subsampling::S422, 16),
        (Subsampling::S440, 8),
        (Subsampling::S411, 8),
        (Subsampling::S444, 8),
        (Subsampling::S444, 14),
    ];
    for (subsampling, depth) in layouts {
        for range in [Range::Limited, Range::Full] {
            let layout = YuvFormat {
                subsampling,
                depth,
                alpha: false,
            };
            let color = ColorInfo {
                range,
                ..ColorInfo::guess(size().height())
            };
            let format = SinkFormat {
                pixels: PixelKind::Yuv {
                    format: layout,
                    color,
                },
                ..colors::<u8>(size(), false)
            };
            let frames = (0..3).map(|at| Frame {
                picture: FramePicture::Yuv(planes(layout, color, at)),
                time: FrameTime {
                    start: at as i64,
                    duration: 1,
                },
            });
            let frames: Vec<Frame> = frames.collect();
            write(&path, &format, &lossless(), frames.clone()).unwrap();
            let found = read(&path);
            assert_eq!(found.len(), frames.len());
            for (found, truth) in found.iter().zip(&frames) {
                let (FramePicture::Yuv(found), FramePicture::Yuv(truth)) =
                    (&found.picture, &truth.picture)
                else {
                    panic!("no planes");
                };
                assert_eq!(found.planes(), truth.planes(), "{layout:?}");
                assert_eq!(found.color().range, range);
            }
        }
    }
}

#[test]
fn siting_is_written_back() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("clip.y4m");
    for siting in [Siting::LEFT, Siting::CENTER, Siting::TOP_LEFT] {
        let color = ColorInfo {
            siting,
            ..ColorInfo::guess(11)
        };
        let format = SinkFormat {
            pixels: PixelKind::Yuv {
                format: YuvFormat::YUV420P8,
                color,
            },
            pixel_aspect: Rational::new(4, 3).unwrap(),
            rate: Rational::new(30000, 1001),
            ..colors::<u8>(size(), false)
        };
        let planes = FramePicture::Yuv(planes(YuvFormat::YUV420P8, color, 0));
        let time = FrameTime {
            start: 0,
            duration: 1,
        };
        write(
            &path,
            &format,
            &lossless(),
            [Frame {
                picture: planes,
                time,
            }],
        )
        .unwrap();
        let clip = open(&path).unwrap();
        let PixelKind::Yuv { color: found, .. } = clip.info().pixels else {
            panic!("no planes");
        };
        assert_eq!(found.siting, siting);
        assert_eq!(clip.info().pixel_aspect, format.pixel_aspect);
        assert_eq!(clip.info().rate, format.rate);
    }
}

#[test]
fn colors_come_back_from_lossless_y4m_to_the_last_bit() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("clip.y4m");
    let format = colors::<u8>(size(), false);
    let frames = (0..4).map(|at| frame(picture(size(), at), at));
    write(&path, &format, &lossless(), frames).unwrap();
    for (at, found) in read(&path).into_iter().enumerate() {
        let found: Image<Srgb<u8>> = found.picture.into_image().convert();
        assert_eq!(found, picture(size(), at as u64));
    }
}

#[test]
fn numbered_pictures_keep_their_bits_alpha_and_numbers() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("f_%03d.png");
    let format = colors::<u16>(size(), true);
    let options = CreateOptions {
        first_number: 998,
        ..CreateOptions::default()
    };
    let frames = (0..4).map(|at| frame(deep_picture(size(), at), at));
    write(&path, &format, &options, frames).unwrap();
    let clip = open(&path).unwrap();
    assert_eq!(clip.first_number(), 998);
    assert_eq!(clip.info().frames, Some(4));
    for source in [path.as_path(), folder.path()] {
        for (at, found) in read(source).into_iter().enumerate() {
            assert_eq!(
                found.picture.into_image(),
                AnyImage::from(deep_picture(size(), at as u64))
            );
        }
    }
    std::fs::remove_file(folder.path().join("f_999.png")).unwrap();
    let clip = open(&path).unwrap();
    assert_eq!(clip.info().frames, Some(3));
    assert!(
        clip.warnings()[0].contains("999 to 999"),
        "{:?}",
        clip.warnings()
    );
}

#[test]
fn floats_come_back_from_exr_pictures() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("f_%d.exr");
    let image = AnyImage::Linear(deep_picture(size(), 3).convert());
    let format = colors::<f32>(size(), false);
    write(
        &path,
        &format,
        &CreateOptions::default(),
        [frame(image.clone(), 0)],
    )
    .unwrap();
    assert_eq!(read(&path)[0].picture.to_image().into_owned(), image);
}

#[test]
fn animated_png_keeps_sixteen_bits_alpha_and_time() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("clip.apng");
    let format = SinkFormat {
        time_base: Rational::new(1, 30).unwrap(),
        rate: None,
        ..colors::<u16>(size(), true)
    };
    let durations = [1, 5, 2, 90];
    let mut start = 0;
    let frames = durations.iter().enumerate().map(|(at, duration)| {
        let time = FrameTime {
            start,
            duration: *duration,
        };
        start += *duration as i64;
        Frame {
            time,
            ..frame(deep_picture(size(), at as u64), 0)
        }
    });
    let frames: Vec<Frame> = frames.collect();
    write(&path, &format, &CreateOptions::default(), frames.clone()).unwrap();
    let found = read(&path);
    assert_eq!(found.len(), 4);
    let time_base = open(&path).unwrap().info().time_base;
    for (found, truth) in found.iter().zip(&frames) {
        assert_eq!(found.picture, truth.picture);
        let seconds = found.time.duration as f64 * time_base.to_f64();
        assert!((seconds - truth.time.duration as f64 / 30.0).abs() < 1e-8);
    }
    // other programs see a picture
    let first = ravec_media::decode(
        std::io::Cursor::new(std::fs::read(&path).unwrap()),
        &ravec_media::Limits::default(),
    );
    assert_eq!(
        first.unwrap().image,
        frames[0].picture.to_image().into_owned()
    );
}

#[test]
fn gif_keeps_colors_that_it_has_transparency_and_time() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("clip.gif");
    let image = |at: u64| {
        Image::from_fn(size(), |col, row| match (col as u64 + at) % 4 {
            0 => Srgba([0u8; 4]),
            1 => Srgba([255, 0, 0, 255]),
            _ => Srgba([0, 40 * (row as u8 % 3), 200, 255]),
        })
    };
    // 30 frames a second are no whole number of hundredths: errors must not add up
    let format = SinkFormat {
        time_base: Rational::new(1, 30).unwrap(),
        ..colors::<u8>(size(), true)
    };
    let frames = (0..31).map(|at| frame(image(at), at));
    write(&path, &format, &CreateOptions::default(), frames).unwrap();
    let found = read(&path);
    assert_eq!(found.len(), 31);
    for (at, found) in found.iter().enumerate() {
        assert_eq!(
            found.picture.to_image().into_owned(),
            AnyImage::from(image(at as u64))
        );
        let start = found.time.start as f64 / 100.0;
        assert!((start - at as f64 / 30.0).abs() <= 0.0051, "{at}: {start}");
    }
}

#[test]
fn any_frame_is_the_one_that_reading_from_the_start_gives() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["clip.y4m", "clip.gif", "clip.apng", "f_%02d.png"] {
        let path = folder.path().join(name);
        let frames = (0..23).map(|at| frame(picture(size(), at), at));
        write(
            &path,
            &colors::<u8>(size(), false),
            &CreateOptions::default(),
            frames,
        )
        .unwrap();
        let truth = read(&path);
        // one cache for nothing, one for some frames
        for cache in [0, 5 * 17 * 11 * 3, u64::MAX] {
            let mut access = RandomAccess::new(open(&path).unwrap(), cache);
            for step in 0..60u64 {
                let index = (step * step * 7 + step) % 25;
                let found = access.frame(index).unwrap();
                let truth = truth.get(index as usize);
                assert_eq!(found.as_deref(), truth, "{name} {index}");
            }
        }
    }
}

#[test]
fn a_cut_file_gives_the_frames_before_the_cut_and_says_so() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["clip.y4m", "clip.gif", "clip.apng"] {
        let path = folder.path().join(name);
        let frames = (0..6).map(|at| frame(picture(size(), at), at));
        write(
            &path,
            &colors::<u8>(size(), false),
            &CreateOptions::default(),
            frames,
        )
        .unwrap();
        let (whole, truth) = (std::fs::read(&path).unwrap(), read(&path));
        let mut damaged = 0;
        for end in 0..whole.len() {
            std::fs::write(&path, &whole[..end]).unwrap();
            let Ok(mut clip) = open(&path) else {
                continue;
            };
            let mut count = 0;
            loop {
                match clip.next_frame() {
                    Ok(Some(found)) => {
                        assert_eq!(found, truth[count], "{name} cut at {end}");
                        count += 1;
                    }
                    Ok(None) => break,
                    Err(error) => {
                        assert_eq!(count, 0, "{name} cut at {end}: {error}");
                        break;
                    }
                }
            }
            damaged += usize::from(
                clip.damage()
                    .is_some_and(|damage| damage.frames == count as u64),
            );
        }
        // nearly every cut is within a frame
        assert!(
            damaged * 10 > whole.len() * 6,
            "{name}: {damaged} of {}",
            whole.len()
        );
    }
}

#[test]
fn flipped_bytes_end_in_frames_or_an_error() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["clip.y4m", "clip.gif", "clip.apng"] {
        let path = folder.path().join(name);
        let frames = (0..3).map(|at| frame(picture(size(), at), at));
        write(
            &path,
            &colors::<u8>(size(), false),
            &CreateOptions::default(),
            frames,
        )
        .unwrap();
        let whole = std::fs::read(&path).unwrap();
        let mut refused = 0;
        for at in 0..whole.len() {
            let mut broken = whole.clone();
            broken[at] ^= 1 << (at % 8);
            broken[(at * 31) % whole.len()] = (at % 256) as u8;
            std::fs::write(&path, &broken).unwrap();
            // must not panic or hang
            match read_anything(&path) {
                Ok(frames) => assert!(frames <= whole.len() as u64),
                Err(error) => {
                    refused += 1;
                    assert!(!error.to_string().is_empty());
                }
            }
        }
        assert!(0 < refused && refused < whole.len(), "{name}: {refused}");
    }
}

#[test]
fn limits_are_checked_before_memory_is_taken() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("clip.y4m");
    let mut limits = VideoLimits::default();
    limits.pictures.max_pixels = 100;
    limits.max_frames = 2;
    let options = OpenOptions { rate: None, limits };
    let opened = |text: &str| {
        std::fs::write(&path, text).unwrap();
        ravec_video::Clip::open(&path, &options)
            .map(|mut clip| while let Ok(Some(_)) = clip.next_frame() {})
    };
    let error = opened("YUV4MPEG2 W99999999999 H99999999999\n").unwrap_err();
    assert!(matches!(error, VideoError::TooManyPixels { .. }), "{error}");
    let error = opened("YUV4MPEG2 W99999999999999999999 H1\n").unwrap_err();
    assert!(matches!(error, VideoError::Damaged { .. }), "{error}");
    assert!(matches!(opened("").unwrap_err(), VideoError::Empty));
    assert!(matches!(
        opened("nothing").unwrap_err(),
        VideoError::UnknownFormat
    ));
    let frames = format!("YUV4MPEG2 W1 H1 Cmono\n{}", "FRAME\nx".repeat(3));
    std::fs::write(&path, frames).unwrap();
    let mut clip = ravec_video::Clip::open(&path, &options).unwrap();
    assert!(clip.next_frame().unwrap().is_some());
    assert!(clip.next_frame().unwrap().is_some());
    assert!(matches!(
        clip.next_frame().unwrap_err(),
        VideoError::TooManyFrames { limit: 2 }
    ));
}

#[test]
fn what_a_format_cannot_hold_is_refused_in_a_sentence() {
    let folder = tempfile::tempdir().unwrap();
    let refused = |name: &str, format: &SinkFormat, options: &CreateOptions| {
        write(&folder.path().join(name), format, options, [])
            .unwrap_err()
            .to_string()
    };
    let plain = colors::<u8>(size(), false);
    assert!(refused("a.gif", &plain, &lossless()).contains("256 colors"));
    assert!(refused("a_%d.jpg", &plain, &lossless()).contains("JPEG"));
    assert!(
        refused("a.y4m", &colors::<u16>(size(), true), &lossless()).contains("numbered pictures")
    );
    assert!(refused("a.xyz", &plain, &lossless()).contains("`xyz`"));
    let mut options = CreateOptions::default();
    options.encode.codec = Some("h264".to_owned());
    assert!(refused("a.y4m", &plain, &options).contains("`codec`"));
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[test]
fn matrices_change_codes_but_not_colors() {
    let image = AnyImage::from(picture(size(), 1));
    let color = |matrix| ColorInfo {
        matrix,
        ..ColorInfo::guess(11)
    };
    let layout = YuvFormat {
        subsampling: Subsampling::S444,
        depth: 12,
        alpha: false,
    };
    let picture = FramePicture::Image(image.clone());
    let first = picture.to_yuv(layout, color(Matrix::Bt601)).into_owned();
    let second = FramePicture::Yuv(first.clone());
    let second = second.to_yuv(layout, color(Matrix::Bt709)).into_owned();
    assert_ne!(first.planes(), second.planes());
    let back: Image<Srgb<u8>> = FramePicture::Yuv(second).into_image().convert();
    assert_eq!(AnyImage::from(back), image);
}

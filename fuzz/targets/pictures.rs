//! Readers of pictures.

use super::{Outcome, limits};
use ravec::raster::AnyImage;
use ravec_media::{
    DecodeError, Picture, Probe, WriteOptions, decode, decode_reduced, encode, probe_data,
};
use std::io::Cursor;

/// The shorter side below which the reduced picture may not fall.
const MIN_SIDE: u32 = 8;

/// Pictures up to this many pixels are also written and read again.
const MAX_REWRITTEN_PX: usize = 1 << 12;

/// Probes, decodes and decodes at reduced size, and compares what the three say.
pub fn read(input: &[u8]) -> Outcome {
    let limits = limits::pictures();
    let probe = probe_data(Cursor::new(input), &limits);
    let decoded = decode(Cursor::new(input), &limits);
    let reduced = decode_reduced(Cursor::new(input), MIN_SIDE, &limits);
    if let Err(DecodeError::Io(error)) = &decoded {
        panic!("bytes in memory cannot fail to be read: {error}");
    }
    if let Ok(picture) = &decoded {
        let probe = probe.as_ref().expect("what can be decoded can be probed");
        judge(picture, probe);
        assert_eq!(picture.image.size(), probe.size);
        match reduced {
            Ok((reduced_probe, reduced)) => {
                assert_eq!(&reduced_probe, probe);
                judge(&reduced, probe);
                judge_reduced(&reduced, probe);
            }
            // beside the whole picture there may be no room for another
            Err(DecodeError::TooManyBytes { .. }) => {}
            Err(error) => panic!("what can be decoded can be decoded smaller: {error}"),
        }
        if picture.image.size().pixels() <= MAX_REWRITTEN_PX {
            judge_rewritten(picture);
        }
    }
    Outcome::of(&decoded)
}

fn judge(picture: &Picture, probe: &Probe) {
    let size = picture.image.size();
    assert!(
        size.pixels() as u64 <= limits::MAX_PIXELS,
        "{size} is above the limit"
    );
    assert_eq!(picture.image.has_alpha(), probe.alpha, "alpha of {probe:?}");
    match &picture.image {
        AnyImage::Linear(image) => {
            for pixel in image.pixels() {
                assert!(pixel.0.iter().all(|v| v.is_finite()), "{pixel:?}");
            }
        }
        AnyImage::LinearAlpha(image) => {
            for pixel in image.pixels() {
                assert!(pixel.0.iter().all(|v| v.is_finite()), "{pixel:?}");
                assert!((0.0..=1.0).contains(&pixel.0[3]), "alpha of {pixel:?}");
            }
        }
        // integers are within their bounds by their type
        _ => {}
    }
}

/// Each side is that of the picture, or a half, a quarter or an eighth of it, rounded up.
fn judge_reduced(reduced: &Picture, probe: &Probe) {
    let (small, large) = (reduced.image.size(), probe.size);
    let is_share = |small: usize, large: usize| {
        [1, 2, 4, 8]
            .iter()
            .any(|factor| large.div_ceil(*factor) == small)
    };
    assert!(
        is_share(small.width(), large.width()) && is_share(small.height(), large.height()),
        "{small} of {large}"
    );
}

/// Whatever was read can be written in its own format, and read again with its size.
fn judge_rewritten(picture: &Picture) {
    let format = picture
        .origin
        .format
        .expect("a picture that was read has a format");
    let mut data = Cursor::new(Vec::new());
    match encode(&mut data, format, picture, &WriteOptions::default()) {
        Ok(_) => {
            data.set_position(0);
            let again = decode(data, &limits::pictures()).expect("what we write we can read");
            assert_eq!(again.image.size(), picture.image.size());
        }
        Err(error) => assert!(error.to_string().len() > 5),
    }
}

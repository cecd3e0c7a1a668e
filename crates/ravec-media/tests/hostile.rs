//! Hostile files: whatever the bytes, reading ends with a picture or an error, and never holds more memory than the
//! limit.
//!
//! Memory is measured by counting every allocation of this test program, so its tests take turns.

use ravec_media::{
    DecodeError, Format, Limits, Picture, SampleKind, WriteOptions, decode, decode_reduced, encode,
    memory_to_decode, probe_data,
};
use ravec_memory::MemoryBudget;
use ravec_raster::{Image, LinearRgb, LinearRgba, Size, Srgb, Srgba};
use std::alloc::{GlobalAlloc, Layout, System};
use std::io::Cursor;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

struct Counting;

static HELD: AtomicUsize = AtomicUsize::new(0);
static PEAK: AtomicUsize = AtomicUsize::new(0);

// Counting needs an allocator of our own, which only hands on to that of the system.
#[expect(
    unsafe_code,
    reason = "an allocator is an unsafe trait; this one only counts"
)]
// SAFETY: every call goes to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let held = HELD.fetch_add(layout.size(), Relaxed) + layout.size();
        PEAK.fetch_max(held, Relaxed);
        // SAFETY: as the caller promises.
        unsafe { System.alloc(layout) }
    }
    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        let held = HELD.fetch_add(layout.size(), Relaxed) + layout.size();
        PEAK.fetch_max(held, Relaxed);
        // SAFETY: as the caller promises.
        unsafe { System.alloc_zeroed(layout) }
    }
    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        HELD.fetch_sub(layout.size(), Relaxed);
        // SAFETY: as the caller promises.
        unsafe { System.dealloc(memory, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

static TURN: Mutex<()> = Mutex::new(());

const LIMIT: usize = 16 << 20;

const MAX_PIXELS: u64 = 1_000_000;

fn limits() -> Limits {
    Limits {
        max_pixels: MAX_PIXELS,
        memory: MemoryBudget::new(LIMIT as u64),
    }
}

/// Decodes within the limits; `Err` with the peak if they are not kept.
fn peak_of(data: &[u8]) -> (Result<Picture, DecodeError>, usize) {
    let before = HELD.load(Relaxed);
    PEAK.store(before, Relaxed);
    let result = decode(Cursor::new(data), &limits());
    (result, PEAK.load(Relaxed) - before)
}

fn check(data: &[u8], what: &str) -> bool {
    let (result, peak) = peak_of(data);
    assert!(peak <= LIMIT, "{what}: {peak} bytes were held");
    if let Ok(picture) = &result {
        assert!(picture.image.size().pixels() as u64 <= MAX_PIXELS);
    }
    let _ = probe_data(Cursor::new(data), &limits());
    result.is_ok()
}

/// Small files of every format and kind of sample.
fn samples() -> Vec<(String, Vec<u8>)> {
    let size = Size::new(13, 9).unwrap();
    let at = |col: usize, row: usize| (col * 19 + row * 7) as u8;
    let mut gray = Picture::from_image(Image::from_fn(size, |c, r| Srgb([at(c, r); 3])));
    gray.origin.gray = true;
    let pictures = [
        gray,
        Picture::from_image(Image::from_fn(size, |c, r| Srgb([at(c, r), at(r, c), 7]))),
        Picture::from_image(Image::from_fn(size, |c, r| {
            Srgba([at(c, r), 9, 7, at(r, c)])
        })),
        Picture::from_image(Image::from_fn(size, |c, r| {
            Srgb([256 * u16::from(at(c, r)); 3])
        })),
        Picture::from_image(Image::from_fn(size, |c, r| {
            LinearRgb([f32::from(at(c, r)); 3])
        })),
        Picture::from_image(Image::from_fn(size, |c, r| {
            LinearRgba([0.5, 2.0, f32::from(at(c, r)), 0.5])
        })),
    ];
    let mut files = Vec::new();
    for format in Format::ALL {
        for (number, picture) in pictures.iter().enumerate() {
            let mut data = Cursor::new(Vec::new());
            encode(&mut data, format, picture, &WriteOptions::default()).unwrap();
            files.push((format!("{format} {number}"), data.into_inner()));
        }
    }
    files
}

/// Panics of decoders are caught and turned into errors; their messages would drown the output of the test.
fn without_panic_messages<T>(work: impl FnOnce() -> T) -> T {
    let hook = std::panic::take_hook();
    std::panic::set_hook(Box::new(|info| {
        let own = info
            .location()
            .is_some_and(|place| place.file().contains("hostile.rs"));
        if own {
            eprintln!("{info}");
        }
    }));
    let result = work();
    std::panic::set_hook(hook);
    result
}

#[test]
fn files_cut_at_any_length_give_a_picture_or_an_error() {
    let _turn = TURN.lock().unwrap();
    without_panic_messages(|| {
        for (name, data) in samples() {
            assert!(check(&data, &name), "{name} as it is");
            for length in 0..data.len() {
                check(&data[..length], &format!("{name} cut at {length}"));
            }
        }
    });
}

#[test]
fn corrupted_files_give_a_picture_or_an_error() {
    let _turn = TURN.lock().unwrap();
    let mut state = 20_240_607u64;
    let mut random = move |below: usize| {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % below
    };
    without_panic_messages(|| {
        for (name, data) in samples() {
            for round in 0..400 {
                let mut broken = data.clone();
                for _ in 0..=random(4) {
                    // half of the damage goes where the lengths and types are
                    let end = if random(2) == 0 {
                        broken.len().min(64)
                    } else {
                        broken.len()
                    };
                    let place = random(end);
                    broken[place] = match random(4) {
                        0 => 0,
                        1 => 0xff,
                        2 => broken[place] ^ (1 << random(8)),
                        _ => random(256) as u8,
                    };
                }
                check(&broken, &format!("{name}, round {round}"));
            }
        }
    });
}

/// A PNG that says it is large and has no pixels.
fn png_header(width: u32, height: u32) -> Vec<u8> {
    let mut chunk = b"IHDR".to_vec();
    chunk.extend_from_slice(&width.to_be_bytes());
    chunk.extend_from_slice(&height.to_be_bytes());
    chunk.extend_from_slice(&[8, 2, 0, 0, 0]);
    let mut data = b"\x89PNG\r\n\x1a\n\0\0\0\x0d".to_vec();
    data.extend_from_slice(&chunk);
    data.extend_from_slice(&crc(&chunk).to_be_bytes());
    // the decoder reads on to the first chunk of pixels
    data.extend_from_slice(b"\0\0\0\0IDAT\x35\xaf\x06\x1e");
    data
}

fn crc(data: &[u8]) -> u32 {
    !data.iter().fold(u32::MAX, |crc, &byte| {
        (0..8).fold(crc ^ u32::from(byte), |crc, _| {
            crc >> 1 ^ if crc & 1 == 1 { 0xedb8_8320 } else { 0 }
        })
    })
}

#[test]
fn a_header_of_ten_thousand_million_pixels_is_refused_by_name() {
    let _turn = TURN.lock().unwrap();
    let data = png_header(100_000, 100_000);
    let error = decode(Cursor::new(&data), &Limits::default()).unwrap_err();
    assert_eq!(
        error.to_string(),
        "the picture has 100000 x 100000 pixels, more than the limit of 400000000 (raise `max_pixels`)"
    );
    let (result, peak) = peak_of(&data);
    assert!(matches!(result, Err(DecodeError::TooManyPixels { .. })));
    assert!(peak < 1 << 20, "{peak}");
    let error = decode(Cursor::new(png_header(20_000, 20_000)), &limits_of_bytes()).unwrap_err();
    assert!(
        error
            .to_string()
            .starts_with("reading the picture needs 1.1 GiB, more"),
        "{error}"
    );
    assert!(
        error
            .to_string()
            .ends_with("more than the limit of 16.0 MiB (raise `max_bytes`)")
    );
}

fn limits_of_bytes() -> Limits {
    Limits {
        max_pixels: u64::MAX,
        ..limits()
    }
}

#[test]
fn large_pictures_of_one_color_meet_the_limit_before_they_are_decoded() {
    let _turn = TURN.lock().unwrap();
    let size = Size::new(3000, 2000).unwrap();
    let picture = Picture::from_image(Image::new(size, Srgb([7u8; 3])));
    for format in Format::ALL {
        let mut data = Cursor::new(Vec::new());
        encode(&mut data, format, &picture, &WriteOptions::default()).unwrap();
        let data = data.into_inner();
        let before = HELD.load(Relaxed);
        PEAK.store(before, Relaxed);
        let error = decode(Cursor::new(&data), &limits_of_bytes()).unwrap_err();
        assert!(
            matches!(error, DecodeError::TooManyBytes { .. }),
            "{format}: {error}"
        );
        assert!(PEAK.load(Relaxed) - before <= LIMIT, "{format}");
    }
}

#[test]
fn the_need_that_is_checked_bounds_the_need_that_is_measured() {
    let _turn = TURN.lock().unwrap();
    let size = Size::new(700, 500).unwrap();
    let noise = |c: usize, r: usize| ((c * 7919 + r * 104_729) ^ (c * r)) as u8;
    let mut gray = Picture::from_image(Image::from_fn(size, |c, r| Srgb([noise(c, r); 3])));
    gray.origin.gray = true;
    let mut wide = Picture::from_image(Image::from_fn(size, |c, r| Srgb([noise(c, r), 1, 2])));
    wide.origin.icc = Some(
        moxcms::ColorProfile::new_display_p3()
            .encode()
            .unwrap()
            .into(),
    );
    let alpha = Picture::from_image(Image::from_fn(size, |c, r| Srgba([noise(c, r), 5, 6, 200])));
    for picture in [gray, wide, alpha] {
        for format in Format::ALL {
            for sample in [SampleKind::U8, SampleKind::U16, SampleKind::F32] {
                let options = WriteOptions {
                    sample: Some(sample),
                    ..WriteOptions::default()
                };
                let mut data = Cursor::new(Vec::new());
                encode(&mut data, format, &picture, &options).unwrap();
                let data = data.into_inner();
                let within = |bytes: u64| Limits {
                    max_pixels: u64::MAX,
                    memory: MemoryBudget::new(bytes),
                };
                let need = memory_to_decode(Cursor::new(&data), None, &within(64 << 20)).unwrap();
                let error = decode(Cursor::new(&data), &within(need - 1)).unwrap_err();
                assert!(
                    matches!(error, DecodeError::TooManyBytes { .. }),
                    "{format}: {error}"
                );
                // decoders have limits of their own for their tables
                let limits = within(need.max(4 << 20));
                let before = HELD.load(Relaxed);
                PEAK.store(before, Relaxed);
                let decoded = decode(Cursor::new(&data), &limits).unwrap();
                let measured = PEAK.load(Relaxed) - before;
                assert_eq!(limits.memory.peak(), need, "{format}");
                let pixels = decoded.image.size().pixels() as u64;
                let held = limits.memory.used();
                assert!(
                    (3 * pixels..=16 * pixels).contains(&held),
                    "{format}: {held}"
                );
                let copy = decoded.clone();
                drop(decoded);
                assert_eq!(limits.memory.used(), held, "a clone keeps it");
                drop(copy);
                assert_eq!(limits.memory.used(), 0);
                // tables of the decoders, of any size of picture
                let slack = 3 << 20;
                assert!(
                    measured as u64 <= need + slack,
                    "{format} {sample:?}: {measured} > {need}"
                );
                // and the check is not absurdly careful: at most four times of what is held
                assert!(
                    need <= 4 * measured as u64 + slack,
                    "{format} {sample:?}: {need} >> {measured}"
                );
            }
        }
    }
}

#[test]
fn photos_that_are_decoded_small_reserve_what_they_hold() {
    let _turn = TURN.lock().unwrap();
    let size = Size::new(1600, 1200).unwrap();
    let noise = |c: usize, r: usize| ((c * 7919 + r * 104_729) ^ (c * r)) as u8;
    let picture = Picture::from_image(Image::from_fn(size, |c, r| Srgb([noise(c, r), 9, 200])));
    let mut data = Cursor::new(Vec::new());
    encode(&mut data, Format::Jpeg, &picture, &WriteOptions::default()).unwrap();
    let data = data.into_inner();
    let limits = Limits {
        max_pixels: u64::MAX,
        memory: MemoryBudget::new(64 << 20),
    };
    let whole = memory_to_decode(Cursor::new(&data), None, &limits).unwrap();
    for min_side in [40, 200, 700] {
        let need = memory_to_decode(Cursor::new(&data), Some(min_side), &limits).unwrap();
        assert!(need <= whole, "{need} of {whole}");
        let share = limits.memory.reserve(need).unwrap().into_budget();
        let within = Limits {
            memory: share,
            ..limits.clone()
        };
        let before = HELD.load(Relaxed);
        PEAK.store(before, Relaxed);
        decode_reduced(Cursor::new(&data), min_side, &within).unwrap();
        let measured = (PEAK.load(Relaxed) - before) as u64;
        assert!(measured <= need + (1 << 20), "{measured} > {need}");
    }
    assert_eq!(limits.memory.used(), 0);
}

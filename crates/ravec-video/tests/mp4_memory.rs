//! Memory for files whose index lies: in proportion to the file, not to its numbers.
#![cfg(feature = "h264")]

use peak_alloc::PeakAlloc;
use ravec_video::VideoLimits;
use ravec_video::mp4::Mp4Source;
use std::io::Cursor;
use std::path::Path;

#[global_allocator]
static MEMORY: PeakAlloc = PeakAlloc;

/// Peak of memory while a file is opened, beyond what was in use.
fn peak_of_opening(bytes: Vec<u8>) -> usize {
    let input = Cursor::new(bytes);
    MEMORY.reset_peak_usage();
    let before = MEMORY.current_usage();
    drop(Mp4Source::open(input, &VideoLimits::default()));
    MEMORY.peak_usage() - before
}

/// One test, so that nothing else allocates meanwhile.
#[test]
fn lying_counts_take_no_memory() {
    let fixture = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/fragments.mp4");
    let fragments = std::fs::read(fixture).unwrap();
    let fixture = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/bframes.mp4");
    let tables = std::fs::read(fixture).unwrap();
    let mut worst = 0.0f64;
    for original in [tables, fragments] {
        let bound = 16 * original.len() + (64 << 10);
        let last = original.len() - 4;
        for at in (0..last).filter(|at| *at < 1500 || *at > last.saturating_sub(1500)) {
            for number in [0xffff_ffff_u32, 0x7fff_ffff, 0x0010_0000] {
                let mut bytes = original.clone();
                bytes[at..at + 4].copy_from_slice(&number.to_be_bytes());
                let peak = peak_of_opening(bytes);
                assert!(
                    peak <= bound,
                    "{peak} bytes for {number:#x} at {at}, at most {bound}"
                );
                worst = worst.max(peak as f64 / original.len() as f64);
            }
        }
    }
    // tables at their densest: four bytes a sample, all of them in the same place of the file
    let count = 200_000u32;
    let dense = dense_file(count);
    let length = dense.len();
    let peak = peak_of_opening(dense);
    println!(
        "worst of changed files {worst:.1}, of dense tables {:.1} times the file",
        peak as f64 / length as f64
    );
    assert!(peak <= 17 * length, "{peak} bytes for a file of {length}");
    assert!(peak >= 4 * length, "the tables were not expanded: {peak}");
    let dense = dense_fragment(count);
    let length = dense.len();
    let peak = peak_of_opening(dense);
    println!(
        "dense fragments {:.1} times the file",
        peak as f64 / length as f64
    );
    assert!(peak <= 40 * length, "{peak} bytes for a file of {length}");
    assert!(peak >= 4 * length, "the fragment was not expanded: {peak}");
    // numbers that need no bytes of their own: samples of one size, in one chunk, in one run
    for size in [1, 4, 5, 100] {
        let file = media_file(u32::MAX, &words(&[0, size, u32::MAX]), &[]);
        let length = file.len();
        let peak = peak_of_opening(file);
        assert!(
            peak <= 17 * length + (16 << 10),
            "{peak} bytes for a file of {length}"
        );
    }
}

fn atom(kind: [u8; 4], body: &[u8]) -> Vec<u8> {
    let mut bytes = (body.len() as u32 + 8).to_be_bytes().to_vec();
    bytes.extend(kind);
    bytes.extend(body);
    bytes
}

fn words(numbers: &[u32]) -> Vec<u8> {
    numbers
        .iter()
        .flat_map(|number| number.to_be_bytes())
        .collect()
}

/// A file whose samples have sizes of their own and share their place.
fn dense_file(count: u32) -> Vec<u8> {
    let mut sizes = words(&[0, 0, count]);
    sizes.extend(words(&[5]).repeat(count as usize));
    media_file(count, &sizes, &[])
}

/// A file whose samples have sizes of their own in a fragment, and no other numbers.
fn dense_fragment(count: u32) -> Vec<u8> {
    let defaults = atom(*b"mvex", &atom(*b"trex", &words(&[0, 0, 1, 10, 5, 0])));
    let mut file = media_file(0, &words(&[0, 0, 0]), &defaults);
    let mut run = words(&[0x200, count]);
    run.extend(words(&[5]).repeat(count as usize));
    let fragment = [atom(*b"tfhd", &words(&[0, 0])), atom(*b"trun", &run)].concat();
    file.extend(atom(*b"moof", &atom(*b"traf", &fragment)));
    file
}

/// A file of one video track with a table of sizes, all of whose samples are in one chunk and one run.
fn media_file(count: u32, sizes: &[u8], more: &[u8]) -> Vec<u8> {
    let table = [
        atom(
            *b"stsd",
            &[words(&[0, 1]), atom(*b"avc1", &[0; 78])].concat(),
        ),
        atom(*b"stts", &words(&[0, 1, count, 1])),
        atom(*b"stsc", &words(&[0, 1, 1, count, 1])),
        atom(*b"stco", &words(&[0, 1, 0])),
        atom(*b"stsz", sizes),
    ]
    .concat();
    let media = [
        atom(*b"mdhd", &words(&[0, 0, 0, 1000, 0, 0])),
        atom(*b"hdlr", b"\0\0\0\0\0\0\0\0vide\0\0\0\0\0\0\0\0\0\0\0\0\0"),
        atom(*b"minf", &atom(*b"stbl", &table)),
    ]
    .concat();
    let track = [atom(*b"tkhd", &[0; 84]), atom(*b"mdia", &media)].concat();
    let index = [
        atom(*b"mvhd", &words(&[0, 0, 0, 1000, 0])),
        atom(*b"trak", &track),
        more.to_vec(),
    ]
    .concat();
    atom(*b"moov", &index)
}

use super::*;
use proptest::prelude::*;

const TRACK: NutTrack = NutTrack {
    width: 4,
    height: 2,
    pixel_aspect: (4, 3),
    time_base: (1, 12800),
    rate: Some((25, 1)),
    fourcc: *b"Y800",
};
const FRAME: usize = 8;

fn written(frames: &[(u64, [u8; FRAME])]) -> Vec<u8> {
    let mut bytes = Vec::new();
    write_headers(&mut bytes, &TRACK).unwrap();
    for (pts, content) in frames {
        write_head(&mut bytes, *pts, FRAME as u64).unwrap();
        bytes.extend(content);
    }
    bytes
}

/// Time stamps and contents.
type Frames = Vec<(i64, Vec<u8>)>;

/// All frames of a stream, or the reason why there are no more.
fn read(bytes: &[u8]) -> (Frames, Result<(), NutError>) {
    let mut frames = Vec::new();
    let result = (|| {
        let Some(mut reader) = NutReader::open(bytes)? else {
            return Ok(());
        };
        while let Some(head) = reader.next_head(FRAME as u64)? {
            let (mut one, mut two) = ([0; 3], [0; FRAME - 3]);
            reader.read_content(head, &mut [&mut one, &mut two])?;
            frames.push((head.pts, [&one[..], &two].concat()));
        }
        Ok(())
    })();
    (frames, result)
}

#[test]
fn what_is_written_is_read() {
    let frames = [(0, [1; 8]), (512, [2; 8]), (513, [3; 8]), (1 << 40, [4; 8])];
    let (found, end) = read(&written(&frames));
    end.unwrap();
    let truth = frames.map(|(pts, content)| (pts as i64, content.to_vec()));
    assert_eq!(found, truth);
    let bytes = written(&[]);
    assert_eq!(
        NutReader::open(&bytes[..]).unwrap().unwrap().time_base(),
        (1, 12800)
    );
}

#[test]
fn a_stream_that_is_cut_anywhere_gives_its_whole_frames() {
    let frames = [(5, [1; 8]), (600, [2; 8]), (700, [3; 8])];
    let bytes = written(&frames);
    let whole = bytes.len();
    for length in 0..whole {
        let (found, end) = read(&bytes[..length]);
        assert!(found.len() < 3);
        for (found, truth) in found.iter().zip(frames) {
            assert_eq!(found, &(truth.0 as i64, truth.1.to_vec()));
        }
        // an end between packets cannot be seen; all others are errors
        if end.is_ok() {
            let next = &bytes[length..];
            assert!(
                length == 0 || next.starts_with(b"N") || next.starts_with(&[0]),
                "{length}"
            );
        }
    }
}

/// A main header by its numbers, with one track and the clock 1/25.
fn with_codes(codes: &[u64], headers: &[&[u8]]) -> Vec<u8> {
    let mut main = Vec::new();
    for value in [3, 1, 65536, 1, 1, 25].iter().chain(codes) {
        push_v(&mut main, *value);
    }
    push_v(&mut main, headers.len() as u64);
    for header in headers {
        push_v(&mut main, header.len() as u64);
        main.extend(*header);
    }
    push_v(&mut main, 0);
    let mut bytes = FILE_ID.to_vec();
    write_packet(&mut bytes, MAIN, main).unwrap();
    let mut stream = Vec::new();
    for value in [0, 0, 0, 0, 7, 99, 0, 1, 0, 4, 2, 1, 1, 0] {
        push_v(&mut stream, value);
    }
    write_packet(&mut bytes, STREAM, stream).unwrap();
    bytes
}

#[test]
fn short_forms_of_heads_are_understood() {
    // code 0: the next tick (1 is +1), 8 bytes; codes from 1: a time stamp by its low bits, and a header left out
    let short = [flag::KEY, 6, 1, 1, 0, 8, 0, 1];
    let elided = [flag::CODED_PTS, 8, 1, 1, 0, 8, 0, 1, 0, 1];
    let rest = [flag::INVALID, 6, 1, 1, 0, 0, 0, 253];
    let codes = [&short[..], &elided, &rest].concat();
    let mut bytes = with_codes(&codes, &[b"abcde"]);
    bytes.push(0);
    bytes.extend(b"11111111");
    bytes.push(1);
    push_v(&mut bytes, 5);
    bytes.extend(b"fgh");
    bytes.push(0);
    bytes.extend(b"22222222");
    let (found, end) = read(&bytes);
    end.unwrap();
    let truth = [(1, "11111111"), (5, "abcdefgh"), (6, "22222222")];
    let truth = truth.map(|(pts, content)| (pts, content.as_bytes().to_vec()));
    assert_eq!(found, truth);
}

#[test]
fn low_bits_of_a_stamp_mean_the_nearest_one() {
    for last in [0, 63, 64, 1000, 1 << 40] {
        for pts in (last - 63).max(0)..last + 64 {
            assert_eq!(full_pts(pts as u64 & 127, 7, last), Some(pts), "{last}");
            assert_eq!(full_pts(pts as u64 + 128, 7, last), Some(pts));
        }
    }
}

#[test]
fn sizes_that_lie_are_refused_before_memory_is_taken() {
    let frame_size = |size| {
        let mut bytes = written(&[]);
        write_head(&mut bytes, 0, size).unwrap();
        bytes.extend([0; FRAME]);
        read(&bytes).1
    };
    for size in [0, 7, 9, 1 << 40, (1 << 63) - 1] {
        assert!(
            matches!(frame_size(size), Err(NutError::FrameSize { found, .. }) if found == size)
        );
    }
    let mut header = FILE_ID.to_vec();
    header.extend(MAIN.to_be_bytes());
    push_v(&mut header, 1 << 50);
    header.extend([0; 100]);
    assert!(matches!(
        read(&header).1,
        Err(NutError::Damaged("a header is too long"))
    ));
    // a packet to skip that is longer than the stream
    let mut skipped = written(&[]);
    skipped.extend(INFO.to_be_bytes());
    push_v(&mut skipped, 1 << 60);
    assert!(matches!(read(&skipped).1, Err(NutError::Io(_))));
    // numbers without an end
    let mut endless = written(&[]);
    endless.push(0);
    endless.extend([0xFF; 64]);
    assert!(matches!(
        read(&endless).1,
        Err(NutError::Damaged("a number is too long"))
    ));
}

proptest! {
    #[test]
    fn no_bytes_make_the_reader_panic(bytes in proptest::collection::vec(any::<u8>(), 0..600)) {
        let _ = read(&bytes);
    }

    #[test]
    fn no_change_of_a_stream_makes_the_reader_panic(
        changes in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8),
    ) {
        let mut bytes = written(&[(5, [1; 8]), (600, [2; 8]), (700, [3; 8])]);
        for (at, value) in changes {
            let at = at.index(bytes.len());
            bytes[at] = value;
        }
        let (frames, _) = read(&bytes);
        prop_assert!(frames.len() <= 3 + bytes.len() / 2);
    }
}

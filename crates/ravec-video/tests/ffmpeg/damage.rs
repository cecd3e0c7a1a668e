//! Clips that are cut, and programs that stop.

use crate::scene::{clips, frames, has_ffmpeg, open, options, read_all, sink_format, write, yuv};
use ravec_raster::Size;
use ravec_video::{FrameSource, Rational, Subsampling, VideoError};

#[test]
fn clips_that_are_cut_give_whole_frames_and_the_reason() {
    if !has_ffmpeg() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    for path in clips() {
        let extension = path.extension().unwrap().to_owned();
        let bytes = std::fs::read(&path).unwrap();
        let cut = folder.path().join("cut").with_extension(&extension);
        std::fs::write(&cut, &bytes[..bytes.len() * 6 / 10]).unwrap();
        let name = path.file_name().unwrap().display();
        let mut source = match open(&cut) {
            Ok(source) => source,
            Err(VideoError::Damaged { .. } | VideoError::UnknownFormat) if extension == "mp4" => {
                continue;
            }
            Err(error) => panic!("{name}: {error}"),
        };
        let found = read_all(&mut source);
        let mut whole = open(&path).unwrap();
        for (number, found) in found.iter().enumerate() {
            let truth = whole
                .next_frame()
                .unwrap()
                .expect("the whole clip is longer");
            assert!(
                found.picture == truth.picture,
                "{name}: frame {number} is not whole"
            );
            assert_eq!(found.time.start, truth.time.start, "{name}: frame {number}");
        }
        let rest = read_all(&mut whole).len();
        assert!(
            found.len() > rest / 2 && rest > 0,
            "{name}: {} of {}",
            found.len(),
            found.len() + rest
        );
        let damage = source
            .damage()
            .unwrap_or_else(|| panic!("{name}: the cut is not noticed"));
        assert_eq!(damage.frames, found.len() as u64);
        assert!(
            !damage.reason.contains("file:") && !damage.reason.is_empty(),
            "{name}: {}",
            damage.reason
        );
        // the end stays where it is
        source.seek(damage.frames).unwrap();
        assert_eq!(source.next_frame().unwrap(), None);
        source.seek(found.len() as u64 / 2).unwrap();
        assert_eq!(
            source.next_frame().unwrap().as_ref(),
            found.get(found.len() / 2),
            "{name}"
        );
    }
}

#[test]
fn a_cut_at_any_place_makes_no_panic_and_no_wrong_frame() {
    if !has_ffmpeg() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let format = sink_format(
        Size::new(32, 16).unwrap(),
        yuv(Subsampling::S420, 8, false),
        Rational::new(1, 25).unwrap(),
    );
    let truth = frames(&format, &[0, 1, 2, 3, 4, 5, 6, 7]);
    for extension in ["mkv", "avi", "nut"] {
        let path = folder.path().join(format!("whole.{extension}"));
        write(&path, &format, &options("ffv1", true), &truth, 9).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        let cut = folder.path().join(format!("cut.{extension}"));
        for part in 0..14 {
            std::fs::write(&cut, &bytes[..bytes.len() * part / 14]).unwrap();
            match open(&cut) {
                Ok(mut source) => {
                    for (found, truth) in read_all(&mut source).iter().zip(&truth) {
                        assert!(found.picture == truth.picture, "{extension} {part}");
                    }
                }
                Err(error) => {
                    let message = error.to_string();
                    assert!(!message.contains('\n') && message.len() < 300, "{message}");
                    assert_eq!(matches!(error, VideoError::Empty), part == 0, "{message}");
                }
            }
        }
    }
}

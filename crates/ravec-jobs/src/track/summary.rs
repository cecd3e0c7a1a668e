//! Quality of a track, for the report.

use super::file::TrackFile;
use crate::error::JobError;
use crate::report::Report;
use ravec::planar::track::{Track, TrackState, TrackedFrame};
use serde_json::{Value, json};
use std::path::Path;

/// Numbers of the frames in which the plane is lost, as ranges from the first to the last of each.
pub(crate) fn lost_ranges(track: &Track) -> Vec<[u64; 2]> {
    let mut ranges: Vec<[u64; 2]> = Vec::new();
    for (index, frame) in (track.first..).zip(&track.frames) {
        if frame.state != TrackState::Lost {
            continue;
        }
        match ranges.last_mut() {
            Some([_, last]) if *last + 1 == index => *last = index,
            _ => ranges.push([index, index]),
        }
    }
    ranges
}

/// Ranges that a warning lists at most.
const MAX_LISTED: usize = 20;

/// Ranges of frames in words: `41 to 53, 80`.
pub(crate) fn in_words(ranges: &[[u64; 2]]) -> String {
    let words = |&[first, last]: &[u64; 2]| {
        if first == last {
            first.to_string()
        } else {
            format!("{first} to {last}")
        }
    };
    let mut list: Vec<_> = ranges.iter().take(MAX_LISTED).map(words).collect();
    if ranges.len() > MAX_LISTED {
        list.push(format!("and {} more ranges", ranges.len() - MAX_LISTED));
    }
    list.join(", ")
}

fn count(track: &Track, state: TrackState) -> usize {
    let frames = track.frames.iter();
    frames.filter(|frame| frame.state == state).count()
}

/// Median and maximum of the predicted deviations of frames that are not lost.
fn sigmas<'a>(frames: impl Iterator<Item = &'a TrackedFrame>) -> [f64; 2] {
    let found = frames.filter(|frame| frame.state != TrackState::Lost);
    let mut sigmas: Vec<f64> = found.map(TrackedFrame::sigma_px).collect();
    sigmas.sort_by(f64::total_cmp);
    let median = sigmas.get(sigmas.len() / 2).copied().unwrap_or(0.0);
    [median, sigmas.last().copied().unwrap_or(0.0)]
}

/// Records figures, result and warnings.
///
/// # Errors
/// [`JobError::TrackLost`] if a plane is lost in all frames but the reference.
pub(super) fn record(file: &TrackFile, input: &Path, report: &mut Report) -> Result<(), JobError> {
    let several = file.planes.len() > 1;
    for (at, track) in file.planes.iter().enumerate() {
        let lost = lost_ranges(track);
        if track.frames.len() > 1 && count(track, TrackState::Lost) + 1 >= track.frames.len() {
            return Err(JobError::TrackLost {
                path: input.to_path_buf(),
            });
        }
        if !lost.is_empty() {
            let name = if several {
                format!("plane {} is", at + 1)
            } else {
                "the plane is".to_owned()
            };
            let plural = if lost.len() > 1 || lost[0][0] != lost[0][1] {
                "s"
            } else {
                ""
            };
            report.warn(format!("{name} lost in frame{plural} {}", in_words(&lost)));
        }
    }
    let total = |of: &dyn Fn(&Track) -> usize| file.planes.iter().map(of).sum::<usize>() as f64;
    let [median, max] = sigmas(file.planes.iter().flat_map(|plane| &plane.frames));
    for (name, figure) in [
        ("planes", file.planes.len() as f64),
        ("frames", total(&|plane| plane.frames.len())),
        ("tracked", total(&|plane| count(plane, TrackState::Tracked))),
        ("weak", total(&|plane| count(plane, TrackState::Weak))),
        ("lost", total(&|plane| count(plane, TrackState::Lost))),
        ("sigma_px_median", median),
        ("sigma_px_max", max),
    ] {
        report.figures.insert(name, figure);
    }
    let first_lost = file.planes.iter().filter_map(first_lost).min();
    if let Some(first) = first_lost {
        report.figures.insert("first_lost", first as f64);
    }
    let planes: Vec<_> = file
        .planes
        .iter()
        .map(|plane| described(plane, file))
        .collect();
    report.result = Some(json!({ "pixel_centers": file.centers, "planes": planes }));
    Ok(())
}

fn first_lost(track: &Track) -> Option<u64> {
    Some(lost_ranges(track).first()?[0])
}

fn described(track: &Track, file: &TrackFile) -> Value {
    let [median, max] = sigmas(track.frames.iter());
    json!({
        "quad": file.centers.write_all(track.quad).map(|corner| corner.to_array()),
        "reference": track.reference,
        "first": track.first,
        "frames": track.frames.len(),
        "tracked": count(track, TrackState::Tracked),
        "weak": count(track, TrackState::Weak),
        "lost": count(track, TrackState::Lost),
        "lost_frames": lost_ranges(track),
        "sigma_px_median": median,
        "sigma_px_max": max,
    })
}

#[cfg(test)]
mod tests {
    use super::super::file::tests::track;
    use super::*;
    use crate::pixel_centers::PixelCenters;

    #[test]
    fn ranges_of_lost_frames_are_named() {
        let mut lost = track();
        let frame = lost.frames[2].clone();
        lost.frames
            .extend([frame.clone(), lost.frames[0].clone(), frame]);
        assert_eq!(lost_ranges(&lost), [[7, 8], [10, 10]]);
        let file = TrackFile {
            centers: PixelCenters::Half,
            planes: vec![lost],
        };
        let mut report = Report::new("track", &());
        record(&file, Path::new("a.mp4"), &mut report).unwrap();
        assert_eq!(report.warnings, ["the plane is lost in frames 7 to 8, 10"]);
        assert_eq!(report.figures["first_lost"], 7.0);
        assert_eq!(report.figures["lost"], 3.0);
        let many: Vec<_> = (0..30).map(|at| [2 * at, 2 * at]).collect();
        assert!(in_words(&many).ends_with("38, and 10 more ranges"));
    }

    #[test]
    fn a_plane_that_is_never_found_again_is_a_failure() {
        let mut lost = track();
        lost.frames[0].state = TrackState::Lost;
        let file = TrackFile {
            centers: PixelCenters::Half,
            planes: vec![track(), lost],
        };
        let error = record(&file, Path::new("a.mp4"), &mut Report::new("track", &())).unwrap_err();
        assert!(matches!(error, JobError::TrackLost { .. }));
        assert_eq!(error.kind(), crate::ErrorKind::Failure);
    }
}

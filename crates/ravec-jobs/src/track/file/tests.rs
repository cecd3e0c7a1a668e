//! Files of tracks, whole and broken.

use super::*;

fn frame(shift: f64, state: TrackState) -> TrackedFrame {
    let map = Homography::from_matrix(glam::DMat3::from_cols(
        glam::dvec3(1.01, 0.02, 1e-5),
        glam::dvec3(-0.03, 0.98, -2e-5),
        glam::dvec3(shift, 2.0, 1.0),
    ))
    .unwrap();
    let mut covariance = [[0.0; 8]; 8];
    for (k, row) in covariance.iter_mut().enumerate() {
        row[k] = 1e-4 * (k + 1) as f64;
    }
    TrackedFrame {
        state,
        frame_from_reference: map,
        corners: quad().map(|corner| map.apply(corner)),
        covariance,
        inlier_share: 0.9,
        visible: 1.0,
        residual: 0.01,
        gain: 1.1,
        bias: -0.02,
        keyframe: 0,
    }
}

fn quad() -> [DVec2; 4] {
    [
        dvec2(100.25, 80.5),
        dvec2(500.0, 90.0),
        dvec2(490.0, 400.0),
        dvec2(90.0, 390.0),
    ]
}

pub(in crate::track) fn track() -> Track {
    Track {
        width: 640,
        height: 480,
        quad: quad(),
        reference: 6,
        first: 5,
        frames: vec![
            frame(-3.0, TrackState::Tracked),
            frame(0.0, TrackState::Weak),
            frame(4.0, TrackState::Lost),
        ],
    }
}

/// The largest difference of corners and of points through the maps.
fn difference(a: &Track, b: &Track) -> f64 {
    assert_eq!(a.frames.len(), b.frames.len());
    assert_eq!(
        (a.width, a.height, a.reference, a.first),
        (b.width, b.height, b.reference, b.first)
    );
    let mut most = 0.0f64;
    for (a, b) in a.frames.iter().zip(&b.frames) {
        assert_eq!((a.state, a.keyframe), (b.state, b.keyframe));
        assert_eq!(a.covariance, b.covariance);
        for k in 0..4 {
            let point = quad()[k];
            most = most.max(a.corners[k].distance(b.corners[k])).max(
                a.frame_from_reference
                    .apply(point)
                    .distance(b.frame_from_reference.apply(point)),
            );
        }
    }
    most
}

#[test]
fn a_track_comes_back_from_both_conventions_and_from_lists_of_planes() {
    for centers in [PixelCenters::Half, PixelCenters::Integer] {
        for planes in [1, 2] {
            let file = TrackFile {
                centers,
                planes: vec![track(); planes],
            };
            let text = file.to_json();
            let found = TrackFile::from_json(&text, 1000).unwrap();
            assert_eq!((found.centers, found.planes.len()), (centers, planes));
            for plane in &found.planes {
                assert!(difference(plane, &track()) < 1e-9, "{text}");
            }
        }
    }
}

#[test]
fn the_lists_of_a_single_plane_are_at_the_top_and_integers_are_half_a_pixel_less() {
    let json = |centers| -> serde_json::Value {
        let planes = vec![track()];
        serde_json::from_str(&TrackFile { centers, planes }.to_json()).unwrap()
    };
    let (half, integer) = (json(PixelCenters::Half), json(PixelCenters::Integer));
    assert_eq!(half["corners"].as_array().unwrap().len(), 3);
    assert_eq!(half["frame_from_reference"][1].as_array().unwrap().len(), 9);
    assert_eq!(half["state"][2], "lost");
    assert_eq!(half["quad"][0], 100.25);
    assert_eq!(integer["quad"][0], 99.75);
    assert_eq!(integer["pixel_centers"], "integer");
    for k in 0..8 {
        let (a, b) = (&half["corners"][0][k], &integer["corners"][0][k]);
        assert!((a.as_f64().unwrap() - b.as_f64().unwrap() - 0.5).abs() < 1e-12);
    }
}

#[test]
fn broken_files_are_refused_with_a_sentence() {
    let text = TrackFile {
        centers: PixelCenters::Half,
        planes: vec![track()],
    }
    .to_json();
    let whole: serde_json::Value = serde_json::from_str(&text).unwrap();
    let refused = |change: &dyn Fn(&mut serde_json::Value), part: &str| {
        let mut value = whole.clone();
        change(&mut value);
        let error = TrackFile::from_json(&value.to_string(), 1000).unwrap_err();
        assert!(error.contains(part), "no `{part}` in: {error}");
    };
    refused(&|v| v["format"] = "csv".into(), "it is no track");
    refused(&|v| v["version"] = 7.into(), "version 1");
    refused(&|v| v["width"] = 0.into(), "0 x 480");
    refused(&|v| v["more"] = 1.into(), "unknown field `more`");
    refused(
        &|v| v["state"] = serde_json::json!(["tracked"]),
        "`state` has 1 entries",
    );
    refused(
        &|v| v["state"][0] = "found".into(),
        "unknown variant `found`",
    );
    refused(
        &|v| v["corners"] = serde_json::json!([]),
        "`corners` is missing",
    );
    refused(&|v| v["corners"][1][3] = 1e12.into(), "frame 6: `corners`");
    refused(
        &|v| v["frame_from_reference"][2] = vec![0; 9].into(),
        "frame 7:",
    );
    refused(&|v| v["covariance"][0] = vec![0; 63].into(), "63 numbers");
    refused(
        &|v| v["covariance"][0][0] = (-1).into(),
        "negative variance",
    );
    refused(&|v| v["visible"][0] = 2.into(), "`visible` is 2");
    refused(&|v| v["reference"] = 9.into(), "reference frame 9");
    refused(&|v| v["first"] = u64::MAX.into(), "reference frame");
    refused(&|v| v["quad"] = vec![1; 8].into(), "no rectangle");
    refused(
        &|v| v["quad"] = serde_json::Value::Null,
        "`quad` is missing",
    );
    refused(&|v| v["planes"] = serde_json::json!([]), "beside `planes`");
    let few = TrackFile::from_json(&text, 2).unwrap_err();
    assert!(few.contains("more than the 2"), "{few}");
    for text in [
        "",
        "[]",
        "{",
        "{}",
        "null",
        "{\"planes\":[{\"planes\":[]}]}",
    ] {
        assert!(TrackFile::from_json(text, 1000).is_err(), "{text}");
    }
}

/// Every byte changed and every prefix: read or refused, without a panic.
#[test]
fn no_bytes_break_the_reader() {
    let mut short = track();
    short.frames.truncate(2);
    let text = TrackFile {
        centers: PixelCenters::Integer,
        planes: vec![short],
    }
    .to_json();
    let bytes = text.as_bytes();
    for at in (0..bytes.len()).step_by(7) {
        let _ = TrackFile::from_json(&text[..at], 1000);
        for byte in *b"0-e\"]" {
            let mut changed = bytes.to_vec();
            changed[at] = byte;
            let _ = TrackFile::from_json(std::str::from_utf8(&changed).unwrap(), 1000);
        }
    }
}

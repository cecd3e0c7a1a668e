//! Refused inputs with their messages, and the latency of cancellation.

use glam::DVec3;
use ravec_mesh::TriMesh;
use ravec_offset::{OffsetError, OffsetParams, OpenRule, Side, offset};
use ravec_progress::{Cancelled, Progress};
use ravec_scenes::solids::{cuboid, icosphere, sheet, torus};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::Duration;

fn params(distance: f64, tolerance: f64, side: Side) -> OffsetParams {
    OffsetParams {
        distance,
        tolerance,
        side,
        simplify: false,
        ..OffsetParams::default()
    }
}

/// The error of an offset that must not be.
fn refusal(mesh: &TriMesh, params: &OffsetParams) -> OffsetError {
    offset(mesh, params, &Progress::none())
        .map(|found| found.report)
        .unwrap_err()
}

fn cube() -> TriMesh {
    cuboid(DVec3::ONE).mesh
}

#[test]
fn a_mesh_without_triangles_has_no_offset() {
    let nothing = TriMesh::new(vec![DVec3::ZERO, DVec3::X], Vec::new()).unwrap();
    for side in [Side::Both, Side::Outer, Side::Inner, Side::Shell] {
        let error = refusal(&nothing, &params(0.1, 0.01, side));
        assert_eq!(error, OffsetError::NoTriangles);
    }
}

#[test]
fn a_distance_is_a_number_above_0() {
    for distance in [0.0, -0.1, f64::INFINITY, f64::NEG_INFINITY] {
        let error = refusal(&cube(), &params(distance, 0.01, Side::Both));
        assert_eq!(error, OffsetError::Distance { got: distance });
        assert!(error.to_string().contains(&distance.to_string()), "{error}");
    }
    let error = refusal(&cube(), &params(f64::NAN, 0.01, Side::Both));
    assert!(matches!(error, OffsetError::Distance { got } if got.is_nan()));
}

#[test]
fn a_tolerance_is_above_what_numbers_hold_and_below_half_the_distance() {
    for tolerance in [0.0, -0.01, 0.05, 1.0, f64::INFINITY, 1e-9, 5e-324] {
        let error = refusal(&cube(), &params(0.1, tolerance, Side::Both));
        let OffsetError::Tolerance { got, least, most } = error else {
            panic!("{error}");
        };
        assert_eq!((got, most), (tolerance, 0.05));
        assert!(least > 0.0 && least < 1e-4, "{least}");
        assert!(!(tolerance >= least && tolerance < most));
    }
    let error = refusal(&cube(), &params(0.1, f64::NAN, Side::Both));
    assert!(matches!(error, OffsetError::Tolerance { got, .. } if got.is_nan()));
    // far too far away to keep apart what is this close
    let error = refusal(&cube(), &params(1e12, 1e-3, Side::Both));
    assert!(matches!(error, OffsetError::Tolerance { .. }), "{error}");
}

#[test]
fn the_limits_in_a_message_can_be_taken_at_their_word() {
    let mesh = cuboid(DVec3::new(3.7, 0.3, 1.1)).mesh;
    for (distance, tolerance) in [(0.123_456_789_012, 1e-9), (7.77e-5, 1e-12), (2e3, 1e-5)] {
        let asked = params(distance, tolerance, Side::Both);
        let OffsetError::Tolerance { least, .. } = refusal(&mesh, &asked) else {
            panic!("not refused for its tolerance: {asked:?}");
        };
        let text = refusal(&mesh, &asked).to_string();
        let named = text.split("at least ").nth(1).unwrap();
        let named: f64 = named.split(' ').next().unwrap().parse().unwrap();
        assert_eq!(named, least, "{text}");
        assert!(
            text.split([' ', ',']).all(|word| word.len() <= 11),
            "{text}"
        );
        // what it says is enough: only the caller's wish ends that
        let progress = Progress::none();
        progress.cancel();
        let enough = params(distance, named, Side::Both);
        let error = offset(&mesh, &enough, &progress).unwrap_err();
        assert_eq!(error, OffsetError::Cancelled(Cancelled));
    }
}

#[test]
fn a_distance_beyond_what_can_be_reckoned_with_is_refused_by_its_size() {
    let point = TriMesh::new(vec![DVec3::ONE; 3], vec![[0, 1, 2]]).unwrap();
    for (mesh, distance) in [(cube(), 1e300), (point, 1e-50)] {
        let error = refusal(&mesh, &params(distance, 0.1 * distance, Side::Both));
        assert_eq!(error, OffsetError::DistanceSize { got: distance });
        assert!(error.to_string().contains(&format!("{distance:e}")));
    }
}

#[test]
fn a_distance_that_leaves_no_room_for_a_tolerance_is_refused_and_the_least_is_named() {
    for mesh in [cube(), cuboid(DVec3::ONE).shifted(DVec3::splat(1e9)).mesh] {
        let asked = params(1e-9, 1e-10, Side::Outer);
        let error = refusal(&mesh, &asked);
        let OffsetError::DistanceTooSmall { got: 1e-9, least } = error else {
            panic!("{error}");
        };
        assert!(least > 1e-9);
        // a little above it a tolerance just below half of it is possible
        let (distance, progress) = (1.001 * least, Progress::none());
        progress.cancel();
        let enough = params(distance, 0.4999 * distance, Side::Both);
        let error = offset(&mesh, &enough, &progress).unwrap_err();
        assert_eq!(error, OffsetError::Cancelled(Cancelled), "{enough:?}");
    }
}

/// There, numbers are about 1e-4 apart.
#[test]
fn a_tolerance_that_coordinates_far_from_the_origin_cannot_hold_is_refused() {
    let far = cuboid(DVec3::ONE)
        .shifted(DVec3::new(1e12, -1e12, 1e12))
        .mesh;
    for side in [Side::Both, Side::Inner] {
        let error = refusal(&far, &params(0.1, 0.001, side));
        assert!(
            matches!(error, OffsetError::DistanceTooSmall { .. }),
            "{error}"
        );
        let error = refusal(&far, &params(10.0, 0.001, side));
        assert!(matches!(error, OffsetError::Tolerance { .. }), "{error}");
    }
}

#[test]
fn a_normal_deviation_is_above_0_and_at_most_a_right_angle() {
    for degrees in [0.0, -4.0, 90.5, f64::INFINITY, f64::NAN] {
        let asked = OffsetParams {
            max_normal_deviation_deg: Some(degrees),
            ..params(0.1, 0.01, Side::Both)
        };
        let error = refusal(&cube(), &asked);
        let OffsetError::NormalDeviation { got } = error else {
            panic!("{error}");
        };
        assert_eq!(got.to_bits(), degrees.to_bits());
    }
}

#[test]
fn an_open_sheet_has_no_inside() {
    let sheet = sheet(2.0, 1.0, 4, 2);
    for side in [Side::Inner, Side::Shell] {
        let error = refusal(&sheet.mesh, &params(0.1, 0.01, side));
        assert_eq!(error, OffsetError::NotClosed { boundary_edges: 12 });
    }
    let open_sides = [Side::Both, Side::Outer];
    for side in open_sides {
        assert!(offset(&sheet.mesh, &params(0.1, 0.01, side), &Progress::none()).is_ok());
    }
}

#[test]
fn nothing_is_farther_inside_than_the_middle() {
    for (mesh, distance) in [
        (cube(), 0.51),
        (icosphere(1.0, 2).mesh, 1.01),
        (torus(1.0, 0.3, 24, 12).mesh, 0.31),
    ] {
        for side in [Side::Inner, Side::Shell] {
            let error = refusal(&mesh, &params(distance, 0.01 * distance, side));
            assert_eq!(error, OffsetError::Empty { distance });
        }
    }
}

#[test]
fn what_is_cancelled_before_it_begins_does_not_begin() {
    let progress = Progress::none();
    progress.cancel();
    for side in [Side::Both, Side::Outer, Side::Inner, Side::Shell] {
        let error = offset(&cube(), &params(0.1, 0.01, side), &progress).unwrap_err();
        assert_eq!(error, OffsetError::Cancelled(Cancelled));
    }
}

/// Cancelled when the first phase begins, the second and so on, until the work is done before it is.
#[test]
fn work_that_is_cancelled_in_any_phase_begins_no_other() {
    let solid = torus(1.0, 0.4, 12, 8).mesh;
    let mut ended = 0;
    for nth in 0.. {
        let (reported, shared) = (Arc::new(AtomicUsize::new(0)), Arc::new(OnceLock::new()));
        let (count, handle) = (Arc::clone(&reported), Arc::clone(&shared));
        let progress = Progress::new(move |update| {
            if update.done == 0 && count.fetch_add(1, Ordering::Relaxed) == nth {
                handle.get().map(Progress::cancel);
            }
        });
        shared.set(progress.clone()).unwrap();
        let one = OffsetParams {
            simplify: true,
            ..params(0.2, 0.05, Side::Outer)
        };
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
        let result = pool.unwrap().install(|| offset(&solid, &one, &progress));
        if reported.load(Ordering::Relaxed) <= nth {
            assert!(result.is_ok());
            break;
        }
        assert_eq!(result.unwrap_err(), OffsetError::Cancelled(Cancelled));
        assert_eq!(reported.load(Ordering::Relaxed), nth + 1);
        ended += 1;
    }
    assert!(ended > 10, "{ended}");
}

/// Every step over a whole mesh looks whether it is still wanted; here each look in turn, or nearly, is reported that it is not.
#[test]
fn work_that_is_cancelled_at_any_look_ends_with_that() {
    let solid = torus(1.0, 0.4, 16, 10).mesh;
    let tent = vec![
        DVec3::new(0.0, 0.0, 0.0),
        DVec3::new(1.0, 0.0, 0.0),
        DVec3::new(1.0, 1.0, 0.0),
        DVec3::new(0.0, 1.0, 0.0),
        DVec3::new(0.5, 0.5, 0.4),
    ];
    let tent = TriMesh::new(tent, vec![[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]).unwrap();
    let simplified = |side| OffsetParams {
        simplify: true,
        ..params(0.2, 0.05, side)
    };
    let thickened = OffsetParams {
        open: OpenRule::Thicken,
        ..simplified(Side::Both)
    };
    for (mesh, asked) in [
        (&solid, simplified(Side::Outer)),
        (&solid, simplified(Side::Shell)),
        (&tent, thickened),
    ] {
        let (mut look, mut ended) = (1_u64, 0);
        while let Err(error) = offset(mesh, &asked, &Progress::cancelled_at(look)) {
            assert_eq!(error, OffsetError::Cancelled(Cancelled), "look {look}");
            ended += 1;
            look += look.div_ceil(3);
        }
        assert!(ended > 20, "{ended}");
    }
}

/// Can only fail by taking much longer than all other tests together: the whole work is minutes long.
#[test]
fn work_that_is_cancelled_from_another_thread_ends() {
    let solid = torus(1.0, 0.4, 96, 48);
    for delay_ms in [1, 30, 200] {
        let progress = Progress::none();
        let fine = params(0.2, 2e-5, Side::Both);
        let result = std::thread::scope(|scope| {
            let work = scope.spawn(|| offset(&solid.mesh, &fine, &progress));
            std::thread::sleep(Duration::from_millis(delay_ms));
            progress.cancel();
            work.join().expect("the work does not panic")
        });
        assert_eq!(result.unwrap_err(), OffsetError::Cancelled(Cancelled));
    }
}

#[test]
fn memory_that_the_mesh_itself_takes_is_not_enough() {
    let params = OffsetParams {
        memory_bytes: Some(10 << 20),
        ..params(0.1, 0.01, Side::Both)
    };
    let error = refusal(&cube(), &params);
    assert!(matches!(error, OffsetError::Memory { got, .. } if got == 10 << 20));
    let sentence = "10 MiB of memory are not enough for this mesh: it takes at least 65";
    assert_eq!(error.to_string(), sentence);
}

#[test]
fn limited_memory_gives_the_same_surface() {
    let free = params(0.1, 0.01, Side::Outer);
    let limited = OffsetParams {
        memory_bytes: Some(65 << 20),
        ..free.clone()
    };
    let [free, limited] =
        [free, limited].map(|params| offset(&cube(), &params, &Progress::none()).unwrap());
    assert_eq!(free.mesh, limited.mesh);
}

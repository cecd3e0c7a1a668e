//! Surfaces for files of 32-bit floats: what is said of them has to hold for what is read from such a file.

mod support;

use glam::{DQuat, DVec3};
use ravec_mesh::{CheckParams, TriMesh, check};
use ravec_offset::{Coordinates, OffsetError, OffsetParams, OpenRule, Side, offset};
use ravec_progress::Progress;
use ravec_scenes::solids::{comb, cuboid, sheet, torus};
use support::verdict::{params, sound_offset, written_and_read};

fn single(side: Side, distance: f64, tolerance: f64, simplify: bool) -> OffsetParams {
    OffsetParams {
        coordinates: Coordinates::Single,
        ..params(side, distance, tolerance, simplify)
    }
}

/// Turned to where no coordinate is a round number.
fn turned(mesh: &TriMesh, shift: DVec3) -> TriMesh {
    let turn = DQuat::from_scaled_axis(DVec3::new(0.7, -0.4, 1.1));
    let positions = mesh.positions().iter().map(|&p| turn * p + shift);
    TriMesh::new(positions.collect(), mesh.triangles().to_vec()).unwrap()
}

#[test]
fn solids_in_and_out_of_line_with_the_axes_are_what_a_file_holds() {
    for mesh in [
        cuboid(DVec3::new(4.0, 3.0, 2.0)).mesh,
        torus(1.0, 0.4, 12, 8).mesh,
        comb(4, 0.04, 0.16, 0.6).mesh,
    ] {
        for mesh in [mesh.clone(), turned(&mesh, DVec3::new(3.0, 0.0, -2.0))] {
            let distance = 0.02 * mesh.bounds().diagonal();
            for (side, simplify) in [
                (Side::Both, true),
                (Side::Outer, false),
                (Side::Inner, true),
                (Side::Shell, true),
            ] {
                let asked = single(side, distance, 0.1 * distance, simplify);
                sound_offset("a solid", &mesh, &asked);
            }
        }
    }
}

#[test]
fn a_sheet_made_thick_is_what_a_file_holds() {
    let flat = sheet(30.0, 20.0, 1, 1).mesh;
    for mesh in [flat.clone(), turned(&flat, DVec3::ZERO)] {
        for k in 0..6 {
            let asked = OffsetParams {
                open: OpenRule::Thicken,
                ..single(Side::Both, 2.0, 0.02 * 1.3f64.powi(k), true)
            };
            let found = offset(&mesh, &asked, &Progress::none()).unwrap();
            let report = &found.report;
            assert!(report.certified && report.solid, "{report:?}");
            let read = written_and_read(&found.mesh);
            let checked = check(&read, &CheckParams::default(), &Progress::none()).unwrap();
            assert!(checked.is_solid(), "{checked:?}");
            let same = read.triangles().len() == found.mesh.triangles().len();
            assert!(same && read.positions().len() == found.mesh.positions().len());
        }
    }
}

#[test]
fn the_finest_tolerance_is_named_and_can_be_kept() {
    let mesh = turned(&cuboid(DVec3::ONE).mesh, DVec3::splat(2e4));
    for (side, open) in [
        (Side::Both, OpenRule::Refuse),
        (Side::Shell, OpenRule::Refuse),
        (Side::Both, OpenRule::Thicken),
    ] {
        let asked = OffsetParams {
            open,
            ..single(side, 0.3, 1e-3, true)
        };
        let error = offset(&mesh, &asked, &Progress::none()).unwrap_err();
        let OffsetError::SinglePrecision { got, least } = error else {
            panic!("{error}");
        };
        assert!(
            got == asked.tolerance && least > got && least < 0.1,
            "{error}"
        );
        let text = error.to_string();
        assert!(text.contains("write PLY"), "{text}");
        let kept = OffsetParams {
            tolerance: 1.1 * least,
            ..asked
        };
        let found = offset(&mesh, &kept, &Progress::none()).unwrap();
        let report = &found.report;
        assert!(report.certified && report.solid, "{report:?}");
    }
}

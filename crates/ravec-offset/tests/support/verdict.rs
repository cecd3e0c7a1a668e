//! Requirements of every offset surface: a solid, at the distance, everywhere.

use super::coverage::{Coverage, Part, Truth, coverage};
use super::oracle::Oracle;
use glam::DVec3;
use ravec_mesh::{CheckParams, MeshCheck, TriMesh, check, weld};
use ravec_mesh_io::{MeshFormat, ReadOptions, WriteOptions, read_mesh, write_mesh};
use ravec_offset::{Coordinates, Offset, OffsetParams, Side, offset};
use ravec_progress::Progress;

pub fn params(side: Side, distance: f64, tolerance: f64, simplify: bool) -> OffsetParams {
    OffsetParams {
        distance,
        tolerance,
        side,
        simplify,
        ..OffsetParams::default()
    }
}

/// The offset, of which anything must be true that always is.
///
/// # Panics
/// If there is no offset or something is wrong with it; the message begins with `name`.
pub fn sound_offset(name: &str, mesh: &TriMesh, params: &OffsetParams) -> (Offset, MeshCheck) {
    match checked_offset(mesh, params) {
        Ok(sound) => sound,
        Err(fault) => panic!("{name}, {params:?}: {fault}"),
    }
}

/// The offset and what was found when it was checked, or what is wrong with it.
pub fn checked_offset(
    mesh: &TriMesh,
    params: &OffsetParams,
) -> Result<(Offset, MeshCheck), String> {
    let found = offset(mesh, params, &Progress::none()).map_err(|error| error.to_string())?;
    let report = &found.report;
    if !(report.certified && report.solid && report.self_intersections == 0) {
        return Err(format!("{report:?}"));
    }
    let inspect = |mesh: &TriMesh| {
        let found = check(mesh, &CheckParams::default(), &Progress::none());
        found.map_err(|cancelled| cancelled.to_string())
    };
    let plain = inspect(&found.mesh)?;
    let mut welded = inspect(&weld(&found.mesh, 0.0).mesh)?;
    if params.coordinates == Coordinates::Single {
        let read = written_and_read(&found.mesh);
        let here = found.mesh.triangles().iter().flatten();
        let there = read.triangles().iter().flatten();
        let place = |mesh: &TriMesh, v: u32| mesh.positions()[v as usize];
        if !here
            .map(|&v| place(&found.mesh, v))
            .eq(there.map(|&v| place(&read, v)))
        {
            return Err("a file holds other places".to_owned());
        }
        welded = inspect(&read)?;
    }
    for checked in [&plain, &welded] {
        if !checked.is_solid() || !checked.degenerate_triangles.is_empty() {
            return Err(format!("not a solid: {checked:?}"));
        }
    }
    if report.triangles != plain.triangles {
        return Err(format!(
            "{} triangles, not {}",
            plain.triangles, report.triangles
        ));
    }
    // a shell begins with the mesh itself
    let own = match params.side {
        Side::Shell => mesh.triangles().len(),
        Side::Both | Side::Outer | Side::Inner => 0,
    };
    let [least, most] = [report.least_distance, report.most_distance];
    let is_within = least >= params.distance - params.tolerance
        && most <= params.distance + params.tolerance
        && (least..=most).contains(&report.most_distance_found);
    if !is_within {
        return Err(format!("proved to be from {least} to {most}: {report:?}"));
    }
    // no place is beyond what was proved, but for the rounding of the distance itself
    let oracle = Oracle::new(mesh);
    let proved = OffsetParams {
        distance: 0.5 * (least + most),
        ..params.clone()
    };
    let (worst, at) = farthest_off(&found.mesh, own, &proved, |p| oracle.distance(p));
    if worst > 0.5 * (most - least) + 1e-9 * params.distance {
        let share = worst / params.tolerance;
        return Err(format!("{share} of the tolerance off at {at}: {report:?}"));
    }
    Ok((found, plain))
}

/// A mesh that was written as binary STL, of 32-bit floats, and read with equal places as one vertex.
pub fn written_and_read(mesh: &TriMesh) -> TriMesh {
    let mut bytes = Vec::new();
    let options = WriteOptions::default();
    write_mesh(
        mesh,
        MeshFormat::StlBinary,
        &options,
        &mut bytes,
        &Progress::none(),
    )
    .unwrap();
    let read = read_mesh(&bytes[..], &ReadOptions::default(), &Progress::none()).unwrap();
    weld(&read.mesh, 0.0).mesh
}

/// By how much the triangles from number `first` on miss the distance, at corners and at places within, and where.
pub fn farthest_off(
    surface: &TriMesh,
    first: usize,
    params: &OffsetParams,
    distance: impl Fn(DVec3) -> f64,
) -> (f64, DVec3) {
    let fine = surface.bounds().diagonal() / 30.0;
    let mut worst = (0.0, DVec3::ZERO);
    let mut look = |p: DVec3| {
        let off = (distance(p) - params.distance).abs();
        if off > worst.0 {
            worst = (off, p);
        }
    };
    for t in first..surface.triangles().len() {
        let [a, b, c] = surface.corners(t as u32);
        let longest = a.distance(b).max(b.distance(c)).max(c.distance(a));
        let parts = (longest / fine).ceil().clamp(2.0, 20.0) as u32;
        for i in 0..=parts {
            for j in 0..=parts - i {
                let [u, v] = [i, j].map(|k| f64::from(k) / f64::from(parts));
                look(a + u * (b - a) + v * (c - a));
            }
        }
        look((a + b + c) / 3.0);
    }
    worst
}

/// Coverage of the true offset of a small mesh, by brute force.
pub fn coverage_by_oracle(
    mesh: &TriMesh,
    surface: &TriMesh,
    params: &OffsetParams,
    spacing: f64,
) -> Coverage {
    let oracle = Oracle::new(mesh);
    let closed =
        check(mesh, &CheckParams::default(), &Progress::none()).is_ok_and(|found| found.closed);
    let truth = Truth {
        mesh,
        part: part(params.side, closed),
        delta: params.distance,
        distance: &|p| oracle.distance(p),
        is_inside: &|p| oracle.is_inside(p),
    };
    coverage(&truth, surface, params.tolerance, spacing)
}

/// Part of space on a side of a mesh.
pub fn part(side: Side, closed: bool) -> Part {
    match side {
        Side::Both => Part::All,
        Side::Outer if closed => Part::Outside,
        Side::Outer => Part::Reachable,
        Side::Inner | Side::Shell => Part::Inside,
    }
}

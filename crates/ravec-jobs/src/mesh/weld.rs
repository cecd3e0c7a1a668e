//! Welding as a step of an operation: seams are closed where a surface has to be, vertices within a tolerance are joined where
//! that is asked for, and the report says so.

use super::Length;
use crate::error::JobError;
use crate::report::Report;
use ravec::mesh::{JoinedSeams, TriMesh, join_seams, try_weld};
use ravec::mesh_io::LengthUnit;
use ravec::progress::Progress;
use std::path::Path;

/// Refuses a tolerance below 0.
pub(super) fn check(tolerance: Option<Length>) -> Result<(), JobError> {
    match tolerance.filter(|length| length.is_negative()) {
        Some(length) => Err(JobError::Parameter {
            field: "weld",
            value: length.to_string(),
            range: "at least 0",
        }),
        None => Ok(()),
    }
}

/// The mesh with vertices within `tolerance` made one, and without the triangles that thereby lost a corner.
///
/// Figures: `welded_vertices` and `collapsed_triangles`.
pub(super) fn welded(
    mesh: TriMesh,
    tolerance: Option<Length>,
    unit: Option<LengthUnit>,
    report: &mut Report,
    progress: &Progress,
) -> Result<TriMesh, JobError> {
    let Some(tolerance) = tolerance else {
        return Ok(mesh);
    };
    let tolerance = tolerance.resolve("weld", mesh.bounds().diagonal(), unit)?;
    let welded = report.time("weld", || try_weld(&mesh, tolerance, progress))?;
    let (positions, mut triangles) = welded.mesh.into_parts();
    let before = triangles.len();
    if welded.collapsed > 0 {
        triangles.retain(|&[a, b, c]| a != b && b != c && c != a);
    }
    let dropped = before - triangles.len();
    report
        .figures
        .insert("welded_vertices", welded.merged as f64);
    report.figures.insert("collapsed_triangles", dropped as f64);
    let welded = TriMesh::try_new(positions, triangles, progress)?;
    Ok(welded.expect("some triangles of a mesh make a mesh"))
}

/// Closes the seams of a mesh that is not closed without: see [`join_seams`].
///
/// Figure: `joined_vertices`, if there are any.
pub(super) fn seams(
    mesh: &TriMesh,
    path: &Path,
    report: &mut Report,
    progress: &Progress,
) -> Result<Option<JoinedSeams>, JobError> {
    let joined = report.time("weld", || join_seams(mesh, progress))?;
    if let Some(joined) = &joined {
        report
            .figures
            .insert("joined_vertices", joined.joined as f64);
        report.record_assumed(format!(
            "{}: {} vertices on borders lie where another one does, as along seams of normals or texture: they were joined",
            path.display(),
            joined.joined
        ));
    }
    Ok(joined)
}

/// The mesh with its seams closed: see [`seams`].
pub(super) fn with_joined_seams(
    mesh: TriMesh,
    path: &Path,
    report: &mut Report,
    progress: &Progress,
) -> Result<TriMesh, JobError> {
    let joined = seams(&mesh, path, report, progress)?;
    Ok(joined.map_or(mesh, |joined| joined.mesh))
}

#[cfg(test)]
mod tests {
    use super::*;
    use ravec::mesh_io::MeshFormat;

    #[test]
    fn triangles_that_collapse_are_dropped_and_counted() {
        let corners = [
            [0.0, 0.0, 0.0],
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.0, 1.0, 1e-3],
        ];
        let positions = corners.map(Into::into).to_vec();
        let mesh = TriMesh::new(positions, vec![[0, 1, 2], [1, 3, 2]]).unwrap();
        let mut report = Report::new("test", &());
        let progress = Progress::none();
        let same = welded(mesh.clone(), None, None, &mut report, &progress).unwrap();
        assert_eq!(same, mesh);
        let tolerance = Some(Length::Percent(1.0));
        let result = welded(mesh, tolerance, None, &mut report, &progress).unwrap();
        assert_eq!(result.triangles(), [[0, 1, 2]]);
        assert_eq!(report.figures["welded_vertices"], 1.0);
        assert_eq!(report.figures["collapsed_triangles"], 1.0);
        assert!(check(Some(Length::Units(-1.0))).is_err());
    }

    /// A ball of which each triangle has vertices of its own.
    fn shattered() -> TriMesh {
        let ball = ravec_scenes::solids::icosphere(2.0, 3).mesh;
        let corners = ball.triangles().iter().flatten();
        let positions = corners.map(|&v| ball.positions()[v as usize]).collect();
        let triangles = (0..ball.triangles().len() as u32).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]);
        TriMesh::new(positions, triangles.collect()).unwrap()
    }

    #[test]
    fn operations_on_solids_take_meshes_with_seams() {
        use crate::context::Context;
        use crate::mesh::{MeshTarget, check, info, offset, simplify, write_mesh_file};
        use crate::operation::Operation as _;
        use ravec::offset::Side;

        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let target = MeshTarget::new(MeshFormat::PlyBinary);
        let mesh = shattered();
        write_mesh_file(&at("a.ply"), &mesh, &target, &Progress::none()).unwrap();
        let context = Context::default();
        let joined = mesh.positions().len() - 642;
        let input = at("a.ply");
        let seen = |report: &Report| {
            assert_eq!(report.figures["joined_vertices"], joined as f64);
            assert!(report.verdict.assumed[0].contains("were joined"));
        };
        let params = info::Params::default();
        let report = info::Info {
            input: input.clone(),
            params,
        }
        .run(&context)
        .unwrap();
        seen(&report);
        assert_eq!(
            (report.figures["closed"], report.figures["vertices"]),
            (1.0, 3840.0)
        );
        assert!((report.figures["volume"] / 33.5 - 1.0).abs() < 0.02);
        let params = check::Params::default();
        let report = check::Check {
            input: input.clone(),
            params,
        }
        .run(&context)
        .unwrap();
        seen(&report);
        assert_eq!(
            (report.passed, report.verdict.solid),
            (Some(true), Some(true))
        );
        for side in [Side::Inner, Side::Shell] {
            let params = offset::Params {
                distance: Length::Units(0.5),
                side,
                ..offset::Params::default()
            };
            let operation = offset::Offset {
                input: input.clone(),
                output: at("b.ply"),
                params,
            };
            let report = operation.run(&context).unwrap();
            seen(&report);
            assert_eq!(
                (report.passed, report.verdict.proved),
                (Some(true), Some(true))
            );
        }
        let params = simplify::Params {
            triangles: Some(300),
            ..simplify::Params::default()
        };
        let operation = simplify::Simplify {
            input,
            output: at("c.stl"),
            params,
        };
        let report = operation.run(&context).unwrap();
        seen(&report);
        assert_eq!(report.figures["target_reached"], 1.0);
        assert_eq!((report.passed, report.verdict.solid), (None, Some(true)));
    }

    #[test]
    fn places_of_defects_are_those_of_the_file() {
        use crate::context::Context;
        use crate::mesh::{MeshTarget, check, write_mesh_file};
        use crate::operation::Operation as _;

        let folder = tempfile::tempdir().unwrap();
        let (positions, mut triangles) = shattered().into_parts();
        triangles.pop();
        let mesh = TriMesh::new(positions, triangles).unwrap();
        let input = folder.path().join("a.ply");
        let target = MeshTarget::new(MeshFormat::PlyBinary);
        write_mesh_file(&input, &mesh, &target, &Progress::none()).unwrap();
        let params = check::Params::default();
        let report = check::Check { input, params }
            .run(&Context::default())
            .unwrap();
        let edges = &report.findings[1];
        assert_eq!((edges.what, edges.count), ("boundary edges", 3));
        for place in &edges.places {
            let ends = [0, 1].map(|i| mesh.positions()[place.vertices[i] as usize]);
            assert_eq!((0.5 * (ends[0] + ends[1])).to_array(), place.at);
        }
    }
}

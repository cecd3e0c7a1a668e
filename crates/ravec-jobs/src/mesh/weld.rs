//! Welding as a step of an operation: what collapses is dropped, and the report says so.

use super::Length;
use crate::error::JobError;
use crate::report::Report;
use ravec::mesh::{TriMesh, try_weld};
use ravec::mesh_io::LengthUnit;
use ravec::progress::Progress;

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

#[cfg(test)]
mod tests {
    use super::*;

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
}

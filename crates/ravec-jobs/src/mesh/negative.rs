//! Negative volumes of 3MF files, subtracted from the objects that they belong to when a file is read.

use crate::error::JobError;
use crate::report::Report;
use ravec::boolean::{BooleanError, BooleanParams, Expr, boolean};
use ravec::mesh::TriMesh;
use ravec::mesh_io::{MeshFile, MeshObject, part_of};
use ravec::progress::Progress;
use std::path::Path;

/// Subtracts the negative volumes of a file from its objects. Other objects stay as they are.
pub(super) fn subtract(
    file: &mut MeshFile,
    path: &Path,
    report: &mut Report,
    progress: &Progress,
) -> Result<(), JobError> {
    let negative = std::mem::take(&mut file.negative);
    if negative.triangles().is_empty() {
        return Ok(());
    }
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for object in &mut file.objects {
        progress.check()?;
        let mut part = part_of(&file.mesh, object.triangles.clone());
        if !object.negative.is_empty() {
            let holes = part_of(&negative, object.negative.clone());
            part = difference(part, holes, object, path, report, progress)?;
        }
        let (first, begin) = (positions.len() as u32, triangles.len());
        let (more, corners) = part.into_parts();
        positions.extend(more);
        triangles.extend(corners.into_iter().map(|t| t.map(|corner| first + corner)));
        object.triangles = begin..triangles.len();
        object.negative = 0..0;
    }
    file.mesh = TriMesh::new(positions, triangles).map_err(|error| JobError::Parameter {
        field: "input",
        value: format!(
            "{}, whose negative volumes were subtracted: {error}",
            path.display()
        ),
        range: "small enough for 32-bit indices",
    })?;
    Ok(())
}

fn difference(
    part: TriMesh,
    holes: TriMesh,
    object: &MeshObject,
    path: &Path,
    report: &mut Report,
    progress: &Progress,
) -> Result<TriMesh, JobError> {
    let expr = Expr::Difference(vec![Expr::Mesh(0), Expr::Mesh(1)]);
    let settings = BooleanParams::default();
    let result = report.time("boolean", || {
        boolean(&[part, holes], &expr, &settings, progress)
    });
    let result = result.map_err(|cause| match cause {
        BooleanError::Cancelled => JobError::Cancelled,
        cause => JobError::Boolean { cause },
    })?;
    if !result.report.passed() {
        let done = &result.report;
        let doubts = done.operands.iter().flat_map(|operand| &operand.doubts);
        let doubts: Vec<_> = doubts
            .chain(&done.doubts)
            .map(ToString::to_string)
            .collect();
        report.record_assumed(format!(
            "{}: the object {:?} without its negative volumes is no clean solid; check its volumes: {}",
            path.display(),
            object.name,
            doubts.join(", ")
        ));
    }
    Ok(result.mesh)
}

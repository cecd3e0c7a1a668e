//! Verdicts on written meshes: what `mesh check` will say about the file.

use super::MeshTarget;
use super::as_read::as_read;
use super::check::is_solid;
use crate::error::JobError;
use crate::report::{Finding, Report};
use ravec::mesh::{CheckParams, MeshCheck, TriMesh, check, join_seams};
use ravec::progress::Progress;

/// Enters the facts about a mesh as readers of `target` will see it into the verdict of the report.
///
/// The run has not passed if that is no solid although `source`, from which it was made by changing no more than was asked, is
/// one.
pub(super) fn judge_written(
    source: &TriMesh,
    written: &TriMesh,
    target: MeshTarget,
    report: &mut Report,
    progress: &Progress,
) -> Result<(), JobError> {
    let Some(read) = as_read(written, target, progress)? else {
        return Ok(());
    };
    let (solid, found) = report.time("check", || checked(&read, progress))?;
    report.verdict.solid = Some(solid);
    report.verdict.closed = Some(found.closed);
    if solid || written.triangles().is_empty() {
        return Ok(());
    }
    let (was_solid, _) = report.time("check", || checked(source, progress))?;
    if was_solid {
        report.passed = Some(false);
        let pairs = found.self_intersections.map_or(0, |pairs| pairs.count);
        if pairs > 0 {
            report.findings.push(Finding {
                what: "self-intersections",
                count: pairs,
                defect: true,
                places: Vec::new(),
            });
        }
        report.warn(format!(
            "the input is the surface of a solid, but the {} file is not: {}; formats with 64-bit floats (PLY, OBJ, OFF, 3MF) keep more \
             of it",
            target.format,
            match pairs {
                0 => "it is not closed or not manifold".to_owned(),
                count => format!("it meets itself {count} times"),
            }
        ));
    }
    Ok(())
}

/// True for the surface of a solid, and the check of the mesh with its seams closed.
fn checked(mesh: &TriMesh, progress: &Progress) -> Result<(bool, MeshCheck), JobError> {
    let joined = join_seams(mesh, progress)?;
    let mesh = joined.as_ref().map_or(mesh, |joined| &joined.mesh);
    let full = CheckParams {
        self_intersections: true,
        list_limit: 0,
    };
    let found = check(mesh, &full, progress)?;
    Ok((is_solid(mesh, &found), found))
}

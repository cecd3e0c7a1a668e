//! Entry points of offsets.

use crate::direct::{direct, is_small};
use crate::domain::rounded;
use crate::params::{Coordinates, OffsetError, OffsetParams, OpenRule, Side};
use crate::pieces::Coordinator;
use crate::remote::Remote;
use crate::report::{Offset, StoredOffset};
use crate::store::{NewStorage, OffsetSurface, in_memory};
use crate::task::Task;
use crate::thicken::thicken;
use ravec_mesh::TriMesh;
use ravec_pieces::Cluster;
use ravec_progress::Progress;
use std::sync::Arc;

/// Computes the surface at a distance from the triangles of a mesh. Any triangles are valid input: open, intersecting, repeated
/// or without area.
///
/// # Errors
/// [`OffsetError`]: no triangles, parameters out of range, a side that requires a closed mesh, an empty result, a sheet that is
/// too rough to be thickened; [`OffsetError::Cancelled`] soon after `progress` is cancelled.
pub fn offset(
    mesh: &TriMesh,
    params: &OffsetParams,
    progress: &Progress,
) -> Result<Offset, OffsetError> {
    let StoredOffset { surface, report } = offset_stored(mesh, params, &in_memory, progress)?;
    Ok(Offset {
        mesh: surface.into_mesh(progress)?,
        report,
    })
}

/// Computes the surface as [`offset`] does. A surface that exceeds [`OffsetParams::memory_bytes`] is built in a `storage`,
/// about 180 bytes per triangle before simplification, and stays there to be written triangle by triangle.
///
/// # Errors
/// As [`offset`]; [`OffsetError::Storage`] if the storage fails.
pub fn offset_stored(
    mesh: &TriMesh,
    params: &OffsetParams,
    storage: NewStorage<'_>,
    progress: &Progress,
) -> Result<StoredOffset, OffsetError> {
    offset_with(mesh, params, storage, None, progress)
}

/// Computes [`offset_stored`] alone or with a cluster.
pub(crate) fn offset_with(
    mesh: &TriMesh,
    params: &OffsetParams,
    storage: NewStorage<'_>,
    cluster: Option<&Arc<Cluster>>,
    progress: &Progress,
) -> Result<StoredOffset, OffsetError> {
    if mesh.triangles().is_empty() {
        return Err(OffsetError::NoTriangles);
    }
    // a mesh that becomes part of the result must be representable in the file
    let is_part = params.open == OpenRule::Thicken || params.side == Side::Shell;
    if !is_part || params.coordinates == Coordinates::Double {
        return offset_exact(mesh, params, storage, cluster, progress);
    }
    let got = params.tolerance;
    let Some((rounded, moved)) = rounded(mesh, params.coordinates) else {
        return Err(OffsetError::BeyondSinglePrecision);
    };
    let left = OffsetParams {
        // a tolerance below half is refused for the same reason
        tolerance: got - moved.min(0.5 * got),
        ..params.clone()
    };
    let made = offset_exact(&rounded, &left, storage, cluster, progress);
    let mut offset = made.map_err(|error| match error {
        OffsetError::SinglePrecision { least, .. } => OffsetError::SinglePrecision {
            got,
            least: least + moved,
        },
        OffsetError::Tolerance { least, most, .. } => OffsetError::Tolerance { got, least, most },
        other => other,
    })?;
    offset.report.least_distance -= moved;
    offset.report.most_distance += moved;
    Ok(offset)
}

/// Computes [`offset_stored`] for a mesh that may become part of the result as it is.
fn offset_exact(
    mesh: &TriMesh,
    params: &OffsetParams,
    storage: NewStorage<'_>,
    cluster: Option<&Arc<Cluster>>,
    progress: &Progress,
) -> Result<StoredOffset, OffsetError> {
    if params.open == OpenRule::Thicken {
        let Offset { mesh, report } = thicken(mesh, params, progress)?;
        let surface = OffsetSurface::from(mesh);
        return Ok(StoredOffset { surface, report });
    }
    params.check(&mesh.bounds())?;
    let task = Task::checked(mesh, params, false, progress)?;
    let field = task.field(progress)?;
    if is_small(mesh, params) {
        let mut field = task.field(progress)?;
        field.has_large_facets = true;
        let finish = task.finish(mesh, params, &field, storage)?;
        if let Some(offset) = direct(mesh, params, &finish, progress)? {
            return Ok(offset);
        }
    }
    let mut finish = task.finish(mesh, params, &field, storage)?;
    let coordinator =
        (cluster.map(|cluster| Coordinator::start(cluster, mesh, params, progress))).transpose()?;
    finish.budget.remote = (coordinator.as_ref()).map(|coordinator| coordinator as &dyn Remote);
    let repaired = task.repaired(params, &finish, progress)?;
    finish.run(mesh, repaired, progress)
}

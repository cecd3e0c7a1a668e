//! Drafts of offsets, for display while a distance is chosen.

use crate::extract::{CrossingCache, Selection, extract};
use crate::grow::{Halt, Refinement, Setting};
use crate::params::{OffsetError, OffsetParams, OpenRule, Side};
use crate::surface::Edits;
use crate::task::{Prepared, Task, Topology};
use ravec_mesh::{Bvh, TriMesh};
use ravec_octree::CellKey;
use ravec_progress::Progress;
use std::sync::Arc;

/// Nodes of the tree of a draft, about 250 MB and two seconds.
const MAX_NODES: usize = 500_000;

/// A mesh prepared for drafts of its offsets: its search tree and its topology.
#[derive(Debug)]
pub struct OffsetDrafts {
    mesh: Prepared,
}

impl OffsetDrafts {
    /// Prepares drafts of the offsets of a mesh.
    ///
    /// # Errors
    /// [`OffsetError::NoTriangles`]; [`OffsetError::Cancelled`] soon after `progress` is cancelled.
    pub fn new(mesh: &TriMesh, progress: &Progress) -> Result<Self, OffsetError> {
        if mesh.triangles().is_empty() {
            return Err(OffsetError::NoTriangles);
        }
        let (topology, bvh) = rayon::join(
            || Topology::of(mesh, progress),
            || Bvh::try_new(mesh, progress),
        );
        Ok(Self {
            mesh: Prepared {
                bounds: mesh.bounds(),
                bvh: Arc::new(bvh?),
                topology: topology?,
            },
        })
    }

    /// Returns whether [`Self::draft`] has a draft of such an offset: not of shells and thickened sheets, which contain the mesh.
    pub fn covers(params: &OffsetParams) -> bool {
        params.open != OpenRule::Thicken && params.side != Side::Shell
    }

    /// Returns the first surface that [`offset`](crate::offset()) extracts, in about half of its time without simplification;
    /// nothing if that takes more than half a million cells, which is no draft.
    ///
    /// Does not guarantee what that function does: triangles may leave the tolerance or intersect others, and components in
    /// cavities remain on the outer side of open meshes.
    ///
    /// # Errors
    /// As [`offset`](crate::offset()).
    ///
    /// # Panics
    /// If there are no drafts of such an offset: see [`Self::covers`].
    pub fn draft(
        &self,
        params: &OffsetParams,
        progress: &Progress,
    ) -> Result<Option<TriMesh>, OffsetError> {
        assert!(Self::covers(params), "no drafts of solids with the mesh");
        params.check(&self.mesh.bounds)?;
        let task = Task::prepared(self.mesh.clone(), params, false, progress)?;
        let field = task.field(progress)?;
        let enclosed = task.enclosed(&field, params.side, usize::MAX, progress)?;
        let setting = task.setting(&field, &enclosed, params);
        match first_surface(setting, progress) {
            Ok(surface) if surface.triangles().is_empty() => Err(OffsetError::Empty {
                distance: params.distance,
            }),
            Ok(surface) => Ok(Some(surface)),
            Err(Halt::TooLarge) => Ok(None),
            Err(Halt::Cancelled(cancelled)) => Err(cancelled.into()),
        }
    }
}

fn first_surface(setting: Setting<'_>, progress: &Progress) -> Result<TriMesh, Halt> {
    let root = CellKey::ROOT;
    let grown = Refinement::grow(setting, root, &Edits::default(), MAX_NODES, progress)?;
    let mut whole = Selection::Tile(root);
    let extracted = extract(&grown, &mut whole, &mut CrossingCache::default(), progress)?;
    let patch = extracted.patch(&grown, &whole, progress)?.finished();
    let surface = TriMesh::new(patch.positions, patch.triangles);
    Ok(surface.expect("triangles have three of the vertices"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use ravec_mesh::{CheckParams, check, measure};
    use ravec_scenes::solids::{cuboid, torus};

    fn params(side: Side) -> OffsetParams {
        OffsetParams {
            distance: 0.1,
            tolerance: 0.02,
            side,
            simplify: false,
            ..OffsetParams::default()
        }
    }

    #[test]
    fn drafts_keep_about_the_distance_and_are_closed() {
        let meshes = [
            torus(1.0, 0.4, 40, 30).mesh,
            cuboid(DVec3::new(2.0, 1.5, 1.0)).mesh,
        ];
        for mesh in meshes {
            let drafts = OffsetDrafts::new(&mesh, &Progress::none()).unwrap();
            let bvh = Bvh::new(&mesh);
            for side in [Side::Both, Side::Outer, Side::Inner] {
                let draft = drafts.draft(&params(side), &Progress::none());
                let draft = draft.unwrap().unwrap();
                assert!(
                    check(&draft, &CheckParams::default(), &Progress::none())
                        .unwrap()
                        .closed
                );
                for &position in draft.positions() {
                    let distance = bvh.closest(position).unwrap().distance_sq.sqrt();
                    assert!((distance - 0.1).abs() <= 0.02, "{side:?}: {distance}");
                }
                let whole = crate::offset(&mesh, &params(side), &Progress::none()).unwrap();
                let volumes = [&draft, &whole.mesh].map(|mesh| measure(mesh).volume);
                assert!((volumes[0] / volumes[1] - 1.0).abs() < 0.02, "{volumes:?}");
            }
        }
    }

    #[test]
    fn what_has_no_offset_has_no_draft() {
        let error = OffsetDrafts::new(&TriMesh::default(), &Progress::none()).unwrap_err();
        assert_eq!(error, OffsetError::NoTriangles);
        let block = cuboid(DVec3::new(2.0, 1.5, 1.0)).mesh;
        let drafts = OffsetDrafts::new(&block, &Progress::none()).unwrap();
        let deep = OffsetParams {
            distance: 0.6,
            ..params(Side::Inner)
        };
        let error = drafts.draft(&deep, &Progress::none()).unwrap_err();
        assert_eq!(error, OffsetError::Empty { distance: 0.6 });
        let fine = OffsetParams {
            distance: 1e-3,
            tolerance: 2e-4,
            ..params(Side::Both)
        };
        assert_eq!(drafts.draft(&fine, &Progress::none()), Ok(None));
        let progress = Progress::none();
        progress.cancel();
        let error = drafts.draft(&params(Side::Both), &progress).unwrap_err();
        assert_eq!(error, OffsetError::Cancelled(ravec_progress::Cancelled));
    }
}

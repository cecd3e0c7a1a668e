//! Cells of the octree, for inspection.

use crate::grow::{Halt, Refinement};
use crate::params::{OffsetError, OffsetParams};
use crate::surface::Edits;
use crate::task::Task;
use ravec_mesh::{Aabb, TriMesh};
use ravec_octree::CellKey;
use ravec_progress::Progress;

/// A cell of the octree.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OffsetCell {
    /// Bounds: a cube.
    pub bounds: Aabb,
    /// Level: the side is that of the root divided by two to this power.
    pub level: u8,
}

/// Returns the leaves of the octree from which [`offset`](crate::offset()) extracts its first surface: those with corners on
/// both sides of it. Repair may split some of them further. The cells do not overlap; their order is unspecified.
///
/// Cells are small where the surface is curved or parts of it are close to each other, and as large as the tolerance allows
/// elsewhere; a single vertex represents a crease or a corner as well as a plane.
///
/// # Errors
/// As [`offset`](crate::offset()).
pub fn offset_cells(
    mesh: &TriMesh,
    params: &OffsetParams,
    progress: &Progress,
) -> Result<Vec<OffsetCell>, OffsetError> {
    let task = Task::new(mesh, params, progress)?;
    let field = task.field(progress)?;
    let enclosed = task.enclosed(&field, params.side, usize::MAX, progress)?;
    let grown = Refinement::grow(
        task.setting(&field, &enclosed, params),
        CellKey::ROOT,
        &Edits::default(),
        usize::MAX,
        progress,
    );
    let grown = grown.map_err(|halt| match halt {
        Halt::Cancelled(cancelled) => cancelled,
        Halt::TooLarge => unreachable!("any number of nodes is allowed"),
    })?;
    let tree = &grown.tree;
    let crossed = tree.leaves().filter(|&leaf| {
        let key = tree.key(leaf);
        let inside = |octant| grown.is_inside(leaf, key.corner(octant));
        (1..8).any(|octant| inside(octant) != inside(0))
    });
    let cells: Vec<OffsetCell> = crossed
        .map(|leaf| {
            let key = tree.key(leaf);
            let [min, max] = grown.setting.frame.bounds(key);
            OffsetCell {
                bounds: Aabb { min, max },
                level: key.level,
            }
        })
        .collect();
    if cells.is_empty() {
        return Err(OffsetError::Empty {
            distance: params.distance,
        });
    }
    Ok(cells)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::params::Side;
    use glam::DVec3;
    use ravec_mesh::Bvh;
    use ravec_scenes::solids::cuboid;

    fn params(side: Side) -> OffsetParams {
        OffsetParams {
            distance: 0.2,
            tolerance: 0.005,
            side,
            ..OffsetParams::default()
        }
    }

    fn cells(side: Side) -> Vec<OffsetCell> {
        offset_cells(&block(), &params(side), &Progress::none()).unwrap()
    }

    fn block() -> TriMesh {
        cuboid(DVec3::new(2.0, 1.5, 1.0)).mesh
    }

    #[test]
    fn cells_are_cubes_apart_from_each_other_that_hold_the_distance() {
        let bvh = Bvh::new(&block());
        for side in [Side::Both, Side::Outer, Side::Inner] {
            let cells = cells(side);
            for cell in &cells {
                let size = cell.bounds.size();
                assert!((size.max_element() - size.min_element()).abs() < 1e-9);
                let middle = bvh.closest(cell.bounds.center()).unwrap();
                let off = middle.distance_sq.sqrt() - 0.2;
                assert!(off.abs() <= 0.5 * size.length(), "{cell:?}");
            }
            let lows: Vec<_> = cells.iter().map(|cell| cell.bounds).collect();
            for (i, a) in lows.iter().enumerate() {
                let apart = |b: &Aabb| {
                    let gap = (a.min.max(b.min) - a.max.min(b.max)).max_element();
                    gap > -1e-9
                };
                assert!(lows[i + 1..].iter().all(apart));
            }
        }
    }

    #[test]
    fn flat_parts_have_larger_cells_than_round_ones() {
        let cells = cells(Side::Outer);
        let at = |p: DVec3| {
            let holds =
                |cell: &&OffsetCell| (p.cmpge(cell.bounds.min) & p.cmple(cell.bounds.max)).all();
            cells.iter().find(holds).unwrap().level
        };
        // the middle of the top of a box that has grown, and the middle of a rounded corner
        let bounds = block().bounds();
        let top = bounds.center() + DVec3::Z * (0.5 * bounds.size().z + 0.2);
        let corner = bounds.max + 0.2 * DVec3::ONE.normalize();
        assert!(at(top) < at(corner), "{} and {}", at(top), at(corner));
    }

    #[test]
    fn an_empty_offset_has_no_cells() {
        let deep = OffsetParams {
            distance: 0.6,
            ..params(Side::Inner)
        };
        let error = offset_cells(&block(), &deep, &Progress::none()).unwrap_err();
        assert_eq!(error, OffsetError::Empty { distance: 0.6 });
        let error = offset_cells(&TriMesh::default(), &params(Side::Both), &Progress::none());
        assert_eq!(error.unwrap_err(), OffsetError::NoTriangles);
    }
}

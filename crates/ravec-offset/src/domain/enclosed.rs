//! Enclosed space: cells that the outermost surface cannot reach.
//!
//! Cells with triangles are halved until the triangles cover all of the cell within the distance. Such cells are walls;
//! everything that the other cells do not connect with the border of the tree is enclosed, including the insides of scans whose
//! holes are small beside the distance.
//!
//! Guarantees: no point that can be reached from far away without coming nearer to the triangles than the distance lies in an
//! enclosed cell, and the border of the enclosed cells is within the distance. Does not guarantee: to find space enclosed by
//! gaps that are narrower than a cell but wider than twice the distance.

use super::Field;
use ravec_numeric::DisjointSets;
use ravec_octree::{CellKey, Frame, MAX_LEVEL, NodeId, Octree, for_each_minimal_face};
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;
use rustc_hash::FxHashMap;

/// Bound on the nodes of the coarse tree, at about 40 bytes per node; a larger tree is dropped, and no space counts as
/// enclosed.
const MAX_NODES: usize = 1 << 21;

/// Enclosure of a cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Enclosure {
    /// All of the cell is enclosed.
    Whole,
    /// Some leaves in the cell are enclosed; the tree must be split down to them.
    Partial,
}

/// The enclosed cells of a tree.
#[derive(Debug, Default)]
pub(crate) struct Enclosed {
    cells: FxHashMap<CellKey, Enclosure>,
}

/// Data of a coarse cell.
#[derive(Debug, Clone, Copy)]
struct Coarse {
    /// A triangle close to it.
    hint: u32,
    /// All of the cell is nearer to the triangles than the distance.
    is_wall: bool,
}

impl Enclosed {
    /// Finds the enclosed cells of a tree over a frame, for a field without signs.
    pub fn find(
        field: &Field<'_>,
        frame: &Frame,
        max_nodes: usize,
        progress: &Progress,
    ) -> Result<Self, Cancelled> {
        let max_nodes = max_nodes.min(MAX_NODES);
        let Some(tree) = coarse_tree(field, frame, max_nodes, progress)? else {
            return Ok(Self::default());
        };
        let outside = reachable_leaves(&tree);
        progress.check()?;
        let mut cells = FxHashMap::default();
        for leaf in tree.leaves() {
            if tree.data(leaf).is_wall || outside[leaf as usize] {
                continue;
            }
            for node in tree.path_to(leaf) {
                cells.insert(tree.key(node), Enclosure::Partial);
            }
            cells.insert(tree.key(leaf), Enclosure::Whole);
        }
        Ok(Self { cells })
    }

    pub fn of(&self, cell: CellKey) -> Option<Enclosure> {
        self.cells.get(&cell).copied()
    }
}

/// Halves cells until no triangle passes through them or all of them is nearer than the distance; returns `None` if that takes
/// more nodes than allowed.
fn coarse_tree(
    field: &Field<'_>,
    frame: &Frame,
    max_nodes: usize,
    progress: &Progress,
) -> Result<Option<Octree<Coarse>>, Cancelled> {
    let mut tree = Octree::new(Coarse {
        hint: 0,
        is_wall: false,
    });
    let mut front: Vec<NodeId> = vec![0];
    while !front.is_empty() {
        if tree.len() > max_nodes {
            return Ok(None);
        }
        let probes: Vec<(u32, f64, f64)> = front
            .par_iter()
            .map(|&node| {
                progress.check()?;
                let [low, high] = frame.bounds(tree.key(node));
                let near = field.near(0.5 * (low + high), tree.data(node).hint);
                Ok((near.triangle, near.distance, 0.5 * (high - low).length()))
            })
            .collect::<Result<_, Cancelled>>()?;
        let mut next = Vec::new();
        for (node, (hint, distance, radius)) in front.into_iter().zip(probes) {
            let is_wall = distance + radius < field.radius();
            *tree.data_mut(node) = Coarse { hint, is_wall };
            let may_be_split = tree.key(node).level < MAX_LEVEL;
            if distance <= radius && !is_wall && may_be_split {
                let first = tree.split(node, |_, &parent| parent);
                next.extend(first..first + 8);
            }
        }
        front = next;
    }
    Ok(Some(tree))
}

/// Returns, by leaf, whether a path leads there from the border of the root through faces of leaves that are not walls.
fn reachable_leaves(tree: &Octree<Coarse>) -> Vec<bool> {
    let is_open = |leaf: NodeId| !tree.data(leaf).is_wall;
    let is_at_border = |leaf: NodeId| {
        let key = tree.key(leaf);
        let side = CellKey::ROOT.side();
        (key.at.0.iter()).any(|&x| x == 0 || x + key.side() == side)
    };
    // the root stands for all that is beyond its border
    let mut sets = DisjointSets::new(tree.len());
    for leaf in tree
        .leaves()
        .filter(|&leaf| is_open(leaf) && is_at_border(leaf))
    {
        sets.join(0, leaf);
    }
    for_each_minimal_face(tree, |[a, b]| {
        if is_open(a) && is_open(b) {
            sets.join(a, b);
        }
    });
    let nodes = 0..tree.len() as NodeId;
    nodes.map(|node| sets.root(node) == 0).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::Solid;
    use glam::DVec3;
    use ravec_mesh::{Bvh, TriMesh};
    use ravec_scenes::solids::cuboid;

    /// The enclosed cells around a box of size 2 without some of its triangles, at a distance.
    fn enclosed(left_out: usize, distance: f64) -> (Enclosed, Frame, TriMesh) {
        let whole = cuboid(DVec3::splat(2.0)).mesh;
        let triangles = whole.triangles()[left_out..].to_vec();
        let mesh = TriMesh::new(whole.positions().to_vec(), triangles).unwrap();
        let bounds = mesh.bounds().grown(1.5 * distance);
        let frame = Frame {
            origin: bounds.min - DVec3::new(0.01, 0.02, 0.03),
            side: 1.1 * bounds.size().max_element(),
        };
        let bvh = Bvh::new(&mesh);
        let field = Field::new(&bvh, Solid::No, distance, &Progress::none()).unwrap();
        let found = Enclosed::find(&field, &frame, usize::MAX, &Progress::none()).unwrap();
        (found, frame, mesh)
    }

    fn whole_cells(enclosed: &Enclosed) -> impl Iterator<Item = CellKey> + '_ {
        let cells = enclosed.cells.iter();
        cells.filter_map(|(&key, &is)| (is == Enclosure::Whole).then_some(key))
    }

    #[test]
    fn the_inside_of_a_closed_box_is_enclosed_but_for_what_is_near_its_sides() {
        let distance = 0.1;
        let (found, frame, mesh) = enclosed(0, distance);
        let bounds = mesh.bounds();
        let mut volume = 0.0;
        for cell in whole_cells(&found) {
            let [low, high] = frame.bounds(cell);
            assert!(low.cmpge(bounds.min).all() && high.cmple(bounds.max).all());
            volume += (high - low).element_product();
        }
        // all that is farther from the sides than the distance
        assert!(volume >= 1.8_f64.powi(3) && volume < 2.0_f64.powi(3));
    }

    #[test]
    fn nothing_is_enclosed_by_a_box_with_a_hole() {
        let (found, ..) = enclosed(1, 0.1);
        assert_eq!(whole_cells(&found).count(), 0);
    }
}

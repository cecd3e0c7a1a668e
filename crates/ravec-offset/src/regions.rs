//! Which of the space outside the offset solid can be reached from far away.

use crate::refine::{Refinement, State};
use ravec_octree::{Contour, Corner, MAX_LEVEL, MinimalEdge, NodeId, for_each_minimal_edge};
use rustc_hash::FxHashMap;

/// Corners and empty cells outside, joined where no surface is between them.
struct Regions {
    parents: Vec<u32>,
    corners: FxHashMap<u64, u32>,
    cells: FxHashMap<NodeId, u32>,
}

/// The space far away.
const FAR: u32 = 0;

impl Regions {
    fn root(&mut self, mut at: u32) -> u32 {
        while self.parents[at as usize] != at {
            let above = self.parents[self.parents[at as usize] as usize];
            self.parents[at as usize] = above;
            at = above;
        }
        at
    }

    /// The lower root wins, so that what joins [`FAR`] is called that.
    fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        self.parents[a.max(b) as usize] = a.min(b);
    }

    fn corner(&mut self, corner: Corner) -> u32 {
        // no edge on the border of the root is visited, and all of it is far away
        if corner.0.iter().any(|&x| x == 0 || x == 1 << MAX_LEVEL) {
            return FAR;
        }
        let next = self.parents.len() as u32;
        let number = *self.corners.entry(corner.code()).or_insert(next);
        if number == next {
            self.parents.push(next);
        }
        number
    }

    fn cell(&mut self, cell: NodeId) -> u32 {
        let next = self.parents.len() as u32;
        let number = *self.cells.entry(cell).or_insert(next);
        if number == next {
            self.parents.push(next);
        }
        number
    }
}

/// The part of a contour whose outer side can be reached from far away: some of its closed surfaces.
pub(crate) fn reachable(
    refinement: &Refinement<'_>,
    crossings: &[(MinimalEdge, bool)],
    contour: Contour,
) -> Contour {
    // a single closed surface has nothing around it
    if is_one_piece(&contour) {
        return contour;
    }
    let tree = &refinement.tree;
    let mut regions = Regions {
        parents: vec![FAR],
        corners: FxHashMap::default(),
        cells: FxHashMap::default(),
    };
    let end_of_root = 1 << MAX_LEVEL;
    for leaf in tree.leaves() {
        let key = tree.key(leaf);
        let at_border =
            (0..3).any(|axis| key.at.0[axis] == 0 || key.at.0[axis] + key.side() == end_of_root);
        if at_border && matches!(tree.data(leaf).state, State::Empty { is_inside: false }) {
            let cell = regions.cell(leaf);
            regions.join(cell, FAR);
        }
    }
    for_each_minimal_edge(tree, |edge| {
        let is_inside = |corner| refinement.is_inside(edge.smallest, corner);
        if is_inside(edge.start) || is_inside(edge.end()) {
            return;
        }
        let start = regions.corner(edge.start);
        let end = regions.corner(edge.end());
        regions.join(start, end);
        for cell in edge.cells {
            if matches!(tree.data(cell).state, State::Empty { .. }) {
                let cell = regions.cell(cell);
                regions.join(cell, start);
            }
        }
    });
    // where a face is ambiguous, what is inside is apart, so what is outside hangs together
    for dual in contour.duals.iter().filter(|dual| dual.is_ambiguous) {
        let [a, b] = dual
            .polygons
            .map(|polygon| regions.corner(contour.polygons[polygon as usize].ends()[1]));
        regions.join(a, b);
    }
    let seen: Vec<(MinimalEdge, bool)> = crossings
        .iter()
        .filter(|(edge, start_inside)| {
            let outer = if *start_inside {
                edge.end()
            } else {
                edge.start
            };
            let corner = regions.corner(outer);
            regions.root(corner) == FAR
        })
        .copied()
        .collect();
    if seen.len() == crossings.len() {
        return contour;
    }
    Contour::new(tree, &seen)
}

/// Whether all polygons hang together.
fn is_one_piece(contour: &Contour) -> bool {
    let mut seen = vec![false; contour.polygons.len()];
    let mut front: Vec<u32> = seen.first().map(|_| 0).into_iter().collect();
    let mut count = 0;
    while let Some(polygon) = front.pop() {
        if std::mem::replace(&mut seen[polygon as usize], true) {
            continue;
        }
        count += 1;
        for &dual in contour.polygons[polygon as usize].duals() {
            let beside = contour.duals[dual as usize].polygons;
            front.extend(beside.into_iter().filter(|&next| !seen[next as usize]));
        }
    }
    count == seen.len()
}

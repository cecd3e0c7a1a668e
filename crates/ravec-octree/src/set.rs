//! Sets of cells with intersection queries.

use crate::key::{CellKey, Corner};

/// A set of cells of any levels, which may contain each other.
///
/// Cost: insertion and lookup are linear in the level of the cell; a box query is linear in the cells of all levels that
/// contain members and touch the border of the box.
#[derive(Debug, Clone, Default)]
pub struct CellSet {
    nodes: Vec<Node>,
}

#[derive(Debug, Clone, Copy, Default)]
struct Node {
    /// Nodes of the octants that contain members; 0, the root, for none.
    children: [u32; 8],
    is_member: bool,
}

impl CellSet {
    /// Adds a cell.
    ///
    /// # Panics
    /// If it takes more than 2³² nodes.
    pub fn insert(&mut self, cell: CellKey) {
        if self.nodes.is_empty() {
            self.nodes.push(Node::default());
        }
        let mut at = 0;
        for level in 0..cell.level {
            let octant = octant_of(cell, level);
            let mut child = self.nodes[at].children[octant];
            if child == 0 {
                child = u32::try_from(self.nodes.len()).expect("fewer than 2^32 nodes");
                self.nodes.push(Node::default());
                self.nodes[at].children[octant] = child;
            }
            at = child as usize;
        }
        self.nodes[at].is_member = true;
    }

    /// Returns whether a cell lies in a member, or is one.
    pub fn contains(&self, cell: CellKey) -> bool {
        let mut at = 0;
        for level in 0..=cell.level {
            match self.nodes.get(at) {
                None => return false,
                Some(node) if node.is_member => return true,
                Some(_) if level == cell.level => return false,
                Some(node) => {
                    at = node.children[octant_of(cell, level)] as usize;
                    if at == 0 {
                        return false;
                    }
                }
            }
        }
        false
    }

    /// Returns whether a box, given by its lowest and its highest corner, shares a point with a member.
    pub fn touches(&self, [low, high]: [Corner; 2]) -> bool {
        !self.nodes.is_empty() && self.touches_below(0, CellKey::ROOT, low, high)
    }

    fn touches_below(&self, at: usize, cell: CellKey, low: Corner, high: Corner) -> bool {
        let (first, last) = (cell.corner(0), cell.corner(7));
        let is_beside =
            (0..3).any(|axis| low.0[axis] > last.0[axis] || high.0[axis] < first.0[axis]);
        if is_beside {
            return false;
        }
        let node = &self.nodes[at];
        // a box that holds all of a cell holds its members
        let holds = (0..3).all(|axis| low.0[axis] <= first.0[axis] && last.0[axis] <= high.0[axis]);
        if node.is_member || holds {
            return true;
        }
        (0..8).any(|octant| {
            let child = node.children[octant] as usize;
            child != 0 && self.touches_below(child, cell.child(octant), low, high)
        })
    }

    /// Returns the members, each before those inside it.
    pub fn members(&self) -> Vec<CellKey> {
        let mut members = Vec::new();
        let mut to_visit = vec![(0, CellKey::ROOT)];
        while let Some((at, cell)) = to_visit.pop() {
            let Some(node) = self.nodes.get(at) else {
                break;
            };
            if node.is_member {
                members.push(cell);
            }
            let children = (0..8).filter(|&octant| node.children[octant] != 0);
            to_visit.extend(
                children.map(|octant| (node.children[octant] as usize, cell.child(octant))),
            );
        }
        members
    }
}

/// Returns the octant of the ancestor at a level that contains a cell.
fn octant_of(cell: CellKey, level: u8) -> usize {
    let half = CellKey::ROOT.side() >> (level + 1);
    let bit = |axis: usize| usize::from(cell.at.0[axis] & half != 0) << axis;
    bit(0) | bit(1) | bit(2)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Cells of a few levels, from a generator of random numbers.
    fn cells(seed: u32, count: usize) -> Vec<CellKey> {
        let mut state = seed;
        let mut random = move || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            state >> 8
        };
        let mut cell = || {
            let levels = random() % 5;
            (0..levels).fold(CellKey::ROOT.child(2), |cell, _| {
                cell.child(random() as usize / 7 % 8)
            })
        };
        (0..count).map(|_| cell()).collect()
    }

    fn corners(cell: CellKey) -> [Corner; 2] {
        [cell.corner(0), cell.corner(7)]
    }

    fn share_a_point([a, b]: [Corner; 2], [c, d]: [Corner; 2]) -> bool {
        (0..3).all(|axis| a.0[axis] <= d.0[axis] && c.0[axis] <= b.0[axis])
    }

    #[test]
    fn a_set_touches_what_a_member_touches() {
        for seed in 0..40 {
            let members = cells(seed, 6);
            let mut set = CellSet::default();
            for &cell in &members {
                set.insert(cell);
            }
            for cell in cells(seed + 1000, 60) {
                let touches = |&member: &CellKey| share_a_point(corners(member), corners(cell));
                assert_eq!(set.touches(corners(cell)), members.iter().any(touches));
                let point = [cell.corner(5); 2];
                let holds = |&member: &CellKey| share_a_point(corners(member), point);
                assert_eq!(set.touches(point), members.iter().any(holds));
                let is_in = |member: &CellKey| member.level <= cell.level && member.owns(cell.at);
                assert_eq!(set.contains(cell), members.iter().any(is_in));
            }
        }
    }

    #[test]
    fn members_are_listed_once() {
        let mut expected = cells(5, 50);
        let mut set = CellSet::default();
        for &cell in expected.iter().chain(&expected) {
            set.insert(cell);
        }
        let mut members = set.members();
        members.sort_unstable();
        expected.sort_unstable();
        expected.dedup();
        assert_eq!(members, expected);
    }

    #[test]
    fn nothing_touches_nothing() {
        let set = CellSet::default();
        assert!(!set.touches(corners(CellKey::ROOT)) && !set.contains(CellKey::ROOT));
        assert!(set.members().is_empty());
    }
}

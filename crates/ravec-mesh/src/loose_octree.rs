//! A loose octree of triangles that come and go.
//!
//! A box lives in the cell that holds its center, at the deepest level whose cells are no smaller than the box; so it sticks
//! out of its cell by no more than half a cell, and moving it costs one way down the tree. A search for a box visits the
//! cells that meet it when grown by half; of those, only the ones whose boxes it meets. These grow with what is added and
//! never shrink, which is right though not tight.
//!
//! Source: Ulrich, "Loose Octrees", *Game Programming Gems*, 2000.

use glam::DVec3;

use crate::Aabb;

const NONE: u32 = u32::MAX;

/// The deepest level. Smaller triangles share the cells of this one; that they are crowded a millionth of the mesh apart
/// is not expected.
const DEPTH: u32 = 20;

/// Largest overhang of a box beyond its cell, relative to the cell: half, and the rounding of centers and cells.
const LOOSE: f64 = 0.5 + 1e-6;

#[derive(Debug, Clone, Copy)]
struct Node {
    children: [u32; 8],
    /// The first item of this cell.
    first: u32,
    /// Items in this cell and all below.
    count: u32,
    /// A box around all of them.
    bounds: Rounded,
}

impl Node {
    const EMPTY: Self = Self {
        children: [NONE; 8],
        first: NONE,
        count: 0,
        bounds: Rounded::EMPTY,
    };
}

#[derive(Debug, Clone, Copy)]
struct Item {
    next: u32,
    previous: u32,
    node: u32,
    bounds: Rounded,
}

impl Item {
    const AWAY: Self = Self {
        next: NONE,
        previous: NONE,
        node: NONE,
        bounds: Rounded::EMPTY,
    };
}

/// A box rounded outward.
#[derive(Debug, Clone, Copy)]
struct Rounded {
    min: [f32; 3],
    max: [f32; 3],
}

impl Rounded {
    const EMPTY: Self = Self {
        min: [f32::INFINITY; 3],
        max: [f32::NEG_INFINITY; 3],
    };

    #[inline]
    fn around(bounds: &Aabb) -> Self {
        let down = |x: f64| {
            let rounded = x as f32;
            if f64::from(rounded) > x {
                rounded.next_down()
            } else {
                rounded
            }
        };
        let (min, max) = (bounds.min.to_array(), bounds.max.to_array());
        Self {
            min: min.map(down),
            max: max.map(|x| -down(-x)),
        }
    }

    #[inline]
    fn include(&mut self, other: &Self) {
        for axis in 0..3 {
            self.min[axis] = self.min[axis].min(other.min[axis]);
            self.max[axis] = self.max[axis].max(other.max[axis]);
        }
    }

    #[inline]
    fn touches(&self, other: &Self) -> bool {
        let apart =
            |axis: usize| self.min[axis] > other.max[axis] || other.min[axis] > self.max[axis];
        !(apart(0) | apart(1) | apart(2))
    }
}

/// Cell of a box.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Address {
    level: u32,
    cell: [u32; 3],
}

impl Address {
    const ROOT: Self = Self {
        level: 0,
        cell: [0; 3],
    };
}

/// Items, named by numbers, by their boxes.
#[derive(Debug, Clone)]
pub(crate) struct LooseOctree {
    min: DVec3,
    side: f64,
    nodes: Vec<Node>,
    items: Vec<Item>,
    addresses: Vec<Address>,
}

impl LooseOctree {
    /// An octree over `bounds` for items named from 0 to `items - 1`.
    pub fn new(bounds: Aabb, items: usize) -> Self {
        // room for what moves out of the box a little
        let side = 1.5 * bounds.size().max_element().max(f64::MIN_POSITIVE);
        Self {
            min: bounds.center() - 0.5 * side,
            side,
            nodes: vec![Node::EMPTY],
            items: vec![Item::AWAY; items],
            addresses: vec![Address::ROOT; items],
        }
    }

    #[inline]
    fn address(&self, bounds: &Aabb) -> Address {
        let extent = bounds.size().max_element();
        let local = (bounds.center() - self.min) / self.side;
        // what sticks out of the whole lives at the root, which is always visited
        if local.min_element() < 0.0 || local.max_element() >= 1.0 {
            return Address::ROOT;
        }
        let ratio = self.side / extent;
        // the exponent of a number is the integer below its binary logarithm
        let exponent = ((ratio.to_bits() >> 52) & 0x7ff) as i64 - 1023;
        let level = exponent.clamp(0, DEPTH.into()) as u32;
        let cells = f64::from(1_u32 << level);
        Address {
            level,
            cell: (local * cells).to_array().map(|x| x as u32),
        }
    }

    /// Adds an item with the next number.
    pub fn add(&mut self, bounds: &Aabb) {
        let item = self.items.len() as u32;
        self.items.push(Item::AWAY);
        self.addresses.push(Address::ROOT);
        self.insert(item, bounds);
    }

    /// Adds an item that is not there.
    pub fn insert(&mut self, item: u32, bounds: &Aabb) {
        let address = self.address(bounds);
        let bounds = Rounded::around(bounds);
        let mut node = 0_usize;
        self.nodes[0].count += 1;
        self.nodes[0].bounds.include(&bounds);
        for level in (0..address.level).rev() {
            let octant = (0..3)
                .map(|axis| ((address.cell[axis] >> level & 1) as usize) << axis)
                .sum::<usize>();
            let mut child = self.nodes[node].children[octant];
            if child == NONE {
                child = self.nodes.len() as u32;
                self.nodes[node].children[octant] = child;
                self.nodes.push(Node::EMPTY);
            }
            node = child as usize;
            self.nodes[node].count += 1;
            self.nodes[node].bounds.include(&bounds);
        }
        let next = self.nodes[node].first;
        if next != NONE {
            self.items[next as usize].previous = item;
        }
        self.nodes[node].first = item;
        self.items[item as usize] = Item {
            next,
            previous: NONE,
            node: node as u32,
            bounds,
        };
        self.addresses[item as usize] = address;
    }

    /// Removes an item that is there.
    pub fn remove(&mut self, item: u32) {
        let address = self.addresses[item as usize];
        let mut node = 0_usize;
        self.nodes[0].count -= 1;
        for level in (0..address.level).rev() {
            let octant = (0..3)
                .map(|axis| ((address.cell[axis] >> level & 1) as usize) << axis)
                .sum::<usize>();
            node = self.nodes[node].children[octant] as usize;
            self.nodes[node].count -= 1;
        }
        let Item {
            next,
            previous,
            node,
            ..
        } = self.items[item as usize];
        if next != NONE {
            self.items[next as usize].previous = previous;
        }
        if previous == NONE {
            self.nodes[node as usize].first = next;
        } else {
            self.items[previous as usize].next = next;
        }
    }

    /// Gives an item that is there another box.
    pub fn update(&mut self, item: u32, bounds: &Aabb) {
        self.remove(item);
        self.insert(item, bounds);
    }

    /// Appends all items whose boxes meet `bounds`, or nearly.
    pub fn search(&self, bounds: &Aabb, stack: &mut Vec<(u32, DVec3, f64)>, found: &mut Vec<u32>) {
        let wanted = Rounded::around(bounds);
        stack.clear();
        stack.push((0, self.min, self.side));
        while let Some((node, corner, side)) = stack.pop() {
            let node = &self.nodes[node as usize];
            let mut item = node.first;
            while item != NONE {
                let held = &self.items[item as usize];
                if held.bounds.touches(&wanted) {
                    found.push(item);
                }
                item = held.next;
            }
            let half = 0.5 * side;
            // along each axis the lower half of the node is met, the upper one, or both
            let middle = corner + half;
            let lower = (bounds.min - LOOSE * half).cmple(middle).bitmask();
            let upper = middle.cmple(bounds.max + LOOSE * half).bitmask();
            for (octant, &child) in (0_u32..).zip(&node.children) {
                let met = (!octant & lower) | (octant & upper);
                if met != 7 || child == NONE {
                    continue;
                }
                let below = &self.nodes[child as usize];
                if below.count == 0 || !below.bounds.touches(&wanted) {
                    continue;
                }
                let bit = |axis: u32| f64::from(octant >> axis & 1);
                stack.push((
                    child,
                    corner + half * DVec3::new(bit(0), bit(1), bit(2)),
                    half,
                ));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn boxes() -> impl Strategy<Value = Aabb> {
        let place = [-1.0..1.0, -1.0..1.0, -1.0..1.0].prop_map(DVec3::from_array);
        (place, 0_i32..24, [0.0..1.0, 0.0..1.0, 0.0..1.0]).prop_map(|(min, shrink, size)| {
            Aabb::new(min, min + DVec3::from_array(size) * 0.5_f64.powi(shrink))
        })
    }

    proptest! {
        #[test]
        fn nothing_that_meets_a_box_is_missed_whatever_came_and_went(
            first in prop::collection::vec(boxes(), 40),
            more in prop::collection::vec(boxes(), 0..10),
            second in prop::collection::vec((any::<prop::sample::Index>(), prop::option::of(boxes())), 0..60),
            asked in prop::collection::vec(boxes(), 10),
        ) {
            // some of the boxes are out of the range the tree was made for
            let mut tree = LooseOctree::new(Aabb::new(DVec3::splat(-0.5), DVec3::splat(0.5)), first.len());
            let mut now: Vec<Option<Aabb>> = first.into_iter().map(Some).collect();
            for (i, bounds) in now.iter().enumerate() {
                tree.insert(i as u32, &bounds.unwrap());
            }
            for bounds in more {
                tree.add(&bounds);
                now.push(Some(bounds));
            }
            for (at, bounds) in second {
                let i = at.index(now.len());
                match (now[i], bounds) {
                    (Some(_), Some(bounds)) => tree.update(i as u32, &bounds),
                    (Some(_), None) => tree.remove(i as u32),
                    (None, Some(bounds)) => tree.insert(i as u32, &bounds),
                    (None, None) => {}
                }
                now[i] = bounds;
            }
            for bounds in asked {
                let mut found = Vec::new();
                tree.search(&bounds, &mut Vec::new(), &mut found);
                found.sort_unstable();
                prop_assert!(found.windows(2).all(|pair| pair[0] != pair[1]));
                for (i, held) in now.iter().enumerate() {
                    let meets = held.is_some_and(|held| held.touches(&bounds));
                    let listed = found.binary_search(&(i as u32)).is_ok();
                    prop_assert!(!meets || listed);
                    prop_assert!(held.is_some() || !listed);
                }
            }
        }
    }
}

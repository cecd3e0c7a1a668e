//! A node: the boxes of up to eight children, and what they hold.

use super::frame::LocalBox;
use fearless_simd::{Level, dispatch, f32x8, prelude::*};

/// Children of a node: as many `f32` as the widest common vector registers hold.
pub(super) const WIDTH: usize = 8;

/// More than the largest number of entries a traversal ever holds: see [`super::build::MAX_DEPTH`].
pub(super) const STACK: usize = 192;

/// Bound on the number of nodes, so that the place of a box, its node times eight and its lane, is a `u32`.
pub(super) const MAX_NODES: usize = 1 << 29;

/// Up to eight boxes with what they hold.
#[derive(Debug, Clone, Copy)]
#[repr(align(32))]
pub(super) struct Node {
    pub boxes: Boxes,
    pub children: Children,
}

/// Eight boxes side by side, one axis after the other.
#[derive(Debug, Clone, Copy)]
pub(super) struct Boxes {
    pub min: [[f32; WIDTH]; 3],
    pub max: [[f32; WIDTH]; 3],
}

/// Contents of the boxes of a node.
#[derive(Debug, Clone, Copy)]
pub(super) struct Children {
    index: [u32; WIDTH],
    /// The triangles of a leaf; 0 for a node.
    count: [u8; WIDTH],
    len: u8,
}

/// Content of a box: a node, or a run of triangles.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Child {
    Node(u32),
    Leaf { first: u32, count: u32 },
}

impl Node {
    pub const EMPTY: Self = Self {
        boxes: Boxes::EMPTY,
        children: Children {
            index: [0; WIDTH],
            count: [0; WIDTH],
            len: 0,
        },
    };

    pub fn push(&mut self, bounds: &LocalBox, child: Child) {
        self.boxes.set(self.children.len(), bounds);
        self.children.push(child);
    }

    pub fn len(&self) -> usize {
        self.children.len()
    }

    #[inline]
    pub fn child(&self, lane: usize) -> Child {
        self.children.get(lane)
    }

    /// The box of a child.
    #[inline]
    pub fn bounds(&self, lane: usize) -> LocalBox {
        self.boxes.get(lane)
    }

    /// As [`Boxes::touching`].
    #[inline]
    pub fn touching(&self, other: &LocalBox) -> u32 {
        self.boxes.touching(other)
    }
}

impl Children {
    fn push(&mut self, child: Child) {
        let lane = self.len();
        (self.index[lane], self.count[lane]) = match child {
            Child::Node(node) => (node, 0),
            Child::Leaf { first, count } => (first, count as u8),
        };
        self.len += 1;
    }

    #[inline]
    pub fn len(&self) -> usize {
        self.len as usize
    }

    /// A bit for each lane that holds something.
    #[inline]
    pub fn mask(&self) -> u32 {
        (1 << self.len) - 1
    }

    #[inline]
    pub fn get(&self, lane: usize) -> Child {
        match (self.index[lane], self.count[lane]) {
            (node, 0) => Child::Node(node),
            (first, count) => Child::Leaf {
                first,
                count: count.into(),
            },
        }
    }

    /// Renames the nodes among the children: `by` is added to their index.
    pub fn shift_nodes(&mut self, by: u32) {
        for lane in 0..self.len() {
            if self.count[lane] == 0 {
                self.index[lane] += by;
            }
        }
    }
}

impl Boxes {
    pub const EMPTY: Self = Self {
        min: [[f32::INFINITY; WIDTH]; 3],
        max: [[f32::NEG_INFINITY; WIDTH]; 3],
    };

    pub fn set(&mut self, lane: usize, bounds: &LocalBox) {
        for axis in 0..3 {
            self.min[axis][lane] = bounds.min[axis];
            self.max[axis][lane] = bounds.max[axis];
        }
    }

    #[inline]
    pub fn get(&self, lane: usize) -> LocalBox {
        LocalBox {
            min: [0, 1, 2].map(|axis| self.min[axis][lane]),
            max: [0, 1, 2].map(|axis| self.max[axis][lane]),
        }
    }

    /// A bit for each box that shares a point with `other`; none where there is no box.
    #[inline]
    pub fn touching(&self, other: &LocalBox) -> u32 {
        // a few comparisons gain nothing from wider registers
        dispatch!(Level::baseline(), simd => self.touching_with(simd, other))
    }

    #[inline(always)]
    fn touching_with<S: Simd>(&self, simd: S, other: &LocalBox) -> u32 {
        let mut touches = 0xff;
        for axis in 0..3 {
            let (min, max) = self.along(simd, axis);
            let both = min.simd_le(other.max[axis]) & max.simd_ge(other.min[axis]);
            touches &= both.to_bitmask() as u32;
        }
        touches
    }

    /// The boxes' least and largest coordinates along an axis.
    #[inline(always)]
    fn along<S: Simd>(&self, simd: S, axis: usize) -> (f32x8<S>, f32x8<S>) {
        (
            self.min[axis].simd_into(simd),
            self.max[axis].simd_into(simd),
        )
    }

    /// The squared distance from `p` to each box; infinite where there is none.
    #[inline(always)]
    pub fn distances_sq<S: Simd>(&self, simd: S, p: [f32; 3]) -> f32x8<S> {
        self.distances_sq_to(simd, &LocalBox { min: p, max: p })
    }

    /// The squared distance from another box to each box; infinite where there is none.
    #[inline(always)]
    pub fn distances_sq_to<S: Simd>(&self, simd: S, other: &LocalBox) -> f32x8<S> {
        let mut sum = f32x8::splat(simd, 0.0);
        for axis in 0..3 {
            let (min, max) = self.along(simd, axis);
            let low = f32x8::splat(simd, other.min[axis]);
            let outside = (min - other.max[axis]).max(low - max).max(0.0);
            sum += outside * outside;
        }
        sum
    }
}

/// The lanes whose bits are set, in order.
#[inline(always)]
pub(super) fn lanes(mut bits: u32) -> impl Iterator<Item = usize> {
    std::iter::from_fn(
        #[inline(always)]
        move || {
            let lane = (bits != 0).then(|| bits.trailing_zeros() as usize % WIDTH)?;
            bits &= bits - 1;
            Some(lane)
        },
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Boxes with corners on a coarse grid, so that many touch just so.
    fn local_box() -> impl Strategy<Value = LocalBox> {
        let interval = (-4_i8..4, 0_i8..4).prop_map(|(low, size)| [low, low + size].map(f32::from));
        [interval.clone(), interval.clone(), interval].prop_map(|axes| LocalBox {
            min: axes.map(|[low, _]| low),
            max: axes.map(|[_, high]| high),
        })
    }

    /// The plain definition.
    fn distance_sq(a: &LocalBox, b: &LocalBox) -> f32 {
        let outside = |axis: usize| (a.min[axis] - b.max[axis]).max(b.min[axis] - a.max[axis]);
        let along = |axis: usize| outside(axis).max(0.0);
        [0, 1, 2].map(|axis| along(axis).powi(2)).into_iter().sum()
    }

    proptest! {
        #[test]
        fn all_lanes_say_what_one_says_whatever_the_instructions(
            boxes in prop::collection::vec(local_box(), 0..=WIDTH),
            other in local_box(),
        ) {
            let mut lanes_of = Boxes::EMPTY;
            for (lane, bounds) in boxes.iter().enumerate() {
                lanes_of.set(lane, bounds);
            }
            let touched: Vec<usize> = lanes(lanes_of.touching(&other)).collect();
            let expected = (0..boxes.len()).filter(|&lane| boxes[lane].touches(&other));
            prop_assert_eq!(touched, expected.collect::<Vec<_>>());
            for vectors in [Level::baseline(), Level::new()] {
                let found: [f32; WIDTH] =
                    dispatch!(vectors, simd => lanes_of.distances_sq_to(simd, &other).into());
                for (lane, &found) in found.iter().enumerate() {
                    let far = boxes.get(lane).map_or(f32::INFINITY, |a| distance_sq(a, &other));
                    prop_assert_eq!(found, far);
                }
            }
        }
    }
}

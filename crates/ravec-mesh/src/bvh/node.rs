//! A node: the boxes of up to eight children, and what they hold.

use super::frame::LocalBox;

/// Children of a node: as many `f32` as the widest common vector registers hold.
pub(super) const WIDTH: usize = 8;

/// More than the largest number of entries a traversal ever holds: see [`super::build::MAX_DEPTH`].
pub(super) const STACK: usize = 192;

/// So many that the place of a box, its node times eight and its lane, is a `u32`.
pub(super) const MOST_NODES: usize = 1 << 29;

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

/// What the boxes of a node hold.
#[derive(Debug, Clone, Copy)]
pub(super) struct Children {
    index: [u32; WIDTH],
    /// The triangles of a leaf; 0 for a node.
    count: [u8; WIDTH],
    len: u8,
}

/// What a box holds: a node, or a run of triangles.
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

    /// Which boxes share a point with `other`; none where there is no box.
    #[inline]
    pub fn touching(&self, other: &LocalBox) -> [bool; WIDTH] {
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

    /// Which boxes share a point with `other`; none where there is no box.
    #[inline]
    pub fn touching(&self, other: &LocalBox) -> [bool; WIDTH] {
        let mut touches = [true; WIDTH];
        for axis in 0..3 {
            for (lane, touches) in touches.iter_mut().enumerate() {
                let (below, above) = (
                    self.min[axis][lane] <= other.max[axis],
                    other.min[axis] <= self.max[axis][lane],
                );
                // Without branches, so that all lanes are compared at once.
                *touches = *touches & below & above;
            }
        }
        touches
    }

    /// The squared distance from `p` to each box; infinite where there is none.
    #[inline]
    pub fn distances_sq(&self, p: [f32; 3]) -> [f32; WIDTH] {
        self.distances_sq_to(&LocalBox { min: p, max: p })
    }

    /// The squared distance from another box to each box; infinite where there is none.
    #[inline]
    pub fn distances_sq_to(&self, other: &LocalBox) -> [f32; WIDTH] {
        let mut sum = [0.0; WIDTH];
        for axis in 0..3 {
            let (low, high) = (other.min[axis], other.max[axis]);
            for ((sum, min), max) in sum.iter_mut().zip(&self.min[axis]).zip(&self.max[axis]) {
                let outside = larger(larger(min - high, low - max), 0.0);
                *sum += outside * outside;
            }
        }
        sum
    }
}

/// A bit for each lane of which `is` is true.
#[inline(always)]
pub(super) fn mask_of(is: impl Fn(usize) -> bool) -> u32 {
    // first side by side, then added up, so that all lanes are compared at once
    let bits: [u32; WIDTH] = std::array::from_fn(|lane| if is(lane) { 1 << lane } else { 0 });
    bits.into_iter().sum()
}

/// The maximum as one instruction: `f32::max` takes more for the sake of NaN.
#[inline(always)]
fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

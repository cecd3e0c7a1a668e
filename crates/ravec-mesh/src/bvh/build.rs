//! From boxes of triangles to nodes.
//!
//! Top down: a range of triangles is cut in two where the surface area heuristic is lowest over 16 bins of each axis
//! (Wald, *On fast Construction of SAH-based Bounding Volume Hierarchies*, 2007), and the larger part is cut again until
//! there are eight, the children of one node. We differ in: the last few triangles of a range are dealt out to all eight
//! children of a node, since a node with few children costs as much to visit and to keep as a full one. The shape depends
//! only on the mesh: large ranges are built in parallel and put together in order.

use glam::DVec3;
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;

use super::frame::{Frame, LocalBox};
use super::node::{Child, MAX_NODES, Node, WIDTH};

/// Most triangles in a leaf.
const LEAF: usize = 4;

/// Most triangles below a node whose children are all leaves; they hold one or two each.
///
/// With 16 the nodes take 13 bytes more a triangle, and queries are no faster. No more than [`WIDTH`] leaves can hold.
const BOTTOM: usize = 20;

/// Depth below which ranges are halved by number, whatever the heuristic says.
///
/// This bounds the depth: 12 levels; then 2^32 triangles shrink by 8 a level until there are at most 160, 9 levels; and 2
/// levels until there are at most [`BOTTOM`], and one for these. Each level leaves at most 7 children for later on a stack, in all fewer than [`super::node::STACK`]. Real meshes stay above it.
pub(super) const MAX_DEPTH: usize = 12;

/// Bins of an axis. With 8 queries are 2 % slower; more than 16 gain nothing.
const BINS: usize = 16;

/// Bins of an axis for no more than [`BOTTOM`] triangles.
const FEW_BINS: usize = 8;

/// Ranges from this size on are built in parallel.
const PARALLEL: usize = 8192;

/// Effort spent on good boxes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Effort {
    /// Cuts are searched along all axes.
    Thorough,
    /// Cuts are searched along the longest axis only: in half the time, for boxes that cost a tenth more to search.
    Quick,
}

/// The box of one triangle.
#[derive(Debug, Clone, Copy)]
pub(super) struct Prim {
    pub bounds: LocalBox,
    pub triangle: u32,
}

impl Prim {
    pub fn new(frame: &Frame, [a, b, c]: [DVec3; 3], triangle: u32) -> Self {
        Self {
            bounds: frame.local_box(a.min(b).min(c), a.max(b).max(c)),
            triangle,
        }
    }

    /// Twice the middle of the box along an axis.
    #[inline]
    fn middle(&self, axis: usize) -> f32 {
        self.bounds.min[axis] + self.bounds.max[axis]
    }
}

impl LocalBox {
    const EMPTY: Self = Self {
        min: [f32::INFINITY; 3],
        max: [f32::NEG_INFINITY; 3],
    };

    #[inline]
    fn include(&mut self, other: &Self) {
        // one instruction each: `f32::min` takes more for the sake of NaN
        let smaller = |a: f32, b: f32| if a < b { a } else { b };
        let larger = |a: f32, b: f32| if a > b { a } else { b };
        for axis in 0..3 {
            self.min[axis] = smaller(other.min[axis], self.min[axis]);
            self.max[axis] = larger(other.max[axis], self.max[axis]);
        }
    }

    /// Grows to hold the middle of a triangle's box, twice.
    #[inline]
    fn include_middle(&mut self, prim: &Prim) {
        let middle = [0, 1, 2].map(|axis| prim.middle(axis));
        self.include(&Self {
            min: middle,
            max: middle,
        });
    }

    /// Half the area of the surface; 0 if empty.
    #[inline]
    fn half_area(&self) -> f32 {
        let [x, y, z] = [0, 1, 2].map(|axis| (self.max[axis] - self.min[axis]).max(0.0));
        x * y + y * z + z * x
    }
}

/// The nodes over `prims`, root first; `prims` are put in the order of the leaves.
///
/// # Errors
/// [`Cancelled`] soon after `progress` is cancelled.
///
/// # Panics
/// If there are more than [`MAX_NODES`].
pub(super) fn nodes(
    prims: &mut [Prim],
    effort: Effort,
    progress: &Progress,
) -> Result<Vec<Node>, Cancelled> {
    let mut nodes = Vec::new();
    if !prims.is_empty() {
        build(Part::of(prims), 0, 0, &mut nodes, effort, progress)?;
    }
    assert!(nodes.len() <= MAX_NODES, "too many triangles");
    Ok(nodes)
}

/// A part of a range on its way to becoming a child.
struct Part<'a> {
    prims: &'a mut [Prim],
    bounds: LocalBox,
    /// The range of the middles, twice.
    middles: LocalBox,
}

impl<'a> Part<'a> {
    fn of(prims: &'a mut [Prim]) -> Self {
        let (mut bounds, mut middles) = (LocalBox::EMPTY, LocalBox::EMPTY);
        for prim in &*prims {
            bounds.include(&prim.bounds);
            middles.include_middle(prim);
        }
        Self {
            prims,
            bounds,
            middles,
        }
    }

    /// The axis along which the middles reach farthest, the first of equals.
    fn longest(&self) -> usize {
        let LocalBox { min, max } = self.middles;
        (0..3).fold(0, |best, axis| {
            if max[axis] - min[axis] > max[best] - min[best] {
                axis
            } else {
                best
            }
        })
    }

    /// Cuts off the `lower` lowest triangles along the longest axis.
    fn halved(self, lower: usize) -> [Self; 2] {
        let axis = self.longest();
        self.prims.select_nth_unstable_by(lower, |a, b| {
            let by_place = a.middle(axis).total_cmp(&b.middle(axis));
            by_place.then(a.triangle.cmp(&b.triangle))
        });
        let (left, right) = self.prims.split_at_mut(lower);
        [Self::of(left), Self::of(right)]
    }
}

/// Appends the node over a part, whose triangles start at slot `first`, and all nodes below it.
fn build(
    part: Part<'_>,
    first: usize,
    depth: usize,
    nodes: &mut Vec<Node>,
    effort: Effort,
    progress: &Progress,
) -> Result<(), Cancelled> {
    let at = nodes.len();
    nodes.push(Node::EMPTY);
    let parallel = part.prims.len() >= PARALLEL;
    let parts = if part.prims.len() <= BOTTOM {
        let mut parts = Vec::with_capacity(WIDTH);
        cut_into_leaves(part, WIDTH, effort, &mut parts);
        parts
    } else {
        cut_in_eight(part, depth, effort, progress)?
    };
    let firsts: Vec<usize> = parts
        .iter()
        .scan(first, |next, part| {
            *next += part.prims.len();
            Some(*next - part.prims.len())
        })
        .collect();
    let mut node = Node::EMPTY;
    if parallel {
        let bounds: Vec<(LocalBox, usize)> = parts
            .iter()
            .map(|part| (part.bounds, part.prims.len()))
            .collect();
        let subtrees: Vec<Vec<Node>> = parts
            .into_par_iter()
            .zip(&firsts)
            .map(|(part, &first)| {
                let mut subtree = Vec::new();
                if part.prims.len() > LEAF {
                    build(part, first, depth + 1, &mut subtree, effort, progress)?;
                }
                Ok(subtree)
            })
            .collect::<Result<_, Cancelled>>()?;
        for ((mut subtree, (bounds, count)), &first) in
            subtrees.into_iter().zip(bounds).zip(&firsts)
        {
            let root = nodes.len() as u32;
            node.push(&bounds, child(root, first, count));
            for node in &mut subtree {
                node.children.shift_nodes(root);
            }
            nodes.append(&mut subtree);
        }
    } else {
        for (part, &first) in parts.into_iter().zip(&firsts) {
            node.push(
                &part.bounds,
                child(nodes.len() as u32, first, part.prims.len()),
            );
            if part.prims.len() > LEAF {
                build(part, first, depth + 1, nodes, effort, progress)?;
            }
        }
    }
    nodes[at] = node;
    Ok(())
}

fn child(node: u32, first: usize, count: usize) -> Child {
    if count > LEAF {
        Child::Node(node)
    } else {
        Child::Leaf {
            first: first as u32,
            count: count as u32,
        }
    }
}

/// At most eight parts of a range, in order, none of them empty.
fn cut_in_eight<'a>(
    part: Part<'a>,
    depth: usize,
    effort: Effort,
    progress: &Progress,
) -> Result<Vec<Part<'a>>, Cancelled> {
    let mut parts = Vec::with_capacity(WIDTH);
    parts.push(part);
    while parts.len() < WIDTH {
        progress.check()?;
        // The part that is the most likely to be looked into; the first of equals.
        let worth = |part: &Part<'_>| match part.prims.len() {
            0..=BOTTOM => -1.0,
            count if depth >= MAX_DEPTH => count as f32,
            _ => part.bounds.half_area(),
        };
        let mut best = (0, -1.0);
        for (i, part) in parts.iter().enumerate() {
            if worth(part) > best.1 {
                best = (i, worth(part));
            }
        }
        if best.1 < 0.0 {
            break;
        }
        let part = parts.remove(best.0);
        let half = part.prims.len() / 2;
        let halves = if depth >= MAX_DEPTH {
            part.halved(half)
        } else {
            cut_cheaply::<BINS>(part, effort, |_| true).unwrap_or_else(|part| part.halved(half))
        };
        for (offset, part) in halves.into_iter().enumerate() {
            parts.insert(best.0 + offset, part);
        }
    }
    Ok(parts)
}

/// Appends `lanes` parts of a range that are leaves, in order, or one for each triangle if there are fewer. All triangles
/// must fit in `lanes` leaves.
fn cut_into_leaves<'a>(part: Part<'a>, lanes: usize, effort: Effort, parts: &mut Vec<Part<'a>>) {
    let count = part.prims.len();
    let lanes = lanes.min(count);
    if lanes <= 1 {
        parts.push(part);
        return;
    }
    let lanes_of = |count: usize| count.div_ceil(LEAF);
    let fits = |at: usize| lanes_of(at) + lanes_of(count - at) <= lanes;
    let [left, right] = cut_cheaply::<FEW_BINS>(part, effort, fits)
        .unwrap_or_else(|part| part.halved((count / 2).min(lanes / 2 * LEAF)));
    // Each side gets its share of the leaves, but no fewer than it needs, and no more than it can fill.
    let at = left.prims.len();
    let share = (lanes * at + count / 2) / count;
    let least = lanes_of(at).max(lanes.saturating_sub(count - at));
    let most = (lanes - lanes_of(count - at)).min(at);
    let lower = share.clamp(least, most);
    cut_into_leaves(left, lower, effort, parts);
    cut_into_leaves(right, lanes - lower, effort, parts);
}

/// The two sides of the cheapest cut. The part as it was if there is no cut between bins after a number of triangles that `fits`.
fn cut_cheaply<const BINS: usize>(
    part: Part<'_>,
    effort: Effort,
    fits: impl Fn(usize) -> bool,
) -> Result<[Part<'_>; 2], Part<'_>> {
    match effort {
        Effort::Thorough => cut_along::<BINS, 3>(part, 0, fits),
        Effort::Quick => {
            let axis = part.longest();
            cut_along::<BINS, 1>(part, axis, fits)
        }
    }
}

/// As [`cut_cheaply`], along `AXES` axes from `first` on.
fn cut_along<const BINS: usize, const AXES: usize>(
    part: Part<'_>,
    first: usize,
    fits: impl Fn(usize) -> bool,
) -> Result<[Part<'_>; 2], Part<'_>> {
    let LocalBox {
        min: low,
        max: high,
    } = part.middles;
    let per_unit = [0, 1, 2].map(|axis| BINS as f32 / (high[axis] - low[axis]));
    let bin_of = |prim: &Prim, axis: usize| {
        (((prim.middle(axis) - low[axis]) * per_unit[axis]) as usize).min(BINS - 1)
    };
    let mut bins = [[(LocalBox::EMPTY, 0_usize); BINS]; AXES];
    for prim in &*part.prims {
        for (axis, bins) in (first..).zip(&mut bins) {
            let bin = &mut bins[bin_of(prim, axis)];
            bin.0.include(&prim.bounds);
            bin.1 += 1;
        }
    }
    let mut best = (f32::INFINITY, 0, 0);
    for (axis, bins) in (first..).zip(&bins) {
        // Where all middles agree there is nothing to cut.
        if !per_unit[axis].is_finite() {
            continue;
        }
        let mut above = [0.0; BINS];
        let mut sum = (LocalBox::EMPTY, 0);
        for bin in (1..BINS).rev() {
            sum.0.include(&bins[bin].0);
            sum.1 += bins[bin].1;
            above[bin] = sum.0.half_area() * sum.1 as f32;
        }
        let mut sum = (LocalBox::EMPTY, 0);
        for bin in 1..BINS {
            sum.0.include(&bins[bin - 1].0);
            sum.1 += bins[bin - 1].1;
            let cost = sum.0.half_area() * sum.1 as f32 + above[bin];
            if sum.1 > 0 && sum.1 < part.prims.len() && cost < best.0 && fits(sum.1) {
                best = (cost, axis, bin);
            }
        }
    }
    let (cost, axis, bin) = best;
    if cost.is_infinite() {
        return Err(part);
    }
    let mut at = 0;
    let mut middles = [LocalBox::EMPTY; 2];
    for i in 0..part.prims.len() {
        let prim = part.prims[i];
        let is_lower = bin_of(&prim, axis) < bin;
        middles[usize::from(!is_lower)].include_middle(&prim);
        if is_lower {
            part.prims.swap(at, i);
            at += 1;
        }
    }
    let (lower, upper) = part.prims.split_at_mut(at);
    let around = |bins: &[(LocalBox, usize)]| {
        bins.iter().fold(LocalBox::EMPTY, |mut sum, bin| {
            sum.include(&bin.0);
            sum
        })
    };
    let [of_lower, of_upper] = middles;
    Ok([
        Part {
            prims: lower,
            bounds: around(&bins[axis - first][..bin]),
            middles: of_lower,
        },
        Part {
            prims: upper,
            bounds: around(&bins[axis - first][bin..]),
            middles: of_upper,
        },
    ])
}

//! Simple loops out of a chain without boundary, and the surfaces that fill them.
//!
//! 1. From each edge that is left the shortest way back is taken, so that loops which touch come apart.
//! 2. Two loops near each other may be better filled by a band between them than each for itself, as the two rims of a
//!    ring: they are joined by a bridge into one polygon, and if that has a surface of notably less area, it stays.
//!
//! A band that repeats the wall between its loops, as the one between the rims of a short tube does, closes nothing (`walls`);
//! such loops get a lid each.
//!
//! The winding number chooses bands in the same places: the surface where the wall of an open tube winds a half goes over from
//! two lids to a band where the tube is 1.15 radii long, least area where it is 1.06 radii long.
//!
//! Cost: O(n log n) for n edges where loops touch in few places; each join as a patch of as many corners, of which there are at
//! most [`JOIN_CORNERS`] in all.

use super::edges::Chain;
use super::patch::{Patch, fill};
use super::strip::strip;
use super::walls::Walls;
use crate::params::CloseRule;
use glam::DVec3;
use ravec_mesh::Aabb;
use ravec_numeric::DisjointSets;
use ravec_progress::{Cancelled, Progress};
use rustc_hash::FxHashMap;
use std::cmp::Reverse;
use std::collections::{BTreeMap, BinaryHeap};

/// A polygon along the boundary, and the surface in it.
#[derive(Debug, Clone)]
pub(super) struct Filled {
    /// Its vertices, as the boundary runs; those at a bridge occur twice.
    pub vertices: Vec<u32>,
    /// The surface.
    pub patch: Patch,
    /// Number of loops that it was joined of.
    pub loops: u32,
}

/// Maximum number of loops, the longest ones, whose pairs are considered for joining.
const JOIN_LOOPS: usize = 1000;

/// Maximum number of corners that are triangulated on trial: about half a second.
const JOIN_CORNERS: usize = 30_000;

/// The share of the two loops' own surfaces that a common one must stay below to be taken.
const NOTABLY_LESS: f64 = 0.95;

/// Takes a chain without boundary apart into simple loops.
pub(super) fn simple_loops(
    chain: &Chain,
    at: &impl Fn(u32) -> DVec3,
    progress: &Progress,
) -> Result<Vec<Vec<u32>>, Cancelled> {
    let mut next: BTreeMap<u32, Vec<(u32, i64)>> = BTreeMap::new();
    for ([from, to], count) in chain.directed() {
        next.entry(from).or_default().push((to, count));
    }
    let mut loops = Vec::new();
    while let Some((&start, onward)) = next.first_key_value() {
        progress.check()?;
        let second = onward[0].0;
        let vertices = shortest(&next, second, start, at);
        for (i, &from) in vertices.iter().enumerate() {
            let to = vertices[(i + 1) % vertices.len()];
            let onward = next.get_mut(&from).expect("the way goes along edges");
            let edge = onward.iter().position(|edge| edge.0 == to);
            let edge = edge.expect("the way goes along edges");
            onward[edge].1 -= 1;
            if onward[edge].1 == 0 {
                onward.remove(edge);
                if onward.is_empty() {
                    next.remove(&from);
                }
            }
        }
        loops.push(vertices);
    }
    Ok(loops)
}

/// A number that is never negative, in an order.
#[derive(PartialEq, PartialOrd)]
struct Length(f64);

impl Eq for Length {}

#[expect(
    clippy::derive_ord_xor_partial_ord,
    reason = "lengths are numbers, for which both are the same"
)]
impl Ord for Length {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.0.total_cmp(&other.0)
    }
}

/// The vertices from `start` to `end` along the shortest way; there is one, since as many edges leave a vertex as enter it.
fn shortest(
    next: &BTreeMap<u32, Vec<(u32, i64)>>,
    start: u32,
    end: u32,
    at: &impl Fn(u32) -> DVec3,
) -> Vec<u32> {
    // by vertex, where the way comes from
    let mut settled: BTreeMap<u32, u32> = BTreeMap::new();
    let mut open = BinaryHeap::from([Reverse((Length(0.0), start, start))]);
    while let Some(Reverse((Length(length), v, from))) = open.pop() {
        if settled.contains_key(&v) {
            continue;
        }
        settled.insert(v, from);
        if v == end {
            break;
        }
        for &(to, _) in next.get(&v).into_iter().flatten() {
            if !settled.contains_key(&to) {
                let length = length + at(v).distance(at(to));
                open.push(Reverse((Length(length), to, v)));
            }
        }
    }
    let mut way = vec![end];
    let mut v = end;
    while v != start {
        v = settled[&v];
        way.push(v);
    }
    way.reverse();
    way
}

/// Fills loops, in common as `close` says.
pub(super) fn fill_loops(
    loops: Vec<Vec<u32>>,
    walls: &Walls,
    close: CloseRule,
    at: &impl Fn(u32) -> DVec3,
    progress: &Progress,
) -> Result<Vec<Filled>, Cancelled> {
    let mut filled = Vec::with_capacity(loops.len());
    for vertices in loops {
        progress.check()?;
        filled.push(Some(Filled {
            patch: filled_polygon(&vertices, at),
            vertices,
            loops: 1,
        }));
    }
    if matches!(close, CloseRule::Auto | CloseRule::Band) {
        join(&mut filled, walls, close, at, progress)?;
    }
    Ok(filled.into_iter().flatten().collect())
}

fn filled_polygon(vertices: &[u32], at: &impl Fn(u32) -> DVec3) -> Patch {
    let places: Vec<_> = vertices.iter().map(|&v| at(v)).collect();
    fill(&places)
}

/// Two loops that may be filled in common.
struct Neighbors {
    /// Their distance as a share of the smaller one's size.
    gap_rel: f64,
    loops: [usize; 2],
    /// The vertices at which they are nearest.
    bridge: [u32; 2],
}

fn join(
    filled: &mut [Option<Filled>],
    walls: &Walls,
    close: CloseRule,
    at: &impl Fn(u32) -> DVec3,
    progress: &Progress,
) -> Result<(), Cancelled> {
    let mut group = DisjointSets::new(filled.len());
    let mut room = JOIN_CORNERS;
    // bands that are asked for may be long
    let is_asked_for = close == CloseRule::Band;
    let reach = if is_asked_for { f64::INFINITY } else { 1.0 };
    let originals: Vec<Vec<u32>> = filled
        .iter()
        .flatten()
        .map(|own| own.vertices.clone())
        .collect();
    let pairs = neighbors(filled, reach, at, progress)?;
    let mut bands = Bands {
        originals: &originals,
        bridges: pairs.iter().map(|pair| (pair.loops, pair.bridge)).collect(),
        known: FxHashMap::default(),
    };
    let mut members: Vec<Vec<usize>> = (0..filled.len()).map(|own| vec![own]).collect();
    for pair in &pairs {
        progress.check()?;
        let [a, b] = pair.loops.map(|own| group.root(own as u32) as usize);
        let (Some(first), Some(second)) = (&filled[a], &filled[b]) else {
            continue;
        };
        if a == b || (is_asked_for && !face_each_other(first, second, at)) {
            continue;
        }
        let loops = first.loops + second.loops;
        let joined = if is_asked_for {
            let is_retraced = bands.is_retraced(pair.loops, walls, at);
            let strip = (!is_retraced)
                .then(|| bands.strip(pair.loops, at))
                .flatten();
            strip.map(|(vertices, patch)| Filled {
                vertices,
                patch,
                loops,
            })
        } else {
            let vertices = bridged(&first.vertices, &second.vertices, pair.bridge);
            let Some(left) = room.checked_sub(vertices.len()) else {
                continue;
            };
            room = left;
            let patch = filled_polygon(&vertices, at);
            let is_less = patch.area < NOTABLY_LESS * (first.patch.area + second.patch.area);
            let is_retraced = is_less
                && (walls.is_retraced(&vertices, &patch, at)
                    || bands.is_any_retraced([&members[a], &members[b]], walls, at));
            (is_less && !is_retraced).then_some(Filled {
                vertices,
                patch,
                loops,
            })
        };
        if let Some(joined) = joined {
            filled[a] = Some(joined);
            filled[b] = None;
            group.join_into(b as u32, a as u32);
            let more = std::mem::take(&mut members[b]);
            members[a].extend(more);
        }
    }
    Ok(())
}

/// Strips between loops, which say whether the mesh's own wall is between them: a surface of least area in a long polygon
/// follows a wall less closely.
struct Bands<'a> {
    /// The loops as they were before any were joined.
    originals: &'a [Vec<u32>],
    /// For pairs of loops that are near to each other the vertices at which they are nearest.
    bridges: FxHashMap<[usize; 2], [u32; 2]>,
    /// Pairs that were looked at, and whether the strip between them lies on the mesh.
    known: FxHashMap<[usize; 2], bool>,
}

impl Bands<'_> {
    /// The strip between two loops that are near to each other, unless they are too long.
    fn strip(&self, pair: [usize; 2], at: &impl Fn(u32) -> DVec3) -> Option<(Vec<u32>, Patch)> {
        let bridge = self.bridges.get(&pair)?;
        let own = pair.map(|own| &self.originals[own][..]);
        let places = own.map(|own| own.iter().map(|&v| at(v)).collect::<Vec<_>>());
        let start = |k: usize| own[k].iter().position(|v| *v == bridge[k]);
        let patch = strip(&places[0], &places[1], [start(0)?, start(1)?])?;
        Some((own.concat(), patch))
    }

    /// Returns `true` if the strip between two loops lies on the mesh.
    fn is_retraced(&mut self, pair: [usize; 2], walls: &Walls, at: &impl Fn(u32) -> DVec3) -> bool {
        if let Some(&known) = self.known.get(&pair) {
            return known;
        }
        let strip = self.strip(pair, at);
        let is_retraced =
            strip.is_some_and(|(vertices, patch)| walls.is_retraced(&vertices, &patch, at));
        self.known.insert(pair, is_retraced);
        is_retraced
    }

    /// The same for any two loops of two groups.
    fn is_any_retraced(
        &mut self,
        groups: [&[usize]; 2],
        walls: &Walls,
        at: &impl Fn(u32) -> DVec3,
    ) -> bool {
        let [one, other] = groups;
        one.iter().any(|&a| {
            let mut pairs = other.iter().flat_map(|&b| [[a, b], [b, a]]);
            pairs.any(|pair| self.bridges.contains_key(&pair) && self.is_retraced(pair, walls, at))
        })
    }
}

/// Returns `true` if neither of two loops was joined with another one and they run around opposite directions.
fn face_each_other(one: &Filled, other: &Filled, at: &impl Fn(u32) -> DVec3) -> bool {
    let area = |filled: &Filled| -> DVec3 {
        let vertices = &filled.vertices;
        let origin = at(vertices[0]);
        let sides = vertices.windows(2);
        sides
            .map(|v| (at(v[0]) - origin).cross(at(v[1]) - origin))
            .sum()
    };
    one.loops == 1 && other.loops == 1 && area(one).dot(area(other)) < 0.0
}

/// Pairs of loops that are nearer to each other than `reach` times the width of the smaller one, the relatively nearest first.
fn neighbors(
    filled: &[Option<Filled>],
    reach: f64,
    at: &impl Fn(u32) -> DVec3,
    progress: &Progress,
) -> Result<Vec<Neighbors>, Cancelled> {
    let mut loops: Vec<(usize, &[u32], Aabb)> = filled
        .iter()
        .enumerate()
        .filter_map(|(i, filled)| {
            let vertices = &filled.as_ref()?.vertices[..];
            Some((i, vertices, Aabb::around(vertices.iter().map(|&v| at(v)))))
        })
        .collect();
    loops.sort_by_key(|(i, vertices, _)| (Reverse(vertices.len()), *i));
    loops.truncate(JOIN_LOOPS);
    let mut pairs = Vec::new();
    for (i, (a, of_a, box_a)) in loops.iter().enumerate() {
        for (b, of_b, box_b) in &loops[..i] {
            let width = box_a.diagonal().min(box_b.diagonal());
            if !box_a.grown(reach * width).touches(box_b) {
                continue;
            }
            progress.check()?;
            let (gap, bridge) = nearest(of_a, of_b, at);
            if gap < reach * width {
                pairs.push(Neighbors {
                    gap_rel: gap / width,
                    loops: [*a, *b],
                    bridge,
                });
            }
        }
    }
    pairs.sort_by(|x, y| {
        let by_gap = x.gap_rel.total_cmp(&y.gap_rel);
        by_gap.then(x.loops.cmp(&y.loops))
    });
    Ok(pairs)
}

/// Maximum number of vertices of a loop that are compared with another loop.
const COMPARED: usize = 1000;

/// The distance of two loops' vertices, and which are nearest. Of long loops not every vertex is examined.
fn nearest(a: &[u32], b: &[u32], at: &impl Fn(u32) -> DVec3) -> (f64, [u32; 2]) {
    let stride = |n: usize| n.div_ceil(COMPARED);
    let of_b: Vec<_> = b
        .iter()
        .step_by(stride(b.len()))
        .map(|&v| (v, at(v)))
        .collect();
    let mut best = (f64::INFINITY, [a[0], b[0]]);
    for &v in a.iter().step_by(stride(a.len())) {
        let place = at(v);
        for &(w, other) in &of_b {
            let distance_sq = place.distance_squared(other);
            if distance_sq < best.0 {
                best = (distance_sq, [v, w]);
            }
        }
    }
    (best.0.sqrt(), best.1)
}

/// The polygon around `a` from the bridge, over it, around `b` and back.
fn bridged(a: &[u32], b: &[u32], bridge: [u32; 2]) -> Vec<u32> {
    let mut vertices = Vec::with_capacity(a.len() + b.len() + 2);
    for (polygon, end) in [(a, bridge[0]), (b, bridge[1])] {
        let start = polygon.iter().position(|&v| v == end);
        let (before, after) = polygon.split_at(start.expect("a bridge ends at its loops"));
        vertices.extend_from_slice(after);
        vertices.extend_from_slice(before);
        vertices.push(end);
    }
    vertices.dedup();
    if vertices.first() == vertices.last() {
        vertices.pop();
    }
    vertices
}

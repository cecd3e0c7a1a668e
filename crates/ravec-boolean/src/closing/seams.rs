//! Seams: boundaries that nearly meet, closed by strips.
//!
//! The plain idea: where two edges of the boundary run side by side in opposite directions, the strip between them closes
//! both. For each width, from tiny to a hundredth of the mesh:
//!
//! 1. Vertices of the boundary that are so near to each other that no edge there is shorter than four times their distance are
//!    taken for one.
//! 2. Edges longer than four times the width are taken to go over the vertices that are so near to them.
//! 3. Edges that are thereby used as often in one direction as in the other are closed: the triangles between the true edge
//!    and the one that it was taken for are added, and the boundary moves there, where it cancels.
//!
//! Strips that cover the wall between the two rims of a low tube once more are left out. The remains of a seam at its ends are
//! small loops. No place moves: triangles only lead from one to another.
//!
//! Guarantees: the boundary stays a chain without boundary. Cost: some microseconds an edge of the boundary.

use super::edges::Chain;
use super::patch::fill;
use super::walls::Walls;
use glam::DVec3;
use ravec_mesh::{Bvh, TriMesh};
use ravec_progress::{Cancelled, Progress};
use std::collections::{BTreeMap, BTreeSet};

/// The widths, as shares of the mesh's diagonal: from the rounding of single precision to what is still a small gap.
const WIDTHS_REL: [f64; 6] = [1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2];

/// Least ratio of the length of an edge to the width of the strip along it. Less would fold fine boundaries onto
/// themselves, more would leave seams between short edges to the filling of loops.
const LONGER: f64 = 4.0;

/// Result of closing.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Seams {
    /// Edges of the boundary with a strip along them.
    pub edges: u64,
    /// The width of the widest strip.
    pub widest: f64,
}

/// Closes seams: adds to `triangles` and leaves in `chain` what is still open.
pub(super) fn close_seams(
    chain: &mut Chain,
    walls: &Walls,
    at: &impl Fn(u32) -> DVec3,
    diagonal: f64,
    triangles: &mut Vec<[u32; 3]>,
    progress: &Progress,
) -> Result<Seams, Cancelled> {
    let mut seams = Seams::default();
    for width_rel in WIDTHS_REL {
        let width = width_rel * diagonal;
        if chain.is_empty() || width == 0.0 {
            break;
        }
        for snapped in snap(chain, walls, at, width, progress)? {
            let Snapped {
                loop_,
                count,
                apart,
            } = snapped;
            seams.edges += 1;
            seams.widest = seams.widest.max(apart);
            let places: Vec<_> = loop_.iter().map(|&v| at(v)).collect();
            let strip = fill(&places).triangles;
            for _ in 0..count {
                triangles.extend(strip.iter().map(|t| t.map(|i| loop_[i as usize])));
            }
            for (i, &from) in loop_.iter().enumerate() {
                chain.add(from, loop_[(i + 1) % loop_.len()], count);
            }
        }
    }
    Ok(seams)
}

/// An edge of the boundary that cancels if it is moved.
struct Snapped {
    /// The edge backward, and then the way that it was taken for.
    loop_: Vec<u32>,
    /// Number of uses.
    count: i64,
    /// Distance of the way from the edge.
    apart: f64,
}

/// A vertex near an edge that it is not of.
struct Near {
    edge: usize,
    vertex: u32,
    distance: f64,
}

fn snap(
    chain: &Chain,
    walls: &Walls,
    at: &impl Fn(u32) -> DVec3,
    width: f64,
    progress: &Progress,
) -> Result<Vec<Snapped>, Cancelled> {
    let edges: Vec<([u32; 2], i64)> = chain.directed().collect();
    let near = near(&edges, at, width, progress)?;
    if near.is_empty() {
        return Ok(Vec::new());
    }
    let length = |[u, v]: [u32; 2]| at(u).distance(at(v));
    let mut shortest: BTreeMap<u32, f64> = BTreeMap::new();
    for &(edge, _) in &edges {
        for v in edge {
            let least = shortest.entry(v).or_insert(f64::INFINITY);
            *least = least.min(length(edge));
        }
    }
    let taken_for = merged(&edges, &near, &shortest, at, width);
    let named = |v: u32| taken_for.get(&v).copied().unwrap_or(v);
    let mut over: BTreeMap<usize, Vec<u32>> = BTreeMap::new();
    for Near { edge, vertex, .. } in near {
        if length(edges[edge].0) > LONGER * width {
            over.entry(edge).or_default().push(named(vertex));
        }
    }
    let ways: Vec<Vec<u32>> = edges
        .iter()
        .enumerate()
        .map(|(i, &(edge, _))| {
            way(
                edge.map(named),
                over.remove(&i).unwrap_or_default(),
                at,
                width,
            )
        })
        .collect();
    // how often each piece is used upward and downward
    let mut uses: BTreeMap<[u32; 2], [i64; 2]> = BTreeMap::new();
    for (way, (_, count)) in ways.iter().zip(&edges) {
        for piece in way.windows(2) {
            let (key, side) = directed(piece);
            uses.entry(key).or_default()[side] += count;
        }
    }
    let mut snapped = Vec::new();
    for (way, (edge, count)) in ways.into_iter().zip(edges) {
        let (mut whole, mut cancelled) = (0.0, 0.0);
        for piece in way.windows(2) {
            let (key, side) = directed(piece);
            let [forth, back] = [uses[&key][side], uses[&key][1 - side]];
            whole += length(key);
            cancelled += length(key) * forth.min(back) as f64 / forth as f64;
        }
        // of what cancels less than half, the rest would be longer than the edge
        if way == edge || cancelled < 0.5 * whole || whole == 0.0 {
            continue;
        }
        let apart = |v: u32| distance_to(at(v), edge.map(at));
        let farthest = way
            .iter()
            .copied()
            .max_by(|&v, &w| apart(v).total_cmp(&apart(w)));
        if farthest.is_some_and(|v| walls.is_covered(edge, at, at(v))) {
            continue;
        }
        let apart = farthest.map_or(0.0, apart);
        let mut loop_ = vec![edge[1], edge[0]];
        loop_.extend(way);
        loop_.dedup();
        if loop_.first() == loop_.last() {
            loop_.pop();
        }
        snapped.push(Snapped {
            loop_,
            count,
            apart,
        });
    }
    Ok(snapped)
}

/// A piece with its lower vertex first, and 1 if that turns it.
fn directed(piece: &[u32]) -> ([u32; 2], usize) {
    let [u, v] = [piece[0], piece[1]];
    ([u.min(v), u.max(v)], usize::from(u > v))
}

/// The distance of a place to an edge.
fn distance_to(p: DVec3, [u, v]: [DVec3; 2]) -> f64 {
    p.distance(u + along(p, [u, v]).clamp(0.0, 1.0) * (v - u))
}

/// Position of a place along an edge: 0 at its start and 1 at its end.
fn along(p: DVec3, [u, v]: [DVec3; 2]) -> f64 {
    let side = v - u;
    let share = (p - u).dot(side) / side.length_squared();
    if share.is_finite() { share } else { 0.0 }
}

/// All vertices within `width` of edges that they are not of.
fn near(
    edges: &[([u32; 2], i64)],
    at: &impl Fn(u32) -> DVec3,
    width: f64,
    progress: &Progress,
) -> Result<Vec<Near>, Cancelled> {
    let mut vertices: Vec<u32> = edges.iter().flat_map(|(edge, _)| *edge).collect();
    vertices.sort_unstable();
    vertices.dedup();
    let local = |v| vertices.binary_search(&v).expect("it is one of them") as u32;
    let sides = edges.iter().map(|(edge, _)| edge.map(local));
    let sides = sides.map(|[u, v]| [u, v, v]).collect();
    let places = vertices.iter().map(|&v| at(v)).collect();
    let sides = TriMesh::new(places, sides).expect("vertices of a mesh are finite, and of these");
    let bvh = Bvh::try_new(&sides, progress)?;
    let mut near = Vec::new();
    for &vertex in &vertices {
        progress.check()?;
        bvh.for_each_within(at(vertex), width, |edge, distance| {
            let edge = edge as usize;
            if !edges[edge].0.contains(&vertex) {
                near.push(Near {
                    edge,
                    vertex,
                    distance,
                });
            }
        });
    }
    near.sort_by_key(|near| (near.edge, near.vertex));
    Ok(near)
}

/// The vertex for which each vertex is taken.
fn merged(
    edges: &[([u32; 2], i64)],
    near: &[Near],
    shortest: &BTreeMap<u32, f64>,
    at: &impl Fn(u32) -> DVec3,
    width: f64,
) -> BTreeMap<u32, u32> {
    let mut pairs: Vec<(f64, u32, u32)> = Vec::new();
    for near in near.iter().filter(|near| near.distance <= width) {
        for end in edges[near.edge].0 {
            let distance = at(end).distance(at(near.vertex));
            let least = shortest[&end].min(shortest[&near.vertex]);
            if distance <= width && LONGER * distance <= least {
                pairs.push((distance, end.min(near.vertex), end.max(near.vertex)));
            }
        }
    }
    pairs.sort_by(|x, y| x.0.total_cmp(&y.0).then((x.1, x.2).cmp(&(y.1, y.2))));
    pairs.dedup();
    let mut taken_for: BTreeMap<u32, u32> = BTreeMap::new();
    // those that others were taken for: they stay
    let mut stays: BTreeSet<u32> = BTreeSet::new();
    for (_, a, b) in pairs {
        let named = |v: u32| taken_for.get(&v).copied().unwrap_or(v);
        let (to_a, to_b) = (named(a), named(b));
        if to_a == to_b || at(to_a).distance(at(to_b)) > width {
            continue;
        }
        // one of them is alone, or the two groups stay apart
        let (gone, kept) = if to_b == b && !stays.contains(&b) {
            (b, to_a)
        } else if to_a == a && !stays.contains(&a) {
            (a, to_b)
        } else {
            continue;
        };
        taken_for.insert(gone, kept);
        stays.insert(kept);
    }
    taken_for
}

/// The way from the start of an edge to its end over vertices near it, in their order along it.
fn way(edge: [u32; 2], mut over: Vec<u32>, at: &impl Fn(u32) -> DVec3, width: f64) -> Vec<u32> {
    let ends = edge.map(at);
    let [from, to] = edge;
    over.sort_unstable();
    over.dedup();
    let mut between: Vec<(f64, u32)> = over
        .into_iter()
        .filter(|v| *v != from && *v != to)
        .map(|v| (along(at(v), ends), v))
        .filter(|(share, v)| {
            *share > 0.0 && *share < 1.0 && distance_to(at(*v), ends) <= 2.0 * width
        })
        .collect();
    between.sort_by(|x, y| x.0.total_cmp(&y.0).then(x.1.cmp(&y.1)));
    let mut way = vec![from];
    way.extend(between.into_iter().map(|(_, v)| v));
    way.push(to);
    way.dedup();
    way
}

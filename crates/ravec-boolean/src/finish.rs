//! The last step: one vertex for each fan of triangles, so that the mesh is manifold where the solid is not.
//!
//! Solids that touch in an edge or a vertex have more than two triangles at that edge, or several fans at the vertex. There
//! the triangles on both sides of a wedge of solid stay together, and each fan gets a vertex of its own at the same place:
//! the solids come out apart. Where two sheets share an edge and are joined at both of its ends, its middle becomes a vertex,
//! one for each sheet.

use glam::DVec3;
use ravec_mesh::Coordinates;
use ravec_progress::{Cancelled, Progress};
use rustc_hash::FxHashMap;

use crate::arrangement::{Edges, Pieces, Turned, Use};
use crate::select::{Draft, Parent};

const NONE: u32 = u32::MAX;

/// Triangles between two checks for cancellation: some milliseconds.
const STRIDE: usize = 1 << 16;

/// A mesh with the triangles of an uncut soup in their order, and the edges where `differ` says so about two neighbors.
pub(crate) struct Finished {
    pub positions: Vec<DVec3>,
    pub triangles: Vec<[u32; 3]>,
    pub features: Vec<[u32; 2]>,
    /// `true` if every edge has two triangles.
    pub closed: bool,
    /// Places of edges that two sheets share with both ends: vertices alone cannot hold these apart.
    pub pinched: Vec<[DVec3; 2]>,
}

/// The bits of a place.
fn key(p: DVec3) -> [u64; 3] {
    p.to_array().map(f64::to_bits)
}

/// Puts a vertex into the middle of edges, which are given by their ends: a fan of its own for each sheet to come. Edges too
/// short for that are contracted.
pub(crate) fn split_edges(draft: Draft, edges: &[[DVec3; 2]], coordinates: Coordinates) -> Draft {
    let mut middle_of = FxHashMap::default();
    let Draft {
        mut positions,
        triangles,
        parents,
    } = draft;
    let mut ends_of = FxHashMap::default();
    for &[a, b] in edges {
        let at = coordinates.nearest(a.midpoint(b));
        if at == a || at == b {
            // neighboring numbers: with nothing between them they become one
            ends_of.insert(key(b), a);
            continue;
        }
        let middle = positions.len() as u32;
        positions.push(at);
        middle_of.insert([key(a), key(b)], middle);
        middle_of.insert([key(b), key(a)], middle);
    }
    for p in &mut positions {
        *p = ends_of.get(&key(*p + DVec3::ZERO)).copied().unwrap_or(*p);
    }
    let mut split = Draft::default();
    let mut stack = Vec::new();
    for (triangle, mut parent) in triangles.into_iter().zip(parents) {
        // triangles with a corner at a place where vertices became one may have been moved
        let is_met = |v: u32| ends_of.values().any(|&end| end == positions[v as usize]);
        parent.whole &= ends_of.is_empty() || !triangle.iter().any(|&v| is_met(v));
        stack.push((triangle, parent));
        while let Some((t, parent)) = stack.pop() {
            let at = |i: usize| key(positions[t[i % 3] as usize] + DVec3::ZERO);
            let side = (0..3).find_map(|i| Some((i, *middle_of.get(&[at(i), at(i + 1)])?)));
            if let Some((i, middle)) = side {
                let [a, b, c] = std::array::from_fn(|k| t[(i + k) % 3]);
                let part = Parent {
                    whole: false,
                    ..parent
                };
                stack.extend([([a, middle, c], part), ([middle, b, c], part)]);
            } else {
                split.triangles.push(t);
                split.parents.push(parent);
            }
        }
    }
    split.positions = positions;
    split
}

/// Splits vertices of an uncut soup, whose edges are given, so that each has one fan.
///
/// # Errors
/// [`Cancelled`] soon after `progress` is.
pub(crate) fn finish(
    pieces: &Pieces,
    edges: Edges,
    differ: impl Fn(u32, u32) -> bool,
    progress: &Progress,
) -> Result<Finished, Cancelled> {
    let list = &pieces.soup.triangles;
    // the triangle over each side
    let Edges {
        mut across,
        junctions,
        ..
    } = edges;
    let (pairs, mut closed) = paired_sides(list, &junctions, &mut across);
    closed &= across
        .iter()
        .flatten()
        .all(|other| other.number().is_some());

    let (mut triangles, positions) = one_fan_each(pieces, &across, progress)?;
    let pinched = pinched_edges(list, &triangles, &positions, &junctions, &pairs);
    drop(pairs);
    let mut features = feature_edges(&triangles, &across, differ, progress)?;
    drop(across);
    progress.check()?;
    let positions = without_unused(&positions, &mut triangles, &mut features);
    Ok(Finished {
        positions,
        triangles,
        features,
        closed,
        pinched,
    })
}

/// Pairs of triangles that go on in one another over an edge, and whether all triangles at edges are in one.
type Pairs = Vec<Vec<(Use, Use)>>;

/// Pairs the triangles at each junction, and writes each into `across` of the other.
fn paired_sides(
    list: &[[u32; 3]],
    junctions: &[([u32; 2], Vec<Use>)],
    across: &mut [[Turned; 3]],
) -> (Pairs, bool) {
    let mut closed = true;
    let mut pairs = Vec::with_capacity(junctions.len());
    for ([lower, upper], uses) in junctions {
        let side = |piece: u32, forward: bool| {
            let c = list[piece as usize];
            let (from, to) = if forward {
                (*lower, *upper)
            } else {
                (*upper, *lower)
            };
            (0..3).find(|&i| c[i] == from && c[(i + 1) % 3] == to)
        };
        let mut free = Vec::new();
        let mut taken = vec![false; uses.len()];
        for (i, &one) in uses.iter().enumerate() {
            let next = (i + 1) % uses.len();
            // a wedge of solid lies between backs
            if !one.forward && uses[next].forward {
                taken[i] = true;
                taken[next] = true;
                free.push((one, uses[next]));
            }
        }
        // what has no such neighbor, in a surface that crosses itself: any partner will do
        let (mut with, mut against): (Vec<_>, Vec<_>) = uses
            .iter()
            .zip(&taken)
            .filter(|(_, taken)| !**taken)
            .map(|(one, _)| *one)
            .partition(|one| one.forward);
        while let (Some(a), Some(b)) = (with.pop(), against.pop()) {
            free.push((a, b));
        }
        closed &= with.is_empty() && against.is_empty();
        for &(a, b) in &free {
            for (one, other) in [(a, b), (b, a)] {
                if let Some(side) = side(one.piece, one.forward) {
                    across[one.piece as usize][side] = Turned::new(other.piece, false);
                }
            }
        }
        pairs.push(free);
    }
    (pairs, closed)
}

/// The triangles with a vertex of its own for each fan, and the places of all vertices.
fn one_fan_each(
    pieces: &Pieces,
    across: &[[Turned; 3]],
    progress: &Progress,
) -> Result<(Vec<[u32; 3]>, Vec<DVec3>), Cancelled> {
    let list = &pieces.soup.triangles;
    let mut triangles = vec![[NONE; 3]; list.len()];
    let mut vertex_taken = vec![false; pieces.places.given().len()];
    let mut positions = pieces.places.given().to_vec();
    for piece in 0..list.len() {
        if piece % STRIDE == 0 {
            progress.check()?;
        }
        for corner in 0..3 {
            if triangles[piece][corner] != NONE {
                continue;
            }
            let name = list[piece][corner];
            let vertex = if std::mem::replace(&mut vertex_taken[name as usize], true) {
                positions.push(positions[name as usize]);
                (positions.len() - 1) as u32
            } else {
                name
            };
            // around the vertex in one direction, and in the other if there is a border
            for forward in [true, false] {
                let (mut p, mut c) = (piece, corner);
                loop {
                    triangles[p][c] = vertex;
                    let side = if forward { c } else { (c + 2) % 3 };
                    let Some(next) = across[p][side].number() else {
                        break;
                    };
                    p = next as usize;
                    let Some(at) = list[p].iter().position(|&x| x == name) else {
                        break;
                    };
                    c = at;
                    if triangles[p][c] != NONE {
                        break;
                    }
                }
            }
        }
    }
    Ok((triangles, positions))
}

/// Edges that more than one pair of triangles has between the same two vertices.
fn pinched_edges(
    list: &[[u32; 3]],
    triangles: &[[u32; 3]],
    positions: &[DVec3],
    junctions: &[([u32; 2], Vec<Use>)],
    pairs: &Pairs,
) -> Vec<[DVec3; 2]> {
    let mut pinched = Vec::new();
    for (([lower, upper], _), pairs) in junctions.iter().zip(pairs) {
        let mut ends: Vec<[u32; 2]> = pairs
            .iter()
            .map(|(one, _)| {
                let corner = |name: u32| {
                    let corners = &list[one.piece as usize];
                    let at = corners.iter().position(|&c| c == name);
                    at.map_or(NONE, |at| triangles[one.piece as usize][at])
                };
                [corner(*lower), corner(*upper)]
            })
            .collect();
        ends.sort_unstable();
        if ends.windows(2).any(|two| two[0] == two[1]) {
            pinched.push([lower, upper].map(|&name| positions[name as usize]));
        }
    }
    pinched
}

/// Edges between triangles that differ.
fn feature_edges(
    triangles: &[[u32; 3]],
    across: &[[Turned; 3]],
    differ: impl Fn(u32, u32) -> bool,
    progress: &Progress,
) -> Result<Vec<[u32; 2]>, Cancelled> {
    let mut features = Vec::new();
    for (piece, over) in across.iter().enumerate() {
        if piece % STRIDE == 0 {
            progress.check()?;
        }
        for (side, other) in over.iter().enumerate() {
            let later = other.number().filter(|&other| other as usize > piece);
            if later.is_some_and(|other| differ(piece as u32, other)) {
                let corners = triangles[piece];
                features.push([corners[side], corners[(side + 1) % 3]]);
            }
        }
    }
    Ok(features)
}

/// The places of the vertices that triangles use, by which these and the features are renumbered.
fn without_unused(
    positions: &[DVec3],
    triangles: &mut [[u32; 3]],
    features: &mut [[u32; 2]],
) -> Vec<DVec3> {
    let mut new_name = vec![NONE; positions.len()];
    let mut used = Vec::with_capacity(positions.len());
    for v in triangles.iter_mut().flatten() {
        let slot = &mut new_name[*v as usize];
        if *slot == NONE {
            *slot = used.len() as u32;
            used.push(positions[*v as usize]);
        }
        *v = *slot;
    }
    for v in features.iter_mut().flatten() {
        *v = new_name[*v as usize];
    }
    used
}

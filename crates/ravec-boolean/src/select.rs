//! The pieces that bound the result, rounded, and triangles made whole again.

use glam::DVec3;
use ravec_mesh::TriMesh;
use rustc_hash::{FxHashMap, FxHashSet};

use crate::arrangement::{Cells, Piece, Pieces, Side};

/// What a triangle of a draft is made of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Parent {
    /// The triangle of the soup.
    pub triangle: u32,
    /// Whether it is turned around.
    pub reversed: bool,
    /// Whether it is all of that triangle.
    pub whole: bool,
}

/// A surface in doubles.
#[derive(Debug, Clone, Default)]
pub(crate) struct Draft {
    pub positions: Vec<DVec3>,
    pub triangles: Vec<[u32; 3]>,
    pub parents: Vec<Parent>,
}

impl Draft {
    /// The same surface as a mesh.
    pub fn mesh(&self) -> TriMesh {
        TriMesh::new(self.positions.clone(), self.triangles.clone())
            .expect("rounded points are finite, and corners are among them")
    }
}

/// A piece that bounds the result.
#[derive(Clone, Copy)]
struct Kept {
    piece: u32,
    /// The first triangle that covers it.
    parent: u32,
    /// Against that triangle.
    reversed: bool,
    /// Against the piece.
    turned: bool,
}

/// Whether the corners of a piece are those of a triangle.
fn is_whole(piece: &Piece, triangle: [u32; 3]) -> bool {
    piece.corners.iter().all(|c| triangle.contains(c))
}

/// The pieces with one side in cells that are `inside` and the other in cells that are not, all facing out.
pub(crate) fn select(pieces: &Pieces, cells: &Cells, inside: &[bool]) -> Draft {
    let mut kept = Vec::new();
    for (index, piece) in pieces.list.iter().enumerate() {
        let at = |side| {
            cells
                .cell(index as u32, side)
                .map(|cell| inside[cell as usize])
        };
        let (Some(front), Some(back)) = (at(Side::Front), at(Side::Back)) else {
            continue;
        };
        if front == back {
            continue;
        }
        let Some((parent, same)) = piece.cover.iter().next() else {
            continue;
        };
        kept.push(Kept {
            piece: index as u32,
            parent,
            reversed: front == same,
            turned: front,
        });
    }
    let restored = restorable(pieces, &kept);
    let mut draft = Draft::default();
    let mut vertex_of = vec![u32::MAX; pieces.places.given().len() + pieces.places.made.len()];
    let mut vertex = |draft: &mut Draft, name: u32| {
        let slot = &mut vertex_of[name as usize];
        if *slot == u32::MAX {
            *slot = draft.positions.len() as u32;
            draft.positions.push(pieces.places.rounded(name));
        }
        *slot
    };
    let mut done = FxHashSet::default();
    for one in kept {
        let piece = &pieces.list[one.piece as usize];
        let triangle = pieces.soup.triangles[one.parent as usize];
        let (mut corners, turned, whole) = if restored.contains(&one.parent) {
            if !done.insert(one.parent) {
                continue;
            }
            (triangle, one.reversed, true)
        } else {
            (piece.corners, one.turned, is_whole(piece, triangle))
        };
        if turned {
            corners.swap(1, 2);
        }
        let corners = corners.map(|name| vertex(&mut draft, name));
        draft.triangles.push(corners);
        draft.parents.push(Parent {
            triangle: one.parent,
            reversed: one.reversed,
            whole,
        });
    }
    draft
}

/// Triangles in pieces that are all kept and can be put together again, since nothing else ends at the vertices that were
/// put into them.
fn restorable(pieces: &Pieces, kept: &[Kept]) -> FxHashSet<u32> {
    let in_pieces = |t: u32| {
        let [from, to] = pieces.of_triangle[t as usize];
        to - from > 1
    };
    // kept pieces by triangle, and triangles at each vertex that was put in
    let mut of_triangle: FxHashMap<u32, Vec<Kept>> = FxHashMap::default();
    for &one in kept.iter().filter(|one| in_pieces(one.parent)) {
        of_triangle.entry(one.parent).or_default().push(one);
    }
    let mut covering: FxHashMap<u32, u32> = FxHashMap::default();
    for (t, _) in pieces.list.iter().flat_map(|piece| piece.cover.iter()) {
        if in_pieces(t) {
            *covering.entry(t).or_default() += 1;
        }
    }
    let inserted = |t: u32, list: &[Kept]| -> Vec<u32> {
        let corners = pieces.soup.triangles[t as usize];
        let names = list
            .iter()
            .flat_map(|one| pieces.list[one.piece as usize].corners);
        let mut names: Vec<u32> = names.filter(|name| !corners.contains(name)).collect();
        names.sort_unstable();
        names.dedup();
        names
    };
    let mut candidates: FxHashSet<u32> = FxHashSet::default();
    let mut at_vertex: FxHashMap<u32, Vec<u32>> = FxHashMap::default();
    for (&t, list) in &of_triangle {
        let all = covering
            .get(&t)
            .is_some_and(|&count| count as usize == list.len());
        if all && list.len() > 1 && list.iter().all(|one| one.reversed == list[0].reversed) {
            candidates.insert(t);
        }
        for name in inserted(t, list) {
            at_vertex.entry(name).or_default().push(t);
        }
    }
    // a vertex that was put into one triangle and is a corner of another has to stay
    let mut pinned: Vec<u32> = kept
        .iter()
        .flat_map(|one| pieces.soup.triangles[one.parent as usize])
        .filter(|name| at_vertex.contains_key(name))
        .collect();
    for (&t, list) in &of_triangle {
        if !candidates.contains(&t) {
            let names = list
                .iter()
                .flat_map(|one| pieces.list[one.piece as usize].corners);
            pinned.extend(names.filter(|name| at_vertex.contains_key(name)));
        }
    }
    // so is a vertex where surfaces touch: it must be in the inside of one triangle or of the edge of two
    pinned.extend(at_vertex.iter().filter_map(|(&name, list)| {
        let shared = |a: u32, b: u32| {
            let [a, b] = [a, b].map(|t| pieces.soup.triangles[t as usize]);
            a.iter().filter(|v| b.contains(v)).count()
        };
        let goes = match list[..] {
            [_] => true,
            [a, b] => shared(a, b) == 2,
            _ => false,
        };
        (!goes).then_some(name)
    }));
    while let Some(name) = pinned.pop() {
        for t in at_vertex.remove(&name).into_iter().flatten() {
            if candidates.remove(&t) {
                pinned.extend(inserted(t, &of_triangle[&t]));
                pinned.extend(pieces.soup.triangles[t as usize]);
            }
        }
    }
    candidates
}

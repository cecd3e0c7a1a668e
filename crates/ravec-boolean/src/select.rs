//! The pieces that bound the result, rounded, and triangles made whole again.

use glam::DVec3;
use ravec_progress::{Cancelled, Progress};
use rustc_hash::{FxHashMap, FxHashSet};

use crate::arrangement::{Cells, Pieces, Side};

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

/// Pieces between two looks at the progress: some milliseconds.
const STRIDE: usize = 1 << 16;

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

/// The piece as it bounds the result, if it does: with one side in cells that are `inside` and the other in cells that are not.
fn kept(pieces: &Pieces, cells: &Cells, inside: &[bool], piece: u32) -> Option<Kept> {
    let at = |side| cells.cell(piece, side).map(|cell| inside[cell as usize]);
    let (front, back) = (at(Side::Front)?, at(Side::Back)?);
    (front != back).then(|| {
        let (parent, same) = pieces.first_cover(piece);
        Kept {
            piece,
            parent,
            reversed: front == same,
            turned: front,
        }
    })
}

/// The pieces with one side in cells that are `inside` and the other in cells that are not, all facing out.
///
/// # Errors
/// [`Cancelled`] soon after `progress` is.
pub(crate) fn select(
    pieces: &Pieces,
    cells: &Cells,
    inside: &[bool],
    progress: &Progress,
) -> Result<Draft, Cancelled> {
    let is_kept = |piece: &u32| kept(pieces, cells, inside, *piece).is_some();
    let whole = || {
        pieces
            .all()
            .take_while(|&p| !pieces.pieces_of_cut().contains(&p))
    };
    let of_cut: Vec<Kept> = pieces
        .pieces_of_cut()
        .filter_map(|piece| kept(pieces, cells, inside, piece))
        .collect();
    progress.check()?;
    let restored = restorable(pieces, &of_cut, || whole().filter(is_kept));
    progress.check()?;
    let most = of_cut.len() + whole().filter(is_kept).count();
    let mut draft = Draft {
        positions: Vec::new(),
        triangles: Vec::with_capacity(most),
        parents: Vec::with_capacity(most),
    };
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
    let of_whole = whole().filter_map(|piece| kept(pieces, cells, inside, piece));
    for (at, one) in of_whole.chain(of_cut).enumerate() {
        if at % STRIDE == 0 {
            progress.check()?;
        }
        let triangle = pieces.soup.triangles[one.parent as usize];
        let (mut corners, turned, whole) = if restored.contains(&one.parent) {
            if !done.insert(one.parent) {
                continue;
            }
            (triangle, one.reversed, true)
        } else {
            let corners = pieces.corners(one.piece);
            let is_whole = corners.iter().all(|c| triangle.contains(c));
            (corners, one.turned, is_whole)
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
    Ok(draft)
}

/// Triangles in pieces that are all kept and can be put together again, since nothing else ends at the vertices that were
/// put into them. `kept` are pieces of triangles that were cut, and `whole` gives the triangles that were not cut and are kept.
fn restorable<I: Iterator<Item = u32>>(
    pieces: &Pieces,
    kept: &[Kept],
    whole: impl Fn() -> I,
) -> FxHashSet<u32> {
    let in_pieces = |t: u32| pieces.of_triangle(t).len() > 1;
    // kept pieces by triangle, and triangles at each vertex that was put in
    let mut of_triangle: FxHashMap<u32, Vec<Kept>> = FxHashMap::default();
    for &one in kept.iter().filter(|one| in_pieces(one.parent)) {
        of_triangle.entry(one.parent).or_default().push(one);
    }
    let mut covering: FxHashMap<u32, u32> = FxHashMap::default();
    for (t, _) in pieces.pieces_of_cut().flat_map(|piece| pieces.cover(piece)) {
        if in_pieces(t) {
            *covering.entry(t).or_default() += 1;
        }
    }
    let inserted = |t: u32, list: &[Kept]| -> Vec<u32> {
        let corners = pieces.soup.triangles[t as usize];
        let names = list.iter().flat_map(|one| pieces.corners(one.piece));
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
    let given = pieces.places.given().len();
    let mut is_inserted = Vec::new();
    for &name in at_vertex.keys().filter(|&&name| (name as usize) < given) {
        is_inserted.resize(given, false);
        is_inserted[name as usize] = true;
    }
    let mut pinned = Vec::new();
    if !is_inserted.is_empty() {
        let parents = kept.iter().map(|one| one.parent).chain(whole());
        let corners = parents.flat_map(|t| pieces.soup.triangles[t as usize]);
        pinned.extend(corners.filter(|&name| is_inserted[name as usize]));
    }
    for (&t, list) in &of_triangle {
        if !candidates.contains(&t) {
            let names = list.iter().flat_map(|one| pieces.corners(one.piece));
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

//! The pieces that bound the result, rounded, and triangles made whole again.

use glam::DVec3;
use ravec_progress::{Cancelled, Progress};
use rustc_hash::{FxHashMap, FxHashSet};

use crate::arrangement::{Cells, Pieces, Side};

/// Components of a triangle of a draft.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Parent {
    /// The triangle of the soup.
    pub triangle: u32,
    /// `true` if it is turned around.
    pub reversed: bool,
    /// `true` if it is all of that triangle.
    pub whole: bool,
}

/// A surface in doubles.
#[derive(Debug, Clone, Default)]
pub(crate) struct Draft {
    pub positions: Vec<DVec3>,
    pub triangles: Vec<[u32; 3]>,
    pub parents: Vec<Parent>,
}

/// Pieces between two checks for cancellation: some milliseconds.
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
    draft_of(pieces, |piece| kept(pieces, cells, inside, piece), progress)
}

/// The pieces of sheets for which `stays` says so of the sheet and of the cells on both sides, facing as their triangles do.
///
/// # Errors
/// [`Cancelled`] soon after `progress` is.
pub(crate) fn trim(
    pieces: &Pieces,
    cells: &Cells,
    is_sheet: impl Fn(u32) -> bool,
    stays: impl Fn(u32, [u32; 2]) -> bool,
    progress: &Progress,
) -> Result<Draft, Cancelled> {
    let kept = |piece: u32| {
        let mesh = |triangle: u32| pieces.soup.sources[triangle as usize].mesh;
        let (parent, same) = pieces.cover(piece).find(|&(t, _)| is_sheet(mesh(t)))?;
        let sides = [
            cells.cell(piece, Side::Front)?,
            cells.cell(piece, Side::Back)?,
        ];
        stays(mesh(parent), sides).then_some(Kept {
            piece,
            parent,
            reversed: false,
            turned: !same,
        })
    };
    draft_of(pieces, kept, progress)
}

/// The pieces that are kept, rounded.
fn draft_of(
    pieces: &Pieces,
    kept: impl Fn(u32) -> Option<Kept>,
    progress: &Progress,
) -> Result<Draft, Cancelled> {
    let is_kept = |piece: &u32| kept(*piece).is_some();
    let whole = || {
        pieces
            .all()
            .take_while(|&p| !pieces.pieces_of_cut().contains(&p))
    };
    let of_cut: Vec<Kept> = pieces.pieces_of_cut().filter_map(&kept).collect();
    progress.check()?;
    let restored = restorable(pieces, &of_cut, || whole().filter(is_kept), progress)?;
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
    let of_whole = whole().filter_map(&kept);
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

/// Knowledge about the pieces of a triangle.
#[derive(Default)]
struct Tally {
    /// Pieces that it covers.
    covered: u32,
    /// Those of them that are kept as its own, with it and against it.
    kept: [u32; 2],
}

impl Tally {
    /// Returns `true` if the triangle is in several pieces, all kept and all facing the same way.
    fn is_all_kept(&self) -> bool {
        self.covered > 1 && self.kept.contains(&self.covered)
    }
}

/// Triangles in pieces that are all kept and can be put together again, since nothing else ends at the vertices that were
/// put into them. `kept` are pieces of triangles that were cut, and `whole` gives the triangles that were not cut and are kept.
fn restorable<I: Iterator<Item = u32>>(
    pieces: &Pieces,
    kept: &[Kept],
    whole: impl Fn() -> I,
    progress: &Progress,
) -> Result<FxHashSet<u32>, Cancelled> {
    let mut tally: FxHashMap<u32, Tally> = FxHashMap::default();
    for (at, piece) in pieces.pieces_of_cut().enumerate() {
        if at % STRIDE == 0 {
            progress.check()?;
        }
        for (t, _) in pieces.cover(piece) {
            tally.entry(t).or_default().covered += 1;
        }
    }
    progress.check()?;
    for one in kept {
        let own = tally.entry(one.parent).or_default();
        own.kept[usize::from(one.reversed)] += 1;
    }
    // nearly always there are none: what is cut has a side in something
    tally.retain(|_, own| own.is_all_kept());
    let mut candidates: FxHashSet<u32> = tally.into_keys().collect();
    if candidates.is_empty() {
        return Ok(candidates);
    }
    progress.check()?;
    // pieces by triangle, and triangles at each vertex that was put in
    let mut of_triangle: FxHashMap<u32, Vec<Kept>> = FxHashMap::default();
    for &one in kept.iter().filter(|one| candidates.contains(&one.parent)) {
        of_triangle.entry(one.parent).or_default().push(one);
    }
    let inserted = |t: u32| -> Vec<u32> {
        let corners = pieces.soup.triangles[t as usize];
        let names = of_triangle[&t]
            .iter()
            .flat_map(|one| pieces.corners(one.piece));
        let mut names: Vec<u32> = names.filter(|name| !corners.contains(name)).collect();
        names.sort_unstable();
        names.dedup();
        names
    };
    progress.check()?;
    let mut at_vertex: FxHashMap<u32, Vec<u32>> = FxHashMap::default();
    for &t in &candidates {
        for name in inserted(t) {
            at_vertex.entry(name).or_default().push(t);
        }
    }
    progress.check()?;
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
    progress.check()?;
    // so has one of a piece that stays
    let stay = kept.iter().filter(|one| !candidates.contains(&one.parent));
    let corners = stay.flat_map(|one| pieces.corners(one.piece));
    pinned.extend(corners.filter(|name| at_vertex.contains_key(name)));
    progress.check()?;
    // and one where surfaces touch: it must be in the inside of one triangle or of the edge of two
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
    let mut steps = 0_usize;
    while let Some(name) = pinned.pop() {
        steps += 1;
        if steps.is_multiple_of(STRIDE) {
            progress.check()?;
        }
        for t in at_vertex.remove(&name).into_iter().flatten() {
            if candidates.remove(&t) {
                pinned.extend(inserted(t));
                pinned.extend(pieces.soup.triangles[t as usize]);
            }
        }
    }
    Ok(candidates)
}

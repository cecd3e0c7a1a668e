//! Cuts all triangles along all others.
//!
//! 1. Pairs of triangles whose boxes touch are tested for contact.
//! 2. The points of these contacts get names, one for each place.
//! 3. Triangles that overlap within a plane are put together; each such group, and each other triangle that meets
//!    anything, is triangulated with its points and segments.
//! 4. The pieces are put together again over common names.
//!
//! Source: Cherchi, Livesu, Scateni and Attene, "Fast and robust mesh arrangements using floating-point arithmetic", 2020.
//! We differ in what lies in one plane: overlapping triangles are triangulated together, so that each piece of the plane
//! is there once and knows all triangles that cover it.
//!
//! Guarantees: pieces meet in whole edges and corners only; together they cover exactly what the triangles cover.
//! Cost: near that of finding the pairs if few triangles meet; n log n in the points within one plane.

use std::ops::Range;

use ravec_mesh::CandidateTree;
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;
use rustc_hash::FxHashMap;

use super::contact::{Contact, contact};
use super::crossings::name_crossings;
use super::exact::Grid;
use super::group::{Corner, CutGroup, cut_group, gather};
use super::places::Places;
use super::soup::{Facet, Soup};

/// Triangles of the soup that cover a piece.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Cover {
    /// One, turned the same way.
    One(u32),
    /// Several within a plane, and whether each is turned the same way.
    Several(Box<[(u32, bool)]>),
}

impl Cover {
    /// The triangles, and whether each is turned as the piece is.
    fn iter(&self) -> impl Iterator<Item = (u32, bool)> + '_ {
        let (one, several) = match self {
            Self::One(triangle) => (Some((*triangle, true)), None),
            Self::Several(list) => (None, Some(list.iter().copied())),
        };
        one.into_iter().chain(several.into_iter().flatten())
    }
}

/// A part of the surface of the soup that nothing crosses.
struct Piece {
    /// Names of its corners.
    corners: [u32; 3],
    cover: Cover,
}

/// A soup in pieces.
///
/// A triangle that meets nothing is a piece under its own number, of which nothing is kept. The pieces of the others have the
/// numbers from there on; the numbers of triangles that were cut stand for no piece.
pub(crate) struct Pieces<'a> {
    pub soup: &'a Soup,
    pub places: Places<'a>,
    is_cut: Vec<bool>,
    cut: Vec<Piece>,
    /// For each triangle that was cut its pieces, among them pieces of others in its plane if there are any.
    of_cut: FxHashMap<u32, [u32; 2]>,
    /// Pairs of triangles that met in more than corners and an edge.
    pub contacts: Vec<(u32, u32)>,
}

impl Pieces<'_> {
    /// One more than the highest number of a piece.
    pub fn end(&self) -> u32 {
        (self.is_cut.len() + self.cut.len()) as u32
    }

    /// The numbers of all pieces, ascending.
    pub fn all(&self) -> impl Iterator<Item = u32> + '_ {
        let whole = (0..self.is_cut.len()).filter(|&t| !self.is_cut[t]);
        whole.map(|t| t as u32).chain(self.pieces_of_cut())
    }

    /// The numbers of the pieces of triangles that were cut, ascending.
    pub fn pieces_of_cut(&self) -> Range<u32> {
        self.is_cut.len() as u32..self.end()
    }

    /// The piece of a triangle that was cut; `None` for a triangle that is a piece.
    fn piece(&self, piece: u32) -> Option<&Piece> {
        self.cut
            .get((piece as usize).checked_sub(self.is_cut.len())?)
    }

    /// Names of the corners of a piece.
    #[inline]
    pub fn corners(&self, piece: u32) -> [u32; 3] {
        match self.piece(piece) {
            Some(piece) => piece.corners,
            None => self.soup.triangles[piece as usize],
        }
    }

    /// The triangles that cover a piece, and whether each is turned as the piece is.
    pub fn cover(&self, piece: u32) -> impl Iterator<Item = (u32, bool)> + '_ {
        let part = self.piece(piece);
        let own = part.is_none().then_some((piece, true));
        let covers = part.into_iter().flat_map(|piece| piece.cover.iter());
        own.into_iter().chain(covers)
    }

    /// The first triangle that covers a piece, and whether it is turned as the piece is.
    #[inline]
    pub fn first_cover(&self, piece: u32) -> (u32, bool) {
        let first = match self.piece(piece) {
            None => Some((piece, true)),
            Some(piece) => piece.cover.iter().next(),
        };
        first.expect("a piece is covered by something")
    }

    /// Returns `true` if just one triangle covers a piece.
    #[inline]
    pub fn has_one_cover(&self, piece: u32) -> bool {
        self.piece(piece)
            .is_none_or(|piece| matches!(piece.cover, Cover::One(_)))
    }

    /// The pieces of a triangle, among them pieces of others in its plane if there are any.
    pub fn of_triangle(&self, triangle: u32) -> Range<u32> {
        match self.of_cut.get(&triangle) {
            Some(&[from, to]) => from..to,
            None => triangle..triangle + 1,
        }
    }
}

/// Cuts a soup. With `only`, triangles for which it is false are known to meet none of each other.
///
/// # Errors
/// [`Cancelled`] soon after `progress` is.
pub(crate) fn cut<'a>(
    soup: &'a Soup,
    tree: &CandidateTree,
    only: Option<&[bool]>,
    progress: &Progress,
) -> Result<Pieces<'a>, Cancelled> {
    let contacts = contacts(soup, tree, only, progress)?;
    let mut places = Places::new(&soup.positions, Grid::holding(&soup.positions));
    let names = name_crossings(soup, &contacts, &mut places, progress)?;
    progress.check()?;
    let groups = gather(soup, &contacts, &names, progress)?;
    progress.check()?;

    let phase = progress.phase("cutting", groups.len() as u64);
    let cut: Vec<CutGroup> = groups
        .par_iter()
        .map(|group| {
            progress.check()?;
            let cut = cut_group(soup, &places, group);
            phase.advance(1);
            Ok(cut)
        })
        .collect::<Result<_, Cancelled>>()?;

    let mut is_cut = vec![false; soup.triangles.len()];
    for &member in groups.iter().flat_map(|g| &g.members) {
        is_cut[member as usize] = true;
    }
    let mut pieces = Vec::with_capacity(cut.iter().map(|cut| cut.pieces.len()).sum());
    let mut of_cut = FxHashMap::default();
    for (group, cut) in groups.iter().zip(cut) {
        progress.check()?;
        let names: Vec<u32> = cut
            .points
            .into_iter()
            .map(|corner| match corner {
                Corner::Named(name) => name,
                Corner::Made(point) => places.name(*point),
            })
            .collect();
        let first = (is_cut.len() + pieces.len()) as u32;
        pieces.extend(cut.pieces.into_iter().map(|(corners, cover)| Piece {
            corners: corners.map(|c| names[c as usize]),
            cover,
        }));
        let end = (is_cut.len() + pieces.len()) as u32;
        of_cut.extend(group.members.iter().map(|&member| (member, [first, end])));
    }
    Ok(Pieces {
        soup,
        places,
        is_cut,
        cut: pieces,
        of_cut,
        contacts: contacts.into_iter().map(|(a, b, _)| (a, b)).collect(),
    })
}

/// A soup of which nothing is cut.
pub(crate) fn uncut(soup: &Soup) -> Pieces<'_> {
    Pieces {
        soup,
        places: Places::new(&soup.positions, Grid::holding(&soup.positions)),
        is_cut: vec![false; soup.triangles.len()],
        cut: Vec::new(),
        of_cut: FxHashMap::default(),
        contacts: Vec::new(),
    }
}

/// All pairs of triangles that meet in more than corners and an edge, ascending.
///
/// # Errors
/// [`Cancelled`] soon after `progress` is.
pub(crate) fn contacts(
    soup: &Soup,
    tree: &CandidateTree,
    only: Option<&[bool]>,
    progress: &Progress,
) -> Result<Vec<(u32, u32, Contact)>, Cancelled> {
    // side by side in the order of the tree, where those that are compared are near to each other
    let vertices: Vec<[u32; 3]> = (0..tree.len() as u32)
        .into_par_iter()
        .map(|slot| soup.triangles[tree.triangle(slot) as usize])
        .collect();
    let facet = |slot: u32| {
        let vertices = vertices[slot as usize];
        Facet {
            triangle: tree.triangle(slot),
            vertices,
            corners: vertices.map(|v| soup.positions[v as usize]),
        }
    };
    let mut contacts = tree.filter_near_pairs(progress, |one, other| {
        let (one, other) = (facet(one), facet(other));
        let (a, b) = if one.triangle < other.triangle {
            (one, other)
        } else {
            (other, one)
        };
        let is_selected = |f: &Facet| only.is_none_or(|only| only[f.triangle as usize]);
        let selected = is_selected(&a) || is_selected(&b);
        let found = selected.then(|| contact(&a, &b)).flatten();
        found.map(|contact| (a.triangle, b.triangle, contact))
    })?;
    progress.check()?;
    contacts.par_sort_unstable_by_key(|&(a, b, _)| (a, b));
    progress.check()?;
    Ok(contacts)
}

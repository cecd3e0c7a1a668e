//! Cuts all triangles along all others.
//!
//! 1. Pairs of triangles whose boxes touch are asked how they meet.
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

use ravec_mesh::BoxTree;
use ravec_progress::{Cancelled, Progress};
use rayon::prelude::*;

use super::contact::{Contact, contact};
use super::crossings::name_crossings;
use super::exact::Grid;
use super::group::{Corner, CutGroup, cut_group, gather};
use super::places::Places;
use super::soup::Soup;

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
    pub fn iter(&self) -> impl Iterator<Item = (u32, bool)> + '_ {
        let (one, several) = match self {
            Self::One(triangle) => (Some((*triangle, true)), None),
            Self::Several(list) => (None, Some(list.iter().copied())),
        };
        one.into_iter().chain(several.into_iter().flatten())
    }
}

/// A part of the surface of the soup that nothing crosses.
#[derive(Debug, Clone)]
pub(crate) struct Piece {
    /// Names of its corners.
    pub corners: [u32; 3],
    pub cover: Cover,
}

/// A soup in pieces.
pub(crate) struct Pieces<'a> {
    pub soup: &'a Soup,
    pub places: Places<'a>,
    pub list: Vec<Piece>,
    /// For each triangle its pieces, among them pieces of others in its plane if there are any.
    pub of_triangle: Vec<[u32; 2]>,
    /// Pairs of triangles that met in more than corners and an edge.
    pub contacts: Vec<(u32, u32)>,
}

/// Cuts a soup. With `only`, triangles for which it is false are known to meet none of each other.
///
/// # Errors
/// [`Cancelled`] soon after `progress` is.
pub(crate) fn cut<'a>(
    soup: &'a Soup,
    bvh: &BoxTree,
    only: Option<&[bool]>,
    progress: &Progress,
) -> Result<Pieces<'a>, Cancelled> {
    let contacts = contacts(soup, bvh, only, progress)?;
    let mut places = Places::new(&soup.positions, Grid::holding(&soup.positions));
    let names = name_crossings(soup, &contacts, &mut places, progress)?;
    progress.check()?;
    let groups = gather(soup, &contacts, &names);
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
    let mut pieces = Vec::with_capacity(soup.triangles.len());
    let mut of_triangle = vec![[0; 2]; soup.triangles.len()];
    for (triangle, &corners) in soup.triangles.iter().enumerate() {
        if !is_cut[triangle] {
            let at = pieces.len() as u32;
            of_triangle[triangle] = [at, at + 1];
            pieces.push(Piece {
                corners,
                cover: Cover::One(triangle as u32),
            });
        }
    }
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
        let first = pieces.len() as u32;
        pieces.extend(cut.pieces.into_iter().map(|(corners, cover)| Piece {
            corners: corners.map(|c| names[c as usize]),
            cover,
        }));
        for &member in &group.members {
            of_triangle[member as usize] = [first, pieces.len() as u32];
        }
    }
    Ok(Pieces {
        soup,
        places,
        list: pieces,
        of_triangle,
        contacts: contacts.into_iter().map(|(a, b, _)| (a, b)).collect(),
    })
}

/// A soup of which nothing is cut.
pub(crate) fn uncut(soup: &Soup) -> Pieces<'_> {
    let piece = |(triangle, &corners): (usize, &[u32; 3])| Piece {
        corners,
        cover: Cover::One(triangle as u32),
    };
    Pieces {
        soup,
        places: Places::new(&soup.positions, Grid::holding(&soup.positions)),
        list: soup.triangles.iter().enumerate().map(piece).collect(),
        of_triangle: (0..soup.triangles.len() as u32)
            .map(|t| [t, t + 1])
            .collect(),
        contacts: Vec::new(),
    }
}

/// All pairs of triangles that meet in more than corners and an edge, ascending.
///
/// # Errors
/// [`Cancelled`] soon after `progress` is.
pub(crate) fn contacts(
    soup: &Soup,
    bvh: &BoxTree,
    only: Option<&[bool]>,
    progress: &Progress,
) -> Result<Vec<(u32, u32, Contact)>, Cancelled> {
    let mut contacts = bvh.filter_overlapping_pairs(progress, |a, b| {
        let asked = only.is_none_or(|only| only[a as usize] || only[b as usize]);
        let found = asked.then(|| contact(soup, a, b)).flatten();
        found.map(|contact| (a, b, contact))
    })?;
    contacts.par_sort_unstable_by_key(|&(a, b, _)| (a, b));
    Ok(contacts)
}

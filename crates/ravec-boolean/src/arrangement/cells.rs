//! The spaces between the pieces, and how often each mesh winds around them.
//!
//! Pieces that meet in an edge where no others do belong to one patch; both sides of a patch look into one cell each. Where
//! more than two meet, neighbors in the order around the edge look into the same cell. That leaves parts of the surface
//! which touch no others; a ray from each says what lies between them and the outside (`rays`). From there winding numbers are
//! counted through the patches.
//!
//! Source: Zhou, Grinspun, Zorin and Jacobson, "Mesh arrangements for solid geometry", 2016.
//!
//! Guarantees: if every mesh has no boundary, winding numbers are those of the exact input. If one has, numbers depend on
//! the way by which a cell is reached. Cost: linear in the pieces, and a ray for each connected part.

use std::collections::VecDeque;

use ravec_mesh::CandidateTree;
use ravec_numeric::DisjointSets;
use ravec_progress::{Cancelled, Progress};

use super::cut::Pieces;
use super::edges::{Edges, NONE, Turned, Use};
use super::rays::Rays;
use crate::params::BooleanError;

/// Pieces between two checks for cancellation: some milliseconds.
const STRIDE: usize = 1 << 16;

/// A side of a piece.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Side {
    /// The side from which its corners are seen counter-clockwise.
    Front,
    /// The other.
    Back,
}

impl Side {
    pub fn other(self) -> Self {
        match self {
            Self::Front => Self::Back,
            Self::Back => Self::Front,
        }
    }
}

/// Pieces that see the same cells.
struct Patch {
    /// The cells in front and behind.
    cells: [u32; 2],
    /// Winding-number jump of each mesh from front to back.
    change: Vec<(u32, i32)>,
}

/// The cells of a soup in pieces. Cell 0 is the outside.
pub(crate) struct Cells {
    patches: Vec<Patch>,
    /// For each piece its patch, against which it may be turned.
    patch_of: Vec<Turned>,
    meshes: usize,
    /// Winding numbers of all meshes, cell by cell.
    winding: Vec<i32>,
}

/// Winding-number jump across the piece, from its front to its back, sorted by mesh. Meshes that cancel are omitted, unless
/// they are to be `kept`.
fn change(pieces: &Pieces, piece: u32, kept: bool) -> Vec<(u32, i32)> {
    let mut list: Vec<(u32, i32)> = pieces
        .cover(piece)
        .map(|(triangle, same)| {
            let mesh = pieces.soup.sources[triangle as usize].mesh;
            (mesh, if same { 1 } else { -1 })
        })
        .collect();
    list.sort_unstable_by_key(|&(mesh, _)| mesh);
    let mut merged: Vec<(u32, i32)> = Vec::with_capacity(list.len());
    for (mesh, by) in list {
        match merged.last_mut() {
            Some(last) if last.0 == mesh => last.1 += by,
            _ => merged.push((mesh, by)),
        }
    }
    merged.retain(|&(_, by)| kept || by != 0);
    merged
}

/// The node of a side of a patch: node 0 is the outside.
pub(super) fn node(patch: Turned, side: Side) -> u32 {
    let number = patch.number();
    let number = number.expect("asked only of pieces that have an effect");
    let back = (side == Side::Back) != patch.is_turned();
    1 + 2 * number + u32::from(back)
}

/// The side that is met when turning on from a piece at an edge.
fn side_ahead(one: Use) -> Side {
    if one.forward { Side::Front } else { Side::Back }
}

impl Cells {
    /// Finds the cells. `tree` holds the triangles of the soup. With `keeps_cancelled` triangles of a mesh that lie on one another
    /// and face opposite ways are walls between cells, too.
    ///
    /// # Errors
    /// [`BooleanError::Undecided`] if it cannot be found out what a part of the surface is in,
    /// [`BooleanError::Cancelled`] soon after `progress` is.
    pub fn of(
        pieces: &Pieces,
        tree: &CandidateTree,
        keeps_cancelled: bool,
        progress: &Progress,
    ) -> Result<Self, BooleanError> {
        let change = |piece: u32| change(pieces, piece, keeps_cancelled);
        let matters = |piece: u32| pieces.has_one_cover(piece) || !change(piece).is_empty();
        let edges = Edges::of(pieces, matters, progress)?;
        let (patch_of, firsts) = patches(pieces, &edges, matters, progress)?;
        let mut sides = DisjointSets::new(1 + 2 * firsts.len());
        let mut parts = DisjointSets::new(firsts.len());
        for (_, uses) in &edges.junctions {
            for (i, &one) in uses.iter().enumerate() {
                let next = uses[(i + 1) % uses.len()];
                let [p, q] = [one, next].map(|u| patch_of[u.piece as usize]);
                sides.join(node(p, side_ahead(one)), node(q, side_ahead(next).other()));
                if let (Some(p), Some(q)) = (p.number(), q.number()) {
                    parts.join(p, q);
                }
            }
        }
        // around the border of a sheet both of its sides are in one cell
        for &piece in &edges.free {
            let patch = patch_of[piece as usize];
            sides.join(node(patch, Side::Front), node(patch, Side::Back));
        }
        progress.check()?;
        let mut rays = Rays {
            pieces,
            tree,
            patch_of: &patch_of,
            sides: &mut sides,
        };
        rays.cast(&mut parts, progress)?;

        let mut cell_of_root = vec![NONE; sides.len()];
        let outside = sides.root(0);
        cell_of_root[outside as usize] = 0;
        let mut count = 1;
        let mut cell = |node: u32| {
            let slot = &mut cell_of_root[sides.root(node) as usize];
            if *slot == NONE {
                *slot = count;
                count += 1;
            }
            *slot
        };
        let patches: Vec<Patch> = firsts
            .iter()
            .enumerate()
            .map(|(patch, &first)| Patch {
                cells: [Side::Front, Side::Back]
                    .map(|s| cell(node(Turned::new(patch as u32, false), s))),
                change: change(first),
            })
            .collect();
        let mut cells = Self {
            patches,
            patch_of,
            meshes: pieces.soup.meshes,
            winding: vec![0; count as usize * pieces.soup.meshes],
        };
        cells.count_windings(count as usize);
        Ok(cells)
    }

    fn count_windings(&mut self, count: usize) {
        let mut patches_at: Vec<Vec<u32>> = vec![Vec::new(); count];
        for (index, patch) in self.patches.iter().enumerate() {
            for cell in patch.cells {
                patches_at[cell as usize].push(index as u32);
            }
        }
        let mut reached = vec![false; count];
        reached[0] = true;
        let mut queue = VecDeque::from([0_u32]);
        while let Some(cell) = queue.pop_front() {
            for &patch in &patches_at[cell as usize] {
                let patch = &self.patches[patch as usize];
                for (from, to, sign) in [(0, 1, 1), (1, 0, -1)] {
                    let (from, to) = (patch.cells[from], patch.cells[to]);
                    if from != cell || reached[to as usize] {
                        continue;
                    }
                    reached[to as usize] = true;
                    queue.push_back(to);
                    let start = from as usize * self.meshes;
                    self.winding
                        .copy_within(start..start + self.meshes, to as usize * self.meshes);
                    for &(mesh, by) in &patch.change {
                        self.winding[to as usize * self.meshes + mesh as usize] += sign * by;
                    }
                }
            }
        }
    }

    /// Number of cells.
    pub fn len(&self) -> usize {
        self.winding.len() / self.meshes.max(1)
    }

    /// The winding number of each mesh around a cell.
    pub fn winding(&self, cell: u32) -> &[i32] {
        &self.winding[cell as usize * self.meshes..][..self.meshes]
    }

    /// The cell that a side of a piece looks into; `None` if the piece has no effect: what covers it cancels out.
    pub fn cell(&self, piece: u32, side: Side) -> Option<u32> {
        let patch = self.patch_of[piece as usize];
        let back = (side == Side::Back) != patch.is_turned();
        let patch = &self.patches[patch.number()? as usize];
        Some(patch.cells[usize::from(back)])
    }

    /// For each cell whether it is cut off from the outside by mesh `mesh` alone.
    pub fn enclosed_by(&self, mesh: u32) -> Vec<bool> {
        let mut open = DisjointSets::new(self.len());
        for patch in &self.patches {
            if patch.change.iter().all(|&(m, _)| m != mesh) {
                open.join(patch.cells[0], patch.cells[1]);
            }
        }
        let outside = open.root(0);
        (0..self.len() as u32)
            .map(|cell| open.root(cell) != outside)
            .collect()
    }
}

/// Collects pieces over edges of two into patches; gives the patch of each piece and the first piece of each patch, which is not
/// turned against it.
///
/// Sets of pieces are united in the order of the pieces, each under its first, which reads memory more evenly than going from
/// neighbor to neighbor.
fn patches(
    pieces: &Pieces,
    edges: &Edges,
    matters: impl Fn(u32) -> bool,
    progress: &Progress,
) -> Result<(Vec<Turned>, Vec<u32>), Cancelled> {
    // an earlier piece of the same set, or the piece itself
    let mut earlier = vec![Turned::NONE; pieces.end() as usize];
    for (at, piece) in pieces.all().filter(|&piece| matters(piece)).enumerate() {
        if at % STRIDE == 0 {
            progress.check()?;
        }
        earlier[piece as usize] = Turned::new(piece, false);
        for neighbor in edges.across[piece as usize] {
            let Some(before) = neighbor.number().filter(|&other| other < piece) else {
                continue;
            };
            let (one, is_one_turned) = first_of(&mut earlier, piece);
            let (other, is_other_turned) = first_of(&mut earlier, before);
            if one != other {
                let is_turned = is_one_turned ^ is_other_turned ^ neighbor.is_turned();
                earlier[one.max(other) as usize] = Turned::new(one.min(other), is_turned);
            }
        }
    }
    // from the first on each piece finds the patch where an earlier one was
    let mut firsts = Vec::new();
    for piece in 0..pieces.end() {
        if (piece as usize).is_multiple_of(STRIDE) {
            progress.check()?;
        }
        let own = earlier[piece as usize];
        earlier[piece as usize] = match own.number() {
            None => Turned::NONE,
            Some(first) if first == piece => {
                firsts.push(piece);
                Turned::new(firsts.len() as u32 - 1, false)
            }
            Some(before) => earlier[before as usize].turned(own.is_turned()),
        };
    }
    Ok((earlier, firsts))
}

/// The first piece of a set, and whether a piece of it is turned against that.
fn first_of(earlier: &mut [Turned], mut piece: u32) -> (u32, bool) {
    let mut is_turned = false;
    loop {
        let own = earlier[piece as usize];
        let Some(before) = own.number().filter(|&before| before != piece) else {
            return (piece, is_turned);
        };
        let next = earlier[before as usize];
        // two steps become one
        if let Some(first) = next.number() {
            earlier[piece as usize] = Turned::new(first, own.is_turned() ^ next.is_turned());
        }
        is_turned ^= own.is_turned();
        piece = before;
    }
}

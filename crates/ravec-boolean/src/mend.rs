//! Rounding to doubles, and mending what it does.
//!
//! Points of cuts fall between doubles. Rounded, triangles thinner than an ulp may turn over, meet others or vanish. New
//! triangles are therefore compared with all around them, by exact tests of the rounded corners, and if any two meet
//! where they should not, the rounded surface is taken for an input of its own: cut along itself, and reduced to the
//! border of what it winds around. That is rounded again, and so on; in practice it settles in a round or two.
//!
//! Source: the idea of iterated snap rounding (Halperin and Packer, 2002), on surfaces.
//!
//! Guarantees: if the number of contacts left is zero, no two triangles of the result meet in more than common corners
//! or an edge. Does not guarantee that this is reached.

use ravec_mesh::{Aabb, BoxTree, TriMesh};
use ravec_progress::{Cancelled, Progress};

use crate::arrangement::{Cells, Soup, cut};
use crate::closing::Closing;
use crate::select::{Draft, Parent, select};

/// Rounds after which mending is given up.
const MOST_ROUNDS: u32 = 8;

/// A mended surface.
pub(crate) struct Mended {
    pub draft: Draft,
    pub rounds: u32,
    /// Pairs of triangles that still meet.
    pub contacts: u64,
}

/// Mends a draft whose triangles that are whole are known to meet each other properly. `input` holds the triangles that
/// parents are named after.
///
/// # Errors
/// [`Cancelled`] soon after `progress` is.
pub(crate) fn mend(
    mut draft: Draft,
    input: &BoxTree,
    progress: &Progress,
) -> Result<Mended, Cancelled> {
    let mut contacts = conflicts(&draft, input, progress)?;
    let mut rounds = 0;
    while contacts > 0 && rounds < MOST_ROUNDS {
        rounds += 1;
        let mesh = draft.mesh();
        let soup = Soup::of(&[&mesh], &[Closing::default()], progress)?;
        let bvh = bvh_of(&soup, progress)?;
        let is_new: Vec<bool> = soup
            .sources
            .iter()
            .map(|source| !draft.parents[source.triangle as usize].whole)
            .collect();
        let pieces = cut(&soup, &bvh, Some(&is_new), progress)?;
        let cells = Cells::of(&pieces, &bvh, progress)?;
        let inside: Vec<bool> = (0..cells.len() as u32)
            .map(|cell| cells.winding(cell)[0] > 0)
            .collect();
        let mut next = select(&pieces, &cells, &inside);
        for parent in &mut next.parents {
            let source = soup.sources[parent.triangle as usize];
            let before = draft.parents[source.triangle as usize];
            *parent = Parent {
                triangle: before.triangle,
                reversed: before.reversed != parent.reversed,
                whole: before.whole && parent.whole,
            };
        }
        draft = next;
        contacts = conflicts(&draft, input, progress)?;
    }
    Ok(Mended {
        draft,
        rounds,
        contacts,
    })
}

/// A search structure over a soup.
pub(crate) fn bvh_of(soup: &Soup, progress: &Progress) -> Result<BoxTree, Cancelled> {
    let mesh = TriMesh::new(soup.positions.clone(), soup.triangles.clone())
        .expect("a soup has finite positions, and its corners are among them");
    BoxTree::try_new(&mesh, progress)
}

/// How many pairs of new triangles, or of a new and a whole one, meet where they should not.
fn conflicts(draft: &Draft, input: &BoxTree, progress: &Progress) -> Result<u64, Cancelled> {
    // whole triangles by their names in the input, to find those near new ones
    let mut whole = vec![u32::MAX; input.len()];
    let mut chosen = vec![false; draft.triangles.len()];
    let mut list: Vec<usize> = Vec::new();
    for (index, parent) in draft.parents.iter().enumerate() {
        if parent.whole {
            whole[parent.triangle as usize] = index as u32;
        } else {
            chosen[index] = true;
            list.push(index);
        }
    }
    let new = list.len();
    for at in 0..new {
        if at % 4096 == 0 {
            progress.check()?;
        }
        let corners = draft.triangles[list[at]].map(|v| draft.positions[v as usize]);
        input.for_each_touching(&Aabb::around(corners), |triangle| {
            let index = whole[triangle as usize];
            if index != u32::MAX && !std::mem::replace(&mut chosen[index as usize], true) {
                list.push(index as usize);
            }
        });
    }
    let part = Draft {
        positions: draft.positions.clone(),
        triangles: list.iter().map(|&i| draft.triangles[i]).collect(),
        parents: Vec::new(),
    };
    let mesh = part.mesh();
    let soup = Soup::of(&[&mesh], &[Closing::default()], progress)?;
    let is_new: Vec<bool> = soup
        .sources
        .iter()
        .map(|source| (source.triangle as usize) < new)
        .collect();
    let bvh = bvh_of(&soup, progress)?;
    let contacts = crate::arrangement::contacts(&soup, &bvh, Some(&is_new), progress)?;
    Ok(contacts.len() as u64)
}

//! Rounding to the numbers of the result, and the repair of its self-intersections.
//!
//! Points of cuts fall between doubles, and between 32-bit floats all the more. Rounded, triangles thinner than an ulp may turn
//! over, meet others or vanish. New triangles are therefore compared with all around them, by exact tests of the rounded corners, and if any two meet
//! where they should not, the rounded surface is taken for an input of its own: cut along itself, and reduced to the
//! border of what it winds around. That is rounded again, and so on. From the second round on, vertices of triangles
//! that meet are first merged with each other, and with edges and triangles, where they are near to them; the reach grows from
//! round to round. If that leads to more contacts, it is given up.
//!
//! Source: the idea of iterated snap rounding (Halperin and Packer, 2002), on surfaces.
//!
//! Guarantees: if the number of contacts left is zero, no two triangles of the result meet in more than common corners
//! or an edge. Does not guarantee that this is reached.

use glam::DVec3;
use ravec_mesh::{Aabb, CandidateTree, Coordinates, TriMesh};
use ravec_progress::{Cancelled, Progress};

use crate::arrangement::{Cells, Soup, cut};
use crate::closing::Closing;
use crate::near::merge_near;
use crate::params::BooleanError;
use crate::select::{Draft, Parent, select};

/// Rounds after which repair gives up.
const MAX_ROUNDS: u32 = 8;

/// New triangles per contact above which only vertices of triangles that meet are merged; below, those of all new ones.
const SPARSE: usize = 50;

/// Growth per round of the distance within which vertices are merged.
const GROWTH: f64 = 4.0;

/// The reach does not grow beyond this share of the largest coordinate: half a unit in the last place of 32-bit floats, or
/// some such units where the result is rounded to these.
fn farthest(coordinates: Coordinates) -> f64 {
    match coordinates {
        Coordinates::Double => 6e-8,
        Coordinates::Single => 32.0 * coordinates.epsilon(),
    }
}

/// Rounds the places of a draft, and gives the largest change of a coordinate. Triangles with a corner that changes are not
/// whole any more.
pub(crate) fn round_to(draft: &mut Draft, coordinates: Coordinates) -> f64 {
    let mut largest = 0.0_f64;
    if coordinates == Coordinates::Double {
        return largest;
    }
    let mut has_changed = vec![false; draft.positions.len()];
    for (p, has_changed) in draft.positions.iter_mut().zip(&mut has_changed) {
        let rounded = coordinates.nearest(*p);
        let change = (rounded - *p).abs().max_element();
        *has_changed = change > 0.0;
        largest = largest.max(change);
        *p = rounded;
    }
    if largest > 0.0 {
        for (corners, parent) in draft.triangles.iter().zip(&mut draft.parents) {
            parent.whole &= !corners.iter().any(|&v| has_changed[v as usize]);
        }
    }
    largest
}

/// A repaired surface.
pub(crate) struct Repaired {
    pub draft: Draft,
    pub rounds: u32,
    /// Pairs of triangles that still meet.
    pub contacts: u64,
    /// The farthest that a vertex may have been moved along an axis beyond rounding to doubles.
    pub moved: f64,
}

/// Repairs a draft over `coordinates` whose triangles that are whole are known to meet each other properly. `input` holds the
/// triangles that parents are named after; `reach` is how near vertices are merged in the second round, the first that does.
///
/// # Errors
/// Those of [`Cells::of`].
pub(crate) fn repair(
    mut draft: Draft,
    input: &CandidateTree,
    mut reach: f64,
    coordinates: Coordinates,
    progress: &Progress,
) -> Result<Repaired, BooleanError> {
    let mut found = conflicts(&draft, input, progress)?;
    let largest = input.bounds().min.abs().max(input.bounds().max.abs());
    let most = farthest(coordinates) * largest.max_element();
    let (mut rounds, mut moved) = (0, 0.0);
    let mut contacts = usize::MAX;
    while !found.is_empty() && rounds < MAX_ROUNDS && found.len() <= contacts {
        progress.check()?;
        contacts = found.len();
        rounds += 1;
        let mut soup = soup_of(draft.positions.clone(), draft.triangles.clone(), progress)?;
        if rounds > 1 {
            // where a few triangles meet the others are left alone; where many do, all are slivers
            let new = draft.parents.iter().filter(|parent| !parent.whole).count();
            let all = found.len() * SPARSE > new;
            let mut chosen: Vec<bool> = draft.parents.iter().map(|p| all && !p.whole).collect();
            for &t in found.iter().flatten() {
                chosen[t as usize] = true;
            }
            let meets = |t: u32| chosen[soup.sources[t as usize].triangle as usize];
            soup = merge_near(&soup, reach, meets, progress)?;
            progress.check()?;
            moved += reach;
            reach = (GROWTH * reach).min(most);
            for (t, source) in soup.sources.iter().enumerate() {
                let corners = draft.triangles[source.triangle as usize];
                let as_before = corners.map(|v| draft.positions[v as usize]);
                let parent = &mut draft.parents[source.triangle as usize];
                parent.whole &= soup.corners(t as u32) == as_before;
            }
        }
        progress.check()?;
        let tree = soup.tree(progress)?;
        let is_new: Vec<bool> = soup
            .sources
            .iter()
            .map(|source| !draft.parents[source.triangle as usize].whole)
            .collect();
        let pieces = cut(&soup, &tree, Some(&is_new), progress)?;
        let cells = Cells::of(&pieces, &tree, false, progress)?;
        let inside: Vec<bool> = (0..cells.len() as u32)
            .map(|cell| cells.winding(cell)[0] > 0)
            .collect();
        let mut next = select(&pieces, &cells, &inside, progress)?;
        for p in &mut next.positions {
            *p = coordinates.nearest(*p);
        }
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
        progress.check()?;
        found = conflicts(&draft, input, progress)?;
    }
    Ok(Repaired {
        draft,
        rounds,
        contacts: found.len() as u64,
        moved,
    })
}

/// A soup of one surface.
fn soup_of(
    positions: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
    progress: &Progress,
) -> Result<Soup, Cancelled> {
    let mesh = TriMesh::new(positions, triangles);
    let mesh = mesh.expect("rounded points are finite, and corners are among them");
    Soup::of(&[&mesh], &[Closing::default()], &[], progress)
}

/// The pairs of new triangles, or of a new and a whole one, that meet where they should not.
///
/// # Errors
/// [`Cancelled`] soon after `progress` is.
pub(crate) fn conflicts(
    draft: &Draft,
    input: &CandidateTree,
    progress: &Progress,
) -> Result<Vec<[u32; 2]>, Cancelled> {
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
    if new == 0 {
        return Ok(Vec::new());
    }
    for at in 0..new {
        if at % 4096 == 0 {
            progress.check()?;
        }
        let corners = draft.triangles[list[at]].map(|v| draft.positions[v as usize]);
        input.for_each_near(&Aabb::around(corners), |triangle| {
            let index = whole[triangle as usize];
            if index != u32::MAX && !std::mem::replace(&mut chosen[index as usize], true) {
                list.push(index as usize);
            }
        });
    }
    // only what these use, in the same order
    let mut name_of = vec![u32::MAX; draft.positions.len()];
    for &v in list.iter().flat_map(|&t| &draft.triangles[t]) {
        name_of[v as usize] = 0;
    }
    let mut positions = Vec::new();
    for (name, &at) in name_of.iter_mut().zip(&draft.positions) {
        if *name == 0 {
            *name = positions.len() as u32;
            positions.push(at);
        }
    }
    let triangle = |&t: &usize| draft.triangles[t].map(|v| name_of[v as usize]);
    let soup = soup_of(positions, list.iter().map(triangle).collect(), progress)?;
    let is_new: Vec<bool> = soup
        .sources
        .iter()
        .map(|source| (source.triangle as usize) < new)
        .collect();
    let tree = soup.tree(progress)?;
    let contacts = crate::arrangement::contacts(&soup, &tree, Some(&is_new), progress)?;
    let name = |t: u32| list[soup.sources[t as usize].triangle as usize] as u32;
    Ok(contacts
        .into_iter()
        .map(|(a, b, _)| [name(a), name(b)])
        .collect())
}

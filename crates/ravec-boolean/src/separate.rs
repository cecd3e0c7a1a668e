//! Vertices at one place, moved apart: for formats whose readers join what is at one place.
//!
//! The finished mesh has a vertex for each solid at the same place, if solids touch in an edge or a vertex. STL cannot
//! say so: read again, the edge has four triangles. Each such vertex is moved against the normals around it, into its solid,
//! so that the solids draw back from each other; if triangles meet then, with the normals, out of its solid, as where a cavity
//! touches the outer surface; and then farther. Each attempt is judged by exact tests of the moved triangles.
//!
//! Guarantees: vertices move by at most eight steps along an axis. If no place and no contact is left, no two vertices
//! are at one place, and no two triangles meet in more than common corners or an edge. Does not guarantee that this is
//! reached. Cost: that of a search structure over all triangles for each attempt, if any vertices share a place.

use glam::DVec3;
use ravec_mesh::{Coordinates, TriMesh, place_key};
use ravec_progress::{Cancelled, Progress};
use rustc_hash::FxHashMap;

use crate::arrangement::{Soup, contacts};
use crate::closing::Closing;
use crate::finish::Finished;

/// Attempts for a vertex, in steps: into its solid where negative.
const ATTEMPTS: [f64; 8] = [-1.0, 1.0, -2.0, 2.0, -4.0, 4.0, -8.0, 8.0];

/// Length of a step as a share of the largest coordinate: two units in the last place of 32-bit floats, which most readers of
/// STL use. A shorter one may vanish in rounding.
const STEP_REL: f64 = 2.0 * f32::EPSILON as f64;

/// A vertex that shares its place.
struct Shared {
    vertex: u32,
    place: DVec3,
    /// Sum of the unit normals around it, weighted by angle.
    normal: DVec3,
    attempt: usize,
}

/// Outcome of [`separate`].
#[derive(Debug, Default)]
pub(crate) struct Separated {
    /// Vertices that were moved.
    pub vertices: u64,
    /// Longest move along an axis.
    pub moved: f64,
    /// Vertices that still share a place.
    pub shared: u64,
    /// Pairs of triangles that meet after it and did not before, and triangles that lost their area.
    pub faults: u64,
}

/// Gives each vertex a place of its own.
///
/// # Errors
/// [`Cancelled`] soon after `progress` is.
pub(crate) fn separate(
    finished: &mut Finished,
    coordinates: Coordinates,
    progress: &Progress,
) -> Result<Separated, Cancelled> {
    let mut shared = vertices_at_shared_places(finished, progress)?;
    if shared.is_empty() {
        return Ok(Separated::default());
    }
    let largest = finished.positions.iter().map(|p| p.abs().max_element());
    let step = STEP_REL * largest.fold(0.0, f64::max);
    let index: FxHashMap<u32, usize> = (0..).zip(&shared).map(|(i, s)| (s.vertex, i)).collect();
    loop {
        for one in &shared {
            let way = ATTEMPTS[one.attempt] * step * one.normal;
            finished.positions[one.vertex as usize] = coordinates.nearest(one.place + way);
        }
        let (failed, faults) = failures(finished, &index, progress)?;
        let mut can_go_on = false;
        for &i in &failed {
            let attempt = &mut shared[i].attempt;
            if *attempt + 1 < ATTEMPTS.len() {
                *attempt += 1;
                can_go_on = true;
            }
        }
        if !can_go_on {
            let places = vertices_at_shared_places(finished, progress)?;
            let moves = shared
                .iter()
                .map(|one| (finished.positions[one.vertex as usize] - one.place).abs());
            return Ok(Separated {
                vertices: shared.len() as u64,
                moved: moves.map(DVec3::max_element).fold(0.0, f64::max),
                shared: places.len() as u64,
                faults,
            });
        }
    }
}

/// The vertices that have the place of another one, ascending.
fn vertices_at_shared_places(
    finished: &Finished,
    progress: &Progress,
) -> Result<Vec<Shared>, Cancelled> {
    let mut first_at: FxHashMap<[u64; 3], u32> = FxHashMap::default();
    first_at.reserve(finished.positions.len());
    let mut is_shared = vec![false; finished.positions.len()];
    let mut any = false;
    for (v, &p) in finished.positions.iter().enumerate() {
        if v % (1 << 16) == 0 {
            progress.check()?;
        }
        let first = *first_at.entry(place_key(p)).or_insert(v as u32);
        if first != v as u32 {
            is_shared[first as usize] = true;
            is_shared[v] = true;
            any = true;
        }
    }
    if !any {
        return Ok(Vec::new());
    }
    let mut normals: FxHashMap<u32, DVec3> = FxHashMap::default();
    for t in &finished.triangles {
        for i in (0..3).filter(|&i| is_shared[t[i] as usize]) {
            let [a, b, c] = [0, 1, 2].map(|k| finished.positions[t[(i + k) % 3] as usize]);
            let normal = (b - a).cross(c - a).normalize_or_zero();
            *normals.entry(t[i]).or_default() += (b - a).angle_between(c - a) * normal;
        }
    }
    let shared = is_shared.iter().enumerate().filter(|(_, shared)| **shared);
    Ok(shared
        .map(|(v, _)| Shared {
            vertex: v as u32,
            place: finished.positions[v],
            normal: pointed(normals.get(&(v as u32)).copied().unwrap_or_default()),
            attempt: 0,
        })
        .collect())
}

/// A direction scaled so that its largest component is 1: a step is then never lost in rounding.
fn pointed(v: DVec3) -> DVec3 {
    let largest = v.abs().max_element();
    if largest > 0.0 && largest.is_finite() {
        v / largest
    } else {
        // surfaces around that face all ways: any direction will do
        DVec3::ONE
    }
}

/// The entries of moved vertices that share a place, or are at triangles without area or in a contact; and the number of such
/// triangles and contacts.
fn failures(
    finished: &Finished,
    index: &FxHashMap<u32, usize>,
    progress: &Progress,
) -> Result<(Vec<usize>, u64), Cancelled> {
    let mut failed = Vec::new();
    let of_triangle = |t: usize| {
        let corners = finished.triangles[t].into_iter();
        corners.filter_map(|v| index.get(&v).copied())
    };
    for one in vertices_at_shared_places(finished, progress)? {
        failed.extend(index.get(&one.vertex));
    }
    let mesh = TriMesh::new(finished.positions.clone(), finished.triangles.clone());
    let mesh = mesh.expect("rounded places near finite ones are finite");
    let soup = Soup::of(&[&mesh], &[Closing::default()], &[], progress)?;
    let mut has_area = vec![false; finished.triangles.len()];
    for source in &soup.sources {
        has_area[source.triangle as usize] = true;
    }
    let mut faults = 0;
    for t in (0..has_area.len()).filter(|&t| !has_area[t]) {
        failed.extend(of_triangle(t));
        faults += 1;
    }
    let tree = soup.tree(progress)?;
    let is_moved: Vec<bool> = soup
        .sources
        .iter()
        .map(|source| of_triangle(source.triangle as usize).next().is_some())
        .collect();
    let found = contacts(&soup, &tree, Some(&is_moved), progress)?;
    for &(a, b, _) in &found {
        for t in [a, b] {
            failed.extend(of_triangle(soup.sources[t as usize].triangle as usize));
        }
    }
    failed.sort_unstable();
    failed.dedup();
    Ok((failed, faults + found.len() as u64))
}

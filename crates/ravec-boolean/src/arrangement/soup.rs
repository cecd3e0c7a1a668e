//! All triangles of all meshes in one list, with one vertex for each place.

use glam::DVec3;
use ravec_mesh::{Aabb, CandidateTree, OrientedPlane, TriMesh};
use ravec_progress::{Cancelled, Progress};

use super::same_place::first_at_place;
use crate::closing::Closing;

/// Vertices or triangles between two checks for cancellation: some milliseconds.
const STRIDE: usize = 1 << 16;

/// Coordinates smaller than this are taken for zero: exact tests multiply the differences of three, which must not vanish.
const MIN_COORDINATE: f64 = 1e-70;

/// Origin of a triangle of the soup.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Source {
    /// Index of the mesh.
    pub mesh: u32,
    /// Index of the triangle in the mesh; beyond its triangles, those that close it.
    pub triangle: u32,
}

/// A triangle with its name, and what its corners are.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Facet {
    pub triangle: u32,
    pub vertices: [u32; 3],
    pub corners: [DVec3; 3],
}

/// A place as exact tests take it.
pub(crate) fn testable(p: DVec3) -> DVec3 {
    // adding zero makes the two zeros one
    DVec3::select(p.abs().cmplt(DVec3::splat(MIN_COORDINATE)), DVec3::ZERO, p) + DVec3::ZERO
}

/// All triangles that have an area, over vertices of which no two are at one place.
#[derive(Debug, Clone, Default)]
pub(crate) struct Soup {
    pub positions: Vec<DVec3>,
    pub triangles: Vec<[u32; 3]>,
    pub sources: Vec<Source>,
    /// Number of meshes.
    pub meshes: usize,
    /// `true` if positions are those of the meshes: none was so small that it was taken for zero, and none was moved.
    pub is_as_given: bool,
}

impl Soup {
    /// Puts meshes and what closes them together. Of `sound` meshes all triangles are known to have an area; it may say nothing
    /// about the last ones.
    ///
    /// # Errors
    /// [`Cancelled`] soon after `progress` is.
    pub fn of(
        meshes: &[&TriMesh],
        closings: &[Closing],
        sound: &[bool],
        progress: &Progress,
    ) -> Result<Self, Cancelled> {
        let count = |f: fn(&TriMesh) -> usize| meshes.iter().map(|m| f(m)).sum();
        let triangles: usize = count(|m| m.triangles().len());
        let positions: usize = count(|m| m.positions().len());
        let mut soup = Self {
            positions: Vec::with_capacity(positions),
            triangles: Vec::with_capacity(triangles),
            sources: Vec::with_capacity(triangles),
            meshes: meshes.len(),
            is_as_given: true,
        };
        for (mesh, closing) in meshes.iter().zip(closings) {
            for part in mesh.positions().chunks(STRIDE).chain([&closing.added[..]]) {
                progress.check()?;
                let first = soup.positions.len();
                soup.positions.extend(part.iter().copied().map(testable));
                soup.is_as_given &= soup.positions[first..] == *part;
            }
        }
        let names = one_for_each_place(&mut soup.positions, progress)?;
        let mut first = 0;
        for (index, (mesh, closing)) in meshes.iter().zip(closings).enumerate() {
            let names = &names[first..][..mesh.positions().len() + closing.added.len()];
            first += names.len();
            let is_known = soup.is_as_given && sound.get(index) == Some(&true);
            let own = mesh.triangles().len();
            // what closes a mesh of which nothing is wanted is not wanted either
            let added = if own > 0 { &closing.triangles[..] } else { &[] };
            for (triangle, corners) in mesh.triangles().iter().chain(added).enumerate() {
                if triangle % STRIDE == 0 {
                    progress.check()?;
                }
                let corners = corners.map(|v| names[v as usize]);
                if (is_known && triangle < own) || soup.has_area(corners) {
                    soup.triangles.push(corners);
                    soup.sources.push(Source {
                        mesh: index as u32,
                        triangle: triangle as u32,
                    });
                }
            }
        }
        Ok(soup)
    }

    /// No triangles yet, over given places.
    pub fn with_vertices(positions: Vec<DVec3>, meshes: usize) -> Self {
        Self {
            positions,
            meshes,
            ..Self::default()
        }
    }

    /// A search structure over the triangles.
    ///
    /// # Errors
    /// [`Cancelled`] soon after `progress` is.
    pub fn tree(&self, progress: &Progress) -> Result<CandidateTree, Cancelled> {
        let bounds = Aabb::around(self.positions.iter().copied());
        CandidateTree::try_new(bounds, self.triangles.len(), |t| self.corners(t), progress)
    }

    /// Adds a triangle if it has an area.
    pub fn push(&mut self, corners: [u32; 3], source: Source) {
        if self.has_area(corners) {
            self.triangles.push(corners);
            self.sources.push(source);
        }
    }

    /// Returns `true` if a triangle with these corners has an area, exactly.
    pub fn has_area(&self, corners: [u32; 3]) -> bool {
        let [a, b, c] = corners.map(|v| self.positions[v as usize]);
        let distinct =
            corners[0] != corners[1] && corners[1] != corners[2] && corners[2] != corners[0];
        distinct && !OrientedPlane::through(a, b, c).is_degenerate()
    }

    /// The places of the corners of a triangle.
    #[inline]
    pub fn corners(&self, triangle: u32) -> [DVec3; 3] {
        self.triangles[triangle as usize].map(|v| self.positions[v as usize])
    }
}

/// Leaves only the first of the positions at each place, in their order, and gives for each of those that were there the number
/// of the one that is left.
///
/// # Errors
/// [`Cancelled`] soon after `progress` is.
pub(crate) fn one_for_each_place(
    positions: &mut Vec<DVec3>,
    progress: &Progress,
) -> Result<Vec<u32>, Cancelled> {
    let mut names = first_at_place(positions, progress)?;
    let mut left = 0;
    for at in 0..names.len() {
        let first = names[at] as usize;
        names[at] = if first == at {
            positions[left] = positions[at];
            left += 1;
            left as u32 - 1
        } else {
            names[first]
        };
    }
    positions.truncate(left);
    Ok(names)
}

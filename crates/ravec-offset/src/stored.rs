//! A finished surface, in memory or in the storage where it was made, to be written row by row.

use crate::params::OffsetError;
use crate::pieces::Pieces;
use crate::tile::{Patch, VertexName, border};
use glam::DVec3;
use ravec_mesh::{MeshRows, RowsError, TriMesh};
use ravec_progress::Progress;
use rustc_hash::FxHashMap;

/// A surface that need not be in memory. `write_rows` of `ravec-mesh-io` writes it.
#[derive(Debug)]
pub struct OffsetSurface(Kind);

#[derive(Debug)]
enum Kind {
    Mesh(TriMesh),
    Stored(StoredSurface),
}

/// A surface in blocks, whose vertices have numbers: each that of its first place in the order of the blocks.
#[derive(Debug)]
pub(crate) struct StoredSurface {
    pieces: Pieces,
    /// The number of the first vertex that is new in each block, and how many vertices there are.
    firsts: Vec<u32>,
    /// The numbers of vertices that several blocks may have.
    shared: FxHashMap<VertexName, u32>,
}

impl From<TriMesh> for OffsetSurface {
    fn from(mesh: TriMesh) -> Self {
        Self(Kind::Mesh(mesh))
    }
}

impl From<StoredSurface> for OffsetSurface {
    fn from(stored: StoredSurface) -> Self {
        Self(Kind::Stored(stored))
    }
}

impl OffsetSurface {
    /// All of it in memory.
    ///
    /// # Errors
    /// [`OffsetError::Storage`] if it cannot be read from where it is; [`OffsetError::Cancelled`].
    pub fn into_mesh(self, progress: &Progress) -> Result<TriMesh, OffsetError> {
        match self.0 {
            Kind::Mesh(mesh) => Ok(mesh),
            Kind::Stored(stored) => stored.pieces.into_mesh(progress),
        }
    }

    /// Whether all of it is in memory.
    pub fn is_in_memory(&self) -> bool {
        matches!(self.0, Kind::Mesh(_))
    }

    fn rows(&self) -> &dyn MeshRows {
        match &self.0 {
            Kind::Mesh(mesh) => mesh,
            Kind::Stored(stored) => stored,
        }
    }
}

impl MeshRows for OffsetSurface {
    fn vertex_count(&self) -> usize {
        self.rows().vertex_count()
    }

    fn triangle_count(&self) -> usize {
        self.rows().triangle_count()
    }

    fn for_each_vertex(
        &self,
        visit: &mut dyn FnMut(DVec3) -> Result<(), RowsError>,
    ) -> Result<(), RowsError> {
        self.rows().for_each_vertex(visit)
    }

    fn for_each_triangle(
        &self,
        visit: &mut dyn FnMut([u32; 3], [DVec3; 3]) -> Result<(), RowsError>,
    ) -> Result<(), RowsError> {
        self.rows().for_each_triangle(visit)
    }
}

/// What a walk through the triangles of a block comes across.
enum Step {
    /// A vertex that no block before had.
    Vertex(DVec3),
    Triangle([u32; 3], [DVec3; 3]),
}

impl StoredSurface {
    /// Gives numbers to the vertices. Takes some 40 bytes for each that several blocks have, about a quarter of all.
    pub fn new(pieces: Pieces, progress: &Progress) -> Result<Self, OffsetError> {
        let mut firsts = vec![0];
        let mut shared = FxHashMap::default();
        let mut next = 0;
        for block in 0..pieces.blocks().len() {
            progress.check()?;
            let (patch, numbers) = pieces.part(block)?;
            let triangles: Vec<u32> = numbers.collect();
            let border = border_of(&patch, &triangles);
            let mut is_known = vec![false; border.len()];
            for v in corners(&patch, &triangles) {
                if std::mem::replace(&mut is_known[v], true) {
                    continue;
                }
                if border[v] && *shared.entry(patch.names[v]).or_insert(next) != next {
                    continue;
                }
                next += 1;
            }
            firsts.push(next);
        }
        Ok(Self {
            pieces,
            firsts,
            shared,
        })
    }

    fn walk(
        &self,
        block: usize,
        mut visit: impl FnMut(Step) -> Result<(), RowsError>,
    ) -> Result<(), RowsError> {
        let (patch, numbers) = self.pieces.part(block).map_err(unread)?;
        let triangles: Vec<u32> = numbers.collect();
        let border = border_of(&patch, &triangles);
        let mut names = vec![u32::MAX; border.len()];
        let mut next = self.firsts[block];
        for &t in &triangles {
            let corners = patch.triangles[t as usize];
            for v in corners.map(|v| v as usize) {
                if names[v] != u32::MAX {
                    continue;
                }
                names[v] = if border[v] {
                    self.shared[&patch.names[v]]
                } else {
                    next
                };
                if names[v] == next {
                    next += 1;
                    visit(Step::Vertex(patch.positions[v]))?;
                }
            }
            let places = corners.map(|v| patch.positions[v as usize]);
            visit(Step::Triangle(corners.map(|v| names[v as usize]), places))?;
        }
        Ok(())
    }
}

fn unread(error: OffsetError) -> RowsError {
    match error {
        OffsetError::Cancelled(_) => RowsError::Cancelled,
        other => RowsError::Io(std::io::Error::other(other.to_string())),
    }
}

/// The vertices of some triangles, as often as these have them.
fn corners<'a>(patch: &'a Patch, triangles: &'a [u32]) -> impl Iterator<Item = usize> + 'a {
    let corners = |&t: &u32| patch.triangles[t as usize].map(|v| v as usize);
    triangles.iter().flat_map(corners)
}

fn border_of(patch: &Patch, triangles: &[u32]) -> Vec<bool> {
    let chosen = triangles.iter().map(|&t| &patch.triangles[t as usize]);
    border(patch.positions.len(), chosen)
}

impl MeshRows for StoredSurface {
    fn vertex_count(&self) -> usize {
        self.firsts.last().map_or(0, |&count| count as usize)
    }

    fn triangle_count(&self) -> usize {
        self.pieces.triangles()
    }

    fn for_each_vertex(
        &self,
        visit: &mut dyn FnMut(DVec3) -> Result<(), RowsError>,
    ) -> Result<(), RowsError> {
        for block in 0..self.pieces.blocks().len() {
            self.walk(block, |step| match step {
                Step::Vertex(at) => visit(at),
                Step::Triangle(..) => Ok(()),
            })?;
        }
        Ok(())
    }

    fn for_each_triangle(
        &self,
        visit: &mut dyn FnMut([u32; 3], [DVec3; 3]) -> Result<(), RowsError>,
    ) -> Result<(), RowsError> {
        for block in 0..self.pieces.blocks().len() {
            self.walk(block, |step| match step {
                Step::Vertex(_) => Ok(()),
                Step::Triangle(corners, places) => visit(corners, places),
            })?;
        }
        Ok(())
    }
}

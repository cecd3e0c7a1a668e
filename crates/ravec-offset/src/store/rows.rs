//! The finished surface, in memory or in its storage, written row by row.

use super::ChunkedSurface;
use crate::params::OffsetError;
use crate::surface::{Patch, VertexName, border};
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

/// A surface in blocks, with the numbers of its vertices: by first occurrence in the order of the blocks.
#[derive(Debug)]
pub(crate) struct StoredSurface {
    chunks: ChunkedSurface,
    /// First new vertex number of each block, then the number of vertices.
    firsts: Vec<u32>,
    /// Numbers of vertices that several blocks may share.
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
    /// Loads the whole surface into memory.
    ///
    /// # Errors
    /// [`OffsetError::Storage`] if reading fails; [`OffsetError::Cancelled`].
    pub fn into_mesh(self, progress: &Progress) -> Result<TriMesh, OffsetError> {
        match self.0 {
            Kind::Mesh(mesh) => Ok(mesh),
            Kind::Stored(stored) => stored.chunks.into_mesh(progress),
        }
    }

    /// Returns whether the whole surface is in memory.
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

/// A step of a walk through a block.
enum Step {
    /// A vertex that no earlier block has.
    Vertex(DVec3),
    Triangle([u32; 3], [DVec3; 3]),
}

impl StoredSurface {
    /// Numbers the vertices. Takes about 40 bytes per shared vertex, about a quarter of all.
    pub fn new(chunks: ChunkedSurface, progress: &Progress) -> Result<Self, OffsetError> {
        let mut firsts = vec![0];
        let mut shared = FxHashMap::default();
        let mut next = 0;
        for block in 0..chunks.blocks().len() {
            progress.check()?;
            let (patch, numbers) = chunks.visible(block)?;
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
            chunks,
            firsts,
            shared,
        })
    }

    fn walk(
        &self,
        block: usize,
        mut visit: impl FnMut(Step) -> Result<(), RowsError>,
    ) -> Result<(), RowsError> {
        let (patch, numbers) = self.chunks.visible(block).map_err(read_error)?;
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

fn read_error(error: OffsetError) -> RowsError {
    match error {
        OffsetError::Cancelled(_) => RowsError::Cancelled,
        other => RowsError::Io(std::io::Error::other(other.to_string())),
    }
}

/// Returns the vertices of some triangles, with repetitions.
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
        self.chunks.triangles()
    }

    fn for_each_vertex(
        &self,
        visit: &mut dyn FnMut(DVec3) -> Result<(), RowsError>,
    ) -> Result<(), RowsError> {
        for block in 0..self.chunks.blocks().len() {
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
        for block in 0..self.chunks.blocks().len() {
            self.walk(block, |step| match step {
                Step::Vertex(_) => Ok(()),
                Step::Triangle(corners, places) => visit(corners, places),
            })?;
        }
        Ok(())
    }
}

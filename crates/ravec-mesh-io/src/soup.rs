//! The vertices and faces of a file while it is read.
//!
//! Counts are checked against the limits before anything is stored; memory grows with the data, never with a count that
//! a header claims.

use glam::{DVec2, DVec3};
use ravec_memory::{MemoryBudget, Reservation};
use ravec_progress::Progress;

use crate::error::{Place, ReadMeshError};
use crate::polygon::triangulate;
use crate::read::{MeshFile, MeshLimits, MeshMemory, ReadWarning};
use crate::{LengthUnit, MeshFormat};
use ravec_memory::{ReservedVec, with_room};
use ravec_mesh::TriMesh;

/// Number of triangles that are processed between two checks for cancellation.
const AT_ONCE: usize = 1 << 16;

/// A face with more than three corners, kept until the positions of all its corners are known.
struct Polygon {
    /// Number of triangles before it.
    before: usize,
    /// End of its corners in `corners`; they begin where those of the polygon before end.
    end: usize,
}

/// Stands for a corner without texture coordinates.
pub(super) const NO_TEXTURE: u32 = u32::MAX;

/// Texture coordinates, and which of them the corners of faces have. Both lists of corners may be shorter than those of the
/// faces: the rest has none.
struct Texture {
    coordinates: ReservedVec<DVec2>,
    of_triangles: ReservedVec<[u32; 3]>,
    /// As the corners of polygons.
    of_corners: ReservedVec<u32>,
}

impl Texture {
    fn new(budget: &MemoryBudget) -> Self {
        Self {
            coordinates: ReservedVec::new(budget),
            of_triangles: ReservedVec::new(budget),
            of_corners: ReservedVec::new(budget),
        }
    }

    /// Texture coordinates of the corners of a triangle.
    fn of_triangle(&self, triangle: usize) -> [DVec2; 3] {
        let corners = self.of_triangles.get(triangle);
        corners.map_or([DVec2::NAN; 3], |corners| corners.map(|i| self.at(i)))
    }

    fn at(&self, index: u32) -> DVec2 {
        let coordinates = self.coordinates.get(index as usize).copied();
        coordinates.unwrap_or(DVec2::NAN)
    }
}

/// The part of the mesh that has been read.
pub(super) struct Soup {
    format: MeshFormat,
    limits: MeshLimits,
    positions: ReservedVec<DVec3>,
    colors: ReservedVec<[u8; 4]>,
    triangles: ReservedVec<[u32; 3]>,
    polygons: ReservedVec<Polygon>,
    corners: ReservedVec<u32>,
    texture: Texture,
    /// Triangles that the polygons will give.
    more: u64,
    /// The highest index that a face names, where, and as what it stands there.
    highest: Option<(u32, Place, i64)>,
    left_out: u64,
    warnings: Vec<ReadWarning>,
}

impl Soup {
    pub(super) fn new(format: MeshFormat, limits: &MeshLimits) -> Self {
        // Indices are 32-bit whatever the caller allows.
        let most = u64::from(u32::MAX);
        let limits = MeshLimits {
            max_vertices: limits.max_vertices.min(most),
            max_triangles: limits.max_triangles.min(most),
            memory: limits.memory.clone(),
        };
        let budget = &limits.memory;
        Self {
            format,
            positions: ReservedVec::new(budget),
            colors: ReservedVec::new(budget),
            triangles: ReservedVec::new(budget),
            polygons: ReservedVec::new(budget),
            corners: ReservedVec::new(budget),
            texture: Texture::new(budget),
            limits,
            more: 0,
            highest: None,
            left_out: 0,
            warnings: Vec::new(),
        }
    }

    /// Announces counts that a header claims: those beyond the limits are refused at once.
    pub(super) fn claim(&mut self, vertices: u64, faces: u64) -> Result<(), ReadMeshError> {
        self.check_vertices(vertices)?;
        self.check_triangles(faces)?;
        self.positions.expect(vertices);
        self.triangles.expect(faces);
        Ok(())
    }

    /// Announces counts that are likely, and may be wrong.
    pub(super) fn expect(&mut self, vertices: u64, triangles: u64) {
        self.positions.expect(vertices);
        self.triangles.expect(triangles);
    }

    /// Announces that each vertex will have a color.
    pub(super) fn claim_colors(&mut self, vertices: u64) {
        self.colors.expect(vertices);
    }

    #[inline]
    fn check_vertices(&self, count: u64) -> Result<(), ReadMeshError> {
        if count > self.limits.max_vertices {
            return Err(ReadMeshError::TooMany {
                what: "vertices",
                limit: self.limits.max_vertices,
            });
        }
        Ok(())
    }

    #[inline]
    fn check_triangles(&self, count: u64) -> Result<(), ReadMeshError> {
        if count > self.limits.max_triangles {
            return Err(ReadMeshError::TooMany {
                what: "triangles",
                limit: self.limits.max_triangles,
            });
        }
        Ok(())
    }

    /// Number of vertices.
    pub(super) fn vertices(&self) -> usize {
        self.positions.len()
    }

    /// The number of triangles, polygons not counted.
    pub(super) fn triangles(&self) -> usize {
        self.triangles.len()
    }

    /// Fails unless `count` more vertices may come.
    pub(super) fn check_more_vertices(&self, count: u64) -> Result<(), ReadMeshError> {
        self.check_vertices((self.positions.len() as u64).saturating_add(count))
    }

    /// Fails unless `triangles` more may come.
    #[inline]
    pub(super) fn check_room(&self, triangles: u64) -> Result<(), ReadMeshError> {
        let so_far = self.triangles.len() as u64 + self.more;
        self.check_triangles(so_far.saturating_add(triangles))
    }

    /// Adds a vertex.
    #[inline]
    pub(super) fn vertex(&mut self, at: DVec3, place: Place) -> Result<(), ReadMeshError> {
        if !at.is_finite() {
            return Err(ReadMeshError::NotFinite {
                format: self.format,
                place,
                vertex: self.positions.len() as u64,
                at: at.to_array(),
            });
        }
        self.check_vertices(self.positions.len() as u64 + 1)?;
        self.positions.push(at)?;
        Ok(())
    }

    /// Adds the color of the last vertex, red, green, blue and alpha.
    #[inline]
    pub(super) fn color(&mut self, color: [u8; 4]) -> Result<(), ReadMeshError> {
        self.colors.push(color)?;
        Ok(())
    }

    /// Adds texture coordinates for corners to name.
    pub(super) fn texture(&mut self, at: DVec2) -> Result<(), ReadMeshError> {
        if self.texture.coordinates.len() as u64 >= self.limits.max_vertices {
            return Err(ReadMeshError::TooMany {
                what: "vertices",
                limit: self.limits.max_vertices,
            });
        }
        // what is nowhere is as good as none
        let at = if at.is_finite() { at } else { DVec2::NAN };
        self.texture.coordinates.push(at)?;
        Ok(())
    }

    /// Number of texture coordinates.
    pub(super) fn textures(&self) -> usize {
        self.texture.coordinates.len()
    }

    /// Adds a face whose corners have these texture coordinates, or [`NO_TEXTURE`].
    pub(super) fn textured_face(
        &mut self,
        corners: &[u32],
        texture: &[u32],
    ) -> Result<(), ReadMeshError> {
        let (triangles, polygons) = (self.triangles.len(), self.corners.len());
        self.face(corners)?;
        if self.triangles.len() > triangles {
            let of_triangles = &mut self.texture.of_triangles;
            of_triangles.fill_up_to(triangles, [NO_TEXTURE; 3])?;
            of_triangles.push(std::array::from_fn(|i| texture[i]))?;
        } else if self.corners.len() > polygons {
            let of_corners = &mut self.texture.of_corners;
            of_corners.fill_up_to(polygons, NO_TEXTURE)?;
            of_corners.extend_from_slice(texture)?;
        }
        Ok(())
    }

    /// The index that stands in the file as `written`, `base` subtracted. It may name a vertex that is yet to come.
    #[inline]
    pub(super) fn index(
        &mut self,
        written: i64,
        base: i64,
        place: Place,
    ) -> Result<u32, ReadMeshError> {
        match u32::try_from(written - base) {
            Ok(index) => {
                let higher = self.highest.is_none_or(|(highest, ..)| index > highest);
                if index as usize >= self.positions.len() && higher {
                    self.highest = Some((index, place, written));
                }
                Ok(index)
            }
            Err(_) => Err(self.no_such_vertex(written, place)),
        }
    }

    fn no_such_vertex(&self, index: i64, place: Place) -> ReadMeshError {
        ReadMeshError::NoSuchVertex {
            format: self.format,
            place,
            index,
            vertices: self.positions.len() as u64,
        }
    }

    /// Adds a face; one with fewer than three corners is counted and left out.
    #[inline]
    pub(super) fn face(&mut self, corners: &[u32]) -> Result<(), ReadMeshError> {
        let gives = (corners.len() as u64).saturating_sub(2);
        self.check_room(gives)?;
        match *corners {
            [a, b, c] => self.triangles.push([a, b, c])?,
            [] | [_] | [_, _] => self.left_out += 1,
            _ => {
                self.more += gives;
                self.corners.extend_from_slice(corners)?;
                self.polygons.push(Polygon {
                    before: self.triangles.len(),
                    end: self.corners.len(),
                })?;
            }
        }
        Ok(())
    }

    /// Remembers that something of the file is not in the mesh.
    pub(super) fn warn(&mut self, warning: ReadWarning) {
        if !self.warnings.contains(&warning) {
            self.warnings.push(warning);
        }
    }

    /// Remembers that a kind of data is not in the mesh.
    #[inline]
    pub(super) fn ignore(&mut self, what: &'static str) {
        self.warn(ReadWarning::Ignored { what });
    }

    /// The mesh, with its polygons cut into triangles.
    pub(super) fn finish(
        self,
        unit: Option<LengthUnit>,
        progress: &Progress,
    ) -> Result<MeshFile, ReadMeshError> {
        if let Some((index, place, written)) = self.highest
            && index as usize >= self.positions.len()
        {
            return Err(self.no_such_vertex(written, place));
        }
        let mut warnings = self.warnings;
        warnings.extend(face_warnings(
            self.polygons.len() as u64,
            self.more,
            self.left_out,
        ));
        let budget = &self.limits.memory;
        let mut texture: ReservedVec<[DVec2; 3]> = ReservedVec::new(budget);
        let mut all = self.triangles;
        let textured = !self.texture.coordinates.is_empty();
        if textured {
            texture.make_room(all.len() + self.more as usize)?;
        }
        if !self.polygons.is_empty() {
            let single = all;
            let (mut triangles, memory) = with_room(budget, single.len() + self.more as usize)?;
            let (mut taken, mut start, mut since_check) = (0, 0, 0);
            for polygon in self.polygons.iter() {
                let corners = &self.corners[start..polygon.end];
                since_check += corners.len() + polygon.before - taken;
                // at worst some microseconds for each corner
                if since_check >= 4096 {
                    progress.check()?;
                    since_check = 0;
                }
                triangles.extend_from_slice(&single[taken..polygon.before]);
                let first = triangles.len();
                triangulate(corners, &self.positions, &mut triangles, progress)?;
                if textured {
                    for t in taken..polygon.before {
                        texture.push(self.texture.of_triangle(t))?;
                    }
                    let of_corners = self.texture.of_corners.get(start..polygon.end);
                    let at = |i: u32| {
                        let of = of_corners.map(|of| self.texture.at(of[i as usize]));
                        of.unwrap_or(DVec2::NAN)
                    };
                    for block in triangles[first..].chunks(AT_ONCE) {
                        progress.check()?;
                        for t in block {
                            texture.push(t.map(at))?;
                        }
                    }
                }
                for block in triangles[first..].chunks_mut(AT_ONCE) {
                    progress.check()?;
                    for t in block {
                        *t = t.map(|i| corners[i as usize]);
                    }
                }
                (taken, start) = (polygon.before, polygon.end);
            }
            triangles.extend_from_slice(&single[taken..]);
            if textured {
                for t in taken..single.len() {
                    texture.push(self.texture.of_triangle(t))?;
                }
            }
            all = ReservedVec::from_parts(triangles, memory);
        } else if textured {
            for t in 0..all.len() {
                if t.is_multiple_of(1 << 16) {
                    progress.check()?;
                }
                texture.push(self.texture.of_triangle(t))?;
            }
        }
        drop((self.polygons, self.corners, self.texture));
        let (format, lists) = (self.format, (self.positions, all));
        let mut file = mesh_file(format, lists, unit, warnings, progress)?;
        let (colors, mut memory) = self.colors.into_parts();
        if colors.len() == file.mesh.positions().len() {
            file.colors = colors;
        } else {
            if !colors.is_empty() {
                // several tables of vertices, and not all with colors
                file.warnings.push(ReadWarning::Ignored { what: "colors" });
            }
            drop(colors);
            memory.shrink_to(0);
        }
        let (texture, of_texture) = texture.into_parts();
        file.texture = texture;
        memory.absorb(of_texture);
        file.memory.absorb(memory);
        Ok(file)
    }
}

/// Warnings about polygons that were cut into triangles, and about faces that were left out.
fn face_warnings(polygons: u64, triangles: u64, faces: u64) -> impl Iterator<Item = ReadWarning> {
    let cut = ReadWarning::PolygonsCut {
        polygons,
        triangles,
    };
    let left_out = ReadWarning::FacesLeftOut { faces };
    let cut = (polygons > 0).then_some(cut);
    cut.into_iter().chain((faces > 0).then_some(left_out))
}

/// Puts the parts together.
pub(super) fn mesh_file(
    format: MeshFormat,
    (positions, triangles): (ReservedVec<DVec3>, ReservedVec<[u32; 3]>),
    unit: Option<LengthUnit>,
    mut warnings: Vec<ReadWarning>,
    progress: &Progress,
) -> Result<MeshFile, ReadMeshError> {
    let (positions, mut memory): (_, Reservation) = positions.into_parts();
    let (triangles, of_triangles) = triangles.into_parts();
    memory.absorb(of_triangles);
    let mesh = TriMesh::try_new(positions, triangles, progress)?.map_err(|error| {
        ReadMeshError::Unsupported {
            format,
            what: error.to_string(),
        }
    })?;
    if mesh.triangles().is_empty() {
        warnings.push(ReadWarning::NoTriangles);
    }
    Ok(MeshFile {
        mesh,
        format,
        unit,
        colors: Vec::new(),
        texture: Vec::new(),
        objects: Vec::new(),
        negative: TriMesh::default(),
        warnings,
        memory: MeshMemory::new(memory),
    })
}

//! glTF 2.0, binary (GLB) and JSON.
//!
//! Read are the triangles of the file's scene (the first if it names none; all nodes if there are no scenes), each placed
//! by the transforms of its nodes; the coordinates keep the directions of the file (y up) and are in meters. Transforms
//! that mirror turn the triangles around, so that their outside stays outside. Each use of a mesh makes new vertices.
//! The instances of `EXT_mesh_gpu_instancing` are uses of a mesh like others; nodes that `KHR_node_visibility` hides are left
//! out. The first set of texture coordinates is read if it was requested. Materials, normals, colors, skins and morph targets
//! are left out, points and lines, too. Meshes compressed by an extension are refused, and so are files that require an
//! extension which is not known here.
//!
//! Cost: the data of the buffers are held in memory, the text is not; of each mesh only those primitives are gone through
//! again with each use that bring something.

mod buffers;
mod document;
mod json;

use std::collections::HashMap;

use glam::{DAffine3, DMat4, DQuat, DVec2, DVec3};
use ravec_memory::MemoryBudget;
use ravec_progress::Progress;

use self::buffers::{Buffers, Origins};
use self::document::{Document, InstanceAttributes, Node, PACKING, Primitive};
use self::json::Json;
use crate::error::{Place, ReadMeshError};
use crate::number::shown;
use crate::read::{BufferResolver, MeshFile, ReadWarning};
use crate::soup::Soup;
use crate::source::Source;
use crate::{LengthUnit, MeshFormat};
use ravec_memory::ReservedVec;

pub(super) fn read(
    mut source: Source<'_>,
    resolver: Option<&mut BufferResolver<'_>>,
) -> Result<MeshFile, ReadMeshError> {
    let (format, progress, options) = (source.format, source.progress, source.options().clone());
    let length = if format == MeshFormat::Glb {
        head(&mut source)?
    } else {
        source.skip_mark()?;
        u64::MAX
    };
    let mut json = Json::new(&mut source, length);
    let parsed = serde_json::from_reader(&mut json);
    if let Some(failure) = json.take_failure() {
        return Err(failure);
    }
    let (left, data, _of_document) = json.finish();
    let document: Document = match parsed {
        Ok(document) => document,
        Err(_) if left > 0 && format == MeshFormat::Glb && source.peek(1)?.is_empty() => {
            return Err(source.truncated("a chunk"));
        }
        Err(error) => {
            // In a GLB file the text has a single line.
            let place = Place::Line(error.line() as u64);
            let error = error.to_string();
            let what = format!("the JSON is not right: {}", shown(error.as_bytes()));
            return Err(ReadMeshError::syntax(format, place, what));
        }
    };
    if let Some(extension) = document.extensions_required.names.first() {
        return Err(ReadMeshError::Unsupported {
            format,
            what: format!(
                "the file needs the extension `{}`, which is not read here; save it without compression and extensions",
                shown(extension.as_bytes())
            ),
        });
    }
    let inside = match format {
        MeshFormat::Glb => binary_chunk(&mut source, left)?,
        _ => None,
    };
    drop(source);
    let origins = Origins {
        inside,
        data,
        resolver,
    };
    let buffers = Buffers::new(format, &document.buffers, origins, &options, progress)?;
    let budget = options.limits.memory.clone();
    let mut scene = Scene {
        format,
        document: &document,
        buffers: &buffers,
        fruitful: ReservedVec::new(&budget),
        soup: Soup::new(format, &options.limits),
        texture: options.texture,
        budget,
        progress,
    };
    scene.name_extensions();
    scene.read()?;
    let soup = scene.soup;
    drop(buffers);
    soup.finish(Some(LengthUnit::Meter), progress)
}

fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]])
}

/// Passes over the header of a GLB file and that of its first chunk, the JSON, and gives the length of that.
fn head(source: &mut Source<'_>) -> Result<u64, ReadMeshError> {
    const HEADER: usize = 12;
    let Some(header) = source.exact(HEADER)? else {
        return Err(source.truncated("the header"));
    };
    if u32_at(header, 4) != 2 {
        return Err(ReadMeshError::Unsupported {
            format: MeshFormat::Glb,
            what: "only version 2 of glTF is read".to_owned(),
        });
    }
    let chunk = source.exact(8)?;
    let json = chunk.filter(|chunk| &chunk[4..] == b"JSON");
    let length = json.map(|chunk| u64::from(u32_at(chunk, 0)));
    length.ok_or_else(|| {
        let what = "the first chunk of the file is not its JSON";
        ReadMeshError::syntax(MeshFormat::Glb, Place::Byte(12), what)
    })
}

/// The chunk of binary data, which comes after `left` bytes, if there is one.
fn binary_chunk(
    source: &mut Source<'_>,
    left: u64,
) -> Result<Option<ReservedVec<u8>>, ReadMeshError> {
    if !source.skip(left)? {
        return Err(source.truncated("a chunk"));
    }
    while let Some(chunk) = source.exact(8)? {
        let (length, is_binary) = (u64::from(u32_at(chunk, 0)), &chunk[4..] == b"BIN\0");
        if is_binary {
            let bytes = source.bytes(length, length)?;
            if (bytes.len() as u64) < length {
                return Err(source.truncated("a chunk"));
            }
            return Ok(Some(bytes));
        }
        // Chunks of other kinds may be there and are to be passed over.
        if !source.skip(length)? {
            return Err(source.truncated("a chunk"));
        }
    }
    Ok(None)
}

/// The vertices of a primitive.
struct Vertices {
    /// Their start in the soup.
    begin: u32,
    count: usize,
    /// Start of their texture coordinates there.
    texture: Option<u32>,
}

/// The scene while it is read.
struct Scene<'a> {
    format: MeshFormat,
    document: &'a Document,
    buffers: &'a Buffers,
    /// Of the meshes that were used before, the primitives that bring something.
    fruitful: ReservedVec<Option<ReservedVec<u32>>>,
    soup: Soup,
    /// `true` if texture coordinates are wanted.
    texture: bool,
    budget: MemoryBudget,
    progress: &'a Progress,
}

impl Scene<'_> {
    fn fault(&self, of: &'static str, index: usize, what: &str) -> ReadMeshError {
        let index = index as u64;
        ReadMeshError::syntax(self.format, Place::Item { of, index }, what)
    }

    /// Warns of the extensions that the file uses and may have its shape from.
    fn name_extensions(&mut self) {
        let used = &self.document.extensions_used;
        let names = used.names.iter();
        let names = names.filter(|name| !PACKING.contains(&name.as_str()));
        let names: Vec<_> = names.map(|name| shown(name.as_bytes())).collect();
        if !names.is_empty() {
            let more = used.more;
            self.soup
                .warn(ReadWarning::UnknownExtensions { names, more });
        }
    }

    fn read(&mut self) -> Result<(), ReadMeshError> {
        let document = self.document;
        for _ in 0..document.meshes.len() {
            self.fruitful.push(None)?;
        }
        let (vertices, triangles) = expected(document);
        self.soup.expect(vertices, triangles);
        if document.nodes.is_empty() {
            for mesh in 0..document.meshes.len() {
                self.mesh(mesh, &DAffine3::IDENTITY)?;
            }
        }
        let mut seen = ReservedVec::new(&self.budget);
        seen.fill_up_to(document.nodes.len(), false)?;
        let mut left: ReservedVec<(usize, DAffine3)> = ReservedVec::new(&self.budget);
        if let Some(scene) = document.scenes.get(document.scene.unwrap_or(0)) {
            for &root in scene.nodes.iter().rev() {
                left.push((root, DAffine3::IDENTITY))?;
            }
        } else {
            // the nodes that are nobody's children
            let mut is_root = ReservedVec::new(&self.budget);
            is_root.fill_up_to(document.nodes.len(), true)?;
            for &child in document.nodes.iter().flat_map(|node| &node.children) {
                if let Some(is_root) = is_root.get_mut(child) {
                    *is_root = false;
                }
            }
            for root in (0..document.nodes.len())
                .rev()
                .filter(|&node| is_root[node])
            {
                left.push((root, DAffine3::IDENTITY))?;
            }
        }
        while let Some((index, scene_from_parent)) = left.pop() {
            self.progress.check()?;
            let Some(node) = document.nodes.get(index) else {
                return Err(self.fault("node", index, "there is no such node"));
            };
            if std::mem::replace(&mut seen[index], true) {
                return Err(self.fault("node", index, "it has two parents"));
            }
            let extensions = node.extensions.as_deref();
            let visibility = extensions.and_then(|extensions| extensions.visibility.as_ref());
            if visibility.is_some_and(|visibility| visibility.visible == Some(false)) {
                self.soup.ignore("nodes that the file hides");
                continue;
            }
            let scene_from_node = scene_from_parent * local(node);
            if let Some(mesh) = node.mesh {
                self.remark_on_pose(node, mesh);
                match extensions.and_then(|extensions| extensions.instancing.as_ref()) {
                    None => self.mesh(mesh, &scene_from_node)?,
                    Some(instancing) => {
                        self.instances(mesh, &instancing.attributes, &scene_from_node)?;
                    }
                }
            }
            for &child in node.children.iter().rev() {
                left.push((child, scene_from_node))?;
            }
        }
        Ok(())
    }

    /// Warns if a node puts its mesh into a pose, which is not done here.
    fn remark_on_pose(&mut self, node: &Node, mesh: usize) {
        if node.skin.is_some() {
            self.soup.warn(ReadWarning::RestPose { of: "skins" });
        }
        let of_mesh = || self.document.meshes.get(mesh)?.weights;
        if node.weights.or_else(of_mesh) == Some(true) {
            let of = "morph targets";
            self.soup.warn(ReadWarning::RestPose { of });
        }
    }

    /// Adds a mesh once for each element of the accessors that place its instances.
    fn instances(
        &mut self,
        mesh: usize,
        attributes: &InstanceAttributes,
        scene_from_node: &DAffine3,
    ) -> Result<(), ReadMeshError> {
        let (document, buffers) = (self.document, self.buffers);
        let &InstanceAttributes {
            translation,
            rotation,
            scale,
        } = attributes;
        let points = |accessor: Option<usize>| {
            accessor
                .map(|accessor| buffers.points(document, accessor))
                .transpose()
        };
        let (mut shifts, mut scales) = (points(translation)?, points(scale)?);
        let turns = rotation.map(|accessor| buffers.quaternions(document, accessor));
        let mut turns = turns.transpose()?;
        let given = [translation, rotation, scale].into_iter().flatten();
        let mut counts = given.map(|accessor| (accessor, document.accessors[accessor].count));
        let Some((_, count)) = counts.next() else {
            return self.mesh(mesh, scene_from_node);
        };
        if let Some((accessor, _)) = counts.find(|&(_, other)| other != count) {
            let what = "it places another number of instances than the others of its node";
            return Err(self.fault("accessor", accessor, what));
        }
        for _ in 0..count {
            let before = (self.soup.vertices(), self.soup.triangles());
            let shift = shifts.as_mut().and_then(Iterator::next);
            let turn = turns.as_mut().and_then(Iterator::next);
            let scale = scales.as_mut().and_then(Iterator::next);
            let turn = turn.map_or(DQuat::IDENTITY, rotation_of);
            let node_from_instance = DAffine3::from_scale_rotation_translation(
                scale.map_or(DVec3::ONE, DVec3::from_array),
                turn,
                shift.map_or(DVec3::ZERO, DVec3::from_array),
            );
            self.mesh(mesh, &(*scene_from_node * node_from_instance))?;
            if before == (self.soup.vertices(), self.soup.triangles()) {
                // no limit would end a mesh that brings nothing
                break;
            }
        }
        Ok(())
    }

    fn mesh(&mut self, index: usize, scene_from_mesh: &DAffine3) -> Result<(), ReadMeshError> {
        let document = self.document;
        let Some(mesh) = document.meshes.get(index) else {
            return Err(self.fault("mesh", index, "there is no such mesh"));
        };
        // Primitives often share their positions; where those begin in the soup.
        let known = self.fruitful[index].take();
        let count = known
            .as_ref()
            .map_or(mesh.primitives.len(), |known| known.len());
        // 25 bytes in up to 3.5 places while the table grows
        let _of_begins = self.budget.reserve(90 * count as u64)?;
        let mut begins: HashMap<usize, u32> = HashMap::new();
        let mut fruitful = ReservedVec::new(&self.budget);
        if let Some(known) = known {
            for &which in known.iter() {
                let primitive = &mesh.primitives[which as usize];
                self.primitive(index, primitive, scene_from_mesh, &mut begins)?;
            }
            fruitful = known;
        } else {
            for (which, primitive) in (0_u32..).zip(&mesh.primitives) {
                if self.primitive(index, primitive, scene_from_mesh, &mut begins)? {
                    fruitful.push(which)?;
                }
            }
        }
        self.fruitful[index] = Some(fruitful);
        Ok(())
    }

    /// Adds the vertices and triangles of a primitive. Says whether there were any.
    fn primitive(
        &mut self,
        mesh: usize,
        primitive: &Primitive,
        scene_from_mesh: &DAffine3,
        begins: &mut HashMap<usize, u32>,
    ) -> Result<bool, ReadMeshError> {
        self.progress.check()?;
        self.remark(primitive);
        let mode = primitive.mode.unwrap_or(4);
        if mode < 4 {
            self.soup.ignore("points and lines");
            return Ok(false);
        }
        if mode > 6 {
            return Err(self.fault("mesh", mesh, "its primitives are of no known mode"));
        }
        let Some(position) = primitive.attributes.position else {
            return Ok(false);
        };
        let (vertices, triangles) = (self.soup.vertices(), self.soup.triangles());
        let begin = if let Some(&begin) = begins.get(&position) {
            begin
        } else {
            let begin = vertices as u32;
            self.vertices(position, scene_from_mesh)?;
            begins.insert(position, begin);
            begin
        };
        let count = self.document.accessors.get(position).map_or(0, |a| a.count);
        let texture = primitive.attributes.texture.filter(|_| self.texture);
        let texture = texture
            .map(|accessor| self.coordinates(accessor, count))
            .transpose()?;
        let added = Vertices {
            begin,
            count,
            texture,
        };
        let mirrors = scene_from_mesh.matrix3.determinant() < 0.0;
        let corners = match primitive.indices {
            None => count,
            Some(accessor) => self.document.accessors.get(accessor).map_or(0, |a| a.count),
        };
        // sparse accessors may have more elements than the file has bytes
        self.soup.check_room(match mode {
            4 => corners as u64 / 3,
            _ => (corners as u64).saturating_sub(2),
        })?;
        match primitive.indices {
            None => self.triangles(mesh, mode, mirrors, &added, 0..count as u32)?,
            Some(accessor) => {
                let buffers = self.buffers;
                let indices = buffers.indices(self.document, accessor)?;
                self.triangles(mesh, mode, mirrors, &added, indices)?;
            }
        }
        Ok(self.soup.vertices() > vertices || self.soup.triangles() > triangles)
    }

    fn remark(&mut self, primitive: &Primitive) {
        for (there, what) in [
            (primitive.material.is_some(), "materials"),
            (primitive.attributes.normal.is_some(), "normals"),
            (
                primitive.attributes.texture.is_some() && !self.texture,
                "texture coordinates",
            ),
            (primitive.attributes.color.is_some(), "colors"),
            (primitive.targets.is_some(), "morph targets"),
        ] {
            if there {
                self.soup.ignore(what);
            }
        }
    }

    fn vertices(
        &mut self,
        accessor: usize,
        scene_from_mesh: &DAffine3,
    ) -> Result<(), ReadMeshError> {
        let moves = *scene_from_mesh != DAffine3::IDENTITY;
        let place = Place::Item {
            of: "accessor",
            index: accessor as u64,
        };
        let buffers = self.buffers;
        let points = buffers.points(self.document, accessor)?;
        self.soup.check_more_vertices(points.len() as u64)?;
        for (i, at) in points.enumerate() {
            if i % 65536 == 0 {
                self.progress.check()?;
            }
            let at = DVec3::from_array(at);
            let at = if moves {
                scene_from_mesh.transform_point3(at)
            } else {
                at
            };
            self.soup.vertex(at, place)?;
        }
        Ok(())
    }

    /// Adds the texture coordinates of `count` vertices, and gives the index of the first.
    fn coordinates(&mut self, accessor: usize, count: usize) -> Result<u32, ReadMeshError> {
        // fits: their number is limited like that of the vertices
        let first = self.soup.textures() as u32;
        let buffers = self.buffers;
        let pairs = buffers.pairs(self.document, accessor)?;
        if pairs.len() != count {
            let what = "it must have texture coordinates for each vertex";
            return Err(self.fault("accessor", accessor, what));
        }
        for (i, [u, v]) in pairs.enumerate() {
            if i % 65536 == 0 {
                self.progress.check()?;
            }
            // here they count from the upper edge of the picture
            self.soup.texture(DVec2::new(u, 1.0 - v))?;
        }
        Ok(first)
    }

    fn triangles(
        &mut self,
        mesh: usize,
        mode: u32,
        mirrors: bool,
        vertices: &Vertices,
        indices: impl Iterator<Item = u32>,
    ) -> Result<(), ReadMeshError> {
        let &Vertices {
            begin,
            count,
            texture,
        } = vertices;
        // The two corners that the next one makes a triangle with.
        let mut last = [0_u32; 2];
        for (i, index) in indices.enumerate() {
            if i % 65536 == 0 {
                self.progress.check()?;
            }
            if index as usize >= count {
                let index = i64::from(index);
                return Err(ReadMeshError::NoSuchVertex {
                    format: self.format,
                    place: Place::Item {
                        of: "mesh",
                        index: mesh as u64,
                    },
                    index,
                    vertices: count as u64,
                });
            }
            // Cannot overflow: the vertices are there, and so many that their indices fit.
            let corner = begin + index;
            let (complete, odd) = match mode {
                5 => (i >= 2, i % 2 == 1),
                6 => (i >= 2, false),
                _ => (i % 3 == 2, false),
            };
            if complete {
                let [a, b] = if odd == mirrors {
                    last
                } else {
                    [last[1], last[0]]
                };
                let corners = [a, b, corner];
                match texture {
                    None => self.soup.face(&corners)?,
                    Some(first) => {
                        let texture = corners.map(|corner| first + (corner - begin));
                        self.soup.textured_face(&corners, &texture)?;
                    }
                }
            }
            match (mode, i) {
                (6, 0) => last[0] = corner,
                (6, _) => last[1] = corner,
                _ => last = [last[1], corner],
            }
        }
        Ok(())
    }
}

/// Primitives of a mesh that are counted before it is read: it may have very many, and be used by very many nodes.
const COUNTED: usize = 64;

/// The numbers of vertices and triangles, if no primitives share their vertices and all nodes are in the scene.
fn expected(document: &Document) -> (u64, u64) {
    let count = |accessor: Option<usize>| {
        let accessor = accessor.and_then(|accessor| document.accessors.get(accessor));
        accessor.map_or(0, |accessor| accessor.count as u64)
    };
    let plus = |(a, b): (u64, u64), (c, d): (u64, u64)| (a.saturating_add(c), b.saturating_add(d));
    let of_primitive = |primitive: &Primitive| {
        let vertices = count(primitive.attributes.position);
        let corners = primitive.indices.map_or(vertices, |i| count(Some(i)));
        match primitive.mode.unwrap_or(4) {
            0..4 => (0, 0),
            4 => (vertices, corners / 3),
            _ => (vertices, corners.saturating_sub(2)),
        }
    };
    let of_mesh = |mesh: &document::Mesh| {
        let primitives = mesh.primitives.iter().take(COUNTED);
        primitives.map(of_primitive).fold((0, 0), plus)
    };
    if document.nodes.is_empty() {
        return document.meshes.iter().map(of_mesh).fold((0, 0), plus);
    }
    let meshes = document.nodes.iter().filter_map(|node| node.mesh);
    let meshes = meshes.filter_map(|mesh| document.meshes.get(mesh));
    meshes.map(of_mesh).fold((0, 0), plus)
}

/// The transform of a node.
fn local(node: &Node) -> DAffine3 {
    if let Some(matrix) = &node.matrix {
        return DAffine3::from_mat4(DMat4::from_cols_array(matrix));
    }
    let vector = |v: &Option<Box<[f64; 3]>>, default: DVec3| {
        v.as_deref().map_or(default, |&v| DVec3::from_array(v))
    };
    let rotation = node.rotation.as_deref();
    DAffine3::from_scale_rotation_translation(
        vector(&node.scale, DVec3::ONE),
        rotation.map_or(DQuat::IDENTITY, |&rotation| rotation_of(rotation)),
        vector(&node.translation, DVec3::ZERO),
    )
}

/// The rotation of a quaternion of any length; one of zero length is ignored.
fn rotation_of(quaternion: [f64; 4]) -> DQuat {
    let rotation = DQuat::from_array(quaternion);
    if rotation.length_squared() > 0.0 && rotation.is_finite() {
        rotation.normalize()
    } else {
        DQuat::IDENTITY
    }
}

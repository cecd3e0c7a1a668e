//! glTF 2.0, binary (GLB) and JSON.
//!
//! Read are the triangles of the file's scene (the first if it names none; all nodes if there are no scenes), each placed
//! by the transforms of its nodes; the coordinates keep the directions of the file (y up) and are in meters. Transforms
//! that mirror turn the triangles around, so that their outside stays outside. Each use of a mesh makes new vertices.
//! The first set of texture coordinates is read if it was asked for. Materials, normals, colors, skins and morph targets are
//! left out, points and lines, too. Meshes compressed by an
//! extension are refused.
//!
//! Cost: the file is held in memory whole.

mod buffers;
mod document;

use std::ops::Range;

use glam::{DAffine3, DMat4, DQuat, DVec2, DVec3};
use ravec_progress::Progress;
use rustc_hash::FxHashMap;

use self::buffers::Buffers;
use self::document::{Document, Node, Primitive};
use super::error::{Place, ReadMeshError};
use super::read::{BufferResolver, MeshFile};
use super::soup::Soup;
use super::source::Source;
use super::{LengthUnit, MeshFormat};

/// What a file may demand: these do not change where the triangles are.
const HARMLESS: [&str; 4] = [
    "KHR_mesh_quantization",
    "KHR_texture_",
    "KHR_materials_",
    "EXT_texture_",
];

pub(super) fn read(
    source: Source<'_>,
    resolver: Option<&mut BufferResolver<'_>>,
) -> Result<MeshFile, ReadMeshError> {
    let (format, progress, options) = (source.format, source.progress, source.options());
    let file = source.rest()?;
    let (json, inside) = if format == MeshFormat::Glb {
        chunks(&file)?
    } else {
        let mark = if file.starts_with(b"\xef\xbb\xbf") {
            3
        } else {
            0
        };
        (mark..file.len(), None)
    };
    let document: Document = serde_json::from_slice(&file[json]).map_err(|error| {
        // In a GLB file the text has a single line.
        let place = Place::Line(error.line() as u64);
        ReadMeshError::syntax(format, place, format!("the JSON is not right: {error}"))
    })?;
    for extension in &document.extensions_required {
        if !HARMLESS
            .iter()
            .any(|harmless| extension.starts_with(harmless))
        {
            return Err(ReadMeshError::Unsupported {
                format,
                what: format!(
                    "the file needs the extension `{}`, which is not read here; save it without compression and extensions",
                    extension.chars().take(60).collect::<String>()
                ),
            });
        }
    }
    // A JSON file has no data but in its addresses, which are in the document by now.
    let file = if inside.is_some() { file } else { Vec::new() };
    let buffers = Buffers::new(
        format,
        file,
        inside.as_ref(),
        &document.buffers,
        resolver,
        &options,
        progress,
    )?;
    let mut scene = Scene {
        format,
        document: &document,
        buffers: &buffers,
        soup: Soup::new(format, &options.limits),
        texture: options.texture,
        progress,
    };
    scene.read()?;
    scene.soup.finish(Some(LengthUnit::Meter), progress)
}

/// Where the JSON and the first buffer of a GLB file are.
fn chunks(file: &[u8]) -> Result<(Range<usize>, Option<Range<usize>>), ReadMeshError> {
    let word = |at: usize| {
        let bytes = file.get(at..at + 4)?;
        Some(u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]))
    };
    let truncated = |inside: &str| ReadMeshError::Truncated {
        format: MeshFormat::Glb,
        place: Place::Byte(file.len() as u64),
        inside: inside.to_owned(),
    };
    if word(4).ok_or_else(|| truncated("the header"))? != 2 {
        return Err(ReadMeshError::Unsupported {
            format: MeshFormat::Glb,
            what: "only version 2 of glTF is read".to_owned(),
        });
    }
    let mut at = 12;
    let mut json = None;
    while let (Some(length), Some(kind)) = (word(at), word(at + 4)) {
        let start = at + 8;
        let end = start + length as usize;
        if end > file.len() {
            return Err(truncated("a chunk"));
        }
        match (&json, &kind.to_le_bytes()) {
            (None, b"JSON") => json = Some(start..end),
            (None, _) => break,
            (Some(json), b"BIN\0") => return Ok((json.clone(), Some(start..end))),
            // Chunks of other kinds may be there and are to be passed over.
            (Some(_), _) => {}
        }
        at = end;
    }
    let json = json.ok_or_else(|| {
        let what = "the first chunk of the file is not its JSON";
        ReadMeshError::syntax(MeshFormat::Glb, Place::Byte(12), what)
    })?;
    Ok((json, None))
}

/// The vertices of a primitive.
struct Vertices {
    /// Where they begin in the soup.
    begin: u32,
    count: usize,
    /// Where their texture coordinates begin there.
    texture: Option<u32>,
}

/// The scene while it is read.
struct Scene<'a> {
    format: MeshFormat,
    document: &'a Document,
    buffers: &'a Buffers,
    soup: Soup,
    /// Whether texture coordinates are wanted.
    texture: bool,
    progress: &'a Progress,
}

impl Scene<'_> {
    fn fault(&self, of: &'static str, index: usize, what: &str) -> ReadMeshError {
        let index = index as u64;
        ReadMeshError::syntax(self.format, Place::Item { of, index }, what)
    }

    fn read(&mut self) -> Result<(), ReadMeshError> {
        let document = self.document;
        let scene = document.scenes.get(document.scene.unwrap_or(0));
        let roots = scene.map_or_else(
            || without_parents(&document.nodes),
            |scene| scene.nodes.clone(),
        );
        if document.nodes.is_empty() {
            for mesh in 0..document.meshes.len() {
                self.mesh(mesh, &DAffine3::IDENTITY)?;
            }
        }
        let mut seen = vec![false; document.nodes.len()];
        let mut left: Vec<(usize, DAffine3)> = Vec::new();
        left.extend(
            roots
                .into_iter()
                .rev()
                .map(|root| (root, DAffine3::IDENTITY)),
        );
        while let Some((index, scene_from_parent)) = left.pop() {
            self.progress.check()?;
            let Some(node) = document.nodes.get(index) else {
                return Err(self.fault("node", index, "there is no such node"));
            };
            if std::mem::replace(&mut seen[index], true) {
                return Err(self.fault("node", index, "it has two parents"));
            }
            let scene_from_node = scene_from_parent * local(node);
            if node.skin.is_some() {
                self.soup.ignore("skins");
            }
            if let Some(mesh) = node.mesh {
                self.mesh(mesh, &scene_from_node)?;
            }
            let children = node.children.iter().rev();
            left.extend(children.map(|&child| (child, scene_from_node)));
        }
        Ok(())
    }

    fn mesh(&mut self, index: usize, scene_from_mesh: &DAffine3) -> Result<(), ReadMeshError> {
        let Some(mesh) = self.document.meshes.get(index) else {
            return Err(self.fault("mesh", index, "there is no such mesh"));
        };
        // Primitives often share their positions; where those begin in the soup.
        let mut begins: FxHashMap<usize, u32> = FxHashMap::default();
        for primitive in &mesh.primitives {
            self.remark(primitive);
            let mode = primitive.mode.unwrap_or(4);
            if mode < 4 {
                self.soup.ignore("points and lines");
                continue;
            }
            if mode > 6 {
                return Err(self.fault("mesh", index, "its primitives are of no known mode"));
            }
            let Some(position) = primitive.attributes.position else {
                continue;
            };
            let begin = if let Some(&begin) = begins.get(&position) {
                begin
            } else {
                let begin = self.soup.vertices() as u32;
                self.vertices(position, scene_from_mesh)?;
                begins.insert(position, begin);
                begin
            };
            let count = self.document.accessors.get(position).map_or(0, |a| a.count);
            let texture = primitive.attributes.texture.filter(|_| self.texture);
            let texture = texture
                .map(|accessor| self.coordinates(accessor, count))
                .transpose()?;
            let vertices = Vertices {
                begin,
                count,
                texture,
            };
            let mirrors = scene_from_mesh.matrix3.determinant() < 0.0;
            match primitive.indices {
                None => self.triangles(index, mode, mirrors, &vertices, 0..count as u32)?,
                Some(accessor) => {
                    let buffers = self.buffers;
                    let indices = buffers.indices(self.document, accessor)?;
                    self.triangles(index, mode, mirrors, &vertices, indices)?;
                }
            }
        }
        Ok(())
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
        let so_far = self.soup.vertices() as u64;
        self.soup
            .claim(so_far.saturating_add(points.len() as u64), 0)?;
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

/// The nodes that are nobody's children.
fn without_parents(nodes: &[Node]) -> Vec<usize> {
    let mut is_root = vec![true; nodes.len()];
    for &child in nodes.iter().flat_map(|node| &node.children) {
        if let Some(is_root) = is_root.get_mut(child) {
            *is_root = false;
        }
    }
    (0..nodes.len()).filter(|&node| is_root[node]).collect()
}

/// The transform of a node.
fn local(node: &Node) -> DAffine3 {
    if let Some(matrix) = &node.matrix {
        return DAffine3::from_mat4(DMat4::from_cols_array(matrix));
    }
    let vector = |v: &Option<Box<[f64; 3]>>, default: DVec3| {
        v.as_deref().map_or(default, |&v| DVec3::from_array(v))
    };
    let rotation = node.rotation.as_deref().map(|&q| DQuat::from_array(q));
    // A rotation of no length is none.
    let rotation = rotation.filter(|q| q.length_squared() > 0.0 && q.is_finite());
    DAffine3::from_scale_rotation_translation(
        vector(&node.scale, DVec3::ONE),
        rotation.map_or(DQuat::IDENTITY, DQuat::normalize),
        vector(&node.translation, DVec3::ZERO),
    )
}

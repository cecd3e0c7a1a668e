//! Writing: the options, the checks that all formats share, and the choice of the writer.

mod gltf;
mod ply;
mod stl;
mod text;
mod threemf;

use std::io::{self, Write};

use glam::{DVec2, DVec3};
use ravec_progress::{Phase, Progress};

use crate::error::WriteMeshError;
use crate::{LengthUnit, MeshFormat, MeshObject};
use ravec_mesh::{KeyedMap, MeshRows, RowsError, TriMesh};

/// Options for writing a mesh.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct WriteOptions {
    /// Precision of coordinates (default [`Precision::Exact`]). Binary STL and glTF hold 32-bit floats in any case.
    pub precision: Precision,
    /// The unit of the coordinates, if known. 3MF names it (default: millimeters); glTF, whose unit is the meter, scales
    /// by it (default: not at all); no other format knows units.
    pub unit: Option<LengthUnit>,
}

/// Precision of coordinates.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(rename_all = "kebab-case")
)]
pub enum Precision {
    /// As they are, where the format can: binary STL and glTF hold 32-bit floats only.
    ///
    /// Reading the file gives the same numbers: 64-bit floats where 32 bits would change one, all digits in text.
    #[default]
    Exact,
    /// Rounded to 32-bit floats: smaller files.
    Single,
}

/// Writes `mesh` in `format`.
///
/// STL has no vertices but the corners of triangles; vertices that no triangle uses are lost, and so are all vertices of
/// a mesh without triangles in 3MF and glTF. Equal input gives equal bytes. `writer` need not be buffered; it is flushed
/// at the end. After an error, what was written is not a file.
///
/// # Errors
/// [`WriteMeshError::Io`] from `writer`, [`WriteMeshError::BeyondF32`] where 32-bit floats are written,
/// [`WriteMeshError::TooLarge`] for a glTF buffer above 4 GiB, [`WriteMeshError::Cancelled`].
///
/// ```
/// use ravec_mesh::TriMesh;
/// use ravec_mesh_io::{MeshFormat, WriteOptions, write_mesh};
/// use ravec_progress::Progress;
///
/// let corners = vec![[0.0, 0.0, 0.0].into(), [1.0, 0.0, 0.0].into(), [0.0, 1.0, 0.5].into()];
/// let mesh = TriMesh::new(corners, vec![[0, 1, 2]])?;
/// let mut file = Vec::new();
/// write_mesh(&mesh, MeshFormat::Off, &WriteOptions::default(), &mut file, &Progress::none())?;
/// assert_eq!(file, b"OFF\n3 1 0\n0.0 0.0 0.0\n1.0 0.0 0.0\n0.0 1.0 0.5\n3 0 1 2\n");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn write_mesh(
    mesh: &TriMesh,
    format: MeshFormat,
    options: &WriteOptions,
    writer: impl Write,
    progress: &Progress,
) -> Result<(), WriteMeshError> {
    write_mesh_with(
        mesh,
        Attributes::default(),
        format,
        options,
        writer,
        progress,
    )
}

/// Attributes of a mesh beside its shape.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Attributes<'a> {
    /// Red, green, blue and alpha of each vertex. Only PLY holds them.
    pub colors: &'a [[u8; 4]],
    /// Texture coordinates of the corners of each triangle, as in [`MeshFile::texture`](crate::MeshFile::texture). Only OBJ and
    /// glTF hold them. A vertex of a glTF file has one place in the texture: those with several are written several times.
    pub texture: &'a [[DVec2; 3]],
    /// The objects that the mesh consists of, whose triangles follow on one another. Only 3MF holds them: without any it has
    /// one object.
    pub objects: &'a [MeshObject],
}

/// Writes `mesh` as [`write_mesh`] does, with those of its `attributes` that the format holds, and that are as many as the
/// mesh has vertices or triangles.
///
/// # Errors
/// As [`write_mesh`].
pub fn write_mesh_with(
    mesh: &TriMesh,
    attributes: Attributes<'_>,
    format: MeshFormat,
    options: &WriteOptions,
    writer: impl Write,
    progress: &Progress,
) -> Result<(), WriteMeshError> {
    let Attributes {
        colors,
        texture,
        objects,
    } = attributes;
    let all = colors.len() == mesh.positions().len() && !colors.is_empty();
    let colors = all.then_some(colors);
    let all = texture.len() == mesh.triangles().len() && !texture.is_empty();
    let texture = all.then_some(texture);
    if let (MeshFormat::Glb | MeshFormat::Gltf, Some(texture)) = (format, texture) {
        let (split, of_vertices) = split_by_texture(mesh, texture, progress)?;
        let rows = Rows {
            texture_of_vertices: Some(&of_vertices),
            ..Rows::of(&split)
        };
        return rows.write(format, *options, writer, progress);
    }
    let rows = Rows {
        colors,
        texture,
        objects: follow_on(objects, mesh.triangles().len()).then_some((mesh, objects)),
        ..Rows::of(mesh)
    };
    rows.write(format, *options, writer, progress)
}

/// Writes a mesh as [`write_mesh`] does, without ever holding all of it.
///
/// # Errors
/// As [`write_mesh`]; [`WriteMeshError::Io`] also if `mesh` cannot be read.
pub fn write_rows(
    mesh: &impl MeshRows,
    format: MeshFormat,
    options: &WriteOptions,
    writer: impl Write,
    progress: &Progress,
) -> Result<(), WriteMeshError> {
    Rows::of(mesh).write(format, *options, writer, progress)
}

/// The rows that are written, with the attributes of their vertices and triangles, in their order.
#[derive(Clone, Copy)]
struct Rows<'a> {
    mesh: &'a dyn MeshRows,
    colors: Option<&'a [[u8; 4]]>,
    texture: Option<&'a [[DVec2; 3]]>,
    texture_of_vertices: Option<&'a [[f32; 2]]>,
    objects: Option<(&'a TriMesh, &'a [MeshObject])>,
}

/// True if each of the triangles belongs to one of `objects`, in their order, and each has some.
fn follow_on(objects: &[MeshObject], triangles: usize) -> bool {
    let mut end = 0;
    let mut follows = |object: &MeshObject| {
        let begin = std::mem::replace(&mut end, object.triangles.end);
        object.triangles.start == begin && begin < object.triangles.end
    };
    objects.iter().all(&mut follows) && !objects.is_empty() && end == triangles
}

impl<'a> Rows<'a> {
    /// Without anything else.
    fn of(mesh: &'a impl MeshRows) -> Self {
        Self {
            mesh,
            colors: None,
            texture: None,
            texture_of_vertices: None,
            objects: None,
        }
    }

    fn write(
        self,
        format: MeshFormat,
        options: WriteOptions,
        mut writer: impl Write,
        progress: &Progress,
    ) -> Result<(), WriteMeshError> {
        let Self {
            mesh,
            colors,
            texture,
            texture_of_vertices,
            objects,
        } = self;
        let single = options.precision == Precision::Single;
        let always_single = matches!(
            format,
            MeshFormat::StlBinary | MeshFormat::Glb | MeshFormat::Gltf
        );
        if single || always_single {
            check_f32(mesh, format, progress)?;
        }
        let rows = (mesh.vertex_count() + mesh.triangle_count()) as u64;
        let phase = progress.phase("write", rows);
        let mut sink = Sink {
            writer: &mut writer,
            buffer: Vec::with_capacity(FULL + ROW),
            progress,
            phase: &phase,
        };
        match format {
            MeshFormat::StlBinary => stl::write_binary(mesh, &mut sink),
            MeshFormat::StlAscii => stl::write_ascii(mesh, options.precision, &mut sink),
            MeshFormat::PlyBinary => ply::write_binary(mesh, colors, options.precision, &mut sink),
            MeshFormat::PlyAscii => ply::write_ascii(mesh, colors, options.precision, &mut sink),
            MeshFormat::Obj => text::write_obj(mesh, texture, options.precision, &mut sink),
            MeshFormat::Off => text::write_off(mesh, options.precision, &mut sink),
            MeshFormat::ThreeMf => threemf::write(mesh, objects, options, &mut sink),
            MeshFormat::Glb => gltf::write_glb(mesh, texture_of_vertices, options.unit, &mut sink),
            MeshFormat::Gltf => {
                gltf::write_gltf(mesh, texture_of_vertices, options.unit, &mut sink)
            }
        }?;
        sink.flush()?;
        writer.flush()?;
        Ok(())
    }
}

/// Number of rows that are processed between two checks for cancellation.
const AT_ONCE: usize = 1 << 16;

fn check_f32(
    mesh: &dyn MeshRows,
    format: MeshFormat,
    progress: &Progress,
) -> Result<(), WriteMeshError> {
    let (mut vertex, mut beyond): (usize, _) = (0, None);
    let walked = mesh.for_each_vertex(&mut |at| {
        if vertex.is_multiple_of(AT_ONCE) {
            progress.check()?;
        }
        beyond = at.to_array().into_iter().find(|&x| !(x as f32).is_finite());
        if beyond.is_some() {
            return Err(RowsError::Stopped);
        }
        vertex += 1;
        Ok(())
    });
    match beyond {
        Some(value) => Err(WriteMeshError::BeyondF32 {
            format,
            vertex,
            value,
        }),
        None => Ok(walked?),
    }
}

/// The same mesh with as many vertices at a place as there are texture coordinates there, and these for each vertex. Corners
/// without, or with more than 32-bit floats hold, have those of the origin: the format knows no others.
fn split_by_texture(
    mesh: &TriMesh,
    texture: &[[DVec2; 3]],
    progress: &Progress,
) -> Result<(TriMesh, Vec<[f32; 2]>), WriteMeshError> {
    let mut names: KeyedMap<(u32, [u32; 2]), u32> = KeyedMap::default();
    let (mut positions, mut of_vertices) = (Vec::new(), Vec::new());
    let corners = mesh.triangles().iter().zip(texture);
    let triangles = corners.enumerate().map(|(t, (corners, texture))| {
        if t.is_multiple_of(AT_ONCE) {
            progress.check()?;
        }
        Ok(std::array::from_fn(|i| {
            let at = texture[i];
            // counted from the upper edge of the picture
            let at = [at.x as f32, (1.0 - at.y) as f32];
            let at = if at.iter().all(|x| x.is_finite()) {
                at
            } else {
                [0.0; 2]
            };
            *names
                .entry((corners[i], at.map(f32::to_bits)))
                .or_insert_with(|| {
                    positions.push(mesh.positions()[corners[i] as usize]);
                    of_vertices.push(at);
                    (positions.len() - 1) as u32
                })
        }))
    });
    let triangles = triangles.collect::<Result<_, WriteMeshError>>()?;
    let split = TriMesh::try_new(positions, triangles, progress)?;
    let split = split.expect("vertices were numbered as they came");
    Ok((split, of_vertices))
}

/// A place rounded to 32-bit floats.
fn rounded(at: DVec3) -> [f32; 3] {
    at.to_array().map(|x| x as f32)
}

/// Number of bytes that are gathered before they are written.
const FULL: usize = 1 << 16;

/// Longer than a row of any format: three numbers of at most 25 characters, words of the longest formats.
const ROW: usize = 512;

/// Gathers rows and hands them on, with progress and cancellation.
struct Sink<'a> {
    writer: &'a mut dyn Write,
    buffer: Vec<u8>,
    progress: &'a Progress,
    phase: &'a Phase,
}

impl Sink<'_> {
    /// Appends what `spell` writes for each vertex.
    fn vertices(
        &mut self,
        mesh: &dyn MeshRows,
        mut spell: impl FnMut(&mut Vec<u8>, DVec3) -> io::Result<()>,
    ) -> Result<(), WriteMeshError> {
        let mut rows = 0;
        mesh.for_each_vertex(&mut |at| {
            spell(&mut self.buffer, at)?;
            self.count(&mut rows)
        })?;
        self.phase.advance(rows);
        Ok(())
    }

    /// Appends what `spell` writes for each triangle: its vertices, and where these are.
    fn triangles(
        &mut self,
        mesh: &dyn MeshRows,
        mut spell: impl FnMut(&mut Vec<u8>, [u32; 3], [DVec3; 3]) -> io::Result<()>,
    ) -> Result<(), WriteMeshError> {
        let mut rows = 0;
        mesh.for_each_triangle(&mut |corners, places| {
            spell(&mut self.buffer, corners, places)?;
            self.count(&mut rows)
        })?;
        self.phase.advance(rows);
        Ok(())
    }

    /// Counts a row, and hands on what was gathered if it is much.
    fn count(&mut self, rows: &mut u64) -> Result<(), RowsError> {
        *rows += 1;
        if self.buffer.len() >= FULL {
            self.flush()?;
            self.phase.advance(std::mem::take(rows));
        }
        Ok(())
    }

    /// Appends what `spell` writes for each of `items`, which are no rows of the mesh.
    fn more<T>(
        &mut self,
        items: impl IntoIterator<Item = T>,
        mut spell: impl FnMut(&mut Vec<u8>, T) -> io::Result<()>,
    ) -> Result<(), WriteMeshError> {
        for item in items {
            spell(&mut self.buffer, item)?;
            if self.buffer.len() >= FULL {
                self.flush()?;
            }
        }
        Ok(())
    }

    /// Appends `bytes`.
    fn bytes(&mut self, bytes: &[u8]) {
        self.buffer.extend_from_slice(bytes);
    }

    fn flush(&mut self) -> Result<(), RowsError> {
        self.progress.check()?;
        self.writer.write_all(&self.buffer)?;
        self.buffer.clear();
        Ok(())
    }
}

/// Appends a number so that reading gives the same one again, with an exponent if it is very large or small.
fn number(buffer: &mut Vec<u8>, x: f64, precision: Precision) -> io::Result<()> {
    match precision {
        Precision::Exact => write!(buffer, "{x:?}"),
        Precision::Single => write!(buffer, "{:?}", x as f32),
    }
}

/// Appends three numbers with spaces between them.
fn point(buffer: &mut Vec<u8>, at: DVec3, precision: Precision) -> io::Result<()> {
    number(buffer, at.x, precision)?;
    buffer.push(b' ');
    number(buffer, at.y, precision)?;
    buffer.push(b' ');
    number(buffer, at.z, precision)
}

/// Appends a whole number.
fn whole(buffer: &mut Vec<u8>, mut value: u32) {
    let mut digits = [0; 10];
    let mut start = digits.len();
    loop {
        start -= 1;
        digits[start] = b'0' + (value % 10) as u8;
        value /= 10;
        if value == 0 {
            break;
        }
    }
    buffer.extend_from_slice(&digits[start..]);
}

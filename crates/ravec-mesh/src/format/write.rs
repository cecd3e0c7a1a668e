//! Writing: the options, the checks that all formats share, and the choice of the writer.

mod gltf;
mod ply;
mod stl;
mod text;
mod threemf;

use std::io::{self, Write};

use glam::DVec3;
use ravec_progress::{Phase, Progress};

use super::error::WriteMeshError;
use super::{LengthUnit, MeshFormat};
use crate::TriMesh;

/// How a mesh is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct WriteOptions {
    /// How exactly coordinates are written (default [`Precision::Exact`]). Binary STL and glTF hold
    /// 32-bit floats in any case.
    pub precision: Precision,
    /// The unit of the coordinates, if known. 3MF names it (default: millimeters); glTF, whose unit is the meter, scales
    /// by it (default: not at all); no other format knows units.
    pub unit: Option<LengthUnit>,
}

/// How exactly coordinates are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Precision {
    /// Reading the file gives the same numbers: 64-bit floats where 32 bits would change one, all digits in text.
    #[default]
    Exact,
    /// Rounded to 32-bit floats: smaller files, for programs that hold no more.
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
/// use ravec_mesh::{MeshFormat, TriMesh, WriteOptions, write_mesh};
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
    write_colored_mesh(mesh, &[], format, options, writer, progress)
}

/// Writes `mesh` with a color for each vertex: red, green, blue and alpha.
///
/// Only PLY holds them; the other formats are written as by [`write_mesh`], and so is PLY if `colors` has not one for each
/// vertex.
///
/// # Errors
/// As [`write_mesh`].
pub fn write_colored_mesh(
    mesh: &TriMesh,
    colors: &[[u8; 4]],
    format: MeshFormat,
    options: &WriteOptions,
    mut writer: impl Write,
    progress: &Progress,
) -> Result<(), WriteMeshError> {
    let all = colors.len() == mesh.positions().len() && !colors.is_empty();
    let colors = all.then_some(colors);
    let single = options.precision == Precision::Single;
    let always_single = matches!(
        format,
        MeshFormat::StlBinary | MeshFormat::Glb | MeshFormat::Gltf
    );
    if single || always_single {
        check_f32(mesh, format)?;
    }
    let rows = (mesh.positions().len() + mesh.triangles().len()) as u64;
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
        MeshFormat::Obj => text::write_obj(mesh, options.precision, &mut sink),
        MeshFormat::Off => text::write_off(mesh, options.precision, &mut sink),
        MeshFormat::ThreeMf => threemf::write(mesh, *options, &mut sink),
        MeshFormat::Glb => gltf::write_glb(mesh, options.unit, &mut sink),
        MeshFormat::Gltf => gltf::write_gltf(mesh, options.unit, &mut sink),
    }?;
    sink.flush()?;
    writer.flush()?;
    Ok(())
}

fn check_f32(mesh: &TriMesh, format: MeshFormat) -> Result<(), WriteMeshError> {
    let positions = mesh.positions().iter().enumerate();
    for (vertex, at) in positions {
        if let Some(value) = at.to_array().into_iter().find(|&x| !(x as f32).is_finite()) {
            return Err(WriteMeshError::BeyondF32 {
                format,
                vertex,
                value,
            });
        }
    }
    Ok(())
}

/// A place rounded to 32-bit floats.
fn rounded(at: DVec3) -> [f32; 3] {
    at.to_array().map(|x| x as f32)
}

/// So much is gathered before it is written.
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
    /// Appends what `spell` writes for each of `items`; they count as rows of the mesh.
    fn rows<T>(
        &mut self,
        items: impl IntoIterator<Item = T>,
        mut spell: impl FnMut(&mut Vec<u8>, T) -> io::Result<()>,
    ) -> Result<(), WriteMeshError> {
        let mut rows = 0;
        for item in items {
            spell(&mut self.buffer, item)?;
            rows += 1;
            if self.buffer.len() >= FULL {
                self.flush()?;
                self.phase.advance(rows);
                rows = 0;
            }
        }
        self.phase.advance(rows);
        Ok(())
    }

    /// Appends `bytes`.
    fn bytes(&mut self, bytes: &[u8]) {
        self.buffer.extend_from_slice(bytes);
    }

    fn flush(&mut self) -> Result<(), WriteMeshError> {
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

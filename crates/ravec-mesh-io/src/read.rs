//! Reading: what is allowed, what is found, and the choice of the reader.

use std::fmt;
use std::io::{self, Read};
use std::sync::Arc;

use glam::DVec2;
use ravec_memory::{MemoryBudget, Reservation};
use ravec_progress::Progress;

use crate::error::ReadMeshError;
use crate::objects::MeshObject;
use crate::source::Source;
use crate::{LengthUnit, MeshFormat, gltf, obj, off, ply, sniff, stl, threemf};
use ravec_mesh::TriMesh;
use ravec_mesh::weld_within;

/// Bounds on a mesh that is read: every file is taken to be hostile.
///
/// Counts that a file claims are checked before anything is allocated, and memory grows with the data that really come.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MeshLimits {
    /// The memory that reading may take, reserved before it is allocated (default half of that of the machine). Clones share
    /// one account, and a [`MeshFile`] keeps its part of it: all files that are read with clones of one budget take no more
    /// together than it has. A file as programs write them takes up to three times its size while it is read, a 3MF file
    /// that of its unpacked model; numbers of few digits in text, and short ones in binary data, take more.
    pub memory: MemoryBudget,
    /// The most triangles, those of cut polygons and of repeated parts counted (default 200 million; never more than
    /// `u32::MAX`). Each takes 12 bytes, up to three times as much while it is read.
    pub max_triangles: u64,
    /// The most vertices, counted like the triangles, for STL after welding (default 200 million; never more than
    /// `u32::MAX`). Each takes 24 bytes, up to three times as much while it is read.
    pub max_vertices: u64,
}

impl Default for MeshLimits {
    fn default() -> Self {
        Self {
            memory: MemoryBudget::default(),
            max_triangles: 200_000_000,
            max_vertices: 200_000_000,
        }
    }
}

/// Options for reading a mesh.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ReadOptions {
    /// Limits on the cost of reading.
    pub limits: MeshLimits,
    /// Distance of vertices that are merged: `None` (the default) merges those at equal places for STL, which cannot
    /// say it otherwise, and none for other formats; `Some(0.0)` merges those at equal places in any format; more
    /// merges those within this distance (in units of the file, see [`weld`](ravec_mesh::weld)), which closes cracks
    /// and collapses small triangles.
    pub weld_tolerance: Option<f64>,
    /// Size of the file in bytes, if known (default: not known). Used to report progress, and as a mark of binary STL
    /// files, which have no other.
    pub size: Option<u64>,
    /// `true` if colors of vertices are wanted (default no: they are left out, with a warning). Read are those of PLY
    /// files; not together with `weld_tolerance`.
    pub colors: bool,
    /// `true` if texture coordinates are wanted (default no: they are left out, with a warning). Read are those of OBJ
    /// files and the first set of glTF files; not together with `weld_tolerance`.
    pub texture: bool,
}

/// A mesh and what its file says about it.
///
/// Keeps memory reserved of the budget that it was read with until it is dropped, together with its clones, which reserve
/// nothing of their own.
#[derive(Debug, Clone, PartialEq)]
pub struct MeshFile {
    /// The mesh, in units of the file.
    pub mesh: TriMesh,
    /// The format that was recognized.
    pub format: MeshFormat,
    /// The unit of its coordinates: what a 3MF file names, meters for glTF, unknown for all others.
    pub unit: Option<LengthUnit>,
    /// Red, green, blue and alpha of each vertex, if they were requested and are there; else none at all.
    pub colors: Vec<[u8; 4]>,
    /// Texture coordinates of the corners of each triangle, if they were requested and are there, else none at all: to the
    /// right and up in the picture, which reaches from 0 to 1; NaN at corners without.
    pub texture: Vec<[DVec2; 3]>,
    /// The objects of a 3MF file, one for each item that is built, in their order; none for other formats. Those of a mesh that
    /// was welded while it was read are one.
    pub objects: Vec<MeshObject>,
    /// Negative volumes of a 3MF file, in units of the file: solids to be subtracted from the objects, whose
    /// [`MeshObject::negative`] names their triangles. The mesh is as if there were none.
    pub negative: TriMesh,
    /// Differences from the file, each at most once.
    pub warnings: Vec<ReadWarning>,
    pub(super) memory: MeshMemory,
}

impl MeshFile {
    /// A mesh as if it was read from a file of this format, without attributes. No memory is reserved for it.
    pub fn from_mesh(mesh: TriMesh, format: MeshFormat) -> Self {
        Self {
            mesh,
            format,
            unit: None,
            colors: Vec::new(),
            texture: Vec::new(),
            objects: Vec::new(),
            negative: TriMesh::default(),
            warnings: Vec::new(),
            memory: MeshMemory::default(),
        }
    }
}

/// The reservation for what a [`MeshFile`] holds. It ends with the last clone of the file, and is no part of its value.
#[derive(Debug, Clone, Default)]
pub(super) struct MeshMemory {
    reservations: Vec<Arc<Reservation>>,
}

impl MeshMemory {
    pub(super) fn new(reservation: Reservation) -> Self {
        Self {
            reservations: vec![Arc::new(reservation)],
        }
    }

    /// Keeps all that `other` keeps.
    pub(super) fn absorb_all(&mut self, other: Self) {
        self.reservations.extend(other.reservations);
    }

    /// Keeps `more` as well.
    pub(super) fn absorb(&mut self, more: Reservation) {
        if more.bytes() > 0 {
            self.reservations.push(Arc::new(more));
        }
    }
}

impl PartialEq for MeshMemory {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

/// Something in a file that is not in the mesh as it was there.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum ReadWarning {
    /// Polygons with more than three corners became triangles.
    PolygonsCut {
        /// Number of polygons.
        polygons: u64,
        /// Number of triangles that they became.
        triangles: u64,
    },
    /// Faces with fewer than three corners were left out.
    FacesLeftOut {
        /// Number of faces.
        faces: u64,
    },
    /// Data that a [`TriMesh`] does not hold were left out.
    Ignored {
        /// Kind of the elements, in the plural.
        what: &'static str,
    },
    /// Vertices were made one.
    Welded {
        /// Number of vertices that were merged into an earlier one.
        vertices: u64,
        /// Number of triangles that lost a corner thereby.
        collapsed: u64,
    },
    /// The file goes on behind the end of the mesh.
    MoreBehindTheEnd,
    /// A text file lacks the line that ends it, perhaps because it was cut off there.
    NoEnd,
    /// Parts of a 3MF file that are not printed were left out.
    NotPrinted {
        /// Kind of the parts, in the singular.
        what: &'static str,
        /// Number of parts.
        count: u64,
        /// The first names of them.
        names: Vec<String>,
    },
    /// Negative volumes of a 3MF file are not in the mesh, but in [`MeshFile::negative`].
    NegativeVolumes {
        /// Number of volumes.
        volumes: u64,
        /// The first names of them.
        names: Vec<String>,
    },
    /// The settings of a slicer in a 3MF file could not be read.
    UnreadableSettings,
    /// The header announces another number of triangles than the file holds; all that are there were read.
    OtherCount {
        /// Number in the header; `u32::MAX` in some that were never filled in.
        announced: u64,
        /// Number in the file.
        found: u64,
    },
    /// The file puts the mesh into a pose, which was not done.
    RestPose {
        /// Means by which it does so, in the plural.
        of: &'static str,
    },
    /// The file uses extensions of its format that are not known here, and may have its shape from them.
    UnknownExtensions {
        /// The first few, as they can be shown.
        names: Vec<String>,
        /// The number of others.
        more: u64,
    },
    /// There is no triangle in the mesh.
    NoTriangles,
}

impl fmt::Display for ReadWarning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::PolygonsCut {
                polygons,
                triangles,
            } => write!(f, "cut {polygons} polygons into {triangles} triangles"),
            Self::FacesLeftOut { faces } => {
                write!(f, "left out {faces} faces with fewer than three corners")
            }
            Self::Ignored { what } => write!(f, "left out {what}"),
            Self::Welded {
                vertices,
                collapsed,
            } => write!(
                f,
                "welded {vertices} vertices to others, which collapsed {collapsed} triangles"
            ),
            Self::MoreBehindTheEnd => f.write_str(
                "the file goes on behind the last element that its header announces; that was left out",
            ),
            Self::NoEnd => {
                f.write_str("the file lacks its last line; it may be cut off between two triangles")
            }
            Self::NotPrinted { what, count, names } => {
                write!(f, "left out {}", Counted { what, count: *count, names })
            }
            Self::NegativeVolumes { volumes, names } => {
                let counted = Counted { what: "negative volume", count: *volumes, names };
                write!(f, "kept {counted} apart from the mesh, for subtraction")
            }
            Self::UnreadableSettings => f.write_str(
                "the settings of the slicer cannot be read: its modifiers and negative volumes are solid here; save the file again",
            ),
            Self::OtherCount { announced, found } => {
                write!(
                    f,
                    "the header announces {announced} triangles and the file holds {found}, which were read"
                )?;
                if (*found + 1..u64::from(u32::MAX)).contains(announced) {
                    f.write_str("; it may be cut off between two triangles")?;
                }
                Ok(())
            }
            Self::RestPose { of } => write!(
                f,
                "left out the pose that the file gives by {of}: the mesh is as it stands without"
            ),
            Self::UnknownExtensions { names, more } => {
                write!(f, "left out what the extensions {}", names.join(", "))?;
                if *more > 0 {
                    write!(f, " and {more} others")?;
                }
                f.write_str(" add, which are not read here and may change the shape")
            }
            Self::NoTriangles => f.write_str("the mesh has no triangles"),
        }
    }
}

/// Things of a kind with their number and the first names.
pub(super) struct Counted<'a> {
    what: &'a str,
    count: u64,
    names: &'a [String],
}

impl fmt::Display for Counted<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { what, count, names } = self;
        let plural = if *count == 1 { "" } else { "s" };
        write!(f, "{count} {what}{plural}")?;
        match names {
            [] => Ok(()),
            names => write!(f, " ({})", names.join(", ")),
        }
    }
}

/// Gives the bytes of another file that a glTF file refers to by a relative address, percent signs already decoded.
///
/// The address comes out of the file: open it only if it stays inside the folder that it should be in.
pub type BufferResolver<'a> = dyn FnMut(&str) -> io::Result<Box<dyn Read>> + 'a;

/// Reads a mesh of any format, which is recognized by its content.
///
/// `reader` need not be buffered. Cancellation is noticed at least every 256 KiB. The format is decided by the first 4 KiB, or by
/// the first 64 KiB of a text file that begins with comments.
///
/// # Errors
/// All variants of [`ReadMeshError`]; [`ReadMeshError::OverBudget`] before more memory is taken than
/// [`MeshLimits::memory`] has; [`ReadMeshError::Unsupported`] also if the data of a glTF file are in other files.
///
/// ```
/// use ravec_mesh_io::{MeshFormat, ReadOptions, read_mesh};
/// use ravec_progress::Progress;
///
/// let text = "OFF\n4 2 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 1 2\n3 0 2 3\n";
/// let file = read_mesh(text.as_bytes(), &ReadOptions::default(), &Progress::none())?;
/// assert_eq!(file.format, MeshFormat::Off);
/// assert_eq!(file.mesh.triangles(), [[0, 1, 2], [0, 2, 3]]);
/// # Ok::<(), ravec_mesh_io::ReadMeshError>(())
/// ```
pub fn read_mesh(
    reader: impl Read,
    options: &ReadOptions,
    progress: &Progress,
) -> Result<MeshFile, ReadMeshError> {
    read_dyn(reader, None, options, progress)
}

/// Reads a mesh like [`read_mesh`]; the data of glTF files that are in other files are requested from `buffers`.
///
/// # Errors
/// All variants of [`ReadMeshError`]; [`ReadMeshError::Io`] also for errors of `buffers`.
pub fn read_mesh_with_buffers(
    reader: impl Read,
    buffers: &mut BufferResolver<'_>,
    options: &ReadOptions,
    progress: &Progress,
) -> Result<MeshFile, ReadMeshError> {
    read_dyn(reader, Some(buffers), options, progress)
}

fn read_dyn(
    mut reader: impl Read,
    buffers: Option<&mut BufferResolver<'_>>,
    options: &ReadOptions,
    progress: &Progress,
) -> Result<MeshFile, ReadMeshError> {
    let mut source = Source::new(&mut reader, options, progress)?;
    source.format = recognize(&mut source, options.size)?;
    let mut file = match source.format {
        MeshFormat::StlBinary => stl::read_binary(source),
        MeshFormat::StlAscii => stl::read_ascii(source),
        MeshFormat::PlyBinary | MeshFormat::PlyAscii => ply::read(source),
        MeshFormat::Obj => obj::read(source),
        MeshFormat::Off => off::read(source),
        MeshFormat::ThreeMf => threemf::read(source),
        MeshFormat::Glb | MeshFormat::Gltf => gltf::read(source, buffers),
    }?;
    if let Some(tolerance) = options.weld_tolerance {
        progress.check()?;
        let (welded, memory) =
            weld_within(&file.mesh, tolerance, &options.limits.memory, progress)?;
        file.mesh = welded.mesh;
        if !file.objects.is_empty() {
            file.objects = vec![MeshObject {
                name: String::new(),
                triangles: 0..file.mesh.triangles().len(),
                negative: 0..file.negative.triangles().len(),
            }];
        }
        file.memory = MeshMemory::new(memory);
        if !std::mem::take(&mut file.colors).is_empty() {
            file.warnings.push(ReadWarning::Ignored { what: "colors" });
        }
        if !std::mem::take(&mut file.texture).is_empty() {
            let what = "texture coordinates";
            file.warnings.push(ReadWarning::Ignored { what });
        }
        if welded.merged > 0 {
            file.warnings.push(ReadWarning::Welded {
                vertices: welded.merged as u64,
                collapsed: welded.collapsed as u64,
            });
        }
    }
    Ok(file)
}

/// The format of what comes, from its first bytes: a stream need not end for that, nor bring much.
fn recognize(source: &mut Source<'_>, size: Option<u64>) -> Result<MeshFormat, ReadMeshError> {
    // no more is examined than requested, lest the answer depends on how much a read brings
    fn first(head: &[u8], most: usize) -> &[u8] {
        &head[..head.len().min(most)]
    }
    let mut most = sniff::HEAD;
    let head = first(source.peek(most)?, most);
    if head.is_empty() {
        return Err(ReadMeshError::Empty);
    }
    let mut is_open = sniff::is_undecided(head);
    if is_open {
        // long comments stand in front of some text files
        most = sniff::MAX_COMMENT;
        let head = first(source.peek(most)?, most);
        is_open = sniff::is_undecided(head) && head.len() == most;
    }
    let head = first(source.peek(1)?, most);
    // Of a binary STL file with extraordinary numbers at least the size is right.
    let is_stl = || size.is_some_and(|size| sniff::is_size_of_stl(head, size));
    let format = MeshFormat::sniff(head).filter(|_| !is_open);
    format
        .or_else(|| is_stl().then_some(MeshFormat::StlBinary))
        .ok_or(ReadMeshError::UnknownFormat)
}

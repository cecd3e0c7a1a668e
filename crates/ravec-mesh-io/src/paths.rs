//! Mesh files by path: standard streams, data beside glTF files, outputs that are whole or absent.

use std::cell::RefCell;
use std::fs::File;
use std::io::{self, Read, Write};
use std::path::{Component, Path, PathBuf};

use ravec_files::{is_stream, message_without_code, write_atomically};
use ravec_mesh::{MeshRows, TriMesh};
use ravec_progress::Progress;

use crate::{
    Attributes, LengthUnit, MeshFile, MeshFormat, MeshLimits, Precision, ReadMeshError,
    ReadOptions, WriteMeshError, WriteOptions, read_mesh, read_mesh_with_buffers, write_mesh_with,
    write_rows,
};

/// The format of a mesh file that is written, and its options.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MeshTarget {
    /// The format.
    pub format: MeshFormat,
    /// The precision of the coordinates.
    pub precision: Precision,
    /// The unit of the coordinates, if it is known.
    pub unit: Option<LengthUnit>,
}

impl MeshTarget {
    /// A file of this format with exact coordinates of unknown unit.
    pub fn new(format: MeshFormat) -> Self {
        Self {
            format,
            precision: Precision::default(),
            unit: None,
        }
    }

    /// The format that the extension of `path` names; for standard output, which has none, that of the input.
    ///
    /// # Errors
    /// [`UnknownMeshExtension`] for any other extension.
    pub fn of(path: &Path, input: MeshFormat) -> Result<Self, UnknownMeshExtension> {
        if is_stream(path) {
            return Ok(Self::new(input));
        }
        let extension = path.extension().and_then(|extension| extension.to_str());
        let format = extension.and_then(MeshFormat::from_extension);
        let unknown = || UnknownMeshExtension {
            path: path.to_path_buf(),
        };
        format.map(Self::new).ok_or_else(unknown)
    }

    fn options(self) -> WriteOptions {
        WriteOptions {
            precision: self.precision,
            unit: self.unit,
        }
    }
}

/// The extension of a path names no mesh format.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "{}: its extension does not name a mesh format; known are {}",
    .path.display(),
    MeshFormat::known_extensions()
)]
pub struct UnknownMeshExtension {
    /// The path.
    pub path: PathBuf,
}

/// Why a mesh was not read from a path.
#[derive(Debug, thiserror::Error)]
#[error("{}: {cause}", .path.display())]
pub struct ReadMeshFileError {
    /// The file; `-` is standard input.
    pub path: PathBuf,
    /// The reason.
    pub cause: ReadMeshError,
}

/// Why a mesh was not written to a path.
#[derive(Debug, thiserror::Error)]
#[error("{}: {cause}", .path.display())]
pub struct WriteMeshFileError {
    /// The file; `-` is standard output.
    pub path: PathBuf,
    /// The reason.
    pub cause: WriteMeshError,
}

/// Reads a mesh of any format, which is recognized by its content; `-` is standard input.
///
/// The data of a glTF file may be in other files in the same folder or below it, and nowhere else.
///
/// # Errors
/// [`ReadMeshFileError`] with the path and the reason; [`ReadMeshError::Cancelled`] soon after `progress` is cancelled.
pub fn read_mesh_file(
    path: &Path,
    limits: &MeshLimits,
    progress: &Progress,
) -> Result<MeshFile, ReadMeshFileError> {
    let options = ReadOptions {
        limits: limits.clone(),
        ..ReadOptions::default()
    };
    read_mesh_file_with(path, options, progress).map(|(file, _)| file)
}

/// Reads a mesh as [`read_mesh_file`] does with all options, and returns the paths of the other files that were read for it.
/// The size in the options is replaced by that of the file.
///
/// # Errors
/// As [`read_mesh_file`].
pub fn read_mesh_file_with(
    path: &Path,
    mut options: ReadOptions,
    progress: &Progress,
) -> Result<(MeshFile, Vec<PathBuf>), ReadMeshFileError> {
    let companions = RefCell::new(Vec::new());
    let mut attempt = || -> Result<MeshFile, ReadMeshError> {
        progress.check()?;
        if is_stream(path) {
            return read_mesh(io::stdin().lock(), &options, progress);
        }
        let file = File::open(path)?;
        let metadata = file.metadata()?;
        options.size = metadata.is_file().then_some(metadata.len());
        let mut beside = |address: &str| {
            let (file, place) = open_beside(path, address)?;
            companions.borrow_mut().push(place);
            Ok(Box::new(file) as Box<dyn Read>)
        };
        read_mesh_with_buffers(file, &mut beside, &options, progress)
    };
    let file = attempt().map_err(|cause| ReadMeshFileError {
        path: path.to_path_buf(),
        cause,
    })?;
    Ok((file, companions.into_inner()))
}

/// An address out of a file as it can be shown: short, and with control characters escaped.
fn shown(address: &str) -> String {
    const MAX_CHARS: usize = 80;
    let escaped = address.chars().flat_map(|c| {
        let (plain, escaped) = if c.is_control() {
            (None, Some(c.escape_default()))
        } else {
            (Some(c), None)
        };
        plain.into_iter().chain(escaped.into_iter().flatten())
    });
    let mut shown: String = escaped.clone().take(MAX_CHARS).collect();
    if escaped.count() > MAX_CHARS {
        shown.push('…');
    }
    shown
}

/// Opens the file at a relative address that stands in the file `path`, if it is in the folder of that or below.
fn open_beside(path: &Path, address: &str) -> io::Result<(File, PathBuf)> {
    let shown = shown(address);
    let failed = |kind, what: &str| io::Error::new(kind, format!("its data file {shown} {what}"));
    let outside = || {
        let what = "is not in the folder of the file, and others are not read";
        failed(io::ErrorKind::PermissionDenied, what)
    };
    let below = |part: Component<'_>| matches!(part, Component::Normal(_) | Component::CurDir);
    if !Path::new(address).components().all(below) {
        return Err(outside());
    }
    let unreadable = |cause: io::Error| {
        let what = format!("cannot be read: {}", message_without_code(&cause));
        failed(cause.kind(), &what)
    };
    let folder = match path.parent() {
        Some(folder) if folder != Path::new("") => folder,
        _ => Path::new("."),
    };
    let folder = folder.canonicalize().map_err(unreadable)?;
    // links may lead elsewhere
    let place = folder.join(address).canonicalize().map_err(unreadable)?;
    if !place.starts_with(&folder) {
        return Err(outside());
    }
    let file = File::open(&place).map_err(unreadable)?;
    Ok((file, place))
}

/// Writes a mesh, whole or not at all; `-` is standard output.
///
/// # Errors
/// [`WriteMeshFileError`] with the path and the reason; [`WriteMeshError::Cancelled`] soon after `progress` is cancelled. An
/// old file of that name is then as it was. Of standard output a part may have been written.
pub fn write_mesh_file(
    path: &Path,
    mesh: &TriMesh,
    target: &MeshTarget,
    progress: &Progress,
) -> Result<(), WriteMeshFileError> {
    write_mesh_file_with(path, mesh, Attributes::default(), target, progress)
}

/// Writes a mesh as [`write_mesh_file`] does, with those of its attributes that the format holds.
///
/// # Errors
/// As [`write_mesh_file`].
pub fn write_mesh_file_with(
    path: &Path,
    mesh: &TriMesh,
    attributes: Attributes<'_>,
    target: &MeshTarget,
    progress: &Progress,
) -> Result<(), WriteMeshFileError> {
    let options = target.options();
    write_to(path, progress, |writer| {
        write_mesh_with(mesh, attributes, target.format, &options, writer, progress)
    })
}

/// Writes a mesh as [`write_mesh_file`] does, without ever holding all of it.
///
/// # Errors
/// As [`write_mesh_file`]; [`WriteMeshError::Io`] also if `mesh` cannot be read.
pub fn write_rows_file(
    path: &Path,
    mesh: &impl MeshRows,
    target: &MeshTarget,
    progress: &Progress,
) -> Result<(), WriteMeshFileError> {
    let options = target.options();
    write_to(path, progress, |writer| {
        write_rows(mesh, target.format, &options, writer, progress)
    })
}

/// Lets `write` write to a file that is whole or absent, or to standard output.
fn write_to(
    path: &Path,
    progress: &Progress,
    write: impl FnOnce(&mut dyn Write) -> Result<(), WriteMeshError>,
) -> Result<(), WriteMeshFileError> {
    let attempt = || {
        progress.check()?;
        if is_stream(path) {
            write(&mut io::stdout().lock())
        } else {
            write_atomically(path, |writer| write(writer))
        }
    };
    attempt().map_err(|cause| WriteMeshFileError {
        path: path.to_path_buf(),
        cause,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use ravec_scenes::solids::icosphere;

    const TRIANGLE: &str = r#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],
        "meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],
        "accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]}],
        "bufferViews":[{"buffer":0,"byteLength":36}],"buffers":[{"byteLength":36,"uri":"ADDRESS"}]}"#;

    fn put(path: &Path, bytes: &[u8]) {
        use std::io::Write as _;
        write_atomically(path, |writer| writer.write_all(bytes)).unwrap();
    }

    fn triangle_at(folder: &Path, address: &str) -> PathBuf {
        let path = folder.join("a.gltf");
        put(&path, TRIANGLE.replace("ADDRESS", address).as_bytes());
        path
    }

    fn corners() -> Vec<u8> {
        let corners = [0.0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
        corners.iter().flat_map(|x| x.to_le_bytes()).collect()
    }

    #[test]
    fn data_outside_the_folder_of_a_gltf_file_are_not_read() {
        let folder = tempfile::tempdir().unwrap();
        let inner = folder.path().join("inner");
        std::fs::create_dir(&inner).unwrap();
        let secret = folder.path().join("corners.bin");
        put(&secret, &corners());
        let mut addresses = vec!["../corners.bin".to_owned(), secret.display().to_string()];
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink(&secret, inner.join("link.bin")).unwrap();
            addresses.push("link.bin".to_owned());
        }
        let limits = MeshLimits::default();
        for address in addresses {
            let path = triangle_at(&inner, &address);
            let error = read_mesh_file(&path, &limits, &Progress::none()).unwrap_err();
            assert!(
                matches!(error.cause, ReadMeshError::Io(_)),
                "{address}: {error}"
            );
        }
        let path = triangle_at(&inner, "missing.bin");
        let error = read_mesh_file(&path, &limits, &Progress::none()).unwrap_err();
        let text = error.to_string();
        assert!(
            text.contains("missing.bin cannot be read: No such file or directory"),
            "{text}"
        );
    }

    #[test]
    fn an_address_is_shown_short_and_without_control_characters() {
        let folder = tempfile::tempdir().unwrap();
        let address = format!("%1b]0;x%07{}", "y".repeat(100));
        let path = triangle_at(folder.path(), &address);
        let error = read_mesh_file(&path, &MeshLimits::default(), &Progress::none()).unwrap_err();
        let text = error.to_string();
        assert!(text.contains("\\u{1b}]0;x\\u{7}yyy"), "{text}");
        assert!(
            !text.chars().any(char::is_control) && !text.contains(&"y".repeat(80)),
            "{text}"
        );
    }

    #[test]
    fn nothing_is_read_or_written_after_a_cancellation() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.off");
        let progress = Progress::none();
        let (mesh, target) = (icosphere(1.0, 2).mesh, MeshTarget::new(MeshFormat::Off));
        write_mesh_file(&path, &mesh, &target, &progress).unwrap();
        let before = std::fs::read(&path).unwrap();
        progress.cancel();
        let error = read_mesh_file(&path, &MeshLimits::default(), &progress).unwrap_err();
        assert!(matches!(error.cause, ReadMeshError::Cancelled));
        let none = TriMesh::default();
        let error = write_mesh_file(&path, &none, &target, &progress).unwrap_err();
        assert!(matches!(error.cause, WriteMeshError::Cancelled));
        assert_eq!(std::fs::read(&path).unwrap(), before);
    }

    #[test]
    fn standard_output_takes_the_format_of_the_input_and_odd_extensions_are_refused() {
        let off = MeshTarget::of(Path::new("-"), MeshFormat::Off).unwrap();
        assert_eq!(off.format, MeshFormat::Off);
        for name in ["a", "a.png", ".stl"] {
            let error = MeshTarget::of(Path::new(name), MeshFormat::Off).unwrap_err();
            assert!(
                error.to_string().contains(".stl, .ply, .obj"),
                "{name}: {error}"
            );
        }
    }

    #[test]
    fn files_that_are_read_one_after_the_other_share_the_memory_as_long_as_they_are_held() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.ply");
        let (mesh, progress) = (icosphere(1.0, 6).mesh, Progress::none());
        let target = MeshTarget::new(MeshFormat::PlyBinary);
        write_mesh_file(&path, &mesh, &target, &progress).unwrap();
        let limits = MeshLimits {
            memory: ravec_memory::MemoryBudget::new(6_000_000),
            ..MeshLimits::default()
        };
        let first = read_mesh_file(&path, &limits, &progress).unwrap();
        assert!(limits.memory.used() > 1_900_000);
        let _second = read_mesh_file(&path, &limits, &progress).unwrap();
        let error = read_mesh_file(&path, &limits, &progress).unwrap_err();
        assert!(
            matches!(error.cause, ReadMeshError::OverBudget(_)),
            "{error}"
        );
        drop(first);
        read_mesh_file(&path, &limits, &progress).unwrap();
    }
}

//! Mesh files by path: limits, streams, buffers beside glTF files, outputs that are whole or absent.

use crate::context::{Context, Intermediate};
use crate::error::JobError;
use crate::files::{IN_MEMORY, check_files, is_stream};
use crate::report::{FileReport, Report};
use ravec::mesh::{
    Attributes, LengthUnit, MeshFile, MeshFormat, MeshLimits, MeshRows, Precision, ReadMeshError,
    ReadOptions, TriMesh, WriteMeshError, WriteOptions, read_mesh, read_mesh_with_buffers,
    write_mesh_with, write_rows,
};
use ravec::progress::Progress;
use ravec_media::write_atomically;
use std::cell::RefCell;
use std::fs::File;
use std::io::{self, Read, Write};
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;

/// How a mesh file is to be written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MeshTarget {
    /// In which format.
    pub format: MeshFormat,
    /// How exactly.
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

    /// The format that the extension of `path` asks for; for standard output, which has none, that of the input.
    ///
    /// # Errors
    /// [`JobError::UnknownMeshFormat`] for any other extension.
    pub fn of(path: &Path, input: MeshFormat) -> Result<Self, JobError> {
        if is_stream(path) {
            return Ok(Self::new(input));
        }
        let extension = path.extension().and_then(|extension| extension.to_str());
        let format = extension.and_then(MeshFormat::from_extension);
        let unknown = || JobError::UnknownMeshFormat {
            path: path.to_path_buf(),
        };
        format.map(Self::new).ok_or_else(unknown)
    }
}

/// The extensions of the formats that are written, for a message.
pub(crate) fn known_extensions() -> String {
    let formats = [
        MeshFormat::StlBinary,
        MeshFormat::PlyBinary,
        MeshFormat::Obj,
        MeshFormat::Off,
        MeshFormat::ThreeMf,
        MeshFormat::Glb,
        MeshFormat::Gltf,
    ];
    formats
        .map(|format| format!(".{}", format.extension()))
        .join(", ")
}

/// Reads a mesh of any format, which is recognized by its content; `-` is standard input.
///
/// The data of a glTF file may be in other files in the same folder or below it, and nowhere else.
///
/// # Errors
/// [`JobError::ReadMesh`] with the path and what is wrong, [`JobError::Cancelled`] soon after `progress` is cancelled.
pub fn read_mesh_file(
    path: &Path,
    limits: &MeshLimits,
    progress: &Progress,
) -> Result<MeshFile, JobError> {
    let options = ReadOptions {
        limits: limits.clone(),
        ..ReadOptions::default()
    };
    read_with_companions(path, options, progress).map(|(file, _)| file)
}

/// Reads a mesh, and says which other files were read for it.
fn read_with_companions(
    path: &Path,
    mut options: ReadOptions,
    progress: &Progress,
) -> Result<(MeshFile, Vec<PathBuf>), JobError> {
    progress.check()?;
    let companions = RefCell::new(Vec::new());
    let mut attempt = || -> Result<MeshFile, ReadMeshError> {
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
    let file = attempt().map_err(|cause| JobError::from_reading(path, cause))?;
    Ok((file, companions.into_inner()))
}

/// An address out of a file as it can be shown: short, and with control characters escaped.
fn shown(address: &str) -> String {
    const MOST: usize = 80;
    let escaped = address.chars().flat_map(|c| {
        let (plain, escaped) = if c.is_control() {
            (None, Some(c.escape_default()))
        } else {
            (Some(c), None)
        };
        plain.into_iter().chain(escaped.into_iter().flatten())
    });
    let mut shown: String = escaped.clone().take(MOST).collect();
    if escaped.count() > MOST {
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
        let what = format!("cannot be read: {}", crate::error::plain(&cause));
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
/// [`JobError::WriteMesh`] with the path and what is wrong, [`JobError::Cancelled`] soon after `progress` is cancelled;
/// an old file of that name is then as it was. Of standard output a part may have been written.
pub fn write_mesh_file(
    path: &Path,
    mesh: &TriMesh,
    target: &MeshTarget,
    progress: &Progress,
) -> Result<(), JobError> {
    write_file(path, mesh, Attributes::default(), target, progress)
}

#[expect(
    clippy::trivially_copy_pass_by_ref,
    reason = "taken like in the public function"
)]
fn write_file(
    path: &Path,
    mesh: &TriMesh,
    attributes: Attributes<'_>,
    target: &MeshTarget,
    progress: &Progress,
) -> Result<(), JobError> {
    write_to(path, target, progress, |writer, options| {
        write_mesh_with(mesh, attributes, target.format, options, writer, progress)
    })
}

/// Lets `write` write to a file that is whole or absent, or to standard output.
#[expect(
    clippy::trivially_copy_pass_by_ref,
    reason = "taken like in the public function"
)]
fn write_to(
    path: &Path,
    target: &MeshTarget,
    progress: &Progress,
    write: impl FnOnce(&mut dyn Write, &WriteOptions) -> Result<(), WriteMeshError>,
) -> Result<(), JobError> {
    progress.check()?;
    let options = WriteOptions {
        precision: target.precision,
        unit: target.unit,
    };
    let written = if is_stream(path) {
        write(&mut io::stdout().lock(), &options)
    } else {
        write_atomically(path, |writer| write(writer, &options))
    };
    written.map_err(|cause| JobError::from_writing(path, cause))
}

/// Reads a mesh and records it. Files that were read along with it must not be among `outputs`.
pub(crate) fn read(
    path: &Path,
    outputs: &[&Path],
    report: &mut Report,
    context: &Context,
) -> Result<MeshFile, JobError> {
    read_recorded(path, outputs, ReadOptions::default(), report, context)
}

/// Reads a mesh as [`read`] does, with the colors of its vertices and with texture coordinates.
pub(super) fn read_with_attributes(
    path: &Path,
    outputs: &[&Path],
    report: &mut Report,
    context: &Context,
) -> Result<MeshFile, JobError> {
    let all = ReadOptions {
        colors: true,
        texture: true,
        ..ReadOptions::default()
    };
    read_recorded(path, outputs, all, report, context)
}

/// Takes from a file what `target` does not hold, and says so.
#[expect(
    clippy::trivially_copy_pass_by_ref,
    reason = "taken like in the public function"
)]
pub(super) fn keep_supported(
    file: &mut MeshFile,
    path: &Path,
    target: &MeshTarget,
    report: &mut Report,
) {
    use MeshFormat::{Glb, Gltf, Obj, PlyAscii, PlyBinary};
    let mut left_out = Vec::new();
    if !file.colors.is_empty() && !matches!(target.format, PlyBinary | PlyAscii) {
        file.colors = Vec::new();
        left_out.push("colors");
    }
    if !file.texture.is_empty() && !matches!(target.format, Obj | Glb | Gltf) {
        file.texture = Vec::new();
        left_out.push("texture coordinates");
    }
    for what in left_out {
        report.warn(format!("{}: left out {what}", path.display()));
    }
}

fn read_recorded(
    path: &Path,
    outputs: &[&Path],
    mut options: ReadOptions,
    report: &mut Report,
    context: &Context,
) -> Result<MeshFile, JobError> {
    if context.is_intermediate(path) {
        let mut file = context.stored_mesh(path)?;
        if !options.colors {
            file.colors = Vec::new();
        }
        if !options.texture {
            file.texture = Vec::new();
        }
        report.inputs.push(in_memory(path, file.unit, &file.mesh));
        return Ok(file);
    }
    tracing::info!("reading {}", path.display());
    options.limits = context.mesh_limits();
    let (file, companions) = report.time("read", || {
        read_with_companions(path, options, &context.progress)
    })?;
    let companions: Vec<_> = companions.iter().map(PathBuf::as_path).collect();
    check_files(&companions, outputs)?;
    for path in companions.into_iter().chain([path]) {
        report.protect(path);
    }
    for warning in &file.warnings {
        report.warn(format!("{}: {warning}", path.display()));
    }
    let described = described(path, file.format, file.unit, &file.mesh);
    report.inputs.push(described);
    Ok(file)
}

/// Writes a mesh, whole or not at all, or keeps it in memory, and records it.
#[expect(
    clippy::trivially_copy_pass_by_ref,
    reason = "taken like in the public function"
)]
pub(crate) fn write(
    path: &Path,
    mesh: &TriMesh,
    target: &MeshTarget,
    report: &mut Report,
    context: &Context,
) -> Result<(), JobError> {
    write_with(path, mesh, Attributes::default(), target, report, context)
}

/// Writes a mesh as [`write`] does, with those of its attributes that the format holds.
#[expect(
    clippy::trivially_copy_pass_by_ref,
    reason = "taken like in the public function"
)]
pub(super) fn write_with(
    path: &Path,
    mesh: &TriMesh,
    attributes: Attributes<'_>,
    target: &MeshTarget,
    report: &mut Report,
    context: &Context,
) -> Result<(), JobError> {
    if context.is_intermediate(path) {
        let mut file = MeshFile::from_mesh(mesh.clone(), target.format);
        file.unit = target.unit;
        file.colors = attributes.colors.to_vec();
        file.texture = attributes.texture.to_vec();
        store(path, file, report, context);
        return Ok(());
    }
    write_recorded(path, mesh, target, report, || {
        write_file(path, mesh, attributes, target, &context.progress)
    })
}

/// Writes a mesh as [`write`] does, wherever its rows are.
#[expect(
    clippy::trivially_copy_pass_by_ref,
    reason = "taken like in the public function"
)]
pub(super) fn write_stored(
    path: &Path,
    mesh: &impl MeshRows,
    target: &MeshTarget,
    report: &mut Report,
    context: &Context,
) -> Result<(), JobError> {
    if context.is_intermediate(path) {
        let failed = |cause| JobError::from_writing(path, cause);
        let mut file = MeshFile::from_mesh(collected(mesh).map_err(failed)?, target.format);
        file.unit = target.unit;
        store(path, file, report, context);
        return Ok(());
    }
    write_recorded(path, mesh, target, report, || {
        write_to(path, target, &context.progress, |writer, options| {
            write_rows(mesh, target.format, options, writer, &context.progress)
        })
    })
}

/// The rows of a mesh in memory.
fn collected(mesh: &impl MeshRows) -> Result<TriMesh, WriteMeshError> {
    let mut positions = Vec::with_capacity(mesh.vertex_count());
    mesh.for_each_vertex(&mut |position| {
        positions.push(position);
        Ok(())
    })?;
    let mut triangles = Vec::with_capacity(mesh.triangle_count());
    mesh.for_each_triangle(&mut |triangle, _| {
        triangles.push(triangle);
        Ok(())
    })?;
    TriMesh::new(positions, triangles).map_err(|error| io::Error::other(error).into())
}

/// Keeps a mesh in memory and records it.
fn store(path: &Path, file: MeshFile, report: &mut Report, context: &Context) {
    report.outputs.push(in_memory(path, file.unit, &file.mesh));
    context.store(path, Intermediate::Mesh(Arc::new(file)));
}

/// Writes a mesh by `write`, and records it.
#[expect(
    clippy::trivially_copy_pass_by_ref,
    reason = "taken like in the public function"
)]
fn write_recorded(
    path: &Path,
    mesh: &impl MeshRows,
    target: &MeshTarget,
    report: &mut Report,
    write: impl FnOnce() -> Result<(), JobError>,
) -> Result<(), JobError> {
    report.check_output(path)?;
    tracing::info!("writing {}", path.display());
    report.time("write", write)?;
    report.outputs.push(written(path, *target, mesh));
    Ok(())
}

/// Report entry of an intermediate result.
fn in_memory(path: &Path, unit: Option<LengthUnit>, mesh: &impl MeshRows) -> FileReport {
    FileReport {
        format: IN_MEMORY.to_owned(),
        ..described(path, MeshFormat::PlyBinary, unit, mesh)
    }
}

/// Report entry of a mesh that was written.
fn written(path: &Path, target: MeshTarget, mesh: &impl MeshRows) -> FileReport {
    let unit = match target.format {
        MeshFormat::ThreeMf => target.unit.or(Some(LengthUnit::Millimeter)),
        MeshFormat::Glb | MeshFormat::Gltf => Some(LengthUnit::Meter),
        _ => None,
    };
    described(path, target.format, unit, mesh)
}

fn described(
    path: &Path,
    format: MeshFormat,
    unit: Option<LengthUnit>,
    mesh: &impl MeshRows,
) -> FileReport {
    FileReport {
        path: path.display().to_string(),
        format: format.to_string(),
        vertices: Some(mesh.vertex_count() as u64),
        triangles: Some(mesh.triangle_count() as u64),
        unit: unit.map(LengthUnit::name),
        ..FileReport::default()
    }
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
    fn a_mesh_that_is_written_and_read_leaves_its_trace_in_the_report() {
        let folder = tempfile::tempdir().unwrap();
        let mesh = icosphere(1.0, 1).mesh;
        let (mut report, context) = (Report::new("test", &()), Context::default());
        for (name, format, unit) in [
            ("a.stl", "binary STL", None),
            ("a.ply", "binary PLY", None),
            ("a.obj", "OBJ", None),
            ("a.off", "OFF", None),
            ("a.3mf", "3MF", Some("inch")),
            ("a.glb", "GLB", Some("meter")),
            ("a.gltf", "glTF", Some("meter")),
        ] {
            let path = folder.path().join(name);
            let mut target = MeshTarget::of(&path, MeshFormat::Off).unwrap();
            target.unit = Some(LengthUnit::Inch);
            write(&path, &mesh, &target, &mut report, &progress).unwrap();
            let again = read(&MeshSource::new(&path), &[], &mut report, &progress).unwrap();
            assert_eq!(again.mesh.triangles().len(), 80);
            let (written, read) = (report.outputs.last(), report.inputs.last());
            assert_eq!(written, read);
            let read = read.unwrap();
            assert_eq!(read.format, format);
            assert_eq!((read.vertices, read.triangles), (Some(42), Some(80)));
            assert_eq!(read.unit, unit, "{name}");
        }
    }

    #[test]
    fn standard_output_takes_the_format_of_the_input_and_odd_extensions_are_refused() {
        let off = MeshTarget::of(Path::new("-"), MeshFormat::Off).unwrap();
        assert_eq!(off.format, MeshFormat::Off);
        for name in ["a", "a.png", ".stl"] {
            let error = MeshTarget::of(Path::new(name), MeshFormat::Off).unwrap_err();
            assert_eq!(error.exit_code(), 2, "{name}");
        }
    }

    #[test]
    fn data_beside_a_gltf_file_are_read_and_never_written_over() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("data")).unwrap();
        let data = folder.path().join("data/corners.bin");
        put(&data, &corners());
        let source = MeshSource::new(triangle_at(folder.path(), "data/corners.bin"));
        let (mut report, context) = (Report::new("test", &()), Context::default());
        let file = read(&source, &[], &mut report, &progress).unwrap();
        assert_eq!(file.mesh.triangles().len(), 1);
        let error = read(&source, &[&data], &mut report, &progress).unwrap_err();
        assert!(matches!(error, JobError::OverwritesInput { .. }), "{error}");
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
            assert_eq!(error.exit_code(), 3, "{address}: {error}");
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
    fn files_that_are_read_one_after_the_other_share_the_memory_as_long_as_they_are_held() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.ply");
        let (mesh, progress) = (icosphere(1.0, 6).mesh, Progress::none());
        let target = MeshTarget::new(MeshFormat::PlyBinary);
        write_mesh_file(&path, &mesh, &target, &progress).unwrap();
        let limits = MeshLimits {
            memory: ravec::memory::MemoryBudget::new(6_000_000),
            ..MeshLimits::default()
        };
        let first = read_mesh_file(&path, &limits, &progress).unwrap();
        assert!(limits.memory.used() > 1_900_000);
        let _second = read_mesh_file(&path, &limits, &progress).unwrap();
        let error = read_mesh_file(&path, &limits, &progress).unwrap_err();
        assert!(error.to_string().contains("--max-bytes"), "{error}");
        assert_eq!(error.exit_code(), 3);
        drop(first);
        read_mesh_file(&path, &limits, &progress).unwrap();
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
        let error = read_mesh_file(&path, &MeshLimits::default(), &progress);
        assert!(matches!(error, Err(JobError::Cancelled)));
        let none = TriMesh::default();
        let error = write_mesh_file(&path, &none, &target, &progress);
        assert!(matches!(error, Err(JobError::Cancelled)));
        assert_eq!(std::fs::read(&path).unwrap(), before);
    }
}

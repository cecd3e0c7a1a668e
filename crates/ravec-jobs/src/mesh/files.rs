//! Mesh files of operations: each leaves its trace in the report.

use super::negative;
use crate::context::{Context, Intermediate};
use crate::error::JobError;
use crate::files::{IN_MEMORY, check_files};
use crate::report::{FileReport, Report};
use ravec::mesh::{MeshRows, TriMesh};
use ravec::mesh_io::{
    Attributes, LengthUnit, MeshFile, MeshFormat, MeshTarget, ReadOptions, ReadWarning,
    WriteMeshError, WriteMeshFileError, read_mesh_file_with, write_mesh_file_with, write_rows_file,
};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

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
    let mut left_out = Vec::new();
    if !file.colors.is_empty() && !target.format.holds_colors() {
        file.colors = Vec::new();
        left_out.push("colors");
    }
    if !file.texture.is_empty() && !target.format.holds_texture() {
        file.texture = Vec::new();
        left_out.push("texture coordinates");
    }
    for what in left_out {
        report.record_dropped(format!("{}: left out {what}", path.display()));
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
    let (mut file, companions) = report.time("read", || {
        read_mesh_file_with(path, options, &context.progress)
    })?;
    let companions: Vec<_> = companions.iter().map(PathBuf::as_path).collect();
    check_files(&companions, outputs)?;
    for path in companions.into_iter().chain([path]) {
        report.protect(path);
    }
    for warning in &file.warnings {
        let sentence = format!("{}: {warning}", path.display());
        match warning {
            ReadWarning::PolygonsCut { .. } | ReadWarning::Welded { .. } => {
                report.record_changed(sentence);
            }
            ReadWarning::NegativeVolumes { .. } => {
                report.record_changed(format!("{sentence}; they were subtracted"));
            }
            ReadWarning::NoEnd
            | ReadWarning::OtherCount { .. }
            | ReadWarning::UnreadableSettings => report.record_assumed(sentence),
            _ => report.record_dropped(sentence),
        }
    }
    let described = described(path, file.format, file.unit, &file.mesh);
    report.inputs.push(described);
    negative::subtract(&mut file, path, report, &context.progress)?;
    Ok(file)
}

/// Advice of operations whose coordinates stay in the unit of their input.
pub(super) const CONVERT_FIRST: &str = "mesh convert to millimeters before avoids that";

/// Records that the unit of `input`, other than the millimeter, is lost in a file of a format that names none.
#[expect(
    clippy::trivially_copy_pass_by_ref,
    reason = "taken as when it is written"
)]
pub(super) fn record_unit_loss(
    input: &Path,
    output: &Path,
    target: &MeshTarget,
    cure: &str,
    report: &mut Report,
    context: &Context,
) {
    let keeps = matches!(
        target.format,
        MeshFormat::ThreeMf | MeshFormat::Glb | MeshFormat::Gltf
    );
    let unit = target.unit.filter(|&unit| unit != LengthUnit::Millimeter);
    if let Some(unit) = unit
        && !keeps
        && !context.is_intermediate(output)
    {
        report.record_dropped(format!(
            "{} is in units of one {unit}: the numbers stay, but {} names no unit, and most programs take the numbers for millimeters; {cure}",
            input.display(),
            target.format
        ));
    }
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
        file.objects = attributes.objects.to_vec();
        store(path, file, report, context);
        return Ok(());
    }
    write_recorded(path, mesh, target, report, || {
        write_mesh_file_with(path, mesh, attributes, target, &context.progress)
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
        let failed = |cause| WriteMeshFileError {
            path: path.to_path_buf(),
            cause,
        };
        let mut file = MeshFile::from_mesh(collected(mesh).map_err(failed)?, target.format);
        file.unit = target.unit;
        store(path, file, report, context);
        return Ok(());
    }
    write_recorded(path, mesh, target, report, || {
        write_rows_file(path, mesh, target, &context.progress)
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
    write: impl FnOnce() -> Result<(), WriteMeshFileError>,
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
    use ravec_files::write_atomically;
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
            write(&path, &mesh, &target, &mut report, &context).unwrap();
            let again = read(&path, &[], &mut report, &context).unwrap();
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
    fn data_beside_a_gltf_file_are_read_and_never_written_over() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("data")).unwrap();
        let data = folder.path().join("data/corners.bin");
        put(&data, &corners());
        let source = triangle_at(folder.path(), "data/corners.bin");
        let (mut report, context) = (Report::new("test", &()), Context::default());
        let file = read(&source, &[], &mut report, &context).unwrap();
        assert_eq!(file.mesh.triangles().len(), 1);
        let error = read(&source, &[&data], &mut report, &context).unwrap_err();
        assert!(matches!(error, JobError::OverwritesInput { .. }), "{error}");
    }
}

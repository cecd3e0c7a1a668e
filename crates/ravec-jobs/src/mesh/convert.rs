//! `mesh convert`: a mesh in another format, unit or precision.

use super::as_read::as_read;
use super::files::record_unit_loss;
use super::judge::judge_written;
use super::{Length, MeshTarget, weld};
use crate::context::Context;
use crate::error::JobError;
use crate::files::is_stream;
use crate::operation::Operation;
use crate::report::Report;
use ravec::mesh::TriMesh;
use ravec::mesh_io::{Attributes, LengthUnit, MeshFile, MeshFormat, Precision, UnitRatio};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Format and precision of an output.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct Output {
    /// Format of the output [default: what its extension says; for standard output that of the input]
    #[cfg_attr(feature = "cli", arg(long, value_enum, value_name = "FORMAT"))]
    pub format: Option<MeshFormat>,
    /// Write STL and PLY as text; OBJ, OFF and glTF are text anyway
    #[cfg_attr(feature = "cli", arg(long))]
    pub ascii: bool,
    /// Precision of coordinates
    #[cfg_attr(feature = "cli", arg(long, value_enum, value_name = "PRECISION", default_value_t = Precision::default()))]
    pub precision: Precision,
}

/// Start of a run that converts one file into another.
pub(super) struct Start {
    /// With the input in it.
    pub report: Report,
    /// Input as read.
    pub file: MeshFile,
    /// Output, in the unit of the input.
    pub target: MeshTarget,
}

/// Parts of a file that are read and written again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Content {
    /// Triangles alone.
    Shape,
    /// Triangles, colors and texture coordinates, where the format of the output has them.
    ShapeAndAttributes,
}

impl Output {
    /// Checks the paths, reads the input and finds out how to write; whatever can be refused is refused before it is read.
    pub(super) fn start(
        &self,
        mut report: Report,
        input: &Path,
        output: &Path,
        content: Content,
        context: &Context,
    ) -> Result<Start, JobError> {
        self.check(output, context)?;
        context.check_files(&[input], &[output])?;
        let read = match content {
            Content::Shape => super::read,
            Content::ShapeAndAttributes => super::read_with_attributes,
        };
        let mut file = read(input, &[output], &mut report, context)?;
        let mut target = self.target(output, file.format, context)?;
        if !context.is_intermediate(output) {
            super::keep_supported(&mut file, input, &target, &mut report);
        }
        let objects = file.objects.len();
        if content == Content::Shape && target.format == MeshFormat::ThreeMf && objects > 1 {
            report.record_dropped(format!(
                "{}: its {objects} objects become one, without their names",
                input.display()
            ));
        }
        target.unit = file.unit;
        Ok(Start {
            report,
            file,
            target,
        })
    }

    /// Refuses what can be refused before the input is read.
    pub(super) fn check(&self, path: &Path, context: &Context) -> Result<(), JobError> {
        if !is_stream(path) || self.format.is_some() {
            self.target(path, MeshFormat::Off, context)?;
        }
        Ok(())
    }

    /// Target for `path`, once the format of the input is known.
    pub(super) fn target(
        &self,
        path: &Path,
        input: MeshFormat,
        context: &Context,
    ) -> Result<MeshTarget, JobError> {
        let mut target = match self.format {
            Some(format) => MeshTarget::new(format),
            // holds all coordinates and attributes as they are
            None if context.is_intermediate(path) => MeshTarget::new(MeshFormat::PlyBinary),
            None => MeshTarget::of(path, input)?,
        };
        if self.ascii {
            target.format = match target.format {
                MeshFormat::StlBinary | MeshFormat::StlAscii => MeshFormat::StlAscii,
                MeshFormat::PlyBinary | MeshFormat::PlyAscii => MeshFormat::PlyAscii,
                text @ (MeshFormat::Obj | MeshFormat::Off | MeshFormat::Gltf) => text,
                other => {
                    return Err(JobError::Parameter {
                        field: "ascii",
                        value: format!("given for {other}"),
                        range: "left out: this format has no text form (STL, PLY, OBJ, OFF and glTF have)",
                    });
                }
            };
        }
        target.precision = self.precision;
        Ok(target)
    }
}

/// Write a mesh in another format, unit or precision
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args), command(after_help = HELP))]
pub struct Convert {
    /// Input mesh; `-` is standard input
    pub input: PathBuf,
    /// Output mesh; its extension selects the format, `-` is standard output in the input's format
    #[cfg_attr(feature = "cli", arg(short, long, value_name = "FILE"))]
    pub output: PathBuf,
    /// Parameters.
    #[cfg_attr(feature = "cli", command(flatten))]
    #[serde(default)]
    pub params: Params,
}

#[cfg(feature = "cli")]
const HELP: &str = "\
Examples:
  ravec mesh convert part.stl -o part.ply
  ravec mesh convert part.stl -o part.3mf --from-unit inch --unit millimeter
  ravec mesh convert part.stl -o text.stl --ascii --precision single
  ravec mesh convert sheet.obj -o welded.off --weld 0.001%
  ravec mesh convert - -o - --format obj <part.stl >part.obj

Colors of the vertices of PLY files and texture coordinates of OBJ and glTF files go along where the output has room for them, unless \
vertices are welded.

A unit other than the millimeter that STL, PLY, OBJ and OFF cannot name stays that of the numbers, and a warning says so; --unit millimeter \
converts them. Units are converted exactly: an inch is 25.4 mm.

Figures: scale of the coordinates, if units differ; largest_rounding of a coordinate, if the output holds 32-bit floats; \
welded_vertices and collapsed_triangles, with --weld. If rounding, or STL, which joins vertices at equal places, makes \
a solid none, a warning says so, and the exit code is 5.";

/// Parameters of [`Convert`].
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct Params {
    /// Format of the output.
    #[cfg_attr(feature = "cli", command(flatten))]
    pub output: Output,
    /// Make vertices one that are no farther apart than this, a length or as in 0.01%; 0 welds equal places
    ///
    /// Triangles that lose a corner thereby are dropped. Vertices of STL files at equal places are always welded.
    #[cfg_attr(feature = "cli", arg(long, value_name = "LENGTH"))]
    pub weld: Option<Length>,
    /// Unit of the coordinates to write; those of an input with a known unit (3MF, glTF, --from-unit) are scaled to it
    #[cfg_attr(feature = "cli", arg(long, value_enum, value_name = "UNIT"))]
    pub unit: Option<LengthUnit>,
    /// Unit of the input's coordinates, whatever the file says
    #[cfg_attr(feature = "cli", arg(long, value_enum, value_name = "UNIT"))]
    pub from_unit: Option<LengthUnit>,
}

impl Operation for Convert {
    const NAME: &'static str = "mesh convert";

    fn inputs(&self) -> Vec<&Path> {
        vec![&self.input]
    }

    fn outputs(&self) -> Vec<&Path> {
        vec![&self.output]
    }

    /// Writes the mesh with the colors of the vertices of a PLY file and the texture coordinates of an OBJ or glTF
    /// file if the output has room for them and nothing is welded.
    ///
    /// Figures: `scale` of the coordinates if units differ; `largest_rounding` of a coordinate, if the output holds 32-bit
    /// floats; `welded_vertices` and `collapsed_triangles` if welding was asked for. If the format changes the mesh, the
    /// [`Verdict`](crate::Verdict) is about the file; a solid that is none there has not passed.
    ///
    /// # Errors
    /// [`JobError::Parameter`], [`JobError::UnknownMeshFormat`], [`JobError::ReadMesh`], [`JobError::WriteMesh`], what
    /// [`check_files`](crate::check_files) refuses, [`JobError::Cancelled`].
    fn run(&self, context: &Context) -> Result<Report, JobError> {
        let Self {
            input,
            output,
            params,
        } = self;
        let progress = &context.progress;
        weld::check(params.weld)?;
        // welding merges vertices of several colors
        let content = match params.weld {
            None => Content::ShapeAndAttributes,
            Some(_) => Content::Shape,
        };
        let report = Report::of(self, params);
        let start = params
            .output
            .start(report, input, output, content, context)?;
        let Start {
            mut report,
            file,
            mut target,
        } = start;
        let from = params.from_unit.or(file.unit);
        target.unit = params.unit.or(from);
        let MeshFile {
            mesh,
            colors,
            texture,
            objects,
            ..
        } = file;
        let mesh = weld::welded(mesh, params.weld, from, &mut report, progress)?;
        progress.check()?;
        let mesh = match (from, target.unit) {
            (Some(from), Some(to)) if from != to => {
                let scale = from.per(to);
                report.figures.insert("scale", scale.factor());
                scaled(mesh, scale, input)?
            }
            _ => mesh,
        };
        if rounds(&target) {
            report
                .figures
                .insert("largest_rounding", largest_rounding(&mesh, target));
        }
        if params.unit.is_none() {
            let cure = "`unit` millimeter converts them";
            record_unit_loss(input, output, &target, cure, &mut report, context);
        }
        // a file that holds the mesh as it is needs no verdict
        if as_read(&mesh, target, progress)?.is_some_and(|read| read != mesh) {
            judge_written(&mesh, &mesh, target, &mut report, progress)?;
        }
        let attributes = Attributes {
            colors: &colors,
            texture: &texture,
            objects: if params.weld.is_none() { &objects } else { &[] },
        };
        super::write_with(output, &mesh, attributes, &target, &mut report, context)?;
        Ok(report)
    }
}

pub(super) fn scaled(mesh: TriMesh, scale: UnitRatio, path: &Path) -> Result<TriMesh, JobError> {
    let (mut positions, triangles) = mesh.into_parts();
    for position in &mut positions {
        *position = position.map(|x| scale.apply(x));
    }
    TriMesh::new(positions, triangles).map_err(|_| JobError::Parameter {
        field: "unit",
        value: format!(
            "{} times smaller than that of {}",
            scale.factor(),
            path.display()
        ),
        range: "large enough for coordinates to stay finite",
    })
}

/// True if coordinates become 32-bit floats.
#[expect(
    clippy::trivially_copy_pass_by_ref,
    reason = "taken as when it is written"
)]
pub(super) fn rounds(target: &MeshTarget) -> bool {
    target.precision == Precision::Single
        || matches!(
            target.format,
            MeshFormat::StlBinary | MeshFormat::Glb | MeshFormat::Gltf
        )
}

/// Scale of coordinates in the output to meters, where the format is glTF and the unit is known.
pub(super) fn scale_to_meters(target: MeshTarget) -> Option<UnitRatio> {
    match target.format {
        MeshFormat::Glb | MeshFormat::Gltf => target.unit.map(|unit| unit.per(LengthUnit::Meter)),
        _ => None,
    }
}

/// Factor by which readers of the output multiply its coordinates: glTF is in meters.
pub(super) fn unit_scale(target: MeshTarget) -> f64 {
    scale_to_meters(target).map_or(1.0, UnitRatio::factor)
}

/// Largest change of a coordinate.
fn largest_rounding(mesh: &TriMesh, target: MeshTarget) -> f64 {
    let scale = unit_scale(target);
    let positions = mesh.positions().iter();
    positions
        .flat_map(glam::DVec3::to_array)
        .map(|x| ((f64::from((x * scale) as f32)) / scale - x).abs())
        .fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ErrorKind;
    use crate::mesh::{read_mesh_file, write_mesh_file};
    use ravec::mesh_io::MeshLimits;
    use ravec::progress::Progress;
    use ravec_scenes::solids::cuboid;
    use std::io::Write as _;

    fn converted(from: &str, to: &str, params: &Params) -> (TriMesh, Report) {
        let folder = tempfile::tempdir().unwrap();
        let (input, output) = (folder.path().join(from), folder.path().join(to));
        let mut target = MeshTarget::of(&input, MeshFormat::Off).unwrap();
        target.unit = Some(LengthUnit::Inch);
        let (mesh, progress) = (cuboid([1.0, 2.0, 3.0].into()).mesh, Progress::none());
        write_mesh_file(&input, &mesh, &target, &progress).unwrap();
        let report = run(&input, &output, params).unwrap();
        let file = read_mesh_file(&output, &MeshLimits::default(), &progress).unwrap();
        (file.mesh, report)
    }

    fn width(mesh: &TriMesh) -> f64 {
        mesh.bounds().size().x
    }

    fn run(input: &Path, output: &Path, params: &Params) -> Result<Report, JobError> {
        let operation = Convert {
            input: input.to_path_buf(),
            output: output.to_path_buf(),
            params: params.clone(),
        };
        operation.run(&Context::default())
    }

    #[test]
    fn a_solid_that_rounding_or_stl_makes_none_has_not_passed() {
        // two cubes with a common edge, each with vertices of its own
        let one = cuboid([1.0; 3].into()).mesh;
        let other = cuboid([1.0; 3].into()).shifted([1.0, 1.0, 0.0].into()).mesh;
        let mut positions = one.positions().to_vec();
        positions.extend_from_slice(other.positions());
        let mut triangles = one.triangles().to_vec();
        triangles.extend(other.triangles().iter().map(|t| t.map(|v| v + 8)));
        let pair = TriMesh::new(positions, triangles).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let (target, progress) = (MeshTarget::new(MeshFormat::PlyBinary), Progress::none());
        write_mesh_file(&at("pair.ply"), &pair, &target, &progress).unwrap();
        for (out, passed) in [("a.off", None), ("a.glb", None), ("a.stl", Some(false))] {
            let report = run(&at("pair.ply"), &at(out), &Params::default()).unwrap();
            assert_eq!(report.passed, passed, "{out}");
            assert_eq!(report.verdict.solid, passed);
            assert_eq!(report.warnings.len(), usize::from(passed.is_some()));
        }
        // a film that 32-bit floats cannot hold
        let film = cuboid([1.0, 1.0, 1e-9].into())
            .shifted([5.0; 3].into())
            .mesh;
        write_mesh_file(&at("film.ply"), &film, &target, &progress).unwrap();
        let report = run(&at("film.ply"), &at("a.glb"), &Params::default()).unwrap();
        assert_eq!(
            (report.passed, report.verdict.solid),
            (Some(false), Some(false))
        );
    }

    #[test]
    fn known_units_are_kept_and_scaled_to_others() {
        // from inches
        let (mesh, report) = converted("a.3mf", "b.3mf", &Params::default());
        assert_eq!(width(&mesh), 1.0);
        assert_eq!(report.outputs[0].unit, Some("inch"));
        assert!(!report.figures.contains_key("scale"));
        let millimeters = Params {
            unit: Some(LengthUnit::Millimeter),
            ..Params::default()
        };
        let (mesh, report) = converted("a.3mf", "b.off", &millimeters);
        assert!((width(&mesh) - 25.4).abs() < 1e-12);
        assert!((report.figures["scale"] - 25.4).abs() < 1e-12);
        // glTF is in meters
        let (mesh, _) = converted("a.3mf", "b.glb", &Params::default());
        assert!((width(&mesh) - 0.0254).abs() < 1e-8);
        // a file that says nothing is as it is
        let (mesh, report) = converted("a.off", "b.3mf", &millimeters);
        assert_eq!(width(&mesh), 1.0);
        assert_eq!(report.outputs[0].unit, Some("millimeter"));
        let from = Params {
            from_unit: Some(LengthUnit::Centimeter),
            ..millimeters
        };
        let (mesh, _) = converted("a.off", "b.off", &from);
        assert!((width(&mesh) - 10.0).abs() < 1e-12);
    }

    #[test]
    fn rounding_is_measured_where_there_is_some() {
        let single = Params {
            output: Output {
                precision: Precision::Single,
                ..Output::default()
            },
            from_unit: Some(LengthUnit::Inch),
            unit: Some(LengthUnit::Foot),
            ..Params::default()
        };
        let (_, report) = converted("a.off", "b.ply", &single);
        let rounding = report.figures["largest_rounding"];
        // half a unit in the last place of a twenty-fourth to an eighth
        assert!(rounding > 0.0 && rounding < 4e-9, "{rounding}");
        let (_, report) = converted("a.off", "b.ply", &Params::default());
        assert!(!report.figures.contains_key("largest_rounding"));
    }

    /// The names on the command line, which must be those in data.
    #[cfg(feature = "cli")]
    fn spelled<T: clap::ValueEnum + Serialize>() -> Vec<String> {
        let named = |value: &T| {
            let value = value.to_possible_value().unwrap();
            value.get_name().to_owned()
        };
        let names: Vec<_> = T::value_variants().iter().map(named).collect();
        let data: Vec<_> = T::value_variants()
            .iter()
            .map(|value| serde_json::json!(value))
            .collect();
        assert_eq!(serde_json::json!(names), serde_json::json!(data));
        names
    }

    #[test]
    #[cfg(feature = "cli")]
    fn choices_are_spelled_alike_in_data_and_on_the_command_line() {
        assert_eq!(
            spelled::<MeshFormat>(),
            [
                "stl",
                "stl-ascii",
                "ply",
                "ply-ascii",
                "obj",
                "off",
                "3mf",
                "glb",
                "gltf"
            ]
        );
        assert_eq!(
            spelled::<LengthUnit>(),
            [
                "micron",
                "millimeter",
                "centimeter",
                "inch",
                "foot",
                "meter"
            ]
        );
        assert_eq!(spelled::<Precision>(), ["exact", "single"]);
        assert_eq!(spelled::<ravec::mesh_render::UpAxis>(), ["y", "z"]);
        assert_eq!(
            spelled::<ravec::boolean::Inside>(),
            ["positive", "nonzero", "outer-hull"]
        );
        assert_eq!(
            spelled::<ravec::boolean::CloseRule>(),
            ["auto", "lid", "band", "base"]
        );
        assert_eq!(
            spelled::<ravec::boolean::OpenRule>(),
            ["auto", "trim", "close"]
        );
        assert_eq!(
            spelled::<ravec::offset::Side>(),
            ["both", "outer", "inner", "shell"]
        );
        assert_eq!(spelled::<ravec::offset::OpenRule>(), ["refuse", "thicken"]);
        assert_eq!(
            spelled::<ravec::retarget::Borders>(),
            ["slide", "symmetric", "free"]
        );
        assert_eq!(spelled::<ravec::mosaic::Crop>(), ["never", "center"]);
        for (alias, unit) in [("um", LengthUnit::Micron), ("in", LengthUnit::Inch)] {
            let parsed: Result<LengthUnit, _> = clap::ValueEnum::from_str(alias, false);
            assert_eq!(parsed, Ok(unit));
        }
    }

    #[test]
    fn text_forms_are_written_where_there_are_any() {
        let ascii = Params {
            output: Output {
                ascii: true,
                ..Output::default()
            },
            ..Params::default()
        };
        for (name, format) in [
            ("b.stl", "ASCII STL"),
            ("b.ply", "ASCII PLY"),
            ("b.obj", "OBJ"),
        ] {
            let (_, report) = converted("a.off", name, &ascii);
            assert_eq!(report.outputs[0].format, format);
        }
        for name in ["b.3mf", "b.glb"] {
            let error = ascii
                .output
                .check(Path::new(name), &Context::default())
                .unwrap_err();
            assert_eq!(error.kind(), ErrorKind::Request, "{error}");
        }
    }

    #[test]
    fn colors_and_texture_coordinates_go_along_where_there_is_room() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0.5 0.25\nvt 1 0\nf 1/1 2/2 3/1\n";
        ravec_files::write_atomically(&at("a.obj"), |file| file.write_all(text.as_bytes()))
            .unwrap();
        let convert =
            |from: &str, to: &str, params: &Params| run(&at(from), &at(to), params).unwrap();
        let params = Params::default();
        for (from, to) in [("a.obj", "b.glb"), ("b.glb", "c.gltf"), ("c.gltf", "d.obj")] {
            let report = convert(from, to, &params);
            // OBJ cannot say that the numbers are meters
            assert_eq!(report.warnings.len(), usize::from(to == "d.obj"), "{to}");
            assert!(
                report
                    .warnings
                    .iter()
                    .all(|told| told.contains("names no unit"))
            );
        }
        let told = std::fs::read_to_string(at("d.obj")).unwrap();
        assert!(told.contains("vt 0.5 0.25\nvt 1.0 0.0\n"), "{told}");
        let welded = Params {
            weld: Some("0".parse().unwrap()),
            ..Params::default()
        };
        for report in [
            convert("a.obj", "e.obj", &welded),
            convert("a.obj", "e.ply", &params),
        ] {
            let told = report.warnings.join("\n");
            assert!(told.contains("left out texture coordinates"), "{told}");
        }
    }
}

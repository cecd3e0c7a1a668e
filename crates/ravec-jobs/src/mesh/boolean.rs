//! `boolean`: meshes combined by an expression, exact where they meet.

mod attributes;
mod named;
mod origins;
mod picture;
mod showcase;

use super::convert::{Output, Unit, rounds, scaled};
use super::rounded::rounded;
use super::{MeshSource, MeshTarget, Viewpoint};
use crate::error::JobError;
use crate::files::{check_files, check_target};
use crate::report::{Finding, Report};
use bytesize::ByteSize;
use glam::DVec2;
use ravec::boolean as library;
use ravec::boolean::{BooleanError, BooleanReport, Expr, ParseExprError};
use ravec::mesh::render::View;
use ravec::mesh::{Attributes, LengthUnit, MeshFile, MeshFormat, MeshLimits, TriMesh};
use ravec::progress::Progress;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

pub use named::NamedFile;
pub(crate) use showcase::show;

/// Which places a mesh stands for.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
pub enum Inside {
    /// Those with a winding number above one half: where it is closed, those that it goes around counterclockwise
    #[default]
    Positive,
    /// Those that it goes around in either direction, for meshes with parts that are inside out
    Nonzero,
    /// Those that cannot be reached from outside: cavities are filled, directions do not matter
    OuterHull,
}

impl From<Inside> for library::Inside {
    fn from(inside: Inside) -> Self {
        match inside {
            Inside::Positive => Self::Positive,
            Inside::Nonzero => Self::Nonzero,
            Inside::OuterHull => Self::OuterHull,
        }
    }
}

/// Parameters of a Boolean operation and of its output.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
pub struct Params {
    /// Which places each mesh stands for
    #[cfg_attr(feature = "cli", arg(long, value_enum, value_name = "RULE", default_value_t = Params::default().inside))]
    pub inside: Inside,
    /// The most memory to work in, such as 2GiB [default: as much as it takes]
    #[cfg_attr(feature = "cli", arg(long, value_name = "SIZE"))]
    pub memory: Option<ByteSize>,
    /// Unit of all inputs' coordinates, whatever the files say; most formats say nothing
    #[cfg_attr(feature = "cli", arg(long, value_enum, value_name = "UNIT"))]
    pub unit: Option<Unit>,
    /// Where --picture looks from: front, right, back, left, top, bottom, iso, or degrees around and up, as in 30,20
    #[cfg_attr(feature = "cli", arg(long, value_name = "VIEW", allow_hyphen_values = true, default_value_t = Params::default().view))]
    pub view: Viewpoint,
    /// How the mesh is written.
    #[cfg_attr(feature = "cli", command(flatten))]
    pub output: Output,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            inside: Inside::default(),
            memory: None,
            unit: None,
            view: Viewpoint(View::ISO),
            output: Output::default(),
        }
    }
}

/// The files to write.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Targets {
    /// Input mesh; `-` is standard output.
    pub mesh: PathBuf,
    /// Where each triangle comes from, as JSON or as CSV.
    pub origins: Option<PathBuf>,
    /// A picture with whole triangles, pieces and seams in different colors.
    pub picture: Option<PathBuf>,
}

impl Targets {
    /// The paths of all of them.
    fn paths(&self) -> Vec<&Path> {
        let more = [&self.origins, &self.picture];
        let more = more.into_iter().filter_map(Option::as_deref);
        std::iter::once(self.mesh.as_path()).chain(more).collect()
    }
}

/// Puts an operator over expressions.
type Operator = fn(Vec<Expr>) -> Expr;

/// The words that stand for an operator over all meshes.
const SHORTHANDS: [(&str, Operator); 4] = [
    ("union", Expr::Union),
    ("intersection", Expr::Intersection),
    ("difference", Expr::Difference),
    ("symmetric-difference", Expr::SymmetricDifference),
];

/// The expression over meshes with these names. A shorthand stands for an operator over all of them, unless one has its name.
fn parsed(text: &str, names: &[String]) -> Result<Expr, JobError> {
    let word = text.trim();
    let shorthand = SHORTHANDS.iter().find(|(known, _)| *known == word);
    if let Some((_, operator)) = shorthand
        && !names.iter().any(|name| name == word)
    {
        return Ok(operator((0..names.len()).map(Expr::Mesh).collect()));
    }
    Expr::parse_with(text, names).map_err(|cause: ParseExprError| JobError::Expression {
        caret: cause.caret(text),
        cause,
    })
}

/// Writes what `expression` says is inside, over the meshes in `files`.
///
/// `expression` is one as [`Expr::parse`] reads it, or one of the words `union`, `intersection`, `difference` (the first without
/// all others) and `symmetric-difference`, over all files in their order. Files without a name are called a, b, c and so on. A
/// file that the expression does not name is not read; a warning says so.
///
/// Where files name different units, meshes are scaled to that of the first. Colors of the vertices of PLY files follow into a
/// PLY file: between the corners of a triangle they are mixed, and vertices where meshes meet take that of one of them. Texture
/// coordinates of OBJ and glTF files follow into one of these: each piece of a triangle shows what was there.
///
/// [`Report::passed`] says whether the result is closed, manifold and free of self-intersections; an empty one is. If not, it is
/// written all the same. Rounding to 32-bit floats happens after that; a warning says if it does harm.
///
/// Figures: `triangles`, `kept_triangles` (those of an input, whole and unchanged), `seam_edges` (along which surfaces were
/// cut), `intersecting_pairs` of triangles, `mending_rounds` after rounding to double precision, `self_intersections`, `solid` (0
/// or 1), `volume` in cubic units of the files; `largest_rounding` if the output holds 32-bit floats. The result, in JSON, is
/// what was found out about each input: `name`, `path`, `triangles`, `closed`, `oriented`, `self_intersections`,
/// `degenerate_triangles`, `closing_triangles`, `reversed_parts`, and `assumptions` in sentences, which are warnings, too.
///
/// # Errors
/// [`JobError::Expression`], [`JobError::Parameter`], [`JobError::UnknownMeshFormat`], [`JobError::ReadMesh`],
/// [`JobError::NoTriangles`], [`JobError::Boolean`], [`JobError::WriteMesh`], [`JobError::Write`], what
/// [`check_files`] refuses, [`JobError::Cancelled`].
pub fn run(
    expression: &str,
    files: &[NamedFile],
    limits: &MeshLimits,
    targets: &Targets,
    params: &Params,
    progress: &Progress,
) -> Result<Report, JobError> {
    let names = named::names(files)?;
    let expr = parsed(expression, &names)?;
    let used = expr.meshes();
    params.output.check(&targets.mesh)?;
    if let Some(path) = &targets.picture {
        check_target(path)?;
    }
    if let Some(path) = &targets.origins {
        origins::check(path)?;
    }
    let inputs: Vec<&Path> = used.iter().map(|&i| files[i].path.as_path()).collect();
    check_files(&inputs, &targets.paths())?;
    let mut report = Report::new("boolean", params);
    for (i, name) in names.iter().enumerate() {
        if !used.contains(&i) {
            report.warn(format!(
                "{} is {name}, which the expression does not name: it was not read",
                files[i].path.display()
            ));
        }
    }
    let read = read_all(files, &used, limits, targets, params, &mut report, progress)?;
    let Inputs {
        meshes,
        colors,
        textures,
        _files,
        target,
    } = read;
    let asked = library::BooleanParams {
        inside: params.inside.into(),
        memory_bytes: params.memory.map(|size| size.as_u64()),
    };
    let result = report.time("boolean", || {
        library::boolean(&meshes, &expr, &asked, progress)
    });
    let result = result.map_err(|cause| match cause {
        BooleanError::Cancelled => JobError::Cancelled,
        cause => JobError::Boolean { cause },
    })?;
    tell(&result.report, &used, &names, files, &mut report);
    let yes = |fact: bool| f64::from(u8::from(fact));
    let done = &result.report;
    report.figures.extend([
        ("triangles", done.triangles as f64),
        ("kept_triangles", done.kept_triangles as f64),
        ("seam_edges", result.feature_edges.len() as f64),
        ("intersecting_pairs", done.intersecting_pairs as f64),
        ("mending_rounds", f64::from(done.repair_rounds)),
        ("self_intersections", done.self_intersections as f64),
        ("solid", yes(done.solid)),
        ("volume", done.volume),
    ]);
    if done.moved > 0.0 {
        report.warn(format!(
            "surfaces nearly lie on one another: vertices there were moved by up to {:.1e} to keep the result free of intersections",
            done.moved
        ));
    }
    if result.mesh.triangles().is_empty() {
        report.warn("nothing is inside: the result is empty");
    } else if rounds(&target) {
        report_rounding(&result.mesh, target, &mut report, progress)?;
    }
    let carried = Attributes {
        colors: &attributes::colors_of(&result, &meshes, &colors),
        texture: &attributes::texture_of(&result, &meshes, &textures),
    };
    super::write_with(
        &targets.mesh,
        &result.mesh,
        carried,
        &target,
        &mut report,
        progress,
    )?;
    if let Some(path) = &targets.origins {
        let inputs: Vec<_> = names.iter().zip(files).collect();
        origins::write(path, &inputs, &result.origins, &mut report)?;
    }
    if let Some(path) = &targets.picture {
        picture::write(path, &result, params.view, &mut report, progress)?;
    }
    Ok(report)
}

/// Input as read.
struct Inputs {
    /// By index; those that are not used are empty.
    meshes: Vec<TriMesh>,
    /// Colors of their vertices, where there are any.
    colors: Vec<Vec<[u8; 4]>>,
    /// Texture coordinates of the corners of their triangles, where there are any.
    textures: Vec<Vec<[DVec2; 3]>>,
    /// The rest of the files: the memory of all that was read stays reserved as long as they are there.
    _files: Vec<MeshFile>,
    target: MeshTarget,
}

fn read_all(
    files: &[NamedFile],
    used: &[usize],
    limits: &MeshLimits,
    targets: &Targets,
    params: &Params,
    report: &mut Report,
    progress: &Progress,
) -> Result<Inputs, JobError> {
    // what standard output takes is known once the first mesh is
    let output = params.output.target(&targets.mesh, MeshFormat::PlyBinary)?;
    let mut target: Option<MeshTarget> = None;
    let mut meshes = vec![TriMesh::default(); files.len()];
    let mut colors = vec![Vec::new(); files.len()];
    let mut textures = vec![Vec::new(); files.len()];
    let mut read = Vec::new();
    for &i in used {
        let source = MeshSource {
            path: files[i].path.clone(),
            limits: limits.clone(),
        };
        let outputs = targets.paths();
        let mut file = super::read_with_attributes(&source, &outputs, report, progress)?;
        if file.mesh.triangles().is_empty() {
            return Err(JobError::NoTriangles { path: source.path });
        }
        let unit = params.unit.map(LengthUnit::from).or(file.unit);
        let target = match &mut target {
            Some(target) => target,
            none => {
                let mut first = params.output.target(&targets.mesh, file.format)?;
                first.unit = unit;
                none.insert(first)
            }
        };
        if let (Some(from), Some(to)) = (unit, target.unit)
            && from != to
        {
            let scale = from.in_meters() / to.in_meters();
            report.warn(format!(
                "{} is in units of one {from}: it was scaled by {scale} to the {to} of the first mesh",
                source.path.display()
            ));
            file.mesh = scaled(file.mesh, scale, &source)?;
        }
        super::keep_held(&mut file, &source.path, target, report);
        meshes[i] = std::mem::take(&mut file.mesh);
        colors[i] = std::mem::take(&mut file.colors);
        textures[i] = std::mem::take(&mut file.texture);
        read.push(file);
    }
    // an expression always names a mesh
    let target = target.unwrap_or(output);
    Ok(Inputs {
        meshes,
        colors,
        textures,
        _files: read,
        target,
    })
}

/// Puts what was found out and what was assumed into the report.
fn tell(
    done: &BooleanReport,
    used: &[usize],
    names: &[String],
    files: &[NamedFile],
    report: &mut Report,
) {
    let mut inputs = Vec::new();
    for &i in used {
        let path = files[i].path.display().to_string();
        let operand = &done.operands[i];
        for assumption in &operand.assumptions {
            report.warn(format!("{path}: {assumption}"));
        }
        if done.pruned.contains(&(i as u32)) {
            report.warn(format!("{path} does not matter for the result"));
        }
        inputs.push(serde_json::json!({
            "name": names[i],
            "path": path,
            "triangles": operand.triangles,
            "closed": operand.closed,
            "oriented": operand.oriented,
            "self_intersections": operand.self_intersections,
            "degenerate_triangles": operand.degenerate_triangles,
            "closing_triangles": operand.closing_triangles,
            "reversed_parts": operand.reversed_parts,
            "assumptions": operand.assumptions,
        }));
    }
    report.result = Some(serde_json::Value::Array(inputs));
    let sound = done.solid || done.triangles == 0;
    report.passed = Some(sound);
    if done.self_intersections > 0 {
        report.findings.push(Finding {
            what: "self-intersections",
            count: done.self_intersections,
            defect: true,
            places: Vec::new(),
        });
    }
    if !sound {
        report.warn(match done.self_intersections {
            0 => "the result is not closed or not manifold".to_owned(),
            count => format!("the result meets itself {count} times"),
        });
    }
}

/// Says what 32-bit floats do to the mesh.
fn report_rounding(
    mesh: &TriMesh,
    target: MeshTarget,
    report: &mut Report,
    progress: &Progress,
) -> Result<(), JobError> {
    let written = report.time("check", || rounded(mesh, target, progress))?;
    report.figures.insert("largest_rounding", written.moved);
    let Some(found) = written.check else {
        return Ok(());
    };
    let pairs = found
        .self_intersections
        .as_ref()
        .map_or(0, |pairs| pairs.count);
    if pairs > 0 {
        report.warn(format!(
            "rounded to the 32-bit floats of the file, the result meets itself {pairs} times: PLY, OBJ, OFF and 3MF keep it as it is"
        ));
    } else if !found.is_solid() {
        report.warn(
            "rounded to the 32-bit floats of the file, the result is not closed or not manifold: PLY, OBJ, OFF and 3MF keep it as \
             it is",
        );
    }
    Ok(())
}

#[cfg(test)]
mod tests;
